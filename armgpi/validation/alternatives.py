"""What may stand in place of an expression when someone has made a mistake there.

Everything is a change of Python's syntax tree. The kinds are those of mistakes: "sign", "factor", "square",
"trig", "angle", "degrees", "name", "index", "transposed", "cross", "term", "sum", "extra", "product",
"swapped", "inverse".
Whether a choice means anything is not asked here: it is compiled and tried.
"""

from __future__ import annotations

import ast
import copy
import itertools
import math
import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from types import FunctionType
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from armgpi.validation.graph import Expression, joint_of

Choice = tuple[str, ast.expr]

#: Numbers from this on may be angles in degrees.
_DEGREES = 5.0
_ADDITIVE = (ast.Add, ast.Sub)
_PRODUCTS = (ast.Mult, ast.Div, ast.MatMult)
_FACTORS = (*_PRODUCTS, ast.Pow)
_TURNS = {"sin": "cos", "cos": "sin"}
#: Vectors that are combined to cross products, at most: their squares are tried.
_VECTORS = 24
#: Numbers by which products of matrices are scaled, and combinations of names in a term, at most.
_FACTORS_TRIED, _TWINS = 8, 60
#: What is read nowhere and is multiplied with each number, at most.
_UNUSED_MULTIPLIED = 12
#: Matrices of which all products are tried: those of ten were two thirds of a search.
_FEW_MATRICES = 4
#: Numbers of one list or array that are names, at most.
_MOST_ENTRIES = 30
#: Shapes of rotations, of matrices of Denavit and Hartenberg, and of those of spatial vectors.
_SQUARE = ((3, 3), (4, 4), (6, 6))
#: Shapes of SymPy's vectors.
_COLUMNS = ((2, 1), (3, 1))
#: What SciPy calls its rotations, and what holds one.
_ROTATION = "Rotation"
#: Modules of frames, points and symbols.
_SYMBOLIC = ("sympy.physics", "sympy.core.symbol", "armgpi.validation.mechanics")
#: Methods by which a class has operators.
_OPERATORS = ("__add__", "__mul__", "__matmul__")
#: Shape of a twist, a wrench, a spatial velocity.
_SPATIAL = (6,)


class Scope(NamedTuple):
    """What can be written at a place.

    Attributes:
        kinds: name -> what it holds: "float", "int", an array's shape, a symbol.
        scalars: expressions of one number that depend on the state, such as ``q[0]`` or ``np.cos(q[1])``.
        vectors: expressions of vectors of three.
        matrices: expressions of 3 x 3 matrices.
        products: matrices times vectors, and cross products, that stand somewhere.
        keys: keys of dictionaries that are read.
        joints: expressions of the joints' positions.
        items: items of dictionaries that are read anywhere, such as ``p["m2"]``.
        entries: other entries of arguments and of lists of numbers, such as ``v[1]`` or ``masses[i]``.
        cross: how the function for cross products is called there.
        loops: whether variables have several values in one call.
        attributes: numbers and arrays that objects have, such as ``self.m2``, and parts of arrays, such as
            ``T[k][:3, 3]``, by their text.
        functions: functions of the file by their names, and how many arguments they take.
        unused: what is assigned or given and read nowhere: it may have been forgotten.
        neighbours: array -> what its entries are assigned.
        arguments: names of the function's arguments.
        methods: class of somebody's own with operators -> its methods without arguments.
    """

    kinds: Mapping[str, Any]
    scalars: tuple[ast.expr, ...] = ()
    vectors: tuple[ast.expr, ...] = ()
    matrices: tuple[ast.expr, ...] = ()
    products: tuple[ast.expr, ...] = ()
    keys: tuple[str, ...] = ()
    joints: tuple[ast.expr, ...] = ()
    items: tuple[ast.expr, ...] = ()
    entries: tuple[ast.expr, ...] = ()
    cross: ast.expr | None = None
    loops: bool = False
    attributes: Mapping[str, ast.expr] = {}
    unused: tuple[ast.expr, ...] = ()
    functions: Mapping[str, int] = {}
    neighbours: Mapping[str, tuple[ast.expr, ...]] = {}
    arguments: tuple[str, ...] = ()
    methods: Mapping[str, tuple[str, ...]] = {}

    def numbers(self) -> list[ast.expr]:
        """Return the names of numbers."""
        return [ast.Name(name, ast.Load()) for name, kind in self.kinds.items() if kind == "float"]

    def integers(self) -> list[str]:
        """Return the names of what may index."""
        return [name for name, kind in self.kinds.items() if kind == "int"]

    def other_items(self) -> list[ast.expr]:
        """Return the items of dictionaries that are no scalars of the block."""
        own = {ast.unparse(x) for x in self.scalars}
        return [x for x in self.items if ast.unparse(x) not in own]

    def kind(self, node: ast.AST) -> Any:
        """Return what a name, an attribute or an entry of a list of arrays holds, None where not known."""
        if not isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
            return None
        kind = self.kinds.get(ast.unparse(node))
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Name | ast.Constant | ast.BinOp):
            of = self.kinds.get(ast.unparse(node.value))
            return of[1:] if kind is None and isinstance(of, tuple) and len(of) > 1 else kind
        return kind

    def alike(self, node: ast.expr) -> Iterator[ast.expr]:
        """Yield what else holds the same kind of thing as a name, an attribute or an entry."""
        text, kind = ast.unparse(node), self.kind(node)
        single = ("float", "scalar")
        for other, its in self.kinds.items() if kind is not None else ():
            if (its == kind or (its in single and kind in single)) and other != text:
                yield self.attributes.get(other) or ast.Name(other, ast.Load())


def kind_of(value: Any) -> Any:
    """Return what can stand for a value: None for what is never replaced."""
    match value:
        case bool():
            return None
        case int():
            return "int"
        case float() | np.floating() | Expression():
            return "float"
        case np.ndarray():
            return value.shape
        case list() if value and all(isinstance(x, np.ndarray) for x in value):
            return (len(value), *value[0].shape)
    if type(value).__name__ == _ROTATION:
        return _ROTATION
    if _are_numbers(value):
        return f"list of {len(value)}"
    if _has_operators(value):
        return "float" if _is_like_a_number(value) else type(value).__name__
    if str(type(value).__module__).startswith(_SYMBOLIC):  # frames, points
        return type(value).__name__
    return None


def _has_operators(value: Any) -> bool:
    """Tell whether a value is of somebody's own class that adds or multiplies: a vector, a quaternion."""
    of = type(value)
    known = of.__module__.split(".")[0] in ("builtins", "numpy", "sympy", "casadi", "fractions", "armgpi")
    return not known and any(name in dir(of) for name in _OPERATORS)


def _is_like_a_number(value: Any) -> bool:
    """Tell whether a value of a class of somebody's own is a number: a dual number, or one that counts."""
    try:
        return all(type(x) is type(value) for x in (value + 1.0, 2.0 * value, value * value))
    except Exception:  # a vector, or whatever else
        return False


