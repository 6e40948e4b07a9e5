"""Products of exponentials with twists (w, v), as in Modern Robotics: base, shoulder and elbow."""

import numpy as np

g = np.array([0.0, 0.0, -9.81])
M01 = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.1], [0, 0, 0, 1.0]])
M12 = np.array([[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0.15], [0, 0, 0, 1.0]])
M23 = np.array([[1, 0, 0, 0.35], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
G1 = np.diag([0.03, 0.03, 0.02, 4.0, 4.0, 4.0])
G2 = np.diag([0.006, 0.04, 0.04, 3.0, 3.0, 3.0])
G3 = np.diag([0.002, 0.015, 0.015, 1.5, 1.5, 1.5])
S1 = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
S2 = np.array([0.0, 1.0, 0.0, -0.25, 0.0, 0.0])
S3 = np.array([0.0, 1.0, 0.0, -0.25, 0.0, 0.4])
Mlist = [M01, M12, M23]
Glist = [G1, G2, G3]
Slist = [S1, S2, S3]


def VecToso3(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def MatrixExp6(S, theta):
    W = VecToso3(S[:3])
    R = np.eye(3) + np.sin(theta) * W + (1 - np.cos(theta)) * W @ W
    V = np.eye(3) * theta + (1 - np.cos(theta)) * W + (theta - np.sin(theta)) * W @ W
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = V @ S[3:]
    return T


def TransInv(T):
    R, p = T[:3, :3], T[:3, 3]
    out = np.eye(4)
    out[:3, :3] = R.T
    out[:3, 3] = -R.T @ p
    return out


def Adjoint(T):
    R, p = T[:3, :3], T[:3, 3]
    out = np.zeros((6, 6))
    out[:3, :3] = R
    out[3:, :3] = VecToso3(p) @ R
    out[3:, 3:] = R
    return out


def ad(V):
    out = np.zeros((6, 6))
    out[:3, :3] = VecToso3(V[:3])
    out[3:, :3] = VecToso3(V[3:])
    out[3:, 3:] = VecToso3(V[:3])
    return out


def inverse_dynamics(thetalist, dthetalist, ddthetalist):
    n = len(Slist)
    Mi = np.eye(4)
    A = [None] * n
    AdT = [None] * n
    V = [np.zeros(6)] + [None] * n
    Vd = [np.r_[np.zeros(3), -g]] + [None] * n
    for i in range(n):
        Mi = Mi @ Mlist[i]
        A[i] = Adjoint(TransInv(Mi)) @ Slist[i]
        AdT[i] = Adjoint(MatrixExp6(A[i], -thetalist[i]) @ TransInv(Mlist[i]))
        V[i + 1] = AdT[i] @ V[i] + A[i] * dthetalist[i]
        Vd[i + 1] = AdT[i] @ Vd[i] + A[i] * ddthetalist[i] + ad(V[i + 1]) @ A[i] * dthetalist[i]
    F = np.zeros(6)
    tau = np.zeros(n)
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            F = AdT[i + 1].T @ F
        F = F + Glist[i] @ Vd[i + 1] - ad(V[i + 1]).T @ (Glist[i] @ V[i + 1])
        tau[i] = F @ A[i]
    return tau
