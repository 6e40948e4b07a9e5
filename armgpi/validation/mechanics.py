"""Frames, points, bodies and Kane's method of SymPy's mechanics, drawn as a graph (:mod:`.graph`).

A vector is a sum of components along the axes of frames. What is not here raises, and the real SymPy is used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from armgpi.validation import graph
from armgpi.validation.graph import (
    DrawnEquations,
    Expression,
    Matrix,
    _constant,
    _expression,
    _later,
    _node,
    _now,
    _rate,
)

#: Rows of expressions (3 x 3).
Tensor = list[list[Expression]]


class Vector:
    """A vector: frame -> components along its axes."""

    def __init__(self, components: Mapping[Frame, Sequence[Any]]) -> None:
        """Take the components."""
        self.components: dict[Frame, tuple[Expression, ...]] = {}
        for frame, xyz in components.items():
            self.components[frame] = tuple(map(_expression, xyz))

    def _each(self, change: Callable[[Expression], Any]) -> Vector:
        changed: dict[Frame, list[Any]] = {}
        for frame, xyz in self.components.items():
            changed[frame] = [change(x) for x in xyz]
        return Vector(changed)

    def __add__(self, other: Any) -> Vector:
        """Return a sum; 0 adds nothing."""
        total = dict(self.components)
        for frame, xyz in _vector(other).components.items():
            total[frame] = tuple(_plus(total[frame], xyz)) if frame in total else xyz
        return Vector(total)

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
        total = [_constant(0.0)] * 3
        for frame, xyz in self.components.items():
            rows = frame.rotation()
            total = [_dot(row, xyz, before) for row, before in zip(rows, total, strict=True)]
        return total

    def dot(self, other: Any) -> Expression:
        """Return the inner product."""
        return _dot(self.in_root(), _vector(other).in_root())

    def cross(self, other: Any) -> Vector:
        """Return the cross product."""
        return Vector({self._root(): _cross(self.in_root(), _vector(other).in_root())})

    __and__, __xor__ = dot, cross

    def _root(self) -> Frame:
        for frame in self.components:
            return frame.root()
        return Frame("root")

    def dt(self, frame: Frame) -> Vector:
        """Return the derivative by time in the frame that carries all others."""
        if frame.parent is not None:
            raise NotImplementedError
        rates = [x.diff() for x in self.in_root()]
        return Vector({frame: rates})

    def express(self, frame: Frame, **_: Any) -> Vector:
        """Return the vector along the axes of another frame."""
        return Vector({frame: [self.dot(axis) for axis in frame.axes()]})

    def to_matrix(self, frame: Frame) -> Matrix:
        """Return the components along the axes of a frame as a column."""
        return Matrix([self.dot(axis) for axis in frame.axes()])

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
        self._rotation: Tensor | None = None
        self.x = Vector({self: (1.0, 0.0, 0.0)})
        self.y = Vector({self: (0.0, 1.0, 0.0)})
        self.z = Vector({self: (0.0, 0.0, 1.0)})

    def axes(self) -> tuple[Vector, Vector, Vector]:
        """Return its axes."""
        return self.x, self.y, self.z

    def orientnew(self, name: str, kind: str, amounts: Any, *_: Any, **__: Any) -> Frame:
        """Return a new frame, turned from this one."""
        frame = Frame(name)
        frame.orient(self, kind, amounts)
        return frame

    def orient(self, parent: Frame, kind: str, amounts: Any, *_: Any) -> None:
        """Turn it from its parent by (angle, axis)."""
        if kind.lower() != "axis":
            raise NotImplementedError
        angle, axis = amounts
        self.orient_axis(parent, axis, angle)

    def orient_axis(self, parent: Frame, axis: Any, angle: Any) -> None:
        """Turn it from its parent about an axis by an angle."""
        if not isinstance(axis, Vector):  # SymPy takes both orders
            axis, angle = angle, axis
        ((frame, xyz),) = axis.components.items()
        if frame not in (parent, self):
            raise NotImplementedError
        self.parent = parent
        self._turn = (angle, xyz)
        self._rotation = None
        rate = _later(lambda: _now(_expression(angle).diff()))
        self._rates[parent] = Vector({parent: xyz}) * rate

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

    def rotation(self) -> Tensor:
        """Return its rotation in the frame that carries all others (3 x 3)."""
        if self._rotation is None:
            if self.parent is None or self._turn is None:
                return _eye()
            self._rotation = _product(self.parent.rotation(), _rodrigues(*self._turn))
        return self._rotation

    def dcm(self, other: Frame) -> Matrix:
        """Return the matrix of the axes of this frame along those of another."""
        return Matrix([[row.dot(axis) for axis in other.axes()] for row in self.axes()])


class Point:
    """A point."""

    def __init__(self, name: str) -> None:
        """Take its name."""
        self.name = name
        self._places: dict[Point, Vector] = {}
        self._velocities: dict[Frame, Vector] = {}

    def locatenew(self, name: str, way: Any) -> Point:
        """Return a new point, some way from this one."""
        point = Point(name)
        point.set_pos(self, way)
        return point

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

    def rotational(self) -> tuple[Frame, Tensor] | None:
        """Return its frame, and its inertia in the frame that carries all others; None without such."""
        return None


class RigidBody(Particle):
    """A rigid body; its inertia is given as a dyadic about its centre of mass."""

    def __init__(
        self,
        name: str,
        point: Point,
        frame: Frame,
        mass: Any,
        inertia: tuple[tuple[Frame, Tensor], Point],
    ) -> None:
        """Take its centre of mass, frame, mass and inertia."""
        super().__init__(name, point, mass)
        self.frame = frame
        self.inertia, about = inertia
        if about is not point:
            raise NotImplementedError

    def rotational(self) -> tuple[Frame, Tensor] | None:
        """Return its frame, and its inertia in the frame that carries all others."""
        frame, tensor = self.inertia
        R = frame.rotation()
        turned = [[_turned_entry(row, tensor, other_row) for other_row in R] for row in R]
        return self.frame, turned


def inertia(
    frame: Frame,
    xx: Any,
    yy: Any,
    zz: Any,
    xy: Any = 0.0,
    yz: Any = 0.0,
    zx: Any = 0.0,
) -> tuple[Frame, Tensor]:
    """Return an inertia dyadic: its frame and its tensor there."""
    rows = (
        (xx, xy, zx),
        (xy, yy, yz),
        (zx, yz, zz),
    )
    return frame, [[_expression(x) for x in row] for row in rows]


class Kane:
    """Kane's equations of independent coordinates, without constraints."""

    def __init__(
        self,
        frame: Frame,
        q_ind: Any,
        u_ind: Any,
        kd_eqs: Any = None,
        **given: Any,
    ) -> None:
        """Take the frame, coordinates, speeds and what the speeds are."""
        has_constraints = any(x is not None for x in given.values())
        if frame.parent is not None or has_constraints or kd_eqs is None:
            raise NotImplementedError
        self._frame = frame
        self._q = [_now(x) for x in _list(q_ind)]
        self._u = [_now(x) for x in _list(u_ind)]
        rates = [_rate(x) for x in self._q]
        zero = dict.fromkeys([rate.name for rate in rates], _constant(0.0))
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
        bodies = list(bodies or ())
        loads = list(loads or ())
        if bodies and isinstance(bodies[0], tuple):
            bodies, loads = loads, bodies  # the order of older versions
        n = len(self._u)
        mass = [[_constant(0.0)] * n for _ in range(n)]
        forcing = [_constant(0.0)] * n
        for body in bodies:
            velocity = self._of_speeds(body.masscenter.vel(self._frame))
            self._add(mass, forcing, velocity, partial(_scaled, body.mass), None)
            if (rotational := body.rotational()) is not None:
                frame, tensor = rotational
                turning = self._of_speeds(frame.ang_vel_in(self._frame))
                self._add(mass, forcing, turning, partial(_times, tensor), turning)
        for on, load in loads:
            if isinstance(on, Point):
                velocity = self._of_speeds(on.vel(self._frame))
            else:
                velocity = self._of_speeds(on.ang_vel_in(self._frame))
            force = _vector(load).in_root()
            for r, row in enumerate(self._partials(velocity)):
                forcing[r] = forcing[r] + _dot(row, force)
        self.mass_matrix = Matrix(mass)
        self.forcing = Matrix(forcing)
        return self.forcing, self.forcing

    def drawn_equations(self) -> DrawnEquations:
        """Return M, the forcing, the coordinates and the speeds."""
        return DrawnEquations(self.mass_matrix, self.forcing, self._q, self._u)

    def _add(
        self,
        mass: Tensor,
        forcing: list[Expression],
        velocity: list[Expression],
        momentum: Callable[[Any], list[Expression]],
        turning: list[Expression] | None,
    ) -> None:
        """Add what a body's motion, or its rotation, adds to the equations."""
        partials = self._partials(velocity)
        constant_speeds = dict.fromkeys([_rate(u).name for u in self._u], _constant(0.0))
        # What is left of the acceleration where the speeds do not change.
        rates = [x.diff() for x in velocity]
        acceleration = _substituted(rates, {**self._rates, **constant_speeds})
        force = momentum(acceleration)
        if turning is not None:
            force = _plus(force, _cross(turning, momentum(turning)))
        for r, row in enumerate(partials):
            forcing[r] = forcing[r] - _dot(row, force)
            for s, column in enumerate(partials):
                mass[r][s] = mass[r][s] + _dot(row, momentum(column))

    def _of_speeds(self, vector: Vector) -> list[Expression]:
        """Return a velocity's components in the speeds, formed once for a point's body and load."""
        if id(vector) not in self._in_speeds:
            in_speeds = _substituted(vector.in_root(), self._rates)
            self._in_speeds[id(vector)] = vector, in_speeds
        return self._in_speeds[id(vector)][1]

    def _partials(self, velocity: list[Expression]) -> list[list[Expression]]:
        """Return the derivatives of a velocity by the speeds."""
        return [[x.diff(u) for x in velocity] for u in self._u]


