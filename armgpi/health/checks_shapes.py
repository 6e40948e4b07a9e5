"""Checks of mass properties against the link's own shapes: boxes, cylinders, spheres, meshes.

A mesh counts as its convex hull. Where one is not found or not read (trimesh is not installed, the files are
large), the link gets no verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from statistics import median
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.errors import MissingPackage, Remedy
from armgpi.health.findings import Finding, Subject, check
from armgpi.robot import mesh_files, tensors
from armgpi.robot.mesh_hulls import hull_of
from armgpi.robot.repairs import ABOUT_CENTRE, PRODUCTS, UNITS, UnitRepair
from armgpi.robot.tree import Link

#: Shapes whose diagonal is shorter are placeholders [m].
_PLACEHOLDER = 0.02
#: A link lighter than this share of what moves gets no verdict, nor an arm with fewer different shapes.
_NEGLIGIBLE = 1e-4
_DIFFERENT = 2
#: Shapes longer than the last, or than so many times the arm's median link and the one between [m], are not
#: written in metres: most are meshes in millimetres without a scale.
_LONG_BESIDE, _LONG_SHAPE, _LONGEST_SHAPE = 50.0, 3.0, 20.0
#: How far beyond its shapes a centre of mass may be, as a share of their diagonal.
_BESIDE = 0.1
#: Where the centres of mass of more than this share of the links are, their shapes may be stand-ins.
_STAND_INS = 0.5
#: Radius of gyration below this share of a thin rod's of the same length is too small.
_ROD_SHARE = 0.5
#: Densities of what robots are made of, over the volume of the shapes [kg/m^3].
_LIGHTEST, _HEAVIEST = 20.0, 20_000.0
#: A link's density may be so many times that of the arm's median link, or that part of it.
_FROM_MEDIAN = 40.0
#: Kinds of repairs of units, the likeliest first.
_UNITS = ("grams", "inertia-mm", "centre-mm", "inertia-g-mm", "inertia-g")
#: The trace of an inertia fits shapes between this part and this multiple of a solid box's; a centre of mass
#: as far outside as this share of their diagonal.
_WITHIN, _FAR = 25.0, 0.5
#: The same, and densities [kg/m^3], where another unit is said to be the slip.
_SURE, _USUAL = 5.0, (100.0, 12_000.0)
#: A centre of mass in millimetres is so many times the size of the shapes away; one of another frame is not.
_MILLIMETRES = 5.0
#: An inertia that says nothing: an exporter's placeholder.
_ONES = (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)
#: An inertia may be about the joint where a centre of mass is so far away that it adds this share of a
#: solid's, if the rest is nearer to a solid's by this (of logarithms), in at least so many links.
_AWAY, _NEARER, _ENOUGH = 1.0, 0.5, 2
#: Shapes whose sizes and volumes differ by less than this share are alike, as wrists of one arm often (UR10e:
#: 16 and 14 %; a Kinova's fingers and their tips, which share one inertial: 18 and 82 %).
_ALIKE = 0.3
#: A product of inertia shows its sign where it is so large a part of its moments, in the shapes and the file.
_PRODUCT, _WRITTEN = 0.1, 0.05
#: So many of them are needed, this share with the other sign, and this correlation of all products.
_PRODUCTS, _OPPOSITE, _CORRELATION = 5, 0.8, -0.5
#: Meshes are read as long as their files are together no larger [bytes].
_MOST_MESHES = 32 * 2**20


class _Extent(NamedTuple):
    """What the shapes of a link fill, in its frame.

    Attributes:
        corners: of their boxes [m], shape (m, 3).
        volume: their sum [m^3].
        centre: of their volume [m], shape (3,).
        spread: mean of (x - centre) (x - centre)' over their volume [m^2], shape (3, 3).
    """

    corners: Array
    volume: float
    centre: Array
    spread: Array


@check(
    "shape-mass",
    "centre of mass, radius of gyration, density or signs of products of inertia contradict the link's own "
    "shapes (boxes, cylinders, spheres, hulls of meshes), as a wrong unit, an inertia about the joint, a "
    "copied inertial or a mesh in millimetres does",
    "warning",
)
def against_shapes(subject: Subject) -> Iterator[Finding]:
    """Find mass properties that the shapes of their link contradict."""
    bodies = _bodies(subject)
    if len({each.extent.corners.tobytes() for each in bodies}) < _DIFFERENT:
        return  # one shape for every link is a placeholder
    longest = _longest_shape(bodies)
    yield from (_too_long(body, longest) for body in bodies if body.length > longest)
    bodies = [body for body in bodies if body.length <= longest]
    if not bodies:
        return
    alike: set[str] = set()
    for finding, names in _copied(bodies):
        yield finding
        alike.update(names)
    outside = {body.link.name for body in bodies if any(_centre(body.link, body.extent))}
    slips = _common_slips(bodies, alike, outside)
    for kinds, names in slips.items():
        yield from _slips(kinds, names, len(bodies))
    yield from _turned_products(bodies)
    named = {name for names in slips.values() for name in names}
    others = [body for body in bodies if body.link.name not in named]
    beside = [body.link.name for body in others if body.link.name in outside]
    stand_ins = len(beside) > max(_STAND_INS * len(bodies), _DIFFERENT)
    if stand_ins:
        yield _doubt(beside, len(bodies))
    usual = median(each.density for each in bodies)
    for link, extent, density in others:
        if not stand_ins:
            yield from _centre(link, extent)
        yield from _gyration(link, extent)
        if not stand_ins:
            yield from _density(link, density, usual)


def _longest_shape(bodies: list[_Body]) -> float:
    """Return the length up to which shapes may be in metres [m]: beyond, a link is longer than all others."""
    usual = median(body.length for body in bodies)
    return float(np.clip(_LONG_BESIDE * usual, _LONG_SHAPE, _LONGEST_SHAPE))


def _too_long(body: _Body, longest: float) -> Finding:
    """Return the finding of a shape whose unit is not the metre."""
    message = f"its shapes are {body.length:.3g} m long"
    repair = (
        'a mesh in millimetres needs scale="0.001 0.001 0.001", a size in millimetres to be written in metres'
    )
    where = f"link {body.link.name!r}"
    return Finding("warning", where, message, body.length, longest, repair)


def _doubt(beside: list[str], count: int) -> Finding:
    """Return the finding that masses and shapes contradict each other, and that nothing tells which is wrong.

    Jaco's model with discs for collisions is such an arm, and right.
    """
    message = (
        f"{len(beside)} of {count} links have their centre of mass outside their own shapes: the shapes are "
        "stand-ins, or the centres are in another frame, as the base's; densities were not compared"
    )
    repair = f"compare one link, such as {beside[0]!r}, with the maker's data"
    return Finding("warning", "robot", message, len(beside), 0.0, repair)


class _Body(NamedTuple):
    """A link that moves, with its shapes.

    Attributes:
        link: as it is built.
        extent: what its shapes fill.
        density: its mass over their volume [kg/m^3].
    """

    link: Link
    extent: _Extent
    density: float

    @property
    def length(self) -> float:
        """Largest extent of its shapes along an axis of its frame [m]."""
        return float(np.ptp(self.extent.corners, axis=0).max())

    @property
    def solid(self) -> float:
        """Trace of the inertia about its centre that a solid box of its extent has [kg m^2]."""
        return self.link.mass * float(np.sum(np.ptp(self.extent.corners, axis=0) ** 2)) / 6.0


def _bodies(subject: Subject) -> list[_Body]:
    """Return the links that move, have a mass that the arm feels, and shapes that are read."""
    total = sum(subject.document.links[name].mass for name in subject.moved)
    shapes = _Shapes(subject)
    bodies = []
    for element in subject.document.root.findall("link"):
        link = subject.document.links[element.get("name", "")]
        # Masses that the arm does not feel are often made up.
        if link.name not in subject.moved or link.mass <= max(_NEGLIGIBLE * total, 0.0):
            continue
        if (extent := shapes.extent(element)) is not None:
            bodies.append(_Body(link, extent, link.mass / extent.volume))
    return bodies


def _copied(bodies: list[_Body]) -> Iterator[tuple[Finding, list[str]]]:
    """Find one mass and inertia in links of different shapes; yield a finding, and the links."""
    groups: dict[tuple[object, ...], list[_Body]] = {}
    for body in bodies:
        link = body.link
        groups.setdefault((link.mass, link.inertia), []).append(body)
    for group in groups.values():
        sizes = [np.sort(np.ptp(body.extent.corners, axis=0)) for body in group]
        volumes = [body.extent.volume for body in group]
        different = any(not np.allclose(size, sizes[0], rtol=_ALIKE) for size in sizes)
        different |= max(volumes) > (1.0 + _ALIKE) * min(volumes)
        if len(group) > 1 and different:
            names = ", ".join(repr(body.link.name) for body in group[1:])
            message = f"has the same mass and inertia as {names}, whose shapes are others"
            repair = "was it copied, or is it a placeholder of an exporter? Give each link its own"
            finding = Finding("warning", f"link {group[0].link.name!r}", message, repair=repair)
            yield finding, [body.link.name for body in group]


def _unit_slip(body: _Body) -> tuple[str, str] | None:
    """Return the repairs of units with which a link's mass properties fit its shapes, and its name.

    None where they fit as they are, or with no other unit. Tried are one unit alone, masses in g with another
    one, centres of mass in mm with one of inertias, and of three at once those of CAD: g, mm and g mm^2.
    """
    if body.link.inertia == _ONES or _fits(body, UnitRepair("")):
        return None
    options: list[tuple[str, ...]] = [(kind,) for kind in _UNITS]
    options += [("grams", kind) for kind in _UNITS if kind != "grams"]
    options += [("centre-mm", kind) for kind in _UNITS if "inertia" in kind]
    options.append(("grams", "centre-mm", "inertia-g-mm"))
    for kinds in options:
        mass = inertia = centre = 1.0
        for kind in kinds:
            unit = UNITS[kind]
            mass, inertia, centre = mass * unit.mass, inertia * unit.inertia, centre * unit.centre
        size = float(np.linalg.norm(np.ptp(body.extent.corners, axis=0)))
        away = float(np.linalg.norm(body.link.xyz))
        if centre < 1.0 and away < _MILLIMETRES * size:  # in metres it is not far from the shapes
            continue
        if _fits(body, UnitRepair("", mass, inertia, centre), sure=True):
            return ",".join(kinds), body.link.name
    return None


def _fits(body: _Body, unit: UnitRepair, sure: bool = False) -> bool:
    """Tell whether mass properties in some unit are those of a body of such shapes: widely, or usually."""
    lightest, heaviest = _USUAL if sure else (_LIGHTEST, _HEAVIEST)
    within, far = (_SURE, 0.0) if sure else (_WITHIN, _FAR)
    density = unit.mass * body.density
    trace = unit.inertia * float(np.sum(body.link.moments())) / unit.mass
    low, high = body.extent.corners.min(axis=0), body.extent.corners.max(axis=0)
    middle = unit.centre * np.array(body.link.xyz) - 0.5 * (low + high)
    return bool(
        lightest <= density <= heaviest
        and 1.0 / within <= trace / body.solid <= within
        and float(np.max(np.abs(middle) - 0.5 * (high - low))) <= far * float(np.linalg.norm(high - low))
    )


def _about_joint(bodies: list[_Body]) -> Iterator[tuple[str, str]]:
    """Yield the links whose inertia is about their origin, where that explains all whose centre is away."""
    about = []
    for body in bodies:
        link, given = body.link, float(np.sum(body.link.moments()))
        added = tensors.carried(link.mass, link.xyz, pin.rpy.rpyToMatrix(np.array(link.rpy)))
        if np.trace(added) < _AWAY * body.solid:
            continue
        left = tensors.as_matrix(link.inertia) - added
        if not tensors.is_rigid(tensors.as_values(left)):
            return
        # Nearer to a solid's, by its logarithm.
        if abs(math.log(np.trace(left) / body.solid)) > abs(math.log(given / body.solid)) - _NEARER:
            return
        about.append(link.name)
    if len(about) >= _ENOUGH:
        yield from ((ABOUT_CENTRE, name) for name in about)


def _turned_products(bodies: list[_Body]) -> Iterator[Finding]:
    """Find products of inertia that have the sign opposite to those of the links' shapes, all over the arm.

    CAD programs give sums of x y where URDF has their negative. One link shows little, as its inside differs
    from its hull; where nearly all links say the same, it is the file.
    """
    written = np.array([_correlations(_spread_of(body.link)) for body in bodies])
    shaped = np.array([_correlations(_as_written(body)) for body in bodies])
    shown = (np.abs(shaped) > _PRODUCT) & (np.abs(written) > _WRITTEN)
    opposite = shown & (written * shaped < 0.0)
    if shown.sum() < _PRODUCTS or opposite.sum() < _OPPOSITE * shown.sum():
        return
    correlation = float((written * shaped).sum() / np.sqrt((written**2).sum() * (shaped**2).sum()))
    if correlation > _CORRELATION:
        return
    whole = bool(opposite.sum() == shown.sum())
    message = f"{opposite.sum()} of {shown.sum()} products of inertia have the sign opposite to the shapes'"
    repair = "ixy is minus the sum of x y in URDF, and often without the minus in CAD: correct the file"
    for body, of_body, turned in zip(bodies, shown, opposite, strict=True):
        if turned.any() and (turned == of_body).all():
            name = body.link.name
            remedies = (Remedy("repair", (), PRODUCTS if whole else f"{PRODUCTS}:{name}"),)
            yield Finding("warning", f"link {name!r}", message, correlation, 0.0, repair, remedies)


def _spread_of(link: Link) -> Array:
    """Return the mean of (x - centre) (x - centre)' over a link's mass [m^2], in its inertial frame."""
    inertia = tensors.as_matrix(link.inertia)
    return np.asarray((0.5 * np.trace(inertia) * np.eye(3) - inertia) / link.mass)


def _as_written(body: _Body) -> Array:
    """Return the spread of a body's shapes in its inertial frame."""
    rotation = pin.rpy.rpyToMatrix(np.array(body.link.rpy))
    return np.asarray(rotation.T @ body.extent.spread @ rotation)


