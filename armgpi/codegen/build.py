"""From generated C to a loaded library: compiled once, kept by what it was made from."""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from armgpi.errors import BackendError

#: Strict arithmetic: no reordering and no fused multiply-add, so every machine and number of lanes gives the
#: same bits. What is left out is errno and traps, which nothing here looks at.
FLAGS = (
    "-std=gnu11",
    "-O2",
    # What this CPU has; on ARM the option has another name.
    "-mcpu=native" if platform.machine() in ("aarch64", "arm64") else "-march=native",
    "-ffp-contract=off",
    # GCC 12 fuses where it makes vectors of scalars (vfmaddsub), whatever the line above says.
    "-fno-tree-slp-vectorize",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fPIC",
    "-shared",
    "-w",
)
#: For one number at a time: operations that wait for each other are put farther apart.
SCALAR = ("-fschedule-insns",)
#: Libraries kept at most; the ones used least recently go.
_KEPT = 256
#: Longest time that a compiler may take [s].
_PATIENCE = 300.0


class Compiler(NamedTuple):
    """A C compiler.

    Attributes:
        command: how it is called.
        version: what it says of itself.
    """

    command: tuple[str, ...]
    version: str


@lru_cache(maxsize=4)
def _probed(command: tuple[str, ...], path: str | None) -> Compiler | None:
    """Return a compiler that answers, None when it does not; `path` is the PATH that it is looked for in."""
    if shutil.which(command[0], path=path) is None:
        return None
    try:
        said = called([*command, "--version"], 30.0)
    except (OSError, subprocess.SubprocessError):
        return None
    return None if said.returncode else Compiler(command, said.stdout.decode(errors="replace"))


