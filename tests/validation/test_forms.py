"""Right models in other forms are right, and the form is said: columns, transposes, the rows of a base."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import byhand
import numpy as np
import pytest

from armgpi import Robot, validate
from armgpi.validation.tree import evaluate, from_robot

ARM = Robot.load("anthropomorphic3")
TREE = from_robot(ARM)


def kinematics(q: np.ndarray, quantity: str) -> np.ndarray:
    return np.asarray(evaluate(TREE, q[np.newaxis], [quantity])[quantity][0])


def with_base(D: np.ndarray) -> np.ndarray:
    whole = 7.0 * np.eye(9)
    whole[6:, 6:] = D
    whole[0, 7] = whole[7, 0] = 0.3
    return whole


def of_columns(q: np.ndarray) -> Any:
    return ARM.gravity(np.array([q[0, 0], q[1, 0], q[2, 0]])).reshape(3, 1)


def pose(q: np.ndarray) -> np.ndarray:
    turned = np.eye(4)
    turned[3, :3] = kinematics(q, "F")
    return turned


@pytest.mark.parametrize(
    ("name", "function", "said"),
    [
        ("gravity", of_columns, "takes columns of shape (n, 1)"),
        ("jacobian", lambda q: kinematics(q, "J").T, "returns the transpose"),
        ("jacobian", lambda q: kinematics(q, "J")[:3].T, "returns the transpose"),
        ("jacobian", lambda q: np.roll(kinematics(q, "J"), 3, axis=0), "first three rows are angular"),
        ("forward_kinematics", pose, "returns the transpose"),
    ],
)
def test_a_right_model_in_another_form_agrees(name: str, function: Callable[..., Any], said: str) -> None:
    report = validate({name: function}, ARM)
    assert report.agrees
    assert report.judge().exit_code == 0
    assert sum(said in note for note in report.notes) == 1


def test_the_rows_of_a_base_are_not_compared_and_the_verdict_is_not_green() -> None:
    model = {
        "mass_matrix": lambda q: with_base(ARM.mass_matrix(q)),
        "gravity": lambda q: np.r_[np.ones(6), ARM.gravity(q)],
    }
    report = validate(model, ARM)
    assert report.agrees
    assert report.judge().exit_code == 3
    assert "the first 6 rows of gravity" in report.verdict()
    assert list(report.to_dict()["left_out"]) == list(report.left_out)
    wrong = model | {"gravity": lambda q: np.r_[np.ones(6), -ARM.gravity(q)]}
    report = validate(wrong, ARM)
    assert report.judge().exit_code == 1
    assert report.causes[0].text == "the sign of gravity"


def test_a_mistake_is_named_in_another_form() -> None:
    report = validate({"gravity": lambda q: -of_columns(q)}, ARM)
    assert not report.agrees
    assert report.causes[0].text == "the sign of gravity"


def test_a_report_that_differs_by_laws_alone_has_a_diagnosis() -> None:
    def mass_matrix(q: np.ndarray) -> np.ndarray:
        D = ARM.mass_matrix(q)
        D[0, 1] += 0.1
        return D

    report = validate({"mass_matrix": mass_matrix}, joints=3)
    assert not report.agrees
    assert "D symmetric fails: D[1,2] = 0.1, but D[2,1] = 0" in report.causes[0].text
    assert "What is wrong" in str(report)


def test_a_model_without_any_torque_is_compared_with_none() -> None:
    zero = np.zeros(3)
    report = validate({"forward_dynamics": lambda q, v, tau: ARM.forward_dynamics(q, v, zero)}, ARM)
    assert report.agrees
    assert any("it has no torque at all" in note for note in report.notes)
    # Whoever has motors was not told that their torques do the right thing.
    assert report.judge().exit_code == 3
    assert "reads none of them" in report.judge().line


def test_a_mistake_in_a_model_with_a_passive_joint_is_named_at_its_line(tmp_path: Path) -> None:
    right = byhand.source("swingup")
    place = tmp_path / "swingup.py"
    place.write_text(right.replace("phi2 = m2 * lc2 * g", "phi2 = m2 * l1 * g"))
    report = validate(place, byhand.robot("swingup"))
    assert [one.function for one in report.functions] == ["forward_dynamics"]
    assert set(report.functions[0].differing) <= {"q̈1", "q̈2"}
    cause = report.causes[0]
    assert cause.line == 35
    assert "l1 should be lc2" in cause.text
