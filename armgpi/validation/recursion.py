"""What a recursion by Newton and Euler has on its way, beside Pinocchio's: where a model first goes astray.

Books differ in their frames: along the axes of each link or of the base, in the joint or at its end. The
lengths of vectors do not depend on that, so these are compared. A recursion is evidence: a model is right or
wrong by its other functions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.arrays import Array
from armgpi.validation.tree import Tree

#: Names that a quantity may have, with one vector per link -> what it is.
QUANTITIES = {
    ("omega", "w"): "angular velocity",
    ("alpha", "dw"): "angular acceleration",
    ("a_c", "dc"): "acceleration of the centre of mass",
    ("f", "force"): "force from the link before",
    ("n", "moment"): "moment from the link before",
}
#: Two lengths are the same up to this, relative to the largest of their kind.
SAME = 1e-8
_OMEGA, _ALPHA, _CENTRE, _FORCE, _MOMENT = range(5)


class Difference(NamedTuple):
    """A quantity of a link that differs.

    Attributes:
        link: its number, from 1.
        quantity: what it is.
        model: its length in the model, at the state where it differs most.
        robot: the same in the robot.
    """

    link: int
    quantity: str
    model: float
    robot: float

    def __str__(self) -> str:
        """Return it as a sentence."""
        told = f"its length is {self.model:.6g}, that of the robot {self.robot:.6g}"
        return f"first to differ in the recursion: {self.quantity} of link {self.link}: {told}"


def lengths(value: Any) -> Array:
    """Return the lengths of the vectors that a recursion gave, (5, n), zero for quantities that it has not.

    Raises:
        ValueError: when it gave something else than a mapping of known names to one vector per link.
    """
    names = ", ".join(names[0] for names in QUANTITIES)
    known = [name for both in QUANTITIES for name in both]
    if not isinstance(value, Mapping) or not any(name in value for name in known):
        raise ValueError(f"must return a mapping with some of {names} to one vector per link")
    rows: dict[int, Array] = {}
    for k, both in enumerate(QUANTITIES):
        name = next((name for name in both if name in value), None)
        if name is not None:
            vectors = np.asarray(value[name], dtype=np.float64)
            if vectors.ndim != 2 or vectors.shape[1] not in (2, 3):
                raise ValueError(f"{name} has the shape {vectors.shape}, expected one vector of 3 per link")
            rows[k] = np.linalg.norm(vectors, axis=1)
    if len({len(row) for row in rows.values()}) > 1:
        raise ValueError("has quantities of different numbers of links")
    n = len(next(iter(rows.values())))
    return np.stack([rows.get(k, np.zeros(n)) for k in range(len(QUANTITIES))])


def reference(tree: Tree, q: Array, v: Array, a: Array, seen: Array) -> Array:
    """Return the lengths in the robot, (rows, 5, n), in the conventions that fit what was `seen` best.

    Gravity may be an acceleration of the base or a force, and a moment about any point of the joint's axis.
    """
    model = tree.model()
    data = model.createData()
    found = np.zeros((len(q), len(QUANTITIES), tree.n))
    plain, moments, levers = np.zeros((len(q), tree.n)), *np.zeros((2, len(q), tree.n, 3))
    for row, state in enumerate(zip(q, v, a, strict=True)):
        pin.rnea(model, data, *state)
        pin.forwardKinematics(model, data, state[0])  # where the frames stand, which rnea leaves out
        for i, body in enumerate(tree.bodies):
            speed, push, wrench = data.v[i + 1], data.a_gf[i + 1], data.f[i + 1]
            w, dw = speed.angular, push.angular
            centre = push.linear + np.cross(w, speed.linear)
            centre = centre + np.cross(dw, body.com) + np.cross(w, np.cross(w, body.com))
            found[row, :_MOMENT, i] = [np.linalg.norm(x) for x in (w, dw, centre, wrench.linear)]
            plain[row, i] = np.linalg.norm(centre + data.oMi[i + 1].rotation.T @ tree.gravity)
            moments[row, i], levers[row, i] = wrench.angular, np.cross(tree.axes[i], wrench.linear)
    if np.sum(_near(plain, seen[:, _CENTRE])) > np.sum(_near(found[:, _CENTRE], seen[:, _CENTRE])):
        found[:, _CENTRE] = plain
    for i in range(tree.n):
        given = (moments[:, i], levers[:, i], q[:, i], tree.prismatic[i])
        found[:, _MOMENT, i] = _moment(*given, seen[:, _MOMENT, i])
    # What the model does not tell is not compared.
    told = np.abs(seen).max(axis=(0, 2)) > 0.0
    return np.where(told[:, np.newaxis], found, 0.0)


def _moment(moment: Array, lever: Array, q: Array, slides: bool, seen: Array) -> Array:
    """Return the lengths of a moment about the point of the axis for which most of them are as seen."""
    for along in (0.0, 1.0) if slides else (0.0,):  # the point may stay behind as the joint slides
        there = moment + along * q[:, np.newaxis] * lever
        # |m + s l|² = |m|² + 2 s m·l + s² |l|²: linear in s and s².
        columns = np.stack([2.0 * np.sum(there * lever, axis=1), np.sum(lever * lever, axis=1)], axis=-1)
        shift = np.linalg.lstsq(columns, seen**2 - np.sum(there**2, axis=1), rcond=1e-12)[0][0]
        shifted = np.linalg.norm(there + shift * lever, axis=1)
        if _near(shifted, seen).all():
            return np.asarray(shifted)
    return np.asarray(np.linalg.norm(moment, axis=1))


def _near(one: Array, other: Array) -> Any:
    return np.abs(one - other) <= SAME * max(float(np.abs(one).max()), 1e-3)


def differences(seen: Array, robot: Array) -> Iterator[Difference]:
    """Yield what differs, in the order of the recursion: outwards the motion, inwards forces and moments."""
    n = seen.shape[2]
    outward = [(k, i) for i in range(n) for k in (_OMEGA, _ALPHA, _CENTRE)]
    inward = [(k, i) for i in reversed(range(n)) for k in (_FORCE, _MOMENT)]
    texts = list(QUANTITIES.values())
    for k, i in (*outward, *inward):
        size = max(float(np.abs(robot[:, k]).max()), 1e-3)
        away = np.abs(seen[:, k, i] - robot[:, k, i])
        if not away.max() <= SAME * size:
            row = int(np.argmax(away))
            yield Difference(i + 1, texts[k], float(seen[row, k, i]), float(robot[row, k, i]))
