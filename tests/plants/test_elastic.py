"""Gears that twist: closed forms of one joint, MuJoCo on the same arm, and the rigid arm in the limit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from machines import sled
from scipy.linalg import expm

from armgpi import (
    GPI,
    Bezier,
    Delayed,
    ElasticPlant,
    Encoder,
    FixedGains,
    Friction,
    Hold,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Step,
    config,
    prepare,
    simulate,
)
from armgpi.errors import ArrayError, ConfigError
from armgpi.plants.elastic import ElasticState, sag
from armgpi.robot.kinematics import random_configurations
from armgpi.tuning import two_mass

Array = npt.NDArray[np.float64]

UR5 = Robot.load("ur5").with_armature([1.2, 1.2, 0.8, 0.2, 0.2, 0.2])
#: Stiffness of its gears [N m/rad]: assumed, of typical size.
STIFF = np.array([20e3, 20e3, 15e3, 5e3, 5e3, 5e3])
START = UR5.middle() + 0.3
MASS, ROTOR, K, B = 2.0, 0.5, 3e3, 4.0
ARM = Robot.load("anthropomorphic3").with_armature([0.3, 0.3, 0.1])


def steps(plant: Any, q: Array, tau: Any, count: int, dt: float = 1e-3) -> Any:
    """Return the state after so many steps from rest under tau(time), held."""
    state = plant.init(q, 0.0 * q)
    for k in range(count):
        state = plant.step(tau(k * dt), state, dt)
    return state


def one_joint(time: float, rate: float) -> Array:
    """Return (q, theta, v, omega) of a level slide from rest under 1 N, from its linear equations."""
    c, d = 3.0, 2.0  # viscous friction of the link, of the motor
    A = np.zeros((6, 6))  # q, theta, v, omega, the motor's force, the force asked for
    A[0, 2] = A[1, 3] = 1.0
    A[2, :4] = np.array([-K, K, -B - c, B]) / MASS
    A[3, :5] = np.array([K, -K, B, -B - d, 1.0]) / ROTOR
    A[4, 4], A[4, 5] = -rate, rate
    found: Array = (expm(time * A) @ [0.0, 0.0, 0.0, 0.0, 0.0, 1.0])[:4]
    return found


def test_one_joint_is_the_linear_one_to_order_two_without_friction_and_one_with() -> None:
    time, rate = 0.1, 2.0 * math.pi * 80.0
    exact = one_joint(time, rate)
    robot = sled(MASS).with_armature(ROTOR)
    errors = []
    for count in (200, 400, 800):
        plant = ElasticPlant(
            robot, (), Friction(2.0, 0.0), gear_stiffness=K, gear_damping=B, current_bandwidth=80.0,
            link_viscous=3.0,
        )  # fmt: skip
        state = steps(plant, np.zeros(1), lambda t: np.ones(1), count, time / count)
        errors.append(np.abs(np.concatenate(state[1:5])[[0, 2, 1, 3]] - exact).max() / np.abs(exact).max())
    # Friction follows the step, as in the rigid plant: order 1.
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(1.0, abs=0.1)
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("place", [0.03, 0.17])
def test_ripple_and_cogging_push_where_their_wave_is_positive(place: float) -> None:
    waves: dict[str, float] = {"torque_ripple": 0.1, "cogging": 0.3, "ripple_period": 0.2}
    plant = ElasticPlant(sled(MASS).with_armature(ROTOR), gear_stiffness=K, current_bandwidth=1e9, **waves)
    state = steps(plant, np.array([place]), lambda t: 2.0 * np.ones(1), 1, 1e-6)
    push = 2.0 + (0.1 * 2.0 + 0.3) * math.sin(2.0 * math.pi * place / 0.2)
    assert state.omega == pytest.approx(1e-6 * push / ROTOR, rel=1e-3)  # the motor lags by 1e-3 of it


def test_what_pushes_a_link_and_what_its_motor_gives_change_the_momentum_of_both() -> None:
    robot, load = sled(MASS).with_armature(ROTOR), Step(0.7)
    plant = ElasticPlant(robot, (load,), gear_stiffness=K, gear_damping=B, current_bandwidth=1e9)
    state = steps(plant, np.zeros(1), lambda t: 2.0 * np.ones(1), 100)
    momentum = float(MASS * state.v[0] + ROTOR * state.omega[0])
    assert momentum == pytest.approx(0.1 * (2.0 - 0.7), rel=1e-6)


def test_a_substep_is_the_step_of_rosenbrock_by_dense_matrices() -> None:
    """ROS2 (Verwer et al. 1999) with links and motors in one system, and viscous friction after it."""
    rng, n, h = np.random.default_rng(7), 3, 0.5e-3
    stiff, damping, load = (
        np.array([900.0, 1500.0, 700.0]),
        np.array([3.0, 5.0, 2.0]),
        np.array([0.7, -0.4, 0.2]),
    )
    visc_links, visc_motors, rate = np.array([0.9, 0.4, 0.2]), np.array([0.3, 0.6, 0.5]), 2.0 * math.pi * 60.0
    plant = ElasticPlant(
        ARM, (Step(load),), Friction(visc_motors, 0.0), gear_stiffness=stiff, gear_damping=damping,
        current_bandwidth=60.0, link_viscous=visc_links, torque_ripple=0.2, cogging=0.5, ripple_period=0.3,
        substeps=2,
    )  # fmt: skip
    q, v, theta, omega = rng.uniform(-0.5, 0.5, n), *rng.normal(size=(3, n))
    theta, motor, tau = q + 0.02 * theta, np.array([4.0, -3.0, 2.0]), np.array([6.0, 5.0, -1.0])
    after = plant.step(tau, ElasticState(0, q, v, theta, omega, motor, tau), 2.0 * h)
    rotor, zero, one = np.diag(ARM.armature), np.zeros((n, n)), np.eye(n)
    K, B, gamma = np.diag(stiff), np.diag(damping), 1.0 - math.sqrt(0.5)
    for _ in range(2):
        links = ARM.mass_matrix(q + 0.5 * h * v) - rotor
        masses = np.linalg.inv(np.block([[links, zero], [zero, rotor]]))
        springs = np.block([[-K, K, -B, B], [K, -K, B, -B]])
        A = np.vstack([np.block([[zero, zero, one, zero], [zero, zero, zero, one]]), masses @ springs])
        mean = tau + (motor - tau) * (1.0 - math.exp(-rate * h)) / (rate * h)
        motor = tau + (motor - tau) * math.exp(-rate * h)

        def slope(x: Array, mean: Array = mean, masses: Array = masses, springs: Array = springs) -> Array:
            at, speed = x[:n], x[2 * n : 3 * n]
            waves = (0.2 * mean + 0.5) * np.sin(2.0 * math.pi * x[n : 2 * n] / 0.3)
            forces = np.concatenate([-ARM.nonlinear_effects(at, speed) - load, mean + waves])
            return np.concatenate([x[2 * n :], masses @ (springs @ x + forces)])

        x, left = np.concatenate([q, theta, v, omega]), np.eye(4 * n) - gamma * h * A
        k1 = np.linalg.solve(left, slope(x))
        k2 = np.linalg.solve(left, slope(x + h * k1) - 2.0 * k1)
        x = x + 1.5 * h * k1 + 0.5 * h * k2
        # Friction and what it stretches, of which half a step's way is implicit.
        rubs = np.diag(np.concatenate([visc_links, visc_motors]))
        tied = h * (0.5 * h * K + B)
        held = np.block([[links + tied, -tied], [-tied, rotor + tied]]) + h * rubs
        change = np.linalg.solve(held, -h * rubs @ x[2 * n :])
        q, theta, v, omega = np.split(x + np.concatenate([0.5 * h * change, change]), 4)
    for own, other in zip(after[1:6], (q, v, theta, omega, motor), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-9)


def test_what_nothing_tells_of_arms_together_is_that_of_the_first() -> None:
    arms = RobotBatch([ARM, ARM.scaled_inertia(2.0).with_armature(ARM.armature)])
    both, alone = (ElasticPlant(robot, gear_stiffness=K) for robot in (arms, ARM))
    np.testing.assert_allclose(
        both.gear_damping, np.broadcast_to(alone.gear_damping, both.gear_damping.shape)
    )


def test_a_substep_is_of_order_two() -> None:
    def end(substeps: int) -> Array:
        plant = ElasticPlant(UR5, gear_stiffness=STIFF, current_bandwidth=500.0, substeps=substeps)
        push = 10.0 * UR5.armature
        state = steps(plant, START, lambda t: UR5.gravity(START) + push * (t < 0.05), 150)
        return np.concatenate(state[1:5])

    exact = end(64)
    errors = [np.abs(end(substeps) - exact).max() for substeps in (2, 4, 8)]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(2.0, abs=0.15)


def test_it_is_the_rigid_arm_with_rotors_in_the_limit_by_one_over_the_stiffness() -> None:
    def tau(t: float) -> Array:
        return np.asarray(UR5.gravity(START) + UR5.armature * 20.0 * math.sin(20.0 * t))

    rigid = steps(RigidBodyPlant(UR5), START, tau, 300)
    apart = []
    for factor in (1.0, 10.0, 100.0):
        state = steps(ElasticPlant(UR5, gear_stiffness=factor * STIFF), START, tau, 300)
        apart.append(max(np.abs(state.q - rigid.q).max(), np.abs(state.theta - rigid.q).max()))
    assert np.log10(np.divide(apart[:-1], apart[1:])) == pytest.approx(1.0, abs=0.02)
    # Beyond, what is left is the method's own error at this sample time.
    far = steps(ElasticPlant(UR5, gear_stiffness=1e7 * STIFF), START, tau, 300)
    assert np.abs(far.q - rigid.q).max() < 2e-5 * np.abs(rigid.q - START).max()


def test_with_friction_at_both_ends_it_is_the_rigid_arm_with_the_sum_in_the_limit() -> None:
    def tau(t: float) -> Array:
        return np.asarray(UR5.gravity(START) + 15.0 * np.sin(10.0 * t) * np.ones(6))

    plant = ElasticPlant(
        UR5, (), Friction(2.0, 5.0), gear_stiffness=1e4 * STIFF, link_viscous=1.0, link_coulomb=2.0
    )
    rigid = steps(RigidBodyPlant(UR5, (), Friction(3.0, 7.0)), START, tau, 400)
    stiff = steps(plant, START, tau, 400)
    moved = np.abs(rigid.q - START).max()
    assert moved > 0.01
    assert np.abs(stiff.q - rigid.q).max() < 1e-3 * moved


def test_about_rest_it_is_the_linear_plant_of_the_two_mass_loop() -> None:
    dt, n, ratio = 1e-3, UR5.n, 0.05
    link = np.diag(UR5.mass_matrix(START)) - UR5.armature
    damping = 2.0 * ratio * np.sqrt(STIFF * link * UR5.armature / (link + UR5.armature))
    gears = two_mass.Gears(UR5.armature, STIFF, ratio, 300.0)
    A, B, _ = two_mass.plant(UR5, START, gears, dt)
    plant = ElasticPlant(
        UR5,
        gear_stiffness=STIFF,
        gear_damping=damping,
        current_bandwidth=300.0,
        encoder_side="link",
        substeps=40,
    )
    rest = plant.init(START, np.zeros(n))
    hold, size = UR5.gravity(START), np.repeat([1e-6, 1e-6, 1e-6, 1e-6, 1e-2, 1e-2], n)

    def after(i: int, sign: float) -> Array:
        """Return (q, theta, v, omega, motor) after a sample in which one of them, or a torque, is off."""
        off = sign * size[i] * np.eye(6 * n)[i].reshape(6, n)
        state = ElasticState(
            0, rest.q + off[0], off[2], rest.theta + off[1], off[3], hold + off[4], np.zeros(n)
        )
        _, q, v, theta, omega, motor, _ = plant.step(hold + off[5], state, dt)
        return np.concatenate([q, theta, v, omega, motor])

    columns = [(after(i, 1.0) - after(i, -1.0)) / (2.0 * size[i]) for i in range(6 * n)]
    found = np.array(columns).T
    for exact, given in ((A, found[:, : 5 * n]), (B, found[:, 5 * n :])):
        # Velocities per position are the largest; the rest is the method's error at a fortieth of a sample.
        scale = np.abs(exact).max(axis=1, keepdims=True)
        np.testing.assert_allclose(given / scale, exact / scale, rtol=0.0, atol=2e-3)


MJCF = """
<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81" timestep="2e-5" integrator="RK4"/><worldbody>
<body name="one"><joint name="j1" axis="0 1 0" armature="0.4"/>{twist1}
  <inertial pos="0.2 0.02 0" mass="3" diaginertia="0.02 0.05 0.05"/>
  <body name="two" pos="0.5 0 0"><joint name="j2" axis="0 0 1" armature="0.2"/>{twist2}
    <inertial pos="0.1 0 0.05" mass="1.5" diaginertia="0.01 0.02 0.02"/>
    <body name="three" pos="0.3 0 0.1"><joint name="j3" axis="0 1 0" armature="0.1"/>{twist3}
      <inertial pos="0.05 0 0.01" mass="0.3" diaginertia="1e-3 1e-3 2e-3"/></body></body></body>
