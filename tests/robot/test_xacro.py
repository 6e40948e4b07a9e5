"""A xacro file is expanded to the URDF that it says, or refused in one line."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import Answer

from armgpi import Robot
from armgpi.errors import MissingPackage, UrdfError
from armgpi.robot import markup, xacro

pytest.importorskip("xacrodoc")

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
#: A macro that is included: a rod on a joint.
MACRO = f"""{HEAD}
<xacro:macro name="rod" params="name parent mass">
<link name="${{name}}"><inertial><origin xyz="0.1 0 0"/><mass value="${{mass}}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="package://own/meshes/rod.stl"/></geometry></visual></link>
<joint name="to_${{name}}" type="revolute"><parent link="${{parent}}"/><child link="${{name}}"/>
<origin xyz="${{length}} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</xacro:macro></robot>"""
ARM = f"""{HEAD}
<xacro:arg name="mass" default="2.0"/>
<xacro:property name="length" value="${{0.1 * 3}}"/>
<xacro:include filename="$(find own)/urdf/rod.xacro"/>
<link name="base"/>
<xacro:rod name="upper" parent="base" mass="$(arg mass)"/>
<xacro:rod name="fore" parent="upper" mass="1.0"/>
</robot>"""


def package(folder: Path) -> Path:
    """Write a ROS package with an arm in xacro, and return the file of the arm."""
    (folder / "own/urdf").mkdir(parents=True)
    manifest = '<package format="2"><name>own</name><version>1.0.0</version></package>'
    (folder / "own/package.xml").write_text(manifest, encoding="utf-8")
    (folder / "own/urdf/rod.xacro").write_text(MACRO, encoding="utf-8")
    path = folder / "own/urdf/arm.urdf.xacro"
    path.write_text(ARM, encoding="utf-8")
    return path


def written(folder: Path, inside: str) -> Path:
    """Write a xacro file."""
    path = folder / "arm.xacro"
    path.write_text(f"{HEAD}{inside}</robot>", encoding="utf-8")
    return path


def test_properties_macros_includes_and_arguments_are_expanded(tmp_path: Path) -> None:
    path = package(tmp_path)
    robot = Robot.from_xml(xacro.expand(path, {"mass": "5"}))
    assert robot.joint_names == ("to_upper", "to_fore")
    assert robot.total_mass == 6.0
    np.testing.assert_allclose(robot.frame_pose("fore", np.zeros(2)).translation, [0.6, 0.0, 0.0], atol=1e-15)


def test_the_command_writes_a_urdf_beside_its_meshes(cli: Callable[..., Answer], tmp_path: Path) -> None:
    path = package(tmp_path)
    with pytest.raises(UrdfError, match=r"line 4 has <xacro:include>.*armgpi expand FILE"):
        Robot.load(path)
    out = tmp_path / "own/arm.urdf"
    assert cli("expand", str(path), "mass:=3", "-o", str(out))[0] == 0
    assert 'filename="meshes/rod.stl"' in out.read_text(encoding="utf-8")
    assert Robot.load(out).total_mass == 4.0


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (
            '<xacro:include filename="$(find nowhere)/a.xacro"/>',
            "the package 'nowhere' is not found; give the",
        ),
        ('<link name="$(arg which)"/>', "its argument 'which' has no default; give it as which:=VALUE"),
        ('<xacro:include filename="none.xacro"/>', "none.xacro', which is not there"),
        ('<link name="${1 / 0}"/>', "division by zero"),
        ('<link name="${().__class__}"/>', "invalid name"),
        ("<xacro:nothing/>", "nothing"),
        ("<xacro:macro name='m'><xacro:m/></xacro:macro><xacro:m/>", "recursion"),
    ],
)
def test_what_cannot_be_expanded_is_refused_in_one_line(
    cli: Callable[..., Answer], tmp_path: Path, inside: str, said: str
) -> None:
    path = written(tmp_path, inside)
    code, out, err = cli("expand", str(path))
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert said in err


