"""Least squares with a prior, intervals, the nearest physical arm: against closed forms and slow twins."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import armgpi
from armgpi.identification import estimate
from armgpi.identification.estimate import Block, Prior, fit
from armgpi.identification.weak_form import COLUMNS, COULOMB, OFFSET, ROTOR, VISCOUS

Numbers = npt.NDArray[np.float64]

#: With friction everywhere, so that one bound alone is near.
ARM = armgpi.Robot.load("ur5").with_friction(5.0, 5.0)


def graded_root(size: int, spread: float) -> np.ndarray:
    """Return the root of a covariance whose directions differ by a factor, mixed between all unknowns."""
    rng = np.random.default_rng(4)
    directions, _ = np.linalg.qr(rng.normal(size=(size, size)))
    return np.asarray(directions * np.geomspace(1.0 / spread, 1e-3, size))


@pytest.mark.parametrize("spread", [1e3, 1e5, 1e7])
def test_one_negative_friction_is_none_and_all_else_follows_as_its_covariance_says(spread: float) -> None:
    prior = estimate.expect(ARM)
    root = graded_root(len(prior.mean), spread)
    covariance = root @ root.T
    free = np.zeros(len(prior.mean))
    place = 2 * len(COLUMNS) + COULOMB
    none = -prior.mean[place] / prior.std[place]
    free[place] = none - 3.0 * np.sqrt(covariance[place, place])
    nearest = estimate.project(free, root, prior)
    # A bound that alone is active: the mean of a normal distribution, given that unknown.
    given = free + covariance[:, place] / covariance[place, place] * (none - free[place])
    apart = np.linalg.solve(root, nearest - given)
    assert np.linalg.norm(apart) < 1e-3 * np.linalg.norm(np.linalg.solve(root, given - free))
    assert nearest[place] == none


def test_what_is_physical_stays_where_it_is() -> None:
    prior = estimate.expect(ARM)
    root = graded_root(len(prior.mean), 1e7)
    step = 1e-6 * root @ np.ones(len(prior.mean))
    positive = list(prior.positive)
    step[positive] = np.abs(step[positive])
    nearest = estimate.project(step, root, prior)
    assert np.linalg.norm(np.linalg.solve(root, nearest - step)) < 1e-4


def regression(seed: int, count: int = 300, noise: float = 0.1) -> tuple[list[Block], Prior, Numbers]:
    """Return a log of three joints without bodies, its prior, and the truth in units of the prior."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, 3, 5))
    prior = Prior(rng.normal(size=5), rng.uniform(0.5, 2.0, 5), (), ())
    truth = rng.normal(size=5)
    exact = rows @ (prior.mean + prior.std * truth)
    torque = exact + noise * np.array([1.0, 3.0, 0.3]) * rng.normal(size=(count, 3))
    block = Block(rows, torque, np.ones((count, 3), dtype=bool), np.arange(count))
    return [block], prior, truth


def test_scale_of_a_joint_and_order_and_pieces_of_logs_change_nothing() -> None:
    (block,), prior, _ = regression(1)
    whole = fit([block], prior, physical=False).free
    scale = np.array([1.0, 1e3, 0.02])
    other = block._replace(rows=block.rows * scale[None, :, None], torque=block.torque * scale)
    assert fit([other], prior, physical=False).free == pytest.approx(whole, abs=1e-6)
    pieces = [Block(*(part[cut] for part in block)) for cut in (slice(120, 300), slice(0, 120))]
    assert fit(pieces, prior, physical=False).free == pytest.approx(whole, abs=1e-9)


def test_a_joint_with_less_noise_decides_as_in_weighted_least_squares() -> None:
    """With so much data the prior hardly counts: the twin is NumPy's, with the true weights."""
    (block,), prior, _ = regression(2, count=4000)
    weights = 1.0 / np.array([1.0, 3.0, 0.3])
    rows = (block.rows * weights[None, :, None]).reshape(-1, 5)
    twin, *_ = np.linalg.lstsq(rows, (block.torque * weights).ravel(), rcond=None)
    found = prior.mean + prior.std * fit([block], prior, physical=False).free
    assert found == pytest.approx(twin, abs=3e-4)


