"""Frames, points, bodies and Kane's method of SymPy's mechanics, drawn as a graph (:mod:`.graph`).

A vector is a sum of components along the axes of frames. What is not here raises, and the real SymPy is used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from armgpi.validation import graph
from armgpi.validation.graph import Expression, Matrix, _constant, _expression, _later, _node, _now, _rate


class Vector:
    """A vector: frame -> components along its axes."""

    def __init__(self, parts: Mapping[Frame, Sequence[Any]]) -> None:
        """Take the components."""
        self.parts = {frame: tuple(map(_expression, xyz)) for frame, xyz in parts.items()}

    def _each(self, change: Callable[[Expression], Any]) -> Vector:
        return Vector({frame: [change(x) for x in xyz] for frame, xyz in self.parts.items()})

    def __add__(self, other: Any) -> Vector:
        """Return a sum; 0 adds nothing."""
        found = dict(self.parts)
        for frame, xyz in _vector(other).parts.items():
            own = found.get(frame)
            found[frame] = xyz if own is None else tuple(a + b for a, b in zip(own, xyz, strict=True))
        return Vector(found)

    __radd__ = __add__

    def __mul__(self, factor: Any) -> Vector:
        """Return a multiple."""
        return self._each(lambda x: x * factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> Vector:
        """Return a fraction."""
        return self._each(lambda x: x / divisor)

    def __neg__(self) -> Vector:
        """Return the negative."""
        return self * -1.0

    def __sub__(self, other: Any) -> Vector:
        """Return a difference."""
        return self + _vector(other) * -1.0

    def __rsub__(self, other: Any) -> Vector:
        """Return a difference."""
        return _vector(other) - self

    def in_root(self) -> list[Expression]:
        """Return the components along the axes of the frame that carries all others."""
        found = [_constant(0.0)] * 3
        for frame, xyz in self.parts.items():
            R = frame.rotation()
            found = [sum((R[i][j] * xyz[j] for j in range(3)), found[i]) for i in range(3)]
        return found

    def dot(self, other: Any) -> Expression:
        """Return the inner product."""
        pairs = zip(self.in_root(), _vector(other).in_root(), strict=True)
        return sum((a * b for a, b in pairs), _constant(0.0))

    def cross(self, other: Any) -> Vector:
        """Return the cross product."""
        (a, b, c), (x, y, z) = self.in_root(), _vector(other).in_root()
        return Vector({self._root(): (b * z - c * y, c * x - a * z, a * y - b * x)})

    __and__, __xor__ = dot, cross

    def _root(self) -> Frame:
        return next(iter(self.parts)).root() if self.parts else Frame("root")

    def dt(self, frame: Frame) -> Vector:
        """Return the derivative by time in the frame that carries all others."""
        if frame.parent is not None:
            raise NotImplementedError
        return Vector({frame: [x.diff() for x in self.in_root()]})

    def express(self, frame: Frame, **_: Any) -> Vector:
        """Return the vector along the axes of another frame."""
        return Vector({frame: [self.dot(axis) for axis in (frame.x, frame.y, frame.z)]})

    def to_matrix(self, frame: Frame) -> Matrix:
        """Return the components along the axes of a frame as a column."""
        return Matrix([self.dot(axis) for axis in (frame.x, frame.y, frame.z)])

    def subs(self, *changes: Any, **_: Any) -> Vector:
        """Return the vector with others in place of symbols."""
        return self._each(lambda x: x.subs(*changes))

    def simplify(self) -> Vector:
        """Return the vector itself."""
        return self


class Frame:
    """A frame of reference, turned about an axis of its parent by an angle."""

    def __init__(self, name: str, *_: Any, **__: Any) -> None:
        """Take its name."""
        self.name = name
        self.parent: Frame | None = None
        self._turn: tuple[Any, Sequence[Expression]] | None = None
        self._rates: dict[Frame, Vector] = {}
        self._rotation: list[list[Expression]] | None = None
        self.x, self.y, self.z = (Vector({self: row}) for row in np.eye(3).tolist())

    def orientnew(self, name: str, kind: str, amounts: Any, *_: Any, **__: Any) -> Frame:
        """Return a new frame, turned from this one."""
        found = Frame(name)
        found.orient(self, kind, amounts)
        return found

    def orient(self, parent: Frame, kind: str, amounts: Any, *_: Any) -> None:
        """Turn it from its parent by (angle, axis)."""
        if kind.lower() != "axis":
            raise NotImplementedError
        angle, axis = amounts if isinstance(amounts[1], Vector) else amounts[::-1]
        self.orient_axis(parent, axis, angle)

    def orient_axis(self, parent: Frame, axis: Any, angle: Any) -> None:
        """Turn it from its parent about an axis by an angle."""
        axis, angle = (axis, angle) if isinstance(axis, Vector) else (angle, axis)
        ((frame, xyz),) = axis.parts.items()
        if frame not in (parent, self):
            raise NotImplementedError
        self.parent, self._turn, self._rotation = parent, (angle, xyz), None
        self._rates[parent] = Vector({parent: xyz}) * _later(lambda: _now(_expression(angle).diff()))

    def set_ang_vel(self, other: Frame, rate: Any) -> None:
        """Set its angular velocity in another frame."""
        self._rates[other] = _vector(rate)

    def ang_vel_in(self, other: Frame) -> Vector:
        """Return its angular velocity in another frame."""
        if other is self:
            return Vector({})
        if other in self._rates:
            return self._rates[other]
        if self.parent is None:
            raise NotImplementedError
        return self._rates[self.parent] + self.parent.ang_vel_in(other)

    def ang_acc_in(self, other: Frame) -> Vector:
        """Return its angular acceleration in another frame."""
        return self.ang_vel_in(other).dt(other)

    def root(self) -> Frame:
        """Return the frame that carries all others."""
        return self if self.parent is None else self.parent.root()

    def rotation(self) -> list[list[Expression]]:
        """Return its rotation in the frame that carries all others (3 x 3)."""
        if self._rotation is not None:
            return self._rotation
        eye = [[_constant(float(i == j)) for j in range(3)] for i in range(3)]
        if self.parent is None or self._turn is None:
            return eye
        angle, (x, y, z) = self._turn
        s, c = _node("sin", _expression(angle)), _node("cos", _expression(angle))
        k = [[_constant(0.0), -z, y], [z, _constant(0.0), -x], [-y, x, _constant(0.0)]]
        # Rodrigues: cos I + sin K + (1 - cos) k k'.
        axis = (x, y, z)
        own = [
            [eye[i][j] * c + k[i][j] * s + axis[i] * axis[j] * (1.0 - c) for j in range(3)] for i in range(3)
        ]
        up = self.parent.rotation()
        self._rotation = [
            [sum((up[i][m] * own[m][j] for m in range(3)), _constant(0.0)) for j in range(3)]
            for i in range(3)
        ]
        return self._rotation

    def dcm(self, other: Frame) -> Matrix:
        """Return the matrix of the axes of this frame along those of another."""
        rows = (self.x, self.y, self.z)
        return Matrix([[row.dot(axis) for axis in (other.x, other.y, other.z)] for row in rows])


class Point:
    """A point."""

    def __init__(self, name: str) -> None:
        """Take its name."""
        self.name = name
        self._places: dict[Point, Vector] = {}
        self._velocities: dict[Frame, Vector] = {}

    def locatenew(self, name: str, way: Any) -> Point:
        """Return a new point, some way from this one."""
        found = Point(name)
        found.set_pos(self, way)
        return found

    def set_pos(self, other: Point, way: Any) -> None:
        """Set the way to it from another point."""
        self._places[other] = _vector(way)

    def pos_from(self, other: Point) -> Vector:
        """Return the way to it from another point."""
        if other is self:
            return Vector({})
        if other in self._places:
            return self._places[other]
        if self in other._places:
            return -other._places[self]
        for between, way in self._places.items():
            return between.pos_from(other) + way
        raise NotImplementedError

    def set_vel(self, frame: Frame, velocity: Any) -> None:
        """Set its velocity in a frame."""
        self._velocities[frame] = _vector(velocity)

    def vel(self, frame: Frame) -> Vector:
        """Return its velocity in a frame."""
        if frame not in self._velocities:
            between, way = next(iter(self._places.items()))
            self._velocities[frame] = between.vel(frame) + way.dt(frame)
        return self._velocities[frame]

    def v2pt_theory(self, other: Point, frame: Frame, fixed: Frame) -> Vector:
        """Set its velocity by that of another point that is fixed in the same frame."""
        turning = fixed.ang_vel_in(frame).cross(self.pos_from(other))
        self._velocities[frame] = other.vel(frame) + turning
        return self._velocities[frame]

    def acc(self, frame: Frame) -> Vector:
        """Return its acceleration in a frame."""
        return self.vel(frame).dt(frame)

    def a2pt_theory(self, other: Point, frame: Frame, fixed: Frame) -> Vector:
        """Return its acceleration: Kane's method here derives the velocities."""
        return self.acc(frame)


