"""Two links hanging in a vertical plane, solved for the accelerations."""

import numpy as np

m1 = 1.21
m2 = 0.83
l1 = 0.41
lc1 = 0.17
lc2 = 0.23
I1 = 0.021
I2 = 0.013
g = 9.81


def forward_dynamics(q, v, tau):
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    a = I1 + I2 + m1 * lc1**2 + m2 * (l1**2 + lc2**2)
    b = m2 * l1 * lc2
    d = I2 + m2 * lc2**2
    d11, d12, d22 = a + 2 * b * c2, d + b * c2, d
    h1 = -b * s2 * (2 * v[0] * v[1] + v[1] ** 2)
    h2 = b * s2 * v[0] ** 2
    g1 = m1 * lc1 * g * np.sin(q[0]) + m2 * g * (l1 * np.sin(q[0]) + lc2 * np.sin(q[0] + q[1]))
    g2 = m2 * g * lc2 * np.sin(q[0] + q[1])
    r1, r2 = tau[0] - h1 - g1, tau[1] - h2 - g2
    det = d11 * d22 - d12 * d12
    return np.array([(d22 * r1 - d12 * r2) / det, (d11 * r2 - d12 * r1) / det])
