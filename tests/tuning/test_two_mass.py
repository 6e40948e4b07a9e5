"""The linear loop of an arm with gears is the slope of the arm's own equations, gravity in them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from armgpi import Robot
from armgpi.base.arrays import Array
from armgpi.control.linear_arm import gravity_stiffness
from armgpi.tuning.two_mass import Gears, plant

ROTOR, STIFFNESS = np.array([0.4, 0.3, 0.1]), np.array([900.0, 700.0, 300.0])
Q, DT = np.array([0.3, 0.7, -0.9]), 0.02
#: Step of the differences: of the third power of it and of the integrator's error, some 1e-10, is left.
STEP = 1e-4


def moved(robot: Robot, gears: Gears, x: Array, tau: Array) -> Array:
    """Return the state after a sample of the arm's own equations, integrated by SciPy."""
    n, elastic = robot.n, gears.stiffness is not None
    m = 2 * n if elastic else n
    mass = robot.mass_matrix(Q)
    shunt = 2.0 * gears.damping * np.sqrt(STIFFNESS / (1.0 / np.diag(mass) + 1.0 / ROTOR))

    def rates(_: float, x: Any) -> Array:
        q, v = x[:n], x[m : m + n]
        torque = tau if gears.current is None else x[2 * m :]
        current = [] if gears.current is None else [2.0 * np.pi * gears.current * (tau - torque)]
        if not elastic:
            D = robot.mass_matrix(q) + np.diag(ROTOR)
            return np.concatenate([v, np.linalg.solve(D, torque - robot.nonlinear_effects(q, v)), *current])
        theta, omega = x[n:m], x[m + n : 2 * m]
        gear = STIFFNESS * (theta - q) + shunt * (omega - v)
        fast = np.linalg.solve(robot.mass_matrix(q), gear - robot.nonlinear_effects(q, v))
        return np.concatenate([v, omega, fast, (torque - gear) / ROTOR, *current])

    done = solve_ivp(rates, (0.0, DT), x, method="DOP853", rtol=1e-12, atol=1e-14)
    found: Array = done.y[:, -1]
    return found


@pytest.mark.parametrize("current", [None, 60.0])
@pytest.mark.parametrize("stiffness", [None, STIFFNESS])
def test_the_sampled_loop_is_the_slope_of_the_arms_own_motion(
    stiffness: Array | None, current: float | None
) -> None:
    robot = Robot.load("anthropomorphic3")
    gears = Gears(ROTOR, stiffness, 0.05, current)
    A, B, _ = plant(robot, Q, gears, DT)
    held = robot.gravity(Q)
    rest = [Q] if stiffness is None else [Q, Q + held / STIFFNESS]
    rest += [np.zeros(sum(map(len, rest)))] + ([] if current is None else [held])
    x = np.concatenate(rest)
    assert moved(robot, gears, x, held) == pytest.approx(x, abs=1e-9)  # it is at rest there
    still, same = np.zeros_like(x), np.zeros_like(held)
    of_state = [(e, same) for e in STEP * np.eye(len(x))]
    of_torque = [(still, e) for e in STEP * np.eye(len(held))]
    for matrix, steps in ((A, of_state), (B, of_torque)):
        columns = []
        for dx, dtau in steps:
            ahead, behind = (moved(robot, gears, x + k * dx, held + k * dtau) for k in (1.0, -1.0))
            columns.append((ahead - behind) / (2.0 * STEP))
        scale = np.abs(matrix).max(axis=1, keepdims=True)
        assert (np.array(columns).T - matrix) / scale == pytest.approx(np.zeros(matrix.shape), abs=2e-6)


def test_gravity_makes_a_difference_that_the_comparison_sees() -> None:
    """The loop without gravity is 1e4 times as far from the arm's own motion as the comparison allows."""
    robot = Robot.load("anthropomorphic3")
    steep = gravity_stiffness(robot, Q)
    fall = np.linalg.solve(robot.mass_matrix(Q) + np.diag(ROTOR), steep) * DT
    A, _, _ = plant(robot, Q, Gears(ROTOR, None, 0.05, None), DT)
    assert np.abs(fall).max() / np.abs(A[3:]).max() > 1e-2
