"""Mistakes of the whole model, each as a change of the reference arm that can be tried.

A :class:`Hypothesis` says "the model is right for an arm that differs in this": it changes the tree, the
coordinates or the quantities. A :class:`Parameter` does so with one number. Which of several that explain
the same is named is decided by the length of its description: a kind of few members is short, and a
number that can be anything is long.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.tree import (
    PARALLEL,
    Affine,
    Body,
    Quantities,
    Tree,
    absolute_angles,
    evaluate,
    parallel_pairs,
)

T = TypeVar("T")
_XYZ = "xyz"
_DEGREE = np.pi / 180.0
#: Entries of an inertia matrix: the moments, then the products.
MOMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
#: Kinds of conventions of a whole model: mistakes that its source need not show in any one place.
CONVENTIONS = (
    "joint-sign",
    "offset",
    "degrees",
    "joint-order",
    "absolute-angles",
    "axis",
    "armature",
    "rotor-inertia",
    "triangle",
    "friction",
)


class Hypothesis(NamedTuple):
    """One mistake that a model may have.

    Attributes:
        kind: short name of its kind.
        text: what it is, for the report.
        tree: the arm for which the model would be right.
        affine: the coordinates in which it would be.
        post: what to do to the quantities.
    """

    kind: str
    text: str
    tree: Callable[[Tree], Tree] | None = None
    affine: Affine | None = None
    post: Callable[[Quantities], Quantities] | None = None

    def quantities(self, tree: Tree, q: Array, want: Iterable[str]) -> Quantities:
        """Return the quantities of a model with this mistake."""
        changed = tree if self.tree is None else self.tree(tree)
        quantities = evaluate(changed, q, want, self.affine)
        return quantities if self.post is None else {**quantities, **self.post(quantities)}


class Parameter(NamedTuple):
    """One number of the robot, of which a model may have another value.

    Attributes:
        kind: short name of its kind.
        what: which number, for the report.
        unit: its unit.
        value: what the robot has.
        angle: whether the quantities are trigonometric in it, and not polynomial.
        instance: the hypothesis for a value of it.
    """

    kind: str
    what: str
    unit: str
    value: float
    angle: bool
    instance: Callable[[float], Hypothesis]


class Names:
    """How joints and links are called in messages."""

    def __init__(self, tree: Tree) -> None:
        """Take the names from a tree."""
        self._joints, self._links = tree.joint_names, tree.link_names

    def joint(self, i: int) -> str:
        """Return "joint 2" or "joint 2 ('elbow')"."""
        name = self._joints[i]
        # A name that only counts adds nothing to the number.
        plain = {f"q{i + 1}", f"joint{i + 1}", f"joint_{i + 1}", f"j{i + 1}"}
        return f"joint {i + 1}" if name in plain else f"joint {i + 1} ({name!r})"

    def link(self, i: int) -> str:
        """Return "link 2" or "link 2 ('forearm')"."""
        name = self._links[i]
        return f"link {i + 1}" if name in (f"link{i + 1}", f"link {i + 1}") else f"link {i + 1} ({name!r})"


def discrete(tree: Tree) -> list[Hypothesis]:
    """Return the mistakes without a number in them."""
    makers = (_signs, _zeros, _degrees, _orders, _absolute, _bodies, _frames, _lengths)
    return [*(h for maker in makers for h in maker(tree)), *_structure()]


def angle_maps(tree: Tree) -> list[Hypothesis]:
    """Return the mistakes in an angle that a single entry may have."""
    coordinates = (_signs, _zeros, _degrees, _orders, _absolute)
    n = tree.n
    every = (h for maker in coordinates for h in maker(tree))
    maps = [h for h in every if h.affine and np.array_equal(h.affine.L, np.eye(n))]
    for j, k in itertools.product(range(n), repeat=2):
        mine, other = f"q{j + 1}", f"q{k + 1}"
        if j == k:
            maps.append(_mix_angles(n, j, {j: 0.0}, "angle-missing", f"{mine} is left out"))
            maps.append(_mix_angles(n, j, {j: 2.0}, "angle-doubled", f"2 {mine} replaces {mine}"))
        elif tree.prismatic[k] == tree.prismatic[j]:  # an angle is never taken for a length
            expected = f"should be {mine}"
            maps.append(_mix_angles(n, j, {j: 0.0, k: 1.0}, "angle-replaced", f"{other} {expected}"))
            maps.append(_mix_angles(n, j, {k: 1.0}, "angle-added", f"{mine} + {other} {expected}"))
            maps.append(_mix_angles(n, j, {k: -1.0}, "angle-added", f"{mine} - {other} {expected}"))
    return maps


def _mix_angles(n: int, j: int, factors: Mapping[int, float], kind: str, text: str) -> Hypothesis:
    """Return the hypothesis that q_j is another combination of the angles, inside of the formulas."""
    A = np.eye(n)
    for k, factor in factors.items():
        A[j, k] = factor
    return Hypothesis(kind, text, affine=_inside(A))


def _inside(A: Array, b: Array | None = None) -> Affine:
    """Return other angles inside of the formulas alone."""
    n = len(A)
    return Affine(A, np.zeros(n) if b is None else b, np.eye(n))


def _both(A: Array) -> Affine:
    """Return other coordinates, of rates and torques too."""
    return Affine(A, np.zeros(len(A)), A)


def _all_and_each(items: list[T]) -> list[list[T]]:
    """Return all items together, where there are several, then each alone."""
    return [items] * (len(items) > 1) + [[item] for item in items]


def _turning(tree: Tree) -> list[int]:
    return [i for i in range(tree.n) if not tree.prismatic[i]]


def _signs(tree: Tree) -> Iterator[Hypothesis]:
    """Yield joints that turn or slide the other way."""
    n, names = tree.n, Names(tree)
    for i in range(n):
        A = np.diag(np.where(np.arange(n) == i, -1.0, 1.0))
        way = "slides" if tree.prismatic[i] else "turns"
        text = f"{names.joint(i)} {way} the other way: its sign, or the direction of its axis"
        yield Hypothesis("joint-sign", text, affine=_both(A))
        yield Hypothesis("angle-sign", f"the sign of q{i + 1} inside of the formulas", affine=_inside(A))
    if n > 1:
        text = "every joint has the other sign"
        yield Hypothesis("joint-sign", text, affine=_both(-np.eye(n)))
        yield Hypothesis("angle-sign", f"{text} inside of the formulas", affine=_inside(-np.eye(n)))


def _zeros(tree: Tree) -> Iterator[Hypothesis]:
    """Yield joints that are measured from another zero."""
    names = Names(tree)
    for i in _turning(tree):
        for degrees, slip in ((90, " (cos for sin)"), (-90, " (sin for cos)"), (180, "")):
            shift = f"q{i + 1} {'+' if degrees > 0 else '-'} {abs(degrees)}°"
            text = f"{names.joint(i)} has a different zero position: {shift} should be q{i + 1}"
            b = degrees * _DEGREE * np.eye(tree.n)[i]
            yield Hypothesis("offset", text + slip, affine=_inside(np.eye(tree.n), b))


def _degrees(tree: Tree) -> Iterator[Hypothesis]:
    """Yield angles in degrees: all, or one alone."""
    turning = _turning(tree)
    for chosen in _all_and_each(turning):
        which = "all angles" if chosen == turning else Names(tree).joint(chosen[0])
        scale = np.where(np.isin(range(tree.n), chosen), _DEGREE, 1.0)
        text = f"degrees: {which} taken in degrees where radians are given"
        yield Hypothesis("degrees", text, affine=_inside(np.diag(scale)))
        yield Hypothesis("degrees", f"{text}, rates and torques too", affine=_both(np.diag(scale)))
        text = f"degrees: {which} turned into degrees inside of the formulas"
        yield Hypothesis("degrees", text, affine=_inside(np.diag(1.0 / scale)))


def _orders(tree: Tree) -> Iterator[Hypothesis]:
    """Yield other orders of the joints: all for a short arm, else two joints swapped."""
    n = tree.n
    own = ", ".join(f"q{j + 1}" for j in range(n))
    if n <= 4:
        orders = list(itertools.permutations(range(n)))[1:]  # the first is the robot's
    else:
        orders = [tuple(reversed(range(n)))]  # counted from the tip
        for i, j in itertools.combinations(range(n), 2):
            orders.append(tuple({i: j, j: i}.get(k, k) for k in range(n)))
    for order in orders:
        P, listed = np.eye(n)[list(order)], ", ".join(f"q{j + 1}" for j in order)
        text = f"the joints are in another order: the robot's {own} are the model's {listed}"
        yield Hypothesis("joint-order", text, affine=_both(P))
        text = f"the angles are mixed up inside of the formulas: {own} are used as {listed}"
        yield Hypothesis("angle-order", text, affine=_inside(P))


def _absolute(tree: Tree) -> Iterator[Hypothesis]:
    """Yield angles counted from the base (or the other way round) where joints are parallel."""
    n, names, pairs = tree.n, Names(tree), parallel_pairs(tree)
    for chosen in _all_and_each(pairs):
        B = absolute_angles(tree, chosen)
        A, eye, zero = np.asarray(np.linalg.inv(B), dtype=np.float64), np.eye(n), np.zeros(n)
        joints = " and ".join(names.joint(i) for i, _, _ in chosen)
        absolute = (
            f"absolute angles: {joints} counted from the base (or the horizontal), not from the link before"
        )
        added = f"the angles of {joints} are added to those before where the robot's are added already"
        rates = f"absolute angles: the rates and torques of {joints} are absolute, their angles are not"
        inside = ", inside of the formulas"
        yield Hypothesis("absolute-angles", absolute, affine=_both(B))
        yield Hypothesis("absolute-angles", added, affine=_both(A))
        yield Hypothesis("angle-absolute", absolute + inside, affine=_inside(B))
        yield Hypothesis("angle-absolute", added + inside, affine=_inside(A))
        yield Hypothesis("angle-absolute", rates, affine=Affine(eye, zero, B))


def steiner(mass: float, c: Array) -> Array:
    """Return the parallel-axis term, m (c.c I - c c')."""
    return np.asarray(mass * (c @ c * np.eye(3) - np.outer(c, c)))


def _bodies(tree: Tree) -> Iterator[Hypothesis]:
    """Yield mistakes in the inertia of one link, or of all, and links that are taken for each other."""
    names = Names(tree)
    twice = "inertia about the joint used as if about the centre of mass: the parallel-axis term counts twice"
    changes: tuple[tuple[str, str, Callable[[Body], Array]], ...] = (
        (
            "parallel-axis",
            "the parallel-axis (Steiner) term m c² is missing",
            lambda b: b.inertia - steiner(b.mass, b.com),
        ),
        ("inertia-about-joint", twice, lambda b: b.inertia + steiner(b.mass, b.com)),
        (
            "no-inertia",
            "a point mass: its inertia about the centre of mass is missing",
            lambda b: 0.0 * b.inertia,
        ),
        (
            "products-of-inertia",
            "the products of inertia are missing",
            lambda b: np.diag(np.diag(b.inertia)),
        ),
        (
            "products-of-inertia",
            "the products of inertia have the other sign",
            lambda b: 2.0 * np.diag(np.diag(b.inertia)) - b.inertia,
        ),
    )
    for kind, text, inertia in changes:
        for i in range(tree.n):
            yield Hypothesis(
                kind, f"{names.link(i)}: {text}", tree=partial(_with_inertia, only=i, inertia=inertia)
            )
        yield Hypothesis(kind, f"every link: {text}", tree=partial(_with_inertia, only=None, inertia=inertia))
    for i in range(tree.n):
        text = f"{names.link(i)} is missing: no mass and no inertia"
        nothing: dict[str, Any] = {"mass": 0.0, "inertia": np.zeros((3, 3))}
        yield Hypothesis("no-link", text, tree=partial(Tree.with_body, i=i, **nothing))
    if tree.armature.any():
        missing = partial(replace, armature=np.zeros(tree.n))
        yield Hypothesis("armature", "the rotor inertias are missing", tree=missing)
    for i, j in itertools.combinations(range(tree.n), 2):
        for what, fields in (
            ("masses", ("mass",)),
            ("centres of mass", ("com",)),
            ("inertias", ("inertia",)),
            ("masses, centres of mass and inertias", Body._fields),
        ):
            text = f"the {what} of {names.link(i)} and {names.link(j)} are swapped"
            yield Hypothesis("links-swapped", text, tree=partial(_swap, i=i, j=j, fields=fields))


def _with_inertia(tree: Tree, only: int | None, inertia: Callable[[Body], Array]) -> Tree:
    """Return the tree with another inertia of one body, or of every one."""
    bodies = tree.bodies
    changed = (b._replace(inertia=inertia(b)) if only in (None, i) else b for i, b in enumerate(bodies))
    return replace(tree, bodies=tuple(changed))


def _swap(tree: Tree, i: int, j: int, fields: tuple[str, ...]) -> Tree:
    first, second = ({f: getattr(tree.bodies[k], f) for f in fields} for k in (i, j))
    return tree.with_body(i, **second).with_body(j, **first)


def _frames(tree: Tree) -> Iterator[Hypothesis]:
    """Yield mistakes in axes and in how joints stand."""
    names = Names(tree)
    for i in range(tree.n):
        joint, R = names.joint(i), tree.rotations[i]
        for k, sign in itertools.product(range(3), (1.0, -1.0)):
            axis = sign * np.eye(3)[k]
            if abs(abs(axis @ tree.axes[i]) - 1.0) < PARALLEL:
                continue  # the same axis, or another sign of the joint
            verb = "slides along" if tree.prismatic[i] else "turns about"
            text = f"{joint} {verb} {'-' if sign < 0 else ''}{_XYZ[k]}, the robot's {_vector(tree.axes[i])}"
            change = partial(Tree.with_item, field="axes", i=i, value=axis)
            yield Hypothesis("axis", text + " (in its frame at zero)", tree=change)
        for wrong, what in ((R.T, "transposed (turned the other way)"), (np.eye(3), "missing")):
            if not np.allclose(R, wrong):  # half a turn is its own transpose
                text = f"the fixed rotation before {joint} is {what}"
                change = partial(Tree.with_item, field="rotations", i=i, value=wrong)
                yield Hypothesis("rotation", text, tree=change)


def _lengths(tree: Tree) -> Iterator[Hypothesis]:
    """Yield lengths that are taken for others."""
    names = Names(tree)
    carried = [i for i in range(tree.n) if tree.parents[i] >= 0 and tree.positions[i].any()]
    for chosen in _all_and_each(carried):
        which = "the lengths of all links" if len(chosen) > 1 else f"the length to {names.joint(chosen[0])}"
        text = f"the distance of the centre of mass replaces {which} (lc for l)"
        yield Hypothesis("length", text, tree=partial(_short, chosen=tuple(chosen)))
    for i, j in itertools.combinations(carried, 2):
        text = f"the lengths to {names.joint(i)} and to {names.joint(j)} are swapped"
        yield Hypothesis("length", text, tree=partial(_lengths_swapped, i=i, j=j))


def _short(tree: Tree, chosen: tuple[int, ...]) -> Tree:
    for i in chosen:
        tree = tree.with_item("positions", i, tree.bodies[tree.parents[i]].com)
    return tree


def _lengths_swapped(tree: Tree, i: int, j: int) -> Tree:
    p, r = tree.positions[i], tree.positions[j]
    ratio = float(np.linalg.norm(r) / np.linalg.norm(p))
    return tree.with_item("positions", i, p * ratio).with_item("positions", j, r / ratio)


def _on(name: str, change: Callable[[Array], Array], becomes: str = "") -> Callable[[Quantities], Quantities]:
    """Return a change of one quantity, where it is asked for; `becomes` is the quantity that it gives."""
    return lambda p: {becomes or name: change(p[name])} if name in p else {}


def _scale(diagonal: float, others: float) -> Callable[[Array], Array]:
    """Return a change of D, or of the squares (diagonal) and the other products of velocities in H."""
    return lambda x: np.asarray(x * np.where(np.eye(x.shape[-1]) > 0.0, diagonal, others))


def _rates(along: float, across: float) -> Callable[[Array], Array]:
    """Return an H of along dD/dt v + across d(v'Dv)/dq; right are 1 and -1/2."""

    def change(H: Array) -> Array:
        # D's slopes from its Christoffel symbols: [i, j, k] is the derivative of D_ij by q_k.
        slope = H + np.swapaxes(H, -3, -2)
        straight = 0.5 * (slope + np.swapaxes(slope, -1, -2))
        return np.asarray(along * straight + across * np.moveaxis(slope, -1, -3))

    return change


def _transpose(H: Array) -> Array:
    """Return the H of C', made symmetric again."""
    T = np.swapaxes(H, -3, -2)
    return np.asarray(0.5 * (T + np.swapaxes(T, -1, -2)))


_MIXED = "every product of two different velocities"
_INCLUDED = "gravity is contained in the Coriolis torque"
#: Formulas that are wrong whatever the arm: kind, text, and the change of the quantities.
_FORMULAS: tuple[tuple[str, str, Callable[[Quantities], Quantities]], ...] = (
    ("diagonal", "D has its off-diagonal entries with the other sign", _on("D", _scale(1.0, -1.0))),
    ("diagonal", "D has no off-diagonal entries", _on("D", _scale(1.0, 0.0))),
    ("products", f"a factor 2 is missing in {_MIXED}", _on("H", _scale(1.0, 0.5))),
    ("products", f"a factor 1/2 is missing in {_MIXED}", _on("H", _scale(1.0, 2.0))),
    ("products", "all products of two different velocities are missing", _on("H", _scale(1.0, 0.0))),
    ("products", "all centrifugal products (squares) are missing", _on("H", _scale(0.0, 1.0))),
    ("products", "the centrifugal products (squares) have the other sign", _on("H", _scale(-1.0, 1.0))),
    ("products", "a factor 1/2 is missing in every square", _on("H", _scale(2.0, 1.0))),
    ("products", "a factor 2 is missing in every square", _on("H", _scale(0.5, 1.0))),
    ("transposed", "C is transposed", _on("H", _transpose)),
    ("christoffel", "-½ ∂(v'Dv)/∂q is missing: it is Ḋ v alone", _on("H", _rates(1.0, 0.0))),
    ("christoffel", "it is ½ Ḋ v", _on("H", _rates(0.5, 0.0))),
    ("christoffel", "the ½ of -½ ∂(v'Dv)/∂q is missing", _on("H", _rates(1.0, -1.0))),
    ("christoffel", "+½ ∂(v'Dv)/∂q replaces -½ ∂(v'Dv)/∂q", _on("H", _rates(1.0, 0.5))),
    ("christoffel", "Ḋ v is missing: it is -½ ∂(v'Dv)/∂q alone", _on("H", _rates(0.0, -0.5))),
    ("christoffel", "½ Ḋ v replaces Ḋ v", _on("H", _rates(0.5, -0.5))),
    ("gravity-included", _INCLUDED, _on("G", lambda G: G, "Z")),
    ("gravity-included", f"{_INCLUDED}, with the other sign", _on("G", lambda G: -G, "Z")),
)


def _structure() -> Iterator[Hypothesis]:
    """Yield mistakes in how the quantities are formed, whatever the arm."""
    wholes = {
        "D": "the inertia matrix",
        "H": "the Coriolis torque",
        "G": "gravity",
        "V": "the potential energy",
    }
    for name, what in wholes.items():
        changes = {
            f"a factor 2 is missing in all of {what}": 0.5,
            f"a factor 1/2 is missing in all of {what}": 2.0,
        }
        if name in ("D", "H"):  # gravity's sign and strength are found by least squares, as a vector
            changes |= {f"the sign of all of {what}": -1.0, f"{what} is zero": 0.0}
        for text, factor in changes.items():
            yield Hypothesis("whole", text, post=_on(name, partial(np.multiply, factor)))
    for kind, text, post in _FORMULAS:
        yield Hypothesis(kind, text, post=post)


def parameters(tree: Tree) -> list[Parameter]:
    """Return the numbers of the robot of which a model may have another value."""
    found = [one for i in range(tree.n) for one in _of_link(tree, i)]
    scales: dict[str, Callable[[Tree, float], Tree]] = {"all lengths times": _longer}
    if tree.n > 1:  # of one link they are its own numbers
        scales["all masses times"] = partial(_heavier, field="mass")
        scales["all inertias about the centres of mass times"] = partial(_heavier, field="inertia")
    found += [_number("scale", what, "", 1.0, change) for what, change in scales.items()]
    tool = _components(
        *("tool", "position of the tool", tree, lambda t: t.tool_position),
        lambda t, place: replace(t, tool_position=place),
    )
    return found + list(tool)


def _of_link(tree: Tree, i: int) -> Iterator[Parameter]:
    """Yield the numbers of a link and of its joint."""
    body, names, parent = tree.bodies[i], Names(tree), tree.parents[i]
    link, joint = names.link(i), names.joint(i)

    def with_moment(t: Tree, x: float, r: int, c: int) -> Tree:
        tensor = t.bodies[i].inertia.copy()
        tensor[r, c] = tensor[c, r] = x
        return t.with_body(i, inertia=tensor)

    def with_rotor(t: Tree, x: float) -> Tree:
        return replace(t, armature=np.where(np.arange(t.n) == i, x, t.armature))

    yield _number("mass", f"mass of {link}", "kg", body.mass, lambda t, x: t.with_body(i, mass=x))
    yield from _components(
        *("com", f"centre of mass of {link}", tree, lambda t: t.bodies[i].com),
        lambda t, place: t.with_body(i, com=place),
    )
    for r, c in MOMENTS:
        what = f"inertia I{_XYZ[r]}{_XYZ[c]} of {link}"
        yield _number("inertia", what, "kg m²", float(body.inertia[r, c]), partial(with_moment, r=r, c=c))
    what = f"length from {names.joint(parent) if parent >= 0 else 'the base'} to {joint}"
    yield from _components(
        *("length", what, tree, lambda t: t.positions[i]),
        lambda t, place: t.with_item("positions", i, place),
    )
    yield _number("armature", f"rotor inertia of {joint}", "kg m²", float(tree.armature[i]), with_rotor)

    def with_offset(x: float) -> Hypothesis:
        return Hypothesis("offset", "", affine=_inside(np.eye(tree.n), x * np.eye(tree.n)[i]))

    slides = tree.prismatic[i]
    unit = "m" if slides else "rad"
    yield Parameter("offset", f"offset added to q{i + 1}", unit, 0.0, not slides, with_offset)


def _number(
    kind: str, what: str, unit: str, value: float, change: Callable[[Tree, float], Tree]
) -> Parameter:
    """Return one number of the tree as a parameter."""

    def instance(x: float) -> Hypothesis:
        return Hypothesis(kind, what, tree=lambda t: change(t, x))

    return Parameter(kind, what, unit, value, False, instance)


def _components(
    kind: str, what: str, tree: Tree, at: Callable[[Tree], Array], place: Callable[[Tree, Array], Tree]
) -> Iterator[Parameter]:
    """Yield the components of a vector, and its length, as parameters."""
    start = at(tree)
    directions = [(f" along {_XYZ[k]}", axis) for k, axis in enumerate(np.eye(3))]
    if np.count_nonzero(np.abs(start) > 1e-12) > 1:
        directions.append((" along its line", start / np.linalg.norm(start)))
    for way, direction in directions:

        def change(t: Tree, x: float, direction: Array = direction) -> Tree:
            return place(t, at(t) + (x - at(t) @ direction) * direction)

        yield _number(kind, what + way, "m", float(start @ direction), change)


def _heavier(tree: Tree, x: float, field: str) -> Tree:
    return replace(tree, bodies=tuple(b._replace(**{field: x * getattr(b, field)}) for b in tree.bodies))


def _longer(tree: Tree, x: float) -> Tree:
    positions = tuple(x * p for p in tree.positions)
    return replace(_heavier(tree, x, "com"), positions=positions, tool_position=x * tree.tool_position)


def _vector(x: Array) -> str:
    """Return an axis as text: "-y", or its numbers."""
    for k in range(3):
        if abs(abs(x[k]) - 1.0) < PARALLEL:
            return f"{'-' if x[k] < 0.0 else ''}{_XYZ[k]}"
    return f"({', '.join(f'{value:.4g}' for value in x)})"
