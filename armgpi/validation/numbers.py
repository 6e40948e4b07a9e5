"""Numbers in place of the symbols of SymPy or CasADi: a module of expressions gives its values at once.

SymPy takes a tenth of a second to make functions of expressions, too long where thousands of changes are
tried. A :class:`Number` has a value and knows its derivatives, so that a model may form them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np


class Number:
    """A value that can be differentiated by symbols."""

    __slots__ = ("derivative", "known", "value")

    def __init__(self, value: float, derivative: Callable[[Any], Any] | None = None) -> None:
        """Take a value and what gives its derivative by a symbol, nothing for a symbol itself."""
        self.value = float(value)
        self.known: dict[int, Any] = {}  # derivatives that were formed, by the symbol
        self.derivative = derivative or (lambda x: 1.0 if x is self else 0.0)  # plain numbers, to be left out

    def diff(self, *symbols: Any) -> Any:
        """Return the derivative by one symbol after the other."""
        return diff(self, *symbols)

    def __float__(self) -> float:
        """Return the value."""
        return self.value

    def __neg__(self) -> Number:
        """Return the negative."""
        return Number(-self.value, lambda x: _product(-1.0, _slope(self, x)))

    def __add__(self, other: Any) -> Any:
        """Return a sum."""
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Number(self.value + float(other), lambda x: _sum(_slope(self, x), _slope(other, x)))

    def __mul__(self, other: Any) -> Any:
        """Return a product."""
        if isinstance(other, np.ndarray):
            return NotImplemented

        def derivative(x: Any) -> Any:
            return _sum(_product(_slope(self, x), other), _product(self, _slope(other, x)))

        return Number(self.value * float(other), derivative)

    def __pow__(self, exponent: Any) -> Number:
        """Return a power with a constant exponent."""
        k = float(exponent)
        return Number(self.value**k, lambda x: _product(_slope(self, x), k, lambda: self ** (k - 1.0)))

    def __sub__(self, other: Any) -> Any:
        """Return a difference."""
        return self + (-other)

    def __rsub__(self, other: Any) -> Any:
        """Return a difference."""
        return -self + other

    def __truediv__(self, other: Any) -> Any:
        """Return a quotient."""
        return self * _inverse(other)

    def __rtruediv__(self, other: Any) -> Any:
        """Return a quotient."""
        return _inverse(self) * other

    __radd__, __rmul__ = __add__, __mul__


def diff(value: Any, *symbols: Any) -> Number:
    """Return the derivative of a number; that of a constant is zero."""
    for symbol in symbols:
        value = _slope(value, symbol)
    return value if isinstance(value, Number) else _constant(value)


def _slope(value: Any, symbol: Any) -> Any:
    """Return a derivative, 0.0 itself for a constant."""
    if not isinstance(value, Number):
        return 0.0
    if id(symbol) not in value.known:
        value.known[id(symbol)] = value.derivative(symbol)
    return value.known[id(symbol)]


def _constant(value: Any) -> Number:
    return Number(value, lambda _: 0.0)


def _sum(a: Any, b: Any) -> Any:
    """Return a sum without what is plainly zero: derivatives of derivatives have many zeros."""
    if isinstance(a, float) and a == 0.0:
        return b
    return a if isinstance(b, float) and b == 0.0 else a + b


def _product(a: Any, b: Any, more: Callable[[], Any] = lambda: 1.0) -> Any:
    """Return a product with a factor more, which is not formed where a factor is plainly zero."""
    if any(isinstance(x, float) and x == 0.0 for x in (a, b)):
        return 0.0
    c = more()
    return a * b * c if isinstance(c, Number) else a * b


def _inverse(value: Any) -> Any:
    return value**-1.0 if isinstance(value, Number) else 1.0 / float(value)


def _sin(x: Any) -> Number:
    return Number(math.sin(float(x)), lambda s: _product(_slope(x, s), 1.0, lambda: _cos(x)))


def _cos(x: Any) -> Number:
    return Number(math.cos(float(x)), lambda s: _product(_slope(x, s), -1.0, lambda: _sin(x)))


class Matrix(np.ndarray):
    """A matrix whose product is that of matrices; a list makes a column."""

    def __new__(cls, rows: Any, columns: Any = None, entries: Any = None) -> Matrix:
        """Make it of rows, of a column's entries, or of its size and a function or list of entries."""
        if entries is not None:
            places = np.ndindex(rows, columns)
            flat = [entries(*at) for at in places] if callable(entries) else entries
            rows = np.array(flat, dtype=object).reshape(rows, columns)
        array = np.array(rows, dtype=object)
        for k, x in enumerate(array.flat):
            if not isinstance(x, Number):  # so that every entry has its derivatives
                array.flat[k] = _constant(x)
        return (array[:, np.newaxis] if array.ndim == 1 else array).view(cls)

    def __getitem__(self, index: Any) -> Any:
        """Return entries; a single index counts through the rows."""
        return self.ravel().view(np.ndarray)[index] if isinstance(index, int) else super().__getitem__(index)

    def __mul__(self, other: Any) -> Any:
        """Return a product."""
        return self @ other if isinstance(other, Matrix) else super().__mul__(other)

    def diff(self, symbol: Any) -> Any:
        """Return the derivative of every entry."""
        return Matrix([[diff(x, symbol) for x in row] for row in self.view(np.ndarray)])

    def jacobian(self, symbols: Any) -> Any:
        """Return the derivatives of a column by several symbols."""
        return Matrix([[diff(x, s) for s in np.ravel(symbols)] for x in np.ravel(self)])


