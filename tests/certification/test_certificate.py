"""Certificates: what is claimed, checked exactly; and that nothing false gets past the checker."""

from __future__ import annotations

import ast
import copy
import json
import re
import subprocess
import sys
from decimal import Context, Decimal
from fractions import Fraction
from html import escape
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi.certification import check_certificate, report
from armgpi.certification.adversary import worst
from armgpi.certification.certificate import seal
from armgpi.certification.diagnosis import _less, beyond
from armgpi.certification.quantities import functions, points
from armgpi.certification.refute import again
from armgpi.certification.report import html
from armgpi.certification.request import member_of
from armgpi.certification.solve import merge_facts, solve
from armgpi.certification.text import _join, table, verdict
from armgpi.cli import main
from armgpi.cli.certify import _chosen_parts, _gains
from armgpi.gpi.family import Member
from armgpi.gpi.gains import Tuning
from armgpi.gpi.margins import open_loop
from armgpi.gpi.realisation import Bumpless
from armgpi.viewing.drawing import Drawing

checker: Any = check_certificate
FILE = Path(check_certificate.__file__)
LAW = {
    "integrators": 2,
    "rolloff": 0,
    "delay": 0,
    "sample_time": "0.001",
    "rate": "0",
    "omega": ["30"],
    "zeta": "1",
    "pole_ratio": "1",
    "rolloff_ratio": "4",
    "second_ratio": "1",
    "second_zeta": "1",
}
NUMBERS = {
    "delta_low": "1",
    "delta_high": "1.5",
    "sigma": "1",
    "kappa_v": "0.5",
    "kappa_e": "50",
    "kappa_g": "50",
    "kappa_f": "0",
    "sigma_error": "5",
    "kappa_error": "5",
    "inverse": ["1"],
    "count_time": "0",
    "hold": ["0"],
    "reach": ["1"],
    "jump": "0",
}
#: One joint whose motors and whose distance from the reference have no limit.
LIMITS = {"velocity": ["0"], "radius": ["1e9"], "effort": ["1e9"]}
INPUTS = {"torque": "1", "shift": "0", "count": "0", "reference": "0", "zone": "0", "spread": "0.01"}


@pytest.fixture(scope="module")
def made() -> armgpi.Certificate:
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.05)
    options = {"torque": 0.005, "bits": 20, "feedforward": "gravity", "radius": 0.05, "jump": True}
    moves = {"acceleration": 0.2}
    return armgpi.certify(robot, payload=(0.0, 0.25), speed=0.2, start="held", **options, **moves)


def test_a_certificate_holds_and_its_file_says_so(made: armgpi.Certificate, tmp_path: Path) -> None:
    assert made.certified, made.reasons
    assert not made.numbers_proved  # its numbers are searched
    assert made.check() == []
    path = made.save(tmp_path / "arm.json")
    assert armgpi.Certificate.load(path).data == made.data
    for flags in ((), ("-I", "-S")):  # where its folder is looked into for modules, and where nothing is
        program = [sys.executable, *flags, str(FILE), str(path)]
        run = subprocess.run(program, capture_output=True, text=True)
        assert run.returncode == 0, run.stdout + run.stderr
        assert "HOLDS" in run.stdout


def test_the_checker_needs_the_standard_library_alone() -> None:
    text = FILE.read_text(encoding="utf-8")
    tree = ast.parse(text)
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert names <= {*sys.stdlib_module_names}


