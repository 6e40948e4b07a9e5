"""Turret, shoulder and elbow with the Christoffel symbols printed one by one (as in Murray et al. 1994)."""

import numpy as np

m2 = 1.31
m3 = 0.72
l2 = 0.37
lc2 = 0.16
lc3 = 0.21
Ix2 = 0.011
Iy2 = 0.023
Ix3 = 0.007
Iy3 = 0.013
I1 = 0.031
g = 9.81


def mass_matrix(q):
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    c23, s23 = np.cos(q[1] + q[2]), np.sin(q[1] + q[2])
    c3 = np.cos(q[2])
    d = np.zeros((3, 3))
    d[0, 0] = (
        I1
        + Ix2 * s2**2
        + Iy2 * c2**2
        + Ix3 * s23**2
        + Iy3 * c23**2
        + m2 * lc2**2 * c2**2
        + m3 * (l2 * c2 + lc3 * c23) ** 2
    )
    d[1, 1] = Iy2 + Iy3 + m2 * lc2**2 + m3 * l2**2 + m3 * lc3**2 + 2 * m3 * l2 * lc3 * c3
    d[1, 2] = d[2, 1] = Iy3 + m3 * lc3**2 + m3 * l2 * lc3 * c3
    d[2, 2] = Iy3 + m3 * lc3**2
    return d


def coriolis_matrix(q, v):
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    c23, s23 = np.cos(q[1] + q[2]), np.sin(q[1] + q[2])
    s3 = np.sin(q[2])
    g112 = (
        (Ix2 - Iy2 - m2 * lc2**2) * c2 * s2
        + (Ix3 - Iy3) * c23 * s23
        - m3 * (l2 * c2 + lc3 * c23) * (l2 * s2 + lc3 * s23)
    )
    g113 = (Ix3 - Iy3) * c23 * s23 - m3 * lc3 * s23 * (l2 * c2 + lc3 * c23)
    g211 = -g112
    g311 = -g113
    g223 = -l2 * m3 * lc3 * s3
    g322 = l2 * m3 * lc3 * s3
    return np.array(
        [
            [g112 * v[1] + g113 * v[2], g112 * v[0], g113 * v[0]],
            [g211 * v[0], g223 * v[2], g223 * (v[1] + v[2])],
            [g311 * v[0], g322 * v[1], 0.0],
        ]
    )


def gravity(q):
    c2, c23 = np.cos(q[1]), np.cos(q[1] + q[2])
    return np.array([0.0, (m2 * lc2 + m3 * l2) * g * c2 + m3 * lc3 * g * c23, m3 * g * lc3 * c23])
