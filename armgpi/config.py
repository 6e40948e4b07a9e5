"""The experiment file: robot, plant, controllers, reference and horizon as YAML, checked, and as objects.

Every quantity is in SI units. A per-joint quantity is a number for all joints, a list, or a mapping from
joint names. An error names the file, the line and the key.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import yaml
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
)

from armgpi.arrays import Array
from armgpi.control.controller import Controller
from armgpi.control.gains import FixedGains, default_omega
from armgpi.control.gpi import GPI
from armgpi.control.pid import PIDInversion
from armgpi.errors import ArmgpiError, ConfigError, EffortError, NameNotFound
from armgpi.plants import actuators, loads, sensors
from armgpi.plants.plant import Plant
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.references.bezier import minimum_duration
from armgpi.references.waypoints import Waypoints
from armgpi.robot import Robot

#: Largest size of an experiment file [bytes], and its most keys and values, aliases written out.
_MAX_BYTES = 1_000_000
_MAX_NODES = 100_000
#: Most samples of a run: a day at 10 kHz.
_MAX_SAMPLES = 10**9
#: Share of the velocity limits that a move without a duration uses, and its acceleration [rad/s^2].
_MOVE_SHARE = 0.5
_MOVE_ACCELERATION = 5.0
#: How long a run goes on after its reference has ended, when nothing is said [s].
_SETTLE = 2.0


def _number(value: Any) -> Any:
    """Accept numbers, and the forms of them that YAML 1.1 reads as text (1e-3); no bools."""
    if isinstance(value, bool | bytes):
        raise ValueError("expected a number")
    if isinstance(value, str | int):
        try:
            value = float(value)
        except (ValueError, OverflowError):
            raise ValueError("expected a number") from None
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("expected a finite number")
    return value


def _whole(value: Any) -> Any:
    """Accept whole numbers; no bools, no text."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError("expected a whole number")
    return value


def _names(value: Any) -> Any:
    """Accept one name where a list of them may stand."""
    return [value] if isinstance(value, str) else value


def _shape(value: Any) -> str:
    """Tell how a quantity is given, so that an error speaks of that form alone."""
    if isinstance(value, list | tuple):
        return "list"
    return "mapping" if isinstance(value, dict) else "number"


Number = Annotated[float, BeforeValidator(_number)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Whole = Annotated[int, BeforeValidator(_whole)]

PerJoint = Annotated[
    Annotated[Number, Tag("number")]
    | Annotated[list[Number], Tag("list")]
    | Annotated[dict[str, Number], Tag("mapping")],
    Discriminator(_shape),
]
PerJointPositive = Annotated[
    Annotated[Positive, Tag("number")]
    | Annotated[list[Positive], Tag("list")]
    | Annotated[dict[str, Positive], Tag("mapping")],
    Discriminator(_shape),
]
PerJointNotNegative = Annotated[
    Annotated[NotNegative, Tag("number")]
    | Annotated[list[NotNegative], Tag("list")]
    | Annotated[dict[str, NotNegative], Tag("mapping")],
    Discriminator(_shape),
]
Names = Annotated[list[str], BeforeValidator(_names)]
#: Names, or name -> value; a name without a value is locked where ``Robot.load`` chooses.
Locks = Annotated[
    Annotated[Names, Tag("list")] | Annotated[dict[str, Number | None], Tag("mapping")],
    Discriminator(lambda value: "mapping" if isinstance(value, dict) else "list"),
]
Times = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[list[Positive], Tag("list")],
    Discriminator(lambda value: "list" if isinstance(value, list) else "number"),
]
Stands = Annotated[
    Annotated[NotNegative, Tag("number")] | Annotated[list[NotNegative], Tag("list")],
    Discriminator(lambda value: "list" if isinstance(value, list) else "number"),
]


