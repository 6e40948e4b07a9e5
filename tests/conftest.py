"""What every test shares. That this file is here also lets tests import `strategies`, beside it."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from commands import Answer
from hypothesis import settings
from minutes import Minutes

# As `make` has it, also for whoever calls pytest: a process that forks must not have OpenMP's threads.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# The machine may be busy with something else: an example that takes long is no failure. The examples are the
# same on every run, so that a red run means that a change broke something; `make search` looks for new ones.
settings.register_profile("armgpi", deadline=None, print_blob=True, derandomize=True)
settings.register_profile("search", deadline=None, print_blob=True)
settings.load_profile("armgpi")

# A shell that starts the tests in the background has them ignore Ctrl-C, and so would every program that they
# start: some wait for one to end by it.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--minutes`."""
    parser.addoption("--minutes", action="store_true", help="print where the processor time of tests goes")


def pytest_configure(config: pytest.Config) -> None:
    """Note the processor time of every test, where that was asked for."""
    if config.getoption("--minutes"):
        config.pluginmanager.register(Minutes())


def pytest_collection_finish() -> None:
    """Leave imports and tests, which stay for good, out of every later look for garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def search_failures(request: pytest.FixtureRequest) -> Iterator[list[str]]:
    """In tests of `validate` allow four times the processor time, and fail when a search of a source fails.

    The machine may be busy. What failed is yielded: a test that expects it takes it out.
    """
    failures: list[str] = []
    if request.path.parent.name != "validation":
        yield failures
        return
    from armgpi.validation import course, repair  # others need not wait for their imports

    class Watched(course.Course):
        def left_out(self) -> tuple[str, ...]:
            failures.extend(self.failures)
            return super().left_out()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(course, "TOTAL", 4.0 * course.TOTAL)
        patch.setattr(repair, "SHORT", 4.0 * repair.SHORT)
        patch.setattr("armgpi.validation.check.Course", Watched)
        yield failures
    assert not failures, failures


@pytest.fixture(scope="session", autouse=True)
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep compiled libraries in one folder for the whole session, which its processes share."""
    base = tmp_path_factory.getbasetemp()
    if base.name.startswith("popen-"):  # a pytest-xdist worker's own
        base = base.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARMGPI_CACHE", str(base / "armgpi-cache"))
        yield


@pytest.fixture(scope="session")
def quick_compiler(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A C compiler that is soon done: the bits are those of any level."""
    path = tmp_path_factory.mktemp("compiler") / "cc"
    path.write_text('#!/bin/sh\nexec cc "$@" -O0\n')
    path.chmod(0o700)
    return path


@pytest.fixture
def compile_quickly(quick_compiler: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is compiled of generated C is there soon; the other tests have the level of a user's runs."""
    if shutil.which("cc"):
        monkeypatch.setenv("CC", str(quick_compiler))


@pytest.fixture(autouse=True)
def choose_compiler(request: pytest.FixtureRequest) -> None:
    """Compile quickly in rooms of many short runs: long ones would take longer, others ask for the level."""
    if request.path.parent.name in ("control", "gpi", "laws", "loop", "plants", "supervisor"):
        request.getfixturevalue("compile_quickly")


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Answer]:
    """Call `armgpi` in this process; anything but an exit with a code would come out as it is."""
    from armgpi.cli import main

    monkeypatch.delenv("COLUMNS", raising=False)

    def call(*arguments: object) -> Answer:
        monkeypatch.setattr(sys, "argv", ["armgpi", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        code = end.value.code or 0
        assert isinstance(code, int)
        return Answer(code, captured.out, captured.err)

    return call
