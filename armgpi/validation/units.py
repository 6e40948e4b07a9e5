"""Does a repair hold for other numbers, and has it right units? No declarations: the robot's numbers say it.

A mass of the model is a mass of the robot: if it is another one, some robot with other masses, and the same
lengths and inertias, moves as the model says. So the derivative of all that a right model gives by one of its
numbers is a sum of the robot's derivatives by numbers of one unit. In a repair that agrees at the numbers of
the file alone, such as ``m2`` for ``m2 * l1 ** 2`` where a length is 1, that by the length is none.
"""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array

#: Step of a derivative, of the number itself; what it leaves out is far below what counts as the same, and so
#: is what the rounding of finite differences leaves.
STEP = 1e-3
#: A derivative is such a sum up to this, relative.
_SAME = 1e-5
#: Numbers of a model that are looked at, at most.
_MOST = 30
#: Numbers of the robot that one of the model may be, at most: Ixx, Iyy and Izz of two links.
_ALIKE = 6
#: A name with a number in it: m1, lc2, I_3.
_FAMILY = re.compile(r"(.*?)_?(\d+)$")
#: Before the unit of what a link's number is where the model takes it apart: a motor sits at its end.
JOINED = "joined "
#: Coefficients that a formula may have, without a name.
USUAL = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 9.81, 9.8, 9.80665)


class Slopes(NamedTuple):
    """Derivatives of what an arm gives by its numbers.

    Attributes:
        names: the functions whose values are stacked, each in units of its largest value.
        sizes: these largest values.
        bases: orthonormal columns that span the derivatives by numbers of one unit and link (None: of all).
        values: the robot's numbers.
        units: their units.
        links: the links that they belong to, from 0; gravity's is -1.
        columns: the derivatives by them, (values, count).
        noise: what the rounding of a model's values leaves of a derivative: of finite differences, say.
    """

    names: tuple[str, ...]
    sizes: tuple[float, ...]
    bases: Mapping[tuple[str, int | None], Array]
    values: Array
    units: tuple[str, ...]
    links: tuple[int, ...]
    columns: Array
    noise: float = 0.0

    def same(self, rest: Array, column: Array) -> bool:
        """Tell whether what is left of a derivative is nothing."""
        least = self.noise * np.sqrt(len(column))
        return bool(np.linalg.norm(rest) <= _SAME * np.linalg.norm(column) + least)

    def of(self, column: Array, stated: Sequence[float]) -> set[int | None]:
        """Return the links whose numbers of one unit give a derivative, with None if those of all give it.

        A link whose mass is none of those that the model states may be joined of several bodies there.
        """
        masses = [j for j, unit in enumerate(self.units) if unit == "kg"]
        whole = {self.links[j] for j in masses if np.isclose(self.values[j], stated, rtol=1e-6).any()}
        rests = [
            (link, column - basis @ (basis.T @ column))
            for (unit, link), basis in self.bases.items()
            if not (unit.startswith(JOINED) and link in whole)
        ]
        return {link for link, rest in rests if self.same(rest, column)}

    def alike(self, value: float, share: float = 1.0) -> list[int]:
        """Return which of the robot's numbers are a share of a value, up to the sign, and are felt."""
        near = np.abs(np.abs(self.values) - share * abs(value)) <= 1e-6 * abs(value)
        felt = np.abs(self.columns).max(axis=0) * np.abs(self.values) > 1e-7
        return [int(j) for j in np.flatnonzero(near & felt)]

    def standing(self, column: Array, value: float, used: Container[int] = ()) -> dict[int, float]:
        """Return the robot's numbers that a model's is, others than those used, and their changes by it.

        All of them change by the same share as it does. A length may move one more, as far as it grows: what
        is counted from its end, as in the frames of Denavit and Hartenberg.
        """
        alike = [*self.alike(value), *self.alike(value, 0.5)]  # the centre of mass at half of a length
        alike = [j for j in alike if j not in used]
        for size in range(1, min(len(alike), _ALIKE) + 1):
            for chosen in itertools.combinations(alike, size):
                if len(units := {self.units[j] for j in chosen}) > 1:
                    continue
                rates = {j: float(self.values[j]) / value for j in chosen}
                rest = column - self.columns[:, chosen] @ self.values[list(chosen)]
                if self.same(rest, column):
                    return rates
                if units == {"m"} and (moved := self._one_more(rest, column, value, chosen)):
                    return {**rates, **moved}
        return {}

    def _one_more(
        self, rest: Array, column: Array, value: float, chosen: tuple[int, ...]
    ) -> dict[int, float]:
        """Return the one length that moves as well, and which way."""
        for j, way in itertools.product(range(len(self.units)), (1.0, -1.0)):
            length = self.units[j] == "m" and j not in chosen
            if length and self.same(rest - way * value * self.columns[:, j], column):
                return {j: way}
        return {}


