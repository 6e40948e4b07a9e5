"""Names of joints as C can have them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from armgpi.robot import Robot


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
    """Return a text that can stand in a comment or a string of C."""
    kept = re.sub(r"[^ -~]", "?", str(text)).replace("\\", "/").replace('"', "'")
    for sign in ("*/", "/*", "??"):  # comments, and trigraphs
        kept = kept.replace(sign, " ".join(sign))
    return kept


def source_of(robot: Robot) -> str:
    """Return where a robot's model is from: the file's name without folders, and its hash."""
    source, digest = robot.provenance.get("source", "a model"), robot.provenance.get("sha256", "")
    return plain(f"{Path(str(source)).name} (SHA-256 {digest[:16]}...)" if digest else source)
