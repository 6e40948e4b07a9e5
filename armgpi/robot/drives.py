"""The drives of an arm: rotors, gears, motors and encoders, each number with its interval and its source.

A plant, an uncertainty model, a rule of gains, an identification read and write the same object. It comes
from a file (:func:`Drives.read`), a URDF's ``<transmission>``, ``robot.with_drives``, or from who estimates
it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from armgpi.base import files, renamed
from armgpi.base.arrays import LARGEST, Array, check_choice, quantity
from armgpi.base.parameter import Parameter, plain
from armgpi.base.renamed import current_name
from armgpi.errors import ArmgpiError, ConfigError, NameNotFound, ParameterError, UrdfError, show_value
from armgpi.robot.markup import GEAR_RATIO, ROTOR_INERTIA

#: Whose word a number is: a user's or a file's, a rule's where nobody said anything, a measurement's, or that
#: of a public source on a known arm (:mod:`armgpi.robot.known_arms`).
SOURCES = ("specified", "assumed", "identified", "published")
#: Size of a file that is read [B].
_MAX_BYTES = 1_000_000
#: What a URDF's parameters are called that only armgpi knows.
_OWN = "armgpi:"


def _quantity(name: str, text: str, unit: str = "", **facts: Any) -> Parameter:
    return Parameter(text, unit, default=None, none="not known", name=name, **{"least": 0.0, **facts})


#: What is known of a drive, all as seen at the joint.
QUANTITIES: Mapping[str, Parameter] = {
    each.name: each
    for each in (
        _quantity("rotor_inertia", "inertia of the rotor, gear ratio squared", "kg m^2 or kg"),
        _quantity("viscous", "viscous friction", "N m s/rad or N s/m"),
        _quantity("coulomb", "Coulomb friction", "N m or N"),
        _quantity("offset", "constant torque that the joint takes besides", "N m or N", least=-math.inf),
        _quantity("stiffness", "stiffness of the gear", "N m/rad or N/m", above=True),
        _quantity("damping", "damping of the gear", "N m s/rad or N s/m"),
        _quantity("current_bandwidth", "bandwidth of the current loop", "Hz", above=True),
        _quantity("encoder_side", "where the encoder sits", kind="choice", choices=("motor", "link")),
        _quantity("gear_ratio", "turns of the motor in one of the joint; rad/m of a slide", above=True),
        _quantity("encoder_count", "counts in one turn of the encoder, wherever it sits", above=True),
        _quantity("torque_constant", "torque constant", "N m/A or N/A", above=True),
        _quantity("velocity_limit", "velocity limit of the motor", "rad/s or m/s", above=True),
        _quantity("torque_limit", "torque limit of the motor", "N m or N", above=True),
    )
}


class Datum(NamedTuple):
    """What is known of one number of a drive.

    Attributes:
        value: its best value; a word where it is not a number.
        low: lowest value that it may have.
        high: highest value that it may have.
        source: "specified", "assumed", "identified" or "published".
        file: where it is from; empty for no file.
    """

    value: Any
    low: Any
    high: Any
    source: str = "specified"
    file: str = ""

    def plain(self) -> Any:
        """Return it as a file has it: the bare value where a user gave that alone."""
        if self == Datum(self.value, self.value, self.value):
            return self.value
        found = {"value": self.value}
        if self.low != self.high:
            found |= {"low": self.low, "high": self.high}
        found["source"] = self.source
        if self.file:
            found["file"] = self.file
        return found


@dataclass(frozen=True)
class Drives:
    """What is known of the drives of an arm; frozen. What is not there is not known.

    Attributes:
        joint_names: names of the n joints.
        data: name of a quantity (:data:`QUANTITIES`) -> joint -> what is known of it.
    """

    joint_names: tuple[str, ...]
    data: Mapping[str, Mapping[str, Datum]] = field(default_factory=dict)

    def value(self, name: str, default: Any = math.nan) -> Array:
        """Return a quantity of every joint, shape (n,): `default` where it is not known.

        Raises:
            NameNotFound: when there is no such quantity.
        """
        known = self._of(name)
        is_number = QUANTITIES[name].kind == "number"
        missing = np.broadcast_to(default if is_number else "", (len(self.joint_names),))
        values = []
        for joint, other in zip(self.joint_names, missing, strict=True):
            values.append(known[joint].value if joint in known else other)
        return np.array(values, dtype=np.float64 if is_number else np.str_)

    def interval(self, name: str) -> tuple[Array, Array]:
        """Return the lowest and highest value of every joint, each (n,); NaN where nothing is known."""
        known = self._of(name)
        missing = Datum(math.nan, math.nan, math.nan)
        data = [known.get(joint, missing) for joint in self.joint_names]
        low = np.array([datum.low for datum in data])
        high = np.array([datum.high for datum in data])
        return low, high

    def sources(self, name: str) -> tuple[str, ...]:
        """Return whose word a quantity is, joint by joint; empty where it is not known."""
        known = self._of(name)
        return tuple(known[joint].source if joint in known else "" for joint in self.joint_names)

    def with_value(
        self,
        name: str,
        value: Any,
        low: Any = None,
        high: Any = None,
        source: str = "specified",
        file: str = "",
    ) -> Drives:
        """Return these drives with another quantity.

        Args:
            name: of the quantity.
            value: a number or word for all joints, one per joint, or joint -> value (the others keep theirs).
            low: lowest values, likewise; the values when not given.
            high: highest values, likewise.
            source: "specified", "assumed", "identified" or "published".
            file: where it is from.

        Raises:
            NameNotFound: when there is no such quantity, or no such joint.
            ArrayError: for another shape, or what is not finite.
            ParameterError: when a value is not as declared, or outside its interval.
        """
        source = current_name(source, renamed.SOURCES)
        check_choice(source, "source", SOURCES)
        values = self._column(name, value)
        if not values:
            return self
        lowest = values if low is None else self._column(name, low)
        highest = values if high is None else self._column(name, high)
        data = dict(self._of(name))
        for joint, best in values.items():
            # An end that is given for other joints alone is NaN, which no interval takes.
            least = lowest.get(joint, math.nan)
            most = highest.get(joint, math.nan)
            if QUANTITIES[name].kind == "number" and not least <= best <= most:
                raise ParameterError(f"{joint}.{name}", [least, best, most], "low <= value <= high")
            data[joint] = Datum(best, least, most, source, file)
        return Drives(self.joint_names, {**self.data, name: data})

    def updated(self, other: Drives) -> Drives:
        """Return these drives with the data of other ones in place of their own.

        A quantity that the others contain of some joints alone is kept of the rest.

        Args:
            other: drives whose data prevails, of some or all of the same joints.

        Raises:
            NameNotFound: when the others contain a joint that these have not.
        """
        together = dict(self.data)
        for name, data in other.data.items():
            for joint in data:
                if joint not in self.joint_names:
                    raise NameNotFound("joint", joint, self.joint_names)
            together[name] = {**self.data.get(name, {}), **data}
        return Drives(self.joint_names, together)

    def of(self, joint_names: Sequence[str]) -> Drives:
        """Return what is known of the drives of some joints."""
        chosen = {}
        for name, data in self.data.items():
            of_joints = {joint: data[joint] for joint in joint_names if joint in data}
            if of_joints:
                chosen[name] = of_joints
        return Drives(tuple(joint_names), chosen)

    def scaled(self, name: str, factor: float) -> Drives:
        """Return these drives with a quantity and its interval multiplied by a factor."""
        scaled = {}
        for joint, datum in self._of(name).items():
            value, low, high = (factor * number for number in (datum.value, datum.low, datum.high))
            scaled[joint] = datum._replace(value=value, low=low, high=high)
        if not scaled:
            return self
        return Drives(self.joint_names, {**self.data, name: scaled})

    def plain(self) -> dict[str, dict[str, Any]]:
        """Return joint -> quantity -> value as a file has it, and :meth:`from_plain` takes it."""
        by_joint: dict[str, dict[str, Any]] = {joint: {} for joint in self.joint_names}
        for name, data in self.data.items():
            for joint, datum in data.items():
                by_joint[joint][name] = plain(datum.plain())
        return {joint: quantities for joint, quantities in by_joint.items() if quantities}

    @classmethod
    def from_plain(
        cls, data: Any, joint_names: Sequence[str] | None = None, source: str = "drives"
    ) -> Drives:
        """Return drives from plain data: joint -> quantity -> value, or -> value, low, high, source, file.

        ``motor_inertia`` of the rotor itself with ``gear_ratio`` (1) is as good as ``rotor_inertia``.

        Args:
            data: joint -> its drive.
            joint_names: of the arm; those of the data when not given.
            source: what it is called in errors.

        Raises:
            ConfigError: when a key, a joint or a value is not as it should be; it names the key.
        """
        if not isinstance(data, Mapping):
            raise ConfigError(source, "", f"expected joint -> its drive, got {show_value(data)}")
        for joint in data:
            if not isinstance(joint, str):
                raise ConfigError(source, "", f"expected names of joints, got {show_value(joint)}")
        drives = cls(tuple(data) if joint_names is None else tuple(joint_names))
        for joint, drive in data.items():
            if not isinstance(drive, Mapping):
                expected = "expected a mapping such as {stiffness: 1.0e+4}"
                raise ConfigError(source, joint, f"{expected}, got {show_value(drive)}")
            quantities = dict(drive)
            has_bare_ratio = not isinstance(quantities.get("gear_ratio", {}), Mapping)
            if "motor_inertia" in quantities or has_bare_ratio:
                quantities |= _reflect_motor(quantities, source, joint)
            for key, value in quantities.items():
                try:
                    drives = drives._with_plain(joint, key, value)
                except ArmgpiError as error:
                    raise ConfigError(source, f"{joint}.{key}", str(error)) from None
        return drives

    @classmethod
    def read(cls, path: str | PathLike[str], joint_names: Sequence[str] | None = None) -> Drives:
        """Return the drives of a file, YAML or JSON; see :meth:`from_plain`.

        Raises:
            ConfigError: when it cannot be read, or something in it is not as it should be.
        """
        from armgpi.base.yaml_text import read_yaml  # here: YAML takes long to import

        data = read_yaml(Path(path), _MAX_BYTES)
        return cls.from_plain(data, joint_names, str(path))

    def write(self, path: str | PathLike[str]) -> None:
        """Write a file that :meth:`read` reads.

        Raises:
            ArmgpiError: when it cannot be written.
        """
        import yaml

        files.write(path, yaml.safe_dump(self.plain(), sort_keys=False, allow_unicode=True))

    @classmethod
    def from_urdf(cls, root: Element, source: str, joint_names: Sequence[str]) -> Drives:
        """Return what a URDF says of its drives: in transmissions, as Drake reads them, or in ros2_control.

        Args:
            root: the XML.
            source: where it is from.
            joint_names: of the arm; what the file says of others is left out.

        Raises:
            UrdfError: for what is no finite number, or outside its bounds.
        """
        drives = cls(tuple(joint_names))
        for element in (*root.iter("transmission"), *root.findall("ros2_control")):
            for joint in element.findall("joint"):
                name = joint.get("name", "")
                # A transmission is that of its joint; ros2_control lists many.
                where = element if element.tag == "transmission" else joint
                # Of one name the first text counts.
                values = dict(reversed([*_values(where)]))
                for key, value in _urdf_quantities(values, name, source):
                    if name in drives.joint_names:
                        drives = drives.with_value(key, {name: value}, file=source)
        return drives

    def _of(self, name: str) -> Mapping[str, Datum]:
        """Return what is known of a quantity, joint -> datum."""
        if name not in QUANTITIES:
            raise NameNotFound("quantity of a drive", name, tuple(QUANTITIES))
        return self.data.get(name, {})

    def _column(self, name: str, value: Any) -> dict[str, Any]:
        """Return joint -> value, checked."""
        declared, names = QUANTITIES[name], self.joint_names
        if declared.kind == "choice":
            words = value if isinstance(value, Mapping) else dict.fromkeys(names, value)
            return {joint: declared.check_value(word) for joint, word in words.items()}
        numbers = quantity(value, name, names, default=math.nan)
        column = {}
        for joint, number in zip(names, numbers.tolist(), strict=True):
            if not isinstance(value, Mapping) or joint in value:
                column[joint] = declared.check_value(number)
        return column

    def _with_plain(self, joint: str, key: str, given: Any) -> Drives:
        """Return these drives with one value of a file, bare or with interval, source and file.

        Raises:
            ArmgpiError: when key, joint or value is not as it should be; who reads the file names them.
        """
        if key not in QUANTITIES:
            raise NameNotFound("key", key, (*QUANTITIES, "motor_inertia", "gear_ratio"))
        datum = _as_mapping(given)
        for word in datum:
            if word not in Datum._fields:
                raise NameNotFound("key", word, Datum._fields)
        if "value" not in datum:
            raise ParameterError(key, given, "a value, and low, high, source, file where they are known")
        if joint not in self.joint_names:
            raise NameNotFound("joint", joint, self.joint_names)
        rest: dict[str, Any] = {}
        for end in ("low", "high"):
            if end in datum:
                rest[end] = {joint: _number(datum[end])}
        for word in ("source", "file"):
            if word in datum:
                rest[word] = str(datum[word])
        return self.with_value(key, {joint: _number(datum["value"])}, **rest)


def _number(value: Any) -> Any:
    """Return a number that YAML 1.1 reads as text (1e-3) as a number."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


