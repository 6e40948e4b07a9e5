"""A cylindrical arm (turn, lift, reach) whose numbers are read from a catalogue in JSON."""

import json

import numpy as np

CATALOGUE = json.loads(
    """
    {"column": {"mass": 8.0, "Izz": 0.15},
     "carriage": {"mass": 5.5, "x": 0.06, "Izz": 0.08},
     "boom": {"mass": 2.6, "x": 0.21, "Izz": 0.05},
     "g": 9.81}
    """
)
carriage, boom = CATALOGUE["carriage"], CATALOGUE["boom"]
moment = CATALOGUE["column"]["Izz"] + carriage["Izz"] + boom["Izz"]
lifted = carriage["mass"] + boom["mass"]


def radius(q):
    return boom["x"] + q[2]


def mass_matrix(q):
    about = moment + carriage["mass"] * carriage["x"] ** 2 + boom["mass"] * radius(q) ** 2
    return np.diag([about, lifted, boom["mass"]])


def coriolis_matrix(q, v):
    C = np.zeros((3, 3))
    push = boom["mass"] * radius(q)
    C[0, 0] = push * v[2]
    C[0, 2] = push * v[0]
    C[2, 0] = -push * v[0]
    return C


def gravity(q):
    return np.array([0.0, lifted * CATALOGUE["g"], 0.0])