class Particle:
    """A point with a mass."""

    def __init__(self, name: str, point: Point, mass: Any) -> None:
        """Take the point and the mass."""
        self.name, self.masscenter, self.mass = name, point, _expression(mass)
        self.potential_energy: Any = 0.0

    def rotational(self) -> tuple[Frame, list[list[Expression]]] | None:
        """Return its frame, and its inertia in the frame that carries all others; None without such."""
        return None


class RigidBody(Particle):
    """A rigid body; its inertia is given as a dyadic about its centre of mass."""

    def __init__(self, name: str, point: Point, frame: Frame, mass: Any, inertia: Any) -> None:
        """Take its centre of mass, frame, mass and inertia."""
        super().__init__(name, point, mass)
        self.frame, (self.inertia, about) = frame, inertia
        if about is not point:
            raise NotImplementedError

    def rotational(self) -> tuple[Frame, list[list[Expression]]] | None:
        """Return its frame, and its inertia in the frame that carries all others."""
        frame, tensor = self.inertia
        R = frame.rotation()
        turned = [
            [
                sum((R[i][a] * tensor[a][b] * R[j][b] for a in range(3) for b in range(3)), _constant(0.0))
                for j in range(3)
            ]
            for i in range(3)
        ]
        return self.frame, turned


def inertia(
    frame: Frame, xx: Any, yy: Any, zz: Any, xy: Any = 0.0, yz: Any = 0.0, zx: Any = 0.0
) -> tuple[Frame, list[list[Expression]]]:
    """Return an inertia dyadic: its frame and its tensor there."""
    rows = ((xx, xy, zx), (xy, yy, yz), (zx, yz, zz))
    return frame, [[_expression(x) for x in row] for row in rows]


