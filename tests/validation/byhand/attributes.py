"""Three links in a vertical plane as a class, all numbers attributes."""

import numpy as np


class Arm:
    def __init__(self):
        self.m1, self.m2, self.m3 = 3.0, 2.0, 1
        self.l1, self.l2 = 0.4, 0.3
        self.lc1, self.lc2, self.lc3 = 0.2, 0.15, 0.1
        self.I1 = 0.04
        self.I2 = 0.02
        self.I3 = 0.005
        self.g = 9.81

    def mass_matrix(self, q):
        c2, c3, c23 = np.cos(q[1]), np.cos(q[2]), np.cos(q[1] + q[2])
        a = self.m2 * self.lc2**2 + self.m3 * self.l2**2
        b = self.l1 * (self.m2 * self.lc2 + self.m3 * self.l2)
        d = self.m3 * self.l2 * self.lc3
        e = self.m3 * self.l1 * self.lc3
        f = self.I3 + self.m3 * self.lc3**2
        d33 = f
        d23 = f + d * c3
        d22 = self.I2 + a + f + 2 * d * c3
        d13 = f + d * c3 + e * c23
        d12 = self.I2 + a + f + b * c2 + 2 * d * c3 + e * c23
        d11 = (self.I1 + self.I2 + a + f + self.m1 * self.lc1**2 + (self.m2 + self.m3) * self.l1**2
               + 2 * b * c2 + 2 * d * c3 + 2 * e * c23)
        return np.array([[d11, d12, d13], [d12, d22, d23], [d13, d23, d33]])

    def coriolis_torque(self, q, v):
        b = self.l1 * (self.m2 * self.lc2 + self.m3 * self.l2) * np.sin(q[1])
        d = self.m3 * self.l2 * self.lc3 * np.sin(q[2])
        e = self.m3 * self.l1 * self.lc3 * np.sin(q[1] + q[2])
        w2 = v[0] + v[1]
        w3 = w2 + v[2]
        t3 = d * w2**2 + e * v[0] ** 2
        t2 = t3 - d * w3**2 + b * v[0] ** 2
        t1 = t2 - b * w2**2 - e * w3**2
        return np.array([t1, t2, t3])

    def gravity(self, q):
        c1, c12, c123 = np.cos(q[0]), np.cos(q[0] + q[1]), np.cos(q[0] + q[1] + q[2])
        g3 = self.m3 * self.g * self.lc3 * c123
        g2 = g3 + self.g * (self.m2 * self.lc2 + self.m3 * self.l2) * c12
        g1 = g2 + self.g * (self.m1 * self.lc1 + self.m2 * self.l1 + self.m3 * self.l1) * c1
        return np.array([g1, g2, g3])
