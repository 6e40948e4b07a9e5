"""Sensors between the true state and the controller: encoder steps, noise, delay, drop-outs."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, plain, with_parameters
from armgpi.control.bandwidth import FilteredDifference
from armgpi.control.controller import FullState
from armgpi.errors import ParameterError
from armgpi.plants import noise
from armgpi.plants.plant import StatefulWrapper, Wrapped, Wrapper


@with_parameters
class Encoder(Wrapper):
    """Positions in steps of an encoder; velocities stay as they are.

    Attributes:
        bits: resolution, shape (n,) or (batch, n).
        step_size: one count [rad or m], likewise; see :meth:`armgpi.Robot.encoder_count`.
    """

    config_name: ClassVar[str | None] = "encoder_bits"
    order: ClassVar[float] = 40.0

    bits: PerJoint = parameter(
        "encoder resolution",
        unit="bits",
        kind="integer",
        default=16,
        least=1,
        most=52,
        per_joint=True,
        slider=(8, 24),
    )

    def __post_init__(self) -> None:
        """Check the resolution and work out a count."""
        super().__post_init__()
        self.step_size = self.robot.encoder_count(self.bits)

    def measure(self, state: Any) -> FullState:
        """Return positions rounded to the nearest count; see :meth:`Plant.measure`."""
        q, v = self.plant.measure(state)
        return FullState(np.rint(q / self.step_size) * self.step_size, v)

    def values(self) -> dict[str, Any]:
        """Return the resolution: one number where all joints have the same."""
        whole = self.bits.astype(int)
        return {"bits": int(whole.flat[0]) if (whole == whole.flat[0]).all() else whole.tolist()}


@with_parameters
class Noisy(Wrapper):
    """White Gaussian noise on the measurements.

    Attributes:
        std_q: standard deviation of positions [rad or m], shape (n,) or (batch, n).
        std_v: standard deviation of velocities [rad/s or m/s], likewise.
        seed: seed of rollout 0, as rollout i of a batch uses seed + i; or those of all rollouts, (batch,).
    """

    config_name: ClassVar[str | None] = "noise"
    order: ClassVar[float] = 30.0

    std_q: PerJoint = parameter(
        "standard deviation of measured positions",
        unit="rad or m",
        default=0.0,
        least=0.0,
        per_joint=True,
        key="position",
        log=True,
    )
    std_v: PerJoint = parameter(
        "standard deviation of measured velocities",
        unit="rad/s or m/s",
        default=0.0,
        least=0.0,
        per_joint=True,
        key="velocity",
        log=True,
    )
    seed: Any = parameter("seed of rollout 0", kind="seed", default=0, least=0, in_file=False)

    def measure(self, state: Any) -> FullState:
        """Return the measurements with the noise of this sample; see :meth:`Plant.measure`."""
        q, v = self.plant.measure(state)
        k = self.plant.true_state(state).k
        return FullState(
            q + self.std_q * noise.normal(self.seed, k, q.shape, 0),
            v + self.std_v * noise.normal(self.seed, k, v.shape, 1),
        )


@with_parameters
class Delayed(StatefulWrapper):
    """Measurements that arrive some samples late; before time 0 the arm was at rest at its start.

    Attributes:
        samples: delay in samples, 0 for none; or one for each rollout, shape (batch, 1).
        longest: length of the queue where rollouts differ [samples]; the longest delay when not given.
    """

    config_name: ClassVar[str | None] = "delay"
    order: ClassVar[float] = 70.0
    off: ClassVar[Any] = 0

    samples: Any = parameter(
        "delay of the measurements, in samples",
        kind="integer",
        default=1,
        least=0,
        most=10_000,
        slider=(0, 20),
    )
    longest: int | None = parameter(
        "length of the queue where rollouts differ",
        unit="samples",
        kind="integer",
        default=None,
        none="the longest delay",
        least=0,
        most=10_000,
        in_file=False,
        structural=True,
    )

    def __post_init__(self) -> None:
        """Check the delay.

        Raises:
            ParameterError: when a delay is longer than the queue.
        """
        super().__post_init__()
        most = int(np.max(self.samples))
        if self.longest is not None and most > self.longest:
            raise ParameterError("samples", most, f"at most the length of the queue, {self.longest}")
        self._length = most if self.longest is None else self.longest

    def start(self, plant: Any, q: Array) -> tuple[FullState, ...]:
        """Return the queue of measurements; see :meth:`StatefulWrapper.start`."""
        return (self.plant.measure(plant),) * (self._length + 1)

    def follow(self, plant: Any, own: tuple[FullState, ...], dt: float) -> tuple[FullState, ...]:
        """Return the queue with the newest measurement at its end; see :meth:`StatefulWrapper.follow`."""
        return (*own[1:], self.plant.measure(plant))

    def measure(self, state: Wrapped) -> FullState:
        """Return the measurement that arrives now; see :meth:`Plant.measure`."""
        if isinstance(self.samples, int):
            arrived: FullState = state.own[self._length - self.samples]
            return arrived
        q, v = state.own[-1]
        for late, (q_late, v_late) in enumerate(reversed(state.own[:-1]), start=1):
            q, v = np.where(self.samples == late, q_late, q), np.where(self.samples == late, v_late, v)
        return FullState(q, v)

    def values(self) -> dict[str, Any]:
        """Return the delay."""
        return {"samples": plain(self.samples)}


@with_parameters
class Differentiated(StatefulWrapper):
    """Velocities from filtered differences of the measured positions: what a drive without a tachometer has.

    The filter is bandwidth s / (s + bandwidth), by the trapezoidal rule. Before time 0 the arm was at rest.

    Attributes:
        bandwidth: of the filter [rad/s], shape (n,) or (batch, n).
    """

    config_name: ClassVar[str | None] = "velocity_bandwidth"
    order: ClassVar[float] = 50.0

    bandwidth: PerJoint = parameter(
        "velocities are differences of measured positions, filtered with this bandwidth",
        unit="rad/s",
        default=200.0,
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        slider=(10.0, 1000.0),
    )

    def start(self, plant: Any, q: Array) -> FullState:
        """Return the first measurement, at rest; see :meth:`StatefulWrapper.start`."""
        measured = self.plant.measure(plant)
        return FullState(measured.q, np.zeros_like(measured.v))

    def follow(self, plant: Any, own: FullState, dt: float) -> FullState:
        """Return the positions as measured, and their differences; see :meth:`StatefulWrapper.follow`."""
        q = self.plant.measure(plant).q
        decay, drive = FilteredDifference.of(self.bandwidth, dt)
        return FullState(q, decay * own.v + drive * (q - own.q))

    def measure(self, state: Wrapped) -> FullState:
        """Return measured positions, and velocities from their differences; see :meth:`Plant.measure`."""
        seen: FullState = state.own
        return seen


@with_parameters
class DropOut(StatefulWrapper):
    """Measurements that are dropped at random; the last one that arrived replaces them.

    The first one always arrives.

    Attributes:
        probability: share of samples dropped [-], joint by joint, in [0, 1), a number or (batch, 1).
        seed: seed of rollout 0, as rollout i of a batch uses seed + i; or those of all rollouts, (batch,).
    """

    config_name: ClassVar[str | None] = "drop_out"
    order: ClassVar[float] = 60.0
    off: ClassVar[Any] = 0.0

    probability: Any = parameter(
        "share of measurements that are dropped", least=0.0, most=1.0, below=True, slider=(0.0, 0.9)
    )
    seed: Any = parameter("seed of rollout 0", kind="seed", default=0, least=0, in_file=False)

    def start(self, plant: Any, q: Array) -> FullState:
        """Return the first measurement; see :meth:`StatefulWrapper.start`."""
        return self.plant.measure(plant)

    def follow(self, plant: Any, own: FullState, dt: float) -> FullState:
        """Return the last measurement that arrived; see :meth:`StatefulWrapper.follow`."""
        q, v = self.plant.measure(plant)
        lost = noise.uniform(self.seed, self.plant.true_state(plant).k, q.shape, 4) < self.probability
        return FullState(np.where(lost, own.q, q), np.where(lost, own.v, v))

    def measure(self, state: Wrapped) -> FullState:
        """Return the last measurement that arrived; see :meth:`Plant.measure`."""
        seen: FullState = state.own
        return seen
