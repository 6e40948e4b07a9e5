"""The acrobot (Spong 1995): q1 from the vertical, hanging down at zero."""

import numpy as np

m1 = 1.21
m2 = 0.83
l1 = 0.41
lc1 = 0.17
lc2 = 0.23
I1 = 0.021
I2 = 0.013
g = 9.81


def mass_matrix(q):
    c2 = np.cos(q[1])
    d22 = m2 * lc2**2 + I2
    d12 = m2 * (lc2**2 + l1 * lc2 * c2) + I2
    d11 = m1 * lc1**2 + m2 * (l1**2 + lc2**2 + 2.0 * l1 * lc2 * c2) + I1 + I2
    return np.array([[d11, d12], [d12, d22]])


def coriolis_torque(q, v):
    s2 = np.sin(q[1])
    h1 = -m2 * l1 * lc2 * s2 * v[1] ** 2 - 2.0 * m2 * l1 * lc2 * s2 * v[1] * v[0]
    h2 = m2 * l1 * lc2 * s2 * v[0] ** 2
    return np.array([h1, h2])


def gravity(q):
    s1, s12 = np.sin(q[0]), np.sin(q[0] + q[1])
    phi2 = m2 * lc2 * g * s12
    phi1 = (m1 * lc1 + m2 * l1) * g * s1 + phi2
    return np.array([phi1, phi2])
