"""Loads that a controller does not know: between which it works, and with which bandwidth.

GPI multiplies its virtual acceleration by the inertia matrix D^ of its nominal model. At a configuration the
error then splits into modes, each with its own eigenvalue delta of D^-1 D^ as a factor of the loop gain.
Below 0.36 a mode is unstable (zeta_c = 1), and above 1 its crossover grows like delta, until the sample time
bites. So the nominal model carries the heaviest load, delta >= 1, and the bandwidth is as low as the lightest
one requires.

A point mass m adds m B(q) to D, with B = J^T J of the point. So delta = 1 + m eig(D^-1 B): one eigenvalue,
the mobility of the point [1/kg], says what every mass does.
"""

from __future__ import annotations

import math
from bisect import bisect
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, ArrayLike, as_float_array, check_number
from armgpi.base.hints import with_keyword_hints
from armgpi.base.parameter import Parametrised, Vector, parameter, with_parameters
from armgpi.errors import ParameterError, PayloadError
from armgpi.gpi.family import PRINTED, Member
from armgpi.gpi.gains import Tuning
from armgpi.gpi.margins import (
    PRINTED_PHASE,
    Interval,
    default_omega,
    gain_interval,
    loops,
    open_loop,
    sector,
    tolerated_phase,
)
from armgpi.robot.batch import AnyRobot, RobotBatch, VariedRobots
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Least delta that the law tolerates for zeta_c = 1, p_c = omega_c (docs, theory: a wrong inertia matrix).
LEAST_DELTA = 0.36
#: delta omega_c (1.5 dt + delay) at the lightest load; the printed law tolerates 0.36 (delta = 1) to 0.40
#: (more). Of what another member tolerates the same share is used.
_PHASE = 0.3
DELAY_SHARE = _PHASE / PRINTED_PHASE
#: Slower loops follow too badly [rad/s]: gravity alone pulls at rates of up to sqrt(g / 0.1 m) = 10 rad/s.
_SLOWEST = 15.0
#: A load that an arm is likely to carry, as a share of what moves of it, how far beside its tip [m], as any
#: gripper holds it, and the least delta that it should leave.
_PLAUSIBLE, _BESIDE, PLAUSIBLE_DELTA = 0.05, 0.05, 0.5
#: Configurations at which the mobility is evaluated.
_CONFIGURATIONS = 512
#: Configurations of the highest mobility around which others are tried.
_WORST = 16
#: How often that is done, each time closer around them.
_ROUNDS = 8
#: Configurations over which inertia is taken.
_INERTIAS = 50


class PayloadRange(NamedTuple):
    """A range of loads and the controller that serves it.

    Attributes:
        lightest: lightest load [kg].
        heaviest: heaviest load [kg].
        frame: frame that carries it.
        com: its centre of mass in that frame [m], shape (3,).
        nominal: the nominal model for the controller, the robot with the heaviest load; a batch of them where
            the robot is one.
        delta: least and largest eigenvalue of D^-1 D^ over the range, at the configurations checked.
        omega_c: bandwidth that serves the range [rad/s]; of a batch of robots (batch, n).
        member: order of the controller that it is for.
    """

    lightest: float
    heaviest: float
    frame: str
    com: tuple[float, float, float]
    nominal: Robot
    delta: tuple[float, float]
    omega_c: float
    member: Member = PRINTED

    def certifiable(self, member: Member | None = None) -> bool:
        """Tell whether delta stays in :func:`certified_sector`: outside of it there is no certificate.

        Args:
            member: of the family; that of the range when not given.
        """
        return self.delta[1] <= certified_sector(self.member if member is None else member).upper

    def __str__(self) -> str:
        """Return the range in a sentence, and whether there may be a certificate for it."""
        sector, (low, high) = certified_sector(self.member).upper, self.delta
        verdict = f"is within the certified sector, 1 to {sector:.3g}"
        if not self.certifiable():
            verdict = f"leaves the certified sector, 1 to {sector:.3g}: no certificate at any speed"
        return (
            f"{self.lightest:g} to {self.heaviest:g} kg at {self.frame!r}: omega_c = "
            f"{np.min(self.omega_c):.4g} rad/s; delta from {low:.3g} to {high:.3g} {verdict}"
        )


