"""Margins of the family: the figures of the printed law, sweeps over frequencies, and roots of the loop."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.optimize import minimize_scalar

from armgpi import Tuning
from armgpi.gpi.family import PRINTED, Member, transfer_function
from armgpi.gpi.margins import (
    Interval,
    Loop,
    count_noise,
    crossovers,
    delay_margin,
    delay_margins,
    gain_interval,
    open_loop,
    peak_sensitivity,
    phase_margin,
    sector,
)

Array = npt.NDArray[np.float64]

OMEGA = 30.0
SWEEP = np.logspace(-3.0, 3.0, 60_001)


def tuned(zeta: float = 1.0, p: float = 1.0, omega: float = OMEGA) -> Tuning:
    """A tuning of one joint, its pole as a multiple of omega."""
    return Tuning(*map(np.array, (omega, zeta, p * omega)))


@st.composite
def loops(draw: st.DrawFn) -> Loop:
    """Loops of any member."""
    member = Member(
        draw(st.integers(1, 3)),
        draw(st.integers(0, 2)),
        draw(st.floats(0.5, 10.0)),
        draw(st.none() | st.floats(0.5, 4.0)),
        draw(st.none() | st.floats(0.5, 1.5)),
    )
    return open_loop(tuned(draw(st.floats(0.5, 1.5)), draw(st.floats(0.5, 4.0))), member)


def swept(loop: Loop, shift: float = 0.0) -> Array:
    """Return L(j w - shift) over the sweep, frequencies in units of omega."""
    s = 1j * SWEEP - shift
    return np.polyval(loop.numerator, s) / np.polyval(loop.denominator, s)


def fastest(loop: Loop, delta: float) -> float:
    """Return the largest real part of the closed loop's poles."""
    return float(np.roots(np.polyadd(loop.denominator, delta * loop.numerator)).real.max())


def test_the_loop_is_the_law_over_the_double_integrator() -> None:
    member = Member(3, 2, 2.0, 1.5, 0.8)
    numerator, denominator = transfer_function(tuned(0.8, 1.3), member)
    s = OMEGA * (0.4 + 0.7j)
    law = np.polyval(numerator[::-1], s) / (s**3 * np.polyval([1.0, *denominator[::-1]], s))
    loop = open_loop(tuned(0.8, 1.3), member, delta=1.2)
    value = np.polyval(loop.numerator, s / OMEGA) / np.polyval(loop.denominator, s / OMEGA)
    assert value == pytest.approx(1.2 * law / s**2, rel=1e-12)


# Multiples of omega: roll-off, p_c, p_f; phase margin [degrees], sensitivity, omega times delay margin,
# frozen delta, upper end of the sector from 1.
FIGURES = [
    ((0, 1.0, 4.0), (38.3, 1.553, 0.356, (0.36, math.inf), 4.270)),
    ((1, 1.0, 1.0), (25.6, 2.303, 0.347, (0.471, 3.21), 2.156)),
    ((1, 3.0, 3.0), (29.7, 2.020, 0.274, (0.413, 3.82), 2.428)),
    ((1, 4.0, 4.0), (32.1, 1.888, 0.268, (0.385, 4.25), 2.614)),
    ((1, 1.0, 3.0), (28.1, 2.115, 0.317, (0.439, 3.66), 2.338)),
]


@pytest.mark.parametrize(("where", "figures"), FIGURES)
def test_two_integrators_have_the_stated_margins(
    where: tuple[int, float, float], figures: tuple[float, float, float, tuple[float, float], float]
) -> None:
    rolloff, p, p_f = where
    loop = open_loop(tuned(p=p), Member(2, rolloff, p_f))
    phase, sensitivity, delay, frozen, varying = figures
    assert math.degrees(phase_margin(loop)) == pytest.approx(phase, abs=0.05)
    assert peak_sensitivity(loop) == pytest.approx(sensitivity, abs=1e-3)
    assert OMEGA * delay_margin(loop) == pytest.approx(delay, abs=1e-3)
    assert gain_interval(loop) == pytest.approx(frozen, abs=5e-3)
    assert sector(loop).upper == pytest.approx(varying, abs=1e-3)


def widest_sector(loop: Loop, sigma: float = 0.0) -> Interval:
    """Return the interval of :func:`sector` with the largest ratio of its ends."""
    frozen = gain_interval(loop, sigma)
    tried = np.linspace(math.log(max(frozen.lower, 1e-3)), math.log(min(frozen.upper, 1e3)), 66)

    def shortfall(x: float) -> float:
        interval = sector(loop, math.exp(x), sigma)
        return -interval.upper / interval.lower

    best, step = min(tried[1:-1], key=shortfall), tried[1] - tried[0]
    found = minimize_scalar(
        shortfall, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-9}
    )
    return sector(loop, math.exp(found.x), sigma)


@pytest.mark.parametrize(("sigma", "ratio"), [(0.0, 4.66), (0.1, 4.38), (0.2, 4.14), (0.4, 3.71)])
def test_the_widest_sector_shrinks_as_the_arm_moves_faster(sigma: float, ratio: float) -> None:
    interval = widest_sector(open_loop(tuned()), sigma * OMEGA)
    assert interval.upper / interval.lower == pytest.approx(ratio, abs=5e-3)


