"""SymPy as people write it: lists under names of their own, Lagrange's and Kane's method by their objects.

The arm of each model is two.urdf by hand: two links in a vertical plane, angles down from the level.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from armgpi import validate
from armgpi.errors import ModelError
from armgpi.validation.template import planar

_ENERGIES = """
import sympy as sp
from sympy.physics import mechanics as me
t = me.dynamicsymbols._t
m1, m2, a1, c1, c2, J1, J2, g = sp.symbols("m1 m2 a1 c1 c2 J1 J2 g")
q1, q2 = q = list(me.dynamicsymbols("q1 q2"))
v = [x.diff(t) for x in q]
x1, z1 = c1*sp.cos(q1), c1*sp.sin(q1)
x2, z2 = a1*sp.cos(q1) + c2*sp.cos(q1 + q2), a1*sp.sin(q1) + c2*sp.sin(q1 + q2)
squares = [x.diff(t)**2 + z.diff(t)**2 for x, z in ((x1, z1), (x2, z2))]
K = (m1*squares[0] + m2*squares[1] + J1*v[0]**2 + J2*(v[0] + v[1])**2)/2
V = g*(m1*z1 + m2*z2)
L = K - V
"""
_NUMBERS = "{m1: 1.2, m2: 0.8, a1: 0.5, c1: 0.25, c2: 0.2, J1: 0.03, J2: 0.01, g: 9.81}"
_TORQUES = "tau = [sp.expand(L.diff(b).diff(t) - L.diff(a)) for a, b in zip(q, v)]\n"
_KANE = """
import sympy as sp
from sympy.physics import mechanics as me
m1, m2, a1, c1, c2, J1, J2, g, T1, T2 = sp.symbols("m1 m2 a1 c1 c2 J1 J2 g T1 T2")
q1, q2, u1, u2 = me.dynamicsymbols("q1 q2 u1 u2")
N = me.ReferenceFrame("N")
A = N.orientnew("A", "Axis", (q1, N.z))
B = A.orientnew("B", "Axis", (q2, A.z))
A.set_ang_vel(N, u1*N.z)
B.set_ang_vel(A, u2*A.z)
O = me.Point("O")
O.set_vel(N, 0)
P, Ao = O.locatenew("P", a1*A.x), O.locatenew("Ao", c1*A.x)
Bo = P.locatenew("Bo", c2*B.x)
P.v2pt_theory(O, N, A)
Ao.v2pt_theory(O, N, A)
Bo.v2pt_theory(P, N, B)
one = me.RigidBody("one", Ao, A, m1, (me.inertia(A, 0, 0, J1), Ao))
two = me.RigidBody("two", Bo, B, m2, (me.inertia(B, 0, 0, J2), Bo))
loads = [(Ao, -m1*g*N.y), (Bo, -m2*g*N.y), (A, T1*N.z - T2*N.z), (B, T2*N.z)]
method = me.KanesMethod(N, q_ind=[q1, q2], u_ind=[u1, u2], kd_eqs=[u1 - q1.diff(), u2 - q2.diff()])
"""
_FORMED = "method.kanes_equations([one, two], loads)\n"
_URDF = """<robot name="two">
<link name="base"/>
<link name="one"><inertial><origin xyz="0.25 0 0"/><mass value="1.2"/>
<inertia ixx="0.001" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="two"><inertial><origin xyz="0.2 0 0"/><mass value="0.8"/>
<inertia ixx="0.001" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="continuous"><parent link="base"/><child link="one"/><axis xyz="0 -1 0"/></joint>
<joint name="j2" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0.5 0 0"/>
<axis xyz="0 -1 0"/></joint>
</robot>
"""


def _written(folder: Path, source: str) -> tuple[Path, Path]:
    """Write a model and the robot beside it."""
    model, robot = folder / "model.py", folder / "two.urdf"
    model.write_text(source, encoding="utf-8")
    robot.write_text(_URDF, encoding="utf-8")
    return model, robot


def test_a_list_of_torques_is_proposed_and_taken(tmp_path: Path) -> None:
    """A length called a1 is no acceleration, though the model differentiates twice."""
    model, robot = _written(tmp_path, f"{_ENERGIES}{_TORQUES}parameters = {_NUMBERS}\n")
    with pytest.raises(ModelError) as refused:
        validate(model, robot)
    pairs = re.findall(r"--map (\w+)=(\w+)", str(refused.value))
    assert dict(pairs) == {"tau": "inverse_dynamics", "K": "kinetic_energy", "V": "potential_energy"}
    report = validate(model, robot, names=dict(pairs))
    assert report.agrees
    assert {one.function for one in report.functions} == {function for _, function in pairs}


def test_matrices_are_told_apart_by_what_they_depend_on(tmp_path: Path) -> None:
    """Lists of rows, M by accelerations, C v by its degree in v, gravity by g."""
    lists = f"""{_TORQUES}
