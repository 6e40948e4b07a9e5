"""Inertia tensors whose numbers stand in another order than URDF's ixx, ixy, ixz, iyy, iyz, izz.

The six numbers of a symmetric matrix are also written diagonal first (MuJoCo's ``fullinertia``), along the
rows of the lower triangle (Pinocchio's dynamic parameters), or as the first six of the nine of its rows. As a
URDF such a tensor is mostly not positive, and one of these readings alone is that of a rigid body.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array

#: By how much of the largest moment a tensor may violate what a rigid body's obeys, by rounding of the file.
_ROUNDING = 0.01
#: Halvings of the range in which the moment is that nine numbers cut to six have lost.
_HALVINGS = 40
#: Values of it that are tried first.
_TRIED = 400


class Reading(NamedTuple):
    """One way to read six numbers.

    Attributes:
        order: how they are written, in words.
        values: ixx, ixy, ixz, iyy, iyz, izz [kg m^2].
    """

    order: str
    values: tuple[float, ...]


def as_matrix(values: Sequence[float]) -> Array:
    """Return ixx, ixy, ixz, iyy, iyz, izz as a matrix."""
    xx, xy, xz, yy, yz, zz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def is_rigid(values: Sequence[float], rounding: float = _ROUNDING) -> bool:
    """Tell whether a rigid body has such an inertia: positive, and no moment larger than both others."""
    least, middle, most = np.linalg.eigvalsh(as_matrix(values))
    return bool(least > 0.0 and least + middle >= (1.0 - rounding) * most)


def only_reading(values: Sequence[float]) -> Reading | None:
    """Return the one of three other known orders in which six numbers are the inertia of a rigid body.

    None where they are one in URDF's order as well, in none of these orders, or in several that differ.
    """
    a, b, c, d, e, f = values
    if is_rigid(values):
        return None
    readings = [
        Reading("diagonal first, as MuJoCo's fullinertia", (a, d, e, b, f, c)),
        Reading("along the rows of the lower triangle, as Pinocchio's parameters", (a, b, d, c, e, f)),
    ]
    good = [reading for reading in readings if is_rigid(reading.values)]
    # Of nine, the second and the fourth are the same number, or the fourth is 0: the upper triangle alone.
    if d in (b, 0.0) and (lost := _least_moment(a, b, c, e, f)) is not None:
        text = f"along the rows, the first six of nine: izz, which is lost, as the least possible, {lost:.3g}"
        good.append(Reading(text, (a, b, c, e, f, lost)))
    return good[0] if len({reading.values for reading in good}) == 1 else None


def _least_moment(xx: float, xy: float, xz: float, yy: float, yz: float) -> float | None:
    """Return the least izz with which the others are the inertia of a rigid body; None when none does."""
    if min(xx, yy) <= 0.0:
        return None

    def fits(zz: float) -> bool:
        return is_rigid((xx, xy, xz, yy, yz, zz), 0.0)

    tried = np.linspace(0.0, 1.01 * (xx + yy), _TRIED + 1)
    first = next((k for k, zz in enumerate(tried) if fits(zz)), 0)
    if not first:
        return None
    low, high = float(tried[first - 1]), float(tried[first])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if fits(middle) else (middle, high)
    return high


def carried(mass: float, centre: Sequence[float], rotation: Array) -> Array:
    """Return what a mass at a centre adds to an inertia about the origin [kg m^2], shape (3, 3).

    Args:
        mass: [kg].
        centre: of the mass, in the link's axes [m].
        rotation: from the axes of the inertia to those of the link, shape (3, 3).
    """
    c = rotation.T @ np.asarray(centre, dtype=float)
    added: Array = mass * (float(c @ c) * np.eye(3) - np.outer(c, c))
    return added


def as_values(matrix: Array) -> tuple[float, ...]:
    """Return a matrix as ixx, ixy, ixz, iyy, iyz, izz."""
    return tuple(float(matrix[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
