"""What has to be true of a log before a fit of it can mean anything."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from armgpi.base.arrays import Array
from armgpi.errors import UnfitLog
from armgpi.identification.estimate import Prior, is_supposed
from armgpi.identification.logs import Grid
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

#: Longest sample time [s] and shortest log [s].
_SLOWEST, _SHORTEST = 0.025, 3.0
#: Least speed of a joint [rad/s or m/s]: ten times that at which the sign of velocity is noise.
_LEAST_SPEED = 0.04
#: Fewest turns of a joint's motion.
_TURNS = 2
#: Least share of a joint's torque that its own terms, each with its sign, have to explain; and how much more
#: the terms of another joint or the reversed torque may explain before it is taken for that one's.
_EXPLAINED, _BETTER = 0.5, 0.25
#: Share of samples at the limit of torque beyond which it is clipped; torque over its limit that cannot be.
_CLIPPED, _TOO_MUCH = 0.05, 2.0
#: Torque over its limit that is above it: limits of files are rounded.
_ABOVE = 1.01
#: Sample time from which times are likely ms [s].
_NO_RATE = 0.5
#: A position stays at one value if for so long [s]; it came there at speed if with so much of its usual one
#: over so long before [s]; share of the log from which that is a sensor that saturates.
_STAYS, _AT_SPEED, _BEFORE, _SATURATED = 0.05, 0.3, 0.02, 0.01
#: Least samples of that time, and how many usual steps of two samples are no speed yet.
_BEFORE_SAMPLES, _JUMPS = 10, 2.0
#: Different values of a torque from which its resolution is fine.
_MANY = 200
#: Share of its range that is close to an end, and how many times as long a saturated one is at the end.
_NEAR, _LONGER = 2.0 / _MANY, 3.0
#: By how much positions may be outside their limits [rad or m], and how far beyond them they are degrees.
_OUTSIDE, _DEGREES = 0.05, 3.0
#: Share of the weight that the torques have to carry, where weight is so much of the expected torque.
_WEIGHT, _WEIGHS = 0.3, 0.3
#: What the file expects over a torque, and a torque over the most that an arm with rotors and friction may
#: take, from which its unit is another one: the latter allows for bodies, rotors and friction so far from
#: what is assumed, in parts of the file's, parts of the assumed rotor, and standard deviations.
_TOO_SMALL, _TOO_LARGE = 30.0, 10.0
_BODIES, _ROTORS, _FRICTIONS = 1.5, 4.0, 2.0
#: Coulomb friction that was found, over that allowance, from which its torque has another unit.
_RUBS = 2.0
#: A found rotor over the expected one that is not plausible for a motor: none of those published is outside.
LIGHT, HEAVY = 0.15, 4.0
#: Residual over torque of a joint beyond which the fit is of another arm.
_UNEXPLAINED = 0.5
#: Rotor over the expected one from which something else is wrong: none of those published is above four.
_HEAVY = 10.0
#: Distance of a body from the file's, over what is expected, from which that is said.
_UNLIKE = 1.5
#: Width of the sign in the check [rad/s or m/s].
_WIDTH = 5e-3


class Finding(NamedTuple):
    """A remark of the check.

    Attributes:
        severity: "error" or "warning".
        joint: of which joint; empty for the log.
        message: what was seen, what was expected and what to do.
    """

    severity: str
    joint: str
    message: str

    def __str__(self) -> str:
        """Return it in one line."""
        return f"{self.joint}: {self.message}" if self.joint else self.message


def refuse(findings: Sequence[Finding]) -> None:
    """Refuse logs with an error.

    Raises:
        UnfitLog: with all of them.
    """
    errors = [str(each) for each in findings if each.severity == "error"]
    if errors:
        raise UnfitLog(errors)


def check(
    robot: Robot, gravity: bool, prior: Prior, source: str, grid: Grid, form: WeakForm
) -> list[Finding]:
    """Return what is wrong with a log, or weak: rate, length, units, speed, turns, order and sign."""
    found = list(_of_samples(robot, grid))
    if not any(each.severity == "error" for each in found) and len(form.starts):
        found += _of_motion(robot, form)
        found += _of_torques(robot, gravity, prior, form)
    return [each._replace(message=f"{each.message} ({source})") for each in found]


def check_fit(names: Sequence[str], lag: Array, residuals: Array, rotors: Array) -> list[Finding]:
    """Return what only the fit shows: torques of another time, or of another arm.

    Args:
        names: of the joints.
        lag: of positions behind torques [s], (n,).
        residuals: residual over torque of each joint, (n,); NaN of one that did not move.
        rotors: lower ends of their intervals over what is expected, (n,).
    """
    found = []
    if np.abs(lag).max() > MOST_LAG:
        said = f"positions and torques are more than {1e3 * MOST_LAG:g} ms apart: give both the same clock"
        found.append(Finding("error", "", said))
    for name, share, rotor in zip(names, residuals, rotors, strict=True):
        if rotor > _HEAVY:
            said = f"its rotor is {rotor:.2g} times the assumed one: are times in s, torques at the joint?"
            found.append(Finding("error", name, said))
        if share > _UNEXPLAINED:
            said = f"no arm of this kind explains {share:.0%} of its torque: is it this robot, in this order?"
            found.append(Finding("error", name, said))
    return found


def check_friction(names: Sequence[str], prior: Prior, friction: Array) -> list[Finding]:
    """Return which friction is more than an arm has: the check before the fit, once more after it.

    Args:
        names: of the joints.
        prior: what was expected of an arm.
        friction: lower ends of the intervals of Coulomb friction [N m or N], (n,).
    """
    mean, std = (each.reshape(len(names), -1)[:, COULOMB] for each in (prior.mean, prior.std))
    most = _RUBS * (mean + _FRICTIONS * std)
    return [
        Finding(
            "warning",
            name,
            f"its friction came out as {x:.3g} or more, where at most {limit:.2g} is plausible: is its "
            "torque in N m or N, at the joint?",
        )
        for name, x, limit in zip(names, friction, most, strict=True)
        if x > limit
    ]


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
    found = []
    for i, name in enumerate(names):
        low, high, assumed = float(ends[0][i]), float(ends[1][i]), float(expected[i])
        said = (
            f"its rotor came out as {value[i]:.2g} [{low:.2g}, {high:.2g}], where {assumed:.2g} is assumed: "
        )
        if high < LIGHT * assumed:
            said += (
                "not plausible for a motor behind a gear, so the assumed one is kept; --drives FILE says more"
            )
            found.append(Finding("warning", name, said))
        elif low > HEAVY * assumed:
            said += "not plausible for its motor; is it this robot, its torque that at the joint, times in s?"
            found.append(Finding("warning", name, said))
    return found


def check_bodies(names: Sequence[str], distances: Array) -> list[Finding]:
    """Return which bodies are far from the file's, for distances over what a file may be off, (n,)."""
    said = "its body came out unlike the file's: is it this robot, with the same zero?"
    return [Finding("warning", name, said) for name, x in zip(names, distances, strict=True) if x > _UNLIKE]


