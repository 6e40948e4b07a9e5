"""Where a frame of an arm is, how it moves and what a force on it does, as elementwise NumPy.

:meth:`armgpi.Robot.frame_pose` asks Pinocchio, one configuration after another. What stands here runs on
batches at once and becomes generated C, so a plant may ask it at every stage of its integrator.
"""

from __future__ import annotations

import zlib
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.errors import NameNotFound, ParameterError
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Damping of J J', lengths in those of the arm: directions with a singular value below its root are no
#: directions of a force or a motion.
_SINGULAR = 1e-4
_IDENTITY = np.eye(3)
#: Axes in the order in which a cross product multiplies them.
_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]
#: Configurations over which the length of an arm is taken.
_CONFIGURATIONS = 32


class Pose(NamedTuple):
    """Where a frame is, in the base frame.

    Attributes:
        rotation: rotation matrix, (..., 3, 3).
        position: of the point [m], (..., 3).
    """

    rotation: Array
    position: Array


class Motion(NamedTuple):
    """A point fixed to a frame, in the base frame.

    Attributes:
        rotation: rotation matrix of the frame, (..., 3, 3).
        position: of the point [m], (..., 3).
        velocity: of the point [m/s], (..., 3).
        rate: angular velocity of the frame [rad/s], (..., 3).
        levers: for each joint of the arm how it moves the point at 1 rad/s or m/s: velocity [m] or [1] and
            angular velocity [1], two arrays (..., 3); None for a joint that does not carry the frame.
    """

    rotation: Array
    position: Array
    velocity: Array
    rate: Array
    levers: tuple[tuple[Array, Array] | None, ...]

    def torque(self, q: Array, force: Array, moment: Array) -> Array:
        """Return J' (force, moment): the torque [N m or N] of the joints that a wrench at the point is.

        Args:
            q: positions, for the shape of the answer, (n,) or (batch, n).
            force: in the base frame [N], (..., 3).
            moment: likewise [N m].
        """
        if all(map(_is_vector, (self.position, force, moment))) and None not in self.levers:
            # All joints at once, with the same bits.
            linear, angular = (np.stack(every) for every in zip(*self.levers, strict=True))
            return np.asarray(_dot(linear, force) + _dot(angular, moment))
        columns = []
        for joint, lever in enumerate(self.levers):
            if lever is None:
                columns.append(np.zeros_like(q[..., joint]))
            else:
                columns.append(_dot(lever[0], force) + _dot(lever[1], moment))
        return np.stack(columns, axis=-1)

    def damped_jacobian(self, length: float) -> DampedJacobian:
        """Return the Jacobian of the point, with what inverts it everywhere.

        Args:
            length: that of the arm [m], which makes positions and rotations comparable.
        """
        zero = 0.0 * self.position
        columns = []
        for lever in self.levers:
            linear, angular = (zero, zero) if lever is None else lever
            columns.append(np.concatenate([linear / length + zero, angular + zero], axis=-1))
        matrix, transposed = np.stack(columns, axis=-1), np.stack(columns, axis=-2)
        return DampedJacobian(matrix, transposed, np.matmul(matrix, transposed) + _SINGULAR * np.eye(6))


class DampedJacobian(NamedTuple):
    """The Jacobian of a point, lengths in those of the arm.

    Attributes:
        matrix: J, (..., 6, n).
        transposed: its transpose, (..., n, 6).
        square: J J' and a damping, (..., 6, 6): it has an inverse at singular configurations too.
    """

    matrix: Array
    transposed: Array
    square: Array


class Chain(NamedTuple):
    """Where a point is, and the joints before it, in the base frame.

    Attributes:
        rotation: rotation matrix of the frame, (..., 3, 3).
        position: of the point [m], (..., 3).
        axes: of the joints, from the base on, each (..., 3).
        origins: a point on each axis [m], likewise.
    """

    rotation: Any
    position: Any
    axes: list[Any]
    origins: list[Any]


