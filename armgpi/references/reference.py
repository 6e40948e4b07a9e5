"""The reference protocol: position, velocity and acceleration asked for at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError


class Target(NamedTuple):
    """Reference of the joints; arrays of shape (n,), (batch, n) or with leading times.

    Attributes:
        q: positions [rad or m].
        v: velocities [rad/s or m/s].
        a: accelerations [rad/s^2 or m/s^2].
    """

    q: Array
    v: Array
    a: Array


class Reference(ABC):
    """A trajectory q*(t) with its first two derivatives.

    Attributes:
        symbolic: whether :meth:`at` is arithmetic alone, which also takes a symbol for the time; generated
            code then works it out, and reads it from a table otherwise.
    """

    symbolic: ClassVar[bool] = False

    def variables(self) -> dict[str, Any]:
        """Return what may be given anew, by name: see :meth:`with_values`; nothing by default."""
        return {}

    def with_values(self, **changes: Any) -> Reference:
        """Return the same trajectory with other numbers.

        Args:
            **changes: name of one of :meth:`variables` -> value; configurations (n,) or (batch, n), times a
                number or (batch, 1).

        Raises:
            ParameterError: for a name that is none of them.
        """
        raise ParameterError(", ".join(changes), type(self).__name__, "a reference that has such a parameter")

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
