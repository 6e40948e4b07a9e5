"""Arrays of symbols that NumPy's functions accept, so that a law written for numbers writes itself down.

A :class:`Symbols` goes through the same functions as an array of floats. What comes out are the expressions
that were worked out on the way. What a value decides (``if``, an index, a loop that stops) has no expression,
and ends in :class:`NotElementwise`.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, cast

import casadi as ca
import numpy as np
import numpy.typing as npt

from armgpi.errors import ArmgpiError

#: Arrays of :class:`Scalar` and floats.
Scalars = npt.NDArray[Any]


class NotElementwise(ArmgpiError):
    """A law does what a straight line of arithmetic cannot."""


class Scalar:
    """One expression: what an array of symbols is made of.

    Attributes:
        sx: the CasADi expression.
    """

    __slots__ = ("sx",)

    def __init__(self, sx: Any) -> None:
        """Wrap a CasADi scalar."""
        self.sx = sx

    def __bool__(self) -> bool:
        """Refuse: the value is not known yet."""
        raise NotElementwise("it decides by the value of a symbol (if, and, or, any, all, sort)")

    def __float__(self) -> float:
        """Refuse: the value is not known yet."""
        raise NotElementwise("it needs the value of a symbol (float, int, an index)")

    __int__ = __index__ = __float__
    __hash__ = None  # type: ignore[assignment]

    def __add__(self, other: Any) -> Any:
        """Return the sum."""
        return _sum(self, other) if _is_one(other) else NotImplemented

    def __sub__(self, other: Any) -> Any:
        """Return the difference."""
        return _difference(self, other) if _is_one(other) else NotImplemented

    def __mul__(self, other: Any) -> Any:
        """Return the product."""
        return _product(self, other) if _is_one(other) else NotImplemented

    def __truediv__(self, other: Any) -> Any:
        """Return the quotient."""
        return _divide(self, other) if _is_one(other) else NotImplemented

    def __radd__(self, other: Any) -> Any:
        """Return the sum."""
        return _sum(other, self) if _is_one(other) else NotImplemented

    def __rsub__(self, other: Any) -> Any:
        """Return the difference."""
        return _difference(other, self) if _is_one(other) else NotImplemented

    def __rmul__(self, other: Any) -> Any:
        """Return the product."""
        return _product(other, self) if _is_one(other) else NotImplemented

    def __rtruediv__(self, other: Any) -> Any:
        """Return the quotient."""
        return _divide(other, self) if _is_one(other) else NotImplemented

    def __lt__(self, other: Any) -> Any:
        """Return whether it is below."""
        return _less(self, other)

    def __le__(self, other: Any) -> Any:
        """Return whether it is not above."""
        return _not_above(self, other)

    def __gt__(self, other: Any) -> Any:
        """Return whether it is above."""
        return _less(other, self)

    def __ge__(self, other: Any) -> Any:
        """Return whether it is not below."""
        return _not_above(other, self)

    def __eq__(self, other: Any) -> Any:
        """Return whether the two are equal."""
        return _equal(self, other)

    def __ne__(self, other: Any) -> Any:
        """Return whether the two differ."""
        return _unequal(self, other)

    def __neg__(self) -> Scalar:
        """Return the negative."""
        return Scalar(-self.sx)

    def __pos__(self) -> Scalar:
        """Return the same."""
        return self

    def __abs__(self) -> Scalar:
        """Return the absolute value."""
        return Scalar(ca.fabs(self.sx))

    def __pow__(self, power: Any) -> Any:
        """Return a whole power by multiplication, as NumPy's answer is one rounding from it."""
        if isinstance(power, int | float) and power == int(power) and 0 < power <= 16:
            result: Any = None
            base, left = self, int(power)
            while left:
                if left & 1:
                    result = base if result is None else result * base
                base, left = base * base, left >> 1
            return result
        raise NotElementwise(f"it raises to the power {power!r}; only whole powers from 1 to 16 are known")

    def __mod__(self, other: Any) -> Scalar:
        """Return the remainder with the sign of the divisor, as Python's."""
        return Scalar(self.sx - ca.floor(self.sx / _sx(other)) * _sx(other))


def _is_one(x: Any) -> bool:
    """Tell one number from an array, whose operators work through its entries."""
    return isinstance(x, Scalar | int | float | np.number)


def _sx(x: Any) -> Any:
    """Return a scalar's expression, or a number as it is."""
    return x.sx if isinstance(x, Scalar) else float(x)


