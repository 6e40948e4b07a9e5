"""Meshes of a robot, from files that nobody vouches for, as triangles.

A URDF names files, and a mesh file may name others. Only files inside the robot's own package are read, by
:mod:`armgpi.robot.meshes`; a mesh is read into memory and parsed there, without anything that it refers to:
textures are never opened. What cannot be used raises :class:`MeshError` with the reason, and the scene goes
on without it.
"""

from __future__ import annotations

import io
import re
import stat
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from armgpi import files, interrupts
from armgpi.arrays import Array
from armgpi.errors import ArmgpiError, MissingPackage, import_extra
from armgpi.robot.meshes import Found, MeshFinder
from armgpi.robot.robot import Robot

_Part = TypeVar("_Part")

#: Kinds of files that are read, by their endings.
KINDS = ("stl", "dae", "obj")
#: Largest file [B] and largest mesh that is read at all.
MAX_BYTES, MAX_TRIANGLES = 64 * 1024 * 1024, 2_000_000
#: A mesh farther out than this [m] is no part of an arm.
_FARTHEST = 1e3
#: How often a Collada file may draw its parts: files can hold parts within parts within parts.
_MAX_INSTANCES = 20_000
#: And how deep it may nest them.
_MAX_DEPTH = 60
#: Faces that meet at a smaller angle than this are shaded as one surface [rad]; in meshes of more triangles
#: than this every corner is, as finding its surfaces would take long.
_CREASE, _FINE = 0.6, 200_000


class MeshError(ArmgpiError):
    """A mesh that cannot be drawn.

    Attributes:
        filename: as the URDF names it.
    """

    def __init__(self, filename: str, message: str) -> None:
        """Describe what is wrong with the mesh `filename`."""
        self.filename = filename
        super().__init__(f"mesh {filename!r}: {message}")


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
    path, kind, changed = _checked(_find_mesh(robot, filename), MAX_BYTES)
    try:
        return _parse(str(path), changed, filename, kind)
    except OSError as error:
        raise MeshError(filename, f"cannot be read: {error.strerror or error}") from None


def corners(found: Found, most: int = MAX_BYTES) -> Array:
    """Return the corners of the triangles of a mesh [m], shape (k, 3), of a file of at most so many bytes.

    Raises:
        MeshError: when it is not there, larger, outside the robot's package, or no mesh.
        MissingPackage: when trimesh is not installed.
    """
    path, kind, _ = _checked(found, most)
    content = files.read_bytes(path, most)
    parts = _guarded(_corners, content, kind, found.name)
    if not parts:
        raise MeshError(found.name, "has no triangles")
    points: Array = np.concatenate(parts)
    if not (np.abs(points) <= _FARTHEST * _FARTHEST).all():  # millimetres are scaled later; NaN as well
        raise MeshError(found.name, "has corners that are not finite")
    return points


def _checked(found: Found, most: int) -> tuple[Path, str, int]:
    """Return path, kind and time of change [ns] of a file that may be read.

    Raises:
        MeshError: for another one.
    """
    if (path := found.path) is None:
        raise MeshError(found.name, found.reason)
    kind = path.suffix[1:].lower()
    if kind not in KINDS:
        raise MeshError(found.name, f"is no {', '.join(k.upper() for k in KINDS)} file")
    try:
        status = path.stat()
    except OSError as error:
        raise MeshError(found.name, f"cannot be read: {error.strerror or error}") from None
    if not stat.S_ISREG(status.st_mode) or status.st_size > most:
        raise MeshError(found.name, f"is no regular file of at most {most} bytes")
    return path, kind, status.st_mtime_ns


@lru_cache(maxsize=64)
def _parse(path: str, _changed: int, filename: str, kind: str) -> Triangles:
    """Return the triangles of a file; the last ones read are remembered, as arms repeat their parts."""
    parts = _guarded(_parts, files.read_bytes(path, MAX_BYTES), kind, filename)
    if not parts:
        raise MeshError(filename, "has no triangles")
    whole = concatenate(parts)
    if len(whole.faces) > MAX_TRIANGLES:
        raise MeshError(filename, f"has {len(whole.faces)} triangles, more than {MAX_TRIANGLES}")
    if not (np.abs(whole.points) <= _FARTHEST).all():  # NaN as well
        raise MeshError(filename, f"has corners that are not finite or beyond {_FARTHEST:g} m")
    return whole


