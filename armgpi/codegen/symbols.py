"""Arrays of symbols that NumPy's functions accept, so that a law for numbers can be traced.

A :class:`Symbols` goes through the same functions as an array of floats. What comes out are the expressions
that were worked out on the way. What a value decides (``if``, an index, a loop that stops) has no expression,
and ends in :class:`NotElementwise`.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import lru_cache
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from armgpi.codegen.algebra import ca
from armgpi.errors import ArmgpiError

#: Arrays of :class:`Scalar` and floats.
Scalars = npt.NDArray[Any]


class NotElementwise(ArmgpiError):
    """A law does what a straight line of arithmetic cannot."""


# Why not arrays of ca.SX: NumPy makes bools of what < and == give, and has no isfinite or rint for objects.


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
        _numbers(self)
        return Scalar(ca.SX.unary(ca.OP_NEG, self.sx))

    def __pos__(self) -> Scalar:
        """Return the same."""
        return self

    def __abs__(self) -> Scalar:
        """Return the absolute value."""
        _numbers(self)
        return Scalar(ca.SX.unary(ca.OP_FABS, self.sx))

    def __pow__(self, power: Any) -> Any:
        """Return a whole power by multiplication, as NumPy's answer is one rounding from it."""
        _numbers(self)
        # C's pow differs between libraries in the last place; products do not.
        if isinstance(power, int | float) and power == int(power) and 0 < power <= 16:
            result: Any = None
            base, left = self, int(power)
            while left:
                if left & 1:
                    result = base if result is None else result * base
                base, left = base * base, left >> 1
            return result
        raise NotElementwise(f"it raises to the power {power!r}; C has powers from 1 to 16, and np.sqrt")

    def __mod__(self, other: Any) -> Any:
        """Return the remainder with the sign of the divisor, as Python's."""
        return _remainder(self, other) if _is_one(other) else NotImplemented


class Bool(Scalar):
    """What is true or false, as NumPy's bool: its sums and bits are other ones than those of numbers."""

    __slots__ = ()


# Tuples, made once: these are asked for every operation.
_ONES = (Scalar, int, float, np.number)
_BOOLS = (Bool, bool, np.bool_)


def _is_one(x: Any) -> bool:
    """Tell one number from an array, whose operators work through its entries."""
    return isinstance(x, _ONES)


def _sx(x: Any) -> Any:
    """Return a scalar's expression, or that of a number."""
    if isinstance(x, Scalar):
        return x.sx
    number = float(x)
    return _constant(number) if number else ca.SX(number)  # zeros, of which there are two, are alike as keys


@lru_cache(maxsize=1 << 14)
def _constant(number: float) -> Any:
    """Return the expression of a number."""
    return ca.SX(number)


def is_bool(x: Any) -> bool:
    """Tell booleans from numbers."""
    return isinstance(x, _BOOLS)


def _numbers(*operands: Any) -> None:
    """Refuse arithmetic on booleans alone: NumPy's has one bit (True + True is True)."""
    if all(map(is_bool, operands)):
        raise NotElementwise("it does arithmetic on booleans (multiply them by 1.0 before)")


def _booleans(*operands: Any) -> None:
    """Refuse operations on the bits of numbers."""
    if not all(is_bool(x) for x in operands):
        raise NotElementwise("it works on the bits of numbers (&, |, ~)")


def _free(*operands: Any) -> None:
    """Take any operands."""


def _lift(
    function: Callable[..., Any], code: int, kind: Any = Scalar, check: Callable[..., None] = _numbers
) -> Callable[..., Any]:
    """Return a function of one or two numbers as one of scalars as well; `kind` is what it gives.

    Of scalars it is the operation of CasADi's with a `code`. CasADi's operators and functions, which look for
    what they are given, take ten times as long.
    """

    def apply(*operands: Any) -> Any:
        check(*operands)
        if any(isinstance(x, Scalar) for x in operands):
            make = ca.SX.unary if len(operands) == 1 else ca.SX.binary
            return kind(make(code, *map(_sx, operands)))
        return (bool if kind is Bool else float)(function(*map(float, operands)))

    return apply


