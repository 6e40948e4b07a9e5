"""What is wrong with a model, from its values: the shortest description of what differs.

Three scopes are tried, all that differs, one quantity of one function, one entry. In each, every mistake that
explains what differs there and spoils nothing that agrees is a candidate, and the one of the shortest
description is the cause. A description is as long as it takes to choose it: among the members of its kind,
the terms of the robot, the usual coefficients; a number that can be anything takes the most. An entry is
fitted with a dictionary of the robot's own terms (:mod:`armgpi.validation.terms`); the same term in all
entries that differ is one cause. What nobody would believe is not named, and shown beside the evidence.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation import harmonics, phrasing, terms
from armgpi.validation.hypotheses import (
    CONVENTIONS,
    Hypothesis,
    Names,
    Parameter,
    angle_maps,
    discrete,
    parameters,
)
from armgpi.validation.problem import Element, Mask, Problem

#: Other explanations that are as good, at most so many: who reads more?
ALTERNATIVES = 4
#: Alternatives have descriptions that are no longer than the cause's by more than this [bits].
_NEAR = 12.0
#: Length of a number that can be anything, to the six digits that are shown, and of one that means something.
_FREE, _MEANT = 20.0, 10.0
#: What is usually taken for gravity [m/s²], and that of the moon and of Mars; in feet and in cm.
_STRENGTHS = (9.81, 9.8, 10.0, 1.62, 3.71, 32.174, 981.0, 1.0)
#: Elements whose dependence on the configuration is shown, at most.
SHOWN = 6
#: Two factors are the same up to this, relative: they come from values that agree to 1e-9.
_SAME_FACTOR = 1e-7
#: What a factor of an element means, the usual ones first.
_FACTORS = {
    -1.0: "its sign",
    0.5: "a factor 2 is missing",
    2.0: "a factor 1/2 is missing (it counts twice)",
    -0.5: "its sign, and a factor 2 is missing",
    -2.0: "its sign, and a factor 1/2 is missing",
}
#: What is said where nothing explains what differs.
NOT_NAMED = "not diagnosed: no usual mistake explains it"
#: Entries of one quantity that are explained by more different causes than these are not.
_MOST_CAUSES = 2
#: Quantities of a function that may have causes of their own; D first, as C and G may follow from the same.
_QUANTITIES = ("D", "H", "B", "Z", "G", "V", "F", "J", "A")
#: Kinds of causes that say nothing of a mistake.
UNNAMED = ("unknown", "consequence")


class Cause(NamedTuple):
    """What brings a part of the model into agreement, or the evidence where nothing does.

    Attributes:
        kind: short name of the kind of mistake; "unknown" when none was found.
        text: the mistake, for the report.
        scope: "model", "function" or "elements".
        elements: what it explains.
        value: the number that the model seems to have, for a mistake in one number.
        expected: what the robot has there.
        alternatives: other mistakes that explain the same.
        evidence: what was seen, one line each.
        structural: whether the formulas are wrong, and not the value of a parameter.
        line: of the model's source, where the mistake is and a repair is proved; None without one.
        formulas: what stands in the model and what has to, each with its label, as expressions of Python.
        confirmed: whether the repaired model agrees for other numbers too, and has right units.
        beside: what the other witness says: the values beside the source, or the source beside the values.
    """

    kind: str
    text: str
    scope: str
    elements: tuple[Element, ...]
    value: float | None = None
    expected: float | None = None
    alternatives: tuple[str, ...] = ()
    evidence: tuple[str, ...] = ()
    structural: bool = True
    line: int | None = None
    formulas: tuple[tuple[str, str], ...] = ()
    confirmed: bool = False
    beside: str = ""

    @property
    def functions(self) -> list[str]:
        """The functions that it is about."""
        return list(dict.fromkeys(element.function for element in self.elements))


class _Candidate(NamedTuple):
    """A mistake that explains what was asked; of equally good ones the shortest wins."""

    bits: float
    kind: str
    text: str
    value: float | None = None
    expected: float | None = None
    structural: bool = True
    plausible: bool = True


def _best_first(found: list[_Candidate]) -> list[_Candidate]:
    return sorted(found, key=lambda c: (not c.plausible, c.bits))


def diagnose(
    problem: Problem, follows: Mapping[str, tuple[str, Mask]], conventions: bool = False
) -> list[Cause]:
    """Return the causes of all that differs, none when nothing does.

    Args:
        problem: model and reference.
        follows: function -> the other function of the model that it agrees with where it differs from the
            reference, and those elements.
        conventions: look for conventions of the whole model alone; none when there is none.
    """
    if problem.agreeing.all():
        return []
    search = _Search(problem)
    return search.conventions() if conventions else search.run(follows)


def added_rotors(problem: Problem, differing: Mask) -> Array | None:
    """Return rotor inertias of several joints that a model has in addition; see :func:`added_diagonal`.

    None where it is at one joint alone, which may as well have another mistake in its constant.
    """
    added = added_diagonal(problem, differing)
    return added if added is not None and np.count_nonzero(added) >= 2 else None


def added_diagonal(problem: Problem, differing: Mask) -> Array | None:
    """Return what a model has on the diagonal of D in addition [kg m² or kg], shape (n,).

    None where what differs is more than that, varies, or is negative somewhere.

    Args:
        problem: model and reference.
        differing: the elements that are looked at.
    """
    added = np.zeros(problem.tree.n)
    for column in np.flatnonzero(differing):
        _, quantity, place = problem.elements[column]
        rest = problem.user[:, column] - problem.reference[:, column]
        if quantity != "D" or place[0] != place[1] or rest.min() <= 0.0:
            return None
        if np.ptp(rest) > 2.0 * problem.tolerance[column]:
            return None
        added[place[0]] = rest.mean()
    return added


def rotors_text(problem: Problem, added: Array) -> str:
    """Return what is said of rotor inertia that a model has in addition, with the option for it."""
    rotors = zip(problem.tree.joint_names, problem.tree.armature + added, strict=True)
    values = ",".join(f"{name}={x:.6g}" for name, x in rotors if x)
    joints = np.flatnonzero(added)
    larger = "D is larger than the robot's by a constant diagonal"
    if len(joints) == 1:
        larger = f"D[{joints[0] + 1},{joints[0] + 1}] is larger than the robot's by a constant"
    causes = "rotor inertia, or another wrong constant on the diagonal"
    return f"{causes}: {larger}; compare with --rotor-inertia {values}"


class _Search:
    """The search in one problem; holds what every scope needs."""

    def __init__(self, problem: Problem) -> None:
        """Try every hypothesis on every element."""
        self.problem = problem
        self.names = Names(problem.tree)
        self.differing = ~problem.agreeing
        hypotheses = discrete(problem.tree)
        kinds = Counter(h.kind for h in hypotheses)
        self.discrete = [(h, problem.explains(h), math.log2(kinds[h.kind])) for h in hypotheses]

    @cached_property
    def summands(self) -> list[terms.Term]:
        """The robot's own terms."""
        return list(terms.split(self.problem))

    @cached_property
    def maps(self) -> list[tuple[Hypothesis, Mask, float]]:
        """Mistakes in the angles of a single entry."""
        maps = angle_maps(self.problem.tree)
        return [(h, self.problem.explains(h), math.log2(len(maps))) for h in maps]

    @cached_property
    def fits(self) -> list[_Fitted]:
        """The robot's numbers, as functions of which the quantities are known."""
        return [_Fitted(self.problem, one) for one in parameters(self.problem.tree)]

    def conventions(self) -> list[Cause]:
        """Return the convention of the whole model, or the gravity, that explains all; none without such."""
        found = [
            _Candidate(bits, h.kind, h.text)
            for h, fits, bits in self.discrete
            if h.kind in CONVENTIONS and fits.all()
        ]
        triangles = list(self.triangles())
        found += [*self.rotors(), *self.friction(), *triangles]
        # With a level first axis every joint's other sign is gravity's other sign, which is more likely.
        found += self.gravity(np.ones_like(self.differing), self.differing)
        if not triangles and len({e[1:] for e in self.problem.elements_of(self.differing)}) < 2:
            return []  # one entry alone is wrong
        return [self.cause(_best_first(found), self.differing, "model")] if found else []

    def rotors(self) -> Iterator[_Candidate]:
        """Yield rotor inertias that the model has in addition: a constant diagonal that is not negative."""
        added = added_rotors(self.problem, self.differing)
        if added is not None:
            yield _Candidate(-1.0, "rotor-inertia", rotors_text(self.problem, added), structural=False)

    def friction(self) -> Iterator[_Candidate]:
        """Yield viscous friction that the model has in addition: linear in each joint's own velocity."""
        p = self.problem
        damping: dict[str, float] = {}
        for column in np.flatnonzero(self.differing):
            _, quantity, place = p.elements[column]
            mine = p.user[:, column]
            if quantity != "B" or place[0] != place[1] or mine.min() <= 0.0:
                return
            if np.ptp(mine) > 2.0 * p.tolerance[column]:
                return
            damping[p.tree.joint_names[place[0]]] = float(mine.mean())
        if not damping:
            return
        values = ",".join(f"{name}={x:.6g}" for name, x in damping.items())
        of_dynamics = all(e.function.endswith("dynamics") for e in p.elements_of(self.differing))
        do = (
            f"compare with --viscous-friction {values}"
            if of_dynamics
            else "leave it out of the Coriolis torque"
        )
        text = f"viscous friction: the torque has a part that is linear in v ({values}); {do}"
        yield _Candidate(-1.0, "friction", text, structural=False)

    def triangles(self) -> Iterator[_Candidate]:
        """Yield that one triangle of D is filled alone."""
        p = self.problem
        for which, below in (("upper", True), ("lower", False)):
            empty = [k for k, e in enumerate(p.elements) if _is_in_triangle(e, below)]
            wrong = np.flatnonzero(self.differing).tolist()
            if wrong and {*wrong} <= {*empty} and not np.abs(p.user[:, empty]).max():
                zeros = ", ".join(p.elements[k].label for k in wrong[:SHOWN])
                text = f"only the {which} triangle of D is filled, not {zeros}"
                text += ": mirror it, D = D + D' - diag(D)"
                yield _Candidate(0.0, "triangle", text)

    def run(self, follows: Mapping[str, tuple[str, Mask]]) -> list[Cause]:
        """Return the causes, the ones with the largest scope first."""
        p, left = self.problem, self.differing.copy()
        if found := self.best(np.ones_like(left), left):
            places = {e[1:] for e in self.problem.elements_of(left)}
            return [self.cause(found, left, "model" if len(places) > 1 else "elements")]
        consequences = []
        for name, (source, mask) in follows.items():
            mine = left & mask & p.of_function(name)
            if mine.any():
                text = f"follows from {source}: the two agree with each other"
                consequences.append(Cause("consequence", text, "function", self.problem.elements_of(mine)))
                left &= ~mine
        scope = ~(self.differing & ~left)
        if consequences and left.any() and (found := self.best(scope, left)):
            return [self.cause(found, left, "model"), *consequences]
        return [*join_equal(self.by_function(left)), *consequences]

    def by_function(self, left: Mask) -> Iterator[Cause]:
        """Yield causes for every quantity of every function alone."""
        p = self.problem
        for name, quantity in itertools.product(dict.fromkeys(p.functions.tolist()), _QUANTITIES):
            part = p.of_function(name) & p.quantity(quantity)
            mine = left & part
            if not mine.any():
                continue
            if found := self.best(part & ~(self.differing & ~left), mine):
                yield self.cause(found, mine, "function")
                continue
            causes = join_equal(
                self.cause(_best_first(self.entry(int(k))), np.arange(len(mine)) == k, "elements")
                for k in np.flatnonzero(mine)
            )
            if len(causes) > _MOST_CAUSES:  # a different cause for every entry is none
                told = tuple(c.text for c in causes if c.kind != "unknown")
                causes = [self.cause([], mine, "elements")._replace(alternatives=told[:ALTERNATIVES])]
            yield from causes

    def best(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return the mistakes that make all elements of `scope` agree, the shortest first."""
        p = self.problem
        columns = np.flatnonzero(differing).tolist()
        elements = self.problem.elements_of(differing)
        found = self.of_arm(scope, differing)
        if len({(e.function, e.quantity) for e in elements}) == 1:
            # Where a formula is wrong in one function alone, the others need not know of it.
            alone = scope & p.of_function(elements[0].function) & p.quantity(elements[0].quantity)
            found += [c._replace(bits=c.bits + 1.0) for c in self.of_formula(alone, differing)]
        found += self.gravity(scope, differing)
        # The same element of several functions counts once: D of mass_matrix and of kinetic_energy.
        if len({e[1:] for e in elements}) == 1:
            found += self.common_entries(columns)
        else:
            found += [*self.common_factor(scope), *self.common_terms(columns)]
        return _best_first(found)

    def of_arm(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return the mistakes in the arm, or in how quantities are formed, that make a scope agree."""
        found = [_Candidate(bits, h.kind, h.text) for h, fits, bits in self.discrete if fits[scope].all()]
        return found + self.wrong_values(scope, differing)

    def of_formula(self, alone: Mask, differing: Mask) -> list[_Candidate]:
        """Return the mistakes that make one quantity of one function agree.

        Where that function has other quantities that agree, or another function has the quantity right, it
        is no mistake in the arm: those would show it too.
        """
        p = self.problem
        of_function = p.of_function(p.elements_of(alone)[0].function)
        of_quantity = p.quantity(p.elements_of(alone)[0].quantity)
        if not ((of_function | of_quantity) & ~alone & ~self.differing).any():
            return self.of_arm(alone, differing)
        return [
            _Candidate(bits, h.kind, h.text)
            for h, fits, bits in self.discrete
            if h.post is not None and fits[alone].all()
        ]

    def common_entries(self, columns: list[int]) -> list[_Candidate]:
        """Return the mistakes that explain each of several elements."""
        entries = [self.entry(column) for column in columns]
        texts = set.intersection(*({c.text for c in entry} for entry in entries))
        return [c for c in entries[0] if c.text in texts]

    def wrong_values(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return the numbers of the robot of which another value makes all of `scope` agree."""
        found = [one.candidate(scope, differing) for one in self.fits]
        return [c._replace(bits=c.bits + math.log2(len(self.fits))) for c in found if c is not None]

    def common_terms(self, columns: list[int]) -> list[_Candidate]:
        """Return the terms that are wrong in the same way in every element that differs."""
        if any(self.problem.elements[k].quantity == "A" for k in columns):
            return []
        fits = [{one.text: one for one in terms.fits(self.problem, self.summands, k)} for k in columns]
        texts = [text for text in fits[0] if all(text in other for other in fits)]
        return [self.of_fit(fits[0][text]) for text in texts]

    def of_fit(self, fit: terms.Fit) -> _Candidate:
        """Return a fit of terms as a candidate."""
        reason = "" if fit.usual else phrasing.ratio(1.0 + fit.share)
        bits = fit.bits + (0.0 if fit.usual else _MEANT if reason else _FREE)
        return _Candidate(bits, "term", fit.text + reason, plausible=fit.usual or bool(reason))

    def gravity(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return another gravity vector, by least squares, if that is all that differs."""
        p, tree = self.problem, self.problem.tree
        columns = p.quantity("G", "V")
        if not differing.any() or (differing & ~columns).any():
            return []
        weights = 1.0 / p.tolerance[scope & columns]
        units = [Hypothesis("", "", tree=partial(replace, gravity=axis)) for axis in np.eye(3)]
        parts = [p.hypothesis(under)[:, scope & columns] * weights for under in units]
        basis = np.stack([part.ravel() for part in parts], axis=-1)
        target = (p.user[:, scope & columns] * weights).ravel()
        g = np.linalg.lstsq(basis, target, rcond=1e-12)[0]
        if np.abs(basis @ g - target).max() > 1.0:  # in units of the tolerance
            return []
        # Compare only what these joints feel of it: a vertical axis feels no vertical gravity.
        felt = np.linalg.lstsq(basis, basis @ tree.gravity, rcond=1e-12)[0]
        return [_other_gravity(np.asarray(g), np.asarray(felt))]

    def entry(self, column: int) -> list[_Candidate]:
        """Return the mistakes that explain one element; none when none does."""
        p = self.problem
        # What is wrong with an arm hardly shows in one entry alone, and a wrong formula not at all.
        rare = math.log2(len(self.discrete))
        found = [
            _Candidate(rare, h.kind, h.text)
            for h, fits, _ in self.discrete
            if fits[column] and h.post is None
        ]
        if p.elements[column].quantity == "A":  # no sum of the robot's terms
            return found
        found += [_Candidate(bits, h.kind, h.text) for h, fits, bits in self.maps if fits[column]]
        found += [self.of_fit(fit) for fit in terms.fits(p, self.summands, column)]
        found += [*self.factor(column), *self.copies(column), *self.slips(column)]
        return found

    def factor(self, column: int) -> Iterator[_Candidate]:
        """Yield the constant factor by which an element is off, or what is zero in one of the two."""
        p = self.problem
        mine, theirs, tolerance = p.user[:, column], p.reference[:, column], p.tolerance[column]
        if np.abs(theirs).max() <= tolerance:
            yield from self.extra(column)
            return
        if np.abs(mine).max() <= tolerance:
            yield _Candidate(0.0, "missing", "is missing: the model has zero there")
            return
        factor = float(mine @ theirs) / float(theirs @ theirs)
        if np.abs(mine - factor * theirs).max() > tolerance:
            return
        for rank, (known, text) in enumerate(_FACTORS.items()):
            if abs(factor - known) < _SAME_FACTOR:
                kind = "sign" if known == -1.0 else "factor"
                yield _Candidate(math.log2(rank + 1.0), kind, text, known, 1.0)
                return
        yield self.by_factor(factor, f"is {factor:.6g} times what it should be")

    def by_factor(self, factor: float, text: str) -> _Candidate:
        """Return a factor as a candidate: a unit, or any number."""
        reason = phrasing.ratio(factor)
        bits = _MEANT / 2.0 if reason else _FREE
        return _Candidate(bits, "factor", text + reason, factor, 1.0, plausible=bool(reason))

    def extra(self, column: int) -> Iterator[_Candidate]:
        """Yield what an element is that must be zero."""
        p, element = self.problem, self.problem.elements[column]
        mine = p.user[:, column]
        diagonal = element.quantity == "B" and element.place[0] == element.place[1]
        if diagonal and np.ptp(mine) <= p.tolerance[column]:
            text = f"viscous friction of {mine.mean():.6g} is contained in it"
            yield _Candidate(1.0, "friction", text, float(mine.mean()), 0.0)
        elif element.quantity != "Z":  # a torque at rest is gravity, or a part of it
            yield _Candidate(1.0, "extra", "must be zero, and is not")

    def common_factor(self, scope: Mask) -> list[_Candidate]:
        """Return the factor by which all of `scope` is off."""
        p = self.problem
        weights = 1.0 / p.tolerance[scope]
        mine, theirs = p.user[:, scope] * weights, p.reference[:, scope] * weights
        size = float((theirs * theirs).sum())
        factor = float((mine * theirs).sum()) / size if size else 0.0
        # Where nothing at all is there, it is missing, not scaled.
        if abs(factor) <= 1e-9 or np.abs(mine - factor * theirs).max() > 1.0:
            return []
        return [self.by_factor(factor, f"it is {factor:.6g} times what it should be, in every entry")]

    def copies(self, column: int) -> Iterator[_Candidate]:
        """Yield another element whose value stands in place of this one's."""
        p, element, tolerance = self.problem, self.problem.elements[column], self.problem.tolerance[column]
        same = [k for k, e in enumerate(p.elements) if e[:2] == element[:2] and k != column]
        for k in same:
            away = np.abs(p.user[:, column] - p.reference[:, k]).max()
            if away <= tolerance and np.abs(p.reference[:, k]).max() > tolerance:
                text = f"it has the value of {p.elements[k].label}"
                yield _Candidate(math.log2(len(same)), "swapped", text)
                return

    def slips(self, column: int) -> list[_Candidate]:
        """Return the slips of trigonometry that explain one element, or the one wrong term of its sum."""
        p = self.problem
        mine, theirs = p.user[:, column], p.reference[:, column]
        given = (p.tree.prismatic, float(p.tolerance[column]))
        told = harmonics.trigonometry(p.q, mine - theirs, *given)
        if not told and (text := harmonics.slip(p.q, mine, theirs, *given)) is not None:
            # Two coefficients beside each other are evidence and no name.
            return [_Candidate(_FREE, "term", text, plausible=not text.endswith(tuple("0123456789")))]
        return [_Candidate(_MEANT, "trigonometry", text) for text in told]

    def cause(self, found: list[_Candidate], mask: Mask, scope: str) -> Cause:
        """Return the first candidate as a cause, the others of about its length as alternatives."""
        named = bool(found) and found[0].plausible
        structural = found[0].structural if found else True
        first = found[0] if named else _Candidate(0.0, "unknown", NOT_NAMED, structural=structural)
        # A reader who sees at once that the first is not it wants to see the others.
        near = [c.text for c in found if not named or c.bits <= max(first.bits, _FREE) + _NEAR]
        other = tuple(text for text in dict.fromkeys(near) if text != first.text)
        evidence, formulas = self.evidence(mask) if scope == "elements" or not named else ((), ())
        return Cause(
            first.kind,
            first.text,
            scope,
            self.problem.elements_of(mask),
            first.value,
            first.expected,
            other[:ALTERNATIVES],
            evidence,
            first.structural,
            formulas=formulas,
        )

    def evidence(self, mask: Mask) -> tuple[tuple[str, ...], tuple[tuple[str, str], ...]]:
        """Return what elements are as functions of the configuration, as lines and as formulas."""
        p = self.problem
        lines: list[str] = []
        formulas: list[tuple[str, str]] = []
        for column in np.flatnonzero(mask)[:SHOWN]:
            label = p.elements[column].label
            sums = [
                harmonics.expand(p.q, values[:, column], p.tree.prismatic, float(p.tolerance[column]))
                for values in (p.user, p.reference, p.user - p.reference)
            ]
            mine, theirs, rest = ("?" if s is None else harmonics.formula(s) for s in sums)
            told = (
                {"model": mine, "robot": theirs} if "?" not in (mine, theirs) else {"model less robot": rest}
            )
            if "robot" in told:
                lines.append(f"{label}: the model has {mine}, the robot {theirs}")
            elif rest != "?":
                lines.append(f"{label}: model less robot is {rest}")
            else:
                worst = int(np.argmax(np.abs(p.user[:, column] - p.reference[:, column])))
                configuration = ", ".join(f"{x:.4g}" for x in p.q[worst])
                values = f"{p.user[worst, column]:.6g}, the robot {p.reference[worst, column]:.6g}"
                lines.append(f"{label}: the model has {values} at q = ({configuration})")
                continue
            formulas += [(f"{label}, {whose}", harmonics.code(text)) for whose, text in told.items()]
        return tuple(lines), tuple(formulas)


def _is_in_triangle(element: Element, below: bool) -> bool:
    """Tell whether an element is an entry of D below the diagonal, or above it."""
    if element.quantity != "D" or element.place[0] == element.place[1]:
        return False
    return (element.place[0] > element.place[1]) == below


def _other_gravity(g: Array, felt: Array) -> _Candidate:
    """Return a gravity as a candidate, beside what is felt of the robot's."""
    strength, own = float(np.linalg.norm(g)), float(np.linalg.norm(felt))
    if strength < 1e-9 * max(own, 1.0):
        return _Candidate(0.0, "gravity", "gravity is missing")
    if own and np.abs(g + felt).max() < 1e-7 * own:
        return _Candidate(0.0, "gravity", "the sign of gravity")
    if own and np.abs(g / strength - felt / own).max() < 1e-7:
        text = f"the strength of gravity: {strength:.6g} m/s², the robot's is {own:.6g}"
        usual = any(abs(strength / known - 1.0) < 1e-3 for known in _STRENGTHS)
        bits = math.log2(len(_STRENGTHS)) if usual else _FREE
        return _Candidate(bits, "gravity", text, strength, own, False, usual)
    shown = ", ".join(f"{x:.6g}" for x in np.round(g, 9) + 0.0)
    text = f"the direction of gravity: the model has ({shown}) m/s² along x, y, z of the base"
    along = np.count_nonzero(np.abs(g) > 1e-7 * strength) == 1
    return _Candidate(3.0 if along else _FREE, "gravity", text)


class _Fitted:
    """A parameter, evaluated so that the quantities are known for every value of it."""

    def __init__(self, problem: Problem, parameter: Parameter) -> None:
        """Evaluate it at three values, or five angles: as many as its polynomial has coefficients."""
        self.problem, self.parameter = problem, parameter
        value = parameter.value
        if parameter.angle:
            # 1, cos, sin, cos 2, sin 2: equidistant angles make the best conditioned system.
            nodes = np.asarray(2.0 * np.pi * np.arange(5) / 5.0)
        else:
            # Half of a mass: Pinocchio adds no negative ones.
            step: float = 0.5 * abs(value) if parameter.kind == "mass" and value else 1.0
            nodes = np.array([-step, 0.0, step])
        columns = np.stack([problem.hypothesis(parameter.instance(value + x)) for x in nodes])
        inverse = np.linalg.inv(self._basis(nodes))
        self._coefficients = np.tensordot(inverse, columns, axes=1)  # (K, N, E)

    def _basis(self, x: Array) -> Array:
        """Return the functions that the columns are made of, at values of the number, (len(x), K)."""
        if self.parameter.angle:
            return np.stack([np.ones_like(x), np.cos(x), np.sin(x), np.cos(2 * x), np.sin(2 * x)], axis=-1)
        return np.stack([np.ones_like(x), x, x**2], axis=-1)

    def candidate(self, scope: Mask, differing: Mask) -> _Candidate | None:
        """Return the value that makes all of `scope` agree, None when there is none.

        An angle is returned within [-pi, pi).

        Args:
            scope: elements that have to agree with it.
            differing: elements that the value is fitted to, each weighted by its tolerance.
        """
        p, h = self.problem, self.parameter
        weights = 1.0 / p.tolerance[differing]
        parts = (self._coefficients[:, :, differing] * weights).reshape(len(self._coefficients), -1)
        target = (p.user[:, differing] * weights).ravel()
        # An arm without that mass may have no inertia at all, and no accelerations.
        if not np.isfinite(parts).all() or np.abs(parts[1:]).max() < 1.0:
            return None  # what differs does not depend on it
        value = h.value + self._closest(parts, target)
        # The fit knows only what differs; the hypothesis itself must not spoil what agrees.
        if not p.fits(p.hypothesis(h.instance(value)))[scope].all():
            return None
        value = 0.0 if abs(value) < 1e-9 else value
        if h.angle:
            value = (value + math.pi) % (2.0 * math.pi) - math.pi
        text, meant = self._text(value)
        # A number that the robot does not have is rarely what a model has too much, but for a zero.
        new = h.value == 0.0 and h.kind != "offset"
        real = {"mass": value >= 0.0, "armature": value >= 0.0, "inertia": value > 0.0, "scale": meant}.get(
            h.kind, True
        )
        bits = (_MEANT if meant else _FREE) + (1.0 if new else 0.0)
        return _Candidate(bits, h.kind, text, value, h.value, structural=False, plausible=real)

    def _text(self, value: float) -> tuple[str, bool]:
        """Return what a value is, and whether it means something."""
        h = self.parameter
        if h.kind == "scale":
            text = f"{h.what} {value:.6g}"
        else:
            degrees = f"rad ({value * 180.0 / math.pi:.4g}°)" if h.angle else h.unit
            text = f"{h.what}: {value:.6g} {degrees} in the model, {h.value:.6g} {h.unit} in the robot"
        lengths = phrasing.lengths(self.problem.tree) if h.kind in ("com", "length") and value else []
        near = (which for part, which in lengths if abs(abs(value) - part) <= 1e-7 * part)
        meaning = next((f" (which is {which})" for which in near), "")  # l for lc, or the other way round
        if not meaning and h.value and not h.angle:
            meaning = phrasing.ratio(value / h.value)
        if h.kind == "armature" and value > 0.0:
            return f"{text}; --rotor-inertia compares with it", bool(meaning)
        return text + meaning, bool(meaning)

    def _closest(self, parts: Array, target: Array) -> float:
        """Return the change of the number that brings the parts closest to a target."""
        gram, inner = parts @ parts.T, parts @ target
        if self.parameter.angle:
            # Degree four in cos and sin: at most eight extrema, so half a degree finds the deepest.
            grid = np.linspace(-np.pi, np.pi, 721)
        else:
            # The squared distance is a polynomial of degree four: its extrema are roots of a cubic.
            quartic = np.array(
                [
                    gram[2, 2],
                    2.0 * gram[1, 2],
                    2.0 * gram[0, 2] + gram[1, 1] - 2.0 * inner[2],
                    2.0 * (gram[0, 1] - inner[1]),
                ]
            )
            derivative = quartic * np.array([4.0, 3.0, 2.0, 1.0])
            roots = np.roots(np.trim_zeros(derivative, "f")) if derivative.any() else np.zeros(1)
            grid = np.append(roots.real, 0.0)
        rows = self._basis(grid)
        x = float(grid[np.argmin(np.einsum("ki,ij,kj->k", rows, gram, rows) - 2.0 * rows @ inner)])
        # Gauss-Newton: the roots of the cubic have half the digits, and the grid has half a degree.
        for _ in range(4):
            h = 1e-6
            row, ahead, behind = self._basis(np.array([x, x + h, x - h]))
            slope = (ahead - behind) / (2.0 * h) @ parts
            size = float(slope @ slope)
            if size == 0.0:
                break
            x += float(slope @ (target - row @ parts)) / size
        return x


def join_equal(causes: Iterable[Cause]) -> list[Cause]:
    """Return causes with equal ones made one."""
    found: dict[tuple[str, str, str], Cause] = {}
    for cause in causes:
        key = (cause.kind, cause.text, cause.scope)
        if key in found:
            before = found[key]
            cause = before._replace(
                elements=before.elements + cause.elements,
                alternatives=tuple(dict.fromkeys(before.alternatives + cause.alternatives))[:ALTERNATIVES],
                evidence=tuple(dict.fromkeys(before.evidence + cause.evidence))[:SHOWN],
                formulas=(before.formulas + cause.formulas)[: 2 * SHOWN],
            )
        found[key] = cause
    return list(found.values())