class FrameMotion:
    """The kinematics of one point of an arm.

    Attributes:
        frame: name of the frame.
        point: the point in the axes of the frame [m].
    """

    def __init__(self, robot: Robot, frame: str, point: Array | None = None) -> None:
        """Take the placements from the robot's Pinocchio model.

        Args:
            robot: the arm.
            frame: name of a link, joint or fixed joint.
            point: a point in its axes [m], (3,); its origin when not given.

        Raises:
            NameNotFound: when there is no such frame.
            ParameterError: when no joint moves it.
        """
        if frame not in robot.frame_names:
            raise NameNotFound("frame", frame, robot.frame_names)
        model = robot._model
        known = model.frames[robot._frame(frame)]
        self.frame = frame
        self.point = np.zeros(3) if point is None else np.array(point, dtype=np.float64)
        joints: list[int] = []
        joint = int(known.parentJoint)
        while joint > 0:
            joints.insert(0, joint)
            joint = int(model.parents[joint])
        if not joints:
            raise ParameterError("frame", frame, "a frame that a joint moves")
        end = known.placement.act(pin.SE3(np.eye(3), self.point))
        places = [*(model.jointPlacements[i] for i in joints), end]
        motions = [np.array(model.joints[i].createData().S).ravel() for i in joints]
        self._turns = tuple(bool(motion[3:].any()) for motion in motions)
        self._places = tuple(int(model.joints[i].idx_v) for i in joints)
        # In stacks of matrices, which are part of the structure of generated code: literals, not inputs.
        self._rotations = np.array([_snapped(place.rotation) for place in places])
        self._positions = np.array([np.reshape(place.translation, (3, 1)) for place in places])
        axes = [
            motion[3:] if turns else motion[:3] for motion, turns in zip(motions, self._turns, strict=True)
        ]
        self._axes = np.array([_snapped(axis).reshape(3, 1) for axis in axes])
        self._crosses = cross_matrix(self._axes[:, :, 0])
        self._squares = np.array([each @ each for each in self._crosses])
        self._ratio: Array | None = None
        self._offset: Array | None = None
        if robot.coupling is not None:
            self._ratio = robot.coupling.ratio[None]
            self._offset = robot.coupling.offset[None, None]
        self._n = robot.n

    def reach(self, robot: Robot) -> float:
        """Return how far the frame is from a joint's axis at most [m], over configurations; 1 for slides.

        Args:
            robot: the arm.
        """
        jacobian = robot.frame_jacobian(self.frame, random_configurations(robot, _CONFIGURATIONS, seed=0))
        lengths = np.linalg.norm(jacobian[:, :3] * ~robot.prismatic, axis=1)
        return float(lengths.max()) or 1.0

    def pose(self, q: Array) -> Pose:
        """Return where the point is; cheaper than :meth:`at`.

        Args:
            q: positions [rad or m], (..., n).
        """
        chain = self.chain(q)
        return Pose(chain.rotation, chain.position)

    @property
    def digest(self) -> str:
        """A name for what is equal for equal kinematics."""
        arrays = (self._rotations, self._positions, self._axes, self._ratio, self._offset)
        content = [b"" if array is None else array.tobytes() for array in arrays]
        return f"{zlib.crc32(repr([self._turns, self._places, *content]).encode()):08x}"

    def lever_bounds(self) -> Array | None:
        """Return how far the point moves at most for a rad of each joint [m/rad], (n,), at any configuration.

        None for an arm with slides, whose levers have no such bound.
        """
        if not all(self._turns):
            return None
        lengths = np.linalg.norm(self._positions[:, :, 0], axis=1)
        longest = np.zeros(self._n if self._ratio is None else self._ratio.shape[1])
        for i, place in enumerate(self._places):
            longest[place] = lengths[i + 1 :].sum()
        if self._ratio is None:
            return longest
        return np.asarray(longest @ np.abs(self._ratio[0]))

    def turn_bounds(self) -> Array:
        """Return by how much the frame turns at most for a rad of each joint [rad/rad], (n,)."""
        turned = np.zeros(self._n if self._ratio is None else self._ratio.shape[1])
        for place, turns in zip(self._places, self._turns, strict=True):
            turned[place] = float(turns)
        if self._ratio is None:
            return turned
        return np.asarray(turned @ np.abs(self._ratio[0]))

    def at(self, q: Array, v: Array) -> Motion:
        """Return where the point is and how it moves.

        Args:
            q: positions [rad or m], (n,) or (batch, n).
            v: velocities [rad/s or m/s], likewise.
        """
        return self.moving(self.chain(q), q, v)

    def moving(self, chain: Chain, q: Array, v: Array) -> Motion:
        """Return how the point moves, from where the joints are; arguments as of :meth:`at`."""
        rotation, position, axes, origins = chain
        _, all_v = self._whole(q, v)
        velocity: Any
        rate: Any
        levers: dict[int, tuple[Any, Any]]
        if _is_vector(position) and all(self._turns):  # all joints at once, with the same bits
            angular, speeds = np.stack(axes), all_v[list(self._places), None]
            linear = cross(angular, position - np.stack(origins))
            # One after the other, from 0.0 on: a sum of -0.0 alone is 0.0.
            velocity, rate = (np.add.accumulate(x * speeds)[-1] + 0.0 for x in (linear, angular))
            levers = dict(zip(self._places, zip(linear, angular, strict=True), strict=True))
            return Motion(rotation, position, velocity, rate, self._levers(levers))
        velocity, rate, levers = 0.0, 0.0, {}
        for i, (place, turns) in enumerate(zip(self._places, self._turns, strict=True)):
            zero = 0.0 * axes[i]
            lever = (cross(axes[i], position - origins[i]), axes[i]) if turns else (axes[i], zero)
            levers[place] = lever
            velocity = velocity + lever[0] * all_v[..., place, None]
            rate = rate + lever[1] * all_v[..., place, None]
        return Motion(rotation, position, velocity, rate, self._levers(levers))

    def chain(self, q: Array) -> Chain:
        """Return rotation and position of the point, and axis and origin of every joint before it."""
        all_q, _ = self._whole(q, q)
        turned = self._turned(all_q)
        rotation: Any = _IDENTITY
        position: Any = np.zeros((3, 1))
        axes = []
        origins = []
        for i, (place, turns) in enumerate(zip(self._places, self._turns, strict=True)):
            position = position + np.matmul(rotation, self._positions[i])
            rotation = np.matmul(rotation, self._rotations[i])
            axes.append(np.matmul(rotation, self._axes[i])[..., 0])
            origins.append(position[..., 0])
            if turns:
                rotation = np.matmul(rotation, turned[i])
            else:
                position = position + axes[-1][..., None] * all_q[..., place, None, None]
        position = (position + np.matmul(rotation, self._positions[-1]))[..., 0]
        rotation = np.matmul(rotation, self._rotations[-1])
        return Chain(rotation, position, axes, origins)

    def _turned(self, all_q: Any) -> Any:
        """Return the rotations of the joints about their axes: Rodrigues' 1 + sin(x) K + (1 - cos(x)) K^2."""
        if isinstance(all_q, np.ndarray):  # all at once, with the same bits
            x = all_q[..., list(self._places), None, None]
            turned = _IDENTITY + np.sin(x) * self._crosses + (1.0 - np.cos(x)) * self._squares
            return np.moveaxis(turned, -3, 0)
        rotations = []
        for place, cross, square in zip(self._places, self._crosses, self._squares, strict=True):
            x = all_q[..., place, None, None]
            rotations.append(_IDENTITY + np.sin(x) * cross + (1.0 - np.cos(x)) * square)
        return rotations

    def _whole(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return all coordinates of the model, those of joints that follow others included."""
        if self._ratio is None or self._offset is None:
            return q, v
        ratio = self._ratio[0]
        all_q = np.matmul(ratio, q[..., None])[..., 0] + self._offset[0, 0]
        return all_q, np.matmul(ratio, v[..., None])[..., 0]

    def _levers(self, found: dict[int, tuple[Any, Any]]) -> tuple[tuple[Array, Array] | None, ...]:
        """Return the levers of the arm's joints: with joints that follow, sums by their ratios."""
        if self._ratio is None:
            return tuple(found.get(joint) for joint in range(self._n))
        summed: list[tuple[Array, Array] | None] = []
        for joint in range(self._n):
            parts: Any = None
            for place, (linear, angular) in found.items():
                share = float(self._ratio[0, place, joint])
                if share != 0.0:
                    own = (share * linear, share * angular)
                    parts = own if parts is None else (parts[0] + own[0], parts[1] + own[1])
            summed.append(parts)
        return tuple(summed)


def _is_vector(x: Any) -> bool:
    """Tell whether something is one vector of numbers, no batch of them and no symbols."""
    return isinstance(x, np.ndarray) and x.ndim == 1


def cross(a: Any, b: Any) -> Any:
    """Return the cross product of (..., 3) and (..., 3)."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a[..., _NEXT] * b[..., _AFTER] - a[..., _AFTER] * b[..., _NEXT]
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def inner(a: Any, b: Any) -> Any:
    """Return the products of vectors (..., 3) and (..., 3), (..., 1)."""
    x, y, z = (a[..., axis : axis + 1] * b[..., axis : axis + 1] for axis in range(3))
    return x + y + z


def _dot(a: Any, b: Any) -> Any:
    """Return the product of (..., 3) and (..., 3), a number each."""
    return inner(a, b)[..., 0]


def cross_matrix(r: Array) -> Array:
    """Return the matrices K (..., 3, 3) of cross products, K x = r cross x, of vectors (..., 3)."""
    zero = np.zeros(r.shape[:-1])
    x, y, z = r[..., 0], r[..., 1], r[..., 2]
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _snapped(numbers: Any) -> Array:
    """Return entries that are 0, 1 or -1 but for rounding as that: 6e-17 is what is left of cos(pi / 2)."""
    values = np.array(numbers, dtype=np.float64)
    nearest = np.rint(values)
    return np.where(np.abs(values - nearest) < 1e-15, nearest, values)