#: What numbers of motor and gear have to be.
_MOTOR = {"motor_inertia": "zero or positive [kg m^2]", "gear_ratio": "positive, rad/m of a slide"}


def _reflect_motor(drive: dict[str, Any], source: str, joint: str) -> dict[str, Any]:
    """Return the rotor inertia at the joint where a drive has those of motor and gear, and take these.

    A gear ratio stays as it is; the interval of the rotor inertia follows from those of both, and its source
    and file are those of the motor's inertia.

    Args:
        drive: quantity -> value of a file; what is used here is removed.
        source: what the file is called in errors.
        joint: whose drive it is.

    Raises:
        ConfigError: when a number is not as it should be, or the rotor inertia is there as well.
    """
    taken = {key: drive.pop(key) for key in _MOTOR if key in drive}
    for key, value in taken.items():
        _check_motor(key, _number(value.get("value") if isinstance(value, Mapping) else value), source, joint)
    ratio = {"gear_ratio": taken["gear_ratio"]} if "gear_ratio" in taken else {}
    if "motor_inertia" not in taken:  # a ratio alone says nothing of the rotor
        return ratio
    if "rotor_inertia" in drive:
        raise ConfigError(
            source, f"{joint}.rotor_inertia", "and motor_inertia are mutually exclusive: specify one of them"
        )
    motor = _as_mapping(taken["motor_inertia"])
    gear = _as_mapping(taken.get("gear_ratio", 1.0))
    reflected = dict(motor)
    for end in ("value", "low", "high"):
        if end not in motor and end not in gear:
            continue
        inertia = _number(motor.get(end, motor["value"]))
        factor = _number(gear.get(end, gear["value"]))
        for key, number in (("motor_inertia", inertia), ("gear_ratio", factor)):
            if not _is_number(number):
                message = f"expected a number, got {show_value(number)}"
                raise ConfigError(source, f"{joint}.{key}.{end}", message)
        reflected[end] = inertia * factor**2
    return ratio | {"rotor_inertia": reflected}