def _correlations(spread: Array) -> Array:
    """Return the products of a spread, each divided by the root of its two squares, (3,)."""
    squares = np.sqrt(np.abs(np.diagonal(spread)))
    scale = np.maximum(np.outer(squares, squares), np.finfo(float).tiny)
    return np.asarray((spread / scale)[np.triu_indices(3, 1)])


def _common_slips(bodies: list[_Body], alike: set[str], outside: set[str]) -> dict[str, list[str]]:
    """Return the links by the repairs that explain them, but for those whose inertials are alike.

    Where most centres of mass are outside, and not by millimetres, one that fits does so by chance: those of
    Doosan's arms are all in the base's frame.
    """
    slips: dict[str, list[str]] = {}
    for slip in (*(_unit_slip(each) for each in bodies), *_about_joint(bodies)):
        if slip is not None and slip[1] not in alike:
            slips.setdefault(slip[0], []).append(slip[1])
    for kinds in [kinds for kinds in slips if "centre-mm" in kinds.split(",")]:
        if len(outside - set(slips[kinds])) > _STAND_INS * len(bodies):
            del slips[kinds]
    return slips


def _slips(kinds: str, names: list[str], count: int) -> Iterator[Finding]:
    """Yield the findings of one slip in some links of those that have shapes."""
    *first, last = (UNITS[kind].meaning for kind in kinds.split(","))
    meanings = f"{', '.join(first)} and {last}" if first else last
    for name in names:
        message = f"its mass properties contradict its own shapes, and fit them if {meanings}"
        whole = [kind if len(names) == count else f"{kind}:{name}" for kind in kinds.split(",")]
        remedies = (Remedy("repair", (), ",".join(whole)),)
        yield Finding("warning", f"link {name!r}", message, None, None, "correct the file", remedies)


