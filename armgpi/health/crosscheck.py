"""A second opinion on a URDF: yourdfpy reads it too, and both must find the same kinematics.

Joint axes, limits and mimics are compared as read, and the pose of every link at random configurations.
yourdfpy parses by itself (lxml and NumPy, no urdfdom, no Pinocchio). It is no gate: it repairs broken XML
and passes masses that no body has.
"""

from __future__ import annotations

import io
import logging
import math
import re
from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ArmgpiError, import_extra
from armgpi.health.findings import Finding
from armgpi.health.report import HealthReport
from armgpi.robot import from_mujoco, repairs, tree, urdf
from armgpi.robot.robot import Robot

#: Of products of some ten rotations and lengths below 10 m; yourdfpy's rotations are good to 1e-15.
_ROUNDING = 1e-9
#: Random configurations, fewer where a robot of very many links would take seconds.
_CONFIGURATIONS, _MOST_POSES = 20, 5_000


class CrossCheckUnavailable(ArmgpiError):
    """A URDF that yourdfpy cannot read, which does not make it a bad one."""


class CrossCheck(NamedTuple):
    """What the second reader finds otherwise.

    Attributes:
        links: number of links whose poses were compared.
        configurations: number of random configurations.
        position: largest distance between the two readers' link origins [m].
        rotation: largest difference between elements of their rotation matrices.
        differences: what differs, one line each; empty when the two agree.
        reader: the second reader: yourdfpy, of an MJCF MuJoCo.
    """

    links: int
    configurations: int
    position: float
    rotation: float
    differences: tuple[str, ...]
    reader: str = "yourdfpy"


def cross_check(robot: Robot) -> CrossCheck:
    """Read the file of a robot a second time, a URDF with yourdfpy, an MJCF with MuJoCo, and compare.

    Args:
        robot: a robot loaded from a file, whose file has not changed since.

    Raises:
        CrossCheckUnavailable: when yourdfpy cannot read the file.
        MissingPackage: when yourdfpy is not installed.
        ArmgpiError: when the robot has no file, or another one by now.
    """
    source = robot.provenance["source"]
    text = urdf.read_file(Path(source))
    if from_mujoco.is_mjcf(text):
        document = from_mujoco.read(Path(source), text)
        _check_unchanged(document, robot)
        return _of_poses(document, robot, partial(from_mujoco.poses, document), "MuJoCo")
    yourdfpy = import_extra("yourdfpy", "check")
    document = urdf.parse(text, source, repairs.made_in(robot.provenance))
    _check_unchanged(document, robot)
    other = _read(yourdfpy, text)
    differences = [
        *_of_names("link", document.links, other.link_map),
        *_of_names("joint", document.joints, other.joint_map),
    ]
    for joint in document.joints.values():
        differences += _of_joint(joint, other)
    if differences:
        return CrossCheck(0, 0, float("nan"), float("nan"), tuple(differences))
    return _of_poses(document, robot, partial(_their_poses, document, other), "yourdfpy")


def _of_names(kind: str, ours: Collection[str], theirs: Collection[str]) -> list[str]:
    """Return the names that only one of the readers finds, a sentence each."""
    lines = [f"{kind} {name!r} is found by us alone" for name in ours if name not in theirs]
    lines += [f"{kind} {name!r} is found by yourdfpy alone" for name in theirs if name not in ours]
    return lines


def _check_unchanged(document: urdf.Urdf, robot: Robot) -> None:
    """Refuse a file that is another one by now."""
    if document.sha256 != robot.provenance["sha256"]:
        raise ArmgpiError(f"{document.source}: has changed since the robot was loaded; load it again")


def with_cross_check(report: HealthReport) -> HealthReport:
    """Return a report with what yourdfpy reads otherwise; a file that it cannot read may be sound.

    Raises:
        MissingPackage: when yourdfpy is not installed.
        ArmgpiError: when the file has changed.
    """
    try:
        result = cross_check(report.robot)
    except CrossCheckUnavailable as error:
        repair = "nothing, if other tools read it: there is just no second opinion"
        finding = Finding("warning", "file", str(error), repair=repair, kind="cross-check")
        return report.with_findings([finding])
    repair = "one of the readers is wrong: check that element"
    findings = [
        Finding("error", "file", line, repair=repair, kind="cross-check") for line in result.differences
    ]
    return report.with_findings(findings, cross_check=result._asdict())