def _product(a: Any, b: Any) -> Any:
    """Return a b; zeros and ones, of which a model is full, never become an expression."""
    _numbers(a, b)
    # Though NaN times 0 is NaN: a NaN shows where it came from.
    for x, y in ((a, b), (b, a)):
        if not isinstance(x, Scalar) and isinstance(y, Scalar) and x in (0.0, 1.0):
            return _number(y) if x == 1.0 else 0.0
    return _multiply(a, b)


def _sum(a: Any, b: Any) -> Any:
    """Return a + b, without an expression where one is zero."""
    _numbers(a, b)
    if not isinstance(a, Scalar) and a == 0.0:
        return _number(b)
    return _number(a) if not isinstance(b, Scalar) and b == 0.0 else _add(a, b)


def _difference(a: Any, b: Any) -> Any:
    """Return a - b, without an expression where b is zero."""
    _numbers(a, b)
    return _number(a) if not isinstance(b, Scalar) and b == 0.0 else _subtract(a, b)


_less = _lift(operator.lt, ca.OP_LT, Bool, _free)
_not_above = _lift(operator.le, ca.OP_LE, Bool, _free)
_equal = _lift(operator.eq, ca.OP_EQ, Bool, _free)
_unequal = _lift(operator.ne, ca.OP_NE, Bool, _free)
# What these are for has checked the operands.
_multiply = _lift(operator.mul, ca.OP_MUL, check=_free)
_add = _lift(operator.add, ca.OP_ADD, check=_free)
_subtract = _lift(operator.sub, ca.OP_SUB, check=_free)
_divide = _lift(operator.truediv, ca.OP_DIV, check=_free)
_modulo = _lift(ca.fmod, ca.OP_FMOD)
_lower, _higher = _lift(ca.fmin, ca.OP_FMIN), _lift(ca.fmax, ca.OP_FMAX)


def _number(x: Any) -> Any:
    """Return a boolean as the number that it is, and a number as it is."""
    return Scalar(x.sx) if isinstance(x, Bool) else x


def _remainder(a: Any, b: Any) -> Any:
    """Return the remainder with the sign of the divisor, of the exact quotient as NumPy's."""
    rest = _modulo(a, b)
    # fmod has the sign of the dividend.
    other = _both(_unequal(rest, 0.0), _unequal(_less(rest, 0.0), _less(b, 0.0)))
    return select(other, rest + b, rest)


def rint(x: Scalar) -> Scalar:
    """Return the nearest whole number: what is left of x without its remainder in [-1/2, 1/2]."""
    return Scalar(x.sx - ca.remainder(x.sx, 1.0))


def select(condition: Any, yes: Any, no: Any) -> Any:
    """Return `yes` where the condition holds, else `no`."""
    kind: Any = Bool if is_bool(yes) and is_bool(no) else Scalar
    if not isinstance(condition, Scalar):
        return yes if condition else no
    # Both ways the same number, as in laws where an option is off: no need to decide.
    if not isinstance(yes, Scalar) and not isinstance(no, Scalar) and float(yes) == float(no):
        return yes
    return kind(ca.if_else(condition.sx, _sx(yes), _sx(no)))


_both = _lift(ca.logic_and, ca.OP_AND, Bool, _free)
_either = _lift(ca.logic_or, ca.OP_OR, Bool, _free)
_not = _lift(ca.logic_not, ca.OP_NOT, Bool, _free)


