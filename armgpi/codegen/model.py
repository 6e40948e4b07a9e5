"""Equations of motion as CasADi expressions, by the textbook recursion, straight from a `pin.Model`.

Numbers that are the same in every rollout are literals, and what is zero in them costs nothing; those that
differ between rollouts (payloads, masses) are parameters.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.codegen.algebra import ca
from armgpi.codegen.symbols import Scalar, solve
from armgpi.robot.dynamics import VariedDynamics

# Not by pinocchio.casadi, which Pinocchio's packages on PyPI lack.

#: An array of :class:`armgpi.codegen.symbols.Scalar` and floats; NumPy has no types for arrays of objects.
Expressions = Any

#: Numbers of a body, and where among them its inertia and its rotor's are; see :class:`Body`.
_WIDTH, _INERTIA, _ARMATURE = 26, slice(15, 25), 25
#: Entries of rotations this close to 0, 1 or -1 are that: 6e-17 is what is left of cos(pi / 2).
_ROUNDING = 1e-15


class Body(NamedTuple):
    """A joint and the body that it carries, as plain numbers.

    Attributes:
        parent: index of the body that carries the joint, -1 for the base.
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
    for i in range(1, model.njoints):  # joint 0 is the universe
        motion = np.array(model.joints[i].createData().S).ravel()
        turns = bool(np.any(motion[3:]))
        placement, inertia = model.jointPlacements[i], model.inertias[i]
        lever, mass = np.array(inertia.lever), float(inertia.mass)
        square = lever @ lever * np.eye(3) - np.outer(lever, lever)
        about_origin = np.array(inertia.inertia) + mass * square
        numbers = np.concatenate(
            [
                _snap(motion[3:] if turns else motion[:3]),
                _snap(np.array(placement.rotation).ravel()),
                np.array(placement.translation),
                [mass],
                mass * lever,
                about_origin[np.tril_indices(3)],
                [model.armature[model.joints[i].idx_v]],
            ]
        )
        found.append(Body(int(model.parents[i]) - 1, turns, numbers))
    return found, np.array(model.gravity.linear)


def numbers_of(found: Sequence[Body], gravity: Array) -> Array:
    """Return the numbers of all bodies, 26 of each, and gravity (3,) in one array."""
    return np.concatenate([*(body.numbers for body in found), gravity])


def varying(model: Any, dynamics: VariedDynamics) -> Any:
    """Return which numbers of a `pin.Model` vary, a mask in the order of :func:`numbers_of`.

    Where one rotor inertia varies all do. :func:`varied_table` has the numbers in the same order.
    """
    found = np.zeros((model.njoints - 1, _WIDTH), dtype=bool)
    if dynamics.load is not None:
        found[dynamics.joint - 1, _INERTIA] = True
    found[:, _ARMATURE] = dynamics.armature is not None
    return np.concatenate([found.ravel(), np.full(3, dynamics.gravity_vector is not None)])


def varied_table(model: Any, dynamics: VariedDynamics, own: Array) -> Array:
    """Return the numbers that vary in every row, shape (batch, k), by sums over all rows at once.

    They are in the order of :func:`varying`: body by body, its inertia before its rotor's, then gravity.

    Args:
        model: the `pin.Model` that varies, of joints with one coordinate each.
        dynamics: what varies, at least one number; its load is a point mass.
        own: the model's numbers among them, (k,).
    """
    parts: list[Array] = []
    if dynamics.load is not None:
        mass, com = dynamics.load[:, :1], dynamics.load[:, 1:]
        distance = (com * com).sum(axis=1)[:, None, None]
        square = distance * np.eye(3) - com[:, :, None] * com[:, None, :]
        rows, columns = np.tril_indices(3)
        second = (mass[..., None] * square)[:, rows, columns]
        # Inertias about one point add up, also where base parameters have part of one body's in another.
        before = (dynamics.joint - 1) if dynamics.armature is not None else 0  # rotors of the bodies before
        load = np.hstack([mass, mass * com, second])
        parts.append(own[before : before + 10] + load)
    if dynamics.armature is not None:
        places = [int(model.joints[i].idx_v) for i in range(1, model.njoints)]
        rotors = dynamics.armature[:, places]
        body = dynamics.joint - 1
        if parts:  # the body with the load has its own after its inertia
            parts = [rotors[:, :body], parts[0], rotors[:, body:]]
        else:
            parts.append(rotors)
    if dynamics.gravity_vector is not None:
        parts.append(dynamics.gravity_vector)
    return np.hstack(parts)


