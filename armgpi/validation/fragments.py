"""The summands of the equations of motion: what one link, one length or one centre of mass adds to them.

D, the Coriolis products and G are sums over the links. A link alone adds a part from its inertia and parts
of degree 0, 1 and 2 in the position of its centre of mass, and these are split again by the lengths before
it: m l², m l lc, m lc². A summand that is missing, halved, doubled or has another sign or angle in one
entry is found by comparing the difference with each of these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.validation.hypotheses import Hypothesis, Names
from armgpi.validation.problem import Problem
from armgpi.validation.tree import Affine, Tree, evaluate

_DEGREES = (
    ("the terms m l² of {}", "the gravity terms m l of {}"),
    ("the terms m l lc of {}", "the gravity terms m lc of {}"),
    ("the term m lc² of {} (parallel axis)", ""),
)
#: Share of a summand by which a model is off -> what that means.
_SHARES = {
    -1.0: "{} missing",
    -0.5: "a factor 2 is missing in {}",
    -2.0: "the sign of {}",
    1.0: "a factor 1/2 is missing in {} (or it stands twice)",
}


class Fragment(NamedTuple):
    """One summand.

    Attributes:
        inertial: what it is in D and the products, in words.
        gravity: what it is in G, in words; "" when it is not in there.
        columns: its samples for every element, (N, E).
    """

    inertial: str
    gravity: str
    columns: Array


class Match(NamedTuple):
    """How a summand explains a difference.

    Attributes:
        text: in words.
        factor: what the summand is multiplied by in the model.
        plain: whether the factor is one of the usual ones.
    """

    text: str
    factor: float
    plain: bool


def fragments(problem: Problem, affine: Affine | None = None, rows: int | None = None) -> list[Fragment]:
    """Return all summands of the reference, at other angles when `affine` says so."""
    return list(_fragments(problem, affine, rows))


def match(problem: Problem, fragment: Fragment, column: int) -> Match | None:
    """Return how a summand explains the difference of one element, None when it does not."""
    part = fragment.columns[:, column]
    size = float(part @ part)
    if not size > 0.0 or np.abs(part).max() <= problem.tolerance[column]:
        return None
    rest = problem.user[:, column] - problem.reference[:, column]
    share = float(rest @ part) / size
    if np.abs(rest - share * part).max() > problem.tolerance[column]:
        return None
    words = fragment.gravity if problem.elements[column].piece in ("G", "V", "Z") else fragment.inertial
    for known, text in _SHARES.items():
        if abs(share - known) < 1e-7:
            return Match(text.format(f"{words} is" if known == -1.0 else words), 1.0 + known, True)
    if share < -1.0 or np.ptp(part) <= problem.tolerance[column]:
        return None  # any constant is a multiple of any other
    return Match(f"{words} stands with the factor {1.0 + share:.6g}", 1.0 + share, False)


def match_mapped(
    problem: Problem, plain: Fragment, mapped: Fragment, hypothesis: Hypothesis, column: int
) -> Match | None:
    """Return how a summand at other angles explains the difference of one element."""
    moved = mapped.columns[:, column] - plain.columns[: len(mapped.columns), column]
    rest = (problem.user[:, column] - problem.reference[:, column])[: len(moved)]
    if (
        not np.abs(moved).max() > problem.tolerance[column]
        or np.abs(rest - moved).max() > problem.tolerance[column]
    ):
        return None
    words = plain.gravity if problem.elements[column].piece in ("G", "V", "Z") else plain.inertial
    return Match(f"in {words}: {hypothesis.text}", 1.0, True)


def _fragments(problem: Problem, affine: Affine | None, rows: int | None) -> Iterator[Fragment]:
    tree, names = problem.tree, Names(problem.tree)
    q = problem.q[:rows]
    want = [piece for piece in problem.want if piece in ("D", "H", "G", "V")]

    def columns(changed: Tree) -> Array:
        return problem.columns(evaluate(changed, q, want, affine))

    for k in range(tree.n):
        link, body = names.link(k), tree.bodies[k]
        alone = _alone(tree, k)
        words = f"the inertia about the centre of mass of {link}"
        if body.inertia.any():
            yield Fragment(words, "", columns(alone.with_body(k, mass=0.0, inertia=body.inertia)))
        if body.mass == 0.0:
            continue
        whole = _by_degree(lambda s, a=alone, k=k: columns(_at(a, k, s)))
        for degree, part in enumerate(whole):
            inertial, weight = (word.format(link) for word in _DEGREES[degree])
            yield Fragment(inertial, weight, part)
        for j in _chain(tree, k):
            if not tree.positions[j].any():
                continue
            by_length = _by_degree(
                lambda t, a=alone, k=k, j=j: np.stack(
                    _by_degree(lambda s: columns(_at(_stretched(a, j, t), k, s)))[:2]
                )
            )
            for degree in (0, 1):
                for power in (1, 2):
                    part = by_length[power][degree]
                    if power == 2 and degree == 1:
                        continue
                    which = f" with the length to {names.joint(j)}" + (" squared" if power == 2 else "")
                    inertial, weight = (word.format(link) + which for word in _DEGREES[degree])
                    yield Fragment(inertial, weight, part)


def _alone(tree: Tree, k: int) -> Tree:
    """Return the tree with the point mass of body k and nothing else."""
    for i, body in enumerate(tree.bodies):
        tree = tree.with_body(i, mass=body.mass if i == k else 0.0, inertia=np.zeros((3, 3)))
    return replace(tree, armature=np.zeros(tree.n))


def _at(tree: Tree, k: int, scale: float) -> Tree:
    """Return the tree with the centre of mass of body k at a multiple of its distance."""
    return tree.with_body(k, com=scale * tree.bodies[k].com)


def _stretched(tree: Tree, j: int, scale: float) -> Tree:
    """Return the tree with the length to joint j multiplied."""
    return tree.with_item("positions", j, scale * tree.positions[j])


def _by_degree(function: object) -> tuple[Array, Array, Array]:
    """Return the parts of degree 0, 1 and 2 of a polynomial, at 1."""
    assert callable(function)
    zero, plus, minus = (np.asarray(function(s)) for s in (0.0, 1.0, -1.0))
    return zero, 0.5 * (plus - minus), 0.5 * (plus + minus) - zero


def _chain(tree: Tree, k: int) -> list[int]:
    """Return the joints that carry body k."""
    chain = []
    while k >= 0:
        chain.append(k)
        k = tree.parents[k]
    return chain
