"""From a checked configuration to the objects it describes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from armgpi.arrays import Array
from armgpi.config.reading import Origin, Path_
from armgpi.config.schema import (
    BoxSection,
    CircleSection,
    ControllerSection,
    ExperimentConfig,
    GPISection,
    LaserSection,
    LissajousSection,
    NetworkSection,
    PaperLoad,
    PathSection,
    PIDSection,
    PlantSection,
    ReferenceSection,
    RobotSection,
)
from armgpi.control.controller import Controller
from armgpi.control.gains import FixedGains, Gains, default_omega
from armgpi.control.gpi import GPI
from armgpi.control.network import BSplineNetwork
from armgpi.control.payload import payload_range
from armgpi.control.pid import PIDInversion
from armgpi.errors import ArmgpiError, ConfigError, EffortError, NameNotFound
from armgpi.paper.arm import PaperArm
from armgpi.plants import actuators, loads, sensors
from armgpi.plants.plant import Plant
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.references import paths
from armgpi.references.bezier import Bezier, minimum_duration
from armgpi.references.cartesian import CartesianReference, Inverse
from armgpi.references.reference import Reference
from armgpi.references.waypoints import Waypoints
from armgpi.robot.kinematics import TrackingInverse, inverse_kinematics, random_configurations
from armgpi.robot.robot import Robot

#: Most samples of a run: a day at 10 kHz.
_MAX_SAMPLES = 10**9
#: Share of the velocity limits that a move without a duration uses, and its acceleration [rad/s^2].
_MOVE_SHARE = 0.5
_MOVE_ACCELERATION = 5.0
#: How far a move goes that nobody asked for [rad or m]; and the share of a joint's effort that holding the
#: arm may take on its way, if it does not take more at the start.
_MOVE, _HOLDING_SHARE, _ROUNDING = 0.5, 0.9, 1e-9
#: Velocity limits below this are none [rad/s or m/s]: a move would take weeks.
_LEAST_SPEED = 1e-6
#: Share of the effort beyond gravity that a move without a duration may take; how much slower it may become.
_MOVING_SHARE, _SLOWEST = 0.8, 4.0
#: How long a run goes on after its reference has ended, when nothing is said [s].
_SETTLE = 2.0
#: Time for a path without an end, when nothing is said [s].
_PATH_TIME = 18.0
#: Size of a path that is chosen for an arm, as a share of how far from the base it is; and the number of
#: configurations among which the roomiest is looked for.
_PATH_SIZE, _CANDIDATES = 0.1, 256
#: Ends of a network's box when nothing is said, in default bandwidths: 22 and 60 rad/s at 30 rad/s.
_CALM, _ALERT = 22.0 / 30.0, 2.0
#: Resolution that stands for the scale of errors where there is no encoder.
_FINE_BITS = 22


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
    def error_context(self) -> Iterator[None]:
        """Turn an error of ours that happens inside into one that names this key."""
        try:
            yield
        except ConfigError:
            raise
        except ArmgpiError as error:
            raise self.error(str(error)) from error


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


def build(config: ExperimentConfig, origin: Origin | None = None) -> Experiment:
    """Make the objects that a configuration describes.

    Raises:
        ConfigError: when something in it does not fit the robot; it names the key.
    """
    top = _Place(origin or Origin())
    robot = _robot(config.robot, top.at("robot"))
    plant = _plant(config, robot, top.at("plant"))
    controllers: dict[str, Controller] = {}
    sections: list[ControllerSection] = []
    for index, section in enumerate(config.controllers):
        place = top.at("controllers", index)
        label = section.label or section.type
        if label in controllers:
            label = f"{label} {index + 1}"
        if label in controllers:
            raise place.at("label").error(f"another controller is labelled {label!r} as well")
        try:
            with place.error_context():
                section, controllers[label] = _controller(config, section, robot, place)
        except ConfigError as error:
            if isinstance(error.__cause__, EffortError):
                raise top.at("robot", "effort").error(str(error.__cause__)) from None
            raise
        sections.append(section.model_copy(update={"label": label}))
    reference, end, moves = _reference(config.reference, robot, top.at("reference"))
    t_final = end + _SETTLE if config.t_final is None else config.t_final
    if not 0.5 < t_final / config.sample_time <= _MAX_SAMPLES:
        # Say whose key it is: the run's length may be the reference's, and the samples the default ones.
        given = (key for key in ("t_final", "sample_time", "reference") if key in config.model_fields_set)
        raise top.at(next(given, "t_final")).error(
            f"expected {config.sample_time:g} to {config.sample_time * _MAX_SAMPLES:g} s (1 to "
            f"{_MAX_SAMPLES:.0e} samples of {config.sample_time:g} s) in a run, got {t_final:g} s"
        )
    filled = {"controllers": sections, "reference": moves, "t_final": t_final}
    return Experiment(robot, plant, controllers, reference, t_final, config.model_copy(update=filled))


def _robot(section: RobotSection, place: _Place) -> Robot:
    """Return the arm."""
    # In a mapping, a joint without a value is locked where Robot.load would lock it by its name alone.
    lock: Any = section.lock
    try:
        robot = Robot.load(section.name, lock=lock, keep=section.keep, mimic=section.mimic)
    except NameNotFound as error:
        # Robots and joints are looked up: say whose key it is.
        key = next((k for k in ("lock", "keep") if error.name in (getattr(section, k) or ())), "name")
        raise place.at(key).error(str(error)) from None
    except ArmgpiError as error:
        raise place.at("name").error(str(error)) from error
    except OSError as error:  # a name too long for a file, for one
        raise place.at("name").error(f"cannot be read: {error.strerror or error}") from None
    if section.effort is not None:
        current = robot.limits.effort
        with place.at("effort").error_context():
            robot = robot.with_limits(effort=_per_joint(section.effort, robot, place.at("effort"), current))
    return robot


def _plant(config: ExperimentConfig, robot: Robot, place: _Place) -> Plant:
    """Return the plant with its loads and wires."""
    section = config.plant
    real = robot
    if section.payload is not None:
        with place.at("payload").error_context():
            frame = section.payload.frame or robot.tip
            real = real.with_payload(frame, section.payload.mass, section.payload.com)
    if section.armature is not None:
        armature = _per_joint(section.armature, robot, place.at("armature"), robot.armature)
        real = real.with_armature(armature)
    torques: list[loads.Load] = []
    for index, item in enumerate(section.loads):
        with place.at("loads", index).error_context():
            torques += _loads(item, robot, place.at("loads", index))
    with place.error_context():
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
        if section.velocity_bandwidth is not None:
            plant = sensors.Differentiated(plant, section.velocity_bandwidth)
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
        return [*loads.paper_disturbances()]
    kinds: dict[str, Any] = {"step": loads.Step, "ramp": loads.Ramp, "sine": loads.Sine, "pulse": loads.Pulse}
    given = section.model_dump(exclude_none=True)
    kind = kinds[given.pop("type")]
    for key in ("amplitude", "slope", "omega", "phase"):
        if key in given:
            given[key] = _per_joint(given[key], robot, place.at(key), 0.0)
    load: loads.Load = kind(**given)
    return [load]


def _controller(
    config: ExperimentConfig, section: ControllerSection, robot: Robot, place: _Place
) -> tuple[ControllerSection, Controller]:
    """Return one controller, and its section with the defaults filled in."""
    dt = config.sample_time
    nominal = robot if section.inertia_scale == 1.0 else robot.scaled_inertia(section.inertia_scale)
    if isinstance(section, PIDSection):
        defaults = {"kp": 400.0, "ki": 500.0, "kd": 40.0}
        gains = {
            key: _per_joint(getattr(section, key), robot, place.at(key), default)
            for key, default in defaults.items()
        }
        return section, PIDInversion(nominal, dt, **gains, bias_robot=robot)
    delay = config.plant.delay * dt
    omega = default_omega(dt, delay)
    law: dict[str, Any] = {"realisation": section.realisation, "start": section.start, "delay": delay}
    if section.payload_range is not None:
        span = section.payload_range
        frame = span.frame or robot.tip
        with place.at("payload_range").error_context():
            found = payload_range(robot, span.lightest, span.heaviest, frame, span.com, dt=dt, delay=delay)
        omega = found.omega_c
        law |= {"payload": (span.lightest, span.heaviest), "frame": frame, "com": span.com}
    adapted: Gains
    if isinstance(section, NetworkSection):
        section, adapted = _network(section, robot, omega, config.plant, place)
    else:
        section, adapted = _fixed_gains(section, robot, omega, place)
    return section, GPI(nominal, dt, adapted, **law)


def _fixed_gains(
    section: GPISection, robot: Robot, omega: float, place: _Place
) -> tuple[GPISection, FixedGains]:
    """Return constant gains, `omega` where no bandwidth is given."""
    if section.omega is None:
        section = section.model_copy(update={"omega": omega})
    omegas = _per_joint(section.omega or omega, robot, place.at("omega"), omega)
    zetas = _per_joint(section.zeta, robot, place.at("zeta"), 1.0)
    ps = None if section.p is None else _per_joint(section.p, robot, place.at("p"), omegas)
    return section, FixedGains(omegas, zetas, ps)


def _network(
    section: NetworkSection, robot: Robot, omega: float, plant: PlantSection, place: _Place
) -> tuple[NetworkSection, BSplineNetwork]:
    """Return networks; where nothing is given, their box is around the default bandwidth `omega`."""
    count = 2.0 * math.pi / 2.0 ** (plant.encoder_bits or _FINE_BITS)
    filled = {
        "omega": BoxSection(lower=omega * _CALM, upper=omega * _ALERT),
        "error_range": count,
        "dead_zone": 2.0 * count if plant.encoder_bits else 0.0,
    }
    missing = {key: value for key, value in filled.items() if getattr(section, key) is None}
    section = section.model_copy(update=missing)

    def box(key: str) -> Any:
        value = getattr(section, key)
        if value is None:
            return None
        if isinstance(value, BoxSection):
            here = place.at(key)
            ends = ("lower", "upper")
            low, high = (_per_joint(getattr(value, end), robot, here.at(end), None) for end in ends)
            if np.any(low > high):
                raise here.error(f"expected lower <= upper, got {low.tolist()} above {high.tolist()}")
            return low, high
        return _per_joint(value, robot, place.at(key), None)

    def each(key: str) -> Any:
        value = getattr(section, key)
        return None if value is None else _per_joint(value, robot, place.at(key), None)

    network = BSplineNetwork(
        omega_c=box("omega"),
        zeta_c=box("zeta"),
        p_c=box("p"),
        learning=section.learning,
        learning_rate=each("learning_rate"),
        error_range=each("error_range"),
        derivative_range=each("derivative_range"),
        dead_zone=each("dead_zone"),
        leak=section.leak,
        rate=math.inf if section.rate is None else each("rate"),
        bandwidth=section.bandwidth,
        knots=section.knots,
        order=section.order,
    )
    return section, network


def _reference(
    section: ReferenceSection, robot: Robot, place: _Place
) -> tuple[Reference, float, ReferenceSection]:
    """Return the reference, when it has ended [s], and its section with the defaults filled in."""
    if section.path is None:
        if section.frame is not None:
            raise place.at("frame").error("goes with path")
        return _moves(section, robot, place)
    for key in ("points", "durations", "holds"):
        if getattr(section, key) is not None:
            raise place.at(key).error("cannot stand beside path: give one of the two")
    frame = section.frame or robot.tip
    with place.at("frame").error_context():
        robot.frame_pose(frame, robot.middle())
    axis = section.tool_axis or [0.0, 0.0, 1.0]
    inverse: Inverse = PaperArm().inverse_kinematics
    if section.direction is not None or not _is_paper_arm(robot, frame):
        with place.error_context():
            inverse = TrackingInverse(robot, frame, direction=section.direction, tool_axis=axis)
    elif section.tool_axis is not None:
        raise place.at("tool_axis").error("goes with direction")
    with place.at("path").error_context():
        drawn = _fitted(section.path, robot, frame, section.direction, axis)
        path = _path(drawn)
        reference = CartesianReference(robot, frame, path, inverse)
    end = path.t_end if math.isfinite(path.t_end) else _PATH_TIME
    return reference, end, section.model_copy(update={"frame": frame, "path": drawn})


def _is_paper_arm(robot: Robot, frame: str) -> bool:
    """Tell whether a frame moves as the paper's tool does: then eq. 2 is its inverse kinematics."""
    if robot.n != 3:
        return False
    q = np.array([[0.0, 0.0, 0.0], [0.3, 0.5, -0.7], [-1.1, 0.2, 0.9]])
    there = robot.frame_pose(frame, q).translation
    return bool(np.abs(there - PaperArm().forward_kinematics(q)).max() < 1e-9)


