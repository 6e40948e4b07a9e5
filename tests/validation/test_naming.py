"""Mistakes in the sources of textbook arms: named by a repair that is proved."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import textbooks
from hand_models import in_coordinates, planar
from mutants import same
from sampling import for_search, sample
from scoring import alarms, interval, outcomes, summary

from armgpi import errors, testing, validate
from armgpi.validation import edits, models
from armgpi.validation.dictionary import Dictionary

#: What was named wrongly once: arm, what the right source has, and what the mistaken one has instead.
CASES = {
    "a term that a precomputed constant hides": ("pendubot", " + m2 * l1**2", ""),
    "the sign of a slider's centre of mass": ("rpr_inverse", "x = r - lc2", "x = r + lc2"),
    "degrees for radians in a twist": ("dh3_jacobian", "0.0, np.pi / 2)", "0.0, 90.0)"),
    "a missing m l² a": ("rpr_inverse", " + m3 * r**2", ""),
    "an offset forgotten": ("furuta", "np.sin(2 * q[1])", "np.sin(2 * q[1] + np.pi / 2)"),
    "c2 c2 for c2 s2": ("rrr_christoffel", "* c2 * s2", "* c2 * c2"),
    "indices of a Christoffel symbol swapped": ("prr_jacobian", "- dD[j, k, i]", "- dD[k, i, j]"),
    "a square lost": ("acrobot", "+ I1 + I2", "+ I1 + I2 + m2 * lc2 - m2 * lc2**2"),
    "the unit of one length": ("scara", "l2 = 0.36", "l2 = 360.0"),
    "a and d swapped": ("dh3_jacobian", "(0.0, 0.0, a2, 0.0)", "(0.0, a2, 0.0, 0.0)"),
    "ω × I ω forgotten": ("ne3_base", " + np.cross(w3, I3 @ w3)", ""),
    "a cross product forgotten": ("ne3_base", "p2 + np.cross(b2, s2) +", "p2 +"),
    "a rotation transposed": ("ne4", "w = R[i].T @ (w", "w = R[i] @ (w"),
    "a factor of two products": ("ppp_gantry", "0.5 * m2 * (x", "(x"),
    "ω × I ω forgotten in a loop": (
        "ne4",
        "\n            + np.cross(speeds[i], INERTIAS[i] @ speeds[i])",
        "",
    ),
    "an acceleration forgotten in a loop": ("ne4", "dw + a[i] * AXIS +", "dw +"),
    "a mass forgotten where nothing moves": ("ppp_gantry", "m1 + m2 + m3", "m1 + m3"),
    "a height forgotten": ("ppp_gantry", "m3 * g * q[2]", "m3 * g"),
    "a term of a vector in the plane forgotten": ("rr_recursive", "b2 = joint + ", "b2 = "),
    "the end of a loop": ("rrr_numeric", "range(k + 1)", "range(k)"),
    "a factor forgotten in a function of a comprehension": ("ne4", "st * sa]", "st]"),
    "a factor forgotten in a loop of SymPy": ("prr_lagrange", "c * V[k] / 2", "c * V[k]"),
    "the wrong frame": ("ne4", "mu = R[i + 1] @ f, R[i + 1] @ mu", "mu = R[i] @ f, R[i + 1] @ mu"),
}
#: Each takes 8 to 35 s to name: `make search` has them, and everything else what is like them.
LONG = (
    *("ω × I ω forgotten", "a rotation transposed"),
    *("ω × I ω forgotten in a loop", "a factor forgotten in a function of a comprehension"),
    *("a factor forgotten in a loop of SymPy", "the wrong frame", "an acceleration forgotten in a loop"),
    "a cross product forgotten",
)


def written(folder: Path, source: str) -> Path:
    path = folder / "mine.py"
    path.write_text(source, encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("name", [for_search(name) if name in LONG else name for name in CASES])
def test_a_mistake_is_named_by_a_repair_that_is_right(name: str, tmp_path: Path) -> None:
    arm, old, new = CASES[name]
    right = textbooks.text(arm)
    assert old in right
    path = written(tmp_path, right.replace(old, new, 1))
    report = validate(path, textbooks.robot(arm, right))
    assert not report.agrees
    assert report.repaired is not None, report
    assert same(report.repaired, right, 99), report
    assert len(report.causes) == 1
    assert "with this change the model agrees" in str(report)
    line = report.causes[0].line
    assert line is not None
    assert report.repaired.splitlines()[line - 1].strip() in str(report)


@pytest.mark.parametrize("arm", sample(textbooks.ARMS))
def test_a_right_arm_raises_no_alarm(arm: str, tmp_path: Path) -> None:
    source = textbooks.text(arm, 20261122)
    assert validate(written(tmp_path, source), textbooks.robot(arm, source)).agrees


def test_a_mistake_of_a_free_value_is_no_longer_named_by_one() -> None:
    # Gravity of 8.77 m/s²: nobody takes that, so something else is wrong.
    robot, right = planar(1)
    report = validate({"gravity": lambda q: 0.894 * right["gravity"](q)}, robot)
    (cause,) = report.causes
    assert cause.kind == "unknown"
    assert cause.text.startswith("not diagnosed")
    assert any("strength of gravity: 8.77" in text for text in cause.alternatives)


def test_two_mistakes_are_named_each_in_its_line_and_function(tmp_path: Path) -> None:
    right = textbooks.text("rrr_christoffel")
    wrong = right.replace("+ Ix2 * s2**2", "- Ix2 * s2**2", 1).replace(
        "m3 * g * lc3 * c23]", "m3 * lc3 * c23]", 1
    )
    report = validate(written(tmp_path, wrong), textbooks.robot("rrr_christoffel", right))
    assert report.repaired is not None
    assert same(report.repaired, right, 99)
    lines = wrong.splitlines()
    inertia, gravity = sorted(report.causes, key=lambda cause: cause.line or 0)
    assert "Ix2" in lines[(inertia.line or 0) - 1]
    assert "lc3 * c23]" in lines[(gravity.line or 0) - 1]
    assert {one.function for one in inertia.elements} == {"mass_matrix"}
    assert {one.function for one in gravity.elements} == {"gravity"}


# Conventions.

REST = np.array([[1.0, 0.0], [-1.0, 1.0]])  # angles of the robot from absolute ones


@pytest.mark.parametrize(
    ("A", "b", "options"),
    [
        (REST, [0.0, 0.0], {"absolute": True}),
        (np.eye(2), [np.pi / 2, 0.0], {"from_vertical": "up"}),
        (np.eye(2), [-np.pi / 2, 0.0], {"from_vertical": "down"}),
        (REST, [np.pi / 2, 0.0], {"absolute": True, "from_vertical": "up"}),
    ],
)
def test_another_convention_may_be_declared(
    A: np.ndarray, b: list[float], options: dict[str, object]
) -> None:
    robot, right = planar(1)
    model = in_coordinates(right, A, b, A)
    assert not validate(model, robot).agrees
    assert validate(model, robot, **options).agrees


def test_a_convention_that_was_not_declared_is_named_before_changes_that_undo_it(tmp_path: Path) -> None:
    right = textbooks.text("rr_textbook")
    absolute = """
