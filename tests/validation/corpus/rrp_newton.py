"""Two level links with a slide by Newton for each body: accelerations, then moments about the joints."""

import numpy as np

m1 = 1.7
m2 = 1.1
m3 = 0.6
l1 = 0.38
l2 = 0.31
r1 = 0.18
r2 = 0.14
I1 = 0.019
I2 = 0.015
I3 = 0.012
g = 9.81


def rotate(angle, x, y):
    return np.array([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y])


def across(one, other):
    return one[0] * other[1] - one[1] * other[0]


def inverse_dynamics(q, v, a):
    first, second = q[0], q[0] + q[1]
    w1, w2 = v[0], v[0] + v[1]
    e1, e2 = a[0], a[0] + a[1]
    # Of the body's points: centripetal along the link, tangential across it.
    elbow = rotate(first, -l1 * w1**2, l1 * e1)
    centre1 = rotate(first, -r1 * w1**2, r1 * e1)
    centre2 = elbow + rotate(second, -r2 * w2**2, r2 * e2)
    quill = elbow + rotate(second, -l2 * w2**2, l2 * e2)
    push2 = m2 * centre2
    push3 = m3 * quill
    moment2 = (I2 + I3) * e2 + across(rotate(second, r2, 0.0), push2) + across(rotate(second, l2, 0.0), push3)
    moment1 = I1 * e1 + across(rotate(first, r1, 0.0), m1 * centre1)
    moment1 = moment1 + moment2 + across(rotate(first, l1, 0.0), push2 + push3)
    lift = m3 * (a[2] - g)
    return np.array([moment1, moment2, lift])
