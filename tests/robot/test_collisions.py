"""An arm that touches itself, by its collision shapes."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from armgpi import Robot
from armgpi.robot.collisions import Contact, read_shapes, self_collisions, shape_files
from armgpi.robot.usual import usual_ends

#: Three links of 1 m in a plane, each a ball of 0.2 m at its end; the third can come back to the base.
BALL = '<{tag}><origin xyz="1 0 0"/><geometry>{shape}</geometry></{tag}>'
SPHERE = '<sphere radius="0.2"/>'
BODY = (
    '<inertial><origin xyz="0.5 0 0"/><mass value="1"/>'
    '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def arm(folder: Path, shape: str = SPHERE) -> Robot:
    """An arm of three joints about z, with a ball at the base as well."""
    links = [f'<link name="base"><collision><geometry>{SPHERE}</geometry></collision></link>']
    joints = []
    for k, parent in enumerate(("base", "a", "b")):
        name = "abc"[k]
        links.append(f'<link name="{name}">{BODY}{BALL.format(tag="collision", shape=shape)}</link>')
        joints.append(
            f'<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{float(k > 0)} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="50" velocity="3"/></joint>'
        )
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="balls">{"".join(links)}{"".join(joints)}</robot>')
    return Robot.load(path)


def test_an_arm_that_closes_to_a_triangle_touches_its_base(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    # With both elbows at a the last ball is |1 + e^ia + e^2ia| = |1 + 2 cos a| from the base's.
    bends = np.linspace(0.0, 2.0, 201)
    way = np.stack([0.0 * bends, bends, bends], axis=1)
    near = np.abs(1.0 + 2.0 * np.cos(bends)) < 0.4
    assert self_collisions(robot, way) == [Contact("base", "c", int(np.argmax(near)))]
    assert self_collisions(robot, way[:100]) == []


def test_shapes_that_cannot_be_had_are_no_contact(tmp_path: Path) -> None:
    """Meshes elsewhere on the machine are not read, and a text has no file."""
    (tmp_path / "package").mkdir()
    (tmp_path / "secret.stl").write_bytes(b"solid")
    bent = np.array([[0.0, 0.0, 0.0], [0.0, 2.094, 2.094]])
    assert self_collisions(arm(tmp_path / "package", '<mesh filename="../../secret.stl"/>'), bent) == []
    assert self_collisions(Robot.load("anthropomorphic3"), np.zeros((2, 3))) is None


@pytest.mark.parametrize(
    "shape",
    [
        *('<box size="a b"/>', '<cone r="1"/>', "", "<sphere/>", '<sphere radius="-1"/>'),
        *('<cylinder radius="1"/>', "<mesh/>", '<box size="1 1"/>', '<mesh filename="a" scale="x"/>'),
    ],
)
def test_a_shape_that_is_none_is_left_out_and_nothing_else_prints_it(
    shape: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    robot = arm(tmp_path)
    path = Path(str(robot.provenance["source"]))
    odd = f"<collision><geometry>{shape}</geometry></collision>"
    path.write_text(path.read_text().replace('<link name="b">', f'<link name="b">{odd}'))
    shapes = read_shapes(Robot.load(path))
    assert shapes.missing == ("b",)
    assert len(shapes.model.geometryObjects) == 4
    captured = capfd.readouterr()
    assert captured.out + captured.err == ""


@pytest.mark.parametrize("head", ["\n\n", "\n<?xml version='1.0'?>\n"])
def test_files_that_load_have_shapes(head: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Prefixes that are not declared, blank lines before the XML, and an effort that urdfdom refuses."""
    plain = arm(tmp_path)
    bent = np.array([[0.0, 0.0, 0.0], [0.0, 2.094, 2.094]])
    path = tmp_path / "odd.urdf"
    text = Path(plain.provenance["source"]).read_text().replace('effort="50"', 'effort="inf"')
    beside = '<controller:foo name="x"/><gazebo><sensor:bar/></gazebo></robot>'
    path.write_text(head + text.replace("</robot>", beside))
    odd = Robot.load(path)
    assert self_collisions(odd, bent) == self_collisions(plain, bent) == [Contact("base", "c", 1)]
    assert np.array_equal(usual_ends(odd).start, usual_ends(plain).start)
    assert capfd.readouterr() == ("", "")


def test_what_shapes_are_read_from_has_their_places_sizes_and_meshes(tmp_path: Path) -> None:
    """Two files with the same bodies and other shapes are not the same."""
    digests = {shape_files(arm(tmp_path, f'<sphere radius="{radius}"/>')).digest for radius in (0.2, 0.3)}
    path = tmp_path / "arm.urdf"
    path.write_text(path.read_text().replace('<collision><origin xyz="1 0 0"/>', "<collision>"))
    digests.add(shape_files(Robot.load(path)).digest)
    path.write_text(path.read_text().replace('effort="50"', 'effort="40"'))  # is no shape
    digests.add(shape_files(Robot.load(path)).digest)
    assert len(digests) == 3
    mesh = tmp_path / "a.stl"
    mesh.write_bytes(b"solid one")
    robot = arm(tmp_path, '<mesh filename="a.stl"/>')
    before = shape_files(robot)
    os.utime(mesh, ns=(0, 0))
    assert before.meshes[0][:2] == (str(mesh.resolve()), len(b"solid one"))
    assert shape_files(robot) != before


def test_a_mujoco_model_in_a_file_with_the_name_of_a_urdf_has_no_shapes_here(tmp_path: Path) -> None:
    """Files are loaded by what they are, so this one is."""
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.urdf"
    path.write_text(
        '<mujoco><worldbody><body><joint name="a" axis="0 1 0" range="-1 1"/>'
        '<geom type="sphere" size="0.1" pos="0.3 0 0"/></body></worldbody>'
        '<actuator><motor joint="a" ctrlrange="-50 50"/></actuator></mujoco>'
    )
    robot = Robot.load(path)
    assert shape_files(robot) == ("", ())
    assert self_collisions(robot, np.zeros((2, 1))) is None
    assert np.isfinite(usual_ends(robot)).all()


def test_a_mesh_that_cannot_be_read_takes_no_other_link_off_the_list(tmp_path: Path) -> None:
    """The base's mesh is not there, `b` has one that is none: no link has a shape, in their order."""
    robot = arm(tmp_path)
    (tmp_path / "broken.stl").write_text("no mesh")
    path = Path(str(robot.provenance["source"]))
    text = path.read_text().replace(SPHERE, '<mesh filename="gone.stl"/>', 1)
    before, last = text.split('<link name="b">')
    path.write_text(before + '<link name="b">' + last.replace(SPHERE, '<mesh filename="broken.stl"/>', 1))
    assert read_shapes(Robot.load(path)) == (None, ("base", "a", "b", "c"))
