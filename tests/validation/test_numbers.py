"""Names are confirmed, and agreement is green, only where every number was varied; usual causes are known."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import textbooks

from armgpi import Robot, validate
from armgpi.base.arrays import Array
from armgpi.validation import units
from armgpi.validation.proofs import is_read

_LINK = (
    '<link name="{name}"><inertial><origin xyz="{c} 0 0"/><mass value="{m}"/>'
    '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
_JOINT = (
    '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{at} 0 0"/><axis xyz="0 -1 0"/>'
    '<limit lower="-3" upper="3" effort="80" velocity="9"/></joint>'
)


def _arm(folder: Path, m: Array, c: Array, i: Array, length: float) -> Robot:
    """Return a planar arm of two links that lies level at zero."""
    parts = [_LINK.format(name=f"part{k + 1}", c=c[k], m=m[k], i=i[k]) for k in range(2)]
    parts += [
        _JOINT.format(name="first", parent="base", child="part1", at=0.0),
        _JOINT.format(name="second", parent="part1", child="part2", at=length),
    ]
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="pair"><link name="base"/>{"".join(parts)}</robot>', encoding="utf-8")
    return Robot.load(path)


def _file(folder: Path, text: str) -> Path:
    path = folder / "model.py"
    path.write_text("import numpy as np\n" + text, encoding="utf-8")
    return path


_TWOS = """
m1, m2 = 2.0, 2.0
l1 = l2 = 2.0
J1, J2 = np.full(2, 2.0)
g = 9.81

def mass_matrix(q):
    c = np.cos(q[1])
    d = J2 + m2 * (l2**2 + l1 * l2 * c)
    a = J1 + m1 * l1**2 + J2 + m2 * (l1**2 + l2**2 + 2 * l1 * l2 * c)
    return np.array([[a, d], [d, J2 + m2 * l2**2]])

def gravity(q):
    b = m2 * g * l2 * np.cos(q[0] + q[1])
    return np.array([(m1 + m2) * g * l1 * np.cos(q[0]) + b, b])
"""


@pytest.mark.parametrize(
    ("old", "new", "odd"),
    [
        ("", "", ()),
        ("g * l1", "g * l2", ("l1",)),
        ("2 * l1 * l2 * c", "2 * l1 * l1 * c", ("l1", "l2")),
    ],
)
def test_round_numbers_hide_no_mistake(old: str, new: str, odd: tuple[str, ...], tmp_path: Path) -> None:
    twos = np.full(2, 2.0)
    report = validate(_file(tmp_path, _TWOS.replace(old, new)), _arm(tmp_path, twos, twos, twos, 2.0))
    assert all(one.agrees for one in report.functions)
    assert bool(report.numbers_only) == bool(odd)
    assert {*odd} & {*report.numbers_only} or not odd
    assert report.agrees == (not odd)
    assert ("for these numbers only" in report.verdict()) == bool(odd)


def test_what_round_numbers_hide_is_named_at_its_lines(tmp_path: Path) -> None:
    one = _TWOS.replace("g * l1", "g * l2")
    # 2 (... + J2) - J2 is right for a mass of 2 alone.
    two = one.replace("d = J2 + m2 * (l2**2 + l1 * l2 * c)", "d = m2 * (l2**2 + l1 * l2 * c + J2) - J2")
    twos = np.full(2, 2.0)
    arm = _arm(tmp_path, twos, twos, twos, 2.0)
    for text, lines in ((one, {16}), (two, {10, 16})):
        report = validate(_file(tmp_path, text), arm)
        assert all(one.agrees for one in report.functions)
        assert not report.agrees
        assert {cause.line for cause in report.causes} == lines
        assert "l2 should be l1" in report.causes[0].text
        assert not any(cause.confirmed for cause in report.causes)


_RODS = """
m = np.array([1.7, 1.1])
a1 = 0.62
a2 = 0.44
J1 = m[0] * a1**2 / 12
J2 = m[1] * a2**2 / 12

def mass_matrix(q):
    k = m[1] * a1 * a2 / 2 * np.cos(q[1])
    d22 = J2 + m[1] * a2**2 / 4
    d12 = d22 + k
    return np.array([[J1 + m[0] * a1**2 / 4 + m[1] * a1**2 + d22 + 2 * k, d12], [d12, d22]])
