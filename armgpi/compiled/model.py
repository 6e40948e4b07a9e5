"""Equations of motion as CasADi expressions, by the textbook recursion, straight from a `pin.Model`.

Numbers that are the same in every rollout are literals, and what is zero in them costs nothing; those that
differ between rollouts (payloads, masses) are parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from armgpi.arrays import Array
from armgpi.compiled.symbols import Scalar

#: An array of :class:`armgpi.compiled.symbols.Scalar` and floats; NumPy has no types for arrays of objects.
Expressions = Any

#: Entries of rotations this close to 0, 1 or -1 are that: 6e-17 is what is left of cos(pi / 2).
_ROUNDING = 1e-15


class Body(NamedTuple):
    """A joint and the body that it carries, as plain numbers.

    Attributes:
        parent: index of the body that the joint stands on, -1 for the base.
        turns: whether the joint turns; it slides otherwise.
        numbers: joint axis (3), placement in the parent (rotation 9, position 3), mass, mass times centre
            (3), inertia about the joint's origin (6: xx, xy, yy, xz, yz, zz) and armature: 26 numbers.
    """

    parent: int
    turns: bool
    numbers: Array


def bodies(model: Any) -> tuple[list[Body], Array]:
    """Return the bodies of a `pin.Model` of single-axis joints (nq = nv), and its gravity (3,) [m/s^2]."""
    found = []
    for i in range(1, model.njoints):
        motion = np.array(model.joints[i].createData().S).ravel()
        turns = bool(np.any(motion[3:]))
        placement, inertia = model.jointPlacements[i], model.inertias[i]
        lever, mass = np.array(inertia.lever), float(inertia.mass)
        about_origin = np.array(inertia.inertia) + mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))
        numbers = np.concatenate(
            [
                _snapped(motion[3:] if turns else motion[:3]),
                _snapped(np.array(placement.rotation).ravel()),
                np.array(placement.translation),
                [mass],
                mass * lever,
                about_origin[np.tril_indices(3)],
                [model.armature[model.joints[i].idx_v]],
            ]
        )
        found.append(Body(int(model.parents[i]) - 1, turns, numbers))
    return found, np.array(model.gravity.linear)


class SymbolicModel:
    """The equations of motion of one arm, or of arms of one structure, as expressions.

    Attributes:
        n: number of joints.
        table: what differs between rollouts, shape (rollouts, k): the values of `parameters`.
        parameters: one symbol for each column of the table.
    """

    def __init__(
        self,
        models: Sequence[Any],
        ratio: Array | None = None,
        offset: Array | None = None,
        prefix: str = "m",
    ) -> None:
        """Take one `pin.Model`, or one per rollout; `ratio` and `offset` as in ``CoupledDynamics``.

        The parameters' names begin with `prefix`.

        Raises:
            ValueError: when the models have joints of different kinds or another order.
        """
        rows, gravity = zip(*(bodies(model) for model in models), strict=True)
        self._bodies = rows[0]
        shape = [(body.parent, body.turns) for body in self._bodies]
        if any([(body.parent, body.turns) for body in row] != shape for row in rows):
            raise ValueError("the arms differ in their joints")
        table = np.array(
            [
                np.concatenate([*(body.numbers for body in row), g])
                for row, g in zip(rows, gravity, strict=True)
            ]
        )
        differs = (table != table[0]).any(axis=0)
        self.table = np.ascontiguousarray(table[:, differs])
        self.parameters = [Scalar(ca.SX.sym(f"{prefix}{i}")) for i in range(self.table.shape[1])]
        values = table[0].astype(object)
        values[differs] = self.parameters
        self._numbers = values[:-3].reshape(len(self._bodies), -1)
        self._gravity = values[-3:]
        self._ratio, self._offset = ratio, offset
        self.n = len(self._bodies) if ratio is None else ratio.shape[1]

    def inverse(
        self, q: Expressions, v: Expressions | None, a: Expressions | None, weight: bool = True
    ) -> Expressions:
        """Return D(q) a + C(q, v) v + G(q) by the recursion of Newton and Euler (Featherstone 2008, ch. 5).

        Args:
            q: positions (n,).
            v: velocities (n,); None for none.
            a: accelerations (n,); None for none.
            weight: whether gravity acts.
        """
        if self._ratio is not None:
            q, v, a = (
                self._offset + self._ratio @ q,
                None if v is None else self._ratio @ v,
                None if a is None else self._ratio @ a,
            )
        zero: Expressions = np.zeros(3, dtype=object)
        # Velocity and acceleration of each body's origin, in its own axes: gravity as an acceleration up.
        turning: list[Expressions] = []
        turned: list[Expressions] = []
        moved: list[Expressions] = []
        rotations: list[tuple[Expressions, Expressions]] = []
        for i, body in enumerate(self._bodies):
            axis, rotation, position, *_ = self._split(i)
            base = body.parent < 0
            w0 = zero if base else turning[body.parent]
            dw0 = zero if base else turned[body.parent]
            a0 = (-self._gravity if weight else zero) if base else moved[body.parent]
            if body.turns:
                rotation = rotation @ _rotation(axis, q[i])
            else:
                position = position + rotation @ axis * q[i]
            at = a0 + _cross(dw0, position) + _cross(w0, _cross(w0, position))
            w, dw, at = rotation.T @ w0, rotation.T @ dw0, rotation.T @ at
            speed = zero if v is None else axis * v[i]
            gain = zero if a is None else axis * a[i]
            if body.turns:
                dw = dw + gain + _cross(w, speed)
                w = w + speed
            else:
                at = at + gain + 2.0 * _cross(w, speed)
            turning.append(w)
            turned.append(dw)
            moved.append(at)
            rotations.append((rotation, position))
        forces: list[Expressions] = [zero] * len(self._bodies)
        moments: list[Expressions] = [zero] * len(self._bodies)
        tau: Expressions = np.zeros(len(self._bodies), dtype=object)
        for i in reversed(range(len(self._bodies))):
            body = self._bodies[i]
            axis, _, _, mass, first, second, armature = self._split(i)
            w, dw, at = turning[i], turned[i], moved[i]
            force = forces[i] + mass * at + _cross(dw, first) + _cross(w, _cross(w, first))
            moment = moments[i] + second @ dw + _cross(w, second @ w) + _cross(first, at)
            tau[i] = axis @ (moment if body.turns else force)
            if a is not None:
                tau[i] = tau[i] + armature * a[i]
            if body.parent >= 0:
                rotation, position = rotations[i]
                force, moment = rotation @ force, rotation @ moment
                forces[body.parent] = forces[body.parent] + force
                moments[body.parent] = moments[body.parent] + moment + _cross(position, force)
        return tau if self._ratio is None else self._ratio.T @ tau

    def inertia(self, q: Expressions) -> Expressions:
        """Return D(q), shape (n, n): the Jacobian of the inverse dynamics in the accelerations."""
        a = ca.SX.sym("a", self.n)
        moving = self.inverse(q, None, scalars(a), weight=False)
        matrix = ca.jacobian(ca.vertcat(*(x.sx for x in moving)), a)
        return np.array([[Scalar(matrix[i, j]) for j in range(self.n)] for i in range(self.n)], dtype=object)

    def forward(self, q: Expressions, v: Expressions, tau: Expressions) -> Expressions:
        """Return D(q)^-1 (tau - C(q, v) v - G(q))."""
        return solve(self.inertia(q), tau - self.inverse(q, v, None, weight=True))

    def solved(self, q: Expressions, tau: Expressions) -> Expressions:
        """Return D(q)^-1 tau."""
        return solve(self.inertia(q), tau)

    def _split(self, i: int) -> tuple[Any, ...]:
        """Return axis, rotation, position, mass, mass times centre, inertia and armature of a body."""
        x = self._numbers[i]
        xx, xy, yy, xz, yz, zz = x[19:25]
        second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=object)
        return x[:3], x[3:12].reshape(3, 3), x[12:15], x[15], x[16:19], second, x[25]


def solve(matrix: Expressions, column: Expressions) -> Expressions:
    """Return matrix^-1 column for a symmetric, positive definite matrix, by its factors L D L'.

    They are taken from the last row up: for an arm without branches no order is better.
    """
    n = len(column)
    below: Expressions = matrix.copy()
    inverse = [None] * n
    x = list(column)
    for j in range(n):
        for k in range(j):
            below[j, j] = below[j, j] - below[j, k] * below[k, j]
        inverse[j] = 1.0 / below[j, j]
        for i in range(j + 1, n):
            for k in range(j):
                below[i, j] = below[i, j] - below[i, k] * below[k, j]
            # Above the diagonal the column before it is divided: D L' there, L below.
            below[j, i] = below[i, j]
            below[i, j] = below[i, j] * inverse[j]
    for i in range(n):
        for k in range(i):
            x[i] = x[i] - below[i, k] * x[k]
    x = [value * pivot for value, pivot in zip(x, inverse, strict=True)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            x[i] = x[i] - below[k, i] * x[k]
    return np.array(x, dtype=object)


def _rotation(axis: Expressions, angle: Any) -> Expressions:
    """Return the rotation matrix about an axis of length one (Rodrigues)."""
    x, y, z = axis
    s, c = Scalar(ca.sin(angle.sx)), Scalar(ca.cos(angle.sx))
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], dtype=object)
    outer = np.outer(axis, axis)
    return np.eye(3) * c + skew * s + outer * (1.0 - c)


def _cross(a: Expressions, b: Expressions) -> Expressions:
    """Return the cross product; NumPy's own does not know expressions."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], dtype=object
    )


def scalars(x: Any) -> Expressions:
    """Return the entries of a CasADi vector as an array."""
    return np.array([Scalar(x[i]) for i in range(x.numel())], dtype=object)


def _snapped(x: Array) -> Array:
    """Return entries of axes and rotations without the rounding of 0, 1 and -1."""
    nearest = np.rint(x)
    return np.where(np.abs(x - nearest) < _ROUNDING, nearest, x)
