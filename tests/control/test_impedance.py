"""Springs without a velocity sensor: the stiffness that was specified, stable up to the stated limits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

import armgpi
from armgpi import config
from armgpi.control.controller import Measurement
from armgpi.control.elastic_limits import Damping, ElasticLoop, Springs, elastic_joints
from armgpi.control.impedance import rotation_between
from armgpi.control.impedance_limits import _largest, _Loop
from armgpi.errors import ArrayError, NameNotFound, ParameterError
from armgpi.health.compliance import compliance_of
from armgpi.robot.drives import Drives
from armgpi.robot.kinematics import random_configurations

DT = 1e-3
HOMES = {
    "ur5": np.array([0.0, -1.2, 1.6, -1.97, -1.5708, 0.0]),
    "panda": np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.75, 0.8]),
}


def arm_of(name: str) -> armgpi.Robot:
    fingers = ["panda_finger_joint1", "panda_finger_joint2"] if name == "panda" else ()
    return armgpi.Robot.load(name, lock=fingers).with_armature(0.4)


def pushed(law: Any, home: np.ndarray, contact: Any, seconds: float = 2.0) -> Any:
    """Return the tool's pose at the end of a push, by generated code where there is a compiler."""
    arm = law.robot
    plant = armgpi.Delayed(armgpi.RigidBodyPlant(arm, environment=[contact]), 1)
    rollout = armgpi.simulate(plant, law, armgpi.Hold(home), seconds, backend="auto")
    assert rollout["status"] == armgpi.Status.FINISHED
    return arm.frame_pose(arm.tip, rollout["q"].values[-1])


@pytest.mark.parametrize("name", HOMES)
@pytest.mark.parametrize("stiffness", [300.0, 3000.0])
def test_a_push_moves_the_tool_by_force_over_stiffness(name: str, stiffness: float) -> None:
    arm, home = arm_of(name), HOMES[name]
    law = armgpi.CartesianImpedance(arm, DT, stiffness=[stiffness] * 3 + [50.0] * 3, delay=DT)
    force = np.array([6.0, -9.0, 3.0])
    end = pushed(law, home, armgpi.ToolForce(force))
    moved = end.translation - arm.frame_pose(arm.tip, home).translation
    np.testing.assert_allclose(moved, force / stiffness, atol=0.01 * np.linalg.norm(force) / stiffness)


@pytest.mark.parametrize("name", HOMES)
def test_a_moment_turns_the_tool_by_moment_over_stiffness(name: str) -> None:
    arm, home = arm_of(name), HOMES[name]
    law = armgpi.CartesianImpedance(arm, DT, stiffness=[2000.0] * 3 + [20.0, 30.0, 40.0], delay=DT)
    moment = np.array([1.0, -2.0, 1.5])
    end = pushed(law, home, armgpi.ToolForce(moment=moment))
    turned = pin.log3(end.rotation @ arm.frame_pose(arm.tip, home).rotation.T)
    # K r is the moment only to first order in the angle: J' of the logarithm is 1 + r / 2 x ... .
    np.testing.assert_allclose(turned, moment / [20.0, 30.0, 40.0], atol=2e-3)


def test_a_joint_spring_gives_way_by_torque_over_stiffness() -> None:
    arm, home = arm_of("ur5"), HOMES["ur5"]
    stiffness = np.array([300.0, 200.0, 150.0, 80.0, 60.0, 40.0])
    law = armgpi.JointImpedance(arm, DT, stiffness, delay=DT)
    torque = np.array([3.0, -2.0, 1.0, 0.5, 0.5, -0.3])
    plant = armgpi.Delayed(armgpi.RigidBodyPlant(arm, loads=[armgpi.Step(torque)]), 1)
    rollout = armgpi.simulate(plant, law, armgpi.Hold(home), 2.0, backend="auto")
    # A load opposes the motors.
    np.testing.assert_allclose(rollout["q"].values[-1] - home, -torque / stiffness, atol=2e-5)


