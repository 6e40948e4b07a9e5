"""Values put at the keys of an experiment as plain data: by commands, searches, sweeps and pages alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

#: A way to a key: names of sections, and places in lists.
Path = Sequence[str | int]


def path_of(name: str) -> tuple[str | int, ...]:
    """Return the way to a key from its name with dots, such as plant.loads.0.onset."""
    return tuple(int(step) if step.isdigit() else step for step in name.split("."))


def put(data: Any, path: Path, value: Any, known: bool = False) -> None:
    """Put a value at a key; a section that is not there, or null, is made.

    Args:
        data: the experiment, or a section of it, as plain data; it is changed.
        path: the way to the key.
        value: what is put there; a whole number stays one where there is one already.
        known: whether the key has to be there, as it is where every default is filled in.

    Raises:
        LookupError: when there is no such place in a list, or no such key where it has to be.
        TypeError: when a number or text on the way has no keys.
    """
    *way, end = path
    last: Any = end
    for step in way:
        if isinstance(data, dict) and isinstance(step, str) and data.get(step) is None:
            data[step] = {}
        data = data[step]
    if known and isinstance(data, dict) and last not in data:
        raise KeyError(last)
    if known and type(data[last]) is int and isinstance(value, float) and value.is_integer():
        value = int(value)
    data[last] = value
