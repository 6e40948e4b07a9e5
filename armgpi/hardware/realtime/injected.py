"""What goes wrong on purpose: lost datagrams, outages, a controller that stalls or dies."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import as_sized_array, check_number, check_whole
from armgpi.errors import ArrayError, ParameterError


class Injected:
    """Faults of a loop over a wire. They are at the arm's end, so that the controller knows nothing of them.

    Attributes:
        loss: probability that a datagram is lost, either way.
        outage: begin and length of a time in which all are lost [s]; None for none.
        stall: begin and length of a time in which the controller does nothing [s]; None for none.
        kill: when the controller is killed [s]; None for never.
        seed: of what is lost.
    """

    def __init__(
        self,
        loss: float = 0.0,
        outage: tuple[float, float] | None = None,
        stall: tuple[float, float] | None = None,
        kill: float | None = None,
        seed: int = 0,
    ) -> None:
        """Define what goes wrong.

        Raises:
            ParameterError: for a probability outside [0, 1), or a negative time.
            ArrayError: for an outage or stall that is no begin and length.
        """
        self.loss = check_number(loss, "loss", "0 to below 1", 0.0, 1.0)
        if self.loss == 1.0:
            raise ParameterError("loss", loss, "0 to below 1")
        self.outage = None if outage is None else _stretch(outage, "outage")
        self.stall = None if stall is None else _stretch(stall, "stall")
        self.kill = None if kill is None else check_number(kill, "kill", "zero or positive [s]", 0.0)
        self.seed = check_whole(seed, "seed", 0)

    def prepare(self, steps: int, dt: float) -> Schedule:
        """Return what happens at each of so many samples."""
        lost = np.random.default_rng(self.seed).random((steps, 2)) < self.loss
        if self.outage is not None:
            lost[_samples(self.outage, dt)] = True
        stalled = np.zeros(steps, dtype=bool)
        if self.stall is not None:
            stalled[_samples(self.stall, dt)] = True
        killed = steps if self.kill is None else min(steps, round(self.kill / dt))
        return Schedule(lost, stalled, killed)

    def describe(self) -> dict[str, object]:
        """Return the parameters as plain data."""
        return {name: getattr(self, name) for name in ("loss", "outage", "stall", "kill", "seed")}


class Schedule:
    """What goes wrong at each sample.

    Attributes:
        lost: shape (steps, 2): whether its sample gets lost, and the torque that comes while it waits.
        stalled: shape (steps,): whether the controller does nothing.
        killed: the sample at which it is killed; the number of samples for never.
    """

    def __init__(self, lost: npt.NDArray[np.bool_], stalled: npt.NDArray[np.bool_], killed: int) -> None:
        """Take the faults of all samples."""
        self.lost, self.stalled, self.killed = lost, stalled, killed

    @cached_property
    def signals(self) -> dict[int, str]:
        """Sample -> what is done to the controller's process there: "stop", "continue" or "kill"."""
        edges = np.diff(np.concatenate([[0], self.stalled.astype(int)]))
        found = {int(k): "stop" if edges[k] > 0 else "continue" for k in np.flatnonzero(edges)}
        if self.killed < len(self.stalled):
            found[self.killed] = "kill"
        return found


def _stretch(value: object, name: str) -> tuple[float, float]:
    """Return begin and length of a time."""
    both = as_sized_array(value, name)
    if both.shape != (2,) or (both < 0.0).any():
        raise ArrayError(name, f"expected begin and length [s], not negative, got {value!r}")
    return float(both[0]), float(both[1])


def _samples(stretch: tuple[float, float], dt: float) -> slice:
    begin = round(stretch[0] / dt)
    return slice(begin, begin + round(stretch[1] / dt))
