"""From checked links and joints to a Pinocchio model, and to the text of a URDF for those who read one.

The model is built joint by joint, in the order and by the arithmetic with which Pinocchio reads a URDF: it
is what Pinocchio makes of the text (``tests/robot/test_assembly.py``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.robot import tensors
from armgpi.robot.tree import Joint, Link

#: Means "no limit" where Pinocchio and urdfdom want a number; ours are set afterwards.
_NO_LIMIT = 1e300
_UNBOUNDED = {
    "lower": repr(-_NO_LIMIT),
    "upper": repr(_NO_LIMIT),
    "effort": repr(_NO_LIMIT),
    "velocity": repr(_NO_LIMIT),
}
#: An axis so near to one of x, y and z is that one: Pinocchio has joints of their own for these [-].
_ALIGNED = 1e-12


class Assembly(NamedTuple):
    """The links and joints that a model is made of: locked joints are fixed, continuous ones unbounded.

    Attributes:
        name: name of the robot.
        base: name of the root link.
        links: every link.
        joints: every joint, in the order of the file.
        locked: value of every locked joint [rad or m].
    """

    name: str
    base: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    locked: Mapping[str, float]

    def model(self) -> Any:
        """Return the `pin.Model`, with nq = nv.

        Raises:
            ValueError, RuntimeError: when Pinocchio refuses a name or an inertia.
        """
        model = pin.Model()
        model.name = self.name
        links = {link.name: link for link in self.links}
        own = inertia_of(links[self.base])
        base = pin.Frame(self.base, 0, 0, pin.SE3.Identity(), pin.FrameType.BODY, own)
        bodies = {self.base: model.addFrame(base)}
        for joint in self._in_order():
            link, carrier = links[joint.child], bodies[joint.parent]
            add = self._add_moving if self._moves(joint) else self._add_fixed
            bodies[link.name] = add(model, joint, link, carrier)
        return model

    def urdf(self) -> str:
        """Return the text of the URDF, without geometry."""
        return tostring(self.element(), encoding="unicode")

    def element(self) -> Element:
        """Return the URDF as elements below <robot>."""
        # urdfdom insists on a name.
        root = Element("robot", {"name": self.name, "version": "1.0"})
        for link in self.links:
            element = SubElement(root, "link", name=link.name)
            if link.inertial:
                _write_inertial(element, link)
        for joint in self.joints:
            self._write_joint(root, joint)
        return root

    def _moves(self, joint: Joint) -> bool:
        return joint.moves and joint.name not in self.locked

    def _in_order(self) -> Iterator[Joint]:
        """Yield the joints as Pinocchio adds them: depth first, those of one link by the bytes of names."""
        below: dict[str, list[Joint]] = {}
        for joint in sorted(self.joints, key=lambda joint: joint.name.encode(), reverse=True):
            below.setdefault(joint.parent, []).append(joint)
        front = list(below.get(self.base, ()))
        while front:
            joint = front.pop()
            yield joint
            front += below.get(joint.child, ())

    def _pose(self, joint: Joint) -> tuple[Sequence[float], Sequence[float]]:
        """Return xyz and rpy of a joint on its parent; of a locked one those at its value."""
        value = 0.0 if self._moves(joint) else self.locked.get(joint.name, 0.0)
        if value == 0.0:
            return joint.xyz, joint.rpy
        axis, xyz = joint.direction, np.array(joint.xyz)
        rotation = pin.rpy.rpyToMatrix(np.array(joint.rpy))
        if joint.type == "prismatic":
            xyz = xyz + rotation @ axis * value
        else:
            rotation = rotation @ pin.exp3(axis * value)
        return xyz.tolist(), pin.rpy.matrixToRpy(rotation).tolist()

    def _placement(self, model: pin.Model, joint: Joint, carrier: int) -> Any:
        """Return where a joint is on the moving joint that carries it."""
        xyz, rpy = self._pose(joint)
        return model.frames[carrier].placement * pin.SE3(_rotation(rpy), np.array(xyz, dtype=np.float64))

    def _add_fixed(self, model: pin.Model, joint: Joint, link: Link, carrier: int) -> int:
        """Add a joint that does not move, and return the frame of its link."""
        placement, parent = self._placement(model, joint, carrier), model.frames[carrier].parentJoint
        fixed = pin.FrameType.FIXED_JOINT
        frame = model.addFrame(pin.Frame(joint.name, parent, carrier, placement, fixed, inertia_of(link)))
        return int(model.addBodyFrame(link.name, parent, placement, frame))

    def _add_moving(self, model: pin.Model, joint: Joint, link: Link, carrier: int) -> int:
        """Add a joint that moves, and return the frame of its link."""
        placement, parent = self._placement(model, joint, carrier), model.frames[carrier].parentJoint
        most = np.full(1, _NO_LIMIT)
        index = model.addJoint(parent, _joint_model(joint), placement, joint.name, most, most, -most, most)
        frame = model.addJointFrame(index, carrier)
        model.appendBodyToJoint(index, inertia_of(link), pin.SE3.Identity())
        return int(model.addBodyFrame(link.name, index, pin.SE3.Identity(), frame))

    def _write_joint(self, root: Element, joint: Joint) -> None:
        """Write a joint."""
        moves = self._moves(joint)
        # A continuous joint as one unbounded angle instead of Pinocchio's (cos, sin), so that nq = nv.
        kind = "prismatic" if joint.type == "prismatic" else "revolute"
        element = SubElement(root, "joint", name=joint.name, type=kind if moves else "fixed")
        SubElement(element, "parent", link=joint.parent)
        SubElement(element, "child", link=joint.child)
        xyz, rpy = self._pose(joint)
        SubElement(element, "origin", xyz=join(xyz), rpy=join(rpy))
        if moves:
            SubElement(element, "axis", xyz=join(joint.direction.tolist()))
            SubElement(element, "limit", _UNBOUNDED)


def join(numbers: Iterable[float]) -> str:
    """Join numbers as URDF attributes want them, to the last digit."""
    return " ".join(repr(float(number)) for number in numbers)


def _write_inertial(element: Element, link: Link) -> None:
    """Write the mass properties of a link."""
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "origin", xyz=join(link.xyz), rpy=join(link.rpy))
    SubElement(inertial, "mass", value=repr(link.mass))
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    SubElement(inertial, "inertia", dict(zip(keys, map(repr, link.inertia), strict=True)))


def _joint_model(joint: Joint) -> Any:
    """Return Pinocchio's joint about, or along, an axis."""
    kind, axis = "Prismatic" if joint.type == "prismatic" else "Revolute", joint.direction
    for letter, unit in zip("XYZ", np.eye(3), strict=True):
        if np.linalg.norm(axis - unit) <= _ALIGNED:
            return getattr(pin, f"JointModel{kind[0]}{letter}")()
    return getattr(pin, f"JointModel{kind}Unaligned")(axis)


