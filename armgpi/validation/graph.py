"""Expressions of SymPy or CasADi as a graph that is drawn in a hundredth of their time, for the search.

While changes of a source are tried, modules of these names stand for SymPy and CasADi: symbols, matrices,
derivatives, substitutions, `lambdify` and `Function`. What they give is compared with what the real ones gave
before anything is tried (:mod:`armgpi.validation.worker`); a model that uses more of them is run with these.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

#: Letters for a joint's position, velocity, acceleration and torque in the names of symbols.
_LETTERS = {
    "q": r"(?:q|theta|th)_?(\d+)",
    "v": r"(?:v|dq|qd|qdot|q_dot|dtheta|thetad|omega)_?(\d+)|q_?(\d+)_?(?:d|dot)",
    "a": r"(?:a|ddq|qdd|qddot|alpha)_?(\d+)|q_?(\d+)_?(?:dd|ddot)",
    "tau": r"(?:tau|u)_?(\d+)",
}
#: Symbol -> the number that it stood for last: put in its place, or given to what `lambdify` made.
GIVEN: dict[str, float] = {}
#: Modules of SymPy in whose place these stand.
_MODULES = (
    "sympy",
    "sympy.matrices",
    "sympy.physics",
    "sympy.physics.mechanics",
    "sympy.physics.vector",
)
#: Functions of one argument that both SymPy and CasADi have.
_FUNCTIONS = ("sin", "cos", "tan", "exp")
#: Functions of SymPy that change how an expression is written, not what it is.
_REWRITING = (
    "simplify",
    "expand",
    "trigsimp",
    "factor",
    "nsimplify",
    "N",
    "cancel",
    "together",
    "collect",
    "powsimp",
    "ratsimp",
    "fu",
    "expand_trig",
    "refine",
)
#: Functions of SymPy that make a number an expression.
_NUMBERS = ("S", "sympify", "Integer", "Float")
#: Symbol of time, of which coordinates may be functions.
_TIME = "t"


def joint_of(name: str) -> tuple[str, int] | None:
    """Return which quantity of which joint (from 1) a symbol's name means."""
    for letter, pattern in _LETTERS.items():
        match = re.fullmatch(pattern, name)
        if match:
            return letter, int(next(group for group in match.groups() if group))
    return None


