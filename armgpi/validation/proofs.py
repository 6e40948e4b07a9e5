"""What a repair is worth: what a changed copy of a source gives, with its own numbers and with others."""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.alternatives import is_sum, names_in
from armgpi.validation.dimensions import adds_unlike
from armgpi.validation.edits import ROWS, Change, Goal, apply_changes, impatient, stack_values
from armgpi.validation.models import Functions
from armgpi.validation.units import check, numbers, readings, spell_out

Again = Callable[[str], Functions]


class Repaired(NamedTuple):
    """Changes with which a model agrees, and its whole source with them."""

    changes: tuple[Change, ...]
    source: str
    doubts: int = 0  # numbers for which it does not hold
    checked: int = 0  # numbers that were changed to see that
    other: int = 0  # numbers that stand for others than those of the robot that are as large
    sure: bool = False  # whether nothing else is as good, as far as the numbers tell
    #: Place among the source's numbers -> the robot's that it is, and how they change with it.
    standing: Mapping[int, Mapping[int, float]] = {}
    #: The source with a number of its own for every name: what `standing` counts.
    spelled: str = ""
    #: Names of numbers that mean nothing in the robot.
    odd: tuple[str, ...] = ()
    #: What may be wrong in place of it, and leaves it a candidate; "" without such.
    instead: str = ""

    @property
    def rank(self) -> tuple[int, int, int, bool, float]:
        """What makes a repair better than another: it holds for other numbers, its description is short."""
        return self.doubts, len(self.changes), self.other, not self.sure, self.bits

    @property
    def holds(self) -> bool:
        """Whether it holds for other numbers, and they are those of the robot."""
        return self.doubts == self.other == 0

    @property
    def confirmed(self) -> bool:
        """Whether it holds for other numbers than those of the file, and has right units."""
        return self.sure and self.checked > 0 and self.holds

    @property
    def doubtful(self) -> bool:
        """Whether it hardly is what was meant: two changes may agree at the numbers of a file by chance."""
        return self.doubts > 0 or (self.other > 0 and len(self.changes) > 1)

    @property
    def bits(self) -> float:
        """How long the description of the changes is."""
        return sum(change.bits for change in self.changes)


class Searched(NamedTuple):
    """What a search of a source came to.

    Attributes:
        found: changes with which the model agrees, None without such.
        unsearched: what the time did not suffice for, a phrase each.
        failure: what failed in the search itself; "" when nothing did.
    """

    found: Repaired | None
    unsearched: tuple[str, ...] = ()
    failure: str = ""


class Proofs:
    """Copies of a source with changes, which are run with its own numbers and with others."""

    def __init__(self, source: str, again: Again, goal: Goal, known: Sequence[float]) -> None:
        """Take the source, what reads a changed one, what it should give, and numbers of the robot."""
        self.source, self.again, self.goal = source, again, goal
        self._known = np.array(known)

    def agrees(self, source: str) -> bool:
        """Tell whether the functions of another source give what they should."""
        found = self.values(source)
        return found is not None and not any(self.goal.away(name, x).any() for name, x in found.items())

    def values(self, source: str) -> dict[str, Array] | None:
        """Return what the functions of another source give at all rows, None when they do not work."""
        goal = self.goal
        try:
            with impatient(), np.errstate(all="ignore"):
                given = partial(goal.call, self.again(source).calls)
                names = (name for name, x in goal.targets.items() if x.whole)
                return {name: stack_values(goal.targets[name], given, ROWS) for name in names}
        except BaseException:  # a name that is not there yet, or a module that never ends
            return None

    def with_doubts(self, repair: Repaired) -> Repaired:
        """Return a repair with its doubts."""
        slopes = self.goal.slopes
        if slopes is None:
            return repair

        def values(source: str) -> Array | None:
            found = self.values(source)
            if found is None:
                return None
            sizes = zip(slopes.names, slopes.sizes, strict=True)
            return np.concatenate([found[name].ravel() / size for name, size in sizes])

        text = " ".join(f"{one.old} {one.new}" for one in repair.changes)
        spelled = self._spelled(repair.source)
        found = check(spelled, values, slopes, text, whole=not repair.changes)
        wrong = found.wrong + sum(self._is_guess(one, found.seen > 0) for one in repair.changes)
        named = {name.strip("'").split(".")[-1] for name, _ in numbers(ast.parse(spelled))}
        wrong += sum(adds_unlike(x.new, named) and not adds_unlike(x.old, named) for x in repair.changes)
        sure = found.sure and wrong == found.other == 0
        # Numbers in each other's place may as well be names in each other's place.
        swapped = [ast.parse(one.old.strip()) for one in repair.changes if one.kind == "swapped"]
        sure = sure and all(map(names_in, swapped))
        # A name that nothing reads any more was meant to be read: its number may be wrong, not its use.
        renamed = [one.old for one in repair.changes if one.kind == "name"]
        sure = sure and all(is_read(old, repair.source) for old in renamed)
        for other in _by_ratios(self.source, repair.changes) if sure else ():
            as_good = check(other, values, slopes)
            sure = sure and as_good.wrong + as_good.other > 0
        return repair._replace(
            doubts=wrong,
            checked=found.seen,
            other=found.other,
            sure=sure,
            standing=found.standing,
            spelled=spelled,
            odd=found.names,
        )

    def _spelled(self, source: str) -> str:
        """Return a source with a number for every name, so that each can be varied alone."""
        try:
            with impatient():
                origin = self.again(source).origin
            return source if origin is None else spell_out(source, vars(origin.module))
        except BaseException:  # as everywhere, where a model runs
            return source

    def _is_guess(self, change: Change, named: bool) -> bool:
        """Tell whether a change puts a number that may explain anything: it is neither known nor a unit's.

        Args:
            change: the change.
            named: whether numbers have names: a formula in names lacks no bare number.
        """
        term = named and change.kind == "term"
        if change.kind == "value" or (term and is_number(change.old) and is_number(change.new)):
            return not self._is_known(change)
        return term and _is_bare(change.new)

    def _is_known(self, change: Change) -> bool:
        """Tell whether a change puts a number that the robot has too."""
        value = abs(float(change.new))
        return value in (0.0, 1.0) or bool((np.abs(self._known - value) <= 1e-6 * value).any())


