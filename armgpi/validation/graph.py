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
from typing import Any

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
    *("sympy", "sympy.matrices", "sympy.physics"),
    *("sympy.physics.mechanics", "sympy.physics.vector"),
)
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

    def __init__(self, op: str, args: tuple[Any, ...] = (), name: str = "", value: float = 0.0) -> None:
        """Take an operation, what it is of, and the name or the value of a leaf."""
        self.op, self.args, self.name, self.value = op, args, name, value
        self.known: dict[str, Expression] | None = None  # derivatives that were formed, by the symbol

    def __str__(self) -> str:
        """Return the name of a symbol: models have their numbers by symbols, and by names."""
        return self.name if self.op == "symbol" else self.op

    def diff(self, *symbols: Any) -> Any:
        """Return the derivative by one symbol after the other; by time where none is given."""
        symbols = symbols or (symbol(_TIME),)
        if isinstance(symbols[0], Matrix):
            return type(symbols[0])([[self.diff(x) for x in row] for row in symbols[0].view(np.ndarray)])
        if self.op != "symbol":
            return _later(lambda: self._slopes(symbols))
        return self._slopes(symbols)

    def _slopes(self, symbols: Sequence[Any]) -> Expression:
        found = self
        for symbol, times in _with_counts(symbols):
            for _ in range(times):
                found = found._slope(_now(symbol))
        return found

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
        parts = (a._slope(x) for a in self.args)
        found = _constant(0.0)
        for k, part in enumerate(parts):
            if not _is(part, 0.0):
                found = found + part * _PARTIAL[self.op](k, *self.args)
        return found

    def subs(self, *changes: Any, **_: Any) -> Expression:
        """Return the expression with others in place of symbols."""
        return _later(lambda: _substitute([self], _pairs(changes))[0])

    xreplace = subs

    def coeff(self, x: Any, n: int = 1) -> Expression:
        """Return the coefficient of a power of a symbol, of an expression that is expanded."""
        found, at = self, _now(x)
        for k in range(n):
            found = found.diff(at) * (1.0 / (k + 1))
        return found.subs({at: 0.0})

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
#: What leaves the other argument as it is, and what makes all of it nothing.
_NEUTRAL, _ZERO = {"add": 0.0, "mul": 1.0}, {"mul": 0.0}
#: Derivatives by the k-th argument.
_PARTIAL: Mapping[str, Callable[..., Expression]] = {
    "add": lambda k, a, b: _constant(1.0),
    "mul": lambda k, a, b: (b, a)[k],
    "pow": lambda k, a, b: b * a ** (b.value - 1.0),
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
        made = node.args[0]()
        for field in Expression.__slots__:
            setattr(node, field, getattr(made, field))
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
    if "later" in (args[0].op, args[-1].op):
        return _later(lambda: _node(op, *map(_now, args)))
    if args[0].op == "constant" == args[-1].op:
        return _constant(_OPERATIONS[op](*[a.value for a in args]))
    for one, other in (args, args[::-1]) if op in _NEUTRAL else ():
        if _is(one, _NEUTRAL[op]):
            return other
        if _is(one, _ZERO.get(op)):
            return one
    return args[0] if op == "pow" and _is(args[1], 1.0) else Expression(op, args)


def symbol(name: str, moving: bool = False) -> Expression:
    """Return the symbol of a name, which may be a function of time."""
    return Expression("symbol", name=name, value=float(moving))


def _rate(one: Expression) -> Expression:
    """Return the derivative of a coordinate by time, as a symbol."""
    joint = joint_of(one.name)
    # A length may be called a1.
    next_letter = {"q": "v", "v": "qdd"}.get(joint[0]) if joint else None
    return symbol(f"{next_letter}{joint[1]}" if joint and next_letter else f"{one.name}'", moving=True)


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
    pairs = [changes] if len(changes) == 2 else first.items() if isinstance(first, Mapping) else first
    names = (_now(old).name if isinstance(old, Expression) else str(old) for old, _ in pairs)
    found = {name: _expression(new) for name, (_, new) in zip(names, pairs, strict=True)}
    GIVEN.update({name: new.value for name, new in found.items() if new.op == "constant"})
    return found


def _substitute(nodes: Sequence[Expression], swap: Mapping[str, Expression]) -> list[Expression]:
    done: dict[int, Expression] = {}
    for one in _in_order(nodes):
        if one.args:
            args = tuple([done[id(a)] for a in one.args])
            done[id(one)] = one if args == one.args else _node(one.op, *args)
        else:
            done[id(one)] = swap.get(one.name, one) if one.name else one
    return [done[id(node)] for node in nodes]


def _in_order(nodes: Iterable[Expression]) -> list[Expression]:
    """Return all nodes that some need, each after those that it needs."""
    found: list[Expression] = []
    seen: set[int] = set()
    todo = [(node, False) for node in nodes]
    while todo:
        node, ready = todo.pop()
        _now(node)
        if ready:
            found.append(node)
        elif id(node) not in seen:
            seen.add(id(node))
            todo.append((node, True))
            todo += [(a, False) for a in node.args]
    return found


class Program:
    """What computes some expressions, of the values of their symbols by names."""

    def __init__(self, outputs: Any) -> None:
        """Take an expression, or an array of them."""
        self._outputs = np.asarray(outputs, dtype=object)
        flat = [_expression(x) for x in self._outputs.ravel()]
        nodes = _in_order(flat)
        place = {id(node): k for k, node in enumerate(nodes)}
        self._places = [place[id(x)] for x in flat]
        self._leaves = [(k, node) for k, node in enumerate(nodes) if not node.args]
        self._steps = [
            (k, _OPERATIONS[node.op], [place[id(a)] for a in node.args])
            for k, node in enumerate(nodes)
            if node.args
        ]
        self._count = len(nodes)
        #: Names of the symbols.
        self.names = {node.name for _, node in self._leaves if node.op == "symbol"}

    def __call__(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the values of the expressions.

        Raises:
            KeyError: when a symbol has no value.
        """
        at: list[Any] = [0.0] * self._count
        for k, node in self._leaves:
            at[k] = values[node.name] if node.op == "symbol" else node.value
        for k, operation, args in self._steps:
            at[k] = operation(*[at[j] for j in args])
        return np.array([at[k] for k in self._places], dtype=np.float64).reshape(self._outputs.shape)


class Matrix(np.ndarray):
    """A matrix whose product is that of matrices; a list makes a column."""

    def __new__(cls, rows: Any, columns: Any = None, entries: Any = None) -> Matrix:
        """Make it of rows, of a column's entries, or of its size and a function or list of entries."""
        if entries is not None:
            flat = [entries(*at) for at in np.ndindex(rows, columns)] if callable(entries) else entries
            rows = np.array(flat, dtype=object).reshape(rows, columns)
        array = np.array(rows, dtype=object)
        for k, x in enumerate(array.flat):
            array.flat[k] = _expression(x)  # so that every entry has its derivatives
        return (array[:, np.newaxis] if array.ndim == 1 else array).view(cls)

    def __getitem__(self, index: Any) -> Any:
        """Return entries; a single index counts through the rows."""
        return self.ravel().view(np.ndarray)[index] if isinstance(index, int) else super().__getitem__(index)

    def __mul__(self, other: Any) -> Any:
        """Return a product."""
        return self @ other if isinstance(other, Matrix) else super().__mul__(other)

    def _each(self, function: Callable[[Any], Any]) -> Matrix:
        return type(self)([[function(x) for x in row] for row in self.view(np.ndarray)])

    def diff(self, *symbols: Any) -> Matrix:
        """Return the derivative of every entry."""
        return self._each(lambda x: x.diff(*symbols))

    def subs(self, *changes: Any, **_: Any) -> Matrix:
        """Return the matrix with others in place of symbols."""
        made: list[Expression] = []

        def entry(k: int) -> Expression:
            made[:] = made or _substitute(list(self.view(np.ndarray).flat), _pairs(changes))
            return made[k]

        entries = [_later(partial(entry, k)) for k in range(self.size)]
        return type(self)(np.array(entries, dtype=object).reshape(self.shape))

    xreplace = subs
    applyfunc = _each

    def evalf(self, *_: Any, **__: Any) -> Matrix:
        """Return the matrix itself."""
        return self

    simplify = expand = doit = trigsimp = nsimplify = as_explicit = as_mutable = evalf

    def jacobian(self, symbols: Any) -> Matrix:
        """Return the derivatives of a column by several symbols."""
        return type(self)([[x.diff(s) for s in np.ravel(symbols)] for x in np.ravel(self)])

    def dot(self, other: Any, *_: Any) -> Any:
        """Return the product of the entries of two vectors, summed."""
        return sum(x * y for x, y in zip(np.ravel(self), np.ravel(other), strict=True))

    def cross(self, other: Any) -> Matrix:
        """Return a cross product."""
        (x, y, z), (u, v, w) = np.ravel(self), np.ravel(other)
        return type(self)([y * w - z * v, z * u - x * w, x * v - y * u])

    @classmethod
    def vstack(cls, *parts: Any) -> Any:
        """Return matrices below each other."""
        return cls(np.concatenate([part.view(np.ndarray) for part in parts]))

    @classmethod
    def hstack(cls, *parts: Any) -> Any:
        """Return matrices beside each other."""
        return cls.vstack(*(part.T for part in parts)).T

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
            return self.T.ravel().view(np.ndarray)[index]
        if isinstance(index, slice):
            return Grid(self.T.ravel().view(np.ndarray)[index])
        found = super().__getitem__(index)
        if not isinstance(found, np.ndarray):
            return found
        return Grid(found.reshape(-1, 1) if isinstance(index[1], int) else np.atleast_2d(found))

    def __mul__(self, other: Any) -> Any:
        """Return a product of the entries."""
        return np.ndarray.__mul__(self, other)

    def __matmul__(self, other: Any) -> Any:
        """Return a product of matrices; one with a single entry is a factor."""
        if isinstance(other, np.ndarray) and min(self.size, other.size) > 1:
            return np.ndarray.__matmul__(self, other)
        return self * other


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
        if any(isinstance(x, Expression) and _now(x).op != "constant" for x in values.values()):
            return outputs.subs(values)
        if not programs:
            programs.append(Program(outputs))
        numbers = {name: float(x) for name, x in values.items()}
        GIVEN.update(numbers)
        return shape(programs[0](numbers))

    return call


def _flatten(parts: Iterable[Any]) -> list[Any]:
    """Return the entries of numbers, expressions and arrays one after the other."""
    return [x for part in parts for x in np.ravel(np.asarray(part, dtype=object))]


def _turn(op: str) -> Callable[[Any], Any]:
    def call(x: Any) -> Any:
        return x._each(call) if isinstance(x, Matrix) else _node(op, _expression(x))

    return call


def _symbols(text: Any, cls: Any = None, **_: Any) -> Any:
    """Return the symbols of a text such as "q1 q2" or "q1:4"."""
    names: list[str] = []
    for word in str(text).replace(",", " ").split():
        span = re.fullmatch(r"(.*?)(\d*):(\d+)", word)
        if span is None:
            names.append(word)
        else:
            names += [f"{span[1]}{k}" for k in range(int(span[2] or 0), int(span[3]))]
    made = [(cls or symbol)(name) for name in names]
    return made[0] if len(made) == 1 and ":" not in str(text) else tuple(made)


def _lambdify(arguments: Any, outputs: Any, *_: Any, **__: Any) -> Callable[..., Any]:
    single = isinstance(arguments, Expression)
    if isinstance(outputs, Expression):
        return _function([arguments] if single else list(arguments), outputs, float)
    made = outputs if isinstance(outputs, Matrix) else Matrix(outputs)
    shape = made.shape if isinstance(outputs, Matrix) else np.shape(outputs)
    return _function([arguments] if single else list(arguments), made, lambda x: x.reshape(shape))


def _sizes(make: Callable[..., Any], kind: type[Matrix]) -> Callable[..., Matrix]:
    def call(*shape: int) -> Matrix:
        return kind(make(shape if len(shape) > 1 else (*shape, shape[0] if kind is Matrix else 1)))

    return call


def _sympy() -> dict[str, Any]:
    """Return what computes as SymPy does."""

    def hessian(value: Any, symbols: Any, *_: Any) -> Matrix:
        names = list(np.ravel(np.asarray(symbols, dtype=object)))
        return Matrix([[_expression(value).diff(a, b) for b in names] for a in names])

    def linear_equations(equations: Any, *symbols: Any) -> tuple[Matrix, Matrix]:
        rows = Matrix(list(np.ravel(np.asarray(equations, dtype=object))))
        names = list(np.ravel(np.asarray(symbols, dtype=object)))
        return rows.jacobian(names), -rows.subs(dict.fromkeys(names, 0.0))

    same = dict.fromkeys(
        (
            *("simplify", "expand", "trigsimp", "factor", "nsimplify", "N", "cancel", "together", "collect"),
            *("powsimp", "ratsimp", "fu", "expand_trig", "refine"),
        ),
        lambda x, *_, **__: x,
    )
    same |= dict.fromkeys(("S", "sympify", "Integer", "Float"), _expression)
    return {
        **{name: _turn(name) for name in ("sin", "cos", "tan", "exp")},
        **same,
        "sqrt": lambda x: _expression(x) ** 0.5,
        "diff": lambda value, *symbols: (
            _expression(value).diff(*symbols) if not isinstance(value, Matrix) else value.diff(*symbols)
        ),
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
        "hessian": hessian,
        "linear_eq_to_matrix": linear_equations,
        "Rational": lambda a, b=1: _constant(a / b),
        "lambdify": _lambdify,
        "dynamicsymbols": _dynamic_symbols,
        "LagrangesMethod": _Lagrange,
        **dict.fromkeys(("MatrixBase", "Basic"), ModuleType),
        "pi": math.pi,
    }


class _Lagrange:
    """Lagrange's equations of SymPy's mechanics, without forces and constraints."""

    def __init__(self, lagrangian: Any, coordinates: Any, *rest: Any, **given: Any) -> None:
        """Take what the equations follow from."""
        if rest or any(x is not None for x in given.values()):
            raise NotImplementedError  # the real one is used then
        self._energy = _expression(lagrangian)
        self._q = [_now(x) for x in np.ravel(np.asarray(coordinates, dtype=object))]
        self._v = [_rate(x) for x in self._q]

    def form_lagranges_equations(self) -> Matrix:
        """Return d/dt dL/dv - dL/dq."""
        momenta = [self._energy.diff(v) for v in self._v]
        rows = [p.diff() - self._energy.diff(q) for p, q in zip(momenta, self._q, strict=True)]
        self.eom = Matrix(rows)
        return self.eom

    @property
    def mass_matrix(self) -> Matrix:
        """What the accelerations are multiplied by."""
        return Matrix([[self._energy.diff(v).diff(w) for w in self._v] for v in self._v])

    @property
    def forcing(self) -> Matrix:
        """What is left of the equations without accelerations, with the other sign."""
        still = self.eom.subs({_rate(v).name: _constant(0.0) for v in self._v})
        return still._each(lambda x: -x)

    def drawn_equations(self) -> tuple[Matrix, Matrix, list[Expression], list[Expression]]:
        """Return M, the forcing, the coordinates and the speeds."""
        if not hasattr(self, "eom"):
            self.form_lagranges_equations()
        return self.mass_matrix, self.forcing, self._q, self._v


def equations_of(method: Any) -> Matrix:
    """Return the torques of a drawn object of SymPy's mechanics, in q1.., v1.., qdd1..."""
    mass, forcing, q, u = method.drawn_equations()
    accelerations = [symbol(f"qdd{i + 1}") for i in range(len(u))]
    own = {x.name for x in (*q, *u)}
    names = Program(forcing).names - own
    still = {name: 0.0 for name in names if (joint_of(name) or ("",))[0] == "tau"}
    swap: dict[Any, Any] = {x: symbol(f"q{i + 1}") for i, x in enumerate(q)}
    swap |= {x: symbol(f"v{i + 1}") for i, x in enumerate(u)}
    torques = mass * Matrix(accelerations) - (forcing.subs(still) if still else forcing)
    return Matrix(np.asarray(torques.subs(swap)))


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
    return x if isinstance(x, Grid) else Grid(np.atleast_2d(np.array(x, dtype=object)))


def _join(axis: int, *parts: Any) -> Grid:
    return Grid(np.concatenate([_grid(x).view(np.ndarray) for x in parts], axis=axis))


def _jacobian(value: Any, symbols: Any) -> Grid:
    return Grid([[x.diff(s) for s in np.ravel(_grid(symbols))] for x in _grid(value).T.ravel()])


def _casadi() -> dict[str, Any]:
    """Return what computes as CasADi does."""
    zeros, grid = _sizes(np.zeros, Grid), _grid

    def sym(name: str, rows: int = 1, columns: int = 1) -> Matrix:
        several = rows * columns > 1
        return Grid(rows, columns, lambda k, j: symbol(f"{name}[{k + rows * j}]" if several else name))

    def function(_: str, inputs: Sequence[Any], outputs: Sequence[Any], *__: Any) -> Callable[..., Any]:
        calls = [_function(inputs, grid(x), lambda y: y.view(_Numbers)) for x in outputs]
        return lambda *given: calls[0](*given) if len(calls) == 1 else tuple(c(*given) for c in calls)

    def multiply(a: Any, *rest: Any) -> Any:
        for b in [*a[1:], *rest] if isinstance(a, list) else rest:
            a = (a[0] if isinstance(a, list) else a) @ grid(b)
        return a

    class Kind:
        """SX, MX and DM: what makes symbols and matrices."""

        def __new__(cls, *given: Any) -> Any:
            return zeros(*given) if len(given) > 1 else grid(*given)

        eye = staticmethod(lambda n: Grid(np.eye(n)))

    Kind.zeros = staticmethod(zeros)  # type: ignore[attr-defined]
    Kind.sym = staticmethod(sym)  # type: ignore[attr-defined]
    return {
        **{name: _turn(name) for name in ("sin", "cos", "tan", "exp")},
        **dict.fromkeys(("SX", "MX", "DM"), Kind),
        **dict.fromkeys(("simplify", "densify"), lambda a: a),
        "transpose": np.transpose,
        "sqrt": lambda x: grid(x)._each(lambda y: y**0.5),
        "vertcat": partial(_join, 0),
        "horzcat": partial(_join, 1),
        "jacobian": _jacobian,
        "gradient": lambda value, symbols: _jacobian(value, symbols).T,
        "hessian": lambda e, x: (_jacobian(_jacobian(e, x).T, x), _jacobian(e, x).T),
        "jtimes": lambda value, symbols, v: _jacobian(value, symbols) @ grid(v),
        "mtimes": multiply,
        "solve": _solve,
        "dot": lambda a, b: grid(a).dot(grid(b)),
        "cross": lambda a, b: grid(a).cross(grid(b)),
        "sumsqr": lambda a: grid(a).dot(grid(a)),
        "diag": lambda a: Grid(np.diag(np.ravel(a))),
        "substitute": lambda e, old, new: grid(e).subs(
            list(zip(np.ravel(old), np.ravel(grid(new)), strict=True))
        ),
        "Function": function,
        "pi": math.pi,
    }


def install(more: Mapping[str, Any]) -> Callable[[], None]:
    """Put modules of these in the place of SymPy and CasADi, and return what takes them away again.

    Args:
        more: what SymPy's mechanics have beside, by names.
    """
    before = {name: sys.modules[name] for name in sys.modules if name.split(".")[0] in ("sympy", "casadi")}
    for name in before:
        del sys.modules[name]
    made = {"casadi": _casadi()}
    made |= {name: {**_sympy(), **more} for name in _MODULES}
    made["sympy"] = made["sympy.matrices"] = _sympy()
    for name, members in made.items():
        module = ModuleType(name)
        module.__path__ = []
        vars(module).update(members)
        sys.modules[name] = module
    for name in _MODULES[1:]:
        parent, child = name.rsplit(".", maxsplit=1)
        setattr(sys.modules[parent], child, sys.modules[name])

    def uninstall() -> None:
        for name in made:
            sys.modules.pop(name, None)
        sys.modules.update(before)

    return uninstall


def is_drawn(value: Any) -> bool:
    """Tell whether a value is an expression of these, or a list of them."""
    flat = np.ravel(np.asarray(value, dtype=object)) if isinstance(value, list | np.ndarray) else [value]
    return any(isinstance(x, Expression) for x in flat)


def states_of(names: Iterable[str]) -> dict[str, tuple[str, int]]:
    """Return which entry (from 0) of which quantity symbols are, by their names; others are left out."""
    found: dict[str, tuple[str, int, bool]] = {}
    for name in names:
        vector = re.fullmatch(r"(\w+)\[(\d+)\]", name)
        joint = joint_of(f"{vector[1]}_{vector[2]}" if vector else name)
        if joint is not None:
            found[name] = (*joint, vector is not None)
    # q_0, q_1, ... or q1, q2, ...
    first = 0 if any(k == 0 and not of for _, k, of in found.values()) else 1
    return {name: (letter, k - (0 if of else first)) for name, (letter, k, of) in found.items()}