</worldbody><actuator><motor joint="j1"/><motor joint="j2"/><motor joint="j3"/></actuator></mujoco>
"""
AXES, STIFFNESS, DAMPING = ("0 1 0", "0 0 1", "0 1 0"), (2e3, 1.5e3, 600.0), (3.0, 2.0, 0.5)


def test_mujoco_goes_the_same_way_with_a_second_joint_for_each_gear(tmp_path: Any) -> None:
    mujoco = pytest.importorskip("mujoco")
    gears = zip(AXES, STIFFNESS, DAMPING, strict=True)
    joints = [f'<joint axis="{axis}" stiffness="{K}" damping="{B}"/>' for axis, K, B in gears]
    twists = {f"twist{i + 1}": joint for i, joint in enumerate(joints)}
    model = mujoco.MjModel.from_xml_string(MJCF.format(**twists))  # joints: motor, twist, motor, twist ...
    data = mujoco.MjData(model)
    (tmp_path / "arm.xml").write_text(MJCF.format(twist1="", twist2="", twist3=""))
    arm = Robot.load(tmp_path / "arm.xml")
    plant = ElasticPlant(arm, gear_stiffness=STIFFNESS, gear_damping=DAMPING)
    state = plant.init(np.array([-0.4, 0.3, 0.5]), np.zeros(3))
    data.qpos[0::2], data.qpos[1::2] = state.theta, state.q - state.theta
    for k in range(200):
        tau = arm.gravity(state.q) + np.array([8.0, 4.0, 1.0]) * math.sin(0.05 * k)
        data.ctrl[:] = tau
        for _ in range(50):
            mujoco.mj_step(model, data)
        state = plant.step(tau, state, 1e-3)
    np.testing.assert_allclose(state.theta, data.qpos[0::2], rtol=0.0, atol=2e-5)
    np.testing.assert_allclose(state.q, data.qpos[0::2] + data.qpos[1::2], rtol=0.0, atol=2e-5)
    assert np.abs(data.qpos[1::2]).max() > 2e-3  # twist: a hundred times of what they may differ by
    assert np.abs(state.q - [-0.4, 0.3, 0.5]).max() > 0.02


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1.0, 1e3, 1e9])
@pytest.mark.parametrize("name", ["so101", "ur5"])
def test_no_stiffness_and_no_light_link_gives_energy(name: str, factor: float) -> None:
    lock = ["gripper"] if name == "so101" else []
    robot = Robot.load(name, lock).with_armature(0.02).with_gravity([0.0, 0.0, 0.0])
    random = np.random.default_rng(1)
    plant = ElasticPlant(robot, gear_stiffness=factor * 1e3, gear_damping=0.0)
    q = robot.middle()
    state = plant.init(q, 0.3 * random.normal(size=robot.n))
    state = state._replace(theta=q + 1e-3 * random.normal(size=robot.n) / math.sqrt(factor))

    def energy(state: ElasticState) -> float:
        links = robot.mass_matrix(state.q) - np.diag(robot.armature)
        twist = state.theta - state.q
        parts = (state.v @ links @ state.v, robot.armature @ state.omega**2, plant.gear_stiffness @ twist**2)
        return float(0.5 * sum(parts))

    first = most = energy(state)
    for _ in range(1000):
        state = plant.step(np.zeros(robot.n), state, 1e-3)
        most = max(most, energy(state))
    # Order 2 in the motion of the links; what the springs hold is only taken away.
    assert most <= 1.01 * first


def test_an_arm_that_friction_holds_stays_as_a_rigid_one_does() -> None:
    plant = ElasticPlant(UR5, (), Friction(0.0, 5.0), gear_stiffness=STIFF)
    rigid = RigidBodyPlant(UR5, (), Friction(0.0, 5.0))

    def tau(t: float) -> Array:
        return UR5.gravity(START) + 3.0

    begun, ended = ([steps(each, START, tau, count).q for each in (plant, rigid)] for count in (0, 300))
    crept, expected = np.subtract(ended, begun)
    # Both creep as friction is smoothed: at 0.75 mm/s here.
    assert np.abs(crept).max() < 1.1 * np.abs(expected).max()


@pytest.mark.parametrize("stick", [1e-3, 2e-2])
def test_below_the_stick_velocity_an_arm_creeps_as_fast_as_its_friction_says(stick: float) -> None:
    """Where friction f v / sqrt(v^2 + stick^2) holds half of it, v is stick times 0.5 / sqrt(0.75)."""
    plant = ElasticPlant(
        sled().with_armature(0.5), gear_stiffness=1e4, friction=Friction(0.0, 2.0), stick_velocity=stick
    )
    state = steps(plant, np.zeros(1), lambda _: np.ones(1), 2000)
    assert float(state.omega[0]) == pytest.approx(stick * 0.5 / math.sqrt(0.75), rel=1e-3)


def loop(plant: Any, backend: str) -> Any:
    """Return a rollout of a move of 0.2 rad."""
    start = ARM.middle()
    law = GPI(ARM, 1e-3, gains=FixedGains(8.0, 1.0, 8.0))
    return simulate(plant, law, Bezier(start, start + 0.2, 0.2), 0.3, progress=False, backend=backend)


def test_generated_code_is_the_same_alone_and_where_all_varies() -> None:
    parts: dict[str, Any] = {
        "loads": (Step(0.5, 0.1),),
        "friction": Friction(2.0, 1.0),
        "link_coulomb": 1.0,
        "torque_ripple": 0.01,
        "cogging": 0.2,
        "current_bandwidth": 300.0,
        "stick_velocity": 5e-3,
    }
    alone = ElasticPlant(ARM, gear_stiffness=3e3, **parts)
    factors = np.linspace(0.5, 2.0, 3)
    varied = ARM.varied(rotor_inertia=np.outer(factors, ARM.armature))
    several = ElasticPlant(varied, gear_stiffness=3e3 * factors[:, None], **parts)
    for plant in (Delayed(Encoder(alone, 18), 1), several):
        by_numpy, compiled = (loop(plant, backend) for backend in ("numpy", "compiled"))
        for name in ("q", "tau"):
            np.testing.assert_allclose(compiled[name], by_numpy[name], rtol=0.0, atol=1e-9)
    first = ElasticPlant(ARM.with_armature(0.5 * ARM.armature), gear_stiffness=1.5e3, **parts)
    np.testing.assert_allclose(loop(first, "numpy").q, by_numpy.q[0], rtol=0.0, atol=1e-9)


def test_its_numbers_are_given_anew_by_name() -> None:
    plant = ElasticPlant(UR5, gear_stiffness=STIFF)
    law = GPI(UR5, 1e-3, gains=FixedGains(8.0, 1.0, 8.0))
    prepared = prepare(plant, law, Hold(START), 0.05, backend="numpy")
    values = {"plant.gear_stiffness": np.array([STIFF, 2.0 * STIFF]), "plant.cogging": np.array([0.0, 0.5])}
    result = prepared.run(values)
    assert result.sizes["rollout"] == 2
    assert not np.array_equal(result.q[0], result.q[1])


@pytest.mark.parametrize("side", ["motor", "link"])
def test_it_begins_at_rest_where_its_encoders_say(side: str) -> None:
    drives = {joint: {"stiffness": 4e3, "encoder_side": side} for joint in UR5.joint_names}
    plant = ElasticPlant(UR5.with_drives(drives))
    state = plant.init(START, np.zeros(6))
    np.testing.assert_array_equal(plant.measure(state).q, START)
    gravity = UR5.gravity(state.q)
    np.testing.assert_allclose(state.theta - state.q, gravity / 4e3, atol=1e-14)
    after = plant.step(gravity, state, 1e-3)
    np.testing.assert_allclose(np.concatenate(after[1:5]), np.concatenate(state[1:5]), atol=1e-13)


def test_the_sag_is_how_far_the_tip_moves_by_gravity_over_stiffness() -> None:
    robot = UR5.with_drives({joint: {"stiffness": 1e4} for joint in UR5.joint_names})
    q = random_configurations(UR5, 200, seed=0)
    there, sunk = (UR5.frame_pose(UR5.tip, each).translation for each in (q, q + UR5.gravity(q) / 1e4))
    most = 1e3 * np.linalg.norm(there - sunk, axis=1).max()
    assert f"{most:.2g} mm largest" in sag(robot)
    assert sag(UR5) == sag(robot.with_gravity((0.0, 0.0, 0.0))) == ""
    at_links = robot.with_drives({joint: {"encoder_side": "link"} for joint in UR5.joint_names})
    assert sag(at_links) == ElasticPlant(at_links).sag == ""
    assert ElasticPlant(robot).sag == sag(robot)


def built(data: dict[str, Any]) -> config.Experiment:
    """Return an experiment from plain data."""
    return config.build(*config.parse(yaml.safe_dump(data), "file.yaml"))


def test_an_experiment_file_has_it_and_refuses_what_it_lacks() -> None:
    rotors = dict(zip(UR5.joint_names, UR5.armature.tolist(), strict=True))
    data: dict[str, Any] = {
        "robot": {"name": "ur5", "rotor_inertia": rotors},
        "plant": {"engine": "elastic", "gear_stiffness": 1e4, "drives": {"elbow_joint": {"damping": 9.0}}},
        "controllers": [{"type": "gpi", "omega": 8.0}],
        "t_final": 0.01,
    }
    (plant,) = built(data).plants.values()
    described = plant.describe()
    assert (described["plant"], described["gear_stiffness"]) == ("ElasticPlant", [1e4] * 6)
    assert described["gear_damping"][2] == 9.0
    # 3 % of the joint's own mode.
    link = UR5.mass_matrix(UR5.middle())[0, 0] - 1.2
    usual = 0.06 * math.sqrt(1e4 * link * 1.2 / (link + 1.2))
    assert described["gear_damping"][0] == pytest.approx(usual)
    with pytest.raises(ConfigError, match=r"shoulder_pan_joint\.gear_stiffness.*--drives"):
        built({**data, "plant": {"engine": "elastic"}})
    with pytest.raises(ConfigError, match=r"shoulder_pan_joint\.rotor_inertia"):
        built({**data, "robot": {"name": "ur5"}})
    with pytest.raises(ConfigError, match="requires engine: elastic"):
        built({**data, "plant": {"cogging": 1.0}})
    with pytest.raises(ArrayError, match="gear_stiffness"):
        ElasticPlant(UR5, gear_stiffness=-1.0)
