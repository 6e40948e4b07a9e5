"""The paper's scenarios 5.1 to 5.3 as experiment files that say of every value whose it is."""

from __future__ import annotations

from pathlib import Path

from armgpi.errors import NameNotFound

_FOLDER = Path(__file__).parent


def names() -> tuple[str, ...]:
    """Return the names of the scenarios."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


def locate(name: str) -> Path:
    """Return the experiment file of a scenario.

    Raises:
        NameNotFound: when there is none of this name.
    """
    if name not in names():
        raise NameNotFound("scenario", name, names())
    return _FOLDER / f"{name}.yaml"
