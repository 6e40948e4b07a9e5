"""Hamilton's equations for yaw, shoulder and boom with the Stanford arm's offset; partials by hand."""

import numpy as np

arm = {
    "I1": 0.21, "I2": 0.108, "I3": 0.067,
    "m2": 6.3, "m3": 4.1,
    "d2": 0.154, "lc2": 0.087, "e3": 0.26,
    "g": 9.81,
}


def mass_matrix(q):
    r = q[2] + arm["e3"]
    s, c = np.sin(q[1]), np.cos(q[1])
    m2, m3, d2, lc2 = arm["m2"], arm["m3"], arm["d2"], arm["lc2"]
    M = np.zeros((3, 3))
    M[0, 0] = arm["I1"] + arm["I2"] + arm["I3"]
    M[0, 0] += m2 * (d2**2 + lc2**2 * c**2) + m3 * (d2**2 + r**2 * c**2)
    M[0, 1] = M[1, 0] = d2 * s * (m2 * lc2 + m3 * r)
    M[0, 2] = M[2, 0] = -m3 * d2 * c
    M[1, 1] = arm["I2"] + arm["I3"] + m2 * lc2**2 + m3 * r**2
    M[2, 2] = m3
    return M


def partials(q):
    """Return the derivatives of the mass matrix for q2 and q3; q1 has none."""
    r = q[2] + arm["e3"]
    s, c = np.sin(q[1]), np.cos(q[1])
    m2, m3, d2, lc2 = arm["m2"], arm["m3"], arm["d2"], arm["lc2"]
    dM2 = np.zeros((3, 3))
    dM2[0, 0] = -2 * s * c * (m2 * lc2**2 + m3 * r**2)
    dM2[0, 1] = dM2[1, 0] = d2 * c * (m2 * lc2 + m3 * r)
    dM2[0, 2] = dM2[2, 0] = m3 * d2 * s
    dM3 = np.zeros((3, 3))
    dM3[0, 0] = 2 * m3 * r * c**2
    dM3[0, 1] = dM3[1, 0] = m3 * d2 * s
    dM3[1, 1] = 2 * m3 * r
    return dM2, dM3


def potential_gradient(q):
    r = q[2] + arm["e3"]
    lift = (arm["m2"] * arm["lc2"] + arm["m3"] * r) * np.cos(q[1])
    return arm["g"] * np.array([0.0, lift, arm["m3"] * np.sin(q[1])])


def forward_dynamics(q, qd, tau):
    dM2, dM3 = partials(q)
    dHdq = potential_gradient(q)
    dHdq[1] -= 0.5 * qd @ dM2 @ qd
    dHdq[2] -= 0.5 * qd @ dM3 @ qd
    pdot = tau - dHdq
    Mdot = dM2 * qd[1] + dM3 * qd[2]
    return np.linalg.solve(mass_matrix(q), pdot - Mdot @ qd)
