"""Two witnesses of what is wrong: what the values say and what the source says, side by side.

Neither mutes the other. A cause of the whole model, which fits every function that was compared, is tried
first and ends the search. What a model neglects, or rounds, is set aside before, and the search goes on
behind it.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from armgpi.errors import ModelError
from armgpi.validation import repair, samples
from armgpi.validation.alternatives import names_with
from armgpi.validation.diagnose import (
    ALTERNATIVES,
    NOT_NAMED,
    UNNAMED,
    Cause,
    added_diagonal,
    added_rotors,
    diagnose,
    join_equal,
    rotors_text,
)
from armgpi.validation.edits import harmless
from armgpi.validation.entries import shown
from armgpi.validation.friction import coulomb_friction
from armgpi.validation.hypotheses import CONVENTIONS
from armgpi.validation.naming import UserName, users_names
from armgpi.validation.problem import Element, Mask, Problem
from armgpi.validation.proofs import Repaired
from armgpi.validation.repair import Compared, Renumbered
from armgpi.validation.residual import Difference, Residual
from armgpi.validation.samples import Sampled
from armgpi.validation.slips import everywhere, find_slip, overwritten
from armgpi.validation.summands import fits_other_bodies, without_inertias
from armgpi.validation.typed import doubted, find_wrong_number
from armgpi.validation.units import numbers

#: Inertias that add at most this to any entry of D, relative, are neglected and not forgotten.
_NEGLIGIBLE = 0.01
#: Strengths of gravity that are rounded ones of each other [m/s²].
_ROUNDED = (9.81, 9.8, 9.80665, 9.82, 9.8067, 9.807, 10.0)
#: Elements that a line lists with what they lack, at most.
_LISTED = 3
#: Kinds of causes that are about more than the elements which differ.
_WHOLE = ("consequence", "rotor-inertia", "triangle", "gravity", *CONVENTIONS)
#: Share of a torque that is no polynomial of degree two in v, beyond rounding.
_BENT = 1e-6
#: Explanations up to this length are a summand or two of the robot's own, with usual shares.
_OWN = 3.5
#: Coefficients by which one quantity is another one by chance: 4 lc² is l² of a rod.
_ODD = {3.0, 4.0, 6.0, 8.0, 12.0, 0.25}
#: What the two witnesses are called.
VALUES, SOURCE = "the values say", "the source says"


class Found(NamedTuple):
    """What both witnesses say.

    Attributes:
        causes: the mistakes, the best first, each beside what the other witness says.
        repaired: the source with changes with which the model agrees; None without such.
        differences: what differs as formulas.
        symbols: what the numbers in these formulas are.
    """

    causes: list[Cause]
    repaired: str | None
    differences: tuple[Difference, ...]
    symbols: tuple[str, ...]


class _Aside(NamedTuple):
    """A problem behind what was set aside, and that as a cause; None where nothing was."""

    problem: Problem
    cause: Cause | None


class _Behind(NamedTuple):
    """What is left of a comparison when all that can be was set aside.

    Attributes:
        problem: model and reference, with what was set aside in the reference.
        causes: what was set aside.
        differences: what differed at first as formulas, with the other rounding of gravity in the reference.
    """

    problem: Problem
    causes: list[Cause]
    differences: tuple[Difference, ...]


def find_causes(
    compared: Compared, sampled: Mapping[str, Sampled], follows: Mapping[str, tuple[str, Mask]]
) -> Found:
    """Return what is wrong with a model, as its values and its source tell.

    Args:
        compared: the model beside the robot.
        sampled: its samples.
        follows: see :func:`armgpi.validation.diagnose.diagnose`.
    """
    names = users_names(compared.worker.source, compared.problem.tree)
    residual = Residual(compared.problem, names)
    differences = residual.differences(~compared.problem.agreeing)
    whole = diagnose(compared.problem, follows, conventions=True)
    behind = _Behind(compared.problem, [], differences)
    if not whole:
        behind = _set_aside(compared.problem, sampled, differences, names)
    if behind.causes:
        compared = compared._replace(problem=behind.problem)
        if behind.problem.agreeing.all():
            return Found(behind.causes, None, behind.differences, residual.legend(behind.differences))
        differences = Residual(behind.problem, names).differences(~behind.problem.agreeing)
        whole = diagnose(behind.problem, follows, conventions=True)
    whole = _friction(compared, sampled, whole)
    if _is_of_drives(whole, behind.problem):
        # Not a mistake of the formulas: the drives' part, which a search would only take away again.
        legend = residual.legend(behind.differences)
        return Found([*whole, *behind.causes], None, behind.differences, legend)
    by_values = whole or diagnose(behind.problem, follows)
    causes, repaired = _searched_causes(compared, by_values, whole, differences)
    if behind.causes:
        causes = [cause._replace(evidence=tuple(map(_but_for_the_rest, cause.evidence))) for cause in causes]
    labels = {one.label for one in differences}
    shown = (*differences, *(one for one in behind.differences if one.label not in labels))
    return Found([*causes, *behind.causes], repaired, shown, residual.legend(shown))


def _set_aside(
    problem: Problem,
    sampled: Mapping[str, Sampled],
    differences: tuple[Difference, ...],
    names: Mapping[str, UserName],
) -> _Behind:
    """Set aside what is no mistake of the formulas: rotors, another rounding of gravity, small inertias.

    Args:
        problem: model and reference.
        sampled: the model's samples.
        differences: what differs as formulas.
        names: what the user calls the robot's numbers.
    """
    causes: list[Cause] = []
    for step in (_rotors, _rounded, _neglected):
        behind = step(problem, sampled, differences)
        if behind.cause is None:
            continue
        causes.append(behind.cause)
        problem = behind.problem
        if step is _rounded:
            differences = Residual(problem, names).differences(~problem.agreeing)
    return _Behind(problem, causes, differences)


def _searched_causes(
    compared: Compared, by_values: list[Cause], whole: list[Cause], differences: Sequence[Difference]
) -> tuple[list[Cause], str | None]:
    """Search the source, and return what both witnesses say, with the repaired source or None.

    Args:
        compared: the model beside the robot.
        by_values: what the values say.
        whole: of that the convention of the whole model, if there is one.
        differences: what differs as formulas.
    """
    # A convention of the whole model is seen at once; one line of the source that undoes it is found fast.
    budget = repair.SHORT if whole and whole[0].kind in CONVENTIONS else np.inf
    found = _find_repair(compared, by_values, whole, budget)
    if found is not None:
        found = repair.confirmed_by_terms(compared, found, differences)
    is_number = found is not None and all(change.kind == "value" for change in found.changes)
    # Of a wrong number the values say which it is; its terms in every entry say less.
    values = by_values if is_number else _told_by_values(by_values, differences)
    if found is None and not whole:
        values = _with_other_bodies(compared.problem, values)
    _forget_what_was_not_searched(compared, whole, found)
    rotor = _one_rotor(compared.problem)
    if rotor is not None:
        if found is not None and _removes_no_term_of(found, differences):
            causes = repair.causes(found, compared.worker.source or "", compared.problem)
            return _beside([rotor], list(causes), SOURCE), None
        values = [_or_rotor(cause, rotor) for cause in values]
    return _ranked(values, found, whole, compared.worker.source, compared.problem, differences)


def _but_for_the_rest(line: str) -> str:
    """Return a line of evidence; one that says that the model agrees says as well what was set aside."""
    return f"{line}, but for what is set aside below" if "the model agrees" in line else line


def _forget_what_was_not_searched(compared: Compared, whole: list[Cause], found: Repaired | None) -> None:
    """Where the mistake is named, no further search is needed."""
    if whole or (found is not None and found.confirmed):
        compared.course.unsearched.clear()


def _friction(compared: Compared, sampled: Mapping[str, Sampled], whole: list[Cause]) -> list[Cause]:
    """Return dry friction in place of viscous friction where the torque is no polynomial of v."""
    if dry := coulomb_friction(compared, sampled):
        return dry
    bent = any(one.quadratic > _BENT * float(np.abs(one.values).max()) for one in sampled.values())
    return [] if bent and whole and whole[0].kind == "friction" else whole


def _is_of_drives(whole: list[Cause], problem: Problem) -> bool:
    """Tell whether all that differs is rotor inertia or friction, of which the robot has none.

    Where a joint slides, a wrong mass adds to the diagonal as well.
    """
    tree = problem.tree
    has_some = tree.armature.any() or (tree.viscous is not None and tree.viscous.any())
    kinds = {cause.kind for cause in whole[:1]}
    if has_some or (kinds == {"rotor-inertia"} and any(tree.prismatic)):
        return False
    return bool(kinds & {"rotor-inertia", "friction"})


def _find_repair(
    compared: Compared, values: list[Cause], whole: list[Cause], budget: float
) -> Repaired | None:
    """Return the repair of the source: of one number first where the values say that a number is wrong."""
    number: Repaired | None = None
    is_number = not whole and len(values) == 1 and not values[0].structural
    if is_number:
        number = _wrong_number(compared)
        if number is not None and number.confirmed:
            return number
    if not whole and (slip := find_slip(compared, overwritten)) is not None:
        return slip
    found = repair.search(compared, budget)
    found = None if found is None else doubted(compared, found)
    if found is not None and found.confirmed:
        if number is None or not number.instead:
            return found
        if any(change.kind not in ("index", "name") for change in found.changes):
            return number  # which says as well that the other number may belong there
        return found._replace(sure=False, instead=_or_number(compared.worker.source or "", number))
    if not is_number and not whole:
        number = _wrong_number(compared)
    if number is None and (found is None or found.doubtful) and not whole:
        number = find_slip(compared, everywhere)
    if number is not None and found is not None and found.doubts < number.doubts:
        return found  # fewer numbers speak against it
    return number or found


def _wrong_number(compared: Compared) -> Repaired | None:
    """Return the one wrong number of a source; a candidate where another number may belong there."""
    found = find_wrong_number(compared)
    return None if found is None else doubted(compared, found)


def _or_number(source: str, number: Repaired) -> str:
    """Return that a number may be wrong instead of the place where it is read."""
    change = number.changes[0]
    name = shown(source, change.name, change.span)
    return f"or {name} in line {change.span[0]} is wrong: with {change.new} the model agrees as well"


def with_other_numbers(compared: Compared, other: Renumbered) -> Found | None:
    """Return what is wrong with a model that agrees with its own numbers alone, as it shows with others.

    None where it agrees with the other numbers too, whatever their derivatives are.

    Args:
        compared: the model beside the robot, where they agree.
        other: the model and the robot with other numbers.
    """
    names = ", ".join(other.names)
    text = f"it agrees for these numbers only: with another {names} it would differ from the robot"
    functions = tuple(Element(name, "whole", ()) for name in compared.names)
    bare = Found([Cause("numbers", text, "model", functions)], None, (), ())
    try:
        with compared.worker.again(other.source) as twin:
            sampled = samples.sample(twin, compared.states)
            problem = Problem(other.tree, compared.states.q, sampled, compared.problem.rtol)
            if problem.agreeing.all():
                return None
            there = compared._replace(worker=twin, problem=problem)
            found = find_causes(there, sampled, {})
    except ModelError:
        return bare
    if all(cause.kind in UNNAMED for cause in found.causes):
        return bare
    proof = "seen with other numbers in the model and in the robot; with those of the file it agrees"
    causes = [
        cause._replace(confirmed=False, beside="", evidence=(proof, *_without_numbers(cause.evidence)))
        for cause in found.causes
    ]
    return Found(causes, None, found.differences, ())


def _without_numbers(evidence: Sequence[str]) -> list[str]:
    """Return lines of evidence that have no values of other numbers: those of the source."""
    return [line for line in evidence if line.partition(":")[0].isdigit()]


def _with_other_bodies(problem: Problem, values: list[Cause]) -> list[Cause]:
    """Return causes of which those without a name say where another parameter set is the model."""
    differing = problem.elements_of(~problem.agreeing)
    if all(cause.kind != UNNAMED[0] for cause in values) or len({e[1:] for e in differing}) < 2:
        return values
    if not fits_other_bodies(problem):
        return values
    text = (
        "another parameter set: the robot with other masses, centres of mass and inertias is the model, "
        "so the formulas may be right; --suggest-urdf FILE writes it"
    )
    return [
        cause._replace(alternatives=(text, *cause.alternatives)[:ALTERNATIVES])
        if cause.kind == UNNAMED[0]
        else cause
        for cause in values
    ]


def _ranked(
    values: list[Cause],
    found: Repaired | None,
    whole: list[Cause],
    source: str | None,
    problem: Problem,
    differences: Sequence[Difference],
) -> tuple[list[Cause], str | None]:
    """Return what both witnesses say, the better first, and the repaired source where that one is."""
    if found is None or source is None:
        if source is not None and harmless(source):
            values = join_equal(_searched(cause, source) for cause in values)
        return values, None
    causes = list(repair.causes(found, source, problem))
    numbers_alone = all(change.kind == "value" for change in found.changes)
    if numbers_alone and len(values) == 1 and not values[0].structural:  # both say the same
        return _beside(causes, values, VALUES), found.source
    if whole and whole[0].kind in CONVENTIONS and _only_removes(found):
        # What converts between two conventions was written on purpose.
        return _beside(values, causes, SOURCE), None
    plain = bool(differences) and all(one.bits <= _OWN for one in differences)
    if plain and _has_odd_coefficient(found, source):
        unsure = [cause._replace(confirmed=False) for cause in causes]
        return _beside(values, unsure, SOURCE), None
    # A convention is a shorter description than two changes.
    if found.confirmed and len(found.changes) + bool(whole) <= 2:
        return _beside(causes, values, VALUES), found.source
    if (
        len(found.changes) > 2 and len(values) == 1 and values[0].kind not in UNNAMED
    ):  # so is one cause than three
        return _beside(values, causes, SOURCE), found.source
    # A number that the source does not have is none that someone mistyped.
    number = values[0].value if len(values) == len(causes) == 1 else None
    if not found.doubtful or not (number is None or _is_typed(number, found.source)):
        return _beside(causes, values, VALUES), found.source
    # What the values say goes before a change that agrees at the numbers of the file alone.
    return _beside([_searched(cause, source) for cause in values], causes, SOURCE), None


def _only_removes(found: Repaired) -> bool:
    """Tell whether a repair is one number or term that becomes zero."""
    if len(found.changes) != 1:
        return False
    try:
        return float(found.changes[0].new) == 0.0
    except ValueError:
        return False


def _removes_no_term_of(found: Repaired, differences: Sequence[Difference]) -> bool:
    """Tell whether a repair drops a number or summand that is none of the robot's: written on purpose."""
    if _only_removes(found):
        return True
    is_dropped = [change.kind for change in found.changes] == ["extra"]
    return is_dropped and bool(differences) and not any(one.named for one in differences)


