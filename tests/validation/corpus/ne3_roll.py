"""Pan, tilt and roll by Newton and Euler, a function for a step out and one for a body (Craig 2005)."""

import numpy as np

m1 = 1.5
m2 = 1.1
m3 = 0.6
h1 = 0.3
l2 = 0.33
x1 = -0.05
x2 = -0.14
x3 = -0.09
y3 = -0.06
Ia = 0.018
Ib = 0.012
Ic = 0.015
g = 9.81

X, Y, Z = np.eye(3)


def about_z(t):
    return np.array([[np.cos(t), -np.sin(t), 0.0], [np.sin(t), np.cos(t), 0.0], [0.0, 0.0, 1.0]])


def about_y(t):
    return np.array([[np.cos(t), 0.0, np.sin(t)], [0.0, 1.0, 0.0], [-np.sin(t), 0.0, np.cos(t)]])


def about_x(t):
    return np.array([[1.0, 0.0, 0.0], [0.0, np.cos(t), -np.sin(t)], [0.0, np.sin(t), np.cos(t)]])


def outward(R, offset, axis, rate, push, w, dw, dv):
    wi = R.T @ w + rate * axis
    dwi = R.T @ dw + np.cross(R.T @ w, rate * axis) + push * axis
    dvi = R.T @ (dv + np.cross(dw, offset) + np.cross(w, np.cross(w, offset)))
    return wi, dwi, dvi


def wrench(m, c, J, w, dw, dv):
    F = m * (dv + np.cross(dw, c) + np.cross(w, np.cross(w, c)))
    N = J @ dw + np.cross(w, J @ w) + np.cross(c, F)
    return F, N


def inverse_dynamics(q, v, a):
    R1, R2, R3 = about_z(q[0]), about_y(q[1]), about_x(q[2])
    p1, p2, p3 = np.zeros(3), np.array([0.0, 0.0, h1]), np.array([l2, 0.0, 0.0])
    w1, dw1, dv1 = outward(R1, p1, Z, v[0], a[0], np.zeros(3), np.zeros(3), g * Z)
    w2, dw2, dv2 = outward(R2, p2, Y, v[1], a[1], w1, dw1, dv1)
    w3, dw3, dv3 = outward(R3, p3, X, v[2], a[2], w2, dw2, dv2)
    _, N1 = wrench(m1, np.array([x1, 0.0, 0.0]), np.diag([Ia, Ib, Ic]), w1, dw1, dv1)
    F2, N2 = wrench(m2, np.array([x2, 0.0, 0.0]), np.diag([Ib, Ic, Ia]), w2, dw2, dv2)
    F3, N3 = wrench(m3, np.array([x3, y3, 0.0]), np.diag([Ia, Ic, Ib]), w3, dw3, dv3)
    f3 = F3
    n3 = N3
    f2 = F2 + R3 @ f3
    n2 = N2 + R3 @ n3 + np.cross(p3, R3 @ f3)
    n1 = N1 + R2 @ n2 + np.cross(p2, R2 @ f2)
    return np.array([n1 @ Z, n2 @ Y, n3 @ X])
