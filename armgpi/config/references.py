"""The reference of an experiment: moves, paths of the tool, poses, and recorded motions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import parameters
from armgpi.config import default_move
from armgpi.config.place import Place
from armgpi.config.schema import ExperimentConfig, ReferenceSection
from armgpi.config.section import Section
from armgpi.config.values import per_joint
from armgpi.references.cartesian import CartesianReference, ClosedForm, Inverse
from armgpi.references.following import FollowLimits, Setpoints
from armgpi.references.paths import Eased, Path
from armgpi.references.poses import PosePath
from armgpi.references.recorded import Recorded
from armgpi.references.reference import Reference
from armgpi.references.waypoints import Waypoints
from armgpi.registry import classes_of, subclasses
from armgpi.robot.kinematics import TrackingInverse, inverse_kinematics, random_configurations
from armgpi.robot.robot import Robot

#: Keys of a reference that are of a stream alone.
_STREAM_KEYS = ("feedforward", "torque_rate", "start")
#: Time for a path without an end, when nothing is said [s].
_PATH_TIME = 18.0
#: Size of a path that is chosen for an arm, as a share of how far from the base it is [-].
_PATH_SIZE = 0.1
#: Number of configurations among which the one with the most clearance is looked for.
_CANDIDATES = 256


def build_reference(
    config: ExperimentConfig, robot: Robot, place: Place
) -> tuple[Reference, float, ReferenceSection]:
    """Return the reference, when it has ended [s], and its section with the defaults filled in."""
    section = config.reference
    for other in ("file", "path", "poses", "stream"):
        for key in ("points", "durations", "holds", "file", "path", "poses"):
            if key != other and getattr(section, other) is not None and getattr(section, key) is not None:
                message = f"{other} and this key are mutually exclusive: use one of the two"
                raise place.at(key).error(message)
    for key in _STREAM_KEYS:
        if section.stream is None and getattr(section, key) is not None:
            raise place.at(key).error("requires stream")
    if section.poses is not None or section.stream is not None:
        return _follow_poses(section, robot, place)
    if section.path is not None:
        return _follow_path(section, robot, place)
    if section.frame is not None:
        raise place.at("frame").error("requires path, poses or stream")
    if section.file is None:
        return _moves(config, robot, place)
    with place.at("file").error_context():
        recorded = Recorded.load(section.file, robot)
    return recorded, recorded.t_end, section


def _follow_path(
    section: ReferenceSection, robot: Robot, place: Place
) -> tuple[Reference, float, ReferenceSection]:
    """Return a path of the tool as a reference; see `build_reference`."""
    frame = section.frame or robot.tip
    with place.at("frame").error_context():
        robot.frame_pose(frame, robot.middle())
    axis = section.tool_axis or [0.0, 0.0, 1.0]
    inverse = _inverse(section, robot, frame, axis, place)
    with place.at("path").error_context():
        drawn, path = _path(section.path, robot, frame, section.direction, axis)
        reference = CartesianReference(robot, frame, path, inverse)
    end = path.t_end if math.isfinite(path.t_end) else _PATH_TIME
    return reference, end, section.replace(frame=frame, path=drawn)


def _follow_poses(
    section: ReferenceSection, robot: Robot, place: Place
) -> tuple[Reference, float, ReferenceSection]:
    """Return poses of a file as a reference, known in advance or as they arrive; see `build_reference`."""
    for key in ("direction", "tool_axis"):
        if getattr(section, key) is not None:
            raise place.at(key).error("requires path")
    frame = section.frame or robot.tip
    with place.at("frame").error_context():
        robot.frame_pose(frame, robot.middle())
    section = section.replace(frame=frame)
    if section.poses is not None:
        with place.at("poses").error_context():
            path = PosePath.load(section.poses)
            return CartesianReference(robot, frame, path), path.t_end, section
    limits = None
    if section.torque_rate is not None:
        limits = FollowLimits.of(robot, section.torque_rate)
    start = section.start
    if start is not None:
        start = per_joint(start, robot, place.at("start"), robot.middle())
        with place.at("start").error_context():
            robot.check_position(start, "start")
    with place.at("stream").error_context():
        stream = Setpoints.load(
            section.stream, robot, frame, limits=limits, start=start, feedforward=bool(section.feedforward)
        )
    return stream, float(stream.times[-1]), section


def _inverse(section: ReferenceSection, robot: Robot, frame: str, axis: list[float], place: Place) -> Inverse:
    """Return the inverse kinematics of a frame: in closed form where the arm has one, else by tracking."""
    closed = next((each for each in subclasses(ClosedForm) if each.fits(robot, frame)), None)
    if section.direction is not None or closed is None:
        with place.error_context():
            return TrackingInverse(robot, frame, direction=section.direction, tool_axis=axis)
    if section.tool_axis is not None:
        raise place.at("tool_axis").error("requires direction")
    inverse: Inverse = closed()
    return inverse


def _path(
    section: Section, robot: Robot, frame: str, direction: list[float] | None, axis: list[float]
) -> tuple[Any, Path]:
    """Return a path, and its section with what was left out chosen for the arm."""
    kind = classes_of(Path)[section.type]
    declared = parameters(kind)
    missing = []
    for name, parameter in declared.items():
        if parameter.chosen and getattr(section, parameter.file_key) is None:
            missing.append(name)
    if missing:
        point = _roomiest(robot, frame, direction, axis)
        chosen = kind.fitted(point, _PATH_SIZE * float(np.linalg.norm(point)))
        update = {declared[name].file_key: np.asarray(chosen[name]).tolist() for name in missing}
        section = section.replace(**update)
    values = {}
    for name, parameter in declared.items():
        if parameter.in_file:
            values[name] = getattr(section, parameter.file_key)
    path = kind(**values)
    if kind.starts_moving and section.ease:
        return section, Eased(path, section.ease)
    return section, path


def _roomiest(robot: Robot, frame: str, direction: list[float] | None, axis: list[float]) -> Array:
    """Return the point at which the arm has the most clearance, of some."""
    clearance = TrackingInverse(robot, frame, direction=direction, tool_axis=axis).clearance
    q = random_configurations(robot, _CANDIDATES, seed=0)
    points = robot.frame_pose(frame, q).translation
    if direction is not None:
        found = inverse_kinematics(robot, frame, points, direction=direction, tool_axis=axis, restarts=4)
        if found.reached.any():
            q, points = found.q[found.reached], points[found.reached]
    point: Array = points[np.argmax(clearance(q))]
    return point


def _moves(config: ExperimentConfig, robot: Robot, place: Place) -> tuple[Waypoints, float, ReferenceSection]:
    """Return moves from configuration to configuration; see `build_reference`."""
    section, points, usual = config.reference, [], 0.0
    here = goal = robot.middle()
    # Points that name every joint need no start: searching one takes a while for a new arm.
    if section.points is None or isinstance(section.points[0], Mapping):
        here, goal = default_move.ends(robot, old=config.ideal is None)
    if section.points is None:
        points, usual = [here, goal, here], default_move.HOLD
    for index, point in enumerate(section.points or ()):
        here = per_joint(point, robot, place.at("points", index), here)
        with place.at("points", index).error_context():
            robot.check_position(here, f"point {index + 1} of the reference")
        points.append(here)
    durations, holds = section.durations, usual if section.holds is None else section.holds
    if durations is None:
        durations = [default_move.gentle_duration(robot, a, b) for a, b in pairwise(points)]
    with place.error_context():
        reference = Waypoints(points, durations, holds)
    filled = ReferenceSection(points=[x.tolist() for x in points], durations=durations, holds=holds)
    return reference, reference.t_end, filled