class _Section(BaseModel):
    """A part of the file; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class RobotSection(_Section):
    """Which arm.

    Attributes:
        name: a name from ``armgpi.robots.names()`` or the path of a URDF, relative to the file.
        lock: joints to hold fixed: names, or name -> value [rad or m].
        keep: when given, every other joint is locked.
        effort: effort limits that replace the URDF's [N m or N].
    """

    name: str
    lock: Locks = []
    keep: Names | None = None
    effort: PerJointNotNegative | None = None


class PayloadSection(_Section):
    """A load that the controller does not know: mass [kg] at com [m] in a frame (the tip when not given)."""

    mass: NotNegative
    frame: str | None = None
    com: list[Number] = Field(default=[0.0, 0.0, 0.0], min_length=3, max_length=3)


class StepLoad(_Section):
    """A constant disturbance torque; see :class:`armgpi.Step`."""

    type: Literal["step"]
    amplitude: PerJoint
    onset: Number = 0.0
    end: Number | None = None


class RampLoad(_Section):
    """A disturbance torque that grows; see :class:`armgpi.Ramp`."""

    type: Literal["ramp"]
    slope: PerJoint
    onset: Number = 0.0
    end: Number | None = None


class SineLoad(_Section):
    """A vibrating disturbance torque; see :class:`armgpi.Sine`."""

    type: Literal["sine"]
    amplitude: PerJoint
    omega: PerJoint
    phase: PerJoint = 0.0
    onset: Number = 0.0
    end: Number | None = None


class PulseLoad(_Section):
    """A push; see :class:`armgpi.Pulse`."""

    type: Literal["pulse"]
    amplitude: PerJoint
    onset: Number
    duration: Positive


class PaperLoad(_Section):
    """The disturbance torques of eqs. 29-31, for the paper's arm."""

    type: Literal["paper"]


LoadSection = Annotated[StepLoad | RampLoad | SineLoad | PulseLoad | PaperLoad, Field(discriminator="type")]


class NoiseSection(_Section):
    """White noise on the measurements: standard deviations [rad or m, rad/s or m/s]."""

    position: NotNegative = 0.0
    velocity: NotNegative = 0.0


class PlantSection(_Section):
    """What differs from the model that the controller has, and what is on the wires.

    Attributes:
        payload: a load that the controller does not know.
        armature: rotor inertia that it does not know [kg m^2 or kg].
        friction: "urdf" for the URDF's friction coefficients, "none".
        loads: disturbance torques.
        substeps: integration steps per sample.
        encoder_bits: encoder resolution; exact positions when not given.
        delay: samples by which measurements are late.
        drop_out: share of measurements lost.
        noise: measurement noise.
        torque_rate: highest rate of change of torque [N m/s or N/s].
    """

    payload: PayloadSection | None = None
    armature: PerJointNotNegative | None = None
    friction: Literal["urdf", "none"] = "none"
    loads: list[LoadSection] = []
    substeps: Whole = Field(default=1, ge=1, le=1000)
    encoder_bits: Annotated[Whole, Field(ge=1, le=52)] | None = None
    delay: Whole = Field(default=0, ge=0, le=10_000)
    drop_out: NotNegative = Field(default=0.0, lt=1.0)
    noise: NoiseSection | None = None
    torque_rate: PerJointPositive | None = None


class GPISection(_Section):
    """A GPI controller; see :class:`armgpi.GPI`. `inertia_scale` multiplies the D(q) that it believes in."""

    type: Literal["gpi"]
    label: str | None = None
    omega: PerJointPositive | None = None
    zeta: PerJointPositive = 1.0
    p: PerJointPositive | None = None
    realisation: Literal["bumpless", "paper"] = "bumpless"
    start: Literal["hold", "zero"] = "hold"
    inertia_scale: Positive = 1.0


class PIDSection(_Section):
    """PID with dynamic inversion; see :class:`armgpi.PIDInversion`. `inertia_scale` scales its D(q) alone."""

    type: Literal["pid"]
    label: str | None = None
    kp: PerJointNotNegative = 400.0
    ki: PerJointNotNegative = 500.0
    kd: PerJointNotNegative = 40.0
    inertia_scale: Positive = 1.0


ControllerSection = Annotated[GPISection | PIDSection, Field(discriminator="type")]


class ReferenceSection(_Section):
    """Smooth moves from posture to posture, with holds.

    Attributes:
        points: postures [rad or m]; a mapping keeps the joints that it does not name where they were, and
            starts from the middle of the joint ranges. When not given, every joint moves by up to 0.5 from
            there and back.
        durations: of the moves [s]; gentle ones when not given.
        holds: at each posture [s]; 0 when not given, 1 when there are no points either.
    """

    points: list[PerJoint] | None = Field(default=None, min_length=1)
    durations: Times | None = None
    holds: Stands | None = None


