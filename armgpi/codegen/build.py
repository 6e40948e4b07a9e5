"""From generated C to a loaded library: compiled once, kept by what it was made from."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import re
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from armgpi.base.cache import RESULTS, Untrusted, cache_folder, open_folder, why_shared
from armgpi.errors import ArmgpiWarning, BackendError

#: Strict arithmetic: no reordering and no fused multiply-add, so every machine and number of lanes gives the
#: same bits. What is left out is errno and traps, which nothing here checks.
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
    "-falign-functions=64",  # or how fast one is depends on the length of those before it, by up to a tenth
    "-fPIC",
    "-shared",
    "-w",  # generated code has constants that are not used, say
)
#: For one number at a time: operations that wait for each other are put farther apart.
SCALAR = ("-fschedule-insns",)
#: For a run that is short: its code is there in half of the time, and its bits are those of any level.
QUICK = ("-O0",)
#: Passes of GCC that find nothing in straight lines, for up to a third of its time. Clang lacks the names.
_FRUITLESS = ("-fno-tree-pta", "-fno-gcse", "-fno-rerun-cse-after-loop", "-fno-tree-pre")
#: Entries kept at most, a library has one or two; the ones used least recently go.
_KEPT = 512
#: What they are called.
_ENTRY = re.compile(r"[0-9a-f]{32}-[0-9a-f]{16}\.(so|wasm|made)")
#: Longest time that a compiler may take [s]; the first call of Zig's takes 20.
_PATIENCE = 600.0
#: About what it takes to trace, generate and compile a loop, for each joint [s]: at full speed, and quickly.
_JOINT, _QUICK_JOINT = 0.1, 0.06


#: The compiler of the package `ziglang`: for machines that have no other, and for WebAssembly.
ZIG = (sys.executable, "-m", "ziglang", "cc")


class Compiler(NamedTuple):
    """A C compiler.

    Attributes:
        command: how it is called.
        version: what it says of itself.
    """

    command: tuple[str, ...]
    version: str

    @property
    def flags(self) -> tuple[str, ...]:
        """What it alone knows."""
        return _FRUITLESS if "Free Software Foundation" in self.version else ()


@lru_cache(maxsize=4)
def probe(command: tuple[str, ...], path: str | None) -> Compiler | None:
    """Return a compiler that answers, None when it does not; `path` is the PATH that it is looked for in."""
    if shutil.which(command[0], path=path) is None:
        return None
    try:
        said = run_program([*command, "--version"], 30.0)
    except (OSError, subprocess.SubprocessError):
        return None
    return None if said.returncode else Compiler(command, said.stdout.decode(errors="replace"))


def run_program(
    command: Sequence[str], patience: float, folder: Path | None = None, temporary: Path | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run a program and return what it says, in English; on Ctrl-C, or without an answer in time, end it.

    A compiler is a driver with children (cc1, ld, those of a script): in a session of their own, so that
    all of them end, not the driver alone.

    Args:
        command: the program and its arguments.
        patience: how long it may take [s].
        folder: where to run it.
        temporary: where it puts its temporary files; what it leaves there when it is ended is the caller's
            to remove. The usual folder of this machine by default.

    Raises:
        OSError: when it cannot be started.
        subprocess.TimeoutExpired: when it takes longer.
    """
    environment = {**os.environ, "LC_ALL": "C"}
    if temporary is not None:
        environment["TMPDIR"] = str(temporary.absolute())
    # Ctrl-C waits until there is something to end.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
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
    """Return the C compiler: what CC names, or cc, gcc or clang, or the one of the package `ziglang`.

    Raises:
        BackendError: when there is none.
    """
    asked = os.environ.get("CC", "")
    for command in _commands(asked):
        found = probe(command, os.environ.get("PATH"))
        if found is not None:
            return found
    wanted = f"CC names {asked!r}, which does not run" if asked else "none of cc, gcc and clang is there"
    raise BackendError(
        f"no C compiler: {wanted}; install GCC or Clang, set CC, or take Zig's: pip install ziglang"
    )


def _commands(asked: str) -> Iterator[tuple[str, ...]]:
    """Yield the commands of compilers, the next one when those before do not run."""
    if not asked:
        yield from (("cc",), ("gcc",), ("clang",))
        if find_spec("ziglang") is not None:
            yield ZIG
        return
    yield (asked,)  # a path may have spaces in it
    with suppress(ValueError):  # a quotation without an end
        yield tuple(shlex.split(asked)) or ("",)


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


# Libraries are never unloaded: a run may still be inside of one.
_loaded: dict[str, ctypes.CDLL] = {}


def none_known() -> bool:
    """Tell whether no library is there at all, made by this process or kept by one before."""
    with suppress(OSError), os.scandir(cache_folder()) as entries:
        return not _loaded and not any(entry.name != RESULTS for entry in entries)
    return not _loaded


