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

from armgpi.validation import graph, models


@pytest.fixture
def graphs() -> Iterator[None]:
    uninstall = graph.install()
    yield
    uninstall()


@pytest.mark.parametrize("style", ["furuta", "column", "homework", "prr_lagrange"])
def test_a_model_is_the_same_as_a_graph(style: str) -> None:
    folder = byhand.FOLDER if (byhand.FOLDER / f"{style}.py").exists() else textbooks.FOLDER
    path = folder / f"{style}.py"
    real = models.resolve(path).calls
    uninstall = graph.install()
    try:
        other = models.resolve(path).calls
        assert other.keys() == real.keys()
        n = 3 if style in ("column", "prr_lagrange") else 2
        q, v = np.random.default_rng(4).normal(size=(2, n))
        for name, call in real.items():
            state = [{"q": q, "v": v}[letter].copy() for letter in models.ARGUMENTS[name]]
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
    uninstall = graph.install()
    try:
        second = expression(sys.modules["sympy"]).diff(graph.symbol("x"), graph.symbol("y"))
        assert float(graph.Program(second)(values)) == pytest.approx(expected, rel=1e-12)
    finally:
        uninstall()


def test_coordinates_of_time(graphs: None) -> None:
    mechanics = sys.modules["sympy.physics.mechanics"]
    angle, time = mechanics.dynamicsymbols("th"), graph.symbol("t")
    height = mechanics.sin(angle) * 2
    rate = height.diff(time)
    assert float(graph.Program(rate.subs({angle.diff(time): 3.0, angle: 0.5}))({})) == pytest.approx(
        6.0 * np.cos(0.5)
    )
    assert float(graph.Program(rate.diff(angle.diff(time)))({"th": 0.5})) == pytest.approx(2.0 * np.cos(0.5))
