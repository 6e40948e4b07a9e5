"""A process whose end is the end of everything that it has started, and what keeps it from the machine.

A process group does not hold what calls ``setsid``, and a process that forks twice has no parent left who
knows of it. On Linux, a keeper between armgpi and the model adopts such orphans (``PR_SET_CHILD_SUBREAPER``)
and ends them all, also when armgpi itself is killed. Elsewhere the group of the model is all that ends.

:func:`isolate` goes further: in namespaces of its own a process has no network, sees no other process, and
can write nothing but a small folder in memory. It needs user namespaces, which some systems forbid.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
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
SCRATCH, _SCRATCH_SIZE = "/dev/shm", "64m"
#: Why there is no isolation where a system has no Linux.
_NO_LINUX = "it needs Linux"


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
        yield "the memory of the model is not bounded on this system"
    if not adopts():
        yield "processes that the model starts in a session of their own are not ended on this system"


def keep(run: Callable[[], None]) -> None:
    """Run something in a child, end whatever it has started when it ends, and end as it ended.

    SIGTERM ends the child and all that it has started. On Linux the death of the parent does the same.
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
    status = _wait(child, waited)
    end_children(child)
    _end_like(status)


def _wait(child: int, waited: set[signal.Signals]) -> int | None:
    """Return the status with which a child ended; None when SIGTERM came first."""
    while True:
        if signal.sigwait(waited) == signal.SIGTERM:
            return None
        while True:
            try:
                ended, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return None
            if ended == child:
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
    os._exit(max(code, 0))


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
