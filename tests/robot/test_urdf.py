"""URDF text to a model: what is read, what is locked, and what is refused before Pinocchio sees it.

Pinocchio accepts most of the files refused here, with masses of zero or another tree than the one
written, so each test changes one thing in a good file and asks for our error with the element's name.
"""

from __future__ import annotations

import gzip
import os
import warnings
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from armgpi import ArmgpiWarning, Robot
from armgpi.errors import ArmgpiError, ArrayError, NameNotFound, UrdfError
from armgpi.robot import markup, urdf, urdf_model
from armgpi.robot.urdf import MAX_BYTES, MAX_JOINTS
from armgpi.robot.urdf_model import MAX_MOVING_JOINTS

#: Of products of a few rotations and lengths below 1 m: some 50 times 2.2e-16.
ROUNDING = 1e-14
BODY = (
    '<inertial><origin xyz="0.1 0 0" rpy="0 0 0"/><mass value="1.0"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
)
MASS, INERTIA = '<mass value="1.0"/>', BODY[BODY.index("<inertia ") : BODY.index("</inertial>")]
ELBOW = (
    '<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>'
    '<origin xyz="0.2 0 0" rpy="0 0 0"/><axis xyz="0 1 0"/>'
    '<limit lower="-1.5" upper="2.5" effort="20" velocity="3"/>'
    '<dynamics damping="0.5" friction="0.25"/></joint>'
)
LIMIT = ELBOW[ELBOW.index("<limit") : ELBOW.index("<dynamics")]
GOOD = f"""<robot name="arm">
<link name="base"/>
<link name="upper">{BODY}</link>
<link name="fore">{BODY}</link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/></joint>
{ELBOW}
</robot>
"""
WRIST = ELBOW.replace('"elbow"', '"wrist"').replace('"fore"', '"hand"').replace('"upper"', '"fore"')
THREE = GOOD.replace("</robot>", f'<link name="hand">{BODY}</link>{WRIST}</robot>')


def changed(*replacements: tuple[str, str], text: str = GOOD) -> str:
    """Return the good URDF with the last place where each old text stands changed."""
    for old, new in replacements:
        assert old in text, old
        head, _, tail = text.rpartition(old)
        text = head + new + tail
    return text


def refusal(text: str, **options: Any) -> UrdfError:
    """Return the error with which a URDF is refused."""
    with pytest.raises(UrdfError) as caught:
        Robot.from_xml(text, **options)
    assert isinstance(caught.value, ArmgpiError)
    assert str(caught.value).startswith(caught.value.source)
    return caught.value


# --- What is read --------------------------------------------------------------------------------


def test_limits_types_and_friction_are_those_of_the_file() -> None:
    robot = Robot.from_xml(GOOD)
    assert robot.name == "arm"
    assert robot.joint_names == ("shoulder", "elbow")
    assert robot.joint_types == ("continuous", "revolute")
    np.testing.assert_array_equal(robot.limits.lower, [-np.inf, -1.5])
    np.testing.assert_array_equal(robot.limits.upper, [np.inf, 2.5])
    np.testing.assert_array_equal(robot.limits.velocity, [np.inf, 3.0])
    np.testing.assert_array_equal(robot.limits.effort, [np.inf, 20.0])
    np.testing.assert_array_equal(robot.friction.viscous, [0.0, 0.5])
    np.testing.assert_array_equal(robot.friction.coulomb, [0.0, 0.25])


def test_the_axis_and_origin_of_a_joint_default_as_the_urdf_specification_says() -> None:
    spelled_out = changed(
        ('link="upper"/></joint>', 'link="upper"/><origin xyz="0 0 0"/><axis xyz="1 0 0"/></joint>')
    )
    q = [0.3, -0.4]
    np.testing.assert_array_equal(
        Robot.from_xml(GOOD).mass_matrix(q), Robot.from_xml(spelled_out).mass_matrix(q)
    )


@pytest.mark.parametrize(
    ("plain", "odd"),
    [
        ('xyz="0 1 0"', 'xyz="0 2 0"'),  # an axis need not have unit length
        ('value="1.0"', 'value=" 1.0 "'),  # urdfdom drops an inertia that ends in a space
        ('izz="0.01"', 'izz="0.01\n"'),
        ('iyy="0.01"', 'iyy="1e-2&#9;"'),
        ('xyz="0.1 0 0"', 'xyz="\t0.1\n 0  0 "'),
        ('xyz="0.2 0 0"', 'xyz="+.2 0. -0"'),
    ],
)
def test_a_number_means_the_same_however_it_is_written(plain: str, odd: str) -> None:
    assert plain in THREE
    robot, same = Robot.from_xml(THREE), Robot.from_xml(THREE.replace(plain, odd))
    assert same.total_mass == robot.total_mass == 3.0
    q = [0.3, -0.4, 0.5]
    np.testing.assert_allclose(same.mass_matrix(q), robot.mass_matrix(q), rtol=1e-15)


