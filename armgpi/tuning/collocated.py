"""The controller for elastic joints whose encoders sit at the motors, in closed form.

Motor and encoder move together, so the loop damps the joint's resonance at no cost as long as its phase stays
above -180 degrees there. What limits it is not the resonance but the delay T of hold, transport and current
loop, together with how much more inertia the feedback has than the rotor alone, which is all that the torque
moves at high frequencies. So the derivative filter is kept apart from the bandwidth. With

    C(s) = w s / (1 + s/f) + w^2 / 1.4 + w^3 / (10 s)

the characteristic polynomial of one joint has a pair of poles at 0.77 w with a damping ratio of 0.55, a slow
real one at 0.18 w and a fast one near f. From a delay of 2.5 ms on, where lighter rotors are not checked, it
has w^2 / 2 and w^3 / 15, and where the loop is late w^2 / 2.5 and w^3 / 25. It is the member of the GPI
family with one integrator and no roll-off.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.gpi.advice import COUNT_SHARE
from armgpi.gpi.family import Member
from armgpi.robot.batch import feedback_model
from armgpi.robot.kinematics import middle_and_random
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears
from armgpi.tuning import geared
from armgpi.tuning.two_mass import CURRENT_LOOP, ArmLoop, Gears

#: Share of the links' inertia in the feedback: between the rotor alone, which the torque moves above the
#: resonance, and the whole arm, which it moves below.
LINK_FACTOR = 0.4
#: Share of the rotors' inertia in the feedback.
ROTOR_FACTOR = 1.5
#: The same where the loop is late. What excites a lightly damped resonance grows with w times these, what
#: holds a load with w^2 times them: with less inertia and more w the same stiffness needs less damping.
LATE_LINK_FACTOR = 0.2
LATE_ROTOR_FACTOR = 1.0
#: Divisors p and i of the proportional and integral gains, w^2 / p and w^3 / i [-]. A joint that friction
#: holds beside its reference moves on when the integral has grown by that friction: with these it does so
#: soon enough to be at rest where with 2 and 15, or 2.5 and 25, it still creeps (tools/first_rule.py, seeds
#: 501 and 508). With 1.2 and 9 the peak sensitivity of Panda's loop is above 2.5.
PROPORTIONAL, INTEGRAL = 1.4, 10.0
#: The same from a delay of GUARDED on. No corner of lighter rotors is checked there, and with 1.4 and 10 six
#: of 96 randomised arms swing for good, with these one (tools/alarms.py; docs/drives_measured.md).
CAREFUL_PROPORTIONAL, CAREFUL_INTEGRAL = 2.0, 15.0
#: The same where the loop is late.
LATE_PROPORTIONAL, LATE_INTEGRAL = 2.5, 25.0
#: Error that is not integrated while the reference rests [rad or m], but no less than so many counts.
REST_ZONE, REST_COUNTS = 1e-4, 2.0
#: The same where the loop is late, and at most.
LATE_REST_ZONE = 3e-4
#: Highest velocity gain w [rad/s]; faster loops bring little and step the torque more.
FASTEST = 45.0
#: Lowest velocity gain w [rad/s]: an arm that is slower falls under a load.
SLOWEST = 4.0
#: Largest w times delay times inertia ratio [-]. With the true rotors up to 0.6 is stable; assumed ones may
#: be 2.5 times too heavy, or too light.
DELAY_SHARE = 0.4
#: Highest filter frequency f [rad/s].
HIGHEST_FILTER = 1000.0
#: Lowest filter frequency f that encoder counts may ask for [rad/s], and lowest one over w [-].
LOWEST_FILTER = 150.0
LEAST_FILTER_RATIO = 5.0
#: Ratio of the feedback's inertia to the rotor's, over that of a rotor alone, from which on that is light.
_LIGHT = 2.0
#: Delay from which on a loop is slow enough for the other controller [s].
LATE = 8e-3
#: Delay from which on a loop is late: the resonance is not damped any more, but excited [s].
COMPARED = 5e-3
#: Damping ratio of the joints at which loops have to be stable [-]; 1 to 5 % are usual.
DAMPING = 0.03
#: The same of loops that are late, whose resonance has no other damping than its own [-]; the second where
#: the first makes joints so slow that arms fall under their loads (tools/first_rule.py, seeds 502 to 504).
LATE_DAMPINGS = (0.01, 0.02)
#: Factors of an assumed stiffness at which they have to be.
STIFFNESS_FACTORS = (0.5, 1.0, 2.0)
#: By how much those joints are slower that swing where a loop is not stable [-].
SLOWER = 1.25
#: Delay below which loops have to be stable in a corner as well [s]: assumed rotors that are as light, and
#: joints that are as stiff and as little damped, as they may be. Later loops would lose most of their gain.
GUARDED = 2.5e-3
#: That corner: factor of assumed rotors, and damping ratio of the joints [-].
CORNER_ROTORS, CORNER_DAMPING = 0.4, 0.01
#: By how much joints that swing are slower where it is not stable, and how often at most.
CORNER_SLOWER, CORNER_STEPS = 1.06, 4
#: Configurations at which inertia is taken, at which loops are tried, and late ones.
_CONFIGURATIONS = 8
_TRIED, _LATE_TRIED = 2, 4


class Collocated(NamedTuple):
    """The numbers of the controller.

    Attributes:
        w: velocity gain [rad/s], (n,).
        f: filter frequency of the derivative [rad/s], (n,).
        limits: joint by joint what limits w: "delay", "rotors" (light ones), "noise" (encoder counts),
            "gears" (elasticity) or "crossover".
        link_factor: share of the links' inertia in the feedback [-].
        rotor_factor: share of the rotors' inertia in the feedback [-].
        proportional: divisor of the proportional gain [-].
        integral: divisor of the integral gain [-].
        rest_zone: error that is not integrated while the reference rests [rad or m].
    """

    w: Array
    f: Array
    limits: tuple[str, ...]
    link_factor: float = LINK_FACTOR
    rotor_factor: float = ROTOR_FACTOR
    proportional: float = PROPORTIONAL
    integral: float = INTEGRAL
    rest_zone: float = REST_ZONE

    @property
    def poles(self) -> Poles:
        """The poles of each joint's loop, as parameters of the GPI family."""
        joints = zip(self.w, self.f, strict=True)
        rows = [poles_of(w, f, self.proportional, self.integral) for w, f in joints]
        return Poles(*np.array(rows).T)


