"""Checks of mass properties against the link's own primitive shapes: boxes, cylinders, spheres."""

from __future__ import annotations

import math
from collections.abc import Iterator
from statistics import median
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from armgpi.arrays import Array
from armgpi.health.findings import Finding, Subject, check
from armgpi.robot.tree import Link

#: Shapes whose diagonal is shorter are placeholders [m].
_PLACEHOLDER = 0.02
#: A link lighter than this share of what moves gets no verdict, nor an arm with fewer different shapes.
_NEGLIGIBLE = 1e-4
_DIFFERENT = 2
#: How far beyond its shapes a centre of mass may be, as a share of their diagonal.
_BESIDE = 0.1
#: Radius of gyration below this share of a thin rod's of the same length is too small.
_ROD_SHARE = 0.5
#: Densities of what robots are made of, over the volume of the shapes [kg/m^3].
_LIGHTEST, _HEAVIEST = 20.0, 20_000.0
#: A link's density may be so many times that of the arm's median link, or that part of it.
_FROM_MEDIAN = 40.0


class _Extent(NamedTuple):
    """What the shapes of a link fill, in its frame.

    Attributes:
        corners: of their boxes [m], shape (m, 3).
        volume: their sum [m^3].
    """

    corners: Array
    volume: float


@check(
    "shape-mass",
    "centre of mass, radius of gyration or density contradict the link's own boxes, cylinders and spheres",
    "warning",
)
def against_shapes(subject: Subject) -> Iterator[Finding]:
    """Find mass properties that the shapes of their link contradict."""
    extents = {}
    for element in subject.document.root.findall("link"):
        link = subject.document.links[element.get("name", "")]
        if link.name in subject.moved and link.mass > 0.0:
            extent = _extent(element)
            if extent is not None:
                extents[link.name] = extent
    total = sum(subject.document.links[name].mass for name in subject.moved)
    # Masses that the arm does not feel are often made up.
    for name in list(extents):
        if subject.document.links[name].mass < _NEGLIGIBLE * total:
            del extents[name]
    if len({each.corners.tobytes() for each in extents.values()}) < _DIFFERENT:
        return  # one box for every link is a placeholder
    densities = {name: subject.document.links[name].mass / each.volume for name, each in extents.items()}
    usual = median(densities.values()) if densities else 0.0
    for name, extent in extents.items():
        link = subject.document.links[name]
        yield from _centre(link, extent)
        yield from _gyration(link, extent)
        yield from _density(link, densities[name], usual)


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
        repair = "its mass is too large or its inertia too small: were parts summed about their own centres?"
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


def _extent(element: Element) -> _Extent | None:
    """Return what the shapes of a link fill; None where they are placeholders, or not read.

    Beside a mesh, which is not read, primitive shapes are often a part of the link: feet, stops.
    """
    if element.find(".//mesh") is not None:
        return None
    for tag in ("collision", "visual"):
        shapes = element.findall(tag)
        parts = []
        for shape in shapes:
            part = _part(shape)
            if part is None:
                break
            parts.append(part)
        if shapes and len(parts) == len(shapes):
            corners = np.vstack([part.corners for part in parts])
            if float(np.linalg.norm(np.ptp(corners, axis=0))) < _PLACEHOLDER:
                return None
            return _Extent(corners, sum(part.volume for part in parts))
    return None


def _part(shape: Element) -> _Extent | None:
    """Return what one shape fills; None for a mesh, or numbers that are not read."""
    geometry = shape.find("geometry")
    solid = None if geometry is None else next(iter(geometry), None)
    if solid is None:
        return None
    try:
        sizes = _sizes(solid)
        origin = shape.find("origin")
        xyz, rpy = np.zeros(3), np.zeros(3)
        if origin is not None:
            xyz, rpy = (_floats(origin.get(key, "0 0 0"), 3) for key in ("xyz", "rpy"))
    except ValueError:
        return None
    if sizes is None or not np.all(sizes[0] > 0.0) or not sizes[1] > 0.0:
        return None
    half, volume = sizes
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    corners = xyz + (signs * half) @ pin.rpy.rpyToMatrix(rpy).T
    return _Extent(corners, volume)


def _sizes(solid: Element) -> tuple[Array, float] | None:
    """Return half the edges of a solid's box [m], and its volume [m^3]; None where it is no primitive."""
    if solid.tag == "box":
        edges = _floats(solid.get("size", ""), 3)
        return edges / 2.0, float(np.prod(edges))
    if solid.tag == "sphere":
        radius = float(_floats(solid.get("radius", ""), 1)[0])
        return np.full(3, radius), 4.0 / 3.0 * math.pi * radius**3
    if solid.tag == "cylinder":
        radius, length = _floats(f"{solid.get('radius', '')} {solid.get('length', '')}", 2)
        return np.array([radius, radius, length / 2.0]), float(math.pi * radius**2 * length)
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
