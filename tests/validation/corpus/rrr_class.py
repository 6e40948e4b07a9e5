"""An anthropomorphic arm with an offset shoulder as a class with a dictionary of parameters."""

import numpy as np


class Arm:
    def __init__(self):
        self.parameters = {
            "m2": 1.31,
            "m3": 0.72,
            "l1": 0.08,
            "l2": 0.37,
            "lc2": 0.16,
            "lc3": 0.21,
            "I1": 0.031,
            "I2": 0.023,
            "I3": 0.013,
            "g": 9.81,
        }

    def mass_matrix(self, q):
        p = self.parameters
        m2, m3, l1, l2, lc2, lc3 = p["m2"], p["m3"], p["l1"], p["l2"], p["lc2"], p["lc3"]
        I1, I2, I3 = p["I1"], p["I2"], p["I3"]
        r2 = l1 + lc2 * np.cos(q[1])
        r3 = l1 + l2 * np.cos(q[1]) + lc3 * np.cos(q[1] + q[2])
        d11 = I1 + I2 + I3 + m2 * r2**2 + m3 * r3**2
        d33 = I3 + m3 * lc3**2
        d23 = d33 + m3 * l2 * lc3 * np.cos(q[2])
        d22 = I2 + m2 * lc2**2 + m3 * l2**2 + 2 * d23 - d33
        return np.array([[d11, 0, 0], [0, d22, d23], [0, d23, d33]])

    def coriolis_torque(self, q, v):
        p = self.parameters
        m2, m3, l1, l2, lc2, lc3 = p["m2"], p["m3"], p["l1"], p["l2"], p["lc2"], p["lc3"]
        s2, s23, s3 = np.sin(q[1]), np.sin(q[1] + q[2]), np.sin(q[2])
        r2 = l1 + lc2 * np.cos(q[1])
        r3 = l1 + l2 * np.cos(q[1]) + lc3 * np.cos(q[1] + q[2])
        k2 = m2 * r2 * lc2 * s2 + m3 * r3 * (l2 * s2 + lc3 * s23)
        k3 = m3 * r3 * lc3 * s23
        b = m3 * l2 * lc3 * s3
        return np.array(
            [
                -2 * k2 * v[0] * v[1] - 2 * k3 * v[0] * v[2],
                k2 * v[0] ** 2 - 2 * b * v[1] * v[2] - b * v[2] ** 2,
                k3 * v[0] ** 2 + b * v[1] ** 2,
            ]
        )

    def gravity(self, q):
        p = self.parameters
        c2, c23 = np.cos(q[1]), np.cos(q[1] + q[2])
        far = p["m3"] * p["lc3"] * c23
        return -p["g"] * np.array([0, (p["m2"] * p["lc2"] + p["m3"] * p["l2"]) * c2 + far, far])
