"""Meshes of a robot as triangles with normals and colours (files: ``armgpi.robot.mesh_files``).

What cannot be drawn raises :class:`MeshError` with the reason, and the scene goes on without it.
"""

from __future__ import annotations

import base64
import hashlib
import warnings
import zlib
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.base.cache import keep_result, read_result
from armgpi.robot.mesh_files import KINDS as KINDS
from armgpi.robot.mesh_files import MAX_BYTES, MeshError, checked, guarded, read_parts, toolbox, unit
from armgpi.robot.meshes import Found, MeshFinder
from armgpi.robot.robot import Robot

#: Largest mesh that is drawn.
MAX_TRIANGLES = 2_000_000
#: Part of the key of what is kept: another number wherever reading, shading or the form of it changes.
_VERSION = "triangles 1"
#: What each array of triangles is kept as: numbers in a row.
_KEPT_AS = ("<f8", "<f8", "<f8", "<i8")
#: So much is kept of a mesh at most [bytes, compressed]: as text it is what the cache takes (1 MiB).
_MOST_KEPT = 750_000
#: A mesh farther out than this [m] is no part of an arm.
_FARTHEST = 1e3
#: Faces that meet at a smaller angle than this are shaded as one surface [rad].
_CREASE = 0.6
#: In meshes of more triangles than this every corner is, as finding its surfaces would take long.
_FINE = 200_000
#: Numbers of corners or colours, (k,).
_Indices = npt.NDArray[np.intp]
#: Cubes in which corners are put together, along the largest side of a part: at first, and at the least.
_MOST_CUBES = 256.0
_LEAST_CUBES = 4.0


class Triangles(NamedTuple):
    """Triangles with normals and colours.

    Attributes:
        points: corners [m], shape (k, 3).
        normals: unit normals, shape (k, 3).
        colors: red, green, blue from 0 to 1, shape (k, 3); NaN where the file has none.
        faces: indices of corners, shape (m, 3).
    """

    points: Array
    normals: Array
    colors: Array
    faces: npt.NDArray[np.int64]


def resolve_mesh(robot: Robot, filename: str) -> Path | None:
    """Return the file that a URDF means by a mesh's name, None when it may not be read or is not there."""
    return _find_mesh(robot, filename).path


def _find_mesh(robot: Robot, filename: str) -> Found:
    """Return what a mesh's name leads to."""
    source = Path(str(robot.provenance["source"]))
    if not source.is_file():
        return Found(filename, None, reason="the robot's URDF is not there")
    return MeshFinder(source).find(filename)


def load(robot: Robot, filename: str) -> Triangles:
    """Return a mesh that a robot's URDF names.

    Raises:
        MeshError: when it is not there, outside the robot's package, or no mesh that can be drawn.
    """
    path, kind, changed = checked(_find_mesh(robot, filename), MAX_BYTES)
    try:
        return _parse(str(path), changed, filename, kind)
    except OSError as error:
        raise MeshError(filename, f"cannot be read: {error.strerror or error}") from None


@lru_cache(maxsize=64)
def _parse(path: str, _changed: int, filename: str, kind: str) -> Triangles:
    """Return the triangles of a file; the last ones read are remembered, as arms repeat their parts."""
    return _read_or_kept(files.read_bytes(path, MAX_BYTES), kind, filename)


def _read_or_kept(content: bytes, kind: str, filename: str) -> Triangles:
    """Return the triangles of a file's bytes.

    They depend on nothing else, and are kept on the disk: importing what reads and shades meshes (trimesh,
    scipy) takes three times as long as importing Pinocchio.

    Raises:
        MeshError: when they cannot be drawn.
    """
    head = f"{_VERSION} {kind}\n".encode()
    key = hashlib.sha256(head + content).hexdigest()[:32]
    triangles = _unpacked(read_result(key))
    if triangles is not None:
        return triangles
    triangles = _read(content, kind, filename)
    packed = zlib.compress(b"".join(_packed(triangles)), 1)
    if len(packed) <= _MOST_KEPT:
        plain = {
            "corners": len(triangles.points),
            "faces": len(triangles.faces),
            "numbers": base64.b64encode(packed).decode(),
        }
        keep_result(key, plain)
    return triangles


def _packed(part: Triangles) -> Iterator[bytes]:
    """Yield the arrays of triangles as bytes."""
    for array, kind in zip(part, _KEPT_AS, strict=True):
        yield np.ascontiguousarray(array, dtype=kind).tobytes()