A = np.array([[1.0, 0.0], [-1.0, 1.0]])

def M(t):
    return A.T @ _mass_matrix(A @ t) @ A

def G(t):
    return A.T @ _gravity(A @ t)
"""
    path = written(tmp_path, right.replace("def ", "def _") + absolute)
    robot = textbooks.robot("rr_textbook", right)
    assert validate(path, robot, absolute=True).agrees
    (cause,) = validate(path, robot).causes
    assert cause.kind == "absolute-angles"


def test_rotor_inertia_and_short_names_may_be_declared() -> None:
    robot, right = planar(1)
    rotors = {"M": lambda q: right["mass_matrix"](q) + np.diag([0.1, 0.2]), "G": right["gravity"]}
    assert validate(rotors, robot, rotor_inertia={"q1": 0.1, "q2": 0.2}).agrees
    assert not validate(rotors, robot).agrees
    assert validate({"h": right["coriolis_torque"]}, robot, names={"h": "coriolis_torque"}).agrees


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"from_vertical": "left"}, "from_vertical"),
        ({"absolute": "yes"}, "absolute"),
        ({"absolute": True, "robot": None}, "robot"),
    ],
)
def test_a_convention_that_is_none_is_refused(options: dict[str, object], name: str) -> None:
    robot, right = planar(1)
    with pytest.raises(errors.ParameterError) as caught:
        validate(right, **{"robot": robot, **options})
    assert caught.value.name == name


def test_a_function_that_is_not_compared_is_refused_with_those_that_are() -> None:
    robot, right = planar(1)
    with pytest.raises(errors.NameNotFound, match=r"'nothing'.*mass_matrix.*h=nothing"):
        validate(right, robot, names={"h": "nothing"})


# Forms of models and reports.


def test_a_notebook_is_a_model(tmp_path: Path) -> None:
    source = textbooks.text("cart_pole")
    cells = [
        {"cell_type": "markdown", "source": ["# A cart"]},
        {"cell_type": "code", "source": ["%matplotlib inline\n"]},
        {"cell_type": "code", "source": source.splitlines(keepends=True)},
    ]
    path = tmp_path / "arm.ipynb"
    path.write_text(json.dumps({"cells": cells}), encoding="utf-8")
    assert validate(path, textbooks.robot("cart_pole", source)).agrees
    path.write_text("{}", encoding="utf-8")
    with pytest.raises(errors.ModelError, match="is no notebook"):
        validate(path, textbooks.robot("cart_pole", source))


def test_expressions_of_casadi_are_a_model() -> None:
    casadi = pytest.importorskip("casadi")
    robot, right = planar(1)
    at = np.array([0.3, -0.7])
    far = right["gravity"](at)[1] / np.cos(at.sum())
    near = (right["gravity"](at)[0] - right["gravity"](at)[1]) / np.cos(at[0])
    q = casadi.SX.sym("q", 2)
    second = far * casadi.cos(q[0] + q[1])
    assert validate({"gravity": casadi.vertcat(near * casadi.cos(q[0]) + second, second)}, robot).agrees


def test_functions_of_matlab_are_told_how_to_get_here(tmp_path: Path) -> None:
    path = tmp_path / "arm.m"
    path.write_text("function M = mass_matrix(q)", encoding="utf-8")
    with pytest.raises(errors.ModelError, match="of MATLAB, write the symbolic expressions"):
        validate(path, planar(1).robot)


def test_a_model_that_takes_all_memory_is_stopped(tmp_path: Path) -> None:
    path = written(tmp_path, "def gravity(q):\n    return [0.0] * 10**10\n")
    with pytest.raises(errors.ModelError, match="MemoryError"):
        validate(path, planar(1).robot)


def test_an_assertion_prints_the_report() -> None:
    robot, right = planar(1)
    assert testing.assert_dynamics(right, robot).agrees
    with pytest.raises(AssertionError, match="the model differs in gravity"):
        testing.assert_dynamics({"gravity": lambda q: -right["gravity"](q)}, robot)


def test_the_report_is_markdown_and_latex() -> None:
    robot, right = planar(1)
    report = validate({"gravity": lambda q: -right["gravity"](q)}, robot)
    assert "| gravity | DIFFERS |" in report.markdown()
    assert r"\begin{itemize}" in report.latex()
    assert "dict" in report.latex()


def test_formulas_are_set_in_reports(tmp_path: Path) -> None:
    right = textbooks.text("rr_textbook")
    old = "m2 * lc2**2"
    assert old in right
    report = validate(
        written(tmp_path, right.replace(old, "m2 * lc2", 1)), textbooks.robot("rr_textbook", right)
    )
    assert dict(report.causes[0].formulas) == {"found": "lc2", "expected": "lc2 ** 2"}
    assert r"expected: ${l_{c2}}^{2}$" in report.latex()
    assert r"expected: ${l_{c2}}^{2}$" in report.markdown()
    assert "<mark>** 2</mark>" in report.html().replace(" ** 2</mark>", "** 2</mark>")
    assert (
        "<msup><mrow><msub><mi>l</mi><mn>c2</mn></msub></mrow><mrow><mn>2</mn></mrow></msup>" in report.html()
    )


def test_a_mistake_that_only_shows_beyond_degree_two_is_repaired(tmp_path: Path) -> None:
    right = textbooks.text("ppp_gantry")
    wrong = right.replace("(x**2 + y**2) +", "(x**2 + y) +", 1)
    assert wrong != right
    report = validate(written(tmp_path, wrong), textbooks.robot("ppp_gantry", right))
    assert report.repaired is not None
    assert same(report.repaired, right, 99)


# The parts.


def test_a_term_is_found_by_its_values() -> None:
    rng = np.random.default_rng(1)
    s, v = rng.normal(size=8), rng.normal(size=8)
    terms = Dictionary({"m": 1.23, "l": 0.41, "k": 0.77}, {"s": s, "v": v})
    space = {"m": 1.23, "l": 0.41, "k": 0.77, "s": s, "v": v}
    for text in ("m * l ** 2", "2 * m * l * s", "-0.5 * k * s * v ** 2"):
        values = np.broadcast_to(eval(text, space), 8)
        (found, *_) = terms.terms(values)
        assert found is not None, text
        assert np.allclose(eval(found.text, space), values, rtol=1e-9), found
    assert terms.terms(rng.normal(size=8)) == []


def test_a_source_is_changed_where_it_has_to_be() -> None:
    change = edits.Change("sign", (2, 4, 2, 9), "a + b", "a - b", "f", "", 8.0)
    assert edits.apply_changes("ä = 1\nx = a + b  # ä\n", (change,)) == "ä = 1\nx = a - b  # ä\n"


# What is measured: `make search` draws new mistakes and numbers.

#: Mistakes at once -> how many are drawn per arm, and the lower bounds of what docs/validate.md measured:
#: of the names that are right, and of the mistakes that are named rightly.
MEASURED = {1: (4, 0.957, 0.894), 2: (2, 0.891, 0.683)}


@pytest.mark.search
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("mistakes", MEASURED)
def test_mistakes_in_arms_that_nobody_had_seen_are_named(mistakes: int) -> None:
    count, precision, recall = MEASURED[mistakes]
    seed = int.from_bytes(os.urandom(4), "big")
    found = outcomes(textbooks.UNSEEN, count, seed, mistakes)
    text = f"seed {seed}\n{summary(found)}"
    print(text)
    assert all(one.found and one.proved for one in found), text
    right, named = sum(one.right for one in found), sum(one.named for one in found)
    # Few draws say little: they must not be worse than what was measured.
    assert interval(right, named)[1] >= precision, text
    assert interval(right, len(found))[1] >= recall, text


@pytest.mark.search
@pytest.mark.timeout(600)
@pytest.mark.parametrize("arm", textbooks.ARMS)
def test_random_numbers_raise_no_alarm(arm: str) -> None:
    assert alarms(arm, 10, int.from_bytes(os.urandom(4), "big")) == []


def test_casadis_symbols_have_as_many_joints_as_their_names_say() -> None:
    """Without a function whose size says it: a frame of two joints, of which one does not enter."""
    casadi = pytest.importorskip("casadi")
    q = casadi.SX.sym("q2")
    found = models._of_casadi(casadi, {"forward_kinematics": casadi.vertcat(casadi.cos(q), q)}, {})
    assert found.n == 2
    np.testing.assert_allclose(found.calls["forward_kinematics"](np.array([9.0, 0.4])), [np.cos(0.4), 0.4])
