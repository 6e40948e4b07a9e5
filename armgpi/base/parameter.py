"""A parameter is declared once: its sentence, unit, default, bounds, and how it may be given.

A class lists its parameters as fields::

    @with_parameters
    class PIDInversion(Controller):
        kp: PerJoint = parameter("proportional gain", unit="1/s^2", default=400.0, least=0.0, per_joint=True)

From that come its ``__init__`` with the checks, ``describe()``, the section of the experiment file, the
option of the command line with its help, the comment in exported C, and the row of the documentation's table.
"""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, FrozenInstanceError, dataclass, field, fields, is_dataclass, replace
from enum import Enum
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np

from armgpi.base.arrays import (
    Array,
    ArrayLike,
    PerJointInput,
    as_sized_array,
    check_number,
    check_whole,
    is_listing,
    per_joint,
    positive,
    sizes,
)
from armgpi.base.hints import MissingAttribute, with_keyword_hints
from armgpi.errors import ArrayError, NameNotFound, ParameterError, show_value

if sys.version_info >= (3, 11):  # quick to import
    from typing import dataclass_transform
else:
    from typing_extensions import dataclass_transform


class _Required(Enum):
    REQUIRED = "required"


#: What a parameter's value is. A range is two numbers. A box is (lower, upper), or one value that does not
#: vary. A table has a list of numbers for each joint, or one for all. A group has parameters of its own below
#: it; a variant is one of the named classes below a base class.
Kind = Literal[
    "number",
    "integer",
    "seed",
    "choice",
    "flag",
    "text",
    "box",
    "range",
    "vector",
    "numbers",
    "times",
    "points",
    "table",
    "group",
    "variant",
]
#: Default of a parameter that must be given.
REQUIRED: Any = _Required.REQUIRED

#: How far a range stays from a bound that is too small or too large itself, as a share of the whole.
_EDGE = 1e-3

_Same = TypeVar("_Same", bound="Parametrised")
_Class = TypeVar("_Class", bound=type)

if TYPE_CHECKING:

    class PerJoint:
        """Type of a per-joint field: given as numbers, lists or arrays; an array once it is checked."""

        def __get__(self, instance: object, owner: type) -> Array:
            """Return the checked array."""

        def __set__(self, instance: object, value: PerJointInput) -> None:
            """Take what the constructor takes."""

    class Vector:
        """Type of a field of three numbers: given as a list or an array; an array once it is checked."""

        def __get__(self, instance: object, owner: type) -> Array:
            """Return the checked array."""

        def __set__(self, instance: object, value: ArrayLike) -> None:
            """Take what the constructor takes."""

else:
    PerJoint, Vector = PerJointInput, ArrayLike