@with_parameters
class LoadRange(Parametrised):
    """Loads that a controller must tolerate.

    Attributes:
        lightest: lightest load [kg], zero for none.
        heaviest: heaviest load [kg]; (batch, 1) for one in each rollout.
        frame: its frame; the robot's tip when not given.
        com: its centre of mass in that frame [m], shape (3,); it is taken as a point mass.
    """

    lightest: float = parameter("lightest load", unit="kg", default=0.0, least=0.0)
    heaviest: float = parameter("heaviest load", unit="kg", least=0.0, kw_only=True)
    frame: str | None = parameter(
        "frame that carries it", kind="text", default=None, none="the tip", kw_only=True
    )
    com: Vector = parameter(
        "centre of mass in that frame", unit="m", kind="vector", default=(0.0, 0.0, 0.0), kw_only=True
    )

    def choose(
        self,
        robot: AnyRobot,
        dt: float,
        delay: float,
        slowest: float | None = None,
        member: Member = PRINTED,
    ) -> PayloadRange:
        """Return nominal model and bandwidth for them; see :func:`payload_range`.

        Of a batch every robot is given its own bandwidth, and `delta` is the widest of all.
        """
        least = _SLOWEST if slowest is None else slowest
        robots = robot.robots if isinstance(robot, RobotBatch) else (robot,)
        heaviest = np.broadcast_to(np.ravel(self.heaviest), len(robots)).tolist()

        @cache  # rollouts may share a robot
        def one(robot: Robot, most: float) -> PayloadRange:
            place = (self.frame, self.com)
            return payload_range(
                robot, self.lightest, most, *place, dt=dt, delay=delay, slowest=least, member=member
            )

        each = [one(robot, most) for robot, most in zip(robots, heaviest, strict=True)]
        if robot.batch is None:
            return each[0]
        nominal: Any
        if isinstance(robot, VariedRobots) and "payload" not in robot.variation:
            # Declared to vary, so that generated code has the load as an input, whatever it is.
            load = {"payload": heaviest, "com": self.com, "frame": self.frame}
            nominal = robot.base.varied(**robot.variation, **load)
        else:
            nominal = RobotBatch([one.nominal for one in each])
        omega_c: Any = np.array([[one.omega_c] * robot.n for one in each])
        delta = (1.0, max(one.delta[1] for one in each))
        return each[0]._replace(nominal=nominal, delta=delta, omega_c=omega_c)


def load_range(loads: Any, frame: str | None, com: Any) -> LoadRange:
    """Return a range of loads as it is, or that of two masses in a frame.

    Raises:
        ParameterError: when it is neither.
    """
    if isinstance(loads, LoadRange):
        return loads
    if not isinstance(loads, tuple | list) or len(loads) != 2:
        raise ParameterError("payload", loads, "two masses [kg], the lightest and the heaviest")
    return LoadRange(loads[0], heaviest=loads[1], frame=frame, com=com)


def served_omega(loads: PayloadRange | None, dt: float, delay: float, member: Member) -> float | Array:
    """Return the bandwidth that sample time, delay and loads allow [rad/s]; of a batch of robots (batch, n).

    Raises:
        ParameterError: when poles of the member are so far apart that floats do not tell.
    """
    if loads is not None:
        return loads.omega_c
    omega = default_omega(dt, delay, member=member)
    if not omega > 0.0:  # NaN
        raise ParameterError("gains", None, "given where poles are so far apart")
    return omega


class LargestPayload(NamedTuple):
    """The heaviest loads [kg] that an arm tolerates, by what limits them.

    Attributes:
        nominal: of a range from no load on, for a controller with default gains whose nominal model has the
            heaviest (``GPI(robot, dt, payload=(0.0, nominal))``).
        unknown: for a controller whose nominal model has no load. Its modes have delta = 0.36 there, the
            edge of stability.
        certifiable: of a range from no load on that a certificate may be had for (:func:`certified_sector`).
        effort: that the motors hold against gravity at every configuration checked; zero when they do not
            even hold the arm.
        mobility: largest eigenvalue of D^-1 B without load [1/kg], the inverse of the least mass that the
            arm itself sets against an acceleration of the point.
    """

    nominal: float
    unknown: float
    certifiable: float
    effort: float
    mobility: float


