"""The SCARA as a regressor times base parameters."""

import numpy as np

theta = np.array([
    0.1 + 5.0 * 0.2**2 + 4.0 * 0.4**2 + 2.0 * 0.4**2,
    0.06 + 0.014 + 4.0 * 0.15**2 + 2.0 * 0.3**2,
    0.4 * (4.0 * 0.15 + 2.0 * 0.3),
    2.0,
    0.004,
])


def regressor(q, v, a):
    c, s = np.cos(q[1]), np.sin(q[1])
    Y = np.zeros((4, 5))
    Y[0] = [a[0], a[0] + a[1], c * (2 * a[0] + a[1]) - s * (2 * v[0] + v[1]) * v[1], 0, a[3]]
    Y[1] = [0, a[0] + a[1], c * a[0] + s * v[0] ** 2, 0, a[3]]
    Y[2, 3] = a[2] + 9.81
    Y[3, 4] = a[0] + a[1] + a[3]
    return Y


inverse_dynamics = lambda q, v, a: regressor(q, v, a) @ theta  # noqa: E731
