"""Faults of encoders and motors from a time on, for trying what a supervisor does about them."""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.controller import FullState
from armgpi.plants.loads import check_times
from armgpi.plants.plant import PlantState, StatefulWrapper, Wrapped, Wrapper


class Broken(NamedTuple):
    """State of :class:`SensorFault`.

    Attributes:
        last: the last measurement before the fault [rad or m].
        seen: what is measured.
    """

    last: Array
    seen: FullState


@with_parameters
class SensorFault(StatefulWrapper):
    """Encoders that fail at a time: that freeze, jump, count wrongly or backwards, or deliver nothing.

    A position measured as q is last + gain (q - last) + offset then, with the last one before the fault. The
    first measurement of all is always good.

    Attributes:
        onset: when it begins [s], a number or (batch, 1).
        end: when it is over [s], likewise.
        gain: of what is measured since [-], shape (n,) or (batch, n).
        offset: added to positions [rad or m], likewise.
        lost: above 0.5 where nothing is measured, NaN, likewise.
    """

    config_name: ClassVar[str | None] = "sensor_fault"
    order: ClassVar[float] = 45.0

    onset: Any = parameter("when encoders fail", unit="s", least=0.0)
    end: Any = parameter("when they are well again", unit="s", default=math.inf, unlimited="never")
    gain: PerJoint = parameter(
        "measured change for a change: 0 for an encoder that is frozen, -1 for one that counts backwards",
        default=1.0,
        per_joint=True,
    )
    offset: PerJoint = parameter(
        "jump of the measured position", unit="rad or m", default=0.0, per_joint=True
    )
    lost: PerJoint = parameter(
        "1 for an encoder that measures nothing (NaN)", default=0.0, least=0.0, most=1.0, per_joint=True
    )

    def __post_init__(self) -> None:
        """Check the values."""
        super().__post_init__()
        check_times(self.onset, self.end)

    def start(self, plant: Any, q: Array) -> Broken:
        """Return the first measurement; see :meth:`StatefulWrapper.start`."""
        seen = self.plant.measure(plant)
        return Broken(seen.q, seen)

    def follow(self, plant: Any, own: Broken, dt: float) -> Broken:
        """Return what is measured, with or without the fault; see :meth:`StatefulWrapper.follow`."""
        good, truth = self.plant.measure(plant), self.plant.true_state(plant)
        begun = _has_begun(truth, self.onset, dt)
        last = np.where(begun > 0.0, own.last, good.q)
        failing = begun > _has_begun(truth, self.end, dt)
        q = last + self.gain * (good.q - last) + self.offset
        q, v = (np.where(self.lost > 0.5, math.nan, x) for x in (q, self.gain * good.v))
        return Broken(last, FullState(np.where(failing, q, good.q), np.where(failing, v, good.v)))

    def measure(self, state: Wrapped) -> FullState:
        """Return what is measured, with or without the fault; see :meth:`Plant.measure`."""
        seen: FullState = state.own.seen
        return seen


@with_parameters
class MotorFault(Wrapper):
    """Motors that fail at a time: that are dead, weak, or turn the other way.

    Attributes:
        onset: when it begins [s], a number or (batch, 1).
        end: when it is over [s], likewise.
        gain: share of the torque asked for that they give [-], shape (n,) or (batch, n).
    """

    config_name: ClassVar[str | None] = "motor_fault"
    order: ClassVar[float] = 5.0

    onset: Any = parameter("when motors fail", unit="s", least=0.0)
    end: Any = parameter("when they are well again", unit="s", default=math.inf, unlimited="never")
    gain: PerJoint = parameter(
        "share of its torque that a motor produces: 0 for a dead one, -1 for reversed sign",
        default=0.0,
        per_joint=True,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        super().__post_init__()
        check_times(self.onset, self.end)

    def step(self, tau: Array, state: Any, dt: float) -> Any:
        """Return the next state under what the motors give; see :meth:`Plant.step`."""
        truth = self.plant.true_state(state)
        failing = _has_begun(truth, self.onset, dt) > _has_begun(truth, self.end, dt)
        return self.plant.step(np.where(failing, self.gain, 1.0) * tau, state, dt)


def _has_begun(truth: PlantState, time: Any, dt: float) -> Array:
    """Return 1 from a time on, else 0, of the shape of a position; half a sample is for rounding."""
    return np.where(truth.k * dt + np.zeros_like(truth.q) >= time - 0.5 * dt, 1.0, 0.0)
