"""Poses: positions with rotations, as arrays, as files, and as a smooth path that a frame follows."""

from __future__ import annotations

import csv
import operator
from collections.abc import Sequence
from os import PathLike
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from armgpi.base import columns, files, hdf5
from armgpi.base.arrays import SMALLEST, Array, ArrayLike, as_sized_array, as_times, check_path
from armgpi.errors import ArrayError, MissingPackage, ParameterError, UnreadableTrajectory
from armgpi.references.paths import Path, PathPoint, Turning
from armgpi.robot.frame_motion import cross_matrix

#: How far a matrix may be from a rotation.
_SLACK = 1e-6
#: Largest turn from the first pose that a path of poses has [rad]: at a full turn its logarithm is singular.
_MOST_TURN = 1.75 * np.pi
#: A smaller turn is none but for rounding, as of numbers with six digits [rad].
_NO_TURN = 1e-6
#: Step of the central difference that gives the change of the Jacobian of the exponential [s].
_DIFFERENCE = 1e-5
#: Times that are closer than this share of the whole cannot be told apart.
_CLOSEST = 1e-9
#: Larger files are no recorded poses [bytes].
_MOST_BYTES = 256 * 1024 * 1024
#: Names of the numbers of a pose in files: position [m] and quaternion.
NUMBERS = ("x", "y", "z", "qx", "qy", "qz", "qw")


class Poses(NamedTuple):
    """Poses as arrays.

    Attributes:
        positions: [m], shape (m, 3).
        rotations: rotation matrices, shape (m, 3, 3).
    """

    positions: Array
    rotations: Array


class StampedPoses(NamedTuple):
    """Poses with the times at which they arrived.

    Attributes:
        times: [s], shape (m,).
        poses: the poses.
    """

    times: Array
    poses: Poses


def as_poses(poses: Any, name: str = "poses") -> Poses:
    """Return poses as arrays.

    Args:
        poses: a sequence of `pinocchio.SE3`, homogeneous matrices (m, 4, 4), or positions and quaternions
            (m, 7) in the order x, y, z [m], qx, qy, qz, qw.
        name: what they are called in messages.

    Raises:
        ArrayError: for arrays of other shapes, numbers that are not finite, matrices that are no rotations
            or have another last row than 0, 0, 0, 1, and quaternions of norm 0; it names the pose.
    """
    if isinstance(poses, Poses):
        return poses
    is_list = isinstance(poses, Sequence) and len(poses) > 0
    if is_list and all(hasattr(pose, "homogeneous") for pose in poses):
        poses = np.stack([pose.homogeneous for pose in poses])
    array = np.array(as_sized_array(poses, name))  # a copy: the caller's buffer may be filled again
    if array.ndim == 2 and array.shape[1] == 7:
        return Poses(array[:, :3], _of_quaternions(array[:, 3:], name))
    if array.ndim != 3 or array.shape[1:] != (4, 4):
        expected = "pinocchio.SE3 poses, matrices (m, 4, 4), or x, y, z, qx, qy, qz, qw (m, 7)"
        raise ArrayError(name, f"expected {expected}; got shape {array.shape}")
    rotations = array[:, :3, :3]
    not_orthogonal = np.abs(rotations @ rotations.swapaxes(-1, -2) - np.eye(3))
    off = not_orthogonal.max(axis=(-2, -1), initial=0.0)
    wrong = (off > _SLACK) | (np.linalg.det(rotations) < 0.0)
    if wrong.any():
        row = int(np.argmax(wrong))
        mirrored = "it is a reflection" if off[row] <= _SLACK else f"it is {off[row]:.2g} from one"
        raise ArrayError(name, f"pose {row}: expected a rotation matrix; {mirrored}")
    last_row = np.array([0.0, 0.0, 0.0, 1.0])
    bent = np.abs(array[:, 3] - last_row).max(axis=-1, initial=0.0) > _SLACK
    if bent.any():  # a transposed matrix has a rotation as well, and its position here
        row = int(np.argmax(bent))
        got = ", ".join(f"{x:g}" for x in array[row, 3])
        expected = f"pose {row}: expected a matrix with the last row 0, 0, 0, 1, not transposed"
        raise ArrayError(name, f"{expected}; got {got}")
    return Poses(array[:, :3, 3], rotations)


def _of_quaternions(quaternions: Array, name: str) -> Array:
    """Return the rotation matrices of quaternions (m, 4), x, y, z, w."""
    norms = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    if (norms < SMALLEST).any():
        row = int(np.argmin(norms))
        expected = f"pose {row}: expected a quaternion qx, qy, qz, qw of norm 1"
        raise ArrayError(name, f"{expected}; it has norm {norms[row, 0]:g}")
    x, y, z, w = (quaternions / norms).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def check_pose_times(times: ArrayLike, count: int, name: str = "times") -> Array:
    """Return times [s] as an array that increases, refusing others with the first that does not.

    Args:
        times: one per pose.
        count: number of poses.
        name: what they are called in messages.

    Raises:
        ArrayError: when there are more or fewer, or one is not later than the one before.
    """
    array = as_sized_array(times, name)
    if array.shape != (count,):
        raise ArrayError(name, f"expected {count} times [s], one for each pose; got shape {array.shape}")
    steps = np.diff(array)
    if (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0))
        order = f"pose {row + 1} is at {array[row + 1]:.6g} s, after {array[row]:.6g} s"
        raise ArrayError(name, f"expected times that increase; {order}")
    return array


