"""A certificate in words: the table that is printed."""

from __future__ import annotations

import math
from typing import Any

from armgpi.certification.solve import checker, merge_facts
from armgpi.loop.units import POSITION, TORQUE

#: Numbers of the arm: their names in the file, what they are and their units.
NUMBERS = {
    "delta_low": ("smallest inertia ratio: eigenvalue of D^-1 D^", ""),
    "delta_high": ("largest inertia ratio: eigenvalue of D^-1 D^", ""),
    "sigma": ("rate of change of the metric D along the reference", "1/s"),
    "kappa_v": ("Coriolis matrix along the reference", "1/s"),
    "kappa_e": ("stiffness of gravity", "1/s^2"),
    "kappa_g": ("stiffness of gravity between samples", "1/s^2"),
    "kappa_f": ("viscous friction", "1/s"),
    "sigma_error": ("sigma for an error of unit speed", "1/s"),
    "kappa_error": ("kappa_v for an error of unit speed", "1/s"),
}

#: Status of a number in the file -> how it is shown.
STATUS = {"searched": "estimated", "proved": "proved"}


#: Numbers that the table leaves out, each the largest of all joints.
OTHERS = {
    "inverse": ("diagonal of D^-1", "1/(kg m^2) or 1/kg"),
    "jump": ("what a jump of the load changes", ""),
    "hold": ("torque that holds the arm at the reference", "N m or N"),
    "reach": ("torque for an acceleration of length 1 that the controller requests", ""),
}


#: Smaller shares are not shown.
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
    course = "moving" if moves else "at rest (--acceleration: moving)"
    prices = []  # what one omega for all joints costs of what the rule for automatic tuning gives them
    if robot["rule"] is not None:
        rule, zone = _join(robot["rule"]), _join(robot["dead_zone"])
        prices = [
            f"  The automatic controller with one omega: automatic tuning gives the joints {rule} rad/s.",
            f"  Its dead zone, {zone} rad or m, is in all claims but the error per torque.",
        ]
    lines = [
        f"{robot['name']} with stiff joints, payload {light:g} to {heavy:g} kg",
        f"  Controller: omega {omega} rad/s, {law['integrators']} integrators, roll-off {law['rolloff']}, "
        f"feedforward {robot['feedforward']}, {1e3 * float(law['sample_time']):g} ms, delay "
        f"{law['delay']} samples",
        f"  Reference: {course}, speed up to {_join(limits['speed'])} rad/s or m/s; start: {robot['start']}",
        *prices,
        f"  Configurations (box) [rad or m]: {', '.join(f'{low:.4g} to {high:.4g}' for low, high in box)}",
        "  Numbers of the arm that the claims depend on:",
    ]
    lines += [
        f"    {name:<12} {float(data['numbers'][name]):<10.4g} {unit:<6} {STATUS[data['status'][name]]:<9}  "
        f"{text}"
        for name, (text, unit) in NUMBERS.items()
    ]
    if "gain" in data["solutions"]:
        lines += _joints(made)
    return [verdict_line(made), *made.reasons, *lines]


def verdict_line(made: Any) -> str:
    """Return the verdict as a sentence: the first line that is printed."""
    said = verdict(made)
    return f"{said[0].upper()}{said[1:]}{':' if made.reasons else '.'}"


def share_covered(tried: int) -> float:
    """Return which share of what is possible is, with 95 % confidence, as all of so many drawn ones are."""
    return float(0.05 ** (1.0 / tried))


def verdict(made: Any) -> str:
    """Return in a line whether there is a certificate, and how sure its numbers are."""
    if not made.certified:
        return "not certified"
    if made.numbers_proved:
        return (
            "proved under the assumptions of docs/proof.md, among them stiff joints: every number is proved"
        )
    said = (
        "certified, not proved: the numbers of the arm are estimated numerically, as the largest of a search "
        "and 3 % more"
    )
    if searched := made.data["robot"].get("searched"):
        share = 100.0 * share_covered(searched)
        return (
            f"{said}; each of {searched} other possible arms was searched as well, and none exceeds them: as "
            f"far as such a search finds, with 95 % confidence {share:.0f} % of the arms from "
            "which these were drawn do not"
        )
    if tried := made.data["robot"].get("tried"):  # of a file of an earlier version
        return (
            f"{said}; {tried} other possible arms do not exceed them at the worst points of this one (their "
            "own worst points were not searched)"
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
    """Return the shares of the inputs in all disturbance torques; empty where none was stated."""
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
    meaning = [
        "  Largest errors: per disturbance torque at rest, for torques up to the next column; under all",
        "  stated disturbances; from the start; after a jump of the payload. Last: largest motor torque.",
    ]
    sizes, lines = (20, 11, 12, 12, 12, 10), [*meaning]
    for name, cells in zip(["joint", *made.joint_names], [head, *claims(made)], strict=True):
        padded = (f"{x:<{w}}" for x, w in zip(cells, sizes, strict=True))
        lines.append(f"    {name:<{width}}  " + "  ".join(padded).rstrip())
    disturbances = shares(made)
    lines += [f"  Shares of the disturbances: {disturbances}"] if disturbances else []
    lines.append(f"  The effect of a disturbance decays at {made.decay:.3g} 1/s.")
    return lines