def _methods(values: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Return the methods without arguments of own classes with operators, by the names of these."""
    found: dict[str, tuple[str, ...]] = {}
    for value in values.values():
        of = type(value)
        if of.__name__ in found or not _has_operators(value):
            continue
        plain = {name: x for name, x in vars(of).items() if isinstance(x, FunctionType) and name[:1] != "_"}
        found[of.__name__] = tuple(name for name, x in plain.items() if x.__code__.co_argcount == 1)
    return found


def scope_of(
    tree: ast.AST, values: Mapping[str, Any], arguments: tuple[str, ...], everywhere: ast.AST
) -> Scope:
    """Return what can be written in a block, from its syntax tree and the values of its names."""
    kinds = {name: kind for name, value in values.items() if (kind := kind_of(value)) is not None}
    indices = set(_indexing(everywhere))
    kinds |= {name: "float" for name, kind in kinds.items() if kind == "int" and name not in indices}
    seen, attributes = _Seen(arguments), dict(_attributes(everywhere, values, kinds))
    attributes |= {
        text: ast.parse(text, mode="eval").body for text in _numbers_read(tree, everywhere, values, arguments)
    }
    kinds |= dict.fromkeys(attributes.keys() - kinds.keys(), "scalar")
    attributes |= _parts(tree, values, kinds)
    seen.scalars |= {text: x for text, x in attributes.items() if kinds[text] == "scalar"}
    # What is a function of the state elsewhere may be missing here.
    seen.scalars |= {ast.unparse(x): x for x in ast.walk(everywhere) if _of_state(x, arguments)}
    items = {ast.unparse(x): x for x in ast.walk(everywhere) if _is_item(x)}
    seen.visit(tree)
    for key, entry in list(_unread(items, values)):
        seen.keys[key] = None
        items.setdefault(ast.unparse(entry), entry)
    seen.add_counterparts()
    seen.add_names(kinds, attributes, _names_in_lists(tree))
    for index in _counters(tree):
        seen.add_entries(index, kinds)
    entries = _entries(tree, seen, kinds, arguments, values)
    return Scope(
        kinds,
        tuple(seen.scalars.values()),
        tuple(seen.few_vectors(attributes)),
        tuple(seen.matrices.values()),
        tuple(seen.products.values()),
        tuple(seen.keys),
        tuple(seen.joints.values()),
        tuple(items.values()),
        tuple(entry for entry in entries if ast.unparse(entry) not in seen.scalars),
        seen.cross,
        bool(_counters(tree)) or any(isinstance(node, ast.While) for node in ast.walk(tree)),
        attributes,
        (*_unread_names(tree, arguments), *_unread_parts(everywhere, attributes, items)),
        {n.name: len(n.args.args) for n in getattr(everywhere, "body", ()) if isinstance(n, ast.FunctionDef)},
        _neighbours(tree),
        arguments,
        _methods(values),
    )


def _neighbours(tree: ast.AST) -> dict[str, tuple[ast.expr, ...]]:
    """Return what the entries of each array are assigned."""
    found: dict[str, tuple[ast.expr, ...]] = {}
    for node in ast.walk(tree):
        match node:
            case ast.Assign(targets=[ast.Subscript(value=ast.Name(id=name))], value=value):
                found[name] = (*found.get(name, ()), value)
    return found


def _unread_names(tree: ast.AST, arguments: tuple[str, ...]) -> Iterator[ast.expr]:
    """Yield the names that a function assigns or takes and never reads, and their entries in loops."""
    read = {n.id for n in names_with(ast.Load, tree)}
    stored = (n.id for n in names_with(ast.Store, tree))
    for name in dict.fromkeys((*stored, *arguments) if arguments else ()):
        if name not in read and name != "self":
            yield ast.Name(name, ast.Load())
            yield from (_entry(name, ast.Name(index, ast.Load())) for index in _counters(tree))


def _unread_parts(everywhere: ast.AST, *known: Mapping[str, ast.expr]) -> Iterator[ast.expr]:
    """Yield numbers of objects and items of dictionaries that the file reads nowhere: I1 of a record."""
    read = {ast.unparse(x) for x in ast.walk(everywhere) if isinstance(x, ast.Attribute | ast.Subscript)}
    for text, node in itertools.chain(*(parts.items() for parts in known)):
        if text not in read and isinstance(node, ast.Attribute | ast.Subscript):
            yield node


def _unread(
    items: Mapping[str, ast.Subscript], values: Mapping[str, Any]
) -> Iterator[tuple[str, ast.Subscript]]:
    """Yield all items of the dictionaries that are read: one that is read nowhere may be what belongs."""
    owners = [node.value.id for node in items.values() if isinstance(node.value, ast.Name)]
    for owner in dict.fromkeys(owners):
        known = values.get(owner)
        for key, value in known.items() if isinstance(known, Mapping) else ():
            if kind_of(value) in ("float", "int"):
                yield key, _entry(owner, ast.Constant(key))


def _indexing(tree: ast.AST) -> Iterator[str]:
    """Yield the names that index or count: an integer with another name is a number as others are."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript):
            inside: list[ast.AST] = [node.slice]
        elif isinstance(node, ast.For):
            inside = [node.target, node.iter]
        elif isinstance(node, ast.Call) and function_name(node) in ("range", "zeros", "eye", "ones", "sym"):
            inside = list(node.args)
        else:
            inside = [node.left, *node.comparators] if isinstance(node, ast.Compare) else []
        yield from (x.id for part in inside for x in ast.walk(part) if isinstance(x, ast.Name))


def _attributes(
    tree: ast.AST, values: Mapping[str, Any], kinds: dict[str, Any]
) -> Iterator[tuple[str, ast.expr]]:
    """Yield the numbers and arrays of the objects whose attributes are read, and add their kinds."""
    owners = {ast.unparse(n.value): n.value for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
    for owner, node in owners.items():
        thing = _value_at(node, values)
        for name, value in {**vars(type(thing)), **getattr(thing, "__dict__", {})}.items():
            kind, text = kind_of(value), f"{owner}.{name}"
            if not name.startswith("_") and (kind in ("float", "int") or isinstance(value, np.ndarray)):
                kinds[text] = kind if isinstance(kind, tuple) else "scalar"
                yield text, ast.Attribute(node, name, ast.Load())


def _value_at(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """Return what a name holds, or an attribute of what it holds."""
    if isinstance(node, ast.Attribute):
        return getattr(_value_at(node.value, values), node.attr, None)
    return values.get(node.id) if isinstance(node, ast.Name) else None


def _numbers_read(
    tree: ast.AST, everywhere: ast.AST, values: Mapping[str, Any], arguments: tuple[str, ...]
) -> Iterator[str]:
    """Yield the numbers of lists and arrays of which one is read alone: ``m[1]``, ``I[2][0, 0]``.

    Not those of arrays that functions fill: they are other numbers in every call.
    """
    others = {*arguments, *filled_by_functions(everywhere)}
    if arguments:
        others |= {n.id for n in names_with(ast.Store, tree)}
    roots: dict[str, None] = {}
    for node in ast.walk(everywhere):
        if not (isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load)):
            continue
        root: ast.expr = node
        while isinstance(root, ast.Subscript) and _is_one_place(root.slice):
            root = root.value
        if isinstance(root, ast.Name) and root.id not in others:
            roots[root.id] = None
    for name in roots:
        yield from itertools.islice(_numbers_in(name, values.get(name)), _MOST_ENTRIES)


def _is_one_place(index: ast.expr) -> bool:
    """Tell whether an index is the same place at every pass: not a slice, and nothing that counts."""
    return not names_in(index) and not any(isinstance(x, ast.Slice) for x in ast.walk(index))


@lru_cache(maxsize=1)
def filled_by_functions(tree: ast.AST) -> frozenset[str]:
    """Return the names of arrays, lists and dictionaries of a module whose entries its functions assign."""
    found: set[str] = set()
    for function in (x for x in ast.walk(tree) if isinstance(x, ast.FunctionDef)):
        filled: set[str] = set()
        for node in ast.walk(function):
            root: ast.AST = node
            while isinstance(root, ast.Subscript):
                root = root.value
            if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store):
                filled |= {root.id} if isinstance(root, ast.Name) else set()
        own = {x.arg for x in ast.walk(function.args) if isinstance(x, ast.arg)}
        found |= filled - own - {x.id for x in names_with(ast.Store, *function.body)}
    return frozenset(found)


def _numbers_in(text: str, value: Any) -> Iterator[str]:
    """Yield how the numbers of a list or an array are read, but for zeros."""
    if isinstance(value, list | tuple):
        for k, x in enumerate(value):
            yield from _numbers_in(f"{text}[{k}]", x)
    elif type(value) is np.ndarray and value.dtype.kind in "if":
        yield from (f"{text}[{', '.join(map(str, at))}]" for at, x in np.ndenumerate(value) if at and x)
    elif type(value) in (int, float, Expression) and value and "[" in text:
        yield text


def _parts(tree: ast.AST, values: Mapping[str, Any], kinds: dict[str, Any]) -> Iterator[tuple[str, ast.expr]]:
    """Yield the parts of arrays that stand in a block, for other indices too, and add their kinds."""
    for one in _with_other_indices(tree, [name for name, kind in kinds.items() if kind == "int"]):
        text = ast.unparse(one)
        if text in kinds or any(isinstance(x, ast.Call) for x in ast.walk(one)):
            continue
        try:
            kind = kind_of(eval(text, {"__builtins__": {}}, dict(values)))
        except Exception:  # a name that is not there yet, an index out of range
            continue
        if kind in ("float", (2,), (3,), _SPATIAL, *_SQUARE):
            kinds[text] = "scalar" if kind == "float" else kind
            yield text, ast.parse(text, mode="eval").body


def _with_other_indices(tree: ast.AST, counters: Sequence[str]) -> Iterator[ast.Subscript]:
    """Yield the parts of arrays that stand somewhere, each with its twins of other counters."""
    for node in (n for n in ast.walk(tree) if isinstance(n, ast.Subscript)):
        yield node
        for x, y in itertools.product([x for x in counters if x in names_in(node)], counters):
            yield _Replaced(x, ast.Name(y, ast.Load())).visit(copy.deepcopy(node))


def _entries(
    tree: ast.AST,
    seen: _Seen,
    kinds: Mapping[str, Any],
    arguments: tuple[str, ...],
    values: Mapping[str, Any],
) -> Iterator[ast.expr]:
    """Yield v[1] where v[0] stands, which may be missing, and what loops are at in lists: ``masses[i]``."""
    read = {text.split("[")[0] for text in seen.scalars}
    for name in (name for name in arguments if name in read):
        kind = kinds.get(name)
        count = kind[0] if isinstance(kind, tuple) and len(kind) == 1 else 0
        yield from (_entry(name, ast.Constant(k)) for k in range(count))
    for index in _counters(tree):
        names = (name for name, value in values.items() if _are_numbers(value))
        yield from (_entry(name, ast.Name(index, ast.Load())) for name in names)


def _are_numbers(value: Any) -> bool:
    """Tell whether a value is a list of numbers, such as the masses."""
    return isinstance(value, list | tuple) and bool(value) and all(type(x) in (int, float) for x in value)


def _entry(name: str, index: ast.expr) -> ast.Subscript:
    """Return an entry of a list."""
    return ast.Subscript(ast.Name(name, ast.Load()), index, ast.Load())


def _is_key(node: ast.AST) -> bool:
    """Tell whether an index is the key of a dictionary."""
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _is_item(node: ast.AST) -> TypeGuard[ast.Subscript]:
    """Tell whether an expression reads an item of a dictionary."""
    return isinstance(node, ast.Subscript) and _is_key(node.slice) and isinstance(node.ctx, ast.Load)


def _of_state(node: ast.AST, arguments: tuple[str, ...]) -> TypeGuard[ast.expr]:
    """Tell whether an expression is a part of a function's arguments, or a sine or cosine of one."""
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        is_read = isinstance(node.ctx, ast.Load)  # functions may write into their arguments
        return is_read and isinstance(node.value, ast.Name) and node.value.id in arguments
    if not (isinstance(node, ast.Call) and function_name(node) in _TURNS):
        return False
    used = {x.id for x in ast.walk(node) if isinstance(x, ast.Name) and x is not node.func}
    return bool(used & set(arguments)) or not arguments


def _counters(tree: ast.AST) -> list[str]:
    """Return the variables that loops count with."""
    loops = [n for n in ast.walk(tree) if isinstance(n, ast.For)]
    counted = [n.target.elts[0] if isinstance(n.target, ast.Tuple) else n.target for n in loops]
    return list(dict.fromkeys(x.id for x in counted if isinstance(x, ast.Name)))


def _names_in_lists(tree: ast.AST) -> set[str]:
    """Return the names whose entries loops go through, such as the angles: they are no vectors of space."""
    counters = _counters(tree)
    found = (n for n in ast.walk(tree) if isinstance(n, ast.Subscript) and isinstance(n.value, ast.Name))
    return {n.value.id for n in found if isinstance(n.slice, ast.Name) and n.slice.id in counters}  # type: ignore[attr-defined]


class _Seen(ast.NodeVisitor):
    """Collects the expressions of a block that may belong elsewhere in it, by their text."""

    def __init__(self, arguments: tuple[str, ...]) -> None:
        self._arguments = arguments
        self.scalars: dict[str, ast.expr] = {}
        self.vectors: dict[str, ast.expr] = {}
        self.matrices: dict[str, ast.expr] = {}
        self.products: dict[str, ast.expr] = {}
        self.joints: dict[str, ast.expr] = {}
        self.keys: dict[str, None] = {}
        self.cross: ast.expr | None = None

    def add_names(
        self, kinds: Mapping[str, Any], attributes: Mapping[str, ast.expr], listed: Container[str]
    ) -> None:
        """Keep the names of vectors and matrices that loops do not go through, and symbols of joints."""
        for name, kind in kinds.items():
            node = attributes.get(name, ast.Name(name, ast.Load()))
            if kind in ((2,), (3,), _SPATIAL) and name not in listed:
                self.vectors[name] = node
            if kind in _SQUARE and name not in listed:
                self.matrices[name] = node
            is_position = (joint_of(name) or "")[:1] == ("q",) or (not self._arguments and name[:1] == "q")
            if kind == "float" and is_position:
                self.joints[name] = ast.Name(name, ast.Load())

    def few_vectors(self, attributes: Container[str]) -> Iterator[ast.expr]:
        """Yield the vectors of the shortest texts, and of the others the attributes."""
        for k, text in enumerate(sorted(map(ast.unparse, self.vectors.values()), key=len)):
            if k < _VECTORS or text in attributes:
                yield self.vectors[text]

    def add_entries(self, index: str, kinds: Mapping[str, Any]) -> None:
        """Keep `name[index]`: vectors and matrices out of lists of them, and numbers out of arguments.

        Numbers out of local lists are too many to try.
        """
        for name, kind in (one for one in kinds.items() if one[0].isidentifier()):
            entry = _entry(name, ast.Name(index, ast.Load()))
            if isinstance(kind, tuple) and len(kind) > 1:
                vector = kind[1:] in ((3,), _SPATIAL)
                into = self.vectors if vector else self.matrices if kind[1:] in _SQUARE else {}
                into[ast.unparse(entry)] = entry
            elif name in self._arguments and isinstance(kind, tuple) and kind:
                self.scalars[ast.unparse(entry)] = entry

    def add_counterparts(self) -> None:
        """Keep the cosine of what a sine is taken of, and the other way round."""
        for node in [*self.scalars.values()]:
            if isinstance(node, ast.Call):
                other = ast.Call(_rename(node.func, _TURNS[function_name(node)]), node.args, [])
                self.scalars.setdefault(ast.unparse(other), other)

    def visit_Call(self, node: ast.Call) -> None:
        """Keep sines, cosines and cross products."""
        if function_name(node) in _TURNS:
            self.scalars[ast.unparse(node)] = node
        elif function_name(node) == "cross" and len(node.args) == 2:
            self.cross = node.func
            self.vectors |= {ast.unparse(part): part for part in node.args}
            self.products[ast.unparse(node)] = node
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """Keep products of matrices."""
        if isinstance(node.op, ast.MatMult):
            self.products[ast.unparse(node)] = node
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        """Keep parts of the arguments and items of dictionaries."""
        if isinstance(node.ctx, ast.Load):
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            key = node.slice.value if isinstance(node.slice, ast.Constant) else None
            if isinstance(key, str):
                self.keys[key] = None
            if isinstance(key, str) or (
                owner in self._arguments and isinstance(node.slice, ast.Constant | ast.Name)
            ):
                self.scalars[ast.unparse(node)] = node
            if isinstance(key, int) and owner == "q":
                self.joints[ast.unparse(node)] = node
        self.generic_visit(node)


def formula_of(text: str) -> ast.expr | None:
    """Return the expression that a text is; None where it is a name, or no expression."""
    try:
        node = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError):
        return None
    return node if isinstance(node, ast.BinOp | ast.UnaryOp | ast.Call) else None


