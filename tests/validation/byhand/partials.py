"""A rail with a turning and tilting beam: constants h1 to h8, M and its partial derivatives typed by hand."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Params:
    m0: float = 7.43
    m1: float = 3.26
    m2: float = 1.84
    l1: float = 0.317
    c1: float = 0.143
    c2: float = 0.226
    Iz1: float = 0.0418
    Ix2: float = 0.0153
    Iy2: float = 0.0347
    Iz2: float = 0.0483
    g: float = 9.81


class RailArm:
    def __init__(self, p=None):
        p = p or Params()
        self.h1 = p.m0 + p.m1 + p.m2
        self.h2 = p.m1 * p.c1 + p.m2 * p.l1
        self.h3 = p.m2 * p.c2
        self.h4 = p.Iz1 + p.m1 * p.c1**2 + p.m2 * p.l1**2 + p.Ix2
        self.h5 = p.m2 * p.c2**2 + p.Iz2 - p.Ix2
        self.h6 = p.m2 * p.l1 * p.c2
        self.h7 = p.m2 * p.c2**2 + p.Iy2
        self.h8 = p.m2 * p.c2 * p.g

    def mass_matrix(self, q):
        s2, c2 = np.sin(q[1]), np.cos(q[1])
        s3, c3 = np.sin(q[2]), np.cos(q[2])
        M = np.zeros((3, 3))
        M[0, 0] = self.h1
        M[0, 1] = M[1, 0] = -(self.h2 + self.h3 * c3) * s2
        M[0, 2] = M[2, 0] = -self.h3 * s3 * c2
        M[1, 1] = self.h4 + self.h5 * c3**2 + 2 * self.h6 * c3
        M[2, 2] = self.h7
        return M

    def dM(self, q):
        """dM[i, j, k] = dM_ij / dq_k."""
        s2, c2 = np.sin(q[1]), np.cos(q[1])
        s3, c3 = np.sin(q[2]), np.cos(q[2])
        dM = np.zeros((3, 3, 3))
        dM[0, 1, 1] = dM[1, 0, 1] = -(self.h2 + self.h3 * c3) * c2
        dM[0, 2, 1] = dM[2, 0, 1] = self.h3 * s3 * s2
        dM[0, 1, 2] = dM[1, 0, 2] = self.h3 * s3 * s2
        dM[0, 2, 2] = dM[2, 0, 2] = -self.h3 * c3 * c2
        dM[1, 1, 2] = -2 * self.h5 * c3 * s3 - 2 * self.h6 * s3
        return dM

    def coriolis_matrix(self, q, qd):
        d = self.dM(q)
        C = np.zeros((3, 3))
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    C[i, j] += 0.5 * (d[i, j, k] + d[i, k, j] - d[j, k, i]) * qd[k]
        return C

    def gravity(self, q):
        return np.array([0.0, 0.0, self.h8 * np.cos(q[2])])


arm = RailArm()
mass_matrix = arm.mass_matrix
coriolis_matrix = arm.coriolis_matrix
gravity = arm.gravity
