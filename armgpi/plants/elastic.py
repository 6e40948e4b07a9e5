"""An arm whose joints are elastic: a rotor turns, and its link follows through a spring and a damper."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, new
from armgpi.base.parameter import PerJoint, parameter, same, with_parameters
from armgpi.control.controller import FullState
from armgpi.errors import ParameterError
from armgpi.plants.arm import Arm
from armgpi.plants.friction import STICK_VELOCITY, Braked, ImplicitFriction, solve
from armgpi.plants.plant import PlantState
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.robot.equations import Friction
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Share of a step in each stage of ROS2 that makes it L-stable (Verwer, Spee, Blom, Hundsdorfer 1999).
_GAMMA = 1.0 - math.sqrt(0.5)
#: What replaces a current loop of which nothing is known: it is at once [Hz].
_AT_ONCE = 1e6
#: Damping of gears of which nothing is known, as a ratio of each joint's own mode: 1 to 5 % are usual.
_RATIO = 0.03
#: Steps in which links sink to their balance, at most: of what is left, each leaves the share dG/dq / K.
_SINKING = 8
#: A rollout is in balance when a step moved no link by more than this [rad or m]: the next one would move it
#: by a hundredth, which is below the rounding of a position.
_BALANCED = 1e-14
#: Configurations over which the sag is taken.
_CONFIGURATIONS = 200


class ElasticState(NamedTuple):
    """State of an arm with elastic joints, each but k of shape (n,) or (batch, n).

    Attributes:
        k: number of steps taken.
        q: positions of the links [rad or m].
        v: velocities of the links [rad/s or m/s].
        theta: positions of the motors, as seen at the joint [rad or m].
        omega: velocities of the motors, likewise [rad/s or m/s].
        motor: torque of the motors at the end of the last step [N m or N].
        tau: torque that they were asked for in the last step [N m or N].
    """

    k: int
    q: Array
    v: Array
    theta: Array
    omega: Array
    motor: Array
    tau: Array


class _Motion(NamedTuple):
    """Positions and velocities of links and motors, or their changes over a step."""

    q: Array
    v: Array
    theta: Array
    omega: Array


class _Implicit(NamedTuple):
    """What both stages of a step of ROS2 solve with.

    Attributes:
        matrix: inertia of the links, with what springs and dampers hold to them [kg m^2 or kg], (n, n) or
            (batch, n, n).
        stretched: gamma h K, by which a stage's velocity acts as a torque [N m s/rad or N s/m], (n,).
        tied: gamma h (gamma h K + B), what holds a link to its rotor [kg m^2 or kg], (n,).
        heavier: a rotor with what holds it [kg m^2 or kg], (n,).
        share: of the torque on a rotor that reaches its link [-], (n,).
    """

    matrix: Array
    stretched: Array
    tied: Array
    heavier: Array
    share: Array


@with_parameters
class ElasticPlant(Arm):
    """M a + C v + G = S - tau_d - friction of the link, J omega' = motor - S - friction of the motor.

    S = K (theta - q) + B (omega - v) is the torque of the gear; M has no rotors, J is the robot's rotor
    inertia. The motor's torque follows the one asked for by a current loop of first order; ripple and cogging
    go with sin(2 pi theta / period). Values that are not given are those of ``robot.drives``.

    Each substep is one of ROS2 with the inertia of its middle, order 2; spring and damper are implicit, so it
    is stable for any stiffness and lightness, and modes that turn by more than a radian a substep are damped.
    The motor's torque is its mean over the substep. Friction, of which `friction` is the motors', follows
    through the springs as in :class:`armgpi.RigidBodyPlant`.

    Attributes:
        gear_stiffness: K [N m/rad or N/m], shape (n,) or (batch, n).
        gear_damping: B [N m s/rad or N s/m], likewise; 3 % of the critical damping of each joint's own
            mode where it is not specified.
        current_bandwidth: of the current loops [Hz], likewise.
        encoder_side: where the encoders sit, "motor" or "link"; None for that of the drives, or the motor.
        link_viscous: viscous friction at the links [N m s/rad or N s/m], likewise.
        link_coulomb: Coulomb friction at the links [N m or N], likewise.
        torque_ripple: amplitude of the torque's ripple over the torque [-], likewise.
        cogging: amplitude of a ripple that there is without torque [N m or N], likewise.
        ripple_period: way of the joint in a period of both [rad or m], likewise.
        stick_velocity: speed below which Coulomb friction is smoothed [rad/s or m/s].
    """

    config_name: ClassVar[str | None] = "elastic"
    feels: ClassVar[tuple[str, ...]] = ("loads", "friction", "environment")

    gear_stiffness: PerJoint = parameter(
        "stiffness of the gears",
        unit="N m/rad or N/m",
        default=None,
        none="that of the drives",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
    )
    gear_damping: PerJoint = parameter(
        "damping of the gears",
        unit="N m s/rad or N s/m",
        default=None,
        none="that of the drives, else 3 % of each joint's own mode",
        least=0.0,
        per_joint=True,
    )
    current_bandwidth: PerJoint = parameter(
        "bandwidth of the current loops",
        unit="Hz",
        default=None,
        none="that of the drives, else at once",
        least=1e-3,
        per_joint=True,
        log=True,
    )
    encoder_side: str | None = parameter(
        "where the encoders sit",
        kind="choice",
        choices=("motor", "link"),
        default=None,
        none="as the drives specify, else at the motor",
    )
    link_viscous: PerJoint = parameter(
        "viscous friction at the links", unit="N m s/rad or N s/m", default=0.0, least=0.0, per_joint=True
    )
    link_coulomb: PerJoint = parameter(
        "Coulomb friction at the links", unit="N m or N", default=0.0, least=0.0, per_joint=True
    )
    torque_ripple: PerJoint = parameter(
        "amplitude of the torque ripple, as a share of the torque", default=0.0, least=0.0, per_joint=True
    )
    cogging: PerJoint = parameter(
        "amplitude of the cogging torque", unit="N m or N", default=0.0, least=0.0, per_joint=True
    )
    ripple_period: PerJoint = parameter(
        "motion of the joint in one period of ripple and cogging",
        unit="rad or m",
        default=math.pi / 100.0,
        least=0.0,
        above=True,
        per_joint=True,
    )
    stick_velocity: float = same(RigidBodyPlant, "stick_velocity", default=STICK_VELOCITY)

    def __post_init__(self) -> None:
        """Check what is given, and take the rest from the drives; see :class:`armgpi.plants.arm.Arm`.

        Raises:
            ParameterError: for a gear whose stiffness nobody tells, or a joint without rotor inertia.
        """
        super().__post_init__()
        drives, rotor = self.robot.drives, self.robot.armature
        self.fill("gear_stiffness", drives.value("stiffness"))
        self._check_positive("gear_stiffness", self.gear_stiffness)
        self._check_positive("rotor_inertia", rotor)
        arm = self.robot if isinstance(self.robot, Robot) else self.robot.first
        link = np.diag(arm.mass_matrix(arm.middle())) - arm.armature
        mode = link * rotor / (link + rotor)  # the inertia of the mode of each link and rotor alone
        usual = 2.0 * _RATIO * np.sqrt(self.gear_stiffness * mode)
        damping = drives.value("damping")
        self.fill("gear_damping", np.where(np.isnan(damping), usual, damping))
        self.fill("current_bandwidth", drives.value("current_bandwidth", _AT_ONCE))
        sides = drives.value("encoder_side")
        if self.encoder_side is not None:
            sides = np.full(self.robot.n, self.encoder_side)
        self._at_motor = (sides != "link").astype(np.float64)  # numbers, as which of them is code for both
        self._rotor = rotor
        self._rate = 2.0 * math.pi * self.current_bandwidth
        self._wave = 2.0 * math.pi / self.ripple_period
        self._ripples = _acts(self.torque_ripple) or _acts(self.cogging)
        # Links and motors in one row, (2 n,) or (batch, 2 n).
        motor_viscous, motor_coulomb = self.friction or (0.0, 0.0)

        def of_both(link: Any, motor: Any) -> Array:
            link, motor, _ = np.broadcast_arrays(link, motor, rotor)
            return np.concatenate([link, motor], axis=-1)

        self._friction_of_both = Friction(
            of_both(self.link_viscous, motor_viscous), of_both(self.link_coulomb, motor_coulomb)
        )
        self._rubs = any(map(_acts, self._friction_of_both))
        sticks = _acts(self.link_coulomb), _acts(np.asarray(motor_coulomb))
        self._brake = ImplicitFriction(sticks, _brake_elastic)

    def _check_positive(self, name: str, value: Array) -> None:
        """Refuse what a joint lacks."""
        for i, joint in enumerate(self.robot.joint_names):
            if not (value[..., i] > 0.0).all():
                unit = "[N m/rad or N/m]" if name == "gear_stiffness" else "[kg m^2 or kg]"
                expected = f"positive {unit}: specify it here or in the robot's drives (--drives FILE)"
                raise ParameterError(f"{joint}.{name}", None, expected)

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data, and where each encoder sits."""
        sides = np.where(self._at_motor > 0.5, "motor", "link")
        return {**super().describe(), "encoder_side": sides.tolist()}

    @property
    def sag(self) -> str:
        """Tool deflection under gravity that the encoders do not measure, in a line; or nothing."""
        if not isinstance(self.robot, Robot) or self.gear_stiffness.ndim != 1:
            return ""
        return sag(self.robot, self.gear_stiffness, self._at_motor > 0.5)

    def static_deflection(self, q: Array) -> float:
        """Return how far gravity moves the tool of a single arm at rest while its encoders stay at `q` [mm].

        Args:
            q: positions at the encoders [rad or m], (n,).

        Returns:
            The distance, NaN for arms of a batch; 0 where all encoders sit at the links.
        """
        if not isinstance(self.robot, Robot) or self.gear_stiffness.ndim != 1:
            return math.nan
        link = self.init(q, np.zeros_like(q)).q
        frame = self.metrics_frame or self.robot.tip
        there, here = (self.robot.frame_pose(frame, x).translation for x in (q, link))
        return 1e3 * float(np.linalg.norm(there - here))

    def init(self, q: Array, v: Array) -> ElasticState:  # type: ignore[override]
        """Return the state at time 0, in balance with gravity; see :meth:`Plant.init`.

        Positions are those of the encoders: if these are at the motors, the links are deflected by gravity.
        """
        self.check_start(q)
        link, gravity = q, self.robot.dynamics.gravity(q)
        for _ in range(_SINKING):
            sunk = np.where(self._at_motor > 0.5, q - gravity / self.gear_stiffness, q)
            moves = (abs(sunk - link) > _BALANCED).any(axis=-1, keepdims=True)
            if not moves.any():
                break
            # A rollout in balance keeps its numbers, so that they do not depend on its neighbours.
            link = np.where(moves, sunk, link)
            gravity = self.robot.dynamics.gravity(link)
        theta = np.where(self._at_motor > 0.5, q, q + gravity / self.gear_stiffness)
        return ElasticState(0, link, v, theta, v, gravity, np.zeros_like(q))

    def measure(self, state: ElasticState) -> FullState:  # type: ignore[override]
        """Return positions and velocities where the encoders sit; see :meth:`Plant.measure`."""
        at_motor = self._at_motor > 0.5
        q = np.where(at_motor, state.theta, state.q)
        v = np.where(at_motor, state.omega, state.v)
        return new(FullState, (q, v))

    def true_state(self, state: ElasticState) -> PlantState:  # type: ignore[override]
        """Return the state of the links, and the torque that was requested of the motors."""
        return new(PlantState, (state.k, state.q, state.v, state.tau))

    def step(self, tau: Array, state: ElasticState, dt: float) -> ElasticState:
        """Return the state after `tau` was asked for during `dt`; see :meth:`Plant.step`."""
        k, motor = state.k, state.motor
        x = _Motion(*state[1:5])
        h = dt / self.substeps
        turned = h * self._rate
        left = np.exp(-turned)
        for i in range(self.substeps):
            begin, _, end = self.acting_torques(0.0, k, i, dt)
            missing = motor - tau
            motor = tau + left * missing
            mean_motor = tau + (1.0 - left) / turned * missing
            touched = partial(self.contact_torque, k=k, dt=dt)
            x = self._substep(x, mean_motor, begin, end, h, touched, i)
        return new(ElasticState, (k + 1, *x, motor, tau))

    def _substep(
        self,
        x: _Motion,
        motor: Array,
        begin: Any,
        end: Any,
        h: float,
        touched: Callable[..., Any],
        i: int,
    ) -> _Motion:
        """Return the state after a step of ROS2 and friction, under these torques of motors and loads.

        (1 - g A) k1 = F(x), (1 - g A) k2 = F(x + h k1) - 2 k1, and x becomes x + h (3 k1 + k2) / 2, where A
        is that of springs and dampers alone and g = gamma h. The motors' equations are eliminated by hand.
        """
        inertia = self.robot.dynamics.mass_matrix(x.q + (0.5 * h) * x.v)
        stage = partial(self._stage, motor, h, self._implicit(inertia, h))
        k1, forces = stage(x, begin + touched(x.q, x.v, substep=i), _NONE, _NONE)
        ahead = _ahead(x, h, k1)
        k2, _ = stage(ahead, end + touched(ahead.q, ahead.v, substep=i + 1.0), k1, forces)
        free = _ahead(_ahead(x, 1.5 * h, k1), 0.5 * h, k2)
        return self._apply_friction(x, free, inertia, h) if self._rubs else free

    def _implicit(self, inertia: Array, h: float) -> _Implicit:
        """Return what both stages of a step solve with, for an inertia matrix of links and rotors."""
        stretched = (_GAMMA * h) * self.gear_stiffness
        tied = (_GAMMA * h) * (stretched + self.gear_damping)
        heavier = self._rotor + tied
        matrix = _held_links(inertia, self._rotor, self._rotor, tied)
        return _Implicit(matrix, stretched, tied, heavier, tied / heavier)

    def _stage(
        self,
        motor: Array,
        h: float,
        implicit: _Implicit,
        y: _Motion,
        push: Any,
        before: _Motion,
        forces: _Motion,
    ) -> tuple[_Motion, _Motion]:
        """Return a stage k of a step, and it with forces in place of accelerations.

        Args:
            motor: torque of the motors, constant in the step [N m or N], (n,) or (batch, n).
            h: length of the step [s].
            implicit: what the step solves with.
            y: where the stage is.
            push: torque of loads and contacts on the links, likewise.
            before: the stage before; zero before the first.
            forces: likewise, with forces in place of accelerations.
        """
        stretched, tied, heavier, share = implicit.stretched, implicit.tied, implicit.heavier, implicit.share
        is_first = before is _NONE
        # Rates of the positions: q and theta stand for their derivatives from here on.
        q, theta = y.v, y.omega
        if not is_first:
            q = q - 2.0 * before.q
            theta = theta - 2.0 * before.theta
        gear = self.gear_stiffness * (y.theta - y.q) + self.gear_damping * (y.omega - y.v)
        gear = gear + stretched * (theta - q)
        link = gear - self.robot.dynamics.nonlinear_effects(y.q, y.v) + push
        rotor = motor - gear
        if not is_first:
            link = link - 2.0 * forces.v
            rotor = rotor - 2.0 * forces.omega
        if self._ripples:
            ripple = self.torque_ripple * motor + self.cogging
            rotor = rotor + ripple * np.sin(self._wave * y.theta)
        # The motors' equations, eliminated: a is of the links, alpha of the rotors.
        a = solve(implicit.matrix, (link + share * rotor)[..., None])
        alpha = (rotor + tied * a) / heavier
        passed = tied * (alpha - a)
        q = q + (_GAMMA * h) * a
        theta = theta + (_GAMMA * h) * alpha
        stage = _Motion(q, a, theta, alpha)
        return stage, _Motion(q, link + passed, theta, rotor - passed)

    def _apply_friction(self, before: _Motion, free: _Motion, inertia: Array, h: float) -> _Motion:
        """Return what friction of links and motors together leaves of a step without, from `before`."""
        n, rotor = self.robot.n, self._rotor
        tied = h * (0.5 * h * self.gear_stiffness + self.gear_damping)
        begin, v_free = (np.concatenate([x.v, x.omega], axis=-1) for x in (before, free))
        viscous, coulomb = self._friction_of_both
        left = self._brake(v_free, begin, viscous, coulomb, h, self.stick_velocity, inertia, rotor, tied)
        change = left - v_free
        dv, domega = change[..., :n], change[..., n:]
        half = 0.5 * h
        return _Motion(
            free.q + half * dv,
            free.v + dv,
            free.theta + half * domega,
            free.omega + domega,
        )


