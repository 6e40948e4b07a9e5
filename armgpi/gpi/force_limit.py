"""A bound on the force that a controller presses with, from its own torque: no force sensor.

What a torque beyond the model's does at rest is a wrench at the tool: J' f is that torque, but for what moves
the arm without the tool. So f follows from the torque, is shortened to the limit, and what is too much is
taken away from the torque.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armgpi.arrays import Array
from armgpi.robot.frame_motion import FrameMotion, inner
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Lever of the moment that belongs to a force where none is given [m].
LEVER = 0.2
#: Configurations over which forces are taken.
_CONFIGURATIONS = 20


class ForceLimit:
    """Shortens a torque to what presses with a force and a moment at most.

    Attributes:
        force: largest force [N].
        moment: largest moment [N m].
        friction: Coulomb friction that comes on top, as the arm has to move [N m or N].
    """

    def __init__(self, robot: Robot, frame: str | None, force: Any, moment: Any, friction: Array) -> None:
        """Find the tool.

        Args:
            robot: the arm.
            frame: that presses; the tip when not given.
            force: largest force [N].
            moment: largest moment about it [N m]; 0.2 m times the force when not given.
            friction: Coulomb friction of the joints [N m or N], (n,) or (batch, n).

        Raises:
            NameNotFound: when there is no such frame.
            ParameterError: when no joint moves it.
        """
        self._motion = FrameMotion(robot, frame or robot.tip)
        self.force = force
        self.moment = LEVER * force if moment is None else moment
        self.friction = friction
        self._length = self._motion.reach(robot)

    def force_of(self, robot: Robot, torque: Array) -> float:
        """Return the force at the tool [N] that torques (n,) are, the median of some configurations."""
        forces = []
        for q in random_configurations(robot, _CONFIGURATIONS, seed=0):
            jacobian = self._motion.at(q, 0.0 * q).damped_jacobian(self._length)
            wrench = np.linalg.solve(jacobian.square, jacobian.matrix @ torque)
            forces.append(float(np.linalg.norm(wrench[:3])) / self._length)
        return float(np.median(forces))

    def excess(self, q: Array, torque: Array) -> Array:
        """Return what is too much of a torque; exactly 0 where nothing is.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
            torque: beyond the model's [N m or N], likewise.
        """
        jacobian = self._motion.at(q, 0.0 * q).damped_jacobian(self._length)
        seen = np.matmul(jacobian.matrix, torque[..., None])
        wrench: Any = np.linalg.solve(jacobian.square, seen)[..., 0]
        force, moment = wrench[..., 0:3], wrench[..., 3:6]
        much = np.concatenate(
            [_beyond(force, self.force * self._length), _beyond(moment, self.moment)], axis=-1
        )
        taken = np.matmul(jacobian.transposed, much[..., None])[..., 0]
        left: Array = taken - np.minimum(np.maximum(taken, -self.friction), self.friction)
        return left


def _beyond(vector: Array, most: Any) -> Array:
    """Return what is beyond a length of vectors (..., 3): exactly 0 for shorter ones."""
    length = np.sqrt(np.maximum(inner(vector, vector), 1e-12))
    share = np.maximum(1.0 - most / length, 0.0)
    beyond: Array = share * vector
    return beyond
