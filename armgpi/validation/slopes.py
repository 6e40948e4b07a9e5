"""The robot's derivatives by its own numbers, with which a repair's are compared (:mod:`.units`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armgpi.arrays import Array
from armgpi.validation.hypotheses import parameters
from armgpi.validation.models import States
from armgpi.validation.problem import Problem
from armgpi.validation.tree import Quantities, Tree, evaluate
from armgpi.validation.units import STEP, Slopes, span

#: Kind of a number of the robot -> its unit.
_UNITS = {"mass": "kg", "com": "m", "length": "m", "tool": "m", "inertia": "kg m²", "armature": "kg m²"}


def slopes(problem: Problem, states: States, names: Sequence[str]) -> Slopes:
    """Return the derivatives of an arm's functions by its masses, lengths, inertias, gravity and zeros."""
    tree = problem.tree

    def values(quantities: Quantities) -> list[Array]:
        seen = problem.seen(quantities)
        return [_function(name, seen, states).ravel() for name in names]

    want = ("D", "H", "G", "V", "F", "J")
    sizes = [max(float(np.abs(x).max(initial=0.0)), 1e-9) for x in values(evaluate(tree, states.q, want))]

    def column(ahead: Quantities, behind: Quantities) -> Array:
        pairs = zip(values(ahead), values(behind), sizes, strict=True)
        return np.concatenate([(a - b) / size for a, b, size in pairs])

    columns: dict[str, list[Array]] = {}
    found: list[float] = []
    ordered: list[Array] = []
    for one in parameters(tree):
        if one.kind == "scale":
            continue
        unit = _UNITS.get(one.kind, one.unit)
        step = STEP * (abs(one.value) if one.kind == "mass" and one.value else 1.0)
        ends = [one.instance(one.value + s * step).quantities(tree, states.q, want) for s in (1.0, -1.0)]
        ordered.append(column(*ends) / step)
        columns.setdefault(unit, []).append(ordered[-1])
        found.append(abs(one.value))
    under = [[evaluate(_under(tree, s * e), states.q, want) for s in (1.0, -1.0)] for e in np.eye(3)]
    columns["m/s²"] = [column(*ends) for ends in under]
    ordered.append(column(*(evaluate(_under(tree, s * tree.gravity), states.q, want) for s in (1.0, -1.0))))
    found.append(float(np.linalg.norm(tree.gravity)))
    spans = {unit: span(rows) for unit, rows in columns.items()}
    return Slopes(tuple(names), tuple(sizes), spans, np.array(found), np.stack(ordered, axis=-1))


def _under(tree: Tree, gravity: Array) -> Tree:
    return replace(tree, gravity=tree.gravity + gravity)


def _function(name: str, p: Quantities, s: States) -> Array:
    """Return what a function of a model gives, from an arm's quantities, (rows, ...)."""
    if name in ("mass_matrix", "gravity", "potential_energy", "forward_kinematics", "jacobian"):
        return p[{"mass_matrix": "D", "gravity": "G", "potential_energy": "V"}.get(name, name[0].upper())]
    if name == "kinetic_energy":
        return np.asarray(0.5 * np.einsum("Ni,Nij,Nj->N", s.v, p["D"], s.v))
    torque = np.einsum("Nijk,Nj,Nk->Ni", p["H"], s.v, s.v)
    if name == "inverse_dynamics":
        return np.asarray(np.einsum("Nij,Nj->Ni", p["D"], s.a) + torque + p["G"])
    if name == "forward_dynamics":  # taken apart, as the search compares it
        return np.concatenate([p["D"].reshape(len(s.q), -1), torque + p["G"]], axis=1)
    return np.asarray(torque)
