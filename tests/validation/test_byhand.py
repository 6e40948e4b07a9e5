"""Mistakes listed by hand, in styles of real code: names hold for other numbers than those of the file."""

from __future__ import annotations

import ast
from pathlib import Path

import byhand
import numpy as np
import pytest
from sampling import for_search, sample

from armgpi import validate
from armgpi.validation import alternatives, edits, units, witnesses


@pytest.mark.parametrize("style", sorted({*byhand.STYLES, *byhand.LATER} - {*byhand.THIRD}))
def test_every_mistake_can_be_made(style: str) -> None:
    sources = [mistake.source for mistake in byhand.mistakes(style)]
    few = (*byhand.SEVENTH, *byhand.EIGHTH, *byhand.NINTH)
    fewest = (*byhand.TENTH, *byhand.ELEVENTH)
    least = 10 if style in fewest else 12 if style in few else 17 if style in byhand.SIXTH else 25
    assert len(set(sources)) == len(sources) >= least
    assert byhand.source(style) not in sources


@pytest.mark.parametrize(
    "style",
    [
        *sample(
            [
                *(style for style in byhand.STYLES if style != "lagrange"),
                *byhand.THIRD,
                *byhand.FOURTH,
                *byhand.FIFTH,
                *(style for style in byhand.SIXTH if style != "craig"),
                *byhand.SEVENTH,
                *byhand.EIGHTH,
                *byhand.NINTH,
                *byhand.TENTH,
                *byhand.ELEVENTH,
            ]
        ),
        for_search("craig"),  # 5 s
    ],
)
def test_right_models_agree(style: str) -> None:
    assert validate(byhand.FOLDER / f"{style}.py", byhand.robot(style)).agrees


@pytest.mark.parametrize("path", sorted((byhand.FOLDER / "right").glob("*.py")), ids=lambda path: path.stem)
def test_right_models_in_odd_styles_agree(path: Path) -> None:
    assert validate(path, byhand.robot(path.stem.split("__")[0])).agrees


@pytest.mark.parametrize(
    ("style", "line"),
    [
        ("closed", 28),  # g = 9.8 was "g should be (g + I3)"
        for_search("attributes", 8),  # attributes were no names
        ("attributes", 20),  # where l1 ** 2 is small any product agrees
        for_search("gears", 20),  # a dropped rotor was another number of teeth
        ("matlab", 12),  # I1 is I2 + I3
        ("graph", 4),  # expressions of CasADi were not searched
        for_search(
            "closed", 12
        ),  # 12 of 40 products that are 0.04 were looked at, the right one not among them
        ("spong", 13),  # where a function had defaults or annotations nothing was searched
        for_search("loops", 28),  # entries of lists were no names: 0.5 is c[k] / l[k]
        ("loops", 4),  # c[i] if i == k else l[i] was l[i]
        for_search("wheel", 18),  # what a class makes that the module calls was not searched
        for_search("mechanics", 9),  # frames of SymPy were no names
        ("inherited", 3),  # methods of an object of the module were not searched
        ("beamball", 3),  # of accelerations the derivatives were too coarse
        for_search("catalogue", 6),  # a model that reads JSON was not searched
        for_search("formulas", 9),  # formulas that are texts were not searched
    ],
)
def test_a_name_holds_for_other_numbers(style: str, line: int, tmp_path: Path) -> None:
    (mistake,) = (one for one in byhand.mistakes(style) if one.line == line)
    found = byhand.outcome(mistake, tmp_path)
    assert found.right, found.text
    assert found.confirmed


@pytest.mark.parametrize(("style", "line", "name"), [("gantry", 19, "-m"), ("stanford", 4, "-d2")])
def test_a_sign_that_stands_there_is_wrong_sooner_than_one_that_does_not(
    style: str, line: int, name: str, tmp_path: Path
) -> None:
    (mistake,) = (one for one in byhand.mistakes(style) if one.line == line)
    found = byhand.outcome(mistake, tmp_path)
    assert found.right
    assert f"{name} should be {name[1:]}" in found.text


