"""The log of a controlled arm: one file format for hardware, two processes and simulation, and its replay.

A file of a log (`.armlog`) is little endian throughout:

====== ================= ==============================================================================
offset type              meaning
====== ================= ==============================================================================
0      8 x u8            ``ARMGPILG``
8      u32               version of this format, 1
12     u32               bytes of the header
16     UTF-8             the header, JSON: `joints`, `dt` [s], `inputs`, and what is known besides
then   rows of one size:
0      u64               number of the sample, in sample times
8      u32               event: 0 a sample, 1 a start (init), 2 a start that keeps the torque (reset)
12     4 x u32           the controller's status, reason and joint; sample times since the last row
28     u32               unused, 0
32     n x f64 each      the inputs in the header's order; the torque sent; the torque that the robot says it
                         applies, NaN where it does not say
====== ================= ==============================================================================

The C of an exported controller (``armgpi_log.h``) writes the same, from memory that it was given.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import IntEnum
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base import files
from armgpi.base.arrays import Array, check_path, check_type
from armgpi.base.version import VERSION, other_format
from armgpi.control.controller import FullState, Measurement
from armgpi.errors import NameNotFound, ParameterError, RolloutError
from armgpi.references.reference import Target
from armgpi.robot.robot import Robot
from armgpi.supervisor import OF_TOOL, Reason, State

if TYPE_CHECKING:
    import xarray as xr

#: Begin of a file.
MAGIC = b"ARMGPILG"
#: Version of the format.
VERSION_OF_FORMAT = 1
#: Ending of a file's name.
ENDING = ".armlog"
#: What a controller may be given in a sample, in this order.
INPUTS = ("q_measured", "v_measured", "q_ref", "v_ref", "a_ref")
#: Longest header [bytes].
_LONGEST = 1 << 20
#: Largest file [bytes].
_LARGEST = 1 << 32
#: Most joints.
_MOST_JOINTS = 1000
#: Bytes before the header: magic, version and the header's length.
_PREAMBLE = 16
#: Largest number of a sample: up to it floats have all whole numbers.
_MOST_SAMPLES = 1 << 53
_COUNTS = ("event", "status", "reason", "joint", "elapsed", "unused")


class Event(IntEnum):
    """What a row of the log records: a sample, an init or a reset."""

    SAMPLE = 0
    INIT = 1
    RESET = 2


class ArmLog(NamedTuple):
    """What a controller was given and what it answered, sample by sample.

    Attributes:
        header: `joints` (their names), `dt` [s], `inputs` (which of `q_measured`, `v_measured`, `q_ref`,
            `v_ref`, `a_ref`), and what is known besides: `robot`, `made_by`, `layout` (of the exported
            controller), `diverged` (when a simulated arm was lost [s]).
        rows: structured array (k,) with the fields of a row, see :mod:`armgpi.loop.log`.
        source: where it came from, for messages.
    """

    header: Mapping[str, Any]
    rows: npt.NDArray[np.void]
    source: str = "log"

    @property
    def samples(self) -> npt.NDArray[np.void]:
        """Rows that are samples, not starts."""
        samples: npt.NDArray[np.void] = self.rows[self.rows["event"] == Event.SAMPLE]
        return samples

    @property
    def inputs(self) -> dict[str, Array]:
        """Name -> what the controller was given in each sample, (samples, n)."""
        return {name: self.samples[name] for name in self.header["inputs"]}

    @property
    def t(self) -> Array:
        """Time of each sample [s], (samples,)."""
        return np.asarray(self.samples["number"] * float(self.header["dt"]))

    @property
    def tau(self) -> Array:
        """Torque sent in each sample [N m or N], (samples, n)."""
        return np.asarray(self.samples["tau"])

    @property
    def fault(self) -> str | None:
        """First fault in words, as "2.315 s: REFERENCE (elbow)"; None where there is none."""
        faulty = self.samples[self.samples["reason"] > Reason.NONE]
        if not len(faulty):
            return None
        row = faulty[0]
        reason = Reason(row["reason"])
        joint = self.header["joints"][row["joint"]]
        named = "" if reason in OF_TOOL else f" ({joint})"
        return f"{row['number'] * self.header['dt']:.4g} s: {reason.name}{named}"


def row_type(inputs: tuple[str, ...], n: int) -> np.dtype[np.void]:
    """Return the type of a row for these inputs and n joints."""
    counts = [(name, "<u4") for name in _COUNTS]
    of_joints = [(name, "<f8", (n,)) for name in (*inputs, "tau", "applied")]
    return np.dtype([("number", "<u8"), *counts, *of_joints])


class LogWriter:
    """Rows in memory that is there from the start; when it is full the oldest are overwritten."""

    def __init__(
        self, joints: tuple[str, ...], dt: float, inputs: tuple[str, ...], room: int, **known: Any
    ) -> None:
        """Make room for so many rows; `known` goes into the header."""
        self._header = _plain_header(joints, dt, inputs, known)
        self._inputs = inputs
        self._rows = np.zeros(room, row_type(inputs, len(joints)))
        self._count = 0

    def take(
        self,
        number: int,
        measured: Measurement | FullState,
        target: Target,
        tau: Array,
        *,
        event: Event = Event.SAMPLE,
        report: tuple[int, int, int] = (State.RUN, Reason.NONE, 0),
        elapsed: int = 1,
        applied: Array | None = None,
    ) -> None:
        """Keep a row.

        Args:
            number: of the sample.
            measured: what the controller was given.
            target: likewise.
            tau: what it answered [N m or N], (n,).
            event: a sample, or a start before it.
            report: status, reason and index of the joint.
            elapsed: sample times since the last row.
            applied: torque that the robot says it applies [N m or N], (n,).
        """
        row = self._rows[self._count % len(self._rows)]
        row["number"] = number
        row["event"] = event
        row["elapsed"] = elapsed
        row["status"], row["reason"], row["joint"] = report
        inputs = {f"{name}_measured": values for name, values in measured._asdict().items()}
        inputs |= {f"{name}_ref": values for name, values in target._asdict().items()}
        for name in self._inputs:
            row[name] = inputs[name]
        row["tau"] = tau
        row["applied"] = np.nan if applied is None else applied
        self._count += 1

    def log(self) -> ArmLog:
        """Return what is there, the oldest row first."""
        return ArmLog(self._header, np.roll(self._rows[: self._count], -self._count))


def of_samples(
    joints: tuple[str, ...],
    dt: float,
    inputs: Mapping[str, Array],
    tau: Array,
    reports: Array | None = None,
    **known: Any,
) -> ArmLog:
    """Return the log of samples of which none was missed, after a start with what the first was given.

    Args:
        joints: their names.
        dt: sample time [s].
        inputs: what the controller was given, name -> array (samples, n).
        tau: what it answered [N m or N], (samples, n).
        reports: status, reason and index of the joint, (samples, 3); RUN when not given.
        known: goes into the header.
    """
    names = tuple(name for name in INPUTS if name in inputs)
    rows = np.zeros(len(tau) + 1, row_type(names, len(joints)))
    rows["number"][1:] = np.arange(len(tau))
    rows["elapsed"][1:] = 1
    rows["event"][0] = Event.INIT
    rows["status"] = State.RUN
    if reports is not None:
        for name, column in zip(("status", "reason", "joint"), reports.T, strict=True):
            rows[name][1:] = column
    for name in names:
        rows[name][0] = inputs[name][0]
        rows[name][1:] = inputs[name]
    rows["tau"][1:] = tau
    rows["applied"] = np.nan
    return ArmLog(_plain_header(joints, dt, names, known), rows)


def _plain_header(
    joints: tuple[str, ...], dt: float, inputs: tuple[str, ...], known: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the header of a log that Python writes."""
    header = {"joints": list(joints), "dt": dt, "inputs": list(inputs), "made_by": f"armgpi {VERSION}"}
    return {**header, **known}


