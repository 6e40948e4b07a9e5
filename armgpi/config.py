"""The experiment file: robot, plant, controllers, reference and horizon as YAML, checked, and as objects.

Every quantity is in SI units. A per-joint quantity is a number for all joints, a list, or a mapping from
joint names. An error names the file, the line and the key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from armgpi.arrays import Array
from armgpi.control.controller import Controller
from armgpi.control.gains import FixedGains, default_omega
from armgpi.control.gpi import GPI
from armgpi.control.pid import PIDInversion
from armgpi.errors import ArmgpiError, ConfigError, NameNotFound
from armgpi.plants import actuators, loads, sensors
from armgpi.plants.plant import Plant
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.references.bezier import minimum_duration
from armgpi.references.reference import Reference
from armgpi.references.waypoints import Waypoints
from armgpi.robot import Robot

#: Largest size of an experiment file [bytes].
_MAX_BYTES = 1_000_000
#: Share of the velocity limits that a move without a duration uses, and its acceleration [rad/s^2].
_MOVE_SHARE = 0.5
_MOVE_ACCELERATION = 5.0


def _number(value: Any) -> Any:
    """Accept numbers, and the forms of them that YAML 1.1 reads as text (1e-3); no bools."""
    if isinstance(value, bool):
        raise ValueError("expected a number")
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            raise ValueError("expected a number") from None
    if isinstance(value, int | float) and not math.isfinite(value):
        raise ValueError("expected a finite number")
    return value


Number = Annotated[float, BeforeValidator(_number)]
PerJoint = Number | list[Number] | dict[str, Number]


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
    lock: list[str] | dict[str, Number] = []
    keep: list[str] | None = None
    effort: PerJoint | None = None


class PayloadSection(_Section):
    """A load that the controller does not know: mass [kg] at com [m] in a frame (the tip when not given)."""

    mass: Number
    frame: str | None = None
    com: list[Number] = [0.0, 0.0, 0.0]


class LoadSection(_Section):
    """One disturbance torque; see :mod:`armgpi.plants.loads`. "paper" stands for eqs. 29-31."""

    type: Literal["step", "ramp", "sine", "pulse", "paper"]
    amplitude: PerJoint | None = None
    slope: PerJoint | None = None
    omega: Number | None = None
    phase: Number | None = None
    onset: Number | None = None
    end: Number | None = None
    duration: Number | None = None


class NoiseSection(_Section):
    """White noise on the measurements: standard deviations [rad or m, rad/s or m/s]."""

    position: Number = 0.0
    velocity: Number = 0.0


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
    armature: PerJoint | None = None
    friction: Literal["urdf", "none"] = "none"
    loads: list[LoadSection] = []
    substeps: int = 1
    encoder_bits: int | None = None
    delay: int = 0
    drop_out: Number = 0.0
    noise: NoiseSection | None = None
    torque_rate: PerJoint | None = None


class GPISection(_Section):
    """A GPI controller; see :class:`armgpi.GPI`. `inertia_scale` multiplies the D(q) that it believes in."""

    type: Literal["gpi"]
    label: str | None = None
    omega: PerJoint | None = None
    zeta: PerJoint = 1.0
    p: PerJoint | None = None
    realisation: Literal["bumpless", "paper"] = "bumpless"
    start: Literal["hold", "zero"] = "hold"
    inertia_scale: Number = 1.0


class PIDSection(_Section):
    """PID with dynamic inversion; see :class:`armgpi.PIDInversion`. `inertia_scale` scales its D(q) alone."""

    type: Literal["pid"]
    label: str | None = None
    kp: PerJoint = 400.0
    ki: PerJoint = 500.0
    kd: PerJoint = 40.0
    inertia_scale: Number = 1.0


ControllerSection = Annotated[GPISection | PIDSection, Field(discriminator="type")]


class ReferenceSection(_Section):
    """Smooth moves from posture to posture, with holds.

    Attributes:
        points: postures [rad or m]; a mapping keeps the joints that it does not name where they were, and
            starts from the middle of the joint ranges.
        durations: of the moves [s]; gentle ones when not given.
        holds: at each posture [s].
    """

    points: list[PerJoint] = Field(min_length=1)
    durations: Number | list[Number] | None = None
    holds: Number | list[Number] = 0.0


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
    reference: ReferenceSection | None = None
    sample_time: Number = 1e-3
    t_final: Number | None = None
    record_every: int = 1
    seed: int = Field(default=0, ge=0)


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
    reference: Reference
    t_final: float
    config: ExperimentConfig


def read(path: Path) -> ExperimentConfig:
    """Read and check an experiment file.

    Raises:
        ConfigError: when it cannot be read or is not as it should be; it names line and key.
    """
    try:
        if not path.is_file():
            raise ConfigError(path, "", "there is no such file")
        if path.stat().st_size > _MAX_BYTES:
            raise ConfigError(path, "", f"is larger than {_MAX_BYTES} bytes")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ConfigError(path, "", "is not UTF-8 text") from None
    except OSError as error:
        raise ConfigError(path, "", f"cannot be read: {error.strerror or error}") from None
    config = parse(text, str(path))
    robot = config.robot.name
    beside = path.parent / robot
    if Path(robot).suffix and not Path(robot).is_absolute() and beside.is_file():
        config = config.model_copy(update={"robot": config.robot.model_copy(update={"name": str(beside)})})
    return config


def parse(text: str, source: str) -> ExperimentConfig:
    """Check the text of an experiment file; errors as :func:`read`."""
    try:
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
        lines = _lines(tree, source)
        data = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise ConfigError(source, "", f"is not valid YAML: {error.problem}", line) from None
    except (yaml.YAMLError, RecursionError) as error:
        raise ConfigError(source, "", f"is not valid YAML: {error}") from None
    if not isinstance(data, dict):
        raise ConfigError(source, "", "expected a mapping with the keys robot, plant, controllers, ...")
    return check(data, source, lines)


def check(
    data: Mapping[str, Any], source: str, lines: Mapping[tuple[str | int, ...], int] | None = None
) -> ExperimentConfig:
    """Check plain data; `lines` says in which line of `source` a key stands."""
    try:
        return ExperimentConfig.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        path, place = _path_in_data(data, first["loc"])
        message = first["msg"].removeprefix("Value error, ")
        if first["type"] == "extra_forbidden":
            known = _known_keys(first["loc"])
            message = str(NameNotFound("key", path[-1], known)) if known else "unknown key"
        elif first["type"] == "missing":
            message = "is missing"
        else:
            message = f"{message[0].lower()}{message[1:]}, got {place!r}"
        line = None
        for length in range(len(path), 0, -1):
            # A missing key has no line: name that of the section it is missing from.
            line = line or (lines or {}).get(path[:length])
        raise ConfigError(source, ".".join(map(str, path)), message, line) from None


def build(config: ExperimentConfig, source: str = "experiment") -> Experiment:
    """Make the objects that a configuration describes.

    Raises:
        ArmgpiError: when something in it does not fit the robot; ConfigError names the key.
    """
    section = config.robot
    robot = Robot.load(section.name, lock=section.lock, keep=section.keep)
    if section.effort is not None:
        with _key(source, "robot.effort"):
            robot = robot.with_limits(effort=section.effort)
    with _key(source, "plant"):
        plant = _plant(config, robot)
    controllers: dict[str, Controller] = {}
    for index, choice in enumerate(config.controllers):
        with _key(source, f"controllers.{index}"):
            label = choice.label or choice.type
            if label in controllers:
                label = f"{label} {index + 1}"
            controllers[label] = _controller(config, choice, robot)
    with _key(source, "reference"):
        reference = _reference(config.reference, robot)
    t_final = reference.t_end + 2.0 if config.t_final is None else config.t_final
    return Experiment(robot, plant, controllers, reference, t_final, config)


def dump(config: ExperimentConfig) -> str:
    """Return a configuration as YAML, every default written out."""
    text: str = yaml.safe_dump(config.model_dump(), sort_keys=False, allow_unicode=True)
    return text


def per_joint(value: PerJoint, robot: Robot, default: Array | float = 0.0) -> Array:
    """Return a per-joint quantity as an array (n,); joints that a mapping leaves out get the default."""
    if isinstance(value, Mapping):
        result = np.array(np.broadcast_to(default, (robot.n,)), dtype=np.float64)
        for joint, number in value.items():
            if joint not in robot.joint_names:
                raise NameNotFound("joint", joint, robot.joint_names)
            result[robot.joint_names.index(joint)] = number
        return result
    if isinstance(value, Sequence) and len(value) != robot.n:
        raise ConfigError(
            "value", "", f"expected {robot.n} numbers ({', '.join(robot.joint_names)}), got {len(value)}"
        )
    return np.array(np.broadcast_to(np.array(value, dtype=np.float64), (robot.n,)))


def _plant(config: ExperimentConfig, robot: Robot) -> Plant:
    """Return the plant with its loads and wires."""
    section = config.plant
    real = robot
    if section.payload is not None:
        frame = section.payload.frame or robot.tip
        real = real.with_payload(frame, section.payload.mass, section.payload.com)
    if section.armature is not None:
        real = real.with_armature(per_joint(section.armature, robot))
    torques = [load for item in section.loads for load in _loads(item, robot)]
    plant: Plant = RigidBodyPlant(
        real, torques, friction="urdf" if section.friction == "urdf" else None, substeps=section.substeps
    )
    if section.torque_rate is not None:
        plant = actuators.RateLimited(plant, per_joint(section.torque_rate, robot))
    plant = actuators.Saturated(plant)
    if section.noise is not None:
        plant = sensors.Noisy(plant, section.noise.position, section.noise.velocity, config.seed)
    if section.encoder_bits is not None:
        plant = sensors.Encoder(plant, section.encoder_bits)
    if section.drop_out:
        plant = sensors.DropOut(plant, section.drop_out, config.seed)
    if section.delay:
        plant = sensors.Delayed(plant, section.delay)
    return plant


def _loads(section: LoadSection, robot: Robot) -> list[loads.Load]:
    """Return the loads of one entry."""
    if section.type == "paper":
        return loads.paper_disturbances()
    kind: Any = {"step": loads.Step, "ramp": loads.Ramp, "sine": loads.Sine, "pulse": loads.Pulse}[
        section.type
    ]
    given = {
        key: per_joint(value, robot) if key in ("amplitude", "slope") else value
        for key, value in section.model_dump(exclude={"type"}, exclude_none=True).items()
    }
    known = tuple(kind.__dataclass_fields__)
    for key in given:
        if key not in known:
            raise NameNotFound(f"key of a {section.type}", key, known)
    try:
        load: loads.Load = kind(**given)
    except TypeError:
        missing = [key for key in known if key not in given]
        raise ConfigError("loads", section.type, f"needs {' and '.join(missing)} as well") from None
    return [load]


def _controller(config: ExperimentConfig, section: GPISection | PIDSection, robot: Robot) -> Controller:
    """Return one controller."""
    dt = config.sample_time
    believed = robot if section.inertia_scale == 1.0 else robot.scaled_inertia(section.inertia_scale)
    if isinstance(section, PIDSection):
        gains = {key: per_joint(getattr(section, key), robot) for key in ("kp", "ki", "kd")}
        return PIDInversion(believed, dt, **gains, bias_robot=robot)
    delay = config.plant.delay * dt
    omega = default_omega(dt, delay)
    tuning = FixedGains(
        per_joint(omega if section.omega is None else section.omega, robot, omega),
        per_joint(section.zeta, robot, 1.0),
        None if section.p is None else per_joint(section.p, robot, omega),
    )
    return GPI(believed, dt, tuning, realisation=section.realisation, start=section.start, delay=delay)


def _reference(section: ReferenceSection | None, robot: Robot) -> Waypoints:
    """Return the reference; without a section, a move of every joint by up to 0.5 and back."""
    middle = robot.middle()
    if section is None:
        room = robot.limits.upper - middle
        goal = middle + np.minimum(0.5, 0.5 * room)
        section = ReferenceSection(points=[middle.tolist(), goal.tolist(), middle.tolist()], holds=1.0)
    points: list[Array] = []
    for point in section.points:
        points.append(per_joint(point, robot, points[-1] if points else middle))
    durations = section.durations
    if durations is None:
        gentle = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, 1.0) * _MOVE_SHARE
        gentle = np.where(gentle > 0.0, gentle, _MOVE_SHARE)
        durations = [
            max(1.0, minimum_duration(b - a, gentle, _MOVE_ACCELERATION)) for a, b in pairwise(points)
        ]
    return Waypoints(points, durations, section.holds)


class _key:
    """Add the key of the experiment file to an error of ours that happens inside."""

    def __init__(self, source: str, key: str) -> None:
        self.source = source
        self.key = key

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Turn an error of ours into one that names the key."""
        if isinstance(error, ArmgpiError):
            raise ConfigError(self.source, self.key, str(error)) from error


