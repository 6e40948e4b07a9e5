"""Craig's frames (a and alpha of the link before) for a Puma with four joints; C by loops, complex steps."""

import numpy as np

# alpha of the link before, a of the link before, d
table = [
    (0.0, 0.0, 0.0),
    (-np.pi / 2, 0.0, 0.243),
    (0.0, 0.432, -0.093),
    (-np.pi / 2, -0.02, 0.433),
]
masses = [4.2, 9.1, 5.3, 1.2]
centers = np.array([[0.0, 0.01, -0.05], [0.068, 0.006, -0.016], [0.0, -0.07, 0.014], [0.0, 0.0, -0.019]])
moments = [[0.11, 0.09, 0.07], [0.13, 0.524, 0.539], [0.066, 0.0125, 0.086], [0.0018, 0.0018, 0.0013]]
g0 = np.array([0.0, 0.0, -9.81])
n = 4


def link_transform(alpha, a, d, theta):
    ct, st = np.cos(theta), np.sin(theta)
    ca, sa = np.cos(alpha), np.sin(alpha)
    return np.array([
        [ct, -st, 0.0, a],
        [st * ca, ct * ca, -sa, -sa * d],
        [st * sa, ct * sa, ca, ca * d],
        [0.0, 0.0, 0.0, 1.0],
    ])


def frames(q):
    T = np.eye(4)
    out = []
    for i in range(n):
        alpha, a, d = table[i]
        T = T @ link_transform(alpha, a, d, q[i])
        out.append(T)
    return out


def jacobians(q, k):
    """Return the Jacobians of the centre of mass and of the turning of link k."""
    T = frames(q)
    Jv = np.zeros((3, n), dtype=np.asarray(q).dtype)
    Jw = np.zeros((3, n), dtype=np.asarray(q).dtype)
    pc = T[k][:3, :3] @ centers[k] + T[k][:3, 3]
    for j in range(k + 1):
        z = T[j][:3, 2]
        Jv[:, j] = np.cross(z, pc - T[j][:3, 3])
        Jw[:, j] = z
    return Jv, Jw


def mass_matrix(q):
    T = frames(q)
    D = 0
    for k in range(n):
        Jv, Jw = jacobians(q, k)
        R = T[k][:3, :3]
        D = D + masses[k] * Jv.T @ Jv + Jw.T @ R @ np.diag(moments[k]) @ R.T @ Jw
    return D


def coriolis_matrix(q, qd):
    dD = []
    for k in range(n):
        step = np.zeros(n, dtype=complex)
        step[k] = 1e-30j
        dD.append(mass_matrix(q + step).imag / 1e-30)
    C = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for k in range(n):
                C[i, j] += 0.5 * (dD[k][i, j] + dD[j][i, k] - dD[i][j, k]) * qd[k]
    return C


def gravity(q):
    G = np.zeros(n)
    for k in range(n):
        Jv, _ = jacobians(q, k)
        G -= masses[k] * Jv.T @ g0
    return G
