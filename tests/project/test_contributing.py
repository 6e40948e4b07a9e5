"""The recipes of CONTRIBUTING.md are true: their modules, as plugins, show up wherever the page says so.

Each block whose first line names a file is one; modules and tests go into a folder of their own, which is on
the path of fresh processes and lists the modules as a distribution would.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr

import armgpi
from armgpi.codegen import build
from armgpi.errors import BackendError
from armgpi.loop.provenance import Provenance

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(\w+)\n(?:# (\S+\.\w+)\n)?(.*?)^```$", re.MULTILINE | re.DOTALL)
#: Errands, and the module that a distribution would have for each.
ERRANDS = {
    "controller": "gravity_pd",
    "sensor": "low_pass",
    "plant": "springs",
    "metric": "mean_error",
    "check": "check_case",
}

pytestmark = pytest.mark.slow


class Block(NamedTuple):
    """A fenced block: its language, the file that its first line names (or nothing), its text."""

    language: str
    file: str
    text: str


BLOCKS = [Block(*match.groups(default="")) for match in BLOCK.finditer(PAGE[PAGE.index("## Recipes") :])]
MODULES = dict(zip(ERRANDS.values(), (b for b in BLOCKS if b.file.startswith("armgpi/")), strict=True))
TESTS = [block for block in BLOCKS if block.file.startswith("tests/")]
Run = Callable[..., str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the recipes' files, in which a distribution lists the modules."""
    folder = tmp_path_factory.mktemp("scratch")
    for (name, module), test in zip(MODULES.items(), TESTS, strict=True):
        (folder / f"{name}.py").write_text(module.text, encoding="utf-8")
        here = module.file.removesuffix(".py").replace("/", ".")
        text = test.text.replace(f"from {here} import", f"from {name} import")
        (folder / Path(test.file).name).write_text(text, encoding="utf-8")
    for block in BLOCKS:
        if block.language == "yaml":
            (folder / block.file).write_text(block.text, encoding="utf-8")
    info = folder / "scratch-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: scratch\nVersion: 1.0\n")
    listed = "".join(f"{name} = {name}\n" for name in MODULES)
    (info / "entry_points.txt").write_text(f"[armgpi.plugins]\n{listed}")
    return folder


#: Runs the command lines that it reads, and writes exit code and outputs of each.
COMMANDS = """
import io, json, sys
from contextlib import redirect_stderr, redirect_stdout
from armgpi.cli import main
for line in sys.stdin:
    sys.argv = ["armgpi", *json.loads(line)]
    out, err, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    print(json.dumps([code, out.getvalue(), err.getvalue()]), flush=True)
"""


@pytest.fixture(scope="module")
def run(folder: Path) -> Iterator[Run]:
    """Run Python in that folder, by default the command line; it must succeed.

    All commands are run by one process, which imports once.
    """
    path = os.pathsep.join([str(folder), str(ROOT)])
    there: Any = {"cwd": folder, "env": {**os.environ, "PYTHONPATH": path, "COLUMNS": "200"}, "text": True}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}

    with subprocess.Popen([sys.executable, "-c", COMMANDS], **pipes, **there) as commands:
        assert commands.stdin is not None
        assert commands.stdout is not None

        def call(*arguments: object, module: tuple[str, ...] | None = None) -> str:
            words = [*map(str, arguments)]
            if module is not None:
                done = subprocess.run([sys.executable, *module, *words], capture_output=True, **there)
                code, out, err = done.returncode, done.stdout, done.stderr
            else:
                print(json.dumps(words), file=commands.stdin, flush=True)
                code, out, err = json.loads(commands.stdout.readline())
            assert code == 0, out + err
            return str(out)

        yield call
        commands.stdin.close()


def shown(run: Run, recipe: str) -> dict[str, str]:
    """Run the commands of a recipe and return what each prints, by its first word."""
    text = next(block.text for block in BLOCKS if block.language == "console" and recipe in block.text)
    commands = [shlex.split(line.removeprefix("$ armgpi ")) for line in text.splitlines()]
    return {command[0]: run(*command) for command in commands}


