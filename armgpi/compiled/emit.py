"""Straight-line C from CasADi's list of instructions, one local variable for each result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

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
    ca.OP_FMIN: "v_min({0}, {1})",
    ca.OP_FMAX: "v_max({0}, {1})",
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
    """

    number: str = "V"
    truth: str = "M"
    constant: Callable[[float], str] = lambda x: f"v_set({literal(x)})"


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
    symbols = [symbol for symbol, _ in inputs]
    names = [name for _, name in inputs]
    function = ca.Function("f", [ca.vertcat(*symbols)] if symbols else [], [ca.vertcat(*outputs)])
    rows = function.sparsity_out(0).row()
    code = Code()
    values: dict[int, str] = {}  # place in CasADi's working memory -> C
    truths: set[str] = set()
    results: dict[int, str] = {}
    after = after or {}
    written = 0
    count = 0

    def number(place: int) -> str:
        text = values[place]
        return f"v_number({text})" if text in truths else text

    def truth(place: int) -> str:
        text = values[place]
        return text if text in truths else f"v_ne({text}, {dialect.constant(0.0)})"

    def hooks(place: int) -> None:
        """Write what comes once the outputs before `place` of CasADi's nonzeros are known.

        It must come before the next output is worked out, which may use it; structural zeros are not put out.
        """
        nonlocal written
        known = rows[place] if place < len(rows) else len(outputs)
        while written <= known:
            if written in after:
                known_now = [results.get(i, dialect.constant(0.0)) for i in range(written)]
                code.lines.extend(after[written](known_now))
            written += 1

    hooks(0)

    for i in range(function.n_instructions()):
        kind = function.instruction_id(i)
        if kind == ca.OP_OUTPUT:
            at = function.instruction_output(i)[1]
            (place,) = function.instruction_input(i)
            results[rows[at]] = number(place)
            hooks(at + 1)
            continue
        (out,) = function.instruction_output(i)
        if kind == ca.OP_INPUT:
            values[out] = names[function.instruction_input(i)[1]]
            continue
        if kind == ca.OP_CONST:
            values[out] = dialect.constant(function.instruction_constant(i))
            continue
        places = function.instruction_input(i)
        count += 1
        name = f"x{i}"
        if kind in _NUMBER:
            text, is_truth = _NUMBER[kind].format(*map(number, places)), False
        elif kind in _TRUTH:
            text, is_truth = _TRUTH[kind].format(*map(number, places)), True
        elif kind in _LOGIC:
            text, is_truth = _LOGIC[kind].format(*map(truth, places)), True
        elif kind == ca.OP_IF_ELSE_ZERO:
            text, is_truth = f"v_only({truth(places[0])}, {number(places[1])})", False
        elif kind == ca.OP_INV:
            text, is_truth = f"{dialect.constant(1.0)} / {number(places[0])}", False
        else:
            raise NotElementwise(f"it uses CasADi's operation {kind}, which the generator does not know")
        if is_truth:
            truths.add(name)
        code.lines.append(f"const {dialect.truth if is_truth else dialect.number} {name} = {text};")
        values[out] = name
    code.results = [results.get(i, dialect.constant(0.0)) for i in range(len(outputs))]
    code.operations = count
    return code
