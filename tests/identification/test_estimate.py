"""The nearest physical arm: against a closed form, where logs know some unknowns far better than others."""

from __future__ import annotations

import numpy as np
import pytest

import armgpi
from armgpi.identification import estimate
from armgpi.identification.weak_form import COLUMNS, COULOMB

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