@pytest.mark.parametrize("integrators", [1, 2, 3])
@pytest.mark.parametrize("rolloff", [0, 1, 2])
@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_checker_has_the_law_that_runs(integrators: int, rolloff: int, delay: int) -> None:
    theta = 0.03
    law = {**LAW, "integrators": integrators, "rolloff": rolloff, "zeta": "0.8", "pole_ratio": "1.1"}
    law |= {"second_ratio": "1.3", "second_zeta": "0.9", "delay": delay}
    A, K = (np.array(x, dtype=float) for x in checker.loop(checker.exact(law), Fraction(30))[1:3])
    bumpless = Bumpless(Member(integrators, rolloff, 4.0, 1.3, 0.9))
    c = bumpless.coefficients(Tuning(np.array(1.0), np.array(0.8), np.array(1.1)), theta)
    x = np.random.default_rng(0).standard_normal(len(A))
    parts = slice(0, 2), slice(2, len(A) - delay), slice(len(A) - delay, None)
    (q, speed), own, past = (x[part] for part in parts)  # errors of the last samples are states
    seen = past[-1] if delay else q
    state = type(bumpless.init(np.array(0.0), c))(*own)
    v = bumpless.output(seen, state, c)
    moved, updated, remembered = ((A @ x)[part] for part in parts)
    np.testing.assert_allclose(K @ x, v, rtol=1e-12)
    np.testing.assert_allclose(moved, [q + theta * speed, speed], rtol=1e-12)
    np.testing.assert_allclose(updated, bumpless.update(seen, v, None, state, c), rtol=1e-12)
    np.testing.assert_array_equal(remembered, [q, *past][:delay])


def decimal(x: Fraction) -> str:
    """Return a number as a text of at most 50 digits."""
    return str(Context(prec=50).divide(Decimal(x.numerator), Decimal(x.denominator))).lower()


def changed(data: Any, factor: Fraction) -> list[tuple[list[Any], Any]]:
    """Return copies of a certificate in which one number each is changed, and where."""
    found: list[tuple[list[Any], Any]] = []

    def visit(path: list[Any]) -> None:
        part = data
        for step in path:
            part = part[step]
        if isinstance(part, dict | list):
            for key in part if isinstance(part, dict) else range(len(part)):
                visit([*path, key])
        elif isinstance(part, str) and path[0] in ("solutions", "law", "numbers", "inputs", "limits"):
            other = copy.deepcopy(data)
            inner = other
            for step in path[:-1]:
                inner = inner[step]
            inner[path[-1]] = decimal(Fraction(part) * factor)
            if Fraction(part):
                found.append((path, other))

    visit([])
    return found


def one_claim_each(data: Any) -> list[Any]:
    """Return a certificate as several that claim one thing each, sealed: each is checked on its own."""
    found = []
    for name in data["solutions"]:
        one = {**data, **{key: {name: data[key][name]} for key in ("solutions", "inputs")}}
        found.append({**one, "seal": seal(one)})
    return found


def still_claimed(data: Any, name: str) -> bool:
    """Tell, by NumPy alone, whether a solution implies the errors that are claimed."""
    facts = merge_facts(data["limits"], data["law"], data["numbers"], data["inputs"][name])
    solution = checker.exact(data["solutions"][name])
    P = np.array(solution["P"], dtype=float)
    for delta in checker.sample(facts)[2]:
        X = np.array(
            checker.inequality(facts, checker.sample(facts), facts["omega"][0], 1, delta, solution),
            dtype=float,
        )
        scale = 1.0 / np.sqrt(np.diagonal(X))
        if np.linalg.eigvalsh(scale[:, None] * X * scale)[0] <= 0.0:
            return False
    sizes = np.array(checker.sample(facts)[4], dtype=float)
    V = np.array(solution["a"], dtype=float) @ sizes**2 / float(solution["alpha"])
    if name == "jump":
        V *= float(facts["delta_high"] / facts["delta_low"])
    e = np.sqrt(np.linalg.inv(P)[0, 0] * V * np.array(facts["inverse"], dtype=float))
    claims = np.array(solution["claims"]["errors"], dtype=float)
    return bool((np.linalg.eigvalsh(P) > 0.0).all() and (e <= claims).all())


