"""Slips that are no single expression: a name overwritten before it is read, one slip at all such places.

These are tried on the source as it is. An assignment that overwrites a name which nothing has read yet is
taken away, before the search of single changes. Where that finds nothing, sine and cosine are swapped
throughout a line, a function or the file, and a square, or one name for another, is tried at all places that
differ by their digits alone (``m1 * lc1`` and ``m2 * lc2``).
"""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from armgpi.validation.course import seconds_used
from armgpi.validation.edits import ROWS, Change, apply_changes, harmless
from armgpi.validation.proofs import Repaired
from armgpi.validation.repair import Compared, agrees, proved_for_other_numbers

#: Slips that are tried, at most.
_MOST = 80
#: Time of the processor that they may take [s].
_SECONDS = 2.0
#: What a sine is mistaken for, and the other way round.
_SWAPPED = {"sin": "cos", "cos": "sin"}

Span = tuple[int, int, int, int]


class Slip(NamedTuple):
    """Changes that undo one slip.

    Attributes:
        kind: "overwritten" or "everywhere".
        text: what is wrong.
        places: what stands where, and what has to.
    """

    kind: str
    text: str
    places: tuple[tuple[Span, str, str], ...]

    @property
    def changes(self) -> tuple[Change, ...]:
        """The changes of the source."""
        return tuple(Change(self.kind, span, old, new, "", self.text, 1.0) for span, old, new in self.places)


def find_slip(compared: Compared, slips: Callable[[str], Iterator[Slip]]) -> Repaired | None:
    """Return the changes that undo one slip with which the model agrees, None without one.

    Args:
        compared: the model beside the robot.
        slips: yields those that are tried: `overwritten` or `everywhere`.
    """
    source = compared.worker.source
    if source is None or not harmless(source):
        return None
    few, late = compared.states.first(ROWS), seconds_used() + min(_SECONDS, compared.seconds_left)
    for slip in itertools.islice(slips(source), _MOST):
        if seconds_used() > late:
            compared.course.unsearched.append("one slip at several places")
            return None
        changed = apply_changes(source, slip.changes)
        if not agrees(compared.worker, changed, few, compared.problem):
            continue
        if agrees(compared.worker, changed, compared.states, compared.problem):
            return proved_for_other_numbers(compared, Repaired(slip.changes, changed))
    return None


def overwritten(source: str) -> Iterator[Slip]:
    """Yield the assignments of a source that overwrite a name before anything reads it."""
    lines = source.splitlines()
    for body in _bodies(ast.parse(source)):
        given: dict[str, int] = {}
        for statement in body:
            read = {
                x.id for x in ast.walk(statement) if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Load)
            }
            given = {name: line for name, line in given.items() if name not in read}
            name = _plain_target(statement)
            if name is None:
                # A branch or a loop may read it, or give it a value, in any order.
                given = {} if not isinstance(statement, ast.Assign | ast.Expr) else given
                continue
            if name in given and len(body) > 1:
                text = ast.unparse(statement)
                what = f"line {statement.lineno}: {text} overwrites {name} of line {given[name]}"
                place = _whole_lines(statement, lines)
                yield Slip("overwritten", f"{what} before anything reads that", (place,))
            given[name] = statement.lineno


