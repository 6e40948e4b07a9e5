"""The version of armgpi, which generated code carries, and what is said of files of other versions."""

from __future__ import annotations

VERSION = "0.2.0"
#: Address of the project, where problems are reported; empty until there is one.
ADDRESS: str = ""


def other_format(found: object, known: object) -> str:
    """Return what is said of a file whose format this version does not read."""
    name = "no format" if found is None else f"format {str(found)[:40]}"
    return f"is of {name}, expected {known}; read it with the armgpi that wrote it, this is {VERSION}"
