"""The usual mistakes, each as a change of the reference arm that can be tried.

A :class:`Hypothesis` says "the model is right for an arm that differs in this": it changes the tree, the
coordinates or the pieces. A :class:`ParametricHypothesis` does so with one number, a parameter. All pieces
are polynomials of degree two in a mass, length or centre of mass, and trigonometric polynomials of degree two
in an angle, so three or five evaluations give them for every value of it, and the value that fits best is
found in closed form.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.arrays import Array
from armgpi.validation.tree import Affine, Pieces, Tree, christoffel, evaluate, identity

_XYZ = "xyz"
_DEGREE = np.pi / 180.0


class Hypothesis(NamedTuple):
    """One mistake that a model may have.

    Attributes:
        kind: short name of its kind.
        text: what it is, in words.
        cost: how far-fetched it is; the simplest one that fits is named.
        tree: the arm for which the model would be right.
        affine: the coordinates in which it would be.
        post: what to do to the pieces.
        custom: in place of all that, a function of tree, configurations and names of pieces.
    """

    kind: str
    text: str
    cost: float
    tree: Callable[[Tree], Tree] | None = None
    affine: Affine | None = None
    post: Callable[[Pieces], Pieces] | None = None
    custom: Callable[[Tree, Array, Iterable[str]], Pieces] | None = None

    def pieces(self, tree: Tree, q: Array, want: Iterable[str]) -> Pieces:
        """Return the pieces of a model with this mistake."""
        changed = tree if self.tree is None else self.tree(tree)
        if self.custom is not None:
            return self.custom(changed, q, want)
        pieces = evaluate(changed, q, want, self.affine)
        return pieces if self.post is None else {**pieces, **self.post(pieces)}

    def and_also(self, other: Hypothesis) -> Hypothesis:
        """Return both mistakes at once."""
        first, second = self.tree, other.tree

        def tree(x: Tree) -> Tree:
            x = x if first is None else first(x)
            return x if second is None else second(x)

        def post(x: Pieces) -> Pieces:
            x = x if self.post is None else {**x, **self.post(x)}
            return x if other.post is None else {**x, **other.post(x)}

        affine = self.affine
        if other.affine is not None:
            affine = other.affine if affine is None else other.affine.after(affine)
        both = self.post is not None or other.post is not None
        return Hypothesis(
            f"{self.kind}+{other.kind}",
            f"{self.text}; and {other.text}",
            self.cost + other.cost + 4.0,
            tree,
            affine,
            post if both else None,
        )


class ParametricHypothesis(NamedTuple):
    """A mistake in one number.

    Attributes:
        kind: short name of its kind.
        what: which number, in words.
        unit: its unit.
        value: what the robot has.
        cost: how far-fetched it is.
        angle: whether the pieces are trigonometric in it, and not polynomial.
        member: the hypothesis for a value of it.
    """

    kind: str
    what: str
    unit: str
    value: float
    cost: float
    angle: bool
    member: Callable[[float], Hypothesis]


class Names:
    """How joints and links are called in words."""

    def __init__(self, tree: Tree) -> None:
        """Take the names from a tree."""
        self._joints, self._links = tree.joint_names, tree.link_names

    def joint(self, i: int) -> str:
        """Return "joint 2" or "joint 2 ('elbow')"."""
        name = self._joints[i]
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
        *_kinematic(tree),
        *_structure(),
        *_left_out(tree),
        *_unturned(tree),
    ]
    return sorted(found, key=lambda h: h.cost)


def angle_maps(tree: Tree) -> list[Hypothesis]:
    """Return the mistakes in an angle that may stand in one summand alone."""
    maps = [h for h in _coordinates(tree) if h.affine is not None and _same_rates(h.affine)]
    n, names = tree.n, Names(tree)
    for j in range(n):
        A = np.eye(n)
        A[j, j] = 0.0
        maps.append(Hypothesis("angle-missing", f"q{j + 1} is left out", 4, affine=_inside(A)))
        A = np.eye(n)
        A[j, j] = 2.0
        maps.append(Hypothesis("angle-doubled", f"2 q{j + 1} stands for q{j + 1}", 5, affine=_inside(A)))
        for k in range(n):
            if k != j and tree.prismatic[k] == tree.prismatic[j]:
                A = np.eye(n)
                A[j, j], A[j, k] = 0.0, 1.0
                text = f"q{k + 1} stands where q{j + 1} belongs"
                maps.append(Hypothesis("angle-replaced", text, 4, affine=_inside(A)))
                A = np.eye(n)
                A[j, k] = 1.0
                text = f"q{j + 1} + q{k + 1} stands where q{j + 1} belongs"
                maps.append(Hypothesis("angle-added", text, 4.5, affine=_inside(A)))
                A = np.eye(n)
                A[j, k] = -1.0
                text = f"q{j + 1} - q{k + 1} stands where q{j + 1} belongs"
                maps.append(Hypothesis("angle-added", text, 4.5, affine=_inside(A)))
    del names
    return sorted(maps, key=lambda h: h.cost)


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
        for degrees in (90, -90, 180):
            b = zero.copy()
            b[i] = degrees * _DEGREE
            shift = f"q{i + 1} {'+' if degrees > 0 else '-'} {abs(degrees)}°"
            text = f"{names.joint(i)} is measured from another zero: {shift} stands where q{i + 1} belongs"
            if degrees == 90:
                text += " (cos for sin)"
            elif degrees == -90:
                text += " (sin for cos)"
            yield Hypothesis("offset", text, 2, affine=_inside(eye, b))
    subsets = ([revolute] if revolute else []) + ([[i] for i in revolute] if len(revolute) > 1 else [])
    for chosen in subsets:
        which = "all angles" if chosen == revolute else names.joint(chosen[0])
        scale = np.ones(n)
        scale[chosen] = _DEGREE
        cost = 2.0 if chosen == revolute else 2.5
        A, back = np.diag(scale), np.diag(1.0 / scale)
        text = f"degrees: {which} taken in degrees where radians are given"
        yield Hypothesis("degrees", text, cost, affine=_inside(A))
        yield Hypothesis("degrees", f"{text}, rates and torques too", cost + 0.5, affine=Affine(A, zero, A))
        text = f"degrees: {which} turned into degrees inside of the formulas"
        yield Hypothesis("degrees", text, cost, affine=_inside(back))
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
    yield tuple(reversed(range(n)))
    for i, j in itertools.combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        yield tuple(order)


def _absolute(tree: Tree) -> Iterator[Hypothesis]:
    """Yield angles counted from the base (or the other way round) where joints are parallel."""
    n, names = tree.n, Names(tree)
    pairs = []
    for i in range(n):
        if tree.prismatic[i]:
            continue
        R, k = tree.rotations[i], tree.parents[i]
        while k >= 0 and tree.prismatic[k]:
            R, k = tree.rotations[k] @ R, tree.parents[k]
        if k >= 0:
            along = float(tree.axes[k] @ (R @ tree.axes[i]))
            if abs(abs(along) - 1.0) < 1e-9:
                pairs.append((i, k, round(along)))
    chosen_sets = [pairs] + ([[p] for p in pairs] if len(pairs) > 1 else []) if pairs else []
    for chosen in chosen_sets:
        B = np.eye(n)
        for i, k, sign in chosen:
            B[i, k] = -sign
        joints = " and ".join(names.joint(i) for i, _, _ in chosen)
        cost = 2.0 if chosen == pairs else 2.5
        text = (
            f"absolute angles: {joints} counted from the base (or the horizontal), not from the link before"
        )
        zero = np.zeros(n)
        yield Hypothesis("absolute-angles", text, cost, affine=Affine(B, zero, B))
        yield Hypothesis("absolute-angles", f"{text}, inside of the formulas", cost + 0.5, affine=_inside(B))
        rates = f"absolute angles: the rates and torques of {joints} are absolute, their angles are not"
        yield Hypothesis("absolute-angles", rates, cost + 1.0, affine=Affine(np.eye(n), zero, B))
        A = np.asarray(np.linalg.inv(B), dtype=np.float64)
        rates = f"the rates and torques of {joints} are added up once more, their angles are not"
        yield Hypothesis("absolute-angles", rates, cost + 2.0, affine=Affine(np.eye(n), zero, A))
        text = f"the angles of {joints} are added to those before where the robot's are added already"
        yield Hypothesis("absolute-angles", text, cost + 1.0, affine=Affine(A, zero, A))
        yield Hypothesis("absolute-angles", f"{text}, inside of the formulas", cost + 1.5, affine=_inside(A))


def _steiner(mass: float, com: Array) -> Array:
    """Return the parallel-axis term, m (c.c I - c c')."""
    return np.asarray(mass * (com @ com * np.eye(3) - np.outer(com, com)))


def _bodies(tree: Tree) -> Iterator[Hypothesis]:
    """Yield mistakes in mass, centre of mass and inertia."""
    n, names = tree.n, Names(tree)

    def body(i: int, kind: str, text: str, cost: float, **changes: object) -> Hypothesis:
        return Hypothesis(kind, text, cost, tree=lambda t: t.with_body(i, **changes))

    def all_bodies(kind: str, text: str, cost: float, change: Callable[[Tree, int], Tree]) -> Hypothesis:
        def whole(t: Tree) -> Tree:
            for i in range(t.n):
                t = change(t, i)
            return t

        return Hypothesis(kind, text, cost, tree=whole)

    def steiner(t: Tree, i: int, factor: float) -> Tree:
        b = t.bodies[i]
        return t.with_body(i, inertia=b.inertia + factor * _steiner(b.mass, b.com))

    missing = "the parallel-axis (Steiner) term m c² is missing"
    twice = "inertia about the joint used as if about the centre of mass: the parallel-axis term counts twice"
    yield all_bodies("parallel-axis", f"every link: {missing}", 2, lambda t, i: steiner(t, i, -1.0))
    yield all_bodies("inertia-about-joint", f"every link: {twice}", 2, lambda t, i: steiner(t, i, 1.0))
    text = "every link is a point mass: the inertias about the centres of mass are missing"
    yield all_bodies("no-inertia", text, 2, lambda t, i: t.with_body(i, inertia=np.zeros((3, 3))))
    for factor, word in ((0.5, "halved"), (2.0, "doubled")):

        def scaled(t: Tree, i: int, factor: float = factor) -> Tree:
            return t.with_body(i, inertia=factor * t.bodies[i].inertia)

        yield all_bodies("inertia", f"the inertias of all links are {word}", 2.5, scaled)
    text = "the products of inertia have the other sign in every link"
    yield all_bodies("products-of-inertia", text, 3, lambda t, i: t.with_body(i, inertia=_signed(t, i, -1.0)))
    text = "the products of inertia are missing in every link"
    yield all_bodies("products-of-inertia", text, 3, lambda t, i: t.with_body(i, inertia=_signed(t, i, 0.0)))
    yield Hypothesis(
        "armature", "the rotor inertias are missing", 3, tree=lambda t: replace(t, armature=np.zeros(t.n))
    )
    for i in range(n):
        b, link = tree.bodies[i], names.link(i)
        term = _steiner(b.mass, b.com)
        yield body(i, "parallel-axis", f"{link}: {missing}", 2, inertia=b.inertia - term)
        yield body(i, "inertia-about-joint", f"{link}: {twice}", 2, inertia=b.inertia + term)
        yield body(
            i, "no-inertia", f"{link}: its inertia about the centre of mass is missing", 2, inertia=0 * term
        )
        yield body(i, "no-mass", f"{link}: its mass is missing", 2, mass=0.0)
        yield body(i, "no-link", f"{link} is missing: no mass and no inertia", 2, mass=0.0, inertia=0 * term)
        for factor, word in ((-1.0, "have the other sign"), (0.0, "are missing")):
            text = f"{link}: the products of inertia {word}"
            yield body(i, "products-of-inertia", text, 3, inertia=_signed(tree, i, factor))
        for order in itertools.permutations(range(3)):
            if order == (0, 1, 2):
                continue
            axes = ", ".join(_XYZ[k] for k in order)
            turned = b.inertia[np.ix_(order, order)]
            text = f"{link}: inertia about the wrong axes: x, y, z stand as {axes}"
            yield body(i, "inertia-axes", text, 3, inertia=turned)
            text = f"{link}: centre of mass along the wrong axes: x, y, z stand as {axes}"
            yield body(i, "com-axes", text, 3, com=b.com[list(order)])
        yield body(i, "com", f"{link}: centre of mass at the joint", 3, com=np.zeros(3))
        yield body(i, "com", f"{link}: centre of mass mirrored, with the other sign", 2.5, com=-b.com)
        for k in range(3):
            mirrored = b.com.copy()
            mirrored[k] = -mirrored[k]
            text = f"{link}: the {_XYZ[k]} of its centre of mass has the other sign"
            yield body(i, "com", text, 2.6, com=mirrored)
        end = tree.next_joint(i)
        if end is not None:
            text = f"{link}: centre of mass at its far end (the length l for lc)"
            yield body(i, "com", text, 2.5, com=end)
            text = f"{link}: distance of its centre of mass counted from the far end (l - lc for lc)"
            yield body(i, "com", text, 2.5, com=end - b.com)
            yield body(i, "com", f"{link}: centre of mass in the middle (l/2 for lc)", 2.7, com=0.5 * end)
        for j in range(i):
            o, both = tree.bodies[j], f"{names.link(j)} and {names.link(i)}"
            for kind, fields in (
                ("masses", ("mass",)),
                ("centres of mass", ("com",)),
                ("inertias", ("inertia",)),
                ("masses, centres of mass and inertias", ("mass", "com", "inertia")),
            ):
                mine = {f: getattr(o, f) for f in fields}
                others = {f: getattr(b, f) for f in fields}
                yield Hypothesis(
                    "links-swapped",
                    f"the {kind} of {both} are swapped",
                    3,
                    tree=_both(i, mine, j, others),
                )


def _both(i: int, mine: Mapping[str, object], j: int, others: Mapping[str, object]) -> Callable[[Tree], Tree]:
    """Return a change of two bodies."""
    return lambda t: t.with_body(i, **mine).with_body(j, **others)


def _signed(tree: Tree, i: int, factor: float) -> Array:
    """Return an inertia whose products are multiplied by a factor."""
    tensor = tree.bodies[i].inertia
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
            if abs(abs(axis @ tree.axes[i]) - 1.0) < 1e-9:
                continue
            verb = "slides along" if tree.prismatic[i] else "turns about"
            text = f"{joint} {verb} {'-' if sign < 0 else ''}{_XYZ[k]}, the robot's {_vector(tree.axes[i])}"
            yield Hypothesis("axis", text + " (in its frame at zero)", 3, tree=item("axes", i, axis))
        word = "revolute" if tree.prismatic[i] else "prismatic"
        yield Hypothesis(
            "joint-type", f"{joint} is taken as {word}", 4, tree=item("prismatic", i, not tree.prismatic[i])
        )
        R, p = tree.rotations[i], tree.positions[i]
        if not np.allclose(R, R.T):
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


def _kinematic(tree: Tree) -> Iterator[Hypothesis]:
    """Yield mistakes in the frame of the tool's position and of its Jacobian."""

    def turned(R: Array) -> Callable[[Pieces], Pieces]:
        def change(p: Pieces) -> Pieces:
            changed = {"F": p["F"] @ R.T} if "F" in p else {}
            if "J" in p:
                changed["J"] = np.concatenate([R @ p["J"][:, :3], R @ p["J"][:, 3:]], axis=1)
            return changed

        return change

    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.diag(signs) @ np.eye(3)[list(order)]
            if np.array_equal(R, np.eye(3)):
                continue
            axes = ", ".join(f"{'-' if s < 0.0 else ''}{_XYZ[k]}" for s, k in zip(signs, order, strict=True))
            text = f"the kinematics in another frame: {axes} of the base stand as x, y, z"
            flips = sum(s < 0.0 for s in signs)
            cost = 2.0 + 0.1 * flips + (0.0 if np.linalg.det(R) > 0.0 else 0.3)
            yield Hypothesis("frame", text, cost, post=turned(R))

    def with_tool(change: Callable[[Array, Array, Array], Array]) -> Callable[..., Pieces]:
        def custom(t: Tree, q: Array, want: Iterable[str]) -> Pieces:
            pieces = evaluate(t, q, want)
            if "J" in pieces:
                seen = evaluate(t, q, ("R", "F"))
                parts = zip(pieces["J"], seen["R"], seen["F"], strict=True)
                pieces["J"] = np.stack([change(J, R, p) for J, R, p in parts])
            return pieces

        return custom

    def along_tool(J: Array, R: Array, _: Array) -> Array:
        return np.concatenate([R.T @ J[:3], R.T @ J[3:]])

    def spatial(J: Array, _: Array, p: Array) -> Array:
        return np.concatenate([J[:3] + np.cross(p, J[3:], axisb=0).T, J[3:]])

    def spin_along_tool(J: Array, R: Array, _: Array) -> Array:
        return np.concatenate([J[:3], R.T @ J[3:]])

    body = "the Jacobian along the axes of the tool (body frame), not along those of the base"
    moving = "the Jacobian of the point of the tool that passes the base's origin (spatial velocity)"
    spin = "the angular rows of the Jacobian along the axes of the tool, not along those of the base"
    yield Hypothesis("jacobian", body, 2, custom=with_tool(along_tool))
    yield Hypothesis("jacobian", moving, 2, custom=with_tool(spatial))
    yield Hypothesis("jacobian", spin, 2.5, custom=with_tool(spin_along_tool))
    for name, rates in (("roll, pitch, yaw", _of_rpy), ("ZYZ Euler angles", _of_zyz)):

        def analytic(J: Array, R: Array, _: Array, rates: Callable[[Array], Array] = rates) -> Array:
            return np.concatenate([J[:3], rates(R) @ J[3:]])

        text = f"the angular rows of the Jacobian are rates of {name} (analytic), not angular velocities"
        yield Hypothesis("jacobian", text, 2.5, custom=with_tool(analytic))


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


def _structure() -> Iterator[Hypothesis]:
    """Yield mistakes in how the terms are formed, whatever the arm."""

    def scaled(name: str, factor: float) -> Callable[[Pieces], Pieces]:
        return lambda p: {name: factor * p[name]} if name in p else {}

    def masked(name: str, diagonal: float, others: float) -> Callable[[Pieces], Pieces]:
        def change(p: Pieces) -> Pieces:
            if name not in p:
                return {}
            n = p[name].shape[-1]
            return {name: p[name] * np.where(np.eye(n) > 0.0, diagonal, others)}

        return change

    def rates(along: float, across: float) -> Callable[[Pieces], Pieces]:
        """Take along dD/dt v + across d(v'Dv)/dq in place of 1 and -1/2."""

        def change(p: Pieces) -> Pieces:
            if "H" not in p:
                return {}
            H = p["H"]
            slope = H + np.swapaxes(H, -3, -2)  # [i, j, k]: derivative of D_ij by q_k
            straight = 0.5 * (slope + np.swapaxes(slope, -1, -2))
            return {"H": along * straight + across * np.moveaxis(slope, -1, -3)}

        return change

    def transposed(p: Pieces) -> Pieces:
        if "H" not in p:
            return {}
        T = np.swapaxes(p["H"], -3, -2)
        return {"H": 0.5 * (T + np.swapaxes(T, -1, -2))}

    def make(kind: str, text: str, cost: float, post: Callable[[Pieces], Pieces]) -> Hypothesis:
        return Hypothesis(kind, text, cost, post=post)

    whole = {
        "D": "the inertia matrix",
        "H": "the Coriolis torque",
        "G": "gravity",
        "V": "the potential energy",
    }
    for name, word in whole.items():
        yield make("factor", f"a factor 2 is missing in all of {word}", 2, scaled(name, 0.5))
        yield make("factor", f"a factor 1/2 is missing in all of {word}", 2, scaled(name, 2.0))
        if name not in ("G", "V"):
            yield make("sign", f"the sign of all of {word}", 1, scaled(name, -1.0))
            yield make("missing", f"{word} is zero", 1, scaled(name, 0.0))
    yield make("sign", "D has its off-diagonal entries with the other sign", 2, masked("D", 1.0, -1.0))
    yield make("missing", "D has no off-diagonal entries", 2, masked("D", 1.0, 0.0))
    text = "a factor 2 is missing in every product of two different velocities"
    yield make("factor", text, 1.5, masked("H", 1.0, 0.5))
    text = "a factor 1/2 is missing in every product of two different velocities"
    yield make("factor", text, 1.5, masked("H", 1.0, 2.0))
    yield make("missing", "all products of two different velocities are missing", 2, masked("H", 1.0, 0.0))
    yield make("missing", "all centrifugal products (squares) are missing", 2, masked("H", 0.0, 1.0))
    yield make("sign", "the centrifugal products (squares) have the other sign", 2, masked("H", -1.0, 1.0))
    yield make("factor", "a factor 1/2 is missing in every square", 2, masked("H", 2.0, 1.0))
    yield make("factor", "a factor 2 is missing in every square", 2, masked("H", 0.5, 1.0))
    yield make("transposed", "C is transposed", 1.5, transposed)
    yield make("christoffel", "-½ ∂(v'Dv)/∂q is missing: it is Ḋ v alone", 1.8, rates(1.0, 0.0))
    yield make("christoffel", "it is ½ Ḋ v", 1.8, rates(0.5, 0.0))
    yield make("christoffel", "the ½ of -½ ∂(v'Dv)/∂q is missing", 1.8, rates(1.0, -1.0))
    yield make("christoffel", "+½ ∂(v'Dv)/∂q stands for -½ ∂(v'Dv)/∂q", 1.8, rates(1.0, 0.5))
    yield make("christoffel", "Ḋ v is missing: it is -½ ∂(v'Dv)/∂q alone", 1.8, rates(0.0, -0.5))
    yield make("christoffel", "½ Ḋ v stands for Ḋ v", 1.8, rates(0.5, -0.5))
    text = "gravity is contained in the Coriolis torque"
    yield make("gravity-included", text, 1.5, lambda p: {"Z": p["G"]} if "G" in p else {})
    yield make(
        "gravity-included", text + ", with the other sign", 2, lambda p: {"Z": -p["G"]} if "G" in p else {}
    )
    text = "the rows of the Jacobian stand in another order: angular first"
    yield make("jacobian", text, 2, lambda p: {"J": np.roll(p["J"], 3, axis=1)} if "J" in p else {})


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


def _dropper(k: int, j: int, turning: bool) -> Callable[[Tree, Array, Iterable[str]], Pieces]:
    """Return the pieces where body k does not turn (or its centre not move) with joint j."""

    def lost(tree: Tree, _: Array, spin: Array, move: Array) -> Array:
        body = tree.bodies[k]
        part, tensor = (spin, body.inertia) if turning else (move, body.mass * np.eye(3))
        kept = part.copy()
        kept[:, j] = 0.0
        return np.asarray(part.T @ tensor @ part - kept.T @ tensor @ kept)

    return _less(k, lost)


def _less(k: int, lost: Callable[[Tree, Array, Array, Array], Array]) -> Callable[..., Pieces]:
    """Return the pieces of an arm whose D lacks something of body k.

    Args:
        k: the body.
        lost: gives what D lacks, (n, n), for the tree, the rotation of the body in the base, and the
            Jacobians of its turning and of its centre of mass, (3, n), along its own axes.
    """

    def custom(tree: Tree, q: Array, want: Iterable[str]) -> Pieces:
        want = tuple(want)
        pieces = evaluate(tree, q, want)
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
            pieces["D"] = pieces["D"] - all_lost(q)
        if "H" in want:
            step, columns = 1e-3, []
            for e in np.eye(n):
                near, far = (all_lost(q + step * m * e) - all_lost(q - step * m * e) for m in (1, 2))
                columns.append((8.0 * near - far) / (12.0 * step))
            pieces["H"] = pieces["H"] - christoffel(np.stack(columns, axis=-1))
        return pieces

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
    ) -> Callable[[Tree, Array, Iterable[str]], Pieces]:
        changes = [_less(k, wrong(k, ends_of[k], backward)) for k in chosen]

        def custom(t: Tree, q: Array, want: Iterable[str]) -> Pieces:
            want = tuple(want)
            right, total = evaluate(t, q, want), evaluate(t, q, want)
            for change in changes:
                one = change(t, q, want)
                total = {name: total[name] + one[name] - right[name] for name in total}
            return total

        return custom

    turning = [k for k in range(tree.n) if tree.bodies[k].inertia.any()]
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
                cost = 2.8 if chosen == turning else 3.2
                yield Hypothesis("inertia-frame", text, cost, custom=links(chosen, frame, backward))


