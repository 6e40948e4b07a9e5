"""Two links in a vertical plane, linear in the inertial parameters (Siciliano et al. 2009, sec. 7.3)."""

import numpy as np

m1 = 1.42
m2 = 0.87
l1 = 0.37
lc1 = 0.16
lc2 = 0.2
I1 = 0.022
I2 = 0.014
g = 9.81

PI = np.array(
    [
        I1 + m1 * lc1**2 + m2 * l1**2,
        I2 + m2 * lc2**2,
        m2 * l1 * lc2,
        m1 * lc1 + m2 * l1,
        m2 * lc2,
    ]
)


def regressor(q, v, a):
    c1, c2, s2, c12 = np.cos(q[0]), np.cos(q[1]), np.sin(q[1]), np.cos(q[0] + q[1])
    Y = np.zeros((2, 5))
    Y[0, 0] = a[0]
    Y[0, 1] = a[0] + a[1]
    Y[0, 2] = c2 * (2 * a[0] + a[1]) - s2 * (v[1] ** 2 + 2 * v[0] * v[1])
    Y[0, 3] = g * c1
    Y[0, 4] = g * c12
    Y[1, 1] = a[0] + a[1]
    Y[1, 2] = c2 * a[0] + s2 * v[0] ** 2
    Y[1, 4] = g * c12
    return Y


def inverse_dynamics(q, v, a):
    return regressor(q, v, a) @ PI