def test_rotations_are_told_apart_as_by_pinocchio() -> None:
    random = np.random.default_rng(2)
    wished = np.array([pin.exp3(random.normal(size=3)) for _ in range(50)])
    turns = random.normal(size=(50, 3)) * np.geomspace(1e-9, 1.7, 50)[:, None] / math.sqrt(3.0)
    actual = np.array([pin.exp3(turn) @ r for turn, r in zip(turns, wished, strict=True)])
    known = np.array([pin.log3(a @ w.T) for a, w in zip(actual, wished, strict=True)])
    np.testing.assert_allclose(rotation_between(actual, wished), known, atol=1e-8)
    np.testing.assert_array_equal(rotation_between(actual[3], wished[3]), rotation_between(actual, wished)[3])


def test_the_posture_returns_and_does_not_push_the_tool() -> None:
    arm, home = arm_of("panda"), HOMES["panda"]
    law = armgpi.CartesianImpedance(arm, DT, nullspace_stiffness=10.0)
    jacobian = arm.frame_jacobian(arm.tip, home)
    free = np.linalg.svd(jacobian)[2][-1]
    motion = law._motion.at(home, 0.0 * home)
    left = law._in_null_space(motion, 0.1 * free)
    np.testing.assert_allclose(left, 0.1 * free, atol=1e-10)
    # What moves the tool is projected away, but for the damping of the projection.
    moving = jacobian.T @ np.ones(6)
    assert np.linalg.norm(law._in_null_space(motion, moving)) < 1e-2 * np.linalg.norm(moving)
    plant = armgpi.RigidBodyPlant(arm)
    rollout = armgpi.simulate(plant, law, armgpi.Hold(home), 4.0, q0=home + 0.1 * free, backend="auto")
    assert np.abs(rollout["q"].values[-1] - home).max() < 5e-3


@pytest.mark.parametrize("name", HOMES)
def test_behind_a_wall_the_spring_presses_with_its_limit(name: str) -> None:
    arm, home = arm_of(name), HOMES[name]
    height = float(arm.frame_pose(arm.tip, home).translation[2]) - 1e-3
    wall = armgpi.Wall(normal=[0.0, 0.0, 1.0], distance=height, stiffness=1e4, damping=50.0)
    down = arm.frame_pose(arm.tip, home)
    goal = armgpi.inverse_kinematics(
        arm, arm.tip, down.translation - [0.0, 0.0, 0.08], down.rotation, near=home
    ).q
    law = armgpi.CartesianImpedance(arm, DT, stiffness=[1000.0] * 3 + [50.0] * 3, force_limit=15.0)
    plant = armgpi.RigidBodyPlant(arm, environment=[wall])
    rollout = armgpi.simulate(plant, law, armgpi.Bezier(home, goal, 1.0), 3.0, backend="auto")
    assert float(armgpi.metrics.final_force(rollout)[0]) == pytest.approx(15.0, rel=0.05)


@pytest.mark.parametrize("kind", ["cartesian", "joint"])
def test_generated_code_and_batches_do_what_python_does(kind: str) -> None:
    arm, home = arm_of("panda"), HOMES["panda"]
    law: Any = armgpi.JointImpedance(arm, DT, torque_limit=3.0, friction_feedforward=True)
    if kind == "cartesian":
        law = armgpi.CartesianImpedance(arm, DT, force_limit=10.0, friction_feedforward=True)
    plant = armgpi.Encoder(armgpi.RigidBodyPlant(arm, environment=[armgpi.ToolForce([0.0, 30.0, 0.0])]), 17)
    move = armgpi.Bezier(home, home + 0.1, 0.1)
    starts = np.stack([home, home + 0.02])
    known = armgpi.simulate(plant, law, move, 0.1, q0=starts, backend="numpy")
    for row, start in enumerate(starts):
        alone = armgpi.simulate(plant, law, move, 0.1, q0=start, backend="numpy")
        np.testing.assert_allclose(known["tau"].values[row], alone["tau"].values, rtol=1e-9, atol=1e-9)
    made = armgpi.simulate(plant, law, move, 0.1, q0=starts, backend="compiled")
    np.testing.assert_allclose(made["tau"].values, known["tau"].values, rtol=1e-9, atol=1e-9)