def test_intervals_have_the_truth_as_often_as_they_say() -> None:
    """They are widened for misfit that is not in the residuals, so more than 95 % of pure noise is inside."""
    inside = []
    for seed in range(60):
        blocks, prior, truth = regression(100 + seed)
        found = fit(blocks, prior, physical=False)
        inside += (np.abs(found.free - truth) < 1.96 * np.sqrt(np.diag(found.covariance))).tolist()
    assert 0.95 <= np.mean(inside) <= 1.0


def test_what_the_data_decide_is_one_and_what_they_do_not_is_zero() -> None:
    (block,), prior, _ = regression(3, count=4000)
    rows = block.rows.copy()
    rows[..., 4] = 0.0
    found = fit([block._replace(rows=rows)], prior, physical=False)
    assert found.learned[:4].min() > 0.99
    assert found.learned[4] == pytest.approx(0.0, abs=1e-12)
    assert found.free[4] == pytest.approx(0.0, abs=1e-12)
    assert found.covariance[4, 4] == pytest.approx(1.0)


def test_the_covariance_of_a_sum_is_the_double_sum_with_weights_that_fade() -> None:
    """The slow twin of Newey and West (1987): every pair of scores, the less the farther they are apart."""
    scores = np.random.default_rng(4).normal(size=(40, 3))
    reach = 6
    slow = np.zeros((3, 3))
    for one in range(40):
        for other in range(40):
            weight = max(0.0, 1.0 - abs(one - other) / (reach + 1.0))
            slow += weight * np.outer(scores[one], scores[other])
    assert estimate._score_covariance(scores, np.arange(40)) == pytest.approx(slow)


def test_scores_of_equal_phase_are_summed_first() -> None:
    """What repeats with the excitation is misfit: its sum over n periods grows n times, not by its root."""
    once = np.random.default_rng(5).normal(size=(20, 2))
    periods = 5
    found = estimate._score_covariance(np.tile(once, (periods, 1)), np.tile(np.arange(20), periods))
    assert found == pytest.approx(periods**2 * estimate._score_covariance(once, np.arange(20)))


def test_the_nearest_physical_point_has_every_other_one_behind_it() -> None:
    """Variational inequality of a projection: (y - x)' M (x - free) >= 0 for every physical y."""
    rng = np.random.default_rng(6)
    size = len(COLUMNS)
    ball = np.zeros(size)
    ball[[0, 4, 6, 9]] = 2.0, 0.02, 0.02, 0.02
    ball[[ROTOR, COULOMB, VISCOUS]] = 0.1
    std = np.full(size, 0.5)
    std[4:10] = 0.01
    prior = Prior(ball, std, (0,), (ROTOR, COULOMB, VISCOUS))
    root = np.tril(0.3 * rng.normal(size=(size, size))) + np.eye(size)
    metric = np.linalg.inv(root @ root.T)
    free = 4.0 * rng.normal(size=size)
    nearest = estimate.project(free, root, prior)
    others = [estimate.project(4.0 * rng.normal(size=size), root, prior) for _ in range(30)]
    size_of_it = float((nearest - free) @ metric @ (nearest - free))
    assert size_of_it > 1.0
    for other in [*others, np.zeros(size)]:
        assert (other - nearest) @ metric @ (nearest - free) > -1e-5 * size_of_it


@pytest.mark.parametrize(("low", "high"), [(0.3, 0.8), (-np.inf, -0.2), (0.1, np.inf)])
def test_bounds_of_a_projection_are_kept_and_what_is_inside_stays(low: float, high: float) -> None:
    size = len(COLUMNS)
    ball = np.zeros(size)
    ball[[0, 4, 6, 9]] = 2.0, 0.02, 0.02, 0.02
    std = np.full(size, 0.1)
    std[4:10] = 1e-3
    ball[ROTOR] = 1.0
    prior = Prior(ball, std, (0,), (ROTOR,))
    lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
    lower[OFFSET], upper[OFFSET] = low, high
    for value in (-1.5, 0.0, 0.5, 1.5):
        free = np.zeros(size)
        free[OFFSET] = value
        nearest = estimate.project(free, np.eye(size), prior, (lower, upper))
        expected = free.copy()
        expected[OFFSET] = np.clip(value, low, high)
        assert nearest == pytest.approx(expected, abs=1e-6)
