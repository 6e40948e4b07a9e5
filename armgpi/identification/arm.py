"""Identify: from logs of positions and torques to the arm that made them, with intervals."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from armgpi.base.arrays import Array, PerJointInput, check_choice, check_type, frozen, quantity
from armgpi.base.hints import with_keyword_hints
from armgpi.base.renamed import warn_renamed
from armgpi.errors import ParameterError, UnfitLog
from armgpi.identification import estimate
from armgpi.identification.check import (
    LIGHT,
    carrying_joint,
    check,
    check_bodies,
    check_fit,
    check_friction,
    check_robot,
    check_rotors,
    refuse,
)
from armgpi.identification.chirp import Side, find_side
from armgpi.identification.elastic import (
    MOST_SOFT,
    SOFT,
    Twist,
    Twisted,
    expected_compliance,
    knows_stiffness,
)
from armgpi.identification.estimate import Block, Fit, Prior
from armgpi.identification.logs import TORQUES, Grid, Log, read_log, resample, with_torques
from armgpi.identification.posterior import Posterior, with_parameters
from armgpi.identification.resonance import Gears, find_gears
from armgpi.identification.samples import Finding
from armgpi.identification.simulated import simulate_experiment
from armgpi.identification.weak_form import (
    BODY,
    COLUMNS,
    COULOMB,
    OFFSET,
    ROTOR,
    VISCOUS,
    WeakForm,
    inverse_rows,
)
from armgpi.plants.reality import scales
from armgpi.robot.batch import RobotBatch
from armgpi.robot.drives import Drives
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import SCATTER, assume_gears, with_published

#: Widths over which the sign of velocity may be smoothed [rad/s or m/s], and the one to begin with.
WIDTHS, _FIRST_WIDTH = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2), 5e-3
#: Slower than this is at rest [rad/s or m/s].
_STILL = 4e-3
#: Rounds in which the lag settles: it enters almost linearly.
_LAG_ROUNDS = 3
#: A lag or a friction of each joint has to explain so much of the residual's power that is left without.
_WORTH = 0.1
#: Residual over torque from which there is anything for another friction to explain.
_SEEN = 5e-3
#: What friction may have besides, where the data ask for it: a share of the gravity torque, as gears rub more
#: under load, and what comes on top near rest (Stribeck), over a speed [rad/s or m/s]. Width of the prior: a
#: share, and one of that of Coulomb friction.
FRICTIONS: Mapping[str, float] = {"load": 0.2, "stribeck": 0.5}
_STRIBECK = 0.05
#: A motor that turns with its neighbour's joint, as those of wrists do, is taken where it explains so much of
#: what is left of either joint; what it has then, each beside its own.
_COUPLED, MOTOR = 0.3, ("rotor", "viscous", "coulomb")
#: Elastic joints are taken where they explain so much of what is left, all joints together (geometric mean of
#: powers), or where their stiffness is known. The first share is for a known side of the encoders, the second
#: for an unknown one, as then more is free to fit. Soft arms had 52 % and more, stiff ones with sharp
#: friction 35 % and less; the first share was chosen on two logs of soft Pandas.
_ELASTIC, _ELASTIC_BLIND = 0.45, 0.8
#: Rounds in which the twist of the gears settles, and the change of a compliance that ends them, as a share.
_TWIST_ROUNDS = 8
_TWIST_SETTLED = 2e-2
#: Lower and upper end of the interval of a stiffness from slow motions, over it.
_STIFFNESS_WITHIN = (0.5, 2.0)
#: What is estimated of drives -> its name there; and the share of the data from which it is identified.
_DRIVES, _DECIDED = (
    {"rotor": "rotor_inertia", "coulomb": "coulomb", "viscous": "viscous", "offset": "offset"},
    0.5,
)
#: Share of the rotors that the log decided, too light, from which sensors behind the gears hide them.
_MOST_LIGHT = 0.5
#: Half width of a 95 % interval in standard deviations.
_95 = 1.96
#: Shortest period that is looked for [s], and the step in which it is [s].
_SHORTEST_PERIOD, _PERIOD_STEP = 2.0, 0.02
#: Most that two periods may differ, as a share of the motion.
_SAME = 0.03
#: Configurations at which inertia matrices are compared.
_CONFIGURATIONS = 50
#: Half width of the 95 % interval of the common factor of torque constants: a magnet's remanence and a
#: gear's efficiency, which no log without a known load tells.
_CONSTANTS = 0.1
#: Samples by which lags of joints may differ as delays do.
_LAG_SAMPLES = 2.5
#: Factor by which the last link may be farther from the file's where it may carry a payload.
_PAYLOAD = 10.0
#: Least inertia of a joint, over that of the largest, that is compared with the file's.
_INERT = 0.1
#: Expected load over the arm's mass, and its radius about the tip [m].
_LOAD, _LOAD_RADIUS = 0.2, 0.15


class Estimate(NamedTuple):
    """One number of a joint.

    Attributes:
        joint: its name.
        quantity: "mass", ..., "rotor", "coulomb", "viscous", "offset", "load", "stribeck", "stiffness",
            "lag", "inertia".
        value: the estimate, in SI units.
        lower: lower end of its 95 % interval.
        upper: upper end.
        data_share: share of it that the log decided; the rest is what was expected of the arm.
        expected: what the file contains, or what is assumed.
    """

    joint: str
    quantity: str
    value: float
    lower: float
    upper: float
    data_share: float
    expected: float

    @property
    def learned(self) -> float:
        """Return `data_share`; its old name."""
        warn_renamed("learned", "data_share")
        return self.data_share


class Load(NamedTuple):
    """A load at the tip, in the tip's frame; intervals are one standard deviation.

    Attributes:
        mass: [kg].
        mass_std: [kg].
        com: centre of mass [m], (3,).
        com_std: [m], (3,).
        inertia: about the centre, in the frame's axes [kg m^2], (3, 3).
        frame: the tip.
        scale: half width of the 95 % interval of the common factor of the torque constants, as a share, which
            is in `mass_std` too; 0 where torques are no currents, or that factor is known.
    """

    mass: float
    mass_std: float
    com: Array
    com_std: Array
    inertia: Array
    frame: str
    scale: float = 0.0


class Validation(NamedTuple):
    """Predicted against measured torque on a log, by the moments of the weak form.

    Attributes:
        source: the log.
        identified: residual over torque of the identified arm, (n,) [-].
        file: the same of the file's arm.
        times: of the moments [s], (k,).
        position: of the joints then [rad or m], (k, n).
        velocity: likewise [rad/s or m/s], (k, n).
        torque: measured mean torques, gravity and all [N m or N], (k, n).
        predicted: what the identified arm predicts, (k, n).
    """

    source: str
    identified: Array
    file: Array
    times: Array
    position: Array
    velocity: Array
    torque: Array
    predicted: Array


class Identified:
    """What logs say of an arm; :func:`identify` makes it.

    Attributes:
        robot: the arm, with its bodies, rotor inertia and friction.
        file: the arm as it was given, with what is published of its drives.
        lag: time by which measured positions lag behind torques [s], (n,).
        lag_std: its standard deviation [s], (n,).
        width: speed over which friction changes its sign [rad/s or m/s], (n,).
        findings: what the check before the fit remarked.
        residuals: residual over torque on the logs themselves, (n,) [-].
        sources: where the logs came from.
        dt: sample time of the first log [s].
        torque: what the torques of the logs are: "motor", "joint" or "commanded"; empty where nobody said.
        hidden: joints whose rotor and motor friction are not in the torques, (n,): these stay assumed.
        gears: their stiffness and the first mode, where a log of a multisine was given; else None.
        twist: the elastic joints with which the logs were fitted, as their first mode is low; else None.
        side: what chirps say of the side of the encoders, where a log of them was given; else None.
        simulated: residual over torque of the arm simulated with the experiment of the first log, (n,), where
            that was given, infinite where it fails; else None.
    """

    def __init__(
        self,
        data: _Data,
        fitted: Fit,
        prior: Prior,
        findings: Sequence[Finding],
    ) -> None:
        """Take over a regression; users call :func:`identify`."""
        self.gears: Gears | None = None
        self.simulated: Array | None = None
        self.side: Side | None = None
        self._shaken: Log | None = None  # the log that the gears are of
        self._data, self._fit, self._prior = data, fitted, prior
        self.file, self.findings = data.robot, tuple(findings)
        own = np.arange(data.robot.n)[data.hidden] * len(COLUMNS) + ROTOR
        fitted.physical[own] = 0.0  # no column has them, and a solver may leave them anywhere
        self.theta = prior.mean + prior.std * fitted.physical
        self._std = prior.std * np.sqrt(np.diag(fitted.covariance))
        joints = len(COLUMNS) * data.robot.n
        self.lag = frozen(np.broadcast_to(self.theta[-data.lags :], data.robot.n))
        self.lag_std = frozen(np.broadcast_to(self._std[-data.lags :], data.robot.n))
        self.width = frozen(data.width)
        self.sources = tuple(log.source for log in data.logs)
        self.dt = data.grids[0].dt
        self.torque, self.hidden = data.torque, data.hidden.copy()
        self.twist = data.twist
        self.robot = with_parameters(data.robot, self.theta[:joints])
        self.robot = self.robot.with_drives(self.drives)
        self.residuals = frozen(_shares(fitted.residuals, data.torques(self.lag)))

    @property
    def light(self) -> npt.NDArray[np.bool_]:
        """Which rotors that the log decided came out far too light for a motor behind a gear, (n,)."""
        rows = [row for row in self.table() if row.quantity == "rotor"]
        light = [row.data_share > _DECIDED and row.upper < LIGHT * row.expected for row in rows]
        return np.array(light) & ~_without_rotors(self.file)

    @property
    def posterior(self) -> Posterior:
        """What the logs leave open, as a normal distribution of the unknowns of the joints within bounds.

        Rotors are bounded by what is known of them beside the logs. Friction of motors that are not in the
        torques comes on top of what was found, within what :attr:`drives` says.
        """
        n = self.file.n
        own = slice(0, len(COLUMNS) * n)
        std, mean = self._prior.std[own], self.theta[own].copy()
        covariance = self._fit.covariance[own, own].copy()
        lower, upper = (np.full((n, len(COLUMNS)), end) for end in (-np.inf, np.inf))
        lower[:, ROTOR], upper[:, ROTOR] = self._rotor_bounds()
        for column in (VISCOUS, COULOMB):
            places = np.flatnonzero(self.hidden) * len(COLUMNS) + column
            covariance[places, places] += 1.0
            lower[self.hidden, column], upper[self.hidden, column] = self._hidden_friction(column)
        rotors = self._exact_rotors
        exact = np.isfinite(rotors)
        places = np.flatnonzero(exact) * len(COLUMNS) + ROTOR
        mean[places] = rotors[exact]
        covariance[places, :] = covariance[:, places] = 0.0
        lower[exact, ROTOR], upper[exact, ROTOR] = -np.inf, np.inf
        return Posterior.of(mean, std, covariance, (lower.ravel(), upper.ravel()))

    @property
    def _exact_rotors(self) -> Array:
        """Return rotors that torques do not show and that were specified exactly, (n,); NaN for others."""
        known = self.file.drives.data.get("rotor_inertia", {})
        exact = np.full(self.file.n, np.nan)
        for joint, name in enumerate(self.file.joint_names):
            datum = known.get(name)
            if self.hidden[joint] and datum is not None and not datum.low < datum.high:
                exact[joint] = datum.value
        return exact

    def _rotor_bounds(self) -> tuple[Array, Array]:
        """Return what is known of the rotors beside the logs [kg m^2 or kg], (n,) each; else infinite."""
        lower, upper = np.full((2, self.file.n), np.inf) * np.array([[-1.0], [1.0]])
        expected = self._prior.mean[ROTOR : len(COLUMNS) * self.file.n : len(COLUMNS)]
        for joint, name in enumerate(self.file.joint_names):
            value = float(self.theta[joint * len(COLUMNS) + ROTOR])
            lower[joint], upper[joint] = self._known_rotor(name, value, float(expected[joint]))
        if self.side is not None:
            chirped = self._chirped
            lower[chirped], upper[chirped] = self.side.low[chirped], self.side.high[chirped]
        return lower, upper

    def _hidden_friction(self, column: int) -> tuple[Array, Array]:
        """Return the ends of the friction where motors are not in the torques, (hidden,) each."""
        rows = [row for row in self.table() if row.quantity == COLUMNS[column]]
        hidden = [row for row, own in zip(rows, self.hidden, strict=True) if own]
        return np.array([row.lower for row in hidden]), np.array([self._with_motor(row) for row in hidden])

    @property
    def drives(self) -> Drives:
        """Rotors, friction and gears with their intervals: "identified" where the logs decided them.

        Rotors and motor friction that are not in the torques of the logs, and rotors that are not plausible
        for a motor, are "assumed".
        """
        drives = self._add_stiffness(self._fitted_drives)
        if self.side is not None:
            drives = self.side._replace(identified=self._chirped).add_to(drives)
        return drives

    @property
    def _fitted_drives(self) -> Drives:
        """Rotors, friction and offsets by the fit alone."""
        drives = self.file.drives
        implausible = {each.joint for each in self._rotor_findings()}
        hidden = dict(zip(self.file.joint_names, self.hidden, strict=True))
        for row in self.table():
            if not (name := _DRIVES.get(row.quantity)):
                continue
            known = row.joint in drives.data.get(name, {})
            if hidden[row.joint] and row.quantity == "rotor" and known:
                continue
            decided = row.data_share > _DECIDED and not hidden[row.joint]
            decided &= not (row.quantity == "rotor" and row.joint in implausible)
            upper = row.upper
            if hidden[row.joint] and row.quantity != "rotor":
                upper = self._with_motor(row)
            value, low, high = ({row.joint: x} for x in (row.value, row.lower, upper))
            drives = drives.with_value(name, value, low, high, "identified" if decided else "assumed")
        return drives

    def _with_motor(self, row: Estimate) -> float:
        """Return the upper end of friction behind a sensor, when the motor's comes on top."""
        joint, column = self.file.joint_names.index(row.joint), COLUMNS.index(row.quantity)
        std = float(self._prior.std[joint * len(COLUMNS) + column])
        return max(row.upper, row.value + std)

    @property
    def _chirped(self) -> npt.NDArray[np.bool_]:
        """Which rotors are those of a log of chirps, as the other logs did not decide them, (n,)."""
        if self.side is None:
            return np.zeros(self.file.n, dtype=bool)
        undecided = [each != "identified" for each in self._fitted_drives.sources("rotor_inertia")]
        return np.asarray(self.side.identified & np.array(undecided), dtype=np.bool_)

    def _add_stiffness(self, drives: Drives) -> Drives:
        """Return drives with the stiffness that the logs show, and the side that it was found for.

        That of slow motions is no more than a better assumption: it counts as assumed. That of a multisine
        comes before it. Chirps, which are added later, overrule the side: they alone are made to tell it.
        """
        if self.twist is not None:
            soft = assume_gears(self.file).drives.data.get("stiffness", {})
            value = {joint: datum.value for joint, datum in soft.items() if datum.source == "assumed"}
            for row in self.table():
                if row.quantity == "stiffness" and row.joint in value and math.isfinite(row.upper):
                    value[row.joint] = row.value
            if value:
                low, high = ({joint: f * x for joint, x in value.items()} for f in _STIFFNESS_WITHIN)
                drives = drives.with_value("stiffness", value, low, high, "assumed")
        if self.gears is not None:
            drives = self.gears.add_to(drives)
            if self.gears.measured.any():
                drives = drives.with_value("encoder_side", self.gears.side, source="identified")
        return drives

    def with_resonance(self, log: Any) -> Identified:
        """Return the same with the gears that a log of ``armgpi excite --resonance`` shows.

        Args:
            log: of the same arm, see :func:`identify`.

        Raises:
            UnfitLog: when it shows no joint's multisine.
        """
        other = copy.copy(self)
        other._shaken = self._data.read(log)
        other.gears = find_gears(self.robot, other._shaken, self.lag, self._data.gravity)
        return other._with_own_drives()

    def with_side(self, log: Any) -> Identified:
        """Return the same with the side of the encoders that a log of ``armgpi excite --side`` shows.

        Its rotors are taken where the other logs did not decide them.

        Args:
            log: of the same arm, see :func:`identify`.

        Raises:
            UnfitLog: when it shows no joint's chirp.
            ParameterError: for torques of sensors behind the gears, by this log or the others.
        """
        other = copy.copy(self)
        other.side = find_side(self.robot, self._data.with_rotors(self._data.read(log)))
        shaken, side = self._shaken, other.side.side
        if shaken is not None and self.gears is not None and side not in ("", self.gears.side):
            # The stiffness was found for the other side.
            robot = self.robot.with_drives(self.robot.drives.with_value("encoder_side", side))
            other.gears = find_gears(robot, shaken, self.lag, self._data.gravity)
        return other._with_own_drives()

    def _with_own_drives(self) -> Identified:
        """Take over into the robot what is known of the drives now, and return the same."""
        self.robot = self.robot.with_drives(self.drives)
        return self

    def with_experiment(self, path: str | PathLike[str]) -> Identified:
        """Return the same with a second opinion: what the arm takes when it is simulated.

        Args:
            path: of the experiment file that the first log is of, both from its begin.

        Raises:
            ConfigError: for a file that is no experiment, or is one of drawn arms.
            ParameterError: when the first log is of another experiment.
        """
        data, n, other = self._data, self.file.n, copy.copy(self)
        tau = simulate_experiment(path, self.robot, self.late, data.grids[0])
        twin = WeakForm(data.model, data.grids[0]._replace(tau=tau))
        measured, simulated = (form.torque(np.zeros(n))[0] for form in (data.forms[0], twin))
        measured = np.where(data.blocks(self.lag)[0].valid, measured, np.nan)
        shares = _shares([measured - simulated], [measured])
        other.simulated = frozen(np.full(n, np.inf) if np.isinf(tau).any() else shares)
        return other

    def table(self, bodies: bool = False) -> list[Estimate]:
        """Return the estimates of every joint: drives, offset and lag, and those of its body if asked for.

        Where the data ask for it there are friction that grows with the load ("load", a share of the gravity
        torque) or towards rest ("stribeck"), and what a motor has that turns with another joint as well
        ("rotor with wrist_1", ...).
        """
        names = self.robot.joint_names
        rows = []
        for i, joint in enumerate(names):
            for j, name in enumerate(COLUMNS):
                if bodies or j >= len(BODY):
                    rows.append(self._estimate(joint, name, i * len(COLUMNS) + j))
            for k, (kind, asked) in enumerate(self._data.frictions.items()):
                if asked[i]:
                    rows.append(self._estimate(joint, kind, (len(COLUMNS) + k) * len(names) + i))
            for k, (one, other, _) in enumerate(self._data.coupled):
                place = (len(COLUMNS) + len(self._data.frictions)) * len(names) + k * len(MOTOR)
                rows += [
                    self._estimate(joint, f"{kind} with {names[one]}", place + m)
                    for m, kind in enumerate(MOTOR)
                    if other == i
                ]
            end = len(self.theta) - self._data.lags
            if self.twist is not None:
                rows.append(self._stiffness(joint, end - len(names) + i))
            rows.append(self._estimate(joint, "lag", end + min(i, self._data.lags - 1)))
        return rows

    def sums(self) -> list[Estimate]:
        """Return, joint by joint, the mean of its diagonal of D(q), rotor included.

        A rotor near the base cannot be told from the links, and this sum can.
        """
        rows = []
        for joint, own in zip(self.robot.joint_names, self._data.inertias(), strict=True):
            combination = np.zeros(len(self.theta))
            combination[: len(own)] = own
            value, expected = float(combination @ self.theta), float(combination @ self._prior.mean)
            scaled = combination * self._prior.std
            std = float(np.sqrt(scaled @ self._fit.covariance @ scaled))
            inverse = np.linalg.solve(self._fit.information, scaled)
            learned = 1.0 - float(scaled @ inverse) / float(scaled @ scaled)
            ends = (max(value - _95 * std, 0.0), value + _95 * std)
            rows.append(Estimate(joint, "inertia", value, *ends, learned, expected))
        return rows

    @property
    def link_distance(self) -> float:
        """How far all links but the last are from the file's, over what is expected, squared and summed.

        The last link may carry anything: its expected value is widened, so that a payload is found there and
        not in the links before it.
        """
        n, fitted = self.file.n, self._fit
        carrying = carrying_joint(self.file)
        place = carrying * len(COLUMNS)
        body = np.arange(place, place + len(BODY))
        information = fitted.information.copy()
        information[body, body] -= 1.0 - 1.0 / _PAYLOAD**2
        free = np.linalg.solve(information, fitted.information @ fitted.free)
        bodies = free[: len(COLUMNS) * n].reshape(n, -1)[:, : len(BODY)]
        links = np.delete(bodies, carrying, axis=0)
        return float((links**2).sum())

    @property
    def _tip(self) -> Any:
        """Return the frame of the tip, as Pinocchio has it."""
        return self.file._model.frames[self.file._frame(self.file.tip)]

    @property
    def inertia_ratios(self) -> Array:
        """Mean inertia of each joint over that of the file, rotors left out, (n,).

        NaN of joints with less than a tenth of the largest one: a tool at a wrist multiplies its inertia.
        """
        none = np.zeros(self.file.n)
        own, file = (mean_inertia(arm.with_armature(none)) for arm in (self.robot, self.file))
        return np.where(file > _INERT * file.max(), own / np.maximum(file, np.finfo(float).tiny), np.nan)

    def sample(self, count: int = 64, seed: int = 0) -> RobotBatch:
        """Return arms drawn from what the logs leave open, each physical.

        Args:
            count: how many.
            seed: the same seed gives the same arms.
        """
        return self.posterior.sample(self.file, count, seed)

    def delta(self, box: tuple[Array, Array] | None = None, count: int = 32) -> tuple[float, float]:
        """Return the interval of the eigenvalues of D_true^-1 D of arms drawn, over configurations.

        Args:
            box: lower and upper ends of the configurations [rad or m], each (n,); the joint ranges if None.
            count: arms.
        """
        q = random_configurations(self.robot, _CONFIGURATIONS, seed=0)
        if box is not None:
            lower, upper = (np.asarray(end, dtype=float) for end in box)
            q = np.random.default_rng(0).uniform(lower, upper, (_CONFIGURATIONS, self.robot.n))
        own = self.robot.mass_matrix(q)
        eigenvalues = [
            np.linalg.eigvals(np.linalg.solve(each.mass_matrix(q), own)).real
            for each in self.sample(count).robots
        ]
        return float(np.min(eigenvalues)), float(np.max(eigenvalues))

    @property
    def late(self) -> float:
        """Time by which positions lag behind torques that a controller has to allow for [s].

        The largest lag of the joints; where lags differ by more than delays do, as friction with memory makes
        them, their median. Never below zero.
        """
        lag = float(np.median(self.lag)) if self._lags_differ else float(self.lag.max())
        return max(lag, 0.0)

    @property
    def _lags_differ(self) -> bool:
        """Tell whether lags differ by more than delays do, or positions come before torques."""
        most = _LAG_SAMPLES * max(grid.dt for grid in self._data.grids)
        return bool(np.ptp(self.lag) > most or self.lag.min() < -most)

    def _lag_findings(self) -> list[Finding]:
        """Return that lags are no delays, where they are not."""
        if not self._lags_differ:
            return []
        low, high = f"{1e3 * self.lag.min():.2g}", f"{1e3 * self.lag.max():.2g}"
        lags = f"the lags that fit best are {low} to {high} ms, and no delay differs so between joints"
        if low == high:
            lags = f"the lag that fits best is {low} ms: the positions come before the torques"
        said = (
            f"{lags}; friction with memory (presliding), or clocks that differ, look like that. The "
            f"controller is made for {1e3 * self.late:.2g} ms"
        )
        return [Finding("warning", "", said)]

    def load(self, log: Any, *, check_first: bool = True, scale_known: bool = False) -> Load:
        """Return what the arm carried in another log, by a fit of all logs together.

        Args:
            log: of the same arm with the load fixed to its tip; see :func:`identify`.
            check_first: whether that log has to pass the check.
            scale_known: whether the common factor of the torque constants is known, by another load. Where it
                is not, and the logs are currents, it is within 10 %, and so is the mass.

        Raises:
            UnfitLog: when that log does not pass the check.
        """
        data = self._data.join([log])
        refuse(data.findings(1) if check_first else [])
        tip = self._tip
        place = carrying_joint(self.file) * len(COLUMNS)
        prior = estimate.extend(data.prior, self._expected_load(), body=True)
        blocks = data.blocks(self.lag)
        last = len(blocks) - 1
        for index, block in enumerate(blocks):
            is_carried = float(index == last)
            carried = is_carried * block.rows[..., place : place + len(BODY)]
            blocks[index] = block._replace(rows=np.concatenate([block.rows, carried], axis=-1))
        fitted = estimate.fit(blocks, prior)
        load = _load(fitted, prior, tip, self.file.tip)
        constants = self._data.current
        if scale_known or constants is None or np.all(constants == 1.0):
            return load
        mass_std = float(np.hypot(load.mass_std, _CONSTANTS / _95 * load.mass))
        return load._replace(mass_std=mass_std, scale=_CONSTANTS)

    def _expected_load(self) -> Array:
        """Return the standard deviations of the ten parameters of a load, about the joint that carries it."""
        mass = _LOAD * scales(self.file).mass
        first, second = mass * _LOAD_RADIUS, mass * _LOAD_RADIUS**2
        about_tip = np.array([mass, *[first] * 3, *[second] * 6])
        reach = float(np.linalg.norm(self._tip.placement.translation))
        farther = 1.0 + reach / _LOAD_RADIUS
        return np.asarray(about_tip * np.array([1.0, *[farther] * 3, *[farther**2] * 6]))

    def validate(self, log: Any) -> Validation:
        """Return how well the arm predicts the torques of a log that it has not seen."""
        return self._judge(self._data.with_logs([log]))

    @property
    def replayed(self) -> Validation:
        """How well it predicts the torques of the first log that it was fitted to."""
        return self._judge(self._data)

    def _judge(self, data: _Data) -> Validation:
        """Return how well the arm predicts the torques of the first of some logs."""
        block, form = data.blocks(self.lag, linear=False)[0], data.forms[0]
        weight = block.rows[0, 0, OFFSET]
        moments = block.torque - block.rows[..., -data.lags :] @ self.theta[-data.lags :]
        torque = np.where(block.valid, moments, np.nan)
        predicted, expected = (
            block.rows[..., : -data.lags] @ x[: -data.lags] for x in (self.theta, self._prior.mean)
        )
        shares = [_shares([torque - x], [torque]) for x in (predicted, expected)]
        middle = np.rint(form.times / data.grids[0].dt).astype(np.intp)
        motion = form.times, form.position[middle], form.velocity[middle]
        identified, file = shares
        return Validation(data.logs[0].source, identified, file, *motion, torque / weight, predicted / weight)

    def _estimate(self, joint: str, quantity: str, place: int) -> Estimate:
        """Return one unknown; what cannot be negative has an interval that is not."""
        value, std = float(self.theta[place]), float(self._std[place])
        least = 0.0 if place in self._prior.positive else -np.inf
        ends = (max(value - _95 * std, least), value + _95 * std)
        learned, expected = float(self._fit.learned[place]), float(self._prior.mean[place])
        if quantity == "lag":
            expected = 0.0
        if quantity == "rotor":
            ends = self._rotor_ends(joint, value, expected, ends)
        return Estimate(joint, quantity, value, *ends, learned, expected)

    def _rotor_ends(
        self, joint: str, value: float, expected: float, ends: tuple[float, float]
    ) -> tuple[float, float]:
        """Return the interval of a rotor: where the log leaves it open, that of what was known before.

        A rotor that cannot be told from its link has an interval down to zero by the log alone, as the prior
        of the fit is wide. A controller has to be stable at its lower end, and would be for an arm whose
        motor nobody builds. A rotor that came out beyond what was known keeps its end there: that is found.
        """
        lower, upper = ends
        least, most = self._known_rotor(joint, value, expected)
        if self.hidden[self.file.joint_names.index(joint)]:
            return least, most
        return max(lower, least), min(upper, most)

    def _known_rotor(self, joint: str, value: float, expected: float) -> tuple[float, float]:
        """Return the interval of a rotor that was known before; endless where it came out beyond."""
        known = self.file.drives.data.get("rotor_inertia", {}).get(joint)
        least, most = expected / SCATTER, expected * SCATTER
        if known is not None and known.low < known.high:
            least, most = known.low, known.high
        if self.hidden[self.file.joint_names.index(joint)]:
            return least, most
        return (least if value > least else -math.inf), (most if value < most else math.inf)

    def _stiffness(self, joint: str, place: int) -> Estimate:
        """Return the stiffness of a joint, 1 / compliance; endless where the log does not bound it."""
        row = self._estimate(joint, "compliance", place)
        with np.errstate(divide="ignore"):
            value, lower, upper, expected = (
                float(1.0 / np.maximum(x, 0.0)) for x in (row.value, row.upper, row.lower, row.expected)
            )
        return row._replace(quantity="stiffness", value=value, lower=lower, upper=upper, expected=expected)

    def _twist_findings(self) -> list[Finding]:
        """Return that the logs were fitted with elastic joints, where they were."""
        if self.twist is None:
            return []
        mode, explained = self.twist.mode(self.file.middle()), self._data.explained
        said = (
            f"the joints are elastic: the logs were fitted with their stiffness, encoders at the "
            f"{self.twist.side}s, and a first mode of {mode:.2g} Hz in the middle, which explains "
            f"{100.0 * explained:.2g} % of what stiff joints leave of the torques; armgpi excite --resonance "
            "measures it"
        )
        return [Finding("warning", "", said)]

    def _rotor_findings(self) -> list[Finding]:
        """Return which rotors that the log decided are not plausible for a motor."""
        rows = [row for row in self.table() if row.quantity == "rotor"]
        none = _without_rotors(self.file)
        decided = [row for row, own in zip(rows, none, strict=True) if row.data_share > _DECIDED and not own]
        value, low, high, expected = (
            np.array([getattr(row, name) for row in decided])
            for name in ("value", "lower", "upper", "expected")
        )
        return check_rotors([row.joint for row in decided], value, (low, high), expected)

    def __repr__(self) -> str:
        """Return a one-line description."""
        worst = int(np.nanargmax(self.residuals))
        return (
            f"Identified({self.robot.name!r}, {', '.join(self.sources)}: median residual "
            f"{100 * np.nanmedian(self.residuals):.2g} % of the torque, "
            f"worst {100 * self.residuals[worst]:.2g} % at {self.robot.joint_names[worst]})"
        )


