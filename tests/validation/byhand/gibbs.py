"""Gibbs and Appell: torques are slopes of the energy of acceleration; a slide with a two-link arm on it."""

import numpy as np

m0, m1, m2 = 5.2, 1.8, 1.05
l1, r1, r2 = 0.39, 0.18, 0.16
I1, I2 = 0.0274, 0.0097
g = 9.81


def accelerations(q, v, a):
    s1, c1 = np.sin(q[1]), np.cos(q[1])
    s12, c12 = np.sin(q[1] + q[2]), np.cos(q[1] + q[2])
    w1, w12 = v[1], v[1] + v[2]
    e1, e12 = a[1], a[1] + a[2]
    x1 = a[0] - r1 * (s1 * e1 + c1 * w1**2)
    z1 = r1 * (c1 * e1 - s1 * w1**2)
    xe = a[0] - l1 * (s1 * e1 + c1 * w1**2)
    ze = l1 * (c1 * e1 - s1 * w1**2)
    x2 = xe - r2 * (s12 * e12 + c12 * w12**2)
    z2 = ze + r2 * (c12 * e12 - s12 * w12**2)
    return a[0], x1, z1, x2, z2, e1, e12


def energy_of_acceleration(q, v, a):
    x0, x1, z1, x2, z2, e1, e12 = accelerations(q, v, a)
    S = 0.5 * m0 * x0**2
    S = S + 0.5 * m1 * (x1**2 + z1**2) + 0.5 * I1 * e1**2
    S = S + 0.5 * m2 * (x2**2 + z2**2) + 0.5 * I2 * e12**2
    return S


def gravity(q):
    G2 = m2 * g * r2 * np.cos(q[1] + q[2])
    G1 = (m1 * r1 + m2 * l1) * g * np.cos(q[1]) + G2
    return np.array([0.0, G1, G2])


def inverse_dynamics(q, v, a):
    tau = np.zeros(3)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 0.5
        tau[k] = energy_of_acceleration(q, v, a + step) - energy_of_acceleration(q, v, a - step)
    return tau + gravity(q)


def mass_matrix(q):
    still = np.zeros(3)
    return np.column_stack([inverse_dynamics(q, still, e) - gravity(q) for e in np.eye(3)])


def coriolis_torque(q, v):
    return inverse_dynamics(q, v, np.zeros(3)) - gravity(q)