def _fitted(
    section: PathSection, robot: Robot, frame: str, direction: list[float] | None, axis: list[float]
) -> PathSection:
    """Return a path with what was left out chosen for the arm: around a point where it has clearance."""
    if isinstance(section, LaserSection):
        return section
    clearance = TrackingInverse(robot, frame, direction=direction, tool_axis=axis).clearance
    q = random_configurations(robot, _CANDIDATES, seed=0)
    points = robot.frame_pose(frame, q).translation
    if direction is not None:
        found = inverse_kinematics(robot, frame, points, direction=direction, tool_axis=axis, restarts=4)
        if found.reached.any():
            q, points = found.q[found.reached], points[found.reached]
    point = points[np.argmax(clearance(q))]
    size = _PATH_SIZE * float(np.linalg.norm(point))
    chosen: dict[str, Any]
    if isinstance(section, LissajousSection):
        chosen = {"centre": point, "amplitude": np.array([0.0, size, 0.5 * size])}
    elif isinstance(section, CircleSection):
        chosen = {"centre": point, "radius": size}
    else:
        square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]], dtype=np.float64)
        chosen = {"corners": point + size * (square - [0.5, 0.5, 0.0])}
    missing = {
        key: np.asarray(value).tolist() for key, value in chosen.items() if getattr(section, key) is None
    }
    return section.model_copy(update=missing)


