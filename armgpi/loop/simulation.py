"""The loop: plant, controller and reference together, one rollout or a batch of them."""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from armgpi.arrays import Array, ArrayLike, as_joint_array, check_number, check_whole, new
from armgpi.control.controller import Controller, FullState, Measurement, common_batch
from armgpi.errors import ArmgpiWarning, ArrayError, BackendError, LimitError, ParameterError
from armgpi.loop.rollout import Recording, Status, to_dataset
from armgpi.plants.plant import Plant, PlantState
from armgpi.references.reference import Reference, Target

if TYPE_CHECKING:
    from armgpi.compiled.run import CompiledRun

#: Longest stretch of samples between two looks at whether something diverged.
_CHUNK = 256
#: Numbers per recorded quantity and chunk, so that a batch of thousands stays in memory.
_CHUNK_NUMBERS = 1 << 19
#: More samples than this cannot be counted in a float.
_MOST_STEPS = 1e15
#: How many configurations of the reference are checked against the joint limits before the run; fewer where
#: the reference of a large batch has more numbers in all than this.
_MOST_CHECKS, _FEWEST_CHECKS, _CHECKED_NUMBERS = 2001, 65, 1 << 20
#: Seconds after which a run gets a progress bar.
_LONG = 2.0
#: What takes the samples of a run.
BACKENDS = ("numpy", "compiled", "auto")
#: About what NumPy takes for a sample [s], and for each number in it; and what is worth compiling for.
_CALLS, _NUMBER, _WORTH = 6e-5, 5e-7, 2.0


class LoopState(NamedTuple):
    """State of a closed loop.

    Attributes:
        k: number of samples taken.
        plant: state of the plant.
        controller: state of the controller.
    """

    k: int
    plant: Any
    controller: Any


class LoopStep(NamedTuple):
    """Result of one sample of a closed loop.

    Attributes:
        state: the next state.
        measured: what the sensors said at the sample.
        tau: torque that the controller asked for [N m or N], shape (n,) or (batch, n).
    """

    state: LoopState
    measured: FullState
    tau: Array