class ExperimentConfig(_Section):
    """A whole experiment file.

    Attributes:
        robot: which arm.
        plant: what it really is like.
        controllers: who controls it; `run` takes the first one, `compare` all.
        reference: where to.
        sample_time: of the controllers [s].
        t_final: how long [s]; when not given, until the reference has ended and 2 s more.
        record_every: record every so many samples.
        seed: of all random numbers.
    """

    robot: RobotSection
    plant: PlantSection = PlantSection()
    controllers: list[ControllerSection] = Field(default=[GPISection(type="gpi")], min_length=1)
    reference: ReferenceSection = ReferenceSection()
    sample_time: Number = Field(default=1e-3, ge=1e-9)
    t_final: Positive | None = None
    record_every: Whole = Field(default=1, ge=1)
    seed: Whole = Field(default=0, ge=0, le=2**63 - 1)


Path_ = tuple[str | int, ...]


class Origin(NamedTuple):
    """Where a configuration came from, for messages.

    Attributes:
        source: the file, or "command line".
        lines: path of a key -> its line in the file.
        options: dotted key -> the option of the command line that set it.
    """

    source: str = "experiment"
    lines: Mapping[Path_, int] = {}
    options: Mapping[str, str] = {}

    def error(self, path: Path_, message: str) -> ConfigError:
        """Return an error about the key at `path`, naming the line or option it came from."""
        key = ".".join(map(str, path))
        for prefix, option in self.options.items():
            if key == prefix or key.startswith(f"{prefix}."):
                return ConfigError("command line", option, message)
        # A missing key has no line: name that of the section it is missing from.
        known = (self.lines.get(path[:length]) for length in range(len(path), 0, -1))
        return ConfigError(self.source, key, message, next((line for line in known if line), None))


