"""What has to be true of a log before a fit of it can mean anything."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import optimize

from armgpi.base.arrays import Array
from armgpi.errors import UnfitLog
from armgpi.identification.estimate import Prior, is_supposed
from armgpi.identification.logs import Grid, Log
from armgpi.identification.samples import Finding, check_samples
from armgpi.identification.weak_form import (
    BODY,
    COLUMNS,
    COULOMB,
    MOST_LAG,
    OFFSET,
    ROTOR,
    VISCOUS,
    WeakForm,
)
from armgpi.robot.robot import Robot

#: Least speed of a joint [rad/s or m/s]: ten times that at which the sign of velocity is noise.
_LEAST_SPEED = 0.04
#: Fewest turns of a joint's motion.
_TURNS = 2
#: Least share of a joint's torque that its own terms, each with its sign, have to explain.
_EXPLAINED = 0.5
#: How much more the terms of another joint or the reversed torque may explain before it is taken for that
#: one's.
_BETTER = 0.25
#: Least share of a torque that counts as unexplained.
_NOTHING_LEFT = 1e-6
#: Logarithm of the power that torques leave unexplained in the order of the log over that in another order,
#: from which it is the other one. Logs of four real and five simulated arms had -3.2 or less for every pair
#: of joints, and 3.2 or more with that pair swapped (tools/swapped.py).
OTHER_ORDER = 1.6
#: Share of the weight that the torques have to carry.
_WEIGHT = 0.3
#: Share of the power of a torque that weight has to be before that is asked for.
_WEIGHS = 0.3
#: What the file expects over a torque from which its unit is another one.
_TOO_SMALL = 30.0
#: A torque over the most that an arm with rotors and friction may take, likewise.
_TOO_LARGE = 10.0
#: What that allows for: bodies over the file's, rotors over the assumed ones, and friction in standard
#: deviations above what is expected.
_BODIES = 1.5
_ROTORS = 4.0
_FRICTIONS = 2.0
#: Coulomb friction that was found, over that allowance, from which its torque has another unit.
_RUBS = 2.0
#: A found rotor over the expected one that is not plausible for a motor: none of those published is outside.
LIGHT = 0.15
HEAVY = 4.0
#: Residual over torque of a joint beyond which the fit is of another arm.
_UNEXPLAINED = 0.5
#: Rotor over the expected one from which something else is wrong: none of those published is above four.
_HEAVY = 10.0
#: Distance of a body from the file's, over what is expected, from which that is said.
_UNLIKE = 1.5
#: Distance of the links but the last from the file's, squared, from which they are those of another robot.
#: Logs of five real and of the right simulated arms, with payloads up to the rated one, had 3.8 or less; two
#: real UR10s named UR5 had 6.2 and 7.3, simulated arms named another one 9.4 or more; chosen between them
#: (tools/another_robot.py).
ANOTHER_ROBOT = 5.0
#: Time of a log in which positions in another order are tried [s].
_TRIED = 10.0
#: Width of the sign in the check [rad/s or m/s].
_WIDTH = 5e-3


def refuse(findings: Sequence[Finding]) -> None:
    """Refuse logs with an error.

    Raises:
        UnfitLog: with all of them.
    """
    errors = [str(finding) for finding in findings if finding.severity == "error"]
    if errors:
        raise UnfitLog(errors)


def check(robot: Robot, gravity: bool, prior: Prior, log: Log, grid: Grid, form: WeakForm) -> list[Finding]:
    """Return what is wrong with a log, or weak: rate, length, units, speed, turns, order and sign."""
    findings = list(check_samples(robot, log, grid))
    is_fit = all(finding.severity != "error" for finding in findings)
    if is_fit and len(form.starts):
        findings += _of_motion(robot, form)
        of_torques = list(_of_torques(robot, gravity, prior, form))
        if any(finding.severity == "error" for finding in of_torques):
            of_torques = check_positions(robot, prior, form) or of_torques
        findings += of_torques
    return [finding._replace(message=f"{finding.message} ({log.source})") for finding in findings]


def check_positions(robot: Robot, prior: Prior, form: WeakForm) -> list[Finding]:
    """Return that the positions of two joints are swapped, where torques follow from the exchanged ones.

    The whole motion is computed again for each pair, so it is asked for where something is wrong already.
    """
    if is_supposed(robot):  # of a bare arm the terms say too little
        return []
    unchanged = list(range(robot.n))
    least = unexplained(explained_in_order(prior, form, unchanged)).sum() - OTHER_ORDER
    swapped: tuple[int, int] | None = None
    for first, second in itertools.combinations(unchanged, 2):
        order = unchanged.copy()
        order[first], order[second] = second, first
        shares = explained_in_order(prior, form, order)
        power = unexplained(shares).sum()
        if power < least and (shares >= _EXPLAINED).all():
            least, swapped = power, (first, second)
    if swapped is None:
        return []
    first_name, second_name = (robot.joint_names[joint] for joint in swapped)
    said = (
        f"the torques follow from the motion with the positions of {first_name!r} and {second_name!r} "
        "exchanged: the columns of these two are swapped, of positions or of torques"
    )
    return [Finding("error", "", said)]


def explained_in_order(prior: Prior, form: WeakForm, order: Sequence[int]) -> Array:
    """Return the share of each joint's torque that positions in some order explain, (n,).

    Args:
        prior: what is expected of the arm.
        form: of the log; its first seconds are taken.
        order: joint -> whose positions it gets.
    """
    n = len(order)
    ordered = form.in_order(order, _TRIED)
    if not len(ordered.starts):
        return np.zeros(n)
    terms = terms_of(prior, ordered, n)
    torque, _ = ordered.torque(np.zeros(n))
    return np.array([_explain(terms[:, joint], torque[:, joint])[0] for joint in range(n)])


def check_fit(names: Sequence[str], lag: Array, residuals: Array, rotors: Array) -> list[Finding]:
    """Return what only the fit shows: torques of another time, or of another arm.

    Args:
        names: of the joints.
        lag: of positions behind torques [s], (n,).
        residuals: residual over torque of each joint, (n,); NaN of one that did not move.
        rotors: lower ends of their intervals over what is expected, (n,).
    """
    findings = []
    if np.abs(lag).max() > MOST_LAG:
        said = f"positions and torques are more than {1e3 * MOST_LAG:g} ms apart: give both the same clock"
        findings.append(Finding("error", "", said))
    for name, share, rotor in zip(names, residuals, rotors, strict=True):
        if rotor > _HEAVY:
            said = f"its rotor is {rotor:.2g} times the assumed one: are times in s, torques at the joint?"
            findings.append(Finding("error", name, said))
        if share > _UNEXPLAINED:
            said = f"no arm of this kind explains {share:.0%} of its torque: is it this robot, in this order?"
            findings.append(Finding("error", name, said))
    return findings


def check_friction(names: Sequence[str], prior: Prior, friction: Array) -> list[Finding]:
    """Return which friction is more than an arm has: the check before the fit, once more after it.

    Args:
        names: of the joints.
        prior: what was expected of an arm.
        friction: lower ends of the intervals of Coulomb friction [N m or N], (n,).
    """
    mean = prior.mean.reshape(len(names), -1)[:, COULOMB]
    std = prior.std.reshape(len(names), -1)[:, COULOMB]
    most = _RUBS * (mean + _FRICTIONS * std)
    findings = []
    for joint in np.flatnonzero(friction > most).tolist():
        said = (
            f"its friction came out as {friction[joint]:.3g} or more, where at most {most[joint]:.2g} is "
            "plausible: is its torque in N m or N, at the joint?"
        )
        findings.append(Finding("warning", names[joint], said))
    return findings


def check_rotors(
    names: Sequence[str], value: Array, ends: tuple[Array, Array], expected: Array
) -> list[Finding]:
    """Return which rotors are not plausible for a motor: findings, whatever the log says.

    Args:
        names: of the joints.
        value: what was found [kg m^2 or kg], (n,).
        ends: of the 95 % intervals, each (n,).
        expected: what is assumed or specified, (n,).
    """
    findings = []
    for i, name in enumerate(names):
        low, high = float(ends[0][i]), float(ends[1][i])
        assumed = float(expected[i])
        said = (
            f"its rotor came out as {value[i]:.2g} [{low:.2g}, {high:.2g}], where {assumed:.2g} is assumed: "
        )
        if high < LIGHT * assumed:
            said += (
                "not plausible for a motor behind a gear, so the assumed one is kept; specify it by --drives"
            )
            findings.append(Finding("warning", name, said))
        elif low > HEAVY * assumed:
            said += "not plausible for its motor; is it this robot, its torque that at the joint, times in s?"
            findings.append(Finding("warning", name, said))
    return findings


def check_bodies(names: Sequence[str], distances: Array, carrying: int) -> list[Finding]:
    """Return which bodies are far from the file's.

    Args:
        names: of the joints.
        distances: of their bodies from the file's, over what a file may be off, (n,).
        carrying: the joint whose body has the tip and may carry something that the file does not have; joints
            of a gripper come behind it.
    """
    findings = []
    for joint in np.flatnonzero(distances > _UNLIKE).tolist():
        said = "its body came out unlike the file's: is it this robot, with the same zero?"
        if joint == carrying:
            said = "its body came out unlike the file's: does it carry a tool or a payload?"
        findings.append(Finding("warning", names[joint], said))
    return findings


def carrying_joint(robot: Robot) -> int:
    """Return the joint whose body has the tip; joints of a gripper come behind it."""
    tip = robot._model.frames[robot._frame(robot.tip)]
    return int(tip.parentJoint) - 1


def check_robot(names: Sequence[str], distance: float, inertia: Array) -> list[Finding]:
    """Return that the links are those of another robot, where they are.

    Args:
        names: of the joints.
        distance: of the links but the last from the file's, over what is expected, squared and summed; a
            payload is in the last link alone.
        inertia: mean inertia of each joint over that of the file, rotors left out, (n,); NaN where the file
            has next to none.
    """
    if distance <= ANOTHER_ROBOT:
        return []
    positive = np.maximum(inertia, np.finfo(float).tiny)
    worst = int(np.nanargmax(np.abs(np.log(positive))))
    said = (
        f"the torques need links that are unlike the file's: {inertia[worst]:.2g} times the inertia at "
        f"{names[worst]!r}, which no payload explains (distance {distance:.2g}; right files are below "
        f"{ANOTHER_ROBOT:g}): is it another robot, or does the file have invented masses?"
    )
    return [Finding("warning", "", said)]


def _of_motion(robot: Robot, form: WeakForm) -> Iterator[Finding]:
    """Find joints that move too little."""
    for j, name in enumerate(robot.joint_names):
        v = form.velocity[:, j]
        is_fast = np.abs(v) > 0.1 * form.speed[j]
        changes = np.diff(np.sign(v[is_fast]))
        turns = int((changes != 0).sum())
        if form.speed[j] < _LEAST_SPEED:
            yield Finding(
                "error",
                name,
                f"its speed is {form.speed[j]:.2g}, expected {_LEAST_SPEED:g} rad/s or m/s: move it faster, "
                f"or lock it where it is no joint of the arm (--lock {name})",
            )
        elif turns < _TURNS:
            yield Finding(
                "error", name, f"it turns round {turns} times, expected {_TURNS}: move it to and fro"
            )


def _of_torques(robot: Robot, gravity: bool, prior: Prior, form: WeakForm) -> Iterator[Finding]:
    """Find torques that are not those of their joint: swapped, reversed, without weight, in another unit."""
    n = robot.n
    bare = is_supposed(robot)  # of a bare arm the terms say less
    terms = terms_of(prior, form, n)
    torque, _ = form.torque(np.zeros(n))
    match = match_motions(terms, torque)
    order = find_order(match)
    swapped = np.flatnonzero(order != np.arange(n))
    if len(swapped):
        yield _describe_order(robot.joint_names, swapped, order)
    most = _most(prior, terms)
    carrying = carrying_joint(robot)
    for i in np.setdiff1d(np.arange(n), swapped):
        name = robot.joint_names[i]
        if said := _misfit(robot, i, terms[:, i], torque[:, i], form.rows[:, i, i, 1:4], match, bare):
            yield Finding("error", name, said)
            continue
        payload = form.rows[:, i, carrying, :4]
        yield from _of_scale(name, terms[:, i], torque[:, i], float(most[i]), payload, gravity and not bare)


def match_motions(terms: Array, torque: Array) -> Array:
    """Return the share of the torque of each joint i that the terms of each joint j explain, (n, n).

    Args:
        terms: of the joints, (k, n, 5), as :func:`terms_of` has them.
        torque: moments of their torques, (k, n).
    """
    n = torque.shape[1]
    match = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            match[i, j], _ = _explain(terms[:, j], torque[:, i])
    return match


def find_order(match: Array) -> npt.NDArray[np.intp]:
    """Return whose motion each joint's torque fits, if columns are in another order: joint -> joint, (n,).

    Joints are compared with what each one needs by the file, and the order is the one in which all torques
    together are explained best. It is another one than that of the log only where that explains much more.

    Args:
        match: share of the torque of joint i that the terms of joint j explain, (n, n).
    """
    unchanged = np.arange(len(match))
    left = unexplained(match)
    _, order = optimize.linear_sum_assignment(left)
    moved = order != unchanged
    gains = left[unchanged, unchanged] - left[unchanged, order]
    gain = float(np.sum(gains[moved]))
    fits = bool(np.all(match[unchanged, order][moved] >= _EXPLAINED))
    return np.asarray(order if fits and gain > OTHER_ORDER else unchanged, dtype=np.intp)


def unexplained(match: Array) -> Array:
    """Return the logarithm of the share of torques that is unexplained, for shares that are explained."""
    return np.asarray(np.log(np.maximum(1.0 - match, _NOTHING_LEFT)))


def _describe_order(
    names: Sequence[str], swapped: npt.NDArray[np.intp], order: npt.NDArray[np.intp]
) -> Finding:
    """Return the finding that the columns of some joints are in another order."""
    first = names[swapped[0]]
    if len(swapped) == 2:
        other = names[swapped[1]]
        said = f"the torque of {first!r} fits the motion of {other!r}, and that of {other!r} the motion of "
        said += f"{first!r}: the columns of these two are swapped, of torques or of positions"
        return Finding("error", "", said)
    pairs = ", ".join(f"{names[i]!r} that of {names[order[i]]!r}" for i in swapped)
    said = f"torques fit the motion of other joints, {pairs}: their columns are in another order, of torques "
    return Finding("error", "", f"{said}or of positions")


def _misfit(
    robot: Robot, joint: int, terms: Array, torque: Array, weight: Array, match: Array, bare: bool
) -> str:
    """Return why a joint's torque is not its own, or nothing.

    Args:
        robot: the arm.
        joint: which joint.
        terms: what explains its torque, (k, 5), as :func:`terms_of` has them.
        torque: (k,).
        weight: moments of the weight of a load that nothing is known of, (k, 3).
        match: share of the torque of joint i that the terms of joint j explain, (n, n).
        bare: whether the file has no masses.
    """
    own = match[joint, joint]
    best = int(match[joint].argmax())
    if own >= _EXPLAINED:
        return ""
    reverse, _ = _explain(terms, -torque)
    loaded, _ = _explain(np.hstack([terms, weight, -weight]), torque)
    if reverse > own + _BETTER and reverse >= match[joint, best] and reverse > loaded:
        return f"its torque has the reversed sign: -tau explains {reverse:.0%}"
    if not bare and match[joint, best] > max(own + _BETTER, match[best, best]):
        return f"its torque fits the motion of {robot.joint_names[best]!r}: check the joints' order"
    if loaded >= _EXPLAINED:
        return ""
    return (
        f"{own:.0%} of its torque follow from its motion, expected {_EXPLAINED:.0%}: is it this robot, with "
        "commanded torques of the same time, order and sign?"
    )


def terms_of(prior: Prior, form: WeakForm, n: int) -> Array:
    """Return what a joint's terms explain: body, rotor, both frictions, offset; shape (k, n, 5)."""
    mean = prior.mean.reshape(n, len(COLUMNS))
    j = np.arange(n)
    rows = form.rows
    body = np.einsum("kijp,jp->ki", rows[..., : len(BODY)], mean[:, : len(BODY)])
    signs = form.signs(np.full(n, _WIDTH))
    rotor = rows[:, j, j, ROTOR] * mean[:, ROTOR]
    viscous, offset = rows[:, j, j, VISCOUS], rows[:, j, j, OFFSET]
    return np.stack([body, rotor, signs, viscous, offset], axis=-1)


