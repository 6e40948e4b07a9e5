"""The search ends in time, says what it left, and does not hide that it failed itself."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import textbooks

from armgpi import validate
from armgpi.validation import course, edits, models, repair, samples, search, worker

ARM = "rr_textbook"
RIGHT = textbooks.text(ARM)
#: One sign is wrong; in the other one no usual change undoes what is wrong.
WRONG = RIGHT.replace("np.cos(q[1])", "-np.cos(q[1])", 1)
ODD = RIGHT.replace("lc2**2", "lc2**1.3 * np.exp(0.3 * np.sin(q[0]))").replace("np.cos(q[0])", "q[0]**3")


def model(folder: Path, source: str) -> Path:
    path = folder / "model.py"
    path.write_text(source, encoding="utf-8")
    return path


def test_a_failure_of_the_search_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, search_failures: list[str]
) -> None:
    def failing(*_: object) -> None:
        raise IndexError("of ours")

    monkeypatch.setattr(search, "find_repair", failing)
    path = model(tmp_path, WRONG)
    report = validate(path, textbooks.robot(ARM, RIGHT))
    assert not report.agrees
    (text,) = search_failures
    assert text.startswith("IndexError: of ours (")
    assert f"note: the search of the source failed: {text}; please report it" in str(report)
    search_failures.clear()


def test_an_agreement_whose_proof_failed_is_incomplete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, search_failures: list[str]
) -> None:
    def failing(*_: object) -> None:
        raise KeyError("ours as well")

    monkeypatch.setattr(search, "vary_numbers", failing)
    report = validate(model(tmp_path, RIGHT), textbooks.robot(ARM, RIGHT))
    assert report.agrees
    assert report.judge().exit_code == 3
    assert report.verdict().startswith("INCOMPLETE: ")
    assert "KeyError" in report.verdict()
    search_failures.clear()


@pytest.mark.parametrize(("name", "expected"), [("model.py", ""), ("other.py", "ZeroDivisionError: ")])
def test_what_the_model_raises_is_no_failure_of_the_search(
    name: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model that cannot be read again: the exception comes from its file, or from elsewhere."""
    monkeypatch.setattr(np, "cross", np.cross)  # which a search replaces in its process
    source = "x = 1 / 0"
    code = compile(source, name, "exec")
    origin = models.Origin("model.py", source, ModuleType("model"), lambda: functions)
    functions = models.Functions({}, 1)
    functions.origin = origin
    goal = edits.Goal({}, {})

    def again(_: str) -> models.Functions:
        exec(code)
        return functions

    found = worker._search(functions, again, goal, (), 0.0)
    assert found.found is None
    assert found.failure.startswith(expected)
    assert bool(found.failure) == bool(expected)


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        (lambda: os.kill(os.getpid(), signal.SIGKILL), "ended its Python process by SIGKILL"),
        (lambda: os._exit(worker._BROKEN), "breaks the Python it runs in"),
        # What a changed model does itself: an exit code of its own, `exit()`.
        (lambda: os._exit(3), ""),
        (sys.exit, ""),
    ],
)
def test_a_process_of_a_search_that_ends_is_said(
    ends: Callable[[], None],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    search_failures: list[str],
) -> None:
    monkeypatch.setattr(search, "vary_numbers", lambda *_: ends())
    report = validate(model(tmp_path, RIGHT), textbooks.robot(ARM, RIGHT))
    assert report.judge().exit_code == (3 if expected else 0)
    assert [text.startswith(expected) for text in search_failures] == [True] * bool(expected)
    search_failures.clear()


def test_a_search_that_does_not_end_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "vary_numbers", lambda *_: signal.pause())
    monkeypatch.setattr(worker, "_SEARCHED", 0.01)
    with worker.Worker(model(tmp_path, RIGHT), "model", 60.0) as one:
        assert one.search(edits.Goal({}, {}), (), 0.0).failure.startswith("took longer than")


def test_what_there_was_no_time_for_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(course, "TOTAL", 1e-9)
    report = validate(model(tmp_path, ODD), textbooks.robot(ARM, RIGHT))
    assert not report.agrees
    assert "not searched within 1e-09 s of processor time" in str(report)


def test_a_model_that_takes_long_is_sampled_at_few_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samples, "SAMPLING", 0.0)
    report = validate(model(tmp_path, RIGHT), textbooks.robot(ARM, RIGHT))
    assert report.agrees
    assert report.states == samples.FEWEST
    assert any(f"is compared at {samples.FEWEST} states only" in note for note in report.notes)


def test_a_source_that_takes_longer_to_be_read_than_is_left_is_not_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(course, "TOTAL", 0.0)
    monkeypatch.setattr(repair, "LEAST", 0.0)
    report = validate(model(tmp_path, ODD), textbooks.robot(ARM, RIGHT))
    assert not report.agrees
    assert any("the source, which takes" in note for note in report.notes)
