"""Single changes of a model's source, tried until the model agrees: a repair, and with it the mistake's name.

Where the source of a model can be read, every expression in it gets its alternatives: the other sign, a
factor 2 more or less, the other of sine and cosine, another name or index, a term or a factor more or less,
a rotation transposed. All of them are compiled at once, each behind a switch, so that trying one costs no
more than calling the model. Which of them are tried says :mod:`armgpi.validation.search`.
"""

from __future__ import annotations

import ast
import copy
import gc
import inspect
import itertools
import re
import signal
import sys
import time
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, cached_property, lru_cache
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any, NamedTuple, TypeGuard, TypeVar

import numpy as np

from armgpi.base.arrays import Array
from armgpi.validation.alternatives import (
    Scope,
    alternatives,
    filled_by_functions,
    formula_of,
    function_name,
    indices,
    insertion,
    names_in,
    names_with,
    of_text,
    scope_of,
    scope_of_texts,
    vector_terms,
)
from armgpi.validation.dictionary import Dictionary
from armgpi.validation.graph import GIVEN, Expression, Matrix, Program, is_drawn, states_of
from armgpi.validation.models import ALIASES, ARGUMENTS, Origin, States, Unusable, names_of
from armgpi.validation.units import Slopes, numbers

#: Time of the processor that one changed call of the model may take [s]: a change may make it endless.
PATIENCE = 0.5
#: A trial that takes so long is rare: equations of motion that are derived anew [s].
_LONG = 0.03
#: Configurations at which changes are tried.
ROWS = 8
#: Shapes of arrays of which an entry may have been forgotten.
_SMALL = frozenset((rows,) * count for rows in (1, 2, 3, 4) for count in (1, 2, 3))
#: Modules that a source may import when changes of it are tried, and names that it must not have: a change
#: may make it do anything with a file.
_HARMLESS = frozenset(
    "math cmath numpy scipy sympy casadi dataclasses types typing functools itertools operator json io re "  # noqa: SIM905
    "collections abc enum fractions copy random time warnings __future__ matplotlib armgpi".split()
)
_HARMFUL = frozenset(
    "open exec input __import__ save savez savetxt tofile dump system".split()  # noqa: SIM905
)
#: What computes formulas that are texts: these must not have such names either.
_READERS = frozenset(("eval", "compile", "sympify", "parse_expr", "evaluate"))
#: Names under which switches and values of missing terms are known to the compiled code.
_SWITCH, _TERM = "_armgpi_switch", "_armgpi_term"
#: Name of the function inside of which a closure is compiled.
_OUTER = "_armgpi_outer"
#: Factors between units: of masses and lengths, and of angles.
_UNITS = (1000.0, 0.001, 100.0, 0.01, 1e6, 1e-6, np.pi / 180.0, 180.0 / np.pi)
#: What gravity is usually taken for [m/s²].
GRAVITY = (9.81, 9.8, 9.80665, 9.806, 9.807, 10.0)
#: Fields whose expressions stay as they are.
_KEPT = {"func", "targets", "target", "slice", "decorator_list", "annotation", "returns"}


#: Name of the states in which everything moves.
ALL = ""


class Target(NamedTuple):
    """What a function of the model, or a part of it, should give; of a forward dynamics :func:`apart`.

    A part is what is left when the values at rest, or with one joint moving, are taken off: the gravity in a
    torque, the share of one acceleration, of one product of velocities.

    Attributes:
        function: its name.
        values: the reference's values, (rows, m).
        tolerance: how far each of the m may be off, (m,).
        best: values, (rows, k), that are preferred where several fit: the matrix of the Christoffel symbols.
        states: names of the states whose values are added, with their signs.
    """

    function: str
    values: Array
    tolerance: Array
    best: Array | None = None
    states: tuple[tuple[float, str], ...] = ((1.0, ALL),)

    @property
    def whole(self) -> bool:
        """Whether it is all that the function gives."""
        return self.states[0][1] == ALL


class Goal(NamedTuple):
    """What a model should give.

    Attributes:
        states: states by their names, arrays (rows, n).
        targets: what its functions, and their parts, should give there; the whole ones first, by their names.
        slopes: the robot's derivatives by its numbers, of the whole functions.
        passive: whether a forward dynamics does not read every torque, and is compared as it is.
    """

    states: Mapping[str, States]
    targets: Mapping[str, Target]
    slopes: Slopes | None = None
    passive: bool = False

    def away(self, name: str, values: Array) -> Any:
        """Return which values differ from what a function should give, (rows, m)."""
        target = self.targets[name]
        return ~(np.abs(values - target.values[: len(values)]) <= target.tolerance)

    def arguments(self, function: str, label: str, row: int) -> list[Array]:
        """Return the arguments of a call, as copies."""
        return [getattr(self.states[label], letter)[row].copy() for letter in ARGUMENTS[function]]

    def call(self, calls: Mapping[str, Callable[..., Any]], function: str, label: str, row: int) -> Array:
        """Return what a function gives at one state, flat.

        Raises:
            Unusable: when it gives no numbers, or what it gives cannot be taken apart.
        """
        state = self.arguments(function, label, row)
        one = calls[function]
        is_apart = function == "forward_dynamics" and not self.passive
        try:
            value = apart(one, *state) if is_apart else one(*state)
            return self.flat(function, value, label, row)
        except (np.linalg.LinAlgError, TypeError, ValueError) as error:
            raise Unusable(f"{function} returns no array of numbers, or no invertible one") from error

    def flat(self, function: str, value: Any, label: str, row: int) -> Array:
        """Return what a function gave as a flat array: C v for C, the position of a pose."""
        if hasattr(value, "tolist") and not isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        array = np.asarray(value, dtype=np.float64)
        if function == "coriolis_matrix":
            array = array @ self.states[label].v[row]
        elif function == "forward_kinematics" and array.shape == (4, 4):
            array = array[:3, 3]
        return array.ravel()


class Change(NamedTuple):
    """One change of the source.

    Attributes:
        kind: short name of the kind of mistake that it undoes.
        span: first line, first column, last line, last column; lines from 1, columns in UTF-8 bytes.
        old: what stands there.
        new: what has to.
        where: the function that it is in, "" for the module itself.
        name: of a number that has one, else "".
        bits: how long its description is.
        reaches: the model's functions that depend on it.
    """

    kind: str
    span: tuple[int, int, int, int]
    old: str
    new: str
    where: str
    name: str
    bits: float
    reaches: frozenset[str] = frozenset()


def apply_changes(source: str, changes: tuple[Change, ...]) -> str:
    """Return a source with some changes made."""
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    for change in sorted(changes, key=lambda c: c.span, reverse=True):
        first, start, last, end = change.span
        tail = lines[last - 1][end:]
        head = lines[first - 1][:start]
        lines[first - 1 : last] = [head + change.new.encode() + tail]
    return b"".join(lines).decode()