@pytest.mark.parametrize("line", [3, 4])
def test_a_formula_is_believed_before_a_number_that_nobody_typed(line: int, tmp_path: Path) -> None:
    (mistake,) = (one for one in byhand.mistakes("params") if one.line == line)
    found = byhand.outcome(mistake, tmp_path)
    assert found.right  # the robot's rotor of 97.44 kg m² stood nowhere in the model
    assert not found.confirmed


def test_what_is_read_nowhere_is_told_and_a_forgotten_statement_named(tmp_path: Path) -> None:
    (mistake,) = (one for one in byhand.mistakes("wrist") if one.line == 12)
    assert witnesses.unread_names(mistake.source) == ["5: Ir is read nowhere"]
    found = byhand.outcome(mistake, tmp_path)
    assert found.right
    assert "after it M[0, 0] += Ir is missing" in found.text


@pytest.mark.parametrize(
    ("style", "line"),
    [
        # 17 s: a dropped ω×(ω×p), of which another stands beside it; LOOP has one that is the last.
        for_search("newton", 4),
        for_search("spatial", 20),  # one half of a vector of six for the other
        ("basenewton", 21),  # R.T @ I @ R for R @ I @ R.T, where I is an attribute
        for_search("composite", 5),  # in a function that is called several times, names of it were not known
        for_search("exponentials", 29),  # = for += in a loop
        ("printed", 8),  # a number in a sum
        for_search("swingers", 11),  # m (x² + y²) dropped
        ("params", 10),  # a motor at the end of a link, which is one body in the robot
        ("wrist", 1),  # another axis in a list of numbers
        # A forgotten entry that is used later; in helpers: a number of a list, an index, a matrix between
        # others, a formula copied from the line before; a term that is read nowhere, one of another body.
        *(
            for_search(style, line)
            for style, lines in {
                "stanford": (10,),
                "uicker": (8, 11, 13, 15, 23),
                "stacked": (2, 5, 14),
                "wheel": (10, 15),
                "mechanics": (8, 14, 17),
            }.items()
            for line in lines
        ),
    ],
)
def test_a_recursion_is_repaired(style: str, line: int, tmp_path: Path) -> None:
    (mistake,) = (one for one in byhand.mistakes(style) if one.line == line)
    found = byhand.outcome(mistake, tmp_path)
    assert found.right, found.text


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("I[0][2, 2] + I[1][2, 2]", "I[0][2, 2]"),  # entries of arrays were no names
        ("m[1] * (l[0] ** 2", "m[0] * (l[0] ** 2"),
        ("lc[1] ** 2 + 2", "l[1] ** 2 + 2"),
    ],
)
def test_entries_of_arrays_are_names(old: str, new: str, tmp_path: Path) -> None:
    right = """
import numpy as np
m, l, lc = np.array([1.2, 0.8]), [0.35, 0.29], [0.16, 0.13]
I = [np.diag([0.014, 0.014, 0.014]), np.diag([0.007, 0.007, 0.007])]


def mass_matrix(q):
    d = I[1][2, 2] + m[1] * (lc[1] ** 2 + l[0] * lc[1] * np.cos(q[1]))
    inertia = I[0][2, 2] + I[1][2, 2] + m[0] * lc[0] ** 2
    a = inertia + m[1] * (l[0] ** 2 + lc[1] ** 2 + 2 * l[0] * lc[1] * np.cos(q[1]))
    return np.array([[a, d], [d, I[1][2, 2] + m[1] * lc[1] ** 2]])
"""
    path, arm = tmp_path / "arrays.py", byhand.robot("homework")
    path.write_text(right.replace(old, new), encoding="utf-8")
    repaired = validate(path, arm).repaired
    assert repaired is not None
    assert byhand.same(repaired, right, 2)


