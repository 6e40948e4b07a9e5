"""What an impedance controller may be asked for, in closed form, before it runs.

Of a mode with unit inertia the controller is C(s) = w^2 + (alpha + beta w^2) s / (1 + s / d), late by a
delay T. It damps a motion of the frequency omega where the imaginary part of C(j omega) exp(-j omega T) is
positive, which is so up to one frequency: there the lag of the filter and the delay have used up the lead of
the damper. A mode whose frequency is beyond it is driven, not damped. So the stiffness, with a wall beside
it, must not bring the mode there. Elastic joints take less; see ``armgpi.control.elastic_limits``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.control.elastic_limits import (
    GEAR_DAMPING,
    LEAST_LINK,
    Damping,
    ElasticLoop,
    Springs,
    elastic_joints,
)

#: Smallest eigenvalue of an inertia beside the largest that a mode is taken of.
_LEAST = 1e-9
#: Stiffness factors between which the largest one is looked for.
_FACTORS = (1e-3, 1e5)
#: So many of them are looked at at once, then as many between the two where it ends, so many times: the last
#: ones differ by a part of 2e-6.
_LOOKS = 60
_LEVELS = 4
#: Halvings of the range of frequencies, to a part of 1e-9.
_HALVINGS = 30


class Mode(NamedTuple):
    """The springs in one configuration.

    Attributes:
        square: squares of the natural frequencies [1/s^2], (k,).
        masses: what the tool weighs in its principal directions [kg], (3,); empty without a tool.
        springs: the same as matrices of all joints.
    """

    square: Array
    masses: Array
    springs: Springs

    @classmethod
    def of(
        cls,
        inertia: Array,
        stiffness: Array,
        count: int,
        jacobian: Array | None = None,
        posture: Array | None = None,
    ) -> Mode:
        """Return the modes of an inertia and a stiffness matrix, each (n, n).

        Args:
            inertia: D.
            stiffness: K.
            count: how many modes the springs have; the others are free.
            jacobian: of the tool's position, (3, n).
            posture: stiffness beside that of the springs, which counts on elastic joints alone, (n, n).
        """
        nothing = np.zeros_like(stiffness)
        springs = Springs(inertia, stiffness, nothing if posture is None else posture)
        factor = np.linalg.inv(np.linalg.cholesky(inertia))
        square = np.linalg.eigvalsh(factor @ stiffness @ factor.T)
        masses = np.empty(0)
        if jacobian is not None:
            accelerations = np.linalg.solve(inertia, jacobian.T)
            mobility = np.linalg.eigvalsh(jacobian @ accelerations)
            with np.errstate(divide="ignore"):  # a tool on the axis of the only joint does not yield
                masses = 1.0 / np.maximum(mobility, _LEAST * mobility.max())
        positive = np.maximum(square[-count:], 0.0)
        return cls(positive, masses, springs)


class ImpedanceLimits(NamedTuple):
    """What may be asked for.

    Attributes:
        factor: the largest stiffness over that which was asked for [-].
        reason: what limits it.
        link_factor: the same if encoders sat at the links, where joints are elastic and the drives do not
            tell the side; else `factor`.
        wall: the stiffest wall without damping at the tool [N/m], in the configuration and direction where
            it is softest; NaN without a tool.
        usual_wall: the same, median over configurations and directions.
    """

    factor: float
    reason: str
    link_factor: float
    wall: float
    usual_wall: float


class _Loop(NamedTuple):
    """The controller of one mode, per unit of inertia: alpha [1/s], beta [s], filter [1/s], delay [s]."""

    alpha: Any
    beta: Any
    bandwidth: float
    delay: float

    def scaled(self, factor: Array) -> _Loop:
        """Return the damping that belongs to other stiffnesses."""
        root = np.sqrt(factor)
        return self._replace(alpha=self.alpha * root, beta=self.beta / root)

    def response(self, square: Any, frequency: Any) -> Any:
        """Return C(j omega) exp(-j omega T) [1/s^2]."""
        s = 1j * np.asarray(frequency)
        rate = s / (1.0 + s / self.bandwidth)
        return (square + (self.alpha + self.beta * square) * rate) * np.exp(-s * self.delay)

    def phase_limit(self, square: Array) -> Array:
        """Return up to which frequency [rad/s] the controller damps; 0 where it damps nothing."""
        low = np.full(np.shape(square), 1e-3)
        high = np.full(np.shape(square), math.pi / self.delay)
        damps_at_all = self.response(square, low).imag > 0.0
        low = np.where(damps_at_all, low, 0.0)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            damps = (self.response(square, middle).imag > 0.0) & damps_at_all
            low = np.where(damps, middle, low)
            high = np.where(damps, high, middle)
        return low

    def spare(self, square: Array) -> Array:
        """Return the stiffness over inertia [1/s^2] that may be added to a mode before it is driven."""
        frequency = self.phase_limit(square)
        return np.asarray(frequency**2 - self.response(square, frequency).real)


class _Worth(NamedTuple):
    """By what filters are compared: whether what was asked for is allowed, then how much of it.

    Attributes:
        enough: whether the specified stiffness is allowed.
        least: the largest factor, wherever encoders sit [-].
    """

    enough: bool
    least: float


class LimitSearch:
    """What may be asked for, with one filter after another.

    Attributes:
        sides: which encoders sit at links, (n,) each: as it is enforced, and as it would be with those at
            the links of which nothing tells the side; one array where all sides are known.
    """

    def __init__(
        self,
        modes: Sequence[Mode],
        alpha: float,
        beta: float,
        dt: float,
        delay: float,
        elastic: ElasticLoop | None = None,
    ) -> None:
        """Keep what all filters share.

        Args:
            modes: of some configurations.
            alpha: damping over inertia [1/s].
            beta: damping over stiffness [s].
            dt: sample time [s].
            delay: transport delay besides the sample and hold [s].
            elastic: of the arm, where joints are elastic.
        """
        self._modes, self._alpha, self._beta = modes, alpha, beta
        self._dt, self._delay, self._elastic = dt, delay, elastic
        self._fastest = max(float(mode.square.max()) for mode in modes)
        self._stiff = cache(self._stiff_factor)  # a filter is looked at several times
        self.sides: list[Any] = []
        if elastic is not None:
            self.sides.append(elastic.at_link)
            if elastic.unsure.any():
                self.sides.append(elastic.at_link | elastic.unsure)

    def _loop(self, bandwidth: float) -> _Loop:
        """Return the controller of a mode with a filter [rad/s]."""
        return _Loop(self._alpha, self._beta, bandwidth, self._delay + 0.5 * self._dt)

    def _stiff_factor(self, bandwidth: float) -> float:
        """Return the largest factor on stiff joints with a filter [rad/s]."""
        loop = self._loop(bandwidth)
        return _largest(lambda factors: loop.scaled(factors).spare(factors * self._fastest) > 0.0)

    def _allowed(self, bandwidth: float, side: Any, stiff: float, beyond: float = 0.0) -> float:
        """Return the largest factor with encoders on one side; 0 where none beyond `beyond` is."""
        assert self._elastic is not None
        damping = Damping(self._alpha, self._beta, bandwidth)
        found = self._elastic.factor(min(stiff, _FACTORS[1]), damping, side, beyond)
        return found if found < _FACTORS[1] else stiff  # no bound was found up to there

    def at(self, bandwidth: float) -> ImpedanceLimits:
        """Return what may be asked for with a filter [rad/s]."""
        stiff = self._stiff(bandwidth)
        factors = [self._allowed(bandwidth, side, stiff) for side in self.sides] or [stiff]
        reason = f"beyond, the sample time of {self._dt:g} s, the delay and the filter leave no damping"
        if factors[0] < stiff:
            reason = "beyond, a resonance of the elastic joints may not be damped"
        lowest, usual = self._walls(bandwidth)
        return ImpedanceLimits(factors[0], reason, factors[-1], lowest, usual)

    def _walls(self, bandwidth: float) -> tuple[float, float]:
        """Return the lowest and the median stiffest wall without damping [N/m]; NaN without a tool."""
        with_tool = [mode for mode in self._modes if mode.masses.size]
        if not with_tool:
            return math.nan, math.nan
        masses = np.array([mode.masses for mode in with_tool])
        usual = np.array([np.median(mode.square) for mode in with_tool])
        spare = self._loop(bandwidth).spare(usual)
        walls = masses * spare[:, None]
        return float(walls.min()), float(np.median(walls))

    def allows(self, bandwidth: float, factor: float) -> bool:
        """Tell whether a filter [rad/s] allows a factor, wherever encoders sit."""
        if not self._stiff(bandwidth) >= factor:
            return False
        return all(self._holds(bandwidth, side, factor) for side in self.sides)

    def allows_specified(self, bandwidth: float) -> bool:
        """Tell whether a filter [rad/s] allows the specified stiffness as it is enforced."""
        if not self._stiff(bandwidth) >= 1.0:
            return False
        return not self.sides or self._holds(bandwidth, self.sides[0], 1.0)

    def _holds(self, bandwidth: float, side: Any, factor: float) -> bool:
        """Tell whether elastic joints allow a factor with encoders on one side."""
        assert self._elastic is not None
        return self._elastic.stable(factor, Damping(self._alpha, self._beta, bandwidth), side)

    def best(self, bandwidths: Sequence[float]) -> tuple[float, ImpedanceLimits]:
        """Return the filter that allows most: first what was asked for, then most wherever encoders sit.

        Args:
            bandwidths: filters to choose from [rad/s]; of equal ones the first.
        """
        chosen, worth = bandwidths[0], _Worth(False, 0.0)
        for bandwidth in bandwidths:
            other = self._worth(bandwidth, worth)
            if other > worth:
                chosen, worth = bandwidth, other
        return chosen, self.at(chosen)

    def _worth(self, bandwidth: float, before: _Worth) -> _Worth:
        """Return what a filter [rad/s] is worth; no factor where it is not worth more than another one."""
        least, enough = self._stiff(bandwidth), self.allows_specified(bandwidth)
        if enough < before.enough:
            return _Worth(enough, 0.0)
        beyond = before.least if enough == before.enough else 0.0
        for side in self.sides:
            least = self._allowed(bandwidth, side, least, beyond)
            if least == 0.0:
                break
        return _Worth(enough, least)

    def largest(self, bandwidths: Sequence[float]) -> tuple[float, float]:
        """Return the largest factors that any filter allows: as it is enforced, and for encoders at links."""
        if not self.sides:
            stiff = max(map(self._stiff, bandwidths))
            return stiff, stiff
        largest = []
        for side in self.sides:
            most = 0.0
            for bandwidth in bandwidths:
                most = max(most, self._allowed(bandwidth, side, self._stiff(bandwidth), most))
            largest.append(most)
        return largest[0], largest[-1]


def largest_damping(inertias: Array, bandwidth: float, delay: float, drives: Any) -> Array:
    """Return the largest damping over inertia of each joint [1/s] that drives no resonance of it, (n,).

    It is infinite for a joint whose elasticity is not known, or whose resonance it damps.

    Args:
        inertias: own inertias of the joints [kg m^2 or kg], (configurations, n).
        bandwidth: of the filtered difference [rad/s].
        delay: of the loop, with half a sample [s].
        drives: of the arm.
    """
    largest = np.full(inertias.shape[1], math.inf)
    joints = _Joints.of(inertias, drives)
    if joints is None:
        return largest
    phase = _Loop(1.0, 0.0, bandwidth, delay).response(0.0, joints.resonance).imag
    driven_at_link = np.maximum(phase, _LEAST)
    driven_at_motor = np.maximum(-joints.share * phase, _LEAST)
    at_link = np.where(phase > 0.0, joints.own / driven_at_link, math.inf)
    at_motor = np.where(phase < 0.0, joints.own / driven_at_motor, math.inf)
    either = np.where(joints.unsure, np.minimum(at_link, at_motor), at_motor)
    measured = np.where(joints.at_link, at_link, either)
    largest[joints.joints] = measured.min(axis=0)
    return largest


def motor_share(inertias: Array, drives: Any) -> Array:
    """Return the least share of each joint's inertia that is its motor's [-], (n,); 1 where joints are stiff.

    Beyond the resonance of an elastic joint a torque moves the motor alone.

    Args:
        inertias: own inertias of the joints [kg m^2 or kg], (configurations, n).
        drives: of the arm.
    """
    share = np.ones(inertias.shape[1])
    joints = _Joints.of(inertias, drives)
    if joints is not None:
        shares = 1.0 / (1.0 + joints.share)
        share[joints.joints] = shares.min(axis=0)
    return share


class _Joints(NamedTuple):
    """Elastic joints in some configurations, arrays (configurations, n).

    Attributes:
        resonance: between motor and link [rad/s].
        share: inertia of the link over that of the motor [-].
        own: what damps the resonance without the controller [1/s^2].
        at_link: whether the encoder sits at the link, (n,).
        unsure: whether nothing tells where it sits, (n,).
        joints: which joints of the arm they are, (all joints,).
    """

    resonance: Array
    share: Array
    own: Array
    at_link: Any
    unsure: Any
    joints: Any

    @classmethod
    def of(cls, inertias: Array, drives: Any) -> _Joints | None:
        """Return what is known of the joints; None where no stiffness is."""
        if drives is None:
            return None
        known = elastic_joints(drives)
        if not known.any():
            return None
        gear = drives.value("stiffness")[known]
        rotor = drives.value("rotor_inertia")[known]
        inertia = inertias[:, known]
        link = np.maximum(inertia - rotor, LEAST_LINK * inertia)
        reduced = rotor * link / (rotor + link)
        resonance = np.sqrt(gear / reduced)
        damping = drives.value("damping")[known]
        given_ratio = damping / (2.0 * reduced * resonance)
        ratio = np.where(np.isfinite(damping), given_ratio, GEAR_DAMPING)
        side = np.asarray(drives.value("encoder_side"))[known]
        own = 2.0 * ratio * resonance**2
        return cls(resonance, link / rotor, own, side == "link", side == "", known)


def _largest(holds: Callable[[Array], Any]) -> float:
    """Return the factor up to which something holds, from small ones on; 0 for none.

    Args:
        holds: tells it of several factors, (k,) -> booleans (k,).
    """
    low, high = _FACTORS
    for level in range(_LEVELS):
        factors = np.geomspace(low, high, _LOOKS)
        held = holds(factors)
        if level == 0 and held.all():
            return math.inf
        first = int(np.argmin(held))
        if first == 0:
            return 0.0
        low, high = float(factors[first - 1]), float(factors[first])
    return low
