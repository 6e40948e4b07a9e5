"""Formulas are texts in a table, compiled when the file is read: a yaw and two unlike links."""

from math import cos, sin

import numpy as np

NUMBERS = {
    "m2": 2.8, "m3": 1.6, "l2": 0.41, "c2": 0.19, "c3": 0.15, "g": 9.81, "J1": 0.046,
    "A2": 0.0052, "B2": 0.0437, "A3": 0.0021, "B3": 0.0139,
}  # fmt: skip
SHORT = {
    "r2": "c2 * cos(q2)",
    "r3": "l2 * cos(q2) + c3 * cos(q2 + q3)",
    "s2": "sin(q2)",
    "s23": "sin(q2 + q3)",
    "h": "m3 * l2 * c3",
    "k2": "m2 * c2 * c2 + B2 - A2",
    "k3": "B3 - A3",
}
TABLE = {
    "D11": "J1 + A2 * s2**2 + B2 * cos(q2)**2 + A3 * s23**2 + B3 * cos(q2 + q3)**2 + m2 * r2**2 + m3 * r3**2",
    "D22": "B2 + B3 + m2 * c2**2 + m3 * (l2**2 + c3**2) + 2 * h * cos(q3)",
    "D23": "B3 + m3 * c3**2 + h * cos(q3)",
    "D33": "B3 + m3 * c3**2",
    "P12": "-(k2 * sin(2 * q2) + k3 * sin(2 * (q2 + q3)) + 2 * m3 * r3 * (l2 * s2 + c3 * s23))",
    "P13": "-(k3 * sin(2 * (q2 + q3)) + 2 * m3 * r3 * c3 * s23)",
    "P33": "-h * sin(q3)",
    "G2": "(m2 * c2 + m3 * l2) * g * cos(q2) + m3 * g * c3 * cos(q2 + q3)",
    "G3": "m3 * g * c3 * cos(q2 + q3)",
}
CODE = {name: compile(text, name, "eval") for name, text in {**SHORT, **TABLE}.items()}


def look_up(q, *names):
    known = {**NUMBERS, "cos": cos, "sin": sin, "q2": q[1], "q3": q[2]}
    for name in SHORT:
        known[name] = eval(CODE[name], known)
    return [eval(CODE[name], known) for name in names]


def mass_matrix(q):
    D11, D22, D23, D33 = look_up(q, "D11", "D22", "D23", "D33")
    return np.array([[D11, 0.0, 0.0], [0.0, D22, D23], [0.0, D23, D33]])


def coriolis_torque(q, v):
    P12, P13, P33 = look_up(q, "P12", "P13", "P33")
    first = P12 * v[0] * v[1] + P13 * v[0] * v[2]
    second = -P12 / 2 * v[0] ** 2 + P33 * (2 * v[1] * v[2] + v[2] ** 2)
    third = -P13 / 2 * v[0] ** 2 - P33 * v[1] ** 2
    return np.array([first, second, third])


def gravity(q):
    G2, G3 = look_up(q, "G2", "G3")
    return np.array([0.0, G2, G3])
