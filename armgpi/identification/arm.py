"""Identify: from logs of positions and torques to the arm that made them, with intervals."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from armgpi.base.arrays import Array, PerJointInput, check_choice, check_type, frozen, quantity
from armgpi.base.hints import with_keyword_hints
from armgpi.base.renamed import warn_renamed
from armgpi.errors import ParameterError
from armgpi.identification import estimate
from armgpi.identification.check import (
    ANOTHER_ROBOT,
    LIGHT,
    carrying_joint,
    check_bodies,
    check_fit,
    check_friction,
    check_robot,
    check_rotors,
    refuse,
)
from armgpi.identification.chirp import Side, find_side
from armgpi.identification.estimate import HALF_95, Fit, Prior
from armgpi.identification.logs import TORQUES, Log
from armgpi.identification.moments import CONFIGURATIONS, MOTOR, Moments
from armgpi.identification.posterior import Posterior, with_parameters
from armgpi.identification.resonance import Gears, find_gears
from armgpi.identification.samples import Finding
from armgpi.identification.simulated import simulate_experiment
from armgpi.identification.terms import fit_with_terms, shares
from armgpi.identification.weak_form import BODY, COLUMNS, COULOMB, OFFSET, ROTOR, VISCOUS, WeakForm
from armgpi.plants.reality import scales
from armgpi.robot.batch import RobotBatch
from armgpi.robot.drives import Drives
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import SCATTER, assume_gears, with_published

#: Lower and upper end of the interval of a stiffness from slow motions, over it.
_STIFFNESS_WITHIN = (0.5, 2.0)
#: What is estimated of drives -> its name there.
_DRIVES = {"rotor": "rotor_inertia", "coulomb": "coulomb", "viscous": "viscous", "offset": "offset"}
#: Share of the data in an estimate from which it is identified.
_DECIDED = 0.5
#: Share of the rotors that the log decided, too light, from which sensors behind the gears hide them.
_MOST_LIGHT = 0.5
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
_LOAD = 0.2
_LOAD_RADIUS = 0.15


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

    def __init__(self, data: Moments, fitted: Fit, prior: Prior, findings: Sequence[Finding]) -> None:
        """Take over a regression; users call :func:`identify`."""
        self.gears: Gears | None = None
        self.simulated: Array | None = None
        self.side: Side | None = None
        self._shaken: Log | None = None  # the log that the gears are of
        self._data, self._fit, self._prior = data, fitted, prior
        self.file, self.findings = data.robot, tuple(findings)
        hidden_rotors = np.flatnonzero(data.hidden) * len(COLUMNS) + ROTOR
        fitted.physical[hidden_rotors] = 0.0  # no column has them, and a solver may leave them anywhere
        self.theta = prior.mean + prior.std * fitted.physical
        self._std = prior.std * np.sqrt(np.diag(fitted.covariance))
        n = data.robot.n
        self.lag = frozen(np.broadcast_to(self.theta[-data.lags :], n))
        self.lag_std = frozen(np.broadcast_to(self._std[-data.lags :], n))
        self.width = frozen(data.width)
        self.sources = tuple(log.source for log in data.logs)
        self.dt = data.grids[0].dt
        self.torque, self.hidden = data.torque, data.hidden.copy()
        self.twist = data.twist
        self.robot = with_parameters(data.robot, self.theta[: len(COLUMNS) * n])
        self.robot = self.robot.with_drives(self.drives)
        self.residuals = frozen(shares(fitted.residuals, data.torques(self.lag)))

    @property
    def light(self) -> npt.NDArray[np.bool_]:
        """Which rotors that the log decided came out far too light for a motor behind a gear, (n,)."""
        light = [row.data_share > _DECIDED and row.upper < LIGHT * row.expected for row in self._rotors]
        return np.array(light) & ~_without_rotors(self.file)

    @property
    def _rotors(self) -> list[Estimate]:
        """The estimates of the rotors, joint by joint."""
        return [row for row in self.table() if row.quantity == "rotor"]

    @property
    def posterior(self) -> Posterior:
        """What the logs leave open, as a normal distribution of the unknowns of the joints within bounds.

        Rotors are bounded by what is known of them beside the logs. Friction of motors that are not in the
        torques comes on top of what was found, within what :attr:`drives` says.
        """
        n, count = self.file.n, len(COLUMNS) * self.file.n
        mean, std = self.theta[:count].copy(), self._prior.std[:count]
        covariance = self._fit.covariance[:count, :count].copy()
        lower = np.full((n, len(COLUMNS)), -np.inf)
        upper = np.full((n, len(COLUMNS)), np.inf)
        lower[:, ROTOR], upper[:, ROTOR] = self._rotor_bounds()
        for column in (VISCOUS, COULOMB):
            places = np.flatnonzero(self.hidden) * len(COLUMNS) + column
            covariance[places, places] += 1.0
            lower[self.hidden, column], upper[self.hidden, column] = self._hidden_friction(column)
        rotors = self._exact_rotors
        is_exact = np.isfinite(rotors)
        places = np.flatnonzero(is_exact) * len(COLUMNS) + ROTOR
        mean[places] = rotors[is_exact]
        covariance[places, :] = 0.0
        covariance[:, places] = 0.0
        lower[is_exact, ROTOR], upper[is_exact, ROTOR] = -np.inf, np.inf
        return Posterior.of(mean, std, covariance, (lower.ravel(), upper.ravel()))

    @property
    def _exact_rotors(self) -> Array:
        """Return rotors that torques do not show and that were specified exactly, (n,); NaN for others."""
        rotors = self.file.drives.data.get("rotor_inertia", {})
        exact = np.full(self.file.n, np.nan)
        for joint, name in enumerate(self.file.joint_names):
            datum = rotors.get(name)
            if self.hidden[joint] and datum is not None and not datum.low < datum.high:
                exact[joint] = datum.value
        return exact

    def _rotor_bounds(self) -> tuple[Array, Array]:
        """Return what is known of the rotors beside the logs [kg m^2 or kg], (n,) each; else infinite."""
        lower, upper = np.empty(self.file.n), np.empty(self.file.n)
        for joint, name in enumerate(self.file.joint_names):
            place = joint * len(COLUMNS) + ROTOR
            value, expected = float(self.theta[place]), float(self._prior.mean[place])
            lower[joint], upper[joint] = self._known_rotor(name, value, expected)
        if self.side is not None:
            chirped = self._chirped
            lower[chirped] = self.side.low[chirped]
            upper[chirped] = self.side.high[chirped]
        return lower, upper

    def _hidden_friction(self, column: int) -> tuple[Array, Array]:
        """Return the ends of the friction where motors are not in the torques, (hidden,) each."""
        rows = [row for row in self.table() if row.quantity == COLUMNS[column]]
        hidden = [rows[joint] for joint in np.flatnonzero(self.hidden)]
        lower = np.array([row.lower for row in hidden])
        return lower, np.array([self._with_motor(row) for row in hidden])

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
        implausible = {finding.joint for finding in self._rotor_findings()}
        hidden = set(np.array(self.file.joint_names)[self.hidden])
        for row in self.table():
            if row.quantity not in _DRIVES:
                continue
            name = _DRIVES[row.quantity]
            is_rotor, is_hidden = row.quantity == "rotor", row.joint in hidden
            is_known = row.joint in drives.data.get(name, {})
            if is_hidden and is_rotor and is_known:
                continue
            is_decided = row.data_share > _DECIDED and not is_hidden
            if is_rotor and row.joint in implausible:
                is_decided = False
            upper = self._with_motor(row) if is_hidden and not is_rotor else row.upper
            source = "identified" if is_decided else "assumed"
            value, low, high = ({row.joint: x} for x in (row.value, row.lower, upper))
            drives = drives.with_value(name, value, low, high, source)
        return drives

    def _with_motor(self, row: Estimate) -> float:
        """Return the upper end of friction behind a sensor, when the motor's comes on top."""
        joint = self.file.joint_names.index(row.joint)
        place = joint * len(COLUMNS) + COLUMNS.index(row.quantity)
        std = float(self._prior.std[place])
        return max(row.upper, row.value + std)

    @property
    def _chirped(self) -> npt.NDArray[np.bool_]:
        """Which rotors are those of a log of chirps, as the other logs did not decide them, (n,)."""
        if self.side is None:
            return np.zeros(self.file.n, dtype=bool)
        sources = np.array(self._fitted_drives.sources("rotor_inertia"))
        return np.asarray(self.side.identified & (sources != "identified"), dtype=np.bool_)

    def _add_stiffness(self, drives: Drives) -> Drives:
        """Return drives with the stiffness that the logs show, and the side that it was found for.

        That of slow motions is no more than a better assumption: it counts as assumed. That of a multisine
        comes before it. Chirps, which are added later, overrule the side: they alone are made to tell it.
        """
        if self.twist is not None:
            value = self._slow_stiffness()
            if value:
                low, high = ({joint: f * x for joint, x in value.items()} for f in _STIFFNESS_WITHIN)
                drives = drives.with_value("stiffness", value, low, high, "assumed")
        if self.gears is not None:
            drives = self.gears.add_to(drives)
            if self.gears.measured.any():
                drives = drives.with_value("encoder_side", self.gears.side, source="identified")
        return drives

    def _slow_stiffness(self) -> dict[str, float]:
        """Return joint -> stiffness that slow motions show where it is assumed, else the assumed one."""
        stiffness = {}
        for joint, datum in assume_gears(self.file).drives.data.get("stiffness", {}).items():
            if datum.source == "assumed":
                stiffness[joint] = datum.value
        for row in self.table():
            is_shown = row.quantity == "stiffness" and math.isfinite(row.upper)
            if is_shown and row.joint in stiffness:
                stiffness[row.joint] = row.value
        return stiffness

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
        chirps = self._data.with_rotors(self._data.read(log))
        other.side = find_side(self.robot, chirps)
        shaken, side = self._shaken, other.side.side
        if shaken is not None and self.gears is not None and side not in ("", self.gears.side):
            # The stiffness was found for the other side.
            drives = self.robot.drives.with_value("encoder_side", side)
            robot = self.robot.with_drives(drives)
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
        data, other = self._data, copy.copy(self)
        no_lag = np.zeros(self.file.n)
        tau = simulate_experiment(path, self.robot, self.late, data.grids[0])
        twin = WeakForm(data.model, data.grids[0]._replace(tau=tau))
        measured, _ = data.forms[0].torque(no_lag)
        simulated, _ = twin.torque(no_lag)
        measured = np.where(data.blocks(self.lag)[0].valid, measured, np.nan)
        residuals = shares([measured - simulated], [measured])
        if np.isinf(tau).any():
            residuals = np.full(self.file.n, np.inf)
        other.simulated = frozen(residuals)
        return other

    def table(self, bodies: bool = False) -> list[Estimate]:
        """Return the estimates of every joint: drives, offset and lag, and those of its body if asked for.

        Where the data ask for it there are friction that grows with the load ("load", a share of the gravity
        torque) or towards rest ("stribeck"), and what a motor has that turns with another joint as well
        ("rotor with wrist_1", ...).
        """
        rows: list[Estimate] = []
        for number, joint in enumerate(self.robot.joint_names):
            for column, name in enumerate(COLUMNS):
                if bodies or column >= len(BODY):
                    rows.append(self._estimate(joint, name, number * len(COLUMNS) + column))
            rows += self._further_rows(number, joint)
        return rows

    def _further_rows(self, number: int, joint: str) -> Iterator[Estimate]:
        """Give the estimates of a joint that come after those of all joints: friction, motors, gears, lag."""
        names, data = self.robot.joint_names, self._data
        place = len(COLUMNS) * len(names)
        for kind, asks in data.frictions.items():
            if asks[number]:
                yield self._estimate(joint, kind, place + number)
            place += len(names)
        for coupled in data.coupled:
            if coupled.motor == number:
                for offset, kind in enumerate(MOTOR):
                    yield self._estimate(joint, f"{kind} with {names[coupled.joint]}", place + offset)
            place += len(MOTOR)
        end = len(self.theta) - data.lags
        if self.twist is not None:
            yield self._stiffness(joint, end - len(names) + number)
        yield self._estimate(joint, "lag", end + min(number, data.lags - 1))

    def sums(self) -> list[Estimate]:
        """Return, joint by joint, the mean of its diagonal of D(q), rotor included.

        A rotor near the base cannot be told from the links, and this sum can.
        """
        rows = []
        for joint, of_joints in zip(self.robot.joint_names, self._data.inertias(), strict=True):
            combination = np.zeros(len(self.theta))
            combination[: len(of_joints)] = of_joints
            value = float(combination @ self.theta)
            expected = float(combination @ self._prior.mean)
            scaled = combination * self._prior.std
            std = float(np.sqrt(scaled @ self._fit.covariance @ scaled))
            inverse = np.linalg.solve(self._fit.information, scaled)
            prior_share = float(scaled @ inverse) / float(scaled @ scaled)
            lower, upper = max(value - HALF_95 * std, 0.0), value + HALF_95 * std
            rows.append(Estimate(joint, "inertia", value, lower, upper, 1.0 - prior_share, expected))
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
        of_joints = free[: len(COLUMNS) * n].reshape(n, -1)
        bodies = of_joints[:, : len(BODY)]
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
        no_rotors = np.zeros(self.file.n)
        identified = mean_inertia(self.robot.with_armature(no_rotors))
        file = mean_inertia(self.file.with_armature(no_rotors))
        ratios = identified / np.maximum(file, np.finfo(float).tiny)
        return np.where(file > _INERT * file.max(), ratios, np.nan)

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
        q = random_configurations(self.robot, CONFIGURATIONS, seed=0)
        if box is not None:
            lower, upper = (np.asarray(end, dtype=float) for end in box)
            rng = np.random.default_rng(0)
            q = rng.uniform(lower, upper, (CONFIGURATIONS, self.robot.n))
        inertia = self.robot.mass_matrix(q)
        eigenvalues = []
        for arm in self.sample(count).robots:
            ratio = np.linalg.solve(arm.mass_matrix(q), inertia)
            eigenvalues.append(np.linalg.eigvals(ratio).real)
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
        message = (
            f"{lags}; friction with memory (presliding), or clocks that differ, look like that. The "
            f"controller is made for {1e3 * self.late:.2g} ms"
        )
        return [Finding("warning", "", message)]

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
        place = carrying_joint(self.file) * len(COLUMNS)
        prior = estimate.extend(data.prior, self._expected_load(), body=True)
        blocks = data.blocks(self.lag)
        last = len(blocks) - 1
        for index, block in enumerate(blocks):
            is_carried = float(index == last)
            carried = is_carried * block.rows[..., place : place + len(BODY)]
            blocks[index] = block._replace(rows=np.concatenate([block.rows, carried], axis=-1))
        fitted = estimate.fit(blocks, prior)
        load = _load(fitted, prior, self._tip, self.file.tip)
        constants = self._data.current
        if scale_known or constants is None or np.all(constants == 1.0):
            return load
        mass_std = float(np.hypot(load.mass_std, _CONSTANTS / HALF_95 * load.mass))
        return load._replace(mass_std=mass_std, scale=_CONSTANTS)

    def _expected_load(self) -> Array:
        """Return the standard deviations of the ten parameters of a load, about the joint that carries it."""
        mass = _LOAD * scales(self.file).mass
        reach = float(np.linalg.norm(self._tip.placement.translation))
        farther = 1.0 + reach / _LOAD_RADIUS
        first = mass * _LOAD_RADIUS * farther
        second = mass * _LOAD_RADIUS**2 * farther**2
        return np.repeat([mass, first, second], [1, 3, 6])

    def validate(self, log: Any) -> Validation:
        """Return how well the arm predicts the torques of a log that it has not seen."""
        return self._judge(self._data.with_logs([log]))

    @property
    def replayed(self) -> Validation:
        """How well it predicts the torques of the first log that it was fitted to."""
        return self._judge(self._data)

    def _judge(self, data: Moments) -> Validation:
        """Return how well the arm predicts the torques of the first of some logs."""
        block, form = data.blocks(self.lag, linear=False)[0], data.forms[0]
        weight = block.rows[0, 0, OFFSET]
        without_lags = block.rows[..., : -data.lags]
        of_lags = block.rows[..., -data.lags :] @ self.theta[-data.lags :]
        torque = np.where(block.valid, block.torque - of_lags, np.nan)
        predicted = without_lags @ self.theta[: -data.lags]
        expected = without_lags @ self._prior.mean[: -data.lags]
        middle = np.rint(form.times / data.grids[0].dt).astype(np.intp)
        return Validation(
            source=data.logs[0].source,
            identified=shares([torque - predicted], [torque]),
            file=shares([torque - expected], [torque]),
            times=form.times,
            position=form.position[middle],
            velocity=form.velocity[middle],
            torque=torque / weight,
            predicted=predicted / weight,
        )

    def _estimate(self, joint: str, quantity: str, place: int) -> Estimate:
        """Return one unknown; what cannot be negative has an interval that is not."""
        value, std = float(self.theta[place]), float(self._std[place])
        least = 0.0 if place in self._prior.positive else -np.inf
        ends = (max(value - HALF_95 * std, least), value + HALF_95 * std)
        data_share = float(self._fit.learned[place])
        expected = 0.0 if quantity == "lag" else float(self._prior.mean[place])
        if quantity == "rotor":
            ends = self._rotor_ends(joint, value, expected, ends)
        return Estimate(joint, quantity, value, *ends, data_share, expected)

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
        datum = self.file.drives.data.get("rotor_inertia", {}).get(joint)
        least, most = expected / SCATTER, expected * SCATTER
        if datum is not None and datum.low < datum.high:
            least, most = datum.low, datum.high
        if self.hidden[self.file.joint_names.index(joint)]:
            return least, most
        lower = least if value > least else -math.inf
        return lower, most if value < most else math.inf

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
        mode = self.twist.mode(self.file.middle())
        explained = self._data.explained
        message = (
            f"the joints are elastic: the logs were fitted with their stiffness, encoders at the "
            f"{self.twist.side}s, and a first mode of {mode:.2g} Hz in the middle, which explains "
            f"{100.0 * explained:.2g} % of what stiff joints leave of the torques; armgpi excite --resonance "
            "measures it"
        )
        return [Finding("warning", "", message)]

    def _rotor_findings(self) -> list[Finding]:
        """Return which rotors that the log decided are not plausible for a motor."""
        decided = []
        for row, is_direct in zip(self._rotors, _without_rotors(self.file), strict=True):
            if row.data_share > _DECIDED and not is_direct:
                decided.append(row)
        value = np.array([row.value for row in decided])
        low = np.array([row.lower for row in decided])
        high = np.array([row.upper for row in decided])
        expected = np.array([row.expected for row in decided])
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
    data = Moments(robot, gravity, constants, columns).with_logs(list(logs) if several else [logs])
    if not data.forms:
        raise ParameterError("logs", logs, "at least one log")
    findings = data.findings(len(data.grids))
    if check_first:
        refuse(findings)
    if torque is not None:
        data.torque = torque
    if data.torque == "joint":
        data.hide(np.ones(robot.n, dtype=bool))
    found = Identified(data, *fit_with_terms(data), findings)
    light = found.light
    if light.any():
        findings = [*findings, *_hide_rotors(data, light, found)]
        found = Identified(data, *fit_with_terms(data), findings)
    if found.link_distance > ANOTHER_ROBOT or found._lags_differ:
        swapped = [finding for finding in data.position_findings() if finding not in found.findings]
        found.findings += tuple(swapped)
        if check_first:
            refuse(swapped)
    if check_first:
        least = np.array([row.lower / row.expected for row in found._rotors])
        refuse(check_fit(found.robot.joint_names, found.lag, found.residuals, least))
    found.findings += tuple(_findings_of_fit(found))
    return found


