"""From URDF text to a Pinocchio model of a fixed-base arm, with joints locked by name.

Pinocchio accepts many broken files without a word (missing inertias become zero mass, a second parent
makes another tree), so the XML is read and checked first; what reaches Pinocchio is a tree of revolute
and prismatic joints, one coordinate each. Locking happens in the XML (the joint becomes fixed at its
value), which also works where a link and a joint share a name.
"""

from __future__ import annotations

import copy
import hashlib
import math
import os
import re
import stat
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from armgpi.arrays import as_number
from armgpi.errors import ArmgpiWarning, NameNotFound, ParameterError, UrdfError

MAX_BYTES = 32 * 1024 * 1024
MAX_JOINTS = 2_000
MAX_DEPTH = 100
#: Pinocchio's data of a chain needs about 64 B x n^3: 64 joints are 17 MB, 500 would be 8 GB.
MAX_MOVING_JOINTS = 64
MOVING_TYPES = ("revolute", "continuous", "prismatic")
#: Root element -> what such a file is.
_OTHER_FORMATS = {"mujoco": "a MuJoCo model (MJCF)", "sdf": "an SDF model", "html": "a web page"}
#: Stands for "no limit" where urdfdom wants a number.
_UNBOUNDED = "1e300"
#: Attributes that hold numbers which Pinocchio reads.
_NUMBERS = ("xyz", "rpy", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True)
class Joint:
    """One URDF joint as written in the file.

    Attributes:
        name: its name.
        type: its URDF type ("revolute", "continuous", "prismatic" or "fixed").
        lower: lower position limit [rad or m], -inf when it has none.
        upper: upper position limit [rad or m], inf when it has none.
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


@dataclass(frozen=True)
class Urdf:
    """A URDF whose XML has been read and checked.

    Attributes:
        source: path of the file, or a description of where the text came from.
        name: name of the robot.
        sha256: hash of the text.
        root: the XML.
        joints: every joint by name, in the order of the file.
    """

    source: str
    name: str
    sha256: str
    root: ElementTree.Element
    joints: Mapping[str, Joint]


class Built:
    """A Pinocchio model made from a :class:`Urdf`, and what was decided on the way.

    Attributes:
        model: the model; nq = nv = n.
        joints: the URDF joint of every coordinate, in the model's order.
        locked: value of every locked joint [rad or m].
    """

    def __init__(self, model: Any, joints: tuple[Joint, ...], locked: Mapping[str, float]) -> None:
        """Keep the model with its joints and locks."""
        self.model = model
        self.joints = joints
        self.locked = locked


def read_file(path: Path) -> str:
    """Return the text of a URDF file.

    Raises:
        UrdfError: when it is no regular file, too large, unreadable or not UTF-8.
    """
    try:
        # A FIFO would hang and a device would fill the memory: look before opening.
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "no regular file"
            raise UrdfError(path, f"expected a URDF file, this is {kind}")
        if status.st_size > MAX_BYTES:
            raise UrdfError(path, f"has {status.st_size} bytes, more than the {MAX_BYTES} allowed")
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UrdfError(path, f"is not UTF-8 text (byte {error.start}); is it a URDF?") from None
    except OSError as error:
        raise UrdfError(path, f"cannot be read: {error.strerror or error}") from None


def parse(text: str, source: str) -> Urdf:
    """Read and check the XML of a URDF.

    Args:
        text: the XML.
        source: path or description, for messages.

    Raises:
        UrdfError: when it is no well-formed URDF of a single tree, naming the link or joint.
    """
    if not text.strip():
        raise UrdfError(source, "is empty")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise UrdfError(source, "has a document type declaration (DTD), which a URDF does not need")
    try:
        root = ElementTree.fromstring(text.lstrip("\ufeff").strip())
    except (ElementTree.ParseError, UnicodeEncodeError) as error:
        raise UrdfError(source, f"is not well-formed XML: {error}") from None
    if _depth(root) > MAX_DEPTH:
        raise UrdfError(source, f"has XML elements nested more than {MAX_DEPTH} deep, which no URDF has")
    if root.tag != "robot":
        kind = _OTHER_FORMATS.get(root.tag, "no URDF")
        raise UrdfError(source, f"is {kind}: expected the root element <robot>, got <{root.tag}>")
    if len(root.findall("joint")) > MAX_JOINTS:
        raise UrdfError(source, f"has more than {MAX_JOINTS} joints")
    links = _unique_names(root, "link", source)
    names = _unique_names(root, "joint", source)
    joints = {name: _read_joint(element, source) for name, element in names.items()}
    for link, element in links.items():
        _check_inertial(element, link, source)
    _check_tree(links, names, source)
    return Urdf(
        source=source,
        name=root.get("name") or "unnamed",
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        root=root,
        joints=joints,
    )


def build(
    urdf: Urdf, lock: Sequence[str] | Mapping[str, float] = (), keep: Sequence[str] | None = None
) -> Built:
    """Build the Pinocchio model of `urdf` with some joints locked.

    Args:
        urdf: the checked URDF.
        lock: names of joints to lock at zero (or at the limit nearest to zero), or name -> value.
        keep: when given, every moving joint that is not named here is locked.

    Raises:
        NameNotFound: when a name is not that of a moving joint.
        ArrayError: when a value to lock at is no finite number.
        ParameterError: when a joint shall be both locked and kept.
        UrdfError: when a joint type is not supported, no moving joint is left, or Pinocchio refuses.
    """
    locked = _locked_values(urdf, lock, keep)
    moving = [j for j in urdf.joints.values() if j.moves and j.name not in locked]
    if not moving:
        raise UrdfError(urdf.source, "has no moving joint left (revolute, continuous or prismatic)")
    if len(moving) > MAX_MOVING_JOINTS:
        raise UrdfError(
            urdf.source,
            f"has {len(moving)} moving joints, more than the {MAX_MOVING_JOINTS} allowed; lock some of them "
            "or keep only an arm with keep=[...]",
        )
    for joint in urdf.joints.values():
        if not joint.moves and joint.type != "fixed":
            raise UrdfError(
                urdf.source,
                f"joint {joint.name!r} is {joint.type}; armgpi needs a fixed base and revolute, continuous "
                "or prismatic joints: make it fixed in the file",
                joint.name,
            )
    xml = ElementTree.tostring(_with_locks(urdf, locked), encoding="unicode")
    model = _pinocchio_model(xml, urdf.source)
    joints = tuple(urdf.joints[name] for name in list(model.names)[1:])
    if model.nq != model.nv or model.nv != len(joints) or len(joints) != len(moving):
        raise UrdfError(
            urdf.source,
            f"Pinocchio made {len(joints)} joints with {model.nq} coordinates of {len(moving)} moving joints",
        )
    return Built(model, joints, locked)


def _depth(root: ElementTree.Element) -> int:
    """Return how deep elements are nested, without recursion of our own."""
    depth, level = 0, [root]
    while level:
        depth, level = depth + 1, [child for element in level for child in element]
    return depth


def _unique_names(root: ElementTree.Element, tag: str, source: str) -> dict[str, ElementTree.Element]:
    """Return the elements `tag` under `root` by name; names must exist and differ."""
    found: dict[str, ElementTree.Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise UrdfError(source, f"a <{tag}> has no name")
        if name in found:
            raise UrdfError(source, f"two {tag}s are named {name!r}", name)
        found[name] = element
    if tag == "link" and not found:
        raise UrdfError(source, "has no <link>")
    return found


def _read_joint(element: ElementTree.Element, source: str) -> Joint:
    """Read type, limits, dynamics and mimic of a <joint>, checking every number."""
    name = element.get("name", "")
    where = f"joint {name!r}"
    kind = element.get("type", "")
    if kind not in (*MOVING_TYPES, "fixed", "floating", "planar"):
        raise UrdfError(source, f"{where} has type {kind!r}, which URDF does not know", name)
    for tag in ("origin", "axis"):
        child = element.find(tag)
        if child is not None:
            _numbers(child, "xyz", 3, f"{where}, <{tag}>", source, name)
            if tag == "origin":
                _numbers(child, "rpy", 3, f"{where}, <{tag}>", source, name)
    if kind in MOVING_TYPES:
        axis_element = element.find("axis")
        axis = None if axis_element is None else _numbers(axis_element, "xyz", 3, where, source, name)
        if axis is not None and not any(axis):
            raise UrdfError(source, f"{where} has the axis 0 0 0", name)

    limit = element.find("limit")
    bounded = kind in ("revolute", "prismatic")
    if bounded and limit is None:
        raise UrdfError(source, f"{where} is {kind} and has no <limit>", name)

    def read(tag: ElementTree.Element | None, key: str, default: float) -> float:
        if tag is None or tag.get(key) is None:
            return default
        return _numbers(tag, key, 1, f"{where}, <{tag.tag}>", source, name)[0]

    lower = read(limit, "lower", 0.0) if bounded else -math.inf
    upper = read(limit, "upper", 0.0) if bounded else math.inf
    velocity = read(limit, "velocity", math.inf)
    effort = read(limit, "effort", math.inf)
    dynamics = element.find("dynamics")
    damping = read(dynamics, "damping", 0.0)
    friction = read(dynamics, "friction", 0.0)
    if lower > upper:
        raise UrdfError(source, f"{where} has its lower limit {lower:g} above its upper {upper:g}", name)
    for label, value in (
        ("velocity limit", velocity),
        ("effort limit", effort),
        ("damping", damping),
        ("friction", friction),
    ):
        if value < 0.0:
            raise UrdfError(source, f"{where} has a negative {label}: {value:g}", name)
    mimic = element.find("mimic")
    return Joint(
        name,
        kind,
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


def _check_inertial(link: ElementTree.Element, name: str, source: str) -> None:
    """Check mass, inertia and origin of a link's <inertial>, if it has one."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    where = f"link {name!r}"
    mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
    if mass_element is None or inertia_element is None:
        missing = "mass" if mass_element is None else "inertia"
        raise UrdfError(source, f"{where} has an <inertial> without <{missing}>", name)
    origin = inertial.find("origin")
    if origin is not None:
        _numbers(origin, "xyz", 3, f"{where}, <origin>", source, name)
        _numbers(origin, "rpy", 3, f"{where}, <origin>", source, name)
    mass = _required(mass_element, "value", f"{where}, <mass>", source, name)
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (
        _required(inertia_element, key, f"{where}, <inertia>", source, name) for key in keys
    )
    if mass < 0.0:
        raise UrdfError(source, f"{where} has the negative mass {mass:g}", name)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    smallest = float(np.linalg.eigvalsh(tensor)[0])
    if smallest < -1e-9 * max(1e-6, float(np.abs(tensor).max())):
        raise UrdfError(
            source, f"{where} has an inertia that is not positive (smallest eigenvalue {smallest:g})", name
        )
    if mass == 0.0 and tensor.any():
        raise UrdfError(source, f"{where} has an inertia but no mass", name)