def _guarded(read: Callable[[bytes, str], list[_Part]], content: bytes, kind: str, name: str) -> list[_Part]:
    """Return the parts that are read of a file's content.

    Raises:
        MeshError: when it is damaged.
    """
    if kind in _CHECKS:
        _CHECKS[kind](content, name)
    try:
        return read(content, kind)
    except MissingPackage:
        raise
    except ImportError as error:
        raise MeshError(name, f"needs the package {error.name}: pip install 'armgpi[viz]'") from None
    except MemoryError:
        raise MeshError(name, "does not fit into memory") from None
    except Exception as error:  # parsers of meshes fail in every way there is
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise MeshError(name, f"is damaged ({reason})") from None


def _meshes(content: bytes, kind: str) -> Iterator[tuple[Any, Array]]:
    """Yield the meshes of a file, and the transformation of each to the file's own axes."""
    trimesh = toolbox()
    # No resolver: whatever else the file names is not read.
    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=None)
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            yield mesh, transform


def _corners(content: bytes, kind: str) -> list[Array]:
    """Return the corners of the parts of a mesh file, in metres and in the file's own axes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [
            toolbox().transform_points(mesh.vertices, transform) * _unit(mesh.metadata)
            for mesh, transform in _meshes(content, kind)
        ]


def _parts(content: bytes, kind: str) -> list[Triangles]:
    """Return the parts of a mesh file, in metres and in the file's own axes."""
    trimesh = toolbox()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        parts = []
        for mesh, transform in _meshes(content, kind):
            scale = _unit(mesh.metadata)
            color = _color_of(mesh)
            bare = kind == "stl" or (kind == "obj" and b"\nvn " not in content)  # without normals
            if bare and len(mesh.faces) < _FINE:
                mesh = trimesh.graph.smooth_shade(mesh, angle=_CREASE, facet_minarea=None)
            points = trimesh.transform_points(mesh.vertices, transform) * scale
            normals = np.asarray(mesh.vertex_normals) @ np.linalg.inv(transform[:3, :3])
            colors = np.broadcast_to(color, points.shape)
            parts.append(Triangles(points, _unit_rows(normals), colors, np.asarray(mesh.faces)))
    return parts


def concatenate(parts: list[Triangles]) -> Triangles:
    """Return triangles together."""
    offsets = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    points, normals, colors, faces = zip(*parts, strict=True)
    shifted = [face + first for face, first in zip(faces, offsets, strict=True)]
    return Triangles(*map(np.concatenate, (points, normals, colors, shifted)))


def move(part: Triangles, matrix: Array, scale: Array | float = 1.0) -> Triangles:
    """Return triangles scaled along their axes, then moved by a homogeneous matrix (4, 4)."""
    factors = np.broadcast_to(np.asarray(scale, dtype=float), (3,))
    points = (part.points * factors) @ matrix[:3, :3].T + matrix[:3, 3]
    safe = np.where(factors == 0.0, 1.0, factors)
    normals = _unit_rows((part.normals / safe) @ matrix[:3, :3].T)
    # A mirror image has its triangles the other way round.
    faces = part.faces[:, ::-1] if np.prod(safe) < 0.0 else part.faces
    return Triangles(points, normals, part.colors, faces)


def simplify(part: Triangles, most: int) -> Triangles:
    """Return about `most` triangles at most, by putting the corners within a small cube at one place.

    Corners that face different ways stay apart, at that place: edges are kept, and the surface does not tear.
    Surfaces of different colours are simplified each by itself.
    """
    color = np.unique(np.nan_to_num(part.colors, nan=-1.0), axis=0, return_inverse=True)[1].ravel()
    cells = 256.0
    while len(part.faces) > most and cells > 4.0:
        low = part.points.min(axis=0)
        size = max(float(np.ptp(part.points, axis=0).max()), 1e-9) / cells
        place = np.floor((part.points - low) / size).astype(np.int64)
        key = ((color * 1024 + place[:, 0]) * 1024 + place[:, 1]) * 1024 + place[:, 2]
        _, corner, cube = np.unique(key, return_index=True, return_inverse=True)
        facing = np.abs(part.normals).argmax(axis=1)
        ahead = np.take_along_axis(part.normals, facing[:, None], axis=1)[:, 0] > 0.0
        _, first, group = np.unique(key * 8 + 2 * facing + ahead, return_index=True, return_inverse=True)
        normals = np.zeros((len(first), 3))
        np.add.at(normals, group, part.normals)
        cubes = cube[part.faces]
        whole = (cubes[:, 0] != cubes[:, 1]) & (cubes[:, 1] != cubes[:, 2]) & (cubes[:, 2] != cubes[:, 0])
        faces = np.unique(group[part.faces[whole]], axis=0)
        part = Triangles(part.points[corner[cube[first]]], _unit_rows(normals), part.colors[first], faces)
        color = color[first]
        cells *= 0.7
    # Seen from where their normals point: corners put together turn some round.
    a, b, c = (part.points[part.faces[:, i]] for i in range(3))
    inwards = (np.cross(b - a, c - a) * part.normals[part.faces].sum(axis=1)).sum(axis=1) < 0.0
    return part._replace(faces=np.where(inwards[:, None], part.faces[:, ::-1], part.faces))


