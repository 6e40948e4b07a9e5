"""A repair of the model's source: searched beside the model, and proved on a copy of it."""

from __future__ import annotations

import ast
import copy
import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ModelError
from armgpi.validation import phrasing, samples
from armgpi.validation.course import Course
from armgpi.validation.diagnose import Cause
from armgpi.validation.edits import ALL, ROWS, Change, Goal, Target
from armgpi.validation.entries import shown
from armgpi.validation.models import ARGUMENTS, States
from armgpi.validation.problem import Problem
from armgpi.validation.proofs import Repaired, Searched, is_number
from armgpi.validation.residual import Difference
from armgpi.validation.slopes import own_numbers, slopes, with_changes
from armgpi.validation.tree import Tree, evaluate
from armgpi.validation.units import grouped_numbers, states_angles, with_numbers
from armgpi.validation.worker import Worker

Signs = tuple[tuple[float, str], ...]
#: Kind of a change -> how the difference of an entry begins that it undoes.
_SAID_BY_KIND = {"sign": ("wrong sign: ",), "factor": ("half is missing: ", "twice instead of once: ")}
#: Time of the processor for a search where a convention explains all, and the least for any [s].
SHORT, LEAST = 2.0, 1.0
#: Time that is left for what comes after a search: proofs, wrong numbers, slips at several places [s].
_AFTERWARDS = 4.0


class Compared(NamedTuple):
    """A model beside a robot.

    Attributes:
        worker: the model's process.
        states: at which it was sampled.
        problem: model and reference.
        course: how long the search may take, and what it did not do.
    """

    worker: Worker
    states: States
    problem: Problem
    course: Course

    @property
    def names(self) -> list[str]:
        """Its functions."""
        return list(self.problem.noise)

    @property
    def seconds_left(self) -> float:
        """Time of the processor that is left [s]."""
        return self.course.seconds_left(self.worker)

    @property
    def goal(self) -> Goal:
        """What its functions should give."""
        source = self.worker.source
        has_angles = source is not None and states_angles(source)
        return _goal(self.states.first(ROWS), self.problem, self.names, has_angles)


class Renumbered(NamedTuple):
    """A model and a robot with other numbers.

    Attributes:
        names: the model's numbers with which it no longer agrees.
        source: the model's, with other numbers.
        tree: the robot with those.
    """

    names: tuple[str, ...]
    source: str
    tree: Tree


def search(compared: Compared, most: float) -> Repaired | None:
    """Return the changes of the source with which a copy of the model agrees, None when none are found.

    Args:
        compared: the model beside the robot.
        most: time of the processor that it may take [s], if as much is left.
    """
    worker, problem = compared.worker, compared.problem
    if worker.source is None:
        return None
    if worker.read_seconds > max(compared.seconds_left, LEAST):
        compared.course.unsearched.append(f"the source, which takes {worker.read_seconds:.2g} s to be read")
        return None
    with worker.again(worker.source) as copy:
        known = [value for value, _ in phrasing.known_numbers(problem.tree) if value]
        left = compared.seconds_left - copy.seconds - _AFTERWARDS
        searched = copy.search(compared.goal, known, max(min(most, left), LEAST))
    found = searched.found
    _note(compared, searched)
    if found is None or not agrees(worker, found.source, compared.states, problem):
        return None
    sure = found.confirmed and _agrees_renumbered(compared, found)
    if sure and len(found.changes) > 1:
        sure = _has_christoffel_matrix(compared, found.source)
    return found._replace(sure=sure)


def _note(compared: Compared, searched: Searched) -> None:
    """Keep what a search failed in, and what it had no time for where nothing is confirmed."""
    course = compared.course
    course.failures += [searched.failure] if searched.failure else []
    if searched.found is None or not searched.found.confirmed:
        course.unsearched += searched.unsearched


