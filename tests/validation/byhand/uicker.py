"""Uicker and Kahn as in Fu, Gonzalez and Lee: U matrices and pseudo-inertias, classic frames, three turns."""

import numpy as np

alpha = [np.pi / 2, 0.0, 0.0]
a = [0.07, 0.31, 0.26]
d = [0.29, 0.0, 0.04]
m = [3.6, 2.7, 1.4]
rbar = [np.array([-0.06, -0.05, 0.01]), np.array([-0.14, 0.0, 0.02]), np.array([-0.12, 0.01, 0.0])]
I = [[0.025, 0.013, 0.022], [0.006, 0.034, 0.031], [0.0014, 0.011, 0.0105]]
gravity_row = np.array([0.0, 0.0, -9.81, 0.0])
Q = np.zeros((4, 4))
Q[0, 1] = -1.0
Q[1, 0] = 1.0
n = 3


def A(i, t):
    ca, sa = np.cos(alpha[i]), np.sin(alpha[i])
    return np.array([
        [np.cos(t), -ca * np.sin(t), sa * np.sin(t), a[i] * np.cos(t)],
        [np.sin(t), ca * np.cos(t), -sa * np.cos(t), a[i] * np.sin(t)],
        [0.0, sa, ca, d[i]],
        [0.0, 0.0, 0.0, 1.0],
    ])


def pseudo(i):
    xx, yy, zz = I[i]
    J = np.zeros((4, 4))
    J[0, 0] = (-xx + yy + zz) / 2
    J[1, 1] = (xx - yy + zz) / 2
    J[2, 2] = (xx + yy - zz) / 2
    J[:3, :3] += m[i] * np.outer(rbar[i], rbar[i])
    J[:3, 3] = J[3, :3] = m[i] * rbar[i]
    J[3, 3] = m[i]
    return J


def T(q, i, j):
    """Return the transform from frame j to frame i."""
    out = np.eye(4)
    for k in range(i, j):
        out = out @ A(k, q[k])
    return out


def U(q, i, j):
    if j > i:
        return np.zeros((4, 4))
    return T(q, 0, j) @ Q @ T(q, j, i + 1)


def U2(q, i, j, k):
    if max(j, k) > i:
        return np.zeros((4, 4))
    lo, hi = min(j, k), max(j, k)
    return T(q, 0, lo) @ Q @ T(q, lo, hi) @ Q @ T(q, hi, i + 1)


def inverse_dynamics(q, v, acc):
    tau = np.zeros(n)
    J = [pseudo(i) for i in range(n)]
    for i in range(n):
        for j in range(i, n):
            Uji = U(q, j, i)
            for k in range(j + 1):
                tau[i] += np.trace(U(q, j, k) @ J[j] @ Uji.T) * acc[k]
                for l in range(j + 1):
                    tau[i] += np.trace(U2(q, j, k, l) @ J[j] @ Uji.T) * v[k] * v[l]
            tau[i] -= m[j] * gravity_row @ Uji @ np.append(rbar[j], 1.0)
    return tau
