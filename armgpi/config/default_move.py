"""The move of an arm for which nothing specifies one: there, a hold, and back; the same for all commands."""

from __future__ import annotations

import math

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.hints import with_keyword_hints
from armgpi.errors import ParameterError
from armgpi.references.bezier import Bezier, minimum_duration
from armgpi.references.waypoints import Waypoints
from armgpi.robot.collisions import shape_files
from armgpi.robot.robot import Robot
from armgpi.robot.usual import Ends, any_goal, usual_ends
from armgpi.tuning.kept import remember

#: Holds at start and goal [s].
HOLD = 1.0
#: Share of the velocity limits that a move without a duration uses, and its acceleration [rad/s^2].
_MOVE_SHARE = 0.5
_MOVE_ACCELERATION = 5.0
#: Velocity limits below this are ignored [rad/s or m/s]: a move would take weeks.
_LEAST_SPEED = 1e-6
#: Share of the effort beyond gravity that a move without a duration may take; how much slower it may become.
_MOVING_SHARE, _SLOWEST = 0.8, 4.0


@with_keyword_hints
def default_move(robot: Robot) -> Waypoints:
    """Return the move that commands simulate where nothing specifies one: there and back, with holds of 1 s.

    Every joint moves by up to 0.5 rad or m. The move avoids singular and upright configurations, torques that
    the motors do not have, and collisions of the arm with itself and its floor, where the arm has other moves
    and its collision meshes are small enough to be read (10 MB). It starts in the middle of the joint ranges
    where that is such a configuration, and near it otherwise.

    Args:
        robot: the arm.

    Raises:
        ParameterError: for what is not a single :class:`armgpi.Robot`.
    """
    if not isinstance(robot, Robot):
        raise ParameterError("robot", robot, "a single Robot")
    start, goal = ends(robot)
    return Waypoints([start, goal, start], gentle_duration(robot, start, goal), HOLD)


def ends(robot: Robot, old: bool = False) -> Ends:
    """Return start and goal of the default move.

    Args:
        robot: the arm.
        old: whether the move is that of experiment files without the key ``ideal``, which starts in the
            middle of the joint ranges also where the arm is singular there.
    """
    if old:
        return Ends(robot.middle(), any_goal(robot, robot.middle()))
    # The shapes as they are now: without them a changed file would get a move that collides.
    parts = {"robot": robot, "shapes": shape_files(robot)}
    found = remember("default move", parts, lambda: usual_ends(robot))
    return Ends(*found)


def gentle_duration(robot: Robot, start: Array, goal: Array) -> float:
    """Return a duration of a move [s] that keeps half the speeds, and the torques where motors are weak."""
    speed = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, 1.0) * _MOVE_SHARE
    speed = np.where(speed > _LEAST_SPEED, speed, _MOVE_SHARE)
    duration = max(1.0, minimum_duration(goal - start, speed, _MOVE_ACCELERATION))
    target = Bezier(start, goal, duration).at(np.linspace(0.0, duration, 41))
    holding = robot.gravity(target.q)
    moving = robot.inverse_dynamics(*target) - holding  # falls with the square of the duration
    left = robot.limits.effort - np.sign(moving) * holding
    share = np.divide(np.abs(moving), _MOVING_SHARE * left, out=np.zeros_like(moving), where=left > 0.0)
    return duration * math.sqrt(min(max(1.0, float(share.max())), _SLOWEST**2))
