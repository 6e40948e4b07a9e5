"""B-spline basis functions of any order, written so that they also run on symbols."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armgpi.base.arrays import Array, as_sized_array, check_whole
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
        self.knots = as_sized_array(knots, "knots")
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
        t = self.knots.tolist()
        self._terms = _recursion(t, order)
        self._whole = [i for i in range(len(t) - 1) if t[i] < t[i + 1]]
        # Intervals that can hold the size of an input: where it is one, nothing needs to be looked up.
        self._right = [i for i in self._whole if t[i + 1] > 0.0]

    @classmethod
    def uniform(cls, lower: float, upper: float, intervals: int = 1, order: int = 3) -> BSplineBasis:
        """Return the functions on equal intervals, with the end knots repeated.

        Args:
            lower: lower end of the domain.
            upper: upper end of the domain.
            intervals: number of intervals.
            order: order, one more than the degree.

        Returns:
            The basis of intervals + order - 1 functions.

        Raises:
            ParameterError: when the ends are not finite, `upper` is not above `lower`, or a number is not
                whole and positive.
        """
        if not (np.isfinite(lower) and np.isfinite(upper) and lower < upper):
            raise ParameterError("upper", upper, f"above the lower end {lower:g}")
        check_whole(intervals, "intervals", 1)
        inner = np.linspace(lower, upper, intervals + 1)
        return cls(np.concatenate([[lower] * (order - 1), inner, [upper] * (order - 1)]), order)

    def __call__(self, x: Array) -> tuple[Array, ...]:
        """Return the value of every function.

        Args:
            x: input, any shape; clipped to the domain.

        Returns:
            `size` arrays shaped like `x`.
        """
        values = self._functions(np.minimum(np.maximum(x, self.lower), self.upper), self._whole)
        return tuple([values[i] if i in values else np.zeros_like(x) for i in range(self.size)])

    def even(self, x: Array) -> tuple[Array, ...]:
        """Return the sums of each function and its mirror image; the knots must be symmetric about 0.

        They are even in `x` and add up to one. The function in the middle is its own mirror image.

        Args:
            x: input, any shape.

        Returns:
            Half as many arrays as functions, rounded up, each shaped like `x`.
        """
        values = self._functions(np.minimum(np.abs(x), self.upper), self._right)
        # Of |x|: every mirror image reaches right of 0, its function perhaps not.
        pairs = [(self.size - 1 - i, i) for i in range(self.size // 2)]
        folded = [values[i] + values[j] if j in values else values[i] for i, j in pairs]
        return (*folded, values[self.size // 2]) if self.size % 2 else tuple(folded)

    def _functions(self, x: Array, intervals: Sequence[int]) -> dict[int, Array]:
        """Return the functions at `x`, which lies in one of the intervals (knots i to i + 1).

        Those that are zero on all the intervals are left out.
        """
        t = self.knots
        # Order 1: one in its own interval; the last one includes its upper end.
        values: dict[int, Array] = {}
        for i in intervals:
            left, right = i == intervals[0] or x >= t[i], i == intervals[-1] or x < t[i + 1]
            values[i] = np.where(left & right, 1.0, 0.0) if len(intervals) > 1 else np.ones_like(x)
        for terms in self._terms:
            raised: dict[int, Array] = {}
            for function, part, knot, slope in terms:
                if part in values:
                    product = (x - knot) * slope * values[part]
                    raised[function] = raised[function] + product if function in raised else product
            values = raised
        return values


def _recursion(t: Sequence[float], order: int) -> list[list[tuple[int, int, float, float]]]:
    """Return the terms of the recursion, a list per order from 2 on.

    A term (function, part, knot, slope) says: add (x - knot) slope times part of the order below.
    """
    steps = []
    for k in range(2, order + 1):
        terms = []
        for i in range(len(t) - k):
            if t[i + k - 1] > t[i]:
                terms.append((i, i, t[i], 1.0 / (t[i + k - 1] - t[i])))
            if t[i + k] > t[i + 1]:
                terms.append((i, i + 1, t[i + k], -1.0 / (t[i + k] - t[i + 1])))
        steps.append(terms)
    return steps