def test_a_robot_without_a_name_a_comment_and_foreign_elements_are_no_obstacle() -> None:
    text = changed(
        ('<robot name="arm">', '<?xml version="1.0" encoding="latin-1"?><!-- é --><robot>'),
        ("</robot>", '<gazebo><mass value="heavy"/></gazebo><transmission name="t"/></robot>'),
    )
    np.testing.assert_array_equal(
        Robot.from_xml("\ufeff" + text).mass_matrix([0.1, 0.2]), Robot.from_xml(GOOD).mass_matrix([0.1, 0.2])
    )


def test_definitions_of_xacro_that_nothing_uses_are_not_read() -> None:
    plain = urdf.parse(GOOD, "plain")
    for left in (
        '<xacro:property name="m" value="${2 * k}"/>',
        '<xacro:arg name="prefix" default=""/>',
        '<xacro:macro name="wheel" params="side"><link name="${side}"/></xacro:macro>',
    ):
        read = urdf.parse(GOOD.replace("<link", f"{left}<link", 1), "left")
        assert (read.links, read.joints) == (plain.links, plain.joints)


def test_a_name_that_xacro_has_to_fill_in_is_refused_with_its_line() -> None:
    text = GOOD.replace("<link name", '\n\n\n<link name="${side}_tool"/><link name', 1)
    line = 1 + text[: text.index("${side}")].strip().count("\n")
    with pytest.raises(UrdfError, match=rf"line {line} has name='\$\{{side\}}_tool'"):
        urdf.parse(text, "arm")


def test_namespaces_and_the_word_xacro_alone_are_no_obstacle() -> None:
    # Drake's files have a namespace, expanded ones keep xacro's, old ones have prefixes without any.
    for attributes in ('xmlns="http://drake.mit.edu"', 'xmlns:xacro="http://www.ros.org/wiki/xacro"'):
        text = changed(('<robot name="arm">', f'<robot name="arm" {attributes}><sensor:camera a="1"/>'))
        assert Robot.from_xml(text).n == 2


def test_a_joint_that_does_not_move_may_say_what_it_likes() -> None:
    weld = '<joint name="weld" type="fixed"><parent link="fore"/><child link="tool"/><axis xyz="0 0 0"/>'
    weld += '<limit lower="x"/><mimic joint="nobody"/><dynamics/></joint>'
    robot = Robot.from_xml(GOOD.replace("</robot>", f'<link name="tool"/>{weld}</robot>'))
    assert robot.n == 2


def test_names_may_be_in_any_script() -> None:
    robot = Robot.from_xml(GOOD.replace("elbow", "côté 肘"))
    assert robot.joint_names == ("shoulder", "côté 肘")


@pytest.mark.parametrize("shape", ['<mesh filename="/nowhere/../x.dae"/>', '<box size="big"/>', ""])
def test_geometry_is_not_looked_at(shape: str) -> None:
    visual = f"<visual><geometry>{shape}</geometry></visual>"
    drawn = GOOD.replace("</link>", f"{visual}{visual.replace('visual', 'collision')}</link>")
    assert Robot.from_xml(drawn).total_mass == 2.0


def test_massless_links_may_hang_on_fixed_joints() -> None:
    tool = (
        '<link name="tool"/><joint name="weld" type="fixed"><parent link="fore"/><child link="tool"/></joint>'
    )
    robot = Robot.from_xml(GOOD.replace("</robot>", f"{tool}</robot>"))
    assert "tool" in robot.frame_names
    assert robot.n == 2


@pytest.mark.parametrize(("joint", "link"), [("wrist", "fore"), ("elbow", "hand")])
def test_a_link_and_a_joint_may_share_a_name_and_the_frame_is_the_links(joint: str, link: str) -> None:
    text = THREE.replace(f'<joint name="{joint}"', f'<joint name="{link}"')
    robot, plain = Robot.from_xml(text), Robot.from_xml(THREE)
    q = [0.3, 0.4, 0.5]
    pose, same = plain.frame_pose(link, q), robot.frame_pose(link, q)
    np.testing.assert_array_equal(same.translation, pose.translation)
    # Pinocchio's own way of locking raises here.
    locked = Robot.from_xml(text, lock={link: 0.5})
    expected = Robot.from_xml(THREE, lock={joint: 0.5})
    np.testing.assert_array_equal(locked.mass_matrix(q[:2]), expected.mass_matrix(q[:2]))


