"""A closed loop prepared once, which runs with new numbers as often as wanted; `simulate` runs one once."""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from armgpi.base import files
from armgpi.base.arrays import (
    Array,
    ArrayLike,
    check_choice,
    check_number,
    check_path,
    check_type,
    check_whole,
    is_listing,
)
from armgpi.base.hints import with_keyword_hints
from armgpi.control.controller import Controller
from armgpi.errors import (
    ArmgpiWarning,
    ArrayError,
    BackendError,
    LimitError,
    MissingPackage,
    NameNotFound,
    ParameterError,
)
from armgpi.loop import metrics
from armgpi.loop.backends import BACKENDS, runner, sample_streams
from armgpi.loop.closed_loop import ClosedLoop, LoopState
from armgpi.loop.memory import Memory, NetCDF
from armgpi.loop.rollout import SAMPLED, Recorded, Recording, Status, provenance, summary_dataset
from armgpi.loop.runner import DIVERGENCE, NumPyRun, Runner, drive
from armgpi.loop.running import TOTALS, Running, Totals
from armgpi.loop.tool import Tool
from armgpi.loop.variables import Variable, check_values, rows_of, spread_rows, variables, with_values
from armgpi.plants.elastic import ElasticPlant
from armgpi.plants.plant import Plant, inside
from armgpi.references.reference import Reference
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import unlike
from armgpi.supervisor import Supervised, Supervisor

if TYPE_CHECKING:
    import xarray as xr

#: More samples than this cannot be counted in a float.
_MOST_STEPS = 1e15
#: How many configurations of the reference are checked against the joint limits before the run.
_MOST_CHECKS = 2001
#: How many they are at least, where the reference of a large batch ...
_FEWEST_CHECKS = 17
#: ... has more numbers in all than this.
_CHECKED_NUMBERS = 1 << 18
#: Seconds after which a run gets a progress bar.
_LONG = 2.0
#: What a run keeps.
RECORDS = ("all", "metrics")
_DTYPES = ("float64", "float32")
#: About what NumPy takes for each array of the state in a sample, whatever its size [s].
_ARRAY = 5e-6
#: What it takes for each coordinate of each rollout on top [s].
_NUMBER = 1.2e-6
#: What it takes besides for friction, which is solved in some ten steps, of each of an arm's masses, and for
#: elastic joints [s].
_FRICTION, _GEARS = 3.5e-4, 1e-4
#: What it takes for each contact at each evaluation of the dynamics, of which a step of integration has four,
#: two for elastic joints; and for each step after the first, of stiff and of elastic joints [s].
_CONTACT, _STEP, _ELASTIC_STEP = 1.8e-4, 1.4e-5, 5.5e-5
#: What NumPy needs less for it does at once [s]: as long take the imports, where code is compiled already.
_WORTH = 0.1


@with_keyword_hints
def prepare(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    t_final: float,
    *,
    record: str | Sequence[str] = "all",
    record_every: int = 1,
    dtype: str = "float64",
    signals: bool = False,
    divergence: float = DIVERGENCE,
    backend: str = "auto",
    supervisor: Supervisor | None = None,
) -> PreparedLoop:
    """Return a closed loop that runs with new numbers as often as wanted, traced and compiled once.

    Args:
        plant: what moves.
        controller: what moves it; its sample time is the loop's.
        reference: where to.
        t_final: how long [s], rounded to whole samples.
        record: "all" keeps trajectories, names such as ("q", "tau") those alone; "metrics" adds up every
            declared metric instead, in memory that does not depend on the length of the run.
        record_every: record every so many samples; metrics are those of all samples anyway.
        dtype: of recorded numbers: "float64", or "float32" for half the memory and seven digits.
        signals: record the controller's inner signals as well.
        divergence: a rollout has diverged when a joint is farther than this from its reference
            [rad or m], or when a velocity or torque is not finite.
        backend: "numpy"; "compiled" for generated code (see :mod:`armgpi.codegen`), with a warning and NumPy
            where there can be none; "auto" for generated code where it saves more time than it takes to be
            there: little where it was compiled before, some tenths of a second otherwise. What the loop's
            runs before took NumPy counts as well.
        supervisor: puts the controller under a supervisor; see :func:`armgpi.simulate`.

    Raises:
        ParameterError: when an argument is not as it should be, or the parts do not match.
        ArrayError: when an array is not as it should be.
    """
    check_type(supervisor, "supervisor", Supervisor | None, "a Supervisor")
    if supervisor is not None:
        controller = Supervised(controller, supervisor)
    loop = ClosedLoop(plant, controller, reference)
    nominal, arm = loop.controller.robot, loop.plant.robot
    if isinstance(nominal, Robot) and isinstance(arm, Robot) and (said := unlike(nominal, arm)):
        warnings.warn(said, ArmgpiWarning, stacklevel=3)
    return PreparedLoop(loop, t_final, record, record_every, dtype, signals, divergence, backend)


