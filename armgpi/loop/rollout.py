"""A rollout: what happened, as a labelled dataset, with how it ended and what it was made from.

Dimensions are ``time`` and ``joint``, and ``rollout`` in front when a batch was run. Variables:

========================  ===========================================================  ==============
``q``, ``v``              true positions and velocities                                rad, rad/s
``q_ref``, ``v_ref``      reference                                                    rad, rad/s
``q_measured``            positions as the controller saw them                         rad
``tau_command``, ``tau``  commanded torque and applied from this sample to the next    N m
``disturbance``           disturbance torque of the loads, where there are any         N m
``tool``, ``tool_ref``    position of the tip and the wished one, over ``axis``        m
``tool_turn``             angle between the tip's orientation and the wished one       rad
``contact_force``         force of each contact on the arm, over ``contact, axis``     N
``contact_point``         where it acts, likewise                                      m
``status``, ``t_end``     how and when the rollout ended                               , s
``lower`` ... ``effort``  limits of the plant's joints                                 rad, N m
``supervisor``            state of the supervisor, where there is one
``fault``, ...            reason, joint (index) and time of its fault                  , , s
========================  ===========================================================  ==============

(m instead of rad and N instead of N m for prismatic joints; ``joint_type`` says which, and the attribute
``units`` where all joints are prismatic.)
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from armgpi.base import files, hdf5
from armgpi.base.arrays import Array, check_path, check_type
from armgpi.base.files import machine_bytes
from armgpi.base.version import other_format
from armgpi.errors import RolloutError
from armgpi.loop.memory import Memory
from armgpi.loop.provenance import Provenance, versions
from armgpi.loop.tool import MOST, Tool, ToolTrack, angle_of
from armgpi.loop.units import POSITION, TORQUE, VELOCITY
from armgpi.robot.batch import AnyRobot
from armgpi.supervisor import OF_TOOL, SIGNALS, Reason

if TYPE_CHECKING:  # functions that need it import it: with pandas it takes twice as long as Pinocchio
    import xarray as xr

_Content = TypeVar("_Content")
#: Version of the layout described above.
FORMAT = 1
#: What every rollout has.
SAMPLED = ("q", "v", "q_measured", "tau_command", "tau", "q_ref", "v_ref")
_REQUIRED = ("status", "t_end", "lower", "upper", "velocity", "effort", "joint", "time")
#: Recorded quantities to expect, when it is asked whether they fit into memory.
_VARIABLES = 8
#: What every quantity is called, and its unit.
_QUANTITIES = {
    "q": ("position", POSITION),
    "v": ("velocity", VELOCITY),
    "q_ref": ("reference position", POSITION),
    "v_ref": ("reference velocity", VELOCITY),
    "q_measured": ("measured position", POSITION),
    "tau_command": ("commanded torque", TORQUE),
    "tau": ("torque applied", TORQUE),
    "disturbance": ("disturbance torque", TORQUE),
    "lower": ("lower", POSITION),
    "upper": ("upper", POSITION),
    "velocity": ("velocity", VELOCITY),
    "effort": ("effort", TORQUE),
}


#: What is said of the fault of a supervised rollout.
FAULTS: dict[str, dict[str, Any]] = {
    "fault": {
        "long_name": "why the supervisor stopped the arm",
        "flag_values": np.array([int(reason) for reason in Reason], dtype=np.int32),
        "flag_meanings": " ".join(reason.name.lower() for reason in Reason),
    },
    "fault_joint": {"long_name": "index of the joint concerned, -1 for none"},
    "t_fault": {"long_name": "time of the fault", "units": "s"},
}


class Status(IntEnum):
    """How a rollout ended."""

    FINISHED = 0
    DIVERGED = 1
    INTERRUPTED = 2
    STOPPED = 3


@dataclass
class Recording:
    """Samples being collected.

    Attributes:
        times: times of the recorded samples [s], shape (k,).
        dt: sample time [s].
        every: record every so many samples.
        shape: of one sample, (n,) or (batch, n).
        variables: name -> array (k, ..., n).
        status: of every rollout, shape (rollouts,).
        t_end: when each ended [s], shape (rollouts,).
        stored: how many samples are there.
        faults: of supervised rollouts, what :meth:`note_faults` found: name -> array (rollouts,).
        names: variables that are kept; None for all.
        dtype: of their numbers, float64 or float32.
        memory: where the arrays are.
    """

    times: Array
    dt: float
    every: int
    shape: tuple[int, ...]
    variables: dict[str, Array]
    status: npt.NDArray[np.int32]
    t_end: Array
    stored: int = 0
    faults: dict[str, Array] = field(default_factory=dict)
    names: frozenset[str] | None = None
    dtype: str = "float64"
    memory: Memory = field(default_factory=Memory)

    @classmethod
    def new(
        cls,
        shape: tuple[int, ...],
        steps: int,
        dt: float,
        every: int,
        names: frozenset[str] | None = None,
        dtype: str = "float64",
        memory: Memory | None = None,
    ) -> Recording:
        """Make room for `steps` samples and the state after them; `shape` is (n,) or (batch, n).

        Raises:
            RolloutError: when so many do not fit into this machine's memory.
        """
        memory = memory or Memory()
        samples, variables = steps // every + 1, _VARIABLES if names is None else len(names)
        size = 0 if memory.on_disk else np.dtype(dtype).itemsize * variables * math.prod(shape)
        if (size + 8) * samples > machine_bytes():  # 8: times are in memory anyway
            raise RolloutError(_too_much(samples, shape))
        rollouts = shape[0] if len(shape) == 2 else 1
        return cls(
            times=np.arange(0, steps + 1, every) * np.float64(dt),
            dt=dt,
            every=every,
            shape=shape,
            variables={},
            status=np.full(rollouts, Status.FINISHED, dtype=np.int32),
            t_end=np.full(rollouts, steps * dt),
            names=names,
            dtype=dtype,
            memory=memory,
        )

    @property
    def running(self) -> npt.NDArray[np.bool_]:
        """Which rollouts are neither diverged nor interrupted."""
        running: npt.NDArray[np.bool_] = self.status == Status.FINISHED
        return running

    @property
    def kept_samples(self) -> int:
        """How many samples are part of the rollouts: those of one that was interrupted end there."""
        interrupted = (self.status == Status.INTERRUPTED).any()
        return self.stored if interrupted else len(self.times)

    def diverge(self, rollouts: Any, samples: Any) -> None:
        """Note that rollouts (indices) have diverged at samples (counted from 0)."""
        self.status[rollouts] = Status.DIVERGED
        self.t_end[rollouts] = samples * self.dt

    def interrupt(self, samples: int) -> None:
        """Note that all rollouts that still run were stopped after so many samples."""
        running = self.running
        self.t_end[running] = samples * self.dt
        self.status[running] = Status.INTERRUPTED

    def note_faults(self) -> None:
        """Note what the supervisor's signals say of faults; a rollout with one was stopped."""
        last = {}
        for name in SIGNALS:
            # The last number that is one, of the first joint: they are all the same.
            # Where all diverged nothing was stored since.
            values = self.variables[name].reshape(len(self.times), len(self.status), -1)[: self.stored, :, 0]
            there = len(values) - 1 - np.argmax(np.isfinite(values[::-1]), axis=0)
            last[name] = np.nan_to_num(values[there, np.arange(len(self.status))])
        for name in SIGNALS[1:]:  # the same all along, or of no use before the end
            del self.variables[name]
        # The state after the last sample has that sample's controller.
        self._note(last, np.minimum(self.times[there], self.t_end - self.dt))

    def note_last(self, last: Mapping[str, Array], time: float) -> None:
        """Note likewise what the signals of the last sample say, (rollouts, n), which was at `time` [s].

        Of a rollout that diverged nobody counted the samples since its fault: that has no time.
        """
        none = np.zeros((len(self.status), 1))  # interrupted before its first sample
        self._note({name: np.nan_to_num(last.get(name, none)[:, 0]) for name in SIGNALS}, time)
        self.faults["t_fault"][self.status == Status.DIVERGED] = np.nan

    def _note(self, last: Mapping[str, Array], time: Array | float) -> None:
        """Note faults by the last signals of every rollout, which are of these times [s]."""
        _, reason, joint, since = (last[name] for name in SIGNALS)
        faulty = reason > 0.0
        # One that started with its fault has counted a sample before the first.
        sample = np.maximum(np.rint(time / self.dt) - since, 0.0)
        t_fault = np.where(faulty, sample * self.dt, np.nan)
        self.faults = {
            "fault": reason.astype(np.int32),
            "fault_joint": np.where(faulty & ~np.isin(reason, list(OF_TOOL)), joint, -1.0).astype(np.int32),
            "t_fault": t_fault,
        }
        stopped = faulty & self.running
        self.status[stopped] = Status.STOPPED
        self.t_end[stopped] = t_fault[stopped]

    def store(self, first: int, samples: Mapping[str, Array]) -> None:
        """Store the samples `first`, `first` + 1, ... of every variable, (k, rollouts, n), thinned.

        Storing the same samples again changes nothing, so this may be interrupted and repeated.
        """
        skip = -first % self.every
        begin = (first + skip) // self.every
        for name, values in samples.items():
            if not self.keeps(name):
                continue
            kept = values[skip :: self.every]
            place = self.buffer(name)[begin : begin + len(kept)]
            place[...] = kept.reshape(place.shape)
        self.stored = -(-(first + len(values)) // self.every)

    def keeps(self, name: str) -> bool:
        """Tell whether a variable is recorded; what tells of faults is in any case."""
        return self.names is None or name in self.names or name in SIGNALS

    def buffer(self, name: str, blank: bool = True) -> Array:
        """Return the array of a variable, of shape (k, ..., n).

        Args:
            name: of the variable.
            blank: make it NaN where nothing is stored yet; else the caller does that.
        """
        if name in self.variables:
            return self.variables[name]
        try:
            self.variables[name] = self.memory.array(name, (len(self.times), *self.shape), self.dtype)
            if blank:
                self.variables[name].fill(np.nan)
            return self.variables[name]
        except MemoryError:
            raise RolloutError(_too_much(len(self.times), self.shape)) from None


class Recorded(NamedTuple):
    """What a run recorded, as plain arrays; its dataset is made when it is asked for.

    Attributes:
        recording: the samples.
        robot: the plant's, for names and limits.
        disturbance: disturbance torque at all of the recording's times, or None.
        made_from: what was run, as plain data: see :class:`armgpi.loop.provenance.Provenance`.
        tool: what works out what the tool did; None where nobody asks.
    """

    recording: Recording
    robot: AnyRobot
    disturbance: Array | None
    made_from: Mapping[str, Any]
    tool: Tool | None = None

    def track(self) -> ToolTrack | None:
        """Return what the tool did; None where positions were not recorded, or are too many to go through."""
        recording, stored = self.recording, self.recording.kept_samples
        needed = ("q", "v", "q_ref")
        if self.tool is None or not all(name in recording.variables for name in needed):
            return None
        if stored * len(recording.status) > MOST:
            return None
        q, v, q_ref = (np.asarray(self._samples()[name][:stored], dtype=np.float64) for name in needed)
        return self.tool.track(q, v, q_ref, recording.times[:stored])

    def _tool_variables(self, per_rollout: tuple[str, ...]) -> dict[str, Any]:
        """Return the variables of the tool: name -> dimensions, values, attributes."""
        names = self.recording.names
        track = self.track() if names is None else None
        if track is None or self.tool is None:
            return {}

        variables: dict[str, Any] = {}

        def put(name: str, samples: Array, axes: tuple[str, ...], long_name: str, units: str) -> None:
            """Put a variable, whose array begins with samples, then rollouts."""
            values = np.swapaxes(samples, 0, 1) if per_rollout else samples
            attributes = {"long_name": long_name, "units": units}
            variables[name] = ((*per_rollout, "time", *axes), values, attributes)

        put("tool", track.actual.position, ("axis",), f"position of {self.tool.frame}", "m")
        put("tool_ref", track.wished.position, ("axis",), "wished position", "m")
        put("tool_turn", angle_of(track.sample().turn)[..., 0], (), "angle off", "rad")
        if track.forces.shape[-2]:
            put("contact_force", track.forces, ("contact", "axis"), "force on the arm", "N")
            put("contact_point", track.points, ("contact", "axis"), "where a contact acts", "m")
        return variables

    def ends(self) -> list[str]:
        """Return in words how each rollout ended; see :func:`describe_end`."""
        recording = self.recording
        return _ends(recording.status, recording.t_end, self.robot.joint_names, recording.faults)

    def _samples(self) -> dict[str, Array]:
        """Return what was sampled, (samples, ..., n): of a run that all rollouts left, until then."""
        recording, disturbance = self.recording, self.disturbance
        # A run that was interrupted at once has no samples of what it would have recorded.
        none = np.empty((0, *recording.shape), recording.dtype)
        arrays = {name: none for name in SAMPLED if recording.keeps(name)} | recording.variables
        if (recording.status == Status.DIVERGED).all():
            # The run went on for some samples, as many as it takes at once: they are not part of the rollout.
            after = recording.times >= recording.t_end.max()
            for values in recording.variables.values():
                values[after] = np.nan
        if disturbance is not None and recording.keeps("disturbance"):
            if len(recording.shape) == 2 and disturbance.ndim == 2:
                disturbance = disturbance[:, None]  # the same for every rollout
            arrays["disturbance"] = np.broadcast_to(disturbance, (len(recording.times), *recording.shape))
        return arrays

    def dataset(self) -> xr.Dataset:
        """Return it as the dataset that a rollout is."""
        from armgpi.loop.hinted import Rollout

        recording, robot = self.recording, self.robot
        per_rollout, row = _rollout_dimension(recording)
        # An interrupted run ends where it was stopped; of one where all diverged the rest stays NaN.
        stored = recording.kept_samples
        variables: dict[str, Any] = {}
        for name, samples in self._samples().items():
            values = np.swapaxes(samples[:stored], 0, -2)
            variables[name] = ((*per_rollout, "time", "joint"), values, _attributes(name, robot))
        variables |= self._tool_variables(per_rollout)
        attributes = _end_attributes()
        for name, values in _end_values(recording).items():
            variables[name] = (per_rollout, values[row], attributes[name])
        for name, limit in robot.limits._asdict().items():
            # Limits differ by rollout only in a batch of arms.
            dimensions = (*per_rollout[: limit.ndim - 1], "joint")
            variables[name] = (dimensions, limit, _attributes(name, robot))
        coordinates = {
            "time": ("time", recording.times[:stored], {"units": "s"}),
            "joint": ("joint", np.array(robot.joint_names)),
            "joint_type": ("joint", np.array(robot.joint_types)),
        }
        facts = {
            "title": f"armgpi rollout of {robot.name}",
            "robot": robot.name,
            "armgpi_format": FORMAT,
            "provenance": provenance(self.made_from),
        }
        if recording.names is not None:
            facts["recorded"] = " ".join(sorted(recording.names))
        return Rollout(variables, coordinates, facts)


def summary_dataset(
    recording: Recording,
    robot: AnyRobot,
    found: Mapping[str, Array],
    ends: Mapping[str, Array],
    made_from: str,
    like: xr.Dataset | None = None,
) -> xr.Dataset:
    """Return the dataset of a run that kept metrics alone.

    Args:
        recording: how the rollouts ended.
        robot: the plant's robot, for names.
        found: metrics by name, (rollouts, n).
        ends: positions and velocities at the end, likewise.
        made_from: as :func:`provenance` has it.
        like: that of a run of the same loop with as many rollouts, which differs in its numbers alone.
    """
    per_rollout, row = _rollout_dimension(recording)
    values: dict[str, Any] = {name: x.reshape(recording.shape) for name, x in found.items()}
    values |= {f"{name}_end": x.reshape(recording.shape) for name, x in ends.items()}
    values |= {name: x[row] for name, x in _end_values(recording).items()}
    from armgpi.loop.hinted import Rollout

    if like is not None:  # xarray takes longer to put one together than a short run takes
        return like.copy(data=values)
    attributes = _end_attributes() | {f"{name}_end": _attributes(name, robot) for name in ends}
    dimensions = (*per_rollout, "joint")
    variables = {}
    for name, numbers in values.items():
        variables[name] = (dimensions[: np.ndim(numbers)], numbers, attributes.get(name))
    coordinates = {"joint": ("joint", np.array(robot.joint_names))}
    facts = {"title": f"armgpi metrics of {robot.name}", "robot": robot.name, "provenance": made_from}
    return Rollout(variables, coordinates, facts)


def _rollout_dimension(recording: Recording) -> tuple[tuple[str, ...], Any]:
    """Return the dimension of a batch, and the index of its rollouts; none and 0 of a single rollout."""
    if len(recording.shape) == 2:
        return ("rollout",), slice(None)
    return (), 0


def _end_values(recording: Recording) -> dict[str, Any]:
    """Return what says how rollouts ended, name -> (rollouts,)."""
    return {"status": recording.status, "t_end": recording.t_end, **recording.faults}


def _end_attributes() -> dict[str, Any]:
    """Return the attributes of :func:`_end_values`."""
    faults = {name: dict(attributes) for name, attributes in FAULTS.items()}
    return {"status": _status(), "t_end": {"long_name": "end of the rollout", "units": "s"}, **faults}


def provenance(made_from: Mapping[str, Any]) -> str:
    """Return what was run, and by which versions, as JSON."""
    return Provenance({**made_from, "versions": versions()}).to_json()


def _status() -> dict[str, Any]:
    """Return the attributes of `status`."""
    return {
        "long_name": "how the rollout ended",
        "flag_values": np.array([int(s) for s in Status], dtype=np.int32),
        "flag_meanings": " ".join(s.name.lower() for s in Status),
    }


def describe_end(rollout: xr.Dataset) -> list[str]:
    """Return in words how each rollout ended: "finished", "diverged at 1.25 s", "stopped at 1.25 s: ..."."""
    rows = rollout if "rollout" in rollout["status"].dims else rollout.expand_dims("rollout")
    values = {name: rows[name].values for name in ("status", "t_end", "joint", *FAULTS) if name in rows}
    return _ends(values["status"], values["t_end"], values["joint"], values)


def _ends(status: Any, t_end: Array, joints: Any, faults: Mapping[str, Any]) -> list[str]:
    """Return in words how rollouts ended; why and at which joint where a supervisor stopped them."""
    words = []
    for i, end in enumerate(Status(int(each)) for each in status):
        said = end.name.lower() + ("" if end == Status.FINISHED else f" at {float(t_end[i]):.4g} s")
        if "fault" in faults and faults["fault"][i]:
            reason, joint = Reason(int(faults["fault"][i])), int(faults["fault_joint"][i])
            said += f"{':' if end == Status.STOPPED else ', after'} {reason.name}"
            if joint >= 0:
                said += f" ({joints[joint]})"
        words.append(said)
    return words


def describe_measurement(name: str, knows: str = "") -> str:
    """Return in words what a controller measures, by the name of its measurement type, and what it knows."""
    measured = {"Measurement": "positions only", "FullState": "positions and velocities"}.get(name, name)
    known = {
        "inertia": "the inertia matrix",
        "gravity": "inertia and gravity",
        "model": "model feedforward (D, C, G)",
    }
    part, also, friction = knows.partition(" and ")
    return f"{measured}, uses {known.get(part, part)}{also}{friction}" if knows else measured


def save(rollout: xr.Dataset, path: str | PathLike[str]) -> Path:
    """Write a rollout as NetCDF; the file appears whole or not at all.

    Args:
        rollout: as :func:`armgpi.simulate` returns it.
        path: of the file.

    Raises:
        RolloutError: when the file cannot be written.
        ParameterError: when an argument is not as it should be.
    """
    import xarray as xr

    check_type(rollout, "rollout", xr.Dataset, "a rollout, as simulate returns it")
    return files.write(check_path(path, "path"), netcdf(rollout))


def netcdf(rollout: xr.Dataset) -> bytes:
    """Return a dataset, such as a rollout, as a NetCDF file."""
    encoding = {
        name: {"zlib": True, "complevel": 4, "fletcher32": True}  # the checksum finds damage
        for name, variable in rollout.data_vars.items()
        if variable.dtype.kind == "f" and variable.ndim
    }
    # In memory: HDF5 leaves no way to end well when the disk is full.
    import h5netcdf  # here: with h5py, it is as slow to import as Pinocchio
    from xarray.backends import H5NetCDFStore

    content = io.BytesIO()
    with h5netcdf.File(content, "w") as file:
        rollout.dump_to_store(H5NetCDFStore(file), encoding=encoding)
    return content.getvalue()


def load(path: str | PathLike[str]) -> xr.Dataset:
    """Read a rollout that :func:`save` wrote.

    Args:
        path: file that ends in .nc.

    Returns:
        The rollout(s) with all variables and attributes; see :func:`armgpi.simulate`.

    Raises:
        RolloutError: when the file is missing, broken, no rollout of this format, or not the one that its
            folder was written with (``SHA256SUMS``).
        ParameterError: when `path` is no path.
    """
    source = check_path(path, "path")
    files.check_set(source.parent, [source.name])
    rollout = read_netcdf(source)
    names = frozenset(str(name) for name in rollout.variables)
    _check_whole(source, rollout.attrs, names)
    _check_values(source, rollout.attrs, rollout["time"].values, rollout["status"].values)
    from armgpi.loop.hinted import hinted

    return hinted(rollout.transpose("rollout", "time", ..., missing_dims="ignore"))


def load_variables(path: str | PathLike[str], names: Sequence[str]) -> dict[str, hdf5.Variable]:
    """Read some variables of a rollout that :func:`save` wrote, without importing xarray.

    Args:
        path: file that ends in .nc.
        names: of variables; those that were not recorded are left out.

    Raises:
        RolloutError, ParameterError: as :func:`load`.
    """
    source = check_path(path, "path")
    files.check_set(source.parent, [source.name])
    content = _read(source, lambda: hdf5.load_some(source, [*names, "time", "status"]))
    _check_whole(source, content.attributes, content.names)
    time, status = (content.variables[name].values for name in ("time", "status"))
    _check_values(source, content.attributes, time, status)
    return {name: content.variables[name] for name in names if name in content.variables}


def _check_whole(source: Path, attributes: Mapping[Any, Any], names: frozenset[str]) -> None:
    """Check that a file is a rollout of this format, with all variables that it is said to have.

    Raises:
        RolloutError: when it is not.
    """
    version = attributes.get("armgpi_format")
    if not isinstance(version, int | np.integer) or version != FORMAT:
        raise RolloutError(f"{source}: {other_format(version, FORMAT)}")
    recorded = attributes.get("recorded")
    expected = (*(str(recorded).split() if recorded else SAMPLED), *_REQUIRED)
    if missing := [name for name in expected if name not in names]:
        raise RolloutError(f"{source}: is no whole armgpi rollout; it lacks {', '.join(missing)}")


def read_netcdf(source: Path) -> xr.Dataset:
    """Return all of a NetCDF file.

    Raises:
        RolloutError: when it is missing or broken, or declares what :mod:`armgpi.base.hdf5` does not load.
    """
    return _read(source, lambda: hdf5.load(source))


def _read(source: Path, read: Callable[[], _Content]) -> _Content:
    """Return what a function reads of a NetCDF file; errors as :func:`read_netcdf`."""
    try:
        return read()
    except FileNotFoundError:
        raise RolloutError(
            f"{source}: the file does not exist; expected a rollout that armgpi wrote"
        ) from None
    except (hdf5.Refused, files.NotRegular, files.TooLarge) as error:
        said = f"is not read: {files.reason(error)}; expected a rollout that armgpi wrote"
        raise RolloutError(f"{source}: {said}") from None
    except Exception as error:  # h5py has no one kind of error for a damaged file
        said = f"is not a readable NetCDF file ({files.reason(error)}); expected a rollout that armgpi wrote"
        raise RolloutError(f"{source}: {said}") from None


def _check_values(source: Path, attributes: Mapping[Any, Any], time: Any, status: Any) -> None:
    """Check that times, statuses and provenance of a rollout's file are possible ones.

    Raises:
        RolloutError: when they are not.
    """
    damage = ""
    if time.ndim != 1 or not np.isfinite(time).all() or (np.diff(time) <= 0.0).any():
        damage = "its times do not increase"
    elif not np.isin(status, [int(known) for known in Status]).all():
        damage = f"its status is {status}"
    else:
        try:
            Provenance.from_attributes(attributes)
        except RolloutError as error:
            damage = str(error)
    if damage:
        raise RolloutError(f"{source}: is no armgpi rollout any more: {damage}")


def _too_much(samples: int, shape: tuple[int, ...]) -> str:
    """Return what to do when a recording does not fit into memory."""
    size = " x ".join(map(str, shape))
    return (
        f"recording {samples:.3g} samples of {size} numbers each does not fit into memory; run for a shorter "
        "time, run a smaller batch, record fewer samples with record_every or fewer variables with "
        "record=('q', 'tau'), or have them written to a file with file='rollouts.nc'"
    )


def _attributes(name: str, robot: AnyRobot) -> dict[str, str]:
    """Return the attributes of a variable; units are those of prismatic joints where all are."""
    if name not in _QUANTITIES:
        return {"long_name": name}
    long_name, unit = _QUANTITIES[name]
    return {"long_name": long_name, "units": unit.symbol(bool(robot.prismatic.all()), ascii=True)}
