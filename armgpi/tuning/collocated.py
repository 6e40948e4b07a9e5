"""The controller for elastic joints whose encoders sit at the motors, in closed form.

Motor and encoder move together, so the loop damps the joint's resonance at no cost as long as its phase stays
above -180 degrees there. What limits it is not the resonance but the delay T of hold, transport and current
loop, together with how much more inertia the feedback has than the rotor alone, which is all that the torque
moves at high frequencies. So the derivative filter is kept apart from the bandwidth. With

    C(s) = w s / (1 + s/f) + w^2 / 2 + w^3 / (15 s)

the characteristic polynomial of one joint has a pair of poles at 0.58 w, a slow real one at 0.2 w and a fast
one near f. Loops that are late have w^2 / 2.5 and w^3 / 25. It is the member of the GPI family with one
integrator and no roll-off.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.gpi.advice import COUNT_SHARE
from armgpi.gpi.family import Member
from armgpi.robot.batch import feedback_model
from armgpi.robot.kinematics import random_configurations
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
#: soon enough to be at rest where with 2.5 and 25 it still creeps (tools/first_rule.py, seed 501).
PROPORTIONAL, INTEGRAL = 2.0, 15.0
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
        return Poles(*np.array([poles_of(w, f, self.proportional, self.integral) for w, f in joints]).T)


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
    roots = np.roots([1.0 / f, 1.0, w + stiffness / f, stiffness + rate / f, rate])
    order = np.argsort(np.abs(roots.imag))
    slow, fast = np.sort(-roots[order[:2]].real)
    pair = roots[order[2]]
    omega = float(np.abs(pair))
    product = float(slow * fast)
    second = math.sqrt(product)
    return omega, float(-pair.real) / omega, second / omega, float(slow + fast) / (2.0 * second)


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
    places = np.stack([robot.middle(), *random_configurations(robot, _CONFIGURATIONS - 1, seed=0)])
    links = carried.mass_matrix(places) - np.diag(carried.armature)
    own = _Feedback.of(delay)
    feedback = own.link_factor * links + own.rotor_factor * np.diag(rotor)
    own_ratio = np.max(np.diagonal(feedback, axis1=1, axis2=2) / rotor, axis=0)
    w = np.minimum(FASTEST, DELAY_SHARE / (delay * own_ratio))
    coupled = np.abs(np.linalg.eigvals(feedback / rotor[:, None] * w)).max()
    w = w * min(1.0, DELAY_SHARE / (delay * coupled))
    # Of a heavier rotor the torque would move less, and the delay allow more.
    light = own_ratio > _LIGHT * own.rotor_factor
    limits = np.where(w < FASTEST, np.where(light, "rotors", "delay"), "crossover").astype("U9")
    w = np.maximum(w, SLOWEST)
    f = np.full(robot.n, min(HIGHEST_FILTER, 2.0 / dt))
    if counts is not None:
        quiet_w, f = _quieten(np.abs(feedback).max(axis=0), counts, effort, w, f, dt)
        if float(quiet_w.min()) < SLOWEST:
            return None
        limits = np.where(quiet_w < w, "noise", limits)
        w = quiet_w
    fast_enough = w
    nominal: Any = feedback_model(carried, own.link_factor, own.rotor_factor)
    cases = _loops(robot, dt, late, current, DAMPING if delay < COMPARED else damping)
    shape = (own.link_factor, own.rotor_factor, own.proportional, own.integral)

    def swinging(cases: tuple[geared.Case, ...], w: Array) -> Array:
        poles = Collocated(w, f, (), *shape).poles
        return geared.Loops(cases, nominal, robot, poles.member, dt, poles.zeta_c).swinging(poles.omega_c)

    while (which := swinging(cases, w)).any():
        w = np.where(which, w / SLOWER, w)
        if float(w.min()) < SLOWEST / SLOWER:
            return None
    if delay < GUARDED:
        w = _guarded(w, partial(swinging, _corner(robot, places, dt, late, current)))
    limits = np.where(w < fast_enough, "gears", limits)
    return Collocated(w, f, tuple(limits.tolist()), *shape, _rest_zone(own.rest_zone, counts))


def _guarded(w: Array, swinging: Callable[[Array], Array]) -> Array:
    """Return velocity gains [rad/s] with which a corner is stable, the same ones where none nearby are.

    Args:
        w: velocity gains [rad/s], (n,).
        swinging: which joints swing in an unstable loop with some velocity gains, (n,) of bool.
    """
    slower, least = w, np.maximum(w / CORNER_SLOWER**CORNER_STEPS, SLOWEST / SLOWER)
    while (which := swinging(slower)).any():
        slower = np.where(which, slower / CORNER_SLOWER, slower)
        if (slower < 0.999 * least).any():
            return w
    return slower


def _corner(robot: Robot, places: Array, dt: float, late: int, current: float) -> tuple[geared.Case, ...]:
    """Return an arm whose assumed rotors are light, and its joints stiff and little damped, or nothing."""
    assumed = np.array(robot.drives.sources("rotor_inertia")) == "assumed"
    if not assumed.any():
        return ()
    rotor = np.where(assumed, CORNER_ROTORS, 1.0) * robot.armature
    gears = Gears(rotor, _stiffness(robot)[-1], CORNER_DAMPING, current, "motor")
    return tuple(geared.Case(q, ArmLoop(robot, q, gears, dt, late), False) for q in places)


def _rest_zone(least: float, counts: Array | None) -> float:
    """Return the error that is not integrated at rest [rad or m]: above what encoders cannot tell."""
    if counts is None:
        return least
    return min(max(least, REST_COUNTS * float(np.max(counts))), LATE_REST_ZONE)


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
        if delay < COMPARED:
            return cls(LINK_FACTOR, ROTOR_FACTOR, PROPORTIONAL, INTEGRAL, REST_ZONE)
        late = (LATE_LINK_FACTOR, LATE_ROTOR_FACTOR, LATE_PROPORTIONAL, LATE_INTEGRAL)
        return cls(*late, LATE_REST_ZONE)


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
        return np.asarray(feedback @ (counts * w * f / (1.0 + 0.5 * dt * f)) / effort)

    least = np.minimum(f, np.maximum(LOWEST_FILTER, LEAST_FILTER_RATIO * w))
    lowered = f
    for share in np.linspace(1.0, 0.0, 21):
        lowered = least + share * (f - least)
        if (torque(w, lowered) <= COUNT_SHARE).all():
            return w, lowered
    noise = torque(w, lowered)
    # Each joint's torque hears the counts of all others: those that are too loud are all slower.
    loudest = np.max(np.where(feedback > 0.0, (noise / COUNT_SHARE)[:, None], 0.0), axis=0)
    return w / np.maximum(loudest, 1.0), lowered


def _loops(robot: Robot, dt: float, late: int, current: float, damping: float) -> tuple[geared.Case, ...]:
    """Return the arm at some configurations, at the ends of what is known of the stiffness."""
    tried = _TRIED if delay_of(dt, late, current) < COMPARED else _LATE_TRIED
    places = (robot.middle(), *random_configurations(robot, tried - 1, seed=1))
    cases = []
    for q, each in itertools.product(places, _stiffness(robot)):
        gears = Gears(robot.armature, each, damping, current, "motor")
        cases.append(geared.Case(q, ArmLoop(robot, q, gears, dt, late), False))
    return tuple(cases)


def _stiffness(robot: Robot) -> list[Array]:
    """Return the least, the usual and the largest stiffness that joints may have [N m/rad or N/m], (n,)."""
    stiffness = robot.drives.value("stiffness")
    low, high = robot.drives.interval("stiffness")
    assumed = np.array(robot.drives.sources("stiffness")) == "assumed"
    return [
        np.where(assumed | (low == high), factor * stiffness, end)
        for factor, end in zip(STIFFNESS_FACTORS, (low, stiffness, high), strict=True)
    ]
