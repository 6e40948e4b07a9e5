"""Whatever form a model has, it is read alike."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import pytest
import textbooks
from hand_models import planar
from sampling import for_search

from armgpi import Robot, validate
from armgpi.validation import course, models
from armgpi.validation.conventions import propose_map

NUMBERS = planar(1).model

TEXT = """
import numpy as np
m1, m2, l1, lc1, lc2, I1, I2, g = {values}
{head}
def gravity({me}q):
    g2 = m2 * lc2 * g * np.cos(q[0] + q[1])
    return np.array([(m1 * lc1 + m2 * l1) * g * np.cos(q[0]) + g2, g2])
"""

SYMPY = """
from sympy import Matrix, cos, sin, symbols
{symbols}
m1, m2, l1, lc1, lc2, I1, I2, g = symbols("m1 m2 l1 lc1 lc2 I1 I2 g")
d22 = I2 + m2 * lc2**2
d12 = d22 + m2 * l1 * lc2 * cos(q2)
mass_matrix = Matrix([[I1 + m1 * lc1**2 + m2 * l1**2 + 2 * d12 - d22, d12], [d12, d22]])
h = -m2 * l1 * lc2 * sin(q2)
coriolis_torque = Matrix([h * (2 * v1 * v2 + v2**2), -h * v1**2])
g2 = m2 * lc2 * g * cos(q1 + q2)
gravity = Matrix([(m1 * lc1 + m2 * l1) * g * cos(q1) + g2, g2])
parameters = {parameters!r}
"""


def parameters(**wrong: float) -> dict[str, float]:
    closure = NUMBERS["gravity"].__closure__
    assert closure is not None
    names = NUMBERS["gravity"].__code__.co_freevars
    known = dict(zip(names, (cell.cell_contents for cell in closure), strict=True))
    inner = NUMBERS["mass_matrix"]
    assert inner.__closure__ is not None
    known |= dict(zip(inner.__code__.co_freevars, (c.cell_contents for c in inner.__closure__), strict=True))
    return {**known, **wrong}


def values(**wrong: float) -> str:
    p = parameters(**wrong)
    return ", ".join(repr(p[k]) for k in ("m1", "m2", "l1", "lc1", "lc2", "I1", "I2", "g"))


def written(folder: Path, text: str) -> str:
    path = folder / "mine.py"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_functions_of_a_file_and_its_own_numbers(tmp_path: Path) -> None:
    robot = planar(1).robot
    right = written(tmp_path, TEXT.format(values=values(), head="", me=""))
    assert validate(right, robot).agrees
    wrong = written(tmp_path, TEXT.format(values=values(lc2=0.3), head="", me=""))
    (cause,) = validate(wrong, robot).causes
    told = " ".join((cause.text, *cause.alternatives))
    assert "the model's lc2 is 0.3" in told


def test_a_class_in_a_file(tmp_path: Path) -> None:
    text = TEXT.format(values=values(), head="class Arm:", me="self, ").replace("\ndef", "\n  def")
    text = text.replace("\n    g2", "\n      g2").replace("\n    return", "\n      return")
    path = written(tmp_path, text)
    assert validate(path, planar(1).robot).agrees
    assert validate(f"{path}:Arm", planar(1).robot).agrees


def test_a_module_an_instance_and_a_class() -> None:
    robot, model = planar(1)
    module = types.ModuleType("mine")
    vars(module).update(model)
    assert validate(module, robot).agrees
    holder: Any = type("Holder", (), {name: staticmethod(f) for name, f in model.items()})
    assert validate(holder, robot).agrees
    assert validate(holder(), robot).agrees


@pytest.mark.parametrize(
    "symbols",
    [
        for_search('q1, q2, v1, v2 = symbols("q1 q2 v1 v2")'),
        for_search('q1, q2, v1, v2 = symbols("theta_1 theta_2 dq1 dq2", real=True)'),
        'import sympy; t = symbols("t"); q1, q2 = (sympy.Function(f"q{i}")(t) for i in (1, 2))\n'
        "v1, v2 = q1.diff(t), q2.diff(t)",
    ],
    ids=["plain", "greek", "functions of time"],
)
def test_sympy_expressions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, symbols: str) -> None:
    monkeypatch.setattr(course, "TOTAL", 1.0)  # what is named here are values, not sources
    robot = planar(1).robot
    right = written(tmp_path, SYMPY.format(symbols=symbols, parameters=parameters()))
    assert validate(right, robot).agrees
    wrong = written(tmp_path, SYMPY.format(symbols=symbols, parameters=parameters(l1=0.5)))
    (cause,) = validate(wrong, robot).causes
    assert [cause.value, cause.expected] == pytest.approx([0.5, parameters()["l1"]])


@pytest.mark.parametrize("place", ["arm", "arm/__init__.py"])
def test_a_package_is_a_model(place: str, tmp_path: Path) -> None:
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "__init__.py").write_text("from .inside import gravity\n", encoding="utf-8")
    (tmp_path / "arm" / "inside.py").write_text(
        TEXT.format(values=values(), head="", me=""), encoding="utf-8"
    )
    assert validate(tmp_path / place, planar(1).robot).agrees


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("gravity = 9.81\n\ndef G(q):\n    b = 0.15 * gravity * math.cos(q[0] + q[1])", None),
        (
            "import numpy as np\n\ngravity = np.array([0.0, 0.0, -9.81])\n\ndef G(q):\n"
            "    gravity = 9.81\n    b = 0.15 * gravity * math.cos(q[0] + q[1])",
            None,
        ),
        (
            "gravity = [0, 0, -9.81]\n\ndef G(q):\n"
            "    gravity = 9.81\n    b = 0.15 * gravity * math.cos(q[0] + q[1])",
            None,
        ),
        (
            "class Arm:\n    def __init__(self):\n        self.gravity = 9.81\n\n    def g(self, q):\n"
            "        gravity = self.gravity\n        b = 0.15 * gravity * math.cos(q[0] + q[1])",
            {"g": "gravity"},
        ),
        (
            "gravity = 9.81\n\nclass Arm:\n    def G(self, q):\n"
            "        b = 0.15 * gravity * math.cos(q[0] + q[1])",
            None,
        ),
    ],
    ids=("module", "array", "list", "class", "class beside a number"),
)
def test_a_number_called_gravity_is_no_function(
    head: str, names: dict[str, str] | None, tmp_path: Path
) -> None:
    turn, ball = textbooks._turn, textbooks._round
    joints = [turn("0 -1 0", (0, 0, 0), 1.5, (0.2, 0, 0), ball(0.02))]
    joints += [turn("0 -1 0", (0.4, 0, 0), 1.0, (0.15, 0, 0), ball(0.05))]
    robot = Robot.from_xml(textbooks.written("arm", joints))
    path = tmp_path / "arm.py"
    space = " " * (len(head.splitlines()[-1]) - len(head.splitlines()[-1].lstrip()))
    text = f"import math\n\n{head}\n{space}return [(1.5 * 0.2 + 0.4) * gravity * math.cos(q[0]) + b, b]\n"
    path.write_text(text)
    assert validate(path, robot, names=names).agrees
    path.write_text(text.replace("1.5 * 0.2", "1.5 * 0.3"))
    report = validate(path, robot, names=names)
    assert not report.agrees
    assert report.causes


@pytest.mark.parametrize("helper", ["jacobian(link, q)", "forward_kinematics(link, point, q)"])
def test_a_helper_of_a_known_name_that_takes_other_arguments_is_left_alone(
    helper: str, tmp_path: Path
) -> None:
    """A right model is right, whatever its Jacobian of a link is called."""
    path = tmp_path / "model.py"
    path.write_text(f"def {helper}:\n    return q\n\n\ndef gravity(q):\n    return 2.0 * q\n")
    functions = models.resolve(path)
    assert list(functions.calls) == ["gravity"]
    assert functions.uncompared == ()


def test_one_that_takes_a_state_first_is_listed_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text("def jacobian(q, link):\n    return q\n\n\ndef gravity(q):\n    return 2.0 * q\n")
    functions = models.resolve(path)
    assert functions.uncompared == ("jacobian",)
    assert propose_map("jacobian", models.ARGUMENTS) == "takes other arguments than (q)"


def test_one_that_is_the_only_function_is_called_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "model.py"
    path.write_text("def jacobian(link, q):\n    return q\n")
    assert list(models.resolve(path).calls) == ["jacobian"]


def test_modules_that_are_asked_for_leave_the_path_of_imports_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    before = list(sys.path)
    models._import("json")
    for name in ("no_such_module_here", ".relative"):
        with pytest.raises(models.Unusable, match="no such file or module"):
            models._import(name)
    assert sys.path == before
