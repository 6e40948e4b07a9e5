"""The Furuta pendulum (Cazzolato and Prime 2011): a level arm and a pendulum across it."""

import numpy as np

m1 = 0.83
m2 = 0.31
L1 = 0.27
lc1 = 0.12
lc2 = 0.19
J1 = 0.0093
J2 = 0.0041
g = 9.81

J1hat = J1 + m1 * lc1**2
J2hat = J2 + m2 * lc2**2
J0hat = J1hat + m2 * L1**2


def mass_matrix(q):
    s, c = np.sin(q[1]), np.cos(q[1])
    return np.array([[J0hat + J2hat * s**2, m2 * L1 * lc2 * c], [m2 * L1 * lc2 * c, J2hat]])


def coriolis_torque(q, v):
    s, s2 = np.sin(q[1]), np.sin(2 * q[1])
    h1 = J2hat * s2 * v[0] * v[1] - m2 * L1 * lc2 * s * v[1] ** 2
    h2 = -0.5 * J2hat * s2 * v[0] ** 2
    return np.array([h1, h2])


def gravity(q):
    return np.array([0.0, g * m2 * lc2 * np.sin(q[1])])
