"""A wrong number in the source: the one of which another value makes the model agree.

Every number that a source states is varied by running the model with two others. What the model says of the
arm (D, the products of velocities, G) is then known as a polynomial of it, and the value is solved for with
which all agrees. A number that moves what agrees already is right. It needs no name of it in the robot, and
finds a mistyped mass whose wrong value is that of another link, or a default of a dataclass.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import ModelError
from armgpi.validation import samples
from armgpi.validation.course import seconds_used
from armgpi.validation.edits import GRAVITY, Change, apply_changes, harmless
from armgpi.validation.entries import Span, alike, entry_at
from armgpi.validation.phrasing import known_numbers
from armgpi.validation.problem import Mask
from armgpi.validation.proofs import Repaired
from armgpi.validation.repair import GLANCED, Compared, agrees, proved_for_other_numbers
from armgpi.validation.units import numbers
from armgpi.validation.worker import Worker

#: Numbers of a source that are varied, at most.
_MOST = 40
#: Time of the processor that varying them may take [s]. Equations that SymPy derives anew take a second each;
#: others take 2 s in all, several times as long where the machine is busy.
_SECONDS = 10.0
#: Shares of a number at which the model is looked at: of no symmetry.
_SHARES = (1.0, 0.6, 1.5, 2.1)
#: Digits that a typed number has, at most.
_DIGITS = 9
#: A number of more digits than this that the robot does not have was meant by nobody.
_MEANT_DIGITS = 4
#: A value that is solved for is known to this share of itself.
_EXACT = 1e-6
#: A smaller share of a number is none of it [-]: shares are solved for with some 1e-15 of rounding.
_NONE_OF_IT = 1e-12
#: A number inside of a text, which is read when the model runs (JSON, a table).
_IN_TEXT = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:[eE][-+]?\d+)?(?![\w.])")
#: A text with fewer numbers is no table of them.
_TABLE = 3


class Typed(NamedTuple):
    """A number that a source states.

    Attributes:
        name: what it is given to; "" inside of a text.
        line: from 1.
        start: first column, in UTF-8 bytes.
        end: column after the last.
        text: as it is written.
    """

    name: str
    line: int
    start: int
    end: int
    text: str

    @property
    def value(self) -> float:
        """The number."""
        return float(self.text)

    def change(self, new: str) -> Change:
        """Return the change that puts another number in its place."""
        return Change("value", self.span, self.text, new, "", self.name or "number", 1.0)

    @property
    def span(self) -> tuple[int, int, int, int]:
        """First line, first column, last line, last column."""
        return self.line, self.start, self.line, self.end


#: Where one number stands: once, or on several lines.
Places = tuple[Typed, ...]


def typed_numbers(source: str) -> list[Typed]:
    """Return the numbers that a source states: those with a name, and those in tables of text."""
    tree = ast.parse(source)
    lines = source.splitlines()
    named = [_typed(name.strip("'"), node, lines) for name, node in numbers(tree)]
    places_of_named = {(number.line, number.start) for number in named}
    gravities = [
        number for number in _gravities(tree, lines) if (number.line, number.start) not in places_of_named
    ]
    in_tables = _in_tables(tree, lines)
    return [number for number in (*named, *gravities, *in_tables) if _is_varied(number)]


def _typed(name: str, node: ast.Constant, lines: Sequence[str]) -> Typed:
    """Return a number of a source, given its lines, as it is written there."""
    start, end = node.col_offset, node.end_col_offset or 0
    text = lines[node.lineno - 1].encode()[start:end].decode()
    return Typed(name, node.lineno, start, end, text)


def _is_varied(number: Typed) -> bool:
    try:
        return number.value != 0.0 and number.name not in ("n", "N")
    except ValueError:  # 1_000, 0x10
        return False


def _gravities(tree: ast.Module, lines: list[str]) -> Iterator[Typed]:
    """Yield what stands for gravity inside of formulas, where it needs no name."""
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=float() as value) if value in GRAVITY:
                yield _typed("gravity", node, lines)


def _in_tables(tree: ast.Module, lines: list[str]) -> Iterator[Typed]:
    """Yield the numbers in texts that have several, but for docstrings."""
    nodes = list(ast.walk(tree))
    documentation = {node.value for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
            continue
        if node in documentation or len(_IN_TEXT.findall(node.value)) < _TABLE:
            continue
        last = node.end_lineno or node.lineno
        for line in range(node.lineno, last + 1):
            text = lines[line - 1]
            for match in _IN_TEXT.finditer(text):
                start = len(text[: match.start()].encode())
                yield Typed("", line, start, start + len(match.group()), match.group())


def find_wrong_number(compared: Compared) -> Repaired | None:
    """Return the one number of the source of which another value makes the model agree, None without one.

    Where several would do, each alone, the one is that becomes a number of the robot: without one, or with
    several, nothing tells which is wrong. A number that several functions have as the default of an argument
    is one number.
    """
    source = compared.worker.source
    if source is None or not harmless(source) or compared.problem.is_passive:
        return None
    numbers_of_source = typed_numbers(source)
    if len(numbers_of_source) > _MOST:
        return None
    with _Search(compared, source) as search:
        return _found_among(numbers_of_source, search, compared)


def _found_among(numbers_of_source: Sequence[Typed], search: _Search, compared: Compared) -> Repaired | None:
    """Return the one of some numbers of which another value makes the model agree, None without one."""
    late = search.seconds_used() + min(_SECONDS, compared.seconds_left)
    robots_numbers = np.array([value for value, _ in known_numbers(compared.problem.tree)])
    for candidates in (_alone(numbers_of_source), _repeated(numbers_of_source)):
        repairs: list[Repaired] = []
        for places in candidates:
            if search.seconds_used() >= late:
                break
            repair = search.repair(places)
            if repair is not None:
                repairs.append(repair)
        if search.seconds_used() >= late:
            compared.course.unsearched.append("wrong numbers")
        # A mass and a length, say, of which one becomes a number of the robot; or not all were tried.
        if len(repairs) > 1 or (repairs and search.seconds_used() >= late):
            repairs = [repair for repair in repairs if _is_among(robots_numbers, _new_number(repair))]
            return proved_for_other_numbers(compared, repairs[0]) if len(repairs) == 1 else None
        # A formula is wrong sooner than a number is that nobody typed and the robot does not have.
        if not repairs:
            continue
        new = _new_number(repairs[0])
        if _may_be_typed(new) or _is_among(robots_numbers, new):
            return proved_for_other_numbers(compared, repairs[0])
    return None


def _new_number(repair: Repaired) -> str:
    """Return the number that a repair puts in the place of a wrong one."""
    return repair.changes[0].new


def _is_among(robots_numbers: Array, new: str) -> bool:
    """Tell whether a number is one of the robot's, shape (k,)."""
    return bool(np.isclose(robots_numbers, float(new), _EXACT).any())