"""


_DATACLASS = """
from dataclasses import dataclass

@dataclass
class Numbers:
    m1: float = 1.5
    m2: float = 1.0
    l1: float = 0.4
    c1: float = 0.2
    c2: float = 0.17
    J1: float = 0.02
    J2: float = 0.02

p = Numbers()

def mass_matrix(q):
    h = p.m2 * p.l1 * p.c2 * np.cos(q[1])
    d22 = p.m2 * p.c2**2 + p.J2
    d11 = p.m1 * p.c1**2 + p.J1 + p.m2 * p.l1**2 + d22 + 2 * h
    return np.array([[d11, d22 + h], [d22 + h, d22]])
"""


def test_a_wrong_default_is_mended_at_its_line_where_another_is_as_large(tmp_path: Path) -> None:
    # The other link's name in this one's place would make all agree as well.
    arm = _arm(tmp_path, np.array([1.5, 1.0]), np.array([0.2, 0.17]), np.full(2, 0.02), 0.4)
    right = validate(_file(tmp_path, _DATACLASS), arm)
    assert right.agrees
    wrong = validate(_file(tmp_path, _DATACLASS.replace("J2: float = 0.02", "J2: float = 0.002")), arm)
    assert not wrong.agrees
    assert wrong.repaired is not None
    assert wrong.repaired.endswith(_DATACLASS)
    assert "0.002 kg m² in the model, 0.02 kg m² in the robot" in str(wrong)


@pytest.mark.parametrize(
    ("expression", "source", "expected"),
    [
        ("p.J2", "a = p.J2", True),
        ("p.J2", "class A:\n    J2 = 1\n    def f(self):\n        return self.J2", True),
        ("p.J2", "p.J2 = 1", False),
        ("J2", "J2 = 1\nJ1 = 2\nx = J1", False),
        ("J[1]", "x = J[0]", False),
        ("J[1]", "x = J[ 1 ]", True),
    ],
)
def test_a_name_is_read_or_not(expression: str, source: str, expected: bool) -> None:
    assert is_read(expression, source) == expected


def test_a_mistake_in_rods_is_confirmed_with_what_follows_from_a_length(tmp_path: Path) -> None:
    m, a = np.array([1.7, 1.1]), np.array([0.62, 0.44])
    arm = _arm(tmp_path, m, a / 2, m * a**2 / 12, 0.62)
    assert validate(_file(tmp_path, _RODS), arm).agrees
    report = validate(_file(tmp_path, _RODS.replace("+ 2 * k", "- 2 * k")), arm)
    assert report.causes[0].confirmed
    assert report.causes[0].kind == "sign"


def test_numbers_that_no_source_shows_are_spelled_out() -> None:
    source = "import numpy as np\na = b = 1.5\nc, d = np.ones(2)\ne = np.zeros(3)\n"
    space: dict[str, object] = {}
    exec(source, space)
    spelled = units.spell_out(source, space)
    found = [(name, ast.literal_eval(node)) for name, node in units.numbers(ast.parse(spelled))]
    assert found == [("a", 1.5), ("b", 1.5), ("c", 1.0), ("d", 1.0)]


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize(("named", "term"), [("", "0.031"), ("Jm = 0.031", "Jm")])
def test_a_rotor_of_one_joint_is_named_with_the_option(
    joint: int, named: str, term: str, tmp_path: Path
) -> None:
    right = textbooks.text("rr_textbook")
    added = right.replace(
        "    return np.array([[d11, d12], [d12, d22]])",
        f"    d{joint}{joint} = d{joint}{joint} + {term}\n    return np.array([[d11, d12], [d12, d22]])",
    )
    path, arm = tmp_path / "model.py", textbooks.robot("rr_textbook", right)
    path.write_text(added.replace("g = 9.81\n", f"g = 9.81\n{named}\n"), encoding="utf-8")
    report = validate(path, arm)
    cause = report.causes[0]
    assert cause.kind == "rotor-inertia"
    assert cause.text.endswith(f"compare with --rotor-inertia {arm.joint_names[joint - 1]}=0.031")
    assert "the source says: " in cause.beside
    assert report.repaired is None
    assert validate(path, arm, rotor_inertia={arm.joint_names[joint - 1]: 0.031}).agrees


def test_a_summand_of_the_robot_twice_is_no_rotor(tmp_path: Path) -> None:
    right = textbooks.text("rr_textbook")
    path = tmp_path / "model.py"
    path.write_text(right.replace("d22 = I2 +", "d22 = I2 + I2 +"), encoding="utf-8")
    report = validate(path, textbooks.robot("rr_textbook", right))
    assert report.causes[0].kind != "rotor-inertia"
    assert any("--rotor-inertia" in text for text in report.causes[0].alternatives) or report.repaired


def test_rotors_that_a_model_has_are_named_with_the_option(tmp_path: Path) -> None:
    arm = Robot.load("anthropomorphic3")
    rotors = np.array([0.3, 0.2, 0.04])

    def mass_matrix(q: Array) -> Array:
        return np.asarray(arm.mass_matrix(q) + np.diag(rotors))

    (cause,) = validate({"mass_matrix": mass_matrix}, arm).causes
    assert cause.kind == "rotor-inertia"
    assert cause.text.endswith("--rotor-inertia q1=0.3,q2=0.2,q3=0.04")
    assert validate({"mass_matrix": mass_matrix}, arm, rotor_inertia=rotors).agrees


@pytest.mark.parametrize(("fill", "which"), [(np.triu, "upper"), (np.tril, "lower")])
def test_a_triangle_of_an_inertia_matrix_is_named(fill: object, which: str) -> None:
    arm = Robot.load("anthropomorphic3")

    def mass_matrix(q: Array) -> Array:
        return np.asarray(fill(arm.mass_matrix(q)))  # type: ignore[operator]

    (cause,) = validate({"mass_matrix": mass_matrix}, arm).causes
    assert f"only the {which} triangle" in cause.text


def _passive(factor: float) -> dict[str, object]:
    arm = Robot.load("anthropomorphic3")

    def forward_dynamics(q: Array, v: Array, tau: Array) -> Array:
        return np.asarray(factor * arm.forward_dynamics(q, v, tau * np.array([1.0, 0.0, 1.0])))

    return {"forward_dynamics": forward_dynamics}


def test_a_passive_joint_is_seen() -> None:
    report = validate(_passive(1.0), "anthropomorphic3")
    assert report.agrees
    assert any("does not read tau2" in note for note in report.notes)


def test_a_wrong_model_with_a_passive_joint_has_a_diagnosis() -> None:
    report = validate(_passive(1.01), "anthropomorphic3")
    assert not report.agrees
    assert "not diagnosed" in report.causes[0].text
    assert "What is wrong" in str(report)


_SYMBOLIC = """
import sympy as sp
from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols
m1, m2, l1, c1, c2, I1, I2, g = sp.symbols("m1 m2 l1 c1 c2 I1 I2 g")
parameters = {m1: 1.3, m2: 0.7, l1: 0.31, c1: 0.14, c2: 0.12, I1: 0.009, I2: 0.004, g: 9.81}
"""
_BY_SHORT_NAMES = """
q1, q2, v1, v2 = sp.symbols("q1 q2 v1 v2")
h = m2*l1*c2*sp.sin(q2)
C = sp.Matrix([[-h*v2, h*(v1 + v2)], [h*v1, 0]])
"""
_BY_LAGRANGE = """
q1, q2 = dynamicsymbols("q1 q2")
v1, v2 = q1.diff(), q2.diff()
k = m2*l1*c2*sp.cos(q2)
T = (m1*c1**2 + I1 + m2*l1**2)*v1**2/2 + (m2*c2**2 + I2)*(v1 + v2)**2/2 + k*v1*(v1 - v2)
V = g*((m1*c1 + m2*l1)*sp.sin(q1) + m2*c2*sp.sin(q1 + q2))
method = LagrangesMethod(T - V, [q1, q2])
method.form_lagranges_equations()
mass_matrix = method.mass_matrix
gravity = -method.forcing.subs({v1: 0, v2: 0})
"""


@pytest.mark.parametrize(
    ("model", "line", "belongs"),
    [(_BY_SHORT_NAMES, 10, "-h * (v1 + v2)"), (_BY_LAGRANGE, 11, "v1 + v2")],
)
def test_a_lost_minus_in_sympy_is_found(model: str, line: int, belongs: str, tmp_path: Path) -> None:
    arm = _arm(tmp_path, np.array([1.3, 0.7]), np.array([0.14, 0.12]), np.array([0.009, 0.004]), 0.31)
    cause = validate(_file(tmp_path, _SYMBOLIC + model), arm).causes[0]
    assert cause.line == line
    assert belongs in cause.text
    assert cause.confirmed
    assert "the values say" in cause.beside


def test_friction_that_a_model_has_is_one_cause() -> None:
    arm = Robot.load("anthropomorphic3")
    damping = np.array([0.3, 0.2, 0.1])

    def inverse_dynamics(q: Array, v: Array, a: Array) -> Array:
        return np.asarray(arm.inverse_dynamics(q, v, a) + damping * v)

    (cause,) = validate({"inverse_dynamics": inverse_dynamics}, arm).causes
    assert cause.kind == "friction"
    assert cause.text.endswith("--viscous-friction q1=0.3,q2=0.2,q3=0.1")
    assert validate({"inverse_dynamics": inverse_dynamics}, arm, viscous_friction=damping).agrees
    assert not validate({"inverse_dynamics": inverse_dynamics}, arm, viscous_friction=0.2).agrees


def test_no_bodies_have_an_inertia_matrix_that_is_not_positive(tmp_path: Path) -> None:
    arm = _arm(tmp_path, np.array([1.5, 1.0]), np.array([0.2, 0.17]), np.array([0.02, 0.03]), 0.4)
    model = {
        "mass_matrix": lambda q: -0.37 * arm.mass_matrix(q),
        "gravity": lambda q: 1.3 * arm.gravity(q),
    }
    report = validate(model, arm)
    assert not report.agrees
    assert "another parameter set" not in str(report)


_LISTS = """
P = dict(m=[1.5, 1.0], L=[0.4, 0.4], c=[0.2, 0.2], I=[0.02, 0.02])

