"""Terms by their values: which product of a model's names, at most a sum of two, a missing term is.

A column of values is compared with all products of up to three expressions that depend on the state. Where
one is a constant multiple of it, that constant is looked up among products of up to four of the model's
numbers, times a usual coefficient.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array

#: Coefficients that formulas have, the usual ones first.
COEFFICIENTS = (1.0, 2.0, 0.5, 4.0, 0.25, 3.0, 1.0 / 3.0, 1.0 / 12.0)
#: Relative error up to which two values are the same: they come from differences of outputs.
SAME = 1e-7
#: Products that have the same value, at most.
_SEVERAL = 40
#: Names and expressions that take part, at most: their products are listed.
_MOST_NAMES, _MOST_STATES = 30, 18


class Term(NamedTuple):
    """A sum of products as text, and how long its description is [bits]."""

    text: str
    bits: float


class Dictionary:
    """All products of some names."""

    def __init__(self, constants: Mapping[str, float], states: Mapping[str, Array]) -> None:
        """Take numbers by name, and expressions by their text with their values (rows,)."""
        positive = {name: abs(x) for name, x in constants.items() if np.isfinite(x) and x != 0.0}
        self._signs = {name: float(np.sign(constants[name])) for name in positive}
        self._constants = dict(list(positive.items())[:_MOST_NAMES])
        varying = {text: x for text, x in states.items() if np.isfinite(x).all()}
        self._states = dict(list(varying.items())[:_MOST_STATES])

    @cached_property
    def _products(self) -> tuple[list[tuple[str, ...]], Array]:
        """All products of up to four numbers, by their logarithms, sorted."""
        names = list(self._constants)
        words: list[tuple[str, ...]] = [()]
        for size in (1, 2, 3, 4):
            words += itertools.combinations_with_replacement(names, size)
        logs = np.array([sum(np.log(self._constants[x]) for x in word) for word in words])
        order = np.argsort(logs)
        return [words[k] for k in order], logs[order]

    @cached_property
    def _shapes(self) -> tuple[list[tuple[str, ...]], Array]:
        """All products of up to three expressions of the state, (count, rows)."""
        texts = list(self._states)
        rows = len(next(iter(self._states.values()))) if texts else 1
        words: list[tuple[str, ...]] = [()]
        for size in (1, 2, 3, 4):
            words += itertools.combinations_with_replacement(texts[: _MOST_STATES if size < 4 else 8], size)
        columns = np.stack([np.prod([self._states[x] for x in w] or [np.ones(rows)], axis=0) for w in words])
        return words, columns

    def terms(self, values: Array) -> list[Term]:
        """Return the simplest products that have some values (rows,), else a sum of two; none without one."""
        words, columns = self._shapes
        size = np.linalg.norm(values)
        if not 0.0 < size < np.inf or columns.shape[1] not in (1, len(values)):
            return []
        columns = columns * np.ones(len(values))  # those of constants alone have one row
        terms = []
        # The share of each shape, and whether it is all there is.
        with np.errstate(all="ignore"):
            share = columns @ values / np.einsum("ij,ij->i", columns, columns)
            rest = np.linalg.norm(values - share[:, np.newaxis] * columns, axis=1)
        for k in np.flatnonzero(rest <= SAME * size)[:8]:
            for found in self.constants(float(share[k])) or ([] if words[k] else self._sums(float(share[k]))):
                text = re.sub(r"^-1 \* ", "-", _product(found.text, words[k]))
                terms.append(Term(text, float(found.bits + np.log2(len(words)))))
        if terms or not self._states:
            return sorted(terms, key=lambda term: term.bits)[:_SEVERAL]
        return self._sum(values)

    def _sum(self, values: Array) -> list[Term]:
        """Return two products of different shapes that add up to some values; nothing without such."""
        words, columns = self._shapes
        if len(values) < 4:
            return []
        few = np.flatnonzero(np.fromiter(map(len, words), int) <= 2)[:120]
        size, parts = float(np.linalg.norm(values)), columns[few]
        gram, inner = parts @ parts.T, parts @ values
        own = np.diag(gram)
        with np.errstate(all="ignore"):
            det = np.outer(own, own) - gram**2
            first = (np.outer(inner, own) - gram * inner) / det
            # What is left of the squares: to the digits that it has, so that few have to be looked at.
            rest = 1.0 - (first * inner[:, np.newaxis] + (first * inner[:, np.newaxis]).T) / size**2
        near = np.argwhere(np.triu(np.abs(rest) < 1e-8, 1) & (det > 1e-9 * np.outer(own, own)))
        for i, j in near:
            pair = parts[[i, j]].T
            shares = np.linalg.lstsq(pair, values, rcond=None)[0]
            if np.linalg.norm(values - pair @ shares) > SAME * size or np.abs(shares).min() < 1e-12:
                continue
            found = [term for s in shares for term in self.constants(float(s))[:1]]
            if len(found) == 2:
                pairs = zip(found, (i, j), strict=True)
                text = " + ".join(" * ".join([p.text, *_powers(words[few[k]])]) for p, k in pairs)
                return [Term(text, float(found[0].bits + found[1].bits + 2 * np.log2(len(words))))]
        return []

    def _sums(self, value: float) -> list[Term]:
        """Return sums of two products of numbers with a factor in common, such as m (x² + y²)."""
        words, logs = self._products
        few = [k for k, word in enumerate(words) if 1 < len(word) < 4]
        sizes = np.exp(logs[few]) * [np.prod([self._signs[x] for x in words[k]]) for k in few]
        order, near = np.argsort(sizes), SAME * abs(value)
        low, high = np.searchsorted(sizes[order], [value - sizes - near, value - sizes + near])
        pairs = (
            (words[few[i]], words[few[order[j]]])
            for i in np.flatnonzero(high > low)
            for j in range(low[i], high[i])
        )
        found = {tuple(sorted(pair)) for pair in pairs if pair[0] != pair[1] and {*pair[0]} & {*pair[1]}}
        bits = np.log2(len(self._constants) + 1.0)
        return [
            Term(" + ".join(" * ".join(_powers(word)) for word in pair), float(sum(map(len, pair)) * bits))
            for pair in sorted(found)
        ]

    def constants(self, value: float) -> list[Term]:
        """Return the simplest products of numbers, times a usual coefficient, that have a value.

        Numbers of files are round: several products have the value, and at most one of them the unit.
        """
        words, logs = self._products
        found: list[tuple[int, int, tuple[str, ...], float]] = []
        for rank, coefficient in enumerate(COEFFICIENTS):
            wanted = np.log(abs(value) / coefficient)
            low, high = np.searchsorted(logs, [wanted - SAME, wanted + SAME])
            found += [(len(words[k]), rank, words[k], coefficient) for k in range(low, high)]
        terms: list[Term] = []
        for _, rank, word, coefficient in sorted(found, key=lambda one: one[:2])[:_SEVERAL]:
            sign = float(np.sign(value) * np.prod([self._signs[x] for x in word] or [1.0]))
            number = {1.0 / 3.0: "1 / 3", 1.0 / 12.0: "1 / 12"}.get(coefficient, f"{coefficient:g}")
            text = _product(number, word)
            bits = float(np.log2(rank + 1.0) + len(word) * np.log2(len(self._constants) + 1.0))
            terms += [Term(("-" if sign < 0.0 else "") + text, bits)]
        return terms


def _product(number: str, word: tuple[str, ...]) -> str:
    """Return a number times a product as text; a factor of 1 is left out."""
    return " * ".join(_powers(word) if number == "1" and word else [number, *_powers(word)])


def _powers(word: tuple[str, ...]) -> list[str]:
    """Return the factors of a product, equal ones as powers."""
    counted = {x: word.count(x) for x in word}
    return [x if k == 1 else f"{x} ** {k}" for x, k in counted.items()]