def _far_rotation(tree: Tree, k: int) -> Array:
    """Return the fixed rotation at the far end of link k: before the next joint, or of the tool."""
    for j, parent in enumerate(tree.parents):
        if parent == k:
            return tree.rotations[j]
    return tree.tool_rotation if tree.tool_parent == k else np.eye(3)


def families(tree: Tree) -> list[ParametricHypothesis]:
    """Return the mistakes in one number of the robot."""
    n, names = tree.n, Names(tree)
    found: list[ParametricHypothesis] = []

    def add(
        kind: str,
        what: str,
        unit: str,
        value: float,
        cost: float,
        change: Callable[[Tree, float], Tree],
        angle: bool = False,
    ) -> None:
        def member(x: float) -> Hypothesis:
            return Hypothesis(kind, what, cost, tree=lambda t: change(t, x))

        found.append(ParametricHypothesis(kind, what, unit, value, cost, angle, member))

    def vector(field: str, i: int, start: Array, direction: Array) -> Callable[[Tree, float], Tree]:
        across = start - (start @ direction) * direction
        if field == "com":
            return lambda t, x: t.with_body(i, com=across + x * direction)
        if field == "tool_position":
            return lambda t, x: replace(t, tool_position=across + x * direction)
        return lambda t, x: t.with_item("positions", i, across + x * direction)

    def directions(start: Array) -> Iterator[tuple[str, Array, float]]:
        for k in range(3):
            yield f" along {_XYZ[k]}", np.eye(3)[k], 0.0 if start[k] else 1.0
        if np.count_nonzero(np.abs(start) > 1e-12) > 1:
            yield " along its line", start / np.linalg.norm(start), 0.0

    for i in range(n):
        b, link, joint = tree.bodies[i], names.link(i), names.joint(i)

        def weight(t: Tree, x: float, i: int = i) -> Tree:
            return t.with_body(i, mass=x)

        add("mass", f"mass of {link}", "kg", b.mass, 5, weight)
        for way, direction, more in directions(b.com):
            value = float(b.com @ direction)
            add(
                "com",
                f"centre of mass of {link}{way}",
                "m",
                value,
                5 + more,
                vector("com", i, b.com, direction),
            )
        for r, c in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):

            def tensor(t: Tree, x: float, i: int = i, r: int = r, c: int = c) -> Tree:
                changed = t.bodies[i].inertia.copy()
                changed[r, c] = changed[c, r] = x
                return t.with_body(i, inertia=changed)

            what = f"inertia I{_XYZ[r]}{_XYZ[c]} of {link}"
            add("inertia", what, "kg m²", float(b.inertia[r, c]), 5 if r == c else 6, tensor)
        p = tree.positions[i]
        for way, direction, more in directions(p):
            what = (
                f"length from {names.joint(tree.parents[i])} to {joint}{way}"
                if tree.parents[i] >= 0
                else f"length from the base to {joint}{way}"
            )
            add("length", what, "m", float(p @ direction), 5 + more, vector("positions", i, p, direction))

        def rotor(t: Tree, x: float, i: int = i) -> Tree:
            armature = t.armature.copy()
            armature[i] = x
            return replace(t, armature=armature)

        add("armature", f"rotor inertia of {joint}", "kg m²", float(tree.armature[i]), 7, rotor)
        for k in range(3):
            axis = np.eye(3)[k]
            if abs(abs(axis @ tree.axes[i]) - 1.0) < 1e-9 and not tree.prismatic[i]:
                continue

            def tilt(t: Tree, x: float, i: int = i, axis: Array = axis) -> Tree:
                return t.with_item("rotations", i, t.rotations[i] @ pin.exp3(x * axis))

            add("tilt", f"angle by which {joint} is tilted about {_XYZ[k]}", "rad", 0.0, 7, tilt, angle=True)

        def shifted(x: float, i: int = i, what: str = f"zero of {joint}") -> Hypothesis:
            affine = identity(n)
            b = affine.b.copy()
            b[i] = x
            return Hypothesis("offset", what, 4, affine=affine._replace(b=b))

        prismatic = tree.prismatic[i]
        found.append(
            ParametricHypothesis(
                "offset",
                f"offset added to q{i + 1}",
                "m" if prismatic else "rad",
                0.0,
                4,
                not prismatic,
                shifted,
            )
        )
    if n > 1:

        def masses(t: Tree, x: float) -> Tree:
            return replace(t, bodies=tuple(b._replace(mass=x * b.mass) for b in t.bodies))

        def inertias(t: Tree, x: float) -> Tree:
            return replace(t, bodies=tuple(b._replace(inertia=x * b.inertia) for b in t.bodies))

        add("scale", "all masses times", "", 1.0, 6, masses)
        add("scale", "all inertias about the centres of mass times", "", 1.0, 6, inertias)

    def lengths(t: Tree, x: float) -> Tree:
        bodies = tuple(b._replace(com=x * b.com) for b in t.bodies)
        positions = tuple(x * p for p in t.positions)
        return replace(t, bodies=bodies, positions=positions, tool_position=x * t.tool_position)

    add("scale", "all lengths times", "", 1.0, 6, lengths)
    for i in range(n):
        k, p = tree.parents[i], tree.positions[i]
        if k < 0 or not p.any():
            continue
        for way, direction, more in directions(p):
            if more:
                continue

            def longer(t: Tree, x: float, i: int = i, k: int = k, direction: Array = direction) -> Tree:
                change = (x - float(tree.positions[i] @ direction)) * direction
                t = t.with_item("positions", i, t.positions[i] + change)
                return t.with_body(k, com=t.bodies[k].com + change)

            what = f"length from {names.joint(k)} to {names.joint(i)}{way}"
            what += f", with the centre of mass of {names.link(k)} counted from its far end"
            add("length", what, "m", float(p @ direction), 5.5, longer)
    p = tree.tool_position
    for way, direction, more in directions(p):
        what = f"position of the tool{way}"
        add("tool", what, "m", float(p @ direction), 5 + more, vector("tool_position", 0, p, direction))
    return found


def _vector(x: Array) -> str:
    """Return an axis in words: "-y", or its numbers."""
    for k in range(3):
        if abs(abs(x[k]) - 1.0) < 1e-9:
            return f"{'-' if x[k] < 0.0 else ''}{_XYZ[k]}"
    return f"({', '.join(f'{value:.4g}' for value in x)})"
