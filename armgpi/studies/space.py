"""What a search varies: parameters of a controller's section, from their declarations."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import Parameter
from armgpi.config.schema import KINDS
from armgpi.control.controller import Controller
from armgpi.errors import NameNotFound, ParameterError
from armgpi.loop.variables import Variable, of_controller
from armgpi.robot.changes import CHANGES
from armgpi.studies.evaluation import with_keys

#: Searched where nothing is said only while the key that each is for is not zero, or asked for by name alone.
_NEEDS = {
    "rolloff_ratio": "rolloff",
    "second_ratio": "",
    "second_zeta": "",
    "link_factor": "",
    "rotor_factor": "",
}
#: Parts of an experiment that scenarios have of their own; what to do about their numbers, and others'.
_DRAWN = ("robot", "plant", "reference", "supervisor", "reality")
_ELSE = "scenarios are drawn, and a controller's numbers searched: `armgpi sweep` varies all others"
_FORM = "it decides the form of the generated code: make a search for each value"
#: Least value of what is varied by factors and may be zero.
_LEAST = 1e-12


class Range(NamedTuple):
    """How a free parameter is searched, where it is not as declared.

    Attributes:
        low: lowest value; the declared one when not given.
        high: highest value; likewise.
        per_joint: whether it may differ from joint to joint.
    """

    low: float | None = None
    high: float | None = None
    per_joint: bool = False


class Dimension(NamedTuple):
    """One number that is searched.

    Attributes:
        key: of the section, with a dot before a key of a group.
        end: "lower" or "upper" of a box; empty for what is none.
        joint: whose it is; None for all.
        basis: of which basis function; None for what is no table.
        low: lowest value.
        high: highest value.
        log: whether it is varied by factors.
        start: value to begin with.
        unit: of the value; empty where it has none.
    """

    key: str
    end: str
    joint: int | None
    basis: int | None
    low: float
    high: float
    log: bool
    start: float
    unit: str = ""

    @property
    def name(self) -> str:
        """What it is called, but for its joint."""
        basis = "" if self.basis is None else str(self.basis + 1)
        return ".".join(part for part in (self.key, self.end, basis) if part)

    def name_with(self, joints: Sequence[str]) -> str:
        """Return what it is called, with the name of its joint."""
        return self.name if self.joint is None else f"{self.name} {joints[self.joint]}"

    def label(self, joints: Sequence[str]) -> str:
        """Return its name with its joint, range and unit, as pictures show it."""
        return f"{self.name_with(joints)}, {self.low:.3g} to {self.high:.3g} {self.unit}".rstrip()

    def value(self, x: float) -> float:
        """Return the value at a place in [0, 1]."""
        x = min(max(x, 0.0), 1.0)
        if self.log:
            return float(self.low * (self.high / self.low) ** x)
        return float(self.low + (self.high - self.low) * x)

    def place(self, value: float) -> float:
        """Return the place of a value in [0, 1], the nearer end of one outside."""
        value = min(max(value, self.low), self.high)
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


class Space:
    """The free numbers of a controller's section, as a cube [0, 1]^d.

    Attributes:
        section: the section, as plain data.
        dimensions: the free numbers.
        names: what they are called, in the same order.
        joints: names of the joints.
    """

    def __init__(
        self, section: Mapping[str, Any], made: Controller, free: Mapping[str, Range] | None = None
    ) -> None:
        """Find what is free.

        Args:
            section: of a controller, plain data.
            made: the controller that it describes, for the values to begin with.
            free: keys and how they are searched; when not given all that declare a range of search.

        Raises:
            NameNotFound: when a key is not one of the controller's numbers.
            ParameterError: when a range leaves the bounds of its parameter, or nothing is free.
        """
        self.section = copy.deepcopy(dict(section))
        kind = KINDS[section["type"]]
        known = numbers(made)
        chosen = dict.fromkeys(_default(known, section), Range()) if free is None else dict(free)
        chosen = {key.removeprefix("controller."): searched for key, searched in chosen.items()}
        if not chosen:
            raise ParameterError("free", list(chosen), f"some of {', '.join(known)}")
        self.dimensions: list[Dimension] = []
        for key, searched in chosen.items():
            if key not in known:
                remedy = _ELSE if key.split(".")[0] in _DRAWN else _FORM if key in kind.parameters else ""
                raise NameNotFound("number to search", key, () if remedy else tuple(known), remedy)
            declared, value = known[key].declared, known[key].value
            low, high = _ends(key, declared, searched, value)
            begin = _begin(declared, value, low, high, made)
            self.dimensions += _dimensions(key, declared, begin, low, high, searched)
        self.joints = made.robot.joint_names
        self.names = [each.name_with(self.joints) for each in self.dimensions]

    @property
    def start(self) -> Array:
        """Where the section's own values are, shape (d,)."""
        return np.array([each.place(each.start) for each in self.dimensions])

    def values(self, x: Array) -> Array:
        """Return the numbers at a place in the cube, shape (d,)."""
        return np.array([each.value(float(at)) for each, at in zip(self.dimensions, x, strict=True)])

    def keys(self, x: Array) -> dict[str, Any]:
        """Return the values of the free keys at a place in the cube, as an experiment file has them."""
        return self.keys_of(self.values(x))

    def keys_of(self, values: Sequence[float] | Array) -> dict[str, Any]:
        """Return the values of the free keys, as an experiment file has them, from the numbers."""
        found: dict[str, list[tuple[Dimension, float]]] = {}
        for each, value in zip(self.dimensions, values, strict=True):
            found.setdefault(each.key, []).append((each, float(value)))
        return {key: _value(own) for key, own in found.items()}

    def with_values(self, x: Array) -> dict[str, Any]:
        """Return the section with the numbers at a place in the cube."""
        return with_keys(self.section, self.keys(x))


