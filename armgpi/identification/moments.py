"""The moments of the logs of one arm, as regressions, with the terms that the logs ask for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError, UnfitLog
from armgpi.identification import estimate
from armgpi.identification.check import check, check_positions
from armgpi.identification.elastic import Twist, Twisted, expected_compliance
from armgpi.identification.estimate import HALF_95, Block, Prior
from armgpi.identification.logs import Grid, Log, read_log, resample, with_torques
from armgpi.identification.samples import Finding
from armgpi.identification.weak_form import COULOMB, OFFSET, ROTOR, VISCOUS, WeakForm, inverse_rows
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import SCATTER

#: Width over which the sign of velocity is smoothed before a better one is known [rad/s or m/s].
FIRST_WIDTH = 5e-3
#: Slower than this is at rest [rad/s or m/s].
_STILL = 4e-3
#: What friction may have besides, where the data ask for it, and the standard deviation of its prior: a share
#: of the gravity torque, as gears rub more under load; and what comes on top near rest (Stribeck), a share of
#: what is expected of Coulomb friction.
FRICTIONS: Mapping[str, float] = {"load": 0.2, "stribeck": 0.5}
#: Speed over which the latter decays [rad/s or m/s].
_STRIBECK = 0.05
#: What a motor has that turns with its neighbour's joint, as those of wrists do, each beside its own.
MOTOR = ("rotor", "viscous", "coulomb")
#: Shortest period that is looked for, and the step in which it is [s].
_SHORTEST_PERIOD = 2.0
_PERIOD_STEP = 0.02
#: Time at both ends of a motion in which it begins and ends at rest [s].
_ENDS = 1.0
#: Most that two periods may differ, as a share of the motion.
_SAME = 0.03
#: Configurations at which inertia matrices are compared.
CONFIGURATIONS = 50


class Coupled(NamedTuple):
    """A motor that turns with the joint before its own as well.

    Attributes:
        joint: the joint before it.
        motor: whose motor it is.
        sign: which way the motor turns with the joint: 1 or -1.
    """

    joint: int
    motor: int
    sign: float


class Moments:
    """The moments of some logs of one arm.

    Attributes:
        robot: the arm.
        gravity: whether the torques carry the arm's weight.
        current: torque at the joints for a unit of what was logged [N m/A or N/A], (n,); None for torques.
        columns: what the columns of CSV files are called.
        model: of Pinocchio; without gravity where torques do not carry it.
        expected: of the unknowns of the joints.
        compliance: that is known or assumed of the gears, and its standard deviation, each (n,).
        width: speed over which the sign of velocity is smoothed [rad/s or m/s], (n,).
        lags: how many are estimated: one of all joints, or one of each.
        frictions: further friction -> the joints whose data ask for it, (n,).
        coupled: motors that turn with two joints.
        heavy: the arm whose gravity is the load of the gears.
        twist: of the gears, where joints are elastic.
        explained: share that elastic joints explain of what stiff ones leave.
        logs: as they were recorded.
        grids: the same at uniform times.
        rigid: moments as if links and motors were one.
        forms: moments with links and motors where they are.
        twisted: the same and how they change with the compliance, where joints are elastic.
        phases: of each test function in the period of the motion, if it has one; else its number.
        torque: what the torques are; empty where nobody said.
        hidden: joints whose rotors are not in the torques, (n,).
    """

    def __init__(
        self,
        robot: Robot,
        gravity: bool,
        current: Array | None = None,
        columns: Mapping[str, str] | None = None,
    ) -> None:
        """Begin without logs.

        Raises:
            ParameterError: for a robot whose joints follow others.
        """
        if robot.coupling is not None:
            raise ParameterError("robot", robot, "a robot whose joints follow no others (mimic='lock')")
        self.robot, self.gravity = robot, gravity
        self.current, self.columns = current, columns
        self.model = robot.pinocchio_model()
        if not gravity:
            self.model.gravity = pin.Motion.Zero()
        self.expected = estimate.expect(robot)
        self.compliance = expected_compliance(robot)
        self.width = np.full(robot.n, FIRST_WIDTH)
        self.lags = 1
        self.frictions: dict[str, npt.NDArray[np.bool_]] = {}
        self.coupled: list[Coupled] = []
        self.heavy = robot
        self.twist: Twist | None = None
        self.explained = math.nan
        self.logs: list[Log] = []
        self.grids: list[Grid] = []
        self.rigid: list[WeakForm] = []
        self.forms: list[WeakForm] = []
        self.twisted: list[Twisted] = []
        self.phases: list[npt.NDArray[np.intp]] = []
        self.torque = ""
        self.hidden = np.zeros(robot.n, dtype=bool)

    def forget_terms(self) -> None:
        """Begin anew with one width of the sign, one lag and no further terms."""
        self.width = np.full(self.robot.n, FIRST_WIDTH)
        self.lags = 1
        self.frictions, self.coupled = {}, []
        self.set_twist(None)

    def hide(self, joints: npt.NDArray[np.bool_]) -> None:
        """Take the rotors of some joints, (n,), to be not in the torques: they stay what is expected."""
        self.hidden = joints.copy()
        mean = self.expected.mean.reshape(self.robot.n, -1)
        std = self.expected.std.reshape(self.robot.n, -1).copy()
        half_width = 0.5 * (SCATTER - 1.0 / SCATTER)
        std[joints, ROTOR] = half_width / HALF_95 * mean[joints, ROTOR]
        self.expected = self.expected._replace(std=std.ravel())

    def with_logs(self, logs: Sequence[Any]) -> Moments:
        """Return the same of other logs.

        Raises:
            UnfitLog: for one that is too short for a single moment.
        """
        other = Moments(self.robot, self.gravity, self.current, self.columns)
        other.width, other.lags = self.width, self.lags
        other.frictions, other.coupled, other.heavy = self.frictions, self.coupled, self.heavy
        other.torque, other.hidden = self.torque, self.hidden
        other.expected, other.compliance = self.expected, self.compliance
        for log in logs:
            other._add(self.read(log))
        other.set_twist(self.twist)
        return other

    def _add(self, log: Log) -> None:
        """Add a log; errors as :meth:`with_logs`."""
        self.torque = self.kind(log)
        grid = resample(log)
        form = WeakForm(self.model, grid)
        if not len(form.starts):
            length = f"{log.t[-1] - log.t[0]:.2g} s long"
            reason = f"it is {length}, without a second that has no gap: log longer ({log.source})"
            raise UnfitLog([reason])
        self.logs.append(log)
        self.grids.append(grid)
        self.rigid.append(form)
        self.phases.append(_phases(form, grid))

    def set_twist(self, twist: Twist | None) -> None:
        """Take the joints for elastic ones, or for stiff ones."""
        self.twist = twist
        self.forms, self.twisted = list(self.rigid), []
        if twist is not None:
            self.twisted = [twist.apply(form) for form in self.rigid]
            self.forms = [twisted.form for twisted in self.twisted]

    def read(self, log: Any) -> Log:
        """Return a log with torques."""
        return with_torques(read_log(log, self.robot, columns=self.columns), self.current)

    def kind(self, log: Log) -> str:
        """Return what the torques of a log are: what it says itself, or those of the others are.

        Raises:
            ParameterError: when both are known, and not the same.
        """
        if log.torque and self.torque and log.torque != self.torque:
            expected = f"logs of one kind of torque: the others are of {self.torque!r} torques"
            raise ParameterError(f"{log.source}: torque", log.torque, expected)
        return log.torque or self.torque

    def with_rotors(self, log: Log) -> Log:
        """Return a log with what its torques are, which have to have the rotors in them.

        Raises:
            ParameterError: when it is of another kind than the other logs, or these have none of any rotor.
        """
        kind = self.kind(log)
        if self.hidden.all() and kind != "joint":
            expected = "torques of the motors: in those of the other logs there is no joint's rotor"
            raise ParameterError(f"{log.source}: torque", kind or "not specified", expected)
        return log._replace(torque=kind)

    def join(self, logs: Sequence[Any]) -> Moments:
        """Return the same with more logs."""
        other = self.with_logs(logs)
        other.grids = self.grids + other.grids
        other.rigid = self.rigid + other.rigid
        other.forms = self.forms + other.forms
        other.twisted = self.twisted + other.twisted
        other.phases = self.phases + other.phases
        other.logs = self.logs + other.logs
        return other

    def findings(self, count: int) -> list[Finding]:
        """Return what the check says of the last logs."""
        findings = []
        for log, grid, form in list(zip(self.logs, self.grids, self.rigid, strict=True))[-count:]:
            findings += check(self.robot, self.gravity, self.expected, log, grid, form)
        return findings

    def position_findings(self) -> list[Finding]:
        """Return that the positions of two joints are swapped in a log, where they are."""
        findings = []
        for log, form in zip(self.logs, self.rigid, strict=True):
            swapped = check_positions(self.robot, self.expected, form)
            findings += [finding._replace(message=f"{finding.message} ({log.source})") for finding in swapped]
        return findings

    def inertias(self) -> Array:
        """Return the mean diagonal of D(q) as combinations of the unknowns of joints, (n, 14 n)."""
        n = self.robot.n
        free = self.robot.pinocchio_model()
        free.gravity = pin.Motion.Zero()
        q = random_configurations(self.robot, CONFIGURATIONS, seed=0)
        still = np.zeros_like(q)
        means = []
        for joint, unit in enumerate(np.eye(n)):
            rows = inverse_rows(free, q, still, still + unit, np.ones(n))
            means.append(rows[:, joint].mean(axis=0))
        combinations: Array = np.stack(means)
        combinations[..., [COULOMB, VISCOUS, OFFSET]] = 0.0
        return combinations.reshape(n, -1)

    def torques(self, lag: Array) -> list[Array]:
        """Return the moments of the torques of every log."""
        return [form.torque(lag)[0] for form in self.forms]

    @property
    def prior(self) -> Prior:
        """What is expected of joints, further friction and lags."""
        n = self.robot.n
        std = self.expected.std.reshape(n, -1)
        sizes = {"load": np.ones(n), "stribeck": std[:, COULOMB]}
        of_friction = [FRICTIONS[name] * sizes[name] for name in self.frictions]
        of_motors = [std[coupled.motor, [ROTOR, VISCOUS, COULOMB]] for coupled in self.coupled]
        further = np.concatenate([*of_friction, *of_motors, np.empty(0)])
        prior = estimate.extend(self.expected, further)
        if self.twist is not None:
            prior = estimate.extend_positive(prior, *self.compliance)
        return estimate.extend(prior, estimate.lag_std(self.lags))

    def blocks(self, lag: Array, width: Array | None = None, linear: bool = True) -> list[Block]:
        """Return the regressions, linear in the lag around one [s], (n,).

        Args:
            lag: that one.
            width: speed over which friction changes its sign [rad/s or m/s], (n,).
            linear: whether the twist of elastic joints follows the unknowns; else it stays.
        """
        width = self.width if width is None else width
        blocks = []
        for index, form in enumerate(self.forms):
            torque, by_lag = form.torque(lag)
            of_joints = self._rows_of_joints(form, width)
            late = self._lag_rows(by_lag)
            further = [self._friction_rows(form, width, name) for name in self.frictions]
            further += [self._coupling_rows(form, width, coupled) for coupled in self.coupled]
            if self.twist is not None:
                twisted, follows = self.twisted[index], float(linear)
                further.append(follows * twisted.slope)
                of_joints += follows * twisted.rows
                late += follows * self._for_lags(twisted.late)
                torque = torque + follows * twisted.known
            of_joints = of_joints.reshape(*torque.shape, -1)
            rows = np.concatenate([of_joints, *further, late], axis=-1)
            without_lag = torque - by_lag * lag
            blocks.append(Block(rows, without_lag, form.moving(_STILL), self.phases[index]))
        return blocks

    def _rows_of_joints(self, form: WeakForm, width: Array) -> Array:
        """Return the rows of the unknowns of every joint, (k, n, n, 14); rotors where torques have them."""
        rows, j = form.rows.copy(), np.arange(self.robot.n)
        rows[:, j, j, ROTOR] *= ~self.hidden
        rows[:, j, j, COULOMB] = form.signs(width)
        return rows

    def _lag_rows(self, by_lag: Array) -> Array:
        """Return the rows of the lags, (k, n, lags), from the derivative of the torques by them, (k, n)."""
        return self._for_lags(-by_lag[:, :, None] * np.eye(self.robot.n))

    def _for_lags(self, rows: Array) -> Array:
        """Return rows of a lag of each joint, (k, n, n), as they are, or for one lag of all, (k, n, 1)."""
        return rows if self.lags == self.robot.n else rows.sum(axis=-1, keepdims=True)

    def _friction_rows(self, form: WeakForm, width: Array, name: str) -> Array:
        """Return the rows of a further friction of the joints whose data ask for it, (k, n, n)."""
        if name == "load":
            size = np.abs(self.heavy.gravity(form.position))
        else:
            size = np.exp(-((form.velocity / _STRIBECK) ** 2))
        moments = self.frictions[name] * form.signs(width, size)
        return np.asarray(np.eye(self.robot.n) * moments[:, None])

    def _coupling_rows(self, form: WeakForm, width: Array, coupled: Coupled) -> Array:
        """Return the moments of a motor that turns with two joints, beside its own: (k, n, 3)."""
        joint, motor, sign = coupled
        rows = np.zeros((len(form.starts), self.robot.n, len(MOTOR)))
        for i, j in ((joint, motor), (motor, joint)):
            of_motor = form.rows[:, j, j][:, [ROTOR, VISCOUS]]
            rows[:, i, :2] = sign * of_motor
        velocity = form.velocity[:, [motor]] + sign * form.velocity[:, [joint]]
        signs = form.signs(np.full(1, width[motor]), 1.0, velocity)
        rows[:, [joint, motor], 2] = signs * np.array([sign, 1.0])
        return rows


def _phases(form: WeakForm, grid: Grid) -> npt.NDArray[np.intp]:
    """Return the phase of each test function in the period of the motion, if it has one; else its number."""
    since_first = form.times - form.times[:1]
    number: npt.NDArray[np.intp] = np.rint(since_first / form.hop).astype(np.intp)
    period = _period(grid)
    if period is None:
        return number
    hops = max(1, round(period / form.hop))
    return np.asarray(np.remainder(number, hops), dtype=np.intp)


def _period(grid: Grid) -> float | None:
    """Return the time after which a motion repeats [s]; None for none."""
    every = max(1, round(_PERIOD_STEP / grid.dt))
    step = every * grid.dt
    second = round(_ENDS / step)
    q = grid.q[::every][second : -second or None]
    amplitude = np.sqrt(2.0) * q.std(axis=0).max() if len(q) else 0.0
    shortest = max(1, round(_SHORTEST_PERIOD / step))
    for shift in range(shortest, len(q) // 2 + second):
        if shift >= len(q) - 1:
            return None
        difference = _mean_square_change(q, shift)
        if np.sqrt(difference.max()) < _SAME * amplitude:
            near = range(shift, min(shift + max(1, second), len(q) - 1))
            differences = [float(((q[other:] - q[:-other]) ** 2).mean()) for other in near]
            return float(near[int(np.argmin(differences))] * step)
    return None


def _mean_square_change(q: Array, shift: int) -> Array:
    """Return the mean square of the change of each joint's position over some samples, (n,)."""
    change = q[shift:] - q[:-shift]
    return np.asarray((change**2).mean(axis=0))
