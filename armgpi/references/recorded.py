"""A recorded trajectory, of a teach-in, a planner or another run, as a reference that is smooth."""

from __future__ import annotations

import copy
import csv
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from armgpi.base import columns, files, hdf5
from armgpi.base.arrays import (
    SMALLEST,
    Array,
    ArrayLike,
    as_sized_array,
    as_times,
    check_number,
    check_path,
    check_type,
    check_whole,
)
from armgpi.base.escape import counted
from armgpi.errors import (
    ArrayError,
    LimitError,
    MissingPackage,
    NameNotFound,
    ParameterError,
    UnreadableTrajectory,
)
from armgpi.references.reference import Reference, Target
from armgpi.robot.equations import Equations

#: Larger files are no trajectories [bytes].
_MOST_BYTES = 256 * 1024 * 1024
#: Times between two samples at which velocities are compared with their limits.
_LOOKS = 4
#: Times that are closer than this share of the whole cannot be told apart.
_CLOSEST = 1e-9
#: First column of a CSV file.
_TIMES = ("time", "t")


class Recorded(Reference):
    """A spline of degree 5 through recorded positions, at rest before the first and after the last.

    Its velocities and accelerations are continuous everywhere, the ends included. It goes through every
    sample; so noise of a recording is in it, and many times that in its accelerations: thin a noisy one.

    Attributes:
        times: of the samples, the first at `t_start` [s], shape (m,).
        q: positions [rad or m], shape (m, n).
        t_start: when it begins [s].
        t_end: when it ends [s].
        source: where it came from, for messages and provenance.
    """

    def __init__(
        self, times: ArrayLike, q: ArrayLike, t_start: float = 0.0, source: str = "recording"
    ) -> None:
        """Define the trajectory.

        Args:
            times: increasing times [s], shape (m,), at least two.
            q: positions [rad or m], shape (m, n).
            t_start: when it begins [s]; the first sample is then.
            source: where it came from.

        Raises:
            ArrayError: when the arrays do not fit, are not finite, or times do not increase.
        """
        as_given = _increasing(times)
        positions = as_sized_array(q, "q")
        check_type(source, "source", str, "text")
        if positions.ndim != 2 or len(positions) != len(as_given):
            expected = f"positions (m, n) at {len(as_given)} times"
            raise ArrayError("q", f"expected {expected}, got {positions.shape}")
        self.t_start = check_number(t_start, "t_start", "zero or positive [s]", 0.0)
        since_first = as_given - as_given[0]
        self.times = since_first + self.t_start
        self.q = positions
        self.source = source
        self._duration = float(since_first[-1])
        self.t_end = self.t_start + self._duration
        zero = np.zeros(positions.shape[1])
        at_rest = [(1, zero), (2, zero)]  # first and second derivative
        # Over a parameter from 0 to 1, whatever the times are.
        shares = since_first / self._duration
        from scipy.interpolate import make_interp_spline  # here: it is slow to import

        spline = make_interp_spline(shares, positions, k=5, bc_type=(at_rest, at_rest))
        if not np.isfinite(spline.c).all():
            raise ArrayError("q", "expected positions that a spline in floats goes through")
        self._derivatives = (spline, spline.derivative(1), spline.derivative(2))

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        robot: Equations,
        t_start: float = 0.0,
        *,
        variable: str | None = None,
        rollout: int = 0,
    ) -> Recorded:
        """Read a trajectory from a file, joints by their names, and check it against the robot's limits.

        Args:
            path: CSV with the columns ``time`` [s] and one for each joint [rad or m]; NetCDF with a
                variable over ``time`` and ``joint``, such as a rollout; or MCAP with joint states.
            robot: the arm.
            t_start: when it begins [s].
            variable: of a NetCDF file ("q" when not given), or topic of MCAP ("/joint_states").
            rollout: which one, where there are several.

        Raises:
            UnreadableTrajectory: when the file cannot be read, or is none.
            NameNotFound: when it lacks a joint.
            LimitError: when a position or velocity is outside the limits.
        """
        source = check_path(path, "path")
        check_type(robot, "robot", Equations, "a Robot")
        if variable is not None:
            check_type(variable, "variable", str, "the name of a variable")
        rollout = check_whole(rollout, "rollout", 0)
        try:
            columns_by_name = _columns(source, variable, rollout)
        except OSError as error:
            raise UnreadableTrajectory(source, files.reason(error)) from None
        times = columns_by_name.pop("", np.empty(0))
        positions = []
        for name in robot.joint_names:
            if name not in columns_by_name:
                raise NameNotFound(f"column in {source} for the joint", name, list(columns_by_name))
            positions.append(columns_by_name[name])
        try:
            recording = cls(times, np.stack(positions, axis=-1), t_start, str(source))
        except ArrayError as error:
            raise UnreadableTrajectory(source, str(error)) from None
        recording.check(robot)
        return recording

    def check(self, robot: Equations) -> None:
        """Refuse a trajectory that leaves the robot's limits of position or velocity.

        Raises:
            LimitError: when it does; it names joint, time and value.
            ParameterError: when it is for other joints.
        """
        check_type(robot, "robot", Equations, "a Robot")
        if robot.n != self.q.shape[1]:
            raise ParameterError("robot", robot, f"a robot of {self.q.shape[1]} joints")
        steps = np.arange(_LOOKS) / _LOOKS
        starts = self.times[:-1, None]
        between = starts + np.diff(self.times)[:, None] * steps
        times = np.append(between.ravel(), self.t_end)
        target = self.at(times)
        outside = robot.outside(target.q)
        if outside is not None:
            at = times[outside.place[0]]
            raise LimitError(f"{self.source}: the position at t = {at:.4g} s", *outside[1:])
        limits = np.maximum(robot.limits.velocity, np.finfo(float).tiny)
        share = np.abs(target.v) / limits
        worst = np.unravel_index(int(share.argmax()), share.shape)
        row, joint = int(worst[0]), int(worst[1])
        if share[row, joint] > 1.0 + 1e-9:
            limit = float(robot.limits.velocity[joint])
            velocity = f"{self.source}: the velocity at t = {times[row]:.4g} s"
            remedy = "make it slower, or thin a noisy recording"
            name = robot.joint_names[joint]
            raise LimitError(velocity, name, target.v[row, joint], -limit, limit, remedy)

    def at(self, t: float | Array) -> Target:
        """Return the target at `t` [s]; shapes as :meth:`Reference.at`."""
        share = np.asarray((as_times(t) - self.t_start) / self._duration)
        inside = np.clip(share, 0.0, 1.0)
        q, dq, ddq = (np.asarray(derivative(inside)) for derivative in self._derivatives)
        moving = ((share > 0.0) & (share < 1.0))[..., None]
        v = dq / self._duration
        a = ddq / self._duration**2
        return Target(q, np.where(moving, v, 0.0), np.where(moving, a, 0.0))

    def widen(self, others: Sequence[Recorded]) -> Recorded:
        """Return this and others at the same times as one recording of all their joints, in their order."""
        recordings = [self, *others]
        wide = copy.copy(self)
        wide.q = np.concatenate([recording.q for recording in recordings], axis=1)
        joined = []
        # Value, first and second derivative; the knots of all recordings are the same.
        for splines in zip(*(recording._derivatives for recording in recordings), strict=True):
            coefficients = np.concatenate([spline.c for spline in splines], axis=1)
            first = splines[0]
            joined.append(type(first)(first.t, coefficients, first.k))
        wide._derivatives = tuple(joined)
        return wide

    def describe(self) -> dict[str, Any]:
        """Return where it came from and what it is, as plain data."""
        return {
            "type": "Recorded",
            "source": self.source,
            "samples": len(self.times),
            "t_start": self.t_start,
            "t_end": self.t_end,
        }

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"Recorded({self.source!r}, {len(self.times)} samples, {self.t_end:g} s)"


