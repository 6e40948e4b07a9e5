"""Craig's outward and inward iterations written out for a polar arm (R, R, P) at a wall, link after link."""

import numpy as np

m1, m2, m3 = 5.1, 3.4, 1.6
P1 = np.array([0.12, 0.0, 0.23])  # frame 2 in frame 1
Pc1 = np.array([0.04, 0.0, 0.11])
Pc2 = np.array([0.03, 0.09, -0.02])
Pc3 = np.array([0.0, 0.01, 0.21])
I1 = np.diag([0.041, 0.043, 0.019])
I2 = np.diag([0.022, 0.008, 0.021])
I3 = np.diag([0.0151, 0.0142, 0.0012])
Z = np.array([0.0, 0.0, 1.0])
g = 9.81


def inverse_dynamics(q, qd, qdd):
    t1, t2, d3 = q
    c1, s1, c2, s2 = np.cos(t1), np.sin(t1), np.cos(t2), np.sin(t2)
    R01 = np.array([[c1, -s1, 0], [s1, c1, 0], [0, 0, 1]])
    R12 = np.array([[c2, -s2, 0], [0, 0, -1], [s2, c2, 0]])
    R23 = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    R10, R21, R32 = R01.T, R12.T, R23.T
    P2 = np.array([0.0, d3, 0.0])

    # link 1
    w1 = qd[0] * Z
    wd1 = qdd[0] * Z
    vd1 = R10 @ np.array([-g, 0.0, 0.0])
    vdc1 = np.cross(wd1, Pc1) + np.cross(w1, np.cross(w1, Pc1)) + vd1
    F1 = m1 * vdc1
    N1 = I1 @ wd1 + np.cross(w1, I1 @ w1)

    # link 2
    w2 = R21 @ w1 + qd[1] * Z
    wd2 = R21 @ wd1 + np.cross(R21 @ w1, qd[1] * Z) + qdd[1] * Z
    vd2 = R21 @ (np.cross(wd1, P1) + np.cross(w1, np.cross(w1, P1)) + vd1)
    vdc2 = np.cross(wd2, Pc2) + np.cross(w2, np.cross(w2, Pc2)) + vd2
    F2 = m2 * vdc2
    N2 = I2 @ wd2 + np.cross(w2, I2 @ w2)

    # link 3 slides
    w3 = R32 @ w2
    wd3 = R32 @ wd2
    vd3 = R32 @ (np.cross(wd2, P2) + np.cross(w2, np.cross(w2, P2)) + vd2)
    vd3 = vd3 + 2 * np.cross(w3, qd[2] * Z) + qdd[2] * Z
    vdc3 = np.cross(wd3, Pc3) + np.cross(w3, np.cross(w3, Pc3)) + vd3
    F3 = m3 * vdc3
    N3 = I3 @ wd3 + np.cross(w3, I3 @ w3)

    # inward
    f3 = F3
    n3 = N3 + np.cross(Pc3, F3)
    f2 = R23 @ f3 + F2
    n2 = N2 + R23 @ n3 + np.cross(Pc2, F2) + np.cross(P2, R23 @ f3)
    f1 = R12 @ f2 + F1
    n1 = N1 + R12 @ n2 + np.cross(Pc1, F1) + np.cross(P1, R12 @ f2)
    return np.array([n1 @ Z, n2 @ Z, f3 @ Z])