def certified_sector(member: Member = PRINTED) -> Interval:
    """Return the delta that may change with time in any way, as it does while the arm moves.

    A constant delta of the printed law is stable above 0.36 without end. One that changes has to stay in this
    sector, from 1 on (circle criterion, zeta_c = 1, no sampling), and in less of it where motion counts.

    Args:
        member: of the family.
    """
    one = np.array(1.0)
    return sector(open_loop(Tuning(one, one, one), member))


def payload_range(
    robot: Robot,
    lightest: float,
    heaviest: float,
    frame: str | None = None,
    com: ArrayLike = (0.0, 0.0, 0.0),
    *,
    dt: float = 1e-3,
    delay: float = 0.0,
    slowest: float = _SLOWEST,
    member: Member = PRINTED,
) -> PayloadRange:
    """Return the nominal model and the bandwidth of a GPI controller for loads in a range.

    The mobility is taken at 512 configurations inside the joint limits and around the worst of them. The
    bandwidth is :func:`armgpi.default_omega`, or less where the largest delta asks for it: delta omega_c (1.5
    dt + delay) is at most 0.3, where the printed controller tolerates 0.36 or more. Another order uses the
    same share of its delay margin at that delta; one with a roll-off has none beyond a delta of 2 to 5.
    Printed, what it returns says whether delta stays in the certified sector.

    Args:
        robot: the arm without load.
        lightest: lightest load [kg], zero for none.
        heaviest: heaviest load [kg].
        frame: its frame; the robot's tip when not given.
        com: its centre of mass in that frame [m], shape (3,); it is taken as a point mass.
        dt: sample time [s].
        delay: transport delay in the loop [s].
        slowest: least bandwidth that is of use [rad/s].
        member: order of the controller.

    Raises:
        PayloadError: when no bandwidth serves the range; it has the ranges that would suffice.
        NameNotFound: when there is no such frame.
        ParameterError: when a mass is negative, the range is empty, or the frame does not move.
    """
    _check_robot(robot)
    lightest = check_number(lightest, "lightest", "zero or positive [kg]")
    heaviest = check_number(heaviest, "heaviest", f"at least the lightest load, {lightest:g} kg", lightest)
    fastest = default_omega(dt, delay, member=member)
    slowest = min(check_number(slowest, "slowest", "positive [rad/s]", open_=True), fastest)
    frame = robot.tip if frame is None else frame
    nominal = robot.with_payload(frame, heaviest, com)
    lightly = robot if lightest == 0.0 else robot.with_payload(frame, lightest, com)
    mobility = _mobility(lightly, frame, com)
    delta = 1.0 + (heaviest - lightest) * mobility
    omega_c = _phase(member, delta) / late(dt, delay)
    if omega_c < slowest:
        most = most_delta(member, slowest * late(dt, delay))
        # Loaded, the mobility is w = mobility / delta, and the arm less x has delta = 1 / (1 - x w).
        heaviest_too = lightest + (most - 1.0) / mobility
        lightest_too = heaviest - (1.0 - 1.0 / most) * delta / mobility
        asked = (lightest, heaviest)
        raise PayloadError(robot.name, frame, asked, delta, omega_c, slowest, heaviest_too, lightest_too)
    point = as_float_array(com, "com").tolist()
    place = frame, tuple(point)
    return PayloadRange(lightest, heaviest, *place, nominal, (1.0, delta), min(omega_c, fastest), member)


