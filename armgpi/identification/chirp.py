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
from armgpi.identification.excitation import Excitation, blocked, free_configuration, ranges, surroundings
from armgpi.identification.logs import Grid, Log, read_log, resample, with_torques
from armgpi.references.recorded import Recorded
from armgpi.robot.clearance import Clearance
from armgpi.robot.drives import Drives
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears
from armgpi.tuning.rule import BITS, usual_effort
from armgpi.tuning.verdict import describe_bandwidths, verdict

#: Ends of the chirp [Hz], its length, the time to settle before it and to come to rest after it [s].
LOWEST, HIGHEST = 4.0, 160.0
CHIRP, _BEFORE, _AFTER = 1.0, 0.5, 0.5
TURN = _BEFORE + CHIRP + _AFTER
#: Share of the usual effort that the chirp takes, and of the effort that gravity leaves at most.
SHARE, _SPARE = 0.15, 0.4
#: Share of the range that a joint may take, sampling of the motion [s], and share of the chirp that its ramps
#: take.
_RANGE, _SAMPLE, _RAMP = 0.03, 5e-4, 0.06
#: Configurations about which a motion is tried until it collides with nothing.
_CENTRES = 20
#: Share of the fast changes of a joint's torque that has to be in its turn, on average.
_INSIDE = 0.5
#: Time after the chirp in which its answer ends [s]; frequencies that are compared begin here [Hz], and end
#: at a share of the log's rate.
_RINGS, _FROM, _UP_TO = 0.35, 6.0, 0.33
#: Standard deviations of what is expected: of logarithms of links, rotor, stiffness, damping ratio and
#: friction; and of the time between torque and position [s].
_LINKS, _ROTOR, _STIFFNESS, _DAMPING, _FRICTION, _LATE = 0.4, 0.7, 1.2, 0.8, 1.5, 2e-3
#: Damping ratio and friction over 2 sqrt(K J) that are expected.
_RATIO, _RUB = 0.03, 0.05
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
#: Resolution of an encoder that showed no motion [bits].
_COARSEST = 6.0
#: Sample time of the controllers whose margins are printed [s].
_SAMPLE_TIME = 1e-3
#: Half width of a 95 % interval in standard deviations.
_95 = 1.96
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
        rows = zip(drives.joint_names, self.rotor, self.low, self.high, self.identified, strict=True)
        known = {joint: (float(x), float(least), float(most)) for joint, x, least, most, own in rows if own}
        if known:
            value, low, high = ({joint: row[k] for joint, row in known.items()} for k in range(3))
            drives = drives.with_value("rotor_inertia", value, low, high, "identified")
        moved = [j for j, each in zip(drives.joint_names, self.evidence, strict=True) if math.isfinite(each)]
        if self.side and moved:
            side = dict.fromkeys(moved, self.side)
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
        t = times - j * TURN - _BEFORE
        own = (t >= 0.0) & (t <= CHIRP)
        shape = _shape(t[own])
        largest = np.abs(np.gradient(np.gradient(shape, _SAMPLE), _SAMPLE)).max()
        fastest = np.abs(np.gradient(shape, _SAMPLE)).max()
        limits = np.array(
            [
                torque[j] / (inertia[j] * largest),
                0.5 * speed[j] / fastest,
                _RANGE * (upper[j] - lower[j]) / np.abs(shape).max(),
            ]
        )
        q[own, j] += limits.min() * shape
    reference = Recorded(times, q, source=f"chirps of {robot.name}")
    target = reference.at(times)
    moved = np.abs(robot.gravity(centre)) + inertia * np.abs(target.a).max(axis=0)
    return Excitation(reference, np.abs(target.v).max(axis=0) / speed, moved / robot.limits.effort, clear)


def _with_gears(robot: Robot) -> Robot:
    """Return an arm with rotors and stiffness, assumed ones where nothing is known.

    Raises:
        ParameterError: for an arm without rotors.
    """
    soft = assume_gears(robot)
    stiff = ~np.isfinite(soft.drives.value("stiffness")) | ~(soft.armature > 0.0)
    if stiff.any():
        name = robot.joint_names[int(stiff.argmax())]
        wanted = f"an arm with rotors; {name} has none, and both sides of a direct drive are one"
        raise ParameterError("robot", robot.name, wanted)
    return soft