@pytest.mark.parametrize("factor", [Fraction(101, 100), Fraction(99, 100)])
def test_whatever_is_changed_is_refused_or_claims_less(made: armgpi.Certificate, factor: Fraction) -> None:
    """What is sealed may not change at all; a claim may grow, a solution may be another one that holds."""
    refused = 0
    claims = one_claim_each(made.data)
    assert not any(checker.check(each) for each in claims)
    for path, other in chain.from_iterable(changed(each, factor) for each in claims):
        if path[0] != "solutions":
            assert checker.check(other) == ["the seal is broken"], path
            continue
        wrong = checker.check(other)
        if path[2] == "claims":
            assert bool(wrong) == (factor < 1), path
        elif path[2] == "P" and path[3] != path[4]:  # one of a pair alone
            assert wrong == [f"{path[1]}: the matrix inequality does not hold"], path
            other["solutions"][path[1]]["P"][path[4]][path[3]] = other["solutions"][path[1]]["P"][path[3]][
                path[4]
            ]
            wrong = checker.check(other)
        assert wrong or still_claimed(other, path[1]), path
        refused += bool(wrong)
    assert refused > 20


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_last_digit_of_what_is_sealed_or_one_of_a_pair_is_refused(
    made: armgpi.Certificate, sign: int
) -> None:
    factor = 1 + sign * Fraction(1, 10**15)
    for path, other in chain.from_iterable(changed(each, factor) for each in one_claim_each(made.data)):
        if path[0] != "solutions":
            assert checker.check(other) == ["the seal is broken"], path
        elif path[2] == "P" and path[3] != path[4]:
            assert checker.check(other) == [f"{path[1]}: the matrix inequality does not hold"], path


@pytest.mark.parametrize(
    "name",
    ["delta_high", "sigma", "sigma_error", "kappa_v", "kappa_error", "kappa_e", "kappa_g", "inverse", "hold"],
)
def test_worse_numbers_under_a_new_seal_no_longer_imply_the_claims(
    made: armgpi.Certificate, name: str
) -> None:
    data = copy.deepcopy(made.data)
    worse = [decimal(Fraction(x) * Fraction(101, 100)) for x in np.atleast_1d(data["numbers"][name])]
    data["numbers"][name] = worse if isinstance(data["numbers"][name], list) else worse[0]
    data["seal"] = seal(data)
    assert checker.check(data)


@pytest.mark.parametrize("part", ["P", "t", "a"])
def test_a_solution_with_a_part_missing_is_refused(made: armgpi.Certificate, part: str) -> None:
    data = copy.deepcopy(made.data)
    data["solutions"]["stated"][part].pop()
    assert "stated: expected 6 numbers t, 5 numbers a and a square P" in checker.check(data)


def test_a_solution_that_misses_by_1e_8_is_refused(made: armgpi.Certificate) -> None:
    """Solvers call such answers optimal; the exact checker does not."""
    data = copy.deepcopy(made.data)
    law, numbers, inputs = (checker.exact(data[key]) for key in ("law", "numbers", "inputs"))
    solution = data["solutions"]["gain"]
    exact, facts = checker.exact(solution), {**law, **numbers, **inputs["gain"]}
    low, high = Fraction(solution["alpha"]), 3 * Fraction(solution["alpha"])
    for _ in range(40):  # the largest alpha at which the inequality holds
        exact["alpha"] = (low + high) / 2
        low, high = (exact["alpha"], high) if checker.holds(facts, exact) else (low, exact["alpha"])
    # A little more: the smallest eigenvalue is then negative by 1e-8 or less.
    exact["alpha"] = low * (1 + Fraction(1, 10**8))
    worst = min(
        np.linalg.eigvalsh(
            np.array(
                checker.inequality(facts, checker.sample(facts), Fraction(30), 1, delta, exact), dtype=float
            )
        )[0]
        for delta in checker.sample(facts)[2]
    )
    assert -1e-8 < worst < 1e-12
    solution["alpha"] = decimal(exact["alpha"])
    assert "gain: the matrix inequality does not hold" in checker.check(data)


def test_what_the_solver_says_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    from armgpi.certification import solve as solving

    original = solving._Problem.solve_at

    def slightly_wrong(self: Any, alpha: float, margin: float) -> Any:
        x = original(self, alpha, margin)
        return None if x is None else x * np.where(np.arange(len(x)) == 0, 0.5, 1.0)

    monkeypatch.setattr(solving._Problem, "solve_at", slightly_wrong)
    assert solve(LAW, NUMBERS, INPUTS) is None


def bound(law: dict[str, Any], numbers: dict[str, Any], inputs: dict[str, str] = INPUTS) -> Any:
    """Return what is certified for one joint of unit inertia, None for nothing."""
    found = solve(law, numbers, inputs)
    if found is None:
        return None
    return checker.bounds(merge_facts(law, numbers, inputs, LIMITS), checker.exact(found._asdict()))


