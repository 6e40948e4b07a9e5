"""A repair of the model's source: searched beside the model, and proved on a copy of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from armgpi.arrays import Array
from armgpi.errors import ModelError
from armgpi.validation import phrasing, samples
from armgpi.validation.diagnose import Cause
from armgpi.validation.edits import ROWS, Target
from armgpi.validation.models import ARGUMENTS
from armgpi.validation.problem import Problem
from armgpi.validation.samples import States
from armgpi.validation.search import Repaired
from armgpi.validation.tree import evaluate
from armgpi.validation.worker import Worker


def search(
    model: Any,
    worker: Worker,
    states: States,
    problem: Problem,
    references: Mapping[str, Array],
    way: Array | None = None,
) -> tuple[Repaired | None, bool]:
    """Return the changes of the source with which a copy of the model agrees, and whether it was searched.

    `way` is what the robot has on the way of a recursion, (rows, 5, n), for a model that tells of that.
    """
    if worker.source is None:
        return None, False
    few = States(*(x[:ROWS] for x in states))
    targets = {}
    for name, values in references.items():
        arguments = tuple(getattr(few, letter) for letter in ARGUMENTS[name])
        flat = np.asarray(values[: len(few.q)], dtype=np.float64).reshape(len(few.q), -1)
        if name == "forward_dynamics":
            flat = _taken_apart(problem, few, flat)
        size = float(np.abs(flat).max())
        best = None
        if name == "coriolis_matrix":
            H = evaluate(problem.tree, few.q, ["H"])["H"]
            best = np.einsum("Nijk,Nk->Nij", H, few.v).reshape(len(few.q), -1)
        # At least what rounding leaves: an output that must be zero is compared with the others.
        targets[name] = Target(arguments, flat, np.full(flat.shape[1], 1e-8 * max(size, 1e-3)), best)
    if way is not None:
        flat = way[:ROWS, :4].reshape(ROWS, -1)
        size = max(float(np.abs(flat).max()), 1e-3)
        tolerance = np.full(flat.shape[1], 1e-8 * size)
        targets["recursion"] = Target((few.q, few.v, few.a), flat, tolerance, soft=True)
    with Worker(model, worker.name, worker.time_limit, None, worker.convention) as copy:
        known = [value for value, _ in phrasing.known_numbers(problem.tree) if value]
        searched, found = copy.search(targets, known)
    if found is None or not agrees(model, worker, found.source, states, problem):
        return None, searched
    return found, True


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
    "term": "a term is missing",
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
            wrong = _WRONG.get(change.kind, "a number")
            text = f"{line}: {change.old} stands where {change.new} belongs ({wrong})"
        evidence = [f"{k}: {before[k - 1].strip()}" for k in range(first, last + 1)]
        if len(before) == len(after):
            evidence += [f"{k}: {after[k - 1].strip()}   <- so it has to be" for k in range(first, last + 1)]
        proof = (
            "with this change the model agrees"
            if len(repair.changes) == 1
            else "with all changes the model agrees"
        )
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
        )