# --- Locking -------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [np.pi / 2, -np.pi / 2, np.pi, 2.0, -7.0, 0.0])
@pytest.mark.parametrize("axis", ["0 1 0", "0 3 0", "1 2 -2"])
def test_a_joint_may_be_locked_at_any_angle_also_where_roll_and_yaw_are_one(axis: str, angle: float) -> None:
    # About y the rotation is pure pitch, singular at 90 degrees. An axis need not have unit length.
    text = THREE.replace('xyz="0 1 0"', f'xyz="{axis}"')
    full, locked = Robot.from_xml(text), Robot.from_xml(text, lock={"elbow": angle})
    pose, same = full.frame_pose("hand", [0.3, angle, 0.5]), locked.frame_pose("hand", [0.3, 0.5])
    np.testing.assert_allclose(same.rotation, pose.rotation, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(same.translation, pose.translation, rtol=0, atol=ROUNDING)


def test_a_joint_without_axis_and_origin_may_be_locked_as_well() -> None:
    full, locked = Robot.from_xml(THREE), Robot.from_xml(THREE, lock={"shoulder": 0.7})
    pose, same = full.frame_pose("hand", [0.7, 0.4, 0.5]), locked.frame_pose("hand", [0.4, 0.5])
    np.testing.assert_allclose(same.rotation, pose.rotation, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(same.translation, pose.translation, rtol=0, atol=ROUNDING)


def test_without_a_value_a_joint_is_locked_at_zero_or_at_the_limit_nearest_to_it() -> None:
    text = THREE.replace('lower="-1.5"', 'lower="0.5"')
    robot = Robot.from_xml(text, lock=["shoulder", "elbow"])
    assert robot.provenance["locked"] == {"shoulder": 0.0, "elbow": 0.5}


def test_keep_locks_all_the_others() -> None:
    kept, locked = Robot.from_xml(THREE, keep=["elbow"]), Robot.from_xml(THREE, lock=["shoulder", "wrist"])
    assert kept.joint_names == locked.joint_names == ("elbow",)
    assert kept.mass_matrix([0.4]) == locked.mass_matrix([0.4])
    assert Robot.from_xml(THREE, keep="elbow").joint_names == ("elbow",)
    mixed = Robot.from_xml(THREE, lock={"wrist": 1.0}, keep=["elbow"])
    assert mixed.provenance["locked"] == {"wrist": 1.0, "shoulder": 0.0}


@pytest.mark.parametrize("options", [{"lock": ["elbw"]}, {"lock": {"elbw": 0.0}}, {"keep": ["elbw"]}])
def test_a_joint_that_does_not_exist_is_refused_and_the_near_one_offered(options: Any) -> None:
    with pytest.raises(NameNotFound, match="did you mean 'elbow'") as caught:
        Robot.from_xml(GOOD, **options)
    assert caught.value.name == "elbw"
    assert caught.value.valid == ("shoulder", "elbow")


def test_a_fixed_joint_is_none_that_can_be_locked() -> None:
    with pytest.raises(NameNotFound, match="no moving joint named 'elbow'"):
        Robot.from_xml(changed(('type="revolute"', 'type="fixed"')), lock=["elbow"])


@pytest.mark.parametrize("value", [np.nan, np.inf, "0.1", True, [0.1, 0.2]])
def test_a_joint_cannot_be_locked_at_what_is_no_finite_number(value: Any) -> None:
    with pytest.raises(ArrayError, match="lock\\['elbow'\\]"):
        Robot.from_xml(GOOD, lock={"elbow": value})


def test_locking_every_joint_leaves_no_robot() -> None:
    assert "no moving joint" in str(refusal(GOOD, lock=["shoulder", "elbow"]))
    assert "no moving joint" in str(refusal('<robot name="r"><link name="base"/></robot>'))


# --- Mimic joints --------------------------------------------------------------------------------

MIMIC = changed(("<dynamics", '<mimic joint="elbow" multiplier="-2" offset="0.1"/><dynamics'), text=THREE)


def test_a_mimic_joint_is_locked_with_a_warning_that_points_at_the_callers_line() -> None:
    with pytest.warns(ArmgpiWarning, match="joint 'wrist' mimics 'elbow'; it is locked at 0.1") as caught:
        robot = Robot.from_xml(MIMIC)
    assert [Path(warning.filename) for warning in caught] == [Path(__file__)]
    assert robot.joint_names == ("shoulder", "elbow")
    assert robot.provenance["locked"] == {"wrist": 0.1}


def test_joints_that_mimic_one_are_told_in_one_warning() -> None:
    thumb = WRIST.replace('"wrist"', '"thumb"').replace('"hand"', '"nail"')
    thumb = thumb.replace("<dynamics", '<mimic joint="elbow"/><dynamics')
    text = MIMIC.replace("</robot>", f'<link name="nail">{BODY}</link>{thumb}</robot>')
    told = "joints wrist, thumb mimic 'elbow'; they are locked at 0.1, 0,"
    with pytest.warns(ArmgpiWarning, match=told) as caught:
        Robot.from_xml(text)
    assert [Path(warning.filename) for warning in caught] == [Path(__file__)]


def test_with_its_leader_locked_a_mimic_joint_stands_where_it_would_have_followed_to() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = Robot.from_xml(MIMIC, lock={"elbow": 0.7})
    assert robot.provenance["locked"] == pytest.approx({"elbow": 0.7, "wrist": 0.1 - 2 * 0.7})


# --- Files ---------------------------------------------------------------------------------------


def file_refusal(path: Path) -> str:
    """Return the message with which a file is refused."""
    with pytest.raises(UrdfError) as caught:
        Robot.load(path)
    assert str(path) in str(caught.value)
    assert caught.value.source == str(path)
    return str(caught.value)


def test_a_file_loads_as_its_text(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(GOOD, encoding="utf-8")
    q = [0.1, 0.2]
    for robot in (Robot.load(path), Robot.load(str(path))):
        np.testing.assert_array_equal(robot.mass_matrix(q), Robot.from_xml(GOOD).mass_matrix(q))
        assert robot.provenance["source"] == str(path)
        assert robot.provenance["sha256"] == Robot.from_xml(GOOD).provenance["sha256"]


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    assert "no such file" in file_refusal(tmp_path / "arm.urdf")
    assert "no such file" in file_refusal(tmp_path / ("a" * 5000 + ".urdf"))


def test_a_folder_is_refused(tmp_path: Path) -> None:
    assert "a folder" in file_refusal(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no FIFOs")
def test_a_fifo_is_refused_instead_of_waited_for(tmp_path: Path) -> None:
    fifo = tmp_path / "arm.urdf"
    os.mkfifo(fifo)
    assert "no regular file" in file_refusal(fifo)


def test_a_device_is_refused_instead_of_read() -> None:
    assert "no regular file" in file_refusal(Path(os.devnull))


def test_a_huge_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)  # takes no room on the disk
    assert f"{MAX_BYTES + 1} bytes" in file_refusal(path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (gzip.compress(GOOD.encode()), "compressed by gzip: unpack it first (gunzip)"),
        (b"PK\x03\x04", "a zip archive"),
        (GOOD.encode("utf-16"), "UTF-16: save it as UTF-8"),
        (GOOD.encode("utf-16-le"), "UTF-16: save it as UTF-8"),
        (b"Rar!\x1a\x07", "a rar archive"),
        (GOOD.encode() + b"\0", "a binary file"),
        (GOOD.replace("arm", "Bähr").encode("latin-1"), "iconv -f LATIN1"),
    ],
)
def test_a_file_of_another_kind_is_refused_with_the_way_on(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(content)
    assert said in file_refusal(path)


@pytest.mark.parametrize(
    "content",
    [GOOD.replace("arm", "Bähr").encode("latin-1"), gzip.compress(GOOD.encode()), b"\x00\xff\xfe"],
    ids=["latin-1", "gzip", "binary"],
)
def test_bytes_that_are_no_utf8_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(content)
    assert "not UTF-8" in file_refusal(path)


# --- XML that is no URDF -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        (" \n", "is empty"),
        ("no XML at all", "not well-formed XML"),
        (GOOD[:-30], "not well-formed XML"),
        ('<robot name="\ud800"/>', "not well-formed XML"),
        ("<mujoco/>", "expected the root element <robot>, got <mujoco>"),
        ("<mujoco/>", "MuJoCo model (MJCF)"),
        ('<?xml version="1.0"?><!-- by hand --><sdf version="1.7"/>', "an SDF model (Gazebo)"),
        ("<COLLADA/>", "a mesh (COLLADA)"),
        ("<launch/>", "a ROS launch file"),
        ("<!DOCTYPE html><html><body><p>404</html>", "a web page (HTML): download the file itself"),
        ("<HTML><br></HTML>", "a web page (HTML)"),
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0", "git lfs pull"),
        ("robot:\n  name: panda\n", "YAML: for an experiment file, give the name"),
        ('{"robot": 1}', "JSON"),
        ("# ours\n# 2024 \n\nrobot:\n  name: panda\n", "YAML"),
        ('[robot]\nname = "x"\n', "TOML"),
        ("404: Not Found", "the answer of a server"),
        ("<<<<<<< HEAD\n<robot/>\n", "conflicts of git"),
        ("diff --git a/x b/x\n", "a patch"),
        ("# Blender 4\no Cube\nv 0 0 0\n", "a mesh (OBJ)"),
        ("ISO-10303-21;\nHEADER;", "a CAD model (STEP)"),
        ('<model name="m"/>', "SDF"),
        (GOOD.replace("robot", "ROBOT"), "small letters"),
        ("#" + " \n#" * 1000, "not well-formed"),  # and that at once
        ("solid link\n", "a mesh (STL)"),
        ('<robot name="r"><group name="arm"/></robot>', "an SRDF"),
        (GOOD.replace("<link", '<xacro:include filename="a"/><link', 1), "xacro FILE > robot.urdf"),
        (GOOD.replace("<link", '\n\n<xacro:if value="1"/><link', 1), "has <xacro:if>: expand"),
        (
            GOOD.replace("<robot", '<robot xmlns:xacro="http://x"').replace("<link", "<xacro:arm/><link", 1),
            "xacro",
        ),
        (f"<html>{GOOD}</html>", "a web page (HTML)"),
        ('<robot name="r"/>', "has no <link>; it is empty: give the URDF of the robot"),
        ('<robot name="r"><material name="m"/></robot>', "only colours; it is a part of another file: give"),
        (
            '<robot name="r"><gazebo/><xacro:property name="a" value="1"/></robot>',
            "only constants of xacro and settings of a simulator; it is a part",
        ),
        ('<robot name="r"><ros2_control/></robot>', "only drivers (ros2_control);"),
        ('<robot name="r"><other/></robot>', "only <other>; it is a part"),
        (f'<!DOCTYPE robot [<!ENTITY a "b">]>{GOOD}', "document type declaration"),
        (f'<!DOCTYPE r [<!ENTITY f SYSTEM "file:///etc/hostname">]>{GOOD}', "document type"),
    ],
)
def test_text_that_is_no_urdf_is_refused_with_what_it_is(text: str, said: str) -> None:
    assert said in str(refusal(text))


def test_a_part_of_a_xacro_file_is_said_to_be_one(tmp_path: Path) -> None:
    part = GOOD.replace('<parent link="', '<parent link="wrist_of_')
    for name, said in (
        ("tool.urdf", "correct the name"),
        ("tool.urdf.xacro", "give the file that includes it"),
    ):
        path = tmp_path / name
        path.write_text(part)
        with pytest.raises(UrdfError, match="which is missing") as refused:
            Robot.load(path)
        assert str(refused.value).partition("; ")[2].find(said) > 0


def chain(kinds: list[str]) -> str:
    """Return a chain of joints of these types."""
    parts = ['<robot name="chain"><link name="l0"/>']
    for i, kind in enumerate(kinds):
        parts.append(
            f'<link name="l{i + 1}">{BODY}</link><joint name="j{i}" type="{kind}">'
            f'<parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        )
    return "".join([*parts, "</robot>"])


def test_more_joints_than_pinocchio_stands_are_refused() -> None:
    # 5,000 chained fixed links crash it, 500 moving joints take gigabytes.
    assert Robot.from_xml(chain(["continuous"] * MAX_MOVING_JOINTS)).n == MAX_MOVING_JOINTS
    many = refusal(chain(["continuous"] * (MAX_MOVING_JOINTS + 1)))
    assert f"{MAX_MOVING_JOINTS + 1} moving joints" in str(many)
    assert "keep=" in str(many)
    assert f"more than {MAX_JOINTS} joints" in str(refusal(chain(["fixed"] * 5000)))


def test_a_file_holds_as_much_as_is_said_and_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = THREE.strip()  # not a byte that could be left out
    path, root = tmp_path / "arm.urdf", ElementTree.fromstring(text)

    def depth(element: ElementTree.Element) -> int:
        return 1 + max(map(depth, element), default=0)

    path.write_text(text)
    counts = [
        (markup, "MAX_BYTES", len(text.encode())),
        (markup, "MAX_DEPTH", depth(root)),
        (markup, "MAX_ELEMENTS", sum(1 for _ in root.iter())),
        (markup, "MAX_ATTRIBUTES", max(len(each.attrib) for each in root.iter())),
        (urdf, "MAX_JOINTS", len(root.findall("link"))),
        (urdf_model, "MAX_MOVING_JOINTS", len(root.findall("joint"))),
    ]
    for module, name, count in counts:
        with monkeypatch.context() as patch:
            patch.setattr(module, name, count)
            assert Robot.load(path).n == 3, name
            patch.setattr(module, name, count - 1)
            with pytest.raises(UrdfError, match=r"more than|bytes"):
                Robot.load(path)


@pytest.mark.parametrize(
    ("old", "new", "least", "beyond"),
    [
        (MASS, '<mass value="{}"/>', "1e15", "1.001e15"),
        ('iyy="0.01"', 'iyy="{}"', "1e15", "1.001e15"),
        ('damping="0.5"', 'damping="{}"', "1e15", "1.001e15"),
        ('xyz="0.2 0 0"', 'xyz="0.2 {} 0"', "-1e15", "-1.001e15"),
        ("<dynamics", '<mimic joint="shoulder" multiplier="{}"/><dynamics', "-1e6", "-1.001e6"),
        ("<dynamics", '<mimic joint="shoulder" offset="{}"/><dynamics', "1e6", "1.001e6"),
        ("<dynamics", '<mimic joint="shoulder" multiplier="{}"/><dynamics', "1e-6", "0.999e-6"),
        ('damping="0.5"', 'damping="{}"', "0", "-1e-300"),
    ],
)
def test_numbers_are_read_up_to_what_no_robot_has(old: str, new: str, least: str, beyond: str) -> None:
    urdf.parse(changed((old, new.format(least))), "arm")
    with pytest.raises(UrdfError, match=r"larger than (?:that of )?any|no gear has|negative"):
        urdf.parse(changed((old, new.format(beyond))), "arm")


def test_commas_between_numbers_and_within_them_are_told_apart() -> None:
    for given, said in (
        ("0.2,0,0", "by spaces, not by commas"),
        ("0.2, 0, 0", "by spaces"),
        ("0,2 0 0", "1.5, not 1,5"),
    ):
        assert said in str(refusal(changed(('xyz="0.2 0 0"', f'xyz="{given}"'))))


def test_limits_from_1e15_on_are_none_and_a_range_may_be_one_place() -> None:
    for given, wanted in (
        ("1e15 1e15 -1e15 1e15", (1e15, 1e15, -np.inf, np.inf)),
        ("1.1e15 1.1e15 -9e14 9e14", (np.inf, np.inf, -9e14, 9e14)),
        ("0 0 0.5 0.5", (0.0, 0.0, 0.5, 0.5)),
    ):
        names = ("effort", "velocity", "lower", "upper")
        limit = " ".join(f'{name}="{x}"' for name, x in zip(names, given.split(), strict=True))
        elbow = urdf.parse(changed((LIMIT, f"<limit {limit}/>")), "arm").joints["elbow"]
        assert (elbow.effort, elbow.velocity, elbow.lower, elbow.upper) == wanted


# --- Elements with something wrong ---------------------------------------------------------------

REFUSED = [  # element, what stands there, what to write instead, what the error says
    ("shoulder", 'name="elbow"', 'name="shoulder"', "two joints are named"),
    ("elbow", 'type="revolute"', 'type="wobbly"', "type 'wobbly'"),
    ("elbow", 'type="revolute"', "", "type ''"),
    ("elbow", 'type="revolute"', 'type="floating"', "is floating"),
    ("elbow", 'type="revolute"', 'type="planar"', "is planar"),
    ("elbow", 'type="revolute"', 'type="ball"', "type 'ball', which is no type of URDF"),
    ("a\nb", 'name="elbow"', 'name="a&#10;b"', "cannot be printed"),
    ("elbow", 'xyz="0 1 0"', 'xyz="0 0 0"', "axis 0 0 0"),
    ("elbow", 'xyz="0 1 0"', "", "axis 0 0 0"),
    ("elbow", 'xyz="0 1 0"', 'xyz="0 1"', "2 numbers, expected 3"),
    ("elbow", 'xyz="0 1 0"', 'xyz="0,1,0"', "'0,1,0' is not a number"),
    ("elbow", 'xyz="0.2 0 0"', 'xyz="nan 0 0"', "not finite"),
    ("elbow", 'xyz="0.2 0 0"', 'xyz="${l} 0 0"', "has xyz='${l} 0 0' in 'elbow': expand it first"),
    ("elbow", 'rpy="0 0 0"/><axis', 'rpy="inf 0 0"/><axis', "not finite"),
    ("elbow", LIMIT, "", "no <limit>"),
    ("elbow", 'effort="20"', "", "<limit> has no effort"),
    ("elbow", 'velocity="3"', "", "<limit> has no velocity"),
    ("elbow", 'xyz="0.2 0 0"', 'xyz="1e16 0 0"', "larger than any robot"),
    ("elbow", 'damping="0.5"', 'damping="1e300"', "larger than any robot"),
    ("fore", 'value="1.0"', 'value="1e16"', "larger than that of any robot"),
    ("fore", 'value="1.0"', 'value="1,5"', "write 1.5, not 1,5"),
    ("fore", 'value="1.0"', 'value="${m}"', "expand it first"),
    ("elbow", 'lower="-1.5"', 'lower="3"', "lower limit 3 above its upper 2.5"),
    ("elbow", 'lower="-1.5"', 'lower="nan"', "lower='nan' is not finite"),
    ("elbow", 'lower="-1.5"', 'lower="-1,5"', "'-1,5' is not a number"),
    ("elbow", 'upper="2.5"', 'upper="1e400"', "upper='1e400' is not finite"),
    ("elbow", 'effort="20"', 'effort="2_0"', "'2_0' is not a number"),
    ("elbow", 'effort="20"', 'effort="-20"', "negative effort limit: -20"),
    ("elbow", 'velocity="3"', 'velocity="-3"', "negative velocity limit: -3"),
    ("elbow", 'damping="0.5"', 'damping="-0.5"', "negative damping: -0.5"),
    ("elbow", 'friction="0.25"', 'friction="-0.25"', "negative friction: -0.25"),
    ("elbow", '<parent link="upper"/>', "", "no parent link"),
    ("elbow", '<child link="fore"/>', "<child/>", "no child link"),
    ("elbow", '<parent link="upper"/>', '<parent link="uper"/>', "'uper', which is missing"),
    ("elbow", '<child link="fore"/>', '<child link="for"/>', "'for', which is missing"),
    ("upper", '<link name="fore"', '<link name="upper"', "two links are named"),
    (
        "universe",
        '<joint name="elbow"',
        '<joint name="universe"',
        "the name that Pinocchio gives to the world",
    ),
    ("fore", MASS, "", "without <mass>"),
    ("fore", MASS, "<mass/>", "no value"),
    ("fore", INERTIA, "", "without <inertia>"),
    ("fore", ' izz="0.01"', "", "no izz"),
    ("fore", 'value="1.0"', 'value="nan"', "value='nan' is not finite"),
    ("fore", 'value="1.0"', 'value="1,5"', "'1,5' is not a number"),
    ("fore", 'value="1.0"', 'value="heavy"', "'heavy' is not a number"),
    ("fore", 'value="1.0"', 'value="${m}"', "has value='${m}' in 'fore': expand"),
    ("fore", 'value="1.0"', 'value="$(arg m)"', "has value='$(arg m)' in 'fore': expand"),
    ("fore", 'value="1.0"', 'value="1_0"', "'1_0' is not a number"),
    ("fore", 'value="1.0"', 'value="٢"', "'٢' is not a number"),
    ("fore", 'value="1.0"', 'value="1 2"', "2 numbers, expected 1"),
    ("fore", 'value="1.0"', 'value="-1.5"', "negative mass -1.5"),
    ("fore", 'value="1.0"', 'value="0"', "inertia but no mass"),
    ("fore", 'iyy="0.01"', 'iyy="inf"', "iyy='inf' is not finite"),
    ("fore", 'iyy="0.01"', 'iyy="-0.01"', "not positive (smallest eigenvalue -0.01)"),
    ("fore", 'ixy="0"', 'ixy="0.5"', "not positive (smallest eigenvalue -0.49)"),
    ("fore", 'xyz="0.1 0 0"', 'xyz="0.1 nan 0"', "not finite"),
]


@pytest.mark.parametrize(
    ("element", "old", "new", "said"), REFUSED, ids=[f"{row[0]}: {row[3]}" for row in REFUSED]
)
def test_a_bad_element_is_refused_by_name(element: str, old: str, new: str, said: str) -> None:
    error = refusal(changed((old, new)))
    assert error.element == element
    assert repr(element) in str(error)
    assert said in str(error)


@pytest.mark.parametrize("tag", ["link", "joint"])
def test_an_element_without_a_name_is_refused(tag: str) -> None:
    assert f"a <{tag}> has no name" in str(refusal(GOOD.replace(f"<{tag} name=", f"<{tag} title=")))


def test_a_moving_link_without_inertia_is_refused_naming_joint_and_link() -> None:
    for body in ("", BODY.replace("0.01", "0").replace("1.0", "0")):
        error = refusal(changed((BODY, body)))
        assert error.element == "elbow"
        assert "'fore'" in str(error)


def test_joints_without_inertia_are_named_together() -> None:
    palm = '<link name="a"/><link name="b"/>'
    fingers = "".join(WRIST.replace('"wrist"', f'"f{x}"').replace('"hand"', f'"{x}"') for x in "ab")
    error = refusal(GOOD.replace("</robot>", f"{palm}{fingers}</robot>"))
    assert {"'fa'", "'fb'"} <= set(str(error).replace(";", "").replace(",", "").split())
    ((kind, joints, _),) = error.remedies
    assert (kind, set(joints)) == ("lock", {"fa", "fb"})


def test_a_robot_made_for_drawing_alone_is_refused_as_that() -> None:
    error = refusal(GOOD.replace(BODY, ""))
    assert error.element == "upper"
    assert "has no mass in any moving link ('upper', 'fore')" in str(error)
    for count, said in ((6, "'l4', 'l5')"), (9, "'l4', 'l5' and 3 more)")):
        chain = "".join(
            f'<link name="l{i}"/>' + ELBOW.replace("elbow", f"j{i}").replace("fore", f"l{i}")
            for i in range(count)
        )
        assert said in str(refusal(GOOD.replace(BODY, "").replace("</robot>", f"{chain}</robot>")))


def test_a_robot_that_never_had_a_joint_to_move_is_not_told_of_locks() -> None:
    text = GOOD.replace("continuous", "fixed").replace("revolute", "fixed")
    assert "nothing to control" in str(refusal(text))
    assert "lock fewer" in str(refusal(GOOD, lock=["shoulder", "elbow"]))


def test_a_point_mass_on_its_own_axis_is_refused_because_nothing_resists_the_joint() -> None:
    error = refusal(changed((BODY, BODY.replace("0.01", "0").replace('xyz="0.1', 'xyz="0'))))
    assert error.element == "elbow"


@pytest.mark.parametrize("size", ["1e15", "1e-4", "1e-17", "1e-200"])
def test_robots_of_any_size_have_dynamics_that_are_numbers_or_none(size: str) -> None:
    # Masses, inertias and lengths alike; below 1e-15 kg m^2 accelerations would overflow.
    text = GOOD.replace("0.01", size).replace('"1.0"', f'"{size}"').replace('"0.2 ', f'"{size} ')
    text = text.replace('"0.1 0 0"', f'"{size} 0 0"')
    if float(size) < 1e-15:
        assert "singular" in str(refusal(text))
        return
    robot, q = Robot.from_xml(text), [0.3, -0.4]
    assert np.isfinite(robot.mass_matrix(q)).all()
    assert np.isfinite(robot.forward_dynamics(q, [1.0, 1.0], [1.0, 1.0])).all()


def test_an_arm_so_far_away_that_digits_are_lost_is_refused() -> None:
    # ABA in the world's frame: inertias about an origin 1e11 m away leave no digit for the arm's own.
    far = changed(('link="upper"/></joint>', 'link="upper"/><origin xyz="1.8e11 0 0"/></joint>'))
    assert "accelerations are wrong" in str(refusal(far))
    near = changed(('link="upper"/></joint>', 'link="upper"/><origin xyz="1e3 0 0"/></joint>'))
    q, tau = [0.3, -0.4], [1.0, -2.0]
    np.testing.assert_allclose(
        Robot.from_xml(near).forward_dynamics(q, [0.0, 0.0], tau),
        Robot.from_xml(GOOD).forward_dynamics(q, [0.0, 0.0], tau),
        rtol=1e-6,
    )


def test_an_axis_of_any_length_is_a_direction() -> None:
    q = [0.3, -0.4]
    for axis in ("0 1e-200 0", "0 1e200 0", "0 5e-324 0"):
        robot = Robot.from_xml(changed(('xyz="0 1 0"', f'xyz="{axis}"')))
        np.testing.assert_array_equal(robot.mass_matrix(q), Robot.from_xml(GOOD).mass_matrix(q))


def test_a_massless_link_between_two_joints_is_no_obstacle() -> None:
    # A universal joint: what hangs on it has inertia about both axes.
    text = changed((f'<link name="fore">{BODY}', '<link name="fore">'), text=THREE)
    robot = Robot.from_xml(changed(('xyz="0 1 0"', 'xyz="0 0 1"'), text=text))
    assert np.linalg.eigvalsh(robot.mass_matrix([0.1, 0.2, 0.3]))[0] > 0.0


@pytest.mark.parametrize(
    ("extra", "element", "said"),
    [
        (ELBOW.replace('"elbow"', '"again"'), "fore", "two parents"),
        ('<link name="island"/>', "island", "not one tree"),
        (f"<link name='x'/>{WRIST.replace('hand', 'x').replace('fore', 'x')}", "x", "cycle"),
        (ELBOW.replace('"elbow"', '"back"').replace('link="fore"', 'link="base"'), "base", "cycle"),
    ],
    ids=["two parents", "two roots", "cycle beside the tree", "cycle through the base"],
)
def test_joints_that_form_no_tree_are_refused(extra: str, element: str, said: str) -> None:
    error = refusal(changed(("</robot>", f"{extra}</robot>")))
    assert said in str(error)
    assert error.element == element
    assert repr(element) in str(error)


# --- Versions of the format ----------------------------------------------------------------------

#: A quarter turn about x, not normalised, as an origin of URDF 1.1 may have it.
QUATERNION = 'quat_xyzw="2 0 0 2"'


@pytest.mark.parametrize("version", ["", "x", "1", "1.3", "7.0"])
def test_a_version_that_nobody_knows_is_refused(version: str) -> None:
    error = refusal(changed(('<robot name="arm">', f'<robot name="arm" version="{version}">')))
    assert f"has version={version!r}; expected a version of URDF: 1.0, 1.1, 1.2, or none" in str(error)


@pytest.mark.parametrize("version", ["1.1", "1.2"])
def test_a_quaternion_of_later_versions_turns_as_urdfdom_turns_it(version: str) -> None:
    text = changed(
        ('<robot name="arm">', f'<robot name="arm" version="{version}">'),
        ('<origin xyz="0.2 0 0" rpy="0 0 0"/><axis', f'<origin xyz="0.2 0 0" {QUATERNION}/><axis'),
    )
    robot, theirs = Robot.from_xml(text), pin.buildModelFromXML(text)
    joint = theirs.getJointId("elbow")
    mine = robot.pinocchio_model().jointPlacements[joint].rotation
    np.testing.assert_allclose(mine, theirs.jointPlacements[joint].rotation, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(mine, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("version", "angles", "said"),
    [
        ("1.0", QUATERNION, "has quat_xyzw, which version 1.0 of URDF does not have"),
        ("1.1", f'{QUATERNION} rpy="0 0 0"', "has quat_xyzw and rpy"),
        ("1.1", 'quat_xyzw="0 0 0 0"', "has the norm 0; expected a unit quaternion"),
        ("1.1", 'quat_xyzw="0 0 1"', "has 3 numbers, expected 4"),
        ("1.1", 'quat_xyzw="0 0 nan 1"', "is not finite"),
        ("1.1", 'quat_xyzw="1e300 0 0 1e300"', "has the norm 1.41421e+300"),
    ],
)
def test_a_quaternion_that_turns_nothing_is_refused(version: str, angles: str, said: str) -> None:
    text = changed(
        ('<robot name="arm">', f'<robot name="arm" version="{version}">'),
        ('<origin xyz="0.2 0 0" rpy="0 0 0"/><axis', f'<origin xyz="0.2 0 0" {angles}/><axis'),
    )
    error = refusal(text)
    assert said in str(error)
    assert error.element == "elbow"
