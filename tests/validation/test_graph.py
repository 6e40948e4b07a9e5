"""The graph that stands for SymPy and CasADi while repairs are searched gives what these give."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import byhand
import numpy as np
import pytest
import sympy
import textbooks

from armgpi.validation import graph, mechanics, models


@pytest.fixture
def graphs() -> Iterator[None]:
    uninstall = mechanics.install()
    yield
    uninstall()


@pytest.mark.parametrize("style", ["furuta", "column", "homework", "prr_lagrange", "eom", "mechanics"])
def test_a_model_is_the_same_as_a_graph(style: str) -> None:
    folder = byhand.FOLDER if (byhand.FOLDER / f"{style}.py").exists() else textbooks.FOLDER
    path = folder / f"{style}.py"
    real = models.resolve(path).calls
    uninstall = mechanics.install()
    try:
        other = models.resolve(path).calls
        assert other.keys() == real.keys()
        n = 3 if style in ("column", "prr_lagrange") else 2
        q, v = np.random.default_rng(4).normal(size=(2, n))
        for name, call in real.items():
            state = [{"q": q, "v": v, "a": v - q}[letter].copy() for letter in models.ARGUMENTS[name]]
            one, two = (np.asarray(f(*state), dtype=float).ravel() for f in (call, other[name]))
            np.testing.assert_allclose(two, one, rtol=1e-12, atol=1e-13)
    finally:
        uninstall()
    assert sys.modules["sympy"] is sympy


@pytest.mark.parametrize(
    "text",
    [
        "sin(x * y) ** 3 / (2 - cos(y))",
        "exp(-x) * tan(y / 3)",
        "sqrt(1 + x ** 2) - x / y",
        "(x - y) ** -2 + 4",
    ],
)
def test_derivatives_are_those_of_sympy(text: str) -> None:
    values = {"x": 0.7, "y": 1.9}
    names = ("sin", "cos", "exp", "tan", "sqrt", "Symbol")

    def expression(module: ModuleType) -> Any:
        found = {name: getattr(module, name) for name in names}
        return eval(text, found, {name: found["Symbol"](name) for name in values})

    expected = float(expression(sympy).diff("x", "y").subs(values))
    uninstall = mechanics.install()
    try:
        second = expression(sys.modules["sympy"]).diff(graph.symbol("x"), graph.symbol("y"))
        assert float(graph.Program(second)(values)) == pytest.approx(expected, rel=1e-12)
    finally:
        uninstall()


_KANE = """
from sympy import symbols
from sympy.physics.mechanics import *
q1, q2, w1, w2 = dynamicsymbols("q1 q2 w1 w2")
m, l, J, k = symbols("m l J k")
N = ReferenceFrame("N")
A = N.orientnew("A", "Axis", [q1, N.y])
B = ReferenceFrame("B")
B.orient_axis(A, A.x, q2)
A.set_ang_vel(N, w1 * N.y)
B.set_ang_vel(A, w2 * A.x)
O, P = Point("O"), Point("P")
O.set_vel(N, 0)
P.set_pos(O, l * A.x)
P.v2pt_theory(O, N, A)
S = P.locatenew("S", 0.4 * l * B.z - 0.1 * l * B.y)
S.v2pt_theory(P, N, B)
tip = Particle("tip", P, 0.3 * m)
body = RigidBody("body", S, B, m, (inertia(B, J, 2 * J, 1.5 * J, 0.1 * J, -0.05 * J, 0.2 * J), S))
loads = [(S, -9.81 * m * N.z), (P, 0.5 * N.x), (B, k * B.x - 0.2 * N.y)]
kane = KanesMethod(N, [q1, q2], [w1, w2], [w1 - q1.diff(), w2 - q2.diff()])
kane.kanes_equations([tip, body], loads)
given = {q1: 0.4, q2: -0.7, w1: 1.1, w2: 0.6, m: 1.3, l: 0.8, J: 0.02, k: 0.15}
"""


def test_kanes_equations_are_those_of_sympy() -> None:
    def equations() -> tuple[Any, Any]:
        space: dict[str, Any] = {}
        exec(_KANE, space)
        kane, given = space["kane"], space["given"]
        return kane.mass_matrix.subs(given), kane.forcing.subs(given)

    real = [np.array(each.evalf(), dtype=float) for each in equations()]
    uninstall = mechanics.install()
    try:
        mine = [graph.Program(each)({}) for each in equations()]
    finally:
        uninstall()
    for one, two in zip(mine, real, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-13)


def test_coordinates_of_time(graphs: None) -> None:
    mechanics = sys.modules["sympy.physics.mechanics"]
    angle, time = mechanics.dynamicsymbols("th"), graph.symbol("t")
    height = mechanics.sin(angle) * 2
    rate = height.diff(time)
    assert float(graph.Program(rate.subs({angle.diff(time): 3.0, angle: 0.5}))({})) == pytest.approx(
        6.0 * np.cos(0.5)
    )
    assert float(graph.Program(rate.diff(angle.diff(time)))({"th": 0.5})) == pytest.approx(2.0 * np.cos(0.5))