class Site(NamedTuple):
    """An expression with its alternatives; the last one is the sum with a term that is solved for.

    Of a whole sum that before the last is the sum with what a function of the local variables gives.
    """

    node: ast.expr
    parent: Any
    choices: list[tuple[str, ast.expr]]
    fitted: bool
    literal: str  # name of a number that has one
    whole: bool  # a sum, or all that is assigned, where vectors may be missing
    statement: str = ""  # what a forgotten one begins with: "M[0, 0] += "
    span: tuple[int, int, int, int] | None = None  # of what is changed, where it is not the expression


class Pick(NamedTuple):
    """One alternative of one site, with the values of its missing term and its text."""

    block: Block
    site: int
    choice: int
    bits: float
    values: dict[str, Array] | None = None  # of the missing term, (rows, ...) by states
    kind: str = ""
    new: str = ""
    sure: bool = False  # its effect is known to be what lacks
    call: Callable[[dict[str, Any]], Any] | None = None  # gives the term from the local variables

    @property
    def constant(self) -> float:
        """The missing term where it is the same at all states."""
        assert self.values is not None
        return float(next(iter(self.values.values()))[0])

    def term(self, label: str) -> Array:
        """Return the missing term at some states: by its text, nothing where it has none yet.

        Raises:
            ValueError: when it has no value there.
        """
        assert self.values is not None
        if label not in self.values:
            old = ast.unparse(self.block.sites[self.site].node)
            there, here = (self.block.values(text, label) for text in (self.new or old, old))
            if there is None or here is None or there.shape != here.shape:
                raise ValueError
            self.values[label] = there - here
        return self.values[label]


