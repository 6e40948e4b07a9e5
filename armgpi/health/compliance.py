"""What an impedance controller may be asked for on an arm, before one is made."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from armgpi.control.impedance import CartesianImpedance
from armgpi.errors import ArmgpiError, ArmgpiWarning
from armgpi.health.findings import Finding, Subject, check
from armgpi.robot import rotors
from armgpi.robot.robot import Robot
from armgpi.tuning.kept import remember

#: Stiffness at which limits are worked out: usual ones, and what any loop is fast enough for [N/m, N m/rad].
_ASKED = (500.0, 5.0)
#: Stiffness of rotations over that of positions [m^2].
_TURNING = 0.06
#: Stiffness of the posture over that of positions [m^2]: the controller's defaults, 10 over 500.
_POSTURE = 0.02
#: A wall below which a table without damping may be too stiff [N/m].
_TABLE = 1e4
#: No wall is stiffer [N/m]: a tool that cannot move in a direction has no limit there.
_RIGID = 1e9


class Compliance(NamedTuple):
    """What may be asked for.

    Attributes:
        stiffness: largest stiffness of the tool [N/m]; that of rotations is 0.06 m^2 times it.
        link_stiffness: the same if encoders sit at the links, where joints are elastic and the drives do not
            tell the side; else `stiffness`.
        wall: the stiffest wall without damping, in the configuration and direction where it is softest [N/m],
            under the stiffness that it was worked out for.
        usual_wall: the same, median over configurations and directions.
        asked: that stiffness [N/m].
        reason: what limits the stiffness.
    """

    stiffness: float
    link_stiffness: float
    wall: float
    usual_wall: float
    asked: float
    reason: str

    def describe(self) -> list[str]:
        """Return it in two sentences."""
        link = ""
        if self.link_stiffness != self.stiffness:
            link = f" ({self.link_stiffness:.3g} N/m if the encoders sit at the links)"
        return [
            f"largest stiffness {self.stiffness:.3g} N/m at the tool{link}",
            f"at {self.asked:g} N/m the stiffest wall without damping is {_describe_wall(self.wall)} in the "
            f"worst direction, {_describe_wall(self.usual_wall)} in the median",
        ]


def _describe_wall(stiffness: float) -> str:
    """Return the stiffness of a wall with its unit [N/m]; "any" where the arm hardly moves against it."""
    return "any" if stiffness > _RIGID else f"{stiffness / 1e3:.3g} kN/m"


def compliance_of(robot: Robot, dt: float, delay: float) -> Compliance | None:
    """Return what an impedance controller may be asked for; None for an arm that cannot have one.

    The check and the facts of one report ask for the same: it is worked out once.

    Args:
        robot: the nominal model, with what is known or assumed of its drives.
        dt: sample time [s].
        delay: transport delay [s].
    """
    parts = {"robot": robot, "dt": dt, "delay": delay, "asked": _ASKED}
    parts |= {"turning": _TURNING, "posture": _POSTURE}
    found = remember("compliance", parts, lambda: _worked_out(robot, dt, delay))
    return None if found is None else Compliance(*found)


def _worked_out(robot: Robot, dt: float, delay: float) -> Compliance | None:
    """Return what :func:`compliance_of` does."""
    for asked in _ASKED:
        stiffness = np.repeat([asked, _TURNING * asked], 3)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ArmgpiWarning)
                law = CartesianImpedance(
                    robot,
                    dt,
                    stiffness=stiffness,
                    nullspace_stiffness=_POSTURE * asked,
                    delay=delay,
                )
        except ArmgpiError:
            continue
        found, (largest, at_link) = law.limits, law.largest_factors()
        return Compliance(asked * largest, asked * at_link, found.wall, found.usual_wall, asked, found.reason)
    return None


def plain(found: Compliance | None) -> dict[str, Any] | None:
    """Return it as plain data, with its sentences."""
    return None if found is None else {**found._asdict(), "said": found.describe()}


@check(
    "compliance",
    "an impedance controller of 500 N/m is too stiff for the loop, or a wall of 10 kN/m without damping "
    "would make the tool bounce",
    "info",
)
def too_stiff(subject: Subject) -> Iterator[Finding]:
    """Find a loop that is too slow for usual compliance."""
    if not (subject.robot.limits.effort > 0.0).all():
        return
    found = compliance_of(rotors.assume_drives(subject.robot), subject.dt, subject.delay * subject.dt)
    if found is None:
        return
    if found.asked < _ASKED[0]:
        message = (
            f"an impedance controller may be asked for {found.stiffness:.3g} N/m at most: {found.reason}"
        )
        repair = "use a shorter sample time or less delay"
        yield Finding("info", "robot", message, found.stiffness, _ASKED[0], repair)
    elif found.usual_wall < _TABLE:
        message = (
            f"under an impedance controller of {found.asked:g} N/m the tool hammers walls without damping "
            f"that are stiffer than {found.usual_wall / 1e3:.2g} kN/m"
        )
        repair = "use a shorter sample time, less delay, or a tool with a soft cover"
        yield Finding("info", "robot", message, found.usual_wall, _TABLE, repair)
