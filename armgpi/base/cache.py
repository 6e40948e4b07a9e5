"""A folder in which results are kept from one process to the next: compiled code, and what the rule chose."""

from __future__ import annotations

import hashlib
import json
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

#: Folder of small results within the cache.
RESULTS = "results"
#: So many small results are kept, those used last; and how large one may be [bytes].
_KEPT, _LARGEST = 2048, 1 << 20


class Untrusted(OSError):
    """A folder to which somebody else can write."""


def cache_folder() -> Path:
    """Return where libraries are kept: ARMGPI_CACHE, or armgpi in the user's cache folder."""
    if asked := os.environ.get("ARMGPI_CACHE"):
        return Path(asked).absolute()
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    except RuntimeError:  # a user without a home, as in some containers: nothing can be kept
        base = Path(os.devnull)
    return base.absolute() / "armgpi"


@contextmanager
def open_folder(folder: Path) -> Iterator[tuple[Path, int]]:
    """Make a folder and open it: its path, and the descriptor of what was checked.

    Raises:
        OSError: when the folder cannot be used, `Untrusted` when others can write to it.
    """
    place = Path(os.path.realpath(folder.parent), folder.name)
    _check_above(place)
    place.mkdir(parents=True, exist_ok=True, mode=0o700)
    try:
        opened = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError as error:
        if place.is_symlink():
            raise Untrusted(f"{place} is a link") from None
        raise error
    try:
        if reason := why_shared(os.fstat(opened)):
            raise Untrusted(f"{place} {reason}")
        yield place, opened
    finally:
        os.close(opened)


def why_shared(info: os.stat_result) -> str:
    """Return why somebody else can write to a file or folder, empty when nobody can."""
    if info.st_uid != os.geteuid():
        return f"belongs to the user {info.st_uid}, not to {os.geteuid()}"
    return f"can be written by others (mode {stat.S_IMODE(info.st_mode):o})" if info.st_mode & 0o022 else ""


def _check_above(place: Path) -> None:
    """Refuse a folder that somebody else could move away and replace.

    Raises:
        Untrusted: when a folder above it belongs to another user but root, or others can write to it,
            and it is not sticky, as /tmp is.
    """
    for folder in place.parents:
        try:
            info = folder.stat()
        except FileNotFoundError:
            continue
        # Where every user has a group of their own, of the same number, that group is nobody else.
        others = stat.S_IWOTH if info.st_gid == info.st_uid else stat.S_IWOTH | stat.S_IWGRP
        writable = info.st_mode & others and not info.st_mode & stat.S_ISVTX
        if stat.S_ISDIR(info.st_mode) and (writable or info.st_uid not in (0, os.geteuid())):
            raise Untrusted(f"{folder}, above {place.name}, can be written by others than you and root")


def read_result(key: str) -> Any:
    """Return the plain data that was kept under a key; None where nothing whole is there.

    Args:
        key: a digest in hexadecimal.
    """
    with suppress(OSError, ValueError, RecursionError), _open_results() as (_, opened):
        file = os.open(f"{key}.json", os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=opened)
        with open(file, "rb") as stream:
            info = os.fstat(file)
            if not stat.S_ISREG(info.st_mode) or why_shared(info) or info.st_size > _LARGEST:
                return None
            seal, _, content = stream.read(_LARGEST).partition(b"\n")
            if hashlib.sha256(key.encode() + content).hexdigest() != seal.decode():
                return None
            with suppress(OSError):  # of a cache that can only be read
                os.utime(file)
            return json.loads(content)
    return None


def keep_result(key: str, data: Any) -> None:
    """Keep plain data under a key, whole or not at all; where nothing can be kept, nothing happens.

    Args:
        key: a digest in hexadecimal.
        data: what JSON can hold.
    """
    content = json.dumps(data).encode()
    seal = hashlib.sha256(key.encode() + content).hexdigest().encode()
    with suppress(OSError), _open_results() as (place, _):
        handle, name = tempfile.mkstemp(prefix=".new-", dir=place)
        try:
            with open(handle, "wb") as stream:
                stream.write(seal + b"\n" + content)
            os.replace(name, place / f"{key}.json")
        except OSError:
            with suppress(OSError):
                os.unlink(name)
            raise
        _prune(place)


@contextmanager
def _open_results() -> Iterator[tuple[Path, int]]:
    """Open the folder of small results, made where it is not there."""
    with open_folder(cache_folder()) as (place, _), open_folder(place / RESULTS) as found:
        yield found


def _prune(folder: Path) -> None:
    """Remove the results used least recently, beyond so many."""
    entries = list(folder.glob("*.json"))
    if len(entries) <= _KEPT:
        return
    with suppress(OSError):
        for path in sorted(entries, key=lambda path: path.stat().st_mtime)[: len(entries) - _KEPT]:
            path.unlink(missing_ok=True)