def _may_be_typed(new: str) -> bool:
    """Tell whether a number has so few digits that somebody may have meant it."""
    mantissa, _, _ = new.lower().partition("e")
    digits = [character for character in mantissa if character.isdigit()]
    return len("".join(digits).strip("0")) <= _MEANT_DIGITS


def doubted(compared: Compared, found: Repaired) -> Repaired:
    """Return a wrong number as a candidate where another number of the source may belong in its place.

    A model that reads l[1] where l[0] belongs agrees with another l[1]: that of l[0]. Nothing tells the two
    mistakes apart where the value that is missing stands in the same list, or beside it in the same
    dictionary or record under a name that differs by its digits, or anywhere and nothing depends on it.
    """
    source = compared.worker.source
    if source is None:
        return found
    typed = typed_numbers(source)
    names = {number.span: number.name for number in typed}
    for change in found.changes:
        if change.kind != "value" and change.span not in names:
            return found
    changed_spans = {change.span for change in found.changes}
    others = [number for number in typed if number.span not in changed_spans]
    with _Search(compared, source) as search:
        instead = _other_place(ast.parse(source), found, names, others, search)
    return found._replace(sure=False, instead=instead) if instead else found


def _other_place(
    tree: ast.Module,
    found: Repaired,
    names: Mapping[Span, str],
    others: Sequence[Typed],
    search: _Search,
) -> str:
    """Return which other number of the source may belong where a change is; "" when there is none.

    Args:
        tree: the source.
        found: the changes.
        names: span of a number -> its name.
        others: the numbers that are not changed.
        search: runs the model with other numbers.
    """
    for change in found.changes:
        entry = entry_at(tree, change.span)
        changed_name = entry.named(names.get(change.span) or change.name.strip("'"))
        for other in others:
            if not _is_as_large(other, change.new):
                continue
            other_entry = entry_at(tree, other.span)
            other_name = other_entry.named(other.name)
            # One number that is the default of an argument of several functions has one name.
            if other_name == changed_name and other_entry.holder is None:
                continue
            places = [other] if other_entry.holder else _stated_alike(other, others)
            unread = search.is_unread(tuple(places))
            beside = entry.holder is not None and entry.holder is other_entry.holder
            if unread or (beside and (entry.indices or alike(changed_name, other_name))):
                number = f"another {other_name}" if other_name == changed_name else other_name or other.text
                reason = ", and nothing depends on it" if unread else ""
                value = f"{number} in line {other.line} has that value{reason}"
                return f"{value}: it may belong in place of {changed_name}"
    return ""