@pytest.mark.parametrize("delay", [0, 1, 2])
@pytest.mark.parametrize("member", [(1, 0), (2, 0), (3, 0), (2, 1)])
def test_the_bound_is_above_the_exact_worst_case_of_a_frozen_loop(
    delay: int, member: tuple[int, int]
) -> None:
    """The L1 norm of the impulse response, for constant delta and stiffness within what is certified."""
    law = {**LAW, "delay": delay, "integrators": member[0], "rolloff": member[1], "omega": ["15"]}
    numbers = {
        **NUMBERS,
        "delta_high": "1.2",
        "sigma": "0.2",
        "kappa_v": "0.1",
        "kappa_e": "10",
        "kappa_g": "10",
    }
    found = bound(law, numbers)
    assert found is not None
    exact = checker.exact(law)
    theta = exact["omega"][0] * exact["sample_time"]
    A, Y = (np.array(x, dtype=float) for x in checker.loop(exact, exact["omega"][0])[1:3])
    worst = 0.0
    for delta in (1.0, 1.1, 1.2):
        for stiffness in (-10.0, 0.0, 10.0):
            push = np.zeros(len(A))
            push[:2] = float(theta) ** 2 / 2, float(theta)
            e = np.eye(len(A))[0]
            closed = A + np.outer(push, delta * Y - stiffness / 15.0**2 * e)
            x, total = push / 15.0**2, 0.0
            for _ in range(1500):
                total += abs(x[0])
                x = closed @ x
            worst = max(worst, total)
    ratio = float(found["errors"][0]) / worst
    assert 1.0 <= ratio < 4.0


def test_other_possible_arms_are_searched_and_one_beyond_the_numbers_takes_all_claims_back() -> None:
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.05)
    heavier = [robot.with_payload(robot.tip, mass) for mass in (0.0, 0.03, 0.1)]
    options: dict[str, Any] = {"speed": 0.2, "start": "held", "radius": 0.05, "arms": [heavier[1]]}
    within = armgpi.certify(robot, others=heavier[:2], **options)
    assert within.certified
    assert within.check() == []
    share = 100.0 * 0.05**0.5  # two of two
    assert "each of 2 other possible arms was searched as well, and none exceeds them" in verdict(within)
    assert f"with 95 % confidence {share:.0f} % of the arms" in verdict(within)
    assert "a search of each of 2 more found none that exceeds the numbers" in within.data["assumptions"][0]
    beyond = armgpi.certify(robot, others=heavier, **options)
    (reason,) = beyond.reasons
    assert reason.startswith("1 of 3 other possible arms exceed its numbers")
    assert not beyond.certified
    assert np.isnan(beyond.error).all()
    # A file claims nothing either, as it does not have the reason.
    assert (beyond.data["solutions"], beyond.data["inputs"], beyond.data["robot"]["searched"]) == ({}, {}, 0)


def test_a_possible_arm_that_rubs_more_than_the_hull_exceeds_the_numbers_where_friction_acts() -> None:
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.05).with_friction(0.01, 0.001)
    others = [robot.with_friction(0.005, 0.001), robot.with_friction(0.01, 0.005)]
    options: dict[str, Any] = {"speed": 0.2, "start": "held", "radius": 0.05, "arms": [robot]}
    for friction, some in ((True, others[:1]), (False, others)):
        assert armgpi.certify(robot, others=some, friction=friction, **options).certified
    beyond = armgpi.certify(robot, others=others, friction=True, **options)
    assert not beyond.certified
    assert beyond.reasons[0].startswith("1 of 2 other possible arms exceed its numbers")


def test_a_motor_that_is_too_weak_is_the_one_reason_where_nothing_disturbs() -> None:
    robot = armgpi.Robot.load("anthropomorphic3").with_limits(effort={"q3": 0.05})
    made = armgpi.certify(robot, payload=(0.0, 0.1), speed=0.2, start="held")
    assert not made.certified
    (reason,) = made.reasons
    assert "Without disturbances, joint 'q3' can need a torque of" in reason
    assert "its effort is 0.05 N m. Try a lighter payload, more effort" in reason


