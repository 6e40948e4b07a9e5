"""What is wrong with a model: hypotheses are tried, and one that brings agreement is the cause.

From the largest scope to the smallest: a mistake that explains everything that differs and spoils nothing
that agrees; then one that explains a whole term of a function; then single entries, products and joints.
Where nothing fits, no cause is named, and the evidence is shown: what the difference is as a function of
the configuration.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.errors import ModelError
from armgpi.validation import fragments, harmonics, phrasing
from armgpi.validation.hypotheses import (
    Hypothesis,
    Names,
    ParametricHypothesis,
    angle_maps,
    discrete,
    families,
)
from armgpi.validation.problem import Element, Mask, Problem
from armgpi.validation.tree import Tree, evaluate

#: Other explanations that are as good, at most so many.
ALTERNATIVES = 4
#: Pairs of mistakes are tried among those that cost no more than this.
PAIR_COST = 2.0
#: How far-fetched a wrong value among the model's own numbers is.
OWN_COST = 2.2
#: What is usually taken for gravity [m/s²], and that of the moon and of Mars; in feet and in cm.
_STRENGTHS = (9.81, 9.8, 10.0, 1.62, 3.71, 32.174, 981.0, 1.0)
#: Elements whose configuration dependence is shown, at most.
SHOWN = 6
#: Configurations at which a summand at another angle is compared: there are few functions of the
#: configuration.
_FEW = 16
#: Parts of a function that may have causes of their own.
_PARTS = ("D", "H", "B", "Z", "G", "V", "F", "J")


class Cause(NamedTuple):
    """What brings a part of the model into agreement, or the evidence where nothing does.

    Attributes:
        kind: short name of the kind of mistake; "unknown" when none was found.
        text: the mistake in words.
        scope: "model", "function" or "elements".
        elements: what it explains.
        value: the number that the model seems to have, for a mistake in one number.
        expected: what the robot has there.
        alternatives: other mistakes that explain the same.
        evidence: what was seen, in words.
        structural: whether the formulas are wrong, and not the value of a parameter.
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


class Vary(NamedTuple):
    """A model whose own numbers can be changed.

    Attributes:
        numbers: name -> value.
        columns: gives the model's columns, (rows, E), for a number's name and value: of some functions at
            some of the first configurations; NaN for the other functions.
    """

    numbers: Mapping[str, float]
    columns: Callable[[str, float, frozenset[str], int | None], Array]


class _Candidate(NamedTuple):
    """A mistake that explains what was asked."""

    cost: float
    kind: str
    text: str
    value: float | None = None
    expected: float | None = None
    structural: bool = True
    hypothesis: Hypothesis | None = None


def diagnose(problem: Problem, follows: Mapping[str, tuple[str, Mask]], vary: Vary) -> list[Cause]:
    """Return the causes of all that differs, none when nothing does.

    Args:
        problem: model and reference.
        follows: function -> the other function of the model that it agrees with where it differs from the
            reference, and those elements.
        vary: the model's own numbers.
    """
    if problem.agreeing.all():
        return []
    return _Search(problem, vary).run(follows)


