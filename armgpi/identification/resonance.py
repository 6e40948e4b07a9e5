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
from armgpi.identification.estimate import HALF_95, planned_rotors
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
_SPACED = np.geomspace(2.0, 60.0, 40)
LINES = np.unique(np.round(PERIOD * _SPACED)) / PERIOD
_SERIES = 50
#: Of each joint's turn: time to settle [s].
_SETTLE = 2.0
#: Periods that count.
PERIODS = 4
#: Time to come to rest [s].
_REST = 0.5
#: Length of its ramps [s].
_RAMP = 0.5
TURN = _SETTLE + PERIODS * PERIOD + _REST
#: Share of its range that a joint may take.
_RANGE = 0.03
#: Share of its speed limit that a joint may take.
_SPEED = 0.5
#: Sampling of the motion [s].
_SAMPLE = 0.002
#: Share of the torque that gravity leaves: with less, Coulomb friction bends the answer.
SHAKEN = 0.4
#: Configurations about which a motion is tried until it collides with nothing.
_CENTRES = 20
#: Step in which the beginning of the motion is looked for in a log [s].
_LOOK = 0.25
#: Standard deviations of the logarithms of what is expected: stiffness, damping and friction.
_STIFF = 1.5
_DAMPED = 1.0
_RUBBED = 3.0
#: The same of the inertia of the links.
_LINKS = 0.3
#: The same of a rotor where it is assumed, and at least.
_ROTOR = 0.5
_LEAST_ROTOR = 0.05
#: The same of links and rotor together, which are known.
_TOTAL = 0.05
#: Standard deviation of the time between torque and position, at least [s].
_LATE = 3e-3
#: Unknowns of each joint: the fields of :class:`_Drives`.
_UNKNOWNS = 6
#: Largest logarithm of a number, either way: steps of the search may be larger.
_LARGEST = 60.0
#: Damping ratio that is expected, and the friction, over 2 sqrt(K J).
_RATIO = 0.03
_RUB = 0.1
#: Error of the linear model as a share of the torque: friction.
_LINEAR = 0.05
#: Factor on standard deviations for what friction bends and no period shows: chosen on ur5 and panda
#: (tools/identification.py resonance, seed 300).
_UNSEEN = 2.0
#: Frequencies between the lines that show the noise of each.
_BETWEEN = 8
#: Weight of lines that do not fit.
_ROBUST = 0.1
#: Stiffnesses over the assumed ones that the fit begins with.
_STARTS = (0.025, 0.1, 0.4, 1.6, 6.0)
#: Weighings of each of them, and steps of the search in each.
_WEIGHINGS = 4
_STEPS = 25
#: Share that a log has to tell of a stiffness before it counts as measured.
_DECIDED = 0.5
#: Step of the unknowns in which the change of the first mode is looked for.
_STEP = 1e-4


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
        measured = np.flatnonzero(self.measured)
        for row, name in enumerate(("stiffness", "damping")):
            values: Array = (self.stiffness, self.damping)[row]
            spread = np.exp(HALF_95 * self.std[row])
            low, high = values / spread, values * spread
            value_of, low_of, high_of = {}, {}, {}
            for place in measured:
                joint = drives.joint_names[place]
                value_of[joint] = float(values[place])
                low_of[joint] = float(low[place])
                high_of[joint] = float(high[place])
            drives = drives.with_value(name, value_of, low_of, high_of, "identified")
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
    most_acceleration = share * spare / inertia
    most_displacement = _RANGE * (upper - lower)
    most = np.array([most_acceleration, _SPEED * speed, most_displacement])
    for joint in range(robot.n):
        since_begin = times - joint * TURN
        is_own = (since_begin >= 0.0) & (since_begin <= TURN)
        t = since_begin[is_own]
        to_end = np.minimum(t, TURN - t)
        ramp = np.clip(to_end / _RAMP, 0.0, 1.0)
        rest_of_ramp = 10.0 - 15.0 * ramp + 6.0 * ramp**2
        series = _flattest(rng, t)
        largest = np.abs(series).max(axis=1)
        scale = (most[:, joint] / largest).min()
        q[is_own, joint] += scale * series[2] * ramp**3 * rest_of_ramp
    reference = Recorded(times, q, source=f"multisine of {robot.name}, seed {seed}")
    target = reference.at(times)
    torque = np.abs(robot.gravity(centre) + inertia * target.a)
    largest_torque = torque.max(axis=0)
    speed_share = np.abs(target.v).max(axis=0) / speed
    return Excitation(reference, speed_share, largest_torque / robot.limits.effort, clear)


