"""No verdict is greener than what was judged: each command that judges, with something that is left out."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commands import Answer

import armgpi
from armgpi.base.intervals import Estimate
from armgpi.base.verdict import Verdict, judge
from armgpi.certification import check_certificate
from armgpi.certification.certificate import seal
from armgpi.cli import inspect
from armgpi.cli.arms import resolved, unjudged_drives
from armgpi.cli.options import Arm
from armgpi.errors import RolloutError
from armgpi.identification.text import judge_arm
from armgpi.studies.study import Identity, Study

Cli = Callable[..., Answer]

ARM = "robot: {name: anthropomorphic3, rotor_inertia: 0.05}\n"


@pytest.mark.parametrize(
    ("verdict", "code", "colour", "begin"),
    [
        (judge(True, "all agree"), 0, "good", "all agree"),
        (judge(False, "it differs"), 1, "bad", "it differs"),
        (judge(False, "it differs", ["a part"]), 1, "bad", "it differs"),
        (
            judge(True, "one agrees", ["the other"]),
            3,
            "fair",
            "INCOMPLETE: one agrees; not judged: the other",
        ),
        (judge(True, "one agrees", ["the other"], accepted=True), 0, "fair", "INCOMPLETE: one agrees"),
        (Verdict("not judged", "nothing ran"), 3, "fair", "NOT JUDGED: nothing ran"),
    ],
)
def test_a_verdict_gives_code_colour_and_line(verdict: Verdict, code: int, colour: str, begin: str) -> None:
    assert (verdict.exit_code, verdict.page_class) == (code, colour)
    assert verdict.line.startswith(begin)
    assert verdict.plain()["exit_code"] == code


def test_validate_names_what_was_not_compared(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "arm.py").write_text(
        "import armgpi\n"
        "robot = armgpi.Robot.load('anthropomorphic3')\n"
        "def mass(q): return robot.mass_matrix(q)\n"
        "def gravity(q): return robot.gravity(q)\n"
    )
    words = ("validate", tmp_path / "arm.py", "--robot", "anthropomorphic3")
    done = cli(*words)
    assert done.code == 3
    assert "--map mass=mass_matrix" in done.out
    assert "INCOMPLETE: 1 of 2 functions was compared" in done.out
    assert cli(*words, "--allow-uncompared").code == 0
    assert cli(*words, "--map", "mass=mass_matrix").code == 0  # the proposal
    page = tmp_path / "page.html"
    said = json.loads(cli(*words, "--json", "--report", page).out)
    assert said["verdict"]["outcome"] == "holds for part"
    assert "class=fair" in page.read_text()


def test_inspect_names_a_second_reading_that_could_not_be_had(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    finding = armgpi.health.Finding("warning", "file", "yourdfpy cannot read it", kind="cross-check")
    monkeypatch.setattr(
        "armgpi.health.crosscheck.with_cross_check", lambda report: report.with_findings([finding])
    )
    assert cli("inspect", "anthropomorphic3").code == 0
    done = cli("inspect", "anthropomorphic3", "--cross-check")
    assert done.code == 3
    assert done.out.splitlines()[-1].startswith("INCOMPLETE: 0 errors")
    assert cli("inspect", "anthropomorphic3", "--cross-check", "--allow-part").code == 0
    assert inspect._verdict(SimpleNamespace(findings=(), has_errors=False)).outcome == "holds"


@pytest.mark.slow
def test_bound_sums_limit_friction_and_payload_of_a_force_limit(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "pressing.yaml"
    file.write_text(
        "robot: {name: ur5, friction: {coulomb: 1.0}}\ncontrollers: [{type: pid, force_limit: 20}]\n",
        encoding="utf-8",
    )
    found = cli("bound", file, "--payload", "0:0.5", "--json")
    assert found.code == 3
    force = json.loads(found.out)["force"]
    assert force["gravity"] == pytest.approx(0.5 * 9.81)
    assert force["total"] == pytest.approx(20.0 + force["friction"] + 0.5 * 9.81)
    always = json.loads(cli("bound", file, "--payload", "0.5:0.5", "--json").out)["force"]
    assert always["gravity"] == force["gravity"]  # the model carries none
    less = json.loads(cli("bound", file, "--friction-within", "0.1", "--json").out)["force"]
    assert less["friction"] == pytest.approx(force["friction"] * 1.1 / 1.2)
    text = cli("bound", file, "--allow-part")
    assert text.code == 0
    assert "not judged: the error along the reference" in text.out.splitlines()[0]
    assert "no safety function" in text.out


def test_bound_of_a_force_limit_needs_no_rotor_inertia(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "pressing.yaml"
    text = "robot: {name: ur5, friction: {coulomb: 1.0}}\nideal: false\n"
    file.write_text(text + "controllers: [{type: gpi_auto, force_limit: 20}]\n", encoding="utf-8")
    found = cli("bound", file, "--payload", "0:0.5", "--json")
    assert found.code == 3
    force = json.loads(found.out)["force"]
    assert force["gravity"] == pytest.approx(0.5 * 9.81)  # of a load that the model does not have
    assert force["total"] > 20.0 + force["gravity"]


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *(("--torque", "5"), ("--force", "50"), ("--start", "held"), ("--tool-speed", "-1")),
        *(("--tool-speed", "nan"), ("--friction-within", "0.2")),
    ],
)
def test_bound_of_a_force_limit_refuses_options_that_change_nothing(
    option: str, value: str, cli: Cli, tmp_path: Path
) -> None:
    file = tmp_path / "pressing.yaml"
    controller = "controllers: [{type: pid, force_limit: 200, limit_friction: 0.1}]\n"
    file.write_text("robot: {name: anthropomorphic3}\n" + controller, encoding="utf-8")
    done = cli("bound", file, option, value)
    assert done.code == 2
    assert f"command line: {option}: " in done.err.splitlines()[-1]


def test_certify_and_bound_name_keys_of_a_file_that_they_leave_out(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(ARM + "controllers: [{type: gpi, omega: 25.0}]\nsupervisor: {}\n")
    done = cli("certify", file, "--radius", "0.2")
    assert done.code == 3
    first = done.out.splitlines()[0]
    assert first.startswith("INCOMPLETE: ")
    assert "controllers.0.omega" in first
    assert "supervisor" in first
    bounded = cli("bound", file, "--torque", "0.05")
    assert bounded.code == 3
    assert "a stop by the supervisor" in bounded.out.splitlines()[0]
    assert cli("bound", file, "--torque", "0.05", "--allow-part").code == 0


#: Arm of a file whose drives and friction its user supplied.
DRIVES = "drives: {q1: {rotor_inertia: 0.05}, q2: {rotor_inertia: 0.05}, q3: {rotor_inertia: 0.05}}"
SUPPLIED = {
    "friction": (f"{{name: anthropomorphic3, friction: {{viscous: 0.001}}, {DRIVES}}}", "joint friction"),
    "elasticity": (
        f"{{name: anthropomorphic3, {DRIVES.replace('0.05}', '0.05, stiffness: 900.0}')}}}",
        "joint elasticity",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "options", "what"),
    [
        ("certify", ("--radius", "0.3"), "friction"),
        ("certify", ("--radius", "0.3"), "elasticity"),
        ("bound", ("--torque", "0.001"), "elasticity"),  # of a file, friction is judged
    ],
)
def test_drives_that_the_user_supplied_and_that_are_not_judged_make_a_verdict_for_part(
    command: str, options: tuple[str, ...], what: str, cli: Cli, tmp_path: Path
) -> None:
    robot, named = SUPPLIED[what]
    file = tmp_path / "arm.yaml"
    file.write_text(f"robot: {robot}\nideal: false\n")
    words = (command, file, "--controller", "gpi", *options)
    page = tmp_path / "page.html"
    done = cli(*words, "--report", page)
    assert done.code == 3, (done.out, done.err)
    assert done.err.splitlines()[1].startswith("evaluated instead: stiff joints")
    assert done.out.splitlines()[0].startswith("INCOMPLETE: ")
    assert named in done.out.splitlines()[0]
    assert "<p class=fair>INCOMPLETE" in page.read_text()
    assert cli(*words, "--allow-part").code == 0


def test_friction_that_a_urdf_contains_is_judged_or_named(tmp_path: Path) -> None:
    source = Path(__file__).parents[1] / "fixtures" / "urdf_cases" / "00_good.urdf"
    file = tmp_path / "rubs.urdf"
    rubbing = source.read_text().replace("</joint>", '<dynamics damping="0.2" friction="0.1"/></joint>')
    file.write_text(rubbing)
    how = Arm()
    known = resolved(str(file), how)
    assert unjudged_drives(known, friction_is_judged=False) == ["joint friction (--friction includes it)"]
    assert unjudged_drives(known, friction_is_judged=True) == []
    assert unjudged_drives(resolved(str(source), how), friction_is_judged=False) == []


def test_certify_does_not_judge_an_arm_with_assumed_rotors(cli: Cli) -> None:
    done = cli("certify", "ur5", "--drives", "stiff")
    assert done.code == 3
    assert done.out.startswith("NOT JUDGED: ")
    data = json.loads(cli("certify", "ur5", "--drives", "stiff", "--json").out)
    assert data["verdict"]["outcome"] == "not judged"


@pytest.mark.slow
def test_the_checker_names_what_was_asked_for_and_has_no_claim(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.05)
    made = armgpi.certify(robot, speed=0.2, torque=np.full(3, 0.001), radius=np.full(3, 0.2))
    made.save(tmp_path / "whole.json")
    assert check_certificate.main([str(tmp_path / "whole.json")]) == 0
    data = json.loads(made.text)
    del data["solutions"]["stated"], data["inputs"]["stated"]
    data["seal"] = seal(data)
    (tmp_path / "part.json").write_text(json.dumps(data))
    assert check_certificate.main([str(tmp_path / "part.json")]) == 3
    assert "HOLDS FOR PART: asked for and not claimed: everything that was stated" in capsys.readouterr().out


Case = tuple[tuple[Any, ...], str]


class Sway(armgpi.Reference):
    """Sines of some joints about a configuration."""

    def __init__(self, amplitudes: list[float]) -> None:
        self.amplitudes = np.array(amplitudes)

    def at(self, t: Any) -> armgpi.Target:
        t, w = np.asarray(t, dtype=float)[..., None], np.array([2.1, 3.3, 2.7])
        q = np.array([0.0, 0.3, -0.6]) + self.amplitudes * np.sin(w * t)
        v = self.amplitudes * w * np.cos(w * t)
        return armgpi.Target(q, v, -self.amplitudes * w**2 * np.sin(w * t))


def log(path: Path, amplitudes: list[float]) -> Path:
    """Write a log of an arm that follows sines, and return its path."""
    robot = armgpi.Robot.load("anthropomorphic3").with_armature(0.05)
    plant, gpi = armgpi.RigidBodyPlant(robot), armgpi.GPI(robot, 1e-3)
    armgpi.save(armgpi.simulate(plant, gpi, Sway(amplitudes), 6.0, progress=False), path)
    return path


def leave_a_function(folder: Path, patch: pytest.MonkeyPatch) -> Case:
    (folder / "arm.py").write_text(
        "import armgpi\n"
        "robot = armgpi.Robot.load('anthropomorphic3')\n"
        "def mass(q): return robot.mass_matrix(q)\n"
        "def gravity(q): return robot.gravity(q)\n"
    )
    return (folder / "arm.py", "--robot", "anthropomorphic3"), "--allow-uncompared"


def leave_the_second_reader(folder: Path, patch: pytest.MonkeyPatch) -> Case:
    finding = armgpi.health.Finding("warning", "file", "yourdfpy cannot read it", kind="cross-check")
    patch.setattr("armgpi.health.crosscheck.with_cross_check", lambda report: report.with_findings([finding]))
    return ("anthropomorphic3", "--cross-check"), "--allow-part"


def leave_keys_of_a_file(folder: Path, patch: pytest.MonkeyPatch) -> Case:
    file = folder / "arm.yaml"
    file.write_text(ARM + "controllers: [{type: gpi, omega: 25.0}]\nsupervisor: {}\n")
    return (file, "--radius", "0.2"), "--allow-part"


def leave_the_stop(folder: Path, patch: pytest.MonkeyPatch) -> Case:
    (file, *_), allow = leave_keys_of_a_file(folder, patch)
    return (file, "--torque", "0.05"), allow


def leave_questions(folder: Path, patch: pytest.MonkeyPatch) -> Case:
    from armgpi.hardware.realtime import judge as judging
    from armgpi.hardware.realtime import stages

    seen = judging.Verdict((), {"lag": ("q1",)}, {"weight": ("q1",), "lag": ()}, None)
    folder_of: Any = SimpleNamespace(stages=(SimpleNamespace(joints=("q1", "q2", "q3")),), path=folder)
    patch.setattr(stages, "read", lambda path: folder_of)
    patch.setattr(judging, "judge", lambda *_: seen)
    return ("check", folder / "10-dry.armlog"), "--allow-part"


def leave_rollouts(folder: Path, patch: pytest.MonkeyPatch) -> Case:
    from armgpi.studies import workers

    file = folder / "study.yaml"
    file.write_text(ARM + "t_final: 0.05\nvary: {controller.omega: {uniform: [20.0, 30.0]}}\n")
    run = workers.run

    def leave_first(folder: Path, chunks: list[Any], *others: Any) -> dict[int, str]:
        left = run(folder, [chunk for chunk in chunks if chunk[0]], *others)
        return left | {i: "no disk" for i, _ in chunks if not i}

    patch.setattr(workers, "run", leave_first)
    patch.setattr("armgpi.studies.sample._MOST", 16)
    return (file, "--rollouts", "32", "--out", folder / "out"), "--allow-part"


def leave_a_joint(folder: Path, patch: pytest.MonkeyPatch) -> Case:
    moved, part = log(folder / "a.nc", [0.6, 0.5, 0.5]), log(folder / "b.nc", [0.6, 0.5, 0.0])
    words = (moved, "--robot", "anthropomorphic3", "--validate", part, "--out", folder / "out")
    return words, "--allow-part"


#: Every command that judges -> what is left out of what it was given, and the option that accepts it.
LEAVE_OUT: dict[str, Callable[[Path, pytest.MonkeyPatch], Case]] = {
    "validate": leave_a_function,
    "inspect": leave_the_second_reader,
    "certify": leave_keys_of_a_file,
    "bound": leave_the_stop,
    "bringup": leave_questions,
    "sweep": leave_rollouts,
    "identify": leave_a_joint,
}


@pytest.mark.slow
@pytest.mark.parametrize("command", LEAVE_OUT)
def test_every_command_that_judges_ends_with_3_where_something_is_left_out(
    command: str, cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words, accept = LEAVE_OUT[command](tmp_path, monkeypatch)
    done = cli(command, *words)
    assert done.code == 3, done.err
    (line,) = [line for line in done.out.splitlines() if line.startswith("INCOMPLETE: ")]
    assert f"(exit code 3; {accept} accepts this)" in line
    accepted = cli(command, *words, accept)
    assert accepted.code == 0, accepted.err
    assert f"INCOMPLETE: {line.split(': ', 1)[1].split(' (exit code')[0]} (accepted by" in accepted.out
    data = json.loads(cli(command, *words, "--json").out)
    assert (data["verdict"]["outcome"], data["verdict"]["exit_code"]) == ("holds for part", 3)
    assert data["verdict"]["left_out"]


def test_the_table_of_what_is_left_out_names_every_command_that_judges() -> None:
    page = (Path(__file__).parents[2] / "docs" / "cli.md").read_text(encoding="utf-8")
    table = page.split("| command | left out are |")[1].split("\n\n")[0]
    named = set(re.findall(r"^\| `([a-z_]+)", table, re.MULTILINE))
    assert named == {*LEAVE_OUT, "check_certificate"}  # the checker is a program of its own; see above


@pytest.mark.slow
def test_an_estimate_of_rare_failures_that_its_check_contradicts_is_not_judged(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "rare.yaml"
    file.write_text(
        ARM + "t_final: 0.2\nvary: {controller.omega: {uniform: [10.0, 30.0]}, plant.payload.mass: "
        "{uniform: [0.0, 2.0]}}\nfailure: {peak_error: 0.005}\n"
    )
    words = ("sweep", file, "--rare", "--rollouts", "100", "--out", tmp_path / "out")
    assert cli(*words).code == 0
    # Random rollouts that never reach a level which a tenth of the points or more reach contradict it.
    never = Estimate(value=0.0, lower=0.0, upper=0.01)
    monkeypatch.setattr("armgpi.studies.rare.clopper_pearson", lambda *_: never)
    done = cli(*words)
    assert done.code == 3
    assert done.out.splitlines()[0].startswith("NOT JUDGED: the probability of failure")
    assert json.loads(cli(*words, "--json").out)["verdict"]["outcome"] == "not judged"


def test_identify_names_joints_that_no_log_moves() -> None:
    names = ("q1", "q2")
    found: Any = SimpleNamespace(
        robot=SimpleNamespace(joint_names=names),
        residuals=np.array([0.01, np.nan]),
        gears=None,
        simulated=None,
    )
    verdict = judge_arm(found, None)
    assert verdict.exit_code == 3
    assert "q2: did not move in the fitted logs" in verdict.line
    assert judge_arm(found, None, accepted=True).exit_code == 0
    other: Any = SimpleNamespace(identified=np.array([0.5, 0.6]))
    assert judge_arm(found, other).exit_code == 1
    still: Any = SimpleNamespace(identified=np.array([np.nan, np.nan]))
    assert judge_arm(found, still).outcome == "not judged"


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("cma", ("tune", "study.yaml", "--out", "out")),
        ("clarabel", ("certify", "ur5", "--out", "out")),
        ("clarabel", ("identify", "log.csv", "--robot", "ur5", "--out", "out")),
        ("casadi", ("sweep", "study.yaml", "--out", "out")),
        ("trimesh", ("play", "ur5", "--out", "out")),
        ("casadi", ("play", "ur5", "--out", "out")),
        ("distributed", ("sweep", "study.yaml", "--workers", "2", "--out", "out")),
        ("yourdfpy", ("inspect", "ur5", "--cross-check")),
        ("cma", ("benchmark", "controllers", "anthropomorphic3", "--out", "out")),
        ("trimesh", ("run", "ur5", "--report", "page.html", "--out", "out")),
        ("matplotlib", ("compare", "ur5", "--plot", "page.png", "--out", "out")),
        ("casadi", ("export", "ur5", "--out", "out")),
    ],
)
def test_an_extra_is_asked_for_before_any_work(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("study.yaml").write_text(ARM.replace(", rotor_inertia: 0.05", "") + "tune: {evaluations: 4}\n")
    monkeypatch.setitem(sys.modules, module, None)
    done = cli(*words)
    assert done.code == 2
    (line,) = done.err.splitlines()  # no warning before it
    assert f"needs the package '{module}'" in line
    assert "pip install" in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study.yaml"]


def test_a_study_folder_that_never_began_is_no_study(tmp_path: Path) -> None:
    first, second = (Identity({"what": name}, {"code": "1"}, text=f"{name}\n") for name in "ab")
    Study.enter(tmp_path, first, "experiment.yaml")
    study = Study.enter(tmp_path, second, "experiment.yaml")
    assert not study.there
    assert (tmp_path / "experiment.yaml").read_text() == "b\n"
    study.write("part", np.zeros(2))
    with pytest.raises(RolloutError, match="holds another study"):
        Study.enter(tmp_path, first, "experiment.yaml")


def test_an_effort_that_is_proposed_passes_the_check_that_proposed_it(cli: Cli, tmp_path: Path) -> None:
    source = Path(__file__).parents[1] / "fixtures" / "urdf_cases" / "00_good.urdf"
    text = re.sub(r'mass value="[^"]*"', 'mass value="40"', source.read_text())
    file = tmp_path / "heavy.urdf"
    file.write_text(re.sub(r'effort="[^"]*"', 'effort="0"', text))
    for words in (("inspect", file), ("run", file, "--t-final", "0.01")):
        refused = cli(*words)
        assert refused.code in (1, 2)
        found = re.findall(r"--effort (\S+?)\)?(?=\s|$)", refused.out + refused.err)
        (proposed,) = dict.fromkeys(found)
        assert cli(*words, "--effort", proposed.rstrip("),")).code == 0


@pytest.mark.parametrize("command", ["certify", "bound"])
@pytest.mark.parametrize("kind", ["cartesian_impedance", "joint_impedance"])
def test_what_has_no_proof_for_a_spring_says_why(cli: Cli, tmp_path: Path, command: str, kind: str) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(f"robot: {{name: ur5}}\ncontrollers:\n  - {{type: {kind}}}\n")
    answer = cli(command, str(file))
    assert answer.code == 2
    [line] = answer.err.strip().splitlines()
    assert "whose damping from filtered positions ends at some frequency" in line
    limited = kind == "cartesian_impedance" and command == "bound"
    assert ("with force_limit, or a wall without friction" in line) == limited


def test_bound_has_the_force_of_a_spring_at_the_walls_of_its_file(cli: Cli, tmp_path: Path) -> None:
    """And the weight of the file's payload, which the controller does not know."""
    file = tmp_path / "arm.yaml"
    start, goal = [0.0, -1.2, 1.5, -1.87, -1.57, 0.0], [0.0, -1.1, 1.5, -1.87, -1.57, 0.0]
    arm = armgpi.Robot.load("ur5")
    above, below = (arm.frame_pose(arm.tip, q).translation[2] for q in (start, goal))
    wall = f"{{type: wall, normal: [0, 0, 2], distance: {above - 0.01}}}"
    plant = f"plant: {{payload: {{mass: 0.3}}, environment: [{wall}]}}\n"
    robot = "robot: {name: ur5, friction: {coulomb: 1.0}}\n"
    places = f"reference: {{points: [{start}, {goal}], durations: [0.8]}}\nt_final: 1.0\n"
    file.write_text(f"{robot}{plant}{places}controllers: [{{type: cartesian_impedance}}]\n")
    found = cli("bound", file, "--json")
    assert found.code == 3
    force = json.loads(found.out)["force"]
    assert force["depth"] == pytest.approx(above - 0.01 - below)
    assert force["gravity"] == pytest.approx(0.3 * 9.81, rel=1e-3)
    assert force["total"] == pytest.approx(500.0 * force["depth"] + force["friction"] + force["gravity"])
    assert "mm deep" in cli("bound", file, "--allow-part").out


@pytest.mark.parametrize(("stiffness", "damping", "said"), [(1e7, 0.0, 1), (1e7, 10.0, 0), (1e4, 0.0, 0)])
def test_run_names_a_wall_that_a_spring_does_not_damp(
    cli: Cli, tmp_path: Path, stiffness: float, damping: float, said: int
) -> None:
    file = tmp_path / "arm.yaml"
    wall = f"{{type: wall, normal: [0, 0, 1], distance: -0.3, stiffness: {stiffness}, damping: {damping}}}"
    plant = f"plant: {{delay: 1, environment: [{wall}]}}\n"
    file.write_text(
        f"robot: {{name: ur5}}\n{plant}controllers: [{{type: cartesian_impedance}}]\nt_final: 0.02\n"
    )
    answer = cli("run", file)
    assert answer.code == 0
    assert answer.err.count("so the tool may hammer it") == said
