"""Sections of an experiment file: what may stand at each key, read once; an error names the key."""

from __future__ import annotations

import copy
import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import FrozenInstanceError
from numbers import Integral, Real
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

from armgpi.base.escape import in_si, quote
from armgpi.base.parameter import REQUIRED, Parameter, parameters
from armgpi.base.renamed import current_name
from armgpi.errors import ConfigError, NameNotFound

Path_ = tuple[str | int, ...]
#: Reads a value at a path: returns it as it is kept, or raises `Wrong`.
Form = Callable[[Any, Path_], Any]
#: What YAML 1.1 calls true and false besides, and 1.2 does not.
_TRUTH = {"yes": True, "on": True, "no": False, "off": False}
_Same = TypeVar("_Same", bound="Section")
#: Names that Python or the command line has for what a file has -> its key.
_MEANT = {"dt": "sample_time", "duration": "t_final", "urdf": "robot", "controller": "controllers"}


class Wrong(Exception):
    """Something in a file is not as it should be.

    Attributes:
        path: of the key.
        message: what is wrong with it.
        misspelt: whether the key is unknown: said first, as a missing one may be no more than that.
    """

    def __init__(self, path: Path_, message: str, misspelt: bool = False) -> None:
        """Note what is wrong."""
        super().__init__(message)
        self.path, self.message, self.misspelt = path, message, misspelt


class Key(NamedTuple):
    """What may stand at a key.

    Attributes:
        form: reads it.
        default: its value where it is not there; REQUIRED where it has to be.
        optional: whether it may be null.
        declared: what is known of the number.
    """

    form: Form
    default: Any = REQUIRED
    optional: bool = False
    declared: Parameter | None = None


class Section:
    """A part of the file, checked and frozen: its keys are attributes.

    Attributes:
        keys: what it may have, by name.
        given: keys that the file has; the others have their defaults.
    """

    keys: ClassVar[Mapping[str, Key]] = {}
    #: Keys that are not written where they are null.
    quiet: ClassVar[frozenset[str]] = frozenset(
        {
            "ideal",
            "drives",
            "nominal",
            "bodies",
            "posterior",
            "inertia_scale",
            "viscous",
            "coulomb",
            "gravity",
            "force_limit",
            "moment_limit",
            "force_frame",
            "speed_limit",
            "limit_friction",
        }
    )
    given: frozenset[str]

    def __init__(self, **data: Any) -> None:
        """Check what is given; see :meth:`read`."""
        vars(self).update(vars(type(self).read(data)))

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Return the value of a key."""

    @classmethod
    def read(cls: type[_Same], data: Any, path: Path_ = ()) -> _Same:
        """Return the section of plain data at a path.

        Raises:
            Wrong: for an unknown key, one that is missing, or a value that is not as it should be.
        """
        if isinstance(data, Section):
            data = data.plain(given=True)
        if not isinstance(data, Mapping):
            raise _refusal("a mapping", data, path, f"its keys: {', '.join(cls.keys)}")
        entries = [(name, key, data.get(name, REQUIRED)) for name, key in cls.keys.items()]
        for name, value in data.items():
            if name not in cls.keys:
                entries.append((name, _unknown(cls.keys), value))
        values = _read_each(entries, path)
        made = object.__new__(cls)
        vars(made).update(values, given=frozenset(data))
        return made

    def replace(self: _Same, **changes: Any) -> _Same:
        """Return it with other values of some keys, as they are."""
        made = copy.copy(self)
        vars(made).update(changes, given=self.given | set(changes))
        return made

    def plain(self, given: bool = False) -> dict[str, Any]:
        """Return it as plain data: all, or what the file says alone."""
        data = {}
        for name in self.keys:
            value = getattr(self, name)
            is_left_out = (given and name not in self.given) or (value is None and name in self.quiet)
            if not is_left_out:
                data[name] = _plain(value, given)
        return data

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to set a key."""
        raise FrozenInstanceError(f"cannot assign to {name!r}; use replace")

    def __eq__(self, other: object) -> bool:
        """Tell whether another one has the same values."""
        return isinstance(other, type(self)) and self.plain() == other.plain()

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        """Return it with its values."""
        return f"{type(self).__name__}({self.plain()})"


def _plain(value: Any, given: bool) -> Any:
    """Return a value as plain data."""
    if isinstance(value, Section):
        return value.plain(given)
    if isinstance(value, Mapping):
        return {key: _plain(item, given) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, given) for item in value]
    return value


