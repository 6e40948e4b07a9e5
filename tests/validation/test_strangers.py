"""Models as people write them: Coriolis terms by differences of D, a class with its numbers as defaults."""

from __future__ import annotations

from pathlib import Path

import pytest

from armgpi import Robot, validate
from armgpi.errors import ModelError
from armgpi.validation import edits

URDF = """
<robot name="scara">
  <link name="base"/>
  <link name="l1"><inertial><origin xyz="0.11 0 0.02"/><mass value="3.1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.035"/></inertial></link>
  <link name="l2"><inertial><origin xyz="0.09 0.01 0"/><mass value="2.2"/>
    <inertia ixx="0.008" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.021"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
    <limit lower="-2.5" upper="2.5" velocity="4" effort="60"/></joint>
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.25 0 0.05"/>
    <axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" velocity="4" effort="30"/></joint>
</robot>
"""
MODEL = """
import numpy as np
m1, m2 = 3.1, 2.2
a1, c1, x2, y2 = 0.25, 0.11, 0.09, 0.01
I1, I2 = 0.035, 0.021

def jacobians(q):
    t1, t2 = q[0], q[0] + q[1]
    e = lambda t: np.array([np.cos(t), np.sin(t)])
    n = lambda t: np.array([-np.sin(t), np.cos(t)])
    b = x2 * n(t2) - y2 * e(t2)
    return np.column_stack([c1 * n(t1), 0 * b]), np.column_stack([a1 * n(t1) + b, b])

def inertia_matrix(q):
    J1, J2 = jacobians(q)
    first, both = np.array([1.0, 0.0]), np.array([1.0, 1.0])
    return m1 * J1.T @ J1 + I1 * np.outer(first, first) + m2 * J2.T @ J2 + I2 * np.outer(both, both)

def coriolis(q, qd):
    h = 1e-6
    dM = [(inertia_matrix(q + h * e) - inertia_matrix(q - h * e)) / (2 * h) for e in np.eye(2)]
    C = np.zeros((2, 2))
    for i in range(2):
        for j in range(2):
            for k in range(2):
                C[i, j] += 0.5 * (dM[k][i, j] + dM[j][i, k] - dM[i][j, k]) * qd[k]
    return C
"""
PENDULUM_URDF = """
<robot name="pendulum">
  <link name="base"/>
  <link name="a"><inertial><origin xyz="0 0 -0.21"/><mass value="1.7"/>
    <inertia ixx="0.024" ixy="0" ixz="0" iyy="0.026" iyz="0" izz="0.003"/></inertial></link>
  <link name="b"><inertial><origin xyz="0 0 -0.16"/><mass value="1.1"/>
    <inertia ixx="0.011" ixy="0" ixz="0" iyy="0.012" iyz="0" izz="0.002"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 -1 0"/>
    <limit lower="-3" upper="3" velocity="5" effort="30"/></joint>
  <joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 -0.4"/>
    <axis xyz="0 -1 0"/><limit lower="-3" upper="3" velocity="5" effort="15"/></joint>
</robot>
"""
PENDULUM = """
from math import cos, sin

class Pendulum:
    def __init__(self, m1=1.7, m2=1.1, l1=0.4, lc1=0.21, lc2=0.16, I1=0.026, I2=0.012, g=9.81):
        self.m1, self.m2, self.l1, self.lc1, self.lc2 = m1, m2, l1, lc1, lc2
        self.I1, self.I2, self.g = I1, I2, g

    def M(self, q):
        a = self.I1 + self.I2 + self.m1 * self.lc1**2 + self.m2 * (self.l1**2 + self.lc2**2)
        b = self.m2 * self.l1 * self.lc2 * cos(q[1])
        d = self.I2 + self.m2 * self.lc2**2
        return [[a + 2 * b, d + b], [d + b, d]]

    def C(self, q, qd):
        h = self.m2 * self.l1 * self.lc2 * sin(q[1])
        return [-h * (2 * qd[0] * qd[1] + qd[1] ** 2), h * qd[0] ** 2]

    def G(self, q):
        tip = self.m2 * self.lc2 * self.g * sin(q[0] + q[1])
        return [(self.m1 * self.lc1 + self.m2 * self.l1) * self.g * sin(q[0]) + tip, tip]
"""


@pytest.fixture(scope="module")
def scara() -> Robot:
    return Robot.from_xml(URDF)


@pytest.mark.parametrize(("ends", "name"), [("C", "coriolis_matrix"), ("C @ qd", "coriolis_torque")])
def test_what_is_called_coriolis_is_compared_as_what_it_gives(
    ends: str, name: str, scara: Robot, tmp_path: Path
) -> None:
    place = tmp_path / "model.py"
    place.write_text(MODEL.replace("return C\n", f"return {ends}\n"))
    report = validate(place, scara)
    assert report.agrees
    assert not report.uncompared
    assert {one.function for one in report.functions} == {"mass_matrix", name}


