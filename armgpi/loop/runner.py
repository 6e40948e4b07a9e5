"""What takes the samples of a closed loop: the protocol, what drives it, and the loop by NumPy.

Every run of a loop goes this way: :func:`armgpi.simulate`'s, by NumPy or by generated code
(:mod:`armgpi.codegen.run`), and the log of an exported controller (:mod:`armgpi.hardware.export.files`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array, new
from armgpi.control.controller import FullState
from armgpi.loop.closed_loop import ClosedLoop, LoopState
from armgpi.loop.rollout import Recording
from armgpi.loop.running import Running
from armgpi.references.reference import Target

#: A rollout has diverged when a joint is farther than this from its reference [rad or m].
DIVERGENCE = 10.0
#: Longest stretch of samples between two checks whether something diverged [samples].
_CHUNK = 256
#: Numbers per recorded quantity and chunk, so that a batch of thousands stays in memory.
_CHUNK_NUMBERS = 1 << 19


class Runner(Protocol):
    """A run of a closed loop in progress.

    Attributes:
        recording: where samples go, and which rollouts still run.
        done: samples taken.
        chunk: samples that are best taken at once, from now on.
    """

    recording: Recording
    done: int
    chunk: int

    @property
    def backend(self) -> str:
        """Name of what takes the samples, for a rollout's provenance."""

    def take(self, count: int) -> int:
        """Take and record `count` samples, and return how many that were; note which rollouts diverged."""

    def finish(self) -> None:
        """Record the state after the last sample, its torque still held."""

    def interrupt(self) -> None:
        """Keep the samples that were whole when the user stopped the run."""


def drive(run: Runner, steps: int, advance: Callable[[int], None] = lambda count: None) -> None:
    """Take samples until there are so many or no rollout runs any more, and finish.

    Args:
        run: the run, in which nothing was taken yet.
        steps: samples to take.
        advance: is given the number of samples after each chunk.
    """
    while run.done < steps and run.recording.running.any():
        advance(run.take(min(run.chunk, steps - run.done)))
    run.finish()


def in_control(error: Array, v: Array, tau: Array, divergence: float) -> npt.NDArray[np.bool_]:
    """Tell for every sample whether its rollout has not diverged; `loop.h` has the same rule in C.

    Args:
        error: q - q_ref [rad or m], shape (..., n).
        v: velocities, likewise.
        tau: torques, likewise.
        divergence: largest error [rad or m].

    Returns:
        Shape (...). A NaN anywhere is a divergence.
    """
    good = np.abs(error) <= divergence
    good &= np.isfinite(v) & np.isfinite(tau)
    return np.asarray(good.all(axis=-1))


class NumPyRun:
    """The loop as it is written, one call of every part for each sample and all rollouts.

    Samples are collected in stretches at full rate; after each stretch they are looked through for
    divergence and moved, thinned, to the recording. So the loop itself has no checks in it.
    """

    backend = "numpy"

    def __init__(
        self,
        loop: ClosedLoop,
        state: LoopState,
        recording: Recording,
        divergence: float = DIVERGENCE,
        *,
        signals: bool = False,
        inputs: bool = False,
        running: Running | None = None,
    ) -> None:
        """Begin a run.

        Args:
            loop: what to run.
            state: its state at the start.
            recording: where samples go.
            divergence: largest error of a rollout that runs [rad or m].
            signals: record the controller's inner signals as well.
            inputs: record as well what else a controller may be given: `v_measured` and `a_ref`.
            running: what adds up samples in place of recording them; the sums are in `sums`.
        """
        # What does not change.
        self.loop = loop
        self.divergence = divergence
        self.running = running
        self.signals = signals
        self.inputs = inputs
        self.chunk = max(16, min(_CHUNK, _CHUNK_NUMBERS // math.prod(recording.shape)))
        # The loop after `done` samples, and what is kept of them.
        self.state = state
        self.done = 0
        self.recording = recording
        shape = (len(recording.status), recording.shape[-1])
        self.sums: Any = None if running is None else running.init(shape)
        self.last: dict[str, Array] = {}
        # The samples since: what ClosedLoop._sample returned, and the targets.
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
        self.recording.interrupt(self.done)

    def _targets(self, count: int) -> Target:
        """Return the targets of the next samples."""
        samples = np.arange(self.done, self.done + count)
        return self.loop.targets(samples * np.float64(self.loop.dt))

    def _keep(self) -> None:
        """Look for divergence in the samples taken, then move them to the recording."""
        count = len(self._samples)
        if not count:
            return
        plant, controller, _, command = self._samples[-1]
        rows, targets = self._rows()
        last = {}
        if self.running is not None:  # before those that diverged are blanked
            last = {name: values[-1].copy() for name, values in rows.items()}
        self._mark_diverged(rows, targets["q_ref"])
        state = LoopState(self.done + count, plant, controller)
        if self.running is None:
            self.recording.store(self.done, {**rows, **targets})
        else:
            seen = rows["q"], targets["q_ref"], rows["tau"]
            self.sums = self.running.add_all(self.done, *seen, self.sums, v=rows["v"])
            self.last = last
        # Assignments only from here on: no Ctrl-C comes between them.
        self._last_command = command
        self.state = state
        self.done = state.k
        self._samples = []

    def _rows(self) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return what was sampled, and the targets, each (samples, rollouts, n); one run is one rollout."""
        plants, controllers, measured, commands = zip(*self._samples, strict=True)
        after = [self.loop.plant.true_state(state) for state in plants]
        before = [self.loop.true_state(self.state), *after[:-1]]
        columns: dict[str, Sequence[Array]] = {
            "q": [truth.q for truth in before],
            "v": [truth.v for truth in before],
            "q_measured": [seen.q for seen in measured],
            "tau_command": commands,
            "tau": [truth.tau for truth in after],
        }
        controller = self.loop.controller
        reported_by = controller.signals if self.signals else controller.reported
        reported = [reported_by(state) for state in controllers]
        for name in reported[0]:
            columns[name] = [values[name] for values in reported]
        if self.inputs:
            columns["v_measured"] = [seen.v for seen in measured]
        count, n = len(plants), self.loop.plant.robot.n
        rows = {name: np.concatenate(column).reshape(count, -1, n) for name, column in columns.items()}
        targets = {}
        for name, values in self._block._asdict().items():
            if name != "a" or self.inputs:
                # What was interrupted used the beginning of its stretch of targets.
                used = values[:count].reshape(count, -1, n)
                targets[f"{name}_ref"] = np.broadcast_to(used, rows["q"].shape)
        return rows, targets

    def _mark_diverged(self, rows: Mapping[str, Array], q_ref: Array) -> None:
        """Note which rollouts have diverged and when, and blank what came after."""
        recording = self.recording
        whole = in_control(rows["q"] - q_ref, rows["v"], rows["tau"], self.divergence)
        # A rollout that has diverged stays so, wherever it strays to afterwards.
        for row in np.flatnonzero(~whole.all(axis=0) | ~recording.running):
            if recording.running[row]:
                first_bad = int(np.argmin(whole[:, row]))
                recording.diverge(row, self.done + first_bad)
            # Known from an earlier stretch, or from this one if Ctrl-C came while it was stored.
            end = round(recording.t_end[row] / recording.dt)
            first = max(0, end - self.done)
            for values in rows.values():
                values[first:, row] = np.nan