def _read_each(parts: Iterable[tuple[Any, Key, Any]], path: Path_) -> dict[Any, Any]:
    """Return values by their keys or places; of what is wrong, a misspelt key is raised first."""
    values: dict[Any, Any] = {}
    errors = []
    for name, key, value in parts:
        place = (*path, name)
        try:
            if value is REQUIRED and key.default is REQUIRED:
                raise Wrong(place, f"is missing; add it, such as '{name}: ...'")
            if value is REQUIRED:
                values[name] = copy.copy(key.default)
            elif value is None and key.optional:
                values[name] = None
            else:
                values[name] = key.form(value, place)
        except Wrong as error:
            errors.append(error)
    if errors:
        raise min(errors, key=lambda error: not error.misspelt)
    return values


def _unknown(known: Mapping[str, Key]) -> Key:
    """Return what refuses an unknown key."""

    def refuse(value: Any, path: Path_) -> Any:
        name = path[-1]
        meant = _MEANT.get(str(name), "")
        remedy = f"write {meant}" if meant in known else ""
        message = "a key is text"
        if isinstance(name, str):
            message = str(NameNotFound("key", name, tuple(known), remedy))
        raise Wrong(path, message, misspelt=True)

    return Key(refuse)


def _refusal(expected: str, value: Any, path: Path_, more: str = "") -> Wrong:
    """Return the error about a value that has another form."""
    hints = "".join(f"; {hint}" for hint in (in_si(value), more) if hint)
    return Wrong(path, f"expected {expected}, got {quote(value)}{hints}")


def text(value: Any, path: Path_) -> str:
    """Read text."""
    if not isinstance(value, str):
        raise _refusal("text", value, path)
    return value


def flag(value: Any, path: Path_) -> bool:
    """Read a truth value, also as YAML 1.1 has it."""
    if isinstance(value, str) and value.lower() in _TRUTH:
        return _TRUTH[value.lower()]
    if not isinstance(value, bool):
        raise _refusal("true or false", value, path)
    return value


def word(*choices: str, old: Mapping[str, str] = MappingProxyType({})) -> Form:
    """Return the form of one of some words; `old` ones have new names."""
    *others, last = map(repr, choices)
    expected = f"{', '.join(others)} or {last}" if others else last

    def read(value: Any, path: Path_) -> str:
        value = current_name(value, old)
        if not isinstance(value, str) or value not in choices:
            raise _refusal(expected, value, path)
        return value

    return read


def number(declared: Parameter) -> Form:
    """Return the form of a number: whole, or any, also as YAML 1.1 reads as text (1e-3); no bools."""

    def read(value: Any, path: Path_) -> float | int:
        if declared.kind == "integer":
            if isinstance(value, bool) or not isinstance(value, Integral):
                raise _refusal("a whole number", value, path)
            read_number: float | int = int(value)
        else:
            if isinstance(value, bool) or not isinstance(value, str | Real):
                raise _refusal("a number", value, path)
            try:
                read_number = float(value)
            except (ValueError, OverflowError):
                raise _refusal("a number", value, path) from None
            if not math.isfinite(read_number):
                raise _refusal("a finite number", value, path)
        limit = declared.broken_limit(read_number)
        if limit:
            raise _refusal(limit, value, path)
        return read_number

    return read


def listing(form: Form, least: int = 0, most: float = math.inf) -> Form:
    """Return the form of a list of so many values."""

    def read(value: Any, path: Path_) -> list[Any]:
        if not isinstance(value, list | tuple):
            raise _refusal("a list", value, path, "begin each entry with '- '")
        if not least <= len(value) <= most:
            count = f"at least {least}" if len(value) < least else f"at most {most}"
            raise _refusal(f"{count} entries", value, path)
        key = Key(form)
        entries = [(place, key, item) for place, item in enumerate(value)]
        return list(_read_each(entries, path).values())

    return read


def mapping(form: Form, optional: bool = False) -> Form:
    """Return the form of a mapping from names to values, which may be null where they are optional."""

    def read(value: Any, path: Path_) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise _refusal("a mapping", value, path)
        for name in value:
            if not isinstance(name, str):
                raise Wrong((*path, name), "a key is text: put it in quotes")
        key = Key(form, optional=optional)
        return _read_each([(name, key, item) for name, item in value.items()], path)

    return read


def by_shape(
    single: Form, several: Form | None = None, named: Form | None = None, nested: Form | None = None
) -> Form:
    """Return the form of what is one value, a list, a mapping or a list of lists; errors speak of that."""

    def read(value: Any, path: Path_) -> Any:
        if isinstance(value, Mapping) and named is not None:
            return named(value, path)
        if isinstance(value, list | tuple) and several is not None:
            if nested is not None and value and isinstance(value[0], list | tuple):
                return nested(value, path)
            return several(value, path)
        return single(value, path)

    return read


