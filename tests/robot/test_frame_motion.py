"""Where a frame is, how it moves and what a force on it does: Pinocchio says the same of every robot."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import State, robots_and_states

import armgpi
from armgpi import Robot
from armgpi.errors import NameNotFound, ParameterError
from armgpi.robot.frame_motion import FrameMotion


@given(robots_and_states(), st.integers(0, 2**32 - 1))
def test_it_is_what_pinocchio_says_of_any_robot(case: tuple[Robot, State], seed: int) -> None:
    robot, state = case
    random = np.random.default_rng(seed)
    force, moment = random.normal(size=(2, 3))
    frame = robot.tip
    motion = FrameMotion(robot, frame).at(state.q, state.v)
    pose = robot.frame_pose(frame, state.q)
    jacobian = robot.frame_jacobian(frame, state.q)
    twist = jacobian @ state.v
    scale = 1.0 + np.abs(pose.translation).max()
    np.testing.assert_allclose(motion.position, pose.translation, atol=1e-12 * scale)
    np.testing.assert_allclose(motion.rotation, pose.rotation, atol=1e-12)
    speed = 1.0 + np.abs(jacobian).max() * (1.0 + np.abs(state.v).max())
    np.testing.assert_allclose(motion.velocity, twist[:3], atol=1e-12 * speed)
    np.testing.assert_allclose(motion.rate, twist[3:], atol=1e-12 * speed)
    torque = jacobian.T @ np.concatenate([force, moment])
    np.testing.assert_allclose(motion.torque(state.q, force, moment), torque, atol=1e-11 * speed)


def test_a_point_of_the_frame_moves_with_its_rotation() -> None:
    robot = Robot.load("ur5")
    random = np.random.default_rng(32)
    q, v = random.normal(size=(2, 4, robot.n))
    point = np.array([0.03, -0.02, 0.11])
    motion = FrameMotion(robot, "tool0", point).at(q, v)
    pose = robot.frame_pose("tool0", q)
    arm = np.einsum("bij,j->bi", pose.rotation, point)
    np.testing.assert_allclose(motion.position, pose.translation + arm, atol=1e-12)
    twist = np.einsum("bij,bj->bi", robot.frame_jacobian("tool0", q), v)
    np.testing.assert_allclose(motion.velocity, twist[:, :3] + np.cross(twist[:, 3:], arm), atol=1e-11)


def test_joints_that_follow_others_move_it_too() -> None:
    robot = Robot.load("panda", mimic="follow")
    assert robot.coupling is not None
    frame = "panda_rightfinger"
    q = robot.middle()
    v = np.linspace(0.1, 0.9, robot.n)
    motion = FrameMotion(robot, frame).at(q, v)
    np.testing.assert_allclose(motion.position, robot.frame_pose(frame, q).translation, atol=1e-12)
    jacobian = robot.frame_jacobian(frame, q)
    np.testing.assert_allclose(motion.velocity, (jacobian @ v)[:3], atol=1e-12)
    torque = motion.torque(q, np.array([1.0, 2.0, 3.0]), np.zeros(3))
    np.testing.assert_allclose(torque, jacobian[:3].T @ [1.0, 2.0, 3.0], atol=1e-12)


def test_several_joints_of_one_chain_that_follow_one_add_up() -> None:
    """A finger of three joints that one motor bends: its leader has the levers of all three."""
    link = (
        '<link name="l{0}"><inertial><mass value="0.1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="q{0}" type="revolute"><parent link="{1}"/><child link="l{0}"/>'
        '<origin xyz="0.1 0.02 0.03" rpy="0.3 0.2 {0}"/><axis xyz="0 0.6 0.8"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/>{2}</joint>'
    )
    mimic = '<mimic joint="q1" multiplier="{}" offset="{}"/>'
    text = '<robot name="finger"><link name="base"/>' + link.format(1, "base", "")
    text += link.format(2, "l1", mimic.format(0.7, 0.1)) + link.format(3, "l2", mimic.format(-0.4, 0.2))
    robot = Robot.from_xml(text + "</robot>", mimic="follow")
    q, v, step = np.array([0.3]), np.array([0.8]), 1e-6
    motion = FrameMotion(robot, "l3", np.array([0.05, 0.0, 0.1])).at(q, v)
    jacobian = robot.frame_jacobian("l3", q)
    arm = motion.rotation @ [0.05, 0.0, 0.1]
    rate = jacobian[3:, 0] * 0.8
    np.testing.assert_allclose(motion.rate, rate, atol=1e-12)
    np.testing.assert_allclose(motion.velocity, jacobian[:3, 0] * 0.8 + np.cross(rate, arm), atol=1e-12)
    before, after = (robot.frame_pose("l3", q + sign * step) for sign in (-1.0, 1.0))
    turned = (after.rotation - before.rotation) / (2.0 * step) * 0.8 @ motion.rotation.T
    np.testing.assert_allclose(motion.rate, [turned[2, 1], turned[0, 2], turned[1, 0]], atol=1e-9)
    moment = np.array([0.3, -0.2, 0.5])
    torque = motion.torque(q, np.zeros(3), moment)
    np.testing.assert_allclose(torque, [jacobian[3:, 0] @ moment], atol=1e-12)


def test_a_frame_that_is_not_there_or_does_not_move_is_refused() -> None:
    robot = armgpi.Robot.load("ur5")
    with pytest.raises(NameNotFound, match="tool0"):
        FrameMotion(robot, "tool9")
    with pytest.raises(ParameterError, match="a frame that a joint moves"):
        FrameMotion(robot, "base_link")
