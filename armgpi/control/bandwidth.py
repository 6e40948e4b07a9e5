"""A bandwidth that suits any robot without tuning, by how late its torques are."""

from __future__ import annotations

import math

from armgpi.arrays import check_number

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
