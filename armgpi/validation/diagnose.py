"""What is wrong with a model: hypotheses are tried, and one that brings agreement is the cause.

From the largest scope to the smallest: a mistake that explains everything that differs and spoils nothing
that agrees; then one that explains a whole term of a function; then single entries, products and joints.
Where nothing fits, no cause is named, and the evidence is shown: what the difference is as a function of
the configuration.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.errors import ModelError
from armgpi.validation import harmonics, phrasing, terms
from armgpi.validation.hypotheses import (
    MOMENTS,
    Hypothesis,
    Names,
    ParametricHypothesis,
    angle_maps,
    discrete,
    parametric_hypotheses,
)
from armgpi.validation.problem import Element, Mask, Problem
from armgpi.validation.tree import Tree, evaluate

#: Other explanations that are as good, at most so many: who reads more?
ALTERNATIVES = 4
#: Pairs of mistakes are tried among those of no greater penalty: a hundred or so make thousands of pairs.
PAIR_PENALTY = 2.0
#: Penalty of a wrong value among the model's own numbers: below that of a number of the robot, as the name of
#: the number tells where to look, and above that of a slip in a formula.
OWN_PENALTY = 2.2
#: Where nothing up to this penalty fits, terms of single entries are looked at.
_SLIP_PENALTY = 2.5
#: What is usually taken for gravity [m/s²], and that of the moon and of Mars; in feet and in cm.
_STRENGTHS = (9.81, 9.8, 10.0, 1.62, 3.71, 32.174, 981.0, 1.0)
#: Elements whose dependence on the configuration is shown, at most.
SHOWN = 6
#: Configurations at which a term at another angle is compared: hundreds of them are tried, and few functions
#: of the configuration agree at so many.
_FEW = 16
#: Two factors are the same up to this, relative: they come from values that agree to 1e-9.
_SAME_FACTOR = 1e-7
#: What a factor of an element means.
_FACTORS = {
    -1.0: "its sign",
    0.5: "a factor 2 is missing",
    2.0: "a factor 1/2 is missing (it counts twice)",
    -0.5: "its sign, and a factor 2 is missing",
    -2.0: "its sign, and a factor 1/2 is missing",
}
#: What is said where nothing explains what differs.
NOT_NAMED = "not named: no usual mistake explains it"
#: Quantities of a function that may have causes of their own; D first, as C and G may follow from the same.
_QUANTITIES = ("D", "H", "B", "Z", "G", "V", "F", "J")


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


#: Kinds of causes that say nothing of a mistake.
UNNAMED = ("unknown", "consequence")
#: More values than these are not changed by one mistake.
_MOST_VALUES = 4


def plausible(cause: Cause, sourced: bool) -> Cause:
    """Return a cause; one that nobody would believe is not named, and becomes an alternative.

    Args:
        cause: what explains the values.
        sourced: whether the model's source was searched and nothing in it explains them: then only a
            convention of the whole model does.
    """
    if cause.kind in UNNAMED:
        return cause
    odd = cause.kind == "gravity-strength" and not _is_usual(cause.value)
    odd |= cause.kind in ("inertia", "mass", "armature") and cause.value is not None and cause.value <= 0.0
    odd |= cause.kind == "tilt" or (
        cause.kind == "inertial-parameters" and cause.text.count(" +") + cause.text.count(" -") > _MOST_VALUES
    )
    odd |= sourced and (cause.scope != "model" or not cause.structural)
    if not odd:
        return cause
    alternatives = (cause.text, *cause.alternatives)[:ALTERNATIVES]
    return cause._replace(kind="unknown", text=NOT_NAMED, alternatives=alternatives)


def _is_usual(gravity: float | None) -> bool:
    """Tell whether a strength is one that is taken for gravity [m/s²]."""
    return gravity is None or any(abs(gravity / known - 1.0) < 1e-3 for known in _STRENGTHS)


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
    """A mistake that explains what was asked; of equally good ones the least penalty wins."""

    penalty: float
    kind: str
    text: str
    value: float | None = None
    expected: float | None = None
    structural: bool = True
    hypothesis: Hypothesis | None = None  # where it may be the context of other mistakes


def _by_penalty(hypotheses: Iterable[Hypothesis]) -> list[_Candidate]:
    """Return hypotheses about one element as candidates, the simplest first."""
    return [_Candidate(h.penalty, h.kind, h.text) for h in sorted(hypotheses, key=lambda h: h.penalty)]


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
        self.fitted = [_Fitted(problem, one) for one in parametric_hypotheses(problem.tree)]
        self.known = phrasing.known_numbers(problem.tree)
        self._terms: list[terms.Term] = []
        self._mapped: list[tuple[Hypothesis, list[terms.Term]]] = []

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
            mine = left & mask & p.of_function(name)
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
        names, quantities = (
            set(p.functions[left].tolist()),
            {p.elements[k].quantity for k in np.flatnonzero(left)},
        )
        if len(names) > 1 or len(quantities) > 1:
            return found
        scope = p.of_function(names.pop()) & p.quantity(*quantities)
        texts = {c.text for c in found}
        # With 0.5 more: what spoils nothing is named first among equals.
        more = [c._replace(penalty=c.penalty + 0.5) for c in self.best(scope, left) if c.text not in texts]
        return sorted([*found, *more], key=lambda c: c.penalty)

    def by_function(self, left: Mask) -> Iterator[Cause]:
        """Yield causes for every term of every function alone."""
        p = self.problem
        context: Hypothesis | None = None
        for name in dict.fromkeys(p.functions.tolist()):
            for quantity in _QUANTITIES:
                mine = left & p.of_function(name) & p.quantity(quantity)
                if not mine.any():
                    continue
                scope = p.of_function(name) & p.quantity(quantity) & ~(self.differing & ~left)
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
        found = [_whole(h) for h, fits in self.discrete if fits[scope].all()]
        columns = [int(column) for column in np.flatnonzero(differing)]
        # The same element of several functions counts once: D of mass_matrix and of kinetic_energy.
        single = len({self.problem.elements[column][1:] for column in columns}) == 1
        if single:
            simple = [self.factor(column, plain=True) for column in columns]
            if simple[0] is not None and all(s is not None and s.text == simple[0].text for s in simple):
                found.append(simple[0])
        if context is not None and self.problem.explains(context)[scope].all():
            found.append(_whole(context)._replace(penalty=-1.0))  # it is there already
        found += self.gravity(scope, differing)
        found += self.own_numbers(scope, differing)
        found += self.wrong_values(scope, differing)
        if not found and context is not None:
            found += self.beside(context, scope)
        if not single:
            found += self.common_factor(scope)
        if not any(c.penalty <= _SLIP_PENALTY for c in found):
            # A term of one entry is a better explanation than a value that only this entry feels.
            found += self.explain_alike(columns) if single else self.common_terms(differing)
        return sorted(found or self.link_parameters(scope, differing), key=lambda c: c.penalty)

    def wrong_values(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return the numbers of the robot of which another value makes all of `scope` agree."""
        return [c for one in self.fitted if (c := one.candidate(scope, differing)) is not None]

    def beside(self, context: Hypothesis, scope: Mask) -> list[_Candidate]:
        """Return the mistakes that make all of `scope` agree together with one that is known already."""
        pairs = (context.and_also(h) for h, _ in self.discrete if h.custom is None)
        return [_whole(both) for both in pairs if self.problem.explains(both)[scope].all()]

    def explain_alike(self, columns: list[int]) -> list[_Candidate]:
        """Return what explains one element in every function that has it; none when they differ."""
        explained = [self.explain_one(column) for column in columns]
        same = explained[0] and all(e and e[0].text == explained[0][0].text for e in explained)
        return explained[0] if same else []

    def common_terms(self, differing: Mask) -> list[_Candidate]:
        """Return the terms that are wrong in the same way in every element that differs."""
        self._terms = self._terms or terms.split(self.problem)
        found = []
        for term in self._terms:
            matches = [terms.match(self.problem, term, int(k)) for k in np.flatnonzero(differing)]
            one = matches[0]
            if one is None or any(m is None or abs(m.factor - one.factor) > _SAME_FACTOR for m in matches):
                continue
            reason = "" if one.plain else phrasing.of_factor(one.factor, self.known)
            named = one.plain or bool(reason)
            found.append(_Candidate(3.0 if named else 6.5, "term", one.text + reason))
        return found

    def gravity(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return another gravity vector, by least squares, if that is all that differs."""
        p, tree = self.problem, self.problem.tree
        columns = p.quantity("G", "V")
        if not differing.any() or (differing & ~columns).any():
            return []
        parts = []
        for axis in np.eye(3):
            under = Hypothesis("", "", 0.0, tree=partial(_under, gravity=axis))
            parts.append(p.hypothesis(under)[:, scope & columns])
        weights = 1.0 / p.tolerance[scope & columns]
        basis = np.stack([(part * weights).ravel() for part in parts], axis=-1)
        target = (p.user[:, scope & columns] * weights).ravel()
        g = np.linalg.lstsq(basis, target, rcond=1e-12)[0]
        if np.abs(basis @ g - target).max() > 1.0:  # in units of the tolerance
            return []
        # Compare only what these joints feel of it: a vertical axis feels no vertical gravity.
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
            penalty = 1.9 if usual else 4.5
            return [_Candidate(penalty, "gravity-strength", text, strength, own, structural=False)]
        text = f"the direction of gravity: the model has {shown} m/s² along x, y, z of the base"
        return [_Candidate(2.1, "gravity-direction", text)]

    def own_numbers(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return numbers of the model for which another value makes it agree."""
        p, found = self.problem, []
        # A call of the model is slow: a number must explain one function before it is tried on the others.
        first = p.functions[np.flatnonzero(differing)[0]]
        several, names = int(differing.sum()) > 1, frozenset([str(first)])
        part = differing & p.of_function(str(first))
        for name, value in self.vary.numbers.items():
            try:
                best = self._solve_number(name, value, part, names)
                # Zero or another sign: rather a formula that is wrong than a number.
                odd = best is None or best * value < 0.0 or abs(best) < 1e-9 * abs(value)
                if best is None or (odd and not several):
                    continue
                columns = self.vary.columns(name, best, frozenset(p.functions.tolist()), None)
            except ModelError:
                continue  # a value that the model does not take
            away = np.abs(columns - p.reference[: len(columns)]).max(axis=0)
            if (away <= p.tolerance)[scope | p.agreeing].all():
                text = f"the model's {name} is {value:.6g}; with {best:.6g} it agrees"
                found.append(
                    _Candidate(
                        OWN_PENALTY + 3.0 * odd + 2.5 * self.is_right(value),
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
        p, rows = self.problem, 2  # one unknown: two configurations show whether it is the right one
        weights = 1.0 / p.tolerance[differing]
        target = p.reference[:rows, differing]

        def rest(x: float) -> Array:
            columns = self.vary.columns(name, x, names, rows)[:, differing]
            return np.asarray(((columns - target) * weights).ravel())

        # The first step is a compromise between rounding and curvature; the later ones are secants.
        x0, x1 = value, value + 1e-4 * max(abs(value), 1e-2)
        r0 = rest(x0)
        for _ in range(14):  # secants gain a factor 1.6 in digits each; more means that there is no root
            r1 = rest(x1)
            slope = (r1 - r0) / (x1 - x0)
            size = float(slope @ slope)
            if size == 0.0 or not math.isfinite(size):
                return None
            step = -float(slope @ r1) / size
            # A slope that hardly points at the difference leads nowhere.
            along = abs(float(slope @ r1)) / math.sqrt(size)
            if along < 0.2 * float(np.linalg.norm(r1)) and np.abs(r1).max() > 1.0:
                return None
            x0, r0, x1 = x1, r1, x1 + step
            if abs(step) <= 1e-13 * max(abs(x1), 1e-6) or x1 == x0:
                break
        return x1 if np.abs(rest(x1)).max() <= 1.0 else None

    def pairs(self, scope: Mask) -> list[_Candidate]:
        """Return two mistakes that together make all of `scope` agree."""
        p, found = self.problem, []
        likely = [h for h, fits in self.discrete if h.penalty <= PAIR_PENALTY and h.custom is None]
        # One quantity at three configurations rules out nearly all pairs, at a hundredth of the time.
        few, part = 3, np.zeros_like(scope)
        for quantity in ("D", "G", "H"):
            if (scope & self.differing & p.quantity(quantity)).any():
                part = scope & p.quantity(quantity)
                break
        else:
            return []
        user, tolerance = p.user[:few, part], p.tolerance[part]
        for first, second in itertools.combinations(likely, 2):
            if first.post is not None and second.post is not None:
                continue  # two factors of the same quantity are one factor
            both = first.and_also(second)
            columns = p.hypothesis(both, few, quantity)[:, part]
            if (np.abs(user - columns).max(axis=0) <= tolerance).all() and p.explains(both)[scope].all():
                found.append(_whole(both))
        return sorted(found, key=lambda c: c.penalty)

    def link_parameters(self, scope: Mask, differing: Mask) -> list[_Candidate]:
        """Return links whose mass, centre of mass and inertia, by least squares, make all agree."""
        p = self.problem
        inertial = p.quantity("D", "H", "G", "V")
        if (differing & ~inertial).any() or (scope & inertial).sum() < 3:
            return []  # ten parameters fit anything that small
        mask = scope & inertial
        weights = 1.0 / p.tolerance[mask]
        target = ((p.user - p.reference)[:, mask] * weights).ravel()
        blocks = [
            np.stack([(p.hypothesis(h)[:, mask] * weights).ravel() for h in regressor(p.tree, i)], axis=-1)
            for i in range(p.tree.n)
        ]
        limit = 100.0  # in units of the tolerance: least squares over many columns loses some digits
        for count in range(1, min(p.tree.n, 3) + 1):
            for chosen in itertools.combinations(range(p.tree.n), count):
                block = np.concatenate([blocks[i] for i in chosen], axis=-1)
                sizes = np.linalg.norm(block, axis=0)
                sizes[sizes == 0.0] = 1.0
                # Joints feel sums of parameters only, so the block is rank deficient by construction.
                change = np.linalg.lstsq(block / sizes, target, rcond=1e-11)[0]
                if np.abs(block / sizes @ change - target).max() <= limit:
                    links = " and ".join(self.names.link(i) for i in chosen)
                    own = _inertial_text(chosen, (change / sizes).reshape(count, 10))
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
            fits, h = min(options, key=lambda option: (-int(option[0].sum()), option[1].penalty))
            if fits.sum() < 2:
                break
            yield self.cause(_by_penalty([h]), fits, "elements")
            left &= ~fits
        for column in np.flatnonzero(left):
            unknown = _Candidate(99.0, "unknown", NOT_NAMED)
            candidates = self.explain_one(int(column)) or [unknown]
            yield self.cause(candidates, _only(int(column), mask), "elements")

    def explain_one(self, column: int) -> list[_Candidate]:
        """Return the mistakes that explain one element, the simplest first; none when none does."""
        fitting = [h for h, fits in [*self.discrete, *self.maps] if fits[column] and h.post is None]
        # Half a turn is a sign, which a term's name tells better.
        turned = [h for h in fitting if h.affine is not None and "180°" not in h.text]
        if turned:
            return _by_penalty(turned)
        matches = self.matches(column)
        if matches and matches[0].plain:
            return [_Candidate(3.0, "term", m.text) for m in matches if m.plain]
        mask = _only(column, self.differing)
        # From what is most telling to what fits most easily: the later ones have free numbers.
        return (
            _by_penalty(fitting)
            or self.copied(column)
            or self.slips(column)
            or self.mapped_term(column)
            or self.scaled_terms(matches)
            or self.harmonic(column)
            or [c for c in [self.factor(column, plain=False)] if c is not None]
            or sorted(self.wrong_values(mask, mask), key=lambda c: c.penalty)
        )

    def matches(self, column: int) -> list[terms.Match]:
        """Return the terms that explain one element, those with a usual factor first."""
        if self.problem.elements[column].quantity not in ("D", "H", "G", "V", "Z"):
            return []
        self._terms = self._terms or terms.split(self.problem)
        matches = [terms.match(self.problem, term, column) for term in self._terms]
        return sorted((m for m in matches if m is not None), key=lambda m: not m.plain)

    def slips(self, column: int) -> list[_Candidate]:
        """Return the slips of trigonometry that explain one element."""
        p = self.problem
        rest = p.user[:, column] - p.reference[:, column]
        found = harmonics.trigonometry(p.q, rest, p.tree.prismatic, float(p.tolerance[column]))
        return [_Candidate(3.5, "trigonometry", text) for text in found]

    def scaled_terms(self, matches: list[terms.Match]) -> list[_Candidate]:
        """Return terms with an unusual factor as candidates, those whose factor means something first."""
        named = [(m, phrasing.of_factor(m.factor, self.known)) for m in matches]
        named = sorted(named, key=lambda one: not one[1])
        return [_Candidate(5.0, "term", m.text + why, m.factor, 1.0) for m, why in named]

    def harmonic(self, column: int) -> list[_Candidate]:
        """Return the one term of an element's trigonometric sum that is wrong."""
        p = self.problem
        mine, theirs = p.user[:, column], p.reference[:, column]
        text = harmonics.slip(p.q, mine, theirs, p.tree.prismatic, float(p.tolerance[column]))
        return [] if text is None else [_Candidate(4.5, "term", text)]

    def mapped_term(self, column: int) -> list[_Candidate]:
        """Return a term of the element whose angle is wrong."""
        p = self.problem
        if self._terms and not self._mapped:
            self._mapped = [(h, terms.split(p, h.affine, _FEW)) for h, _ in self.maps]
        for h, moved in self._mapped:
            for plain, other in zip(self._terms, moved, strict=True):
                found = terms.match_mapped(p, plain, other, h, column)
                if found is not None:
                    return [_Candidate(4.0, "term", found.text)]
        return []

    def factor(self, column: int, plain: bool) -> _Candidate | None:
        """Return the constant factor by which an element is off, None when there is none.

        Args:
            column: the element.
            plain: take only a sign, a factor 2, another unit, or what is zero in one of the two.
        """
        p = self.problem
        mine, theirs, tolerance = p.user[:, column], p.reference[:, column], p.tolerance[column]
        if np.abs(theirs).max() <= tolerance:
            return self.extra(column) if plain else None
        if np.abs(mine).max() <= tolerance:
            return _Candidate(1.0, "missing", "is missing: the model has zero there") if plain else None
        factor = float(mine @ theirs) / float(theirs @ theirs)
        if np.abs(mine - factor * theirs).max() > tolerance:
            return None
        for known, text in _FACTORS.items():
            if abs(factor - known) < _SAME_FACTOR:
                return _Candidate(1.0, "sign" if known == -1.0 else "factor", text, known, 1.0)
        text = f"is {factor:.6g} times what it should be"
        if plain:
            unit = phrasing.ratio(factor)
            return _Candidate(1.2, "factor", text + unit) if unit else None
        return _Candidate(6.0, "factor", text + phrasing.of_factor(factor, self.known), factor, 1.0)

    def extra(self, column: int) -> _Candidate | None:
        """Return what an element is that must be zero."""
        p, element = self.problem, self.problem.elements[column]
        mine = p.user[:, column]
        diagonal = element.quantity == "B" and element.place[0] == element.place[1]
        if diagonal and np.ptp(mine) <= p.tolerance[column]:
            text = f"viscous friction of {mine.mean():.6g} is contained in it"
            return _Candidate(1.0, "friction", text, float(mine.mean()), 0.0)
        if element.quantity == "Z":
            return None  # a torque at rest is gravity, or a part of it
        return _Candidate(1.0, "extra", "must be zero, and is not")

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
        text = f"it is {factor:.6g} times what it should be, in every entry"
        return [_Candidate(4.5, "factor", text + phrasing.of_factor(factor, self.known), factor, 1.0)]

    def copied(self, column: int) -> list[_Candidate]:
        """Return another element whose value stands in place of this one's."""
        p, element, tolerance = self.problem, self.problem.elements[column], self.problem.tolerance[column]
        for other, candidate in enumerate(p.elements):
            if other == column or candidate[:2] != element[:2]:  # of the same function and quantity
                continue
            away = np.abs(p.user[:, column] - p.reference[:, other]).max()
            if away <= tolerance and np.abs(p.reference[:, other]).max() > tolerance:
                return [_Candidate(2.0, "swapped", f"what belongs in {candidate.label} stands there")]
        return []

    def elements(self, mask: Mask) -> tuple[Element, ...]:
        """Return the elements of a mask."""
        return tuple(self.problem.elements[column] for column in np.flatnonzero(mask))

    def cause(self, found: list[_Candidate], mask: Mask, scope: str) -> Cause:
        """Return the simplest candidate as a cause, the others of about its penalty as alternatives."""
        first = found[0]
        # A reader who sees at once that the first is not it wants to see the others.
        near = [
            c.text for c in found[1:] if c.penalty <= max(first.penalty + 2.0, 6.0) and c.text != first.text
        ]
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
            mine, theirs, rest = ("?" if s is None else harmonics.formula(s) for s in sums)
            if mine != "?" and theirs != "?":
                yield f"{element.label}: the model has {mine}, the robot {theirs}"
            elif rest != "?":
                yield f"{element.label}: model less robot is {rest}"
            else:
                worst = int(np.argmax(np.abs(p.user[:, column] - p.reference[:, column])))
                configuration = ", ".join(f"{x:.4g}" for x in p.q[worst])
                values = f"{p.user[worst, column]:.6g}, the robot {p.reference[worst, column]:.6g}"
                yield f"{element.label}: the model has {values} at q = ({configuration})"


def _whole(h: Hypothesis) -> _Candidate:
    """Return a hypothesis about a whole scope as a candidate."""
    return _Candidate(h.penalty, h.kind, h.text, hypothesis=h)


class _Fitted:
    """A parametric hypothesis, evaluated so that it is known for every value of its number."""

    def __init__(self, problem: Problem, hypothesis: ParametricHypothesis) -> None:
        """Evaluate it at three values, or five angles: as many as its polynomial has coefficients."""
        self.problem, self.hypothesis = problem, hypothesis
        value = hypothesis.value
        if hypothesis.angle:
            # 1, cos, sin, cos 2, sin 2: equidistant angles make the best conditioned system.
            nodes = np.asarray(2.0 * np.pi * np.arange(5) / 5.0)
        else:
            # Half of a mass: Pinocchio adds no negative ones.
            step: float = 0.5 * abs(value) if hypothesis.kind == "mass" and value else 1.0
            nodes = np.array([-step, 0.0, step])
        columns = np.stack([problem.hypothesis(hypothesis.instance(value + x)) for x in nodes])
        inverse = np.linalg.inv(self._basis(nodes))
        self._coefficients = np.tensordot(inverse, columns, axes=1)  # (K, N, E)

    def _basis(self, x: Array) -> Array:
        """Return the functions that the columns are made of, at values of the number, (len(x), K)."""
        if self.hypothesis.angle:
            return np.stack([np.ones_like(x), np.cos(x), np.sin(x), np.cos(2 * x), np.sin(2 * x)], axis=-1)
        return np.stack([np.ones_like(x), x, x**2], axis=-1)

    def candidate(self, scope: Mask, differing: Mask) -> _Candidate | None:
        """Return the value that makes all of `scope` agree, None when there is none."""
        p, h = self.problem, self.hypothesis
        weights = 1.0 / p.tolerance[differing]
        parts = (self._coefficients[:, :, differing] * weights).reshape(len(self._coefficients), -1)
        target = (p.user[:, differing] * weights).ravel()
        if np.abs(parts[1:]).max() < 1.0:
            return None  # what differs does not depend on it
        value = h.value + self._closest(parts, target)
        # The fit knows only what differs; the hypothesis itself must not spoil what agrees.
        if not p.fits(p.hypothesis(h.instance(value)))[scope].all():
            return None
        value = 0.0 if abs(value) < 1e-9 else value
        if value < 0.0 and h.kind in ("mass", "armature"):
            return None
        if h.angle:
            value = (value + math.pi) % (2.0 * math.pi) - math.pi
        # Zero, or the other sign: rather a formula that is wrong.
        odd = 2.0 if value * h.value < 0.0 or value == 0.0 else 0.0
        return _Candidate(h.penalty + odd, h.kind, self._text(value), value, h.value, structural=False)

    def _text(self, value: float) -> str:
        """Return what a value means."""
        h = self.hypothesis
        if h.kind == "scale":
            text = f"{h.what} {value:.6g}"
        else:
            degrees = f"rad ({value * 180.0 / math.pi:.4g}°)" if h.angle else h.unit
            text = f"{h.what}: {value:.6g} {degrees} in the model, {h.value:.6g} {h.unit} in the robot"
        if same := self._same_as(value):
            return f"{text} ({same})"
        return text if h.angle or not h.value else text + phrasing.ratio(value / h.value)

    def _same_as(self, value: float) -> str:
        """Return which other length of the robot a value is: l for lc, or the other way round."""
        if self.hypothesis.kind not in ("com", "length") or value == 0.0:
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
        if self.hypothesis.angle:
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


def _under(tree: Tree, gravity: Array) -> Tree:
    """Return the tree under another gravity."""
    return replace(tree, gravity=gravity)


def _fixed(tree: Tree) -> Callable[[Tree], Tree]:
    """Return the change that gives this tree, whatever it is applied to."""
    return lambda _: tree


def _only(column: int, like: Mask) -> Mask:
    """Return a mask of one element."""
    mask = np.zeros_like(like)
    mask[column] = True
    return mask


def regressor(tree: Tree, i: int) -> list[Hypothesis]:
    """Return arms whose quantities are the derivatives by the ten inertial parameters of body i."""
    empty = tree
    for k in range(tree.n):
        empty = empty.with_body(k, mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))
    empty = replace(empty, armature=np.zeros(tree.n))
    point = empty.with_body(i, mass=1.0)
    columns = [Hypothesis("", "", 0.0, tree=_fixed(point))]
    for axis in np.eye(3):
        # A unit point at +axis less one at -axis is twice the first moment.
        ahead, behind = (point.with_body(i, com=s * axis) for s in (1.0, -1.0))

        def moment(t: Tree, q: Array, want: object, a: Tree = ahead, b: Tree = behind) -> dict[str, Array]:
            names = list(want)  # type: ignore[call-overload]
            one, other = evaluate(a, q, names), evaluate(b, q, names)
            return {name: 0.5 * (one[name] - other[name]) for name in one}

        columns.append(Hypothesis("", "", 0.0, custom=moment))
    for r, c in MOMENTS:
        unit = np.zeros((3, 3))
        unit[r, c] = unit[c, r] = 1.0
        columns.append(Hypothesis("", "", 0.0, tree=_fixed(empty.with_body(i, inertia=unit))))
    return columns


def _inertial_text(chosen: tuple[int, ...], change: Array) -> str:
    """Return changes of mass, first moments and inertias as text."""
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
