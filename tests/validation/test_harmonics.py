"""Sums of powers and harmonics of joint positions, and which one term of such a sum is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from armgpi.validation import harmonics

Q = np.random.default_rng(4).uniform(-3.0, 3.0, (60, 2))
ONE, BOTH = np.cos(Q[:, 0]), np.cos(Q.sum(axis=1))
RIGHT = 2.0 * ONE - 0.5 * BOTH + 3.0


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (RIGHT - 4.0 * ONE, "the coefficient of cos(q1) is -2, the robot's is 2: its sign"),
        (RIGHT - 1.0 * ONE, "the coefficient of cos(q1) is 1, the robot's is 2: a factor 2 is missing"),
        (RIGHT + 2.0 * ONE, "the coefficient of cos(q1) is 4, the robot's is 2: a factor 1/2 is missing"),
        (RIGHT + 0.25, "the constant is 3.25, the robot's is 3"),
        (RIGHT - 2.0 * ONE, "the term 2 cos(q1) is missing"),
        (RIGHT + 0.7 * np.sin(Q[:, 1]), "the term 0.7 sin(q2) is too much"),
        (2.0 * np.cos(Q[:, 1]) - 0.5 * BOTH + 3.0, "cos(q2) should be cos(q1)"),
        (2.0 * ONE - 0.5 * BOTH + 3.0 * np.sin(Q[:, 0]), "sin(q1) should be a constant"),
        (3.0 * ONE - 0.7 * BOTH + 4.0, None),
    ],
)
def test_one_wrong_term_of_a_sum_is_named(model: np.ndarray, said: str | None) -> None:
    assert harmonics.slip(Q, model, RIGHT, (False, False), 1e-9) == said
