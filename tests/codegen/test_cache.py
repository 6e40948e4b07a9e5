"""Compiled libraries are kept: whole ones are used, damaged ones rebuilt, and processes do not clash."""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loops import compiled

from armgpi import GPI, ArmgpiWarning, Bezier, RigidBodyPlant, Robot, prepare, simulate
from armgpi.base.cache import cache_folder
from armgpi.codegen import build
from armgpi.codegen import run as generated
from armgpi.codegen.trace import _text
from armgpi.errors import BackendError
from armgpi.loop import prepared

SOURCE = "int answer(void) { return 42; }"
ARM = Robot.load("anthropomorphic3")
LOOP = (RigidBodyPlant(ARM), GPI(ARM, 1e-3), Bezier([0.0, 0.1, 0.0], [0.2, 0.3, 0.1], 0.1), 0.05)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give every test an empty cache, in this process as well."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("ARMGPI_CACHE", str(folder))
    monkeypatch.setattr(build, "_loaded", {})
    monkeypatch.setattr(generated, "_generated", OrderedDict())
    return folder


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the compilations there have been so far."""
    calls: list[Any] = []
    called = build.run_program

    def counted(command: Any, *arguments: Any, **keywords: Any) -> Any:
        if "-o" in command:
            calls.append(command)
        return called(command, *arguments, **keywords)

    monkeypatch.setattr(build, "run_program", counted)
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


def test_a_file_for_pages_is_kept_and_made_anew_when_it_is_damaged(
    cache: Path, compilations: list[Any]
) -> None:
    first, *others = (build.wasm(SOURCE, build.compiler(), ("-shared",)) for _ in range(3))
    assert others == [first] * 2
    assert len(compilations) == 1
    assert entry(cache).suffix == ".wasm"
    entry(cache).write_bytes(first[:-1])
    assert len(build.wasm(SOURCE, build.compiler(), ("-shared",))) == len(first)
    assert len(compilations) == 2


def test_what_else_a_compiler_makes_is_kept_by_its_name(cache: Path) -> None:
    made: list[Path] = []

    def make(folder: Path) -> bytes:
        made.append(folder)
        return b"made of many files"

    assert {build.keep("a", build.compiler(), make) for _ in range(3)} == {b"made of many files"}
    assert len(made) == 1
    assert not made[0].exists()
    build.keep("b", build.compiler(), make)
    assert len(made) == 2
    for path in cache.iterdir():
        path.write_bytes(b"damaged")
    assert build.keep("a", build.compiler(), make) == b"made of many files"


def test_a_short_run_has_code_that_is_there_soon_and_a_long_one_fast_code_with_the_same_bits(
    compilations: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """50 samples: below the limit, then above it, then in a process that finds both."""

    def quick() -> list[bool]:
        return ["-O0" in command for command in compilations]

    first = compiled(*LOOP)
    assert quick() == [True]
    monkeypatch.setattr(generated, "_FEW", 75)
    again = compiled(*LOOP)  # the second 50 samples of this process are too many
    assert quick() == [True, False]
    np.testing.assert_array_equal(again["q"], first["q"])
    np.testing.assert_array_equal(again["tau"], first["tau"])
    forget()
    monkeypatch.setattr(generated, "_FEW", 10_000)
    compiled(*LOOP)
    assert len(compilations) == 2
    (code,) = generated._generated.values()
    fast = build.find_library(next(iter(_names())), (*build.FLAGS, *build.SCALAR))
    assert code.library is fast  # the faster one where it is there


def test_code_of_short_runs_stays_where_fast_code_is_not_worth_it(
    compilations: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """3 joints take 0.18 s to compile quickly, and 0.3 s at full speed."""
    first = compiled(*LOOP)
    monkeypatch.setattr(generated, "_FEW", 75)
    monkeypatch.setattr(prepared.PreparedLoop, "_patience", lambda *_: 0.25)
    again = [prepare(*LOOP, backend="auto").run() for _ in range(3)]
    assert ["-O0" in command for command in compilations] == [True]
    for each in again:
        assert json.loads(each.attrs["provenance"])["backend"] == "compiled"
        np.testing.assert_array_equal(each["q"], first["q"])
    monkeypatch.setattr(prepared.PreparedLoop, "_patience", lambda *_: 0.35)
    prepare(*LOOP, backend="auto").run()
    assert ["-O0" in command for command in compilations] == [True, False]


def _names() -> list[str]:
    """Return the name of the loop's code."""
    from armgpi.codegen.trace import Inventory
    from armgpi.loop.closed_loop import ClosedLoop

    loop = ClosedLoop(*LOOP[:3])
    return [f"False 1 {Inventory(loop, loop.init()).name}"]


