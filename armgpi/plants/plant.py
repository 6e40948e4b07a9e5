"""The plant protocol: torque in, measurement out, with explicit state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, check_type
from armgpi.base.parameter import Parametrised, parameters, with_parameters
from armgpi.control.controller import FullState
from armgpi.control.sizes import batches, common_batch
from armgpi.errors import ArrayError, show_value
from armgpi.registry import Context
from armgpi.robot.batch import AnyRobot


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
        """Return the state at time 0, at rest or in motion.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.

        Returns:
            The plant's state, whatever :meth:`step` takes and returns.
        """

    @abstractmethod
    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Return the state one sample later.

        Args:
            tau: torque that is held over the sample [N m or N], shape (n,) or (batch, n).
            state: from :meth:`init` or the step before.
            dt: sample time [s].
        """

    @abstractmethod
    def measure(self, state: Any) -> FullState:
        """Return what the sensors measure of the state.

        Args:
            state: of the plant.

        Returns:
            Positions [rad or m] and velocities [rad/s or m/s], each of shape (n,) or (batch, n).
        """

    @abstractmethod
    def true_state(self, state: Any) -> PlantState:
        """Return the true state.

        Args:
            state: of the plant.

        Returns:
            Sample number, positions [rad or m], velocities [rad/s or m/s] and applied torque [N m or N] of
            the links.
        """

    def disturbance(self, t: Array) -> Array | None:
        """Return the disturbance torque tau_d of eq. 7.

        Args:
            t: times [s], shape (k,).

        Returns:
            Torques [N m or N], shape (k, n) or (k, batch, n); None for a plant without one.
        """
        return None

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data, for a rollout's provenance."""


def inside(plant: Plant) -> Plant:
    """Return the arm inside of its sensors and actuators."""
    while isinstance(plant, Wrapper):
        plant = plant.plant
    return plant


@with_parameters
class Wrapper(Parametrised, Plant):
    """A plant behind a sensor or an actuator; varies a plant by wrapping it.

    One with a ``config_name`` is a key of ``plant:`` in experiment files.

    Attributes:
        plant: the wrapped plant.
        config_name: its key in experiment files; None for one that has none there.
        order: its place among other wrappers there: a smaller number is nearer to the arm.
        off: what an experiment file says to leave it out.
    """

    config_name: ClassVar[str | None] = None
    order: ClassVar[float] = 0.0
    off: ClassVar[Any] = None

    plant: Plant = field()

    def __post_init__(self) -> None:
        """Check the parameters."""
        check_type(self.plant, "plant", Plant, "a Plant")
        self.robot = self.plant.robot
        self.check_parameters(self.robot.joint_names)
        self.batch = common_batch(*batches(self))

    @classmethod
    def configured(cls, plant: Plant, given: Mapping[str, Any] | None, context: Context) -> Plant:
        """Return a plant with what an experiment file says around it.

        Args:
            plant: the plant.
            given: parameters by their names, but for those that are not in the file; None for no wrapper.
            context: what else the experiment is.
        """
        if given is None:
            return plant
        own = parameters(cls)
        return cls(plant, **given, **({"seed": context.seed} if "seed" in own else {}))

    def __repr__(self) -> str:
        """Return the wrapped plant with the parameters of the wrapper."""
        own = "".join(f", {name}={show_value(value)}" for name, value in self.values().items())
        return f"{type(self).__name__}({self.plant!r}{own})"

    def init(self, q: Array, v: Array) -> Any:
        """Return the wrapped plant's state; see :meth:`Plant.init`.

        Raises:
            ArrayError: when parameters are for several rollouts, and positions for one.
        """
        if self.batch is not None and np.ndim(q) < 2:
            raise ArrayError("q", f"expected shape ({self.batch}, {self.robot.n}), got {np.shape(q)}")
        return self.plant.init(q, v)

    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Return the wrapped plant's next state; see :meth:`Plant.step`."""
        return self.plant.step(tau, state, dt)

    def measure(self, state: Any) -> FullState:
        """Return what the wrapped plant's sensors measure; see :meth:`Plant.measure`."""
        return self.plant.measure(state)

    def true_state(self, state: Any) -> PlantState:
        """Return the true state."""
        return self.plant.true_state(state)

    def disturbance(self, t: Array) -> Array | None:
        """Return the wrapped plant's disturbance torque; see :meth:`Plant.disturbance`."""
        return self.plant.disturbance(t)

    def describe(self) -> dict[str, Any]:
        """Return the wrapped plant's parameters, and under "io" those of all wrappers, inner first."""
        inner = self.plant.describe()
        return {**inner, "io": [*inner.get("io", []), {"type": type(self).__name__, **self.values()}]}


class Wrapped(NamedTuple):
    """State of a wrapper that has one of its own.

    Attributes:
        plant: state of the wrapped plant.
        own: state of the wrapper.
    """

    plant: Any
    own: Any


class StatefulWrapper(Wrapper):
    """A wrapper with a state of its own.

    A subclass gives its first state (`start`), its next one (`follow`), and what it does to measurements
    (`measure`) or torques (`step`). The whole state is a :class:`Wrapped`.
    """

    @abstractmethod
    def start(self, plant: Any, q: Array) -> Any:
        """Return the wrapper's own state at time 0.

        Args:
            plant: the wrapped plant's state.
            q: true positions [rad or m], shape (n,) or (batch, n).
        """

    def follow(self, plant: Any, own: Any, dt: float) -> Any:
        """Return the wrapper's own next state; by default it does not change.

        Args:
            plant: the wrapped plant's next state.
            own: the wrapper's state.
            dt: sample time [s].
        """
        return own

    def init(self, q: Array, v: Array) -> Wrapped:
        """Return the state at time 0; see :meth:`Plant.init`."""
        plant = self.plant.init(q, v)
        return Wrapped(plant, self.start(plant, q))

    def step(self, tau: Array, state: Wrapped, dt: float) -> Wrapped:
        """Return the next state; see :meth:`Plant.step`."""
        plant = self.plant.step(tau, state.plant, dt)
        return Wrapped(plant, self.follow(plant, state.own, dt))

    def measure(self, state: Wrapped) -> FullState:
        """Return what the wrapped plant's sensors say."""
        return self.plant.measure(state.plant)

    def true_state(self, state: Wrapped) -> PlantState:
        """Return the true state."""
        return self.plant.true_state(state.plant)
