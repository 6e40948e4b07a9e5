"""What an MJCF names is checked before MuJoCo opens it: files that it includes, meshes, textures, fields.

MuJoCo reads them by itself, and would wait for a pipe, read a device for ever, or read any file of this
machine. So each has to be a regular file within a size, in the folder of the model: its own, the one above
where the model stands in a folder like ``mjcf``, one of meshes beside it, or that of its package. What
multiplies (``<replicate>``, ``<composite>``, the memory that it asks for) is bounded as well.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from armgpi.base import files
from armgpi.errors import UrdfError
from armgpi.robot.markup import MAX_ELEMENTS, read_file
from armgpi.robot.meshes import MeshFinder

#: Largest mesh, texture or field [bytes], and most of them.
MOST, _MANY = 64 * 2**20, 2_000
#: Most files that are included, and how deep.
_INCLUDED, _DEPTH = 200, 20
#: Most copies of parts of a model, and the memory that it may ask for [bytes].
_COPIES, _MEMORY = 10_000, 2**30
#: Most pixels of a texture.
_PIXELS = 2**26
#: Elements that name files, and their attributes that do.
_NAMING = {
    "mesh": ("file",),
    "hfield": ("file",),
    "skin": ("file",),
    "flexcomp": ("file",),
    "texture": ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback"),
}
_FOLDERS = ("meshdir", "texturedir", "assetdir")
#: Folders of models beside which those of meshes stand.
_BESIDE = ("mjcf", "xml", "xmls", "mujoco", "scene", "scenes")
#: Names of folders of meshes and textures, which may stand beside that of a model.
_ASSETS = re.compile(r"(.*[_-])?(assets?|mesh(es)?|stls?|objs?|textures?)", re.IGNORECASE)
_SUFFIXES = {"K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40, "P": 2**50, "E": 2**60}


def check(path: Path) -> list[Path]:
    """Check all files that MuJoCo would open for a model.

    Returns:
        Files on which its bodies depend besides its own: those that it includes or attaches, and meshes.

    Raises:
        UrdfError: for one that is no regular file, too large, or outside the folders of the model, or a model
            that would grow; it names the file.
    """
    checker = _Checker(path)
    checker.check()
    return sorted(checker.shaping)


class _Checker:
    """Checks one model and what it includes.

    Attributes:
        path: of the model.
        roots: folders in which files may be.
        beside: folder in which folders of meshes may be as well, by their names.
        seen: files that were looked at.
        shaping: of these the ones on which bodies depend: models and meshes, but no pictures.
        count: of those that were read as models.
    """

    def __init__(self, path: Path) -> None:
        """Check the model at a path."""
        self.path = path
        folder = path.resolve().parent
        beside = (folder.parent,) if folder.name.lower() in _BESIDE else ()
        self.roots = (*MeshFinder(path).roots, folder, *beside)
        self.beside = folder.parent
        self.seen: set[Path] = set()
        self.shaping: set[Path] = set()
        self.count = 0

    def check(self) -> None:
        """Check the model, models that it attaches, and what they name."""
        waiting, named = [self.path], 0
        while waiting:
            model = waiting.pop()
            elements = list(self._elements(model, model.parent, 0))
            if elements[0].tag == "mujocoinclude":
                raise UrdfError(model, "is a part of a MuJoCo model (MJCF): give the one that includes it")
            folders = {str(x.get(key)) for x in elements for key in _FOLDERS if x.get(key)}
            for element in elements:
                for key in _NAMING.get(element.tag, ()):
                    if name := element.get(key):
                        named += 1
                        found = self._asset(model.parent, folders, name)
                        if element.tag == "mesh":
                            self.shaping.update(found)
                if element.tag == "model" and (name := element.get("file")):
                    attached = [place for place in self._places(model.parent, {""}, name) if self._new(place)]
                    self.shaping.update(attached)
                    waiting += attached
            if named > _MANY:
                raise UrdfError(self.path, f"names more than {_MANY} files")

    def _new(self, place: Path) -> bool:
        """Tell whether a file has not been read yet, and note it."""
        new = place not in self.seen
        self.seen.add(place)
        return new

    def _elements(self, file: Path, base: Path, depth: int) -> Iterator[Element]:
        """Give the elements of a file and of those that it includes."""
        self.count += 1
        if depth > _DEPTH or self.count > _INCLUDED:
            raise UrdfError(self.path, f"includes files more than {_DEPTH} deep, or more than {_INCLUDED}")
        root = self._root(file)
        self._bound(root)
        for element in root.iter():
            yield element
            if element.tag == "include" and (name := element.get("file")):
                for folder in {base, file.parent}:
                    for place in self._places(folder, {""}, name):
                        if self._new(place):
                            self.shaping.add(place)
                            yield from self._elements(place, base, depth + 1)

    def _root(self, file: Path) -> Element:
        """Return the XML of a file."""
        text = read_file(file, "MJCF")
        if text.count("<") > MAX_ELEMENTS:
            raise UrdfError(file, f"has more than {MAX_ELEMENTS} elements")
        try:
            return ElementTree.fromstring(_without_comments(text))
        except (ElementTree.ParseError, ValueError, RecursionError) as error:
            raise UrdfError(file, f"is no well-formed XML: {' '.join(str(error).split())}") from None

    def _bound(self, root: Element) -> None:
        """Refuse a model that would multiply, or ask for much memory."""
        for size in root.iter("size"):
            if _bytes(size.get("memory", "-1")) > _MEMORY:
                raise UrdfError(self.path, f"asks for {size.get('memory')} of memory, more than 1 GiB")
        copies = 0
        waiting = [(root, 1)]
        while waiting:
            element, times = waiting.pop()
            count = 1
            if element.tag in ("replicate", "composite", "flexcomp"):
                for number in re.findall(r"\d+", element.get("count", "1"))[:3]:
                    count *= int(number[:12] or 1)
                copies += times * count
            if copies > _COPIES:
                raise UrdfError(self.path, f"makes more than {_COPIES} copies of parts (<{element.tag}>)")
            waiting += [(child, times * max(count, 1)) for child in element]

    def _asset(self, base: Path, folders: set[str], name: str) -> list[Path]:
        """Check a file of a mesh, texture or field wherever MuJoCo may look for it; return these places."""
        places = list(self._places(base, {"", *folders}, name))
        for place in places:
            if not self._new(place):
                continue
            try:
                with files.open_regular(place, MOST) as stream:
                    head = stream.read(24)
            except OSError as error:
                raise UrdfError(
                    self.path, f"names {name!r}, which cannot be read: {files.reason(error)}"
                ) from None
            if head.startswith(b"\x89PNG") and len(head) == 24:
                width, height = struct.unpack(">II", head[16:24])
                if width * height > _PIXELS:
                    said = f"names {name!r}, a picture of {width} x {height}, more than {_PIXELS} pixels"
                    raise UrdfError(self.path, said)
        return places

    def _places(self, base: Path, folders: set[str], name: str) -> Iterator[Path]:
        """Give the files that a name may mean, if they are there and in the folders of the model."""
        if "\0" in name:
            raise UrdfError(self.path, f"names {name!r}, which is no file")
        name = name.replace("\\", "/")
        # MuJoCo takes the last part alone where a compiler's strippath says so.
        parts = {name, Path(name).name}
        for place in {base / folder.replace("\\", "/") / part for folder in folders for part in parts}:
            real = place.resolve()
            if not real.exists():
                continue
            if not self._may_hold(real):
                raise UrdfError(
                    self.path,
                    f"names {name!r}, which is outside the folders of the model; copy it beside the model",
                )
            yield real

    def _may_hold(self, place: Path) -> bool:
        """Tell whether a file is in a folder of the model, or in one of meshes beside it."""
        if any(place.is_relative_to(root.resolve()) for root in self.roots):
            return True
        if not place.is_relative_to(self.beside):
            return False
        parts = place.relative_to(self.beside).parts  # none where it is that folder itself
        return len(parts) > 1 and _ASSETS.fullmatch(parts[0]) is not None


def _bytes(text: str) -> float:
    """Return a number of bytes as MJCF writes it, with a letter for its unit."""
    match = re.fullmatch(r"\s*(-?\d{1,18})\s*([KMGTPE]?)\s*", text.upper())
    return float(match[1]) * _SUFFIXES.get(match[2], 1) if match else float("inf")


def _without_comments(text: str) -> str:
    """Return the first element of a text without comments, as MuJoCo's parser sees it.

    Other parsers refuse a `--` within comments, and what is left behind the element.

    Raises:
        ValueError: for what may hide elements from one of both parsers: a CDATA section, a declaration.
    """
    kept, place, depth = [], 0, 0
    while (begun := text.find("<", place)) >= 0:
        kept.append(text[place:begun])
        if text.startswith("<!--", begun):
            end = text.find("-->", begun + 4)
            if end < 0:
                raise ValueError("a comment does not end")
            place = end + 3
            continue
        if text.startswith("<!", begun) or (text.startswith("<?", begun) and kept and "".join(kept).strip()):
            raise ValueError("it has a declaration, a CDATA section or an instruction, which no model needs")
        place = _tag_end(text, begun)
        kept.append(text[begun:place])
        if not text.startswith("<?", begun) and text[place - 2] != "/":
            depth += -1 if text.startswith("</", begun) else 1
        if depth == 0 and not text.startswith("<?", begun):
            break
    return re.sub(r"\A\s*<\?xml[^>]*\?>", "", "".join(kept))


def _tag_end(text: str, begun: int) -> int:
    """Return where the tag that begins somewhere ends: behind its `>` that is in no quotes."""
    quote = ""
    for match in re.compile(r"[\"'>]").finditer(text, begun):
        if quote:
            quote = "" if match[0] == quote else quote
        elif match[0] == ">":
            return match.end()
        else:
            quote = match[0]
    raise ValueError("a tag does not end")
