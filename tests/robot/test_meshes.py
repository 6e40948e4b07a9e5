"""Meshes: found as ROS finds them, and nothing outside the robot's folders is ever read."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from armgpi.robot import mesh_files
from armgpi.robot.meshes import MeshFinder

MANIFEST = "<package><name>{}</name></package>"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package `arm_description` with a URDF and a mesh, and secrets beside it."""
    for file in ("ws/arm/urdf/arm.urdf", "ws/arm/meshes/link.stl", "ws/arm/urdf/near.stl", "secret.stl"):
        path = tmp_path / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("solid")
    root = tmp_path / "ws" / "arm"
    (root / "package.xml").write_text(MANIFEST.format("arm_description"))
    return root


def find(package: Path, name: str, *package_dirs: Path) -> str:
    """Return the file found, relative to the package, or why there is none."""
    found = MeshFinder(package / "urdf" / "arm.urdf", package_dirs).find(name)
    assert (found.path is None) == bool(found.reason)
    assert found.name == name
    return found.reason if found.path is None else str(found.path.relative_to(package.resolve()))


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("package://arm_description/meshes/link.stl", "meshes/link.stl"),
        ("package:///arm_description/meshes/link.stl", "meshes/link.stl"),  # as example-robot-data writes it
        ("package://arm/meshes/link.stl", "meshes/link.stl"),  # by the folder's name
        ("model://arm/meshes/link.stl", "meshes/link.stl"),
        ("../meshes/link.stl", "meshes/link.stl"),
        ("meshes/link.stl", "meshes/link.stl"),  # from the package
        ("near.stl", "urdf/near.stl"),
        ("..\\meshes\\link.stl", "meshes/link.stl"),
        ("package://arm_description/meshes/../meshes/link.stl", "meshes/link.stl"),
    ],
)
def test_a_mesh_is_found_however_its_path_is_written(package: Path, name: str, file: str) -> None:
    assert find(package, name) == file


def test_an_absolute_path_inside_the_package_is_found(package: Path) -> None:
    mesh = package / "meshes" / "link.stl"
    for name in (str(mesh), f"file://{mesh}", f"file://localhost{mesh}", f"file:{mesh}"):
        assert find(package, name) == "meshes/link.stl", name


@pytest.mark.parametrize(
    "name",
    [
        "../../../secret.stl",
        "package://arm_description/../../secret.stl",
        "package://arm_description/meshes/../../../secret.stl",
        "package://ws/../secret.stl",
        "package://arm/%2e%2e/%2e%2e/secret.stl",
    ],
)
def test_what_is_outside_the_package_is_not_read(package: Path, name: str) -> None:
    assert "outside" in find(package, name)


