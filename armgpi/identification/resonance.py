"""The gears of an arm from its answer to a multisine: stiffness, damping, rotors, and the first mode."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from armgpi.base.arrays import Array, check_number, check_type, check_whole
from armgpi.errors import ParameterError, UnfitLog
from armgpi.identification.estimate import expect
from armgpi.identification.excitation import Excitation, blocked, free_configuration, ranges, surroundings
from armgpi.identification.logs import Grid, Log, resample
from armgpi.identification.weak_form import COLUMNS, ROTOR
from armgpi.references.recorded import Recorded
from armgpi.robot.clearance import Clearance
from armgpi.robot.drives import Drives
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears, lowest_mode
from armgpi.tuning.two_mass import Gears as Modes
from armgpi.tuning.two_mass import damping_at_one, gravity_stiffness

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
    tau: Array
    answer: Array
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
    rotor = expect(robot).mean.reshape(robot.n, len(COLUMNS))[:, ROTOR]
    inertia = np.diag(robot.mass_matrix(centre)) - robot.armature + rotor
    times = np.arange(0.0, robot.n * TURN + 0.5 * _SAMPLE, _SAMPLE)
    q = np.tile(centre, (len(times), 1))
    for j in range(robot.n):
        t = times - j * TURN
        own = (t >= 0.0) & (t <= TURN)
        ramp = np.clip(np.minimum(t[own], TURN - t[own]) / _RAMP, 0.0, 1.0)
        series = _flattest(rng, t[own])
        limits = np.array([share * spare[j] / inertia[j], _SPEED * speed[j], _RANGE * (upper[j] - lower[j])])
        scale = (limits / np.abs(series).max(axis=1)).min()
        q[own, j] += scale * series[2] * ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    reference = Recorded(times, q, source=f"multisine of {robot.name}, seed {seed}")
    target = reference.at(times)
    torque = np.abs(robot.gravity(centre) + inertia * target.a).max(axis=0)
    return Excitation(reference, np.abs(target.v).max(axis=0) / speed, torque / robot.limits.effort, clear)


def _flattest(rng: np.random.Generator, t: Array) -> Array:
    """Return acceleration, speed and position of a multisine of unit lines at times (k,), (3, k)."""
    best, w = np.empty(0), 2.0 * math.pi * LINES
    for _ in range(_SERIES):
        angle = w * t[:: max(1, len(t) // 2000), None] + rng.uniform(0.0, 2.0 * math.pi, len(LINES))
        crest = np.abs(np.cos(angle).sum(axis=1)).max()
        if not len(best) or crest < best[0]:
            best = np.append(crest, angle[0])
    angle = w * t[:, None] + best[1:] - w * t[0]
    return np.stack(
        [np.cos(angle).sum(axis=1), (np.sin(angle) / w).sum(axis=1), -(np.cos(angle) / w**2).sum(axis=1)]
    )


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
        raise UnfitLog([f"shows no joint's multisine: {wanted} ({log.source})"])
    soft = assume_gears(robot)
    known = set(robot.drives.value("encoder_side").tolist()) - {""}
    sides = tuple(known) if len(known) == 1 else ("motor", "link")
    found = [_Fit(soft, turns, each, lag + 0.5 * grid.dt, gravity) for each in sides]
    return min(found, key=lambda each: each.cost).gears()


def _turns(grid: Grid) -> Iterator[_Turn]:
    """Find the joints' turns in a log, and their answers at the lines."""
    n, size = grid.q.shape[1], max(2, round(_LOOK / grid.dt))
    count = len(grid.q) // size
    turn, first = round(TURN / _LOOK), round(_SETTLE / _LOOK)
    if count < turn - 2:
        return
    blocks = grid.q[: count * size].reshape(count, size, n)
    moves = np.abs(np.diff(blocks, axis=1)).sum(axis=1)
    moves /= np.maximum(moves.max(axis=0), 1e-300)
    middle = [[np.arange(j * turn + first, (j + 1) * turn - 2)] for j in range(n)]

    def matches(begin: int) -> float:
        """Return how far each joint moves in its own turn beyond what it does in others."""
        inside = 0.0
        for j in range(n):
            at = middle[j][0] + begin
            at = at[(at >= 0) & (at < count)]
            inside += float(moves[at, j].sum())
        return inside

    begin = max(range(-(n - 1) * turn - first, max(count - turn + 3, 1)), key=matches)
    length = round(PERIOD / grid.dt)
    t = np.arange(length) * grid.dt
    # Below half the log's rate, with the frequencies that show the noise.
    lines = LINES[: np.searchsorted(LINES * PERIOD, length // 2 - _BETWEEN, "right")]
    if not len(lines):
        return
    waves = np.exp(2j * math.pi * lines * t[:, None])
    basis = np.hstack([waves.real, waves.imag, np.ones((length, 1)), t[:, None]])
    inverse = np.linalg.pinv(basis)
    for j in range(n):
        start = round((begin * size) + (j * TURN + _SETTLE) / grid.dt)
        there = [start + k * length for k in range(PERIODS)]
        there = [
            k for k in there if k >= 0 and k + length <= len(grid.q) and not grid.bad[k : k + length].any()
        ]
        if len(there) < 2:
            continue
        periods = np.stack(
            [np.hstack([grid.tau[k : k + length, j : j + 1], grid.q[k : k + length]]) for k in there]
        )
        factors = inverse @ periods
        cosines, sines, _ = np.split(factors, [len(lines), 2 * len(lines)], axis=1)
        both, noise = cosines - 1j * sines, _noise_at(lines, periods - basis @ factors)
        yield _Turn(j, lines, periods[..., 1:].mean(axis=(0, 1)), both[..., 0], both[..., 1:], noise)


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

    left: Array
    slope: Array
    own: Array
    own_slope: Array
    noise: Array


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
        self.s = 2j * math.pi * turns[0].lines
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
        relative = [left / scale for left, scale in (self._compare(x, i) for i in range(len(self.turns)))]
        return float(np.log(np.concatenate(relative) + 1e-3).sum() + 0.5 * x @ x)

    def _compare(self, x: Array, index: int) -> tuple[Array, Array]:
        """Return what is left of the torque of a turn at each line, and torque and noise together."""
        rest, turn = self._rest(x, index), self.turns[index]
        scale = [turn.tau.mean(axis=0), rest.noise, rest.own * turn.noise[:, 1 + turn.joint]]
        return np.abs(rest.left), np.linalg.norm(np.abs(scale), axis=0)

    def _noise(self, x: Array, index: int) -> Array:
        """Return the noise of the residual at each line, but for that of the joint's own position."""
        rest, torque = self._rest(x, index), np.abs(self.turns[index].tau.mean(axis=0))
        return np.asarray(
            np.sqrt(0.5 * rest.noise**2 + (_LINEAR * torque) ** 2 + _ROBUST * np.abs(rest.left) * torque)
        )

    def _residuals(self, x: Array) -> Array:
        """Return what is left of the torques in units of its noise, and of what is expected."""
        left = np.concatenate([self._weigh(x, i)[0] for i in range(len(self.turns))])
        return np.concatenate([left.real, left.imag, self._sum(x)[0], x])

    def _slopes(self, x: Array) -> Array:
        """Return the derivative of that."""
        rows = np.concatenate([self._weigh(x, i)[1] for i in range(len(self.turns))])
        return np.concatenate([rows.real, rows.imag, self._sum(x)[1], np.eye(len(x))])

    def _weigh(self, x: Array, index: int) -> tuple[Array, Array]:
        """Return what is left of the torque of a turn in units of its noise, and the derivative.

        The noise of the position counts by as much as the model makes of it: frozen, soft gears, which make
        more of it, would look worse than they are.
        """
        rest, turn = self._rest(x, index), self.turns[index]
        count = math.sqrt(0.5) * turn.noise[:, 1 + turn.joint]
        noise = np.hypot(self.noise[index], count * np.abs(rest.own))
        grows = (np.conj(rest.own)[:, None] * rest.own_slope).real * (count**2 / noise**3)[:, None]
        return rest.left / noise, rest.slope / noise[:, None] - rest.left[:, None] * grows

    def _sum(self, x: Array) -> tuple[Array, Array]:
        """Return how far each joint's inertia is off in the middle, over its width, and the derivative."""
        n, middle = self.robot.n, self.robot.middle()
        values, rotor = (self.mean + self.std * x).reshape(_UNKNOWNS, n), self.robot.armature
        links = np.diag(self.robot.mass_matrix(middle)) - rotor
        both = np.stack([np.exp(values[2]), np.exp(2.0 * values[4]) * links])
        slope = np.zeros((n, _UNKNOWNS, n))
        j, total = np.arange(n), both.sum(axis=0)
        slope[j, 2, j], slope[j, 4, j] = both * np.array([[1.0], [2.0]]) / total
        off = np.log(total / (links + rotor))
        return off / _TOTAL, slope.reshape(n, -1) * self.std / _TOTAL

    def _rest(self, x: Array, index: int, period: int | None = None) -> _Rest:
        """Return what is left of the torque of a turn."""
        turn, s, n = self.turns[index], self.s, self.robot.n
        at: Any = slice(None) if period is None else slice(period, period + 1)
        answer, tau = turn.answer[at].mean(axis=0), turn.tau[at].mean(axis=0)
        values = self.mean + self.std * x
        K, B, J, f, share = np.exp(np.clip(values[: 5 * n], -60.0, 60.0)).reshape(5, n)
        j, links, gear = turn.joint, np.outer(share, share) * self.links[index], K + B * s[:, None]
        late, own = np.exp(-s * values[5 * n + j]) * tau, J[j] * s**2 + f[j] * s
        slope, own_slope = np.zeros((2, len(s), _UNKNOWNS, n), dtype=complex)
        dynamic = links * s[:, None, None] ** 2 + self.steep[index]
        if self.side == "motor":
            right = np.stack([gear * answer, np.broadcast_to(np.eye(n)[j], answer.shape)], axis=-1)
            link, unit = np.moveaxis(np.linalg.solve(dynamic + gear[:, :, None] * np.eye(n), right), -1, 0)
            motor, twist = answer[:, j], answer - link
            row = -gear[:, j, None] * unit * gear
            row[:, j] += own + gear[:, j]
            of_gear = gear[:, j, None] * unit * twist
            of_gear[:, j] -= twist[:, j]
            bent = unit * (link @ links) + (unit @ links) * link
            slope[:, 4] = -gear[:, j, None] * (s**2)[:, None] * bent
            lever = gear[:, j, None] * unit
            stiff = lever**2
            stiff[:, j] += 1.0 - 2.0 * lever[:, j]
            own_slope[:, 4] = 2.0 * (s**2)[:, None] * lever * (lever @ links)
            own_slope[:, 2, j] = s**2 * J[j]
            own_slope[:, 3, j] = s * f[j]
        else:
            spring = np.einsum("li,li->l", dynamic[:, j], answer)
            motor = answer[:, j] + spring / gear[:, j]
            row = dynamic[:, j] * (1.0 + own / gear[:, j])[:, None]
            row[:, j] += own
            of_gear = np.zeros((len(s), n), dtype=complex)
            of_gear[:, j] = own * spring / gear[:, j] ** 2
            bent = answer * links[j]
            bent[:, j] += answer @ links[j]
            both = 1.0 + own / gear[:, j]
            slope[:, 4] = -((s**2) * both)[:, None] * bent
            own_slope[:, 4, j] = 2.0 * s**2 * links[j, j] * both
            stiff = np.zeros_like(of_gear)
            stiff[:, j] = -dynamic[:, j, j] * own / gear[:, j] ** 2
            own_slope[:, 2, j] = s**2 * J[j] * (1.0 + dynamic[:, j, j] / gear[:, j])
            own_slope[:, 3, j] = s * f[j] * (1.0 + dynamic[:, j, j] / gear[:, j])
        left = late - (row * answer).sum(axis=1)
        slope[:, 0], slope[:, 1] = of_gear * K, of_gear * B * s[:, None]
        slope[:, 2, j] -= s**2 * motor * J[j]
        slope[:, 3, j], slope[:, 5, j] = -s * motor * f[j], -s * late
        own_slope[:, 0], own_slope[:, 1] = stiff * K, stiff * B * s[:, None]
        others = np.abs(row * turn.noise[:, 1:])
        others[:, j] = turn.noise[:, 0]
        return _Rest(
            left,
            slope.reshape(len(s), -1) * self.std,
            row[:, j],
            own_slope.reshape(len(s), -1) * self.std,
            np.linalg.norm(others, axis=1),
        )

    def gears(self) -> Gears:
        """Return the gears, with intervals."""
        n, x = self.robot.n, self.x
        fun, jac = self._residuals(x)[: -len(x)], self._slopes(x)[: -len(x)]
        inverse = np.linalg.inv(jac.T @ jac / max(1.0, float((fun**2).mean())) + np.eye(len(x)))
        inverse *= _UNSEEN**2
        std = np.minimum(self.std * np.sqrt(np.diag(inverse)), self.std)
        K, B, J = np.exp((self.mean + self.std * x)[: 3 * n]).reshape(3, n)
        measured = np.zeros(n, dtype=bool)
        measured[[turn.joint for turn in self.turns]] = True
        measured &= std[:n] < (1.0 - _DECIDED) * self.std[:n]
        slope, mode, step = np.zeros(len(x)), self._mode(x), 1e-4
        for i in range(5 * n):
            slope[i] = (self._mode(x + step * np.eye(len(x))[i]) - mode) / step
        wide = _95 * math.sqrt(float(slope @ inverse @ slope))
        misfit = np.full(n, np.nan)
        for i, turn in enumerate(self.turns):
            left, scale = map(np.linalg.norm, self._compare(x, i))
            misfit[turn.joint] = left / scale
        ends = np.array([mode, mode * math.exp(-wide / mode), mode * math.exp(wide / mode)])
        return Gears(K, B, J, std[: 3 * n].reshape(3, n), measured, self.side, ends, misfit)

    def _mode(self, x: Array) -> float:
        """Return the lowest mode in the middle of the ranges [Hz]."""
        K, _, J, _, share = np.exp((self.mean + self.std * x)[: -self.robot.n]).reshape(5, -1)
        links = self.robot.mass_matrix(self.robot.middle()) - np.diag(self.robot.armature)
        return lowest_mode(np.outer(share, share) * links, J, K)
