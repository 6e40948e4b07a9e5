"""What an MJCF names is checked before MuJoCo opens it."""

from __future__ import annotations

import os
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgpi import Robot
from armgpi.errors import UrdfError
from armgpi.health import inspect as health_inspect
from armgpi.health.crosscheck import cross_check
from armgpi.robot import mjcf_files

mujoco = pytest.importorskip("mujoco")

BODY = """<body name="arm"><joint name="turn" axis="0 1 0" range="-1 1" limited="true"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.3" mass="2"/>{}</body>"""
MODEL = "<mujoco model='m'>{before}<worldbody>" + BODY.format("{body}") + "</worldbody>{after}</mujoco>"


def write(folder: Path, before: str = "", after: str = "", body: str = "", name: str = "m.xml") -> Path:
    """Write a model of an arm with more in it."""
    path = folder / name
    path.write_text(MODEL.format(before=before, after=after, body=body))
    return path


def asset(tag: str, file: object, more: str = "") -> str:
    return f"<asset><{tag} name='x' file='{file}' {more}/></asset>"


def named(folder: Path) -> dict[str, str]:
    """Return what a hostile model has in it -> what the refusal says."""
    secret = folder.parent / "secret.xml"
    secret.write_text("<mujoco><asset/></mujoco>")
    (folder.parent / "secret.stl").write_bytes(b"TOP-SECRET")
    os.mkfifo(folder / "pipe.stl")
    os.mkfifo(folder / "pipe.xml")
    (folder / "link.stl").symlink_to(folder.parent / "secret.stl")
    with (folder / "sparse.stl").open("wb") as file:
        file.truncate(2**36)
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 100_000, 100_000) + bytes(20)
    (folder / "bomb.png").write_bytes(png)
    (folder / "self.xml").write_text("<mujoco><include file='self.xml'/></mujoco>")
    return {
        "<include file='/dev/zero'/>": "outside the folders",
        "<include file='../secret.xml'/>": "outside the folders",
        f"<include file='{secret}'/>": "outside the folders",
        "<include file='pipe.xml'/>": "expected an MJCF file, this is no regular file but a pipe",
        asset("mesh", "../secret.stl"): "outside the folders",
        asset("mesh", "/dev/zero"): "outside the folders",
        asset("mesh", "pipe.stl"): "pipe",
        asset("mesh", "link.stl"): "outside the folders",
        asset("mesh", "sparse.stl"): "bytes",
        "<compiler meshdir='..'/>" + asset("mesh", "secret.stl"): "outside the folders",
        "<compiler assetdir='../'/>" + asset("hfield", "secret.stl"): "outside the folders",
        asset("texture", "bomb.png", "type='2d'"): "pixels",
        asset("texture", "/dev/random", "type='2d'"): "outside the folders",
        asset("model", "pipe.xml"): "pipe",
        asset("model", "/etc/passwd"): "outside the folders",
        "<size memory='900G'/>": "memory",
        "<!-- a -- b --><include file='/dev/zero'/>": "outside the folders",
        "<![CDATA[<!--]]><include file='/dev/zero'/><![CDATA[-->]]>": "no well-formed",
        "<!DOCTYPE x><include file='/dev/zero'/>": "",
        "<a b='<!--'/><include file='/dev/zero'/><a b='-->'/>": "no well-formed",
    }


def test_what_it_names_is_refused_before_mujoco_opens_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(path: str) -> Any:
        raise AssertionError(f"MuJoCo opened {path}")

    monkeypatch.setattr(mujoco.MjModel, "from_xml_path", opened)
    folder = tmp_path / "sent"
    folder.mkdir()
    for before, said in named(folder).items():
        begun = time.process_time()
        with pytest.raises(UrdfError) as caught:
            Robot.load(write(folder, before))
        assert said in str(caught.value), before
        assert "\n" not in str(caught.value)
        assert time.process_time() - begun < 5.0


def test_copies_within_copies_are_counted(tmp_path: Path) -> None:
    body = "<replicate count='{}' offset='0 0 1'>" * 4 + "<geom size='0.01'/>" + "</replicate>" * 4
    with pytest.raises(UrdfError, match="copies"):
        Robot.load(write(tmp_path, body=body.format(100, 100, 100, 100)))
    assert Robot.load(write(tmp_path, body=body.format(2, 2, 2, 2))).n == 1


