"""Slotine and Li's arm with a load beside the line: lumped constants a1 to a4, in a gravity field."""

from math import cos, pi, sin

import numpy as np

m1, me = 1.1, 2.2
l1, lc1, lce = 0.95, 0.52, 0.57
I1, Ie = 0.13, 0.24
de = pi / 6
g = 9.81
a1 = I1 + m1 * lc1**2 + Ie + me * lce**2 + me * l1**2
a2 = Ie + me * lce**2
a3 = me * l1 * lce * cos(de)
a4 = me * l1 * lce * sin(de)


def H(q):
    c, s = cos(q[1]), sin(q[1])
    H11 = a1 + 2 * a3 * c + 2 * a4 * s
    H12 = H21 = a2 + a3 * c + a4 * s
    H22 = a2
    return np.array([[H11, H12], [H21, H22]])


def C(q, qd):
    h = a3 * sin(q[1]) - a4 * cos(q[1])
    return np.array([[-h * qd[1], -h * (qd[0] + qd[1])], [h * qd[0], 0.0]])


def G(q):
    c1, ce = cos(q[0]), cos(q[0] + q[1] - de)
    return np.array([(m1 * lc1 + me * l1) * g * c1 + me * lce * g * ce, me * lce * g * ce])


mass_matrix = H
