"""Three links in a vertical plane, with absolute velocities inside and Christoffel's b and c lists."""

import numpy as np

m1 = 1.8
m2 = 1.2
m3 = 0.6
l1 = 0.42
l2 = 0.33
lc1 = 0.19
lc2 = 0.15
lc3 = 0.12
I1 = 0.031
I2 = 0.018
I3 = 0.007
g = 9.81

k12 = (m2 * lc2 + m3 * l2) * l1
k13 = m3 * l1 * lc3
k23 = m3 * l2 * lc3
J1 = I1 + m1 * lc1**2 + (m2 + m3) * l1**2
J2 = I2 + m2 * lc2**2 + m3 * l2**2
J3 = I3 + m3 * lc3**2


def mass_matrix(q):
    c2, c3, c23 = np.cos(q[1]), np.cos(q[2]), np.cos(q[1] + q[2])
    d33 = J3
    d23 = J3 + k23 * c3
    d13 = J3 + k23 * c3 + k13 * c23
    d22 = J2 + J3 + 2 * k23 * c3
    d12 = J2 + J3 + 2 * k23 * c3 + k12 * c2 + k13 * c23
    d11 = J1 + J2 + J3 + 2 * (k12 * c2 + k13 * c23 + k23 * c3)
    return np.array([[d11, d12, d13], [d12, d22, d23], [d13, d23, d33]])


def coriolis_torque(q, v):
    s2, s3, s23 = np.sin(q[1]), np.sin(q[2]), np.sin(q[1] + q[2])
    w1, w2, w3 = v[0], v[0] + v[1], v[0] + v[1] + v[2]
    e1 = -k12 * s2 * w2**2 - k13 * s23 * w3**2
    e2 = k12 * s2 * w1**2 - k23 * s3 * w3**2
    e3 = k13 * s23 * w1**2 + k23 * s3 * w2**2
    return np.array([e1 + e2 + e3, e2 + e3, e3])


def gravity(q):
    c1, c12, c123 = np.cos(q[0]), np.cos(q[0] + q[1]), np.cos(q[0] + q[1] + q[2])
    g3 = m3 * lc3 * g * c123
    g2 = (m2 * lc2 + m3 * l2) * g * c12 + g3
    g1 = (m1 * lc1 + m2 * l1 + m3 * l1) * g * c1 + g2
    return np.array([g1, g2, g3])
