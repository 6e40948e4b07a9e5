"""Siciliano's two links with motors, in which the second motor sits at the elbow: frozen dataclasses."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Link:
    a: float
    l: float
    m: float
    I: float


@dataclass(frozen=True)
class Motor:
    m: float
    I: float
    kr: float


@dataclass(frozen=True)
class Arm:
    link1: Link
    link2: Link
    motor1: Motor
    motor2: Motor
    g: float = 9.81


arm = Arm(
    link1=Link(a=0.92, l=0.47, m=21.0, I=1.9),
    link2=Link(a=0.78, l=0.36, m=14.0, I=0.83),
    motor1=Motor(m=5.2, I=0.0112, kr=95.0),
    motor2=Motor(m=4.3, I=0.0087, kr=70.0),
)


def inertia_matrix(q: np.ndarray) -> np.ndarray:
    L1, L2 = arm.link1, arm.link2
    c2 = np.cos(q[1])
    b11 = L1.I + L1.m * L1.l**2 + arm.motor1.kr**2 * arm.motor1.I
    b11 += L2.I + L2.m * (L1.a**2 + L2.l**2 + 2 * L1.a * L2.l * c2)
    b11 += arm.motor2.m * L1.a**2
    b12 = L2.I + L2.m * (L2.l**2 + L1.a * L2.l * c2)
    b22 = L2.I + L2.m * L2.l**2 + arm.motor2.kr**2 * arm.motor2.I
    return np.array([[b11, b12], [b12, b22]])


def coriolis_matrix(q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    h = -arm.link2.m * arm.link1.a * arm.link2.l * np.sin(q[1])
    return np.array([[h * dq[1], h * (dq[0] + dq[1])], [-h * dq[0], 0.0]])


def gravity(q: np.ndarray) -> np.ndarray:
    L1, L2, g = arm.link1, arm.link2, arm.g
    g2 = L2.m * L2.l * g * np.cos(q[0] + q[1])
    g1 = (L1.m * L1.l + arm.motor2.m * L1.a + L2.m * L1.a) * g * np.cos(q[0]) + g2
    return np.array([g1, g2])
