"""Causes of mistakes that textbook models of other arms have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hand_models import _draw, planar, scara, spatial

from armgpi import Robot, suggest_urdf, validate
from armgpi.validation.tree import evaluate, from_robot

Array = np.ndarray


def causes(model: object, robot: Robot) -> str:
    report = validate(model, robot)
    assert not report.agrees
    return " | ".join(" ".join((cause.text, *cause.alternatives)) for cause in report.causes)


def first(model: object, robot: Robot) -> str:
    return validate(model, robot).causes[0].text


def test_symbols_may_count_from_zero(tmp_path: object) -> None:
    robot, right = planar(1)
    q = [0.3, -0.7]
    import sympy

    q0, q1 = sympy.symbols("q0 q1")
    # Two unknowns: the weights of cos q0 and of cos(q0 + q1).
    two = right["gravity"](q)[1] / np.cos(q[0] + q[1])
    one = (right["gravity"](q)[0] - right["gravity"](q)[1]) / np.cos(q[0])
    far = two * sympy.cos(q0 + q1)
    assert validate({"gravity": sympy.Matrix([one * sympy.cos(q0) + far, far])}, robot).agrees


# Units.


def test_a_mass_in_grams_is_named() -> None:
    robot, model = scara(1)
    mass = model["mass_matrix"](np.zeros(3))[2, 2]
    grams = {**model, "mass_matrix": lambda q: model["mass_matrix"](q) + np.diag([0, 0, 999.0 * mass])}
    assert "g for kg" in first(grams, robot)


# Formulas that are wrong in one function alone.


def test_a_link_that_gravity_forgets_is_named() -> None:
    lift, right = scara(1)
    half = {"gravity": lambda q: 0.37 * right["gravity"](q)}
    # No one takes 3.63 m/s² for gravity; the mass of the quill may be wrong as well.
    told = causes(half, lift)
    assert "strength of gravity" in told
    assert "mass of link 3" in told


def test_a_term_that_is_halved_everywhere_is_named() -> None:
    robot, model = planar(1)
    elbow = model["mass_matrix"](np.zeros(2))[0, 1] - model["mass_matrix"](np.zeros(2))[1, 1]

    def mass_matrix(q: Array) -> Array:
        c = 0.5 * elbow * np.cos(q[1])
        return model["mass_matrix"](q) - np.array([[2.0 * c, c], [c, 0.0]])

    assert (
        first({**model, "mass_matrix": mass_matrix}, robot)
        == "a factor 2 is missing in the terms m l lc of link 2"
    )


def test_a_square_of_a_sine_is_told_from_a_sine() -> None:
    robot, model = planar(1)
    wrong = {
        "mass_matrix": lambda q: (
            model["mass_matrix"](q) + np.diag([0.3 * (np.sin(q[1]) - np.sin(q[1]) ** 2), 0])
        )
    }
    assert first(wrong, robot) == "sin q2 replaces sin² q2 (times 0.3)"


def test_a_number_that_is_right_is_not_blamed() -> None:
    robot, model = planar(1)
    p = dict(zip(("m1", "m2", "l1", "lc1", "lc2", "I1", "I2", "g"), _numbers(), strict=True))
    m2, l1 = p["m2"], p["l1"]

    def mass_matrix(q: Array) -> Array:
        return model["mass_matrix"](q) - np.diag([m2 * l1**2, 0.0])

    told = first({"mass_matrix": mass_matrix, "parameters": p}, robot)
    assert told == "missing: m2*l2x**2"


def test_different_causes_for_neighbouring_entries_are_told_entry_by_entry() -> None:
    robot, model = spatial(1)

    def mass_matrix(q: Array) -> Array:
        D = model["mass_matrix"](q)
        return D + np.array(
            [[D[0, 0], 0.0, 0.0], [0.0, -2.0 * D[1, 1], -0.5 * D[1, 2]], [0.0, -0.5 * D[1, 2], 0.0]]
        )

    (cause,) = validate({**model, "mass_matrix": mass_matrix}, robot).causes
    assert cause.kind == "summand"
    assert cause.text == (
        "D[1,1]: twice instead of once: all of it | D[2,2]: wrong sign: all of it | "
        "D[2,3]: half is missing: all of it"
    )
    assert len(cause.alternatives) == 3
    assert cause.evidence


def test_rotor_inertias_that_are_missing_are_named() -> None:
    robot, model = planar(1)
    assert first(model, robot.with_armature(0.1)) == "the rotor inertias are missing"


def test_a_negative_inertia_is_not_named() -> None:
    robot, model = planar(1)
    I1 = _numbers()[5]
    wrong = {**model, "mass_matrix": lambda q: model["mass_matrix"](q) - np.diag([3.3 * I1, 0.0])}
    (cause,) = validate(wrong, robot).causes
    assert cause.kind == "unknown"
    assert any("inertia" in text and " -" in text for text in cause.alternatives)
    assert cause.evidence


def _numbers() -> list[float]:

    m, lengths, lc, moments = _draw(1, 2)
    return [*m, lengths[0], *lc, moments[0][1], moments[1][1], 9.81]


def test_large_arms_that_slide_and_turn_give_no_false_alarm() -> None:
    mass, length, g = 2e3, 8.0, 9.81
    robot = Robot.from_xml(
        '<robot name="crane"><link name="base"/>'
        '<link name="cart"><inertial><mass value="3e3"/>'
        '<inertia ixx="1e3" iyy="1e3" izz="1e3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="q1" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>'
        '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        f'<link name="boom"><inertial><origin xyz="{length} 0 0"/><mass value="{mass}"/>'
        '<inertia ixx="9e3" iyy="9e3" izz="9e3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="q2" type="revolute"><parent link="cart"/><child link="boom"/><axis xyz="0 -1 0"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    )

    def forward_dynamics(q: Array, v: Array, tau: Array) -> Array:
        c, s = np.cos(q[1]), np.sin(q[1])
        k = mass * length
        D = np.array([[3e3 + mass, -k * s], [-k * s, 9e3 + k * length]])
        return np.linalg.solve(D, tau - np.array([-k * c * v[1] ** 2, k * g * c]))

    assert validate({"forward_dynamics": forward_dynamics}, robot).agrees


# Arithmetic with few digits.


def _ten_digits(function: Callable[..., Array]) -> Callable[..., Array]:
    def rounded(*state: Array) -> Array:
        value = np.asarray(function(*state))
        return np.reshape([float(f"{x:.10g}") for x in value.ravel()], value.shape)

    return rounded


def test_a_model_of_ten_digits_agrees_and_its_digits_are_noted() -> None:
    robot, model = spatial(1)
    report = validate({name: _ten_digits(function) for name, function in model.items()}, robot)
    assert report.agrees
    assert all(law.verdict in ("holds", "note") for law in report.laws)
    assert any("is only computed to" in note for note in report.notes)


def test_a_mistake_is_not_taken_for_few_digits() -> None:
    robot, model = planar(1)
    stepped = {"gravity": lambda q: model["gravity"](np.round(q, 4))}
    assert not validate(stepped, robot).agrees


def test_a_law_of_all_but_vanishing_torques_is_not_said_to_fail() -> None:
    model = planar(1).model
    D = model["mass_matrix"](np.zeros(2))

    def mass_matrix(q: Array) -> Array:
        return D + 1e-11 * np.cos(q[1]) * np.eye(2)[0] * np.eye(2)[:, :1]

    def coriolis_matrix(q: Array, v: Array) -> Array:
        k = 0.5e-11 * np.sin(q[1])
        return np.array([[-k * v[1], -k * v[0]], [k * v[0], 0.0]])

    laws = validate({"mass_matrix": mass_matrix, "coriolis_matrix": coriolis_matrix}).laws
    assert {law.verdict for law in laws} == {"holds"}


def _cart() -> dict[str, Callable[..., Array]]:
    """Return a pendulum on a cart, its potential energy in place of gravity's torque."""
    return {
        "mass_matrix": lambda q: np.array([[2.0, 0.3 * np.cos(q[1])], [0.3 * np.cos(q[1]), 0.2]]),
        "potential_energy": lambda q: -0.3 * 9.81 * np.cos(q[1]),
    }


