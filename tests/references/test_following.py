"""Set-points that arrive late, noisy, or not at all: limits are kept, and the tool comes back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armgpi
from armgpi import config
from armgpi.config import experiment as experiments
from armgpi.errors import ArrayError, ParameterError, ReachError
from armgpi.references import following
from armgpi.references.following import SetpointInverse

HOMES = {
    "ur5": np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.3]),
    "panda": np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]),
}
LIMITS = armgpi.FollowLimits(np.array([1.0, 2.0]), np.array([5.0, 8.0]), np.array([100.0, 300.0]))


def arm_of(name: str) -> armgpi.Robot:
    fingers = ["panda_finger_joint1", "panda_finger_joint2"] if name == "panda" else ()
    return armgpi.Robot.load(name, lock=fingers).with_armature(0.4)


def pose_of(arm: armgpi.Robot, q: np.ndarray) -> pin.SE3:
    pose = arm.frame_pose(arm.tip, q)
    return pin.SE3(pose.rotation, pose.translation)


def check_limits(target: armgpi.Target, limits: armgpi.FollowLimits, dt: float = 1e-3) -> None:
    """Speeds, accelerations and jerks are within their limits, and each is the derivative of the other."""
    q, v, a = target
    assert (np.abs(v) <= limits.velocity).all()
    assert (np.abs(a) <= limits.acceleration).all()
    assert (np.abs(np.diff(a, axis=0)) / dt <= np.asarray(limits.jerk) * (1.0 + 1e-9)).all()
    np.testing.assert_allclose(np.diff(q, axis=0), dt * v[1:], atol=1e-12)
    np.testing.assert_allclose(np.diff(v, axis=0), dt * a[1:], atol=1e-12)


def follow(goals: np.ndarray, rates: Any = None) -> armgpi.Target:
    follower = armgpi.Follower(LIMITS, 1e-3)
    state = follower.init(np.zeros(2))
    states = [state]
    for k, goal in enumerate(goals):
        state = follower.step(goal, state, 0.0 if rates is None else rates[k])
        states.append(state)
    return armgpi.Target(*(np.array(column) for column in zip(*states, strict=True)))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-3, 3.0), st.integers(1, 300))
def test_a_follower_keeps_its_limits_whatever_the_goal_does(seed: int, size: float, hold: int) -> None:
    random = np.random.default_rng(seed)
    goals = np.repeat(random.normal(scale=size, size=(1500 // hold + 1, 2)), hold, axis=0)
    check_limits(follow(goals), LIMITS)
    check_limits(follow(goals, random.normal(scale=3.0, size=goals.shape)), LIMITS)


@pytest.mark.parametrize("jump", [1e-3, 0.05, 0.4, 2.0])
def test_it_reaches_a_goal_and_overshoots_by_little(jump: float) -> None:
    goal = np.array([jump, -jump])
    q = follow(np.tile(goal, (5000, 1))).q
    np.testing.assert_allclose(q[-1], goal, atol=1e-6 + 1e-4 * jump)
    assert ((q / goal) <= (1.13 if jump < 0.2 else 1.02)).all()


def test_limits_that_a_urdf_leaves_blank_do_not_stop_the_follower() -> None:
    link = (
        '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
        'iyz="0"/></inertial></link>'
    )
    joint = (
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="0" effort="0"/></joint>'
    )
    arm = armgpi.Robot.from_xml(f'<robot name="r"><link name="a"/>{link.format("b")}{joint}</robot>')
    limits = armgpi.FollowLimits.of(arm)
    assert limits.velocity == pytest.approx([3.2])
    assert (np.array(limits) > 0.0).all()


def test_a_batch_is_followed_as_each_alone() -> None:
    follower = armgpi.Follower(LIMITS, 1e-3)
    random = np.random.default_rng(0)
    goals = random.normal(size=(400, 3, 2))
    together = follower.init(np.zeros((3, 2)))
    alone = [follower.init(np.zeros(2)) for _ in range(3)]
    for goal in goals:
        together = follower.step(goal, together)
        alone = [follower.step(goal[i], each) for i, each in enumerate(alone)]
    for i in range(3):
        for whole, part in zip(together, alone[i], strict=True):
            np.testing.assert_array_equal(whole[i], part)


def teleoperated(
    arm: armgpi.Robot, home: np.ndarray, seconds: float = 3.0, noise: float = 1e-3
) -> tuple[np.ndarray, list[pin.SE3]]:
    """Poses at 30 Hz with noise and jitter, and none from 1.5 to 1.7 s."""
    random, start = np.random.default_rng(3), pose_of(arm, home)
    times = []
    poses = []
    for i in range(round(30 * seconds)):
        t = i / 30.0
        if 1.5 <= t < 1.7:
            continue
        ease = min(t, 1.0) ** 2
        shift = ease * np.array([0.06 * np.sin(1.3 * t), 0.1 * np.sin(1.9 * t), 0.05 * np.sin(1.1 * t)])
        turn = ease * 0.2 * np.sin(t * np.array([1.1, 0.9, 1.3]))
        noisy = noise * random.normal(size=3) * (i > 0)
        times.append(t + random.uniform(0.0, 8e-3) * (i > 0))
        poses.append(pin.SE3(pin.exp3(turn) @ start.rotation, start.translation + shift + noisy))
    return np.array(times), poses


@pytest.mark.parametrize("name", HOMES)
@pytest.mark.parametrize("feedforward", [False, True])
def test_a_noisy_stream_is_followed_within_limits(name: str, feedforward: bool) -> None:
    arm = arm_of(name)
    times, poses = teleoperated(arm, HOMES[name])
    reference = armgpi.Setpoints(arm, arm.tip, times, poses, start=HOMES[name], feedforward=feedforward)
    target = reference.at(np.arange(4000) * 1e-3)
    check_limits(target, reference.follower.limits)
    assert arm.outside(target.q) is None
    # At rest it is where the last pose is, but for the tolerance of the inverse.
    end = pose_of(arm, target.q[-1])
    assert np.linalg.norm(end.translation - poses[-1].translation) < 1e-4
    assert np.linalg.norm(pin.log3(end.rotation.T @ poses[-1].rotation)) < 1e-3


@pytest.mark.parametrize("name", HOMES)
def test_out_of_reach_it_goes_on_and_comes_back(name: str) -> None:
    arm, home = arm_of(name), HOMES[name]
    start = pose_of(arm, home)
    outward = np.array([*start.translation[:2], 0.0])
    outward = outward / np.linalg.norm(outward)
    times = np.arange(0.0, 5.0, 1 / 30)
    # Out by 1.5 m, which no arm of this size reaches, and back.
    away = 1.5 * np.sin(np.pi * np.minimum(times / 4.0, 1.0)) ** 2
    poses = [pin.SE3(start.rotation, start.translation + far * outward) for far in away]
    reference = armgpi.Setpoints(arm, arm.tip, times, poses, start=home)
    target = reference.at(np.arange(6500) * 1e-3)
    check_limits(target, reference.follower.limits)
    assert arm.outside(target.q) is None
    np.testing.assert_allclose(target.q[-1], home, atol=2e-3)


def test_through_a_wrist_singularity_it_comes_back() -> None:
    arm, home = arm_of("ur5"), HOMES["ur5"].copy()
    home[4] = -0.35
    beyond = home.copy()
    beyond[4] = 0.35
    first, last = pose_of(arm, home), pose_of(arm, beyond)
    turn = pin.log3(last.rotation @ first.rotation.T)
    times = np.arange(0.0, 3.5, 1 / 30)
    shares = np.sin(0.5 * np.pi * np.clip(np.minimum(times, 3.0 - times) / 1.5, 0.0, 1.0)) ** 2
    shift = last.translation - first.translation
    poses = [pin.SE3(pin.exp3(s * turn) @ first.rotation, first.translation + s * shift) for s in shares]
    reference = armgpi.Setpoints(arm, arm.tip, times, poses, start=home)
    target = reference.at(np.arange(5000) * 1e-3)
    check_limits(target, reference.follower.limits)
    np.testing.assert_allclose(target.q[-1], home, atol=2e-3)


def test_the_answer_does_not_depend_on_how_times_are_asked_for() -> None:
    arm, home = arm_of("ur5"), HOMES["ur5"]
    times, poses = teleoperated(arm, home, 1.0)
    one = armgpi.Setpoints(arm, arm.tip, times, poses, start=home)
    other = armgpi.Setpoints(arm, arm.tip, times, poses, start=home)
    whole = one.at(np.arange(900) * 1e-3)
    other.at(0.3)
    for k in (899, 12, 300):
        for a, b in zip(other.at(k * 1e-3), whole, strict=True):
            np.testing.assert_array_equal(a, b[k])


def test_the_arm_follows_a_stream_with_its_tool() -> None:
    arm, home = arm_of("ur5"), HOMES["ur5"]
    times, poses = teleoperated(arm, home, 1.5)
    stream = armgpi.Setpoints(arm, arm.tip, times, poses, start=home)
    rollout = armgpi.simulate(armgpi.RigidBodyPlant(arm), armgpi.GPI(arm, dt=1e-3), stream, 1.6)
    assert float(armgpi.metrics.tool_error(rollout)[0]) < 10.0


def test_the_limits_of_an_arm_follow_from_its_torques() -> None:
    arm = arm_of("ur5")
    limits = armgpi.FollowLimits.of(arm)
    doubled = armgpi.FollowLimits.of(arm, 2.0 * arm.limits.effort / 0.087)
    np.testing.assert_allclose(doubled.jerk, 2.0 * np.asarray(limits.jerk))
    assert (np.asarray(limits.velocity) <= arm.limits.velocity).all()
    # Each joint alone: D_jj times its jerk stays below the rate.
    own = np.diagonal(arm.mass_matrix(HOMES["ur5"]))
    assert (own * np.asarray(limits.jerk) <= arm.limits.effort / 0.087).all()


def test_the_inverse_of_a_set_point_comes_near_at_once_and_meets_the_pose_when_asked_again() -> None:
    arm, home = arm_of("panda"), HOMES["panda"]
    inverse = SetpointInverse(arm, arm.tip, home)
    random = np.random.default_rng(5)
    for _ in range(20):
        wished = pose_of(arm, home + 0.2 * random.normal(size=7))
        q = inverse(home, wished.translation, wished.rotation)
        distance, angle = inverse.error(q, wished.translation, wished.rotation)
        assert distance < 3e-3
        assert angle < 0.03
        for _ in range(8):
            q = inverse(q, wished.translation, wished.rotation)
        distance, angle = inverse.error(q, wished.translation, wished.rotation)
        assert distance < 1e-5
        assert angle < 1e-5


def test_near_a_stretched_elbow_the_tool_stays_near_the_poses() -> None:
    """The elbow is too slow for the poses there: the others wait for it, and none runs ahead."""
    arm = arm_of("panda")
    home = HOMES["panda"].copy()
    home[[1, 3, 5]] = [0.3, -0.25, 1.2]
    start = pose_of(arm, home)
    out = start.translation - arm.frame_pose("panda_link2", home).translation
    out = out / np.linalg.norm(out)
    times = np.arange(0.0, 4.0, 1 / 30)
    # Beyond the reach by some mm, and back.
    shift = 0.02 * np.sin(2.0 * times)
    poses = [pin.SE3(start.rotation, start.translation + far * out) for far in shift]
    reference = armgpi.Setpoints(arm, arm.tip, times, poses, start=home)
    grid = np.arange(4000) * 1e-3
    target = reference.at(grid)
    check_limits(target, reference.follower.limits)
    there = arm.frame_pose(arm.tip, target.q[::20]).translation
    late = np.interp(grid[::20] - 0.08, times, shift)
    away = np.linalg.norm(there - start.translation - late[:, None] * out, axis=1)
    assert away.max() < 0.02


def test_a_jump_is_followed_as_soon_as_by_the_follower_alone() -> None:
    arm, home = arm_of("ur5"), HOMES["ur5"]
    first = pose_of(arm, home)
    second = pin.SE3(first.rotation, first.translation + np.array([0.0, 0.0, -0.2]))
    stream = armgpi.Setpoints(arm, arm.tip, [0.0, 0.1], [first, second], start=home)
    q = stream.at(np.arange(2000) * 1e-3).q
    follower = stream.follower
    state = follower.init(home)
    alone = [state.q]
    for _ in range(1900):
        state = follower.step(q[-1], state)
        alone.append(state.q)

    def arrival(path: np.ndarray) -> int:
        return int(np.flatnonzero(np.abs(path - q[-1]).max(axis=1) > 5e-3)[-1])

    assert arrival(q[100:]) <= arrival(np.array(alone)) + 20


def test_a_stream_of_any_inverse_is_followed() -> None:
    arm, home = arm_of("ur5"), HOMES["ur5"]
    pose = pose_of(arm, home)
    stream = armgpi.Setpoints(
        arm, arm.tip, [0.0], [pose], start=home, inverse=lambda q, position, rotation: home + 0.1
    )
    np.testing.assert_allclose(stream.at(3.0).q, home + 0.1, atol=1e-4)


def test_bad_input_is_refused_in_a_line_with_pose_joint_and_value() -> None:
    arm, home = arm_of("ur5"), HOMES["ur5"]
    pose = pose_of(arm, home)
    far = pin.SE3(pose.rotation, pose.translation + np.array([0.0, 0.0, 9.0]))
    with pytest.raises(
        ReachError, match=r"pose 0, .* is out of reach of 'ee_link': .* misses it by \d"
    ) as said:
        armgpi.Setpoints(arm, arm.tip, [0.0], [far])
    assert "\n" not in str(said.value)
    limits = armgpi.FollowLimits(np.array([1.0, 1.0, 0.0, 1.0, 1.0, 1.0]), 5.0, 100.0)
    with pytest.raises(ParameterError, match=r"elbow_joint.velocity.*positive") as zero:
        armgpi.Setpoints(arm, arm.tip, [0.0], [pose], limits)
    assert "0.0" in str(zero.value) or "got 0" in str(zero.value)
    with pytest.raises(ArrayError, match=r"pose 1 is at 0.1 s, after 0.2 s"):
        armgpi.Setpoints(arm, arm.tip, [0.2, 0.1], [pose, pose])
    with pytest.raises(ArrayError, match="pose 0: expected a quaternion"):
        armgpi.Setpoints(arm, arm.tip, [0.0], np.zeros((1, 7)))
    with pytest.raises(ParameterError, match="jerk"):
        armgpi.Follower(armgpi.FollowLimits(1.0, 1.0, 0.0), 1e-3)


def written(file: Path, times: np.ndarray, poses: list[pin.SE3]) -> None:
    lines = ["time,x,y,z,qx,qy,qz,qw"]
    for t, pose in zip(times, poses, strict=True):
        lines.append(",".join(repr(float(x)) for x in (t, *pin.SE3ToXYZQUAT(pose))))
    file.write_text("\n".join(lines), encoding="utf-8")


def test_an_experiment_file_follows_poses_and_streams(tmp_path: Path) -> None:
    arm, home = armgpi.Robot.load("ur5"), HOMES["ur5"]
    times, poses = teleoperated(arm, home, 0.5)
    written(tmp_path / "hand.csv", times, poses)
    start = ", ".join(f"{name}: {x}" for name, x in zip(arm.joint_names, home, strict=True))
    text = "robot: {name: ur5}\nt_final: 0.4\nreference: "
    for reference in ("{poses: hand.csv}", f"{{stream: hand.csv, torque_rate: 500, start: {{{start}}}}}"):
        file = tmp_path / "experiment.yaml"
        file.write_text(f"{text}{reference}\n", encoding="utf-8")
        experiment = config.build(*config.read(file))
        target = experiment.reference.at(0.4)
        if "stream" in reference:
            limits = armgpi.FollowLimits.of(arm, 500.0)
            stream = armgpi.Setpoints(arm, arm.tip, times - times[0], poses, limits, start=home)
            np.testing.assert_allclose(target.q, stream.at(0.4).q, atol=1e-9)
        else:
            path = armgpi.PosePath(times, poses)
            there = arm.frame_pose(arm.tip, target.q).translation
            np.testing.assert_allclose(there, path.at(0.4).x, atol=1e-6)
        result = experiments.compare(experiment, progress=False)
        experiments.save(result, experiment, tmp_path / "out")
        again = config.build(*config.read(tmp_path / "out" / "experiment.yaml"))
        np.testing.assert_array_equal(again.reference.at(0.4).q, target.q)


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ({"stream": "no such.csv"}, r"reference\.stream: .*No such file"),
        ({"poses": "x.csv", "stream": "x.csv"}, r"reference\.poses: stream and this key"),
        ({"poses": "x.csv", "feedforward": True}, r"reference\.feedforward: requires stream"),
        ({"poses": "x.csv", "holds": 1.0}, r"reference\.holds: poses and this key"),
        ({"stream": "x.csv", "tool_axis": [0, 0, 1]}, r"reference\.tool_axis: requires path"),
        ({"stream": "x.csv", "torque_rate": 0.0}, r"reference\.torque_rate: "),
    ],
)
def test_a_wrong_experiment_of_poses_names_its_key(reference: dict[str, Any], message: str) -> None:
    wanted = {"robot": {"name": "ur5"}, "reference": reference}
    with pytest.raises(armgpi.ArmgpiError, match=message):
        config.build(config.check(wanted, config.Origin("x")), config.Origin("x"))


@pytest.mark.parametrize("seed", range(30))
def test_a_step_within_bounds_costs_least_of_all(seed: int) -> None:
    """No joint that is free to move, or may move inwards, would lower the cost: the conditions of Karush."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    root = rng.normal(size=(n, n))
    matrix, gradient = root @ root.T + 0.05 * np.eye(n), 3.0 * rng.normal(size=n)
    lower, upper = -rng.uniform(0.0, 0.6, n), rng.uniform(0.0, 0.6, n)
    x = following._bounded(matrix, gradient, lower, upper)
    slope = matrix @ x - gradient
    assert (x >= lower).all()
    assert (x <= upper).all()
    assert np.abs(slope[(x > lower) & (x < upper)]).max(initial=0.0) < 1e-9
    assert slope[x == lower].min(initial=0.0) > -1e-9
    assert slope[x == upper].max(initial=0.0) < 1e-9