class Poles(NamedTuple):
    """Poles as a GPI controller takes them, each (n,).

    Attributes:
        omega_c: natural frequency of the pair [rad/s].
        zeta_c: its damping ratio [-].
        second_ratio: frequency of the second factor over omega_c [-].
        second_zeta: its damping ratio [-], above 1: one slow and one fast real pole.
    """

    omega_c: Array
    zeta_c: Array
    second_ratio: Array
    second_zeta: Array

    @property
    def member(self) -> Member:
        """The member of the family: one integrator and no roll-off."""
        return Member(1, 0, 4.0, self.second_ratio, self.second_zeta)


def poles_of(
    w: float, f: float, proportional: float = PROPORTIONAL, integral: float = INTEGRAL
) -> tuple[float, float, float, float]:
    """Return pair and second factor of s^3 (1 + s/f) + w s^2 + (w^2 s/p + w^3/i) (1 + s/f).

    Args:
        w: velocity gain [rad/s].
        f: filter frequency [rad/s], five times w at least: then two roots are real.
        proportional: divisor p of the proportional gain [-].
        integral: divisor i of the integral gain [-].

    Returns:
        Natural frequency [rad/s] and damping ratio of the pair, ratio and damping ratio of the other factor.
    """
    stiffness = w * w / proportional
    rate = w**3 / integral
    polynomial = [1.0 / f, 1.0, w + stiffness / f, stiffness + rate / f, rate]
    roots = np.roots(polynomial)
    most_real_first = np.argsort(np.abs(roots.imag))
    slow, fast = np.sort(-roots[most_real_first[:2]].real)
    pair = roots[most_real_first[2]]
    omega = float(np.abs(pair))
    damping = float(-pair.real) / omega
    second_omega = math.sqrt(float(slow * fast))
    second_damping = float(slow + fast) / (2.0 * second_omega)
    return omega, damping, second_omega / omega, second_damping


def delay_of(dt: float, late: int, current: float = CURRENT_LOOP) -> float:
    """Return the delay of hold, transport and current loop [s].

    Args:
        dt: sample time [s].
        late: samples by which measurements are late.
        current: bandwidth of the current loop [Hz].
    """
    return dt * (0.5 + late) + 1.0 / (2.0 * math.pi * current)


