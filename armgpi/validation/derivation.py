"""Closed-form equations of motion of a short arm, by SymPy from its URDF.

The composite-rigid-body algorithm (Featherstone 2008, ch. 6) with symbols: from the tip to the base, mass,
first moment and inertia of all that moves with a joint are put together in that joint's frame. C is the
matrix of the Christoffel symbols, G the slope of the potential energy.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, check_type
from armgpi.base.escape import latex_text
from armgpi.base.hints import with_keyword_hints
from armgpi.errors import MissingPackage, ParameterError, Remedy
from armgpi.robot.robot import Robot
from armgpi.validation.tree import Tree, from_robot
from armgpi.validation.trig import Trig

#: Longer arms have formulas that nobody reads, and take minutes.
MOST_JOINTS = 4
#: Numbers below this are rounding, relative to the others of their kind.
_ROUNDING = 1e-13
_XYZ = "xyz"

Vector = list[Trig]
Matrix = list[list[Trig]]
#: Name of a number of the arm; None for a zero.
Name = str | None


class _Numbers(NamedTuple):
    """Names of the numbers of a body and of the joint that carries it.

    Attributes:
        mass: of its mass.
        com: of the coordinates of its centre of mass.
        inertia: of the entries of its inertia about that.
        length: of the coordinates of the joint's origin.
        rotor: of the rotor's inertia at the joint.
    """

    mass: Name
    com: list[Name]
    inertia: list[list[Name]]
    length: list[Name]
    rotor: Name


class _Moments(NamedTuple):
    """Mass, first moment and inertia about the origin of a frame."""

    mass: Trig
    first: Vector
    inertia: Matrix

    def __add__(self, other: _Moments) -> _Moments:  # type: ignore[override]
        """Return the moments of two bodies together."""
        first = _plus(self.first, other.first)
        return _Moments(self.mass + other.mass, first, _sum(self.inertia, other.inertia))


@dataclass(frozen=True)
class Derivation:
    """The equations of motion D(q) a + C(q, v) v + G(q) = tau in symbols.

    Attributes:
        robot: name of the robot.
        joint_names: names of its joints: q1 is the first one's position, and so on.
        q: symbols of the positions.
        v: symbols of the velocities.
        D: inertia matrix, a SymPy matrix.
        C: Coriolis matrix of the Christoffel symbols.
        G: gravity torque, a column.
        V: potential energy.
        position: position of the tool, a column.
        parameters: value of every other symbol, by name.
    """

    robot: str
    joint_names: tuple[str, ...]
    q: tuple[Any, ...]
    v: tuple[Any, ...]
    D: Any
    C: Any
    G: Any
    V: Any
    position: Any
    parameters: dict[str, float]

    def latex(self) -> str:
        """Return the equations as LaTeX: an `align*` and a table of the parameters."""
        import sympy

        names = {symbol: rf"\dot q_{{{i + 1}}}" for i, symbol in enumerate(self.v)}
        for name in self.parameters:
            names[sympy.Symbol(name)] = _tex_symbol(name)

        def tex(expression: Any) -> str:
            return str(sympy.latex(expression, symbol_names=names))

        lines = []
        n = len(self.q)
        for i, j in itertools.combinations_with_replacement(range(n), 2):
            lines.append(f"d_{{{i + 1}{j + 1}}} &= {tex(self.D[i, j])}")
        for i, j in itertools.product(range(n), repeat=2):
            lines.append(f"c_{{{i + 1}{j + 1}}} &= {tex(self.C[i, j])}")
        lines += [f"g_{{{i + 1}}} &= {tex(self.G[i])}" for i in range(n)]
        joints = ", ".join(f"$q_{{{i + 1}}}$: {latex_text(name)}" for i, name in enumerate(self.joint_names))
        text = f"% {self.robot}, by armgpi derive\n{joints}\n"
        text += "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}\n"
        if self.parameters:
            rows = [f"${_tex_symbol(name)}$ & {value:.10g}" for name, value in self.parameters.items()]
            text += "\\begin{tabular}{ll}\n" + " \\\\\n".join(rows) + "\n\\end{tabular}\n"
        return text

    def python(self) -> str:
        """Return a Python module with the equations as functions, which `armgpi validate` accepts."""
        joints = ", ".join(f"q{i + 1} {name}" for i, name in enumerate(self.joint_names))
        lines = [
            f'"""Equations of motion of {_plain(self.robot)}, by `armgpi derive`.',
            "",
            "D(q) a + C(q, v) v + G(q) = tau in SI units, C of the Christoffel symbols.",
            f"Joints: {_plain(joints)}.",
            '"""',
            "",
            "from math import cos, sin",
            "",
            "import numpy as np",
            "",
            "parameters = {",
            *(f'    "{name}": {value!r},' for name, value in self.parameters.items()),
            "}",
            "",
        ]
        written = {
            "mass_matrix": ("D(q) [kg m^2], shape (n, n)", self.D, ("q",)),
            "coriolis_matrix": ("C(q, v) [N m s/rad], shape (n, n)", self.C, ("q", "v")),
            "gravity": ("G(q) [N m], shape (n,)", self.G, ("q",)),
            "potential_energy": ("the potential energy [J]", self.V, ("q",)),
            "forward_kinematics": ("the position of the tool [m], shape (3,)", self.position, ("q",)),
        }
        for name, (meaning, expression, arguments) in written.items():
            lines += ["", *self._function(name, meaning, expression, arguments), ""]
        return "\n".join(lines)

    def _function(self, name: str, meaning: str, expression: Any, arguments: Sequence[str]) -> list[str]:
        """Return the lines of one function."""
        import sympy
        from sympy.printing.pycode import pycode

        def code(x: Any) -> str:
            return str(pycode(x, fully_qualified_modules=False))

        # Common subexpressions once: shorter and faster, and still to be read.
        shared, (reduced,) = sympy.cse([expression], symbols=sympy.numbered_symbols("x"))
        lines = [
            f"def {name}({', '.join(arguments)}):",
            f'    """Return {meaning}."""',
        ]
        for letter in arguments:
            entries = ", ".join(f"{letter}{i + 1}" for i in range(len(self.q)))
            comma = "," if len(self.q) == 1 else ""
            lines.append(f"    {entries}{comma} = {letter}")
        used_names = {str(symbol) for symbol in expression.free_symbols}
        used_parameters = sorted(used_names & self.parameters.keys())
        lines += [f'    {parameter} = parameters["{parameter}"]' for parameter in used_parameters]
        lines += [f"    {symbol} = {code(value)}" for symbol, value in shared]
        if name == "potential_energy":
            return [*lines, f"    return {code(reduced)}"]
        if name in ("mass_matrix", "coriolis_matrix"):
            body = [f"            [{', '.join(map(code, row))}]," for row in reduced.tolist()]
        else:
            body = [f"            {code(x)}," for x in reduced]
        return [*lines, "    return np.array(", "        [", *body, "        ]", "    )"]


