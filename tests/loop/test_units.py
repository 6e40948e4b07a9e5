"""Units: the symbols that people write, and which joints have which."""

from __future__ import annotations

import numpy as np
import pytest
from hand_models import planar, scara

from armgpi import GPI, Bezier, Hold, RigidBodyPlant, Robot, RobotBatch, simulate
from armgpi.loop import units
from armgpi.loop.units import Unit

SLIDER = """<robot name="slider"><link name="base"/>
<link name="cart"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="10" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("unit", "revolute", "prismatic", "plain"),
    [
        (Unit(position=1), "rad", "m", "rad"),
        (Unit(position=1, time=-1), "rad/s", "m/s", "rad/s"),
        (Unit(position=1, time=2), "rad s²", "m s²", "rad s^2"),
        (Unit(torque=1), "N m", "N", "N m"),
        (Unit(torque=2, time=1), "(N m)² s", "N² s", "(N m)^2 s"),
        (Unit(time=-10), "1/s¹⁰", "1/s¹⁰", "1/s^10"),
        (Unit(), "", "", ""),
    ],
)
def test_symbols_are_those_of_the_kind_of_joint(
    unit: Unit, revolute: str, prismatic: str, plain: str
) -> None:
    assert unit.symbol() == revolute
    assert unit.symbol(prismatic=True) == prismatic
    assert unit.symbol(ascii=True) == plain
    assert str(unit) == (revolute if revolute == prismatic else f"{revolute} or {prismatic}")


def test_a_robot_its_batch_and_its_rollout_name_the_same_joints_prismatic() -> None:
    robot = scara().robot
    batch = RobotBatch([robot, robot])
    q0 = robot.middle()
    rollout = simulate(RigidBodyPlant(robot), GPI(robot, dt=1e-3), Bezier(q0, q0, 1.0), 0.01, progress=False)
    for found in (robot.prismatic, batch.prismatic, units.prismatic(rollout)):
        np.testing.assert_array_equal(found, [False, False, True])
    assert not units.prismatic(rollout.drop_vars("joint_type")).any()


def test_the_note_is_for_robots_with_both_kinds_of_joints() -> None:
    robot = scara().robot
    assert units.note(robot.joint_names, robot.prismatic) == "prismatic: q3: m for rad, N for N m"
    assert units.note(("x", "y"), np.array([True, True])) == ""
    assert units.note(planar().robot.joint_names, planar().robot.prismatic) == ""


def test_a_rollout_of_sliding_joints_has_their_units() -> None:
    robot = Robot.from_xml(SLIDER)
    rollout = simulate(RigidBodyPlant(robot), GPI(robot, 1e-3), Hold(np.zeros(1)), 0.01)
    found = {name: rollout[name].attrs["units"] for name in ("q", "v", "tau", "lower", "effort")}
    assert found == {"q": "m", "v": "m/s", "tau": "N", "lower": "m", "effort": "N"}