#: What NumPy's functions are on one scalar.
_ELEMENTWISE: dict[Any, Callable[..., Any]] = {
    np.add: _sum,
    np.subtract: _difference,
    np.multiply: _product,
    np.true_divide: _divide,
    np.minimum: _lower,
    np.maximum: _higher,
    np.less: _less,
    np.less_equal: _not_above,
    np.greater: lambda a, b: _less(b, a),
    np.greater_equal: lambda a, b: _not_above(b, a),
    np.equal: _equal,
    np.not_equal: _unequal,
    np.logical_and: _both,
    np.logical_or: _either,
    np.logical_not: _not,
    np.bitwise_and: _lift(ca.logic_and, ca.OP_AND, Bool, _booleans),
    np.bitwise_or: _lift(ca.logic_or, ca.OP_OR, Bool, _booleans),
    np.invert: _lift(ca.logic_not, ca.OP_NOT, Bool, _booleans),
    np.power: operator.pow,
    np.remainder: _remainder,
    np.fmod: _modulo,
    np.negative: _lift(operator.neg, ca.OP_NEG),
    np.positive: _lift(operator.pos, ca.OP_ASSIGN),
    np.absolute: _lift(ca.fabs, ca.OP_FABS),
    np.fabs: _lift(ca.fabs, ca.OP_FABS),
    np.square: lambda x: x * x,
    np.sin: _lift(ca.sin, ca.OP_SIN),
    np.cos: _lift(ca.cos, ca.OP_COS),
    np.sqrt: _lift(ca.sqrt, ca.OP_SQRT),
    np.exp: _lift(ca.exp, ca.OP_EXP),
    np.log: _lift(ca.log, ca.OP_LOG),
    np.tan: _lift(ca.tan, ca.OP_TAN),
    np.tanh: _lift(ca.tanh, ca.OP_TANH),
    np.arctan: _lift(ca.atan, ca.OP_ATAN),
    np.floor: _lift(ca.floor, ca.OP_FLOOR),
    np.rint: lambda x: rint(x) if isinstance(x, Scalar) else float(np.rint(x)),
    np.sign: _lift(ca.sign, ca.OP_SIGN),
    np.isfinite: lambda x: _less(abs(x), math.inf),
}
_VECTORISED = {ufunc: np.frompyfunc(f, ufunc.nin, 1) for ufunc, f in _ELEMENTWISE.items()}
_SELECT = np.frompyfunc(select, 3, 1)
_COUNTED = np.frompyfunc(lambda x: _number(x) if isinstance(x, Scalar) else float(x), 1, 1)


class Symbols(np.lib.mixins.NDArrayOperatorsMixin):
    """An array of expressions.

    Attributes:
        x: the expressions, an array of objects.
    """

    __hash__ = None  # type: ignore[assignment]
    # NumPy's arrays leave their operators to this class.
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
        return _wrap(self.x[index])

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
        """Refuse: these are not numbers."""
        # Else NumPy would make an array of objects, and go on with Python's operators where it can.
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
        # reduce, accumulate and outer have orders of their own, in which NumPy adds pairwise, say.
        if method != "__call__" or set(keywords) - {"dtype", "out"} or not _is_float(keywords.get("dtype")):
            raise NotElementwise(f"it uses np.{ufunc.__name__} in a way that has no expression")
        if ufunc is not np.matmul and ufunc not in _VECTORISED:
            raise NotElementwise(f"it uses np.{ufunc.__name__}, which the generator does not know")
        result = np.matmul(*arrays) if ufunc is np.matmul else _VECTORISED[ufunc](*arrays)
        (out,) = keywords.get("out", (None,))
        if out is None:
            return _wrap(result)
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
    # As objects they are Python floats, whose arithmetic is float64's.
    return np.asarray(x).astype(object)


def _wrap(x: Any) -> Symbols:
    """Return what a function of object arrays gave as symbols; a scalar becomes an array without axes."""
    if not isinstance(x, np.ndarray):
        scalar = np.empty((), dtype=object)
        scalar[()] = x
        x = scalar
    return Symbols(x)


def _is_float(dtype: Any) -> bool:
    """Tell whether a type of numbers, None when not given, is the one of symbols."""
    return dtype is None or np.dtype(dtype) == np.float64


def _fill(x: Symbols, value: float, dtype: Any) -> Symbols:
    """Return so many numbers, all the same."""
    if not _is_float(dtype) or (dtype is None and any(map(is_bool, x.x.ravel()))):
        raise NotElementwise("it makes an array of another type than float64")
    return Symbols(np.full(x.shape, value, dtype=object))