def test_delay_margins_of_a_robot_are_those_of_its_joints() -> None:
    omega = np.array([[10.0, 20.0, 10.0], [30.0, 10.0, 20.0]])
    zeta, p, ratio = np.array([0.7, 1.0, 1.2]), 2.0 * omega, np.array([2.0, 4.0, 8.0])
    together = delay_margins(Tuning(omega, zeta, p), Member(2, 1, ratio), delta=1.5)
    for i, j in np.ndindex(2, 3):
        one = open_loop(tuned(zeta[j], 2.0, omega[i, j]), Member(2, 1, ratio[j]), delta=1.5)
        assert together[i, j] == pytest.approx(delay_margin(one), rel=1e-9)
    assert (delay_margins(Tuning(omega, zeta, p), Member(2, 1, ratio), delta=20.0) == 0.0).all()


@settings(max_examples=30)
@given(loops())
def test_margins_are_those_of_a_sweep(loop: Loop) -> None:
    value = swept(loop)
    near = np.flatnonzero(np.diff(np.sign(np.log(np.abs(value)))))
    # Interpolated by nothing: neighbours of the sweep are 2e-4 apart in log w.
    np.testing.assert_allclose(np.sort(crossovers(loop)) / OMEGA, SWEEP[near], rtol=5e-4)
    phases = (np.angle(value[near]) + math.pi) % (2.0 * math.pi)
    assert phase_margin(loop) == pytest.approx(phases.min(), abs=2e-3)
    assert OMEGA * delay_margin(loop) == pytest.approx((phases / SWEEP[near]).min(), rel=5e-3)
    assert peak_sensitivity(loop) == pytest.approx((1.0 / np.abs(1.0 + value)).max(), rel=1e-6)


@settings(max_examples=30)
@given(loops())
def test_the_loop_is_stable_inside_the_interval_of_gains_and_not_beyond(loop: Loop) -> None:
    lower, upper = gain_interval(loop)
    for inside in np.geomspace(lower * 1.01, min(upper, 1e3) / 1.01, 9):
        assert fastest(loop, inside) < 0.0
    assert fastest(loop, lower / 1.01) > 0.0
    assert upper == math.inf or fastest(loop, upper * 1.01) > 0.0


@settings(max_examples=30)
@given(loops(), st.floats(0.8, 1.2), st.floats(0.0, 0.1))
def test_the_sector_is_as_far_as_the_circle_criterion_holds(loop: Loop, lowest: float, sigma: float) -> None:
    lower, upper = sector(loop, lowest, sigma * OMEGA)
    value = swept(loop, sigma / 2.0)

    def holds(b: float) -> bool:
        return bool((((1.0 + b * value) * np.conj(1.0 + lower * value)).real > 0.0).all())

    if upper == lower:
        assert fastest(loop, lower) >= -sigma / 2.0
    else:
        assert holds(lower + (upper - lower) * 0.999)
        assert not holds(upper * 1.001)


def test_where_a_loop_is_not_fast_enough_the_intervals_are_empty() -> None:
    loop = open_loop(tuned())
    assert sector(loop, 0.3) == (0.3, 0.3)
    assert sector(loop, 1.0, 3.0 * OMEGA) == (1.0, 1.0)
    assert gain_interval(loop, 3.0 * OMEGA) == (1.0, 1.0)


@pytest.mark.parametrize("member", [PRINTED, Member(2, 1), Member(1, 2, 2.0), Member(3, 2)])
def test_noise_is_that_of_the_sampled_loop(member: Member) -> None:
    dt, tuning = 1e-3, tuned()
    above, below = transfer_function(tuning, member)
    denominator = np.array([1.0, *below[::-1], *[0.0] * member.integrators])
    A, B, C, D, _ = signal.cont2discrete(signal.tf2ss(above[::-1], denominator), dt, "bilinear")
    # SciPy's law on a double integrator that is stepped exactly: the response of v to one wrong count.
    x, q, speed, v = np.zeros((len(A), 1)), 0.0, 0.0, []
    for k in range(2000):
        e = q + (k == 0)
        v.append(-float((C @ x).item() + D.item() * e))
        x = A @ x + B * e
        q, speed = q + dt * speed + 0.5 * dt * dt * v[-1], speed + dt * v[-1]
    noise = count_noise(tuning, dt, member)
    assert noise.at_once == pytest.approx(abs(v[0]), rel=1e-9)
    assert noise.deviation == pytest.approx(np.linalg.norm(v), rel=1e-6)
    assert noise.step == pytest.approx(np.linalg.norm(np.diff(v, prepend=0.0)), rel=1e-6)


def test_noise_of_a_sampled_loop_that_is_not_stable_is_infinite() -> None:
    assert count_noise(tuned(omega=2000.0), 1e-3).deviation == math.inf


@pytest.mark.parametrize("integrators", [1, 2, 3])
def test_a_roll_off_passes_half_a_sample_of_an_integral_for_each_pole(integrators: int) -> None:
    dt = 1e-4
    for rolloff in (0, 1, 2):
        member = Member(integrators, rolloff, 2.0)
        leading = float(transfer_function(tuned(), member).numerator[-1])
        at_once = count_noise(tuned(), dt, member).at_once
        assert at_once == pytest.approx(leading * (0.5 * dt) ** rolloff, rel=0.05)
