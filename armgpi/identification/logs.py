"""A log: what was measured and commanded, on a uniform grid, whatever it came from."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base import files
from armgpi.base.arrays import Array, as_sized_array, check_choice, check_path, check_type
from armgpi.base.columns import read_table
from armgpi.errors import ArrayError, NameNotFound, ParameterError, UnreadableTrajectory
from armgpi.loop.log import ENDING, ArmLog, read
from armgpi.references.recorded import joint_states
from armgpi.robot.robot import Robot

#: A log's times may differ from a uniform grid by this share of a sample before it is interpolated.
_JITTER = 0.01
#: Samples that are missing in a row before what is between is a gap, and the least length of one [s].
_GAP, _LEAST_GAP = 5.0, 0.02
#: Fewest samples of a log.
_FEWEST = 20
#: What columns of a CSV file are called; JOINT is its name, and NUMBER its number, from 1.
_COLUMNS = {
    "time": ("time", "t", "timestamp", "stamp"),
    "q": (
        "q_JOINT",
        "position_JOINT",
        "pos_JOINT",
        "JOINT_position",
        "JOINT_pos",
        "JOINT.position",
        "JOINT/position",
    ),
    "tau": (
        "tau_JOINT",
        "torque_JOINT",
        "effort_JOINT",
        "JOINT_torque",
        "JOINT_effort",
        "JOINT.effort",
        "JOINT/effort",
        "current_JOINT",
        "tau_motor_JOINT",
        "tau_joint_JOINT",
        "tau_commanded_JOINT",
    ),
}
#: What a torque is: that of the motor (its current times a constant), that of a sensor behind the gear, or
#: that which was commanded; and what names of columns say of it.
TORQUES = ("motor", "joint", "commanded")
_SAID = {
    "current_JOINT": "motor",
    "tau_motor_JOINT": "motor",
    "tau_joint_JOINT": "joint",
    "tau_commanded_JOINT": "commanded",
}
#: What columns of currents are called, and their units.
_CURRENT = "current_JOINT"
_AMPERES = ("A", "mA")
#: Units that may follow a column's name in brackets, in SI units.
_UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "q": {
        "rad": 1.0,
        "deg": np.pi / 180.0,
        "°": np.pi / 180.0,
        "m": 1.0,
        "mm": 1e-3,
    },
    "tau": {
        "Nm": 1.0,
        "N": 1.0,
        "A": 1.0,
        "kNm": 1e3,
        "kN": 1e3,
        "mNm": 1e-3,
        "Nmm": 1e-3,
        "mA": 1e-3,
    },
}
#: A column's name, and its unit.
_NAME_AND_UNIT = re.compile(r"^(.*?)\s*(?:\[(.*)\])?$")
#: Topics of an MCAP file that are looked at in turn: those of armgpi's own, and ROS's.
_TOPICS = ("measured", "/joint_states", "joint_states")
#: Larger files are no logs [bytes].
_MOST_BYTES = 1 << 30


class Log(NamedTuple):
    """Positions and torques of an arm that moved, sample by sample.

    A torque holds from its time to the next one. Times need not be uniform.

    Attributes:
        t: increasing times [s], shape (k,).
        q: measured positions [rad or m], shape (k, n).
        tau: commanded torques [N m or N], shape (k, n).
        source: where it came from, for messages.
        torque: what the torques are: "motor", "joint" (a sensor behind the gear) or "commanded"; empty where
            nobody said.
        currents: whether they are currents, which need torque constants.
    """

    t: Array
    q: Array
    tau: Array
    source: str = "log"
    torque: str = ""
    currents: bool = False


class Grid(NamedTuple):
    """A log at uniform times.

    Attributes:
        dt: sample time [s].
        q: positions [rad or m], shape (k, n).
        tau: mean torque from each time to the next [N m or N], shape (k, n).
        bad: which samples are in a gap of the log, shape (k,).
    """

    dt: float
    q: Array
    tau: Array
    bad: npt.NDArray[np.bool_]


def read_log(log: Any, robot: Robot, rollout: int = 0, columns: Mapping[str, str] | None = None) -> Log:
    """Return a checked log of an arm.

    Args:
        log: a :class:`Log`; a rollout, whose measured positions and commanded torques are taken until it
            ends; a log of an arm (:mod:`armgpi.loop.log`) or its path; or the path of a NetCDF file with a
            rollout, of an MCAP file with positions and efforts of joint states, or of a CSV file with the
            columns ``time`` [s], ``q_<joint>`` and ``tau_<joint>``, or others with units such as ``[deg]``.
        robot: whose joints they are.
        rollout: which one of several.
        columns: "time", "q" and "tau" -> what columns of a CSV file are called: JOINT is a joint's name, and
            NUMBER its number from 1.

    Raises:
        ArrayError: for other shapes, numbers that are not finite, or times that do not increase.
        NameNotFound: for a file without a column of a joint.
        UnreadableTrajectory: for a file that cannot be read.
        ParameterError: for something else.
    """
    check_type(robot, "robot", Robot, "a Robot")
    if isinstance(log, (str, Path)):
        log = _read_file(check_path(log, "log"), robot, rollout, columns)
    if isinstance(log, ArmLog):
        log = _of_arm_log(log, robot)
    if hasattr(log, "data_vars"):
        log = _of_rollout(log, robot, rollout)
    if not isinstance(log, Log):
        raise ParameterError("log", log, "a Log, a rollout or the path of a CSV, NetCDF or MCAP file")
    t, q, tau = (as_sized_array(getattr(log, name), f"{log.source}: {name}") for name in ("t", "q", "tau"))
    if t.ndim != 1 or len(t) < _FEWEST:
        raise ArrayError(f"{log.source}: t", f"expected at least {_FEWEST} increasing times [s]")
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if back.size:
        first = int(back[0])
        said = f"increasing times [s], got {t[first + 1]:.6g} after {t[first]:.6g} (sample {first + 2})"
        raise ArrayError(f"{log.source}: t", f"expected {said}: cut the log there, or sort its rows")
    for name, array in (("q", q), ("tau", tau)):
        if array.shape != (len(t), robot.n):
            raise ArrayError(
                f"{log.source}: {name}",
                f"expected shape ({len(t)}, {robot.n}), a row for each time and a column for each joint; "
                f"got {array.shape}",
            )
    if log.torque:
        check_choice(log.torque, f"{log.source}: torque", TORQUES)
    return Log(t, q, tau, log.source, log.torque, log.currents)


def with_torques(log: Log, current: Array | None) -> Log:
    """Return a log of torques for one that may be of currents.

    Args:
        log: of either.
        current: torque at the joint for a unit of what is logged [N m/A or N/A], (n,); None for torques.

    Raises:
        ParameterError: for currents without these constants.
    """
    if current is not None:
        return log._replace(tau=current * log.tau, currents=False)
    if log.currents:
        wanted = f"torque constants at the joints [N m/A or N/A], as the columns of {log.source} are currents"
        raise ParameterError("current", None, f"{wanted}; 1 where these are torques")
    return log


def resample(log: Log) -> Grid:
    """Return a log at uniform times; a torque's integral over time stays what it is."""
    steps = np.diff(log.t)
    dt = float(np.median(steps))
    if np.abs(steps - dt).max() <= _JITTER * dt:
        return Grid(dt, log.q, log.tau, np.zeros(len(log.t), dtype=bool))
    from scipy.interpolate import CubicSpline  # here: it is slow to import

    times = np.arange(log.t[0], log.t[-1], dt)
    q = CubicSpline(log.t, log.q)(times)
    impulses = np.cumsum(log.tau[:-1] * steps[:, None], axis=0)
    integral = np.vstack([np.zeros(log.q.shape[1]), impulses])
    ends = np.append(times, times[-1] + dt)
    columns = [np.interp(ends, log.t, column) for column in integral.T]
    summed = np.stack(columns, axis=-1)
    before = np.searchsorted(log.t, times, side="right") - 1
    before = np.clip(before, 0, len(steps) - 1)
    bad = steps[before] > max(_GAP * dt, _LEAST_GAP)
    return Grid(dt, q, np.diff(summed, axis=0) / dt, bad)


