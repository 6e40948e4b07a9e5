"""What the samples of a log show before anything is computed of the arm: rate, gaps, units, sensors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.identification.logs import Grid, Log
from armgpi.robot.robot import Robot

#: Longest sample time [s].
_SLOWEST = 0.025
#: Sample time from which times are likely in ms [s].
_NO_RATE = 0.5
#: Shortest log [s].
_SHORTEST = 3.0
#: By how much positions may be outside their limits [rad or m].
_OUTSIDE = 0.05
#: How far beyond their limits positions are in degrees [rad or m].
_DEGREES = 3.0
#: Share of samples at the limit of torque beyond which it is clipped.
_CLIPPED = 0.05
#: Torque over its limit that cannot be.
_TOO_MUCH = 2.0
#: Torque over its limit that is above it: limits of files are rounded.
_ABOVE = 1.01
#: Share of the log from which a sensor that stays at its largest or smallest value saturates.
_SATURATED = 0.01
#: Different values of a torque from which its resolution is fine.
_MANY = 200
#: Share of its range that is close to an end.
_NEAR = 2.0 / _MANY
#: How many times as long as close to an end a saturated torque is at it.
_LONGER = 3.0
#: Fewest changes of a position that show how often it is read.
_FEWEST_UPDATES = 20
#: Time for which a position that saturates stays at one value [s].
_STAYS = 0.05
#: Changes of a position from which the speed is taken at which it comes to an end.
_CHANGES = 8
#: Share of a joint's range beyond which that many changes are too much of a motion to show how it ends.
_WHOLE = 0.25
#: Counts by which a joint would have turned beyond the value at which its sensor ends. One that turns there
#: by itself would have turned by one count at most; the other one is for the error of the speed.
_BEYOND = 2.0


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


def check_samples(robot: Robot, log: Log, grid: Grid) -> Iterator[Finding]:
    """Find what the samples alone show.

    Args:
        robot: the arm as its file has it.
        log: as it was recorded: sensors that saturate repeat a value exactly, which interpolation hides.
        grid: the same at uniform times.
    """
    length = len(grid.q) * grid.dt
    if grid.dt > _SLOWEST:
        said = f"it is sampled at {1.0 / grid.dt:.3g} Hz, expected at least 40 Hz: log faster"
        if grid.dt > _NO_RATE:
            said += "; or are its times in ms? Then call the column 'time [ms]'"
        yield Finding("error", "", said)
    if length < _SHORTEST:
        said = f"it is {length:.2g} s long, expected at least {_SHORTEST:g} s: log longer"
        yield Finding("error", "", said)
    if grid.bad.any():
        yield Finding("warning", "", _describe_gaps(grid))
    for j, name in enumerate(robot.joint_names):
        yield from _check_position(robot, j, name, log)
        yield from _check_torque(name, log.tau[:, j], float(robot.limits.effort[j]))


def _describe_gaps(grid: Grid) -> str:
    """Return where samples are missing, and what becomes of these parts."""
    begins, ends = _runs(grid.bad)
    lengths = grid.dt * (ends - begins)
    longest = int(np.argmax(ends - begins))
    gaps = "1 gap" if len(begins) == 1 else f"{len(begins)} gaps"
    return (
        f"samples are missing in {gaps}, {lengths.sum():.2g} s in all, the longest {lengths[longest]:.2g} s "
        f"at {grid.dt * begins[longest]:.3g} s: what is around them is left out; log without losses"
    )


def _runs(flags: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the first index of each run of true values, and the index after its last one."""
    padded = np.concatenate([[0], flags.astype(int), [0]])
    edges = np.diff(padded)
    return np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)


def _check_position(robot: Robot, joint: int, name: str, log: Log) -> Iterator[Finding]:
    """Find positions in another unit or of another zero, a constant one, and a sensor that saturates."""
    q = log.q[:, joint]
    if np.ptp(q) == 0.0:
        said = f"its position is {q[0]:.3g} throughout: is it the right column? Else move the joint, or lock "
        yield Finding("error", name, f"{said}it where it is no joint of the arm (--lock {name})")
        return
    lower = float(robot.limits.lower[joint])
    upper = float(robot.limits.upper[joint])
    beyond = float(max(np.max(lower - q), np.max(q - upper)))
    if beyond > _DEGREES:
        unit = "m, not mm" if robot.prismatic[joint] else "rad, not degrees or counts"
        yield Finding("error", name, f"it moves {beyond:.3g} beyond its limits; positions are in {unit}")
    elif beyond > _OUTSIDE:
        yield Finding("warning", name, f"it is {beyond:.3g} outside its limits: is it the same zero?")
    yield from _check_updates(name, log, q)
    for end, share in _saturated_shares(log.t, q).items():
        if share > _SATURATED:
            said = f"its position stops at {end:.3g} at speed and stays there in {100.0 * share:.2g} % of "
            said += "the log: its sensor saturates, or it runs against its stop; move it less"
            yield Finding("error", name, said)


def _check_updates(name: str, log: Log, q: Array) -> Iterator[Finding]:
    """Find a position that is new every few samples only, as one that is read more slowly than it is logged.

    Args:
        name: of the joint.
        log: with its position.
        q: that position [rad or m], not all of it equal, (k,).
    """
    changes = np.flatnonzero(np.diff(q))
    if len(changes) < _FEWEST_UPDATES:
        return
    every = int(np.gcd.reduce(np.diff(changes)))
    period = every * float(np.median(np.diff(log.t)))
    if every > 1:
        said = (
            f"its position is a new one every {every} samples only, each {period:.3g} s: read it as often as "
        )
        severity = "error" if period > _SLOWEST else "warning"
        yield Finding(severity, name, f"{said}the torque, at {1.0 / _SLOWEST:g} Hz or more")


