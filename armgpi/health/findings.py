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
    found = []
    for each in CHECKS:
        if each.function is not None and (kinds is None or each.kind in kinds):
            found += [finding._replace(kind=each.kind) for finding in each.function(subject)]
    return found


def fold(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings for readers: what holds of several joints or links once, with their names.

    Numbers that differ between them become ranges, of names the first are left. Of one kind and level the
    first few are left.
    """
    alike: dict[tuple[Any, ...], list[Finding]] = {}
    for each in findings:
        template = _TOKEN.sub("#", each.message)
        named = _NAMED.fullmatch(each.where)
        where = each.where if named is None else named[1]
        kinds = tuple((remedy.kind, type(remedy.value)) for remedy in each.remedies)
        alike.setdefault((each.level, each.kind, where, template, each.repair, kinds), []).append(each)
    kept: list[Finding] = []
    counts: Counter[tuple[Level, str]] = Counter()
    for group in alike.values():
        counts[group[0].level, group[0].kind] += 1
        if counts[group[0].level, group[0].kind] <= _LISTED:
            kept.append(group[0] if len(group) == 1 else _merge(group))
    for (level, kind), count in counts.items():
        if count > _LISTED:
            kept.append(Finding(level, "others", f"{count - _LISTED} more of this kind", kind=kind))
    return sorted(kept, key=lambda finding: LEVELS.index(finding.level))


def _merge(group: list[Finding]) -> Finding:
    """Return one finding for several whose messages differ in numbers and names alone."""
    first = group[0]
    names = [*dict.fromkeys(each.where.partition(" ")[2] for each in group)]
    listed = ", ".join(names[:_LISTED]) + f" and {len(names) - _LISTED} more" * (len(names) > _LISTED)
    tokens = ([token[0] for token in _TOKEN.finditer(each.message)] for each in group)
    columns = iter([list(dict.fromkeys(column)) for column in zip(*tokens, strict=True)])

    def as_range(_: re.Match[str]) -> str:
        values: list[str] = next(columns)
        if len(values) == 1 or values[0].startswith("'"):
            return values[0] + ", ..." * (len(values) > 1)
        return f"{min(values, key=float)} to {max(values, key=float)}"

    where = f"each of {first.where.partition(' ')[0]}s {listed}" if len(names) > 1 else first.where
    remedies = tuple(map(_join, zip(*(each.remedies for each in group), strict=True)))
    return first._replace(where=where, message=_TOKEN.sub(as_range, first.message), remedies=remedies)


def _join(remedies: tuple[Remedy, ...]) -> Remedy:
    """Return one remedy for joints that have one each; of values that are no joint's, the least."""
    first = remedies[0]
    if not first.joints and isinstance(first.value, str):
        return first._replace(value=",".join(dict.fromkeys(str(each.value) for each in remedies)))
    if not first.joints:
        return min(remedies, key=lambda each: each.value if isinstance(each.value, float) else 0.0)
    joints = tuple(dict.fromkeys(joint for remedy in remedies for joint in remedy.joints))
    values = {remedy.value for remedy in remedies}
    if len(values) == 1:
        return first._replace(joints=joints)
    each = (f"{joint}={remedy.value:g}" for remedy in remedies for joint in remedy.joints)
    return Remedy(first.kind, (), ",".join(each))


def table() -> str:
    """Return the kinds of findings as a Markdown table, sorted by kind and level."""
    registry.load_plugins()
    rows = sorted(CHECKS, key=lambda row: (row.kind, min(map(LEVELS.index, row.levels))))
    lines = [f"| `{row.kind}` | {', '.join(row.levels)} | {row.meaning} |" for row in rows]
    return "\n".join(["| kind | level | what it means |", "|---|---|---|", *lines]) + "\n"