def test_a_sum_of_vectors_in_sympy_is_repaired(tmp_path: Path) -> None:
    # Of symbols that other names mean, with numbers by `update`, and what hstack joins.
    right = """
import numpy as np
import sympy as sp

th = sp.Matrix(sp.symbols("th1 th2"))
m1, m2, L, r1, r2, J1, J2 = sp.symbols("m1 m2 L r1 r2 J1 J2")
values = {m1: 1.2, m2: 0.8, L: 0.35}
values.update({r1: 0.16, r2: 0.13, J1: 0.014, J2: 0.007})
a = th[0] + th[1]
o2 = L * sp.Matrix([sp.cos(th[0]), sp.sin(th[0])])
p1 = r1 * sp.Matrix([sp.cos(th[0]), sp.sin(th[0])])
p2 = o2 + r2 * sp.Matrix([sp.cos(a), sp.sin(a)])
ones = sp.Matrix.hstack(sp.Matrix([1]), sp.Matrix([1]))
M = sp.diag(J1, 0) + J2 * ones.T * ones
for m, p in ((m1, p1), (m2, p2)):
    M += m * p.jacobian(th).T * p.jacobian(th)
f = sp.lambdify([*th], M.subs(values))


def mass_matrix(q):
    return f(*q)
"""
    path, arm = tmp_path / "points.py", byhand.robot("homework")
    path.write_text(right.replace("p2 = o2 + ", "p2 = "), encoding="utf-8")
    report = validate(path, arm)
    (cause,) = report.causes
    assert "o2 + r2" in cause.text
    assert cause.confirmed


@pytest.mark.parametrize("line", [18, 21])
def test_a_number_that_is_a_ratio_of_others_confirms_nothing(line: int, tmp_path: Path) -> None:
    # 2 is Jm1 / Jm2, and 100 and 50 swapped are the rotors swapped: unequal, and right at these numbers.
    (mistake,) = (one for one in byhand.mistakes("gears") if one.line == line)
    found = byhand.outcome(mistake, tmp_path)
    assert found.found
    assert found.right or not found.confirmed


def test_a_closure_is_repaired(tmp_path: Path) -> None:
    head, body = byhand.source("spong").split("def M(", 1)
    lines = f"def M({body}".replace("p=params", "unused=0").replace('p["r2"]**2', 'p["r2"]').splitlines()
    text = [head, "def made(p):", *(f"    {line}" for line in lines), "    return M, C, G", ""]
    path = tmp_path / "closed.py"
    path.write_text("\n".join([*text, "M, C, G = made(params)"]), encoding="utf-8")
    (cause,) = validate(path, byhand.robot("spong")).causes
    assert 'p["r2"]' in cause.text or "p['r2']" in cause.text
    assert cause.line is not None


def test_a_derivative_is_that_of_the_robots_numbers_of_one_unit() -> None:
    rng = np.random.default_rng(3)
    mass, length = rng.normal(size=(2, 9))
    bases = {
        ("kg", 0): mass[:, None] / np.linalg.norm(mass),
        ("m", 1): length[:, None] / np.linalg.norm(length),
    }
    columns, values = np.stack([mass, length], axis=-1), np.array([2.0, -0.5])
    known = units.Slopes(("gravity",), (1.0,), bases, values, ("kg", "m"), (0, 1), columns)
    assert known.of(-3.0 * mass, []) == {0}
    assert known.of(mass + length, []) == set()
    # Unless the link is one of several bodies: the model has no mass of 2.
    joined = known._replace(bases={**known.bases, (f"{units.JOINED}kg", 0): units.span([mass, length])})
    assert joined.of(mass + length, [3.0]) == {0}
    assert joined.of(mass + length, [2.0]) == set()
    assert known.standing(2.0 * mass, 2.0) == {0: 1.0}
    assert known.standing(-0.5 * length, 0.5) == {1: -1.0}
    assert known.standing(mass, 2.0) == {}  # half of what that mass would do
    assert known.standing(mass, 0.5) == {}
    # From its end: what the length moves as far as it grows.
    columns, values = np.stack([length, mass], axis=-1), np.array([0.5, 0.2])
    moving = units.Slopes(("gravity",), (1.0,), bases, values, ("m", "m"), (0, 1), columns)
    assert moving.standing(0.5 * (length - mass), 0.5) == {0: 1.0, 1: -1.0}


