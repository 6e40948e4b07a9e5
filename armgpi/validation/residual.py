"""The difference of a model and a robot as a formula: missing, too much, of wrong sign or coefficient.

Each element that differs (an entry of D, a product of velocities, a gravity torque) is a sum of the robot's
own summands (:mod:`armgpi.validation.summands`). The shortest explanation of its difference is looked for
among these: one or two of them with a usual share, all that have one number in common, one number or one
angle for another, a term that does not belong there. No source is needed. Where nothing of the kind is found,
the difference is given as a sum of sines and cosines with numbers.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.naming import UserName, describe
from armgpi.validation.problem import Element, Mask, Problem
from armgpi.validation.summands import Shape, Shapes, Summand, is_weight, numbers_of, summands

#: Share of a summand by which a model is off -> what that means, and the length of saying so.
_USUAL = {
    -1.0: ("missing: {}", 1.0),
    -2.0: ("wrong sign: {}", 1.0),
    -0.5: ("half is missing: {}", 1.5),
    1.0: ("twice instead of once: {}", 1.5),
}
#: First letters of the numbers in the order in which a product has them.
_ORDER = "mIglc"
#: Name of an entry of a link's inertia, such as I10xy; a rotor's is another, such as Ir3.
_LINK_INERTIA = re.compile(r"I(\d+)")
#: Two shares are the same up to this: they come from values that agree to 1e-9.
_SAME = 1e-6
#: Explanations that are as good as the first, listed at most.
_OTHERS = 3
#: Summands of an element of which pairs are tried, at most.
_MOST_PAIRED = 60
#: Summands of a formula that are written with their numbers, at most.
_MOST_SHOWN = 6
#: Of longer explanations a number of any value is one.
_ANY = 20.0
#: Explanations up to this length are in the robot's own terms, and are named.
NAMED = 8.0


class Explanation(NamedTuple):
    """One way to say what the difference of an element is.

    Attributes:
        bits: length of the description.
        text: what is missing, too much or otherwise.
        code: the difference, model less robot, as an expression of Python.
        factors: the products of numbers that it is about.
    """

    bits: float
    text: str
    code: str
    factors: tuple[tuple[str, ...], ...] = ()


class Difference(NamedTuple):
    """The difference of one element as a formula.

    Attributes:
        function: the model's function.
        label: the element: "D[1,2]", "q̇1 q̇2 in τ1", "G[2]".
        text: what is missing, too much, of wrong sign or coefficient.
        formula: model less robot, as an expression of Python in q1, q2, ... and the numbers; "" where it is
            none of few terms.
        named: whether it is said in the robot's own terms.
        bits: length of the description.
        others: other explanations that are as short.
        missing: names of the inertias of which it says that they are missing, where it says nothing else.
    """

    function: str
    label: str
    text: str
    formula: str
    named: bool
    bits: float
    others: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def told(self) -> str:
        """What differs, with the other explanations."""
        return self.text + "".join(f"; or {text}" for text in self.others)


class Residual:
    """Explains the elements of a problem."""

    def __init__(self, problem: Problem, names: Mapping[str, UserName] | None = None) -> None:
        """Take a problem, and what the user calls the robot's numbers."""
        self.problem = problem
        self.names = dict(names or {})
        self.numbers = numbers_of(problem.tree)

    @cached_property
    def summands(self) -> list[Summand]:
        """The robot's own summands."""
        return summands(self.problem)

    @cached_property
    def shapes(self) -> Shapes:
        """Functions of the configuration."""
        return Shapes(self.problem.q, self.problem.tree.prismatic)

    def differences(self, mask: Mask) -> tuple[Difference, ...]:
        """Return what differs in some elements, each in the terms that most of them share."""
        columns = [k for k in np.flatnonzero(mask).tolist() if self.problem.elements[k].quantity in "DHG"]
        found = {k: _Entry(self, k).explanations() for k in columns}
        votes = Counter(
            factors for each in found.values() for factors in {f for one in each for f in one.factors}
        )
        return tuple(self._difference(k, found[k], votes) for k in columns)

    def _difference(
        self, column: int, found: list[Explanation], votes: Mapping[tuple[str, ...], int]
    ) -> Difference:
        """Return the shortest explanation of an element; of equal ones that which others share."""
        element = self.problem.elements[column]
        if not found:
            return Difference(element.function, element.label, "no short formula", "", False, 2.0 * _ANY)

        def rank(one: Explanation) -> tuple[float, int, int]:
            # What is missing together belongs together: m2 l1² and m2 l1 lc2, not I1 and m3 l1 l2.
            numbers = {name for factors in one.factors for name in factors}
            return one.bits, len(numbers), -sum(votes[factors] for factors in one.factors)

        ordered = sorted(found, key=rank)
        first = ordered[0]
        near = [one.text for one in ordered[1:] if one.bits <= first.bits]
        others = tuple(text for text in dict.fromkeys(near) if text != first.text)[:_OTHERS]
        named = first.bits <= NAMED
        only = all(text.startswith("missing: ") for text in first.text.split("; "))
        alone = only and all(len(factors) == 1 for factors in first.factors)
        missing = tuple(factors[0] for factors in first.factors) if alone else ()
        told = (first.text, first.code, named, first.bits, others, missing)
        return Difference(element.function, element.label, *told)

    def negligible(self, share: float) -> set[str]:
        """Return the inertias that add at most a share to any entry of D's diagonal."""
        diagonal = [
            k for k, e in enumerate(self.problem.elements) if e.quantity == "D" and e.place[0] == e.place[1]
        ]
        whole = np.abs(self.problem.reference[:, diagonal]).max(axis=0)
        inertias = [one for one in self.summands if one.factors[0][0] == "I" and len(one.factors) == 1]
        return {
            one.factors[0]
            for one in inertias
            if (np.abs(one.columns[:, diagonal]).max(axis=0) <= share * whole).all()
        }

    def value(self, factors: Sequence[str]) -> float:
        """Return the product of some of the robot's numbers."""
        return float(np.prod([self.numbers[name] for name in factors]))

    def product(self, factors: Sequence[str]) -> str:
        """Return a product of numbers in the user's names: "m2*l1**2"."""
        ordered = sorted(factors, key=lambda name: _ORDER.index(name[0]))
        powers = Counter(map(self.shown, ordered))
        return "*".join(name if k == 1 else f"{name}**{k}" for name, k in powers.items())

    def shown(self, name: str) -> str:
        """Return what the user calls one of the robot's numbers, else its own name."""
        return self.names[name].name if name in self.names else name

    def sign(self, factors: Sequence[str]) -> float:
        """Return the sign of a product where the user has numbers of the other sign."""
        return float(np.prod([self.names[name].sign for name in factors if name in self.names]))

    def legend(self, differences: Sequence[Difference]) -> tuple[str, ...]:
        """Return what the robot's numbers in some formulas are."""
        words = {word for one in differences for word in re.findall(r"[A-Za-z]\w*", one.text)}
        return tuple(describe(self.names, words, self.problem.tree))