def test_a_urdf_is_suggested_for_a_cart_from_its_potential_energy() -> None:
    # Both functions take longer arrays too: the shape of D tells that there are two joints.
    suggestion = suggest_urdf(_cart())
    assert suggestion.rest < 1e-6
    assert validate(_cart(), Robot.from_xml(suggestion.urdf), rtol=1e-6).agrees


def test_another_parameter_set_is_named_and_a_wrong_formula_is_none() -> None:
    robot = Robot.load("anthropomorphic3")
    tree = from_robot(robot)
    draw = np.random.default_rng(7).uniform(0.8, 1.2, size=(3, 3))
    for i, (m, c, inertia) in enumerate(draw):
        body = tree.bodies[i]
        tree = tree.with_body(i, mass=m * body.mass, com=c * body.com, inertia=inertia * body.inertia)

    def of(quantity: str) -> Callable[[Array], Array]:
        return lambda q: np.asarray(evaluate(tree, q[np.newaxis], [quantity])[quantity][0])

    model = {"mass_matrix": of("D"), "gravity": of("G")}
    text = causes(model, robot)
    assert "another parameter set" in text
    assert "--suggest-urdf" in text
    signs = np.array([1.0, 1.0, -1.0])
    wrong = {**model, "gravity": lambda q: signs * model["gravity"](q)}
    assert "another parameter set" not in causes(wrong, robot)


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (-1.0, "the sign of all of the Coriolis torque"),
        (2.0, "a factor 1/2 is missing in all of the Coriolis torque"),
    ],
)
@pytest.mark.parametrize("name", ["forward_dynamics", "inverse_dynamics"])
def test_a_wrong_coriolis_torque_in_one_function_is_none_of_the_arm(
    tmp_path: Path, name: str, factor: float, cause: str
) -> None:
    """The three functions beside it agree, so that the sign of q2, say, cannot be what is wrong."""
    robot = tmp_path / "two.urdf"
    robot.write_text(_TWO, encoding="utf-8")

    def mass_matrix(q: Array) -> Array:
        k = 0.4 * 0.2 * np.cos(q[1])
        return np.array([[0.3 + 2.0 * k, 0.06 + k], [0.06 + k, 0.06]])

    def coriolis_torque(q: Array, v: Array) -> Array:
        h = 0.4 * 0.2 * np.sin(q[1])
        return np.array([-h * (2.0 * v[0] * v[1] + v[1] ** 2), h * v[0] ** 2])

    def gravity(q: Array) -> Array:
        far = 0.2 * 9.81 * np.cos(q[0] + q[1])
        return -np.array([(1.5 * 0.2 + 0.4) * 9.81 * np.cos(q[0]) + far, far])

    def inverse_dynamics(q: Array, v: Array, a: Array) -> Array:
        return np.asarray(mass_matrix(q) @ a + factor * coriolis_torque(q, v) + gravity(q))

    def forward_dynamics(q: Array, v: Array, tau: Array) -> Array:
        return np.asarray(np.linalg.solve(mass_matrix(q), tau - factor * coriolis_torque(q, v) - gravity(q)))

    dynamics: Any = {"inverse_dynamics": inverse_dynamics, "forward_dynamics": forward_dynamics}[name]
    model = {"mass_matrix": mass_matrix, "coriolis_torque": coriolis_torque, "gravity": gravity}
    report = validate({**model, name: dynamics}, robot)
    assert [one.function for one in report.functions if not one.agrees] == [name]
    assert [one.text for one in report.causes] == [cause]
    assert not any("q2" in text for text in report.causes[0].alternatives)


_TWO = """<robot name="two">
<link name="base"/>
<link name="one"><inertial><origin xyz="0.2 0 0"/><mass value="1.5"/>
<inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="two"><inertial><origin xyz="0.2 0 0"/><mass value="1.0"/>
<inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="continuous"><parent link="base"/><child link="one"/><axis xyz="0 1 0"/></joint>
<joint name="j2" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0.4 0 0"/>
<axis xyz="0 1 0"/></joint>
</robot>
"""
