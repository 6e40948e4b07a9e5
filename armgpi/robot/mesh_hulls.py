"""Convex hulls of mesh files, worked out once for each file and kept on the disk.

Reading a mesh needs packages whose import alone takes longer than all other checks of a robot together
(trimesh, scipy.spatial). A hull depends on nothing but the bytes of its file, so the second command that asks
for it neither parses the mesh nor imports these packages.
"""

from __future__ import annotations

import hashlib
from typing import Any, NamedTuple

import numpy as np

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.base.cache import keep_result, read_result
from armgpi.robot import mesh_files
from armgpi.robot.meshes import Found

#: Part of the key of what is kept: another number wherever reading or the form of a result changes.
_VERSION = "mesh hull 2"
#: So many corners are kept at most: as JSON they stay far below what the cache takes (1 MiB).
_MOST_KEPT = 10_000


class Hull(NamedTuple):
    """The convex hull of a mesh, in its file's own frame.

    Attributes:
        corners: of the hull [m, by the file's own unit], shape (m, 3).
        volume: of the hull [m^3].
        centre: of its volume [m], shape (3,).
        spread: mean of (x - centre) (x - centre)' over its volume [m^2], shape (3, 3).
    """

    corners: Array
    volume: float
    centre: Array
    spread: Array


def hull_of(found: Found, most: int = mesh_files.MAX_BYTES) -> Hull:
    """Return the convex hull of a mesh of a file of at most so many bytes.

    Raises:
        MeshError: when it is not there, larger, outside the robot's package, no mesh, or flat.
        MissingPackage: when trimesh is not installed, and the hull of this file was never kept.
    """
    path, kind, _ = mesh_files.checked(found, most)
    content = files.read_bytes(path, most)
    key = hashlib.sha256(f"{_VERSION} {kind}\n".encode() + content).hexdigest()[:32]
    kept = _read(read_result(key))
    if kept is not None:
        return kept
    hull = _convex(mesh_files.corners(content, kind, found.name), found.name)
    if len(hull.corners) <= _MOST_KEPT:
        keep_result(key, {name: np.asarray(value).tolist() for name, value in hull._asdict().items()})
    return hull


def _convex(points: Array, name: str) -> Hull:
    """Return the convex hull of points, shape (k, 3).

    Raises:
        MeshError: when they lie in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # here: it takes longer to import than Pinocchio

    try:
        hull = ConvexHull(np.unique(points, axis=0))
    except (QhullError, ValueError):
        raise mesh_files.MeshError(name, "is flat: its corners enclose no volume") from None
    return Hull(hull.points[hull.vertices], float(hull.volume), *_moments(hull.points[hull.simplices]))


def _moments(triangles: Array) -> tuple[Array, Array]:
    """Return centre and spread of what triangles (k, 3, 3) enclose, which is convex.

    A tetrahedron of a point inside and a triangle has the volume |det| / 6; the integral of x x' over it is
    (a a' + b b' + c c' + s s') volume / 20, where s = a + b + c, with its corners a, b and c from that point.
    """
    inside = triangles.mean(axis=(0, 1))
    corners = triangles - inside
    volumes = np.abs(np.linalg.det(corners)) / 6.0
    sums = corners.sum(axis=1)
    centre = volumes @ sums / (4.0 * volumes.sum())
    squares = np.einsum("k,kai,kaj->ij", volumes, corners, corners) + np.einsum(
        "k,ki,kj->ij", volumes, sums, sums
    )
    return inside + centre, squares / (20.0 * volumes.sum()) - np.outer(centre, centre)


def _read(plain: Any) -> Hull | None:
    """Return the hull that was cached as plain data; None where the data is not a hull's."""
    if not isinstance(plain, dict):
        return None
    try:
        corners, centre, spread = (
            np.array(plain.get(name), dtype=float) for name in ("corners", "centre", "spread")
        )
        hull = Hull(corners, float(plain.get("volume", np.nan)), centre, spread)
    except (TypeError, ValueError, OverflowError):
        return None
    shaped = corners.ndim == 2 and corners.shape[1:] == centre.shape == (3,) and spread.shape == (3, 3)
    solid = corners.size > 0 and hull.volume > 0.0
    return hull if shaped and solid and all(np.isfinite(each).all() for each in hull) else None
