"""Actuators between the controller's torque and the joints: limits on torque and on its rate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.plants.plant import Plant, StatefulWrapper, Wrapped, Wrapper
from armgpi.registry import Context


@with_parameters
class Saturated(Wrapper):
    """Torque saturated at the actuators' limits.

    Attributes:
        effort: highest torque [N m or N], shape (n,) or (batch, n); the robot's effort limits when not given.
    """

    config_name: ClassVar[str | None] = "torque_limit"
    order: ClassVar[float] = 20.0

    effort: PerJoint = parameter(
        "highest torque of the motors",
        unit="N m or N",
        default=None,
        none="the robot's effort limits",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
    )

    def __post_init__(self) -> None:
        """Check the limits; the robot's when none are given."""
        super().__post_init__()
        self.fill("effort", self.robot.limits.effort)

    @classmethod
    def configured(cls, plant: Plant, given: Mapping[str, Any] | None, context: Context) -> Plant:
        """Return the plant with limits: motors always have some; see :meth:`Wrapper.configured`."""
        return super().configured(plant, given or {}, context)

    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Return the next state under the limited torque; see :meth:`Plant.step`."""
        limited = np.minimum(np.maximum(tau, -self.effort), self.effort)
        return self.plant.step(limited, state, dt)


@with_parameters
class RateLimited(StatefulWrapper):
    """Torque that changes no faster than a rate; it starts at what holds the arm still.

    Attributes:
        rate: highest rate of change [N m/s or N/s], shape (n,) or (batch, n).
    """

    config_name: ClassVar[str | None] = "torque_rate"
    order: ClassVar[float] = 10.0

    rate: PerJoint = parameter(
        "highest rate of change of torque",
        unit="N m/s or N/s",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        slider=(1.0, 1e4),
    )

    def start(self, plant: Any, q: Array) -> Array:
        """Return the torque of actuators that hold the arm; see :meth:`StatefulWrapper.start`."""
        return self.robot.dynamics.gravity(q)

    def step(self, tau: Array, state: Wrapped, dt: float) -> Wrapped:
        """Return the next state under the torque that the actuators reach; see :meth:`Plant.step`."""
        most = self.rate * dt
        reached = state.own + np.minimum(np.maximum(tau - state.own, -most), most)
        return Wrapped(self.plant.step(reached, state.plant, dt), reached)
