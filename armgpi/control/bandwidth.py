"""A bandwidth that suits any robot without tuning, by how late its torques are; and what raises it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, check_number
from armgpi.base.parameter import Parametrised, PerJoint, parameter, with_parameters
from armgpi.errors import ParameterError
from armgpi.registry import Context

#: Resolution [bits] whose count is the scale of small errors without an encoder.
_FINE_BITS = 22
#: Bandwidth times delay [-]: less than a third of what the printed law tolerates, 0.356.
PHASE = 0.1


def default_bandwidth(dt: float, delay: float = 0.0, highest: float = 30.0, phase: float = PHASE) -> float:
    """Return a bandwidth [rad/s]; see :func:`armgpi.default_omega`.

    Args:
        dt: sample time [s].
        delay: transport delay in the loop [s].
        highest: cap [rad/s]; infinite for none.
        phase: bandwidth times delay [-].

    Raises:
        ParameterError: when a number is out of its range.
    """
    dt = check_number(dt, "dt", "a positive sample time [s]", open_=True)
    delay = check_number(delay, "delay", "zero or positive [s]")
    if not (isinstance(highest, float) and highest == math.inf):
        highest = check_number(highest, "highest", "positive [rad/s]", open_=True)
    return min(phase / (1.5 * dt + delay), highest)


class FilteredDifference(NamedTuple):
    """bandwidth s / (s + bandwidth) by the trapezoidal rule: rate = decay rate + drive (q - q before).

    Attributes:
        decay: share of the rate that a sample leaves [-].
        drive: from a difference of positions into the rate [1/s].
    """

    decay: Any
    drive: Any

    @classmethod
    def of(cls, bandwidth: Any, dt: float) -> FilteredDifference:
        """Return the coefficients for a bandwidth [rad/s], a number or an array, and a sample time [s]."""
        half = 0.5 * bandwidth * dt
        return cls((1.0 - half) / (1.0 + half), bandwidth / (1.0 + half))


def error_scales(context: Context) -> dict[str, Any]:
    """Return the scales of errors that an experiment takes: a count, and a dead zone of two."""
    count = context.robot.encoder_count(_FINE_BITS if context.bits is None else context.bits)
    return {"error_range": count, "dead_zone": 0.0 * count if context.bits is None else 2.0 * count}


@with_parameters
class ErrorSchedule(Parametrised):
    """What raises a bandwidth with the size of the error: attack and leak."""

    attack: PerJoint = parameter(
        "share of the remaining difference by which omega changes in a sample",
        default=0.2,
        least=0.0,
        most=1.0,
        per_joint=True,
        search=(0.01, 1.0),
        slider=(0.0, 1.0),
        kw_only=True,
    )
    leak: float = parameter(
        "how fast it falls back", unit="1/s", default=5.0, least=0.0, search=(0.1, 50.0), kw_only=True
    )
    error_range: PerJoint = parameter(
        "error beyond the dead zone from which omega goes to the upper end of its range",
        unit="rad or m",
        default=1e-4,
        least=0.0,
        above=True,
        per_joint=True,
        chosen="an encoder count; one of 22 bits without encoder",
        log=True,
        search=(1e-6, 1e-2),
        kw_only=True,
    )
    dead_zone: PerJoint = parameter(
        "error that does not raise the gain, such as two encoder counts",
        unit="rad or m",
        default=2e-4,
        least=0.0,
        per_joint=True,
        chosen="two encoder counts; 0 without encoder",
        log=True,
        search=(1e-6, 1e-2),
        kw_only=True,
    )

    def check_leak(self, dt: float) -> None:
        """Refuse a leak that is too fast for the sample time.

        Raises:
            ParameterError: when it is.
        """
        if (leak := float(np.max(self.leak))) * dt >= 1.0:
            raise ParameterError("leak", leak, f"below 1 / dt = {1.0 / dt:g} 1/s")

    def raised(self, w: Array, e: Array, span: Array, learn: Array, dt: float) -> Array:
        """Return by how much something is above its lower end after a sample.

        Args:
            w: the same before.
            e: tracking error [rad or m]; NaN changes nothing.
            span: upper end above the lower one.
            learn: share of the change that is made; 0 while the torque is cut.
            dt: sample time [s].
        """
        sound = np.abs(e) < math.inf
        size = np.where(sound, np.abs(e), 0.0) - self.dead_zone
        aim = span * np.minimum(np.maximum(size, 0.0) / self.error_range, 1.0)
        change = self.attack * np.maximum(aim - w, 0.0) - self.leak * dt * w
        after: Array = w + np.where(sound, learn, 0.0) * change
        return after
