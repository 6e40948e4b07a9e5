"""Why there is no certificate: which number limits it, and which change would suffice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

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
#: Units of those that have one.
_UNITS = {"kappa_e": " 1/s^2", "kappa_g": " 1/s^2"}
#: Bandwidths that are tried in place of the one asked for.
_BANDWIDTHS = (0.5, 0.7, 0.85, 1.2, 1.5, 2.0)
_SHARES = (0.5, 0.25, 0.1)
#: A part of a certificate file.
_Part = Mapping[str, Any]


def explain_unsolved(asked: Asked, law: _Part, numbers: _Part, inputs: _Part) -> list[str]:
    """Return why the inequality has no solution: the sector, the limiting number, and what would suffice.

    Args:
        asked: what was asked for.
        law: of the certificate.
        numbers: of the certificate.
        inputs: of the certificate.
    """
    reasons = [_sector(asked, law, numbers, float(inputs["spread"]))]
    limiting = []
    for name, meaning in _NUMBERS.items():
        if solvable(law, _less(numbers, name, 0.0), inputs):
            value = f"{float(numbers[name]):.4g}{_UNITS.get(name, '')}"
            limiting.append(f"Limiting quantity: {meaning}, {name} = {value}.")
    if not limiting:
        limiting = ["Limiting quantity: more than one; improving one of them alone would not suffice."]
    return reasons + limiting + _remedies(asked, law, numbers, inputs)


def beyond(asked: Asked, what: str | None, spread: float | None, found: _Part | None) -> list[str]:
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
    for key, limits, text, quantity in (
        ("errors", asked.radius, off, POSITION),
        ("torques", robot.limits.effort, weak, TORQUE),
    ):
        values = np.array([float(x) for x in found[key]])
        worst = int(np.argmax(values / limits))
        if values[worst] > limits[worst]:
            unit = quantity.symbol(bool(robot.prismatic[worst]))
            joint = f"joint {names[worst]!r}"
            sentence = text.format(joint, values[worst], limits[worst], unit=unit)
            said.append(f"{where}, {sentence}{less}.")
    if float(found["speed"][0]) > spread:
        said.append(
            f"{where}, the speed of the error can exceed the one that the numbers were taken for. "
            "Try smaller disturbances."
        )
    return said


def _less(numbers: _Part, name: str, share: float) -> dict[str, Any]:
    """Return numbers with one of them, above its best value, only a share of it."""
    best = 1.0 if name == "delta_high" else 0.0
    value = best + share * max(0.0, float(numbers[name]) - best)
    changed = {**numbers, name: repr(value)}
    if float(changed["delta_low"]) > float(changed["delta_high"]):
        changed["delta_low"] = changed["delta_high"]
    return changed


def _sector(asked: Asked, law: _Part, numbers: _Part, spread: float) -> str:
    """Return the sector that the controller tolerates, compared with the one asked for."""
    low = float(numbers["delta_low"])
    high = float(numbers["delta_high"])
    sigma = spread * float(numbers["sigma_error"])
    omega = float(law["omega"][0])
    zeta = float(law["zeta"])
    pole = float(law["pole_ratio"]) * omega
    tuning = Tuning(np.array(omega), np.array(zeta), np.array(pole))
    loop = open_loop(tuning, member_of(law))
    most = sector(loop, low, sigma).upper
    return (
        f"The inertia ratio delta is {low:.3g} to {high:.3g} and changes at sigma = {sigma:.3g} 1/s; the "
        f"controller tolerates {low:.3g} to {most:.3g}, and less with sampling, delay, gravity and Coriolis "
        "torques."
    )


def _remedies(asked: Asked, law: _Part, numbers: _Part, inputs: _Part) -> list[str]:
    """Return changes each of which alone would suffice: of each kind the least that does."""
    kinds = (
        _bandwidths(law, numbers, inputs),
        _speeds(law, numbers, inputs),
        _loads(asked, law, numbers, inputs),
        _delays(law, numbers, inputs),
    )
    sentences = []
    for trials in kinds:
        enough = next((trial.change for trial in trials if trial.solves), None)
        if enough is not None:
            sentences.append(f"This change would suffice: {enough}.")
    rotors = zip(asked.robot.joint_names, asked.robot.armature, strict=True)
    missing = [name for name, rotor in rotors if not rotor]
    if missing:
        joints = ", ".join(missing)
        sentences.append(f"Rotor inertia makes all numbers smaller; specify that of {joints}.")
    return sentences


class _Trial(NamedTuple):
    """A certificate's parts with one change.

    Attributes:
        change: in words.
        law: with the change, as the other parts.
        numbers: of the arm.
        inputs: what disturbs.
    """

    change: str
    law: _Part
    numbers: _Part
    inputs: _Part

    @property
    def solves(self) -> bool:
        """Whether the inequality has a solution with it."""
        return solvable(self.law, self.numbers, self.inputs)


def _bandwidths(law: _Part, numbers: _Part, inputs: _Part) -> Iterator[_Trial]:
    """Give other bandwidths, the lowest first."""
    for factor in _BANDWIDTHS:
        omega = round(factor * float(law["omega"][0]), 3)
        yield _Trial(f"omega = {omega:.3g} rad/s", {**law, "omega": [repr(omega)]}, numbers, inputs)


def _speeds(law: _Part, numbers: _Part, inputs: _Part) -> Iterator[_Trial]:
    """Give shares of the speed, the largest first."""
    for share in _SHARES:
        spread = share * float(inputs["spread"])
        yield _Trial(f"{share:g} of the speed", law, numbers, {**inputs, "spread": repr(spread)})


def _loads(asked: Asked, law: _Part, numbers: _Part, inputs: _Part) -> Iterator[_Trial]:
    """Give shares of the range of loads, the largest first; none where all loads are the same."""
    lightest, heaviest = asked.loads
    if not heaviest > lightest:
        return
    for share in _SHARES:
        change = f"{share:g} of the range of loads, or a smaller box"
        yield _Trial(change, law, _less(numbers, "delta_high", share), inputs)


def _delays(law: _Part, numbers: _Part, inputs: _Part) -> Iterator[_Trial]:
    """Give the loop without its delay; nothing where it has none."""
    if law["delay"]:
        yield _Trial("no delay", {**law, "delay": 0}, numbers, inputs)