def _saturated_shares(t: Array, q: Array) -> dict[float, float]:
    """Return the share of a log in which a position stays at each end that it came to and left at speed.

    A joint that turns there by itself, or comes to rest, brakes before: from the boundary of the last count
    on it goes on by no more than that count. One whose sensor saturates would have gone on by many, and is
    back at speed: of a stay that lasts until the log ends that is not seen, and nothing is said. Where the
    joint stops as abruptly between the ends as well, its counts are too coarse to show how it brakes, and
    nothing is said of the ends.

    Args:
        t: times [s], (k,).
        q: positions [rad or m], not all of them equal, (k,).

    Returns:
        Smallest and largest position -> share.
    """
    steps = np.diff(q)
    changes = np.flatnonzero(steps)  # between this sample and the next one
    count = float(np.median(np.abs(steps[changes])))
    middles = 0.5 * (t[changes] + t[changes + 1])
    values = 0.5 * (q[changes] + q[changes + 1])
    ends = np.append(changes[1:], len(t) - 1)
    durations = t[ends] - t[changes + 1]
    stayed = {float(q.min()): 0.0, float(q.max()): 0.0}
    for i in np.flatnonzero(durations >= _STAYS):
        if i + 1 < _CHANGES or len(changes) < i + 1 + _CHANGES:
            continue
        before = slice(i + 1 - _CHANGES, i + 1)
        after = slice(i + 1, i + 1 + _CHANGES)
        came = _overshoot(middles[before], values[before], durations[i])
        leaves = _overshoot(-middles[after][::-1], values[after][::-1], durations[i])
        moved = max(np.ptp(values[before]), np.ptp(values[after]))
        is_shown = moved <= _WHOLE * np.ptp(q)
        if not is_shown or min(came, leaves) <= _BEYOND * count:
            continue
        place = float(q[changes[i] + 1])
        if place not in stayed:
            return dict.fromkeys(stayed, 0.0)
        stayed[place] += float(durations[i] / (t[-1] - t[0]))
    return stayed


def _overshoot(t: Array, q: Array, duration: float) -> float:
    """Return by how much a joint would have gone on that comes to a value and stays there [rad or m].

    Args:
        t: times of the last changes of its position [s], (k,).
        q: positions then [rad or m], (k,).
        duration: for which it stays [s].
    """
    half_acceleration, speed, _ = np.polyfit(t - t[-1], q, 2)
    acceleration = 2.0 * half_acceleration
    if speed * (q[-1] - q[0]) <= 0.0:  # at rest before already, which a parabola does not follow
        return 0.0
    # A parabola that is back after that time has its vertex in the middle.
    highest = 0.25 * abs(speed) * duration
    if acceleration * speed < 0.0:  # it brakes
        highest = min(highest, 0.5 * speed**2 / abs(acceleration))
    return float(highest)


def _check_torque(name: str, tau: Array, effort: float) -> Iterator[Finding]:
    """Find a constant torque, one above the joint's limit, and one that is clipped or saturates.

    Args:
        name: of the joint.
        tau: its torque [N m or N], (k,).
        effort: its limit [N m or N]; infinite for none.
    """
    if np.ptp(tau) == 0.0:
        wanted = "is it the right column?" if tau[0] else "log commanded torques"
        size = f"{tau[0]:.3g}" if tau[0] else "zero"
        yield Finding("error", name, f"its torque is {size} throughout: {wanted}")
        return
    saturated = list(_check_torque_sensor(name, tau, effort))
    yield from saturated or _check_effort(name, np.abs(tau), effort)


def _check_torque_sensor(name: str, tau: Array, effort: float) -> Iterator[Finding]:
    """Find a torque that ends at one value below its limit, as that of a saturated sensor does."""
    if len(np.unique(tau)) < _MANY:  # of a coarse sensor
        return
    for end in (float(tau.min()), float(tau.max())):
        share = float(np.mean(tau == end))
        # A coarse sensor stays at a peak as well, but not three times as long as close to it.
        is_near = np.abs(tau - end) <= _NEAR * np.ptp(tau)
        near = float(np.mean(is_near)) - share
        is_long = share > max(_SATURATED, _LONGER * near)
        if is_long and abs(end) < effort / _ABOVE:
            said = (
                f"its torque stays at exactly {end:.3g} in {100.0 * share:.2g} % of the log, below its limit "
            )
            said += f"of {effort:.3g}: its sensor saturates; move slower"
            yield Finding("error", name, said)


def _check_effort(name: str, sizes: Array, effort: float) -> Iterator[Finding]:
    """Find torques above a joint's limit, and clipped ones, from their sizes [N m or N], (k,)."""
    largest = float(sizes.max())
    clipped = float(np.mean(sizes >= 0.999 * effort)) if np.isfinite(effort) else 0.0
    clipped = max(clipped, float(np.mean(sizes >= 0.9999 * largest)))
    above = float(np.mean(sizes > _ABOVE * effort))
    if largest > _TOO_MUCH * effort:
        said = f"its torque is {largest:.3g}, and its limit {effort:.3g}: in N m or N, at the joint?"
        yield Finding("error", name, said)
    elif above > _CLIPPED:
        said = f"its torque is above its limit of {effort:.3g} in {100.0 * above:.2g} % of the log, at most "
        said += f"{largest:.3g}: is it this robot, with torques in N m or N at the joint?"
        yield Finding("error", name, said)
    elif clipped > _CLIPPED:
        said = f"its torque is clipped at {largest:.3g} in {100.0 * clipped:.2g} % of the log: move slower"
        yield Finding("error", name, said)
