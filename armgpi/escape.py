"""Text from files, as it may be shown: it commands no terminal, and hides or turns nothing."""

from __future__ import annotations


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


def _written_out(character: str) -> str:
    """Return a character as Python's `repr` has it."""
    return repr(character)[1:-1]
