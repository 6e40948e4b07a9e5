"""Drives: what is known of rotors, gears, motors and encoders, from files, URDFs and Python."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import numpy as np
import pytest

import armgpi
from armgpi import Robot, config
from armgpi.errors import ArmgpiError, ConfigError
from armgpi.robot.drives import QUANTITIES, Drives

ARM = Robot.load("anthropomorphic3")
FILE = """
q1: {gear_ratio: 100, motor_inertia: 2e-5, coulomb: 0.5}
q2:
  viscous: 0.25
  rotor_inertia: {value: 0.1, low: 0.05, high: 0.2, source: assumed}
  stiffness: {value: 1.0e+4, source: identified, file: log.nc}
  encoder_side: motor
"""


def write(folder: Path, text: str) -> Path:
    """Write a file of drives."""
    path = folder / "drives.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_interval_and_the_source_of_a_motor_inertia_are_reflected_as_well() -> None:
    motor = {"value": 2e-5, "low": 1e-5, "high": "4e-5", "source": "identified", "file": "sheet.pdf"}
    drives = Drives.from_plain(
        {
            "q1": {"motor_inertia": motor, "gear_ratio": 100},
            "q2": {"motor_inertia": 2e-5, "gear_ratio": {"value": 100, "low": 90, "high": 110}},
            "q3": {"motor_inertia": motor},
        }
    )
    low, high = drives.interval("rotor_inertia")
    assert drives.value("rotor_inertia") == pytest.approx([0.2, 0.2, 2e-5])
    assert low == pytest.approx([0.1, 0.162, 1e-5])
    assert high == pytest.approx([0.4, 0.242, 4e-5])
    assert drives.sources("rotor_inertia") == ("identified", "specified", "identified")
    assert drives.data["rotor_inertia"]["q1"].file == "sheet.pdf"
    assert drives.interval("gear_ratio")[0][:2] == pytest.approx([100.0, 90.0])
    assert Drives.from_plain(drives.plain()) == drives
    for wrong in ({"value": 2e-5, "low": "few"}, {"value": 2e-5, "low": 3e-5}, {"value": 2e-5, "unit": "g"}):
        with pytest.raises(ConfigError, match=r"q1\.(motor|rotor)_inertia"):
            Drives.from_plain({"q1": {"motor_inertia": wrong, "gear_ratio": 100}})


def test_a_file_says_values_intervals_and_sources(tmp_path: Path) -> None:
    drives = Drives.read(write(tmp_path, FILE), ARM.joint_names)
    np.testing.assert_allclose(drives.value("rotor_inertia", 0.0), [0.2, 0.1, 0.0])
    low, high = drives.interval("rotor_inertia")
    np.testing.assert_allclose([low[:2], high[:2]], [[0.2, 0.05], [0.2, 0.2]])
    assert math.isnan(low[2])
    assert drives.sources("rotor_inertia") == ("specified", "assumed", "")
    assert drives.data["stiffness"]["q2"] == (1e4, 1e4, 1e4, "identified", "log.nc")
    assert drives.value("encoder_side").tolist() == ["", "motor", ""]


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    drives = Drives.read(write(tmp_path, FILE), ARM.joint_names)
    drives.write(tmp_path / "again.yaml")
    assert Drives.read(tmp_path / "again.yaml", ARM.joint_names) == drives


def transmissions(drives: Drives) -> list[Element]:
    """Return a ``<transmission>`` for every joint of which something is known, as a URDF has them."""
    found = []
    for joint, own in drives.plain().items():
        element = Element("transmission", name=f"{joint}_drive")
        SubElement(element, "joint", name=joint)
        for key in own:
            value = str(drives.data[key][joint].value)
            if key == "rotor_inertia":
                actuator = SubElement(element, "actuator", name=f"{joint}_motor")
                SubElement(actuator, "motorInertia").text = value
                SubElement(actuator, "mechanicalReduction").text = "1"
            else:
                SubElement(element, "param", name=f"armgpi:{key}").text = value
        found.append(element)
    return found


def test_transmissions_of_a_urdf_are_read() -> None:
    drives = Drives(ARM.joint_names)
    for name, declared in QUANTITIES.items():
        drives = drives.with_value(name, "link" if declared.kind == "choice" else 0.3)
    text = Path(ARM.provenance["source"]).read_text(encoding="utf-8")
    added = "".join(tostring(each, encoding="unicode") for each in transmissions(drives))
    loaded = Robot.from_xml(text.replace("</robot>", f"{added}</robot>"))
    for name in QUANTITIES:
        assert loaded.drives.value(name).tolist() == drives.value(name).tolist()
    np.testing.assert_array_equal(loaded.armature, 0.3)
    assert loaded.drives.data["stiffness"]["q1"].file == "URDF text"


def test_what_a_transmission_says_wrongly_is_named() -> None:
    said = "<joint name='q1'/><param name='armgpi:stiffness'>soft</param>"
    root = fromstring(f"<robot><transmission>{said}</transmission></robot>")
    with pytest.raises(ArmgpiError, match="armgpi:stiffness> is 'soft'"):
        Drives.from_urdf(root, "arm", ("q1",))


def test_an_arm_has_the_drives_that_it_was_told(tmp_path: Path) -> None:
    drives = Drives.read(write(tmp_path, FILE), ARM.joint_names)
    before = ARM.drives.plain()
    robot = ARM.with_drives(drives.with_value("torque_limit", {"q1": 2.0}))
    np.testing.assert_allclose(robot.armature, [0.2, 0.1, 0.0])
    np.testing.assert_allclose(robot.friction.viscous, [0.0, 0.25, 0.0])
    np.testing.assert_allclose(robot.friction.coulomb, [0.5, 0.0, 0.0])
    np.testing.assert_allclose(robot.limits.effort, [2.0, *ARM.limits.effort[1:]])
    assert robot.drives.data["stiffness"]["q2"].source == "identified"
    # Its file says that it has no rotors, and nothing else of its drives.
    assert ARM.drives.plain() == before
    assert {name: set(own) for name, own in before.items()} == {key: {"rotor_inertia"} for key in before}
    assert list(before) == list(ARM.joint_names)


def test_edits_of_an_arm_are_in_its_drives() -> None:
    robot = ARM.with_armature({"q2": 0.4}).with_friction(viscous=0.2)
    assert robot.drives.sources("rotor_inertia") == ("specified", "specified", "specified")
    own = robot.drives.data["rotor_inertia"]
    assert [bool(own[name].file) for name in ARM.joint_names] == [True, False, True]
    assert robot.scaled_inertia(2.0).drives.value("rotor_inertia", 0.0).tolist() == [0.0, 0.8, 0.0]
    assert robot.drives.value("viscous").tolist() == [0.2, 0.2, 0.2]
    assert robot.varied(payload=[0.0, 1.0]).drives == robot.drives


def test_drives_are_of_the_nominal_model_and_of_the_plant_which_may_have_others() -> None:
    wanted: dict[str, Any] = {
        "robot": {
            "name": "anthropomorphic3",
            "drives": {"q1": {"rotor_inertia": 0.2}, "q2": {"viscous": 0.25}},
        },
        "plant": {"drives": {"q1": {"rotor_inertia": 0.3, "stiffness": 5e3}}, "friction": "urdf"},
    }
    built = config.build(config.check(wanted, config.Origin("test")))
    nominal, real = built.controllers["gpi"].robot, built.plant.robot
    assert isinstance(nominal, Robot)
    assert isinstance(real, Robot)
    assert (nominal.armature[0], real.armature[0]) == (0.2, 0.3)
    assert (nominal.friction.viscous[1], real.friction.viscous[1]) == (0.25, 0.25)
    assert real.drives.value("stiffness", 0.0)[0] == 5e3
    assert config.check(config.parse(config.dump(built.config), "x").config.plain(), config.Origin("x"))


def test_rotor_inertia_that_is_given_besides_comes_on_top() -> None:
    section = {
        "name": "anthropomorphic3",
        "drives": {"q1": {"rotor_inertia": 0.2}},
        "rotor_inertia": {"q1": 0.4},
    }
    robot = config.robot(config.check({"robot": section}, config.Origin("test")))
    assert robot.armature[0] == 0.4


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("q1: {gear: 3}", r"q1\.gear.*'gear_ratio'"),
        ("q1: {motor_inertia: -1}", r"q1\.motor_inertia"),
        ("q1: {gear_ratio: 0}", r"q1\.gear_ratio"),
        ("q1: {motor_inertia: 1, rotor_inertia: 1}", "are mutually exclusive"),
        ("q1: {stiffness: soft}", r"q1\.stiffness.*soft"),
        ("q1: {stiffness: .nan}", r"q1\.stiffness"),
        ("q1: {stiffness: {value: 1, low: 2, high: 3}}", "low <= value <= high"),
        ("q1: {stiffness: {low: 2}}", "a value"),
        ("q1: {stiffness: {value: 2, unit: N}}", "unit"),
        ("q1: {stiffness: {value: 2, source: guess}}", "specified, assumed, identified"),
        ("q1: {encoder_side: left}", "motor, link"),
        ("q9: {stiffness: 1}", "q9"),
        ("q1: 3", "q1: expected a mapping"),
        ("[1, 2]", "joint -> its drive"),
        ("{", "is not valid YAML"),
    ],
)
def test_a_bad_file_of_drives_is_named(tmp_path: Path, text: str, named: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError, match=named):
        Drives.read(path, ARM.joint_names)
    with pytest.raises(ConfigError, match="nowhere"):
        Drives.read(tmp_path / "nowhere.yaml")


def test_a_bad_drive_of_an_experiment_is_named_with_its_line() -> None:
    text = "robot:\n  name: anthropomorphic3\n  drives:\n    q1: {stiffnes: 3.0}\n"
    loaded = config.parse(text, "x.yaml")
    with pytest.raises(ConfigError, match=r"x\.yaml:4: robot\.drives\.q1\.stiffnes.*'stiffness'"):
        config.build(*loaded)


def test_a_mimicked_joint_has_the_drive_of_its_leader() -> None:
    assert armgpi.Robot.load("panda", mimic="follow").drives.joint_names[-1] == "panda_finger_joint1"
