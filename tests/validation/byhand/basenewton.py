"""Newton-Euler with all vectors in the base frame, for a yaw, a pitch and a roll."""

import numpy as np


def Rx(t):
    return np.array([[1, 0, 0], [0, np.cos(t), -np.sin(t)], [0, np.sin(t), np.cos(t)]])


def Ry(t):
    return np.array([[np.cos(t), 0, np.sin(t)], [0, 1, 0], [-np.sin(t), 0, np.cos(t)]])


def Rz(t):
    return np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])


class Wrist:
    m1, m2, m3 = 3.0, 1.5, 0.8
    Ic1 = np.diag([0.03, 0.02, 0.01])
    Ic2 = np.diag([0.004, 0.01, 0.009])
    Ic3 = np.diag([0.001, 0.003, 0.002])
    d2 = np.array([0.1, 0.0, 0.2])
    d3 = np.array([0.3, 0.0, 0.0])
    r1 = np.array([0.02, 0.0, 0.1])
    r2 = np.array([0.15, 0.0, 0.01])
    r3 = np.array([0.1, 0.03, 0.0])
    g = np.array([0.0, 0.0, -9.81])

    def inverse_dynamics(self, q, qd, qdd):
        R1 = Rz(q[0])
        R2 = R1 @ Ry(q[1])
        R3 = R2 @ Rx(q[2])
        z1 = np.array([0.0, 0.0, 1.0])
        z2 = R1 @ np.array([0.0, 1.0, 0.0])
        z3 = R2 @ np.array([1.0, 0.0, 0.0])

        w1 = z1 * qd[0]
        w2 = w1 + z2 * qd[1]
        w3 = w2 + z3 * qd[2]
        a1 = z1 * qdd[0]
        a2 = a1 + z2 * qdd[1] + np.cross(w1, z2) * qd[1]
        a3 = a2 + z3 * qdd[2] + np.cross(w2, z3) * qd[2]

        b2 = R1 @ self.d2
        b3 = R2 @ self.d3
        c1 = R1 @ self.r1
        c2 = R2 @ self.r2
        c3 = R3 @ self.r3
        acc2 = np.cross(a1, b2) + np.cross(w1, np.cross(w1, b2))
        acc3 = acc2 + np.cross(a2, b3) + np.cross(w2, np.cross(w2, b3))
        ac1 = np.cross(a1, c1) + np.cross(w1, np.cross(w1, c1))
        ac2 = acc2 + np.cross(a2, c2) + np.cross(w2, np.cross(w2, c2))
        ac3 = acc3 + np.cross(a3, c3) + np.cross(w3, np.cross(w3, c3))

        F1 = self.m1 * (ac1 - self.g)
        F2 = self.m2 * (ac2 - self.g)
        F3 = self.m3 * (ac3 - self.g)
        I1 = R1 @ self.Ic1 @ R1.T
        I2 = R2 @ self.Ic2 @ R2.T
        I3 = R3 @ self.Ic3 @ R3.T
        N1 = I1 @ a1 + np.cross(w1, I1 @ w1)
        N2 = I2 @ a2 + np.cross(w2, I2 @ w2)
        N3 = I3 @ a3 + np.cross(w3, I3 @ w3)

        f3 = F3
        n3 = N3 + np.cross(c3, F3)
        f2 = F2 + f3
        n2 = N2 + n3 + np.cross(c2, F2) + np.cross(b3, f3)
        n1 = N1 + n2 + np.cross(c1, F1) + np.cross(b2, f2)
        return np.array([z1 @ n1, z2 @ n2, z3 @ n3])


inverse_dynamics = Wrist().inverse_dynamics
