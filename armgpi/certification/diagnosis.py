"""Why there is no certificate: which number is in the way, and what would do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armgpi.certification.request import Asked, member_of
from armgpi.certification.solve import solvable
from armgpi.gpi.gains import Tuning
from armgpi.gpi.margins import open_loop, sector

#: What each number comes from.
_NUMBERS = {
    "delta_high": "the range of loads",
    "sigma_error": "the rate of the metric D(q)",
    "kappa_error": "Coriolis torques",
    "kappa_e": "the stiffness of gravity",
    "kappa_g": "gravity between samples",
}
_UNITS = {**dict.fromkeys(_NUMBERS, ""), "kappa_e": " 1/s^2", "kappa_g": " 1/s^2"}
#: Bandwidths that are tried in place of the one asked for.
_BANDWIDTHS = (0.5, 0.7, 0.85, 1.2, 1.5, 2.0)
_SHARES = (0.5, 0.25, 0.1)


def explain_unsolved(
    asked: Asked, law: Mapping[str, Any], numbers: Mapping[str, Any], inputs: Mapping[str, Any]
) -> list[str]:
    """Return why the inequality has no solution: the sector, the number in the way, and what would do.

    Args:
        asked: what was asked for.
        law: of the certificate.
        numbers: of the certificate.
        inputs: of the certificate.
    """
    said = [_sector(asked, law, numbers, float(inputs["spread"]))]
    causes = [name for name in _NUMBERS if solvable(law, _less(numbers, name, 0.0), inputs)]
    said += [
        f"in the way: {_NUMBERS[name]}, {name} = {float(numbers[name]):.4g}{_UNITS[name]}" for name in causes
    ]
    if not causes:
        said.append("in the way: more than one number; none alone at its best would do")
    return said + _remedies(asked, law, numbers, inputs)


def beyond(
    asked: Asked, what: str | None, spread: float | None, found: Mapping[str, Any] | None
) -> list[str]:
    """Return why there is no claim: where bounds are not within what the numbers were taken over.

    Args:
        asked: what was asked for.
        what: disturbs; None where nothing does.
        spread: speed of the error for which the numbers were taken; None where nothing is certified at it.
        found: the bounds; None where there are none.
    """
    robot, names = asked.robot, asked.robot.joint_names
    where = "where nothing disturbs" if what is None else f"under {what}"
    less = "" if what is None else ", or less that disturbs,"
    if spread is None or found is None:
        return [
            f"{where} the error may be so fast that the arm's own motion is more than the law takes: "
            "less that disturbs, a slower reference, feedforward or rotor inertia would do"
        ]
    said = []
    off = "{} may be {:.3g} off and radius allows {:.3g}: a larger radius"
    weak = "{} may need {:.3g} and its effort is {:.3g}: a lighter load, more effort or the joint locked"
    for key, limits, text in (("errors", asked.radius, off), ("torques", robot.limits.effort, weak)):
        values = np.array([float(x) for x in found[key]])
        worst = int(np.argmax(values / limits))
        if values[worst] > limits[worst]:
            told = text.format(f"joint {names[worst]!r}", values[worst], limits[worst])
            said.append(f"{where} {told}{less} would do")
    if float(found["speed"][0]) > spread:
        said.append(f"{where} no bound on the speed of the error implies itself: less that disturbs would do")
    return said


def _less(numbers: Mapping[str, Any], name: str, share: float) -> dict[str, Any]:
    """Return numbers with one of them, above its best value, only a share of it."""
    best = 1.0 if name == "delta_high" else 0.0
    value = best + share * max(0.0, float(numbers[name]) - best)
    changed = {**numbers, name: repr(value)}
    if float(changed["delta_low"]) > float(changed["delta_high"]):
        changed["delta_low"] = changed["delta_high"]
    return changed


def _sector(asked: Asked, law: Mapping[str, Any], numbers: Mapping[str, Any], spread: float) -> str:
    """Return what the law takes beside what is asked, with an error of some speed."""
    low, high, sigma = (float(numbers[x]) for x in ("delta_low", "delta_high", "sigma_error"))
    sigma *= spread
    omega, zeta, pole = (float(x) for x in (law["omega"][0], law["zeta"], law["pole_ratio"]))
    loop = open_loop(Tuning(np.array(omega), np.array(zeta), np.array(pole * omega)), member_of(law))
    most = sector(loop, low, sigma).upper
    return (
        f"no certificate: delta goes from {low:.3g} to {high:.3g}, and moves at sigma = {sigma:.3g} 1/s; "
        f"without sampling, delay, gravity and Coriolis torques the law takes {low:.3g} to {most:.3g}"
    )


def _remedies(
    asked: Asked, law: Mapping[str, Any], numbers: Mapping[str, Any], inputs: Mapping[str, Any]
) -> list[str]:
    """Return what would do, each alone."""
    omegas = [round(factor * float(law["omega"][0]), 3) for factor in _BANDWIDTHS]
    # What is tried of each kind, the least change first.
    bandwidths = ((f"omega = {x:.3g} rad/s", {**law, "omega": [repr(x)]}, numbers, inputs) for x in omegas)
    speeds = (
        (f"{x:g} of the speed", law, numbers, {**inputs, "spread": repr(x * float(inputs["spread"]))})
        for x in _SHARES
    )
    loads = (
        (f"{x:g} of the range of loads, or a smaller box", law, _less(numbers, "delta_high", x), inputs)
        for x in _SHARES
        if asked.loads[1] > asked.loads[0]
    )
    delays = [("no delay", {**law, "delay": 0}, numbers, inputs)] * bool(law["delay"])
    kinds = (bandwidths, speeds, loads, delays)
    first = (next((what for what, *changed in tried if solvable(*changed)), None) for tried in kinds)
    said = [f"what would do: {what}" for what in first if what is not None]
    if not asked.robot.armature.all():
        missing = [x for x, y in zip(asked.robot.joint_names, asked.robot.armature, strict=True) if not y]
        said.append(f"rotor inertia makes all numbers smaller; give that of {', '.join(missing)}")
    return said