def _held_links(inertia: Array, own: Array, rotor: Array, tied: Array) -> Array:
    """Return the inertia [kg m^2 or kg] of links that springs and dampers hold to rotors in a step.

    Args:
        inertia: of links and rotors together, (n, n) or (batch, n, n).
        own: inertia of the rotors in it, (n,) or (batch, n).
        rotor: what each rotor resists with, its friction included, likewise.
        tied: what holds a link to its rotor, likewise.
    """
    matrix = inertia.copy()
    diagonal = np.arange(inertia.shape[-1])
    matrix[..., diagonal, diagonal] += tied * rotor / (rotor + tied) - own
    return matrix


def _brake_elastic(h: float, v_free: Array, inertia: Array, rotor: Array, tied: Array) -> Braked:
    """Return what solves for the velocities of links and motors; the motors' equations are eliminated.

    Args:
        h: length of the step [s].
        v_free: velocities of links, then of motors, without friction [rad/s or m/s], (2 n,) or (batch, 2 n).
        inertia: of links and rotors together [kg m^2 or kg], (n, n) or (batch, n, n).
        rotor: inertia of the rotors, (n,) or (batch, n).
        tied: what holds a link to its rotor in the step [kg m^2 or kg], likewise.
    """
    n = inertia.shape[-1]
    diagonal = np.arange(n)

    def braked(resistance: Array, push: Array) -> Array:
        impulse = -h * (resistance * v_free + push)
        heavier = rotor + h * resistance[..., n:]
        matrix = _held_links(inertia, rotor, heavier, tied)
        matrix[..., diagonal, diagonal] += h * resistance[..., :n]
        links = impulse[..., :n] + tied / (heavier + tied) * impulse[..., n:]
        dv = solve(matrix, links[..., None])
        domega = (impulse[..., n:] + tied * dv) / (heavier + tied)
        both: Array = v_free + np.concatenate([dv, domega], axis=-1)
        return both

    return braked