def check_patience(joints: int, patience: float, quick: bool = True) -> None:
    """Refuse to compile a loop of so many joints where that takes longer than it may [s].

    Args:
        joints: of the arm.
        patience: how long it may take [s].
        quick: whether it would be compiled with :data:`QUICK`.

    Raises:
        BackendError: when it does.
    """
    if (about := (_QUICK_JOINT if quick else _JOINT) * joints) > patience:
        raise BackendError(f"compiling it takes longer than NumPy: about {about:.1f} s")


@lru_cache(maxsize=1)
def package() -> str:
    """Return a name for what decides what is generated: this package's code, and what it generates with."""
    content = hashlib.sha256(" ".join(map(version, ("casadi", "numpy"))).encode())
    root = Path(__file__).parents[1]
    for folder, folders, names in os.walk(root):  # in half of the time of Path.rglob
        folders.sort()
        for name in sorted(name for name in names if name.endswith((".py", ".h"))):
            path = os.path.join(folder, name)
            with open(path, "rb") as file:
                content.update(f"{path.removeprefix(str(root))}\0".encode() + file.read())
    return content.hexdigest()


def _key(found: Compiler, *parts: str) -> str:
    """Return the name of an entry by a compiler for this CPU."""
    return hashlib.sha256("\0".join([*parts, found.version, *found.command, cpu()]).encode()).hexdigest()[:32]


def find_library(name: str, flags: tuple[str, ...] = FLAGS) -> ctypes.CDLL | None:
    """Return the library that was given this name once, by this version of the package; None without one.

    Raises:
        BackendError: when there is no compiler, or the library cannot be loaded.
    """
    key = _key(compiler(), name, package(), *flags)
    if key not in _loaded and (kept := _find(_LIBRARY, key)) is not None:
        _loaded[key] = kept
    return _loaded.get(key)


def library(source: str, flags: tuple[str, ...] = FLAGS, name: str = "") -> ctypes.CDLL:
    """Return the library of a C source, compiled now or before.

    An entry is named by a hash of the source, the compiler, its flags and the CPU, and by one of its own
    content, so that a damaged one is not taken. It appears whole or not at all. What is loaded runs, so the
    cache is used only where nobody else can write; otherwise a warning says why, and the library is compiled
    for this process alone.

    Args:
        source: the C.
        flags: of the compiler.
        name: under which :func:`find_library` finds it without its source.

    Raises:
        BackendError: when there is no compiler, or it fails.
    """
    found = compiler()
    key = _key(found, source, *flags)
    alias = _key(found, name, package(), *flags) if name else ""
    if key not in _loaded:
        _loaded[key] = _obtain(_LIBRARY, key, _compiled(source, found, (*flags, "-lm")), alias)
    return _loaded[key]


def wasm(source: str, found: Compiler, flags: tuple[str, ...], name: str = "") -> bytes:
    """Return WebAssembly of a C source, compiled now or before; it is kept as libraries are.

    Raises:
        BackendError: when the compiler fails.
    """
    alias = _key(found, name, package()) if name else ""
    return _obtain(_WASM, _key(found, source, *flags), _compiled(source, found, flags), alias)


def find_wasm(name: str, found: Compiler) -> bytes | None:
    """Return the WebAssembly that was given this name once, by this version of the package."""
    return _find(_WASM, _key(found, name, package()))


def keep(name: str, found: Compiler, make: Callable[[Path], bytes]) -> bytes:
    """Return what a compiler made once of what has this name; it is kept as libraries are.

    Args:
        name: tells all that decides what is made, but for compiler and CPU.
        found: the compiler.
        make: makes it, in an empty folder.

    Raises:
        BackendError: when `make` raises it, or there is no folder.
    """

    def compile_into(built: Path) -> None:
        built.write_bytes(make(built.parent))

    return _obtain(_MADE, _key(found, name), compile_into)


_Made = TypeVar("_Made")


class _Kind(NamedTuple, Generic[_Made]):
    """What is made of C.

    Attributes:
        suffix: of its files.
        load: makes it of a file.
    """

    suffix: str
    load: Callable[[Path], _Made]


_LIBRARY = _Kind(".so", lambda path: ctypes.CDLL(str(path)))
_WASM = _Kind(".wasm", Path.read_bytes)
_MADE = _Kind(".made", Path.read_bytes)


def _find(kind: _Kind[_Made], key: str) -> _Made | None:
    """Return what is kept, None where it is not."""
    with suppress(OSError), open_folder(cache_folder()) as (place, opened):
        return _load_kept(place, opened, key, kind)
    return None


def _compiled(source: str, found: Compiler, flags: tuple[str, ...]) -> Callable[[Path], None]:
    """Return what compiles a C source into a file, in a folder of the file's own.

    What it returns raises `BackendError` when the compiler fails.
    """

    def compile_into(built: Path) -> None:
        text = built.with_name("loop.c")
        text.write_text(source, encoding="utf-8")
        arguments = [str(text), *flags, *found.flags, "-o", str(built)]
        run_compiler(found.command, arguments, built, _PATIENCE)

    return compile_into