def _one_rotor(problem: Problem) -> Cause | None:
    """Return the rotor inertia of one joint where that is all that differs, None else.

    Where the robot has rotors their numbers are compared, and where a joint slides a mass adds there too.
    """
    added = added_diagonal(problem, ~problem.agreeing)
    if added is None or np.count_nonzero(added) != 1 or problem.tree.armature.any():
        return None
    if problem.tree.prismatic[int(np.flatnonzero(added)[0])]:
        return None
    elements = problem.elements_of(~problem.agreeing)
    return Cause("rotor-inertia", rotors_text(problem, added), "elements", elements, structural=False)


def _or_rotor(cause: Cause, rotor: Cause) -> Cause:
    """Return what the values tell, with the rotor inertia that explains it as well."""
    if cause.kind in ("armature", "rotor-inertia"):
        return cause
    return cause._replace(alternatives=(rotor.text, *cause.alternatives)[:ALTERNATIVES])


def _told_by_values(causes: list[Cause], differences: Sequence[Difference]) -> list[Cause]:
    """Return what the values tell; what has no name of its own is told by its difference."""
    by_label = {(one.function, one.label): one for one in differences}
    told = []
    for cause in causes:
        own = [by_label.get((e.function, e.label)) for e in cause.elements]
        named = [one for one in own if one is not None and one.named]
        if not named or len(named) < len(own):
            told.append(cause)
            continue
        # A number without a meaning is a longer description than one or two summands.
        is_any = not cause.structural and cause.kind != "factor" and "(" not in cause.text.split(": ", 1)[-1]
        plain = all(one.bits <= _OWN for one in named) and (cause.scope == "elements" or is_any)
        if cause.kind == UNNAMED[0]:
            cause = cause._replace(kind="summand", text=_in_lines(named))
        elif plain and (cause.structural or is_any) and cause.kind not in _WHOLE:
            other = (cause.text, *cause.alternatives)[:ALTERNATIVES]
            cause = cause._replace(
                kind=cause.kind if cause.structural else "summand",
                text=_in_lines(named),
                alternatives=other,
                structural=True,
                value=None,
                expected=None,
            )
        told.append(cause)
    return join_equal(told)


