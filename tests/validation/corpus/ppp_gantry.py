"""A gantry: three slides, the third one lifts; with a tool."""

import numpy as np

m1 = 3.1
m2 = 1.7
m3 = 0.83
l3 = 0.24
g = 9.81


class Gantry:
    n = 3

    def mass_matrix(self, q):
        return np.diag([m1 + m2 + m3, m2 + m3, m3])

    def coriolis_matrix(self, q, v):
        return np.zeros((3, 3))

    def gravity(self, q):
        return np.array([0.0, 0.0, m3 * g])

    def potential_energy(self, q):
        return m3 * g * q[2]

    def kinetic_energy(self, q, v):
        x, y, z = v
        return 0.5 * m1 * x**2 + 0.5 * m2 * (x**2 + y**2) + 0.5 * m3 * (x**2 + y**2 + z**2)

    def forward_kinematics(self, q):
        return np.array([q[0], q[1], q[2] - l3])
