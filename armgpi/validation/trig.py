"""Trigonometric sums with exact coefficients: what the equations of motion of an arm are made of.

A :class:`Trig` is a sum of c cos(k.q) and c sin(k.q) with whole k; the coefficients c are SymPy
polynomials in the parameters and sliding positions. Products become sums of angles at once, so no
simplification is needed afterwards, and cos² + sin² never stands there.
"""

from __future__ import annotations

from typing import Any

#: "c" or "s", and the multiples of the angles.
Key = tuple[str, tuple[int, ...]]


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

        def add(kind: str, k: tuple[int, ...], value: Any) -> None:
            # One of k and -k, so that equal functions meet: the first multiple is positive.
            leading = next((x for x in k if x), 0)
            if leading == 0 and kind == "s":
                return
            if leading < 0:
                k = tuple(-x for x in k)
                value = -value if kind == "s" else value
            terms[kind, k] = terms[kind, k] + value if (kind, k) in terms else value

        for (one, a), x in self.terms.items():
            for (two, b), y in other.terms.items():
                z = x * y
                if not any(a) or not any(b):  # a constant: the other one stays as it is
                    add(two if one == "c" and not any(a) else one, b if not any(a) else a, z)
                    continue
                half = z / 2
                plus = tuple(i + j for i, j in zip(a, b, strict=True))
                minus = tuple(i - j for i, j in zip(a, b, strict=True))
                if one == two == "c":
                    add("c", plus, half)
                    add("c", minus, half)
                elif one == two:
                    add("c", minus, half)
                    add("c", plus, -half)
                elif one == "s":
                    add("s", plus, half)
                    add("s", minus, half)
                else:
                    add("s", plus, half)
                    add("s", minus, -half)
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
