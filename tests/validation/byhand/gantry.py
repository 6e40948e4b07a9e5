"""An overhead crane with four coordinates, typed from a paper: bridge, trolley and two angles of the load."""

from math import cos, sin

import numpy as np

Mb, Mt, Mu, m = 11.3, 4.7, 0.6, 2.9
Ju, J = 0.0035, 0.0181
l, g = 0.83, 9.81


def M(q):
    a, b = q[2], q[3]
    Sa, Ca, Sb, Cb = sin(a), cos(a), sin(b), cos(b)
    M11 = Mb + Mt + Mu + m
    M14 = -m * l * Cb
    M22 = Mt + Mu + m
    M23 = m * l * Ca * Cb
    M24 = -m * l * Sa * Sb
    M33 = Ju + J + m * l**2 * Cb**2
    M44 = J + m * l**2
    return np.array([
        [M11, 0, 0, M14],
        [0, M22, M23, M24],
        [0, M23, M33, 0],
        [M14, M24, 0, M44],
    ])


def C(q, qd):
    a, b = q[2], q[3]
    ad, bd = qd[2], qd[3]
    Sa, Ca, Sb, Cb = sin(a), cos(a), sin(b), cos(b)
    C14 = m * l * Sb * bd
    C23 = -m * l * (Sa * Cb * ad + Ca * Sb * bd)
    C24 = -m * l * (Ca * Sb * ad + Sa * Cb * bd)
    C33 = -m * l**2 * Sb * Cb * bd
    C34 = -m * l**2 * Sb * Cb * ad
    C43 = m * l**2 * Sb * Cb * ad
    return np.array([
        [0, 0, 0, C14],
        [0, 0, C23, C24],
        [0, 0, C33, C34],
        [0, 0, C43, 0],
    ])


def G(q):
    a, b = q[2], q[3]
    return np.array([0.0, 0.0, m * g * l * sin(a) * cos(b), m * g * l * cos(a) * sin(b)])