def _is_as_large(number: Typed, new: str) -> bool:
    """Tell whether a number is what another becomes, up to its sign; what is no plain number is none."""
    try:
        return bool(np.isclose(abs(number.value), abs(float(new)), _EXACT, 0.0))
    except ValueError:
        return False


def _stated_alike(number: Typed, numbers_of_source: Sequence[Typed]) -> list[Typed]:
    """Return the numbers that have the same name and are written in the same way."""
    key = (number.name, number.text)
    return [other for other in numbers_of_source if (other.name, other.text) == key]


def _alone(numbers_of_source: Sequence[Typed]) -> list[Places]:
    """Return every number as a candidate of its own."""
    return [(number,) for number in numbers_of_source]


def _repeated(numbers_of_source: Sequence[Typed]) -> list[Places]:
    """Return the numbers that are stated on several lines under one name."""
    groups: dict[tuple[str, str], list[Typed]] = {}
    for number in numbers_of_source:
        if number.name:
            groups.setdefault((number.name, number.text), []).append(number)
    candidates = []
    for places in groups.values():
        lines = {number.line for number in places}
        if len(lines) > 1:
            candidates.append(tuple(places))
    return candidates


class _Search:
    """A model that is run with other numbers, all in one process; a context manager, which ends that."""

    def __init__(self, compared: Compared, source: str) -> None:
        self._compared = compared
        self._source = source
        self._twin: Worker | None = None
        problem = compared.problem
        self._few = compared.states.first(GLANCED)
        self._right = problem.agreeing
        self._target = problem.reference[:GLANCED] / problem.tolerance
        self._start = problem.user[:GLANCED] / problem.tolerance
        took = compared.worker.takes
        self._fast_first = sorted(compared.names, key=lambda name: took.get(name, 0.0))

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self._end()

    def _end(self) -> None:
        if self._twin is not None:
            self._twin.close()
        self._twin = None

    def seconds_used(self) -> float:
        """Return the processor time that this process and those of models have used [s]."""
        return seconds_used() + (0.0 if self._twin is None else self._twin.seconds)

    def _read(self, source: str) -> Worker:
        """Return the process after it has read another source."""
        if self._twin is None:
            self._twin = self._compared.worker.again(source)
        else:
            self._twin.reread(source)
        return self._twin

    def repair(self, places: Places) -> Repaired | None:
        """Return the change of a number with which the model agrees, None when there is none."""
        fast = self._fast_first[:1]
        of_fast = self._compared.problem.of_function(fast[0])
        is_fast_wrong = bool((of_fast & ~self._right).any())
        has_others = len(self._fast_first) > 1 and is_fast_wrong
        # What does not explain the fast function does not explain all.
        if has_others and self._explaining_share(places, fast) is None:
            return None
        nearest = self._explaining_share(places, self._fast_first)
        if nearest is None:
            return None
        if abs(nearest) < _NONE_OF_IT:
            nearest = 0.0
        new = _shortest(nearest * places[0].value)
        changes = tuple(number.change(new) for number in places)
        source = apply_changes(self._source, changes)
        problem = self._compared.problem
        if not agrees(self._compared.worker, source, self._compared.states, problem):
            return None
        return Repaired(changes, source)

    def _explaining_share(self, places: Places, names: Sequence[str]) -> float | None:
        """Return the share of a number with which some functions agree, None without one."""
        value = places[0].value
        first = self._columns(places, _SHARES[1] * value, names, may_move=~self._right)
        if first is None or not self._may_be_wrong(first):
            return None
        values = [self._start, first]
        for share in _SHARES[2:]:
            columns = self._columns(places, share * value, names)
            if columns is None:
                return None
            values.append(columns)
        rows = min(map(len, values))
        of_names = np.isin(self._compared.problem.functions, names)
        at_shares = np.stack([columns[:rows, of_names] for columns in values])
        return _nearest_share(at_shares, self._target[:rows, of_names])

    def is_unread(self, places: Places) -> bool:
        """Tell whether another value of a number leaves all that the model gives."""
        nothing = np.zeros_like(self._right)
        value = _SHARES[2] * places[0].value
        columns = self._columns(places, value, self._fast_first, may_move=nothing)
        if columns is None:
            return False
        return bool((self._moves(columns) <= 1.0).all())

    def _may_be_wrong(self, columns: Array) -> bool:
        """Tell whether a number moves something that differs, and nothing that agrees."""
        moved = self._moves(columns) > 1.0
        moves_wrong = bool((moved & ~self._right).any())
        moves_right = bool((moved & self._right).any())
        return moves_wrong and not moves_right

    def _moves(self, columns: Array) -> Array:
        """Return how far the elements move at most, over the tolerances; a slow model has fewer rows."""
        rows = min(len(columns), len(self._start))
        differences = np.abs(columns[:rows] - self._start[:rows])
        return np.asarray(differences.max(axis=0))

    def _columns(
        self,
        places: Places,
        value: float,
        names: Sequence[str],
        may_move: Mask | None = None,
    ) -> Array | None:
        """Return what the model gives with another number, over the tolerances.

        None where it fails, or where it moves an element that it may not: the functions are called one after
        the other, up to that. Elements of other functions are NaN.

        Args:
            places: where the number stands.
            value: the other number.
            names: the functions that are called.
            may_move: the elements that it may move; all when not given.
        """
        problem = self._compared.problem
        changes = tuple(number.change(repr(value)) for number in places)
        source = apply_changes(self._source, changes)
        sampled: dict[str, samples.Sampled] = {}
        try:
            worker = self._read(source)
            for name in names:
                sampled |= samples.glance(worker, self._few, problem.noise, [name])
                if not problem.has_layout_of(sampled):
                    return None
                quantities = {function: of.quantities for function, of in sampled.items()}
                columns = np.asarray(problem.user_columns(quantities, GLANCED) / problem.tolerance)
                moved = self._moves(columns) > 1.0
                if may_move is not None and moved[~may_move].any():
                    return None
        except ModelError:
            self._end()
            return None
        return columns