def mass_matrix(q):
    m, L, c, I = P["m"], P["L"], P["c"], P["I"]
    k = L[0]*c[1]*np.cos(q[1])
    a = I[0] + I[1] + m[0]*c[0]**2 + m[1]*(L[0]**2 + c[1]**2 + 2*k)
    d = I[1] + m[1]*(c[1]**2 + k)
    return np.array([[a, d], [d, I[1] + m[1]*c[1]**2]])
"""


def test_numbers_in_a_call_of_dict_are_varied(tmp_path: Path) -> None:
    """All lists of two equal numbers: only other numbers tell 2 k from a sum of two lengths."""
    arm = _arm(tmp_path, np.array([1.5, 1.0]), np.full(2, 0.2), np.full(2, 0.02), 0.4)
    assert validate(_file(tmp_path, _LISTS), arm).agrees
    wrong = validate(_file(tmp_path, _LISTS.replace("I[0] + I[1] + m[0]", "I[0] + m[0]")), arm)
    assert [(one.line, one.confirmed) for one in wrong.causes] == [(8, True)]
    assert "angle" not in wrong.causes[0].text
    factor = validate(_file(tmp_path, _LISTS.replace("2*k)", "k)")), arm)
    assert factor.causes[0].line == 8
    assert factor.causes[0].text.endswith("(a factor of 2, or its half)")


def test_words_of_calls_are_numbers_and_shapes_are_none() -> None:
    tree = ast.parse("P = dict(m=[1.5, -2.0], g=9.81)\nz = np.zeros(shape=(2, 3))\nR = Rod(c=(0.1, 0.2))")
    found = [(name, node.value) for name, node in units.numbers(tree)]
    assert found == [("m", 1.5), ("m", 2.0), ("g", 9.81), ("c", 0.1), ("c", 0.2)]


def test_a_constant_is_no_sum_of_two_coincidences(tmp_path: Path) -> None:
    """Rotors of 0.05 and 0.03 kg m², which round numbers of the arm add up to by chance."""
    arm = _arm(tmp_path, np.array([1.5, 1.0]), np.full(2, 0.2), np.full(2, 0.02), 0.4)
    right = runpy.run_path(str(_file(tmp_path, _LISTS)))["mass_matrix"]
    rotors = np.diag([0.05, 0.03])
    report = validate({"mass_matrix": lambda q: right(q) + rotors}, arm)
    assert "--rotor-inertia first=0.05,second=0.03" in report.causes[0].text
    told = {one.label: (one.text, one.others) for one in report.differences}
    assert told == {
        "D[1,1]": ("model less robot is 0.05", ()),
        "D[2,2]": ("model less robot is 0.03", ()),
    }


UNPACKED = """
import numpy as np

