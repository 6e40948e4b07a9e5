"""Two links in a vertical plane (Siciliano et al. 2009, sec. 7.3.2): angles lift, from the horizontal."""

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
    d11 = I1 + m1 * lc1**2 + I2 + m2 * (l1**2 + lc2**2 + 2 * l1 * lc2 * c2)
    d12 = I2 + m2 * (lc2**2 + l1 * lc2 * c2)
    d22 = I2 + m2 * lc2**2
    return np.array([[d11, d12], [d12, d22]])


def coriolis_matrix(q, v):
    h = -m2 * l1 * lc2 * np.sin(q[1])
    return np.array([[h * v[1], h * (v[0] + v[1])], [-h * v[0], 0.0]])


def gravity(q):
    g1 = (m1 * lc1 + m2 * l1) * g * np.cos(q[0]) + m2 * lc2 * g * np.cos(q[0] + q[1])
    g2 = m2 * lc2 * g * np.cos(q[0] + q[1])
    return np.array([g1, g2])