def scope_of_texts(texts: Iterable[str], numbers: Iterable[str]) -> Scope:
    """Return what can be written in formulas that are texts: what is in any of them, and names of numbers."""
    kinds: dict[str, Any] = {}
    scalars: dict[str, ast.expr] = {}
    for node in filter(None, map(formula_of, texts)):
        calls = [x for x in ast.walk(node) if isinstance(x, ast.Call)]
        scalars |= {ast.unparse(x): x for x in calls if function_name(x) in _TURNS}
        called = {x.func for x in calls}
        kinds |= {x.id: "float" for x in ast.walk(node) if isinstance(x, ast.Name) and x not in called}
    if kinds:
        kinds |= {name: "float" for name in numbers if name.isidentifier() and joint_of(name) is None}
    joints = [ast.Name(name, ast.Load()) for name in kinds if (joint_of(name) or ("",))[0] == "q"]
    return Scope(kinds, tuple(scalars.values()), joints=tuple(joints))


def of_text(node: ast.expr, scope: Scope) -> Iterator[Choice]:
    """Yield what may stand in place of a text that is a formula, as texts."""
    if not (scope.kinds and isinstance(node, ast.Constant) and isinstance(node.value, str)):
        return
    whole = formula_of(node.value)
    for part, parent in _with_parents(whole, None) if whole is not None else ():
        for kind, choice in (*alternatives(part, parent, scope), *_terms_of_text(part, parent, scope)):
            yield kind, ast.Constant(ast.unparse(with_part(whole, part, choice)))