def regroup_bodies(found: Sequence[Body]) -> list[Body]:
    """Return bodies of the same equations of motion with fewer numbers (Khalil and Bennis 1987).

    What a turning joint does not notice of its body goes to the parent: its mass, its first moment along
    the axis a, and s (1 - a a') of its inertia, with s its moment about an axis across.
    """
    numbers = [body.numbers.copy() for body in found]
    # From the tips to the base, as what goes to a parent may go on from there.
    below = np.tril_indices(3)
    for i in reversed(range(len(found))):
        axis, position = numbers[i][:3], numbers[i][12:15]
        rotation = numbers[i][3:12].reshape(3, 3)
        # About an axis that is none of the coordinates' nothing would become zero.
        across = np.flatnonzero(axis == 0.0)
        if not found[i].turns or len(across) < 2:
            continue
        mass, first = numbers[i][15], numbers[i][16:19]
        xx, xy, yy, xz, yz, zz = numbers[i][19:25]
        second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about = second[across[1], across[1]]
        along = (axis @ first) * axis
        disc = about * (np.eye(3) - np.outer(axis, axis))
        numbers[i][15] = 0.0
        numbers[i][16:19] = _without_rounding(first - along, np.abs(first).max())
        numbers[i][19:25] = _without_rounding((second - disc)[below], np.abs(second).max())
        if found[i].parent >= 0:
            along, parent = rotation @ along, numbers[found[i].parent]
            shift = np.outer(position, along) + np.outer(along + mass * position, position)
            moved = rotation @ disc @ rotation.T + np.trace(shift) * np.eye(3) - shift
            parent[15] += mass
            parent[16:19] += along + mass * position
            parent[19:25] += moved[np.tril_indices(3)]
    return [body._replace(numbers=x) for body, x in zip(found, numbers, strict=True)]


def _without_rounding(x: Array, size: float) -> Array:
    """Return numbers of which those that are rounding errors of `size` are zero."""
    return np.where(np.abs(x) < _ROUNDING * size, 0.0, x)