@pytest.mark.parametrize("layout", ["beside", "above", "mjcf", "sibling"])
def test_what_is_in_its_folders_is_read(layout: str, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    folder = tmp_path / ("mjcf" if layout == "mjcf" else "arm")
    sibling = tmp_path / "robot_stls" / "arm"  # as of Gymnasium-Robotics
    meshes = {"beside": folder, "above": folder / "meshes", "mjcf": tmp_path / "meshes", "sibling": sibling}[
        layout
    ]
    for each in (folder, meshes):
        each.mkdir(exist_ok=True, parents=True)
    trimesh.creation.box(extents=(0.1, 0.1, 0.1)).export(meshes / "box.stl")
    (folder / "more.xml").write_text(f"<mujoco>{asset('mesh', 'box.stl')}</mujoco>")
    relative = os.path.relpath(meshes, folder)
    before = f"<!-- a -- b --><compiler meshdir='{relative}'/><include file='more.xml'/>"
    path = write(folder, before, body="<geom type='mesh' mesh='x' density='1000' pos='0 0 0.3'/>")
    robot = Robot.load(path)
    assert robot.mass_matrix(np.zeros(1))[0, 0] > 0.06


def test_a_link_out_of_a_folder_of_meshes_is_not_followed(tmp_path: Path) -> None:
    for name in ("sent", "meshes", "other"):
        (tmp_path / name).mkdir()
    (tmp_path / "other" / "box.stl").write_bytes(b"TOP-SECRET")
    (tmp_path / "meshes" / "box.stl").symlink_to(tmp_path / "other" / "box.stl")
    for place in ("../meshes/box.stl", "../other/box.stl", "../meshes/../other/box.stl"):
        with pytest.raises(UrdfError, match="outside the folders"):
            Robot.load(write(tmp_path / "sent", asset("mesh", place)))


def test_a_part_of_a_model_is_called_one(tmp_path: Path) -> None:
    path = tmp_path / "part.xml"
    path.write_text("<mujocoinclude><worldbody/></mujocoinclude>")
    with pytest.raises(UrdfError, match=r"is a part of a MuJoCo model \(MJCF\): give the one that includes"):
        Robot.load(path)


def test_what_stands_behind_the_model_is_not_read(tmp_path: Path) -> None:
    """As Unitree's scene of the G1 has its last line twice; MuJoCo does not look at it either."""
    path = write(tmp_path)
    path.write_text(path.read_text() + "\n</mujoco><include file='/dev/zero'/>")
    assert Robot.load(path).n == 1
    path.write_text(path.read_text().replace("<worldbody>", "<include file='/dev/zero'/><worldbody>", 1))
    with pytest.raises(UrdfError, match="outside the folders"):
        Robot.load(path)


def test_many_meshes_are_no_includes(tmp_path: Path) -> None:
    for k in range(300):
        (tmp_path / f"{k}.stl").write_bytes(b"solid")
    text = "".join(asset("mesh", f"{k}.stl") for k in range(300))
    mjcf_files.check(write(tmp_path, text))


def test_a_second_reading_of_an_mjcf_is_mujocos(tmp_path: Path) -> None:
    path = write(tmp_path, body="<body name='hand' pos='0.1 0.2 0.3'><geom size='0.02' mass='0.1'/></body>")
    result = cross_check(Robot.load(path))
    assert (result.reader, result.differences) == ("MuJoCo", ())
    assert result.links == 3
    assert result.position < 1e-12


TENDON = "<tendon><fixed name='t'><joint joint='turn' coef='0.25'/>{}</fixed></tendon>"
MOTOR = "<actuator><motor name='pull' tendon='t' gear='2' ctrlrange='-30 30' ctrllimited='true'/></actuator>"


def test_an_actuator_on_the_tendon_of_one_joint_is_its_effort(tmp_path: Path) -> None:
    robot = Robot.load(write(tmp_path, after=TENDON.format("") + MOTOR))
    # 30 of control times the gear of 2 times the coefficient.
    assert robot.limits.effort.tolist() == pytest.approx([15.0])


def test_an_actuator_on_the_tendon_of_several_joints_is_named(tmp_path: Path) -> None:
    more = "<body pos='0 0 0.3'><joint name='bend' axis='0 1 0'/><geom size='0.05' mass='1'/></body>"
    after = TENDON.format("<joint joint='bend' coef='1'/>") + MOTOR
    path = write(tmp_path, after=after, body=more)
    with pytest.raises(UrdfError, match="actuator 'pull' on tendon 't', one force for several joints"):
        Robot.load(path)
    assert not health_inspect(write(tmp_path, after=TENDON.format("") + MOTOR)).has_errors


def test_warnings_of_mujoco_are_not_printed_nor_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path, body="<body pos='nan 0 0'><geom size='0.1' mass='1'/></body>")
    with pytest.raises(UrdfError):
        Robot.load(path)
    assert capfd.readouterr() == ("", "")
    assert [file.name for file in tmp_path.iterdir()] == ["m.xml"]


@pytest.mark.parametrize("name", ["..", "../", ".", "../mjcf", "../meshes", "../meshes/."])
def test_a_folder_is_no_file_to_include_or_to_draw(tmp_path: Path, name: str) -> None:
    """Also the one above the model, in which folders of meshes stand: it has no name there."""
    folder = tmp_path / "mjcf"
    for each in (folder, tmp_path / "meshes"):
        each.mkdir()
    for more in (f"<include file='{name}'/>", asset("mesh", name)):
        with pytest.raises(UrdfError) as refused:
            mjcf_files.check(write(folder, more))
        assert "outside the folders" in str(refused.value) or "folder" in str(refused.value)
