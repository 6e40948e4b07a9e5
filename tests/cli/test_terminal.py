"""Lines that wait: which arm a command judges is said before its results, and never before an error."""

from __future__ import annotations

import time
from contextlib import suppress

import pytest
import typer

from armgpi.cli import terminal
from armgpi.errors import ArmgpiError


def test_a_held_line_comes_before_the_next_line(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.hold("world: of this arm")
    assert capsys.readouterr() == ("", "")
    terminal.say("a result", err=True)
    assert capsys.readouterr().err == "world: of this arm\na result\n"
    terminal.say("another", err=True)
    assert capsys.readouterr().err == "another\n"


def test_a_held_line_comes_before_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.hold("world: of this arm")
    terminal.say_markdown("| a |\n|---|\n| 1 |")
    assert capsys.readouterr().err == "world: of this arm\n"


@pytest.mark.parametrize(
    ("end", "printed"),
    [
        (None, "world: of this arm\n"),
        (typer.Exit(3), "world: of this arm\n"),
        (SystemExit(0), "world: of this arm\n"),
        (ArmgpiError("bad"), ""),
    ],
    ids=["well", "with an exit code", "by sys.exit", "with an error"],
)
def test_an_error_alone_drops_what_waits(
    end: BaseException | None, printed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with suppress(typer.Exit, SystemExit, ArmgpiError), terminal.lines_held():
        terminal.hold("world: of this arm")
        if end is not None:
            raise end
    assert capsys.readouterr().err == printed
    terminal.say("next", err=True)
    assert capsys.readouterr().err == "next\n"


def test_work_that_takes_long_says_what_it_does(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal, "_SILENT_AT_MOST", 0.0)
    said = ""
    with terminal.working("fitting"):
        while not said.endswith("\n"):  # another thread says it
            time.sleep(0.01)
            said += capsys.readouterr().err
    assert said + capsys.readouterr().err == "fitting ...\n"
    monkeypatch.setattr(terminal, "_SILENT_AT_MOST", 60.0)
    with terminal.working("fitting"):
        pass
    assert capsys.readouterr().err == ""


def test_a_line_that_is_too_long_goes_on_indented(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.print_wrapped(terminal.console(width=30), "  one two three four five six seven eight nine")
    assert capsys.readouterr().out == "  one two three four five six\n    seven eight nine\n"