def radius(square: float, damping: float, late: int, wall: float) -> float:
    """Spectral radius of one sampled axis of 1 kg with a wall, the controller's filter at 250 1/s."""
    h = 0.5 * 250.0 * DT
    decay, gain = (1.0 - h) / (1.0 + h), 250.0 / (1.0 + h)
    plant = np.zeros((3, 3))
    plant[0, 1], plant[1, 0], plant[1, 2] = 1.0, -wall, 1.0
    moved = expm(plant * DT)
    n = late + 4
    loop = np.zeros((n, n))
    measured = np.zeros(n)
    measured[1 + late if late else 0] = 1.0
    rate = gain * measured
    rate[-1] += decay
    rate[-2] -= gain
    force = -square * measured - damping * rate
    loop[:2, :2] = moved[:2, :2]
    loop[:2] += moved[:2, 2:] * force
    for i in range(late):
        loop[2 + i, 0 if i == 0 else 1 + i] = 1.0
    loop[-2], loop[-1] = measured, rate
    return float(np.abs(np.linalg.eigvals(loop)).max())


@pytest.mark.parametrize("late", [0, 1, 3])
@pytest.mark.parametrize("frequency", [5.0, 50.0])
def test_the_limits_in_closed_form_are_those_of_the_sampled_loop(late: int, frequency: float) -> None:
    square, alpha, beta = frequency**2, 0.8 * frequency, 0.8 / frequency
    loop = _Loop(alpha, beta, 250.0, (late + 0.5) * DT)
    wall = float(loop.spare(np.array([square]))[0])
    damping = alpha + beta * square
    assert radius(square, damping, late, 0.93 * wall) < 1.0
    assert radius(square, damping, late, 1.05 * wall) > 1.0
    most = _largest(lambda factors: loop.scaled(factors).spare(factors * square) > 0.0)
    assert radius(0.97 * most * square, math.sqrt(0.97 * most) * damping, late, 0.0) < 1.0
    assert radius(1.03 * most * square, math.sqrt(1.03 * most) * damping, late, 0.0) > 1.0


def test_a_push_against_the_stiffest_wall_that_is_told_dies_away() -> None:
    arm, home = arm_of("ur5"), HOMES["ur5"]
    law = armgpi.CartesianImpedance(arm, DT, delay=3 * DT)
    height = float(arm.frame_pose(arm.tip, home).translation[2])
    wall = armgpi.Wall(normal=[0.0, 0.0, 1.0], distance=height - 1e-5, stiffness=0.8 * law.limits.wall)
    weight = armgpi.ToolForce([0.0, 0.0, -20.0])
    plant = armgpi.Delayed(armgpi.RigidBodyPlant(arm, environment=[wall, weight], substeps=8), 3)
    rollout = armgpi.simulate(plant, law, armgpi.Hold(home), 1.5, backend="auto")
    speed = np.abs(rollout["v"].values).max(axis=-1)
    assert speed[-200:].max() < 0.5 * speed[-800:-600].max()


@pytest.mark.parametrize("side", ["motor", "link"])
@pytest.mark.parametrize("ratio", [0.01, 0.05])
def test_on_elastic_joints_it_is_stable_wherever_encoders_sit(side: str, ratio: float) -> None:
    """No friction, nothing told of the side: the filter is chosen for both."""
    bare = armgpi.Robot.load("panda", lock=["panda_finger_joint1", "panda_finger_joint2"])
    arm, home = armgpi.assume_drives(bare), HOMES["panda"]
    gear = arm.drives.value("stiffness")
    own = np.diagonal(arm.mass_matrix(home))
    link = np.maximum(own - arm.armature, 0.05 * own)
    damping = 2.0 * ratio * np.sqrt(gear * arm.armature * link / (arm.armature + link))
    law = armgpi.CartesianImpedance(arm, DT, delay=DT)
    push = armgpi.ToolForce([10.0, 10.0, 10.0], [1.0, 1.0, 1.0], onset=0.05, end=0.15)
    elastic = armgpi.ElasticPlant(
        arm, gear_stiffness=gear, gear_damping=damping, encoder_side=side, environment=[push]
    )
    plant = armgpi.Delayed(armgpi.Encoder(elastic, 18), 1)
    rollout = armgpi.simulate(plant, law, armgpi.Hold(home), 2.5, backend="auto")
    assert np.abs(rollout["v"].values[-200:]).max() < 0.02


