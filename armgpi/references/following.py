"""Set-points that arrive at 10 to 60 Hz, late, noisy or not at all, followed within limits.

A teleoperator or a policy sends a pose now and then. An inverse kinematics finds a configuration for each,
once, and a :class:`Follower` goes there at the controller's rate: its speed, acceleration and jerk never
leave their limits, whatever arrives. So nothing here raises an exception while the arm moves.
"""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import (
    SMALLEST,
    Array,
    ArrayLike,
    as_float_array,
    as_sized_array,
    check_number,
    check_type,
)
from armgpi.errors import ArrayError, ParameterError, ReachError
from armgpi.references.poses import Poses, as_poses, check_pose_times, load_poses
from armgpi.references.reference import Reference, Target
from armgpi.robot.kinematics import inverse_kinematics, random_configurations
from armgpi.robot.robot import Robot

#: Rate of a follower's approach [1/s]: it lags by some 4 / _RATE. All joints have one rate, or the tool would
#: leave the path where joints lag differently.
_RATE = 40.0
#: Size of the jumps of the goal at which the jerk limit begins to act, which bounds the rate [rad or m].
_FINE = 1e-3
#: Share of the limits that a follower plans with, so that rounding and sampling stay inside them.
_PLANNED = 0.97
#: Share of the acceleration that it brakes with: the rest is for what the jerk limit delays.
_BRAKING = 0.5
#: Share of the speed from which the jerk limit alone just stops in time.
_EASING = 0.8
#: Time from no torque to the largest one where nothing is specified [s]: Franka's 87 N m at 1,000 N m/s.
_RISE = 0.087
#: Share of the effort that accelerations use, as gravity and disturbances need theirs.
_EFFORT_SHARE = 0.4
#: Share of the torque rate that each joint's own inertia uses, as inertias are coupled.
_RATE_SHARE = 0.55
#: Distance that configurations of set-points keep from joint limits, as a follower may overshoot [rad or m].
#: It is at most this share of the range.
_MARGIN, _MARGIN_SHARE = 0.03, 0.05
#: Effort where the URDF has none [N m or N].
_EFFORT = 100.0
#: Limits where neither the URDF nor the arm's effort say less [rad/s or m/s, rad/s^2 or m/s^2].
_FASTEST, _QUICKEST = 3.2, 10.0
#: Share of the velocity limits that is used.
_SPEED_SHARE = 0.9
#: Configurations over which inertias are taken.
_CONFIGURATIONS = 100
#: Shortest and longest time between two set-points that is counted with [s]: 60 and 10 Hz.
_SHORTEST, _LONGEST = 1.0 / 60.0, 0.1
#: Share of the newest interval in the mean of the intervals.
_NEW = 0.2
#: A goal goes to a new configuration over so many intervals, which averages noise, and its speed is
#: anticipated by so much.
_SPREAD, _AHEAD = 2.0, 0.9
#: The same with `feedforward`: less lag, more noise.
_SPREAD_AHEAD, _AHEAD_FULL = 1.0, 1.0
#: Movement below which a configuration has settled, and is not asked for again [rad or m].
_SETTLED = 1e-5
#: Iterations of the inverse kinematics of a set-point, at most.
_ITERATIONS = 24
#: What the cost falls by [-], and what joints move by [rad, or lengths of the arm], in the last iteration.
_LEAST_GAIN, _LEAST_MOVE = 1e-12, 1e-4
#: Weight of a rad of orientation beside an arm's length of position: near singular, the position counts more.
_TURN_WEIGHT = 0.3
#: Weight of a rad of movement since the last set-point, squared: near singular, joints move less.
_NEARNESS = 5e-4
#: Share of the way to the posture, in directions that the pose leaves free, in a set-point.
_POSTURE = 0.3
#: Damping that tells those directions.
_FREE = 1e-4
#: Longest step of an iteration [rad, or lengths of the arm].
_LONGEST_STEP = 0.3
#: Damping with which an iteration is tried again, its factor, and how often.
_RETRY, _MORE, _RETRIES = 1e-4, 10.0, 6
#: Share of the speed limits that configurations of set-points keep to, so that all joints arrive together.
_PACE = 0.5
#: Distance and angle between two poses from which on that is a jump, without a path to keep to [m, rad], and
#: how near the follower is when it is over [rad or m].
_JUMP, _JUMP_TURN, _OVER = 0.1, 0.4, 0.05
#: Samples that are worked out at once, at least.
_AT_LEAST = 256
#: Smallest and largest limit that is taken, in its unit.
_LEAST, _MOST = 1e-6, 1e9
#: Tolerance of the first pose [m and rad].
_REACHED = 1e-6


