"""Frames of an arm: poses, Jacobians and accelerations, by Pinocchio."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array, ArrayLike
from armgpi.errors import NameNotFound
from armgpi.robot.dynamics import Workspace
from armgpi.robot.equations import Equations
from armgpi.robot.urdf_model import Coupling


class Pose(NamedTuple):
    """Pose of a frame in the base frame.

    Attributes:
        rotation: rotation matrix, shape (..., 3, 3).
        translation: position [m], shape (..., 3).
    """

    rotation: Array
    translation: Array


class Frames(Equations):
    """The frames of one arm, besides its equations of motion.

    Attributes:
        coupling: how joints that follow others (``mimic="follow"``) depend on the n; None when none does.
    """

    coupling: Coupling | None
    _model: pin.Model
    _workspace: Workspace
    _frames: Mapping[str, int]

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all frames (links, joints and fixed joints)."""
        return tuple(self._frames)

    def frame_pose(self, name: str, q: ArrayLike) -> Pose:
        """Return the pose of a frame in the base frame.

        Args:
            name: a link, joint or fixed joint.
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            Rotation (..., 3, 3) and translation (..., 3) [m].

        Raises:
            NameNotFound: when there is no such frame.
            ArrayError: when `q` is not as it should be.
        """
        index = self._frame(name)
        (q_,) = self._states(q=q)
        data = self._workspace.data

        def pose(row: Array) -> Array:
            pin.framesForwardKinematics(self._model, data, self._whole(row))
            matrix: Array = data.oMf[index].homogeneous.copy()
            return matrix

        homogeneous = _rowwise(pose, q_)
        return Pose(homogeneous[..., :3, :3], homogeneous[..., :3, 3])

    def frame_jacobian(self, name: str, q: ArrayLike) -> Array:
        """Return the Jacobian of a frame: J v is its linear, then angular velocity, along the base axes.

        Args:
            name: a link, joint or fixed joint.
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            J, shape (6, n) or (batch, 6, n).

        Raises:
            NameNotFound: when there is no such frame.
            ArrayError: when `q` is not as it should be.
        """
        index = self._frame(name)
        (q_,) = self._states(q=q)
        data, axes = self._workspace.data, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

        def jacobian(row: Array) -> Array:
            J = pin.computeFrameJacobian(self._model, data, self._whole(row), index, axes)
            matrix: Array = np.array(J).reshape(6, -1)  # for a single joint Pinocchio drops an axis
            return matrix if self.coupling is None else matrix @ self.coupling.ratio

        return _rowwise(jacobian, q_)

    def frame_drift(self, name: str, q: ArrayLike, v: ArrayLike) -> Array:
        """Return J'(q, v) v, what a frame accelerates by when no joint does.

        Args:
            name: a link, joint or fixed joint.
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.

        Returns:
            Linear [m/s^2], then angular acceleration [rad/s^2], along the base axes: (6,) or (batch, 6).

        Raises:
            NameNotFound: when there is no such frame.
            ArrayError: when an argument is not as it should be.
        """
        index = self._frame(name)
        q_, v_ = self._states(q=q, v=v)
        still = np.zeros(self._model.nv)
        data, axes = self._workspace.data, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

        def drift(both: Array) -> Array:
            row, speed = np.split(both, 2)
            if self.coupling is not None:
                speed = self.coupling.ratio @ speed
            pin.forwardKinematics(self._model, data, self._whole(row), speed, still)
            moved = pin.getFrameClassicalAcceleration(self._model, data, index, axes)
            return np.array(moved.vector)

        return _rowwise(drift, np.concatenate([q_, v_], axis=-1))

    def links_moved_by(self, joint: str) -> list[str]:
        """Return the names of the links that a joint carries: its child, and what is fixed to that.

        Raises:
            NameNotFound: when no joint has that name.
        """
        if not (isinstance(joint, str) and joint in self.joint_names):
            raise NameNotFound("joint", joint, self.joint_names)
        index = self._model.getJointId(joint)
        return [f.name for f in self._model.frames if f.type == pin.FrameType.BODY and f.parentJoint == index]

    def _frame(self, name: str) -> int:
        """Return the index of a frame (Pinocchio itself returns a past-the-end index for a typo)."""
        try:
            return self._frames[name]
        except (KeyError, TypeError):
            raise NameNotFound("frame", name, self.frame_names) from None

    def _whole(self, q: Array) -> Array:
        """Return all coordinates of the model for one configuration (n,), following joints included."""
        return q if self.coupling is None else self.coupling.ratio @ q + self.coupling.offset


def _rowwise(function: Callable[[Array], Array], q: Array) -> Array:
    """Apply a function of one configuration to (n,), or to every row of (batch, n)."""
    if q.ndim == 1:
        return function(q)
    if not len(q):
        return function(np.zeros(q.shape[-1]))[np.newaxis][:0]
    return np.stack([function(row) for row in q])
