"""A process whose end is the end of everything that it has started, and what keeps it from the machine.

A process group does not hold what calls ``setsid``, and a process that forks twice has no parent left who
knows of it. On Linux, a keeper between armgpi and the model adopts such orphans (``PR_SET_CHILD_SUBREAPER``)
and ends them all, also when armgpi itself is killed. Elsewhere the group of the model is all that ends.

:func:`isolate` goes further: in namespaces of its own a process has no network, sees no other process, and
can write nothing but a small folder in memory. Some systems forbid that to all programs but bubblewrap, which
then does the same to a fresh Python (:func:`bubblewrap`). :func:`find_means` tries which of both works.
"""

from __future__ import annotations

import ctypes
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

#: prctl(2), <linux/prctl.h>.
_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_PR_SET_NO_NEW_PRIVS = 38
#: unshare(2), <linux/sched.h>: mounts, System V IPC, users, processes, network.
_CLONE_NEWNS = 0x00020000
_CLONE_NEWIPC = 0x08000000
_CLONE_NEWUSER = 0x10000000
_CLONE_NEWPID = 0x20000000
_CLONE_NEWNET = 0x40000000
#: mount_setattr(2), Linux 5.12, <linux/mount.h>, <linux/fcntl.h>; the number is that of all architectures.
_MOUNT_SETATTR = 442
_MOUNT_ATTR_RDONLY = 1
_AT_FDCWD = -100
_AT_RECURSIVE = 0x8000
#: capset(2), <linux/capability.h>.
_CAPABILITY_VERSION_3 = 0x20080522
#: What a process in isolation may write, in memory.
SCRATCH, _SCRATCH_SIZE = "/dev/shm", 64 * 2**20
#: Why there is no isolation where a system has no Linux.
_NO_LINUX = "it needs Linux"
#: What isolates a process: namespaces that it makes itself, or the program bubblewrap.
NAMESPACES, BUBBLEWRAP = "user namespaces", "bubblewrap"
#: Exit code for a process in isolation that a signal ended, less the signal; as of shells.
SIGNALLED = 128
#: Exit code of a keeper whose process took too much memory, and time between two looks at it [s].
FULL, _LOOK = 99, 0.2
#: How long bubblewrap may take to run a program that does nothing [s].
_TRIAL = 20.0


class Unavailable(Exception):
    """This system has no way to isolate a process; the text says why."""


class _MountAttributes(ctypes.Structure):
    """The ``mount_attr`` of mount_setattr(2)."""

    _fields_ = (
        ("set", ctypes.c_uint64),
        ("clear", ctypes.c_uint64),
        ("propagation", ctypes.c_uint64),
        ("userns", ctypes.c_uint64),
    )


def adopts() -> bool:
    """Tell whether this system gives orphans to a process that asks for them, so that all can be ended."""
    return sys.platform == "linux"


def bounds_memory() -> bool:
    """Tell whether this system holds a process to RLIMIT_AS; macOS takes the limit and ignores it."""
    return sys.platform == "linux"


def gaps() -> Iterator[str]:
    """Yield what this system does not keep a model from, as notes of a report."""
    if not bounds_memory():
        bound = "is bounded by a look at it five times a second" if shutil.which("ps") else "is not bounded"
        yield f"the memory of the model {bound} on this system"
    if not adopts():
        yield "processes that the model starts in a session of their own are not ended on this system"


def keep(run: Callable[[], None], memory: int) -> None:
    """Run something in a child, end whatever it has started when it ends, and end as it ended.

    SIGTERM ends the child and all that it has started. On Linux the death of the parent does the same. Where
    the system does not bound memory, another process ends them beyond `memory` [bytes]: see :data:`FULL`.
    """
    parent = os.getppid()
    # With a handler, as some systems drop a signal that would be ignored before anyone waits for it.
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    waited = {signal.SIGCHLD, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, waited)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the business of armgpi, which then ends us
    if adopts():
        _prctl(_PR_SET_CHILD_SUBREAPER, 1)
        _prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:
            os._exit(1)
    child = os.fork()
    if not child:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, waited)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        if adopts():
            _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        run()
        os._exit(0)
    guard = _start_guard(child, memory)
    status = _wait({child, *guard}, waited)
    for process in guard:  # where there is no /proc, nothing else ends it
        with suppress(OSError):
            os.kill(process, signal.SIGKILL)
    end_children(child)
    _end_like(status)