def _of_rollout(rollout: Any, robot: Robot, index: int) -> Log:
    """Return the log of a rollout until it ended."""
    if "q_measured" not in rollout or "tau_command" not in rollout:
        raise ParameterError("log", rollout, "a rollout with q_measured and tau_command")
    if "rollout" in rollout.dims:
        rollout = rollout.isel(rollout=index)
    names = [str(name) for name in rollout["joint"].values]
    q, tau = (rollout[name].transpose("time", "joint").values for name in ("q_measured", "tau_command"))
    return _until_the_end(rollout["time"].values, q, tau, names, robot)


def _of_rollout_file(path: Path, robot: Robot, index: int) -> Log:
    """Return the log of a rollout in a file until it ended."""
    from armgpi.loop.rollout import load_variables

    variables = load_variables(path, ("time", "joint", "q_measured", "tau_command"))
    samples = []
    for name in ("q_measured", "tau_command"):
        if name not in variables:
            raise ParameterError("log", str(path), "a rollout with q_measured and tau_command")
        dimensions, values = variables[name]
        if "rollout" in dimensions:
            values = np.take(values, index, axis=dimensions.index("rollout"))
            dimensions = tuple(other for other in dimensions if other != "rollout")
        order = [dimensions.index(axis) for axis in ("time", "joint")]
        samples.append(values.transpose(order))
    q, tau = samples
    names = [str(name) for name in variables["joint"].values]
    return _until_the_end(variables["time"].values, q, tau, names, robot)._replace(source=str(path))


