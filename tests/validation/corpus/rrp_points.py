"""A spherical arm (turret, shoulder, slide): energies from the speeds of its centres of mass."""

import numpy as np


class Spherical:
    def __init__(self):
        self.parameters = {
            "m2": 1.22,
            "m3": 0.81,
            "lc2": 0.14,
            "lc3": 0.19,
            "I1": 0.038,
            "I2": 0.021,
            "I3": 0.015,
            "h1": 0.33,
            "g": 9.81,
        }

    def kinetic_energy(self, q, v):
        p = self.parameters
        c = np.cos(q[1])
        r = q[2] - p["lc3"]
        second = (p["lc2"] * v[1]) ** 2 + (p["lc2"] * c * v[0]) ** 2
        third = (r * v[1]) ** 2 + (r * c * v[0]) ** 2 + v[2] ** 2
        turning = (p["I1"] + p["I2"] + p["I3"]) * v[0] ** 2 + (p["I2"] + p["I3"]) * v[1] ** 2
        return 0.5 * (p["m2"] * second + p["m3"] * third + turning)

    def potential_energy(self, q):
        p = self.parameters
        return (p["m2"] * p["lc2"] + p["m3"] * (q[2] - p["lc3"])) * p["g"] * np.sin(q[1])

    def gravity(self, q):
        p = self.parameters
        arm = p["m2"] * p["lc2"] + p["m3"] * (q[2] - p["lc3"])
        return np.array([0.0, arm * p["g"] * np.cos(q[1]), p["m3"] * p["g"] * np.sin(q[1])])