def _unpacked(plain: Any) -> Triangles | None:
    """Return the triangles that were kept as plain data; None where that is none."""
    try:
        numbers = zlib.decompress(base64.b64decode(plain["numbers"]))
        corners, faces = plain["corners"], plain["faces"]
        rows = (corners, corners, corners, faces)
        whole = np.frombuffer(numbers, "<f8").reshape(sum(rows), 3)
    except (TypeError, KeyError, ValueError, zlib.error):
        return None
    ends = np.cumsum(rows)
    arrays = []
    for end, count, kind in zip(ends, rows, _KEPT_AS, strict=True):
        arrays.append(whole[end - count : end].view(kind))
    part = Triangles(*arrays)
    if not part.faces.size:
        return None
    is_inside = part.faces.min() >= 0 and part.faces.max() < len(part.points)
    return part if is_inside else None


def _read(content: bytes, kind: str, filename: str) -> Triangles:
    """Return the triangles of a file, read anew.

    Raises:
        MeshError: when it is none that can be drawn.
    """
    parts = guarded(_parts, content, kind, filename)
    if not parts:
        raise MeshError(filename, "has no triangles")
    whole = concatenate(parts)
    if len(whole.faces) > MAX_TRIANGLES:
        raise MeshError(filename, f"has {len(whole.faces)} triangles, more than {MAX_TRIANGLES}")
    if not (np.abs(whole.points) <= _FARTHEST).all():  # NaN as well
        raise MeshError(filename, f"has corners that are not finite or beyond {_FARTHEST:g} m")
    return whole


def _parts(content: bytes, kind: str) -> list[Triangles]:
    """Return the parts of a mesh file, in metres and in the file's own axes."""
    trimesh = toolbox()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        parts = []
        for mesh, transform in read_parts(content, kind):
            scale = unit(mesh.metadata)
            color = _color_of(mesh)
            bare = kind == "stl" or (kind == "obj" and b"\nvn " not in content)  # without normals
            if bare and len(mesh.faces) < _FINE:
                mesh = trimesh.graph.smooth_shade(mesh, angle=_CREASE, facet_minarea=None)
            points = trimesh.transform_points(mesh.vertices, transform) * scale
            to_file = np.linalg.inv(transform[:3, :3])
            normals = _unit_rows(np.asarray(mesh.vertex_normals) @ to_file)
            colors = np.broadcast_to(color, points.shape)
            parts.append(Triangles(points, normals, colors, np.asarray(mesh.faces)))
    return parts


def concatenate(parts: list[Triangles]) -> Triangles:
    """Return triangles together."""
    faces = []
    first = 0  # number of the part's first corner among all
    for part in parts:
        faces.append(part.faces + first)
        first += len(part.points)
    return Triangles(
        points=np.concatenate([part.points for part in parts]),
        normals=np.concatenate([part.normals for part in parts]),
        colors=np.concatenate([part.colors for part in parts]),
        faces=np.concatenate(faces),
    )


def move(part: Triangles, matrix: Array, scale: Array | float = 1.0) -> Triangles:
    """Return triangles scaled along their axes, then moved by a homogeneous matrix (4, 4)."""
    factors = np.broadcast_to(np.asarray(scale, dtype=float), (3,))
    rotation = matrix[:3, :3]
    points = (part.points * factors) @ rotation.T + matrix[:3, 3]
    safe = np.where(factors == 0.0, 1.0, factors)
    normals = _unit_rows((part.normals / safe) @ rotation.T)
    # A mirror image has its triangles the other way round.
    faces = part.faces[:, ::-1] if np.prod(safe) < 0.0 else part.faces
    return Triangles(points, normals, part.colors, faces)


def simplify(part: Triangles, most: int) -> Triangles:
    """Return about `most` triangles, by putting the corners within a small cube at one place.

    There may be more where the coarsest cubes do not suffice. Corners that face different ways stay separate
    corners at that place: edges are kept, and the surface does not tear. Surfaces of different colours are
    simplified each by itself. Triangles that face against their corners' normals are turned round, also where
    the mesh was small enough.
    """
    color = _color_numbers(part.colors)
    cubes_across = _MOST_CUBES
    while len(part.faces) > most and cubes_across > _LEAST_CUBES:
        part, first = _merge_corners(part, color, cubes_across)
        color = color[first]
        cubes_across *= 0.7
    # Seen from where their normals point: corners put together turn some round.
    a, b, c = (part.points[part.faces[:, i]] for i in range(3))
    outwards = part.normals[part.faces].sum(axis=1)
    normals = np.cross(b - a, c - a)
    is_inwards = (normals * outwards).sum(axis=1) < 0.0
    faces = np.where(is_inwards[:, None], part.faces[:, ::-1], part.faces)
    return part._replace(faces=faces)


