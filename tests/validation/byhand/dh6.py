"""UR5 by the matrices of Denavit and Hartenberg, inertias turned into the base, potential by heights."""

import numpy as np

d = [0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823]
a = [0.0, -0.425, -0.39225, 0.0, 0.0, 0.0]
alpha = [np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0]
m = [3.7, 8.393, 2.275, 1.219, 1.219, 0.1879]
c = [
    [0.0, -0.02561, 0.00193],
    [0.2125, 0.0, 0.11336],
    [0.15, 0.0, 0.0265],
    [0.0, -0.0018, 0.01634],
    [0.0, 0.0018, 0.01634],
    [0.0, 0.0, -0.001159],
]
J = [
    [0.0084, 0.0064, 0.0084],
    [0.0078, 0.21, 0.20],
    [0.0016, 0.0462, 0.0451],
    [0.0016, 0.0009, 0.0017],
    [0.0018, 0.0009, 0.0016],
    [0.0001, 0.00012, 0.00015],
]
g = 9.81


def dh(theta, d, a, alpha):
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([
        [ct, -st * ca, st * sa, a * ct],
        [st, ct * ca, -ct * sa, a * st],
        [0.0, sa, ca, d],
        [0.0, 0.0, 0.0, 1.0],
    ])


def chain(q):
    T = [np.eye(4)]
    for i in range(6):
        T.append(T[i] @ dh(q[i], d[i], a[i], alpha[i]))
    return T


def mass_matrix(q):
    T = chain(q)
    D = np.zeros((6, 6))
    for i in range(6):
        R = T[i + 1][:3, :3]
        pc = T[i + 1][:3, 3] + R @ np.array(c[i])
        Jv = np.zeros((3, 6))
        Jw = np.zeros((3, 6))
        for k in range(i + 1):
            z = T[k][:3, 2]
            Jv[:, k] = np.cross(z, pc - T[k][:3, 3])
            Jw[:, k] = z
        D += m[i] * Jv.T @ Jv + Jw.T @ R @ np.diag(J[i]) @ R.T @ Jw
    return D


def gravity(q):
    T = chain(q)
    G = np.zeros(6)
    for i in range(6):
        pc = T[i + 1][:3, 3] + T[i + 1][:3, :3] @ np.array(c[i])
        for k in range(i + 1):
            G[k] += m[i] * g * np.cross(T[k][:3, 2], pc - T[k][:3, 3])[2]
    return G
