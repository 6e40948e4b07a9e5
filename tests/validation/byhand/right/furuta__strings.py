"""The Furuta pendulum as strings of a computer algebra program."""

import math

import numpy as np

EXPRESSIONS = """
D11 = 0.003 + 0.4*0.12^2 + 0.15*(0.25^2 + (0.15*sin(q2))^2) + 0.0011*sin(q2)^2 + 0.0002*cos(q2)^2
D12 = 0.15*0.25*0.15*cos(q2)
D22 = 0.0012 + 0.15*0.15^2
k = (0.15*0.15^2 + 0.0011 - 0.0002)*sin(2*q2)
h1 = k*v1*v2 - 0.15*0.25*0.15*sin(q2)*v2^2
h2 = -k*v1^2/2
G2 = 0.15*9.81*0.15*sin(q2)
"""


def evaluated(q, v=(0.0, 0.0)):
    names = {"sin": math.sin, "cos": math.cos, "q1": q[0], "q2": q[1], "v1": v[0], "v2": v[1]}
    for line in EXPRESSIONS.strip().splitlines():
        name, _, value = line.partition(" = ")
        names[name] = eval(value.replace("^", "**"), {}, names)
    return names


def mass_matrix(q):
    e = evaluated(q)
    return np.array([[e["D11"], e["D12"]], [e["D12"], e["D22"]]])


def coriolis_torque(q, v):
    e = evaluated(q, v)
    return np.array([e["h1"], e["h2"]])


def gravity(q):
    return np.array([0.0, evaluated(q)["G2"]])
