"""Single changes of a model's source, tried until the model agrees: a repair, and with it the mistake's name.

Where the source of a model can be read, every expression in it gets its alternatives: the other sign, a
factor 2 more or less, the other of sine and cosine, another name or index, a term or a factor more or less,
a rotation transposed. All of them are compiled at once, each behind a switch, so that trying one costs no
more than calling the model. What a term that is missing has to be is solved for, and looked up among the
products of the model's own names: a fit with a dictionary. Two changes are found one after the other where
the first one brings entries into agreement, else as the two whose effects add up to what differs.

This runs in the worker (:mod:`armgpi.validation.worker`), beside the model.
"""

from __future__ import annotations

import ast
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.validation.alternatives import Scope, alternatives, insertion, scope_of, vector_terms
from armgpi.validation.dictionary import Dictionary
from armgpi.validation.models import ARGUMENTS, Functions, joint_of
from armgpi.validation.numbers import Number, namespace

#: Time of the processor that all the trying may take [s], and one changed call of the model: a change may
#: make it endless.
BUDGET, PATIENCE = 16.0, 0.5
#: Changes that are made at most: nobody believes a report of three.
MOST = 2
#: Configurations at which changes are tried first, and at all.
_FEW, ROWS = 2, 8
#: Kinds of changes: to say which one it is costs their logarithm.
_KINDS = 14
#: Kinds of changes of which there are few at a place.
_USUAL = frozenset(
    [
        "sign",
        "factor",
        "square",
        "trig",
        "angle",
        "degrees",
        "extra",
        "transposed",
        "cross",
        "swapped",
        "unit",
        "name",
        "index",
    ]
)
#: Modules that a source may import when changes of it are tried, and names that it must not have: a change
#: may make it do anything with a file.
_HARMLESS = frozenset(
    [
        "math",
        "cmath",
        "numpy",
        "scipy",
        "sympy",
        "casadi",
        "dataclasses",
        "typing",
        "functools",
        "itertools",
        "operator",
        "collections",
        "abc",
        "enum",
        "fractions",
        "warnings",
        "__future__",
        "matplotlib",
        "armgpi",
    ]
)
_HARMFUL = frozenset(
    [
        "open",
        "exec",
        "eval",
        "compile",
        "input",
        "__import__",
        "save",
        "savez",
        "savetxt",
        "tofile",
        "dump",
        "system",
    ]
)
#: Names under which switches and values of missing terms are known to the compiled code.
_SWITCH, _TERM = "_armgpi_switch", "_armgpi_term"
#: Change of a term that shows what it moves: large enough for the digits, small enough for what is curved.
_NUDGE = 1e-4
#: Steps by which a value is found: a length that is a thousand times too large takes ten to come near.
_STEPS = 24
#: Steps after which a root is as good as the digits of the model allow, once it is near.
_REFINED = 3
#: A root of a square is neared to a quarter of the way at each step; what is left of more has no root.
_SLOW = 0.7
#: What no model gives [N m].
_HUGE = 1e12
#: Factors between units: of masses and lengths, and of angles.
#: What gravity is usually taken for [m/s²].
_GRAVITY = (9.81, 9.8, 9.80665, 9.806, 10.0)
_UNITS = (1000.0, 0.001, 100.0, 0.01, 1e6, 1e-6, np.pi / 180.0, 180.0 / np.pi)
#: A digit of a number costs so many bits.
_DIGIT_BITS = 3.32
#: Fields whose expressions stay as they are.
_KEPT = {
    "func",
    "targets",
    "target",
    "slice",
    "decorator_list",
    "annotation",
    "returns",
    "generators",
}


