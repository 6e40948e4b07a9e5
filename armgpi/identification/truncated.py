"""Normal numbers whose combinations stay within bounds; each draw depends on its own seed alone."""

from __future__ import annotations

import numpy as np
from scipy import special

from armgpi.base.arrays import Array

#: Least part of a combination that is free, given those before it, over all of it: less is rounding.
_FREE = 1e-9
#: Rounds of the Gibbs sampler after its start, which has the right distribution already where the bounded
#: combinations are independent.
_ROUNDS = 30


def draw_truncated(root: Array, low: Array, high: Array, normal: Array) -> Array:
    """Return draws w of the standard normal distribution, given ``low <= root w <= high``, (count, b).

    A Gibbs sampler (Geweke 1991): each number is drawn from its normal distribution within the interval that
    the others leave it. It starts at the draw of the GHK simulator (Geweke, Hajivassiliou, Keane), which
    takes one number after the other within what the earlier ones leave. Each draw depends on its own numbers
    alone, so that a row of a sweep is the same arm whatever it is run with.

    Args:
        root: a lower triangle with a diagonal that is not negative, (b, b).
        low: bounds from below, (b,); may be infinite.
        high: bounds from above, (b,), above `low`.
        normal: standard normal numbers, (count, b): where the sampler starts, and what it is seeded by.
    """
    count, size = normal.shape
    least = _FREE * np.linalg.norm(root, axis=1)
    root = root + np.diag(np.maximum(least - np.diag(root), 0.0))
    drawn = np.zeros((count, size))
    for k in range(size):
        before = combine(drawn[:, :k], root[k : k + 1, :k])[:, 0]
        start, end = (low[k] - before) / root[k, k], (high[k] - before) / root[k, k]
        drawn[:, k] = within(special.ndtr(normal[:, k]), start, end)
    if size == 1:
        return drawn
    chances = np.array([_chances(each) for each in normal])
    combined = combine(drawn, root)
    for turn in range(_ROUNDS):
        for k in range(size):
            start, end = _free(root[k:, k], combined[:, k:], drawn[:, k], low[k:], high[k:])
            moved = within(chances[:, turn, k], start, end)
            combined[:, k:] += (moved - drawn[:, k])[:, None] * root[k:, k]
            drawn[:, k] = moved
    return drawn


def combine(drawn: Array, root: Array) -> Array:
    """Return the combinations ``root w`` of draws, (count, b), each row with the bits that it has alone.

    A product of two matrices sums in another order for another count.

    Args:
        drawn: draws w, (count, a).
        root: the matrix, (b, a).
    """
    return np.asarray((drawn[:, None, :] @ root.T)[:, 0])


def within(chance: Array, low: Array, high: Array) -> Array:
    """Return the quantiles of standard normal numbers that are within intervals, elementwise.

    In logarithms, and on the side of zero on which the interval is, so that it holds in the tails as well.

    Args:
        chance: of the quantiles, from 0 to 1.
        low: lower ends; may be infinite.
        high: upper ends, not below `low`.
    """
    mirrored = low > 0.0
    start, end = np.where(mirrored, -high, low), np.where(mirrored, -low, high)
    share = np.where(mirrored, 1.0 - chance, chance)
    most = special.log_ndtr(end)
    with np.errstate(divide="ignore"):
        logarithm = most + np.log(share + (1.0 - share) * np.exp(special.log_ndtr(start) - most))
    quantile = np.clip(special.ndtri_exp(np.minimum(logarithm, 0.0)), start, end)
    return np.asarray(np.where(mirrored, -quantile, quantile))


def _chances(normal: Array) -> Array:
    """Return the chances of a draw in all rounds, seeded by its own numbers, (rounds, b)."""
    seed = np.frombuffer(np.ascontiguousarray(normal).tobytes(), dtype=np.uint32)
    return np.random.default_rng(seed).random((_ROUNDS, len(normal)))


def _free(column: Array, combined: Array, drawn: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the ends of the interval that the bounds of all combinations leave one number, each (count,).

    Args:
        column: how the combinations grow with the number, (m,); the first is positive.
        combined: the combinations as they are, (count, m).
        drawn: the number as it is, (count,).
        low: bounds of the combinations, (m,).
        high: likewise.
    """
    used = column != 0.0
    slope = column[used]
    rest = combined[:, used] - drawn[:, None] * slope
    ends = (low[used] - rest) / slope, (high[used] - rest) / slope
    start = np.minimum(*ends).max(axis=1)
    end = np.maximum(*ends).min(axis=1)
    # Rounding may put a number that is at a bound on the other side of it.
    return np.minimum(start, drawn), np.maximum(end, drawn)
