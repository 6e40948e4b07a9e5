"""Files appear whole or not at all, whatever happens while they are written; sets of files show a mixture."""

from __future__ import annotations

import errno
import hashlib
import os
import resource
import shutil
import signal
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import armgpi
from armgpi.base import files, hdf5
from armgpi.errors import RolloutError

#: An earlier and a later set of files.
OLD = {"a.txt": "old a", "b.bin": b"old b" * 1000, "c.txt": "old c"}
NEW = {"a.txt": "new a", "b.bin": b"new b" * 2000, "c.txt": "new c"}


@contextmanager
def failing(at: int, fail: Callable[[], None]) -> Iterator[list[str]]:
    """Let the `at`-th call that touches the disk fail, counted from 1; give the calls there were.

    What is written is there by half when it fails.
    """
    calls: list[str] = []

    def counted(name: str, call: Any) -> Any:
        def wrapped(*arguments: Any, **options: Any) -> Any:
            calls.append(name)
            if len(calls) == at:
                if name == "write_bytes":
                    call(arguments[0], arguments[1][: len(arguments[1]) // 2])
                fail()
            return call(*arguments, **options)

        return wrapped

    with pytest.MonkeyPatch.context() as patch:
        for name in ("open", "fsync", "replace", "fchmod"):
            patch.setattr(os, name, counted(name, getattr(os, name)))
        patch.setattr(Path, "write_bytes", counted("write_bytes", Path.write_bytes))
        yield calls


def full() -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@contextmanager
def killing(work: str, path: Path) -> Iterator[Callable[[int], int]]:
    """Give what does some work with a `path` in a process that is killed at a call, and returns how it ended.

    These processes are forks of one that has imported what they need.
    """
    code = (
        "import os, sys; from pathlib import Path; from test_files import NEW, failing, files, killed\n"
        "path = Path(sys.argv[1])\n"
        "for at in sys.stdin:\n"
        "    if (child := os.fork()) == 0:\n"
        f"        with failing(int(at), killed): {work}\n"
        "        os._exit(0)\n"
        "    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)"
    )
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    command = [sys.executable, "-c", code, str(path)]
    with subprocess.Popen(command, cwd=Path(__file__).parent, **pipes) as forks:
        asked, answers = forks.stdin, forks.stdout
        assert asked is not None
        assert answers is not None

        def at(call: int) -> int:
            print(call, file=asked, flush=True)
            return int(answers.readline())

        yield at
        asked.close()


def calls_of(work: Callable[[], object]) -> list[str]:
    with failing(0, full) as calls:
        work()
    return calls


def refusal(work: Callable[[], object]) -> str:
    """Return the message of our error, empty when there is none."""
    try:
        work()
    except RolloutError as error:
        return str(error)
    return ""


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# One file.


def test_a_full_disk_at_any_call_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    total = len(calls_of(lambda: files.write(path, "old")))
    assert total >= 5
    for at in range(1, total + 1):
        with failing(at, full) as calls:
            said = refusal(lambda: files.write(path, "new"))
        # What fails after the renaming is no reason to say that the file is not there.
        renamed = "replace" in calls[: at - 1]
        assert said == ("" if renamed else f"{path}: cannot be written: No space left on device")
        assert content(tmp_path) == {"a.txt": b"new" if renamed else b"old"}
        path.write_text("old")


def test_a_process_that_is_killed_at_any_call_leaves_the_old_or_the_new_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    total = len(calls_of(lambda: files.write(path, "old")))
    with killing("files.write(path, 'new')", path) as killed_at:
        for at in range(1, total + 1):
            path.write_text("old")
            assert killed_at(at) == -signal.SIGKILL
            assert path.read_text() in ("old", "new")
    left = [each for each in tmp_path.iterdir() if each != path]
    assert left
    files.write(path, "newer")
    assert all(each.exists() for each in left)  # they may belong to somebody who writes at this moment
    for each in left:
        os.utime(each, (0, 0))
    files.write(path, "newest")
    assert content(tmp_path) == {"a.txt": b"newest"}


def test_an_interrupt_leaves_the_old_file(tmp_path: Path) -> None:
    path = files.write(tmp_path / "a.txt", "old")

    def interrupted() -> None:
        raise KeyboardInterrupt

    for at in range(1, 1 + calls_of(lambda: files.write(path, "old")).index("replace")):
        with failing(at, interrupted), pytest.raises(KeyboardInterrupt):
            files.write(path, "new")
        assert content(tmp_path) == {"a.txt": b"old"}


def test_a_file_keeps_its_permissions_and_a_new_one_gets_the_usual_ones(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        path = files.write(tmp_path / "a.txt", "a")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    path.chmod(0o604)
    files.write(path, "b")
    assert stat.S_IMODE(path.stat().st_mode) == 0o604


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write to every file")
def test_a_file_that_is_protected_stays(tmp_path: Path) -> None:
    (path := tmp_path / "a.txt").write_text("old")
    path.chmod(0o444)
    with pytest.raises(RolloutError, match="Permission denied"):
        files.write(path, "new")
    assert path.read_text() == "old"


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("a.txt")
    files.write(tmp_path / "link", "a")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "a.txt").read_text() == "a"


def test_pipes_and_devices_are_written_to_and_stay(tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "pipe")
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    files.write(pipe, "through the pipe")
    reader.join(10)
    assert read == [b"through the pipe"]
    assert list(tmp_path.iterdir()) == [pipe]
    files.write("/dev/null", "nothing")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_the_longest_name_is_no_trouble(tmp_path: Path) -> None:
    assert files.write(tmp_path / ("ä" * 125 + ".html"), "a").read_text() == "a"


def test_what_is_no_unicode_is_written_all_the_same(tmp_path: Path) -> None:
    assert files.write(tmp_path / "a", "\udcff").read_text() == "\\udcff"


# Sets.


def whole(folder: Path) -> bool:
    """Tell whether a folder passes for a set."""
    try:
        files.check_set(folder)
    except RolloutError:
        return False
    return True


def set_of(contents: dict[str, Any]) -> dict[str, bytes]:
    return {name: text.encode() if isinstance(text, str) else text for name, text in contents.items()}


def assert_no_mixture_passes(folder: Path) -> None:
    """Check that every file is an old or a new one, and a mixture is seen."""
    found = content(folder)
    found.pop(files.SUMS, None)
    old, new = set_of(OLD), set_of(NEW)
    assert all(found[name] in (old[name], new[name]) for name in found)
    assert whole(folder) or found != old
    assert found in (old, new) or not whole(folder)


def test_a_full_disk_at_any_call_of_a_set_leaves_the_old_one_or_shows(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    files.write_set(folder, OLD)
    names = {*OLD, files.SUMS}
    calls = calls_of(lambda: files.write_set(folder, OLD))
    first = calls.index("replace")
    for at in range(1, len(calls) + 1):
        with failing(at, full):
            said = refusal(lambda: files.write_set(folder, NEW))
        assert said in ("", f"{folder}: cannot be written: No space left on device")
        assert {path.name for path in folder.iterdir()} == names
        assert_no_mixture_passes(folder)
        if at <= first + 1:
            assert (folder / "a.txt").read_text() == "old a"
            assert whole(folder)
        files.write_set(folder, OLD)
        assert whole(folder)


def test_a_process_that_is_killed_at_any_call_of_a_set_leaves_no_mixture_that_passes(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    files.write_set(folder, OLD)
    total = len(calls_of(lambda: files.write_set(folder, OLD)))
    mixtures = 0
    with killing("files.write_set(path, NEW)", folder) as killed_at:
        for at in range(1, total + 1):
            shutil.rmtree(folder)
            folder.mkdir()
            files.write_set(folder, OLD)
            assert killed_at(at) == -signal.SIGKILL
            for path in folder.glob(".*.part"):
                path.unlink()
            assert_no_mixture_passes(folder)
            mixtures += not whole(folder)
    assert mixtures == len(OLD)  # between the first renaming and the last


def test_the_hashes_are_those_of_sha256sum(tmp_path: Path) -> None:
    written = files.write_set(tmp_path, NEW)
    assert [path.name for path in written] == [*NEW, "SHA256SUMS"]
    digest = hashlib.sha256(b"new a").hexdigest()
    assert (tmp_path / files.SUMS).read_text().splitlines()[0] == f"{digest}  a.txt"
    if shutil.which("sha256sum"):
        subprocess.run(["sha256sum", "--check", "--quiet", files.SUMS], cwd=tmp_path, check=True)


def test_a_file_of_a_set_that_is_changed_or_missing_is_named(tmp_path: Path) -> None:
    (tmp_path / "d.txt").write_text("d")
    files.write_set(tmp_path, NEW, also=["d.txt"])
    files.check_set(tmp_path)
    (tmp_path / "d.txt").write_text("D")
    with pytest.raises(RolloutError, match=r"d\.txt: is not the file that .*SHA256SUMS names; it was"):
        files.check_set(tmp_path)
    files.check_set(tmp_path, ["a.txt"])
    (tmp_path / "a.txt").unlink()
    with pytest.raises(RolloutError, match=r"a\.txt: is missing"):
        files.check_set(tmp_path)
    (tmp_path / files.SUMS).unlink()
    files.check_set(tmp_path)  # no set


@pytest.mark.parametrize(
    "text", [b"", b"\n\n", b"\xff\xfe\0", b"x  ../../etc/passwd\n", b"a  \0\n", b"a" * 2_000_000]
)
def test_any_file_of_hashes_is_read_or_refused(tmp_path: Path, text: bytes) -> None:
    (tmp_path / files.SUMS).write_bytes(text)
    whole(tmp_path)


# What writes.


@pytest.mark.skipif(sys.platform != "linux", reason="limits the size of files")
def test_a_rollout_for_which_there_is_no_room_leaves_the_old_one(tmp_path: Path) -> None:
    """The disk is full inside HDF5, which does not write through Python."""
    arm = armgpi.Robot.load("anthropomorphic3")
    loop = (armgpi.RigidBodyPlant(arm), armgpi.GPI(arm, 1e-3), armgpi.Hold([0.0, 0.1, 0.0]))
    target = armgpi.save(armgpi.simulate(*loop, 0.1), tmp_path / "a.nc")
    before = target.read_bytes()
    longer = armgpi.simulate(*loop, 0.5)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for size in np.linspace(0, armgpi.save(longer, tmp_path / "b.nc").stat().st_size - 1, 12, dtype=int):
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(size), limits[1]))
        try:
            with pytest.raises(RolloutError, match=r"a\.nc: cannot be written"):
                armgpi.save(longer, target)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert target.read_bytes() == before
        assert {path.name for path in tmp_path.iterdir()} == {"a.nc", "b.nc"}


def test_a_rollout_of_another_run_is_refused(tmp_path: Path) -> None:
    arm = armgpi.Robot.load("anthropomorphic3")
    loop = (armgpi.RigidBodyPlant(arm), armgpi.GPI(arm, 1e-3), armgpi.Hold([0.0, 0.1, 0.0]))
    armgpi.save(armgpi.simulate(*loop, 0.01), tmp_path / "rollout.nc")
    files.write_set(tmp_path, {}, also=["rollout.nc"])
    armgpi.load(tmp_path / "rollout.nc")
    armgpi.save(armgpi.simulate(*loop, 0.02), tmp_path / "rollout.nc")
    with pytest.raises(RolloutError, match=r"rollout\.nc: is not the file that"):
        armgpi.load(tmp_path / "rollout.nc")


def test_nothing_in_the_package_writes_files_by_itself() -> None:
    """Whatever a user asks for goes through `armgpi.base.files`; what is left is in temporary folders.

    loop/memory.py fills a file that `files.replace_files` gave it, and validation/containment.py tells the
    kernel which user a namespace has.
    """
    root = Path(armgpi.__file__).parent
    ways = (".write_text(", ".write_bytes(", 'open("w', ".to_netcdf(")
    found = {
        str(path.relative_to(root))
        for path in root.rglob("*.py")
        if any(way in path.read_text(encoding="utf-8") for way in ways)
    }
    assert found == {"base/files.py", "codegen/build.py", "loop/memory.py", "validation/containment.py"}


@pytest.mark.parametrize("size", [1, 16, 1000])
def test_texts_of_a_file_are_counted_as_numpy_keeps_them(size: int) -> None:
    kind = h5py.h5t.py_create(np.dtype(f"S{size}"))
    assert hdf5._memory(kind, 7, "names") >= np.zeros(7, f"U{size}").nbytes


def test_texts_of_variable_length_count_with_all_their_letters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "texts.nc"
    with h5py.File(path, "w") as file:
        file["first"] = ["x" * 1000, "y" * 500]
        file["second"] = ["z" * 1500]
    with h5py.File(path) as file:
        found = hdf5._Found("first", file["first"].id)
        alone = hdf5._memory(found.object.get_type(), 2, "variable")
        assert hdf5._size(found, 1e9) == alone + 4 * 1500
    # Neither is too large by itself, and both together are.
    monkeypatch.setattr(files, "allowance", lambda _: 4 * 2900)
    with pytest.raises(hdf5.Refused, match=r"its variables up to '(first|second)' take"):
        hdf5.check(path)
    monkeypatch.setattr(files, "allowance", lambda _: 4 * 3500)
    hdf5.check(path)
