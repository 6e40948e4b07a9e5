"""Any controller under a force limit, without a force sensor; and what it does not bound."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import armgpi
from armgpi import config
from armgpi.control.controller import FullState, Measurement
from armgpi.control.force_limit import ForceLimit, usual_friction
from armgpi.control.speed_brake import SpeedBrake
from armgpi.errors import ArmgpiWarning, ArrayError, ConfigError, NameNotFound, ParameterError
from armgpi.robot.kinematics import random_configurations

DT = 1e-3
HOME = np.array([0.0, -1.2, 1.6, -1.97, -1.5708, 0.0])
BARE = armgpi.Robot.load("ur5").with_armature(0.4)
LEVEL = armgpi.Friction(0.01 * BARE.limits.effort, 0.01 * BARE.limits.effort)
ARM = BARE.with_friction(*LEVEL)
DOWN = ARM.frame_pose(ARM.tip, HOME)
BEYOND = armgpi.inverse_kinematics(
    ARM, ARM.tip, DOWN.translation - [0.0, 0.0, 0.05], DOWN.rotation, near=HOME
).q
LAWS: dict[str, Any] = {
    "pid": lambda: armgpi.PIDInversion(ARM, DT),
    "pid_positions": lambda: armgpi.PIDPositions(ARM, DT),
    "adrc": lambda: armgpi.ADRC(ARM, DT, delay=DT),
    "gpi": lambda: armgpi.GPI(ARM, DT, delay=DT, feedforward="model", friction_feedforward=True),
    "joints": lambda: armgpi.JointImpedance(ARM, DT, 1500.0, delay=DT),
}


def run(law: Any, move: Any, seconds: float, contact: Any, backend: str = "auto") -> Any:
    """Simulate the arm with friction, its positions in counts where no velocity is measured."""
    plant: Any = armgpi.RigidBodyPlant(ARM, (), "urdf", environment=[contact])
    if law.measurement_type is not FullState:
        plant = armgpi.Encoder(plant, 17)
    return armgpi.simulate(armgpi.Delayed(plant, 1), law, move, seconds, backend=backend)


@pytest.mark.parametrize("name", LAWS)
def test_every_controller_presses_with_the_limit_and_friction(name: str) -> None:
    wall = armgpi.Wall(
        normal=[0.0, 0.0, 1.0], distance=float(DOWN.translation[2]) - 0.02, stiffness=1e4, damping=20.0
    )
    move = armgpi.Bezier(HOME, BEYOND, 1.5)
    limit = 15.0
    free = float(armgpi.metrics.final_force(run(LAWS[name](), move, 3.0, wall))[0])
    law = armgpi.ForceLimited(LAWS[name](), limit)
    end = float(armgpi.metrics.final_force(run(law, move, 3.0, wall))[0])
    jacobian = ARM.frame_jacobian(ARM.tip, BEYOND)
    friction = float(np.abs(np.linalg.inv(jacobian.T)[2]) @ LEVEL.coulomb)
    assert free > 1.5 * limit
    assert 0.3 * limit < end < limit + friction + 0.1 * limit


@pytest.mark.parametrize("name", ["pid", "gpi"])
def test_a_limit_that_never_acts_changes_no_bit(name: str) -> None:
    nothing = armgpi.ToolForce()
    # A move at which the motors saturate is faster beside its reference than any usual speed limit.
    for duration, speed in ((1.0, None), (0.1, 1e3)):
        move = armgpi.Bezier(HOME, HOME + 0.1, duration)
        free = run(LAWS[name](), move, 0.15, nothing, "numpy")
        law = armgpi.ForceLimited(LAWS[name](), 1e5, speed_limit=speed)
        np.testing.assert_array_equal(free["tau"], run(law, move, 0.15, nothing, "numpy")["tau"])


@pytest.mark.parametrize("name", ["ur10", "ur3", "z1", "xarm7", "kinova", "panda"])
def test_a_limit_that_never_acts_changes_no_bit_of_any_arm(name: str) -> None:
    fingers = ["panda_finger_joint1", "panda_finger_joint2"] if name == "panda" else ()
    arm = armgpi.assume_drives(armgpi.Robot.load(name, lock=fingers), "stiff")
    arm = arm.with_friction(0.01 * arm.limits.effort, 0.03 * arm.limits.effort)
    q = arm.middle() + 0.1
    torques = []
    for given in ({}, {"force_limit": 1e3}):
        law = armgpi.GPI.auto(arm, DT, delay=DT, bits=17, drives="stiff", **given)
        plant = armgpi.Delayed(armgpi.Encoder(armgpi.RigidBodyPlant(arm, (), "urdf"), 17), 1)
        rollout = armgpi.simulate(plant, law, armgpi.Bezier(q, q + 0.1, 1.0), 0.4, backend="compiled")
        torques.append(rollout["tau"].values)
    np.testing.assert_array_equal(*torques)


def elastic(side: str, known_side: str) -> tuple[Any, Any, armgpi.Robot]:
    """Return an arm with elastic joints, their damping 1 %, as a plant and as it is known."""
    arm = armgpi.assume_drives(armgpi.Robot.load("ur5"))
    gear, rotor = arm.drives.value("stiffness"), arm.armature
    own = np.diagonal(arm.mass_matrix(HOME))
    link = np.maximum(own - rotor, 0.05 * own)
    damping = 0.02 * np.sqrt(gear * rotor * link / (rotor + link))
    hand = armgpi.ToolForce([0.0, 80.0, 0.0], onset=0.1, end=0.4)
    plant: Any = armgpi.ElasticPlant(
        arm, (), LEVEL, gear_stiffness=gear, gear_damping=damping, encoder_side=side, environment=[hand]
    )
    known = arm.with_friction(*LEVEL)
    if known_side:
        known = known.with_drives(known.drives.with_value("encoder_side", known_side))
    law = armgpi.GPI.auto(known, DT, delay=DT, bits=17, drives="elastic", force_limit=30.0)
    return armgpi.Delayed(armgpi.Encoder(plant, 17), 1), law, arm


@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")
@pytest.mark.parametrize(("side", "known"), [("motor", "motor"), ("link", "link"), ("link", "")])
def test_the_speed_limit_excites_no_resonance_of_elastic_joints(side: str, known: str) -> None:
    """A damping of 73 1/s behind a link encoder left the tool at 9 m/s for ever."""
    plant, law, _ = elastic(side, known)
    tool = armgpi.simulate(plant, law, armgpi.Hold(HOME), 2.5, backend="compiled")["tool"].values
    speed = np.linalg.norm(np.diff(tool, axis=0), axis=1) / DT
    assert speed.max() < (0.28 if known == "motor" else 0.8)
    assert speed[-200:].max() < 0.1


@pytest.mark.parametrize("late", [0, 1, 3])
@pytest.mark.parametrize("name", ["ur5", "xarm7", "z1"])
def test_the_damping_is_stable_on_two_masses(name: str, late: int) -> None:
    """Eigenvalues of the sampled loop of each joint: motor, spring and link, positions late by samples."""
    arm = armgpi.assume_drives(armgpi.Robot.load(name))
    arm = arm.with_drives(arm.drives.with_value("encoder_side", "motor"))
    brake = SpeedBrake(arm, DT, late * DT)
    assert brake.gain.min() > 10.0
    gear, rotor = arm.drives.value("stiffness"), arm.armature
    for q in random_configurations(arm, 5, seed=0):
        own = np.diagonal(arm.mass_matrix(q))
        for joint in range(arm.n):
            link = max(own[joint] - rotor[joint], 0.05 * own[joint])
            masses = (float(rotor[joint]), float(link), float(gear[joint]))
            loop = _sampled(masses, brake, float(brake.gain[joint] * own[joint]), late)
            assert np.abs(np.linalg.eigvals(loop)).max() < 1.0 + 1e-6


def _sampled(masses: tuple[float, float, float], brake: SpeedBrake, damping: float, late: int) -> Any:
    """Return the transition of motor, link, filter and late positions over a sample."""
    rotor, link, gear = masses
    loss = 0.02 * math.sqrt(gear * rotor * link / (rotor + link))
    motion = np.zeros((5, 5))  # motor, its speed, link, its speed, torque that is held
    motion[0, 1] = motion[2, 3] = 1.0
    motion[1] = np.array([-gear, -loss, gear, loss, 1.0]) / rotor
    motion[3] = np.array([gear, loss, -gear, -loss, 0.0]) / link
    step = scipy.linalg.expm(DT * motion)
    size = 4 + 1 + late + 1  # motion, rate, positions of the motor before
    loop = np.zeros((size, size))
    # Newest measured position, the one before, and the rate from both.
    newest, before = (0 if late == 0 else 4 + late), 4 + late + 1
    rate = np.zeros(size)
    rate[4] = brake._decay
    rate[newest] += brake._drive
    rate[before] -= brake._drive
    loop[:4, :4] = step[:4, :4]
    loop[:4] -= damping * np.outer(step[:4, 4], rate)
    loop[4] = rate
    loop[5, 0] = 1.0
    for i in range(6, size):
        loop[i, i - 1] = 1.0
    return loop


@pytest.mark.parametrize("late", [1, 3])
@pytest.mark.parametrize(("side", "warns"), [("link", True), ("", True), ("motor", False)])
def test_a_speed_limit_without_damping_is_warned_of_at_any_delay(late: int, side: str, warns: bool) -> None:
    """At three samples UR10 moved at 0.45 m/s with encoders at the links, and nothing was said."""
    arm = armgpi.assume_drives(armgpi.Robot.load("ur10")).with_friction(1.0, 2.0)
    if side:
        arm = arm.with_drives(arm.drives.with_value("encoder_side", side))
    brake = ForceLimit(arm, None, 30.0, None, arm.friction.coulomb, loop=(DT, late * DT))
    messages = [finding.message for finding in brake.doubts(arm)]
    assert any("the speed limit of" in message for message in messages) == warns


def test_a_slow_controller_keeps_the_speed_limit_too() -> None:
    """It is pushed away without ever coming to its force limit."""
    slow = {"gains": armgpi.FixedGains(6.0), "feedforward": "model"}
    hand = armgpi.ToolForce([0.0, 60.0, 0.0], onset=0.1, end=0.5)
    free, bounded = (
        run(armgpi.GPI(ARM, DT, delay=DT, **slow, **given), armgpi.Hold(HOME), 0.8, hand)["tool"].values
        for given in ({}, {"force_limit": 50.0, "speed_limit": 0.25})
    )
    fastest = [float(np.linalg.norm(np.diff(tool, axis=0), axis=1).max()) / DT for tool in (free, bounded)]
    assert fastest[0] > 0.5
    assert fastest[1] < 0.25


def test_the_delay_of_the_loop_sets_the_damping_of_the_speed_limit() -> None:
    pid = LAWS["pid_positions"]
    at_once, late = (armgpi.ForceLimited(pid(), 20.0, delay=delay) for delay in (None, 3e-3))
    assert at_once.delay == 0.0
    assert late.force._brake.gain[0] == pytest.approx(0.45 / (2e-3 + 3e-3 + 0.5e-3))
    assert late.force_bound().push < at_once.force_bound().push
    origin = config.Origin("x")
    section = {"type": "pid_positions", "force_limit": 30.0, "limit_friction": 0.5}
    wanted = {"robot": {"name": "ur5"}, "plant": {"delay": 2}, "controllers": [section]}
    (law,) = config.build(config.check(wanted, origin), origin).controllers.values()
    assert isinstance(law, armgpi.ForceLimited)
    assert law.delay == pytest.approx(2.0 * law.dt)
    with pytest.raises(ParameterError, match="delay"):
        armgpi.ForceLimited(pid(), 20.0, delay=-1.0)


@pytest.mark.parametrize("limit", [20.0, 100.0])
def test_a_hand_as_strong_as_the_bound_says_moves_the_tool_no_faster(limit: float) -> None:
    """A controller holds nothing yet when the tool is fastest: 100 N left a slow one at 0.33 m/s."""
    slow = {"gains": armgpi.FixedGains(6.0), "feedforward": "model"}
    law = armgpi.GPI(ARM, DT, delay=DT, force_limit=limit, speed_limit=0.2, **slow)
    push = law.force_bound(configurations=HOME[None]).push
    for direction in np.eye(3):
        hand = armgpi.ToolForce((push * direction).tolist(), onset=0.1, end=0.4)
        tool = run(law, armgpi.Hold(HOME), 0.5, hand)["tool"].values
        speed = np.linalg.norm(np.diff(tool, axis=0), axis=1) / DT
        assert speed[:400].max() < 0.2


def test_on_elastic_joints_such_a_hand_moves_the_tool_no_faster_either() -> None:
    """Links swing on their gears while the motors are braked: UR10's tool was at 0.27 m/s of 0.25."""
    arm = armgpi.assume_drives(armgpi.Robot.load("ur10").with_friction(0.0, 1.0))
    arm = arm.with_drives(arm.drives.with_value("encoder_side", "motor"))
    q = np.array([0.0, -1.2, 1.6, -1.97, -1.57, 0.0])
    law = armgpi.GPI.auto(arm, DT, delay=DT, bits=17, drives="elastic", force_limit=30.0, speed_limit=0.25)
    push = law.force_bound(configurations=q[None]).push
    assert push > 5.0
    gear = arm.drives.value("stiffness")
    for direction in np.eye(3):
        hand = armgpi.ToolForce((push * direction).tolist(), onset=0.1, end=0.4)
        plant = armgpi.ElasticPlant(arm, gear_stiffness=gear, encoder_side="motor", environment=[hand])
        plain = armgpi.Delayed(armgpi.Encoder(plant, 17), 1)
        tool = armgpi.simulate(plain, law, armgpi.Hold(q), 0.5, backend="auto")["tool"].values
        assert np.linalg.norm(np.diff(tool, axis=0), axis=1).max() / DT < 0.25


