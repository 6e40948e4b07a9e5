"""The robot's own summands: products of its numbers, each times a function of the configuration.

D and the products of velocities are linear in masses and inertias and of degree two in lengths and centres of
mass; gravity is of degree one in these. So each summand is found exactly from a few values of the lengths, by
polarisation, for any number of joints and without symbols. Numbers are named as `armgpi derive` names them:
m2, c2x, l3z, I2yy, Ir1, g.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation import harmonics
from armgpi.validation.problem import Problem
from armgpi.validation.terms import _alone
from armgpi.validation.tree import Body, Tree, evaluate

#: Quantities of which there are summands.
QUANTITIES = ("D", "H", "G")
#: Quantities that are linear in a link's mass, first moments and inertia about its joint.
_LINEAR = frozenset({*QUANTITIES, "V"})
#: Quantities that may be compared beside them.
_ADDED = frozenset("BZ")
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
    numbers: dict[str, float] = {}
    for i, body in enumerate(tree.bodies):
        if body.mass:
            numbers[f"m{i + 1}"] = body.mass
        for r, c in _moments(body.inertia):
            numbers[_inertia_name(i, r, c)] = float(body.inertia[r, c])
    for length in _lengths(tree):
        numbers[length.name] = length.value
    for i, rotor in enumerate(tree.armature):
        if rotor:
            numbers[f"Ir{i + 1}"] = float(rotor)
    strength = float(np.linalg.norm(tree.gravity))
    if strength:
        numbers["g"] = strength
    return numbers


def _inertia_name(body: int, r: int, c: int) -> str:
    """Return the name of an entry of a body's inertia: I2xx."""
    return f"I{body + 1}{_XYZ[r]}{_XYZ[c]}"


def summands(problem: Problem) -> list[Summand]:
    """Return all summands of the elements of a problem."""
    tree = problem.tree
    quantities = {element.quantity for element in problem.elements}
    want = sorted(quantities.intersection(QUANTITIES))
    if not want:
        return []

    def columns(changed: Tree) -> Array:
        return np.nan_to_num(problem.columns(evaluate(changed, problem.q, want)))

    columns_of: dict[tuple[str, ...], Array] = {}
    for k, body in enumerate(tree.bodies):
        point = _alone(tree, k)
        massless = point.with_body(k, mass=0.0)  # a point of no mass adds nothing
        if body.mass:
            for names, of_lengths in _polarised(point, _felt(tree, k), columns):
                columns_of[(f"m{k + 1}", *names)] = of_lengths
        for r, c in _moments(body.inertia):
            tensor = body.inertia[r, c] * _unit_tensor(r, c)
            columns_of[(_inertia_name(k, r, c),)] = columns(massless.with_body(k, inertia=tensor))
        if tree.armature[k]:
            rotor = np.where(np.arange(tree.n) == k, tree.armature, 0.0)
            columns_of[(f"Ir{k + 1}",)] = columns(replace(massless, armature=rotor))
    all_summands = [Summand(names, of_names) for names, of_names in columns_of.items()]
    return [summand for summand in all_summands if np.abs(summand.columns).max() > 0.0]


def _unit_tensor(r: int, c: int) -> Array:
    """Return a symmetric matrix with one entry of one, (3, 3)."""
    tensor = np.zeros((3, 3))
    tensor[r, c] = tensor[c, r] = 1.0
    return tensor


def without_inertias(tree: Tree, names: Collection[str]) -> Tree:
    """Return an arm of which some inertias are zero, given by their names."""
    for i, body in enumerate(tree.bodies):
        inertia = body.inertia.copy()
        for r, c in _moments(body.inertia):
            if _inertia_name(i, r, c) in names:
                inertia[r, c] = inertia[c, r] = 0.0
        tree = tree.with_body(i, inertia=inertia)
    return tree


