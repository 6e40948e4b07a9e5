"""Every body as six particles with its mass, centre and moments; their Jacobians by complex steps (R P R)."""

import numpy as np

mass = [2.93, 1.87, 0.76]
centre = [[0.031, -0.017, 0.142], [0.113, 0.024, -0.019], [0.137, -0.011, 0.028]]
moment = [[0.0236, 0.0191, 0.0127], [0.0061, 0.0153, 0.0139], [0.0013, 0.0047, 0.0042]]
overhang, height = 0.063, 0.274
reach, beside, drop = 0.218, 0.037, 0.041
down = np.array([0.0, 0.0, -9.81])


def particles(k):
    Ix, Iy, Iz = moment[k]
    second = 0.5 * np.array([Iy + Iz - Ix, Iz + Ix - Iy, Ix + Iy - Iz])
    spread = np.sqrt(3 * second / mass[k])
    return [np.array(centre[k]) + sign * row for row in np.diag(spread) for sign in (1, -1)]


def place(k, p, q):
    """Where the point p of body k is, in the base."""
    x, y, z = p
    if k == 2:
        c3, s3 = np.cos(q[2]), np.sin(q[2])
        x, z = reach + c3 * x + s3 * z, c3 * z - s3 * x - drop
        y = beside + y
    if k >= 1:
        x, z = overhang + q[1] + x, height + z
    c1, s1 = np.cos(q[0]), np.sin(q[0])
    return np.array([c1 * x - s1 * y, s1 * x + c1 * y, z])


def point_jacobian(k, p, q):
    steps = 1e-20j * np.eye(3)
    return np.column_stack([place(k, p, q + step).imag for step in steps]) / 1e-20


def bodies():
    for k in range(3):
        for p in particles(k):
            yield k, p, mass[k] / 6


def mass_matrix(q):
    M = np.zeros((3, 3))
    for k, p, m in bodies():
        J = point_jacobian(k, p, q)
        M += m * J.T @ J
    return M


def coriolis_torque(q, v):
    eps = 1e-5
    h = np.zeros(3)
    for k, p, m in bodies():
        ahead, behind = point_jacobian(k, p, q + eps * v), point_jacobian(k, p, q - eps * v)
        rate = (ahead - behind) / (2 * eps)
        h += m * point_jacobian(k, p, q).T @ rate @ v
    return h


def gravity(q):
    G = np.zeros(3)
    for k, p, m in bodies():
        G -= m * point_jacobian(k, p, q).T @ down
    return G
