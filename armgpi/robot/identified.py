"""A folder that ``armgpi identify`` wrote as a robot: its URDF, how that is loaded, and its drives."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from armgpi.base import files
from armgpi.base.arrays import LARGEST
from armgpi.base.version import other_format
from armgpi.errors import UrdfError

#: The file that makes a folder one of an identified arm, its version, and its largest size [bytes].
NAME, FORMAT = "identification.json", 2
_MAX_BYTES = 50_000_000
_REMEDY = "run `armgpi identify` again, or name the URDF in it"


class Identification(NamedTuple):
    """What says how the files of a folder are loaded.

    Attributes:
        path: of ``identification.json``.
        urdf: the identified arm.
        before: the arm as its file had it.
        drives: the file of its drives.
        lock: joint -> where it is fixed [rad or m].
        repair: names of repairs made in the URDF.
        data: all of ``identification.json``.
    """

    path: Path
    urdf: Path
    before: Path
    drives: Path
    lock: dict[str, float]
    repair: list[str]
    data: Mapping[str, Any]

    def section(self, lock: Any = (), repair: Any = ()) -> dict[str, Any]:
        """Return name, locked joints and repairs for :meth:`armgpi.Robot.load`, with more of both."""
        more = lock if isinstance(lock, Mapping) else dict.fromkeys([lock] if isinstance(lock, str) else lock)
        repairs = [repair] if isinstance(repair, str) else repair
        return {
            "name": str(self.urdf),
            "lock": {**self.lock, **more},
            "repair": [*dict.fromkeys([*self.repair, *repairs])],
        }


def read_data(path: Path) -> Mapping[str, Any]:
    """Return the content of ``identification.json``.

    Raises:
        UrdfError: when it is missing, damaged or of another version.
    """
    try:
        data = json.loads(files.read_bytes(path, _MAX_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        raise UrdfError(path, f"cannot be read: {files.reason(error)}; {_REMEDY}") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        known = data.get("format") if isinstance(data, dict) else None
        raise UrdfError(path, f"{other_format(known, FORMAT)}; {_REMEDY}")
    return data


def read(path: Path) -> Identification:
    """Read ``identification.json`` and find what was written beside it.

    Raises:
        UrdfError: when it, or the URDF beside it, is missing, damaged or was changed.
    """
    data = read_data(path)
    arm = data.get("arm")
    arm = arm if isinstance(arm, dict) else {}
    lock, repair = arm.get("lock"), arm.get("repair")
    urdf, before, drives = (_beside(path, arm, key) for key in ("urdf", "before", "drives"))
    if not isinstance(lock, dict) or not all(is_number(x) for x in lock.values()):
        raise UrdfError(path, f"arm.lock: expected joint -> value, got {lock!r:.40}; {_REMEDY}")
    if not isinstance(repair, list) or not all(isinstance(x, str) for x in repair):
        raise UrdfError(path, f"arm.repair: expected names, got {repair!r:.40}; {_REMEDY}")
    return Identification(path, urdf, before, drives, lock, repair, data)


def original_of(urdf: Path) -> Path | None:
    """Return the URDF beside which the meshes of an identified one are; None where that is not known.

    A folder of an identified arm has no meshes. It names the file that the arm was loaded from, which counts
    as long as its content is the same.

    Args:
        urdf: a URDF, of such a folder or not.
    """
    try:
        data = read_data(urdf.with_name(NAME))
        arm = data["arm"]
        given = arm["meshes"]
        file = Path(given["beside"])
        same = hashlib.sha256(files.read_bytes(file, _MAX_BYTES)).hexdigest() == given["sha256"]
        own = arm["urdf"]["file"] == urdf.name or arm["before"]["file"] == urdf.name
    except (OSError, ValueError, KeyError, TypeError, UrdfError):
        return None
    return file if same and own and file.suffix.lower() == ".urdf" else None


def _beside(path: Path, arm: Mapping[str, Any], key: str) -> Path:
    """Return a file that was written beside, which has to be that one still."""
    given = arm.get(key)
    name, digest = (given.get("file"), given.get("sha256")) if isinstance(given, dict) else (None, None)
    if not isinstance(name, str) or not name or Path(name).name != name or "\0" in name:
        raise UrdfError(
            path,
            f"arm.{key}.file: expected the name of a file in the same folder, got {name!r:.40}; {_REMEDY}",
        )
    file = path.with_name(name)
    try:
        content = files.read_bytes(file, _MAX_BYTES)
    except OSError as error:
        raise UrdfError(file, f"cannot be read: {files.reason(error)}; {_REMEDY}") from None
    if hashlib.sha256(content).hexdigest() != digest:
        raise UrdfError(file, f"was changed since it was identified; {_REMEDY}")
    return file


def is_number(value: Any) -> bool:
    """Tell whether something is a finite number."""
    return isinstance(value, float | int) and not isinstance(value, bool) and abs(value) < LARGEST