class PosePath(Path):
    """A smooth path through poses, at rest at its first and its last one.

    Positions are a spline of degree five through the poses, and so are the rotation vectors of the poses
    relative to the first one. Velocities and accelerations are continuous everywhere.

    Attributes:
        times: of the poses [s], the first at 0, shape (m,).
        poses: the poses.
        t_end: when it is over [s].
    """

    def __init__(self, times: ArrayLike, poses: Any) -> None:
        """Define the path.

        Args:
            times: increasing times [s], shape (m,), at least two; the path begins at the first.
            poses: m poses: `pinocchio.SE3`, matrices (m, 4, 4), or x, y, z, qx, qy, qz, qw (m, 7).

        Raises:
            ArrayError: for arrays that do not fit, times that do not increase, or what is no pose.
            ParameterError: for rotations that turn by more than 315 degrees from the first one.
        """
        self.poses = as_poses(poses)
        positions, rotations = self.poses
        arrivals = check_pose_times(times, len(positions))
        if len(arrivals) < 2:
            raise ArrayError("times", f"expected at least two poses, got {len(arrivals)}")
        self.times = arrivals - arrivals[0]
        self.t_end = float(self.times[-1])
        turns = _continuous(rotations)
        from scipy.interpolate import make_interp_spline  # here: it is slow to import

        at_rest = [(1, np.zeros(6)), (2, np.zeros(6))]  # first and second derivative
        values = np.concatenate([positions, turns], axis=-1)
        shares = self.times / self.t_end
        spline = make_interp_spline(shares, values, k=5, bc_type=(at_rest, at_rest))
        self._derivatives = (spline, spline.derivative(1), spline.derivative(2))
        between = spline(np.linspace(0.0, 1.0, 20 * len(arrivals)))
        longest = np.linalg.norm(between[:, 3:], axis=-1).max()
        if longest > _MOST_TURN:
            expected = "rotations that turn by at most 315 degrees from the first"
            raise ParameterError("poses", "a longer turn", f"{expected}; part the path into several")

    @classmethod
    def load(cls, path: str | PathLike[str], topic: str = "/target_pose") -> PosePath:
        """Read a path from a file of poses; see :func:`load_poses`."""
        times, poses = load_poses(path, topic)
        return cls(times, poses)

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        return PathPoint(*(part[..., :3] for part in self._parts(t)))

    def turning(self, t: float | Array) -> Turning:
        """Return rotation, angular velocity and acceleration; see :meth:`Path.turning`."""
        r, rate, acceleration = (part[..., 3:] for part in self._parts(t))
        first = self.poses.rotations[0]
        jacobian = jacobian_of_exp(r)
        after = jacobian_of_exp(r + _DIFFERENCE * rate)
        before = jacobian_of_exp(r - _DIFFERENCE * rate)
        change = (after - before) / (2.0 * _DIFFERENCE)  # of the Jacobian [1/s]
        omega = np.einsum("...ij,...j->...i", first @ jacobian, rate)
        alpha = np.einsum("...ij,...j->...i", first @ jacobian, acceleration)
        alpha = alpha + np.einsum("...ij,...j->...i", first @ change, rate)
        return Turning(first @ exponential(r), omega, alpha)

    def describe_time(self, t: float) -> str:
        """Return between which poses a time [s] is; they are counted from 0."""
        after = int(np.searchsorted(self.times, t - 1e-9))
        if after < len(self.times) and abs(self.times[after] - t) <= 1e-9:
            return f"t = {t:.4g} s (pose {after})"
        return f"t = {t:.4g} s (between poses {after - 1} and {after})"

    def describe(self) -> dict[str, Any]:
        """Return the path as plain data."""
        positions, rotations = self.poses
        poses = np.concatenate([positions, rotations.reshape(-1, 9)], axis=-1)
        return {"type": "PosePath", "times": self.times.tolist(), "poses": poses.tolist()}

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"PosePath({len(self.times)} poses, {self.t_end:g} s)"

    def _parts(self, t: float | Array) -> tuple[Array, Array, Array]:
        """Return positions and rotation vectors with two derivatives, (..., 6) each."""
        share = as_times(t) / self.t_end
        inside = np.clip(share, 0.0, 1.0)
        x, dx, ddx = (np.asarray(derivative(inside)) for derivative in self._derivatives)
        moving = np.asarray((share > 0.0) & (share < 1.0))[..., None]
        v = dx / self.t_end
        a = ddx / self.t_end**2
        return x, np.where(moving, v, 0.0), np.where(moving, a, 0.0)


