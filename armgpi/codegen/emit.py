"""Straight-line C from CasADi's list of instructions, one local variable for each result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from armgpi.codegen.algebra import ca
from armgpi.codegen.symbols import NotElementwise

#: What an instruction is in C. {0} and {1} are its operands.
_NUMBER = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    # Exact, so the same bits as what CasADi made them from: x * x and 2 x.
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_FABS: "v_abs({0})",
    ca.OP_SIN: "v_sin({0})",
    ca.OP_COS: "v_cos({0})",
    ca.OP_SQRT: "v_sqrt({0})",
    ca.OP_EXP: "v_exp({0})",
    ca.OP_LOG: "v_log({0})",
    ca.OP_TAN: "v_tan({0})",
    ca.OP_TANH: "v_tanh({0})",
    ca.OP_ATAN: "v_atan({0})",
    ca.OP_FLOOR: "v_floor({0})",
    ca.OP_SIGN: "v_sign({0})",
    ca.OP_FMOD: "v_fmod({0}, {1})",
    ca.OP_REMAINDER: "{0} - v_rint({0})",  # only ever by one
}
# Comparisons give masks, numbers are made of them only where a law computes with them: a mask costs nothing
# to combine, and vectors have no branches.
_COMPARISON = {
    ca.OP_LT: "v_lt({0}, {1})",
    ca.OP_LE: "v_le({0}, {1})",
    ca.OP_EQ: "v_eq({0}, {1})",
    ca.OP_NE: "v_ne({0}, {1})",
}
#: Of CasADi's numbers of operations, none.
_SELECT = -1
_LOGIC = {ca.OP_AND: "v_and({0}, {1})", ca.OP_OR: "v_or({0}, {1})", ca.OP_NOT: "v_not({0})"}


@dataclass
class Code:
    """Lines of C that work out expressions.

    Attributes:
        lines: the lines.
        operations: how many arithmetic operations there are.
        before: lines that work out what stays the same, once before.
        constants: how many numbers these give.
    """

    lines: list[str] = field(default_factory=list)
    operations: int = 0
    before: list[str] = field(default_factory=list)
    constants: int = 0


@dataclass(frozen=True)
class Dialect:
    """How numbers and booleans are written.

    Attributes:
        number: type of a number.
        truth: type of a boolean.
        constant: writes a constant.
        sound: how the C of what is never NaN begins: constants and parameters.
    """

    number: str = "V"
    truth: str = "M"
    constant: Callable[[float], str] = lambda x: f"v_set({literal(x)})"
    sound: tuple[str, ...] = ("v_set(", "o[", "m[")


def literal(x: float) -> str:
    """Return a number as C, without loss."""
    # repr is the shortest text that reads back as the same number.
    if x != x:
        return "NAN"
    if x in (float("inf"), float("-inf")):
        return "INFINITY" if x > 0.0 else "(-INFINITY)"
    text = repr(x)
    return f"({text})" if x < 0.0 else text


class CallSite(NamedTuple):
    """A call among the lines: it takes some of the outputs, and others use what it returns.

    Attributes:
        arguments: indices of the outputs that it takes, from the first to the one after the last.
        results: what its results are in C, as the inputs name them.
        lines: what to write.
    """

    arguments: tuple[int, int]
    results: Sequence[str]
    lines: Sequence[str]


def straight_line(
    inputs: Sequence[tuple[Any, str]],
    outputs: Sequence[Any],
    targets: Sequence[str],
    dialect: Dialect,
    calls: Sequence[CallSite] = (),
    order: Sequence[int] = (),
    constants: int | None = None,
) -> Code:
    """Return the C that works out expressions and assigns them.

    Every result is assigned as soon as it is known, and worked out as early as its order allows, so that
    little has to be kept on the way: between two calls first what has order 0 (joint 1), and so on.

    Args:
        inputs: symbols, and what each is in C.
        outputs: expressions (CasADi scalars).
        targets: where each goes; what ends in a bracket takes one that is true or not.
        dialect: how to write numbers.
        calls: calls, in their order.
        order: of each output; all the same when not given.
        constants: number of the first entry of `c` for what constants and parameters alone decide, which is
            worked out before; None to work all out in its place.

    Raises:
        NotElementwise: when an operation has no C here.
    """
    # CasADi puts the graph in order. Its own C is not used: it knows neither vectors nor masks.
    symbols = [symbol for symbol, _ in inputs]
    arguments = [ca.vertcat(*symbols)] if symbols else []
    function = ca.Function("f", arguments, [ca.SX(ca.vertcat(*outputs))])
    graph = _graph(function, [text for _, text in inputs], dialect)
    moved: dict[str, str] = {}
    before: list[str] = []
    if constants is not None:
        moved = _staying(graph, dialect, constants)
        early = _Writer(graph, dialect)
        for text, place in moved.items():
            early.assign(place, text)
        before = early.code.lines
        graph = _without(graph, moved)
    writer = _Writer(graph, dialect)
    writer.code.before, writer.code.constants = before, len(moved)
    level = _levels(graph, calls)
    # CasADi leaves out outputs that are zero by structure.
    zero = dialect.constant(0.0)
    values = [graph.outputs.get(i, zero) for i in range(len(outputs))]
    # After how many calls each output is written: an argument before its own call.
    calls_before = [level.get(text, 0) for text in values]
    for number, call in enumerate(calls):
        for i in range(*call.arguments):
            calls_before[i] = number
    places = list(range(len(outputs)))
    if order:
        places.sort(key=lambda i: order[i])
    for number in range(len(calls) + 1):
        for i in places:
            if calls_before[i] == number:
                writer.assign(targets[i], values[i])
        if number < len(calls):
            writer.code.lines.extend(calls[number].lines)
    return writer.code


class _Step(NamedTuple):
    kind: int
    operands: tuple[str, ...]


class _Graph(NamedTuple):
    steps: dict[str, _Step]  # by the name of the result, operands first
    outputs: dict[int, str]  # those that are not zero by structure


def _graph(function: Any, inputs: Sequence[str], dialect: Dialect) -> _Graph:
    """Return CasADi's instructions with a name for each result, in place of places in working memory."""
    names: dict[int, str] = {}
    graph = _Graph({}, {})
    rows = function.sparsity_out(0).row()
    for i in range(function.n_instructions()):
        kind = function.instruction_id(i)
        if kind == ca.OP_OUTPUT:
            place = rows[function.instruction_output(i)[1]]
            graph.outputs[place] = names[function.instruction_input(i)[0]]
            continue
        out = function.instruction_output(i)[0]
        if kind == ca.OP_INPUT:
            names[out] = inputs[function.instruction_input(i)[1]]
        elif kind == ca.OP_CONST:
            names[out] = dialect.constant(function.instruction_constant(i))
        else:
            operands = tuple(names[place] for place in function.instruction_input(i))
            names[out] = f"x{i}"
            graph.steps[names[out]] = _as_selection(graph.steps, kind, operands) or _Step(kind, operands)
    return graph._replace(steps=_with_shared_inverses(graph.steps))


