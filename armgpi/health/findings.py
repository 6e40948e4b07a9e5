"""Findings about a robot's model, and the registry of the checks that make them.

A check is a function with a decorator, in a module that :mod:`armgpi.health.report` imports or in a plugin
(:mod:`armgpi.registry`). It is given the :class:`Subject` and gives findings; the report, its JSON and the
table of docs/robots.md follow from the registry::

    @check("reach", "an arm longer than 5 m", "warning")
    def too_long(subject: Subject) -> Iterator[Finding]:
        if subject.reach > 5.0:
            yield Finding("warning", "robot", f"reaches {subject.reach:g} m", subject.reach, 5.0)
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from armgpi import registry
from armgpi.base.arrays import Array
from armgpi.errors import Finding as Finding
from armgpi.errors import Level as Level
from armgpi.errors import Remedy
from armgpi.gpi.margins import default_omega
from armgpi.robot import rotors
from armgpi.robot.meshes import MeshFinder
from armgpi.robot.robot import Robot
from armgpi.robot.robots import is_textbook
from armgpi.robot.tree import Joint
from armgpi.robot.urdf import Urdf

LEVELS: tuple[Level, ...] = ("error", "warning", "info")
#: Random configurations at which gravity and inertia are computed, besides the middle of the ranges.
_SAMPLES = 500
#: Findings of one kind that are listed one by one.
_LISTED = 5
#: A name in quotes or a number, of a message, none in a path; and a place that has a name.
_TOKEN = re.compile(r"'[^']*'|(?<![\w/])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w/])")
_NAMED = re.compile(r"(joint|link) '.*'")


@dataclass(frozen=True)
class Subject:
    """What a check is given: the URDF as written, the robot as loaded, and the controller's timing.

    Attributes:
        document: the URDF, read and checked.
        robot: the robot, with its joints locked and its efforts replaced.
        finder: finds meshes.
        dt: sample time of the controller [s].
        delay: samples by which measurements are late.
        encoder_bits: resolution of the position sensors.
    """

    document: Urdf
    robot: Robot
    finder: MeshFinder
    dt: float
    delay: int
    encoder_bits: int

    @cached_property
    def q(self) -> Array:
        """Configurations: the middle of the ranges, then random ones [rad or m], shape (501, n)."""
        return np.vstack([self.robot.middle(), self.robot.random_positions(_SAMPLES, seed=1)])

    @cached_property
    def gravity(self) -> Array:
        """G(q) at these configurations [N m or N], shape (501, n)."""
        return self.robot.dynamics.gravity(self.q)

    @cached_property
    def inertia(self) -> Array:
        """D(q) at these configurations, shape (501, n, n)."""
        return self.robot.dynamics.mass_matrix(self.q)

    @cached_property
    def run_inertia(self) -> Array:
        """D(q) at these configurations of the arm that is run: with the rotor inertia that is assumed."""
        if is_textbook(self.robot.name):
            return self.inertia
        return rotors.assume_rotors(self.robot).dynamics.mass_matrix(self.q)

    @cached_property
    def eigenvalues(self) -> Array:
        """Eigenvalues of D(q), ascending, shape (501, n)."""
        return np.asarray(np.linalg.eigvalsh(self.inertia), dtype=np.float64)

    @cached_property
    def reach(self) -> float:
        """Largest distance of the tip from the first joint at these configurations [m]."""
        first = self.robot.frame_pose(self.robot.joint_names[0], self.q[0]).translation
        tip = self.robot.frame_pose(self.robot.tip, self.q).translation
        return float(np.linalg.norm(tip - first, axis=-1).max())

    @property
    def omega(self) -> float:
        """Default bandwidth of a controller [rad/s]."""
        return default_omega(self.dt, self.delay * self.dt)

    @property
    def locked(self) -> Mapping[str, float]:
        """Value of every locked joint [rad or m]."""
        locked: Mapping[str, float] = self.robot.provenance["locked"]
        return locked

    @cached_property
    def moved(self) -> frozenset[str]:
        """Links that some joint moves."""
        return self.document.moved_links(self.locked)

    @cached_property
    def free(self) -> tuple[Joint, ...]:
        """The URDF joints of the robot's coordinates."""
        return tuple(self.document.joints[name] for name in self.robot.joint_names)

    @cached_property
    def elements(self) -> Mapping[str, Element]:
        """Name of a joint -> its XML."""
        return {element.get("name", ""): element for element in self.document.root.findall("joint")}


Function = Callable[[Subject], Iterator[Finding]]


class Check(NamedTuple):
    """A kind of finding.

    Attributes:
        kind: its short name.
        meaning: what it means, in a sentence (Markdown).
        levels: the levels that its findings have.
        function: what finds it; None for what is found elsewhere.
    """

    kind: str
    meaning: str
    levels: tuple[Level, ...]
    function: Function | None = None


