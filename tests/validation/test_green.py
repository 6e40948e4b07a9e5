"""No silent green: what was not compared is told, and what cannot be compared is refused."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi.errors import ArmgpiWarning, ModelError, ParameterError
from armgpi.paper.arm import PaperArm
from armgpi.testing import assert_dynamics

ROBOT = "anthropomorphic3"
ARM = PaperArm()


def gravity(q: np.ndarray) -> np.ndarray:
    return ARM.gravity(q)


def wrong(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 3.0 * v


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "arm.py"
    path.write_text(
        "from armgpi.paper.arm import PaperArm\n"
        "arm = PaperArm()\n"
        "def gravity(q):\n    return arm.gravity(helper(q))\n"
        "def helper(q):\n    return q\n"
        "def h(q, v):\n    return 3.0 * v\n",
        encoding="utf-8",
    )
    return path


def test_a_mapped_name_that_the_model_lacks_is_an_error(file: Path) -> None:
    for model in (file, {"gravity": gravity, "h": wrong}):
        with pytest.raises(ModelError, match=r"no function 'hh', .*coriolis_torque; is 'h' meant\?"):
            armgpi.validate(model, ROBOT, names={"hh": "coriolis_torque"})


def test_a_function_that_two_names_are_mapped_to_is_an_error(file: Path) -> None:
    with pytest.raises(ParameterError, match="one function for gravity"):
        armgpi.validate(file, ROBOT, names={"h": "gravity", "helper": "gravity"})
    with pytest.raises(ModelError, match="has a function gravity, and 'helper' is mapped"):
        armgpi.validate(file, ROBOT, names={"helper": "gravity"})


def test_a_mapped_function_is_compared(file: Path) -> None:
    report = armgpi.validate(file, ROBOT, names={"h": "coriolis_torque"})
    assert not report.function("coriolis_torque").agrees
    assert report.uncompared == ()


def test_functions_that_are_not_compared_are_listed(file: Path) -> None:
    report = armgpi.validate(file, ROBOT)
    assert report.agrees
    assert report.uncompared == ("h",)
    assert "NOT COMPARED" in str(report)
    assert report.verdict().startswith("INCOMPLETE: 1 of 2 functions was compared")
    with pytest.warns(ArmgpiWarning, match="not compared: h"):
        assert_dynamics(file, ROBOT)


def test_what_is_required_has_to_be_compared() -> None:
    model = {"gravity": gravity}
    assert_dynamics(model, ROBOT, require=["gravity"])
    with pytest.raises(AssertionError, match="not compared: mass_matrix; compared: gravity"):
        assert_dynamics(model, ROBOT, require=["gravity", "mass_matrix"])
    with pytest.raises(ParameterError, match="require"):
        assert_dynamics(model, ROBOT, require=["masses"])


def changing() -> Callable[[np.ndarray], Any]:
    calls = itertools.count()
    return lambda q: np.zeros(3) + (next(calls) > 20)


@pytest.mark.parametrize(
    ("model", "text"),
    [
        ({}, "has none of the functions mass_matrix, "),
        ({"h": wrong}, "has none of the functions mass_matrix, "),
        ({"gravity": changing()}, "gravity: is not deterministic: two calls at the same state differ by 1"),
    ],
)
def test_what_cannot_be_compared_ends_in_one_line(model: Any, text: str) -> None:
    with pytest.raises(ModelError) as error:
        armgpi.validate(model, ROBOT)
    assert text in str(error.value)
    assert "\n" not in str(error.value)
