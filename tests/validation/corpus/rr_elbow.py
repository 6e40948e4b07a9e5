"""Two links in a vertical plane as a class with a method for each lever and each term."""

import math

import numpy as np


class Elbow:
    def __init__(self):
        self.parameters = {
            "m1": 1.35,
            "m2": 0.95,
            "l1": 0.36,
            "lc1": 0.17,
            "lc2": 0.19,
            "I1": 0.021,
            "I2": 0.015,
            "g": 9.81,
        }

    def coupling(self, q):
        p = self.parameters
        return p["m2"] * p["l1"] * p["lc2"] * math.cos(q[1])

    def coupling_rate(self, q):
        p = self.parameters
        return -p["m2"] * p["l1"] * p["lc2"] * math.sin(q[1])

    def forearm(self):
        p = self.parameters
        return p["I2"] + p["m2"] * p["lc2"] ** 2

    def upper_arm(self):
        p = self.parameters
        return p["I1"] + p["m1"] * p["lc1"] ** 2 + p["m2"] * p["l1"] ** 2

    def mass_matrix(self, q):
        k = self.coupling(q)
        far = self.forearm()
        return np.array([[self.upper_arm() + far + 2 * k, far + k], [far + k, far]])

    def coriolis_matrix(self, q, v):
        h = self.coupling_rate(q)
        return np.array([[h * v[1], h * (v[0] + v[1])], [-h * v[0], 0.0]])

    def weight(self, q):
        p = self.parameters
        near = (p["m1"] * p["lc1"] + p["m2"] * p["l1"]) * math.cos(q[0])
        return p["g"] * near, p["g"] * p["m2"] * p["lc2"] * math.cos(q[0] + q[1])

    def gravity(self, q):
        near, far = self.weight(q)
        return np.array([near + far, far])
