"""B-spline basis functions of any order, written so that they also run on symbols."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armgpi.arrays import Array, as_float_array, check_whole
from armgpi.errors import ArrayError, ParameterError


class BSplineBasis:
    """The B-spline functions of one input, by the recursion of Cox and de Boor.

    Function i is a piecewise polynomial of degree order - 1, zero outside [knots[i], knots[i + order]]. On
    the domain [knots[order - 1], knots[-order]] all functions add up to one; inputs are clipped to it.

    Attributes:
        knots: knots, not decreasing, shape (size + order,).
        order: order, one more than the degree.
        size: number of functions.
        lower: lower end of the domain.
        upper: upper end of the domain.
    """

    def __init__(self, knots: Sequence[float] | Array, order: int = 3) -> None:
        """Define the functions.

        Raises:
            ParameterError: when the order is no whole number above 0.
            ArrayError: when the knots decrease, are too few, or repeat more often than `order`.
        """
        self.order = order = check_whole(order, "order", 1)
        self.knots = as_float_array(list(knots), "knots")
        if self.knots.ndim != 1 or len(self.knots) < 2 * order:
            raise ArrayError(
                "knots", f"expected at least {2 * order} knots for order {order}, got {self.knots}"
            )
        steps = np.diff(self.knots)
        if (steps < 0.0).any():
            where = int(np.argmax(steps < 0.0))
            raise ArrayError(
                "knots",
                f"expected increasing knots, got {self.knots[where]:g} before {self.knots[where + 1]:g}",
            )
        if (self.knots[order:] <= self.knots[:-order]).any():
            raise ArrayError("knots", f"expected no knot more than {order} times, got {self.knots}")
        self.size = len(self.knots) - order
        self.lower = float(self.knots[order - 1])
        self.upper = float(self.knots[-order])

    @classmethod
    def uniform(cls, lower: float, upper: float, intervals: int = 1, order: int = 3) -> BSplineBasis:
        """Return the intervals + order - 1 functions on equal intervals, with the end knots repeated."""
        if not (np.isfinite(lower) and np.isfinite(upper) and lower < upper):
            raise ParameterError("upper", upper, f"above the lower end {lower:g}")
        check_whole(intervals, "intervals", 1)
        inner = np.linspace(lower, upper, intervals + 1)
        return cls(np.concatenate([[lower] * (order - 1), inner, [upper] * (order - 1)]), order)

    def __call__(self, x: Array) -> tuple[Array, ...]:
        """Return the value of every function at `x`, clipped to the domain: `size` arrays shaped like x."""
        t = self.knots
        x = np.minimum(np.maximum(x, self.lower), self.upper)
        last = int(np.flatnonzero(t[:-1] < t[1:])[-1])
        # Order 1: one in its own interval; the last interval includes its upper end.
        values = [
            np.where((x >= t[i]) & ((x < t[i + 1]) if i != last else (x <= t[i + 1])), 1.0, 0.0)
            for i in range(len(t) - 1)
        ]
        for order in range(2, self.order + 1):
            raised: list[Array] = []
            for i in range(len(t) - order):
                total = np.zeros_like(x)
                if t[i + order - 1] > t[i]:
                    total = total + (x - t[i]) / (t[i + order - 1] - t[i]) * values[i]
                if t[i + order] > t[i + 1]:
                    total = total + (t[i + order] - x) / (t[i + order] - t[i + 1]) * values[i + 1]
                raised.append(total)
            values = raised
        return tuple(values)