def _path(section: PathSection) -> paths.Path:
    """Return a path in space."""
    kinds: dict[str, Any] = {
        "laser": paths.LaserPath,
        "lissajous": paths.Lissajous,
        "circle": paths.Circle,
        "polyline": paths.Polyline,
    }
    given = section.model_dump()
    ease = given.pop("ease", 0.0)
    path: paths.Path = kinds[given.pop("type")](**given)
    return paths.Eased(path, ease) if ease else path


def _moves(
    section: ReferenceSection, robot: Robot, place: _Place
) -> tuple[Waypoints, float, ReferenceSection]:
    """Return moves from configuration to configuration; see `_reference`."""
    points: list[Array] = []
    holds = section.holds
    if section.points is None:
        middle = robot.middle()
        points = [middle, _goal(robot, middle), middle]
        holds = 1.0 if holds is None else holds
    for index, point in enumerate(section.points or ()):
        here = place.at("points", index)
        before = points[-1] if points else robot.middle()
        points.append(_per_joint(point, robot, here, before))
        with here.error_context():
            robot.check_position(points[-1], f"point {index + 1} of the reference")
    durations = section.durations
    if durations is None:
        durations = [_gentle(robot, a, b) for a, b in pairwise(points)]
    with place.error_context():
        reference = Waypoints(points, durations, 0.0 if holds is None else holds)
    filled = ReferenceSection(
        points=[point.tolist() for point in points],
        durations=durations,
        holds=0.0 if holds is None else holds,
    )
    return reference, reference.t_end, filled