def _start_guard(child: int, memory: int) -> list[int]:
    """Start what looks at a child's memory [bytes] where no limit holds it; return the guard's process."""
    if bounds_memory() or shutil.which("ps") is None:
        return []
    keeper = os.getpid()
    guard = os.fork()
    if guard:
        return [guard]
    try:
        base = size = _resident(child)
        while size and os.getppid() == keeper:
            if size > base + memory:
                os._exit(FULL)
            time.sleep(_LOOK)
            size = _resident(child)
        while os.getppid() == keeper:  # which is about to end this process
            time.sleep(_LOOK)
    finally:
        os._exit(1)


def _resident(first: int) -> int:
    """Return the memory that a process and its descendants have [bytes], as `ps` tells on every system."""
    told = subprocess.run(["ps", "-A", "-o", "pid=,ppid=,rss="], stdout=subprocess.PIPE, check=False).stdout
    parents, sizes = dict[int, int](), dict[int, int]()
    for line in told.decode("ascii", "replace").splitlines():
        with suppress(ValueError):
            process, parent, kilobytes = map(int, line.split())
            parents[process], sizes[process] = parent, 1024 * kilobytes
    total = 0
    for process, size in sizes.items():
        ancestor = process
        while ancestor not in (first, 0, 1) and ancestor in parents:
            ancestor = parents[ancestor]
        if ancestor == first:
            total += size
    return total


def _wait(children: set[int], waited: set[signal.Signals]) -> int | None:
    """Return the status with which the first of some children ended; None when SIGTERM came before."""
    while True:
        if signal.sigwait(waited) == signal.SIGTERM:
            return None
        while True:
            try:
                ended, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return None
            if ended in children:
                return status
            if not ended:
                break


def end_children(group: int) -> None:
    """End a group of processes, all children of this process, and theirs: each is adopted as its parent ends.

    It returns when none is left; without adoption, when none of its own children is.
    """
    with suppress(OSError):
        os.killpg(group, signal.SIGKILL)
    with suppress(OSError):
        os.kill(group, signal.SIGKILL)
    while True:
        for child in _children():
            with suppress(OSError):
                os.kill(child, signal.SIGKILL)
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def _children() -> list[int]:
    """Return the processes whose parent is this one; none where there is no /proc."""
    own, found = os.getpid(), []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            # Behind the name, which may contain anything, are the state and the parent.
            if int(entry.read_text(errors="replace").rpartition(")")[2].split()[1]) == own:
                found.append(int(entry.parent.name))
    return found


def _end_like(status: int | None) -> None:
    """End this process as a child ended."""
    code = 0 if status is None else os.waitstatus_to_exitcode(status)
    if code < 0:
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with suppress(OSError, ValueError):
            signal.signal(-code, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [-code])
        os.kill(os.getpid(), -code)
    # The first process of a namespace is not ended by its own signals.
    os._exit(code if code >= 0 else SIGNALLED - code)


def isolate() -> None:
    """Give this process and its future children namespaces of their own; the next fork is in all of them.

    Raises:
        Unavailable: when this system has none, or forbids them.
    """
    if sys.platform != "linux":
        raise Unavailable(_NO_LINUX)
    user, group = os.getuid(), os.getgid()
    spaces = _CLONE_NEWUSER | _CLONE_NEWNS | _CLONE_NEWPID | _CLONE_NEWNET | _CLONE_NEWIPC
    _check(_libc().unshare(spaces), "unshare")
    try:
        Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1", encoding="ascii")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1", encoding="ascii")
    except OSError as error:
        raise Unavailable(f"users cannot be mapped: {error.strerror}") from None


def close_off() -> None:
    """Make all files read-only to this process, for good; it was forked after :func:`isolate`.

    It sees a /proc of its own processes alone, or an empty one. It may write into :data:`SCRATCH`, and
    `TMPDIR` is set to that, where the system lets a file system in memory be mounted there; nowhere else.
    It gains no privileges by what it starts, and gives up the capabilities of its namespace, with which it
    could undo this.

    Raises:
        Unavailable: when this system cannot do that.
    """
    libc = _libc()
    attributes = _MountAttributes(_MOUNT_ATTR_RDONLY, 0, 0, 0)
    size = ctypes.c_size_t(ctypes.sizeof(attributes))
    read_only = libc.syscall(
        _MOUNT_SETATTR, _AT_FDCWD, b"/", ctypes.c_uint(_AT_RECURSIVE), ctypes.byref(attributes), size
    )
    _check(read_only, "read-only files")
    # Where the system itself hides part of /proc, no new one is given: then there is none at all.
    if libc.mount(b"proc", b"/proc", b"proc", 0, None):
        _check(libc.mount(b"none", b"/proc", b"tmpfs", 0, b"size=4k"), "a /proc of its own")
    options = f"size={_SCRATCH_SIZE},mode=0700".encode()
    if Path(SCRATCH).is_dir() and not libc.mount(b"none", SCRATCH.encode(), b"tmpfs", 0, options):
        os.environ["TMPDIR"] = SCRATCH
    _prctl(_PR_SET_NO_NEW_PRIVS, 1)
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION_3, 0)
    _check(libc.capset(header, (ctypes.c_uint32 * 6)()), "capset")