class Block:
    """A function of the model, or the assignments of its module, with switches compiled in."""

    def __init__(
        self, k: int, name: str, body: list[ast.stmt], namespace: dict[str, Any], everywhere: ast.AST
    ) -> None:
        """Take statements, the globals that they see, and the whole file."""
        self.everywhere, self.literals = everywhere, _literals(everywhere)
        self.name, self.body, self.namespace = name, body, namespace
        self.names = (f"{_SWITCH}{k}", f"{_TERM}{k}")
        self.calls: dict[str, list[dict[str, Any]]] = {}  # the local variables, by states, at every row
        self.once_seen: dict[str, Any] = {}  # the local variables of the first call
        self.once = True
        self.once_in: set[str] = set()  # functions that call it once
        self.rebuilds = False  # whether the functions have to be read again after a change
        self.sites: list[Site] = []
        self.switch: list[int] = []
        self.terms: list[Any] = []
        self.reaches: set[str] = set()
        self.others: set[ast.AST] = set()  # functions inside of it that have switches of their own
        self.checks_choices = False  # whether each alternative is compiled alone first
        self.values_of: Callable[[Any, str], Any] = lambda value, _: (
            value
        )  # expressions as values at the rows
        self.scope = Scope({})
        self._dictionaries: dict[int, Dictionary] = {}

    def switchable(self, arguments: tuple[str, ...]) -> ast.Module:
        """Return the statements with every alternative of every expression behind its switch."""
        values = {**_numbers(self.namespace), **(self.calls[ALL][0] if self.calls else self.once_seen)}
        self.scope = scope_of(ast.Module(self.body, []), values, arguments, self.everywhere)
        self.sites.clear()
        module = ast.Module([self._rebuilt(statement) for statement in self.body], [])
        function = module.body[0]
        if isinstance(function, ast.FunctionDef) and self.name:
            # Decorators, defaults and annotations have no value there.
            args = copy.deepcopy(function.args)
            args.defaults, args.kw_defaults = [], [None] * len(args.kwonlyargs)
            for part in ast.walk(args):
                if isinstance(part, ast.arg):
                    part.annotation = None
            function.decorator_list, function.returns, function.args = [], None, args
        self.switch, self.terms = [0] * len(self.sites), list[Any]([0.0]) * len(self.sites)
        self.namespace[self.names[0]], self.namespace[self.names[1]] = self.switch, self.terms
        return module

    def _rebuilt(self, node: Any, parent: Any = None) -> Any:
        """Return a copy in which every expression can be switched to its alternatives."""
        if isinstance(node, list):
            return [
                y
                for x in node
                for y in (self._with_other_assignment(x, self._rebuilt(x, parent)), *self._with_forgotten(x))
            ]
        kept = isinstance(node, ast.arguments | ast.JoinedStr) or node in self.others
        # Of what a comprehension goes through only the ends of a range: half of a step is no mistake.
        kept = kept or (isinstance(node, ast.comprehension) and not _is_range(node.iter))
        if not isinstance(node, ast.AST) or kept:
            return node
        children = {
            name: value if name in _KEPT else self._rebuilt(value, node)
            for name, value in ast.iter_fields(node)
        }
        if isinstance(node, ast.Assign | ast.AugAssign):
            assigned = "targets" if isinstance(node, ast.Assign) else "target"
            children[assigned] = self._with_places(children[assigned])
        new = ast.copy_location(type(node)(**children), node)
        return self._with_switch(node, parent, new) if _has_value(node) else new

    def _with_switch(self, node: Any, parent: Any, new: Any) -> Any:
        """Return an expression that can be switched to its alternatives, `new` without a switch."""
        later, names = self.later(node.lineno), dict[int, set[str]]()
        every = [*alternatives(node, parent, self.scope)]  # they share their parts
        choices = [one for one in every if not (later and later & names_in(one[1], names))]
        literal = self.literals.get(node, "")
        choices += _other_values(node) if literal else ()
        choices += of_text(node, self.formulas)
        if self.checks_choices:
            choices = [one for one in choices if code_of(one[1]) is not None]
        fitted = insertion(node, parent) or _is_coefficient(node, parent)
        number = len(self.sites)
        whole = fitted and not self.rebuilds and _is_whole(node, parent)
        at = ast.Subscript(ast.Name(self.names[1], ast.Load()), ast.Constant(number), ast.Load())
        if whole:
            there = ast.Call(at, [ast.Call(ast.Name("locals", ast.Load()), [], [])], [])
            choices.append(("term", ast.BinOp(node, ast.Add(), there)))
        if fitted:
            choices.append(("term", ast.BinOp(node, ast.Add(), at)))
        if not choices:
            return new
        self.sites.append(Site(node, parent, choices, fitted, literal, whole))
        return self._add_switch(number, [choice for _, choice in choices], new)

    @cached_property
    def formulas(self) -> Scope:
        """What can be written in the formulas that are texts of the file; nothing where it computes none."""
        texts = _texts(self.everywhere) if reads_texts(self.everywhere) else ()
        return scope_of_texts(texts, (name.strip("'") for name, _ in numbers(self.everywhere)))

    def _with_places(self, target: Any) -> Any:
        """Return what is assigned, where an entry's index can be switched to others."""
        if isinstance(target, list):
            return [self._with_places(x) for x in target]
        if not isinstance(target, ast.Subscript) or self.rebuilds:
            return target
        others = [one for one in indices(target.slice, self.scope) if one[0] == "index"]
        if not others:
            return target
        number = len(self.sites)
        texts: list[tuple[str, ast.expr]] = [
            (kind, ast.Subscript(target.value, index, ast.Load())) for kind, index in others
        ]
        self.sites.append(Site(target, None, texts, False, "", False))
        index = self._add_switch(number, [index for _, index in others], target.slice, is_looked_at=False)
        return ast.copy_location(ast.Subscript(target.value, index, ast.Store()), target)

    def _with_other_assignment(self, statement: Any, new: Any) -> Any:
        """Return a statement that can be switched from = to +=, or from += to =."""
        match statement:
            case ast.Assign(targets=[ast.Name() | ast.Subscript() as target]) if self._may_have_value(target):
                other: ast.stmt = ast.AugAssign(target, ast.Add(), statement.value)
                text = "+="
            case ast.AugAssign(op=ast.Add(), target=ast.Name() | ast.Subscript() as target):
                other, text = ast.Assign([target], statement.value), "="
            case _:
                return new
        value, number = statement.value, len(self.sites)
        if target.end_lineno != value.lineno:
            return new
        span = (value.lineno, target.end_col_offset or 0, value.lineno, value.col_offset)
        self.sites.append(Site(value, statement, [("operator", ast.Name(text))], False, "", False, "", span))
        at = ast.Subscript(ast.Name(self.names[0], ast.Load()), ast.Constant(number), ast.Load())
        return ast.If(at, [ast.copy_location(other, statement)], [new])

    def _may_have_value(self, target: ast.expr) -> bool:
        """Tell whether what is assigned may have a value before: something to which a term may be added."""
        root: Any = target
        while isinstance(root, ast.Subscript):
            root = root.value
        if not isinstance(root, ast.Name):
            return False
        if isinstance(target, ast.Subscript):
            return True
        return self._first.get(root.id, target.lineno) < target.lineno

    def _with_forgotten(self, statement: Any) -> Iterator[ast.stmt]:
        """Yield statements that may be missing after one, each behind its switch."""
        at: dict[str, Any] = {
            "lineno": getattr(statement, "end_lineno", 0),
            "col_offset": getattr(statement, "end_col_offset", 0),
        }
        for begin in self._statements.get(statement, ()):
            number, switch, term = len(self.sites), *self.names
            nothing = ast.Constant(0, **at, end_lineno=at["lineno"], end_col_offset=at["col_offset"])
            choices: list[tuple[str, ast.expr]] = [("term", nothing)]
            site = Site(nothing, statement, choices, fitted=True, literal="", whole=False, statement=begin)
            self.sites.append(site)
            yield from ast.parse(f"if {switch}[{number}]: {begin}{term}[{number}]").body

    @cached_property
    def _statements(self) -> dict[ast.stmt, list[str]]:
        """How statements begin that set an entry nothing sets, or add to one, after those on its array."""
        found: dict[ast.stmt, list[str]] = {}
        if self.rebuilds:
            return found
        function: Any = self.body[0]
        stored = [
            (statement, node)
            for statement in function.body
            for node in ast.walk(statement)
            if isinstance(getattr(node, "ctx", None), ast.Store)
        ]
        given = {ast.unparse(node) for _, node in stored}
        zeros = {ast.unparse(node) for statement, node in stored if _makes_zeros(statement)}
        # Of an entry its array; the last statement of each.
        last = {ast.unparse(getattr(node, "value", node)): statement for statement, node in stored}
        for name, statement in last.items():
            shape = self.scope.kinds.get(name)
            if name.isidentifier() and shape in _SMALL:
                found.setdefault(statement, []).extend(_beginnings(name, shape, name in zeros, given))
        return found

    def _add_switch(
        self, number: int, choices: list[ast.expr], new: ast.expr, is_looked_at: bool = True
    ) -> ast.expr:
        """Return an expression that gives one of the choices when its switch says so.

        Args:
            number: which switch it is.
            choices: the alternatives.
            new: the expression itself.
            is_looked_at: whether a switch below zero gives what its term makes of the local variables.
        """
        at = ast.Subscript(ast.Name(self.names[0], ast.Load()), ast.Constant(number), ast.Load())

        def among(low: int, high: int) -> ast.expr:
            if high - low == 1:
                return choices[low]
            middle = (low + high) // 2
            # Halving: some sites have thousands.
            first = ast.Compare(at, [ast.LtE()], [ast.Constant(middle)])
            return ast.IfExp(first, among(low, middle), among(middle, high))

        one_of_them = among(0, len(choices))
        if is_looked_at:
            looking = ast.Subscript(ast.Name(self.names[1], ast.Load()), ast.Constant(number), ast.Load())
            seen = ast.Call(looking, [ast.Call(ast.Name("locals", ast.Load()), [], [])], [])
            is_looking = ast.Compare(at, [ast.Lt()], [ast.Constant(0)])
            one_of_them = ast.IfExp(is_looking, seen, one_of_them)
        return ast.IfExp(at, one_of_them, new)

    @cached_property
    def _first(self) -> dict[str, int]:
        """The line in which each name of the block is assigned first."""
        stored = [(n.lineno, n.id) for n in names_with(ast.Store, *self.body)]
        return {name: line for line, name in sorted(stored, reverse=True)}

    def later(self, line: int) -> frozenset[str]:
        """Return the names that have no value before a line."""
        return frozenset(name for name, first in self._first.items() if first >= line)

    @cached_property
    def used(self) -> set[str]:
        """Names that are read anywhere in the file."""
        return {n.id for n in names_with(ast.Load, self.everywhere)}

    def _written_in(self, line: int) -> set[str]:
        """Return the expressions that stand in a line."""
        found = (
            n for s in self.body for n in ast.walk(s) if isinstance(n, ast.Name | ast.Subscript | ast.Call)
        )
        return {ast.unparse(node) for node in found if node.lineno == line}

    def dictionary(self, line: int) -> Dictionary:
        """Return the products of names that can be written in a line, those that stand in it first."""
        if line in self._dictionaries:
            return self._dictionaries[line]
        later, there = self.later(line), self._written_in(line)
        texts = [name for name, kind in self.scope.kinds.items() if kind == "float"]
        texts += map(ast.unparse, (*self.scope.scalars, *self.scope.items))
        # What stands in the line, then what stands nowhere: that is what was forgotten.
        texts.sort(key=lambda text: (text not in there, text in self.used or not text.isidentifier()))
        constants, states = {}, {}
        for text in dict.fromkeys(texts):
            known = not later or not later & names_in(ast.parse(text))
            values = self.values(text) if known else None
            if values is None or values.ndim > 1:
                continue
            if np.ptp(values) == 0.0:
                constants[text] = float(values[0])
            else:
                states[text] = values
        self._dictionaries[line] = Dictionary(constants, states)
        return self._dictionaries[line]

    def values(self, text: str, label: str = ALL) -> Array | None:
        """Return what an expression is at the rows of some states; None where it has no value there."""
        code = compile(text, "<term>", "eval")
        try:
            found = [eval(code, self.namespace, names) for names in self.calls[label]]
            if is_drawn(found[0]):
                return np.asarray(self.values_of(found[0], label))
            return np.array([x if isinstance(x, np.ndarray) else float(x) for x in found], dtype=np.float64)
        except Exception:  # a name that is not there yet, an index out of range, a variable of a loop
            return None

    @cached_property
    def terms_of_vectors(self) -> dict[str, CodeType]:
        """Terms of a vector's equation that may be missing, the short ones first."""
        texts = map(ast.unparse, vector_terms(self.scope))
        return {text: compile(text, "<term>", "eval") for text in texts}