def _lines(node: Any, source: str, path: tuple[str | int, ...] = ()) -> dict[tuple[str | int, ...], int]:
    """Return the line of every key of a YAML tree, refusing keys that stand twice."""
    found: dict[tuple[str | int, ...], int] = {}
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            here = (*path, str(key.value))
            line = key.start_mark.line + 1
            if here in found:
                raise ConfigError(source, ".".join(map(str, here)), "stands twice", line)
            found[here] = line
            found.update(_lines(value, source, here))
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            here = (*path, index)
            found[here] = value.start_mark.line + 1
            found.update(_lines(value, source, here))
    return found


def _path_in_data(data: Any, location: Sequence[str | int]) -> tuple[tuple[str | int, ...], Any]:
    """Return the part of pydantic's location that exists in the data, and what stands there.

    Pydantic puts the names of union members into the location ("controllers", 0, "gpi", "omega", "float").
    """
    path: list[str | int] = []
    for position, step in enumerate(location):
        in_mapping = isinstance(data, Mapping) and step in data
        in_list = isinstance(data, list) and isinstance(step, int) and step < len(data)
        if in_mapping or in_list:
            data = data[step]
        elif isinstance(data, Mapping) and position == len(location) - 1 and isinstance(step, str):
            return (*path, step), None  # a key that is missing
        else:
            continue
        path.append(step)
    return tuple(path), data


def _known_keys(location: Sequence[str | int]) -> tuple[str, ...]:
    """Return the keys that are known where an unknown one stands."""
    model: Any = ExperimentConfig
    for step in location[:-1]:
        model = {
            "robot": RobotSection,
            "plant": PlantSection,
            "payload": PayloadSection,
            "loads": LoadSection,
            "noise": NoiseSection,
            "gpi": GPISection,
            "pid": PIDSection,
            "reference": ReferenceSection,
        }.get(str(step), model)
    return tuple(model.model_fields)