@with_keyword_hints
def identify(
    logs: Any,
    robot: Robot,
    *,
    gravity: bool = True,
    check_first: bool = True,
    current: PerJointInput | None = None,
    columns: Mapping[str, str] | None = None,
    torque: str | None = None,
) -> Identified:
    """Return the arm that made a log of measured positions and commanded torques.

    Nothing is known of the controller; no velocities or accelerations are needed. Bodies, rotor inertia,
    Coulomb and viscous friction, an offset of each joint and the lag between torques and positions are
    estimated together, with the robot as given for what the log does not decide. Every estimate is physical.

    Args:
        logs: a log or several of one arm: a :class:`~armgpi.identification.logs.Log`, a rollout, or the
            path of a CSV file with the columns ``time`` [s], ``q_<joint>`` and ``tau_<joint>``, or of a
            NetCDF file.
        robot: the arm as its file has it.
        gravity: whether the torques carry the arm's weight; False where the arm's own controller adds that.
        check_first: whether a log that fails a check, before the fit or of it, is refused.
        current: torque at the joint for a unit of what is logged [N m/A or N/A], where that is currents: a
            number, (n,), or joint -> number. A wrong one is not seen: it makes a heavier or lighter arm.
            Columns named ``current_<joint>``, or in A, need it.
        columns: what the columns of CSV files are called, see :func:`~armgpi.identification.logs.read_log`.
        torque: what the torques are: "motor" (current times a constant), "joint" (a sensor behind the gear)
            or "commanded". In those of a joint there are no rotors and no motor friction: these stay assumed.
            None is what the logs say; where they do not, and most rotors come out far too small for a motor,
            the torques are taken for those of joints, and that is a finding.

    Raises:
        UnfitLog: when a log does not pass the check; the message says what the arm must do.
        ArrayError: for a log of other shapes, times that do not increase, or numbers that are not finite.
        ParameterError: for a robot whose joints follow others, something that is no log, or currents without
            their torque constants.
        MissingPackage: when Clarabel is not installed.
    """
    check_type(robot, "robot", Robot, "a Robot")
    check_type(gravity, "gravity", bool, "True or False")
    check_type(check_first, "check_first", bool, "True or False")
    if torque is not None:
        check_choice(torque, "torque", TORQUES)
    several = isinstance(logs, (list, tuple)) and not isinstance(logs, Log)
    constants = None if current is None else quantity(current, "current", robot.joint_names)
    robot = with_published(robot)
    data = _Data(robot, gravity, constants, columns).with_logs(list(logs) if several else [logs])
    if not data.forms:
        raise ParameterError("logs", logs, "at least one log")
    findings = data.findings(len(data.grids))
    if check_first:
        refuse(findings)
    if torque is not None:
        data.torque = torque
    if data.torque == "joint":
        data.hide(np.ones(robot.n, dtype=bool))
    found = _fit(data, findings)
    light = found.light
    if light.any():
        findings = [*findings, *_hide_rotors(data, light, found)]
        found = _fit(data, findings)
    if check_first:
        rotors = [row for row in found.table() if row.quantity == "rotor"]
        least = np.array([row.lower / row.expected for row in rotors])
        refuse(check_fit(found.robot.joint_names, found.lag, found.residuals, least))
    unknowns = found._fit.physical[: len(COLUMNS) * robot.n].reshape(robot.n, -1)
    bodies = np.sqrt((unknowns[:, : len(BODY)] ** 2).mean(axis=1))
    coulomb = np.array([row.lower for row in found.table() if row.quantity == "coulomb"])
    found.findings += tuple(found._twist_findings())
    found.findings += tuple(found._lag_findings())
    found.findings += tuple(found._rotor_findings())
    found.findings += tuple(check_friction(robot.joint_names, data.expected, coulomb))
    found.findings += tuple(check_bodies(robot.joint_names, bodies, carrying_joint(robot)))
    found.findings += tuple(check_robot(robot.joint_names, found.link_distance, found.inertia_ratios))
    return found


