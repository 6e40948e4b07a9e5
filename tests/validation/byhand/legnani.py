"""Legnani's 4x4 matrices of velocity (W) and acceleration (H), from MATLAB with cells from 1: R R P R."""

import numpy as np
from numpy import cos, eye, outer, sin, trace, zeros

N = 4
g = 9.81
kind = [None, "R", "R", "P", "R"]
u = [None, [0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, 1]]
o = [None, [0, 0, 0.118], [0.083, -0.046, 0.227], [0.154, 0.027, -0.035], [0.109, 0.016, 0.061]]
m = [None, 4.17, 2.64, 1.39, 0.58]
cg = [None, [0.022, 0.013, 0.096], [0.107, 0.029, -0.018], [0.087, -0.012, 0.015], [0.064, 0.009, 0.026]]
# xx, yy, zz, xy, xz, yz about the centre of mass
I = [
    None,
    [0.0312, 0.0283, 0.0178, 0.0021, -0.0014, 0.0017],
    [0.0089, 0.0236, 0.0217, -0.0012, 0.0019, 0.0007],
    [0.0034, 0.0092, 0.0086, 0.0006, -0.0008, 0.0003],
    [0.0009, 0.0023, 0.0019, -0.0002, 0.0004, 0.0001],
]


def one(x):
    return [None, *x]


def jtoJ(j):
    """Inertia matrix (4x4) of link j in its frame."""
    xx, yy, zz, xy, xz, yz = I[j]
    J = zeros((4, 4))
    J[0, 0] = (-xx + yy + zz) / 2
    J[1, 1] = (xx - yy + zz) / 2
    J[2, 2] = (xx + yy - zz) / 2
    J[0, 1] = J[1, 0] = -xy
    J[0, 2] = J[2, 0] = -xz
    J[1, 2] = J[2, 1] = -yz
    c = np.array([*cg[j], 1.0])
    return J + m[j] * outer(c, c)


def makeL(j):
    """L matrix of joint j in its own frame."""
    x, y, z = u[j]
    L = zeros((4, 4))
    if kind[j] == "P":
        L[:3, 3] = u[j]
    else:
        L[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    return L


def moved(j, q):
    L = makeL(j)
    if kind[j] == "P":
        return eye(4) + L * q
    return eye(4) + sin(q) * L + (1 - cos(q)) * L @ L


def invers(T):
    out = eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def dyn(q, qp, qpp, grav):
    q, qp, qpp = one(q), one(qp), one(qpp)
    T, W, H = [None] * (N + 1), [None] * (N + 1), [None] * (N + 1)
    L, J = [None] * (N + 1), [None] * (N + 1)
    T[0], W[0], H[0] = eye(4), zeros((4, 4)), zeros((4, 4))
    H[0][2, 3] = grav
    for j in range(1, N + 1):
        shift = eye(4)
        shift[:3, 3] = o[j]
        F = T[j - 1] @ shift
        L[j] = F @ makeL(j) @ invers(F)
        T[j] = F @ moved(j, q[j])
        W[j] = W[j - 1] + L[j] * qp[j]
        H[j] = H[j - 1] + L[j] * qpp[j] + L[j] @ L[j] * qp[j] ** 2
        H[j] = H[j] + 2 * W[j - 1] @ L[j] * qp[j]
        J[j] = T[j] @ jtoJ(j) @ T[j].T
    tau = zeros(N + 1)
    A = zeros((4, 4))
    for j in range(N, 0, -1):
        A = A + H[j] @ J[j]
        tau[j] = trace(A @ L[j].T)
    return tau[1:]


def mass_matrix(q):
    return np.array([dyn(q, zeros(N), e, 0.0) for e in eye(N)]).T


def coriolis_torque(q, qp):
    return dyn(q, qp, zeros(N), 0.0)


def gravity(q):
    return dyn(q, zeros(N), zeros(N), g)
