"""From URDF text to links and joints that have been checked.

Pinocchio accepts many broken files without a word (missing inertias become zero mass, a second parent
makes another tree), so the XML is read and checked first, in this order: the file and its XML
(:mod:`armgpi.robot.markup`), names, joints, inertials, the tree. :mod:`armgpi.robot.urdf_model` makes a
model of it.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from armgpi.arrays import Array
from armgpi.errors import UrdfError
from armgpi.robot.markup import MAX_BYTES as MAX_BYTES
from armgpi.robot.markup import parse_xml, xacro_hint
from armgpi.robot.markup import read_file as read_file

MAX_JOINTS = 2_000
MOVING_TYPES = ("revolute", "continuous", "prismatic")
#: Types with more than one coordinate: to be locked, or refused.
WIDE_TYPES = ("floating", "planar")
#: Larger numbers in lengths, masses and inertias overflow in D(q); no robot has them.
_HUGEST = 1e15
#: Ratios of mimic joints are between these, or 0.
_LEAST_RATIO, _MOST_RATIO = 1e-6, 1e6


@dataclass(frozen=True)
class Joint:
    """One URDF joint as written in the file.

    Attributes:
        name: its name.
        type: its URDF type ("revolute", "continuous", "prismatic", "fixed", "floating" or "planar").
        parent: name of the link that carries it.
        child: name of the link that it carries.
        xyz: where it stands on its parent [m].
        rpy: how it is turned there [rad].
        axis: its axis as written, not normalised; (1, 0, 0) when the file gives none.
        lower: lower position limit [rad or m], -inf when it has none (or one below -1e15).
        upper: upper position limit [rad or m], inf when it has none (or one above 1e15).
        velocity: velocity limit [rad/s or m/s], inf when it has none.
        effort: effort limit [N m or N], inf when it has none.
        damping: viscous friction [N m s/rad or N s/m].
        friction: Coulomb friction [N m or N].
        mimic: name of the joint that it copies, None for an ordinary joint.
        mimic_multiplier: factor on the copied joint's position.
        mimic_offset: what is added to it [rad or m].
    """

    name: str
    type: str
    parent: str
    child: str
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    axis: tuple[float, ...]
    lower: float
    upper: float
    velocity: float
    effort: float
    damping: float
    friction: float
    mimic: str | None = None
    mimic_multiplier: float = 1.0
    mimic_offset: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether the joint has a coordinate."""
        return self.type in MOVING_TYPES

    @property
    def direction(self) -> Array:
        """Its axis at unit length, shape (3,)."""
        axis = np.array(self.axis)
        axis /= np.abs(axis).max()  # whose square might be too small for a float
        unit: Array = axis / np.linalg.norm(axis)
        return unit

    def nearest_to_zero(self) -> float:
        """Return the allowed position that is nearest to zero [rad or m]."""
        return min(max(0.0, self.lower), self.upper)


@dataclass(frozen=True)
class Link:
    """One URDF link as written in the file.

    Attributes:
        name: its name.
        mass: its mass [kg]; 0 without <inertial>.
        xyz: its centre of mass [m].
        rpy: how the axes of its inertia are turned [rad].
        inertia: ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, in those axes [kg m^2].
        inertial: whether the file has an <inertial> for it.
        meshes: file names of its meshes as written, without repetition.
    """

    name: str
    mass: float
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    inertia: tuple[float, ...]
    inertial: bool
    meshes: tuple[str, ...]

    def moments(self) -> Array:
        """Return the principal moments of its inertia [kg m^2], ascending, shape (3,)."""
        xx, xy, xz, yy, yz, zz = self.inertia
        moments: Array = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        return moments


@dataclass(frozen=True)
class Urdf:
    """A URDF whose XML has been read and checked.

    Attributes:
        source: path of the file, or a description of where the text came from.
        name: name of the robot.
        sha256: hash of the text.
        root: the XML.
        links: every link by name, in the order of the file.
        joints: every joint by name, in the order of the file.
        base: name of the root link.
    """

    source: str
    name: str
    sha256: str
    root: Element
    links: Mapping[str, Link]
    joints: Mapping[str, Joint]
    base: str

    def moved_links(self, locked: Iterable[str] = ()) -> frozenset[str]:
        """Return the links that some joint moves, when the `locked` ones do not."""
        still = set(locked)
        children: dict[str, list[Joint]] = {}
        for joint in self.joints.values():
            children.setdefault(joint.parent, []).append(joint)
        moved: set[str] = set()
        front = [self.base]
        while front:
            link = front.pop()
            for joint in children.get(link, ()):
                if link in moved or (joint.type != "fixed" and joint.name not in still):
                    moved.add(joint.child)
                front.append(joint.child)
        return frozenset(moved)


