"""The robot's own summands: products of its numbers, each times a function of the configuration.

D and the products of velocities are linear in masses and inertias and of degree two in lengths and centres of
mass; gravity is of degree one in these. So each summand is found exactly from a few values of the lengths, by
polarisation, for any number of joints and without symbols. Numbers are named as `armgpi derive` names them:
m2, c2x, l3z, I2yy, Ir1, g.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation import harmonics
from armgpi.validation.problem import Problem
from armgpi.validation.terms import _alone
from armgpi.validation.tree import Tree, evaluate

#: Quantities of which there are summands.
QUANTITIES = ("D", "H", "G")
#: Numbers below this are rounding, relative to the others of their vector.
_ROUNDING = 1e-13
_XYZ = "xyz"
#: More joints than this have too many sums of angles: those of neighbours alone are tried.
_ALL_ANGLES = 4
#: Joints of which a function of the configuration depends, at most, where it is no single product.
_MOST_IN_SUM = 3


class Summand(NamedTuple):
    """One product of the robot's numbers, and what it adds.

    Attributes:
        factors: names of the numbers, without that of gravity.
        columns: what it adds to every element, (N, E).
    """

    factors: tuple[str, ...]
    columns: Array


class _Length(NamedTuple):
    """One component of a centre of mass (body) or of a position (joint)."""

    name: str
    of_body: bool
    place: int
    component: int
    value: float


def numbers_of(tree: Tree) -> dict[str, float]:
    """Return the numbers of an arm that are not zero, by the names that `armgpi derive` has."""
    found: dict[str, float] = {}
    for i, body in enumerate(tree.bodies):
        if body.mass:
            found[f"m{i + 1}"] = body.mass
        found |= {f"I{i + 1}{_XYZ[r]}{_XYZ[c]}": float(body.inertia[r, c]) for r, c in _moments(body.inertia)}
    for length in _lengths(tree):
        found[length.name] = length.value
    found |= {f"Ir{i + 1}": float(x) for i, x in enumerate(tree.armature) if x}
    if strength := float(np.linalg.norm(tree.gravity)):
        found["g"] = strength
    return found


def summands(problem: Problem) -> list[Summand]:
    """Return all summands of the elements of a problem."""
    tree = problem.tree
    want = sorted({e.quantity for e in problem.elements if e.quantity in QUANTITIES})
    if not want:
        return []

    def columns(changed: Tree) -> Array:
        return np.nan_to_num(problem.columns(evaluate(changed, problem.q, want)))

    found: dict[tuple[str, ...], Array] = {}
    for k, body in enumerate(tree.bodies):
        point = _alone(tree, k)
        if body.mass:
            for names, part in _polarised(point, _felt(tree, k), columns):
                found[(f"m{k + 1}", *names)] = part
        for r, c in _moments(body.inertia):
            one = np.zeros((3, 3))
            one[r, c] = one[c, r] = body.inertia[r, c]
            # Through the mass of nothing: a point of no mass adds nothing else.
            spinning = point.with_body(k, mass=0.0, inertia=one)
            found[(f"I{k + 1}{_XYZ[r]}{_XYZ[c]}",)] = columns(spinning)
        if tree.armature[k]:
            rotor = np.where(np.arange(tree.n) == k, tree.armature, 0.0)
            nothing = point.with_body(k, mass=0.0)
            found[(f"Ir{k + 1}",)] = columns(replace(nothing, armature=rotor))
    return [Summand(names, part) for names, part in found.items() if np.abs(part).max() > 0.0]


def without_inertias(tree: Tree, names: Collection[str]) -> Tree:
    """Return an arm of which some inertias are zero, given by their names."""
    for i, body in enumerate(tree.bodies):
        inertia = body.inertia.copy()
        for r, c in _moments(body.inertia):
            if f"I{i + 1}{_XYZ[r]}{_XYZ[c]}" in names:
                inertia[r, c] = inertia[c, r] = 0.0
        tree = tree.with_body(i, inertia=inertia)
    return tree


def fits_other_bodies(problem: Problem) -> bool:
    """Tell whether other masses, centres of mass and inertias on the same chain give all that a model gives.

    D, the products of velocities, gravity and the potential are linear in a link's mass, first moments and
    inertia about its joint; the model has to be a sum of what each of these gives alone.
    """
    tree = problem.tree
    wanted = {*QUANTITIES, "V"}
    if not all(e.quantity in wanted or e.quantity in "BZ" for e in problem.elements):
        return False
    if not _has_positive_definite_inertia(problem):
        return False  # no bodies have that
    columns = np.array([e.quantity in wanted for e in problem.elements])
    nothing = replace(tree, armature=np.zeros(tree.n))
    for i in range(tree.n):
        nothing = nothing.with_body(i, mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))

    def of(changed: Tree) -> Array:
        found = problem.columns(evaluate(changed, problem.q, problem.want))[:, columns]
        return np.asarray(found / problem.tolerance[columns]).ravel()

    parts = []
    for i in range(tree.n):
        point = of(nothing.with_body(i, mass=1.0))
        parts.append(point)
        for axis in np.eye(3):
            # So that the inertia about the joint is zero.
            away = axis @ axis * np.eye(3) - np.outer(axis, axis)
            parts.append(of(nothing.with_body(i, mass=1.0, com=axis, inertia=-away)) - point)
        for r, c in itertools.combinations_with_replacement(range(3), 2):
            one = np.zeros((3, 3))
            one[r, c] = one[c, r] = 1.0
            parts.append(of(nothing.with_body(i, inertia=one)))
    matrix = np.stack([part for part in parts if np.abs(part).max() > 0.0], axis=-1)
    sizes = np.linalg.norm(matrix, axis=0)
    user = (problem.user[:, columns] / problem.tolerance[columns]).ravel()
    shares = np.linalg.lstsq(matrix / sizes, user, rcond=1e-11)[0] / sizes
    left = np.abs(matrix @ shares - user).max()
    # The numbers are found by division: a hundred times what counts as equal is still a millionth.
    return bool(left <= 100.0 and problem.agreeing[~columns].all())


def _has_positive_definite_inertia(problem: Problem) -> bool:
    """Tell whether the D that a model gives is positive definite at all samples; yes where it gives none."""
    n = problem.tree.n
    D = np.full((len(problem.q), n, n), np.nan)
    for column, element in enumerate(problem.elements):
        if element.quantity == "D":
            i, j = element.place
            D[:, i, j] = problem.user[:, column]
    if np.isnan(D).all():
        return True
    upper = np.isnan(D)
    D = np.where(upper, np.swapaxes(D, 1, 2), D)  # elements of a symmetric matrix may be listed once
    if np.isnan(D).any():
        return True
    return bool(np.linalg.eigvalsh(0.5 * (D + np.swapaxes(D, 1, 2))).min() > 0.0)


def is_weight(quantity: str) -> bool:
    """Tell whether a quantity has the strength of gravity in all its summands."""
    return quantity == "G"


def _moments(inertia: Array) -> Iterator[tuple[int, int]]:
    """Yield the entries of a tensor that are not zero."""
    size = float(np.abs(inertia).max())
    for r, c in itertools.combinations_with_replacement(range(3), 2):
        if abs(inertia[r, c]) > _ROUNDING * size:
            yield r, c


def _lengths(tree: Tree) -> list[_Length]:
    """Return the components of all centres of mass and positions that are not zero."""
    vectors = [(f"c{i + 1}", True, i, body.com) for i, body in enumerate(tree.bodies)]
    vectors += [(f"l{i + 1}", False, i, p) for i, p in enumerate(tree.positions)]
    found = []
    for name, of_body, i, vector in vectors:
        size = float(np.abs(vector).max())
        felt = np.flatnonzero(np.abs(vector) > _ROUNDING * size).tolist()
        found += [_Length(f"{name}{_XYZ[k]}", of_body, i, k, float(vector[k])) for k in felt]
    return found


def _felt(tree: Tree, body: int) -> list[_Length]:
    """Return the lengths on which the place of a body's mass depends."""
    chain = [body]
    while tree.parents[chain[-1]] >= 0:
        chain.append(tree.parents[chain[-1]])
    return [x for x in _lengths(tree) if (x.place == body if x.of_body else x.place in chain)]


