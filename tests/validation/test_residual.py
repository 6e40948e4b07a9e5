"""What differs is told exactly: of planar chains in closed form a term is dropped, turned or halved."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armgpi
from armgpi import Robot, validate
from armgpi.base.arrays import Array
from armgpi.validation.problem import Element
from armgpi.validation.report import DynamicsReport
from armgpi.validation.residual import Explanation, _Entry, _together
from armgpi.validation.summands import Summand

G = 9.81


class Term(NamedTuple):
    """One summand of an entry: its name as it has to be told, and its value at a configuration."""

    name: str
    coefficient: float
    number: float
    function: Callable[[float], float]
    joints: tuple[int, ...]

    def value(self, q: Array) -> float:
        angle = float(sum(q[j] for j in self.joints))
        return self.coefficient * self.number * float(self.function(angle))

    @property
    def text(self) -> str:
        return self.name if self.coefficient == 1.0 else f"{self.coefficient:g}*{self.name}"


class Chain:
    """A planar arm whose links lie along x at zero, its joints turning about -y, by its textbook sums."""

    def __init__(self, n: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.n = n
        self.m, self.l, self.c, self.I = (rng.uniform(0.3, 1.7, size=n).round(4) for _ in range(4))

    def robot(self) -> Robot:
        parts = ['<link name="base"/>']
        for k in range(self.n):
            at = 0.0 if k == 0 else self.l[k - 1]
            parts.append(
                f'<joint name="q{k + 1}" type="revolute"><parent link="{"base" if k == 0 else f"link{k}"}"/>'
                f'<child link="link{k + 1}"/><origin xyz="{at} 0 0"/><axis xyz="0 -1 0"/>'
                '<limit lower="-3" upper="3" effort="99" velocity="9"/></joint>'
                f'<link name="link{k + 1}"><inertial><origin xyz="{self.c[k]} 0 0"/>'
                f'<mass value="{self.m[k]}"/>'
                f'<inertia ixx="1" iyy="{self.I[k]}" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            )
        return Robot.from_xml(f'<robot name="chain">{"".join(parts)}</robot>')

    def lengths(self, k: int, a: int) -> tuple[str, float]:
        """Return name and value of the part of link a on the way to the mass of link k."""
        return (f"c{k + 1}x", self.c[k]) if a == k else (f"l{a + 2}x", self.l[a])

    def inertia(self, i: int, j: int) -> list[Term]:
        """Return the summands of D[i, j]."""
        found: dict[tuple[str, tuple[int, ...]], Term] = {}
        for k in range(max(i, j), self.n):
            found[f"I{k + 1}yy", ()] = Term(f"I{k + 1}yy", 1.0, self.I[k], np.cos, ())
            for a, b in itertools.product(range(i, k + 1), range(j, k + 1)):
                (one, x), (other, y) = self.lengths(k, a), self.lengths(k, b)
                joints = tuple(range(min(a, b) + 1, max(a, b) + 1))
                words = sorted((one, other), key=lambda name: (name[0] != "l", name))
                product = f"{one}**2" if one == other else "*".join(words)
                angle = " + ".join(f"q{joint + 1}" for joint in joints)
                name = f"m{k + 1}*{product}" + (f"*cos({angle})" if joints else "")
                before = found.get((name, joints))
                coefficient = 1.0 if before is None else before.coefficient + 1.0
                found[name, joints] = Term(name, coefficient, self.m[k] * x * y, np.cos, joints)
        return list(found.values())

    def gravity(self, i: int) -> list[Term]:
        """Return the summands of G[i]."""
        found = []
        for k in range(i, self.n):
            for a in range(i, k + 1):
                name, x = self.lengths(k, a)
                joints = tuple(range(a + 1))
                angle = " + ".join(f"q{joint + 1}" for joint in joints)
                found.append(Term(f"m{k + 1}*g*{name}*cos({angle})", 1.0, self.m[k] * G * x, np.cos, joints))
        return found


#: What is done to a term -> by which multiple of it the model is off, and how that is told.
PLANTED = {
    "missing": (-1.0, "missing: {}"),
    "sign": (-2.0, "wrong sign: {}"),
    "half": (-0.5, "half is missing: {}"),
    "twice": (1.0, "twice instead of once: {}"),
}


def difference(report: DynamicsReport, label: str) -> str:
    (found,) = (one for one in report.differences if one.label == label)
    assert found.named
    return found.text


@settings(max_examples=15, deadline=None)
@given(
    n=st.integers(2, 4),
    seed=st.integers(0, 10**6),
    planted=st.sampled_from(sorted(PLANTED)),
    data=st.data(),
)
def test_a_term_of_an_inertia_matrix_is_told_exactly(
    n: int, seed: int, planted: str, data: st.DataObject
) -> None:
    chain = Chain(n, seed)
    i, j = sorted(data.draw(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1))))
    terms = chain.inertia(i, j)
    wrong = data.draw(st.sampled_from(terms))
    share, text = PLANTED[planted]

    def mass_matrix(q: Array) -> Array:
        D = np.array(
            [[sum(t.value(q) for t in chain.inertia(*sorted((r, c)))) for c in range(n)] for r in range(n)]
        )
        D[i, j] += share * wrong.value(q)
        D[j, i] = D[i, j]
        return D

    report = validate({"mass_matrix": mass_matrix}, chain.robot())
    told = difference(report, f"D[{i + 1},{j + 1}]")
    # Where an entry is that one term, all of it is wrong as well.
    assert told == text.format(wrong.text) or (len(terms) == 1 and told == text.format("all of it"))
    assert {one.label for one in report.differences} == {f"D[{i + 1},{j + 1}]"}


@settings(max_examples=10, deadline=None)
@given(
    n=st.integers(1, 4), seed=st.integers(0, 10**6), planted=st.sampled_from(sorted(PLANTED)), data=st.data()
)
def test_a_term_of_gravity_is_told_exactly(n: int, seed: int, planted: str, data: st.DataObject) -> None:
    chain = Chain(n, seed)
    i = data.draw(st.integers(0, n - 1))
    wrong = data.draw(st.sampled_from(chain.gravity(i)))
    share, text = PLANTED[planted]

    def gravity(q: Array) -> Array:
        G = np.array([sum(t.value(q) for t in chain.gravity(r)) for r in range(n)])
        G[i] += share * wrong.value(q)
        return G

    report = validate({"gravity": gravity}, chain.robot())
    assert difference(report, f"G[{i + 1}]") == text.format(wrong.text)
    (cause,) = report.causes
    assert cause.kind != "unknown"


@pytest.mark.parametrize(
    ("torque", "told"),
    [
        (
            lambda h, v: [-h * v[1] ** 2, h * v[0] ** 2],
            {"q̇1 q̇2 in τ1": "missing: -2*m2*l2x*c2x*sin(q2)"},
        ),
        (
            lambda h, v: [-h * (2.0 * v[0] * v[1] - v[1] ** 2), h * v[0] ** 2],
            {"q̇2² in τ1": "wrong sign: -m2*l2x*c2x*sin(q2)"},
        ),
        (
            lambda h, v: [-h * (v[0] * v[1] + v[1] ** 2), h * v[0] ** 2],
            {"q̇1 q̇2 in τ1": "half is missing: -2*m2*l2x*c2x*sin(q2)"},
        ),
        (
            lambda h, v: [-h * (2.0 * v[0] * v[1] + v[1] ** 2), h * v[0] ** 2 + h * v[1] ** 2],
            {"q̇2² in τ2": "too much: m2*l2x*c2x*sin(q2)"},
        ),
    ],
)
def test_a_product_of_velocities_is_told_exactly(
    torque: Callable[[float, Array], list[float]], told: dict[str, str]
) -> None:
    chain = Chain(2, 5)

    def coriolis_torque(q: Array, v: Array) -> Array:
        return np.array(torque(chain.m[1] * chain.l[0] * chain.c[1] * np.sin(q[1]), v))

    report = validate({"coriolis_torque": coriolis_torque}, chain.robot())
    assert {one.label: one.text for one in report.differences} == told


def test_one_number_and_one_angle_for_another_are_told() -> None:
    chain = Chain(2, 9)
    m, c, l1 = chain.m, chain.c, chain.l[0]

    def gravity(q: Array) -> Array:
        far = m[0] * G * c[1] * np.cos(q[0] + q[1])
        near = m[1] * G * c[1] * np.cos(q[0] - q[1])
        return np.array([(m[0] * c[0] + m[1] * l1) * G * np.cos(q[0]) + far, near])

    report = validate({"gravity": gravity}, chain.robot())
    told = {one.label: one.text for one in report.differences}
    assert told["G[1]"] == "m1 replaces m2 in m2*g*c2x*cos(q1 + q2)"
    assert told["G[2]"] == "cos(q1 - q2) replaces cos(q1 + q2) in m2*g*c2x*cos(q1 + q2)"


def test_the_formula_is_the_difference() -> None:
    chain = Chain(3, 11)
    robot = chain.robot()
    wrong = next(t for t in chain.inertia(0, 1) if "cos(q2)" in t.name)

    def mass_matrix(q: Array) -> Array:
        D = robot.mass_matrix(q)
        D[0, 1] = D[1, 0] = D[0, 1] - 1.5 * wrong.value(q)
        return D

    report = validate({"mass_matrix": mass_matrix}, robot)
    (one,) = report.differences
    names = {
        f"{k}{i + 1}{x}": v
        for k, x, vs in (("m", "", chain.m), ("c", "x", chain.c))
        for i, v in enumerate(vs)
    }
    names |= {f"l{i + 2}x": value for i, value in enumerate(chain.l)}
    q = np.array([0.3, -0.8, 1.1])
    space = {**names, "cos": np.cos, "sin": np.sin, **{f"q{i + 1}": x for i, x in enumerate(q)}}
    assert eval(one.formula, space) == pytest.approx(-1.5 * wrong.value(q), rel=1e-5)


@pytest.mark.parametrize(
    ("robot", "lock"), [("ur5", ()), ("panda", ("panda_finger_joint1", "panda_finger_joint2"))]
)
def test_arms_of_six_and_seven_joints_have_a_formula(robot: str, lock: tuple[str, ...]) -> None:
    arm = Robot.load(robot, lock=lock)

    def gravity(q: Array) -> Array:
        G = arm.gravity(q).copy()
        G[1] += 1.3 * np.sin(q[1])
        return G

    report = validate({"gravity": gravity}, arm)
    (one,) = report.differences
    assert one.label == "G[2]"
    assert one.formula == "1.3*sin(q2)"


def test_the_report_has_the_difference_in_every_form() -> None:
    chain = Chain(2, 3)
    robot = chain.robot()

    def mass_matrix(q: Array) -> Array:
        return robot.mass_matrix(q) - np.diag([chain.m[1] * chain.l[0] ** 2, 0.0])

    report = armgpi.validate({"mass_matrix": mass_matrix}, robot)
    text = "missing: m2*l2x**2"
    assert f"D[1,1]: {text}" in str(report)
    assert "l2x = " in str(report)
    assert text in report.markdown()
    assert "m_{2}" in report.latex()
    assert "Difference, model less robot" in report.html()
    (told,) = json.loads(report.to_json())["differences"]
    assert told["text"] == text
    assert told["formula"] == "-m2*l2x**2"
    assert told["latex"]


def test_an_inertia_that_is_neglected_is_no_mistake_and_the_search_goes_on() -> None:
    chain = Chain(2, 21)
    chain.I[1] = 1e-5
    robot = chain.robot()

    def mass_matrix(q: Array) -> Array:
        # The second link a point mass, and the coupling once in D[1,1].
        D = robot.mass_matrix(q) - 1e-5 * np.ones((2, 2))
        D[0, 0] -= chain.m[1] * chain.l[0] * chain.c[1] * np.cos(q[1])
        return D

    report = validate({"mass_matrix": mass_matrix}, robot)
    first, second = report.causes
    assert first.text == "half is missing: 2*m2*l2x*c2x*cos(q2)"
    assert second.kind == "neglected"
    assert "I2yy" in second.text


def test_a_rounded_gravity_is_no_mistake_and_the_search_goes_on() -> None:
    chain = Chain(2, 22)
    robot = chain.robot()

    def gravity(q: Array) -> Array:
        G = robot.gravity(q) * 9.8 / 9.81
        G[1] *= -1.0
        return G

    first, second = validate({"gravity": gravity}, robot).causes
    assert "wrong sign" in first.text
    assert second.kind == "rounded"
    assert "9.8 m/s²" in second.text


def test_inertias_of_links_of_two_digits_and_of_rotors_are_told_apart() -> None:
    names = ["I1xx", "I1xy", "I10xx", "I10yy", "Ir1", "Ir2"]
    summands = [Summand((name,), np.ones((1, 1))) for name in names]
    problem = SimpleNamespace(
        elements=[Element("mass_matrix", "D", (0, 0))],
        tolerance=np.zeros(1),
        user=np.zeros((1, 1)),
        reference=np.ones((1, 1)),
    )
    residual: Any = SimpleNamespace(problem=problem, summands=summands, shown=str)
    groups = dict(_Entry(residual, 0).groups())
    assert groups == {
        "all of it": [0, 1, 2, 3, 4, 5],
        "the inertia of link 1": [0, 1],
        "the inertia of link 10": [2, 3],
    }


def test_explanations_of_parts_are_as_long_together_and_half_a_bit_for_each_more() -> None:
    parts = [Explanation(2.0, "one", "a", (("m1",),)), Explanation(3.0, "two", "-b", (("m2",), ("l1",)))]
    whole = _together([*parts, Explanation(5.0, "three", "c")])
    assert whole == Explanation(11.0, "one; two; three", "a - b + c", (("m1",), ("m2",), ("l1",)))
    assert _together(parts[:1]) == parts[0]
