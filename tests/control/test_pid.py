"""The baseline of eqs. 32-33: linear error dynamics where its model is exact, and what it cancels."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import sled, swing
from scipy.linalg import expm
from strategies import State, robots_and_states

from armgpi import Bezier, FullState, Hold, PIDInversion, RigidBodyPlant, Robot, Step, Target, simulate
from armgpi.errors import ArmgpiError, ArrayError, EffortError, ParameterError

Array = npt.NDArray[np.float64]

DT = 1e-3
ARM = Robot.load("anthropomorphic3")


def still(q: Array) -> Target:
    """Return the target of standing at q."""
    return Target(q, np.zeros_like(q), np.zeros_like(q))


def error_dynamics(kp: float, ki: float, kd: float, e0: float, t: Array) -> Array:
    """Return e(t) of e'' + Kd e' + Kp e + Ki int(e) = 0 from e0 at rest."""
    # States int(e), e, e'.
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-ki, -kp, -kd]])
    return np.array([(expm(A * x) @ [0.0, e0, 0.0])[1] for x in t])


def test_with_an_exact_model_a_moving_arm_follows_the_linear_error_dynamics_at_first_order() -> None:
    # Sample and hold delay the loop by half a sample: the error halves with dt. Loads are off, and the
    # nonlinear arm moves all the while; what is compared is the way from an error of 0.1 rad to none.
    kp, ki, kd = 100.0, 150.0, 20.0
    start, goal, e0 = np.array([0.2, 0.3, -0.4]), np.array([1.0, 0.8, -0.9]), 0.1
    steps = np.array([8e-3, 4e-3, 2e-3, 1e-3])
    errors = []
    for dt in steps:
        rollout = simulate(
            RigidBodyPlant(ARM),
            PIDInversion(ARM, dt, kp, ki, kd, effort=1e6),
            Bezier(start, goal, duration=1.0),
            1.0,
            q0=start + e0,
        )
        e = (rollout["q"] - rollout["q_ref"]).values
        expected = error_dynamics(kp, ki, kd, e0, rollout["time"].values)
        errors.append(np.abs(e - expected[:, None]).max())
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.15)
    assert errors[-1] < 0.01 * e0


@given(robots_and_states(max_joints=5), st.integers(0, 100))
def test_the_torque_is_equation_32_on_any_robot(drawn: tuple[Robot, State], seed: int) -> None:
    robot, (q, v, a) = drawn
    rng = np.random.default_rng(seed)
    kp, ki, kd = rng.uniform(1.0, 400.0, (3, robot.n))
    controller = PIDInversion(robot, DT, kp, ki, kd, effort=1e12)
    e, slip = 1e-2 * rng.normal(size=(2, robot.n))
    target = Target(q - e, v - slip, a)
    state = controller.init(FullState(q, v), target)
    for sample in range(3):
        tau, state = controller.step(FullState(q, v), target, state)
        integral = e * DT * (sample + 0.5)  # trapezoidal rule over a constant error
        u = kp * e + ki * integral + kd * slip  # eq. 33
        expected = robot.mass_matrix(q) @ (a - u) + robot.nonlinear_effects(q, v)  # eq. 32
        np.testing.assert_allclose(tau, expected, rtol=0.0, atol=1e-11 * (1.0 + np.abs(expected).max()))


def test_the_bias_robot_is_what_coriolis_and_gravity_come_from() -> None:
    # Tables 3 and 4 vary D alone: D times 0.8, C and G as they are.
    q, v, a = np.array([[0.1, 0.4, -0.7], [1.0, -0.5, 0.3], [0.2, 0.0, -2.0]])
    controller = PIDInversion(ARM.scaled_inertia(0.8), DT, effort=1e6, bias_robot=ARM)
    measured, target = FullState(q, v), Target(q, v, a)
    tau, _ = controller.step(measured, target, controller.init(measured, target))
    expected = 0.8 * ARM.mass_matrix(q) @ a + ARM.nonlinear_effects(q, v)
    np.testing.assert_allclose(tau, expected, atol=1e-12)


def test_a_bias_robot_that_is_the_robot_itself_changes_nothing() -> None:
    q = np.array([0.1, 0.4, -0.7])
    measured, target = FullState(q, 2.0 * q), still(q - 0.1)
    twin = Robot.load("anthropomorphic3")
    torques = []
    for bias in (None, ARM, twin):
        controller = PIDInversion(ARM, DT, bias_robot=bias)
        torques.append(controller.step(measured, target, controller.init(measured, target)).tau)
    np.testing.assert_array_equal(torques[0], torques[1])
    np.testing.assert_allclose(torques[0], torques[2], atol=1e-12)