def _with_parents(node: ast.expr, parent: ast.expr | None) -> Iterator[tuple[ast.expr, ast.expr | None]]:
    """Yield an expression and its parts, but for the names of functions, with what each is a part of."""
    yield node, parent
    for part in ast.iter_child_nodes(node):
        if isinstance(part, ast.expr) and part is not getattr(node, "func", None):
            yield from _with_parents(part, node)


def _terms_of_text(node: ast.expr, parent: Any, scope: Scope) -> Iterator[Choice]:
    """Yield a sum with a term more: a name, or a product of two or three, of which two are equal."""
    if not insertion(node, parent) or isinstance(parent, ast.Call | ast.BinOp):
        return
    moving = {ast.unparse(x) for x in scope.joints}
    names = [ast.Name(name, ast.Load()) for name in scope.kinds if name not in moving]
    terms: list[ast.expr] = [*names]
    terms += [_times(a, b) for a, b in itertools.combinations(names, 2)]
    terms += [_times(a, _power(b, 2)) for a, b in itertools.permutations(names, 2)]
    for term in terms:
        yield "term", ast.BinOp(node, ast.Add(), term)
        yield "term", ast.BinOp(node, ast.Sub(), term)


def insertion(node: ast.expr, parent: Any) -> bool:
    """Tell whether a term may be added to an expression: to a whole sum, not to each of its parts."""
    if isinstance(parent, ast.Subscript | ast.Attribute) or is_sum(parent):
        return False
    if isinstance(node, ast.Attribute):
        return node.attr != "T" and isinstance(node.value, ast.Name)
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float)
    return isinstance(node, ast.BinOp | ast.Name | ast.Call | ast.Subscript | ast.UnaryOp)


def alternatives(node: ast.expr, parent: Any, scope: Scope) -> Iterator[Choice]:
    """Yield what may replace an expression, as pairs of the kind of change and the new expression.

    The same expression may come twice. New ones share nodes with `node`: copy one before changing it. Right
    below an index or an attribute, only names and items are replaced.

    Args:
        node: the expression.
        parent: the node that it is a part of.
        scope: names, numbers and shapes that are known there.
    """
    if isinstance(parent, ast.Subscript | ast.Attribute):
        match node:
            case ast.Name():
                yield from _of_name(node, scope)
            case ast.Subscript():
                yield from _of_subscript(node, scope)
        return
    yield from _of_itself(node, scope)
    yield from _of_own_class(node, scope)
    yield from _of_place(node, parent, scope)
    number = scope.kind(node) == "scalar"
    if is_sum(node) or number or isinstance(node, ast.Name | ast.Subscript | ast.Call):
        yield "square", _power(node, 2)
    if _is_term(node, parent):  # with one more factor
        yield "sign", _negative(node)
        yield "factor", _times(ast.Constant(2), node)
        yield "factor", _times(ast.Constant(0.5), node)
        for factor in (*scope.numbers(), *scope.scalars, *scope.entries, *scope.other_items()):
            yield "product", _times(factor, node)
            yield "product", ast.BinOp(node, ast.Div(), factor)
    yield from _with_unused(node, parent, scope)
    yield from _of_assigned(node, parent, scope)
    yield from _of_products(node, parent, scope)
    yield from _of_arrays(node, scope)
    if isinstance(node, ast.BinOp) and insertion(node, parent):
        for term in _siblings(node, summands(node), scope):
            yield "term", ast.BinOp(node, ast.Add(), term)
            yield "term", ast.BinOp(node, ast.Sub(), term)


def _of_itself(node: ast.expr, scope: Scope) -> Iterator[Choice]:
    """Yield the changes of one kind of expression."""
    match node:
        case ast.BinOp():
            yield from _of_operation(node)
        case ast.UnaryOp(op=ast.USub()):
            yield "sign", node.operand
        case ast.Call():
            yield from _of_call(node, scope)
            yield from _of_own(node, scope)
        case ast.Attribute():
            yield from _of_attribute(node, scope)
        case ast.Name():
            yield from _of_name(node, scope)
        case ast.Subscript():
            yield from _of_subscript(node, scope)
            yield from (("name", x) for x in scope.alike(node))
            yield from _absolute(node, scope)
        case ast.Tuple() | ast.List():
            yield from _of_row(node, scope)
        case ast.IfExp(body=body, orelse=other):
            yield from (("extra", body), ("extra", other))
        case ast.Constant(value=int() | float() as x) if abs(x) >= _DEGREES:
            yield "degrees", ast.BinOp(node, ast.Mult(), ast.Constant(math.pi / 180))


def _of_attribute(node: ast.Attribute, scope: Scope) -> Iterator[Choice]:
    """Yield a matrix as it is for its transpose, the other part of a complex number, another attribute."""
    match node.attr:
        case "T":
            yield "transposed", node.value
        case "real" | "imag" as part:
            yield "trig", ast.Attribute(node.value, "imag" if part == "real" else "real", ast.Load())
        case _:
            yield from (("name", x) for x in scope.alike(node))


