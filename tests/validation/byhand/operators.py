"""Frames, twists and wrenches with operators as in KDL, its recursive solver in Python: roll, yaw, boom."""

from __future__ import annotations

import numpy as np


class Twist:
    def __init__(self, vel, rot):
        self.vel, self.rot = np.array(vel, float), np.array(rot, float)

    def __add__(self, t):
        return Twist(self.vel + t.vel, self.rot + t.rot)

    def __mul__(self, other):
        """Times a number; or the spatial cross product with a twist or a wrench."""
        if isinstance(other, Twist):
            vel = np.cross(self.rot, other.vel) + np.cross(self.vel, other.rot)
            return Twist(vel, np.cross(self.rot, other.rot))
        if isinstance(other, Wrench):
            torque = np.cross(self.rot, other.torque) + np.cross(self.vel, other.force)
            return Wrench(np.cross(self.rot, other.force), torque)
        return Twist(self.vel * other, self.rot * other)


class Wrench:
    def __init__(self, force, torque):
        self.force, self.torque = np.array(force, float), np.array(torque, float)

    def __add__(self, w):
        return Wrench(self.force + w.force, self.torque + w.torque)


class Frame:
    def __init__(self, M, p):
        self.M, self.p = np.array(M, float), np.array(p, float)

    def __mul__(self, w):
        """Wrench in the frame before."""
        force = self.M @ w.force
        return Wrench(force, self.M @ w.torque + np.cross(self.p, force))

    def inverse(self, t):
        """Twist in this frame."""
        return Twist(self.M.T @ (t.vel - np.cross(self.p, t.rot)), self.M.T @ t.rot)


class RigidBodyInertia:
    def __init__(self, m, c, Ic):
        self.m, self.h = m, m * np.array(c)
        self.I = np.diag(Ic) + m * (np.dot(c, c) * np.eye(3) - np.outer(c, c))

    def __mul__(self, t):
        force = self.m * t.vel - np.cross(self.h, t.rot)
        return Wrench(force, self.I @ t.rot + np.cross(self.h, t.vel))


class Joint:
    def __init__(self, kind, axis):
        self.kind, self.axis = kind, axis

    def twist(self, qdot):
        if self.kind == "Rot":
            return Twist(np.zeros(3), self.axis * qdot)
        return Twist(self.axis * qdot, np.zeros(3))

    def pose(self, q):
        if self.kind == "Trans":
            return np.eye(3), self.axis * q
        x, y, z = self.axis
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.cos(q) * np.eye(3) + np.sin(q) * K + (1 - np.cos(q)) * np.outer(self.axis, self.axis), 0.0


class Segment:
    def __init__(self, joint, origin, inertia):
        self.joint, self.origin, self.inertia = joint, np.array(origin), inertia

    def pose(self, q):
        M, p = self.joint.pose(q)
        return Frame(M, self.origin + p)


RotX = Joint("Rot", np.array([1.0, 0.0, 0.0]))
RotZ = Joint("Rot", np.array([0.0, 0.0, 1.0]))
TransX = Joint("Trans", np.array([1.0, 0.0, 0.0]))

chain = [
    Segment(
        RotX,
        [0.0, 0.0, 0.172],
        RigidBodyInertia(3.71, [0.083, -0.024, 0.037], [0.0187, 0.0263, 0.0241]),
    ),
    Segment(
        RotZ,
        [0.193, 0.028, 0.046],
        RigidBodyInertia(2.16, [0.121, 0.017, -0.032], [0.0054, 0.0171, 0.0182]),
    ),
    Segment(
        TransX,
        [0.157, -0.033, 0.029],
        RigidBodyInertia(0.94, [0.068, 0.014, 0.022], [0.0011, 0.0036, 0.0039]),
    ),
]
ag = Twist([0.0, 0.0, 9.81], [0.0, 0.0, 0.0])
rest = Twist(np.zeros(3), np.zeros(3))


def CartToJnt(q, q_dot, q_dotdot, base=ag):
    X, S, v, a, f = [], [], [], [], []
    for i, segment in enumerate(chain):
        X.append(segment.pose(q[i]))
        vj = segment.joint.twist(q_dot[i])
        S.append(segment.joint.twist(1.0))
        v.append(X[i].inverse(v[i - 1] if i else rest) + vj)
        a.append(X[i].inverse(a[i - 1] if i else base) + S[i] * q_dotdot[i] + v[i] * vj)
        Ii = segment.inertia
        f.append(Ii * a[i] + v[i] * (Ii * v[i]))
    torques = np.zeros(3)
    for i in (2, 1, 0):
        torques[i] = S[i].vel @ f[i].force + S[i].rot @ f[i].torque
        if i:
            f[i - 1] = f[i - 1] + X[i] * f[i]
    return torques


def inverse_dynamics(q, v, a):
    return CartToJnt(q, v, a)


def mass_matrix(q):
    return np.array([CartToJnt(q, np.zeros(3), e, rest) for e in np.eye(3)])


def coriolis_torque(q, v):
    return CartToJnt(q, v, np.zeros(3), rest)


def gravity(q):
    return CartToJnt(q, np.zeros(3), np.zeros(3))
