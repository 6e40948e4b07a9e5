"""The gears of an arm from its answer to a multisine: stiffness, damping, rotors, and the first mode."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import optimize

from armgpi.base.arrays import Array, check_number, check_type, check_whole
from armgpi.control.linear_arm import gravity_stiffness
from armgpi.errors import ParameterError, UnfitLog
from armgpi.identification.estimate import planned_rotors
from armgpi.identification.excitation import Excitation, blocked, free_configuration, ranges, surroundings
from armgpi.identification.logs import Grid, Log, resample
from armgpi.references.recorded import Recorded
from armgpi.robot.clearance import Clearance
from armgpi.robot.drives import Drives
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears, lowest_mode
from armgpi.tuning.two_mass import Gears as Modes
from armgpi.tuning.two_mass import damping_at_one

#: Amplitudes at lines.
_Complex: TypeAlias = npt.NDArray[np.complex128]
#: Period of the multisine [s], lines from 2 to 60 Hz, and series of phases of which the flattest is taken.
PERIOD = 2.0
LINES = np.unique(np.round(PERIOD * np.geomspace(2.0, 60.0, 40))) / PERIOD
_SERIES = 50
#: Each joint's turn: time to settle, periods that count, time to rest [s], and of the ramps.
_SETTLE, PERIODS, _REST, _RAMP = 2.0, 4, 0.5, 0.5
TURN = _SETTLE + PERIODS * PERIOD + _REST
#: Share of the range and of the speed that a joint may take, and sampling of the motion [s].
_RANGE, _SPEED, _SAMPLE = 0.03, 0.5, 0.002
#: Share of the torque that gravity leaves: with less, Coulomb friction bends the answer.
SHAKEN = 0.4
#: Configurations about which a motion is tried until it collides with nothing.
_CENTRES = 20
#: Step in which the beginning of the motion is looked for in a log [s].
_LOOK = 0.25
#: Widths of what is expected: logarithms of stiffness, damping, friction, links, of a rotor where it is
#: assumed and at least, and of both together, which is known; time between torque and position [s].
_STIFF, _DAMPED, _RUBBED, _LINKS, _ROTOR, _LEAST_ROTOR, _TOTAL = 1.5, 1.0, 3.0, 0.3, 0.5, 0.05, 0.05
_LATE, _UNKNOWNS = 3e-3, 6
#: Largest logarithm of a number, either way: steps of the search may be larger.
_LARGEST = 60.0
#: Damping ratio that is expected, and error of the linear model as a share of the torque: friction.
_RATIO, _LINEAR = 0.03, 0.05
#: Factor on standard deviations for what friction bends and no period shows: chosen on ur5 and panda
#: (tools/identification.py resonance, seed 300).
_UNSEEN = 2.0
#: Frequencies between the lines that show the noise of each.
_BETWEEN = 8
#: Weight of lines that do not fit, and stiffnesses over the assumed ones that the fit begins with; so many
#: weighings, and steps of each.
_ROBUST, _STARTS, _WEIGHINGS, _STEPS = 0.1, (0.025, 0.1, 0.4, 1.6, 6.0), 4, 25
#: Share that a log has to tell of a stiffness before it counts as measured; 95 % in standard deviations.
_DECIDED, _95 = 0.5, 1.96


class Gears(NamedTuple):
    """The gears of an arm; of joints that the log did not move, what was assumed.

    Attributes:
        stiffness: [N m/rad or N/m], (n,).
        damping: [N m s/rad or N s/m], (n,).
        rotor: inertia of the rotors [kg m^2 or kg], (n,).
        std: standard deviations of the logarithms of these three, (3, n).
        measured: which stiffnesses the log decided, (n,).
        side: where the encoders sit: "motor" or "link".
        mode: the lowest mode with free motors, in the middle of the ranges, and its 95 % interval [Hz], (3,).
        misfit: what the two-mass model leaves of torque and noise at the lines of each joint, (n,); NaN of
            others.
    """

    stiffness: Array
    damping: Array
    rotor: Array
    std: Array
    measured: Array
    side: str
    mode: Array
    misfit: Array

    def add_to(self, drives: Drives) -> Drives:
        """Return drives with the stiffness and damping of these gears."""
        for row, (name, values) in enumerate((("stiffness", self.stiffness), ("damping", self.damping))):
            spread = np.exp(_95 * self.std[row])
            value, low, high = (
                {
                    joint: float(x)
                    for joint, x, own in zip(drives.joint_names, each, self.measured, strict=True)
                    if own
                }
                for each in (values, values / spread, values * spread)
            )
            drives = drives.with_value(name, value, low, high, "identified")
        return drives


class _Turn(NamedTuple):
    """The answer to a joint's multisine, at the lines.

    Attributes:
        joint: its number.
        lines: frequencies that the log can show [Hz], (lines,).
        q: mean configuration [rad or m], (n,).
        tau: torque of the joint, of each period, (periods, lines).
        answer: positions of all joints, likewise, (periods, lines, n).
        noise: of the torque and the answers, as amplitudes, (lines, 1 + n).
    """

    joint: int
    lines: Array
    q: Array
    tau: _Complex
    answer: _Complex
    noise: Array


def shake(
    robot: Robot, share: float = SHAKEN, seed: int = 0, clearance: Clearance | None = None
) -> Excitation:
    """Return a motion that shows the gears: joint by joint, accelerations at lines from 2 to 60 Hz.

    A controller that feeds forward answers with torques at these lines. The arm stays within a few degrees
    of the middle of its ranges, or of a configuration in which it collides with nothing.

    Args:
        robot: the arm.
        share: of the torque that gravity leaves.
        seed: the same seed gives the same motion.
        clearance: what the arm must not touch; its own links and a floor if None.

    Raises:
        ParameterError: for an argument that cannot be, or an arm that cannot hold itself there.
    """
    check_type(robot, "robot", Robot, "a Robot")
    share = check_number(share, "share", "in (0, 1]", 0.0, 1.0, open_=True)
    rng = np.random.default_rng(check_whole(seed, "seed", 0))
    clear = surroundings(robot) if clearance is None else clearance
    failed: ParameterError | None = None
    for turn in range(_CENTRES):
        centre = robot.middle() if not turn else free_configuration(robot, rng, clear)
        try:
            motion = _shake_about(robot, centre, share, seed, clear)
        except ParameterError as error:
            failed = failed or error
            continue
        q = np.asarray(motion.reference.q)
        if (hit := clear.first_hit(q[clear.dense(q)])) is None:
            return motion
        failed = blocked(hit, clear)
    assert failed is not None
    raise failed


def _shake_about(robot: Robot, centre: Array, share: float, seed: int, clear: Clearance) -> Excitation:
    """Return the motion of :func:`shake` about a configuration (n,).

    Raises:
        ParameterError: for an arm that cannot hold itself there.
    """
    rng = np.random.default_rng(seed)
    lower, upper, speed = ranges(robot)
    spare = robot.limits.effort - np.abs(robot.gravity(centre))
    if not (spare > 0.0).all():
        name = robot.joint_names[int(spare.argmin())]
        raise ParameterError("robot", robot.name, f"an arm that {name} holds where it is shaken")
    rotor = planned_rotors(robot)
    inertia = np.diag(robot.mass_matrix(centre)) - robot.armature + rotor
    times = np.arange(0.0, robot.n * TURN + 0.5 * _SAMPLE, _SAMPLE)
    q = np.tile(centre, (len(times), 1))
    most = np.array([share * spare / inertia, _SPEED * speed, _RANGE * (upper - lower)])
    for joint in range(robot.n):
        since_begin = times - joint * TURN
        is_own = (since_begin >= 0.0) & (since_begin <= TURN)
        t = since_begin[is_own]
        ramp = np.clip(np.minimum(t, TURN - t) / _RAMP, 0.0, 1.0)
        rest_of_ramp = 10.0 - 15.0 * ramp + 6.0 * ramp**2
        series = _flattest(rng, t)
        scale = (most[:, joint] / np.abs(series).max(axis=1)).min()
        q[is_own, joint] += scale * series[2] * ramp**3 * rest_of_ramp
    reference = Recorded(times, q, source=f"multisine of {robot.name}, seed {seed}")
    target = reference.at(times)
    torque = np.abs(robot.gravity(centre) + inertia * target.a).max(axis=0)
    speed_share = np.abs(target.v).max(axis=0) / speed
    return Excitation(reference, speed_share, torque / robot.limits.effort, clear)


def _flattest(rng: np.random.Generator, t: Array) -> Array:
    """Return acceleration, speed and position of a multisine of unit lines at times (k,), (3, k)."""
    omega = 2.0 * math.pi * LINES
    some_times = t[:: max(1, len(t) // 2000), None]
    least_crest, first_angles = math.inf, np.zeros(len(LINES))
    for _ in range(_SERIES):
        angles = omega * some_times + rng.uniform(0.0, 2.0 * math.pi, len(LINES))
        crest = float(np.abs(np.cos(angles).sum(axis=1)).max())
        if crest < least_crest:
            least_crest, first_angles = crest, angles[0]
    angles = omega * t[:, None] + first_angles - omega * t[0]
    acceleration = np.cos(angles).sum(axis=1)
    speed = (np.sin(angles) / omega).sum(axis=1)
    position = -(np.cos(angles) / omega**2).sum(axis=1)
    return np.stack([acceleration, speed, position])


def find_gears(robot: Robot, log: Log, lag: Array, gravity: bool = True) -> Gears:
    """Return the gears that a log of :func:`shake` shows.

    Args:
        robot: the arm as it was identified, rotors and all.
        log: with torques.
        lag: time by which measured positions lag behind torques [s], (n,).
        gravity: whether the torques carry the arm's weight.

    Raises:
        UnfitLog: when the log shows no joint's multisine.
    """
    grid = resample(log)
    turns = list(_turns(grid))
    if not turns:
        wanted = f"expected the motion of armgpi excite --resonance, {TURN:g} s for each joint"
        raise UnfitLog([f"it shows no joint's multisine: {wanted} ({log.source})"])
    soft = assume_gears(robot)
    known = set(robot.drives.value("encoder_side").tolist()) - {""}
    sides = tuple(known) if len(known) == 1 else ("motor", "link")
    found = [_Fit(soft, turns, each, lag + 0.5 * grid.dt, gravity) for each in sides]
    return min(found, key=lambda each: each.cost).gears()


def _turns(grid: Grid) -> Iterator[_Turn]:
    """Find the joints' turns in a log, and their answers at the lines."""
    begin = _begin_of_turns(grid)
    length = round(PERIOD / grid.dt)
    # Below half the log's rate, with the frequencies that show the noise.
    lines = LINES[: np.searchsorted(LINES * PERIOD, length // 2 - _BETWEEN, "right")]
    if begin is None or not len(lines):
        return
    t = np.arange(length) * grid.dt
    waves = np.exp(2j * math.pi * lines * t[:, None])
    # A line's amplitude beside the position about which the joint moves, and its drift.
    basis = np.hstack([waves.real, waves.imag, np.ones((length, 1)), t[:, None]])
    inverse = np.linalg.pinv(basis)
    for joint in range(grid.q.shape[1]):
        first = begin + round((joint * TURN + _SETTLE) / grid.dt)
        periods = _whole_periods(grid, joint, first, length)
        if len(periods) < 2:
            continue
        factors = inverse @ periods
        cosines, sines, _ = np.split(factors, [len(lines), 2 * len(lines)], axis=1)
        amplitudes, noise = cosines - 1j * sines, _noise_at(lines, periods - basis @ factors)
        middle = periods[..., 1:].mean(axis=(0, 1))
        yield _Turn(joint, lines, middle, amplitudes[..., 0], amplitudes[..., 1:], noise)


def _begin_of_turns(grid: Grid) -> int | None:
    """Return the sample at which the motion begins, before 0 where the log begins later; None if too short.

    It is where the joints move in their own turns, and not in those of the others.
    """
    n, size = grid.q.shape[1], max(2, round(_LOOK / grid.dt))
    count = len(grid.q) // size
    turn, settling = round(TURN / _LOOK), round(_SETTLE / _LOOK)
    if count < turn - 2:
        return None
    blocks = grid.q[: count * size].reshape(count, size, n)
    moves = np.abs(np.diff(blocks, axis=1)).sum(axis=1)
    moves /= np.maximum(moves.max(axis=0), 1e-300)

    def moved_in_turns(begin: int) -> float:
        """Return how much the joints move in their own turns, if the motion begins at a block."""
        inside = 0.0
        for joint in range(n):
            own = begin + np.arange(joint * turn + settling, (joint + 1) * turn - 2)
            own = own[(own >= 0) & (own < count)]
            inside += float(moves[own, joint].sum())
        return inside

    begins = range(-(n - 1) * turn - settling, max(count - turn + 3, 1))
    return max(begins, key=moved_in_turns) * size


def _whole_periods(grid: Grid, joint: int, first: int, length: int) -> Array:
    """Return the periods in which a joint is excited and the log has no gap, (periods, length, 1 + n).

    Args:
        grid: the log.
        joint: which joint is excited.
        first: sample at which the first period begins.
        length: samples of a period.

    Returns:
        The torque of the joint [N m or N] and the positions of all [rad or m], at most `PERIODS` periods; of
        shape (0,) without such a period.
    """
    found = []
    for k in range(PERIODS):
        own = slice(first + k * length, first + (k + 1) * length)
        if own.start >= 0 and own.stop <= len(grid.q) and not grid.bad[own].any():
            found.append(np.hstack([grid.tau[own, joint : joint + 1], grid.q[own]]))
    return np.array(found)


def _noise_at(lines: Array, rest: Array) -> Array:
    """Return the noise of amplitudes at lines [Hz], as frequencies between them show it, (lines, columns).

    Counts of encoders, which repeat from period to period, and what friction bends are there as well.

    Args:
        lines: their frequencies.
        rest: what the lines leave of each period, (periods, samples, columns).
    """
    spectrum = np.abs(np.fft.rfft(rest, axis=1)) ** 2 * (2.0 / rest.shape[1]) ** 2
    line = np.round(lines * PERIOD).astype(int)
    between = np.setdiff1d(np.arange(line[0], line[-1] + _BETWEEN), line)
    nearest = np.abs(between - line[:, None]).argsort(axis=1)[:, :_BETWEEN]
    return np.asarray(np.sqrt(spectrum.mean(axis=0)[between[nearest]].mean(axis=1)))


class _Rest(NamedTuple):
    """What a model leaves of the torque of a turn.

    Attributes:
        left: at each line, (lines,).
        slope: its derivative, (lines, unknowns).
        own: how it falls with the position of the joint that turns, (lines,).
        own_slope: the derivative of that, (lines, unknowns).
        noise: what of it is noise of the torque and of the other joints' positions, (lines,).
    """

    left: _Complex
    slope: _Complex
    own: _Complex
    own_slope: _Complex
    noise: Array


class _Drives(NamedTuple):
    """The unknown numbers of the joints, each (n,).

    Attributes:
        stiffness: of the gears [N m/rad or N/m].
        damping: of the gears [N m s/rad or N s/m].
        rotor: inertia of the rotors [kg m^2 or kg].
        friction: viscous friction of the motors [N m s/rad or N s/m].
        share: square root of the inertia of the links over that of the model [-].
        late: time by which positions lag behind torques [s].
    """

    stiffness: Array
    damping: Array
    rotor: Array
    friction: Array
    share: Array
    late: Array


class _Torque(NamedTuple):
    """The torque of the joint that turns, linear in the positions at each line, and its derivatives.

    Attributes:
        row: torque for a position of each joint, (lines, n).
        motor: position of the joint's motor, (lines,).
        by_gear: derivative of the torque by the stiffness of each gear, (lines, n).
        by_share: the same by the logarithm of the share of each joint's links.
        own_by_gear: derivative of the row at the joint itself by the stiffness of each gear, (lines, n).
        own_by_share: the same by the logarithm of the share of each joint's links.
        own_by_motor: the same by what the motor alone takes for its position, (lines,).
    """

    row: _Complex
    motor: _Complex
    by_gear: _Complex
    by_share: _Complex
    own_by_gear: _Complex
    own_by_share: _Complex
    own_by_motor: _Complex


class _Model:
    """The two-mass model at the lines, for the turn of one joint.

    At a frequency s, links at q and motors at m obey (L s^2 + G) q = g (m - q) and, at the joint j that
    turns, torque = (J s^2 + f s) m_j + g_j (m_j - q_j), with g = K + B s. Others may rest in their friction.
    """

    def __init__(
        self, joint: int, s: _Complex, answer: _Complex, links: Array, steep: Array, drives: _Drives
    ) -> None:
        """Work out what both sides of the encoders have in common.

        Args:
            joint: that turns.
            s: frequencies [rad/s], imaginary, (lines,).
            answer: measured positions of all joints [rad or m], (lines, n).
            links: inertia L of the links, (n, n).
            steep: derivative G of their weight by the positions, (n, n).
            drives: of the joints.
        """
        self.joint, self.square, self.answer, self.links = joint, s**2, answer, links
        self.dynamic = links * self.square[:, None, None] + steep
        self.gear = drives.stiffness + drives.damping * s[:, None]
        self.motor_alone = drives.rotor[joint] * self.square + drives.friction[joint] * s

    def of_motors(self) -> _Torque:
        """Return the torque where positions are those of the motors."""
        j, n = self.joint, len(self.links)
        unit_torque = np.broadcast_to(np.eye(n)[j], self.answer.shape)
        right = np.stack([self.gear * self.answer, unit_torque], axis=-1)
        matrix = self.dynamic + self.gear[:, :, None] * np.eye(n)
        link, unit = np.moveaxis(np.linalg.solve(matrix, right), -1, 0)
        twist = self.answer - link
        lever = self.gear[:, j, None] * unit  # by how much joint j follows torques at the links
        row = -lever * self.gear
        row[:, j] += self.motor_alone + self.gear[:, j]
        by_gear = -lever * twist
        by_gear[:, j] += twist[:, j]
        by_share = self.square[:, None] * (lever * (link @ self.links) + (lever @ self.links) * link)
        own_by_gear = lever**2
        own_by_gear[:, j] += 1.0 - 2.0 * lever[:, j]
        own_by_share = 2.0 * self.square[:, None] * lever * (lever @ self.links)
        one = np.ones_like(self.square)
        return _Torque(row, self.answer[:, j], by_gear, by_share, own_by_gear, own_by_share, one)

    def of_links(self) -> _Torque:
        """Return the torque where positions are those of the links."""
        j = self.joint
        own_gear, own_links = self.gear[:, j], self.dynamic[:, j, j]
        spring = np.einsum("li,li->l", self.dynamic[:, j], self.answer)  # torque of the gear
        through = 1.0 + self.motor_alone / own_gear  # torque of the motor for one of the gear
        row = self.dynamic[:, j] * through[:, None]
        row[:, j] += self.motor_alone
        by_gear, own_by_gear, own_by_share = np.zeros((3, *self.answer.shape), dtype=complex)
        by_gear[:, j] = -self.motor_alone * spring / own_gear**2
        by_share = self.answer * self.links[j]
        by_share[:, j] += self.answer @ self.links[j]
        by_share = (self.square * through)[:, None] * by_share
        own_by_gear[:, j] = -own_links * self.motor_alone / own_gear**2
        own_by_share[:, j] = 2.0 * self.square * self.links[j, j] * through
        motor = self.answer[:, j] + spring / own_gear
        own_by_motor = 1.0 + own_links / own_gear
        return _Torque(row, motor, by_gear, by_share, own_by_gear, own_by_share, own_by_motor)


class _Fit:
    """The two-mass model of an arm beside the answers at the lines, for encoders at one side.

    Unknown of each joint are the logarithms of stiffness, damping, rotor, friction and of the share of its
    links, and the time between torque and position, in units of what is expected. The diagonal of D(q), links
    and rotor together, is known; which of them it is need not be. Of a turn, the torque of its joint alone is
    explained: others may rest in their friction.
    """

    def __init__(self, robot: Robot, turns: Sequence[_Turn], side: str, lag: Array, gravity: bool) -> None:
        """Find the gears that explain the torques best."""
        self.robot, self.turns, self.side, n = robot, turns, side, robot.n
        self.links = [robot.mass_matrix(turn.q) - np.diag(robot.armature) for turn in turns]
        self.steep = [gravity_stiffness(robot, turn.q) * float(gravity) for turn in turns]
        self.s: _Complex = np.asarray(2j * math.pi * turns[0].lines, dtype=np.complex128)
        rotor, stiffness = robot.armature, robot.drives.value("stiffness")
        low, high = robot.drives.interval("rotor_inertia")
        told = np.log(np.maximum(high, rotor) / np.maximum(low, 1e-3 * rotor)) / (2.0 * _95)
        width = np.clip(np.where(np.isfinite(told), told, _ROTOR), _LEAST_ROTOR, _ROTOR)
        links = np.diag(robot.mass_matrix(robot.middle())) - rotor
        at_one = damping_at_one(np.diag(links), Modes(rotor, stiffness))
        known = np.log([stiffness, _RATIO * at_one, rotor, 0.1 * at_one])
        least = np.full(n, lag.min())  # gears that twist look like a lag to whom takes them as rigid
        self.mean = np.concatenate([*known, 0.0 * lag, least])
        stds = [np.full(n, each) for each in (_STIFF, _DAMPED, _RUBBED, _LINKS)]
        self.std = np.concatenate([*stds[:2], width, *stds[2:], np.maximum(lag - least, _LATE)])
        best = []
        for factor in _STARTS:  # a spectrum has more than one valley
            x = np.zeros(_UNKNOWNS * n)
            x[:n] = math.log(factor) / _STIFF
            for _ in range(_WEIGHINGS):
                self.noise = [self._noise(x, i) for i in range(len(turns))]
                x = optimize.least_squares(self._residuals, x, self._slopes, max_nfev=_STEPS).x
            best.append((self._cost(x), x))
        self.cost, self.x = min(best, key=lambda each: each[0])
        self.noise = [self._noise(self.x, i) for i in range(len(turns))]

    def _cost(self, x: Array) -> float:
        """Return how badly gears explain the torques, with lines that do not fit at all counting less."""
        relative = []
        for index in range(len(self.turns)):
            left, scale = self._compare(x, index)
            relative.append(left / scale)
        return float(np.log(np.concatenate(relative) + 1e-3).sum() + 0.5 * x @ x)

    def _compare(self, x: Array, index: int) -> tuple[Array, Array]:
        """Return what is left of the torque of a turn at each line, and torque and noise together."""
        rest, turn = self._rest(x, index), self.turns[index]
        torque = turn.tau.mean(axis=0)
        by_position = rest.own * turn.noise[:, 1 + turn.joint]
        scale = np.linalg.norm(np.abs([torque, rest.noise, by_position]), axis=0)
        return np.abs(rest.left), scale

    def _noise(self, x: Array, index: int) -> Array:
        """Return the noise of the residual at each line, but for that of the joint's own position."""
        rest = self._rest(x, index)
        torque = np.abs(self.turns[index].tau.mean(axis=0))
        measured = 0.5 * rest.noise**2  # of a real part
        not_linear = (_LINEAR * torque) ** 2
        does_not_fit = _ROBUST * np.abs(rest.left) * torque
        return np.asarray(np.sqrt(measured + not_linear + does_not_fit))

    def _residuals(self, x: Array) -> Array:
        """Return what is left of the torques in units of its noise, and of what is expected."""
        left = np.concatenate([self._weigh(x, i)[0] for i in range(len(self.turns))])
        return np.concatenate([left.real, left.imag, self._sum(x)[0], x])

    def _slopes(self, x: Array) -> Array:
        """Return the derivative of that."""
        rows = np.concatenate([self._weigh(x, i)[1] for i in range(len(self.turns))])
        return np.concatenate([rows.real, rows.imag, self._sum(x)[1], np.eye(len(x))])

    def _weigh(self, x: Array, index: int) -> tuple[_Complex, _Complex]:
        """Return what is left of the torque of a turn in units of its noise, and the derivative.

        The noise of the position counts by as much as the model makes of it: frozen, soft gears, which make
        more of it, would look worse than they are.
        """
        rest, turn = self._rest(x, index), self.turns[index]
        of_position = math.sqrt(0.5) * turn.noise[:, 1 + turn.joint]
        noise = np.hypot(self.noise[index], of_position * np.abs(rest.own))
        half_square_grows = (np.conj(rest.own)[:, None] * rest.own_slope).real
        grows = half_square_grows * (of_position**2 / noise**3)[:, None]
        slope = rest.slope / noise[:, None] - rest.left[:, None] * grows
        return rest.left / noise, slope

    def _sum(self, x: Array) -> tuple[Array, Array]:
        """Return how far each joint's inertia is off in the middle, over its width, and the derivative."""
        n, known_rotor = self.robot.n, self.robot.armature
        known_links = np.diag(self.robot.mass_matrix(self.robot.middle())) - known_rotor
        values = (self.mean + self.std * x).reshape(_UNKNOWNS, n)
        rotor = np.exp(values[2])
        links = np.exp(2.0 * values[4]) * known_links
        total = rotor + links
        off = np.log(total / (known_links + known_rotor))
        slope = np.zeros((n, _UNKNOWNS, n))
        joints = np.arange(n)
        slope[joints, 2, joints] = rotor / total
        slope[joints, 4, joints] = links * 2.0 / total
        return off / _TOTAL, slope.reshape(n, -1) * self.std / _TOTAL

    def _rest(self, x: Array, index: int) -> _Rest:
        """Return what is left of the torque of a turn, and how it changes with the unknowns."""
        turn, s, n = self.turns[index], self.s, self.robot.n
        j, answer, drives = turn.joint, turn.answer.mean(axis=0), self._drives(x)
        links = np.outer(drives.share, drives.share) * self.links[index]
        model = _Model(j, s, answer, links, self.steep[index], drives)
        torque = model.of_motors() if self.side == "motor" else model.of_links()
        measured = np.exp(-s * drives.late[j]) * turn.tau.mean(axis=0)
        slope, own_slope = np.zeros((2, len(s), _UNKNOWNS, n), dtype=complex)
        slope[:, 0] = -torque.by_gear * drives.stiffness
        slope[:, 1] = -torque.by_gear * drives.damping * s[:, None]
        slope[:, 2, j] = -torque.motor * drives.rotor[j] * s**2
        slope[:, 3, j] = -torque.motor * drives.friction[j] * s
        slope[:, 4] = -torque.by_share
        slope[:, 5, j] = -s * measured
        own_slope[:, 0] = torque.own_by_gear * drives.stiffness
        own_slope[:, 1] = torque.own_by_gear * drives.damping * s[:, None]
        own_slope[:, 2, j] = torque.own_by_motor * drives.rotor[j] * s**2
        own_slope[:, 3, j] = torque.own_by_motor * drives.friction[j] * s
        own_slope[:, 4] = torque.own_by_share
        # The noise of the joint's own position is weighed apart; in its place is that of the torque.
        noise = np.abs(torque.row * turn.noise[:, 1:])
        noise[:, j] = turn.noise[:, 0]
        return _Rest(
            measured - (torque.row * answer).sum(axis=1),
            slope.reshape(len(s), -1) * self.std,
            torque.row[:, j],
            own_slope.reshape(len(s), -1) * self.std,
            np.linalg.norm(noise, axis=1),
        )

    def _drives(self, x: Array) -> _Drives:
        """Return the numbers of the joints that unknowns stand for."""
        n, values = self.robot.n, self.mean + self.std * x
        logarithms = np.clip(values[: 5 * n], -_LARGEST, _LARGEST)
        stiffness, damping, rotor, friction, share = np.exp(logarithms).reshape(5, n)
        return _Drives(stiffness, damping, rotor, friction, share, values[5 * n :])

    def gears(self) -> Gears:
        """Return the gears, with intervals."""
        n, x = self.robot.n, self.x
        covariance = self._covariance()
        std = np.minimum(self.std * np.sqrt(np.diag(covariance)), self.std)
        stiffness, damping, rotor = np.exp((self.mean + self.std * x)[: 3 * n]).reshape(3, n)
        measured = np.zeros(n, dtype=bool)
        measured[[turn.joint for turn in self.turns]] = True
        measured &= std[:n] < (1.0 - _DECIDED) * self.std[:n]
        mode = self._mode(x)
        slope = self._mode_slope(mode)
        half_width = _95 * math.sqrt(float(slope @ covariance @ slope))
        factor = half_width / mode
        ends = np.array([mode, mode * math.exp(-factor), mode * math.exp(factor)])
        stds = std[: 3 * n].reshape(3, n)
        return Gears(stiffness, damping, rotor, stds, measured, self.side, ends, self._misfits())

    def _covariance(self) -> Array:
        """Return the covariance of the unknowns, in units of what is expected, widened for unseen misfit."""
        count = len(self.x)
        residuals = self._residuals(self.x)[:-count]  # what is expected comes last
        slopes = self._slopes(self.x)[:-count]
        variance = max(1.0, float((residuals**2).mean()))
        covariance = np.linalg.inv(slopes.T @ slopes / variance + np.eye(count))
        covariance *= _UNSEEN**2
        return np.asarray(covariance)

    def _mode_slope(self, mode: float) -> Array:
        """Return how the lowest mode changes with the unknowns, lags left out."""
        step = 1e-4
        steps = step * np.eye(len(self.x))
        slope = np.zeros(len(self.x))
        for place in range(5 * self.robot.n):
            slope[place] = (self._mode(self.x + steps[place]) - mode) / step
        return slope

    def _misfits(self) -> Array:
        """Return what is left of torques over torque and noise, (n,); NaN of joints that were not shaken."""
        misfits = np.full(self.robot.n, np.nan)
        for index, turn in enumerate(self.turns):
            left, scale = self._compare(self.x, index)
            misfits[turn.joint] = np.linalg.norm(left) / np.linalg.norm(scale)
        return misfits

    def _mode(self, x: Array) -> float:
        """Return the lowest mode in the middle of the ranges [Hz]."""
        values = (self.mean + self.std * x)[: -self.robot.n]
        stiffness, _, rotor, _, share = np.exp(values).reshape(5, -1)
        links = self.robot.mass_matrix(self.robot.middle()) - np.diag(self.robot.armature)
        return lowest_mode(np.outer(share, share) * links, rotor, stiffness)
