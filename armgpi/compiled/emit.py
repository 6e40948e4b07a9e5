"""Straight-line C from CasADi's list of instructions, one local variable for each result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca

from armgpi.compiled.symbols import NotElementwise

#: What an instruction is in C. {0} and {1} are its operands.
_NUMBER = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_FABS: "v_abs({0})",
    ca.OP_SIN: "v_sin({0})",
    ca.OP_COS: "v_cos({0})",
    ca.OP_SQRT: "v_sqrt({0})",
    ca.OP_EXP: "v_exp({0})",
    ca.OP_LOG: "v_log({0})",
    ca.OP_FLOOR: "v_floor({0})",
    ca.OP_SIGN: "v_sign({0})",
    ca.OP_REMAINDER: "{0} - v_rint({0})",  # only ever by one
}
_TRUTH = {
    ca.OP_LT: "v_lt({0}, {1})",
    ca.OP_LE: "v_le({0}, {1})",
    ca.OP_EQ: "v_eq({0}, {1})",
    ca.OP_NE: "v_ne({0}, {1})",
}
_LOGIC = {ca.OP_AND: "{0} & {1}", ca.OP_OR: "{0} | {1}", ca.OP_NOT: "v_not({0})"}


@dataclass
class Code:
    """Lines of C that work out expressions.

    Attributes:
        lines: the lines.
        results: for every expression the C expression of its value.
        operations: how many arithmetic operations there are.
    """

    lines: list[str] = field(default_factory=list)
    results: list[str] = field(default_factory=list)
    operations: int = 0


@dataclass(frozen=True)
class Dialect:
    """How numbers and truths are written.

    Attributes:
        number: type of a number.
        truth: type of a truth.
        constant: writes a constant.
        sound: how the C of what is never NaN begins: constants and parameters.
    """

    number: str = "V"
    truth: str = "M"
    constant: Callable[[float], str] = lambda x: f"v_set({literal(x)})"
    sound: tuple[str, ...] = ("v_set(", "o[", "m[")


def literal(x: float) -> str:
    """Return a number as C, without loss; hexadecimal where a decimal one would be long."""
    if x != x:
        return "NAN"
    if x in (float("inf"), float("-inf")):
        return "INFINITY" if x > 0.0 else "(-INFINITY)"
    text = repr(x)
    return f"({text})" if x < 0.0 else text


def straight_line(
    inputs: Sequence[tuple[Any, str]],
    outputs: Sequence[Any],
    dialect: Dialect,
    after: Mapping[int, Callable[[Sequence[str]], Sequence[str]]] | None = None,
) -> Code:
    """Return the C that works out expressions in their order.

    Args:
        inputs: symbols, and what each is in C.
        outputs: expressions (CasADi scalars).
        dialect: how to write numbers.
        after: number of outputs known -> what to write then, given their C expressions: a call whose results
            later outputs may use.

    Raises:
        NotElementwise: when an operation has no C here.
    """
    function = ca.Function(
        "f", [ca.vertcat(*(x for x, _ in inputs))] if inputs else [], [ca.vertcat(*outputs)]
    )
    instructions = list(_instructions(function, [name for _, name in inputs], dialect))
    rows = function.sparsity_out(0).row()
    divisors = Counter(step.operands[1] for step in instructions if step.kind == ca.OP_DIV)
    code = Code()
    truths: set[str] = set()
    inverses: dict[str, str] = {}
    results: dict[int, str] = {}
    after = after or {}
    zero, one = dialect.constant(0.0), dialect.constant(1.0)
    written = 0

    def number(text: str) -> str:
        return f"v_number({text})" if text in truths else text

    def truth(text: str) -> str:
        return text if text in truths else f"v_ne({text}, {zero})"

    def call(known: int) -> None:
        """Write what comes after so many outputs; those that are zero by structure are never put out."""
        nonlocal written
        for count in range(written, known + 1):
            if count in after:
                code.lines.extend(after[count]([results.get(i, zero) for i in range(count)]))
        written = known + 1

    call(rows[0] if rows else len(outputs))
    for kind, name, operands in instructions:
        if kind == ca.OP_OUTPUT:
            place = int(name)
            results[rows[place]] = number(operands[0])
            # At once, as the next output may use what is called.
            call(rows[place + 1] if place + 1 < len(rows) else len(outputs))
            continue
        numbers = [number(text) for text in operands]
        if kind == ca.OP_DIV and divisors[operands[1]] > 1:
            # One division for all that have a divisor in common.
            if operands[1] not in inverses:
                inverses[operands[1]] = f"i{name}"
                code.lines.append(f"const {dialect.number} i{name} = {one} / {numbers[1]};")
            text = f"{numbers[0]} * {inverses[operands[1]]}"
        elif kind in (ca.OP_FMIN, ca.OP_FMAX):
            text = _clamped(kind, numbers[0], numbers[1], dialect)
        elif kind in _NUMBER:
            text = _NUMBER[kind].format(*numbers)
        elif kind in _TRUTH:
            text = _TRUTH[kind].format(*numbers)
            truths.add(name)
        elif kind in _LOGIC:
            text = _LOGIC[kind].format(*map(truth, operands))
            truths.add(name)
        elif kind == ca.OP_IF_ELSE_ZERO:
            text = f"v_only({truth(operands[0])}, {numbers[1]})"
        elif kind == ca.OP_INV:
            text = f"{one} / {numbers[0]}"
        else:
            raise NotElementwise(f"it uses CasADi's operation {kind}, which the generator does not know")
        code.lines.append(f"const {dialect.truth if name in truths else dialect.number} {name} = {text};")
        code.operations += 1
    code.results = [results.get(i, zero) for i in range(len(outputs))]
    return code


class _Instruction(NamedTuple):
    kind: int
    name: str  # of the result, for an output its place
    operands: tuple[str, ...]


def _instructions(function: Any, inputs: Sequence[str], dialect: Dialect) -> Iterator[_Instruction]:
    """Give CasADi's instructions with a name for each result, in place of places in working memory."""
    names: dict[int, str] = {}
    for i in range(function.n_instructions()):
        kind = function.instruction_id(i)
        if kind == ca.OP_OUTPUT:
            place = function.instruction_output(i)[1]
            yield _Instruction(kind, str(place), (names[function.instruction_input(i)[0]],))
            continue
        out = function.instruction_output(i)[0]
        if kind == ca.OP_INPUT:
            names[out] = inputs[function.instruction_input(i)[1]]
        elif kind == ca.OP_CONST:
            names[out] = dialect.constant(function.instruction_constant(i))
        else:
            operands = tuple(names[place] for place in function.instruction_input(i))
            names[out] = f"x{i}"
            yield _Instruction(kind, names[out], operands)


def _clamped(kind: int, a: str, b: str, dialect: Dialect) -> str:
    """Return the lower or upper of two numbers; where one is never NaN, by the faster way."""
    name = "lower" if kind == ca.OP_FMIN else "upper"
    for x, bound in ((a, b), (b, a)):
        if bound.startswith(dialect.sound):
            return f"v_{name}({x}, {bound})"
    return f"v_{'min' if kind == ca.OP_FMIN else 'max'}({a}, {b})"