def _obtain(kind: _Kind[_Made], key: str, make: Callable[[Path], None], alias: str = "") -> _Made:
    """Return what is kept, or make it: in the cache, or where it cannot be kept."""
    try:
        return _from(cache_folder(), kind, key, make, alias)
    except Untrusted as error:
        message = f"compiled code is not kept: {error}; ARMGPI_CACHE names another folder"
        warnings.warn(ArmgpiWarning(message), stacklevel=3)
    except OSError:  # a home that cannot be written
        pass
    try:
        with tempfile.TemporaryDirectory(prefix="armgpi-", ignore_cleanup_errors=True) as private:
            return _from(Path(private), kind, key, make)
    except OSError as error:
        raise BackendError(f"no folder to compile in: {error}") from None


def _from(folder: Path, kind: _Kind[_Made], key: str, make: Callable[[Path], None], alias: str = "") -> _Made:
    """Return what is kept in a folder, or make it there; `alias` is its other entry.

    Raises:
        OSError: when the folder cannot be used, `Untrusted` when others can write to it.
    """
    with open_folder(folder) as (place, opened):
        kept = _load_kept(place, opened, key, kind)
        if kept is None:
            _make(key + kind.suffix, make, place)
            kept = _load_kept(place, opened, key, kind)
        if kept is None:
            raise BackendError(f"{place}: what was compiled cannot be read back")
        for name in os.listdir(opened) if alias else ():
            if name.startswith(f"{key}-"):
                with suppress(OSError):  # it is there, or the folder can only be read
                    os.link(name, name.replace(key, alias), src_dir_fd=opened, dst_dir_fd=opened)
        return kept


def _load_kept(folder: Path, opened: int, key: str, kind: _Kind[_Made]) -> _Made | None:
    """Return what is whole and ours from an opened folder; what is damaged or not ours is removed."""
    # By the descriptor, so that it comes from the folder that was checked.
    base = Path(f"/proc/self/fd/{opened}")
    base = base if base.is_dir() else folder
    for name in sorted(os.listdir(opened)):
        if not (name.startswith(f"{key}-") and name.endswith(kind.suffix)):
            continue
        with suppress(OSError):  # a folder, or what cannot be removed
            if _is_whole(name, opened):
                try:
                    return kind.load(base / name)
                except OSError as error:
                    with suppress(OSError):  # the next one makes it anew
                        os.unlink(name, dir_fd=opened)
                    raise BackendError(f"{folder / name}: cannot be loaded: {error}") from None
            os.unlink(name, dir_fd=opened)
    return None


def _is_whole(name: str, folder: int) -> bool:
    """Tell whether an entry is a file of ours with the content that its name says."""
    try:
        opened = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
    except OSError:  # a link
        return False
    with open(opened, "rb") as file:
        info = os.fstat(opened)
        if not stat.S_ISREG(info.st_mode) or why_shared(info):
            return False
        if hashlib.sha256(file.read()).hexdigest()[:16] != Path(name).stem.rpartition("-")[2]:
            return False
        with suppress(OSError):  # of a cache that can only be read
            os.utime(opened)
    return True


def _make(name: str, make: Callable[[Path], None], folder: Path) -> None:
    """Make a file, and move it to its place in a folder; `name` is its key and suffix.

    Raises:
        OSError: when nothing can be made in the folder.
        BackendError: when the compiler fails.
    """
    key, _, suffix = name.partition(".")
    work = Path(tempfile.mkdtemp(prefix=f".{key}.", dir=folder))
    try:
        built = work / f"loop.{suffix}"
        make(built)
        built.chmod(0o700)  # whatever the umask
        digest = hashlib.sha256(built.read_bytes()).hexdigest()[:16]
        built.replace(folder / f"{key}-{digest}.{suffix}")
    except OSError as error:
        raise BackendError(f"{folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)
    _prune(folder)


def run_compiler(compiler: Sequence[str], arguments: Sequence[str], file: Path, patience: float) -> None:
    """Run a compiler that makes a file.

    Args:
        compiler: how it is called.
        arguments: of this call.
        file: what it makes, in a folder that is removed soon: the compiler's temporary files are there too.
        patience: how long it may take [s].

    Raises:
        OSError: when it cannot be started.
        BackendError: when it fails, with its first error, or takes longer.
    """
    name = " ".join(compiler)
    try:
        said = run_program([*compiler, *arguments], patience, temporary=file.parent)
    except subprocess.TimeoutExpired:
        raise BackendError(f"{name} took longer than {patience:g} s") from None
    if said.returncode or not file.is_file():
        text = said.stderr.decode(errors="replace")
        # "final link failed: No space left on device" comes before the error that says nothing.
        lines = [line for line in text.splitlines() if "error" in line or "failed" in line]
        raise BackendError(f"{name} failed: {[*lines, 'it said nothing'][0]}")


def _prune(folder: Path) -> None:
    """Remove the libraries used least recently, beyond so many."""
    with suppress(OSError):
        entries = (path for path in folder.iterdir() if _ENTRY.fullmatch(path.name))
        old = sorted(entries, key=lambda path: path.stat().st_mtime)[:-_KEPT]
        for path in old:
            with suppress(OSError):
                path.unlink()