def _findings_of_fit(found: Identified) -> Iterator[Finding]:
    """Give what is remarkable of a fit: elastic joints, lags, rotors, friction, and bodies."""
    robot, names = found.file, found.file.joint_names
    unknowns = found._fit.physical[: len(COLUMNS) * robot.n].reshape(robot.n, -1)
    squares = unknowns[:, : len(BODY)] ** 2
    body_distances = np.sqrt(squares.mean(axis=1))
    coulomb = np.array([row.lower for row in found.table() if row.quantity == "coulomb"])
    yield from found._twist_findings()
    yield from found._lag_findings()
    yield from found._rotor_findings()
    yield from check_friction(names, found._data.expected, coulomb)
    yield from check_bodies(names, body_distances, carrying_joint(robot))
    yield from check_robot(names, found.link_distance, found.inertia_ratios)


def _hide_rotors(data: Moments, light: npt.NDArray[np.bool_], found: Identified) -> list[Finding]:
    """Leave rotors out of a fit that came out too light for motors; return what is to be said of it."""
    names = data.robot.joint_names
    decided = sum(row.data_share > _DECIDED for row in found._rotors)
    if data.torque != "motor" and light.sum() > _MOST_LIGHT * decided:
        data.torque = "joint"
        data.hide(np.ones(data.robot.n, dtype=bool))
        message = (
            f"the rotors of {int(light.sum())} of {decided} joints came out far too light for motors, so the "
            "torques were taken as those of sensors behind the gears: rotor inertia and motor friction are "
            "not in them and stay assumed (--torque joint says so, --torque motor denies it)"
        )
        return [Finding("warning", "", message)]
    data.hide(light | data.hidden)
    return [finding for finding in found._rotor_findings() if light[names.index(finding.joint)]]


