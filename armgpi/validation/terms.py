"""A sparse fit per entry: which of the robot's own terms an entry lacks or has otherwise.

D, the Coriolis products and G are sums over the links. A link alone adds a part from its inertia and parts
of degree 0, 1 and 2 in the position of its centre of mass, and these are split again by the lengths before
it: m l², m l lc, m lc². These terms are the dictionary. What an entry has too much or too little is compared
with each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.hypotheses import Names
from armgpi.validation.problem import Problem
from armgpi.validation.tree import Tree, evaluate

#: What the part of degree 0, 1, 2 in lc is called in D and in G, which is of degree one at most.
_DEGREES = (
    ("the terms m l² of {}", "the gravity terms m l of {}"),
    ("the terms m l lc of {}", "the gravity terms m lc of {}"),
    ("the term m lc² of {} (parallel axis)", ""),
)
#: Share of a term by which a model is off (model less robot) -> what that means; the usual ones first.
SHARES = {
    -1.0: "{} is missing",
    -2.0: "the sign of {}",
    -0.5: "a factor 2 is missing in {}",
    1.0: "a factor 1/2 is missing in {} (or it is there twice)",
}
#: Two shares are the same up to this: they come from values that agree to 1e-9.
SAME = 1e-7


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


class Fit(NamedTuple):
    """How a term explains an entry.

    Attributes:
        text: for the report.
        share: by which multiple of the term the model is off.
        usual: whether that is a usual one.
        bits: length of the description.
    """

    text: str
    share: float
    usual: bool
    bits: float


def fits(problem: Problem, dictionary: list[Term], column: int) -> list[Fit]:
    """Return which terms explain the difference of one element, the shortest first."""
    quantity, tolerance = problem.elements[column].quantity, float(problem.tolerance[column])
    if quantity not in ("D", "H", "G", "V", "Z"):
        return []
    label = "gravity" if quantity in ("G", "V", "Z") else "inertial"
    rest = problem.user[:, column] - problem.reference[:, column]
    place = float(np.log2(len(dictionary)))
    found = []
    for term in dictionary:
        part = term.columns[:, column]
        if np.abs(part).max() <= tolerance:
            continue
        # Least squares, then the worst sample: a share that fits on average explains nothing.
        share, name = float(part @ rest) / float(part @ part), getattr(term, label)
        if np.abs(rest - share * part).max() > tolerance:
            continue
        for rank, (known, text) in enumerate(SHARES.items(), start=1):
            if abs(share - known) < SAME:
                found.append(Fit(text.format(name), known, True, place + float(np.log2(rank))))
                break
        else:
            if share >= -1.0 and np.ptp(part) > tolerance:  # any constant is a multiple of any other
                text = f"{name} has the factor {1.0 + share:.6g}"
                found.append(Fit(text, share, False, place))
    return sorted(found, key=lambda fit: (not fit.usual, fit.bits))


def split(problem: Problem) -> Iterator[Term]:
    """Yield all terms of the reference."""
    tree = problem.tree
    want = [quantity for quantity in problem.want if quantity in ("D", "H", "G", "V")]

    def columns(changed: Tree) -> Array:
        return problem.columns(evaluate(changed, problem.q, want))

    for k, body in enumerate(tree.bodies):
        link, alone = Names(tree).link(k), _alone(tree, k)
        if body.inertia.any():
            spin = alone.with_body(k, mass=0.0, inertia=body.inertia)
            yield Term(f"the inertia about the centre of mass of {link}", "", columns(spin))
        if body.mass == 0.0:
            continue  # no parts in the position of its centre of mass
        yield Term(f"all that is linear in the mass of {link}", f"the weight of {link}", columns(alone))
        parts = _by_degree(_of_scale(alone, k, columns))
        for labels, part in zip(_DEGREES, parts, strict=True):
            inertial, weight = (label.format(link) for label in labels)
            yield Term(inertial, weight, part)
        j = k
        while j >= 0:
            if tree.positions[j].any():
                yield from _by_length(alone, k, j, columns)
            j = tree.parents[j]


def _by_length(tree: Tree, k: int, j: int, columns: Callable[[Tree], Array]) -> Iterator[Term]:
    """Yield the terms of body k that have the length to joint j in them."""

    def of_length(scale: float) -> Array:
        stretched = tree.with_item("positions", j, scale * tree.positions[j])
        return np.stack(_by_degree(_of_scale(stretched, k, columns))[:2])

    powers = _by_degree(of_length)
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


def _by_degree(function: Callable[[float], Array]) -> tuple[Array, Array, Array]:
    """Return the parts of degree 0, 1 and 2 of a polynomial, at 1: three values fix its coefficients."""
    zero, plus, minus = function(0.0), function(1.0), function(-1.0)
    return zero, 0.5 * (plus - minus), 0.5 * (plus + minus) - zero