def test_without_configurations_the_line_says_what_it_is_of() -> None:
    law: Any = armgpi.GPI(ARM, DT, delay=DT, feedforward="model", force_limit=20.0)
    usual = law.force_bound()
    assert "(median of usual configurations)" in str(usual)
    assert "(the least of these)" in str(usual)
    assert "usual configurations" not in str(law.force_bound(configurations=HOME[None]))
    every = [law.force_bound(configurations=q[None]).push for q in law._force._usual(ARM)]
    assert usual.push == pytest.approx(min(every))


def test_such_a_hand_is_one_that_the_motors_hold_in_every_direction() -> None:
    arm = armgpi.Robot.load("twodof").with_friction(0.1, 0.1)
    q = np.array([0.4, 0.9])
    law = armgpi.ForceLimited(armgpi.PIDInversion(arm, DT), 20.0, speed_limit=50.0)
    push = law.force_bound(configurations=q[None]).push
    spare = arm.limits.effort - np.abs(arm.gravity(q))
    angles = np.linspace(0.0, np.pi, 1001)
    jacobian = arm.frame_jacobian(arm.tip, q)[:3]
    plane = np.linalg.svd(jacobian)[0][:, :2]
    torques = np.abs(jacobian.T @ plane @ np.array([np.cos(angles), np.sin(angles)]))
    assert push == pytest.approx((spare[:, None] / np.maximum(torques, 1e-9)).min(), rel=1e-4)