def _merge_corners(part: Triangles, color: _Indices, cubes_across: float) -> tuple[Triangles, _Indices]:
    """Return triangles with one corner for each cube, colour and way to face; and which corners are left.

    Args:
        part: the triangles.
        color: number of each corner's colour, (k,).
        cubes_across: how many cubes the largest side of the part has.
    """
    low = part.points.min(axis=0)
    largest_side = float(np.ptp(part.points, axis=0).max())
    size = max(largest_side, 1e-9) / cubes_across
    x, y, z = np.floor((part.points - low) / size).astype(np.int64).T
    # One number for colour and cube, as there are less than 1024 cubes across.
    key = ((color * 1024 + x) * 1024 + y) * 1024 + z
    _, corner_of_cube, cube = np.unique(key, return_index=True, return_inverse=True)
    axis = np.abs(part.normals).argmax(axis=1)
    along_axis = np.take_along_axis(part.normals, axis[:, None], axis=1)[:, 0]
    facing = 2 * axis + (along_axis > 0.0)  # one of six
    _, first, group = np.unique(key * 8 + facing, return_index=True, return_inverse=True)
    normals = np.zeros((len(first), 3))
    np.add.at(normals, group, part.normals)
    a, b, c = cube[part.faces].T
    stays_a_triangle = (a != b) & (b != c) & (c != a)
    faces = _unique_faces(group[part.faces[stays_a_triangle]], len(first))
    points = part.points[corner_of_cube[cube[first]]]
    return Triangles(points, _unit_rows(normals), part.colors[first], faces), first


def _color_numbers(colors: Array) -> _Indices:
    """Return a number for each corner, the same for equal colours (k, 3); NaN is no colour."""
    known = np.nan_to_num(colors, nan=-1.0)
    if (known == known[:1]).all():  # one colour: rows need not be sorted
        return np.zeros(len(known), dtype=np.int64)
    _, numbers = np.unique(known, axis=0, return_inverse=True)
    return np.asarray(numbers.ravel())


def _unique_faces(faces: _Indices, corners: int) -> _Indices:
    """Return each triangle once, in order of its corners, (k, 3); there are so many corners."""
    if corners**3 > np.iinfo(np.int64).max:
        return np.unique(faces, axis=0)
    # As one number, which sorts in a fraction of the time of a row.
    key = np.unique((faces[:, 0] * corners + faces[:, 1]) * corners + faces[:, 2])
    return np.stack([key // corners**2, key // corners % corners, key % corners], axis=1)


def box(x: float, y: float, z: float) -> Triangles:
    """Return a box about the origin [m]."""
    creation = toolbox().creation
    return _primitive(creation.box(extents=(x, y, z)))


def cylinder(radius: float, length: float) -> Triangles:
    """Return a cylinder about the z axis [m]."""
    creation = toolbox().creation
    return _primitive(creation.cylinder(radius=radius, height=length, sections=32))


def sphere(radius: float) -> Triangles:
    """Return a sphere about the origin [m]."""
    creation = toolbox().creation
    return _primitive(creation.uv_sphere(radius=radius, count=[16, 24]))


def _primitive(mesh: Any) -> Triangles:
    """Return a shape with its edges kept sharp."""
    shaded = toolbox().graph.smooth_shade(mesh, angle=_CREASE, facet_minarea=None)
    points = np.asarray(shaded.vertices, dtype=float)
    return Triangles(
        points,
        _unit_rows(np.asarray(shaded.vertex_normals)),
        np.full_like(points, np.nan),
        np.asarray(shaded.faces),
    )


def _unit_rows(vectors: Array) -> Array:
    """Return vectors (k, 3) of length 1; those of no length become z."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    has_length = np.isfinite(length) & (length > 0.0)
    units = vectors / np.where(has_length, length, 1.0)
    return np.where(has_length, units, [0.0, 0.0, 1.0])


def _color_of(mesh: Any) -> Array:
    """Return the colour of a part, NaN when the file gives none."""
    visual = mesh.visual
    if getattr(visual, "kind", None) == "texture":
        color = getattr(visual.material, "main_color", None)
    elif getattr(visual, "defined", False):
        color = visual.main_color
    else:
        color = None
    if color is None:
        return np.full(3, np.nan)
    return np.asarray(color, dtype=float)[:3] / 255.0