def _of_samples(robot: Robot, grid: Grid) -> Iterator[Finding]:
    """Find what the samples alone show."""
    length = len(grid.q) * grid.dt
    if grid.dt > _SLOWEST:
        said = f"sampled at {1.0 / grid.dt:.3g} Hz, expected at least 40 Hz: log faster"
        if grid.dt > _NO_RATE:
            said += "; or are its times in ms? Then call the column 'time [ms]'"
        yield Finding("error", "", said)
    if length < _SHORTEST:
        yield Finding("error", "", f"is {length:.2g} s long, expected at least {_SHORTEST:g} s: log longer")
    if grid.bad.any():
        yield Finding("warning", "", _describe_gaps(grid))
    lower, upper, _, effort = robot.limits
    for j, name in enumerate(robot.joint_names):
        q = grid.q[:, j]
        beyond = float(max(np.max(lower[j] - q), np.max(q - upper[j])))
        if beyond > _DEGREES:
            unit = "m, not mm" if robot.prismatic[j] else "rad, not degrees or counts"
            yield Finding("error", name, f"moves {beyond:.3g} beyond its limits; positions are in {unit}")
        elif beyond > _OUTSIDE:
            yield Finding("warning", name, f"is {beyond:.3g} outside its limits: is it the same zero?")
        tau, limit = grid.tau[:, j], float(effort[j])
        yield from list(_of_sensor(name, tau, limit)) or _of_effort(name, np.abs(tau), limit)
        yield from _of_range(name, q, grid.dt)


def _describe_gaps(grid: Grid) -> str:
    """Return where samples are missing, and what becomes of these parts."""
    edges = np.diff(np.concatenate([[0], grid.bad.astype(int), [0]]))
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    lengths, longest = grid.dt * (ends - begins), int(np.argmax(ends - begins))
    gaps = "1 gap" if len(begins) == 1 else f"{len(begins)} gaps"
    return (
        f"samples are missing in {gaps}, {lengths.sum():.2g} s in all, the longest {lengths[longest]:.2g} s "
        f"at {grid.dt * begins[longest]:.3g} s: what is around them is left out; log without losses"
    )