def test_beyond_the_limit_a_hand_moves_the_arm_no_faster_than_the_speed_limit() -> None:
    law = armgpi.GPI(ARM, DT, delay=DT, feedforward="model", force_limit=20.0, speed_limit=0.2)
    hand = armgpi.ToolForce([0.0, 50.0, 0.0], onset=0.1, end=0.6)
    tool = run(law, armgpi.Hold(HOME), 2.5, hand)["tool"].values
    speed = np.linalg.norm(np.diff(tool, axis=0), axis=1) / DT
    away = np.linalg.norm(tool - tool[0], axis=1)
    assert away.max() > 0.03
    assert speed.max() < 0.2
    assert away[-1] < 1e-3


def test_a_wall_does_not_turn_the_tool() -> None:
    """A joint controller that is told the torque that was cut gives way by D^-1 of it, which turns it."""
    law = armgpi.GPI(ARM, DT, delay=DT, feedforward="model", friction_feedforward=True, force_limit=10.0)
    wall = armgpi.Wall(
        normal=[0.0, 0.5, math.sqrt(0.75)],
        distance=float(DOWN.translation @ [0.0, 0.5, math.sqrt(0.75)]) - 0.02,
        stiffness=1e4,
        damping=20.0,
    )
    pressed = run(law, armgpi.Bezier(HOME, BEYOND, 1.5), 3.0, wall)
    assert float(armgpi.metrics.tool_angle(pressed)[0]) < 2.0


