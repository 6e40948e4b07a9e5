"""Two slender boxes, upright: lumped constants alpha, beta, delta inside of functions."""

import numpy as np

rho = 2700.0
L1, L2 = 0.42, 0.36
W1, W2 = 0.06, 0.05
T1, T2 = 0.04, 0.03
grav = 9.81

m1, m2 = rho * L1 * W1 * T1, rho * L2 * W2 * T2
r1, r2 = L1 / 2, L2 / 2


def box(m, a, b):
    return m * (a**2 + b**2) / 12


Iz1, Iz2 = box(m1, L1, W1), box(m2, L2, W2)


def M(q):
    alpha = Iz1 + Iz2 + m1 * r1**2 + m2 * (L1**2 + r2**2)
    beta = m2 * L1 * r2
    delta = Iz2 + m2 * r2**2
    k = beta * np.cos(q[1])
    return np.array([[alpha + 2 * k, delta + k], [delta + k, delta]])


def C(q, qdot):
    beta = m2 * L1 * r2
    w1, w2 = qdot
    k = beta * np.sin(q[1])
    return np.array([[-k * w2, -k * (w1 + w2)], [k * w1, 0.0]])


def G(q):
    e1, e12 = np.cos(q[0]), np.cos(q[0] + q[1])
    return grav * np.array([(m1 * r1 + m2 * L1) * e1 + m2 * r2 * e12, m2 * r2 * e12])