def parse(text: str, source: str) -> Urdf:
    """Read and check the XML of a URDF.

    Args:
        text: the XML.
        source: path or description, for messages.

    Raises:
        UrdfError: when it is no well-formed URDF of a single tree, naming the link or joint.
    """
    root = parse_xml(text, source)
    for tag in ("joint", "link"):
        if len(root.findall(tag)) > MAX_JOINTS:
            raise UrdfError(source, f"has more than {MAX_JOINTS} {tag}s")
    link_elements = _unique_names(root, "link", source)
    if not link_elements:
        semantic = root.find("group") is not None or root.find("disable_collisions") is not None
        hint = "; it looks like an SRDF, which goes with a URDF: give that" if semantic else ""
        raise UrdfError(source, f"has no <link>{hint}")
    joint_elements = _unique_names(root, "joint", source)
    joints = {name: _read_joint(element, source) for name, element in joint_elements.items()}
    links = {name: _read_link(element, source) for name, element in link_elements.items()}
    base = _check_tree(links, joints, source)
    _check_mimics(joints, source)
    return Urdf(
        source=source,
        name=" ".join(root.get("name", "").split()) or "unnamed",
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        root=root,
        links=links,
        joints=joints,
        base=base,
    )


def bad_numbers(element: Element, key: str, count: int, positive: bool) -> str:
    """Return what is wrong with the numbers of an attribute that dynamics do not need; empty when nothing is.

    Args:
        element: the element.
        key: its attribute, which may be missing.
        count: how many numbers there should be.
        positive: whether none of them may be zero (a size; negative ones mirror a mesh).
    """
    try:
        values = _numbers(element, key, count, "", "", "")
    except UrdfError as error:
        return str(error).removeprefix(": : ")
    if positive and element.get(key) is not None:
        if element.tag == "mesh" and 0.0 in values:
            return f"{key}={element.get(key)!r} is 0"
        if element.tag != "mesh" and min(values) <= 0.0:
            return f"{key}={element.get(key)!r} is not positive"
    return ""


def _unique_names(root: Element, tag: str, source: str) -> dict[str, Element]:
    """Return the elements `tag` under `root` by name; names must exist and differ."""
    found: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name", "")
        if not name.strip():
            raise UrdfError(source, f"a <{tag}> has no name")
        if not name.isprintable():
            raise UrdfError(
                source, f"{tag} {name[:80]!r} has characters in its name that cannot be printed", name
            )
        if name in found:
            raise UrdfError(source, f"two {tag}s are named {name!r}", name)
        found[name] = element
    return found


