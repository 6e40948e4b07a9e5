"""Yaw, shoulder and elbow in closed form, numbers of a lecture's example."""

import numpy as np

I1, I2, I3 = 0.02, 0.015, 0.01
m2, m3 = 2.0, 1.0
l1, l2 = 0.1, 0.5
lc2, lc3 = 0.25, 0.2
g = 9.81


def mass_matrix(q):
    c2, c3, c23 = np.cos(q[1]), np.cos(q[2]), np.cos(q[1] + q[2])
    D = np.zeros((3, 3))
    D[0, 0] = I1 + I2 + I3 + m2 * (l1 + lc2 * c2) ** 2 + m3 * (l1 + l2 * c2 + lc3 * c23) ** 2
    D[1, 1] = I2 + I3 + m2 * lc2**2 + m3 * (l2**2 + lc3**2 + 2 * l2 * lc3 * c3)
    D[1, 2] = I3 + m3 * (lc3**2 + l2 * lc3 * c3)
    D[2, 1] = D[1, 2]
    D[2, 2] = I3 + m3 * lc3**2
    return D


def coriolis_torque(q, v):
    s2, s3, s23 = np.sin(q[1]), np.sin(q[2]), np.sin(q[1] + q[2])
    r2 = l1 + lc2 * np.cos(q[1])
    r3 = l1 + l2 * np.cos(q[1]) + lc3 * np.cos(q[1] + q[2])
    b = m2 * r2 * lc2 * s2 + m3 * r3 * (l2 * s2 + lc3 * s23)
    d = m3 * r3 * lc3 * s23
    h = m3 * l2 * lc3 * s3
    return np.array([
        -2 * b * v[0] * v[1] - 2 * d * v[0] * v[2],
        b * v[0] ** 2 - h * (2 * v[1] * v[2] + v[2] ** 2),
        d * v[0] ** 2 + h * v[1] ** 2,
    ])


def gravity(q):
    c2, c23 = np.cos(q[1]), np.cos(q[1] + q[2])
    return np.array([
        0.0,
        -g * (m2 * lc2 * c2 + m3 * (l2 * c2 + lc3 * c23)),
        -m3 * g * lc3 * c23,
    ])
