"""What is written wrongly and can mean one thing alone is repaired on request, and never silently."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from armgpi import GPI, ArmgpiError, Bezier, RigidBodyPlant, Robot, health, simulate
from armgpi.errors import NameNotFound, ParameterError, Remedy, UrdfError
from armgpi.robot.urdf import bad_numbers
from armgpi.viewing import scene

INERTIAL = (
    '<inertial><origin xyz="{com}"/><mass value="{mass}"/>'
    '<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>'
)
BODY = INERTIAL.format(com="0.1 0 0.02", mass=1.5, i=0.02)
#: As PyBullet's Panda has it: a flange of mass 0 with an inertia.
FLANGE = INERTIAL.format(com="0 0 0", mass=0, i=0.1)
WELD = '<joint name="weld" type="fixed"><parent link="fore"/><child link="flange"/>{}</joint>'
ORIGIN = '<origin xyz="0 0 0.1" rpy="1.57 1.30 1.57"/>'


def arm(base: str = "", flange: str = "", weld: str = ORIGIN, upper: str = "0 0 1", limit: str = "") -> str:
    """Return an arm of two joints with a flange."""
    return f"""<robot name="arm"><link name="base">{base}</link>
<link name="upper">{BODY}</link><link name="fore">{BODY}</link><link name="flange">{flange}</link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/>
<axis xyz="{upper}"/>{limit}</joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="20" velocity="3"/></joint>
{WELD.format(weld)}</robot>"""


COMMAS = '<origin xyz="0 0 0.1" rpy="1.57, 1.30 1.57"/>'
SOUND = Robot.from_xml(arm())
TWO = arm(flange=FLANGE, weld=COMMAS)
NAMES = ("drop-inertia:flange", "split-commas:weld")
#: What is wrong -> the file, and the repair.
BROKEN = {
    "an inertia but no mass": (arm(flange=FLANGE), "drop-inertia:flange"),
    "commas and spaces between numbers": (arm(weld=COMMAS), "split-commas:weld"),
    "commas alone between numbers": (arm(upper="0,0,1"), "split-commas:shoulder"),
    "a comma at the end": (arm(upper="0 0 1,"), "split-commas:shoulder"),
}


def same_arm(robot: Robot, other: Robot) -> None:
    """Assert that two robots have the same kinematics and dynamics, to the last bit."""
    q = robot.random_positions(5, seed=3)
    np.testing.assert_array_equal(robot.mass_matrix(q), other.mass_matrix(q))
    np.testing.assert_array_equal(robot.gravity(q), other.gravity(q))
    pose, same = robot.frame_pose("flange", q), other.frame_pose("flange", q)
    np.testing.assert_array_equal(pose.rotation, same.rotation)
    np.testing.assert_array_equal(pose.translation, same.translation)


@pytest.mark.parametrize(("text", "name"), BROKEN.values(), ids=BROKEN)
def test_the_refusal_names_the_repair_and_with_it_the_arm_is_the_one_that_was_meant(
    text: str, name: str
) -> None:
    with pytest.raises(UrdfError) as caught:
        Robot.from_xml(text)
    assert caught.value.remedies == (Remedy("repair", (), name),)
    assert repr(name) in str(caught.value)
    assert caught.value.element == name.partition(":")[2]
    for repair in (name, [name], name.partition(":")[0], "all", f"all,{name}"):
        robot = Robot.from_xml(text, repair=repair)
        same_arm(robot, SOUND)
        (made,) = robot.provenance["repairs"]
        assert made["name"] == name


def test_the_provenance_says_what_was_there_before() -> None:
    drop, split = Robot.from_xml(TWO, repair=NAMES).provenance["repairs"][::-1]
    assert drop == {
        "name": NAMES[0],
        "before": "mass 0, inertia 0.1 0.0 0.0 0.1 0.0 0.1",
        "after": "a frame, without inertia",
    }
    assert split == {"name": NAMES[1], "before": "rpy='1.57, 1.30 1.57'", "after": "rpy='1.57 1.30 1.57'"}


def test_a_sound_file_is_not_touched_whatever_may_be_repaired() -> None:
    robot = Robot.from_xml(arm(), repair="all")
    assert robot.provenance == SOUND.provenance
    same_arm(robot, SOUND)


def test_a_link_that_does_not_move_needs_no_repair() -> None:
    assert "repairs" not in Robot.from_xml(arm(base=FLANGE), repair="all").provenance


@pytest.mark.parametrize(
    "numbers",
    ["0,1 0,2 0,3", "0,1 0", "0,5 1,5 2", "0,1", "0;0;1", "0, 0, x", "0, 0, nan", "0,0,0,1", "(0,0,1)"],
)
def test_what_may_mean_something_else_is_not_repaired(numbers: str) -> None:
    # Decimal commas, another count, other characters.
    with pytest.raises(UrdfError) as caught:
        Robot.from_xml(arm(upper=numbers), repair="all")
    assert not caught.value.remedies


@pytest.mark.parametrize(
    ("numbers", "hint"),
    [
        ("1.57, 1.30 1.57", "separate numbers by spaces, not by commas"),
        ("0,0,1", "separate numbers by spaces, not by commas"),
        ("0,5 1,5 2,5", "write 1.5, not 1,5"),
    ],
)
def test_the_hint_tells_separators_from_decimal_commas(numbers: str, hint: str) -> None:
    with pytest.raises(UrdfError, match=hint):
        Robot.from_xml(arm(upper=numbers))


@pytest.mark.parametrize("name", ["drop-inertias", "drop-inertia:flnge", "all:flange", "fix"])
def test_a_repair_that_does_not_exist_is_refused(name: str) -> None:
    with pytest.raises(NameNotFound):
        Robot.from_xml(arm(flange=FLANGE), repair=name)


@pytest.mark.parametrize("bad", [5, [5], None])
def test_what_is_no_name_of_a_repair_is_refused(bad: Any) -> None:
    with pytest.raises(ParameterError, match="repair"):
        Robot.from_xml(arm(), repair=bad)


def test_inspect_names_exactly_the_repairs_that_make_a_file_load(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(TWO, encoding="utf-8")
    with pytest.raises(UrdfError) as caught:
        health.inspect(path)
    ((kind, _, value),) = caught.value.remedies
    assert kind == "repair"
    needed = str(value).split(",")
    assert sorted(needed) == sorted(NAMES)
    same_arm(Robot.load(path, repair=needed), SOUND)
    for fewer in combinations(needed, len(needed) - 1):
        with pytest.raises(UrdfError) as again:
            Robot.load(path, repair=fewer)
        (left,) = set(needed) - set(fewer)
        assert again.value.remedies == (Remedy("repair", (), left),)


def test_where_no_repair_helps_inspect_reports_what_none_can_mend(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(TWO.replace('upper="2"', 'upper="-2"'), encoding="utf-8")
    with pytest.raises(UrdfError, match="lower limit -1 above its upper -2") as caught:
        health.inspect(path)
    assert not caught.value.remedies


def test_a_repaired_robot_is_reported_as_one(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(TWO, encoding="utf-8")
    report = health.inspect(path, repair="all")
    found = {f.where: f for f in report.findings if f.kind == "repair"}
    assert {where: f.value for where, f in found.items()} == {
        "link 'flange'": NAMES[0],
        "joint 'weld'": NAMES[1],
    }
    assert "mass 0, inertia 0.1" in found["link 'flange'"].message
    assert [made["name"] for made in report.as_dict()["repairs"]] == list(NAMES[::-1])


@pytest.mark.parametrize("missing", ["mass", "inertia"])
def test_a_base_without_mass_or_inertia_is_a_warning_as_nothing_feels_it(
    missing: str, tmp_path: Path
) -> None:
    start = BODY.index(f"<{missing} ")
    base = BODY[:start] + BODY[BODY.index("/>", start) + 2 :]
    path = tmp_path / "arm.urdf"
    path.write_text(arm(base=base), encoding="utf-8")
    report = health.inspect(path)
    same_arm(report.robot, SOUND)
    assert report.robot.total_mass == SOUND.total_mass + (1.5 if missing == "inertia" else 0.0)
    (found,) = (f for f in report.findings if f.level != "info")
    assert (found.level, found.kind, found.where) == ("warning", "inertia", "link 'base'")
    assert f"without <{missing}>" in found.message
    with pytest.raises(UrdfError, match=f"link 'flange' has an <inertial> without <{missing}>"):
        Robot.from_xml(arm(flange=base), repair="all")


@pytest.mark.parametrize("written", ["inf", "Infinity", "1e400"])
def test_an_infinite_effort_of_a_continuous_joint_is_a_warning(written: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(arm(limit=f'<limit effort="{written}" velocity="{written}"/>'), encoding="utf-8")
    report = health.inspect(path)
    assert report.robot.limits.effort[0] == report.robot.limits.velocity[0] == math.inf
    (found,) = (f for f in report.findings if f.level != "info")
    assert (found.level, found.kind, found.where) == ("warning", "effort", "joint 'shoulder'")
    with pytest.raises(UrdfError, match="not finite"):
        Robot.from_xml(arm(limit='<limit effort="nan" velocity="1"/>'))


def test_the_command_line_names_all_repairs_and_makes_them(tmp_path: Path, cli: Callable[..., Any]) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(TWO, encoding="utf-8")
    code, out, err = cli("inspect", path)
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    option = line[line.rindex("(") + 1 : -1]
    assert option == f"--repair {NAMES[1]},{NAMES[0]}"
    assert cli("inspect", path, *option.split())[0] == 0
    data = json.loads(cli("inspect", path, "--repair", "all", "--json")[1])
    assert {made["name"] for made in data["repairs"]} == set(NAMES)


def test_an_experiment_keeps_the_repairs_and_its_rollout_finds_its_robot(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    path, out = tmp_path / "arm.urdf", tmp_path / "out"
    path.write_text(TWO, encoding="utf-8")
    short = ("--to", "elbow=0.6", "--duration", "0.1", "--t-final", "0.2", "--effort", "30")
    code, _, err = cli("run", path, *short, "--repair", NAMES[1])
    assert code == 2
    assert f"--repair {NAMES[0]}" in err
    assert cli("run", path, *short, "--repair", ",".join(NAMES), "--out", out)[0] == 0
    assert cli("run", "--config", out / "experiment.yaml")[0] == 0
    assert cli("view", out / "rollout.nc", "-o", tmp_path / "arm.html")[0] == 0
    assert cli("view", path, "--repair", "all", "-o", tmp_path / "arm.html")[0] == 0
    code, _, err = cli("run", path, *short, "--repair", "drop-inertia:flnge")
    assert code == 2
    assert "--repair: there is no link or joint to repair named 'flnge'; did you mean 'flange'" in err


def test_a_rollout_of_a_repaired_robot_loads_the_same_one(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(TWO, encoding="utf-8")
    robot = Robot.load(path, repair="all").with_limits(effort=30.0)
    goal = Bezier([0.0, 0.5], [0.0, 0.6], 0.1)
    rollout = simulate(RigidBodyPlant(robot), GPI(robot, 1e-3), goal, t_final=0.1, progress=False)
    same_arm(scene.robot_of(rollout), SOUND)
    path.write_text(arm(), encoding="utf-8")
    with pytest.raises(ArmgpiError, match="has changed"):
        scene.robot_of(rollout)


@pytest.mark.parametrize("efforts", [(2.0, 40.0), (40.0, 400.0)])
def test_bodies_that_are_supposed_are_rods_to_the_next_joint_that_the_motors_hold(
    efforts: tuple[float, float],
) -> None:
    limit = '<limit lower="-1" upper="2" effort="{}" velocity="3"/>'
    shoulder, elbow = map(limit.format, efforts)
    robot = Robot.from_xml(
        f"""<robot name="bare"><link name="base"/><link name="upper"/><link name="fore"/><link name="tip"/>
        <joint name="s" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
        {shoulder}</joint>
        <joint name="e" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0.4 0"/>
        <axis xyz="0 1 0"/>{elbow}</joint>
        <joint name="t" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="0 0 0.25"/>
        </joint></robot>""",
        repair="assume-bodies",
    )
    reach, total = 0.75, min(28.0 * 0.75**2, max(efforts) / (3.0 * 0.4) / (9.81 * 0.75))
    share = (0.5 + 0.05 * reach) / (reach + 2.0 * 0.05 * reach)
    rods = (([0.3, 0.4, 0.0], share * total), ([0.0, 0.0, 0.25], (1.0 - share) * total))
    for body, (rod, mass) in zip(robot._model.inertias[1:], rods, strict=True):
        assert body.mass == pytest.approx(mass, rel=1e-9)
        np.testing.assert_allclose(body.lever, 0.5 * np.array(rod), atol=1e-12)
        moment = mass * (np.dot(rod, rod) / 12.0 + (0.05 * reach) ** 2)
        np.testing.assert_allclose(body.inertia, moment * np.eye(3), rtol=1e-9, atol=1e-12)


def test_a_size_is_positive_but_that_of_a_mesh_which_may_be_mirrored() -> None:
    for text, key, count, wrong in (
        ('<sphere radius="0"/>', "radius", 1, "not positive"),
        ('<box size="1 -1 2"/>', "size", 3, "not positive"),
        ('<mesh scale="1 0 1"/>', "scale", 3, "is 0"),
        ('<mesh scale="1 -1 1"/>', "scale", 3, ""),
    ):
        said = bad_numbers(ElementTree.fromstring(text), key, count, positive=True)
        assert said.endswith(wrong)
        assert bool(said) == bool(wrong)


def test_macros_of_xacro_are_not_called_a_robot_without_links() -> None:
    text = '<robot name="m" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="arm"/></robot>'
    with pytest.raises(UrdfError, match="defines macros of xacro for other files: expand the one"):
        Robot.from_xml(text)
