"""From URDF text to a Pinocchio model of a fixed-base arm, with joints locked by name.

Pinocchio accepts many broken files without a word (missing inertias become zero mass, a second parent
makes another tree), so the XML is read and checked first, in this order: the file and its XML
(:mod:`armgpi.markup`), names, joints, inertials, the tree. What reaches Pinocchio is written anew from
what was read: a tree of fixed, revolute and prismatic joints, one coordinate each, without geometry.
Locking happens there (the joint becomes fixed at its value), which also works where a link and a joint
share a name.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
import tempfile
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import pinocchio as pin

from armgpi.arrays import Array, as_number, frozen
from armgpi.errors import ArmgpiWarning, NameNotFound, ParameterError, UrdfError
from armgpi.markup import MAX_BYTES as MAX_BYTES
from armgpi.markup import parse_xml, xacro_hint
from armgpi.markup import read_file as read_file

MAX_JOINTS = 2_000
#: Pinocchio's data of a chain needs about 64 B x n^3: 64 joints are 17 MB, 500 would be 8 GB.
MAX_MOVING_JOINTS = 64
MOVING_TYPES = ("revolute", "continuous", "prismatic")
#: Types with more than one coordinate: to be locked, or refused.
WIDE_TYPES = ("floating", "planar")
#: Larger numbers in lengths, masses and inertias overflow in D(q); no robot has them.
_HUGEST = 1e15
#: Ratios of mimic joints are between these, or 0.
_LEAST_RATIO, _MOST_RATIO = 1e-6, 1e6
#: Stands for "no limit" where urdfdom wants a number; ours are set afterwards.
_UNBOUNDED = {"lower": "-1e300", "upper": "1e300", "effort": "1e300", "velocity": "1e300"}

Mimic = Literal["lock", "follow"]


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


class Coupling(NamedTuple):
    """How all coordinates of a model follow from the n that are free: ``ratio @ q + offset``.

    Attributes:
        ratio: shape (m, n).
        offset: shape (m,) [rad or m].
    """

    ratio: Array
    offset: Array


class Built(NamedTuple):
    """A Pinocchio model made from a :class:`Urdf`, and what was decided on the way.

    Attributes:
        model: the model; nq = nv.
        joints: the URDF joint of every coordinate, in the model's order.
        locked: value of every locked joint [rad or m].
        coupling: how the coordinates follow from fewer free ones; None when all of them are free.
    """

    model: Any
    joints: tuple[Joint, ...]
    locked: Mapping[str, float]
    coupling: Coupling | None = None


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


def build(
    urdf: Urdf,
    lock: Sequence[str] | Mapping[str, float] = (),
    keep: Sequence[str] | None = None,
    mimic: Mimic = "lock",
) -> Built:
    """Build the Pinocchio model of `urdf` with some joints locked.

    Args:
        urdf: the checked URDF.
        lock: names of joints to lock at zero (or at the limit nearest to zero), or name -> value.
        keep: when given, every moving joint that is not named here is locked.
        mimic: whether joints that mimic another are locked or follow it.

    Raises:
        NameNotFound: when a name is not that of a moving joint.
        ArrayError: when a value to lock at is no finite number.
        ParameterError: when a joint shall be both locked and kept.
        UrdfError: when a joint type is not supported, no moving joint is left, a moving link has no
            possible inertia, or Pinocchio refuses.
    """
    if mimic not in ("lock", "follow"):
        raise ParameterError("mimic", mimic, "'lock' or 'follow'")
    locked = _locked_values(urdf, lock, keep, mimic)
    moving = [j for j in urdf.joints.values() if j.moves and j.name not in locked]
    for joint in urdf.joints.values():
        if joint.type in WIDE_TYPES and joint.name not in locked:
            raise UrdfError(
                urdf.source,
                f"joint {joint.name!r} is {joint.type}; armgpi needs a fixed base and revolute, continuous "
                f"or prismatic joints: lock it (lock=[{joint.name!r}], --lock {joint.name}) or make it fixed",
                joint.name,
            )
    if not moving:
        if locked:
            left = "left (revolute, continuous or prismatic); lock fewer, or keep some"
        else:
            left = "(revolute, continuous or prismatic), so there is nothing to control"
        raise UrdfError(urdf.source, f"has no moving joint {left}")
    if len(moving) > MAX_MOVING_JOINTS:
        raise UrdfError(
            urdf.source,
            f"has {len(moving)} moving joints, more than the {MAX_MOVING_JOINTS} allowed; lock some of them "
            "or keep only those of an arm (keep=[...], --keep JOINT,JOINT,...)",
        )
    moved = urdf.moved_links(locked)
    for link in urdf.links.values():
        if link.name in moved:
            _check_inertia(link, urdf.source)
    if not any(urdf.links[name].mass > 0.0 for name in moved):
        _refuse_shapes_alone(urdf, moved)
    model = _pinocchio_model(_written(urdf, locked), urdf.source)
    joints = tuple(urdf.joints[name] for name in list(model.names)[1:])
    if model.nq != model.nv or model.nv != len(joints) or len(joints) != len(moving):
        raise UrdfError(
            urdf.source,
            f"Pinocchio made {len(joints)} joints with {model.nq} coordinates of {len(moving)} moving joints",
        )
    coupling = _coupling(urdf, joints) if mimic == "follow" else None
    return Built(model, joints, locked, coupling)


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


def _check_inertia(link: Link, source: str) -> None:
    """Refuse a moving link whose inertia no body has: not positive, or without mass."""
    where = f"link {link.name!r}"
    smallest = float(link.moments()[0])
    largest = max(map(abs, link.inertia))
    if smallest < -1e-9 * max(1e-6, largest):
        raise UrdfError(
            source,
            f"{where} has an inertia that is not positive (smallest eigenvalue {smallest:g})",
            link.name,
        )
    if link.mass == 0.0 and largest > 0.0:
        raise UrdfError(source, f"{where} has an inertia but no mass", link.name)


def _refuse_shapes_alone(urdf: Urdf, moved: Collection[str]) -> None:
    """Refuse a robot without any mass: many a URDF was made for drawing and planning alone."""
    names = [name for name in urdf.links if name in moved]
    listed = ", ".join(map(repr, names[:8])) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    raise UrdfError(
        urdf.source,
        f"has no mass in any link that moves ({listed}): it says how the robot looks and bends, not how "
        "heavy it is; add an <inertial> with mass and inertia to each link, or take a URDF that has them, "
        "from the robot's maker or from CAD",
        names[0],
    )


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


def _locked_values(
    urdf: Urdf, lock: Sequence[str] | Mapping[str, float], keep: Sequence[str] | None, mimic: Mimic
) -> dict[str, float]:
    """Return the value of every joint to lock: those asked for, those not kept, and mimic joints."""
    moving = [name for name, joint in urdf.joints.items() if joint.type != "fixed"]
    asked: dict[str, float | None] = (
        dict(lock) if isinstance(lock, Mapping) else dict.fromkeys(_name_list(lock, "lock"))
    )
    kept = None if keep is None else _name_list(keep, "keep")
    for name in (*asked, *(kept or ())):
        if name not in moving:
            raise NameNotFound("moving joint", name, moving)
        if kept is not None and name in kept and name in asked:
            raise ParameterError("lock", name, "a joint that is not in keep as well")
    if kept is not None:
        for name in moving:
            followed = mimic == "follow" and _leader(urdf, name).name in kept
            if name not in kept and not followed:
                asked.setdefault(name, None)
    values: dict[str, float] = {}
    for name, value in asked.items():
        joint = urdf.joints[name]
        values[name] = joint.nearest_to_zero() if value is None else as_number(value, f"lock[{name!r}]")
        if joint.type in WIDE_TYPES and values[name] != 0.0:
            raise ParameterError(
                f"lock[{name!r}]", value, f"0, as a {joint.type} joint is locked where it stands"
            )
    for name in moving:
        joint = urdf.joints[name]
        if joint.mimic is not None and joint.moves and name not in values:
            _lock_follower(urdf, joint, values, mimic)
    return values


def _lock_follower(urdf: Urdf, joint: Joint, values: dict[str, float], mimic: Mimic) -> None:
    """Lock a joint that mimics another where it would have followed to, or let it follow."""
    follow = [joint]
    while follow[-1].mimic is not None and follow[-1].name not in values:
        leader = follow[-1].mimic
        if leader not in urdf.joints:
            raise UrdfError(
                urdf.source,
                f"joint {follow[-1].name!r} mimics {leader!r}, which does not exist; correct the name, "
                f"or lock it (--lock {follow[-1].name})",
                follow[-1].name,
            )
        follow.append(urdf.joints[leader])
    leader_moves = follow[-1].moves and follow[-1].name not in values
    if leader_moves and mimic == "follow":
        return
    value = values.get(follow[-1].name, 0.0)
    for follower in reversed(follow[:-1]):
        value = follower.mimic_offset + follower.mimic_multiplier * value
    values[joint.name] = value
    if leader_moves:
        warnings.warn(
            f"{urdf.source}: joint {joint.name!r} mimics {joint.mimic!r}; it is locked at {value:g}, "
            f"so lock {joint.mimic!r} as well if they move one gripper, or let it follow (mimic='follow')",
            ArmgpiWarning,
            stacklevel=6,  # where the user calls Robot.load
        )


def _leader(urdf: Urdf, name: str) -> Joint:
    """Return the joint that a joint follows in the end; itself when it follows none."""
    joint = urdf.joints[name]
    while joint.mimic is not None and joint.mimic in urdf.joints:
        joint = urdf.joints[joint.mimic]
    return joint


def _coupling(urdf: Urdf, joints: Sequence[Joint]) -> Coupling | None:
    """Return how all of `joints` follow from the free ones among them; None when all are free."""
    free = [joint.name for joint in joints if joint.mimic is None]
    if len(free) == len(joints):
        return None
    ratio, offset = np.zeros((len(joints), len(free))), np.zeros(len(joints))
    for row, joint in enumerate(joints):
        factor, shift, current = 1.0, 0.0, joint
        while current.mimic is not None:
            shift += factor * current.mimic_offset
            factor *= current.mimic_multiplier
            current = urdf.joints[current.mimic]
        ratio[row, free.index(current.name)], offset[row] = factor, shift
    return Coupling(frozen(ratio), frozen(offset))


def _name_list(value: Any, name: str) -> list[Any]:
    """Return joint names given as one name or several."""
    if isinstance(value, str):
        return [value]
    try:
        return list(value)
    except TypeError:
        raise ParameterError(name, value, "names of joints") from None


def _written(urdf: Urdf, locked: Mapping[str, float]) -> str:
    """Return the URDF that Pinocchio gets: locked joints fixed, continuous ones unbounded, no geometry."""
    version = {"version": urdf.root.get("version", "1.0")}
    root = Element("robot", {"name": urdf.name, **version})  # urdfdom insists on a name
    for link in urdf.links.values():
        element = SubElement(root, "link", name=link.name)
        if link.inertial:
            inertial = SubElement(element, "inertial")
            SubElement(inertial, "origin", xyz=_words(link.xyz), rpy=_words(link.rpy))
            SubElement(inertial, "mass", value=repr(link.mass))
            keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            SubElement(inertial, "inertia", dict(zip(keys, map(repr, link.inertia), strict=True)))
    for joint in urdf.joints.values():
        moves = joint.moves and joint.name not in locked
        # A continuous joint as one unbounded angle instead of Pinocchio's (cos, sin), so that nq = nv.
        kind = "prismatic" if joint.type == "prismatic" else "revolute"
        element = SubElement(root, "joint", name=joint.name, type=kind if moves else "fixed")
        SubElement(element, "parent", link=joint.parent)
        SubElement(element, "child", link=joint.child)
        xyz, rpy = (joint.xyz, joint.rpy) if moves else _stand(joint, locked.get(joint.name, 0.0))
        SubElement(element, "origin", xyz=_words(xyz), rpy=_words(rpy))
        if moves:
            SubElement(element, "axis", xyz=_words(joint.direction.tolist()))
            SubElement(element, "limit", _UNBOUNDED)
    return tostring(root, encoding="unicode")


def _stand(joint: Joint, value: float) -> tuple[Sequence[float], Sequence[float]]:
    """Return xyz and rpy of a fixed joint that stands where the moving one stands at `value`."""
    if value == 0.0:
        return joint.xyz, joint.rpy
    axis, xyz = joint.direction, np.array(joint.xyz)
    rotation = pin.rpy.rpyToMatrix(np.array(joint.rpy))
    if joint.type == "prismatic":
        xyz = xyz + rotation @ axis * value
    else:
        rotation = rotation @ pin.exp3(axis * value)
    return xyz.tolist(), pin.rpy.matrixToRpy(rotation).tolist()


def _words(numbers: Iterable[float]) -> str:
    """Join numbers as URDF attributes want them, to the last digit."""
    return " ".join(map(repr, numbers))


def _pinocchio_model(xml: str, source: str) -> Any:
    """Build the model, turning Pinocchio's bare refusal into one that carries the parser's reason."""
    with _captured_stderr() as captured:
        try:
            model = pin.buildModelFromXML(xml)
            reason = ""
        except (ValueError, RuntimeError, UnicodeError) as error:
            model, reason = None, str(error)
    if model is None:
        # Line numbers in it are of urdfdom's source.
        said = " ".join(re.sub(r" at line \d+ in \S+", "", captured[0]).split()) if captured else ""
        raise UrdfError(source, f"is refused by Pinocchio: {said or reason}")
    return model


@contextmanager
def _captured_stderr() -> Iterator[list[str]]:
    """Collect what C++ writes to file descriptor 2, where urdfdom puts the reason of a refusal."""
    said: list[str] = []
    with tempfile.TemporaryFile() as sink:
        saved = os.dup(2)
        try:
            os.dup2(sink.fileno(), 2)
            yield said
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            sink.seek(0)
            said.append(sink.read().decode("utf-8", "replace"))