def test_neither_by_an_absolute_path_nor_by_a_link(package: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret.stl"
    (package / "meshes" / "link2.stl").symlink_to(secret)
    for name in (str(secret), f"file://{secret}", "package://arm_description/meshes/link2.stl"):
        assert "outside the robot's folders" in find(package, name)


def test_the_user_may_allow_a_folder(package: Path, tmp_path: Path) -> None:
    finder = MeshFinder(package / "urdf" / "arm.urdf", [tmp_path])
    assert finder.find("../../../secret.stl").path == (tmp_path / "secret.stl").resolve()


def test_a_url_may_not_name_any_folder_above_as_a_package(tmp_path: Path) -> None:
    # With ~/robot/urdf/arm.urdf, package://.ssh/key would be ~/.ssh/key.
    (tmp_path / "a" / "b" / "c" / "urdf").mkdir(parents=True)
    (tmp_path / ".ssh").mkdir()
    (tmp_path / ".ssh" / "key.stl").write_text("x")
    (tmp_path / "a" / "other.stl").write_text("x")
    finder = MeshFinder(tmp_path / "a" / "b" / "c" / "urdf" / "arm.urdf")
    for name in (
        "package://.ssh/key.stl",
        "package://a/other.stl",
        f"package://{tmp_path.name}/.ssh/key.stl",
    ):
        assert finder.find(name).path is None, name


def test_a_sibling_package_counts_by_its_manifest(package: Path) -> None:
    other = package.parent / "gripper"
    other.mkdir()
    (other / "finger.stl").write_text("x")
    finder = MeshFinder(package / "urdf" / "arm.urdf")
    assert "no package 'gripper'" in finder.find("package://gripper/finger.stl").reason
    (other / "package.xml").write_text(MANIFEST.format("gripper"))
    assert finder.find("package://gripper/finger.stl").path == (other / "finger.stl").resolve()


def test_ros_package_path_and_package_dirs_are_searched(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = tmp_path / "opt" / "hand"
    far.mkdir(parents=True)
    (far / "palm.stl").write_text("x")
    urdf, name = package / "urdf" / "arm.urdf", "package://hand/palm.stl"
    assert MeshFinder(urdf).find(name).path is None
    for folder in (far.parent, far):
        assert MeshFinder(urdf, [folder]).find(name).path == (far / "palm.stl").resolve()
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{far.parent}")
    assert MeshFinder(urdf).find(name).path == (far / "palm.stl").resolve()


def test_packages_of_ros_2_are_found(package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    palm = tmp_path / "install" / "hand" / "share" / "hand" / "palm.stl"
    palm.parent.mkdir(parents=True)
    palm.write_text("x")
    (palm.parent / "package.xml").write_text(MANIFEST.format("hand"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path / 'install' / 'hand'}")
    assert MeshFinder(package / "urdf" / "arm.urdf").find("package://hand/palm.stl").path == palm.resolve()


def test_a_missing_mesh_names_every_path_that_was_tried(package: Path) -> None:
    found = MeshFinder(package / "urdf" / "arm.urdf").find("meshes/gone.stl")
    assert found.path is None
    assert [path.parent.parent.name for path in found.tried] == ["urdf", "arm"]
    assert found.reason == "there is no such file"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("http://127.0.0.1:9/x.stl", "not downloaded"),
        ("https://example.org/x.stl", "not downloaded"),
        ("ftp://x/y.stl", "not downloaded"),
        ("file://server/x.stl", "another machine"),
        ("file://home/me/x.stl", "three slashes"),
        ("file:///a%00b.stl", "no such file"),
        ("file://LOCALHOST/a.stl", "no such file"),
        ("package://", "expected package://"),
        ("package://../x.stl", "expected package://"),
        ("", "no file name"),
        ("a\0b.stl", "no file name"),
        ("x" * 5000 + ".stl", "no such file"),
        ("arm.urdf", "not one of"),  # not a mesh by its name
        ("$(find arm)/x.stl", "no such file"),
        (".", "not one of"),
    ],
)
def test_names_that_lead_nowhere_say_so(package: Path, name: str, said: str) -> None:
    assert said in find(package, name)


def test_only_regular_files_are_meshes(package: Path) -> None:
    (package / "urdf" / "pipe.stl").mkdir()
    assert "no regular file" in find(package, "pipe.stl")


def test_a_text_has_no_folder_but_those_given(package: Path) -> None:
    assert MeshFinder(None).find("meshes/link.stl").path is None
    assert MeshFinder(None, [package]).find("meshes/link.stl").path is not None


# --- Textures of COLLADA files -------------------------------------------------------------------


def test_parts_of_a_collada_file_may_be_nested_as_deep_as_is_said_and_no_deeper() -> None:
    def parts(deep: int) -> ElementTree.Element:
        inner = "<node>" * deep + "<instance_geometry/>" + "</node>" * deep
        return ElementTree.fromstring(f'<node xmlns="c">{inner}</node>')

    assert mesh_files._instances(parts(60), {}, {}, "deep.dae") == 1
    with pytest.raises(mesh_files.MeshError, match="more than 60 deep"):
        mesh_files._instances(parts(61), {}, {}, "deep.dae")