def _has_christoffel_matrix(compared: Compared, source: str) -> bool:
    """Tell whether a repaired C(q, v) is the matrix of Christoffel symbols; yes where there is none.

    Several changes may make its product with v right, and another matrix than the one that was meant.
    """
    name, few = "coriolis_matrix", compared.states.first(ROWS)
    if name not in compared.names:
        return True
    try:
        with compared.worker.again(source) as repaired:
            C = samples.call(repaired, name, few.q, few.v)
    except ModelError:
        return False
    H = evaluate(compared.problem.tree, few.q, ["H"])["H"]
    meant = np.einsum("Nijk,Nk->Nij", H, few.v)
    return bool(np.abs(C - meant).max() <= 1e-6 * max(float(np.abs(meant).max()), 1e-3))


def _with_varied_numbers(compared: Compared, source: str) -> Repaired | None:
    """Return a source as it is, with what its numbers are in the robot; None where that is not found."""
    with compared.worker.again(source) as twin:
        searched = twin.search(compared.goal, (), 0.0)
    _note(compared, searched)
    return searched.found


def proved_for_other_numbers(compared: Compared, found: Repaired) -> Repaired:
    """Return a repair with what the numbers of its source are in the robot, and whether that is sure."""
    varied = _with_varied_numbers(compared, found.source)
    if varied is None:
        return found
    varied = varied._replace(changes=found.changes, source=found.source)
    return varied._replace(sure=varied.confirmed and _agrees_renumbered(compared, varied))


def confirmed_by_terms(compared: Compared, found: Repaired, differences: Sequence[Difference]) -> Repaired:
    """Return a repair that is sure where it is what the difference says in the robot's own terms.

    One change of a sign, or of a factor of two, may leave a doubt: a number that nothing reads is as large
    as one that is read. Where the values lack just that sign or half of one term of the robot in every
    entry, and the repaired model agrees with other numbers, there is nothing left to doubt.
    """
    if found.sure or found.checked == 0 or not found.holds or len(found.changes) != 1:
        return found
    of_kind = _SAID_BY_KIND.get(found.changes[0].kind, ())
    texts = [one.text for one in differences]
    single = all(text.startswith(of_kind) and ";" not in text for text in texts)
    differing = compared.problem.elements_of(~compared.problem.agreeing)
    told = {(one.function, one.label) for one in differences}
    complete = all((e.function, e.label) in told for e in differing)
    if not texts or not of_kind or not single or not complete:
        return found
    return found._replace(sure=_agrees_renumbered(compared, found))


def odd_numbers(compared: Compared) -> Renumbered | None:
    """Return a model that agrees with other numbers, with which it no longer does; None where it does.

    Each number is varied. The model then has to move as the robot does with another number of that value,
    and with any inertias: a mistake that round numbers hide does not.
    """
    source = compared.worker.source
    if source is None:
        return None
    found = _with_varied_numbers(compared, source)
    if found is None or not found.odd:
        return None
    return Renumbered(found.odd, *_renumbered(found, compared.problem))


def _goal(few: States, problem: Problem, names: Sequence[str], has_angles: bool) -> Goal:
    """Return what functions, and their parts, should give at some states; see :func:`slopes` for the last."""

    def values(name: str, s: States) -> Array:
        # As the search compares them, (rows, m): of accelerations D and C v + G.
        flat = np.asarray(problem.values(name, s), dtype=np.float64).reshape(len(s.q), -1)
        if name != "forward_dynamics" or problem.is_passive:
            return flat
        D = evaluate(problem.tree, s.q, ["D"])["D"]
        return np.concatenate([D.reshape(len(D), -1), s.tau - np.einsum("Nij,Nj->Ni", D, flat)], axis=1)

    targets: dict[str, Target] = {}
    for name in names:
        flat, best = values(name, few), None
        if name == "coriolis_matrix":
            H = evaluate(problem.tree, few.q, ["H"])["H"]
            best = np.einsum("Nijk,Nk->Nij", H, few.v).reshape(len(few.q), -1)
        # At least what rounding leaves: an output that must be zero is compared with the others.
        least = 1e-8 * max(float(np.abs(flat).max()), 1e-3)
        targets[name] = Target(name, flat, np.full(flat.shape[1], least), best)
    seen = {ALL: few}
    for name in names:
        parts = _parts(few, ARGUMENTS[name])
        seen |= {label: s for label, (s, _) in parts.items()}
        given = {label: values(name, s) for label, (s, _) in parts.items()}
        for label, (_, signs) in parts.items():
            flat = np.sum([sign * given[one] for sign, one in signs], axis=0)
            targets[f"{name} {label}"] = targets[name]._replace(values=flat, best=None, states=signs)
    return Goal(seen, targets, slopes(problem, few, names, has_angles), problem.is_passive)


