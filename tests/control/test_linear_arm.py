"""The linear model of an arm with elastic joints: SciPy's exponential of its equations, a loop by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from armgpi.base.arrays import Array
from armgpi.control.linear_arm import Law, LinearArm, closed, critical_damping, exponential, sampled

#: A joint of three is stiff: the one in the middle.
ELASTIC = np.array([0, 2])
ROTOR, STIFFNESS, DAMPING = np.array([0.4, 0.1]), np.array([900.0, 300.0]), np.array([3.0, 0.7])
INERTIA = np.array([[2.0, 0.5, 0.1], [0.5, 1.2, 0.2], [0.1, 0.2, 0.6]])
GRAVITY = np.array([[0.0, 0.0, 0.0], [0.0, 9.0, 4.0], [0.0, 4.0, 5.0]])
DT = 0.01


def rates(x: Array, held: Array, current: float | None) -> Array:
    """Return dx/dt of the equations in the module's docstring, joint by joint."""
    q, theta, v, omega = x[:3], x[3:5], x[5:8], x[8:10]
    torque = held if current is None else x[10:]
    on_links = -GRAVITY @ q
    motors = np.zeros(2)
    for i, joint in enumerate(ELASTIC):
        spring = STIFFNESS[i] * (q[joint] - theta[i]) + DAMPING[i] * (v[joint] - omega[i])
        on_links[joint] -= spring
        motors[i] = (torque[joint] + spring) / ROTOR[i]
    on_links[1] += torque[1]
    currents = [] if current is None else [2.0 * np.pi * current * (held - torque)]
    return np.concatenate([v, omega, np.linalg.solve(INERTIA, on_links), motors, *currents])


@pytest.mark.parametrize("current", [None, 40.0])
def test_a_sample_is_the_exponential_of_the_equations(current: float | None) -> None:
    size = 10 if current is None else 13
    unit, none = np.eye(size + 3), np.zeros(3)
    columns = [rates(column[:size], column[size:], current) for column in unit]
    whole = np.vstack([np.array(columns).T, np.zeros((3, size + 3))])
    exact = expm(DT * whole)[:size]
    arm = LinearArm(INERTIA, GRAVITY, ELASTIC, ROTOR, STIFFNESS, DAMPING, current)
    A, B, C = sampled(arm, DT, np.array([True, True, False]))
    scale = np.abs(exact).max(axis=1, keepdims=True)
    assert np.hstack([A, B]) / scale == pytest.approx(exact / scale, abs=1e-13)
    state = np.arange(1.0, size + 1.0)
    # The first joint is seen at its motor, the last at its link; the stiff one has no other place.
    assert (C @ state).tolist() == [state[3], state[1], state[2]]
    assert np.array_equal(rates(np.zeros(size), none, current), np.zeros(size))


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_closed_loop_is_its_samples_one_after_the_other(delay: int) -> None:
    rng = np.random.default_rng(0)
    linear = LinearArm(INERTIA, GRAVITY, ELASTIC, ROTOR, STIFFNESS, DAMPING, None)
    arm = sampled(linear, DT, np.array([True, True, False]))
    batch = [Law(*(rng.normal(size=shape) for shape in ((2, 2), (2, 3), (3, 2), (3, 3)))) for _ in range(2)]
    stacked: Any = (np.array(parts) for parts in zip(*batch, strict=True))
    both = closed(arm, Law(*stacked), delay)
    for law, turn in zip(batch, both, strict=True):
        assert closed(arm, law, delay) == pytest.approx(turn, rel=1e-14)
        x, own = rng.normal(size=10), rng.normal(size=2)
        line = [rng.normal(size=3) for _ in range(delay)]  # measurements on their way, the newest first
        after = turn @ np.concatenate([x, *line, own])
        measured = arm.C @ x
        seen = line[-1] if delay else measured
        tau = law.C @ own + law.D @ seen
        expected = [arm.A @ x + arm.B @ tau, *[measured, *line][:delay], law.A @ own + law.B @ seen]
        assert after == pytest.approx(np.concatenate(expected), rel=1e-12, abs=1e-12)


def test_the_exponential_is_scipys() -> None:
    rng = np.random.default_rng(1)
    for size in (1e-300, 1e-3, 1.0, 3.0):
        matrix = size * rng.normal(size=(7, 7))
        exact = expm(matrix)
        assert exponential(matrix) == pytest.approx(exact, abs=1e-12 * np.abs(exact).max())


def test_a_mode_with_critical_damping_does_not_swing() -> None:
    link, rotor, stiffness = np.array(0.8), np.array(0.3), np.array(250.0)
    damping = critical_damping(link, rotor, stiffness)
    reduced = link * rotor / (link + rotor)
    # reduced x'' + damping x' + stiffness x = 0 has a double root.
    assert damping**2 == pytest.approx(4.0 * reduced * stiffness, rel=1e-14)