class Target(NamedTuple):
    """What a function of the model should give; a forward dynamics as :func:`apart` has it.

    Attributes:
        states: arguments, arrays (rows, n).
        values: the reference's values, (rows, m).
        tolerance: how far each of the m may be off, (m,).
        best: values, (rows, k), that are preferred where several fit: the matrix of the Christoffel symbols.
    """

    states: tuple[Array, ...]
    values: Array
    tolerance: Array
    best: Array | None = None


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
    """

    kind: str
    span: tuple[int, int, int, int]
    old: str
    new: str
    where: str
    name: str
    bits: float


def patched(source: str, changes: tuple[Change, ...]) -> str:
    """Return a source with some changes made."""
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    for change in sorted(changes, key=lambda c: c.span, reverse=True):
        first, start, last, end = change.span
        tail = lines[last - 1][end:]
        head = lines[first - 1][:start]
        lines[first - 1 : last] = [head + change.new.encode() + tail]
    return b"".join(lines).decode()


class _Site(NamedTuple):
    """An expression with its alternatives; the last one is the sum with a term that is solved for."""

    node: ast.expr
    choices: list[tuple[str, ast.expr]]
    fitted: bool
    literal: str  # name of a number that has one
    whole: bool  # a sum, or all that is assigned


class _Pick(NamedTuple):
    """One alternative of one site, with the values of its missing term at the rows and its text."""

    block: _Block
    site: int
    choice: int
    bits: float
    values: Array | None = None
    kind: str = ""
    new: str = ""
    sure: bool = False  # its effect is known to be what lacks


class _Block:
    """A function of the model, or the assignments of its module, with switches compiled in."""

    def __init__(
        self, k: int, name: str, body: list[ast.stmt], namespace: dict[str, Any], everywhere: ast.AST
    ) -> None:
        """Take statements, the globals that they see, and the whole file."""
        self.everywhere, self.literals = everywhere, _literals(everywhere)
        self.name, self.body, self.namespace = name, body, namespace
        self.names = (f"{_SWITCH}{k}", f"{_TERM}{k}")
        self.calls: list[dict[str, Any]] = []  # the local variables, at every row
        self.once = True
        self.rebuilds = False  # whether the functions have to be read again after a change
        self.sites: list[_Site] = []
        self.switch: list[int] = []
        self.terms: list[Any] = []
        self.reaches: set[str] = set()
        self.scope = Scope({})

    def compiled(self, path: str, arguments: tuple[str, ...]) -> CodeType:
        """Compile every alternative of every expression behind its switch."""
        values = {**_numbers(self.namespace), **(self.calls[0] if self.calls else {})}
        self.scope = scope_of(ast.Module(self.body, []), values, arguments, self.everywhere)
        module = ast.Module([self._rebuilt(statement) for statement in self.body], [])
        self.switch, self.terms = [0] * len(self.sites), list[Any]([0.0]) * len(self.sites)
        self.namespace[self.names[0]], self.namespace[self.names[1]] = self.switch, self.terms
        return compile(ast.fix_missing_locations(module), path, "exec")

    def _rebuilt(self, node: Any, parent: Any = None, field: str = "") -> Any:
        """Return a copy in which every expression can be switched to its alternatives."""
        if isinstance(node, list):
            return [self._rebuilt(x, parent, field) for x in node]
        if not isinstance(node, ast.AST) or isinstance(node, ast.arguments | ast.JoinedStr):
            return node
        children = {
            name: value if name in _KEPT else self._rebuilt(value, node, name)
            for name, value in ast.iter_fields(node)
        }
        new: Any = ast.copy_location(type(node)(**children), node)
        if isinstance(new, ast.FunctionDef):
            new.decorator_list = []
        if not isinstance(node, ast.expr) or isinstance(node, ast.Starred | ast.Lambda):
            return new
        if isinstance(getattr(node, "ctx", None), ast.Store | ast.Del):
            return new
        choices = list(alternatives(node, parent, self.scope))
        literal = self.literals.get(node, "")
        if literal and isinstance(node, ast.Constant) and isinstance(node.value, float):
            choices += [("unit", ast.Constant(float(f"{node.value * unit:.12g}"))) for unit in _UNITS]
        fitted = insertion(node, parent) and not _is_text(node)
        number = len(self.sites)
        if fitted:
            at = ast.Subscript(ast.Name(self.names[1], ast.Load()), ast.Constant(number), ast.Load())
            choices.append(("term", ast.BinOp(node, ast.Add(), at)))
        if not choices:
            return new
        whole = isinstance(parent, ast.Assign) or (
            isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add)
        )
        self.sites.append(_Site(node, choices, fitted, literal, fitted and whole))
        return self._switched(number, [choice for _, choice in choices], new)

    def _switched(self, number: int, choices: list[ast.expr], new: ast.expr) -> ast.expr:
        """Return an expression that gives one of the choices when its switch says so."""
        at = ast.Subscript(ast.Name(self.names[0], ast.Load()), ast.Constant(number), ast.Load())

        def among(low: int, high: int) -> ast.expr:
            if high - low == 1:
                return choices[low]
            middle = (low + high) // 2
            # Halving: some sites have thousands.
            first = ast.Compare(at, [ast.LtE()], [ast.Constant(middle)])
            return ast.IfExp(first, among(low, middle), among(middle, high))

        return ast.IfExp(at, among(0, len(choices)), new)

    @cached_property
    def dictionary(self) -> Dictionary:
        """The products of names that can be written in this block."""
        texts = [name for name, kind in self.scope.kinds.items() if kind == "float"]
        constants, states = {}, {}
        for text in dict.fromkeys([*texts, *map(ast.unparse, self.scope.scalars)]):
            values = self.values(text)
            if values is None or values.ndim > 1:
                continue
            if np.ptp(values) == 0.0:
                constants[text] = float(values[0])
            else:
                states[text] = values
        return Dictionary(constants, states)

    def values(self, text: str) -> Array | None:
        """Return what an expression is at the rows; None where it has no value there."""
        code = compile(text, "<term>", "eval")
        try:
            found = [eval(code, self.namespace, names) for names in self.calls]
            return np.array([x if isinstance(x, np.ndarray) else float(x) for x in found], dtype=np.float64)
        except Exception:  # a name that is not there yet, an index out of range, a variable of a loop
            return None

    def vectors(self) -> dict[str, Array]:
        """Return terms of a vector's equation that may be missing, with their values at the rows."""
        if not self.once or self.scope.loops:
            return {}
        found = {}
        for term in vector_terms(self.scope):
            text = ast.unparse(term)
            values = self.values(text)
            if values is not None and values.ndim == 2 and np.abs(values).max() > 0.0:
                found[text] = values
        return found


