"""Mistakes made by mutation of the syntax trees of right models, and whether a repair undoes them.

Every mistake is one that people make: a sign, a factor, a square, sin for cos, a name or an index for
another, a term or a cross product that is dropped, a rotation that is transposed, degrees, a unit, a and d
swapped.
"""

from __future__ import annotations

import ast
import copy
import re
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import textbooks

from armgpi.validation.models import ARGUMENTS, resolve


class Mutant(NamedTuple):
    """A model with mistakes: arm, kinds of the mistakes, the source with them and the right one."""

    arm: str
    kinds: tuple[str, ...]
    source: str
    right: str


Change = tuple[str, ast.AST]


def mutate(source: str, rng: np.random.Generator) -> tuple[str, str]:
    """Return a random kind of mistake and the source with one of that kind."""
    tree = ast.parse(source)
    by_kind = defaultdict(list)
    for node, parent, field, index, scope in _expressions(tree):
        for kind, new in _changes(node, parent, field, scope):
            by_kind[kind].append((parent, field, index, new))
    kind = sorted(by_kind)[rng.integers(len(by_kind))]
    _put(*by_kind[kind][rng.integers(len(by_kind[kind]))])
    return kind, ast.unparse(tree) + "\n"


def draw(arm: str, count: int, seed: int, mistakes: int = 1) -> list[Mutant]:
    """Return random mutants of one arm with random numbers, all of them different from the right model."""
    rng = np.random.default_rng([seed, *arm.encode()])
    found: dict[str, Mutant] = {}
    for attempt in range(20 * count):
        right = textbooks.text(arm, int(rng.integers(2**31)) if attempt else None)
        source, kinds = right, []
        for _ in range(mistakes):
            kind, source = mutate(source, rng)
            kinds.append(kind)
        # A second mistake may undo the first one, or raise.
        if len(found) < count and not _equal_or_broken(source, right):
            found[source] = Mutant(arm, tuple(kinds), source, right)
    return list(found.values())


def same(one: str, other: str, redraw: int | None = None) -> bool:
    """Tell whether two sources are equal as expressions: at random states, and for other numbers."""
    seeds = [None] if redraw is None else [None, redraw]
    for seed in seeds:
        a, b = (_sampled(_renumbered(text, seed), textbooks.joints(other)) for text in (one, other))
        if a is None or b is None or a.keys() != b.keys():
            return False
        if any(np.abs(a[k] - b[k]).max() > 1e-8 * max(1e-3, np.abs(b[k]).max()) for k in a):
            return False
    return True


def _equal_or_broken(source: str, right: str) -> bool:
    with np.errstate(all="ignore"):
        values = _sampled(source, textbooks.joints(right))
    return values is None or same(source, right)


def _renumbered(source: str, seed: int | None) -> str:
    return source if seed is None else textbooks.renumbered(source, seed)


def _sampled(source: str, n: int) -> dict[str, np.ndarray] | None:
    """Return what the functions of a source of n joints give at random states; None when they do not work."""
    rng = np.random.default_rng(5)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"m{abs(hash(source))}.py"
        path.write_text(source, encoding="utf-8")
        try:
            functions = resolve(str(path))
            values = {}
            for name, function in functions.calls.items():
                states = [rng.uniform(0.1, 1.4, (len(ARGUMENTS[name]), n)) for _ in range(3)]
                rows = [function(*state) for state in states]
                rows = [r.tolist() if hasattr(r, "tolist") else r for r in rows]
                values[name] = np.array(rows, dtype=float)
        except Exception:
            return None
    return values if all(np.isfinite(x).all() for x in values.values()) else None


def _expressions(tree: ast.AST) -> Iterator[tuple[ast.AST, ast.AST, str, int | None, set[str]]]:
    """Yield every expression with its place and the names beside it."""
    stack: list[tuple[ast.AST, set[str]]] = [(tree, _names(tree, top=True))]
    while stack:
        parent, scope = stack.pop()
        if isinstance(parent, ast.FunctionDef):
            scope = scope | _names(parent, top=False)
        for field, value in ast.iter_fields(parent):
            for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
                if not isinstance(child, ast.AST) or isinstance(
                    child, ast.Import | ast.ImportFrom | ast.arguments
                ):
                    continue
                stack.append((child, scope))
                if isinstance(child, ast.expr) and field not in ("func", "targets", "decorator_list"):
                    yield child, parent, field, index, scope


def _names(tree: ast.AST, top: bool) -> set[str]:
    """Return the names that are assigned: in a module itself, or anywhere in a function."""
    nodes = tree.body if top else list(ast.walk(tree))  # type: ignore[attr-defined]
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Assign):
            for target in node.targets:
                found |= {x.id for x in ast.walk(target) if isinstance(x, ast.Name)}
    return found


