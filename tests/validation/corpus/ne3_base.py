"""A 3R arm by Newton and Euler with all vectors along the axes of the base (as in Craig 2005, ch. 6)."""

import numpy as np

m1 = 1.6
m2 = 1.1
m3 = 0.6
h1 = 0.28
l2 = 0.39
c1 = 0.11
c2 = 0.18
c3 = 0.15
Ia = 0.019
Ib = 0.012
Ic = 0.027
g = 9.81

UP = np.array([0.0, 0.0, 1.0])


def rot_z(x):
    return np.array([[np.cos(x), -np.sin(x), 0.0], [np.sin(x), np.cos(x), 0.0], [0.0, 0.0, 1.0]])


def rot_y(x):
    return np.array([[np.cos(x), 0.0, np.sin(x)], [0.0, 1.0, 0.0], [-np.sin(x), 0.0, np.cos(x)]])


def inverse_dynamics(q, v, a):
    R1 = rot_z(q[0])
    R2 = R1 @ rot_y(q[1])
    R3 = R2 @ rot_y(q[2])
    y = R1 @ np.array([0.0, 1.0, 0.0])
    # Velocities and accelerations, outwards.
    w1 = v[0] * UP
    b1 = a[0] * UP
    w2 = w1 + v[1] * y
    b2 = b1 + a[1] * y + np.cross(w1, v[1] * y)
    w3 = w2 + v[2] * y
    b3 = b2 + a[2] * y + np.cross(w2, v[2] * y)
    r1, r2, r3 = R1 @ np.array([c1, 0.0, 0.0]), R2 @ np.array([c2, 0.0, 0.0]), R3 @ np.array([c3, 0.0, 0.0])
    s1, s2 = h1 * UP, R2 @ np.array([l2, 0.0, 0.0])
    p0 = g * UP
    p1 = p0 + np.cross(b1, r1) + np.cross(w1, np.cross(w1, r1))
    p2 = p0 + np.cross(b1, s1) + np.cross(w1, np.cross(w1, s1))
    p3 = p2 + np.cross(b2, s2) + np.cross(w2, np.cross(w2, s2))
    f1 = m1 * p1
    f2 = m2 * (p2 + np.cross(b2, r2) + np.cross(w2, np.cross(w2, r2)))
    f3 = m3 * (p3 + np.cross(b3, r3) + np.cross(w3, np.cross(w3, r3)))
    I1 = R1 @ np.diag([Ia, Ib, Ic]) @ R1.T
    I2 = R2 @ np.diag([Ib, Ic, Ia]) @ R2.T
    I3 = R3 @ np.diag([Ia, Ic, Ib]) @ R3.T
    # Forces and moments, inwards.
    n3 = I3 @ b3 + np.cross(w3, I3 @ w3) + np.cross(r3, f3)
    n2 = I2 @ b2 + np.cross(w2, I2 @ w2) + np.cross(r2, f2) + n3 + np.cross(s2, f3)
    n1 = I1 @ b1 + np.cross(w1, I1 @ w1) + np.cross(r1, f1) + n2 + np.cross(s1, f2 + f3)
    return np.array([n1 @ UP, n2 @ y, n3 @ y])