def numbers_of_arm():
    return 1.5, 1.0, 0.4, 0.2, 0.15, 0.02, 0.05, 9.81

def gravity(q):
    m1, m2, l1, c1, c2, I1, I2, g = numbers_of_arm()
    b = m2 * c2 * g * np.cos(q[0] + q[1])
    return np.array([(m1 * c1 + m2 * l1) * g * np.cos(q[0]) + b, b])

def mass_matrix(q):
    m1, m2, l1, c1, c2, I1, I2, g = numbers_of_arm()
    k = m2 * l1 * c2 * np.cos(q[1])
    d = I2 + m2 * c2**2
    return np.array([[I1 + m1 * c1**2 + m2 * l1**2 + d + 2 * k, d + k], [d + k, d]])
"""


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [("1.5, 1.0", "1.7, 1.0", 5), ("+ 2 * k", "+ k", 16), ("(m1 * c1", "(m1 * l1", 10)],
)
def test_numbers_unpacked_from_a_call_are_varied(old: str, new: str, line: int, tmp_path: Path) -> None:
    turn, ball = textbooks._turn, textbooks._round
    joints = [turn("0 -1 0", (0, 0, 0), 1.5, (0.2, 0, 0), ball(0.02))]
    joints += [turn("0 -1 0", (0.4, 0, 0), 1.0, (0.15, 0, 0), ball(0.05))]
    path = tmp_path / "arm.py"
    path.write_text(UNPACKED.replace(old, new, 1))
    (cause,) = validate(path, Robot.from_xml(textbooks.written("arm", joints))).causes
    assert cause.line == line
    assert cause.confirmed


_PLANAR = """import numpy as np

