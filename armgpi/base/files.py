"""Files that appear whole or not at all, and sets of files that show when they do not belong together.

A file is written under another name beside its place, brought to the disk, and renamed. Whoever is killed, or
runs out of disk, leaves what was there before. A set of files ends with ``SHA256SUMS``, the hashes of the
others as ``sha256sum --check`` reads them: renamed last, so that a mixture of two sets does not pass for one.

What is read may come from strangers, so that every file is opened by :func:`open_regular`: a pipe would make
the reader wait for ever, a device has no end, and a sparse file is larger than what was ever sent.
"""

from __future__ import annotations

import errno
import glob
import hashlib
import math
import os
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from armgpi.errors import RolloutError

#: The file that makes a set of files whole.
SUMS = "SHA256SUMS"
#: What a killed process left is removed when it is so old [s].
_STALE = 86400.0
#: Largest size of a file with hashes [bytes].
_MAX_SUMS = 1_000_000
#: What a file may declare, or hold when it is decompressed, is at most so many times what is stored of it.
#: Rollouts of arms at rest, which compress best, have 5 to 40.
RATIO = 100
#: What any file may declare or hold, however small it is [bytes].
_SMALL = 64 * 2**20
#: Unit of `st_blocks`, by POSIX's <sys/stat.h> [bytes].
_BLOCK = 512


class NotRegular(OSError):
    """What is no regular file; `kind` says what it is, with an article."""

    def __init__(self, kind: str) -> None:
        """Say what it is."""
        super().__init__(errno.EINVAL, f"it is {kind}, not a regular file; expected a file on a disk")
        self.kind = kind


class TooLarge(OSError):
    """A file that is larger than what is read."""

    def __init__(self, size: int, most: int, why: str = "") -> None:
        """Say how large it is."""
        said = why or f"it has {size} bytes, more than the {most} that are read"
        super().__init__(errno.EFBIG, said)
        self.size, self.most = size, most


@contextmanager
def open_regular(path: str | PathLike[str], most: int | None = None) -> Iterator[BinaryIO]:
    """Open a regular file of at most `most` bytes for reading, without waiting for anybody.

    Raises:
        NotRegular: when it is a folder, a pipe, a device or a socket.
        TooLarge: when it is larger, or most of it is stored nowhere.
        OSError: when it is not there or may not be read.
        ValueError: when no path can be so.
    """
    # Without waiting: opening a pipe waits for who writes into it, a terminal for its line.
    opened = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    status = os.fstat(opened)
    if not stat.S_ISREG(status.st_mode):
        os.close(opened)
        raise NotRegular(_kind(status.st_mode))
    with open(opened, "rb") as stream:
        if most is not None and status.st_size > most:
            raise TooLarge(status.st_size, most)
        if status.st_size > allowance(stored := stored_bytes(status)):
            why = (
                f"it declares {status.st_size} bytes, but only {stored} of them are stored; copy "
                "the whole file"
            )
            raise TooLarge(status.st_size, stored, why)
        yield stream


def read_bytes(path: str | PathLike[str], most: int) -> bytes:
    """Return the bytes of a regular file, at most so many; errors as :func:`open_regular`."""
    with open_regular(path, most) as stream:
        # Not what it has grown by meanwhile, nor one of /proc, which says to be empty and may have no end.
        return stream.read(os.fstat(stream.fileno()).st_size)


def read_text(path: str | PathLike[str], most: int, encoding: str = "utf-8") -> str:
    """Return the text of a regular file of at most so many bytes; errors as :func:`open_regular`.

    Raises:
        UnicodeDecodeError: when it is no text.
    """
    return read_bytes(path, most).decode(encoding).replace("\r\n", "\n").replace("\r", "\n")


def reason(error: BaseException) -> str:
    """Return in one line why a file could not be read."""
    said = error.strerror if isinstance(error, OSError) else None
    return " ".join((said or str(error)).split())[:300] or type(error).__name__


def stored_bytes(status: os.stat_result) -> int:
    """Return how much of a file is stored [bytes]: of a sparse one less than its size."""
    return min(status.st_size, status.st_blocks * _BLOCK)


def allowance(stored: int) -> int:
    """Return what a file may declare, or hold when it is decompressed [bytes], by what is stored of it."""
    return max(RATIO * stored, _SMALL)


def machine_bytes() -> float:
    """Return how much memory this machine has [B], infinite when it does not tell."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):  # as on Windows
        return math.inf


def _kind(mode: int) -> str:
    """Return what is no regular file, with an article."""
    if stat.S_ISDIR(mode):
        return "a folder"
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"


def make_folder(path: Path) -> Path:
    """Make a folder, and those above it, where there is none.

    Raises:
        RolloutError: when it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RolloutError(
            f"{path}: cannot be written to: {error.strerror or error}; choose another folder"
        ) from None
    return path


def write(path: str | PathLike[str], content: str | bytes) -> Path:
    """Write a file; it appears whole or not at all. A pipe or a device is written to.

    Raises:
        RolloutError: when it cannot be written.
    """
    target = Path(path)
    with replace_files([target], str(target)) as (partial,):
        _fill(partial, content)
    return target


