"""Trigonometric sums with exact coefficients: what the equations of motion of an arm are made of.

A :class:`Trig` is a sum of c cos(k.q) and c sin(k.q) with whole k; the coefficients c are SymPy
polynomials in the parameters and sliding positions. Products become sums of angles at once, so no
simplification is needed afterwards, and cos² + sin² never stands there.
"""

from __future__ import annotations

import itertools
from typing import Any

#: "c" or "s", and the multiples of the angles.
Key = tuple[str, tuple[int, ...]]
#: Kinds of two functions -> kind of the two of which their product is half, and the signs of these: that of
#: the sum of the angles, that of their difference.
_PRODUCTS = {"cc": ("c", 1, 1), "ss": ("c", -1, 1), "sc": ("s", 1, 1), "cs": ("s", 1, -1)}


class Trig:
    """A sum of cosines and sines; immutable.

    Attributes:
        terms: function -> coefficient, never zero.
    """

    __slots__ = ("terms",)

    def __init__(self, terms: dict[Key, Any]) -> None:
        """Keep the terms that are not zero."""
        self.terms = {key: value for key, value in terms.items() if value}

    def __bool__(self) -> bool:
        """Tell whether it is anything but zero."""
        return bool(self.terms)

    def __add__(self, other: Trig) -> Trig:
        """Return the sum."""
        terms = dict(self.terms)
        for key, value in other.terms.items():
            terms[key] = terms[key] + value if key in terms else value
        return Trig(terms)

    def __neg__(self) -> Trig:
        """Return the negative."""
        return Trig({key: -value for key, value in self.terms.items()})

    def __sub__(self, other: Trig) -> Trig:
        """Return the difference."""
        return self + -other

    def times(self, factor: Any) -> Trig:
        """Return a multiple by a coefficient."""
        return Trig({key: value * factor for key, value in self.terms.items()})

    def __mul__(self, other: Trig) -> Trig:
        """Return the product, as a sum of angles."""
        terms: dict[Key, Any] = {}
        for ((one, a), x), ((two, b), y) in itertools.product(self.terms.items(), other.terms.items()):
            half = x * y / 2
            kind, *signs = _PRODUCTS[one + two]
            for way, sign in zip((1, -1), signs, strict=True):
                k = [i + way * j for i, j in zip(a, b, strict=True)]
                # One of k and -k, so that equal functions meet: the first multiple is positive. sin 0 goes.
                leading = next((x for x in k if x), 0)
                turned = (leading > 0) - (leading < 0)
                key = kind, tuple(turned * x for x in k)
                terms[key] = terms.get(key, 0) + half * sign * (turned if kind == "s" else 1)
        return Trig(terms)

    def derivative(self, i: int, sliding: Any = None) -> Trig:
        """Return the derivative by coordinate i; `sliding` is its symbol when it is no angle."""
        if sliding is not None:
            return Trig({key: value.diff(sliding) for key, value in self.terms.items()})
        terms: dict[Key, Any] = {}
        for (kind, k), value in self.terms.items():
            if k[i]:
                terms["s" if kind == "c" else "c", k] = value * (-k[i] if kind == "c" else k[i])
        return Trig(terms)
