"""Units of what a change puts: what is added has one unit."""

from __future__ import annotations

import pytest

from armgpi.validation.dimensions import adds_unlike

NUMBERS = {"m1", "m2", "l1", "lc1", "I1", "l2", "alpha1"}


@pytest.mark.parametrize(
    ("text", "unlike"),
    [
        ("m1 - m2**2 * self.l2", True),
        ("I1 + m1 * lc1**2", False),
        ("I1 + m1 * lc1", True),
        ("m1 * l1 + p['m2'] * self.l2", False),
        ("2 * m1 - m2 / 3", False),
        ("l1 / lc1 + 1", False),
        ("m1 * (l1 + m2)", True),
        ("0.52 + l1 * m1", False),
        ("0.37 * m1 + I1", False),
        ("alpha1 + m1", False),  # it may be anything
        ("c1 + m1", False),  # no number of the source
        ("m1 * np.cos(q) + l1", True),
        ("np.cos(q) - 0.5 * m2 * lc1", True),
        ("m1 * l1 * np.cos(q) + m1 * lc1", False),
        ("\n    M[0, 0] += m1", False),
    ],
)
def test_kilograms_and_metres_have_no_sum(text: str, unlike: bool) -> None:
    assert adds_unlike(text, NUMBERS) == unlike
