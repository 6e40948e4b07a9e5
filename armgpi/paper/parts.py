"""What the paper's arm adds to experiment files: its vibrating torques and its inverse kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import with_parameters
from armgpi.errors import ParameterError
from armgpi.paper.arm import PaperArm
from armgpi.plants.loads import Load, paper_disturbances
from armgpi.references.cartesian import ClosedForm
from armgpi.registry import Context
from armgpi.robot.robot import Robot


@with_parameters
class PaperLoad(Load):
    """The vibrating torques of eqs. 29-31, for an arm of three joints."""

    config_name: ClassVar[str | None] = "paper"

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        total: Array = sum((load.torque(t) for load in paper_disturbances()), np.zeros(3))
        return total

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> list[Load]:
        """Return the sines of which it is the sum."""
        n = context.robot.n
        if n != 3:
            raise ParameterError(
                "type", "paper", f"of other loads: eqs. 29-31 are for 3 joints, this arm has {n}"
            )
        return [*paper_disturbances()]


class PaperInverse(ClosedForm):
    """Eq. 2, for a frame that moves as the paper's tool does."""

    @classmethod
    def fits(cls, robot: Robot, frame: str) -> bool:
        """Tell whether a frame of an arm moves as the paper's tool does."""
        if robot.n != 3:
            return False
        q = np.array([[0.0, 0.0, 0.0], [0.3, 0.5, -0.7], [-1.1, 0.2, 0.9]])
        there = robot.frame_pose(frame, q).translation
        return bool(np.abs(there - PaperArm().forward_kinematics(q)).max() < 1e-9)

    def __call__(self, points: Array) -> Array:
        """Return the joint positions; see :data:`armgpi.references.cartesian.Inverse`."""
        return PaperArm().inverse_kinematics(points)
