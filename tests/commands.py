"""What a command of armgpi answers."""

from __future__ import annotations

from typing import NamedTuple


class Answer(NamedTuple):
    """How a call of `armgpi` ended, and what it wrote."""

    code: int
    out: str
    err: str