#: What is before the first stage.
_NONE = _Motion(0.0, 0.0, 0.0, 0.0)  # type: ignore[arg-type]


def _ahead(x: _Motion, h: float, rate: _Motion) -> _Motion:
    """Return x + h rate."""
    return _Motion(
        x.q + h * rate.q,
        x.v + h * rate.v,
        x.theta + h * rate.theta,
        x.omega + h * rate.omega,
    )


def _acts(value: Array) -> bool:
    """Tell whether something is there; what differs by rollout was declared to vary, whatever it is."""
    return bool(value.ndim == 2 or value.any())


def sag(robot: Robot, stiffness: Array | None = None, at_motor: Any = None) -> str:
    """Return in a line how far the tool sinks that encoders at motors hold in place; nothing if not known.

    It is |J G / K| of the tip, over joints with encoders at motors, at random configurations.

    Args:
        robot: the arm.
        stiffness: of its gears [N m/rad or N/m], (n,); that of its drives when not given.
        at_motor: which joints have encoders at motors, (n,); likewise.
    """
    stiffness = robot.drives.value("stiffness") if stiffness is None else stiffness
    at_motor = robot.drives.value("encoder_side") != "link" if at_motor is None else at_motor
    if np.isnan(stiffness).any() or not np.any(at_motor):
        return ""
    q = random_configurations(robot, _CONFIGURATIONS, seed=0)
    twist = np.where(at_motor, robot.gravity(q) / stiffness, 0.0)
    moved = robot.frame_jacobian(robot.tip, q)[:, :3] @ twist[..., None]
    sunk = 1e3 * np.linalg.norm(moved[..., 0], axis=-1)
    if not sunk.any():  # a robot that carries its weight by itself: its model has none
        return ""
    return (
        f"Deflection under gravity that motor encoders cannot measure: {np.median(sunk):.2g} mm median, "
        f"{sunk.max():.2g} mm largest (tool, {_CONFIGURATIONS} configurations)"
    )
