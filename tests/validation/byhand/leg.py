"""A swinging leg (thigh, shank, foot) by free bodies: forces by components, moments about centres."""

from math import cos, sin

import numpy as np

thigh = dict(m=7.4, L=0.41, r=0.178, I=0.13)
shank = dict(m=3.2, L=0.43, r=0.186, I=0.061)
foot = dict(m=1.1, L=0.17, r=0.074, I=0.0041)
g = 9.81


def inverse_dynamics(q, qd, qdd):
    th1, th2, th3 = np.cumsum(q)
    w1, w2, w3 = np.cumsum(qd)
    al1, al2, al3 = np.cumsum(qdd)

    # accelerations of the centres of mass, x forward and y up; angles from the vertical
    ax1 = thigh["r"] * (al1 * cos(th1) - w1**2 * sin(th1))
    ay1 = thigh["r"] * (al1 * sin(th1) + w1**2 * cos(th1))
    kx = thigh["L"] * (al1 * cos(th1) - w1**2 * sin(th1))
    ky = thigh["L"] * (al1 * sin(th1) + w1**2 * cos(th1))
    ax2 = kx + shank["r"] * (al2 * cos(th2) - w2**2 * sin(th2))
    ay2 = ky + shank["r"] * (al2 * sin(th2) + w2**2 * cos(th2))
    hx = kx + shank["L"] * (al2 * cos(th2) - w2**2 * sin(th2))
    hy = ky + shank["L"] * (al2 * sin(th2) + w2**2 * cos(th2))
    ax3 = hx + foot["r"] * (al3 * cos(th3) - w3**2 * sin(th3))
    ay3 = hy + foot["r"] * (al3 * sin(th3) + w3**2 * cos(th3))

    # ankle
    Ax = foot["m"] * ax3
    Ay = foot["m"] * (ay3 + g)
    ankle = foot["I"] * al3 + foot["r"] * (Ax * cos(th3) + Ay * sin(th3))

    # knee
    Kx = shank["m"] * ax2 + Ax
    Ky = shank["m"] * (ay2 + g) + Ay
    knee = ankle + shank["I"] * al2 + shank["r"] * (Kx * cos(th2) + Ky * sin(th2))
    knee += (shank["L"] - shank["r"]) * (Ax * cos(th2) + Ay * sin(th2))

    # hip
    Hx = thigh["m"] * ax1 + Kx
    Hy = thigh["m"] * (ay1 + g) + Ky
    hip = knee + thigh["I"] * al1 + thigh["r"] * (Hx * cos(th1) + Hy * sin(th1))
    hip += (thigh["L"] - thigh["r"]) * (Kx * cos(th1) + Ky * sin(th1))
    return np.array([hip, knee, ankle])