def _of_own_class(node: ast.expr, scope: Scope) -> Iterator[Choice]:
    """Yield what belongs where objects of own classes are combined: the other order, an inverse, none."""
    match node:
        case ast.BinOp(left=left, op=ast.Mult() as op, right=right) if scope.methods:
            yield "swapped", ast.BinOp(right, op, left)
        case ast.Call(func=ast.Attribute(value=value, attr=name), args=[]):
            if any(name in names for names in scope.methods.values()):
                yield "inverse", value
        case ast.Name() | ast.Attribute() | ast.Subscript():
            for name in scope.methods.get(str(scope.kind(node)), ()):
                yield "inverse", ast.Call(ast.Attribute(node, name, ast.Load()), [], [])


def _of_place(node: ast.expr, parent: Any, scope: Scope) -> Iterator[Choice]:
    """Yield what belongs where an entry of an array is assigned, or in a list or a call.

    Of an entry that is what others are assigned with two names swapped: Jyy as Jxx, with x for y.
    """
    match parent:
        case ast.List() if isinstance(node, ast.Constant) and node.value in (0, 1):
            yield "index", ast.Constant(1 - node.value)  # another axis or row
        case ast.Call() if scope.kind(node) == "int":
            yield from (("index", ast.BinOp(node, ast.Add(), ast.Constant(step))) for step in (1, -1))
        case ast.Assign(targets=[ast.Name()]) if isinstance(node, ast.Name | ast.Subscript | ast.Attribute):
            # An angle out of a table in degrees, of which sine and cosine are taken later.
            yield "degrees", ast.BinOp(node, ast.Mult(), ast.Constant(math.pi / 180))
        case ast.Assign(targets=[ast.Subscript(value=ast.Name(id=name))]):
            for other in scope.neighbours.get(name, ()):
                names = sorted(x for x in names_in(other) if scope.kinds.get(x) == "float")
                for a, b in itertools.combinations(names, 2):
                    yield "swapped", _with_names(other, {a: b, b: a})


def _absolute(node: ast.Subscript, scope: Scope) -> Iterator[Choice]:
    """Yield q[0] + q[1] for q[1]: an angle from the base for one from the link before, or its rate."""
    if ast.unparse(node) in map(ast.unparse, scope.scalars):
        for other in scope.scalars:
            alike = isinstance(other, ast.Subscript) and ast.dump(other.value) == ast.dump(node.value)
            if alike and ast.unparse(other) != ast.unparse(node):  # twice itself is a factor of 2
                yield "angle" if _is_motion(node, scope) else "sum", ast.BinOp(other, ast.Add(), node)


def _is_motion(node: ast.Subscript, scope: Scope) -> bool:
    """Tell whether an entry is one of the joints' positions or rates, not of a list of lengths."""
    name = ast.unparse(node.value)
    return name in scope.arguments or (joint_of(f"{name}1") or "")[:1] in (("q",), ("v",))


def _with_unused(node: ast.expr, parent: Any, scope: Scope) -> Iterator[Choice]:
    """Yield sums with what is read nowhere."""
    if isinstance(node, ast.Name | ast.Subscript | ast.Call | ast.BinOp):
        for other in scope.unused:
            yield "term", ast.BinOp(other, ast.Add(), node)
            yield "term", ast.BinOp(node, ast.Sub(), other)
        factors = (*scope.numbers(), *scope.scalars)
        few = scope.unused[:_UNUSED_MULTIPLIED]
        for other in few if isinstance(node, ast.BinOp) and insertion(node, parent) else ():
            for x in factors:  # of a spring, a mass: half of its product with a square
                yield "term", ast.BinOp(node, ast.Add(), _times(other, x))
                half = _times(ast.Constant(0.5), _times(other, _power(x, 2)))
                yield "term", ast.BinOp(node, ast.Add(), half)


def _of_assigned(node: ast.expr, parent: Any, scope: Scope) -> Iterator[Choice]:
    """Yield sums with the name that is assigned in a loop, = for +=, or with another of its kind."""
    match parent:
        case ast.Assign(targets=[ast.Name(id=name)]) if scope.loops and name not in names_in(node):
            yield "term", ast.BinOp(ast.Name(name, ast.Load()), ast.Add(), node)
    match parent:
        case ast.Assign(targets=[ast.Name() as target, *_]) if scope.kind(target) in _COLUMNS:
            for other in scope.alike(target):
                yield "sum", ast.BinOp(other, ast.Add(), node)
                yield "sum", ast.BinOp(node, ast.Sub(), other)


def _of_products(node: ast.expr, parent: Any, scope: Scope) -> Iterator[Choice]:
    """Yield m * (a - g) for m * a, and a product of matrices with one more in it."""
    match node, parent:
        case _, ast.BinOp(op=ast.Mult()) if scope.kind(node) == (3,):
            for other in (x for x in scope.vectors if scope.kind(x) == (3,)):
                if ast.dump(other) != ast.dump(node):
                    yield "term", ast.BinOp(node, ast.Sub(), other)
                    yield "term", ast.BinOp(node, ast.Add(), other)
        case ast.BinOp(left=left, op=ast.MatMult() as op, right=right), _:
            shape = scope.kind(right)
            square = isinstance(shape, tuple) and len(shape) == 2 and shape[0] == shape[1]
            inner = scope.alike(right) if square else scope.matrices
            between = (ast.BinOp(left, op, matrix) for matrix in inner)
            yield from (("product", ast.BinOp(one, op, right)) for one in between)


def _of_arrays(node: ast.expr, scope: Scope) -> Iterator[Choice]:
    """Yield products with a matrix or a function of what may be an array."""
    if _is_array(node, scope):
        taken = (name for name, count in scope.functions.items() if count == 1)
        yield from (("product", ast.Call(ast.Name(name, ast.Load()), [node], [])) for name in taken)
        if scope.kind(node) in _SQUARE:
            for term in _squares(node, scope):
                yield "term", ast.BinOp(node, ast.Sub(), term)
                yield "term", ast.BinOp(node, ast.Add(), term)
        for matrix in scope.matrices:
            yield "product", ast.BinOp(node, ast.MatMult(), matrix)
            back = ast.Attribute(matrix, "T", ast.Load())
            for one, other in ((matrix, back), (back, matrix)):
                yield "product", (product := ast.BinOp(one, ast.MatMult(), node))
                if scope.kind(node) in _SQUARE or isinstance(node, ast.Call):
                    yield "product", ast.BinOp(product, ast.MatMult(), other)
        for name in (name for name, kind in scope.kinds.items() if kind == _ROTATION):
            turn = ast.Attribute(ast.Name(name, ast.Load()), "apply", ast.Load())
            yield "product", ast.Call(turn, [node], [])


def _squares(node: ast.expr, scope: Scope) -> Iterator[ast.expr]:
    """Yield products of two matrices of the shape of one, of many the squares, also times a number."""
    alike = [x for x in scope.matrices if scope.kind(x) == scope.kind(node)]
    factors = scope.numbers()
    pairs = itertools.product(alike, repeat=2)
    for one, other in pairs if len(alike) <= _FEW_MATRICES else zip(alike, alike, strict=True):
        yield ast.BinOp(one, ast.MatMult(), other)
        scaled = (ast.BinOp(x, ast.Mult(), one) for x in factors[:_FACTORS_TRIED])
        yield from (ast.BinOp(x, ast.MatMult(), other) for x in scaled)


def _is_array(node: ast.expr, scope: Scope) -> bool:
    """Tell whether an expression may be a vector or a matrix."""
    if isinstance(node, ast.Call):
        return function_name(node) in ("array", "diag") or function_name(node) in scope.functions
    if not isinstance(node, ast.Name | ast.Subscript | ast.Attribute):
        return False
    kind = scope.kind(node)
    if isinstance(node, ast.Attribute):
        return isinstance(kind, tuple)
    return kind not in ("float", "int") and ast.unparse(node) not in map(ast.unparse, scope.scalars)