def _literals(tree: ast.AST) -> dict[ast.AST, str]:
    """Return the numbers that are given a name, by an assignment or as an item of a dictionary."""
    found: list[tuple[str, ast.AST]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target, value = node.targets[0], node.value
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                found += [(ast.unparse(t), v) for t, v in zip(target.elts, value.elts, strict=False)]
            elif isinstance(target, ast.Name | ast.Attribute):
                found.append((ast.unparse(target), value))
        elif isinstance(node, ast.Dict):
            keys = zip(node.keys, node.values, strict=True)
            found += [(str(k.value), v) for k, v in keys if isinstance(k, ast.Constant)]
    inner = [(name, v.operand if isinstance(v, ast.UnaryOp) else v) for name, v in found]
    return {v: name for name, v in inner if isinstance(v, ast.Constant) and not _is_text(v)}


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and not isinstance(node.value, int | float)


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
def _impatient() -> Iterator[None]:
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
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            modules = [node.module or "."]
        else:
            modules = []
        if any(name.split(".")[0] not in _HARMLESS for name in modules):
            return False
        if isinstance(node, ast.Name | ast.Attribute):
            name = node.id if isinstance(node, ast.Name) else node.attr
            if name in _HARMFUL:
                return False
    return True


def cross(a: Any, b: Any, *rest: Any, _general: Any = np.cross, **options: Any) -> Any:
    """Return a cross product: that of two vectors of three in a tenth of NumPy's time."""
    if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.shape == b.shape == (3,)):
        return _general(a, b, *rest, **options)
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