def _centre(link: Link, extent: _Extent) -> Iterator[Finding]:
    """Find a centre of mass outside the shapes."""
    low, high = extent.corners.min(axis=0), extent.corners.max(axis=0)
    centre = np.array(link.xyz)
    outside = float(np.max([low - centre, centre - high]))
    if outside > _BESIDE * float(np.linalg.norm(high - low)):
        message = f"its centre of mass is {outside:.3g} m outside its own shapes"
        repair = "check sign, frame and unit of the inertial's origin, or whose inertial it is"
        yield Finding("warning", f"link {link.name!r}", message, outside, 0.0, repair)


def _gyration(link: Link, extent: _Extent) -> Iterator[Finding]:
    """Find an inertia that is too large or too small for the mass and the shapes."""
    gyration = math.sqrt(max(float(link.moments()[2]), 0.0) / link.mass)
    farthest = float(np.linalg.norm(extent.corners - np.array(link.xyz), axis=1).max())
    longest = float(np.ptp(extent.corners, axis=0).max())
    rod = longest / math.sqrt(12.0)
    where = f"link {link.name!r}"
    if gyration > farthest:
        message = f"its radius of gyration is {gyration:.3g} m; its shapes end {farthest:.3g} m away"
        repair = "check unit and reference point (the centre of mass) of the inertia, and the mass"
        yield Finding("warning", where, message, gyration, farthest, repair)
    elif 0.0 < gyration < _ROD_SHARE * rod:
        message = f"its radius of gyration is {gyration:.3g} m; a thin rod of its length has {rod:.3g}"
        repair = (
            "check whether its mass is too large or its inertia too small (parts summed about their own "
            "centres, perhaps); a compact weight in a long shape is right"
        )
        yield Finding("warning", where, message, gyration, rod, repair)


