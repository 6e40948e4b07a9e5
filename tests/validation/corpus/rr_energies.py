"""Two links in a vertical plane by their energies alone, from the velocities of the centres of mass."""

from math import cos, sin

import numpy as np

m1 = 1.21
m2 = 0.83
l1 = 0.41
lc1 = 0.17
lc2 = 0.23
I1 = 0.021
I2 = 0.013
g = 9.81


def kinetic_energy(q, v):
    w2 = v[0] + v[1]
    x1, y1 = -lc1 * sin(q[0]) * v[0], lc1 * cos(q[0]) * v[0]
    x2 = -l1 * sin(q[0]) * v[0] - lc2 * sin(q[0] + q[1]) * w2
    y2 = l1 * cos(q[0]) * v[0] + lc2 * cos(q[0] + q[1]) * w2
    return 0.5 * (m1 * (x1**2 + y1**2) + m2 * (x2**2 + y2**2) + I1 * v[0] ** 2 + I2 * w2**2)


def potential_energy(q):
    return m1 * g * lc1 * sin(q[0]) + m2 * g * (l1 * sin(q[0]) + lc2 * sin(q[0] + q[1]))


def gravity(q):
    far = m2 * g * lc2 * cos(q[0] + q[1])
    return np.array([m1 * g * lc1 * cos(q[0]) + m2 * g * l1 * cos(q[0]) + far, far])
