"""Each term of the certificate's checker, against a twin in matrices that was written from docs/proof.md.

The twin says what `sample`, `inequality` and `bounds` are; and of each of their sums, one with a term less is
another one at random numbers: so no term can be lost unseen.
"""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Iterator
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armgpi.base.arrays import Array
from armgpi.certification import check_certificate

checker: Any = check_certificate
CLAIMS = "", "start", "jump"


def facts(seed: int) -> dict[str, Any]:
    """Return numbers of an arm and a law, none of them 0 but in a case of each that may be."""
    rng = np.random.default_rng(seed)

    def number(low: float, high: float) -> Fraction:
        return Fraction(int(rng.uniform(low, high) * 2**30), 2**30)

    found: dict[str, Any] = {
        "integrators": int(rng.integers(1, 4)),
        "rolloff": int(rng.integers(0, 3)),
        "delay": int(rng.integers(1, 3)),
        "sample_time": number(4e-3, 8e-3),
        "omega": sorted(number(5.0, 40.0) for _ in range(2)),
        "rate": number(0.1, 1.0),
    }
    found |= {key: number(0.7, 1.9) for key in checker.LAW[2:]}
    ranges = {
        "delta_low": (0.6, 0.9),
        "delta_high": (1.1, 2.0),
        "sigma": (1.0, 9.0),
        "count_time": (0.01, 0.02),
    }
    ranges |= {"kappa_v": (1.0, 9.0), "kappa_e": (50.0, 90.0)}
    ranges |= {"kappa_g": (500.0, 900.0), "kappa_f": (1.0, 9.0)}
    ranges |= {"sigma_error": (1.0, 9.0), "kappa_error": (1.0, 9.0), "jump": (1.0, 9.0)}
    ranges |= dict.fromkeys(("torque", "shift", "count", "reference", "zone", "spread"), (0.1, 0.9))
    found |= {key: number(*ends) for key, ends in ranges.items()}
    vectors = ("inverse", "hold", "reach", "velocity")
    found |= {key: [number(0.5, 2.0) for _ in range(2)] for key in vectors}
    for key in ("delay", "reference", "kappa_f", "kappa_g"):  # the first seeds have all
        if seed > 3 and rng.random() < 0.2:
            found[key] = 0 * found[key]
    return found