def fits_other_bodies(problem: Problem) -> bool:
    """Tell whether other masses, centres of mass and inertias on the same chain give all that a model gives.

    D, the products of velocities, gravity and the potential are linear in a link's mass, first moments and
    inertia about its joint; the model has to be a sum of what each of these gives alone.
    """
    tree = problem.tree
    is_linear = np.array([element.quantity in _LINEAR for element in problem.elements])
    others = {element.quantity for element in problem.elements} - _LINEAR
    if not others <= _ADDED:
        return False
    if not _has_positive_definite_inertia(problem):
        return False  # no bodies have that
    nothing = Body(mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))
    empty = replace(tree, bodies=(nothing,) * tree.n, armature=np.zeros(tree.n))

    def scaled(columns: Array) -> Array:
        """Return linear elements in units of what counts as equal, (N E,)."""
        return np.asarray(columns[:, is_linear] / problem.tolerance[is_linear]).ravel()

    def of(changed: Tree) -> Array:
        return scaled(problem.columns(evaluate(changed, problem.q, problem.want)))

    columns = []
    for i in range(tree.n):
        at_origin = of(empty.with_body(i, mass=1.0))
        columns.append(at_origin)
        for axis in np.eye(3):
            # So that the inertia about the joint is zero.
            about_joint = axis @ axis * np.eye(3) - np.outer(axis, axis)
            first_moment = empty.with_body(i, mass=1.0, com=axis, inertia=-about_joint)
            columns.append(of(first_moment) - at_origin)
        for r, c in itertools.combinations_with_replacement(range(3), 2):
            columns.append(of(empty.with_body(i, inertia=_unit_tensor(r, c))))
    matrix = np.stack([column for column in columns if np.abs(column).max() > 0.0], axis=-1)
    sizes = np.linalg.norm(matrix, axis=0)
    of_model = scaled(problem.user)
    parameters = np.linalg.lstsq(matrix / sizes, of_model, rcond=1e-11)[0] / sizes
    largest_difference = np.abs(matrix @ parameters - of_model).max()
    # The numbers are found by division: a hundred times what counts as equal is still a millionth.
    return bool(largest_difference <= 100.0 and problem.agreeing[~is_linear].all())


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
    transposed = np.swapaxes(D, 1, 2)
    D = np.where(np.isnan(D), transposed, D)  # elements of a symmetric matrix may be listed once
    if np.isnan(D).any():
        return True
    symmetric = 0.5 * (D + np.swapaxes(D, 1, 2))
    return bool(np.linalg.eigvalsh(symmetric).min() > 0.0)


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
    lengths: list[_Length] = []
    for i, body in enumerate(tree.bodies):
        lengths += _components(f"c{i + 1}", True, i, body.com)
    for i, position in enumerate(tree.positions):
        lengths += _components(f"l{i + 1}", False, i, position)
    return lengths


def _components(name: str, of_body: bool, place: int, vector: Array) -> Iterator[_Length]:
    """Yield the components of a vector that are not zero."""
    size = float(np.abs(vector).max())
    for k, value in enumerate(vector):
        if abs(value) > _ROUNDING * size:
            yield _Length(f"{name}{_XYZ[k]}", of_body, place, k, float(value))


def _felt(tree: Tree, body: int) -> list[_Length]:
    """Return the lengths on which the place of a body's mass depends."""
    chain = [body]
    while tree.parents[chain[-1]] >= 0:
        chain.append(tree.parents[chain[-1]])
    felt = []
    for length in _lengths(tree):
        is_felt = length.place == body if length.of_body else length.place in chain
        if is_felt:
            felt.append(length)
    return felt