def _check_tree(
    links: Mapping[str, ElementTree.Element], joints: Mapping[str, ElementTree.Element], source: str
) -> None:
    """Check that the joints connect all links into one tree."""
    parent_of: dict[str, str] = {}
    for name, element in joints.items():
        ends = []
        for tag in ("parent", "child"):
            end = element.find(tag)
            link = None if end is None else end.get("link")
            if not link:
                raise UrdfError(source, f"joint {name!r} has no {tag} link", name)
            if link not in links:
                raise UrdfError(
                    source, f"joint {name!r} names the {tag} link {link!r}, which is missing", name
                )
            ends.append(link)
        parent, child = ends
        if child in parent_of:
            raise UrdfError(source, f"link {child!r} has two parents (second one by joint {name!r})", child)
        parent_of[child] = parent
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1:
        raise UrdfError(
            source, f"is not one tree: {' and '.join(map(repr, roots[:5]))} have no parent", roots[1]
        )
    reached = set(roots)
    children: dict[str, list[str]] = {}
    for child, parent in parent_of.items():
        children.setdefault(parent, []).append(child)
    front = list(roots)
    while front:
        for child in children.get(front.pop(), ()):
            reached.add(child)
            front.append(child)
    if len(reached) < len(links):
        lost = next(link for link in links if link not in reached)
        raise UrdfError(source, f"has a cycle through link {lost!r}", lost)