def _polarised(
    point: Tree, lengths: Sequence[_Length], columns: object
) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Yield the parts of degree 0, 1 and 2 in the lengths, each with the names of its lengths."""
    assert callable(columns)

    def at(signs: dict[int, float]) -> Array:
        changed = point
        for i in range(point.n):
            changed = changed.with_item("positions", i, np.zeros(3)).with_body(i, com=np.zeros(3))
        for k, sign in signs.items():
            one = lengths[k]
            step = sign * one.value * np.eye(3)[one.component]
            if one.of_body:
                changed = changed.with_body(one.place, com=changed.bodies[one.place].com + step)
            else:
                changed = changed.with_item("positions", one.place, changed.positions[one.place] + step)
        return np.asarray(columns(changed))

    nothing = at({})
    yield (), nothing
    alone = []
    for k, one in enumerate(lengths):
        plus, minus = at({k: 1.0}), at({k: -1.0})
        alone.append(plus)
        yield (one.name,), 0.5 * (plus - minus)
        yield (one.name, one.name), 0.5 * (plus + minus) - nothing
    for j, k in itertools.combinations(range(len(lengths)), 2):
        both = at({j: 1.0, k: 1.0}) - alone[j] - alone[k] + nothing
        yield (lengths[j].name, lengths[k].name), both


class Shape(NamedTuple):
    """A function of the configuration: a sum of coefficients times expressions of Python; "" is 1."""

    terms: tuple[tuple[float, str], ...]

    @property
    def is_nice(self) -> bool:
        """Whether all coefficients are usual: quarters up to four."""
        return all(abs(4.0 * c - round(4.0 * c)) < 1e-5 and 0.2 < abs(c) < 4.5 for c, _ in self.terms)

    def times(self, factor: float) -> Shape:
        """Return a multiple of it."""
        return Shape(tuple((c * factor, code) for c, code in self.terms))


class Shapes:
    """Finds functions of the configuration in samples: products of sines and cosines first, then sums."""

    def __init__(self, q: Array, prismatic: Sequence[bool]) -> None:
        """List the products of two sines or cosines at some configurations."""
        self.q, self.prismatic = q, tuple(prismatic)
        turning = [i for i, slides in enumerate(prismatic) if not slides]
        sliding = [i for i, slides in enumerate(prismatic) if slides]
        singles = [("", np.ones(len(q)))]
        for k in _angles(len(prismatic), turning):
            inner = _angle_text(k)
            angle = q @ np.array(k, dtype=float)
            singles += [(f"cos({inner})", np.cos(angle)), (f"sin({inner})", np.sin(angle))]
        slides = [("", np.ones(len(q)))]
        slides += [(f"q{i + 1}", q[:, i]) for i in sliding]
        slides += [
            (_product([f"q{i + 1}", f"q{j + 1}"]), q[:, i] * q[:, j])
            for i, j in itertools.combinations_with_replacement(sliding, 2)
        ]
        codes, columns = [], []
        pairs = sorted(
            itertools.combinations_with_replacement(singles, 2), key=lambda p: len(p[0][0]) + len(p[1][0])
        )
        for power, factor in slides:
            for (one, x), (other, y) in pairs:
                codes.append(_product(list(filter(None, (power, one, other)))))
                columns.append(factor * x * y)
        self._codes = codes
        self._columns = np.stack(columns)
        self._sizes = np.maximum((self._columns**2).sum(axis=1), 1e-300)

    def find(self, y: Array, tolerance: float) -> Shape | None:
        """Return the function that has these samples, None where it is not found."""
        if np.abs(y).max() <= tolerance:
            return Shape(())
        return self.product(y, tolerance) or self._sum(y, tolerance)

    def product(self, y: Array, tolerance: float) -> Shape | None:
        """Return a single product that has these samples, None where none has."""
        shares = (self._columns @ y) / self._sizes
        # The squared distance first: it is one product of matrices for all.
        left = float(y @ y) - shares**2 * self._sizes
        near = np.flatnonzero(left <= len(y) * tolerance**2 + 1e-12 * float(y @ y))
        for k in near:
            if np.abs(y - shares[k] * self._columns[k]).max() <= tolerance:
                return Shape(((float(shares[k]), self._codes[k]),))
        return None

    def _sum(self, y: Array, tolerance: float) -> Shape | None:
        """Return a sum of few harmonics of few joints."""
        n = self.q.shape[1]
        if n <= harmonics.MOST_JOINTS:
            groups = [tuple(range(n))]
        else:
            groups = list(itertools.combinations(range(n), _MOST_IN_SUM))
        for joints in groups:
            told = harmonics.expand(self.q, y, self.prismatic, tolerance, joints)
            if told is not None:
                return Shape(tuple((one.factor, harmonics.code(one.function)) for one in told))
        return None


def _angles(n: int, turning: Sequence[int]) -> list[tuple[int, ...]]:
    """Return the whole multiples of the angles whose sines and cosines are tried."""
    if len(turning) <= _ALL_ANGLES:
        choices = [(-1, 0, 1) if i in turning else (0,) for i in range(n)]
        every = [k for k in itertools.product(*choices) if next((x for x in k if x), 0) > 0]
        return sorted(every, key=lambda k: sum(map(abs, k)))
    found = [tuple(int(i == j) for i in range(n)) for j in turning]
    for length in range(2, len(turning) + 1):
        for start in range(len(turning) - length + 1):
            chosen = turning[start : start + length]
            found.append(tuple(int(i in chosen) for i in range(n)))
            if length == 2:
                found.append(tuple({chosen[0]: 1, chosen[1]: -1}.get(i, 0) for i in range(n)))
    return found


def _angle_text(k: Sequence[int]) -> str:
    """Return a sum of angles: "q1 - q2"."""
    text = "".join(f" {'+' if x > 0 else '-'} q{i + 1}" for i, x in enumerate(k) if x)
    return text.removeprefix(" + ").replace(" - ", "-", 1) if text.startswith(" - ") else text[3:]


def _product(codes: list[str]) -> str:
    """Return factors as an expression: equal ones as a square."""
    if len(codes) == 2 and codes[0] == codes[1]:
        return f"{codes[0]}**2"
    if len(codes) == 3 and codes[1] == codes[2]:
        return f"{codes[0]}*{codes[1]}**2"
    return "*".join(codes)