def test_numbers_that_have_a_name() -> None:
    source = "a = 1.5\nself.b, c = 2, -3.0\np = {'m': 4.0}\ns = Box(l=5.0)\nv = [6.0, 7.0]\nd = 8.0 * a\n"
    named = list(units.numbers(ast.parse(source)))
    assert [(name, node.value) for name, node in named] == [
        ("a", 1.5), ("self.b", 2), ("c", 3.0), ("v", 6.0), ("v", 7.0), ("'m'", 4.0), ("l", 5.0)
    ]  # fmt: skip
    changed = units.with_numbers(source, [(named[0][1], 9.5), (named[4][1], 7.5)]).splitlines()
    assert (changed[0], changed[4]) == ("a = 9.5", "v = [6.0, 7.5]")


@pytest.mark.parametrize(
    ("line", "belongs"),
    [
        ("x = m3-m4", "x = m3+m4"),
        ("x = a + b * c", "x = a - b * c"),
        ("x = a - b**2", "x = a + b**2"),
    ],
)
def test_the_last_term_of_a_sum_has_its_sign_changed_once(line: str, belongs: str) -> None:
    statement = ast.parse(line).body[0]
    assert isinstance(statement, ast.Assign)
    assert isinstance(statement.value, ast.BinOp)
    site = edits.Site(statement.value.right, statement.value, [], False, "", False)
    turned = edits._with_operator(line, site)
    assert turned is not None
    change = edits.Change("sign", where="", name="", bits=0.0, **turned)
    assert edits.apply_changes(line, (change,)) == belongs


def test_products_are_changed_as_they_are_written() -> None:
    product = ast.parse("m2 * J.T @ J", mode="eval").body
    assert ast.unparse(alternatives._negative(product)) == "-m2 * J.T @ J"
    assert ast.unparse(alternatives._times(ast.Constant(2), product)) == "2 * m2 * J.T @ J"


LOOP = """import numpy as np
from numpy import cross

m, l, c, I = [1.2, 0.8], [0.35, 0.0], [0.16, 0.13], [0.014, 0.007]
z = np.array([0.0, -1.0, 0.0])


def inverse_dynamics(q, v, a):
    w, dw, dv, angle = np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 9.81]), 0.0
    arms, coms, forces, moments = [], [], [], []
    for i in range(2):
        angle += q[i]
        w = w + v[i] * z
        dw = dw + a[i] * z
        e = np.array([np.cos(angle), 0.0, np.sin(angle)])
        s, p = c[i] * e, l[i] * e
        forces.append(m[i] * (dv + cross(dw, s) + cross(w, cross(w, s))))
        moments.append(I[i] * dw)
        coms.append(s)
        arms.append(p)
        dv = dv + cross(dw, p) + cross(w, cross(w, p))
    f, n, tau = np.zeros(3), np.zeros(3), np.zeros(2)
    for i in (1, 0):
        n = n + cross(arms[i], f) + moments[i] + cross(coms[i], forces[i])
        f = f + forces[i]
        tau[i] = z @ n
    return tau
"""


@pytest.mark.parametrize(
    "mistakes",
    [
        {"dv + cross(dw, p) + cross(w, cross(w, p))": "dv + cross(dw, p)"},
        for_search({"cross(dw, s) + cross(w, cross(w, s))": "cross(dw, s)", "I[i] * dw": "dw"}),
    ],
)
def test_vectors_missing_in_a_loop_are_named(mistakes: dict[str, str], tmp_path: Path) -> None:
    wrong = LOOP
    for right, other in mistakes.items():
        assert right in wrong
        wrong = wrong.replace(right, other)
    path = tmp_path / "loop.py"
    path.write_text(LOOP, encoding="utf-8")
    assert validate(path, byhand.robot("homework")).agrees
    path.write_text(wrong, encoding="utf-8")
    report = validate(path, byhand.robot("homework"))
    assert len(report.causes) == len(mistakes)
    assert report.repaired is not None
    assert byhand.same(report.repaired, LOOP, 2)