class Kane:
    """Kane's equations of independent coordinates, without constraints."""

    def __init__(self, frame: Frame, q_ind: Any, u_ind: Any, kd_eqs: Any = None, **given: Any) -> None:
        """Take the frame, coordinates, speeds and what the speeds are."""
        if frame.parent is not None or any(x is not None for x in given.values()) or kd_eqs is None:
            raise NotImplementedError
        self._frame = frame
        self._q, self._u = ([_now(x) for x in _list(each)] for each in (q_ind, u_ind))
        rates = [_rate(x) for x in self._q]
        zero = dict.fromkeys((x.name for x in rates), _constant(0.0))
        #: Velocities by their identity, each with its components in the speeds.
        self._in_speeds: dict[int, tuple[Vector, list[Expression]]] = {}
        #: Rate of a coordinate, by its name -> what it is of the speeds.
        self._rates: dict[str, Expression] = {}
        for rate, equation in zip(rates, _list(kd_eqs), strict=True):
            slope = equation.diff(rate)
            self._rates[rate.name] = -equation.subs(zero) / slope
            if _now(slope).op != "constant":
                raise NotImplementedError

    def kanes_equations(self, bodies: Any, loads: Any = None) -> tuple[Matrix, Matrix]:
        """Form the equations."""
        bodies, loads = (list(x or ()) for x in (bodies, loads))
        if bodies and isinstance(bodies[0], tuple):
            bodies, loads = loads, bodies  # the order of older versions
        n = len(self._u)
        mass = [[_constant(0.0)] * n for _ in range(n)]
        rest = [_constant(0.0)] * n
        for body in bodies:
            velocity = self._of_speeds(body.masscenter.vel(self._frame))
            self._add(mass, rest, velocity, partial(_scaled, body.mass), None)
            if (rotational := body.rotational()) is not None:
                frame, tensor = rotational
                turning = self._of_speeds(frame.ang_vel_in(self._frame))
                self._add(mass, rest, turning, partial(_times, tensor), turning)
        for on, load in loads:
            moved = on.vel(self._frame) if isinstance(on, Point) else on.ang_vel_in(self._frame)
            force = _vector(load).in_root()
            for r, row in enumerate(self._partials(self._of_speeds(moved))):
                rest[r] = rest[r] + _dot(row, force)
        self.mass_matrix, self.forcing = Matrix(mass), Matrix(rest)
        return self.forcing, self.forcing

    def drawn_equations(self) -> tuple[Matrix, Matrix, list[Expression], list[Expression]]:
        """Return M, the forcing, the coordinates and the speeds."""
        return self.mass_matrix, self.forcing, self._q, self._u

    def _add(
        self,
        mass: list[list[Expression]],
        rest: list[Expression],
        velocity: list[Expression],
        momentum: Callable[[Any], list[Expression]],
        turning: list[Expression] | None,
    ) -> None:
        """Add what a body's motion, or its rotation, adds to the equations."""
        partials = self._partials(velocity)
        still = dict.fromkeys((_rate(u).name for u in self._u), _constant(0.0))
        # The rest of the acceleration: what is left where the speeds do not change.
        acceleration = _substituted([x.diff() for x in velocity], {**self._rates, **still})
        force = momentum(acceleration)
        if turning is not None:
            (a, b, c), (x, y, z) = turning, momentum(turning)
            gyration = (b * z - c * y, c * x - a * z, a * y - b * x)
            force = [one + two for one, two in zip(force, gyration, strict=True)]
        for r, row in enumerate(partials):
            rest[r] = rest[r] - _dot(row, force)
            for s, column in enumerate(partials):
                mass[r][s] = mass[r][s] + _dot(row, momentum(column))

    def _of_speeds(self, vector: Vector) -> list[Expression]:
        """Return a velocity's components in the speeds, formed once for a point's body and load."""
        if id(vector) not in self._in_speeds:
            self._in_speeds[id(vector)] = vector, _substituted(vector.in_root(), self._rates)
        return self._in_speeds[id(vector)][1]

    def _partials(self, velocity: list[Expression]) -> list[list[Expression]]:
        return [[x.diff(u) for x in velocity] for u in self._u]


