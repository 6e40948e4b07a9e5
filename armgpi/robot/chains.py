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
    still = {*locked, *fingers}
    independent = [joint for joint in urdf.joints.values() if joint.moves and joint.mimic is None]
    moving = [joint for joint in independent if joint.name not in still]
    carrying = {joint.child: joint for joint in urdf.joints.values()}  # link -> the joint that carries it
    moving_names = {joint.name for joint in moving}

    def moving_joint_above(link: str) -> str | None:
        """Return the moving joint that carries a link; None for what stands still on the base."""
        while link in carrying:
            joint = carrying[link]
            if joint.name in moving_names:
                return joint.name
            link = joint.parent
        return None

    parents = {joint.name: moving_joint_above(joint.parent) for joint in moving}
    children = Counter(parents.values())  # how many joints each carries
    named: list[tuple[str, str, tuple[str, ...]]] = []  # what names say, last link, joints
    for end in moving:
        if children[end.name]:
            continue
        joints = [end.name]
        # Up to the base, or to a joint at which the robot branches.
        while True:
            parent = parents[joints[0]]
            if parent is None or children[parent] > 1:
                break
            joints.insert(0, parent)
        named.append((_name(joints), end.child, tuple(joints)))
    counts = Counter(name for name, _, _ in named)
    counts[""] = 0  # names that say nothing are no name
    return tuple(
        Chain(name if counts[name] == 1 else last_link, chain_joints)
        for name, last_link, chain_joints in named
    )


def of(provenance: Mapping[str, Any]) -> tuple[Chain, ...]:
    """Return the chains of a loaded robot, by its provenance, where several move, else none."""
    return tuple(Chain(name, tuple(joints)) for name, joints in provenance.get("chains", {}).items())


def expand(urdf: Urdf, keep: Sequence[str] | None) -> Sequence[str] | None:
    """Return names of joints to keep, those of chains replaced by their joints' names; all else as it is.

    A joint that has the name of a chain counts as the joint. What is no list of texts, or names neither, is
    left to whoever checks it.
    """
    if not isinstance(keep, list | tuple) or not all(isinstance(name, str) for name in keep):
        return keep
    if all(name in urdf.joints for name in keep):
        return keep
    joints_of = {chain.name: chain.joints for chain in find(urdf)}
    expanded: list[str] = []
    for name in keep:
        if name in urdf.joints:
            expanded.append(name)
        else:
            expanded += joints_of.get(name, (name,))
    return expanded


def describe(chains: Sequence[Chain]) -> str:
    """Return in words which chains there are."""
    listed = ", ".join(f"{name} ({len(joints)})" for name, joints in chains)
    return f"this robot has {len(chains)} chains: {listed}"


def first_arm(chains: Sequence[Chain]) -> Chain:
    """Return the chain that is most likely meant: the longest of the arms, else the longest of all."""
    return max(chains, key=lambda chain: ("arm" in chain.name, len(chain.joints)))


def _name(joints: Sequence[str]) -> str:
    """Return what the names of joints say that they are together: side and kind, such as "left_arm".

    The kind is that of most joints whose names say one, the side one that the names of all have. Empty where
    no name says a kind.
    """
    # leftShoulder-pitch2 -> left_shoulder_pitch_
    words = [re.sub(r"(?<=[a-z])(?=[A-Z])|[^A-Za-z]+", "_", joint).lower() for joint in joints]
    kinds: Counter[str] = Counter()
    for word in words:
        for kind, pattern in _KINDS.items():
            if re.search(pattern, word):
                kinds[kind] += 1
                break
    if not kinds:
        return ""
    ((kind, _),) = kinds.most_common(1)
    for side, pattern in _SIDES.items():
        if all(re.search(pattern, word) for word in words):
            return f"{side}_{kind}"
    return kind
