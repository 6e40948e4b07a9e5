"""What an arm, its drives and its sensors may really be: drawn at random, every distribution a parameter.

A draw is a pure function of (seed, index) and the arm. Each quantity has random numbers of its own, so
changing one distribution leaves all others as they were drawn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import LARGEST, Array, check_whole
from armgpi.base.parameter import Parametrised, parameter, with_parameters
from armgpi.errors import ParameterError
from armgpi.plants import noise
from armgpi.plants.actuators import Saturated
from armgpi.plants.elastic import ElasticPlant
from armgpi.plants.loads import Step
from armgpi.plants.plant import Plant
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.plants.sensors import Delayed, Encoder
from armgpi.references.bezier import minimum_duration
from armgpi.references.reference import Reference
from armgpi.references.waypoints import Waypoints
from armgpi.registry import Context
from armgpi.robot import rotors
from armgpi.robot.batch import AnyRobot
from armgpi.robot.drives import Drives
from armgpi.robot.equations import Friction
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Quantities with random numbers of their own; a new one comes last, or all draws would change.
_QUANTITIES = (
    *("sample_time", "delay", "encoder_bits", "rotor_inertia", "payload", "payload_place"),
    *("inertia_scale", "has_friction", "coulomb", "viscous", "has_effort", "effort", "effort_known"),
    *("has_step", "torque_step", "configuration", "distance", "direction", "speed"),
    *(
        "rotor_common",
        "rotor_each",
        "mode",
        "stiffness_share",
        "gear_damping",
        "at_motor",
        "current",
        "cogging",
    ),
    *("gear_ratio", "side_known"),
)
#: More quantities than there will ever be.
_MOST_QUANTITIES = 64
#: Configurations over which inertia and gravity of an arm are taken, and moves among which one is looked for.
_INERTIAS, _GRAVITIES, _MOVES = 50, 200, 64
#: Configurations of a move at which gravity is checked.
_ON_THE_WAY = 21
#: Least gravity torque of a joint, as a share of the largest joint's; most, as a share of its effort.
_LEAST_GRAVITY, _MOST_GRAVITY = 0.03, 0.5
#: Effort in gravity torques beyond which a limit is none; speed that replaces a limit where there is none.
_MOST_EFFORT, _SPEED = 5.0, 1.0
#: Kinds whose rotors have the scatter of published drives.
_SCATTERED = ("undriven", "elastic", "owned")
#: Lowest mode of gears that are rigid [Hz]: beyond half of all sampling rates.
_RIGID = 2000.0
#: Velocity limits below this are none [rad/s or m/s].
_LEAST_SPEED = 1e-6


class Scales(NamedTuple):
    """What the distributions are in shares of, joint by joint.

    Attributes:
        inertia: mean diagonal of D(q) [kg m^2 or kg], shape (n,).
        gravity: largest gravity torque [N m or N], likewise, but for joints that have hardly any.
        effort: effort limit [N m or N], at most five times the gravity torque.
        mass: of all that moves [kg].
    """

    inertia: Array
    gravity: Array
    effort: Array
    mass: float


@lru_cache(maxsize=64)
def scales(robot: Robot) -> Scales:
    """Return the scales of an arm, at random configurations that are always the same."""
    q = random_configurations(robot, _GRAVITIES, seed=0)
    inertia = np.mean([np.diag(D) for D in robot.mass_matrix(q[:_INERTIAS])], axis=0)
    largest = np.abs(robot.gravity(q)).max(axis=0)
    if not largest.any():  # an arm that gravity does not move: what accelerates it by 1 rad/s^2 stands in
        largest = inertia
    floor = np.maximum(largest, _LEAST_GRAVITY * largest.max())
    limit = robot.limits.effort
    gravity = np.minimum(floor, _MOST_GRAVITY * np.where(limit > 0.0, limit, math.inf))
    return Scales(inertia, gravity, np.minimum(limit, _MOST_EFFORT * gravity), robot.moving_mass)


class Gears(NamedTuple):
    """Gears of a draw that has any, and motors behind them; arrays of shape (n,).

    Attributes:
        stiffness: [N m/rad or N/m].
        damping: [N m s/rad or N s/m].
        current: bandwidth of the current loops [Hz].
        cogging: amplitude of the cogging torque [N m or N].
        side: where the encoders sit, "motor" or "link".
    """

    stiffness: Array
    damping: Array
    current: Array
    cogging: Array
    side: str


class Numbers(NamedTuple):
    """What is drawn before it is known of which arm; arrays of shape (n,).

    Attributes:
        sample_time: of the controller [s].
        delay: samples by which measurements are late.
        encoder_bits: resolution of the encoders.
        rotor_inertia: true over nominal rotor inertia [-], (n,).
        payload: over the mass of the arm [-].
        payload_place: its centre of mass in the tip's frame [m], (3,).
        inertia_scale: nominal over modelled inertia matrix [-].
        coulomb: Coulomb friction over gravity torque [-], (n,).
        viscous: viscous over Coulomb friction [s/rad], (n,).
        effort: torque limit over the arm's; infinite where it is the arm's.
        effort_known: whether the controller knows the limit.
        torque_step: torque of the disturbance over gravity torque [-], (n,).
        mode: lowest mode of links, rotors and gears [Hz].
        stiffness_share: stiffness of the gears in shares that the mode scales [-], (n,).
        gear_damping: of the gears, as a ratio of each joint's own mode [-].
        at_motor: whether the encoders sit at the motors.
        current: bandwidth of the current loops [Hz].
        cogging: amplitude of the cogging torque over gravity torque [-], (n,).
        gear_ratio: turns of a motor in one of its joint, of all joints.
        side_known: whether the controller knows on which side of the gears the encoders sit.
    """

    sample_time: float
    delay: int
    encoder_bits: int
    rotor_inertia: Array
    payload: float
    payload_place: Array
    inertia_scale: float
    coulomb: Array
    viscous: Array
    effort: float
    effort_known: bool
    torque_step: Array
    mode: float
    stiffness_share: Array
    gear_damping: float
    at_motor: bool
    current: float
    cogging: Array
    gear_ratio: float
    side_known: bool


class Move(NamedTuple):
    """A move: from where to where [rad or m], after how long and in what time [s]."""

    start: Array
    goal: Array
    begin: float
    duration: float


class Scenario(NamedTuple):
    """One arm, its drives and sensors, a move, and what its controller is given of them.

    Attributes:
        index: which scenario of its uncertainty model.
        numbers: what was drawn.
        model: the arm as its maker knows it: without the load, with nominal rotor inertia, its torque limits
            those of the motors where they are known.
        nominal: nominal model of a controller, `model` with all inertia scaled; the scaled one is for D(q)
            alone, as in the paper's comparison.
        arm: what it really is.
        friction: of its joints; None without rotor inertia.
        effort: torque limits of the motors [N m or N], (n,).
        scale: effort that chatter is in shares of [N m or N], (n,).
        torque_step: disturbance torque [N m or N], (n,).
        step_time: from when to when it acts [s].
        move: the reference.
        t_final: how long the experiment is [s].
        robot: the arm as its URDF has it, and what its maker knows of its drives in every draw.
        gears: its gears; None for rigid ones.
    """

    index: int  # type: ignore[assignment]
    numbers: Numbers
    model: Robot
    nominal: Robot
    arm: Robot
    friction: Friction | None
    effort: Array
    scale: Array
    torque_step: Array
    step_time: tuple[float, float]
    move: Move
    t_final: float
    robot: Robot
    gears: Gears | None = None

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return self.numbers.sample_time

    @property
    def delay(self) -> int:
        """Samples by which measurements are late."""
        return self.numbers.delay

    @property
    def encoder_bits(self) -> int:
        """Resolution of the encoders."""
        return self.numbers.encoder_bits

    @property
    def effort_known(self) -> bool:
        """Whether the controller knows the torque limits of the motors."""
        return self.numbers.effort_known

    @property
    def q0(self) -> Array:
        """Where the arm starts, at rest [rad or m], (n,)."""
        return self.move.start

    @property
    def plant(self) -> Plant:
        """The simulated arm of this scenario, with its drives, sensors, payload and disturbances."""
        return stack_draws([self]).plant

    @property
    def reference(self) -> Reference:
        """The motion of this scenario."""
        return stack_draws([self]).reference

    @property
    def context(self) -> Context:
        """What the controller knows of the arm, its sensors and the sample time."""
        return stack_draws([self]).context


class ScenarioBatch(NamedTuple):
    """Scenarios that run as one batch, or a single one.

    Attributes:
        plant: the simulated arms.
        reference: their motions.
        context: what the controllers know; it has the nominal models.
        t_final: how long [s].
    """

    plant: Plant
    reference: Reference
    context: Context
    t_final: float


@with_parameters
class Reality(Parametrised):
    """An uncertainty model: distributions of arms, drives, sensors, payloads and moves, which give scenarios.

    "geared" has rotor inertia and friction at every joint; "bare" has neither, as a URDF that contains
    nothing about the drives. The joints of both are stiff, and known to be.

    Three models have rotors with the scatter of published drives (:mod:`armgpi.robot.rotors`), torque ripple,
    and current loops. "undriven" has stiff joints, and a controller that has the bare file, whose drives it
    assumes. "elastic" has elastic joints, and a controller that knows the rotors and the side of the
    encoders, and assumes the stiffness. "owned" has all at once, as an arm that somebody has: a bare
    file, elastic joints, and encoders at the motors.

    Ranges are uniform. Coulomb friction, torque steps and efforts are in shares of the arm's own gravity
    torque and effort (:func:`scales`), rotor inertia in shares of its inertia.
    """

    name: str = parameter(
        "what the drives are, and what is known of them",
        kind="choice",
        default="geared",
        choices=("geared", "bare", "undriven", "elastic", "owned"),
    )
    seed: int = parameter("of all scenarios", kind="integer", default=0, least=0)
    block: int = parameter(
        "scenarios in a row with the same sample time and delay, which then run as one batch",
        kind="integer",
        default=8,
        least=1,
    )
    sample_time: Array = parameter(
        "sample times to choose from", unit="s", kind="numbers", default=(0.0005, 0.001, 0.002, 0.004)
    )
    delay: tuple[float, float] = parameter(
        "whole samples of delay", kind="range", default=(1.0, 3.0), least=0.0
    )
    encoder_bits: tuple[float, float] = parameter(
        "whole bits of the encoders", unit="bits", kind="range", default=(12.0, 20.0), least=1.0, most=52.0
    )
    rotor_share: float = parameter(
        "nominal rotor inertia over the joint's mean inertia", default=0.5, least=0.0, above=True
    )
    rotor_least: float = parameter(
        "what is added to it, over the mean inertia of the arm's largest joint", default=0.02, least=0.0
    )
    rotor_inertia: tuple[float, float] = parameter(
        "true over nominal rotor inertia", kind="range", default=(0.7, 1.3), least=0.0, above=True
    )
    rotor_common: float = parameter(
        "most of a common factor between true and assumed rotor inertia, either way", default=3.0, least=1.0
    )
    rotor_each: float = parameter("most of a factor joint by joint on top of it", default=1.5, least=1.0)
    mode: tuple[float, float] = parameter(
        "lowest mode of links, rotors and gears, motors free, at the middle of the ranges",
        unit="Hz",
        kind="range",
        default=(5.0, 25.0),
        least=0.0,
        above=True,
    )
    stiffness_each: float = parameter(
        "most of a factor joint by joint between stiffness and assumed rotor inertia", default=2.0, least=1.0
    )
    gear_damping: tuple[float, float] = parameter(
        "damping of the gears, as a ratio of each joint's own mode",
        kind="range",
        default=(0.01, 0.05),
        least=0.0,
    )
    motor_share: float = parameter(
        "share of scenarios whose encoders sit at the motors", default=0.5, least=0.0, most=1.0
    )
    current: tuple[float, float] = parameter(
        "bandwidth of the current loops", unit="Hz", kind="range", default=(300.0, 1000.0), least=1.0
    )
    cogging: tuple[float, float] = parameter(
        "amplitude of the cogging torque over gravity torque", kind="range", default=(0.0, 0.01), least=0.0
    )
    gear_ratio: tuple[float, float] = parameter(
        "turns of a motor in one of its joint; where the side of the encoders is known, those at the motors "
        "are finer by it, and the controller assumes 100",
        kind="range",
        default=(30.0, 160.0),
        least=0.0,
        above=True,
    )
    side_known: float = parameter(
        "share of undriven and owned scenarios whose controller knows the encoders' side",
        default=0.0,
        least=0.0,
        most=1.0,
    )
    payload: tuple[float, float] = parameter(
        "unknown payload over the mass of the arm", kind="range", default=(0.0, 0.05), least=0.0
    )
    payload_place: float = parameter(
        "farthest that its centre is from the tip, along each axis", unit="m", default=0.0, least=0.0
    )
    inertia_scale: tuple[float, float] = parameter(
        "nominal over modelled inertia matrix", kind="range", default=(0.8, 1.2), least=0.0, above=True
    )
    friction_share: float = parameter("share of scenarios with friction", default=0.7, least=0.0, most=1.0)
    coulomb: tuple[float, float] = parameter(
        "Coulomb friction over gravity torque", kind="range", default=(0.0, 0.1), least=0.0
    )
    viscous: tuple[float, float] = parameter(
        "viscous over Coulomb friction", unit="s/rad", kind="range", default=(0.0, 0.3), least=0.0
    )
    effort_share: float = parameter(
        "share of scenarios with other torque limits than the arm's", default=0.5, least=0.0, most=1.0
    )
    effort: tuple[float, float] = parameter(
        "those limits over the arm's; more where gravity asks for it",
        kind="range",
        default=(0.15, 0.6),
        least=0.0,
        above=True,
    )
    effort_gravity: float = parameter(
        "those limits are at least so many times gravity on the way", default=1.15, least=1.0
    )
    effort_spare: float = parameter(
        "and so much of the arm's effort on top", default=0.05, least=0.0, above=True
    )
    effort_known: float = parameter(
        "share of them that the controller knows", default=0.5, least=0.0, most=1.0
    )
    step_share: float = parameter("share of scenarios with a torque step", default=0.6, least=0.0, most=1.0)
    torque_step: tuple[float, float] = parameter(
        "torque step over gravity torque", kind="range", default=(-0.2, 0.2)
    )
    step_time: tuple[float, float] = parameter(
        "from when to when it acts", unit="s", kind="range", default=(3.2, 3.9), least=0.0
    )
    distance: tuple[float, float] = parameter(
        "size of the move, times a number from -1 to 1 per joint",
        unit="rad or m",
        kind="range",
        default=(0.2, 1.0),
        least=0.0,
    )
    gravity_share: float = parameter(
        "most that gravity may take of the effort on the way", default=0.6, least=0.0, above=True
    )
    speed: tuple[float, float] = parameter(
        "duration of the move over the shortest that velocity limits allow",
        kind="range",
        default=(1.0, 4.0),
        least=0.0,
        above=True,
    )
    duration: tuple[float, float] = parameter(
        "bounds of that duration", unit="s", kind="range", default=(0.15, 2.5), least=0.0, above=True
    )
    begin: float = parameter("when the move begins", unit="s", default=0.3, least=0.0)
    t_final: float = parameter("how long an experiment is", unit="s", default=6.0, least=0.0, above=True)

    def __post_init__(self) -> None:
        """Check the distributions.

        Raises:
            ParameterError: when one is not as declared; it says how it has to be.
            ArrayError: when it holds no numbers.
        """
        super().__post_init__()
        if self.sample_time.ndim != 1 or not self.sample_time.size or not (self.sample_time >= 1e-9).all():
            raise ParameterError("sample_time", self.sample_time, "a list of positive sample times [s]")
        for name in ("delay", "encoder_bits"):
            if any(end != round(end) for end in getattr(self, name)):
                raise ParameterError(name, getattr(self, name), "[lowest, highest], whole numbers")
        if self.t_final < (end := self.begin + self.duration[1]):
            raise ParameterError("t_final", self.t_final, f"at least {end:g} s, when the longest move ends")

    @classmethod
    def geared(cls, seed: int = 0, **changes: Any) -> Reality:
        """Return the reality of geared drives, by its seed; `changes` are parameters by their names.

        Args:
            seed: the same seed gives the same scenarios.
            **changes: parameters that differ from those of the model, by their names.

        Raises:
            ParameterError: when a value is not as declared.
        """
        return cls("geared", seed, **changes)

    @classmethod
    def bare(cls, seed: int = 0, **changes: Any) -> Reality:
        """Return the reality of arms without rotor inertia and friction; arguments as of :meth:`geared`.

        Args:
            seed: as of :meth:`geared`.
            **changes: as of :meth:`geared`.
        """
        return cls("bare", seed, **changes)

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return self.values()

    def numbers(self, n: int, index: int) -> Numbers:
        """Return what draw `index` of an arm with `n` joints is, in shares of the arm's own scales.

        Args:
            n: number of joints.
            index: which scenario, from 0.

        Raises:
            ParameterError: when the index is no whole number, or below 0.
        """
        index = check_whole(index, "index", 0, 2**40)
        block = index // self.block * self.block
        has_friction = self._chance(index, "has_friction", self.friction_share) and self.name != "bare"
        has_effort = self._chance(index, "has_effort", self.effort_share)
        known = not has_effort or self._chance(index, "effort_known", self.effort_known)
        has_step = self._chance(index, "has_step", self.step_share)
        choice = int(self._random(block, "sample_time")[0] * self.sample_time.size)
        rotor = self._uniform(index, "rotor_inertia", n)
        if self.name in _SCATTERED:
            rotor = self._factors(index, "rotor_common") * self._factors(index, "rotor_each", n)
        return Numbers(
            sample_time=float(self.sample_time[choice]),
            delay=self._whole(block, "delay"),
            encoder_bits=self._whole(index, "encoder_bits"),
            rotor_inertia=rotor,
            payload=float(self._uniform(index, "payload")[0]),
            payload_place=self.payload_place * (2.0 * self._random(index, "payload_place", 3) - 1.0),
            inertia_scale=float(self._uniform(index, "inertia_scale")[0]),
            coulomb=self._uniform(index, "coulomb", n) * has_friction,
            viscous=self._uniform(index, "viscous", n),
            effort=float(self._uniform(index, "effort")[0]) if has_effort else math.inf,
            effort_known=known,
            torque_step=self._uniform(index, "torque_step", n) * has_step,
            mode=_RIGID if self.name == "undriven" else float(self._uniform(index, "mode")[0]),
            stiffness_share=self._factors(index, "stiffness_share", n),
            gear_damping=float(self._uniform(index, "gear_damping")[0]),
            at_motor=self.name == "owned" or self._chance(block, "at_motor", self.motor_share),
            current=float(self._uniform(index, "current")[0]),
            cogging=self._uniform(index, "cogging", n),
            gear_ratio=float(self._uniform(block, "gear_ratio")[0]),
            side_known=self.name == "elastic" or self._chance(block, "side_known", self.side_known),
        )

    def draw(self, robot: Robot, index: int) -> Scenario:
        """Return scenario `index` of an arm.

        Args:
            robot: the arm as its URDF has it. Rotor inertia that it has is the nominal one.
            index: which; the same seed and index are the same scenario.

        Raises:
            ParameterError: when the index is no whole number, or below 0, or the robot no single one.
        """
        if not isinstance(robot, Robot):
            raise ParameterError("robot", robot, "a Robot")
        drawn = self.numbers(robot.n, index)
        scale = scales(robot)
        if self.name in _SCATTERED:
            # What is known of it in every draw: assumed drives, and the encoders' side.
            robot = rotors.assume_drives(robot)
            if drawn.side_known:
                sides = Drives(robot.joint_names).with_value("encoder_side", _side(drawn))
                robot = robot.with_drives(sides)
        nominal_rotors = np.where(robot.armature > 0.0, robot.armature, self._nominal_rotors(scale))
        model, arm = self._with_rotors(robot, nominal_rotors, drawn)
        friction = None
        if self.name != "bare":
            coulomb = drawn.coulomb * scale.gravity
            friction = Friction(drawn.viscous * coulomb, coulomb)
        arm = arm.with_payload(robot.tip, drawn.payload * scale.mass, drawn.payload_place)
        gears = None
        if self.name in _SCATTERED:
            gears = _gears(arm, nominal_rotors, drawn, scale)
        move, gravity = self._move(arm, scale, index)
        effort = np.minimum(robot.limits.effort, LARGEST)  # infinite: none
        if math.isfinite(drawn.effort):
            least = self.effort_gravity * gravity + self.effort_spare * scale.effort
            effort = np.minimum(np.maximum(least, drawn.effort * scale.effort), effort)
            if drawn.effort_known:
                model = model.with_limits(effort=effort)
        return Scenario(
            index,
            drawn,
            model=model,
            nominal=model.scaled_inertia(drawn.inertia_scale),
            arm=arm,
            friction=friction,
            effort=effort,
            scale=scale.effort,
            torque_step=drawn.torque_step * scale.gravity,
            step_time=self.step_time,
            move=move,
            t_final=self.t_final,
            robot=robot,
            gears=gears,
        )

    def _with_rotors(self, robot: Robot, nominal: Array, drawn: Numbers) -> tuple[Robot, Robot]:
        """Return the arm as its maker knows it, and as it is in a draw, both without payload.

        Args:
            robot: the arm, with what is known of its drives.
            nominal: rotor inertia that a draw scales [kg m^2 or kg], (n,).
            drawn: the numbers of the draw.
        """
        if self.name == "bare":
            return robot, robot
        arm = robot.with_armature(drawn.rotor_inertia * nominal)
        if self.name == "geared":
            return robot.with_armature(nominal), arm
        # Elastic arms of this model are known but for their payload; of others the drives are assumed.
        model = arm if self.name == "elastic" else robot
        return model, _with_gear_ratio(arm, drawn)

    def _nominal_rotors(self, scale: Scales) -> Array:
        """Return rotor inertia in shares of the arm's own [kg m^2 or kg], (n,)."""
        return np.asarray(self.rotor_share * scale.inertia + self.rotor_least * scale.inertia.max())

    def _move(self, arm: Robot, scale: Scales, index: int) -> tuple[Move, Array]:
        """Return a move and the largest gravity torque on its way, (n,).

        It is the first of some that the motors can hold the arm on; the one that asks least of them, if none.
        """
        lower, upper = arm.limits.lower, arm.limits.upper
        # A turn around the middle of each joint's range, within its limits.
        low = np.clip(arm.middle() - math.pi, lower, upper)
        high = np.clip(arm.middle() + math.pi, lower, upper)
        # Some moves, (moves, n).
        shape = (_MOVES, arm.n)
        configurations = self._random(index, "configuration", _MOVES * arm.n).reshape(shape)
        directions = 2.0 * self._random(index, "direction", _MOVES * arm.n).reshape(shape) - 1.0
        distances = self._uniform(index, "distance", _MOVES)[:, None]
        start = low + (high - low) * configurations
        goal = np.clip(start + distances * directions, lower, upper)
        # Gravity on the way of each, (points, moves, n), and its largest torque.
        share = np.linspace(0.0, 1.0, _ON_THE_WAY)[:, None, None]
        passed = start + share * (goal - start)
        torques = np.abs(arm.gravity(passed.reshape(-1, arm.n))).reshape(passed.shape)
        gravity = torques.max(axis=0)
        worst = (gravity / scale.effort).max(axis=1)
        can_be_held = worst <= self.gravity_share
        best = int(can_be_held.argmax() if can_be_held.any() else worst.argmin())
        limit = arm.limits.velocity
        has_limit = np.isfinite(limit) & (limit > _LEAST_SPEED)
        shortest = minimum_duration(goal[best] - start[best], np.where(has_limit, limit, _SPEED))
        duration = float(np.clip(shortest * self._uniform(index, "speed")[0], *self.duration))
        return Move(start[best], goal[best], self.begin, duration), gravity[best]

    def _random(self, index: int, quantity: str, count: int = 1) -> Array:
        """Return numbers uniform in (0, 1) for a quantity of a draw."""
        k = index * _MOST_QUANTITIES + _QUANTITIES.index(quantity)
        return noise.uniform(self.seed, k, (count,))

    def _uniform(self, index: int, quantity: str, count: int = 1) -> Array:
        """Return numbers uniform in a quantity's range."""
        low, high = getattr(self, quantity)
        return np.asarray(low + (high - low) * self._random(index, quantity, count))

    def _factors(self, index: int, quantity: str, count: int = 1) -> Array:
        """Return factors whose logarithms are uniform, from one over a quantity to itself."""
        most = self.stiffness_each if quantity == "stiffness_share" else getattr(self, quantity)
        return np.asarray(most ** (2.0 * self._random(index, quantity, count) - 1.0))

    def _whole(self, index: int, quantity: str) -> int:
        """Return a whole number in a quantity's range, its ends included."""
        low, high = getattr(self, quantity)
        return int(low + math.floor((high - low + 1.0) * self._random(index, quantity)[0]))

    def _chance(self, index: int, quantity: str, share: float) -> bool:
        """Tell whether something is so in a draw that is so in a share of them."""
        return bool(self._random(index, quantity)[0] < share)