def write(log: ArmLog, path: str | PathLike[str]) -> Path:
    """Write a log to a file, whole or not at all.

    Raises:
        RolloutError: when it cannot be written.
        ParameterError: when an argument is not as it should be.
    """
    check_type(log, "log", ArmLog, "an ArmLog")
    return files.write(check_path(path, "path"), pack(log))


def pack(log: ArmLog) -> bytes:
    """Return a log as the bytes of a file."""
    return preamble(log.header) + log.rows.tobytes()


def preamble(header: Mapping[str, Any]) -> bytes:
    """Return what stands before the rows: magic, version, the header and its length: a multiple of 8."""
    text = json.dumps(dict(header)).encode()
    text += b" " * (-len(text) % 8)
    sizes = np.array([VERSION_OF_FORMAT, len(text)], dtype="<u4").tobytes()
    return MAGIC + sizes + text


def read(path: str | PathLike[str]) -> ArmLog:
    """Read a log; of a file that was cut off, the rows that are whole.

    Raises:
        RolloutError: when the file is missing, too large, no log of this format, or damaged.
        ParameterError: when `path` is no path.
    """
    source = check_path(path, "path")
    try:
        content = files.read_bytes(source, _LARGEST)
    except OSError as error:
        raise RolloutError(f"{source}: cannot be read: {files.reason(error)}") from None
    if content[: len(MAGIC)] != MAGIC or len(content) < _PREAMBLE:
        raise RolloutError(
            f"{source}: is no log of an arm; expected a file that begins with {MAGIC.decode()}"
        )
    version, length = np.frombuffer(content, "<u4", 2, len(MAGIC)).tolist()
    if version != VERSION_OF_FORMAT:
        raise RolloutError(f"{source}: {other_format(version, VERSION_OF_FORMAT)}")
    if length > min(_LONGEST, len(content) - _PREAMBLE):
        raise RolloutError(f"{source}: its header of {length} bytes is not whole")
    begin = _PREAMBLE + length
    header = _header(content[_PREAMBLE:begin], source)
    kind = row_type(tuple(header["inputs"]), len(header["joints"]))
    whole_rows = (len(content) - begin) // kind.itemsize
    rows = np.frombuffer(content, kind, whole_rows, begin)
    damage = _damage(rows, len(header["joints"]))
    if damage:
        raise RolloutError(f"{source}: {damage}")
    return ArmLog(header, rows, str(source))


