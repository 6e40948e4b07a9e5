"""The robot's derivatives by its own numbers, with which a repair's are compared (:mod:`.units`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.validation.hypotheses import Parameter, parameters, steiner
from armgpi.validation.models import States
from armgpi.validation.problem import Problem, function_of
from armgpi.validation.samples import SAFETY
from armgpi.validation.tree import Body, Quantities, Tree, evaluate
from armgpi.validation.units import (
    JOINED,
    STEP,
    TURNED,
    BodySlopes,
    Slopes,
    moments_of_point,
    slope_of_moments,
    span,
)

#: Quantities of which functions of states are made.
_ALWAYS = {"D", "H", "G"}
#: Kind of a number of the robot -> its unit.
_UNITS = {"mass": "kg", "com": "m", "length": "m", "tool": "m", "inertia": "kg m²", "armature": "kg m²"}


def slopes(problem: Problem, states: States, names: Sequence[str], has_angles: bool = False) -> Slopes:
    """Return the derivatives of an arm's functions by its masses, lengths, inertias, gravity and zeros.

    Args:
        problem: model and reference.
        states: at which they are taken.
        names: of the functions.
        has_angles: whether the model states angles of the geometry, by which the derivatives are needed too.
    """
    tree, stack = problem.tree, _Stack(problem, states, names)
    known = list(own_numbers(tree))
    ordered: list[Array] = []
    for one, _ in known:
        step = STEP * (abs(one.value) if one.kind == "mass" and one.value else 1.0)
        ends = [
            one.instance(one.value + s * step).quantities(tree, states.q, stack.want) for s in (1.0, -1.0)
        ]
        ordered.append(stack.difference(*ends) / (2.0 * step))
    units = [_UNITS.get(one.kind, one.unit) for one, _ in known]
    links = [link for _, link in known]
    bases = _bases(tree, stack, units, links, ordered)
    bases |= _turned_bases(tree, stack) if has_angles else {}
    strength = float(np.linalg.norm(tree.gravity))
    along = tree.gravity / strength if strength else tree.gravity
    ordered.append(0.5 * stack.between(*_under(tree, along)))
    noise = max(problem.noise[name] / size for name, size in zip(names, stack.sizes, strict=True))
    return Slopes(
        tuple(names),
        tuple(stack.sizes),
        bases,
        np.array([*(one.value for one, _ in known), strength]),
        (*units, "m/s²"),
        (*links, -1),
        np.stack(ordered, axis=-1),
        SAFETY * noise / (2.0 * STEP),
        problem.is_passive,
        tuple(_of_bodies(tree, known, ordered)),
    )


def _of_bodies(
    tree: Tree, known: Sequence[tuple[Parameter, int]], columns: Sequence[Array]
) -> Iterator[BodySlopes]:
    """Yield the derivatives by what bodies are made of: those by m, c and I about c, taken apart."""
    for i, body in enumerate(tree.bodies):
        of_kind: dict[str, list[Array]] = {}
        for (one, link), column in zip(known, columns, strict=False):
            if link == i:
                of_kind.setdefault(one.kind, []).append(column)
        if not body.mass:
            continue
        moments = np.stack(of_kind["inertia"], axis=-1)
        first = [of_kind["com"][k] / body.mass - moments @ slope_of_moments(body.com, k) for k in range(3)]
        linear = np.stack(first, axis=-1)
        mass = of_kind["mass"][0] - linear @ body.com - moments @ moments_of_point(body.com)
        end = tree.next_joint(i)
        places = (body.com, np.zeros(3), *(() if end is None else (end,)))
        yield BodySlopes(i, mass, linear, moments, places)


class _Stack:
    """What some functions of an arm give, stacked, each in units of its largest value.

    Attributes:
        sizes: these largest values.
    """

    def __init__(self, problem: Problem, states: States, names: Sequence[str]) -> None:
        """Take the reference, and the states and functions of which the values are stacked."""
        self._problem, self._states, self._names = problem, states, names
        self.want = sorted(_ALWAYS.union(problem.want))
        nominal = evaluate(problem.tree, states.q, self.want)
        self._passive = _Passive(problem, states, nominal) if problem.is_passive else None
        own = [self._function(name, problem.in_tool_coordinates(nominal), False) for name in names]
        self.sizes = [max(float(np.abs(x).max(initial=0.0)), 1e-9) for x in own]

    def _values(self, quantities: Quantities) -> list[Array]:
        seen = self._problem.in_tool_coordinates(quantities)
        return [self._function(name, seen, True).ravel() for name in self._names]

    def _function(self, name: str, quantities: Quantities, for_slope: bool) -> Array:
        """Return what a function gives, or something with the same derivative by the arm's numbers."""
        if name == "forward_dynamics" and self._passive is not None and for_slope:
            return self._passive.moved(quantities)
        return _function(name, quantities, self._states, self._problem)

    def difference(self, ahead: Quantities, behind: Quantities) -> Array:
        """Return how much more one arm gives than another."""
        pairs = zip(self._values(ahead), self._values(behind), self.sizes, strict=True)
        return np.concatenate([(a - b) / size for a, b, size in pairs])

    def between(self, ahead: Tree, behind: Tree) -> Array:
        """Return how much more one arm gives than another, from the arms."""
        return self.difference(*(evaluate(x, self._states.q, self.want) for x in (ahead, behind)))