def _in_lines(differences: Sequence[Difference]) -> str:
    """Return what some elements lack in one line."""
    if len({one.text for one in differences}) == 1:
        return differences[0].text
    listed = [f"{one.label}: {one.text}" for one in differences[:_LISTED]]
    more = len(differences) - _LISTED
    return " | ".join(listed) + (f" | and {more} more" if more > 0 else "")


def _searched(cause: Cause, source: str) -> Cause:
    """Return what the values tell where no change of the source makes the model agree."""
    typed = cause.expected is not None and _is_typed(cause.expected, source)
    if not (typed or cause.structural) or cause.kind in ("consequence", *CONVENTIONS, "gravity"):
        return cause
    beside = f"{SOURCE}: no usual change of it makes the model agree"
    if typed and not cause.structural:
        # The source has the right number, so that it is no other one that the model computes with.
        other = (cause.text, *cause.alternatives)[:ALTERNATIVES]
        cause = cause._replace(kind=UNNAMED[0], text=NOT_NAMED, alternatives=other)
    return cause._replace(beside=beside, evidence=(*unread_names(source), *cause.evidence))


def unread_names(source: str) -> list[str]:
    """Return where names are given numbers that nothing reads: what uses them may have been forgotten."""
    tree = ast.parse(source)
    read = {x.id for x in names_with(ast.Load, tree)}
    read |= {x.attr for x in ast.walk(tree) if isinstance(x, ast.Attribute)}  # of a class, or a module
    stored = {x.id: x.lineno for x in names_with(ast.Store, tree) if x.id not in read}
    given = (name for name, _ in numbers(tree) if name in stored)
    return [f"{stored[name]}: {name} is read nowhere" for name in given][:ALTERNATIVES]


