"""The elbow by central differences of its energies."""

import numpy as np


def kinetic_energy(q, v):
    s2, s3 = np.sin(q[1]), np.sin(q[1] + q[2])
    c2, c3 = np.cos(q[1]), np.cos(q[1] + q[2])
    T = 0.5 * (0.08 + 0.01 * s2**2 + 0.09 * c2**2 + 0.005 * s3**2 + 0.04 * c3**2) * v[0] ** 2
    T += 0.5 * 0.09 * v[1] ** 2 + 0.5 * 0.04 * (v[1] + v[2]) ** 2
    for m, l, r in ((4.0, 0.25, 0.0), (2.5, 0.5, 0.2)):
        out = l * c2 + r * c3
        up = l * s2 * v[1] + r * s3 * (v[1] + v[2])
        lift = l * c2 * v[1] + r * c3 * (v[1] + v[2])
        T += 0.5 * m * ((out * v[0]) ** 2 + up**2 + lift**2)
    return T


def mass_matrix(q):
    E = np.eye(3)
    T = kinetic_energy
    return np.array([[T(q, a + b) - T(q, a) - T(q, b) for a in E] for b in E])


def gravity(q, h=1e-5):
    def V(x):
        z2, z3 = 0.5 * np.sin(x[1]), np.sin(x[1] + x[2])
        return 9.81 * (4.0 * z2 / 2 + 2.5 * (z2 + 0.2 * z3))

    return np.array([(V(q + h * e) - V(q - h * e)) / (2 * h) for e in np.eye(3)])