def _numbers(
    element: ElementTree.Element, key: str, count: int, where: str, source: str, name: str
) -> tuple[float, ...]:
    """Return the `count` finite numbers of attribute `key`; zeros when the attribute is missing."""
    text = element.get(key)
    if text is None:
        return (0.0,) * count
    try:
        if not text.isascii() or "_" in text:
            raise ValueError  # Python's float reads 1_0 and digits of other scripts, urdfdom does not
        values = tuple(float(word) for word in text.split())
    except ValueError:
        raise UrdfError(source, f"{where}: {key}={text!r} is not a number", name) from None
    if len(values) != count:
        raise UrdfError(source, f"{where}: {key}={text!r} has {len(values)} numbers, expected {count}", name)
    if not all(map(math.isfinite, values)):
        raise UrdfError(source, f"{where}: {key}={text!r} is not finite", name)
    return values


def _required(element: ElementTree.Element, key: str, where: str, source: str, name: str) -> float:
    """Return the number of an attribute that must be there."""
    if element.get(key) is None:
        raise UrdfError(source, f"{where} has no {key}", name)
    return _numbers(element, key, 1, where, source, name)[0]


def _locked_values(
    urdf: Urdf, lock: Sequence[str] | Mapping[str, float], keep: Sequence[str] | None
) -> dict[str, float]:
    """Return the value of every joint to lock: those asked for, those not kept, and mimic joints."""
    moving = [name for name, joint in urdf.joints.items() if joint.moves]
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
            if name not in kept:
                asked.setdefault(name, None)
    values: dict[str, float] = {}
    for name, value in asked.items():
        joint = urdf.joints[name]
        nearest_zero = min(max(0.0, joint.lower), joint.upper)
        values[name] = nearest_zero if value is None else as_number(value, f"lock[{name!r}]")
    for name in moving:
        joint = urdf.joints[name]
        if joint.mimic is None or name in values:
            continue
        if joint.mimic not in urdf.joints:
            raise UrdfError(urdf.source, f"joint {name!r} mimics {joint.mimic!r}, which does not exist", name)
        leader = values.get(joint.mimic, 0.0)
        values[name] = joint.mimic_offset + joint.mimic_multiplier * leader
        if joint.mimic not in values:
            warnings.warn(
                f"{urdf.source}: joint {name!r} mimics {joint.mimic!r}; it is locked at {values[name]:g}, "
                f"so lock {joint.mimic!r} as well if they move one gripper",
                ArmgpiWarning,
                stacklevel=5,  # where the user calls Robot.load
            )
    return values