def _read_joint(element: Element, source: str) -> Joint:
    """Read a <joint>, checking every number that the dynamics need."""
    name = element.get("name", "")
    where = f"joint {name!r}"
    kind = element.get("type", "")
    if kind not in (*MOVING_TYPES, *WIDE_TYPES, "fixed"):
        known = ", ".join((*MOVING_TYPES, "fixed"))
        way = "make it fixed in the file"
        if kind in ("spherical", "ball"):
            way += ", or three revolute joints in a row with links without mass between them"
        raise UrdfError(source, f"{where} has type {kind!r}, which URDF does not know ({known}); {way}", name)
    parent, child = (_end(element, tag, name, source) for tag in ("parent", "child"))
    xyz, rpy = _origin(element, where, source, name)
    if kind not in MOVING_TYPES:
        # What else it says is of no use, and often a left-over.
        free = (-math.inf, math.inf, math.inf, math.inf, 0.0, 0.0)
        return Joint(name, kind, parent, child, xyz, rpy, (1.0, 0.0, 0.0), *free)

    axis_element = element.find("axis")
    axis: tuple[float, ...] = (1.0, 0.0, 0.0)
    if axis_element is not None:
        axis = _numbers(axis_element, "xyz", 3, f"{where}, <axis>", source, name)
    if not any(axis):
        raise UrdfError(source, f"{where} has the axis 0 0 0; give a direction, such as 0 0 1", name)

    limit, bounded = element.find("limit"), kind in ("revolute", "prismatic")
    if bounded and limit is None:
        way_out = ", or make it continuous" if kind == "revolute" else ""
        raise UrdfError(source, f"{where} is {kind} and has no <limit>: add one{way_out}", name)
    if limit is not None:
        for key, unit in (("effort", "N m or N"), ("velocity", "rad/s or m/s")):
            if limit.get(key) is None:
                raise UrdfError(
                    source,
                    f"{where}, <limit> has no {key}, which URDF requires: add {key} [{unit}]",
                    name,
                )

    def read(tag: Element | None, key: str, default: float) -> float:
        if tag is None or tag.get(key) is None:
            return default
        return _numbers(tag, key, 1, f"{where}, <{tag.tag}>", source, name)[0]

    lower = read(limit, "lower", 0.0)
    upper = read(limit, "upper", 0.0)
    if bounded and lower > upper:
        raise UrdfError(source, f"{where} has its lower limit {lower:g} above its upper {upper:g}", name)
    # Limits that large stand for none, and their difference might overflow.
    lower = lower if bounded and lower > -_HUGEST else -math.inf
    upper = upper if bounded and upper < _HUGEST else math.inf
    velocity = read(limit, "velocity", math.inf)
    effort = read(limit, "effort", math.inf)
    dynamics = element.find("dynamics")
    damping = read(dynamics, "damping", 0.0)
    friction = read(dynamics, "friction", 0.0)
    for label, value in (
        ("velocity limit", velocity),
        ("effort limit", effort),
        ("damping", damping),
        ("friction", friction),
    ):
        if value < 0.0:
            raise UrdfError(source, f"{where} has a negative {label}: {value:g}", name)
        if value > _HUGEST and label in ("damping", "friction"):
            raise UrdfError(source, f"{where} has a {label} of {value:g}, larger than any robot", name)
    mimic = element.find("mimic")
    return Joint(
        name,
        kind,
        parent,
        child,
        xyz,
        rpy,
        axis,
        lower,
        upper,
        velocity,
        effort,
        damping,
        friction,
        mimic=None if mimic is None else mimic.get("joint", ""),
        mimic_multiplier=read(mimic, "multiplier", 1.0),
        mimic_offset=read(mimic, "offset", 0.0),
    )


def _end(joint: Element, tag: str, name: str, source: str) -> str:
    """Return the link that a joint's <parent> or <child> names."""
    end = joint.find(tag)
    link = None if end is None else end.get("link")
    if not link:
        raise UrdfError(source, f"joint {name!r} has no {tag} link", name)
    return link


def _origin(element: Element, where: str, source: str, name: str) -> tuple[tuple[float, ...], ...]:
    """Return xyz and rpy of an element's <origin>; zeros when it has none."""
    origin = element.find("origin")
    if origin is None:
        return (0.0,) * 3, (0.0,) * 3
    place = f"{where}, <origin>"
    xyz = _numbers(origin, "xyz", 3, place, source, name)
    rpy = _numbers(origin, "rpy", 3, place, source, name)
    for key, values in (("xyz", xyz), ("rpy", rpy)):
        if max(map(abs, values)) > _HUGEST:
            raise UrdfError(source, f"{place}: {key}={origin.get(key)!r} is larger than any robot", name)
    return xyz, rpy