class SymbolicModel:
    """The equations of motion of one arm, or of arms of one structure, as expressions.

    Attributes:
        n: number of joints.
        table: what differs between rollouts, shape (rollouts, k): the values of `parameters`.
        parameters: one symbol for each column of the table.
        fingerprint: of the equations: equal ones have the same.
        digest: the beginning of it, as a name.
    """

    def __init__(
        self,
        models: Sequence[Any],
        ratio: Array | None = None,
        offset: Array | None = None,
        varies: Any = None,
    ) -> None:
        """Take one `pin.Model`, or one per rollout; `ratio` and `offset` as in ``CoupledDynamics``.

        Args:
            models: one, or one for each rollout.
            ratio: how the coordinates of bodies follow those of joints; None where they are the same.
            offset: likewise.
            varies: of one model, which of its numbers vary, as :func:`numbers_of` has them; of several it is
                those that differ.

        Raises:
            ValueError: when the models have joints of different kinds or another order.
        """
        rows, gravity = zip(*(bodies(model) for model in models), strict=True)
        if len(models) == 1:
            # Of several arms more numbers would differ after this than before.
            rows = (regroup_bodies(rows[0]),)
        self._bodies = rows[0]
        shape = [(body.parent, body.turns) for body in self._bodies]
        if any([(body.parent, body.turns) for body in row] != shape for row in rows):
            raise ValueError("the arms differ in their joints")
        table = np.array([numbers_of(*row) for row in zip(rows, gravity, strict=True)])
        # Only what differs is an input: a literal that is zero or one makes no operation at all.
        differs = (table != table[0]).any(axis=0) if varies is None else varies
        self.table = np.ascontiguousarray(table[:, differs])
        self.parameters = [Scalar(ca.SX.sym(f"m{i}")) for i in range(self.table.shape[1])]
        values = table[0].astype(object)
        values[differs] = self.parameters
        self._way: Callable[[Expressions], Expressions] | None = None  # the cheaper one to D(q)
        self._numbers = values[:-3].reshape(len(self._bodies), -1)
        self._gravity = values[-3:]
        self._ratio, self._offset = ratio, offset
        # All that decides the expressions, and nothing else: equal models share one function in C.
        literals = [table[0][~differs].tobytes(), differs.tobytes(), repr(shape).encode()]
        literals += [x.tobytes() for x in (ratio, offset) if x is not None]
        self.fingerprint = hashlib.sha256(b"".join(literals)).hexdigest()
        self.digest = self.fingerprint[:8]
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
        q, v, a = self._all(q), self._rates(v), self._rates(a)
        zero: Expressions = np.zeros(3, dtype=object)
        # Of each body, in its own axes: angular velocity, its derivative, acceleration of the origin (gravity
        # is one upwards), and the matrix that makes a point's acceleration of its position.
        states: list[tuple[Expressions, ...]] = []
        places = [self._placement(i, q[i]) for i in range(len(self._bodies))]
        for i, body in enumerate(self._bodies):
            axis = self._numbers[i][:3]
            rotation, position = places[i]
            if body.parent < 0:
                w, dw, at = zero, zero, rotation.T @ (-self._gravity if weight else zero)
            else:
                w0, dw0, a0, spread0 = states[body.parent]
                w, dw, at = rotation.T @ w0, rotation.T @ dw0, rotation.T @ (a0 + spread0 @ position)
            speed = zero if v is None else axis * v[i]
            gain = zero if a is None else axis * a[i]
            if body.turns:
                dw = dw + gain + _cross(w, speed)
                w = w + speed
            else:
                at = at + gain + 2.0 * _cross(w, speed)
            states.append((w, dw, at, _acceleration_matrix(w, dw)))
        forces = [zero] * len(self._bodies)
        moments = [zero] * len(self._bodies)
        tau: Expressions = np.zeros(len(self._bodies), dtype=object)
        for i in reversed(range(len(self._bodies))):
            body = self._bodies[i]
            axis, _, _, mass, first, second, armature = self._split(i)
            w, dw, at, spread = states[i]
            force = forces[i] + mass * at + spread @ first
            moment = moments[i] + second @ dw + _cross(w, second @ w) + _cross(first, at)
            tau[i] = axis @ (moment if body.turns else force)
            if a is not None:
                tau[i] = tau[i] + armature * a[i]
            if body.parent >= 0:
                rotation, position = places[i]
                force, moment = rotation @ force, rotation @ moment
                forces[body.parent] = forces[body.parent] + force
                moments[body.parent] = moments[body.parent] + moment + _cross(position, force)
        return tau if self._ratio is None else self._ratio.T @ tau

    def mass_matrix(self, q: Expressions) -> Expressions:
        """Return D(q), shape (n, n), in the way that takes fewer operations here."""
        if self._way is not None:
            return self._way(q)
        # Which that is depends on the arm, so both are made and counted.
        below = np.tril_indices(self.n)
        ways = [(way, way(q)) for way in (self._composite, self._jacobian)]
        self._way, matrix = min(ways, key=lambda found: int(ca.n_nodes(_vector(found[1][below]))))
        return matrix

    def _jacobian(self, q: Expressions) -> Expressions:
        """Return D(q) as the Jacobian of the inverse dynamics in the accelerations."""
        a = ca.SX.sym("a", self.n)
        matrix = ca.jacobian(_vector(self.inverse(q, None, scalars(a), weight=False)), a)
        found: Expressions = np.empty((self.n, self.n), dtype=object)
        for i, j in np.ndindex(self.n, self.n):
            found[i, j] = Scalar(matrix[i, j])
        return found

    def _composite(self, q: Expressions) -> Expressions:
        """Return D(q) by composite rigid bodies (Featherstone 2008, ch. 6)."""
        q, count = self._all(q), len(self._bodies)
        places = [self._placement(i, q[i]) for i in range(count)]
        split = [self._split(i) for i in range(count)]
        masses, firsts, seconds = ([numbers[k] for numbers in split] for k in (3, 4, 5))
        matrix: Expressions = np.zeros((count, count), dtype=object)
        for i in reversed(range(count)):
            body = self._bodies[i]
            axis, *_, armature = self._split(i)
            # What it takes to accelerate the joint by one, with all that hangs on it.
            if body.turns:
                force, moment = _cross(axis, firsts[i]), seconds[i] @ axis
                matrix[i, i] = axis @ moment + armature
            else:
                force, moment = masses[i] * axis, _cross(firsts[i], axis)
                matrix[i, i] = axis @ force + armature
            j, parent = i, body.parent
            while parent >= 0:
                rotation, position = places[j]
                force, moment = rotation @ force, rotation @ moment
                moment = moment + _cross(position, force)
                along = self._numbers[parent][:3]
                matrix[i, parent] = along @ (moment if self._bodies[parent].turns else force)
                matrix[parent, i] = matrix[i, parent]
                j, parent = parent, self._bodies[parent].parent
            if (parent := body.parent) >= 0:
                rotation, position = places[i]
                first = rotation @ firsts[i]
                masses[parent] = masses[parent] + masses[i]
                firsts[parent] = firsts[parent] + first + masses[i] * position
                shift = _outer(position, first) + _outer(first + masses[i] * position, position)
                turned = self._rotate_tensor(i, q[i], seconds[i])
                seconds[parent] = seconds[parent] + turned + np.eye(3) * np.trace(shift) - shift
        if self._ratio is None:
            return matrix
        return self._ratio.T @ matrix @ self._ratio

    def forward(self, q: Expressions, v: Expressions, tau: Expressions) -> Expressions:
        """Return D(q)^-1 (tau - C(q, v) v - G(q))."""
        return solve(self.mass_matrix(q), tau - self.inverse(q, v, None, weight=True))

    def solve_inertia(self, q: Expressions, tau: Expressions) -> Expressions:
        """Return D(q)^-1 tau."""
        return solve(self.mass_matrix(q), tau, bounded=True)

    def _all(self, q: Expressions) -> Expressions:
        """Return the positions of all bodies' joints."""
        return q if self._ratio is None else self._offset + self._ratio @ q

    def _rates(self, x: Expressions | None) -> Expressions | None:
        """Return velocities or accelerations of all bodies' joints."""
        return x if x is None or self._ratio is None else self._ratio @ x

    def _placement(self, i: int, q: Any) -> tuple[Expressions, Expressions]:
        """Return rotation and position of a body in its parent."""
        axis, rotation, position, *_ = self._split(i)
        if self._bodies[i].turns:
            return rotation @ _rotation(axis, q), position
        return rotation, position + rotation @ axis * q

    def _rotate_tensor(self, i: int, q: Any, tensor: Expressions) -> Expressions:
        """Return a symmetric tensor of a body's axes in its parent's."""
        axis, rotation, *_ = self._split(i)
        if self._bodies[i].turns:
            along = [k for k in range(3) if not isinstance(axis[k], Scalar) and abs(axis[k]) == 1.0]
            if along:
                tensor = _turned_about(along[0], float(axis[along[0]]), q, tensor)
            else:
                rotation = rotation @ _rotation(axis, q)
        half = rotation @ tensor
        turned: Expressions = np.empty((3, 3), dtype=object)
        for r, c in zip(*np.tril_indices(3), strict=True):  # it is symmetric
            turned[r, c] = turned[c, r] = half[r] @ rotation[c]
        return turned

    def _split(self, i: int) -> tuple[Any, ...]:
        """Return axis, rotation, position, mass, mass times centre, inertia and armature of a body."""
        x = self._numbers[i]
        xx, xy, yy, xz, yz, zz = x[19:25]
        second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=object)
        return x[:3], x[3:12].reshape(3, 3), x[12:15], x[15], x[16:19], second, x[25]