@with_keyword_hints
def derive(
    robot: Robot | str | PathLike[str], *, numbers: bool = False, frame: str | None = None
) -> Derivation:
    """Derive the equations of motion of an arm of up to four joints in closed form.

    Args:
        robot: the robot, its name or its URDF.
        numbers: put in the values of masses, lengths and inertias, and not symbols for them.
        frame: frame whose position is given; the tip when not given.

    Raises:
        ParameterError: when the robot has more than four joints.
        NameNotFound: when there is no such robot or frame.
        MissingPackage: when SymPy is not installed.
    """
    try:
        import sympy
    except ImportError:
        raise MissingPackage("sympy", "derive") from None
    check_type(numbers, "numbers", bool, "True or False")
    arm = robot if isinstance(robot, Robot) else Robot.load(robot)
    if arm.n > MOST_JOINTS:
        raise ParameterError(
            "robot",
            f"{arm.name} with {arm.n} joints",
            f"an arm of at most {MOST_JOINTS} joints; lock others",
        ).suggesting(Remedy("lock"), Remedy("keep"))
    symbols = _Symbols(from_robot(arm, frame))
    n = arm.n
    v = sympy.symbols(f"v1:{n + 1}")
    inertia = symbols.inertia()
    potential = symbols.potential()

    @cache
    def slope(i: int, j: int, k: int) -> Trig:
        """Return the derivative of D_ij by q_k."""
        return symbols.slope(inertia[i][j], k)

    def expression(x: Trig) -> Any:
        return symbols.expression(x, numbers)

    def coriolis_entry(i: int, j: int) -> Any:
        # C from D's exact derivatives: its harmonics, so nothing is left to simplify.
        total = sympy.S.Zero
        for k in range(n):
            twice_christoffel = slope(i, j, k) + slope(i, k, j) - slope(j, k, i)
            total += expression(twice_christoffel.times(symbols.one / 2)) * v[k]
        return total

    D = sympy.Matrix(n, n, lambda i, j: expression(inertia[i][j]))
    C = sympy.Matrix(n, n, coriolis_entry)
    G = sympy.Matrix([expression(symbols.slope(potential, i)) for i in range(n)])
    V = expression(potential)
    position = sympy.Matrix([expression(x) for x in symbols.position()])
    used_names = {str(symbol) for symbol in sympy.Tuple(D, C, G, V, position).free_symbols}
    return Derivation(
        robot=arm.name,
        joint_names=arm.joint_names,
        q=sympy.symbols(f"q1:{n + 1}"),
        v=v,
        D=D,
        C=C,
        G=G,
        V=V,
        position=position,
        parameters={name: value for name, value in symbols.values.items() if name in used_names},
    )