def is_sum(node: Any) -> TypeGuard[ast.BinOp]:
    """Tell whether an expression is a sum or a difference."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, _ADDITIVE)


def names_with(context: type[ast.expr_context], *trees: ast.AST) -> Iterator[ast.Name]:
    """Yield the names that are read, with `ast.Load`, or assigned, with `ast.Store`."""
    for node in itertools.chain.from_iterable(map(ast.walk, trees)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, context):
            yield node


def names_in(node: ast.AST, known: dict[int, set[str]] | None = None) -> set[str]:
    """Return the names in an expression; those of its parts are kept in `known`, while these are there."""
    known = {} if known is None else known
    if id(node) not in known:
        own = {node.id} if isinstance(node, ast.Name) else set[str]()
        known[id(node)] = own.union(*(names_in(part, known) for part in ast.iter_child_nodes(node)))
    return known[id(node)]


class _Renumbered(ast.NodeTransformer):
    """Names and keys with another number: m1 for m2."""

    def __init__(self, old: str, new: str, scope: Scope) -> None:
        self._old, self._new = old, new
        self._known = {*scope.kinds, *scope.keys, *(x.rpartition(".")[2] for x in scope.attributes)}
        self.good = True

    def _of(self, name: str) -> str:
        other = name.replace(self._old, self._new)
        self.good = self.good and (other == name or other in self._known)
        return other

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Return another name."""
        return ast.Name(self._of(node.id), node.ctx)

    def visit_Attribute(self, node: ast.Attribute) -> ast.Attribute:
        """Return another attribute."""
        return ast.Attribute(node.value, self._of(node.attr), node.ctx)

    def visit_Subscript(self, node: ast.Subscript) -> ast.Subscript:
        """Return another item of a dictionary."""
        if _is_key(node.slice):
            key = ast.Constant(self._of(ast.literal_eval(node.slice)))
            return ast.Subscript(node.value, key, node.ctx)
        index = node.slice
        if isinstance(index, ast.Constant) and str(index.value) == self._old:
            index = ast.Constant(int(self._new))
        return ast.Subscript(self.visit(node.value), index, node.ctx)


def _siblings(node: ast.expr, parts: Iterable[ast.expr], scope: Scope) -> Iterator[ast.expr]:
    """Yield parts for another number: m1 * J1.T @ J1 beside m2 * J2.T @ J2, (m3, c3) behind (m2, c2)."""
    terms = {ast.unparse(term): term for term in parts}
    read = [x.slice for x in ast.walk(node) if isinstance(x, ast.Subscript)]
    indices = [x.value for x in read if isinstance(x, ast.Constant) and type(x.value) is int]
    digits = "".join((*scope.kinds, *scope.keys, *(f"{k}{k + 1}" for k in indices)))
    numbers = sorted(set(filter(str.isdigit, digits)))
    others = [*itertools.chain(*(_renumber(term, numbers, scope) for term in terms.values()))]
    others += itertools.chain(*(itertools.islice(_twins(x, scope), _TWINS) for x in terms.values()))
    found = {ast.unparse(x): x for x in others}
    yield from (term for text, term in found.items() if text not in terms)


def _renumber(term: ast.expr, numbers: Iterable[str], scope: Scope) -> Iterator[ast.expr]:
    """Yield a term with another number in its names and keys, where there are such."""
    text = ast.unparse(term)
    for old, new in itertools.permutations(numbers, 2):
        if old in text:
            renamed = _Renumbered(old, new, scope)
            other = renamed.visit(copy.deepcopy(term))
            if renamed.good:
                yield other


def _twins(term: ast.expr, scope: Scope) -> Iterator[ast.expr]:
    """Yield a term of another body: mw * wheel[1] beside mp * pole[1], with numbers of the same letter."""
    names = {x.id: scope.kinds.get(x.id) for x in ast.walk(term) if isinstance(x, ast.Name)}
    choices = [
        [x for x in scope.kinds if scope.kinds[x] == kind and (kind != "float" or x[0] == name[0])]
        for name, kind in names.items()
    ]
    bodies = [name for name, kind in names.items() if kind not in ("float", "int", None)]
    for chosen in itertools.product(*(ones or [name] for ones, name in zip(choices, names, strict=True))):
        swap = dict(zip(names, chosen, strict=True))
        if all(x.isidentifier() for x in chosen) and any(swap[name] != name for name in bodies):
            yield _with_names(term, swap)


def _with_names(node: ast.expr, swap: Mapping[str, str]) -> ast.expr:
    """Return an expression with other names."""
    other = copy.deepcopy(node)
    for x in (x for x in ast.walk(other) if isinstance(x, ast.Name)):
        x.id = swap.get(x.id, x.id)
    return other


def summands(node: ast.expr) -> Iterator[ast.expr]:
    """Yield the terms of a sum."""
    if is_sum(node):
        yield from summands(node.left)
        yield from summands(node.right)
    else:
        yield node


def _is_term(node: ast.expr, parent: Any) -> bool:
    """Tell whether an expression is a whole product."""
    if isinstance(parent, ast.BinOp) and isinstance(parent.op, _FACTORS):
        # A sum in brackets is multiplied as a whole outside of them; the base of a power is not.
        return isinstance(parent.op, ast.Pow) and parent.left is node
    if isinstance(node, ast.BinOp):
        return isinstance(node.op, _FACTORS) or not isinstance(parent, ast.BinOp)
    return isinstance(node, ast.Name | ast.Call | ast.Subscript | ast.UnaryOp | ast.Attribute)


def vector_terms(scope: Scope) -> Iterator[ast.expr]:
    """Yield vectors that a vector's equation may lack, the short ones first.

    They are products that stand elsewhere, with another vector in them as well, scaled vectors, and at last
    other cross products.
    """
    near = {ast.unparse(x): x for x in (*scope.products, *scope.vectors, *_relatives(scope))}
    products = [*_crosses(scope), *_spatial_terms(scope)]
    found = {ast.unparse(x): x for x in products}
    simple = [x for x in products if _length(x)[0] == 2 and not _has_call(x)] if scope.loops else []
    scalars = [x for x in scope.scalars if isinstance(x, ast.Subscript)]
    for scalar, x in itertools.product(scalars, (*simple, *scope.vectors)):
        scaled = _times(scalar, x)
        (near if _length(scaled)[1] == 0 else found)[ast.unparse(scaled)] = scaled
    yield from sorted(near.values(), key=_length)
    yield from sorted((x for text, x in found.items() if text not in near), key=_length)


class _Replaced(ast.NodeTransformer):
    """An expression with another one in place of one of its parts."""

    def __init__(self, old: str, new: ast.expr) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> Any:
        """Return the other part, or the node with its parts."""
        return self._new if ast.unparse(node) == self._old else self.generic_visit(node)


def _relatives(scope: Scope) -> Iterator[ast.expr]:
    """Yield products that stand somewhere with another vector in place of one."""
    vectors = {ast.unparse(x): x for x in scope.vectors if isinstance(x, ast.Name | ast.Subscript)}
    for product in scope.products:
        for old in dict.fromkeys(ast.unparse(x) for x in ast.walk(product)):
            for other in vectors.values() if old in vectors else ():
                yield _Replaced(old, other).visit(copy.deepcopy(product))


def _crosses(scope: Scope) -> Iterator[ast.expr]:
    """Yield cross products of two vectors, those of a vector with these, and I ω and ω × I ω."""
    vectors = [x for x in scope.vectors if scope.kind(x) != _SPATIAL]
    plain = [x for x in scope.products if isinstance(x, ast.BinOp)]
    if scope.cross is None:
        return
    for a, b in itertools.product(vectors[:_VECTORS], (*vectors[:_VECTORS], *plain)):
        one = ast.Call(scope.cross, [a, b], [])
        if a is not b:
            yield one
            if not _has_call(one):
                yield ast.Call(scope.cross, [a, one], [])
    for matrix, x in itertools.product(scope.matrices, vectors):
        turned = ast.BinOp(matrix, ast.MatMult(), x)
        yield from (turned, ast.Call(scope.cross, [x, turned], []))