def _shape(t: Array) -> Array:
    """Return positions whose accelerations are a chirp of one size, at times (k,) from 0 to its length."""
    rate = math.log(HIGHEST / LOWEST) / CHIRP
    frequency = LOWEST * np.exp(rate * t)
    phase = 2.0 * math.pi * (frequency - LOWEST) / rate
    ramp = np.clip(np.minimum(t, CHIRP - t) / (_RAMP * CHIRP), 0.0, 1.0)
    window = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    return np.asarray(-np.sin(phase) / (2.0 * math.pi * frequency) ** 2 * window)


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
    soft, n = _with_gears(robot), robot.n
    coarse: list[int] = []
    responses = list(_responses(soft, grid, counts, coarse))
    if not responses and not coarse:
        wanted = f"expected the motion of armgpi excite --side, {TURN:g} s for each joint"
        raise UnfitLog([f"it shows no joint's chirp: {wanted} ({log.source})"])
    fits = {
        each.joint: {side: _fit(soft, each, grid.dt, side) for side in ("motor", "link")}
        for each in responses
    }
    evidence = np.full(n, np.nan)
    evidence[coarse] = 0.0
    for j, both in fits.items():
        evidence[j] = both["link"].cost - both["motor"].cost
    side = _judge(evidence)
    rotor, low, high = np.tile(soft.armature, (3, 1))
    low, high = soft.drives.interval("rotor_inertia")
    low, high = np.where(np.isnan(low), rotor, low), np.where(np.isnan(high), rotor, high)
    identified = np.zeros(n, dtype=bool)
    late = []
    for j, both in fits.items() if side else ():
        found = both[side]
        late.append(_LATE * found.x[5] + 1.5 * grid.dt)
        # Behind the elasticity a rotor cannot be told from the link: it came out up to six times too heavy.
        if side == "motor" and found.std < _LEARNED * _ROTOR:
            value = soft.armature[j] * math.exp(_ROTOR * found.x[1])
            spread = math.exp(_95 * found.std)
            rotor[j], low[j], high[j], identified[j] = value, value / spread, value * spread, True
    return Side(
        side,
        evidence,
        rotor,
        low,
        high,
        identified,
        float(np.median(late)) if late else math.nan,
        counts,
    )


def _judge(evidence: Array) -> str:
    """Return the side that joints agree on; "" where none tells it, or where they contradict each other."""
    told = evidence[np.isfinite(evidence)]
    strong = told[np.abs(told) > _DECIDED]
    total = float(told.sum())
    if not len(strong) or abs(total) <= _DECIDED:
        return ""
    # A joint that says the other one as clearly is no chance.
    if (
        (strong > 0.0).any()
        and (strong < 0.0).any()
        and np.abs(strong[strong * total < 0.0]).max() > 0.2 * abs(total)
    ):
        return ""
    return "motor" if total > 0.0 else "link"


def _counts(q: Array) -> Array:
    """Return the smallest step of each joint in positions as logged [rad or m], (k, n): (n,).

    Positions between samples are no measure of it: interpolation makes steps of any size.
    """
    steps = np.abs(np.diff(q, axis=0))
    largest = steps.max(axis=0)
    steps = np.where(steps > 1e-9 * np.maximum(largest, 1e-300), steps, np.inf)
    least = steps.min(axis=0)
    return np.asarray(np.where(np.isfinite(least), least, 0.0))


