"""Yaw, shoulder and elbow; a function of its own for every entry, as printed tables are typed."""

from math import cos, sin

import numpy as np

P = dict(J1=0.021, m2=2.6, m3=1.4, l2=0.37, a2=0.17, a3=0.15, J2=0.031, J3=0.0105, g=9.81)


def rho(q2, q3):
    return P["l2"] * cos(q2) + P["a3"] * cos(q2 + q3)


def d11(q2, q3):
    upper = (P["J2"] + P["m2"] * P["a2"] ** 2) * cos(q2) ** 2
    return P["J1"] + upper + P["J3"] * cos(q2 + q3) ** 2 + P["m3"] * rho(q2, q3) ** 2


def d22(q2, q3):
    inner = P["l2"] ** 2 + P["a3"] ** 2 + 2 * P["l2"] * P["a3"] * cos(q3)
    return P["J2"] + P["J3"] + P["m2"] * P["a2"] ** 2 + P["m3"] * inner


def d23(q2, q3):
    return P["J3"] + P["m3"] * (P["a3"] ** 2 + P["l2"] * P["a3"] * cos(q3))


def d33(q2, q3):
    return P["J3"] + P["m3"] * P["a3"] ** 2


def c112(q2, q3):
    slope = P["l2"] * sin(q2) + P["a3"] * sin(q2 + q3)
    upper = (P["J2"] + P["m2"] * P["a2"] ** 2) * cos(q2) * sin(q2)
    return upper + P["J3"] * cos(q2 + q3) * sin(q2 + q3) + P["m3"] * rho(q2, q3) * slope


def c113(q2, q3):
    return (P["J3"] * cos(q2 + q3) + P["m3"] * rho(q2, q3) * P["a3"]) * sin(q2 + q3)


def c223(q2, q3):
    return P["m3"] * P["l2"] * P["a3"] * sin(q3)


def mass_matrix(q):
    _, q2, q3 = q
    b = d23(q2, q3)
    return np.array([[d11(q2, q3), 0, 0], [0, d22(q2, q3), b], [0, b, d33(q2, q3)]])


def coriolis_torque(q, v):
    _, q2, q3 = q
    v1, v2, v3 = v
    x, y, z = c112(q2, q3), c113(q2, q3), c223(q2, q3)
    first = -2 * x * v1 * v2 - 2 * y * v1 * v3
    return [first, x * v1**2 - 2 * z * v2 * v3 - z * v3**2, y * v1**2 + z * v2**2]


def gravity(q):
    _, q2, q3 = q
    forearm = P["m3"] * P["g"] * P["a3"] * cos(q2 + q3)
    return [0, (P["m2"] * P["a2"] + P["m3"] * P["l2"]) * P["g"] * cos(q2) + forearm, forearm]
