"""Names of joints as C can have them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from armgpi.errors import ParameterError
from armgpi.robot.robot import Robot

#: Files that a header and a source of the same name would be taken for.
_FILES = ("main", "math", "float", "stdint", "stdio", "stdlib", "time")
#: Names of an export: those of files, of functions and types, and of macros. Other strings are left alone.
_OURS = re.compile(
    r'"(?!armgpi_(?:controller|move|follow|log))[^"\n]*"'
    r"|armgpi_controller(?=\.[cho]\b)|\b(?:armgpi|ARMGPI)_(?:CONTROLLER_(?=H\b))?"
)


def check_name(name: str | None, source: str = "") -> None:
    """Refuse what cannot replace `armgpi` in some C.

    Raises:
        ParameterError: when it is no C identifier, or makes names that are taken.
    """
    if name is None:
        return
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name):
        raise ParameterError("name", name, "a C identifier of at most 31 letters, digits and _")
    if name.lower() in _FILES:
        raise ParameterError("name", name, f"another one, as there are other files {name}.h and {name}.c")
    words = set(re.findall(r"\w+", source))
    for word in sorted(word for word in words if _OURS.match(word)):
        if rename(word, name) in words:
            raise ParameterError("name", name, f"another one, as {rename(word, name)} is used in the C")


def rename(text: str, name: str | None) -> str:
    """Return C, or its documents, with a name in place of `armgpi` and of `armgpi_controller`."""

    def ours(match: re.Match[str]) -> str:
        if match[0].startswith('"'):
            return match[0]
        if match[0] == "armgpi_controller":
            return str(name)
        return f"{name}_" if match[0].islower() else f"{name}_".upper()

    return text if name is None else _OURS.sub(ours, text)


def identifiers(names: Sequence[str]) -> list[str]:
    """Return names as parts of C identifiers, no two alike."""
    found: list[str] = []
    for j, name in enumerate(names):
        text = re.sub(r"[^A-Za-z0-9]", "_", name).upper()
        while text in found or not text:
            text = f"{text}_{j}"
        found.append(text)
    return found


def plain(text: object) -> str:
    """Return a text that is safe in a comment or a string of C."""
    # ASCII alone: C99 leaves it to the compiler what else a comment may have.
    kept = re.sub(r"[^ -~]", "?", str(text)).replace("\\", "/").replace('"', "'")
    for sign in ("*/", "/*", "??"):  # comments, and trigraphs
        kept = kept.replace(sign, " ".join(sign))
    return kept


def source_of(robot: Robot) -> str:
    """Return where a robot's model is from: the file's name without folders, and its hash."""
    source, digest = robot.provenance.get("source", "a model"), robot.provenance.get("sha256", "")
    return plain(f"{Path(str(source)).name} (SHA-256 {digest[:16]}...)" if digest else source)