def _is_typed(number: float, source: str) -> bool:
    """Tell whether a number stands in a source."""
    constants = (x.value for x in ast.walk(ast.parse(source)) if isinstance(x, ast.Constant))
    has = [float(x) for x in constants if isinstance(x, int | float)]
    return bool(np.isclose(abs(number), has, rtol=1e-6, atol=0.0).any())


def _has_odd_coefficient(found: Repaired, source: str) -> bool:
    """Tell whether a repair brings in a number that nobody writes: 4 m lc² for m l² of a rod."""
    for change in found.changes:
        if change.kind not in ("term", "sum", "product"):
            continue
        try:
            new, old = (
                ast.parse(change.new.strip(), mode="eval"),
                ast.parse(change.old.strip() or "0", mode="eval"),
            )
        except SyntaxError:
            continue
        if (set(_constants(new)) - set(_constants(old))) & _ODD:
            return True
    return False


def _constants(tree: ast.AST) -> list[float]:
    found = (x.value for x in ast.walk(tree) if isinstance(x, ast.Constant))
    return [abs(float(x)) for x in found if isinstance(x, int | float)]


def _beside(first: list[Cause], second: list[Cause], who: str) -> list[Cause]:
    """Return the causes that one witness tells, with what the other one says beside the first."""
    other = [cause for cause in second if cause.kind not in UNNAMED]
    if not first or not other:
        return first or second
    worth = "confirmed" if all(cause.confirmed for cause in other) else "suggested"
    text = "; ".join(cause.text for cause in other[:_LISTED])
    if text == first[0].text:
        return first
    return [first[0]._replace(beside=f"{who}: {text} [{worth}]"), *first[1:]]


