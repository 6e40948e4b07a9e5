"""Two uniform links; a dataclass with defaults, and what follows from them in __post_init__."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Arm:
    mass1: float = 2.0
    mass2: float = 1.0
    length1: float = 0.5
    length2: float = 0.4
    inertia1: float = 0.04
    inertia2: float = 0.02
    gravity_constant: float = 9.81
    com1: float = field(init=False)
    com2: float = field(init=False)

    def __post_init__(self):
        self.com1 = self.length1 / 2
        self.com2 = self.length2 / 2

    def mass_matrix(self, q):
        coupling = self.mass2 * self.length1 * self.com2 * np.cos(q[1])
        tip = self.inertia2 + self.mass2 * self.com2**2
        root = self.inertia1 + self.mass1 * self.com1**2 + self.mass2 * self.length1**2
        return np.array([[root + tip + 2 * coupling, tip + coupling], [tip + coupling, tip]])

    def coriolis_torque(self, q, v):
        k = self.mass2 * self.length1 * self.com2 * np.sin(q[1])
        return np.array([-k * v[1] * (2 * v[0] + v[1]), k * v[0] ** 2])

    def gravity(self, q):
        level = np.cos(q[0] + q[1])
        tip = self.mass2 * self.com2 * self.gravity_constant * level
        root = (self.mass1 * self.com1 + self.mass2 * self.length1) * self.gravity_constant
        return np.array([root * np.cos(q[0]) + tip, tip])


arm = Arm()
mass_matrix, coriolis_torque, gravity = arm.mass_matrix, arm.coriolis_torque, arm.gravity
