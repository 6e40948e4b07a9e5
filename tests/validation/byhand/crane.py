"""A gantry crane: it rolls, lifts its trolley, and a beam swings below; closed forms from a homework."""

from math import cos, sin

import numpy as np

mr, ml, mb = 3.2, 1.4, 0.55
xb, zb = 0.04, 0.23
Ib = 0.0065
grav = 9.81


def mass_matrix(q):
    th = q[2]
    x = xb * cos(th) - zb * sin(th)
    z = -xb * sin(th) - zb * cos(th)
    M = np.zeros((3, 3))
    M[0, 0] = mr + ml + mb
    M[1, 1] = ml + mb
    M[0, 2] = M[2, 0] = mb * z
    M[1, 2] = M[2, 1] = -mb * x
    M[2, 2] = Ib + mb * (xb**2 + zb**2)
    return M


def coriolis_torque(q, qdot):
    th, rate = q[2], qdot[2]
    x = xb * cos(th) - zb * sin(th)
    z = -xb * sin(th) - zb * cos(th)
    return np.array([-mb * x * rate**2, -mb * z * rate**2, 0.0])


def gravity(q):
    th = q[2]
    lift = (ml + mb) * grav
    swing = -mb * grav * (xb * cos(th) - zb * sin(th))
    return np.array([0.0, lift, swing])


def kinetic_energy(q, qdot):
    th, rate = q[2], qdot[2]
    vx = qdot[0] - (xb * sin(th) + zb * cos(th)) * rate
    vz = qdot[1] - (xb * cos(th) - zb * sin(th)) * rate
    T = 0.5 * mr * qdot[0] ** 2 + 0.5 * ml * (qdot[0] ** 2 + qdot[1] ** 2)
    return T + 0.5 * mb * (vx**2 + vz**2) + 0.5 * Ib * rate**2