def _nearest_share(values: Array, target: Array) -> float | None:
    """Return the share of a number with which values come nearest to a target; None where they stay away.

    Args:
        values: at the shares above, (4, ...), of a cubic polynomial.
        target: what they should be.
    """
    count = len(_SHARES)
    powers = np.vander(np.array(_SHARES), count, increasing=True)
    coefficients = np.linalg.solve(powers, values.reshape(count, -1))
    coefficients[0] -= target.ravel()
    if not np.isfinite(coefficients).all():
        return None
    # The squared distance is a polynomial of degree six; its least value is where its derivative is zero.
    gram = coefficients @ coefficients.T
    squared = np.zeros(2 * count - 1)
    for i, row in enumerate(gram):
        squared[i : i + len(row)] += row
    size = max(np.abs(squared).max(), 1e-300)
    derivative = (squared[1:] * np.arange(1, len(squared))) / size
    roots = np.roots(derivative[::-1])
    # A sign that is wrong is wrong in a formula sooner than in a number.
    is_real = np.abs(roots.imag) <= 1e-4 * np.abs(roots)
    real = roots.real[is_real & (roots.real > 0.0)]
    if not len(real):
        return None
    exponents = np.arange(count)
    differences = [float(np.abs((share**exponents) @ coefficients).max()) for share in real]
    best = int(np.argmin(differences))
    before = float(np.abs(coefficients.sum(axis=0)).max())
    share = float(real[best])
    explains = differences[best] <= 1e-3 * before
    return share if explains and abs(share - 1.0) > _EXACT else None


def _shortest(value: float) -> str:
    """Return a number with as few digits as it takes."""
    for digits in range(1, _DIGITS):
        text = f"{value:.{digits}g}"
        if abs(float(text) - value) <= _EXACT * abs(value):
            return text
    return f"{value:.{_DIGITS}g}"
