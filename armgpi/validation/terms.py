"""The terms of the equations of motion: what one link, one length or one centre of mass adds to them.

D, the Coriolis products and G are sums over the links. A link alone adds a part from its inertia and parts
of degree 0, 1 and 2 in the position of its centre of mass, and these are split again by the lengths before
it: m l², m l lc, m lc². A term that is missing, halved, doubled or has another sign or angle in one
entry is found by comparing the difference with each of these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.validation.hypotheses import Hypothesis, Names
from armgpi.validation.problem import Problem
from armgpi.validation.tree import Affine, Tree, evaluate

#: What the part of degree 0, 1, 2 in lc is called in D and in G, which is of degree one at most.
_DEGREES = (
    ("the terms m l² of {}", "the gravity terms m l of {}"),
    ("the terms m l lc of {}", "the gravity terms m lc of {}"),
    ("the term m lc² of {} (parallel axis)", ""),
)
#: Share of a term by which a model is off (model less robot) -> what that means.
_SHARES = {
    -1.0: "{} missing",
    -0.5: "a factor 2 is missing in {}",
    -2.0: "the sign of {}",
    1.0: "a factor 1/2 is missing in {} (or it is there twice)",
}


class Term(NamedTuple):
    """One term of a sum over links, lengths and centres of mass.

    Attributes:
        inertial: what it is called in D and the products of velocities.
        gravity: what it is called in G; "" when it is not in there.
        columns: its samples for every element, (N, E).
    """

    inertial: str
    gravity: str
    columns: Array


class Match(NamedTuple):
    """How a term explains a difference.

    Attributes:
        text: for the report.
        factor: what the term is multiplied by in the model.
        plain: whether the factor is one of the usual ones.
    """

    text: str
    factor: float
    plain: bool


def split(problem: Problem, affine: Affine | None = None, rows: int | None = None) -> list[Term]:
    """Return all terms of the reference, at other angles when `affine` says so."""
    return list(_terms(problem, affine, rows))


def match(problem: Problem, term: Term, column: int) -> Match | None:
    """Return how a term explains the difference of one element, None when it does not."""
    part = term.columns[:, column]
    size = float(part @ part)
    if not size > 0.0 or np.abs(part).max() <= problem.tolerance[column]:
        return None
    # Least squares, then the worst sample: a share that fits on average explains nothing.
    rest = problem.user[:, column] - problem.reference[:, column]
    share = float(rest @ part) / size
    if np.abs(rest - share * part).max() > problem.tolerance[column]:
        return None
    name = term.gravity if problem.elements[column].quantity in ("G", "V", "Z") else term.inertial
    for known, text in _SHARES.items():
        if abs(share - known) < 1e-7:
            return Match(text.format(f"{name} is" if known == -1.0 else name), 1.0 + known, True)
    if share < -1.0 or np.ptp(part) <= problem.tolerance[column]:
        return None  # any constant is a multiple of any other
    return Match(f"{name} stands with the factor {1.0 + share:.6g}", 1.0 + share, False)


def match_mapped(
    problem: Problem, plain: Term, mapped: Term, hypothesis: Hypothesis, column: int
) -> Match | None:
    """Return how a term at other angles explains the difference of one element."""
    # The term at the other angle less the term as it is must be all that differs.
    moved = mapped.columns[:, column] - plain.columns[: len(mapped.columns), column]
    rest = (problem.user[:, column] - problem.reference[:, column])[: len(moved)]
    if (
        not np.abs(moved).max() > problem.tolerance[column]
        or np.abs(rest - moved).max() > problem.tolerance[column]
    ):
        return None
    name = plain.gravity if problem.elements[column].quantity in ("G", "V", "Z") else plain.inertial
    return Match(f"in {name}: {hypothesis.text}", 1.0, True)


def _terms(problem: Problem, affine: Affine | None, rows: int | None) -> Iterator[Term]:
    tree, q = problem.tree, problem.q[:rows]
    want = [quantity for quantity in problem.want if quantity in ("D", "H", "G", "V")]

    def columns(changed: Tree) -> Array:
        return problem.columns(evaluate(changed, q, want, affine))

    for k, body in enumerate(tree.bodies):
        link, alone = Names(tree).link(k), _alone(tree, k)
        if body.inertia.any():
            spin = alone.with_body(k, mass=0.0, inertia=body.inertia)
            yield Term(f"the inertia about the centre of mass of {link}", "", columns(spin))
        if body.mass == 0.0:
            continue  # no parts in the position of its centre of mass
        parts = _by_degree(_of_scale(alone, k, columns))
        for labels, part in zip(_DEGREES, parts, strict=True):
            inertial, weight = (label.format(link) for label in labels)
            yield Term(inertial, weight, part)
        for j in _chain(tree, k):
            if tree.positions[j].any():
                yield from _by_length(alone, k, j, columns)


def _by_length(tree: Tree, k: int, j: int, columns: Callable[[Tree], Array]) -> Iterator[Term]:
    """Yield the terms of body k that have the length to joint j in them."""
    powers = _by_degree(lambda t: np.stack(_by_degree(_of_scale(_stretched(tree, j, t), k, columns))[:2]))
    # Of degree two in lengths altogether, so lc never stands beside l².
    for degree, power in ((0, 1), (0, 2), (1, 1)):
        which = f" with the length to {Names(tree).joint(j)}" + (" squared" if power == 2 else "")
        inertial, weight = (label.format(Names(tree).link(k)) + which for label in _DEGREES[degree])
        yield Term(inertial, weight, powers[power][degree])


def _alone(tree: Tree, k: int) -> Tree:
    """Return the tree with the point mass of body k and nothing else."""
    for i, body in enumerate(tree.bodies):
        tree = tree.with_body(i, mass=body.mass if i == k else 0.0, inertia=np.zeros((3, 3)))
    return replace(tree, armature=np.zeros(tree.n))


def _of_scale(tree: Tree, k: int, columns: Callable[[Tree], Array]) -> Callable[[float], Array]:
    """Return the columns with the centre of mass of body k at a multiple of its distance."""
    return lambda scale: columns(tree.with_body(k, com=scale * tree.bodies[k].com))


def _stretched(tree: Tree, j: int, scale: float) -> Tree:
    """Return the tree with the length to joint j multiplied."""
    return tree.with_item("positions", j, scale * tree.positions[j])


def _by_degree(function: Callable[[float], Array]) -> tuple[Array, Array, Array]:
    """Return the parts of degree 0, 1 and 2 of a polynomial, at 1: three values fix its coefficients."""
    zero, plus, minus = function(0.0), function(1.0), function(-1.0)
    return zero, 0.5 * (plus - minus), 0.5 * (plus + minus) - zero


def _chain(tree: Tree, k: int) -> list[int]:
    """Return the joints that carry body k."""
    chain = []
    while k >= 0:
        chain.append(k)
        k = tree.parents[k]
    return chain