def _without_rotors(robot: Robot) -> npt.NDArray[np.bool_]:
    """Return of which joints somebody specified that they have no rotor, as those of direct drives, (n,)."""
    is_specified = np.array(robot.drives.sources("rotor_inertia")) != ""
    is_zero = robot.drives.value("rotor_inertia") == 0.0
    return np.asarray(is_zero & is_specified, dtype=np.bool_)


def mean_inertia(robot: Robot) -> Array:
    """Return a robot's mean diagonal of D(q), (n,), over the configurations of :meth:`Identified.sums`."""
    q = random_configurations(robot, CONFIGURATIONS, seed=0)
    diagonals = np.diagonal(robot.mass_matrix(q), axis1=1, axis2=2)
    return np.asarray(diagonals.mean(axis=0))


def _load(fitted: Fit, prior: Prior, element: Any, frame: str) -> Load:
    """Return the load of a fit, which is what comes last, in the frame that carries it."""
    std = prior.std[-len(BODY) :]
    value = std * fitted.physical[-len(BODY) :]
    covariance = fitted.covariance[-len(BODY) :, -len(BODY) :] * np.outer(std, std)
    mass, lever = float(value[0]), value[1:4] / value[0]
    slope = np.hstack([-lever[:, None], np.eye(3)]) / mass  # of the lever by mass and first moments
    rotation = np.asarray(element.placement.rotation)
    spread = rotation.T @ slope @ covariance[:4, :4] @ slope.T @ rotation
    body = element.placement.actInv(pin.Inertia.FromDynamicParameters(value))
    return Load(
        mass=mass,
        mass_std=float(np.sqrt(covariance[0, 0])),
        com=np.array(body.lever),
        com_std=np.sqrt(np.diag(spread)),
        inertia=np.array(body.inertia),
        frame=frame,
    )