def lagrangian(frame: Frame, *bodies: Any) -> Expression:
    """Return the kinetic less the potential energy of bodies."""
    energy = _constant(0.0)
    for body in bodies:
        velocity = body.masscenter.vel(frame).in_root()
        kinetic = 0.5 * body.mass * _dot(velocity, velocity)
        energy = energy + kinetic - _expression(body.potential_energy)
        if (rotational := body.rotational()) is not None:
            body_frame, tensor = rotational
            turning = body_frame.ang_vel_in(frame).in_root()
            energy = energy + 0.5 * _dot(turning, _times(tensor, turning))
    return energy


def _list(values: Any) -> list[Any]:
    return list(np.ravel(np.asarray(values, dtype=object)))


def _dot(a: Sequence[Expression], b: Sequence[Expression], before: Expression | None = None) -> Expression:
    """Return the inner product, added to what is there before."""
    total = _constant(0.0) if before is None else before
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


def _plus(a: Sequence[Expression], b: Sequence[Expression]) -> list[Expression]:
    return [x + y for x, y in zip(a, b, strict=True)]


def _cross(a: Sequence[Expression], b: Sequence[Expression]) -> list[Expression]:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def _times(matrix: Tensor, x: Sequence[Expression]) -> list[Expression]:
    return [_dot(row, x) for row in matrix]