def _flattest(rng: np.random.Generator, t: Array) -> Array:
    """Return acceleration, speed and position of a multisine of unit lines at times (k,), (3, k)."""
    omega = 2.0 * math.pi * LINES
    some_times = t[:: max(1, len(t) // 2000), None]
    least_crest, first_angles = math.inf, np.zeros(len(LINES))
    for _ in range(_SERIES):
        phases = rng.uniform(0.0, 2.0 * math.pi, len(LINES))
        angles = omega * some_times + phases
        acceleration = np.cos(angles).sum(axis=1)
        crest = float(np.abs(acceleration).max())
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
    known_sides = set(robot.drives.value("encoder_side").tolist()) - {""}
    sides = tuple(known_sides) if len(known_sides) == 1 else ("motor", "link")
    lag_of_middle = lag + 0.5 * grid.dt
    fits = [_Fit(soft, turns, side, lag_of_middle, gravity) for side in sides]
    return min(fits, key=lambda fit: fit.cost).gears()


def _turns(grid: Grid) -> Iterator[_Turn]:
    """Find the joints' turns in a log, and their answers at the lines."""
    begin = _begin_of_turns(grid)
    length = round(PERIOD / grid.dt)
    # Below half the log's rate, with the frequencies that show the noise.
    shown = np.searchsorted(LINES * PERIOD, length // 2 - _BETWEEN, "right")
    lines = LINES[:shown]
    if begin is None or not len(lines):
        return
    t = np.arange(length) * grid.dt
    waves = np.exp(2j * math.pi * lines * t[:, None])
    # A line's amplitude beside the position about which the joint moves, and its drift.
    middle_and_drift = np.stack([np.ones(length), t], axis=1)
    basis = np.hstack([waves.real, waves.imag, middle_and_drift])
    inverse = np.linalg.pinv(basis)
    for joint in range(grid.q.shape[1]):
        first = begin + round((joint * TURN + _SETTLE) / grid.dt)
        periods = _whole_periods(grid, joint, first, length)
        if len(periods) < 2:
            continue
        factors = inverse @ periods
        cosines = factors[:, : len(lines)]
        sines = factors[:, len(lines) : 2 * len(lines)]
        amplitudes = cosines - 1j * sines
        torque, positions = amplitudes[..., 0], amplitudes[..., 1:]
        noise = _noise_at(lines, periods - basis @ factors)
        middle = periods[..., 1:].mean(axis=(0, 1))
        yield _Turn(joint, lines, middle, torque, positions, noise)


def _begin_of_turns(grid: Grid) -> int | None:
    """Return the sample at which the motion begins, before 0 where the log begins later; None if too short.

    It is where the joints move in their own turns, and not in those of the others.
    """
    n = grid.q.shape[1]
    size = max(2, round(_LOOK / grid.dt))
    count = len(grid.q) // size
    turn, settling = round(TURN / _LOOK), round(_SETTLE / _LOOK)
    if count < turn - 2:
        return None
    blocks = grid.q[: count * size].reshape(count, size, n)
    steps = np.abs(np.diff(blocks, axis=1))
    moves = steps.sum(axis=1)
    moves /= np.maximum(moves.max(axis=0), 1e-300)

    def moved_in_turns(begin: int) -> float:
        """Return how much the joints move in their own turns, if the motion begins at a block."""
        inside = 0.0
        for joint in range(n):
            in_turn = np.arange(joint * turn + settling, (joint + 1) * turn - 2)
            places = begin + in_turn
            is_inside = (places >= 0) & (places < count)
            inside += float(moves[places[is_inside], joint].sum())
        return inside

    earliest = -(n - 1) * turn - settling
    begins = range(earliest, max(count - turn + 3, 1))
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
    periods = []
    for k in range(PERIODS):
        start = first + k * length
        end = start + length
        is_whole = start >= 0 and end <= len(grid.q)
        if is_whole and not grid.bad[start:end].any():
            torque = grid.tau[start:end, joint]
            periods.append(np.column_stack([torque, grid.q[start:end]]))
    return np.array(periods)


def _noise_at(lines: Array, unexplained: Array) -> Array:
    """Return the noise of amplitudes at lines [Hz], as frequencies between them show it, (lines, columns).

    Counts of encoders, which repeat from period to period, and what friction bends are there as well.

    Args:
        lines: their frequencies.
        unexplained: what the lines leave of each period, (periods, samples, columns).
    """
    transform = np.abs(np.fft.rfft(unexplained, axis=1))
    spectrum = transform**2 * (2.0 / unexplained.shape[1]) ** 2
    line = np.round(lines * PERIOD).astype(int)
    frequencies = np.arange(line[0], line[-1] + _BETWEEN)
    between = np.setdiff1d(frequencies, line)
    distance = np.abs(between - line[:, None])
    nearest = distance.argsort(axis=1)[:, :_BETWEEN]
    power = spectrum.mean(axis=0)[between[nearest]]
    return np.asarray(np.sqrt(power.mean(axis=1)))


class _Rest(NamedTuple):
    """What a model leaves of the torque of a turn.

    Attributes:
        left: at each line, (lines,).
        slope: its derivative, (lines, unknowns).
        by_position: how it falls with the position of the joint that turns, (lines,).
        position_slope: the derivative of that, (lines, unknowns).
        noise: what of it is noise of the torque and of the other joints' positions, (lines,).
    """

    left: _Complex
    slope: _Complex
    by_position: _Complex
    position_slope: _Complex
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

    def __init__(self, turn: _Turn, s: _Complex, links: Array, steep: Array, drives: _Drives) -> None:
        """Work out what both sides of the encoders have in common.

        Args:
            turn: of the joint.
            s: frequencies [rad/s], imaginary, (lines,).
            links: inertia L of the links, (n, n).
            steep: derivative G of their weight by the positions, (n, n).
            drives: of the joints.
        """
        self.joint, self.links = turn.joint, links
        self.answer = turn.answer.mean(axis=0)
        self.square = s**2
        self.dynamic = links * self.square[:, None, None] + steep
        self.gear = drives.stiffness + drives.damping * s[:, None]
        rotor, friction = drives.rotor[turn.joint], drives.friction[turn.joint]
        self.motor_alone = rotor * self.square + friction * s

    def of_motors(self) -> _Torque:
        """Return the torque where positions are those of the motors."""
        j, n = self.joint, len(self.links)
        unit_torque = np.broadcast_to(np.eye(n)[j], self.answer.shape)
        gear_torque = self.gear * self.answer
        right = np.stack([gear_torque, unit_torque], axis=-1)
        matrix = self.dynamic + self.gear[:, :, None] * np.eye(n)
        solution = np.linalg.solve(matrix, right)
        link, unit = solution[..., 0], solution[..., 1]
        twist = self.answer - link
        lever = self.gear[:, j, None] * unit  # by how much joint j follows torques at the links
        row = -lever * self.gear
        row[:, j] += self.motor_alone + self.gear[:, j]
        by_gear = -lever * twist
        by_gear[:, j] += twist[:, j]
        lever_of_links = lever @ self.links
        both = lever * (link @ self.links) + lever_of_links * link
        by_share = self.square[:, None] * both
        own_by_gear = lever**2
        own_by_gear[:, j] += 1.0 - 2.0 * lever[:, j]
        own_by_share = 2.0 * self.square[:, None] * lever * lever_of_links
        own_by_motor = np.ones_like(self.square)
        motor = self.answer[:, j]
        return _Torque(row, motor, by_gear, by_share, own_by_gear, own_by_share, own_by_motor)

    def of_links(self) -> _Torque:
        """Return the torque where positions are those of the links."""
        j = self.joint
        own_row = self.dynamic[:, j]
        own_gear, own_links = self.gear[:, j], own_row[:, j]
        spring = np.einsum("li,li->l", own_row, self.answer)  # torque of the gear
        through = 1.0 + self.motor_alone / own_gear  # torque of the motor for one of the gear
        row = own_row * through[:, None]
        row[:, j] += self.motor_alone
        by_gear = np.zeros(self.answer.shape, dtype=complex)
        by_gear[:, j] = -self.motor_alone * spring / own_gear**2
        by_share = self.answer * self.links[j]
        by_share[:, j] += self.answer @ self.links[j]
        by_share = (self.square * through)[:, None] * by_share
        own_by_gear = np.zeros_like(by_gear)
        own_by_gear[:, j] = -own_links * self.motor_alone / own_gear**2
        own_by_share = np.zeros_like(by_gear)
        own_inertia = self.links[j, j]
        own_by_share[:, j] = 2.0 * self.square * own_inertia * through
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
        self.robot, self.turns, self.side = robot, turns, side
        self.links = [_links_of(robot, turn.q) for turn in turns]
        self.steep = [gravity_stiffness(robot, turn.q) * float(gravity) for turn in turns]
        self.s: _Complex = np.asarray(2j * math.pi * turns[0].lines, dtype=np.complex128)
        self.mean, self.std = _expected(robot, lag)
        self.noise: list[Array] = []
        fits = [self._search(factor) for factor in _STARTS]  # a spectrum has more than one valley
        costs = [self._cost(x) for x in fits]
        best = int(np.argmin(costs))
        self.cost, self.x = costs[best], fits[best]
        self._weigh_again(self.x)

    def _search(self, factor: float) -> Array:
        """Return the unknowns that a search finds from so many times the expected stiffness."""
        n = self.robot.n
        x = np.zeros(_UNKNOWNS * n)
        x[:n] = math.log(factor) / _STIFF
        for _ in range(_WEIGHINGS):
            self._weigh_again(x)
            solution = optimize.least_squares(self._residuals, x, self._slopes, max_nfev=_STEPS)
            x = np.asarray(solution.x)
        return x

    def _weigh_again(self, x: Array) -> None:
        """Take the noise of the residuals for what it is at some unknowns."""
        self.noise = [self._noise(x, index) for index in range(len(self.turns))]

    def _cost(self, x: Array) -> float:
        """Return how badly gears explain the torques, with lines that do not fit at all counting less."""
        relative = []
        for index in range(len(self.turns)):
            unexplained, scale = self._compare(x, index)
            relative.append(unexplained / scale)
        logarithms = np.log(np.concatenate(relative) + 1e-3)
        return float(logarithms.sum() + 0.5 * x @ x)

    def _compare(self, x: Array, index: int) -> tuple[Array, Array]:
        """Return what is unexplained of a turn's torque at each line, and torque and noise together."""
        residual, turn = self._rest(x, index), self.turns[index]
        noise_of_position = turn.noise[:, 1 + turn.joint]
        by_position = residual.by_position * noise_of_position
        sizes = np.abs([turn.tau.mean(axis=0), residual.noise, by_position])
        return np.abs(residual.left), np.linalg.norm(sizes, axis=0)

    def _noise(self, x: Array, index: int) -> Array:
        """Return the noise of the residual at each line, but for that of the joint's own position."""
        residual = self._rest(x, index)
        torque = np.abs(self.turns[index].tau.mean(axis=0))
        measured = 0.5 * residual.noise**2  # of a real part
        not_linear = (_LINEAR * torque) ** 2
        does_not_fit = _ROBUST * np.abs(residual.left) * torque
        return np.asarray(np.sqrt(measured + not_linear + does_not_fit))

    def _residuals(self, x: Array) -> Array:
        """Return the residuals of the torques in units of their noise, and of what is expected."""
        weighed = [self._weigh(x, index)[0] for index in range(len(self.turns))]
        residuals = np.concatenate(weighed)
        off, _ = self._sum(x)
        return np.concatenate([residuals.real, residuals.imag, off, x])

    def _slopes(self, x: Array) -> Array:
        """Return the derivative of that."""
        weighed = [self._weigh(x, index)[1] for index in range(len(self.turns))]
        rows = np.concatenate(weighed)
        _, slope = self._sum(x)
        return np.concatenate([rows.real, rows.imag, slope, np.eye(len(x))])

    def _weigh(self, x: Array, index: int) -> tuple[_Complex, _Complex]:
        """Return the residual of a turn in units of its noise, and the derivative.

        The noise of the position counts by as much as the model makes of it: frozen, soft gears, which make
        more of it, would look worse than they are.
        """
        residual, turn = self._rest(x, index), self.turns[index]
        of_position = math.sqrt(0.5) * turn.noise[:, 1 + turn.joint]
        by_position = residual.by_position
        noise = np.hypot(self.noise[index], of_position * np.abs(by_position))
        half_square_grows = (np.conj(by_position)[:, None] * residual.position_slope).real
        grows = half_square_grows * (of_position**2 / noise**3)[:, None]
        slope = residual.slope / noise[:, None]
        slope = slope - residual.left[:, None] * grows
        return residual.left / noise, slope

    def _sum(self, x: Array) -> tuple[Array, Array]:
        """Return how far each joint's inertia is off in the middle, over its width, and the derivative."""
        n, known_rotor = self.robot.n, self.robot.armature
        inertia = self.robot.mass_matrix(self.robot.middle())
        known_links = np.diag(inertia) - known_rotor
        drives = self.mean + self.std * x
        values = drives.reshape(_UNKNOWNS, n)
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
        turn, drives = self.turns[index], self._drives(x)
        links = np.outer(drives.share, drives.share) * self.links[index]
        model = _Model(turn, self.s, links, self.steep[index], drives)
        torque = model.of_motors() if self.side == "motor" else model.of_links()
        measured = np.exp(-self.s * drives.late[turn.joint]) * turn.tau.mean(axis=0)
        predicted = (torque.row * model.answer).sum(axis=1)
        # The noise of the joint's own position is weighed apart; in its place is that of the torque.
        noise = np.abs(torque.row * turn.noise[:, 1:])
        noise[:, turn.joint] = turn.noise[:, 0]
        return _Rest(
            measured - predicted,
            self._slope(turn, drives, torque, measured),
            torque.row[:, turn.joint],
            self._position_slope(turn, drives, torque),
            np.linalg.norm(noise, axis=1),
        )

    def _slope(self, turn: _Turn, drives: _Drives, torque: _Torque, measured: _Complex) -> _Complex:
        """Return the derivative of the residual of a turn by the unknowns, (lines, unknowns)."""
        s, joint = self.s, turn.joint
        slope = np.zeros((len(s), _UNKNOWNS, self.robot.n), dtype=complex)
        slope[:, 0] = -torque.by_gear * drives.stiffness
        slope[:, 1] = -torque.by_gear * drives.damping * s[:, None]
        slope[:, 2, joint] = -torque.motor * drives.rotor[joint] * s**2
        slope[:, 3, joint] = -torque.motor * drives.friction[joint] * s
        slope[:, 4] = -torque.by_share
        slope[:, 5, joint] = -s * measured
        return np.asarray(slope.reshape(len(s), -1) * self.std)

    def _position_slope(self, turn: _Turn, drives: _Drives, torque: _Torque) -> _Complex:
        """Return the derivative of the torque for a position of the joint, likewise."""
        s, joint = self.s, turn.joint
        slope = np.zeros((len(s), _UNKNOWNS, self.robot.n), dtype=complex)
        slope[:, 0] = torque.own_by_gear * drives.stiffness
        slope[:, 1] = torque.own_by_gear * drives.damping * s[:, None]
        slope[:, 2, joint] = torque.own_by_motor * drives.rotor[joint] * s**2
        slope[:, 3, joint] = torque.own_by_motor * drives.friction[joint] * s
        slope[:, 4] = torque.own_by_share
        return np.asarray(slope.reshape(len(s), -1) * self.std)

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
        posterior = self.std * np.sqrt(np.diag(covariance))
        std = np.minimum(posterior, self.std)
        logarithms = self.mean + self.std * x
        stiffness, damping, rotor = np.exp(logarithms[: 3 * n]).reshape(3, n)
        measured = np.zeros(n, dtype=bool)
        measured[[turn.joint for turn in self.turns]] = True
        least_known = (1.0 - _DECIDED) * self.std[:n]
        measured &= std[:n] < least_known
        mode = self._mode(x)
        slope = self._mode_slope(mode)
        half_width = HALF_95 * math.sqrt(float(slope @ covariance @ slope))
        factor = half_width / mode
        low, high = mode * math.exp(-factor), mode * math.exp(factor)
        ends = np.array([mode, low, high])
        stds = std[: 3 * n].reshape(3, n)
        return Gears(stiffness, damping, rotor, stds, measured, self.side, ends, self._misfits())

    def _covariance(self) -> Array:
        """Return the covariance of the unknowns, in units of what is expected, widened for unseen misfit."""
        count = len(self.x)
        residuals = self._residuals(self.x)[:-count]  # what is expected comes last
        slopes = self._slopes(self.x)[:-count]
        variance = max(1.0, float((residuals**2).mean()))
        information = slopes.T @ slopes / variance + np.eye(count)
        covariance = np.linalg.inv(information)
        covariance *= _UNSEEN**2
        return np.asarray(covariance)

    def _mode_slope(self, mode: float) -> Array:
        """Return how the lowest mode changes with the unknowns, lags left out."""
        steps = _STEP * np.eye(len(self.x))
        slope = np.zeros(len(self.x))
        for place in range(5 * self.robot.n):
            change = self._mode(self.x + steps[place]) - mode
            slope[place] = change / _STEP
        return slope

    def _misfits(self) -> Array:
        """Return what is left of torques over torque and noise, (n,); NaN of joints that were not shaken."""
        misfits = np.full(self.robot.n, np.nan)
        for index, turn in enumerate(self.turns):
            unexplained, scale = self._compare(self.x, index)
            relative = np.linalg.norm(unexplained) / np.linalg.norm(scale)
            misfits[turn.joint] = relative
        return misfits

    def _mode(self, x: Array) -> float:
        """Return the lowest mode in the middle of the ranges [Hz]."""
        values = self.mean + self.std * x
        logarithms = values[: -self.robot.n]
        stiffness, _, rotor, _, share = np.exp(logarithms).reshape(5, -1)
        links = _links_of(self.robot, self.robot.middle())
        return lowest_mode(np.outer(share, share) * links, rotor, stiffness)


def _links_of(robot: Robot, q: Array) -> Array:
    """Return the inertia of the links alone at a configuration, (n, n)."""
    return np.asarray(robot.mass_matrix(q) - np.diag(robot.armature))


def _expected(robot: Robot, lag: Array) -> tuple[Array, Array]:
    """Return what is expected of the unknowns of :class:`_Fit`, and its standard deviations, each (6 n,).

    Args:
        robot: the arm, with rotors and stiffness.
        lag: time between torque and position that slow motions showed [s], (n,).
    """
    n, rotor = robot.n, robot.armature
    stiffness = robot.drives.value("stiffness")
    links = np.diag(robot.mass_matrix(robot.middle())) - rotor
    at_one = damping_at_one(np.diag(links), Modes(rotor, stiffness))
    logarithms = np.log([stiffness, _RATIO * at_one, rotor, _RUB * at_one])
    unchanged = 0.0 * lag
    least_lag = np.full(n, lag.min())  # gears that twist look like a lag to whom takes them as rigid
    mean = np.concatenate([*logarithms, unchanged, least_lag])
    late = np.maximum(lag - least_lag, _LATE)
    before, after = np.repeat([_STIFF, _DAMPED], n), np.repeat([_RUBBED, _LINKS], n)
    std = np.concatenate([before, _rotor_width(robot), after, late])
    return mean, std


def _rotor_width(robot: Robot) -> Array:
    """Return the standard deviations of the logarithms of the rotors, (n,)."""
    rotor = robot.armature
    low, high = robot.drives.interval("rotor_inertia")
    highest, lowest = np.maximum(high, rotor), np.maximum(low, 1e-3 * rotor)
    width = np.log(highest / lowest) / (2.0 * HALF_95)
    width = np.where(np.isfinite(width), width, _ROTOR)
    return np.clip(width, _LEAST_ROTOR, _ROTOR)