def _agrees_renumbered(compared: Compared, found: Repaired) -> bool:
    """Tell whether a repaired model agrees where its numbers, and what they are in the robot, are others."""
    source, tree = _renumbered(found, compared.problem)
    other = copy.copy(compared.problem)
    other.tree = tree
    return agrees(compared.worker, source, compared.states, other)


def _renumbered(found: Repaired, problem: Problem) -> tuple[str, Tree]:
    """Return a model's source with other numbers, and the robot with what they are in it."""
    source = found.spelled or found.source
    named = [places for _, places in grouped_numbers(ast.parse(source))]
    # Shares that no products or ratios of few of them make one again.
    draw = np.random.default_rng(20261123).uniform(0.75, 1.3, size=len(named))
    own = {k: float(ast.literal_eval(named[k][0])) for k in found.standing}
    changes = [(node, value * draw[k]) for k, value in own.items() for node in named[k]]
    known = [one.value for one, _ in own_numbers(problem.tree)]
    known.append(float(np.linalg.norm(problem.tree.gravity)))
    moved: dict[int, float] = {}
    factors: dict[int, float] = {}
    for k, value in own.items():
        for j, rate in found.standing[k].items():
            power = rate * value / known[j] if known[j] else 0.0
            # An inertia m a² / 12 moves with every number that it is made of, and by their product.
            if abs(power - 1.0) < 1e-6 or abs(power - 2.0) < 1e-6:
                factors[j] = factors.get(j, 1.0) * draw[k] ** round(power)
            else:
                moved[j] = moved.get(j, 0.0) + rate * (value * (draw[k] - 1.0))
    for j, factor in factors.items():
        moved[j] = moved.get(j, 0.0) + known[j] * (factor - 1.0)
    return with_numbers(source, changes), with_changes(problem.tree, moved)


def _parts(s: States, letters: tuple[str, ...]) -> dict[str, tuple[States, Signs]]:
    """Return the states that show the parts of a function, and the signs with which values there are added.

    A part is what gravity, one acceleration or one product of velocities gives: one or two joints move.
    """
    n, found = s.q.shape[1], dict[str, tuple[States, Signs]]()
    if "v" not in letters:
        return found
    # What is left at rest stands in each of them.
    rest: Signs = ((1.0, "rest"),) if {"a", "tau"} & {*letters} else ()
    less = tuple((-sign, label) for sign, label in rest)

    def add(signs: Signs, v: Sequence[int] = (), a: Sequence[int] = ()) -> None:
        at_v, at_a = (np.where(np.isin(range(n), few), x, 0.0) for few, x in ((v, s.v), (a, s.a)))
        found[signs[0][1]] = s._replace(v=at_v, a=at_a), signs

    if rest:
        add(rest)
    for i in range(n if "a" in letters else 0):
        add(((1.0, f"a{i}"), *less), a=[i])
    for i in range(n):
        add(((1.0, f"v{i}"), *less), v=[i])
    for i, j in itertools.combinations(range(n), 2):
        add(((1.0, f"v{i}v{j}"), (-1.0, f"v{i}"), (-1.0, f"v{j}"), *rest), v=[i, j])
    return found


#: States at which a changed model is looked at first, and those at which it has to agree. Nothing agrees at
#: sixteen of them by chance; the forty of the model itself also show sums of harmonics.
GLANCED, PROVED = 2, samples.FEW


