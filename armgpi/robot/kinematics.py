"""Inverse kinematics: the joint positions that put a frame of any arm at a position or pose.

Damped least squares on :meth:`Robot.frame_pose` and :meth:`Robot.frame_jacobian`; all poses, and all starts
of those that one start does not solve, advance together as a batch. Inside, lengths are in units of the
arm's own length and sliding joints count in the same unit, so that a small and a large arm are solved alike.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import (
    SMALLEST,
    Array,
    ArrayLike,
    as_float_array,
    as_sized_array,
    check_number,
    check_whole,
)
from armgpi.base.hints import with_keyword_hints
from armgpi.errors import ArrayError, ParameterError, ReachError
from armgpi.robot.frames import Pose
from armgpi.robot.robot import Robot

Rows = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]

#: Damping per half squared residual; Chan and Lawrence (1988) leave it open, and it hardly matters.
_DAMPING = 0.1
#: Damping that is left at the goal, so that a singular configuration there divides by no zero.
_LEAST_DAMPING = 1e-14
#: Longest step of a joint in an iteration [rad, or lengths of the arm].
_LONGEST_STEP = 1.0
#: Iterations between two checks whether a search still gains.
_PATIENCE = 10
#: Share of the loss that a search has to gain in between, or it ends.
_LEAST_GAIN = 0.01
#: The last search for a pose out of reach, whose distance is reported, takes so many times the iterations.
_LAST_ITERATIONS = 10
#: Share of the loss that the last search has to gain.
_LAST_GAIN = 1e-6
#: Starts that are tried at once.
_AT_ONCE = 8
#: Share of the way to a configuration that a step of the null-space projection asks for.
_PROJECTION_SHARE = 0.7
#: Steps of the null-space projection.
_PROJECTION_STEPS = 12
#: Steps after them that only correct the pose.
_CORRECTIONS = 4
#: Largest coordinate that can be asked for [m]; squares of more overflow in the end.
_FARTHEST = 1e9
#: How far a matrix may be from a rotation.
_ROTATION_SLACK = 1e-6
#: Singular values below this share of the largest count as zero.
_SINGULAR = 1e-9
#: Tolerance of a search for configurations on a path [m and rad].
_EXACT = 1e-12
#: Iterations of such a search.
_ITERATIONS = 60


class InverseSolution(NamedTuple):
    """What :func:`inverse_kinematics` found; arrays of shape (...) as the requested poses.

    Attributes:
        q: joint positions, those nearest to the pose where it is not reached [rad or m], shape (..., n).
        position_error: distance of the frame from the requested position [m].
        rotation_error: angle between its rotation and the requested one [rad]; 0 where none was.
        reached: whether both are within the tolerance.
        iterations: iterations of the start that led there.
    """

    q: Array
    position_error: Array
    rotation_error: Array
    reached: Flags
    iterations: npt.NDArray[np.int64]


@with_keyword_hints
def inverse_kinematics(
    robot: Robot,
    frame: str,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    *,
    direction: ArrayLike | None = None,
    tool_axis: ArrayLike = (0.0, 0.0, 1.0),
    near: ArrayLike | None = None,
    restarts: int = 64,
    tolerance: float = 1e-9,
    iterations: int = 60,
    seed: int = 0,
) -> InverseSolution:
    """Return joint positions, inside the limits, that put a frame at a position or pose.

    Levenberg-Marquardt with the damping of Chan and Lawrence, "General inverse kinematics with the error
    damped pseudoinverse", ICRA 1988: proportional to the squared residual. A joint at a limit that the
    residual presses against it is held there. The search begins at `near`; where that does not reach, at
    random configurations, the same for every pose. So an answer depends on its own pose alone.

    Of the solutions the one nearest to `near` is taken, among full turns too. An arm with more joints than
    the task needs is then moved in the null space of its Jacobian towards `near`, as far as the task lets it.

    Args:
        robot: the arm.
        frame: name of the frame.
        position: position of its origin in the base frame [m], shape (3,) or (k, 3).
        rotation: its rotation matrix in the base frame, shape (3, 3) or (k, 3, 3); any rotation will do
            when not given.
        direction: instead of a rotation, the direction of its `tool_axis` in the base frame, shape (3,) or
            (k, 3); the rotation about it is free.
        tool_axis: axis in the frame, shape (3,), for `direction`.
        near: configuration to begin at and to stay near to [rad or m], shape (n,) or (k, n); the middle of
            the joint ranges when not given.
        restarts: number of further starts, at most, for a pose that is not reached from `near`.
        tolerance: distance [m] and angle [rad] that count as reached.
        iterations: most iterations of a start.
        seed: of the random starts.

    Returns:
        The configurations and how well they reach. One out of reach raises no error: check `reached`.

    Raises:
        NameNotFound: when there is no such frame.
        ArrayError: when an array is not as it should be, or a matrix is not a rotation.
        ParameterError: when both rotation and direction are given, the frame does not move, or a number is
            out of its range.
        LimitError: when `near` is outside the joint limits.
    """
    arm = _Arm.of(robot, frame)
    single, goal = _goal(position, rotation, direction, tool_axis)
    k = len(goal.position)
    home = robot.middle() if near is None else robot.check_position(near, "near")
    is_row_per_pose = not single and home.shape == (k, robot.n)
    if home.shape != (robot.n,) and not is_row_per_pose:
        raise ArrayError("near", f"expected shape ({robot.n},) or one row per pose, got {home.shape}")
    home = np.broadcast_to(home, (k, robot.n))
    restarts = check_whole(restarts, "restarts", 0, 100_000)
    search = _Search(
        check_number(tolerance, "tolerance", "a positive length and angle [m, rad]", open_=True),
        check_whole(iterations, "iterations", 1),
    )
    found = search.descend(arm, goal, home)
    starts = random_configurations(robot, restarts, seed)
    for begin in range(0, restarts, _AT_ONCE):
        missing = np.flatnonzero(~found.reached)
        if not len(missing):
            break
        some = starts[begin : begin + _AT_ONCE]
        of_each = np.broadcast_to(some, (len(missing), *some.shape))
        _try_again(arm, goal, home, search, found, missing, of_each)
    missing = np.flatnonzero(~found.reached)
    if len(missing):
        last = _Search(search.tolerance, _LAST_ITERATIONS * search.iterations, _LAST_GAIN, last=True)
        from_both = np.stack([found.q, home], axis=1)[missing]
        _try_again(arm, goal, home, last, found, missing, from_both)
    if robot.n > goal.size:
        rows = np.flatnonzero(found.reached)
        goals = goal.rows(rows)
        projected = search.null_space_projection(arm, goals, found.q[rows], home[rows])
        distances, angles = arm.errors(goals, projected)
        found.q[rows] = projected
        found.position_error[rows] = distances
        found.rotation_error[rows] = angles
    return InverseSolution._make(x[0] for x in found) if single else found


class TrackingInverse:
    """Where the joints go while a frame follows a path, its axis or its rotation held if so wished.

    It serves :class:`armgpi.CartesianReference` as the inverse of any arm. Joints that the task leaves free
    are drawn towards the configuration that it began in, by the null space of the Jacobian.

    Attributes:
        robot: the arm.
        frame: name of the frame that follows.
        rate: how fast free joints are drawn back [1/s].
    """

    def __init__(
        self,
        robot: Robot,
        frame: str,
        *,
        rotation: ArrayLike | None = None,
        direction: ArrayLike | None = None,
        tool_axis: ArrayLike = (0.0, 0.0, 1.0),
        near: ArrayLike | None = None,
        rate: float = 1.0,
        restarts: int = 64,
        seed: int = 0,
    ) -> None:
        """Define the task.

        Args:
            robot: the arm.
            frame: name of the frame that follows.
            rotation: its rotation matrix all along, shape (3, 3); any rotation will do when not given.
            direction: instead of a rotation, the direction of its `tool_axis` all along, shape (3,).
            tool_axis: axis in the frame, shape (3,), for `direction`.
            near: configuration to begin nearest to [rad or m], shape (n,). When not given, the path begins in
                the configuration with the most clearance: far from joint limits and singularities.
            rate: how fast free joints are drawn back to the first configuration [1/s], zero for not at all.
            restarts: number of configurations that the search for the first one begins at.
            seed: of these.

        Raises:
            As :func:`inverse_kinematics`.
        """
        self._arm = _Arm.of(robot, frame)
        self.robot = robot
        self.frame = frame
        _, self._goal = _goal(np.zeros(3), rotation, direction, tool_axis)
        if self._goal.size > robot.n:
            bent = " with the specified direction of the tool" if self._goal.size > 3 else ""
            raise ParameterError(
                "robot",
                robot,
                f"an arm of {self._goal.size} joints or more, which a path in space{bent} takes (each of its "
                "numbers is an equation)",
            )
        self._near = None if near is None else robot.check_position(near, "near")
        if self._near is not None and self._near.ndim != 1:
            raise ArrayError("near", f"expected shape ({robot.n},), got {self._near.shape}")
        self.rate = check_number(rate, "rate", "zero or positive [1/s]")
        self._starts = random_configurations(robot, check_whole(restarts, "restarts", 1, 100_000), seed)

    def __call__(self, points: ArrayLike) -> Array:
        """Return the configurations for points in order, each found from the one before.

        Args:
            points: [m], shape (k, 3), a path of small steps.

        Returns:
            Joint positions [rad or m], shape (k, n), of one branch.

        Raises:
            ReachError: for a point that is out of reach, or cannot be reached on this branch.
        """
        _, goal = _goal(points, None, None, (0.0, 0.0, 1.0))
        q = np.empty((len(goal.position), self.robot.n))
        for i, point in enumerate(goal.position):
            if i == 0:
                q[i] = self.begin(point)
            else:
                (q[i],) = self.closest(q[i - 1 : i], point[None])
        return q

    def begin(self, point: Array, rotation: Array | None = None) -> Array:
        """Return the configuration in which a path begins, the first of :meth:`candidates`.

        Args:
            point: in the base frame [m], shape (3,).
            rotation: of the frame, where it moves, shape (3, 3).

        Returns:
            Joint positions [rad or m], shape (n,).

        Raises:
            ReachError: when the point is out of reach.
        """
        first: Array = self.candidates(point, rotation)[0]
        return first

    def candidates(self, point: Array, rotation: Array | None = None) -> Array:
        """Return configurations for a point that a path may begin in.

        Args:
            point: in the base frame [m], shape (3,).
            rotation: of the frame, where it moves, shape (3, 3).

        Returns:
            Joint positions [rad or m], shape (c, n), the one nearest to `near`, or several, from the one
            with the most clearance on.

        Raises:
            ReachError: when the point is out of reach; it carries how far.
        """
        home = self.robot.middle() if self._near is None else self._near
        starts = np.concatenate([home[None], self._starts])
        homes = np.broadcast_to(home, starts.shape)
        search = _Search(_EXACT, _ITERATIONS)
        goal = self._at(point[None], None if rotation is None else rotation[None])
        goals = goal.rows(np.zeros(len(starts), dtype=np.intp))
        found = search.descend(self._arm, goals, starts, homes)
        if not found.reached.any():
            raise self._out_of_reach(point, found)
        q = found.q[found.reached]
        if self._near is None:
            return q[np.argsort(-self.clearance(q), kind="stable")]
        nearest = np.argmin(_distance(self._arm, q, home))
        best = q[[nearest]]
        if not self.free:
            return best
        return search.null_space_projection(self._arm, goal, best, home[None])

    def describe(self) -> dict[str, Any]:
        """Return what is followed as plain data."""
        held = {"rotation": self._goal.rotation, "direction": self._goal.direction}
        return {
            "type": "TrackingInverse",
            **{name: value[0].tolist() for name, value in held.items() if value is not None},
            "tool_axis": self._goal.tool_axis.tolist(),
            "near": None if self._near is None else self._near.tolist(),
            "rate": self.rate,
        }

    def __repr__(self) -> str:
        """Return a one-line description."""
        return (
            f"TrackingInverse({self.robot.name!r}, {self.frame!r}, {self._goal.size} of {self.robot.n} held)"
        )

    @property
    def free(self) -> int:
        """Number of joint directions that the task leaves free."""
        return int(self.robot.n) - self._goal.size

    def flow(self, q: Array, velocity: Array, home: Array, angular: Array | None = None) -> Array:
        """Return the joint velocities that carry the frame, free joints drawn back to `home`.

        Args:
            q: configurations [rad or m], shape (k, n).
            velocity: of the frame's origin [m/s], shape (k, 3).
            home: configurations that free joints are drawn to [rad or m], shape (n,) or (k, n).
            angular: angular velocity of the frame [rad/s], zero when not given, shape (k, 3).

        Returns:
            Joint velocities [rad/s or m/s], shape (k, n).
        """
        return self.resolve(q, velocity, self.rate * (home - q), angular)

    def resolve(self, q: Array, linear: Array, wish: Array, angular: Array | None = None) -> Array:
        """Return the joint rates nearest to a wish that give the frame a linear and angular rate.

        Positions, velocities and accelerations are all of this form: wish + J^+ (rate - J wish).

        Args:
            q: configurations at which J is taken [rad or m], shape (k, n).
            linear: rate of the frame's origin, shape (k, 3).
            wish: joint rates to stay near to, shape (k, n).
            angular: rate of the frame's rotation, zero when not given, shape (k, 3); what the task leaves
                free of it does not count.

        Returns:
            Joint rates, shape (k, n).
        """
        goal = self._at(linear)
        J = self._arm.jacobian(goal, q)
        turn = np.zeros_like(linear) if angular is None else angular
        turned = _times(goal.turns, turn)
        asked: Array = np.concatenate([linear / self._arm.length, turned], axis=-1)
        wished = wish / self._arm.units
        missing = asked - _times(J, wished)
        return self._arm.units * (wished + _times(_pseudoinverse(J), missing))

    def correct(self, q: Array, points: Array, steps: int, rotations: Array | None = None) -> Array:
        """Return the nearest configurations with the frame on the points, by Newton steps.

        Args:
            q: configurations to begin at [rad or m], shape (k, n).
            points: where the frame should be [m], shape (k, 3).
            steps: number of Newton steps.
            rotations: of the frame, where they move, shape (k, 3, 3).

        Returns:
            Joint positions [rad or m], shape (k, n).
        """
        goal = self._at(points, rotations)
        for _ in range(steps):
            e, J = self._arm.linearise(goal, q)
            q = q + self._arm.units * _times(_pseudoinverse(J), e)
        return q

    def closest(self, q: Array, points: Array) -> Array:
        """Return configurations on the points, on the branch of those that the search begins at.

        Args:
            q: configurations to begin at [rad or m], shape (k, n).
            points: where the frame should be [m], shape (k, 3).

        Returns:
            Joint positions [rad or m], shape (k, n).

        Raises:
            ReachError: when one is not found.
        """
        found = _Search(_EXACT, _ITERATIONS).descend(self._arm, self._at(points), q)
        if not found.reached.all():
            row = int(np.argmin(found.reached))
            one = InverseSolution._make(x[row : row + 1] for x in found)
            raise self._out_of_reach(points[row], one)
        return found.q

    def missed(self, q: Array, points: Array, rotations: Array | None = None) -> Array:
        """Return how far the frame is from the points.

        Args:
            q: configurations [rad or m], shape (k, n).
            points: where the frame should be [m], shape (k, 3).
            rotations: of the frame, where they move, shape (k, 3, 3).

        Returns:
            The larger of distance [m] and angle [rad], shape (k,).
        """
        goal = self._at(points, rotations)
        worst: Array = np.max(self._arm.errors(goal, q), axis=0)
        return worst

    def _at(self, points: Array, rotations: Array | None = None) -> _Goal:
        """Return the goal at points (k, 3), with rotations (k, 3, 3) where they move."""
        one_each = np.zeros(len(points), dtype=np.intp)
        goal = self._goal.rows(one_each)._replace(position=points)
        return goal if rotations is None else goal._replace(rotation=rotations)

    def clearance(self, q: Array) -> Array:
        """Return how far configurations are from limits and singular configurations.

        The least distance of a joint from a limit, as a share of half its range, times the least singular
        value of the Jacobian. It is negative outside the limits.

        Args:
            q: configurations [rad or m], shape (k, n).

        Returns:
            Clearance [-], shape (k,); the Jacobian is in units of the arm's own length.
        """
        lower, upper = self.robot.limits[:2]
        half = 0.5 * (upper - lower)
        with np.errstate(invalid="ignore"):  # of unbounded joints
            distance = np.minimum(q - lower, upper - q)
            inside = distance / np.where(half > 0.0, half, 1.0)
        is_bounded = np.isfinite(half) & (half > 0.0)
        margin = np.where(is_bounded, inside, 1.0).min(axis=-1)
        anywhere = self._at(np.zeros((len(q), 3)))
        J = self._arm.jacobian(anywhere, q)
        least = np.linalg.svd(J, compute_uv=False)[:, -1]
        return np.asarray(margin * least)

    def _out_of_reach(self, point: Array, found: InverseSolution) -> ReachError:
        """Return the error for a point and the searches that did not reach it."""
        missed = found.position_error + self._arm.length * found.rotation_error
        best = int(np.argmin(missed))
        distance = float(found.position_error[best])
        angle = float(found.rotation_error[best])
        held = f" and {angle:.3g} rad" if self._goal.turns.shape[1] else ""
        text = ", ".join(f"{x:.6g}" for x in point)
        return ReachError(
            tuple(point),
            distance,
            f"{self.frame!r} of {self.robot.name!r} does not reach ({text}) m: the nearest configuration "
            f"found misses it by {distance:.3g} m{held}",
        )


class _Arm(NamedTuple):
    """An arm and a frame of it, in units of its own."""

    robot: Robot
    frame: str
    length: float  # [m] that weighs as much as a radian
    units: Array  # [rad or m] per unit of a joint, (n,)

    @classmethod
    def of(cls, robot: Robot, frame: str) -> _Arm:
        """Check robot and frame, and measure them."""
        if not isinstance(robot, Robot):
            raise ParameterError("robot", robot, "a single Robot")
        J = robot.frame_jacobian(frame, random_configurations(robot, 32, seed=0))
        if not J.any():
            raise ParameterError("frame", frame, "a frame that moves; this one is fixed to the base")
        turning = ~robot.prismatic
        # The longest lever found; an arm that slides only, or turns on the spot, is measured in metres.
        levers = np.linalg.norm(J[:, :3] * turning, axis=1)
        length = float(levers.max()) or 1.0
        return cls(robot, frame, length, np.where(turning, 1.0, length))

    def linearise(self, goal: _Goal, q: Array) -> tuple[Array, Array]:
        """Return what is missing to a goal (k, m) and the Jacobian of what is there (k, m, n)."""
        pose = self.robot.frame_pose(self.frame, q)
        linear = (goal.position - pose.translation) / self.length
        angular = _times(goal.turns, goal.turn(pose))
        e = np.concatenate([linear, angular], axis=-1)
        return e, self.jacobian(goal, q)

    def jacobian(self, goal: _Goal, q: Array) -> Array:
        """Return the Jacobian of what a goal asks for, shape (k, m, n)."""
        J = self.robot.frame_jacobian(self.frame, q)
        linear = J[:, :3] / self.length
        angular = goal.turns @ J[:, 3:]
        return np.concatenate([linear, angular], axis=1) * self.units

    def errors(self, goal: _Goal, q: Array) -> tuple[Array, Array]:
        """Return distance [m] and angle [rad] from a goal, shape (k,) each."""
        pose = self.robot.frame_pose(self.frame, q)
        distance = np.linalg.norm(goal.position - pose.translation, axis=-1)
        return distance, np.linalg.norm(goal.turn(pose), axis=-1)


class _Goal(NamedTuple):
    """What is asked of a frame, one row per pose."""

    position: Array  # [m], (k, 3)
    rotation: Array | None  # (k, 3, 3)
    direction: Array | None  # (k, 3), of length one
    tool_axis: Array  # (3,), of length one
    turns: Array  # axes about which a turn counts, (k, 0, 2 or 3, 3)

    @property
    def size(self) -> int:
        """Number of equations."""
        return 3 + int(self.turns.shape[1])

    def rows(self, rows: Rows) -> _Goal:
        """Return some of the rows."""
        return _Goal(
            self.position[rows],
            None if self.rotation is None else self.rotation[rows],
            None if self.direction is None else self.direction[rows],
            self.tool_axis,
            self.turns[rows],
        )

    def turn(self, pose: Pose) -> Array:
        """Return the turn from a pose to the goal as axis times angle [rad], shape (k, 3)."""
        if self.rotation is not None:
            from scipy.spatial.transform import Rotation  # here: it takes longer to import than Pinocchio

            turn = self.rotation @ pose.rotation.swapaxes(-1, -2)
            return np.asarray(Rotation.from_matrix(turn).as_rotvec()).reshape(-1, 3)
        if self.direction is not None:
            axis = pose.rotation @ self.tool_axis
            normal = np.cross(axis, self.direction)
            sine = np.linalg.norm(normal, axis=-1, keepdims=True)
            cosine = np.sum(axis * self.direction, axis=-1, keepdims=True)
            # Opposite, every turn about an axis across will do.
            lost = (sine < 1e-12) & (cosine < 0.0)
            across = normal / np.where(sine > 0.0, sine, 1.0)
            unit = np.where(lost, self.turns[:, 0], across)
            return np.asarray(unit * np.arctan2(sine, cosine))
        return np.zeros_like(pose.translation)


class _Search(NamedTuple):
    """The iteration and when it ends."""

    tolerance: float  # [m and rad]
    iterations: int
    least_gain: float = _LEAST_GAIN
    last: bool = False  # whether it is the last search: it comes to rest where the goal is out of reach

    def descend(self, arm: _Arm, goal: _Goal, start: Array, home: Array | None = None) -> InverseSolution:
        """Search from configurations (k, n), one per row of the goal.

        Turns of the answers are those nearest to `home`, or to the start when not given. The answers are
        inside the joint limits, also from a start outside; errors and `reached` are of these.
        """
        lower, upper = _wide(arm.robot)
        q = np.array(start)
        k = len(q)
        count = np.zeros(k, dtype=np.int64)
        before = np.full(k, np.inf)
        rows = np.arange(k)
        for iteration in range(self.iterations):
            e, J = arm.linearise(goal.rows(rows), q[rows])
            loss = 0.5 * np.sum(e * e, axis=-1)
            distance = arm.length * np.linalg.norm(e[:, :3], axis=-1)
            angle = np.linalg.norm(e[:, 3:], axis=-1)
            going = ~((distance <= self.tolerance) & (angle <= self.tolerance))
            if iteration % _PATIENCE == 0:
                going &= loss < (1.0 - self.least_gain) * before[rows]
                before[rows] = loss
            rows, e, J, loss = rows[going], e[going], J[going], loss[going]
            if not len(rows):
                break
            # By Chan and Lawrence. Out of reach e stays large, and with it the second derivative of the loss
            # that J'J leaves out (e times the change of J): there the damping is the length of e.
            damping = np.sqrt(2.0 * loss) if self.last else _DAMPING * loss
            is_low = q[rows] <= lower
            is_high = q[rows] >= upper
            step = arm.units * _damped_step(e, J, damping + _LEAST_DAMPING, is_low, is_high)
            q[rows] = np.clip(q[rows] + step, lower, upper)
            count[rows] += 1
        q = _nearest_turns(arm.robot, q, start if home is None else home)
        errors = arm.errors(goal, q)
        is_reached = np.max(errors, axis=0) <= self.tolerance
        return InverseSolution(q, *errors, is_reached, count)

    def null_space_projection(self, arm: _Arm, goal: _Goal, q: Array, home: Array) -> Array:
        """Return configurations (k, n) moved in the null space towards `home`, where that keeps the goal."""
        lower, upper = arm.robot.limits[:2]
        moved = q
        for step in range(_PROJECTION_STEPS + _CORRECTIONS):
            e, J = arm.linearise(goal, moved)
            share = _PROJECTION_SHARE if step < _PROJECTION_STEPS else 0.0
            wish = share * (home - moved) / arm.units
            dx = wish + _times(_pseudoinverse(J), e - _times(J, wish))
            moved = np.clip(moved + arm.units * dx, lower, upper)
        kept = np.max(arm.errors(goal, moved), axis=0) <= self.tolerance
        closer = _distance(arm, moved, home) < _distance(arm, q, home)
        return np.where((kept & closer)[:, None], moved, q)


def _damped_step(e: Array, J: Array, damping: Array, low: Flags, high: Flags) -> Array:
    """Return the steps (k, n) of damped least squares; joints pressed against a limit are held.

    A step is shortened as a whole so that no joint moves by more than `_LONGEST_STEP` in its unit.

    Args:
        e: what is missing, (k, m).
        J: Jacobian with respect to the joints in their units, (k, m, n).
        damping: what is added to the squared singular values, (k,).
        low: joints at their lower limit, (k, n).
        high: joints at their upper limit, (k, n).
    """
    downhill = _times(J.swapaxes(-1, -2), e)
    held = (low & (downhill < 0.0)) | (high & (downhill > 0.0))
    J = np.asarray(np.where(held[:, None, :], 0.0, J))
    JT = J.swapaxes(-1, -2)
    # J^T (J J^T + w)^-1 e is (J^T J + w)^-1 J^T e: the smaller system is solved.
    w = damping[:, None, None]
    rows, columns = J.shape[1:]
    if rows <= columns:
        damped = J @ JT + w * np.eye(rows)
        step = _times(JT, _solve(damped, e))
    else:
        damped = JT @ J + w * np.eye(columns)
        step = _solve(damped, _times(JT, e))
    longest = np.abs(step).max(axis=-1, keepdims=True)
    return np.asarray(step * (_LONGEST_STEP / np.maximum(longest, _LONGEST_STEP)))


def _try_again(
    arm: _Arm, goal: _Goal, home: Array, search: _Search, found: InverseSolution, rows: Rows, starts: Array
) -> None:
    """Search for rows (r,) from several starts each, (r, s, n), and keep the better answers in `found`."""
    number = starts.shape[1]
    row_of_start = np.repeat(rows, number)
    homes = home[row_of_start]
    begin = starts.reshape(len(row_of_start), -1)
    tried = search.descend(arm, goal.rows(row_of_start), begin, homes)
    # Reached ones by their distance from home, all others after them by what they miss.
    miss = tried.position_error / arm.length + tried.rotation_error
    rank = np.where(tried.reached, _distance(arm, tried.q, homes), 1e9 * (1.0 + miss))
    best_of_row = np.argmin(rank.reshape(len(rows), -1), axis=1)
    best = best_of_row + number * np.arange(len(rows))
    had = found.position_error[rows] / arm.length + found.rotation_error[rows]
    better = tried.reached[best] | (miss[best] < had)
    for ours, theirs in zip(found, tried, strict=True):
        ours[rows[better]] = theirs[best[better]]


def _goal(
    position: ArrayLike, rotation: ArrayLike | None, direction: ArrayLike | None, tool_axis: ArrayLike
) -> tuple[bool, _Goal]:
    """Check what is asked for; return whether it is a single pose, and it with one row per pose."""
    position = as_float_array(position, "position")
    if position.ndim not in (1, 2) or position.shape[-1] != 3:
        raise ArrayError("position", f"expected shape (3,) or (k, 3), got {position.shape}")
    if np.abs(position).max(initial=0.0) > _FARTHEST:
        raise ArrayError(
            "position", f"expected positions within {_FARTHEST:g} m, got {np.abs(position).max():g}"
        )
    points, single = position.reshape(-1, 3), position.ndim == 1
    k = len(points)
    tool_axes = _rows(tool_axis, "tool_axis", (3,), 1)
    (axis,) = _unit(tool_axes[:1], "tool_axis")
    if rotation is not None and direction is not None:
        raise ParameterError("direction", direction, "left out where a rotation is specified")
    if rotation is not None:
        matrices = _rows(rotation, "rotation", (3, 3), k)
        products = matrices @ matrices.swapaxes(-1, -2)
        off = np.abs(products - np.eye(3)).max(initial=0.0)
        is_mirrored = np.linalg.det(matrices) < 0.0
        if off > _ROTATION_SLACK or is_mirrored.any():
            raise ArrayError(
                "rotation", f"expected rotation matrices, got one {off:.2g} from orthonormal or mirrored"
            )
        all_turns = np.broadcast_to(np.eye(3), (k, 3, 3))
        return single, _Goal(points, matrices, None, axis, all_turns)
    if direction is not None:
        towards = _unit(_rows(direction, "direction", (3,), k), "direction")
        _, _, directions = np.linalg.svd(towards[:, None, :])
        return single, _Goal(points, None, towards, axis, directions[:, 1:])
    return single, _Goal(points, None, None, axis, np.zeros((k, 0, 3)))


def _rows(value: ArrayLike, name: str, shape: tuple[int, ...], k: int) -> Array:
    """Return an array of one shape, or of one per row, as rows."""
    array = as_sized_array(value, name)
    if array.shape not in (shape, (k, *shape)):
        raise ArrayError(name, f"expected shape {shape} or {(k, *shape)}, got {array.shape}")
    return np.broadcast_to(array, (k, *shape))


def _unit(vectors: Array, name: str) -> Array:
    """Return vectors (k, 3) with length one."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if (length < SMALLEST).any():
        raise ParameterError(name, [0.0, 0.0, 0.0], "a direction")
    return np.asarray(vectors / length)