def unstable(springs: Any, side: str, ratio: float, late: int) -> bool:
    """Whether one elastic joint with a spring swings up, by its own simulation in small steps."""
    link, rotor, gear, dt = 1.2, 0.5, 4e3, DT
    stiffness, damper, bandwidth = springs
    reduced = link * rotor / (link + rotor)
    damping = 2.0 * ratio * math.sqrt(gear * reduced)
    steps, h = 40, dt / 40
    q = v = w = 0.0
    motor, seen, rate, sent = 1e-3, 0.0, 0.0, [0.0] * late
    size = []
    half = 0.5 * bandwidth * dt
    for _ in range(6000):
        now = motor if side == "motor" else q
        rate = (1.0 - half) / (1.0 + half) * rate + bandwidth / (1.0 + half) * (now - seen)
        seen = now
        sent.append(-stiffness * now - damper * rate)
        torque = sent.pop(0)
        for _ in range(steps):  # semi-implicit Euler: a spring keeps its energy
            pull = gear * (motor - q) + damping * (w - v)
            v, w = v + h * pull / link, w + h * (torque - pull) / rotor
            q, motor = q + h * v, motor + h * w
        size.append(abs(q) + abs(motor))
        if size[-1] > 1.0:
            return True
    return max(size[-500:]) > 1.02 * max(size[-3000:-2500])


@pytest.mark.parametrize("side", ["motor", "link"])
@pytest.mark.parametrize("ratio", [0.01, 0.05])
@pytest.mark.parametrize(("bandwidth", "late"), [(30.0, 2), (250.0, 2), (120.0, 12)])
def test_the_limit_on_an_elastic_joint_is_that_of_its_simulation(
    side: str, ratio: float, bandwidth: float, late: int
) -> None:
    """What is allowed is 0.6 of the stiffness from which on a joint simulated on its own swings up."""
    link, rotor, gear = 1.2, 0.5, 4e3
    plain = 2.0 * ratio * math.sqrt(gear * link * rotor / (link + rotor))
    drives = Drives(("joint",))
    for quantity, value in (("rotor_inertia", rotor), ("stiffness", gear), ("damping", plain)):
        drives = drives.with_value(quantity, value)
    drives = drives.with_value("encoder_side", side)
    inertia, spring = np.array([[link + rotor]]), np.array([[30.0]])
    loop = ElasticLoop([Springs(inertia, spring, np.zeros((1, 1)))], drives, DT, late * DT)
    frequency = math.sqrt(30.0 / (link + rotor))
    damping = Damping(0.8 * frequency, 0.8 / frequency, bandwidth)
    factor = loop.factor(1e4, damping, loop.at_link)

    def swings(share: float) -> bool:
        scaled = factor / 0.6 * share
        root = math.sqrt(scaled)
        damper = damping.alpha * root * (link + rotor) + damping.beta * root * 30.0
        return unstable((30.0 * scaled, damper, bandwidth), side, ratio, late)

    assert 0.0 < factor < 1e4
    assert not swings(0.93)
    assert swings(1.1)


@pytest.mark.parametrize("filtered", [None, 100.0])
def test_a_spring_that_hardly_pulls_is_allowed_on_elastic_joints(filtered: float | None) -> None:
    """A loop without a bound of its own looked for one up to infinity, and ended in a traceback."""
    arm = armgpi.assume_drives(armgpi.Robot.load("ur5"))
    law = armgpi.JointImpedance(arm, DT, 1e-6, velocity_filter=filtered)
    assert law.limits.factor == math.inf