def _put(parent: ast.AST, field: str, index: int | None, new: ast.AST) -> None:
    if index is None:
        setattr(parent, field, new)
    else:
        getattr(parent, field)[index] = new


def _changes(node: ast.AST, parent: ast.AST, field: str, scope: set[str]) -> Iterator[Change]:
    """Yield the mistakes that can be made at one expression."""
    match node:
        case ast.BinOp():
            yield from _of_operation(node, parent)
        case ast.UnaryOp():
            yield from _of_sign(node)
        case ast.Call():
            yield from _of_call(node)
        case ast.Attribute(attr="T", value=inner):
            yield "transposed", inner
        case ast.Name(ctx=ast.Load()):
            yield from _of_name(node, scope)
        case ast.Subscript(ctx=ast.Load()):
            yield from _of_subscript(node)
        case ast.Constant(value=float() as x) if isinstance(parent, ast.Assign | ast.Dict):
            if x not in (0, 9.81):
                yield "unit", ast.Constant(x * 1000.0)
                yield "value", ast.Constant(round(x * 1.3, 5))
        case ast.Tuple(elts=[_, _, _, *_]) if isinstance(parent, ast.List):
            yield from _of_row(node)


def _of_row(node: ast.Tuple) -> Iterator[Change]:
    """Yield a row of a table with two neighbours swapped."""
    items = node.elts
    for k in range(len(items) - 1):
        if ast.dump(items[k]) != ast.dump(items[k + 1]):
            swapped = [*items[:k], items[k + 1], items[k], *items[k + 2 :]]
            yield "swapped", ast.Tuple(swapped, ast.Load())


def _of_sign(node: ast.UnaryOp) -> Iterator[Change]:
    if isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        yield "sign", node.operand


def _of_operation(node: ast.BinOp, parent: ast.AST) -> Iterator[Change]:
    left, op, right = node.left, node.op, node.right
    match op:
        case ast.Add() | ast.Sub():
            other = ast.Sub() if isinstance(op, ast.Add) else ast.Add()
            yield "sign", ast.BinOp(left, other, right)
            kind = "cross" if "cross" in ast.dump(right) else "term"
            yield kind, left
            if isinstance(op, ast.Add):
                yield "term", right
        case ast.Mult():
            for one, rest in ((left, right), (right, left)):
                kind = "factor" if isinstance(one, ast.Constant) else "product"
                yield kind, rest
            if not isinstance(parent, ast.BinOp):
                yield "factor", ast.BinOp(ast.Constant(2), ast.Mult(), node)
                yield "sign", ast.UnaryOp(ast.USub(), node)
        case ast.Pow():
            yield "square", left
        case ast.MatMult() if isinstance(left, ast.Subscript) and "R" in ast.dump(left):
            yield "transposed", ast.BinOp(ast.Attribute(left, "T", ast.Load()), op, right)


def _of_call(node: ast.Call) -> Iterator[Change]:
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if name in ("sin", "cos"):
        func = copy.deepcopy(node.func)
        setattr(func, "attr" if isinstance(func, ast.Attribute) else "id", "cos" if name == "sin" else "sin")
        yield "trig", ast.Call(func, node.args, [])
        turned = ast.BinOp(node.args[0], ast.Mult(), ast.Constant(0.017453292519943295))
        yield "degrees", ast.Call(node.func, [turned], [])
        shifted = ast.BinOp(node.args[0], ast.Add(), ast.Constant(1.5707963267948966))
        yield "offset", ast.Call(node.func, [shifted], [])
    if name == "cross":
        yield "cross", ast.Call(node.func, node.args[::-1], [])


def _family(name: str) -> str:
    """Return what kind of thing a name is: a mass, a length, an inertia, a cosine or sine, a vector."""
    if re.fullmatch(r"[cs]\d+", name):
        return "trig"
    if re.fullmatch(r"(l|lc|a|d|L|r)\d+", name):
        return "length"
    return re.sub(r"\d+", "#", name)


def _of_name(node: ast.Name, scope: set[str]) -> Iterator[Change]:
    for other in sorted(scope):
        if other != node.id and _family(other) == _family(node.id) and any(map(str.isdigit, other)):
            yield "name", ast.Name(other, ast.Load())


def _of_subscript(node: ast.Subscript) -> Iterator[Change]:
    match node.slice:
        case ast.Constant(value=int() as k) if isinstance(node.value, ast.Name):
            for other in (k - 1, k + 1):
                if 0 <= other <= 2:
                    yield "index", ast.Subscript(node.value, ast.Constant(other), node.ctx)
        case ast.Tuple(elts=[ast.Name(), ast.Name(), *_] as items):
            for k in range(len(items) - 1):
                swapped = [*items[:k], items[k + 1], items[k], *items[k + 2 :]]
                yield "index", ast.Subscript(node.value, ast.Tuple(swapped, ast.Load()), node.ctx)
