"""Refusals of an arm that loads but whose equations of motion cannot be solved."""

from __future__ import annotations

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import Remedy, UrdfError
from armgpi.robot.frames import Frames

#: Smallest eigenvalue of D(q), as a share of the largest one, at or below which D(q) is singular.
_SINGULAR = 1e-14
#: Smallest eigenvalue of D(q) by itself at or below which it is singular [kg m^2 or kg].
_WEIGHTLESS = 1e-15
#: Most that D(q)^-1 D(q) may differ from one.
_WRONG = 1e-3
#: Most joints that a message lists besides the first.
_LISTED = 5


def check_inertia(robot: Frames, configurations: Array, source: str) -> None:
    """Refuse an arm whose inertia matrix is singular or overflows, or whose accelerations are wrong.

    Args:
        robot: the arm.
        configurations: where D(q) is checked, the middle of the ranges first, shape (k, n).
        source: the file, for the message.

    Raises:
        UrdfError: with the joint concerned.
    """
    matrices = robot.dynamics.mass_matrix(configurations)
    if not np.isfinite(matrices).all():
        raise UrdfError(source, "has masses and lengths so large that D(q) overflows; check their units")
    eigenvalues, vectors = np.linalg.eigh(matrices)
    least = np.maximum(_SINGULAR * eigenvalues[:, -1], _WEIGHTLESS)
    bad = eigenvalues[:, 0] <= least
    if not bad.any():
        _check_digits(robot, configurations, source)
        return
    first = int(np.argmax(bad))
    # The eigenvectors of the smallest eigenvalues are the motions that no inertia resists.
    motions = vectors[first][:, eigenvalues[first] <= least[first]]
    joint, *others = dict.fromkeys(robot.joint_names[int(row)] for row in np.abs(motions).argmax(axis=0))
    others = others[:_LISTED]
    links = ", ".join(map(repr, robot.links_moved_by(joint)))
    alike = f"; nor does {', '.join(map(repr, others))}" if others else ""
    shown = np.array2string(configurations[first], precision=3, max_line_width=10_000)
    where = f" at q = {shown}" if first else ""
    raise UrdfError(
        source,
        f"joint {joint!r} moves no inertia (links {links}), so D(q) is singular{where}{alike}; "
        "give them mass and inertia, lock the joint, or check its axis",
        joint,
    ).suggesting(Remedy("lock", (joint, *others)))


def _check_digits(robot: Frames, configurations: Array, source: str) -> None:
    """Refuse a model whose accelerations lose their digits: lengths of 1e9 m beside others of 1 m."""
    unit, dynamics = np.ones_like(configurations), robot.dynamics
    back = dynamics.inertia_solve(configurations, dynamics.inertia_times(configurations, unit))
    wrong = np.abs(back - unit).max(axis=0)
    if not (wrong < _WRONG).all():
        joint = robot.joint_names[int(np.argmax(np.where(np.isfinite(wrong), wrong, np.inf)))]
        raise UrdfError(
            source,
            "has lengths, masses or inertias so far apart that accelerations are wrong, that of joint "
            f"{joint!r} the most; check their units",
            joint,
        )
