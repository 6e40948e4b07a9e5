"""The matrix inequality of a certificate, solved by Clarabel and checked in exact arithmetic.

What the solver gets is the checker's own matrix, column by column: it is affine in the unknowns. What it
returns is rounded to decimal numbers and checked as such; its status is not looked at.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg, sparse

from armgpi.base.arrays import Array
from armgpi.certification import check_certificate
from armgpi.errors import import_extra

checker: Any = check_certificate  # generic over number types, so without annotations

#: Rates of decay alpha [omega] that are tried.
_ALPHAS = (0.05, 0.1, 0.15, 0.2, 0.23, 0.26, 0.3, 0.4)
#: By how much the inequality must hold at least in scaled coordinates: more in a retry.
_MARGINS = (1e-7, 1e-6, 1e-5)
#: Beyond the best rate of decay the bound gets worse: by how much ends the search.
_WORSE = 1.1
#: Significant digits of a solution.
_DIGITS = 15


class Solution(NamedTuple):
    """A solution of the inequality in decimal numbers, as texts.

    Attributes:
        P: row by row.
        alpha: rate of decay of V [omega].
        t: multipliers of what motion and gravity add.
        a: multipliers of the inputs.
    """

    P: list[list[str]]
    alpha: str
    t: list[str]
    a: list[str]


class _Used(NamedTuple):
    """Which multipliers there are: those of what is not zero."""

    t: list[int]
    a: list[int]


def solve(*facts: Mapping[str, Any]) -> Solution | None:
    """Return the solution with the smallest bound that was found, or None; it holds exactly.

    Args:
        *facts: law, numbers of the arm and sizes of what disturbs, as a certificate has them.

    Raises:
        MissingPackage: when Clarabel is not installed.
    """
    exact = merge_facts(*facts)
    problem = _Problem.from_facts(_floats(exact))
    if problem is None:
        return None
    found: list[tuple[float, float, Array]] = []
    for alpha in _ALPHAS:
        values = problem.attempt(alpha)
        if values is not None:
            found.append((problem.error_bound(values, alpha), alpha, values))
        if not found:
            continue
        least = min(error for error, *_ in found)
        if values is None or found[-1][0] > _WORSE * least:
            break  # what is too fast at one rate is so at every larger one
    for _, alpha, values in sorted(found, key=lambda attempt: attempt[0]):
        solution = problem.to_decimals(values, alpha)
        if checker.holds(exact, checker.exact(solution._asdict())):
            return solution
    return None


def merge_facts(*facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return parts of a certificate as the checker takes them: one mapping of exact numbers."""
    merged: dict[str, Any] = {}
    for part in facts:
        merged |= {key: checker.exact(value) for key, value in part.items()}
    return merged


def solvable(*facts: Mapping[str, Any]) -> bool:
    """Tell whether the inequality has a solution at a low rate of decay, as floats have it."""
    problem = _Problem.from_facts(_floats(merge_facts(*facts)))
    if problem is None:
        return False
    return problem.attempt(_ALPHAS[0]) is not None


