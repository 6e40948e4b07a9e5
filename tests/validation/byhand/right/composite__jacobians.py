"""Slide, tilt and swing: Jacobians of points, class methods and a static numpy pipeline."""

import numpy as np


class Arm:
    mass = np.array([6.0, 2.0, 1.0])

    @staticmethod
    def _turns(q):
        c, s = np.cos(q), np.sin(q)
        tilt = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
        swing = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
        return tilt, tilt @ swing

    @classmethod
    def mass_matrix(cls, q):
        A, B = cls._turns(q)
        x, y, z = np.eye(3)
        zB = A @ z
        p2 = A @ np.array([0.2, 0, 0])
        e = A @ np.array([0.5, 0, 0])
        p3 = e + B @ np.array([0.1, 0, 0.02])
        o = np.zeros(3)
        columns = (
            np.stack([x, o, o], axis=1),
            np.stack([x, np.cross(y, p2), o], axis=1),
            np.stack([x, np.cross(y, p3), np.cross(zB, p3 - e)], axis=1),
        )
        M = sum(m * J.T @ J for m, J in zip(cls.mass, columns))
        W2 = np.stack([o, y, o], axis=1)
        W3 = np.stack([o, y, zB], axis=1)
        M += W2.T @ A @ np.diag([0.003, 0.03, 0.028]) @ A.T @ W2
        return M + W3.T @ B @ np.diag([0.002, 0.008, 0.009]) @ B.T @ W3

    @classmethod
    def potential_energy(cls, q):
        A, B = cls._turns(q)
        z2 = (A @ np.array([0.2, 0, 0]))[2]
        z3 = (A @ np.array([0.5, 0, 0]) + B @ np.array([0.1, 0, 0.02]))[2]
        return 9.81 * (cls.mass[1] * z2 + cls.mass[2] * z3) - 3.0


mass_matrix = Arm.mass_matrix
potential_energy = Arm.potential_energy