def random_configurations(robot: Robot, count: int, seed: int) -> Array:
    """Return random configurations inside the limits, within half a turn of the middle where that is less.

    Args:
        robot: the arm.
        count: how many.
        seed: the same seed gives the same configurations.

    Returns:
        Configurations [rad or m], shape (count, n).
    """
    rng = np.random.default_rng(check_whole(seed, "seed", 0))
    middle = robot.middle()
    low, high = (
        np.maximum(robot.limits.lower, middle - math.pi),
        np.minimum(robot.limits.upper, middle + math.pi),
    )
    # Adding 0 makes -0 to 0: NumPy takes a range from 0 to -0 for a negative one.
    return rng.uniform(low, high + 0.0, (count, robot.n))


def middle_and_random(robot: Robot, count: int, seed: int) -> Array:
    """Return the middle of the limits first, then random configurations; `count` in all, (count, n)."""
    others = random_configurations(robot, count - 1, seed)
    return np.stack([robot.middle(), *others])


def _wide(robot: Robot) -> tuple[Array, Array]:
    """Return the position limits, none where every angle has a full turn inside them."""
    lower, upper = robot.limits[:2]
    turns = ~robot.prismatic & (upper - lower >= 2.0 * math.pi)
    return np.where(turns, -math.inf, lower), np.where(turns, math.inf, upper)