def test_a_delay_of_many_samples_takes_no_longer_to_work_out() -> None:
    """The loop of all its samples would have a million states."""
    drives = Drives(("joint",)).with_value("rotor_inertia", 0.5).with_value("stiffness", 4e3)
    loop = ElasticLoop([Springs(np.array([[1.7]]), np.array([[1e-3]]), np.zeros((1, 1)))], drives, 1e-6, 1.0)
    assert 0.0 < loop.factor(10.0, Damping(0.02, 20.0, 30.0), loop.at_link) <= 10.0


def test_the_largest_stiffness_is_that_of_all_configurations_tried_one_by_one() -> None:
    """A slow twin: every filter, every configuration, factors of 5 % from 1 on, no configuration first."""
    arm = armgpi.assume_drives(armgpi.Robot.load("ur5"))
    law = armgpi.CartesianImpedance(arm, DT, delay=3 * DT)
    modes = law._modes(arm, random_configurations(arm, 40, seed=0))
    loop = ElasticLoop.of([mode.springs for mode in modes], arm.drives, DT, 3 * DT)
    assert loop is not None
    places = np.arange(40)

    def largest(bandwidth: float) -> float:
        damping = Damping(law._alpha.item(), law._beta.item(), bandwidth)
        factor = 1.0
        while (loop._radius(1.05 * factor / 0.6, damping, loop.at_link, places) < 1.0 + 1e-6).all():
            factor *= 1.05
        return factor

    slow = max(largest(bandwidth) for bandwidth in (250.0, 180.0, 120.0, 500.0, 1000.0))
    assert law.largest_factor() == pytest.approx(slow, rel=0.055)


def test_how_much_a_search_looks_at_stays_small(monkeypatch: pytest.MonkeyPatch) -> None:
    """All filters and configurations one by one were 10,000 loops: 2 to 25 s."""
    looked = []

    def counted(loops: Any) -> Any:
        looked.append(len(loops))
        return eigvals(loops)

    eigvals = np.linalg.eigvals
    arm = armgpi.assume_drives(armgpi.Robot.load("ur5"))
    monkeypatch.setattr(np.linalg, "eigvals", counted)
    law = armgpi.CartesianImpedance(arm, DT, delay=3 * DT)
    assert sum(looked) < 1500
    law.largest_factors()
    assert sum(looked) < 2500


def test_a_posture_that_is_too_stiff_is_the_cause_that_a_refusal_names() -> None:
    panda = armgpi.Robot.load("panda", lock=("panda_finger_joint1", "panda_finger_joint2"))
    arm = armgpi.assume_drives(panda)
    asked = {"stiffness": [5.0] * 3 + [0.3] * 3, "delay": 8 * DT}
    with pytest.raises(ParameterError, match=r"nullspace_stiffness must be at most \S+ for this") as refused:
        armgpi.CartesianImpedance(arm, DT, nullspace_stiffness=10.0, **asked)
    allowed = float(str(refused.value).split("at most ")[1].split()[0])
    law = armgpi.CartesianImpedance(arm, DT, nullspace_stiffness=allowed, **asked)
    assert law.limits.factor >= 1.0
    found = compliance_of(arm, DT, 8 * DT)  # was none, as 5 N/m were refused
    assert found is not None
    assert 50.0 < found.stiffness < 100.0


@pytest.mark.parametrize("gear", [1e12, 1e20])
def test_a_joint_far_stiffer_than_any_is_stiff(gear: float) -> None:
    """Rounding hid the motion of the arm beside it, and every stiffness was refused."""
    arm = armgpi.assume_drives(armgpi.Robot.load("ur5"))
    stiff = armgpi.CartesianImpedance(armgpi.Robot.load("ur5").with_armature(arm.armature), DT, delay=DT)
    hard = armgpi.CartesianImpedance(arm.with_drives(arm.drives.with_value("stiffness", gear)), DT, delay=DT)
    assert hard.limits.factor == stiff.limits.factor