def same_in_c(run: Run, folder: Path, file: str) -> None:
    """Run an experiment by NumPy and as C; both must be the same to rounding."""
    pytest.importorskip("casadi", reason="casadi writes the C")
    try:
        build.compiler()
    except BackendError as error:
        pytest.skip(str(error))
    name = Path(file).stem
    rollouts = []
    for backend in ("numpy", "compiled"):
        run("run", "--config", file, "--backend", backend, "--out", f"{name}_{backend}")
        rollouts.append(armgpi.load(folder / f"{name}_{backend}" / "rollout.nc"))
    by_numpy, compiled = rollouts
    assert Provenance.from_rollout(compiled).first.backend == "compiled"
    # Rounding of 500 samples, as in tests/codegen/test_same_loop.py.
    for variable in ("q", "tau"):
        np.testing.assert_allclose(compiled[variable], by_numpy[variable], rtol=0.0, atol=1e-9)


def test_a_recipe_is_a_module_a_test_and_a_line_of_the_changelog() -> None:
    languages = [block.language for block in BLOCKS if block.file.endswith(".py") or block.text[:2] == "- "]
    assert languages == ["python", "python", "markdown"] * len(ERRANDS)


def test_the_tests_of_the_recipes_pass(run: Run, folder: Path) -> None:
    tests = sorted(path.name for path in folder.glob("test_*.py"))
    assert len(tests) == len(ERRANDS)
    said = run(*tests, "-q", "-p", "no:cacheprovider", "-W", "error", module=("-m", "pytest"))
    assert f"{len(ERRANDS)} passed" in said


def test_the_recipes_have_the_style_of_the_house(tmp_path: Path) -> None:
    for block in BLOCKS:
        if block.language == "python":
            path = tmp_path / block.file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
    for command in (["check"], ["format", "--check"]):
        config = ["--config", str(ROOT / "pyproject.toml"), "--no-cache", "."]
        config += ["--config", "lint.isort.known-first-party = ['armgpi']"] * (command == ["check"])
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *command, *config], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_controller_is_in_files_help_reports_sweeps_searches_pages_and_c(run: Run, folder: Path) -> None:
    helped = run("run", "--help-all")
    assert all(word in helped for word in ("gravity_pd", "--stiffness", "--damping", "[1/s^2]"))
    said = shown(run, "gravity_pd.yaml")
    assert "gravity_pd: finished; measures positions and velocities" in said["compare"]
    assert "gravity_pd" in (folder / "compared.html").read_text(encoding="utf-8")
    gains = (folder / "tuned" / "gains.csv").read_text(encoding="utf-8").splitlines()
    assert [line.partition(",")[0] for line in gains] == ["number", "stiffness", "damping"]
    with xr.open_dataset(folder / "varied" / "results.nc") as results:
        assert "drawn.controller.damping" in results
    assert '"id":"controllers.0.damping"' in (folder / "gravity_pd.html").read_text(encoding="utf-8")
    entries = json.loads((folder / "compared" / "metrics.json").read_text(encoding="utf-8"))
    assert [entry["label"] for entry in entries] == ["gravity_pd", "gpi"]
    provenance = Provenance.from_rollout(armgpi.load(folder / "compared" / "rollout.nc"))
    described = provenance.of("gravity_pd").data["controller"]
    assert (described["stiffness"], described["damping"]) == ([400.0, 300.0, 400.0], [30.0] * 3)
    same_in_c(run, folder, "gravity_pd.yaml")
    code = (folder / "exported" / "armgpi_controller.c").read_text(encoding="utf-8")
    assert "gain of the position error" in code
    assert "of the torque limits from Python" in said["export"]  # the replay; it fails where it differs


def test_the_sensor_is_in_files_help_provenance_and_c(run: Run, folder: Path) -> None:
    assert "--position-lag" in run("run", "--help-all")
    shown(run, "low_pass.yaml")
    written = (folder / "lagging" / "experiment.yaml").read_text(encoding="utf-8")
    assert "position_lag: 0.002" in written
    provenance = Provenance.from_rollout(armgpi.load(folder / "lagging" / "rollout.nc"))
    assert {"type": "LowPass", "time_constant": 0.002} in provenance.first.data["plant"]["io"]
    same_in_c(run, folder, "low_pass.yaml")


