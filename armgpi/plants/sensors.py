"""What stands between the true state and the controller: encoder steps, noise, delay, drop-outs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.arrays import Array, PerJointInput, check_number, check_whole, not_negative, per_joint, positive
from armgpi.control.controller import FullState, common_batch
from armgpi.plants import noise
from armgpi.plants.plant import Plant, Wrapper


class Encoder(Wrapper):
    """Positions in steps of an encoder; velocities stay as they are.

    Attributes:
        bits: resolution, shape (n,) or (batch, n).
        step_size: one count [rad or m], likewise: a turn / 2^bits, for a prismatic joint its
            travel / 2^bits (1 m where it has no limits).
    """

    def __init__(self, plant: Plant, bits: PerJointInput = 16) -> None:
        """Put an encoder of `bits` bits (whole numbers from 1 to 52) on every joint of `plant`."""
        super().__init__(plant)
        names = plant.robot.joint_names
        if np.ndim(bits) == 0:
            bits = check_whole(bits, "bits", 1, 52)
        self.bits = per_joint(bits, "bits", names, "whole numbers from 1 to 52 as", _are_bits)
        self.batch = common_batch(plant.batch, self.bits)
        travel = plant.robot.limits.upper - plant.robot.limits.lower
        linear = np.array([kind == "prismatic" for kind in plant.robot.joint_types])
        self.step_size = (
            np.where(linear, np.where(np.isfinite(travel) & (travel > 0.0), travel, 1.0), 2.0 * math.pi)
            / 2.0**self.bits
        )

    def measure(self, state: Any) -> FullState:
        """Return positions rounded to the nearest count."""
        q, v = self.plant.measure(state)
        return FullState(np.rint(q / self.step_size) * self.step_size, v)

    def parameters(self) -> dict[str, Any]:
        """Return the resolution."""
        whole = self.bits.astype(int)
        return {"bits": int(whole.flat[0]) if (whole == whole.flat[0]).all() else whole.tolist()}


class Noisy(Wrapper):
    """White Gaussian noise on the measurements.

    Attributes:
        std_q: standard deviation of positions [rad or m], shape (n,) or (batch, n).
        std_v: standard deviation of velocities [rad/s or m/s], likewise.
        seed: seed of rollout 0; rollout i of a batch uses seed + i.
    """

    def __init__(self, plant: Plant, std_q: PerJointInput, std_v: PerJointInput = 0.0, seed: int = 0) -> None:
        """Put noise on the measurements of `plant`."""
        super().__init__(plant)
        names = plant.robot.joint_names
        self.std_q = per_joint(std_q, "std_q", names, "zero or positive", not_negative)
        self.std_v = per_joint(std_v, "std_v", names, "zero or positive", not_negative)
        self.batch = common_batch(plant.batch, self.std_q, self.std_v)
        self.seed = check_whole(seed, "seed", 0)

    def measure(self, state: Any) -> FullState:
        """Return the measurements with the noise of this sample."""
        q, v = self.plant.measure(state)
        k = self.plant.true_state(state).k
        return FullState(
            q + self.std_q * noise.normal(self.seed, k, q.shape, 0),
            v + self.std_v * noise.normal(self.seed, k, v.shape, 1),
        )

    def parameters(self) -> dict[str, Any]:
        """Return deviations and seed."""
        return {"std_q": self.std_q.tolist(), "std_v": self.std_v.tolist(), "seed": self.seed}


class _Late(NamedTuple):
    plant: Any
    waiting: tuple[FullState, ...]


class Delayed(Wrapper):
    """Measurements that arrive some samples late.

    Attributes:
        samples: how many.
    """

    def __init__(self, plant: Plant, samples: int = 1) -> None:
        """Delay the measurements of `plant` by `samples` (0 or more)."""
        super().__init__(plant)
        self.samples = check_whole(samples, "samples", 0)

    def init(self, q: Array, v: Array) -> _Late:
        """Return the state; before time 0 the arm stood at its start."""
        state = self.plant.init(q, v)
        return _Late(state, (self.plant.measure(state),) * (self.samples + 1))

    def step(self, tau: Array, state: _Late, dt: float) -> _Late:
        """Return the next state with its measurement at the end of the queue."""
        plant = self.plant.step(tau, state.plant, dt)
        return _Late(plant, (*state.waiting[1:], self.plant.measure(plant)))

    def measure(self, state: _Late) -> FullState:
        """Return the measurement that arrives now."""
        return state.waiting[0]

    def true_state(self, state: _Late) -> Any:
        """Return the true state."""
        return self.plant.true_state(state.plant)

    def parameters(self) -> dict[str, Any]:
        """Return the delay."""
        return {"samples": self.samples}


class _Differences(NamedTuple):
    plant: Any
    seen: FullState


class Differentiated(Wrapper):
    """Velocities from filtered differences of the measured positions: what a drive without a tachometer has.

    The filter is bandwidth s / (s + bandwidth), by the trapezoidal rule.

    Attributes:
        bandwidth: of the filter [rad/s], shape (n,) or (batch, n).
    """

    def __init__(self, plant: Plant, bandwidth: PerJointInput = 200.0) -> None:
        """Differentiate what the sensors of `plant` say, with a filter of `bandwidth` [rad/s]."""
        super().__init__(plant)
        names = plant.robot.joint_names
        self.bandwidth = per_joint(bandwidth, "bandwidth", names, "positive [rad/s]", positive)
        self.batch = common_batch(plant.batch, self.bandwidth)

    def init(self, q: Array, v: Array) -> _Differences:
        """Return the state; before time 0 the arm stood still."""
        state = self.plant.init(q, v)
        measured = self.plant.measure(state)
        return _Differences(state, FullState(measured.q, np.zeros_like(measured.v)))

    def step(self, tau: Array, state: _Differences, dt: float) -> _Differences:
        """Return the next state with its velocities."""
        plant = self.plant.step(tau, state.plant, dt)
        q = self.plant.measure(plant).q
        half = 0.5 * self.bandwidth * dt
        decay = (1.0 - half) / (1.0 + half)
        v = decay * state.seen.v + self.bandwidth / (1.0 + half) * (q - state.seen.q)
        return _Differences(plant, FullState(q, v))

    def measure(self, state: _Differences) -> FullState:
        """Return the positions as they are measured, and the velocities."""
        return state.seen

    def true_state(self, state: _Differences) -> Any:
        """Return the true state."""
        return self.plant.true_state(state.plant)

    def parameters(self) -> dict[str, Any]:
        """Return the bandwidth."""
        return {"bandwidth": self.bandwidth.tolist()}


class _Held(NamedTuple):
    plant: Any
    last: FullState


class DropOut(Wrapper):
    """Measurements that are lost at random; the last one that arrived stands in.

    Attributes:
        probability: share of samples lost, joint by joint.
        seed: seed of rollout 0; rollout i of a batch uses seed + i.
    """

    def __init__(self, plant: Plant, probability: float, seed: int = 0) -> None:
        """Lose measurements of `plant` with `probability` (0 to below 1)."""
        super().__init__(plant)
        self.probability = check_number(probability, "probability", "in [0, 1)", highest=1.0 - 1e-12)
        self.seed = check_whole(seed, "seed", 0)

    def init(self, q: Array, v: Array) -> _Held:
        """Return the state; the first measurement arrives."""
        state = self.plant.init(q, v)
        return _Held(state, self.plant.measure(state))

    def step(self, tau: Array, state: _Held, dt: float) -> _Held:
        """Return the next state with what arrived."""
        plant = self.plant.step(tau, state.plant, dt)
        q, v = self.plant.measure(plant)
        lost = noise.uniform(self.seed, self.plant.true_state(plant).k, q.shape, 4) < self.probability
        return _Held(plant, FullState(np.where(lost, state.last.q, q), np.where(lost, state.last.v, v)))

    def measure(self, state: _Held) -> FullState:
        """Return the last measurement that arrived."""
        return state.last

    def true_state(self, state: _Held) -> Any:
        """Return the true state."""
        return self.plant.true_state(state.plant)

    def parameters(self) -> dict[str, Any]:
        """Return probability and seed."""
        return {"probability": self.probability, "seed": self.seed}


def _are_bits(bits: Array) -> npt.NDArray[np.bool_]:
    """Tell which numbers of bits an encoder can have."""
    return np.asarray((bits >= 1.0) & (bits <= 52.0) & (bits == np.rint(bits)))
