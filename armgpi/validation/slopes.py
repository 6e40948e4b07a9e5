"""The robot's derivatives by its own numbers, with which a repair's are compared (:mod:`.units`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from armgpi.arrays import Array
from armgpi.validation.hypotheses import Parameter, parameters, steiner
from armgpi.validation.models import States
from armgpi.validation.problem import Problem
from armgpi.validation.samples import SAFETY
from armgpi.validation.tree import Body, Quantities, Tree, evaluate
from armgpi.validation.units import JOINED, STEP, Slopes, span

#: Kind of a number of the robot -> its unit.
_UNITS = {"mass": "kg", "com": "m", "length": "m", "tool": "m", "inertia": "kg m²", "armature": "kg m²"}


def slopes(problem: Problem, states: States, names: Sequence[str]) -> Slopes:
    """Return the derivatives of an arm's functions by its masses, lengths, inertias, gravity and zeros."""
    tree = problem.tree

    def values(quantities: Quantities) -> list[Array]:
        seen = problem.in_tool_coordinates(quantities)
        return [_function(name, seen, states).ravel() for name in names]

    want = ("D", "H", "G", "V", "F", "J")
    sizes = [max(float(np.abs(x).max(initial=0.0)), 1e-9) for x in values(evaluate(tree, states.q, want))]

    def column(ahead: Quantities, behind: Quantities) -> Array:
        pairs = zip(values(ahead), values(behind), sizes, strict=True)
        return np.concatenate([(a - b) / size for a, b, size in pairs])

    ordered: list[Array] = []
    known = list(own_numbers(tree))
    for one, _ in known:
        step = STEP * (abs(one.value) if one.kind == "mass" and one.value else 1.0)
        ends = [one.instance(one.value + s * step).quantities(tree, states.q, want) for s in (1.0, -1.0)]
        ordered.append(column(*ends) / (2.0 * step))
    under = [[evaluate(_under(tree, s * e), states.q, want) for s in (1.0, -1.0)] for e in np.eye(3)]
    units = [*(_UNITS.get(one.kind, one.unit) for one, _ in known), "m/s²"]
    links = [*(link for _, link in known), -1]
    groups: dict[tuple[str, int | None], list[Array]] = {("m/s²", -1): [column(*ends) for ends in under]}
    for unit, link, values_of in zip(units, links, ordered, strict=False):
        groups.setdefault((unit, link), []).append(values_of)
    for (unit, _), rows in list(groups.items()):
        groups.setdefault((unit, None), []).extend(rows)
    joined: dict[tuple[str, int | None], list[Array]] = {}
    for unit, link, both in _with_loads(tree):
        own = groups.get((unit, link if unit == "kg" else None), [])
        pair = column(*[evaluate(x, states.q, want) for x in both])
        joined.setdefault((JOINED + unit, link), [*own]).append(pair)
    groups |= joined
    strength = float(np.linalg.norm(tree.gravity))
    along = tree.gravity / strength if strength else tree.gravity
    ends = [evaluate(_under(tree, s * along), states.q, want) for s in (1.0, -1.0)]
    ordered.append(0.5 * column(*ends))
    return Slopes(
        tuple(names),
        tuple(sizes),
        {group: span(rows) for group, rows in groups.items()},
        np.array([*(one.value for one, _ in known), strength]),
        tuple(units),
        tuple(links),
        np.stack(ordered, axis=-1),
        SAFETY
        * max(problem.noise[name] / size for name, size in zip(names, sizes, strict=True))
        / (2.0 * STEP),
    )


def _with_loads(tree: Tree) -> Iterator[tuple[str, int, tuple[Tree, Tree]]]:
    """Yield a unit and a link with a load at one of its joints, more and less of it, or to both sides."""
    for i, body in enumerate(tree.bodies):
        end = tree.next_joint(i)
        if end is None or not body.mass:
            continue

        def with_load(mass: float, at: Array, i: int = i, body: Body = body) -> Tree:
            total, away = body.mass + mass, at - body.com
            com, inertia = (
                body.com + mass / total * away,
                body.inertia + steiner(mass * body.mass / total, away),
            )
            return tree.with_body(i, mass=total, com=com, inertia=inertia)

        step = STEP * body.mass
        yield from (("kg", i, (with_load(step, at), with_load(-step, at))) for at in (end, 0.0 * end))
        yield from (("m", i, (with_load(step, end + e), with_load(step, end - e))) for e in np.eye(3))


def own_numbers(tree: Tree) -> Iterator[tuple[Parameter, int]]:
    """Yield the robot's numbers, each with its link from 0; that of the tool is the number of links."""
    link = -1
    for one in parameters(tree):
        link += one.kind == "mass"  # the first of every link
        if one.kind != "scale":
            yield one, tree.n if one.kind == "tool" else link


def with_changes(tree: Tree, changes: Mapping[int, float]) -> Tree:
    """Return an arm with other numbers: place among its own -> how much larger; gravity's is by its share."""
    known, found = list(own_numbers(tree)), tree
    for k, change in changes.items():
        if k == len(known):
            share = 1.0 + change / float(np.linalg.norm(tree.gravity))
            found = replace(found, gravity=share * found.gravity)
            continue
        make = known[k][0].instance(known[k][0].value + change).tree
        if make is None:
            raise ValueError
        found = make(found)
    return found


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