{numbers}

def mass_matrix(q):
    c2 = np.cos(q[1])
    d11 = m1 * lc1**2 + I1 + m2 * (l1**2 + lc2**2 + 2 * l1 * lc2 * c2)
    d12 = m2 * (lc2**2 + l1 * lc2 * c2) + I2
    return np.array([[d11, d12], [d12, m2 * lc2**2 + I2]])
"""


@pytest.mark.parametrize(
    "numbers",
    [
        "m1, m2, l1, lc1, lc2, I1, I2 = 1.0, 1.0, 1.0, 0.5, 0.5, 1 / 12, 1 / 12",
        "m1 = m2 = l1 = 1.0\nlc1 = lc2 = 0.5\nI1 = 1 / 12\nI2 = 1 / 12",
    ],
)
def test_numbers_that_are_worked_out_are_varied_too(numbers: str, tmp_path: Path) -> None:
    """I2 is missing in D[1,1]; with I1 = I2 = 1/12, 2 I1 agrees as well, so nothing is confirmed."""
    link = (
        '<link name="{0}"><inertial><mass value="1"/><origin xyz="0.5 0 0"/>'
        '<inertia ixx="{1}" ixy="0" ixz="0" iyy="{1}" iyz="0" izz="{1}"/></inertial></link>'
    )
    joint = (
        '<joint name="q{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>'
        '<axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="100" velocity="5"/></joint>'
    )
    joints = joint.format(1, "base", "a", 0) + joint.format(2, "a", "b", 1)
    links = '<link name="base"/>' + link.format("a", 1 / 12) + link.format("b", 1 / 12)
    robot = Robot.from_xml(f'<robot name="two">{links}{joints}</robot>')
    model = tmp_path / "model.py"
    model.write_text(_PLANAR.format(numbers=numbers))
    report = validate(str(model), robot)
    assert not report.agrees
    assert "for other numbers too" not in str(report)
    assert "[formula, confirmed]" not in str(report)


_WITH_ROTORS = """
m1, m2, l1, c1, c2, J1, J2 = 1.5, 1.1, 0.4, 0.21, 0.17, 0.031, 0.019
Jm, N = 1.2e-5, np.array([100, 80])