def _fit(data: _Data, findings: Sequence[Finding]) -> Identified:
    """Return the fit of some logs, with the terms of friction, motors and lags that they ask for."""
    n = data.robot.n
    data.width, data.frictions, data.coupled, data.lags = np.full(n, _FIRST_WIDTH), {}, [], 1
    data.set_twist(None)
    lag = _settle(data, np.zeros(n))
    data.width = _choose_widths(data, lag)
    lag = _choose_elasticity(data, lag)
    _choose_frictions(data, lag)
    _choose_couplings(data, lag)
    lag = _settle(data, lag)
    if data.twist is not None:
        lag, _ = _settle_twist(data, data.twist, lag)
    fitted, prior = _with_lags(data, lag)
    if data.twist is not None:
        compliance = (prior.mean + prior.std * fitted.physical)[: len(prior.mean) - data.lags][-n:]
        data.set_twist(_twist_of(data, fitted, lag, data.twist.side, compliance))
    return Identified(data, fitted, prior, findings)


def _hide_rotors(data: _Data, light: npt.NDArray[np.bool_], found: Identified) -> list[Finding]:
    """Leave rotors out of a fit that came out too light for motors; return what is to be said of it."""
    names = data.robot.joint_names
    decided = sum(row.quantity == "rotor" and row.data_share > _DECIDED for row in found.table())
    if data.torque != "motor" and light.sum() > _MOST_LIGHT * decided:
        data.torque = "joint"
        data.hide(np.ones(data.robot.n, dtype=bool))
        said = (
            f"the rotors of {int(light.sum())} of {decided} joints came out far too light for motors, so the "
            "torques were taken as those of sensors behind the gears: rotor inertia and motor friction are "
            "not in them and stay assumed (--torque joint says so, --torque motor denies it)"
        )
        return [Finding("warning", "", said)]
    data.hide(light | data.hidden)
    return [each for each in found._rotor_findings() if light[names.index(each.joint)]]


