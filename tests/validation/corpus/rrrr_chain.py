"""Four links in a vertical plane with matrices of absolute angles (as chains of pendulums are written)."""

import numpy as np

m1 = 1.7
m2 = 1.3
m3 = 0.9
m4 = 0.5
l1 = 0.36
l2 = 0.31
l3 = 0.24
lc1 = 0.17
lc2 = 0.15
lc3 = 0.11
lc4 = 0.08
I1 = 0.019
I2 = 0.016
I3 = 0.013
I4 = 0.011
g = 9.81

m = np.array([m1, m2, m3, m4])
REACH = np.array(
    [
        [lc1, 0.0, 0.0, 0.0],
        [l1, lc2, 0.0, 0.0],
        [l1, l2, lc3, 0.0],
        [l1, l2, l3, lc4],
    ]
)
K = REACH.T @ np.diag(m) @ REACH
J = np.diag([I1, I2, I3, I4])
B = np.tril(np.ones((4, 4)))


def mass_matrix(q):
    angle = B @ q
    cosines = np.cos(angle[:, None] - angle)
    return B.T @ (K * cosines + J) @ B


def coriolis_torque(q, v):
    angle = B @ q
    w = B @ v
    sines = np.sin(angle[:, None] - angle)
    return B.T @ ((K * sines) @ w**2)


def gravity(q):
    angle = B @ q
    weights = g * (m @ REACH)
    return B.T @ (weights * np.cos(angle))