def stack_draws(draws: Sequence[Scenario]) -> ScenarioBatch:
    """Return draws of one arm as one batch; a single one is no batch.

    Raises:
        ParameterError: when there are none, or their sample times, delays or lengths differ.
    """
    alike = {(*_batch(draw), draw.t_final, draw.step_time) for draw in draws}
    if len(alike) != 1:
        raise ParameterError("draws", len(draws), "scenarios of the same sample time, delay and length")
    first = draws[0]
    arm, model, nominal = _robots(draws)
    step = Step(_stack_draws(draws, "torque_step"), *first.step_time)
    frictions = [draw.friction for draw in draws if draw.friction is not None]
    friction = None
    if frictions:
        viscous = _rows([each.viscous for each in frictions])
        coulomb = _rows([each.coulomb for each in frictions])
        friction = Friction(viscous, coulomb)
    gears = [draw.gears for draw in draws if draw.gears is not None]
    inner: Plant = RigidBodyPlant(arm, step, friction)
    if gears:  # the encoders' side is that of the arm's drives
        inner = ElasticPlant(
            arm,
            step,
            friction,
            gear_stiffness=_rows([each.stiffness for each in gears]),
            gear_damping=_rows([each.damping for each in gears]),
            current_bandwidth=_rows([each.current for each in gears]),
            cogging=_rows([each.cogging for each in gears]),
        )
    plant: Plant = Saturated(inner, _stack_draws(draws, "effort"))
    moves = [draw.move for draw in draws]
    # A single draw has numbers; draws of a batch have columns (batch, 1).
    bits: Any = first.encoder_bits
    durations: Any = moves[0].duration
    if len(draws) > 1:
        bits = np.array([[float(draw.encoder_bits)] for draw in draws])
        durations = np.array([[move.duration] for move in moves])
    plant = Delayed(Encoder(plant, bits), first.delay)
    points = [_rows([move.start for move in moves]), _rows([move.goal for move in moves])]
    reference: Reference = Waypoints(points, [durations], [moves[0].begin, 0.0])
    context = Context(model, first.dt, 0, first.delay * first.dt, bits, nominal)  # type: ignore[arg-type]
    return ScenarioBatch(plant, reference, context, first.t_final)


