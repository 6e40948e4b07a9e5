"""What a supervisor takes for a fault: its settings, and the same as numbers for an arm and a sample time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import LARGEST, Array, as_sized_array, per_joint, quantity
from armgpi.base.parameter import Parametrised, PerJoint, parameter, parameters, with_parameters
from armgpi.control.controller import Controller, Measurement
from armgpi.control.force_limit import KNOWN_WITHIN
from armgpi.errors import ArrayError, ParameterError
from armgpi.references.reference import Target

#: Positions beyond this are no measurements: sine and cosine would lose digits and time [rad or m]. Set by
#: hand: single precision is left 1 mrad there.
FARTHEST = 1e4
#: Counts by which a reference has to move before a measurement has to. Set by hand.
COUNTS = 16.0
#: Time constant of the velocities from which a stop begins, and of the torques that RESPONSE compares [s].
#: Set by hand: five samples at 1 kHz.
SMOOTHING = 5e-3
#: Configurations in which inertias are looked at, always the same. Set by hand.
_POSES = 16
#: Resolution of positions where none is given: a turn, or the travel of a prismatic joint, in 2^16 counts, as
#: GPI.auto takes it where nobody says it.
_BITS = 16
#: Standard deviations of noise that count as resolution: a normal one passes them once in 5e8 samples.
_SIGMAS = 6.0
#: Share of the torque's rate by which the deceleration of a stop builds up and goes: the law has the rest.
_STOP_RATE = 0.5
#: Time in which it builds up, and goes, where a gear may twist [s]: a period of the slowest resonance that is
#: reckoned with, 10 Hz, as a force that grows so slowly leaves least of it (tools/faults.py).
_STOP_RISE = 0.1
#: A measurement that does not change for so long [s], while it should, is frozen. Set by hand; fault-free
#: scenarios that it stops are counted by tools/alarms.py.
_FROZEN_TIME = 0.05
#: Error at which gains are taken [rad or m]: small, and far above what rounding leaves of a torque.
_SMALL = 1e-4


@with_parameters
class Supervisor(Parametrised):
    """What a supervisor takes for a fault, and how it stops the arm.

    A frozen sensor and an arm at rest both repeat one number. They differ in what was asked of the arm since
    the number last changed: the reference has moved on by 16 counts, or the torque has gone to its limit.
    """

    on_fault: str = parameter(
        "torque in FAULT: brake follows the decelerating reference by the nominal model and damps the joints "
        "that still measure well, hold compensates gravity at the last valid position, zero",
        kind="choice",
        default="brake",
        choices=("brake", "hold", "zero"),
        structural=True,
    )
    deceleration: PerJoint = parameter(
        "deceleration of a stop",
        unit="rad/s^2 or m/s^2",
        default=10.0,
        least=0.0,
        above=True,
        per_joint=True,
    )
    stop_velocity: PerJoint = parameter(
        "velocity at which a stop begins, at most",
        unit="rad/s or m/s",
        default=None,
        none="the velocity limits",
        least=0.0,
        above=True,
        per_joint=True,
    )
    torque_rate: PerJoint = parameter(
        "highest rate of change of torque, in every state; the anti-windup takes it into account",
        unit="N m/s or N/s",
        default=None,
        none="no limit",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
    )
    jump: float = parameter(
        "JUMP: samples of travel at the velocity limit by which a measurement may miss where its last "
        "change leads; one more than may get lost in a row; 0 for no check",
        default=2.0,
        least=0.0,
    )
    reference_jump: float = parameter(
        "REFERENCE: samples of travel at the velocity limit by which the reference may miss where its "
        "velocity leads; 0 for no check, nor of reference_step",
        default=2.0,
        least=0.0,
    )
    reference_step: float = parameter(
        "REFERENCE: for how long a step of the reference's velocity may take all the torque of a joint's "
        "motor; 0 for no bound",
        unit="s",
        default=0.01,
        least=0.0,
    )
    frozen_samples: int | None = parameter(
        "FROZEN: samples for which a measurement repeats itself that should change; 0 for no check",
        kind="integer",
        default=None,
        none="those of 0.05 s, and of the delay",
        least=0,
        most=2**20,
        key="frozen",
    )
    sticking: float = parameter(
        "FROZEN: share of its limit, or of twice what gravity asks of it at most, by which a joint's torque "
        "may change while friction holds it: twice the friction of its gear; 0 for a joint without any",
        default=0.1,
        least=0.0,
        most=1.0,
    )
    resolution: PerJoint = parameter(
        "a count: what positions may differ by without a motion",
        unit="rad or m",
        default=None,
        none="the encoder's, or a turn / 2^16",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
    )
    position_margin: PerJoint = parameter(
        "POSITION: how far beyond its limits a joint may be",
        unit="rad or m",
        default=0.1,
        least=0.0,
        per_joint=True,
    )
    following: PerJoint = parameter(
        "FOLLOWING: largest distance from the reference; springs and force limits pass the default",
        unit="rad or m",
        default=0.5,
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
    )
    saturated: float = parameter(
        "SATURATED: how long a torque may be at its limit; shorter times add up, times below it count back; "
        "0 for no check",
        unit="s",
        default=0.5,
        least=0.0,
    )
    response: float = parameter(
        "RESPONSE: how long, after eight samples, a joint may answer its torque the wrong way, running away "
        "from its reference; it then brakes by its reversed torque; 0 for no check",
        unit="s",
        default=0.004,
        least=0.0,
    )
    speed: float | None = parameter(
        "SPEED: share of its velocity limit by which a joint may be faster",
        default=None,
        none="no check; 0 with springs or a force limit",
        least=0.0,
    )
    speed_cap: PerJoint = parameter(
        "SPEED: highest velocity, whatever the limit is; beyond it is FAULT; of a stage of `armgpi bringup`",
        unit="rad/s or m/s",
        default=None,
        none="no cap",
        least=0.0,
        above=True,
        per_joint=True,
    )
    torque_cap: PerJoint = parameter(
        "CAP: how far a torque may be from what holds the nominal model; a controller that asks for as "
        "much is a fault, and no torque is farther; of a stage of `armgpi bringup`",
        unit="N m or N",
        default=None,
        none="no cap",
        least=0.0,
        above=True,
        per_joint=True,
    )
    workspace: Any = parameter(
        "WORKSPACE: box that the tool has to stay in, its lowest and its highest x, y, z in the base frame",
        unit="m",
        kind="points",
        default=None,
        none="no check",
        structural=True,
    )
    tool_speed: float | None = parameter(
        "TOOL_SPEED: highest speed of the tool",
        unit="m/s",
        default=None,
        none="no check",
        least=0.0,
        above=True,
        structural=True,
    )
    tool_force: float | None = parameter(
        "TOOL_FORCE: highest estimated force on the tool, beyond what friction and `uncertain_mass` may be",
        unit="N",
        default=None,
        none="no check",
        least=0.0,
        above=True,
        log=True,
        structural=True,
    )
    friction_within: float = parameter(
        "TOOL_FORCE: factor within which the model's Coulomb friction is known; of a model without any, 0 to "
        "6 % of the effort are reckoned with",
        default=KNOWN_WITHIN,
        least=1.0,
        structural=True,
    )
    uncertain_mass: float = parameter(
        "TOOL_FORCE: mass at the tool that the model may lack, or have too much",
        unit="kg",
        default=0.0,
        least=0.0,
        structural=True,
    )
    tool_frame: str | None = parameter(
        "frame that is the tool", kind="text", default=None, none="the tip", structural=True
    )
    missed: int = parameter(
        "LATE: samples that may be missed in a row; after as many without a good measurement it is FAULT",
        kind="integer",
        default=20,
        least=0,
        most=1000,
    )

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ParameterError: when a setting is not as declared, the workspace is empty, or a tool is named that
                nothing is checked of.
            ArrayError: when the workspace is no pair of three numbers.
        """
        super().__post_init__()
        if self.workspace is not None:
            self.keep("workspace", _check_workspace(self.workspace))
        if self.tool_frame is not None and not self.checks_tool:
            raise ParameterError(
                "tool_frame",
                self.tool_frame,
                "left out where none of workspace, tool_speed and tool_force is given",
            )

    @property
    def checks_tool(self) -> bool:
        """Whether the tool is checked, not only the joints."""
        asked = (self.workspace, self.tool_speed, self.tool_force)
        return any(each is not None for each in asked)


