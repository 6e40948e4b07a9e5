"""A chain of point masses on rods without mass, all links at once with NumPy: absolute angles inside."""

import numpy as np

masses = np.array([1.9, 1.3, 0.8])
lengths = np.array([0.45, 0.35, 0.3])
g = 9.81
N = len(masses)

# absolute angles from joint angles
T = np.tril(np.ones((N, N)))
# mass that hangs below each joint
below = np.cumsum(masses[::-1])[::-1]
mu = np.minimum.outer(below, below)
ll = np.outer(lengths, lengths)


def absolute(q):
    return np.cumsum(q)


def mass_matrix(q):
    th = absolute(q)
    A = mu * ll * np.cos(np.subtract.outer(th, th))
    return T.T @ A @ T


def coriolis_torque(q, v):
    th, w = absolute(q), absolute(v)
    B = mu * ll * np.sin(np.subtract.outer(th, th))
    return T.T @ (B @ w**2)


def potential_energy(q):
    y = -np.cumsum(lengths * np.cos(absolute(q)))
    return g * np.dot(masses, y)


def gravity(q):
    return T.T @ (g * below * lengths * np.sin(absolute(q)))