def mass_matrix(q):
    h = m2 * l1 * c2 * np.cos(q[1])
    d = J2 + m2 * c2**2
    D = np.array([[J1 + m1 * c1**2 + m2 * l1**2 + d + 2 * h, d + h], [d + h, d]])
    return D + Jm * np.diag(N**2)

def coriolis_matrix(q, v):
    h = m2 * l1 * c2 * np.sin(q[1])
    return np.array([[-h * v[1], -h * (v[0] + v[1])], [-h * v[0], 0.0]])
"""


def test_rotors_are_set_aside_and_the_search_goes_on_behind_them(tmp_path: Path) -> None:
    """A wrong sign in C, and rotors that the robot lacks: these are no term too much."""
    arm = _arm(tmp_path, np.array([1.5, 1.1]), np.array([0.21, 0.17]), np.array([0.031, 0.019]), 0.4)
    report = validate(_file(tmp_path, _WITH_ROTORS), arm)
    sign, rotors = report.causes
    assert "-h should be h" in sign.text
    assert sign.line == 14
    assert sign.evidence[-1].endswith(
        "the model agrees, for other numbers too, but for what is set aside below"
    )
    assert rotors.kind == "rotor-inertia"
    assert rotors.text.endswith("--rotor-inertia first=0.12,second=0.0768")
    right = _WITH_ROTORS.replace("[-h * v[0]", "[h * v[0]")
    assert validate(_file(tmp_path, right), arm, rotor_inertia={"first": 0.12, "second": 0.0768}).agrees


def test_a_number_that_should_be_gone_is_said_to_be_zero(tmp_path: Path) -> None:
    """Rotor inertia of one joint alone: the number was solved for as 7e-21."""
    arm = _arm(tmp_path, np.array([1.5, 1.1]), np.array([0.21, 0.17]), np.array([0.031, 0.019]), 0.4)
    right_signs = _WITH_ROTORS.replace("[-h * v[0]", "[h * v[0]")
    one_rotor = right_signs.replace("np.array([100, 80])", "np.array([100, 0])")
    (cause,) = validate(_file(tmp_path, one_rotor), arm).causes
    assert cause.kind == "rotor-inertia"
    assert "with 0 it agrees" in cause.beside


def test_a_term_too_much_is_named_as_it_is_written(tmp_path: Path) -> None:
    arm = _arm(tmp_path, np.array([1.5, 1.1]), np.array([0.21, 0.17]), np.array([0.031, 0.019]), 0.4)
    right = _WITH_ROTORS.replace("[-h * v[0]", "[h * v[0]").replace(" + Jm * np.diag(N**2)", "")
    wrong = right.replace("d = J2 + m2 * c2**2", "d = J2 + m2 * c2**2 + J1")
    (cause,) = validate(_file(tmp_path, wrong), arm).causes
    assert "J2 + m2 * c2**2 + J1 should be J2 + m2 * c2**2" in cause.text


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("np.cos(q[0]) + m2", "np.sin(q[0]) + m2"), ("    g2 = m2", "    g2 = -m2")),
        (("lc1 + m2 * l1", "lc1 - m2 * l1"), ("g2 = m2 * lc2 * g", "g2 = m2 * lc2 * g / 2")),
        (("lc1 + m2 * l1", "l1 + m2 * l1"), ("g * np.cos(q[0] + q[1])", "g * np.cos(q[1])")),
        (("m1 * lc1 + m2 * l1", "m1 * lc1"), ("    g2 = m2 * lc2", "    g2 = m2 * lc1")),
    ],
)
def test_two_slips_in_gravity_are_both_named(
    one: tuple[str, str], other: tuple[str, str], tmp_path: Path
) -> None:
    right = textbooks.text("rr_textbook")
    wrong = right
    for old, new in (one, other):
        assert old in wrong
        wrong = wrong.replace(old, new, 1)
    path = tmp_path / "model.py"
    path.write_text(wrong, encoding="utf-8")
    report = validate(path, textbooks.robot("rr_textbook", right))
    assert len(report.causes) == 2
    assert {cause.line for cause in report.causes} <= {29, 30}
    assert report.repaired is not None
    repaired: dict[str, Any] = {}
    meant: dict[str, Any] = {}
    exec(report.repaired, repaired)
    exec(right, meant)
    q = np.array([0.3, -1.1])
    np.testing.assert_allclose(repaired["gravity"](q), meant["gravity"](q), rtol=1e-12)
