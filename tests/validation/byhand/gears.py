"""Two links by their absolute angles, motors with gears at both joints."""

import numpy as np

m1, m2 = 2.0, 1.0
l1, lc1, lc2 = 0.4, 0.2, 0.15
I1, I2 = 0.03, 0.01
N1, N2 = 100, 50
Jm1, Jm2 = 2e-5, 1e-5
g = 9.81
B = np.array([[1.0, 0.0], [1.0, 1.0]])


def mass_matrix(q):
    th1 = q[0]
    th2 = q[0] + q[1]
    a = I1 + m1 * lc1**2 + m2 * l1**2
    b = m2 * l1 * lc2 * np.cos(th2 - th1)
    d = I2 + m2 * lc2**2
    rotors = np.diag([N1**2 * Jm1, N2**2 * Jm2])
    return B.T @ np.array([[a, b], [b, d]]) @ B + rotors


def coriolis_torque(q, v):
    th1 = q[0]
    th2 = q[0] + q[1]
    w1 = v[0]
    w2 = v[0] + v[1]
    h = m2 * l1 * lc2 * np.sin(th2 - th1)
    return B.T @ np.array([-h * w2**2, h * w1**2])


def gravity(q):
    th1 = q[0]
    th2 = q[0] + q[1]
    G1 = (m1 * lc1 + m2 * l1) * g * np.cos(th1)
    G2 = m2 * lc2 * g * np.cos(th2)
    return B.T @ np.array([G1, G2])