class _Passive:
    """Accelerations where the torques that are read are too few to take D and C v + G apart.

    Their derivative by a number of the arm is -D⁻¹ times that of the torque for the same acceleration. That
    torque is linear in the masses, so that a step of any size gives it exactly; the accelerations are not.
    """

    def __init__(self, problem: Problem, states: States, nominal: Quantities) -> None:
        """Take the accelerations of the nominal arm."""
        self._viscous = problem.tree.viscous
        self._inverse = -np.linalg.inv(nominal["D"])
        a = function_of("forward_dynamics", nominal, states, self._viscous)
        self._states = states._replace(a=a)

    def moved(self, quantities: Quantities) -> Array:
        """Return -D⁻¹ of the nominal arm times the torque of another one."""
        torque = function_of("inverse_dynamics", quantities, self._states, self._viscous)
        return np.asarray(np.einsum("Nij,Nj->Ni", self._inverse, torque))


def _bases(
    tree: Tree, stack: _Stack, units: Sequence[str], links: Sequence[int], columns: Sequence[Array]
) -> dict[tuple[str, int | None], Array]:
    """Return what the derivatives by numbers of one unit and link span, of all links, and of loads there."""
    groups: dict[tuple[str, int | None], list[Array]] = {
        ("m/s²", -1): [stack.between(*_under(tree, e)) for e in np.eye(3)]
    }
    for unit, link, column in zip(units, links, columns, strict=True):
        groups.setdefault((unit, link), []).append(column)
    for (unit, _), rows in list(groups.items()):
        groups.setdefault((unit, None), []).extend(rows)
    joined: dict[tuple[str, int | None], list[Array]] = {}
    for unit, link, both in _with_loads(tree):
        own = groups.get((unit, link if unit == "kg" else None), [])
        joined.setdefault((JOINED + unit, link), [*own]).append(stack.between(*both))
    return {group: span(rows) for group, rows in (groups | joined).items()}


def _turned_bases(tree: Tree, stack: _Stack) -> dict[tuple[str, int | None], Array]:
    """Return what derivatives span by how a joint's frame, or all behind a joint, is turned and moved."""
    found: dict[tuple[str, int | None], Array] = {}
    for place, make in (("before", _before_joint), ("behind", _behind_joint)):
        for i in range(tree.n):
            ends = [(make(tree, i, twist), make(tree, i, -twist)) for twist in STEP * np.eye(6)]
            found[TURNED + place, i] = span([stack.between(*both) for both in ends])
    return found


def _before_joint(tree: Tree, i: int, twist: Array) -> Tree:
    """Return an arm of which the frame of joint i is turned and moved in its parent's."""
    rotation, shift = pin.exp3(twist[:3]), twist[3:]
    moved = tree.with_item("rotations", i, rotation @ tree.rotations[i])
    return moved.with_item("positions", i, rotation @ tree.positions[i] + shift)


def _behind_joint(tree: Tree, i: int, twist: Array) -> Tree:
    """Return an arm of which all that joint i carries is turned and moved in its frame."""
    rotation, shift = pin.exp3(twist[:3]), twist[3:]
    body = tree.bodies[i]
    moved = tree.with_body(i, com=rotation @ body.com + shift, inertia=rotation @ body.inertia @ rotation.T)
    for child, parent in enumerate(tree.parents):
        if parent == i:
            moved = _before_joint(moved, child, twist)
    if tree.tool_parent != i:
        return moved
    return replace(
        moved,
        tool_rotation=rotation @ tree.tool_rotation,
        tool_position=rotation @ tree.tool_position + shift,
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


def _under(tree: Tree, gravity: Array) -> tuple[Tree, Tree]:
    """Return an arm with some gravity more, and less."""
    more, less = (replace(tree, gravity=tree.gravity + s * gravity) for s in (1.0, -1.0))
    return more, less


def _function(name: str, p: Quantities, s: States, problem: Problem) -> Array:
    """Return what a function of a model gives, from an arm's quantities, as the search compares it."""
    viscous = problem.tree.viscous
    if name == "forward_dynamics" and not problem.is_passive:  # taken apart
        still = s._replace(a=0.0 * s.a)
        torque = function_of("inverse_dynamics", p, still, viscous)
        return np.concatenate([p["D"].reshape(len(s.q), -1), torque], axis=1)
    return function_of(name, p, s, viscous)
