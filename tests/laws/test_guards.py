"""What may be so many may be just so many, and not one more: the guards of readers, tables and lists.

Each bound is set to what a small case has, which passes, and then to one less, which is refused or left out.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

import armgpi
from armgpi.base import arrays, hdf5, yaml_text
from armgpi.certification import trigonometric
from armgpi.errors import ArrayError, ConfigError, ParameterError, UrdfError
from armgpi.health import findings
from armgpi.health.findings import Finding
from armgpi.identification import logs
from armgpi.robot import mesh_files, meshes, mjcf_files
from armgpi.robot.mesh_files import MeshError
from armgpi.studies import objective, results, study
from armgpi.tuning import advice
from armgpi.viewing import meshes as drawn_meshes


class Guard(NamedTuple):
    """A bound, what is read under it, and how one more ends.

    Attributes:
        module: where the bound is.
        name: of the bound.
        most: what the case has.
        read: reads the case, in a folder.
        error: what is raised with a bound of one less.
        words: what it says.
    """

    module: ModuleType
    name: str
    most: int
    read: Callable[[Path], object]
    error: type[Exception]
    words: str


def netcdf(folder: Path, fill: Callable[[Any], object]) -> None:
    """Check an HDF5 file."""
    path = folder / "a.nc"
    with h5py.File(path, "w") as file:
        fill(file)
    hdf5.check(path)


def three_variables(file: Any) -> None:
    for name in "abc":
        file[name] = np.zeros(2)


def three_texts(file: Any) -> None:
    file.create_dataset("words", data=["a", "b", "c"], dtype=h5py.string_dtype())


def three_values(file: Any) -> None:
    file.attrs["range"] = np.zeros(3)


def model(folder: Path, inside: str) -> None:
    """Check an MJCF."""
    path = folder / "m.xml"
    path.write_text(f"<mujoco>{inside}</mujoco>")
    mjcf_files.check(path)


def includes(folder: Path, depth: int) -> None:
    """Check a model that includes a file that includes a file, so deep."""
    for k in range(1, depth + 1):
        inner = f"<include file='{k + 1}.xml'/>" if k < depth else ""
        (folder / f"{k}.xml").write_text(f"<mujocoinclude>{inner}</mujocoinclude>")
    model(folder, "<include file='1.xml'/>")


def textures(folder: Path, count: int = 1) -> None:
    """Check a model with textures of 3 x 4 pixels."""
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 3, 4) + bytes(20)
    named = []
    for k in range(count):
        (folder / f"{k}.png").write_bytes(png)
        named.append(f"<texture name='t{k}' file='{k}.png'/>")
    model(folder, f"<asset>{''.join(named)}</asset>")


def collada(folder: Path, count: int) -> None:
    """Check a Collada file that draws a part so many times."""
    parts = "<node><instance_geometry/></node>" * count
    scene = f"<visual_scene>{parts}</visual_scene>"
    mesh_files._check_collada(f'<COLLADA xmlns="c">{scene}</COLLADA>'.encode(), "part.dae")


def polynomials(folder: Path) -> object:
    """Work out the polynomials of an arm with three joints that turn, on a grid of five each."""
    return trigonometric.polynomials_of([armgpi.Robot.load("anthropomorphic3")], np.zeros(3))


def log(folder: Path, samples: int) -> object:
    """Read a log of so many samples."""
    t = 0.01 * np.arange(samples)
    zeros = np.zeros((samples, 3))
    given = logs.Log(t, zeros, zeros)
    return logs.read_log(given, armgpi.Robot.load("anthropomorphic3"))


GUARDS = {
    "groups and variables": Guard(
        hdf5, "_MOST_OBJECTS", 4, lambda x: netcdf(x, three_variables), hdf5.Refused, "more than 3 groups"
    ),
    "texts of a variable": Guard(
        hdf5, "_MOST_TEXTS", 3, lambda x: netcdf(x, three_texts), hdf5.Refused, "more than 2 texts"
    ),
    "values of an attribute": Guard(
        hdf5, "_MOST_TEXTS", 3, lambda x: netcdf(x, three_values), hdf5.Refused, "has 3 values"
    ),
    "keys and values": Guard(
        yaml_text, "_MAX_NODES", 3, lambda _: yaml_text.parse("a: 1", "x"), ConfigError, "more than 2 keys"
    ),
    "keys and values, aliases written out": Guard(
        yaml_text,
        "_MAX_NODES",
        11,
        lambda _: yaml_text.parse("a: &x [1, 2, 3]\nb: *x", "x"),
        ConfigError,
        "more than 10 keys",
    ),
    "characters of a value": Guard(
        yaml_text, "_MAX_TEXT", 4, lambda _: yaml_text.parse("a: word", "x"), ConfigError, "more than 3 char"
    ),
    "samples of a grid": Guard(
        trigonometric, "_MOST", 125, polynomials, ParameterError, "at most 8 joints for a proof"
    ),
    "files that are named": Guard(
        mjcf_files, "_MANY", 3, lambda x: textures(x, 3), UrdfError, "names more than 2 files"
    ),
    "pixels of a texture": Guard(mjcf_files, "_PIXELS", 12, textures, UrdfError, "3 x 4, more than 11"),
    "files that are included": Guard(
        mjcf_files, "_INCLUDED", 4, lambda x: includes(x, 3), UrdfError, "or more than 3"
    ),
    "depth of includes": Guard(
        mjcf_files, "_DEPTH", 3, lambda x: includes(x, 3), UrdfError, "more than 2 deep"
    ),
    "copies of parts": Guard(
        mjcf_files,
        "_COPIES",
        6,
        lambda x: model(x, "<replicate count='2'><replicate count='2'/></replicate>"),
        UrdfError,
        "more than 5 copies",
    ),
    "memory that is asked for": Guard(
        mjcf_files, "_MEMORY", 2048, lambda x: model(x, "<size memory='2K'/>"), UrdfError, "asks for 2K"
    ),
    "elements of an MJCF": Guard(
        mjcf_files, "MAX_ELEMENTS", 4, lambda x: model(x, "<option/><size/>"), UrdfError, "more than 3 el"
    ),
    "instances of parts": Guard(
        mesh_files, "_MAX_INSTANCES", 3, lambda x: collada(x, 3), MeshError, "more than 2 times"
    ),
    "characters of an objective": Guard(
        objective, "_LONGEST", 8, lambda _: objective.Objective("itae + 1"), ParameterError, "arithmetic"
    ),
}


@pytest.mark.parametrize("name", GUARDS)
def test_what_is_at_its_bound_passes_and_what_is_beyond_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    guard = GUARDS[name]
    monkeypatch.setattr(guard.module, guard.name, guard.most)
    guard.read(tmp_path)
    monkeypatch.setattr(guard.module, guard.name, guard.most - 1)
    with pytest.raises(guard.error, match=guard.words):
        guard.read(tmp_path)


def test_a_mesh_may_be_as_large_as_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path.resolve() / "part.stl"
    file.write_bytes(b"solid x")
    for most, refused in ((7, ""), (6, f"{file} has 7 bytes, more than the 6 allowed")):
        monkeypatch.setattr(meshes, "MAX_MESH_BYTES", most)
        assert meshes._refuse(file, file.stat(), [tmp_path.resolve()]) == refused


def test_a_mesh_may_have_as_many_triangles_as_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = [*np.eye(3), *np.eye(3)[::-1]]
    facets = [b"".join(np.asarray(x, "<f4").tobytes() for x in (np.zeros(3), *corners[:3])) + bytes(2)] * 2
    content = bytes(80) + struct.pack("<I", 2) + b"".join(facets)
    monkeypatch.setattr(drawn_meshes, "MAX_TRIANGLES", 2)
    assert len(drawn_meshes._read(content, "stl", "part.stl").faces) == 2
    monkeypatch.setattr(drawn_meshes, "MAX_TRIANGLES", 1)
    with pytest.raises(MeshError, match="has 2 triangles, more than 1"):
        drawn_meshes._read(content, "stl", "part.stl")


def test_a_log_has_at_least_twenty_samples() -> None:
    read = log(Path(), 20)
    assert len(read.t) == 20  # type: ignore[attr-defined]
    with pytest.raises(ArrayError, match="at least 20 increasing times"):
        log(Path(), 19)


def finding(message: str, where: str = "robot") -> Finding:
    return Finding("warning", where, message, None, None, "", (), kind="limits")


def test_five_findings_of_a_kind_are_listed_and_the_others_counted() -> None:
    words = ["one", "two", "three", "four", "five", "six", "seven"]
    for count, others in ((5, None), (6, "1 more of this kind"), (7, "2 more of this kind")):
        folded = findings.fold([finding(f"message {word}") for word in words[:count]])
        assert [each.message for each in folded[:5]] == [f"message {word}" for word in words[:5]]
        assert [each.message for each in folded[5:]] == ([] if others is None else [others])


def test_five_joints_of_a_finding_are_named_and_the_others_counted() -> None:
    for count, said in ((5, "'q0', 'q1', 'q2', 'q3', 'q4'"), (6, "'q0', 'q1', 'q2', 'q3', 'q4' and 1 more")):
        (folded,) = findings.fold([finding("message", f"joint 'q{k}'") for k in range(count)])
        assert folded.where.endswith(f" of joints {said}")


def test_eight_arms_of_a_batch_are_numbered_and_the_others_counted() -> None:
    assert advice._numbered(range(8)) == "0, 1, 2, 3, 4, 5, 6, 7"
    assert advice._numbered(range(9)) == "0, 1, 2, 3, 4, 5, 6, 7 and 1 more"
    assert advice._numbered(range(10)) == "0, 1, 2, 3, 4, 5, 6, 7 and 2 more"


def test_eight_values_of_a_number_are_parts_of_their_own() -> None:
    eight, nine = np.arange(8.0), np.arange(9.0)
    assert [part[:2] for part in results._cut(eight, 2)] == [(x, x) for x in eight]
    assert [part[:2] for part in results._cut(nine, 2)] == [(0.0, 4.0), (4.0, 8.0)]


def test_three_differences_of_a_study_are_named() -> None:
    there, here = {"a": 1, "b": 1, "c": 1, "d": 1}, {"a": 2, "b": 2, "c": 2, "d": 2}
    three = [f"{name}: 1 there, 2 here" for name in "abc"]
    assert study._differences({**there, "d": 2}, here) == three
    assert study._differences(there, here) == [*three, "..."]


def test_parts_of_parts_are_counted_as_often_as_they_are_drawn() -> None:
    """A part that is drawn twice by a part that is drawn three times is drawn six times."""
    text = """<c xmlns="c"><node id="a"><instance_geometry/></node>
    <node id="b"><instance_node url="#a"/><instance_node url="#a"/></node>
    <visual_scene>SCENE</visual_scene></c>"""
    root = ElementTree.fromstring(text.replace("SCENE", 3 * '<instance_node url="#b"/>'))
    nodes = {e.get("id"): e for e in root.iter() if e.get("id")}
    assert mesh_files._instances(root[-1], nodes, {}, "part.dae") == 6


def test_numbers_up_to_the_largest_are_taken_in_either_sign() -> None:
    names = ("q1", "q2")
    most = arrays.LARGEST
    taken = arrays.per_joint([most, -most], "effort", names, "finite", np.isfinite)
    assert taken.tolist() == [most, -most]
    for beyond in (np.nextafter(most, np.inf), -np.nextafter(most, np.inf)):
        with pytest.raises(ArrayError, match="q2"):
            arrays.per_joint([0.0, beyond], "effort", names, "finite", np.isfinite)
