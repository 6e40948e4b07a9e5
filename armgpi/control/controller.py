"""The controller protocol: from a measurement and a target to a torque, with explicit state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.arrays import Array, PerJointInput, check_number, per_joint, positive
from armgpi.errors import EffortError, ParameterError
from armgpi.references.reference import Target
from armgpi.robot.robot import AnyRobot


class Measurement(NamedTuple):
    """What an output-feedback controller sees: positions, and nothing else.

    Attributes:
        q: measured positions [rad or m], shape (n,) or (batch, n).
    """

    q: Array


class FullState(NamedTuple):
    """What a state-feedback controller sees.

    Attributes:
        q: measured positions [rad or m], shape (n,) or (batch, n).
        v: measured velocities [rad/s or m/s], same shape.
    """

    q: Array
    v: Array


class ControlStep(NamedTuple):
    """Result of one control step.

    Attributes:
        tau: torque to apply until the next sample [N m or N], shape (n,) or (batch, n).
        state: the controller's next state.
    """

    tau: Array
    state: Any


class Controller(ABC):
    """A sampled torque controller.

    Its parameters do not change; what changes is its state, which goes in and out of :meth:`step`. Steps
    are elementwise in the joints except for D(q) x and D(q)^-1 x of the robot it believes in.

    Attributes:
        robot: the robot that the controller believes in.
        dt: its sample time [s].
        effort: torque that it never exceeds [N m or N], shape (n,) or (batch, n).
        batch: number of rollouts that its parameters are for, None when they fit any.
        sees: :class:`Measurement` or :class:`FullState`: what `step` is given.
    """

    measurement_type: ClassVar[type[Measurement] | type[FullState]] = Measurement

    def __init__(self, robot: AnyRobot, dt: float, effort: PerJointInput | None = None) -> None:
        """Check and keep what all controllers share.

        Args:
            robot: the robot that the controller believes in.
            dt: sample time [s].
            effort: torque limits [N m or N], a number, (n,) or (batch, n); the robot's when not given.

        Raises:
            ParameterError: when dt is not positive.
            EffortError: when a joint's limit leaves no torque.
        """
        self.robot = robot
        self.dt = check_number(dt, "dt", "a positive sample time of at least 1e-9 [s]", lowest=1e-9)
        if effort is None:
            self.effort = robot.limits.effort
        else:
            self.effort = per_joint(effort, "effort", robot.joint_names, "positive", positive)
        powerless = np.argwhere(~(self.effort > 0.0))
        if powerless.size:
            index = tuple(int(i) for i in powerless[0])
            raise EffortError(robot.joint_names[index[-1]], self.effort[index])
        self._floor = -self.effort
        self.batch = common_batch(robot.batch, self.effort)

    @abstractmethod
    def init(self, measurement: Any, target: Target) -> Any:
        """Return the state before the first sample.

        Args:
            measurement: the first measurement, of the type that :attr:`measurement_type` names.
            target: the first target.
        """

    @abstractmethod
    def step(self, measurement: Any, target: Target, state: Any) -> ControlStep:
        """Return the torque to hold until the next sample, and the next state.

        Args:
            measurement: of the type that :attr:`measurement_type` names; arrays (n,) or (batch, n).
            target: what is asked for now.
            state: from :meth:`init` or the step before.
        """

    def limited(self, tau: Array) -> Array:
        """Return a torque cut to what the controller may ask for."""
        cut: Array = np.minimum(np.maximum(tau, self._floor), self.effort)
        return cut

    def signals(self, state: Any) -> Mapping[str, Array]:
        """Return inner signals worth recording, name -> array (..., n); none by default."""
        return {}

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data, for a rollout's provenance."""
        return {"controller": type(self).__name__, "dt": self.dt, "effort": self.effort.tolist()}


def common_batch(*sources: int | Array | None) -> int | None:
    """Return the one batch size of several numbers or arrays (batch, n), None when none has one.

    Raises:
        ParameterError: when two of them differ.
    """
    sizes = set()
    for source in sources:
        if isinstance(source, int):
            sizes.add(source)
        elif source is not None and source.ndim == 2:
            sizes.add(len(source))
    if len(sizes) > 1:
        raise ParameterError("batch", sorted(sizes), "the same size everywhere")
    return sizes.pop() if sizes else None
