"""Checks of array arguments at the public boundary: shape, dtype and finiteness.

Pinocchio silently misreads big-endian arrays, accepts NaN and converts integers and bools without a
word, so nothing reaches it unchecked. Inside the package arrays are trusted.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import UnionType
from typing import Any

import numpy as np
import numpy.typing as npt

from armgpi.errors import ArrayError, NameNotFound, ParameterError, show_value

#: A native float64 array.
Array = npt.NDArray[np.float64]
#: What public functions accept: a float64 array, or plain (nested) lists of Python numbers.
ArrayLike = npt.ArrayLike
#: Largest size of a number that is taken, and smallest one of a number that has to be above zero: the fifth
#: powers that gains are made of, and products of those, are then finite.
LARGEST, SMALLEST = 1e30, 1e-30
#: What a per-joint parameter may be: a number, or an array that broadcasts against (n,).
PerJointInput = npt.ArrayLike


def as_float_array(value: Any, name: str, infinite: bool = False) -> Array:
    """Return `value` as a finite, C-contiguous, native float64 array of any shape.

    Args:
        value: a native float64 array, or a Python number, or (nested) lists of them.
        name: name of the argument, for the message.
        infinite: whether infinity is accepted, as for no limit.

    Raises:
        ArrayError: when it is an array of another dtype or byte order, not numeric, ragged, or holds
            NaN or infinity.
    """
    array = _convert(value, name)
    _check_finite(np.where(np.isinf(array), 0.0, array) if infinite else array, name)
    return array


def as_sized_array(value: Any, name: str, infinite: bool = False) -> Array:
    """Return `value` as :func:`as_float_array` does, refusing numbers beyond `LARGEST` as well."""
    array = as_float_array(value, name, infinite)
    beyond = np.abs(array) > LARGEST
    if infinite:
        beyond &= np.isfinite(array)
    if beyond.any():
        raise ArrayError(name, f"expected numbers up to {LARGEST:g} in size, got {array[beyond].flat[0]:g}")
    return array


def as_times(t: Any, infinite: bool = True) -> Any:
    """Return a time or times [s] as an array, symbols of generated code as they are.

    Raises:
        ArrayError: when it is not a number, NaN, or infinite where a time must be finite.
    """
    if type(t) is float and -LARGEST <= t <= LARGEST:
        return np.array(t)  # the most frequent case: one sample of a loop
    if hasattr(t, "__array_ufunc__") and not isinstance(t, np.ndarray | np.generic):
        return t
    if isinstance(t, np.ndarray) and t.dtype.kind in "iuf":
        t = t.astype(np.float64)
    # Beyond that nothing that ends goes on, and products stay finite.
    return np.clip(as_float_array(t, "t", infinite), -LARGEST, LARGEST)


def is_listing(value: Any) -> bool:
    """Tell whether something is a list of things: a sequence or an array, but no text and no lone number."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def check_type(value: Any, name: str, kind: type | UnionType, expected: str) -> None:
    """Refuse what is no `kind`.

    Raises:
        ParameterError: when it is something else.
    """
    if not isinstance(value, kind):
        raise ParameterError(name, value, expected)


def as_number(value: Any, name: str, infinite: bool = False) -> float:
    """Return `value` as a single float; arguments and errors as :func:`as_sized_array`."""
    array = as_sized_array(value, name, infinite)
    if array.ndim:
        raise ArrayError(name, f"expected one number, got shape {array.shape}")
    return float(array)


def as_joint_array(value: Any, name: str, joint_names: Sequence[str]) -> Array:
    """Return `value` as a float64 array of shape (n,) or (batch, n), its last axis the joints.

    Args:
        value: array-like of that shape.
        name: name of the argument, for the message.
        joint_names: names of the n joints.

    Raises:
        ArrayError: as :func:`as_float_array` (a value that is not finite is reported with its joint's
            name), and when the shape is another one.
    """
    array = _convert(value, name)
    n = len(joint_names)
    if array.ndim not in (1, 2) or array.shape[-1] != n:
        raise ArrayError(
            name,
            f"expected shape ({n},) or (batch, {n}) for the joints {', '.join(joint_names)}; "
            f"got {array.shape}",
        )
    _check_finite(array, name, joint_names)
    if np.abs(array).max(initial=0.0) > LARGEST:
        raise ArrayError(name, f"expected numbers up to {LARGEST:g} in size, got {np.abs(array).max():g}")
    return array


