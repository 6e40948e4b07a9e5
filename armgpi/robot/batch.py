"""One robot per rollout."""

from __future__ import annotations

from typing import Any

import numpy as np

from armgpi.base.arrays import Array, check_type
from armgpi.errors import EffortError, ParameterError
from armgpi.robot.robot import Robot
from armgpi.robot.several import RobotBatch, VariedRobots, common_batch

__all__ = [
    "AnyRobot",
    "RobotBatch",
    "VariedRobots",
    "check_powered",
    "check_robot",
    "check_same_joints",
    "common_batch",
    "with_heavier_rotors",
]

#: A single robot or one per rollout.
AnyRobot = Robot | RobotBatch


def with_heavier_rotors(robot: AnyRobot, factor: float) -> AnyRobot:
    """Return a robot with its rotors' inertia multiplied by a factor; what is known of them stays known."""
    if isinstance(robot, VariedRobots):
        rotors = robot.variation.get("rotor_inertia", np.tile(robot.base.armature, (robot.batch, 1)))
        heavier: VariedRobots = robot.base.varied(**{**robot.variation, "rotor_inertia": factor * rotors})
        return heavier
    if isinstance(robot, RobotBatch):
        return RobotBatch([with_heavier_rotors(each, factor) for each in robot.robots])
    return robot.with_drives(robot.drives.scaled("rotor_inertia", factor))


def feedback_model(robot: AnyRobot, link_factor: Any, rotor_factor: Any) -> AnyRobot:
    """Return a robot with the inertia of its links and that of its rotors multiplied by a factor each.

    Args:
        robot: the robot, or one for each rollout.
        link_factor: factor of the links' inertia [-], or one for each rollout, (batch, 1).
        rotor_factor: factor of the rotors' inertia [-], likewise.
    """
    if isinstance(link_factor, np.ndarray) or isinstance(rotor_factor, np.ndarray):
        return _varied_feedback(robot, link_factor, rotor_factor)
    if link_factor != 1.0:
        robot = robot.scaled_inertia(link_factor)  # rotors too
        rotor_factor = rotor_factor / link_factor
    return robot if rotor_factor == 1.0 else with_heavier_rotors(robot, rotor_factor)


def _varied_feedback(robot: AnyRobot, link_factor: Any, rotor_factor: Any) -> AnyRobot:
    """Return what :func:`feedback_model` does where a factor differs by rollout."""
    if isinstance(robot, RobotBatch) and not isinstance(robot, VariedRobots):
        return _each_feedback(robot, link_factor, rotor_factor)
    known = robot.variation if isinstance(robot, VariedRobots) else {}
    base = robot.base if isinstance(robot, VariedRobots) else robot
    given = {"link_factor": np.ravel(link_factor), "rotor_factor": np.ravel(rotor_factor)}
    rows = common_batch({name: len(each) for name, each in given.items()} | {"robot": robot.batch or 1})
    links, rotors = (np.broadcast_to(each, (rows,)) for each in given.values())
    if "payload" in known:  # a load is a part of the last link
        known = {**known, "payload": links * known["payload"]}
    scale = links * known.get("inertia_scale", 1.0)
    varied: VariedRobots = base.varied(
        **{**known, "inertia_scale": scale, "rotor_inertia": rotors[:, None] * robot.armature}
    )
    return varied


def _each_feedback(robots: RobotBatch, link_factor: Any, rotor_factor: Any) -> RobotBatch:
    """Return what :func:`feedback_model` does of robots that are listed one by one."""
    factors = {"link_factor": np.ravel(link_factor), "rotor_factor": np.ravel(rotor_factor)}
    common_batch({name: len(each) for name, each in factors.items()} | {"robot": robots.batch})
    links, rotors = (np.broadcast_to(each, (robots.batch,)).tolist() for each in factors.values())
    rows = zip(robots.robots, links, rotors, strict=True)
    return RobotBatch([feedback_model(one, link, rotor) for one, link, rotor in rows])


def check_robot(robot: Any, name: str = "robot") -> None:
    """Refuse what is neither a robot nor one per rollout.

    Raises:
        ParameterError: when it is something else.
    """
    check_type(robot, name, AnyRobot, "a Robot or a RobotBatch")


def one_of(robot: AnyRobot) -> Robot:
    """Return an arm of a batch, whose kinematics are those of all; a single arm as it is."""
    return robot if isinstance(robot, Robot) else robot.first


def check_same_joints(other: Any, name: str, robot: AnyRobot) -> None:
    """Refuse what is not a robot with the joints of `robot`.

    Raises:
        ParameterError: when it is something else.
    """
    check_robot(other, name)
    if other.joint_names != robot.joint_names:
        raise ParameterError(name, other, f"a robot with the joints {', '.join(robot.joint_names)}")


def check_powered(robot: AnyRobot, effort: Array) -> None:
    """Refuse efforts [N m or N], (n,) or (batch, n), that leave a joint no torque.

    Raises:
        EffortError: when one does.
    """
    powerless = np.argwhere(~(effort > 0.0))
    if powerless.size:
        index = tuple(int(i) for i in powerless[0])
        alike = [int(i) for i in np.flatnonzero(~(effort[index[:-1]] > 0.0)) if i != index[-1]]
        joints = [index[-1], *alike]
        others = [robot.joint_names[i] for i in alike]
        enough = 10.0
        if hasattr(robot, "random_positions"):  # one arm, no batch: what is proposed holds it
            q = np.vstack([robot.middle(), robot.random_positions(500, seed=1)])
            enough = enough_effort(float(np.abs(robot.dynamics.gravity(q))[:, joints].max()))
        movable = len(joints) < robot.n  # an arm with all of its joints locked is none
        raise EffortError(robot.joint_names[index[-1]], effort[index], others, enough, movable)


def enough_effort(holding: float) -> float:
    """Return an effort to propose [N m or N]: half more than what holds the arm, 10 at least.

    Args:
        holding: largest torque that holds the arm [N m or N].
    """
    return max(10.0, float(f"{1.5 * holding:.3g}"))
