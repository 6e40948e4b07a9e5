"""Colours and text that figures, scene and report share.

The palette is that of Okabe and Ito (Color Universal Design, 2008), which people with any of the common
kinds of colour blindness can tell apart. A controller has the same colour in every page and figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from typing import Any, NamedTuple

#: Colours of rollouts, in this order: blue, vermillion, green, purple, orange, sky blue, yellow.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
#: Controllers, by their names in files, that have a colour of their own: the palette's, in its order. The
#: first four, compared the most, have a contrast of 3 on white (WCAG 2.2, 1.4.11), which not all seven could.
_OWN = ("gpi", "pid", "network", "gpi_auto", "adrc", "ctdob", "schedule")
#: The reference, in figures and as the ghost in the scene.
REFERENCE = "#000000"
#: Limits and the like: what is there but is not the point.
QUIET = "#7F7F7F"
#: A joint at its torque limit, a rollout that diverged.
ALARM = "#B2182B"
#: A disturbance.
DISTURBANCE = "#882255"
#: Dashes tell rollouts apart on paper without colour, and once the colours are used up.
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
#: Longest name shown whole.
LONGEST = 40


class Look(NamedTuple):
    """How a rollout is drawn.

    Attributes:
        color: as "#rrggbb".
        dashes: Matplotlib's line style.
    """

    color: str
    dashes: Any


def look(index: int) -> Look:
    """Return how the rollout of an index is drawn: neighbours differ in colour and in dashes."""
    turn, place = divmod(index, len(PALETTE))
    return Look(PALETTE[place], _DASHES[(turn + place) % len(_DASHES)])


def looks(names: Sequence[str]) -> list[Look]:
    """Return how rollouts of some names are drawn: controllers as everywhere, others by what is left."""
    own = {name: _OWN.index(name) for name in names if name in _OWN and names.count(name) == 1}
    free = (index for index in count() if index not in own.values())
    return [look(own[name] if name in own else next(free)) for name in names]


def canvas_dashes(look: Look) -> list[float]:
    """Return the dashes of a look as a canvas has them [px]."""
    return [] if look.dashes == "-" else [2.0 * length for length in look.dashes[1]]


def shorten(name: str, longest: int = LONGEST) -> str:
    """Return a name on one line, its middle left out where it is long, without control characters."""
    clean = "".join(c if c.isprintable() else " " for c in name)
    if len(clean) <= longest:
        return clean
    head = (longest - 1) // 2 + (longest - 1) % 2
    return f"{clean[:head]}…{clean[len(clean) - (longest - 1 - head) :]}"
