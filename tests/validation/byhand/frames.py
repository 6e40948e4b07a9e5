"""Yaw, shoulder and elbow from frames of Denavit and Hartenberg and geometric Jacobians."""

import numpy as np

a1, a2, a3, d1 = 0.07, 0.38, 0.29, 0.34
m = [3.1, 2.1, 1.2]
c1, c2, c3 = np.array([-0.05, 0.02, 0.0]), np.array([-0.2, 0.0, 0.01]), np.array([-0.14, 0.0, 0.0])
I1 = np.diag([0.022, 0.014, 0.02])
I2 = np.diag([0.004, 0.031, 0.03])
I3 = np.diag([0.0015, 0.01, 0.011])
g = np.array([0.0, 0.0, -9.81])


def A(theta, d, a, alpha):
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([
        [ct, -st * ca, st * sa, a * ct],
        [st, ct * ca, -ct * sa, a * st],
        [0, sa, ca, d],
        [0, 0, 0, 1],
    ])


def frames(q):
    T1 = A(q[0], d1, a1, np.pi / 2)
    T2 = T1 @ A(q[1], 0, a2, 0)
    T3 = T2 @ A(q[2], 0, a3, 0)
    return [np.eye(4), T1, T2, T3]


def jacobians(q):
    T = frames(q)
    out = []
    for k, c in enumerate((c1, c2, c3)):
        p = T[k + 1][:3, 3] + T[k + 1][:3, :3] @ c
        Jv, Jw = np.zeros((3, 3)), np.zeros((3, 3))
        for j in range(k + 1):
            z, o = T[j][:3, 2], T[j][:3, 3]
            Jv[:, j] = np.cross(z, p - o)
            Jw[:, j] = z
        out.append((Jv, Jw, T[k + 1][:3, :3]))
    return out


def mass_matrix(q):
    D = np.zeros((3, 3))
    for (Jv, Jw, R), mass, I in zip(jacobians(q), m, (I1, I2, I3)):
        D += mass * Jv.T @ Jv + Jw.T @ R @ I @ R.T @ Jw
    return D


def gravity(q):
    G = np.zeros(3)
    for (Jv, _, _), mass in zip(jacobians(q), m):
        G -= mass * Jv.T @ g
    return G
