"""Links and joints of a URDF, and the two walks over them: down the tree, and along chains of mimics."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array

MOVING_TYPES = ("revolute", "continuous", "prismatic")
#: Types with more than one coordinate: to be locked, or refused.
MULTI_DOF_TYPES = ("floating", "planar")


@dataclass(frozen=True)
class Joint:
    """One URDF joint as written in the file.

    Attributes:
        name: its name.
        type: its URDF type ("revolute", "continuous", "prismatic", "fixed", "floating" or "planar").
        parent: name of the link that carries it.
        child: name of the link that it carries.
        xyz: its position on its parent [m].
        rpy: its orientation there [rad].
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
    axis: tuple[float, ...] = (1.0, 0.0, 0.0)
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    damping: float = 0.0
    friction: float = 0.0
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
        rpy: orientation of the axes of its inertia [rad].
        inertia: ixx, ixy, ixz, iyy, iyz, izz about the centre of mass, in those axes [kg m^2].
        inertial: whether the file has an <inertial> for it.
        meshes: file names of its meshes as written, without repetition.
        missing: "mass" or "inertia" when its <inertial> lacks that element, which then is 0; else empty.
    """

    name: str
    mass: float
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    inertia: tuple[float, ...]
    inertial: bool
    meshes: tuple[str, ...]
    missing: str = ""

    def moments(self) -> Array:
        """Return the principal moments of its inertia [kg m^2], ascending, shape (3,)."""
        xx, xy, xz, yy, yz, zz = self.inertia
        moments: Array = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        return moments


class Leader(NamedTuple):
    """What a joint follows in the end: q = ratio * q_leader + offset.

    Attributes:
        joint: the leader; the joint itself when it follows none.
        ratio: product of the multipliers on the way.
        offset: of the follower where the leader is at 0 [rad or m].
    """

    joint: Joint
    ratio: float
    offset: float


def topological_order(joints: Mapping[str, Joint], base: str) -> list[Joint]:
    """Return the joints that hang on the link `base`, each after the one that carries it."""
    carried: dict[str, list[Joint]] = {}
    for joint in joints.values():
        carried.setdefault(joint.parent, []).append(joint)
    order: list[Joint] = []
    front, seen = [base], {base}
    while front:
        below = carried.get(front.pop(), [])
        order += below
        front += [joint.child for joint in below if joint.child not in seen]
        seen.update(joint.child for joint in below)
    return order


def moved_links(joints: Mapping[str, Joint], base: str, locked: Iterable[str] = ()) -> frozenset[str]:
    """Return the links that some joint moves, when the `locked` ones do not."""
    still = set(locked)
    moved: set[str] = set()
    for joint in topological_order(joints, base):
        if joint.parent in moved or (joint.type != "fixed" and joint.name not in still):
            moved.add(joint.child)
    return frozenset(moved)


def mimic_chain(joints: Mapping[str, Joint], name: str, held: Container[str] = ()) -> list[Joint]:
    """Return a joint, the one that it mimics, the one which that mimics, and so on.

    The chain ends at a joint that mimics none, that mimics one which does not exist, or that is `held`;
    a cycle ends before it closes.
    """
    chain = [joints[name]]
    names = {name}
    while (leader := chain[-1].mimic) in joints and leader not in names and chain[-1].name not in held:
        chain.append(joints[str(leader)])
        names.add(str(leader))
    return chain


def mimic_leader(joints: Mapping[str, Joint], name: str, held: Container[str] = ()) -> Leader:
    """Return what a joint follows in the end; joints that are `held` follow none."""
    *followers, leader = mimic_chain(joints, name, held)
    ratio, offset = 1.0, 0.0
    for joint in followers:
        offset += ratio * joint.mimic_offset
        ratio *= joint.mimic_multiplier
    return Leader(leader, ratio, offset)
