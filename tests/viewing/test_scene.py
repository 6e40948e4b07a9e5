"""The scene: bodies move as Pinocchio says, meshes come from the robot's package, bad ones are named."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pictured import box_mesh, chain, chain_urdf, compared, made_up, package, run
from strategies import robots_and_states

import armgpi
from armgpi import ArmgpiWarning, Robot, robots
from armgpi.errors import NameNotFound, Remedy, RolloutError
from armgpi.viewing import meshes, scene
from armgpi.viewing.scene import Scene

ARM = Robot.load("anthropomorphic3")
EXAMPLES = [name for name in ("panda", "ur5", "kinova", "talos_left_arm", "so101") if name in robots.names()]


def poses(arm: Scene, q: np.ndarray) -> list[np.ndarray]:
    """Where the bodies are, from the scene's own data: the way the page does it."""
    found: list[np.ndarray] = []
    for body in arm.bodies:
        motion = np.eye(4)
        at = body.ratio * q[body.coordinate] + body.offset
        if body.kind == "prismatic":
            motion[:3, 3] = at * body.axis
        elif body.kind:
            x, y, z = body.axis
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            motion[:3, :3] += np.sin(at) * cross + (1 - np.cos(at)) * cross @ cross
        parent = np.eye(4) if body.parent < 0 else found[body.parent]
        found.append(parent @ body.placement @ motion)
    return found


@pytest.mark.slow
@settings(max_examples=20)
@given(robots_and_states())
def test_bodies_of_any_robot_are_where_pinocchio_puts_them(case: tuple[Robot, object]) -> None:
    robot, state = case
    arm = scene.build(robot)
    there = poses(arm, state.q)  # type: ignore[attr-defined]
    for body, pose in zip(arm.bodies, there, strict=True):
        for link in body.links:
            expected = robot.frame_pose(link, state.q)  # type: ignore[attr-defined]
            offset = robot.pinocchio_model().frames[robot._frame(link)].placement.homogeneous
            assert np.allclose((pose @ offset)[:3, 3], expected.translation, atol=1e-9)
            assert np.allclose((pose @ offset)[:3, :3], expected.rotation, atol=1e-9)
    tip = there[arm.tip_body] @ arm.tip
    assert np.allclose(tip[:3, 3], robot.frame_pose(robot.tip, state.q).translation, atol=1e-9)  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_robots_are_drawn_from_their_own_meshes(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)  # of a gripper's mimic joints
        arm = scene.build(Robot.load(name))
    assert arm.drawn_as == "meshes"
    assert arm.findings == ()
    fine = sum(len(body.triangles.faces) for body in arm.bodies)
    coarse = sum(len(body.coarse.faces) for body in arm.bodies)
    assert 1000 < fine <= 1.1 * scene.TRIANGLES
    assert coarse < 2 * scene.COARSE


def test_meshes_are_where_assimp_finds_them() -> None:
    pytest.importorskip("coal")
    if "ur5" not in robots.names():
        pytest.skip("example-robot-data is not installed")
    robot = Robot.load("ur5")
    for part in ("visual/base.dae", "visual/forearm.dae", "collision/wrist1.stl"):
        name = f"package://example-robot-data/robots/ur_description/meshes/ur5/{part}"
        ours = meshes.load(robot, name).points
        path = meshes.resolve_mesh(robot, name)
        other = coal.MeshLoader().load(str(path))
        other.computeLocalAABB()
        assert np.allclose(ours.min(axis=0), other.aabb_local.min_, atol=1e-5)
        assert np.allclose(ours.max(axis=0), other.aabb_local.max_, atol=1e-5)