def _header(text: bytes, source: Path) -> dict[str, Any]:
    """Return the header of a file, checked."""
    try:
        header = json.loads(text)
        joints, dt, inputs = header["joints"], header["dt"], header["inputs"]
    except (ValueError, RecursionError, TypeError, KeyError) as error:
        reason = " ".join(str(error).split())[:100]
        raise RolloutError(f"{source}: its header is no JSON with joints, dt and inputs ({reason})") from None
    names = joints if isinstance(joints, list) else []
    if not 0 < len(names) <= _MOST_JOINTS or not all(isinstance(name, str) for name in names):
        raise RolloutError(f"{source}: joints in its header: expected 1 to {_MOST_JOINTS} names")
    if isinstance(dt, bool) or not isinstance(dt, int | float) or not 1e-9 < dt < 1e3:
        raise RolloutError(f"{source}: dt in its header: expected a positive time [s], got {dt!r}"[:300])
    known = [name for name in INPUTS if isinstance(inputs, list) and name in inputs]
    if known != inputs or not {"q_measured", "q_ref"} <= set(known):
        raise RolloutError(
            f"{source}: inputs in its header: expected q_measured, q_ref and more of "
            f"{', '.join(INPUTS)}, in this order"
        )
    return dict(header)


def _damage(rows: npt.NDArray[np.void], n: int) -> str:
    """Return what in rows cannot be, empty when all is well."""
    ends = {"event": len(Event), "status": len(State), "reason": len(Reason), "joint": n}
    for name, end in ends.items():
        beyond = np.flatnonzero(rows[name] >= end)
        if beyond.size:
            row = beyond[0]
            return f"row {row}: {name} is {rows[name][row]}, expected below {end}"
    not_finite = np.flatnonzero(~np.isfinite(rows["tau"]).all(axis=1))
    if not_finite.size:
        return f"row {not_finite[0]}: tau is no finite number"
    numbers = rows["number"].astype(np.int64)
    falling = np.flatnonzero(np.diff(numbers) < 0)
    if falling.size:
        row = falling[0]
        return f"row {row + 1}: number is {numbers[row + 1]} after {numbers[row]}"
    if (numbers < 0).any() or (numbers > _MOST_SAMPLES).any():
        return "its samples are numbered beyond 2^53"
    return ""


class Replay(NamedTuple):
    """How far a law is from the torques of a log.

    Attributes:
        samples: how many were compared.
        difference: largest difference of each joint [N m or N], (n,).
        first: number of the first sample whose torque is not the same to the bit; None for none.
        status: number of the first sample whose status or reason differs; None for none.
    """

    samples: int
    difference: Array
    first: int | None
    status: int | None


def replay(log: ArmLog, controller: Any) -> Replay:
    """Give a controller what a log says that it was given, and compare the torques.

    Args:
        log: that begins with a start, as all do that were not overwritten in their writer's memory.
        controller: the law under its supervisor (:class:`armgpi.Supervised`) in Python, or as exported C.

    Raises:
        RolloutError: when the log does not begin with a start, or lacks what the controller is given.
        NameNotFound: when a joint of the log is not the controller's.
        ParameterError: when the order of joints or the sample time is another one.
    """
    check_type(log, "log", ArmLog, "an ArmLog")
    _check_same(log, controller)
    if not len(log.rows) or log.rows["event"][0] == Event.SAMPLE:
        raise RolloutError(
            f"{log.source}: does not begin with the start of the controller, so the state of its first "
            "sample is unknown; give the writer more memory, or log a shorter time"
        )
    takes_velocities = controller.measurement_type is FullState
    zero = np.zeros(len(log.header["joints"]))
    state = None
    samples = 0
    difference = zero
    first_apart: int | None = None
    first_other_status: int | None = None
    for row in log.rows:
        inputs = {name: row[name] if name in log.header["inputs"] else zero for name in INPUTS}
        measured: Any = Measurement(inputs["q_measured"])
        if takes_velocities:
            measured = FullState(inputs["q_measured"], inputs["v_measured"])
        target = Target(inputs["q_ref"], inputs["v_ref"], inputs["a_ref"])
        with np.errstate(all="ignore"):  # a measurement that is none belongs to what is replayed
            if state is None or row["event"] == Event.INIT:
                state = controller.init(measured, target)
                continue
            if row["event"] == Event.RESET:
                state = controller.reset(measured, target, state)
                continue
            step = controller.advance(measured, target, state, max(1, int(row["elapsed"])))
            if np.isfinite(row["applied"]).all():
                step = controller.within_rate(row["applied"], step)
        state = step.state
        samples += 1
        number = int(row["number"])
        apart = np.abs(step.tau - row["tau"])
        difference = np.maximum(difference, apart)
        if first_apart is None and apart.any():
            first_apart = number
        status_and_reason = controller.report(state)[:2]
        logged = State(row["status"]).name.lower(), Reason(row["reason"]).name.lower()
        if first_other_status is None and status_and_reason != logged:
            first_other_status = number
    return Replay(samples, difference, first_apart, first_other_status)


