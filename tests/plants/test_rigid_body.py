"""The rigid arm: its integrator's order, its energy, and MuJoCo on the same URDF."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machines import sled, swing
from scipy.integrate import solve_ivp
from scipy.optimize import root
from strategies import State, robots_and_states, states, urdf_texts

from armgpi import Friction, RigidBodyPlant, Robot, RobotBatch, Sine, Step
from armgpi.errors import ArmgpiError, ParameterError
from armgpi.plants.plant import PlantState
from armgpi.robot.robots import locate

Array = npt.NDArray[np.float64]

ARM = Robot.load("anthropomorphic3")


def run(
    plant: RigidBodyPlant, q: Array, v: Array, samples: int, dt: float, tau: Array | None = None
) -> PlantState:
    """Return the state after so many samples of a held torque."""
    state = plant.init(q, v)
    for _ in range(samples):
        state = plant.step(np.zeros_like(q) if tau is None else tau, state, dt)
    return state


def order(steps: Array, errors: Array) -> float:
    """Return the slope of log(error) over log(step)."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def energy(robot: Robot) -> Callable[[Array, Array], float]:
    """Return the function of kinetic and potential energy, by Pinocchio [J]."""
    model = robot.pinocchio_model()
    data = model.createData()
    return lambda q, v: float(pin.computeMechanicalEnergy(model, data, q, v))


