"""Three links in a vertical plane from the Jacobians of their centres of mass and these Jacobians' rates."""

import numpy as np

m1 = 1.9
m2 = 1.15
m3 = 0.55
l1 = 0.4
l2 = 0.31
lc1 = 0.18
lc2 = 0.14
lc3 = 0.11
I1 = 0.029
I2 = 0.017
I3 = 0.0065
g = 9.81

REACH = [(lc1, 0.0, 0.0), (l1, lc2, 0.0), (l1, l2, lc3)]
MASSES = [m1, m2, m3]
MOMENTS = [I1, I2, I3]


def along(q, k):
    total = q[0] + q[1] * (k > 0) + q[2] * (k > 1)
    return np.array([np.cos(total), np.sin(total)]), np.array([-np.sin(total), np.cos(total)])


def jacobian_of(q, i):
    J = np.zeros((2, 3))
    for k in range(3):
        _, across = along(q, k)
        for j in range(k + 1):
            J[:, j] += REACH[i][k] * across
    return J


def rate_of(q, v, i):
    dJ = np.zeros((2, 3))
    w = 0
    for k in range(3):
        w = w + v[k]
        u, _ = along(q, k)
        for j in range(k + 1):
            dJ[:, j] -= REACH[i][k] * w * u
    return dJ


def mass_matrix(q):
    D = np.zeros((3, 3))
    for i in range(3):
        J = jacobian_of(q, i)
        turns = np.array([1.0 * (j <= i) for j in range(3)])
        D = D + MASSES[i] * J.T @ J + MOMENTS[i] * np.outer(turns, turns)
    return D


def coriolis_matrix(q, v):
    C = np.zeros((3, 3))
    for i in range(3):
        C = C + MASSES[i] * jacobian_of(q, i).T @ rate_of(q, v, i)
    return C


def gravity(q):
    G = np.zeros(3)
    for i in range(3):
        G = G + MASSES[i] * g * jacobian_of(q, i)[1]
    return G
