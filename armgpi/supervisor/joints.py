"""What is worked out over all joints, elementwise as the generated code is: shapes (n,) or (batch, n)."""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import partial, reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array

#: Which joints, or rollouts (..., 1).
Mask = npt.NDArray[np.bool_]


def _over_joints(combine: Callable[[Any, Any], Any], x: Any) -> Any:
    """Return the joints' numbers combined in their order, shape (1,) or (batch, 1)."""
    return reduce(combine, (x[..., j : j + 1] for j in range(x.shape[-1])))


def any_joint(x: Any) -> Mask:
    """Tell whether a condition holds for any joint, shape (1,) or (batch, 1)."""
    if isinstance(x, np.ndarray) and x.dtype == bool:  # a single call of NumPy; symbols have none
        together: Mask = np.logical_or.reduce(x, axis=-1, keepdims=True)
        return together
    combined: Mask = _over_joints(operator.or_, x)
    return combined


def all_joints(x: Any) -> Mask:
    """Tell whether a condition holds for all joints, shape (1,) or (batch, 1)."""
    if isinstance(x, np.ndarray) and x.dtype == bool:
        together: Mask = np.logical_and.reduce(x, axis=-1, keepdims=True)
        return together
    combined: Mask = _over_joints(operator.and_, x)
    return combined


sum_joints: Callable[[Array], Array] = partial(_over_joints, operator.add)
largest: Callable[[Array], Array] = partial(_over_joints, np.maximum)


def worst_joint(code: Array) -> tuple[Array, Array]:
    """Return the highest code of the joints, and the first joint that has it, each (1,) or (batch, 1).

    Without any fault the highest code is 0, and the joint is 0 too: the code says whether there is one.
    """
    worst = largest(code)
    first = np.zeros_like(worst)
    for j in reversed(range(code.shape[-1])):
        first = np.where(code[..., j : j + 1] == worst, float(j), first)
    return worst, first


def tightest(bound: Array) -> Any:
    """Return the bound of the tightest joint, (1,) or (batch, 1): less to load than that of each."""
    return np.min(bound, axis=-1, keepdims=True)


def beyond(x: Array, limit: Array | float) -> Mask:
    """Tell which numbers are not within plus and minus a limit; NaN is not."""
    return ~(np.abs(x) <= limit)


def choose(condition: Mask, yes: Any, no: Any) -> Any:
    """Return a state whose numbers are those of `yes` where the condition holds, else those of `no`.

    Counts are always those of `no`.
    """
    if isinstance(yes, tuple):
        return tuple.__new__(type(yes), [choose(condition, *pair) for pair in zip(yes, no, strict=True)])
    if yes is None or isinstance(no, int):
        return no
    return np.where(condition if np.ndim(yes) else condition[..., 0], yes, no)
