"""Two bodies in a plane with three coordinates each: velocities are projected on the joints' rates."""

from math import cos, sin

import numpy as np

mA, mB = 1.7, 0.95
JA, JB = 0.028, 0.0102
a, ca, cb = 0.42, 0.19, 0.17
g = 9.81
bodies = np.diag([mA, mA, JA, mB, mB, JB])
weight = np.array([0.0, -mA * g, 0.0, 0.0, -mB * g, 0.0])


def projection(q):
    s1, c1 = sin(q[0]), cos(q[0])
    s12, c12 = sin(q[0] + q[1]), cos(q[0] + q[1])
    return np.array(
        [
            [-ca * s1, 0.0],
            [ca * c1, 0.0],
            [1.0, 0.0],
            [-a * s1 - cb * s12, -cb * s12],
            [a * c1 + cb * c12, cb * c12],
            [1.0, 1.0],
        ]
    )


def projection_rate(q, v):
    s1, c1 = sin(q[0]), cos(q[0])
    s12, c12 = sin(q[0] + q[1]), cos(q[0] + q[1])
    w1, w12 = v[0], v[0] + v[1]
    return np.array(
        [
            [-ca * c1 * w1, 0.0],
            [-ca * s1 * w1, 0.0],
            [0.0, 0.0],
            [-a * c1 * w1 - cb * c12 * w12, -cb * c12 * w12],
            [-a * s1 * w1 - cb * s12 * w12, -cb * s12 * w12],
            [0.0, 0.0],
        ]
    )


def mass_matrix(q):
    P = projection(q)
    return P.T @ bodies @ P


def coriolis_torque(q, v):
    return projection(q).T @ bodies @ projection_rate(q, v) @ v


def gravity(q):
    return -projection(q).T @ weight
