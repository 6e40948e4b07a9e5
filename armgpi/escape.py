"""Text and numbers as they may be shown: nothing commands a terminal, and JSON gets only what it has."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def shown(value: object, *, lines: bool = False) -> str:
    r"""Return text with everything that cannot be seen written out, as in ``\x1b`` and ``\u202e``.

    That is what Unicode calls control, format and surrogate characters, separators but the space, private and
    unassigned ones: escape sequences, bidirectional overrides, zero-width characters, ends of lines.

    Args:
        value: what is shown; its ``str``.
        lines: whether ends of lines (``\n``) stay: for text of ours that has several lines.
    """
    text = str(value)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or (lines and c == "\n") else _written_out(c) for c in text)


def quoted(value: object, most: int = 80) -> str:
    """Return a value as Python writes it, cut where it is long."""
    text = repr(value)
    return text if len(text) <= most else f"{text[: most - 3]}..."


def json_data(value: Any) -> Any:
    """Return plain data as JSON has it: tuples are lists, numbers that are not finite are null."""
    if isinstance(value, Mapping):
        return {key: json_data(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_data(item) for item in value]
    if isinstance(value, float):  # NumPy's float64 is one too
        return float(value) if math.isfinite(value) else None
    return value


def html_text(value: object) -> str:
    """Return text as HTML that shows it to the letter."""
    return html.escape(shown(value, lines=True), quote=True)


def html_table(caption: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table of plain text as HTML, for notebooks."""
    names = "".join(f"<th>{html_text(name)}</th>" for name in head)
    lines = ("".join(f"<td>{html_text(cell)}</td>" for cell in row) for row in rows)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    top = f"<caption><b>{html_text(caption)}</b></caption>"
    return f"<table>{top}<thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"


def _written_out(character: str) -> str:
    """Return a character as Python's `repr` has it."""
    return repr(character)[1:-1]
