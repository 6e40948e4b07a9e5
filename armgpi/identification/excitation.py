"""A motion from which an arm can be identified: periodic, inside the limits, at rest at both ends."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from os import PathLike
from typing import Literal, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, ArrayLike, as_sized_array, check_number, check_type, check_whole
from armgpi.errors import ParameterError
from armgpi.identification.estimate import planned_rotors
from armgpi.references.recorded import Recorded
from armgpi.robot.clearance import Clearance, Hit, usual_floor
from armgpi.robot.robot import Robot

#: Lowest frequency [Hz]: the motion repeats every ten seconds.
BASE = 0.1
#: Number of its harmonics. Speed is what counts, not which series it is.
HARMONICS = 5
#: Time in which the motion begins and ends [s].
_RAMP = 1.0
#: Range that replaces that of a joint without one, to either side [rad or m].
_WIDEST = 3.0
#: Share of the range that is used.
_RANGE = 0.9
#: Speed that replaces a limit where there is none, or one below the least [rad/s or m/s].
_SPEED = 2.0
_LEAST_SPEED = 1e-6
#: Largest speed that is asked for [rad/s or m/s].
_FASTEST = 3.5
#: The rotor inertia may be so many times the expected one, either way.
_ROTORS = 4.0
#: Speed that each joint reaches in a motion, where one is found [rad/s or m/s]: half as much again as a log
#: has to have (`armgpi.identification.check`).
_SEEN_SPEED = 0.06
#: Series of each size that are drawn.
_TRIES = 40
#: Motions with a slower joint that are found before more of the torque is taken.
_SLOW_TRIES = 12
#: Rounds in which one is made slower, and by how much each.
_ROUNDS = 24
_SLOWER = 0.85
#: Parts of the range, either way of its middle, in which a motion's centre is looked for: the second one
#: where the first has none.
_NEAR = 0.25
_FAR = 0.42
#: Sizes of series that are tried in turn until one collides with nothing.
_SIZES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2)
#: Configurations that are drawn to find one in which the arm is free.
_CENTRES = 1000
#: Sampling of the trajectory [s].
_SAMPLE = 0.01
#: Configurations at which limits are checked a second.
_LOOKS = 50
#: Share of the efforts that a first motion may take, and of the speeds.
FIRST_SHARE = 0.25
#: Shares of the efforts that are taken in turn where an arm cannot hold itself with less.
_HOLDING = (0.5, 0.7, 1.0)


class Excitation(NamedTuple):
    """A motion for identification.

    Attributes:
        reference: the motion.
        share: largest speed over its limit, of each joint, (n,).
        effort: largest torque over its limit, (n,): of :func:`excite` for every rotor within four times the
            expected one; of chirps and multisines, which are fed forward, for the expected one.
        clearance: what the motion was compared with: the arm's own links, floor and box, with which margin,
            and what was left out.
    """

    reference: Recorded
    share: Array
    effort: Array
    clearance: Clearance


def excite(
    robot: Robot,
    seconds: float = 20.0,
    share: float = 0.7,
    seed: int = 0,
    floor: float | Literal["usual"] | None = "usual",
    box: ArrayLike | None = None,
    margin: float | None = None,
    collisions: bool = True,
    package_dirs: Iterable[str | PathLike[str]] = (),
    clearance: Clearance | None = None,
) -> Excitation:
    """Return a motion from which an arm can be identified, and that collides with nothing that is known.

    It is a random Fourier series of 0.1 to 0.5 Hz, scaled to positions, speeds and torques inside the limits
    for every rotor inertia within four times the expected one. It is drawn anew, and made smaller at last,
    until the collision shapes of the arm stay clear of each other, of the floor and of the box by a margin.
    It knows no other obstacles. Where a joint would be too slow for a log, others are tried, and more of the
    torque at last.

    Args:
        robot: the arm.
        seconds: how long.
        share: of the limits of speed and torque that is used; of torque more where an arm cannot hold itself.
        seed: the same seed gives the same motion.
        floor: height that all links but the base and the first one stay above [m]; "usual" is the lowest
            fixed point of an arm that stands, and no floor for others; None for none.
        box: two opposite corners in the base's frame [m], (2, 3), between which no link is, as lines from
            origin to origin, the tip included; None for none.
        margin: distance that is kept [m]; 0.02 of the arm's length if None.
        collisions: whether the arm's own links are compared.
        package_dirs: folders in which collision meshes are looked for, too.
        clearance: what the arm must not touch, in place of the five arguments before.

    Raises:
        ParameterError: for an argument that cannot be, when no motion was found that collides with nothing,
            or when a joint cannot hold the arm.
    """
    check_type(robot, "robot", Robot, "a Robot")
    seconds = check_number(seconds, "seconds", "at least 4 [s]", 4.0)
    share = check_number(share, "share", "in (0, 1]", 0.0, 1.0, open_=True)
    rng = np.random.default_rng(check_whole(seed, "seed", 0))
    clear = clearance or surroundings(robot, floor, box, margin, collisions, package_dirs)
    efforts = [share, *(larger for larger in _HOLDING if larger > share)]
    times = np.arange(0.0, seconds + 0.5 * _SAMPLE, _SAMPLE)
    hit: Hit | None = None
    failed: ParameterError | None = None
    fastest, best = 0.0, None  # of the motions in which a joint is too slow for a log
    for effort_share, size in itertools.product(efforts, _SIZES):
        if size < 1.0 and (hit is None or best is not None):
            continue  # no motion of any size is held, or smaller ones are slower still
        slow = 0
        for _ in range(_TRIES):
            normal = rng.normal(size=(2, HARMONICS, robot.n))
            series = normal / math.sqrt(HARMONICS) * _amplitude(robot)
            centre = free_configuration(robot, rng, clear)
            try:
                scale = size * _scale(robot, series, centre, seconds, share, effort_share)
            except ParameterError as error:
                failed = error
                continue
            q = centre + scale * _series(series, times, seconds)
            slowest = _slowest_joint(times, q)
            if slowest > fastest:
                hit = clear.first_hit(q[clear.dense(q)])
                if hit is not None:
                    continue
                if slowest >= _SEEN_SPEED:
                    return _excitation(robot, times, q, seed, clear)
                fastest, best = slowest, q
            slow += 1
            if slow == _SLOW_TRIES:
                break
    if best is not None:
        return _excitation(robot, times, best, seed, clear)
    raise failed if hit is None and failed is not None else blocked(hit, clear)


def _slowest_joint(times: Array, q: Array) -> float:
    """Return the largest speed of the joint whose largest one is the smallest [rad/s or m/s]."""
    speed = np.abs(np.gradient(q, times, axis=0))
    return float(speed.max(axis=0).min())


def surroundings(
    robot: Robot,
    floor: float | Literal["usual"] | None = "usual",
    box: ArrayLike | None = None,
    margin: float | None = None,
    collisions: bool = True,
    package_dirs: Iterable[str | PathLike[str]] = (),
) -> Clearance:
    """Return what a motion is compared with; see :func:`excite`.

    Raises:
        ParameterError: for an argument that cannot be.
    """
    corners = None if box is None else as_sized_array(box, "box")
    if corners is not None and corners.shape != (2, 3):
        raise ParameterError("box", box, "two opposite corners [m], (2, 3)")
    if corners is not None and not (np.ptp(corners, axis=0) > 0.0).all():
        raise ParameterError("box", box, "two opposite corners that differ in x, y and z [m]")
    check_type(collisions, "collisions", bool, "True or False")
    folders = tuple(package_dirs)
    if margin is not None:
        margin = check_number(margin, "margin", "at least 0 [m]", 0.0)
    if floor == "usual":
        height = usual_floor(robot, folders)
    else:
        height = None if floor is None else check_number(floor, "floor", "a height [m]", -math.inf)
    return Clearance(robot, margin, height, corners, folders, own=collisions)


def free_configuration(robot: Robot, rng: np.random.Generator, clear: Clearance) -> Array:
    """Return a configuration in which an arm collides with nothing, near the middle if there is one, (n,).

    Raises:
        ParameterError: when none was found.
    """
    lower, upper, _ = ranges(robot)
    for k in range(_CENTRES):
        reach = _NEAR if k < _CENTRES // 2 else _FAR
        away = reach * (upper - lower) * rng.uniform(-1.0, 1.0, robot.n)
        centre = np.asarray(0.5 * (lower + upper) + away)
        if (hit := clear.first_hit(centre)) is None:
            return centre
    raise blocked(hit, clear)


def blocked(hit: Hit | None, clear: Clearance) -> ParameterError:
    """Return the error that no motion is free, with what was in the way of the last one."""
    assert hit is not None
    names = f"{hit.first} and {hit.second}"
    wanted = (
        f"a motion in which nothing comes closer than {clear.margin:.3g} m; the last one of those that were "
        f"tried brought {names} closer: try another seed, a smaller share or a smaller margin"
    )
    box = None if clear.box is None else clear.box.tolist()
    around = {"floor": clear.floor, "box": box}
    if hit.second in around:
        return ParameterError(hit.second, around[hit.second], wanted)
    return ParameterError("robot", f"{hit.first}, {hit.second}", wanted)


def _amplitude(robot: Robot) -> Array:
    """Return the amplitude at which a series has the speeds that stand for the limits, (n,)."""
    _, _, speed = ranges(robot)
    return np.asarray(speed / (2.0 * math.pi * BASE * 0.5 * HARMONICS))


def _excitation(robot: Robot, times: Array, q: Array, seed: int, clear: Clearance) -> Excitation:
    """Return a motion with the shares of the limits that it takes."""
    reference = Recorded(times, q, source=f"excitation of {robot.name}, seed {seed}")
    target = reference.at(times)
    torque = _torque(robot, target.q, target.v, target.a, 1.0)
    _, _, speed = ranges(robot)
    speed_share = np.abs(target.v).max(axis=0) / speed
    return Excitation(reference, speed_share, torque / robot.limits.effort, clear)


def ranges(robot: Robot) -> tuple[Array, Array, Array]:
    """Return positions between which the motion is, and the speed that stands for the limit, each (n,)."""
    lower, upper, speed, _ = robot.limits
    middle = robot.middle()
    lower = np.maximum(lower, middle - _WIDEST)
    upper = np.minimum(upper, middle + _WIDEST)
    is_limit = np.isfinite(speed) & (speed > _LEAST_SPEED)
    speed = np.where(is_limit, speed, _SPEED)
    return lower, upper, np.minimum(speed, _FASTEST)


def _series(series: Array, t: Array, seconds: float) -> Array:
    """Return the sum of harmonics at times (k,), which begins and ends at rest; shape (k, n)."""
    harmonics = np.arange(1, HARMONICS + 1)
    angle = 2.0 * math.pi * BASE * t[:, None] * harmonics
    whole = np.sin(angle) @ series[0] + np.cos(angle) @ series[1]
    to_end = np.minimum(t, seconds - t)
    ramp = np.clip(to_end / _RAMP, 0.0, 1.0)
    window = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    return np.asarray(whole * window[:, None])


def _scale(
    robot: Robot, series: Array, centre: Array, seconds: float, share: float, effort_share: float
) -> Array:
    """Return the factor of each joint's series that keeps positions, speeds and torques inside, (n,).

    Raises:
        ParameterError: when a joint does not hold the arm.
    """
    lower, upper, speed = ranges(robot)
    looks = int(_LOOKS * min(seconds, 2.0 / BASE))
    t = np.linspace(0.0, seconds, max(looks, 200))
    q = _series(series, t, seconds)
    v = np.gradient(q, t, axis=0)
    room = _RANGE * np.minimum(upper - centre, centre - lower)
    farthest = np.maximum(np.abs(q).max(axis=0), 1e-12)
    fastest = np.maximum(np.abs(v).max(axis=0), 1e-12)
    scale = np.minimum(1.0, room / farthest)
    scale = np.minimum(scale, share * speed / fastest)
    a = np.gradient(v, t, axis=0)
    for turn in range(_ROUNDS):
        torque = _torque(robot, centre + scale * q, scale * v, scale * a, effort_share)
        beyond = torque > robot.limits.effort
        if not beyond.any():
            return np.asarray(scale)
        # The joints that ask for too much first: it is mostly their own rotors.
        is_slowed = beyond | (turn > _ROUNDS // 2)
        scale = np.where(is_slowed, _SLOWER, 1.0) * scale
    over_limit = torque / np.maximum(robot.limits.effort, 1e-300)
    worst = int(np.argmax(over_limit))
    limit = f"above its limit of {robot.limits.effort[worst]:g} in the file"
    wanted = f"an arm whose {robot.joint_names[worst]} has the torque to hold it, {limit}"
    raise ParameterError("robot", robot.name, wanted)


def _torque(robot: Robot, q: Array, v: Array, a: Array, share: float) -> Array:
    """Return the torque that the efforts have to allow for, (n,).

    That is the largest for every rotor within four times the expected one, and that for the expected one over
    the share that may be used.
    """
    rotor = planned_rotors(robot)
    body = robot.inverse_dynamics(q, v, a) - robot.armature * a
    torques = []
    for factor, allowed in ((1.0 / _ROTORS, 1.0), (1.0, share), (_ROTORS, 1.0)):
        torque = body + factor * rotor * a
        torques.append(np.abs(torque) / allowed)
    return np.asarray(np.max(torques, axis=(0, 1)))
