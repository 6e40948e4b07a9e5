"""Where a URDF's meshes are: found as ROS finds them, read only inside the robot's own package folders.

Dynamics never need a mesh; a viewer does, and the health report lists those that are missing. A URDF may
come from anywhere and can name any file of this machine; textures are never read. So whatever a name leads
to must lie, links resolved, in a folder of the robot: the package that its URDF is in, a
package that a ``package://`` name finds, or a folder that the user gave.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterable, Iterator
from os import PathLike
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

from armgpi.base import files
from armgpi.robot import identified

MAX_MESH_BYTES = 256 * 1024 * 1024
MESHES = frozenset({".stl", ".dae", ".obj", ".ply", ".glb", ".gltf", ".off", ".3mf", ".mesh", ".stlb"})
#: How far up from the URDF its package is looked for.
_PARENTS = 8
#: Folders of a package in which URDFs are kept: what is beside them belongs to the robot, too.
_URDF_FOLDERS = ("urdf", "urdfs", "robots", "robot", "xacro", "models", "model")


class Found(NamedTuple):
    """What a mesh's name leads to.

    Attributes:
        name: the name as written.
        path: the file, links resolved; None when there is none that may be read.
        tried: every path that was tried, in order.
        reason: why there is no file; empty when there is one.
    """

    name: str
    path: Path | None
    tried: tuple[Path, ...] = ()
    reason: str = ""


class MeshFinder:
    """Finds the files that a URDF names.

    Names are looked for in this order: in the folders the user gave, from the URDF's folder up through
    its parents, in the folders of ROS_PACKAGE_PATH, in those of AMENT_PREFIX_PATH (ROS 2: `share` of each).

    Attributes:
        folder: the URDF's own folder, None when it came as text.
        homes: that folder; of a URDF that ``armgpi identify`` wrote also that of the URDF it was made from.
        package_dirs: folders given by the user; each a package, or a folder of packages.
        roots: folders inside which anything may be read.
    """

    def __init__(
        self, urdf: str | PathLike[str] | None, package_dirs: Iterable[str | PathLike[str]] = ()
    ) -> None:
        """Find meshes for the URDF file `urdf` (None for a text), and in `package_dirs`."""
        self.folder = None if urdf is None else _real(Path(urdf)).parent
        self.package_dirs = tuple(_real(Path(folder)) for folder in package_dirs)
        self.homes: tuple[Path, ...] = ()
        if urdf is not None:
            original = identified.original_of(_real(Path(urdf)))
            every = (Path(urdf), *([] if original is None else [original]))
            self.homes = tuple(_real(each).parent for each in every)
        self.roots = (*self.package_dirs, *map(_package_of, self.homes))

    def find(self, name: str) -> Found:
        """Return the file that a mesh's name in the URDF leads to."""
        if "\0" in name or not name.strip():
            return Found(name, None, reason="it is no file name")
        # ROS forgives package:/x and file:/x; a lone letter is a drive of Windows.
        match = re.match(r"([A-Za-z][\w+.-]+):/(/?)(.*)", name, re.DOTALL)
        if match is None:
            return self._first(name, self._plain(name))
        scheme, double, rest = match[1].lower(), match[2], match[3]
        if scheme in ("package", "model"):
            return self._in_package(name, rest)
        if scheme == "file":
            host, _, path = rest.partition("/") if double else ("", "", rest)
            if host.lower() not in ("", "localhost"):
                reason = f"it is on another machine ({host}); a path of this one has three slashes, file:///"
                return Found(name, None, reason=reason)
            return self._first(name, ((Path("/", unquote(path)), self.roots),))
        return Found(name, None, reason=f"{scheme}:// is not downloaded; save the file next to the URDF")

    def _plain(self, name: str) -> Iterator[tuple[Path, tuple[Path, ...]]]:
        """Give the places of a name that is a path, absolute or relative."""
        path = Path(name.replace("\\", "/"))
        if path.is_absolute():
            yield path, self.roots
            return
        for folder in dict.fromkeys((*self.homes, *self.roots)):
            yield folder / path, self.roots

    def _in_package(self, name: str, rest: str) -> Found:
        """Find a file of a package, ``package://PACKAGE/PATH``."""
        # Some files have three slashes.
        package, _, path = unquote(rest).lstrip("/").partition("/")
        if not package or not path or package in (".", ".."):
            return Found(name, None, reason="expected package://PACKAGE/PATH")
        places = [(root / path, (*self.roots, root)) for root in self._packages(package)]
        found = self._first(name, places)
        if found.path is None and not places:
            return found._replace(reason=f"there is no package {package!r} here; give its folder")
        return found

    def _packages(self, package: str) -> Iterator[Path]:
        """Give the folders that may be a package, the likeliest first.

        The URDF chooses the name, so a folder above it counts only with a package.xml, or when it is so
        close that it is the robot's by the usual layout: not ``package://user/.ssh/key``.
        """
        above: list[Path] = []
        near: set[Path] = set()
        home = _real(Path.home()) if os.path.isdir(os.path.expanduser("~")) else Path("/")
        for own in self.homes:
            upwards = [own, *list(own.parents)[:_PARENTS]]
            above += upwards
            near |= {folder for folder in upwards[:3] if not home.is_relative_to(folder)}
        ros = [
            *_folders_of("ROS_PACKAGE_PATH"),
            *(path / "share" for path in _folders_of("AMENT_PREFIX_PATH")),
        ]
        given = {*self.package_dirs, *ros}
        seen = set()
        for folder in dict.fromkeys((*self.package_dirs, *above, *ros)):
            for candidate in (folder / package, folder):
                if candidate in seen or not os.path.isdir(candidate):
                    continue
                seen.add(candidate)
                manifest = _manifest_name(candidate)
                trusted = (
                    folder in given or candidate in near or any(map(candidate.is_relative_to, self.roots))
                )
                if manifest == package or (candidate.name == package and (manifest or trusted)):
                    yield _real(candidate)

    def _first(self, name: str, places: Iterable[tuple[Path, tuple[Path, ...]]]) -> Found:
        """Return the first place that is a mesh's file and inside its roots."""
        tried: list[Path] = []
        reason = ""
        for path, roots in places:
            tried.append(path)
            real = _real(path)
            try:
                status = os.stat(real)
            except (OSError, ValueError):
                continue
            refused = _refuse(real, status, roots)
            if not refused:
                return Found(name, real, tuple(tried))
            reason = reason or refused
        return Found(name, None, tuple(tried), reason or "there is no such file")