def _spatial_terms(scope: Scope) -> Iterator[ast.expr]:
    """Yield what cross products are to spatial vectors: a matrix of one times another, or times I of it."""
    vectors = [x for x in scope.vectors if scope.kind(x) == _SPATIAL]
    inertias = [x for x in scope.matrices if scope.kind(x) == 2 * _SPATIAL]
    for name in (name for name, count in scope.functions.items() if count == 1 and vectors):
        for x, y in itertools.product(vectors, repeat=2):
            matrix = ast.Call(ast.Name(name, ast.Load()), [x], [])
            for one in (matrix, _transposed(matrix)):
                yield ast.BinOp(one, ast.MatMult(), y)
                for inertia in inertias:
                    yield ast.BinOp(ast.BinOp(one, ast.MatMult(), inertia), ast.MatMult(), y)


def _length(node: ast.expr) -> tuple[int, int]:
    """Return how many different names an expression has, and how many operations."""
    parts = list(ast.walk(node))
    of_functions = {id(x.func) for x in parts if isinstance(x, ast.Call)}
    of_functions |= {id(x.value) for x in parts if isinstance(x, ast.Attribute)}
    counters = {id(x.slice) for x in parts if isinstance(x, ast.Subscript)}
    names = {x.id for x in parts if isinstance(x, ast.Name) and id(x) not in of_functions | counters}
    return len(names), sum(isinstance(x, ast.Call) for x in parts)


def _has_call(node: ast.expr) -> bool:
    """Tell whether an expression is a call with another one in it."""
    return isinstance(node, ast.Call) and any(isinstance(part, ast.Call) for part in node.args)


def _of_operation(node: ast.BinOp) -> Iterator[Choice]:
    left, op, right = node.left, node.op, node.right
    match op:
        case ast.Add():
            yield "sign", ast.BinOp(left, ast.Sub(), right)
            yield "sign", ast.BinOp(right, ast.Sub(), left)
            yield from (("extra", left), ("extra", right))
        case ast.Sub():
            yield "sign", ast.BinOp(left, ast.Add(), right)
            yield from (("extra", left), ("extra", _negative(right)))
        case ast.Mult():
            yield from (_without_factor(left, right), _without_factor(right, left))
        case ast.Div():
            yield ("factor" if isinstance(right, ast.Constant) else "product"), left
            yield "product", ast.BinOp(left, ast.Mult(), right)
        case ast.Pow():
            yield from (("square", left), ("square", _power(left, 3)))
            if is_sum(left):  # (l1 + lc2)² for l1² + lc2²
                yield "square", ast.BinOp(_power(left.left, 2), left.op, _power(left.right, 2))
        case ast.MatMult():
            yield "transposed", ast.BinOp(ast.Attribute(left, "T", ast.Load()), op, right)
            yield "transposed", ast.BinOp(left, op, ast.Attribute(right, "T", ast.Load()))
            yield from (("transposed", right), ("transposed", left))
            yield "swapped", ast.BinOp(right, op, left)
            if isinstance(left, ast.BinOp) and isinstance(left.op, ast.MatMult):
                turned = ast.BinOp(_transposed(left.left), op, left.right)
                yield "transposed", ast.BinOp(turned, op, _transposed(right))
            yield "product", ast.BinOp(node, op, _transposed(left))
            yield "product", ast.BinOp(_transposed(right), op, node)


def _without_factor(factor: ast.expr, rest: ast.expr) -> Choice:
    """Return a product without one of its two factors: -m for -2 * m."""
    match factor:
        case ast.Constant():
            return "factor", rest
        case ast.UnaryOp(operand=ast.Constant()):
            return "factor", _negative(rest)
    return "product", rest


def _transposed(node: ast.expr) -> ast.expr:
    back = isinstance(node, ast.Attribute) and node.attr == "T"
    return node.value if back else ast.Attribute(node, "T", ast.Load())  # type: ignore[attr-defined]


def _of_call(node: ast.Call, scope: Scope) -> Iterator[Choice]:
    match function_name(node), node.args:
        case ("sin" | "cos") as name, [angle]:
            yield "trig", ast.Call(_rename(node.func, _TURNS[name]), [angle], [])
            for kind, other in _of_angle(angle, scope):
                yield kind, ast.Call(node.func, [other], [])
        case "range", [*before, end]:
            for step in (1, -1):
                shifted = ast.BinOp(end, ast.Add(), ast.Constant(step))
                yield "index", ast.Call(node.func, [*before, shifted], [])
        case "einsum", [ast.Constant(value=str() as indices), *rest]:
            for text in _other_indices(indices):
                yield "index", ast.Call(node.func, [ast.Constant(text), *rest], node.keywords)
        case "cross", [a, b]:
            yield from (("cross", ast.Call(node.func, [b, a], [])), ("cross", b))
        case _, args:
            for k in range(len(args) - 1):
                items = [*args[:k], args[k + 1], args[k], *args[k + 2 :]]
                yield "swapped", ast.Call(node.func, items, node.keywords)


def _other_indices(indices: str) -> Iterator[str]:
    """Yield the indices of a sum of products with two letters of an array in each other's place."""
    parts = re.split(r"(\W+)", indices)
    for k, part in enumerate(parts):
        for i, j in itertools.combinations(range(len(part)) if part.isalpha() else (), 2):
            letters = [*part]
            letters[i], letters[j] = letters[j], letters[i]
            yield "".join([*parts[:k], *letters, *parts[k + 1 :]])


def _of_angle(angle: ast.expr, scope: Scope) -> Iterator[Choice]:
    """Yield what belongs in a sine or cosine: degrees, another zero, another joint as well, half or twice."""
    yield "degrees", ast.BinOp(angle, ast.Mult(), ast.Constant(math.pi / 180))
    yield "degrees", ast.BinOp(angle, ast.Mult(), ast.Constant(180 / math.pi))
    yield "angle", ast.BinOp(angle, ast.Add(), ast.Constant(math.pi / 2))
    yield "angle", ast.BinOp(angle, ast.Add(), ast.Constant(math.pi))
    yield "angle", ast.BinOp(angle, ast.Sub(), ast.Constant(math.pi / 2))
    for other in scope.joints:
        yield "angle", ast.BinOp(angle, ast.Add(), other)
        yield "angle", ast.BinOp(angle, ast.Sub(), other)
    for factor in (2, 0.5):
        yield "angle", _times(ast.Constant(factor), angle)


def _of_own(node: ast.Call, scope: Scope) -> Iterator[Choice]:
    """Yield another function of the file for one, and what one is called with."""
    if isinstance(node.func, ast.Name) and node.func.id in scope.functions:
        for other, count in scope.functions.items():
            if count == len(node.args) and other != node.func.id:
                yield "name", ast.Call(ast.Name(other, ast.Load()), node.args, [])
        yield from (("extra", x) for x in node.args[:1] if len(node.args) == 1)


def _of_name(node: ast.Name, scope: Scope) -> Iterator[Choice]:
    yield from (("name", x) for x in scope.alike(node))
    kind = scope.kinds.get(node.id)
    if isinstance(kind, tuple) and len(kind) == 2:
        yield "transposed", ast.Attribute(node, "T", ast.Load())