def _rotation(rpy: Sequence[float]) -> Array:
    """Return the rotation of roll, pitch and yaw, by the quaternion that urdfdom makes of them."""
    roll, pitch, yaw = (0.5 * angle for angle in rpy)
    sr, sp, sy = math.sin(roll), math.sin(pitch), math.sin(yaw)
    cr, cp, cy = math.cos(roll), math.cos(pitch), math.cos(yaw)
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    w = cr * cp * cy + sr * sp * sy
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    rotation: Array = pin.Quaternion(w / norm, x / norm, y / norm, z / norm).matrix()
    return rotation


def inertia_of(link: Link) -> Any:
    """Return the `pin.Inertia` of a link in its frame; zero where the file has none."""
    inertia = pin.Inertia.Zero()
    if link.inertial:
        rotation = _rotation(link.rpy)
        inertia.mass, inertia.lever = link.mass, np.array(link.xyz)
        turned = _product(_product(rotation, tensors.as_matrix(link.inertia)), rotation.T)
        lower = np.tril(turned)  # which Pinocchio's constructor takes; rounding has made the upper another
        # That constructor would refuse a tensor that was accepted though it is not positive.
        inertia.inertia = lower + np.tril(lower, -1).T
    return inertia


def _product(left: Array, right: Array) -> Array:
    """Return a product of two matrices (3, 3), summed as Eigen does, where BLAS would round otherwise."""
    first, second, third = (left[:, k, None] * right[None, k, :] for k in range(3))
    return np.asarray(first + second + third)