def test_one_place_decides_which_joints_are_elastic() -> None:
    drives = Drives(tuple("abcd"))
    np.testing.assert_array_equal(elastic_joints(drives), [False] * 4)
    drives = drives.with_value("stiffness", np.array([1e4, 1e4, 1e20, 1e20]))
    np.testing.assert_array_equal(elastic_joints(drives), [False] * 4)
    drives = drives.with_value("rotor_inertia", np.array([0.5, 0.0, 0.5, 0.0]))
    np.testing.assert_array_equal(elastic_joints(drives), [True, False, False, False])


@pytest.mark.parametrize("side", ["", "motor", "link"])
def test_what_inspect_says_is_what_is_refused_beyond(side: str) -> None:
    arm = armgpi.assume_drives(armgpi.Robot.load("ur5"))
    if side:
        arm = arm.with_drives(arm.drives.with_value("encoder_side", side))
    found = compliance_of(arm, DT, DT)
    assert found is not None
    for share in (0.97, 1.03):
        stiffness = [share * found.stiffness] * 3 + [0.06 * share * found.stiffness] * 3
        if share < 1.0:
            assert armgpi.CartesianImpedance(arm, DT, stiffness=stiffness, delay=DT).limits.factor >= 1.0
        else:
            with pytest.raises(ParameterError, match="a resonance of the elastic joints may not be damped"):
                armgpi.CartesianImpedance(arm, DT, stiffness=stiffness, delay=DT)
    # Where nothing tells the side, what it would be at links is what it is where they are there.
    at_link = compliance_of(arm.with_drives(arm.drives.with_value("encoder_side", "link")), DT, DT)
    assert at_link is not None
    assert found.link_stiffness == pytest.approx(found.stiffness if side else at_link.stiffness, rel=0.02)