@pytest.mark.parametrize("name", ["ur5", "ur10", "ur3", "panda", "xarm7", "kinova"])
def test_the_wrench_is_bounded_and_no_axis_through_the_tool_is_lost(name: str) -> None:
    """Against the projection of the wrench onto a ball of forces and one of moments, by another solver."""
    fingers = ["panda_finger_joint1", "panda_finger_joint2"] if name == "panda" else ()
    arm = armgpi.Robot.load(name, lock=fingers)
    limit = ForceLimit(arm, None, 10.0, 2.0, np.zeros(arm.n))
    random = np.random.default_rng(3)
    drawn = random_configurations(arm, 200, seed=7)
    least = np.linalg.svd(arm.frame_jacobian(arm.tip, drawn), compute_uv=False)[:, -1]
    for q in drawn[np.argsort(-least)[:10]]:
        jacobian = arm.frame_jacobian(arm.tip, q)
        wrench = np.concatenate([40.0 * random.normal(size=3), random.normal(size=3)])
        left = jacobian.T @ wrench - limit.excess(q, jacobian.T @ wrench)
        found = np.linalg.lstsq(jacobian.T, left, rcond=None)[0]
        assert np.linalg.norm(found[:3]) < 10.5
        assert np.linalg.norm(found[3:]) < 2.1
        # The moment was not too much: it stays, whatever the force is. Scaling the torque would lose it.
        keep = min(1.0, 2.0 / float(np.linalg.norm(wrench[3:])))
        np.testing.assert_allclose(found[3:], keep * wrench[3:], atol=0.15)