@with_keyword_hints
def largest_payload(
    robot: Robot,
    frame: str | None = None,
    com: ArrayLike = (0.0, 0.0, 0.0),
    *,
    dt: float = 1e-3,
    delay: float = 0.0,
    member: Member = PRINTED,
) -> LargestPayload:
    """Return the heaviest loads that an arm tolerates, with default gains and by its motors.

    Args:
        robot: the arm without load.
        frame: frame of the payload; the robot's tip when not given.
        com: its centre of mass in that frame [m], shape (3,); it is taken as a point mass.
        dt: sample time [s].
        delay: transport delay in the loop [s].
        member: order of the controller.

    Raises:
        NameNotFound: when there is no such frame.
        ParameterError: when the frame does not move.
    """
    _check_robot(robot)
    frame = robot.tip if frame is None else frame
    mobility = _mobility(robot, frame, com)
    most = most_delta(member, default_omega(dt, delay, member=member) * late(dt, delay))
    return LargestPayload(
        nominal=_over(most - 1.0, mobility),
        unknown=_over(1.0 / least_delta(member) - 1.0, mobility),
        certifiable=_over(certified_sector(member).upper - 1.0, mobility),
        effort=_holdable(robot, frame, com),
        mobility=mobility,
    )


class PlausibleLoad(NamedTuple):
    """A load that an arm is likely to carry.

    Attributes:
        mass: 5 % of what moves of the arm [kg].
        com: where its centre is in the frame of the tip [m]: 5 cm beside it.
        delta: least eigenvalue of D^-1 D^ with it, of a nominal model without.
        mobility: largest eigenvalue of D^-1 B without load [1/kg].
    """

    mass: float
    com: tuple[float, float, float]
    delta: float
    mobility: float

    def with_nominal(self, mass: float) -> float:
        """Return `delta` of a nominal model that carries a mass [kg]."""
        return self.delta * (1.0 + mass * self.mobility)


def plausible_load(robot: Robot) -> PlausibleLoad:
    """Return the load that an arm is likely to carry at its tip, and what it does to the loop."""
    mass, q = _PLAUSIBLE * robot.moving_mass, robot.middle()
    # 5 cm along the axis of the tip's frame where it weighs most on the last joint.
    sides: list[tuple[float, float, float]] = [(_BESIDE, 0.0, 0.0), (0.0, _BESIDE, 0.0), (0.0, 0.0, _BESIDE)]
    com = max(sides, key=lambda x: float(robot.with_payload(robot.tip, 1.0, x).mass_matrix(q)[-1, -1]))
    mobility = _mobility(robot, robot.tip, com)
    return PlausibleLoad(mass, com, 1.0 / (1.0 + mass * mobility), mobility)


def balanced_load(robot: Robot, most: float) -> float:
    """Return the nominal load at the tip [kg] that puts delta as far above 1 empty as below it loaded.

    Loaded is with :func:`plausible_load`.

    Args:
        robot: the arm without load.
        most: largest delta that the loop tolerates, empty.
    """
    load = plausible_load(robot)
    return _over(min(most, 1.0 / math.sqrt(load.delta)) - 1.0, load.mobility) if load.mobility > 0.0 else 0.0


def _check_robot(robot: Robot) -> None:
    """Refuse anything but one robot."""
    if not isinstance(robot, Robot):
        raise ParameterError("robot", robot, "a single Robot")


def least_delta(member: Member = PRINTED) -> float:
    """Return the least delta that a member tolerates for zeta_c = 1 and p_c = omega_c, of its worst joint."""
    if member.printed:
        return LEAST_DELTA
    one = np.ones(1)
    return max(gain_interval(loop).lower for loop in loops(Tuning(one, one, one), member))


def _phase(member: Member, delta: float) -> float:
    """Return omega_c (1.5 dt + delay) that may be used at the lightest load, which has `delta`."""
    if member.printed:
        return _PHASE / delta
    return DELAY_SHARE * tolerated_phase(member, delta)


def most_delta(member: Member, phase: float) -> float:
    """Return the largest delta at which a loop may spend `phase`, omega_c times its lateness [-]; at least 1.

    It is what :func:`payload_range` allows: no more than a share of the member's delay margin at that delta.
    """
    if member.printed:
        return max(_PHASE / phase, 1.0)
    if _phase(member, 1.0) <= phase:
        return 1.0
    low = 1.0
    while _phase(member, 2.0 * low) > phase:
        low *= 2.0
    octave: list[float] = np.geomspace(low, 2.0 * low, 1 + 2**16).tolist()
    return octave[bisect(octave, -phase, key=lambda delta: -_phase(member, delta)) - 1]


