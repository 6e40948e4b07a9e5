"""Twists (v, w) in the base frame as in Murray, Li and Sastry: a yaw, a pitch and a roll."""

import numpy as np

twists = [
    np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    np.array([-0.32, 0.0, 0.06, 0.0, 1.0, 0.0]),
    np.array([0.0, 0.32, 0.0, 1.0, 0.0, 0.0]),
]
centres = [np.array([0.02, 0.0, 0.15]), np.array([0.18, 0.0, 0.32]), np.array([0.36, 0.02, 0.32])]
masses = [2.6, 1.9, 0.6]
moments = [[0.021, 0.017, 0.011], [0.003, 0.013, 0.012], [0.0008, 0.0019, 0.0017]]
gravity_acceleration = np.array([0.0, 0.0, -9.81])


def hat(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def exponential(xi, theta):
    v, w = xi[:3], xi[3:]
    W = hat(w)
    R = np.eye(3) + W * np.sin(theta) + W @ W * (1 - np.cos(theta))
    p = (np.eye(3) - R) @ np.cross(w, v) + w * (w @ v) * theta
    return R, p


def adjoint(R, p):
    return np.block([[R, hat(p) @ R], [np.zeros((3, 3)), R]])


def inverse_adjoint(R, p):
    return np.block([[R.T, -R.T @ hat(p)], [np.zeros((3, 3)), R.T]])


def bracket(xi):
    v, w = hat(xi[:3]), hat(xi[3:])
    return np.block([[w, v], [np.zeros((3, 3)), w]])


def inverse_dynamics(theta, dtheta, ddtheta):
    R, p = np.eye(3), np.zeros(3)
    V, A = np.zeros(6), np.zeros(6)
    A[:3] = -gravity_acceleration
    columns, wrenches = [], []
    for k in range(3):
        S = adjoint(R, p) @ twists[k]
        A = A + S * ddtheta[k] + bracket(V) @ S * dtheta[k]
        V = V + S * dtheta[k]
        E, e = exponential(twists[k], theta[k])
        p = p + R @ e
        R = R @ E
        c = p + R @ centres[k]
        I = np.diag(masses[k] * np.ones(6))
        I[3:, 3:] = np.diag(moments[k])
        X = inverse_adjoint(R, c)
        G = X.T @ I @ X
        columns.append(S)
        wrenches.append(G @ A - bracket(V).T @ G @ V)
    return np.array([columns[k] @ sum(wrenches[k:]) for k in range(3)])
