"""Yaw, shoulder and elbow: the equations of a report with their numbers."""

import numpy as np


def mass_matrix(q):
    c2, c3, c23 = np.cos(q[1]), np.cos(q[2]), np.cos(q[1] + q[2])
    return np.array([
        [0.12 + 0.44 * c2**2 + 0.16 * c2 * c23 + 0.02 * c23**2, 0, 0],
        [0, 0.52 + 0.16 * c3, 0.03 + 0.08 * c3],
        [0, 0.03 + 0.08 * c3, 0.03],
    ])


def coriolis_torque(q, dq):
    s2, s3, s23 = np.sin(q[1]), np.sin(q[2]), np.sin(q[1] + q[2])
    c2, c23 = np.cos(q[1]), np.cos(q[1] + q[2])
    a = 0.44 * s2 * c2 + 0.08 * s2 * c23 + 0.08 * c2 * s23 + 0.02 * s23 * c23
    b = 0.08 * c2 * s23 + 0.02 * s23 * c23
    return np.array([
        -2 * a * dq[0] * dq[1] - 2 * b * dq[0] * dq[2],
        a * dq[0] ** 2 - 0.16 * s3 * dq[1] * dq[2] - 0.08 * s3 * dq[2] ** 2,
        b * dq[0] ** 2 + 0.08 * s3 * dq[1] ** 2,
    ])


def gravity(q):
    c2, c23 = np.cos(q[1]), np.cos(q[1] + q[2])
    return np.array([0, 13.734 * c2 + 1.962 * c23, 1.962 * c23])
