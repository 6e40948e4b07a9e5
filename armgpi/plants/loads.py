"""Disturbance torques as data: what pushes the joints besides the motors (eqs. 7, 29-31).

A load opposes the motor: D(q) a + C(q, v) v + G(q) = tau - tau_d. Amplitudes are per joint: a number, or
an array of shape (n,) or (batch, n).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, cast

import numpy as np

from armgpi.arrays import Array, PerJointInput, as_float_array, check_number
from armgpi.errors import ParameterError


class Load(ABC):
    """A disturbance torque that depends on time."""

    @abstractmethod
    def torque(self, t: Array) -> Array:
        """Return tau_d at the times `t` [s], of any shape that broadcasts against the joints: (..., n)."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the torque at one time, (), (n,) or (batch, n)."""
        return np.shape(self.torque(np.zeros(())))

    def describe(self) -> dict[str, Any]:
        """Return the load as plain data."""
        values = {f.name: _plain(getattr(self, f.name)) for f in fields(self)}  # type: ignore[arg-type]
        return {"type": type(self).__name__, **values}


@dataclass(frozen=True)
class Step(Load):
    """A constant torque from an onset on.

    Attributes:
        amplitude: torque [N m or N].
        onset: when it begins [s].
        end: when it is over [s].
    """

    amplitude: PerJointInput
    onset: float = 0.0
    end: float = math.inf

    def __post_init__(self) -> None:
        """Check the values."""
        _check(self, arrays=("amplitude",))

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        return _gate(t, self.onset, self.end) * _array(self.amplitude)


@dataclass(frozen=True)
class Ramp(Load):
    """A torque that grows from zero at its onset, and stays where it is after its end.

    Attributes:
        slope: growth [N m/s or N/s].
        onset: when it begins to grow [s].
        end: when it stops growing [s].
    """

    slope: PerJointInput
    onset: float = 0.0
    end: float = math.inf

    def __post_init__(self) -> None:
        """Check the values."""
        _check(self, arrays=("slope",))

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        return (np.minimum(np.maximum(t, self.onset), self.end) - self.onset) * _array(self.slope)


@dataclass(frozen=True)
class Sine(Load):
    """A torque amplitude sin(omega t + phase), with t the time since 0, from an onset on.

    Attributes:
        amplitude: torque [N m or N].
        omega: angular frequency [rad/s].
        phase: phase at t = 0 [rad]; pi / 2 makes it a cosine.
        onset: when it begins [s].
        end: when it is over [s].
    """

    amplitude: PerJointInput
    omega: PerJointInput
    phase: PerJointInput = 0.0
    onset: float = 0.0
    end: float = math.inf

    def __post_init__(self) -> None:
        """Check the values."""
        _check(self, arrays=("amplitude", "omega", "phase"))

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        wave = np.sin(_array(self.omega) * t + _array(self.phase))
        return _gate(t, self.onset, self.end) * _array(self.amplitude) * wave


@dataclass(frozen=True)
class Pulse(Load):
    """A smooth push and release: amplitude sin^2 over its duration.

    Attributes:
        amplitude: highest torque [N m or N].
        onset: when it begins [s].
        duration: how long it lasts [s].
    """

    amplitude: PerJointInput
    onset: float
    duration: float

    def __post_init__(self) -> None:
        """Check the values."""
        _check(self, arrays=("amplitude",))
        check_number(self.duration, "duration", "positive [s]", open_=True)

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        x = np.minimum(np.maximum((t - self.onset) / self.duration, 0.0), 1.0)
        push: Array = np.sin(np.pi * x) ** 2 * _array(self.amplitude)
        return push


def multi_sine(
    amplitudes: Sequence[PerJointInput],
    omegas: Sequence[PerJointInput],
    phases: Sequence[PerJointInput] | None = None,
    onset: float = 0.0,
) -> list[Sine]:
    """Return a sum of sines as a list of loads.

    Args:
        amplitudes: of each sine [N m or N].
        omegas: of each sine [rad/s].
        phases: of each sine [rad], zero when not given.
        onset: when they begin [s].

    Raises:
        ParameterError: when the sequences differ in length.
    """
    phases = [0.0] * len(amplitudes) if phases is None else phases
    if not len(amplitudes) == len(omegas) == len(phases):
        raise ParameterError("omegas", omegas, f"as many as amplitudes and phases ({len(amplitudes)})")
    return [Sine(a, w, p, onset) for a, w, p in zip(amplitudes, omegas, phases, strict=True)]


def paper_disturbances() -> list[Sine]:
    """Return the vibrating torques of scenario 3 on the paper's arm, eqs. 29-31."""
    cosine = math.pi / 2.0
    return [
        Sine([0.7, 0.0, 0.0], 0.1, cosine, onset=10.0),  # eq. 29
        Sine([0.0, 0.3, 0.0], 0.1, cosine, onset=15.0),  # eq. 30
        Sine([0.0, 0.2, 0.0], 0.5, onset=15.0),
        Sine([0.0, 0.0, 0.2], 0.1, onset=20.0),  # eq. 31
        Sine([0.0, 0.0, 0.1], 0.5, onset=20.0),
    ]


def _array(value: PerJointInput) -> Array:
    """Return a field of a load, which its check has made an array already."""
    return cast(Array, value)


def _gate(t: Array, onset: float, end: float) -> Array:
    """Return 1 where onset <= t < end, else 0."""
    return np.where((t >= onset) & (t < end), 1.0, 0.0)


def _check(load: Any, arrays: Sequence[str]) -> None:
    """Check a load's numbers and make arrays of its per-joint ones."""
    for name in arrays:
        object.__setattr__(load, name, as_float_array(getattr(load, name), name))
    onset = check_number(load.onset, "onset", "a finite time [s]", lowest=-math.inf)
    if getattr(load, "end", math.inf) != math.inf:
        check_number(load.end, "end", f"a time after the onset {onset:g} [s]", lowest=onset)


def _plain(value: Any) -> Any:
    """Return an array as a list, another value as it is."""
    return value.tolist() if isinstance(value, np.ndarray) else value
