"""The usual mistakes, each as a change of the reference arm that can be tried.

A :class:`Hypothesis` says "the model is right for an arm that differs in this": it changes the tree, the
coordinates or the quantities. A :class:`ParametricHypothesis` does so with one number, a parameter. All
quantities are polynomials of degree two in a mass, length or centre of mass, and trigonometric polynomials of
degree two in an angle, so three or five evaluations give them for every value of it, and the value that fits
best is found in closed form.

The complexity penalty orders hypotheses that fit equally well: slips of a pen (a sign, a factor 2, another
zero) have 1 to 2, wrong formulas 2 to 4, wrong values of a parameter 5 and more, because a parameter always
fits a little. Differences of a few tenths only break ties, so that the more common mistake is named first.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.arrays import Array
from armgpi.validation.tree import (
    PARALLEL,
    Affine,
    Body,
    Quantities,
    Tree,
    absolute_angles,
    christoffel,
    evaluate,
    identity,
    parallel_pairs,
)

_XYZ = "xyz"
_DEGREE = np.pi / 180.0
#: Entries of an inertia matrix: the moments, then the products.
MOMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class Hypothesis(NamedTuple):
    """One mistake that a model may have.

    Attributes:
        kind: short name of its kind.
        text: what it is, for the report.
        penalty: its complexity penalty; the simplest one that fits is named.
        tree: the arm for which the model would be right.
        affine: the coordinates in which it would be.
        post: what to do to the quantities.
        custom: in place of all that, a function of tree, configurations and names of quantities.
    """

    kind: str
    text: str
    penalty: float
    tree: Callable[[Tree], Tree] | None = None
    affine: Affine | None = None
    post: Callable[[Quantities], Quantities] | None = None
    custom: Callable[[Tree, Array, Iterable[str]], Quantities] | None = None

    def quantities(self, tree: Tree, q: Array, want: Iterable[str]) -> Quantities:
        """Return the quantities of a model with this mistake."""
        changed = tree if self.tree is None else self.tree(tree)
        if self.custom is not None:
            return self.custom(changed, q, want)
        quantities = evaluate(changed, q, want, self.affine)
        return quantities if self.post is None else {**quantities, **self.post(quantities)}

    def and_also(self, other: Hypothesis) -> Hypothesis:
        """Return both mistakes at once."""
        first, second = self.tree, other.tree

        def tree(x: Tree) -> Tree:
            x = x if first is None else first(x)
            return x if second is None else second(x)

        def post(x: Quantities) -> Quantities:
            x = x if self.post is None else {**x, **self.post(x)}
            return x if other.post is None else {**x, **other.post(x)}

        affine = self.affine
        if other.affine is not None:
            affine = other.affine if affine is None else other.affine.after(affine)
        both = self.post is not None or other.post is not None
        return Hypothesis(
            f"{self.kind}+{other.kind}",
            f"{self.text}; and {other.text}",
            self.penalty + other.penalty + 4.0,  # two mistakes are named only where no single one fits
            tree,
            affine,
            post if both else None,
        )


class ParametricHypothesis(NamedTuple):
    """A mistake in one number.

    Attributes:
        kind: short name of its kind.
        what: which number, for the report.
        unit: its unit.
        value: what the robot has.
        penalty: its complexity penalty.
        angle: whether the quantities are trigonometric in it, and not polynomial.
        instance: the hypothesis for a value of it.
    """

    kind: str
    what: str
    unit: str
    value: float
    penalty: float
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
    found = [
        *_coordinates(tree),
        *_bodies(tree),
        *_frames(tree),
        *_kinematic(),
        *_structure(),
        *_left_out(tree),
        *_unturned(tree),
    ]
    return sorted(found, key=lambda h: h.penalty)


def angle_maps(tree: Tree) -> list[Hypothesis]:
    """Return the mistakes in an angle that a single term may have."""
    maps = [h for h in _coordinates(tree) if h.affine is not None and _same_rates(h.affine)]
    n = tree.n
    for j in range(n):
        mine = f"q{j + 1}"
        maps.append(_mixed(n, j, {j: 0.0}, "angle-missing", f"{mine} is left out", 4))
        maps.append(_mixed(n, j, {j: 2.0}, "angle-doubled", f"2 {mine} stands for {mine}", 5))
        for k in range(n):
            # An angle is never taken for a length.
            if k == j or tree.prismatic[k] != tree.prismatic[j]:
                continue
            other, belongs = f"q{k + 1}", f"stands where {mine} belongs"
            maps += [
                _mixed(n, j, {j: 0.0, k: 1.0}, "angle-replaced", f"{other} {belongs}", 4),
                _mixed(n, j, {k: 1.0}, "angle-added", f"{mine} + {other} {belongs}", 4.5),
                _mixed(n, j, {k: -1.0}, "angle-added", f"{mine} - {other} {belongs}", 4.5),
            ]
    return sorted(maps, key=lambda h: h.penalty)


def _mixed(n: int, j: int, factors: Mapping[int, float], kind: str, text: str, penalty: float) -> Hypothesis:
    """Return the hypothesis that q_j is another combination of the angles, inside of the formulas."""
    A = np.eye(n)
    for k, factor in factors.items():
        A[j, k] = factor
    return Hypothesis(kind, text, penalty, affine=_inside(A))


def _same_rates(affine: Affine) -> bool:
    return bool(np.array_equal(affine.L, np.eye(len(affine.b))))


def _inside(A: Array, b: Array | None = None) -> Affine:
    """Return other angles inside of the formulas alone."""
    n = len(A)
    return Affine(A, np.zeros(n) if b is None else b, np.eye(n))


def _coordinates(tree: Tree) -> Iterator[Hypothesis]:
    """Yield mistakes in the joint coordinates."""
    n, names = tree.n, Names(tree)
    eye, zero = np.eye(n), np.zeros(n)
    revolute = [i for i in range(n) if not tree.prismatic[i]]
    for i in range(n):
        A = eye.copy()
        A[i, i] = -1.0
        way = "slides" if tree.prismatic[i] else "turns"
        text = f"{names.joint(i)} {way} the other way: its sign, or the direction of its axis"
        yield Hypothesis("joint-sign", text, 1, affine=Affine(A, zero, A))
        text = f"the sign of q{i + 1} inside of the formulas"
        yield Hypothesis("angle-sign", text, 3, affine=_inside(A))
    if n > 1:
        text = "every joint has the other sign"
        yield Hypothesis("joint-sign", text, 2, affine=Affine(-eye, zero, -eye))
        yield Hypothesis("angle-sign", f"{text} inside of the formulas", 3, affine=_inside(-eye))
    for i in revolute:
        for degrees, slip in ((90, " (cos for sin)"), (-90, " (sin for cos)"), (180, "")):
            shift = f"q{i + 1} {'+' if degrees > 0 else '-'} {abs(degrees)}°"
            text = f"{names.joint(i)} is measured from another zero: {shift} stands where q{i + 1} belongs"
            yield Hypothesis("offset", text + slip, 2, affine=_inside(eye, degrees * _DEGREE * eye[i]))
    # Rarely some angles alone; a mistake in all is one line of code.
    subsets = ([revolute] if revolute else []) + ([[i] for i in revolute] if len(revolute) > 1 else [])
    for chosen in subsets:
        which = "all angles" if chosen == revolute else names.joint(chosen[0])
        scale = np.ones(n)
        scale[chosen] = _DEGREE
        penalty = 2.0 if chosen == revolute else 2.5
        A, back = np.diag(scale), np.diag(1.0 / scale)
        text = f"degrees: {which} taken in degrees where radians are given"
        yield Hypothesis("degrees", text, penalty, affine=_inside(A))
        yield Hypothesis(
            "degrees", f"{text}, rates and torques too", penalty + 0.5, affine=Affine(A, zero, A)
        )
        text = f"degrees: {which} turned into degrees inside of the formulas"
        yield Hypothesis("degrees", text, penalty, affine=_inside(back))
    for order in _orders(n):
        P = eye[list(order)]
        listed = ", ".join(f"q{j + 1}" for j in order)
        own = ", ".join(f"q{j + 1}" for j in range(n))
        text = f"the joints stand in another order: the robot's {own} are the model's {listed}"
        yield Hypothesis("joint-order", text, 2, affine=Affine(P, zero, P))
        text = f"the angles are mixed up inside of the formulas: {own} stand as {listed}"
        yield Hypothesis("joint-order", text, 3, affine=_inside(P))
    yield from _absolute(tree)


def _orders(n: int) -> Iterator[tuple[int, ...]]:
    """Yield other orders of the joints: all for a short arm, else two joints swapped."""
    if n <= 4:
        yield from (p for p in itertools.permutations(range(n)) if p != tuple(range(n)))
        return
    yield tuple(reversed(range(n)))  # counted from the tip
    for i, j in itertools.combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        yield tuple(order)


def _absolute(tree: Tree) -> Iterator[Hypothesis]:
    """Yield angles counted from the base (or the other way round) where joints are parallel."""
    n, names = tree.n, Names(tree)
    pairs = parallel_pairs(tree)
    chosen_sets = [pairs] + ([[p] for p in pairs] if len(pairs) > 1 else []) if pairs else []
    for chosen in chosen_sets:
        B = absolute_angles(tree, chosen)
        A, eye, zero = np.asarray(np.linalg.inv(B), dtype=np.float64), np.eye(n), np.zeros(n)
        joints = " and ".join(names.joint(i) for i, _, _ in chosen)
        penalty = 2.0 if chosen == pairs else 2.5
        absolute = (
            f"absolute angles: {joints} counted from the base (or the horizontal), not from the link before"
        )
        added = f"the angles of {joints} are added to those before where the robot's are added already"
        inside = ", inside of the formulas"
        for text, more, affine in (
            (absolute, 0.0, Affine(B, zero, B)),
            (absolute + inside, 0.5, _inside(B)),
            (
                f"absolute angles: the rates and torques of {joints} are absolute, their angles are not",
                1.0,
                Affine(eye, zero, B),
            ),
            (
                f"the rates and torques of {joints} are added up once more, their angles are not",
                2.0,
                Affine(eye, zero, A),
            ),
            (added, 1.0, Affine(A, zero, A)),
            (added + inside, 1.5, _inside(A)),
        ):
            yield Hypothesis("absolute-angles", text, penalty + more, affine=affine)


def _steiner(body: Body) -> Array:
    """Return the parallel-axis term, m (c.c I - c c')."""
    c = body.com
    return np.asarray(body.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def _bodies(tree: Tree) -> Iterator[Hypothesis]:
    """Yield mistakes in mass, centre of mass and inertia."""
    yield from _every_body()
    names = Names(tree)
    for i in range(tree.n):
        link = names.link(i)
        for kind, text, penalty, changes in (*_wrong_inertias(tree.bodies[i]), *_wrong_coms(tree, i)):
            yield Hypothesis(kind, link + text, penalty, tree=_with_body(i, changes))
        for j in range(i):
            yield from _swapped_bodies(tree, i, j)


_NO_STEINER = "the parallel-axis (Steiner) term m c² is missing"
_TWO_STEINER = (
    "inertia about the joint used as if about the centre of mass: the parallel-axis term counts twice"
)


def _every_body() -> Iterator[Hypothesis]:
    """Yield mistakes in the inertias of all links at once."""
    point = "every link is a point mass: the inertias about the centres of mass are missing"
    products = "the products of inertia"
    changes: tuple[tuple[str, str, float, Callable[[Body], Array]], ...] = (
        ("parallel-axis", f"every link: {_NO_STEINER}", 2, lambda b: b.inertia - _steiner(b)),
        ("inertia-about-joint", f"every link: {_TWO_STEINER}", 2, lambda b: b.inertia + _steiner(b)),
        ("no-inertia", point, 2, lambda b: 0.0 * b.inertia),
        ("inertia", "the inertias of all links are halved", 2.5, lambda b: 0.5 * b.inertia),
        ("inertia", "the inertias of all links are doubled", 2.5, lambda b: 2.0 * b.inertia),
        (
            "products-of-inertia",
            f"{products} have the other sign in every link",
            3,
            lambda b: _signed(b, -1.0),
        ),
        ("products-of-inertia", f"{products} are missing in every link", 3, lambda b: _signed(b, 0.0)),
    )
    for kind, text, penalty, inertia in changes:
        yield Hypothesis(kind, text, penalty, tree=partial(_with_inertias, inertia=inertia))
    text = "the rotor inertias are missing"
    yield Hypothesis("armature", text, 3, tree=lambda t: replace(t, armature=np.zeros(t.n)))


#: Kind, text after the link's name, penalty, and the fields of the body that change.
_Change = tuple[str, str, float, dict[str, object]]


def _wrong_inertias(b: Body) -> Iterator[_Change]:
    """Yield mistakes in mass and inertia of one link, and in the axes of what it has."""
    none = 0.0 * b.inertia
    yield "parallel-axis", f": {_NO_STEINER}", 2, {"inertia": b.inertia - _steiner(b)}
    yield "inertia-about-joint", f": {_TWO_STEINER}", 2, {"inertia": b.inertia + _steiner(b)}
    yield "no-inertia", ": its inertia about the centre of mass is missing", 2, {"inertia": none}
    yield "no-mass", ": its mass is missing", 2, {"mass": 0.0}
    yield "no-link", " is missing: no mass and no inertia", 2, {"mass": 0.0, "inertia": none}
    products = "products-of-inertia"
    yield products, ": the products of inertia have the other sign", 3, {"inertia": _signed(b, -1.0)}
    yield products, ": the products of inertia are missing", 3, {"inertia": _signed(b, 0.0)}
    for order in list(itertools.permutations(range(3)))[1:]:  # the first is x, y, z itself
        text = f"about the wrong axes: x, y, z stand as {', '.join(_XYZ[k] for k in order)}"
        yield "inertia-axes", f": inertia {text}", 3, {"inertia": b.inertia[np.ix_(order, order)]}
        text = text.replace("about", "along")
        yield "com-axes", f": centre of mass {text}", 3, {"com": b.com[list(order)]}


def _wrong_coms(tree: Tree, i: int) -> Iterator[_Change]:
    """Yield mistakes in where the centre of mass of one link is."""
    com, end = tree.bodies[i].com, tree.next_joint(i)
    yield "com", ": centre of mass at the joint", 3, {"com": np.zeros(3)}
    yield "com", ": centre of mass mirrored, with the other sign", 2.5, {"com": -com}
    for k in range(3):
        mirrored = np.where(np.arange(3) == k, -com, com)
        yield "com", f": the {_XYZ[k]} of its centre of mass has the other sign", 2.6, {"com": mirrored}
    if end is not None:
        counted = ": distance of its centre of mass counted from the far end (l - lc for lc)"
        yield "com", ": centre of mass at its far end (the length l for lc)", 2.5, {"com": end}
        yield "com", counted, 2.5, {"com": end - com}
        yield "com", ": centre of mass in the middle (l/2 for lc)", 2.7, {"com": 0.5 * end}


def _swapped_bodies(tree: Tree, i: int, j: int) -> Iterator[Hypothesis]:
    """Yield values of two links that are swapped."""
    names, first, second = Names(tree), tree.bodies[j], tree.bodies[i]
    for what, fields in (
        ("masses", ("mass",)),
        ("centres of mass", ("com",)),
        ("inertias", ("inertia",)),
        ("masses, centres of mass and inertias", ("mass", "com", "inertia")),
    ):
        to_i, to_j = ({field: getattr(b, field) for field in fields} for b in (first, second))
        text = f"the {what} of {names.link(j)} and {names.link(i)} are swapped"
        yield Hypothesis("links-swapped", text, 3, tree=_both(i, to_i, j, to_j))


def _with_body(i: int, changes: Mapping[str, object]) -> Callable[[Tree], Tree]:
    """Return a change of one body."""
    return lambda t: t.with_body(i, **changes)


def _with_inertias(tree: Tree, inertia: Callable[[Body], Array]) -> Tree:
    """Return the tree with another inertia of every body."""
    return replace(tree, bodies=tuple(b._replace(inertia=inertia(b)) for b in tree.bodies))


def _both(i: int, mine: Mapping[str, object], j: int, others: Mapping[str, object]) -> Callable[[Tree], Tree]:
    """Return a change of two bodies."""
    return lambda t: t.with_body(i, **mine).with_body(j, **others)


def _signed(body: Body, factor: float) -> Array:
    """Return an inertia whose products are multiplied by a factor."""
    tensor = body.inertia
    return np.asarray(factor * tensor + (1.0 - factor) * np.diag(np.diag(tensor)))


def _frames(tree: Tree) -> Iterator[Hypothesis]:
    """Yield mistakes in axes and in where joints stand."""
    names = Names(tree)

    def item(field: str, i: int, value: object) -> Callable[[Tree], Tree]:
        return lambda t: t.with_item(field, i, value)

    for i in range(tree.n):
        joint = names.joint(i)
        for k, sign in itertools.product(range(3), (1.0, -1.0)):
            axis = np.zeros(3)
            axis[k] = sign
            if abs(abs(axis @ tree.axes[i]) - 1.0) < PARALLEL:
                continue  # the same axis, or another sign of the joint
            verb = "slides along" if tree.prismatic[i] else "turns about"
            text = f"{joint} {verb} {'-' if sign < 0 else ''}{_XYZ[k]}, the robot's {_vector(tree.axes[i])}"
            yield Hypothesis("axis", text + " (in its frame at zero)", 3, tree=item("axes", i, axis))
        word = "revolute" if tree.prismatic[i] else "prismatic"
        yield Hypothesis(
            "joint-type", f"{joint} is taken as {word}", 4, tree=item("prismatic", i, not tree.prismatic[i])
        )
        R, p = tree.rotations[i], tree.positions[i]
        if not np.allclose(R, R.T):  # half a turn is its own transpose
            text = f"the fixed rotation before {joint} is transposed (turned the other way)"
            yield Hypothesis("rotation", text, 3, tree=item("rotations", i, R.T))
        if not np.allclose(R, np.eye(3)):
            text = f"the fixed rotation before {joint} is missing"
            yield Hypothesis("rotation", text, 3.5, tree=item("rotations", i, np.eye(3)))
        if p.any():
            text = f"the length to {joint} has the other sign"
            yield Hypothesis("length", text, 3, tree=item("positions", i, -p))
            text = f"the length to {joint} is missing"
            yield Hypothesis("length", text, 3, tree=item("positions", i, 0.0 * p))
            if tree.parents[i] >= 0:
                com = tree.bodies[tree.parents[i]].com
                text = f"the distance of the centre of mass stands for the length to {joint} (lc for l)"
                yield Hypothesis("length", text, 2.6, tree=item("positions", i, com))
    yield from _lengths(tree, names)
    if tree.tool_position.any():
        text = "the tool stands at the last joint: its length is missing"
        yield Hypothesis("tool", text, 3, tree=lambda t: replace(t, tool_position=np.zeros(3)))


def _lengths(tree: Tree, names: Names) -> Iterator[Hypothesis]:
    """Yield mistakes in two or more lengths at once."""
    sizes = [float(np.linalg.norm(p)) for p in tree.positions]
    carried = [i for i in range(tree.n) if tree.parents[i] >= 0 and sizes[i] > 0.0]
    if len(carried) > 1:
        text = "the distances of the centres of mass stand for the lengths of all links (lc for l)"

        def short(t: Tree) -> Tree:
            for i in carried:
                t = t.with_item("positions", i, tree.bodies[tree.parents[i]].com)
            return t

        yield Hypothesis("length", text, 2.4, tree=short)

    def swapped(i: int, j: int) -> Callable[[Tree], Tree]:
        def change(t: Tree) -> Tree:
            t = t.with_item("positions", i, t.positions[i] * (sizes[j] / sizes[i]))
            if j < t.n:
                return t.with_item("positions", j, t.positions[j] * (sizes[i] / sizes[j]))
            return replace(t, tool_position=t.tool_position * (sizes[i] / sizes[j]))

        return change

    sizes.append(float(np.linalg.norm(tree.tool_position)))
    words = [f"the length to {names.joint(i)}" for i in range(tree.n)] + ["the length to the tool"]
    ends = [*carried, *([tree.n] if sizes[-1] > 0.0 else [])]
    for i, j in itertools.combinations(ends, 2):
        text = f"{words[i]} and {words[j]} are swapped"
        yield Hypothesis("lengths-swapped", text, 3, tree=swapped(i, j))


def _kinematic() -> Iterator[Hypothesis]:
    """Yield mistakes in the frame of the tool's position and of its Jacobian."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.diag(signs) @ np.eye(3)[list(order)]
            if np.array_equal(R, np.eye(3)):
                continue
            axes = ", ".join(f"{'-' if s < 0.0 else ''}{_XYZ[k]}" for s, k in zip(signs, order, strict=True))
            text = f"the kinematics in another frame: {axes} of the base stand as x, y, z"
            # Fewer minus signs are likelier, and a left-handed frame is less so than a right-handed one.
            flips = sum(s < 0.0 for s in signs)
            penalty = 2.0 + 0.1 * flips + (0.0 if np.linalg.det(R) > 0.0 else 0.3)
            yield Hypothesis("frame", text, penalty, post=partial(_in_frame, R=R))
    rows: tuple[tuple[str, float, Callable[[Array, Array, Array], Array]], ...] = (
        (
            "the Jacobian along the axes of the tool (body frame), not along those of the base",
            2,
            lambda J, R, _: np.concatenate([R.T @ J[:3], R.T @ J[3:]]),
        ),
        (
            "the Jacobian of the point of the tool that passes the base's origin (spatial velocity)",
            2,
            lambda J, _, p: np.concatenate([J[:3] + np.cross(p, J[3:], axisb=0).T, J[3:]]),
        ),
        (
            "the angular rows of the Jacobian along the axes of the tool, not along those of the base",
            2.5,
            lambda J, R, _: np.concatenate([J[:3], R.T @ J[3:]]),
        ),
        (
            "the angular rows of the Jacobian are rates of roll, pitch, yaw (analytic), "
            "not angular velocities",
            2.5,
            lambda J, R, _: np.concatenate([J[:3], _of_rpy(R) @ J[3:]]),
        ),
        (
            "the angular rows of the Jacobian are rates of ZYZ Euler angles (analytic), "
            "not angular velocities",
            2.5,
            lambda J, R, _: np.concatenate([J[:3], _of_zyz(R) @ J[3:]]),
        ),
    )
    for text, penalty, change in rows:
        yield Hypothesis("jacobian", text, penalty, custom=_jacobian(change))


def _in_frame(p: Quantities, R: Array) -> Quantities:
    """Return position and Jacobian of the tool along other axes."""
    changed = {"F": p["F"] @ R.T} if "F" in p else {}
    if "J" in p:
        changed["J"] = np.concatenate([R @ p["J"][:, :3], R @ p["J"][:, 3:]], axis=1)
    return changed


def _jacobian(change: Callable[[Array, Array, Array], Array]) -> Callable[..., Quantities]:
    """Return the quantities with another Jacobian: a function of it, of rotation and position of the tool."""

    def custom(t: Tree, q: Array, want: Iterable[str]) -> Quantities:
        quantities = evaluate(t, q, want)
        if "J" in quantities:
            tool = evaluate(t, q, ("R", "F"))
            rows = zip(quantities["J"], tool["R"], tool["F"], strict=True)
            quantities["J"] = np.stack([change(J, R, p) for J, R, p in rows])
        return quantities

    return custom


def _of_rpy(R: Array) -> Array:
    """Return the rates of roll, pitch and yaw from the angular velocity along the base (Siciliano 3.6)."""
    pitch, yaw = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)), np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    T = np.array([[c * np.cos(pitch), -s, 0.0], [s * np.cos(pitch), c, 0.0], [-np.sin(pitch), 0.0, 1.0]])
    return np.asarray(np.linalg.pinv(T))


def _of_zyz(R: Array) -> Array:
    """Return the rates of ZYZ Euler angles from the angular velocity along the base (Siciliano 3.6)."""
    a, b = np.arctan2(R[1, 2], R[0, 2]), np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2])
    c, s = np.cos(a), np.sin(a)
    T = np.array([[0.0, -s, c * np.sin(b)], [0.0, c, s * np.sin(b)], [1.0, 0.0, np.cos(b)]])
    return np.asarray(np.linalg.pinv(T))


def _on(name: str, change: Callable[[Array], Array], becomes: str = "") -> Callable[[Quantities], Quantities]:
    """Return a change of one quantity, where it is asked for; `becomes` is the quantity that it gives."""
    return lambda p: {becomes or name: change(p[name])} if name in p else {}


def _scaled(diagonal: float, others: float) -> Callable[[Array], Array]:
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


def _transposed(H: Array) -> Array:
    """Return the H of C', made symmetric again."""
    T = np.swapaxes(H, -3, -2)
    return np.asarray(0.5 * (T + np.swapaxes(T, -1, -2)))


_MIXED = "every product of two different velocities"
_INCLUDED = "gravity is contained in the Coriolis torque"
#: Formulas that are wrong whatever the arm: kind, text, penalty, and the change of the quantities.
_FORMULAS: tuple[tuple[str, str, float, Callable[[Quantities], Quantities]], ...] = (
    ("sign", "D has its off-diagonal entries with the other sign", 2, _on("D", _scaled(1.0, -1.0))),
    ("missing", "D has no off-diagonal entries", 2, _on("D", _scaled(1.0, 0.0))),
    ("factor", f"a factor 2 is missing in {_MIXED}", 1.5, _on("H", _scaled(1.0, 0.5))),
    ("factor", f"a factor 1/2 is missing in {_MIXED}", 1.5, _on("H", _scaled(1.0, 2.0))),
    ("missing", "all products of two different velocities are missing", 2, _on("H", _scaled(1.0, 0.0))),
    ("missing", "all centrifugal products (squares) are missing", 2, _on("H", _scaled(0.0, 1.0))),
    ("sign", "the centrifugal products (squares) have the other sign", 2, _on("H", _scaled(-1.0, 1.0))),
    ("factor", "a factor 1/2 is missing in every square", 2, _on("H", _scaled(2.0, 1.0))),
    ("factor", "a factor 2 is missing in every square", 2, _on("H", _scaled(0.5, 1.0))),
    ("transposed", "C is transposed", 1.5, _on("H", _transposed)),
    ("christoffel", "-½ ∂(v'Dv)/∂q is missing: it is Ḋ v alone", 1.8, _on("H", _rates(1.0, 0.0))),
    ("christoffel", "it is ½ Ḋ v", 1.8, _on("H", _rates(0.5, 0.0))),
    ("christoffel", "the ½ of -½ ∂(v'Dv)/∂q is missing", 1.8, _on("H", _rates(1.0, -1.0))),
    ("christoffel", "+½ ∂(v'Dv)/∂q stands for -½ ∂(v'Dv)/∂q", 1.8, _on("H", _rates(1.0, 0.5))),
    ("christoffel", "Ḋ v is missing: it is -½ ∂(v'Dv)/∂q alone", 1.8, _on("H", _rates(0.0, -0.5))),
    ("christoffel", "½ Ḋ v stands for Ḋ v", 1.8, _on("H", _rates(0.5, -0.5))),
    ("gravity-included", _INCLUDED, 1.5, _on("G", lambda G: G, "Z")),
    ("gravity-included", f"{_INCLUDED}, with the other sign", 2, _on("G", lambda G: -G, "Z")),
    (
        "jacobian",
        "the rows of the Jacobian stand in another order: angular first",
        2,
        _on("J", lambda J: np.roll(J, 3, axis=1)),
    ),
)


def _structure() -> Iterator[Hypothesis]:
    """Yield mistakes in how the quantities are formed, whatever the arm."""
    for name, what in (
        ("D", "the inertia matrix"),
        ("H", "the Coriolis torque"),
        ("G", "gravity"),
        ("V", "the potential energy"),
    ):
        changes: list[tuple[str, str, float, float]] = [
            ("factor", f"a factor 2 is missing in all of {what}", 2, 0.5),
            ("factor", f"a factor 1/2 is missing in all of {what}", 2, 2.0),
        ]
        # Gravity's sign and strength are found by least squares, as a vector.
        if name in ("D", "H"):
            changes += [
                ("sign", f"the sign of all of {what}", 1, -1.0),
                ("missing", f"{what} is zero", 1, 0.0),
            ]
        for kind, text, penalty, factor in changes:
            yield Hypothesis(kind, text, penalty, post=_on(name, partial(np.multiply, factor)))
    for kind, text, penalty, post in _FORMULAS:
        yield Hypothesis(kind, text, penalty, post=post)


def _left_out(tree: Tree) -> Iterator[Hypothesis]:
    """Yield links that do not turn, or do not move, with one of the joints that carry them."""
    n, names = tree.n, Names(tree)
    for k in range(n):
        chain, j = [], k
        while j >= 0:
            chain.append(j)
            j = tree.parents[j]
        for j in chain:
            for turning in (True, False) if not tree.prismatic[j] else (False,):
                if turning and not tree.bodies[k].inertia.any():
                    continue
                verb = "rotation" if turning else "motion of the centre of mass"
                text = f"the {verb} of {names.link(k)} with {names.joint(j)} is left out"
                yield Hypothesis("left-out", text, 3, custom=_dropper(k, j, turning))


def _dropper(k: int, j: int, turning: bool) -> Callable[[Tree, Array, Iterable[str]], Quantities]:
    """Return the quantities where body k does not turn (or its centre not move) with joint j."""

    def lost(tree: Tree, _: Array, spin: Array, move: Array) -> Array:
        body = tree.bodies[k]
        # What v' J' I J v loses with the column of joint j.
        part, tensor = (spin, body.inertia) if turning else (move, body.mass * np.eye(3))
        kept = part.copy()
        kept[:, j] = 0.0
        return np.asarray(part.T @ tensor @ part - kept.T @ tensor @ kept)

    return _less(k, lost)


def _less(k: int, lost: Callable[[Tree, Array, Array, Array], Array]) -> Callable[..., Quantities]:
    """Return the quantities of an arm whose D lacks something of body k.

    Args:
        k: the body.
        lost: gives what D lacks, (n, n), for the tree, the rotation of the body in the base, and the
            Jacobians of its turning and of its centre of mass, (3, n), along its own axes.
    """

    def custom(tree: Tree, q: Array, want: Iterable[str]) -> Quantities:
        want = tuple(want)
        quantities = evaluate(tree, q, want)
        model = tree.model()
        data = model.createData()
        com, n = tree.bodies[k].com, tree.n

        def all_lost(rows: Array) -> Array:
            out = np.empty((len(rows), n, n))
            for row, x in enumerate(rows):
                pin.forwardKinematics(model, data, x)
                J = pin.computeJointJacobian(model, data, x, k + 1).reshape(6, n)
                spin = J[3:].copy()
                out[row] = lost(tree, data.oMi[k + 1].rotation, spin, J[:3] + np.cross(spin.T, com).T)
            return out

        if "D" in want:
            quantities["D"] = quantities["D"] - all_lost(q)
        if "H" in want:
            # By differences: this D has no model that Pinocchio could differentiate.
            step, columns = 1e-3, []
            for e in np.eye(n):
                near, far = (all_lost(q + step * m * e) - all_lost(q - step * m * e) for m in (1, 2))
                columns.append((8.0 * near - far) / (12.0 * step))
            quantities["H"] = quantities["H"] - christoffel(np.stack(columns, axis=-1))
        return quantities

    return custom


def _unturned(tree: Tree) -> Iterator[Hypothesis]:
    """Yield inertias that are not turned from the link into the base, or the wrong way."""
    names = Names(tree)

    def wrong(k: int, end: Array, backward: bool) -> Callable[[Tree, Array, Array, Array], Array]:
        def lost(t: Tree, R: Array, spin: Array, _: Array) -> Array:
            tensor, across = t.bodies[k].inertia, R @ end
            own = end.T @ tensor @ end  # in the frame at the far end of the link, as in Denavit-Hartenberg
            seen = across.T @ own @ across if backward else own
            over = R @ spin
            return np.asarray(spin.T @ tensor @ spin - over.T @ seen @ over)

        return lost

    def links(
        chosen: Iterable[int], ends_of: Mapping[int, Array], backward: bool
    ) -> Callable[[Tree, Array, Iterable[str]], Quantities]:
        changes = [_less(k, wrong(k, ends_of[k], backward)) for k in chosen]

        def custom(t: Tree, q: Array, want: Iterable[str]) -> Quantities:
            want = tuple(want)
            right, total = evaluate(t, q, want), evaluate(t, q, want)
            # What each link loses adds up, as D is a sum over the links.
            for change in changes:
                one = change(t, q, want)
                total = {name: total[name] + one[name] - right[name] for name in total}
            return total

        return custom

    turning = [k for k in range(tree.n) if tree.bodies[k].inertia.any()]
    # Denavit-Hartenberg puts a link's frame at its far end; then R I R' needs the rotation there.
    far = {k: _far_rotation(tree, k) for k in turning}
    here = {k: np.eye(3) for k in turning}
    choices = [here] + ([far] if any(not np.allclose(R, np.eye(3)) for R in far.values()) else [])
    groups = [turning] + ([[k] for k in turning] if len(turning) > 1 else [])
    for frame in choices:
        for chosen in groups:
            which = "every link" if chosen == turning else names.link(chosen[0])
            for backward in (False, True):
                how = (
                    "turned the wrong way (R' I R for R I R')"
                    if backward
                    else "not turned into the base frame (I for R I R')"
                )
                text = f"the inertia of {which} is {how}"
                penalty = 2.8 if chosen == turning else 3.2
                yield Hypothesis("inertia-frame", text, penalty, custom=links(chosen, frame, backward))


def _far_rotation(tree: Tree, k: int) -> Array:
    """Return the fixed rotation at the far end of link k: before the next joint, or of the tool."""
    for j, parent in enumerate(tree.parents):
        if parent == k:
            return tree.rotations[j]
    return tree.tool_rotation if tree.tool_parent == k else np.eye(3)


def parametric_hypotheses(tree: Tree) -> list[ParametricHypothesis]:
    """Return the mistakes in one number of the robot."""
    found: list[ParametricHypothesis] = []
    for i in range(tree.n):
        found += _body_numbers(tree, i)
        found += _joint_numbers(tree, i)
    found += _scales(tree)
    for i in range(tree.n):
        found += _moved_links(tree, i)
    text, tool = "position of the tool", tree.tool_position
    found += _components("tool", text, tool, lambda t, x: replace(t, tool_position=x))
    return found


def _number(
    kind: str,
    what: str,
    unit: str,
    value: float,
    penalty: float,
    change: Callable[[Tree, float], Tree],
    angle: bool = False,
) -> ParametricHypothesis:
    """Return the hypothesis that one number of the tree has another value."""

    def instance(x: float) -> Hypothesis:
        return Hypothesis(kind, what, penalty, tree=lambda t: change(t, x))

    return ParametricHypothesis(kind, what, unit, value, penalty, angle, instance)


def _directions(start: Array) -> Iterator[tuple[str, Array, float]]:
    """Yield the directions in which a vector may be wrong: text, unit vector, additional penalty."""
    for k, axis in enumerate(np.eye(3)):
        # A component that the robot does not have is rarely what a model has too much.
        yield f" along {_XYZ[k]}", axis, 0.0 if start[k] else 1.0
    if np.count_nonzero(np.abs(start) > 1e-12) > 1:
        yield " along its line", start / np.linalg.norm(start), 0.0


def _components(
    kind: str, what: str, start: Array, place: Callable[[Tree, Array], Tree]
) -> Iterator[ParametricHypothesis]:
    """Yield the hypotheses that a vector has another component, or another length."""
    for way, direction, more in _directions(start):
        across = start - (start @ direction) * direction

        def change(t: Tree, x: float, across: Array = across, direction: Array = direction) -> Tree:
            return place(t, across + x * direction)

        yield _number(kind, what + way, "m", float(start @ direction), 5 + more, change)


def _body_numbers(tree: Tree, i: int) -> Iterator[ParametricHypothesis]:
    """Yield the numbers of body i."""
    b, link = tree.bodies[i], Names(tree).link(i)
    yield _number("mass", f"mass of {link}", "kg", b.mass, 5, lambda t, x: t.with_body(i, mass=x))
    yield from _components("com", f"centre of mass of {link}", b.com, lambda t, x: t.with_body(i, com=x))
    for r, c in MOMENTS:

        def change(t: Tree, x: float, r: int = r, c: int = c) -> Tree:
            tensor = t.bodies[i].inertia.copy()
            tensor[r, c] = tensor[c, r] = x
            return t.with_body(i, inertia=tensor)

        what = f"inertia I{_XYZ[r]}{_XYZ[c]} of {link}"
        yield _number("inertia", what, "kg m²", float(b.inertia[r, c]), 5 if r == c else 6, change)


def _joint_numbers(tree: Tree, i: int) -> Iterator[ParametricHypothesis]:
    """Yield the numbers of joint i: the length before it, its rotor, its tilt and its zero."""
    names, parent, slides = Names(tree), tree.parents[i], tree.prismatic[i]
    joint = names.joint(i)
    what = f"length from {names.joint(parent) if parent >= 0 else 'the base'} to {joint}"
    yield from _components("length", what, tree.positions[i], lambda t, x: t.with_item("positions", i, x))

    def rotor(t: Tree, x: float) -> Tree:
        return replace(t, armature=np.where(np.arange(t.n) == i, x, t.armature))

    yield _number("armature", f"rotor inertia of {joint}", "kg m²", float(tree.armature[i]), 7, rotor)
    for k, axis in enumerate(np.eye(3)):
        # A tilt about a joint's own axis is another zero of it.
        if not slides and abs(abs(axis @ tree.axes[i]) - 1.0) < PARALLEL:
            continue

        def tilt(t: Tree, x: float, axis: Array = axis) -> Tree:
            return t.with_item("rotations", i, t.rotations[i] @ pin.exp3(x * axis))

        what = f"angle by which {joint} is tilted about {_XYZ[k]}"
        yield _number("tilt", what, "rad", 0.0, 7, tilt, angle=True)

    def shifted(x: float) -> Hypothesis:
        same = identity(tree.n)
        return Hypothesis("offset", f"zero of {joint}", 4, affine=same._replace(b=x * same.A[i]))

    unit = "m" if slides else "rad"
    yield ParametricHypothesis("offset", f"offset added to q{i + 1}", unit, 0.0, 4, not slides, shifted)


def _scales(tree: Tree) -> Iterator[ParametricHypothesis]:
    """Yield all masses, inertias or lengths times a factor: another unit, usually."""

    def bodies(change: Callable[[Body, float], Body]) -> Callable[[Tree, float], Tree]:
        return lambda t, x: replace(t, bodies=tuple(change(b, x) for b in t.bodies))

    def lengths(t: Tree, x: float) -> Tree:
        positions = tuple(x * p for p in t.positions)
        t = bodies(lambda b, x: b._replace(com=x * b.com))(t, x)
        return replace(t, positions=positions, tool_position=x * t.tool_position)

    if tree.n > 1:  # of one link they are its own numbers
        masses = bodies(lambda b, x: b._replace(mass=x * b.mass))
        inertias = bodies(lambda b, x: b._replace(inertia=x * b.inertia))
        yield _number("scale", "all masses times", "", 1.0, 6, masses)
        yield _number("scale", "all inertias about the centres of mass times", "", 1.0, 6, inertias)
    yield _number("scale", "all lengths times", "", 1.0, 6, lengths)


def _moved_links(tree: Tree, i: int) -> Iterator[ParametricHypothesis]:
    """Yield lengths to joint i with which the centre of mass of the link before it moves."""
    names, k, p = Names(tree), tree.parents[i], tree.positions[i]
    for way, direction, more in _directions(p):
        if k < 0 or more:
            continue

        def longer(t: Tree, x: float, direction: Array = direction) -> Tree:
            change = (x - float(p @ direction)) * direction
            t = t.with_item("positions", i, t.positions[i] + change)
            return t.with_body(k, com=t.bodies[k].com + change)

        what = f"length from {names.joint(k)} to {names.joint(i)}{way}"
        what += f", with the centre of mass of {names.link(k)} counted from its far end"
        yield _number("length", what, "m", float(p @ direction), 5.5, longer)


def _vector(x: Array) -> str:
    """Return an axis as text: "-y", or its numbers."""
    for k in range(3):
        if abs(abs(x[k]) - 1.0) < PARALLEL:
            return f"{'-' if x[k] < 0.0 else ''}{_XYZ[k]}"
    return f"({', '.join(f'{value:.4g}' for value in x)})"