def toolbox() -> Any:
    """Return trimesh, which reads and makes meshes.

    Raises:
        MissingPackage: when it is not installed.
    """
    # trimesh takes whatever is raised while it imports other packages for a package that is not there.
    with nullcontext() if "trimesh" in sys.modules else interrupts.hold():
        return import_extra("trimesh", "viz")


def box(x: float, y: float, z: float) -> Triangles:
    """Return a box about the origin [m]."""
    return _primitive(toolbox().creation.box(extents=(x, y, z)))


def cylinder(radius: float, length: float) -> Triangles:
    """Return a cylinder about the z axis [m]."""
    return _primitive(toolbox().creation.cylinder(radius=radius, height=length, sections=32))


def sphere(radius: float) -> Triangles:
    """Return a sphere about the origin [m]."""
    return _primitive(toolbox().creation.uv_sphere(radius=radius, count=[16, 24]))


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
    good = np.isfinite(length) & (length > 0.0)
    return np.where(good, vectors / np.where(good, length, 1.0), [0.0, 0.0, 1.0])


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


def _unit(metadata: dict[str, Any]) -> float:
    """Return the unit that a Collada file is in [m]."""
    text = str(metadata.get("units", ""))
    match = re.fullmatch(r"([-+.\deE]+) \* meters", text)
    scale = float(match[1]) if match else 1.0
    return scale if np.isfinite(scale) and scale > 0.0 else 1.0


def _check_stl(content: bytes, filename: str) -> None:
    """Refuse a binary STL file whose size is not what its count of triangles says."""
    if content[:5].lower() == b"solid" and b"facet" in content[:2000]:
        return  # the same as text
    if len(content) < 84:
        raise MeshError(filename, f"has {len(content)} bytes, which is no STL file")
    count, room = int.from_bytes(content[80:84], "little"), (len(content) - 84) // 50
    if count > room:
        raise MeshError(filename, f"declares {count} triangles, but contains {room}")
    triangles = np.frombuffer(content, np.dtype([("corners", "<f4", (4, 3)), ("more", "<u2")]), count, 84)
    if not np.isfinite(triangles["corners"][:, 1:]).all():
        raise MeshError(filename, "has corners that are not finite")


def _check_collada(content: bytes, filename: str) -> None:
    """Refuse Collada files that would grow when read: entities, and parts within parts many times over."""
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise MeshError(filename, "has a document type declaration (DTD), which a mesh does not need")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise MeshError(filename, f"is no well-formed XML: {error}") from None
    nodes = {e.get("id"): e for e in root.iter() if e.tag.endswith("}node") and e.get("id")}
    counted: dict[int, int] = {}
    scenes = [e for e in root.iter() if e.tag.endswith("}visual_scene")]
    if sum(_instances(scene, nodes, counted, filename) for scene in scenes) > _MAX_INSTANCES:
        raise MeshError(filename, f"draws its parts more than {_MAX_INSTANCES} times")


#: Kind of a file -> what refuses one that would do harm, before it is read.
_CHECKS = {"dae": _check_collada, "stl": _check_stl}


def _instances(
    node: ElementTree.Element,
    nodes: dict[str | None, ElementTree.Element],
    counted: dict[int, int],
    filename: str,
    depth: int = 0,
) -> int:
    """Return how many meshes a node of a Collada file draws, its parts' parts included.

    Args:
        node: the node.
        nodes: by their ids, for those that a node draws by reference.
        counted: what is known already; each node is counted once.
        filename: for the message.
        depth: how deep it is nested.
    """
    if depth > _MAX_DEPTH:
        raise MeshError(filename, f"has parts nested more than {_MAX_DEPTH} deep")
    if id(node) in counted:
        return counted[id(node)]
    total = 0
    for child in node:
        part: ElementTree.Element | None = None
        if child.tag.endswith("}node"):
            part = child
        elif child.tag.endswith("}instance_node"):
            part = nodes.get((child.get("url") or "").removeprefix("#"))
        elif child.tag.endswith("}instance_geometry"):
            total += 1
        if part is not None:
            total += _instances(part, nodes, counted, filename, depth + 1)
    counted[id(node)] = total
    return total
