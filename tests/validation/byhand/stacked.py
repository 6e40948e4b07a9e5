"""Closed form of Lynch and Park: M = A' L' G L A with stacked matrices, for a yaw, a roll and a pitch."""

import numpy as np
from scipy.linalg import block_diag, expm

N = 3
home = [np.array([0.0, 0.0, 0.28]), np.array([0.11, 0.0, 0.07]), np.array([0.24, -0.05, 0.0])]
screws = np.array([
    [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
])
mass = [3.3, 2.1, 0.9]
com = [np.array([0.03, 0.0, 0.05]), np.array([0.1, 0.02, 0.0]), np.array([0.08, 0.0, 0.03])]
I1, I2, I3 = np.diag([0.02, 0.017, 0.012]), np.diag([0.003, 0.011, 0.0105]), np.diag([0.0009, 0.0024, 0.002])
g = 9.81


def skew(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def inertia(m, c, I):
    S = skew(c)
    return np.block([[I - m * S @ S, m * S], [-m * S, m * np.eye(3)]])


def se3(xi):
    return np.block([[skew(xi[:3]), xi[3:, None]], [np.zeros((1, 4))]])


def Ad(T):
    R, p = T[:3, :3], T[:3, 3]
    return np.block([[R, np.zeros((3, 3))], [skew(p) @ R, R]])


def ad(V):
    return np.block([[skew(V[:3]), np.zeros((3, 3))], [skew(V[3:]), skew(V[:3])]])


A = block_diag(*[s[:, None] for s in screws])
G = block_diag(*[inertia(m, c, I) for m, c, I in zip(mass, com, (I1, I2, I3))])


def shifts(q):
    """Return W, in which Ad(T[i, i-1]) stands below the diagonal, and Ad(T[1, 0])."""
    W = np.zeros((6 * N, 6 * N))
    first = None
    for i in range(N):
        M = np.eye(4)
        M[:3, 3] = home[i]
        X = Ad(np.linalg.inv(M @ expm(se3(screws[i]) * q[i])))
        if i == 0:
            first = X
        else:
            W[6 * i : 6 * i + 6, 6 * i - 6 : 6 * i] = X
    return W, first


def mass_matrix(q):
    W, _ = shifts(q)
    L = np.linalg.inv(np.eye(6 * N) - W)
    return A.T @ L.T @ G @ L @ A


def coriolis_torque(q, qd):
    W, _ = shifts(q)
    L = np.linalg.inv(np.eye(6 * N) - W)
    V = L @ A @ qd
    adV = block_diag(*[ad(v) for v in V.reshape(N, 6)])
    adA = block_diag(*[ad(s * u) for s, u in zip(screws, qd)])
    return -A.T @ L.T @ (G @ L @ adA @ W + adV.T @ G) @ L @ A @ qd


def gravity(q):
    W, first = shifts(q)
    L = np.linalg.inv(np.eye(6 * N) - W)
    base = np.zeros(6 * N)
    base[:6] = first @ np.array([0, 0, 0, 0, 0, g])
    return A.T @ L.T @ G @ L @ base
