"""Compiled libraries are kept: whole ones are used, damaged ones rebuilt, and processes do not clash."""

from __future__ import annotations

import ctypes
import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loops import compiled

from armgpi import GPI, ArmgpiWarning, Bezier, RigidBodyPlant, Robot, simulate
from armgpi.codegen import build
from armgpi.errors import BackendError

SOURCE = "int answer(void) { return 42; }"
ARM = Robot.load("anthropomorphic3")
LOOP = (RigidBodyPlant(ARM), GPI(ARM, 1e-3), Bezier([0.0, 0.1, 0.0], [0.2, 0.3, 0.1], 0.1), 0.05)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give every test an empty cache, in this process as well."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("ARMGPI_CACHE", str(folder))
    monkeypatch.setattr(build, "_loaded", {})
    return folder


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the compilations there have been so far."""
    calls: list[Any] = []
    called = build.called

    def counted(command: Any, *arguments: Any) -> Any:
        if "-o" in command:
            calls.append(command)
        return called(command, *arguments)

    monkeypatch.setattr(build, "called", counted)
    return calls


def answer(source: str = SOURCE) -> int:
    build._loaded.clear()  # as in another process
    return int(build.library(source).answer())


def entry(cache: Path) -> Path:
    """Return the one entry of a cache."""
    (path,) = cache.iterdir()
    return path


def test_an_entry_is_compiled_once(cache: Path, compilations: list[Any]) -> None:
    assert [answer() for _ in range(3)] == [42] * 3
    assert len(compilations) == 1
    assert answer(SOURCE.replace("42", "43")) == 43
    assert len(compilations) == 2
    assert len(list(cache.iterdir())) == 2
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700  # what is loaded from here runs


def test_within_a_process_it_is_loaded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    assert build.library(SOURCE) is build.library(SOURCE)


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[: len(data) // 2],
        lambda data: data[:-1],
        lambda data: data + b"x",
        lambda data: bytes([data[0] ^ 1]) + data[1:],
        lambda data: data[: len(data) // 2] + b"\0" * (len(data) - len(data) // 2),
        lambda data: b"\0" * len(data),
    ],
)
def test_a_damaged_entry_is_rebuilt(cache: Path, compilations: list[Any], damage: Any) -> None:
    answer()
    path = entry(cache)
    # Not in place: this process has the file mapped.
    data = damage(path.read_bytes())
    path.unlink()
    path.write_bytes(data)
    assert answer() == 42
    assert len(compilations) == 2
    assert answer() == 42
    assert len(compilations) == 2
    assert len(list(cache.iterdir())) == 1


def test_a_folder_among_the_entries_is_left_alone(cache: Path, compilations: list[Any]) -> None:
    answer()
    (folder := cache / entry(cache).name.replace("-", "-0")).mkdir()
    folders = [folder, *(cache / f"{folder.name[:32]}-{i}.so" for i in range(5))]
    for path in folders[1:]:
        path.mkdir()
    assert answer() == 42
    assert len(compilations) == 1


def test_a_cache_that_can_only_be_read_is_used(
    cache: Path, compilations: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answer()

    def refuses(*_: Any) -> None:
        raise PermissionError(13, "Read-only file system")

    monkeypatch.setattr(os, "utime", refuses)
    assert answer() == 42
    assert len(compilations) == 1


def test_a_full_disk_is_an_error_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.warns(ArmgpiWarning, match="running by NumPy: .*cannot be written: No space left"):
        simulate(*LOOP, backend="compiled")


def test_a_dead_link_is_no_entry(cache: Path) -> None:
    answer()
    path = entry(cache)
    path.unlink()
    path.symlink_to(cache / "nothing")
    assert answer() == 42


def test_what_a_killed_process_leaves_does_no_harm(cache: Path, compilations: list[Any]) -> None:
    answer()
    path = entry(cache)
    for name in (f".{path.name[:32]}.abcd", f".{path.name[:32]}.efgh"):
        (cache / name).mkdir()
        (cache / name / "loop.so").write_bytes(b"half")
    assert answer() == 42
    assert len(compilations) == 1


def test_old_entries_go_first(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "_KEPT", 3)
    sources = [SOURCE.replace("42", str(i)) for i in range(4)]
    for i, source in enumerate(sources[:3]):
        answer(source)
        newest = max(cache.iterdir(), key=lambda path: path.stat().st_mtime_ns)
        os.utime(newest, (i, i))
    assert answer(sources[0]) == 0  # used again: the youngest
    assert answer(sources[3]) == 3
    assert len(list(cache.iterdir())) == 3
    with monkeypatch.context() as patch:
        patch.setattr(build, "_compiled", lambda *_: pytest.fail("compiled again"))
        assert [answer(sources[i]) for i in (0, 2, 3)] == [0, 2, 3]


def test_a_cache_that_cannot_be_written_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ARMGPI_CACHE", str(tmp_path / "file" / "cache"))
    assert answer() == 42
    np.testing.assert_array_equal(compiled(*LOOP)["status"], 0)


def test_the_cache_is_where_it_is_said_to_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ARMGPI_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert build.cache_folder() == tmp_path / "xdg" / "armgpi"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert build.cache_folder() == tmp_path / "home" / ".cache" / "armgpi"


def test_two_processes_that_build_the_same_do_not_clash(cache: Path) -> None:
    code = (
        "import sys, time; from armgpi.codegen import build\n"
        "time.sleep(max(0, float(sys.argv[1]) - time.time()))\n"
        f"sys.exit(build.library({SOURCE!r}).answer() != 42)"
    )
    start = str(time.time() + 1.0)
    processes = [subprocess.Popen([sys.executable, "-c", code, start]) for _ in range(3)]
    assert [process.wait(60) for process in processes] == [0, 0, 0]
    assert answer() == 42
    assert all(path.suffix == ".so" for path in cache.iterdir())


def test_a_second_run_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    first = compiled(*LOOP)
    build._loaded.clear()
    build._probed.cache_clear()
    called = build.called

    def only_versions(command: Any, *arguments: Any) -> Any:
        assert command[-1] == "--version"
        return called(command, *arguments)

    monkeypatch.setattr(build, "called", only_versions)
    np.testing.assert_array_equal(compiled(*LOOP)["q"], first["q"])


def test_a_library_without_what_it_should_have_is_an_error_in_words(cache: Path) -> None:
    with pytest.raises(BackendError, match=r"cc failed: .*error"):
        build.library("int answer(void) { return nothing; }")
    assert list(cache.iterdir()) == []


def test_a_library_that_cannot_be_loaded_is_an_error_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(path: str) -> None:
        raise OSError("no room for its segments")

    monkeypatch.setattr(ctypes, "CDLL", refuses)
    with pytest.warns(ArmgpiWarning, match="running by NumPy: .*cannot be loaded: no room"):
        run = simulate(*LOOP, backend="compiled")
    np.testing.assert_array_equal(run["q"], simulate(*LOOP)["q"])


def test_a_user_without_a_home(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(path: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("ARMGPI_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "expanduser", nobody)
    assert build.cache_folder().is_absolute()


def test_a_cache_in_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ARMGPI_CACHE", ".")
    assert answer() == 42


def test_a_compiler_that_says_what_is_no_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "odd-cc"
    path.write_text("#!/bin/sh\nprintf '\\377\\376'\nprintf 'error \\377' >&2\n")
    path.chmod(0o755)
    monkeypatch.setenv("CC", str(path))
    with pytest.raises(BackendError, match="odd-cc failed: error"):
        answer()


def script(path: Path, text: str) -> Path:
    """Write a compiler of one's own."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def test_a_compiler_whose_path_has_spaces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = script(tmp_path / "my tools ü" / "cc one", 'exec cc "$@"')
    for cc in (str(path), f"'{path}' -O1", f"env X=1 '{path}'"):
        monkeypatch.setenv("CC", cc)
        assert answer() == 42