def test_the_impact_is_that_of_a_mass_on_a_spring() -> None:
    """m x'' = F - k x from v at x = 0, by small steps."""
    law = armgpi.ForceLimited(LAWS["pid"](), 20.0)
    bound = law.force_bound(speed=0.3, wall=2e4)
    pressed, x, v, h, peak = bound.limit + bound.friction, 0.0, 0.3, 1e-6, 0.0
    for _ in range(100_000):
        v += h * (pressed - 2e4 * x) / bound.mass
        x += h * v
        peak = max(peak, 2e4 * x)
    assert bound.impact == pytest.approx(peak, rel=1e-3)
    assert bound.total == pytest.approx(20.0 + bound.friction)
    assert "no safety function" in str(bound)


@pytest.mark.parametrize("along", [[800.0, 800.0, 800.0], [1600.0, 400.0, 900.0]])
def test_a_spring_presses_with_its_depth_friction_and_unknown_weight(along: list[float]) -> None:
    """Against the balance n' K^-1 (f n - r) = depth, of the worst r of that size, and a run."""
    law = armgpi.CartesianImpedance(ARM, DT, stiffness=[*along, 40.0, 40.0, 40.0], delay=DT)
    loaded = ARM.with_payload(ARM.tip, 0.3)
    given = {"configurations": BEYOND[None], "arm": loaded}
    bound = law.force_bound(depth=0.03, **given)
    assert bound.depth == 0.03
    assert "its target 30 mm deep" in str(bound)
    alone = armgpi.CartesianImpedance(ARM, DT, force_limit=10.0, delay=DT).force_bound(**given)
    rest = alone.friction + alone.gravity
    for normal in np.random.default_rng(4).normal(size=(500, 3)):
        n = normal / np.linalg.norm(normal)
        softness = n / np.array(along)
        most = (0.03 + rest * np.linalg.norm(softness)) / (n @ softness)
        assert most <= bound.total * (1.0 + 1e-9)
    if len(set(along)) == 1:
        assert bound.total == pytest.approx(0.03 * along[0] + rest)
    wall = armgpi.Wall([0.0, 0.0, 1.0], float(DOWN.translation[2]) - 0.02, stiffness=1e5, damping=100.0)
    plant: Any = armgpi.RigidBodyPlant(loaded, (), "urdf", environment=[wall])
    plant = armgpi.Delayed(armgpi.Encoder(plant, 17), 1)
    pressed = armgpi.simulate(plant, law, armgpi.Bezier(HOME, BEYOND, 1.0), 2.5)
    end = float(armgpi.metrics.final_force(pressed)[0])
    assert 0.3 * 0.03 * along[2] < end < bound.total


def test_a_spring_without_a_limit_is_bounded_by_its_depth_alone() -> None:
    spring = armgpi.CartesianImpedance(ARM, DT, delay=DT)
    for given in ({}, {"depth": -1.0}, {"depth": math.nan}):
        with pytest.raises(ParameterError, match="depth"):
            spring.force_bound(**given)
    soft = armgpi.CartesianImpedance(ARM, DT, stiffness=[500.0, 500.0, 0.0, 30.0, 30.0, 30.0], delay=DT)
    with pytest.raises(ParameterError, match="positive along x, y and z"):
        soft.force_bound(depth=0.01)
    limited = armgpi.CartesianImpedance(ARM, DT, force_limit=10.0, delay=DT)
    assert limited.force_bound(depth=1.0) == limited.force_bound()


