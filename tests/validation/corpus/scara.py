"""A SCARA: two level links and a quill that slides down (Spong et al. 2006, example 7.8)."""

import numpy as np

m1 = 2.1
m2 = 1.3
m3 = 0.57
l1 = 0.43
l2 = 0.36
lc1 = 0.19
lc2 = 0.14
I1 = 0.033
I2 = 0.021
I3 = 0.0047
g = 9.81


def mass_matrix(q):
    b = (m2 * lc2 + m3 * l2) * l1
    d22 = I2 + I3 + m2 * lc2**2 + m3 * l2**2
    d12 = d22 + b * np.cos(q[1])
    d11 = I1 + m1 * lc1**2 + (m2 + m3) * l1**2 + d22 + 2 * b * np.cos(q[1])
    return np.array([[d11, d12, 0], [d12, d22, 0], [0, 0, m3]])


def coriolis_torque(q, v):
    b = (m2 * lc2 + m3 * l2) * l1
    h = b * np.sin(q[1])
    return np.array([-h * (2 * v[0] * v[1] + v[1] ** 2), h * v[0] ** 2, 0])


def gravity(q):
    return np.array([0, 0, -m3 * g])


def forward_kinematics(q):
    x = l1 * np.cos(q[0]) + l2 * np.cos(q[0] + q[1])
    y = l1 * np.sin(q[0]) + l2 * np.sin(q[0] + q[1])
    return np.array([x, y, -q[2]])


def jacobian(q):
    s1, c1 = np.sin(q[0]), np.cos(q[0])
    s12, c12 = np.sin(q[0] + q[1]), np.cos(q[0] + q[1])
    return np.array([[-l1 * s1 - l2 * s12, -l2 * s12, 0], [l1 * c1 + l2 * c12, l2 * c12, 0], [0, 0, -1]])
