"""Actuators: torque cut to a limit, torque that changes no faster than a rate."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import State, robots_and_states

from armgpi import GPI, FixedGains, Hold, RateLimited, RigidBodyPlant, Robot, Saturated, simulate
from armgpi.errors import ArmgpiError, ArrayError

Array = npt.NDArray[np.float64]

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
PLANT = RigidBodyPlant(ARM)
ZERO = np.zeros(3)


def applied(plant: Any, commands: Array) -> Array:
    """Return the torques that reach the joints of the level arm."""
    state = plant.init(ZERO, ZERO)
    torques = []
    for tau in commands:
        state = plant.step(tau, state, DT)
        torques.append(plant.true_state(state).tau)
    return np.array(torques)


@given(robots_and_states(max_joints=4), st.floats(0.0, 10.0))
def test_saturation_cuts_to_the_limits_of_any_robot_and_moves_it_as_the_cut_torque_does(
    drawn: tuple[Robot, State], share: float
) -> None:
    robot, (q, v, a) = drawn
    tau = share * np.sign(a) * robot.limits.effort
    cut = np.clip(tau, -robot.limits.effort, robot.limits.effort)
    plain, saturated = RigidBodyPlant(robot), Saturated(RigidBodyPlant(robot))
    expected = plain.step(cut, plain.init(q, v), DT)
    truth = saturated.true_state(saturated.step(tau, saturated.init(q, v), DT))
    for one, other in zip(truth, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_saturation_takes_its_own_limits() -> None:
    commands = np.array([[5.0, -5.0, 0.1], [-5.0, 1.0, 5.0]])
    limits = np.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(
        applied(Saturated(PLANT, limits), commands), np.clip(commands, -limits, limits)
    )


@given(st.integers(0, 1000), st.floats(1.0, 1e4))
def test_a_limited_rate_is_never_exceeded_and_always_used(seed: int, rate: float) -> None:
    commands = np.random.default_rng(seed).normal(0.0, 3.0, (50, 3))
    torques = applied(RateLimited(PLANT, rate), commands)
    before = np.vstack([ARM.gravity(ZERO), torques[:-1]])  # the brakes open while the motors hold the arm
    change, wanted = torques - before, commands - before
    most = rate * DT
    assert (np.abs(change) <= most * (1.0 + 1e-9)).all()
    # All of the way, or as much of it as the rate allows.
    np.testing.assert_allclose(change, np.clip(wanted, -most, most), atol=1e-12)


def test_an_arm_whose_holding_torque_is_commanded_stays_though_its_torque_is_slow() -> None:
    plant = RateLimited(PLANT, 1e-3)
    hold = np.tile(ARM.gravity(ZERO), (100, 1))
    np.testing.assert_array_equal(applied(plant, hold), hold)


def test_a_rollout_records_the_torque_asked_for_and_the_one_applied() -> None:
    limited = Saturated(RateLimited(PLANT, 50.0), 2.0)
    rollout = simulate(limited, GPI(ARM, DT, FixedGains(20.0)), Hold(ZERO + 0.2), 0.1, q0=ZERO)
    asked, got = rollout["tau_command"].values, rollout["tau"].values
    assert np.abs(asked).max() > 10.0  # the controller does not know of the limits
    assert np.abs(np.diff(got, axis=0)).max() <= 50.0 * DT * (1.0 + 1e-12)


@pytest.mark.parametrize(
    ("make", "error", "named"),
    [
        (lambda: Saturated(PLANT, 0.0), ArrayError, "effort.*q1"),
        (lambda: Saturated(PLANT, [1.0, 2.0]), ArrayError, "effort"),
        (lambda: RateLimited(PLANT, [1.0, -1.0, 1.0]), ArrayError, "rate.*q2"),
        (lambda: RateLimited(PLANT, np.nan), ArrayError, "rate"),
        (lambda: RateLimited(RateLimited(PLANT, np.ones((2, 3))), np.ones((3, 3))), ArmgpiError, "batch"),
    ],
)
def test_a_bad_parameter_is_named(make: Any, error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        make()