def _of_subscript(node: ast.Subscript, scope: Scope) -> Iterator[Choice]:
    for kind, index in indices(node.slice, scope):
        yield kind, ast.Subscript(node.value, index, node.ctx)
    if isinstance(node.slice, ast.Name | ast.BinOp):
        yield "transposed", ast.Attribute(node, "T", ast.Load())
    if not (isinstance(node.slice, ast.Name) and isinstance(node.value, ast.Name)):
        return
    # Where two loops meet: of the last link the centre of mass.
    others = [x for x in scope.entries if ast.unparse(x).endswith(f"[{node.slice.id}]")]
    counters = [name for name in scope.integers() if name != node.slice.id]
    for other, name in itertools.product(others, counters):
        meet = ast.Compare(node.slice, [ast.Eq()], [ast.Name(name, ast.Load())])
        yield "index", ast.IfExp(meet, other, node)
        yield "index", ast.IfExp(meet, node, other)


def indices(index: ast.expr, scope: Scope) -> Iterator[Choice]:
    """Yield other indices: another number, key or variable, two of them swapped."""
    match index:
        case ast.Constant(value=int() as k):
            yield from (("index", ast.Constant(other)) for other in range(4) if other != k)
            for name in scope.integers():
                yield "index", ast.Name(name, ast.Load())
                yield "index", ast.BinOp(ast.Name(name, ast.Load()), ast.Add(), ast.Constant(1))
        case ast.Constant(value=str() as key):
            yield from (("name", ast.Constant(name)) for name in scope.keys if name != key)
        case ast.Slice(lower=lower, upper=upper, step=None) if (lower is None) != (upper is None):
            yield "index", ast.Slice(upper, lower)
            yield from (("index", x) for x in _shifted_slices(lower, upper))
        case ast.Tuple(elts=items):
            for j, k in itertools.combinations(range(len(items)), 2):
                swapped = [*items]
                swapped[j], swapped[k] = items[k], items[j]
                yield "index", ast.Tuple(swapped, ast.Load())
            yield from _of_pages(items, scope)
        case ast.Name(id=name):
            yield from _of_counter(name, scope)
        case ast.BinOp():
            if isinstance(index.left, ast.Name):
                yield "index", index.left
                yield from _of_counter(index.left.id, scope)
            yield from _of_flat_index(index, scope)


def _of_pages(items: Sequence[ast.expr], scope: Scope) -> Iterator[Choice]:
    """Yield other pages and columns of an array: ``R[:, :, i + 1]`` for ``R[:, :, i]``, ``z[:, 1]`` for 0."""
    if not any(isinstance(item, ast.Slice) for item in items):
        return
    for k, item in enumerate(items):
        if not isinstance(item, ast.Name | ast.BinOp | ast.Constant):
            continue
        for kind, other in indices(item, scope):
            yield kind, ast.Tuple([*items[:k], other, *items[k + 1 :]], ast.Load())


def _of_counter(name: str, scope: Scope) -> Iterator[Choice]:
    """Yield other variables for one that counts, the next one and the one before."""
    others = (other for other in scope.integers() if other != name)
    yield from (("index", ast.Name(other, ast.Load())) for other in others)
    for step in (1, -1):
        yield "index", ast.BinOp(ast.Name(name, ast.Load()), ast.Add(), ast.Constant(step))


def _of_flat_index(index: ast.BinOp, scope: Scope) -> Iterator[Choice]:
    """Yield other indices of an array by rows: 2 * n + 1 for 2 * n + 2, i * n + j for i + j or j * n + i."""
    places = [x for x in ast.walk(index) if isinstance(x, ast.Constant) and type(x.value) is int]
    for place in places:
        for k in (k for k in range(4) if k != place.value):
            yield "index", with_part(index, place, ast.Constant(k))
    names = [x for x in ast.walk(index) if isinstance(x, ast.Name)]
    for one, other in itertools.combinations(names, 2):
        if one.id != other.id:
            swap = (one, ast.Name(other.id, ast.Load()), other, ast.Name(one.id, ast.Load()))
            yield "index", with_part(index, *swap)
    for one in names:
        for name in (name for name in scope.integers() if name != one.id):
            yield "index", with_part(index, one, ast.Name(name, ast.Load()))
    if isinstance(index.op, ast.Add):
        known = {x.id for x in names}
        for name in (name for name in scope.integers() if name not in known):
            rows = ast.BinOp(index.left, ast.Mult(), ast.Name(name, ast.Load()))
            yield "index", ast.BinOp(rows, ast.Add(), index.right)


def with_part(node: Any, *swaps: ast.expr) -> Any:
    """Return an expression with others in place of some of its parts, given as old, new, old, new..."""
    if isinstance(node, list):
        return [with_part(x, *swaps) for x in node]
    for old, new in zip(swaps[::2], swaps[1::2], strict=True):
        if node is old:
            return new
    if not isinstance(node, ast.expr):
        return node
    return type(node)(**{name: with_part(value, *swaps) for name, value in ast.iter_fields(node)})


def _shifted_slices(*ends: ast.expr | None) -> Iterator[ast.Slice]:
    """Yield slices with one link more, or fewer."""
    for step in (1, -1):
        yield ast.Slice(*(None if x is None else _shifted(x, step) for x in ends))


def _shifted(node: ast.expr, step: int) -> ast.expr:
    """Return an index that is one more or less, k and not k + 1 - 1."""
    match node:
        case ast.Constant(value=int() as k):
            return ast.Constant(k + step)
        case ast.BinOp(left=left, op=ast.Add(), right=ast.Constant(value=1)) if step == -1:
            return left
        case ast.BinOp(left=left, op=ast.Sub(), right=ast.Constant(value=1)) if step == 1:
            return left
    return ast.BinOp(node, ast.Add() if step > 0 else ast.Sub(), ast.Constant(1))


def _of_row(node: ast.Tuple | ast.List, scope: Scope) -> Iterator[Choice]:
    items = node.elts
    for k in range(len(items) - 1):
        if ast.dump(items[k]) != ast.dump(items[k + 1]):
            swapped = [*items[:k], items[k + 1], items[k], *items[k + 2 :]]
            yield "swapped", type(node)(swapped, ast.Load())
    if all(isinstance(x, ast.Tuple) for x in items):
        more = _siblings(node, items, scope)
        yield from (("term", type(node)([*items, x], ast.Load())) for x in more)
    rows = [x.elts for x in items if isinstance(x, ast.List) and len(x.elts) == len(items) > 1]
    if len(rows) == len(items):
        columns = (ast.List([*column], ast.Load()) for column in zip(*rows, strict=True))
        yield "transposed", ast.List([*columns], ast.Load())
    if len(items) == 6:  # a twist or an inertia with its other half first
        yield "swapped", type(node)([*items[3:], *items[:3]], ast.Load())


def function_name(node: ast.Call) -> str:
    """Return the last part of a function's name."""
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def _rename(func: ast.expr, name: str) -> ast.expr:
    if isinstance(func, ast.Attribute):
        return ast.Attribute(func.value, name, ast.Load())
    return ast.Name(name, ast.Load())


def _times(factor: ast.expr, node: ast.expr) -> ast.expr:
    """Return a product as it is written, 2 * a * b and not 2 * (a * b)."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, _PRODUCTS):
        return ast.BinOp(_times(factor, node.left), node.op, node.right)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):  # -2 * a, not 2 * -a
        return ast.BinOp(ast.UnaryOp(node.op, factor), ast.Mult(), node.operand)
    return ast.BinOp(factor, ast.Mult(), node)


def _negative(node: ast.expr) -> ast.expr:
    """Return what has the other sign, -a * b and not -(a * b)."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, _PRODUCTS):
        return ast.BinOp(_negative(node.left), node.op, node.right)
    return node.operand if isinstance(node, ast.UnaryOp) else ast.UnaryOp(ast.USub(), node)


def _power(node: ast.expr, exponent: int) -> ast.expr:
    return ast.BinOp(node, ast.Pow(), ast.Constant(exponent))
