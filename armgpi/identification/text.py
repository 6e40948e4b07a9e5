"""What was identified, in words and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.verdict import Verdict, judge
from armgpi.errors import ArmgpiError
from armgpi.gpi.law import GPI
from armgpi.identification.arm import Estimate, Identified, Load, Validation
from armgpi.identification.estimate import HALF_95, is_supposed
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears
from armgpi.tuning.rule import BITS
from armgpi.tuning.verdict import describe_bandwidths, verdict, why_sensitive

#: Residual over torque up to which a model is good enough to control by, and from which it explains little.
_GOOD, _POOR = 0.1, 0.25
#: Residual over torque from which, at two joints or more, columns may be swapped: real arms had one at most.
_STRANGE = 0.2
#: Residual of another log over that of the fitted ones, and over its torque, from which the arm has changed.
_DRIFT, _DRIFTED = 2.0, 0.02
#: What is said of friction that is neither Coulomb nor viscous.
_FRICTIONS = {
    "load": "grows with its load, by {} of the gravity torque",
    "stribeck": "is {} larger near rest",
}
#: What is said of a motor that turns with another joint, too.
_COUPLED = "its motor turns with {} as well (rotor {}); simulated plants do not have it"
#: Draws of the arm for what the logs leave open.
_DRAWS = 16
#: Sample time of `armgpi run` where nobody says another [s].
_SAMPLE_TIME = 1e-3
#: Bins of a residual over something, and the share of its power that their means have to explain before
#: that is named as its cause.
_BINS, _CAUSE = 12, 0.3
#: Share of the moments that are the slowest, and of the power that has to be in them where a joint sticks.
_SLOW, _STICKS = 0.2, 0.5
#: What a residual may follow, and what that says.
_CAUSES = {
    "position": "it goes with its position: ripple, a cable, or a body of another shape",
    "speed": "it goes with its speed: friction is more than Coulomb and viscous",
    "torque": "it goes with its torque: friction grows with the load, or the torque has another scale",
    "time": "it goes with time: it warms up, or something changed",
}
#: Share of the data in an estimate from which the log has decided a number.
_DECIDED = 0.5
#: What is said of the controller of an identified arm: page and terminal ask for it, and it takes a while.
_CONTROLLERS: WeakKeyDictionary[Identified, list[str]] = WeakKeyDictionary()


def say_residuals(
    robot: Robot, residuals: Array, held_out: bool, causes: Mapping[str, str] | None = None
) -> list[str]:
    """Return the verdict: how much of the torques the model leaves unexplained, worst joints and causes."""
    seen = "a log that was not fitted" if held_out else "the fitted log"
    if not np.isfinite(residuals).any():
        return [f"No joint moved in {seen}: the model was not tested."]
    median = 100.0 * float(np.nanmedian(residuals))
    lines = [f"The model leaves {median:.2g} % of a joint's torque on {seen} unexplained (median)."]
    unknown = "its friction is more than Coulomb and viscous, or it turns with another motor"
    for name, share in zip(robot.joint_names, residuals, strict=True):
        if np.isnan(share):
            lines.append(f"{name} did not move in it.")
        elif share > _GOOD:
            cause = (causes or {}).get(name, unknown if share > _POOR else "")
            lines.append(f"{name}: {100 * share:.2g} % is unexplained{cause and ': '}{cause}.")
    strange = [name for name, share in zip(robot.joint_names, residuals, strict=True) if share > _STRANGE]
    if len(strange) > 1:
        lines.append(
            f"So much of {' and '.join(strange)} is unexplained that their columns may be swapped, or of "
            "another robot: check which torque belongs to which joint before you use what is written."
        )
    if not held_out:
        lines.append("No other log was given: other motions were not tested.")
    return lines


def say_causes(robot: Robot, judged: Validation) -> dict[str, str]:
    """Return joint -> what its residual follows, where it follows something."""
    found = {}
    left = judged.torque - judged.predicted
    for j, name in enumerate(robot.joint_names):
        own = np.isfinite(left[:, j])
        rest = left[own, j]
        power = float(rest @ rest)
        if len(rest) < 3 * _BINS or not power:
            continue
        speed = np.abs(judged.velocity[own, j])
        slow = speed <= np.quantile(speed, _SLOW)
        axes = followed(judged, j)
        shares = {key: _explain(values[own], rest) for key, values in axes.items()}
        best = max(shares, key=lambda key: shares[key])
        if float(rest[slow] @ rest[slow]) > _STICKS * power:
            found[name] = "it sticks: most of the residual is near rest"
        elif shares[best] > _CAUSE:
            found[name] = _CAUSES[best]
    return found


def followed(judged: Validation, joint: int) -> dict[str, Array]:
    """Return what a residual is drawn over."""
    return {
        "time": judged.times,
        "position": judged.position[:, joint],
        "speed": judged.velocity[:, joint],
        "torque": judged.predicted[:, joint],
    }


def _explain(values: Array, rest: Array) -> float:
    """Return the share of a residual's power that its means over bins explain beyond what chance does."""
    ends = np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1)[1:-1])
    bins = np.searchsorted(ends, values)
    counts = np.maximum(np.bincount(bins, minlength=_BINS), 1)
    explained = float((np.bincount(bins, rest, _BINS) ** 2 / counts).sum()) / float(rest @ rest)
    chance = _BINS / len(rest)
    return (explained - chance) / (1.0 - chance)


