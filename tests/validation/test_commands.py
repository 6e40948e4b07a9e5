"""armgpi validate and armgpi derive, as programs call them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from commands import Answer

ARM = "anthropomorphic3"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder of its own."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_a_derived_module_agrees_and_a_changed_one_differs(cli: Callable[..., Answer]) -> None:
    assert cli("derive", ARM, "-o", "arm.py") == (0, "", "wrote arm.py\n")
    good = cli("validate", "arm.py", "--robot", ARM, "--json", "--report", "a.html")
    assert good.code == 0
    assert json.loads(good.out)["agrees"] is True
    assert Path("a.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")

    text = Path("arm.py").read_text(encoding="utf-8")
    Path("arm.py").write_text(text.replace('"m3": 0.51', '"m3": 0.61'), encoding="utf-8")
    wrong = cli("validate", "arm.py", "--robot", ARM)
    assert wrong.code == 1
    assert "the model's m3 is 0.61; with 0.51 it agrees" in wrong.out
    assert wrong.err == ""


@pytest.mark.parametrize(
    "arguments",
    [
        ("validate", "nothing.py", "--robot", ARM),
        ("validate", "paper", "--robot", "nothing"),
        ("validate", "paper", "--lock", "q1"),
        ("derive", "nothing"),
        ("derive", ARM, "-o", "no/such/folder/arm.py"),
    ],
)
def test_bad_input_ends_with_2(arguments: tuple[str, ...], cli: Callable[..., Answer]) -> None:
    done = cli(*arguments)
    assert done.code == 2
    assert done.err.startswith("error: ")
    assert "Traceback" not in done.err


def test_latex_on_the_screen(cli: Callable[..., Answer]) -> None:
    done = cli("derive", ARM, "--latex", "--numbers")
    assert done.code == 0
    assert "d_{11} &=" in done.out


def test_a_model_for_which_no_chain_is_found_ends_with_1(
    cli: Callable[..., Answer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armgpi.validation.skeleton.SEARCH", 0.0)
    text = "import numpy as np\ndef mass_matrix(q): return np.diag([2.0 + np.sin(q[1]) ** 5, 1.0])\n"
    Path("odd.py").write_text(text, encoding="utf-8")
    done = cli("validate", "odd.py", "--joints", "2", "--suggest-urdf", "odd.urdf")
    assert done.code == 1
    assert "no chain" in done.err