def choose(
    robot: Robot,
    carried: Robot,
    dt: float,
    late: int,
    counts: Array | None,
    effort: Array,
    damping: float = LATE_DAMPINGS[0],
) -> Collocated | None:
    """Return the controller of an arm, or None where no bandwidth is stable and quiet enough.

    Args:
        robot: the arm as it is known; stiffness of which nothing is known is assumed.
        carried: the same with the load in the nominal model of the feedback.
        dt: sample time [s].
        late: samples by which measurements are late.
        counts: one count of each encoder, at the joint [rad or m], (n,); None for exact positions.
        effort: usual effort of each joint [N m or N], (n,).
        damping: ratio of the joints at which loops that are late have to be stable [-].
    """
    robot = assume_gears(robot)
    rotor = robot.armature
    if not rotor.all():
        return None
    current = float(np.min(robot.drives.value("current_bandwidth", CURRENT_LOOP)))
    delay = delay_of(dt, late, current)
    suited = _Feedback.of(delay)
    places = middle_and_random(robot, _CONFIGURATIONS, seed=0)
    inertia = suited.inertia(carried, rotor, places)
    w, limits = _allowed_by_delay(inertia, rotor, delay, suited.rotor_factor)
    f = np.full(robot.n, min(HIGHEST_FILTER, 2.0 / dt))
    if counts is not None:
        quiet_w, f = _quieten(np.abs(inertia).max(axis=0), counts, effort, w, f, dt)
        if float(quiet_w.min()) < SLOWEST:
            return None
        limits = np.where(quiet_w < w, "noise", limits)
        w = quiet_w
    fast_enough = w
    nominal: Any = feedback_model(carried, suited.link_factor, suited.rotor_factor)
    shape = (suited.link_factor, suited.rotor_factor, suited.proportional, suited.integral)

    def swinging(cases: tuple[geared.Case, ...], w: Array) -> Array:
        poles = Collocated(w, f, (), *shape).poles
        loops = geared.Loops(cases, nominal, robot, poles.member, dt, poles.zeta_c)
        return loops.swinging(poles.omega_c)

    cases = _loops(robot, dt, late, current, DAMPING if delay < COMPARED else damping)
    while (is_swinging := swinging(cases, w)).any():
        w = np.where(is_swinging, w / SLOWER, w)
        if float(w.min()) < SLOWEST / SLOWER:
            return None
    if delay < GUARDED:
        corner = _corner(robot, places, dt, late, current)
        w = _guarded(w, partial(swinging, corner))
    limits = np.where(w < fast_enough, "gears", limits)
    rest_zone = _rest_zone(suited.rest_zone, counts)
    return Collocated(w, f, tuple(limits.tolist()), *shape, rest_zone)


def _allowed_by_delay(inertia: Array, rotor: Array, delay: float, rotor_factor: float) -> tuple[Array, Array]:
    """Return the velocity gains that the delay leaves [rad/s], (n,), and joint by joint what limits them.

    Args:
        inertia: of the feedback at some configurations [kg m^2], (configurations, n, n).
        rotor: inertia of the rotors [kg m^2], (n,): all that a torque moves at high frequencies.
        delay: of hold, transport and current loop [s].
        rotor_factor: share of the rotors' inertia in the feedback [-].
    """
    alone = np.diagonal(inertia, axis1=1, axis2=2) / rotor
    ratio = np.max(alone, axis=0)
    w = np.minimum(FASTEST, DELAY_SHARE / (delay * ratio))
    # All joints together have a larger ratio than the largest of one alone.
    coupled = np.linalg.eigvals(inertia / rotor[:, None] * w)
    w = w * min(1.0, DELAY_SHARE / (delay * np.abs(coupled).max()))
    # Of a heavier rotor the torque would move less, and the delay allow more.
    is_light = ratio > _LIGHT * rotor_factor
    by_delay = np.where(is_light, "rotors", "delay")
    limits = np.where(w < FASTEST, by_delay, "crossover").astype("U9")
    return np.maximum(w, SLOWEST), limits


def _guarded(w: Array, swinging: Callable[[Array], Array]) -> Array:
    """Return velocity gains [rad/s] with which a corner is stable, the same ones where none nearby are.

    Args:
        w: velocity gains [rad/s], (n,).
        swinging: which joints swing in an unstable loop with some velocity gains, (n,) of bool.
    """
    least = np.maximum(w / CORNER_SLOWER**CORNER_STEPS, SLOWEST / SLOWER)
    slower = w
    while (is_swinging := swinging(slower)).any():
        slower = np.where(is_swinging, slower / CORNER_SLOWER, slower)
        if (slower < 0.999 * least).any():
            return w
    return slower


def _corner(robot: Robot, places: Array, dt: float, late: int, current: float) -> tuple[geared.Case, ...]:
    """Return an arm whose assumed rotors are light, and its joints stiff and little damped, or nothing."""
    assumed = np.array(robot.drives.sources("rotor_inertia")) == "assumed"
    if not assumed.any():
        return ()
    rotor = np.where(assumed, CORNER_ROTORS, 1.0) * robot.armature
    stiffest = _stiffness(robot)[-1]
    gears = Gears(rotor, stiffest, CORNER_DAMPING, current, "motor")
    return _stable_cases(robot, places, [gears], dt, late)


def _stable_cases(
    robot: Robot, places: Array, drives: Sequence[Gears], dt: float, late: int
) -> tuple[geared.Case, ...]:
    """Return loops that have to be stable, and no more than that: each place with each of some drives."""
    listed = []
    for q, gears in itertools.product(places, drives):
        loop = ArmLoop(robot, q, gears, dt, late)
        listed.append(geared.Case(q, loop, judged=False))
    return tuple(listed)