class Grid(Matrix):
    """A matrix of CasADi: its product is that of the entries, and a single index counts down the columns."""

    def __getitem__(self, index: Any) -> Any:
        """Return entries."""
        return (
            self.T.ravel().view(np.ndarray)[index] if isinstance(index, int) else super().__getitem__(index)
        )

    def __mul__(self, other: Any) -> Any:
        """Return a product of the entries."""
        return np.ndarray.__mul__(self, other)

    def __matmul__(self, other: Any) -> Any:
        """Return a product of matrices; one with a single entry is a factor."""
        if isinstance(other, np.ndarray) and min(self.size, other.size) > 1:
            return np.ndarray.__matmul__(self, other)
        return self * other


def _grid(x: Any) -> Any:
    return x if isinstance(x, Grid) else Grid(np.atleast_2d(np.array(x, dtype=object)))


def _stack_along(axis: int) -> Callable[..., Grid]:
    return lambda *parts: Grid(np.concatenate([_grid(x).view(np.ndarray) for x in parts], axis=axis))


def _each(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda x: Grid([[function(y) for y in row] for row in x]) if isinstance(x, Grid) else function(x)


def _casadi(values: Mapping[str, Number]) -> SimpleNamespace:
    """Return what computes with numbers as CasADi does with symbols."""

    def sym(name: str, rows: int = 1, columns: int = 1) -> Any:
        if name in values:
            return values[name]
        return Grid(np.array([values[f"{name}_{k}"] for k in range(rows * columns)], dtype=object))

    def jacobian(value: Any, symbols: Any) -> Grid:
        return Grid([[diff(x, s) for s in np.ravel(_grid(symbols))] for x in _grid(value).T.ravel()])

    def zeros(*shape: int) -> Grid:
        return Grid(np.zeros(shape if len(shape) > 1 else (*shape, 1)))

    def hessian(value: Any, symbols: Any) -> tuple[Grid, Grid]:
        slope = jacobian(value, symbols).T
        return jacobian(slope, symbols), slope

    def multiply(a: Any, b: Any) -> Any:
        return a @ b if isinstance(a, Grid) else a * b

    kind = SimpleNamespace(sym=sym, zeros=zeros, eye=lambda n: Grid(np.eye(n)))
    return SimpleNamespace(
        SX=kind,
        MX=kind,
        sin=_each(_sin),
        cos=_each(_cos),
        sqrt=_each(lambda x: x**0.5),
        vertcat=_stack_along(0),
        horzcat=_stack_along(1),
        jacobian=jacobian,
        gradient=lambda value, symbols: jacobian(value, symbols).T,
        hessian=hessian,
        jtimes=lambda value, symbols, v: jacobian(value, symbols) @ v,
        mtimes=multiply,
        dot=lambda a, b: sum(x * y for x, y in zip(np.ravel(a), np.ravel(b), strict=True)),
        sumsqr=lambda a: sum(x * x for x in np.ravel(a)),
        transpose=lambda a: a.T,
        diag=lambda a: Grid(np.diag(np.ravel(a))),
        simplify=lambda a: a,
        pi=math.pi,
    )


def namespace(space: Mapping[str, Any], values: Mapping[str, Number]) -> dict[str, Any]:
    """Return a module's names with numbers in place of its symbols, and what computes with them."""

    def symbols(text: Any, **_: Any) -> Any:
        found = [values[name] for name in str(text).replace(",", " ").split()]
        return found if len(found) > 1 else found[0]

    known: dict[str, Any] = {
        "sin": _sin,
        "cos": _cos,
        "sqrt": lambda x: x**0.5,
        "diff": diff,
        "symbols": symbols,
        "Symbol": symbols,
        "Matrix": Matrix,
        "zeros": lambda *shape: Matrix(np.zeros(shape if len(shape) > 1 else shape * 2)),
        "eye": lambda n: Matrix(np.eye(n)),
        "Rational": lambda a, b=1: a / b,
        "pi": math.pi,
        **{name: lambda x: x for name in ("simplify", "expand", "trigsimp", "factor")},
    }
    changed, casadi = dict(space), _casadi(values)
    for name, value in space.items():
        if isinstance(value, ModuleType) and value.__name__ == "casadi":
            changed[name] = casadi
        elif getattr(value, "__module__", "").startswith("casadi") and hasattr(casadi, name):
            changed[name] = getattr(casadi, name)
        elif isinstance(value, ModuleType) and value.__name__ == "sympy":
            changed[name] = SimpleNamespace(**known)
        elif getattr(value, "__module__", "").startswith("sympy") and name in known:
            changed[name] = known[name]
        elif getattr(value, "is_Symbol", False):
            changed[name] = values.get(value.name, value)
    return changed