def _until_the_end(t: Array, q: Array, tau: Array, names: Sequence[str], robot: Robot) -> Log:
    """Return the log of a rollout until it ended; torques beyond the limits are clipped as the motors do.

    Raises:
        ParameterError: for joints with other names.
    """
    if list(names) != list(robot.joint_names):
        raise ParameterError("log", ", ".join(names), f"a rollout of {', '.join(robot.joint_names)}")
    is_there = _finite_rows(q) & _finite_rows(tau)
    count = len(t) if is_there.all() else int(np.argmin(is_there))
    limit = robot.limits.effort
    return Log(t[:count], q[:count], np.clip(tau[:count], -limit, limit), "rollout", "motor")


def _finite_rows(values: Array) -> npt.NDArray[np.bool_]:
    """Return in which samples all joints have a finite number, (k,), of values (k, n)."""
    return np.asarray(np.isfinite(values).all(axis=1), dtype=np.bool_)


def _of_arm_log(log: ArmLog, robot: Robot) -> Log:
    """Return the samples of a log of an arm, with the torque that was applied where the robot says it."""
    rows, names = log.samples, log.header["joints"]
    if names != list(robot.joint_names):
        raise ParameterError(log.source, ", ".join(names), f"a log of {', '.join(robot.joint_names)}")
    q, commanded = rows["q_measured"], rows["tau"]
    applied = np.vstack([rows["applied"][1:], commanded[-1:]])  # of a sample the next one says
    tau = np.where(np.isfinite(applied), applied, commanded)
    is_good = _finite_rows(q)
    kind = str(log.header.get("torque", ""))
    return Log(log.t[is_good], q[is_good], tau[is_good], log.source, kind)


def _read_file(path: Path, robot: Robot, rollout: int, columns: Mapping[str, str] | None) -> Any:
    """Return the log, or the rollout, in a file."""
    ending = path.suffix.lower()
    try:
        if ending == ENDING:
            return _of_arm_log(read(path), robot)
        if ending in (".nc", ".nc4", ".h5"):
            return _of_rollout_file(path, robot, rollout)
        if ending == ".mcap":
            return _of_states(path, robot)
        head, table = _read_table(path)
    except OSError as error:
        raise UnreadableTrajectory(path, f"{files.reason(error)}; give a log's file") from None
    columns = columns or {}
    t, q, tau = (_columns(path, head, table, key, robot, columns) for key in ("time", "q", "tau"))
    form = _form(head, "tau", robot.joint_names, columns)
    kind = "" if "tau" in columns else _SAID.get(form, "")
    torques = _of_joints(form, robot.joint_names)
    currents = form == _CURRENT or _have_unit(head, torques, _AMPERES)
    return Log(t[:, 0], q, tau, str(path), kind, currents)