def test_a_torque_under_the_full_name_of_the_matrix_is_refused(scara: Robot, tmp_path: Path) -> None:
    place = tmp_path / "model.py"
    torque = MODEL.replace("return C\n", "return C @ qd\n")
    for name, names in (
        ("coriolis_matrix", {}),
        ("h", {"h": "coriolis_matrix"}),
        ("C", {"C": "coriolis_matrix"}),
    ):
        place.write_text(torque.replace("def coriolis(", f"def {name}("))
        with pytest.raises(ModelError, match="shape"):
            validate(place, scara, names=names)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("+= 0.5 * (dM", "+= (dM"),
        ("- dM[i][j, k])", "+ dM[i][j, k])"),
        ("a1 * n(t1) + b, b])", "a1 * n(t1) - b, b])"),
    ],
)
def test_a_mistake_is_named_beside_differences(right: str, wrong: str, scara: Robot, tmp_path: Path) -> None:
    place = tmp_path / "model.py"
    place.write_text(MODEL.replace(right, wrong))
    report = validate(place, scara)
    assert report.causes[0].line == next(i for i, text in enumerate(MODEL.splitlines(), 1) if right in text)
    assert report.causes[0].confirmed


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("(self.l1**2 + self.lc2**2)", "(self.l1 + self.lc2) ** 2"),
        ("2 * qd[0] * qd[1] + qd[1] ** 2", "qd[0] * qd[1] + qd[1] ** 2"),
        ("self.m2 * self.l1) * self.g", "self.m2 * self.lc1) * self.g"),
    ],
)
def test_numbers_may_be_defaults_of_a_class(right: str, wrong: str, tmp_path: Path) -> None:
    robot, place = Robot.from_xml(PENDULUM_URDF), tmp_path / "pendulum.py"
    place.write_text(PENDULUM)
    assert validate(place, robot).agrees
    place.write_text(PENDULUM.replace(right, wrong))
    cause = validate(place, robot).causes[0]
    assert cause.line == next(i for i, text in enumerate(PENDULUM.splitlines(), 1) if right in text)
    assert cause.confirmed


FLAT = """
from math import cos, sin
import numpy as np
N = 2
m1, m2, a1, c1, c2, I1, I2 = 3.1, 2.2, 0.25, 0.11, 0.0906, 0.035, 0.021

class Pair:
    def __init__(self, x, y):
        self.x, self.y = x, y
    def __add__(self, other):
        return Pair(self.x + other.x, self.y + other.y)
    def __mul__(self, other):
        return self.x * other.x + self.y * other.y

def ahead(length, angle):
    return Pair(length * cos(angle), length * sin(angle))

def fill(q, out):
    k = I2 + m2 * c2 * c2 + m2 * (ahead(a1, q[0]) * ahead(c2, q[0] + q[1]))
    out[0 * N + 0] = I1 + m1 * c1 * c1 + m2 * a1 * a1
    out[0 * N + 0] += 2.0 * k - (I2 + m2 * c2 * c2)
    out[0 * N + 1] = k
    out[1 * N + 0] = out[0 * N + 1]
    out[1 * N + 1] = I2 + m2 * c2 * c2

def mass_matrix(q):
    work = np.zeros(N * N)
    fill(q, work)
    return work.reshape(N, N)
"""


@pytest.mark.parametrize(
    ("right", "wrong", "belongs"),
    [
        ("out[0 * N + 0] += 2.0 * k", "out[0 * N + 0] = 2.0 * k", "= should be +="),
        ("out[0 * N + 1] = k", "out[1 * N + 1] = k", "out[1 * N + 1] should be out[0 * N + 1]"),
        ("m1 * c1 * c1", "m1 * c1 * a1", "a1 should be c1"),
        ("length * sin(angle))", "length * cos(angle))", "cos(angle) should be sin(angle)"),
    ],
)
def test_helpers_that_write_into_an_argument_and_operators_of_own_classes_are_searched(
    right: str, wrong: str, belongs: str, tmp_path: Path
) -> None:
    assert FLAT.count(right) == 1
    robot = Robot.from_xml(URDF.replace("0.09 0.01 0", "0.0906 0 0"))
    (tmp_path / "flat.py").write_text(FLAT)
    assert validate(tmp_path / "flat.py", robot).agrees
    (tmp_path / "wrong.py").write_text(FLAT.replace(right, wrong))
    report = validate(tmp_path / "wrong.py", robot)
    assert belongs in report.causes[0].text


TEXTS = """
from math import cos
import numpy as np

p = {"m1": 3.1, "m2": 2.2, "a1": 0.25, "c1": 0.11, "c2": 0.0906, "I1": 0.035, "I2": 0.021}
table = {"h": "m2 * a1 * c2 * cos(q2)", "k": "I2 + m2 * c2**2", "f": "I1 + m1 * c1**2 + m2 * a1**2"}


def mass_matrix(q):
    names = {**p, "cos": cos, "q2": q[1]}
    h, k, f = (eval(table[name], names) for name in ("h", "k", "f"))
    return np.array([[f + k + 2 * h, k + h], [k + h, k]])
"""


@pytest.mark.parametrize(
    ("right", "wrong", "text"),
    [
        ("m1 * c1**2", "m1 * a1**2", "line 6: a1 should be c1"),
        ("I2 + m2 * c2**2", "m2 * c2**2", "line 6: m2 * c2**2 should be m2 * c2 ** 2 +"),
    ],
)
def test_formulas_that_are_texts_are_searched(right: str, wrong: str, text: str, tmp_path: Path) -> None:
    robot = Robot.from_xml(URDF.replace("0.09 0.01 0", "0.0906 0 0"))
    (tmp_path / "texts.py").write_text(TEXTS.replace(right, wrong))
    cause = validate(tmp_path / "texts.py", robot).causes[0]
    assert text in cause.text
    assert cause.confirmed


def test_a_source_that_computes_a_text_which_opens_something_is_not_changed() -> None:
    assert edits.harmless(TEXTS)
    for text in ("__import__('os').remove('x')", "open('x', 'w')", "a.tofile('x')", "eval('1')"):
        assert not edits.harmless(f'{TEXTS}\nother = {{"t": {text!r}}}\n')