def _binary(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def apply(a: Any, b: Any) -> Any:
        if isinstance(a, Scalar):
            return Scalar(function(a.sx, _sx(b)))
        if isinstance(b, Scalar):
            return Scalar(function(ca.SX(float(a)), b.sx))
        return float(function(float(a), float(b)))

    return apply


def _unary(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def apply(a: Any) -> Any:
        return Scalar(function(a.sx)) if isinstance(a, Scalar) else float(function(a))

    return apply


def _product(a: Any, b: Any) -> Any:
    """Return a b; zeros and ones, of which a model is full, never become an expression."""
    for x, y in ((a, b), (b, a)):
        if not isinstance(x, Scalar) and isinstance(y, Scalar) and x in (0.0, 1.0):
            return y if x == 1.0 else 0.0
    return _multiply(a, b)


def _sum(a: Any, b: Any) -> Any:
    """Return a + b, without an expression where one is zero."""
    if not isinstance(a, Scalar) and a == 0.0:
        return b
    return a if not isinstance(b, Scalar) and b == 0.0 else _add(a, b)


def _difference(a: Any, b: Any) -> Any:
    """Return a - b, without an expression where b is zero."""
    return a if not isinstance(b, Scalar) and b == 0.0 else _subtract(a, b)


_less, _not_above, _equal, _unequal = map(_binary, (operator.lt, operator.le, operator.eq, operator.ne))
_multiply, _add, _subtract, _divide = map(
    _binary, (operator.mul, operator.add, operator.sub, operator.truediv)
)


def rint(x: Scalar) -> Scalar:
    """Return the nearest whole number: what is left of x without its remainder in [-1/2, 1/2]."""
    return Scalar(x.sx - ca.remainder(x.sx, 1.0))


def select(condition: Any, yes: Any, no: Any) -> Any:
    """Return `yes` where the condition holds, else `no`."""
    if not isinstance(condition, Scalar):
        return yes if condition else no
    if not isinstance(yes, Scalar) and not isinstance(no, Scalar) and float(yes) == float(no):
        return yes
    return Scalar(ca.if_else(condition.sx, _sx(yes), _sx(no)))


#: What NumPy's functions are on one scalar.
_ELEMENTWISE: dict[Any, Callable[..., Any]] = {
    np.add: _sum,
    np.subtract: _difference,
    np.multiply: _product,
    np.true_divide: _divide,
    np.minimum: _binary(ca.fmin),
    np.maximum: _binary(ca.fmax),
    np.less: _less,
    np.less_equal: _not_above,
    np.greater: lambda a, b: _less(b, a),
    np.greater_equal: lambda a, b: _not_above(b, a),
    np.equal: _equal,
    np.not_equal: _unequal,
    np.logical_and: _binary(ca.logic_and),
    np.logical_or: _binary(ca.logic_or),
    np.bitwise_and: _binary(ca.logic_and),
    np.bitwise_or: _binary(ca.logic_or),
    np.logical_not: _unary(ca.logic_not),
    np.invert: _unary(ca.logic_not),
    np.power: operator.pow,
    np.remainder: operator.mod,
    np.negative: operator.neg,
    np.positive: operator.pos,
    np.absolute: abs,
    np.fabs: abs,
    np.square: lambda x: x * x,
    np.sin: _unary(ca.sin),
    np.cos: _unary(ca.cos),
    np.sqrt: _unary(ca.sqrt),
    np.exp: _unary(ca.exp),
    np.log: _unary(ca.log),
    np.tan: _unary(ca.tan),
    np.tanh: _unary(ca.tanh),
    np.arctan: _unary(ca.atan),
    np.floor: _unary(ca.floor),
    np.rint: lambda x: rint(x) if isinstance(x, Scalar) else float(np.rint(x)),
    np.sign: _unary(ca.sign),
    np.isfinite: lambda x: _less(abs(x), math.inf),
}
_VECTORISED = {ufunc: np.frompyfunc(f, ufunc.nin, 1) for ufunc, f in _ELEMENTWISE.items()}
_SELECT = np.frompyfunc(select, 3, 1)


class Symbols(np.lib.mixins.NDArrayOperatorsMixin):
    """An array of expressions.

    Attributes:
        x: the expressions, an array of objects.
    """

    __hash__ = None  # type: ignore[assignment]
    __array_priority__ = 1000.0

    def __init__(self, x: Scalars) -> None:
        """Wrap an array of :class:`Scalar` and floats."""
        self.x = x

    @classmethod
    def new(cls, name: str, shape: tuple[int, ...]) -> Symbols:
        """Return new symbols: what is not known yet."""
        x = np.empty(shape, dtype=object)
        for index in np.ndindex(*shape):
            x[index] = Scalar(ca.SX.sym("_".join([name, *map(str, index)])))
        return cls(x)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.x.shape

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return self.x.ndim

    @property
    def size(self) -> int:
        """Number of entries."""
        return self.x.size

    @property
    def T(self) -> Symbols:
        """The array with its axes reversed."""
        return Symbols(self.x.T)

    def __len__(self) -> int:
        """Return the length of the first axis."""
        return len(self.x)

    def __getitem__(self, index: Any) -> Symbols:
        """Return part of the array."""
        return _wrapped(self.x[index])

    def __setitem__(self, index: Any, value: Any) -> None:
        """Replace part of the array."""
        self.x[index] = _objects(value)

    def __bool__(self) -> bool:
        """Refuse: the values are not known yet."""
        raise NotElementwise("it decides by the value of a symbol (if, and, or)")

    def __float__(self) -> float:
        """Refuse: the value is not known yet."""
        raise NotElementwise("it needs the value of a symbol (float, int)")

    def __array__(self, *arguments: Any, **keywords: Any) -> Any:
        """Refuse: this is no array of numbers."""
        raise NotElementwise("it makes an array of numbers out of symbols (np.asarray, np.array)")

    def copy(self) -> Symbols:
        """Return a copy that may be written to."""
        return Symbols(self.x.copy())

    def reshape(self, *shape: Any) -> Symbols:
        """Return the entries in another shape."""
        return Symbols(self.x.reshape(*shape))

    def any(self, *arguments: Any, **keywords: Any) -> Any:
        """Refuse: the values are not known yet."""
        raise NotElementwise("it decides by the values of symbols (any)")

    all = any

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **keywords: Any) -> Any:
        """Apply one of NumPy's elementwise functions."""
        arrays = [_objects(x) for x in inputs]
        if method != "__call__" or set(keywords) - {"dtype", "out"}:
            raise NotElementwise(f"it uses np.{ufunc.__name__} in a way that has no expression")
        if ufunc is not np.matmul and ufunc not in _VECTORISED:
            raise NotElementwise(f"it uses np.{ufunc.__name__}, which the generator does not know")
        result = np.matmul(*arrays) if ufunc is np.matmul else _VECTORISED[ufunc](*arrays)
        (out,) = keywords.get("out", (None,))
        if out is None:
            return _wrapped(result)
        if not isinstance(out, Symbols):
            raise NotElementwise("it writes symbols into an array of numbers")
        out.x[...] = result
        return out

    def __array_function__(self, function: Any, types: Any, arguments: Any, keywords: Any) -> Any:
        """Apply one of NumPy's other functions."""
        if function not in _FUNCTIONS:
            raise NotElementwise(f"it uses np.{function.__name__}, which the generator does not know")
        return _FUNCTIONS[function](*arguments, **keywords)


def _objects(x: Any) -> Any:
    """Return symbols or numbers as an array of scalars and Python floats."""
    if isinstance(x, Symbols):
        return x.x
    if isinstance(x, Scalar):
        return x
    return np.asarray(x).astype(object)


def _wrapped(x: Any) -> Symbols:
    """Return what a function of object arrays gave as symbols; a scalar becomes an array without axes."""
    if not isinstance(x, np.ndarray):
        scalar = np.empty((), dtype=object)
        scalar[()] = x
        x = scalar
    return Symbols(x)


def _solve(matrix: Any, column: Any) -> Symbols:
    """Solve for symmetric, positive definite matrices, which is all that the laws here have."""
    from armgpi.compiled.model import solve

    a, b = _objects(matrix), _objects(column)
    if b.ndim == 2 and b.shape[1] == 1:
        return Symbols(solve(a, b[:, 0])[:, None])
    raise NotElementwise("it solves for several columns at once")


_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: lambda c, x, y: _wrapped(_SELECT(_objects(c), _objects(x), _objects(y))),
    np.clip: lambda x, low, high: np.minimum(np.maximum(x, low), high),
    np.zeros_like: lambda x, dtype=None: Symbols(np.full(x.shape, 0.0, dtype=object)),
    np.ones_like: lambda x, dtype=None: Symbols(np.full(x.shape, 1.0, dtype=object)),
    np.broadcast_to: lambda x, shape: Symbols(np.broadcast_to(_objects(x), shape)),
    np.ascontiguousarray: lambda x, dtype=None: x,
    np.round: lambda x, decimals=0: np.rint(x),
    np.shape: lambda x: x.shape,
    np.ndim: lambda x: x.ndim,
    np.concatenate: lambda xs, axis=0: Symbols(np.concatenate([_objects(x) for x in xs], axis=axis)),
    np.stack: lambda xs, axis=0: Symbols(np.stack([_objects(x) for x in xs], axis=axis)),
    np.linalg.solve: _solve,
    np.sum: lambda x, axis=None: _wrapped(np.sum(_objects(x), axis=axis)),
    np.dot: lambda a, b: _wrapped(np.dot(_objects(a), _objects(b))),
}


def flat(x: Any) -> list[Any]:
    """Return the CasADi expressions of symbols or numbers, in order."""
    return [_sx(value) for value in np.ravel(cast(Any, _objects(x)))]
