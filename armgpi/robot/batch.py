"""One robot per rollout."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armgpi.arrays import check_type, frozen, is_listing
from armgpi.errors import ParameterError
from armgpi.robot.dynamics import stacked
from armgpi.robot.equations import Equations, Friction, Limits
from armgpi.robot.robot import Robot


class RobotBatch(Equations):
    """One robot per rollout: the same joints, other masses, payloads or limits.

    Row i of every array argument belongs to ``robots[i]``. It goes where a :class:`Robot` goes in a plant
    or a controller.

    Attributes:
        robots: the robots.
        batch: their number.
        limits: arrays of shape (batch, n).
    """

    robots: tuple[Robot, ...]
    batch: int

    def __init__(self, robots: Sequence[Robot]) -> None:
        """Stack robots with equal joint names.

        Raises:
            ParameterError: when there are none or their joints differ.
        """
        if not is_listing(robots) or not len(robots) or not all(isinstance(r, Robot) for r in robots):
            raise ParameterError("robots", robots, "a sequence of at least one Robot")
        first = robots[0]
        for robot in robots:
            if robot.joint_names != first.joint_names:
                raise ParameterError(
                    "robots", robot, f"robots with the joints {', '.join(first.joint_names)}"
                )
        limits = zip(*(robot.limits for robot in robots), strict=True)
        friction = zip(*(robot.friction for robot in robots), strict=True)
        vars(self).update(
            robots=tuple(robots),
            name=first.name,
            joint_names=first.joint_names,
            joint_types=first.joint_types,
            batch=len(robots),
            limits=Limits(*(frozen(np.stack(rows)) for rows in limits)),
            friction=Friction(*(frozen(np.stack(rows)) for rows in friction)),
            dynamics=stacked([robot.dynamics for robot in robots]),
        )

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the models came from."""
        return {"robots": [robot.provenance for robot in self.robots]}

    def scaled_inertia(self, factor: float) -> RobotBatch:
        """Return the robots with every mass and inertia scaled; see :meth:`armgpi.Robot.scaled_inertia`."""
        return RobotBatch([robot.scaled_inertia(factor) for robot in self.robots])

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"RobotBatch({self.batch} x {self.name!r}, n={self.n})"


#: A single robot or one per rollout.
AnyRobot = Robot | RobotBatch


def check_robot(robot: Any, name: str = "robot") -> None:
    """Refuse what is neither a robot nor one per rollout.

    Raises:
        ParameterError: when it is something else.
    """
    check_type(robot, name, AnyRobot, "a Robot or a RobotBatch")


def check_same_joints(other: Any, name: str, robot: AnyRobot) -> None:
    """Refuse what is not a robot with the joints of `robot`.

    Raises:
        ParameterError: when it is something else.
    """
    check_robot(other, name)
    if other.joint_names != robot.joint_names:
        raise ParameterError(name, other, f"a robot with the joints {', '.join(robot.joint_names)}")
