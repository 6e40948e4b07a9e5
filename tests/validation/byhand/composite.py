"""Composite rigid bodies, motion vectors with the linear part first: a slide, a tilt and a swing."""

import numpy as np

bodies = [
    {"kind": "P", "axis": [1, 0, 0], "at": [0, 0, 0], "m": 6.0, "c": [0, 0, 0.1], "I": [0.05, 0.06, 0.04]},
    {"kind": "R", "axis": [0, 1, 0], "at": [0, 0, 0.3], "m": 2.0,
     "c": [0.2, 0, 0], "I": [0.003, 0.03, 0.028]},
    {"kind": "R", "axis": [0, 0, 1], "at": [0.5, 0, 0], "m": 1.0,
     "c": [0.1, 0, 0.02], "I": [0.002, 0.008, 0.009]},
]
N = 3
g = 9.81


def cross(a):
    x, y, z = a
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def rotation(axis, angle):
    K = cross(axis)
    return np.identity(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


def motion(body, x):
    """Turn motion vectors of the parent into those of the body."""
    R, p = np.identity(3), np.array(body["at"], dtype=float)
    if body["kind"] == "R":
        R = rotation(body["axis"], x)
    else:
        p = p + x * np.array(body["axis"])
    top = np.hstack([R.T, -R.T @ cross(p)])
    bottom = np.hstack([np.zeros((3, 3)), R.T])
    return np.vstack([top, bottom])


def subspace(body):
    zero = [0, 0, 0]
    return np.array(zero + body["axis"] if body["kind"] == "R" else body["axis"] + zero, dtype=float)


def inertia(body):
    m, c = body["m"], cross(body["c"])
    top = np.hstack([m * np.identity(3), -m * c])
    bottom = np.hstack([m * c, np.diag(body["I"]) - m * c @ c])
    return np.vstack([top, bottom])


def mass_matrix(q):
    X = [motion(body, x) for body, x in zip(bodies, q)]
    S = [subspace(body) for body in bodies]
    Ic = [inertia(body) for body in bodies]
    H = np.zeros((N, N))
    for i in reversed(range(N)):
        if i > 0:
            Ic[i - 1] = Ic[i - 1] + X[i].T @ Ic[i] @ X[i]
        F = Ic[i] @ S[i]
        H[i, i] = S[i] @ F
        j = i
        while j > 0:
            F = X[j].T @ F
            j = j - 1
            H[i, j] = H[j, i] = F @ S[j]
    return H


def bias(q, u, gravity):
    V = np.zeros(6)
    A = np.array([0, 0, gravity, 0, 0, 0])
    X, f = [], []
    for body, x, speed in zip(bodies, q, u):
        T = motion(body, x)
        s = subspace(body)
        V = T @ V + s * speed
        lin, ang = cross(V[:3]), cross(V[3:])
        crm = np.block([[ang, lin], [np.zeros((3, 3)), ang]])
        A = T @ A + crm @ s * speed
        I = inertia(body)
        X.append(T)
        f.append(I @ A - crm.T @ I @ V)
    tau = np.zeros(N)
    for i in reversed(range(N)):
        tau[i] = subspace(bodies[i]) @ f[i]
        if i > 0:
            f[i - 1] += X[i].T @ f[i]
    return tau


def coriolis_torque(q, u):
    return bias(q, u, 0.0)


def gravity(q):
    return bias(q, np.zeros(N), g)
