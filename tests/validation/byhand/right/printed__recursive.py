"""Yaw, shoulder and elbow by recursion over nested tuples and lambdas."""

from functools import reduce
from math import cos

I0, (m2, c2, J2), (m3, l2, c3, J3) = 0.06, (3.0, 0.2, 0.05), (2.0, 0.4, 0.1, 0.01)
dot = lambda *pairs: reduce(lambda s, ab: s + ab[0] * ab[1], pairs, 0.0)  # noqa: E731
radius = lambda q: l2 * cos(q[1]) + c3 * cos(q[1] + q[2])  # noqa: E731


def mass_matrix(q):
    k = m3 * l2 * c3 * cos(q[2])
    d3 = J3 + m3 * c3**2
    rows = {(0, 0): I0 + J2 + J3 + dot((m2, (c2 * cos(q[1])) ** 2), (m3, radius(q) ** 2))}
    rows |= {(1, 1): J2 + m2 * c2**2 + m3 * l2**2 + 2 * k + d3, (1, 2): d3 + k, (2, 1): d3 + k, (2, 2): d3}
    return [[rows.get((i, j), 0.0) for j in range(3)] for i in range(3)]


def gravity(q):
    g3 = m3 * 9.81 * c3 * cos(q[1] + q[2])
    return [0.0, g3 + 9.81 * (m2 * c2 + m3 * l2) * cos(q[1]), g3]


def kinetic_energy(q, v):
    M = mass_matrix(q)
    return sum(M[i][j] * v[i] * v[j] for i in range(3) for j in range(3)) / 2
