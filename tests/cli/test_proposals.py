"""What messages propose is typed as it is printed, and passes the check that made it."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from commands import Answer

from armgpi import robots
from armgpi.cli import experiment as experiment_command
from armgpi.cli.options import Asked, Run

Cli = Callable[..., Answer]

FIXTURES = Path(__file__).parents[1] / "fixtures" / "urdf_cases"
GOOD = FIXTURES / "00_good.urdf"
#: An option and its value as messages propose them; words in capitals stand for what only the user has.
PROPOSED = re.compile(
    r"--(?:effort|lock|keep|mimic|repair|map|friction|gravity|drives|rotor-inertia|plant|controller|torque)"
    r" (?![A-Z]+\b)(?:'[^']*'|[^\s;)(,]+(?:,[^\s;)(,]+)*)"
)
#: Names that messages propose for one that does not exist.
NEAR = re.compile(r"'([^']*)'; did you mean '([^']*)'")


def changed(folder: Path, name: str, *edits: tuple[str, str]) -> Path:
    """Return the path of the good arm with edits of its text."""
    text = GOOD.read_text()
    for old, new in edits:
        assert re.search(old, text), old
        text = re.sub(old, new, text)
    file = folder / f"{name}.urdf"
    file.write_text(text)
    return file


EFFORT, MASS = r'effort="[^"]*"', r'mass value="[^"]*"'
#: What is wrong -> the arm, and the command with its other words.
CASES: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "no effort at all": (lambda f: changed(f, "weak", (EFFORT, 'effort="0"')), ("run", "--t-final", "0.01")),
    "too little effort": (
        lambda f: changed(f, "heavy", (EFFORT, 'effort="1"'), (MASS, 'mass value="9"')),
        ("run", "--t-final", "0.01"),
    ),
    "no effort, inspected": (lambda f: changed(f, "weak", (EFFORT, 'effort="0"')), ("inspect",)),
    "no mass": (lambda f: changed(f, "light", (MASS, 'mass value="0"')), ("run", "--t-final", "0.01")),
    "friction below zero": (
        lambda f: changed(f, "slick", ("</joint>", '<dynamics damping="-0.2"/></joint>')),
        ("inspect",),
    ),
    "much friction": (
        lambda f: changed(f, "rough", ("</joint>", '<dynamics friction="9"/></joint>')),
        ("inspect",),
    ),
    "two arms": (lambda f: "tiago_dual_left_arm", ("inspect",)),
    "several arms": (lambda f: "talos_left_arm", ("inspect",)),
}
FILES = {path.stem: path for path in FIXTURES.glob("*.urdf")}


def texts(answer: Answer) -> list[str]:
    """Return the errors and warnings of an answer."""
    lines = (*answer.err.splitlines(), *answer.out.splitlines())
    return [line for line in lines if line.startswith(("error:", "warning:"))]


def check(cli: Cli, words: tuple[object, ...]) -> list[str]:
    """Type the first proposal of a command's messages behind it, again and again; return what was typed.

    What `inspect` proposes to run with is typed behind `run`.
    """
    typed: list[str] = []
    for _ in range(8):
        found = [(text, match) for text in texts(cli(*words)) for match in PROPOSED.finditer(text)]
        if not found:
            break
        text, match = found[0]
        assert text not in typed, text  # it was typed, and did not help
        typed.append(text)
        if "run with " in text:
            assert cli("run", words[1], "--t-final", "0.01", *shlex.split(match[0])).code == 0, text
            break
        words = (*words, *shlex.split(match[0]))
    else:
        pytest.fail(f"{typed} lead to no end")
    if typed:
        assert cli(*words).code in (0, 1, 3), typed
    return typed


@pytest.mark.parametrize("what", CASES)
def test_an_option_that_a_message_proposes_passes_the_check_that_made_it(
    what: str, cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    make, (command, *options) = CASES[what]
    robot = make(tmp_path)
    if isinstance(robot, str) and robot not in robots.names():
        pytest.skip("the robots extra is not installed")
    assert check(cli, (command, robot, *options))


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(FILES))
def test_options_proposed_for_a_broken_file_make_it_load(name: str, cli: Cli) -> None:
    check(cli, ("run", FILES[name], "--t-final", "0.002"))


@pytest.mark.parametrize(
    "words",
    [
        ("run", "anthropomorphic"),
        ("run", "anthropomorphic3", "--controller", "gpy"),
        ("run", "anthropomorphic3", "--set", "plant.dely=2"),
        ("run", "anthropomorphic3", "--set", "controller.omga=20"),
        ("run", "anthropomorphic3", "--lock", "q33"),
        ("run", "anthropomorphic3", "--effort", "qq1=20"),
        ("run", "anthropomorphic3", "--to", "qq1=0.2"),
        ("run", "anthropomorphic3", "--rotor-inertia", "qq1=0.1"),
        ("compare", "anthropomorphic3", "--controllers", "gpi_aut,pid"),
    ],
    ids=lambda words: " ".join(words[-2:]),
)
def test_a_near_name_that_is_proposed_is_taken(words: tuple[str, ...], cli: Cli) -> None:
    short = ("--t-final", "0.01")
    refused = cli(*words, *short)
    assert refused.code == 2
    found = NEAR.search(refused.err)
    assert found, refused.err
    wrong, right = found.groups()
    # The whole name of an option or key where it stands alone, else its part of a word.
    typed = [re.sub(rf"(?<![\w]){re.escape(wrong)}(?![\w])", right, word) for word in words]
    assert typed != list(words)
    assert cli(*typed, *short).code == 0


def test_what_an_arm_that_cannot_be_certified_is_told_leads_to_a_certificate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Callable[..., Answer]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli("new", "ur5", "--out", "arm.yaml").code == 0
    refused = cli("certify", "arm.yaml")
    assert refused.code == 3
    assert "specify them by --rotor-inertia or --drives." in refused.out
    assert "Add --controller gpi: " in refused.out
    judged = cli("certify", "arm.yaml", "--rotor-inertia", "1", "--controller", "gpi", "--allow-part")
    assert judged.code == 0, judged
    assert "ertified" in judged.out


def test_options_are_to_be_added_to_the_next_commands_where_some_were_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    options = Run(report=Path("report.html"))
    asked = Asked(robot="ur5", controllers=None, declared=[], options=options)
    experiment: Any = SimpleNamespace(config=None)
    for more, added in (([], ""), (["--report=x"], "; add your options")):
        monkeypatch.setattr(sys, "argv", ["armgpi", "run", "ur5", *more])
        lines = experiment_command._next_commands(asked, options, False, experiment).splitlines()
        assert lines[0] == "Next:"
        assert lines[1].strip() == f"armgpi compare ur5   other controllers on the same arm{added}"
        assert lines[2].split() == [
            "armgpi",
            "new",
            "ur5",
            *["a", "file", "of", "this", "experiment", "to", "edit"],
        ]
