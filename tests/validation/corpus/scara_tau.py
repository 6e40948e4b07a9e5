"""A SCARA as one function of torques, its numbers in a dictionary."""

import numpy as np

p = {
    "m1": 1.8,
    "m2": 1.1,
    "m3": 0.49,
    "l1": 0.41,
    "l2": 0.33,
    "lc1": 0.2,
    "lc2": 0.15,
    "I1": 0.031,
    "I2": 0.019,
    "I3": 0.0051,
    "g": 9.81,
}


def inverse_dynamics(q, v, a):
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    far = (p["m2"] * p["lc2"] + p["m3"] * p["l2"]) * p["l1"]
    elbow = p["I2"] + p["I3"] + p["m2"] * p["lc2"] ** 2 + p["m3"] * p["l2"] ** 2
    base = p["I1"] + p["m1"] * p["lc1"] ** 2 + (p["m2"] + p["m3"]) * p["l1"] ** 2
    tau1 = (base + elbow + 2 * far * c2) * a[0] + (elbow + far * c2) * a[1]
    tau1 = tau1 - far * s2 * (2 * v[0] * v[1] + v[1] ** 2)
    tau2 = (elbow + far * c2) * a[0] + elbow * a[1] + far * s2 * v[0] ** 2
    tau3 = p["m3"] * (a[2] - p["g"])
    return np.array([tau1, tau2, tau3])