def test_gravity_that_the_model_lacks_is_a_force_at_the_tool() -> None:
    """A weight at the tip is its weight there; one in a link is that of its torque, by the inverse of J'."""
    law: Any = armgpi.ForceLimited(armgpi.JointImpedance(BARE, DT), 20.0, limit_friction=1.0)
    tip = BARE.with_payload(BARE.tip, 1.0)
    here = {"configurations": HOME[None]}
    assert law.force_bound(arm=tip, **here).gravity == pytest.approx(9.81, rel=1e-3)
    assert law.force_bound(arm=BARE, **here).gravity == pytest.approx(0.0, abs=1e-9)
    heavy = BARE.with_payload("forearm_link", 2.0, com=[0.0, 0.0, 0.2])
    torque = heavy.gravity(HOME) - BARE.gravity(HOME)
    force = np.linalg.solve(BARE.frame_jacobian(BARE.tip, HOME).T, torque)[:3]
    bound = law.force_bound(arm=heavy, **here)
    assert bound.gravity == pytest.approx(float(np.linalg.norm(force)), rel=2e-2)
    assert bound.total == pytest.approx(bound.limit + bound.friction + bound.gravity)
    with pytest.raises(ParameterError, match="shoulder_pan_joint"):
        law.force_bound(arm=armgpi.Robot.load("twodof"), **here)
    with pytest.raises(ParameterError, match="arm"):
        law.force_bound(arm="ur5", **here)


@pytest.mark.parametrize("friction", [[2.0, 1.0, 0.5], [2.0, 0.0, 0.5], [2.0, 1e-3, 0.5]])
def test_friction_leaves_a_torque_in_the_direction_that_was_asked_for(friction: list[float]) -> None:
    """Until no joint has more than twice its friction; joints with far less than others are cut alone."""
    arm = armgpi.Robot.load("anthropomorphic3").with_limits(effort=[4.0, 2.0, 1.0])
    limit = ForceLimit(arm, None, 10.0, None, np.array(friction))
    compared = np.maximum(2.0 * np.array(friction), 0.5 * np.array([4.0, 2.0, 1.0]))
    rubs = np.array(friction) > 0.0
    for torque in np.random.default_rng(2).normal(size=(50, 3)) * 3.0:
        shortened = torque * min(1.0, float(np.min((compared / np.abs(torque))[rubs])))
        expected = np.clip(shortened, -np.array(friction), friction)
        np.testing.assert_allclose(limit._rubbed(torque), expected, rtol=1e-12)
    inside = 0.9 * np.array(friction)
    np.testing.assert_array_equal(limit._rubbed(inside), inside)


def test_friction_at_the_tool_is_that_of_the_worst_signs() -> None:
    limit = ForceLimit(ARM, None, 10.0, None, np.zeros(6))
    found = []
    for q in limit._usual(ARM):
        inverse = np.linalg.inv(ARM.frame_jacobian(ARM.tip, q).T)[:3]
        signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1)
        found.append(np.linalg.norm(inverse @ (signs * LEVEL.coulomb[:, None]), axis=0).max())
    assert limit.force_of(ARM, LEVEL.coulomb) == pytest.approx(np.median(found), rel=0.05)


