"""Forms in which a right model takes and returns arrays: columns, transposes, the rows of a base first.

None of them is a mistake. They are converted, and the report says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import wraps
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array

#: Numbers of joints that are tried where no robot has one.
_JOINTS = range(1, 9)
#: Coordinates of a base that moves, which stand before those of the joints.
BASE = 6
#: A position of every joint [rad or m] at which a function is tried: not singular for most arms.
_TRIED = 0.3
#: Functions that return a square matrix, and those that return a vector.
_MATRICES = ("mass_matrix", "coriolis_matrix")
_VECTORS = ("coriolis_torque", "gravity", "inverse_dynamics", "forward_dynamics")


class Form(NamedTuple):
    """How one function of a model takes and returns arrays.

    Attributes:
        columns: it takes columns of shape (n, 1).
        transposed: it returns the transpose: of a Jacobian, or of a pose.
        base: it returns the rows (and columns) of a base before those of the joints.
    """

    columns: bool = False
    transposed: bool = False
    base: bool = False

    def applied_to(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function in the plain form."""

        @wraps(function)
        def call(*state: Array) -> Any:
            value = function(*map(_column, state)) if self.columns else function(*state)
            if self.transposed:
                value = np.asarray(value).T
            if self.base:
                value = np.asarray(value)
                value = value[BASE:, BASE:] if name in _MATRICES else value.ravel()[BASE:]
            return value

        return call

    def notes(self, name: str) -> Iterator[str]:
        """Yield what is said of it."""
        if self.columns:
            yield f"{name} takes columns of shape (n, 1): it is called with these"
        if self.transposed:
            yield f"{name} returns the transpose (the convention of row vectors): it is transposed"

    def left_out(self, name: str) -> str:
        """Return what of the function is not compared; "" for nothing."""
        return f"the first {BASE} rows of {name}, those of a base" if self.base else ""


def form_of(name: str, function: Callable[..., Any], arguments: int, n: int | None) -> Form:
    """Return the form of a function of so many arguments, of n joints; the plain one where it fails."""
    for columns in (False, True):
        for joints in _JOINTS if n is None else (n,):
            state = [np.full(joints, _TRIED) for _ in range(arguments)]
            with suppress(Exception):  # what it raises is said when it is compared
                value = np.asarray(function(*map(_column, state)) if columns else function(*state))
                if value.dtype.kind not in "iuf" or (columns and not np.isfinite(value).all()):
                    continue
                shape = value.shape
                return Form(
                    columns,
                    _is_transposed(name, value, joints),
                    n is not None and _has_base(name, shape, joints),
                )
    return Form()


def _column(x: Array) -> Array:
    """Return an array of shape (n,) as a column; a copy, as a function may change it."""
    return np.array(x).reshape(-1, 1)


def _is_transposed(name: str, value: Any, n: int) -> bool:
    """Tell whether a value is the transpose of what is expected, by its shape or its last row."""
    if name == "jacobian":
        return value.ndim == 2 and value.shape[0] == n != value.shape[1] and value.shape[1] in (2, 3, 6)
    if name == "forward_kinematics" and value.shape == (4, 4):
        return bool(value[3, 3] == 1.0 and not value[:3, 3].any() and value[3, :3].any())
    return False


def _has_base(name: str, shape: tuple[int, ...], n: int) -> bool:
    """Tell whether a function has the rows of a base beside those of n joints."""
    if name in _MATRICES:
        return shape == (n + BASE, n + BASE)
    return name in _VECTORS and shape in ((n + BASE,), (n + BASE, 1), (1, n + BASE))


def forms_of_jacobian(J: Array) -> Iterable[tuple[str, Array]]:
    """Yield other forms of samples of a Jacobian (N, rows, n), each with what is said of it."""
    if J.shape[1] == J.shape[2]:
        yield "it returns the transpose (the convention of row vectors)", np.swapaxes(J, 1, 2)
    if J.shape[1] == BASE:
        swapped = np.concatenate([J[:, 3:], J[:, :3]], axis=1)
        yield "its first three rows are angular, the last three linear", swapped
        if J.shape[2] == BASE:
            turned = np.swapaxes(J, 1, 2)
            both = np.concatenate([turned[:, 3:], turned[:, :3]], axis=1)
            yield "it returns the transpose, with the angular part first", both


def applied(
    calls: Mapping[str, Callable[..., Any]], arguments: Mapping[str, tuple[str, ...]], n: int | None
) -> tuple[dict[str, Callable[..., Any]], dict[str, Form]]:
    """Return functions in the plain form, and the forms of those that had another one."""
    found, forms = dict(calls), {}
    for name, function in calls.items():
        form = form_of(name, function, len(arguments[name]), n)
        if form != Form():
            forms[name] = form
            found[name] = form.applied_to(name, function)
    return found, forms