class Check(NamedTuple):
    """What a model's numbers are in the robot.

    Attributes:
        wrong: how many mean nothing in the robot.
        other: how many are not what is as large in the robot.
        seen: how many were looked at.
        sure: whether each is of one link, families such as m1, m2 are in the links' order, and all are used.
        standing: place among the numbers -> the robot's numbers that it is, and how they change with it.
    """

    wrong: int
    other: int
    seen: int
    sure: bool
    standing: Mapping[int, Mapping[int, float]]


def span(columns: Sequence[Array]) -> Array:
    """Return orthonormal columns of what some columns span."""
    matrix = np.stack(columns, axis=-1)
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    left, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(left[:, sizes > 1e-6])


def check(source: str, values: Callable[[str], Array | None], known: Slopes, text: str = "") -> Check:
    """Return what the numbers of a source are in the robot.

    Args:
        source: a model that agrees with the robot.
        values: gives what a changed source gives, as in `known`; None when it does not work.
        known: the robot's derivatives.
        text: what was changed: the numbers named in it are looked at first, the others where these are right.
    """
    tree = ast.parse(source)
    named = list(numbers(tree))
    checked = _Checked(known, [float(ast.literal_eval(node)) for _, node in named])
    words = set(re.findall(r"\w+", text))

    def is_new(name: str) -> bool:
        return re.findall(r"\w+", name)[-1] in words

    # The sort is stable: the others in their order.
    for k, (name, node) in sorted(enumerate(named[:_MOST]), key=lambda one: not is_new(one[1][0])):
        if checked.wrong + checked.other > 0 and not is_new(name):
            break
        value = checked.stated[k]
        if value == 0.0 or name in ("n", "N"):
            continue
        ends = [values(with_numbers(source, [(node, value * (1.0 + s * STEP))])) for s in (1.0, -1.0)]
        if ends[0] is not None and ends[1] is not None:
            checked.add(k, name, (ends[0] - ends[1]) / (2.0 * STEP))
    sure = len(named) <= _MOST and not _bare(tree, named) and checked.is_sure()
    return Check(checked.wrong, checked.other, checked.seen, sure, checked.standing)


