"""The Bezier move: the regularised incomplete beta function, flat to the fourth derivative at its ends."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize, special

from armgpi import Bezier
from armgpi.errors import ArmgpiError, ArrayError, ParameterError
from armgpi.references.bezier import blend, minimum_duration

Array = npt.NDArray[np.float64]

# Eq. 27 as it holds: x^5 (252 - 1050 x + ...), as coefficients of x^0 ... x^10.
CORRECTED = np.polynomial.Polynomial([0, 0, 0, 0, 0, 252, -1050, 1800, -1575, 700, -126])
# Eq. 27 as printed: a plain sum of powers, all signs plus.
PRINTED = np.polynomial.Polynomial([252, 1050, 1800, 1575, 700, 126])

shares = np.linspace(0.0, 1.0, 1001)
lengths = st.floats(1e-3, 1e3)
configurations = st.integers(-500, 500).map(lambda hundredths: hundredths / 100.0)


def test_the_blend_is_the_regularised_incomplete_beta_function() -> None:
    # The alternating sum cancels from 1800 down to 1: some 1800 eps.
    np.testing.assert_allclose(blend(shares).value, special.betainc(5, 6, shares), rtol=0.0, atol=1e-12)


def test_its_derivatives_are_those_of_the_polynomial() -> None:
    np.testing.assert_allclose(blend(shares).first, CORRECTED.deriv(1)(shares), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(blend(shares).second, CORRECTED.deriv(2)(shares), rtol=0.0, atol=1e-10)


def test_four_derivatives_are_zero_at_both_ends() -> None:
    for x, value in ((0.0, 0.0), (1.0, 1.0)):
        assert CORRECTED(x) == value
        assert [CORRECTED.deriv(order)(x) for order in (1, 2, 3, 4)] == [0.0] * 4
        assert [float(part) for part in blend(np.array(x))] == [value, 0.0, 0.0]


def test_the_code_is_as_flat_at_its_ends_as_the_polynomial() -> None:
    # The velocity leaves zero like 1260 x^4 (four derivatives of the blend are zero) and comes back to
    # it like 1260 (1 - x)^5 (five are); what is left of the factors bends the lines by 1 %.
    x = np.logspace(-4, -2, 20)
    for near_end, power in ((blend(x), 4.0), (blend(1.0 - x), 5.0)):
        assert np.polyfit(np.log(x), np.log(near_end.first), 1)[0] == pytest.approx(power, abs=0.02)


def test_the_printed_equation_27_is_no_blend() -> None:
    assert PRINTED(0.0) == 252.0  # not 0
    assert PRINTED(1.0) == 5503.0  # not 1
    assert PRINTED.deriv()(0.0) == 1050.0  # not at rest
    signs_alone = np.polynomial.Polynomial([0] * 5 + [252, 1050, 1800, 1575, 700, 126])
    assert signs_alone(1.0) == 5503.0  # x^5 in front is not enough


def test_outside_the_move_the_blend_stays_at_its_ends() -> None:
    before, after = blend(np.array([-3.0, -1e-9])), blend(np.array([1.0 + 1e-9, 7.0]))
    np.testing.assert_array_equal(before, np.zeros((3, 2)))
    np.testing.assert_array_equal(after, [[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]])


def test_velocity_peaks_at_four_ninths_of_the_move_with_2_602_d_over_t() -> None:
    D, T = 0.8, 3.0
    move = Bezier([0.0], [D], duration=T)
    peak = optimize.minimize_scalar(lambda t: -move.at(t).v[0], bounds=(0.0, T), options={"xatol": 1e-9})
    # A maximum is found to the root of the rounding error.
    assert peak.x == pytest.approx(4.0 / 9.0 * T, abs=1e-6)
    assert -peak.fun == pytest.approx(2.602 * D / T, rel=2e-4)


def test_acceleration_peaks_with_11_06_d_over_t_squared() -> None:
    D, T = 0.8, 3.0
    a = Bezier([0.0], [D], duration=T).at(np.linspace(0.0, T, 100_001)).a
    assert np.abs(a).max() == pytest.approx(11.06 * D / T**2, rel=5e-4)


@given(configurations, configurations, st.floats(0.1, 10.0), st.floats(-2.0, 2.0))
def test_velocity_and_acceleration_are_the_derivatives_of_position(
    start: float, goal: float, duration: float, t_start: float
) -> None:
    move = Bezier([start], [goal], duration, t_start)
    t = t_start + duration * np.linspace(-0.2, 1.2, 141)
    h = 1e-3 * duration  # fourth-order differences: error h^4 times a fifth derivative below 3e4 D / T^5
    near, far = ([move.at(t + step * h) for step in (-k, k)] for k in (1, 2))
    for value, derivative, unit in (("q", "v", duration), ("v", "a", duration**2)):
        (a, b), (c, d) = ([getattr(target, value) for target in pair] for pair in (near, far))
        slope = (8.0 * (b - a) - (d - c)) / (12.0 * h)
        size = abs(goal - start) / unit
        rounding = 1e-15 * (abs(start) + abs(goal)) / (h * unit / duration)
        np.testing.assert_allclose(getattr(move.at(t), derivative), slope, atol=1e-6 * size + 10 * rounding)


def test_the_move_stands_then_moves_then_stands() -> None:
    start, goal = np.array([0.1, -0.2]), np.array([1.3, 0.4])
    move = Bezier(start, goal, duration=2.0, t_start=1.0)
    for t in (-5.0, 0.0, 1.0):
        np.testing.assert_array_equal(move.at(t), [start, np.zeros(2), np.zeros(2)])
    for t in (3.0, 3.5, 1e6):
        np.testing.assert_allclose(move.at(t), [goal, np.zeros(2), np.zeros(2)], rtol=1e-15)
    # The blend is not symmetric: half the way is done a little before half the time.
    halfway = 1.0 + 2.0 * special.betaincinv(5, 6, 0.5)
    np.testing.assert_allclose(move.at(halfway).q, 0.5 * (start + goal), rtol=1e-12)


@given(
    st.lists(st.tuples(configurations, lengths, lengths), min_size=1, max_size=5).filter(
        lambda rows: any(row[0] for row in rows)
    )
)
def test_the_shortest_duration_keeps_every_limit_and_meets_one(
    rows: list[tuple[float, float, float]],
) -> None:
    distance, velocity, acceleration = np.array(rows).T
    T = minimum_duration(distance, velocity, acceleration)
    # The peaks of the unit move, looked up on the polynomial.
    speed = np.abs(CORRECTED.deriv(1)(PEAKS[0])) * np.abs(distance) / T
    rate = np.abs(CORRECTED.deriv(2)(PEAKS[1])) * np.abs(distance) / T**2
    used = np.maximum(speed / velocity, rate / acceleration)
    assert used.max() == pytest.approx(1.0, rel=1e-9)


#: Where the second and the third derivative of the blend are zero for the first time after its start.
PEAKS = [
    min(
        float(x.real)
        for x in CORRECTED.deriv(order).roots()
        if abs(x.imag) < 1e-6 and 0.05 < float(x.real) < 0.95
    )
    for order in (2, 3)
]


def test_a_move_without_a_duration_takes_the_shortest() -> None:
    limits = {"velocity_limit": [1.0, 2.0], "acceleration_limit": 5.0}
    move = Bezier([0.0, 0.0], [1.0, -0.5], **limits)
    assert move.duration == minimum_duration([1.0, -0.5], **limits)
    target = move.at(np.linspace(0.0, move.duration, 100_001))
    assert (np.abs(target.v) <= np.array([1.0, 2.0]) * (1.0 + 1e-9)).all()
    assert np.abs(target.a).max() <= 5.0 * (1.0 + 1e-9)


def test_a_move_to_where_it_is_needs_no_duration() -> None:
    np.testing.assert_array_equal(Bezier([1.0], [1.0]).at(0.3), [[1.0], [0.0], [0.0]])


@pytest.mark.parametrize(
    ("start", "goal", "shape"),
    [
        (np.zeros(3), np.ones(3), (3,)),
        (np.zeros((2, 3)), np.ones((2, 3)), (2, 3)),
        (np.zeros(3), np.ones((2, 3)), (2, 3)),
        (np.zeros((2, 3)), np.ones(3), (2, 3)),
    ],
)
def test_times_come_before_rollouts_and_joints(start: Array, goal: Array, shape: tuple[int, ...]) -> None:
    move = Bezier(start, goal, duration=1.0)
    times = np.linspace(-0.5, 1.5, 7)
    assert {part.shape for part in move.at(0.3)} == {shape}
    together = move.at(times)
    for part in range(3):
        alone = [move.at(float(t))[part] for t in times]
        np.testing.assert_array_equal(together[part], alone)


def test_later_changes_of_the_arrays_given_do_not_move_it() -> None:
    start = np.zeros(2)
    move = Bezier(start, [1.0, 1.0], duration=1.0)
    start += 5.0
    np.testing.assert_array_equal(move.at(0.0).q, [0.0, 0.0])


@pytest.mark.parametrize(
    ("arguments", "error", "named"),
    [
        ({"duration": 0.0}, ParameterError, "duration"),
        ({"duration": -1.0}, ParameterError, "duration"),
        ({"duration": math.nan}, ParameterError, "duration"),
        ({"duration": math.inf}, ParameterError, "duration"),
        ({"duration": "3"}, ParameterError, "duration"),
        ({}, ParameterError, "duration"),
        ({"duration": 1.0, "t_start": math.inf}, ParameterError, "t_start"),
        ({"velocity_limit": 0.0}, ParameterError, "velocity_limit"),
        ({"acceleration_limit": [1.0, -1.0]}, ParameterError, "acceleration_limit"),
        ({"velocity_limit": math.nan}, ParameterError, "velocity_limit"),
        ({"velocity_limit": [1.0, 1.0, 1.0]}, ArmgpiError, "velocity_limit"),
        ({"duration": 1.0, "goal": [1.0]}, ArrayError, "goal"),
        ({"duration": 1.0, "goal": [1.0, math.nan]}, ArrayError, "goal"),
        ({"duration": 1.0, "start": [[0.0, 0.0]] * 2, "goal": [[1.0, 1.0]] * 3}, ArrayError, "goal"),
        ({"duration": 1.0, "start": 0.0}, ArrayError, "start"),
        ({"duration": 1.0, "start": np.zeros(2, np.float32)}, ArrayError, "start"),
        ({"duration": 1.0, "start": np.zeros(2, ">f8")}, ArrayError, "start"),
    ],
)
def test_a_bad_argument_is_named(arguments: dict[str, Any], error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        Bezier(**{"start": [0.0, 0.0], "goal": [1.0, 1.0], **arguments})


def test_single_times_have_the_bits_of_arrays_of_times() -> None:
    random = np.random.default_rng(340)
    for n in (1, 3, 7):
        start, goal = random.normal(size=(2, n))
        move = Bezier(start, goal, duration=1.7, t_start=-0.2)
        times = np.concatenate([random.uniform(-1.0, 3.0, 40), [-0.2, 1.5, 1.6]])
        together = move.at(times)
        for i, t in enumerate(times.tolist()):
            for one, all_of_them in zip(move.at(t), together, strict=True):
                np.testing.assert_array_equal(one, all_of_them[i])


def test_a_time_of_minus_zero_is_one_of_zero_to_the_last_bit() -> None:
    # A velocity and an acceleration of -0.0 came of it, and 0.0 of an array of times.
    for move in (Bezier([0.0, 0.0], [1.0, -1.0], duration=1.0), Bezier([0.0], [1.0], 1.0, t_start=-0.0)):
        for below, zero in zip(move.at(-0.0), move.at(0.0), strict=True):
            np.testing.assert_array_equal(np.signbit(below), np.signbit(zero))
