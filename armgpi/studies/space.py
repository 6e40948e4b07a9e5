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
#: Parts of an experiment that scenarios have of their own.
_DRAWN = ("robot", "plant", "reference", "supervisor", "reality")
#: What to do about a number of one of them.
_ELSE = "scenarios are drawn, and a controller's numbers searched: `armgpi sweep` varies all others"
#: What to do about a parameter of the controller that is no number.
_FORM = "it decides the form of the generated code: make a search for each value"
#: Least value of what is varied by factors and may be zero.
_LEAST = 1e-12
#: Ends of a box whose section gives none, to begin with [rad/s].
_BEGIN_OF_BOX = 30.0


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
        parts = [self.key]
        if self.end:
            parts.append(self.end)
        if self.basis is not None:
            parts.append(str(self.basis + 1))
        return ".".join(parts)

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
        known = numbers(made)
        if free is None:
            free = dict.fromkeys(_default(known, section), Range())
        ranges = {key.removeprefix("controller."): searched for key, searched in free.items()}
        if not ranges:
            raise ParameterError("free", [], f"some of {', '.join(known)}")
        self.dimensions: list[Dimension] = []
        for key, searched in ranges.items():
            if key not in known:
                raise _not_found(key, section["type"], known)
            declared, value = known[key].declared, known[key].value
            low, high = _ends(key, declared, searched, value)
            begin = _begin(declared, value, low, high, made)
            self.dimensions += _dimensions(key, declared, begin, low, high, searched)
        self.joints = made.robot.joint_names
        self.names = [dimension.name_with(self.joints) for dimension in self.dimensions]

    @property
    def start(self) -> Array:
        """Where the section's own values are, shape (d,)."""
        return np.array([dimension.place(dimension.start) for dimension in self.dimensions])

    def values(self, x: Array) -> Array:
        """Return the numbers at a place in the cube, shape (d,)."""
        values = []
        for dimension, place in zip(self.dimensions, x, strict=True):
            values.append(dimension.value(float(place)))
        return np.array(values)

    def keys(self, x: Array) -> dict[str, Any]:
        """Return the values of the free keys at a place in the cube, as an experiment file has them."""
        return self.keys_of(self.values(x))

    def keys_of(self, values: Sequence[float] | Array) -> dict[str, Any]:
        """Return the values of the free keys, as an experiment file has them, from the numbers."""
        numbers_of: dict[str, list[_Number]] = {}
        for dimension, value in zip(self.dimensions, values, strict=True):
            numbers_of.setdefault(dimension.key, []).append(_Number(dimension, float(value)))
        return {key: _value(numbers) for key, numbers in numbers_of.items()}

    def with_values(self, x: Array) -> dict[str, Any]:
        """Return the section with the numbers at a place in the cube."""
        return with_keys(self.section, self.keys(x))


def numbers(made: Controller) -> dict[str, Variable]:
    """Return what can be searched of a controller, by its keys in a file: those of groups have a dot."""
    searchable = {}
    for variable in of_controller(made):
        key = variable.name.removeprefix("controller.")
        declared = variable.declared
        is_number = declared.kind in ("number", "box", "table")
        if is_number and declared.in_file and not variable.fixed and key not in CHANGES:
            searchable[key] = variable
    return searchable


def _not_found(key: str, kind: str, known: Mapping[str, Variable]) -> NameNotFound:
    """Return the error for a key that is no number of a controller, with what to do instead."""
    remedy = ""
    if key.split(".")[0] in _DRAWN:
        remedy = _ELSE
    elif key in KINDS[kind].parameters:
        remedy = _FORM
    return NameNotFound("number to search", key, () if remedy else tuple(known), remedy)


def _default(known: Mapping[str, Variable], section: Mapping[str, Any]) -> list[str]:
    """Return the keys that are free when nothing is said."""
    no_tables = {key: variable for key, variable in known.items() if variable.declared.kind != "table"}
    searched = [key for key, variable in no_tables.items() if variable.declared.search]
    if not searched:  # who declares none has all of which something tells a range
        for key, variable in no_tables.items():
            if variable.declared.range(variable.value) is not None:
                searched.append(key)
    return [key for key in searched if key not in _NEEDS or section.get(_NEEDS[key])]


def _ends(key: str, declared: Parameter, searched: Range, value: Any) -> tuple[float, float]:
    """Return the lowest and highest value.

    Raises:
        ParameterError: when they leave the bounds of the parameter, or are no range.
    """
    known = declared.range(value)
    if known is None and None in (searched.low, searched.high):
        raise ParameterError(f"free.{key}", value, "low and high: nothing declares a range of it")
    low, high = known or (0.0, 0.0)
    if searched.low is not None:
        low = searched.low
    if searched.high is not None:
        high = searched.high
    for end in (low, high):
        if not declared.inside(np.array(end)):
            raise ParameterError(f"free.{key}", end, f"within the bounds of {key}: {declared.bounds}")
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
        if value is None:
            return np.full(n, _BEGIN_OF_BOX), np.full(n, _BEGIN_OF_BOX)
        return value
    if value is None:  # as another one is: begin in the middle
        value = math.sqrt(low * high) if declared.log else 0.5 * (low + high)
    shape = (n,) if declared.per_joint else ()
    return np.broadcast_to(np.asarray(value, dtype=np.float64), shape)


def _dimensions(
    key: str, declared: Parameter, begin: Any, low: float, high: float, searched: Range
) -> list[Dimension]:
    """Return the numbers of one parameter."""
    ends = {"": begin}
    if isinstance(begin, tuple):
        # One value that does not vary is one number, a box has two.
        lower, upper = begin
        ends = {"": lower} if np.array_equal(lower, upper) else {"lower": lower, "upper": upper}
    dimensions = []
    for end, start in ends.items():
        # A table's last axis is that of the basis functions.
        functions = range(start.shape[-1]) if declared.kind == "table" else [None]
        joints = range(len(start)) if searched.per_joint and start.ndim else [None]
        for joint in joints:
            for basis in functions:
                value = start if basis is None else start[..., basis]
                value = value if joint is None else value[joint]
                inside = np.clip(value, low, high)
                # What joints share begins at their mean.
                mean = math.exp(np.log(inside).mean()) if declared.log else float(np.mean(inside))
                dimension = Dimension(
                    key, end, joint, basis, low, high, declared.log, mean, declared.unit or ""
                )
                dimensions.append(dimension)
    return dimensions


class _Number(NamedTuple):
    """A number that is searched, and its value."""

    dimension: Dimension
    value: float


def _value(numbers: Sequence[_Number]) -> Any:
    """Return the value of a key from its numbers, as an experiment file has it."""
    first = numbers[0].dimension
    if first.end:
        lower, upper = (np.array(_value(_of_end(numbers, end))) for end in ("lower", "upper"))
        # Whichever is the smaller one is the lower end.
        low, high = np.minimum(lower, upper), np.maximum(lower, upper)
        return {"lower": low.tolist(), "upper": high.tolist()}
    values = [number.value for number in numbers]
    joints = {number.dimension.joint for number in numbers}
    is_shared = None in joints
    if first.basis is None:
        return values[0] if is_shared else values
    return values if is_shared else np.reshape(values, (len(joints), -1)).tolist()


def _of_end(numbers: Sequence[_Number], end: str) -> list[_Number]:
    """Return the numbers of one end of a box, as if they were no end."""
    of_end = []
    for dimension, value in numbers:
        if dimension.end == end:
            of_end.append(_Number(dimension._replace(end=""), value))
    return of_end