def numbers(made: Controller) -> dict[str, Variable]:
    """Return what can be searched of a controller, by its keys in a file: those of groups have a dot."""
    found = (each for each in of_controller(made) if each.declared.kind in ("number", "box", "table"))
    own = {each.name.removeprefix("controller."): each for each in found if not each.fixed}
    return {key: each for key, each in own.items() if each.declared.in_file and key not in CHANGES}


def _default(known: Mapping[str, Variable], section: Mapping[str, Any]) -> list[str]:
    """Return the keys that are free when nothing is said."""
    declared = {key: each.declared for key, each in known.items() if each.declared.kind != "table"}
    searched = [key for key, each in declared.items() if each.search]
    if not searched:  # who declares none has all of which something tells a range
        searched = [key for key, each in declared.items() if each.range(known[key].value) is not None]
    return [key for key in searched if key not in _NEEDS or section.get(_NEEDS[key])]


def _ends(key: str, declared: Parameter, searched: Range, value: Any) -> tuple[float, float]:
    """Return the lowest and highest value.

    Raises:
        ParameterError: when they leave the bounds of the parameter, or are no range.
    """
    known = declared.range(value)
    if known is None and None in searched[:2]:
        raise ParameterError(f"free.{key}", value, "low and high: nothing declares a range of it")
    low, high = (x if y is None else y for x, y in zip(known or (0.0, 0.0), searched[:2], strict=True))
    if outside := [end for end in (low, high) if not declared.inside(np.array(end))]:
        raise ParameterError(f"free.{key}", outside[0], f"within the bounds of {key}: {declared.bounds}")
    if not low < high:
        raise ParameterError(f"free.{key}", [low, high], "a lowest value below the highest")
    if declared.log and low <= 0.0:
        raise ParameterError(f"free.{key}", low, f"above {_LEAST:g}: it is varied by factors")
    return low, high


def _begin(declared: Parameter, value: Any, low: float, high: float, made: Any) -> Any:
    """Return the value to begin with: an array over the joints, a box of two, or a table."""
    n = made.robot.n
    if declared.kind == "table":
        return np.zeros((n, made.gains.size)) if value is None else value
    if declared.kind == "box":
        return value if value is not None else (np.full(n, 30.0), np.full(n, 30.0))
    if value is None:  # as another one is: begin in the middle
        value = math.sqrt(low * high) if declared.log else 0.5 * (low + high)
    return np.broadcast_to(np.asarray(value, dtype=np.float64), (n,) if declared.per_joint else ())


def _dimensions(
    key: str, declared: Parameter, begin: Any, low: float, high: float, searched: Range
) -> list[Dimension]:
    """Return the numbers of one parameter."""
    log = declared.log
    ends = [("", begin)]
    if isinstance(begin, tuple):
        # One value that does not vary is one number, a box has two.
        same = np.array_equal(*begin)
        ends = [("", begin[0])] if same else [("lower", begin[0]), ("upper", begin[1])]
    found = []
    for end, start in ends:
        # A table's last axis is that of the basis functions.
        functions = range(start.shape[-1]) if declared.kind == "table" else [None]
        joints = range(len(start)) if searched.per_joint and start.ndim else [None]
        for joint in joints:
            for basis in functions:
                value = start if basis is None else start[..., basis]
                value = value if joint is None else value[joint]
                shared = np.clip(value, low, high)
                mean = math.exp(np.log(shared).mean()) if log else float(np.mean(shared))
                found.append(Dimension(key, end, joint, basis, low, high, log, mean, declared.unit or ""))
    return found


def _value(own: Sequence[tuple[Dimension, float]]) -> Any:
    """Return the value of a key from its numbers, as an experiment file has it."""
    if own[0][0].end:
        ends = [[(d._replace(end=""), v) for d, v in own if d.end == end] for end in ("lower", "upper")]
        lower, upper = np.array(_value(ends[0])), np.array(_value(ends[1]))
        # Whichever is the smaller one is the lower end.
        low, high = np.minimum(lower, upper), np.maximum(lower, upper)
        return {"lower": low.tolist(), "upper": high.tolist()}
    values = [value for _, value in own]
    joints = {each.joint for each, _ in own}
    if own[0][0].basis is None:
        return values if None not in joints else values[0]
    return values if None in joints else np.reshape(values, (len(joints), -1)).tolist()