class _Data:
    """The moments of some logs of one arm."""

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
        self.robot, self.gravity, self.current, self.lags = robot, gravity, current, 1
        self.columns = columns
        self.model = robot.pinocchio_model()
        if not gravity:
            self.model.gravity = pin.Motion.Zero()
        self.expected = estimate.expect(robot)
        self.width = np.full(robot.n, _FIRST_WIDTH)
        self.frictions: dict[str, npt.NDArray[np.bool_]] = {}
        self.coupled: list[tuple[int, int, float]] = []  # joints, and which way the motor of the second turns
        self.heavy = robot  # whose gravity is the load of the gears
        self.twist: Twist | None = None  # where joints are elastic
        self.explained = math.nan  # share that elastic joints explain of what stiff ones leave
        self.compliance = expected_compliance(robot)
        self.grids: list[Grid] = []
        self.rigid: list[WeakForm] = []  # as if links and motors were one
        self.forms: list[WeakForm] = []
        self.twisted: list[Twisted] = []  # where joints are elastic
        self.phases: list[npt.NDArray[np.intp]] = []
        self.logs: list[Log] = []  # as they were recorded
        self.torque = ""
        self.hidden = np.zeros(robot.n, dtype=bool)

    def hide(self, joints: npt.NDArray[np.bool_]) -> None:
        """Take the rotors of some joints, (n,), to be not in the torques: they stay what is expected."""
        self.hidden = joints.copy()
        mean, std = (
            each.reshape(self.robot.n, -1).copy() for each in (self.expected.mean, self.expected.std)
        )
        std[joints, ROTOR] = 0.5 * (SCATTER - 1.0 / SCATTER) / _95 * mean[joints, ROTOR]
        self.expected = self.expected._replace(std=std.ravel())

    def with_logs(self, logs: Sequence[Any]) -> _Data:
        """Return the same of other logs.

        Raises:
            UnfitLog: for one that is too short for a single moment.
        """
        other = _Data(self.robot, self.gravity, self.current, self.columns)
        other.width, other.lags, other.frictions = self.width, self.lags, self.frictions
        other.heavy, other.coupled = self.heavy, self.coupled
        other.torque, other.hidden, other.expected = self.torque, self.hidden, self.expected
        other.compliance = self.compliance
        for each in logs:
            log = self.read(each)
            other.torque = other.kind(log)
            grid = resample(log)
            form = WeakForm(self.model, grid)
            if not len(form.starts):
                length = f"{log.t[-1] - log.t[0]:.2g} s long"
                reason = f"it is {length}, without a second that has no gap: log longer ({log.source})"
                raise UnfitLog([reason])
            other.grids.append(grid)
            other.rigid.append(form)
            # The phase of each test function in the period of the motion, if it has one; else its number.
            phase: npt.NDArray[np.intp] = np.rint((form.times - form.times[:1]) / form.hop).astype(np.intp)
            if (period := _period(grid)) is not None:
                phase = np.remainder(phase, max(1, round(period / form.hop)))
            other.phases.append(phase)
            other.logs.append(log)
        other.set_twist(self.twist)
        return other

    def set_twist(self, twist: Twist | None) -> None:
        """Take the joints for elastic ones, or for stiff ones."""
        self.twist, self.forms, self.twisted = twist, list(self.rigid), []
        if twist is not None:
            self.twisted = [twist.apply(form) for form in self.rigid]
            self.forms = [each.form for each in self.twisted]

    def read(self, log: Any) -> Log:
        """Return a log with torques."""
        return with_torques(read_log(log, self.robot, columns=self.columns), self.current)

    def kind(self, log: Log) -> str:
        """Return what the torques of a log are: what it says itself, or those of the others are.

        Raises:
            ParameterError: when both are known, and not the same.
        """
        if log.torque and self.torque and log.torque != self.torque:
            wanted = f"logs of one kind of torque: the others are of {self.torque!r} torques"
            raise ParameterError(f"{log.source}: torque", log.torque, wanted)
        return log.torque or self.torque

    def with_rotors(self, log: Log) -> Log:
        """Return a log with what its torques are, which have to have the rotors in them.

        Raises:
            ParameterError: when it is of another kind than the other logs, or these have none of any rotor.
        """
        kind = self.kind(log)
        if self.hidden.all() and kind != "joint":
            wanted = "torques of the motors: in those of the other logs there is no joint's rotor"
            raise ParameterError(f"{log.source}: torque", kind or "not specified", wanted)
        return log._replace(torque=kind)

    def join(self, logs: Sequence[Any]) -> _Data:
        """Return the same with more logs."""
        other = self.with_logs(logs)
        other.grids, other.rigid = self.grids + other.grids, self.rigid + other.rigid
        other.forms, other.twisted = self.forms + other.forms, self.twisted + other.twisted
        other.phases, other.logs = self.phases + other.phases, self.logs + other.logs
        return other

    def findings(self, count: int) -> list[Finding]:
        """Return what the check says of the last logs."""
        pairs = list(zip(self.logs, self.grids, self.rigid, strict=True))[-count:]
        return [x for each in pairs for x in check(self.robot, self.gravity, self.expected, *each)]

    def inertias(self) -> Array:
        """Return the mean diagonal of D(q) as combinations of the unknowns of joints, (n, 14 n)."""
        n, free = self.robot.n, self.robot.pinocchio_model()
        free.gravity = pin.Motion.Zero()
        q = random_configurations(self.robot, _CONFIGURATIONS, seed=0)
        still = np.zeros_like(q)
        each = [
            inverse_rows(free, q, still, still + unit, np.ones(n))[:, j] for j, unit in enumerate(np.eye(n))
        ]
        combinations: Array = np.stack([rows.mean(axis=0) for rows in each])
        combinations[..., [COULOMB, VISCOUS, OFFSET]] = 0.0
        return combinations.reshape(n, -1)

    def torques(self, lag: Array) -> list[Array]:
        """Return the moments of the torques of every log."""
        return [form.torque(lag)[0] for form in self.forms]

    @property
    def prior(self) -> Prior:
        """What is expected of joints, further friction and lags."""
        coulomb = self.expected.std.reshape(self.robot.n, -1)[:, COULOMB]
        sizes = {"load": np.ones(self.robot.n), "stribeck": coulomb}
        stds = [FRICTIONS[name] * sizes[name] for name in self.frictions]
        own = self.expected.std.reshape(self.robot.n, -1)[:, [ROTOR, VISCOUS, COULOMB]]
        stds += [own[j] for _, j, _ in self.coupled]
        prior = estimate.extend(self.expected, np.concatenate([*stds, np.empty(0)]))
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
        found = []
        for index, form in enumerate(self.forms):
            torque, by_lag = form.torque(lag)
            own, late = self._own_rows(form, width), self._lag_rows(by_lag)
            more = [self._friction_rows(form, width, name) for name in self.frictions]
            more += [self._coupling(form, width, *each) for each in self.coupled]
            if self.twist is not None:
                twisted, follows = self.twisted[index], float(linear)
                more.append(follows * twisted.slope)
                own += follows * twisted.rows
                late += follows * self._for_lags(twisted.late)
                torque = torque + follows * twisted.known
            rows = np.concatenate([own.reshape(*torque.shape, -1), *more, late], axis=-1)
            found.append(Block(rows, torque - by_lag * lag, form.moving(_STILL), self.phases[index]))
        return found

    def _own_rows(self, form: WeakForm, width: Array) -> Array:
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
        return np.asarray(np.eye(self.robot.n) * (self.frictions[name] * form.signs(width, size))[:, None])

    def _coupling(self, form: WeakForm, width: Array, one: int, other: int, sign: float) -> Array:
        """Return the moments of a motor that turns with two joints, beside its own: (k, n, 3)."""
        rows = np.zeros((len(form.starts), self.robot.n, len(MOTOR)))
        for i, j in ((one, other), (other, one)):
            rows[:, i, :2] = sign * form.rows[:, j, j][:, [ROTOR, VISCOUS]]
        both = form.signs(
            np.full(1, width[other]), 1.0, form.velocity[:, [other]] + sign * form.velocity[:, [one]]
        )
        rows[:, [one, other], 2] = both * np.array([sign, 1.0])
        return rows


