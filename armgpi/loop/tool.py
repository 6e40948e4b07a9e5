"""What the tool of an arm does in a run: how far it is from where it should be, and what it touches.

The tool is the arm's tip, or the plant's `metrics_frame`. Its error is that of the links, wherever the
encoders sit. All of it is elementwise NumPy on positions and velocities, of one sample or of many, so a loop
without trajectories folds it as well.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError
from armgpi.plants.plant import Plant, inside
from armgpi.robot.frame_motion import FrameMotion, Pose, inner
from armgpi.robot.robot import Robot

#: Numbers of samples times rollouts of which poses are worked out at once, so that they stay in memory.
_AT_ONCE = 1 << 15
#: What a distance [m] or an angle [rad] may be off by rounding, much enlarged.
_ROUNDING = 1e-9
#: More than these in all are not worked out for a dataset: 5 microseconds each.
MOST = 400_000


class ToolSample(NamedTuple):
    """What metrics of the tool are made from, arrays (..., 1); squares, as roots can wait until the end.

    Attributes:
        offset: square of the distance from the wished position [m^2].
        turn: square of the Frobenius norm of R - R*, which is 8 sin^2(angle / 2) [-].
        force: square of the largest force of a contact [N^2].
    """

    offset: Any
    turn: Any
    force: Any


class ToolTrack(NamedTuple):
    """The tool over a run.

    Attributes:
        actual: where it was: rotations (..., 3, 3) and positions [m], (..., 3).
        wished: where the reference puts it, likewise.
        points: of the contacts: where each acts [m], (..., contacts, 3).
        forces: of the contacts, on the arm, in the base frame [N], likewise.
    """

    actual: Pose
    wished: Pose
    points: Array
    forces: Array

    def sample(self) -> ToolSample:
        """Return what metrics are made from."""
        forces = [self.forces[..., i, :] for i in range(self.forces.shape[-2])]
        squares = [inner(force, force) for force in forces]
        largest = np.maximum.reduce(squares) if squares else np.zeros((*self.actual.position.shape[:-1], 1))
        return ToolSample(*_apart(self.actual, self.wished), largest)


class Tool:
    """Works out what the tool of a plant does.

    Attributes:
        frame: the frame that is the tool.
        motion: its kinematics; None for an arm whose tip no joint moves.
    """

    def __init__(self, plant: Plant) -> None:
        """Find the tool and what it touches.

        Args:
            plant: the plant; its arms, where it has several, differ in masses alone.
        """
        robot = plant.robot
        arm = robot if isinstance(robot, Robot) else robot.first
        self.frame = getattr(inside(plant), "metrics_frame", None) or arm.tip
        self.motion: FrameMotion | None
        try:
            self.motion = FrameMotion(arm, self.frame)
        except ParameterError:
            self.motion = None
        self._surroundings: Any = getattr(inside(plant), "_surroundings", None)

    def at(
        self, q: Array, v: Array, q_ref: Array, t: Any, largest: tuple[Any, Any] | None = None
    ) -> ToolSample:
        """Return what metrics are made from.

        Args:
            q: positions of the links [rad or m], (..., n).
            v: their velocities [rad/s or m/s], likewise.
            q_ref: wished positions [rad or m], likewise.
            t: time [s], a number or (..., 1).
            largest: offset and turn that were the largest so far, (..., 1): generated code has 0 for those
                that cannot be larger.
        """
        zero = 0.0 * q[..., 0:1]
        offset, turn, force = zero, zero, zero
        if self.motion is not None:
            offset, turn = self.apart(self.motion, q, q_ref, largest)
        if self._surroundings is not None:
            for touched in self._surroundings.touched(q, v, t):
                force = np.maximum(force, inner(touched.wrench.force, touched.wrench.force))
        return ToolSample(offset, turn, force)

    def apart(
        self, motion: FrameMotion, q: Array, q_ref: Array, largest: tuple[Any, Any] | None
    ) -> tuple[Any, Any]:
        """Return offset and turn of :class:`ToolSample`, (..., 1).

        Args:
            motion: kinematics of the tool.
            q: positions [rad or m], (..., n).
            q_ref: wished positions [rad or m], likewise.
            largest: as for :meth:`at`.
        """
        return _apart(motion.pose(q), motion.pose(q_ref))

    def track(self, q: Array, v: Array, q_ref: Array, times: Array) -> ToolTrack | None:
        """Return the tool over a run, of all rollouts; None where there is none.

        Args:
            q: positions of the links [rad or m], (samples, ..., n).
            v: their velocities [rad/s or m/s], likewise.
            q_ref: wished positions [rad or m], likewise.
            times: [s], (samples,).
        """
        if self.motion is None:
            return None
        stride = max(1, _AT_ONCE // max(1, int(np.prod(q.shape[1:-1]))))
        parts = []
        for first in range(0, len(q), stride):
            now = slice(first, first + stride)
            parts.append(self._track(q[now], v[now], q_ref[now], times[now]))
        if not parts:
            return None
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        return ToolTrack(Pose(*columns[0:2]), Pose(*columns[2:4]), columns[4], columns[5])

    def _track(self, q: Array, v: Array, q_ref: Array, times: Array) -> tuple[Array, ...]:
        """Return the arrays of some samples of :meth:`track`."""
        assert self.motion is not None
        rows = q.shape[:-1]
        points = []
        forces = []
        if self._surroundings is not None:
            t = times.reshape(-1, *[1] * (q.ndim - 1))
            for touched in self._surroundings.touched(q, v, t):
                points.append(touched.motion.position)
                forces.append(np.broadcast_to(touched.wrench.force, points[-1].shape))
        arrays: list[Array] = []
        for rotation, position in (self.motion.pose(q), self.motion.pose(q_ref)):
            # The rotation of an arm that only slides is the same at all configurations.
            arrays.append(np.broadcast_to(rotation, (*rows, 3, 3)))
            arrays.append(np.broadcast_to(position, (*rows, 3)))
        if points:
            return (*arrays, np.stack(points, axis=-2), np.stack(forces, axis=-2))
        no_contacts = np.zeros((*rows, 0, 3))
        return (*arrays, no_contacts, no_contacts)


def most_apart(motion: FrameMotion, q: Any, q_ref: Any) -> tuple[Any, Any] | None:
    """Return what offset and turn of :class:`ToolSample` are at most, by the errors of the joints alone.

    A joint that is off by e moves the tool by its longest lever times e at most, and turns it by e: the
    Frobenius norm of R - R* is at most sqrt(2) times the angle.

    Args:
        motion: kinematics of the tool.
        q: positions [rad], (..., n).
        q_ref: wished positions [rad], likewise.

    Returns:
        The two, (..., 1); None for an arm with slides.
    """
    levers = motion.lever_bounds()
    if levers is None:
        return None
    turns = motion.turn_bounds()
    way: Any = _ROUNDING
    angle: Any = _ROUNDING
    for joint in range(q.shape[-1]):
        error = np.abs(q[..., joint : joint + 1] - q_ref[..., joint : joint + 1])
        way = way + float(levers[joint]) * error
        angle = angle + float(turns[joint]) * error
    return way * way, 2.0 * (angle * angle)


def angle_of(turn: Array) -> Array:
    """Return angles [rad] from :attr:`ToolSample.turn`."""
    return np.asarray(2.0 * np.arcsin(np.minimum(np.sqrt(turn / 8.0), 1.0)))


def _apart(actual: Pose, wished: Pose) -> tuple[Any, Any]:
    """Return the squares of distance and turn between two poses, (..., 1)."""
    between = actual.rotation - wished.rotation
    turn: Any = 0.0
    for row in range(3):
        turn = turn + inner(between[..., row, :], between[..., row, :])
    offset = actual.position - wished.position
    return inner(offset, offset), turn
