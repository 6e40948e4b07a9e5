"""What was identified, in words and tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armgpi.arrays import Array
from armgpi.identification.arm import Estimate, Identified, Validation
from armgpi.identification.estimate import is_supposed
from armgpi.robot.robot import Robot

#: Residual over torque up to which a model is good enough to control by, and from which it explains little.
_GOOD, _POOR = 0.1, 0.25
#: Residual of another log over that of the fitted ones, and over its torque, from which the arm has changed.
_DRIFT, _DRIFTED = 2.0, 0.02
#: What is said of friction that is neither Coulomb nor viscous.
_FRICTIONS = {
    "load": "grows with its load, by {} of the gravity torque",
    "stribeck": "is {} larger near rest",
}
#: Share learned from which the log has decided a number.
_DECIDED = 0.5


def say_residuals(robot: Robot, residuals: Array, held_out: bool) -> list[str]:
    """Return the verdict: how much of the torques the model leaves unexplained, worst joints by name."""
    seen = "a log that was not fitted" if held_out else "the fitted log"
    if not np.isfinite(residuals).any():
        return [f"No joint moved in {seen}: nothing can be said of the model."]
    median = 100.0 * float(np.nanmedian(residuals))
    lines = [f"The model leaves {median:.2g} % of a joint's torque on {seen} unexplained (median)."]
    for name, share in zip(robot.joint_names, residuals, strict=True):
        if np.isnan(share):
            lines.append(f"{name} did not move in it.")
        elif share > _POOR:
            lines.append(
                f"{name}: {100 * share:.2g} % is unexplained: its friction is more than Coulomb and viscous, "
                "or it turns with another motor."
            )
        elif share > _GOOD:
            lines.append(f"{name}: {100 * share:.2g} % is unexplained.")
    if not held_out:
        lines.append("No other log was given: this says nothing of motions that are not in this one.")
    return lines


def say_lag(found: Identified) -> str:
    """Return the lag in words."""
    lag, std = found.lag, found.lag_std
    if np.ptp(lag) == 0.0:
        return f"measured positions lag {1e3 * lag[0]:.3g} ms (± {1.96e3 * std[0]:.1g}) behind the torques"
    each = ", ".join(f"{name} {1e3 * x:.3g}" for name, x in zip(found.robot.joint_names, lag, strict=True))
    return f"measured positions lag behind the torques, joint by joint [ms]: {each}"


def say_drift(found: Identified, validation: Validation | None) -> list[str]:
    """Return the joints that another log leaves much more of than the fitted ones do."""
    if validation is None:
        return []
    pairs = zip(found.robot.joint_names, found.residuals, validation.identified, strict=True)
    worse = [name for name, own, other in pairs if other > max(_DRIFT * own, _DRIFTED)]
    return worse and [
        f"drifted since the fitted logs, or moved otherwise than in them: {', '.join(worse)}; identify again"
    ]


def say_findings(found: Identified) -> list[str]:
    """Return what the check remarked, and which rotors the log did not decide."""
    lines = [str(each) for each in found.findings]
    if is_supposed(found.file):
        said = "the file has no masses: bodies began as rods from joint to joint, within four times"
        lines.append(f"{said}; what the log does not decide is still supposed")
    for row in found.table():
        if row.quantity in _FRICTIONS:
            said = _FRICTIONS[row.quantity].format(_interval(row))
            lines.append(f"{row.joint}: its friction {said}; simulated plants do not have it")
    together = {row.joint: row for row in found.sums()}
    for row in found.table():
        if row.quantity == "rotor" and row.learned < _DECIDED:
            both = together[row.joint]
            lines.append(
                f"{row.joint}: the rotor cannot be told from the links; the joint's mean inertia is "
                f"{both.value:.3g} [{both.lower:.3g}, {both.upper:.3g}]"
            )
    return lines


def tabulate(found: Identified, validation: Validation | None) -> tuple[list[str], list[list[str]]]:
    """Return the head and the rows of the table: drives with 95 % intervals, and residuals."""
    rows: dict[str, list[str]] = {name: [name] for name in found.robot.joint_names}
    for row in found.table():
        if row.quantity in ("rotor", "coulomb", "viscous"):
            rows[row.joint].append(_interval(row))
    for name, share in zip(found.robot.joint_names, found.residuals, strict=True):
        rows[name].append(_percent(share))
    head = [
        "joint",
        "rotor\n[kg m² or kg]",
        "Coulomb\n[N m or N]",
        "viscous\n[N m s/rad or N s/m]",
        "residual\n[%]",
    ]
    if validation is not None:
        head += ["other log,\nidentified [%]", "other log,\nfile [%]"]
        shares = zip(found.robot.joint_names, validation.identified, validation.file, strict=True)
        for name, identified, file in shares:
            rows[name] += [_percent(identified), _percent(file)]
    return head, list(rows.values())


def _interval(row: Estimate) -> str:
    """Return an estimate with its interval; in brackets what only the file says."""
    text = f"{row.value:.3g} [{row.lower:.3g}, {row.upper:.3g}]"
    return text if row.learned >= _DECIDED else f"({text})"


def _percent(share: float) -> str:
    """Return a share in percent."""
    return "no motion" if np.isnan(share) else f"{100.0 * share:.2g}"


def lines(found: Identified, validation: Validation | None, rows: Sequence[str] = ()) -> str:
    """Return everything as text for a terminal: verdict, notes."""
    residuals = found.residuals if validation is None else validation.identified
    verdict = say_residuals(found.robot, residuals, held_out=validation is not None)
    notes = [*say_drift(found, validation), say_lag(found), *say_findings(found)]
    return "\n".join([*verdict, *notes, *rows]) + "\n"