def _without_rotors(robot: Robot) -> npt.NDArray[np.bool_]:
    """Return of which joints somebody specified that they have no rotor, as those of direct drives, (n,)."""
    known = np.array([source != "" for source in robot.drives.sources("rotor_inertia")])
    return np.asarray((robot.drives.value("rotor_inertia") == 0.0) & known, dtype=np.bool_)


def mean_inertia(robot: Robot) -> Array:
    """Return a robot's mean diagonal of D(q), (n,), over the configurations of :meth:`Identified.sums`."""
    q = random_configurations(robot, _CONFIGURATIONS, seed=0)
    mean: Array = np.diagonal(robot.mass_matrix(q), axis1=1, axis2=2).mean(axis=0)
    return mean


def _settle(data: _Data, lag: Array) -> Array:
    """Return the lag around which the regression is linear [s], (n,)."""
    for _ in range(_LAG_ROUNDS):
        prior = data.prior
        fitted = estimate.fit(data.blocks(lag), prior, physical=False)
        lag = np.broadcast_to((prior.mean + prior.std * fitted.free)[-data.lags :], data.robot.n).copy()
    return lag


def _choose_widths(data: _Data, lag: Array) -> Array:
    """Return the width of the sign of each joint that leaves the least residual."""
    left = []
    for width in WIDTHS:
        blocks = data.blocks(lag, np.full(data.robot.n, width))
        left.append(_power(estimate.fit(blocks, data.prior, physical=False)))
    return np.asarray(np.array(WIDTHS)[np.argmin(left, axis=0)], dtype=np.float64)


