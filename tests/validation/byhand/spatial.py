"""Featherstone's recursion with spatial vectors, angular part first."""

import numpy as np

m = [2.5, 2.0, 1.0]
com = [np.array([0.0, 0.0, 0.1]), np.array([0.2, 0.0, 0.0]), np.array([0.15, 0.0, 0.0])]
Ic = [np.diag([0.02, 0.02, 0.01]), np.diag([0.004, 0.03, 0.03]), np.diag([0.002, 0.01, 0.012])]
origin = [np.zeros(3), np.array([0.0, 0.0, 0.25]), np.array([0.4, 0.0, 0.0])]
axis = [np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0]), np.array([0.0, -1.0, 0.0])]
g = 9.81


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def transform(i, t):
    K = skew(axis[i])
    E = (np.eye(3) + np.sin(t) * K + (1 - np.cos(t)) * K @ K).T
    X = np.zeros((6, 6))
    X[:3, :3] = E
    X[3:, :3] = -E @ skew(origin[i])
    X[3:, 3:] = E
    return X


def inertia(i):
    C = skew(com[i])
    S = np.zeros((6, 6))
    S[:3, :3] = Ic[i] + m[i] * C @ C.T
    S[:3, 3:] = m[i] * C
    S[3:, :3] = m[i] * C.T
    S[3:, 3:] = m[i] * np.eye(3)
    return S


def crm(v):
    W = np.zeros((6, 6))
    W[:3, :3] = skew(v[:3])
    W[3:, :3] = skew(v[3:])
    W[3:, 3:] = skew(v[:3])
    return W


def crf(v):
    return -crm(v).T


def inverse_dynamics(q, qd, qdd):
    X, f = [], []
    S = [np.concatenate([axis[i], np.zeros(3)]) for i in range(3)]
    vp = np.zeros(6)
    ap = np.array([0, 0, 0, 0, 0, g])
    for i in range(3):
        X.append(transform(i, q[i]))
        vj = S[i] * qd[i]
        vi = X[i] @ vp + vj
        ai = X[i] @ ap + S[i] * qdd[i] + crm(vi) @ vj
        P = inertia(i) @ vi
        f.append(inertia(i) @ ai + crf(vi) @ P)
        vp = vi
        ap = ai
    tau = np.zeros(3)
    for i in (2, 1, 0):
        tau[i] = S[i] @ f[i]
        if i > 0:
            f[i - 1] = f[i - 1] + X[i].T @ f[i]
    return tau
