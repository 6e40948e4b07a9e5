"""Disturbance torques as data: what pushes the joints besides the motors (eqs. 7, 29-31).

A load opposes the motor: D(q) a + C(q, v) v + G(q) = tau - tau_d. Amplitudes are per joint: a number, or
an array of shape (n,) or (batch, n). Times are numbers, or one for each rollout, shape (batch, 1).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, ClassVar

import numpy as np

from armgpi.base.arrays import Array, PerJointInput, as_times, is_listing
from armgpi.base.parameter import Parametrised, PerJoint, parameter, plain, with_parameters
from armgpi.errors import ParameterError
from armgpi.registry import Context


class Load(Parametrised, ABC):
    """A disturbance torque that depends on time; it opposes the motor (eq. 7).

    Attributes:
        config_name: its `type` in experiment files; None for one that has none there.
        shape: shape of the torque at one time, (), (n,) or (batch, n).
    """

    config_name: ClassVar[str | None] = None

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> list[Load]:
        """Return the loads of an entry of an experiment file.

        Args:
            given: parameters by their names, in their units.
            context: what else the experiment is.
        """
        return [cls(**given)]

    @abstractmethod
    def torque(self, t: Array) -> Array:
        """Return the disturbance torque tau_d of eq. 7.

        Args:
            t: times [s], of any shape that broadcasts against the joints: (..., n) or (..., 1).

        Returns:
            Torques [N m or N], shape (..., n).
        """

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the torque at one time, (), (n,) or (batch, n)."""
        return np.shape(self.torque(np.zeros(())))

    def describe(self) -> dict[str, Any]:
        """Return the load as plain data."""
        values = {f.name: plain(getattr(self, f.name)) for f in fields(self)}  # type: ignore[arg-type]
        return {"type": type(self).__name__, **values}

    def __post_init__(self) -> None:
        """Check the values, and that an end comes after the onset."""
        super().__post_init__()
        check_times(getattr(self, "onset", 0.0), getattr(self, "end", math.inf))


@with_parameters
class Step(Load):
    """A constant torque from an onset on.

    Attributes:
        amplitude: torque [N m or N].
        onset: when it begins [s].
        end: when it is over [s].
    """

    config_name: ClassVar[str | None] = "step"

    amplitude: PerJoint = parameter("torque", unit="N m or N", per_joint=True)
    onset: float = parameter("time at which it begins", unit="s", default=0.0)
    end: float = parameter("time at which it is over", unit="s", default=math.inf, unlimited="never")

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        t = as_times(t)
        return _gate(t, self.onset, self.end) * self.amplitude


@with_parameters
class Ramp(Load):
    """A torque that grows from zero at its onset, and stays where it is after its end.

    Attributes:
        slope: growth [N m/s or N/s].
        onset: when it begins to grow [s].
        end: when it stops growing [s].
    """

    config_name: ClassVar[str | None] = "ramp"

    slope: PerJoint = parameter("growth of the torque", unit="N m/s or N/s", per_joint=True)
    onset: float = parameter("time at which it begins", unit="s", default=0.0)
    end: float = parameter("time at which it is over", unit="s", default=math.inf, unlimited="never")

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        t = as_times(t)
        return (np.minimum(np.maximum(t, self.onset), self.end) - self.onset) * self.slope


@with_parameters
class Sine(Load):
    """A torque amplitude sin(omega t + phase), with t the time since 0, from an onset on.

    Attributes:
        amplitude: torque [N m or N].
        omega: angular frequency [rad/s].
        phase: phase at t = 0 [rad]; pi / 2 makes it a cosine.
        onset: when it begins [s].
        end: when it is over [s].
    """

    config_name: ClassVar[str | None] = "sine"

    amplitude: PerJoint = parameter("torque", unit="N m or N", per_joint=True)
    omega: PerJoint = parameter("angular frequency", unit="rad/s", per_joint=True)
    phase: PerJoint = parameter("phase at t = 0", unit="rad", default=0.0, per_joint=True)
    onset: float = parameter("time at which it begins", unit="s", default=0.0)
    end: float = parameter("time at which it is over", unit="s", default=math.inf, unlimited="never")

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        t = as_times(t)
        wave = np.sin(self.omega * t + self.phase)
        return _gate(t, self.onset, self.end) * self.amplitude * wave


@with_parameters
class Pulse(Load):
    """A smooth push and release: amplitude sin^2 over its duration.

    Attributes:
        amplitude: highest torque [N m or N].
        onset: when it begins [s].
        duration: how long it lasts [s].
    """

    config_name: ClassVar[str | None] = "pulse"

    amplitude: PerJoint = parameter("torque", unit="N m or N", per_joint=True)
    onset: float = parameter("time at which it begins", unit="s")
    duration: float = parameter("how long it lasts", unit="s", least=0.0, above=True, log=True)

    def torque(self, t: Array) -> Array:
        """Return the torque; see :meth:`Load.torque`."""
        t = as_times(t)
        x = np.minimum(np.maximum((t - self.onset) / self.duration, 0.0), 1.0)
        push: Array = np.sin(np.pi * x) ** 2 * self.amplitude
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
    if not is_listing(amplitudes) or not is_listing(omegas) or not (phases is None or is_listing(phases)):
        raise ParameterError("amplitudes, omegas and phases", (amplitudes, omegas, phases), "lists")
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


def check_times(onset: Any, end: Any) -> None:
    """Refuse an end before the onset [s]; each may be one per rollout, (batch, 1).

    Raises:
        ParameterError: when there is one.
    """
    if np.any(np.less(end, onset)):
        raise ParameterError("end", plain(end), f"a time after the onset {np.max(onset):g} [s]")


def _gate(t: Array, onset: Any, end: Any) -> Array:
    """Return 1 where onset <= t < end, else 0; each may be one per rollout, (batch, 1)."""
    return np.where((t >= onset) & (t < end), 1.0, 0.0)
