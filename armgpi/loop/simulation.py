"""The loop: plant, controller and reference together, one rollout or a batch of them."""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from armgpi.arrays import Array, ArrayLike, as_joint_array, check_number, check_whole, new
from armgpi.control.controller import Controller, FullState, Measurement, common_batch
from armgpi.errors import ArmgpiWarning, ArrayError, BackendError, LimitError, ParameterError
from armgpi.loop.rollout import Recording, to_dataset
from armgpi.loop.runner import DIVERGENCE, NumPyRun, Runner, drive
from armgpi.plants.plant import Plant, PlantState
from armgpi.references.reference import Reference, Target

#: More samples than this cannot be counted in a float.
_MOST_STEPS = 1e15
#: How many configurations of the reference are checked against the joint limits before the run.
_MOST_CHECKS = 2001
#: How many they are at least, where the reference of a large batch ...
_FEWEST_CHECKS = 65
#: ... has more numbers in all than this.
_CHECKED_NUMBERS = 1 << 20
#: Seconds after which a run gets a progress bar.
_LONG = 2.0
#: What takes the samples of a run.
BACKENDS = ("numpy", "compiled", "auto")
#: About what NumPy takes for the calls of a sample, whatever its size [s].
_CALLS = 6e-5
#: What it takes for each number in a sample on top [s].
_NUMBER = 5e-7
#: A run that NumPy takes longer for is worth compiling [s]: about what a compiler takes.
_WORTH = 2.0


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

    def describe(self) -> dict[str, Any]:
        """Return the parts, and what the controller measures, as plain data for a rollout's provenance."""
        return {
            "plant": self.plant.describe(),
            "controller": self.controller.describe(),
            "reference": self.reference.describe(),
            "measurement": self.controller.measurement_type.__name__,
        }

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
    divergence: float = DIVERGENCE,
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
            [rad or m], or when a velocity or torque is not finite.
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
    by_numpy = NumPyRun(loop, state, recording, divergence, signals=signals)
    run = _finished(by_numpy, steps, backend, progress)
    return to_dataset(
        recording,
        loop.plant.robot,
        loop.plant.disturbance(recording.times),
        {
            **loop.describe(),
            "divergence": divergence,
            "t_final": steps * loop.dt,
            "backend": run.backend,
        },
    )


def _finished(by_numpy: NumPyRun, steps: int, backend: str, progress: bool | None) -> Runner:
    """Run a loop to its end, or until Ctrl-C, and return what did it: generated code or NumPy as it was."""
    run: Runner = by_numpy
    with np.errstate(all="ignore"), _progress_bar(steps, progress) as advance:
        try:
            if _worth_compiling(backend, run.recording, steps):
                run = _compiled(by_numpy, warn=backend == "compiled")
            drive(run, steps, advance)
        except KeyboardInterrupt:
            run.interrupt()
            dt = run.recording.dt
            warnings.warn(
                f"interrupted at t = {run.done * dt:g} s of {steps * dt:g} s; kept what is there",
                ArmgpiWarning,
                stacklevel=3,
            )
    return run


def _worth_compiling(backend: str, recording: Recording, steps: int) -> bool:
    """Tell whether to run by generated code."""
    slow = steps * (_CALLS + _NUMBER * math.prod(recording.shape))
    return backend == "compiled" or (backend == "auto" and slow > _WORTH)


def _compiled(run: NumPyRun, warn: bool) -> Runner:
    """Return the same run by generated code, or as it is where that cannot be, with a warning if wanted."""
    try:
        from armgpi.compiled.run import CompiledRun

        return CompiledRun(run.loop, run.state, run.recording, run.divergence, run.signals)
    except ModuleNotFoundError as error:
        reason = f"{error.name} is not installed (pip install 'armgpi[compiled]')"
    except BackendError as error:
        reason = str(error)
    if warn:
        warnings.warn(f"running by NumPy: {reason}", ArmgpiWarning, stacklevel=4)
    return run


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
