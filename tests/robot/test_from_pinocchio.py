"""Robots taken over from Pinocchio: a model of the user's is the same arm as its URDF."""

from __future__ import annotations

import types
import warnings
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from armgpi import GPI, ArmgpiWarning, Bezier, RigidBodyPlant, Robot, robots, simulate
from armgpi.errors import ParameterError, UrdfError


def both(name: str) -> tuple[Robot, Robot]:
    """Return an arm from its URDF, and by way of Pinocchio's own reader."""
    path = str(robots.locate(name)[0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        expected = Robot.load(path)
        found = Robot.from_pinocchio(pin.buildModelFromUrdf(path), lock=expected.provenance["locked"])
    return expected, found


# With continuous joints, prismatic ones that are locked, friction, and fixed frames.
@pytest.mark.parametrize("name", ["anthropomorphic3", "kinova", "panda", "so101", "ur5", "xarm7"])
def test_a_model_is_the_arm_of_its_urdf(name: str) -> None:
    expected, found = both(name)
    assert found.joint_names == expected.joint_names
    assert found.joint_types == expected.joint_types
    assert found.tip == expected.tip
    for mine, theirs in zip(
        (*found.limits, *found.friction), (*expected.limits, *expected.friction), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)
    q = expected.random_positions(20)
    v = np.ones_like(q)
    rounding = 1e-13 * np.abs(expected.mass_matrix(q)).max()
    np.testing.assert_allclose(found.mass_matrix(q), expected.mass_matrix(q), rtol=0.0, atol=rounding)
    bias = expected.nonlinear_effects(q, v)
    atol = 1e-13 * np.abs(bias).max()
    np.testing.assert_allclose(found.nonlinear_effects(q, v), bias, rtol=0.0, atol=atol)
    poses = [robot.frame_pose(expected.tip, q).translation for robot in (found, expected)]
    np.testing.assert_allclose(*poses, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("name", ["kinova", "ur5"])
def test_a_model_goes_to_pinocchio_and_back_with_its_limits(name: str) -> None:
    robot = Robot.load(name)
    for there, back in zip(robot.limits, Robot.load(robot.pinocchio_model()).limits, strict=True):
        np.testing.assert_array_equal(back, there)


def test_a_model_made_by_hand_is_controlled() -> None:
    robot = Robot.from_pinocchio(pin.buildSampleModelManipulator())
    start = robot.middle()
    robot = robot.with_limits(effort=1e3)
    rollout = simulate(
        RigidBodyPlant(robot), GPI(robot, 1e-3), Bezier(start, start + 0.1, 0.6), 0.7, progress=False
    )
    assert float(np.abs(rollout.q - rollout.q_ref).max()) < 0.01


def test_rotor_inertia_and_gravity_come_along_and_a_wrapper_will_do() -> None:
    model = pin.buildSampleModelManipulator()
    model.armature = np.full(model.nv, 0.1)
    model.gravity = pin.Motion(np.array([0.0, 1.0, -2.0]), np.zeros(3))
    robot = Robot.from_pinocchio(pin.RobotWrapper(model))
    np.testing.assert_array_equal(robot.armature, 0.1)
    q = robot.middle()
    np.testing.assert_allclose(
        robot.gravity(q), pin.computeGeneralizedGravity(model, model.createData(), q), rtol=0.0, atol=1e-12
    )
    model.armature = np.zeros(model.nv)  # a model that changes afterwards changes nothing
    np.testing.assert_array_equal(robot.armature, 0.1)


def test_a_floating_base_is_locked_or_refused() -> None:
    model = pin.buildSampleModelHumanoid()
    with pytest.raises(UrdfError, match=r"root_joint.*floating"):
        Robot.from_pinocchio(model)
    assert Robot.from_pinocchio(model, lock=["root_joint"]).n == model.nv - 6


def test_what_a_urdf_cannot_have_is_refused_by_its_name() -> None:
    model = pin.buildSampleModelManipulator()
    ball = model.addJoint(6, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(ball, pin.Inertia.Random(), pin.SE3.Identity())
    with pytest.raises(UrdfError, match=r"'ball' is a Spherical.*buildReducedModel"):
        Robot.from_pinocchio(model)


def test_an_inertia_that_is_none_is_refused() -> None:
    model = pin.buildSampleModelManipulator()
    model.inertias[3] = pin.Inertia(np.nan, np.zeros(3), np.eye(3))
    with pytest.raises(UrdfError):
        Robot.from_pinocchio(model)


@pytest.mark.parametrize("given", [None, 3, "ur5", types.SimpleNamespace(model=3)])
def test_anything_else_is_refused(given: Any) -> None:
    with pytest.raises(ParameterError, match=r"pin\.Model"):
        Robot.from_pinocchio(given)


def test_a_module_of_robot_descriptions_will_do() -> None:
    module = types.ModuleType("robot_descriptions.some_description")
    with pytest.raises(UrdfError, match="URDF_PATH"):
        Robot.load(module)
    vars(module)["URDF_PATH"] = str(robots.locate("anthropomorphic3")[0])
    assert Robot.load(module).n == 3


def test_load_takes_a_model_its_wrapper_and_the_text_of_a_urdf() -> None:
    text = robots.locate("anthropomorphic3")[0].read_text(encoding="utf-8")
    model = pin.buildModelFromXML(text)
    wrapper = pin.RobotWrapper(model)
    q = Robot.load("anthropomorphic3").middle()
    wanted = Robot.from_xml(text).mass_matrix(q)
    for given in (text, "\n " + text, model, wrapper):
        np.testing.assert_allclose(Robot.load(given).mass_matrix(q), wanted, rtol=1e-12)
    assert Robot.load(model, lock=["q1"]).joint_names == ("q2", "q3")