def _of_effort(name: str, sizes: Array, effort: float) -> Iterator[Finding]:
    """Find torques above a joint's limit, clipped ones and none, from their sizes."""
    clipped = float(np.mean(sizes >= 0.999 * effort)) if np.isfinite(effort) else 0.0
    largest = float(sizes.max())
    above = float(np.mean(sizes > _ABOVE * effort))
    if largest == 0.0:
        yield Finding("error", name, "its torque is zero throughout: log commanded torques")
        return
    share = max(clipped, float(np.mean(sizes >= 0.9999 * largest)))
    if largest > _TOO_MUCH * effort:
        said = f"its torque is {largest:.3g}, and its limit {effort:.3g}: in N m or N, at the joint?"
        yield Finding("error", name, said)
    elif above > _CLIPPED:
        said = f"its torque is above its limit of {effort:.3g} in {100.0 * above:.2g} % of the log, at most "
        said += f"{largest:.3g}: is it this robot, with torques in N m or N at the joint?"
        yield Finding("error", name, said)
    elif share > _CLIPPED:
        said = f"its torque is clipped at {largest:.3g} in {100.0 * share:.2g} % of the log: move slower"
        yield Finding("error", name, said)


def _of_sensor(name: str, tau: Array, effort: float) -> Iterator[Finding]:
    """Find a torque that ends at one value below its limit, as a saturated sensor's does, or has only one."""
    if tau[0] != 0.0 and np.ptp(tau) == 0.0:
        yield Finding("error", name, f"its torque is {tau[0]:.3g} throughout: is it the right column?")
    if len(np.unique(tau)) < _MANY:  # of a coarse sensor, or a constant
        return
    for end in (float(tau.min()), float(tau.max())):
        share = float(np.mean(tau == end))
        # A coarse sensor stays at a peak as well, but not three times as long as close to it.
        near = float(np.mean(np.abs(tau - end) <= _NEAR * np.ptp(tau))) - share
        if share > max(_SATURATED, _LONGER * near) and abs(end) < effort / _ABOVE:
            said = (
                f"its torque stays at exactly {end:.3g} in {100.0 * share:.2g} % of the log, below its limit "
            )
            said += f"of {effort:.3g}: its sensor saturates; move slower"
            yield Finding("error", name, said)


def _of_range(name: str, q: Array, dt: float) -> Iterator[Finding]:
    """Find a position that stops at its largest or smallest value at speed, as a saturated sensor's does.

    A joint that comes to rest there brakes before.
    """
    velocity = np.gradient(q, dt)
    usual = float(np.sqrt(np.mean(velocity**2)))
    back = max(_BEFORE_SAMPLES, round(_BEFORE / dt))
    # A turn jumps by a count or two of a coarse encoder before it stays. Resampled jumps take two samples.
    steps = np.abs(q[2:] - q[:-2])
    jumps = _JUMPS * float(np.median(steps[steps > 0.0])) if steps.any() else 0.0
    for end in (q.min(), q.max()):
        edges = np.diff(np.concatenate([[0], (q == end).astype(int), [0]]))
        begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
        long = (ends - begins) * dt > _STAYS
        begins, lengths = begins[long & (begins >= back)], (ends - begins)[long & (begins >= back)]
        fast = np.abs(q[begins] - q[begins - back]) > _AT_SPEED * usual * back * dt + jumps
        if fast.any() and lengths[fast].sum() > _SATURATED * len(q):
            said = f"its position stops at {end:.3g} at speed and stays there in "
            said += (
                f"{100.0 * lengths[fast].sum() / len(q):.2g} % of the log: its sensor saturates; move it less"
            )
            yield Finding("error", name, said)


def _of_motion(robot: Robot, form: WeakForm) -> Iterator[Finding]:
    """Find joints that move too little."""
    for j, name in enumerate(robot.joint_names):
        v = form.velocity[:, j]
        fast = v[np.abs(v) > 0.1 * form.speed[j]]
        turns = int((np.diff(np.sign(fast)) != 0).sum())
        if form.speed[j] < _LEAST_SPEED:
            yield Finding(
                "error",
                name,
                f"its speed is {form.speed[j]:.2g}, expected {_LEAST_SPEED:g} rad/s or m/s: move it faster, "
                f"or lock it where it is no joint of the arm (--lock {name})",
            )
        elif turns < _TURNS:
            yield Finding("error", name, f"turns round {turns} times, expected {_TURNS}: move it to and fro")