def _name_list(value: Any, name: str) -> list[Any]:
    """Return joint names given as one name or several."""
    if isinstance(value, str):
        return [value]
    try:
        return list(value)
    except TypeError:
        raise ParameterError(name, value, "names of joints") from None


def _with_locks(urdf: Urdf, locked: Mapping[str, float]) -> ElementTree.Element:
    """Return the XML for Pinocchio: locked joints fixed, continuous ones unbounded, no mimic."""
    root = copy.deepcopy(urdf.root)
    root.set("name", urdf.name)  # urdfdom insists on one
    for element in root.findall("joint"):
        joint = urdf.joints[element.get("name", "")]
        mimic = element.find("mimic")
        if mimic is not None:
            element.remove(mimic)
        if joint.name in locked:
            _fix(element, joint, locked[joint.name])
        elif joint.moves:
            # Limits are set from the checked numbers afterwards; urdfdom only has to accept these.
            for limit in element.findall("limit"):
                element.remove(limit)
            bounds = dict.fromkeys(("upper", "effort", "velocity"), _UNBOUNDED)
            ElementTree.SubElement(element, "limit", {"lower": "-" + _UNBOUNDED, **bounds})
            if joint.type == "continuous":
                # One unbounded angle instead of Pinocchio's (cos, sin), so that nq = nv.
                element.set("type", "revolute")
    for element in root.iter():
        for key in _NUMBERS:
            if key in element.attrib:
                # A space after a number makes urdfdom drop the inertia silently.
                element.set(key, " ".join(element.get(key, "").split()))
    # Dynamics need no geometry, and a missing mesh must not stop them.
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for child in link.findall(tag):
                link.remove(child)
    return root


def _fix(element: ElementTree.Element, joint: Joint, value: float) -> None:
    """Turn a <joint> into a fixed one that stands where the moving one stands at `value`."""
    element.set("type", "fixed")
    if value == 0.0:
        return
    origin = element.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(element, "origin")
    axis_element = element.find("axis")
    axis = np.array([1.0, 0.0, 0.0])
    if axis_element is not None and axis_element.get("xyz") is not None:
        axis = np.array([float(word) for word in axis_element.get("xyz", "").split()])
    axis /= np.linalg.norm(axis)
    xyz = np.array([float(word) for word in origin.get("xyz", "0 0 0").split()])
    rotation = pin.rpy.rpyToMatrix(np.array([float(word) for word in origin.get("rpy", "0 0 0").split()]))
    if joint.type == "prismatic":
        xyz = xyz + rotation @ axis * value
    else:
        rotation = rotation @ pin.exp3(axis * value)
    origin.set("xyz", " ".join(repr(float(x)) for x in xyz))
    origin.set("rpy", " ".join(repr(float(x)) for x in pin.rpy.matrixToRpy(rotation)))


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