class _ElasticFit(NamedTuple):
    """A fit with elastic joints.

    Attributes:
        explained: share of what stiff joints leave of the torques that it explains (geometric mean).
        twist: what the twist of the gears is computed from.
        lag: of positions behind torques [s], (n,).
    """

    explained: float
    twist: Twist
    lag: Array


def _choose_elasticity(data: _Data, lag: Array) -> Array:
    """Take the joints for elastic ones where they are soft; return the lag then [s], (n,).

    Soft is a first mode below :data:`SOFT` by a stiffness that is known, or one below :data:`MOST_SOFT` by
    elastic joints that explain much of what stiff ones leave.
    """
    _, most = data.compliance
    if not most.any():  # direct drives
        return lag
    fitted = estimate.fit(data.blocks(lag), data.prior)
    stiff = _twist_of(data, fitted, lag, "motor", np.zeros(data.robot.n))
    middle = data.robot.middle()
    known = bool(knows_stiffness(data.robot).all())
    if known and not stiff._replace(compliance=data.compliance[0]).mode(middle) < SOFT:
        return lag
    sides = _sides(data.robot)
    fits = [_fit_elastic(data, stiff._replace(side=side), lag, _power(fitted), known) for side in sides]
    data.set_twist(None)
    best = max((each for each in fits if each is not None), key=lambda each: each.explained, default=None)
    if best is None or best.twist.mode(middle) >= MOST_SOFT:
        return lag
    least = _ELASTIC if len(sides) == 1 else _ELASTIC_BLIND
    if best.explained < least and not known:
        return lag
    data.set_twist(best.twist)
    data.explained = best.explained
    return best.lag


