"""A repair of the model's source: searched beside the model, and proved on a copy of it."""

from __future__ import annotations

import ast
import copy
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from armgpi.arrays import Array
from armgpi.errors import ModelError
from armgpi.validation import phrasing, samples
from armgpi.validation.diagnose import Cause
from armgpi.validation.edits import ALL, ROWS, Goal, Target
from armgpi.validation.models import ARGUMENTS, States
from armgpi.validation.problem import Problem
from armgpi.validation.search import BUDGET, Repaired, is_number
from armgpi.validation.slopes import slopes, with_changes
from armgpi.validation.tree import evaluate
from armgpi.validation.units import numbers, with_numbers
from armgpi.validation.worker import Worker

#: Time of the processor for a search [s], and where a convention explains all.
LONG, SHORT = BUDGET, 0.3


def search(
    model: Any,
    worker: Worker,
    states: States,
    problem: Problem,
    reference: Callable[[str, States], Array],
    names: Sequence[str],
    budget: float = LONG,
) -> Repaired | None:
    """Return the changes of the source with which a copy of the model agrees, None when none are found.

    Args:
        model: as the user gave it.
        worker: its process.
        states: at which it was sampled.
        problem: model and reference.
        reference: what a function should give at some states.
        names: its functions.
        budget: time of the processor that it may take [s].
    """
    if worker.source is None:
        return None
    few = States(*(x[:ROWS] for x in states))
    where = {ALL: few, **_moving(few)}
    targets = {name: _target(problem, few, name, reference(name, few)) for name in names}
    for name in names:
        targets |= _parts(targets[name], where, partial(_reference, problem, reference, name))
    with Worker(model, worker.name, worker.time_limit, None, worker.convention) as copy:
        known = [value for value, _ in phrasing.known_numbers(problem.tree) if value]
        asked = {label for target in targets.values() for _, label in target.states}
        seen = {label: states for label, states in where.items() if label in asked}
        goal = Goal(seen, targets, slopes(problem, few, names))
        found = copy.search(goal, known, budget)
    if found is None or not agrees(model, worker, found.source, states, problem):
        return None
    sure = found.confirmed and _agrees_renumbered(model, worker, found, states, problem)
    return found._replace(sure=sure)


def _agrees_renumbered(model: Any, worker: Worker, found: Repaired, states: States, problem: Problem) -> bool:
    """Tell whether a repaired model agrees where its numbers, and what they are in the robot, are others."""
    named = [node for _, node in numbers(ast.parse(found.source))]
    # Shares that no products or ratios of few of them make one again.
    draw = np.random.default_rng(20261123).uniform(0.75, 1.3, size=len(named))
    own = {k: float(ast.literal_eval(named[k])) for k in found.standing}
    changes = [(named[k], value * draw[k]) for k, value in own.items()]
    moved: dict[int, float] = {}
    for k, value in own.items():
        for j, rate in found.standing[k].items():
            moved[j] = moved.get(j, 0.0) + rate * (value * (draw[k] - 1.0))
    other = copy.copy(problem)
    other.tree = with_changes(problem.tree, moved)
    return agrees(model, worker, with_numbers(found.source, changes), states, other)


def _target(problem: Problem, s: States, name: str, values: Array) -> Target:
    """Return what a function should give at some states."""
    flat = _flat(problem, name, s, values)
    size, best = float(np.abs(flat).max()), None
    if name == "coriolis_matrix":
        H = evaluate(problem.tree, s.q, ["H"])["H"]
        best = np.einsum("Nijk,Nk->Nij", H, s.v).reshape(len(s.q), -1)
    # At least what rounding leaves: an output that must be zero is compared with the others.
    return Target(name, flat, np.full(flat.shape[1], 1e-8 * max(size, 1e-3)), best)


def _reference(problem: Problem, reference: Callable[[str, States], Array], name: str, s: States) -> Array:
    return _flat(problem, name, s, reference(name, s))


def _flat(problem: Problem, name: str, s: States, values: Array) -> Array:
    """Return the values of a function as the search compares them, (rows, m)."""
    flat = np.asarray(values, dtype=np.float64).reshape(len(s.q), -1)
    return _taken_apart(problem, s, flat) if name == "forward_dynamics" else flat