def _begin(robot: Robot, grid: Grid) -> int | None:
    """Return the sample at which the motion began: where the torques' chirps are in their turns; or None."""
    width = max(1, round(0.05 / grid.dt))
    fast = np.diff(grid.tau, n=2, axis=0) ** 2
    blocks = fast[: len(fast) // width * width].reshape(-1, width, robot.n).sum(axis=1)
    blocks = np.maximum(blocks - np.median(blocks, axis=0), 0.0)  # without the noise that is always there
    blocks /= np.maximum(blocks.sum(axis=0), 1e-300)
    turn, before, length = (round(each / (width * grid.dt)) for each in (TURN, _BEFORE, CHIRP))
    best, begin, whole = -1.0, 0, 1
    for start in range(-(robot.n - 1) * turn, max(len(blocks) - turn, 0) + 1):
        first = start + before + turn * np.arange(robot.n)
        there = [j for j in range(robot.n) if first[j] >= 0 and first[j] + length <= len(blocks)]
        inside = float(sum(blocks[first[j] : first[j] + length, j].sum() for j in there))
        if inside > best + 1e-12:
            best, begin, whole = inside, start, len(there)
    return begin * width if whole and best > _INSIDE * whole else None


def _responses(robot: Robot, grid: Grid, count: Array, coarse: list[int]) -> Iterator[_Response]:
    """Find the joints' chirps in a log, and their answers at frequencies.

    Args:
        robot: the arm with rotors.
        grid: the log.
        count: smallest step of each joint's positions [rad or m], (n,); 0 of those that never changed.
        coarse: takes the joints whose encoders are too coarse for their answers.
    """
    begin = _begin(robot, grid)
    if begin is None:
        return
    # Of a joint whose position never changed the counts are coarser than its motion.
    count = np.where(count > 0.0, count, robot.encoder_count(_COARSEST))
    heaviest = np.fmax(robot.drives.interval("rotor_inertia")[1], robot.armature)
    for j in range(robot.n):
        start = begin + round((j * TURN + _BEFORE - 0.1) / grid.dt)
        end = begin + round((j * TURN + _BEFORE + CHIRP + _RINGS) / grid.dt)
        if start < 0 or end > len(grid.q) or grid.bad[start:end].any():
            continue
        part = slice(start, end)
        t = grid.dt * np.arange(end - start)
        lines = np.arange(_FROM, min(HIGHEST, _UP_TO / grid.dt), 1.0 / CHIRP)
        if len(lines) < _FEWEST:
            continue
        waves = np.exp(-2j * math.pi * lines[:, None] * t)
        both = [_level(signal[part, j]) @ waves.T * grid.dt for signal in (grid.q, grid.tau)]
        position, torque = both
        # The transform of the noise of one sample, of counts as they are rounded.
        noise = count[j] / math.sqrt(12.0) * math.sqrt(end - start) * grid.dt
        # Where not even the heaviest rotor that is expected would move by a count, a position that stands
        # still says nothing: counts are no white noise then.
        size = math.sqrt(2.0) * float(_level(grid.tau[part, j]).std())
        seen = size / (heaviest[j] * (2.0 * math.pi * lines) ** 2) > count[j]
        strong = (np.abs(torque) > 0.05 * np.abs(torque).max()) & seen
        if strong.sum() < _FEWEST:
            coarse.append(j)
            continue
        yield _Response(
            j,
            lines[strong],
            (position / np.where(strong, torque, 1.0))[strong],
            noise / np.abs(torque[strong]),
            grid.q[part].mean(axis=0),
        )


def _level(values: Array) -> Array:
    """Return a signal without the line between its ends, so that it begins and ends at zero."""
    edge = max(1, len(values) // 50)
    first, last = values[:edge].mean(), values[-edge:].mean()
    return np.asarray(values - first - (last - first) * np.linspace(0.0, 1.0, len(values)))


def _fit(robot: Robot, response: _Response, dt: float, side: str) -> _Fitted:
    """Return the two-mass model of a joint that explains a response best, for encoders at one side."""
    j = response.joint
    rotor = float(robot.armature[j])
    links = float(robot.mass_matrix(response.q)[j, j]) - rotor
    stiffness = float(robot.drives.value("stiffness")[j])
    best: tuple[float, Array] | None = None

    def residuals(x: Array) -> Array:
        model = _model(x, response.lines, dt, (links, rotor, stiffness), side)
        sigma = np.hypot(_MODEL * np.abs(model), response.noise)
        rest = (response.ratio - model) / sigma / math.sqrt(_ALIKE)
        # The width of the noise belongs to the likelihood: ln sigma beside what a perfect ratio would have.
        width = np.log(sigma / np.hypot(_MODEL * np.abs(response.ratio), response.noise)) * 2.0 / _ALIKE
        return np.concatenate([rest.real, rest.imag, np.sqrt(np.maximum(2.0 * width + 20.0, 0.0)), x])

    for factor in _STARTS:
        x = np.zeros(6)
        x[2] = math.log(factor) / _STIFFNESS
        found = optimize.least_squares(residuals, x, loss="soft_l1", f_scale=3.0, max_nfev=60)
        if best is None or found.cost < best[0]:
            best = float(found.cost), np.asarray(found.x)
            jacobian = found.jac
    assert best is not None
    covariance = np.linalg.inv(jacobian.T @ jacobian + 1e-9 * np.eye(6))
    std = _ROTOR * math.sqrt(float(covariance[1, 1]))
    return _Fitted(best[0], best[1], math.hypot(std, _UNSEEN))


def _model(x: Array, lines: Array, dt: float, known: Sequence[float], side: str) -> Array:
    """Return position over torque of a two-mass model at frequencies [Hz]."""
    links, rotor, stiffness = known
    M = links * math.exp(_LINKS * x[0])
    J = rotor * math.exp(_ROTOR * x[1])
    K = stiffness * math.exp(_STIFFNESS * x[2])
    B = 2.0 * _RATIO * math.exp(_DAMPING * x[3]) * math.sqrt(K * M * J / (M + J))
    f = 2.0 * _RUB * math.exp(_FRICTION * x[4]) * math.sqrt(K * J)
    s = 2j * math.pi * lines
    gear = K + B * s
    link, motor = M * s**2 + gear, J * s**2 + f * s + gear
    late = np.exp(-s * (_LATE * x[5] + 1.5 * dt))
    return np.asarray((link if side == "motor" else gear) / (motor * link - gear**2) * late)


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
    there = with_torques(read_log(log, robot, columns=columns), constants)
    kind = there.torque if torque is None else torque
    return find_side(robot, there._replace(torque=kind))


def judge_side(found: Side, joint_names: Sequence[str], accepted: bool = False) -> Verdict:
    """Return the verdict on a log of chirps: whether it decides the side of the encoders.

    Args:
        found: what the log says.
        joint_names: of the arm.
        accepted: whether joints without a chirp in the log are accepted.
    """
    left_out = [
        f"{name}: no chirp in the log"
        for name, each in zip(joint_names, found.evidence, strict=True)
        if math.isnan(each)
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
        told = float(found.evidence[j])
        side = "motor" if told > _DECIDED else "link" if told < -_DECIDED else "undecided"
        rotor = "not determined by the data"
        if found.identified[j]:
            rotor = f"{found.rotor[j]:.3g} [{found.low[j]:.3g}, {found.high[j]:.3g}]"
        unit = "m" if robot.prismatic[j] else "rad"
        step = f"smallest step of its position {found.counts[j]:.2g} {unit}"
        if not found.counts[j] > 0.0:
            step = "its position never changed"
        lines.append(
            f"{name}: {side} (log-likelihood ratio {told:.3g}; beyond ±{_DECIDED:g} decides), rotor inertia "
            f"{rotor}, {step}"
        )
    known = robot.drives.value("encoder_side").tolist()
    for name, side in zip(robot.joint_names, known, strict=True):
        if side and found.side and side != found.side:
            lines.append(f"{name}: its drives say {side}, and the log {found.side}: one of them is wrong")
            break
    for label, drives in (("before", robot.drives), ("with this log", found.add_to(robot.drives))):
        lines.append(f"automatic controller {label}: {_margins(robot.with_drives(drives))}")
    return "\n".join(lines) + "\n"


def _margins(robot: Robot) -> str:
    """Return bandwidth and margins of an arm's automatic controller, at 1 kHz and one sample of delay."""
    arm = assume_gears(robot)
    try:
        controller = GPI.auto(arm, _SAMPLE_TIME, delay=_SAMPLE_TIME, bits=BITS)
        said = verdict(controller, arm, BITS).describe()
    except ArmgpiError as error:
        return str(error)
    return f"bandwidth {describe_bandwidths(controller)}, {said}"


def plain(found: Side, joint_names: Sequence[str]) -> dict[str, Any]:
    """Return what chirps say as plain data."""
    rows = zip(joint_names, found.evidence, found.rotor, found.low, found.high, found.identified, strict=True)
    joints = {
        name: {
            "evidence": None if math.isnan(evidence) else float(evidence),
            "rotor_inertia": [float(low), float(rotor), float(high)] if own else None,
        }
        for name, evidence, rotor, low, high, own in rows
    }
    return {"side": found.side, "joints": joints}
