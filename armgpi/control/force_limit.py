"""A bound on the force that a controller presses with, from its own torque: no force sensor.

What a torque beyond the model's does at rest is a wrench at the tool: J' f is that torque, but for what
moves the arm without the tool. So f follows from the torque, its force and its moment are shortened to their
limits, and what is too much is taken away from the torque. Force and moment are not scaled together: a
torque about an axis through the tool is a moment without a force, and stays as it is where the force alone
is too much.

Of what is taken away the joints' friction is given back, so that the arm moves: shortened as a whole until no
joint has more than twice its friction, then cut to the friction of each.

Beyond the limit nothing holds the arm, so a speed limit belongs to it: the joints are damped as soon as the
tool is faster beside its reference than 0.4 of its speed limit; see ``armgpi.control.speed_brake``.

It bounds what the tool presses with at rest, and it is no safety function.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import (
    Array,
    ArrayLike,
    as_float_array,
    as_joint_array,
    check_number,
    check_type,
    new,
    not_negative,
    per_joint,
)
from armgpi.control.elastic_limits import LEAST_LINK, elastic_joints
from armgpi.control.speed_brake import FREE, SpeedBrake
from armgpi.errors import ArmgpiWarning, ArrayError, Finding, ParameterError
from armgpi.references.reference import Target
from armgpi.robot.frame_motion import DampedJacobian, FrameMotion, inner
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Lever of the moment limit that belongs to a force limit where none is given [m].
LEVER = 0.2
#: Acceleration of free fall [m/s^2].
FREE_FALL = 9.81
#: Speed of the tool beside the reference, where none is given [m/s]: the reduced speed of ISO 10218-1.
SPEED = 0.25
#: Coulomb friction of geared joints, as a share of the effort, where nobody knows it, and the factor within
#: which it is.
USUAL_FRICTION, USUAL_WITHIN = 0.03, 2.0
#: Factor within which a level of friction is that a file or a user gives: what identifications of the same
#: arm differ by between days and temperatures.
KNOWN_WITHIN = 1.2
#: Stiffness of what is hit, where none is given [N/m].
HIT = 1e4
#: Time constant of a change of the limit [s].
CHANGE = 0.1
#: Configurations over which forces are taken, of those that are drawn.
_CONFIGURATIONS, _DRAWN = 20, 60
#: Joints of which all combinations of signs are tried.
_MOST_SIGNS = 10
#: A torque is shortened as a whole until no joint has more than so many times its friction; then each is cut
#: to its own. With 1 one of 432 hands left an arm 11 mm off, as one joint kept the others from theirs.
_MOST_RUBBED = 2.0
#: Friction below this is none [N m or N]: a torque over it would be no number.
_NO_FRICTION = 1e-100
#: Share of the full damping below which the speed limit is said not to hold [-].
_WEAK = 0.25


class ForceBound(NamedTuple):
    """What a tool presses with, in numbers; a sum of worst cases, not a safety function.

    Attributes:
        limit: the force limit [N].
        friction: what the joints' Coulomb friction adds at the tool at most [N], the upper end of its
            interval; median over configurations away from singular ones, the worst direction of each.
        gravity: the weight that the model is uncertain by, or the force at the tool [N] of the gravity that a
            given arm has and the model does not, whichever is larger.
        total: the sum, which bounds the force at rest [N].
        speed: of an approach [m/s].
        wall: stiffness of what is hit [N/m].
        mass: what the tool weighs in motion [kg], median over configurations and directions.
        impact: peak force of the impact [N], without damping: F + sqrt(F^2 + k m v^2) with F the limit and
            the friction.
        push: force of a hand [N] up to which the tool keeps its speed limit, or which the motors can hold:
            the least over directions and configurations; NaN where nothing limits the speed.
        fastest: that speed limit [m/s].
        usual: whether it is of usual configurations, as none were given; near singular ones all is worse.
        assumed: whether the friction is that of usual geared joints, as the model has none.
        depth: how deep the target of a spring without a limit is behind what it presses on [m]; `limit` is
            the spring's force there. 0 for a force limit.
    """

    limit: float
    friction: float
    gravity: float
    total: float
    speed: float
    wall: float
    mass: float
    impact: float
    push: float = math.nan
    fastest: float = math.nan
    usual: bool = False
    assumed: bool = False
    depth: float = 0.0

    def __str__(self) -> str:
        """Return it in two or three lines."""
        pushed = friction = ""
        if self.assumed:
            share = 100.0 * USUAL_FRICTION * USUAL_WITHIN
            friction = f" (assumed: {share:g} % of the effort, as the model has none)"
        median, least = (
            (" (median of usual configurations)", " (the least of these)") if self.usual else ("", "")
        )
        if math.isfinite(self.push):
            pushed = (
                f"A hand that pushes with up to {self.push:.3g} N{least} moves it no faster than "
                f"{self.fastest:.3g} m/s relative to its reference.\n"
            )
        pressing = f"limit {self.limit:.3g} N"
        if self.depth:
            pressing = f"spring {self.limit:.3g} N, its target {1e3 * self.depth:.3g} mm deep"
        return (
            f"At rest the tool presses with at most {self.total:.3g} N{median}: {pressing}, "
            f"joint friction {self.friction:.3g} N{friction}, unknown weight {self.gravity:.3g} N.\n"
            f"{pushed}The impact is not bounded: at {self.speed:.3g} m/s on {self.wall / 1e3:.3g} kN/m it is "
            f"about {self.impact:.3g} N (the tool weighs {self.mass:.3g} kg in motion). "
            "This is no safety function."
        )


class LimitState(NamedTuple):
    """State of a force limit.

    Attributes:
        e: position error of the last sample [rad or m].
        rate: filtered difference of it [rad/s or m/s].
        force: the limit now [N], (1,) or (batch, 1).
        force_goal: the limit that it changes to, likewise.
    """

    e: Array
    rate: Array
    force: Array
    force_goal: Array


class Gentle(NamedTuple):
    """A torque under a force limit.

    Attributes:
        tau: what is applied [N m or N].
        told: what the controller takes for it, likewise: its integrators give way along what was taken away.
        state: of the limit.
    """

    tau: Array
    told: Array
    state: LimitState


class _Excess(NamedTuple):
    """What is too much of a torque.

    Attributes:
        torque: exactly 0 where nothing is [N m or N], (..., n).
        wrench: before friction, its force times the arm's length and its moment [N m], (..., 6).
        jacobian: of the tool.
    """

    torque: Array
    wrench: Array
    jacobian: DampedJacobian


class ForceLimit:
    """Shortens a torque to what presses with a force and a moment at most.

    Attributes:
        force: largest force [N].
        moment: largest moment [N m].
        friction: Coulomb friction that comes on top, as the arm has to move [N m or N].
        speed: of the tool beside its reference [m/s].
    """

    derived: ClassVar[Mapping[str, str]] = {
        **SpeedBrake.derived,
        "_change": "share of a change of the force limit that a sample makes [-]",
        "_per_friction": "one over what friction of the joints is compared with [1/(N m) or 1/N]",
    }

    def __init__(
        self,
        robot: Robot,
        frame: str | None,
        force: Any,
        moment: Any,
        friction: Array,
        speed: Any = SPEED,
        loop: tuple[float, float] = (1e-3, 0.0),
    ) -> None:
        """Find the tool.

        Args:
            robot: the arm.
            frame: that presses; the tip when not given.
            force: largest force [N].
            moment: largest moment about it [N m]; 0.2 m times the force when not given.
            friction: Coulomb friction of the joints [N m or N], (n,) or (batch, n).
            speed: of the tool beside its reference [m/s].
            loop: sample time and delay [s].

        Raises:
            NameNotFound: when there is no such frame.
            ParameterError: when no joint moves it.
        """
        self._motion = FrameMotion(robot, frame or robot.tip)
        self.force = force
        self.moment = LEVER * force if moment is None else moment
        self.friction = friction
        self._per_friction = _per_friction(friction, robot.limits.effort)
        self.speed = speed
        self._length = self._motion.reach(robot)
        self._brake = SpeedBrake(robot, *loop)
        self._change = -np.expm1(-loop[0] / CHANGE)

    def init(self, e: Array) -> LimitState:
        """Return the state before the first sample, at rest, from a position error."""
        force = 0.0 * e[..., :1] + self.force
        return LimitState(e, np.zeros_like(e), force, force)

    def changed(self, state: LimitState, limit: Any, weight: float) -> LimitState:
        """Return a state from which on the limit goes to another one, without a step of torque.

        Args:
            state: of the running limit.
            limit: largest force [N], a number or one a rollout, (batch, 1).
            weight: that the model is uncertain by [N].

        Raises:
            ParameterError: when it is not positive, or below that weight.
            ArrayError: when its shape does not fit.
        """
        value = as_float_array(limit, "limit")
        if not (value > 0.0).all():
            raise ParameterError("limit", value.tolist(), "positive [N]")
        check_weight(value, weight, "limit")
        return state._replace(force_goal=fitted(value, state.force_goal, "limit"))

    def gentle(
        self, q: Array, target: Target, parts: tuple[Array, Array], state: LimitState, dynamics: Any
    ) -> Gentle:
        """Return a torque that presses no more than the limits allow, and the next state.

        A joint controller that is told what was taken away gives way by D(q)^-1 of it, which turns the tool
        and moves it aside. It is told what moves the tool along the force, and turns it along the moment,
        that were too much: so a wall turns nothing.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
            target: what is asked for.
            parts: the torque that a controller asks for, and the model's share of it [N m or N], likewise.
            state: of the last sample.
            dynamics: of the arm: its inertia scales the damping.
        """
        asked, of_model = parts
        e = q - target.q
        after_rate = self._brake.rate(e, state.e, state.rate)
        force = limit_after(state.force, state.force_goal, self._change)
        much = self._excess(q, asked - of_model, force)
        motion = self._motion.at(q, after_rate)
        swift = inner(motion.velocity, motion.velocity)
        turning = LEVER * LEVER * inner(motion.rate, motion.rate)
        fastest = np.maximum(np.maximum(swift, turning), 1e-12)
        fast = np.sqrt(fastest) / self.speed
        brake = self._brake.torque(q, after_rate, fast, dynamics)
        given_way = self._given_way(much, dynamics.inertia_solve(q, much.torque))
        told = asked - dynamics.inertia_times(q, given_way)
        after = new(LimitState, (e, after_rate, force, state.force_goal))
        return new(Gentle, (asked - much.torque - brake, told, after))

    def _given_way(self, much: _Excess, acceleration: Array) -> Array:
        """Return the part of an acceleration of the joints that is along what was too much."""
        twist = np.matmul(much.jacobian.matrix, acceleration[..., None])[..., 0]
        linear, angular = slice(0, 3), slice(3, 6)
        moved = _along(twist[..., linear], much.wrench[..., linear])
        turned = _along(twist[..., angular], much.wrench[..., angular])
        along = np.concatenate([moved, turned], axis=-1)
        solved = np.linalg.solve(much.jacobian.square, along[..., None])
        given_way: Array = np.matmul(much.jacobian.transposed, solved)[..., 0]
        return given_way

    def excess(self, q: Array, torque: Array) -> Array:
        """Return what is too much of a torque; exactly 0 where nothing is.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
            torque: beyond the model's [N m or N], likewise.
        """
        return self._excess(q, torque, self.force).torque

    def _excess(self, q: Array, torque: Array, most: Any) -> _Excess:
        """Return what is too much of a torque beyond the model's, under a largest force [N]."""
        jacobian = self._motion.at(q, 0.0 * q).damped_jacobian(self._length)
        at_tool = np.matmul(jacobian.matrix, torque[..., None])
        wrench: Any = np.linalg.solve(jacobian.square, at_tool)[..., 0]
        force = wrench[..., 0:3]
        moment = wrench[..., 3:6]
        # The moment's limit changes with that of the force.
        largest_moment = self.moment * (most / self.force)
        too_much_force = _beyond(force, most * self._length)
        too_much_moment = _beyond(moment, largest_moment)
        much = np.concatenate([too_much_force, too_much_moment], axis=-1)
        taken = np.matmul(jacobian.transposed, much[..., None])[..., 0]
        beyond_friction: Array = taken - self._rubbed(taken)
        return new(_Excess, (beyond_friction, much, jacobian))

    def _rubbed(self, torque: Array) -> Array:
        """Return the share of a torque that joint friction holds: first shortened as a whole, then by joint.

        What is left then presses more nearly in the direction that was asked for. Each joint at its own
        friction is a wrench of any direction: behind a wall it turned the tool, and pressed aside.
        """
        used = np.abs(torque) * self._per_friction
        most = used[..., 0:1]
        for joint in range(1, used.shape[-1]):
            most = np.maximum(most, used[..., joint : joint + 1])
        shortened = torque / np.maximum(most, 1.0)
        rubbed: Array = np.minimum(np.maximum(shortened, -self.friction), self.friction)
        return rubbed

    def force_of(self, robot: Robot, torque: Array, configurations: Array | None = None) -> float:
        """Return the largest force at the tool [N] of torques within +- `torque` (n,).

        It is the median of some configurations away from singular ones, or the largest of given ones (k, n).
        """
        few = robot.n <= _MOST_SIGNS
        signs = np.array(list(product((-1.0, 1.0), repeat=robot.n))) if few else np.eye(robot.n)
        usual = configurations is None
        largest = []
        for q in self._usual(robot) if configurations is None else configurations:
            jacobian = self._motion.at(q, 0.0 * q).damped_jacobian(self._length)
            at_tool = jacobian.matrix @ (signs * torque).T
            forces = np.linalg.solve(jacobian.square, at_tool)[:3]
            if not few:  # the sum of all joints, which is not less than any combination of signs
                forces = np.abs(forces).sum(axis=1, keepdims=True)
            sizes = np.linalg.norm(forces, axis=0)
            largest.append(float(sizes.max()) / self._length)
        return float(np.median(largest) if usual else np.max(largest))

    def _usual(self, robot: Robot) -> Array:
        """Return configurations away from singular ones, where forces have no bounds: the best of some."""
        drawn = random_configurations(robot, _DRAWN, seed=0)
        jacobians = robot.frame_jacobian(self._motion.frame, drawn)
        jacobians[:, :3] /= self._length
        least = np.linalg.svd(jacobians, compute_uv=False)[:, -1]
        return np.asarray(drawn[np.argsort(-least)[:_CONFIGURATIONS]])

    def mass_of(self, robot: Robot) -> float:
        """Return what the tool weighs in motion [kg], the median of directions and some configurations."""
        masses = []
        for q in self._usual(robot):
            jacobian = robot.frame_jacobian(self._motion.frame, q)[:3]
            accelerations = np.linalg.solve(robot.mass_matrix(q), jacobian.T)
            mobility = np.linalg.eigvalsh(jacobian @ accelerations)
            moving = mobility[mobility > 1e-6 * mobility.max()]
            masses += (1.0 / moving).tolist()
        return float(np.median(masses))

    def bound(
        self,
        robot: Robot,
        friction: Any = None,
        weight: float = 0.0,
        speed: float | None = None,
        wall: float = HIT,
        configurations: ArrayLike | None = None,
        arm: Robot | None = None,
    ) -> ForceBound:
        """Return what the tool presses with at rest at most, and the impact at a speed beside it.

        Args:
            robot: the nominal model.
            friction: upper end of the joints' Coulomb friction [N m or N], (n,); 1.2 times that which the
                limit leaves to the joints when not given, or what is usual where there is none.
            weight: that the model is uncertain by [N].
            speed: of the approach [m/s]; the speed limit when not given.
            wall: stiffness of what is hit [N/m].
            configurations: where friction and pushes count [rad or m], (k, n): the worst of them; usual ones
                when not given.
            arm: what is really moved, such as the arm of a plant with another payload: the gravity that the
                model does not have counts. The model itself when not given.

        Raises:
            ParameterError: when speed, wall or friction is negative or no number, or `arm` is no robot with
                the joints of the model.
            ArrayError: when friction or configurations do not fit the joints.
        """
        names = robot.joint_names
        places, assumed = None, False
        if configurations is not None:
            places = np.atleast_2d(as_joint_array(configurations, "configurations", names))
            if not len(places):
                raise ParameterError("configurations", configurations, "one at least")
        if friction is None:
            level = np.atleast_2d(self.friction).max(axis=0)
            assumed = not level.any()
            level = USUAL_WITHIN * usual_friction(robot) if assumed else KNOWN_WITHIN * level
        else:
            level = per_joint(friction, "friction", names, "zero or positive", not_negative)
            level = np.atleast_2d(level).max(axis=0)
        slowest = float(np.max(self.speed))
        fast = slowest if speed is None else check_number(speed, "speed", "zero or positive [m/s]")
        wall = check_number(wall, "wall", "zero or positive [N/m]")
        limit = float(np.max(self.force))  # of rollouts with limits of their own, the one that presses most
        rubbed, mass = self.force_of(robot, level, places), self.mass_of(robot)
        unknown = weight if arm is None else max(weight, self._unknown_weight(robot, arm, places))
        pressed = limit + rubbed
        impact = pressed + float(np.sqrt(pressed**2 + wall * mass * fast**2))
        push = self._push(robot, places)
        return ForceBound(
            limit=limit,
            friction=rubbed,
            gravity=unknown,
            total=pressed + unknown,
            speed=fast,
            wall=wall,
            mass=mass,
            impact=impact,
            push=push,
            fastest=slowest,
            usual=places is None,
            assumed=assumed,
        )

    def _unknown_weight(self, robot: Robot, arm: Robot, configurations: Array | None) -> float:
        """Return the force at the tool [N] of the gravity that an arm has and a model does not.

        It is that torque over its lever: of the force J'^-1 makes of it, the median of usual configurations,
        or the largest of given ones (k, n).
        """
        check_type(arm, "arm", Robot, "a Robot")
        if arm.joint_names != robot.joint_names:
            raise ParameterError("arm", list(arm.joint_names), f"one with {', '.join(robot.joint_names)}")
        forces = []
        for q in self._usual(robot) if configurations is None else configurations:
            missing = arm.gravity(q) - robot.gravity(q)
            jacobian = self._motion.at(q, 0.0 * q).damped_jacobian(self._length)
            wrench = np.linalg.solve(jacobian.square, jacobian.matrix @ missing)
            forces.append(float(np.linalg.norm(wrench[:3])) / self._length)
        return float(np.median(forces) if configurations is None else np.max(forces))

    def _push(self, robot: Robot, configurations: Array | None) -> float:
        """Return the force of a hand [N] that the brake holds at the speed limit, and the motors at all.

        What the controller holds itself does not count: it comes with the distance, and a hand that begins
        at once is fastest before.
        """
        braked = (1.0 - FREE) * float(np.min(self.speed))
        root = np.sqrt(np.maximum(self._brake.gain, 1e-9))
        forces = []
        for q in self._usual(robot) if configurations is None else configurations:
            jacobian = robot.frame_jacobian(self._motion.frame, q)[:3]
            inertia = robot.mass_matrix(q)
            damped = jacobian / root
            speeds = np.linalg.eigvalsh(damped @ np.linalg.solve(inertia, damped.T))
            fastest = float(speeds.max()) + self._spring_speed(robot, jacobian, inertia)
            spare = np.maximum(robot.limits.effort - np.abs(robot.gravity(q)), 0.0)
            levers = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-9)
            held = float((spare / levers).min())
            forces.append(min(braked / fastest, held))
        return float(np.min(forces))

    def _spring_speed(self, robot: Robot, jacobian: Array, inertia: Array) -> float:
        """Return how fast a force of 1 N at once makes the tool on elastic joints, their motors held [m/s].

        A force f at once makes a mode of unit stiffness and frequency w as fast as f w, and the modes add up.

        Args:
            robot: the nominal model.
            jacobian: of the tool's position, (3, n).
            inertia: of the arm with its rotors, (n, n).
        """
        gear = robot.drives.value("stiffness")
        rotor = robot.drives.value("rotor_inertia")
        elastic = np.flatnonzero(elastic_joints(robot.drives))
        if not len(elastic):
            return 0.0
        motors = np.minimum(rotor[elastic], (1.0 - LEAST_LINK) * np.diag(inertia)[elastic])
        links = inertia[np.ix_(elastic, elastic)] - np.diag(motors)
        soft = 1.0 / np.sqrt(gear[elastic])
        squares, modes = np.linalg.eigh(soft[:, None] * links * soft)  # 1 / w^2, as the stiffness is 1
        # Rounding may leave a mode without inertia: it is passed over.
        positive = squares > 0.0
        frequency = np.where(positive, 1.0 / np.sqrt(np.where(positive, squares, 1.0)), 0.0)
        moved = (jacobian[:, elastic] * soft) @ modes
        speeds = np.linalg.eigvalsh((moved * frequency) @ moved.T)
        return float(speeds.max())

    def doubts(self, robot: Robot) -> Iterator[Finding]:
        """Find a limit that friction, as it is known, makes senseless.

        Args:
            robot: the nominal model.
        """
        yield from self._unbraked(robot)
        limit = float(np.min(self.force))
        if not self.friction.any():
            force = self.force_of(robot, usual_friction(robot))
            message = (
                "the nominal model has no Coulomb friction, which comes on top of the force limit of "
                f"{limit:g} N: with {100 * USUAL_FRICTION:g} % of the effort, usual for geared joints (half "
                f"to twice of it), it is up to {force:.2g} N at the tool"
            )
            repair = "the arm may stop on its way; specify it: robot.with_friction(viscous, coulomb)"
            yield Finding("warning", "the force limit", message, limit, force, repair)
            return
        unsure = self.force_of(robot, (KNOWN_WITHIN - 1.0) * np.atleast_2d(self.friction).max(axis=0))
        if unsure > limit:
            message = (
                f"the force limit of {limit:g} N is below {unsure:.2g} N, which joint friction is uncertain "
                f"by at the tool where it is known within {100 * (KNOWN_WITHIN - 1):.0f} %"
            )
            repair = f"the arm may stop on its way; use at least {unsure:.2g} N"
            yield Finding("warning", "the force limit", message, limit, unsure, repair)

    def _unbraked(self, robot: Robot) -> Iterator[Finding]:
        """Find a speed limit that elastic joints leave no damping for."""
        gain, full = float(self._brake.gain.min()), self._brake.full
        if gain < _WEAK * full:
            speed = float(np.max(self.speed))
            reason = "their encoders are, or may be, at the links, where damping would excite a resonance"
            repair = "where the encoders are at the motors, specify it: encoder_side of the drives"
            if np.all(np.asarray(robot.drives.value("encoder_side")) == "motor"):
                reason = "their motors are much lighter than what they move"
                repair = "`push` of force_bound is the force of a hand up to which it holds"
            message = (
                f"the speed limit of {speed:g} m/s does not hold beyond the force limit: joints are elastic "
                f"and {reason}"
            )
            yield Finding("warning", "the speed limit", message, gain, full, repair)