class Bounds(NamedTuple):
    """The numbers that a supervised controller compares with, each of shape (n,) or (batch, n).

    Attributes:
        jump: by how much a position may miss where its last change leads [rad or m].
        turn: a change in a sample of which a joint may turn round at once [rad or m].
        step: by how much the reference may miss where its velocity leads [rad or m].
        lower: lowest position [rad or m].
        upper: highest position [rad or m].
        following: largest distance from the reference [rad or m].
        travel: of the reference, which asks a position to change [rad or m].
        slowing: change of velocity in a sample of a stop [rad or m per sample].
        jerk: change of that from sample to sample, as the torque's rate and gears allow [rad or m].
        stop_velocity: at which a stop begins, at most [rad or m per sample].
        rate: change of torque in a sample, at most [N m or N].
        speed: largest velocity, smoothed [rad or m per sample].
        cap: how far a torque may be from what holds the model [N m or N].
    """

    jump: Array
    turn: Array
    step: Array
    lower: Array
    upper: Array
    following: Array
    travel: Array
    slowing: Array
    jerk: Array
    stop_velocity: Array
    rate: Array
    speed: Array
    cap: Array


def _check_workspace(value: Any) -> tuple[tuple[float, ...], ...]:
    """Return the lowest and the highest corner of a box [m].

    Raises:
        ParameterError: when the box is empty.
        ArrayError: when it is no pair of three numbers.
    """
    corners = as_sized_array(value, "workspace")
    if corners.shape != (2, 3):
        said = f"expected two corners of three numbers (x, y, z), got shape {corners.shape}"
        raise ArrayError("workspace", said)
    lower, upper = (tuple(row) for row in corners.tolist())
    for axis, least, most in zip("xyz", lower, upper, strict=True):
        if not least < most:
            expected = f"a box whose lowest {axis} is below its highest, not from {least:g} to {most:g} m"
            raise ParameterError("workspace", corners.tolist(), expected)
    return lower, upper


