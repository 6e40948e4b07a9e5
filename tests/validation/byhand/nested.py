"""Yaw, shoulder and elbow; links are objects in a list with inertias along and across the link."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Link:
    mass: float
    length: float
    com: float
    along: float
    across: float


@dataclass
class Elbow:
    base: float = 0.08
    links: list = field(default_factory=list)
    g: float = 9.81

    def mass_matrix(self, q):
        upper, fore = self.links
        c2, c23 = np.cos(q[1]), np.cos(q[1] + q[2])
        s2, s23 = np.sin(q[1]), np.sin(q[1] + q[2])
        reach = upper.length * c2 + fore.com * c23
        M = np.zeros((3, 3))
        M[0, 0] = (
            self.base
            + upper.along * s2**2
            + upper.across * c2**2
            + fore.along * s23**2
            + fore.across * c23**2
            + upper.mass * (upper.com * c2) ** 2
            + fore.mass * reach**2
        )
        M[2, 2] = fore.across + fore.mass * fore.com**2
        M[1, 2] = M[2, 1] = M[2, 2] + fore.mass * upper.length * fore.com * np.cos(q[2])
        M[1, 1] = (
            upper.across
            + upper.mass * upper.com**2
            + fore.mass * upper.length**2
            + 2 * M[1, 2]
            - M[2, 2]
        )
        return M

    def coriolis_torque(self, q, v):
        upper, fore = self.links
        c2, c23 = np.cos(q[1]), np.cos(q[1] + q[2])
        s2, s23 = np.sin(q[1]), np.sin(q[1] + q[2])
        reach = upper.length * c2 + fore.com * c23
        k3 = (fore.along - fore.across) * s23 * c23 - fore.mass * reach * fore.com * s23
        k2 = k3 + (upper.along - upper.across - upper.mass * upper.com**2) * s2 * c2
        k2 -= fore.mass * reach * upper.length * s2
        h = fore.mass * upper.length * fore.com * np.sin(q[2])
        t1 = 2 * v[0] * (k2 * v[1] + k3 * v[2])
        t2 = -k2 * v[0] ** 2 - h * v[2] * (2 * v[1] + v[2])
        t3 = -k3 * v[0] ** 2 + h * v[1] ** 2
        return np.array([t1, t2, t3])

    def gravity(self, q):
        upper, fore = self.links
        g3 = fore.mass * self.g * fore.com * np.cos(q[1] + q[2])
        g2 = (upper.mass * upper.com + fore.mass * upper.length) * self.g * np.cos(q[1]) + g3
        return np.array([0.0, g2, g3])


arm = Elbow(links=[Link(4.0, 0.5, 0.25, 0.01, 0.09), Link(2.5, 0.4, 0.2, 0.005, 0.04)])
mass_matrix = arm.mass_matrix
coriolis_torque = arm.coriolis_torque
gravity = arm.gravity
