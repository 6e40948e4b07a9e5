"""Grippers of many designs, told from arms by what they are, names aside."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import pytest

from armgpi import Robot, robots
from armgpi.robot import grippers, urdf

BODY = (
    '<inertial><origin xyz="0.02 0.01 0.03"/><mass value="0.3"/>'
    '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>'
)


class J(NamedTuple):
    """A joint of a test robot; its child is named after it."""

    name: str
    parent: str
    type: str = "revolute"
    mimic: str = ""
    travel: float = 2.0


def text(*joints: J, arm: int = 6) -> str:
    """Return an arm a1..aN of turning joints, with more joints on it; the parent "tip" is its last link."""
    chain = [J(f"a{i}", f"L_a{i - 1}" if i > 1 else "base") for i in range(1, arm + 1)]
    parts = ['<robot name="r"><link name="base"/>']
    for i, joint in enumerate((*chain, *joints)):
        parent = {"tip": f"L_a{arm}", "base": "base"}.get(joint.parent, joint.parent)
        mimic = f'<mimic joint="{joint.mimic}"/>' if joint.mimic else ""
        axis = ("1 0 0", "0 1 0", "0 0 1")[i % 3]
        parts.append(
            f'<link name="L_{joint.name}">{BODY}</link><joint name="{joint.name}" type="{joint.type}">'
            f'<parent link="{parent}"/><child link="L_{joint.name}"/><origin xyz="0 0.05 0.1"/>'
            f'<axis xyz="{axis}"/><limit lower="{0.03 - joint.travel}" upper="0.03" effort="9" velocity="9"/>'
            f"{mimic}</joint>"
        )
    return "".join([*parts, "</robot>"])


DESIGNS = {
    "two sliding fingers": [J("x", "tip", "prismatic", travel=0.04), J("y", "tip", "prismatic", travel=0.04)],
    "the second mimics the first": [J("x", "tip", "prismatic"), J("y", "tip", "prismatic", "x")],
    "two turning fingers": [J("x", "tip"), J("y", "tip")],
    "three fingers of three joints": [
        J(f"f{i}{k}", "tip" if k == 1 else f"L_f{i}{k - 1}") for i in "abc" for k in (1, 2, 3)
    ],
    "linkage with five mimics": [
        J("drive", "tip"), J("k1", "L_drive", mimic="drive"), J("r", "tip", mimic="drive"),
        J("k2", "L_r", mimic="drive"), J("in1", "tip", mimic="drive"), J("in2", "tip", mimic="drive"),
    ],
    "one sliding jaw": [J("x", "tip", "prismatic", travel=0.05)],
    "on a hand bolted on": [J("mount", "tip", "fixed"), J("x", "L_mount"), J("y", "L_mount")],
    "named jaw": [J("left_jaw", "tip")],
    "named thumb": [J("thumb_1", "tip"), J("thumb_2", "L_thumb_1")],
    "next to the frame of a tool": [J("tool0", "tip", "fixed"), J("x", "tip")],
}  # fmt: skip
NONE = {
    "a bare arm": [],
    "a tool bolted on": [J("tool", "tip", "fixed"), J("tcp", "L_tool", "fixed")],
    "a long sliding axis at the end": [J("z", "tip", "prismatic", travel=0.5)],
    "a wrist that follows another joint": [J("x", "tip", mimic="a1")],
    "a wrist named after its gripper": [J("gripper_yaw", "tip")],
}


@pytest.mark.parametrize("design", DESIGNS)
def test_a_gripper_is_recognised_with_all_its_joints_and_none_of_the_arms(design: str) -> None:
    moving = [joint.name for joint in DESIGNS[design] if joint.type != "fixed"]
    (found,) = grippers.find(urdf.parse(text(*DESIGNS[design]), design))
    assert list(found.joints) == moving
    assert found.after == "a6"
    assert found.reason


@pytest.mark.parametrize("design", NONE)
def test_what_is_no_gripper_is_none(design: str) -> None:
    assert grippers.find(urdf.parse(text(*NONE[design]), design)) == ()


def test_an_arm_of_two_joints_has_a_gripper_and_one_joint_with_two_on_it_none() -> None:
    for arm in (1, 2):
        found = grippers.find(urdf.parse(text(*DESIGNS["two sliding fingers"], arm=arm), "short"))
        assert [each.joints for each in found] == [("x", "y")][: arm - 1]


def row(name: str, count: int, mimic: str = "", follows: bool = False) -> list[J]:
    """Return joints one after the other, the first on the tip; all but the first follow it, or all."""
    return [
        J(f"{name}{k}", "tip" if k == 1 else f"L_{name}{k - 1}", mimic=mimic if k > 1 or follows else "")
        for k in range(1, count + 1)
    ]


TOOL = J("tool0", "tip", "fixed")
PAIR = [*row("x", 3, "x1"), *row("y", 3, "x1", True)]


@pytest.mark.parametrize(
    ("joints", "arm", "other", "arm_of_other"),
    [
        ([J("x", "tip", "prismatic", travel=0.1)], 4, [J("x", "tip", "prismatic", travel=0.11)], 4),
        ([J("x", "tip", "prismatic", travel=0.1)], 4, [J("x", "tip", "prismatic", travel=0.1)], 3),
        ([TOOL, J("x", "tip", travel=3.19)], 2, [TOOL, J("x", "tip", travel=3.2)], 2),
        ([J("jaw", "tip")], 2, [J("jaw", "tip")], 1),
        (row("thumb", 8), 2, row("thumb", 9), 2),
        ([*row("x", 2), *row("y", 2)], 3, [*row("x", 3), *row("y", 3)], 3),
        ([*row("x", 8), *row("y", 8)], 9, [*row("x", 9), *row("y", 9)], 10),
        (PAIR, 2, PAIR, 1),
        (PAIR, 2, row("x", 3, "x1"), 2),
    ],
)  # fmt: skip
def test_how_long_an_arm_and_a_finger_are_tells_grippers_from_arms(
    joints: list[J], arm: int, other: list[J], arm_of_other: int
) -> None:
    (found,) = grippers.find(urdf.parse(text(*joints, arm=arm), "gripper"))
    assert list(found.joints) == [each.name for each in joints if each.type != "fixed"]
    assert grippers.find(urdf.parse(text(*other, arm=arm_of_other), "none")) == ()


def test_two_arms_on_a_body_are_arms() -> None:
    # A torso of two joints that branches into arms of three is no hand with fingers.
    arms = [J(f"{side}{k}", "tip" if k == 1 else f"L_{side}{k - 1}") for side in "lr" for k in (1, 2, 3)]
    assert grippers.find(urdf.parse(text(*arms, arm=2), "torso")) == ()


def test_coupled_joints_of_an_arm_are_no_gripper() -> None:
    assert grippers.find(urdf.parse(text(J("m", "tip", mimic="a2"), J("n", "L_m"), arm=2), "coupled")) == ()


def test_every_gripper_of_a_robot_with_two_is_found() -> None:
    found = grippers.find(urdf.parse(robots.locate("baxter_left_arm")[0].read_text("utf-8"), "baxter"))
    assert [(g.after, len(g.joints)) for g in found] == [("left_w2", 2), ("right_w2", 2)]


def test_a_locked_gripper_is_none() -> None:
    document = urdf.parse(text(*DESIGNS["two sliding fingers"]), "r")
    assert grippers.find(document, ["x", "y"]) == ()


#: Arms whose grippers move by their names alone, and their joints.
GRIPPERS = {
    "panda": {"panda_finger_joint1", "panda_finger_joint2"},
    "so100": {"gripper"},
    "so101": {"gripper"},
    "talos_left_arm": {"gripper_left_joint"},
    "z1": {"jointGripper"},
}


@pytest.mark.parametrize("name", robots.names())
def test_the_grippers_of_example_robot_data_are_those(name: str) -> None:
    path, _ = robots.locate(name)
    document = urdf.parse(path.read_text("utf-8"), name)
    kept = robots.kept(name, document.joints, ())
    locked = () if kept is None else [j for j in document.joints if j not in kept]
    found = {joint for gripper in grippers.find(document, locked) for joint in gripper.joints}
    assert found == GRIPPERS.get(name, set())


@pytest.mark.parametrize("design", DESIGNS)
def test_locking_a_gripper_keeps_the_total_mass_and_the_weight_that_the_arm_feels(design: str) -> None:
    source = text(*DESIGNS[design])
    (found,) = grippers.find(urdf.parse(source, design))
    value = {joint: 0.01 * (1 + i) for i, joint in enumerate(found.joints)}
    arm = Robot.from_xml(source, lock=value)
    # The full robot, with mimic joints as free ones, stood where the lock stands.
    whole = Robot.from_xml(re.sub(r"<mimic[^>]*/>", "", source))
    assert arm.n == 6
    assert arm.total_mass == pytest.approx(whole.total_mass, rel=1e-14)
    q = arm.random_positions(20)
    full = np.zeros((20, whole.n))
    own = [whole.joint_names.index(name) for name in arm.joint_names]
    full[:, own] = q
    for name, x in value.items():
        full[:, whole.joint_names.index(name)] = x
    np.testing.assert_allclose(arm.gravity(q), whole.gravity(full)[:, own], rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        arm.mass_matrix(q), whole.mass_matrix(full)[:, own][:, :, own], rtol=0, atol=1e-13
    )