def per_joint(form: Form) -> Form:
    """Return the form of a quantity: a number for all joints, a list, or a mapping from joints."""
    return by_shape(form, listing(form), mapping(form))


def anything(value: Any, path: Path_) -> Any:
    """Take a value as it is: who uses it checks it."""
    return value


#: A number without bounds, and three of them.
plain_number = number(Parameter(""))
vector = listing(plain_number, 3, 3)


def names(value: Any, path: Path_) -> list[str]:
    """Read names, of which one may stand in place of a list."""
    listed: list[str] = listing(text)([value] if isinstance(value, str) else value, path)
    return listed


def one_of(kinds: Mapping[str, type[Section]], old: Mapping[str, str] = MappingProxyType({})) -> Form:
    """Return the form of a section that is one of several, by its `type`; `old` types have new names."""

    def read(value: Any, path: Path_) -> Section:
        if isinstance(value, Section):
            return value
        if not isinstance(value, Mapping):
            named = f", as in 'type: {value}'" if isinstance(value, str) and value in kinds else ""
            raise _refusal(f"a mapping{named}", value, path)
        if "type" not in value:
            raise Wrong((*path, "type"), f"is missing; one of {', '.join(kinds)}")
        tag = current_name(str(value["type"]), old)
        if tag not in kinds:
            kind = [step for step in path if isinstance(step, str)][-1]
            raise Wrong((*path, "type"), str(NameNotFound(kind.rstrip("s"), tag, tuple(kinds))))
        return kinds[tag].read({**value, "type": tag}, path)

    return read


def form_of(declared: Parameter) -> Form:
    """Return the form of a declared parameter."""
    kind = declared.kind
    if kind == "choice":
        return word(*declared.choices)
    if kind in ("flag", "text"):
        return flag if kind == "flag" else text
    if kind == "group":
        assert declared.group is not None
        return section(declared.group).read
    item = number(declared)
    several = listing(item)
    forms: dict[str, Callable[[], Form]] = {
        "box": lambda: _box(item),
        "table": lambda: by_shape(several, several, mapping(several), listing(several)),
        "range": lambda: listing(item, 2, 2),
        "vector": lambda: vector,
        "numbers": lambda: listing(plain_number),
        "times": lambda: by_shape(item, several),
        "points": lambda: listing(vector, 2),
    }
    return forms.get(kind, lambda: per_joint(item) if declared.per_joint else item)()


def _box(item: Form) -> Form:
    """Return the form of a box: two ends, or one value that does not adapt."""
    single = per_joint(item)
    end = Key(single)
    ends: type[Section] = type("Box", (Section,), {"keys": {"lower": end, "upper": end}})

    def read(value: Any, path: Path_) -> Any:
        has_ends = isinstance(value, Mapping) and not {"lower", "upper"}.isdisjoint(value)
        if isinstance(value, Section) or has_ends:
            return ends.read(value, path)
        return single(value, path)

    return read


def key_of(declared: Parameter, default: Any = REQUIRED, optional: bool = False) -> Key:
    """Return the key of a declared parameter; with a default of its own where one is given."""
    default = declared.file_default if default is REQUIRED else default
    return Key(form_of(declared), default, optional or declared.optional, declared)


def keys_of(declared: Mapping[str, Parameter]) -> dict[str, Key]:
    """Return the keys of declared parameters."""
    return {parameter.file_key: key_of(parameter) for parameter in declared.values() if parameter.in_file}


def union(where: str, *parts: Mapping[str, Any]) -> dict[str, Any]:
    """Return mappings as one.

    Raises:
        ConfigError: when a name is in two of them, as that of a plugin and one of ours.
    """
    counts = Counter(itertools.chain(*parts))
    for name, count in counts.items():
        if count > 1:
            raise ConfigError(where, name, "is taken already; choose another name")
    together: dict[str, Any] = {}
    for part in parts:
        together |= part
    return together


def section(
    cls: type, declared: Mapping[str, Parameter] | None = None, more: Mapping[str, Key] | None = None
) -> type[Section]:
    """Return the section of the experiment file for a class, from its declarations.

    Args:
        cls: the class.
        declared: its parameters, when they are not all.
        more: further keys.
    """
    if declared is None:
        declared = parameters(cls)
    keys = union(cls.__name__, more or {}, keys_of(declared))
    return type(f"{cls.__name__}Section", (Section,), {"keys": keys, "__doc__": cls.__doc__})
