"""Smooth moves between configurations by the Bezier polynomial of the paper (eqs. 26-27)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, ArrayLike, as_sized_array, as_times, check_number, positive
from armgpi.base.hints import with_keyword_hints
from armgpi.errors import ArrayError, ParameterError
from armgpi.references.reference import Reference, Target

#: Peak of the first derivative of the blend, at x = 4/9: 1260 (4/9)^4 (5/9)^5.
PEAK_VELOCITY = 1260.0 * (4.0 / 9.0) ** 4 * (5.0 / 9.0) ** 5
#: Where the second derivative, 1260 x^3 (1 - x)^4 (4 - 9 x), is largest: its smaller inner extremum.
_PEAK_AT = (8.0 - math.sqrt(10.0)) / 18.0
#: Peak of the second derivative of the blend, near x = 0.269.
PEAK_ACCELERATION = 1260.0 * _PEAK_AT**3 * (1.0 - _PEAK_AT) ** 4 * (4.0 - 9.0 * _PEAK_AT)


class Blend(NamedTuple):
    """The blend from 0 to 1 and its derivatives with respect to its argument.

    Attributes:
        value: the blend [-], shape as the argument.
        first: its first derivative [-], same shape.
        second: its second derivative [-], same shape.
    """

    value: Array
    first: Array
    second: Array


def blend(x: Array) -> Blend:
    """Return the polynomial of eq. 27 that goes from 0 to 1, four derivatives zero at both ends.

    Printed as a sum with positive coefficients, which is not 0..1; with alternating signs it is
    (errata in the docs). Outside [0, 1] it stays at its ends.

    Args:
        x: share of the move that has passed, any shape.
    """
    return _polynomial(np.minimum(np.maximum(x, 0.0), 1.0))


def _polynomial(x: Any) -> Blend:
    """Return the blend of a share between 0 and 1, a number or an array: the same bits for both."""
    inner = 252.0 + x * (-1050.0 + x * (1800.0 + x * (-1575.0 + x * (700.0 - 126.0 * x))))
    y = 1.0 - x
    x_square, y_square = x * x, y * y
    # Products, as NumPy's powers of numbers and of arrays differ in their last bit.
    x_fourth, y_fourth = x_square * x_square, y_square * y_square
    return Blend(
        value=x_fourth * x * inner,  # eq. 27, signs corrected
        first=1260.0 * x_fourth * (y_fourth * y),
        second=1260.0 * (x_square * x) * y_fourth * (4.0 - 9.0 * x),
    )


def minimum_duration(
    distance: ArrayLike, velocity_limit: ArrayLike = math.inf, acceleration_limit: ArrayLike = math.inf
) -> float:
    """Return the shortest duration [s] in which a move keeps its limits.

    A move over D in T has the peaks ``2.602 |D| / T`` (at 4/9 of the move) and ``11.06 |D| / T^2``.

    Args:
        distance: how far each joint goes [rad or m], any shape that broadcasts.
        velocity_limit: highest speeds [rad/s or m/s].
        acceleration_limit: highest accelerations [rad/s^2 or m/s^2].

    Raises:
        ParameterError: when a limit is not positive.
        ArrayError: when an argument is no array of numbers, or shapes do not match.
    """
    distance_ = np.abs(as_sized_array(distance, "distance"))
    velocity = _limit(velocity_limit, "velocity_limit")
    acceleration = _limit(acceleration_limit, "acceleration_limit")
    for name, limit in (("velocity_limit", velocity), ("acceleration_limit", acceleration)):
        try:
            np.broadcast_shapes(distance_.shape, limit.shape)
        except (ValueError, RuntimeError):  # or more axes than NumPy has
            raise ArrayError(name, f"shape {limit.shape} does not match {distance_.shape}") from None
    by_velocity = PEAK_VELOCITY * distance_ / velocity
    by_acceleration = np.sqrt(PEAK_ACCELERATION * distance_ / acceleration)
    return float(np.max(np.maximum(by_velocity, by_acceleration), initial=0.0))


class Bezier(Reference):
    """One smooth move from a start to a goal (eq. 26), at rest before and after it.

    Attributes:
        start: configuration before the move [rad or m], shape (n,) or (batch, n).
        goal: configuration after it, same shape.
        duration: how long the move takes [s]; a number, or one for each rollout, shape (batch, 1).
        t_start: when it begins [s], likewise.
    """

    symbolic = True

    @with_keyword_hints
    def __init__(
        self,
        start: ArrayLike,
        goal: ArrayLike,
        duration: ArrayLike | None = None,
        t_start: ArrayLike = 0.0,
        velocity_limit: ArrayLike = math.inf,
        acceleration_limit: ArrayLike = math.inf,
    ) -> None:
        """Define the move.

        Args:
            start: configuration before it [rad or m], shape (n,) or (batch, n).
            goal: configuration after it; the two broadcast.
            duration: how long it takes [s], a number or (batch, 1); when not given, the shortest that keeps
                the limits.
            t_start: when it begins [s], a number or (batch, 1).
            velocity_limit: highest speeds [rad/s or m/s], used when there is no duration.
            acceleration_limit: highest accelerations [rad/s^2 or m/s^2], likewise.

        Raises:
            ArrayError: when start and goal do not match.
            ParameterError: when the duration is not positive, or neither it nor a limit is given.
        """
        self.start, self.goal = _configurations(start, goal)
        distance = self.goal - self.start
        if duration is None:
            duration = minimum_duration(distance, velocity_limit, acceleration_limit)
            if duration == 0.0 and distance.any():
                raise ParameterError(
                    "duration", None, "given, or a finite velocity_limit or acceleration_limit"
                )
            duration = duration or 1.0  # nothing moves: any duration will do
        self.duration = time(duration, "duration", "a positive, finite time [s]", open_=True)
        self.t_start = time(t_start, "t_start", "a finite time [s]", lowest=-math.inf)
        self._distance = distance
        self._is_single = (
            distance.ndim == 1 and isinstance(self.duration, float) and isinstance(self.t_start, float)
        )
        for name in ("duration", "t_start"):
            times = getattr(self, name)
            if np.ndim(times) == 2 and (distance.ndim == 1 or len(distance) != len(times)):
                expected = f"start and goal of {len(times)} rollouts, as {name} has"
                raise ArrayError("start", f"expected {expected}, got {distance.shape}")

    def variables(self) -> dict[str, Any]:
        """Return the four numbers of the move; see :meth:`Reference.variables`."""
        return {name: getattr(self, name) for name in ("start", "goal", "duration", "t_start")}

    def with_values(self, **changes: Any) -> Bezier:
        """Return another move; see :meth:`Reference.with_values`."""
        values = {**self.variables(), **changes}
        start, goal = values["start"], values["goal"]
        rollouts = [len(x) for x in values.values() if np.ndim(x) == 2]
        if rollouts and np.ndim(start) == 1 and np.ndim(goal) == 1:
            values["start"] = np.broadcast_to(start, (rollouts[0], len(start)))
        return Bezier(**values)

    def at(self, t: float | Array) -> Target:
        """Return the target at `t` [s]; shapes as :meth:`Reference.at`.

        A single time of a single move is worked out by numbers, which is faster than by arrays of one.
        """
        if isinstance(t, float) and math.isfinite(t) and self._is_single:
            share = (float(t) - self.t_start) / self.duration
            # 0.0 first: of -0.0 and 0.0 Python takes the first one, NumPy the positive one.
            step = _polynomial(min(max(0.0, share), 1.0))
        else:
            x = np.multiply(1.0, as_times(t))  # an array, or symbols
            x = (x.reshape(x.shape + (1,) * self._distance.ndim) - self.t_start) / self.duration
            step = blend(x)
        return Target(
            q=self.start + self._distance * step.value,  # eq. 26
            v=self._distance * step.first / self.duration,
            a=self._distance * step.second / self.duration**2,
        )

    def describe(self) -> dict[str, Any]:
        """Return the move as plain data."""
        return {
            "type": "Bezier",
            "start": self.start.tolist(),
            "goal": self.goal.tolist(),
            "duration": np.asarray(self.duration).tolist(),
            "t_start": np.asarray(self.t_start).tolist(),
        }

    def __repr__(self) -> str:
        """Return a one-line description."""
        way = f"{self.start.tolist()} -> {self.goal.tolist()}"
        return f"Bezier({way} in {_shown(self.duration)} s from t = {_shown(self.t_start)} s)"


def _shown(times: Any) -> str:
    """Return a time, or those of all rollouts, as text."""
    listed = np.asarray(times).ravel().tolist()
    return f"{listed[0]:g}" if len(listed) == 1 else str(listed)


def time(value: Any, name: str, expected: str, lowest: float = 0.0, open_: bool = False) -> Any:
    """Return a time [s], or those of all rollouts (batch, 1); arguments and errors as `check_number`."""
    is_column = isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == 1
    if not is_column or len(value) == 0:
        return check_number(value, name, expected, lowest, open_=open_)
    times = as_sized_array(value, name)
    check_number(float(times.min()), name, expected, lowest, open_=open_)
    return times


def _limit(value: Any, name: str) -> Array:
    """Return a limit as an array: positive, infinite for none."""
    if isinstance(value, float) and math.isnan(value):
        raise ParameterError(name, value, "positive")
    limit = as_sized_array(value, name, infinite=True)
    if not positive(limit).all():
        raise ParameterError(name, limit.tolist(), "positive")
    return limit


def _configurations(start: ArrayLike, goal: ArrayLike) -> tuple[Array, Array]:
    """Check two configurations and give them one shape."""
    start_ = as_sized_array(start, "start")
    goal_ = as_sized_array(goal, "goal")
    for name, array in (("start", start_), ("goal", goal_)):
        if array.ndim not in (1, 2):
            raise ArrayError(name, f"expected shape (n,) or (batch, n), got {array.shape}")
    if start_.shape[-1] != goal_.shape[-1]:
        raise ArrayError("goal", f"expected {start_.shape[-1]} joints as in start, got {goal_.shape}")
    try:
        shape = np.broadcast_shapes(start_.shape, goal_.shape)
    except ValueError:
        raise ArrayError("goal", f"shape {goal_.shape} does not match start's {start_.shape}") from None
    return np.broadcast_to(start_, shape).copy(), np.broadcast_to(goal_, shape).copy()