def test_reasons_name_the_number_and_what_would_do() -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    made = armgpi.certify(robot, payload=(0.0, 0.25), speed=2.0, start="held")
    assert not made.certified
    assert made.data["solutions"] == {}
    said = "\n".join(made.reasons)
    assert "the controller tolerates 1 to" in said
    assert "of the speed" in said
    assert str(made).startswith("Not certified:\n")


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"speed": 0.0}, "speed"),
        ({"speed": 0.2, "radius": -1.0}, "radius"),
        ({"speed": 0.2, "delay": -1}, "delay"),
        ({"speed": 0.2, "bits": 99}, "bits"),
        ({"speed": 0.2, "box": {"middle": 0.0}}, "box"),
        ({"speed": 0.2, "box": {"lower": 1.0, "upper": -1.0}}, "box"),
        ({"speed": 0.2, "gains": armgpi.FixedGains([20.0, 30.0, 30.0])}, "omega"),
        ({"speed": 0.2, "gains": armgpi.BSplineNetwork()}, "gains"),
        ({"speed": 0.2, "rest_leak": 1.0}, "rest_leak"),
        ({"speed": 0.2, "realisation": "paper"}, "realisation"),
    ],
)
def test_bad_input_is_refused_by_name(options: dict[str, Any], name: str) -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    with pytest.raises(armgpi.errors.ArmgpiError, match=name):
        armgpi.certify(robot, **options)


def test_what_is_no_certificate_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    for text in ("", "[]", "{}", '{"format": "other"}'):
        path.write_text(text)
        with pytest.raises(armgpi.errors.ConfigError):
            armgpi.Certificate.load(path)
    with pytest.raises(armgpi.errors.ConfigError):
        armgpi.Certificate.load(tmp_path / "none.json")


def test_a_seal_is_of_what_was_searched(made: armgpi.Certificate) -> None:
    assert seal(made.data) == made.data["seal"]
    other = json.loads(json.dumps(made.data))
    other["numbers"]["sigma"] = "0.1"
    assert seal(other) != made.data["seal"]


def test_what_takes_long_says_how_far_it_is_where_somebody_looks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    options: dict[str, Any] = {"speed": 0.2, "prove": True, "budget": 0.2, "progress": said.append}
    armgpi.certify(armgpi.Robot.load("twodof"), **options)
    assert said[0] == "searching number 1 of 14"
    assert any(line.startswith("proof 1: ") for line in said)
    assert said[-1] == "solving"
    monkeypatch.setattr(sys, "argv", ["armgpi", "certify", "twodof", "--speed", "0.2"])
    for looks in (False, True):
        monkeypatch.setattr("sys.stderr.isatty", lambda looks=looks: looks)
        with pytest.raises(SystemExit):
            main()
        err = capsys.readouterr().err
        assert ("searching number 1 of 14" in err) == looks
        assert "searching" not in err.rpartition("\r")[2]


def test_proved_is_said_where_every_number_is_and_there_alone() -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    made = armgpi.certify(robot, payload=(0.0, 0.25), speed=0.2, start="held", box=0.3, prove=True)
    assert made.numbers_proved
    assert set(made.data["status"].values()) == {"proved"}
    assert "every number is proved" in str(made)
    assert "Proved under the assumptions of docs/proof.md" in str(made)
    for name in made.data["status"]:
        other = copy.deepcopy(made.data)
        other["status"][name] = "searched"
        assert not armgpi.Certificate(other).numbers_proved
        assert "guaranteed" not in str(armgpi.Certificate(other))


@pytest.mark.parametrize("prove", [False, True])
def test_a_gantry_whose_inertia_is_constant_has_a_certificate(prove: bool) -> None:
    axes = zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), ("b", "x", "y"), (10, 5, 2), strict=True)
    text = "".join(
        f"<link name='{name}'><inertial><mass value='{mass}'/>"
        "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        f"<joint name='j{name}' type='prismatic'><parent link='{parent}'/><child link='{name}'/>"
        f"<axis xyz='{axis}'/><limit lower='-1' upper='1' velocity='1' effort='200'/></joint>"
        for name, axis, parent, mass in axes
    )
    robot = armgpi.Robot.from_xml(f"<robot name='gantry'><link name='b'/>{text}</robot>")
    made = armgpi.certify(robot, payload=(0.0, 1.0), speed=0.2, start="held", prove=prove)
    assert made.certified, made.reasons
    assert made.check() == []
    assert made.numbers_proved is prove
    largest = float(made.data["inputs"]["gain"]["torque"]) / np.sqrt(
        [float(x) for x in made.data["numbers"]["inverse"]]
    )
    assert (largest > 10.0).all()  # N: motors of 200 N limit it, and no motion of D(q), which there is not
    assert (np.diff(made.per_torque) > 0.0).all()  # the more mass an axis moves, the less it gives way


