"""The column by Hamilton's equations: momenta and their rates, accelerations solved for."""

import numpy as np


class Column:
    def __call__(self, phi):
        R = 0.15 + 0.3 * np.cos(phi)
        M = np.zeros((3, 3))
        M[0, 0] = 0.3 + 3.0 * 0.05**2 + 2.0 * R**2
        M[1, 1] = 5.0
        M[1, 2] = M[2, 1] = 2.0 * 0.3 * np.cos(phi)
        M[2, 2] = 0.06 + 2.0 * 0.3**2
        dM = np.zeros((3, 3))
        dM[0, 0] = -4.0 * R * 0.3 * np.sin(phi)
        dM[1, 2] = dM[2, 1] = -0.6 * np.sin(phi)
        return M, dM


column = Column()


def forward_dynamics(q, v, tau):
    M, dM = column(q[2])
    force = tau - np.array([0.0, 5.0, 0.6 * np.cos(q[2])]) * 9.81
    force[2] += 0.5 * v @ dM @ v
    return np.linalg.solve(M, force - dM @ v * v[2])


def mass_matrix(q):
    return column(q[2])[0]