class Expression:
    """A node: an operation on others, or a leaf: a constant, a symbol, a term with a value of its own.

    One "later" is a derivative or a substitution that is made when it is asked for: a search asks for one
    function at a time, and most of the graph is in the others.
    """

    __slots__ = ("args", "known", "name", "op", "value")

    def __init__(
        self,
        op: str,
        args: tuple[Any, ...] = (),
        name: str = "",
        value: float = 0.0,
    ) -> None:
        """Take an operation, what it is of, and the name or the value of a leaf."""
        self.op = op
        self.args = args
        self.name = name
        self.value = value
        self.known: dict[str, Expression] | None = None  # derivatives that were formed, by the symbol

    def __str__(self) -> str:
        """Return the name of a symbol: models have their numbers by symbols, and by names."""
        return self.name if self.op == "symbol" else self.op

    def diff(self, *symbols: Any) -> Any:
        """Return the derivative by one symbol after the other; by time where none is given."""
        symbols = symbols or (symbol(_TIME),)
        if isinstance(symbols[0], Matrix):
            return symbols[0]._each(self.diff)
        if self.op != "symbol":
            return _later(lambda: self._slopes(symbols))
        return self._slopes(symbols)

    def _slopes(self, symbols: Sequence[Any]) -> Expression:
        derivative = self
        for symbol, times in _with_counts(symbols):
            for _ in range(times):
                derivative = derivative._slope(_now(symbol))
        return derivative

    def _slope(self, x: Expression) -> Expression:
        _now(self)
        if self.known is None:
            self.known = {}
        if x.name not in self.known:
            self.known[x.name] = self._derivative(x)
        return self.known[x.name]

    def _derivative(self, x: Expression) -> Expression:
        if self.op == "symbol":
            if self.name == x.name:
                return _constant(1.0)
            return _rate(self) if x.name == _TIME and self.value else _constant(0.0)
        derivative = _constant(0.0)
        for k, argument in enumerate(self.args):
            inner = argument._slope(x)
            if not _is(inner, 0.0):
                derivative = derivative + inner * _PARTIAL[self.op](k, *self.args)
        return derivative

    def subs(self, *changes: Any, **_: Any) -> Expression:
        """Return the expression with others in place of symbols."""
        return _later(lambda: _substitute([self], _pairs(changes))[0])

    xreplace = subs

    def coeff(self, x: Any, n: int = 1) -> Expression:
        """Return the coefficient of a power of a symbol, of an expression that is expanded."""
        x_now = _now(x)
        derivative = self
        for k in range(n):
            derivative = derivative.diff(x_now) * (1.0 / (k + 1))
        return derivative.subs({x_now: 0.0})

    def evalf(self, *_: Any, **__: Any) -> Expression:
        """Return the expression itself."""
        return self

    simplify = expand = doit = trigsimp = collect = factor = cancel = together = nsimplify = evalf

    @property
    def free_symbols(self) -> set[Expression]:
        """The symbols in it."""
        return {node for node in _in_order([self]) if node.op == "symbol"}

    def __float__(self) -> float:
        """Return the value of what has no symbols."""
        if _now(self).op not in ("constant", "term"):
            raise TypeError("an expression with symbols has no value")
        return self.value

    def __neg__(self) -> Expression:
        """Return the negative."""
        return _node("mul", _constant(-1.0), self)

    def __add__(self, other: Any) -> Any:
        """Return a sum."""
        return _node("add", self, _expression(other)) if _is_number(other) else NotImplemented

    def __mul__(self, other: Any) -> Any:
        """Return a product."""
        return _node("mul", self, _expression(other)) if _is_number(other) else NotImplemented

    def __pow__(self, exponent: Any) -> Expression:
        """Return a power with a constant exponent."""
        return _node("pow", self, _constant(float(exponent)))

    def __sub__(self, other: Any) -> Any:
        """Return a difference."""
        return self + (-other)

    def __rsub__(self, other: Any) -> Any:
        """Return a difference."""
        return -self + other

    def __truediv__(self, other: Any) -> Any:
        """Return a quotient."""
        return self * _expression(other) ** -1.0

    def __rtruediv__(self, other: Any) -> Any:
        """Return a quotient."""
        return self**-1.0 * other

    __radd__, __rmul__ = __add__, __mul__
    T = property(lambda self: self)
    shape = (1, 1)


_OPERATIONS: Mapping[str, Callable[..., float]] = {
    "add": lambda a, b: a + b,
    "mul": lambda a, b: a * b,
    "pow": lambda a, b: a**b,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "exp": math.exp,
}
#: What leaves the other argument as it is.
_NEUTRAL = {"add": 0.0, "mul": 1.0}
#: What makes all of it nothing.
_ZERO = {"mul": 0.0}
#: Derivatives by the k-th argument.
_PARTIAL: Mapping[str, Callable[..., Expression]] = {
    "add": lambda k, a, b: _constant(1.0),
    "mul": lambda k, a, b: (b, a)[k],
    "pow": lambda k, base, exponent: exponent * base ** (exponent.value - 1.0),
    "sin": lambda k, a: _node("cos", a),
    "cos": lambda k, a: -_node("sin", a),
    "tan": lambda k, a: 1.0 + _node("tan", a) ** 2,
    "exp": lambda k, a: _node("exp", a),
}


def _later(make: Callable[[], Expression]) -> Expression:
    return Expression("later", (make,))


def _now(node: Expression) -> Expression:
    """Make a node what it is."""
    while node.op == "later":
        result = node.args[0]()
        for field in Expression.__slots__:
            setattr(node, field, getattr(result, field))
    return node


def _constant(value: float) -> Expression:
    return Expression("constant", value=float(value))


def _expression(x: Any) -> Expression:
    return x if isinstance(x, Expression) else _constant(float(x))


def _is_number(x: Any) -> bool:
    """Tell whether something is an expression, or a number."""
    return isinstance(x, Expression | int | float | np.number) or (
        np.ndim(x) == 0 and hasattr(x, "__float__")
    )