def _sides(robot: Robot) -> tuple[str, ...]:
    """Return where the encoders may be: both sides, unless one is known of all joints."""
    known = set(robot.drives.value("encoder_side").tolist())
    if len(known) == 1 and "" not in known:
        return tuple(known)
    return ("motor", "link")


def _fit_elastic(data: _Data, stiff: Twist, lag: Array, left: Array, known: bool) -> _ElasticFit | None:
    """Return the fit with elastic joints and encoders at one side; None where they explain nothing at once.

    Args:
        data: of the logs; it keeps the twist.
        stiff: what the twist is computed from, without compliance.
        lag: to begin with [s], (n,).
        left: power of what stiff joints leave of the torque of each joint, (n,).
        known: whether the stiffness is known: then the fit is wanted whatever it explains.
    """
    data.set_twist(stiff)
    at_once = _power(estimate.fit(data.blocks(lag), data.prior, physical=False))
    if not known and _explained(at_once, left) < _WORTH:
        return None
    settled_lag, settled = _settle_twist(data, stiff, lag)
    assert data.twist is not None
    return _ElasticFit(_explained(settled, left), data.twist, settled_lag)


def _explained(power: Array, before: Array) -> float:
    """Return the share of powers before that is gone, all joints together (geometric mean)."""
    return 1.0 - math.exp(float(np.mean(np.log(power / before))))


