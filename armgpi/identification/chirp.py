"""The side of the encoders and the rotors of an arm, from a chirp of one second for each joint.

An encoder at the motor sees a torque move the rotor alone at frequencies above the joint's resonance; one at
the link sees less and less. So the ratio of position to torque over frequency tells both: two-mass models of
a joint are fitted to it, one for each side. The better one is taken where the difference is beyond doubt.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import optimize

from armgpi.base.arrays import Array, PerJointInput, check_number, check_type, quantity
from armgpi.base.verdict import Verdict, judge
from armgpi.errors import ArmgpiError, ParameterError, UnfitLog
from armgpi.gpi.law import GPI
from armgpi.identification.estimate import HALF_95
from armgpi.identification.excitation import Excitation, blocked, free_configuration, ranges, surroundings
from armgpi.identification.logs import Grid, Log, read_log, resample, with_torques
from armgpi.references.recorded import Recorded
from armgpi.robot.clearance import Clearance
from armgpi.robot.drives import Drives
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears
from armgpi.tuning.rule import BITS, usual_effort
from armgpi.tuning.verdict import describe_bandwidths, verdict

#: Ends of the chirp [Hz].
LOWEST = 4.0
HIGHEST = 160.0
#: Its length, the time to settle before it and to come to rest after it [s].
CHIRP = 1.0
_BEFORE = 0.5
_AFTER = 0.5
TURN = _BEFORE + CHIRP + _AFTER
#: Share of the usual effort that the chirp takes, and of the effort that gravity leaves at most.
SHARE = 0.15
_SPARE = 0.4
#: Share of the range that a joint may take, and of its speed limit.
_RANGE = 0.03
_SPEED = 0.5
#: Sampling of the motion [s].
_SAMPLE = 5e-4
#: Share of the chirp that its ramps take.
_RAMP = 0.06
#: Configurations about which a motion is tried until it collides with nothing.
_CENTRES = 20
#: Share of the fast changes of a joint's torque that has to be in its turn, on average.
_INSIDE = 0.5
#: Time before the chirp that belongs to its answer [s], and after it, in which the answer ends [s].
_STILL = 0.1
_RINGS = 0.35
#: Frequencies that are compared begin here [Hz], and end at a share of the log's rate.
_FROM = 6.0
_UP_TO = 0.33
#: Share of the largest torque from which a frequency is compared.
_STRONG = 0.05
#: Standard deviations of what is expected: of the logarithms of links, rotor, stiffness, damping ratio and
#: friction.
_LINKS = 0.4
_ROTOR = 0.7
_STIFFNESS = 1.2
_DAMPING = 0.8
_FRICTION = 1.5
#: The same of the time between torque and position [s].
_LATE = 2e-3
#: Unknowns of a joint, in this order.
_UNKNOWNS = 6
#: Samples by which a position lags behind its torque without anything else: the hold, and one of delay.
_HELD = 1.5
#: Damping ratio and friction over 2 sqrt(K J) that are expected.
_RATIO = 0.03
_RUB = 0.05
#: Error of the model as a share of what it says: other joints, friction.
_MODEL = 0.15
#: Stiffnesses over the assumed one that the fits begin with.
_STARTS = (0.1, 0.3, 1.0, 3.0, 10.0)
#: Difference of the logarithms of two likelihoods from which one side is taken, of a joint that tells any.
_DECIDED = 8.0
#: Frequencies over which what the model leaves is alike: so many lines count as one.
_ALIKE = 4.0
#: Standard deviation of a rotor's logarithm that no fit shows: the other joints, which the model of one has
#: not; chosen on ur5 and panda (tools/side.py, seed 100).
_UNSEEN = 0.18
#: Fewest frequencies that are compared.
_FEWEST = 8
#: Share of the evidence of all joints from which one that says the other side is no chance.
_CONTRADICTS = 0.2
#: Length of the blocks in which the begin of a motion is looked for [s].
_BLOCK = 0.05
#: Resolution of an encoder that showed no motion [bits].
_COARSEST = 6.0
#: Sample time of the controllers whose margins are printed [s].
_SAMPLE_TIME = 1e-3
#: Share of the prior's width that a rotor's has to be below before it counts as identified.
_LEARNED = 0.5


class Side(NamedTuple):
    """What chirps say of the encoders and the rotors.

    Attributes:
        side: where the encoders sit: "motor" or "link"; "" where the log does not decide it.
        evidence: of each joint, the difference of the logarithms of both likelihoods, (n,): above zero for
            the motor; NaN of joints without a chirp in the log.
        rotor: inertia of the rotors [kg m^2 or kg], (n,); what was known before where the log tells nothing.
        low: lower ends of their 95 % intervals, (n,).
        high: upper ends, (n,).
        identified: which rotors the log decided, (n,).
        late: time by which positions lag behind torques, the hold of half a sample included [s]: the median
            of the joints.
        counts: smallest step of the measured positions as logged [rad or m], (n,), 0 of those that never
            changed; what is too coarse hides the side.
    """

    side: str
    evidence: Array
    rotor: Array
    low: Array
    high: Array
    identified: npt.NDArray[np.bool_]
    late: float
    counts: Array

    def add_to(self, drives: Drives) -> Drives:
        """Return drives with the rotors that the log decided, and the side of the joints that it moved."""
        value, low, high = {}, {}, {}
        for place in np.flatnonzero(self.identified):
            joint = drives.joint_names[place]
            value[joint] = float(self.rotor[place])
            low[joint] = float(self.low[place])
            high[joint] = float(self.high[place])
        if value:
            drives = drives.with_value("rotor_inertia", value, low, high, "identified")
        moved = np.isfinite(self.evidence)
        if self.side and moved.any():
            side = {drives.joint_names[place]: self.side for place in np.flatnonzero(moved)}
            drives = drives.with_value("encoder_side", side, source="identified")
        return drives


class _Response(NamedTuple):
    """The response of one joint to its chirp.

    Attributes:
        joint: its number.
        lines: frequencies [Hz], (k,).
        ratio: position over torque at them, (k,).
        noise: standard deviation of that, (k,).
        q: mean configuration [rad or m], (n,).
    """

    joint: int
    lines: Array
    ratio: Array
    noise: Array
    q: Array


class _Fitted(NamedTuple):
    """A two-mass model beside the response of one joint.

    Attributes:
        cost: the negative logarithm of its likelihood, prior included.
        x: the unknowns in standard deviations of what is expected: links, rotor, stiffness, damping,
            friction, and the time between torque and position.
        std: standard deviation of the logarithm of the rotor.
    """

    cost: float
    x: Array
    std: float


class _BothSides(NamedTuple):
    """The fits of one joint for encoders at the motor, and at the link."""

    motor: _Fitted
    link: _Fitted


def chirp(
    robot: Robot, share: float = SHARE, clearance: Clearance | None = None, seed: int = 0
) -> Excitation:
    """Return a motion that shows the side of the encoders: joint by joint, 4 to 160 Hz in a second.

    A controller that feeds forward answers with torques at these frequencies, of a share of the usual effort
    at most. Each joint moves by a few degrees at most, about the middle of its range or a configuration in
    which the arm collides with nothing.

    Args:
        robot: the arm.
        share: of the usual effort; less where gravity leaves less.
        clearance: what the arm must not touch; its own links and a floor if None.
        seed: of the configurations that are tried.

    Raises:
        ParameterError: for an argument that cannot be, or an arm that cannot hold itself there.
    """
    check_type(robot, "robot", Robot, "a Robot")
    share = check_number(share, "share", "in (0, 1]", 0.0, 1.0, open_=True)
    _with_gears(robot)
    rng = np.random.default_rng(seed)
    clear = surroundings(robot) if clearance is None else clearance
    failed: ParameterError | None = None
    for turn in range(_CENTRES):
        centre = robot.middle() if not turn else free_configuration(robot, rng, clear)
        try:
            motion = _chirp_about(robot, centre, share, clear)
        except ParameterError as error:
            failed = failed or error
            continue
        q = np.asarray(motion.reference.q)
        if (hit := clear.first_hit(q[clear.dense(q)])) is None:
            return motion
        failed = blocked(hit, clear)
    assert failed is not None
    raise failed


def _chirp_about(robot: Robot, centre: Array, share: float, clear: Clearance) -> Excitation:
    """Return the motion of :func:`chirp` about a configuration (n,).

    Raises:
        ParameterError: for an arm that cannot hold itself there.
    """
    lower, upper, speed = ranges(robot)
    spare = robot.limits.effort - np.abs(robot.gravity(centre))
    if not (spare > 0.0).all():
        name = robot.joint_names[int(spare.argmin())]
        raise ParameterError("robot", robot.name, f"an arm that {name} holds where it is shaken")
    soft = assume_gears(robot)
    inertia = np.diag(soft.mass_matrix(centre))
    torque = np.minimum(share * usual_effort(robot), _SPARE * spare)
    times = np.arange(0.0, robot.n * TURN + 0.5 * _SAMPLE, _SAMPLE)
    q = np.tile(centre, (len(times), 1))
    for j in range(robot.n):
        since_begin = times - j * TURN - _BEFORE
        is_own = (since_begin >= 0.0) & (since_begin <= CHIRP)
        shape = _shape(since_begin[is_own])
        change = np.gradient(shape, _SAMPLE)
        largest = np.abs(np.gradient(change, _SAMPLE)).max()
        by_torque = torque[j] / (inertia[j] * largest)
        by_speed = _SPEED * speed[j] / np.abs(change).max()
        by_range = _RANGE * (upper[j] - lower[j]) / np.abs(shape).max()
        q[is_own, j] += min(by_torque, by_speed, by_range) * shape
    reference = Recorded(times, q, source=f"chirps of {robot.name}")
    target = reference.at(times)
    accelerating = inertia * np.abs(target.a).max(axis=0)
    effort = (np.abs(robot.gravity(centre)) + accelerating) / robot.limits.effort
    speed_share = np.abs(target.v).max(axis=0) / speed
    return Excitation(reference, speed_share, effort, clear)


def _with_gears(robot: Robot) -> Robot:
    """Return an arm with rotors and stiffness, assumed ones where nothing is known.

    Raises:
        ParameterError: for an arm without rotors.
    """
    soft = assume_gears(robot)
    is_elastic = np.isfinite(soft.drives.value("stiffness"))
    is_direct = ~is_elastic | ~(soft.armature > 0.0)
    if is_direct.any():
        name = robot.joint_names[int(is_direct.argmax())]
        wanted = f"an arm with rotors; {name} has none, and both sides of a direct drive are one"
        raise ParameterError("robot", robot.name, wanted)
    return soft


def _shape(t: Array) -> Array:
    """Return positions whose accelerations are a chirp of one size, at times (k,) from 0 to its length."""
    rate = math.log(HIGHEST / LOWEST) / CHIRP
    frequency = LOWEST * np.exp(rate * t)
    phase = 2.0 * math.pi * (frequency - LOWEST) / rate
    to_end = np.minimum(t, CHIRP - t)
    ramp = np.clip(to_end / (_RAMP * CHIRP), 0.0, 1.0)
    window = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    omega = 2.0 * math.pi * frequency
    return np.asarray(-np.sin(phase) / omega**2 * window)


def find_side(robot: Robot, log: Log) -> Side:
    """Return what a log of :func:`chirp` says of the side of the encoders and of the rotors.

    Args:
        robot: the arm, with what is known or assumed of its rotors.
        log: with torques of the motors.

    Raises:
        UnfitLog: when the log shows no joint's chirp.
    """
    if log.torque == "joint":
        wanted = "torques of the motors or commanded ones: sensors behind the gears do not feel the rotors"
        raise ParameterError(f"{log.source}: torque", log.torque, wanted)
    grid, counts = resample(log), _counts(log.q)
    soft = _with_gears(robot)
    coarse: list[int] = []
    responses = list(_responses(soft, grid, counts, coarse))
    if not responses and not coarse:
        wanted = f"expected the motion of armgpi excite --side, {TURN:g} s for each joint"
        raise UnfitLog([f"it shows no joint's chirp: {wanted} ({log.source})"])
    fits = {response.joint: _fit_both(soft, response, grid.dt) for response in responses}
    evidence = np.full(robot.n, np.nan)
    evidence[coarse] = 0.0
    for joint, both in fits.items():
        evidence[joint] = both.link.cost - both.motor.cost
    side = _judge(evidence)
    rotor = soft.armature
    low, high = soft.drives.interval("rotor_inertia")
    low, high = np.where(np.isnan(low), rotor, low), np.where(np.isnan(high), rotor, high)
    measured = np.zeros(robot.n, dtype=bool)
    result = Side(side, evidence, rotor.copy(), low, high, measured, math.nan, counts)
    return _with_rotors(result, fits, grid.dt) if side else result


def _with_rotors(result: Side, fits: Mapping[int, _BothSides], dt: float) -> Side:
    """Return what chirps say with the rotors and the lag that the fits of the decided side have.

    Args:
        result: with a side, and what is known of the rotors; these arrays are written to.
        fits: of the joints.
        dt: sample time of the log [s].
    """
    late = []
    for joint, both in fits.items():
        fitted = both.motor if result.side == "motor" else both.link
        late.append(_LATE * fitted.x[5] + _HELD * dt)
        # Behind the elasticity a rotor cannot be told from the link: it came out up to six times too heavy.
        if result.side == "motor" and fitted.std < _LEARNED * _ROTOR:
            value = result.rotor[joint] * math.exp(_ROTOR * fitted.x[1])
            spread = math.exp(HALF_95 * fitted.std)
            result.rotor[joint] = value
            result.low[joint] = value / spread
            result.high[joint] = value * spread
            result.identified[joint] = True
    return result._replace(late=float(np.median(late)) if late else math.nan)


def _judge(evidence: Array) -> str:
    """Return the side that joints agree on; "" where none tells it, or where they contradict each other."""
    shown = evidence[np.isfinite(evidence)]
    strong = shown[np.abs(shown) > _DECIDED]
    total = float(shown.sum())
    if not len(strong) or abs(total) <= _DECIDED:
        return ""
    # A joint that says the other one as clearly is no chance.
    is_against = strong * total < 0.0
    if is_against.all() or not is_against.any():
        return "motor" if total > 0.0 else "link"
    if np.abs(strong[is_against]).max() > _CONTRADICTS * abs(total):
        return ""
    return "motor" if total > 0.0 else "link"


def _counts(q: Array) -> Array:
    """Return the smallest step of each joint in positions as logged [rad or m], (k, n): (n,).

    Positions between samples are no measure of it: interpolation makes steps of any size.
    """
    steps = np.abs(np.diff(q, axis=0))
    largest = steps.max(axis=0)
    is_step = steps > 1e-9 * np.maximum(largest, 1e-300)
    least = np.where(is_step, steps, np.inf).min(axis=0)
    return np.where(np.isfinite(least), least, 0.0)


def _begin(robot: Robot, grid: Grid) -> int | None:
    """Return the sample at which the motion began: where the torques' chirps are in their turns; or None."""
    width = max(1, round(_BLOCK / grid.dt))
    fast = np.diff(grid.tau, n=2, axis=0) ** 2
    whole = len(fast) // width * width
    blocks = fast[:whole].reshape(-1, width, robot.n).sum(axis=1)
    always_there = np.median(blocks, axis=0)  # noise
    blocks = np.maximum(blocks - always_there, 0.0)
    blocks /= np.maximum(blocks.sum(axis=0), 1e-300)
    turn, before, length = (round(time / (width * grid.dt)) for time in (TURN, _BEFORE, CHIRP))
    most_inside, begin, most_joints = -1.0, 0, 1
    earliest, latest = -(robot.n - 1) * turn, max(len(blocks) - turn, 0)
    for start in range(earliest, latest + 1):
        inside, joints = 0.0, 0
        for joint in range(robot.n):
            first = start + before + turn * joint
            if first >= 0 and first + length <= len(blocks):
                inside += float(blocks[first : first + length, joint].sum())
                joints += 1
        if inside > most_inside + 1e-12:
            most_inside, begin, most_joints = inside, start, joints
    if not most_joints or most_inside <= _INSIDE * most_joints:
        return None
    return begin * width


