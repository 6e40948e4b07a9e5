"""Units as powers of a joint coordinate, its torque and seconds; those of prismatic joints follow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import xarray as xr

_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


class Unit(NamedTuple):
    """A unit of a quantity that every joint has: rad s² of a revolute joint is m s² of a prismatic one.

    Attributes:
        position: power of the joint's coordinate, rad or m.
        torque: power of its torque or force, N m or N.
        time: power of the second.
    """

    position: int = 0
    torque: int = 0
    time: int = 0

    def symbol(self, prismatic: bool = False, ascii: bool = False) -> str:
        """Return the unit's symbol, empty where there is no dimension.

        Args:
            prismatic: of a prismatic joint; of a revolute one when not.
            ascii: "rad s^2", as in files; "rad s²" when not.
        """
        names = ("m", "N", "s") if prismatic else ("rad", "N m", "s")

        def with_power(name: str, power: int) -> str:
            if power in (1, -1):
                return name
            name = f"({name})" if " " in name else name
            return name + (f"^{abs(power)}" if ascii else str(abs(power)).translate(_SUPERSCRIPTS))

        above, below = (
            [with_power(name, power) for name, power in zip(names, self, strict=True) if sign * power > 0]
            for sign in (1, -1)
        )
        return "/".join([" ".join(above) or "1", *below]) if any(self) else ""

    def __str__(self) -> str:
        """Return the symbol for either kind of joint: "rad or m"."""
        return " or ".join(dict.fromkeys([self.symbol(), self.symbol(prismatic=True)]))


class PlainUnit(NamedTuple):
    """A unit of a quantity of the whole arm, whatever its joints are.

    Attributes:
        text: its symbol.
    """

    text: str

    def symbol(self, prismatic: bool = False, ascii: bool = False) -> str:
        """Return the unit's symbol; see :meth:`Unit.symbol`."""
        return self.text

    def __str__(self) -> str:
        """Return the symbol."""
        return self.text


NEWTON = PlainUnit("N")
POSITION, VELOCITY, TORQUE = Unit(position=1), Unit(position=1, time=-1), Unit(torque=1)
TORQUE_RATE = Unit(torque=1, time=-1)


def prismatic(rollout: xr.Dataset) -> npt.NDArray[np.bool_]:
    """Return which joints of a rollout are prismatic, shape (n,); none where it does not say."""
    if "joint_type" not in rollout.coords:
        return np.zeros(rollout.sizes["joint"], dtype=bool)
    return np.asarray(rollout["joint_type"].values == "prismatic")


def note(joint_names: Sequence[str], prismatic: npt.NDArray[np.bool_]) -> str:
    """Return how to read the units of revolute joints where only some joints are; empty elsewhere.

    Args:
        joint_names: names of the joints.
        prismatic: which of them are prismatic, shape (n,).
    """
    if prismatic.all() or not prismatic.any():
        return ""
    names = ", ".join(name for name, slides in zip(joint_names, prismatic, strict=True) if slides)
    swaps = (f"{unit.symbol(prismatic=True)} for {unit.symbol()}" for unit in (POSITION, TORQUE))
    return f"prismatic: {names}: {', '.join(swaps)}"