class _Place(NamedTuple):
    """One key of a configuration, while objects are made from it."""

    origin: Origin
    path: Path_ = ()

    def at(self, *steps: str | int) -> _Place:
        """Return a place below this one."""
        return _Place(self.origin, (*self.path, *steps))

    def error(self, message: str) -> ConfigError:
        """Return an error about this key."""
        return self.origin.error(self.path, message)

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Turn an error of ours that happens inside into one that names this key."""
        try:
            yield
        except ConfigError:
            raise
        except ArmgpiError as error:
            raise self.error(str(error)) from error


class Loaded(NamedTuple):
    """A checked configuration and where it came from: what :func:`build` takes."""

    config: ExperimentConfig
    origin: Origin


class Experiment(NamedTuple):
    """The objects that an experiment file describes.

    Attributes:
        robot: the arm as its URDF has it.
        plant: what moves.
        controllers: label -> controller.
        reference: where to.
        t_final: how long [s].
        config: what they were made from, with every default filled in.
    """

    robot: Robot
    plant: Plant
    controllers: dict[str, Controller]
    reference: Waypoints
    t_final: float
    config: ExperimentConfig


def read(path: Path) -> Loaded:
    """Read and check an experiment file.

    Raises:
        ConfigError: when it cannot be read or is not as it should be; it names line and key.
    """
    try:
        if not path.exists():
            raise ConfigError(path, "", "there is no such file")
        if not path.is_file():
            raise ConfigError(path, "", "is no regular file")
        if path.stat().st_size > _MAX_BYTES:
            raise ConfigError(path, "", f"is larger than {_MAX_BYTES} bytes")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ConfigError(path, "", "is not UTF-8 text") from None
    except OSError as error:
        raise ConfigError(path, "", f"cannot be read: {error.strerror or error}") from None
    config, origin = parse(text, str(path))
    name = Path(config.robot.name)
    if (name.suffix or len(name.parts) > 1) and (path.parent / name).is_file():
        robot = config.robot.model_copy(update={"name": str(path.parent / name)})
        config = config.model_copy(update={"robot": robot})
    return Loaded(config, origin)


def parse(text: str, source: str) -> Loaded:
    """Check the text of an experiment file; errors as :func:`read`."""
    try:
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
        lines: dict[Path_, int] = {}
        _note_lines(tree, (), lines, source)
        data = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        raise ConfigError(source, "", f"is not valid YAML: {error.problem}", line) from None
    except RecursionError:
        raise ConfigError(source, "", "is not valid YAML: nested too deeply") from None
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError) as error:
        # PyYAML lets errors of Python through, for a date such as 2020-13-45.
        reason = " ".join(str(error).split())
        raise ConfigError(source, "", f"is not valid YAML: {reason}") from None
    if not isinstance(data, dict):
        raise ConfigError(source, "", "expected a mapping with the keys robot, plant, controllers, ...")
    origin = Origin(source, lines)
    return Loaded(check(data, origin), origin)


def check(data: Mapping[Any, Any], origin: Origin) -> ExperimentConfig:
    """Check plain data.

    Raises:
        ConfigError: when something in it is not as it should be; it names the key.
    """
    # A section of which every key is commented out is null: as if it were not there.
    data = {key: value for key, value in data.items() if value is not None}
    try:
        return ExperimentConfig.model_validate(data)
    except ValidationError as error:
        # A misspelt key first: a missing one may be no more than that.
        found_errors = error.errors(include_url=False)
        first = min(found_errors, key=lambda item: item["type"] != "extra_forbidden")
        path, found = _path_in_data(data, first["loc"])
        kind, context = first["type"], first.get("ctx", {})
        if kind == "extra_forbidden":
            message = str(NameNotFound("key", path[-1], _known_keys(first["loc"])))
        elif kind == "missing":
            message = "is missing"
        elif kind == "invalid_key":
            message = "a key is text"
        elif kind == "union_tag_not_found":
            path, message = (*path, context["discriminator"].strip("'")), "is missing"
        elif kind == "union_tag_invalid":
            path = (*path, context["discriminator"].strip("'"))
            known = [tag.strip(" '") for tag in context["expected_tags"].split(",")]
            message = str(NameNotFound(str(path[-3]).rstrip("s"), context["tag"], known))
        else:
            expected = _EXPECTED.get(kind, first["msg"].removeprefix("Value error, ")).format(**context)
            message = f"{expected[0].lower()}{expected[1:]}, got {_shown(found)}"
        raise origin.error(path, message) from None


def build(config: ExperimentConfig, origin: Origin | None = None) -> Experiment:
    """Make the objects that a configuration describes.

    Raises:
        ConfigError: when something in it does not fit the robot; it names the key.
    """
    top = _Place(origin or Origin())
    robot = _robot(config.robot, top.at("robot"))
    plant = _plant(config, robot, top.at("plant"))
    controllers: dict[str, Controller] = {}
    sections: list[GPISection | PIDSection] = []
    for index, section in enumerate(config.controllers):
        place = top.at("controllers", index)
        label = section.label or section.type
        if label in controllers:
            label = f"{label} {index + 1}"
        if label in controllers:
            raise place.at("label").error(f"another controller is labelled {label!r} as well")
        try:
            with place.blamed():
                section, controllers[label] = _controller(config, section, robot, place)
        except ConfigError as error:
            if isinstance(error.__cause__, EffortError):
                raise top.at("robot", "effort").error(str(error.__cause__)) from None
            raise
        sections.append(section.model_copy(update={"label": label}))
    reference, moves = _reference(config.reference, robot, top.at("reference"))
    t_final = reference.t_end + _SETTLE if config.t_final is None else config.t_final
    if not 0.5 < t_final / config.sample_time <= _MAX_SAMPLES:
        raise top.at("t_final").error(
            f"expected {config.sample_time:g} to {config.sample_time * _MAX_SAMPLES:g} s (1 to "
            f"{_MAX_SAMPLES:.0e} samples), got {t_final:g} s"
        )
    filled = {"controllers": sections, "reference": moves, "t_final": t_final}
    return Experiment(robot, plant, controllers, reference, t_final, config.model_copy(update=filled))


def dump(config: ExperimentConfig) -> str:
    """Return a configuration as YAML, every default written out."""
    text: str = yaml.safe_dump(config.model_dump(), sort_keys=False, allow_unicode=True)
    return text


def _robot(section: RobotSection, place: _Place) -> Robot:
    """Return the arm."""
    # In a mapping, a joint without a value is locked where Robot.load would lock it by its name alone.
    lock: Any = section.lock
    try:
        robot = Robot.load(section.name, lock=lock, keep=section.keep)
    except NameNotFound as error:
        # Robots and joints are looked up: say whose key it is.
        key = next((k for k in ("lock", "keep") if error.name in (getattr(section, k) or ())), "name")
        raise place.at(key).error(str(error)) from None
    except ArmgpiError as error:
        raise place.at("name").error(str(error)) from None
    except OSError as error:  # a name too long for a file, for one
        raise place.at("name").error(f"cannot be read: {error.strerror or error}") from None
    if section.effort is not None:
        current = robot.limits.effort
        with place.at("effort").blamed():
            robot = robot.with_limits(effort=_per_joint(section.effort, robot, place.at("effort"), current))
    return robot


def _plant(config: ExperimentConfig, robot: Robot, place: _Place) -> Plant:
    """Return the plant with its loads and wires."""
    section = config.plant
    real = robot
    if section.payload is not None:
        with place.at("payload").blamed():
            frame = section.payload.frame or robot.tip
            real = real.with_payload(frame, section.payload.mass, section.payload.com)
    if section.armature is not None:
        armature = _per_joint(section.armature, robot, place.at("armature"), robot.armature)
        real = real.with_armature(armature)
    torques: list[loads.Load] = []
    for index, item in enumerate(section.loads):
        with place.at("loads", index).blamed():
            torques += _loads(item, robot, place.at("loads", index))
    with place.blamed():
        plant: Plant = RigidBodyPlant(
            real,
            torques,
            friction="urdf" if section.friction == "urdf" else None,
            substeps=section.substeps,
        )
        if section.torque_rate is not None:
            rate = _per_joint(section.torque_rate, robot, place.at("torque_rate"), None)
            plant = actuators.RateLimited(plant, rate)
        plant = actuators.Saturated(plant)
        if section.noise is not None:
            noise = section.noise
            plant = sensors.Noisy(plant, noise.position, noise.velocity, config.seed)
        if section.encoder_bits is not None:
            plant = sensors.Encoder(plant, section.encoder_bits)
        if section.drop_out:
            plant = sensors.DropOut(plant, section.drop_out, config.seed)
        if section.delay:
            plant = sensors.Delayed(plant, section.delay)
    return plant


def _loads(section: BaseModel, robot: Robot, place: _Place) -> list[loads.Load]:
    """Return the loads of one entry."""
    if isinstance(section, PaperLoad):
        if robot.n != 3:
            raise place.error(f"eqs. 29-31 are for an arm of 3 joints, this one has {robot.n}")
        return loads.paper_disturbances()
    kinds: dict[str, Any] = {"step": loads.Step, "ramp": loads.Ramp, "sine": loads.Sine, "pulse": loads.Pulse}
    given = section.model_dump(exclude_none=True)
    kind = kinds[given.pop("type")]
    for key in ("amplitude", "slope", "omega", "phase"):
        if key in given:
            given[key] = _per_joint(given[key], robot, place.at(key), 0.0)
    load: loads.Load = kind(**given)
    return [load]


def _controller(
    config: ExperimentConfig, section: GPISection | PIDSection, robot: Robot, place: _Place
) -> tuple[GPISection | PIDSection, Controller]:
    """Return one controller, and its section with the defaults filled in."""
    dt = config.sample_time
    believed = robot if section.inertia_scale == 1.0 else robot.scaled_inertia(section.inertia_scale)

    def values(key: str, default: float) -> Array:
        return _per_joint(getattr(section, key), robot, place.at(key), default)

    if isinstance(section, PIDSection):
        defaults = {"kp": 400.0, "ki": 500.0, "kd": 40.0}
        gains = {key: values(key, default) for key, default in defaults.items()}
        return section, PIDInversion(believed, dt, **gains, bias_robot=robot)
    delay = config.plant.delay * dt
    omega = default_omega(dt, delay)
    if section.omega is None:
        section = section.model_copy(update={"omega": omega})
    omegas = values("omega", omega)
    ps = None
    if section.p is not None:
        ps = _per_joint(section.p, robot, place.at("p"), omegas)
    tuning = FixedGains(omegas, values("zeta", 1.0), ps)
    return section, GPI(
        believed, dt, tuning, realisation=section.realisation, start=section.start, delay=delay
    )


def _reference(section: ReferenceSection, robot: Robot, place: _Place) -> tuple[Waypoints, ReferenceSection]:
    """Return the reference, and its section with the defaults filled in."""
    points: list[Array] = []
    holds = section.holds
    if section.points is None:
        middle = robot.middle()
        room = robot.limits.upper - middle
        goal = middle + np.minimum(0.5, 0.5 * room)
        points = [middle, goal, middle]
        holds = 1.0 if holds is None else holds
    for index, point in enumerate(section.points or ()):
        here = place.at("points", index)
        before = points[-1] if points else robot.middle()
        points.append(_per_joint(point, robot, here, before))
        with here.blamed():
            robot.check_position(points[-1], f"point {index + 1} of the reference")
    durations = section.durations
    if durations is None:
        gentle = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, 1.0) * _MOVE_SHARE
        gentle = np.where(gentle > 0.0, gentle, _MOVE_SHARE)
        durations = [
            max(1.0, minimum_duration(b - a, gentle, _MOVE_ACCELERATION)) for a, b in pairwise(points)
        ]
    with place.blamed():
        reference = Waypoints(points, durations, 0.0 if holds is None else holds)
    filled = ReferenceSection(
        points=[point.tolist() for point in points],
        durations=durations,
        holds=0.0 if holds is None else holds,
    )
    return reference, filled


def _per_joint(
    value: float | list[float] | Mapping[str, float],
    robot: Robot,
    place: _Place,
    default: Array | float | None,
) -> Array:
    """Return a per-joint quantity as an array (n,); joints that a mapping leaves out get the default."""
    names = robot.joint_names
    if isinstance(value, Mapping):
        for joint in value:
            if joint not in names:
                raise place.at(joint).error(str(NameNotFound("joint", joint, names)))
        missing = [joint for joint in names if joint not in value]
        if missing and default is None:
            raise place.error(f"needs a value for {', '.join(missing)} as well")
        result = np.array(np.broadcast_to(0.0 if default is None else default, (robot.n,)), dtype=np.float64)
        for joint, number in value.items():
            result[names.index(joint)] = number
        return result
    if isinstance(value, list) and len(value) != robot.n:
        raise place.error(f"expected {robot.n} numbers ({', '.join(names)}), got {len(value)}")
    return np.array(np.broadcast_to(np.array(value, dtype=np.float64), (robot.n,)))


def _note_lines(node: Any, path: Path_, lines: dict[Path_, int], source: str) -> None:
    """Note the line of every key of a YAML tree, refusing keys that stand twice."""
    if len(lines) > _MAX_NODES:  # aliases of aliases make a small file explode
        raise ConfigError(source, "", f"has more than {_MAX_NODES} keys and values")
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            here = (*path, str(key.value))
            line = key.start_mark.line + 1
            if here in lines and key.tag != "tag:yaml.org,2002:merge":
                raise ConfigError(source, ".".join(map(str, here)), "stands twice", line)
            lines[here] = line
            _note_lines(value, here, lines, source)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            here = (*path, index)
            lines[here] = value.start_mark.line + 1
            _note_lines(value, here, lines, source)


def _path_in_data(data: Any, location: tuple[str | int, ...]) -> tuple[Path_, Any]:
    """Return the part of pydantic's location that exists in the data, and what stands there.

    Pydantic puts the names of union members into the location ("controllers", 0, "gpi", "omega", "list").
    """
    path: list[str | int] = []
    for position, step in enumerate(location):
        inside = isinstance(data, list) and isinstance(step, int) and step < len(data)
        if inside or (isinstance(data, Mapping) and step in data):
            data = data[step]
        elif isinstance(data, Mapping) and position == len(location) - 1 and step not in _TAGS:
            return (*path, step), None  # a key that is missing
        else:
            continue
        path.append(step)
    return tuple(path), data


def _known_keys(location: tuple[str | int, ...]) -> tuple[str, ...]:
    """Return the keys that are known where an unknown one stands."""
    model: type[BaseModel] = ExperimentConfig
    for step in location[:-1]:
        model = _MODELS.get(str(step), model)
    return tuple(model.model_fields)


def _shown(value: Any) -> str:
    """Return a value for a message, cut when it is long."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