def test_signs_are_tried_for_as_many_joints_as_is_said_and_bounded_beyond(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    limit = ForceLimit(ARM, None, 10.0, None, np.zeros(6))
    places = limit._usual(ARM)[:4]
    monkeypatch.setattr("armgpi.control.force_limit._MOST_SIGNS", 6)
    worst = limit.force_of(ARM, LEVEL.coulomb, places)
    monkeypatch.setattr("armgpi.control.force_limit._MOST_SIGNS", 5)
    bound = limit.force_of(ARM, LEVEL.coulomb, places)
    assert worst < bound < 3.0 * worst


def test_it_is_in_files_of_every_controller() -> None:
    origin = config.Origin("x")
    section = {"type": "pid", "force_limit": 30.0, "limit_friction": 0.5}
    wanted = {"robot": {"name": "ur5"}, "controllers": [section]}
    (law,) = config.build(config.check(wanted, origin), origin).controllers.values()
    assert isinstance(law, armgpi.ForceLimited)
    assert law.force_limit == 30.0
    wanted["controllers"] = [{"type": "pid", "speed_limit": 0.1}]
    with pytest.raises(ConfigError, match=r"speed_limit.*no force_limit"):
        config.build(config.check(wanted, origin), origin)


def test_generated_code_does_what_python_does() -> None:
    law = armgpi.ForceLimited(LAWS["pid_positions"](), 8.0)
    hand = armgpi.ToolForce([10.0, 30.0, 0.0])
    known = run(law, armgpi.Hold(HOME), 0.2, hand, "numpy")
    made = run(law, armgpi.Hold(HOME), 0.2, hand, "compiled")
    np.testing.assert_allclose(made["tau"].values, known["tau"].values, rtol=1e-8, atol=1e-8)


def test_bad_input_is_refused_and_friction_is_asked_for() -> None:
    pid = LAWS["pid"]()
    with pytest.raises(ParameterError, match="force_limit"):
        armgpi.ForceLimited(pid, 0.0)
    with pytest.raises(ParameterError, match=r"more than 19\.6 N, the weight"):
        armgpi.ForceLimited(pid, 10.0, uncertain_mass=2.0)
    with pytest.raises(NameNotFound):
        armgpi.ForceLimited(pid, 10.0, force_frame="nowhere")
    with pytest.raises(ParameterError, match="force limit of its own"):
        armgpi.ForceLimited(armgpi.ForceLimited(pid, 10.0), 10.0)
    with pytest.raises(ParameterError, match="supervise the limited one"):
        armgpi.ForceLimited(armgpi.Supervised(pid), 10.0)
    with pytest.warns(ArmgpiWarning, match="no Coulomb friction"):
        armgpi.ForceLimited(armgpi.PIDInversion(BARE, DT), 10.0)
    with pytest.warns(ArmgpiWarning, match="friction is uncertain by"):
        armgpi.ForceLimited(pid, 1.0, limit_friction=2.0 * usual_friction(ARM))
    armgpi.Supervised(armgpi.ForceLimited(pid, 10.0))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed", -1.0),
        ("wall", math.nan),
        ("friction", -1.0),
        ("friction", "much"),
        ("friction", [1.0, 2.0]),
        ("configurations", np.zeros((0, 6))),
        ("configurations", [[0.0, 1.0]]),
    ],
)
def test_a_bound_of_numbers_that_are_none_is_refused(name: str, value: Any) -> None:
    """A friction of -1 N m made the bound lower than one of zero would."""
    law = armgpi.GPI(ARM, DT, force_limit=20.0)
    with pytest.raises((ParameterError, ArrayError), match=name):
        law.force_bound(**{name: value})
    assert law.force_bound(configurations=HOME) == law.force_bound(configurations=[HOME.tolist()])


def test_a_spring_under_a_force_limit_is_a_spring_to_a_supervisor() -> None:
    limited = armgpi.Supervised(armgpi.ForceLimited(LAWS["joints"](), 20.0))
    alone = armgpi.Supervised(LAWS["joints"]())
    assert limited.supervisor.values() == alone.supervisor.values()
    # What has integrators is held off its reference by a wall as well; without a limit it is a fault.
    for law in (
        armgpi.ForceLimited(LAWS["pid_positions"](), 20.0),
        armgpi.GPI(ARM, DT, force_limit=20.0),
    ):
        assert armgpi.Supervised(law).supervisor.values() == alone.supervisor.values()
    stiff = armgpi.Supervised(LAWS["pid_positions"]())
    assert stiff.supervisor.following == armgpi.Supervisor().following
    given = armgpi.Supervised(law, armgpi.Supervisor(following=0.2, speed=0.1))
    assert np.all(given.supervisor.following == 0.2)
    assert given.supervisor.speed == 0.1


def test_of_limits_that_differ_by_rollout_the_largest_bounds_the_force() -> None:
    law = armgpi.CartesianImpedance(ARM, DT, force_limit=np.array([[10.0], [40.0]]))
    assert law.force_bound().limit == 40.0


