"""armgpi validate and armgpi derive, as programs call them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ARM = "anthropomorphic3"


def run(*arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "armgpi.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)


@pytest.mark.slow
def test_a_derived_module_agrees_and_a_changed_one_differs(tmp_path: Path) -> None:
    derived = run("derive", ARM, "-o", "arm.py", folder=tmp_path)
    assert (derived.returncode, derived.stdout, derived.stderr) == (0, "", "wrote arm.py\n")
    good = run("validate", "arm.py", "--robot", ARM, "--json", "--report", "a.html", folder=tmp_path)
    assert good.returncode == 0
    assert json.loads(good.stdout)["agrees"] is True
    assert (tmp_path / "a.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")

    text = (tmp_path / "arm.py").read_text(encoding="utf-8")
    (tmp_path / "arm.py").write_text(text.replace('"m3": 0.51', '"m3": 0.61'), encoding="utf-8")
    wrong = run("validate", "arm.py", "--robot", ARM, folder=tmp_path)
    assert wrong.returncode == 1
    assert "the model's m3 is 0.61; with 0.51 it agrees" in wrong.stdout
    assert wrong.stderr == ""


@pytest.mark.slow
def test_bad_input_ends_with_2(tmp_path: Path) -> None:
    for arguments in (
        ("validate", "nothing.py", "--robot", ARM),
        ("validate", "paper", "--robot", "nothing"),
        ("validate", "paper", "--lock", "q1"),
        ("derive", "nothing"),
        ("derive", ARM, "-o", "no/such/folder/arm.py"),
    ):
        done = run(*arguments, folder=tmp_path)
        assert done.returncode == 2, arguments
        assert done.stderr.startswith("error: ")
        assert "Traceback" not in done.stderr


def test_latex_on_the_screen(tmp_path: Path) -> None:
    done = run("derive", ARM, "--latex", "--numbers", folder=tmp_path)
    assert done.returncode == 0
    assert "d_{11} &=" in done.stdout
