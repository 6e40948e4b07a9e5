"""Truncated normal numbers against rejection, closed forms and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from armgpi.identification.truncated import draw_truncated, within

COUNT = 4000


@pytest.mark.parametrize(
    ("low", "high"), [(-1.0, 2.0), (-np.inf, 0.5), (1.0, np.inf), (3.0, 3.5), (-9.0, -7.0), (-np.inf, np.inf)]
)
def test_one_number_has_the_quantiles_of_scipy(low: float, high: float) -> None:
    chance = np.linspace(0.001, 0.999, 41)
    found = within(chance, np.full(41, low), np.full(41, high))
    assert found == pytest.approx(stats.truncnorm.ppf(chance, low, high), rel=1e-6, abs=1e-8)


def test_far_in_the_tail_it_is_the_exponential_distribution() -> None:
    """Above a = 40 the excess has the mean 1 / a, but for a share of 1 / a^2."""
    chance = (np.arange(1000) + 0.5) / 1000
    excess = within(chance, np.full(1000, 40.0), np.full(1000, np.inf)) - 40.0
    assert (excess >= 0.0).all()
    assert excess.mean() == pytest.approx(1.0 / 40.0, rel=5e-3)


@pytest.mark.parametrize("bound", [-8.0, 0.0, 8.0])
def test_an_interval_of_no_width_is_its_end(bound: float) -> None:
    ends = np.full(3, bound)
    assert within(np.array([0.0, 0.5, 1.0]), ends, ends) == pytest.approx(ends, abs=1e-9)


@pytest.mark.parametrize("correlation", [0.0, 0.9, -0.95])
def test_draws_are_those_of_rejection_whatever_the_correlation(correlation: float) -> None:
    covariance = np.array([[1.0, correlation, 0.3], [correlation, 1.0, 0.0], [0.3, 0.0, 2.0]])
    covariance[2, 1] = covariance[1, 2] = 0.3 * correlation
    root = np.linalg.cholesky(covariance)
    low, high = np.array([-0.5, 0.2, -np.inf]), np.array([2.0, 1.5, 1.0])
    rng = np.random.default_rng(5)
    drawn = draw_truncated(root, low, high, rng.normal(size=(COUNT, 3))) @ root.T
    assert (drawn >= low - 1e-9).all()
    assert (drawn <= high + 1e-9).all()
    free = rng.multivariate_normal(np.zeros(3), covariance, size=400_000)
    kept = free[((free >= low) & (free <= high)).all(axis=1)]
    assert len(kept) > COUNT
    for place in range(3):
        assert stats.ks_2samp(drawn[:, place], kept[:, place]).pvalue > 1e-3
    for one, other in ((0, 1), (0, 2), (1, 2)):
        products = [x[:, one] * x[:, other] for x in (drawn, kept)]
        assert stats.ks_2samp(*products).pvalue > 1e-3


def test_bounds_that_are_far_away_leave_every_number_as_it_is() -> None:
    """Then the start is the number itself; one number alone is not moved by a sampler."""
    normal = np.random.default_rng(6).normal(size=(20, 1))
    drawn = draw_truncated(np.eye(1), np.array([-30.0]), np.array([30.0]), normal)
    assert drawn == pytest.approx(normal, abs=1e-9)


def test_a_combination_that_others_decide_stays_finite() -> None:
    """The second is the first, to rounding: nothing of its own is left to draw."""
    root = np.array([[1.0, 0.0], [1.0, 0.0]])
    drawn = draw_truncated(
        root, np.array([0.0, 0.1]), np.ones(2), np.random.default_rng(7).normal(size=(50, 2))
    )
    assert np.isfinite(drawn).all()
    combined = drawn @ root.T
    assert (combined[:, 0] >= -1e-6).all()
    assert (combined[:, 0] <= 1.0 + 1e-6).all()