def test_rollouts_side_by_side_have_fast_code_at_once(compilations: list[Any]) -> None:
    plant, law, move, seconds = LOOP
    simulate(plant, law, move, seconds, q0=np.tile([0.0, 0.1, 0.0], (3, 1)), backend="compiled")
    assert ["-O0" in command for command in compilations] == [False]


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
        patch.setattr(build, "_make", lambda *_: pytest.fail("compiled again"))
        assert [answer(sources[i]) for i in (0, 2, 3)] == [0, 2, 3]


def test_a_cache_that_cannot_be_written_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ARMGPI_CACHE", str(tmp_path / "file" / "cache"))
    assert answer() == 42
    np.testing.assert_array_equal(compiled(*LOOP)["status"], 0)


def test_the_cache_is_where_it_is_said_to_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ARMGPI_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "armgpi"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == tmp_path / "home" / ".cache" / "armgpi"


def test_two_processes_that_build_the_same_do_not_clash(cache: Path) -> None:
    code = (
        "import sys, time; from armgpi.codegen import build\n"
        "time.sleep(max(0, float(sys.argv[1]) - time.time()))\n"
        f"sys.exit(build.library({SOURCE!r}).answer() != 42)"
    )
    start = str(time.time() + 1.0)
    processes = [subprocess.Popen([sys.executable, "-c", code, start]) for _ in range(3)]
    assert [process.wait(200) for process in processes] == [0, 0, 0]
    assert answer() == 42
    assert all(path.suffix == ".so" for path in cache.iterdir())


def test_a_second_run_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    first = compiled(*LOOP)
    build._loaded.clear()
    build.probe.cache_clear()
    called = build.run_program

    def only_versions(command: Any, *arguments: Any) -> Any:
        assert command[-1] == "--version"
        return called(command, *arguments)

    monkeypatch.setattr(build, "run_program", only_versions)
    np.testing.assert_array_equal(compiled(*LOOP)["q"], first["q"])


def forget() -> None:
    """Forget what this process has loaded, as another one has nothing."""
    build._loaded.clear()
    generated._generated.clear()


def test_a_second_process_traces_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any) -> Any:
        raise AssertionError("traced")

    first = compiled(*LOOP)
    forget()
    with monkeypatch.context() as patch:
        patch.setattr(generated, "trace_used", refused)
        np.testing.assert_array_equal(compiled(*LOOP)["q"], first["q"])
        forget()
        patch.setattr(build, "package", lambda: "of another version")
        with pytest.warns(ArmgpiWarning, match="traced"):
            simulate(*LOOP, backend="compiled")


def test_a_structure_has_the_same_text_in_every_process() -> None:
    code = (
        "from armgpi import GPI, BSplineNetwork, ClosedLoop, Encoder, Hold, RigidBodyPlant, Robot, Step\n"
        "from armgpi.codegen.trace import Inventory\n"
        "arm = Robot.load('anthropomorphic3')\n"
        "gpi = GPI(arm, 1e-3, BSplineNetwork())\n"
        "loop = ClosedLoop(Encoder(RigidBodyPlant(arm, Step(0.1, 0.0)), 16), gpi, Hold([0.0, 0.1, 0.0]))\n"
        "print(Inventory(loop, loop.init()).name)"
    )
    said = []
    for seed in ("1", "2"):  # of Python's own hashes
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True)
        said.append(done.stdout)
    assert said[0] == said[1] != b"\n"


def test_what_has_no_text_of_its_own_has_no_name() -> None:
    def made(value: Any) -> Any:
        return lambda: value

    assert _text((np.sin, "a", 1.0, frozenset("ba"), np.float64)) == "(sin,'a',1.0,{'a','b'},numpy.float64)"
    for value in (object(), [{}], made(1)):
        with pytest.raises(TypeError, match="has no text of its own"):
            _text(value)


