"""Pitch, roll and yaw as a table of bodies that know their parent; a state caches what it was asked for."""

from functools import cached_property

import numpy as np

ARM = {
    "trunk": {
        "parent": "base",
        "axis": (0.0, 1.0, 0.0),
        "at": (0.0, 0.0, 0.153),
        "mass": 3.94,
        "com": (0.044, -0.026, 0.117),
        "moments": (0.0287, 0.0314, 0.0169),
    },
    "fork": {
        "parent": "trunk",
        "axis": (1.0, 0.0, 0.0),
        "at": (0.071, 0.052, 0.194),
        "mass": 1.47,
        "com": (0.086, 0.033, 0.048),
        "moments": (0.0074, 0.0118, 0.0097),
    },
    "head": {
        "parent": "fork",
        "axis": (0.0, 0.0, 1.0),
        "at": (0.126, -0.038, 0.067),
        "mass": 0.69,
        "com": (0.059, 0.021, 0.036),
        "moments": (0.0018, 0.0029, 0.0024),
    },
}
NAMES = list(ARM)
GRAVITY = np.array([0.0, 0.0, -9.81])


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


class Base:
    R = np.eye(3)
    origin = velocity = w = np.zeros(3)
    chain = ()


class Body:
    def __init__(self, state, name):
        self.state = state
        self.k = NAMES.index(name)
        self.row = ARM[name]
        self.m = self.row["mass"]
        self.unit, self.at, self.com = (np.array(self.row[x]) for x in ("axis", "at", "com"))

    @cached_property
    def parent(self):
        return self.state[self.row["parent"]]

    @cached_property
    def chain(self):
        return (*self.parent.chain, self)

    @cached_property
    def R(self):
        t, K = self.state.q[self.k], skew(self.unit)
        return self.parent.R @ (np.eye(3) + np.sin(t) * K + (1 - np.cos(t)) * K @ K)

    @cached_property
    def axis(self):
        return self.parent.R @ self.unit

    @cached_property
    def origin(self):
        return self.parent.origin + self.parent.R @ self.at

    @cached_property
    def centre(self):
        return self.origin + self.R @ self.com

    @cached_property
    def inertia(self):
        return self.R @ np.diag(self.row["moments"]) @ self.R.T

    @cached_property
    def w(self):
        return self.parent.w + self.axis * self.state.v[self.k]

    @cached_property
    def velocity(self):
        return self.parent.velocity + np.cross(self.parent.w, self.origin - self.parent.origin)

    @cached_property
    def centre_velocity(self):
        return self.velocity + np.cross(self.w, self.centre - self.origin)

    @cached_property
    def axis_rate(self):
        return np.cross(self.parent.w, self.axis)

    def filled(self, column):
        J = np.zeros((3, len(NAMES)))
        for b in self.chain:
            J[:, b.k] = column(b)
        return J

    @cached_property
    def Jw(self):
        return self.filled(lambda b: b.axis)

    @cached_property
    def Jv(self):
        return self.filled(lambda b: np.cross(b.axis, self.centre - b.origin))

    @cached_property
    def dJw(self):
        return self.filled(lambda b: b.axis_rate)

    @cached_property
    def dJv(self):
        return self.filled(
            lambda b: np.cross(b.axis_rate, self.centre - b.origin)
            + np.cross(b.axis, self.centre_velocity - b.velocity)
        )


class State:
    def __init__(self, q, v=(0.0, 0.0, 0.0)):
        self.q, self.v = q, v
        self.found = {"base": Base()}

    def __getitem__(self, name):
        if name not in self.found:
            self.found[name] = Body(self, name)
        return self.found[name]

    @cached_property
    def bodies(self):
        return [self[name] for name in NAMES]

    @cached_property
    def D(self):
        return sum(b.m * b.Jv.T @ b.Jv + b.Jw.T @ b.inertia @ b.Jw for b in self.bodies)

    @cached_property
    def C(self):
        linear = sum(b.m * b.Jv.T @ b.dJv for b in self.bodies)
        angular = sum(b.Jw.T @ (b.inertia @ b.dJw + skew(b.w) @ b.inertia @ b.Jw) for b in self.bodies)
        return linear + angular

    @cached_property
    def G(self):
        return -sum(b.m * b.Jv.T @ GRAVITY for b in self.bodies)


def D(q):
    return State(q).D


def C(q, v):
    return State(q, v).C


def G(q):
    return State(q).G
