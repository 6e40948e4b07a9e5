"""Entries of lists, dictionaries and records in a source: names, and what is beside them."""

from __future__ import annotations

import ast
import re
from typing import NamedTuple

Span = tuple[int, int, int, int]


class Entry(NamedTuple):
    """Where a number stands.

    Attributes:
        indices: from the outermost list to the number; () outside of lists.
        holder: of the outermost list, else of the dictionary, call or class that has it by a name; None for
            a number that stands alone.
    """

    indices: tuple[int, ...]
    holder: ast.AST | None

    def named(self, name: str) -> str:
        """Return the name of the whole with the index of the entry."""
        return name + "".join(f"[{k}]" for k in self.indices)


def entry_at(tree: ast.Module, span: Span) -> Entry:
    """Return where the number at a span stands; alone where there is none.

    Args:
        tree: of the whole source.
        span: first line, first column, last line, last column of it, with or without its sign.
    """
    nodes = list(ast.walk(tree))
    parents = {child: node for node in nodes for child in ast.iter_child_nodes(node)}
    expressions = (node for node in nodes if isinstance(node, ast.expr))
    node = next((expression for expression in expressions if _ends(expression) == span), None)
    indices: tuple[int, ...] = ()
    outermost: ast.AST | None = None
    while node is not None:
        parent = parents.get(node)
        if isinstance(parent, ast.List | ast.Tuple) and not _is_unpacked(parent, parents):
            indices = (parent.elts.index(node), *indices)
            outermost = parent
        elif not (isinstance(parent, ast.UnaryOp) or _only_keeps(parent, node)):
            break
        node = parent if isinstance(parent, ast.expr) else None
    if node is None or not _is_given(parents.get(node)):
        return Entry((), None)
    return Entry(indices, outermost or _record(parents[node], parents))


def shown(source: str, name: str, span: Span) -> str:
    """Return what a number at a span is called: its name, of a list with the index."""
    if not name:
        return ""
    return entry_at(ast.parse(source), span).named(name.strip("'"))


def alike(name: str, other: str) -> bool:
    """Tell whether two names differ by their digits alone: l1 and l2, link_1 and link_2."""
    without_digits, other_without_digits = (re.sub(r"\d+", "", text) for text in (name, other))
    return without_digits == other_without_digits


def _ends(node: ast.expr) -> Span:
    last_line = node.end_lineno or node.lineno
    return node.lineno, node.col_offset, last_line, node.end_col_offset or 0


def _is_unpacked(node: ast.List | ast.Tuple, parents: dict[ast.AST, ast.AST]) -> bool:
    """Tell whether each entry gets a name of its own."""
    match parents.get(node):
        case ast.Assign(targets=[ast.Tuple() | ast.List()]):
            return True
    return False


def _only_keeps(call: ast.AST | None, argument: ast.AST) -> bool:
    """Tell whether a call is that of an array of a list, or has one argument alone."""
    if not isinstance(call, ast.Call) or call.args[:1] != [argument]:
        return False
    return len(call.args) == 1 or isinstance(argument, ast.List | ast.Tuple)


def _is_given(parent: ast.AST | None) -> bool:
    kinds = ast.Assign | ast.AnnAssign | ast.Dict | ast.keyword | ast.arguments | ast.Tuple | ast.List
    return isinstance(parent, kinds)


def _record(parent: ast.AST | None, parents: dict[ast.AST, ast.AST]) -> ast.AST | None:
    """Return the dictionary, call or class that has a number by a name; None without one."""
    if isinstance(parent, ast.Dict):
        return parent
    above = parents.get(parent) if parent is not None else None
    return above if isinstance(above, ast.ClassDef | ast.Call) else None
