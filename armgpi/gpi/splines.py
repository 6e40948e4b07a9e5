"""B-spline basis functions of any order, written so that they also run on symbols."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

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
        is_finite = np.isfinite(lower) and np.isfinite(upper)
        if not (is_finite and lower < upper):
            raise ParameterError("upper", upper, f"above the lower end {lower:g}")
        check_whole(intervals, "intervals", 1)
        inner = np.linspace(lower, upper, intervals + 1)
        below = [lower] * (order - 1)
        above = [upper] * (order - 1)
        return cls(np.concatenate([below, inner, above]), order)

    def __call__(self, x: Array) -> tuple[Array, ...]:
        """Return the value of every function.

        Args:
            x: input, any shape; clipped to the domain.

        Returns:
            `size` arrays shaped like `x`.
        """
        inside = np.minimum(np.maximum(x, self.lower), self.upper)
        values = self._functions(inside, self._whole)
        zero = np.zeros_like(x)
        return tuple([values.get(i, zero) for i in range(self.size)])

    def even(self, x: Array) -> tuple[Array, ...]:
        """Return the sums of each function and its mirror image; the knots must be symmetric about 0.

        They are even in `x` and add up to one. The function in the middle is its own mirror image.

        Args:
            x: input, any shape.

        Returns:
            Half as many arrays as functions, rounded up, each shaped like `x`.
        """
        size = np.minimum(np.abs(x), self.upper)
        values = self._functions(size, self._right)
        folded = []
        for function in range(self.size // 2):
            # Of |x|: every mirror image reaches right of 0, its function perhaps not.
            total = values[self.size - 1 - function]
            if function in values:
                total = total + values[function]
            folded.append(total)
        if self.size % 2:
            folded.append(values[self.size // 2])
        return tuple(folded)

    def _functions(self, x: Array, intervals: Sequence[int]) -> dict[int, Array]:
        """Return the functions at `x`, which lies in one of the intervals (knots i to i + 1).

        Those that are zero on all the intervals are left out.
        """
        t = self.knots
        # Order 1: one in its own interval; the last one includes its upper end.
        values: dict[int, Array] = {}
        for i in intervals:
            if len(intervals) == 1:
                values[i] = np.ones_like(x)
                continue
            is_right_of_begin = i == intervals[0] or x >= t[i]
            is_left_of_end = i == intervals[-1] or x < t[i + 1]
            values[i] = np.where(is_right_of_begin & is_left_of_end, 1.0, 0.0)
        for terms in self._terms:
            raised: dict[int, Array] = {}
            for term in terms:
                if term.lower not in values:
                    continue
                product = (x - term.knot) * term.slope * values[term.lower]
                if term.function in raised:
                    product = raised[term.function] + product
                raised[term.function] = product
            values = raised
        return values


class _Term(NamedTuple):
    """A term of the recursion: (x - knot) slope times a function of the order below.

    Attributes:
        function: number of the function that it is added to.
        lower: number of the function of the order below.
        knot: where the term is zero.
        slope: of the factor [1 / unit of x].
    """

    function: int
    lower: int
    knot: float
    slope: float


def _recursion(t: Sequence[float], order: int) -> list[list[_Term]]:
    """Return the terms of the recursion of Cox and de Boor over knots `t`, a list per order from 2 on."""
    steps = []
    for k in range(2, order + 1):
        terms = []
        for i in range(len(t) - k):
            width = t[i + k - 1] - t[i]
            if width > 0.0:
                terms.append(_Term(i, i, t[i], 1.0 / width))
            width_after = t[i + k] - t[i + 1]
            if width_after > 0.0:
                terms.append(_Term(i, i + 1, t[i + k], -1.0 / width_after))
        steps.append(terms)
    return steps
