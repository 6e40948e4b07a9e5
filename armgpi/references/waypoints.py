"""A sequence of smooth moves with holds between them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, ArrayLike, as_sized_array, is_listing
from armgpi.errors import ArrayError, ParameterError
from armgpi.references.bezier import Bezier, time
from armgpi.references.reference import Reference, Target

#: Share of a time by which rounding may move the end of a move, with much to spare [-].
_BORDER = 1e-12


class Waypoints(Reference):
    """Go from configuration to configuration by Bezier moves, standing still at each for a while.

    Attributes:
        moves: the moves, one :class:`Bezier` from each waypoint to the next.
        t_end: when the last hold is over [s], in every rollout.
    """

    symbolic = True

    def __init__(
        self,
        points: Sequence[ArrayLike],
        durations: ArrayLike | Sequence[ArrayLike] | None = None,
        holds: ArrayLike | Sequence[ArrayLike] = 0.0,
        velocity_limit: ArrayLike = math.inf,
        acceleration_limit: ArrayLike = math.inf,
    ) -> None:
        """Define the sequence, from t = 0.

        Args:
            points: m configurations [rad or m], each of shape (n,) or (batch, n).
            durations: of the m - 1 moves [s]: a number for all, one for each, or None for the shortest
                ones that keep the limits. Each may be one per rollout, shape (batch, 1).
            holds: how long to stand at each of the m configurations [s]: a number for all or one for each,
                likewise.
            velocity_limit: highest speeds [rad/s or m/s], used when there are no durations.
            acceleration_limit: highest accelerations [rad/s^2 or m/s^2], likewise.

        Raises:
            ArrayError: when the configurations do not match.
            ParameterError: when there is no configuration, or numbers of durations or holds do not fit.
        """
        if not is_listing(points) or len(points) == 0:
            raise ParameterError("points", points, "at least one configuration")
        legs = max(len(points) - 1, 0)
        times = _per_item(durations, "durations", legs)
        stands = _per_item(holds, "holds", len(points))
        stands = [time(hold, "holds", "zero or positive, finite times [s]") for hold in stands]
        configurations = _one_shape(points, [*times, *stands])
        self._as_given = {"points": configurations, "durations": times, "holds": stands}
        moves = []
        t: Any = stands[0]
        for leg in range(legs):
            move = Bezier(
                configurations[leg],
                configurations[leg + 1],
                times[leg],
                t,
                velocity_limit,
                acceleration_limit,
            )
            moves.append(move)
            times[leg] = move.duration
            t = t + (move.duration + stands[leg + 1])
        self.moves = tuple(moves)
        self.t_end = float(np.max(t))
        # A single configuration is a move to itself.
        self._parts = self.moves or (Bezier(configurations[0], configurations[0]),)

    def variables(self) -> dict[str, Any]:
        """Return points, durations and holds, one by one; see :meth:`Reference.variables`."""
        numbered = {}
        for name, values in self._as_given.items():
            for place, value in enumerate(values):
                numbered[f"{name}.{place}"] = value
        return numbered

    def with_values(self, **changes: Any) -> Waypoints:
        """Return another sequence; see :meth:`Reference.with_values`."""
        values = {name: list(listed) for name, listed in self._as_given.items()}
        for numbered, value in changes.items():
            name, _, place = numbered.partition(".")
            values[name][int(place)] = value
        return type(self)(**values)

    def at(self, t: float | Array) -> Target:
        """Return the target at `t` [s]; shapes as :meth:`Reference.at`.

        A single time costs one move, however many there are, and gives the same numbers as an array of times.
        """
        if isinstance(t, float) and math.isfinite(t) and self._legs:
            last_begun = bisect_right(self._legs, t, key=_begin) - 1
            leg = self._legs[max(last_begun, 0)]
            # Where one begins, rounding may leave the move before it short of its end by a last bit.
            if leg.reached is None or t > leg.begin + _BORDER * (1.0 + abs(t)):
                q, v, a = leg.move.at(float(t))
                if leg.reached is not None:
                    q = leg.reached + (q - leg.move.start)
                return Target(q, v, a)
        first, *others = self._parts
        # Each move adds its own way to where the one before it ends.
        q, v, a = first.at(t)
        for move in others:
            target = move.at(t)
            q = q + (target.q - move.start)
            v = v + target.v
            a = a + target.a
        return Target(q, v, a)

    @cached_property
    def _legs(self) -> list[_Leg]:
        """The moves as single times need them; a sequence only joined into a batch never works them out."""
        return _legs(self._parts)

    def describe(self) -> dict[str, Any]:
        """Return the moves as plain data."""
        moves = [move.describe() for move in self._parts]
        return {"type": "Waypoints", "moves": moves, "t_end": self.t_end}

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"Waypoints({len(self.moves)} moves, {self.t_end:g} s)"


class _Leg(NamedTuple):
    """A move of a sequence, for single times.

    Attributes:
        begin: when it begins [s].
        move: the move.
        reached: where the moves before it end [rad or m], (n,) or (batch, n); None for the first move.
    """

    begin: float
    move: Bezier
    reached: Array | None


def _begin(leg: _Leg) -> float:
    """Return when a leg begins [s]."""
    return leg.begin


def _legs(moves: Sequence[Bezier]) -> list[_Leg]:
    """Return the legs of a sequence; none where each rollout has times of its own."""
    legs: list[_Leg] = []
    reached: Array | None = None
    for move in moves:
        if np.ndim(move.t_start) or np.ndim(move.duration):
            return []
        legs.append(_Leg(float(move.t_start), move, reached))
        end = move.at(math.inf).q
        # Summed as for an array of times, so that both have the same bits.
        reached = end if reached is None else reached + (end - move.start)
    return legs


def _per_item(value: Any, name: str, count: int) -> list[Any]:
    """Return one time per item."""
    is_column = isinstance(value, np.ndarray) and value.ndim == 2  # one per rollout
    if is_column or not is_listing(value):
        return [value] * count
    if len(value) != count:
        raise ParameterError(name, value, f"a number or {count} of them")
    return list(value)


def _one_shape(points: Sequence[ArrayLike], times: Sequence[Any]) -> list[Array]:
    """Return the configurations with one shape, (n,) or (batch, n), as times (batch, 1) ask for."""
    arrays = [as_sized_array(point, "points") for point in points]
    shapes = [array.shape for array in arrays]
    rows = [time.shape for time in times if isinstance(time, np.ndarray)]
    try:
        joints = {shape[-1:] for shape in shapes}
        if len(joints) > 1 or max(map(len, shapes)) > 2:
            raise ValueError
        shape = np.broadcast_shapes(*shapes, *rows)
    except ValueError:
        listed = ", ".join(map(str, shapes))
        expected = "configurations of the same joints and batch"
        raise ArrayError("points", f"expected {expected}, got {listed}") from None
    return [np.broadcast_to(array, shape) for array in arrays]


class Hold(Reference):
    """Stand still at one configuration.

    Attributes:
        q: the configuration as given [rad or m], shape (n,) or (batch, n).
    """

    symbolic = True

    def __init__(self, q: ArrayLike) -> None:
        """Hold `q` [rad or m], shape (n,) or (batch, n)."""
        self.q = q
        self._at = Waypoints([q], durations=[]).at

    def variables(self) -> dict[str, Any]:
        """Return the configuration."""
        return {"q": self.q}

    def with_values(self, **changes: Any) -> Hold:
        """Return another configuration; see :meth:`Reference.with_values`."""
        return Hold(**changes)

    def describe(self) -> dict[str, Any]:
        """Return the configuration as plain data."""
        return {"type": "Hold", "q": self._at(0.0).q.tolist()}

    def at(self, t: float | Array) -> Target:
        """Return the configuration with zero velocity and acceleration, shapes as :meth:`Reference.at`."""
        return self._at(t)
