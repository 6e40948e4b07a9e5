"""A certificate in words: the table that is printed."""

from __future__ import annotations

import math
from typing import Any

from armgpi.loop.units import POSITION, TORQUE

#: Numbers of the arm: their names in the file, what they are and their units.
NUMBERS = {
    "delta_low": ("least eigenvalue of D^-1 D^", ""),
    "delta_high": ("largest eigenvalue of D^-1 D^", ""),
    "sigma": ("rate of the metric D along the reference", "1/s"),
    "kappa_v": ("Coriolis matrix along the reference", "1/s"),
    "kappa_e": ("stiffness of gravity", "1/s^2"),
    "kappa_g": ("stiffness of gravity between samples", "1/s^2"),
    "sigma_error": ("sigma for a unit of the error's speed", "1/s"),
    "kappa_error": ("kappa_v for a unit of the error's speed", "1/s"),
}


#: Numbers that the table leaves out, each the largest of all joints.
OTHERS = {
    "inverse": ("diagonal of D^-1", "1/(kg m^2) or 1/kg"),
    "jump": ("what a jump of the load changes", ""),
    "hold": ("torque that holds the arm at the reference", "N m or N"),
    "reach": ("torque for what the law asks for, of length 1", ""),
}


def table(made: Any) -> list[str]:
    """Return the lines that are printed of an :class:`armgpi.Certificate`."""
    data = made.data
    robot, law, limits = data["robot"], data["law"], data["limits"]
    light, heavy = (float(x) for x in robot["loads"])
    slow, fast = (f"{end(float(x) for x in limits['speed']):g}" for end in (min, max))
    lines = [
        f"{robot['name']}: loads {light:g} to {heavy:g} kg, reference up to {fast} rad/s or m/s"
        f"{'' if slow == fast else f' (slowest {slow})'}, omega {_omega(law)} rad/s, "
        f"{law['integrators']} integrators, roll-off {law['rolloff']}, feedforward {robot['feedforward']}, "
        f"{1e3 * float(law['sample_time']):g} ms, {law['delay']} samples late"
    ]
    lines += [
        f"  {name:<12} {float(data['numbers'][name]):<10.4g} {unit:<6} {data['status'][name]:<9} {text}"
        for name, (text, unit) in NUMBERS.items()
    ]
    if "gain" in data["solutions"]:
        lines += _joints(made)
    if made.guaranteed:
        lines.append("guaranteed: every number is proved")
    elif made.certified:
        lines.append(
            "certified for the numbers above; they are the largest that a search found, and 3 % more"
        )
    return lines + list(made.reasons)


def _omega(law: Any) -> str:
    """Return the bandwidth, or between which ones it moves, and how fast."""
    first, last = float(law["omega"][0]), float(law["omega"][-1])
    return (
        f"{first:g}" if first == last else f"{first:g} to {last:.4g} at a rate up to {float(law['rate']):.3g}"
    )


def _joints(made: Any) -> list[str]:
    """Return a line for each joint."""
    prismatic, most = made.data["robot"]["prismatic"], float(made.data["inputs"]["gain"]["torque"])
    width = max(len(name) for name in made.joint_names)
    inverse = [float(x) for x in made.data["numbers"]["inverse"]]
    lines = [f"  {'joint':<{width}}  error per torque      up to        under all   after a jump  torque"]
    for j, name in enumerate(made.joint_names):
        p, t = POSITION.symbol(prismatic[j]), TORQUE.symbol(prismatic[j])
        alone = most / math.sqrt(inverse[j])
        cells = [f"{made.per_torque[j]:.3g} {p}/({t})", f"{alone:.3g} {t}"]
        cells += [f"{x[j]:.3g} {p}" if math.isfinite(x[j]) else "-" for x in (made.error, made.after_jump)]
        cells.append(f"{made.torque[j]:.3g} {t}" if math.isfinite(made.torque[j]) else "-")
        sizes = (20, 11, 10, 12, 10)
        lines.append(
            f"  {name:<{width}}  " + "  ".join(f"{x:<{w}}" for x, w in zip(cells, sizes, strict=True))
        )
    lines.append(f"  what disturbed is forgotten at {made.decay:.3g} 1/s")
    return lines
