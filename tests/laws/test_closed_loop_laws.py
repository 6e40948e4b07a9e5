"""The closed GPI loop: eqs. 20 and 24 in continuous time, and what limits do to it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import sled, swing
from scipy import signal
from scipy.linalg import expm

from armgpi import (
    GPI,
    FixedGains,
    Friction,
    Hold,
    Load,
    Plant,
    Ramp,
    RigidBodyPlant,
    Robot,
    Step,
    simulate,
)
from armgpi.gpi.realisation import Bumpless

Array = npt.NDArray[np.float64]

SLED = sled()  # 1 kg on a rail: the double integrator of eq. 12, force being acceleration
DT = 1e-3


def desired(omega: float, zeta: float, p: float) -> Array:
    """Return the coefficients of eq. 24, multiplied out."""
    pair = [1.0, 2.0 * zeta * omega, omega * omega]
    return np.polymul(np.polymul(pair, pair), [1.0, p])


def analytic_error(tuning: tuple[float, float, float], start: Array, push: Array, t: Array) -> Array:
    """Return e(t) from e, e' = `start` under the acceleration push[0] + push[1] t.

    e'' = v + zeta and v = -C(s) e give E(s) (s^2 + C(s)) = s e0 + e0' + p0 / s + p1 / s^2. Multiplied by
    the denominator s^2 (s + beta4) of C, the left side is E(s) times the polynomial of eq. 24.
    """
    denominator = desired(*tuning)
    filtered = [1.0, denominator[1]]
    numerator = np.polymul(filtered, np.polyadd([*start, 0.0, 0.0], push))
    A, B, C, _ = signal.tf2ss(numerator, denominator)
    return np.array([float((C @ expm(A * x) @ B)[0, 0]) for x in t])


def errors_of(
    plant: Plant, tuning: tuple[float, ...], dt: float, t_final: float, start: Array, **options: Any
) -> tuple[Array, Array]:
    """Return sample times and errors of the sled held at the origin."""
    controller = GPI(SLED, dt, FixedGains(*tuning), start="zero", **options)
    rollout = simulate(plant, controller, Hold([0.0]), t_final, q0=start[:1], v0=start[1:], divergence=1e6)
    return rollout["time"].values, rollout["q"].values[:, 0]


@pytest.mark.parametrize("realisation", ["bumpless", "paper"])
@pytest.mark.parametrize("tuning", [(2.0, 1.0, 2.0), (3.0, 0.6, 1.0)])
@pytest.mark.parametrize(
    ("start", "push"),
    [([0.5, 0.0], [0.0, 0.0]), ([0.0, 1.0], [0.0, 0.0]), ([0.0, 0.0], [3.0, 0.0]), ([0.1, -0.3], [1.0, 2.0])],
    ids=["position", "velocity", "constant", "ramp"],
)
def test_the_loop_follows_the_fifth_order_response_at_order_one(
    realisation: str, tuning: tuple[float, float, float], start: list[float], push: list[float]
) -> None:
    # The trapezoidal rule is of order two; a torque held over the sample is late by half of it: order one.
    plant = RigidBodyPlant(SLED, [Step(-push[0]), Ramp(-push[1])])  # loads oppose the motor
    steps = np.array([16e-3, 8e-3, 4e-3, 2e-3, 1e-3])
    errors = []
    for dt in steps:
        t, e = errors_of(plant, tuning, dt, 3.2, np.array(start), realisation=realisation)
        every = len(t) // 50  # enough instants of the comparison, and the same ones at every step
        expected = analytic_error(tuning, np.array(start), np.array(push), t[::every])
        errors.append(np.abs(e[::every] - expected).max())
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("realisation", ["bumpless", "paper"])
@pytest.mark.parametrize("loads", [[Step(7.0)], [Ramp(5.0)], [Step(-3.0), Ramp(2.0), Step(4.0, onset=1.0)]])
def test_constant_and_ramp_disturbances_leave_no_error(realisation: str, loads: list[Load]) -> None:
    plant = RigidBodyPlant(SLED, loads)
    _, e = errors_of(plant, (20.0, 1.0, 20.0), DT, 6.0, np.zeros(2), realisation=realisation)
    assert np.abs(e).max() > 1e-4  # it was felt,
    assert np.abs(e[-500:]).max() < 1e-12  # and is gone: e^(-20 * 4.5) and rounding


@pytest.mark.parametrize(
    ("scale", "stable"), [(0.3, False), (0.35, False), (0.40, True), (1.0, True), (5.0, True)]
)
def test_a_model_whose_inertia_is_scaled_is_stable_above_0_37(scale: float, stable: bool) -> None:
    controller = GPI(SLED.scaled_inertia(scale), DT, FixedGains(20.0), start="zero")
    rollout = simulate(RigidBodyPlant(SLED), controller, Hold([0.0]), 10.0, q0=[1e-3], divergence=1e9)
    assert (np.abs(rollout["q"].values[-100:]).max() < 1e-4) == stable


@pytest.mark.parametrize(("rate", "stable"), [(3.0, True), (6.0, True), (7.5, False)])
def test_viscous_friction_is_rejected_up_to_6_7_times_the_bandwidth(rate: float, stable: bool) -> None:
    # Friction whose rate f / m nears the loop's own is no disturbance any more, but another plant:
    # s^2 (s + beta4) (s^2 + (f / m) s) + N(s) has roots on the right above f / m = 6.68 omega_c.
    omega, polynomial = 20.0, desired(1.0, 1.0, 1.0)
    roots = np.roots(polynomial + rate * np.array([0.0, 1.0, polynomial[1], 0.0, 0.0, 0.0]))
    assert (roots.real.max() < 0.0) == stable
    plant = RigidBodyPlant(SLED, friction=Friction(rate * omega, 0.0))
    _, e = errors_of(plant, (omega, 1.0, omega), DT, 10.0, np.array([1e-3, 0.0]))
    assert (np.abs(e[-100:]).max() < 1e-3) == stable


def step_response(robot: Robot, gains: FixedGains, effort: Any, t_final: float) -> Array:
    """Return q - q* (samples, n) of a step of 1 rad or m on every joint, from rest."""
    controller = GPI(robot, DT, gains, effort=effort, start="zero")
    goal = Hold(np.ones(robot.n))
    start, law = np.zeros(robot.n), controller
    backend = "auto" if t_final > 5.0 else "numpy"  # long runs are worth a compiler's time
    rollout = simulate(RigidBodyPlant(robot), law, goal, t_final, q0=start, divergence=1e9, backend=backend)
    assert (np.abs(rollout["tau"].values) <= controller.effort).all()
    return (rollout["q"] - 1.0).values


def hundredth(robot: Robot, omega: float) -> Array:
    """Return a hundredth of the torque that the law asks for at the beginning of a step of 1 rad."""
    beta3 = desired(omega, 1.0, omega)[2]
    return 0.01 * robot.mass_matrix(np.zeros(robot.n)) @ np.full(robot.n, beta3)


bandwidths = pytest.mark.parametrize("omega", [10.0, 20.0, 40.0])


@bandwidths
@pytest.mark.parametrize("limit", ["50 m/s^2", "a hundredth"])
def test_a_step_far_beyond_the_limit_settles_without_a_limit_cycle(omega: float, limit: str) -> None:
    e = step_response(SLED, FixedGains(omega), 50.0 if limit == "50 m/s^2" else hundredth(SLED, omega), 4.0)
    assert e.max() < 0.2  # overshoot
    assert np.abs(e[1200:]).max() < 0.02  # settled after 1.2 s
    assert np.abs(e[-500:]).max() < 1e-6  # for good


@bandwidths
def test_a_step_far_beyond_the_limits_of_a_coupled_arm_settles_without_a_limit_cycle(omega: float) -> None:
    arm = swing(2, axis="0 0 1")
    e = step_response(arm, FixedGains(omega), hundredth(arm, omega), 4.0)
    assert e.max() < 0.2
    assert np.abs(e[-500:]).max() < 1e-6


@bandwidths
@pytest.mark.parametrize("limit", [50.0, None])
def test_without_knowing_what_was_applied_it_diverges(
    omega: float, limit: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    update = Bumpless.update
    monkeypatch.setattr(Bumpless, "update", lambda law, e, v, a, state, c: update(law, e, v, None, state, c))
    e = step_response(SLED, FixedGains(omega), limit or hundredth(SLED, omega), 4.0)
    assert np.abs(e[-500:]).max() > 1.0


@pytest.mark.slow
@given(st.floats(0.7, 2.0), st.floats(0.3, 10.0), st.floats(0.003, 1.0))
@settings(max_examples=10)
def test_saturated_loops_of_any_sound_tuning_come_to_rest(zeta: float, ratio: float, share: float) -> None:
    omega = 20.0
    asked = desired(omega, zeta, ratio * omega)[2]
    e = step_response(SLED, FixedGains(omega, zeta, ratio * omega), share * asked, 12.0)
    # The slowest pole, at -2.7 /s or so, leaves e^(-2.7 * 9) of some radians.
    assert np.abs(e[-100:]).max() < 1e-6
