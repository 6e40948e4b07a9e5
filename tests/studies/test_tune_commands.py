"""`armgpi tune` and `armgpi contend`, as a user calls them."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from commands import Answer

from armgpi.base import files
from armgpi.cli import main
from armgpi.errors import ArmgpiWarning, ConfigError
from armgpi.studies import contend, setup
from armgpi.studies.optimise import Search
from armgpi.studies.study import IDENTITY

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "tune.yaml"
#: Short rollouts are not worth a compiler.
NUMPY = ("--backend", "numpy")
SHORT: dict[str, Any] = {
    "robot": {"name": "anthropomorphic3"},
    "controllers": [{"type": "gpi", "rolloff": 1}],
    "reality": {
        "sample_time": [0.002],
        "delay": [1, 1],
        "effort_share": 0.0,
        "payload": [0.0, 0.02],
        "duration": [0.15, 0.3],
        "t_final": 0.6,
    },
    "tune": {"evaluations": 30, "scenarios": 2, "held_out": 2, "objective": "itae + 1e-4*variation"},
}


def study_file(folder: Path, **tune: Any) -> Path:
    """Return a file with a short study."""
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump({**SHORT, "tune": {**SHORT["tune"], **tune}}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a study that ran to its end."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            sys, "argv", ["armgpi", "tune", *NUMPY, str(study_file(folder)), "--out", str(folder / "study")]
        )
        with pytest.raises(SystemExit) as end:
            main()
    assert not end.value.code
    return folder


def test_a_search_says_that_it_leaves_the_supervisor_out(tmp_path: Path) -> None:
    path = study_file(tmp_path)
    path.write_text(path.read_text() + "supervisor: {}\n")
    with pytest.warns(ArmgpiWarning, match=r"supervisor: tuning simulates without the supervisor"):
        setup.read(path)


def test_a_search_says_which_keys_of_the_file_it_does_not_use(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text("robot: {name: anthropomorphic3}\nt_final: 2\nreference: {points: [[0, 0.3, 0]]}\n")
    with pytest.warns(ArmgpiWarning, match=r"study.yaml:3: reference: .* reference and t_final are not used"):
        setup.read(path)


def test_a_folder_that_is_no_identified_arm_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"not one of armgpi identify .*; give an experiment file"):
        setup.read(tmp_path)
    (tmp_path / "experiment.yaml").write_text("robot: {name: anthropomorphic3}\n")
    with pytest.raises(ConfigError, match=r"give the experiment file in it: .*experiment.yaml"):
        setup.read(tmp_path)


def test_a_search_says_what_of_the_plant_its_scenarios_do_not_have(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text("robot: {name: anthropomorphic3}\nplant: {delay: 1, payload: {mass: 0.1}}\n")
    with pytest.warns(
        ArmgpiWarning,
        match=r"plant: tuning simulates .* delay and the encoder of the file, but not its payload",
    ):
        setup.read(path)


def test_a_study_leaves_what_it_found(whole: Path, cli: Callable[..., Answer]) -> None:
    folder = whole / "study"
    with (folder / "evaluations.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 30
    best = yaml.safe_load((folder / "best.yaml").read_text())["controllers"]
    assert [each["label"] for each in best] == ["tuned", "default"]
    with (folder / "gains.csv").open() as file:
        gains = {row["number"]: row for row in csv.DictReader(file)}
    assert float(gains["omega"]["best"]) == best[0]["omega"]
    with (folder / "front.csv").open() as file:
        front = [(float(r["total_variation"]), float(r["objective"])) for r in csv.DictReader(file)]
    assert front == sorted(front)
    assert "| best |" in (folder / "report.md").read_text()
    assert (folder / "study.png").read_bytes().startswith(b"\x89PNG")
    answer = cli("compare", "--config", folder / "best.yaml", "--json")
    assert answer.code == 0
    assert [each["label"] for each in json.loads(answer.out)] == ["tuned", "default"]


def test_a_killed_study_ends_with_the_same_bytes(
    whole: Path, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    folder = tmp_path / "study"
    shutil.copytree(whole / "study", folder)
    # As a kill leaves it: the first generations, and no result.
    for path in folder.rglob("*"):
        if path.is_file() and path.name not in ("study.yaml", IDENTITY, "000000.chunk", "000001.chunk"):
            path.unlink()
    assert cli("tune", *NUMPY, whole / "study.yaml", "--out", folder, "--resume").code == 0
    for path in (path for path in (whole / "study").rglob("*") if path.is_file()):
        there = folder / path.relative_to(whole / "study")
        assert there.read_bytes() == path.read_bytes() or path.suffix == ".png", path.name


def test_a_folder_with_a_study_is_not_overwritten(
    whole: Path, cli: Callable[..., Answer], tmp_path: Path
) -> None:
    again = cli("tune", *NUMPY, whole / "study.yaml", "--out", whole / "study")
    assert (again.code, "this study already" in again.err) == (2, True)
    other = cli("tune", *NUMPY, study_file(tmp_path, seed=9), "--out", whole / "study", "--resume")
    assert (other.code, "another study" in other.err) == (2, True)
    none = cli("tune", *NUMPY, whole / "study.yaml", "--out", tmp_path / "empty", "--resume")
    assert (none.code, "no study" in none.err) == (2, True)


@pytest.mark.parametrize(
    ("tune", "named"),
    [
        ({"objective": "itae + chatter"}, "chatter"),
        ({"objective": "sqrt(-itae)", "evaluations": 60}, "sqrt(-itae)"),
        ({"objective": "itae +"}, "tune.objective"),
        ({"constraints": ["peak < "]}, "tune.constraints"),
        ({"constraints": ["peek_error < 1"]}, "peek_error"),
        ({"against": "noise"}, "noise"),
        ({"free": {"omega": {"low": -5}}}, "tune.free.omega"),
        ({"free": {"omega": {"low": 5, "high": 2}}}, "tune.free.omega"),
        ({"free": ["omgea"]}, "omgea"),
        ({"free": []}, "tune.free"),
        ({"method": "gradient"}, "tune.method"),
        ({"evaluations": 0}, "tune.evaluations"),
        ({"seed": 2**63}, "tune.seed"),
        ({"budgets": [-1.0]}, "tune.budgets"),
        ({"controller": "pdi"}, "pdi"),
        ({"nonsense": 1}, "nonsense"),
    ],
)
def test_bad_input_is_one_line_that_names_it(
    cli: Callable[..., Answer], tmp_path: Path, tune: dict[str, Any], named: str
) -> None:
    answer = cli("tune", *NUMPY, study_file(tmp_path, **tune), "--out", tmp_path / "out")
    last = answer.err.strip().splitlines()[-1]
    assert answer.code == 2, answer.err
    assert last.startswith("error: ")
    assert named in last


def test_draws_that_are_held_out_begin_far_from_those_that_are_searched_on(tmp_path: Path) -> None:
    path = study_file(tmp_path, seed=2**63 - 1)
    path.write_text(path.read_text().replace("reality:\n", "reality:\n  index: 5\n"))
    found = setup.read(path, backend="numpy").problem
    first = [[draw.index for draw in each.draws] for each in (found.search, found.held_out)]
    assert (first, found.seed) == ([[5, 6], [5 + 2**20, 6 + 2**20]], 2**63 - 1)


def test_files_that_are_no_study_are_refused(cli: Callable[..., Answer], tmp_path: Path) -> None:
    (tmp_path / "list.yaml").write_text("- 1\n")
    (tmp_path / "tune.yaml").write_text("robot: {name: anthropomorphic3}\ntune: 3\n")
    for name in ("list.yaml", "tune.yaml", "missing.yaml"):
        answer = cli("tune", *NUMPY, tmp_path / name, "--out", tmp_path / "out")
        assert (answer.code, name in answer.err) == (2, True)


def test_a_full_disk_is_one_line_and_loses_nothing(
    cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = files.write
    written: list[Path] = []

    def write(path: Path, content: Any) -> Path:
        if len(written) > 2:
            monkeypatch.setattr("armgpi.base.files._fill", full)
        written.append(path)
        return real(path, content)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    fill = files._fill
    monkeypatch.setattr(files, "write", write)
    answer = cli("tune", *NUMPY, study_file(tmp_path), "--out", tmp_path / "out")
    assert (answer.code, "No space left" in answer.err) == (2, True)
    monkeypatch.setattr("armgpi.base.files._fill", fill)
    monkeypatch.setattr(files, "write", real)
    assert cli("tune", *NUMPY, study_file(tmp_path), "--out", tmp_path / "out", "--resume").code == 0


def test_a_study_in_which_nothing_holds_has_no_best(cli: Callable[..., Answer], tmp_path: Path) -> None:
    path = study_file(tmp_path, constraints=["peak_error <= 1e-9"], evaluations=10)
    answer = cli("tune", *NUMPY, path, "--out", tmp_path / "out")
    assert (answer.code, "No candidate holds" in answer.out) == (1, True)
    assert not (tmp_path / "out" / "best.yaml").exists()


def test_the_example_is_a_study(cli: Callable[..., Answer], tmp_path: Path) -> None:
    answer = cli("tune", EXAMPLE, "--out", tmp_path / "out", "--evaluations", 2)
    assert answer.code in (0, 1), answer.err
    assert (tmp_path / "out" / "report.md").exists()


def test_a_contest_is_the_same_search_for_all(
    cli: Callable[..., Answer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(contend, "QUICK", contend.Setting(30, 1, 1, 1))
    laws = ("--law", "GPI, roll-off", "--law", "ADRC, order 3")
    answer = cli("benchmark", "controllers", "anthropomorphic3", "--quick", "--out", tmp_path, *laws)
    assert answer.code == 0, answer.err
    assert "│ GPI, roll-off (4) " in answer.out  # numbers that are searched
    assert "┃ class " in answer.out
    assert "| GPI, roll-off (4) |" in (tmp_path / "contest.md").read_text()
    assert (tmp_path / "contest.png").exists()
    # What is there is not run again.
    monkeypatch.setattr(Search, "run", None)
    assert (
        cli("benchmark", "controllers", "anthropomorphic3", "--quick", "--out", tmp_path, *laws).out
        == answer.out
    )
    told = cli(
        "benchmark", "controllers", "anthropomorphic3", "--quick", "--out", tmp_path, *laws, "--json"
    ).out
    (own,) = (each for each in json.loads(told) if each["law"] == "GPI, roll-off")
    wanted = contend.problem("anthropomorphic3", "GPI, roll-off", 0, contend.QUICK)
    assert own["budgets"]
    for budget, best in own["budgets"].items():
        keys = [wanted.space.keys_of(best["values"])]
        fit, held_out = (runs(wanted.space.section, keys).values for runs in (wanted.search, wanted.held_out))
        assert best["fit"] == pytest.approx(fit["itae"].mean(), rel=1e-3)
        assert best["held_out"] == pytest.approx(held_out["itae"].mean(), rel=1e-3)
        assert best["variation"] == pytest.approx(held_out["total_variation"].mean(), rel=1e-3)
        assert fit["total_variation"].mean() <= float(budget)
    assert cli("benchmark", "controllers", "anthropomorphic3", "--out", tmp_path, *laws).code == 2
    for bad in (["--law", "magic"], ["--evaluations", "1"], ["--seeds", "0"], ["nobody"]):
        assert cli("benchmark", "controllers", *bad, "--out", tmp_path / "other").code == 2
