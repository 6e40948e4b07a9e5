"""Public names that changed: an old one works for one minor version, and a warning names the new one."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TypeVar

from armgpi.errors import ArmgpiWarning

_Name = TypeVar("_Name")

#: Old name of a member of the package -> new name.
MEMBERS = {"believe_drives": "assume_drives", "Draw": "Scenario"}
#: Old word for what is assumed of drives -> new word; `rigid` meant an arm without rotors.
DRIVES = {"soft": "elastic", "believed": "stiff", "rigid": "none"}
#: Old source of a value of a drive -> new source.
SOURCES = {"told": "specified", "believed": "assumed", "measured": "identified"}
#: Old type of a controller -> new type.
CONTROLLERS = {"untuned": "gpi_auto"}
#: Old command -> new command.
COMMANDS = {"contend": "benchmark controllers", "zoo": "benchmark robots"}
#: Old kind of repair of a URDF -> new kind.
REPAIRS = {"suppose-bodies": "assume-bodies"}


class RenamedWarning(ArmgpiWarning, DeprecationWarning):
    """An old public name was used; the text has the new one."""


def warn_renamed(old: str, new: str, stacklevel: int = 2) -> None:
    """Warn that an old name was used.

    Args:
        old: the name that was used.
        new: the name to use.
        stacklevel: 1 for the caller of this function, 2 for its caller, and so on.
    """
    text = f"{old!r} is now called {new!r}; the old name works until the next minor version"
    warnings.warn(text, RenamedWarning, stacklevel=stacklevel + 1)


def current_name(name: _Name, renamed: Mapping[str, str], stacklevel: int = 2) -> _Name | str:
    """Return the current name for one that may be old, with a warning where it is; others are left alone."""
    if not isinstance(name, str) or name not in renamed:
        return name
    warn_renamed(name, renamed[name], stacklevel + 1)
    return renamed[name]
