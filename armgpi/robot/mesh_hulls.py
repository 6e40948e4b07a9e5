"""Convex hulls of mesh files, worked out once for each file and kept on the disk.

Reading a mesh needs packages whose import alone takes longer than all other checks of a robot together
(trimesh, scipy.spatial). A hull depends on nothing but the bytes of its file, so the second command that asks
for it neither parses the mesh nor imports these packages.
"""

from __future__ import annotations

import hashlib
from typing import Any, NamedTuple

import numpy as np

from armgpi import files
from armgpi.arrays import Array
from armgpi.cache import keep_result, read_result
from armgpi.robot import mesh_files
from armgpi.robot.meshes import Found

#: Part of the key of what is kept: another number wherever reading or the form of a result changes.
_VERSION = "mesh hull 1"
#: So many corners are kept at most: as JSON they stay far below what the cache takes (1 MiB).
_MOST_KEPT = 10_000


class Hull(NamedTuple):
    """The convex hull of a mesh, in its file's own frame.

    Attributes:
        corners: of the hull [m, by the file's own unit], shape (m, 3).
        volume: of the hull [m^3].
    """

    corners: Array
    volume: float


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
        keep_result(key, {"corners": hull.corners.tolist(), "volume": hull.volume})
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
    return Hull(hull.points[hull.vertices], float(hull.volume))


def _read(plain: Any) -> Hull | None:
    """Return the hull that was kept as plain data; None where that is none."""
    if not isinstance(plain, dict):
        return None
    try:
        corners = np.array(plain.get("corners"), dtype=float)
        volume = float(plain.get("volume", np.nan))
    except (TypeError, ValueError):
        return None
    is_hull = corners.ndim == 2 and corners.shape[1:] == (3,) and bool(np.isfinite(corners).all())
    return Hull(corners, volume) if is_hull and np.isfinite(volume) else None