@pytest.mark.parametrize("kind", meshes.KINDS)
def test_a_box_is_a_box_in_every_format(kind: str, tmp_path: Path) -> None:
    robot = Robot.load(package(tmp_path, **{f"box_{kind}": box_mesh(kind)}))
    part = meshes.load(robot, f"package://pkg/meshes/box.{kind}")
    assert np.allclose(np.ptp(part.points, axis=0), [0.1, 0.2, 0.3])
    assert np.allclose(np.linalg.norm(part.normals, axis=1), 1.0)
    if kind == "stl":  # no normals of its own: its sides are shaded flat, along the axes
        assert np.allclose(np.abs(part.normals).max(axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("kind", ["dae", "stl"])
def test_triangles_are_kept_with_the_same_bits_and_need_no_reader(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ARMGPI_CACHE", str(tmp_path / "cache"))
    content = box_mesh(kind)
    first = meshes._read_or_kept(content, kind, "mesh")

    def refuse(*_: object) -> object:
        raise AssertionError("the mesh is read again")

    with monkeypatch.context() as patch:
        patch.setattr(meshes, "_parts", refuse)
        for ours, kept in zip(first, meshes._read_or_kept(content, kind, "mesh"), strict=True):
            assert np.array_equal(ours, kept, equal_nan=True)
            assert ours.dtype == kept.dtype
    others: list[Any] = [[], {"corners": 1}, {"corners": 1, "faces": 1, "numbers": "AAAA"}]
    for plain in others:
        monkeypatch.setattr(meshes, "read_result", lambda key, plain=plain: plain)
        assert np.array_equal(meshes._read_or_kept(content, kind, "mesh").points, first.points)


def test_a_mesh_in_millimetres_is_in_metres_when_drawn(tmp_path: Path) -> None:
    unit = '<unit name="millimeter" meter="0.001"/>'
    scaled = box_mesh("dae").decode().replace("</created>", f"</created>{unit}")
    robot = Robot.load(package(tmp_path, box_dae=scaled))
    part = meshes.load(robot, "package://pkg/meshes/box.dae")
    assert np.allclose(np.ptp(part.points, axis=0), [1e-4, 2e-4, 3e-4])


# Files that nobody vouches for.


def textured(target: str) -> str:
    """A Collada box that names a picture as its texture."""
    image = f'<library_images><image id="t"><init_from>{target}</init_from></image></library_images>'
    return box_mesh("dae").decode().replace("<library_effects>", image + "<library_effects>", 1)


def lying(count: int) -> bytes:
    """A binary STL file that says how many triangles it has, whatever it has."""
    content = bytearray(box_mesh("stl"))
    content[80:84] = struct.pack("<I", count)
    return bytes(content)


def with_nan() -> bytes:
    """A binary STL file with a corner that is not a number."""
    content = bytearray(box_mesh("stl"))
    content[96:100] = struct.pack("<f", float("nan"))
    return bytes(content)


def parts_within_parts(depth: int) -> str:
    """A Collada file that draws its box 2^depth times."""
    content = box_mesh("dae").decode()
    start = content.index("<visual_scene")
    begin = content.index(">", start) + 1
    end = content.index("</visual_scene>")
    nodes = [content[begin:end].replace("<node ", '<node id="n0" ', 1)]
    inner = f"<node id='n0'>{content[begin:end]}</node>"
    nodes = [inner]
    for i in range(1, depth):
        nodes.append(f"<node id='n{i}'>" + f"<instance_node url='#n{i - 1}'/>" * 2 + "</node>")
    library = f"<library_nodes>{''.join(nodes)}</library_nodes>"
    scene_part = f"<node><instance_node url='#n{depth - 1}'/></node>"
    content = content[:begin] + scene_part + content[end:]
    return content.replace("<library_visual_scenes>", library + "<library_visual_scenes>", 1)


BAD = {
    "liar_stl": (lying(4_000_000_000), "declares 4000000000 triangles"),
    "nan_stl": (with_nan(), "not finite"),
    "empty_stl": (b"", "no STL file"),
    "noise_dae": (bytes(range(256)), "no well-formed XML"),
    "bomb_dae": ("<!DOCTYPE x [<!ENTITY a 'aaaa'>]>" + box_mesh("dae").decode().split("?>", 1)[-1], "DTD"),
    "many_dae": (parts_within_parts(40), "more than 20000 times"),
    "torn_obj": ("v 0 0 0\nv 1 0 0\nf 1 2 99\n", "damaged"),
    "far_stl": (trimesh.creation.box(extents=(1e6, 1, 1)).export(file_type="stl"), "beyond"),
    "odd_step": ("ISO-10303-21;", "odd.step"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_mesh_is_named_and_the_rest_is_shown(name: str, tmp_path: Path) -> None:
    content, reason = BAD[name]
    arm = scene.build(Robot.load(package(tmp_path, good_stl=box_mesh("stl"), **{name: content})))
    (finding,) = arm.findings
    assert name.rpartition("_")[0] in finding
    assert reason in finding
    assert arm.drawn_as == "meshes"
    assert len(arm.bodies[0].triangles.faces) == 12


@pytest.mark.parametrize("target", ["../../../secret.png", "file:///etc/passwd", "/etc/passwd"])
def test_textures_are_never_read(target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "secret.png").write_bytes(b"TOP SECRET")
    urdf = package(tmp_path, box_dae=textured(target))
    read: list[str] = []
    original = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda self: read.append(self.name) or original(self))  # type: ignore[func-returns-value]
    arm = scene.build(Robot.load(urdf))
    assert arm.findings == ()
    assert set(read) <= {"arm.urdf", "box.dae"}


@pytest.mark.parametrize(
    "name",
    [
        "package://pkg/../../secret.stl",
        "package://pkg/meshes/link.stl",
        "package://../secret.stl",
        "package://etc/passwd",
        "package:///etc/passwd",
        "../../../secret.stl",
        "file:///etc/passwd",
        "/etc/passwd",
        "http://example.com/a.stl",
        "package://pkg/meshes/none.stl",
        "package://pkg/meshes",
        "",
        "\0",
        "package://pkg/" + "x" * 5000,
    ],
)
def test_files_outside_the_package_are_not_found(name: str, tmp_path: Path) -> None:
    (tmp_path / "secret.stl").write_bytes(box_mesh("stl"))
    urdf = package(tmp_path, good_stl=box_mesh("stl"))
    (urdf.parents[1] / "meshes" / "link.stl").symlink_to(tmp_path / "secret.stl")
    assert meshes.resolve_mesh(Robot.load(urdf), name) is None


@pytest.mark.parametrize("name", ["package://pkg/meshes/good.stl", "../meshes/good.stl"])
def test_files_of_the_package_are_found(name: str, tmp_path: Path) -> None:
    urdf = package(tmp_path, good_stl=box_mesh("stl"))
    assert meshes.resolve_mesh(Robot.load(urdf), name) == urdf.parents[1] / "meshes" / "good.stl"


def test_a_package_beside_needs_to_be_one(tmp_path: Path) -> None:
    urdf = package(tmp_path, good_stl=box_mesh("stl"))
    other = tmp_path / "other"
    other.mkdir()
    (other / "part.stl").write_bytes(box_mesh("stl"))
    robot = Robot.load(urdf)
    assert meshes.resolve_mesh(robot, "package://other/part.stl") is None
    (other / "package.xml").write_text("<package><name>other</name></package>")
    assert meshes.resolve_mesh(robot, "package://other/part.stl") == other / "part.stl"


def test_no_visuals_make_sticks() -> None:
    arm = scene.build(chain(5))
    assert arm.drawn_as == "sticks"
    assert all(len(body.triangles.faces) for body in arm.bodies)


def test_a_last_link_without_a_tool_is_a_stick_to_its_mass() -> None:
    robot = Robot.from_xml(
        "<robot name='one'><link name='base'/><link name='arm'><inertial><origin xyz='0.25 0 0'/>"
        "<mass value='1'/><inertia ixx='1e-4' ixy='0' ixz='0' iyy='0.02' iyz='0' izz='0.02'/></inertial>"
        "</link>"
        "<joint name='a' type='revolute'><parent link='base'/><child link='arm'/><axis xyz='0 1 0'/>"
        "<limit lower='-1' upper='1' velocity='1' effort='9'/></joint></robot>"
    )
    arm = scene.build(robot)
    assert arm.size == pytest.approx(0.25)
    assert arm.bodies[1].triangles.points[:, 0].max() == pytest.approx(0.25, rel=1e-6)


def test_rings_around_the_joints_of_short_links_do_not_reach_the_next_ones(tmp_path: Path) -> None:
    text = chain_urdf(14, reach=2.1)
    boxes = (
        "<visual><origin xyz='0.075 0 0'/><geometry><box size='0.15 0.02 0.02'/></geometry></visual></link>"
    )
    urdf = tmp_path / "chain.urdf"
    urdf.write_text(text.replace("</link>", boxes))
    arm = scene.build(Robot.load(urdf))
    assert max(body.ring for body in arm.bodies[1:]) < 0.75 * 0.15


def test_colours_and_primitives_of_the_urdf(tmp_path: Path) -> None:
    urdf = package(tmp_path, good_stl=box_mesh("stl"))
    text = urdf.read_text()
    text = text.replace("</visual>", '<material name="red"><color rgba="1 0 0 1"/></material></visual>')
    shapes = '<cylinder radius="0.1" length="0.4"/>', '<sphere radius="0.2"/>', '<box size="0.1 0.2 0.4"/>'
    extents = [0.2, 0.2, 0.4], [0.4, 0.4, 0.4], [0.1, 0.2, 0.4]
    for shape, extent in zip(shapes, extents, strict=True):
        visual = f'<visual><origin xyz="0 0 1"/><geometry>{shape}</geometry><material name="red"/></visual>'
        urdf.write_text(text.replace('<link name="end">', f'<link name="end">{visual}'))
        robot = Robot.load(urdf)
        arm = scene.build(robot)
        base, end = arm.bodies[0].triangles, arm.bodies[1].triangles
        assert np.array_equal(np.unique(base.colors, axis=0), [[1.0, 0.0, 0.0]])
        assert np.allclose(np.ptp(end.points, axis=0), extent, rtol=0.02)
        assert np.allclose(end.points.mean(axis=0)[2], 1.0, atol=0.01)


@settings(max_examples=10)
@given(most=st.integers(50, 2000), box=st.booleans())
def test_simplified_meshes_stay_where_they_were_and_do_not_tear(most: int, box: bool) -> None:
    part = meshes.sphere(0.5)
    if box:  # with edges, fine enough to be simplified
        points, faces = trimesh.remesh.subdivide_to_size(*meshes.box(1.0, 1.0, 1.0)[::3], max_edge=0.08)
        facing = np.abs(points).argmax(axis=1)
        part = meshes.Triangles(points, np.sign(points) * np.eye(3)[facing], np.ones_like(points), faces)
    few = meshes.simplify(part, most)
    a, b, c = (few.points[few.faces[:, i]] for i in range(3))
    assert (np.einsum("ij,ikj->i", np.cross(b - a, c - a), few.normals[few.faces]) >= 0.0).all()
    assert len(few.faces) <= max(most, len(meshes.simplify(part, 1).faces))
    assert few.faces.max() < len(few.points)
    assert np.allclose(few.points.min(axis=0), part.points.min(axis=0), atol=0.3)
    # Closed as before: every edge, by its ends' places, has a triangle on both sides.
    _, place = np.unique(few.points, axis=0, return_inverse=True)
    corners = place.ravel()[few.faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    _, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert (count % 2 == 0).all()


# Rollouts as frames.


def test_frames_are_samples_of_the_rollout() -> None:
    rollout = run(ARM, t_final=0.5)
    clip = scene.clip(rollout, ARM)
    assert clip.times[0] == 0.0
    assert clip.times[-1] == pytest.approx(0.5)
    at = rollout.sel(time=clip.times)
    (actor,) = clip.actors
    assert np.array_equal(actor.q, at["q"].values.astype(np.float32))
    assert np.array_equal(actor.tau, at["tau"].values.astype(np.float32))
    assert clip.onsets == {name: pytest.approx(0.1) for name in ARM.joint_names}


def test_frames_keep_to_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene, "FRAME_BYTES", 17 * 3 * 2 * 50)
    rollout = compared(a=run(ARM), b=run(ARM, omega=30.0))
    assert len(scene.clip(rollout, ARM).times) <= 50


def test_a_short_saturation_is_not_lost_between_frames() -> None:
    rollout = run(ARM, t_final=0.3).copy(deep=True)
    rollout["tau"].values[123, 1] = rollout["effort"].values[1]
    (actor,) = scene.clip(rollout, ARM).actors
    assert actor.saturated[:, 1].sum() == 1
    assert actor.saturated[:, [0, 2]].sum() == 0


def test_after_the_end_the_pose_is_held() -> None:
    rollout = run(ARM).copy(deep=True)
    rollout["q"].values[200:] = np.nan
    rollout["status"].data = np.int32(armgpi.Status.DIVERGED)
    rollout["t_end"].data = np.float64(0.2)
    (actor,) = scene.clip(rollout, ARM).actors
    assert np.isfinite(actor.q).all()
    assert np.array_equal(actor.q[-1], rollout["q"].values[199].astype(np.float32))
    assert actor.end == "diverged at 0.2 s"


def test_a_crowd_is_thinned_and_counted() -> None:
    rollout = compared(**{f"run {i}": made_up(ARM) for i in range(9)})
    clip = scene.clip(rollout, ARM)
    assert len(clip.actors) == scene.MOST_ROBOTS
    assert clip.left_out == 9 - scene.MOST_ROBOTS


def test_the_robot_of_a_rollout_is_found_again(tmp_path: Path) -> None:
    urdf = package(tmp_path, good_stl=box_mesh("stl"))
    urdf.write_text(chain_text := urdf.read_text().replace('name="chain"', 'name="mine"'))
    rollout = run(Robot.load(urdf), t_final=0.05)
    assert scene.robot_of(rollout).joint_names == ("to end",)
    (tmp_path / "results").mkdir()
    urdf.rename(tmp_path / "results" / "arm.urdf")  # as when the results went to another machine
    assert scene.robot_of(rollout, tmp_path / "results").joint_names == ("to end",)
    with pytest.raises(RolloutError, match=r"'mine'.*was not found.*specify a robot") as caught:
        scene.robot_of(rollout)
    assert caught.value.remedies == (Remedy("robot"),)
    urdf.write_text(chain_text.replace("0.01", "0.02"))
    with pytest.raises(RolloutError, match="has changed"):
        scene.robot_of(rollout)


def test_locked_joints_stay_locked() -> None:
    robot = chain(4)
    with pytest.raises(RolloutError, match="was not found"):
        scene.robot_of(run(robot, t_final=0.02))  # it was no file
    if "kinova" in robots.names():
        names = ("j2s6s200_joint_finger_1", "j2s6s200_joint_finger_2")
        whole = Robot.load("kinova")
        lock = {name: 0.3 for name in whole.joint_names if name in names} or {whole.joint_names[-1]: 0.3}
        robot = Robot.load("kinova", lock=lock)
        again = scene.robot_of(made_up_of(robot))
        assert again.joint_names == robot.joint_names
        assert again.provenance["locked"] == robot.provenance["locked"]


def made_up_of(robot: Robot) -> object:
    """A short rollout that says which robot it is of."""
    return run(robot, move=0.01, t_final=0.02)


def test_a_rollout_of_another_robot_is_refused() -> None:
    with pytest.raises(RolloutError, match="joint0"):
        scene.clip(run(ARM, t_final=0.02), chain(3))
    with pytest.raises(NameNotFound, match="hand"):
        scene.build(ARM, "hand")


def test_corners_of_a_part_far_from_its_origin_are_merged_by_what_they_look_like() -> None:
    points = np.array([1e3, -1e3, 0.0]) + np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0]])
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    part = meshes.Triangles(np.tile(points, (2, 1)), np.eye(3)[[2] * 6], np.ones((6, 3)), faces)
    merged = scene._merge_equal_corners(part)
    assert len(merged.points) == 3
    assert len(merged.faces) == 2