def _per_friction(friction: Array, effort: Array) -> Array:
    """Return one over what each joint's share of a torque is compared with, where it is shortened as a whole.

    That is `_MOST_RUBBED` times its friction, but no less than the largest share of the effort that friction
    has in any joint: one with far less friction than the others would leave too little to these. A joint
    without friction is compared with nothing: 0.

    Args:
        friction: Coulomb friction [N m or N], (n,) or (batch, n).
        effort: limits [N m or N], (n,), which may be infinite.
    """
    known = np.isfinite(effort) & (effort > 0.0)
    efforts = np.where(known, effort, 1.0)
    shares = np.where(known, friction / efforts, 0.0)
    least = np.where(known, shares.max(axis=-1, keepdims=True) * efforts, 0.0)
    rubs = friction > _NO_FRICTION
    compared = np.maximum(_MOST_RUBBED * friction, least)
    return np.where(rubs, 1.0 / np.where(rubs, compared, 1.0), 0.0)


def usual_friction(robot: Robot) -> Array:
    """Return the Coulomb friction that is usual for geared joints [N m or N], (n,): 3 % of the effort.

    A joint without an effort limit adds nothing: nobody knows its friction.
    """
    efforts = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, 0.0)
    return np.asarray(USUAL_FRICTION * efforts)