def _with_shared_inverses(steps: dict[str, _Step]) -> dict[str, _Step]:
    """Return steps of which those that divide by the same divide once.

    A division takes as long as many products. It is one rounding more.
    """
    divisors = Counter(step.operands[1] for step in steps.values() if step.kind == ca.OP_DIV)
    inverses: dict[str, str] = {}  # divisor -> its reciprocal
    made: dict[str, _Step] = {}
    for name, step in steps.items():
        if step.kind == ca.OP_DIV and divisors[step.operands[1]] > 1:
            number, divisor = step.operands
            if divisor not in inverses:
                inverses[divisor] = f"i{name}"
                made[f"i{name}"] = _Step(ca.OP_INV, (divisor,))
            step = _Step(ca.OP_MUL, (number, inverses[divisor]))
        made[name] = step
    return made


def _staying(graph: _Graph, dialect: Dialect, first: int) -> dict[str, str]:
    """Return what constants and parameters alone decide and the rest uses, and its place in `c`."""
    fixed: set[str] = set()

    def stays(text: str) -> bool:
        if text in graph.steps:
            return text in fixed
        return text.startswith(dialect.sound)

    used: list[str] = []
    for name, step in graph.steps.items():  # operands first
        # Not what is true or not: a number would have to be made of it.
        is_number = step.kind not in _COMPARISON and step.kind not in _LOGIC
        if is_number and all(map(stays, step.operands)):
            fixed.add(name)
        else:
            used += step.operands
    moved: dict[str, str] = {}
    for text in (*used, *graph.outputs.values()):
        # The negative of a parameter stays where it is seen that it is never NaN, see `_is_sound`.
        if text in fixed and not _is_negative_input(graph.steps, text):
            moved.setdefault(text, f"c[{first + len(moved)}]")
    return moved


def _is_negative_input(steps: dict[str, _Step], text: str) -> bool:
    """Tell whether a step is the negative of what is no step."""
    return steps[text].kind == ca.OP_NEG and steps[text].operands[0] not in steps


def _without(graph: _Graph, moved: dict[str, str]) -> _Graph:
    """Return a graph that takes some values from elsewhere."""
    steps = {
        name: step._replace(operands=tuple(moved.get(text, text) for text in step.operands))
        for name, step in graph.steps.items()
        if name not in moved
    }
    outputs = {i: moved.get(text, text) for i, text in graph.outputs.items()}
    return _Graph(steps, outputs)