def test_an_expansion_that_does_not_end_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xacro, "SECONDS", 2)
    path = written(tmp_path, '<link name="${[x for x in range(10**12)]}"/><link name="${9**9**9**9}"/>')
    with pytest.raises(UrdfError, match=r"cannot be expanded: it takes more than \d"):
        xacro.expand(path)


def test_what_an_argument_is_not_is_refused(cli: Callable[..., Answer], tmp_path: Path) -> None:
    path = package(tmp_path)
    code, _, err = cli("expand", str(path), "mass=3")
    assert (code, err.count("\n")) == (2, 1)
    assert "expected the name of an argument, := and its value" in err


def test_an_argument_that_the_file_does_not_have_is_refused(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    """A misspelt name would have left the default in place, in silence."""
    code, out, err = cli("expand", str(package(tmp_path)), "mass:=3", "mas:=4")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "has no argument 'mas'; it has mass" in err
    code, out, err = cli("expand", str(written(tmp_path, '<link name="base"/>')), "mass:=3")
    assert (code, out) == (2, "")
    assert "has no argument 'mass'; it has none" in err


def test_an_argument_counts_where_it_is_read_without_being_declared(tmp_path: Path) -> None:
    path = written(tmp_path, '<link name="$(arg which)"/><link name="${xacro.arg(\'other\')}"/>')
    text = xacro.expand(path, {"which": "base", "other": "tool"})
    assert 'name="base"' in text
    assert 'name="tool"' in text


def test_without_the_package_one_line_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(MissingPackage, match="pip install xacrodoc"):
        xacro.expand(package(tmp_path))


def test_what_is_printed_is_the_urdf_with_its_tabs(cli: Callable[..., Answer], tmp_path: Path) -> None:
    path = written(tmp_path, '\n\t<link name="base">\n\t\t<!-- a\ttab -->\n\t</link>\n')
    code, out, _ = cli("expand", str(path))
    assert code == 0
    assert out.rstrip("\n") == xacro.expand(path).rstrip("\n")
    assert "\t" in out
    assert r"\t" not in out


def test_modules_in_the_current_folder_are_not_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "json.py").write_text("open('imported', 'w').close()\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert "base" in xacro.expand(written(tmp_path, '<link name="base"/>'))
    assert not (tmp_path / "imported").exists()


def test_an_expansion_that_is_too_large_is_no_timeout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(markup, "MAX_BYTES", 1000)
    path = written(tmp_path, "<link name=\"${'a' * 2000}\"/>")
    with pytest.raises(UrdfError, match=r"its URDF has 2\d\d\d bytes, more than the 1000 allowed"):
        xacro.expand(path)


@pytest.mark.parametrize(
    ("worker", "seconds", "said"),
    [
        ("import os; os._exit(3)", 60, "the process that expands it ended with code 3 and no result"),
        (
            "import os; os.kill(os.getpid(), 9)",
            60,
            "the process that expands it was ended by signal 9 without a result",
        ),
        ("import time; time.sleep(200)", 1, r"takes more than 2 s"),
    ],
)
def test_a_worker_that_dies_is_no_timeout(
    worker: str, seconds: int, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(xacro, "_WORKER", worker)
    monkeypatch.setattr(xacro, "SECONDS", seconds)
    with pytest.raises(UrdfError, match=said):
        xacro.expand(written(tmp_path, '<link name="base"/>'))


def test_a_file_of_macros_alone_writes_no_robot(tmp_path: Path) -> None:
    path = package(tmp_path).with_name("rod.xacro")
    with pytest.raises(UrdfError, match="writes no <link>, as a file of macros or constants; expand"):
        xacro.expand(path)
    constants = written(tmp_path, '<xacro:property name="linkage" value="1"/>')
    with pytest.raises(UrdfError, match="writes no <link>"):
        xacro.expand(constants)
