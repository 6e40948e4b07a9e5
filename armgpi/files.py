"""Files that appear whole or not at all, and sets of files that show when they do not belong together.

A file is written under another name beside its place, brought to the disk, and renamed. Whoever is killed, or
runs out of disk, leaves what was there before. A set of files ends with ``SHA256SUMS``, the hashes of the
others as ``sha256sum --check`` reads them: renamed last, so that a mixture of two sets does not pass for one.
"""

from __future__ import annotations

import glob
import hashlib
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

from armgpi.errors import RolloutError

#: The file that makes a set of files whole.
SUMS = "SHA256SUMS"
#: What a killed process left is removed when it is so old [s].
_STALE = 86400.0
#: Largest size of a file with hashes [bytes].
_MAX_SUMS = 1_000_000


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
        with sums.open("rb") as file:
            lines = file.read(_MAX_SUMS).decode(errors="replace").splitlines()
        for digest, _, name in (line.partition("  ") for line in lines):
            if names is not None and name not in names:
                continue
            path = folder / name
            if not path.is_file():
                raise RolloutError(f"{path}: is missing, and {sums} names it; {_REMEDY}")
            if _digest(path) != digest:
                raise RolloutError(f"{path}: is not the file that {sums} names; {_REMEDY}")
    except (OSError, ValueError) as error:
        raise RolloutError(f"{folder}: cannot be read: {error}") from None


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
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            found.update(block)
    return found.hexdigest()
