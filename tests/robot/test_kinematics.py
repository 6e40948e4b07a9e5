"""Inverse kinematics: against the closed form of the paper's arm, SciPy, and forward kinematics itself."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import sled, swing
from scipy.linalg import null_space
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from strategies import decimals, robots_and_states

from armgpi import InverseSolution, Robot, RobotBatch, TrackingInverse, inverse_kinematics
from armgpi.errors import ArmgpiError, ArrayError, LimitError, NameNotFound, ParameterError, ReachError
from armgpi.paper.arm import PaperArm
from armgpi.robot import kinematics
from armgpi.robot.frames import Pose
from armgpi.robot.kinematics import _Arm, _goal, _try_again, random_configurations

HAND = PaperArm()
ARM = Robot.load("anthropomorphic3")
LOCKED = {"panda": ["panda_finger_joint1", "panda_finger_joint2"], "so101": ["gripper"]}
FRAMES = {"ur5": "ee_link", "panda": "panda_hand_tcp", "kinova": "j2s6s200_end_effector", "so101": ""}
TOLERANCE = 1e-9  # [m, rad], the default


def load(name: str) -> tuple[Robot, str]:
    robot = Robot.load(name, lock=LOCKED.get(name, ()))
    return robot, FRAMES[name] or robot.tip


def anywhere(robot: Robot, count: int, seed: int = 1) -> np.ndarray:
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    return np.random.default_rng(seed).uniform(lower, upper, (count, robot.n))


def check(robot: Robot, frame: str, position: np.ndarray, found: InverseSolution) -> None:
    """What is said of a solution is so, by forward kinematics, and it is inside the limits."""
    assert np.isfinite(found.q).all()
    assert (found.q >= robot.limits.lower).all()
    assert (found.q <= robot.limits.upper).all()
    missed = np.linalg.norm(robot.frame_pose(frame, found.q).translation - position, axis=-1)
    np.testing.assert_allclose(found.position_error, missed, rtol=1e-9, atol=1e-15)
    near = np.maximum(found.position_error, found.rotation_error) <= TOLERANCE
    np.testing.assert_array_equal(found.reached, near)


def test_it_is_the_closed_form_of_the_papers_arm() -> None:
    closed = HAND.inverse_kinematics(HAND.forward_kinematics(anywhere(ARM, 300)))
    # Inside the limits, and away from the stretched arm, where the two elbows meet.
    inside = (closed > ARM.limits.lower).all(axis=1) & (closed < ARM.limits.upper).all(axis=1)
    closed = closed[inside & (np.abs(closed[:, 2]) > 0.1)]
    points = HAND.forward_kinematics(closed)
    found = inverse_kinematics(ARM, "tool", points, near=closed + 0.02)
    assert found.reached.all()
    check(ARM, "tool", points, found)
    # 1e-9 m, over the smallest singular value: 0.3 m times sin 0.1 and less near the axis of q1.
    np.testing.assert_allclose(found.q, closed, atol=1e-5)
    assert np.median(np.abs(found.q - closed).max(axis=1)) < 1e-8


def test_a_point_out_of_reach_says_so_and_by_how_far() -> None:
    points = np.array([[0.7, 0.0, 0.3], [0.3, -0.5, 0.4], [0.2, 0.2, 0.9]])
    found = inverse_kinematics(ARM, "tool", points)
    assert not found.reached.any()
    check(ARM, "tool", points, found)
    for point, error in zip(points, found.position_error, strict=True):
        with pytest.raises(ReachError) as caught:
            HAND.inverse_kinematics(point)
        assert error == pytest.approx(caught.value.distance, rel=1e-4)


@pytest.mark.parametrize("name", FRAMES)
@pytest.mark.parametrize("asked", ["position", "direction", "rotation"])
def test_poses_that_can_be_reached_are_reached(name: str, asked: str) -> None:
    robot, frame = load(name)
    pose = robot.frame_pose(frame, anywhere(robot, 60))
    axis = np.array([0.6, 0.0, 0.8])
    options: dict[str, Any] = {
        "position": {},
        "direction": {"direction": pose.rotation @ axis, "tool_axis": axis},
        "rotation": {"rotation": pose.rotation},
    }[asked]
    found = inverse_kinematics(robot, frame, pose.translation, **options)
    # Five joints reach a set of poses without volume: a start may end beside it.
    assert found.reached.mean() >= (0.95 if robot.n < 6 and asked == "rotation" else 1.0)
    check(robot, frame, pose.translation, found)
    there = robot.frame_pose(frame, found.q[found.reached]).rotation
    turned = Rotation.from_matrix(pose.rotation[found.reached].swapaxes(1, 2) @ there)
    if asked == "rotation":
        assert turned.magnitude().max() < 2e-9
    elif asked == "direction":
        np.testing.assert_allclose(turned.apply(axis), np.tile(axis, (len(there), 1)), atol=2e-9)
    else:
        assert (found.rotation_error == 0.0).all()


@settings(max_examples=40)
@given(robots_and_states(max_joints=6), st.booleans())
def test_where_a_robot_is_it_stays(drawn: Any, turned: bool) -> None:
    robot, state = drawn
    pose = robot.frame_pose(robot.tip, state.q)
    found = inverse_kinematics(
        robot, robot.tip, pose.translation, pose.rotation if turned else None, near=state.q
    )
    assert found.reached
    assert found.iterations == 0
    np.testing.assert_allclose(found.q, state.q, atol=1e-9)


@pytest.mark.slow
@settings(max_examples=15)
@given(robots_and_states(max_joints=6), st.tuples(*[decimals(-3.0, 3.0)] * 6))
def test_what_it_says_is_so_for_every_robot_and_point(drawn: Any, asked: Any) -> None:
    robot, state = drawn
    point, axis = np.array(asked[:3]), np.array(asked[3:])
    direction = axis if axis.any() else None
    found = inverse_kinematics(robot, robot.tip, point, direction=direction, near=state.q, restarts=8)
    check(robot, robot.tip, point, found)


def test_an_answer_depends_on_its_own_pose_alone() -> None:
    robot, frame = load("panda")
    pose = robot.frame_pose(frame, anywhere(robot, 6))
    together = inverse_kinematics(robot, frame, pose.translation, pose.rotation)
    again = inverse_kinematics(robot, frame, pose.translation, pose.rotation)
    for ours, theirs in zip(together, again, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    for i in range(6):
        alone = inverse_kinematics(robot, frame, pose.translation[i], pose.rotation[i])
        assert alone.q.shape == (robot.n,)
        np.testing.assert_allclose(alone.q, together.q[i], atol=1e-9)


def test_no_poses_give_no_answers() -> None:
    found = inverse_kinematics(ARM, "tool", np.zeros((0, 3)))
    assert found.q.shape == (0, 3)
    assert found.reached.shape == (0,)


def test_joints_to_spare_stay_near_a_posture_as_scipy_finds_it() -> None:
    robot, frame = load("panda")
    near = robot.middle()
    for q in anywhere(robot, 3, seed=4):
        point = robot.frame_pose(frame, 0.5 * (q + near)).translation
        found = inverse_kinematics(robot, frame, point, near=near)
        best = minimize(
            lambda x: np.sum((x - near) ** 2),
            found.q,
            jac=lambda x: 2.0 * (x - near),
            method="SLSQP",
            bounds=list(zip(robot.limits.lower, robot.limits.upper, strict=True)),
            constraints={
                "type": "eq",
                "fun": lambda x, point=point: robot.frame_pose(frame, x).translation - point,
                "jac": lambda x: robot.frame_jacobian(frame, x)[:3],
            },
            options={"ftol": 1e-14, "maxiter": 200},
        )
        # Ours goes most of the way: it stops where next to nothing is left to gain.
        assert found.reached
        assert np.linalg.norm(found.q - near) < 1.0005 * np.linalg.norm(best.x - near)


def test_full_turns_are_those_nearest_to_the_posture_asked_for() -> None:
    robot, frame = load("ur5")
    q = np.array([0.3, -1.0, 1.2, -0.5, 0.8, 0.2])
    pose = robot.frame_pose(frame, q)
    for turns in ([1, 0, 0, 0, 0, -1], [0, 0, 0, 0, 0, 0]):
        near = q + 2.0 * np.pi * np.array(turns)
        near = np.clip(near + 0.05, *robot.limits[:2])
        found = inverse_kinematics(robot, frame, pose.translation, pose.rotation, near=near)
        inside = np.where(
            q + 2.0 * np.pi * np.array(turns) > robot.limits.upper, q, q + 2.0 * np.pi * np.array(turns)
        )
        np.testing.assert_allclose(found.q, inside, atol=1e-7)


def test_a_stretched_arm_is_found_and_left() -> None:
    robot, frame = load("ur5")
    stretched = robot.frame_pose(frame, np.zeros(6))
    # At the edge of the reach half a nanometre lies 1e-5 rad from the configuration.
    found = inverse_kinematics(robot, frame, stretched.translation, near=np.full(6, 0.7))
    assert found.reached
    inwards = stretched.translation * np.array([0.7, 1.0, 1.0])
    found = inverse_kinematics(robot, frame, inwards, stretched.rotation, near=np.zeros(6))
    assert found.reached


def test_sliding_joints_slide_and_stop_at_their_limits() -> None:
    rail = sled(bounds='lower="-2" upper="2"')
    inside = inverse_kinematics(rail, "body", [1.5, 0.0, 0.0])
    assert inside.reached
    np.testing.assert_allclose(inside.q, [1.5], atol=1e-9)
    beyond = inverse_kinematics(rail, "body", [2.5, 0.0, 0.0])
    assert not beyond.reached
    np.testing.assert_allclose(beyond.q, [2.0], atol=1e-12)
    assert beyond.position_error == pytest.approx(0.5, abs=1e-12)
    beside = inverse_kinematics(rail, "body", [1.0, 0.3, 0.0])
    np.testing.assert_allclose(beside.q, [1.0], atol=1e-6)
    assert beside.position_error == pytest.approx(0.3, abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_at_its_limit_lets_the_others_go_on(side: float) -> None:
    lower, upper = np.sort(side * np.array([[-0.5] * 3, [0.5, 3.0, 3.0]]), axis=0)
    limited = swing(count=3).with_limits(lower=lower, upper=upper)
    goal = side * np.array([0.5, 1.2, 0.8])
    target = limited.frame_pose("link3", goal)
    found = inverse_kinematics(limited, "link3", target.translation, target.rotation, restarts=0)
    assert found.reached
    np.testing.assert_allclose(found.q, goal, atol=1e-6)


def crane() -> Robot:
    """An arm that slides first, so that its units are not all one."""
    moves = (
        ("x", "1 0 0", 0.1, 0.9),
        ("z", "0 0 1", -0.5, 2.0),
        ("y", "0 1 0", -1.0, 2.5),
        ("w", "0 1 0", -2, 0),
    )
    parts = ['<robot name="crane"><link name="base"/>']
    for (name, axis, low, high), before in zip(moves, ("base", "x", "z", "y"), strict=True):
        kind = "prismatic" if name == "x" else "revolute"
        parts.append(
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"'
            f' iyz="0"/></inertial></link><joint name="{name}" type="{kind}"><parent link="{before}"/>'
            f'<child link="{name}"/><origin xyz="0.1 0.2 0.7"/><axis xyz="{axis}"/>'
            f'<limit lower="{low}" upper="{high}" effort="9" velocity="9"/></joint>'
        )
    parts.append('<link name="tip"/><joint name="t" type="fixed"><parent link="w"/><child link="tip"/>')
    return Robot.from_xml("".join([*parts, '<origin xyz="0.4 0 0"/></joint></robot>']))


@pytest.mark.parametrize("asked", ["position", "direction", "rotation"])
@pytest.mark.parametrize("name", ["crane", "panda"])
def test_what_is_missing_to_a_goal_changes_as_its_jacobian_says(name: str, asked: str) -> None:
    robot, frame = (crane(), "tip") if name == "crane" else load("panda")
    arm, q = _Arm.of(robot, frame), anywhere(robot, 4)
    pose, axis = robot.frame_pose(frame, q), np.array([0.6, 0.0, 0.8])
    rotation = pose.rotation if asked == "rotation" else None
    _, goal = _goal(pose.translation, rotation, pose.rotation @ axis if asked == "direction" else None, axis)
    e, J = arm.linearise(goal, q)
    np.testing.assert_allclose(e, 0.0, atol=1e-12)
    assert J.shape == (4, goal.size, robot.n)
    assert arm.units[0] == (arm.length if name == "crane" else 1.0)
    for j, unit in enumerate(1e-5 * arm.units * np.eye(robot.n)):
        ahead, behind = (arm.linearise(goal, q + step)[0] for step in (unit, -unit))
        np.testing.assert_allclose(J[:, :, j], (behind - ahead) / 2e-5, atol=1e-8)
        moved = robot.frame_pose(frame, q + unit).translation - pose.translation
        np.testing.assert_allclose(arm.errors(goal, q + unit)[0], np.linalg.norm(moved, axis=1), rtol=1e-6)


def test_an_axis_that_points_the_other_way_is_half_a_turn_off_and_one_that_is_there_none() -> None:
    _, goal = _goal(np.zeros((2, 3)), None, [[0.0, 0.6, 0.8], [0.0, -0.6, -0.8]], [0.0, 0.6, 0.8])
    there, off = goal.turn(Pose(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3))))
    np.testing.assert_array_equal(there, 0.0)
    assert np.linalg.norm(off) == pytest.approx(np.pi)
    assert off @ [0.0, 0.6, 0.8] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("keeps", [1e3, 1e-9])
def test_joints_to_spare_go_home_by_steps_that_keep_the_frame(
    monkeypatch: pytest.MonkeyPatch, keeps: float
) -> None:
    """Few steps, so that each counts: the change nearest to the wish of those that give what is missing."""
    for name, value in {"_PROJECTION_STEPS": 2, "_CORRECTIONS": 1, "_PROJECTION_SHARE": 0.4}.items():
        monkeypatch.setattr(kinematics, name, value)
    arm, robot = _Arm.of(crane(), "tip"), crane()
    lower, upper = robot.limits[:2]
    q, home = np.random.default_rng(2).uniform(lower, upper, (2, 8, 4))
    home[6:], off = q[6:], 0.1 * (np.arange(8) > 3)[:, None]
    _, goal = _goal(robot.frame_pose("tip", q).translation + off, None, None, [0.0, 0.0, 1.0])
    found = kinematics._Search(keeps, 1).null_space_projection(arm, goal, q, home)
    moved = q.copy()
    for share in (0.4, 0.4, 0.0):
        for i, at in enumerate(moved):
            J = robot.frame_jacobian("tip", at)[:3] * arm.units
            missing, wish = (
                goal.position[i] - robot.frame_pose("tip", at).translation,
                share * (home[i] - at) / arm.units,
            )
            change = wish + np.linalg.lstsq(J, missing - J @ wish, rcond=None)[0]
            moved[i] = np.clip(at + arm.units * change, lower, upper)
    near, nearer = (np.linalg.norm((x - home) / arm.units, axis=1) for x in (q, moved))
    missed = np.linalg.norm(robot.frame_pose("tip", moved).translation - goal.position, axis=1)
    assert 0 < (nearer < near).sum() < 8
    kept = (nearer < near) & (missed <= keeps)
    np.testing.assert_allclose(found, np.where(kept[:, None], moved, q), atol=1e-9)


def test_rates_and_newton_steps_give_a_frame_its_way_and_its_turn() -> None:
    robot, frame = load("panda")
    rng = np.random.default_rng(3)
    q, linear, angular, wish = anywhere(robot, 5), *rng.normal(size=(2, 5, 3)), rng.normal(size=(5, 7))
    pose = robot.frame_pose(frame, q[:1])
    follow = TrackingInverse(robot, frame, rotation=pose.rotation[0])
    J, rates = robot.frame_jacobian(frame, q), follow.resolve(q, linear, wish, angular)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", J, rates), np.hstack([linear, angular]), atol=1e-9)
    for own, rate, asked in zip(J, rates, wish, strict=True):
        np.testing.assert_allclose(null_space(own).T @ (rate - asked), 0.0, atol=1e-9)
    still = np.einsum("kij,kj->ki", J, follow.resolve(q, linear, wish))
    np.testing.assert_allclose(still, np.hstack([linear, 0.0 * linear]), atol=1e-9)
    for arm, tip, at in ((robot, frame, q[0]), (crane(), "tip", crane().middle())):
        near, goal = TrackingInverse(arm, tip), arm.frame_pose(tip, at + 0.02).translation
        missed = [float(near.missed(near.correct(at[None], goal[None], n), goal[None])[0]) for n in range(4)]
        assert missed[1] < 0.05 * missed[0]
        assert missed[3] < 1e-9


def test_the_point_of_several_that_is_not_reached_is_named() -> None:
    robot, frame = load("ur5")
    follow, q = TrackingInverse(robot, frame), anywhere(robot, 3)
    points = robot.frame_pose(frame, q).translation
    np.testing.assert_allclose(follow.closest(q, points), q, atol=1e-9)
    points[1] = [0.0, 3.0, 0.0]
    with pytest.raises(ReachError, match=r"does not reach \(0, 3, 0\) m") as caught:
        follow.closest(q, points)
    assert caught.value.distance == pytest.approx(3.0 - np.linalg.norm([0.0, 0.95, 0.0]), abs=0.4)


def test_starts_are_drawn_all_over_the_limits_and_a_held_joint_takes_no_clearance() -> None:
    lower, upper = np.array([0.5, -9.0, -1.0, 2.0, -0.2, 1.0]), np.array([0.9, 20.0, 0.4, 2.5, 0.7, 1.0])
    arm = Robot.load("ur5").with_limits(lower=lower, upper=upper)
    drawn, middle = random_configurations(arm, 3000, seed=1), 0.5 * (lower + upper)
    half = np.minimum(0.5 * (upper - lower), np.pi)
    assert (np.abs(drawn - middle) <= half * (1.0 + 1e-12)).all()
    ends = [drawn.min(axis=0), drawn.max(axis=0)]
    np.testing.assert_allclose(ends, [middle - half, middle + half], atol=0.01)
    follow, q = TrackingInverse(arm, "tool0"), drawn[:4]
    margin = np.min(1.0 - np.abs(q - middle)[:, :5] / (0.5 * (upper - lower)[:5]), axis=1)
    J = arm.frame_jacobian("tool0", q)[:, :3] / _Arm.of(arm, "tool0").length
    np.testing.assert_allclose(follow.clearance(q), margin * np.linalg.svd(J)[1][:, -1], rtol=1e-9)


def test_rates_clearance_and_what_is_missed_are_those_of_the_jacobian_by_hand() -> None:
    arm = crane()
    follow, rng = TrackingInverse(arm, "tip", rate=0.7), np.random.default_rng(5)
    lower, upper = arm.limits[:2]
    q = rng.uniform(lower, upper, (6, 4))
    home, velocity = arm.middle(), rng.normal(size=(6, 3))
    levers = arm.frame_jacobian("tip", random_configurations(arm, 32, seed=0))[:, :3, 1:]
    units = np.array([np.linalg.norm(levers, axis=1).max(), 1.0, 1.0, 1.0])
    J = arm.frame_jacobian("tip", q)[:, :3]
    rates = follow.flow(q, velocity, home)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", J, rates), velocity, atol=1e-12)
    for own, rate, at in zip(J, rates, q, strict=True):
        np.testing.assert_allclose(
            null_space(own * units).T @ ((rate - 0.7 * (home - at)) / units), 0.0, atol=1e-12
        )
    margin = (np.minimum(q - lower, upper - q) / (0.5 * (upper - lower))).min(axis=1)
    least = [np.linalg.svd(own * units / units[0])[1][-1] for own in J]
    np.testing.assert_allclose(follow.clearance(q), margin * least, rtol=1e-12)
    robot, frame = load("panda")
    towards = np.array([0.6, 0.0, -0.8])
    follow = TrackingInverse(robot, frame, direction=towards, tool_axis=[0.0, 1.0, 0.0])
    q, points = anywhere(robot, 20), rng.normal(size=(20, 3))
    pose = robot.frame_pose(frame, q)
    angle = np.arccos(pose.rotation[:, :, 1] @ towards)
    far = np.linalg.norm(pose.translation - points, axis=1)
    np.testing.assert_allclose(follow.missed(q, points), np.maximum(far, angle), rtol=1e-9)
    assert (angle > far).any()


@pytest.mark.parametrize(
    ("arguments", "error", "named"),
    [
        ({"frame": "tol"}, NameNotFound, "did you mean 'tool'"),
        ({"frame": ARM.frame_names[0]}, ParameterError, "frame must be a frame that moves"),
        ({"position": [0.1, 0.2]}, ArrayError, r"position: expected shape \(3,\) or \(k, 3\)"),
        ({"position": [0.1, np.nan, 0.2]}, ArrayError, "position"),
        ({"position": [1e300, 0.0, 0.0]}, ArrayError, "within 1e.09 m"),
        ({"rotation": 2.0 * np.eye(3)}, ArrayError, "rotation"),
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, ArrayError, "mirrored"),
        ({"rotation": np.eye(2)}, ArrayError, "rotation"),
        ({"rotation": np.eye(3), "direction": [0, 0, 1]}, ParameterError, "direction must be left out"),
        ({"direction": [0, 0, 0]}, ParameterError, "direction must be a direction"),
        ({"direction": [0, 0, 1], "tool_axis": [0, 0, 0]}, ParameterError, "tool_axis"),
        ({"near": [0.0, 0.0]}, ArrayError, "near"),
        ({"near": [0.0, 9.0, 0.0]}, LimitError, "near of joint 'q2'"),
        ({"near": np.zeros((2, 3))}, ArrayError, "near"),
        ({"restarts": -1}, ParameterError, "restarts"),
        ({"tolerance": 0.0}, ParameterError, "tolerance"),
        ({"iterations": 0}, ParameterError, "iterations"),
        ({"seed": 0.5}, ParameterError, "seed"),
        ({"robot": RobotBatch([ARM, ARM])}, ParameterError, "a single Robot"),
    ],
)
def test_what_is_wrong_is_named(arguments: dict[str, Any], error: type[ArmgpiError], named: str) -> None:
    given = {"robot": ARM, "frame": "tool", "position": [0.2, 0.0, 0.3], **arguments}
    with pytest.raises(error, match=named):
        inverse_kinematics(**given)


def test_points_in_order_are_followed_on_one_branch() -> None:
    robot, frame = load("ur5")
    follow = TrackingInverse(robot, frame, direction=[0.0, 0.0, -1.0], tool_axis=[1.0, 0.0, 0.0])
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    points = np.stack([0.45 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.3 + 0.0 * angle], axis=1)
    q = follow(points)
    pose = robot.frame_pose(frame, q)
    np.testing.assert_allclose(pose.translation, points, atol=1e-9)
    np.testing.assert_allclose(pose.rotation[:, :, 0], np.tile([0.0, 0.0, -1.0], (100, 1)), atol=1e-9)
    assert np.abs(np.diff(q, axis=0)).max() < 0.1
    with pytest.raises(ReachError, match="misses it by") as caught:
        follow(points + np.array([0.0, 0.0, 2.0]))
    assert caught.value.distance > 1.0
    with pytest.raises(ReachError, match="misses it by") as caught:
        follow(points[:1] + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]))
    assert caught.value.distance > 1.0


@pytest.mark.parametrize(
    ("arguments", "error", "named"),
    [
        ({"rotation": np.eye(3)}, ParameterError, "an arm of 6 joints or more.* with the specified"),
        (
            {"robot": Robot.load("anthropomorphic3", lock=["q3"])},
            ParameterError,
            "an arm of 3 joints or more, which a path in space takes",
        ),
        ({"near": np.zeros((2, 3))}, ArrayError, "near"),
        ({"near": [0.0, 9.0, 0.0]}, LimitError, "near of joint 'q2'"),
        ({"rate": -1.0}, ParameterError, "rate"),
        ({"restarts": 0}, ParameterError, "restarts"),
        ({"seed": -1}, ParameterError, "seed"),
        ({"frame": "tol"}, NameNotFound, "tool"),
    ],
)
def test_what_cannot_be_followed_is_named(
    arguments: dict[str, Any], error: type[ArmgpiError], named: str
) -> None:
    with pytest.raises(error, match=named):
        TrackingInverse(**{"robot": ARM, "frame": "tool", **arguments})


def test_of_several_tries_the_reached_one_nearest_home_is_kept_or_the_one_that_misses_least() -> None:
    q = np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0], [2.0, 2.0], [1.0, 0.5], [0.0, 0.1]])
    position = np.array([0.1, 0.2, 0.05, 0.0, 0.0, 0.4])
    turn, reached = np.array([0.3, 0.0, 0.5, 0.0, 0.0, 0.4]), np.arange(6) // 3 == 1
    reached[5] = False
    tried = InverseSolution(q, position, turn, reached, np.arange(6))
    found = InverseSolution(
        np.zeros((2, 2)), np.array([0.1, 0.0]), np.array([0.25, 0.1]), np.zeros(2, bool), np.zeros(2, int)
    )
    same: Any = SimpleNamespace(rows=lambda rows: None)
    search: Any = SimpleNamespace(descend=lambda *_: tried)
    arm: Any = SimpleNamespace(length=0.5, units=np.ones(2))
    _try_again(arm, same, np.zeros((2, 2)), search, found, np.arange(2), np.zeros((2, 3, 2)))
    # Missed by 0.1 / 0.5 + 0.3, 0.4 and 0.6, and before by 0.45; of two that reach it, the nearer one.
    np.testing.assert_array_equal(found.q, q[[1, 4]])
    assert found.reached.tolist() == [False, True]