def _read(yourdfpy: Any, text: str) -> Any:
    """Return what yourdfpy makes of a URDF."""
    text = re.sub(r"\A\s*<\?xml.*?\?>", "", text)  # what it says of the encoding may be wrong
    logger = logging.getLogger("yourdfpy")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        with np.errstate(all="ignore"):  # axes too small or large for its arithmetic are compared below
            other = yourdfpy.URDF.load(
                io.BytesIO(text.encode()), load_meshes=False, build_collision_scene_graph=False
            )
    except Exception as error:  # whatever a parser of others raises
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise CrossCheckUnavailable(f"yourdfpy cannot read it ({reason[:200]})") from None
    finally:
        logger.setLevel(before)
    if not other.link_map:
        raise CrossCheckUnavailable("yourdfpy finds no link in it, as where the root has an XML namespace")
    return other


def _of_joint(joint: tree.Joint, other: Any) -> list[str]:
    """Return what the readers find differently of one joint."""
    theirs = other.joint_map.get(joint.name)
    if theirs is None:
        return []
    pairs: list[tuple[str, Any, Any]] = [
        ("type", joint.type, theirs.type),
        ("parent", joint.parent, theirs.parent),
        ("child", joint.child, theirs.child),
    ]
    if joint.moves:
        axis = np.asarray(theirs.axis, dtype=np.float64)
        axis = axis / np.linalg.norm(axis)
        pairs.append(("axis", joint.direction.tolist(), axis.tolist()))
        pairs.append(("mimic", joint.mimic, None if theirs.mimic is None else theirs.mimic.joint))
        if theirs.limit is not None:
            # Ours is infinite where theirs is huge, and of a continuous joint. No lower and upper means 0 and
            # 0; yourdfpy says None.
            for end in ("lower", "upper"):
                limit = getattr(joint, end)
                if math.isfinite(limit):
                    pairs.append((f"{end} limit", limit, getattr(theirs.limit, end) or 0.0))
            pairs.append(("effort limit", joint.effort, theirs.limit.effort))
            pairs.append(("velocity limit", joint.velocity, theirs.limit.velocity))
    return [
        f"joint {joint.name!r}: {what} is {ours!r} to us and {seen!r} to yourdfpy"
        for what, ours, seen in pairs
        if not _same(ours, seen)
    ]


def _same(ours: Any, theirs: Any) -> bool:
    """Tell whether two readings agree, numbers to rounding."""
    if isinstance(ours, str) or ours is None or theirs is None:
        return bool(ours == theirs)
    return bool(np.allclose(ours, theirs, rtol=1e-12, atol=1e-12))


def _their_poses(document: urdf.Urdf, other: Any, values: Mapping[str, float]) -> dict[str, Array]:
    """Return where yourdfpy has the links at values of the joints."""
    other.update_cfg({name: values.get(name, 0.0) for name in other.actuated_joint_names})
    # Joint by joint: a chain at once takes it time that grows with the cube of its length.
    poses: dict[str, Array] = {document.base: np.eye(4)}
    for joint in tree.topological_order(document.joints, document.base):
        poses[joint.child] = poses[joint.parent] @ other.get_transform(joint.child, joint.parent)
    return poses


def _of_poses(
    document: urdf.Urdf, robot: Robot, theirs: Callable[[Mapping[str, float]], dict[str, Array]], reader: str
) -> CrossCheck:
    """Compare the poses of links at random configurations."""
    count = max(2, min(_CONFIGURATIONS, _MOST_POSES // len(document.links)))
    configurations = robot.random_positions(count, seed=2)
    apart = _differently_locked(document, robot)
    known_to_them = theirs(robot.provenance["locked"])
    names = [name for name in document.links if name not in apart and name in known_to_them]
    ours = {name: robot.frame_pose(name, configurations) for name in names}
    position = rotation = 0.0
    worst = names[0]
    for row, q in enumerate(configurations):
        moved = dict(zip(robot.joint_names, q.tolist(), strict=True))
        poses = theirs({**robot.provenance["locked"], **moved})
        for name in names:
            pose = poses[name]
            distance = float(np.linalg.norm(pose[:3, 3] - ours[name].translation[row]))
            if distance > position:
                position, worst = distance, name
            turned = float(np.abs(pose[:3, :3] - ours[name].rotation[row]).max())
            rotation = max(rotation, turned)
    lines = []
    if not (position <= _ROUNDING and rotation <= _ROUNDING):
        lines.append(
            f"the poses of links differ by up to {position:.3g} m (link {worst!r}), their rotation matrices "
            f"by {rotation:.3g}"
        )
    return CrossCheck(len(names), len(configurations), position, rotation, tuple(lines), reader)


def _differently_locked(document: urdf.Urdf, robot: Robot) -> set[str]:
    """Return the links behind joints that are locked here and follow a moving joint there."""
    locked = robot.provenance["locked"]
    alike = []
    for name, joint in document.joints.items():
        follows_there = joint.mimic is not None and joint.mimic not in locked
        if not (name in locked and follows_there):
            alike.append(name)
    return set(document.moved_links(alike))