class FollowLimits(NamedTuple):
    """What a follower keeps to, each a number or one per joint.

    Attributes:
        velocity: [rad/s or m/s].
        acceleration: [rad/s^2 or m/s^2].
        jerk: [rad/s^3 or m/s^3].
    """

    velocity: ArrayLike
    acceleration: ArrayLike
    jerk: ArrayLike

    @classmethod
    def of(cls, robot: Robot, torque_rate: ArrayLike | None = None) -> FollowLimits:
        """Return limits that suit an arm.

        The jerk of a joint is 55 % of its torque rate over its largest own inertia D_jj, the acceleration
        40 % of its effort over it, 10 rad/s^2 at most; the rest is for the other joints, whose inertias are
        coupled. The velocity is 90 % of the URDF's, 3.2 rad/s at most.

        Args:
            robot: the arm.
            torque_rate: how fast the torques of its motors may change [N m/s or N/s], a number or (n,); where
                it is not given, the largest torque is reached in 87 ms, as Franka's is at 1,000 N m/s.

        Raises:
            ParameterError: for a robot that is none, or a rate that is not positive.
            ArrayError: for a rate of another shape.
        """
        check_type(robot, "robot", Robot, "a single Robot")
        effort, fastest = robot.limits.effort, robot.limits.velocity
        # A limit of 0 is one that the URDF leaves blank.
        is_given = np.isfinite(effort) & (effort > 0.0)
        effort = np.where(is_given, effort, _EFFORT)
        fastest = np.where(fastest > 0.0, fastest, np.inf)
        if torque_rate is None:
            rate = effort / _RISE
        else:
            rate = _per_joint(torque_rate, "torque_rate", robot.n, robot.joint_names)
        configurations = random_configurations(robot, _CONFIGURATIONS, seed=0)
        own_inertias = np.diagonal(robot.mass_matrix(configurations), axis1=1, axis2=2)
        inertia = own_inertias.max(axis=0)  # D_jj, the largest
        velocity = np.minimum(_SPEED_SHARE * fastest, _FASTEST)
        acceleration = np.minimum(_EFFORT_SHARE * effort / inertia, _QUICKEST)
        jerk = _RATE_SHARE * rate / inertia
        return cls(velocity, acceleration, jerk)


class FollowPlan(NamedTuple):
    """What one step of a follower computes with, arrays that broadcast: the plan of its limits.

    Attributes:
        speed: that is planned with, less than the limit [rad/s or m/s].
        acceleration: likewise [rad/s^2 or m/s^2].
        jerk: the limit [rad/s^3 or m/s^3].
        lost: speed that the jerk takes while the brake comes on [rad/s or m/s].
        twice_braking: twice the deceleration of a brake [rad/s^2 or m/s^2].
        easing: of the speed where the jerk alone limits: a stop from v takes sqrt(v^3 / jerk) [rad/s^3 or
            m/s^3].
        rate: at which an acceleration closes a difference of speeds [1/s].
        dt: sample time [s].
    """

    speed: Array
    acceleration: Array
    jerk: Array
    lost: Array
    twice_braking: Array
    easing: Array
    rate: float
    dt: float