@dataclass(frozen=True)
class Parameter:
    """What is known of a parameter.

    Attributes:
        text: what it is, in one sentence or less.
        unit: its unit; empty for none.
        kind: what its value is.
        default: its default, `REQUIRED` when it must be given.
        least: lower bound.
        most: upper bound.
        above: whether the lower bound itself is too small.
        below: whether the upper bound itself is too large.
        per_joint: whether it may differ from joint to joint.
        choices: what a choice may be.
        none: what None means, which is then allowed.
        unlimited: what infinity means, which is then allowed; None (null) in an experiment file.
        chosen: what an experiment takes when its file says nothing; the class works it out.
        key: its name in an experiment file and on the command line; its own name when empty.
        in_file: whether it is there at all. What is not comes from the experiment: robot, dt, seed.
        group: the class of a group, or the base class of a variant.
        follows: the parameter whose value it takes where it is None.
        short: its option of the command line in few words; `text` when empty.
        log: whether it is to be varied by factors, not by differences.
        structural: whether it decides the form of the generated code, so that it cannot vary by rollout.
        search: from where to where a search varies it.
        slider: from where to where a slider moves it.
        name: name of the field.
    """

    text: str
    unit: str = ""
    kind: Kind = "number"
    default: Any = REQUIRED
    least: float = -math.inf
    most: float = math.inf
    above: bool = False
    below: bool = False
    per_joint: bool = False
    choices: tuple[str, ...] = ()
    none: str = ""
    unlimited: str = ""
    chosen: str = ""
    key: str = ""
    in_file: bool = True
    group: type | None = None
    follows: str = ""
    short: str = ""
    log: bool = False
    structural: bool = False
    search: tuple[float, float] | None = None
    slider: tuple[float, float] | None = None
    name: str = ""

    @property
    def file_key(self) -> str:
        """Its name in an experiment file and on the command line."""
        return self.key or self.name

    @property
    def bounds(self) -> str:
        """What its values have to be, in words, with their unit."""
        if self.kind in ("integer", "seed"):
            limit = (
                f"from {self.least:g} to {self.most:g}" if self.most < math.inf else f"{self.least:g} or more"
            )
            return f"a whole number, {limit}"
        unit = f" [{self.unit}]" if self.unit else ""
        if math.isfinite(self.most):
            ends = f"{'(' if self.above else '['}{self.least:g}, {self.most:g}{')' if self.below else ']'}"
            return f"in {ends}{unit}"
        if self.least == 0.0:
            return f"{'positive' if self.above else 'zero or positive'}{unit}"
        if math.isfinite(self.least):
            return f"{'above' if self.above else 'at least'} {self.least:g}{unit}"
        return f"finite{unit}"

    @property
    def optional(self) -> bool:
        """Whether it may be null in an experiment file."""
        return bool(self.none or self.chosen or self.unlimited)

    @property
    def file_default(self) -> Any:
        """Its default in an experiment file."""
        return None if self.chosen or self.default == math.inf else plain(self.default)

    @property
    def meaning(self) -> str:
        """What it is, up to a semicolon, with its unit: for a comment."""
        said = self.text.partition(";")[0]
        return f"{said} [{self.unit or '-'}]" if self.numeric else said

    def range(self, value: Any = None) -> tuple[float, float] | None:
        """Return from where to where it goes where nobody says it; None where nothing tells.

        That is its search, else its slider, else its bounds, else a tenth to ten times its value.

        Args:
            value: what it is now: numbers, or None.
        """
        if self.search or self.slider:
            return self.search or self.slider
        if math.isfinite(self.least) and math.isfinite(self.most):
            edge = _EDGE * (self.most - self.least)
            return self.least + edge * self.above, self.most - edge * self.below
        now = np.ravel(np.asarray(0.0 if value is None else value, dtype=np.float64))
        now = now[np.isfinite(now) & (now != 0.0)]
        if not now.size:
            return None
        around = now * [[0.1], [10.0]]
        return max(float(around.min()), self.least), min(float(around.max()), self.most)

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers with a unit."""
        return self.kind in ("number", "box", "range", "vector", "numbers", "table")

    def inside(self, values: Array) -> Any:
        """Tell which values of an array are within the bounds, and whole where they have to be."""
        low = values > self.least if self.above else values >= self.least
        if self.above and self.least == 0.0:
            low = positive(values)
        high = values < self.most if self.below else values <= self.most
        return low & high & (values == np.rint(values)) if self.kind == "integer" else low & high

    def broken_limit(self, value: float) -> str:
        """Return which bound a number breaks, in words; empty for none."""
        if value < self.least or (self.above and value == self.least):
            return f"a number above {self.least:g}" if self.above else f"{self.least:g} or more"
        if value > self.most or (self.below and value == self.most):
            return f"a number below {self.most:g}" if self.below else f"{self.most:g} or less"
        return ""

    def check_value(self, value: Any, joint_names: Sequence[str] | None = None) -> Any:
        """Return a value as it is to be kept: a number, or for per-joint ones an array.

        Args:
            value: what was given.
            joint_names: of the joints; when they are known, an array over them is returned.

        Raises:
            ParameterError: when a single value is not as declared, or a per-joint one of unknown joints.
            ArrayError: when a per-joint value is not, or does not fit the joints; it names the joint.
        """
        if value is None and self.none:
            return None
        if self.unlimited and isinstance(value, float) and value == math.inf:
            return math.inf
        kinds: Mapping[str, Callable[[Any], Any]] = {
            "box": lambda x: self._box(x, joint_names),
            "table": lambda x: self._table(x, joint_names),
            "range": self._range,
            "vector": self._numbers,
            "numbers": self._numbers,
            "seed": lambda x: _seeds(x, self),
            "number": lambda x: self._per_joint(x, joint_names) if self.per_joint else self._number(x),
        }
        kinds = {**kinds, "integer": kinds["number"]}
        return kinds.get(self.kind, self._word)(value)

    def _word(self, value: Any) -> Any:
        """Return a choice, a flag or text; parts are checked by themselves."""
        if self.kind == "choice" and not (isinstance(value, str) and value in self.choices):
            raise ParameterError(self.name, value, f"one of {', '.join(self.choices)}")
        if self.kind == "flag" and not isinstance(value, bool):
            raise ParameterError(self.name, value, "True or False")
        if self.kind == "text" and not isinstance(value, str):
            raise ParameterError(self.name, value, "text")
        return value

    @property
    def varies(self) -> bool:
        """Whether it may differ by rollout: it is a number, and does not decide the form of the code."""
        return self.kind in ("number", "integer", "seed", "box", "table") and not self.structural

    def _number(self, value: Any) -> Any:
        """Return a single number, or a column of them, one for each rollout."""
        if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == 1 and self.varies:
            return self._per_joint(value, None)
        if self.kind == "integer":
            return check_whole(value, self.name, int(self.least), int(min(self.most, 2**63 - 1)))
        number = check_number(value, self.name, self.bounds, self.least, self.most, open_=self.above)
        if self.below and number == self.most:
            raise ParameterError(self.name, value, self.bounds)
        return number

    def _per_joint(self, value: Any, joint_names: Sequence[str] | None) -> Array:
        """Return an array, over the joints where they are known."""
        if self.kind == "integer" and not is_listing(value):
            value = self._number(value)
        expected = "whole numbers as" if self.kind == "integer" else self.bounds
        if joint_names is not None:
            return per_joint(value, self.name, joint_names, expected, self.inside)
        array = as_sized_array(value, self.name)
        if not array.size:
            raise ArrayError(self.name, f"expected {expected} values, got none")
        if not self.inside(array).all():
            wrong = array[~self.inside(array)].flat[0]
            raise ParameterError(self.name, float(wrong), f"{expected}{sizes(wrong)}")
        return array

    def _numbers(self, value: Any) -> Array:
        """Return a vector of three numbers, or a list of any length."""
        array = as_sized_array(value, self.name)
        if self.kind == "vector" and array.shape != (3,):
            raise ArrayError(self.name, f"expected three numbers, got shape {array.shape}")
        return array

    def _table(self, value: Any, joint_names: Sequence[str] | None) -> Any:
        """Return a list of numbers for each joint, (n, k) or (batch, n, k) once the joints are known."""
        if isinstance(value, Mapping):
            if joint_names is None:
                return value
            for joint in value:
                if joint not in joint_names:
                    raise NameNotFound("joint", joint, joint_names)
            if missing := [joint for joint in joint_names if joint not in value]:
                raise ArrayError(self.name, f"needs values for {', '.join(missing)} as well")
            value = [value[joint] for joint in joint_names]
        array = as_sized_array(value, self.name)
        if array.ndim not in (1, 2, 3) or not array.size:
            raise ArrayError(self.name, f"expected a list of numbers, or one per joint, got {array.shape}")
        if joint_names is None:
            return array
        n = len(joint_names)
        if array.ndim > 1 and array.shape[-2] != n:
            raise ArrayError(
                self.name, f"expected {n} lists ({', '.join(joint_names)}), got {array.shape[-2]}"
            )
        return np.ascontiguousarray(np.broadcast_to(array, (*array.shape[:-2], n, array.shape[-1])))

    def _range(self, value: Any) -> tuple[float, float]:
        """Return the two ends of a range."""
        ends = as_sized_array(value, self.name)
        if ends.shape != (2,) or not self.inside(ends).all() or ends[0] > ends[1]:
            raise ParameterError(self.name, value, f"[lowest, highest], {self.bounds}")
        return float(ends[0]), float(ends[1])

    def _box(self, value: Any, joint_names: Sequence[str] | None) -> tuple[Array, Array]:
        """Return the lower and upper end, which are the same for one value."""
        ends = value if isinstance(value, tuple) else (value, value)
        if len(ends) != 2:
            raise ParameterError(self.name, value, "a number or (lower, upper)")
        if ends[0] is ends[1]:  # one value, which does not vary
            return (self._per_joint(ends[0], joint_names),) * 2
        low, high = (self._per_joint(end, joint_names) for end in ends)
        if np.any(low > high):
            raise ArrayError(self.name, f"expected lower <= upper, got {low.tolist()} above {high.tolist()}")
        return low, high


def _seeds(value: Any, declared: Parameter) -> Any:
    """Return a seed, or those of all rollouts (batch, 1): any whole numbers, which count modulo 2^64."""
    if not is_listing(value):
        return check_whole(value, declared.name, int(declared.least))
    try:
        seeds = np.asarray(value)
    except ValueError:  # a ragged list
        seeds = np.empty(0)
    if seeds.shape not in ((seeds.size,), (seeds.size, 1)) or not seeds.size or seeds.dtype.kind not in "iu":
        raise ParameterError(declared.name, value, "a whole number, or one for each rollout")
    return seeds.astype(np.uint64).reshape(-1, 1)


def parameter(text: str, *, default: Any = REQUIRED, kw_only: bool = False, **facts: Any) -> Any:
    """Declare a field as a parameter.

    Args:
        text: what it is, in one sentence or less, without its unit.
        default: its default; it must be given when there is none.
        kw_only: whether the constructor takes it by its name alone.
        **facts: further attributes of :class:`Parameter`.
    """
    return field(
        default=MISSING if default is REQUIRED else default,
        kw_only=kw_only,
        metadata={"parameter": Parameter(text, default=default, **facts)},
    )


def again(text: str | None = None, *, default: Any = REQUIRED, **facts: Any) -> Any:
    """Declare a parameter that a base class declares, with some facts changed.

    Args:
        text: what it is, where it is not as before.
        default: its default; it must be given when there is none.
        **facts: attributes of :class:`Parameter` that are not as before.
    """
    changed = {**facts, "default": default} | ({} if text is None else {"text": text})
    return field(default=MISSING if default is REQUIRED else default, metadata={"again": changed})


def same(owner: type, name: str, *, default: Any = REQUIRED, kw_only: bool = False, **facts: Any) -> Any:
    """Declare a parameter that a class which is no base declares, with some facts changed.

    Args:
        owner: the class that declares it.
        name: of the parameter there.
        default: its default; it must be given when there is none.
        kw_only: whether the constructor takes it by its name alone.
        **facts: attributes of :class:`Parameter` that are not as there.
    """
    return field(
        default=MISSING if default is REQUIRED else default,
        kw_only=kw_only,
        metadata={"parameter": replace(parameters(owner)[name], default=default, **facts)},
    )


def parameters(cls: type) -> Mapping[str, Parameter]:
    """Return the declared parameters of a class, name -> parameter."""
    found: Mapping[str, Parameter] = _parameters(cls)
    return found


@lru_cache(maxsize=512)
def _parameters(cls: type) -> Mapping[str, Parameter]:
    found = {}
    for f in fields(cls) if is_dataclass(cls) else ():
        if "again" in f.metadata:
            above = next(known for base in cls.__mro__[1:] if f.name in (known := parameters(base)))
            found[f.name] = replace(above[f.name], **f.metadata["again"])
        elif "parameter" in f.metadata:
            found[f.name] = replace(f.metadata["parameter"], name=f.name)
    return MappingProxyType(found)


# Not frozen_default=True: mypy then takes an inherited per-joint field for what the constructor takes.
@dataclass_transform(eq_default=False, field_specifiers=(parameter, again, same, field))
def with_parameters(cls: _Class) -> _Class:
    """Make the constructor of a class from its fields; they are checked, and cannot be set again."""
    dataclass(eq=False, repr=False)(cls)
    make: Any = vars(cls).get("__init__")
    if make is not None and make.__doc__ is None:  # for `help`: inherited ones too
        shaped = {True: "; a number, or shape (n,) or (batch, n)", False: ""}
        lines = [f"    {name}: {p.meaning}{shaped[p.per_joint]}." for name, p in parameters(cls).items()]
        errors = "    ParameterError, ArrayError: when a value is not as declared; it names the joint."
        make.__doc__ = "\n".join(
            ["Check and keep the parameters.", "", "Args:", *lines, "", "Raises:", errors]
        )
    if make is not None:
        type.__setattr__(cls, "__init__", with_keyword_hints(make))
    return cls


class Parametrised:
    """Something that is defined by parameters, which are checked when it is made and do not change.

    Attributes:
        remade: whether it is another one with other values (:meth:`with_values`): no need to warn again.
    """

    remade: ClassVar[bool] = False

    def with_values(self: _Same, **changes: Any) -> _Same:
        """Return another one with some values changed; all else is as it was given, not as it was worked out.

        Args:
            **changes: name of a field -> value, as the constructor takes it.

        Raises:
            ParameterError: for a class with a constructor of its own, or a value that is not as declared.
        """
        names = [f.name for f in fields(self) if f.init]  # type: ignore[arg-type]
        given = {**vars(self).get("_as_given", {}), **changes}
        if missing := [name for name in names if name not in given]:
            name = type(self).__name__
            raise ParameterError(name, missing, "a class whose constructor comes from its parameters")
        made = object.__new__(type(self))
        object.__setattr__(made, "remade", True)
        made.__init__(**{name: given[name] for name in names})  # type: ignore[misc]
        return made

    def __post_init__(self) -> None:
        """Check all parameters; what is derived from them comes after this."""
        self.check_parameters()

    def check_parameters(
        self, joint_names: Sequence[str] | None = None, only: Callable[[Parameter], bool] | None = None
    ) -> None:
        """Check the declared values and keep them in their form.

        Args:
            joint_names: of the joints that per-joint values are for, if these are known.
            only: which parameters; all when not given.

        Raises:
            ParameterError: when a value is not as declared.
            ArrayError: when a per-joint value is not; it names the joint.
        """
        for name, declared in parameters(type(self)).items():
            if only is None or only(declared):
                self.keep(name, declared.check_value(getattr(self, name), joint_names))

    def keep(self, name: str, value: Any) -> None:
        """Put a checked value in the place of what the constructor was given: for ``__post_init__`` alone."""
        object.__setattr__(self, name, value)

    def fill(self, name: str, value: Any) -> None:
        """Put a value in the place of a parameter that was not given: for ``__post_init__`` alone."""
        if getattr(self, name) is None:
            self.keep(name, value)

    def values(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {name: plain(getattr(self, name)) for name in parameters(type(self))}

    #: Names that users of other libraries type -> what to write in their place; see :mod:`armgpi.base.hints`.
    _hints: ClassVar[Mapping[str, str]] = {}

    if not TYPE_CHECKING:  # type checkers would take any name for one that exists

        def __getattr__(self, name: str) -> Any:
            """Name what to use in place of an attribute that does not exist."""
            declared = getattr(type(self), name, None)
            if isinstance(declared, property):  # Python comes here when it lacks something itself
                return declared.fget(self)
            raise MissingAttribute(self, name, type(self)._hints)

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to set a field again."""
        if name in self.__dict__ and name in getattr(type(self), "__dataclass_fields__", ()):
            raise FrozenInstanceError(
                f"cannot assign to field {name!r} of {type(self).__name__}; make another one"
            )
        if name in getattr(type(self), "__dataclass_fields__", ()):
            # By the constructor, before anything is worked out of it.
            self.__dict__.setdefault("_as_given", {})[name] = value
        object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Return the class with its parameters."""
        said = ", ".join(f"{name}={show_value(value)}" for name, value in self.values().items())
        return f"{type(self).__name__}({said})"


def notes(kind: type) -> dict[str, str]:
    """Return what the attributes of a class mean, each with its unit, for whoever writes them down.

    They come from the parameters that it declares, from the section "Attributes" of its docstring, and from a
    mapping ``derived`` of what it works out: name -> meaning.
    """
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        found |= _listed_attributes(each.__doc__ or "") | dict(vars(each).get("derived", {}))
    return found | {name: declared.meaning for name, declared in parameters(kind).items()}


def meaning(root: Any, path: str) -> str:
    """Return what a part of an object means: the nearest note on the way to it, empty for none.

    Args:
        root: the object.
        path: names of attributes, keys or places with dots between them.
    """
    value, said, box = root, "", False
    for step in path.split("."):
        if box:
            said = f"{('lower', 'upper')[int(step)]} end: {said}"
        said = notes(type(value)).get(step, said)
        box = getattr(parameters(type(value)).get(step), "kind", "") == "box"
        if isinstance(value, Mapping):
            value = value.get(step)
        elif step.isdigit() and isinstance(value, Sequence):
            value = value[int(step)]
        else:
            value = getattr(value, step, None)
    return said


def _listed_attributes(text: str) -> dict[str, str]:
    """Return the section "Attributes" of a docstring, name -> text, without shapes and what follows ";"."""
    lines = inspect.cleandoc(text).splitlines()
    found: dict[str, str] = {}
    name = ""
    for line in lines[lines.index("Attributes:") + 1 :] if "Attributes:" in lines else ():
        if line and not line.startswith(" "):  # the next section
            break
        if begun := re.match(r" {4}(\w+): (.*)", line):
            name = begun[1]
            found[name] = begun[2]
        elif name:
            found[name] = f"{found[name]} {line.strip()}".rstrip()
    return {name: re.split(r";|, shape |, likewise|\.$", words)[0] for name, words in found.items()}


def plain(value: Any) -> Any:
    """Return a parameter's value as plain data: arrays as lists, boxes as [lower, upper]."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    return value.values() if isinstance(value, Parametrised) else value