def batches(draws: Sequence[Scenario]) -> list[list[Scenario]]:
    """Return draws in groups that may run together."""
    groups: Mapping[Any, list[Scenario]] = {_batch(draw): [] for draw in draws}
    for draw in draws:
        groups[_batch(draw)].append(draw)
    return list(groups.values())


def _batch(draw: Scenario) -> tuple[float, int, str, float]:
    """Return what draws of one batch have in common; the gear ratio where encoders are finer by it."""
    side = draw.gears.side if draw.gears else ""
    finer = draw.gears is not None and draw.numbers.side_known and side == "motor"
    return draw.dt, draw.delay, side, draw.numbers.gear_ratio if finer else 0.0


def _with_gear_ratio(arm: Robot, drawn: Numbers) -> Robot:
    """Return an arm whose motors have the gear ratio of a draw, where the side of its encoders is known."""
    if not drawn.side_known:
        return arm
    return arm.with_drives(Drives(arm.joint_names).with_value("gear_ratio", drawn.gear_ratio))


def _side(drawn: Numbers) -> str:
    """Return where the encoders sit."""
    return "motor" if drawn.at_motor else "link"


def _gears(arm: Robot, rotor: Array, drawn: Numbers, scale: Scales) -> Gears:
    """Return the gears of an arm: stiffness as the rotors, as both grow with a motor, scaled by the mode."""
    links = arm.mass_matrix(arm.middle()) - np.diag(arm.armature)
    stiffness = drawn.stiffness_share * rotor
    stiffness = stiffness * (drawn.mode / rotors.lowest_mode(links, arm.armature, stiffness)) ** 2
    own = stiffness * np.diag(links) * arm.armature / (np.diag(links) + arm.armature)
    current = np.full(arm.n, drawn.current)
    damping = 2.0 * drawn.gear_damping * np.sqrt(own)
    return Gears(stiffness, damping, current, drawn.cogging * scale.gravity, _side(drawn))