def _polarised(
    point: Tree, lengths: Sequence[_Length], columns: Callable[[Tree], Array]
) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Yield the parts of degree 0, 1 and 2 in the lengths, each with the names of its lengths."""
    without_lengths = replace(point, positions=(np.zeros(3),) * point.n)
    for i in range(point.n):
        without_lengths = without_lengths.with_body(i, com=np.zeros(3))

    def at(signs: Mapping[int, float]) -> Array:
        """Return the columns of the arm that has some of the lengths alone, with signs."""
        changed = without_lengths
        for k, sign in signs.items():
            changed = _with_length(changed, lengths[k], sign)
        return columns(changed)

    constant = at({})
    yield (), constant
    alone = []
    for k, length in enumerate(lengths):
        plus = at({k: 1.0})
        minus = at({k: -1.0})
        alone.append(plus)
        yield (length.name,), 0.5 * (plus - minus)
        yield (length.name, length.name), 0.5 * (plus + minus) - constant
    for j, k in itertools.combinations(range(len(lengths)), 2):
        both = at({j: 1.0, k: 1.0})
        product = both - alone[j] - alone[k] + constant
        yield (lengths[j].name, lengths[k].name), product


def _with_length(tree: Tree, length: _Length, sign: float) -> Tree:
    """Return an arm to which a length is added, with a sign."""
    step = sign * length.value * np.eye(3)[length.component]
    if length.of_body:
        com = tree.bodies[length.place].com
        return tree.with_body(length.place, com=com + step)
    position = tree.positions[length.place]
    return tree.with_item("positions", length.place, position + step)


class Shape(NamedTuple):
    """A function of the configuration: a sum of coefficients times expressions of Python; "" is 1."""

    terms: tuple[tuple[float, str], ...]

    @property
    def is_nice(self) -> bool:
        """Whether all coefficients are usual: quarters up to four."""
        return all(_is_nice(coefficient) for coefficient, _ in self.terms)

    def times(self, factor: float) -> Shape:
        """Return a multiple of it."""
        return Shape(tuple((c * factor, code) for c, code in self.terms))


def _is_nice(coefficient: float) -> bool:
    """Tell whether a coefficient is a quarter, or a multiple of one up to four."""
    quarters = 4.0 * coefficient
    return abs(quarters - round(quarters)) < 1e-5 and 0.2 < abs(coefficient) < 4.5


class Shapes:
    """Finds functions of the configuration in samples: products of sines and cosines first, then sums."""

    def __init__(self, q: Array, prismatic: Sequence[bool]) -> None:
        """List the products of two sines or cosines at some configurations."""
        self.q = q
        self.prismatic = tuple(prismatic)
        turning = [i for i, slides in enumerate(prismatic) if not slides]
        sliding = [i for i, slides in enumerate(prismatic) if slides]
        waves = _waves(q, turning)
        pairs = list(itertools.combinations_with_replacement(waves, 2))
        pairs.sort(key=lambda pair: len(pair[0].code) + len(pair[1].code))
        codes, columns = [], []
        for power in _powers(q, sliding):
            for first, second in pairs:
                factors = [function.code for function in (power, first, second) if function.code]
                codes.append(_product(factors))
                columns.append(power.values * first.values * second.values)
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
        size = float(y @ y)
        squared_distances = size - shares**2 * self._sizes
        largest = len(y) * tolerance**2 + 1e-12 * size
        for k in np.flatnonzero(squared_distances <= largest):
            difference = y - shares[k] * self._columns[k]
            if np.abs(difference).max() <= tolerance:
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
            terms = harmonics.expand(self.q, y, self.prismatic, tolerance, joints)
            if terms is not None:
                return Shape(tuple((term.factor, harmonics.code(term.function)) for term in terms))
        return None


class _Function(NamedTuple):
    """A function of the configuration: an expression of Python ("" is 1), and its samples (N,)."""

    code: str
    values: Array


def _waves(q: Array, turning: Sequence[int]) -> list[_Function]:
    """Return 1, and the cosines and sines of sums of angles that are tried."""
    functions = [_Function("", np.ones(len(q)))]
    for multiples in _angles(q.shape[1], turning):
        text = _angle_text(multiples)
        angle = q @ np.array(multiples, dtype=float)
        functions.append(_Function(f"cos({text})", np.cos(angle)))
        functions.append(_Function(f"sin({text})", np.sin(angle)))
    return functions


def _powers(q: Array, sliding: Sequence[int]) -> list[_Function]:
    """Return 1, the sliding positions, and their products by twos."""
    functions = [_Function("", np.ones(len(q)))]
    functions += [_Function(f"q{i + 1}", q[:, i]) for i in sliding]
    for i, j in itertools.combinations_with_replacement(sliding, 2):
        code = _product([f"q{i + 1}", f"q{j + 1}"])
        functions.append(_Function(code, q[:, i] * q[:, j]))
    return functions


def _angles(n: int, turning: Sequence[int]) -> list[tuple[int, ...]]:
    """Return the whole multiples of the angles whose sines and cosines are tried."""
    if len(turning) <= _ALL_ANGLES:
        choices = [(-1, 0, 1) if i in turning else (0,) for i in range(n)]
        with_positive_first = [k for k in itertools.product(*choices) if next(filter(None, k), 0) > 0]
        return sorted(with_positive_first, key=lambda k: sum(map(abs, k)))
    angles = [_multiples(n, {i: 1}) for i in turning]
    for length in range(2, len(turning) + 1):
        for start in range(len(turning) - length + 1):
            neighbours = turning[start : start + length]
            angles.append(_multiples(n, dict.fromkeys(neighbours, 1)))
            if length == 2:
                first, second = neighbours
                angles.append(_multiples(n, {first: 1, second: -1}))
    return angles


def _multiples(n: int, multiple_of: Mapping[int, int]) -> tuple[int, ...]:
    """Return how often each joint's angle is in a sum."""
    return tuple(multiple_of.get(i, 0) for i in range(n))


def _angle_text(k: Sequence[int]) -> str:
    """Return a sum of angles: "q1 - q2"."""
    text = ""
    for joint, multiple in enumerate(k, 1):
        if multiple:
            text += f" {'+' if multiple > 0 else '-'} q{joint}"
    if text.startswith(" - "):
        return text.replace(" - ", "-", 1)
    return text.removeprefix(" + ")


def _product(codes: list[str]) -> str:
    """Return factors as an expression: equal ones as a square."""
    if len(codes) == 2 and codes[0] == codes[1]:
        return f"{codes[0]}**2"
    if len(codes) == 3 and codes[1] == codes[2]:
        return f"{codes[0]}*{codes[1]}**2"
    return "*".join(codes)