def test_a_constant_load_leaves_no_error_with_an_integral_and_the_stated_one_without() -> None:
    rail, push = sled(), Step(2.0)
    kp, kd = 100.0, 20.0
    final = {
        ki: simulate(RigidBodyPlant(rail, push), PIDInversion(rail, DT, kp, ki, kd), Hold([0.0]), 8.0)["q"][
            -1
        ]
        for ki in (0.0, 200.0)
    }
    assert float(final[0.0][0]) == pytest.approx(-2.0 / kp, rel=1e-9)
    assert abs(float(final[200.0][0])) < 1e-6


@pytest.mark.parametrize("joints", [1, 2])
def test_a_step_far_beyond_the_torque_limit_settles_without_a_limit_cycle(joints: int) -> None:
    # 1 rad on a level arm with 3 % of the torque that the law asks for. An integral that knew nothing of
    # the limit would wind up and drive the arm away for good.
    arm = swing(joints, axis="0 0 1")
    kp, ki, kd = 400.0, 2000.0, 40.0
    effort = 0.03 * arm.mass_matrix(np.zeros(joints)) @ np.full(joints, kp)
    controller = PIDInversion(arm, DT, kp, ki, kd, effort=effort)
    rollout = simulate(RigidBodyPlant(arm), controller, Hold(np.ones(joints)), 10.0, q0=np.zeros(joints))
    e = (rollout["q"] - 1.0).values
    assert (np.abs(rollout["tau"].values) <= effort).all()
    assert np.abs(e[-1000:]).max() < 1e-6


@settings(max_examples=50)
@given(robots_and_states(max_joints=6), st.floats(1.0, 1e4))
def test_the_torque_never_exceeds_the_limits_on_any_robot(drawn: tuple[Robot, State], kp: float) -> None:
    robot, (q, v, a) = drawn
    controller = PIDInversion(robot, DT, kp=kp)
    measured, target = FullState(q, v), Target(np.zeros_like(q), np.zeros_like(q), a)
    state = controller.init(measured, target)
    for _ in range(5):
        tau, state = controller.step(measured, target, state)
        assert (np.abs(tau) <= robot.limits.effort).all()


@pytest.mark.parametrize("kp", [0.0, 1e-3, 1e-300])
def test_a_long_saturation_leaves_the_integral_finite_whatever_the_gains(kp: float) -> None:
    rail = sled()
    controller = PIDInversion(rail, DT, kp=kp, ki=500.0, kd=40.0, effort=1e-3)
    measured, target = FullState(np.ones(1), np.zeros(1)), still(np.zeros(1))
    state = controller.init(measured, target)
    for _ in range(1000):
        tau, state = controller.step(measured, target, state)
    assert tau == -1e-3
    assert np.isfinite(state.integral).all()


def test_a_batch_is_the_same_controllers_one_by_one() -> None:
    kp = np.array([[100.0, 200.0, 300.0], [400.0, 50.0, 10.0]])
    effort = np.array([[1.0], [30.0]])
    reference = Bezier(np.zeros(3), np.ones(3), duration=0.2)
    plant = RigidBodyPlant(ARM)
    together = simulate(plant, PIDInversion(ARM, DT, kp, effort=effort), reference, 0.3)
    for row in range(2):
        alone = simulate(plant, PIDInversion(ARM, DT, kp[row], effort=effort[row]), reference, 0.3)
        np.testing.assert_array_equal(together["q"][row], alone["q"])
        np.testing.assert_array_equal(together["tau"][row], alone["tau"])


def test_it_says_that_it_needs_velocity() -> None:
    assert PIDInversion.measurement_type is FullState


def test_a_rollout_can_tell_what_controlled_it() -> None:
    told = json.loads(json.dumps(PIDInversion(ARM, DT, bias_robot=ARM.scaled_inertia(0.5)).describe()))
    assert told["controller"] == "PIDInversion"
    assert told["kp"] == [400.0] * 3
    assert told["bias_robot"]["changes"] == [{"inertia_scale": 0.5}]


@pytest.mark.parametrize(
    ("options", "error", "named"),
    [
        ({"dt": 0.0}, ParameterError, "dt"),
        ({"kp": -1.0}, ArrayError, "kp"),
        ({"ki": [1.0, -2.0, 0.0]}, ArrayError, "ki.*q2"),
        ({"kd": np.nan}, ArrayError, "kd"),
        ({"kp": [1.0, 2.0]}, ArrayError, "kp"),
        ({"effort": 0.0}, ArrayError, "effort"),
        ({"robot": ARM.with_limits(effort=0.0)}, EffortError, "q1"),
        ({"kp": np.ones((2, 3)), "kd": np.ones((3, 3))}, ParameterError, "batch"),
        ({"bias_robot": swing(2)}, ParameterError, "bias_robot"),
    ],
)
def test_a_bad_parameter_is_named(options: dict[str, Any], error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        PIDInversion(**{"robot": ARM, "dt": DT, **options})