class _Search:
    """The search in one problem; holds what every scope needs."""

    def __init__(self, problem: Problem, vary: Vary) -> None:
        """Try every hypothesis on every element."""
        self.problem = problem
        self.vary = vary
        self.names = Names(problem.tree)
        self.differing = ~problem.agreeing
        self.discrete = [(h, problem.explains(h)) for h in discrete(problem.tree)]
        self.maps = [(h, problem.explains(h)) for h in angle_maps(problem.tree)]
        self.families = [_Fitted(problem, family) for family in families(problem.tree)]
        self.known = phrasing.known_numbers(problem.tree)
        self._fragments: list[fragments.Fragment] = []
        self._mapped: list[tuple[Hypothesis, list[fragments.Fragment]]] = []

    def run(self, follows: Mapping[str, tuple[str, Mask]]) -> list[Cause]:
        """Return the causes, the ones with the largest scope first."""
        p, left = self.problem, self.differing.copy()
        if found := self.best(np.ones_like(left), left):
            found = self.widened(found, left)
            return [
                self.cause(
                    found, left, "model" if len({e[1:] for e in self.elements(left)}) > 1 else "elements"
                )
            ]
        consequences = []
        for name, (source, mask) in follows.items():
            mine = left & mask & p.term(name)
            if mine.any():
                text = f"follows from {source}: the two agree with each other"
                consequences.append(Cause("consequence", text, "function", self.elements(mine)))
                left &= ~mine
        scope = ~(self.differing & ~left)
        if consequences and left.any() and (found := self.best(scope, left)):
            return [self.cause(found, left, "model"), *consequences]
        causes = _joined(self.by_function(left))
        if any(cause.kind == "unknown" for cause in causes) and (found := self.pairs(scope)):
            causes = [self.cause(found, left, "model")]
        return [*causes, *consequences]

    def widened(self, found: list[_Candidate], left: Mask) -> list[_Candidate]:
        """Return also what explains the one function that differs and would spoil others that agree.

        Where a formula is wrong in one function alone, the others need not know of it.
        """
        p = self.problem
        names, pieces = set(p.terms[left].tolist()), {p.elements[k].piece for k in np.flatnonzero(left)}
        if len(names) > 1 or len(pieces) > 1:
            return found
        scope = p.term(names.pop()) & p.piece(*pieces)
        texts = {c.text for c in found}
        # With 0.5 more: what spoils nothing is named first among equals.
        more = [c._replace(cost=c.cost + 0.5) for c in self.best(scope, left) if c.text not in texts]
        return sorted([*found, *more], key=lambda c: c.cost)

    def by_function(self, left: Mask) -> Iterator[Cause]:
        """Yield causes for every term of every function alone."""
        p = self.problem
        context: Hypothesis | None = None
        for name in dict.fromkeys(p.terms.tolist()):
            for piece in _PARTS:
                mine = left & p.term(name) & p.piece(piece)
                if not mine.any():
                    continue
                scope = p.term(name) & p.piece(piece) & ~(self.differing & ~left)
                found = self.best(scope, mine, context)
                if found:
                    first = found[0].hypothesis
                    if first is not None and first.post is None and first.custom is None:
                        context = first
                    yield self.cause(found, mine, "function")
                else:
                    yield from self.singles(mine)

    def best(self, scope: Mask, differing: Mask, context: Hypothesis | None = None) -> list[_Candidate]:
        """Return the mistakes that make all elements of `scope` agree, the simplest first."""
        p = self.problem
        found = [
            _Candidate(h.cost, h.kind, h.text, hypothesis=h) for h, fits in self.discrete if fits[scope].all()
        ]
        alike = {p.elements[column][1:] for column in np.flatnonzero(differing)}
        if len(alike) == 1:
            simple = [self.factor(int(column), plain=True) for column in np.flatnonzero(differing)]
            if simple[0] is not None and all(s is not None and s.text == simple[0].text for s in simple):
                found.append(simple[0])
        if context is not None and p.explains(context)[scope].all():
            found.append(_Candidate(-1.0, context.kind, context.text, hypothesis=context))
        found += self.gravity(scope, differing)
        found += self.own_numbers(scope, differing)
        for family in self.families:
            candidate = family.candidate(scope, differing)
            if candidate is not None:
                found.append(candidate)
        if not found and context is not None:
            for h, _ in self.discrete:
                if h.custom is None:
                    both = context.and_also(h)
                    if p.explains(both)[scope].all():
                        found.append(_Candidate(both.cost, both.kind, both.text, hypothesis=both))
        factor = self.common_factor(scope)
        if factor is not None and len(alike) > 1:
            text = f"it is {factor:.6g} times what it should be, in every entry"
            text += phrasing.of_factor(factor, self.known)
            found.append(_Candidate(4.5, "factor", text, factor, 1.0))
        if len(alike) == 1 and not any(c.cost <= 2.5 for c in found):
            # One entry alone: a summand of it is a better explanation than a value that only it feels.
            columns = [int(column) for column in np.flatnonzero(differing)]
            explained = [self.explain_one(column) for column in columns]
            if explained[0] and all(e and e[0].text == explained[0][0].text for e in explained):
                found += explained[0]
        if len(alike) > 1 and not any(c.cost <= 2.5 for c in found):
            found += self.common_summands(differing)
        if not found:
            found += self.link_parameters(scope, differing)
        return sorted(found, key=lambda c: c.cost)

    def common_summands(self, differing: Mask) -> list[_Candidate]:
        """Return the summands that are wrong in the same way in every element that differs."""
        self._fragments = self._fragments or fragments.fragments(self.problem)
        found = []
        for fragment in self._fragments:
            matches = [fragments.match(self.problem, fragment, int(k)) for k in np.flatnonzero(differing)]
            one = matches[0]
            if one is None or any(m is None or abs(m.factor - one.factor) > 1e-7 for m in matches):
                continue
            reason = "" if one.plain else phrasing.of_factor(one.factor, self.known)
            named = one.plain or bool(reason)
            found.append(_Candidate(3.0 if named else 6.5, "summand", one.text + reason))
        return found

    def gravity(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return another gravity vector, by least squares, if that is all that differs."""
        p, tree = self.problem, self.problem.tree
        columns = p.piece("G", "V")
        if not differing.any() or (differing & ~columns).any():
            return []
        parts = []
        for axis in np.eye(3):
            changed = Hypothesis("", "", 0.0, tree=partial(_under, gravity=axis))
            parts.append(p.hypothesis(changed)[:, scope & columns])
        weights = 1.0 / p.tolerance[scope & columns]
        basis = np.stack([(part * weights).ravel() for part in parts], axis=-1)
        target = (p.user[:, scope & columns] * weights).ravel()
        g = np.linalg.lstsq(basis, target, rcond=1e-12)[0]
        if np.abs(basis @ g - target).max() > 1.0:
            return []
        # Compare only what these joints feel of it.
        felt = np.linalg.lstsq(basis, basis @ tree.gravity, rcond=1e-12)[0]
        strength, own = float(np.linalg.norm(g)), float(np.linalg.norm(felt))
        shown = f"({', '.join(f'{x:.6g}' for x in np.round(g, 9) + 0.0)})"
        if strength < 1e-9 * max(own, 1.0):
            return [_Candidate(0.0, "gravity-missing", "gravity is missing")]
        if own and np.abs(g + felt).max() < 1e-7 * own:
            return [_Candidate(0.0, "gravity-sign", "the sign of gravity")]
        if own and np.abs(g / strength - felt / own).max() < 1e-7:
            text = f"the strength of gravity: {strength:.6g} m/s², the robot's is {own:.6g}"
            usual = any(abs(strength / known - 1.0) < 1e-3 for known in _STRENGTHS)
            cost = 1.9 if usual else 4.5
            return [_Candidate(cost, "gravity-strength", text, strength, own, structural=False)]
        text = f"the direction of gravity: the model has {shown} m/s² along x, y, z of the base"
        return [_Candidate(2.1, "gravity-direction", text)]

    def own_numbers(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return numbers of the model for which another value makes it agree."""
        p, found = self.problem, []
        # The number must explain one function before it is tried on the others.
        first = p.terms[np.flatnonzero(differing)[0]]
        several, names = int(differing.sum()) > 1, frozenset([str(first)])
        part = differing & p.term(str(first))
        for name, value in self.vary.numbers.items():
            try:
                best = self._solve_number(name, value, part, names)
                odd = best is None or best * value < 0.0 or abs(best) < 1e-9 * abs(value)
                if best is None or (odd and not several):
                    continue
                columns = self.vary.columns(name, best, frozenset(p.terms.tolist()), None)
            except ModelError:
                continue  # a value that the model does not take
            away = np.abs(columns - p.reference[: len(columns)]).max(axis=0)
            if (away <= p.tolerance)[scope | p.agreeing].all():
                text = f"the model's {name} is {value:.6g}; with {best:.6g} it agrees"
                found.append(
                    _Candidate(
                        OWN_COST + 3.0 * odd + 2.5 * self.is_right(value),
                        "parameter",
                        text + phrasing.ratio(value / best if best else 0.0),
                        value,
                        best,
                        structural=False,
                    )
                )
        return found

    def is_right(self, value: float) -> bool:
        """Tell whether a number of the model is one of the robot's too: hardly the wrong one."""
        return any(abs(abs(value) - known) <= 1e-7 * known for known, _ in self.known if known > 0.0)

    def _solve_number(self, name: str, value: float, differing: Mask, names: frozenset[str]) -> float | None:
        """Return the value for which the differing elements agree, by the secant method."""
        p, rows = self.problem, 2
        weights = 1.0 / p.tolerance[differing]
        target = p.reference[:rows, differing]

        def rest(x: float) -> Array:
            columns = self.vary.columns(name, x, names, rows)[:, differing]
            return np.asarray(((columns - target) * weights).ravel())

        x0, x1 = value, value + 1e-4 * max(abs(value), 1e-2)
        r0 = rest(x0)
        for _ in range(14):
            r1 = rest(x1)
            slope = (r1 - r0) / (x1 - x0)
            size = float(slope @ slope)
            if size == 0.0 or not math.isfinite(size):
                return None
            step = -float(slope @ r1) / size
            # A slope that hardly points at the difference leads nowhere.
            if (
                abs(float(slope @ r1)) < 0.2 * math.sqrt(size) * float(np.linalg.norm(r1))
                and np.abs(r1).max() > 1.0
            ):
                return None
            x0, r0, x1 = x1, r1, x1 + step
            if abs(step) <= 1e-13 * max(abs(x1), 1e-6) or x1 == x0:
                break
        return x1 if np.abs(rest(x1)).max() <= 1.0 else None

    def pairs(self, scope: Mask) -> list[_Candidate]:
        """Return two mistakes that together make all of `scope` agree."""
        p, found = self.problem, []
        likely = [h for h, fits in self.discrete if h.cost <= PAIR_COST and h.custom is None]
        # One piece at few configurations rules out nearly all.
        few, piece = 3, next((x for x in ("D", "G", "H") if (scope & self.differing & p.piece(x)).any()), "")
        if not piece:
            return []
        part = scope & p.piece(piece)
        user, tolerance = p.user[:few, part], p.tolerance[part]
        for first, second in itertools.combinations(likely, 2):
            if first.post is not None and second.post is not None:
                continue
            both = first.and_also(second)
            columns = p.hypothesis(both, few, piece)[:, part]
            if (np.abs(user - columns).max(axis=0) <= tolerance).all() and p.explains(both)[scope].all():
                found.append(_Candidate(both.cost, both.kind, both.text, hypothesis=both))
        return sorted(found, key=lambda c: c.cost)

    def link_parameters(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return links whose mass, centre of mass and inertia, by least squares, make all agree."""
        p = self.problem
        inertial = p.piece("D", "H", "G", "V")
        if (differing & ~inertial).any() or (scope & inertial).sum() < 3:
            return []
        mask = scope & inertial
        weights = 1.0 / p.tolerance[mask]
        target = ((p.user - p.reference)[:, mask] * weights).ravel()
        blocks = [
            np.stack([(p.hypothesis(h)[:, mask] * weights).ravel() for h in regressor(p.tree, i)], axis=-1)
            for i in range(p.tree.n)
        ]
        limit = 100.0  # least squares over many columns loses some digits
        for count in range(1, min(p.tree.n, 3) + 1):
            for chosen in itertools.combinations(range(p.tree.n), count):
                block = np.concatenate([blocks[i] for i in chosen], axis=-1)
                sizes = np.linalg.norm(block, axis=0)
                sizes[sizes == 0.0] = 1.0
                change = np.linalg.lstsq(block / sizes, target, rcond=1e-11)[0]
                if np.abs(block / sizes @ change - target).max() <= limit:
                    links = " and ".join(self.names.link(i) for i in chosen)
                    own = _inertial_words(chosen, (change / sizes).reshape(count, 10))
                    text = f"the inertial parameters of {links}: {own}"
                    return [_Candidate(8.0 + count, "inertial-parameters", text, structural=False)]
        return []

    def singles(self, mask: Mask) -> Iterator[Cause]:
        """Yield causes for elements one by one, equal ones to be joined."""
        left = mask.copy()
        for column in np.flatnonzero(mask):
            simple = self.factor(int(column), plain=True)
            if simple is not None:
                yield self.cause([simple], _only(int(column), mask), "elements")
                left[column] = False
        while left.any():
            options = [(fits & left, h) for h, fits in [*self.discrete, *self.maps] if h.post is None]
            fits, h = min(options, key=lambda option: (-int(option[0].sum()), option[1].cost))
            if fits.sum() < 2:
                break
            yield self.cause([_Candidate(h.cost, h.kind, h.text)], fits, "elements")
            left &= ~fits
        for column in np.flatnonzero(left):
            unknown = _Candidate(99.0, "unknown", "no usual mistake explains it")
            candidates = self.explain_one(int(column)) or [unknown]
            yield self.cause(candidates, _only(int(column), mask), "elements")

    def explain_one(self, column: int) -> list[_Candidate]:
        """Return the mistakes that explain one element, the simplest first; none when none does."""
        p, element = self.problem, self.problem.elements[column]
        fitting = [h for h, fits in [*self.discrete, *self.maps] if fits[column] and h.post is None]
        angles = [h for h in fitting if h.affine is not None]
        # Half a turn is a sign, which a summand's name tells better.
        turned = [h for h in angles if "180°" not in h.text]
        if turned:
            return [_Candidate(h.cost, h.kind, h.text) for h in sorted(turned, key=lambda h: h.cost)]
        summands: list[fragments.Match] = []
        if element.piece in ("D", "H", "G", "V", "Z"):
            self._fragments = self._fragments or fragments.fragments(p)
            matches = [fragments.match(p, f, column) for f in self._fragments]
            summands = sorted((m for m in matches if m is not None), key=lambda m: not m.plain)
        if summands and summands[0].plain:
            return [_Candidate(3.0, "summand", m.text) for m in summands if m.plain]
        if fitting:
            return [_Candidate(h.cost, h.kind, h.text) for h in sorted(fitting, key=lambda h: h.cost)]
        copied = self.copied(column)
        if copied is not None:
            return [copied]
        tolerance = float(p.tolerance[column])
        mine, theirs = p.user[:, column], p.reference[:, column]
        slips = harmonics.trigonometry(p.q, mine - theirs, p.tree.prismatic, tolerance)
        if slips:
            return [_Candidate(3.5, "trigonometry", text) for text in slips]
        mapped = self.mapped_fragment(column) if self._fragments else None
        if mapped is not None:
            return [_Candidate(4.0, "summand", mapped.text)]
        if summands:
            named = [(m, phrasing.of_factor(m.factor, self.known)) for m in summands]
            named = sorted(named, key=lambda one: not one[1])
            return [_Candidate(5.0, "summand", m.text + why, m.factor, 1.0) for m, why in named]
        slip = harmonics.slip(p.q, mine, theirs, p.tree.prismatic, tolerance)
        if slip is not None:
            return [_Candidate(4.5, "term", slip)]
        factor = self.factor(column, plain=False)
        if factor is not None:
            return [factor]
        mask = _only(column, self.differing)
        fitted = [c for family in self.families if (c := family.candidate(mask, mask)) is not None]
        return sorted(fitted, key=lambda c: c.cost)

    def mapped_fragment(self, column: int) -> fragments.Match | None:
        """Return a summand of the element whose angle is wrong."""
        p = self.problem
        if not self._mapped:
            self._mapped = [(h, fragments.fragments(p, h.affine, _FEW)) for h, _ in self.maps]
        for h, moved in self._mapped:
            for plain, other in zip(self._fragments, moved, strict=True):
                found = fragments.match_mapped(p, plain, other, h, column)
                if found is not None:
                    return found
        return None

    def factor(self, column: int, plain: bool) -> _Candidate | None:
        """Return the factor by which an element is off, if it is a constant one."""
        p = self.problem
        mine, theirs = p.user[:, column], p.reference[:, column]
        tolerance = p.tolerance[column]
        element = p.elements[column]
        if np.abs(theirs).max() <= tolerance:
            if (
                element.piece == "B"
                and plain
                and np.ptp(mine) <= tolerance
                and element.place[0] == element.place[1]
            ):
                text = f"viscous friction of {mine.mean():.6g} is contained in it"
                return _Candidate(1.0, "friction", text, float(mine.mean()), 0.0)
            return (
                _Candidate(1.0, "extra", "must be zero, and is not")
                if plain and element.piece != "Z"
                else None
            )
        if np.abs(mine).max() <= tolerance:
            return _Candidate(1.0, "missing", "is missing: the model has zero there") if plain else None
        factor = float(mine @ theirs) / float(theirs @ theirs)
        if np.abs(mine - factor * theirs).max() > tolerance:
            return None
        usual = {
            -1.0: "its sign",
            0.5: "a factor 2 is missing",
            2.0: "a factor 1/2 is missing (it counts twice)",
        }
        usual |= {-0.5: "its sign, and a factor 2 is missing", -2.0: "its sign, and a factor 1/2 is missing"}
        for known, text in usual.items():
            if abs(factor - known) < 1e-7:
                kind = "sign" if known == -1.0 else "factor"
                return _Candidate(1.0, kind, text, known, 1.0)
        if plain:
            unit = phrasing.ratio(factor)
            return (
                _Candidate(1.2, "factor", f"is {factor:.6g} times what it should be{unit}") if unit else None
            )
        text = f"is {factor:.6g} times what it should be{phrasing.of_factor(factor, self.known)}"
        return _Candidate(6.0, "factor", text, factor, 1.0)

    def common_factor(self, scope: Mask) -> float | None:
        """Return the factor by which all of `scope` is off, None when there is no common one."""
        p = self.problem
        weights = 1.0 / p.tolerance[scope]
        mine, theirs = p.user[:, scope] * weights, p.reference[:, scope] * weights
        size = float((theirs * theirs).sum())
        if size == 0.0:
            return None
        factor = float((mine * theirs).sum()) / size
        fits = abs(factor) > 1e-9 and np.abs(mine - factor * theirs).max() <= 1.0
        return factor if fits else None  # nothing at all is missing, not scaled

    def copied(self, column: int) -> _Candidate | None:
        """Return another element whose value stands in place of this one's."""
        p, element = self.problem, self.problem.elements[column]
        for other, candidate in enumerate(p.elements):
            if candidate.piece == element.piece and candidate.term == element.term and other != column:
                away = np.abs(p.user[:, column] - p.reference[:, other]).max()
                if away <= p.tolerance[column] and np.abs(p.reference[:, other]).max() > p.tolerance[column]:
                    return _Candidate(2.0, "swapped", f"what belongs in {candidate.label} stands there")
        return None

    def elements(self, mask: Mask) -> tuple[Element, ...]:
        """Return the elements of a mask."""
        return tuple(self.problem.elements[column] for column in np.flatnonzero(mask))

    def cause(self, found: list[_Candidate], mask: Mask, scope: str) -> Cause:
        """Return the simplest candidate as a cause, the others of about its cost as alternatives."""
        first = found[0]
        near = [c.text for c in found[1:] if c.cost <= max(first.cost + 2.0, 6.0) and c.text != first.text]
        return Cause(
            first.kind,
            first.text,
            scope,
            self.elements(mask),
            first.value,
            first.expected,
            tuple(dict.fromkeys(near))[:ALTERNATIVES],
            tuple(self.evidence(mask)) if scope == "elements" else (),
            first.structural,
        )

    def evidence(self, mask: Mask) -> Iterator[str]:
        """Yield what elements are as functions of the configuration, the model's beside the robot's."""
        p = self.problem
        for column in np.flatnonzero(mask)[:SHOWN]:
            element = p.elements[column]
            sums = [
                harmonics.expand(p.q, values[:, column], p.tree.prismatic, float(p.tolerance[column]))
                for values in (p.user, p.reference, p.user - p.reference)
            ]
            mine, theirs, rest = ("?" if s is None else harmonics.in_words(s) for s in sums)
            if mine != "?" and theirs != "?":
                yield f"{element.label}: the model has {mine}, the robot {theirs}"
            elif rest != "?":
                yield f"{element.label}: model less robot is {rest}"
            else:
                worst = int(np.argmax(np.abs(p.user[:, column] - p.reference[:, column])))
                configuration = ", ".join(f"{x:.4g}" for x in p.q[worst])
                values = f"{p.user[worst, column]:.6g}, the robot {p.reference[worst, column]:.6g}"
                yield f"{element.label}: the model has {values} at q = ({configuration})"


class _Fitted:
    """A family of mistakes, evaluated so that it is known for every value of its number."""

    def __init__(self, problem: Problem, family: ParametricHypothesis) -> None:
        """Evaluate the family at three values, or five angles."""
        self.problem, self.family = problem, family
        if family.angle:
            nodes = np.asarray(2.0 * np.pi * np.arange(5) / 5.0)
        else:
            # Half of a mass: Pinocchio adds no negative ones.
            step: float = 0.5 * abs(family.value) if family.kind == "mass" and family.value else 1.0
            nodes = np.array([-step, 0.0, step])
        columns = np.stack([problem.hypothesis(family.member(family.value + x)) for x in nodes])
        inverse = np.linalg.inv(self._basis(nodes))
        self._coefficients = np.tensordot(inverse, columns, axes=1)  # (K, N, E)

    def _basis(self, x: Array) -> Array:
        """Return the functions that the columns are made of, at values of the number, (len(x), K)."""
        if self.family.angle:
            return np.stack([np.ones_like(x), np.cos(x), np.sin(x), np.cos(2 * x), np.sin(2 * x)], axis=-1)
        return np.stack([np.ones_like(x), x, x**2], axis=-1)

    def candidate(self, scope: Mask, differing: Mask) -> _Candidate | None:
        """Return the value that makes all of `scope` agree, None when there is none."""
        p = self.problem
        weights = 1.0 / p.tolerance[differing]
        parts = (self._coefficients[:, :, differing] * weights).reshape(len(self._coefficients), -1)
        target = (p.user[:, differing] * weights).ravel()
        if np.abs(parts[1:]).max() < 1.0:
            return None
        x = self._closest(parts, target)
        columns = p.hypothesis(self.family.member(self.family.value + x))
        if not p.fits(columns)[scope].all():
            return None
        value = self.family.value + x
        value = 0.0 if abs(value) < 1e-9 else value
        if value < 0.0 and self.family.kind in ("mass", "armature"):
            return None
        unit = self.family.unit
        if self.family.angle:
            value = (value + math.pi) % (2.0 * math.pi) - math.pi
            shown = f"{value:.6g} rad ({value * 180.0 / math.pi:.4g}°)"
        else:
            shown = f"{value:.6g} {unit}"
        text = f"{self.family.what}: {shown} in the model, {self.family.value:.6g} {unit} in the robot"
        if self.family.kind == "scale":
            text = f"{self.family.what} {value:.6g}"
        same = self._same_as(value)
        text += f" ({same})" if same else ""
        if not same and not self.family.angle and self.family.value:
            text += phrasing.ratio(value / self.family.value)
        odd = 2.0 if value * self.family.value < 0.0 or value == 0.0 else 0.0
        return _Candidate(
            self.family.cost + odd, self.family.kind, text, value, self.family.value, structural=False
        )

    def _same_as(self, value: float) -> str:
        """Return which other length of the robot a value is: l for lc, or the other way round."""
        if self.family.kind not in ("com", "length") or value == 0.0:
            return ""
        tree, names = self.problem.tree, Names(self.problem.tree)
        lengths = [(f"the length to {names.joint(i)}", p) for i, p in enumerate(tree.positions)]
        lengths += [(f"the centre of mass of {names.link(i)}", b.com) for i, b in enumerate(tree.bodies)]
        for which, vector in [*lengths, ("the length to the tool", tree.tool_position)]:
            for part in (float(np.linalg.norm(vector)), *np.abs(vector).tolist()):
                if abs(abs(value) - part) <= 1e-7 * part:
                    return f"which is {which}"
        return ""

    def _closest(self, parts: Array, target: Array) -> float:
        """Return the change of the number that brings the parts closest to a target."""
        gram, inner = parts @ parts.T, parts @ target
        if self.family.angle:
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
        for _ in range(4):  # Gauss-Newton: the polynomial's own digits do not suffice
            h = 1e-6
            row, ahead, behind = self._basis(np.array([x, x + h, x - h]))
            slope = (ahead - behind) / (2.0 * h) @ parts
            size = float(slope @ slope)
            if size == 0.0:
                break
            x += float(slope @ (target - row @ parts)) / size
        return x


def _under(tree: Tree, gravity: Array) -> Tree:
    """Return the tree under another gravity."""
    return replace(tree, gravity=gravity)


def _instead(tree: Tree, other: Tree) -> Tree:
    """Return another tree in place of one."""
    return other


def _only(column: int, like: Mask) -> Mask:
    """Return a mask of one element."""
    mask = np.zeros_like(like)
    mask[column] = True
    return mask


def regressor(tree: Tree, i: int) -> list[Hypothesis]:
    """Return arms whose pieces are the derivatives by the ten inertial parameters of body i."""
    empty = tree
    for k in range(tree.n):
        empty = empty.with_body(k, mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))
    empty = replace(empty, armature=np.zeros(tree.n))
    point = empty.with_body(i, mass=1.0)
    columns = [Hypothesis("", "", 0.0, tree=lambda t: point)]
    for axis in np.eye(3):
        # A unit point at +axis less one at -axis is twice the first moment.
        ahead, behind = (point.with_body(i, com=s * axis) for s in (1.0, -1.0))

        def moment(t: Tree, q: Array, want: object, a: Tree = ahead, b: Tree = behind) -> dict[str, Array]:
            names = list(want)  # type: ignore[call-overload]
            one, other = evaluate(a, q, names), evaluate(b, q, names)
            return {name: 0.5 * (one[name] - other[name]) for name in one}

        columns.append(Hypothesis("", "", 0.0, custom=moment))
    for r, c in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        unit = np.zeros((3, 3))
        unit[r, c] = unit[c, r] = 1.0
        body = empty.with_body(i, inertia=unit)
        columns.append(Hypothesis("", "", 0.0, tree=partial(_instead, other=body)))
    return columns


def _inertial_words(chosen: tuple[int, ...], change: Array) -> str:
    """Return changes of mass, first moments and inertias in words."""
    labels = ("m", "m cx", "m cy", "m cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    texts = []
    for i, row in zip(chosen, change, strict=True):
        size = np.abs(row).max()
        shown = [f"{label} {x:+.4g}" for label, x in zip(labels, row, strict=True) if abs(x) > 1e-6 * size]
        texts.append(f"link {i + 1} by {', '.join(shown)}")
    return "; ".join(texts) + " (least squares; only sums of them may be felt by the joints)"


def _joined(causes: Iterator[Cause]) -> list[Cause]:
    """Return causes with equal ones made one."""
    found: dict[tuple[str, str, str], Cause] = {}
    for cause in causes:
        key = (cause.kind, cause.text, cause.scope)
        if key in found:
            before = found[key]
            evidence = tuple(dict.fromkeys(before.evidence + cause.evidence))[:SHOWN]
            cause = before._replace(elements=before.elements + cause.elements, evidence=evidence)
        found[key] = cause
    return list(found.values())