def say_lag(found: Identified) -> str:
    """Return the lag in words."""
    lag, std = found.lag, found.lag_std
    if np.ptp(lag) == 0.0:
        half_width = 1e3 * HALF_95 * std[0]
        return f"measured positions lag {1e3 * lag[0]:.2f} ms (± {half_width:.1g}) behind the torques"
    each = ", ".join(f"{name} {1e3 * x:.2f}" for name, x in zip(found.robot.joint_names, lag, strict=True))
    return f"measured positions lag behind the torques, joint by joint [ms]: {each}"


def say_gears(found: Identified) -> list[str]:
    """Return the first mode, and the joints whose gears the multisine did not decide."""
    gears = found.gears
    if gears is None:
        return []
    value, low, high = gears.mode
    said = f"first mode {value:.3g} Hz [{low:.3g}, {high:.3g}], motors free, in the middle"
    lines = [f"{said}; encoders at the {gears.side}"]
    still = np.isnan(gears.misfit)
    for own, why in (
        (still, "the log ends before their turn, or begins after it, so the first mode may be lower"),
        (~(still | gears.measured.astype(bool)), "joints as stiff as assumed, or stiffer than the log shows"),
    ):
        if own.any():
            names = ", ".join(np.array(found.robot.joint_names)[own])
            lines.append(f"{why}: {names}")
    return lines


def say_side(found: Identified) -> list[str]:
    """Return what chirps say of the side of the encoders."""
    if found.side is None:
        return []
    if not found.side.side:
        return ["the chirps do not decide the side of the encoders: too coarse, or too stiff joints"]
    return [f"by the chirps the encoders sit at the {found.side.side}s"]


def say_drift(found: Identified, validation: Validation | None) -> list[str]:
    """Return the joints that another log leaves much more of than the fitted ones do."""
    if validation is None:
        return []
    names = _worse_joints(found, found.residuals, validation.identified)
    said = f"drifted since the fitted logs, or moved otherwise than in them: {names}; identify again"
    return [said] if names else []


def say_simulation(found: Identified) -> list[str]:
    """Return what the simulated experiment of the first log says of the arm, beside the weak form."""
    if found.simulated is None:
        return []
    if np.isinf(found.simulated).any():
        return ["misfit: simulated with the experiment of the first log, the identified arm fails"]
    weak = found.replayed.identified
    here, there = (_percent(float(np.nanmedian(each))) for each in (found.simulated, weak))
    said = f"simulated with its experiment, the arm is {here} % of a joint's torque off the first log"
    lines = [f"{said} (median), by the weak form {there} %"]
    names = _worse_joints(found, weak, found.simulated)
    return [*lines, f"misfit: farther off by simulation than by the weak form: {names}"] if names else lines


def _worse_joints(found: Identified, own: Array, other: Array) -> str:
    """Return the joints of which another residual is so much larger that it is no chance."""
    rows = zip(found.robot.joint_names, own, other, strict=True)
    return ", ".join(name for name, x, y in rows if y > max(_DRIFT * x, _DRIFTED))


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
        elif row.quantity.startswith("rotor with "):
            lines.append(f"{row.joint}: {_COUPLED.format(row.quantity[11:], _interval(row))}")
    hidden = [name for name, own in zip(found.robot.joint_names, found.hidden, strict=True) if own]
    if len(hidden) == found.robot.n:
        lines.append(
            "the torques are those of sensors behind the gears: rotor inertia and motor friction are not in "
            "them and stay assumed; what is listed as friction is that behind the sensors"
        )
    together = {row.joint: row for row in found.sums()}
    for row in found.table():
        if row.quantity == "rotor" and row.data_share < _DECIDED and row.joint not in hidden:
            both = together[row.joint]
            lines.append(
                f"{row.joint}: the rotor cannot be separated from the links; the joint's mean inertia is "
                f"{both.value:.3g} [{both.lower:.3g}, {both.upper:.3g}]"
            )
    return lines


