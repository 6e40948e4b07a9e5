"""Every exception and warning that armgpi raises, and the findings that it has.

One root, so that a caller can catch all of them and a program can tell our refusal from a bug::

    ArmgpiError
      an argument:    ParameterError, ArrayError, NameNotFound, LimitError
      a file:         UrdfError, ConfigError, ModelError, UnreadableTrajectory, UnfitLog
      an arm:         EffortError, ReachError, PayloadError
      a run:          RolloutError
      a machine:      BackendError, MissingPackage
    ArmgpiWarning

The leaves carry the data (joint, value, bound, ...) and their text says what was found, what was expected
and what to do.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Literal, NamedTuple, TypeVar

__all__ = [
    "ArmgpiError",
    "ArmgpiWarning",
    "ArrayError",
    "BackendError",
    "ConfigError",
    "EffortError",
    "Finding",
    "LimitError",
    "MissingPackage",
    "ModelError",
    "NameNotFound",
    "ParameterError",
    "PayloadError",
    "ReachError",
    "Remedy",
    "RolloutError",
    "UnfitLog",
    "UnreadableTrajectory",
    "UrdfError",
]

Level = Literal["error", "warning", "info"]
_Error = TypeVar("_Error", bound="ArmgpiError")


class Remedy(NamedTuple):
    """A change that would help, as data; the command line offers it as one of its options.

    Attributes:
        kind: what to change: "effort", "lock", "keep", "mimic", "package_dir", "time_limit", "port", ...
        joints: names of the joints concerned.
        value: the value proposed, in the unit of what is changed; None where any other one may do.
    """

    kind: str
    joints: tuple[str, ...] = ()
    value: float | str | None = None


class Finding(NamedTuple):
    """One thing about a model or a law that its user should know.

    Attributes:
        level: "error" when it stops a run, "warning" when it is probably wrong, "info" when it is good to
            know.
        where: the link, joint or file concerned, as in "joint 'j1'".
        message: what is the matter, in a sentence.
        value: what was found, None where a single value does not say it.
        bound: what it was compared with, None likewise.
        repair: what to do about it; empty when nothing has to be done.
        remedies: changes that would help, any one of them, as data.
        kind: a short name of the kind of finding ("degrees", "effort", ...); the registry fills it in.
    """

    level: Level
    where: str
    message: str
    value: float | str | None = None
    bound: float | str | None = None
    repair: str = ""
    remedies: tuple[Remedy, ...] = ()
    kind: str = ""

    def __str__(self) -> str:
        """Return the finding in a line."""
        return f"{self.where}: {self.message}" + (f" -> {self.repair}" if self.repair else "")


class ArmgpiError(Exception):
    """Root of all errors raised on purpose by armgpi.

    For example::

        try:
            robot = armgpi.Robot.load("arm.urdf")
        except armgpi.ArmgpiError as error:
            print(error, error.remedies)

    Attributes:
        remedies: changes that would help, any one of them; the text has them in words.
    """

    remedies: tuple[Remedy, ...] = ()

    def suggesting(self: _Error, *remedies: Remedy) -> _Error:
        """Return this error with changes that would help: ``raise UrdfError(...).suggesting(...)``."""
        self.remedies = remedies
        return self


class ArmgpiWarning(UserWarning):
    """Something that does not stop the work but that the user should know."""


def show_value(value: object) -> str:
    """Return what a value looks like, its type where it cannot even say that."""
    try:
        return " ".join(text.split()) if "\n" in (text := repr(value)) else text
    except Exception:  # a user's object, a whole number of thousands of digits, a list in itself
        return f"a {type(value).__name__}"


def _listing(names: Sequence[str], limit: int = 20) -> str:
    """Join names for a message, shortening long lists."""
    comma = "; " if any("," in name for name in names) else ", "
    shown = comma.join(names[:limit])
    return shown if len(names) <= limit else f"{shown}{comma}... {len(names) - limit} more"


class ArrayError(ArmgpiError):
    """An array argument has the wrong shape, dtype or content.

    Attributes:
        name: name of the argument.
    """

    def __init__(self, name: str, message: str) -> None:
        """Describe the bad argument `name`."""
        self.name = name
        super().__init__(f"{name}: {message}")


class ParameterError(ArmgpiError):
    """A parameter is outside the values it may take.

    Attributes:
        name: name of the parameter.
        value: what was given.
    """

    def __init__(self, name: str, value: object, expected: str) -> None:
        """Describe the bad parameter: its name, its value and what was expected."""
        self.name = name
        self.value = value
        super().__init__(f"{name} must be {expected}, got {show_value(value)}")


class NameNotFound(ArmgpiError):
    """A joint, frame, robot, controller or the like that does not exist.

    Attributes:
        kind: what was looked for ("joint", "frame", ...).
        name: the name that does not exist.
        valid: the names that exist.
    """

    def __init__(self, kind: str, name: object, valid: Iterable[str], remedy: str = "") -> None:
        """Describe the missing name and offer the nearest ones that exist."""
        self.kind = kind
        self.name = name
        self.valid = tuple(valid)
        folded = {each.casefold(): each for each in reversed(self.valid)}
        said = name.casefold() if isinstance(name, str) else show_value(name)
        longer = [n for n in reversed(folded) if n.startswith(f"{said}_")]  # icub: icub_left_arm
        near = [folded[n] for n in (longer or get_close_matches(said, folded, n=3, cutoff=0.5))[:3]]
        text = f"there is no {kind} named {show_value(name)}"
        if near:
            text += f"; did you mean {' or '.join(repr(n) for n in near)}?"
        if self.valid:
            text += f" (known: {_listing(self.valid)})"
        super().__init__(text + (f"; {remedy}" if remedy else ""))


class UrdfError(ArmgpiError):
    """A URDF that cannot be read as a fixed-base arm.

    Attributes:
        source: the file, or a short description of where the text came from.
        element: the link or joint concerned, if one is.
    """

    def __init__(self, source: object, message: str, element: str | None = None) -> None:
        """Describe what is wrong with `source` and, if known, with which link or joint."""
        self.source = str(source)
        self.element = element
        super().__init__(f"{source}: {message}")


class LimitError(ArmgpiError):
    """A value outside a joint's limits, or a limit that leaves nothing to work with.

    Attributes:
        joint: name of the joint.
        value: the offending value.
        lower: lower bound, in the joint's unit.
        upper: upper bound, in the joint's unit.
    """

    def __init__(
        self, what: str, joint: str, value: float, lower: float, upper: float, remedy: str = ""
    ) -> None:
        """Describe which quantity of which joint left which interval."""
        self.joint, self.value = joint, float(value)
        self.lower, self.upper = float(lower), float(upper)
        text = f"{what} of joint {joint!r} is {value:.6g}, outside [{lower:.6g}, {upper:.6g}]"
        super().__init__(text + (f"; {remedy}" if remedy else ""))


#: What is wrong with a log is said in one line, of so many reasons.
_SHOWN_REASONS = 3


class UnfitLog(ArmgpiError):
    """A log from which an arm cannot be identified.

    Attributes:
        reasons: what is wrong with it and what to do, one line each; the message has the first three.
    """

    def __init__(self, reasons: Sequence[str]) -> None:
        """Describe the log by what the check found."""
        self.reasons = tuple(reasons)
        shown = "; ".join(self.reasons[:_SHOWN_REASONS])
        if more := len(self.reasons) - _SHOWN_REASONS:
            shown += f"; and {more} more" if more > 0 else ""
        super().__init__(f"no arm can be identified from the log: {shown}")


class UnreadableTrajectory(ArmgpiError):
    """A file that is no trajectory of an arm's joints.

    Attributes:
        source: the file.
    """

    def __init__(self, source: object, message: str) -> None:
        """Describe what is wrong in which file."""
        self.source = str(source)
        super().__init__(f"{source}: {message}")


class EffortError(ArmgpiError):
    """A joint whose effort limit leaves a controller no torque.

    Attributes:
        joint: name of the joint.
        effort: its effort limit [N m or N].
    """

    def __init__(
        self,
        joint: str,
        effort: float,
        others: Sequence[str] = (),
        enough: float = 10.0,
        movable: bool = True,
    ) -> None:
        """Describe a joint without torque.

        Args:
            joint: its name.
            effort: its effort limit [N m or N].
            others: joints that lack it too.
            enough: an effort limit that would suffice [N m or N].
            movable: whether the arm can move with all of these joints locked, so that this can be proposed.
        """
        self.joint = joint
        self.effort = float(effort)
        joints = (joint, *others)
        self.remedies = (Remedy("effort", joints, enough), *[Remedy("lock", joints)] * movable)
        besides = f" (nor have {', '.join(others)} more)" if others else ""
        them, it = ("them some", "them") if others else ("it one", "it")
        efforts = dict.fromkeys(joints, enough)
        super().__init__(
            f"joint {joint!r} has effort limit {effort:g}, so no controller can move it{besides}; "
            f"give {them} with robot.with_limits(effort={efforts}){f', or lock {it}' * movable}"
        )


class ReachError(ArmgpiError):
    """A point that the arm cannot reach.

    Attributes:
        point: the point asked for [m].
        distance: how far it is from the nearest reachable point [m].
    """

    def __init__(self, point: Sequence[float], distance: float, message: str) -> None:
        """Describe the point and how far out of reach it is."""
        self.point = tuple(float(x) for x in point)
        self.distance = float(distance)
        super().__init__(message)


class PayloadError(ArmgpiError):
    """A range of loads that no bandwidth serves.

    Attributes:
        asked: lightest and heaviest load asked for [kg].
        delta: largest eigenvalue of D^-1 D^, with the lightest load on the arm and the heaviest one in the
            nominal model.
        omega_c: bandwidth that this leaves [rad/s].
        heaviest: heaviest load that a range from the same lightest one may have [kg].
        lightest: lightest load that a range up to the same heaviest one may have [kg].
    """

    def __init__(
        self,
        robot: str,
        frame: str,
        asked: tuple[float, float],
        delta: float,
        omega_c: float,
        slowest: float,
        heaviest: float,
        lightest: float,
    ) -> None:
        """Describe the range asked for, what it leaves, and the ranges that would suffice."""
        self.asked, self.delta, self.omega_c = asked, float(delta), float(omega_c)
        self.heaviest, self.lightest = float(heaviest), float(lightest)
        super().__init__(
            f"no bandwidth is stable for {asked[0]:g} to {asked[1]:g} kg at {frame!r} of {robot!r}: a "
            f"nominal model with {asked[1]:g} kg has {delta:.3g} times too much inertia when the arm "
            f"carries {asked[0]:g} kg, which leaves omega_c = {omega_c:.3g} rad/s, below {slowest:g}; use "
            f"{asked[0]:g} to {heaviest:.3g} kg or {lightest:.3g} to {asked[1]:g} kg, a shorter sample "
            "time, or specify rotor inertia that the URDF does not contain (robot.with_armature)"
        )


class ConfigError(ArmgpiError):
    """An experiment file, or an option of the command line, that cannot be used.

    Attributes:
        source: the file (or "command line").
        key: dotted path of the offending key, empty when the file as a whole is bad.
        line: line of that key in the file, counted from 1; None when there is no such line.
    """

    def __init__(self, source: object, key: str, message: str, line: int | None = None) -> None:
        """Describe the bad key, its place and what was expected."""
        self.source = str(source)
        self.key = key
        self.line = line
        place = f"{source}:{line}" if line is not None else str(source)
        super().__init__(f"{place}: {key}: {message}" if key else f"{place}: {message}")


class ModelError(ArmgpiError):
    """A user's model of an arm (hand-derived dynamics) that cannot be used.

    Attributes:
        model: the model, as the user named it.
        function: its function concerned, empty when it is the model as a whole.
    """

    def __init__(self, model: object, function: str, message: str) -> None:
        """Describe what the model, or one of its functions, did."""
        self.model = str(model)
        self.function = function
        super().__init__(f"{model}: {function}: {message}" if function else f"{model}: {message}")


class RolloutError(ArmgpiError):
    """A rollout that cannot be made, read, or used for what was asked."""


class BackendError(ArmgpiError):
    """Generated code that cannot be made here: no compiler, or a loop that has none."""


class MissingPackage(ArmgpiError):
    """A package that is not installed, and that only some uses of armgpi need.

    Attributes:
        package: its name.
        extra: the extra of armgpi that brings it.
    """

    def __init__(self, package: str, extra: str = "viz") -> None:
        """Say which package is missing and how to get it."""
        self.package, self.extra = package, extra
        super().__init__(f"needs the package {package!r}: pip install {package}")

    def instead(self, what: str, way_out: str) -> MissingPackage:
        """Return the error that also says what needs the package, and what works without it."""
        self.args = (f"{what}: pip install {self.package}, {way_out}",)
        return self


def require_extra(module: str, extra: str, package: str = "") -> None:
    """Refuse to begin what needs a module that is not installed; nothing is imported.

    Args:
        module: its name.
        extra: the extra of armgpi that brings it.
        package: what it is called where it is installed from, when that is another name.

    Raises:
        MissingPackage: when it is not installed.
    """
    top = module.partition(".")[0]
    try:
        there = find_spec(top) is not None
    except ValueError:  # imported already, or hidden
        there = sys.modules.get(top) is not None
    if not there:
        raise MissingPackage(package or top, extra)


def import_extra(module: str, extra: str, package: str = "") -> Any:
    """Return a module that only some uses of armgpi need.

    Args:
        module: its name.
        extra: the extra of armgpi that brings it.
        package: what it is called where it is installed from, when that is another name.

    Raises:
        MissingPackage: when it is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise MissingPackage(package or module.partition(".")[0], extra) from None


def __dir__() -> list[str]:
    """Return the public names, without what is imported here."""
    return __all__