class ClosedLoop:
    """A plant under a controller that follows a reference, one sample at a time.

    :func:`simulate` is a loop over :meth:`step`; use this class for a loop of your own.

    Attributes:
        plant: what moves.
        controller: what moves it.
        reference: where to.
        dt: sample time [s], the controller's.
        batch: number of rollouts, None for a single one.
    """

    def __init__(self, plant: Plant, controller: Controller, reference: Reference) -> None:
        """Check that the three go together.

        Raises:
            ParameterError: when an argument is of another kind, or joints or batches differ.
            ArrayError: when the reference has another number of joints.
        """
        for name, value, kind in (
            ("plant", plant, Plant),
            ("controller", controller, Controller),
            ("reference", reference, Reference),
        ):
            if not isinstance(value, kind):
                raise ParameterError(name, value, f"a {kind.__name__}")
        if plant.robot.joint_names != controller.robot.joint_names:
            raise ParameterError(
                "controller",
                ", ".join(controller.robot.joint_names),
                f"for the plant's joints {', '.join(plant.robot.joint_names)}",
            )
        self.plant = plant
        self.controller = controller
        self.reference = reference
        self.dt = controller.dt
        first = _arrays(reference.at(0.0))
        if first.q.ndim not in (1, 2) or first.q.shape[-1] != plant.robot.n:
            raise ArrayError(
                "reference",
                f"expected targets of shape (n,) or (batch, n) with n = {plant.robot.n}, got {first.q.shape}",
            )
        self._target_shape = first.q.shape
        self.batch = common_batch(plant.batch, controller.batch, first.q)
        if self.batch == 0:
            raise ArrayError("reference", "expected at least one rollout, got an empty batch")
        self._measures_velocity = controller.measurement_type is FullState

    def init(self, q0: ArrayLike | None = None, v0: ArrayLike | None = None) -> LoopState:
        """Return the state at time 0.

        Args:
            q0: starting positions [rad or m], (n,) or (batch, n); the reference's when not given.
            v0: starting velocities [rad/s or m/s], zero when not given.

        Raises:
            ArrayError: when an array is not as it should be.
            LimitError: when the start is outside the joint limits.
        """
        robot = self.plant.robot
        target = self.reference.at(0.0)
        q = robot.check_position(target.q if q0 is None else q0, "the start q0")
        v = np.zeros_like(q) if v0 is None else as_joint_array(v0, "v0", robot.joint_names)
        batch = common_batch(self.batch, q, v)
        if batch == 0:
            raise ArrayError("q0", "expected at least one rollout, got an empty batch")
        shape = (robot.n,) if batch is None else (batch, robot.n)
        q, v = (np.ascontiguousarray(np.broadcast_to(x, shape)) for x in (q, v))
        state = self.plant.init(q, v)
        return LoopState(0, state, self.controller.init(self._seen(self.plant.measure(state)), target))

    def targets(self, times: Array) -> Target:
        """Return the targets at some times [s], shape (k,): arrays (k, n) or (k, batch, n).

        Raises:
            ArrayError: when the reference, which may be a user's, gives something else.
        """
        target = _arrays(self.reference.at(times.copy()))
        expected = (len(times), *self._target_shape)
        if target.q.shape != expected:
            raise ArrayError(
                "reference",
                f"expected targets of shape {expected} at {len(times)} times, got {target.q.shape}",
            )
        return target

    def step(self, state: LoopState, target: Target | None = None) -> LoopStep:
        """Take one sample: measure, control, and hold the torque until the next.

        Args:
            state: from :meth:`init` or the step before.
            target: the reference at this time, if you have it; evaluated when not given.
        """
        if target is None:
            target = self.reference.at(state.k * self.dt)
        plant, controller, measured, tau = self._sample(state.plant, state.controller, target)
        return LoopStep(LoopState(state.k + 1, plant, controller), measured, tau)

    def _sample(self, plant: Any, controller: Any, target: Target) -> tuple[Any, Any, FullState, Array]:
        """Return the next states of plant and controller, what was measured and the torque asked for."""
        measured = self.plant.measure(plant)
        seen = measured if self._measures_velocity else new(Measurement, (measured.q,))
        tau, controller = self.controller.step(seen, target, controller)
        return self.plant.step(tau, plant, self.dt), controller, measured, tau

    def true_state(self, state: LoopState) -> PlantState:
        """Return the true state of the plant."""
        return self.plant.true_state(state.plant)

    def _seen(self, measured: FullState) -> Measurement | FullState:
        """Return the part of a measurement that the controller may see."""
        return measured if self._measures_velocity else Measurement(measured.q)


def simulate(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    t_final: float,
    *,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    record_every: int = 1,
    signals: bool = False,
    divergence: float = 10.0,
    progress: bool | None = None,
    backend: str = "numpy",
) -> xr.Dataset:
    """Run a closed loop and return its rollout.

    Args:
        plant: what moves.
        controller: what moves it; its sample time is the loop's.
        reference: where to.
        t_final: how long [s], rounded to whole samples.
        q0: starting positions [rad or m], (n,) or (batch, n); the reference's start when not given.
        v0: starting velocities [rad/s or m/s], zero when not given.
        record_every: record every so many samples.
        signals: record the controller's inner signals as well.
        divergence: a rollout has diverged when a joint is farther than this from its reference
            [rad or m], or when a number is not finite.
        progress: show a progress bar; when not given, on a terminal and for long runs.
        backend: "numpy"; "compiled" for generated code (see :mod:`armgpi.compiled`), with a warning and NumPy
            where there can be none; "auto" for generated code where it saves more time than it takes to make.

    Returns:
        A dataset with the dimensions time, joint and, for a batch, rollout: see :mod:`armgpi.loop.rollout`. A
        rollout that diverges is NaN from then on and says when; the others go on. Ctrl-C ends the run
        and returns what is there, with the status "interrupted".

    Raises:
        ParameterError: when an argument is not as it should be, or the parts do not go together.
        ArrayError: when an array is not as it should be.
        LimitError: when the start or the reference is outside the plant's joint limits.
    """
    loop = ClosedLoop(plant, controller, reference)
    steps = _whole_steps(t_final, loop.dt)
    record_every = check_whole(record_every, "record_every", 1)
    divergence = check_number(divergence, "divergence", "positive [rad or m]", open_=True)
    if backend not in BACKENDS:
        raise ParameterError("backend", backend, f"one of {', '.join(BACKENDS)}")
    state = loop.init(q0, v0)
    _check_reference(loop, steps * loop.dt)

    recording = Recording.new(loop.true_state(state).q.shape, steps, loop.dt, record_every)
    plain = _Run(loop, state, recording, divergence, signals)
    run: _Run | CompiledRun = plain
    with np.errstate(all="ignore"), _progress_bar(steps, progress) as advance:
        try:
            if _worth_compiling(backend, recording, steps):
                run = _compiled(plain, warn=backend == "compiled")
            while run.done < steps and recording.running.any():
                advance(run.take(min(run.chunk, steps - run.done)))
            run.finish()
        except KeyboardInterrupt:
            run.interrupt()
            warnings.warn(
                f"interrupted at t = {run.done * loop.dt:g} s of {steps * loop.dt:g} s; kept what is there",
                ArmgpiWarning,
                stacklevel=2,
            )
    return to_dataset(
        recording,
        loop.plant.robot,
        loop.plant.disturbance(recording.times),
        {
            "plant": plant.describe(),
            "controller": controller.describe(),
            "reference": reference.describe(),
            "divergence": divergence,
            "measurement": controller.measurement_type.__name__,
            "t_final": steps * loop.dt,
            "backend": "numpy" if isinstance(run, _Run) else "compiled",
        },
    )


