"""Hulls of mesh files: closed forms, and what is kept of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgpi.base import cache
from armgpi.robot import mesh_files
from armgpi.robot.mesh_hulls import hull_of
from armgpi.robot.meshes import Found

#: Edges of the box [m].
EDGES = (0.2, 0.3, 0.5)


def stl_of(corners: np.ndarray, triangles: np.ndarray) -> bytes:
    """Return a binary STL file of triangles, by the indices of their corners."""
    kind = np.dtype([("corners", "<f4", (4, 3)), ("more", "<u2")])
    rows = np.zeros(len(triangles), kind)
    rows["corners"][:, 1:] = corners[triangles]
    return bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes()


def box(path: Path, edges: tuple[float, float, float] = EDGES) -> Found:
    """Write a box as a mesh whose triangles join each corner with the centre, and so are no surface."""
    signs = np.array(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0])).reshape(3, -1).T
    corners = np.vstack([signs * edges, np.array(edges) / 2.0])
    triangles = np.array([(i, (i + 1) % 8, 8) for i in range(8)])
    path.write_bytes(stl_of(corners, triangles))
    return Found(path.name, path, "")


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARMGPI_CACHE", str(tmp_path / "cache"))


def test_a_box_has_eight_corners_and_its_volume(tmp_path: Path) -> None:
    hull = hull_of(box(tmp_path / "box.stl"))
    assert hull.corners.shape == (8, 3)
    assert hull.volume == pytest.approx(np.prod(EDGES), rel=1e-6)  # STL holds single precision


def test_centre_and_spread_of_a_box_and_of_a_tetrahedron_are_those_of_their_integrals(tmp_path: Path) -> None:
    hull = hull_of(box(tmp_path / "box.stl"))
    np.testing.assert_allclose(hull.centre, np.array(EDGES) / 2.0, rtol=1e-6)
    np.testing.assert_allclose(hull.spread, np.diag(np.square(EDGES)) / 12.0, rtol=1e-6, atol=1e-9)
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    path = tmp_path / "corner.stl"
    path.write_bytes(stl_of(corners, np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])))
    hull = hull_of(Found(path.name, path, ""))
    # x has the mean 1/4, x^2 the mean 1/10, x y the mean 1/20.
    np.testing.assert_allclose(hull.centre, np.full(3, 0.25), rtol=1e-6)
    np.testing.assert_allclose(hull.spread, np.eye(3) / 20.0 + 0.05 - 0.0625, rtol=1e-6)


def test_what_is_kept_has_the_same_bits_and_needs_no_reader(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = box(tmp_path / "box.stl")
    first = hull_of(found)

    def refuse(*_: Any) -> Any:
        raise AssertionError("the mesh is read again")

    monkeypatch.setattr(mesh_files, "corners", refuse)
    again = hull_of(found)
    assert np.array_equal(first.corners, again.corners)
    assert first.volume == again.volume
    assert np.array_equal(first.centre, again.centre)
    assert np.array_equal(first.spread, again.spread)


def test_another_file_at_the_same_place_has_another_hull(tmp_path: Path) -> None:
    hull_of(box(tmp_path / "box.stl"))
    larger = hull_of(box(tmp_path / "box.stl", (1.0, 1.0, 1.0)))
    assert larger.volume == pytest.approx(1.0, rel=1e-6)


SOLID = {"corners": np.eye(3).tolist(), "volume": 1.0, "centre": [0.0] * 3, "spread": np.eye(3).tolist()}


@pytest.mark.parametrize(
    "plain",
    [
        [],
        {},
        {"corners": [1.0], "volume": 1.0},
        {"corners": "a", "volume": {}},
        {**SOLID, "volume": 10**400},
        {**SOLID, "volume": -1.0},
    ],
)
def test_what_was_kept_by_another_program_is_worked_out_anew(
    plain: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armgpi.robot.mesh_hulls.read_result", lambda key: plain)
    assert hull_of(box(tmp_path / "box.stl")).volume == pytest.approx(np.prod(EDGES), rel=1e-6)


def test_a_flat_mesh_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(mesh_files.MeshError, match=r"flat\.stl.*enclose no volume"):
        hull_of(box(tmp_path / "flat.stl", (1.0, 1.0, 0.0)))


def test_without_a_cache_that_can_be_used_the_hull_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("ARMGPI_CACHE", str(blocked / "below"))
    assert cache.cache_folder() == blocked / "below"
    assert hull_of(box(tmp_path / "box.stl")).volume == pytest.approx(np.prod(EDGES), rel=1e-6)