class Follower:
    """Goes after a goal that jumps, within limits of speed, acceleration and jerk.

    Nested saturations: the distance left asks for a speed from which the joint can still brake, the speed for
    an acceleration, the acceleration for a jerk; each is cut to its limit. A step is elementwise, so it works
    on batches, and costs some 15 microseconds. Unlike a planner it does not come to rest at every set-point.
    It overshoots a jump of some hundredths of a rad by an eighth at most, a larger one by less.

    Attributes:
        limits: what it keeps to, arrays.
        dt: sample time [s].
        plan: what a step computes with, from both.
    """

    def __init__(self, limits: FollowLimits, dt: float) -> None:
        """Define the follower.

        Args:
            limits: of speed, acceleration and jerk; see :meth:`FollowLimits.of`.
            dt: sample time [s].

        Raises:
            ParameterError: when a limit or the sample time is not positive; it names the joint's index.
            ArrayError: when a limit is no array of numbers.
        """
        check_type(limits, "limits", FollowLimits, "FollowLimits(velocity, acceleration, jerk)")
        self.dt = check_number(dt, "dt", "a positive sample time [s]", open_=True)
        speed = _positive(limits.velocity, "velocity")
        acceleration = _positive(limits.acceleration, "acceleration")
        jerk = _positive(limits.jerk, "jerk")
        try:
            np.broadcast_shapes(speed.shape, acceleration.shape, jerk.shape)
        except ValueError:
            shapes = f"{speed.shape}, {acceleration.shape}, {jerk.shape}"
            raise ArrayError("limits", f"expected limits of one shape, or numbers; got {shapes}") from None
        self.limits = FollowLimits(speed, acceleration, jerk)
        # No faster than what sampling and the jerk of the slowest joint follow.
        slowest = float(np.cbrt(1.5 * jerk / _FINE).min())
        braking = _BRAKING * _PLANNED * acceleration
        self.plan = FollowPlan(
            speed=_PLANNED * speed,
            acceleration=_PLANNED * acceleration,
            jerk=jerk,
            lost=0.5 * braking * braking / jerk,
            twice_braking=2.0 * braking,
            easing=_EASING**3 * jerk,
            rate=min(_RATE, slowest, 0.2 / self.dt),
            dt=self.dt,
        )

    def init(self, q: ArrayLike) -> Target:
        """Return the state at rest at positions [rad or m], (n,) or (batch, n)."""
        start = as_sized_array(q, "q")
        return Target(start, np.zeros_like(start), np.zeros_like(start))

    def step(self, goal: Array, state: Target, rate: Any = 0.0) -> Target:
        """Return the state one sample later.

        Args:
            goal: where to [rad or m], (n,) or (batch, n).
            state: positions, velocities and accelerations now.
            rate: how fast the goal moves [rad/s or m/s], likewise; 0 for one that waits.
        """
        q, v, a = state
        most, _, jerk_limit, lost, twice_braking, easing, omega, dt = self.plan
        error = goal - q
        size = np.abs(error)
        braking = np.sqrt(lost * lost + twice_braking * size) - lost
        speed = np.minimum((omega / 3.0) * size, braking)
        speed = np.minimum(speed, _cube_root(easing * size * size))
        velocity = rate + np.sign(error) * speed
        velocity = np.maximum(np.minimum(velocity, most), -most)
        change = velocity - v
        size = np.abs(change)
        strength = np.minimum(omega * size, np.sqrt(jerk_limit * size))
        pull = np.sign(change) * strength
        pull = np.maximum(np.minimum(pull, self.plan.acceleration), -self.plan.acceleration)
        jerk = (2.0 * omega) * (pull - a)
        jerk = np.maximum(np.minimum(jerk, jerk_limit), -jerk_limit)
        a = a + dt * jerk
        v = v + dt * a
        return Target(q + dt * v, v, a)


def _cube_root(x: Any) -> Any:
    """Return cube roots of numbers that are not negative, from functions that generated C has as well."""
    return np.exp(np.log(np.maximum(x, SMALLEST)) / 3.0)


