"""The cart with two poles by dual numbers: derivatives of the energies without a formula for them."""

import math

import numpy as np


class Dual:
    def __init__(self, x, d=0.0):
        self.x, self.d = x, d

    def __add__(self, o):
        o = o if isinstance(o, Dual) else Dual(o)
        return Dual(self.x + o.x, self.d + o.d)

    def __mul__(self, o):
        o = o if isinstance(o, Dual) else Dual(o)
        return Dual(self.x * o.x, self.x * o.d + self.d * o.x)

    __radd__, __rmul__ = __add__, __mul__


def sin(t):
    return Dual(math.sin(t.x), t.d * math.cos(t.x)) if isinstance(t, Dual) else math.sin(t)


def cos(t):
    return Dual(math.cos(t.x), -1 * t.d * math.sin(t.x)) if isinstance(t, Dual) else math.cos(t)


def M(q):
    c1, c2, c12 = cos(q[1]), cos(q[2]), cos(q[1] + q[2])
    a = 0.35 * c1 + 0.08 * c12
    b = 0.08 * c12
    h = 0.04 * c2
    return [[2.5, a, b], [a, 0.172 + 2 * h, h + 0.022], [b, h + 0.022, 0.022]]


def mass_matrix(q):
    return np.array(M(q), dtype=float)


def derivative(q, k):
    moved = [Dual(x, 1.0 if i == k else 0.0) for i, x in enumerate(q)]
    return np.array([[e.d if isinstance(e, Dual) else 0.0 for e in row] for row in M(moved)])


def coriolis_matrix(q, v):
    d = np.array([derivative(q, k) for k in range(3)])
    christoffel = 0.5 * (np.einsum("kij->ijk", d) + np.einsum("jik->ijk", d) - np.einsum("ijk->ijk", d))
    return christoffel @ v


def potential_energy(q):
    return 9.81 * (0.35 * cos(q[1]) + 0.08 * cos(q[1] + q[2]))