def test_the_plant_is_in_files_help_sweeps_provenance_and_c(run: Run, folder: Path) -> None:
    helped = run("run", "--help-all")
    assert all(word in helped for word in ("springs", "--spring-stiffness", "--rotor "))
    said = shown(run, "springs.yaml")
    written = (folder / "sprung" / "experiment.yaml").read_text(encoding="utf-8")
    assert "engine: springs" in written
    described = Provenance.from_rollout(armgpi.load(folder / "sprung" / "rollout.nc")).first.data["plant"]
    assert (described["plant"], described["spring_stiffness"]) == ("SpringArm", [4000.0, 2000.0, 2000.0])
    assert "plant.rotor" in said["sweep"] + (folder / "swept" / "experiment.yaml").read_text(encoding="utf-8")
    same_in_c(run, folder, "springs.yaml")


SUMMARY = """
import armgpi
from armgpi.studies.objective import Expression

armgpi.metrics.summary(armgpi.load("measured/rollout.nc"))["mean_error"].to_netcdf("metric.nc")
print(Expression("itae + 2 * mean_error").names)
"""
#: The laws of metrics and plants, with those of the recipes among them.
LAWS = """
import sys, pytest
from armgpi.loop import metrics

assert "mean_error" in metrics.declared()
sys.exit(pytest.main(sys.argv[1:]))
"""


def test_the_metric_is_in_reports_files_sweeps_and_objectives(run: Run, folder: Path) -> None:
    printed = run("compare", "--config", "gravity_pd.yaml", "--out", "measured", "--report", "measured.html")
    assert "final error" in printed
    assert "mean error" not in printed  # nor in what the pages show of it
    run("report", "measured/rollout.nc", "-o", "again.html")  # of a rollout that is there already
    for page in ("measured.html", "again.html"):
        assert "mean error<br>rad" in (folder / page).read_text(encoding="utf-8")
    entries = json.loads((folder / "measured" / "metrics.json").read_text(encoding="utf-8"))
    assert all(len(entry["metrics"]["mean_error"]) == 3 for entry in entries)
    assert "mean_error" in run("-c", SUMMARY, module=())
    with xr.open_dataset(folder / "metric.nc") as table:
        assert table["mean_error"].attrs == {"long_name": "mean error", "units": "rad"}
    run("sweep", "springs.yaml", "--rollouts", "4", "--out", "spread")
    texts = [path.read_text(encoding="utf-8") for path in (folder / "spread").glob("*.json")]
    assert any("mean_error" in text for text in texts)


@pytest.mark.parametrize(
    ("file", "name"), [("loop/test_metrics", "mean_error"), ("plants/test_arms", "springs")]
)
def test_the_laws_of_metrics_and_plants_hold_for_those_of_the_recipes(run: Run, file: str, name: str) -> None:
    laws = [str(ROOT / f"tests/{file}.py"), "-q", "-p", "no:cacheprovider", f"--rootdir={ROOT}"]
    # Those of the others ran where they stand.
    assert " passed" in run("-c", LAWS, *laws, "-k", name, module=())


def test_the_check_is_in_the_output_of_inspect_and_in_its_json(run: Run, folder: Path) -> None:
    text = (ROOT / "urdf" / "anthropomorphic3.urdf").read_text(encoding="utf-8")
    (folder / "arm.urdf").write_text(text.replace('"q2"', '"Q1"'), encoding="utf-8")
    line = "warning: joint 'Q1': differs from 'q1' in case alone -> rename one of them"
    assert line in run("inspect", "arm.urdf")
    (found,) = (
        f for f in json.loads(run("inspect", "arm.urdf", "--json"))["findings"] if f["kind"] == "case"
    )
    assert (found["level"], found["value"], found["bound"]) == ("warning", "Q1", "q1")


@pytest.mark.parametrize(("module", "said"), [("broken", "ZeroDivisionError"), ("nowhere.to", "nowhere")])
def test_a_plugin_that_cannot_be_imported_is_named(module: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("1 / 0\n")
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[armgpi.plugins]\nbroken = {module}\n")

    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "armgpi.cli", *arguments],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        )

    for arguments in (("inspect", "anthropomorphic3"), ("run", "anthropomorphic3", "--t-final", "0.01")):
        refused = call(*arguments)
        assert refused.returncode == 2
        assert refused.stderr.startswith(f"error: plugin '{module}'")
        assert said in refused.stderr
        assert "Traceback" not in refused.stderr
    assert call("run", "--help").returncode == 0
