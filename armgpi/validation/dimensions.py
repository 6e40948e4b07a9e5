"""Units of what a change puts into a source: kg and kg² m have no sum, whatever the numbers are.

Names say what a number is: ``m1`` is a mass, ``l1`` and ``lc1`` are lengths, ``I1`` is an inertia. Other
names, and numbers that are no usual coefficients, may have any unit.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Container

from armgpi.validation.alternatives import function_name
from armgpi.validation.units import USUAL

#: Powers of kg and m.
Unit = tuple[float, float]

_PURE: Unit = (0.0, 0.0)
#: A name with one digit -> the unit of such a number.
_NAMED = (
    (re.compile(r"m_?\d"), (1.0, 0.0)),
    (re.compile(r"[lL]_?c?_?\d"), (0.0, 1.0)),
    (re.compile(r"I_?\d"), (1.0, 2.0)),
)


class _Unlike(Exception):
    """Two units are added that have no sum."""


def adds_unlike(text: str, numbers: Container[str]) -> bool:
    """Tell whether an expression adds numbers of different units.

    Args:
        text: the expression.
        numbers: names of the numbers of the source: of other names nothing is known.
    """
    try:
        _unit(ast.parse(text.strip(), mode="eval").body, numbers)
    except _Unlike:
        return True
    except SyntaxError:  # a statement
        return False
    return False


def _unit(node: ast.expr, numbers: Container[str]) -> Unit | None:
    """Return the unit of an expression, None where nothing tells it.

    Raises:
        _Unlike: when it adds numbers of different units.
    """
    match node:
        case ast.Constant(value=int() | float() as value) if value in USUAL:
            return _PURE
        case ast.Call() if function_name(node) in ("sin", "cos", "tan"):
            return _PURE
        case ast.UnaryOp(operand=inner):
            return _unit(inner, numbers)
        case ast.BinOp(left=left, op=op, right=right):
            if isinstance(op, ast.Add | ast.Sub) and ast.Constant in (type(left), type(right)):
                return None  # a number in a sum has the unit of the rest
            return _of_operation(_unit(left, numbers), op, right, _unit(right, numbers))
        case ast.Name() | ast.Attribute() | ast.Subscript():
            name = re.findall(r"\w+", ast.unparse(node))[-1]
            if name not in numbers:
                return None
            return next((unit for pattern, unit in _NAMED if pattern.fullmatch(name)), None)
    return None


def _of_operation(one: Unit | None, op: ast.operator, right: ast.expr, other: Unit | None) -> Unit | None:
    """Return the unit of two operands together."""
    if isinstance(op, ast.Pow):
        power = right.value if isinstance(right, ast.Constant) else None
        if one is None or not isinstance(power, int | float):
            return None
        return one[0] * power, one[1] * power
    if one is None or other is None:
        return None
    if isinstance(op, ast.Add | ast.Sub):
        if one != other:
            raise _Unlike
        return one
    sign = {ast.Mult: 1.0, ast.Div: -1.0}.get(type(op))
    return None if sign is None else (one[0] + sign * other[0], one[1] + sign * other[1])