def _explain(terms: Array, torque: Array) -> tuple[float, Array]:
    """Return the share of a torque's variation that terms with their signs explain, and their factors."""
    around = torque - torque.mean()
    centred = terms - terms.mean(axis=0)
    squares = (centred**2).sum(axis=0)
    sizes = np.maximum(np.sqrt(squares), 1e-300)
    total = float(around @ around)
    if total == 0.0:
        return 0.0, np.zeros(terms.shape[1])
    factors, remaining = optimize.nnls(centred / sizes, around)
    return 1.0 - remaining**2 / total, factors / sizes


def _of_scale(
    name: str, terms: Array, torque: Array, most: float, payload: Array, gravity: bool
) -> Iterator[Finding]:
    """Find a torque without the arm's weight, or in another unit.

    Args:
        name: of the joint.
        terms: what explains its torque, (k, 5), as :func:`terms_of` has them.
        torque: (k,).
        most: root mean square of the torque that an arm with rotors and friction takes at most.
        payload: moments of the mass and of the first moments of a load on the last link, (k, 4).
        gravity: whether it carries the arm's weight.
    """
    size = _rms(torque)
    body, rotor = terms[:, 0], terms[:, 1]
    least = min(_rms(body), _rms(body + rotor))  # where rotors are not in the torque
    if size > _TOO_LARGE * most or size * _TOO_SMALL < least:
        ratio, what = (size / most, "an arm with rotors and friction takes at most")
        if size * _TOO_SMALL < least:
            ratio, what = size / least, "the file expects"
        said = f"its torque is {ratio:.2g} times what {what}: in N m or N, at the joint, times in s?"
        yield Finding("error", name, said)
        return
    if not gravity or np.var(body) < _WEIGHS * np.var(torque):
        return
    own, factors = _explain(terms, torque)
    if factors[0] >= _WEIGHT:
        return
    with_payload = np.hstack([terms, payload, -payload[:, 1:]])
    loaded, _ = _explain(with_payload, torque)
    gain = float(unexplained(np.array(own)) - unexplained(np.array(loaded)))
    if gain > OTHER_ORDER:
        said = (
            "its gravity torque is not that of the URDF's masses: a payload on the last link has this effect"
        )
        yield Finding("warning", name, said)
    else:
        yield Finding(
            "error",
            name,
            "its torque does not contain the gravity torque of the URDF's masses: if the arm compensates "
            "gravity itself, specify it (--no-gravity, gravity=False); else is it this robot, with the same "
            "zero, and are its times those of the samples, in s?",
        )


def _most(prior: Prior, terms: Array) -> Array:
    """Return the root mean square of the torque that each joint takes at most, rotor and friction, (n,)."""
    n = terms.shape[1]
    mean, std = prior.mean.reshape(n, -1), prior.std.reshape(n, -1)
    most = mean + _FRICTIONS * std
    body, rotor, sign, viscous, offset = _rms(terms).T
    friction = most[:, COULOMB] * sign + most[:, VISCOUS] * viscous + most[:, OFFSET] * offset
    return np.asarray(_BODIES * body + _ROTORS * rotor + friction)


def _rms(values: Array) -> Any:
    """Return root mean squares over the first axis."""
    return np.sqrt((values**2).mean(axis=0))
