"""Random numbers as a function of seed, sample, rollout and joint: reproducible, and random enough."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from armgpi.plants import noise

SAMPLES, JOINTS = 8_000, 3
# Seeds are fixed, so nothing here is up to chance; p-values of good numbers are rarely below this.
UNLIKELY = 1e-3

seeds = st.integers(0, 2**63)
samples = st.integers(0, 2**40)


def obvious_uniform(seed: int, k: int, column: int, stream: int) -> float:
    """Return one number with plain integers: SplitMix64's finaliser on seed and counter."""
    mask, golden = 2**64 - 1, 0x9E3779B97F4A7C15

    def mix(x: int) -> int:
        x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & mask
        x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & mask
        return x ^ (x >> 31)

    key = mix((seed + golden) & mask)
    counter = (k * 2**16 + stream * 2**12 + column) & mask
    bits = mix((mix(key ^ ((counter * golden) & mask)) + key) & mask)
    return ((bits >> 11) + 0.5) * 2.0**-53


@cache
def columns(draw: str, seed: int, stream: int = 0) -> npt.NDArray[np.float64]:
    """Return SAMPLES x JOINTS numbers."""
    function = getattr(noise, draw)
    return np.array([function(seed, k, (JOINTS,), stream) for k in range(SAMPLES)])


@given(seeds, samples, st.integers(0, 5))
def test_plain_integers_make_the_same_numbers(seed: int, k: int, stream: int) -> None:
    expected = [obvious_uniform(seed, k, column, stream) for column in range(JOINTS)]
    np.testing.assert_array_equal(noise.uniform(seed, k, (JOINTS,), stream), expected)


@given(seeds, samples, st.integers(1, 5))
@pytest.mark.parametrize("draw", ["uniform", "normal"])
def test_row_i_of_a_batch_is_seed_plus_i(draw: str, seed: int, k: int, rows: int) -> None:
    function = getattr(noise, draw)
    together = function(seed, k, (rows, JOINTS), 1)
    for row in range(rows):
        np.testing.assert_array_equal(together[row], function(seed + row, k, (JOINTS,), 1))


def test_uniform_numbers_are_uniform() -> None:
    numbers = columns("uniform", 7).ravel()
    assert 0.0 < numbers.min() < numbers.max() <= 1.0
    assert stats.kstest(numbers, "uniform").pvalue > UNLIKELY


def test_normal_numbers_are_standard_normal() -> None:
    numbers = columns("normal", 7).ravel()
    assert np.isfinite(numbers).all()
    assert stats.kstest(numbers, "norm").pvalue > UNLIKELY
    # Mean and deviation within four standard errors.
    assert abs(numbers.mean()) < 4.0 / np.sqrt(numbers.size)
    assert abs(numbers.std() - 1.0) < 4.0 / np.sqrt(2.0 * numbers.size)


@pytest.mark.parametrize("lag", [1, 2, 3, 10])
def test_the_numbers_are_white(lag: int) -> None:
    numbers = columns("normal", 3)
    correlation = np.mean(numbers[lag:] * numbers[:-lag], axis=0)
    assert np.abs(correlation).max() < 4.0 / np.sqrt(SAMPLES)


def test_joints_seeds_and_streams_have_nothing_to_do_with_each_other() -> None:
    sets = [*columns("normal", 3).T, columns("normal", 4)[:, 0], columns("normal", 3, 1)[:, 0]]
    # The same seed one sample on must not be the next seed, nor the next stream.
    sets += [columns("normal", 4)[:, 1], columns("normal", 3, 2)[:, 0]]
    for one, other in itertools.combinations(sets, 2):
        assert abs(np.mean(one * other)) < 4.0 / np.sqrt(SAMPLES)
        assert abs(np.mean(one[1:] * other[:-1])) < 4.0 / np.sqrt(SAMPLES)
        assert abs(np.mean(one**2 * other**2) - 1.0) < 4.0 * np.sqrt(8.0 / SAMPLES)


def test_no_number_of_many_comes_twice() -> None:
    numbers = np.concatenate([columns("uniform", seed, s).ravel() for seed in (0, 1) for s in (0, 1)])
    assert len(np.unique(numbers)) == numbers.size  # 96,000 of 2^53: a repeat has a chance of 5e-7