def called(
    command: Sequence[str], patience: float, folder: Path | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run a program and return what it says, in English; on Ctrl-C, or without an answer in time, end it.

    A compiler is a driver with children (cc1, ld, those of a script): in a session of their own, so that
    all of them end, not the driver alone.

    Args:
        command: the program and its arguments.
        patience: how long it may take [s].
        folder: where to run it.

    Raises:
        OSError: when it cannot be started.
        subprocess.TimeoutExpired: when it takes longer.
    """
    # Ctrl-C waits until there is something to end.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, "LC_ALL": "C"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        try:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            said = process.communicate(timeout=patience)
        except BaseException:
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            raise
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return subprocess.CompletedProcess(list(command), process.returncode, *said)


def compiler() -> Compiler:
    """Return the C compiler: what CC names, or cc, gcc or clang.

    Raises:
        BackendError: when there is none.
    """
    asked = os.environ.get("CC", "")
    commands: list[tuple[str, ...]] = (
        [(asked,)] if asked else [("cc",), ("gcc",), ("clang",)]
    )  # a path may have spaces in it
    with suppress(ValueError):  # a quotation without an end
        commands.append(tuple(shlex.split(asked)) or ("",))
    for command in commands:
        found = _probed(command, os.environ.get("PATH"))
        if found is not None:
            return found
    wanted = f"CC names {asked!r}, which does not run" if asked else "none of cc, gcc and clang is there"
    raise BackendError(f"no C compiler: {wanted}; install GCC or Clang, or set CC")


@lru_cache(maxsize=1)
def cpu() -> str:
    """Return what this CPU can do, as text."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith(("flags", "Features")):
                return f"{platform.machine()} {line.partition(':')[2].strip()}"
    return f"{platform.machine()} {platform.processor()}"


def lanes(rollouts: int) -> int:
    """Return how many rollouts to work on at once: what ARMGPI_LANES says, or what suits this CPU.

    Raises:
        BackendError: when ARMGPI_LANES is none of 1, 2, 4 and 8.
    """
    if asked := os.environ.get("ARMGPI_LANES"):
        if asked not in ("1", "2", "4", "8"):
            raise BackendError(f"ARMGPI_LANES is {asked!r}, expected 1, 2, 4 or 8")
        return int(asked)
    return 1 if rollouts == 1 else widest()


def widest() -> int:
    """Return how many numbers this CPU works on at once."""
    flags = cpu().split()
    return 8 if "avx512f" in flags and "avx512dq" in flags else 4


def cache_folder() -> Path:
    """Return where libraries are kept: ARMGPI_CACHE, or armgpi in the user's cache folder."""
    if asked := os.environ.get("ARMGPI_CACHE"):
        return Path(asked).absolute()  # a library without a folder in its name is looked for elsewhere
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    except RuntimeError:  # a user without a home, as in some containers
        base = Path(tempfile.gettempdir()) / f"cache-{os.getuid()}"
    return base / "armgpi"


_loaded: dict[str, ctypes.CDLL] = {}


def library(source: str, flags: tuple[str, ...] = FLAGS) -> ctypes.CDLL:
    """Return the library of a C source, compiled now or before.

    An entry is named by a hash of the source, the compiler, its flags and the CPU, and by one of its own
    content, so that a damaged one is not taken. It appears whole or not at all.

    Raises:
        BackendError: when there is no compiler, or it fails.
    """
    found = compiler()
    key = hashlib.sha256(
        "\0".join([source, found.version, *found.command, *flags, cpu()]).encode()
    ).hexdigest()[:32]
    if key not in _loaded:
        path = _cached(key) or _compiled(source, key, found, flags)
        try:
            _loaded[key] = ctypes.CDLL(str(path))
        except OSError as error:
            with suppress(OSError):  # the next one makes it anew
                path.unlink()
            raise BackendError(f"{path}: cannot be loaded: {error}") from None
    return _loaded[key]


def _cached(key: str) -> Path | None:
    """Return a whole entry of the cache."""
    for path in _entries(cache_folder(), f"{key}-*.so"):
        with suppress(OSError):  # a folder, or one that is not ours to read or to remove
            if path.stem.rpartition("-")[2] == _digest(path):
                with suppress(OSError):  # of a cache that can only be read
                    os.utime(path)
                return path
            path.unlink()
    return None


def _entries(folder: Path, pattern: str) -> list[Path]:
    """Return the entries of a cache, none when it cannot be read."""
    with suppress(OSError):
        return list(folder.glob(pattern))
    return []


def _digest(path: Path) -> str:
    """Return a hash of a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _compiled(source: str, key: str, found: Compiler, flags: tuple[str, ...]) -> Path:
    """Compile, and move the library to its place in the cache."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        work = Path(tempfile.mkdtemp(prefix=f".{key}.", dir=folder))
    except OSError:  # a home that cannot be written: compile for this process alone
        try:
            folder = work = Path(tempfile.mkdtemp(prefix="armgpi-"))
        except OSError as error:
            raise BackendError(f"{folder}: cannot be written, nor can a temporary folder: {error}") from None
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    try:
        (work / "loop.c").write_text(source, encoding="utf-8")
        built = work / "loop.so"
        command = [*found.command, *flags, "-o", str(built), str(work / "loop.c"), "-lm"]
        said = called(command, _PATIENCE)
        if said.returncode or not built.is_file():
            text = said.stderr.decode(errors="replace")
            # "final link failed: No space left on device" comes before the error that tells nothing.
            lines = [line for line in text.splitlines() if "error" in line or "failed" in line]
            raise BackendError(f"{' '.join(found.command)} failed: {[*lines, 'it said nothing'][0]}")
        target = folder / f"{key}-{_digest(built)}.so"
        built.replace(target)
    except subprocess.TimeoutExpired:
        raise BackendError(f"{' '.join(found.command)} took longer than {_PATIENCE:g} s") from None
    except OSError as error:
        raise BackendError(f"{folder}: cannot be written: {error.strerror or error}") from None
    finally:
        if work != folder:
            shutil.rmtree(work, ignore_errors=True)
    _prune(folder)
    return target


def _prune(folder: Path) -> None:
    """Remove the libraries used least recently, beyond so many."""
    with suppress(OSError):
        old = sorted(_entries(folder, "*-*.so"), key=lambda path: path.stat().st_mtime)[:-_KEPT]
        for path in old:
            with suppress(OSError):
                path.unlink()