def _density(link: Link, density: float, usual: float) -> Iterator[Finding]:
    """Find a density that no part of a robot has, or far from that of the arm's other links."""
    where = f"link {link.name!r}"
    if not _LIGHTEST <= density <= _HEAVIEST:
        message = f"its mass over the volume of its shapes is {density:.3g} kg/m^3"
        repair = "check the unit (kg, not g), and the density that CAD took"
        bound = _LIGHTEST if density < _LIGHTEST else _HEAVIEST
        yield Finding("warning", where, message, density, bound, repair)
    elif not usual / _FROM_MEDIAN <= density <= usual * _FROM_MEDIAN:
        message = f"its mass over its shapes' volume is {density:.3g} kg/m^3; the median link has {usual:.3g}"
        yield Finding("warning", where, message, density, usual, "check its mass")


class _Shapes:
    """Reads the shapes of links, and each mesh once."""

    def __init__(self, subject: Subject) -> None:
        """Read those of a robot."""
        self._finder = subject.finder
        self._hulls: dict[str, _Extent | None] = {}
        self._left = _MOST_MESHES

    def extent(self, element: Element) -> _Extent | None:
        """Return what the shapes of a link fill; None where they are placeholders, or not all are read.

        Primitive shapes beside a mesh are often a part of the link (feet, stops): then all count together.
        """
        tags = ("collision", "visual")
        kinds = {tag: {shape.find("geometry/mesh") is None for shape in element.findall(tag)} for tag in tags}
        together = len(kinds["collision"] | kinds["visual"]) > 1
        sets = [element.findall(tag) for tag in tags]
        for shapes in [sets[0] + sets[1]] if together else sets:
            parts = [part for shape in shapes if (part := self._part(shape)) is not None]
            if not shapes or len(parts) < len(shapes):
                continue
            corners = np.vstack([part.corners for part in parts])
            if float(np.linalg.norm(np.ptp(corners, axis=0))) < _PLACEHOLDER:
                return None
            return _together(corners, parts)
        return None

    def _part(self, shape: Element) -> _Extent | None:
        """Return what one shape fills, in the link's frame; None for what is not read."""
        mesh = shape.find("geometry/mesh")
        if mesh is None:
            return _part(shape)
        name = mesh.get("filename", "")
        if name not in self._hulls:
            self._hulls[name] = self._hull(name)
        hull = self._hulls[name]
        try:
            scale = _floats(mesh.get("scale", "1 1 1"), 3)
            rotation, xyz = _pose(shape)
        except ValueError:
            return None
        if hull is None or not np.all(scale):
            return None
        axes = rotation * scale
        return _Extent(
            xyz + hull.corners @ axes.T,
            hull.volume * abs(float(np.prod(scale))),
            xyz + axes @ hull.centre,
            axes @ hull.spread @ axes.T,
        )

    def _hull(self, name: str) -> _Extent | None:
        """Return the convex hull of a mesh, in its file's own frame and units."""
        try:
            found = self._finder.find(name)
            hull = hull_of(found, self._left)
        except (mesh_files.MeshError, MissingPackage, OSError, ValueError):
            return None
        self._left -= found.path.stat().st_size if found.path else 0
        return _Extent(*hull)