def _check_motor(key: str, number: Any, source: str, joint: str) -> None:
    """Refuse a number of motor or gear that cannot be: no number, negative, too large, a ratio of 0."""
    is_good = _is_number(number) and 0.0 <= number < LARGEST
    if not is_good or (key == "gear_ratio" and number == 0.0):
        raise ConfigError(source, f"{joint}.{key}", f"expected {_MOTOR[key]}, got {show_value(number)}")


def _is_number(value: Any) -> bool:
    """Tell whether a value of a file is a number; true and false are none."""
    return isinstance(value, float | int) and not isinstance(value, bool)


def _as_mapping(value: Any) -> Mapping[str, Any]:
    """Return a value of a file with its interval, source and file; of a bare one the value alone."""
    return value if isinstance(value, Mapping) else {"value": value}


def _urdf_quantities(values: Mapping[str, str], joint: str, source: str) -> Iterator[tuple[str, Any]]:
    """Yield the quantities among the names and texts of a transmission.

    Raises:
        UrdfError: for what is no finite number, or outside its bounds.
    """
    inertia = _first_of(ROTOR_INERTIA, values, joint, source)
    if inertia is not None:  # gear ratios alone, which many files have, say nothing
        stated = _first_of(GEAR_RATIO, values, joint, source)
        ratio = 1.0 if stated is None else abs(stated)  # below zero where motor and joint turn apart
        if not 0.0 < ratio < math.inf:
            raise UrdfError(
                source,
                f"the gear ratio of joint {joint!r} is {ratio:g}, expected not zero and finite",
                joint,
            )
        reflected = inertia * ratio**2
        if not 0.0 <= reflected < math.inf:
            raise UrdfError(source, f"the rotor inertia of joint {joint!r} is {reflected:g}", joint)
        yield "rotor_inertia", reflected
        if stated is not None:
            yield "gear_ratio", ratio
    for key, declared in QUANTITIES.items():
        name = f"{_OWN}{key}"
        if name in values:
            is_word = declared.kind == "choice"
            value = values[name] if is_word else _urdf_number(name, values, joint, source)
            try:
                yield key, declared.check_value(value)
            except ParameterError as error:
                raise UrdfError(source, str(error), joint) from None


def _first_of(names: Collection[str], values: Mapping[str, str], joint: str, source: str) -> float | None:
    """Return the number of the first of some names that a transmission has; None where it has none."""
    for name in values:
        if name in names:
            return _urdf_number(name, values, joint, source)
    return None


def _urdf_number(name: str, values: Mapping[str, str], joint: str, source: str) -> float:
    """Return the number of a name in a transmission.

    Raises:
        UrdfError: when its text is no number.
    """
    try:
        return float(values[name])
    except ValueError:
        raise UrdfError(source, f"<{name}> is {values[name]!r}, expected a number", joint) from None


def _values(element: Element) -> Iterator[tuple[str, str]]:
    """Yield the names and texts of all elements below one that have a text."""
    for below in element.iter():
        name = ""  # of a comment
        if isinstance(below.tag, str):
            name = below.tag.rpartition("}")[2].rpartition(":")[2]  # without namespace and prefix
        if name == "param":
            name = below.get("name", "")
        text = (below.get("value") or below.text or "").strip()
        if text:
            yield name, text