def _moving(s: States) -> dict[str, States]:
    """Return states in which nothing moves, one joint, or two."""
    n = s.q.shape[1]

    def only(v: Sequence[int], a: Sequence[int]) -> States:
        return s._replace(
            v=np.where(np.isin(range(n), v), s.v, 0.0), a=np.where(np.isin(range(n), a), s.a, 0.0)
        )

    found = {"rest": only((), ())}
    found |= {f"a{i}": only((), (i,)) for i in range(n)}
    found |= {f"v{i}": only((i,), ()) for i in range(n)}
    return found | {f"v{i}v{j}": only((i, j), ()) for i, j in itertools.combinations(range(n), 2)}


def _parts(
    whole: Target, where: Mapping[str, States], reference: Callable[[States], Array]
) -> dict[str, Target]:
    """Return a function's parts: what gravity, each acceleration and each product of velocities gives."""
    letters = ARGUMENTS[whole.function]
    if "v" not in letters:
        return {}
    still = "a" in letters or "tau" in letters  # something is left at rest
    values = {
        label: reference(states) for label, states in where.items() if "a" in letters or label[:1] != "a"
    }
    found = {}
    for label in values:
        if label == ALL or (label == "rest" and not still):
            continue
        pair = re.findall(r"v\d+", label)
        states = [(1.0, label), *((-1.0, one) for one in pair if len(pair) > 1)]
        if still and label != "rest":
            states.append((1.0 if len(pair) > 1 else -1.0, "rest"))
        flat = np.sum([sign * values[one] for sign, one in states], axis=0)
        found[f"{whole.function} {label}"] = whole._replace(values=flat, best=None, states=tuple(states))
    return found


def _taken_apart(problem: Problem, s: States, accelerations: Array) -> Array:
    """Return D and C v + G, flat, where the robot has some accelerations."""
    D = evaluate(problem.tree, s.q, ["D"])["D"]
    bias = s.tau - np.einsum("Nij,Nj->Ni", D, accelerations)
    return np.concatenate([D.reshape(len(D), -1), bias], axis=1)


def agrees(model: Any, worker: Worker, source: str, states: States, problem: Problem) -> bool:
    """Tell whether a model with another source agrees everywhere."""
    try:
        with Worker(model, worker.name, worker.time_limit, source, worker.convention) as repaired:
            sampled = samples.sample(repaired, states)
            return bool(Problem(problem.tree, states.q, sampled, problem.rtol).agreeing.all())
    except ModelError:
        return False


#: More elements than these are not listed: a mistake in what many share shows everywhere.
_FEW = 4
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
}


def causes(repair: Repaired, source: str, problem: Problem) -> Iterator[Cause]:
    """Yield the mistakes that a repair undoes."""
    differing = tuple(problem.elements[k] for k in np.flatnonzero(~problem.agreeing))
    scope = "elements" if len(differing) <= _FEW else "model"
    before, after = source.splitlines(), repair.source.splitlines()
    for change in repair.changes:
        elements = tuple(one for one in differing if one.function in change.reaches) or differing
        first, _, last, _ = change.span
        line = f"line {first}" + (f", in {change.where}" if change.where else "")
        value = expected = None
        if change.kind in ("unit", "value"):
            value, expected = float(change.old), float(change.new)
            text = f"the model's {change.name} is {value:.6g}; with {expected:.6g} it agrees"
            text += phrasing.ratio(value / expected) if expected else ""
        else:
            numbers_alone = is_number(change.old) and is_number(change.new)
            wrong = _WRONG.get("" if numbers_alone else change.kind, "a number")
            text = f"{line}: {change.old} stands where {change.new} belongs ({wrong})"
            if not change.old:
                text = f"{line}: after it {change.new.strip()} is missing (a statement)"
        evidence = [f"{k}: {before[k - 1].strip()}" for k in range(first, last + 1)]
        if len(before) == len(after):
            evidence += [f"{k}: {after[k - 1].strip()}   <- so it has to be" for k in range(first, last + 1)]
        proof = f"with {'this change' if len(repair.changes) == 1 else 'all changes'} the model agrees"
        proof += ", for other numbers too" if repair.confirmed else ": suggested, as other numbers may differ"
        structural = change.kind not in ("unit", "value")
        formulas = (("stands", change.old), ("belongs", change.new)) if structural else ()
        yield Cause(
            change.kind,
            text,
            scope,
            elements,
            value,
            expected,
            (),
            (*evidence, proof),
            structural,
            first,
            formulas,
            repair.confirmed,
        )