def _part(shape: Element) -> _Extent | None:
    """Return what one shape fills; None for a mesh, or numbers that are not read."""
    geometry = shape.find("geometry")
    solid = None if geometry is None else next(iter(geometry), None)
    if solid is None:
        return None
    try:
        sizes = _sizes(solid)
        rotation, xyz = _pose(shape)
    except ValueError:
        return None
    if sizes is None or not np.all(sizes.half > 0.0) or not sizes.volume > 0.0:
        return None
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    corners = xyz + (signs * sizes.half) @ rotation.T
    return _Extent(corners, sizes.volume, xyz, rotation @ np.diag(sizes.squares) @ rotation.T)


def _together(corners: Array, parts: list[_Extent]) -> _Extent:
    """Return what several parts fill."""
    shares = np.array([part.volume for part in parts])
    volume = float(shares.sum())
    shares /= volume
    centres = np.array([part.centre for part in parts])
    centre = shares @ centres
    spread = np.zeros((3, 3))
    for share, part in zip(shares, parts, strict=True):
        away = part.centre - centre
        spread += share * (part.spread + np.outer(away, away))
    return _Extent(corners, volume, centre, spread)


def _pose(shape: Element) -> tuple[Array, Array]:
    """Return the rotation of a shape's axes to its link's, and its place there [m].

    Raises:
        ValueError: when they are no numbers.
    """
    origin = shape.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    xyz, rpy = (_floats(origin.get(key, "0 0 0"), 3) for key in ("xyz", "rpy"))
    return pin.rpy.rpyToMatrix(rpy), xyz