def solution(c: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return a solution of no inequality: random positive numbers, P positive definite."""
    rng, n = np.random.default_rng(seed), len(checker.loop(c, c["omega"][0])[1])
    factor = np.round(rng.normal(size=(n, n)) * 256) / 256
    P = factor @ factor.T + n * np.eye(n)
    exact = [[Fraction(float(x)) for x in row] for row in P]
    t, a = ([Fraction(int(x * 2**20), 2**20) for x in rng.uniform(0.5, 2.0, size)] for size in (6, 5))
    return {"P": exact, "t": t, "a": a, "alpha": Fraction(3, 8)}


def plain(c: Any) -> Any:
    """Return exact numbers as floats and arrays."""
    if isinstance(c, dict):
        return {key: plain(value) for key, value in c.items()}
    if isinstance(c, list | tuple):
        return np.array([plain(x) for x in c])
    return float(c) if isinstance(c, Fraction) else c


def growth(x: float) -> float:
    """Return at least e^x."""
    return 1.0 / (1.0 - x + x**2 / 2.0 - x**3 / 6.0)


def sample_twin(c: dict[str, Any]) -> SimpleNamespace:
    """Return what a sample adds; the gains are of what K asks for, e', e and the late e."""
    x = SimpleNamespace(**plain(c))
    moves = x.reference > 0.0
    sigma = (x.sigma if moves else 0.0) + x.spread * x.sigma_error
    coriolis = (2.0 * x.kappa_v if moves else 0.0) + x.spread * x.kappa_error
    h, d = x.sample_time, x.delay
    f, wide = growth(sigma * h), growth(sigma * d * h + x.sigma * x.count_time)
    rest = 1.0 - f * (h * coriolis + h * x.kappa_f + h**2 / 2.0 * x.kappa_g)
    low, high = x.delta_low / wide, x.delta_high * wide
    asked = (f - rest) * high
    speed = (f - rest) * x.kappa_f + f * coriolis + f * h * x.kappa_g
    place, late = f * x.kappa_e, f * x.kappa_g * (d > 0)
    most_k = max(abs(float(K[n])) for _, _, K, n in (checker.loop(c, w) for w in c["omega"]))
    noise = most_k * x.omega[-1] ** 2 * x.count
    seen = x.kappa_e * x.count + x.kappa_g * x.count + x.kappa_g * (d + 1) * h * x.reference
    w = f * (x.torque + seen) + asked * noise
    size = w / rest / x.omega[0] ** 2
    sizes = size, size * x.omega[-1] * h / 2.0, x.shift / x.omega[0] ** 3, x.count, x.zone
    return SimpleNamespace(
        f=f,
        wide=wide,
        rest=rest,
        ends=(low, high),
        gains=(asked, speed, place, late),
        sizes=sizes,
        w=w,
        noise=noise,
    )


def flat(value: Any) -> Iterator[float]:
    """Give the numbers of nested sequences."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple | np.ndarray):
        for each in value:
            yield from flat(each)
    else:
        yield float(value)


def inequality_twin(c: dict[str, Any], omega: Fraction, turn: Fraction, delta: Fraction, s: Any) -> Array:
    """Return the matrix of the inequality: (1 - theta alpha) P + theta multipliers - f Z^T P Z."""
    known, x, y = sample_twin(c), SimpleNamespace(**plain(c)), SimpleNamespace(**plain(s))
    _, A, K, late = checker.loop(c, omega)
    A, K, m = plain(A), plain(K), x.integrators
    n, theta, least = len(A), float(omega) * x.sample_time, x.omega[0]
    e = np.eye(n)
    held = theta * e[1] + theta**2 / 2.0 * e[0]
    seen = [K, e[1], e[late], e[0] - e[late]]
    scale = np.array([1.0, least, least**2, least**2]) * known.rest
    sources = [(t, g, row) for t, g, row in zip(y.t, np.array(known.gains) / scale, seen, strict=False) if g]
    own = np.arange(n)
    count = np.where((own >= 2) & (own < n - x.delay), A[:, late], 0.0) + float(delta) * held * K[late]
    zone = np.where((own >= 2) & (own < 2 + m), A[:, late], 0.0)
    columns = [(theta * e[1], t) for t, _, _ in sources] + [(theta * e[0], y.t[4])]
    rubs = n + len(columns)
    if x.kappa_f:
        columns.append((held, y.t[5]))
    inputs = theta * e[1], theta * e[0], theta * e[2], count, zone
    columns += [(z, a) for z, a, size in zip(inputs, y.a, known.sizes, strict=True) if size]
    Z = np.column_stack([A + float(delta) * np.outer(held, K), *(z for z, _ in columns)])
    powers = np.array([0, 1, *range(2, 2 + m), *range(2, n - x.delay - m), *[0] * x.delay])
    Z = float(turn) ** powers[:, np.newaxis] * Z
    X = -known.f * Z.T @ y.P @ Z + np.diag([0.0] * n + [theta * weight for _, weight in columns])
    place = y.t[4] * len(sources) * theta**2 / 4.0
    taken = sum((t + place) * g**2 * np.outer(row, row) for t, g, row in sources)
    X[:n, :n] += (1.0 - theta * y.alpha) * y.P - theta * taken
    if x.kappa_f:
        X[1, rubs] += y.t[5] * x.sample_time * x.kappa_f / 2.0
        X[rubs, 1] = X[1, rubs]
    return X


def bounds_twin(c: dict[str, Any], s: Any, claim: str) -> dict[str, Any]:
    """Return the bounds of a claim."""
    known, x, y = sample_twin(c), SimpleNamespace(**plain(c)), SimpleNamespace(**plain(s))
    units, _, _, late = checker.loop(c, c["omega"][0])
    h, least, fastest = x.sample_time, x.omega[0], x.omega[-1]
    inverse = np.linalg.inv(y.P)

    def most(row: Any) -> float:
        row = plain(row)
        return math.sqrt(row @ inverse @ row)

    of_e, of_v, of_late = most(units[0]), most(units[1]) * fastest, most(units[late])
    of_ask = max(most(checker.loop(c, omega)[2]) for omega in c["omega"]) * fastest**2

    def motion(level: float, before: float = 0.0) -> tuple[float, float, float, float]:
        e, v = level * of_e, level * of_v
        past, ask = level * of_late, level * of_ask
        if before:
            e, v = e + h * v + h**2 / 2.0 * before, v + h * before
        asked, speed, place, old = known.gains
        far = asked * ask + speed * v + place * past + old * (e + past)
        return e, v, known.ends[1] * (ask + known.noise) + x.kappa_f * v + (known.w + far) / known.rest, ask

    level = math.sqrt(sum(a * size**2 for a, size in zip(y.a, known.sizes, strict=True)) / y.alpha)
    other = math.sqrt(y.P[2, 2]) / least**2
    if claim == "start":
        hidden = (x.kappa_e + x.kappa_g) * x.count / x.delta_low
        level = max(level, other * (x.jump + hidden))
    e, v, fast, ask = motion(level)
    if claim == "jump":
        ratio = math.sqrt(x.delta_high / x.delta_low)
        level, first = ratio * level + other * x.jump, known.f * ratio * fast
        fast = max(first, known.f * motion(level, first)[2])
        moved = h**2 * fast * math.sqrt(y.P[0, 0]) + 2.0 * h * fast * math.sqrt(y.P[1, 1]) / least
        e, v, last, ask = motion(level + moved)
        fast = max(fast, last)
    e, v = e + h * v + h**2 / 2.0 * fast, math.sqrt(known.f) * (v + h * fast)
    return {
        "errors": np.sqrt(known.f * x.inverse) * e + x.delay * h * x.velocity,
        "speed": [v],
        "torques": x.hold + math.sqrt(known.wide) * x.reach * (ask + known.noise),
    }


class Case:
    """Random numbers, and what the twin has for them."""

    def __init__(self, seed: int) -> None:
        self.c = facts(seed)
        self.s = solution(self.c, seed)
        slow, fast = self.c["omega"]
        self.steps = [(slow, slow / fast), (fast, Fraction(1))]
        self.delta = self.c["delta_high"]
        self.expected = {
            "sample": [list(flat(vars(sample_twin(self.c))))],
            "inequality": [
                list(flat(inequality_twin(self.c, *step, self.delta, self.s))) for step in self.steps
            ],
            "bounds": [list(flat(bounds_twin(self.c, self.s, claim))) for claim in CLAIMS],
        }

    def found(self, module: Any, name: str) -> list[list[float]]:
        """Return what a checker has for them."""
        known = module["sample"](self.c)
        if name == "sample":
            (f, wide), rest, *others = known
            return [list(flat([f, wide, rest, *others]))]
        if name == "inequality":
            function = module["inequality"]
            matrices = [function(self.c, known, *step, self.delta, self.s) for step in self.steps]
            return [list(flat(matrix)) for matrix in matrices]
        return [list(flat(module["bounds"](self.c, self.s, claim))) for claim in CLAIMS]

    def agrees(self, module: Any, name: str) -> bool:
        """Tell whether a checker has the same as the twin, to rounding of floats."""
        for ours, theirs in zip(self.found(module, name), self.expected[name], strict=True):
            if len(ours) != len(theirs):
                return False
            size = max(1e-3, float(np.abs(theirs).max())) if name == "inequality" else 0.0
            if not np.allclose(ours, theirs, rtol=1e-11, atol=1e-13 * size):
                return False
        return True


#: What the twin has, and the functions of the checker that it is made of.
PARTS = {
    "sample": ("sample", "growth"),
    "inequality": ("inequality", "sources_of"),
    "bounds": ("bounds", "largest", "motion"),
}


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("name", PARTS)
def test_the_checker_has_what_the_proof_says(name: str, seed: int) -> None:
    assert Case(seed).agrees(vars(checker), name)


def sums_of(tree: ast.Module, name: str) -> list[ast.BinOp]:
    """Return the sums and other products of two sides in the functions of a part."""
    functions = [
        node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name in PARTS[name]
    ]
    return [node for function in functions for node in ast.walk(function) if isinstance(node, ast.BinOp)]


def with_a_term_less(name: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Give each sum of a part, and the checker with one of its two sides alone."""
    source = inspect.getsource(checker)
    for place, one in enumerate(sums_of(ast.parse(source), name)):
        if not isinstance(one.op, ast.Add | ast.Sub):
            continue
        for side in ("left", "right"):
            tree = ast.parse(source)
            node = sums_of(tree, name)[place]
            kept = getattr(node, side)
            dropped = ast.fix_missing_locations(_Drop(node, kept).visit(tree))
            module: dict[str, Any] = {"__name__": "mutant"}
            exec(compile(dropped, "mutant", "exec"), module)
            yield f"{ast.unparse(one)} -> {ast.unparse(kept)} (line {one.lineno})", module


class _Drop(ast.NodeTransformer):
    """Puts one side of a sum in its place."""

    def __init__(self, node: ast.AST, kept: ast.AST) -> None:
        self.node, self.kept = node, kept

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Return what takes a sum's place."""
        return self.kept if node is self.node else self.generic_visit(node)


#: How sums begin that are no terms: places, sizes of lists.
_NO_TERMS = ("order - m", "2 + m", "n + ", "n - ", "range(", "[0] * (n", "theta * theta / 2, theta] + ")


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS)
def test_no_term_can_be_lost(name: str) -> None:
    cases = [Case(seed) for seed in range(4)]
    alive = []
    for said, module in with_a_term_less(name):
        if any(text in said.partition(" -> ")[0][:60] for text in _NO_TERMS):
            continue
        try:
            if all(case.agrees(module, name) for case in cases):
                alive.append(said)
        except (ArithmeticError, IndexError, NameError, TypeError, ValueError):
            continue
    assert not alive
