"""Robots from MuJoCo's models: D(q) and C v + G are MuJoCo's, however the file is written."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgpi import Robot
from armgpi.errors import ArmgpiWarning, UrdfError
from armgpi.health import report as health

mujoco = pytest.importorskip("mujoco")

#: An arm whose joints have anchors beside their bodies, zeros elsewhere, two to a body, and one no name.
ARM = """<mujoco model="crooked"><compiler angle="radian" autolimits="true"/>
<default><joint damping="0.2"/><default class="big"><joint armature="0.04" damping="0.7"/></default></default>
<default><default class="small"><joint frictionloss="0.3"/></default></default>
<worldbody><body name="target" mocap="true"><geom size="0.02" mass="3" contype="0" conaffinity="0"/></body>
<body name="one" pos="0.1 0.2 0.3" euler="0.3 1.5707963267948966 0.2">
 <inertial pos="0.01 0.02 0.1" mass="3" fullinertia="0.03 0.04 0.02 0.001 0.002 0.003"/>
 <joint name="a" class="big" axis="1 2 3" pos="0.03 0.01 0.05" ref="0.4" range="-1 2"/>
 <joint axis="0 1 0" pos="0 0.02 0"/>
 <body name="two" pos="0 0.05 0.4" quat="0.7 0.1 0.5 0.2"><site name="flange" pos="0 0 0.1"/>
  <inertial pos="0.05 0 0.1" mass="1.5" diaginertia="0.011 0.012 0.004"/>
  <joint name="slide" class="small" type="slide" axis="0 0.6 0.8" ref="0.05" range="0 0.3"/>
  <body><geom type="box" size="0.05 0.02 0.04" mass="0.6" pos="0.05 0 0"/>
   <joint name="tip" axis="0 0 1" pos="0.02 0 0" range="-1 1"/></body>
 </body></body></worldbody>
<actuator><position joint="a" kp="30" forcerange="-40 50"/><motor joint="slide" gear="3" ctrlrange="-5 5"/>
 </actuator>{more}</mujoco>"""

CUBE = '<worldbody><body name="cube"><freejoint/><geom size="0.1" mass="1"/></body></worldbody>'
FOLLOW = '<equality><joint joint1="tip" joint2="slide" polycoef="0.2 -3 0 0 0"/></equality>'


def write(folder: Path, more: str = "") -> Path:
    """Write the arm, and return its path."""
    path = folder / "crooked.xml"
    path.write_text(ARM.format(more=more), encoding="utf-8")
    return path


def check_equations(robot: Robot, path: Path, names: list[str]) -> None:
    """Hold D(q) and C v + G of a robot against those of MuJoCo, at the joints `names`, in its order."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data: Any = mujoco.MjData(model)
    index = [int(model.jnt_dofadr[j]) for j in range(model.njnt) if model.jnt_type[j] != 0]
    every = ["a", "joint1", "slide", "tip"]
    rows = [index[every.index(name)] for name in names]
    places = [int(model.jnt_qposadr[j]) for j in range(model.njnt) if model.jnt_type[j] != 0]
    rng = np.random.default_rng(3)
    for _ in range(10):
        q, v = rng.uniform(-2.0, 2.0, (2, robot.n))
        data.qpos[[places[every.index(name)] for name in names]] = q
        data.qvel[rows] = v
        mujoco.mj_forward(model, data)
        columns = np.zeros((model.nv, len(rows)))
        for column, row in enumerate(rows):
            unit = np.zeros(model.nv)
            unit[row] = 1.0
            result = np.zeros(model.nv)
            mujoco.mj_mulM(model, data, result, unit)
            columns[:, column] = result
        np.testing.assert_allclose(robot.mass_matrix(q), columns[rows], rtol=0.0, atol=1e-10)
        bias = np.array(data.qfrc_bias)[rows]
        np.testing.assert_allclose(robot.nonlinear_effects(q, v), bias, rtol=0.0, atol=1e-10)


def test_a_body_to_drag_is_no_part_of_the_arm(tmp_path: Path) -> None:
    """It has the first number of those bodies, 0; its 3 kg stand in the world."""
    path = write(tmp_path)
    assert mujoco.MjModel.from_xml_path(str(path)).body("target").mocapid[0] == 0
    robot = Robot.load(path)
    assert {"one", "two", "flange"} <= set(robot.frame_names)
    assert "target" not in robot.frame_names


