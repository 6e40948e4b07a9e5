"""A camera on a pan-tilt head at a wall, pan axis level: torque = Y(q, v, a) theta, for identification."""

import numpy as np

J1 = 0.0123
m2 = 1.37
cx = 0.064
cz = 0.041
Ixx = 0.0046
Iyy = 0.0067
Izz = 0.0052
g = 9.81


def base_parameters():
    Jxx = Ixx + m2 * cz**2
    Jyy = Iyy + m2 * (cx**2 + cz**2)
    Jzz = Izz + m2 * cx**2
    Jxz = -m2 * cx * cz
    return np.array([J1 + Jzz, Jxx - Jzz, Jxz, Jyy, m2 * cx, m2 * cz])


def regressor(q, v, a):
    s1, c1 = np.sin(q[0]), np.cos(q[0])
    s2, c2 = np.sin(q[1]), np.cos(q[1])
    sin2, cos2 = np.sin(2 * q[1]), np.cos(2 * q[1])
    Y = np.zeros((2, 6))
    Y[0, 0] = a[0]
    Y[0, 1] = s2**2 * a[0] + sin2 * v[0] * v[1]
    Y[0, 2] = -sin2 * a[0] - 2 * cos2 * v[0] * v[1]
    Y[0, 4] = g * s1 * c2
    Y[0, 5] = g * s1 * s2
    Y[1, 1] = -0.5 * sin2 * v[0] ** 2
    Y[1, 2] = cos2 * v[0] ** 2
    Y[1, 3] = a[1]
    Y[1, 4] = g * c1 * s2
    Y[1, 5] = -g * c1 * c2
    return Y


def inverse_dynamics(q, v, a):
    return regressor(q, v, a) @ base_parameters()
