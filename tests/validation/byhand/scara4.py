"""A SCARA with four joints: a function of its numbers returns the model's functions."""

import numpy as np


def scara(m1, m2, m3, m4, l1, l2, lc1, lc2, I1, I2, I3, I4, g):
    mt = m3 + m4
    It = I3 + I4

    def mass_matrix(q):
        c2 = np.cos(q[1])
        d22 = I2 + It + m2 * lc2**2 + mt * l2**2
        d12 = d22 + (m2 * lc2 + mt * l2) * l1 * c2
        d11 = I1 + m1 * lc1**2 + m2 * l1**2 + mt * l1**2 + d22 + 2 * (m2 * lc2 + mt * l2) * l1 * c2
        return np.array([
            [d11, d12, 0.0, I4],
            [d12, d22, 0.0, I4],
            [0.0, 0.0, mt, 0.0],
            [I4, I4, 0.0, I4],
        ])

    def coriolis_matrix(q, v):
        h = (m2 * lc2 + mt * l2) * l1 * np.sin(q[1])
        C = np.zeros((4, 4))
        C[0, 0] = -h * v[1]
        C[0, 1] = -h * (v[0] + v[1])
        C[1, 0] = h * v[0]
        return C

    def gravity(q):
        return np.array([0.0, 0.0, mt * g, 0.0])

    return mass_matrix, coriolis_matrix, gravity


mass_matrix, coriolis_matrix, gravity = scara(
    m1=5.0, m2=4.0, m3=1.5, m4=0.5, l1=0.4, l2=0.3, lc1=0.2, lc2=0.15,
    I1=0.1, I2=0.06, I3=0.01, I4=0.004, g=9.81,
)