def test_auto_takes_what_is_there_and_compiles_what_is_worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def chosen() -> str:
        return str(json.loads(simulate(*LOOP, backend="auto").attrs["provenance"])["backend"])

    monkeypatch.setattr(prepared, "_ARRAY", 0.14 / 50 / 8)  # 0.14 s in all: more than the imports, ...
    assert chosen() == "numpy"  # ... less than what compiling three joints takes
    compiled(*LOOP)
    for _ in range(2):  # in this process, and in another one
        assert chosen() == "compiled"
        forget()
    monkeypatch.setattr(prepared, "_ARRAY", 5e-6)
    assert chosen() == "numpy"


def test_a_loop_that_runs_again_and_again_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prepared, "_ARRAY", 0.14 / 50 / 8)
    loop = prepare(*LOOP, backend="auto")
    runs = [loop.run() for _ in range(3)]
    backends = [json.loads(run.attrs["provenance"])["backend"] for run in runs]
    assert backends == ["numpy", "compiled", "compiled"]
    np.testing.assert_allclose(runs[0]["q"], runs[1]["q"], atol=1e-12)


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
    assert cache_folder().is_absolute()


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
    for _ in range(1200):
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
: > "${{TMPDIR:-/tmp}}/cc1234.s"
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
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    code = f"from armgpi.codegen import build\nbuild.library({SOURCE!r})"
    environment = {**os.environ, "CC": str(cc), "TMPDIR": str(temporary)}
    with subprocess.Popen([sys.executable, "-c", code], env=environment, stderr=subprocess.PIPE) as process:
        while not pid.exists():
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert b"KeyboardInterrupt" in process.communicate(timeout=200)[1]
    assert gone(pid)
    assert list(cache.iterdir()) == []
    assert list(temporary.iterdir()) == []  # the compiler's own files are removed with what it makes


# What is loaded runs: only what nobody else can have written.

#: Another user than the one who runs the tests.
NOBODY = 65534
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files to another user")


def plant(folder: Path, tmp_path: Path) -> Path:
    """Put an entry into a folder that answers 666 in place of 42, its name as it should be."""
    key = entry_of(tmp_path / "elsewhere").name.partition("-")[0]
    code, built = tmp_path / "planted.c", tmp_path / "planted.so"
    code.write_text(SOURCE.replace("42", "666"))
    subprocess.run(["cc", "-shared", "-fPIC", "-o", built, code], check=True)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{key}-{hashlib.sha256(built.read_bytes()).hexdigest()[:16]}.so"
    path.write_bytes(built.read_bytes())
    path.chmod(0o700)
    return path