class _Entry:
    """One element, and the search for what its difference is."""

    def __init__(self, residual: Residual, column: int) -> None:
        p = residual.problem
        self.residual = residual
        self.element: Element = p.elements[column]
        self.tolerance = float(p.tolerance[column])
        self.rest: Array = p.user[:, column] - p.reference[:, column]
        strength = ("g",) if is_weight(self.element.quantity) else ()
        self.own: list[tuple[tuple[str, ...], Array]] = []
        self.foreign: list[tuple[str, ...]] = []
        for one in residual.summands:
            part = one.columns[:, column]
            felt = np.abs(part).max() > self.tolerance
            factors = (*one.factors, *strength)
            if felt:
                self.own.append((factors, part))
            elif np.abs(one.columns).max() > self.tolerance:
                self.foreign.append(factors)

    def explanations(self) -> list[Explanation]:
        """Return the shortest explanations, none where there is none."""
        tries: tuple[Callable[[], Iterable[Explanation]], ...] = (
            self.single,
            self.pairs,
            self.replaced,
            self.all_own,
            self.other_angle,
            self.too_much,
            self.numeric,
        )
        found: list[Explanation] = []
        for attempt in tries:
            found += attempt()
            if found and min(one.bits for one in found) <= NAMED:
                break
        return found

    def single(self) -> Iterator[Explanation]:
        """Yield one summand, or all that have a number in common, with a usual share."""
        for factors, part in self.own:
            for share, (text, bits) in _USUAL.items():
                if self.is_rest(share * part):
                    yield self.told(text, bits, factors, part, share)
        for text, chosen in self.groups():
            part = np.sum([self.own[k][1] for k in chosen], axis=0)
            for share, (pattern, bits) in _USUAL.items():
                if self.is_rest(share * part):
                    shown = pattern.format(text)
                    if share == -1.0 and text == "all of it" and len(chosen) <= _MOST_SHOWN:
                        shown += f", {self.code_of(chosen, 1.0)}"
                    yield Explanation(bits + 0.5, shown, self.code_of(chosen, share))

    def groups(self) -> Iterator[tuple[str, list[int]]]:
        """Yield all of the element, and all summands with one number, where these are more than one."""
        every = list(range(len(self.own)))
        groups = {"all of it": every}
        for name in dict.fromkeys(name for factors, _ in self.own for name in factors if name != "g"):
            shown = self.residual.shown(name)
            groups[f"every term with {shown}"] = [k for k in every if name in self.own[k][0]]
        inertias: dict[str, list[int]] = {}
        for k, (factors, _) in enumerate(self.own):
            if inertia := _LINK_INERTIA.match(factors[0]):
                inertias.setdefault(inertia[1], []).append(k)
        groups |= {f"the inertia of link {link}": of_link for link, of_link in inertias.items()}
        for text, chosen in groups.items():
            if len(chosen) > 1 and (len(chosen) < len(every) or text == "all of it"):
                yield text, chosen

    def code_of(self, chosen: Sequence[int], share: float) -> str:
        """Return a multiple of some summands as an expression: with their numbers where they are few."""
        if len(chosen) > _MOST_SHOWN:
            return self.code(self.rest)
        terms = (self.term(self.own[k][0], self.shape(*self.own[k]).times(share)) for k in chosen)
        return " + ".join(terms).replace("+ -", "- ")

    def pairs(self) -> Iterator[Explanation]:
        """Yield two summands with usual shares."""
        if len(self.own) > _MOST_PAIRED:
            return
        shares = list(_USUAL)
        labels = [(k, share) for k in range(len(self.own)) for share in shares]
        if not labels:
            return
        parts = np.stack([share * self.own[k][1] for k, share in labels])
        fixed = [bool(np.ptp(self.own[k][1]) <= self.tolerance) for k, _ in labels]
        for i, (k, share) in enumerate(labels):
            away = np.abs(self.rest - parts[i] - parts[i + 1 :]).max(axis=1, initial=0.0)
            for j in np.flatnonzero(away <= self.tolerance) + i + 1:
                other, its_share = labels[j]
                # Round constants add up to any other, unless they are just not there.
                by_chance = fixed[i] and fixed[j] and (share, its_share) != (-1.0, -1.0)
                if other == k or by_chance:
                    continue
                one = self.told(*_USUAL[share], *self.own[k], share)
                two = self.told(*_USUAL[its_share], *self.own[other], its_share)
                yield _together([one, two])

    def replaced(self) -> Iterator[Explanation]:
        """Yield one number for another in one summand, a power too few or too many, or any coefficient."""
        for factors, part in self.own:
            share = float(part @ self.rest) / float(part @ part)
            if not self.is_rest(share * part):
                continue
            shape = self.shape(factors, part)
            term, code = self.term(factors, shape), self.term(factors, shape.times(share))
            for bits, text in self._reasons(factors, 1.0 + share):
                yield Explanation(bits, text.format(term=term), code, (factors,))
            if np.ptp(part) <= self.tolerance:
                continue  # any constant is a multiple of any other
            right = shape.terms[0][0] if len(shape.terms) == 1 else 1.0
            text = f"{term} has the factor {right * (1.0 + share):.6g}, expected {right:.6g}"
            yield Explanation(_ANY + 1.0, text, code, (factors,))

    def _reasons(self, factors: tuple[str, ...], ratio: float) -> Iterator[tuple[float, str]]:
        """Yield why a summand may stand with another factor."""
        numbers = self.residual.numbers
        shown = self.residual.shown
        for name, count in Counter(factors).items():
            mine = shown(name)
            for other, value in numbers.items():
                if other == name or _kind(other) != _kind(name):
                    continue
                if any(_same(ratio, (value / numbers[name]) ** k) for k in range(1, count + 1)):
                    yield 2.5, f"{shown(other)} replaces {mine} in {{term}}"
            if _same(ratio * numbers[name], 1.0) and len(factors) > 1:
                yield 2.0, f"the factor {mine} is missing in {{term}}"
            if _same(ratio, numbers[name]):
                yield 3.0, f"the factor {mine} occurs once too often in {{term}}"

    def all_own(self) -> Iterator[Explanation]:
        """Yield several summands with usual shares, where their functions are independent."""
        if not 2 < len(self.own) < len(self.rest):
            return
        parts = np.stack([part for _, part in self.own], axis=1)
        sizes = np.linalg.norm(parts, axis=0)
        singular = np.linalg.svd(parts / sizes, compute_uv=False)
        if singular[-1] < 1e-6 * singular[0]:
            return
        shares = np.linalg.lstsq(parts / sizes, self.rest, rcond=None)[0] / sizes
        if np.abs(parts @ shares - self.rest).max() > self.tolerance:
            return
        told = []
        for (factors, part), share in zip(self.own, shares, strict=True):
            if np.abs(share * part).max() <= self.tolerance:
                continue
            usual = next((known for known in _USUAL if abs(known - share) < _SAME), None)
            if usual is None:
                return
            told.append(self.told(*_USUAL[usual], factors, part, usual))
        if told:
            yield _together(told)

    def other_angle(self) -> Iterator[Explanation]:
        """Yield a summand whose function of the configuration is another one."""
        for factors, part in self.own:
            if max(np.ptp(self.rest), np.ptp(part)) <= self.tolerance:
                continue  # a constant has no angle
            stands = self.residual.shapes.product(
                (self.rest + part) / self.residual.value(factors), self.tolerance_of(factors)
            )
            if stands is None or not stands.is_nice:
                continue
            belongs = self.shape(factors, part)
            text = f"{_sum(stands)} replaces {_sum(belongs)} in {self.term(factors, belongs)}"
            bits = 3.0 + 2.0 * (abs(stands.terms[0][0]) != abs(belongs.terms[0][0]))
            sign = self.residual.sign(factors)
            other = Shape((*stands.times(sign).terms, *belongs.times(-sign).terms))
            code = f"{self.residual.product(factors)}*({_sum(other)})"
            yield Explanation(bits, text, code, (factors,))

    def too_much(self) -> Iterator[Explanation]:
        """Yield a product of the robot's numbers that does not belong there."""
        shape = self.residual.shapes.find(self.rest, self.tolerance)
        if shape is None or not shape.terms:
            return
        fixed = bool(np.ptp(self.rest) <= self.tolerance)
        for bits, names in ((4.0, [factors for factors, _ in self.own]), (5.0, self.foreign)):
            for factors in names:
                scaled = shape.times(1.0 / self.residual.value(factors))
                if fixed and abs(abs(scaled.terms[0][0]) - 1.0) > _SAME:
                    continue  # any constant is a multiple of any other
                if scaled.is_nice and len(scaled.terms) <= 3:
                    term = self.term(factors, scaled)
                    yield Explanation(bits + len(scaled.terms), f"too much: {term}", term, (factors,))

    def numeric(self) -> Iterator[Explanation]:
        """Yield the difference as a sum of sines and cosines with numbers."""
        shape = self.residual.shapes.find(self.rest, self.tolerance)
        if shape is not None and shape.terms:
            text = _sum(shape)
            yield Explanation(_ANY, f"model less robot is {text}", text)

    def told(
        self, text: str, bits: float, factors: tuple[str, ...], part: Array, share: float
    ) -> Explanation:
        """Return a usual share of a summand as an explanation."""
        shape = self.shape(factors, part)
        code = self.term(factors, shape.times(share))
        return Explanation(bits, text.format(self.term(factors, shape)), code, (factors,))

    def is_rest(self, part: Array) -> bool:
        """Tell whether a part is the difference."""
        return float(np.abs(self.rest - part).max()) <= self.tolerance

    def tolerance_of(self, factors: tuple[str, ...]) -> float:
        """Return how exact a function has to be that these numbers are multiplied by."""
        return self.tolerance / abs(self.residual.value(factors))

    def shape(self, factors: tuple[str, ...], part: Array) -> Shape:
        """Return the function of the configuration of one of the robot's summands."""
        y = part / self.residual.value(factors)
        exact = 1e-9 * float(np.abs(y).max())
        found = self.residual.shapes.find(y, exact)
        return Shape(((1.0, "f(q)"),)) if found is None else found

    def code(self, y: Array) -> str:
        """Return samples as a sum with numbers; "" where they are none of few terms."""
        shape = self.residual.shapes.find(y, self.tolerance)
        return "" if shape is None else _sum(shape)

    def term(self, factors: tuple[str, ...], shape: Shape) -> str:
        """Return a product of numbers times a function as an expression: "2*m2*l2x*cos(q2)"."""
        product = self.residual.product(factors)
        shape = shape.times(self.residual.sign(factors))
        if len(shape.terms) != 1:
            return f"{product}*({_sum(shape)})"
        ((coefficient, function),) = shape.terms
        text = f"{product}*{function}" if function else product
        return _with_coefficient(coefficient, text)


def _kind(name: str) -> str:
    """Return the kind of a number by its name: lengths and centres of mass are of one kind."""
    return {"c": "l", "Ir": "I"}.get(name[0], name[0])


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= _SAME * abs(other)


def _together(told: Sequence[Explanation]) -> Explanation:
    """Return explanations of parts as one of the whole."""
    code = " + ".join(one.code for one in told).replace("+ -", "- ")
    factors = tuple(itertools.chain.from_iterable(one.factors for one in told))
    bits = sum(one.bits for one in told) + 0.5 * (len(told) - 1)
    return Explanation(bits, "; ".join(one.text for one in told), code, factors)


def _with_coefficient(coefficient: float, text: str) -> str:
    """Return a coefficient times an expression."""
    number = f"{coefficient:.6g}"
    if not text:
        return number
    return {"1": text, "-1": f"-{text}"}.get(number, f"{number}*{text}")


def _sum(shape: Shape) -> str:
    """Return a function of the configuration as an expression of Python."""
    ordered = sorted(shape.terms, key=lambda term: (len(term[1]), term[1]))
    return " + ".join(_with_coefficient(c, code) for c, code in ordered).replace("+ -", "- ") or "0"
