"""A certificate in words: the table that is printed."""

from __future__ import annotations

import math
from typing import Any

from armgpi.certification.solve import checker, merge_facts
from armgpi.loop.units import POSITION, TORQUE

#: Numbers of the arm: their names in the file, what they are and their units.
NUMBERS = {
    "delta_low": ("least eigenvalue of D^-1 D^", ""),
    "delta_high": ("largest eigenvalue of D^-1 D^", ""),
    "sigma": ("rate of the metric D along the reference", "1/s"),
    "kappa_v": ("Coriolis matrix along the reference", "1/s"),
    "kappa_e": ("stiffness of gravity", "1/s^2"),
    "kappa_g": ("stiffness of gravity between samples", "1/s^2"),
    "kappa_f": ("viscous friction", "1/s"),
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


#: Shares below this are not told.
_SMALL = 1e-4


def table(made: Any) -> list[str]:
    """Return the lines that are printed of an :class:`armgpi.Certificate`."""
    data = made.data
    robot, law, limits = data["robot"], data["law"], data["limits"]
    first, last = float(law["omega"][0]), float(law["omega"][-1])
    omega = f"{first:g}"
    if first != last:  # it moves between two
        omega += f" to {last:.4g} at a rate up to {float(law['rate']):.3g}"
    light, heavy = (float(x) for x in robot["loads"])
    moves = any(float(x) for x in limits["velocity"])
    box = zip(map(float, limits["lower"]), map(float, limits["upper"]), strict=True)
    course = "moves" if moves else "at rest (with --acceleration: moving)"
    prices = []  # what one omega for all joints costs of what the rule for automatic tuning gives them
    if robot["rule"] is not None:
        rule, zone = _join(robot["rule"]), _join(robot["dead_zone"])
        prices = [
            f"  the untuned law, but with one omega: the rule gives the joints {rule} rad/s",
            f"  its dead zone, {zone} rad or m, is in all claims but the error per torque",
        ]
    lines = [
        f"{robot['name']}, taken as rigid: loads {light:g} to {heavy:g} kg, omega {omega} rad/s, "
        f"{law['integrators']} integrators, roll-off {law['rolloff']}, feedforward {robot['feedforward']}, "
        f"{1e3 * float(law['sample_time']):g} ms, {law['delay']} samples late",
        f"  reference {course}, speed {_join(limits['speed'])} rad/s or m/s; start {robot['start']}",
        *prices,
        f"  box [rad or m]: {', '.join(f'{low:.4g} to {high:.4g}' for low, high in box)}",
    ]
    lines += [
        f"  {name:<12} {float(data['numbers'][name]):<10.4g} {unit:<6} {data['status'][name]:<9} {text}"
        for name, (text, unit) in NUMBERS.items()
    ]
    if "gain" in data["solutions"]:
        lines += _joints(made)
    return [*lines, *([verdict(made)] if made.certified else ()), *made.reasons]


def share_covered(tried: int) -> float:
    """Return which share of what is possible is, with 95 % confidence, as all of so many drawn ones are."""
    return float(0.05 ** (1.0 / tried))


def verdict(made: Any) -> str:
    """Return in a line whether there is a certificate, and how sure its numbers are."""
    if not made.certified:
        return "not certified"
    if made.numbers_proved:
        return "guaranteed by docs/proof.md for an arm that is rigid: every number is proved"
    said = "certified for searched numbers: the largest that a search found, and 3 % more"
    if tried := made.data["robot"].get("tried"):
        return (
            f"{said}; {tried} other arms that are possible do not exceed them at the worst points of this "
            "one (their own worst points were not searched)"
        )
    return said


def claims(made: Any) -> list[list[str]]:
    """Return what is claimed of each joint: error per torque, up to which torque, and the bounds of all else.

    Those are the error under all that was stated, that from the start, that after a jump of the load, and the
    torque needed.
    """
    most, sliding = float(made.data["inputs"]["gain"]["torque"]), made.data["robot"]["prismatic"]
    inverse = [float(x) for x in made.data["numbers"]["inverse"]]
    rows = []
    for j, slides in enumerate(sliding):
        p, t = POSITION.symbol(slides), TORQUE.symbol(slides)
        bounds = ((made.error[j], p), (made.from_start[j], p), (made.after_jump[j], p), (made.torque[j], t))
        rows.append(
            [
                f"{made.per_torque[j]:.3g} {p}/({t})",
                f"{most / math.sqrt(inverse[j]):.3g} {t}",
                *(f"{x:.3g} {unit}" if math.isfinite(x) else "-" for x, unit in bounds),
            ]
        )
    return rows


def shares(made: Any) -> str:
    """Return which shares the inputs have in what disturbs, as torques; empty where nothing was stated."""
    data = made.data
    if "stated" not in data["solutions"]:
        return ""
    known = merge_facts(data["limits"], data["law"], data["numbers"], data["inputs"]["stated"])
    (growth, _), *_, whole, _ = checker.sample(known)
    if not whole:
        return ""
    parts = {name: growth * x / whole for name, x in data["shares"].items()}
    parts["encoder"] = 1 - checker.sample({**known, "count": 0})[5] / whole
    # What is left is what the reference moves on within a sample.
    parts["velocity of the reference"] += 1 - sum(parts.values())
    found = sorted(((float(x), name) for name, x in parts.items()), reverse=True)
    return ", ".join(f"{name} {100.0 * x:.3g} %" for x, name in found if x > _SMALL)


def _join(values: Any) -> str:
    """Return numbers for the joints, one where they are the same."""
    texts = [f"{float(x):.4g}" for x in values]
    return ", ".join(texts) if len(set(texts)) > 1 else texts[0]


def _joints(made: Any) -> list[str]:
    """Return a line for each joint."""
    width = max(len(name) for name in ["joint", *made.joint_names])
    head = ["per torque, at rest", "up to", "under all", "from a start", "after a jump", "torque"]
    sizes, lines = (20, 11, 12, 12, 12, 10), []
    for name, cells in zip(["joint", *made.joint_names], [head, *claims(made)], strict=True):
        padded = (f"{x:<{w}}" for x, w in zip(cells, sizes, strict=True))
        lines.append(f"  {name:<{width}}  " + "  ".join(padded))
    told = shares(made)
    lines += [f"  of what disturbs: {told}"] if told else []
    lines.append(f"  what disturbed is forgotten at {made.decay:.3g} 1/s")
    return lines
