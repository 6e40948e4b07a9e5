"""Yaw, pitch and roll by quaternions; torques from virtual power."""

import numpy as np

links = [
    ((0, 0, 1), (0.0, 0.0, 0.0), 3.0, (0.02, 0.0, 0.1), (0.03, 0.02, 0.01)),
    ((0, 1, 0), (0.1, 0.0, 0.2), 1.5, (0.15, 0.0, 0.01), (0.004, 0.01, 0.009)),
    ((1, 0, 0), (0.3, 0.0, 0.0), 0.8, (0.1, 0.03, 0.0), (0.001, 0.003, 0.002)),
]


def multiply(a, b):
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.concatenate([[w], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def turned(q, x):
    conjugate = q * np.array([1, -1, -1, -1])
    return multiply(multiply(q, np.concatenate([[0.0], x])), conjugate)[1:]


def inverse_dynamics(q, v, a):
    Q, p = np.array([1.0, 0, 0, 0]), np.zeros(3)
    w, dw, acc = np.zeros(3), np.zeros(3), np.array([0, 0, 9.81])
    axes, points, tau = [], [], np.zeros(3)
    for k, (axis, at, m, c, I) in enumerate(links):
        r = turned(Q, np.array(at))
        acc = acc + np.cross(dw, r) + np.cross(w, np.cross(w, r))
        p = p + r
        z = turned(Q, np.array(axis, dtype=float))
        dw = dw + z * a[k] + np.cross(w, z) * v[k]
        w = w + z * v[k]
        Q = multiply(Q, np.concatenate([[np.cos(q[k] / 2)], np.sin(q[k] / 2) * np.array(axis)]))
        axes.append(z)
        points.append(p)
        s = turned(Q, np.array(c))
        force = m * (acc + np.cross(dw, s) + np.cross(w, np.cross(w, s)))
        back = Q * np.array([1, -1, -1, -1])
        lw, ldw = turned(back, w), turned(back, dw)
        moment = turned(Q, np.array(I) * ldw + np.cross(lw, np.array(I) * lw))
        for j in range(k + 1):
            tau[j] += force @ np.cross(axes[j], p + s - points[j]) + moment @ axes[j]
    return tau
