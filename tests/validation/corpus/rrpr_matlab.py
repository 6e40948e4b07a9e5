"""A SCARA with a wrist, transcribed from a MATLAB function."""

from math import cos, sin

import numpy as np

m1 = 1.9
m2 = 1.2
m3 = 0.6
m4 = 0.3
a1 = 0.4
a2 = 0.35
r1 = 0.19
r2 = 0.16
I1 = 0.018
I2 = 0.016
I3 = 0.012
I4 = 0.011
g = 9.81


def dynamics(q, qd):
    q2 = q[1]
    qd1, qd2 = qd[:2]
    tip = m3 + m4
    b = m2 * a1 * r2 + tip * a1 * a2
    M = np.zeros((4, 4))
    M[1, 1] = I2 + I3 + I4 + m2 * r2**2 + tip * a2**2
    M[0, 1] = M[1, 1] + b * cos(q2)
    M[1, 0] = M[0, 1]
    M[0, 0] = I1 + m1 * r1**2 + (m2 + tip) * a1**2 + M[1, 1] + 2 * b * cos(q2)
    M[2, 2] = m3 + m4
    M[0, 3] = M[1, 3] = M[3, 0] = M[3, 1] = M[3, 3] = I4
    h = b * sin(q2)
    C = np.zeros((4, 4))
    C[0, 0] = -h * qd2
    C[0, 1] = -h * (qd1 + qd2)
    C[1, 0] = h * qd1
    G = np.zeros(4)
    G[2] = -(m3 + m4) * g
    return M, C, G


def mass_matrix(q):
    return dynamics(q, np.zeros(4))[0]


def coriolis_matrix(q, v):
    return dynamics(q, v)[1]


def gravity(q):
    return dynamics(q, np.zeros(4))[2]