@pytest.mark.parametrize("sticks", [False, True])
def test_a_step_is_runge_kuttas_under_its_loads_and_then_its_frictions_balance(sticks: bool) -> None:
    rng, dt, k = np.random.default_rng(3), 4e-3, 300  # beyond the samples whose loads are worked out at once
    q, v, tau = rng.normal(size=(3, 2, 3))
    loads = Sine(rng.normal(size=(2, 3)), 40.0, 0.3), Step([3.0, -2.0, 1.0], onset=k * dt + dt / 2)
    viscous, coulomb = rng.uniform(0.1, 0.5, (2, 3)), rng.uniform(0.1, 0.9, (2, 3)) * sticks
    options: Any = {"substeps": 2, "stick_velocity": 0.2}
    found = RigidBodyPlant(ARM, loads, Friction(viscous, coulomb), **options).step(
        tau, PlantState(k, q, v, 0.0 * q), dt
    )

    def moves(t: float, x: Array, y: Array) -> tuple[Array, Array]:
        late = (
            t - 1e-9 if abs(t - k * dt - dt / 2) < 1e-12 and t > begin else t
        )  # what sets in there comes then
        push = np.sum([each.torque(np.array([late])) * np.ones((2, 3)) for each in loads], axis=0)
        return y, ARM.forward_dynamics(x, y, tau - push)

    h = dt / 2
    for begin in (k * dt, k * dt + h):
        a = moves(begin, q, v)
        b = moves(begin + h / 2, q + h / 2 * a[0], v + h / 2 * a[1])
        c = moves(begin + h / 2, q + h / 2 * b[0], v + h / 2 * b[1])
        d = moves(begin + h, q + h * c[0], v + h * c[1])
        free_q, free_v = (x + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]) for i, x in enumerate((q, v)))

        inertia = ARM.mass_matrix(q)

        def lacks(x: Array, D: Array = inertia, free: Array = free_v) -> Array:
            x = x.reshape(2, 3)
            rubs = viscous * x + coulomb * x / np.sqrt(x * x + 0.04)
            return np.asarray((np.einsum("kij,kj->ki", D, x - free) + h * rubs).ravel())

        v = root(lacks, free_v.ravel(), tol=1e-14).x.reshape(2, 3)
        q = free_q + h / 2 * (v - free_v)
    np.testing.assert_allclose(found.q, q, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(found.v, v, rtol=1e-7, atol=1e-8)
    assert found.k == k + 1
    np.testing.assert_array_equal(found.tau, tau)


@pytest.mark.parametrize("substeps", [1, 3])
def test_a_driven_pendulum_is_integrated_at_order_four(substeps: int) -> None:
    # A rod of 1 kg and 1 m about its end has 1/3 kg m^2; its weight acts at half its length.
    def motion(t: float, x: Array) -> list[float]:
        return [x[1], 3.0 * (2.0 - 9.81 * 0.5 * math.cos(x[0]))]

    exact = solve_ivp(motion, (0.0, 1.0), [0.5, 1.0], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    plant, counts = RigidBodyPlant(swing(), substeps=substeps), np.array([20, 40, 80, 160])
    ends = [run(plant, np.array([0.5]), np.array([1.0]), n, 1.0 / n, np.array([2.0])) for n in counts]
    errors = [np.hypot(end.q[0] - exact[0], end.v[0] - exact[1]) for end in ends]
    assert order(1.0 / counts, np.array(errors)) == pytest.approx(4.0, abs=0.2)


def test_an_arm_is_integrated_at_order_four() -> None:
    q, v, tau = np.array([[0.3, 0.5, -0.8], [1.0, -0.5, 2.0], [0.5, 3.0, 1.0]])

    def motion(t: float, x: Array) -> Array:
        bias = ARM.nonlinear_effects(x[:3], x[3:])
        return np.append(x[3:], np.linalg.solve(ARM.mass_matrix(x[:3]), tau - bias))

    exact = solve_ivp(motion, (0.0, 0.2), [*q, *v], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    counts = np.array([20, 40, 80, 160])
    ends = [run(RigidBodyPlant(ARM), q, v, n, 0.2 / n, tau) for n in counts]
    errors = [np.linalg.norm([*end.q, *end.v] - exact) for end in ends]
    assert order(0.2 / counts, np.array(errors)) == pytest.approx(4.0, abs=0.2)


def test_substeps_are_shorter_steps() -> None:
    q, v, tau = np.array([[0.3, 0.5, -0.8], [1.0, -0.5, 2.0], [0.5, 3.0, 1.0]])
    once = run(RigidBodyPlant(ARM, substeps=4), q, v, 10, 4e-3, tau)
    often = run(RigidBodyPlant(ARM), q, v, 40, 1e-3, tau)
    np.testing.assert_array_equal([once.q, once.v], [often.q, often.v])
    assert (once.k, often.k) == (10, 40)


def test_a_free_triple_pendulum_keeps_its_energy_to_order_four() -> None:
    pendulum = swing(3)
    total, q, v = energy(pendulum), np.array([0.5, 0.3, -0.4]), np.array([1.0, -2.0, 0.5])
    counts = np.array([100, 200, 400, 800])
    ends = [run(RigidBodyPlant(pendulum), q, v, n, 1.0 / n) for n in counts]
    drift = np.abs([total(end.q, end.v) - total(q, v) for end in ends])
    assert order(1.0 / counts, drift) > 3.8  # energy is a function of the state: order 4, or luckily more
    assert drift[-1] < 1e-6


@given(robots_and_states(max_joints=6), st.integers(0, 1000))
def test_the_energy_gained_is_the_work_of_the_torque_on_any_robot(
    drawn: tuple[Robot, State], seed: int
) -> None:
    robot, (q, v, a) = drawn
    total, plant, dt = energy(robot), RigidBodyPlant(robot), 1e-4
    rng = np.random.default_rng(seed)
    state, work, size = plant.init(q, v), 0.0, abs(total(q, v)) + abs(total(q, 0.0 * v))
    for _ in range(20):
        # Torques that accelerate the joints moderately, new ones at every sample.
        tau = robot.inverse_dynamics(state.q, state.v, a + rng.normal(size=robot.n))
        after = plant.step(tau, state, dt)
        done = float(tau @ (after.q - state.q))
        work, size, state = work + done, size + abs(done), after
    # At 0.1 ms Runge-Kutta's error is below rounding, of which 8e-15 was the worst of 600 robots.
    assert total(state.q, state.v) - total(q, v) == pytest.approx(work, abs=1e-12 * (1.0 + size))


def mujoco_step(urdf: str, q: Array, v: Array, tau: Array, dt: float, names: tuple[str, ...]) -> Array:
    """Return q and v after one Runge-Kutta step of MuJoCo on a URDF, joints by their names."""
    model = mujoco.MjModel.from_xml_string(urdf)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = dt
    # Bare mechanics: no stops, no contacts, no air, no friction.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    data = mujoco.MjData(model)
    columns = [int(model.joint(name).qposadr[0]) for name in names]
    data.qpos[columns], data.qvel[columns], data.qfrc_applied[columns] = q, v, tau
    mujoco.mj_step(model, data)
    return np.array([data.qpos[columns], data.qvel[columns]])


@given(st.data())
def test_a_step_is_mujocos_on_any_robot(data: st.DataObject) -> None:
    urdf = data.draw(urdf_texts(max_joints=6))
    robot = Robot.from_xml(urdf)
    q, v, a = data.draw(states(robot))
    tau, dt = robot.inverse_dynamics(q, v, a), 1e-3
    after = run(RigidBodyPlant(robot), q, v, 1, dt, tau)
    expected = mujoco_step(urdf, q, v, tau, dt, robot.joint_names)
    # Rounding only, which solving with D may amplify by its condition; 2e-15 was the worst of 600 robots.
    rounding = 1e-14 + 10.0 * np.finfo(float).eps * np.linalg.cond(robot.mass_matrix(q))
    np.testing.assert_allclose([after.q, after.v], expected, rtol=0.0, atol=rounding)


@pytest.mark.parametrize("name", ["ur5", "xarm7", "z1"])
def test_a_step_is_mujocos_on_real_arms(name: str) -> None:
    tree = ElementTree.parse(locate(name)[0]).getroot()
    for link in tree.iter("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)  # meshes, which MuJoCo would look for
    robot = Robot.load(name)
    q = robot.middle() + 0.1
    v, a = np.random.default_rng(1).normal(size=(2, robot.n))
    tau = robot.inverse_dynamics(q, v, a)
    after = run(RigidBodyPlant(robot), q, v, 1, 1e-3, tau)
    urdf = ElementTree.tostring(tree, encoding="unicode")
    expected = mujoco_step(urdf, q, v, tau, 1e-3, robot.joint_names)
    np.testing.assert_allclose([after.q, after.v], expected, rtol=0.0, atol=1e-13)


def test_a_batch_is_the_same_arms_one_by_one() -> None:
    rng = np.random.default_rng(0)
    q, v, tau = rng.normal(size=(3, 20, 3))
    loads = [Sine([0.1, 0.2, 0.3], 4.0)]
    together = run(RigidBodyPlant(ARM, loads), q, v, 10, 1e-3, tau)
    for row in range(20):
        alone = run(RigidBodyPlant(ARM, loads), q[row], v[row], 10, 1e-3, tau[row])
        np.testing.assert_array_equal(together.q[row], alone.q)
        np.testing.assert_array_equal(together.v[row], alone.v)


def test_a_batch_may_be_of_different_arms() -> None:
    arms = [ARM, ARM.with_payload("tool", 0.5), ARM.scaled_inertia(1.2)]
    plant = RigidBodyPlant(RobotBatch(arms))
    assert plant.batch == 3
    q, v, tau = np.random.default_rng(0).normal(size=(3, 3, 3))
    together = run(plant, q, v, 10, 1e-3, tau)
    for row, arm in enumerate(arms):
        alone = run(RigidBodyPlant(arm), q[row], v[row], 10, 1e-3, tau[row])
        np.testing.assert_array_equal([together.q[row], together.v[row]], [alone.q, alone.v])


def test_a_payload_is_felt() -> None:
    # The end of a level rod of 1 kg and 1 m falls with 3/2 g; with a point mass of 1 kg there, with
    # (1/2 + 1) g / (1/3 + 1) = 9/8 g.
    for robot, share in ((swing(), 1.5), (swing().with_payload("link1", 1.0, (1.0, 0.0, 0.0)), 1.125)):
        after = run(RigidBodyPlant(robot), np.zeros(1), np.zeros(1), 1, 1e-5)
        assert after.v[0] == pytest.approx(-share * 9.81 * 1e-5, rel=1e-6)


def test_the_state_tells_sample_and_torque_and_is_left_as_it_was() -> None:
    plant, tau = RigidBodyPlant(ARM), np.array([0.1, 0.2, 0.3])
    first = plant.init(np.zeros(3), np.ones(3))
    second = plant.step(tau, first, 1e-3)
    assert (first.k, second.k) == (0, 1)
    np.testing.assert_array_equal(second.tau, tau)
    np.testing.assert_array_equal([first.q, first.v, first.tau], [np.zeros(3), np.ones(3), np.zeros(3)])
    np.testing.assert_array_equal(plant.step(tau, first, 1e-3).q, second.q)
    assert plant.true_state(second) is second
    np.testing.assert_array_equal(plant.measure(second), [second.q, second.v])


def test_a_rollout_can_tell_what_the_plant_was() -> None:
    told = json.loads(json.dumps(RigidBodyPlant(ARM.with_payload("tool", 0.5), substeps=2).describe()))
    assert told["plant"] == "RigidBodyPlant"
    assert told["robot"]["changes"][0]["payload"]["mass"] == 0.5
    assert told["substeps"] == 2


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"substeps": 0}, "substeps"),
        ({"substeps": 1.5}, "substeps"),
        ({"substeps": True}, "substeps"),
        ({"stick_velocity": 0.0}, "stick_velocity"),
        ({"stick_velocity": math.nan}, "stick_velocity"),
        ({"stick_velocity": "slow"}, "stick_velocity"),
    ],
)
def test_a_bad_parameter_is_named(options: dict[str, Any], named: str) -> None:
    with pytest.raises(ParameterError, match=named):
        RigidBodyPlant(sled(), **options)


def test_arms_for_different_numbers_of_rollouts_are_refused() -> None:
    with pytest.raises(ArmgpiError, match="batch"):
        RigidBodyPlant(RobotBatch([ARM] * 2), Sine(np.ones((3, 3)), 1.0))
