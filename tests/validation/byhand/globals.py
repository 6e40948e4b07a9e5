"""A script from MATLAB with four turns: update() fills the module's arrays, a page per link; degrees."""

import numpy as np

n = 4
g0 = np.array([0, 0, -9.81])
# a, alpha [deg], d
DH = np.array([
    [0.057, 90, 0.286],
    [0.334, 0, 0.031],
    [0.048, -90, 0.022],
    [0.112, 0, 0.193],
])
ml = np.array([5.27, 3.84, 1.93, 0.68])
# centres of mass, a column per link, in the link's own frame
rc = np.array([
    [-0.041, -0.173, -0.029, -0.061],
    [-0.067, 0.012, 0.016, 0.007],
    [0.019, 0.028, 0.034, 0.013],
])
Ic = np.zeros((3, 3, n))
Ic[:, :, 0] = np.diag([0.0387, 0.0264, 0.0351])
Ic[:, :, 1] = np.diag([0.0106, 0.0587, 0.0543])
Ic[:, :, 2] = np.diag([0.0049, 0.0063, 0.0057])
Ic[:, :, 3] = np.diag([0.0009, 0.0017, 0.0015])

R = np.zeros((3, 3, n + 1))
o = np.zeros((3, n + 1))
z = np.zeros((3, n + 1))
w = np.zeros((3, n + 1))
od = np.zeros((3, n + 1))
zd = np.zeros((3, n + 1))
pc = np.zeros((3, n))
pcd = np.zeros((3, n))
Jv = np.zeros((3, n, n))
Jw = np.zeros((3, n, n))
dJv = np.zeros((3, n, n))
dJw = np.zeros((3, n, n))


def update(q, qd):
    R[:, :, 0] = np.eye(3)
    z[:, 0] = [0, 0, 1]
    for i in range(n):
        a, d = DH[i, 0], DH[i, 2]
        alpha = np.deg2rad(DH[i, 1])
        ct, st, ca, sa = np.cos(q[i]), np.sin(q[i]), np.cos(alpha), np.sin(alpha)
        A = np.array([[ct, -st * ca, st * sa], [st, ct * ca, -ct * sa], [0, sa, ca]])
        p = np.array([a * ct, a * st, d])
        R[:, :, i + 1] = R[:, :, i] @ A
        o[:, i + 1] = o[:, i] + R[:, :, i] @ p
        z[:, i + 1] = R[:, 2, i + 1]
        pc[:, i] = o[:, i + 1] + R[:, :, i + 1] @ rc[:, i]
        # velocities
        w[:, i + 1] = w[:, i] + z[:, i] * qd[i]
        od[:, i + 1] = od[:, i] + np.cross(w[:, i + 1], o[:, i + 1] - o[:, i])
        zd[:, i + 1] = np.cross(w[:, i + 1], z[:, i + 1])
        pcd[:, i] = od[:, i + 1] + np.cross(w[:, i + 1], pc[:, i] - o[:, i + 1])
    for i in range(n):
        for j in range(i + 1):
            r, rd = pc[:, i] - o[:, j], pcd[:, i] - od[:, j]
            Jv[:, j, i] = np.cross(z[:, j], r)
            Jw[:, j, i] = z[:, j]
            dJv[:, j, i] = np.cross(zd[:, j], r) + np.cross(z[:, j], rd)
            dJw[:, j, i] = zd[:, j]


def M(q):
    update(q, np.zeros(n))
    out = np.zeros((n, n))
    for i in range(n):
        I0 = R[:, :, i + 1] @ Ic[:, :, i] @ R[:, :, i + 1].T
        out = out + ml[i] * Jv[:, :, i].T @ Jv[:, :, i] + Jw[:, :, i].T @ I0 @ Jw[:, :, i]
    return out


def coriolis_torque(q, qd):
    update(q, qd)
    out = np.zeros(n)
    for i in range(n):
        I0 = R[:, :, i + 1] @ Ic[:, :, i] @ R[:, :, i + 1].T
        wi = w[:, i + 1]
        force = ml[i] * dJv[:, :, i] @ qd
        moment = I0 @ dJw[:, :, i] @ qd + np.cross(wi, I0 @ wi)
        out = out + Jv[:, :, i].T @ force + Jw[:, :, i].T @ moment
    return out


def G(q):
    update(q, np.zeros(n))
    out = np.zeros(n)
    for i in range(n):
        out = out - Jv[:, :, i].T @ (ml[i] * g0)
    return out