def _as_it_is(x: Symbols, dtype: Any = None) -> Symbols:
    """Return an array that is made no other."""
    if not _is_float(dtype):
        raise NotElementwise("it makes an array of another type than float64")
    return x


def _round(x: Any, decimals: int = 0) -> Any:
    """Return whole numbers."""
    if decimals != 0:
        raise NotElementwise(f"it rounds to {decimals} decimals")
    return np.rint(x)


#: What no pivot of an inertia matrix is below [kg m^2 or kg], and what no entry of its factor L is beyond.
_LEAST_PIVOT, _MOST_FACTOR = 1e-12, 1e9


def _clip_factor(x: Any, bounded: bool) -> Any:
    """Return a factor, within bounds that those of an arm never reach."""
    return _lower(_higher(x, -_MOST_FACTOR), _MOST_FACTOR) if bounded else x


def solve(matrix: Scalars, column: Scalars, bounded: bool = False) -> Scalars:
    """Return matrix^-1 column for a symmetric, positive definite matrix, by its factors L D L'.

    They are taken from the last row up: for an arm without branches no order is better.

    Args:
        matrix: the matrix, (n, n).
        column: the column, (n,).
        bounded: whether to hold pivots and factors within bounds that those of an arm never reach, so that a
            proof by intervals, which does not see that the matrix is positive definite, finds no overflow.
    """
    n = len(column)
    below: Any = matrix.copy()
    inverse = [None] * n
    x = list(column)
    for j in range(n):
        for k in range(j):
            below[j, j] = below[j, j] - below[j, k] * below[k, j]
        if bounded:
            below[j, j] = _higher(below[j, j], _LEAST_PIVOT)
        inverse[j] = 1.0 / below[j, j]
        for i in range(j + 1, n):
            for k in range(j):
                below[i, j] = below[i, j] - below[i, k] * below[k, j]
            # Above the diagonal the column before it is divided: D L' there, L below.
            below[j, i] = below[i, j]
            below[i, j] = _clip_factor(below[i, j] * inverse[j], bounded)
    for i in range(n):
        for k in range(i):
            x[i] = x[i] - below[i, k] * x[k]
    x = [value * pivot for value, pivot in zip(x, inverse, strict=True)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            x[i] = x[i] - below[k, i] * x[k]
    return np.array(x, dtype=object)


def _solve(matrix: Any, column: Any) -> Symbols:
    """Solve for symmetric, positive definite matrices, which is all that the laws here have."""
    a, b = _objects(matrix), _objects(column)
    if b.ndim == 2 and b.shape[1] == 1:
        return Symbols(solve(a, b[:, 0])[:, None])
    raise NotElementwise("it solves for several columns at once")


# Those that laws here use; what is not among them is refused by name, and never done in another way.
_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: lambda c, x, y: _wrap(_SELECT(_objects(c), _objects(x), _objects(y))),
    # In NumPy's order: where low is above high the answer is high.
    np.clip: lambda x, low, high: np.minimum(np.maximum(x, low), high),
    np.zeros_like: lambda x, dtype=None: _fill(x, 0.0, dtype),
    np.ones_like: lambda x, dtype=None: _fill(x, 1.0, dtype),
    np.broadcast_to: lambda x, shape: Symbols(np.broadcast_to(_objects(x), shape)),
    np.ascontiguousarray: _as_it_is,
    np.round: _round,
    np.shape: lambda x: x.shape,
    np.ndim: lambda x: x.ndim,
    np.concatenate: lambda xs, axis=0: Symbols(np.concatenate([_objects(x) for x in xs], axis=axis)),
    np.stack: lambda xs, axis=0: Symbols(np.stack([_objects(x) for x in xs], axis=axis)),
    np.linalg.solve: _solve,
    np.sum: lambda x, axis=None: _wrap(np.sum(_COUNTED(_objects(x)), axis=axis)),
    np.dot: lambda a, b: _wrap(np.dot(_objects(a), _objects(b))),
}


def flat(x: Any) -> list[Any]:
    """Return the CasADi expressions of symbols or numbers, in order."""
    return [_sx(value) for value in np.ravel(cast(Any, _objects(x)))]
