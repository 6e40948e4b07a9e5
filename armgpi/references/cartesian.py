"""Joint references that move a frame along a path in space (section 5.2, Figure 8)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from armgpi.base.arrays import Array, as_float_array
from armgpi.errors import ArrayError, ParameterError, ReachError
from armgpi.references.paths import Path
from armgpi.references.reference import Reference, Target
from armgpi.references.tracking import Track
from armgpi.robot.kinematics import TrackingInverse
from armgpi.robot.robot import Robot

#: From points (k, 3) [m] to the joint positions (k, n) that put the frame there, all of one branch; raises
#: ReachError for a point out of reach.
Inverse = Callable[[Array], Array]


class ClosedForm(ABC):
    """An inverse kinematics in closed form: an :data:`Inverse` that experiments find by themselves.

    Calling it with points [m], shape (k, 3), gives joint positions [rad or m], shape (k, n), all of one
    branch. It raises a ReachError for a point out of reach.
    """

    @classmethod
    @abstractmethod
    def fits(cls, robot: Robot, frame: str) -> bool:
        """Tell whether it is the inverse kinematics of a frame."""

    @abstractmethod
    def __call__(self, points: Array) -> Array:
        """Return joint positions (k, n) for points (k, 3) [m]."""


#: Distance by which the frame may miss the path [m].
_MISS = 1e-6
#: Latest time that is taken [s]: a path is followed from its beginning.
_LONGEST = 1e6
#: Times at which turns are counted [s]: between two of them no joint turns by half a turn.
_TURN_STEP = 0.01


class CartesianReference(Reference):
    """Joint positions, velocities and accelerations that carry a frame along a path.

    Positions come from an inverse kinematics. With a :class:`armgpi.TrackingInverse` any arm follows, and
    positions, velocities and accelerations are its (see there). With a function of the points, angles are
    continued over full turns, so that the reference never jumps, and velocities and accelerations follow
    from the frame's linear Jacobian J: v = J^+ x' and a = J^+ (x'' - J' v).

    Attributes:
        robot: the arm.
        frame: the frame that follows.
        path: the path in the base frame.
    """

    def __init__(
        self, robot: Robot, frame: str, path: Path, inverse: Inverse | TrackingInverse | None = None
    ) -> None:
        """Define the reference.

        Args:
            robot: the arm.
            frame: name of the frame that shall follow the path.
            path: where to, in the base frame.
            inverse: ``TrackingInverse(robot, frame)``, or for an arm that has a closed form a function
                from points (k, 3) to joint positions (k, n), always of the same branch, such as
                ``PaperArm().inverse_kinematics``. For a :class:`armgpi.PosePath`, whose rotation the frame
                follows as well, and for a path of positions whose rotation is free, a ``TrackingInverse``
                is made when none is given.

        Raises:
            NameNotFound: when there is no such frame.
            ParameterError: when `path` is no path, or `inverse` does not put the frame where it begins.
            ReachError: when the path begins out of reach.
        """
        if not isinstance(robot, Robot):
            raise ParameterError("robot", robot, "a single Robot")
        if not isinstance(path, Path):
            raise ParameterError("path", path, "a Path")
        robot.frame_pose(frame, robot.middle())  # refuses a frame that does not exist
        self.robot = robot
        self.frame = frame
        self.path = path
        self._track: Track | None = None
        turning = path.turning(0.0)
        if inverse is None:
            inverse = TrackingInverse(robot, frame, rotation=None if turning is None else turning.rotation)
        if turning is not None:
            _check_turning(inverse, turning.rotation)
        if isinstance(inverse, TrackingInverse):
            if inverse.frame != frame or inverse.robot.joint_names != robot.joint_names:
                expected = (
                    f"one for {frame!r} of {robot.name!r}, not {inverse.frame!r} of {inverse.robot.name!r}"
                )
                raise ParameterError("inverse", inverse, expected)
            self._track = Track(inverse, path)
            return
        if not callable(inverse) or isinstance(inverse, type):
            raise ParameterError("inverse", inverse, "a TrackingInverse, or a function of points (k, 3)")
        self._inverse = inverse
        self._turning = ~robot.prismatic
        self._continued = np.empty((0, robot.n))
        begin = path.at(np.zeros(1)).x
        first = self._solve(np.zeros(1), begin)
        reached = robot.frame_pose(frame, first).translation
        missed = float(np.linalg.norm(reached - begin))
        if missed > _MISS:
            expected = f"one that puts {frame!r} on the path (it misses its beginning by {missed:.3g} m)"
            raise ParameterError("inverse", inverse, expected)

    def at(self, t: float | Array) -> Target:
        """Return the target at `t` [s]; shapes as :meth:`Reference.at`.

        Raises:
            ArrayError: for a time that is not finite.
            ReachError: with the time and the point where the path leaves the arm's reach, or cannot be
                followed any farther.
            LimitError: with the time and the joint, where an arm with a :class:`armgpi.TrackingInverse` would
                leave its joint limits.
        """
        times = np.atleast_1d(as_float_array(t, "t"))
        if times.ndim > 1:
            raise ArrayError("t", f"expected a time or shape (k,), got shape {times.shape}")
        if np.abs(times).max(initial=0.0) > _LONGEST:
            raise ArrayError("t", f"expected times up to {_LONGEST:g} s, got {np.abs(times).max():g}")
        if self._track is not None:
            target = self._track.at(times)
        else:  # by the inverse for points
            point = self.path.at(times)
            q = self._continue(times, self._solve(times, point.x))
            jacobian = self.robot.frame_jacobian(self.frame, q)[:, :3]
            inverse = np.linalg.pinv(jacobian)
            v = np.matmul(inverse, point.v[..., None])[..., 0]
            drift = self.robot.frame_drift(self.frame, q, v)[:, :3]
            acceleration_left = point.a - drift
            a = np.matmul(inverse, acceleration_left[..., None])[..., 0]
            target = Target(q, v, a)
        return target if np.ndim(t) else Target(*(x[0] for x in target))

    def describe(self) -> dict[str, Any]:
        """Return the reference as plain data."""
        plain = {"type": "CartesianReference", "frame": self.frame, "path": self.path.describe()}
        if self._track is not None:
            plain["inverse"] = self._track.inverse.describe()
        return plain

    def _continue(self, times: Array, q: Array) -> Array:
        """Return angles without jumps: those a full turn away that are nearest to the path so far.

        The turns are counted from time 0 on a grid that grows with the latest time asked for, so the
        answer does not depend on the order in which times are asked for.
        """
        needed = int(np.ceil(max(0.0, float(times.max())) / _TURN_STEP)) + 2
        if needed > len(self._continued):
            first = len(self._continued)
            # At least twice as far as before, so that it rarely grows.
            steps = np.arange(first, max(needed, 2 * first), dtype=np.float64)
            grid = steps * _TURN_STEP
            try:
                new = self._solve(grid, self.path.at(grid).x)
            except ReachError:
                # Beyond what was asked for the path may end out of reach: count no farther.
                grid = grid[: needed - first]
                inside = np.minimum(grid, float(times.max()))
                new = self._solve(inside, self.path.at(inside).x)
            longer = np.concatenate([self._continued, new])
            self._continued = np.unwrap(longer, axis=0)
        nearest = np.rint(times / _TURN_STEP).astype(int)
        nearest = np.clip(nearest, 0, len(self._continued) - 1)
        full_turn = 2.0 * math.pi
        turns = np.rint((self._continued[nearest] - q) / full_turn)
        return np.where(self._turning, q + full_turn * turns, q)

    def _solve(self, times: Array, points: Array) -> Array:
        """Return the joint positions for points, naming the first time when there are none."""
        try:
            return self._inverse(points)
        except ReachError as whole:
            for time, point in zip(times, points, strict=True):
                try:
                    self._inverse(point[None])
                except ReachError as error:
                    text = f"the path at {self.path.describe_time(time)}: {error}"
                    raise ReachError(error.point, error.distance, text) from None
            raise whole from None

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"CartesianReference({self.frame!r} along {type(self.path).__name__})"


def _check_turning(inverse: Any, rotation: Array) -> None:
    """Refuse an inverse that does not begin with the first rotation of a path of poses [matrix (3, 3)]."""
    expected = (
        "TrackingInverse(robot, frame, rotation=path.turning(0.0).rotation), or none for a path of poses"
    )
    if not isinstance(inverse, TrackingInverse) or inverse.free != inverse.robot.n - 6:
        raise ParameterError("inverse", inverse, expected)
    rotation_held = inverse.describe().get("rotation")
    if rotation_held is None or not np.allclose(rotation_held, rotation, atol=1e-6):
        raise ParameterError("inverse", inverse, expected)
