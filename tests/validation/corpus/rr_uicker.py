"""Two links in a vertical plane by 4 x 4 transformations, pseudo-inertia and traces (Lagrange-Uicker)."""

import numpy as np

m1 = 1.12
m2 = 0.71
l1 = 0.39
lc1 = 0.19
lc2 = 0.16
I1 = 0.018
I2 = 0.012
g = 9.81

# d/dq of a turn about the joint's own axis, which points to -y of the world: z up, x ahead.
Q = np.array([[0.0, 0, -1, 0], [0, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0]])


def turn(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, -s, 0], [0, 1, 0, 0], [s, 0, c, 0], [0, 0, 0, 1]])


def shift(x):
    T = np.eye(4)
    T[0, 3] = x
    return T


def pseudo_inertia(m, c, moment):
    half = moment / 2
    J = np.diag([half + m * c**2, half, half, m])
    J[0, 3] = J[3, 0] = m * c
    return J


J1 = pseudo_inertia(m1, lc1, I1)
J2 = pseudo_inertia(m2, lc2, I2)


def inverse_dynamics(q, v, a):
    A1 = turn(q[0])
    A2 = shift(l1) @ turn(q[1])
    T1, T2 = A1, A1 @ A2
    U11 = Q @ T1
    U21, U22 = Q @ T2, A1 @ shift(l1) @ Q @ turn(q[1])
    # Second derivatives of T1 and T2.
    U111 = Q @ Q @ T1
    U211 = Q @ Q @ T2
    U212 = Q @ U22
    U222 = A1 @ shift(l1) @ Q @ Q @ turn(q[1])
    acc1 = U11 * a[0] + U111 * v[0] ** 2
    acc2 = U21 * a[0] + U22 * a[1] + U211 * v[0] ** 2 + 2 * U212 * v[0] * v[1] + U222 * v[1] ** 2
    down = np.array([0, 0, -g, 0])
    r1, r2 = np.array([lc1, 0, 0, 1]), np.array([lc2, 0, 0, 1])
    tau1 = np.trace(acc1 @ J1 @ U11.T) + np.trace(acc2 @ J2 @ U21.T)
    tau1 = tau1 - m1 * down @ U11 @ r1 - m2 * down @ U21 @ r2
    tau2 = np.trace(acc2 @ J2 @ U22.T) - m2 * down @ U22 @ r2
    return np.array([tau1, tau2])
