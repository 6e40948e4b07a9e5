"""Free bodies (shoulder, elbow, slide): all reactions and drives are unknowns of nine linear equations."""

from math import cos, sin

import numpy as np

mA, mB, mC = 2.71, 1.68, 0.83
IA, IB, IC = 0.0386, 0.0173, 0.0052
lA = 0.437
xA, zA = 0.203, 0.019
xB, zB = 0.148, -0.027
xC, zC = 0.094, 0.013
xS, zS = 0.126, 0.034
g = 9.81


def turned(x, z, angle):
    return np.array([x * cos(angle) - z * sin(angle), x * sin(angle) + z * cos(angle)])


def acceleration(r, w, e):
    """Acceleration of the tip of r against its start, r fixed in a body."""
    return np.array([-e * r[1] - w**2 * r[0], e * r[0] - w**2 * r[1]])


def moment(r, f):
    return r[0] * f[1] - r[1] * f[0]


def unknowns(q, qd, qdd):
    """Return Rx, Rz, torque of the shoulder; of the elbow; normal force, couple and drive of the slide."""
    a, b = q[0], q[0] + q[1]
    wa, wb = qd[0], qd[0] + qd[1]
    ea, eb = qdd[0], qdd[0] + qdd[1]
    t, n = turned(1.0, 0.0, b), turned(0.0, 1.0, b)
    elbow = turned(lA, 0.0, a)
    cA = turned(xA, zA, a)
    cB = turned(xB, zB, b)
    cC = turned(xS + q[2] + xC, zS + zC, b)
    aE = acceleration(elbow, wa, ea)
    aA = acceleration(cA, wa, ea)
    aB = aE + acceleration(cB, wb, eb)
    aC = aE + acceleration(cC, wb, eb) + t * qdd[2] + 2 * wb * qd[2] * n
    k = elbow - cA
    d = cC - cB
    equations = np.array([
        [1, 0, 0, -1, 0, 0, 0, 0, 0],
        [0, 1, 0, 0, -1, 0, 0, 0, 0],
        [cA[1], -cA[0], 1, k[1], -k[0], -1, 0, 0, 0],
        [0, 0, 0, 1, 0, 0, -n[0], 0, -t[0]],
        [0, 0, 0, 0, 1, 0, -n[1], 0, -t[1]],
        [0, 0, 0, cB[1], -cB[0], 1, -moment(d, n), -1, -moment(d, t)],
        [0, 0, 0, 0, 0, 0, n[0], 0, t[0]],
        [0, 0, 0, 0, 0, 0, n[1], 0, t[1]],
        [0, 0, 0, 0, 0, 0, 0, 1, 0],
    ])
    right = np.array([
        mA * aA[0],
        mA * (aA[1] + g),
        IA * ea,
        mB * aB[0],
        mB * (aB[1] + g),
        IB * eb,
        mC * aC[0],
        mC * (aC[1] + g),
        IC * eb,
    ])
    return np.linalg.solve(equations, right)


def inverse_dynamics(q, qd, qdd):
    return unknowns(q, qd, qdd)[[2, 5, 8]]