def _is_range(node: ast.expr) -> bool:
    """Tell whether an expression counts."""
    return isinstance(node, ast.Call) and function_name(node) == "range"


def code_of(choice: ast.expr) -> CodeType | None:
    """Return the code of an expression; None for what is none alone, such as a slice."""
    try:
        return compile(_locate(ast.Expression(choice)), "<choice>", "eval")
    except (SyntaxError, TypeError, ValueError):
        return None


_Root = TypeVar("_Root", ast.Module, ast.Expression)


def _locate(root: _Root) -> _Root:
    """Give every node a line, each once: choices share most of theirs."""
    todo, seen = list[ast.AST]([root]), set[int]()
    while todo:
        node = todo.pop()
        if id(node) not in seen:
            seen.add(id(node))
            if "lineno" in node._attributes and not hasattr(node, "lineno"):
                node.lineno, node.col_offset = 1, 0  # type: ignore[attr-defined]
            todo += ast.iter_child_nodes(node)
    return root


def _other_values(node: ast.Constant) -> Iterator[tuple[str, ast.expr]]:
    """Yield a number in other units, other values of gravity, and the other sign."""
    if isinstance(node.value, float):
        yield from (("unit", ast.Constant(float(f"{node.value * unit:.12g}"))) for unit in _UNITS)
    if node.value in GRAVITY:
        yield from (("value", ast.Constant(g)) for g in GRAVITY if g != node.value)
    else:
        yield "sign", ast.UnaryOp(ast.USub(), node)


@lru_cache(maxsize=1)
def _literals(tree: ast.AST) -> dict[ast.AST, str]:
    """Return the numbers that are given a name, by an assignment or as an item of a dictionary."""
    found: list[tuple[str, ast.AST]] = []
    for node in ast.walk(tree):
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                found += [(ast.unparse(t), v) for t, v in zip(names, values, strict=False)]
            case ast.Assign(targets=[ast.Name() | ast.Attribute() as target], value=value):
                found.append((ast.unparse(target), value))
            case ast.Dict(keys=keys, values=values):
                items = zip(keys, values, strict=True)
                found += [(str(k.value), v) for k, v in items if isinstance(k, ast.Constant)]
    inner = [(name, v.operand if isinstance(v, ast.UnaryOp) else v) for name, v in found]
    return {v: name for name, v in inner if isinstance(v, ast.Constant) and isinstance(v.value, int | float)}


def _has_value(node: ast.AST) -> TypeGuard[ast.expr]:
    """Tell whether another expression may stand in place of a node."""
    stored = isinstance(getattr(node, "ctx", None), ast.Store | ast.Del)
    return isinstance(node, ast.expr) and not isinstance(node, ast.Starred | ast.Lambda) and not stored


def _makes_zeros(statement: ast.stmt) -> bool:
    value = getattr(statement, "value", None)
    return isinstance(value, ast.Call) and function_name(value) == "zeros"


def _beginnings(name: str, shape: tuple[int, ...], zeros: bool, given: Container[str]) -> list[str]:
    """Return how statements begin that set an entry of zeros that is not given, or add to a diagonal."""
    places = {at: f"{name}[{', '.join(map(str, at))}]" for at in np.ndindex(*shape)}
    if not zeros:
        return [f"{text} += " for at, text in places.items() if len(at) == 2 and at == at[::-1]]
    free = [at for at, text in places.items() if text not in given]
    begins = [f"{places[at]} = {places[at[::-1]]} = " for at in free if at < at[::-1] in free]
    return begins + [f"{places[at]} = " for at in free]


def _stored(statement: ast.AST) -> Iterator[str]:
    """Yield the names that a statement assigns, or assigns entries or attributes of."""
    for node in ast.walk(statement):
        owner = _owner(node)
        if owner is not None or isinstance(getattr(node, "ctx", None), ast.Store):
            node = owner or node
            while isinstance(node, ast.Subscript | ast.Attribute):
                node = node.value
            if isinstance(node, ast.Name):
                yield node.id


def _is_coefficient(node: ast.expr, parent: Any) -> bool:
    """Tell whether an expression is a number in a sum, such as 0.52 + 0.16 * c3."""
    return isinstance(node, ast.Constant) and isinstance(node.value, float) and isinstance(parent, ast.BinOp)


def _is_whole(node: ast.expr, parent: Any) -> bool:
    """Tell whether an expression is a sum, or all that is assigned or put at a list's end."""
    appended = isinstance(parent, ast.Call) and function_name(parent) == "append"
    summed = isinstance(node, ast.BinOp) and (isinstance(node.op, ast.Add) or appended)
    summed = summed or (isinstance(parent, ast.Call) and function_name(parent) == "cross")
    return summed or isinstance(parent, ast.Assign | ast.AugAssign)


def _numbers(namespace: Mapping[str, Any]) -> dict[str, Any]:
    """Return the globals that a block may mean: those of its module that are no functions or modules."""
    return {
        name: value
        for name, value in namespace.items()
        if not name.startswith("_") and not callable(value) and not isinstance(value, ModuleType)
    }


class _Slow(BaseException):
    """A change that makes a call endless; no `except Exception` of a model catches it."""


@contextmanager
def impatient() -> Iterator[None]:
    """End what takes too long."""

    def stop(*_: object) -> None:
        raise _Slow

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def harmless(source: str) -> bool:
    """Tell whether a source may be changed and run: it imports what computes, and opens nothing."""
    tree = ast.parse(source)
    if reads_texts(tree) and not all(map(_is_harmless_text, _texts(tree))):
        return False
    for node in ast.walk(tree):
        modules: list[str] = []
        match node:
            case ast.Import(names=aliases):
                modules = [alias.name for alias in aliases]
            case ast.ImportFrom(module=module):
                modules = [module or "."]
            case ast.Name(id=name) | ast.Attribute(attr=name) if name in _HARMFUL:
                return False
        if any(name.split(".")[0] not in _HARMLESS for name in modules):
            return False
    return True


def reads_texts(tree: ast.AST) -> bool:
    """Tell whether a source computes what is written in texts, as by ``eval``."""
    names = (getattr(x, "id", "") or getattr(x, "attr", "") for x in ast.walk(tree))
    return not _READERS.isdisjoint(names)


