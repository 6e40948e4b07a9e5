"""A polar arm as it comes out of a MATLAB function: indices from 1, numbers in a struct."""

from types import SimpleNamespace

import numpy as np

par = SimpleNamespace(m2=4.0, m3=2.0, lc2=0.2, lc3=0.3, I1=0.05, I2=0.03, I3=0.02, g=9.81)


def shifted(x):
    return np.concatenate([[0.0], x])


def inverse_dynamics(q, qd, qdd):
    q, qd, qdd = shifted(q), shifted(qd), shifted(qdd)
    c2 = np.cos(q[2])
    s2 = np.sin(q[2])
    r = q[3] - par.lc3
    J = par.m2 * par.lc2**2 + par.m3 * r**2
    M = np.zeros((4, 4))
    M[1, 1] = par.I1 + par.I2 + par.I3 + J * c2**2
    M[2, 2] = par.I2 + par.I3 + J
    M[3, 3] = par.m3
    h = np.zeros(4)
    h[1] = -2 * J * s2 * c2 * qd[1] * qd[2] + 2 * par.m3 * r * c2**2 * qd[1] * qd[3]
    h[2] = J * s2 * c2 * qd[1] ** 2 + 2 * par.m3 * r * qd[2] * qd[3]
    h[3] = -par.m3 * r * (qd[2] ** 2 + c2**2 * qd[1] ** 2)
    G = np.zeros(4)
    G[2] = (par.m2 * par.lc2 + par.m3 * r) * par.g * c2
    G[3] = par.m3 * par.g * s2
    tau = M @ qdd + h + G
    return tau[1:]
