"""A 4R arm by the recursive Newton-Euler algorithm in link frames (Siciliano et al. 2009, sec. 7.5)."""

import numpy as np

m1 = 1.9
m2 = 1.4
m3 = 0.9
m4 = 0.5
d1 = 0.33
a2 = 0.36
a3 = 0.27
d4 = 0.12
y1 = -0.09
x2 = -0.16
x3 = -0.12
z4 = 0.04
Ia = 0.021
Ib = 0.013
Ic = 0.034
g = 9.81

#: d, a, alpha of every joint.
TABLE = [(d1, 0.0, np.pi / 2), (0.0, a2, 0.0), (0.0, a3, np.pi / 2), (d4, 0.0, 0.0)]
MASSES = [m1, m2, m3, m4]
CENTRES = np.array([[0.0, y1, 0.0], [x2, 0.0, 0.0], [x3, 0.0, 0.0], [0.0, 0.0, z4]])
INERTIAS = [np.diag([Ia, Ib, Ic]), np.diag([Ib, Ic, Ia]), np.diag([Ib, Ia, Ic]), np.diag([Ia, Ic, Ib])]
AXIS = np.array([0.0, 0.0, 1.0])


def rotation(theta, alpha):
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[ct, -st * ca, st * sa], [st, ct * ca, -ct * sa], [0.0, sa, ca]])


def inverse_dynamics(q, v, a):
    n = len(q)
    R = [rotation(q[i], TABLE[i][2]) for i in range(n)]
    r = [
        np.array([TABLE[i][1], TABLE[i][0] * np.sin(TABLE[i][2]), TABLE[i][0] * np.cos(TABLE[i][2])])
        for i in range(n)
    ]
    w, dw, dp = np.zeros(3), np.zeros(3), np.array([0.0, 0.0, g])
    speeds, rates, pushes = [], [], []
    for i in range(n):
        dw = R[i].T @ (dw + a[i] * AXIS + v[i] * np.cross(w, AXIS))
        w = R[i].T @ (w + v[i] * AXIS)
        dp = R[i].T @ dp + np.cross(dw, r[i]) + np.cross(w, np.cross(w, r[i]))
        dc = dp + np.cross(dw, CENTRES[i]) + np.cross(w, np.cross(w, CENTRES[i]))
        speeds.append(w)
        rates.append(dw)
        pushes.append(MASSES[i] * dc)
    tau = np.zeros(n)
    f, mu = np.zeros(3), np.zeros(3)
    for i in reversed(range(n)):
        if i < n - 1:
            f, mu = R[i + 1] @ f, R[i + 1] @ mu
        total = f + pushes[i]
        mu = (
            mu
            + np.cross(r[i], f)
            + np.cross(r[i] + CENTRES[i], pushes[i])
            + INERTIAS[i] @ rates[i]
            + np.cross(speeds[i], INERTIAS[i] @ speeds[i])
        )
        f = total
        tau[i] = mu @ (R[i].T @ AXIS)
    return tau