def _robots(draws: Sequence[Scenario]) -> tuple[AnyRobot, AnyRobot, AnyRobot]:
    """Return what the arms of draws really are, as their makers know them, and the nominal models."""
    first = draws[0]
    if len(draws) == 1:
        return first.arm, first.model, first.nominal

    def vary(name: str, **more: Any) -> AnyRobot:
        robots = [getattr(draw, name) for draw in draws]
        if name == "arm" or not rotors.assumed_joints(first.model):  # what is assumed stays so
            more["rotor_inertia"] = np.stack([robot.armature for robot in robots])
        base = _with_gear_ratio(first.robot, first.numbers) if name == "arm" and first.gears else first.robot
        return base.varied(effort=np.stack([robot.limits.effort for robot in robots]), **more)

    mass = scales(first.robot).mass
    payload = np.array([draw.numbers.payload * mass for draw in draws])
    com = np.stack([draw.numbers.payload_place for draw in draws])
    scale = np.array([draw.numbers.inertia_scale for draw in draws])
    arm = vary("arm", payload=payload, com=com)
    return arm, vary("model"), vary("nominal", inertia_scale=scale)


def _stack_draws(draws: Sequence[Scenario], name: str) -> Array:
    """Return an array of each draw, (n,) or (batch, n)."""
    return _rows([getattr(draw, name) for draw in draws])


def _rows(rows: Sequence[Array]) -> Array:
    """Return rows of a batch, or a single one as it is."""
    return rows[0] if len(rows) == 1 else np.stack(rows)
