"""Chains of a whole robot: arms, legs, a head, wheels, of which a controller for an arm runs one."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

from armgpi.robot import grippers
from armgpi.robot.urdf import Urdf

#: What the words in names of joints and links say a chain is, the first that fits; as makers of humanoids,
#: quadrupeds and mobile bases have them (example-robot-data, robot_descriptions).
_KINDS = {
    "wheel": r"wheel|caster|castor",
    "leg": r"leg(?![a-z])|hip|knee|ankle|foot|thigh|calf|haa|hfe|kfe",
    "arm": r"(?<![a-z])arm|shoulder|elbow|wrist|gripper|hand",
    "head": r"head|neck|camera|gaze|eye",
    "torso": r"torso|waist|spine|chest",
}
_SIDES = {
    "front_left": r"(^|_)(fl|lf)(_|$)",
    "front_right": r"(^|_)(fr|rf)(_|$)",
    "rear_left": r"(^|_)([rhb]l|l[rhb])(_|$)",
    "rear_right": r"(^|_)([rhb]r|r[rhb])(_|$)",
    "left": r"left|(^|_)l(_|$)",
    "right": r"right|(^|_)r(_|$)",
}


class Chain(NamedTuple):
    """Joints one after the other, from where the robot branches to an end.

    Attributes:
        name: such as "left_arm"; the name of its last link where names say less, or several say the same.
        joints: names, from the base.
    """

    name: str
    joints: tuple[str, ...]


def find(urdf: Urdf, locked: Collection[str] = ()) -> tuple[Chain, ...]:
    """Return the chains that the joints of `urdf` form that are not `locked`, in the order of their ends.

    Grippers are no chains: what carries one is the end of its arm.

    Args:
        urdf: the robot.
        locked: names of joints that do not move.
    """
    fingers = [joint for gripper in grippers.find(urdf, locked) for joint in gripper.joints]
    return of_arms(urdf, locked, fingers)


def of_arms(urdf: Urdf, locked: Collection[str], fingers: Collection[str]) -> tuple[Chain, ...]:
    """Return the chains as :func:`find`, where it is known which joints are fingers."""
    moving = [
        j for j in urdf.joints.values() if j.moves and j.mimic is None and j.name not in {*locked, *fingers}
    ]
    carried = {joint.child: joint for joint in urdf.joints.values()}
    names = {joint.name for joint in moving}

    def above(link: str) -> str | None:
        """Return the moving joint that carries a link."""
        while link in carried and carried[link].name not in names:
            link = carried[link].parent
        return carried[link].name if link in carried else None

    parents = {joint.name: above(joint.parent) for joint in moving}
    branches = Counter(parents.values())
    found = []
    for end in (joint for joint in moving if not branches[joint.name]):
        joints = [end.name]
        while (parent := parents[joints[0]]) is not None and branches[parent] == 1:
            joints.insert(0, parent)
        found.append((_name(joints), end.child, tuple(joints)))
    common = Counter(name for name, _, _ in found)
    return tuple(Chain(name if name and common[name] == 1 else link, joints) for name, link, joints in found)


def of(provenance: Mapping[str, Any]) -> tuple[Chain, ...]:
    """Return the chains of a loaded robot, by its provenance, where several move, else none."""
    return tuple(Chain(name, tuple(joints)) for name, joints in provenance.get("chains", {}).items())


def expand(urdf: Urdf, keep: Sequence[str] | None) -> Sequence[str] | None:
    """Return names of joints to keep, those of chains replaced by their joints' names; all else as it is."""
    if not isinstance(keep, list | tuple) or not all(isinstance(name, str) for name in keep):
        return keep
    if all(name in urdf.joints for name in keep):
        return keep
    joints = {chain.name: chain.joints for chain in find(urdf)} | {name: (name,) for name in urdf.joints}
    return [joint for name in keep for joint in joints.get(name, (name,))]


def describe(chains: Sequence[Chain]) -> str:
    """Return in words which chains there are."""
    listed = ", ".join(f"{name} ({len(joints)})" for name, joints in chains)
    return f"this robot has {len(chains)} chains: {listed}"


def first_arm(chains: Sequence[Chain]) -> Chain:
    """Return the chain that is most likely meant: the longest of the arms, else the longest of all."""
    return max(chains, key=lambda chain: ("arm" in chain.name, len(chain.joints)))


def _name(joints: Sequence[str]) -> str:
    """Return what the names of joints say that they are together."""
    words = [re.sub(r"(?<=[a-z])(?=[A-Z])|[^A-Za-z]+", "_", joint).lower() for joint in joints]
    kinds = Counter(
        next((kind for kind, pattern in _KINDS.items() if re.search(pattern, word)), "") for word in words
    )
    del kinds[""]
    if not kinds:
        return ""
    sides = (side for side, pattern in _SIDES.items() if all(re.search(pattern, word) for word in words))
    return "_".join(filter(None, (next(sides, ""), kinds.most_common(1)[0][0])))