def _rest_zone(least: float, counts: Array | None) -> float:
    """Return the error that is not integrated at rest [rad or m]: above what encoders cannot tell."""
    if counts is None:
        return least
    unresolved = REST_COUNTS * float(np.max(counts))
    return min(max(least, unresolved), LATE_REST_ZONE)


class _Feedback(NamedTuple):
    """What suits a delay.

    Attributes:
        link_factor: share of the links' inertia in the feedback [-].
        rotor_factor: share of the rotors' inertia [-].
        proportional: divisor of the proportional gain [-].
        integral: divisor of the integral gain [-].
        rest_zone: error that is not integrated at rest [rad or m].
    """

    link_factor: float
    rotor_factor: float
    proportional: float
    integral: float
    rest_zone: float

    @classmethod
    def of(cls, delay: float) -> _Feedback:
        """Return what suits a delay [s]."""
        if delay < GUARDED:
            return cls(LINK_FACTOR, ROTOR_FACTOR, PROPORTIONAL, INTEGRAL, REST_ZONE)
        if delay < COMPARED:
            return cls(LINK_FACTOR, ROTOR_FACTOR, CAREFUL_PROPORTIONAL, CAREFUL_INTEGRAL, REST_ZONE)
        late = (LATE_LINK_FACTOR, LATE_ROTOR_FACTOR, LATE_PROPORTIONAL, LATE_INTEGRAL)
        return cls(*late, LATE_REST_ZONE)

    def inertia(self, carried: Robot, rotor: Array, places: Array) -> Array:
        """Return the inertia of the feedback at some places [kg m^2], (places, n, n).

        Args:
            carried: the arm with the load of the nominal model.
            rotor: inertia of the rotors [kg m^2], (n,).
            places: configurations, (places, n).
        """
        links = carried.mass_matrix(places) - np.diag(carried.armature)
        return np.asarray(self.link_factor * links + self.rotor_factor * np.diag(rotor))


def has_feedback(link_factor: float, rotor_factor: float) -> bool:
    """Tell whether a controller has the inertia in its feedback that this rule gives it at some delay."""
    rule = (LINK_FACTOR, ROTOR_FACTOR), (LATE_LINK_FACTOR, LATE_ROTOR_FACTOR)
    return (link_factor, rotor_factor) in rule


def _quieten(
    feedback: Array, counts: Array, effort: Array, w: Array, f: Array, dt: float
) -> tuple[Array, Array]:
    """Return w and f at which one count moves no torque by more than a share of the usual effort.

    Args:
        feedback: largest absolute entries of the feedback's inertia [kg m^2], (n, n).
        counts: of the encoders at the joints [rad or m], (n,).
        effort: usual effort [N m or N], (n,).
        w: velocity gains [rad/s], (n,).
        f: filter frequencies [rad/s], (n,).
        dt: sample time [s].
    """

    def torque(w: Array, f: Array) -> Array:
        # The derivative's gain at the sample of a step: w f / (1 + dt f / 2).
        acceleration = counts * w * f / (1.0 + 0.5 * dt * f)
        return np.asarray(feedback @ acceleration / effort)

    least = np.minimum(f, np.maximum(LOWEST_FILTER, LEAST_FILTER_RATIO * w))
    lowered = f
    for share in np.linspace(1.0, 0.0, 21):
        lowered = least + share * (f - least)
        if (torque(w, lowered) <= COUNT_SHARE).all():
            return w, lowered
    noise = torque(w, lowered) / COUNT_SHARE
    # Each joint's torque hears the counts of all others: those that are too loud are all slower.
    heard = np.where(feedback > 0.0, noise[:, None], 0.0)
    loudest = np.max(heard, axis=0)
    return w / np.maximum(loudest, 1.0), lowered


def _loops(robot: Robot, dt: float, late: int, current: float, damping: float) -> tuple[geared.Case, ...]:
    """Return the arm at some configurations, at the ends of what is known of the stiffness."""
    is_late = delay_of(dt, late, current) >= COMPARED
    places = middle_and_random(robot, _LATE_TRIED if is_late else _TRIED, seed=1)
    drives = [Gears(robot.armature, stiffness, damping, current, "motor") for stiffness in _stiffness(robot)]
    return _stable_cases(robot, places, drives, dt, late)


def _stiffness(robot: Robot) -> list[Array]:
    """Return the least, the usual and the largest stiffness that joints may have [N m/rad or N/m], (n,)."""
    stiffness = robot.drives.value("stiffness")
    low, high = robot.drives.interval("stiffness")
    is_assumed = np.array(robot.drives.sources("stiffness")) == "assumed"
    is_open = is_assumed | (low == high)
    ends = []
    for factor, end in zip(STIFFNESS_FACTORS, (low, stiffness, high), strict=True):
        ends.append(np.where(is_open, factor * stiffness, end))
    return ends