def _rotors(problem: Problem, sampled: Mapping[str, Sampled], differences: Sequence[Difference]) -> _Aside:
    """Set aside rotor inertia of the model, where other quantities than D differ as well.

    Where a joint slides, a wrong mass adds to the diagonal as well.
    """
    tree = problem.tree
    in_D = ~problem.agreeing & problem.quantity("D")
    if tree.armature.any() or any(tree.prismatic) or not (~problem.agreeing & ~in_D).any():
        return _Aside(problem, None)
    added = added_rotors(problem, in_D)
    if added is None:
        return _Aside(problem, None)
    behind = Problem(replace(tree, armature=added), problem.q, sampled, problem.rtol)
    elements = _explained(problem, behind)
    if not elements:
        return _Aside(problem, None)
    text = rotors_text(problem, added)
    return _Aside(behind, Cause("rotor-inertia", text, "elements", elements, structural=False))


def _rounded(problem: Problem, sampled: Mapping[str, Sampled], differences: Sequence[Difference]) -> _Aside:
    """Set aside another rounding of gravity, where it explains a part of what differs."""
    strength = float(np.linalg.norm(problem.tree.gravity))
    if (
        not (~problem.agreeing & problem.quantity("G", "V")).any()
        or min(abs(strength - x) for x in _ROUNDED) > 1e-9
    ):
        return _Aside(problem, None)
    for other in _ROUNDED:
        if abs(other - strength) < 1e-9:
            continue
        tree = replace(problem.tree, gravity=problem.tree.gravity * (other / strength))
        behind = Problem(tree, problem.q, sampled, problem.rtol)
        if elements := _explained(problem, behind):
            text = (
                f"rounded, not wrong: gravity is {other:.6g} m/s² in the model, {strength:.6g} in the robot"
            )
            cause = Cause("rounded", text, "elements", elements, other, strength, structural=False)
            return _Aside(behind, cause)
    return _Aside(problem, None)


def _neglected(problem: Problem, sampled: Mapping[str, Sampled], differences: Sequence[Difference]) -> _Aside:
    """Set aside small inertias that the model neglects, where they explain a part of what differs."""
    small = Residual(problem).negligible(_NEGLIGIBLE)
    named = {name for one in differences for name in one.missing} & small
    for names in (named, small):
        if not names:
            continue
        behind = Problem(without_inertias(problem.tree, names), problem.q, sampled, problem.rtol)
        if elements := _explained(problem, behind):
            what = ", ".join(sorted(names))
            share = f"at most {100.0 * _NEGLIGIBLE:g} % of any D[i,i]"
            text = f"neglected, not wrong: small inertias of links ({what}), {share}"
            return _Aside(behind, Cause("neglected", text, "elements", elements, structural=False))
    return _Aside(problem, None)


def _explained(problem: Problem, behind: Problem) -> tuple[Element, ...]:
    """Return the elements that agree with another arm and did not before; none where it spoils one."""
    if (problem.agreeing & ~behind.agreeing).any():
        return ()
    return problem.elements_of(behind.agreeing & ~problem.agreeing)