def lagrangian(frame: Frame, *bodies: Any) -> Expression:
    """Return the kinetic less the potential energy of bodies."""
    found = _constant(0.0)
    for body in bodies:
        velocity = body.masscenter.vel(frame).in_root()
        found = found + 0.5 * body.mass * _dot(velocity, velocity) - _expression(body.potential_energy)
        if (rotational := body.rotational()) is not None:
            turning = rotational[0].ang_vel_in(frame).in_root()
            found = found + 0.5 * _dot(turning, _times(rotational[1], turning))
    return found


def _list(values: Any) -> list[Any]:
    return list(np.ravel(np.asarray(values, dtype=object)))


def _dot(one: Sequence[Expression], other: Sequence[Expression]) -> Expression:
    return sum((a * b for a, b in zip(one, other, strict=True)), _constant(0.0))


def _times(matrix: Sequence[Sequence[Expression]], x: Sequence[Expression]) -> list[Expression]:
    return [_dot(row, x) for row in matrix]


def _substituted(x: Sequence[Expression], swap: Mapping[str, Expression]) -> list[Expression]:
    """Return expressions with others in place of symbols; what they share stays shared."""
    return list(np.ravel(Matrix(list(x)).subs(swap)).view(np.ndarray))


def _scaled(factor: Expression, x: Sequence[Expression]) -> list[Expression]:
    return [factor * each for each in x]


def _vector(x: Any) -> Vector:
    """Return a vector; 0 is none."""
    if isinstance(x, Vector):
        return x
    if isinstance(x, int | float | Expression) and float(x) == 0.0:
        return Vector({})
    raise NotImplementedError


#: What is there under the names of SymPy.
NAMES: dict[str, Any] = {
    "ReferenceFrame": Frame,
    "Point": Point,
    "Particle": Particle,
    "RigidBody": RigidBody,
    "inertia": inertia,
    "KanesMethod": Kane,
    "Lagrangian": lagrangian,
    "dot": lambda a, b: a.dot(b),
    "cross": lambda a, b: a.cross(b),
    "msubs": lambda x, *swaps, **__: x.subs({k: v for swap in swaps for k, v in swap.items()}),
    **dict.fromkeys(("mechanics_printing", "init_vprinting"), lambda *_, **__: None),
}


def install() -> Callable[[], None]:
    """Put graphs in the place of SymPy and CasADi, and return what takes them away again."""
    return graph.install(NAMES)