def _product(A: Tensor, B: Tensor) -> Tensor:
    columns = list(zip(*B, strict=True))
    return [[_dot(row, column) for column in columns] for row in A]


def _eye() -> Tensor:
    return [[_constant(float(i == j)) for j in range(3)] for i in range(3)]


def _rodrigues(angle: Any, axis: Sequence[Expression]) -> Tensor:
    """Return the rotation about an axis k of length one: cos I + sin K + (1 - cos) k k'."""
    s = _node("sin", _expression(angle))
    c = _node("cos", _expression(angle))
    x, y, z = axis
    zero = _constant(0.0)
    eye = _eye()
    K = [
        [zero, -z, y],
        [z, zero, -x],
        [-y, x, zero],
    ]
    rotation = _eye()
    for i in range(3):
        for j in range(3):
            outer = axis[i] * axis[j] * (1.0 - c)
            rotation[i][j] = eye[i][j] * c + K[i][j] * s + outer
    return rotation


def _turned_entry(row: Sequence[Expression], tensor: Tensor, other_row: Sequence[Expression]) -> Expression:
    """Return an entry of R I R': of two rows of R."""
    total = _constant(0.0)
    for a in range(3):
        for b in range(3):
            total = total + row[a] * tensor[a][b] * other_row[b]
    return total


def _substituted(x: Sequence[Expression], swap: Mapping[str, Expression]) -> list[Expression]:
    """Return expressions with others in place of symbols; what they share stays shared."""
    return list(np.ravel(Matrix(list(x)).subs(swap)).view(np.ndarray))


def _scaled(factor: Expression, x: Sequence[Expression]) -> list[Expression]:
    return [factor * component for component in x]


def _msubs(value: Any, *swaps: Mapping[Any, Any], **_: Any) -> Any:
    """Return an expression, a vector or a matrix with others in place of symbols."""
    merged: dict[Any, Any] = {}
    for swap in swaps:
        merged |= swap
    return value.subs(merged)


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
    "msubs": _msubs,
    "mechanics_printing": lambda *_, **__: None,
    "init_vprinting": lambda *_, **__: None,
}


def install() -> Callable[[], None]:
    """Put graphs in the place of SymPy and CasADi, and return what takes them away again."""
    return graph.install(NAMES)
