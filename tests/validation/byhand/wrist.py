"""A wrist with roll, pitch, roll at a level forearm: rates of Euler's angles, Euler's equation, einsum."""

import numpy as np

Ir = 0.0031
m2, m3 = 0.74, 0.42
c2, c3 = 0.035, 0.094
I2 = np.array([0.00047, 0.00081, 0.00066])
I3 = np.array([0.00021, 0.00093, 0.00064])
g = 9.81


def about_center(I, m, c):
    """Return the inertia about the centre of the wrist: the centre of mass lies on x."""
    return np.diag(I + m * c**2 * np.array([0.0, 1.0, 1.0]))


def rates2(b):
    sb, cb = np.sin(b), np.cos(b)
    return np.array([[cb, 0, 0], [0, 1, 0], [sb, 0, 0]])


def rates3(b, c):
    sb, cb, sc, cc = np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    return np.array([[cb, 0, 1], [sb * sc, cc, 0], [sb * cc, -sc, 0]])


def rates2_dot(b, bd):
    sb, cb = np.sin(b), np.cos(b)
    return np.array([[-sb * bd, 0, 0], [0, 0, 0], [cb * bd, 0, 0]])


def rates3_dot(b, c, bd, cd):
    sb, cb, sc, cc = np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    return np.array([
        [-sb * bd, 0, 0],
        [cb * sc * bd + sb * cc * cd, -sc * cd, 0],
        [cb * cc * bd - sb * sc * cd, -cc * cd, 0],
    ])


def mass_matrix(q):
    E2, E3 = rates2(q[1]), rates3(q[1], q[2])
    O2, O3 = about_center(I2, m2, c2), about_center(I3, m3, c3)
    M = np.einsum("ki,kl,lj->ij", E2, O2, E2) + np.einsum("ki,kl,lj->ij", E3, O3, E3)
    M[0, 0] += Ir
    return M


def coriolis_torque(q, v):
    out = np.zeros(3)
    E2, E3 = rates2(q[1]), rates3(q[1], q[2])
    dE2, dE3 = rates2_dot(q[1], v[1]), rates3_dot(q[1], q[2], v[1], v[2])
    O2, O3 = about_center(I2, m2, c2), about_center(I3, m3, c3)
    for E, dE, O in [(E2, dE2, O2), (E3, dE3, O3)]:
        w = E @ v
        out += E.T @ (O @ dE @ v + np.cross(w, O @ w))
    return out


def gravity(q):
    k = (m2 * c2 + m3 * c3) * g
    return np.array([k * np.sin(q[0]) * np.sin(q[1]), -k * np.cos(q[0]) * np.cos(q[1]), 0.0])