def _responses(robot: Robot, grid: Grid, count: Array, coarse: list[int]) -> Iterator[_Response]:
    """Find the joints' chirps in a log, and their answers at frequencies.

    Args:
        robot: the arm with rotors.
        grid: the log.
        count: smallest step of each joint's positions [rad or m], (n,); 0 of those that never changed.
        coarse: takes the joints whose encoders are too coarse for their answers.
    """
    begin = _begin(robot, grid)
    lines = np.arange(_FROM, min(HIGHEST, _UP_TO / grid.dt), 1.0 / CHIRP)
    if begin is None or len(lines) < _FEWEST:
        return
    # Of a joint whose position never changed the counts are coarser than its motion.
    count = np.where(count > 0.0, count, robot.encoder_count(_COARSEST))
    heaviest = np.fmax(robot.drives.interval("rotor_inertia")[1], robot.armature)
    for joint in range(robot.n):
        before_chirp = joint * TURN + _BEFORE
        start = begin + round((before_chirp - _STILL) / grid.dt)
        end = begin + round((before_chirp + CHIRP + _RINGS) / grid.dt)
        is_whole = start >= 0 and end <= len(grid.q)
        if not is_whole or grid.bad[start:end].any():
            continue
        span = slice(start, end)
        part = grid._replace(q=grid.q[span], tau=grid.tau[span], bad=grid.bad[span])
        response = _response(joint, part, lines, float(count[joint]), float(heaviest[joint]))
        if response is None:
            coarse.append(joint)
        else:
            yield response


