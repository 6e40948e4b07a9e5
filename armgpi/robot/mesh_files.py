"""Files of meshes, which nobody vouches for, as triangles in memory.

Only files inside the package of a robot are read (:mod:`armgpi.robot.meshes`). A file is read into memory and
parsed there, without anything that it refers to: textures are never opened. What cannot be used raises
:class:`MeshError` with the reason.
"""

from __future__ import annotations

import io
import re
import stat
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree

import numpy as np

from armgpi.base import interrupts
from armgpi.base.arrays import Array
from armgpi.errors import ArmgpiError, MissingPackage, import_extra
from armgpi.robot.meshes import Found

_Part = TypeVar("_Part")

#: Kinds of files that are read, by their endings.
KINDS = ("stl", "dae", "obj")
#: Largest file [B].
MAX_BYTES = 64 * 1024 * 1024
#: A corner farther out than this, in metres or millimetres, is damaged.
_FARTHEST = 1e6
#: How often a Collada file may draw its parts: files can hold parts within parts within parts.
_MAX_INSTANCES = 20_000
#: And how deep it may nest them.
_MAX_DEPTH = 60


class MeshError(ArmgpiError):
    """A mesh that cannot be drawn.

    Attributes:
        filename: as the URDF names it.
    """

    def __init__(self, filename: str, message: str) -> None:
        """Describe what is wrong with the mesh `filename`."""
        self.filename = filename
        super().__init__(f"mesh {filename!r}: {message}")


def corners(content: bytes, kind: str, name: str) -> Array:
    """Return the corners of the triangles of a mesh [m], shape (k, 3), by the content of its file.

    Args:
        content: of the file.
        kind: one of `KINDS`.
        name: of the file, for messages.

    Raises:
        MeshError: when it is no mesh.
        MissingPackage: when trimesh is not installed.
    """
    parts = guarded(_corners, content, kind, name)
    if not parts:
        raise MeshError(name, "has no triangles")
    points: Array = np.concatenate(parts)
    if not (np.abs(points) <= _FARTHEST).all():  # NaN as well
        raise MeshError(name, "has corners that are not finite")
    return points


def checked(found: Found, most: int) -> tuple[Path, str, int]:
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


def guarded(read: Callable[[bytes, str], list[_Part]], content: bytes, kind: str, name: str) -> list[_Part]:
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
        raise MeshError(name, f"needs the package {error.name!r}: pip install trimesh pycollada") from None
    except MemoryError:
        raise MeshError(name, "does not fit into memory") from None
    except Exception as error:  # parsers of meshes fail in every way there is
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise MeshError(name, f"is damaged ({reason})") from None


def read_parts(content: bytes, kind: str) -> Iterator[tuple[Any, Array]]:
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
            toolbox().transform_points(mesh.vertices, transform) * unit(mesh.metadata)
            for mesh, transform in read_parts(content, kind)
        ]


def toolbox() -> Any:
    """Return trimesh, which reads and makes meshes.

    Raises:
        MissingPackage: when it is not installed.
    """
    # trimesh takes whatever is raised while it imports other packages for a package that is not there.
    with nullcontext() if "trimesh" in sys.modules else interrupts.hold():
        return import_extra("trimesh", "viz")


def unit(metadata: dict[str, Any]) -> float:
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
