"""What a search wants: an expression of metrics, how it is taken over scenarios, and constraints."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError
from armgpi.loop import metrics

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": np.abs,
    "log": np.log,
    "sqrt": np.sqrt,
    "max": np.maximum,
    "min": np.minimum,
}
_OPERATORS: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
#: Over which scenarios an objective is -> what is taken of theirs; of "cvar" after the others are left out.
_TOGETHER: Mapping[str, Callable[..., Any]] = {
    "mean": np.mean,
    "median": np.median,
    "worst": np.max,
    "cvar": np.mean,
}
#: What is minimised of a candidate that is not feasible, at least: above any objective.
_BEYOND = 1e12
#: Longest expression, so that none nests too deeply.
_LONGEST = 500
#: Numbers in it are below this one.
_LARGEST = 1e300


def known_names() -> dict[str, str]:
    """Return what an expression may name -> the metric: its name, or its heading where that is one word.

    They are the metrics that a loop adds up while it runs.
    """
    known = metrics.without_rollouts()
    names = {}
    for name, metric in known.items():
        word = metric.heading.casefold()
        if word.isidentifier():
            names[word] = name
    return names | {name: name for name in known}


def heading(text: str, slides: bool = False) -> str:
    """Return what tables and pictures call an expression: of one metric its heading with its unit.

    Args:
        text: the expression.
        slides: whether all joints of the arm are prismatic.
    """
    name = known_names().get(text.strip())
    if name is None:
        return text
    metric = metrics.ALL[name]
    unit = metric.unit.symbol(slides)
    return f"{metric.heading} [{unit}]" if unit else metric.heading


class Expression:
    """Arithmetic on metrics, each of which is one number for the arm, such as ``itae + 0.5*variation``.

    Attributes:
        text: as it was written.
        names: of the metrics in it.
    """

    def __init__(self, text: str, name: str = "objective") -> None:
        """Read the text.

        Raises:
            NameNotFound: when it names what is no metric.
            ParameterError: when it is no arithmetic.
        """
        self.text = text
        try:
            if not isinstance(text, str) or len(text) > _LONGEST:
                raise ValueError
            self._tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise ParameterError(
                name, text, "arithmetic on metrics, such as 'itae + 0.5*variation'"
            ) from None
        self._known = known_names()
        self._name = name
        self.names = sorted({self._known[word] for word in self._names_in(self._tree)})

    def __call__(self, values: Mapping[str, Array]) -> Array:
        """Return the value where metrics have these values; arrays of any one shape."""
        with np.errstate(all="ignore"):
            return np.asarray(self._value(self._tree, values), dtype=np.float64)

    def _names_in(self, node: ast.AST) -> list[str]:
        """Return the names in a tree, refusing what is no arithmetic."""
        if isinstance(node, ast.Name):
            if node.id not in self._known:
                raise metrics.not_found(node.id, self._known)
            return [node.id]
        number: Any = getattr(node, "value", None)
        if type(number) in (int, float) and number < _LARGEST:
            return []
        match node:
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return [*self._names_in(left), *self._names_in(right)]
            case ast.UnaryOp(op=op, operand=inner) if type(op) in _OPERATORS:
                return self._names_in(inner)
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
                expected_arguments = 2 if name in ("max", "min") else 1
                if len(args) == expected_arguments:
                    names: list[str] = []
                    for argument in args:
                        names += self._names_in(argument)
                    return names
        expected = f"sums, products, powers and {', '.join(_FUNCTIONS)} of metrics and numbers"
        raise ParameterError(self._name, self.text, expected)

    def _value(self, node: Any, values: Mapping[str, Array]) -> Any:
        """Return the value of a tree."""
        if isinstance(node, ast.Name):
            return values[self._known[node.id]]
        if isinstance(node, ast.Constant):
            return np.float64(node.value)  # type: ignore[arg-type]  # of NumPy: 1/0 is no exception
        if isinstance(node, ast.Call):
            arguments = [self._value(argument, values) for argument in node.args]
            return _FUNCTIONS[node.func.id](*arguments)  # type: ignore[attr-defined]
        operate = _OPERATORS[type(node.op)]
        if isinstance(node, ast.BinOp):
            return operate(self._value(node.left, values), self._value(node.right, values))
        return operate(self._value(node.operand, values))


class Constraint:
    """A bound on an expression that holds in every scenario, such as ``peak_error <= 0.05``."""

    def __init__(self, text: str) -> None:
        """Read the text.

        Raises:
            NameNotFound: when it names what is no metric.
            ParameterError: when it is no bound.
        """
        sides = ""
        if isinstance(text, str):
            sides = text.replace("<=", "<").replace(">=", ">")
        signs = [sign for sign in "<>" if sides.count(sign) == 1]
        if len(signs) != 1 or "=" in sides:
            raise ParameterError("constraints", text, "a bound on a metric, such as 'peak_error <= 0.05'")
        small, large = sides.split(signs[0])
        if signs[0] == ">":
            small, large = large, small
        self.text = text
        self._small = Expression(small, "constraints")
        self._large = Expression(large, "constraints")
        self.names = sorted({*self._small.names, *self._large.names})

    def violation(self, values: Mapping[str, Array]) -> Array:
        """Return by how much it is broken, relative to the bound; 0 where it holds, infinite where NaN."""
        small, large = np.broadcast_arrays(self._small(values), self._large(values))
        with np.errstate(all="ignore"):
            beyond = (small - large) / np.maximum(np.abs(large), 1e-9)
        beyond = np.where(np.isnan(beyond), math.inf, beyond)
        return np.asarray(np.where(small <= large, 0.0, beyond))


class Judged(NamedTuple):
    """What candidates are worth, arrays of shape (candidates,).

    Attributes:
        objective: over all scenarios; infinite where one of them failed.
        failed: share of scenarios that diverged, or have no objective.
        violation: mean of what constraints were broken by.
    """

    objective: Array
    failed: Array
    violation: Array

    @property
    def feasible(self) -> npt.NDArray[np.bool_]:
        """Which of them fail nowhere and break nothing."""
        return np.asarray((self.failed == 0.0) & (self.violation == 0.0) & np.isfinite(self.objective))

    def scores(self, extra: Array | float = 0.0) -> Array:
        """Return what an optimiser minimises: the objective, or for what is not feasible more than any of it.

        Args:
            extra: a violation besides.
        """
        broken = np.minimum(self.violation + extra, 1e3) + 1e3 * self.failed
        is_bad = ~self.feasible | (broken > 0.0)
        return np.asarray(np.where(is_bad, _BEYOND * (1.0 + broken), self.objective))


class Objective:
    """An expression over scenarios, with constraints.

    Attributes:
        expression: of metrics, for one scenario.
        over: "mean", "median", "worst" or "cvar": the mean of the worst.
        share: how much of the scenarios are the worst.
        constraints: what has to hold in every scenario.
        names: of the metrics in all of it.
    """

    def __init__(
        self, text: str, over: str = "mean", share: float = 0.1, constraints: Sequence[str] = ()
    ) -> None:
        """Read the expressions.

        Raises:
            NameNotFound: when one names what is no metric.
            ParameterError: when one is none.
        """
        self.expression = Expression(text)
        self.over = over
        self.share = share
        self.constraints = [Constraint(bound) for bound in constraints]
        names = set(self.expression.names)
        for constraint in self.constraints:
            names.update(constraint.names)
        self.names = sorted(names)

    def judge(self, values: Mapping[str, Array], failed: Array) -> Judged:
        """Return what candidates are worth.

        Args:
            values: metric -> one number per candidate and scenario, (candidates, scenarios).
            failed: which of them diverged, likewise.
        """
        costs = np.broadcast_to(self.expression(values), failed.shape)
        failed = failed | ~np.isfinite(costs)
        broken = np.zeros(failed.shape)
        for constraint in self.constraints:
            broken = broken + np.where(failed, 0.0, constraint.violation(values))
        costs = np.where(failed, 0.0, costs)
        if self.over == "cvar":  # the mean of the worst share
            count = math.ceil(self.share * costs.shape[1] - 1e-9)
            costs = np.sort(costs, axis=1)[:, -count:]
        together = _TOGETHER[self.over](costs, axis=1)
        objective = np.where(failed.any(axis=1), math.inf, together)
        return Judged(objective, failed.mean(axis=1), broken.mean(axis=1))
