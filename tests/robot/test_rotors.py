"""Rotors that a file does not tell: what is believed of them, and what that does to a law."""

from __future__ import annotations

import math
import re
import runpy
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgpi import GPI, Hold, RigidBodyPlant, Robot, config, simulate
from armgpi.errors import ArmgpiWarning, ParameterError
from armgpi.robot import rotors
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.rotors import assume_drives
from armgpi.tuning import two_mass

#: Rotor inertia of the drives [kg m^2], and stiffness of the gears [N m/rad], assumed, of typical size.
PANDA = Robot.load("panda", ["panda_finger_joint1", "panda_finger_joint2"])
UR5 = Robot.load("ur5")
ROTORS = {PANDA: [0.6, 0.6, 0.46, 0.46, 0.2, 0.2, 0.2], UR5: [1.2, 1.2, 0.8, 0.2, 0.2, 0.2]}
GEARS = {PANDA: [14e3] * 4 + [8e3] * 3, UR5: [20e3, 20e3, 15e3, 5e3, 5e3, 5e3]}


def test_the_time_is_that_of_the_drives_to_fit_and_holds_for_those_held_out() -> None:
    tool = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "rotors.py"))
    assert tool["mean_spin_up"]() == pytest.approx(rotors.SPIN_UP, rel=0.01)
    held_out = [tool["spin_up"](x) / rotors.SPIN_UP for x in tool["PUBLISHED"] if x.part == "held-out"]
    off = np.maximum(held_out, np.reciprocal(held_out))
    assert np.mean(off <= rotors.SCATTER) >= 0.9
    assert off.max() < 4.0
    fitted = {x.robot for x in tool["PUBLISHED"] if x.part == "fit"}
    assert not fitted & {x.robot for x in tool["PUBLISHED"] if x.part == "held-out"}


def test_what_nothing_tells_is_believed_and_what_somebody_tells_is_not() -> None:
    arm = rotors.assume_rotors(UR5)
    np.testing.assert_allclose(arm.armature, rotors.SPIN_UP * UR5.limits.effort / UR5.limits.velocity)
    assert rotors.assumed_joints(arm) == UR5.joint_names
    assert "wrist_3_joint 0.2" in rotors.describe(arm)
    told = UR5.with_armature({"elbow_joint": 0.7})
    assert rotors.assume_rotors(told).armature[2] == 0.7
    assert "elbow_joint" not in rotors.assumed_joints(rotors.assume_rotors(told))
    none = rotors.without_rotors(UR5)
    assert rotors.assume_rotors(none) is none
    assert rotors.told_none(none) == UR5.joint_names
    with pytest.warns(ArmgpiWarning, match="specified to have no rotor"):
        GPI.auto(none, 1e-3)
    paper = Robot.load("anthropomorphic3")  # its file says that it has none
    assert rotors.assume_rotors(paper) is paper
    assert not rotors.told_none(paper)


def test_an_arm_without_the_rotors_that_its_law_believes_is_warned_of() -> None:
    law, move = GPI.auto(UR5, 1e-3), Hold(UR5.middle())
    with pytest.warns(ArmgpiWarning, match="the controller assumes rotor inertia in shoulder_pan_joint"):
        simulate(RigidBodyPlant(UR5), law, move, 2e-3)
    for arm in (rotors.assume_rotors(UR5), UR5.with_armature(0.1), rotors.without_rotors(UR5)):
        assert not rotors.unlike(law.robot, arm)


@pytest.mark.parametrize("effort", [0.0, 1000.0, math.inf])
def test_limits_that_no_motor_has_say_nothing(effort: float) -> None:
    believed = rotors.typical_inertia(UR5.with_limits(effort=effort))
    assert (believed > 0.0).all()
    assert believed.max() < 5.0


@pytest.mark.parametrize("velocity", ["0", "1e-308", "1e-5", "100"])
def test_velocities_that_no_motor_has_say_nothing(velocity: str) -> None:
    file = (Path(__file__).parents[2] / "urdf" / "anthropomorphic3.urdf").read_text(encoding="utf-8")
    texts = [re.sub('velocity="[^"]*"', f'velocity="{x}"', file) for x in (velocity, "1000")]
    told, nothing = (rotors.typical_inertia(Robot.from_xml(text)) for text in texts)
    np.testing.assert_array_equal(told, nothing)


@pytest.mark.parametrize("arm", [PANDA, UR5], ids=["panda", "ur5"])
def test_a_law_from_the_bare_file_holds_the_arm_with_its_rotors(arm: Robot) -> None:
    gears = two_mass.Gears(np.array(ROTORS[arm]))
    held = {}
    for name in (None, "stiff", "none"):
        with pytest.warns(ArmgpiWarning) if name == "none" else nullcontext():
            law = GPI.auto(arm, 1e-3, delay=1e-3, bits=16, drives=name)
        held[name] = sum(
            two_mass.ArmLoop(arm, q, gears, 1e-3, 1).growth(two_mass.law(law, q)) < 1.0
            for q in random_configurations(arm, 8, seed=0)
        )
    assert held == {None: 8, "stiff": 8, "none": 0}


def test_a_stiff_gear_is_no_gear() -> None:
    q, rotor = UR5.middle(), np.array(ROTORS[UR5])
    law = two_mass.law(GPI.auto(UR5, 1e-3, delay=1e-3, bits=16, drives="stiff"), q)
    rigid = two_mass.ArmLoop(UR5, q, two_mass.Gears(rotor), 1e-3, 1).growth(law)
    off = []
    for factor in (1e3, 1e4):
        stiff = two_mass.Gears(rotor, factor * np.array(GEARS[UR5]))
        off.append(abs(two_mass.ArmLoop(UR5, q, stiff, 1e-3, 1).growth(law) - rigid))
    assert off[1] < 0.15 * off[0] < 1e-4


