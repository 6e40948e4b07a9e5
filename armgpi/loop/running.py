"""Running sums from which every metric follows: a loop that keeps no trajectories adds them up as it goes.

They are elementwise NumPy, which the generated code does as well. Their number does not depend on the length
of the run.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array, new

#: Hunting is looked for in the last seconds, but in no more than this share of the horizon.
LAST, SHARE = 1.2, 0.2
#: Less than this is no more than rounding [rad, m, N m, N, s].
ROUNDING = 1e-12
#: A torque is at its limit from this share of it on.
LIMIT_SHARE = 1.0 - 1e-9


class Sums(NamedTuple):
    """What is added up over the samples, arrays (n,) or (batch, n); the first one counts half in integrals.

    Attributes:
        timed: sum of k abs(e), k the sample's number [rad or m].
        absolute: sum of abs(e) [rad or m].
        squared: sum of e^2 [rad^2 or m^2].
        peak: largest abs(e) [rad or m].
        e: the last tracking error [rad or m].
        effort: sum of squared torques before the last one.
        variation: sum of abs(tau_k - tau_(k - 1)) [N m or N].
        peak_torque: largest abs(tau) [N m or N].
        saturated: samples before the last one with the torque at its limit.
        tau: the last torque [N m or N].
        lowest: lowest position [rad or m].
        highest: highest position [rad or m].
        low: lowest error of the last seconds [rad or m].
        high: highest error of the last seconds [rad or m].
        way: sum of abs(e_k - e_(k - 1)) in the last seconds [rad or m].
        target_low: lowest target of the last seconds [rad or m].
        target_high: highest target of the last seconds [rad or m].
    """

    timed: Array
    absolute: Array
    squared: Array
    peak: Array
    e: Array
    effort: Array
    variation: Array
    peak_torque: Array
    saturated: Array
    tau: Array
    lowest: Array
    highest: Array
    low: Array
    high: Array
    way: Array
    target_low: Array
    target_high: Array


class _Fold(NamedTuple):
    """How samples change a sum: one after the other, and many along a first axis with the same bits."""

    one: Callable[[Any, Any], Any]
    all: Callable[[Array, Array], Array]


_ADD = _Fold(operator.add, lambda s, x: np.cumsum(np.concatenate([s[None], x]), axis=0)[-1])
_LEAST = _Fold(np.minimum, lambda s, x: np.minimum(s, x.min(axis=0, initial=np.inf)))
_MOST = _Fold(np.maximum, lambda s, x: np.maximum(s, x.max(axis=0, initial=-np.inf)))
_LAST = _Fold(lambda s, x: x, lambda s, x: x[-1])
#: Of the sums in their order, and of those of the last seconds; when the terms of these begin to count.
_FOLDS = (_ADD, _ADD, _ADD, _MOST, _LAST, _ADD, _ADD, _MOST, _ADD, _LAST, _LEAST, _MOST)
_LATE_FOLDS, _SINCE = (_LEAST, _MOST, _ADD, _LEAST, _MOST), (-0.5, -0.5, 0.5, -0.5, -0.5)


def _late_terms(e: Array, q_ref: Array, e_before: Array) -> tuple[Array, ...]:
    """Return what a sample of the last seconds adds to the sums of these."""
    return e, e, np.abs(e - e_before), q_ref, q_ref


class Running:
    """Adds samples to :class:`Sums`.

    Attributes:
        dt: sample time [s].
        late: number of the first sample of the last seconds.
    """

    def __init__(self, steps: int, dt: float, effort: Array) -> None:
        """Begin a run of so many samples with these torque limits, (n,) or (batch, n)."""
        self.dt = dt
        end = steps * dt
        # The rule of the metrics, on the times that they see.
        last = end - min(LAST, SHARE * end) - ROUNDING
        first = max(0, math.floor(last / dt) - 1)
        self.late = np.array(float(next(k for k in range(first, steps + 1) if k * np.float64(dt) >= last)))
        self._limit = effort * LIMIT_SHARE

    def init(self, shape: tuple[int, ...]) -> Sums:
        """Return the sums of no samples, of this shape."""
        zero, most = np.zeros(shape), np.full(shape, np.inf)
        ends = {"lowest": most, "highest": -most, "low": most, "high": -most}
        ends |= {"target_low": most, "target_high": -most}
        return Sums(*(ends.get(name, zero) for name in Sums._fields))

    def add(self, k: Any, q: Array, q_ref: Array, tau: Array, s: Sums, late: bool = True) -> Sums:
        """Return the sums with one more sample.

        Args:
            k: number of the sample.
            q: positions [rad or m].
            q_ref: their targets [rad or m].
            tau: torques applied from this sample on [N m or N].
            s: the sums before.
            late: False where the sample is known to be before the last seconds: their sums stay.
        """
        e = q - q_ref
        terms = self._terms(k, e, q, tau, s.tau)
        values = [fold.one(x, term) for fold, x, term in zip(_FOLDS, s, terms, strict=False)]
        if not late:
            return new(Sums, (*values, *s[len(values) :]))
        for fold, x, term, since in zip(
            _LATE_FOLDS, s[len(values) :], _late_terms(e, q_ref, s.e), _SINCE, strict=True
        ):
            values.append(np.where(k > self.late + since, fold.one(x, term), x))
        return new(Sums, values)

    def add_all(self, first: int, q: Array, q_ref: Array, tau: Array, s: Sums) -> Sums:
        """Return the sums with samples from number `first` on, the same as those of one after the other.

        Args:
            first: number of the first sample.
            q: positions [rad or m], shape (samples, ...).
            q_ref: their targets [rad or m], likewise.
            tau: torques applied from each sample on [N m or N], likewise.
            s: the sums before, arrays (...).
        """
        e = q - q_ref
        e_before, tau_before = (np.concatenate([x[None], y[:-1]]) for x, y in ((s.e, e), (s.tau, tau)))
        k = np.arange(first, first + len(e), dtype=np.float64).reshape(-1, *[1] * (e.ndim - 1))
        terms = self._terms(k, e, q, tau, tau_before)
        values = [fold.all(x, term) for fold, x, term in zip(_FOLDS, s, terms, strict=False)]
        for fold, x, term, since in zip(
            _LATE_FOLDS, s[len(values) :], _late_terms(e, q_ref, e_before), _SINCE, strict=True
        ):
            values.append(fold.all(x, term[k.ravel() > self.late + since]))
        return new(Sums, values)

    def _terms(self, k: Any, e: Array, q: Array, tau: Array, tau_before: Array) -> Any:
        """Return what a sample, or each of many, adds to all sums but those of the last seconds."""
        size = np.abs(e)
        weight, more = np.where(k > 0.0, 1.0, 0.5), k > 0.0
        return (
            k * size,
            weight * size,
            weight * (e * e),
            size,
            e,
            tau_before * tau_before,
            np.where(more, np.abs(tau - tau_before), 0.0),
            np.abs(tau),
            np.where(more & (np.abs(tau_before) >= self._limit), 1.0, 0.0),
            tau,
            q,
            q,
        )


class Totals(NamedTuple):
    """What a metric is worked out from at the end of a run without trajectories.

    Attributes:
        sums: what was added up.
        dt: sample time [s].
        last: number of the last sample.
        late: number of the first sample of the last seconds.
        lower: lower position limits [rad or m].
        upper: upper position limits [rad or m].
        effort: torque limits [N m or N].
    """

    sums: Sums
    dt: float
    last: int
    late: float
    lower: Array
    upper: Array
    effort: Array

    def integral(self, sum_: Array, last: Array) -> Array:
        """Return an integral by the trapezoidal rule, of a sum whose last value counts half."""
        return self.dt * (sum_ - 0.5 * last)

    @property
    def swing(self) -> Array:
        """Range of the error in the last seconds [rad or m]; 0 where the reference moves then."""
        s = self.sums
        with np.errstate(invalid="ignore"):
            rests = ~(s.target_high - s.target_low > ROUNDING)
            return np.where(rests & (s.high >= s.low), s.high - s.low, 0.0)
