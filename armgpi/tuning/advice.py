"""What there is to say of what the rule chose: findings, which who asked the rule shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import Finding
from armgpi.gpi.margins import SLOWEST_DEFAULT
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import told_none

#: Arms of a batch that a warning names at most.
_SHOWN = 8


def untuned_arm(robot: Robot, chosen: Mapping[str, Any], rigid: bool) -> Iterator[Finding]:
    """Find what will go wrong with an arm under the automatic controller.

    Args:
        robot: nominal model.
        chosen: from :func:`armgpi.tuning.rule.apply_rule`.
        rigid: whether gears are taken as rigid; soft ones make a loop slow by themselves.
    """
    omega: Array | None = chosen.get("omega_c") if rigid else None
    if omega is not None:
        j = int(np.argmin(omega))
        slowest = float(omega[j])
        if slowest < SLOWEST_DEFAULT:
            name = robot.joint_names[j]
            message = (
                f"sample time, delay and encoders leave joint {name!r} {slowest:.3g} rad/s, which is slow: "
                f"below {SLOWEST_DEFAULT:g} rad/s an arm tracks badly"
            )
            repair = "use a shorter sample time, or finer encoders"
            yield Finding("warning", f"joint {name!r}", message, slowest, SLOWEST_DEFAULT, repair)
    if names := told_none(robot):
        message = (
            f"{', '.join(names)}: specified to have no rotor; a geared motor at such a joint makes the "
            "loop unstable, at a light wrist from 0.05 kg m^2 on"
        )
        yield Finding("warning", "joints", message, repair="specify its rotor inertia, or let it be assumed")


def unlike_arms(kinds: Sequence[str]) -> str:
    """Return what is expected of a batch whose arms have controllers of different structures alone.

    Args:
        kinds: the kind of controller that each arm has alone, in words.
    """
    rows: dict[str, list[int]] = {}
    for k, kind in enumerate(kinds):
        rows.setdefault(kind, []).append(k)
    said = "; ".join(f"{kind}: arms {_numbered(arms)}" for kind, arms in rows.items())
    return (
        f"a batch of arms whose automatic controllers have one structure (these have, alone, controllers "
        f"{said}; make a RobotBatch of the arms of each kind)"
    )


def _numbered(rows: Sequence[int]) -> str:
    """Return the numbers of some arms, the first few of many."""
    shown = ", ".join(map(str, rows[:_SHOWN]))
    return shown if len(rows) <= _SHOWN else f"{shown} and {len(rows) - _SHOWN} more"