class _Symbols:
    """An arm with symbols for its numbers, and its composite bodies."""

    def __init__(self, tree: Tree) -> None:
        """Give every number of the arm that is not zero a symbol."""
        import sympy

        self.tree, n = tree, tree.n
        self.values: dict[str, float] = {}
        plan = [self._name_numbers(i) for i in range(n)]
        tool = self._symbols("t", tree.tool_position)
        gravity = self._gravity()
        # Sliding positions are polynomial, so they belong to the coefficients; angles to the harmonics.
        sliding = [f"q{i + 1}" for i in range(n) if tree.prismatic[i]]
        names = [*self.values, *sliding]
        self.ring, *generators = sympy.ring(names, sympy.QQ)
        self._at = dict(zip(names, generators, strict=True))
        self.one = self.ring.one
        self._bodies = [self._body(numbers) for numbers in plan]
        self._lengths = [self._vector(numbers.length) for numbers in plan]
        self._rotors = [self._coefficient(numbers.rotor) for numbers in plan]
        self._tool = self._vector(tool)
        self._down = self._vector(gravity)
        self._turns = [self._rotation(i) for i in range(n)]
        self._shifts = [self._shift(i) for i in range(n)]
        # All that moves with each joint, in its frame.
        self._composites = list(self._bodies)
        for i in reversed(range(n)):
            parent = tree.parents[i]
            if parent >= 0:
                self._composites[parent] = self._composites[parent] + self._moving_body(i)

    def slope(self, x: Trig, i: int) -> Trig:
        """Return the derivative by q_i."""
        sliding = self._at[f"q{i + 1}"] if self.tree.prismatic[i] else None
        return x.derivative(i, sliding)

    def inertia(self) -> Matrix:
        """Return D."""
        n, tree = self.tree.n, self.tree
        zero = Trig({})
        D = [[zero] * n for _ in range(n)]
        for i in range(n):
            mass, first, tensor = self._composites[i]
            axis = self._numbers(tree.axes[i])
            if tree.prismatic[i]:
                force = _scale(axis, mass)
                moment = _cross(first, axis)
            else:
                force = _cross(axis, first)
                moment = _apply(tensor, axis)
            # The force that moves the composite body, carried towards the base (Featherstone, table 6.2).
            j = i
            while j >= 0:
                other = self._numbers(tree.axes[j])
                value = _dot(other, force if tree.prismatic[j] else moment)
                if i == j:
                    value = value + self._constant(self._rotors[i])
                D[i][j] = D[j][i] = value
                force = _apply(self._turns[j], force)
                moment = _apply(self._turns[j], moment)
                moment = _plus(moment, _cross(self._shifts[j], force))
                j = tree.parents[j]
        return D

    def potential(self) -> Trig:
        """Return V = -g . (first moment of everything about the base)."""
        total = [Trig({})] * 3
        for i, parent in enumerate(self.tree.parents):
            if parent < 0:
                total = _plus(total, self._moving_body(i).first)
        return -_dot(self._down, total)

    def position(self) -> Vector:
        """Return where the tool is in the base frame."""
        point, j = self._tool, self.tree.tool_parent
        while j >= 0:
            turned = _apply(self._turns[j], point)
            point = _plus(turned, self._shifts[j])
            j = self.tree.parents[j]
        return point

    def expression(self, x: Trig, numbers: bool) -> Any:
        """Return a sum as a SymPy expression."""
        import sympy

        total = sympy.S.Zero
        functions = {"c": sympy.cos, "s": sympy.sin}
        for key in sorted(x.terms):
            kind, multiples = key
            angle = sum(multiple * sympy.Symbol(f"q{i}") for i, multiple in enumerate(multiples, 1))
            factor = self._number(x.terms[key]) if numbers else self._factor(x.terms[key])
            total += factor * functions[kind](angle)
        return total

    def _factor(self, coefficient: Any) -> Any:
        """Return a coefficient with symbols for the numbers of the arm."""
        import sympy

        factor = coefficient.as_expr()
        # Axes and rotations are made rational to stay exact; 0.7071067811865476 has a long fraction.
        long = [rational for rational in factor.atoms(sympy.Rational) if rational.q > 1000]
        short = {rational: sympy.Float(rational, 17) for rational in long}
        return sympy.factor_terms(factor.xreplace(short))

    def _number(self, coefficient: Any) -> Any:
        """Return a coefficient with the values put in: a polynomial in the sliding positions."""
        import sympy

        names = [str(generator) for generator in self.ring.gens]
        #: Powers of the sliding positions -> the number that they are multiplied by.
        sums: dict[tuple[tuple[str, int], ...], float] = {}
        for powers, factor in coefficient.terms():
            positions = []
            value = float(factor)
            for name, power in zip(names, powers, strict=True):
                value *= self.values.get(name, 1.0) ** power
                if power and name not in self.values:
                    positions.append((name, power))
            key = tuple(positions)
            sums[key] = sums.get(key, 0.0) + value
        total = sympy.S.Zero
        for of_positions, value in sums.items():
            product = sympy.prod(sympy.Symbol(name) ** power for name, power in of_positions)
            total += _short_number(value) * product
        return total

    def _name_numbers(self, i: int) -> _Numbers:
        """Return the names of the numbers of body and joint i."""
        body = self.tree.bodies[i]
        k = i + 1
        return _Numbers(
            mass=self._symbol(f"m{k}", body.mass),
            com=self._symbols(f"c{k}", body.com),
            inertia=self._inertia_symbols(f"I{k}", body.inertia),
            length=self._symbols(f"l{k}", self.tree.positions[i]),
            rotor=self._symbol(f"Ir{k}", float(self.tree.armature[i])),
        )

    def _inertia_symbols(self, name: str, inertia: Array) -> list[list[Name]]:
        size = float(np.abs(inertia).max())
        symbols: list[list[Name]] = [[None] * 3 for _ in range(3)]
        for r, c in itertools.combinations_with_replacement(range(3), 2):
            symbol = self._symbol(f"{name}{_XYZ[r]}{_XYZ[c]}", float(inertia[r, c]), size)
            symbols[r][c] = symbols[c][r] = symbol
        return symbols

    def _symbol(self, name: str, value: float, size: float = 0.0) -> Name:
        """Keep a value under a name, unless it is zero."""
        # What rounding leaves of a zero would drag through every formula.
        if value == 0.0 or abs(value) <= _ROUNDING * size:
            return None
        self.values[name] = float(value)
        return name

    def _symbols(self, name: str, vector: Array) -> list[Name]:
        size = float(np.abs(vector).max())
        coordinates = zip(_XYZ, vector, strict=True)
        return [self._symbol(f"{name}{letter}", float(value), size) for letter, value in coordinates]

    def _gravity(self) -> list[Name]:
        """Return the names of gravity's components; "-g" where it points down."""
        g = self.tree.gravity
        x, y, z = g
        # As in every textbook: g is positive, and the arm hangs along -z.
        if x == 0.0 and y == 0.0 and z < 0.0:
            self.values["g"] = float(-z)
            return [None, None, "-g"]
        return self._symbols("g", g)

    def _coefficient(self, name: Name) -> Any:
        if name is None:
            return self.ring.zero
        if name.startswith("-"):
            return -self._at[name[1:]]
        return self._at[name]

    def _constant(self, coefficient: Any) -> Trig:
        no_angle = (0,) * self.tree.n
        return Trig({("c", no_angle): coefficient})

    def _vector(self, names: Iterable[Name]) -> Vector:
        return [self._constant(self._coefficient(name)) for name in names]

    def _numbers(self, vector: Iterable[float]) -> Vector:
        """Return plain numbers, exact to 15 decimals."""
        return [self._exact_number(x) for x in vector]

    def _exact_number(self, x: float) -> Trig:
        """Return a plain number, exact to 15 decimals."""
        import sympy

        fraction = Fraction(repr(round(float(x), 15)))
        return self._constant(self.ring(sympy.QQ(fraction.numerator, fraction.denominator)))

    def _body(self, numbers: _Numbers) -> _Moments:
        """Return mass, first moment and inertia about the joint of one body."""
        mass = self._constant(self._coefficient(numbers.mass))
        com = self._vector(numbers.com)
        first = _scale(com, mass)
        about_com = [self._vector(row) for row in numbers.inertia]
        return _Moments(mass, first, _sum(about_com, _steiner(com, first)))

    def _rotation(self, i: int) -> Matrix:
        """Return the rotation of joint i's frame in its parent's."""
        fixed = [self._numbers(row) for row in self.tree.rotations[i]]
        if self.tree.prismatic[i]:
            return fixed
        # Rodrigues about the axis a: cos I + (1 - cos) a a' + sin [a].
        x, y, z = a = self.tree.axes[i]
        outer = np.outer(a, a)
        skew = np.array(
            [
                [0.0, -z, y],
                [z, 0.0, -x],
                [-y, x, 0.0],
            ]
        )
        angle = tuple(int(j == i) for j in range(self.tree.n))
        cosine = Trig({("c", angle): self.one})
        sine = Trig({("s", angle): self.one})
        rest_of_one = self._constant(self.one) - cosine
        turn: Matrix = [[Trig({})] * 3 for _ in range(3)]
        for r, c in itertools.product(range(3), repeat=2):
            turn[r][c] = (
                self._exact_number(float(r == c)) * cosine
                + self._exact_number(outer[r, c]) * rest_of_one
                + self._exact_number(skew[r, c]) * sine
            )
        return _product(fixed, turn)

    def _shift(self, i: int) -> Vector:
        """Return the origin of joint i's frame in its parent's."""
        if not self.tree.prismatic[i]:
            return self._lengths[i]
        along = self._numbers(self.tree.rotations[i] @ self.tree.axes[i])
        position = self._constant(self._at[f"q{i + 1}"])
        return _plus(self._lengths[i], _scale(along, position))

    def _moving_body(self, i: int) -> _Moments:
        """Return what moves with joint i, in its parent's frame."""
        mass, first, tensor = self._composites[i]
        R, p = self._turns[i], self._shifts[i]
        turned = _apply(R, first)
        transposed = [list(row) for row in zip(*R, strict=True)]
        inertia = _product(_product(R, tensor), transposed)
        # About the parent's origin: I - [p][h] - [h][p] - m [p][p].
        inertia = _sum(inertia, _steiner(p, turned))
        inertia = _sum(inertia, _steiner(turned, p))
        inertia = _sum(inertia, _steiner(p, _scale(p, mass)))
        return _Moments(mass, _plus(turned, _scale(p, mass)), inertia)


