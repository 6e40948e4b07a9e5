"""From a file to its XML: what can hang, fill the memory or is no URDF at all is refused here.

The tree holds elements and attributes, and of text the numbers of drives. A URDF has no other text of use,
and what is not kept cannot be large.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from armgpi.base import files
from armgpi.errors import Remedy, UrdfError

MAX_BYTES = 32 * 1024 * 1024
MAX_DEPTH = 100
#: The largest URDF of example-robot-data has some 5,000.
MAX_ELEMENTS = 200_000
MAX_ATTRIBUTES = 1_000
#: Characters of one element's tag with its attributes: the parser holds it as a whole.
MAX_TAG = 1_000_000
#: How much of a file is read to find out what it is.
_HEAD = 4096

#: First bytes -> what such a file is, and the way on.
_BINARY = (
    (b"\x1f\x8b", "compressed by gzip: unpack it first (gunzip)"),
    (b"PK\x03\x04", "a zip archive: unpack it and give the URDF in it"),
    (b"BZh", "compressed by bzip2: unpack it first (bunzip2)"),
    (b"\xfd7zXZ", "compressed by xz: unpack it first (unxz)"),
    (b"\x28\xb5\x2f\xfd", "compressed by zstd: unpack it first (unzstd)"),
    (b"\xff\xfe", "UTF-16: save it as UTF-8 (iconv -f UTF-16 -t UTF-8)"),
    (b"\xfe\xff", "UTF-16: save it as UTF-8 (iconv -f UTF-16 -t UTF-8)"),
    (b"<\0", "UTF-16: save it as UTF-8 (iconv -f UTF-16LE -t UTF-8)"),
    (b"\0<", "UTF-16: save it as UTF-8 (iconv -f UTF-16BE -t UTF-8)"),
    (b"\x89PNG", "a picture (PNG): give the URDF"),
    (b"%PDF", "a PDF: give the URDF"),
    (b"\x7fELF", "a program: give the URDF"),
    (b"7z\xbc\xaf", "a 7z archive: unpack it and give the URDF in it"),
    (b"Rar!", "a rar archive: unpack it and give the URDF in it"),
    (b"PXR-USDC", "a scene (OpenUSD): give the URDF of the robot; USD is not read"),
    (b"\x89HDF", "a rollout or other data (HDF5, NetCDF): give the URDF"),
    (b"glTF", "a mesh (glTF): give the URDF that shows it"),
)
_HTML = "a web page (HTML): download the file itself, by the 'raw' link"
_YAML = "YAML: for an experiment file, give the name or the URDF of its robot"
#: Names that files give to a rotor's inertia, and to the reduction of its gear.
ROTOR_INERTIA = ("rotor_inertia", "motor_inertia", "motorInertia")
GEAR_RATIO = ("gear_ratio", "mechanicalReduction", "mechanical_reduction")
#: Elements whose text is kept.
TEXT_OF = frozenset((*ROTOR_INERTIA, *GEAR_RATIO, "param"))
#: How a text begins that is no XML -> what it is.
_TEXTS = (
    (r"<!doctype\s+html|<html", _HTML),
    (r"version https://git-lfs", "a pointer of Git LFS: fetch the file itself with `git lfs pull`"),
    (r"solid\s", "a mesh (STL): give the URDF that shows it"),
    (r"ply\s", "a mesh (PLY): give the URDF that shows it"),
    (r"#!|import |from \w+ import ", "a program: run it if it writes a URDF, and give that"),
    (r"\[\[?[\w.-]+\]\]?\s*$", "TOML or INI: give a URDF"),
    (r"[{\[]", "JSON: give a URDF"),
    (r"40\d: |Not Found", "the answer of a server that has no such file: check the address"),
    (r"<<<<<<<\s", "a file with conflicts of git in it: resolve them (git mergetool)"),
    (r"diff |--- \S|Index: ", "a patch: apply it, and give the URDF that it changes"),
    (r"#usda", "a scene (OpenUSD): give the URDF of the robot; USD is not read"),
    (r"ISO-10303", "a CAD model (STEP): give a URDF, to which CAD tools export"),
    (r"(#[^\n]*\n\s*)*(v|o|mtllib) \S", "a mesh (OBJ): give the URDF that shows it"),
    (r"(#[^\n]*\n\s*)*(%YAML|---\s|robot:|[\w]+:\s)", _YAML),
)
_FLAGS = re.IGNORECASE | re.MULTILINE
#: Root element -> what such a file is and the way on.
_ROOTS = {
    "mujoco": "a MuJoCo model (MJCF): Robot.load and every command read one from its file",
    "mujocoinclude": "a part of a MuJoCo model (MJCF): give the whole one",
    "sdf": "an SDF model (Gazebo): give the URDF that it was made from; SDF is not read",
    "model": "a model of Gazebo (SDF): give the URDF that it was made from; SDF is not read",
    "world": "a world of Gazebo (SDF): give the URDF of the robot; SDF is not read",
    "gazebo": "a model of Gazebo (SDF): give the URDF that it was made from; SDF is not read",
    "html": _HTML,
    "COLLADA": "a mesh (COLLADA): give the URDF that shows it",
    "svg": "a picture (SVG): give the URDF",
    "launch": "a ROS launch file: give the URDF that it loads",
    "package": "the manifest of a ROS package: give the URDF in that package",
    "Robot": "no URDF but something else (OpenRAVE, perhaps): give a URDF",
    "Environment": "an OpenRAVE environment: give a URDF",
}
_EXPAND = (
    "expand it first (pip install xacrodoc, then armgpi expand FILE -o robot.urdf; with ROS: "
    "xacro FILE > robot.urdf) and give the result"
)
_XACRO = f"unexpanded xacro: {_EXPAND}"
#: What only defines something in xacro: without a use nothing of it reaches the robot.
XACRO_DEFINITIONS = ("xacro:property", "xacro:macro", "xacro:arg")
#: In these a value that xacro has to fill in changes no dynamics.
_BESIDE_DYNAMICS = frozenset(
    ("visual", "collision", "gazebo", "transmission", "ros2_control", "sensor", "material")
)


def _read_bytes(path: Path, form: str) -> bytes:
    """Return the bytes of a file of some format, which is named in what is refused.

    Raises:
        UrdfError: when it is no regular file, empty, too large or unreadable.
    """
    try:
        content = files.read_bytes(path, MAX_BYTES)
    except files.NotRegular as error:
        pipe = f"no regular file but a pipe or a device: write the {form} to a file first"
        kind = f"a folder: give the {form} in it" if error.kind == "a folder" else pipe
        article = "a" if form == "URDF" else "an"
        raise UrdfError(path, f"expected {article} {form} file, this is {kind}") from None
    except files.TooLarge as error:
        raise UrdfError(path, f"has {error.size} bytes, more than the {MAX_BYTES} allowed") from None
    except OSError as error:
        raise UrdfError(path, f"cannot be read: {error.strerror or error}") from None
    if not content:
        raise UrdfError(path, f"is empty; give {'a' if form == 'URDF' else 'an'} {form}")
    return content


def read_file(path: Path, form: str = "URDF") -> str:
    """Return the text of a file of a robot.

    Args:
        path: of the file.
        form: its format, "URDF" or "MJCF", for messages.

    Raises:
        UrdfError: when it is no regular file, too large, unreadable or not UTF-8.
    """
    content = _read_bytes(path, form)
    for magic, kind in _BINARY:
        if content.startswith(magic):
            raise UrdfError(path, f"is not UTF-8 text but {kind}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UrdfError(
            path,
            f"is not UTF-8 text (byte 0x{content[error.start]:02x} at {error.start}); save it as UTF-8 "
            f"(iconv -f LATIN1 -t UTF-8), if it is a {form} at all",
        ) from None
    if "\0" in text:
        raise UrdfError(path, f"is a binary file, no {form}")
    return text


def parse_xml(text: str, source: str) -> Element:
    """Return the elements and attributes of a URDF's XML, below its root <robot>.

    Raises:
        UrdfError: when it is no well-formed XML, too large or too deep, or something else than a URDF.
    """
    stripped = text.lstrip("\ufeff").strip()
    if not stripped:
        raise UrdfError(source, "is empty; give a URDF")
    kind = _kind_of_text(stripped)
    if kind == _HTML:  # mostly no XML either
        raise UrdfError(source, f"is {kind}")
    if re.search(rf"<(?=[A-Za-z_:])[^<>]{{{MAX_TAG}}}", stripped):
        raise UrdfError(source, f"has an element whose tag is longer than {MAX_TAG} characters")
    try:
        root = _elements(stripped, source)
    except (expat.ExpatError, UnicodeEncodeError) as error:
        refused = UrdfError(
            source,
            f"is {kind or f'not well-formed XML: {error}; correct that place, or give the whole URDF'}",
        )
        raise refused.suggesting(*[Remedy("config", (), source)] * (kind == _YAML)) from None
    if root.tag != "robot":
        small = ", whose names are in small letters" if root.tag.lower() == "robot" else ""
        other = _ROOTS.get(root.tag, f"no URDF{small}")
        raise UrdfError(source, f"is {other}: expected the root element <robot>, got <{root.tag[:80]}>")
    return root


def xacro_hint(text: str) -> str:
    """Return what to add to a message about a value that only xacro can have left there."""
    return f"; this is {_XACRO}" if re.search(r"\$[({]", text) else ""


def _elements(text: str, source: str) -> Element:
    """Return the tree of elements, refusing what no URDF has while it is read.

    Without namespaces, as urdfdom reads: old files have prefixes that they do not declare.
    """
    builder = _Builder(source)
    parser = expat.ParserCreate()
    depth = count = 0
    keeps_text = False

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > MAX_DEPTH:
            raise UrdfError(source, f"has XML elements nested more than {MAX_DEPTH} deep, which no URDF has")
        if count > MAX_ELEMENTS:
            raise UrdfError(source, f"has more than {MAX_ELEMENTS} XML elements")
        if len(attributes) > MAX_ATTRIBUTES:
            raise UrdfError(source, f"has an element with more than {MAX_ATTRIBUTES} attributes")
        nonlocal keeps_text
        keeps_text = tag in TEXT_OF
        builder.start(tag, attributes, parser.CurrentLineNumber)

    def characters(text: str) -> None:
        if keeps_text:
            builder.data(text)

    def end(tag: str) -> None:
        nonlocal depth
        nonlocal keeps_text
        depth, keeps_text = depth - 1, False
        builder.end(tag)

    def doctype(name: str, *_: object) -> None:
        if name.lower() == "html":
            raise UrdfError(source, f"is {_HTML}")
        raise UrdfError(source, "has a document type declaration (DTD), which no URDF needs: remove it")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = characters
    parser.StartDoctypeDeclHandler = doctype
    parser.Parse(text, True)
    return builder.close()


class _Builder:
    """Keeps the elements of a file, and finds whether anything in it has to be expanded by xacro, and where.

    Definitions of xacro that are used nowhere are kept as empty elements with the attribute `line`.
    """

    def __init__(self, source: str) -> None:
        """Begin to read `source`."""
        self.source = source
        self.tree = TreeBuilder()
        self.open: list[str] = []
        self.inside = 0  # elements of a definition that are open
        self.needed = ""
        self.name = ""  # of the link or joint that is open
        self.needing: str | None = None  # the one in which something has to be expanded

    def start(self, tag: str, attributes: dict[str, str], line: int) -> None:
        """Begin an element."""
        if self.inside:
            self.inside += 1
            return
        if tag in XACRO_DEFINITIONS:
            self.inside = 1
            self.tree.start(tag, {**attributes, "line": str(line)})
            return
        self.open.append(tag)
        if len(self.open) == len(("robot", "link")):
            self.name = attributes.get("name", "")
        if not self.needed:
            self.needed, self.needing = self._needs(tag, attributes, line), self.name or None
        self.tree.start(tag, attributes)

    def data(self, text: str) -> None:
        """Keep text of the element that is open."""
        if not self.inside:
            self.tree.data(text)

    def end(self, tag: str) -> None:
        """End an element."""
        if self.inside > 1:
            self.inside -= 1
            return
        if not self.inside:
            self.open.pop()
        self.inside = 0
        self.tree.end(tag)

    def close(self) -> Element:
        """Return the root; refuse a robot of which something has to be expanded."""
        root: Element = self.tree.close()
        if root.tag == "robot" and self.needed:
            where = f" in {self.needing!r}" if self.needing else ""
            said = f"is unexpanded xacro, as {self.needed}{where}: {_EXPAND}"
            raise UrdfError(self.source, said, self.needing)
        return root

    def _needs(self, tag: str, attributes: dict[str, str], line: int) -> str:
        """Return what xacro has to do with an element; empty when nothing."""
        if tag.startswith("xacro:"):
            return f"line {line} has <{tag[:80]}>"
        if not _BESIDE_DYNAMICS.intersection(self.open):
            for key, value in attributes.items():
                if "${" in value or "$(" in value:
                    return f"line {line} has {key[:80]}={value[:80]!r}"
        return ""


def _kind_of_text(text: str) -> str | None:
    """Return what a text is that does not begin as a URDF does; None when nothing is known of it."""
    head = re.sub(r"\A(<\?.*?\?>|<!--.*?-->|\s)+", "", text[:_HEAD], flags=re.DOTALL)
    return next((kind for pattern, kind in _TEXTS if re.match(pattern, head, _FLAGS)), None)
