"""The law of a certificate: its coefficients over a sample, as polynomials of theta = omega h, exactly.

`armgpi.control.realisation` has the same coefficients in floats, which run; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import comb
from typing import Any

#: Coefficients from the lowest power up.
_Polynomial = list[Fraction]


def coefficients(law: Mapping[str, Any]) -> list[list[str]]:
    """Return what the checker needs of a law, each a polynomial of theta, numbers as texts.

    Args:
        law: `integrators`, `rolloff`, and as texts `zeta`, `pole_ratio`, `rolloff_ratio`, `second_ratio` and
            `second_zeta`.

    Returns:
        A common denominator; what takes the error into v at once, into each integrator and each state of the
        filter; and what takes the first filter's state out of each. All for omega = 1.
    """
    m, r = law["integrators"], law["rolloff"]
    zeta, pole, far, second, damping = (
        Fraction(law[name]) for name in ("zeta", "pole_ratio", "rolloff_ratio", "second_ratio", "second_zeta")
    )
    one = Fraction(1)
    whole = _times([one, 2 * zeta, one], [second**2, 2 * damping * second, one])
    for each in [pole] * (m - 1) + [far] * r:
        whole = _times(whole, [each, one])
    # The law is N / (s^m D) = direct + g_0 / s^m + ... + g_(m - 1) / s + F / D.
    N, D = [*whole[: m + 2], Fraction(0)], whole[m + 2 :]
    g: _Polynomial = []
    for j in range(m):
        g.append((N[j] - _at(_times(g, D), j)) / D[0])
    direct = Fraction(0) if r else N[m + 1]
    F = [N[m + j] - direct * D[j] - _at(_times(g, D), m + j) for j in range(1 + r)]
    (integral, drive), (passed, filtered), (shrunk, leak) = map(_trapezoidal, (g, F, D[: 1 + r]))
    scale = _sum([one], shrunk)
    over = _times(scale, scale)
    at_once = _times(_sum(_times(_sum([direct], integral), scale), passed), scale)
    found = [over, [-x for x in at_once], *(_times(x, over) for x in drive)]
    found += [
        _sum(_times(x, scale), [-z for z in _times(passed, y)]) for x, y in zip(filtered, leak, strict=True)
    ]
    found += [_times(x, scale) for x in leak]
    return [[str(x) for x in polynomial] for polynomial in found]


def _trapezoidal(f: Sequence[Fraction]) -> tuple[_Polynomial, list[_Polynomial]]:
    """Return f_0 / s^k + ... + f_(k - 1) / s at once, and in powers of 1 / (z - 1), trapezoidal."""
    k, half = len(f), Fraction(1, 2)
    at_once = [Fraction(0), *(half**i * f[k - i] for i in range(1, k + 1))]
    later = [
        [Fraction(0), *(comb(k - i, j - i) * half ** (j - i) * f[i] for i in range(j, -1, -1))]
        for j in range(k)
    ]
    return at_once, later[::-1]


def _times(p: Sequence[Fraction], q: Sequence[Fraction]) -> _Polynomial:
    """Return the product of two polynomials."""
    found = [Fraction(0)] * max(len(p) + len(q) - 1, 0)
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            found[i + j] += x * y
    return found


def _sum(p: Sequence[Fraction], q: Sequence[Fraction]) -> _Polynomial:
    """Return the sum of two polynomials."""
    return [_at(p, i) + _at(q, i) for i in range(max(len(p), len(q)))]


def _at(p: Sequence[Fraction], i: int) -> Fraction:
    """Return a coefficient; zero beyond the last one."""
    return p[i] if i < len(p) else Fraction(0)