@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")
@pytest.mark.parametrize("name", ["gpi", "wrapped"])
def test_another_limit_while_it_presses_changes_the_force_without_a_step(name: str) -> None:
    """On a wall the end force goes from one limit to the other, and no torque steps by more than before."""
    wall = armgpi.Wall(
        normal=[0.0, 0.0, 1.0], distance=float(DOWN.translation[2]) - 0.02, stiffness=1e4, damping=20.0
    )
    law: Any = armgpi.ForceLimited(LAWS["adrc"](), 40.0, limit_friction=0.0)
    if name == "gpi":
        law = armgpi.GPI(
            ARM,
            DT,
            delay=DT,
            feedforward="model",
            friction_feedforward=True,
            force_limit=40.0,
            limit_friction=0.0,
        )
    plant = armgpi.Delayed(armgpi.Encoder(armgpi.RigidBodyPlant(BARE, (), "urdf", environment=[wall]), 17), 1)
    loop = armgpi.ClosedLoop(plant, law, armgpi.Bezier(HOME, BEYOND, 0.6))
    state, torques, forces = loop.init(), [], []
    for sample in range(2200):
        if sample in (1000, 1600):
            limit = 12.0 if sample == 1000 else 30.0
            state = state._replace(controller=law.changed(state.controller, limit))
        taken = loop.step(state)
        state = taken.state
        torques.append(taken.tau)
        reached = state.controller.limit.force
        forces.append(float(reached[0]))
    assert forces[999] == 40.0
    assert forces[1599] == pytest.approx(12.0, rel=0.01)
    assert forces[-1] == pytest.approx(30.0, rel=0.01)
    steps = np.abs(np.diff(np.array(torques), axis=0)).max(axis=1)
    assert steps[1000:].max() < 2.0 * max(steps[300:1000].max(), 0.05)


def test_a_changed_limit_ends_with_the_bits_of_the_other_one() -> None:
    """Once it is there, the limit takes away what one of that size does."""
    small, large = (ForceLimit(ARM, None, force, None, np.zeros(6), loop=(DT, DT)) for force in (10.0, 25.0))
    torque = np.array([20.0, 60.0, -40.0, 6.0, 4.0, -2.0])
    state = large.changed(large.init(np.zeros(6)), 10.0, 0.0)
    rest = armgpi.Hold(HOME).at(0.0)
    dynamics = ARM.dynamics
    for _ in range(20_000):
        gentle = large.gentle(HOME, rest, (torque, np.zeros(6)), state, dynamics)
        state = gentle.state
    other = small.gentle(HOME, rest, (torque, np.zeros(6)), small.init(np.zeros(6)), dynamics)
    np.testing.assert_allclose(gentle.tau, other.tau, rtol=1e-12)
    assert np.abs(torque - gentle.tau).max() > 1.0


def test_a_limit_that_cannot_be_is_refused_while_it_runs() -> None:
    law = armgpi.GPI(ARM, DT, delay=DT, feedforward="model", force_limit=30.0)
    at = armgpi.Hold(HOME).at(0.0)
    state = law.init(Measurement(HOME), at)
    for bad in (0.0, -1.0):
        with pytest.raises(ParameterError, match="limit must be positive"):
            law.changed(state, bad)
    for wrong in (math.nan, [1.0, 2.0]):
        with pytest.raises(ArrayError, match="limit"):
            law.changed(state, wrong)
    free = armgpi.GPI(ARM, DT, delay=DT)
    with pytest.raises(ParameterError, match="a controller without a force limit"):
        free.changed(free.init(Measurement(HOME), at), 10.0)
    wrapped = armgpi.ForceLimited(LAWS["adrc"](), 30.0, uncertain_mass=2.0)
    start = wrapped.init(Measurement(HOME), at)
    with pytest.raises(ParameterError, match=r"more than 19\.6 N, the weight"):
        wrapped.changed(start, 19.0)
    assert wrapped.changed(start, 20.0).limit.force_goal.item() == 20.0


@pytest.mark.filterwarnings("ignore::armgpi.ArmgpiWarning")
def test_friction_that_nobody_gave_is_called_assumed() -> None:
    known = armgpi.ForceLimited(LAWS["adrc"](), 20.0).force_bound()
    unknown: Any = armgpi.ForceLimited(armgpi.ADRC(BARE, DT, delay=DT), 20.0)
    assert "assumed" not in str(known)
    assert "(assumed: 6 % of the effort, as the model has none)" in str(unknown.force_bound())
    assert "assumed" not in str(unknown.force_bound(friction=1.0))