def _gentle(robot: Robot, start: Array, goal: Array) -> float:
    """Return a duration of a move [s] that keeps half the speeds, and the torques where motors are weak."""
    speed = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, 1.0) * _MOVE_SHARE
    speed = np.where(speed > _LEAST_SPEED, speed, _MOVE_SHARE)
    duration = max(1.0, minimum_duration(goal - start, speed, _MOVE_ACCELERATION))
    target = Bezier(start, goal, duration).at(np.linspace(0.0, duration, 41))
    holding = robot.gravity(target.q)
    moving = robot.inverse_dynamics(*target) - holding  # falls with the square of the duration
    left = robot.limits.effort - np.sign(moving) * holding
    share = np.divide(np.abs(moving), _MOVING_SHARE * left, out=np.zeros_like(moving), where=left > 0.0)
    return duration * math.sqrt(min(max(1.0, float(share.max())), _SLOWEST**2))


def _goal(robot: Robot, middle: Array) -> Array:
    """Return a configuration near the middle that the motors can hold the arm to all the way, if any."""
    step = np.minimum(_MOVE, 0.5 * (robot.limits.upper - middle))
    most = np.maximum(_HOLDING_SHARE * robot.limits.effort, np.abs(robot.gravity(middle)))
    for scale in (1.0, -1.0, 0.5, -0.5, 0.25, -0.25, 0.125, -0.125):
        goal: Array = middle + scale * step
        way = middle + np.linspace(0.0, 1.0, 21)[:, None] * (goal - middle)
        inside = (goal >= robot.limits.lower).all()
        if inside and (np.abs(robot.gravity(way)) <= most + _ROUNDING * most).all():
            return goal
    return middle + step


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