def suited(law: Controller, given: Supervisor) -> Supervisor:
    """Return settings that suit a controller: a spring is off its reference by force over stiffness.

    Beyond a force limit nothing holds the arm at its reference either. The default of FOLLOWING is not
    checked then, another one is. That it moves faster than its joints may is a fault where nothing else is
    specified.
    """
    if not law.compliant and getattr(law, "force_limit", None) is None:
        return given
    changes: dict[str, Any] = {}
    if np.all(given.following == parameters(Supervisor)["following"].default):
        changes["following"] = FARTHEST
    if given.speed is None:
        changes["speed"] = 0.0
    return given.with_values(**changes) if changes else given


def bounds_of(law: Controller, given: Supervisor) -> Bounds:
    """Return the numbers for a controller's arm and sample time.

    Raises:
        ArrayError: when a bound does not fit the joints.
    """
    robot, dt = law.robot, law.dt
    declared = parameters(Supervisor)

    def joints(name: str, otherwise: Any = None) -> Array:
        value = getattr(given, name)
        value = otherwise if value is None else value
        one = declared[name]
        return per_joint(value, name, robot.joint_names, one.bounds, one.inside)

    count = joints("resolution", robot.encoder_count(_BITS))
    lower, upper, limit, _ = robot.limits
    # A joint whose URDF gives no velocity limit may move at any speed.
    speed = np.where(limit > 0.0, limit, math.inf)
    margin = joints("position_margin")
    jumps, steps = (
        share * dt * speed + 2.0 * count if share else math.inf
        for share in (given.jump, given.reference_jump)
    )
    if given.reference_jump and given.reference_step:
        steps = np.minimum(steps, given.reference_step * dt * least_acceleration(law) + 2.0 * count)
    known = np.minimum(speed, LARGEST)
    most = math.inf if given.speed is None else (1.0 + given.speed) * dt * speed
    # A smoothed velocity is off by a share of a count, at most, whatever the motion.
    most = np.minimum(most, dt * joints("speed_cap", LARGEST)) + smoothing(dt, SMOOTHING) * count
    lowest, highest = np.maximum(lower - margin, -FARTHEST), np.minimum(upper + margin, FARTHEST)
    slowing = dt * (dt * joints("deceleration"))
    shape = np.broadcast_shapes(count.shape, lowest.shape, np.shape(steps))
    return Bounds(
        jump=np.minimum(np.broadcast_to(jumps, shape), LARGEST),
        turn=4.0 * count if given.jump else np.full(shape, LARGEST),
        step=np.minimum(np.broadcast_to(steps, shape), FARTHEST),
        lower=lowest,
        upper=highest,
        following=joints("following"),
        travel=COUNTS * count,
        slowing=slowing,
        jerk=np.minimum(
            _STOP_RATE * dt**3 * joints("torque_rate", LARGEST) / heaviest(law),
            slowing * np.where(model_of(law).armature > 0.0, min(dt / _STOP_RISE, 1.0), 1.0),
        ),
        stop_velocity=dt * joints("stop_velocity", known),
        rate=dt * joints("torque_rate", LARGEST),
        speed=np.minimum(np.broadcast_to(most, shape), LARGEST),
        cap=joints("torque_cap", LARGEST),
    )


def smoothing(dt: float, time_constant: float) -> float:
    """Return the share of what is new that a smoothed number takes in a sample: backward Euler."""
    return dt / (dt + time_constant)


def model_of(law: Controller) -> Any:
    """Return the robot that a law takes for the arm: that of its feedback may be heavier."""
    return getattr(law, "bias_robot", law.robot)


def own_inverse_inertia(law: Controller) -> Array:
    """Return each joint's entry of D(q)^-1 in the middle of its range: as if no other joint were driven."""
    robot = model_of(law)
    return np.diagonal(np.linalg.inv(robot.mass_matrix(robot.middle())), axis1=-2, axis2=-1)