def test_an_experiment_file_has_both(tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(
        """
        robot: {name: ur5}
        controllers:
          - {type: cartesian_impedance, stiffness: [800, 800, 400, 40, 40, 40], force_limit: 30}
          - {type: joint_impedance, joint_stiffness: {elbow_joint: 300, others: 100}}
        """.replace("{elbow_joint: 300, others: 100}", "250"),
        encoding="utf-8",
    )
    tool, joints = config.build(*config.read(file)).controllers.values()
    assert isinstance(tool, armgpi.CartesianImpedance)
    np.testing.assert_array_equal(tool.stiffness, [800.0, 800.0, 400.0, 40.0, 40.0, 40.0])
    assert isinstance(joints, armgpi.JointImpedance)
    np.testing.assert_array_equal(joints.stiffness, np.full(6, 250.0))


def test_bad_input_is_refused_with_what_may_be_asked_for() -> None:
    arm = arm_of("ur5")
    with pytest.raises(ParameterError, match=r"stiffness.*at most 0\.\d+ times that: beyond, the sample"):
        armgpi.CartesianImpedance(arm, DT, stiffness=[1e6] * 3 + [1e4] * 3, delay=3 * DT)
    with pytest.raises(ArrayError, match="six numbers"):
        armgpi.CartesianImpedance(arm, DT, stiffness=[500.0] * 3)
    with pytest.raises(ParameterError, match="zero or positive"):
        armgpi.CartesianImpedance(arm, DT, stiffness=[-1.0] + [500.0] * 5)
    with pytest.raises(NameNotFound):
        armgpi.CartesianImpedance(arm, DT, frame="nowhere")
    with pytest.raises(ArrayError, match="stiffness"):
        armgpi.JointImpedance(arm, DT, stiffness=0.0)


def test_a_stiffness_along_a_direction_that_no_joint_moves_is_refused() -> None:
    planar = armgpi.Robot.load("twodof")
    q = planar.middle()
    moved = np.abs(planar.frame_jacobian(planar.tip, q)).max(axis=1)
    still = int(np.argmin(moved))
    stiffness = np.zeros(6)
    stiffness[still] = 100.0
    with pytest.raises(ParameterError, match="a direction in which the tool can move"):
        armgpi.CartesianImpedance(planar, 1e-3, stiffness=stiffness.tolist())
    with pytest.raises(ParameterError, match="less than a thousandth of that"):
        armgpi.CartesianImpedance(armgpi.Robot.load("ur5"), 1e-3, stiffness=[1e12] * 6)


def test_an_arm_of_six_joints_has_no_posture_beside_its_pose() -> None:
    """All of its joints hold the tool, so a stiffness of the posture changes no torque."""
    arm, home = arm_of("ur5"), HOMES["ur5"]
    torques = []
    for stiffness in (0.0, 50.0):
        law = armgpi.CartesianImpedance(arm, DT, nullspace_stiffness=stiffness)
        rollout = armgpi.simulate(
            armgpi.RigidBodyPlant(arm), law, armgpi.Hold(home), 0.02, q0=home + 0.05, backend="numpy"
        )
        torques.append(rollout["tau"].values)
    np.testing.assert_array_equal(*torques)


def test_a_stiffness_just_below_the_largest_stays() -> None:
    arm = arm_of("panda")
    largest = armgpi.JointImpedance(arm, DT, 100.0, velocity_filter=250.0).limits.factor
    law = armgpi.JointImpedance(arm, DT, 99.0 * largest, velocity_filter=250.0)
    measured, target = Measurement(HOMES["panda"]), armgpi.Hold(HOMES["panda"]).at(0.0)
    first = law.init(measured, target)
    state = law.changed(first, stiffness=law.stiffness)
    for _ in range(5):
        state = law.step(measured, target, state).state
    np.testing.assert_allclose(state.root, first.root, rtol=1e-12)


def test_the_filtered_rate_of_a_ramp_is_its_own_and_a_step_decays_by_the_trapezoidal_rule() -> None:
    law: Any = armgpi.JointImpedance(armgpi.Robot.load("anthropomorphic3"), 1e-3, 10.0, velocity_filter=250.0)
    assert law._drive * 1e-3 / (1.0 - law._decay) == pytest.approx(1.0, rel=1e-12)
    assert law._decay == pytest.approx((1.0 - 0.125) / (1.0 + 0.125), rel=1e-12)


@pytest.mark.parametrize("kind", ["tool", "joints"])
def test_no_change_steps_the_torque_however_far_it_goes(kind: str) -> None:
    """A limit of 10,000 N in place of 30 stepped by 80 N m, and a target elsewhere by 212 N m, as damping."""
    robot = armgpi.Robot.load("anthropomorphic3")
    law: Any = armgpi.JointImpedance(robot, 1e-3, stiffness=20.0, torque_limit=2.0)
    if kind == "tool":
        law = armgpi.CartesianImpedance(robot, 1e-3, stiffness=[500.0] * 3 + [0.0] * 3, force_limit=30.0)
    rng = np.random.default_rng(33)
    zero = np.zeros(3)
    for _ in range(20):
        measured = armgpi.Measurement(robot.middle() + 0.2 * rng.normal(size=3))
        target = armgpi.Target(robot.middle() + 0.2 * rng.normal(size=3), zero, zero)
        state = law.step(measured, target, law.init(measured, target)).state
        usual = law.step(measured, target, state).tau
        spring = np.abs(usual - robot.gravity(measured.q)).max()
        for change in (
            {"stiffness": np.zeros_like(state.goal)},
            {"stiffness": law._most + np.zeros_like(state.root)},
            {"limit": 1e4},
            {"limit": 1e-3},
            {"guided": True},
            {"guided": False},
        ):
            after = law.step(measured, target, law.changed(state, **change)).tau
            # Roots go by a hundredth of their difference in a sample, a hand's position by a fiftieth.
            assert np.abs(after - usual).max() <= 0.25 * spring + 1e-12, change
        new = armgpi.Target(robot.middle() + 0.5 * rng.normal(size=3), zero, zero)
        moved = target.q - new.q
        after = law.step(measured, new, law.changed(state, moved=moved)).tau
        free = law.step(measured, new, law.changed(state, moved=moved)._replace(kept=np.ones(1))).tau
        assert free == pytest.approx(usual, abs=1e-9)  # the wished position is where it was
        # It begins to go to the new one: by a hundredth of the way, at the stiffness of the springs.
        stiffness = 20.0 if kind == "joints" else 500.0
        assert np.abs(after - usual).max() <= 0.0101 * stiffness * np.abs(moved).sum()