#: Every check; several may have one kind.
CHECKS: list[Check] = [
    Check("payload", "the motors cannot hold the payload of `--payload` at all configurations", ("warning",)),
    Check(
        "payload",
        "an unknown load of 5 % of the arm's mass at the tip takes delta below 0.5, with the nominal load of "
        "`gpi_auto` (warning) or without one (info)",
        ("warning", "info"),
    ),
    Check("cross-check", "yourdfpy reads another robot", ("error",)),
    Check("cross-check", "yourdfpy cannot read the file", ("warning",)),
]


def check(kind: str, meaning: str, *levels: Level) -> Callable[[Function], Function]:
    """Register a function that gives findings of one kind.

    Args:
        kind: name of the check.
        meaning: what it finds, in words.
        *levels: those that its findings may have, such as "warning".
    """

    def register(function: Function) -> Function:
        CHECKS.append(Check(kind, meaning, levels, function))
        return function

    return register


def find(subject: Subject, kinds: Container[str] | None = None) -> list[Finding]:
    """Return what all checks find, or those of some kinds alone."""
    registry.load_plugins()
    findings: list[Finding] = []
    for check_of_kind in CHECKS:
        kind, function = check_of_kind.kind, check_of_kind.function
        if function is not None and (kinds is None or kind in kinds):
            findings += [finding._replace(kind=kind) for finding in function(subject)]
    return findings


def fold(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings for readers: what holds of several joints or links once, with their names.

    Numbers that differ between them become ranges, of names the first are left. Of one kind and level the
    first few are left.
    """
    alike: dict[tuple[Any, ...], list[Finding]] = {}
    for finding in findings:
        template = _TOKEN.sub("#", finding.message)
        named = _NAMED.fullmatch(finding.where)
        where = finding.where if named is None else named[1]
        kinds = tuple((remedy.kind, type(remedy.value)) for remedy in finding.remedies)
        key = (finding.level, finding.kind, where, template, finding.repair, kinds)
        alike.setdefault(key, []).append(finding)
    folded: list[Finding] = []
    counts: Counter[tuple[Level, str]] = Counter()
    for group in alike.values():
        first = group[0]
        counts[first.level, first.kind] += 1
        if counts[first.level, first.kind] <= _LISTED:
            folded.append(first if len(group) == 1 else _merge(group))
    for (level, kind), count in counts.items():
        if count > _LISTED:
            more = f"{count - _LISTED} more of this kind"
            folded.append(Finding(level, "others", more, kind=kind))
    return sorted(folded, key=lambda finding: LEVELS.index(finding.level))


def _merge(group: list[Finding]) -> Finding:
    """Return one finding for several whose messages differ in numbers and names alone."""
    first = group[0]
    names = [*dict.fromkeys(finding.where.partition(" ")[2] for finding in group)]
    listed = ", ".join(names[:_LISTED])
    if len(names) > _LISTED:
        listed += f" and {len(names) - _LISTED} more"
    # Of each name or number of the message, the different ones of the group.
    tokens = [_TOKEN.findall(finding.message) for finding in group]
    columns = iter([list(dict.fromkeys(column)) for column in zip(*tokens, strict=True)])

    def as_range(_: re.Match[str]) -> str:
        values: list[str] = next(columns)
        if len(values) == 1:
            return values[0]
        if values[0].startswith("'"):
            return f"{values[0]}, ..."
        return f"{min(values, key=float)} to {max(values, key=float)}"

    where = first.where
    if len(names) > 1:
        kind, _, _ = where.partition(" ")
        where = f"each of {kind}s {listed}"
    message = _TOKEN.sub(as_range, first.message)
    remedies_of = [finding.remedies for finding in group]
    remedies = tuple(map(_join, zip(*remedies_of, strict=True)))
    return first._replace(where=where, message=message, remedies=remedies)


def _join(remedies: tuple[Remedy, ...]) -> Remedy:
    """Return one remedy for joints that have one each; of values that are no joint's, the least."""
    first = remedies[0]
    if not first.joints and isinstance(first.value, str):
        texts = dict.fromkeys(str(remedy.value) for remedy in remedies)
        return first._replace(value=",".join(texts))
    if not first.joints:
        return min(remedies, key=lambda remedy: remedy.value if isinstance(remedy.value, float) else 0.0)
    joints: dict[str, None] = {}
    assignments = []
    values = {remedy.value for remedy in remedies}
    for remedy in remedies:
        joints |= dict.fromkeys(remedy.joints)
        if len(values) > 1:
            assignments += [f"{joint}={remedy.value:g}" for joint in remedy.joints]
    if len(values) == 1:
        return first._replace(joints=tuple(joints))
    return Remedy(first.kind, (), ",".join(assignments))


def table() -> str:
    """Return the kinds of findings as a Markdown table, sorted by kind and level."""
    registry.load_plugins()
    rows = sorted(CHECKS, key=lambda row: (row.kind, min(map(LEVELS.index, row.levels))))
    lines = [f"| `{row.kind}` | {', '.join(row.levels)} | {row.meaning} |" for row in rows]
    return "\n".join(["| kind | level | what it means |", "|---|---|---|", *lines]) + "\n"