class PreparedLoop:
    """A closed loop whose numbers may be given anew for every run and rollout; :func:`prepare` makes it.

    What differs by rollout is what is given as an array; runs that give the same names share one trace and
    one compiled code, whatever the numbers are. It can be pickled, and several threads may run it.

    Attributes:
        loop: plant, controller and reference as they were given.
        parameters: every declared parameter by its name, with what it is now and whether it may be given.
        steps: number of samples of a run.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        t_final: float,
        record: str | Sequence[str],
        record_every: int,
        dtype: str,
        signals: bool,
        divergence: float,
        backend: str,
    ) -> None:
        """Check the options; see :func:`prepare`."""
        self.loop = loop
        self.steps = whole_steps(t_final, loop.dt)
        self._names = None if isinstance(record, str) else _names(record)
        if self._names is None:
            check_choice(record, "record", RECORDS)
        check_choice(dtype, "dtype", _DTYPES)
        check_choice(backend, "backend", BACKENDS)
        check_type(signals, "signals", bool, "True or False")
        self._every = check_whole(record_every, "record_every", 1)
        self._divergence = check_number(divergence, "divergence", "positive [rad or m]", open_=True)
        self._metrics, self._backend = record == "metrics", backend
        self._spent = 0.0
        self._supervised = isinstance(loop.controller, Supervised)
        self._dtype = dtype
        self._signals = (signals or bool((self._names or set()) - set(SAMPLED))) and not self._metrics
        self._known: dict[Any, Any] = {}
        self._variables: dict[str, Variable] | None = None
        self._reference_checked = False
        self._memory = Memory()

    @property
    def parameters(self) -> Mapping[str, Variable]:
        """Every declared parameter by its name."""
        if self._variables is None:
            self._variables = variables(self.loop)
        return self._variables

    def run(
        self,
        values: Mapping[str, Any] | None = None,
        *,
        seed: Any = None,
        q0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        final: bool = False,
        progress: bool | None = False,
        partial: bool = False,
        file: str | PathLike[str] | None = None,
    ) -> xr.Dataset:
        """Run the loop and return its rollouts.

        Args:
            values: name -> number for all rollouts, or an array whose first axis is the rollouts:
                (rollouts,), or (rollouts, n) for a per-joint parameter. A lower and an upper end are a tuple.
                Names are those of :attr:`parameters`.
            seed: of all random numbers: that of rollout 0, as rollout i uses seed + i; or the seeds of all
                rollouts, any whole numbers.
            q0: starting positions [rad or m], (n,) or (batch, n); the reference's start when not given.
            v0: starting velocities [rad/s or m/s], zero when not given.
            final: with ``record="metrics"``, give positions and velocities at the end as well.
            progress: show a progress bar; None for one on a terminal and for long runs.
            partial: on Ctrl-C return what is there, with the status "interrupted", in place of the exception.
            file: NetCDF file that trajectories are written to as they come, for more than fit into memory;
                the dataset, dimensions (time, [rollout], joint), then reads from it what it is asked for.

        Returns:
            A dataset as of :func:`armgpi.simulate`; with ``record="metrics"`` one with every metric of
            totals, dimensions ([rollout], joint), `status` and `t_end`; under a
            supervisor also `fault`, `fault_joint` and `t_fault`, NaN for one that diverged.

        Raises:
            NameNotFound: for a parameter that the loop has not.
            ParameterError: for one that cannot be given anew, or a value that is not as declared.
            ArrayError: when an array is not as it should be.
            LimitError: when the start or the reference is outside the plant's joint limits.
            RolloutError: when the recording does not fit into memory, or onto the disk of its file.
            KeyboardInterrupt: on Ctrl-C, unless `partial`.
        """
        how = (values or {}, seed, q0, v0, progress, partial)
        if file is not None:
            if self._metrics or partial:
                raise ParameterError("file", str(file), 'with trajectories, record="all", and partial=False')
            import xarray as xr

            from armgpi.loop.hinted import hinted

            path = check_path(file, "file")
            with files.replace_files([path], str(path)) as (beside,):
                memory = NetCDF(beside)
                loop, run, made_from = self._run_with(*how, memory)
                memory.finish(_collect(loop, run.recording, made_from).dataset())
            opened = xr.open_dataset(path, engine="h5netcdf")
            rollout = hinted(opened)
            rollout.set_close(opened.close)
            return rollout
        loop, run, made_from = self._run_with(*how, self._memory)
        if self._metrics:
            return self._summary(loop, run, final, made_from)
        return _collect(loop, run.recording, made_from).dataset()

    def record(self, progress: bool | None = False, partial: bool = False) -> Recorded:
        """Run the loop as it was prepared, and return what it recorded without making a dataset of it.

        Args:
            progress: as for :meth:`run`.
            partial: likewise.

        Raises:
            ArmgpiError: as :meth:`run`, and where it keeps metrics alone.
        """
        if self._metrics:
            raise ParameterError("record", "metrics", "all")
        loop, run, made_from = self._run_with({}, None, None, None, progress, partial, self._memory)
        return _collect(loop, run.recording, made_from)

    def _run_with(
        self,
        values: Mapping[str, Any],
        seed: Any,
        q0: ArrayLike | None,
        v0: ArrayLike | None,
        progress: bool | None,
        partial: bool,
        memory: Memory,
    ) -> tuple[ClosedLoop, Any, dict[str, Any]]:
        """Run the loop with other numbers; return what was run, what ran it and what that was made from."""
        check_type(progress, "progress", bool | None, "True, False or None")
        loop = self._with(values, seed)
        sample_streams(loop.reference, self.steps * loop.dt, self._backend)
        state = loop.init(q0, v0)
        if not self._reference_checked or loop.reference is not self.loop.reference:
            _check_reference(loop, self.steps * loop.dt)
            self._reference_checked |= loop.reference is self.loop.reference
        shape, every = loop.true_state(state).q.shape, self.steps if self._metrics else self._every
        if self._names is not None:
            known = (*SAMPLED, "disturbance", *loop.controller.signals(state.controller))
            if unknown := sorted(self._names - set(known)):
                raise NameNotFound("variable", unknown[0], known)
        recording = Recording.new(shape, self.steps, loop.dt, every, self._names, self._dtype, memory)
        run = self._run_to_end(loop, state, recording, progress, partial)
        made_from = {"divergence": self._divergence, "t_final": self.steps * loop.dt, "backend": run.backend}
        if self._supervised and self._metrics:
            recording.note_last(run.last, (min(run.done, self.steps) - 1) * loop.dt)
        elif self._supervised and recording.stored:
            recording.note_faults()
        return loop, run, made_from

    def __getstate__(self) -> dict[str, Any]:
        """Return what is not made anew: code belongs to one process."""
        return {**vars(self), "_known": {}, "_variables": None, "_memory": Memory()}

    def __repr__(self) -> str:
        """Return a one-line description."""
        kept = "metrics" if self._metrics else "trajectories"
        return f"PreparedLoop({self.loop.controller!r}, {self.steps} samples, {kept})"

    @property
    def _times(self) -> Array:
        """Times of the samples, and of the state after them [s]."""
        return np.arange(self.steps + 1) * np.float64(self.loop.dt)

    def _with(self, values: Mapping[str, Any], seed: Any) -> ClosedLoop:
        """Return the loop with other numbers; itself without any."""
        check_type(values, "values", Mapping, "name -> value")
        found = check_values(self.parameters, values) if values else {}
        if seed is not None:
            seeds = {name: seed for name, each in self.parameters.items() if each.declared.kind == "seed"}
            found = {**seeds, **found}
        if not found:
            return self.loop
        rows = rows_of(found)
        if rows is not None and rows == 1 and self.loop.batch is not None:
            rows = self.loop.batch
        found = spread_rows(found, rows)
        return with_values(self.loop, found, rows or self.loop.batch or 1)

    def _run_to_end(
        self, loop: ClosedLoop, state: LoopState, recording: Recording, progress: bool | None, partial: bool
    ) -> Any:
        """Run a loop to its end, or until Ctrl-C where a part is wanted, and return what did it."""
        running = None
        if self._metrics:
            running = Running(self._times, loop.plant.robot.limits.effort, Tool(loop.plant))
        steps = self.steps
        run: Runner = NumPyRun(
            loop, state, recording, self._divergence, signals=self._signals, running=running
        )
        with np.errstate(all="ignore"), _progress_bar(steps, progress) as advance:
            try:
                if (patience := self._patience(state, recording)) > _WORTH:
                    run = self._compile(run, loop, state, recording, running, patience)
                drive(run, steps, advance)
            except KeyboardInterrupt:
                if not partial:
                    raise
                run.interrupt()
                dt = recording.dt
                warnings.warn(
                    f"interrupted at t = {run.done * dt:g} s of {steps * dt:g} s; the samples so far "
                    "are stored",
                    ArmgpiWarning,
                    stacklevel=5,
                )
        return run

    def _patience(self, state: LoopState, recording: Recording) -> float:
        """Return how long it may take until there is generated code for a run [s]."""
        if self._backend != "auto":
            return math.inf if self._backend == "compiled" else 0.0
        arm: Any = inside(self.loop.plant)
        twists = isinstance(arm, ElasticPlant)
        sample = _ARRAY * _leaves(state[1:]) + _NUMBER * math.prod(recording.shape) + _GEARS * twists
        steps = getattr(arm, "substeps", 1)
        if getattr(arm, "friction", None) is not None:
            sample += _FRICTION * (1 + twists) * steps
        contacts = len(getattr(arm, "environment", ()))
        sample += (steps - 1) * (_ELASTIC_STEP if twists else _STEP)
        sample += _CONTACT * contacts * steps * (2 if twists else 4)
        self._spent += self.steps * sample
        return self._spent

    def _compile(
        self,
        run: Runner,
        loop: ClosedLoop,
        state: LoopState,
        recording: Recording,
        running: Running | None,
        patience: float,
    ) -> Runner:
        """Return the same run by generated code, or as it is where there is none, perhaps with a warning."""
        try:
            kind = runner("compiled", loop.plant.robot.n, patience)
            how = (self._divergence, self._signals, running, self._known, patience)
            return cast(Runner, kind(loop, state, recording, *how))
        except MissingPackage as error:
            reason = f"{error.package} is not installed (pip install {error.package})"
        except BackendError as error:
            reason = str(error)
        if self._backend == "compiled":
            warnings.warn(f"running by NumPy: {reason}", ArmgpiWarning, stacklevel=6)
        return run

    def _summary(self, loop: ClosedLoop, run: Any, final: bool, made_from: Mapping[str, Any]) -> xr.Dataset:
        """Return the metrics of a run without trajectories."""
        recording, limits = run.recording, loop.plant.robot.limits
        diverged = recording.status == Status.DIVERGED
        interrupted = (recording.status == Status.INTERRUPTED).any()
        last = max(run.done - 1, 1) if interrupted else self.steps
        running, by_name = Running(self._times, limits.effort), dict(zip(TOTALS, run.sums, strict=True))
        has_tool = Tool(loop.plant).motion is not None
        times = self._times[: last + 1]
        totals = Totals(running, by_name.__getitem__, times, limits, has_tool=has_tool)
        found = metrics.of_totals(totals, diverged)
        ends = {}
        if final:
            ends = {name: np.where(diverged[:, None], np.nan, run.last[name]) for name in ("q", "v")}
        key = ("provenance", made_from["backend"])
        if key not in self._known:  # of the loop as it was prepared: every rollout's would take too long
            self._known[key] = provenance({**self.loop.describe(), **made_from})
        like = ("summary", run.backend, recording.shape, final)
        made = summary_dataset(
            recording, loop.plant.robot, found, ends, self._known[key], self._known.get(like)
        )
        if like not in self._known:
            nothing = {name: np.broadcast_to(x.dtype.type(0), x.shape) for name, x in made.data_vars.items()}
            self._known[like] = made.copy(data=nothing)
        return made


def _collect(loop: ClosedLoop, recording: Recording, made_from: Mapping[str, Any]) -> Recorded:
    """Return what a run of a loop recorded."""
    described = {**loop.describe(), **made_from}
    disturbance = loop.plant.disturbance(recording.times)
    return Recorded(recording, loop.plant.robot, disturbance, described, Tool(loop.plant))


def _names(record: Any) -> frozenset[str]:
    """Return the variables to record."""
    if not is_listing(record) or not len(record) or not all(isinstance(name, str) for name in record):
        raise ParameterError("record", record, f"one of {', '.join(RECORDS)}, or names such as ('q', 'tau')")
    return frozenset(record)


def _leaves(state: Any) -> int:
    """Return how many arrays and numbers a state has."""
    return sum(map(_leaves, state)) if isinstance(state, tuple) else 1


def whole_steps(t_final: float, dt: float) -> int:
    """Return the number of samples in `t_final`."""
    t_final = check_number(t_final, "t_final", "a positive, finite time [s]", open_=True)
    if t_final / dt > _MOST_STEPS:
        raise ParameterError("t_final", t_final, f"at most {_MOST_STEPS:g} sample times of {dt:g} s")
    steps = round(t_final / dt)
    if steps < 1:
        raise ParameterError("t_final", t_final, f"at least one sample time, {dt:g} s")
    return steps


def _check_reference(loop: ClosedLoop, t_final: float) -> None:
    """Refuse a reference that leaves the joint limits or is not finite."""
    robot = loop.plant.robot
    numbers = math.prod(loop._target_shape)
    times = np.linspace(0.0, t_final, max(_FEWEST_CHECKS, min(_MOST_CHECKS, _CHECKED_NUMBERS // numbers)))
    target = loop.targets(times)
    if not all(np.isfinite(part).all() for part in target):
        raise ArrayError("reference", "expected finite positions, velocities and accelerations")
    outside = robot.outside(target.q[:, None])  # whether arms and targets are one or many
    if outside is not None:
        what = f"the reference at t = {times[outside.place[0]]:.4g} s"
        remedy = "choose another goal, or other limits with robot.with_limits(...)"
        raise LimitError(what, *outside[1:], remedy)


@contextmanager
def _progress_bar(steps: int, wanted: bool | None) -> Iterator[Callable[[int], None]]:
    """Give a function that counts samples; it shows a bar on a terminal once the run gets long."""
    if wanted is None:
        wanted = sys.stderr.isatty()
    if not wanted:
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import Progress

    bar = Progress(console=Console(stderr=True), transient=True)
    task = bar.add_task("simulating", total=steps)
    begun = time.monotonic()

    def advance(count: int) -> None:
        bar.advance(task, count)
        if not bar.live.is_started and time.monotonic() - begun > _LONG:
            bar.start()

    try:
        yield advance
    finally:
        bar.stop()
