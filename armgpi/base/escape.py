"""Text and numbers as they may be shown: nothing commands a terminal, and JSON gets only what it has."""

from __future__ import annotations

import csv
import html
import io
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

#: Units that people write behind a number -> what armgpi takes, and how many of it they are.
_UNITS = {
    **dict.fromkeys(("deg", "degree", "degrees", "°"), ("rad", math.pi / 180.0)),
    **{"rad": ("rad", 1.0), "mrad": ("rad", 1e-3)},
    **{"m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3)},
    **{"s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "min": ("s", 60.0)},
    **{"kg": ("kg", 1.0), "g": ("kg", 1e-3), "kgm2": ("kg m^2", 1.0), "kgm^2": ("kg m^2", 1.0)},
    **{"N": ("N", 1.0), "Nm": ("N m", 1.0), "kNm": ("N m", 1e3), "mNm": ("N m", 1e-3)},
    **{"rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", math.pi / 180.0), "rpm": ("rad/s", math.pi / 30.0)},
    **{"bit": ("bits", 1.0), "bits": ("bits", 1.0), "%": ("as a share", 0.01)},
}
#: Characters that mean something to LaTeX, and those that its fonts lack.
_TEX = {c: "\\" + c for c in "&%$#_{}"} | {"\\": r"\textbackslash{}", "^": r"\^{}", "~": r"\~{}"}
_TEX |= {"½": r"$\frac12$", "²": "$^2$", "°": r"$^\circ$", "∂": r"$\partial$", "×": r"$\times$", "−": "$-$"}
_TEX |= {"q̇": r"$\dot q$", "Ḋ": r"$\dot D$", "≤": r"$\le$"} | {c: f"${c}$" for c in "<>|"}
_GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi omicron pi rho varsigma sigma "
    "tau upsilon phi chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega"
)
_LETTERS = [*map(chr, range(0x3B1, 0x3CA)), *"ΓΔΘΛΞΠΣΦΨΩ"]
_TEX |= {c: rf"$\{x}$" for c, x in zip(_LETTERS, _GREEK.split(), strict=True)} | {"ο": "o"}
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*([^\d\s].*)")


def in_si(value: object) -> str:
    """Return how to write a number that has a unit behind it, "write 0.5236 (rad)"; "" for anything else."""
    found = _NUMBER.fullmatch(value) if isinstance(value, str) and len(value) < 100 else None
    unit = _UNITS.get(re.sub(r"[\s*]", "", found[2])) if found else None
    return f"write {float(found[1]) * unit[1]:.6g} ({unit[0]})" if found and unit else ""


def printable(value: object, *, lines: bool = False) -> str:
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
    return "".join(c if c.isprintable() or (lines and c == "\n") else repr(c)[1:-1] for c in text)


def counted(count: int, one: str, several: str = "") -> str:
    """Return a number of things in words, as in "1 rollout" and "2000 rollouts".

    Args:
        count: how many.
        one: what one is called.
        several: what several are called, where that is not `one` and an s.
    """
    return f"1 {one}" if count == 1 else f"{count} {several or one + 's'}"


def quote(value: object, most: int = 80) -> str:
    """Return a value as Python writes it, cut where it is long."""
    text = repr(value)
    return text if len(text) <= most else f"{text[: most - 3]}..."


def json_data(value: Any, as_text: bool = False) -> Any:
    """Return plain data as JSON has it: tuples are lists, numbers that are not finite are null, or text."""
    if isinstance(value, Mapping):
        return {key: json_data(item, as_text) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_data(item, as_text) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value) if as_text else None
    return float(value) if isinstance(value, float) else value  # NumPy's float64 is one too


def html_text(value: object) -> str:
    """Return text as HTML that shows it to the letter."""
    return html.escape(printable(value, lines=True), quote=True)


def html_table(caption: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table of plain text as HTML, for notebooks."""
    names = "".join(f"<th>{html_text(name)}</th>" for name in head)
    lines = ("".join(f"<td>{html_text(cell)}</td>" for cell in row) for row in rows)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    top = f"<caption><b>{html_text(caption)}</b></caption>"
    return f"<table>{top}<thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of Markdown, its cells as they are given, with a line end."""
    return "".join("| " + " | ".join(line) + " |\n" for line in (head, ("---",) * len(head), *rows))


def csv_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as comma-separated values."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    return text.getvalue()


def latex_text(text: str) -> str:
    """Return text for LaTeX, in ASCII: what has no command becomes what is like it, or a question mark."""
    # A letter and the dot on it are two characters.
    text = text.replace("q̇", "\0")
    return "".join(_TEX["q̇"] if c == "\0" else _TEX.get(c) or _alike(c) for c in text)


def _alike(character: str) -> str:
    """Return what a character is made of, as far as LaTeX has it."""
    parts = unicodedata.normalize("NFKD", character)
    plain = (c if c.isascii() and (c.isprintable() or c.isspace()) else "" for c in parts)
    return "".join(_TEX.get(c) or x for c, x in zip(parts, plain, strict=True)) or "?"