#: Sections by the steps of pydantic's locations: keys, and the tags of unions.
_MODELS: dict[str, type[BaseModel]] = {
    "robot": RobotSection,
    "plant": PlantSection,
    "payload": PayloadSection,
    "step": StepLoad,
    "ramp": RampLoad,
    "sine": SineLoad,
    "pulse": PulseLoad,
    "paper": PaperLoad,
    "noise": NoiseSection,
    "gpi": GPISection,
    "pid": PIDSection,
    "reference": ReferenceSection,
}
_TAGS = {"number", "list", "mapping", "[key]", "step", "ramp", "sine", "pulse", "paper", "gpi", "pid"}

#: What to say for pydantic's kinds of errors.
_EXPECTED = {
    "float_type": "expected a number",
    "string_type": "expected text",
    "list_type": "expected a list",
    "dict_type": "expected a mapping",
    "model_type": "expected a mapping",
    "model_attributes_type": "expected a mapping",
    "literal_error": "expected {expected}",
    "greater_than": "expected a number above {gt:g}",
    "greater_than_equal": "expected {ge:g} or more",
    "less_than": "expected a number below {lt:g}",
    "less_than_equal": "expected {le:g} or less",
    "too_short": "expected at least {min_length}",
    "too_long": "expected at most {max_length}",
}
