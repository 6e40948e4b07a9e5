"""`python tools/tests_of.py NAME` finds the tests of a class, a function or a module."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOL = runpy.run_path(str(ROOT / "tools" / "tests_of.py"))
find: Callable[[str], list[str]] = TOOL["tests_of"]
main: Callable[[list[str]], int] = TOOL["main"]


def test_a_class_has_the_tests_that_use_it() -> None:
    found = find("GPI")
    assert "tests/gpi/test_gpi.py" in {test.partition("::")[0] for test in found}


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("Trig", "tests/validation"),  # what a function of derive returns
        ("resonance", "tests/identification/test_resonance.py"),  # a module
        ("checks_control", "tests/health/test_checks_control.py"),
        ("Tracer", "tests/codegen"),
    ],
)
def test_what_no_test_names_has_the_files_of_its_module_or_room(name: str, file: str) -> None:
    assert any(test.startswith(file) for test in find(name))


def test_the_tests_that_are_found_are_there() -> None:
    for test in find("Bezier"):
        path, _, function = test.partition("::")
        assert f"def {function}(" in (ROOT / path).read_text(encoding="utf-8")


def test_a_name_that_armgpi_does_not_have_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["NoSuchClass"]) == 2
    assert capsys.readouterr().err == "armgpi has no class, function or module 'NoSuchClass'\n"