def test_numbers_that_are_the_same_for_all_joints_are_told_once() -> None:
    assert [_join(x) for x in (["3"], ["3", "3.0"], ["3", "4.5"])] == ["3", "3", "3, 4.5"]


def test_a_joint_of_a_box_may_stand_still() -> None:
    robot, ends = armgpi.Robot.load("anthropomorphic3").with_armature(0.05), [0.2, 0.3, -1.0]
    made = armgpi.certify(robot, speed=0.2, box={"lower": ends, "upper": [0.2, 0.6, -0.5]})
    wider = armgpi.certify(robot, speed=0.2, box={"lower": ends, "upper": [0.3, 0.6, -0.5]})
    assert 0.0 < float(made.data["numbers"]["sigma"]) <= float(wider.data["numbers"]["sigma"]) * 1.01


def test_a_page_shows_claims_circle_box_and_what_is_in_the_way(made: armgpi.Certificate) -> None:
    robot = armgpi.Robot.load("anthropomorphic3")
    page = html(again(made, robot.with_armature(0.05)), made)
    for heading in ("What is certified", "Nyquist&#x27;s curve and the circle", "Numbers of the arm"):
        assert heading in page
    assert page.count("<svg") == 1 + robot.n
    assert "<script" not in page
    _, _, *pictures = page.split("<svg")
    for picture in pictures:  # of a joint each: curves go from one end of the box to the other
        drawn = re.findall(r'polyline points="([^"]*)"', picture)
        frame, *_, curve = (np.array([point.split(",") for point in line.split()], float) for line in drawn)
        share = (curve[:, 0] - frame[0, 0]) / np.ptp(frame[:, 0])
        np.testing.assert_allclose(share, (np.arange(len(curve)) + 0.5) / len(curve), atol=1e-3)
    none = armgpi.Certificate({**made.data, "solutions": {}}, ("Limiting quantity: <gravity>",))
    page = html(again(none, robot.with_armature(0.05)), none)
    assert "not certified" in page
    assert "Limiting quantity: &lt;gravity&gt;" in page
    assert "What is certified" not in page


class Drawn(Drawing):
    """A drawing that keeps what is drawn, in its own numbers."""

    def __init__(self, *sides: Any, **more: Any) -> None:
        super().__init__(*sides, **more)
        self.lines, self.words = list[Any](), dict[str, tuple[float, float]]()

    def line(self, path: Any, *style: Any, **more: Any) -> str:
        self.lines.append(np.array(path, float))
        return super().line(path, *style, **more)

    def text(self, x: float, y: float, text: str, *style: Any, **more: Any) -> str:
        self.words[text] = x, y
        return super().text(x, y, text, *style, **more)