def exponential(r: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad] (Rodrigues)."""
    angle = np.linalg.norm(r, axis=-1)[..., None, None]
    cross = cross_matrix(r)
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + a * cross + b * (cross @ cross))


def logarithm(rotations: Array) -> Array:
    """Return the rotation vectors (..., 3) [rad] of rotation matrices (..., 3, 3), of at most half a turn."""
    from scipy.spatial.transform import Rotation  # here: it takes longer to import than Pinocchio

    listed = Rotation.from_matrix(rotations.reshape(-1, 3, 3))
    vectors = np.asarray(listed.as_rotvec())
    return vectors.reshape(*rotations.shape[:-2], 3)


def jacobian_of_exp(r: Array) -> Array:
    """Return the matrices (..., 3, 3) that make angular velocities of rates of rotation vectors (..., 3).

    It is the left Jacobian of the rotation group: 1 + (1 - cos a) / a^2 K + (a - sin a) / a^3 K^2.
    """
    angle = np.linalg.norm(r, axis=-1)[..., None, None]
    cross = cross_matrix(r)
    b = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    series = (1.0 - angle**2 / 20.0) / 6.0
    c = np.where(small, series, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) + b * cross + c * (cross @ cross))


def _continuous(rotations: Array) -> Array:
    """Return rotation vectors relative to the first rotation, each the one nearest to that before it."""
    turns = logarithm(rotations[0].T @ rotations)
    for row in range(1, len(turns)):
        angle = float(np.linalg.norm(turns[row]))
        before = float(np.linalg.norm(turns[row - 1]))
        if angle < _NO_TURN and before < np.pi:
            continue
        # No turn has no axis of its own: it ends the full turn that was begun.
        axis = turns[row - 1] / before if angle < _NO_TURN else turns[row] / angle
        # A turn about an axis by a full turn more or less is the same rotation.
        choices = np.array([axis * (angle + 2.0 * np.pi * k) for k in (-1, 0, 1)])
        distances = np.linalg.norm(choices - turns[row - 1], axis=-1)
        turns[row] = choices[np.argmin(distances)]
    return turns


def load_poses(path: str | PathLike[str], topic: str = "/target_pose") -> StampedPoses:
    """Read poses with their times from a file.

    Args:
        path: CSV with the columns ``time, x, y, z, qx, qy, qz, qw`` [s, m]; NetCDF with variables of these
            names over ``time``; or MCAP with `geometry_msgs/PoseStamped`.
        topic: of MCAP.

    Returns:
        Times [s], as they are in the file, and poses.

    Raises:
        UnreadableTrajectory: when the file cannot be read, or has no such poses; it names the pose.
    """
    source = check_path(path, "path")
    try:
        times, numbers = _read(source, topic)
        poses = as_poses(numbers)
        return StampedPoses(check_pose_times(times, len(numbers)), poses)
    except OSError as error:
        raise UnreadableTrajectory(source, files.reason(error)) from None
    except ArrayError as error:
        raise UnreadableTrajectory(source, str(error)) from None


def _read(source: FilePath, topic: str) -> tuple[Array, Array]:
    """Return times and numbers (m, 7) of a file."""
    kind = source.suffix.lower()
    try:
        if kind in (".nc", ".nc4", ".h5"):
            data = hdf5.load(source)
            numbers = [data[name].values for name in NUMBERS]
            return data["time"].values, np.stack(numbers, axis=-1)
        if kind == ".mcap":
            return _messages(source, topic)
        head, values = columns.read_table(source, _MOST_BYTES)
        column = dict(zip(head, values.T, strict=True))
        numbers = [column[name] for name in NUMBERS]
        return column["time"], np.stack(numbers, axis=-1)
    except (OSError, MissingPackage):
        raise
    except KeyError as error:
        missing = f"has no {error}; expected time, {', '.join(NUMBERS)}"
        raise UnreadableTrajectory(source, missing) from None
    except (ValueError, csv.Error) as error:
        raise UnreadableTrajectory(source, f"cannot be read as poses: {files.reason(error)}") from None
    except UnreadableTrajectory:
        raise
    except Exception as error:  # the libraries have no one kind of error for a damaged file
        raise UnreadableTrajectory(source, f"cannot be read as poses: {files.reason(error)}") from None


def _messages(source: FilePath, topic: str) -> tuple[Array, Array]:
    """Return times and numbers of the PoseStamped messages on a topic."""
    times = []
    rows = []
    for time, message in columns.read_messages(source, topic, ("pose",), _MOST_BYTES):
        pose = message["pose"]
        read = operator.getitem if isinstance(pose, dict) else getattr  # JSON, or ROS 2's own encoding
        position = read(pose, "position")
        quaternion = read(pose, "orientation")
        times.append(time)
        numbers = [read(position, axis) for axis in "xyz"]
        numbers += [read(quaternion, axis) for axis in "xyzw"]
        rows.append([float(number) for number in numbers])
    if not rows:
        raise UnreadableTrajectory(source, f"has no message on the topic {topic!r}")
    return np.array(times), np.array(rows)
