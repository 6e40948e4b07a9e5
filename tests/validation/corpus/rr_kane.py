"""A turret with an arm that lifts a load, by Kane's partial velocities in the frames of its bodies."""

import numpy as np

p = {
    "m2": 1.15,
    "m3": 0.45,
    "l1": 0.11,
    "l2": 0.42,
    "lc2": 0.19,
    "I1": 0.03,
    "Ix2": 0.011,
    "Iy2": 0.017,
    "Iz2": 0.015,
    "g": 9.81,
}


def point(r, q, v, a):
    """Return acceleration and partial velocities of a point of the arm, along the axes of the turret."""
    c, s = np.cos(q[1]), np.sin(q[1])
    reach = p["l1"] + r * c
    speed = -r * s * v[1]
    first = np.array([0.0, reach, 0.0])
    second = np.array([-r * s, 0.0, r * c])
    acceleration = np.array(
        [
            -r * s * a[1] - r * c * v[1] ** 2 - reach * v[0] ** 2,
            reach * a[0] + 2 * speed * v[0],
            r * c * a[1] - r * s * v[1] ** 2,
        ]
    )
    return acceleration, first, second


def inverse_dynamics(q, v, a):
    c, s = np.cos(q[1]), np.sin(q[1])
    pull = np.array([0.0, 0.0, -p["g"]])
    tau = np.array([p["I1"] * a[0], 0.0])
    for mass, r in ((p["m2"], p["lc2"]), (p["m3"], p["l2"])):
        acceleration, first, second = point(r, q, v, a)
        force = mass * (acceleration - pull)
        tau = tau + np.array([force @ first, force @ second])
    # The turning of the arm, along its own axes.
    J = np.diag([p["Ix2"], p["Iy2"], p["Iz2"]])
    w = np.array([v[0] * s, -v[1], v[0] * c])
    dw = np.array([a[0] * s + v[0] * v[1] * c, -a[1], a[0] * c - v[0] * v[1] * s])
    N = J @ dw + np.cross(w, J @ w)
    return tau + np.array([N @ np.array([s, 0.0, c]), N @ np.array([0.0, -1.0, 0.0])])
