"""Grippers and hands, recognised by what they are: what moves at the end of an arm and is no part of it.

A controller for the arm wants their joints locked. They are proposed, never locked unasked: what looks
like a finger may be meant to move.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from armgpi.robot import tree
from armgpi.robot.tree import Joint
from armgpi.robot.urdf import Urdf

#: An arm has at least so many joints before its gripper.
_ARM = 2
#: A finger has at most so many joints one after the other, and fewer than the arm before it.
_FINGER = 8
#: A single sliding joint is a finger behind so many joints.
_SLIDE_BEHIND = 4
#: A single sliding joint is a finger with at most so much travel [m].
_SLIDE_TRAVEL = 0.1
#: A single turning joint is a finger with less travel than this [rad], which no wrist has.
_TURN_TRAVEL = 3.2
_NAMES = re.compile(r"grip|finger|jaw|claw|thumb|knuckle|pincer|hand(?!le)|pinch", re.IGNORECASE)
#: What names a joint of the arm itself, also where it carries a gripper.
_ARM_NAMES = re.compile(r"yaw|pitch|roll|wrist|shoulder|elbow|arm", re.IGNORECASE)
_TIPS = re.compile(r"tcp|tool|(^|_)eef?(_|$)|end.?effector|grasp|pinch", re.IGNORECASE)


class Gripper(NamedTuple):
    """Joints at the end of an arm that look like a gripper or hand.

    Attributes:
        joints: their names, in the order of the file.
        after: name of the arm's last joint before them.
        reason: what they look like one by.
    """

    joints: tuple[str, ...]
    after: str
    reason: str


class _Node:
    """A moving joint among moving joints."""

    def __init__(self, joint: Joint, parent: _Node | None) -> None:
        self.joint, self.parent = joint, parent
        self.children: list[_Node] = []
        #: Leaves of the tree of links that hang on its child by fixed joints.
        self.tips: list[str] = []
        #: Names of the joints before it, from the base.
        self.above: tuple[str, ...] = () if parent is None else (*parent.above, parent.joint.name)
        if parent is not None:
            parent.children.append(self)

    def below(self) -> Iterator[_Node]:
        """Give the node and all under it."""
        front = [self]
        while front:
            node = front.pop()
            yield node
            front.extend(node.children)

    def height(self) -> int:
        """Return how many joints there are one after the other, itself included."""
        return max(len(node.above) for node in self.below()) - len(self.above) + 1


def find(urdf: Urdf, locked: Collection[str] = ()) -> tuple[Gripper, ...]:
    """Return the grippers among the joints of `urdf` that are not `locked`, in the order of the file.

    All that hangs on one joint of the arm is one gripper: two hands on one link are proposed together. A
    gripper without an arm before it is none, as it is the whole robot. What is found by branches counts
    before mimics, and these before single joints.

    Args:
        urdf: the robot.
        locked: names of joints that do not move.
    """
    nodes = _tree(urdf, locked)
    tops = [*_branches(nodes), *_mimic_groups(nodes)]  # first joints of grippers, and why they are
    for node in nodes.values():
        reason = _single(node)
        if reason is not None:
            tops.append((node, reason))
    belongs: dict[str, tuple[str, str]] = {}  # joint -> joint before its gripper, and why it is one
    for top, reason in tops:
        if top.parent is not None:
            for node in top.below():
                belongs.setdefault(node.joint.name, (top.parent.joint.name, reason))
    joints_after: dict[str, list[str]] = {}
    reasons: dict[str, str] = {}
    for name in urdf.joints:
        if name in belongs:
            after, reason = belongs[name]
            joints_after.setdefault(after, []).append(name)
            reasons.setdefault(after, reason)
    return tuple(Gripper(tuple(joints), after, reasons[after]) for after, joints in joints_after.items())


def moving(robot: Any) -> list[str]:
    """Return the joints of a loaded robot that look like a gripper's and move with its arm.

    They were found when it was loaded, and are not asked for again.
    """
    return [joint for joint in robot.provenance.get("grippers", ()) if joint in robot.joint_names]


def _tree(urdf: Urdf, locked: Collection[str]) -> dict[str, _Node]:
    """Return a node for every moving joint, parents first."""
    order = tree.topological_order(urdf.joints, urdf.base)
    carriers = {joint.parent for joint in order}
    nodes: dict[str, _Node] = {}
    carrying: dict[str, _Node | None] = {urdf.base: None}  # link -> the moving joint that carries it
    for joint in order:
        node = carrying[joint.child] = carrying[joint.parent]
        if joint.moves and joint.name not in locked:
            nodes[joint.name] = carrying[joint.child] = _Node(joint, node)
        elif node is not None and joint.child not in carriers:
            node.tips.append(joint.child)
    return nodes


def _branches(nodes: dict[str, _Node]) -> Iterator[tuple[_Node, str]]:
    """Give the first joints of fingers that branch off at the end of an arm."""
    for node in nodes.values():
        if len(node.above) + 1 >= _ARM and len(node.children) > 1:
            heights = [child.height() for child in node.children]
            if max(heights) <= min(_FINGER, len(node.above)):
                for child in node.children:
                    yield child, f"{len(heights)} fingers branch off there"


def _mimic_groups(nodes: dict[str, _Node]) -> Iterator[tuple[_Node, str]]:
    """Give the uppermost joints of mimics that move together, where they end an arm in several branches."""
    groups: dict[str, list[_Node]] = {}
    for node in nodes.values():
        if node.joint.mimic is not None:
            groups.setdefault(node.joint.mimic, []).append(node)
    for leader, followers in groups.items():
        leader_moves = leader in nodes
        group = [nodes[leader], *followers] if leader_moves else followers
        names = {node.joint.name for node in group}
        tops = [node for node in group if names.isdisjoint(node.above)]
        is_behind_an_arm = min(len(node.above) for node in tops) >= _ARM
        # One after the other they may as well be an arm whose joints are coupled.
        is_branched = len(tops) > 1 or not leader_moves
        if is_behind_an_arm and is_branched and all(_only_mimics(top, names) for top in tops):
            for top in tops:
                yield top, "they move together as mimic joints"


def _only_mimics(top: _Node, group: Collection[str]) -> bool:
    """Tell whether a joint and all that hangs on it are of a group of joints, or mimic another joint."""
    return all(node.joint.name in group or node.joint.mimic is not None for node in top.below())


def _single(node: _Node) -> str | None:
    """Return why a joint alone, with what hangs on it, is a gripper; None when it is not one."""
    has_siblings = node.parent is not None and len(node.parent.children) > 1
    if len(node.above) < _ARM or node.height() > _FINGER or has_siblings:
        return None
    joint = node.joint
    is_named_so = _NAMES.search(f"{joint.name} {joint.child}") and not _ARM_NAMES.search(joint.name)
    # Where the joints before it have such names too, the whole robot is a finger.
    if is_named_so and not any(map(_NAMES.search, node.above)):
        return "they are named like one" if node.children else "it is named like one"
    if node.children:
        return None
    return _by_its_motion(node)


def _by_its_motion(node: _Node) -> str | None:
    """Return why the last joint of an arm is a gripper by how it moves; None when it is not one."""
    joint = node.joint
    travel = joint.upper - joint.lower
    is_far_out = len(node.above) >= _SLIDE_BEHIND
    if joint.type == "prismatic" and is_far_out and travel <= _SLIDE_TRAVEL:
        return f"it slides by {travel:g} m at the end"
    if joint.type != "revolute" or travel >= _TURN_TRAVEL or node.parent is None:
        return None
    if any(map(_TIPS.search, node.parent.tips)):
        return "it closes next to the frame of a tool"
    return None
