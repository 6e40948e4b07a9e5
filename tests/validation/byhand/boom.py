"""Newton-Euler in loops, all vectors in the base frame: a yaw, a pitch and a boom that slides out."""

import numpy as np
from numpy import array, cross

mass = [2.2, 1.7, 0.9]
axes = [array([0.0, 0.0, 1.0]), array([0.0, 1.0, 0.0]), array([1.0, 0.0, 0.0])]
offset = [array([0.0, 0.0, 0.0]), array([0.05, 0.0, 0.3]), array([0.12, 0.0, 0.0])]
com = [array([0.03, 0.0, 0.12]), array([0.09, 0.0, 0.02]), array([0.07, 0.01, 0.0])]
inertia = [np.diag([0.02, 0.018, 0.012]), np.diag([0.004, 0.012, 0.011]), np.diag([0.001, 0.004, 0.0045])]
slides = [False, False, True]
g = 9.81


def turn(axis, angle):
    x, y, z = axis
    K = array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def inverse_dynamics(q, dq, ddq):
    R = np.eye(3)
    w, dw = np.zeros(3), np.zeros(3)
    dv = array([0.0, 0.0, g])
    arms, coms, lines, forces, moments = [], [], [], [], []
    for i in range(3):
        arm = R @ offset[i]
        z = R @ axes[i]
        if slides[i]:
            arm = arm + z * q[i]
        dv = dv + cross(dw, arm) + cross(w, cross(w, arm))
        if slides[i]:
            dv = dv + z * ddq[i] + 2 * cross(w, z) * dq[i]
        else:
            R = R @ turn(axes[i], q[i])
            dw = dw + z * ddq[i] + cross(w, z) * dq[i]
            w = w + z * dq[i]
        s = R @ com[i]
        I = R @ inertia[i] @ R.T
        a = dv + cross(dw, s) + cross(w, cross(w, s))
        arms.append(arm)
        coms.append(s)
        lines.append(z)
        forces.append(mass[i] * a)
        moments.append(I @ dw + cross(w, I @ w))

    f, n = np.zeros(3), np.zeros(3)
    tau = np.zeros(3)
    for i in (2, 1, 0):
        n = n + moments[i] + cross(coms[i], forces[i])
        f = f + forces[i]
        tau[i] = lines[i] @ f if slides[i] else lines[i] @ n
        n = n + cross(arms[i], f)
    return tau
