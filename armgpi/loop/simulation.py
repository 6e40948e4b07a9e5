"""One verb, `simulate`: a closed loop run to its end, one rollout or a batch of them."""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import xarray as xr

from armgpi.arrays import ArrayLike, check_choice, check_number, check_type, check_whole
from armgpi.control.controller import Controller
from armgpi.errors import ArmgpiWarning, ArrayError, BackendError, LimitError, ParameterError
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.rollout import Recording, to_dataset
from armgpi.loop.runner import DIVERGENCE, NumPyRun, Runner, drive
from armgpi.plants.plant import Plant
from armgpi.references.reference import Reference

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
        ParameterError: when an argument is not as it should be, or the parts do not match.
        ArrayError: when an array is not as it should be.
        LimitError: when the start or the reference is outside the plant's joint limits.
    """
    loop = ClosedLoop(plant, controller, reference)
    steps = _whole_steps(t_final, loop.dt)
    record_every = check_whole(record_every, "record_every", 1)
    divergence = check_number(divergence, "divergence", "positive [rad or m]", open_=True)
    check_choice(backend, "backend", BACKENDS)
    check_type(signals, "signals", bool, "True or False")
    check_type(progress, "progress", bool | None, "True, False or None")
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
    outside = robot.outside(q)
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
