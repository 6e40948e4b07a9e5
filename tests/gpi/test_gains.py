"""Gains: eq. 25 against the polynomial of eq. 24, and margins against a sweep over frequencies."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgpi import FixedGains, Tuning, default_omega
from armgpi.errors import ArrayError, ParameterError
from armgpi.gpi.family import PRINTED, Member
from armgpi.gpi.gains import betas
from armgpi.gpi.margins import delay_margins

Array = npt.NDArray[np.float64]

JOINTS = ("shoulder", "elbow")
factors = st.floats(0.1, 10.0)


@st.composite
def tunings(draw: st.DrawFn) -> Tuning:
    """Bandwidths of five decades, damping from lively to slow, a real pole anywhere near."""
    omega = 10.0 ** draw(st.floats(-2.0, 3.0))
    return Tuning(*map(np.float64, (omega, draw(st.floats(0.2, 3.0)), omega * draw(factors))))


def desired(tuning: Tuning) -> Array:
    """Return the coefficients of eq. 24, highest power first, by multiplying it out."""
    w, z, p = tuning
    pair = [1.0, 2.0 * z * w, w * w]
    return np.polymul(np.polymul(pair, pair), [1.0, p])  # type: ignore[return-value]


def loop_gain(tuning: Tuning, w: Array) -> Array:
    """Return L(j w) of the plant 1 / s^2 under the law of eqs. 14 and 17, from eq. 24."""
    _, b4, *numerator = desired(tuning)
    s = 1j * w
    return np.polyval(numerator, s) / (s**4 * (s + b4))


def swept_delay_margin(tuning: Tuning) -> float:
    """Return the least delay that turns L onto -1 at any frequency where |L| = 1, by looking at all."""
    w = tuning.omega_c * np.logspace(-3, 3, 20_001)
    loop = loop_gain(tuning, w)
    size = np.log(np.abs(loop))
    phase = np.unwrap(np.angle(loop))
    delays = []
    for i in np.flatnonzero(np.diff(np.sign(size))):
        share = size[i] / (size[i] - size[i + 1])
        crossover = math.exp((1 - share) * math.log(w[i]) + share * math.log(w[i + 1]))
        angle = (1 - share) * phase[i] + share * phase[i + 1]
        delays.append((angle + math.pi) % (2.0 * math.pi) / crossover)
    return min(delays)


@given(tunings())
def test_betas_are_the_coefficients_of_the_desired_polynomial(tuning: Tuning) -> None:
    # Sums of a few positive terms: no digits cancel.
    np.testing.assert_allclose(betas(tuning)[::-1], desired(tuning)[1:], rtol=1e-14)


def test_betas_of_many_tunings_are_those_of_each() -> None:
    omega, zeta = np.array([[5.0, 10.0], [20.0, 40.0]]), np.array([0.7, 1.2])
    together = betas(Tuning(omega, zeta, 0.5 * omega))
    for index in np.ndindex(2, 2):
        alone = betas(Tuning(omega[index], zeta[index[1]], 0.5 * omega[index]))
        np.testing.assert_array_equal([beta[index] for beta in together], alone)


@given(tunings())
def test_the_delay_margin_is_the_least_delay_over_all_crossovers(tuning: Tuning) -> None:
    # Interpolation between points 7e-4 apart in log(w) is good to their square.
    np.testing.assert_allclose(delay_margins(tuning), swept_delay_margin(tuning), rtol=1e-5)


def test_a_plain_tuning_has_the_stated_margins() -> None:
    plain = Tuning(*map(np.float64, (1.0, 1.0, 1.0)))  # zeta_c = 1, p_c = omega_c; times in 1 / omega_c
    w = np.linspace(0.1, 10.0, 1_000_001)
    loop = loop_gain(plain, w)
    crossover = w[np.argmin(np.abs(np.abs(loop) - 1.0))]
    margin = float(delay_margins(plain))
    assert crossover == pytest.approx(1.88, abs=5e-3)
    assert margin == pytest.approx(0.356, abs=5e-4)
    assert math.degrees(margin * crossover) == pytest.approx(38.0, abs=0.5)
    assert np.max(1.0 / np.abs(1.0 + loop)) == pytest.approx(1.55, abs=5e-3)


@given(tunings(), factors)
def test_a_loop_that_is_k_times_faster_stands_a_k_th_of_the_delay(tuning: Tuning, k: float) -> None:
    faster = Tuning(k * tuning.omega_c, tuning.zeta_c, k * tuning.p_c)
    np.testing.assert_allclose(delay_margins(faster), delay_margins(tuning) / k, rtol=1e-9)


def test_delay_margins_of_many_tunings_are_those_of_each() -> None:
    omega = np.array([[5.0, 10.0, 5.0], [20.0, 5.0, 10.0]])
    together = delay_margins(Tuning(omega, np.array(0.8), omega))
    alone = [[float(delay_margins(Tuning(w, np.array(0.8), w))) for w in row] for row in omega]
    np.testing.assert_array_equal(together, alone)


@given(st.floats(-5.0, -1.0), st.floats(-5.0, 0.0))
def test_the_default_bandwidth_leaves_two_thirds_of_the_delay_margin(log_dt: float, log_delay: float) -> None:
    dt, delay = 10.0**log_dt, 10.0**log_delay
    omega = np.array(default_omega(dt, delay))
    assert 1.5 * dt + delay < float(delay_margins(Tuning(omega, np.array(1.0), omega))) / 3.0


def test_the_default_bandwidth_falls_with_sample_time_and_delay_up_to_its_cap() -> None:
    assert default_omega(1e-2) == pytest.approx(0.1 / 0.015)
    assert default_omega(1e-2, delay=5e-3) == pytest.approx(0.1 / 0.02)
    assert default_omega(1e-4) == default_omega(1e-5)  # a cap
    assert default_omega(1e-4, highest=25.0) == 25.0
    assert default_omega(1e-4, highest=1e3) == pytest.approx(0.1 / 1.5e-4)


@pytest.mark.parametrize("member", [Member(1, 0), Member(2, 1), Member(2, 1, 2.0), Member(3, 2)])
def test_the_default_bandwidth_of_a_member_leaves_the_same_share_of_its_margin(member: Member) -> None:
    for dt, delay in ((4e-3, 0.0), (2e-3, 6e-3)):
        shares = []
        for each in (PRINTED, member):
            omega = np.array(default_omega(dt, delay, math.inf, each))
            shares.append(
                (1.5 * dt + delay) / float(delay_margins(Tuning(omega, np.array(1.0), omega), each))
            )
        assert shares[0] == pytest.approx(shares[1], rel=1e-9)


@pytest.mark.parametrize(
    ("dt", "delay", "named"), [(0.0, 0.0, "dt"), (-1e-3, 0.0, "dt"), (1e-3, -1.0, "delay")]
)
def test_the_default_bandwidth_refuses_times_that_cannot_be(dt: float, delay: float, named: str) -> None:
    with pytest.raises(ParameterError, match=named):
        default_omega(dt, delay)


def test_fixed_gains_are_critically_damped_with_equal_poles_unless_told_otherwise() -> None:
    tuning = FixedGains(20.0).prepare(JOINTS, 1e-3).nominal()
    np.testing.assert_array_equal(tuning, [[20.0, 20.0], [1.0, 1.0], [20.0, 20.0]])


def test_fixed_gains_may_differ_by_joint_and_rollout() -> None:
    gains = FixedGains([[10.0, 20.0], [30.0, 40.0]], zeta_c=[0.7, 1.0], p_c=5.0).prepare(JOINTS, 1e-3)
    assert gains.batch == 2
    assert gains.nominal().omega_c.shape == (2, 2)
    np.testing.assert_array_equal(gains.nominal().zeta_c, [0.7, 1.0])
    np.testing.assert_array_equal(gains.nominal().p_c, [5.0, 5.0])


@pytest.mark.parametrize("parameter", ["omega_c", "zeta_c", "p_c"])
@pytest.mark.parametrize(
    ("value", "says"),
    [
        ([1.0, 0.0], "elbow"),
        ([1.0, -3.0], "elbow"),
        ([1.0, math.nan], "finite"),
        (math.inf, "finite"),
        ([1.0, 2.0, 3.0], "shape"),
        ("fast", "numbers"),
        (True, "numbers"),
        (np.float32(1.0) * np.ones(2, np.float32), "float64"),
    ],
)
def test_a_bad_tuning_is_named(parameter: str, value: object, says: str) -> None:
    tuning = {"omega_c": 10.0, parameter: value}
    with pytest.raises(ArrayError, match=f"{parameter}.*{says}"):
        FixedGains(**tuning).prepare(JOINTS, 1e-3)


def test_gains_for_different_numbers_of_rollouts_are_refused() -> None:
    with pytest.raises(ParameterError, match="batch"):
        FixedGains(np.ones((2, 2)), zeta_c=np.ones((3, 2))).prepare(JOINTS, 1e-3)
