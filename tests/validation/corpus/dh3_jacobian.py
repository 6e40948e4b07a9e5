"""A 3R arm from its Denavit-Hartenberg table: D and G by the Jacobians of the centres of mass."""

import numpy as np

m1 = 1.7
m2 = 1.3
m3 = 0.8
d1 = 0.31
a2 = 0.37
a3 = 0.29
x1 = -0.06
x2 = -0.15
x3 = -0.11
Ia = 0.021
Ib = 0.013
Ic = 0.034
g = 9.81

#: theta offset, d, a, alpha of every joint.
TABLE = [(0.0, d1, 0.0, np.pi / 2), (0.0, 0.0, a2, 0.0), (0.0, 0.0, a3, 0.0)]
MASSES = [m1, m2, m3]
CENTRES = [(0.0, x1, 0.0), (x2, 0.0, 0.0), (x3, 0.0, 0.0)]
INERTIAS = [np.diag([Ia, Ib, Ic]), np.diag([Ib, Ic, Ia]), np.diag([Ib, Ia, Ic])]
DOWN = np.array([0.0, 0.0, -g])


def step(theta, d, a, alpha):
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def frames(q):
    found = [np.eye(4)]
    for theta, (offset, d, a, alpha) in zip(q, TABLE, strict=True):
        found.append(found[-1] @ step(theta + offset, d, a, alpha))
    return found


def body_jacobians(q, k):
    T = frames(q)
    R = T[k + 1][:3, :3]
    c = T[k + 1][:3, 3] + R @ np.array(CENTRES[k])
    Jv, Jw = np.zeros((3, 3)), np.zeros((3, 3))
    for j in range(k + 1):
        z, o = T[j][:3, 2], T[j][:3, 3]
        Jv[:, j] = np.cross(z, c - o)
        Jw[:, j] = z
    return Jv, Jw, R


def mass_matrix(q):
    D = np.zeros((3, 3))
    for k in range(3):
        Jv, Jw, R = body_jacobians(q, k)
        D += MASSES[k] * Jv.T @ Jv + Jw.T @ R @ INERTIAS[k] @ R.T @ Jw
    return D


def gravity(q):
    G = np.zeros(3)
    for k in range(3):
        Jv, _, _ = body_jacobians(q, k)
        G -= MASSES[k] * Jv.T @ DOWN
    return G


def forward_kinematics(q):
    return frames(q)[-1][:3, 3]
