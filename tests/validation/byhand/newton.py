"""Newton and Euler along the axes of the links, lists that grow, for a yaw, shoulder and elbow."""

import numpy as np

m = [3.0, 2.0, 1.0]
rc = [np.array([0.05, 0.0, 0.0]), np.array([0.2, 0.0, 0.0]), np.array([0.15, 0.0, 0.0])]
p = [np.zeros(3), np.array([0.0, 0.0, 0.3]), np.array([0.4, 0.0, 0.0])]
I = [np.diag([0.01, 0.02, 0.025]), np.diag([0.005, 0.03, 0.028]), np.diag([0.002, 0.012, 0.011])]
axes = [np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0])]
g = 9.81


def rotation(a, t):
    K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.eye(3) + np.sin(t) * K + (1 - np.cos(t)) * K @ K


def inverse_dynamics(q, qd, qdd):
    R, w, dw, ac, N, F = [], [], [], [], [], []
    wi = np.zeros(3)
    dwi = np.zeros(3)
    ai = np.array([0.0, 0.0, g])
    for i in range(3):
        Ri = rotation(axes[i], q[i])
        R.append(Ri)
        ap = ai + np.cross(dwi, p[i]) + np.cross(wi, np.cross(wi, p[i]))
        wp = Ri.T @ wi
        wi = wp + axes[i] * qd[i]
        dwi = Ri.T @ dwi + np.cross(wp, axes[i] * qd[i]) + axes[i] * qdd[i]
        ai = Ri.T @ ap
        w.append(wi)
        dw.append(dwi)
        ac.append(ai + np.cross(dwi, rc[i]) + np.cross(wi, np.cross(wi, rc[i])))
        F.append(m[i] * ac[i])
        N.append(I[i] @ dwi + np.cross(wi, I[i] @ wi))
    f = np.zeros(3)
    n = np.zeros(3)
    tau = np.zeros(3)
    for i in (2, 1, 0):
        if i < 2:
            f = R[i + 1] @ f
            n = R[i + 1] @ n + np.cross(p[i + 1], f)
        f = f + F[i]
        n = n + N[i] + np.cross(rc[i], F[i])
        tau[i] = n @ axes[i]
    return tau
