"""A pendulum on a cart (Astrom and Murray 2008), its angle from the upright."""

import numpy as np

M = 2.4
m = 0.37
r = 0.31
J = 0.0071
g = 9.81


def mass_matrix(q):
    c = np.cos(q[1])
    return np.array([[M + m, -m * r * c], [-m * r * c, J + m * r**2]])


def coriolis_torque(q, v):
    return np.array([m * r * np.sin(q[1]) * v[1] ** 2, 0.0])


def gravity(q):
    return np.array([0.0, -m * g * r * np.sin(q[1])])


def potential_energy(q):
    return m * g * r * np.cos(q[1])
