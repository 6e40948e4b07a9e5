"""The plant protocol: torque in, measurement out, with explicit state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

from armgpi.arrays import Array
from armgpi.control.controller import FullState
from armgpi.robot.robot import AnyRobot


class PlantState(NamedTuple):
    """True state of an arm.

    Attributes:
        k: number of steps taken.
        q: positions [rad or m], shape (n,) or (batch, n).
        v: velocities [rad/s or m/s], same shape.
        tau: torque that the joints received in the last step [N m or N], same shape.
    """

    k: int
    q: Array
    v: Array
    tau: Array


class Plant(ABC):
    """Something that moves under a torque held over a sample.

    Attributes:
        robot: the arm that it really is.
        batch: number of rollouts that its parameters are for, None when they fit any.
    """

    robot: AnyRobot
    batch: int | None = None

    @abstractmethod
    def init(self, q: Array, v: Array) -> Any:
        """Return the state at rest or in motion at time 0; arrays of shape (n,) or (batch, n)."""

    @abstractmethod
    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Return the state after `tau` [N m or N] was held for `dt` [s]."""

    @abstractmethod
    def measure(self, state: Any) -> FullState:
        """Return what the sensors say of the state."""

    @abstractmethod
    def true_state(self, state: Any) -> PlantState:
        """Return the true state."""

    def disturbance(self, t: Array) -> Array | None:
        """Return the disturbance torque at times of shape (k,), shape (k, ..., n); None without one."""
        return None

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data, for a rollout's provenance."""


class Wrapper(Plant):
    """A plant seen through something on its wires; varies a plant by wrapping it.

    Attributes:
        plant: the wrapped plant.
    """

    def __init__(self, plant: Plant) -> None:
        """Wrap `plant`."""
        self.plant = plant
        self.robot = plant.robot
        self.batch = plant.batch

    def init(self, q: Array, v: Array) -> Any:
        """Return the wrapped plant's state."""
        return self.plant.init(q, v)

    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Return the wrapped plant's next state."""
        return self.plant.step(tau, state, dt)

    def measure(self, state: Any) -> FullState:
        """Return what the wrapped plant's sensors say."""
        return self.plant.measure(state)

    def true_state(self, state: Any) -> PlantState:
        """Return the true state."""
        return self.plant.true_state(state)

    def disturbance(self, t: Array) -> Array | None:
        """Return the wrapped plant's disturbance torque."""
        return self.plant.disturbance(t)

    def describe(self) -> dict[str, Any]:
        """Return the wrapped plant's parameters, and under "wires" those of all wrappers, inner first."""
        inner = self.plant.describe()
        wires = [*inner.get("wires", []), {"type": type(self).__name__, **self.parameters()}]
        return {**inner, "wires": wires}

    def parameters(self) -> dict[str, Any]:
        """Return this wrapper's own parameters as plain data."""
        return {}
