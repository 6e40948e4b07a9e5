"""Forms in which a right model takes and returns arrays: columns, transposes, the rows of a base first.

None of them is a mistake. They are converted, and the report says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import update_wrapper
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array

#: Coordinates of a base that moves, which stand before those of the joints.
BASE = 6
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

    def notes(self, name: str) -> Iterator[str]:
        """Yield what is said of it."""
        if self.columns:
            yield f"{name} takes columns of shape (n, 1): it is called with these"
        if self.transposed:
            yield f"{name} returns the transpose (the convention of row vectors): it is transposed"

    def left_out(self, name: str) -> str:
        """Return what of the function is not compared; "" for nothing."""
        return f"the first {BASE} rows of {name}, those of a base" if self.base else ""


class Adapted:
    """A function of a model in the plain form; which one it has is seen when it is called first.

    Attributes:
        form: its form, None until it was called.
    """

    def __init__(self, name: str, function: Callable[..., Any], with_base: bool) -> None:
        """Take the name of a function, the function, and whether its joints are counted without a base."""
        self._name = name
        self._function = function
        self._with_base = with_base
        self.form: Form | None = None
        update_wrapper(self, function, updated=())

    def __call__(self, *state: Array) -> Any:
        """Return what it gives for arrays of shape (n,)."""
        if self.form is None:
            return self._first(*state)
        arguments = map(_column, state) if self.form.columns else state
        return self._plain(self._function(*arguments))

    def _first(self, *state: Array) -> Any:
        """Return what it gives, and keep which form it has."""
        n = len(state[0])
        columns = [_column(x) for x in state]
        try:
            value = self._function(*state)
            self.form = self._form_of(value, n, columns=False)
        except Exception:
            with suppress(Exception):  # the first one is said
                value = self._function(*columns)
                form = self._form_of(value, n, columns=True)
                if self._is_expected(_shape_of(value), form, n):
                    self.form = form
                    return self._plain(value)
            raise
        return self._plain(value)

    def _form_of(self, value: Any, n: int, columns: bool) -> Form:
        shape = _shape_of(value)
        base = self._with_base and _has_base(self._name, shape, n)
        transposed = _is_transposed(self._name, value, shape, n)
        return Form(columns, transposed, base)

    def _is_expected(self, shape: tuple[int, ...], form: Form, n: int) -> bool:
        """Tell whether a function of columns returns something of as many joints."""
        if form.base or form.transposed or n in shape:
            return True
        return self._name not in (*_MATRICES, *_VECTORS)

    def _plain(self, value: Any) -> Any:
        """Return what it gave in the plain form."""
        form = self.form
        if form is None or not (form.transposed or form.base):
            return value
        array = np.asarray(value)
        if form.transposed:
            array = array.T
        if not form.base:
            return array
        if self._name in _MATRICES:
            return array[BASE:, BASE:]
        return array.ravel()[BASE:]


def _column(x: Array) -> Array:
    """Return an array of shape (n,) as a column; a copy, as a function may change it."""
    return np.array(x).reshape(-1, 1)


def _shape_of(value: Any) -> tuple[int, ...]:
    """Return the shape of a value, () where it has none: what is wrong with it is said elsewhere."""
    try:
        return np.shape(value)
    except Exception:
        return ()


def _is_transposed(name: str, value: Any, shape: tuple[int, ...], n: int) -> bool:
    """Tell whether a value is the transpose of what is expected, by its shape or its last row."""
    if name == "jacobian":
        return shape in ((n, 2), (n, 3), (n, 6)) and shape[1] != n
    if name == "forward_kinematics" and shape == (4, 4):
        pose = np.asarray(value, dtype=np.float64)
        last_row, last_column = pose[3, :3], pose[:3, 3]
        return bool(pose[3, 3] == 1.0 and last_row.any() and not last_column.any())
    return False


def _has_base(name: str, shape: tuple[int, ...], n: int) -> bool:
    """Tell whether a function has the rows of a base beside those of n joints."""
    if name in _MATRICES:
        return shape == (n + BASE, n + BASE)
    count = n + BASE
    return name in _VECTORS and shape in ((count,), (count, 1), (1, count))


def forms_of_jacobian(J: Array) -> Iterable[tuple[str, Array]]:
    """Yield other forms of samples of a Jacobian (N, rows, n), each with what is said of it."""
    if J.shape[1] == J.shape[2]:
        yield "it returns the transpose (the convention of row vectors)", np.swapaxes(J, 1, 2)
    if J.shape[1] == BASE:
        yield "its first three rows are angular, the last three linear", _with_linear_first(J)
        if J.shape[2] == BASE:
            transposed = np.swapaxes(J, 1, 2)
            yield "it returns the transpose, with the angular part first", _with_linear_first(transposed)


def _with_linear_first(J: Array) -> Array:
    """Return samples of Jacobians whose angular rows come first (N, 6, n), with these last."""
    return np.concatenate([J[:, 3:], J[:, :3]], axis=1)


def adapted(calls: Mapping[str, Callable[..., Any]], with_base: bool) -> dict[str, Callable[..., Any]]:
    """Return functions that give what some give in the plain form."""
    return {name: Adapted(name, function, with_base) for name, function in calls.items()}
