"""Why there is no certificate: which number limits it, and which change would suffice."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armgpi.certification.request import Asked, member_of
from armgpi.certification.solve import solvable
from armgpi.gpi.gains import Tuning
from armgpi.gpi.margins import open_loop, sector
from armgpi.loop.units import POSITION, TORQUE

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
    """Return why the inequality has no solution: the sector, the limiting number, and what would suffice.

    Args:
        asked: what was asked for.
        law: of the certificate.
        numbers: of the certificate.
        inputs: of the certificate.
    """
    said = [_sector(asked, law, numbers, float(inputs["spread"]))]
    causes = [name for name in _NUMBERS if solvable(law, _less(numbers, name, 0.0), inputs)]
    said += [
        f"Limiting quantity: {_NUMBERS[name]}, {name} = {float(numbers[name]):.4g}{_UNITS[name]}."
        for name in causes
    ]
    if not causes:
        said.append("Limiting quantity: more than one; improving one of them alone would not suffice.")
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
    where = "Without disturbances" if what is None else f"Under {what}"
    less = "" if what is None else " or smaller disturbances"
    if spread is None or found is None:
        return [
            f"{where}, the speed of the error has no bound that the controller can tolerate. Try smaller "
            "disturbances, a slower reference, feedforward, or an arm with rotor inertia."
        ]
    said = []
    off = "the error of {} can reach {:.3g} {unit}; radius allows {:.3g} {unit}. Try a larger radius"
    weak = (
        "{} can need a torque of {:.3g} {unit}; its effort is {:.3g} {unit}. Try a lighter payload, more "
        "effort, to lock it"
    )
    kinds = (("errors", asked.radius, off, POSITION), ("torques", robot.limits.effort, weak, TORQUE))
    for key, limits, text, quantity in kinds:
        values = np.array([float(x) for x in found[key]])
        worst = int(np.argmax(values / limits))
        if values[worst] > limits[worst]:
            unit = quantity.symbol(bool(robot.prismatic[worst]))
            sentence = text.format(f"joint {names[worst]!r}", values[worst], limits[worst], unit=unit)
            said.append(f"{where}, {sentence}{less}.")
    if float(found["speed"][0]) > spread:
        said.append(
            f"{where}, the speed of the error can exceed the one that the numbers were taken for. "
            "Try smaller disturbances."
        )
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
    """Return the sector that the controller tolerates, compared with the one asked for."""
    low, high, sigma = (float(numbers[x]) for x in ("delta_low", "delta_high", "sigma_error"))
    sigma *= spread
    omega, zeta, pole = (float(x) for x in (law["omega"][0], law["zeta"], law["pole_ratio"]))
    loop = open_loop(Tuning(np.array(omega), np.array(zeta), np.array(pole * omega)), member_of(law))
    most = sector(loop, low, sigma).upper
    return (
        f"The inertia ratio delta is {low:.3g} to {high:.3g} and changes at sigma = {sigma:.3g} 1/s; the "
        f"controller tolerates {low:.3g} to {most:.3g}, and less with sampling, delay, gravity and Coriolis "
        "torques."
    )


def _remedies(
    asked: Asked, law: Mapping[str, Any], numbers: Mapping[str, Any], inputs: Mapping[str, Any]
) -> list[str]:
    """Return changes each of which alone would suffice."""
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
    said = [f"This change would suffice: {what}." for what in first if what is not None]
    if not asked.robot.armature.all():
        missing = [x for x, y in zip(asked.robot.joint_names, asked.robot.armature, strict=True) if not y]
        said.append(f"Rotor inertia makes all numbers smaller; specify that of {', '.join(missing)}.")
    return said
