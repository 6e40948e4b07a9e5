"""The Pendubot (Fantoni and Lozano 2002, ch. 5) with its five precomputed constants."""

from math import cos, sin

m1 = 1.21
m2 = 0.83
l1 = 0.41
lc1 = 0.17
lc2 = 0.23
I1 = 0.021
I2 = 0.013
g = 9.81

theta1 = m1 * lc1**2 + m2 * l1**2 + I1
theta2 = m2 * lc2**2 + I2
theta3 = m2 * l1 * lc2
theta4 = m1 * lc1 + m2 * l1
theta5 = m2 * lc2


def mass_matrix(q):
    c2 = cos(q[1])
    return [
        [theta1 + theta2 + 2 * theta3 * c2, theta2 + theta3 * c2],
        [theta2 + theta3 * c2, theta2],
    ]


def coriolis_matrix(q, v):
    s2 = sin(q[1])
    return [
        [-theta3 * s2 * v[1], -theta3 * s2 * v[1] - theta3 * s2 * v[0]],
        [theta3 * s2 * v[0], 0],
    ]


def gravity(q):
    return [
        theta4 * g * cos(q[0]) + theta5 * g * cos(q[0] + q[1]),
        theta5 * g * cos(q[0] + q[1]),
    ]