def is_read(expression: str, source: str) -> bool:
    """Tell whether a source reads a name, an attribute of that name of any object, or an entry.

    Args:
        expression: such as ``l1``, ``p.l1`` or ``l[0]``.
        source: of a module, whose texts may be formulas.
    """
    try:
        wanted = ast.parse(expression.strip(), mode="eval").body
        tree = ast.parse(source)
    except SyntaxError:
        return True
    if not isinstance(wanted, ast.Name | ast.Attribute | ast.Subscript):
        return True
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and isinstance(wanted, ast.Name) and _is_read_in(node.value, wanted.id):  # type: ignore[attr-defined]
            return True
        if not isinstance(getattr(node, "ctx", None), ast.Load):
            continue
        if isinstance(wanted, ast.Attribute) and isinstance(node, ast.Attribute):
            if node.attr == wanted.attr:
                return True
        elif type(node) is type(wanted) and ast.unparse(node) == ast.unparse(wanted):
            return True
    return False


def _is_read_in(text: str, name: str) -> bool:
    """Tell whether a text, which may be a formula, has a name in it and is not the name alone."""
    return text != name and name in re.findall(r"\w+", text)


def _by_ratios(source: str, changes: Sequence[Change]) -> Iterator[str]:
    """Yield sources with a ratio of two names for a number that a change puts: 4 may be (N1 / N2)²."""
    names = readings(source)
    for k, change in enumerate(changes):
        text, before = change.new.strip(), {value for value, _ in _numbers_in(change.old.strip())}
        for value, node in _numbers_in(text):
            if value in before:
                continue
            for (one, a), (two, b), power in itertools.product(names.items(), names.items(), (1, 2)):
                if a != b and a * b and abs(value * (b / a) ** power - 1.0) <= 1e-9:
                    ratio = f"({one} / {two}) ** {power}"
                    new = change._replace(new=text[: node.col_offset] + ratio + text[node.end_col_offset :])
                    yield apply_changes(source, (*changes[:k], new, *changes[k + 1 :]))


def is_number(text: str) -> bool:
    """Tell whether a text is a number."""
    return text.lstrip("-").replace(".", "", 1).isdigit()


def _numbers_in(text: str) -> Iterator[tuple[float, ast.Constant]]:
    """Yield the numbers in an expression but for zeros, and where they stand; an operator has none."""
    for node in ast.walk(ast.parse(text)) if text not in ("=", "+=") else ():
        match node:
            case ast.Constant(value=int() | float() as value) if value:
                yield value, node


def _is_bare(text: str) -> bool:
    """Tell whether a text is, or adds, a number that means something only where no numbers have names."""
    statement: Any = ast.parse(text.strip()).body[0]
    node = statement.value
    added = is_sum(node)
    turns = any(isinstance(x, ast.Call) for x in ast.walk(node))  # 1 - cos(q) is usual
    parts = [node, node.right] if added and not turns else [node]
    bare = [x.value for x in parts if isinstance(x, ast.Constant) and type(x.value) in (int, float)]
    return any(x != 0 and (added or x not in (0.5, 1, 2)) for x in bare)
