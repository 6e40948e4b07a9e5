"""Shoulder, elbow and wrist with the numbers put in, as programs print them."""

from math import cos, sin


def mass_matrix(q):
    c2, c3, c23 = cos(q[1]), cos(q[2]), cos(q[1] + q[2])
    d11 = 0.81 + 0.48 * c2 + 0.06 * c3 + 0.08 * c23
    d12 = 0.17 + 0.24 * c2 + 0.06 * c3 + 0.04 * c23
    d13 = 0.015 + 0.03 * c3 + 0.04 * c23
    d22 = 0.17 + 0.06 * c3
    d23 = 0.015 + 0.03 * c3
    return [[d11, d12, d13], [d12, d22, d23], [d13, d23, 0.015]]


def coriolis_torque(q, v):
    s2, s3, s23 = sin(q[1]), sin(q[2]), sin(q[1] + q[2])
    t1 = -0.24 * s2 * (2 * v[0] * v[1] + v[1] ** 2)
    t1 -= 0.03 * s3 * (2 * v[0] * v[2] + 2 * v[1] * v[2] + v[2] ** 2)
    t1 -= 0.04 * s23 * (2 * v[0] * v[1] + 2 * v[0] * v[2] + 2 * v[1] * v[2] + v[1] ** 2 + v[2] ** 2)
    t2 = 0.24 * s2 * v[0] ** 2 + 0.04 * s23 * v[0] ** 2
    t2 -= 0.03 * s3 * (2 * v[0] * v[2] + 2 * v[1] * v[2] + v[2] ** 2)
    t3 = 0.03 * s3 * (v[0] + v[1]) ** 2 + 0.04 * s23 * v[0] ** 2
    return [t1, t2, t3]


def gravity(q):
    g3 = 0.981 * cos(q[0] + q[1] + q[2])
    g2 = g3 + 5.886 * cos(q[0] + q[1])
    g1 = g2 + 17.658 * cos(q[0])
    return [g1, g2, g3]
