"""What stands between the controller's torque and the joints: limits on torque and on its rate."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array, PerJointInput, per_joint, positive
from armgpi.control.controller import FullState, common_batch
from armgpi.plants.plant import Plant, Wrapper


class Saturated(Wrapper):
    """Torque cut to the actuators' limits.

    Attributes:
        effort: highest torque [N m or N], shape (n,) or (batch, n).
    """

    def __init__(self, plant: Plant, effort: PerJointInput | None = None) -> None:
        """Limit the torque of `plant` to `effort` [N m or N]; its robot's limits when not given."""
        super().__init__(plant)
        if effort is None:
            self.effort = plant.robot.limits.effort
        else:
            self.effort = per_joint(effort, "effort", plant.robot.joint_names, "positive", positive)
        self.batch = common_batch(plant.batch, self.effort)

    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Return the next state under the limited torque."""
        limited = np.minimum(np.maximum(tau, -self.effort), self.effort)
        return self.plant.step(limited, state, dt)

    def parameters(self) -> dict[str, Any]:
        """Return the limits."""
        return {"effort": self.effort.tolist()}


class _Slew(NamedTuple):
    plant: Any
    tau: Array


class RateLimited(Wrapper):
    """Torque that changes no faster than a rate.

    Attributes:
        rate: highest rate of change [N m/s or N/s], shape (n,) or (batch, n).
    """

    def __init__(self, plant: Plant, rate: PerJointInput) -> None:
        """Limit how fast the torque of `plant` changes; it starts at what holds the arm still."""
        super().__init__(plant)
        self.rate = per_joint(rate, "rate", plant.robot.joint_names, "positive", positive)
        self.batch = common_batch(plant.batch, self.rate)

    def init(self, q: Array, v: Array) -> _Slew:
        """Return the state, the actuators holding the arm."""
        return _Slew(self.plant.init(q, v), self.robot.dynamics.gravity(q))

    def step(self, tau: Array, state: _Slew, dt: float) -> _Slew:
        """Return the next state under the torque that the actuators get to."""
        most = self.rate * dt
        reached = state.tau + np.minimum(np.maximum(tau - state.tau, -most), most)
        return _Slew(self.plant.step(reached, state.plant, dt), reached)

    def measure(self, state: _Slew) -> FullState:
        """Return what the sensors say."""
        return self.plant.measure(state.plant)

    def true_state(self, state: _Slew) -> Any:
        """Return the true state."""
        return self.plant.true_state(state.plant)

    def parameters(self) -> dict[str, Any]:
        """Return the rate."""
        return {"rate": self.rate.tolist()}