class _Sizes(NamedTuple):
    """A solid's size: half the edges of its box [m], volume [m^3], and means of x², y², z² over it [m^2]."""

    half: Array
    volume: float
    squares: Array


def _sizes(solid: Element) -> _Sizes | None:
    """Return a solid's size about its centre; None where it is no primitive."""
    if solid.tag == "box":
        half = _floats(solid.get("size", ""), 3) / 2.0
        return _Sizes(half, float(np.prod(2.0 * half)), half**2 / 3.0)
    if solid.tag == "sphere":
        half = np.full(3, float(_floats(solid.get("radius", ""), 1)[0]))
        return _Sizes(half, float(4.0 / 3.0 * math.pi * half[0] ** 3), half**2 / 5.0)
    if solid.tag == "cylinder":
        radius, length = _floats(f"{solid.get('radius', '')} {solid.get('length', '')}", 2)
        half = np.array([radius, radius, length / 2.0])
        return _Sizes(half, float(math.pi * radius**2 * length), half**2 / np.array([4.0, 4.0, 3.0]))
    return None


def _floats(text: str, count: int) -> Array:
    """Return the finite numbers of an attribute.

    Raises:
        ValueError: when they are others.
    """
    numbers = np.array([float(word) for word in text.split()])
    if numbers.shape != (count,) or not np.all(np.abs(numbers) < 1e6):
        raise ValueError(text)
    return numbers
