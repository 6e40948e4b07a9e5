"""Newton-Euler along the links' axes in arrays, every term by calls of one function: yaw, shoulder, elbow."""

import numpy as np

mass = np.array([2.7, 1.9, 1.1])
offset = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.31], [0.37, 0.0, 0.0]])
center = np.array([[0.01, -0.02, 0.12], [0.17, 0.01, 0.0], [0.13, 0.0, 0.02]])
tensor = np.array([
    [[0.021, 0.002, 0.0], [0.002, 0.019, 0.0], [0.0, 0.0, 0.011]],
    [[0.004, 0.0, 0.001], [0.0, 0.027, 0.0], [0.001, 0.0, 0.028]],
    [[0.002, 0.0005, 0.0], [0.0005, 0.013, 0.0], [0.0, 0.0, 0.0125]],
])
axis = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])


def rot_z(t):
    c, s = np.cos(t), np.sin(t)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rot_y(t):
    c, s = np.cos(t), np.sin(t)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rnea(q, qd, qdd, g):
    R = [rot_z(q[0]), rot_y(q[1]), rot_y(q[2])]
    omega = np.zeros((4, 3))
    alpha = np.zeros((4, 3))
    acc = np.zeros((4, 3))
    acc[0] = [0.0, 0.0, g]
    F = np.zeros((3, 3))
    N = np.zeros((3, 3))
    for i in range(3):
        Rt = R[i].T
        omega[i + 1] = Rt @ omega[i] + axis[i] * qd[i]
        alpha[i + 1] = Rt @ alpha[i] + np.cross(Rt @ omega[i], axis[i] * qd[i]) + axis[i] * qdd[i]
        joint = acc[i] + np.cross(alpha[i], offset[i]) + np.cross(omega[i], np.cross(omega[i], offset[i]))
        acc[i + 1] = Rt @ joint
        w, dw = omega[i + 1], alpha[i + 1]
        com = acc[i + 1] + np.cross(dw, center[i]) + np.cross(w, np.cross(w, center[i]))
        F[i] = mass[i] * com
        N[i] = tensor[i] @ dw + np.cross(w, tensor[i] @ w)
    tau = np.zeros(3)
    f = np.zeros(3)
    n = np.zeros(3)
    for i in range(2, -1, -1):
        n = n + N[i] + np.cross(center[i], F[i])
        f = f + F[i]
        tau[i] = n @ axis[i]
        n = R[i] @ n + np.cross(offset[i], R[i] @ f)
        f = R[i] @ f
    return tau


def inverse_dynamics(q, qd, qdd):
    return rnea(q, qd, qdd, 9.81)


def gravity(q):
    return rnea(q, np.zeros(3), np.zeros(3), 9.81)


def coriolis_torque(q, qd):
    return rnea(q, qd, np.zeros(3), 0.0)


def mass_matrix(q):
    M = np.zeros((3, 3))
    for k in range(3):
        e = np.zeros(3)
        e[k] = 1.0
        M[:, k] = rnea(q, np.zeros(3), e, 0.0)
    return M