def _is(node: Expression, value: float | None) -> bool:
    return node.op == "constant" and node.value == value


def _node(op: str, *args: Expression) -> Expression:
    """Return an operation, without what is plainly zero or one: derivatives have many zeros."""
    first, last = args[0], args[-1]
    if "later" in (first.op, last.op):
        return _later(lambda: _node(op, *map(_now, args)))
    if first.op == "constant" == last.op:
        return _constant(_OPERATIONS[op](*[a.value for a in args]))
    if op in _NEUTRAL:
        for argument, other in ((first, last), (last, first)):
            if _is(argument, _NEUTRAL[op]):
                return other
            if _is(argument, _ZERO.get(op)):
                return argument
    if op == "pow" and _is(last, 1.0):
        return first
    return Expression(op, args)


def symbol(name: str, moving: bool = False) -> Expression:
    """Return the symbol of a name, which may be a function of time."""
    return Expression("symbol", name=name, value=float(moving))


def _rate(coordinate: Expression) -> Expression:
    """Return the derivative of a coordinate by time, as a symbol."""
    joint = joint_of(coordinate.name)
    if joint is not None:
        letter, number = joint
        # The rate of a speed is qdd1, not a1: a length may be called so.
        next_letter = {"q": "v", "v": "qdd"}.get(letter)
        if next_letter:
            return symbol(f"{next_letter}{number}", moving=True)
    return symbol(f"{coordinate.name}'", moving=True)


def _with_counts(symbols: Sequence[Any]) -> Iterator[tuple[Any, int]]:
    """Yield symbols with how many times a derivative is by each."""
    for k, x in enumerate(symbols):
        if isinstance(x, tuple):
            yield x[0], int(x[1])
        elif not isinstance(x, int):
            following = symbols[k + 1] if k + 1 < len(symbols) else 1
            yield x, following if isinstance(following, int) else 1


def _pairs(changes: Sequence[Any]) -> dict[str, Expression]:
    """Return what is put in place of symbols, by their names."""
    first = changes[0]
    if len(changes) == 2:
        pairs = [changes]
    elif isinstance(first, Mapping):
        pairs = [*first.items()]
    else:
        pairs = [*first]
    replacements: dict[str, Expression] = {}
    for old, new in pairs:
        name = _now(old).name if isinstance(old, Expression) else str(old)
        replacements[name] = _expression(new)
    for name, new in replacements.items():
        if new.op == "constant":
            GIVEN[name] = new.value
    return replacements


def _substitute(nodes: Sequence[Expression], swap: Mapping[str, Expression]) -> list[Expression]:
    changed: dict[int, Expression] = {}
    for node in _in_order(nodes):
        if not node.args:
            changed[id(node)] = swap.get(node.name, node) if node.name else node
            continue
        args = tuple([changed[id(a)] for a in node.args])
        changed[id(node)] = node if args == node.args else _node(node.op, *args)
    return [changed[id(node)] for node in nodes]


def _in_order(nodes: Iterable[Expression]) -> list[Expression]:
    """Return all nodes that some need, each after those that it needs."""
    ordered: list[Expression] = []
    visited: set[int] = set()
    todo = [(node, False) for node in nodes]
    while todo:
        node, ready = todo.pop()
        _now(node)
        if ready:
            ordered.append(node)
        elif id(node) not in visited:
            visited.add(id(node))
            todo.append((node, True))
            todo += [(a, False) for a in node.args]
    return ordered