def per_joint(value: Any, name: str, joint_names: Sequence[str], expected: str, ok: Check) -> Array:
    """Return a parameter given as a scalar, (n,) or (batch, n) as an array that broadcasts over joints.

    Args:
        value: a number, or an array-like that broadcasts against (n,).
        name: name of the parameter, for the message.
        joint_names: names of the n joints.
        expected: what the values have to be, in words ("positive").
        ok: function that tells, for an array, which elements are as expected.

    Raises:
        ArrayError: when the shape does not fit or a value is not as expected; it names the joint.
    """
    array = as_float_array(value, name)
    n = len(joint_names)
    if array.ndim > 2 or (array.ndim and array.shape[-1] not in (1, n)) or not array.size:
        raise ArrayError(name, f"expected a number or shape ({n},) or (batch, {n}), got {array.shape}")
    array = np.ascontiguousarray(np.broadcast_to(array, (*array.shape[:-1], n)))
    good = ok(array) & (np.abs(array) <= LARGEST)
    if not good.all():
        index = tuple(int(i) for i in np.argwhere(~good)[0])
        raise ArrayError(
            name,
            f"expected {expected} values{sizes(array[index])}, got {array[index]:g} for joint "
            f"{joint_names[index[-1]]!r}",
        )
    return array


def quantity(
    value: Any,
    name: str,
    joint_names: Sequence[str],
    default: Array | float | None = None,
    infinite: bool = False,
) -> Array:
    """Return a per-joint quantity given as a number, a list or a mapping as an array (n,).

    Args:
        value: a number for all joints, one per joint, or joint -> number.
        name: name of the quantity, for the message.
        joint_names: names of the n joints.
        default: what joints get that a mapping leaves out; None when it must name them all.
        infinite: whether infinity is as good as a number here.

    Raises:
        ArrayError: when the number of numbers is another one, or joints are left out.
        NameNotFound: when a mapping names a joint that does not exist.
    """
    n = len(joint_names)
    if not isinstance(value, Mapping):
        array = as_sized_array(value, name, infinite)
        if array.shape not in ((), (n,)):
            raise ArrayError(name, f"expected {n} numbers ({', '.join(joint_names)}), got {array.size}")
        return np.array(np.broadcast_to(array, (n,)))
    for joint in value:
        if joint not in joint_names:
            raise NameNotFound("joint", joint, joint_names)
    missing = [joint for joint in joint_names if joint not in value]
    if missing and default is None:
        raise ArrayError(name, f"needs a value for {', '.join(missing)} as well")
    filled = np.array(np.broadcast_to(0.0 if default is None else default, (n,)), dtype=np.float64)
    for joint, number in value.items():
        filled[list(joint_names).index(joint)] = as_number(number, f"{name}[{joint!r}]", infinite)
    return filled


def check_choice(value: Any, name: str, choices: Collection[str]) -> None:
    """Refuse what is none of some names.

    Raises:
        ParameterError: when it is something else.
    """
    if not (isinstance(value, str) and value in choices):
        raise ParameterError(name, value, f"one of {', '.join(choices)}")


def check_path(value: Any, name: str) -> Path:
    """Return the path of a file or folder, given as text or as a path.

    Raises:
        ParameterError: when it is none.
    """
    with suppress(TypeError, ValueError):
        text = os.fsdecode(value)
        if b"\0" not in os.fsencode(text):
            return Path(text)
    raise ParameterError(name, value, "a path")


#: Makes a NamedTuple, ``new(Kind, (a, b))``, in half the time of ``Kind(a, b)``: for the control loop.
new = tuple.__new__