a = [x.diff(t) for x in v]
inertias = [[sp.expand(x).coeff(y) for y in a] for x in tau]
still = [x.subs(dict.fromkeys(a, 0)) for x in tau]
weights = sp.Matrix([x.subs(dict.fromkeys(v, 0)) for x in still])
rates = [sp.expand(x - w) for x, w in zip(still, weights)]
del tau, K, V, L
values = {_NUMBERS}
"""
    model, robot = _written(tmp_path, _ENERGIES + lists)
    with pytest.raises(ModelError) as refused:
        validate(model, robot)
    pairs = dict(re.findall(r"--map (\w+)=(\w+)", str(refused.value)))
    assert pairs == {"inertias": "mass_matrix", "weights": "gravity", "rates": "coriolis_torque"}
    assert validate(model, robot, names=pairs).agrees


@pytest.mark.parametrize(
    ("formed", "forces"),
    [("method.form_lagranges_equations()\n", ", forcelist=[(N, T1*N.z)], frame=N"), ("", "")],
)
def test_the_object_of_lagranges_method_is_the_model(tmp_path: Path, formed: str, forces: str) -> None:
    frame = 'N = me.ReferenceFrame("N")\nT1 = sp.Symbol("T1")\n'
    method = f"{frame}method = me.LagrangesMethod(L, q{forces})\n{formed}"
    model, robot = _written(tmp_path, f"{_ENERGIES}{method}constants = {_NUMBERS}\n")
    assert validate(model, robot).agrees


def test_the_object_of_kanes_method_is_the_model(tmp_path: Path) -> None:
    """Its speeds are called u1 and u2, which are torques elsewhere."""
    model, robot = _written(tmp_path, f"{_KANE}{_FORMED}parameters = {_NUMBERS}\n")
    assert validate(model, robot).agrees


def test_a_mistake_before_the_object_is_found_at_its_line(tmp_path: Path) -> None:
    method = "method = me.LagrangesMethod(L, q)\nmethod.form_lagranges_equations()\n"
    wrong = _ENERGIES.replace("c2*sp.sin(q1 + q2)", "c2*sp.sin(q2)")
    model, robot = _written(tmp_path, f"{wrong}{method}parameters = {_NUMBERS}\n")
    report = validate(model, robot)
    assert not report.agrees
    line = next(k for k, text in enumerate(wrong.splitlines(), 1) if text.startswith("x2"))
    assert report.causes[0].line == line


def test_kanes_method_without_its_equations_is_refused_with_what_to_call(tmp_path: Path) -> None:
    model, robot = _written(tmp_path, f"{_KANE}parameters = {_NUMBERS}\n")
    with pytest.raises(ModelError, match=r"call method\.kanes_equations\(bodies, loads\)"):
        validate(model, robot)


def test_two_sets_of_equations_are_refused_by_name(tmp_path: Path) -> None:
    method = "first = me.LagrangesMethod(L, q)\nsecond = me.LagrangesMethod(L, q)\n"
    model, robot = _written(tmp_path, f"{_ENERGIES}{method}parameters = {_NUMBERS}\n")
    with pytest.raises(ModelError, match=r"several sets of equations of motion \(first, second\)"):
        validate(model, robot)


def test_a_list_of_lengths_under_a_short_name_is_no_function(tmp_path: Path) -> None:
    source = "import sympy as sp\nq1 = sp.Symbol('q1')\nC = list(sp.symbols('c1 c2'))\n"
    source += "G = [9.81*sp.cos(q1)*C[0]]\nparameters = {'c1': 0.3, 'c2': 0.2}\n"
    model, robot = tmp_path / "one.py", tmp_path / "one.urdf"
    model.write_text(source, encoding="utf-8")
    robot.write_text(planar(1).urdf, encoding="utf-8")
    assert [one.function for one in validate(model, robot).functions] == ["gravity"]