def find_means() -> str:
    """Return what isolates a process on this system, :data:`NAMESPACES` or :data:`BUBBLEWRAP`, by trying.

    Raises:
        Unavailable: when neither does; the text says why of each.
    """
    if sys.platform != "linux":
        raise Unavailable(_NO_LINUX)
    forbidden = _try_namespaces()
    if not forbidden:
        return NAMESPACES
    failed = _try_bubblewrap()
    if not failed:
        return BUBBLEWRAP
    raise Unavailable(f"{NAMESPACES}: {forbidden}; {BUBBLEWRAP}: {failed}")


def _try_namespaces() -> str:
    """Return why a process cannot isolate itself here, as forks tell that try; "" when it can."""
    reader, writer = os.pipe()
    tried = os.fork()
    if not tried:
        why = ""
        try:
            isolate()
            inner = os.fork()  # the first process in the namespaces
            if inner:
                os.waitpid(inner, 0)
                os._exit(0)
            close_off()
        except Unavailable as error:
            why = str(error)
        except OSError as error:
            why = f"fork: {error.strerror}"
        os.write(writer, (why or "works").encode())
        os._exit(0)
    os.close(writer)
    os.waitpid(tried, 0)
    with open(reader, encoding="utf-8") as said:
        why = said.read() or "the process that tried has ended"
    return "" if why == "works" else why


def _try_bubblewrap() -> str:
    """Return why bubblewrap isolates no process here; "" when it does."""
    try:
        command = [*bubblewrap(), sys.executable, "-I", "-S", "-c", ""]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TRIAL, check=False)
    except Unavailable as error:
        return str(error)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{type(error).__name__} when it was started"
    if not done.returncode:
        return ""
    lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
    return lines[-1].removeprefix("bwrap: ").strip()[:200]


def bubblewrap() -> list[str]:
    """Return the start of a command that bubblewrap isolates, as :func:`isolate` and :func:`close_off` do.

    Raises:
        Unavailable: when this system does not have it.
    """
    found = shutil.which("bwrap")
    if found is None:
        raise Unavailable("it is not installed (`apt install bubblewrap`)")
    # Everything read-only, then devices, processes and a scratch folder of its own.
    files = [*("--ro-bind", "/", "/"), *("--dev", "/dev"), *("--proc", "/proc")]
    scratch = ["--size", str(_SCRATCH_SIZE), "--tmpfs", SCRATCH, "--remount-ro", "/dev"]
    namespaces = ["--unshare-all", "--die-with-parent", "--cap-drop", "ALL"]
    return [found, *namespaces, *files, *scratch, "--setenv", "TMPDIR", SCRATCH]


def close_others(kept: Sequence[int]) -> None:
    """Close every file and socket of this process but its standard streams and those that it keeps.

    A model in isolation would write and send through those that armgpi, or the program around it, has open.
    """
    least = 3
    for descriptor in sorted({*kept, 2, os.sysconf("SC_OPEN_MAX")}):
        os.closerange(least, descriptor)
        least = max(least, descriptor + 1)


def _libc() -> ctypes.CDLL:
    """Return the C library of this process."""
    return ctypes.CDLL(None, use_errno=True)


def _prctl(option: int, value: int) -> None:
    """Set an attribute of this process; a kernel without it changes nothing."""
    with suppress(OSError, AttributeError):
        _libc().prctl(option, ctypes.c_ulong(value), *[ctypes.c_ulong(0)] * 3)


def _check(result: int, what: str) -> None:
    """Raise what a call of the C library failed with."""
    if result:
        raise Unavailable(f"{what}: {os.strerror(ctypes.get_errno())}")