def _texts(tree: ast.AST) -> Iterator[str]:
    """Yield the texts of a source but for its comments."""
    comments = {x.value for x in ast.walk(tree) if isinstance(x, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in comments:
            yield node.value


def _is_harmless_text(text: str) -> bool:
    """Tell whether a text, if it is computed, opens nothing."""
    words = set(re.findall(r"\w+", text))
    if text == "eval":  # a mode of `compile`
        return True
    return "__" not in text and words.isdisjoint({*_HARMFUL, *_READERS, "import", "os", "sys"})


def cross(a: Any, b: Any, *rest: Any, _general: Any = np.cross, **options: Any) -> Any:
    """Return a cross product: that of two vectors of three in a tenth of NumPy's time."""
    if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.shape == b.shape == (3,)):
        return _general(a, b, *rest, **options)
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


class _State:
    """Arrays, lists and dictionaries of a module, and of its objects, that its functions change in place."""

    def __init__(self, module: ModuleType, calls: Iterable[Any]) -> None:
        """Keep what they hold now.

        Args:
            module: of the model.
            calls: functions of the model, maybe methods of objects.
        """
        owners = [getattr(inspect.unwrap(call), "__self__", None) for call in calls]
        held = [value for value in vars(module).values() if type(value).__module__ == module.__name__]
        named = [*vars(module).items()]
        for owner in (*owners, *held):
            named += getattr(owner, "__dict__", {}).items()
        self._kept: dict[int, tuple[str, Any, Any]] = {}
        for name, value in named:
            if name[:2] != "__" and isinstance(value, np.ndarray | list | dict):
                self._kept[id(value)] = (name, value, copy.copy(value))

    def forget_what_stays(self, filled: Container[str]) -> None:
        """Keep those alone that have changed since, and those of some names."""
        self._kept = {
            key: (name, value, before)
            for key, (name, value, before) in self._kept.items()
            if name in filled or not _is_same(value, before)
        }

    def restore(self) -> None:
        """Give all that is kept what it held at first."""
        for _, value, before in self._kept.values():
            if isinstance(value, dict):
                value.clear()
                value.update(before)
            elif isinstance(value, list):
                value[:] = before
            else:
                np.copyto(value, before)


def _is_same(value: Any, before: Any) -> bool:
    """Tell whether an array, a list or a dictionary holds what it held before: the same objects."""
    if isinstance(value, np.ndarray):
        return value.shape == before.shape and np.array_equal(value, before)
    if len(value) != len(before):
        return False
    if isinstance(value, dict):
        return all(key in before and value[key] is before[key] for key in value)
    return all(one is other for one, other in zip(value, before, strict=True))


class Editor:
    """A model's source with its switches."""

    def __init__(self, origin: Origin, goal: Goal, known: Sequence[float]) -> None:
        """Compile the switches into the model's functions.

        Args:
            origin: the file of the model.
            goal: what its functions should give.
            known: numbers that the robot has too, without signs: those are hardly the wrong ones.
        """
        self._known = np.array(known)
        self._path, self.source, self._module, self._resolve = origin
        self.goal, self.targets = goal, goal.targets
        self._tree = ast.parse(self.source)
        self._makers: set[FunctionType] = set()
        self._terms: dict[tuple[int, int], Pick] = {}  # block and site of a term that is made -> what it is
        self._calls = self._resolve().calls
        self._state = _State(self._module, self._calls.values())
        self._body = _assignments(self._tree)
        #: Whether symbols are in it: expressions that are computed at every state.
        self.drawn = any(is_drawn(x) for x in vars(self._module).values())
        self._nodes = {
            (n.name, min([n.lineno, *(d.lineno for d in n.decorator_list)])): n
            for n in ast.walk(self._tree)
            if isinstance(n, ast.FunctionDef)
        }
        found = self._reachable()
        self._add_executed(found)
        self._helpers = dict(self._called_first(found))
        self._trace_helpers()
        self._trace(found)
        self._state.forget_what_stays(filled_by_functions(self._tree))
        #: What the module's statements run.
        self._first = [*self._helpers.values()]
        found |= self._helpers
        bodies: set[ast.AST] = {block.body[0] for block in found.values()}
        for block in found.values():
            block.others, block.values_of = bodies - {*block.body}, self.values_of
        self.blocks = [self._install(function, block) for function, block in found.items()]
        self._switchable: list[ast.stmt] = []
        self._seconds: dict[str, float] = {}
        self._slices: dict[frozenset[str], CodeType] = {}  # the assignments that functions depend on
        self._assignments()
        gc.set_threshold(200_000)
        gc.freeze()  # a collection among all that SymPy and the states keep takes as long as a hundred trials

    # What the model is made of.

    def _reachable(self) -> dict[FunctionType, Block]:
        """Return the functions in the file that the model's functions call, themselves included."""
        found: dict[FunctionType, Block] = {}
        for name, target in self.targets.items():
            todo, seen = [self._calls[target.function]], set()
            while todo:
                thing = todo.pop()
                function = _plain(thing)
                if function is None or function in seen:
                    continue
                seen.add(function)
                node = self._node_of(function)
                if node is None:
                    continue
                block = found.setdefault(
                    function, Block(len(found), node.name, [node], function.__globals__, self._tree)
                )
                block.reaches.add(name)
                owner = getattr(inspect.unwrap(thing), "__self__", None)
                maker = _plain(getattr(type(owner), "__init__", None))
                if maker is not None and maker.__code__.co_filename == self._path:
                    self._makers.add(maker)
                    todo.append(maker)
                for other in names_of(function.__code__):
                    both = (function.__globals__.get(other), getattr(owner, other, None))
                    todo += filter(callable, both)
                todo += self._methods_called(function, owner)
        return found

    def _add_executed(self, found: dict[FunctionType, Block]) -> None:
        """Add the functions of the file that run when the model's do: operators, methods, items of tables."""
        for name, target in self.targets.items():
            if not target.whole:
                continue
            for code in self._codes_run_by(target.function):
                # One inside of another function is a part of that one.
                owners = [x for x in gc.get_referrers(code) if isinstance(x, FunctionType)]
                function = next((x for x in owners if "<locals>" not in x.__qualname__), None)
                node = None if function is None else self._node_of(function)
                if function is None or node is None:
                    continue
                block = found.setdefault(
                    function, Block(len(found), node.name, [node], function.__globals__, self._tree)
                )
                parts = (label for label, x in self.targets.items() if x.function == target.function)
                block.reaches |= {name, *parts}

    def _codes_run_by(self, name: str) -> dict[CodeType, None]:
        """Return the code of the file that runs when a function of the model does, in the order of calls."""
        found: dict[CodeType, None] = {}

        def watch(frame: FrameType, event: str, _: object) -> None:
            if event == "call" and frame.f_code.co_filename == self._path:
                found[frame.f_code] = None

        arguments = self.goal.arguments(name, ALL, 0)
        self._run_watched(lambda: self._calls[name](*arguments), watch)
        return found

    def _run_watched(
        self, run: Callable[[], object], watch: Callable[[FrameType, str, object], None]
    ) -> None:
        """Run something while its calls and returns are watched; the module's variables stay as they are."""
        saved = dict(vars(self._module))
        sys.setprofile(watch)
        try:
            run()
        finally:
            sys.setprofile(None)
            vars(self._module).update(saved)

    def _methods_called(self, function: FunctionType, owner: Any) -> Iterator[Any]:
        """Yield the methods of the file's objects that a function calls: of globals, and of what it owns."""
        names = names_of(function.__code__)
        held = [function.__globals__.get(name) for name in names]
        held += [vars(owner).get(name) for name in names] if hasattr(owner, "__dict__") else []
        for thing in held:
            of_file = getattr(type(thing), "__module__", None) == self._module.__name__
            for name in names if of_file else ():
                if isinstance(inspect.getattr_static(type(thing), name, None), FunctionType):
                    yield getattr(thing, name)

    def _node_of(self, function: FunctionType) -> ast.FunctionDef | None:
        """Return where a function stands in the file, None when it is none of it."""
        code = function.__code__
        if code.co_filename != self._path:
            return None
        return self._nodes.get((code.co_name, code.co_firstlineno))

    def _called_first(self, known: Mapping[FunctionType, Block]) -> Iterator[tuple[FunctionType, Block]]:
        """Yield the functions that only the module's statements call, such as one that returns functions."""
        todo, seen = [x.id for s in self._body for x in ast.walk(s) if isinstance(x, ast.Name)], set[str]()
        space: Mapping[str, Any] = vars(self._module)
        while todo:
            name = todo.pop()
            called = space.get(name)
            if isinstance(called, type):  # what its constructor calls, its methods too
                space = {**vars(called), **space}
                called = vars(called).get("__init__")
            function = _plain(called)
            if name in seen or function is None or function.__code__.co_filename != self._path:
                continue
            seen.add(name)
            todo += names_of(function.__code__)
            node = self._node_of(function)
            if function not in known and node is not None:
                block = Block(len(known) + len(seen), node.name, [node], function.__globals__, self._tree)
                block.rebuilds, block.reaches = True, set(self.targets)
                yield function, block

    def _trace_helpers(self) -> None:
        """Keep the local variables of the functions that the module's statements call."""
        code = compile(ast.Module(self._body if self._helpers else [], []), self._path, "exec")
        helpers = self._locals_while(self._helpers, lambda: exec(code, vars(self._module)))
        for block, frames in helpers.items():
            # A function that it makes may lack one of its variables.
            for name, value in _numbers(frames[0]).items() if len(frames) == 1 else ():
                block.namespace.setdefault(name, value)
            block.once, block.calls = len(frames) == 1, dict.fromkeys(self.goal.states, frames[:1] * ROWS)
            self.drawn = self.drawn or any(map(is_drawn, frames[0].values()))

    def _trace(self, functions: Mapping[FunctionType, Block]) -> None:
        """Keep the local variables of every function at every row."""
        whole = [name for name, target in self.targets.items() if target.whole] if functions else []
        # Drawn functions take long, and hardly compute anything themselves.
        labels = [ALL] if self.drawn else self.goal.states
        for name, label, row in itertools.product(whole, labels, range(ROWS)):
            arguments = self.goal.arguments(name, label, row)
            seen = self._locals_while(functions, lambda: self._calls[name](*arguments))  # noqa: B023
            for block, frames in seen.items():
                block.once_seen = block.once_seen or frames[0]
                if len(frames) == 1:
                    block.once_in.add(name)
                    block.calls.setdefault(label, []).extend(frames)
        for block in functions.values():
            block.once = bool(block.once_in)
            block.calls = {label: frames[:ROWS] for label, frames in block.calls.items()}

    def _locals_while(
        self, functions: Mapping[FunctionType, Block], run: Callable[[], object]
    ) -> dict[Block, list[dict[str, Any]]]:
        """Return the local variables of functions, of each call while something runs."""
        blocks = {function.__code__: block for function, block in functions.items()}
        found: dict[Block, list[dict[str, Any]]] = {}

        def watch(frame: FrameType, event: str, _: object) -> None:
            block = blocks.get(frame.f_code) if event == "return" else None
            if block is not None:
                found.setdefault(block, []).append(dict(frame.f_locals))

        self._run_watched(run, watch)
        return found

    def _install(self, function: FunctionType, block: Block) -> Block:
        """Put the switches into a function."""
        code, space = function.__code__, dict[str, Any]()
        if function in self._makers:
            block.rebuilds, block.once, block.calls = True, True, self._nowhere()
            block.reaches, block.once_in = set(self.targets), set()
        try:
            made = self._compiled(function, block)
        except (SyntaxError, ValueError):
            # One alternative that is no expression must not end the search of all others.
            block.checks_choices = True
            made = self._compiled(function, block)
        exec(made, space)
        if code.co_freevars:
            inner = space[_OUTER].__code__.co_consts
            function.__code__ = next(x for x in inner if isinstance(x, CodeType) and x.co_name == block.name)
        else:
            function.__code__ = space[block.name].__code__
        return block

    def _compiled(self, function: FunctionType, block: Block) -> CodeType:
        """Return what defines a function with its switches, a closure inside of another one."""
        code = function.__code__
        module = block.switchable(code.co_varnames[: code.co_argcount])
        if code.co_freevars:  # compiled inside of a function that has its variables
            outer = ast.parse(f"def {_OUTER}({', '.join(code.co_freevars)}): pass")
            outer.body[0].body = [*module.body, ast.Pass()]  # type: ignore[attr-defined]
            module = outer
        return compile(_locate(module), self._path, "exec")

    def _assignments(self) -> None:
        """Put switches into what the module assigns: constants that are computed, expressions of SymPy."""
        if not self._body:
            return
        block = Block(len(self.blocks) + 1000, "", self._body, vars(self._module), self._tree)
        block.reaches, block.calls, block.rebuilds = set(self.targets), self._nowhere(), True
        block.values_of = self.values_of
        # Symbols of the joints are to its expressions what arguments are to a function.
        matrices = {name: x for name, x in vars(self._module).items() if isinstance(x, Matrix) and x.size}
        vectors = [
            name
            for name, x in matrices.items()
            if all(isinstance(s, Expression) and s.name.endswith("]") for s in np.ravel(x))
        ]
        self._switchable = _locate(block.switchable(tuple(vectors))).body
        self.blocks.append(block)
        self._first.append(block)

    def values_of(self, value: Any, label: str) -> Array:
        """Return an expression's values at the rows of some states."""
        entries = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
        program, states = Program(entries), self.goal.states[label]
        parameters = vars(self._module).get("parameters", {})  # by names, or by symbols
        own = {**self._symbol_numbers, **{str(name): number for name, number in parameters.items()}}
        places = {**states_of(program.names - own.keys()), **self._places}
        at = [
            {s: float(getattr(states, x)[k][i]) for s, (x, i) in places.items()} for k in range(len(states.q))
        ]
        return np.array([program({**own, **one}) for one in at])

    @cached_property
    def _symbol_numbers(self) -> dict[str, float]:
        """Numbers that symbols stand for."""
        return dict(GIVEN)

    @cached_property
    def _places(self) -> dict[str, tuple[str, int]]:
        """Which entry of which argument the symbols are whose numbers are those of the first state."""
        for target in self.targets.values():
            self.goal.call(self._calls, target.function, ALL, 0)
        flat = [(x, i, y) for x in States._fields for i, y in enumerate(getattr(self.goal.states[ALL], x)[0])]
        return {name: (x, i) for name, number in GIVEN.items() for x, i, y in flat if number == y}

    def _nowhere(self) -> dict[str, list[dict[str, Any]]]:
        """Return no local variables, for every state."""
        return {label: [{}] * ROWS for label in self.goal.states}

    # Trying.

    def outputs(self, names: Iterable[str], rows: int, anew: bool = False) -> dict[str, Array] | None:
        """Return what some functions give at the first rows, None when they raise or are not finite."""
        self._state.restore()  # a change may have written where nothing else writes
        try:
            names = tuple(names)
            asked = frozenset(self.targets[name].function for name in names)
            with impatient(), np.errstate(all="ignore"), self._functions_now(asked, anew) as calls:

                @cache
                def value_at(function: str, label: str, row: int) -> Array:
                    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
                    self._place_terms(label, row)
                    return self.goal.call(calls, function, label, row)

                found = {name: stack_values(self.targets[name], value_at, rows) for name in names}
        except (Exception, _Slow):
            return None
        return found if all(np.isfinite(x).all() for x in found.values()) else None

    @contextmanager
    def _functions_now(
        self, asked: frozenset[str], anew: bool = False
    ) -> Iterator[Mapping[str, Callable[..., Any]]]:
        """Give the functions with the changes, read again where these are in what makes them."""
        for (number, site), pick in self._terms.items():
            constant = self.is_constant(self.blocks[number], site)
            self.blocks[number].terms[site] = pick.constant if constant else Expression("term")
        if not (anew or any(any(block.switch) for block in self.blocks if block.rebuilds)):
            yield self._calls
            return
        space = vars(self._module)
        saved = dict(space)
        try:
            if self._switchable and (anew or any(any(block.switch) for block in self._first)):
                exec(self._code_of(asked), space)
            yield self._resolve().calls
        finally:
            space.update(saved)

    def is_slow(self) -> bool:
        """Tell whether a trial derives the equations anew for long, as by Kane's method."""
        start, rebuilds = time.process_time(), any(block.rebuilds for block in self.blocks)
        outputs = self.outputs([*self.targets][:1], 1, anew=True) if rebuilds else None
        return outputs is not None and time.process_time() - start > _LONG

    def seconds(self, name: str) -> float:
        """Return how long a function takes that is drawn anew, 0 for others."""
        if name not in self._seconds:
            self._seconds[name], start = 0.0, time.process_time()
            if self.drawn:
                self.outputs([name], 1, anew=True)
                self._seconds[name] = time.process_time() - start
        return self._seconds[name]

    def _code_of(self, asked: frozenset[str]) -> CodeType:
        """Return the module's assignments that some functions depend on."""
        if asked not in self._slices:
            short = vars(self._module).get(ALIASES, {})
            own = {*asked, *(short[name] for name in asked if name in short)}
            needed = self._with_called(own) | {"parameters"}  # whose numbers expressions are given
            chosen: set[int] = set()
            for _ in self._body:  # loops carry names forward
                before = len(chosen)
                for k, statement in reversed([*enumerate(self._body)]):
                    if k not in chosen and needed & set(_stored(statement)):
                        chosen.add(k)
                        needed |= self._with_called(names_in(statement))
                if len(chosen) == before:
                    break
            unknown = any(name not in vars(self._module) for name in asked)  # by another name
            body = [x for k, x in enumerate(self._switchable) if unknown or k in chosen]
            self._slices[asked] = compile(ast.Module(body, []), self._path, "exec")
        return self._slices[asked]

    def _with_called(self, names: Iterable[str]) -> set[str]:
        """Return names with those that the module's functions among them look up."""
        found, todo = set[str](), [*names]
        while todo:
            name = todo.pop()
            if name not in found:
                found.add(name)
                function = _plain(self._calls.get(name)) or _plain(vars(self._module).get(name))
                todo += names_of(function.__code__) if function is not None else ()
        return found

    def _place_terms(self, label: str, row: int) -> None:
        """Give the missing terms their values at one state."""
        for (number, site), pick in self._terms.items():
            block = self.blocks[number]
            if block.rebuilds and not self.is_constant(block, site):
                block.terms[site].value = float(pick.term(label)[row])
            elif not block.rebuilds:
                block.terms[site] = pick.term(label)[row]

    def is_right(self, site: Site) -> bool:
        """Tell whether a number with a name is one that the robot has too: hardly the wrong one."""
        if not (site.literal and isinstance(site.node, ast.Constant)):
            return False
        value = abs(float(ast.literal_eval(site.node)))
        return bool((np.abs(self._known - value) <= 1e-7 * value).any())

    def is_constant(self, block: Block, site: int) -> bool:
        """Tell whether a term is the same number at all states."""
        one = block.sites[site]
        entry = (
            isinstance(one.parent, ast.List) and isinstance(one.node, ast.Constant) and one.node.value != 0
        )
        return block.rebuilds and (not self.drawn or bool(one.literal) or entry)

    def matrix(self) -> Array | None:
        """Return the Coriolis matrix at the first state, None when it raises."""
        name = "coriolis_matrix"
        self._state.restore()
        try:
            with self._functions_now(frozenset([name])) as calls:
                self._place_terms(ALL, 0)
                return np.asarray(calls[name](*self.goal.arguments(name, ALL, 0)), dtype=np.float64)
        except Exception:
            return None

    def outputs_with(self, names: Iterable[str], rows: int, *picks: Pick) -> dict[str, Array] | None:
        """Return what some functions give at the first rows with changes, None as :meth:`outputs`."""
        with self.making(*picks):
            return self.outputs(names, rows)

    @contextmanager
    def making(self, *picks: Pick) -> Iterator[None]:
        """Make changes meanwhile."""
        for pick in picks:
            block = pick.block
            block.switch[pick.site] = pick.choice + 1
            if pick.values is not None:
                self._terms[self.blocks.index(block), pick.site] = pick
            if pick.call is not None:
                block.terms[pick.site] = pick.call
        try:
            yield
        finally:
            for pick in picks:
                pick.block.switch[pick.site] = 0
                self._terms.pop((self.blocks.index(pick.block), pick.site), None)

    def _as_written(self, node: ast.expr) -> str:
        """Return an expression as text, with the spaces of the source where it stands there."""
        text = ast.unparse(node)
        if getattr(node, "end_lineno", None) is None:
            return text
        there = ast.get_source_segment(self.source, node)
        if there is None or "\n" in there:
            return text
        try:
            same = ast.unparse(ast.parse(there, mode="eval")) == text
        except SyntaxError:
            return text
        return there if same else text

    @contextmanager
    def looking(self, block: Block, site: int, look: Callable[[dict[str, Any]], Any]) -> Iterator[None]:
        """Have an expression be what a function makes of the local variables meanwhile."""
        block.switch[site], block.terms[site] = -1, look
        try:
            yield
        finally:
            block.switch[site], block.terms[site] = 0, 0.0

    def change(self, pick: Pick) -> Change:
        """Return a change as text."""
        site = pick.block.sites[pick.site]
        node = site.node
        kind, new = site.choices[pick.choice]
        span = site_span(node)
        where = (pick.block.name, site.literal, float(pick.bits), frozenset(pick.block.reaches))
        if site.statement:
            line = self.source.splitlines()[site.parent.lineno - 1]
            added = f"\n{line[: len(line) - len(line.lstrip())]}{site.statement}{pick.new}"
            return Change("term", span, "", added, *where)
        if site.span is not None:
            line = self.source.splitlines()[site.span[0] - 1].encode()
            old = line[site.span[1] : site.span[3]].decode()
            return Change(kind, site.span, old, f" {ast.unparse(new)} ", *where)
        old = ast.get_source_segment(self.source, node) or ast.unparse(node)
        text = pick.new or self._as_written(new)
        if self.source.count('"') > self.source.count("'") and '"' not in text:
            text = text.replace("'", '"')  # as the file writes its keys
        if isinstance(node, ast.Constant) and isinstance(new, ast.Constant):
            span, old, text = _inside_of_text(node, old, new.value) or (span, old, text)
        change = Change(pick.kind, span, old, text, *where)
        if kind == "sign" and (turned := _with_operator(self.source, site)) is not None:
            return change._replace(**turned)
        if change.span != site_span(node):
            return change
        return _hold_together(self.source, change)


def site_span(node: ast.expr) -> tuple[int, int, int, int]:
    """Return where an expression stands: first line, first column, last line, last column."""
    return node.lineno, node.col_offset, node.end_lineno or 0, node.end_col_offset or 0


def _inside_of_text(
    node: ast.Constant, old: str, new: object
) -> tuple[tuple[int, int, int, int], str, str] | None:
    """Return the part of a formula that is a text in which another one differs: its span, and both parts.

    None where neither is a formula, or the text is not written in one line as it is.
    """
    text = node.value
    if not (isinstance(text, str) and isinstance(new, str) and old[1:-1] == text and old.isascii()):
        return None
    one, other = formula_of(text), formula_of(new)
    if one is None or other is None or node.lineno != node.end_lineno or text != text.strip():
        return None
    a, b = _differing_parts(one, other)
    begin, end, part = a.col_offset, a.end_col_offset or 0, ast.unparse(b)
    for inner in (part, f"({part})"):
        whole = formula_of(text[:begin] + inner + text[end:])
        if whole is not None and ast.dump(whole) == ast.dump(other):
            first = node.col_offset + 1
            return (node.lineno, first + begin, node.lineno, first + end), text[begin:end], inner
    return None


def _differing_parts(one: ast.expr, other: ast.expr) -> tuple[ast.expr, ast.expr]:
    """Return the smallest parts, of two expressions, outside of which they are the same."""
    if type(one) is not type(other):
        return one, other
    pairs = list(zip(ast.iter_child_nodes(one), ast.iter_child_nodes(other), strict=False))
    apart = [(a, b) for a, b in pairs if ast.dump(a) != ast.dump(b)]
    counts = {len([*ast.iter_child_nodes(x)]) for x in (one, other)}
    if len(apart) == len(counts) == 1:
        a, b = apart[0]
        if isinstance(a, ast.expr) and isinstance(b, ast.expr):
            return _differing_parts(a, b)
    return one, other


def _hold_together(source: str, change: Change) -> Change:
    """Return a change, in brackets where the new expression would not hold together without."""
    safe = change._replace(new=f"({change.new})")
    plain, bracketed = (apply_changes(source, (one,)) for one in (change, safe))
    try:
        same = ast.dump(ast.parse(plain)) == ast.dump(ast.parse(bracketed))
    except SyntaxError:
        same = False
    return change if same else safe


def _with_operator(source: str, site: Site) -> dict[str, Any] | None:
    """Return where the other sign of a sum's last term stands, and both texts: + b for - b, not a - -b."""
    node, parent = site.node, site.parent
    if not (
        isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Add | ast.Sub) and parent.right is node
    ):
        return None
    left, line = parent.left, source.splitlines()[node.lineno - 1].encode()
    if not left.end_lineno == node.lineno == node.end_lineno:
        return None
    begin, end = left.end_col_offset or 0, node.end_col_offset or 0
    between = line[begin : node.col_offset].decode()
    if between.strip() not in ("+", "-"):  # brackets
        return None
    start = begin + between.index(between.strip())
    old = line[start:end].decode()
    new = ("-" if old[0] == "+" else "+") + old[1:]
    return {"span": (node.lineno, start, node.lineno, end), "old": old, "new": new}


