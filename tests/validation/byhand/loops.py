"""Links of a vertical plane in loops: the Jacobians of all centres of mass."""

import numpy as np

n = 3
m = [2.0, 1.5, 1.0]
l = [0.4, 0.3, 0.2]
c = [0.2, 0.15, 0.1]
I = [0.03, 0.02, 0.01]
g = 9.81


def mass_matrix(q):
    th = np.cumsum(q)
    D = np.zeros((n, n))
    for k in range(n):
        J = np.zeros((2, n))
        for j in range(k + 1):
            for i in range(j, k + 1):
                r = c[i] if i == k else l[i]
                J[0, j] -= r * np.sin(th[i])
                J[1, j] += r * np.cos(th[i])
        W = np.zeros(n)
        W[: k + 1] = 1.0
        D += m[k] * J.T @ J + I[k] * np.outer(W, W)
    return D


def coriolis_torque(q, v):
    th = np.cumsum(q)
    w = np.cumsum(v)
    tau = np.zeros(n)
    for k in range(n):
        a = np.zeros(2)
        for i in range(k + 1):
            r = c[i] if i == k else l[i]
            a[0] -= r * np.cos(th[i]) * w[i] ** 2
            a[1] -= r * np.sin(th[i]) * w[i] ** 2
        for j in range(k + 1):
            J = np.zeros(2)
            for i in range(j, k + 1):
                r = c[i] if i == k else l[i]
                J += r * np.array([-np.sin(th[i]), np.cos(th[i])])
            tau[j] += m[k] * J @ a
    return tau


def gravity(q):
    th = np.cumsum(q)
    G = np.zeros(n)
    for k in range(n):
        for j in range(k + 1):
            for i in range(j, k):
                G[j] += m[k] * g * l[i] * np.cos(th[i])
            G[j] += m[k] * g * c[k] * np.cos(th[k])
    return G