def late(dt: float, delay: float) -> float:
    """Return how late the torque acts [s]: hold, computation and transport."""
    return 1.5 * dt + delay


def _mobility(robot: Robot, frame: str, com: ArrayLike = (0.0, 0.0, 0.0)) -> float:
    """Return the largest eigenvalue of D^-1 B [1/kg] found inside the joint limits."""
    alike = _Alike(robot, frame, com)
    return _largest_mobility(alike) / alike.size


class _Alike:
    """A robot and where it carries; equal to those whose inertia is another one by a factor.

    The robots of a batch often are, and an arm's mobility is asked for more than once.
    """

    def __init__(self, robot: Robot, frame: str, com: ArrayLike) -> None:
        self.robot, self.loaded = robot, robot.with_payload(frame, 1.0, com)
        D = robot.mass_matrix(robot.middle())
        self.size = float(np.trace(D))
        B = self.loaded.mass_matrix(robot.middle()) - D
        seen = np.round([*np.ravel(D / self.size), *np.ravel(B), *np.ravel(robot.limits[:2])], 9)
        self._key = (robot.name, frame, seen.tobytes())

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Alike) and self._key == other._key


@lru_cache(maxsize=64)
def _largest_mobility(alike: _Alike) -> float:
    """Return the largest eigenvalue of D^-1 B found, times the trace of D in the middle [kg m^2 / kg]."""
    robot, loaded = alike.robot, alike.loaded
    q = random_configurations(robot, _CONFIGURATIONS, seed=0)
    width = np.ptp(q, axis=0)
    rng = np.random.default_rng(0)
    value = _mobilities(robot, loaded, q)
    for closer in range(_ROUNDS):
        best = np.argsort(-value)[:_WORST]
        q, value = q[best], value[best]
        near = np.repeat(q, _WORST, axis=0)
        near = near + 0.2 * 0.5**closer * width * rng.standard_normal(near.shape)
        near = np.clip(near, *robot.limits[:2])
        q = np.concatenate([q, near])
        value = np.concatenate([value, _mobilities(robot, loaded, near)])
    return float(value.max()) * alike.size


def _mobilities(robot: Robot, loaded: Robot, q: Array) -> Array:
    """Return the largest eigenvalue of D^-1 B at configurations (k, n); `loaded` carries one kilogram."""
    D = robot.mass_matrix(q)
    lower = np.linalg.cholesky(D)
    half = np.linalg.solve(lower, loaded.mass_matrix(q) - D)
    whole = np.linalg.solve(lower, half.swapaxes(-1, -2))
    return np.maximum(np.linalg.eigvalsh(whole)[:, -1], 0.0)


def _holdable(robot: Robot, frame: str, com: ArrayLike) -> float:
    """Return the heaviest load [kg] whose gravity the motors hold at random configurations."""
    q = random_configurations(robot, _CONFIGURATIONS, seed=0)
    own = robot.gravity(q)
    per_kilogram = robot.with_payload(frame, 1.0, com).gravity(q) - own
    spare = robot.limits.effort - np.sign(per_kilogram) * own
    bearing = np.abs(per_kilogram) > 1e-12
    masses = np.where(bearing, spare / np.where(bearing, np.abs(per_kilogram), 1.0), math.inf)
    return max(0.0, float(masses.min()))


def _over(value: float, mobility: float) -> float:
    """Return value / mobility, infinite for a point that no acceleration of the arm moves."""
    return value / mobility if mobility > 0.0 else math.inf


def most_inertia(robot: Robot) -> Array:
    """Return the largest absolute entries of D(q) at random configurations, always the same, (n, n)."""
    q = random_configurations(robot, _INERTIAS, seed=0)
    return np.asarray(np.abs(robot.mass_matrix(q)).max(axis=0))