class _Checked:
    """The numbers of a model that were looked at, and what they are in the robot; see :class:`Check`."""

    def __init__(self, known: Slopes, stated: list[float]) -> None:
        """Take the robot's derivatives, and all numbers that the model states."""
        self.known, self.stated = known, stated
        self.wrong = self.other = self.seen = 0
        self.standing: dict[int, dict[int, float]] = {}
        self._linked = True  # whether each is of a link
        #: The robot's numbers that are used, those of which half is, and the model's that nothing depends on.
        self._used, self._halves, self._unused = set[int](), set[int](), list[float]()
        self._families: dict[str, list[tuple[int, int]]] = {}

    def add(self, k: int, name: str, column: Array) -> None:
        """Take the derivative of all that the model gives by a number."""
        known, value = self.known, self.stated[k]
        if np.abs(column).max() < max(1e-7, known.noise):  # nothing depends on it
            self._unused.append(value)
            return
        self.seen += 1
        whole = known.alike(value)
        if chosen := known.standing(column, value, self._used):
            self.standing[k] = chosen
            own = {*chosen} & {*whole, *known.alike(value, 0.5)}
            links = {known.links[j] for j in own}
            self._used |= own
            self._halves |= own - {*whole}
        else:
            found = known.of(column, self.stated)
            self.wrong += not found
            self.other += bool(whole)
            links = {link for link in found if link is not None}
            self._linked = self._linked and bool(links)
        family = _FAMILY.match(name.strip("'"))
        letter, place = (family[1], int(family[2])) if family else (name, k)
        self._families.setdefault(letter, []).append((place, min(links, default=0)))

    def is_sure(self) -> bool:
        """Tell whether each is of one link, families are in the links' order, and none may be forgotten."""
        # A number that is read nowhere may be what stands at half of another one: lc1, and l1 / 2.
        left = self._used - self._halves
        in_order = [[link for _, link in sorted(rows)] for rows in self._families.values()]
        return (
            self._linked
            and not any(set(self.known.alike(x)) - left for x in self._unused)
            and all(links == sorted(links) for links in in_order)
        )


def _bare(tree: ast.AST, named: Sequence[tuple[str, ast.Constant]]) -> bool:
    """Tell whether a source has numbers without a name that are no usual coefficients."""
    known = {node for _, node in named}
    found = (x for x in ast.walk(tree) if isinstance(x, ast.Constant) and type(x.value) is float)
    return any(x not in known and x.value not in USUAL for x in found)


def numbers(tree: ast.AST) -> Iterator[tuple[str, ast.Constant]]:
    """Yield numbers of a source that have a name: assigned, items, arguments, defaults, entries of lists."""
    pairs: list[tuple[str, Any]] = []
    for node in ast.walk(tree):
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                pairs += [(ast.unparse(a), b) for a, b in zip(names, values, strict=False)]
            case ast.Assign(targets=[ast.Name() | ast.Attribute() as name], value=value):
                entries = value.elts if isinstance(value, ast.List | ast.Tuple) else [value]
                pairs += [(ast.unparse(name), x) for x in entries]
            case ast.AnnAssign(target=target, value=ast.Constant() as value):
                pairs.append((ast.unparse(target), value))
            case ast.Dict(keys=keys, values=values):
                pairs += [(ast.unparse(a), b) for a, b in zip(keys, values, strict=True) if a is not None]
            case ast.keyword(arg=str() as word, value=value):
                pairs.append((word, value))
            case ast.arguments():
                named = [*node.posonlyargs, *node.args]
                named = [*named[len(named) - len(node.defaults) :], *node.kwonlyargs]
                defaults = [*node.defaults, *node.kw_defaults]
                pairs += [(a.arg, b) for a, b in zip(named, defaults, strict=True)]
    for text, x in pairs:
        inner = getattr(x, "operand", x)  # -0.3
        if isinstance(inner, ast.Constant) and type(inner.value) in (int, float):
            yield text, inner


def readings(source: str) -> dict[str, float]:
    """Return how the numbers of a source are read in it, and what they are."""
    tree = ast.parse(source)
    values = {name.strip("'").split(".")[-1]: float(ast.literal_eval(x)) for name, x in numbers(tree)}
    found = {}
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Load()) | ast.Attribute(attr=name, ctx=ast.Load()):
                pass
            case ast.Subscript(slice=ast.Constant(value=str() as name), ctx=ast.Load()):
                pass
            case _:
                continue
        if name in values:
            found[ast.unparse(node)] = values[name]
    return found


def with_numbers(source: str, changes: Sequence[tuple[ast.Constant, float]]) -> str:
    """Return a source with other numbers in place of some."""
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    for node, value in sorted(changes, key=lambda one: (-one[0].lineno, -one[0].col_offset)):
        line = lines[node.lineno - 1]
        lines[node.lineno - 1] = (
            line[: node.col_offset] + repr(float(value)).encode() + line[node.end_col_offset :]
        )
    return b"".join(lines).decode()