def _rotation(axis: Expressions, angle: Any) -> Expressions:
    """Return the rotation matrix about an axis of length one (Rodrigues)."""
    s, c = Scalar(ca.sin(angle.sx)), Scalar(ca.cos(angle.sx))
    x, y, z = axis
    along = _outer(axis, axis)
    skew: Expressions = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], dtype=object)
    return (np.eye(3) - along) * c + skew * s + along


def _turned_about(k: int, sign: float, angle: Any, tensor: Expressions) -> Expressions:
    """Return a symmetric tensor turned about a coordinate axis, in half the operations of R tensor R'."""
    x, y, z = (k + 1) % 3, (k + 2) % 3, k
    s, c = sign * Scalar(ca.sin(angle.sx)), Scalar(ca.cos(angle.sx))
    across, between, sine2 = tensor[x, x] - tensor[y, y], tensor[x, y], s * s
    both = s * c
    moved = sine2 * across + 2.0 * both * between
    turned: Expressions = np.empty((3, 3), dtype=object)
    turned[x, x] = tensor[x, x] - moved
    turned[y, y] = tensor[y, y] + moved
    turned[z, z] = tensor[z, z]
    turned[x, y] = turned[y, x] = both * across + (1.0 - 2.0 * sine2) * between
    turned[x, z] = turned[z, x] = c * tensor[x, z] - s * tensor[y, z]
    turned[y, z] = turned[z, y] = s * tensor[x, z] + c * tensor[y, z]
    return turned