def agrees(worker: Worker, source: str, states: States, problem: Problem) -> bool:
    """Tell whether a model with another source agrees everywhere."""
    try:
        with worker.again(source) as repaired:
            for few in (states.first(GLANCED), states.first(PROVED)):
                seen = samples.glance(repaired, few, problem.noise)
                if not Problem(problem.tree, few.q, seen, problem.rtol).agreeing.all():
                    return False
    except ModelError:
        return False
    return True


#: More elements than these are not listed: a mistake in what many share shows everywhere.
_FEW = 4
#: Kinds of changes that are told by their own text: see `slips`.
_SLIPS = ("overwritten", "everywhere")
#: Kind of a change -> what was wrong.
_WRONG = {
    "sign": "the sign",
    "factor": "a factor of 2, or its half",
    "square": "a square",
    "trig": "sine and cosine",
    "angle": "the angle",
    "degrees": "degrees and radians",
    "name": "one name for another",
    "index": "one index for another",
    "transposed": "a matrix transposed",
    "cross": "the order of a cross product",
    **dict.fromkeys(("term", "sum"), "a term is missing"),
    "extra": "a term too much",
    "product": "a factor is missing, or too much",
    "swapped": "two values in each other's place",
    "inverse": "an inverse, or none",
    "operator": "what is added and what is assigned",
}


def causes(repair: Repaired, source: str, problem: Problem) -> Iterator[Cause]:
    """Yield the mistakes that a repair undoes."""
    differing = problem.elements_of(~problem.agreeing)
    before, after = source.splitlines(), repair.source.splitlines()
    proof = f"with {'this change' if len(repair.changes) == 1 else 'all changes'} the model agrees"
    proof += ", for other numbers too" if repair.confirmed else ": suggested, as other numbers may differ"
    for change in _one_of_each(repair.changes):
        first, _, last, _ = change.span
        evidence = [f"{k}: {before[k - 1].strip()}" for k in range(first, last + 1)]
        if len(before) == len(after):
            evidence += [f"{k}: {after[k - 1].strip()}   <- expected" for k in range(first, last + 1)]
        is_number_given = change.kind in ("unit", "value")
        name = shown(source, change.name, change.span) if is_number_given else change.name
        cause = _cause(change._replace(name=name))
        yield cause._replace(
            text=f"{cause.text}; {repair.instead}" if repair.instead else cause.text,
            scope="elements" if len(differing) <= _FEW else "model",
            elements=tuple(one for one in differing if one.function in change.reaches) or differing,
            evidence=(*evidence, proof),
            line=first,
            confirmed=repair.confirmed,
        )


def _one_of_each(changes: Sequence[Change]) -> Iterator[Change]:
    """Yield changes; of one number that is stated at several places the first."""
    seen = set[tuple[str, str, str]]()
    for change in changes:
        # All places of one slip are one mistake.
        key = (change.name, *(("", "") if change.kind in _SLIPS else (change.old, change.new)))
        if change.kind in ("value", *_SLIPS) and key in seen:
            continue
        seen.add(key)
        yield change


def _cause(change: Change) -> Cause:
    """Return the mistake that a change undoes."""
    if change.kind in _SLIPS:
        return Cause(
            change.kind, change.name, "", (), formulas=(("found", change.old), ("expected", change.new))
        )
    if change.kind in ("unit", "value"):
        value, expected = float(change.old), float(change.new)
        text = f"the model's {change.name} is {value:.6g}; with {expected:.6g} it agrees"
        text += phrasing.ratio(value / expected) if expected else ""
        return Cause(change.kind, text, "", (), value, expected, structural=False)
    line = f"line {change.span[0]}" + (f", in {change.where}" if change.where else "")
    numbers_alone = is_number(change.old) and is_number(change.new)
    wrong = _WRONG.get("" if numbers_alone else change.kind, "a number")
    text = f"{line}: {change.old.strip()} should be {change.new.strip()} ({wrong})"
    if not change.old:
        text = f"{line}: after it {change.new.strip()} is missing (a statement)"
    return Cause(change.kind, text, "", (), formulas=(("found", change.old), ("expected", change.new)))
