"""Base, shoulder and elbow with np.matrix and a bias that the caller adds up."""

import numpy as np

P = np.matrix([[0.02, 0.006, 0.04], [0.0, 0.002, 0.015]])


def mass_matrix(q):
    c2, c3, c23 = np.cos(q[1]), np.cos(q[2]), np.cos(q[1] + q[2])
    J = np.matrix([[0.2 * c2, 0.4 * c2 + 0.15 * c23]])
    turn = 0.02 + 0.006 * (1 - c2**2) + 0.04 * c2**2 + 0.002 * (1 - c23**2) + 0.015 * c23**2
    turn += (J * np.matrix(np.diag([3.0, 1.5])) * J.T)[0, 0]
    k = 1.5 * 0.4 * 0.15 * c3
    d3 = 0.015 + 1.5 * 0.15**2
    d2 = 0.04 + 3.0 * 0.2**2 + 1.5 * 0.4**2 + 2 * k + d3
    return np.matrix([[turn, 0, 0], [0, d2, d3 + k], [0, d3 + k, d3]])


def gravity(q):
    g3 = -1.5 * 9.81 * 0.15 * np.cos(q[1] + q[2])
    return np.matrix([[0], [g3 - 9.81 * (3.0 * 0.2 + 1.5 * 0.4) * np.cos(q[1])], [g3]])