def _read_link(element: Element, source: str) -> Link:
    """Read a <link>, checking every number of its <inertial>, if it has one."""
    name = element.get("name", "")
    where = f"link {name!r}"
    meshes = tuple(dict.fromkeys(mesh.get("filename", "") for mesh in element.iter("mesh")))
    inertial = element.find("inertial")
    if inertial is None:
        return Link(name, 0.0, (0.0,) * 3, (0.0,) * 3, (0.0,) * 6, False, meshes)
    mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
    if mass_element is None or inertia_element is None:
        missing = "mass" if mass_element is None else "inertia"
        raise UrdfError(source, f"{where} has an <inertial> without <{missing}>", name)
    xyz, rpy = _origin(inertial, where, source, name)
    mass = _required(mass_element, "value", f"{where}, <mass>", source, name)
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    inertia = tuple(_required(inertia_element, key, f"{where}, <inertia>", source, name) for key in keys)
    if mass < 0.0:
        raise UrdfError(source, f"{where} has the negative mass {mass:g}", name)
    if max(mass, *map(abs, inertia)) > _HUGEST:
        raise UrdfError(source, f"{where} has a mass or inertia larger than any robot", name)
    return Link(name, mass, xyz, rpy, inertia, True, meshes)


def _check_tree(links: Mapping[str, Link], joints: Mapping[str, Joint], source: str) -> str:
    """Check that the joints connect all links into one tree, and return its root."""
    parent_of: dict[str, str] = {}
    children: dict[str, list[str]] = {}
    for name, joint in joints.items():
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise UrdfError(
                    source, f"joint {name!r} names the {tag} link {link!r}, which is missing", name
                )
        if joint.child in parent_of:
            raise UrdfError(
                source, f"link {joint.child!r} has two parents (second one by joint {name!r})", joint.child
            )
        parent_of[joint.child] = joint.parent
        children.setdefault(joint.parent, []).append(joint.child)
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1:
        raise UrdfError(
            source,
            f"is not one tree: {' and '.join(map(repr, roots[:5]))} have no parent; connect them by joints, "
            "or remove what does not belong to the robot",
            roots[1],
        )
    reached = set(roots)
    front = list(roots)
    while front:
        below = children.get(front.pop(), ())
        reached.update(below)
        front.extend(below)
    if len(reached) < len(links):
        lost = next(link for link in links if link not in reached)
        raise UrdfError(source, f"has a cycle through link {lost!r}", lost)
    return roots[0]


def _check_mimics(joints: Mapping[str, Joint], source: str) -> None:
    """Refuse joints that mimic themselves, also by way of others, or by a ratio that no gear has."""
    for joint in joints.values():
        ratio, offset = abs(joint.mimic_multiplier), abs(joint.mimic_offset)
        if not (ratio == 0.0 or _LEAST_RATIO <= ratio <= _MOST_RATIO) or offset > _MOST_RATIO:
            raise UrdfError(
                source,
                f"joint {joint.name!r}, <mimic> has multiplier {joint.mimic_multiplier:g} and offset "
                f"{joint.mimic_offset:g}, which no gear has",
                joint.name,
            )
        seen = {joint.name}
        leader = joint.mimic
        while leader is not None and leader in joints:
            if leader in seen:
                way = "" if joint.mimic == joint.name else f" by way of {joint.mimic!r}"
                raise UrdfError(source, f"joint {joint.name!r} mimics itself{way}", joint.name)
            seen.add(leader)
            leader = joints[leader].mimic


def _numbers(element: Element, key: str, count: int, where: str, source: str, name: str) -> tuple[float, ...]:
    """Return the `count` finite numbers of attribute `key`; zeros when the attribute is missing."""
    text = element.get(key)
    if text is None:
        return (0.0,) * count
    shown = repr(text if len(text) <= 80 else text[:77] + "...")
    try:
        if not text.isascii() or "_" in text:
            raise ValueError  # Python's float reads 1_0 and digits of other scripts, urdfdom does not
        values = tuple(float(word) for word in text.split())
    except ValueError:
        hint = "; write 1.5, not 1,5" if re.fullmatch(r"[\s\d.,+-]+", text) else xacro_hint(text)
        raise UrdfError(source, f"{where}: {key}={shown} is not a number{hint}", name) from None
    if len(values) != count:
        raise UrdfError(source, f"{where}: {key}={shown} has {len(values)} numbers, expected {count}", name)
    if not all(map(math.isfinite, values)):
        raise UrdfError(source, f"{where}: {key}={shown} is not finite", name)
    return values


def _required(element: Element, key: str, where: str, source: str, name: str) -> float:
    """Return the number of an attribute that must be there."""
    if element.get(key) is None:
        raise UrdfError(source, f"{where} has no {key}", name)
    return _numbers(element, key, 1, where, source, name)[0]