def _increasing(times: ArrayLike) -> Array:
    """Return times [s] as an array (m,), refusing fewer than two and those that do not increase."""
    array = as_sized_array(times, "times")
    is_listed = array.ndim == 1 and len(array) > 1
    whole = array[-1] - array[0] if is_listed else 0.0
    if whole <= SMALLEST or not (np.diff(array) > _CLOSEST * whole).all():
        expected = "at least two times [s], each later than the one before: dt * np.arange(m)"
        raise ArrayError("times", f"expected {expected}")
    return array


def _columns(source: Path, variable: str | None, rollout: int) -> dict[str, Array]:
    """Return the columns of a file by the joints' names, times under an empty one."""
    kind = source.suffix.lower()
    if kind in (".nc", ".nc4", ".h5"):
        return _netcdf(source, variable or "q", rollout)
    if kind == ".mcap":
        return joint_states(source, variable or "/joint_states", ("position",))["position"]
    return _csv(source)


def _csv(source: Path) -> dict[str, Array]:
    """Return the columns of a CSV file by their names, times under an empty one."""
    try:
        head, values = columns.read_table(source, _MOST_BYTES)
        if not head:
            raise ValueError("it is empty")
    except (ValueError, csv.Error) as error:
        reason = f"is no CSV file of numbers under a line of names: {files.reason(error)}"
        raise UnreadableTrajectory(source, reason) from None
    if head[0].lower() not in _TIMES:
        raise UnreadableTrajectory(
            source,
            f"has a first column named {head[0]!r}; expected time or t, which holds the time [s]. It has the "
            f"columns {', '.join(head)[:200]}",
        )
    if values.shape[1:] != (len(head),) or len(set(head)) < len(head):
        raise UnreadableTrajectory(
            source, f"has the columns {', '.join(head)[:200]}; expected time [s] and one for each joint"
        )
    by_name = dict(zip(head[1:], values.T[1:], strict=True))
    return {"": values[:, 0], **by_name}