def test_a_page_draws_curve_circle_and_shares_where_they_are(
    made: armgpi.Certificate, monkeypatch: pytest.MonkeyPatch
) -> None:
    every: list[Drawn] = []

    def drawing(*sides: Any, **more: Any) -> Drawn:
        every.append(Drawn(*sides, **more))
        return every[-1]

    monkeypatch.setattr(report, "Drawing", drawing)
    monkeypatch.setattr(report, "worst", lambda asked, count: worst(asked, count // 20))
    asked = again(made, armgpi.Robot.load("anthropomorphic3").with_armature(0.05))
    page = html(asked, made)
    assert re.findall(r"<p>([^<]*)</p><p class=good>([^<;]*)", page)[0] == (
        escape(table(made)[1 + len(made.reasons)]),
        escape(verdict(made)),
    )
    assert "% of its effort" in page
    assert "claims for each joint" in page
    assert "which switches at the worst times" in page
    nyquist, *boxes = every
    law, numbers = made.data["law"], made.data["numbers"]
    low, high, sigma = (float(numbers[x]) for x in ("delta_low", "delta_high", "sigma"))
    *_, circle, above, below = nyquist.lines
    ends = -1.0 / np.array([low, high])
    size = np.hypot(circle[:, 0] - ends.mean(), circle[:, 1])
    np.testing.assert_allclose(size, 0.5 * abs(ends[1] - ends[0]), atol=1e-9)
    assert np.ptp(circle[:, 1]) == pytest.approx(abs(ends[1] - ends[0]))
    assert nyquist.words[f"-1/{low:.3g}"][0] < ends[0]
    assert nyquist.words[f"-1/{high:.3g}"][0] > ends[1]
    np.testing.assert_allclose(below, above * [1, -1])
    omega, zeta, p = (float(x) for x in (law["omega"][0], law["zeta"], law["pole_ratio"]))
    loop = open_loop(Tuning(np.array(omega), np.array(zeta), np.array(p * omega)), member_of(law))
    s = 1j * np.geomspace(1e-2, 1e3, 4000) - sigma / (2.0 * omega)
    curve = np.polyval(loop.numerator, s) / np.polyval(loop.denominator, s)
    np.testing.assert_allclose(above @ [1.0, 1j], curve[np.abs(curve) < 4.4])
    rng = np.random.default_rng(0).random((3000, 9))
    setting = asked.setting
    at = points(
        setting,
        np.hstack([setting.lower + (setting.upper - setting.lower) * rng[:, :3], 2.0 * rng[:, 3:] - 1.0]),
    )
    for j, box in enumerate(boxes):
        lower, upper = setting.lower[j], setting.upper[j]
        assert box.x == (lower, upper)
        for line, name, best in ((box.lines[3], "delta_high", 1.0), (box.lines[6], "kappa_e", 0.0)):
            values = np.max([functions(setting)[name](setting, arm, at) for arm in setting.arms], axis=0)
            part = np.digitize(rng[:, j], np.arange(1, 24) / 24)
            share = [(values[part == k].max() - best) / (float(numbers[name]) - best) for k in range(24)]
            np.testing.assert_allclose(line[:, 1], share, rtol=1e-9)
            np.testing.assert_allclose(line[:, 0], lower + (np.arange(24) + 0.5) / 24 * (upper - lower))
        np.testing.assert_allclose([line[:, 0] for line in box.lines[:3]], [[lower, upper]] * 3)
        for mark in ("0.5", "1"):
            assert box.words[mark] == pytest.approx((lower, float(mark) - 0.09))  # below its line


@pytest.mark.parametrize(
    ("omega", "pole", "rate", "option"),
    [
        ("24:36", None, None, "--rate"),
        (None, None, "auto", "--rate"),
        ("24:30:36", None, "auto", "--omega"),
        ("fast", None, None, "--omega"),
        ("24:36", None, "slow", "--rate"),
        ("24:36", 30.0, "0.05", "--p"),
    ],
)
def test_bad_options_are_refused_by_name(
    omega: str | None, pole: float | None, rate: str | None, option: str
) -> None:
    with pytest.raises(armgpi.errors.ConfigError, match=option):
        _gains(omega, 1.0, pole, rate)


def test_what_the_rule_chooses_is_no_option_of_the_untuned_law() -> None:
    law = {"integrators": 2, "rolloff": 0, "rolloff_ratio": 4.0, "feedforward": "none", "delay": 1}
    assert _chosen_parts({**law, "controller": "gpi"})["integrators"] == 2
    assert _chosen_parts({**law, "controller": "gpi_auto"}) == {"controller": "gpi_auto", "delay": 1}
    with pytest.raises(armgpi.errors.ConfigError, match="--rolloff"):
        _chosen_parts({**law, "controller": "gpi_auto", "rolloff": 1})


def test_shares_of_what_disturbs_are_told_and_add_up() -> None:
    options: dict[str, Any] = {
        "payload": (0.0, 0.1),
        "start": "held",
        "speed": 0.2,
        "box": 0.2,
        "radius": 0.2,
    }
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.1)

    def shares(**stated: Any) -> dict[str, float]:
        made = armgpi.certify(robot, feedforward="gravity", **options, **stated)
        told = [line for line in str(made).splitlines() if "Shares of the disturbances" in line]
        found = re.findall(r"([a-z][a-z ]+?) ([\d.e+-]+) %", told[0].split(": ")[1]) if told else []
        return {name: float(x) for name, x in found}

    fine, coarse = (shares(torque=0.002, bits=bits, acceleration=0.2) for bits in (16, 15))
    moved = {"acceleration of the reference", "velocity of the reference"}
    for each in fine, coarse:
        assert set(each) == moved | {"encoder", "disturbance"}
        assert sum(each.values()) == pytest.approx(100.0, abs=2.0)
    assert coarse["encoder"] == pytest.approx(2.0 * fine["encoder"], rel=0.1)
    assert shares(torque=0.002) == {"disturbance": 100.0}
    assert not shares()


def test_claims_are_the_bounds_of_their_solutions_and_of_the_largest_torque_that_stays_within(
    made: armgpi.Certificate,
) -> None:
    data = made.data
    limits = checker.exact({key: data["limits"][key] for key in ("radius", "effort")})
    for name, solution in data["solutions"].items():
        numbers = {key: solution[key] for key in ("P", "alpha", "t", "a")}

        def bounds(factor: float, name: str = name, numbers: Any = numbers) -> Any:
            torque = repr(factor * float(data["inputs"][name]["torque"]))
            facts = merge_facts(
                data["limits"], data["law"], data["numbers"], {**data["inputs"][name], "torque": torque}
            )
            return checker.bounds(facts, checker.exact(numbers), name)

        exact = bounds(1.0)
        for what, values in exact.items():
            shares = [
                float(said) / float(x) for said, x in zip(solution["claims"][what], values, strict=True)
            ]
            assert all(1.0 < share < 1.0 + 3e-6 for share in shares), (name, what)
        if name == "gain":
            ends = {
                "errors": limits["radius"],
                "torques": limits["effort"],
                "speed": [Fraction(data["inputs"][name]["spread"])],
            }
            within = [
                all(x <= y for what, most in ends.items() for x, y in zip(found[what], most, strict=True))
                for found in (exact, bounds(1.00001))
            ]
            assert within == [True, False]


def test_what_is_in_the_way_is_told_of_what_is_beyond_alone() -> None:
    numbers = {"delta_low": "0.9", "delta_high": "1.8", "kappa_e": "40"}
    assert _less(numbers, "kappa_e", 0.25)["kappa_e"] == "10.0"
    assert _less(numbers, "delta_high", 0.5) == {**numbers, "delta_high": "1.4"}
    above = _less({**numbers, "delta_low": "1.2"}, "delta_high", 0.0)
    assert (above["delta_low"], above["delta_high"]) == ("1.0", "1.0")
    assert _less({**numbers, "delta_high": "0.95"}, "delta_high", 0.5)["delta_high"] == "1.0"
    robot = armgpi.Robot.load("anthropomorphic3").with_limits(effort=[2.0, 3.0, 4.0])
    asked: Any = SimpleNamespace(robot=robot, radius=np.array([0.1, 0.2, 0.3]))
    edge = {"errors": [0.1, 0.2, 0.3], "torques": [2.0, 3.0, 4.0], "speed": [0.5]}
    assert beyond(asked, None, 0.5, edge) == []
    off = beyond(asked, "a load", 0.49, {**edge, "errors": [0.11, 0.24, 0.3], "torques": [1.0, 3.0, 4.1]})
    assert [re.sub("; .*|[.] Try.*", "", each) for each in off] == [
        "Under a load, the error of joint 'q2' can reach 0.24 rad",
        "Under a load, joint 'q3' can need a torque of 4.1 N m",
        "Under a load, the speed of the error can exceed the one that the numbers were taken for",
    ]


def test_gains_of_a_moving_omega_go_from_the_least_that_is_certified_to_the_largest() -> None:
    law = LAW | {"omega": ["24", "26", "30"], "rate": "1/20", "zeta": "0.9"}
    gains: Any = armgpi.Certificate({"law": law}).gains
    assert gains.omega_c == (24.0, 30.0)
    assert (gains.zeta_c, gains.rate, gains.common) == (0.9, 0.05, True)