def _as_selection(steps: dict[str, _Step], kind: int, operands: tuple[str, ...]) -> _Step | None:
    """Return a choice between two numbers as one step, where CasADi adds one of them to zero."""
    parts = [steps.get(text) for text in operands]
    if kind != ca.OP_ADD or any(part is None or part.kind != ca.OP_IF_ELSE_ZERO for part in parts):
        return None
    (yes, a), (no, b) = (part.operands for part in parts)  # type: ignore[union-attr]
    if steps.get(no) == (ca.OP_NOT, (yes,)):
        return _Step(_SELECT, (yes, a, b))
    if steps.get(yes) == (ca.OP_NOT, (no,)):
        return _Step(_SELECT, (no, b, a))
    return None


def _levels(graph: _Graph, calls: Sequence[CallSite]) -> dict[str, int]:
    """Return after how many calls each value can be worked out."""
    level = {text: number + 1 for number, call in enumerate(calls) for text in call.results}
    for name, step in graph.steps.items():
        level[name] = max(level.get(text, 0) for text in step.operands)
    return level


class _Writer:
    """Writes steps when they are needed, each once."""

    def __init__(self, graph: _Graph, dialect: Dialect) -> None:
        self.code = Code()
        self._steps, self._dialect = graph.steps, dialect
        self._written: set[str] = set()
        self._truths: set[str] = set()

    def assign(self, target: str, text: str) -> None:
        """Write an assignment, and before it what it needs."""
        # Depth first, with a stack of our own: expressions are deeper than Python's.
        waiting = [text]
        while waiting:
            name = waiting[-1]
            step = self._steps.get(name)
            if step is None or name in self._written:
                waiting.pop()
                continue
            needed = [x for x in step.operands if x in self._steps and x not in self._written]
            if needed:
                waiting.extend(reversed(needed))
                continue
            self._write(name, step)
            self._written.add(waiting.pop())
        taken = f"{self._truth(text)})" if target.endswith("(") else f" = {self._number(text)}"
        self.code.lines.append(f"{target}{taken};")

    def _write(self, name: str, step: _Step) -> None:
        """Write one step."""
        kind, operands = step
        numbers = [self._number(text) for text in operands]
        if kind in (ca.OP_FMIN, ca.OP_FMAX):
            text = self._clamp(kind, numbers[0], numbers[1])
        elif kind in _NUMBER:
            text = _NUMBER[kind].format(*numbers)
        elif kind in _COMPARISON:
            text = _COMPARISON[kind].format(*numbers)
            self._truths.add(name)
        elif kind in _LOGIC:
            text = _LOGIC[kind].format(*map(self._truth, operands))
            self._truths.add(name)
        elif kind == ca.OP_IF_ELSE_ZERO:
            text = f"v_only({self._truth(operands[0])}, {numbers[1]})"
        elif kind == _SELECT:
            text = f"v_select({self._truth(operands[0])}, {numbers[1]}, {numbers[2]})"
        elif kind == ca.OP_INV:
            text = f"{self._dialect.constant(1.0)} / {numbers[0]}"
        else:
            raise NotElementwise(f"it uses CasADi's operation {kind}, which the generator does not know")
        kept = self._dialect.truth if name in self._truths else self._dialect.number
        self.code.lines.append(f"const {kept} {name} = {text};")
        self.code.operations += 1

    def _clamp(self, kind: int, a: str, b: str) -> str:
        """Return the lower or upper of two numbers; where one is never NaN, by the faster way."""
        # The hardware's minimum gives its second operand where one is NaN: with a bound that never is, one
        # instruction does.
        name = "lower" if kind == ca.OP_FMIN else "upper"
        for x, bound in ((a, b), (b, a)):
            if self._is_sound(bound):
                return f"v_{name}({x}, {bound})"
        return f"v_{'min' if kind == ca.OP_FMIN else 'max'}({a}, {b})"

    def _is_sound(self, text: str) -> bool:
        """Tell whether a value is never NaN: a constant, its negative, or a choice between two."""
        step = self._steps.get(text)
        if step is None:
            return text.startswith(self._dialect.sound)
        if step.kind == ca.OP_NEG:
            return self._is_sound(step.operands[0])
        if step.kind == _SELECT:
            _, yes, no = step.operands
            return self._is_sound(yes) and self._is_sound(no)
        return False

    def _number(self, text: str) -> str:
        """Return a value as a number."""
        return f"v_number({text})" if text in self._truths else text

    def _truth(self, text: str) -> str:
        """Return a value as a boolean."""
        return text if text in self._truths else f"v_ne({text}, {self._dialect.constant(0.0)})"
