"""What so many rollouts say of a probability or a quantile: intervals that hold with 95 %."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import beta, binom
from scipy.stats import norm as normal

from armgpi.base.arrays import Array

#: Share of all sweeps in which an interval holds the true value.
LEVEL = 0.95


class Estimate(NamedTuple):
    """An estimate with its interval.

    Attributes:
        value: the estimate.
        lower: lower end of the interval.
        upper: upper end of the interval.
    """

    value: float
    lower: float
    upper: float


def clopper_pearson(k: int, n: int, level: float = LEVEL) -> Estimate:
    """Return the probability of what happened k times in n, with an interval that never holds less often.

    By the quantiles of the beta distribution (Clopper and Pearson 1934), which has none for k = 0 and k = n:
    there the interval ends at 0 and at 1.
    """
    if n == 0:
        return Estimate(float("nan"), 0.0, 1.0)
    tail = 0.5 * (1.0 - level)
    lower = 0.0 if k == 0 else float(beta.ppf(tail, k, n - k + 1))
    upper = 1.0 if k == n else float(beta.ppf(1.0 - tail, k + 1, n - k))
    return Estimate(k / n, lower, upper)


def wilson(k: int, n: int, level: float = LEVEL) -> Estimate:
    """Return the same with a shorter interval, which holds so often on average (Wilson 1927)."""
    if n == 0:
        return Estimate(float("nan"), 0.0, 1.0)
    z = float(normal.ppf(0.5 + 0.5 * level))
    share, scale = k / n, 1.0 + z * z / n
    centre = (share + 0.5 * z * z / n) / scale
    half = z / scale * float(np.sqrt(share * (1.0 - share) / n + 0.25 * z * z / n**2))
    # Which is 0 for k = 0 and 1 for k = n but for rounding.
    return Estimate(share, centre - half if k else 0.0, centre + half if k < n else 1.0)


def quantile(values: Array, share: float, level: float = LEVEL) -> Estimate:
    """Return a quantile with an interval between two of the values, whatever they are distributed like.

    The number of values below the true quantile is binomial. Infinite values are the largest ones. Where
    there are too few values for an end, it is open: no value is known to be beyond the quantile.
    """
    ordered = np.sort(values)
    n, tail = len(ordered), 0.5 * (1.0 - level)
    low = int(binom.ppf(tail, n, share)) - 1
    high = int(binom.ppf(1.0 - tail, n, share))
    middle = ordered[int(np.ceil(share * n)) - 1]
    lower = ordered[low] if low >= 0 else -np.inf
    upper = ordered[high] if high < n else np.inf
    return Estimate(float(middle), float(lower), float(upper))
