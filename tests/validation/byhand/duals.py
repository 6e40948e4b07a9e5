"""Shoulder and elbow with a load at the tip; energies are differentiated by dual numbers of its own."""

import math

import numpy as np


class Dual:
    """A number and its derivative: x + d e, with e e = 0."""

    def __init__(self, x, d=0.0):
        self.x, self.d = x, d

    def __add__(self, other):
        other = dual(other)
        return Dual(self.x + other.x, self.d + other.d)

    def __sub__(self, other):
        other = dual(other)
        return Dual(self.x - other.x, self.d - other.d)

    def __mul__(self, other):
        other = dual(other)
        return Dual(self.x * other.x, self.x * other.d + self.d * other.x)

    __radd__, __rmul__ = __add__, __mul__


def dual(x):
    return x if isinstance(x, Dual) else Dual(x)


def sin(x):
    return Dual(math.sin(x.x), math.cos(x.x) * x.d) if isinstance(x, Dual) else math.sin(x)


def cos(x):
    return Dual(math.cos(x.x), -math.sin(x.x) * x.d) if isinstance(x, Dual) else math.cos(x)


class Link:
    def __init__(self, mass, length, centre, inertia):
        self.mass, self.length, self.centre, self.inertia = mass, length, centre, inertia


upper = Link(mass=2.1, length=0.43, centre=0.19, inertia=0.037)
lower = Link(mass=1.3, length=0.36, centre=0.14, inertia=0.0155)
load = 0.45
g = 9.81


def kinetic(q, v):
    w1, w2 = v[0], v[0] + v[1]
    elbow = upper.length * upper.length * w1 * w1
    cross = upper.length * w1 * w2 * cos(q[1])
    about = upper.mass * upper.centre**2 + upper.inertia
    T1 = 0.5 * about * (w1 * w1)
    T2 = 0.5 * lower.mass * (elbow + lower.centre**2 * (w2 * w2) + 2 * lower.centre * cross)
    T3 = 0.5 * lower.inertia * (w2 * w2)
    T4 = 0.5 * load * (elbow + lower.length**2 * (w2 * w2) + 2 * lower.length * cross)
    return T1 + T2 + T3 + T4


def potential(q):
    height = upper.length * sin(q[0])
    V1 = upper.mass * g * upper.centre * sin(q[0])
    V2 = lower.mass * g * (height + lower.centre * sin(q[0] + q[1]))
    V3 = load * g * (height + lower.length * sin(q[0] + q[1]))
    return V1 + V2 + V3


def seeded(q, k):
    return [Dual(float(x), 1.0 if i == k else 0.0) for i, x in enumerate(q)]


def mass_matrix(q):
    D = np.zeros((2, 2))
    for i in range(2):
        for j in range(2):
            v = [float(k == i) + float(k == j) for k in range(2)]
            a = [float(k == i) - float(k == j) for k in range(2)]
            D[i, j] = (kinetic(q, v) - kinetic(q, a)) / 2
    return D


def coriolis_torque(q, v):
    rates = [float(x) for x in v]
    slope = np.array([kinetic(seeded(q, k), rates).d for k in range(2)])
    moving = [Dual(float(x), w) for x, w in zip(q, rates)]
    momentum = np.zeros(2)
    for i in range(2):
        plus = [w + (k == i) for k, w in enumerate(rates)]
        minus = [w - (k == i) for k, w in enumerate(rates)]
        momentum[i] = (kinetic(moving, plus).d - kinetic(moving, minus).d) / 2
    return momentum - slope


def gravity(q):
    return np.array([potential(seeded(q, k)).d for k in range(2)])