def test_the_equations_are_those_of_mujoco(tmp_path: Path) -> None:
    path = write(tmp_path)
    robot = Robot.load(path)
    assert robot.joint_names == ("a", "joint1", "slide", "tip")
    assert robot.joint_types == ("revolute", "continuous", "prismatic", "revolute")
    np.testing.assert_array_equal(robot.armature, [0.04, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(robot.friction.viscous, [0.7, 0.2, 0.2, 0.2])
    np.testing.assert_array_equal(robot.friction.coulomb, [0.0, 0.0, 0.3, 0.0])
    np.testing.assert_array_equal(robot.limits.effort, [50.0, np.inf, 15.0, np.inf])
    np.testing.assert_array_equal(robot.limits.lower, [-1.0, -np.inf, 0.0, -1.0])
    check_equations(robot, path, ["a", "joint1", "slide", "tip"])


def test_frames_are_where_mujoco_has_them(tmp_path: Path) -> None:
    path = write(tmp_path)
    robot = Robot.load(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    q = np.array([0.7, -1.1, 0.2, 0.5])
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    for name, place in (("two", data.body("two").xpos), ("flange", data.site("flange").xpos)):
        np.testing.assert_allclose(robot.frame_pose(name, q).translation, place, atol=1e-12)


def test_a_scene_that_includes_an_arm_is_the_arm(tmp_path: Path) -> None:
    write(tmp_path)
    scene = tmp_path / "scene.xml"
    floor = '<worldbody><geom type="plane" size="1 1 1"/></worldbody>'
    scene.write_text(f'<mujoco><include file="crooked.xml"/>{floor}</mujoco>', encoding="utf-8")
    check_equations(Robot.load(scene), scene, ["a", "joint1", "slide", "tip"])


def test_a_free_body_is_offered_to_be_locked(tmp_path: Path) -> None:
    path = write(tmp_path, CUBE)
    with pytest.raises(UrdfError, match="floating") as refused:
        Robot.load(path)
    (remedy,) = refused.value.remedies
    assert remedy.kind == "lock"
    robot = Robot.load(path, lock=list(remedy.joints))
    check_equations(robot, path, ["a", "joint1", "slide", "tip"])


def test_an_equality_in_proportion_is_a_mimic_joint(tmp_path: Path) -> None:
    path = write(tmp_path, FOLLOW)
    robot = Robot.load(path, mimic="follow")
    assert robot.joint_names == ("a", "joint1", "slide")
    assert robot.coupling is not None
    # tip - 0 = 0.2 - 3 (slide - 0.05)
    np.testing.assert_allclose(robot.coupling.ratio[3], [0.0, 0.0, -3.0])
    np.testing.assert_allclose(robot.coupling.offset[3], 0.35)


def test_a_spring_is_refused_until_its_joint_is_locked(tmp_path: Path) -> None:
    path = write(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('name="tip"', 'name="tip" stiffness="4"'), encoding="utf-8")
    with pytest.raises(UrdfError, match="a spring, which acts on 'tip'"):
        Robot.load(path)
    assert Robot.load(path, lock={"tip": 0.3}).joint_names == ("a", "joint1", "slide")


def test_a_ball_joint_is_refused_by_name(tmp_path: Path) -> None:
    path = write(
        tmp_path, '<worldbody><body><joint name="b" type="ball"/><geom size="1"/></body></worldbody>'
    )
    with pytest.raises(UrdfError, match="joint 'b' is a ball joint"):
        Robot.load(path)


def test_inspect_reads_what_run_reads(tmp_path: Path) -> None:
    report = health.inspect(write(tmp_path), effort=100.0)
    assert report.robot.joint_names == ("a", "joint1", "slide", "tip")


def test_both_joints_of_a_constraint_are_named_the_first_of_the_model_as_well(tmp_path: Path) -> None:
    curve = '<equality><joint joint1="tip" joint2="a" polycoef="0 1 2 0 0"/></equality>'
    path = write(tmp_path, curve)
    with pytest.raises(UrdfError, match="no ratio between two joints") as caught:
        Robot.from_mjcf(path)
    assert [remedy.joints for remedy in caught.value.remedies] == [("tip", "a")]
    assert Robot.from_mjcf(path, lock=["a", "tip"]).n == 2


def test_all_springs_are_named_in_one_refusal(tmp_path: Path) -> None:
    path = tmp_path / "springs.xml"
    path.write_text(
        ARM.format(more="")
        .replace('name="a"', 'name="a" stiffness="3"')
        .replace('name="tip"', 'name="tip" stiffness="2"')
    )
    with pytest.raises(UrdfError, match="a spring, which acts on 'a', 'tip'") as caught:
        Robot.from_mjcf(path)
    assert [remedy.joints for remedy in caught.value.remedies] == [("a", "tip")]
    assert Robot.from_mjcf(path, lock=["a", "tip"]).n == 2


def test_all_that_stands_against_an_arm_is_named_in_one_refusal_whose_command_loads_it(
    tmp_path: Path,
) -> None:
    """A free cube, a spring, a tendon on a third joint: one lock of three joints leaves the fourth."""
    more = """<worldbody><body name="cube"><freejoint name="free"/><geom size="0.1"/></body></worldbody>
    <tendon><fixed name="cord" stiffness="1"><joint joint="slide" coef="1"/></fixed></tendon>"""
    path = write(tmp_path, more)
    path.write_text(path.read_text(encoding="utf-8").replace('name="tip"', 'name="tip" stiffness="4"'))
    with pytest.raises(UrdfError) as caught:
        Robot.load(path)
    said = str(caught.value)
    assert (
        "joint 'free' that is floating; a spring; tendon 'cord', which pulls by itself, which act on" in said
    )
    (remedy,) = caught.value.remedies
    assert set(remedy.joints) == {"free", "tip", "slide"}
    assert Robot.load(path, lock=list(remedy.joints)).joint_names == ("a", "joint1")
    with pytest.raises(UrdfError, match="a spring, which acts on 'tip'") as kept:
        Robot.load(path, keep=["a", "tip"])
    (remedy,) = kept.value.remedies
    assert (remedy.kind, remedy.joints) == ("keep", ("a",))
    assert Robot.load(path, keep=list(remedy.joints)).joint_names == ("a",)


def test_what_no_lock_mends_is_not_proposed_to_be_locked(tmp_path: Path) -> None:
    cord = "".join(f'<joint joint="{name}" coef="1"/>' for name in ("a", "joint1", "slide", "tip"))
    text = ARM.format(more=f'<tendon><fixed name="cord" stiffness="1">{cord}</fixed></tendon>')
    path = tmp_path / "hand.xml"
    path.write_text(text.replace("<joint axis", '<joint name="joint1" axis'), encoding="utf-8")
    with pytest.raises(UrdfError, match="no other joint moves, so locking leaves no arm") as caught:
        Robot.load(path)
    assert not caught.value.remedies
    assert "take it out of the file" in str(caught.value)


def test_what_is_refused_after_the_lock_is_said_as_well() -> None:
    """A floating base, and a link behind it that has an inertia but no mass."""
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    parts = []
    for k, mass in enumerate((1.0, 1.0, 1.0, 0.0)):
        parts.append(f'<link name="l{k}"><inertial><mass value="{mass}"/>{inertia}</inertial></link>')
    for k, kind in enumerate(("floating", "continuous", "continuous")):
        ends = f'<parent link="l{k}"/><child link="l{k + 1}"/>'
        parts.append(f'<joint name="j{k}" type="{kind}">{ends}</joint>')
    with pytest.raises(UrdfError, match="'j0' is floating") as caught:
        Robot.from_xml(f'<robot name="r">{"".join(parts)}</robot>')
    assert "What is refused then: link 'l3' has an inertia but no mass" in str(caught.value)
    assert not caught.value.remedies


def test_a_mesh_that_is_not_there_is_named_with_where_it_is_looked_for(tmp_path: Path) -> None:
    path = write(tmp_path, '<asset><mesh name="hull" file="hull.stl"/></asset>')
    with pytest.raises(UrdfError, match=r"names the file 'hull.stl', which is not there: copy it to where"):
        Robot.load(path)


#: A part of the arm: its fluid, a spring, gravity compensated, a loop, damping, friction and limits.
ACTING = """<option density="{density}" gravity="1 2 -9"><flag {flags}/></option>
<equality><weld body1="two"/></equality>"""


def flagged(folder: Path, flags: str, old: str = "", new: str = "", density: float = 0.0) -> Path:
    """Write the arm with parts of MuJoCo's equations switched off."""
    path = write(folder, ACTING.format(flags=flags, density=density))
    path.write_text(path.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    return path


def test_what_flags_switch_off_does_not_act(tmp_path: Path) -> None:
    with pytest.raises(UrdfError, match="a loop: <weld>"):
        Robot.load(flagged(tmp_path, 'gravity="disable"'))
    flags = 'gravity="disable" equality="disable" damper="disable" spring="disable"'
    path = flagged(tmp_path, flags, density=1000.0)
    robot = Robot.load(path)
    check_equations(robot, path, ["a", "joint1", "slide", "tip"])
    assert not np.any(robot.gravity(robot.middle()))
    assert not np.any(robot.friction.viscous)
    assert robot.friction.coulomb.tolist() == [0.0, 0.0, 0.3, 0.0]
    path = flagged(tmp_path, 'equality="disable" frictionloss="disable" limit="disable"', density=1000.0)
    with pytest.warns(ArmgpiWarning, match="the fluid around the arm are left out"):
        robot = Robot.load(path)
    check_equations(robot, path, ["a", "joint1", "slide", "tip"])
    assert robot.friction.viscous.tolist() == [0.7, 0.2, 0.2, 0.2]
    assert not np.any(robot.friction.coulomb)
    assert np.isinf(robot.limits.lower).all()
    assert any("density 1000" in each.message for each in health.inspect(path).findings)


def test_springs_that_are_switched_off_are_none(tmp_path: Path) -> None:
    spring = ('name="tip"', 'name="tip" stiffness="3"')
    with pytest.raises(UrdfError, match="a spring"):
        Robot.load(flagged(tmp_path, 'equality="disable"', *spring))
    assert (
        Robot.load(flagged(tmp_path, 'equality="disable" spring="disable" damper="disable"', *spring)).n == 4
    )


def test_a_model_is_one_by_its_first_element(tmp_path: Path) -> None:
    path = write(tmp_path)
    plain = path.read_text(encoding="utf-8")
    names = Robot.load(path).joint_names
    for head in (
        '<!-- made from <robot name="x"> -->',
        "<?xml version='1.0'?>\n<!-- a > b --><!---->",
        "  \n",
    ):
        path.write_text(head + plain, encoding="utf-8")
        assert Robot.load(path).joint_names == names
    urdf = '<!-- not a <mujoco> --><robot name="a"><mujoco><compiler/></mujoco><link name="b"/></robot>'
    path.write_text(urdf, encoding="utf-8")
    with pytest.raises(UrdfError, match="no moving joint"):
        Robot.load(path)


def test_a_model_is_another_where_a_file_that_it_includes_is(tmp_path: Path) -> None:
    """A certificate of the one is none of the other."""
    path = tmp_path / "scene.xml"
    part = tmp_path / "part.xml"
    path.write_text("<mujoco><include file='part.xml'/></mujoco>", encoding="utf-8")

    def digest(mass: float) -> str:
        geom = f"<body><joint name='a'/><geom size='0.1' mass='{mass}' pos='0.2 0 0'/></body>"
        part.write_text(f"<mujoco><worldbody>{geom}</worldbody></mujoco>", encoding="utf-8")
        return str(Robot.load(path).provenance["sha256"])

    first = digest(1.0)
    assert digest(2.0) != first
    assert digest(1.0) == first
    alone = write(tmp_path)
    assert Robot.load(alone).provenance["sha256"] == hashlib.sha256(alone.read_bytes()).hexdigest()


def test_what_has_no_name_is_named_by_its_place(tmp_path: Path) -> None:
    joints = '<joint joint="a" coef="1"/><joint joint="tip" coef="1"/>'
    more = f'<tendon><fixed>{joints}</fixed></tendon><actuator><motor tendon="t"/></actuator>'
    path = write(tmp_path, more.replace("<fixed>", '<fixed name="t">'))
    with pytest.raises(UrdfError, match="actuator 'actuator2' on tendon 't'"):
        Robot.load(path)