def _check_same(log: ArmLog, controller: Any) -> None:
    """Refuse a controller of other joints or another sample time."""
    joints, names = log.header["joints"], list(controller.robot.joint_names)
    for name in joints:
        if name not in names:
            raise NameNotFound(f"{log.source}: joint", name, names)
    if joints != names:
        raise ParameterError("controller", ", ".join(names), f"one of the joints {', '.join(joints)}")
    dt = log.header["dt"]
    if not np.isclose(controller.dt, dt, rtol=1e-9):
        raise ParameterError("controller", f"dt = {controller.dt:g}", f"one of dt = {dt:g} s")
    needs = "v_measured" if controller.measurement_type is FullState else "q_measured"
    if needs not in log.header["inputs"]:
        raise RolloutError(f"{log.source}: has no {needs}, which this controller is given")


def to_rollout(log: ArmLog, robot: Robot) -> xr.Dataset:
    """Return a log as a rollout, for reports, players and metrics.

    A log knows the arm by its measurements alone: `q` is the measured position, `v` its central difference.
    `tau` is what the robot says it applied, where it does, else what was sent. Missed samples are left out.

    Args:
        log: of the robot's joints.
        robot: for limits and kinds of joints.

    Raises:
        NameNotFound, ParameterError: when the joints are others.
        RolloutError: when the log has fewer than two samples.
    """
    from armgpi.loop.rollout import Recorded, Recording, Status

    rows, names = log.samples, list(robot.joint_names)
    if log.header["joints"] != names:
        expected = f"one of the joints {', '.join(log.header['joints'])}"
        raise ParameterError("robot", ", ".join(names), expected)
    if len(rows) < 2 or not (np.diff(log.t) > 0.0).all():
        raise RolloutError(f"{log.source}: expected at least two samples at increasing times")
    recording = Recording.new((robot.n,), len(rows), float(log.header["dt"]), 1)
    recording.times = log.t - log.t[0]
    recording.t_end = recording.times[-1:].copy()

    def velocity(name: str, positions: str) -> Array:
        """Return velocities of the log, or where it has none the central difference of positions."""
        if name in log.inputs:
            return np.asarray(rows[name])
        return np.asarray(np.gradient(rows[positions], recording.times, axis=0))

    variables = {
        "q": rows["q_measured"],
        "v": velocity("v_measured", "q_measured"),
        "q_ref": rows["q_ref"],
        "v_ref": velocity("v_ref", "q_ref"),
        "q_measured": rows["q_measured"],
        "tau_command": rows["tau"],
        "tau": np.where(np.isfinite(rows["applied"]), rows["applied"], rows["tau"]),
    }
    recording.store(0, {name: values[:, None] for name, values in variables.items()})
    fault, joint, t_fault = 0, -1, np.nan
    faulty = np.flatnonzero(rows["reason"] > Reason.NONE)
    if faulty.size:
        first = faulty[0]
        fault = rows["reason"][first]
        joint = -1 if fault in OF_TOOL else rows["joint"][first]
        t_fault = recording.times[first]
        recording.status[0] = Status.STOPPED
        recording.t_end[0] = t_fault
    recording.faults = {
        "fault": np.array([fault], np.int32),
        "fault_joint": np.array([joint], np.int32),
        "t_fault": np.array([t_fault]),
    }
    made_from = {
        "plant": {"type": "an arm described by its log", "robot": robot.provenance},
        "controller": {"type": "of the log", "dt": float(log.header["dt"])},
        "reference": {"type": "of the log"},
        "measurement": (FullState if "v_measured" in log.inputs else Measurement).__name__,
        "backend": f"log {Path(log.source).name}",
        "log": dict(log.header),
    }
    return Recorded(recording, robot, None, made_from).dataset()
