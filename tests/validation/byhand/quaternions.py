"""Yaw, shoulder and forearm roll by unit quaternions; Jacobians by cross products, C by differences."""

import numpy as np

MASS = [3.4, 2.2, 0.95]
PLACE = np.array([[0.0, 0.0, 0.15], [0.07, 0.0, 0.21], [0.33, 0.02, 0.0]])
CENTRE = np.array([[0.02, 0.0, 0.12], [0.17, -0.01, 0.0], [0.11, 0.0, 0.015]])
MOMENT = np.array([[0.021, 0.0195, 0.012], [0.0045, 0.0228, 0.0213], [0.0007, 0.0038, 0.0041]])
AXIS = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
FIELD = np.array([0.0, 0.0, -9.81])


def product(p, r):
    w = p[0] * r[0] - p[1:] @ r[1:]
    return np.array([w, *(p[0] * r[1:] + r[0] * p[1:] + np.cross(p[1:], r[1:]))])


def rotate(p, x):
    conjugate = np.array([p[0], -p[1], -p[2], -p[3]])
    return product(product(p, np.array([0.0, *x])), conjugate)[1:]


def turn(axis, angle):
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])


def bodies(q):
    p, at = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    axes, origins, attitudes, centres = [], [], [], []
    for k in range(3):
        at = at + rotate(p, PLACE[k])
        axes.append(rotate(p, AXIS[k]))
        p = product(p, turn(AXIS[k], q[k]))
        origins.append(at)
        attitudes.append(p)
        centres.append(at + rotate(p, CENTRE[k]))
    return axes, origins, attitudes, centres


def columns(q):
    axes, origins, attitudes, centres = bodies(q)
    for k in range(3):
        linear, angular = np.zeros((3, 3)), np.zeros((3, 3))
        back = attitudes[k] * np.array([1.0, -1.0, -1.0, -1.0])
        for j in range(k + 1):
            linear[:, j] = np.cross(axes[j], centres[k] - origins[j])
            angular[:, j] = rotate(back, axes[j])
        yield MASS[k], MOMENT[k], linear, angular


def mass_matrix(q):
    D = np.zeros((3, 3))
    for m, moment, linear, angular in columns(q):
        D += m * linear.T @ linear + angular.T @ np.diag(moment) @ angular
    return D


def slopes(q, h=1e-4):
    found = np.zeros((3, 3, 3))
    for k in range(3):
        step = np.zeros(3)
        step[k] = h
        far = (mass_matrix(q + 2 * step) - mass_matrix(q - 2 * step)) / (4 * h)
        near = (mass_matrix(q + step) - mass_matrix(q - step)) / (2 * h)
        found[k] = (4 * near - far) / 3
    return found


def coriolis_torque(q, v):
    d = slopes(q)
    rate = np.einsum("kij,k->ij", d, v)
    return rate @ v - 0.5 * np.einsum("kij,i,j->k", d, v, v)


def gravity(q):
    G = np.zeros(3)
    for m, _, linear, _ in columns(q):
        G -= m * linear.T @ FIELD
    return G