def entry_of(folder: Path) -> Path:
    """Return the entry that a folder gets."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARMGPI_CACHE", str(folder))
        answer()
    return entry(folder)


def test_the_planted_entry_would_be_loaded(cache: Path, tmp_path: Path) -> None:
    plant(cache, tmp_path).parent.chmod(0o700)  # ours in every respect: the tests below test something
    assert answer() == 666


@pytest.mark.parametrize("mode", [0o1777, 0o777, 0o770, 0o702])
def test_a_folder_that_others_can_write_to_is_not_used(cache: Path, tmp_path: Path, mode: int) -> None:
    planted = plant(cache, tmp_path)
    cache.chmod(mode)
    with pytest.warns(ArmgpiWarning, match=rf"not kept: .*cache can be written by others \(mode {mode:o}\)"):
        assert answer() == 42
    assert list(cache.iterdir()) == [planted]  # it is not ours: left as it is


@as_root
def test_a_folder_of_another_user_is_not_used(cache: Path, tmp_path: Path) -> None:
    plant(cache, tmp_path)
    cache.chmod(0o700)
    os.chown(cache, NOBODY, NOBODY)
    with pytest.warns(ArmgpiWarning, match=f"belongs to the user {NOBODY}, not to 0"):
        assert answer() == 42


@as_root
def test_root_with_the_home_of_another_user_leaves_nothing_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (home := tmp_path / "home").mkdir()
    os.chown(home, NOBODY, NOBODY)
    monkeypatch.delenv("ARMGPI_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(home))
    with pytest.warns(ArmgpiWarning, match="home, above armgpi, can be written by others"):
        assert answer() == 42
    assert list(home.iterdir()) == []


def test_a_folder_that_others_can_move_away_is_not_used(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARMGPI_CACHE", str(cache / "below"))
    cache.mkdir()
    cache.chmod(0o777)
    with pytest.warns(ArmgpiWarning, match="cache, above below, can be written by others"):
        assert answer() == 42
    cache.chmod(0o1777)  # in a sticky folder nobody moves what is another's
    assert answer() == 42
    assert len(list((cache / "below").iterdir())) == 1


def test_a_link_is_no_cache(cache: Path, tmp_path: Path) -> None:
    planted = plant(tmp_path / "planted", tmp_path)
    planted.parent.chmod(0o700)
    cache.symlink_to(planted.parent)
    with pytest.warns(ArmgpiWarning, match="cache is a link"):
        assert answer() == 42


@pytest.mark.parametrize("mode", [0o777, 0o720, 0o702])
def test_a_file_that_others_can_write_to_is_not_loaded(cache: Path, tmp_path: Path, mode: int) -> None:
    planted = plant(cache, tmp_path)
    cache.chmod(0o700)
    planted.chmod(mode)
    assert answer() == 42
    assert not planted.exists()


@as_root
def test_a_file_of_another_user_is_not_loaded(cache: Path, tmp_path: Path) -> None:
    planted = plant(cache, tmp_path)
    cache.chmod(0o700)
    os.chown(planted, NOBODY, NOBODY)
    assert answer() == 42


def test_a_link_is_not_loaded(cache: Path, tmp_path: Path) -> None:
    planted = plant(cache, tmp_path)
    cache.chmod(0o700)
    planted.rename(tmp_path / "there.so")
    planted.symlink_to(tmp_path / "there.so")
    assert answer() == 42


def test_a_pipe_among_the_entries_does_not_stop_it(cache: Path, tmp_path: Path) -> None:
    planted = plant(cache, tmp_path)
    cache.chmod(0o700)
    planted.unlink()
    os.mkfifo(planted, 0o600)
    assert answer() == 42


def test_a_user_without_a_home_has_no_folder_that_others_can_foresee(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nobody(path: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    (shared := tmp_path / "tmp").mkdir()
    shared.chmod(0o1777)
    monkeypatch.setattr(tempfile, "tempdir", str(shared))
    planted = plant(shared / f"cache-{os.getuid()}" / "armgpi", tmp_path)
    monkeypatch.delenv("ARMGPI_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "expanduser", nobody)
    assert answer() == 42
    assert list(shared.iterdir()) == [planted.parent.parent]  # nothing is left there either


def test_without_any_folder_of_its_own_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (shared := tmp_path / "shared").mkdir()
    shared.chmod(0o777)  # not sticky
    monkeypatch.setattr(tempfile, "tempdir", str(shared))
    monkeypatch.setenv("ARMGPI_CACHE", str(shared))
    with (
        pytest.warns(ArmgpiWarning, match="not kept"),
        pytest.raises(BackendError, match=r"no folder to compile in: .*shared, above armgpi-"),
    ):
        answer()


def test_what_is_kept_is_ours_whatever_the_umask(cache: Path, compilations: list[Any]) -> None:
    before = os.umask(0o000)
    try:
        assert [answer(), answer()] == [42, 42]
    finally:
        os.umask(before)
    assert len(compilations) == 1
    assert stat.S_IMODE(entry(cache).stat().st_mode) == 0o700


def test_pruning_removes_nothing_but_libraries_of_ours(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "_KEPT", 1)
    cache.mkdir(mode=0o700)
    (other := cache / "somebody-else.so").write_text("")
    assert [answer(SOURCE.replace("42", str(i))) for i in range(3)] == [0, 1, 2]
    assert other.exists()
    assert len(list(cache.iterdir())) == 2


def test_looking_at_who_can_write_takes_no_time(cache: Path) -> None:
    answer()
    times = []
    for _ in range(20):
        build._loaded.clear()
        start = time.process_time()
        build.library(SOURCE)
        times.append(time.process_time() - start)
    assert min(times) < 2e-3
