"""A lift that carries two level links: D by Jacobians, C by Christoffel's formula on its slopes."""

import numpy as np

m1 = 2.3
m2 = 1.2
m3 = 0.7
l2 = 0.38
lc2 = 0.17
lc3 = 0.22
I2 = 0.024
I3 = 0.011
g = 9.81


def jacobians(q):
    s2, c2 = np.sin(q[1]), np.cos(q[1])
    s23, c23 = np.sin(q[1] + q[2]), np.cos(q[1] + q[2])
    J1 = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    J2 = np.array([[0.0, -lc2 * s2, 0.0], [0.0, lc2 * c2, 0.0], [1.0, 0.0, 0.0]])
    J3 = np.array(
        [
            [0.0, -l2 * s2 - lc3 * s23, -lc3 * s23],
            [0.0, l2 * c2 + lc3 * c23, lc3 * c23],
            [1.0, 0.0, 0.0],
        ]
    )
    return J1, J2, J3


def mass_matrix(q):
    J1, J2, J3 = jacobians(q)
    W2 = np.array([0.0, 1.0, 0.0])
    W3 = np.array([0.0, 1.0, 1.0])
    return m1 * J1.T @ J1 + m2 * J2.T @ J2 + m3 * J3.T @ J3 + I2 * np.outer(W2, W2) + I3 * np.outer(W3, W3)


def slopes(q):
    k = m3 * l2 * lc3 * np.sin(q[2])
    dD = np.zeros((3, 3, 3))
    dD[1, 1, 2] = -2 * k
    dD[1, 2, 2] = dD[2, 1, 2] = -k
    return dD


def coriolis_matrix(q, v):
    dD = slopes(q)
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                C[i, j] += 0.5 * (dD[i, j, k] + dD[i, k, j] - dD[j, k, i]) * v[k]
    return C


def gravity(q):
    J1, J2, J3 = jacobians(q)
    up = np.array([0.0, 0.0, g])
    return m1 * J1.T @ up + m2 * J2.T @ up + m3 * J3.T @ up