class Editor:
    """A model's source with its switches."""

    def __init__(
        self,
        path: str,
        source: str,
        resolve: Callable[[], Functions],
        module: ModuleType,
        targets: Mapping[str, Target],
        known: tuple[float, ...] = (),
    ) -> None:
        """Compile the switches into the model's functions.

        Args:
            path: name of its file.
            source: the text of that file.
            resolve: reads the functions out of the module again.
            module: the module that it became.
            targets: what its functions should give.
            known: numbers that the robot has too, without signs: those are hardly the wrong ones.
        """
        self._known = np.array(known)
        self._path, self._resolve, self._module, self._targets = path, resolve, module, targets
        self._tree, self._source = ast.parse(source), source
        self._until = time.process_time() + BUDGET
        self._makers: set[FunctionType] = set()
        self._spaces: dict[int, dict[str, Any]] = {}
        self._terms: dict[tuple[int, int], Array] = {}  # block and site -> values of its term at the rows
        self._calls = resolve().calls
        self._symbolic = not any(
            (function := _plain(f)) and function.__code__.co_filename == path for f in self._calls.values()
        )
        if self._symbolic and "forward_dynamics" in targets:
            raise ValueError  # a forward dynamics of SymPy is not taken apart
        found = {} if self._symbolic else self._reached()
        self._trace(found)
        self._blocks = [self._installed(function, block) for function, block in found.items()]
        self._assigned: set[str] = set()
        self._code: CodeType | None = None
        self._assignments()

    # What the model is made of.

    def _reached(self) -> dict[FunctionType, _Block]:
        """Return the functions in the file that the model's functions call, themselves included."""
        nodes = {(n.name, _first_line(n)): n for n in ast.walk(self._tree) if isinstance(n, ast.FunctionDef)}
        found: dict[FunctionType, _Block] = {}
        for name in self._targets:
            todo, seen = [self._calls[name]], set()
            while todo:
                thing = todo.pop()
                function = _plain(thing)
                if function is None or function in seen:
                    continue
                seen.add(function)
                code = function.__code__
                node = nodes.get((code.co_name, code.co_firstlineno))
                if code.co_filename != self._path or node is None or code.co_freevars:
                    continue
                block = found.setdefault(
                    function, _Block(len(found), node.name, [node], function.__globals__, self._tree)
                )
                block.reaches.add(name)
                owner = getattr(getattr(thing, "__wrapped__", thing), "__self__", None)
                maker = _plain(getattr(type(owner), "__init__", None))
                if maker is not None and maker.__code__.co_filename == self._path:
                    self._makers.add(maker)
                    todo.append(maker)
                for other in _names_of(code):
                    todo += [
                        x
                        for x in (function.__globals__.get(other), getattr(owner, other, None))
                        if callable(x)
                    ]
        return found

    def _trace(self, functions: Mapping[FunctionType, _Block]) -> None:
        """Keep the local variables of every function at every row."""
        blocks = {function.__code__: block for function, block in functions.items()}
        now: dict[_Block, list[dict[str, Any]]] = {}

        def watch(frame: FrameType, event: str, _: object) -> None:
            block = blocks.get(frame.f_code) if event == "return" else None
            if block is not None:
                now.setdefault(block, []).append(dict(frame.f_locals))

        for name, target in self._targets.items() if blocks else ():
            for row in zip(*target.states, strict=True):
                now.clear()
                sys.setprofile(watch)
                try:
                    self._calls[name](*(x.copy() for x in row))
                finally:
                    sys.setprofile(None)
                for block, frames in now.items():
                    block.once = block.once and len(frames) == 1
                    if len(block.calls) < len(target.values):
                        block.calls.append(frames[0])

    def _installed(self, function: FunctionType, block: _Block) -> _Block:
        """Put the switches into a function."""
        code, space = function.__code__, dict[str, Any]()
        if function in self._makers:
            block.rebuilds, block.once, block.calls = True, True, [{}] * ROWS
            block.reaches = set(self._targets)
        exec(block.compiled(self._path, code.co_varnames[: code.co_argcount]), space)
        function.__code__ = space[block.name].__code__
        return block

    def _assignments(self) -> None:
        """Put switches into what the module assigns: constants that are computed, expressions of SymPy."""
        body: list[ast.stmt] = [s for s in self._tree.body if isinstance(s, ast.Assign | ast.AugAssign)]
        if not body:
            return
        block = _Block(len(self._blocks), "", body, vars(self._module), self._tree)
        block.reaches, block.calls, block.rebuilds = set(self._targets), [{}] * ROWS, True
        self._assigned = {n.id for s in body for n in ast.walk(s) if isinstance(n, ast.Name)}
        if self._symbolic:
            self._code = compile(ast.Module(body, []), self._path, "exec")
            block.calls = [self._at(k) for k in range(ROWS)]
        self._code = block.compiled(self._path, ())
        self._blocks.append(block)
        self._spaces.clear()
        for space in block.calls:  # the switches of what is evaluated there
            space.update({name: vars(self._module)[name] for name in block.names})

    def _arguments(self, row: int) -> dict[str, float]:
        """Return the values of the symbols that a module of SymPy has for the joints, at one state."""
        found: dict[str, float] = {}
        arrays = {
            letter: states[row]
            for name, target in self._targets.items()
            for letter, states in zip(ARGUMENTS[name], target.states, strict=True)
        }
        names = {str(x) for x in vars(self._module).values() if getattr(x, "is_Symbol", False)}
        parameters = vars(self._module).get("parameters", {})
        for symbol in names - parameters.keys():
            joint = joint_of(symbol)
            if joint is not None:
                # What no function that is asked for depends on may have any value.
                array = arrays.get(joint[0], np.zeros(9))
                found[symbol] = float(array[joint[1] - 1])
        return found

    # Trying.

    def outputs(self, names: set[str], rows: int) -> dict[str, Array] | None:
        """Return what some functions give at the first rows, None when they raise or are not finite."""
        space = vars(self._module)
        again = any(any(block.switch) for block in self._blocks if block.rebuilds)
        saved = {name: space[name] for name in self._assigned if name in space} if again else {}
        try:
            with _impatient(), np.errstate(all="ignore"):
                for (number, site), term in self._terms.items():
                    if self._is_constant(number, site):
                        self._blocks[number].terms[site] = float(term[0])
                if self._symbolic:
                    spaces = [self._at(k) for k in range(rows)]
                    found = {name: self._stacked(name, [x[name] for x in spaces]) for name in names}
                else:
                    calls = self._again(space) if again else self._calls
                    found = {name: self._rows(calls, name, rows) for name in names}
        except (Exception, _Slow):
            return None
        finally:
            space.update(saved)
        return found if all(np.isfinite(x).all() for x in found.values()) else None

    def _at(self, row: int) -> dict[str, Any]:
        """Return the names of a module of SymPy with their values at one state."""
        assert self._code is not None
        for (number, site), term in self._terms.items():
            if not self._is_constant(number, site):
                self._blocks[number].terms[site] = term[row]
        return self._filled(row)

    def _filled(self, row: int) -> dict[str, Any]:
        """Return the names of a module of SymPy with their values at one state, its parameters' included."""
        if row not in self._spaces:
            space = vars(self._module)
            values = {**space.get("parameters", {}), **self._arguments(row)}
            self._spaces[row] = namespace(space, {str(name): Number(x) for name, x in values.items()})
        found = dict(self._spaces[row])
        exec(self._code or "", found)
        parameters = found.get("parameters", {})
        if parameters != vars(self._module).get("parameters", {}):  # a change is in there
            values = {**parameters, **self._arguments(row)}
            found = namespace(vars(self._module), {str(name): Number(x) for name, x in values.items()})
            exec(self._code or "", found)
        return found

    def _is_constant(self, number: int, site: int) -> bool:
        """Tell whether a term is the same number at all states."""
        block = self._blocks[number]
        return block.rebuilds and (not self._symbolic or bool(block.sites[site].literal))

    def _again(self, space: dict[str, Any]) -> Mapping[str, Callable[..., Any]]:
        """Return the functions after the module's assignments have been made again."""
        if self._code is not None and any(self._blocks[-1].switch):
            exec(self._code, space)
        return self._resolve().calls

    def _rows(self, calls: Mapping[str, Callable[..., Any]], name: str, rows: int) -> Array:
        """Return what one function gives at the first rows."""
        values = []
        for k in range(rows):
            for (number, site), term in self._terms.items():
                if not self._is_constant(number, site):
                    self._blocks[number].terms[site] = term[k]
            state = [x[k].copy() for x in self._targets[name].states]
            values.append(apart(calls[name], *state) if name == "forward_dynamics" else calls[name](*state))
        return self._stacked(name, values)

    def _stacked(self, name: str, values: list[Any]) -> Array:
        """Return values at the first rows as an array."""
        target = self._targets[name]
        array = np.stack([flat(name, x, target, k) for k, x in enumerate(values)])
        if array.shape[1] != target.values.shape[1]:
            raise ValueError  # a change of the shape
        return array - array[0] if name == "potential_energy" else array

    @contextmanager
    def _with(self, *picks: _Pick) -> Iterator[None]:
        """Make changes meanwhile."""
        for pick in picks:
            block = pick.block
            block.switch[pick.site] = pick.choice + 1
            if pick.values is not None:
                self._terms[self._blocks.index(block), pick.site] = pick.values
        try:
            yield
        finally:
            for pick in picks:
                pick.block.switch[pick.site] = 0
                self._terms.pop((self._blocks.index(pick.block), pick.site), None)

    def search(self) -> tuple[Change, ...]:
        """Return the changes that make the model agree, none when there are none."""
        made: list[_Pick] = []
        tried: list[_Tried] = []
        while len(made) < MOST and time.process_time() < self._until:
            with self._with(*made):
                found, more = self._next()
            tried = tried or more
            if found is None:
                break
            made.append(found)
            with self._with(*made):
                if not self._differing(ROWS):
                    return tuple(self._change(pick) for pick in made)
        both = self._pair(tried)
        return tuple(self._change(pick) for pick in both)

    def _differing(self, rows: int) -> dict[str, Any]:
        """Return for every function that differs which of its values do, at any of the first rows."""
        outputs = self.outputs(set(self._targets), rows)
        if outputs is None:
            return dict.fromkeys(self._targets)
        away = {name: self._away(name, outputs[name]) for name in outputs}
        return {name: x.any(axis=0) for name, x in away.items() if x.any()}

    def _away(self, name: str, values: Array) -> Any:
        """Return which values differ from the reference's, (rows, m)."""
        target = self._targets[name]
        return ~(np.abs(values - target.values[: len(values)]) <= target.tolerance)

    def _next(self) -> tuple[_Pick | None, list[_Tried]]:
        """Return the change that makes all agree, else the one that makes the most agree; and all tried."""
        start = self.outputs(set(self._targets), ROWS)
        if start is None:
            return None, []
        wrong = {name: self._away(name, x).any(axis=0) for name, x in start.items()}
        picks = self._picks({name for name, w in wrong.items() if w.any()})
        usual = [pick for pick in picks if pick.kind in _USUAL or pick.sure]
        others = [pick for pick in picks if pick.kind not in _USUAL and not pick.sure]
        tried: list[_Tried] = []
        good: list[_Pick] = []
        found: tuple[_Pick, bool] | None = None
        # From what is tried fast to what takes long.
        for more in (
            self._helpful(usual, start, wrong, tried, first=True),
            self._fits(wrong),
            self._helpful(others, start, wrong, tried, first=True),
            self._helpful(picks, start, wrong, tried, first=False),
        ):
            good += more
            found = self._best(good, wrong) or found
            if found is not None and found[1]:
                break
        return (None if found is None else found[0]), tried

    def _helpful(
        self,
        picks: list[_Pick],
        start: Mapping[str, Array],
        wrong: Mapping[str, Any],
        tried: list[_Tried],
        first: bool,
    ) -> Iterator[_Pick]:
        """Yield the changes that make values agree and spoil none, at the first state.

        Args:
            picks: all changes.
            start: what the functions give without any.
            wrong: which of that differs.
            tried: takes what each of the changes does.
            first: look at the first function that differs; else at the others.
        """
        for pick in picks:
            if time.process_time() > self._until:
                return
            differing = [name for name in start if wrong[name].any() and name in pick.block.reaches]
            names = set(differing[:1] if first else differing[1:])
            if not names:
                continue
            with self._with(pick):
                outputs = self.outputs(names, _FEW if "potential_energy" in names else 1)
            if outputs is None:
                continue
            off = {name: self._away(name, values).any(axis=0) for name, values in outputs.items()}
            if first:
                tried.append(_Tried(pick, {n: x[-1] - start[n][len(x) - 1] for n, x in outputs.items()}))
            spoiled = any((off[name] & ~wrong[name]).any() for name in off)
            if not spoiled and any((wrong[name] & ~off[name]).any() for name in off):
                yield pick
                # The others have longer descriptions.
                if first and not self._ugly(pick) and (self._best([pick], wrong) or (pick, False))[1]:
                    return

    def _best(self, good: list[_Pick], wrong: Mapping[str, Any]) -> tuple[_Pick, bool] | None:
        """Return the change that makes the most agree at all states, and whether that is all.

        Of several the one of the shortest description.
        """
        found = []
        count = sum(int(w.sum()) for w in wrong.values())
        for k, pick in enumerate(good):
            with self._with(pick):
                outputs = self.outputs(pick.block.reaches, ROWS)
            if outputs is None:
                continue
            off = {name: self._away(name, values).any(axis=0) for name, values in outputs.items()}
            right = sum(int((wrong[name] & ~off[name]).sum()) for name in off)
            if right and not any((off[name] & ~wrong[name]).any() for name in off):
                found.append((-right, self._ugly(pick), pick.bits, k))
        if not found:
            return None
        right, _, _, k = min(found)
        return good[k], -right == count

    def _ugly(self, pick: _Pick) -> bool:
        """Tell whether a change leaves a matrix that is right in its product with v alone."""
        target = self._targets.get("coriolis_matrix")
        if target is None or target.best is None:
            return False
        with self._with(pick):
            calls = self._calls
            try:
                matrix = np.asarray(
                    calls["coriolis_matrix"](*(x[0].copy() for x in target.states)), dtype=float
                )
            except Exception:
                return True
        return bool(
            np.abs(matrix.ravel() - target.best[0]).max() > 1e-6 * max(np.abs(target.best[0]).max(), 1e-3)
        )

    def _picks(self, differing: set[str]) -> list[_Pick]:
        """Return every change in what the functions that differ are made of, the usual kinds first."""
        all_sites = sum(len(block.sites) for block in self._blocks)
        found = []
        for block in self._blocks:
            if not block.reaches & differing:
                continue
            terms = block.vectors()
            for k, site in enumerate(block.sites):
                if block.switch[k] or self._is_right(site):
                    continue
                kinds = [kind for kind, _ in site.choices]
                for c, kind in enumerate(kinds[: len(kinds) - site.fitted]):
                    # Terms come in the order of their length.
                    rank = c + 1 - kinds.index(kind) if kind == "term" else kinds.count(kind)
                    bits = np.log2(all_sites * _KINDS * rank)
                    found.append(_Pick(block, k, c, float(bits), None, kind))
                if terms and site.whole:
                    found += self._vector_picks(block, k, terms, differing)
        return sorted(found, key=lambda pick: pick.bits)

    def _is_right(self, site: _Site) -> bool:
        """Tell whether a number with a name is one that the robot has too: hardly the wrong one."""
        if not (site.literal and isinstance(site.node, ast.Constant)):
            return False
        value = abs(float(site.node.value))  # type: ignore[arg-type]
        return bool((np.abs(self._known - value) <= 1e-7 * value).any())

    def _vector_picks(
        self, block: _Block, k: int, terms: Mapping[str, Array], differing: set[str]
    ) -> Iterator[_Pick]:
        """Yield vectors that may be missing in a sum: where it is linear, those with the right effect."""
        old = ast.unparse(block.sites[k].node)
        now = block.values(old)
        names = differing & block.reaches
        if now is None or now.shape[1:] not in ((2,), (3,)) or not names:
            return
        size = now.shape[1]
        terms = {text: values for text, values in terms.items() if values.shape == now.shape}
        name = min(names)
        bits = float(np.log2(sum(len(b.sites) for b in self._blocks) * _KINDS * (2 * len(terms) + 1)))
        choice = len(block.sites[k].choices) - 1
        effects = []
        for step in (np.zeros(size), *np.eye(size), np.ones(size)):
            with self._with(_Pick(block, k, choice, 0.0, np.tile(step, (ROWS, 1)))):
                outputs = self.outputs({name}, 1)
            if outputs is None:
                return
            effects.append(outputs[name][0])
        start, *axes, together = effects
        slope = np.stack(axes) - start
        rest = 1e-6 * (1.0 + np.abs(together).max())
        linear = np.abs(together - start - slope.sum(axis=0)).max() <= rest
        lacking = self._targets[name].values[0] - start
        for text, values in terms.items():
            for sign in (1.0, -1.0):
                if not linear or np.abs(sign * values[0] @ slope - lacking).max() <= rest:
                    new = f"{old} {'+' if sign > 0.0 else '-'} {text}"
                    yield _Pick(block, k, choice, bits, sign * values, "term", new, bool(linear))

    def _fits(self, wrong: Mapping[str, Any]) -> Iterator[_Pick]:
        """Yield terms that are missing: what each has to be is solved for, and looked up."""
        for block in sorted(self._blocks, key=lambda b: not b.rebuilds):  # constants are found fast
            if not block.once or len(block.calls) < ROWS:
                continue
            for k, site in enumerate(block.sites):
                done = block.switch[k] or time.process_time() > self._until
                if not site.fitted or done or self._is_right(site):
                    continue
                for values in self._solved(block, k, wrong):
                    for text, bits in _written(block, site, values):
                        bits += np.log2(len(block.sites) * _KINDS)
                        kind = "value" if site.literal else "term"
                        yield _Pick(block, k, len(site.choices) - 1, bits, values, kind, text)

    def _solved(self, block: _Block, k: int, wrong: Mapping[str, Any]) -> Iterator[Array]:
        """Yield terms with which some values agree and none is spoiled, at the rows."""
        pick = _Pick(block, k, len(block.sites[k].choices) - 1, 0.0, np.zeros(ROWS))
        constant = self._is_constant(self._blocks.index(block), k)
        slope, _ = self._slope(pick, _FEW)
        affected = {name: (np.abs(x) > 0.0).any(axis=0) for name, x in slope.items()}
        # All that it moves may be wrong because of it, or what it moves in one function.
        groups = [set(affected), *({name} for name in affected if len(affected) > 1)]
        for group in groups:
            if not any((affected[name] & wrong[name]).any() for name in group & affected.keys()):
                continue
            values = self._root(pick, {n: affected[n] & wrong[n] for n in group}, constant)
            if values is None:
                continue
            with self._with(pick._replace(values=values)):
                outputs = self.outputs(block.reaches, ROWS)
            if outputs is None:
                continue
            off = {name: self._away(name, x).any(axis=0) for name, x in outputs.items()}
            if any((off[name] & ~wrong[name]).any() for name in off):
                continue
            if any((wrong[name] & ~off[name]).any() for name in off):
                yield values
                return

    def _slope(self, pick: _Pick, rows: int) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return how much a term moves what the functions give, and what that lacks; nothing if they fail."""
        assert pick.values is not None
        with self._with(pick):
            here = self.outputs(pick.block.reaches, rows)
        with self._with(pick._replace(values=pick.values + _NUDGE)):
            there = self.outputs(pick.block.reaches, rows)
        if here is None or there is None:
            return {}, {}
        slope = {name: (there[name] - here[name]) / _NUDGE for name in here}
        return slope, {name: self._targets[name].values[:rows] - here[name] for name in here}

    def _root(self, pick: _Pick, used: Mapping[str, Any], constant: bool) -> Array | None:
        """Return the term for which some values agree, by Gauss and Newton; None without one."""
        values, near, before = np.zeros(ROWS), 0, np.inf
        for step in range(_STEPS if constant else _STEPS // 2):
            rows = (
                _FEW if constant or step == 0 else ROWS
            )  # one number shows at two states whether it is right
            slopes, rests = self._slope(pick._replace(values=values), rows)
            if not slopes:
                return None
            slope, rest = (
                np.concatenate([x[n][:, u] / self._targets[n].tolerance[u] for n, u in used.items()], axis=1)
                for x in (slopes, rests)
            )
            near += bool(step) and bool(np.abs(rest).max() <= 1.0)
            if near == _REFINED:
                return values
            left = float(np.linalg.norm(rest))
            if step > 1 and not near and left > _SLOW * before:
                return None
            before = left if step else np.inf
            if constant:
                slope, rest = slope.reshape(1, -1), rest.reshape(1, -1)
            size = np.einsum("ij,ij->i", slope, slope)
            if not (size > 0.0).all():
                return None
            move = np.einsum("ij,ij->i", slope, rest) / size
            if step == 0 and not constant and self._apart(slope, rest, move):
                return None
            values = values.copy()
            values[: None if constant else rows] += move
        return None

    def _apart(self, slope: Array, rest: Array, move: Array) -> bool:
        """Tell whether one number can hardly explain what several values lack."""
        left = np.linalg.norm(rest - move[:, np.newaxis] * slope, axis=1)
        return bool((left > 0.5 * np.linalg.norm(rest, axis=1)).any())

    def _pair(self, tried: list[_Tried]) -> tuple[_Pick, ...]:
        """Return the two changes whose effects add up to what differs, none when there are no such."""
        start = self.outputs(set(self._targets), _FEW)
        if start is None or len(tried) < 2:
            return ()
        (name,) = {n for one in tried for n in one.effects} & set(self._differing(_FEW)) or {""}
        # Beyond these it is a change that divides by next to nothing.
        tried = [
            one for one in tried if name in one.effects and 0.0 < np.abs(one.effects[name]).max() < _HUGE
        ]
        if len(tried) < 2:
            return ()
        tolerance = self._targets[name].tolerance

        def row(effects: Mapping[str, Array]) -> Array:
            return np.asarray(effects[name] / tolerance * 1e-3)

        effects = np.stack([row(one.effects) for one in tried])
        last = _FEW - 1 if name == "potential_energy" else 0
        lacking = row({name: self._targets[name].values[last] - start[name][last]})
        from scipy.spatial import cKDTree  # half of the time of importing this package, and rarely needed

        tree = cKDTree(effects)
        found = []
        for i, near in enumerate(tree.query_ball_point(lacking - effects, 1e-2 * np.sqrt(len(lacking)))):
            found += [(tried[i].pick.bits + tried[j].pick.bits, i, j) for j in near[:20] if i < j]
        for _, i, j in sorted(found)[:50]:
            both = (tried[i].pick, tried[j].pick)
            if both[0].block is both[1].block and both[0].site == both[1].site:
                continue
            with self._with(*both):
                if not self._differing(ROWS):
                    return both
        return ()

    def _change(self, pick: _Pick) -> Change:
        """Return a change as text."""
        site = pick.block.sites[pick.site]
        node = site.node
        kind, new = site.choices[pick.choice]
        span = (node.lineno, node.col_offset, node.end_lineno or 0, node.end_col_offset or 0)
        old = ast.get_source_segment(self._source, node) or ast.unparse(node)
        text = pick.new or ast.unparse(new)
        change = Change(pick.kind or kind, span, old, text, pick.block.name, site.literal, float(pick.bits))
        # Brackets where the new expression would not hold together.
        safe = change._replace(new=f"({text})")
        plain, bracketed = (patched(self._source, (one,)) for one in (change, safe))
        try:
            same = ast.dump(ast.parse(plain)) == ast.dump(ast.parse(bracketed))
        except SyntaxError:
            same = False
        return change if same else safe


class _Tried(NamedTuple):
    """A change and what it changes, at the first rows."""

    pick: _Pick
    effects: dict[str, Array]


def _written(block: _Block, site: _Site, values: Array) -> Iterator[tuple[str, float]]:
    """Yield what an expression has to be where a term of known values is missing in it."""
    if isinstance(site.node, ast.Constant):
        yield from _number(site, float(values[0])) if np.ptp(values) <= 1e-9 * np.abs(values).max() else ()
        if site.literal or site.node.value != 0:
            return
    old = ast.unparse(site.node)
    dictionary = block.dictionary
    if found := dictionary.term(values):
        yield _sum(old, found.text), found.bits
        return
    # A factor that all of it lacks, or one of its parts.
    for part, sign in _parts(site.node):
        now = block.values(ast.unparse(part))
        if now is None or now.shape != values.shape:
            continue
        with np.errstate(all="ignore"):
            factor = 1.0 + sign * values / now
        if np.isfinite(factor).all() and (found := dictionary.term(factor, sums=part is site.node)):
            new = ast.BinOp(ast.parse(f"({found.text})", mode="eval").body, ast.Mult(), part)
            yield ast.unparse(_with_part(site.node, part, new)), found.bits + 1.0
            return
        if part is site.node and (found := dictionary.term(now + values)):
            yield found.text, found.bits + 2.0
            return


def _parts(node: ast.expr, sign: float = 1.0) -> Iterator[tuple[ast.expr, float]]:
    """Yield the terms of a sum with their signs."""
    yield node, sign
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        yield from _parts(node.left, sign)
        yield from _parts(node.right, sign if isinstance(node.op, ast.Add) else -sign)


def _with_part(node: ast.expr, part: ast.expr, new: ast.expr) -> ast.expr:
    """Return a sum with another term in place of one."""
    if node is part:
        return new
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        return ast.BinOp(_with_part(node.left, part, new), node.op, _with_part(node.right, part, new))
    return node


def _sum(old: str, term: str) -> str:
    """Return a sum as text."""
    return f"{old} - {term.removeprefix('-')}" if term.startswith("-") else f"{old} + {term}"


def _number(site: _Site, change: float) -> Iterator[tuple[str, float]]:
    """Yield another number in place of one: one in another unit, one of few digits."""
    assert isinstance(site.node, ast.Constant)
    old = float(site.node.value)  # type: ignore[arg-type]
    new = old + change
    text = next(t for digits in range(1, 18) if abs(float(t := f"{new:.{digits}g}") - new) <= 1e-9 * abs(new))
    if (new * old <= 0.0 and site.literal) or not np.isfinite(new) or old in _GRAVITY:
        return  # nothing has the other sign by chance, and gravity is what it is
    if site.literal or len(text) <= 4:
        yield text, _DIGIT_BITS * len(text.lstrip("-0.").replace(".", ""))


def _plain(function: Any) -> FunctionType | None:
    """Return the function of Python that is called, None when there is none."""
    function = getattr(function, "__wrapped__", function)  # by a convention
    function = getattr(function, "__func__", function)
    return function if isinstance(function, FunctionType) else None


def _names_of(code: CodeType) -> set[str]:
    """Return the names that a function looks up, also in its comprehensions."""
    inner = (part for part in code.co_consts if isinstance(part, CodeType))
    return set(code.co_names).union(*map(_names_of, inner))


def _first_line(node: ast.FunctionDef) -> int:
    return min([node.lineno, *(d.lineno for d in node.decorator_list)])


def apart(forward_dynamics: Callable[..., Any], q: Array, v: Array, _: Array) -> Array:
    """Return D and C v + G of a forward dynamics, flat: two mistakes in it add up in these."""
    still = np.asarray(forward_dynamics(q.copy(), v.copy(), 0.0 * q), dtype=np.float64).ravel()
    moved = [forward_dynamics(q.copy(), v.copy(), e) for e in np.eye(len(q))]
    D = np.linalg.inv(np.stack([np.asarray(a, dtype=np.float64).ravel() - still for a in moved], axis=-1))
    return np.concatenate([D.ravel(), -D @ still])


def flat(name: str, value: Any, target: Target, row: int) -> Array:
    """Return what a function gave as a flat array: C v for C, the position of a pose."""
    if hasattr(value, "tolist") and not isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    array = np.asarray(value, dtype=np.float64)
    if name == "coriolis_matrix":
        array = array @ target.states[1][row]
    elif name == "forward_kinematics" and array.shape == (4, 4):
        array = array[:3, 3]
    return array.ravel()
