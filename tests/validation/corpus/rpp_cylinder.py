"""A cylindrical arm (turret, lift, an arm that slides beside the axis), in the letters of a lecture."""

import numpy as np

m2 = 2.1
m3 = 0.9
e3 = 0.12
lc3 = 0.22
I1 = 0.05
I2 = 0.03
I3 = 0.02
g = 9.81


def M(q):
    r = q[2] - lc3
    J = I1 + I2 + I3
    return np.array(
        [
            [J + m3 * (r**2 + e3**2), 0.0, -m3 * e3],
            [0.0, m2 + m3, 0.0],
            [-m3 * e3, 0.0, m3],
        ]
    )


def C(q, dq):
    r = q[2] - lc3
    return m3 * r * np.array([[dq[2], 0.0, dq[0]], [0.0, 0.0, 0.0], [-dq[0], 0.0, 0.0]])


def G(q):
    return np.array([0.0, (m2 + m3) * g, 0.0])


def forward_kinematics(q):
    c, s = np.cos(q[0]), np.sin(q[0])
    return np.array([q[2] * c - e3 * s, q[2] * s + e3 * c, q[1]])