def _assignments(tree: ast.Module) -> list[ast.stmt]:
    """Return what a module computes: what it assigns, and calls such as ``numbers.update(...)``."""
    return [s for s in tree.body if isinstance(s, ast.Assign | ast.AugAssign | ast.For) or _owner(s)]


def _owner(statement: ast.AST) -> ast.expr | None:
    """Return whose method is called where that is all that a statement is."""
    call = statement.value if isinstance(statement, ast.Expr) else None
    return call.func.value if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) else None


def _plain(function: Any) -> FunctionType | None:
    """Return the function of Python that is called, None when there is none."""
    function = inspect.unwrap(function)  # by a form or a convention
    function = getattr(function, "__func__", function)
    return function if isinstance(function, FunctionType) else None


def apart(forward_dynamics: Callable[..., Any], q: Array, v: Array, _: Array) -> Array:
    """Return D and C v + G of a forward dynamics, flat: two mistakes in it add up in these."""
    still = np.asarray(forward_dynamics(q.copy(), v.copy(), 0.0 * q), dtype=np.float64).ravel()
    moved = [forward_dynamics(q.copy(), v.copy(), e) for e in np.eye(len(q))]
    D = np.linalg.inv(np.stack([np.asarray(a, dtype=np.float64).ravel() - still for a in moved], axis=-1))
    return np.concatenate([D.ravel(), -D @ still])


def stack_values(target: Target, given: Callable[[str, str, int], Array], rows: int) -> Array:
    """Return what a function gives at the first states as an array, (rows, m).

    Args:
        target: the function and the part of it.
        given: what a function gives at the row of some states, flat.
        rows: how many.

    Raises:
        ValueError: when it has another shape than the target.
    """
    parts = [
        sign * np.stack([given(target.function, label, k) for k in range(rows)])
        for sign, label in target.states
    ]
    array = np.asarray(np.sum(parts, axis=0))
    if array.shape[1] != target.values.shape[1]:
        raise ValueError
    return array - array[0] if target.function == "potential_energy" else array
