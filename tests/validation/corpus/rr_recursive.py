"""Two links in a vertical plane by Newton and Euler in the base frame, out and back."""

import numpy as np

m1 = 1.37
m2 = 0.92
l1 = 0.38
lc1 = 0.16
lc2 = 0.21
I1 = 0.024
I2 = 0.016
g = 9.81


def turned(u):
    return np.array([-u[1], u[0]])


def moment(r, f):
    return r[0] * f[1] - r[1] * f[0]


def inverse_dynamics(q, v, a):
    t1, t2 = q[0], q[0] + q[1]
    w1, w2 = v[0], v[0] + v[1]
    e1, e2 = a[0], a[0] + a[1]
    u1 = np.array([np.cos(t1), np.sin(t1)])
    u2 = np.array([np.cos(t2), np.sin(t2)])
    up = np.array([0.0, g])
    b1 = lc1 * (e1 * turned(u1) - w1**2 * u1) + up
    joint = l1 * (e1 * turned(u1) - w1**2 * u1) + up
    b2 = joint + lc2 * (e2 * turned(u2) - w2**2 * u2)
    f2 = m2 * b2
    n2 = I2 * e2 + moment(lc2 * u2, f2)
    n1 = I1 * e1 + moment(lc1 * u1, m1 * b1) + n2 + moment(l1 * u1, f2)
    return np.array([n1, n2])