def test_what_is_believed_is_a_word_and_is_believed_once() -> None:
    soft = assume_drives(UR5)
    assert set(soft.drives.sources("stiffness")) == {"assumed"}
    assert assume_drives(soft) is soft
    stiff = assume_drives(UR5, "stiff")
    assert assume_drives(stiff) is stiff  # of which somebody decided that its gears are stiff
    assert not stiff.drives.data.get("stiffness")
    assert not assume_drives(UR5, "none").armature.any()
    told = UR5.with_armature(0.2)  # rotors alone say nothing of gears
    assert set(assume_drives(told).drives.sources("stiffness")) == {"assumed"}
    assert assume_drives(told, "stiff") is told
    paper = Robot.load("anthropomorphic3")  # no rotor, no gear
    assert assume_drives(paper) is paper
    with pytest.raises(ParameterError, match="elastic, stiff, none"):
        assume_drives(UR5, "loose")


@pytest.mark.parametrize("left_open", ["offset", "viscous", "rotor_inertia"])
def test_joints_of_an_identified_arm_are_elastic_whatever_its_logs_leave_open(left_open: str) -> None:
    drives = UR5.drives.with_value("rotor_inertia", np.full(6, 0.5), source="identified")
    open_number = UR5.drives.with_value(left_open, {UR5.joint_names[0]: 0.3}, source="assumed")
    assumed = assume_drives(UR5.with_drives(drives.updated(open_number)))
    assert set(assumed.drives.sources("stiffness")) == {"assumed"}


def test_joints_of_an_arm_with_torque_sensors_are_elastic_though_all_its_rotors_stay_assumed() -> None:
    rotor = assume_drives(UR5, "stiff").drives
    hidden = UR5.with_drives(rotor.with_value("coulomb", np.full(6, 1.0), source="assumed"))
    assert set(assume_drives(hidden).drives.sources("stiffness")) == {"assumed"}
    np.testing.assert_array_equal(assume_drives(hidden).armature, hidden.armature)


@pytest.mark.filterwarnings("ignore::armgpi.errors.ArmgpiWarning")
def test_a_gear_twists_by_an_angle_and_a_belt_stretches_by_a_length_under_the_limit() -> None:
    panda = Robot.load("panda")
    twist = panda.limits.effort / assume_drives(panda).drives.value("stiffness")
    expected = [2e-3 if "finger" in joint else 8e-3 for joint in panda.joint_names]
    np.testing.assert_allclose(twist, expected, rtol=1e-12)


@pytest.mark.parametrize("drives", [None, "elastic", "stiff", "none"])
@pytest.mark.parametrize("inertia", [None, 0.3], ids=["silent", "told"])
@pytest.mark.filterwarnings("ignore:.*specified to have no rotor")
def test_what_an_experiment_writes_is_what_it_had(drives: str | None, inertia: float | None) -> None:
    robot = {"name": "ur5", "drives": drives, "rotor_inertia": inertia}
    data = {"robot": robot, "controllers": [{"type": "gpi_auto"}], "t_final": 1.0}
    made = config.build(config.check(data, config.Origin()))
    again = config.build(config.check(made.config.plain(given=True), config.Origin()))
    assert again.robot.drives.data == made.robot.drives.data
    assert type(again.plant) is type(made.plant)
    assert again.config.controllers == made.config.controllers
    direct = GPI.auto(UR5 if inertia is None else UR5.with_armature(inertia), 1e-3, drives=drives)
    laws: list[Any] = [direct, made.controllers["gpi_auto"], again.controllers["gpi_auto"]]
    for law in laws[1:]:
        np.testing.assert_array_equal(law.gains.nominal(), laws[0].gains.nominal())
        assert (law.rotor_factor, law.rolloff) == (laws[0].rotor_factor, laws[0].rolloff)


def test_an_experiment_with_the_rule_simulates_what_it_believes_and_writes_it_down() -> None:
    data = {"robot": {"name": "ur5"}, "controllers": [{"type": "gpi_auto"}], "t_final": 1.0}
    made = config.build(config.check(data, config.Origin()))
    real: Any = made.plant.robot
    np.testing.assert_array_equal(real.armature, rotors.assume_rotors(UR5).armature)
    again = config.build(config.check(made.config.plain(), config.Origin()))
    np.testing.assert_array_equal(again.robot.armature, made.robot.armature)
    assert rotors.assumed_joints(again.robot) == UR5.joint_names
    data["controllers"] = [{"type": "gpi"}]
    assert not config.build(config.check(data, config.Origin())).robot.armature.any()
    data["robot"] = {"name": "ur5", "drives": "stiff"}
    assert config.build(config.check(data, config.Origin())).robot.armature.all()


def test_the_gear_ratio_that_is_assumed_behind_encoders_at_motors_is_said() -> None:
    arm = assume_drives(UR5)
    assert rotors.describe_ratio(arm) == ""
    motor = arm.with_drives({joint: {"encoder_side": "motor"} for joint in arm.joint_names})
    assert "of all joints is not specified; 100 is assumed" in rotors.describe_ratio(motor)
    assert rotors.joints_with_assumed_ratio(motor) == "all joints"
    first, *others = arm.joint_names
    known = motor.with_drives({joint: {"gear_ratio": 101.0} for joint in others})
    assert f"of {first} is not specified" in rotors.describe_ratio(known)
    assert rotors.joints_with_assumed_ratio(known.with_drives({first: {"gear_ratio": 50.0}})) == ""
