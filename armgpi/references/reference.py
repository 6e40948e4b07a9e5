"""The reference protocol: position, velocity and acceleration asked for at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

from armgpi.arrays import Array, ArrayLike


class Target(NamedTuple):
    """What is asked of the joints; arrays of shape (n,), (batch, n) or with leading times.

    Attributes:
        q: positions [rad or m].
        v: velocities [rad/s or m/s].
        a: accelerations [rad/s^2 or m/s^2].
    """

    q: Array
    v: Array
    a: Array


class Reference(ABC):
    """A trajectory q*(t) with its first two derivatives."""

    @abstractmethod
    def at(self, t: float | Array) -> Target:
        """Return the target at time(s) `t`.

        Args:
            t: a time [s], or times of shape (k,).

        Returns:
            Arrays of shape (n,) or (batch, n); with times, of shape (k, n) or (k, batch, n).
        """

    def describe(self) -> dict[str, Any]:
        """Return the trajectory as plain data, for a rollout's provenance."""
        return {"type": type(self).__name__, "text": repr(self)}


class Hold(Reference):
    """Stand still at one posture."""

    def __init__(self, q: ArrayLike) -> None:
        """Hold `q` [rad or m], shape (n,) or (batch, n)."""
        from armgpi.references.waypoints import Waypoints

        self.q = q
        self._at = Waypoints([q], durations=[]).at

    def describe(self) -> dict[str, Any]:
        """Return the posture as plain data."""
        return {"type": "Hold", "q": self._at(0.0).q.tolist()}

    def at(self, t: float | Array) -> Target:
        """Return the posture with zero velocity and acceleration, shapes as :meth:`Reference.at`."""
        return self._at(t)
