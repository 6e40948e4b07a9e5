"""Where an arm touches itself: its collision shapes at given configurations, by Pinocchio and coal."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import UrdfError
from armgpi.robot import markup, urdf
from armgpi.robot.meshes import MeshFinder
from armgpi.robot.robot import Robot

#: Arm -> what was read for it, by the folders of its meshes: reading them takes long.
_read: WeakKeyDictionary[Robot, dict[tuple[str, ...], Shapes]] = WeakKeyDictionary()


class Shapes(NamedTuple):
    """The collision shapes of an arm.

    Attributes:
        model: Pinocchio's geometry model, with the pairs of links to look at; None where nothing was read.
        missing: links of which a collision shape is none, or its mesh was not found or cannot be read.
    """

    model: Any
    missing: tuple[str, ...]


class ShapeFiles(NamedTuple):
    """What the collision shapes of an arm are read from.

    Attributes:
        digest: of the collision elements and of how links hang together; empty without a file.
        meshes: path, size [bytes] and time of the last change [ns] of each mesh that is found; -1 for
            one that is not there.
    """

    digest: str
    meshes: tuple[tuple[str, int, int], ...]


class Contact(NamedTuple):
    """Two links that touch.

    Attributes:
        first, second: their names.
        configuration: the first one in which they do.
    """

    first: str
    second: str
    configuration: int


def self_collisions(
    robot: Robot, positions: Array, package_dirs: Iterable[str | PathLike[str]] = ()
) -> list[Contact] | None:
    """Return which links touch each other in configurations (k, n) [rad or m]; None without readable shapes.

    Links next to each other, and those that touch in the first already, are not looked at. Nothing is
    said of what is between them, of obstacles, nor of shapes whose mesh is not found.
    """
    shapes = read_shapes(robot, package_dirs).model
    if shapes is None or not shapes.ngeoms:
        return None
    import pinocchio as pin

    model = robot.pinocchio_model()
    data, results = model.createData(), shapes.createData()
    found: dict[tuple[str, str], int] = {}
    rows = np.atleast_2d(np.asarray(positions, dtype=float))
    if robot.coupling is not None:  # with joints that follow others the model has their coordinates, too
        rows = rows @ robot.coupling.ratio.T + robot.coupling.offset
    for index, q in enumerate(rows):
        pin.computeCollisions(model, data, shapes, results, q, False)
        for pair, result in zip(shapes.collisionPairs, results.collisionResults, strict=True):
            if result.isCollision():
                first, second = (shapes.geometryObjects[i].parentFrame for i in (pair.first, pair.second))
                found.setdefault((model.frames[first].name, model.frames[second].name), index)
    return [Contact(*links, index) for links, index in found.items() if index]


def read_shapes(robot: Robot, package_dirs: Iterable[str | PathLike[str]] = ()) -> Shapes:
    """Return the collision shapes of an arm's file that may be read, with the pairs to look at.

    Links that a joint connects are no pair. Every call returns shapes of its own.
    """
    folders = tuple(str(folder) for folder in package_dirs)
    kept = _read.setdefault(robot, {})
    if folders not in kept:
        kept[folders] = _read_shapes(robot, folders)
    shapes = kept[folders]
    if shapes.model is None:
        return shapes
    import pinocchio as pin

    return shapes._replace(model=pin.GeometryModel(shapes.model))


def shape_files(robot: Robot) -> ShapeFiles:
    """Return what the collision shapes of an arm are read from."""
    read = _read_elements(robot)
    if read is None:
        return ShapeFiles("", ())
    source, root = read
    finder = MeshFinder(source)
    names = {mesh.get("filename", "") for mesh in root.iterfind("link/collision/geometry/mesh")}
    meshes = []
    for name in sorted(names):
        path = finder.find(name).path
        if path is not None:
            state = path.stat() if path.is_file() else None
            size, changed = (-1, -1) if state is None else (state.st_size, state.st_mtime_ns)
            meshes.append((str(path), size, changed))
    return ShapeFiles(hashlib.sha256(tostring(root)).hexdigest(), tuple(meshes))


def _read_elements(robot: Robot) -> tuple[Path, Element] | None:
    """Return an arm's file and a URDF of its collision elements alone; None for an arm without a URDF.

    Where links are comes from the arm itself. Of the file only the tree of links is of use, so joints are
    fixed: urdfdom refuses some of what is read here, as an effort of "inf", and prints it.
    """
    source = Path(str(robot.provenance.get("source", "")))
    if source.suffix.lower() != ".urdf" or not source.is_file():
        return None
    try:
        root = markup.parse_xml(markup.read_file(source), str(source))
    except UrdfError:  # an MJCF of that name, or a file that was overwritten since the arm was loaded
        return None
    plain = Element("robot", {"name": root.get("name", "robot")})
    for link in root.findall("link"):
        SubElement(plain, "link", {"name": link.get("name", "")}).extend(link.findall("collision"))
    for joint in root.findall("joint"):
        kept = SubElement(plain, "joint", {"name": joint.get("name", ""), "type": "fixed"})
        for end in ("parent", "child"):
            kept.extend(joint.findall(end))
    return source, plain


def _read_shapes(robot: Robot, package_dirs: tuple[str, ...]) -> Shapes:
    """Return the collision shapes of an arm's file; see :func:`read_shapes`."""
    read = _read_elements(robot)
    if read is None:
        return Shapes(None, ())
    import pinocchio as pin

    source, root = read
    finder = MeshFinder(source, package_dirs)
    # Before the shapes that cannot be had are taken out.
    with_shapes = [
        link.get("name", "") for link in root.findall("link") if link.find("collision") is not None
    ]
    missing: dict[str, None] = {}
    for link in root.findall("link"):
        for shape in link.findall("collision"):
            if any(urdf.shape_problems(shape)):  # urdfdom would print them, and read the rest by half
                link.remove(shape)
                missing[link.get("name", "")] = None
                continue
            if (mesh := shape.find("geometry/mesh")) is None:
                continue
            if (path := finder.find(mesh.get("filename", "")).path) is None:
                link.remove(shape)
                missing[link.get("name", "")] = None
            else:
                mesh.set("filename", str(path))
    model = robot.pinocchio_model()
    text = tostring(root, encoding="unicode")
    try:
        shapes = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    except (RuntimeError, ValueError):  # a mesh that cannot be read
        return Shapes(None, tuple(with_shapes))
    joints = [int(shape.parentJoint) for shape in shapes.geometryObjects]
    # Added one by one: what a list of pairs holds is not theirs any more when one of them is removed.
    for i, j in itertools.combinations(range(len(joints)), 2):
        first, second = min(joints[i], joints[j]), max(joints[i], joints[j])
        if first != second and model.parents[second] != first:  # a joint comes after what carries it
            shapes.addCollisionPair(pin.CollisionPair(i, j))
    return Shapes(shapes, tuple(missing))
