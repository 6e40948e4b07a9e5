"""Random numbers as a function of (seed, sample, rollout, joint): no hidden state.

The same numbers come out whether rollouts run in one batch or one by one, after a pause or from the
start, and any language with 64-bit integers can make them. The mixing function is the finaliser of
SplitMix64 (Steele, Lea, Flood 2014), applied twice.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array

Bits = npt.NDArray[np.uint64]

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)


def uniform(seed: Any, k: Any, shape: tuple[int, ...], stream: int = 0) -> Array:
    """Return numbers uniform in (0, 1) for sample `k`.

    Args:
        seed: seed of row 0, as row i of a batch uses seed + i; or the seeds of all rows, shape (batch, 1).
        k: sample number.
        shape: (n,) or (batch, n).
        stream: which of several independent sets of numbers.

    Returns:
        Numbers [-] of that shape, the same on every machine.
    """
    if not isinstance(k, int | np.integer):  # a symbol, of which the generated code draws the numbers
        symbols: Array = k.uniform(seed, shape, stream)
        return symbols
    row_seeds: Any = seed
    if not isinstance(seed, np.ndarray):
        is_batch = len(shape) == 2
        row_seeds = seeds(seed, shape[0])[:, None] if is_batch else np.uint64(seed % 2**64)
    columns = np.arange(shape[-1], dtype=np.uint64)
    with np.errstate(over="ignore"):
        key = _mix(np.asarray(row_seeds + _GOLDEN, dtype=np.uint64))
        # 4,096 joints in each of 16 streams of a sample.
        first = np.uint64(k) * np.uint64(0x10000) + np.uint64(stream) * np.uint64(0x1000)
        counter = first + columns
        bits = _mix(_mix(key ^ (counter * _GOLDEN)) + key)
    # The top 53 bits, moved half a step up, so that 0 and 1 are never reached.
    values: Array = ((bits >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    return np.broadcast_to(values, np.broadcast_shapes(values.shape, shape))


def seeds(seed: Any, rows: int) -> Bits:
    """Return the seeds of all rows, modulo 2^64: those given, or counted from that of row 0."""
    if isinstance(seed, np.ndarray):
        return np.broadcast_to(seed.ravel(), (rows,))
    with np.errstate(over="ignore"):
        return np.uint64(seed % 2**64) + np.arange(rows, dtype=np.uint64)


def normal(seed: Any, k: Any, shape: tuple[int, ...], stream: int = 0) -> Array:
    """Return standard normal numbers for sample `k` (Box and Muller 1958); arguments as :func:`uniform`.

    Stream s takes the streams 2 s and 2 s + 1 of :func:`uniform`: who draws from both has to choose others.
    """
    share = uniform(seed, k, shape, 2 * stream)
    turn = uniform(seed, k, shape, 2 * stream + 1)
    radius = np.sqrt(-2.0 * np.log(share))
    result: Array = radius * np.cos(2.0 * np.pi * turn)
    return result


def _mix(x: Bits) -> Bits:
    """Return the bits of `x` well mixed."""
    x = (x ^ (x >> np.uint64(30))) * _MIX1
    x = (x ^ (x >> np.uint64(27))) * _MIX2
    mixed: Bits = x ^ (x >> np.uint64(31))
    return mixed
