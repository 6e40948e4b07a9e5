"""B-spline functions keep the laws of B-splines, and are SciPy's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from armgpi.errors import ArmgpiError, ArrayError, ParameterError
from armgpi.gpi.splines import BSplineBasis

#: Rounding of the recursion: a handful of products of numbers below one.
ROUNDING = 1e-14


@st.composite
def bases(draw: st.DrawFn) -> BSplineBasis:
    """Return a basis of order 1 to 5 with simple or repeated ends and uneven inner knots."""
    order = draw(st.integers(1, 5))
    steps = draw(st.lists(st.floats(0.1, 2.0), min_size=1, max_size=5))
    inner = np.concatenate([[0.0], np.cumsum(steps)])
    if draw(st.booleans()):
        outer = np.arange(1, order)
        return BSplineBasis(np.concatenate([inner[0] - outer[::-1], inner, inner[-1] + outer]), order)
    return BSplineBasis(np.concatenate([[0.0] * (order - 1), inner, [inner[-1]] * (order - 1)]), order)


def inputs(basis: BSplineBasis) -> np.ndarray:
    return np.linspace(basis.lower, basis.upper, 201)


@given(bases())
def test_the_functions_are_those_of_scipy(basis: BSplineBasis) -> None:
    x = inputs(basis)[:-1]  # SciPy leaves the last point to the next interval where knots are simple
    for i, values in enumerate(basis(x)):
        expected = BSpline(basis.knots, np.eye(basis.size)[i], basis.order - 1)(x)
        np.testing.assert_allclose(values, expected, atol=ROUNDING)


@given(bases())
def test_the_functions_are_a_partition_of_unity_on_the_domain(basis: BSplineBasis) -> None:
    values = np.array(basis(inputs(basis)))
    assert values.shape == (basis.size, 201)
    assert (values >= 0.0).all()
    np.testing.assert_allclose(values.sum(axis=0), 1.0, atol=ROUNDING)


@given(bases())
def test_each_function_is_zero_outside_its_knots(basis: BSplineBasis) -> None:
    x = inputs(basis)
    for i, values in enumerate(basis(x)):
        outside = (x < basis.knots[i]) | (x > basis.knots[i + basis.order])
        assert not values[outside].any()
    at_once = (np.array(basis(x)) > 0.0).sum(axis=0)
    assert at_once.max() <= basis.order


def test_third_order_functions_have_a_continuous_slope_at_simple_knots() -> None:
    basis = BSplineBasis.uniform(0.0, 3.0, intervals=3)
    for knot in (1.0, 2.0):
        h = 1e-6
        for values in basis(np.array([knot - 2 * h, knot - h, knot + h, knot + 2 * h])):
            left, right = (values[1] - values[0]) / h, (values[3] - values[2]) / h
            assert abs(right - left) < 1e-5  # slopes change by the second derivative (about 2) times 3 h


def test_inputs_beyond_the_domain_count_as_its_ends() -> None:
    basis = BSplineBasis.uniform(-1.0, 1.0, intervals=2)
    beyond, ends = basis(np.array([-9.0, 9.0])), basis(np.array([-1.0, 1.0]))
    np.testing.assert_array_equal(beyond, ends)


@pytest.mark.parametrize(
    ("arguments", "error", "named"),
    [
        (([0, 0, 0, 1, 0.5, 1, 1],), ArrayError, "increasing"),
        (([0, 1, 2],), ArrayError, "at least 6"),
        (([0, 0, 0, 0, 1, 1, 1],), ArrayError, "more than 3 times"),
        (([0, 0, 0, np.nan, 1, 1, 1],), ArrayError, "finite"),
        (([0, 0, 0, 1, 1, 1], 0), ParameterError, "order"),
        (([0, 0, 0, 1, 1, 1], 2.5), ParameterError, "order"),
    ],
)
def test_bad_knots_are_named(arguments: Any, error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        BSplineBasis(*arguments)


@given(st.integers(1, 5), st.lists(st.floats(0.1, 1.0), min_size=1, max_size=3), st.booleans())
def test_folded_functions_are_the_sums_of_functions_and_their_mirror_images(
    order: int, steps: list[float], middle: bool
) -> None:
    right = np.cumsum(steps)
    inner = np.concatenate([-right[::-1], [0.0] if middle else [], right])
    basis = BSplineBasis(np.concatenate([[inner[0]] * (order - 1), inner, [inner[-1]] * (order - 1)]), order)
    x = np.linspace(-1.2 * inner[-1], 1.2 * inner[-1], 101)
    x = x[np.abs(x)[:, None].min(axis=1) > 1e-9]  # at 0 a function of order 1 is on one side only
    values, folded = np.array(basis(x)), np.array(basis.even(x))
    half = basis.size // 2
    expected = [values[i] + values[-1 - i] for i in range(half)] + list(values[half : basis.size - half])
    assert len(folded) == (basis.size + 1) // 2
    np.testing.assert_allclose(folded.sum(axis=0), 1.0, atol=ROUNDING)
    if order > 1:  # steps are not even where they jump
        np.testing.assert_allclose(folded, expected, atol=ROUNDING)
