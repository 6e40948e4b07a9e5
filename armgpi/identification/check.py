"""What has to be true of a log before a fit of it can mean anything."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import optimize

from armgpi.arrays import Array
from armgpi.errors import UnfitLog
from armgpi.identification.estimate import Prior, is_supposed
from armgpi.identification.logs import Grid
from armgpi.identification.weak_form import BODY, COLUMNS, MOST_LAG, OFFSET, ROTOR, VISCOUS, WeakForm
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
#: By how much positions may be outside their limits [rad or m], and how far beyond them they are degrees.
_OUTSIDE, _DEGREES = 0.05, 3.0
#: Share of the weight that the torques have to carry, where weight is so much of the expected torque.
_WEIGHT, _WEIGHS = 0.3, 0.3
#: Torque over what the file expects, either way, beyond which its unit is another one.
_SCALE = 30.0
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
            said = f"its rotor is {rotor:.2g} times what is believed: are times in s, torques at the joint?"
            found.append(Finding("error", name, said))
        if share > _UNEXPLAINED:
            said = f"no arm of this kind explains {share:.0%} of its torque: is it this robot, in this order?"
            found.append(Finding("error", name, said))
    return found


def check_bodies(names: Sequence[str], distances: Array) -> list[Finding]:
    """Return which bodies are far from the file's, for distances over what a file may be off, (n,)."""
    said = "its body came out unlike the file's: is it this robot, with the same zero?"
    return [Finding("warning", name, said) for name, x in zip(names, distances, strict=True) if x > _UNLIKE]


def _of_samples(robot: Robot, grid: Grid) -> Iterator[Finding]:
    """Find what the samples alone show."""
    length = len(grid.q) * grid.dt
    if grid.dt > _SLOWEST:
        yield Finding("error", "", f"sampled at {1.0 / grid.dt:.3g} Hz, expected at least 40 Hz: log faster")
    if length < _SHORTEST:
        yield Finding("error", "", f"is {length:.2g} s long, expected at least {_SHORTEST:g} s: log longer")
    lower, upper, _, effort = robot.limits
    for j, name in enumerate(robot.joint_names):
        q = grid.q[:, j]
        beyond = float(max(np.max(lower[j] - q), np.max(q - upper[j])))
        if beyond > _DEGREES:
            unit = "m, not mm" if robot.prismatic[j] else "rad, not degrees or counts"
            yield Finding("error", name, f"moves {beyond:.3g} beyond its limits; positions are in {unit}")
        elif beyond > _OUTSIDE:
            yield Finding("warning", name, f"is {beyond:.3g} outside its limits: is it the same zero?")
        yield from _of_effort(name, np.abs(grid.tau[:, j]), float(effort[j]))


def _of_effort(name: str, sizes: Array, effort: float) -> Iterator[Finding]:
    """Find torques above a joint's limit, clipped ones and none, from their sizes."""
    clipped = float(np.mean(sizes >= 0.999 * effort)) if np.isfinite(effort) else 0.0
    largest = sizes.max()
    if largest == 0.0:
        yield Finding("error", name, "its torque is zero throughout: log commanded torques")
        return
    share = max(clipped, float(np.mean(sizes >= 0.9999 * largest)))
    if largest > _TOO_MUCH * effort:
        said = f"its torque is {largest:.3g}, and its limit {effort:.3g}: in N m or N, at the joint?"
        yield Finding("error", name, said)
    elif share > _CLIPPED:
        said = f"its torque is clipped at {largest:.3g} in {100.0 * share:.2g} % of the log: move slower"
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
        yield from _of_scale(name, terms[:, i], torque[:, i], gravity and not bare)


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


def _of_scale(name: str, terms: Array, torque: Array, gravity: bool) -> Iterator[Finding]:
    """Find a torque without the arm's weight, or in another unit."""
    expected = terms[:, 0] + terms[:, 1]
    ratio = float(np.sqrt((torque**2).mean() / max((expected**2).mean(), 1e-300)))
    if not 1.0 / _SCALE < ratio < _SCALE:
        yield Finding(
            "error",
            name,
            f"its torque is {ratio:.2g} times what the file expects: in N m or N, at the joint, times in s?",
        )
        return
    if not gravity or np.var(terms[:, 0]) < _WEIGHS * np.var(torque):
        return
    _, factors = _explain(terms, torque)
    if factors[0] < _WEIGHT:
        yield Finding(
            "error",
            name,
            "its torque does not carry the weight that the file has: where the arm adds that itself, say so "
            "(--no-gravity, gravity=False); else is it this robot, with the same zero?",
        )
