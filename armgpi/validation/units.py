"""Does a repair hold for other numbers, and has it right units? No declarations: the robot's numbers say it.

A mass of the model is a mass of the robot: if it is another one, some robot with other masses, and the same
lengths and inertias, moves as the model says. So the derivative of all that a right model gives by one of its
numbers is a sum of the robot's derivatives by numbers of one unit. In a repair that agrees at the numbers of
the file alone, such as ``m2`` for ``m2 * l1 ** 2`` where a length is 1, that by the length is none.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array

#: Step of a derivative, of the number itself; what it leaves out is far below what counts as the same.
STEP = 1e-4
#: A derivative is such a sum up to this, relative.
_SAME = 1e-5
#: Numbers of a model that are looked at, at most.
_MOST = 30


class Slopes(NamedTuple):
    """Derivatives of what an arm gives by its numbers.

    Attributes:
        names: the functions whose values are stacked, each in units of its largest value.
        sizes: these largest values.
        units: unit -> orthonormal columns that span the derivatives, (values, rank).
        values: the robot's numbers, without signs.
        columns: the derivatives by these, (values, count).
    """

    names: tuple[str, ...]
    sizes: tuple[float, ...]
    units: Mapping[str, Array]
    values: Array
    columns: Array

    def spans(self, column: Array) -> bool:
        """Tell whether a derivative is one by numbers of one unit of the robot."""
        return any(_is_in(basis, column) for basis in self.units.values())

    def pins(self, column: Array, value: float) -> bool:
        """Tell whether a derivative is one by those numbers of the robot that have a value, if any has."""
        same = np.abs(self.values - abs(value)) <= 1e-6 * abs(value)
        return not same.any() or _is_in(span(list(self.columns[:, same].T)), column)


def _is_in(basis: Array, column: Array) -> bool:
    rest = column - basis @ (basis.T @ column)
    return float(np.linalg.norm(rest)) <= _SAME * float(np.linalg.norm(column))


def span(columns: Sequence[Array]) -> Array:
    """Return orthonormal columns of what some columns span."""
    matrix = np.stack(columns, axis=-1)
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    left, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(left[:, sizes > 1e-6])


def doubts(source: str, values: Callable[[str], Array | None], known: Slopes) -> tuple[int, int, int]:
    """Return how many numbers of a source mean nothing in the robot, not what is as large, and are looked at.

    Args:
        source: a model that agrees with the robot.
        values: gives what a changed source gives, as in `known`; None when it does not work.
        known: the robot's derivatives.
    """
    wrong = other = seen = 0
    for name, node in list(numbers(source))[:_MOST]:
        value = float(node.value)  # type: ignore[arg-type]
        if value == 0.0:
            continue
        ends = [values(with_number(source, node, value * (1.0 + s * STEP))) for s in (1.0, -1.0)]
        if ends[0] is None or ends[1] is None:
            continue
        column = (ends[0] - ends[1]) / (2.0 * STEP)
        if np.abs(column).max() < 1e-7 or name in ("n", "N"):
            continue  # nothing depends on it
        seen += 1
        wrong += not known.spans(column)
        other += not known.pins(column, value)
    return wrong, other, seen


def numbers(source: str) -> Iterator[tuple[str, ast.Constant]]:
    """Yield the numbers of a source that have a name: assigned, an item, an argument, an entry of a list."""
    pairs: list[tuple[str, Any]] = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                pairs += [(ast.unparse(a), b) for a, b in zip(names, values, strict=False)]
            case ast.Assign(targets=[ast.Name() | ast.Attribute() as name], value=value):
                entries = value.elts if isinstance(value, ast.List | ast.Tuple) else [value]
                pairs += [(ast.unparse(name), x) for x in entries]
            case ast.AnnAssign(target=target, value=ast.Constant() as value):
                pairs.append((ast.unparse(target), value))
            case ast.Dict(keys=keys, values=values):
                pairs += [(ast.unparse(a), b) for a, b in zip(keys, values, strict=True) if a is not None]
            case ast.keyword(arg=str() as word, value=value):
                pairs.append((word, value))
    for text, x in pairs:
        inner = x.operand if isinstance(x, ast.UnaryOp) else x
        if isinstance(inner, ast.Constant) and type(inner.value) in (int, float):
            yield text, inner


def with_number(source: str, node: ast.Constant, value: float) -> str:
    """Return a source with another number in place of one."""
    lines = source.splitlines(keepends=True)
    line = lines[node.lineno - 1].encode()
    new = line[: node.col_offset] + repr(value).encode() + line[node.end_col_offset :]
    lines[node.lineno - 1] = new.decode()
    return "".join(lines)
