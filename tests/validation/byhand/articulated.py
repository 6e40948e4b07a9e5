"""Articulated bodies in the plane (slide, turn, turn): planar spatial vectors (turn, x, y)."""

import numpy as np

MASS = [2.8, 1.2, 0.6]
CENTRE = [0.0, 0.21, 0.16]
MOMENT = [0.01, 0.024, 0.0071]
LENGTH = [0.0, 0.44]
GRAVITY = 9.81
S = [np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])]


def inertia(k):
    m, c = MASS[k], CENTRE[k]
    return np.array([[MOMENT[k] + m * c * c, 0.0, m * c], [0.0, m, 0.0], [m * c, 0.0, m]])


def shift(angle, r):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [s * r[0] - c * r[1], c, s], [c * r[0] + s * r[1], -s, c]])


def cross(v):
    return np.array([[0.0, 0.0, 0.0], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def forward_dynamics(q, qd, tau):
    X = [shift(0.0, (q[0], 0.0)), shift(q[1], (0.0, 0.0)), shift(q[2], (LENGTH[1], 0.0))]
    v, c, IA, pA = [], [], [], []
    for k in range(3):
        before = X[k] @ v[k - 1] if k else np.zeros(3)
        v.append(before + S[k] * qd[k])
        c.append(cross(v[k]) @ S[k] * qd[k])
        IA.append(inertia(k))
        pA.append(-cross(v[k]).T @ inertia(k) @ v[k])
    U, d, u = [None] * 3, [None] * 3, [None] * 3
    for k in (2, 1, 0):
        U[k] = IA[k] @ S[k]
        d[k] = S[k] @ U[k]
        u[k] = tau[k] - S[k] @ pA[k]
        if k:
            Ia = IA[k] - np.outer(U[k], U[k]) / d[k]
            pa = pA[k] + Ia @ c[k] + U[k] * u[k] / d[k]
            IA[k - 1] = IA[k - 1] + X[k].T @ Ia @ X[k]
            pA[k - 1] = pA[k - 1] + X[k].T @ pa
    a, qdd = np.array([0.0, 0.0, GRAVITY]), []
    for k in range(3):
        a = X[k] @ a + c[k]
        qdd.append((u[k] - U[k] @ a) / d[k])
        a = a + S[k] * qdd[k]
    return np.array(qdd)