def _of_torques(robot: Robot, gravity: bool, prior: Prior, form: WeakForm) -> Iterator[Finding]:
    """Find torques that are not those of their joint: swapped, reversed, without weight, in another unit."""
    n, bare = robot.n, is_supposed(robot)  # of a bare arm the terms say less
    terms = _terms(prior, form, n)
    torque, _ = form.torque(np.zeros(n))
    match = np.array([[_explain(terms[:, j], torque[:, i])[0] for j in range(n)] for i in range(n)])
    most = _most(prior, terms)
    for i, name in enumerate(robot.joint_names):
        own, best = match[i, i], int(match[i].argmax())
        reverse, _ = _explain(terms[:, i], -torque[:, i])
        weight = form.rows[:, i, i, 1:4]  # of an unknown load
        said = ""
        if own >= _EXPLAINED:
            pass
        elif reverse > own + _BETTER and reverse >= match[i, best]:
            said = f"its torque has the reversed sign: -tau explains {reverse:.0%}"
        elif not bare and match[i, best] > max(own + _BETTER, match[best, best]):
            said = f"its torque fits the motion of {robot.joint_names[best]!r}: check the joints' order"
        elif _explain(np.hstack([terms[:, i], weight, -weight]), torque[:, i])[0] < _EXPLAINED:
            said = f"{own:.0%} of its torque follow from its motion, expected {_EXPLAINED:.0%}: is it this "
            said += "robot, with commanded torques of the same time, order and sign?"
        if said:
            yield Finding("error", name, said)
        yield from _of_scale(name, terms[:, i], torque[:, i], float(most[i]), gravity and not bare)


def _terms(prior: Prior, form: WeakForm, n: int) -> Array:
    """Return what a joint's terms explain: body, rotor, both frictions, offset; shape (k, n, 5)."""
    mean = prior.mean.reshape(n, len(COLUMNS))
    j = np.arange(n)
    rows = form.rows
    body = np.einsum("kijp,jp->ki", rows[..., : len(BODY)], mean[:, : len(BODY)])
    signs = form.signs(np.full(n, _WIDTH))
    own = [rows[:, j, j, ROTOR] * mean[:, ROTOR], signs, rows[:, j, j, VISCOUS], rows[:, j, j, OFFSET]]
    return np.stack([body, *own], axis=-1)


def _explain(terms: Array, torque: Array) -> tuple[float, Array]:
    """Return the share of a torque's variation that terms with their signs explain, and their factors."""
    around, centred = torque - torque.mean(), terms - terms.mean(axis=0)
    sizes = np.maximum(np.sqrt((centred**2).sum(axis=0)), 1e-300)
    total = float(around @ around)
    if total == 0.0:
        return 0.0, np.zeros(terms.shape[1])
    factors, rest = optimize.nnls(centred / sizes, around)
    return 1.0 - rest**2 / total, factors / sizes


def _of_scale(name: str, terms: Array, torque: Array, most: float, gravity: bool) -> Iterator[Finding]:
    """Find a torque without the arm's weight, or in another unit.

    Args:
        name: of the joint.
        terms: what explains its torque, (k, 5), as :func:`_terms` has them.
        torque: (k,).
        most: root mean square of the torque that an arm with rotors and friction takes at most.
        gravity: whether it carries the arm's weight.
    """
    size = _rms(torque)
    least = min(_rms(terms[:, 0]), _rms(terms[:, 0] + terms[:, 1]))  # where rotors are not in the torque
    if size > _TOO_LARGE * most or size * _TOO_SMALL < least:
        ratio, what = (size / most, "an arm with rotors and friction takes at most")
        if size * _TOO_SMALL < least:
            ratio, what = size / least, "the file expects"
        said = f"its torque is {ratio:.2g} times what {what}: in N m or N, at the joint, times in s?"
        yield Finding("error", name, said)
        return
    if not gravity or np.var(terms[:, 0]) < _WEIGHS * np.var(torque):
        return
    _, factors = _explain(terms, torque)
    if factors[0] < _WEIGHT:
        yield Finding(
            "error",
            name,
            "its torque does not carry the weight that the file has: where the arm adds that itself, say so "
            "(--no-gravity, gravity=False); else is it this robot, with its joints in this order, and the "
            "same zero?",
        )


def _most(prior: Prior, terms: Array) -> Array:
    """Return the root mean square of the torque that each joint takes at most, rotor and friction, (n,)."""
    n = terms.shape[1]
    mean, std = (each.reshape(n, len(COLUMNS)) for each in (prior.mean, prior.std))
    body, rotor, sign, viscous, offset = (_rms(terms[..., k]) for k in range(terms.shape[-1]))
    friction = [
        (mean[:, k] + _FRICTIONS * std[:, k]) * size
        for k, size in ((COULOMB, sign), (VISCOUS, viscous), (OFFSET, offset))
    ]
    return np.asarray(_BODIES * body + _ROTORS * rotor + np.sum(friction, axis=0))


def _rms(values: Array) -> Any:
    """Return root mean squares over the first axis."""
    return np.sqrt((values**2).mean(axis=0))