def _response(joint: int, part: Grid, lines: Array, count: float, heaviest: float) -> _Response | None:
    """Return the answer of a joint to its chirp; None where its encoder is too coarse for it.

    Args:
        joint: its number.
        part: of the log, with its chirp.
        lines: frequencies [Hz], (k,).
        count: smallest step of its position [rad or m].
        heaviest: largest rotor that is expected of it [kg m^2 or kg].
    """
    samples = len(part.q)
    t = part.dt * np.arange(samples)
    waves = np.exp(-2j * math.pi * lines[:, None] * t)
    level_torque = _level(part.tau[:, joint])
    position = _level(part.q[:, joint]) @ waves.T * part.dt
    torque = level_torque @ waves.T * part.dt
    # The transform of the noise of one sample, of counts as they are rounded.
    noise = count / math.sqrt(12.0) * math.sqrt(samples) * part.dt
    # Where not even the heaviest rotor that is expected would move by a count, a position that stands
    # still says nothing: counts are no white noise then.
    amplitude = math.sqrt(2.0) * float(level_torque.std())
    inertia_torque = heaviest * (2.0 * math.pi * lines) ** 2  # for a position of one
    is_seen = amplitude / inertia_torque > count
    size = np.abs(torque)
    is_strong = (size > _STRONG * size.max()) & is_seen
    if is_strong.sum() < _FEWEST:
        return None
    ratio = position[is_strong] / torque[is_strong]
    return _Response(joint, lines[is_strong], ratio, noise / size[is_strong], part.q.mean(axis=0))