def _twist_of(data: _Data, fitted: Fit, lag: Array, side: str, compliance: Array) -> Twist:
    """Return what the twist of gears is computed from by a fit."""
    n = data.robot.n
    joints = len(COLUMNS) * n
    theta = data.prior.mean + data.prior.std * fitted.physical
    arm = with_parameters(data.robot, theta[:joints]).with_armature(np.zeros(n)).pinocchio_model()
    arm.gravity = data.model.gravity
    return Twist(side, compliance, theta[:joints].reshape(n, -1), arm, data.width, lag, data.hidden)


def _settle_twist(data: _Data, twist: Twist, lag: Array) -> tuple[Array, Array]:
    """Find the compliance around which the regression is linear.

    Returns:
        The lag then [s] and the power of what is left, each (n,).
    """
    for _ in range(_TWIST_ROUNDS):
        data.set_twist(twist)
        fitted = estimate.fit(data.blocks(lag), data.prior)
        theta = data.prior.mean + data.prior.std * fitted.physical
        n, end = data.robot.n, len(theta) - data.lags
        compliance = theta[end - n : end]
        lag = np.broadcast_to(theta[end:], n).copy()
        larger = np.maximum(compliance, twist.compliance)  # 0 of a joint without a gear, or of a stiff one
        change = np.abs(compliance - twist.compliance) / np.maximum(larger, np.finfo(float).tiny)
        twist = _twist_of(data, fitted, lag, twist.side, compliance)
        if change.max() < _TWIST_SETTLED:
            break
    data.set_twist(twist)
    return lag, _power(estimate.fit(data.blocks(lag), data.prior, physical=False))


def _choose_frictions(data: _Data, lag: Array) -> None:
    """Give joints the frictions that explain more of what is left."""
    fitted = estimate.fit(data.blocks(lag), data.prior)
    theta, left = data.prior.mean + data.prior.std * fitted.physical, _power(fitted)
    data.heavy = with_parameters(data.robot, theta[: len(COLUMNS) * data.robot.n])
    seen = _shares(fitted.residuals, data.torques(lag)) > _SEEN
    for name in FRICTIONS:
        data.frictions[name] = np.ones(data.robot.n, dtype=bool)
        less = _power(estimate.fit(data.blocks(lag), data.prior, physical=False))
        data.frictions[name] = (less < (1.0 - _WORTH) * left) & seen
        if not data.frictions[name].any():
            del data.frictions[name]
        else:
            left = _power(estimate.fit(data.blocks(lag), data.prior, physical=False))


def _choose_couplings(data: _Data, lag: Array) -> None:
    """Find motors that turn with the joint before theirs as well, the one that explains most first."""
    fitted = estimate.fit(data.blocks(lag), data.prior, physical=False)
    left, seen = _power(fitted), _shares(fitted.residuals, data.torques(lag)) > _SEEN
    known = list(data.coupled)
    tried: dict[tuple[int, int, float], Array] = {}
    for i in range(data.robot.n - 1):
        for sign in (1.0, -1.0) if seen[i : i + 2].any() else ():
            data.coupled = [*known, (i, i + 1, sign)]
            less = _power(estimate.fit(data.blocks(lag), data.prior, physical=False))
            tried[i, i + 1, sign] = (less / left)[i : i + 2]
    best = min(tried, key=lambda each: float(tried[each].min()), default=None)
    data.coupled = known
    if best is not None and tried[best].min() < 1.0 - _COUPLED:
        data.coupled = [*known, best]


def _with_lags(data: _Data, lag: Array) -> tuple[Fit, Prior]:
    """Return the fit with one lag, or with one for each joint where the data ask for it."""
    common = estimate.fit(data.blocks(lag), data.prior, physical=False)
    if data.robot.n > 1:
        data.lags = data.robot.n
        own = _settle(data, lag)
        each = estimate.fit(data.blocks(own), data.prior, physical=False)
        if np.mean(np.log(_power(each) / _power(common))) < np.log(1.0 - _WORTH):
            return estimate.fit(data.blocks(own), data.prior), data.prior
        data.lags = 1
    return estimate.fit(data.blocks(lag), data.prior), data.prior


def _power(fitted: Fit) -> Array:
    """Return the residual's power of each joint, (n,)."""
    return np.asarray(np.nansum([np.nansum(r**2, axis=0) for r in fitted.residuals], axis=0) + 1e-300)


def _shares(residuals: Sequence[Array], torques: Sequence[Array]) -> Array:
    """Return residual over torque of each joint, root mean squares, (n,); NaN of one that stood still."""
    left = np.concatenate(list(residuals))
    torque = np.where(np.isfinite(left), np.concatenate(list(torques)), np.nan)
    power_left, power = np.nansum(left**2, axis=0), np.nansum(torque**2, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(power_left / np.where(power > 0.0, power, np.nan)))


def _period(grid: Grid) -> float | None:
    """Return the time after which a motion repeats [s]; None for none."""
    thin = max(1, round(_PERIOD_STEP / grid.dt))
    step = thin * grid.dt
    second = round(1.0 / step)
    q = grid.q[::thin][second : -second or None]  # without its ends, where it begins and ends at rest
    amplitude = np.sqrt(2.0) * q.std(axis=0).max() if len(q) else 0.0
    for shift in range(max(1, round(_SHORTEST_PERIOD / step)), len(q) // 2 + second):
        if shift >= len(q) - 1:
            return None
        apart = np.sqrt(((q[shift:] - q[:-shift]) ** 2).mean(axis=0).max())
        if apart < _SAME * amplitude:
            near = range(shift, min(shift + max(1, second), len(q) - 1))
            squares = [float(((q[each:] - q[:-each]) ** 2).mean()) for each in near]
            return float(near[int(np.argmin(squares))] * step)
    return None


def _load(fitted: Fit, prior: Prior, element: Any, frame: str) -> Load:
    """Return the load of a fit, which is what comes last, in the frame that carries it."""
    own = slice(len(prior.mean) - len(BODY), None)
    value = prior.std[own] * fitted.physical[own]
    covariance = fitted.covariance[own, own] * np.outer(prior.std[own], prior.std[own])
    mass, lever = float(value[0]), value[1:4] / value[0]
    slope = np.hstack([-lever[:, None], np.eye(3)]) / mass  # of the lever by mass and first moments
    rotation = np.asarray(element.placement.rotation)
    spread = rotation.T @ slope @ covariance[:4, :4] @ slope.T @ rotation
    local = element.placement.actInv(pin.Inertia.FromDynamicParameters(value))
    return Load(
        mass,
        float(np.sqrt(covariance[0, 0])),
        np.array(local.lever),
        np.sqrt(np.diag(spread)),
        np.array(local.inertia),
        frame,
    )
