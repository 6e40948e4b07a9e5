"""The command line, as a user and as a program call it."""

from __future__ import annotations

import ast
import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Answer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rich.cells import cell_len
from typer.main import get_command

import armgpi
from armgpi import Status, config, load, metrics
from armgpi.cli import app
from armgpi.cli.commands import ENTRIES
from armgpi.hardware.export.interfaces import TARGETS
from armgpi.robot.robots import names

ROOT = Path(__file__).parents[2]
DEMO = str(ROOT / "examples" / "demo.yaml")
ARM = "anthropomorphic3"
SHORT = ("--t-final", "0.02")
SAMPLED = ("q", "v", "q_ref", "q_measured", "tau_command", "tau")
FINGERS = ("--lock", "panda_finger_joint1", "--lock", "panda_finger_joint2")


def command(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    """Start `armgpi` as a program of its own."""
    whole = [sys.executable, "-m", "armgpi.cli", *map(str, arguments)]
    return subprocess.Popen(whole, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)


# Help.


def test_options_of_one_name_are_one_option_in_every_command() -> None:
    commands = get_command(app).commands  # type: ignore[attr-defined]
    taken: dict[str, dict[str, Any]] = {"--json": {}, "--report": {}, "--html": {}, "--out": {}}
    for name, command in commands.items():
        for option in command.params:
            assert not {"--output", "--page"} & set(option.opts), name
            for flag in set(option.opts) & set(taken):
                taken[flag][name] = option
    for flag in ("--json", "--report", "--html"):
        assert len({(tuple(o.opts), o.metavar, o.default, o.help) for o in taken[flag].values()}) == 1
    for option in taken["--out"].values():
        assert (option.opts, option.required) == (["--out", "-o"], False)
        assert option.metavar in ("FILE", "FOLDER")
        if option.default is not None:
            assert (option.metavar == "FILE") == bool(option.default.suffix)
    page = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    _, _, after = page.partition("Commands that only write pages, motions or source (")
    silent = set(re.findall(r"`(\w+)`", after.partition("do not have it.")[0]))
    assert set(commands) - set(taken["--json"]) == silent
    assert set(taken["--json"]) - set(taken["--report"]) == {"robots", "doctor", "log", "export", "bringup"}


def test_commands_import_no_command_and_have_a_row_in_the_page() -> None:
    """What they share is in modules that are no command: arms, written, settings and the like."""
    modules = {f"armgpi.cli.{entry.module}" for entry in ENTRIES.values()}
    for module in modules:
        tree = ast.parse((ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
        imported = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                imported |= {each.name for each in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported |= {str(node.module), *(f"{node.module}.{each.name}" for each in node.names)}
        assert not imported & modules, module
    page = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    rows = "".join(line for line in page.splitlines() if line.startswith("| `armgpi "))
    for name in ENTRIES:
        assert re.search(rf"`armgpi {name}[ `]", rows), name


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["--version"], ["run", "--bogus"]])
def test_help_waits_for_no_heavy_import(arguments: list[str]) -> None:
    code = (
        "import sys\nfrom armgpi.cli import main\n"
        f"sys.argv = ['armgpi', *{arguments!r}]\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stderr.split()}
    # Not pydantic: Typer itself imports it.
    heavy = {"pinocchio", "numpy", "scipy", "xarray", "h5py", "h5netcdf", "yaml", "matplotlib"}
    assert "armgpi" in loaded
    assert not loaded & heavy


def test_the_list_of_commands_says_what_they_say_themselves() -> None:
    for name, entry in ENTRIES.items():
        command = get_command(app).commands[name]  # type: ignore[attr-defined]
        assert command.get_short_help_str(limit=1000) == entry.summary


@pytest.mark.parametrize(
    ("out", "unused"),
    [
        (
            False,
            {"dask", "pyarrow", "xarray", "pandas", "yaml", "scipy.optimize", "scipy.interpolate", "h5py"},
        ),
        (True, {"dask", "pyarrow", "scipy.optimize", "scipy.interpolate"}),
    ],
)
def test_a_run_imports_neither_dask_nor_what_it_does_not_use(
    out: bool, unused: set[str], tmp_path: Path
) -> None:
    pytest.importorskip("dask")
    words = [
        "armgpi",
        "run",
        "anthropomorphic3",
        "--t-final",
        "0.02",
        *(["--out", str(tmp_path)] if out else []),
    ]
    code = (
        f"import sys; sys.argv = {words}\n"
        "from armgpi.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        f"assert not {unused} & set(sys.modules)\n"
        "import dask.array, importlib.util  # it is there all the same\n"
        "assert importlib.util.find_spec('dask') is not None"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize("command", ["run", "compare"])
def test_a_table_is_the_same_whether_its_rollouts_are_kept_or_not(
    command: str, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    words = (command, ARM, *SHORT, "--payload", "0.1", "--drop-out", "0.05")
    alone, kept = cli(*words), cli(*words, "--out", tmp_path)
    assert alone.code == kept.code == 0
    assert alone.out == kept.out
    (table, again) = (json.loads(cli(*words, "--json", *more).out) for more in ((), ("--out", tmp_path)))
    assert table == again == json.loads((tmp_path / "metrics.json").read_text())


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("comp", {"compare"}),
        ("run anthro", {ARM}),
        ("run ur5 --pay", {"--payload", "--payload-range"}),
        ("compare ur5 --encoder", {"--encoder-bits", "--encoder-side"}),  # declared by a sensor, a plant
    ],
)
def test_a_shell_completes_commands_robots_and_all_options(words: str, expected: set[str]) -> None:
    asked = {"_ARMGPI_COMPLETE": "complete_bash", "COMP_WORDS": f"armgpi {words}"}
    asked["COMP_CWORD"] = str(len(words.split()))
    code = "import sys; sys.argv = ['armgpi']; from armgpi.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True
    )
    assert set(done.stdout.split()) == expected


def test_every_command_that_reports_has_json_and_a_page() -> None:
    commands = get_command(app).commands  # type: ignore[attr-defined]
    flags = {
        name: {flag for each in command.params for flag in each.opts} for name, command in commands.items()
    }
    for name in (
        "run",
        "compare",
        "sweep",
        "tune",
        "benchmark controllers",
        "benchmark robots",
        "inspect",
        "validate",
        "loop",
    ):
        assert {"--json", "--report"} <= flags[name], name
    # Whatever loads a URDF by way of the command line is told where its meshes are.
    assert all("--package-dir" in each for each in flags.values() if "--lock" in each)
    assert all({"--controller", "--controllers"} <= each for each in flags.values() if "--controller" in each)


def test_what_is_inspected_and_the_zoo_are_pages_too(
    cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armgpi.health.zoo.HORIZON", 0.5)
    for name, words in {
        "inspect": (ARM,),
        "benchmark robots": (ARM,),
        "validate": ("paper", "--robot", ARM),
    }.items():
        page = tmp_path / f"{name}.html"
        assert cli(name, *words, "--report", page).code == 0
        text = page.read_text()
        assert "<table class=data" in text
        assert str(ROOT) not in text
        assert cli(name, *words, "--report", tmp_path).code == 2  # a folder


def test_doctor_names_every_extra() -> None:
    from armgpi.cli.doctor import _EXTRAS

    declared = (ROOT / "pyproject.toml").read_text().partition("[project.optional-dependencies]")[2]
    extras = set(re.findall(r"^(\w+) = \[", declared.partition("[project.scripts]")[0], re.M))
    # `robots` has a line of its own; these are for who works on armgpi.
    assert set(_EXTRAS) == extras - {"robots", "all", "docs", "dev", "peers"}


def test_help_names_every_command_and_option_and_fits_80_columns(
    cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    listed = cli("--help")
    assert listed.code == 0
    assert {"run", "compare", "robots"} <= set(listed.out.split())
    for name, own in (("run", "--controller"), ("compare", "--controllers")):
        short = cli(name, "--help")
        assert short.code == 0
        assert all(
            option in short.out for option in ("--config", "--to", "--set", "--out", "--help-all", own)
        )
        assert len(re.findall(r"^  -", short.out, re.M)) <= 15  # a dozen that a beginner needs
        helped = cli(name, "--help-all")
        assert helped.code == 0
        for option in (
            *("--config", "--to", "--from", "--duration", "--omega", "--lock", "--keep", "--effort", "--out"),
            *("--inertia-scale", "--payload", "--encoder-bits", "--delay", "--friction", "--dt", "--t-final"),
            *("--seed", "--json", own),
        ):
            assert option in helped.out
        # Units stand in brackets, which a markup language would have eaten.
        assert "[rad/s]" in helped.out
        assert max(map(len, helped.out.splitlines())) <= 80


def test_no_help_shows_a_placeholder(cli: Callable[..., Answer]) -> None:
    for name in ENTRIES:
        assert not re.findall(r"\{[a-z]+\}", cli(name, "--help").out), name


def test_any_key_of_an_experiment_is_set(cli: Callable[..., Answer], tmp_path: Path) -> None:
    out = tmp_path / "out"
    given = (
        "plant.delay=2",
        "plant.payload.mass=0.1",
        "controller.omega=q1=20,q2=25,q3=30",
        "plant.engine=armgpi",
        "plant.loads=[{type: step, amplitude: 2, onset: 0.1}]",
    )
    words = [word for each in given for word in ("--set", each)]
    done = cli(
        "compare", "anthropomorphic3", "--t-final", "0.01", "--controllers", "gpi,gpi", *words, "-o", str(out)
    )
    assert done.code == 0, done.err
    found = config.read(out / "experiment.yaml").config
    assert found.plant.plain()["delay"] == 2
    assert found.plant.plain()["payload"]["mass"] == 0.1
    assert [each.type for each in found.plant.loads] == ["step"]
    wanted = {"q1": 20.0, "q2": 25.0, "q3": 30.0}
    assert [each.omega for each in found.controllers] == [wanted] * 2


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("plant.dely=2", "--set plant.dely: there is no key named 'dely'; did you mean 'delay'"),
        ("plant.delay=-1", "--set plant.delay: expected 0 or more, got -1"),
        ("plant.delay", "--set: expected KEY=VALUE"),
        ("controller.omega.3=2", "omega"),
        ("plant.loads=[{type: step", "--set:1: is not valid YAML"),
        ("sample_time.0=2", "--set: the experiment has no 'sample_time.0'"),
    ],
)
def test_a_key_that_cannot_be_set_is_named(cli: Callable[..., Answer], word: str, said: str) -> None:
    done = cli("run", "anthropomorphic3", "--dt", "0.001", "--set", word)
    assert done.code == 2
    assert said in done.err
    assert "Traceback" not in done.err


def test_without_a_command_the_help_is_shown(cli: Callable[..., Answer]) -> None:
    assert "\nSimulate:\n" in "".join(cli()[1:])


def test_the_version_is_shown(cli: Callable[..., Answer]) -> None:
    assert cli("--version") == Answer(0, f"armgpi {armgpi.__version__}\n", "")


@pytest.mark.slow
def test_robots_are_listed_with_what_to_know_of_them(
    cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, err = cli("robots")
    assert (code, err) == (0, "")
    assert [line.split()[0] for line in out.splitlines()] == list(names())
    quick = json.loads(cli("robots", "--json").out)
    assert tuple(row["name"] for row in quick) == names()
    # Loading each takes half a second.
    few = ("ur5", "z1", "double_pendulum", "kinova", "ur3", "baxter_left_arm")
    monkeypatch.setattr("armgpi.robot.robots.names", lambda: few[:2])
    code, out, err = cli("robots", "--check")
    assert (code, err) == (0, "")
    assert [line.split()[0] for line in out.splitlines() if line[0] != " "] == ["name", *few[:2]]
    monkeypatch.setattr("armgpi.robot.robots.names", lambda: few)
    code, out, _ = cli("robots", "--check", "--json")
    rows = {row["name"]: row for row in json.loads(out)}
    assert code == 0
    assert tuple(rows) == few
    assert (rows["ur5"]["n"], rows["ur5"]["effort"], rows["ur5"]["remarks"]) == (6, [28.0, 150.0], [])
    assert "gripper: --lock jointGripper" in rows["z1"]["remarks"]
    assert "effort limit 0: --effort" in rows["double_pendulum"]["remarks"]
    assert "0 outside limits" in rows["kinova"]["remarks"]
    assert any("ur10" in remark for remark in rows["ur3"]["remarks"])
    assert len(rows["kinova"]["continuous"]) == 3
    assert "head_pan" in rows["baxter_left_arm"]["locked"]


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_robot_that_does_not_load_fails_the_check(
    options: tuple[str, ...], cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    def inspect(name: str) -> Any:
        raise armgpi.errors.NameNotFound("mesh", name, ())

    monkeypatch.setattr("armgpi.robot.robots.names", lambda: ("ur5",))
    monkeypatch.setattr("armgpi.health.report.inspect", inspect)
    code, out, err = cli("robots", "--check", *options)
    assert code == 1
    assert "ur5" in out
    assert "1 robot cannot be loaded: ur5" in err


# --- Looking at robots and at the installation ---------------------------------------------------


def test_inspect_says_what_a_robot_is_and_exits_by_what_it_finds(cli: Callable[..., Answer]) -> None:
    code, out, err = cli("inspect", "ur5", "--cross-check")
    assert (code, err.startswith("world: realistic: "), len(err.splitlines())) == (0, True, 1)
    assert out.startswith("ur5: 6 joints, ")
    assert "cross-check: yourdfpy reads the same" in out
    # The wrists of the UR5 in example-robot-data: their centres of mass, and 0.22 kg m^2 of 0.19 kg.
    assert "0 errors, 2 warnings, " in out
    code, out, _ = cli("inspect", "double_pendulum")
    assert code == 1
    assert "error: each of joints 'joint1', 'joint2': has effort limit 0" in out
    assert "--effort joint1=10" in out
    assert cli("inspect", "double_pendulum", "--effort", "10").code == 0


def test_inspect_takes_the_side_of_the_encoders_as_an_option_and_from_a_file(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    file = tmp_path / "ur5.yaml"
    file.write_text("robot: {name: ur5}\nplant: {encoder_side: motor, delay: 1, encoder_bits: 16}\n")
    found = {
        name: json.loads(cli("inspect", *given, "--json").out)["gpi_auto"]["omega_c"]
        for name, given in {
            "option": ("ur5", "--encoder-side", "motor"),
            "file": (file,),
            "option over file": (file, "--encoder-side", "link"),
            "link": ("ur5", "--encoder-side", "link"),
        }.items()
    }
    assert found["option"] == found["file"] != found["link"] == found["option over file"]
    code, out, err = cli("inspect", "ur5", "--encoder-side", "gear")
    assert (code, out) == (2, "")
    assert err == "error: command line: --encoder-side: must be one of motor, link, got 'gear'\n"
    code, out, err = cli("inspect", "pandas")
    assert (code, out) == (2, "")
    assert "did you mean 'panda'" in err


def test_a_law_that_sits_at_its_torque_limit_is_not_called_finished_alone(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    page = tmp_path / "r.html"
    heavy = cli("run", ARM, "--payload", "50", "--t-final", "1", "--report", page)
    assert re.search(
        r"gpi: finished, at its torque limit: .*q2 for \d+ %.* of the time; measures", heavy.out, re.S
    )
    assert "<span class=fair>finished, at its torque limit: " in page.read_text(encoding="utf-8")
    light = cli("run", ARM, "--t-final", "1", "--report", page)
    assert "gpi: finished; measures" in light.out
    assert "<span class=good>finished</span>" in page.read_text(encoding="utf-8")


def test_inspect_takes_locks_as_run_does(cli: Callable[..., Answer]) -> None:
    code, out, _ = cli("inspect", "panda", "--lock", "panda_finger_joint1=0.01", "--json")
    report = json.loads(out)
    assert (code, report["n"]) == (0, 7)
    assert report["locked"] == {"panda_finger_joint1": 0.01, "panda_finger_joint2": 0.01}
    assert {f["kind"] for f in report["findings"] if f["level"] != "info"} == {"shape-mass"}
    assert json.loads(cli("inspect", "panda", "--mimic", "follow", "--json").out)["n"] == 8
    assert json.loads(cli("inspect", "panda", "--keep", "panda_joint1", "--json").out)["n"] == 1
    code, _, err = cli("inspect", "panda", "--mimic", "free")
    assert (code, "one of lock, follow" in err) == (2, True)
    code, _, err = cli("inspect", "panda", "--package-dir", "nowhere")
    assert (code, "there is no folder 'nowhere'" in err) == (2, True)


def test_an_arm_that_cannot_hold_itself_where_it_starts_is_not_run(cli: Callable[..., Answer]) -> None:
    # The middle of the joint ranges: the default move starts where the motors hold the arm.
    start = ("--from", "0.785,0.436,1.55,-1.161,0,-1.047,0", "--to", "l_shoulder_pan_joint=0.8")
    code, _, err = cli("run", "pr2_left_arm", *SHORT, *start)
    assert code == 2
    assert "the torque that holds the arm at the start of joint 'l_shoulder_lift_joint' is -39.7" in err
    assert "--effort l_shoulder_lift_joint=59.6" in err
    assert cli("run", "pr2_left_arm", *SHORT, *start, "--effort", "l_shoulder_lift_joint=60").code == 0
    assert cli("run", "pr2_left_arm", *SHORT).code == 0


def test_mimic_joints_follow_when_asked(cli: Callable[..., Answer]) -> None:
    code, out, err = cli("run", "panda", *SHORT, "--mimic", "follow", "--json")
    assert code == 0
    assert "warning" not in err
    assert len(json.loads(out)[0]["joints"]) == 8


def test_doctor_finds_this_installation_healthy(
    cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONPATH", raising=False)
    code, out, err = cli("doctor")
    assert (code, err) == (0, "")
    assert "loads our arm" in out
    checks = {check["what"]: check for check in json.loads(cli("doctor", "--json").out)}
    assert {check["level"] for check in checks.values()} <= {"ok", "info"}
    assert checks["example-robot-data"]["found"].startswith("6.")


def test_another_pinocchio_is_named_without_a_traceback(tmp_path: Path) -> None:
    # PyPI's `pinocchio` is a plug-in for nose; a broken one does not import.
    (tmp_path / "pinocchio").mkdir()
    for content, said in (
        ("", "another package named pinocchio"),
        ("raise ImportError('libx.so')", "libx.so"),
    ):
        (tmp_path / "pinocchio" / "__init__.py").write_text(content)
        path = os.pathsep.join((str(tmp_path), str(ROOT)))
        for command, code in (("inspect ur5", 2), ("doctor", 1)):
            done = subprocess.run(
                [sys.executable, "-m", "armgpi.cli", *command.split()],
                env={**os.environ, "PYTHONPATH": path},
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == code
            assert said.split()[0] in done.stdout + done.stderr
            assert "Traceback" not in done.stderr


def test_doctor_sees_what_shadows_an_installed_package(
    cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "pinocchio").mkdir()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    code, out, _ = cli("doctor")
    assert code == 1
    assert f"error PYTHONPATH: hides installed packages by pinocchio in {tmp_path}" in out


# Runs.


@pytest.mark.parametrize(
    ("arguments", "joints"),
    [
        (["ur5"], 6),
        (["panda", *FINGERS], 7),
        (["panda", "--lock", "panda_finger_joint1,panda_finger_joint2"], 7),
        (["panda", "--keep", "panda_joint2", "--keep", "panda_joint4"], 2),
        (["panda", *FINGERS, "--lock", "panda_joint7=0.5"], 6),
        ([ARM], 3),
        (["xarm7", "--friction", "urdf"], 7),
        (["double_pendulum", "--effort", "3", "--ideal"], 2),
    ],
)
def test_a_robot_runs_with_no_tuning(arguments: list[str], joints: int, cli: Callable[..., Answer]) -> None:
    answer = cli("run", *arguments, "--t-final", "0.1", "--json")
    assert answer.code == 0
    (record,) = json.loads(answer.out)
    assert len(record["joints"]) == joints
    assert record["status"] == "finished"
    assert max(record["metrics"]["peak_error"]) < 0.01


def test_a_path_with_spaces_is_a_robot(cli: Callable[..., Answer], tmp_path: Path) -> None:
    folder = tmp_path / "my robots"
    folder.mkdir()
    path = folder / "my arm.urdf"
    path.write_text((ROOT / "urdf" / "anthropomorphic3.urdf").read_text())
    assert cli("run", path, *SHORT).code == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("to", "goal"),
    [
        ("q1=0.8,q2=0.4,q3=-0.4", [0.8, 0.4, -0.4]),
        (" q3 = -0.4 , q1 = 0.8 ", [0.8, None, -0.4]),
        ("0.8,0.4,-0.4", [0.8, 0.4, -0.4]),
        ("-0.8, 4e-1, -.4", [-0.8, 0.4, -0.4]),
        ("0.5", [0.5, 0.5, 0.5]),
        ("-0.5", [-0.5, -0.5, -0.5]),
    ],
)
@pytest.mark.parametrize("start", [None, "q1=0.1", "0.1,0.2,0.3"])
def test_to_and_from_are_postures(
    to: str, goal: list[float | None], start: str | None, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    begin = [] if start is None else ["--from", start]
    answer = cli("run", ARM, "--to", to, *begin, "--duration", "0.01", "--t-final", "1.02", "--out", tmp_path)
    assert answer.code in (0, 1)  # nobody follows so fast a move
    reference = load(tmp_path / "rollout.nc")["q_ref"].isel(rollout=0).values
    first = armgpi.default_move(armgpi.Robot.load(ARM)).at(0.0).q
    if start is not None:
        first = np.array([0.1, *first[1:]] if "=" in start else [0.1, 0.2, 0.3])
    np.testing.assert_allclose(reference[0], first, atol=1e-15)
    np.testing.assert_allclose(reference[999], first, atol=1e-15)  # stands for a second
    last = [old if new is None else new for old, new in zip(first, goal, strict=True)]
    np.testing.assert_allclose(reference[-1], last, atol=1e-15)


@pytest.mark.parametrize("plant", ["armgpi", "mujoco", "elastic"])
def test_a_plant_with_stiff_gears_is_told_from_an_arm_whose_gears_twist(
    plant: str, cli: Callable[..., Answer]
) -> None:
    if "ur5" not in names():
        pytest.skip("the robots extra is not installed")
    if plant == "mujoco":
        pytest.importorskip("mujoco")
    answer = cli("run", "ur5", "--controller", "gpi_auto", "--plant", plant, *SHORT)
    assert answer.code == 0, answer.err
    assert "rotors assumed, " in answer.err.splitlines()[0]
    assert "Values: --explain" in answer.err.splitlines()[0]
    assert (f"the plant {plant} simulates stiff joints" in answer.err) == (plant != "elastic")


def written(folder: Path) -> Any:
    return armgpi.config.read(folder / "experiment.yaml").config


def test_options_mean_what_they_say(cli: Callable[..., Answer], tmp_path: Path) -> None:
    answer = cli(
        *(
            "run",
            ARM,
            "--controller",
            "gpi",
            "--omega",
            "q1=15,q2=20",
            "--inertia-scale",
            0.8,
            "--payload",
            0.1,
            "--encoder-bits",
            14,
        ),
        *(
            "--delay",
            2,
            "--dt",
            2e-3,
            "--seed",
            5,
            "--effort",
            "q3=7",
            "--friction",
            "urdf",
            "--out",
            tmp_path,
            *SHORT,
        ),
    )
    assert answer.code == 0
    made = json.loads(load(tmp_path / "rollout.nc").attrs["provenance"])["gpi"]
    default = armgpi.default_omega(2e-3, 4e-3)
    assert made["controller"]["gains"]["omega_c"] == [15.0, 20.0, default]
    assert made["controller"]["robot"]["changes"][-1] == {"inertia_scale": 0.8}
    assert made["controller"]["dt"] == 2e-3
    assert made["controller"]["delay"] == 4e-3
    assert made["controller"]["effort"] == [30.0, 30.0, 7.0]
    assert made["plant"]["robot"]["changes"][-1]["payload"]["mass"] == 0.1
    wires = {wire.pop("type"): wire for wire in made["plant"]["io"]}
    assert wires["Encoder"]["bits"] == 14
    assert wires["Delayed"]["samples"] == 2
    assert made["plant"]["friction"] is not None
    assert written(tmp_path).seed == 5


def test_options_override_the_file_and_leave_the_rest(cli: Callable[..., Answer], tmp_path: Path) -> None:
    answer = cli(
        *(
            "compare",
            "--config",
            DEMO,
            "--omega",
            25,
            "--payload",
            0.1,
            "--duration",
            2,
            "--inertia-scale",
            1.2,
        ),
        *(*SHORT, "--out", tmp_path),
    )
    assert answer.code == 0
    config, demo = written(tmp_path), armgpi.config.read(Path(DEMO)).config
    assert [section.label for section in config.controllers] == ["GPI", "PID + inversion"]
    assert config.controllers[0].omega == 25.0
    assert config.controllers[1].kp == demo.controllers[1].kp == 1200.0
    assert {section.inertia_scale for section in config.controllers} == {1.2}
    assert config.plant.payload.mass == 0.1
    assert config.plant.loads == demo.plant.loads
    assert config.reference.points == demo.reference.points
    assert config.reference.durations == 2.0
    assert config.t_final == 0.02


def test_an_option_can_take_back_what_the_file_says(cli: Callable[..., Answer], tmp_path: Path) -> None:
    file = tmp_path / "e.yaml"
    plant = "{friction: urdf, payload: {mass: 1, com: [0, 0, 0.1]}}"
    file.write_text(f"robot: {{name: {ARM}, lock: [q3]}}\nplant: {plant}\n")
    assert (
        cli(
            "run", "--config", file, "--friction", "none", "--payload", 0.2, *SHORT, "--out", tmp_path / "a"
        ).code
        == 0
    )
    plant = written(tmp_path / "a").plant
    assert plant.friction == "none"
    assert (plant.payload.mass, plant.payload.com) == (0.2, [0.0, 0.0, 0.1])
    # Another robot is another robot: what the file says of its own is gone.
    assert cli("run", ARM, "--config", file, *SHORT, "--out", tmp_path / "b").code == 0
    assert written(tmp_path / "b").robot.lock == []


@pytest.mark.parametrize(
    ("name", "label"),
    [
        (None, "GPI"),
        ("pid_positions", "PID + inversion"),
        ("gpi", "GPI"),
        ("PID + inversion", "PID + inversion"),
    ],
)
def test_a_controller_of_the_file_is_chosen_by_type_or_label(
    name: str | None, label: str, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    chosen = [] if name is None else ["--controller", name]
    answer = cli("run", "--config", DEMO, *chosen, *SHORT, "--json", "--out", tmp_path)
    assert [record["label"] for record in json.loads(answer.out)] == [label]
    assert [section.label for section in written(tmp_path).controllers] == [label]


@pytest.mark.parametrize(
    ("arguments", "labels"),
    [
        ([], ["gpi", "pid"]),
        (["--controllers", "pid,gpi"], ["pid", "gpi"]),
        (["--controllers", "gpi"], ["gpi"]),
        (["--controllers", "gpi,gpi"], ["gpi", "gpi 2"]),
    ],
)
def test_a_comparison_has_the_controllers_asked_for(
    arguments: list[str], labels: list[str], cli: Callable[..., Answer]
) -> None:
    records = json.loads(cli("compare", ARM, *arguments, *SHORT, "--json").out)
    assert [record["label"] for record in records] == labels
    seen = {"gpi": "Measurement", "pid": "FullState"}
    assert [record["measurement"] for record in records] == [seen[label[:3]] for label in labels]


def test_a_run_that_ends_before_its_move_says_so(cli: Callable[..., Answer]) -> None:
    assert "the run ends at 0.02 s, the last move at" in cli("run", ARM, *SHORT).err
    whole = cli("run", ARM, "--to", "0.3", "--duration", "0.5", "--t-final", "1.5")
    assert [line.partition(":")[0] for line in whole.err.splitlines()] == ["world"]


def test_one_position_is_said_to_be_that_of_all_joints(cli: Callable[..., Answer]) -> None:
    assert "; --to 0.3 for all 3 joints" in cli("run", ARM, "--to", "0.3", *SHORT).err
    both = cli("run", ARM, "--from", "0.1", "--to", "0.2", *SHORT).err
    assert "; --from 0.1 and --to 0.2 for all 3 joints" in both
    assert "for all" not in cli("run", ARM, "--to", "q1=0.3", *SHORT).err


# What comes out.


def test_json_is_all_there_is_on_stdout(cli: Callable[..., Answer], tmp_path: Path) -> None:
    # With a warning (the fingers mimic each other), a note and files on the side.
    answer = cli("run", "panda", *SHORT, "--json", "--out", tmp_path)
    assert answer.code == 0
    assert "warning: " in answer.err
    assert "wrote " in answer.err
    (record,) = json.loads(answer.out)
    table = metrics.summary(load(tmp_path / "rollout.nc")).isel(rollout=0)
    for name in metrics.ALL:
        np.testing.assert_array_equal(record["metrics"][name], table[name])
    assert json.loads((tmp_path / "metrics.json").read_text()) == [record]


def test_a_load_is_at_the_hand_of_an_arm_whose_fingers_move(cli: Callable[..., Answer]) -> None:
    # At the tip of a finger of 15 g it would be lost within 1.9 s.
    answer = cli("run", "panda", "--payload", 0.25, "--t-final", 2.5, "--json")
    assert answer.code == 0
    (record,) = json.loads(answer.out)
    assert max(record["metrics"]["peak_error"]) < 0.01
    assert "the load is at 'panda_hand_tcp'" in answer.err
    assert "--lock panda_finger_joint1" in answer.err


def test_a_folder_makes_the_rollout_again_bit_by_bit(cli: Callable[..., Answer], tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    options = ("--encoder-bits", 12, "--delay", 1, "--payload", 0.3, "--seed", 3, "--inertia-scale", 1.1)
    assert cli("compare", "ur5", *options, "--t-final", 0.3, "--out", first).code == 0
    assert cli("compare", "--config", first / "experiment.yaml", "--out", second).code == 0
    one, other = load(first / "rollout.nc"), load(second / "rollout.nc")
    assert one.identical(other)
    for name in SAMPLED:
        assert one[name].values.tobytes() == other[name].values.tobytes()
    for file in first.iterdir():
        assert file.read_bytes() == (second / file.name).read_bytes(), file.name


def test_a_robot_given_by_path_is_kept_with_the_rollout(
    cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "mine.urdf").write_text((ROOT / "urdf" / "anthropomorphic3.urdf").read_text())
    monkeypatch.chdir(tmp_path)
    assert cli("run", "robots/mine.urdf", *SHORT, "--out", "results").code == 0
    monkeypatch.chdir(tmp_path / "robots")
    assert cli("run", "--config", "../results/experiment.yaml", "--out", "../again").code == 0
    one, other = load(tmp_path / "results" / "rollout.nc"), load(tmp_path / "again" / "rollout.nc")
    for name in SAMPLED:
        assert one[name].values.tobytes() == other[name].values.tobytes()


def long_names(tmp_path: Path) -> tuple[str, list[str]]:
    """A robot whose joints have names longer than half a terminal, with what Rich takes for markup."""
    joints = [f"[bold]{word}[/]_{'x' * 50}_:smile:" for word in ("first", "second")]
    links = "".join(
        f'<link name="l{i}"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="{joint}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="99" velocity="3"/></joint>'
        for i, joint in enumerate(joints, start=1)
    )
    path = tmp_path / "long.urdf"
    path.write_text(f'<robot name="[red]arm[/red]"><link name="l0"/>{links}</robot>')
    return str(path), joints


@pytest.mark.parametrize("columns", [80, 100, 200])
def test_tables_fit_the_terminal_with_whole_names_and_numbers(
    columns: int, cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path, odd = long_names(tmp_path)
    monkeypatch.setenv("COLUMNS", str(columns))
    for arguments, joints in (
        (("run", "ur5"), None),
        (("compare", "kinova"), None),
        (("compare", path), odd),
    ):
        answer = cli(*arguments, *SHORT)
        assert answer.code == 0
        table, _, _ = answer.out.partition("Next:")  # commands to copy are not folded
        lines = table.splitlines()
        assert max(map(cell_len, lines)) <= columns
        assert "…" not in answer.out
        known = joints or json.loads(cli(*arguments, *SHORT, "--json").out)[0]["joints"]
        # Folded names run on in the cell below.
        cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if "│" in line]
        number = 0 if arguments[0] == "run" else 1
        assert "".join(row[number] for row in cells).startswith("".join(known))


@pytest.mark.parametrize("columns", [60, 80, 120, 200])
def test_the_table_of_inspect_has_whole_names_and_columns_at_any_width(
    columns: int, cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    joints = armgpi.Robot.load("ur5").joint_names
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = [line for line in cli("inspect", "ur5").out.splitlines() if set(line) & set("│┃━")]
    assert len({cell_len(line) for line in lines}) <= 2  # of a table in two parts
    assert max(map(cell_len, lines)) <= max(columns, 80)
    assert not any("…" in line for line in lines)
    names = [line.split("│")[1].strip() for line in lines if "│" in line]
    assert "".join(names) == "".join(joints) * (1 if columns == 200 else 2)
    assert all(heading in "".join(lines) for heading in ("type", "effort", "inertia", "damping", "encoder"))


def test_a_terminal_far_too_narrow_gets_whole_numbers(
    cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    answer = cli("run", ARM, "--t-final", "1.5")
    assert answer.code == 0
    assert "…" not in answer.out


def test_a_terminal_without_our_letters_gets_others() -> None:
    with command("run", ARM, *SHORT, env={**os.environ, "PYTHONIOENCODING": "ascii"}) as process:
        out, err = process.communicate(timeout=200)
    assert process.returncode == 0
    assert out.isascii()
    assert "Traceback" not in err


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
@pytest.mark.parametrize("arguments", [["robots"], ["run", ARM, *SHORT], ["run", ARM, *SHORT, "--json"]])
def test_an_output_that_is_full_is_an_error_of_one_line(arguments: list[str]) -> None:
    with open("/dev/full", "w") as full:
        whole = [sys.executable, "-m", "armgpi.cli", *arguments]
        done = subprocess.run(whole, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert "error: cannot write the output" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_reader_that_goes_away_costs_no_files(tmp_path: Path) -> None:
    with command("run", ARM, *SHORT, "--out", tmp_path) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        err = process.stderr.read()
    assert "Traceback" not in err
    assert load(tmp_path / "rollout.nc").sizes["time"] == 21


# Exit codes.


def test_a_rollout_that_diverges_exits_with_1_and_says_when(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    options = ("--omega", 3000, "--effort", 1e9, "--t-final", 2, "--out", tmp_path)
    answer = cli("run", ARM, *options)
    assert answer.code == 1
    assert "diverged at 0." in answer.out
    assert "warning: omega_c = 3000 rad/s is too fast" in answer.err
    assert load(tmp_path / "rollout.nc")["status"] == Status.DIVERGED
    both = cli("compare", ARM, *options, "--force", "--json")
    assert both.code == 1
    assert [record["status"] for record in json.loads(both.out)] == ["diverged", "finished"]


def processor_time(process: int) -> float:
    """Return the processor time of a process [s]; the time on the wall where nothing tells that."""
    try:
        numbers = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return time.monotonic()
    return (int(numbers[11]) + int(numbers[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "inherited", "sent", "code"),
    [
        ("run", signal.default_int_handler, [signal.SIGINT], 130),
        ("compare", signal.default_int_handler, [signal.SIGINT], 130),
        # In the background of a shell, which has Ctrl-C ignored.
        ("run", signal.SIG_IGN, [signal.SIGINT, signal.SIGTERM], 143),
    ],
)
def test_a_signal_keeps_what_is_there_and_exits_with_its_code(
    name: str, inherited: Any, sent: list[signal.Signals], code: int, tmp_path: Path
) -> None:
    before = signal.signal(signal.SIGINT, inherited)
    try:
        process = command(
            name, ARM, "--t-final", 1000, "--backend", "numpy", "--out", tmp_path / "out", "--json"
        )
    finally:
        signal.signal(signal.SIGINT, before)
    with process:
        # The folder is made right before the run begins; the run would take half a minute.
        while not (tmp_path / "out").exists():
            assert process.poll() is None
            time.sleep(0.02)
        # Not by the clock: on a busy machine the process may get no turn for a while.
        begun = processor_time(process.pid)
        while processor_time(process.pid) < begun + 0.7:
            time.sleep(0.02)
        for number in sent:
            process.send_signal(number)
        out, err = process.communicate(timeout=200)
    assert process.returncode == code
    assert "Traceback" not in err
    assert "interrupted at t = " in err
    (record,) = json.loads(out)
    assert record["status"] == "interrupted"
    rollout = load(tmp_path / "out" / "rollout.nc")
    assert rollout["status"] == Status.INTERRUPTED
    samples = rollout.sizes["time"]
    assert 0 < samples < 1_000_000
    np.testing.assert_allclose(rollout["t_end"], [samples * 1e-3])
    assert np.isfinite(rollout["q"]).all()
    assert (tmp_path / "out" / "experiment.yaml").is_file()


@pytest.mark.parametrize("error", [ImportError, ValueError, SystemError, SystemExit, KeyboardInterrupt])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_ends_in_another_error_has_its_exit_code_all_the_same(
    number: int, error: type[BaseException], cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A library's import says that it failed; a file that is being closed, that it is none."""

    def interrupt(*_: Any, **__: Any) -> None:
        try:
            os.kill(os.getpid(), number)
        except KeyboardInterrupt:
            raise error(2) from None

    monkeypatch.setattr("armgpi.config.build", interrupt)
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    assert cli("run", ARM).code == 128 + number
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("begins", [True, False])
def test_a_signal_has_its_exit_code_while_the_handlers_are_set_and_set_back(
    number: int, begins: bool, cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    usual = signal.signal

    def set_handler(each: int, handler: Any) -> Any:
        own = handler not in before.values()
        if each == number and not (own or begins):
            signal.raise_signal(number)  # which counts: the handler is not set back yet
        previous = usual(each, handler)
        if each == number and own and begins:
            signal.raise_signal(number)
        return previous

    monkeypatch.setattr(signal, "signal", set_handler)
    monkeypatch.setattr(signal, "getsignal", lambda each: before[each])
    monkeypatch.setattr(signal, "default_int_handler", before[signal.SIGINT])
    try:
        assert cli("--version").code == 128 + number
    finally:
        for each, handler in before.items():
            usual(each, handler)


@pytest.mark.parametrize("where", ["armgpi.config.build", "armgpi.config.experiment.save"])
def test_ctrl_c_outside_of_the_simulation_exits_with_130(
    where: str, cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(where, interrupted)
    answer = cli("run", ARM, *SHORT, "--out", tmp_path)
    assert answer.code == 130
    assert answer.err.endswith("interrupted\n")


BAD: dict[str, tuple[list[str], str]] = {
    "no robot": (["run"], "name a robot"),
    "an unknown robot": (["run", "pandaa"], "ROBOT: there is no robot named 'pandaa'; did you mean 'panda'"),
    "a missing file": (["run", "none.urdf"], "none.urdf: there is no such file"),
    "a folder": (["run", "/"], "a folder"),
    "a long name": (["run", "a" * 5000], "ROBOT"),
    "two robots": (["run", ARM, ARM], "armgpi run takes one argument, ROBOT, so"),
    "an argument too much": (["doctor", "x"], "armgpi doctor takes no argument, so 'x' is too much"),
    "an unknown command": (["rum", ARM], "there is no command 'rum' (did you mean 'run'?)"),
    "an unknown option": (["run", ARM, "--payloda", "1"], "no option --payloda (did you mean --payload"),
    "another program's option": (["sweep", "x.yaml", "--count", "5"], "--count (did you mean --rollouts?)"),
    "one dash": (["run", ARM, "-omega", "30"], "-omega: names of options have two dashes: --omega"),
    "a unit": (["run", ARM, "--payload", "0.5kg"], "got '0.5kg'; write 0.5 (kg)"),
    "a page of another kind": (["view", ARM, "-o", "arm.avi"], "--out: writes HTML"),
    "an option without value": (["run", ARM, "--payload"], "--payload"),
    "a joint that does not exist": (["run", ARM, "--to", "j1=0.8"], "--to: there is no joint named 'j1'"),
    "too few joints": (["run", ARM, "--to", "1,2"], "--to: expected 3 numbers (q1, q2, q3), got 2"),
    "no numbers": (["run", ARM, "--to", "there"], "--to: expected numbers such as"),
    "nothing": (["run", ARM, "--to", ""], "--to: expected numbers such as"),
    "half a number": (["run", ARM, "--to", "q1="], "--to: expected numbers such as"),
    "names and numbers": (["run", ARM, "--to", "q1=1,2"], "--to: expected numbers such as"),
    "a joint twice": (["run", ARM, "--to", "q1=1,q1=2"], "--to: joint 'q1' is a duplicate key"),
    "not a number": (["run", ARM, "--to", "nan"], "--to: expected a finite number"),
    "a goal outside the limits": (["run", ARM, "--to", "q1=9"], "--to: point 2 of the reference"),
    "a start outside the limits": (["run", ARM, "--to", "0", "--from", "9"], "--from: point 1"),
    "a start without goal": (["run", ARM, "--from", "0"], "--from: requires --to"),
    "a negative duration": (["run", ARM, "--duration", "-1"], "--duration: expected a number above 0"),
    "dt = 0": (["run", ARM, "--dt", "0"], "--dt: expected 1e-09 or more"),
    "dt < 0": (["run", ARM, "--dt", "-1e-3"], "--dt: expected 1e-09 or more"),
    "dt = nan": (["run", ARM, "--dt", "nan"], "--dt: expected a finite number"),
    "dt as text": (["run", ARM, "--dt", "fast"], "--dt"),
    "t_final = 0": (["run", ARM, "--t-final", "0"], "--t-final: expected a number above 0"),
    "t_final = inf": (["run", ARM, "--t-final", "inf"], "--t-final: expected a finite number"),
    "t_final without end": (["run", ARM, "--t-final", "1e300"], "--t-final: expected 0.001 to"),
    "too much for the memory": (["run", ARM, "--t-final", "1e6", "--dt", "1e-3"], "memory"),
    "a negative mass": (["run", ARM, "--payload", "-1"], "--payload: expected 0 or more"),
    "no bits": (["run", ARM, "--encoder-bits", "0"], "--encoder-bits: expected 1 or more"),
    "half a bit": (["run", ARM, "--encoder-bits", "0.5"], "--encoder-bits"),
    "a negative delay": (["run", ARM, "--delay", "-1"], "--delay: expected 0 or more"),
    "a negative seed": (["run", ARM, "--seed", "-1"], "--seed: expected 0 or more"),
    "no inertia": (["run", ARM, "--inertia-scale", "0"], "--inertia-scale: expected a number above 0"),
    "no gain": (["run", ARM, "--omega", "0"], "--omega: expected a number above 0"),
    "the gain of a joint that does not exist": (["run", ARM, "--omega", "q4=1"], "--omega: there is no"),
    "a gain for nobody": (["run", ARM, "--controller", "pid", "--omega", "20"], "--omega: is for gpi"),
    "no torque": (["run", ARM, "--effort", "0"], "--effort: joint 'q1' has effort limit 0"),
    "a robot without torque": (["run", "double_pendulum"], "joint 'joint1' has effort limit 0"),
    "what gives it torque": (["run", "double_pendulum"], "with --effort joint1=10.0,joint2=10.0"),
    "an unknown joint to lock": (["run", ARM, "--lock", "q4"], "--lock: there is no moving joint named 'q4'"),
    "a value to lock at that is none": (["run", ARM, "--lock", "q1=x"], "--lock: expected 'name' or"),
    "an unknown joint to keep": (["run", ARM, "--keep", "q4"], "--keep: there is no moving joint named 'q4'"),
    "all locked": (["run", ARM, "--lock", "q1,q2,q3"], "no moving joint left"),
    "an unknown controller": (["run", ARM, "--controller", "lqr"], "--controller: there is no"),
    "no controller": (["compare", ARM, "--controllers", "gpi,"], "there is no controller named ''"),
    "two controllers to run": (["run", ARM, "--controller", "gpi,pid"], "use armgpi compare"),
    "a missing experiment": (["run", "--config", "none.yaml"], "none.yaml: there is no such file"),
    "a robot for an experiment": (["run", "--config", "urdf/anthropomorphic3.urdf"], "anthropomorphic3.urdf"),
    "a file for a folder": (["run", ARM, "--out", "README.md"], "README.md: cannot be written to"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input_exits_with_2_and_names_what_and_where(
    case: str, cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    arguments, named = BAD[case]
    answer = cli(*arguments)
    assert answer.code == 2
    assert answer.out == ""
    assert named in answer.err
    if answer.err.startswith("error: "):
        assert answer.err.count("\n") == 1


def test_an_unknown_key_in_the_file_is_named_with_its_line(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    file = tmp_path / "e.yaml"
    file.write_text(f"robot:\n  name: {ARM}\nplant:\n  encoder_bit: 16\n")
    answer = cli("run", "--config", file)
    assert answer.code == 2
    assert answer.err.startswith(f"error: {file}:4: plant.encoder_bit: there is no key named 'encoder_bit'")


def test_of_file_and_option_the_one_that_is_wrong_is_named(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    file = tmp_path / "e.yaml"
    text = f"robot:\n  name: {ARM}\ncontrollers:\n- type: gpi\n- type: pid\n  kp: [1, 2]\n"
    file.write_text(text)
    # In the file, also where the options have chosen among its controllers.
    for arguments in (["compare"], ["compare", "--controllers", "pid"], ["run", "--controller", "pid"]):
        answer = cli(*arguments, "--config", file, *SHORT)
        assert answer.code == 2
        assert f"error: {file}:6: controllers." in answer.err
        assert "kp: expected 3 numbers" in answer.err
    answer = cli("run", "--config", file, "--omega", "1,2")
    assert "error: command line: --omega: expected 3 numbers" in answer.err


def test_results_never_overwrite_the_file_they_are_made_from(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    file = tmp_path / "experiment.yaml"
    text = f"robot: {{name: {ARM}}}  # a remark that would be lost\n"
    file.write_text(text)
    answer = cli("run", "--config", file, *SHORT, "--out", tmp_path)
    assert answer.code == 2
    assert "--out: would overwrite" in answer.err
    assert file.read_text() == text


def test_a_folder_that_cannot_be_used_is_found_before_the_run(
    cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")

    def never(*_: object) -> None:
        raise AssertionError("it ran")

    monkeypatch.setattr("armgpi.config.experiment.record", never)
    assert cli("run", ARM, "--out", tmp_path / "file" / "below").code == 2


# Whatever is typed: an answer, never a traceback.

TEXTS = st.one_of(
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8),
    st.text("q123=,.-+einfa[] ", max_size=10),
)
VALUES = {
    "--to": TEXTS,
    "--from": TEXTS,
    "--omega": TEXTS,
    "--effort": TEXTS,
    "--lock": TEXTS,
    "--keep": TEXTS,
    "--controller": TEXTS,
    "--config": TEXTS.map(lambda text: f"no-such-folder/{text}"),
    "--dt": st.sampled_from(["0", "nan", "-1", "x", "", "1e400", "inf", "1e-3", "1,5", "0x1"]),
    "--duration": st.sampled_from(["0", "nan", "-1", "x", "", "1e400", "1e-9", "1e9", "1"]),
    "--inertia-scale": st.sampled_from(["0", "nan", "x", "1e400", "1e-300", "1e300", "0.9"]),
    "--payload": st.sampled_from(["0", "nan", "x", "1e400", "1e-300", "1e300", "0.5"]),
    "--encoder-bits": st.sampled_from(["0", "x", "1", "52", "1e3", "99999999999999999999", "-1", ""]),
    "--delay": st.sampled_from(["0", "x", "10000", "10001", "99999999999999999999", "-1", ""]),
    "--seed": st.sampled_from(["0", "x", "99999999999999999999999999", "-1", ""]),
}
TYPED = st.dictionaries(st.sampled_from(sorted(VALUES)), st.none(), max_size=4).flatmap(
    lambda chosen: st.fixed_dictionaries({option: VALUES[option] for option in chosen})
)


@pytest.mark.slow
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    robot=st.one_of(st.just(ARM), TEXTS),
    typed=TYPED,
    flags=st.sets(st.sampled_from(["--json", "--friction=urdf", "--friction=none", "--friction=3", "--"])),
)
def test_whatever_is_typed_there_is_an_answer(
    robot: str, typed: dict[str, str], flags: set[str], cli: Callable[..., Answer]
) -> None:
    options = [part for option, value in typed.items() for part in (option, value)]
    answer = cli("run", *SHORT, *options, *sorted(flags, reverse=True), robot)
    assert answer.code in (0, 1, 2)
    assert "Traceback" not in answer.err
    if answer.code == 2 or "--json" not in flags:
        return
    json.loads(answer.out)


# The paper.


def test_scenarios_are_listed_printed_and_run_by_name(
    cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cli("scenarios").out.split() == ["scenario-5.1", "scenario-5.2", "scenario-5.3"]
    mine = tmp_path / "mine.yaml"
    mine.write_text(cli("scenarios", "scenario-5.3").out, encoding="utf-8")
    by_name = cli("compare", "--config", "scenario-5.3", "--t-final", "0.01", "--json")
    assert by_name.code == 0
    assert json.loads(by_name.out) == json.loads(
        cli("compare", "--config", mine, "--t-final", "0.01", "--json").out
    )
    monkeypatch.setattr(sys, "argv", ["armgpi", "run", "anthropomorphic3"])  # nothing else was typed
    proposed = cli("run", "--config", "scenario-5.1", "--t-final", "0.01").out.partition("Next:")[2]
    assert "armgpi compare --config scenario-5.1 " in proposed
    assert "armgpi compare scenario-5.1" not in proposed
    for line in proposed.splitlines():
        assert "inspect scenario" not in line
    nothing = cli("scenarios", "scenario-6")
    assert nothing.code == 2
    assert "scenario-5.1" in nothing.err


@pytest.mark.slow
def test_reproduce_writes_tables_and_figures(tmp_path: Path) -> None:
    whole = [sys.executable, "-m", "armgpi.cli", "reproduce", "--quick", "--out", str(tmp_path / "out")]
    done = subprocess.run(whole, capture_output=True, text=True, check=False, timeout=500)
    assert done.returncode == 0, done.stderr
    assert "published cells of the proposal" in done.stdout
    files = {path.name for path in (tmp_path / "out").iterdir()}
    for table in ("table-2-ideal", "table-3-real", "table-4-ideal", "statuses"):
        assert {f"{table}.md", f"{table}.csv", f"{table}.tex"} <= files
    assert {f"figure-{number:02}.png" for number in (5, 6, 7, 9, 10, 11, 12, 13)} <= files
    rows = list(csv.DictReader((tmp_path / "out" / "statuses.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["table"] for row in rows} == {"2", "3", "4"}
    assert {row["status"] for row in rows} <= {"better", "same order", "worse", "diverged", "not stated"}


def test_reproduce_says_that_it_cannot_write(cli: Callable[..., Answer], tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    refused = cli("reproduce", "--quick", "--out", tmp_path / "taken")
    assert refused.code == 2
    assert "cannot be written to" in refused.err


@pytest.mark.parametrize("path", ["lissajous", "circle", "polyline"])
def test_any_arm_follows_a_path_that_is_chosen_for_it(
    cli: Callable[..., Answer], tmp_path: Path, path: str
) -> None:
    done = cli("run", "ur5", "--path", path, "--t-final", "1", "--out", tmp_path, "--json")
    assert done.code == 0, done.err
    assert max(json.loads(done.out)[0]["metrics"]["peak_error"]) < 1e-3
    # The file that was written says where the path is, and is run again to the same end.
    assert written(tmp_path).reference.path.type == path
    again = cli("run", "--config", tmp_path / "experiment.yaml", "--json")
    assert json.loads(again.out) == json.loads(done.out)


def test_a_range_of_payloads_is_believed_in(cli: Callable[..., Answer], tmp_path: Path) -> None:
    done = cli(
        "run",
        "ur10",
        "--ideal",
        "--payload-range",
        "0,0.5",
        "--payload",
        "0.5",
        "--t-final",
        "1.5",
        "--out",
        tmp_path,
    )
    assert done.code == 0, done.err
    first = written(tmp_path).controllers[0]
    assert (first.payload_range.lightest, first.payload_range.heaviest) == (0.0, 0.5)
    assert first.omega == 30.0  # 2.3 times too much inertia leaves 30 rad/s


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--path", "spiral"), "did you mean 'circle'"),
        (("--path", "circle", "--to", "0"), "mutually exclusive"),
        (("--direction", "0,0,-1"), "requires a path"),
        (("--path", "circle", "--direction", "0,0"), "at least 3"),
        (("--path", "circle", "--direction", "0,0,0"), "a direction"),
        (("--payload-range", "0.5"), "LIGHTEST,HEAVIEST"),
        (("--payload-range", "0:0.5"), "LIGHTEST,HEAVIEST such as '0,0.5'"),
        (("--payload-range", "1,0.5"), "--payload-range"),
        (("--payload-range", "0,500"), "no bandwidth is stable"),
        (("--controller", "pid", "--payload-range", "0,1"), "is for gpi"),
    ],
)
def test_paths_and_ranges_that_cannot_be_are_refused(
    cli: Callable[..., Answer], arguments: tuple[str, ...], named: str
) -> None:
    refused = cli("run", "ur5", *arguments)
    assert refused.code == 2
    assert named in refused.err


def test_a_goal_where_the_motors_do_not_hold_the_arm_is_warned_of(cli: Callable[..., Answer]) -> None:
    code, _, err = cli("run", "anthropomorphic3", "--to", "q2=0.1", "--effort", "q2=1.2", "--t-final", "3")
    assert "joint 'q2' needs" in err, err
    assert "--effort q2=" in err
    assert code == 0
    assert "warning" not in cli("run", "anthropomorphic3", *SHORT).err


def test_the_effort_of_joints_may_be_given_one_by_one_as_inspect_proposes_it(
    cli: Callable[..., Answer],
) -> None:
    report = json.loads(cli("inspect", "double_pendulum", "--json").out)
    options = [word for f in report["findings"] if f["level"] == "error" for word in f["option"].split()]
    assert options == ["--effort", "joint1=10", "--effort", "joint2=10"]
    assert cli("inspect", "double_pendulum", *options).code == 0
    assert cli("run", "double_pendulum", "--ideal", *SHORT, *options).code == 0


@pytest.mark.parametrize("mixed", [False, True])
def test_metrics_of_prismatic_joints_have_their_units(
    mixed: bool, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    def joint(name: str, kind: str, parent: str) -> str:
        return (
            f"<link name='{name}_link'><inertial><origin xyz='0.1 0 0'/><mass value='1'/>"
            "<inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial></link>"
            f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{name}_link'/>"
            "<axis xyz='1 0 0'/><limit lower='-1' upper='1' velocity='1' effort='50'/></joint>"
        )

    urdf = tmp_path / "rail.urdf"
    second = joint("swing", "revolute", "rail_link") if mixed else ""
    urdf.write_text(
        f"<robot name='r'><link name='base'/>{joint('rail', 'prismatic', 'base')}{second}</robot>"
    )
    answer = cli("run", urdf, *SHORT)
    assert ("rad s²" in answer.out) is mixed
    assert ("m s²" in answer.out) is not mixed
    assert ("prismatic: rail: m for rad, N for N m" in answer.out) is mixed


# Results belong together.


def test_results_of_another_experiment_are_replaced_only_by_force(
    cli: Callable[..., Answer], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert cli("run", ARM, *SHORT, "--out", out).code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert cli("run", ARM, *SHORT, "--out", out).code == 0  # the same one
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    refused = cli("run", ARM, *SHORT, "--omega", 15, "--out", out)
    assert refused.code == 2
    assert f"--out: {out} holds another experiment; choose another folder, or add --force" in refused.err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert cli("run", ARM, *SHORT, "--omega", 15, "--out", out, "--force").code == 0
    assert (out / "experiment.yaml").read_bytes() != before["experiment.yaml"]
    assert cli("compare", "--config", out / "experiment.yaml", "--out", out / "again").code == 0
    (out / "experiment.yaml").unlink()  # whose rollout it is is not known any more
    assert cli("run", ARM, *SHORT, "--out", out).code == 2


def test_a_report_says_in_its_head_what_was_simulated(cli: Callable[..., Answer], tmp_path: Path) -> None:
    page = tmp_path / "r.html"
    done = cli("compare", ARM, *SHORT, "--out", tmp_path / "run", "--report", page)
    line = next(line for line in done.err.splitlines() if line.startswith("world: "))
    assert f"<p class=summary>{line}</p>" in page.read_text(encoding="utf-8")
    assert cli("report", tmp_path / "run", "-o", tmp_path / "again.html").code == 0
    assert "<p class=summary>world: " in (tmp_path / "again.html").read_text(encoding="utf-8")
    shutil.copy(tmp_path / "run" / "rollout.nc", tmp_path / "alone.nc")
    assert cli("report", tmp_path / "alone.nc", "-o", tmp_path / "alone.html").code == 0
    assert "world: " not in (tmp_path / "alone.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("changed", ["rollout.nc", "experiment.yaml"])
def test_a_mixture_of_two_runs_is_refused_by_the_file_that_differs(
    changed: str, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    assert cli("run", ARM, *SHORT, "--out", one).code == 0
    assert cli("run", ARM, *SHORT, "--omega", 15, "--out", two).code == 0
    assert cli("report", one, "-o", tmp_path / "report.html").code == 0
    (one / changed).write_bytes((two / changed).read_bytes())
    refused = cli("report", one, "-o", tmp_path / "mixed.html")
    assert refused.code == 2
    assert f"{one / changed}: is not the file that {one / 'SHA256SUMS'} names" in refused.err
    assert not (tmp_path / "mixed.html").exists()


@pytest.mark.parametrize("suffix", [".csv", ".md", ".tex"])
def test_a_table_of_metrics_is_written_in_the_format_of_its_name(
    cli: Callable[..., Answer], tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"table{suffix}"
    answer = cli("compare", ARM, *SHORT, "--json", "--table", path)
    assert answer.code == 0
    record, _ = json.loads(answer.out)
    text = path.read_text(encoding="utf-8")
    if suffix == ".csv":
        rows = list(csv.DictReader(text.splitlines()))
        assert [(row["controller"], row["joint"]) for row in rows[:2]] == [("gpi", "q1"), ("gpi", "q2")]
        assert [float(row["ITAE [rad s²]"]) for row in rows[:3]] == record["metrics"]["itae"]
    else:
        cells = [line.strip("| \\").split(" | " if suffix == ".md" else " & ") for line in text.splitlines()]
        q1 = next(row for row in cells if row[0] == "gpi")
        assert float(q1[2]) == float(f"{record['metrics']['itae'][0]:.4g}")
        # Two columns of names, and one for each number.
        numbers = len(q1) - 2
        if suffix == ".md":
            assert text.splitlines()[1] == f"| --- | --- |{' ---: |' * numbers}"
        else:
            assert f"{{ll{'r' * numbers}}}" in text
    code, _, err = cli("compare", ARM, *SHORT, "--table", tmp_path / "table.xlsx")
    assert code == 2
    assert "--table" in err
    assert ".csv, .md, .tex" in err


def test_a_file_for_an_arm_is_begun_and_run_without_any_extra(tmp_path: Path) -> None:
    """`armgpi new`, `run` and `inspect` work in the environment of `make demo`, without a compiler."""
    arm = shutil.copy(ROOT / "urdf" / "anthropomorphic3.urdf", tmp_path / "my_arm.urdf")
    code = """
import sys
for name in ("casadi", "cma", "clarabel", "mujoco", "sympy", "optuna", "matplotlib", "trimesh"):
    sys.modules[name] = None
from armgpi.cli import main
main()
"""
    for words in (["new", str(arm)], ["run", "my_arm.yaml", "--t-final", "0.05"], ["inspect", "my_arm.yaml"]):
        done = subprocess.run(
            [sys.executable, "-c", code, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


def test_help_names_every_target(cli: Callable[..., Answer]) -> None:
    helped = " ".join(cli("export", "--help-all").out.split())
    assert "nothing (bare, the default), callbacks for libfranka (fci), a loop for RTDE (ur)" in helped
    for name, interface in TARGETS.items():
        assert f"{interface.summary} ({name}" in helped