def limit_after(limit: Any, goal: Any, share: Any) -> Any:
    """Return a limit after a sample on its way to another one: a far larger one is reached by growing.

    Args:
        limit: now.
        goal: where it goes.
        share: of the way, and of the limit itself at most, in a sample [-].
    """
    nearer = limit + share * (goal - limit)
    return np.minimum(nearer, limit + share * limit)


def fitted(value: Array, like: Array, name: str) -> Array:
    """Return an array in the shape of another one.

    Raises:
        ArrayError: when it does not fit.
    """
    try:
        return np.array(np.broadcast_to(value, like.shape))
    except ValueError:
        raise ArrayError(name, f"expected shape {like.shape}, got {value.shape}") from None


def check_weight(limit: Any, weight: float, name: str = "force_limit") -> None:
    """Refuse a force limit below the weight that a model is uncertain by [N].

    Raises:
        ParameterError: when it is.
    """
    if weight > float(np.min(limit)):
        expected = f"more than {weight:.3g} N, the weight that the payload is uncertain by"
        raise ParameterError(name, np.asarray(limit).tolist(), expected)


def warn(findings: Iterable[Finding], level: int) -> None:
    """Warn of findings; `level` is how many calls above the caller the line is."""
    for finding in findings:
        warnings.warn(f"{finding.message}; {finding.repair}", ArmgpiWarning, stacklevel=level + 2)


def _beyond(vector: Array, most: Any) -> Array:
    """Return what is beyond a length of vectors (..., 3): exactly 0 for shorter ones."""
    length = np.sqrt(np.maximum(inner(vector, vector), 1e-12))
    share = np.maximum(1.0 - most / length, 0.0)
    beyond: Array = share * vector
    return beyond


def _along(vector: Array, direction: Array) -> Array:
    """Return the part of vectors (..., 3) along directions; 0 where a direction is."""
    square = np.maximum(inner(direction, direction), 1e-12)
    share = inner(vector, direction) / square
    along: Array = direction * share
    return along