def write_temporary(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write files into a temporary folder: in no order, and with nothing that outlives a crash.

    Args:
        folder: that is there, and soon gone.
        contents: of each file by its name.
    """
    for name, content in contents.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)


def write_set(folder: Path, contents: Mapping[str, str | bytes], also: Sequence[str] = ()) -> list[Path]:
    """Write files that belong together into a folder that is there, and their hashes last.

    Args:
        folder: where.
        contents: name of a file -> what it gets.
        also: names of files that are there already and belong to them.

    Returns:
        What was written.

    Raises:
        RolloutError: when something cannot be written. Unless that is in the middle of renaming, nothing has
            changed.
    """
    paths = [*(folder / name for name in contents), folder / SUMS]
    for path in paths:
        make_folder(path.parent)
    with replace_files(paths, str(folder)) as partials:
        for partial, content in zip(partials, contents.values(), strict=False):
            _fill(partial, content)
        places = {**dict(zip(contents, partials, strict=False)), **{name: folder / name for name in also}}
        sums = "".join(f"{_digest(place)}  {name}\n" for name, place in places.items())
        _fill(partials[-1], sums)
    return paths


def check_set(folder: Path, names: Sequence[str] | None = None) -> None:
    """Check that the files of a folder, or some of them, are those that were written together.

    A folder without ``SHA256SUMS`` is no set: nothing is checked.

    Raises:
        RolloutError: when a file is missing or has another content.
    """
    sums = folder / SUMS
    try:
        if not sums.is_file():
            return
        lines = read_bytes(sums, _MAX_SUMS).decode(errors="replace").splitlines()
        for digest, _, name in (line.partition("  ") for line in lines):
            if names is not None and name not in names:
                continue
            path = folder / name
            if Path(name).is_absolute() or ".." in Path(name).parts:
                raise RolloutError(f"{sums}: names {name}, which is outside its folder; {_REMEDY}")
            if not path.is_file():
                raise RolloutError(f"{path}: is missing, and {sums} names it; {_REMEDY}")
            if _digest(path) != digest:
                raise RolloutError(f"{path}: is not the file that {sums} names; {_REMEDY}")
    except (OSError, ValueError) as error:
        raise RolloutError(f"{folder}: cannot be read: {reason(error)}") from None


_REMEDY = f"it was changed, or a run that wrote here did not end: run again, or remove {SUMS}"


@contextmanager
def replace_files(targets: Sequence[Path], what: str) -> Iterator[list[Path]]:
    """Give files to write in place of some; they take those places, in this order, when all are written.

    Raises:
        RolloutError: when something cannot be written; it says `what`.
    """
    partials: list[Path] = []
    try:
        # A pipe or a device stays what it is, and a link stays a link.
        special = [target.exists() and not target.is_file() for target in targets]
        places = [
            target if odd else Path(os.path.realpath(target))
            for target, odd in zip(targets, special, strict=True)
        ]
        for place, odd in zip(places, special, strict=True):
            beside = Path(tempfile.gettempdir()) if odd else place.parent
            partials.append(beside / f"{_prefix(place)}{secrets.token_hex(4)}.part")
            _create(partials[-1], None if odd else place)
        yield partials
        for partial in partials:
            _sync(partial)
        for partial, place, odd in zip(partials, places, special, strict=True):
            if odd:
                with partial.open("rb") as source, place.open("wb") as sink:
                    shutil.copyfileobj(source, sink)
            else:
                os.replace(partial, place)
        for folder in {place.parent for place, odd in zip(places, special, strict=True) if not odd}:
            with suppress(OSError):  # the files are there, whether a crash of the machine spares them or not
                _sync(folder)
        _sweep(places)
    except OSError as error:
        raise RolloutError(f"{what}: cannot be written: {error.strerror or error}") from None
    finally:
        for partial in partials:
            with suppress(OSError):
                partial.unlink()


def _prefix(place: Path) -> str:
    """Return how the names of what is written in place of a file begin; no name may be too long."""
    return f".{place.name[:40]}."


def _create(partial: Path, place: Path | None) -> None:
    """Make an empty file, with the permissions of the one whose place it takes."""
    opened = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666)
    try:
        if place is not None and place.exists():
            if not os.access(place, os.W_OK):
                raise PermissionError(13, "Permission denied")
            os.fchmod(opened, stat.S_IMODE(place.stat().st_mode))
    finally:
        os.close(opened)


def _fill(partial: Path, content: str | bytes) -> None:
    """Write what a file gets, text as UTF-8."""
    partial.write_bytes(content.encode(errors="backslashreplace") if isinstance(content, str) else content)


def _sync(path: Path) -> None:
    """Bring a file or folder to the disk."""
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def _sweep(places: Sequence[Path]) -> None:
    """Remove what killed processes left of earlier versions of files."""
    for place in places:
        with suppress(OSError):
            for partial in place.parent.glob(f"{glob.escape(_prefix(place))}*.part"):
                if time.time() - partial.stat().st_mtime > _STALE:
                    partial.unlink()


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    found = hashlib.sha256()
    with open_regular(path) as file:
        while block := file.read(1 << 20):
            found.update(block)
    return found.hexdigest()