class _Guess(NamedTuple):
    """A configuration on the way to a pose: movement since the last one, what is missing, its Jacobian."""

    x: Array
    error: Array
    jacobian: Array


class SetpointInverse:
    """The inverse kinematics of a set-point: from the last configuration a few steps, never an error.

    It minimises ``|W x(q)|^2 + w |q - q_before|^2`` inside the joint limits, where x is what is missing to
    the pose, by Levenberg's and Marquardt's method; each step is a least-squares problem with bounds. So a
    pose out of reach brings the arm near, and near a singular configuration the orientation waits before the
    position does and joints move little. In directions that the pose leaves free, the posture `home` pulls.
    The second term leaves some hundredths of a mm; asking again with the same pose removes them.

    Attributes:
        robot: the arm.
        frame: name of the frame.
        home: the posture [rad or m], (n,).
        length: that weighs as much as a radian [m].
        units: that of each joint in such lengths, 1 for one that turns, (n,).
        margins: lowest and highest positions that it gives [rad or m], two arrays (n,).
    """

    def __init__(self, robot: Robot, frame: str, home: ArrayLike | None = None) -> None:
        """Define the task.

        Args:
            robot: the arm.
            frame: name of the frame.
            home: the posture that joints are drawn to where the pose leaves them free [rad or m], (n,); the
                middle of the joint ranges when not given.

        Raises:
            NameNotFound: when there is no such frame.
            ParameterError: when the robot is no single one, or the frame does not move.
            LimitError: when `home` is outside the joint limits.
        """
        check_type(robot, "robot", Robot, "a single Robot")
        self.robot = robot
        self.frame = frame
        self.home = robot.middle() if home is None else robot.check_position(home, "home")
        if self.home.shape != (robot.n,):
            raise ArrayError("home", f"expected shape ({robot.n},), got {self.home.shape}")
        jacobian = robot.frame_jacobian(frame, random_configurations(robot, 32, seed=0))
        if not jacobian.any():
            raise ParameterError("frame", frame, "a frame that moves; this one is fixed to the base")
        turning = ~robot.prismatic
        arms = np.linalg.norm(jacobian[:, :3] * turning, axis=1)  # of each joint about the frame [m]
        self.length = float(arms.max()) or 1.0
        self.units = np.where(turning, 1.0, self.length)
        lower, upper = robot.limits.lower, robot.limits.upper
        margin = np.minimum(_MARGIN, _MARGIN_SHARE * (upper - lower))
        self.margins = lower + margin, upper - margin

    def with_home(self, home: Array) -> SetpointInverse:
        """Return the same task with another posture [rad or m], (n,)."""
        other = copy.copy(self)
        other.home = home
        return other

    def __call__(
        self, q: Array, position: Array, rotation: Array, within: tuple[Array, Array] | None = None
    ) -> Array:
        """Return the configuration for a pose.

        Args:
            q: the one before [rad or m], (n,).
            position: of the frame [m], (3,).
            rotation: of the frame, (3, 3).
            within: lowest and highest positions that count as within reach by now [rad or m], each (n,); the
                joint limits when not given.

        Returns:
            Joint positions inside the limits [rad or m], (n,): of a pose out of reach, near to it.
        """
        lower, upper = self.margins
        if within is not None:
            lower = np.minimum(np.maximum(within[0], lower), upper)
            upper = np.maximum(np.minimum(within[1], upper), lower)
        first = np.minimum(np.maximum(q, lower), upper)
        guess = self._state(first, q, position, rotation)
        bounds = (lower - q) / self.units, (upper - q) / self.units
        jacobian = guess.jacobian
        damped = jacobian @ jacobian.T + _FREE * np.eye(6)
        inverse = jacobian.T @ np.linalg.inv(damped)
        posture = (self.home - q) / self.units
        # The posture as far as the pose leaves it free.
        near = _POSTURE * (posture - inverse @ (jacobian @ posture))
        damping = 0.0
        for _ in range(_ITERATIONS):
            better, damping = self._better(guess, bounds, near, damping, q, position, rotation)
            if better is None:
                break
            moved = float(np.abs(better.x - guess.x).max())
            gained = _cost(guess, near) - _cost(better, near)
            guess = better
            if gained < _LEAST_GAIN and moved < _LEAST_MOVE:
                break
        return np.asarray(q + self.units * guess.x)

    def error(self, q: Array, position: Array, rotation: Array) -> tuple[float, float]:
        """Return distance [m] and angle [rad] from a pose."""
        pose = self.robot.frame_pose(self.frame, q)
        turned = pin.log3(rotation @ pose.rotation.T)
        return float(np.linalg.norm(position - pose.translation)), float(np.linalg.norm(turned))

    def _state(self, q: Array, q_before: Array, position: Array, rotation: Array) -> _Guess:
        """Return what is missing to a pose, weighted, lengths in those of the arm."""
        pose = self.robot.frame_pose(self.frame, q)
        error = np.empty(6)
        error[:3] = (position - pose.translation) / self.length
        error[3:] = _TURN_WEIGHT * pin.log3(rotation @ pose.rotation.T)
        jacobian = self.robot.frame_jacobian(self.frame, q) * self.units
        jacobian[:3] /= self.length
        jacobian[3:] *= _TURN_WEIGHT
        return _Guess((q - q_before) / self.units, error, jacobian)

    def _better(
        self,
        found: _Guess,
        bounds: tuple[Array, Array],
        near: Array,
        damping: float,
        q: Array,
        position: Array,
        rotation: Array,
    ) -> tuple[_Guess | None, float]:
        """Return a guess that costs less and the next damping; None for the guess where there is none."""
        jacobian = found.jacobian
        matrix = jacobian.T @ jacobian + _NEARNESS * np.eye(len(q))
        gradient = jacobian.T @ found.error - _NEARNESS * (found.x - near)
        lower = np.maximum(bounds[0] - found.x, -_LONGEST_STEP)
        upper = np.minimum(bounds[1] - found.x, _LONGEST_STEP)
        for _ in range(_RETRIES):
            damped = matrix + damping * np.eye(len(q))
            step = _bounded(damped, gradient, lower, upper)
            tried = self._state(q + self.units * (found.x + step), q, position, rotation)
            if _cost(tried, near) <= _cost(found, near):
                return tried, damping / _MORE
            damping = max(_MORE * damping, _RETRY)
        return None, damping