def _floats(data: Any) -> Any:
    """Return fractions as floats, what else is whole as it is."""
    if isinstance(data, dict):
        return {key: _floats(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_floats(value) for value in data]
    return data if isinstance(data, int) else float(data)


class _Problem:
    """The inequality's matrices as functions of the unknowns: lower triangle of P, t, a and (P^-1)_11."""

    def __init__(self, basis: Array, sizes: Array, used: _Used, start: Array) -> None:
        self.basis = basis
        self.sizes = sizes
        self.used = used
        self.n = len(start)
        self._choose(start)

    @classmethod
    def from_facts(cls, facts: Any) -> _Problem | None:
        """Return the problem; None where a sample adds too much for any solution."""
        known = checker.sample(facts)
        growth, growth_while_late = known.growths
        if not (min(growth, growth_while_late) >= 1.0 and 0.0 < known.rest <= 1.0):
            return None
        first, *_ = facts["omega"]
        n = len(checker.loop(facts, first).A)
        sources = [i for i, gain in enumerate(known.gains) if gain]
        sources.append(4)
        if facts["kappa_f"]:
            sources.append(5)
        inputs = [i for i, size in enumerate(known.sizes) if size]
        used = _Used(sources, inputs)
        corners = [*itertools.product(_steps(facts["omega"]), known.ends)]
        basis = []
        unknowns = n * (n + 1) // 2 + len(sources) + len(inputs)
        for unit in np.eye(unknowns):
            P, t, a = (part.tolist() for part in _split(unit, n, used))
            solution = {"P": P, "alpha": 0.0, "t": t, "a": a}
            matrices = []
            for (omega, ratio), delta in corners:
                rows = checker.inequality(facts, known, omega, ratio, delta, solution)
                matrix = np.array(rows)
                matrices.append(matrix / (omega * facts["sample_time"]))
            basis.append(matrices)
        low, high = known.ends
        start = _lyapunov(facts, math.sqrt(low * high))
        sizes = np.array(known.sizes)[inputs]
        return cls(np.array(basis), sizes, used, start)

    def _choose(self, P: Array) -> None:
        """Take coordinates in which a P is the unit matrix; the solver needs them."""
        root = np.linalg.cholesky(P)
        self._to = np.linalg.inv(root).T
        back = np.linalg.inv(self._to)
        n = self.n
        unknowns, corners, size, _ = self.basis.shape
        lower = n * (n + 1) // 2
        rows, columns = np.tril_indices(n)
        units = [_split(unit, n, _Used([], []))[0] for unit in np.eye(lower)]
        turned_units = [(back.T @ unit @ back)[rows, columns] for unit in units]
        self._mixed = np.eye(unknowns)
        self._mixed[:lower, :lower] = turned_units
        # Inputs in units in which the unit matrix meets them with ones, and their multipliers with them.
        at_start = np.tensordot(P[rows, columns], self.basis[:lower], 1)
        diagonals = np.diagonal(at_start, axis1=1, axis2=2)
        of_inputs = -diagonals[:, n:].min(axis=0)
        weights = 1.0 / np.sqrt(np.maximum(of_inputs, 1e-12))
        turn = np.diag(np.concatenate([np.ones(n), weights]))
        turn[:n, :n] = self._to
        inputs = range(lower, unknowns)
        self._mixed[inputs, inputs] = 1.0 / weights**2
        mixed = np.tensordot(self._mixed, self.basis, 1)
        turned = turn.T @ mixed.reshape(-1, size, size) @ turn
        vectors = np.array([_svec(matrix) for matrix in turned])
        self._matrices = vectors.reshape(unknowns, corners, -1)
        self._units = np.zeros((unknowns, corners, size * (size + 1) // 2))
        for k, unit in enumerate(units):
            whole = np.zeros((size, size))
            whole[:n, :n] = unit
            self._units[k] = _svec(whole)

    def attempt(self, alpha: float) -> Array | None:
        """Return unknowns that solve the inequality as floats have it, None when there seem to be none."""
        for margin in _MARGINS:
            values = self.solve_at(alpha, margin)
            if values is None:
                return None
            if self.violation(values, alpha) < 0.0:
                return values
            P = _split(values, self.n, self.used)[0]
            if np.linalg.eigvalsh(P)[0] > 0.0:
                self._choose(P)  # nearer to a solution the solver sees better
        return None

    def solve_at(self, alpha: float, margin: float) -> Array | None:
        """Return the unknowns as Clarabel has them; None for numbers that are not finite."""
        clarabel = import_extra("clarabel", "certify")
        unknowns, corners, size, _ = self.basis.shape
        matrices = self._matrices - alpha * self._units
        blocks = [self._size_of_inputs()]
        right = [np.array([alpha])]
        without_bound = np.zeros((1, matrices.shape[2]))
        for corner in range(corners):
            blocks.append(-np.vstack([matrices[:, corner], without_bound]).T)
            right.append(_svec(-margin * np.eye(size)))
        bound, fixed = self._bound_of_error()
        blocks.append(bound)
        right.append(fixed)
        cones = [clarabel.NonnegativeConeT(1)]
        cones += [clarabel.PSDTriangleConeT(size)] * corners
        cones.append(clarabel.PSDTriangleConeT(self.n + 1))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        objective = np.eye(unknowns + 1)[-1]
        no_squares = sparse.csc_matrix((unknowns + 1, unknowns + 1))
        constraints = sparse.csc_matrix(np.vstack(blocks))
        solver = clarabel.DefaultSolver(
            no_squares, objective, constraints, np.concatenate(right), cones, settings
        )
        inner = np.array(solver.solve().x)[:-1]
        x = self._mixed.T @ inner
        if not np.isfinite(x).all():
            return None
        return np.asarray(x)

    def _size_of_inputs(self) -> Array:
        """Return the row of what all inputs add to V, which is at most alpha; (1, unknowns + 1)."""
        unknowns = len(self.basis)
        relative = self.sizes / self.sizes.max()
        row = np.zeros((1, unknowns + 1))
        row[0, unknowns - len(relative) : unknowns] = relative**2
        row[0, :unknowns] = self._mixed @ row[0, :unknowns]
        return row

    def _bound_of_error(self) -> tuple[Array, Array]:
        """Return matrix and right side of: [[P, c], [c, z]] is positive semidefinite, so z >= c P^-1 c."""
        n, unknowns = self.n, len(self.basis)
        bound = np.zeros((unknowns + 1, n + 1, n + 1))
        for k in range(n * (n + 1) // 2):
            bound[k, :n, :n] = _split(np.eye(unknowns)[k], n, self.used)[0]
        bound[-1, n, n] = 1.0
        first = self._to[0]
        c = first / np.abs(first).max()
        fixed = np.zeros((n + 1, n + 1))
        fixed[:n, n] = c
        fixed[n, :n] = c
        vectors = np.array([_svec(matrix) for matrix in bound])
        return -vectors.T, _svec(fixed)

    def violation(self, x: Array, alpha: float) -> float:
        """Return by how much a solution misses the inequality, in the solver's coordinates."""
        inner = np.linalg.solve(self._mixed.T, x)
        missed = np.tensordot(inner, self._matrices - alpha * self._units, 1)
        matrices = np.array([_matrix(vector) for vector in missed])
        return -float(np.linalg.eigvalsh(matrices)[:, 0].min())

    def to_decimals(self, x: Array, alpha: float) -> Solution:
        """Return a solution in decimal numbers."""
        P, t, a = _split(x, self.n, self.used)
        lower = np.tril(P)
        symmetric = lower + np.tril(lower, -1).T  # of both triangles, which rounding tells apart, the lower
        return Solution(
            [list(map(_text, row)) for row in symmetric],
            _text(alpha),
            [_text(multiplier) for multiplier in t],
            [_text(multiplier) for multiplier in a],
        )

    def error_bound(self, x: Array, alpha: float) -> float:
        """Return what the error is bounded by, but for a factor."""
        P, _, a = _split(x, self.n, self.used)
        disturbed = a[self.used.a] @ self.sizes**2
        return float(np.linalg.inv(P)[0, 0] * disturbed / alpha)


def _split(x: Array, n: int, used: _Used) -> tuple[Array, Array, Array]:
    """Return P, t and a of the unknowns."""
    lower = n * (n + 1) // 2
    end = len(x) - len(used.a)
    P = np.zeros((n, n))
    P[np.tril_indices(n)] = x[:lower]
    P = P + np.tril(P, -1).T
    t = np.zeros(6)
    t[used.t] = x[lower:end]
    a = np.zeros(5)
    a[used.a] = x[end:]
    return P, t, a


def _steps(omegas: Sequence[float]) -> list[tuple[float, float]]:
    """Return bandwidths, and each over the one that follows it, at the ends and in the middle of a range."""
    last = len(omegas) - 1
    steps = []
    for i in sorted({0, min(1, last), last // 2, max(last - 1, 0), last}):
        near = sorted({*omegas[max(i - 1, 0) : i + 2]})
        steps += [(omegas[i], omegas[i] / after) for after in near]
    return steps


def _lyapunov(facts: Any, delta: float) -> Array:
    """Return the V of the loop with one delta, or of a stable one near it: coordinates to begin with."""
    omega = facts["omega"][0]
    channel = checker.loop(facts, omega)
    A = np.array(channel.A, dtype=float)
    K = np.array(channel.K, dtype=float)
    theta = omega * facts["sample_time"]
    push = np.zeros(len(A))
    push[:2] = 0.5 * theta * theta, theta
    for gain in (delta, 1.0):
        closed = A + gain * np.outer(push, K)
        growth = np.abs(np.linalg.eigvals(closed)).max()
        if growth < 1.0:
            weight = theta * np.eye(len(A))
            return np.asarray(linalg.solve_discrete_lyapunov(closed.T, weight))
    return np.eye(len(A))


def _svec(X: Array) -> Array:
    """Return the upper triangle, column by column, off-diagonal elements times the root of two."""
    n = len(X)
    i, j = np.tril_indices(n)
    weights = np.where(i == j, 1.0, math.sqrt(2.0))
    return np.asarray(X[j, i] * weights)


def _matrix(x: Array) -> Array:
    """Return the symmetric matrix of :func:`_svec`."""
    n = math.isqrt(2 * len(x))
    X = np.zeros((n, n))
    i, j = np.tril_indices(n)
    entries = x / np.where(i == j, 1.0, math.sqrt(2.0))
    X[i, j] = entries
    X[j, i] = entries
    return X


def _text(value: float) -> str:
    """Return a decimal number."""
    return f"{value:.{_DIGITS}g}"
