"""The two links in the complex plane; accelerations from forward dynamics alone."""

import cmath

import numpy as np

m = (2.0, 1.2)
r = (0.18 + 0.02j, 0.14 - 0.03j)
J = (0.025, 0.009)


def _bias_and_mass(q, v):
    u, w = cmath.exp(1j * q[0]), cmath.exp(1j * (q[0] + q[1]))
    J1 = np.array([1j * r[0] * u, 0])
    J2 = np.array([1j * (0.35 * u + r[1] * w), 1j * r[1] * w])
    M = m[0] * np.outer(J1.conj(), J1).real + m[1] * np.outer(J2.conj(), J2).real
    M = M + J[0] * np.diag([1, 0]) + J[1] * np.ones((2, 2))
    a1 = -r[0] * u * v[0] ** 2 + 9.81j
    a2 = -0.35 * u * v[0] ** 2 - r[1] * w * (v[0] + v[1]) ** 2 + 9.81j
    return m[0] * (J1.conj() * a1).real + m[1] * (J2.conj() * a2).real, M


def forward_dynamics(q, v, tau):
    h, M = _bias_and_mass(q, v)
    return np.linalg.solve(M, tau - h)