def turning(law: Controller) -> tuple[Array, Array]:
    """Return half of what a push, and all torques, change of a motion in a sample, at most [rad or m].

    A push is by half the torque of the joint's motor; torques are at their limits. A gear may twist before
    its link follows: a motor is pushed with its rotor alone.
    """
    effort, half = np.minimum(law.effort, LARGEST), 0.5 * law.dt**2
    rotor = model_of(law).armature
    alone = np.where(rotor > 0.0, 1.0 / np.where(rotor > 0.0, rotor, 1.0), 0.0)
    pushed, driven = [half * 0.5 * effort * alone], []
    for inertia in _inertias(law):
        inverse = np.abs(np.linalg.inv(inertia))
        pushed.append(half * 0.5 * effort * np.diagonal(inverse, axis1=-2, axis2=-1))
        driven.append(half * (inverse @ effort[..., None])[..., 0])
    return np.max(pushed, axis=0), np.max(driven, axis=0)


def least_acceleration(law: Controller) -> Array:
    """Return each joint's least acceleration by all its torque, the others held [rad/s^2 or m/s^2]."""
    return np.asarray(np.minimum(law.effort, LARGEST) / heaviest(law))


def proportional_gain(law: Controller) -> Array | None:
    """Return what an error that stays asks of each joint's torque, without any integral [N m/rad or N/m].

    None for a law that is not stiff: all but those that were made for encoders at the motors, which have a
    share of the links' inertia in their feedback, and start without a kick.
    """
    if getattr(law, "start", "") != "rest" or np.all(law.link_factor == 1.0):  # type: ignore[attr-defined]
        return None
    robot: Any = law.robot
    shape = (robot.n,) if law.batch is None else (law.batch, robot.n)
    zero, free = np.zeros(shape), law.unlimited()
    q = np.ascontiguousarray(np.broadcast_to(robot.middle(), shape))
    seen = Measurement(q)

    def torque(wanted: Array) -> Array:
        target = Target(wanted, zero, zero)
        # At rest without an error; then with one, on which only the filter has settled.
        state = free.waiting(seen, target, free.init(seen, Target(q, zero, zero)))
        return np.asarray(free.step(seen, target, state).tau)

    held, steps = torque(q), _SMALL * np.eye(robot.n)
    return (
        np.abs(np.stack([(torque(q + step) - held)[..., j] for j, step in enumerate(steps)], axis=-1))
        / _SMALL
    )


def heaviest(law: Controller) -> Array:
    """Return each joint's largest inertia, the others held [kg m^2 or kg]."""
    return np.asarray(
        np.max([np.diagonal(inertia, axis1=-2, axis2=-1) for inertia in _inertias(law)], axis=0)
    )


def largest_gravity(law: Controller) -> Array:
    """Return the most that gravity asks of each joint's motor [N m or N]."""
    return np.asarray(np.max([np.abs(model_of(law).gravity(q)) for q in _configurations(law)], axis=0))


def _inertias(law: Controller) -> Iterator[Array]:
    """Yield the model's D(q) in some configurations."""
    return (model_of(law).mass_matrix(q) for q in _configurations(law))


def _configurations(law: Controller) -> Iterator[Array]:
    """Yield some configurations, always the same."""
    lower, upper = (np.clip(x, -math.pi, math.pi) for x in model_of(law).limits[:2])
    for share in np.random.default_rng(0).uniform(size=(_POSES, law.robot.n)):
        yield lower + share * (upper - lower)


def complete_settings(supervisor: Supervisor, plant: Any, controller: Controller) -> Supervisor:
    """Return settings in which what is not given suits an experiment's encoder, noise and delay.

    Args:
        supervisor: the settings.
        plant: the section of the experiment file.
        controller: for whose arm.
    """
    found: dict[str, Any] = {name: getattr(supervisor, name) for name in parameters(Supervisor)}
    if found["resolution"] is None:
        names = controller.robot.joint_names
        bits = _BITS if plant.encoder_bits is None else plant.encoder_bits
        count = controller.robot.encoder_count(quantity(bits, "encoder_bits", names, _BITS))
        noise = 0.0 if plant.noise is None else quantity(plant.noise.position, "position", names, 0.0)
        found["resolution"] = count + _SIGMAS * noise
    if found["frozen_samples"] is None:  # what comes late repeats itself for longer
        found["frozen_samples"] = frozen_samples(controller.dt) + plant.delay
    if found["response"]:  # and answers late
        found["response"] += controller.dt * plant.delay
    return Supervisor(**found)


def frozen_samples(dt: float) -> int:
    """Return how many samples of `dt` [s] make a measurement frozen."""
    return max(3, math.ceil(_FROZEN_TIME / dt - 1e-9))