def _refuse(file: Path, status: os.stat_result, roots: Iterable[Path]) -> str:
    """Return why a file is not read as a mesh; empty where it is."""
    if not any(file.is_relative_to(root) for root in roots):
        return f"{file} is outside the robot's folders; specify its folder to allow it"
    if file.suffix.lower() not in MESHES:
        return f"{file} is not one of {', '.join(sorted(MESHES))}"
    if not stat.S_ISREG(status.st_mode):
        return f"{file} is no regular file"
    if status.st_size > MAX_MESH_BYTES:
        return f"{file} has {status.st_size} bytes, more than the {MAX_MESH_BYTES} allowed"
    return ""


def _package_of(folder: Path) -> Path:
    """Return the package that a folder is in: the nearest with a package.xml, else by the usual layout."""
    for parent in (folder, *list(folder.parents)[:_PARENTS]):
        if (parent / "package.xml").is_file():
            return parent
    return folder.parent if folder.name.lower() in _URDF_FOLDERS else folder


def _manifest_name(folder: Path) -> str | None:
    """Return the name in a folder's package.xml; None when it has none."""
    try:
        manifest = folder / "package.xml"
        if not manifest.is_file():
            return None
        text = files.read_bytes(manifest, 1_000_000).decode(errors="replace")
    except OSError:
        return None
    match = re.search(r"<name>\s*([^<\s]+)\s*</name>", text)
    return None if match is None else match[1]


def _folders_of(variable: str) -> list[Path]:
    """Return the folders that an environment variable lists."""
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _real(path: Path) -> Path:
    """Return a path with its links resolved, whether it is there or not."""
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError):
        return path
