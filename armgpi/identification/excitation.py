"""A motion from which an arm can be identified: periodic, inside the limits, at rest at both ends."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from armgpi.arrays import Array, ArrayLike, as_sized_array, check_number, check_type, check_whole
from armgpi.errors import ParameterError
from armgpi.identification.estimate import expect
from armgpi.identification.weak_form import COLUMNS, ROTOR
from armgpi.references.recorded import Recorded
from armgpi.robot.robot import Robot

#: Lowest frequency [Hz] and number of its harmonics: the motion repeats every ten seconds. Speed is what
#: counts, not which series it is.
BASE, HARMONICS = 0.1, 5
#: Time in which the motion begins and ends [s].
_RAMP = 1.0
#: Range that stands for that of a joint without one, to either side [rad or m]; and the share that is used.
_WIDEST, _RANGE = 3.0, 0.9
#: Speed that stands for a limit where there is none, and the largest that is asked for [rad/s or m/s].
_SPEED, _FASTEST, _LEAST_SPEED = 2.0, 3.5, 1e-6
#: The rotor inertia may be so many times the expected one, either way.
_ROTORS = 4.0
#: Series that are drawn until one fits, rounds in which one is made slower, and by how much each.
_TRIES, _ROUNDS, _SLOWER = 20, 24, 0.85
#: Sampling of the trajectory [s], and configurations at which limits are checked a second.
_SAMPLE, _LOOKS = 0.01, 50
#: Share of the efforts that a first motion may take, and of the speeds; and shares of the efforts that are
#: taken in turn where an arm cannot hold itself with less.
FIRST_SHARE, _HOLDING = 0.25, (0.5, 0.7, 1.0)
#: Points between the origins of two links that are kept out of a box.
_BETWEEN = 4


class Excitation(NamedTuple):
    """A motion for identification.

    Attributes:
        reference: the motion.
        share: largest speed over its limit, of each joint, (n,).
        effort: largest torque over its limit for every rotor within four times the expected one, (n,).
    """

    reference: Recorded
    share: Array
    effort: Array


def excite(
    robot: Robot,
    seconds: float = 20.0,
    share: float = 0.7,
    seed: int = 0,
    floor: float | None = None,
    box: ArrayLike | None = None,
) -> Excitation:
    """Return a motion from which an arm can be identified.

    It is a random Fourier series of 0.1 to 0.5 Hz, scaled to positions, speeds and torques inside the limits
    for every rotor inertia within four times the expected one. It knows no obstacles but a floor and a box.

    Args:
        robot: the arm.
        seconds: how long.
        share: of the limits of speed and torque that is used; of torque more where an arm cannot hold itself.
        seed: the same seed gives the same motion.
        floor: height that the origins of all links but those at the base stay above [m]; None for none.
        box: two opposite corners in the base's frame [m], (2, 3), between which no link is, as lines from
            origin to origin, the tip included; None for none.

    Raises:
        ParameterError: for an argument that cannot be, when no motion was found above the floor and outside
            the box, or when a joint cannot hold the arm.
    """
    check_type(robot, "robot", Robot, "a Robot")
    seconds = check_number(seconds, "seconds", "at least 4 [s]", 4.0)
    share = check_number(share, "share", "in (0, 1]", 0.0, 1.0, open_=True)
    rng = np.random.default_rng(check_whole(seed, "seed", 0))
    lower, upper, speed = ranges(robot)
    amplitude = speed / (2.0 * math.pi * BASE * 0.5 * HARMONICS)
    corners = None if box is None else as_sized_array(box, "box")
    if corners is not None and corners.shape != (2, 3):
        raise ParameterError("box", box, "two opposite corners [m], (2, 3)")
    corners = None if corners is None else np.sort(corners, axis=0)
    wanted = "a floor and a box that leave the arm room to move: another seed, a smaller share?"
    blocked = ParameterError("floor" if box is None else "box", box or floor, wanted)
    failed: Exception = blocked
    hit = False
    efforts = [share, *(each for each in _HOLDING if each > share)]
    for effort_share, _ in itertools.product(efforts, range(_TRIES)):
        series = rng.normal(size=(2, HARMONICS, robot.n)) / math.sqrt(HARMONICS) * amplitude
        centre = 0.5 * (lower + upper) + 0.25 * (upper - lower) * rng.uniform(-1.0, 1.0, robot.n)
        try:
            scale = _scale(robot, series, centre, seconds, share, effort_share)
        except ParameterError as error:
            failed = failed if hit else error
            continue
        times = np.arange(0.0, seconds + 0.5 * _SAMPLE, _SAMPLE)
        q = centre + scale * _series(series, times, seconds)
        if (floor is not None or corners is not None) and _hits(robot, q, floor, corners):
            failed, hit = blocked, True
            continue
        reference = Recorded(times, q, source=f"excitation of {robot.name}, seed {seed}")
        target = reference.at(times)
        effort = _torque(robot, target.q, target.v, target.a, 1.0) / robot.limits.effort
        return Excitation(reference, np.abs(target.v).max(axis=0) / speed, effort)
    raise failed


def ranges(robot: Robot) -> tuple[Array, Array, Array]:
    """Return positions between which the motion is, and the speed that stands for the limit, each (n,)."""
    lower, upper, speed, _ = robot.limits
    middle = robot.middle()
    lower, upper = np.maximum(lower, middle - _WIDEST), np.minimum(upper, middle + _WIDEST)
    given = np.isfinite(speed) & (speed > _LEAST_SPEED)
    return lower, upper, np.minimum(np.where(given, speed, _SPEED), _FASTEST)


def _series(series: Array, t: Array, seconds: float) -> Array:
    """Return the sum of harmonics at times (k,), which begins and ends at rest; shape (k, n)."""
    angle = 2.0 * math.pi * BASE * t[:, None] * np.arange(1, HARMONICS + 1)
    whole = np.sin(angle) @ series[0] + np.cos(angle) @ series[1]
    ramp = np.clip(np.minimum(t, seconds - t) / _RAMP, 0.0, 1.0)
    return np.asarray(whole * (ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2))[:, None])


def _scale(
    robot: Robot, series: Array, centre: Array, seconds: float, share: float, effort_share: float
) -> Array:
    """Return the factor of each joint's series that keeps positions, speeds and torques inside, (n,).

    Raises:
        ParameterError: when a joint does not hold the arm.
    """
    lower, upper, speed = ranges(robot)
    t = np.linspace(0.0, seconds, max(int(_LOOKS * min(seconds, 2.0 / BASE)), 200))
    q = _series(series, t, seconds)
    v = np.gradient(q, t, axis=0)
    room = _RANGE * np.minimum(upper - centre, centre - lower)
    scale = np.minimum(1.0, room / np.maximum(np.abs(q).max(axis=0), 1e-12))
    scale = np.minimum(scale, share * speed / np.maximum(np.abs(v).max(axis=0), 1e-12))
    a = np.gradient(v, t, axis=0)
    for turn in range(_ROUNDS):
        torque = _torque(robot, centre + scale * q, scale * v, scale * a, effort_share)
        beyond = torque > robot.limits.effort
        if not beyond.any():
            return np.asarray(scale)
        # The joints that ask for too much first: it is mostly their own rotors.
        scale = np.where(beyond | (turn > _ROUNDS // 2), _SLOWER, 1.0) * scale
    worst = int(np.argmax(torque / np.maximum(robot.limits.effort, 1e-300)))
    limit = f"above its limit of {robot.limits.effort[worst]:g} in the file"
    wanted = f"an arm whose {robot.joint_names[worst]} has the torque to hold it, {limit}"
    raise ParameterError("robot", robot.name, wanted)


def _torque(robot: Robot, q: Array, v: Array, a: Array, share: float) -> Array:
    """Return the torque that the efforts have to allow for, (n,).

    That is the largest for every rotor within four times the expected one, and that for the expected one over
    the share that may be used.
    """
    rotor = expect(robot).mean.reshape(robot.n, len(COLUMNS))[:, ROTOR]
    body = robot.inverse_dynamics(q, v, a) - robot.armature * a
    factors = {1.0 / _ROTORS: 1.0, 1.0: share, _ROTORS: 1.0}
    torques = [np.abs(body + factor * rotor * a) / part for factor, part in factors.items()]
    return np.asarray(np.max(torques, axis=(0, 1)))


def _hits(robot: Robot, q: Array, floor: float | None, box: Array | None) -> bool:
    """Tell whether links that move are below a floor, or lines from origin to origin in a box."""
    import pinocchio as pin

    model = robot.pinocchio_model()
    data, between = model.createData(), np.linspace(0.0, 1.0, _BETWEEN + 2)[:, None, None]
    moved = [i for i, frame in enumerate(model.frames) if int(frame.parentJoint) > 1]
    parents = [*[*model.parents][1:], int(model.frames[robot._frame(robot.tip)].parentJoint)]
    for each in q[:: round(0.1 / _SAMPLE)]:
        pin.framesForwardKinematics(model, data, each)
        if floor is not None and any(data.oMf[i].translation[2] < floor for i in moved):
            return True
        ends = [
            *(data.oMi[i].translation for i in range(1, model.njoints)),
            data.oMf[robot._frame(robot.tip)].translation,
        ]
        begins = np.array([data.oMi[i].translation for i in parents])
        lines = begins + between * (np.array(ends) - begins)
        if box is not None and ((lines > box[0]) & (lines < box[1])).all(axis=-1).any():
            return True
    return False