def _level(values: Array) -> Array:
    """Return a signal without the line between its ends, so that it begins and ends at zero."""
    edge = max(1, len(values) // 50)
    first, last = values[:edge].mean(), values[-edge:].mean()
    from_begin = np.linspace(0.0, 1.0, len(values))
    return np.asarray(values - first - (last - first) * from_begin)


def _fit_both(robot: Robot, response: _Response, dt: float) -> _BothSides:
    """Return the two-mass models of a joint that explain a response best."""
    return _BothSides(_fit(robot, response, dt, "motor"), _fit(robot, response, dt, "link"))


class _Expected(NamedTuple):
    """What is expected of one joint.

    Attributes:
        links: inertia behind the gear [kg m^2 or kg].
        rotor: inertia before it [kg m^2 or kg].
        stiffness: of the gear [N m/rad or N/m].
    """

    links: float
    rotor: float
    stiffness: float


def _fit(robot: Robot, response: _Response, dt: float, side: str) -> _Fitted:
    """Return the two-mass model of a joint that explains a response best, for encoders at one side."""
    joint = response.joint
    rotor = float(robot.armature[joint])
    links = float(robot.mass_matrix(response.q)[joint, joint]) - rotor
    expected = _Expected(links, rotor, float(robot.drives.value("stiffness")[joint]))
    usual_sigma = np.hypot(_MODEL * np.abs(response.ratio), response.noise)

    def residuals(x: Array) -> Array:
        model = _model(x, response.lines, dt, expected, side)
        sigma = np.hypot(_MODEL * np.abs(model), response.noise)
        misfit = (response.ratio - model) / sigma / math.sqrt(_ALIKE)
        # The width of the noise belongs to the likelihood: ln sigma beside what a perfect ratio would have.
        width = np.log(sigma / usual_sigma) * 2.0 / _ALIKE
        root_of_width = np.sqrt(np.maximum(2.0 * width + 20.0, 0.0))
        return np.concatenate([misfit.real, misfit.imag, root_of_width, x])

    best: Any = None
    for factor in _STARTS:
        x = np.zeros(_UNKNOWNS)
        x[2] = math.log(factor) / _STIFFNESS
        fitted = optimize.least_squares(residuals, x, loss="soft_l1", f_scale=3.0, max_nfev=60)
        if best is None or fitted.cost < best.cost:
            best = fitted
    information = best.jac.T @ best.jac
    covariance = np.linalg.inv(information + 1e-9 * np.eye(_UNKNOWNS))
    std = _ROTOR * math.sqrt(float(covariance[1, 1]))
    return _Fitted(float(best.cost), np.asarray(best.x), math.hypot(std, _UNSEEN))


def _model(x: Array, lines: Array, dt: float, expected: _Expected, side: str) -> Array:
    """Return position over torque of a two-mass model at frequencies [Hz]."""
    M = expected.links * math.exp(_LINKS * x[0])
    J = expected.rotor * math.exp(_ROTOR * x[1])
    K = expected.stiffness * math.exp(_STIFFNESS * x[2])
    damping_ratio = _RATIO * math.exp(_DAMPING * x[3])
    B = 2.0 * damping_ratio * math.sqrt(K * M * J / (M + J))
    friction_ratio = _RUB * math.exp(_FRICTION * x[4])
    f = 2.0 * friction_ratio * math.sqrt(K * J)
    s = 2j * math.pi * lines
    gear = K + B * s
    link = M * s**2 + gear
    motor = J * s**2 + f * s + gear
    late = np.exp(-s * (_LATE * x[5] + _HELD * dt))
    position = link if side == "motor" else gear
    return np.asarray(position / (motor * link - gear**2) * late)


def identify_side(
    robot: Robot,
    log: Any,
    current: PerJointInput | None = None,
    columns: Mapping[str, str] | None = None,
    torque: str | None = None,
) -> Side:
    """Return the side of the encoders and the rotors of an arm from a log of ``armgpi excite --side`` alone.

    Args:
        robot: the arm as its file has it.
        log: a log, see :func:`armgpi.identify`.
        current: torque at the joint for a unit of what is logged [N m/A or N/A], where that is currents.
        columns: what the columns of CSV files are called.
        torque: what the torques are, "motor" or "commanded"; in those of sensors behind the gears there are
            no rotors.

    Raises:
        UnfitLog: when the log shows no joint's chirp.
        ParameterError: for torques of sensors behind the gears, or currents without torque constants.
    """
    check_type(robot, "robot", Robot, "a Robot")
    constants = None if current is None else quantity(current, "current", robot.joint_names)
    of_torques = with_torques(read_log(log, robot, columns=columns), constants)
    kind = of_torques.torque if torque is None else torque
    return find_side(robot, of_torques._replace(torque=kind))


def judge_side(found: Side, joint_names: Sequence[str], accepted: bool = False) -> Verdict:
    """Return the verdict on a log of chirps: whether it decides the side of the encoders.

    Args:
        found: what the log says.
        joint_names: of the arm.
        accepted: whether joints without a chirp in the log are accepted.
    """
    left_out = [
        f"{name}: no chirp in the log"
        for name, evidence in zip(joint_names, found.evidence, strict=True)
        if math.isnan(evidence)
    ]
    if not found.side:
        why = (
            "the log does not decide the side of the encoders: too coarse, too stiff joints, or contradicting"
        )
        return Verdict("not judged", why, tuple(left_out))
    return judge(True, f"the encoders sit at the {found.side}s", left_out, accepted=accepted)


def describe(found: Side, robot: Robot) -> str:
    """Return in lines what chirps say, and the automatic controller before and with it.

    Args:
        found: what the log says.
        robot: the arm as it was known before.
    """
    lines = []
    for j, name in enumerate(robot.joint_names):
        if math.isnan(found.evidence[j]):
            continue
        evidence = float(found.evidence[j])
        side = "undecided"
        if abs(evidence) > _DECIDED:
            side = "motor" if evidence > 0.0 else "link"
        rotor = "not determined by the data"
        if found.identified[j]:
            rotor = f"{found.rotor[j]:.3g} [{found.low[j]:.3g}, {found.high[j]:.3g}]"
        unit = "m" if robot.prismatic[j] else "rad"
        step = f"smallest step of its position {found.counts[j]:.2g} {unit}"
        if not found.counts[j] > 0.0:
            step = "its position never changed"
        lines.append(
            f"{name}: {side} (log-likelihood ratio {evidence:.3g}; beyond ±{_DECIDED:g} decides), "
            f"rotor inertia {rotor}, {step}"
        )
    sides = robot.drives.value("encoder_side").tolist()
    for name, side in zip(robot.joint_names, sides, strict=True):
        if side and found.side and side != found.side:
            lines.append(f"{name}: its drives say {side}, and the log {found.side}: one of them is wrong")
            break
    lines.append(f"automatic controller before: {_margins(robot)}")
    improved = robot.with_drives(found.add_to(robot.drives))
    lines.append(f"automatic controller with this log: {_margins(improved)}")
    return "\n".join(lines) + "\n"


def _margins(robot: Robot) -> str:
    """Return bandwidth and margins of an arm's automatic controller, at 1 kHz and one sample of delay."""
    arm = assume_gears(robot)
    try:
        controller = GPI.auto(arm, _SAMPLE_TIME, delay=_SAMPLE_TIME, bits=BITS)
        margins = verdict(controller, arm, BITS).describe()
    except ArmgpiError as error:
        return str(error)
    return f"bandwidth {describe_bandwidths(controller)}, {margins}"


def plain(found: Side, joint_names: Sequence[str]) -> dict[str, Any]:
    """Return what chirps say as plain data."""
    joints: dict[str, Any] = {}
    for place, name in enumerate(joint_names):
        evidence = float(found.evidence[place])
        rotor = None
        if found.identified[place]:
            rotor = [float(ends[place]) for ends in (found.low, found.rotor, found.high)]
        joints[name] = {"evidence": None if math.isnan(evidence) else evidence, "rotor_inertia": rotor}
    return {"side": found.side, "joints": joints}
