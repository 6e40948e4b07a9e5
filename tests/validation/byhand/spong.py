"""Two links as in textbooks of robot control: D, C by Christoffel symbols, g; geared motors."""

import numpy as np

params = {
    "m1": 2.3, "m2": 1.4, "l1": 0.45, "lc1": 0.21, "lc2": 0.17, "I1": 0.051, "I2": 0.018,
    "r1": 80.0, "r2": 60.0, "Jm1": 1.5e-5, "Jm2": 0.8e-5, "g": 9.81,
}


def M(q, p=params):
    c2 = np.cos(q[1])
    d11 = p["m1"] * p["lc1"]**2 + p["m2"] * (p["l1"]**2 + p["lc2"]**2 + 2 * p["l1"] * p["lc2"] * c2)
    d11 = d11 + p["I1"] + p["I2"]
    d12 = p["m2"] * (p["lc2"]**2 + p["l1"] * p["lc2"] * c2) + p["I2"]
    d22 = p["m2"] * p["lc2"]**2 + p["I2"]
    return np.array([[d11 + p["r1"]**2 * p["Jm1"], d12], [d12, d22 + p["r2"]**2 * p["Jm2"]]])


def C(q, v, p=params):
    h = -p["m2"] * p["l1"] * p["lc2"] * np.sin(q[1])
    c11 = h * v[1]
    c12 = h * v[1] + h * v[0]
    c21 = -h * v[0]
    return np.array([[c11, c12], [c21, 0.0]])


def G(q, p=params):
    phi1 = (p["m1"] * p["lc1"] + p["m2"] * p["l1"]) * p["g"] * np.cos(q[0])
    phi2 = p["m2"] * p["lc2"] * p["g"] * np.cos(q[0] + q[1])
    return np.array([phi1 + phi2, phi2])


def potential_energy(q, p=params):
    h1 = p["lc1"] * np.sin(q[0])
    h2 = p["l1"] * np.sin(q[0]) + p["lc2"] * np.sin(q[0] + q[1])
    return p["g"] * (p["m1"] * h1 + p["m2"] * h2)
