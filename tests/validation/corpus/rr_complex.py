"""A rotary pendulum: C by Christoffel's formula, with slopes of D by a complex step (Squire, Trapp 1998)."""

import numpy as np

m1 = 0.9
m2 = 0.35
L1 = 0.25
lc1 = 0.11
lc2 = 0.18
J1 = 0.012
J2 = 0.015
g = 9.81
n = 2


def mass_matrix(q):
    s, c = np.sin(q[1]), np.cos(q[1])
    a = J1 + m1 * lc1**2 + m2 * L1**2
    b = J2 + m2 * lc2**2
    k = m2 * L1 * lc2
    return np.array([[a + b * s * s, k * c], [k * c, b]])


def slope(q, k):
    moved = q.astype(complex)
    moved[k] += 1j * 1e-30
    return mass_matrix(moved).imag / 1e-30


def coriolis_matrix(q, v):
    dD = [slope(q, k) for k in range(n)]
    C = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            C[i, j] = 0.5 * sum((dD[k][i, j] + dD[j][i, k] - dD[i][j, k]) * v[k] for k in range(n))
    return C


def gravity(q):
    return np.array([0.0, m2 * g * lc2 * np.sin(q[1])])
