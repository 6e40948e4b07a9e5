"""A polar arm in a vertical plane: it turns, then slides outwards."""

import numpy as np

m1 = 2.13
m2 = 0.91
lc1 = 0.19
I1 = 0.031
I2 = 0.017
g = 9.81


def mass_matrix(q):
    r = q[1]
    return np.array([[I1 + m1 * lc1**2 + I2 + m2 * r**2, 0.0], [0.0, m2]])


def coriolis_torque(q, v):
    r = q[1]
    return np.array([2.0 * m2 * r * v[0] * v[1], -m2 * r * v[0] ** 2])


def gravity(q):
    r = q[1]
    return np.array([(m1 * lc1 + m2 * r) * g * np.cos(q[0]), m2 * g * np.sin(q[0])])