def _bodies(tree: ast.Module) -> Iterator[list[ast.stmt]]:
    """Yield the lists of statements of a module and of its functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.FunctionDef):
            yield node.body


def _plain_target(statement: ast.stmt) -> str | None:
    match statement:
        case ast.Assign(targets=[ast.Name(id=name)]):
            return name
    return None


def _whole_lines(statement: ast.stmt, lines: list[str]) -> tuple[Span, str, str]:
    """Return the lines of a statement as what stands there; one that says nothing has to."""
    first, last = statement.lineno, statement.end_lineno or statement.lineno
    span = (first, statement.col_offset, last, statement.end_col_offset or 0)
    return span, "\n".join(lines[first - 1 : last]).strip(), "pass"


def everywhere(source: str) -> Iterator[Slip]:
    """Yield one slip at all analogous places of a line, of a function and of the file."""
    tree = ast.parse(source)
    functions = [x for x in ast.walk(tree) if isinstance(x, ast.FunctionDef)]
    scopes: list[ast.AST] = [*functions, tree]
    partners = _partners(tree)
    for scope in [*_statements(functions), *scopes]:
        yield from _swapped(scope, partners)
    for scope in scopes:
        yield from _alike(scope)


def _statements(functions: Sequence[ast.FunctionDef]) -> Iterator[ast.AST]:
    for function in functions:
        yield from (x for x in ast.walk(function) if isinstance(x, ast.Assign | ast.Return | ast.AugAssign))


def _partners(tree: ast.AST) -> dict[str, str]:
    """Return the names of sines -> those of the cosines of the same angle, and the other way round."""
    held: dict[str, tuple[str, str]] = {}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Assign):
            continue
        pairs = [(node.targets[0], node.value)]
        if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
            pairs = [*zip(node.targets[0].elts, node.value.elts, strict=False)]
        for target, value in pairs:
            if isinstance(target, ast.Name) and isinstance(value, ast.Call) and len(value.args) == 1:
                held[target.id] = (_function(value), ast.unparse(value.args[0]))
    found = {}
    for name, (function, angle) in held.items():
        for other, what in held.items():
            if what == (_SWAPPED.get(function), angle):
                found[name] = other
    return found


def _function(call: ast.Call) -> str:
    """Return the name of a function that is called, without its module."""
    return str(getattr(call.func, "attr", getattr(call.func, "id", "")))


def _swapped(scope: ast.AST, partners: Mapping[str, str]) -> Iterator[Slip]:
    """Yield sine and cosine in each other's place throughout, with the names that hold them."""
    places = []
    one_line = isinstance(scope, ast.stmt) and not isinstance(scope, ast.FunctionDef)
    for node in ast.walk(scope):
        if isinstance(node, ast.Call) and _function(node) in _SWAPPED:
            old, name = ast.unparse(node.func), _function(node)
            places.append((_span(node.func), old, old[: -len(name)] + _SWAPPED[name]))
        elif one_line and isinstance(node, ast.Name) and _is_read(node) and node.id in partners:
            places.append((_span(node), node.id, partners[node.id]))
    if len(places) > 1:
        yield _slip("sine and cosine are in each other's place", places)


def _alike(scope: ast.AST) -> Iterator[Slip]:
    """Yield a square, or one name for another, at all places that differ by their digits alone."""
    names = [x for x in ast.walk(scope) if isinstance(x, ast.Name | ast.Attribute) and _is_read(x)]
    squares = [x for x in ast.walk(scope) if isinstance(x, ast.BinOp) and isinstance(x.op, ast.Pow)]
    bases = {id(x.left) for x in squares}
    groups: dict[str, list[ast.expr]] = {}
    for name in names:
        if id(name) not in bases and re.search(r"\d", ast.unparse(name)):
            groups.setdefault(_pattern(name), []).append(name)
    existing = {ast.unparse(name) for name in names}
    for pattern, found in groups.items():
        if len({ast.unparse(x) for x in found}) < 2:
            continue
        shown = pattern.replace("#", "1")
        squared = [(_span(x), ast.unparse(x), f"{ast.unparse(x)}**2") for x in found]
        yield _slip(f"a square of {shown} and the like is missing", squared)
        for other in {_pattern(ast.parse(text, mode="eval").body) for text in existing} - {pattern}:
            renamed = [(_span(x), ast.unparse(x), _renamed(x, pattern, other)) for x in found]
            if other.count("#") == pattern.count("#") and {new for _, _, new in renamed} <= existing:
                text = f"{shown} and the like should be {other.replace('#', '1')} and the like"
                yield _slip(text, renamed)
    powers: dict[str, list[ast.BinOp]] = {}
    for square in squares:
        powers.setdefault(_pattern(square), []).append(square)
    for pattern, several in powers.items():
        if len({ast.unparse(x) for x in several}) > 1:
            shown = pattern.replace("#", "1")
            bare = [(_span(x), ast.unparse(x), ast.unparse(x.left)) for x in several]
            yield _slip(f"{shown} and the like are squares too much", bare)


def _slip(text: str, places: list[tuple[Span, str, str]]) -> Slip:
    lines = ", ".join(dict.fromkeys(str(span[0]) for span, _, _ in sorted(places)))
    plural = "lines" if "," in lines else "line"
    return Slip("everywhere", f"{plural} {lines}: {text}, at {len(places)} places", tuple(places))


def _is_read(node: ast.Name | ast.Attribute) -> bool:
    return isinstance(node.ctx, ast.Load)


def _pattern(node: ast.expr) -> str:
    """Return an expression with a mark in place of each number in its names."""
    return re.sub(r"(?<=[A-Za-z_])\d+", "#", ast.unparse(node))


def _renamed(node: ast.expr, pattern: str, other: str) -> str:
    """Return a name of another pattern with the digits of this one."""
    digits = iter(re.findall(r"(?<=[A-Za-z_])\d+", ast.unparse(node)))
    return re.sub("#", lambda _: next(digits, "#"), other)


def _span(node: ast.expr) -> Span:
    end_line, end = node.end_lineno or node.lineno, node.end_col_offset or 0
    return node.lineno, node.col_offset, end_line, end