def _netcdf(source: Path, variable: str, rollout: int) -> dict[str, Array]:
    """Return the same of a variable in a NetCDF file."""
    try:
        data = hdf5.load(source)[variable]
        if "rollout" in data.dims:
            count = data.sizes["rollout"]
            if rollout >= count:
                there = f"has {counted(count, 'rollout')}, numbered from 0"
                raise UnreadableTrajectory(source, f"{there}; expected one of them, got rollout {rollout}")
            data = data.isel(rollout=rollout)
        values = data.transpose("time", "joint")
        joints = [str(name) for name in values["joint"].values]
        by_joint = dict(zip(joints, values.values.T, strict=True))
        return {"": values["time"].values, **by_joint}
    except (FileNotFoundError, PermissionError, UnreadableTrajectory):
        raise
    except Exception as error:  # h5py has no one kind of error for a damaged file
        missing = f"has no variable {variable!r} over time and joint ({files.reason(error)})"
        raise UnreadableTrajectory(source, missing) from None


def joint_states(source: Path, topic: str, fields: Sequence[str]) -> dict[str, dict[str, Array]]:
    """Return fields of the joint states on a topic of an MCAP file: JSON, or ROS 2's own encoding.

    Returns:
        Of each field the columns by the joints' names, times [s] under an empty one.
    """
    rows: dict[str, dict[str, list[float]]] = {field: {} for field in fields}
    try:
        for time, state in columns.read_messages(source, topic, ("name", *fields), _MOST_BYTES):
            names = ["", *state["name"]]
            for field in fields:
                for name, value in zip(names, [time, *state[field]], strict=True):
                    rows[field].setdefault(name, []).append(float(value))
    except (OSError, MissingPackage):
        raise
    except Exception as error:  # the libraries have no one kind of error for a damaged file
        reason = f"cannot be read as joint states on {topic!r}: {files.reason(error)}"
        raise UnreadableTrajectory(source, reason) from None
    if not rows[fields[0]]:
        raise UnreadableTrajectory(source, f"has no message on the topic {topic!r}")
    arrays: dict[str, dict[str, Array]] = {}
    lengths: set[int] = set()
    for field in fields:
        arrays[field] = {name: np.array(numbers) for name, numbers in rows[field].items()}
        lengths.update(len(numbers) for numbers in arrays[field].values())
    if len(lengths) > 1:
        raise UnreadableTrajectory(source, f"has messages of different joints on {topic!r}")
    return arrays
