"""What the paper printed: Tables 1 to 4, and how a value of ours compares with one of them."""

from __future__ import annotations

from typing import NamedTuple

#: Factor within which two values count as of the same order.
_ORDER = 10.0


class Cells(NamedTuple):
    """One column pair of Tables 2 to 4: a value for each of the joints q1, q2, q3.

    Attributes:
        itae: integral of t abs(e) [rad s^2] (eq. 34).
        isci: integral of u^2 [(N m)^2 s] (eq. 35).
    """

    itae: tuple[float, float, float]
    isci: tuple[float, float, float]


class Table(NamedTuple):
    """Tables 2, 3 or 4.

    Attributes:
        number: the table's number.
        inertia_scale: what the D(q) of the controllers is multiplied by.
        pid: PID-like controller with dynamic inversion.
        proposal: the adaptive GPI controller.
    """

    number: int
    inertia_scale: float
    pid: Cells
    proposal: Cells


TABLES = (
    Table(
        2,
        1.0,
        Cells((37.08, 13.50, 36.54), (8.75, 323.68, 41.11)),
        Cells((0.05, 2.60e-3, 3.80e-4), (8.02, 322.76, 39.51)),
    ),
    Table(
        3,
        1.2,
        Cells((45.85, 16.10, 45.06), (8.64, 324.08, 41.33)),
        Cells((0.04, 2.21e-3, 2.81e-4), (8.02, 322.67, 39.77)),
    ),
    Table(
        4,
        0.8,
        Cells((31.22, 11.78, 30.91), (8.84, 324.10, 41.06)),
        Cells((3.01, 0.08, 0.0014), (35.53, 324.4972, 39.77)),
    ),
)


def status(ours: float | None, published: float | None) -> str:
    """Return how a value of ours (smaller is better) compares with a published one.

    Returns:
        "better" (or equal), "same order" (less than ten times it), "worse", "diverged" when ours is None,
        "not stated" when nothing was published.
    """
    if published is None:
        return "not stated"
    if ours is None:
        return "diverged"
    if ours <= published:
        return "better"
    return "same order" if ours < _ORDER * published else "worse"