def _worth_compiling(backend: str, recording: Recording, steps: int) -> bool:
    """Tell whether to run by generated code."""
    slow = steps * (_CALLS + _NUMBER * math.prod(recording.shape))
    return backend == "compiled" or (backend == "auto" and slow > _WORTH)


def _compiled(run: _Run, warn: bool) -> _Run | CompiledRun:
    """Return the same run by generated code, or as it is where that cannot be, with a warning if wanted."""
    try:
        from armgpi.compiled.run import CompiledRun

        return CompiledRun(run.loop, run.state, run.recording, run.divergence, run.signals)
    except ModuleNotFoundError as error:
        reason = f"{error.name} is not installed (pip install 'armgpi[compiled]')"
    except BackendError as error:
        reason = str(error)
    if warn:
        warnings.warn(f"running by NumPy: {reason}", ArmgpiWarning, stacklevel=3)
    return run


class _Run:
    """A run in progress.

    Samples are collected in stretches at full rate; after each stretch they are looked through for
    divergence and moved, thinned, to the recording. So the loop itself has no checks in it.
    """

    def __init__(
        self, loop: ClosedLoop, state: LoopState, recording: Recording, divergence: float, signals: bool
    ) -> None:
        self.loop = loop
        self.state = state
        self.recording = recording
        self.divergence = divergence
        self.signals = signals
        self.done = 0
        self.chunk = max(16, min(_CHUNK, _CHUNK_NUMBERS // math.prod(recording.shape)))
        # What ClosedLoop._sample returns, sample by sample.
        self._samples: list[tuple[Any, Any, FullState, Array]] = []

    def take(self, count: int) -> int:
        """Take `count` samples and record them: the hot path."""
        sample, samples = self.loop._sample, self._samples
        _, plant, controller = self.state
        self._block = self._targets(count)
        for target in zip(*self._block, strict=True):
            taken = plant, controller, _, _ = sample(plant, controller, new(Target, target))
            samples.append(taken)
        self._keep()
        return count

    def finish(self) -> None:
        """Record the state after the last sample, its torque still held."""
        _, plant, controller = self.state
        measured = self.loop.plant.measure(plant)
        self._block = self._targets(1)
        self._samples.append((plant, controller, measured, self._last_command))
        self._keep()

    def interrupt(self) -> None:
        """Keep the samples that were whole when the user stopped the run."""
        self._keep()
        recording = self.recording
        recording.t_end[recording.running] = self.done * self.loop.dt
        recording.status[recording.running] = Status.INTERRUPTED

    def _targets(self, count: int) -> Target:
        """Return the targets of the next samples."""
        return self.loop.targets(np.arange(self.done, self.done + count) * np.float64(self.loop.dt))

    def _keep(self) -> None:
        """Look for divergence in the samples taken, then move them to the recording."""
        samples, count = self._samples, len(self._samples)
        if not count:
            return
        plants, controllers, measured, commands = zip(*samples, strict=True)
        after = [self.loop.plant.true_state(state) for state in plants]
        before = [self.loop.true_state(self.state), *after[:-1]]
        columns = {
            "q": [truth.q for truth in before],
            "v": [truth.v for truth in before],
            "q_measured": [seen.q for seen in measured],
            "tau_command": commands,
            "tau": [truth.tau for truth in after],
        }
        if self.signals:
            values = [self.loop.controller.signals(state) for state in controllers]
            columns.update({name: [value[name] for value in values] for name in values[0]})
        # One row per rollout, a single run being one row: (samples, rollouts, n).
        n = self.loop.plant.robot.n
        rows = {name: np.concatenate(parts).reshape(count, -1, n) for name, parts in columns.items()}
        # What was interrupted used the beginning of its stretch of targets.
        q_ref, v_ref = (
            np.broadcast_to(x[:count].reshape(count, -1, n), rows["q"].shape) for x in self._block[:2]
        )
        self._mark_diverged(rows, q_ref)
        after_all = LoopState(self.done + count, plants[-1], controllers[-1])
        self.recording.store(self.done, {**rows, "q_ref": q_ref, "v_ref": v_ref})
        # Assignments only from here on: no Ctrl-C comes between them.
        self._last_command = commands[-1]
        self.state = after_all
        self.done = after_all.k
        self._samples = []

    def _mark_diverged(self, rows: Mapping[str, Array], q_ref: Array) -> None:
        """Note which rollouts have diverged and when, and blank what came after."""
        recording = self.recording
        good = np.abs(rows["q"] - q_ref) <= self.divergence
        good &= np.isfinite(rows["v"]) & np.isfinite(rows["tau"])
        whole = np.asarray(good.all(axis=-1))
        # A rollout that has diverged stays so, wherever it strays to afterwards.
        for row in np.flatnonzero(~whole.all(axis=0) | ~recording.running):
            if recording.running[row]:
                first = int(np.argmin(whole[:, row]))
                recording.status[row] = Status.DIVERGED
                recording.t_end[row] = (self.done + first) * self.loop.dt
            # Known from an earlier stretch, or from this one if Ctrl-C came while it was stored.
            first = max(0, round(recording.t_end[row] / self.loop.dt) - self.done)
            for values in rows.values():
                values[first:, row] = np.nan


def _arrays(target: Any) -> Target:
    """Return a target whose three parts are arrays of floats and of one shape, or refuse it."""
    if not isinstance(target, Target):
        raise ArrayError("reference", f"expected a Target(q, v, a), got a {type(target).__name__}")
    for name, part in zip(Target._fields, target, strict=True):
        kind = part.dtype.str if isinstance(part, np.ndarray) else type(part).__name__
        if kind != np.dtype(np.float64).str:
            raise ArrayError("reference", f"expected targets of native float64, got {name} of {kind!r}")
        if part.shape != target[0].shape:
            shapes = f"{target[0].shape} and {part.shape}"
            raise ArrayError("reference", f"expected q, v and a of one shape, got {shapes}")
    return Target(*map(np.asarray, target))


def _whole_steps(t_final: float, dt: float) -> int:
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
    rank = 2 if target.q.ndim == 3 or robot.batch is not None else 1
    q = target.q if target.q.ndim == rank + 1 else target.q[:, None]
    if not all(np.isfinite(part).all() for part in target):
        raise ArrayError("reference", "expected finite positions, velocities and accelerations")
    lower, upper = robot.limits.lower, robot.limits.upper
    slack = 1e-9 * np.maximum(1.0, np.abs(q))
    beyond = (q < lower - slack) | (q > upper + slack)
    outside = np.argwhere(beyond)
    if outside.size:
        index = tuple(int(i) for i in outside[0])
        value, low, high = (np.broadcast_to(x, beyond.shape)[index] for x in (q, lower, upper))
        raise LimitError(
            f"the reference at t = {times[index[0]]:.4g} s",
            robot.joint_names[index[-1]],
            value,
            low,
            high,
            "choose another goal, or other limits with robot.with_limits(...)",
        )


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
