"""A leaning arm with SciPy's rotations: Jacobian columns by cross products, sums over bodies by einsum."""

import numpy as np
from scipy.spatial.transform import Rotation

BODIES = [
    {"mass": 2.1, "com": [0.03, 0.0, 0.14], "inertia": [0.014, 0.013, 0.009], "joint": [0.0, 0.0, 0.1]},
    {"mass": 1.6, "com": [0.16, 0.0, 0.02], "inertia": [0.003, 0.017, 0.016], "joint": [0.05, 0.0, 0.26]},
    {"mass": 0.7, "com": [0.09, 0.01, 0.0], "inertia": [0.001, 0.005, 0.0055], "joint": [0.34, 0.0, 0.0]},
]
AXES = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
GRAVITY = np.array([0.0, 0.0, -9.81])


def frames(q):
    R, p, found = Rotation.identity(), np.zeros(3), []
    for angle, axis, body in zip(q, AXES, BODIES):
        p = p + R.apply(body["joint"])
        z = R.apply(axis)
        R = R * Rotation.from_rotvec(angle * axis)
        found.append((R, p, z, p + R.apply(body["com"])))
    return found


def jacobians(q):
    states = frames(q)
    n = len(states)
    Jv, Jw = np.zeros((n, 3, n)), np.zeros((n, 3, n))
    for k, (_, _, _, com) in enumerate(states):
        for j, (_, p, z, _) in enumerate(states[: k + 1]):
            Jv[k, :, j] = np.cross(z, com - p)
            Jw[k, :, j] = z
    return states, Jv, Jw


def mass_matrix(q):
    states, Jv, Jw = jacobians(q)
    m = np.array([body["mass"] for body in BODIES])
    D = np.einsum("k,kai,kaj->ij", m, Jv, Jv)
    for (R, _, _, _), J, body in zip(states, Jw, BODIES):
        A = R.as_matrix()
        D += J.T @ A @ np.diag(body["inertia"]) @ A.T @ J
    return D


def gravity(q):
    _, Jv, _ = jacobians(q)
    weights = np.array([body["mass"] * GRAVITY for body in BODIES])
    return -np.einsum("kai,ka->i", Jv, weights)