def _outer(a: Expressions, b: Expressions) -> Expressions:
    """Return the products of the entries of two vectors, shape (3, 3)."""
    return a[:, None] * b[None, :]


def _acceleration_matrix(w: Expressions, dw: Expressions) -> Expressions:
    """Return [dw]x + [w]x [w]x: what makes of a point's position its acceleration about the origin."""
    x, y, z = w
    xx, yy, zz = x * x, y * y, z * z
    return np.array(
        [
            [-(yy + zz), x * y - dw[2], x * z + dw[1]],
            [x * y + dw[2], -(xx + zz), y * z - dw[0]],
            [x * z - dw[1], y * z + dw[0], -(xx + yy)],
        ],
        dtype=object,
    )


def _cross(a: Expressions, b: Expressions) -> Expressions:
    """Return the cross product; NumPy's own does not know expressions."""
    product: Expressions = np.empty(3, dtype=object)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[i] = a[j] * b[k] - a[k] * b[j]
    return product


def _vector(x: Expressions) -> Any:
    """Return expressions as a CasADi vector."""
    return ca.SX(ca.vertcat(*(value.sx if isinstance(value, Scalar) else value for value in x)))


def scalars(x: Any) -> Expressions:
    """Return the entries of a CasADi vector as an array."""
    return np.array([Scalar(x[i]) for i in range(x.numel())], dtype=object)


def _snap(x: Array) -> Array:
    """Return entries of axes and rotations without the rounding of 0, 1 and -1."""
    nearest = np.rint(x)
    return np.where(np.abs(x - nearest) < _ROUNDING, nearest, x)