def test_a_cache_whose_path_has_spaces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARMGPI_CACHE", str(tmp_path / "my cache äöü"))
    assert [answer(), answer()] == [42, 42]


def gone(path: Path) -> bool:
    """Tell whether the process whose number a file holds has ended, or soon does."""
    number = int(path.read_text())
    for _ in range(100):
        try:
            state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":  # nobody asks for it here
            return True
        time.sleep(0.05)
    return False


#: A compiler that answers, then waits for a child for ever.
HANGS = """
case "$1" in --version) echo hangs; exit;; esac
sleep 1000 &
echo $! > "{pid}.new"
mv "{pid}.new" "{pid}"
wait
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_children_of_a_compiler_that_takes_too_long_are_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pid = tmp_path / "pid"
    monkeypatch.setenv("CC", str(script(tmp_path / "hangs", HANGS.format(pid=pid))))
    monkeypatch.setattr(build, "_PATIENCE", 0.5)
    with pytest.raises(BackendError, match=r"hangs took longer than 0\.5 s"):
        answer()
    assert gone(pid)


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_ctrl_c_ends_the_children_of_a_compiler(tmp_path: Path, cache: Path) -> None:
    pid = tmp_path / "pid"
    cc = script(tmp_path / "hangs", HANGS.format(pid=pid))
    code = f"from armgpi.codegen import build\nbuild.library({SOURCE!r})"
    with subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "CC": str(cc)}, stderr=subprocess.PIPE
    ) as process:
        for _ in range(600):
            if pid.exists():
                break
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert b"KeyboardInterrupt" in process.communicate(timeout=30)[1]
    assert gone(pid)
    assert list(cache.iterdir()) == []
