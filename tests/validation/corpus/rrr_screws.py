"""Turret, shoulder and elbow by the product of exponentials (as in Murray et al. 1994, ch. 3 and 4)."""

import numpy as np

m1 = 1.6
m2 = 1.2
m3 = 0.7
h1 = 0.29
l2 = 0.38
c2 = 0.17
c3 = 0.2
Ia = 0.011
Ib = 0.017
Ic = 0.015
g = 9.81

AXES = [np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0]), np.array([0.0, -1.0, 0.0])]
POINTS = [np.zeros(3), np.array([0.0, 0.0, h1]), np.array([l2, 0.0, h1])]
HOMES = [np.zeros(3), np.array([c2, 0.0, h1]), np.array([l2 + c3, 0.0, h1])]
MASSES = [m1, m2, m3]
INERTIAS = [np.diag([Ia, Ib, Ic]), np.diag([Ib, Ic, Ia]), np.diag([Ia, Ic, Ib])]


def hat(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def exponential(w, p, angle):
    W = hat(w)
    R = np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = p - R @ p
    return T


def body(q, k):
    T, J = np.eye(4), np.zeros((6, 3))
    twists = []
    for w, p, angle in zip(AXES[: k + 1], POINTS, q, strict=False):
        twists.append((T[:3, :3] @ w, T[:3, :3] @ p + T[:3, 3]))
        T = T @ exponential(w, p, angle)
    c = T[:3, :3] @ HOMES[k] + T[:3, 3]
    for i, (w, p) in enumerate(twists):
        J[:3, i] = np.cross(w, c - p)
        J[3:, i] = w
    return J, T[:3, :3]


def mass_matrix(q):
    D = np.zeros((3, 3))
    for k in range(3):
        J, R = body(q, k)
        M = np.zeros((6, 6))
        M[:3, :3] = MASSES[k] * np.eye(3)
        M[3:, 3:] = R @ INERTIAS[k] @ R.T
        D += J.T @ M @ J
    return D


def gravity(q):
    total = np.zeros(3)
    for k in range(3):
        J, _ = body(q, k)
        total += MASSES[k] * g * J[2]
    return total
