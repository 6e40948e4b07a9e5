"""From URDF text to links and joints that have been checked.

Pinocchio accepts many broken files without a word (missing inertias become zero mass, a second parent
makes another tree), so the XML is read and checked first, in this order: the file and its XML
(:mod:`armgpi.robot.markup`), names, joints, inertials, the tree. What is wrong and can mean one thing alone
is repaired when asked for (:mod:`armgpi.robot.repairs`). :mod:`armgpi.robot.urdf_model` makes a model of it.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement

from armgpi.base.escape import in_si, quote
from armgpi.errors import UrdfError
from armgpi.robot import tree
from armgpi.robot.markup import MAX_BYTES as MAX_BYTES
from armgpi.robot.markup import parse_xml, xacro_hint
from armgpi.robot.markup import read_file as read_file
from armgpi.robot.repairs import NO_FRICTION, Repair, Repairs, repair_names
from armgpi.robot.tree import MOVING_TYPES, MULTI_DOF_TYPES, Joint, Link

MAX_JOINTS = 2_000
#: Larger numbers in lengths, masses and inertias overflow in D(q); no robot has them.
_HUGEST = 1e15
#: Ratios of mimic joints are between these, or 0.
_LEAST_RATIO, _MOST_RATIO = 1e-6, 1e6
#: Solids of shapes, and the attributes without which they have no size.
_SOLIDS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "mesh": ("filename",),
}
#: Elements of shapes, their attributes and how many numbers are in each.
_SHAPE_NUMBERS = (
    *(("origin", "xyz", 3), ("origin", "rpy", 3), ("box", "size", 3), ("sphere", "radius", 1)),
    *(("cylinder", "radius", 1), ("cylinder", "length", 1), ("capsule", "radius", 1), ("mesh", "scale", 3)),
)
#: What a file without links may be made of, by the tags of its elements.
_PARTS = {
    "xacro:property": "constants of xacro",
    "material": "colours",
    "gazebo": "settings of a simulator",
    "ros2_control": "drivers (ros2_control)",
    "transmission": "transmissions",
}
#: Versions of the format, of which urdfdom 6 knows these; without one a file has the first.
_VERSIONS = ("1.0", "1.1", "1.2")
#: Quaternions of a smaller norm, or of one as much larger, are none [-].
_LEAST_NORM = 1e-6
#: Pinocchio's name of the joint that carries the base: asked for it, a model gives that one.
_WORLD = "universe"
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
#: Products of inertia -> the same in the lower triangle.
MIRRORED = {"ixy": "iyx", "ixz": "izx", "iyz": "izy"}


class Coupled(NamedTuple):
    """What a tree of rigid bodies does not have: it is refused while one of its joints moves.

    Attributes:
        what: in words.
        joints: names of the joints on which it acts.
    """

    what: str
    joints: tuple[str, ...]


@dataclass(frozen=True)
class Urdf:
    """A robot's tree that has been read and checked: of a URDF, or of another model.

    Attributes:
        source: path of the file, or a description of where the text came from.
        name: name of the robot.
        sha256: hash of the text.
        root: the XML.
        links: every link by name, in the order of the file.
        joints: every joint by name, in the order of the file.
        base: name of the root link.
        wanted: names of the repairs that were asked for.
        repairs: those that were made.
        armature: name of a joint -> rotor inertia [kg m^2 or kg], of a MuJoCo model.
        gravity: acceleration of free fall [m/s^2], of a model that has one.
        coupled: what is no part of a tree of rigid bodies, of a MuJoCo model.
        compiled: the `mujoco.MjModel` that it came from, to compare with; None for others.
    """

    source: str
    name: str
    sha256: str
    root: Element
    links: Mapping[str, Link]
    joints: Mapping[str, Joint]
    base: str
    wanted: frozenset[str] = frozenset()
    repairs: tuple[Repair, ...] = ()
    armature: Mapping[str, float] = field(default_factory=dict)
    gravity: tuple[float, ...] | None = None
    coupled: tuple[Coupled, ...] = ()
    compiled: Any = None

    def moved_links(self, locked: Iterable[str] = ()) -> frozenset[str]:
        """Return the links that some joint moves, when the `locked` ones do not."""
        return tree.moved_links(self.joints, self.base, locked)


def parse(text: str, source: str, repair: str | Iterable[str] = ()) -> Urdf:
    """Read and check the XML of a URDF.

    Args:
        text: the XML.
        source: path or description, for messages.
        repair: names of repairs that may be made (:mod:`armgpi.robot.repairs`).

    Raises:
        UrdfError: when it is no well-formed URDF of a single tree, naming the link or joint.
        NameNotFound: for a repair, or a link or joint to repair, that does not exist.
    """
    repairs = Repairs(source, repair_names(repair))
    root = parse_xml(text, source)
    _check_version(root, source)
    _turn_quaternions(root, source)
    for tag in ("joint", "link"):
        _check_count(len(root.findall(tag)), tag, source)
    link_elements = _unique_names(root, "link", source)
    if not link_elements:
        raise UrdfError(source, f"has no <link>{_what_instead(root)}")
    joint_elements = _unique_names(root, "joint", source)
    repairs.check_names((*link_elements, *joint_elements))
    joints = {name: _Reader(element, repairs).joint() for name, element in joint_elements.items()}
    links = {name: _Reader(element, repairs).link() for name, element in link_elements.items()}
    return assemble(
        source=source,
        name=" ".join(root.get("name", "").split()) or "unnamed",
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        root=root,
        links=links,
        joints=joints,
        wanted=repairs.wanted,
        repairs=tuple(repairs.made),
    )


def _what_instead(root: Element) -> str:
    """Return what a file without links is, and what to give in its place; it begins with "; "."""
    tags = {element.tag for element in root}
    if tags & {"group", "disable_collisions"}:
        return "; it looks like an SRDF, which requires a URDF: give that"
    if "xacro:macro" in tags:
        return "; it defines macros of xacro for other files: expand the one that uses it, and give that"
    if not tags:
        return "; it is empty: give the URDF of the robot"
    found = [what for tag, what in _PARTS.items() if tag in tags]
    listed = " and ".join(found) or f"<{'>, <'.join(sorted(tags)[:3])}>"
    return f", only {listed}; it is a part of another file: give the one that includes it"


def assemble(source: str, links: Mapping[str, Link], joints: Mapping[str, Joint], **more: Any) -> Urdf:
    """Return links and joints as a robot, checked to be one tree.

    Args:
        source: path or description, for messages.
        links: every link by name.
        joints: every joint by name.
        more: the other attributes of :class:`Urdf`, but for its base.

    Raises:
        UrdfError: when they are too many, or no tree, when a number is none that a robot has, when a joint
            copies itself, or is called as the world is.
    """
    _check_count(len(joints), "joint", source)
    _check_count(len(links), "link", source)
    for link in links.values():
        _check_link(link, source)
    for joint in joints.values():
        _check_joint(joint, source)
    base = _check_tree(links, joints, source)
    _check_mimics(joints, source)
    if _WORLD in joints and joints[_WORLD].type != "fixed":
        raise UrdfError(
            source, f"joint {_WORLD!r} has the name that Pinocchio gives to the world; rename it", _WORLD
        )
    return Urdf(source=source, links=links, joints=joints, base=base, **more)


def elements(name: str, links: Mapping[str, Link], joints: Mapping[str, Joint]) -> Element:
    """Return what checks of a URDF look at, for a robot that came from no XML.

    Args:
        name: name of the robot.
        links: every link by name.
        joints: every joint by name.
    """
    root = Element("robot", name=name)
    for link in links:
        SubElement(root, "link", name=link)
    for joint in joints.values():
        element = SubElement(root, "joint", name=joint.name, type=joint.type)
        if joint.moves:
            SubElement(element, "axis", xyz=" ".join(map(repr, joint.axis)))
        if math.isfinite(joint.effort):
            SubElement(element, "limit", effort=repr(joint.effort))
    return root


def _check_link(link: Link, source: str) -> None:
    """Refuse numbers of a link that no robot has; those of a URDF were checked where they were read."""
    numbers = (link.mass, *link.xyz, *link.rpy, *link.inertia)
    if not max(map(abs, numbers)) <= _HUGEST or link.mass < 0.0 or not all(map(math.isfinite, numbers)):
        said = (
            f"link {link.name!r} has the mass {link.mass:g}, centre {_listed(link.xyz)} and inertia "
            f"{_listed(link.inertia)}; expected finite numbers in kg, m and kg m^2, and a mass of 0 or more"
        )
        raise UrdfError(source, said, link.name)


def _check_joint(joint: Joint, source: str) -> None:
    """Refuse numbers of a joint that no robot has; those of a URDF were checked where they were read."""
    where, place = f"joint {joint.name!r}", (*joint.xyz, *joint.rpy)
    finite = all(map(math.isfinite, (*place, *joint.axis)))
    if not finite or max(map(abs, place)) > _HUGEST or not any(joint.axis):
        said = (
            f"{where} has the place {_listed(joint.xyz)}, the angles {_listed(joint.rpy)} and the axis "
            f"{_listed(joint.axis)}; expected finite numbers in m and rad, and a direction"
        )
        raise UrdfError(source, said, joint.name)
    if not joint.lower <= joint.upper:
        said = f"{where} has the limits {joint.lower:g} to {joint.upper:g}; expected lower and upper"
        raise UrdfError(source, said, joint.name)
    amounts = {
        "velocity limit": joint.velocity,
        "effort limit": joint.effort,
        "damping": joint.damping,
        "friction": joint.friction,
    }
    for label, value in amounts.items():
        bounded = label in ("damping", "friction")
        if not value >= 0.0 or (bounded and value > _HUGEST):
            raise UrdfError(source, f"{where} has a {label} of {value:g}; expected 0 or more", joint.name)


def _listed(numbers: Sequence[float]) -> str:
    """Return numbers for a message."""
    return " ".join(f"{number:g}" for number in numbers)


def _check_count(count: int, tag: str, source: str) -> None:
    """Refuse more links or joints than any robot has."""
    if count > MAX_JOINTS:
        raise UrdfError(source, f"has more than {MAX_JOINTS} {tag}s")


def bad_numbers(element: Element, key: str, count: int, positive: bool) -> str:
    """Return what is wrong with the numbers of an attribute that dynamics do not need; empty when nothing is.

    Args:
        element: the element.
        key: its attribute, which may be missing.
        count: how many numbers there should be.
        positive: whether none of them may be zero (a size; negative ones mirror a mesh).
    """
    text = element.get(key)
    if text is None:
        return ""
    try:
        values = _numbers(text, count)
    except ValueError as error:
        return f"{key}={quote(text)} {error}"
    if positive:
        if element.tag == "mesh" and 0.0 in values:
            return f"{key}={text!r} is 0"
        if element.tag != "mesh" and min(values) <= 0.0:
            return f"{key}={text!r} is not positive"
    return ""


def shape_problems(drawn: Element) -> Iterator[tuple[str, str | None]]:
    """Yield what is wrong with a <visual> or <collision>, and the value that is: no solid, or bad numbers."""
    geometry = drawn.find("geometry")
    if geometry is None:
        yield " has no <geometry>", None
    elif not len(geometry):
        yield " has an empty <geometry>", None
    elif geometry[0].tag not in _SOLIDS:
        yield f" has the shape <{geometry[0].tag}>; expected one of {', '.join(_SOLIDS)}", geometry[0].tag
    else:
        for key in _SOLIDS[geometry[0].tag]:
            if geometry[0].get(key) is None:
                yield f", <{geometry[0].tag}>: {key} is missing", None
    for tag, key, count in _SHAPE_NUMBERS:
        for each in drawn.iter(tag):
            problem = bad_numbers(each, key, count, positive=key not in ("xyz", "rpy"))
            if problem:
                yield f", <{tag}>: {problem}", each.get(key)


def _check_version(root: Element, source: str) -> None:
    """Refuse versions of the format that nobody knows."""
    version = root.get("version", _VERSIONS[0])
    if version.strip() not in _VERSIONS:
        known = ", ".join(_VERSIONS)
        raise UrdfError(source, f"has version={quote(version)}; expected a version of URDF: {known}, or none")


def _turn_quaternions(root: Element, source: str) -> None:
    """Write the angles of every origin that has a quaternion, as versions of URDF beyond 1.0 may."""
    for element in root:
        name = element.get("name", "")
        for origin in element.iter("origin"):
            text = origin.get("quat_xyzw")
            if text is None:
                continue
            where = f"{element.tag} {name!r}, <origin>"
            if root.get("version", _VERSIONS[0]).strip() == _VERSIONS[0]:
                said = 'which version 1.0 of URDF does not have; write version="1.1" into <robot>, or rpy'
                raise UrdfError(source, f"{where} has quat_xyzw, {said}", name)
            if origin.get("rpy") is not None:
                raise UrdfError(source, f"{where} has quat_xyzw and rpy; expected one of them", name)
            try:
                numbers = _numbers(text, len("xyzw"))
            except ValueError as error:
                raise UrdfError(source, f"{where}: quat_xyzw={quote(text)} {error}", name) from None
            norm = math.hypot(*numbers)
            if not _LEAST_NORM < norm < 1.0 / _LEAST_NORM:
                said = f"{where}: quat_xyzw={quote(text)} has the norm {norm:g}; expected a unit quaternion"
                raise UrdfError(source, said, name)
            import pinocchio as pin  # which takes a while, and few files need it

            x, y, z, w = (number / norm for number in numbers)
            angles = pin.rpy.matrixToRpy(pin.Quaternion(w, x, y, z).matrix())
            origin.set("rpy", " ".join(repr(float(angle)) for angle in angles))


def _unique_names(root: Element, tag: str, source: str) -> dict[str, Element]:
    """Return the elements `tag` under `root` by name; names must exist and differ."""
    found: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name", "")
        if not name.strip():
            raise UrdfError(source, f"a <{tag}> has no name; add one")
        if not name.isprintable():
            raise UrdfError(
                source, f"{tag} {name[:80]!r} has characters in its name that cannot be printed", name
            )
        if name in found:
            raise UrdfError(source, f"two {tag}s are named {name!r}; rename one", name)
        found[name] = element
    return found


class _Reader:
    """Reads one <joint> or <link>, checking every number that the dynamics need."""

    def __init__(self, element: Element, repairs: Repairs) -> None:
        self.element = element
        self.repairs = repairs
        self.name = element.get("name", "")
        self.where = f"{element.tag} {self.name!r}"

    def joint(self) -> Joint:
        """Return the <joint>."""
        kind = self._type()
        parent, child = (self._end(tag) for tag in ("parent", "child"))
        xyz, rpy = self._origin(self.element, self.where)
        if kind not in MOVING_TYPES:
            # What else it says is of no use, and often a left-over.
            return Joint(self.name, kind, parent, child, xyz, rpy)
        element = self.element.find("axis")
        axis: tuple[float, ...] = (1.0, 0.0, 0.0)
        if element is not None:
            axis = self._read(element, "xyz", 3, f"{self.where}, <axis>")
        if not any(axis):
            raise self._error(f"{self.where} has the axis 0 0 0; expected a direction, such as 0 0 1")
        limits = self._limits(kind)
        dynamics, mimic = self.element.find("dynamics"), self.element.find("mimic")
        damping, friction = (self._friction(dynamics, key) for key in ("damping", "friction"))
        for label, value in (("damping", damping), ("friction", friction)):
            if value > _HUGEST:
                raise self._error(f"{self.where} has a {label} of {value:g}, larger than any robot")
        return Joint(
            self.name,
            kind,
            parent,
            child,
            xyz,
            rpy,
            axis,
            *limits,
            damping,
            friction,
            mimic=None if mimic is None else mimic.get("joint", ""),
            mimic_multiplier=self._optional(mimic, "multiplier", 1.0),
            mimic_offset=self._optional(mimic, "offset", 0.0),
        )

    def link(self) -> Link:
        """Return the <link>; without <inertial> it has no mass."""
        meshes = tuple(dict.fromkeys(mesh.get("filename", "") for mesh in self.element.iter("mesh")))
        inertial = self.element.find("inertial")
        if inertial is None:
            return Link(self.name, 0.0, (0.0,) * 3, (0.0,) * 3, (0.0,) * 6, False, meshes)
        xyz, rpy = self._origin(inertial, self.where)
        numbers = {"mass": (0.0,), "inertia": (0.0,) * 6}
        missing = ""
        for tag, keys in (("mass", ("value",)), ("inertia", _INERTIA)):
            element = inertial.find(tag)
            if element is None:
                missing = missing or tag
            else:
                numbers[tag] = tuple(
                    self._read_required(element, key) for key in self._written(element, keys)
                )
        (mass,), inertia = numbers["mass"], numbers["inertia"] if missing != "mass" else (0.0,) * 6
        if mass < 0.0:
            raise self._error(f"{self.where} has the negative mass {mass:g}; give kg, 0 or more")
        if max(mass, *map(abs, inertia)) > _HUGEST:
            most = max(mass, *map(abs, inertia))
            said = (
                f"{self.where} has a mass or inertia of {most:g}, larger than that of any robot; "
                "expected kg and kg m^2"
            )
            raise self._error(said)
        return Link(self.name, mass, xyz, rpy, inertia, True, meshes, missing)

    def _written(self, element: Element, keys: Sequence[str]) -> list[str]:
        """Return the attributes of an element by which it has what `keys` name: of a triangle, the other."""
        written = []
        for key in keys:
            other = MIRRORED.get(key, key)
            if element.get(key) is None and element.get(other) is not None:
                problem = f"{self.where}, <{element.tag}> has {other} and no {key}"
                self.repairs.make("mirror-inertia", self.name, problem, f"{other} alone", f"{key} = {other}")
                key = other
            written.append(key)
        return written

    def _friction(self, element: Element | None, key: str) -> float:
        """Return a damping or friction, which a fit may have given below 0."""
        value = self._optional(element, key, 0.0)
        if value >= 0.0:
            return value
        problem = f"{self.where} has a negative {key}: {value:g}; give 0 or more"
        self.repairs.make(NO_FRICTION, self.name, problem, f"{key} {value:g}", "0, more than was identified")
        return 0.0

    def _type(self) -> str:
        """Return the type of the <joint>."""
        kind = self.element.get("type", "")
        if kind not in (*MOVING_TYPES, *MULTI_DOF_TYPES, "fixed"):
            known = ", ".join((*MOVING_TYPES, "fixed"))
            way = "make it fixed in the file"
            if kind in ("spherical", "ball"):
                way += ", or three revolute joints in a row with links without mass between them"
            raise self._error(f"{self.where} has type {kind!r}, which is no type of URDF ({known}); {way}")
        return kind

    def _end(self, tag: str) -> str:
        """Return the link that the joint's <parent> or <child> names."""
        end = self.element.find(tag)
        link = None if end is None else end.get("link")
        if not link:
            raise self._error(f"{self.where} has no {tag} link; name it")
        return link

    def _origin(self, element: Element, where: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return xyz and rpy of an element's <origin>; zeros when it has none."""
        origin = element.find("origin")
        if origin is None:
            return (0.0,) * 3, (0.0,) * 3
        place = f"{where}, <origin>"
        xyz, rpy = (self._read(origin, key, 3, place) for key in ("xyz", "rpy"))
        for key, values in (("xyz", xyz), ("rpy", rpy)):
            if max(map(abs, values)) > _HUGEST:
                raise self._error(f"{place}: {key}={origin.get(key)!r} is larger than any robot")
        return xyz, rpy

    def _limits(self, kind: str) -> tuple[float, float, float, float]:
        """Return lower and upper position limit [rad or m], limits of velocity [rad/s or m/s] and effort.

        That of effort is in N m or N. A limit is infinite where there is none. A bounded joint without
        `lower` or `upper` has 0 there, as URDF says.

        Args:
            kind: the joint's type.

        Raises:
            UrdfError: when a limit is missing, is no number or is negative, or `lower` is above `upper`.
        """
        limit = self.element.find("limit")
        bounded = kind in ("revolute", "prismatic")
        if limit is None:
            if bounded:
                way_out = ", or make it continuous" if kind == "revolute" else ""
                raise self._error(f"{self.where} is {kind} and has no <limit>: add one{way_out}")
            return -math.inf, math.inf, math.inf, math.inf
        for key, unit in (("effort", "N m or N"), ("velocity", "rad/s or m/s")):
            if limit.get(key) is None:
                raise self._error(
                    f"{self.where}, <limit> has no {key}, which URDF requires: add {key} [{unit}]"
                )
        lower = self._optional(limit, "lower", 0.0)
        upper = self._optional(limit, "upper", 0.0)
        if bounded and lower > upper:
            raise self._error(
                f"{self.where} has its lower limit {lower:g} above its upper {upper:g}; exchange them"
            )
        # Limits that large mean none, and their difference might overflow.
        lower = lower if bounded and lower > -_HUGEST else -math.inf
        upper = upper if bounded and upper < _HUGEST else math.inf
        speed = self._not_negative(limit, "velocity", "velocity limit", math.inf)
        effort = self._not_negative(limit, "effort", "effort limit", math.inf)
        speed, effort = (math.inf if most > _HUGEST else most for most in (speed, effort))
        return lower, upper, speed, effort

    def _not_negative(self, element: Element | None, key: str, label: str, default: float) -> float:
        """Return a number that may not be negative; a limit may be infinite."""
        value = self._optional(element, key, default, infinite=math.isinf(default))
        if value < 0.0:
            raise self._error(f"{self.where} has a negative {label}: {value:g}; give 0 or more")
        return value

    def _optional(self, element: Element | None, key: str, default: float, infinite: bool = False) -> float:
        """Return the number of an attribute that need not be there."""
        if element is None or element.get(key) is None:
            return default
        return self._read(element, key, 1, f"{self.where}, <{element.tag}>", infinite)[0]

    def _read_required(self, element: Element, key: str) -> float:
        """Return the number of an attribute that must be there."""
        place = f"{self.where}, <{element.tag}>"
        if element.get(key) is None:
            raise self._error(f"{place} has no {key}; add it")
        return self._read(element, key, 1, place)[0]

    def _read(
        self, element: Element, key: str, count: int, place: str, infinite: bool = False
    ) -> tuple[float, ...]:
        """Return the `count` numbers of attribute `key`; zeros when the attribute is missing."""
        text = element.get(key)
        if text is None:
            return (0.0,) * count
        try:
            return _numbers(text, count, infinite)
        except ValueError as error:
            problem = f"{place}: {key}={quote(text)} {error}"
        split = _without_commas(text)
        if len(split.split()) != count:
            raise self._error(problem)
        try:
            values = _numbers(split, count, infinite)
        except ValueError:
            raise self._error(problem) from None
        self.repairs.make("split-commas", self.name, problem, f"{key}={text!r}", f"{key}={split!r}")
        return values

    def _error(self, message: str) -> UrdfError:
        """Return the refusal of this element."""
        return UrdfError(self.repairs.source, message, self.name)


def _check_tree(links: Mapping[str, Link], joints: Mapping[str, Joint], source: str) -> str:
    """Check that the joints connect all links into one tree, and return its root."""
    carried: set[str] = set()
    for name, joint in joints.items():
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                way = "add it, or correct the name"
                if source.endswith(".xacro"):
                    way += "; or this is a part of a robot: give the file that includes it, expanded"
                said = f"joint {name!r} names the {tag} link {link!r}, which is missing; {way}"
                raise UrdfError(source, said, name)
        if joint.child in carried:
            raise UrdfError(
                source,
                f"link {joint.child!r} has two parents (second one by joint {name!r}); remove a joint",
                joint.child,
            )
        carried.add(joint.child)
    roots = [link for link in links if link not in carried]
    if len(roots) > 1:
        raise UrdfError(
            source,
            f"is not one tree: {' and '.join(map(repr, roots[:5]))} have no parent; connect them by joints, "
            "or remove what does not belong to the robot",
            roots[1],
        )
    reached = {joint.child for root in roots for joint in tree.topological_order(joints, root)}.union(roots)
    if len(reached) < len(links):
        lost = next(link for link in links if link not in reached)
        raise UrdfError(source, f"has a cycle through link {lost!r}; remove the joint that closes it", lost)
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
        if tree.mimic_chain(joints, joint.name)[-1].mimic in joints:  # the chain ended before it closed
            way = "" if joint.mimic == joint.name else f" by way of {joint.mimic!r}"
            raise UrdfError(source, f"joint {joint.name!r} mimics itself{way}", joint.name)


def _numbers(text: str, count: int, infinite: bool = False) -> tuple[float, ...]:
    """Return the `count` finite numbers of a text, or ones that may be infinite.

    Raises:
        ValueError: saying what the text is instead.
    """
    try:
        if not text.isascii() or "_" in text:
            raise ValueError  # Python's float reads 1_0 and digits of other scripts, urdfdom does not
        values = tuple(float(word) for word in text.split())
    except ValueError:
        raise ValueError(f"is not a number{_hint(text, count)}") from None
    if len(values) != count:
        raise ValueError(f"has {len(values)} numbers, expected {count}")
    if any(math.isnan(value) or (math.isinf(value) and not infinite) for value in values):
        raise ValueError("is not finite; write a number")
    return values


def _hint(text: str, count: int) -> str:
    """Return what to write instead of a text that is not a number."""
    if len(_without_commas(text).split()) == count and "," in text:
        return "; separate numbers by spaces, not by commas"
    if re.fullmatch(r"[\s\d.,+-]+", text):
        return "; write 1.5, not 1,5"
    return xacro_hint(text) or f"; {in_si(text) or 'write one'}"


def _without_commas(text: str) -> str:
    """Return a text with spaces for commas between numbers; empty where they may be decimal commas."""
    if re.search(r"\d,\d", text) and len(text.split()) > 1:
        return ""
    return " ".join(text.replace(",", " ").split())