#: A predicate over the elements of an array.
Check = Callable[[Array], npt.NDArray[np.bool_]]


def positive(array: Array) -> npt.NDArray[np.bool_]:
    """Tell which elements are above zero, and not too small to divide by."""
    return array >= SMALLEST


def not_negative(array: Array) -> npt.NDArray[np.bool_]:
    """Tell which elements are zero or above."""
    return array >= 0.0


def check_number(
    value: Any, name: str, expected: str, lowest: float = 0.0, highest: float = math.inf, open_: bool = False
) -> float:
    """Return a parameter as a float from `lowest` to `highest`, no larger than `LARGEST`.

    Args:
        value: the number.
        name: name of the parameter, for the message.
        expected: what it has to be, in words and with its unit.
        lowest: smallest value.
        highest: largest value.
        open_: whether `lowest` itself is too small; what has to be above zero is at least `SMALLEST`.

    Raises:
        ParameterError: when it is not a number, not finite, outside, too large or too small.
    """
    number = math.nan
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        with suppress(OverflowError):  # of an int beyond all floats
            number = float(value)
    if open_:
        lowest = SMALLEST if lowest == 0.0 else math.nextafter(lowest, math.inf)
    if not max(lowest, -LARGEST) <= number <= min(highest, LARGEST):
        raise ParameterError(name, value, f"{expected}{sizes(number)}")
    return number


def check_whole(value: Any, name: str, lowest: int, highest: int = 2**63 - 1) -> int:
    """Return a parameter as an int from `lowest` to `highest`.

    Raises:
        ParameterError: when it is no whole number, or outside.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not lowest <= value <= highest:
        bound = f"at least {lowest}" if highest == 2**63 - 1 else f"from {lowest} to {highest}"
        raise ParameterError(name, value, f"a whole number, {bound}")
    return int(value)


def frozen(array: Array) -> Array:
    """Return a read-only copy of `array`."""
    copy = np.array(array, dtype=np.float64, copy=True)
    copy.setflags(write=False)
    return copy


def _convert(value: Any, name: str) -> Array:
    """Return `value` as a C-contiguous native float64 array, or refuse it."""
    if isinstance(value, np.ndarray) and value.dtype != np.float64:
        raise ArrayError(
            name,
            f"expected a native float64 array, got dtype {value.dtype.str!r}; "
            "convert it with x.astype(np.float64)",
        )
    try:
        if _holds_other_than_numbers(value):
            raise ArrayError(name, f"expected numbers, got {show_value(value)}")
        array = np.ascontiguousarray(value, dtype=np.float64).reshape(np.shape(value))
    except ArrayError:
        raise
    except Exception as error:  # of NumPy, or of an object of the user's that says it is an array
        raise ArrayError(name, f"expected an array of numbers, got {show_value(value)} ({error})") from None
    return array


def sizes(number: float) -> str:
    """Return what a number beyond what is taken should have been, empty for another one."""
    good = number == 0.0 or SMALLEST <= abs(number) <= LARGEST or not math.isfinite(number)
    return "" if good else f", from {SMALLEST:g} to {LARGEST:g} in size"


def _check_finite(array: Array, name: str, joint_names: Sequence[str] | None = None) -> None:
    """Refuse NaN and infinity, with the place of the first one."""
    finite = np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])  # empty for a lone number
        place = f"{name}[{', '.join(map(str, index))}]" if index else name
        joint = f" (joint {joint_names[index[-1]]!r})" if joint_names is not None else ""
        raise ArrayError(name, f"expected finite numbers, got {place} = {array[index]}{joint}")


def _holds_other_than_numbers(value: Any) -> bool:
    """Tell whether lists hold a bool, text, date or complex number, which NumPy converts silently."""
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.kind not in "iuf"
    if isinstance(value, list | tuple):
        return any(_holds_other_than_numbers(item) for item in value)
    return isinstance(value, bool | str | bytes)