def constants() -> dict[str, float]:
    """Return the numbers of this module by their names, for the C that does the same."""
    return {name[1:]: value for name, value in globals().items() if re.fullmatch("_[A-Z][A-Z_]+", name)}


def _cost(found: _Guess, near: Array) -> float:
    """Return what the inverse kinematics minimises."""
    away = found.x - near
    return float(found.error @ found.error + _NEARNESS * (away @ away))


def _bounded(matrix: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """Return the x in bounds that minimises x' M x / 2 - g' x, M positive definite, by active sets."""
    n = len(gradient)
    x = np.minimum(np.maximum(np.zeros(n), lower), upper)
    free = np.ones(n, dtype=bool)
    for _ in range(3 * n):
        inside = np.flatnonzero(free)
        at_bound = np.flatnonzero(~free)
        if len(inside):
            block = matrix[np.ix_(inside, inside)]
            coupling = matrix[np.ix_(inside, at_bound)]
            solved = np.linalg.solve(block, gradient[inside] - coupling @ x[at_bound])
            x[inside] = np.minimum(np.maximum(solved, lower[inside]), upper[inside])
            outside = x[inside] != solved
            if outside.any():
                free[inside[outside]] = False
                continue
        pull = gradient - matrix @ x
        inwards = np.where(x <= lower, pull, -pull) * ~free
        worst = int(np.argmax(inwards))
        if inwards[worst] <= 1e-12:
            break
        free[worst] = True
    return x


class Setpoints(Reference):
    """Joint positions that follow poses of a frame as they arrive, within limits up to the jerk.

    Before the first pose, and after the last, it waits where it is. It begins at `start`, or in the
    configuration of the first pose. Joints near a singular configuration or a limit, and poses out of reach,
    slow it down; it does not stop, and it comes back with the poses.

    Attributes:
        robot: the arm.
        frame: name of the frame.
        times: when the poses arrive [s], (m,).
        poses: the poses.
        follower: what goes after the configurations.
        feedforward: whether the poses' own speed is anticipated: less lag, more noise.
        inverse: what finds the configurations.
        start: where it begins [rad or m], (n,).
    """

    def __init__(
        self,
        robot: Robot,
        frame: str,
        times: ArrayLike,
        poses: Any,
        limits: FollowLimits | None = None,
        *,
        start: ArrayLike | None = None,
        feedforward: bool = False,
        dt: float = 1e-3,
        inverse: Callable[[Array, Array, Array], Array] | None = None,
    ) -> None:
        """Define the stream.

        Args:
            robot: the arm.
            frame: name of the frame.
            times: when each pose arrives [s], increasing, (m,).
            poses: m poses: `pinocchio.SE3`, matrices (m, 4, 4), or x, y, z, qx, qy, qz, qw (m, 7).
            limits: of speed, acceleration and jerk; those of :meth:`FollowLimits.of` when not given.
            start: configuration at time 0 [rad or m], (n,), also the posture of free joints; that of the
                first pose when not given.
            feedforward: anticipate by the speed of the last poses: half of the lag, more of the noise.
            dt: sample time of the follower [s].
            inverse: from the last configuration (n,), position (3,) and rotation (3, 3) to a configuration
                (n,); a :class:`SetpointInverse` when not given.

        Raises:
            ArrayError: for arrays that do not fit, times that do not increase, or what is no pose.
            ReachError: when the first pose is out of reach and no start is given.
            ParameterError: for a robot that is no single one, or a limit that is not positive.
            LimitError: when the start is outside the joint limits.
        """
        check_type(robot, "robot", Robot, "a single Robot")
        check_type(feedforward, "feedforward", bool, "True or False")
        self.robot = robot
        self.frame = frame
        self.poses: Poses = as_poses(poses)
        self.times = check_pose_times(times, len(self.poses.positions))
        if not len(self.times):
            raise ArrayError("times", "expected at least one pose")
        self.follower = Follower(_of_robot(limits, robot), dt)
        self.feedforward = feedforward
        self.start = self._first() if start is None else robot.check_position(start, "start")
        if inverse is not None and not callable(inverse):
            raise ParameterError("inverse", inverse, "a function of configuration, position and rotation")
        self.inverse = SetpointInverse(robot, frame, self.start) if inverse is None else inverse
        self._next = 0
        self._begin = self._goal = self.start
        self._arrived = self._solved = -math.inf
        self._interval = _LONGEST
        self._settled = True
        self._jumped = False
        self._samples = [self.follower.init(self.start)]
        self._known = self._stacked()

    @classmethod
    def load(
        cls, path: str | PathLike[str], robot: Robot, frame: str, topic: str = "/target_pose", **given: Any
    ) -> Setpoints:
        """Read a stream from a file of poses, of which the first arrives at time 0.

        Args:
            path: CSV, NetCDF or MCAP; see :func:`armgpi.load_poses`.
            robot: the arm.
            frame: name of the frame.
            topic: of MCAP.
            **given: as the constructor takes it: limits, start, feedforward, dt, inverse.
        """
        times, poses = load_poses(path, topic)
        return cls(robot, frame, times - times[:1], poses, **given)

    def at(self, t: float | Array) -> Target:
        """Return the target at `t` [s]; shapes as :meth:`Reference.at`."""
        times = np.atleast_1d(as_float_array(t, "t"))
        if times.ndim > 1 or (times < -1e-9).any() or times.max(initial=0.0) > 1e6:
            raise ArrayError("t", "expected a time or times (k,) from 0 to 1e6 s")
        place = times / self.follower.dt
        # A multiple of the sample time is that sample, however it was rounded.
        before = np.floor(place + 1e-6).astype(np.int64)
        self._grow(int(before.max(initial=0)) + 1)
        share = np.maximum(place - before, 0.0)
        late = share[:, None] * self.follower.dt
        q, v, a = (x[before] for x in self._known)
        q = q + late * (v + 0.5 * late * a)
        target = Target(q, v + late * a, a.copy())
        return target if np.ndim(t) else Target(*(x[0] for x in target))

    def describe(self) -> dict[str, Any]:
        """Return the stream as plain data."""
        limits = {}
        for name, values in self.follower.limits._asdict().items():
            limits[name] = np.asarray(values).tolist()
        return {
            "type": "Setpoints",
            "frame": self.frame,
            "times": self.times.tolist(),
            "positions": self.poses.positions.tolist(),
            "rotations": self.poses.rotations.tolist(),
            "limits": limits,
            "start": self.start.tolist(),
            "feedforward": self.feedforward,
            "dt": self.follower.dt,
        }

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"Setpoints({self.frame!r}, {len(self.times)} poses, {self.times[-1]:g} s)"

    def _first(self) -> Array:
        """Return the configuration of the first pose.

        Raises:
            ReachError: when it is out of reach.
        """
        position = self.poses.positions[0]
        rotation = self.poses.rotations[0]
        solution = inverse_kinematics(self.robot, self.frame, position, rotation, tolerance=_REACHED)
        if not solution.reached:
            text = ", ".join(f"{x:.6g}" for x in position)
            distance = float(solution.position_error)
            angle = float(solution.rotation_error)
            raise ReachError(
                tuple(position),
                distance,
                f"pose 0, ({text}) m, is out of reach of {self.frame!r}: the nearest configuration found "
                f"misses it by {distance:.3g} m and {angle:.3g} rad; give another pose, or start=q",
            )
        return np.asarray(solution.q)

    @property
    def sampled(self) -> int:
        """How many samples are known."""
        return len(self._known.q)

    def take_samples(self, samples: Target) -> None:
        """Take samples (k, n) from the first one on, which generated code worked out as this class would."""
        self._known = samples

    def _grow(self, count: int) -> None:
        """Have at least so many samples."""
        if self.sampled >= count:
            return
        state = self._samples[-1]
        first = len(self._samples) - 1
        last = max(count, len(self._samples) + _AT_LEAST) - 1
        for k in range(first, last):
            t = k * self.follower.dt
            self._receive(t)
            goal, rate = self._at(t)
            state = self.follower.step(goal, state, rate)
            self._samples.append(state)
        self._known = self._stacked()

    def _receive(self, t: float) -> None:
        """Take the poses that have arrived at a time [s]; of several the last."""
        first = self._next
        self._next = max(first, int(np.searchsorted(self.times, t + 1e-9, side="right")))
        if self._next == first:
            has_waited = t - self._solved >= _LONGEST - 1e-9
            if has_waited and not self._settled:
                self._solve(t)
            return
        arrived = float(self.times[self._next - 1])
        since = min(max(arrived - self._arrived, _SHORTEST), _LONGEST)
        if first == 0:
            self._interval = since
        else:
            self._interval = (1.0 - _NEW) * self._interval + _NEW * since
        self._arrived = arrived
        self._jumped = self._jumped or self._apart(first - 1, self._next - 1)
        self._solve(t)

    def _apart(self, first: int, second: int) -> bool:
        """Tell whether a pose is a jump from the one before."""
        if first < 0:
            return False
        positions, rotations = self.poses
        turn = pin.log3(rotations[second] @ rotations[first].T)
        distance = float(np.linalg.norm(positions[second] - positions[first]))
        angle = float(np.linalg.norm(turn))
        return distance > _JUMP or angle > _JUMP_TURN

    def _solve(self, t: float) -> None:
        """Find the configuration of the last pose that arrived."""
        last = self._next - 1
        position = self.poses.positions[last]
        rotation = self.poses.rotations[last]
        if self._jumped or not isinstance(self.inverse, SetpointInverse):
            goal = self._configuration(position, rotation)
            distance = np.abs(goal - self._samples[-1].q).max()
            self._jumped = self._jumped and bool(distance > _OVER)
        else:
            velocity = np.asarray(self.follower.limits.velocity, dtype=np.float64)
            way = _PACE * self._interval * velocity
            within = (self._goal - way, self._goal + way)
            goal = self.inverse(self._goal, position, rotation, within)
        self._begin, _ = self._at(t)
        moved = np.abs(goal - self._goal).max()
        self._settled = bool(moved < _SETTLED)
        self._goal = goal
        self._solved = t

    def _at(self, t: float) -> tuple[Array, Array]:
        """Return where the follower is to go [rad or m], and the speed that it anticipates [rad/s or m/s]."""
        intervals, ahead = (_SPREAD_AHEAD, _AHEAD_FULL) if self.feedforward else (_SPREAD, _AHEAD)
        spread = intervals * self._interval
        share = (t - self._solved) / spread
        way = self._goal - self._begin
        if share >= 1.0 or self._jumped:
            return self._goal, np.zeros_like(way)
        return self._begin + share * way, (ahead / spread) * way

    def _configuration(self, position: Array, rotation: Array) -> Array:
        """Return the configuration of a pose; the last one where the inverse gives no finite numbers.

        Raises:
            ArrayError: when an inverse of a user's gives something else than (n,) numbers.
        """
        goal = np.asarray(self.inverse(self._goal, position, rotation))
        if goal.shape != (self.robot.n,) or goal.dtype.kind != "f":
            raise ArrayError("inverse", f"expected it to give ({self.robot.n},) floats, got {goal.shape}")
        return goal if np.isfinite(goal).all() else self._goal

    def _stacked(self) -> Target:
        """Return all samples as arrays (k, n)."""
        columns = zip(*self._samples, strict=True)
        return Target(*(np.array(column) for column in columns))


def _of_robot(limits: FollowLimits | None, robot: Robot) -> FollowLimits:
    """Return limits with a number for each joint, refusing one that is not positive by the joint's name."""
    if limits is None:
        return FollowLimits.of(robot)
    check_type(limits, "limits", FollowLimits, "FollowLimits(velocity, acceleration, jerk)")
    arrays = [_per_joint(value, name, robot.n, robot.joint_names) for name, value in limits._asdict().items()]
    return FollowLimits(*arrays)


def _per_joint(value: ArrayLike, name: str, n: int, joint_names: Any = ()) -> Array:
    """Return positive numbers (n,)."""
    array = as_sized_array(value, name)
    if array.shape not in ((), (n,)):
        raise ArrayError(name, f"expected a number or shape ({n},), got {array.shape}")
    array = np.broadcast_to(array, (n,)).copy()
    wrong = ~((array >= _LEAST) & (array <= _MOST))
    if wrong.any():
        joint = int(np.argmax(wrong))
        where = f"{joint_names[joint]}.{name}" if joint_names else f"{name}[{joint}]"
        expected = f"a positive limit, {_LEAST:g} to {_MOST:g}: with 0 nothing moves"
        raise ParameterError(where, float(array[joint]), expected)
    return array


def _positive(value: ArrayLike, name: str) -> Array:
    """Return positive numbers of any shape."""
    array = as_sized_array(value, name)
    is_within = (array >= _LEAST) & (array <= _MOST)
    if not array.size or not is_within.all():
        expected = f"from {_LEAST:g} to {_MOST:g}: with a limit of 0 nothing moves"
        raise ParameterError(name, array.tolist(), expected)
    return array