class Program:
    """What computes some expressions, of the values of their symbols by names."""

    def __init__(self, outputs: Any) -> None:
        """Take an expression, or an array of them."""
        self._outputs = np.asarray(outputs, dtype=object)
        flat = [_expression(x) for x in self._outputs.ravel()]
        nodes = _in_order(flat)
        place = {id(node): k for k, node in enumerate(nodes)}
        self._places = [place[id(x)] for x in flat]
        self._leaves: list[tuple[int, Expression]] = []
        self._steps: list[tuple[int, Callable[..., float], list[int]]] = []
        for k, node in enumerate(nodes):
            if node.args:
                arguments = [place[id(a)] for a in node.args]
                self._steps.append((k, _OPERATIONS[node.op], arguments))
            else:
                self._leaves.append((k, node))
        self._count = len(nodes)
        #: Names of the symbols.
        self.names = {node.name for _, node in self._leaves if node.op == "symbol"}

    def __call__(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the values of the expressions.

        Raises:
            KeyError: when a symbol has no value.
        """
        of_nodes: list[Any] = [0.0] * self._count
        for k, node in self._leaves:
            of_nodes[k] = values[node.name] if node.op == "symbol" else node.value
        for k, operation, args in self._steps:
            of_nodes[k] = operation(*[of_nodes[j] for j in args])
        flat = np.array([of_nodes[k] for k in self._places], dtype=np.float64)
        return flat.reshape(self._outputs.shape)


class Matrix(np.ndarray):
    """A matrix whose product is that of matrices; a list makes a column."""

    def __new__(cls, rows: Any, columns: Any = None, entries: Any = None) -> Matrix:
        """Make it of rows, of a column's entries, or of its size and a function or list of entries."""
        if entries is not None:
            if callable(entries):
                entries = [entries(i, j) for i, j in np.ndindex(rows, columns)]
            rows = np.array(entries, dtype=object).reshape(rows, columns)
        array = np.array(rows, dtype=object)
        for k, x in enumerate(array.flat):
            array.flat[k] = _expression(x)  # so that every entry has its derivatives
        if array.ndim == 1:
            array = array[:, np.newaxis]
        return array.view(cls)

    def __getitem__(self, index: Any) -> Any:
        """Return entries; a single index counts through the rows."""
        if isinstance(index, int):
            return _entries(self)[index]
        return super().__getitem__(index)

    def __mul__(self, other: Any) -> Any:
        """Return a product."""
        return self @ other if isinstance(other, Matrix) else super().__mul__(other)

    def _each(self, function: Callable[[Any], Any]) -> Matrix:
        rows = self.view(np.ndarray)
        return type(self)([[function(x) for x in row] for row in rows])

    def diff(self, *symbols: Any) -> Matrix:
        """Return the derivative of every entry."""
        return self._each(lambda x: x.diff(*symbols))

    def subs(self, *changes: Any, **_: Any) -> Matrix:
        """Return the matrix with others in place of symbols."""
        changed: list[Expression] = []  # all entries at once, so that what they share stays shared

        def entry(k: int) -> Expression:
            if not changed:
                changed.extend(_substitute(list(_entries(self)), _pairs(changes)))
            return changed[k]

        entries = [_later(partial(entry, k)) for k in range(self.size)]
        shaped = np.array(entries, dtype=object).reshape(self.shape)
        return type(self)(shaped)

    xreplace = subs
    applyfunc = _each

    def evalf(self, *_: Any, **__: Any) -> Matrix:
        """Return the matrix itself."""
        return self

    simplify = expand = doit = trigsimp = nsimplify = as_explicit = as_mutable = evalf

    def jacobian(self, symbols: Any) -> Matrix:
        """Return the derivatives of a column by several symbols."""
        names = np.ravel(symbols)
        return type(self)([[x.diff(name) for name in names] for x in np.ravel(self)])

    def dot(self, other: Any, *_: Any) -> Any:
        """Return the product of the entries of two vectors, summed."""
        pairs = zip(np.ravel(self), np.ravel(other), strict=True)
        return sum(x * y for x, y in pairs)

    def cross(self, other: Any) -> Matrix:
        """Return a cross product."""
        x, y, z = np.ravel(self)
        u, v, w = np.ravel(other)
        return type(self)([y * w - z * v, z * u - x * w, x * v - y * u])

    @classmethod
    def vstack(cls, *matrices: Any) -> Any:
        """Return matrices below each other."""
        return cls(np.concatenate([matrix.view(np.ndarray) for matrix in matrices]))

    @classmethod
    def hstack(cls, *matrices: Any) -> Any:
        """Return matrices beside each other."""
        return cls.vstack(*(matrix.T for matrix in matrices)).T

    def row_join(self, other: Any) -> Any:
        """Return another matrix beside this one."""
        return self.hstack(self, other)

    def col_join(self, other: Any) -> Any:
        """Return another matrix below this one."""
        return self.vstack(self, other)


class Grid(Matrix):
    """A matrix of CasADi: its product is that of the entries, and a single index counts down the columns."""

    def __getitem__(self, index: Any) -> Any:
        """Return entries."""
        if isinstance(index, int):
            return _entries(self.T)[index]
        if isinstance(index, slice):
            return Grid(_entries(self.T)[index])
        entries = super().__getitem__(index)
        if not isinstance(entries, np.ndarray):
            return entries
        of_one_column = isinstance(index[1], int)
        return Grid(entries.reshape(-1, 1) if of_one_column else np.atleast_2d(entries))

    def __mul__(self, other: Any) -> Any:
        """Return a product of the entries."""
        return np.ndarray.__mul__(self, other)

    def __matmul__(self, other: Any) -> Any:
        """Return a product of matrices; one with a single entry is a factor."""
        several = isinstance(other, np.ndarray) and min(self.size, other.size) > 1
        return np.ndarray.__matmul__(self, other) if several else self * other


class _Numbers(np.ndarray):
    """What a function of CasADi gives for numbers."""

    def full(self) -> np.ndarray:
        """Return an array."""
        return np.asarray(self)

    toarray = full


def _function(
    arguments: Sequence[Any], outputs: Any, shape: Callable[[np.ndarray], Any]
) -> Callable[..., Any]:
    """Return a function of the values of some symbols; symbols may be given as well."""
    names = [_now(x).name for x in _flatten(arguments)]
    programs: list[Program] = []  # made when it is called first: a search asks for one function

    def call(*given: Any) -> Any:
        values = dict(zip(names, _flatten(given), strict=True))
        if any(map(_has_symbols, values.values())):
            return outputs.subs(values)
        if not programs:
            programs.append(Program(outputs))
        numbers = {name: float(x) for name, x in values.items()}
        GIVEN.update(numbers)
        return shape(programs[0](numbers))

    return call


def _has_symbols(x: Any) -> bool:
    """Tell whether something is an expression, and no constant."""
    return isinstance(x, Expression) and _now(x).op != "constant"


def _entries(x: Any) -> Any:
    """Return the entries of a number, an expression, a list or an array one after the other, an array."""
    return np.ravel(np.asarray(x, dtype=object)).view(np.ndarray)


def _flatten(arguments: Iterable[Any]) -> list[Any]:
    """Return the entries of all of them one after the other."""
    return [x for argument in arguments for x in _entries(argument)]


def _turn(op: str) -> Callable[[Any], Any]:
    def call(x: Any) -> Any:
        if isinstance(x, Matrix):
            return x._each(call)
        return _node(op, _expression(x))

    return call


def _symbols(text: Any, cls: Any = None, **_: Any) -> Any:
    """Return the symbols of a text such as "q1 q2" or "q1:4"."""
    names: list[str] = []
    for word in str(text).replace(",", " ").split():
        span = re.fullmatch(r"(.*?)(\d*):(\d+)", word)
        if span is None:
            names.append(word)
            continue
        prefix, first, end = span.groups()
        names += [f"{prefix}{k}" for k in range(int(first or 0), int(end))]
    make = cls or symbol
    symbols = tuple(make(name) for name in names)
    is_single = len(symbols) == 1 and ":" not in str(text)
    return symbols[0] if is_single else symbols


def _lambdify(arguments: Any, outputs: Any, *_: Any, **__: Any) -> Callable[..., Any]:
    names = [arguments] if isinstance(arguments, Expression) else list(arguments)
    if isinstance(outputs, Expression):
        return _function(names, outputs, float)
    matrix = outputs if isinstance(outputs, Matrix) else Matrix(outputs)
    shape = matrix.shape if isinstance(outputs, Matrix) else np.shape(outputs)
    return _function(names, matrix, lambda x: x.reshape(shape))


def _sizes(make: Callable[..., Any], kind: type[Matrix]) -> Callable[..., Matrix]:
    def call(*shape: int) -> Matrix:
        if len(shape) == 1:
            columns = shape[0] if kind is Matrix else 1
            shape = (shape[0], columns)
        return kind(make(shape))

    return call


def _sympy() -> dict[str, Any]:
    """Return what computes as SymPy does."""
    return {
        **{name: _turn(name) for name in _FUNCTIONS},
        **dict.fromkeys(_REWRITING, lambda x, *_, **__: x),
        **dict.fromkeys(_NUMBERS, _expression),
        "sqrt": lambda x: _expression(x) ** 0.5,
        "diff": _derivative,
        "Derivative": lambda value, *symbols: _expression(value).diff(*symbols),
        "symbols": _symbols,
        "Symbol": lambda name, **_: symbol(name),
        "Function": lambda name: lambda *_: symbol(name, moving=True),
        "Matrix": Matrix,
        "ImmutableMatrix": Matrix,
        "zeros": _sizes(np.zeros, Matrix),
        "ones": _sizes(np.ones, Matrix),
        "eye": lambda n: Matrix(np.eye(n)),
        "diag": lambda *entries: Matrix(np.diag(np.array(entries, dtype=object))),
        "hessian": _hessian,
        "linear_eq_to_matrix": _linear_equations,
        "Rational": lambda a, b=1: _constant(a / b),
        "lambdify": _lambdify,
        "dynamicsymbols": _dynamic_symbols,
        "LagrangesMethod": _Lagrange,
        **dict.fromkeys(("MatrixBase", "Basic"), ModuleType),
        "pi": math.pi,
    }


def _derivative(value: Any, *symbols: Any) -> Any:
    """Return the derivative of an expression or of a matrix."""
    if isinstance(value, Matrix):
        return value.diff(*symbols)
    return _expression(value).diff(*symbols)


def _hessian(value: Any, symbols: Any, *_: Any) -> Matrix:
    """Return the second derivatives of an expression."""
    energy = _expression(value)
    names = list(_entries(symbols))
    return Matrix([[energy.diff(a, b) for b in names] for a in names])


def _linear_equations(equations: Any, *symbols: Any) -> tuple[Matrix, Matrix]:
    """Return A and b of linear equations A x - b = 0."""
    rows = Matrix(list(_entries(equations)))
    names = list(_entries(symbols))
    constant = rows.subs(dict.fromkeys(names, 0.0))
    return rows.jacobian(names), -constant


class DrawnEquations(NamedTuple):
    """Equations of motion M a = forcing.

    Attributes:
        mass_matrix: M (n x n).
        forcing: all other terms (n x 1).
        coordinates: symbols of the positions.
        speeds: symbols of their rates.
    """

    mass_matrix: Matrix
    forcing: Matrix
    coordinates: list[Expression]
    speeds: list[Expression]


class _Lagrange:
    """Lagrange's equations of SymPy's mechanics, without forces and constraints."""

    def __init__(self, lagrangian: Any, coordinates: Any, *rest: Any, **given: Any) -> None:
        """Take what the equations follow from."""
        if rest or any(x is not None for x in given.values()):
            raise NotImplementedError  # the real one is used then
        self._energy = _expression(lagrangian)
        self._q = [_now(x) for x in _entries(coordinates)]
        self._v = [_rate(x) for x in self._q]

    def form_lagranges_equations(self) -> Matrix:
        """Return d/dt dL/dv - dL/dq."""
        rows = []
        for q, v in zip(self._q, self._v, strict=True):
            momentum = self._energy.diff(v)
            rows.append(momentum.diff() - self._energy.diff(q))
        self.eom = Matrix(rows)
        return self.eom

    @property
    def mass_matrix(self) -> Matrix:
        """What the accelerations are multiplied by."""
        momenta = [self._energy.diff(v) for v in self._v]
        return Matrix([[momentum.diff(v) for v in self._v] for momentum in momenta])

    @property
    def forcing(self) -> Matrix:
        """What is left of the equations without accelerations, with the other sign."""
        accelerations = [_rate(v).name for v in self._v]
        still = self.eom.subs(dict.fromkeys(accelerations, _constant(0.0)))
        return still._each(lambda x: -x)

    def drawn_equations(self) -> DrawnEquations:
        """Return M, the forcing, the coordinates and the speeds."""
        if not hasattr(self, "eom"):
            self.form_lagranges_equations()
        return DrawnEquations(self.mass_matrix, self.forcing, self._q, self._v)


def equations_of(method: Any) -> Matrix:
    """Return the torques of a drawn object of SymPy's mechanics, in q1.., v1.., qdd1..."""
    drawn: DrawnEquations = method.drawn_equations()
    forcing = drawn.forcing
    of_state = {x.name for x in (*drawn.coordinates, *drawn.speeds)}
    torque_names = [name for name in Program(forcing).names - of_state if _is_torque(name)]
    if torque_names:
        forcing = forcing.subs(dict.fromkeys(torque_names, 0.0))
    accelerations = Matrix([symbol(f"qdd{i + 1}") for i in range(len(drawn.speeds))])
    torques = drawn.mass_matrix * accelerations - forcing
    swap: dict[Any, Any] = {}
    for i, coordinate in enumerate(drawn.coordinates, 1):
        swap[coordinate] = symbol(f"q{i}")
    for i, speed in enumerate(drawn.speeds, 1):
        swap[speed] = symbol(f"v{i}")
    return Matrix(np.asarray(torques.subs(swap)))


def _is_torque(name: str) -> bool:
    joint = joint_of(name)
    return joint is not None and joint[0] == "tau"


def _dynamic_symbols(text: Any, *_: Any, **__: Any) -> Any:
    return _symbols(text, partial(symbol, moving=True))


_dynamic_symbols._t = symbol(_TIME)  # type: ignore[attr-defined]


def _solve(a: Any, b: Any, *_: Any) -> Grid:
    """Return the solution of a system of equations, whose pivots are those of a mass matrix."""
    rows = np.hstack([a, b]).view(np.ndarray)
    for k in range(len(rows)):
        rows[k] = rows[k] / rows[k, k]
        for j in {*range(len(rows))} - {k}:
            rows[j] = rows[j] - rows[j, k] * rows[k]
    return Grid(rows[:, len(rows) :])


def _grid(x: Any) -> Grid:
    if isinstance(x, Grid):
        return x
    return Grid(np.atleast_2d(np.array(x, dtype=object)))


def _join(axis: int, *matrices: Any) -> Grid:
    arrays = [_grid(matrix).view(np.ndarray) for matrix in matrices]
    return Grid(np.concatenate(arrays, axis=axis))


def _jacobian(value: Any, symbols: Any) -> Grid:
    """Return the derivatives of the entries, counted down the columns, by several symbols."""
    names = np.ravel(_grid(symbols))
    return Grid([[x.diff(name) for name in names] for x in _grid(value).T.ravel()])


def _hessian_and_gradient(value: Any, symbols: Any) -> tuple[Grid, Grid]:
    gradient = _jacobian(value, symbols).T
    return _jacobian(gradient, symbols), gradient


def _replaced(value: Any, old: Any, new: Any) -> Matrix:
    """Return a matrix with others in place of symbols."""
    pairs = list(zip(np.ravel(old), np.ravel(_grid(new)), strict=True))
    return _grid(value).subs(pairs)


def _product(first: Any, *others: Any) -> Any:
    """Return the product of matrices, of a list of them or one after the other."""
    factors = [*first, *others] if isinstance(first, list) else [first, *others]
    product = factors[0]
    for factor in factors[1:]:
        product = product @ _grid(factor)
    return product


def _casadi_symbols(name: str, rows: int = 1, columns: int = 1) -> Matrix:
    """Return a matrix of symbols, which are counted down the columns."""
    if rows * columns == 1:
        return Grid([[symbol(name)]])
    return Grid(rows, columns, lambda i, j: symbol(f"{name}[{i + rows * j}]"))


def _casadi_function(_: str, inputs: Sequence[Any], outputs: Sequence[Any], *__: Any) -> Callable[..., Any]:
    """Return a function of several outputs, a tuple; of one, its value."""
    calls = [_function(inputs, _grid(output), lambda y: y.view(_Numbers)) for output in outputs]
    if len(calls) == 1:
        return calls[0]
    return lambda *given: tuple(call(*given) for call in calls)


def _casadi() -> dict[str, Any]:
    """Return what computes as CasADi does."""
    zeros = _sizes(np.zeros, Grid)

    class Kind:
        """SX, MX and DM: what makes symbols and matrices."""

        def __new__(cls, *given: Any) -> Any:
            return zeros(*given) if len(given) > 1 else _grid(*given)

        eye = staticmethod(lambda n: Grid(np.eye(n)))

    Kind.zeros = staticmethod(zeros)  # type: ignore[attr-defined]
    Kind.sym = staticmethod(_casadi_symbols)  # type: ignore[attr-defined]
    return {
        **{name: _turn(name) for name in _FUNCTIONS},
        **dict.fromkeys(("SX", "MX", "DM"), Kind),
        **dict.fromkeys(("simplify", "densify"), lambda a: a),
        "transpose": np.transpose,
        "sqrt": lambda x: _grid(x)._each(lambda y: y**0.5),
        "vertcat": partial(_join, 0),
        "horzcat": partial(_join, 1),
        "jacobian": _jacobian,
        "gradient": lambda value, symbols: _jacobian(value, symbols).T,
        "hessian": _hessian_and_gradient,
        "jtimes": lambda value, symbols, v: _jacobian(value, symbols) @ _grid(v),
        "mtimes": _product,
        "solve": _solve,
        "dot": lambda a, b: _grid(a).dot(_grid(b)),
        "cross": lambda a, b: _grid(a).cross(_grid(b)),
        "sumsqr": lambda a: _grid(a).dot(_grid(a)),
        "diag": lambda a: Grid(np.diag(np.ravel(a))),
        "substitute": _replaced,
        "Function": _casadi_function,
        "pi": math.pi,
    }


def install(more: Mapping[str, Any]) -> Callable[[], None]:
    """Put modules of these in the place of SymPy and CasADi, and return what takes them away again.

    Args:
        more: what SymPy's mechanics have beside, by names.
    """
    before: dict[str, ModuleType] = {}
    for name in list(sys.modules):
        if name.split(".")[0] in ("sympy", "casadi"):
            before[name] = sys.modules.pop(name)
    members_of = {name: {**_sympy(), **more} for name in _MODULES}
    members_of["sympy"] = members_of["sympy.matrices"] = _sympy()
    members_of["casadi"] = _casadi()
    for name, members in members_of.items():
        module = ModuleType(name)
        module.__path__ = []
        vars(module).update(members)
        sys.modules[name] = module
    for name in _MODULES[1:]:
        parent, child = name.rsplit(".", maxsplit=1)
        setattr(sys.modules[parent], child, sys.modules[name])

    def uninstall() -> None:
        for name in members_of:
            sys.modules.pop(name, None)
        sys.modules.update(before)

    return uninstall


def is_drawn(value: Any) -> bool:
    """Tell whether a value is an expression of these, or a list of them."""
    entries = _entries(value) if isinstance(value, list | np.ndarray) else [value]
    return any(isinstance(x, Expression) for x in entries)


def states_of(names: Iterable[str]) -> dict[str, tuple[str, int]]:
    """Return which entry (from 0) of which quantity symbols are, by their names; others are left out."""
    joints: dict[str, tuple[str, int]] = {}
    in_vectors = set[str]()  # q[0], which counts from 0
    for name in names:
        vector = re.fullmatch(r"(\w+)\[(\d+)\]", name)
        joint = joint_of(f"{vector[1]}_{vector[2]}" if vector else name)
        if joint is not None:
            joints[name] = joint
        if vector:
            in_vectors.add(name)
    # q_0, q_1, ... or q1, q2, ...
    counted_from_0 = any(number == 0 for name, (_, number) in joints.items() if name not in in_vectors)
    first = 0 if counted_from_0 else 1
    states: dict[str, tuple[str, int]] = {}
    for name, (letter, number) in joints.items():
        states[name] = (letter, number if name in in_vectors else number - first)
    return states