def _nearest_turns(robot: Robot, q: Array, home: Array) -> Array:
    """Return angles a number of full turns away, inside the limits and as near to `home` as they let."""
    lower, upper = robot.limits[:2]
    turn = 2.0 * math.pi
    least = np.ceil((lower - q) / turn - 1e-12)
    most = np.floor((upper - q) / turn + 1e-12)
    wished = np.rint((home - q) / turn)
    turns = np.clip(wished, least, np.maximum(least, most))
    may_turn = ~robot.prismatic & (least <= most)
    moved = np.where(may_turn, q + turn * turns, q)
    return np.clip(moved, lower, upper)


def _distance(arm: _Arm, q: Array, home: Array) -> Array:
    """Return how far configurations are from others, shape (k,)."""
    moves = (q - home) / arm.units
    return np.asarray(np.linalg.norm(moves, axis=-1))


def _pseudoinverse(J: Array) -> Array:
    """Return the pseudoinverses of matrices (k, m, n), shape (k, n, m)."""
    inverses = np.linalg.pinv(J, rcond=_SINGULAR)
    return np.asarray(inverses, dtype=np.float64)


def _solve(matrix: Array, vector: Array) -> Array:
    """Solve (k, a, a) matrices for (k, a) vectors."""
    solutions = np.linalg.solve(matrix, vector[..., None])
    return np.asarray(solutions[..., 0], dtype=np.float64)


def _times(matrix: Array, vector: Array) -> Array:
    """Multiply (k, a, b) matrices with (k, b) vectors."""
    products = matrix @ vector[..., None]
    return np.asarray(products[..., 0])