def _short_number(value: float) -> Any:
    """Return a number as SymPy's, to 15 digits: 0.30000000000000004 is 0.3, and 2.0 is 2."""
    import sympy

    short = float(f"{value:.15g}")
    is_whole = short.is_integer() and abs(short) < 1e6
    return sympy.Integer(int(short)) if is_whole else sympy.Float(short)


def _scale(a: Vector, factor: Trig) -> Vector:
    return [x * factor for x in a]


def _plus(a: Vector, b: Vector) -> Vector:
    return [x + y for x, y in zip(a, b, strict=True)]


def _dot(a: Vector, b: Vector) -> Trig:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def _apply(M: Matrix, a: Vector) -> Vector:
    return [_dot(row, a) for row in M]


def _product(A: Matrix, B: Matrix) -> Matrix:
    columns = [list(column) for column in zip(*B, strict=True)]
    return [[_dot(row, column) for column in columns] for row in A]


def _sum(A: Matrix, B: Matrix) -> Matrix:
    return [_plus(a, b) for a, b in zip(A, B, strict=True)]


def _steiner(a: Vector, b: Vector) -> Matrix:
    """Return -[a][b], that is a.b 1 - b a'."""
    matrix: Matrix = [[-(b[r] * a[c]) for c in range(3)] for r in range(3)]
    along = _dot(a, b)
    for k in range(3):
        matrix[k][k] = along + matrix[k][k]
    return matrix


def _tex_symbol(name: str) -> str:
    """Return "I_{2xx}" for "I2xx"."""
    match = re.fullmatch(r"([A-Za-z])(\w+)", name)
    return f"{match[1]}_{{{match[2]}}}" if match else name


def _plain(text: str) -> str:
    """Return a name that can stand in a docstring."""
    return text.replace("\\", "/").replace('"', "'")