def _read_table(path: Path) -> tuple[list[str], Array]:
    """Return the names and the numbers of a CSV file.

    Raises:
        OSError: when it cannot be read.
        UnreadableTrajectory: when it is none, has no rows, or others than of finite numbers.
    """
    try:
        head, table = read_table(path, _MOST_BYTES)
    except (ValueError, csv.Error) as error:
        binary = isinstance(error, UnicodeDecodeError)
        said = "it is binary" if binary else " ".join(str(error).split())[:200].rstrip(".")
        raise UnreadableTrajectory(path, f"is no CSV file of numbers under names: {said}") from None
    if head and all(_is_number(name) for name in head):
        raise UnreadableTrajectory(
            path, "has numbers in its first line, expected names: time, q_JOINT and tau_JOINT of each joint"
        )
    if not len(table):
        raise UnreadableTrajectory(path, "has no rows: expected names, and numbers below them")
    if table.shape[1:] != (len(head),):
        raise UnreadableTrajectory(path, f"has {len(head)} names above {table.shape[1]} columns")
    if (row := np.argwhere(~np.isfinite(table))).size:
        line, column = int(row[0][0]), int(row[0][1])
        raise UnreadableTrajectory(
            path, f"line {line + 2}: {head[column]} is no finite number; leave such rows out"
        )
    return head, table


def _is_number(text: str) -> bool:
    """Tell whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _columns(
    path: Path, head: list[str], table: Array, key: str, robot: Robot, columns: Mapping[str, str]
) -> Array:
    """Return the columns of the joints, or of time, in SI units and in their order."""
    names, units = _names_and_units(head)
    joints = ["time"] if key == "time" else robot.joint_names
    form = _form(head, key, joints, columns)
    in_order = []
    for name in _of_joints(form, joints):
        if name not in names:
            raise NameNotFound(f"column in {path} (or say what it is called by columns)", name, names)
        place = names.index(name)
        unit = re.sub(r"[\s·*]", "", units[place])
        if unit and unit not in _UNITS[key]:
            raise UnreadableTrajectory(path, f"{name} is in {unit!r}, expected {', '.join(_UNITS[key])}")
        factor = _UNITS[key].get(unit, 1.0)
        in_order.append(table[:, place] * factor)
    return np.stack(in_order, axis=-1)


def _have_unit(head: Sequence[str], wanted: Sequence[str], units: Sequence[str]) -> bool:
    """Tell whether any of some columns has one of some units in its brackets."""
    pairs = zip(*_names_and_units(head), strict=True)
    return any(name in wanted and unit in units for name, unit in pairs)


def _names_and_units(head: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of columns, and their units in brackets; empty for none."""
    pairs = [_NAME_AND_UNIT.findall(column)[0] for column in head]
    return tuple(name for name, _ in pairs), tuple(unit for _, unit in pairs)


def _of_joints(form: str, joints: Sequence[str]) -> list[str]:
    """Return what a form of names makes of the joints."""
    names = []
    for number, joint in enumerate(joints, start=1):
        numbered = form.replace("NUMBER", str(number))
        names.append(numbered.replace("JOINT", joint))
    return names


def _form(head: Sequence[str], key: str, joints: Sequence[str], columns: Mapping[str, str]) -> str:
    """Return the form of names that most joints have; where none has all, the message names the first."""
    names, _ = _names_and_units(head)
    forms = [columns[key]] if key in columns else _COLUMNS[key]

    def count(form: str) -> int:
        return sum(name in names for name in _of_joints(form, joints))

    return max(forms, key=count)


def _of_states(path: Path, robot: Robot) -> Log:
    """Return positions and efforts of the joint states of an MCAP file."""
    failed: UnreadableTrajectory | None = None
    for topic in _TOPICS:
        try:
            states = joint_states(path, topic, ("position", "effort"))
        except UnreadableTrajectory as error:
            failed = failed or error if "no message" in str(error) else error
            continue
        for name in robot.joint_names:
            if name not in states["position"]:
                raise NameNotFound(f"joint in {path}", name, [*filter(None, states["position"])])
        names = robot.joint_names
        q = np.stack([states["position"][name] for name in names], axis=-1)
        tau = np.stack([states["effort"][name] for name in names], axis=-1)
        is_good = _finite_rows(q) & _finite_rows(tau)
        times = states["position"][""]
        return Log(times[is_good] - times[:1], q[is_good], tau[is_good], str(path))
    assert failed is not None
    raise failed