def say_notes(found: Identified, validation: Validation | None) -> list[str]:
    """Return what else there is to know."""
    parts = (
        say_drift(found, validation),
        [say_lag(found)],
        say_gears(found),
        say_side(found),
        say_simulation(found),
        say_law(found),
        say_findings(found),
    )
    return [line for part in parts for line in part]


def say_load(load: Load) -> str:
    """Return a load in words, with 95 % intervals."""
    place = ", ".join(f"{1e3 * x:.3g} ± {1960 * s:.1g}" for x, s in zip(load.com, load.com_std, strict=True))
    inertia = ", ".join(f"{x:.2g}" for x in np.diag(load.inertia))
    unknown = (
        f"; ± {100 * load.scale:.0f} % of the mass are those of the torque constants, which a known load "
        "(--load-mass) tells"
    )
    unknown = unknown if load.scale else ""
    return (
        f"load: {load.mass:.4g} ± {HALF_95 * load.mass_std:.1g} kg, centre at {place} mm in {load.frame}, "
        f"inertia {inertia} kg m² about it{unknown}"
    )


def say_law(found: Identified) -> list[str]:
    """Return how fast the automatic controller is by what is known now, and its margins.

    The loop has the sample time of `armgpi run`, or that of the log if it is shorter, and a delay of one
    sample at least, as that of `armgpi run` has.
    """
    if found not in _CONTROLLERS:
        _CONTROLLERS[found] = _say_controller(found)
    return _CONTROLLERS[found]


def _say_controller(found: Identified) -> list[str]:
    """Return how fast the automatic controller is, see :func:`say_law`."""
    dt = min(found.dt, _SAMPLE_TIME)
    late = max(round(found.late / dt), 1)
    try:
        robot = assume_gears(found.robot)
        law = GPI.auto(robot, dt, delay=late * dt, bits=BITS)
    except ArmgpiError as error:
        return [f"no automatic controller for it: {error}"]
    low, high = found.delta(count=_DRAWS)
    judged = verdict(law, robot, BITS)
    samples = "1 sample" if late == 1 else f"{late} samples"
    lines = [
        f"the automatic controller at {1e3 * dt:.3g} ms with a delay of {samples}: bandwidth "
        f"{describe_bandwidths(law)}, {judged.describe()}; the logs leave inertia "
        f"{low:.2f} to {high:.2f} times the identified one"
    ]
    if why := why_sensitive(robot, judged):
        lines.append(why)
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
    """Return an estimate with its interval; in brackets what the data do not decide."""
    text = f"{row.value:.3g} [{row.lower:.3g}, {row.upper:.3g}]"
    return text if row.data_share >= _DECIDED else f"({text})"


def _percent(share: float) -> str:
    """Return a share in percent."""
    return "no motion" if np.isnan(share) else f"{100.0 * share:.2g}"


def lines(found: Identified, validation: Validation | None, rows: Sequence[str] = ()) -> str:
    """Return everything as text for a terminal: verdict, notes."""
    residuals = found.residuals if validation is None else validation.identified
    causes = say_causes(found.robot, validation or found.replayed)
    verdict = say_residuals(found.robot, residuals, validation is not None, causes)
    notes = say_notes(found, validation)
    return "\n".join([*verdict, *notes, *rows]) + "\n"


def judge_arm(found: Identified, validation: Validation | None, accepted: bool = False) -> Verdict:
    """Return the verdict: joints that no log moves, and gears that have no turn in their log, are left out.

    It fails where the identified arm fails when it is simulated, or explains little of another log.

    Args:
        found: the arm.
        validation: on another log, where one was given.
        accepted: whether what was left out is accepted.
    """
    names = found.robot.joint_names
    left_out = [
        f"{name}: did not move in the fitted logs"
        for name, share in zip(names, found.residuals, strict=True)
        if np.isnan(share)
    ]
    if validation is not None:
        judged = zip(names, validation.identified, strict=True)
        left_out += [f"{name}: did not move in the other log" for name, share in judged if np.isnan(share)]
    if found.gears is not None:
        misfits = zip(names, found.gears.misfit, strict=True)
        left_out += [f"{name}: its gear had no turn in the log" for name, x in misfits if np.isnan(x)]
    lost = found.simulated is not None and bool(np.isinf(found.simulated).any())
    residuals = found.residuals if validation is None else validation.identified
    moved = residuals[np.isfinite(residuals)]
    if not len(moved):
        return Verdict(
            "not judged", "no joint moved in the log on which the model is evaluated", tuple(left_out)
        )
    poor = float(np.median(moved)) > _POOR
    text = "the identified model explains the torques"
    if lost:
        text = "the identified arm fails when it is simulated with the experiment of the first log"
    elif poor:
        text = (
            f"the identified model leaves {100.0 * float(np.median(moved)):.2g} % of the torques unexplained"
        )
    return judge(not (lost or poor), text, left_out, accepted=accepted)
