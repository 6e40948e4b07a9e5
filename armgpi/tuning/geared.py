"""How fast a law may be on elastic joints: two-mass loops at the ends of what is known of them."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np

from armgpi.base.arrays import Array
from armgpi.control.elastic_limits import halved
from armgpi.control.linear_arm import Law, gravity_stiffness
from armgpi.gpi.family import Member
from armgpi.gpi.gains import Tuning
from armgpi.gpi.realisation import Bumpless
from armgpi.robot.kinematics import middle_and_random
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import SCATTER, assume_gears, lowest_mode
from armgpi.tuning.two_mass import CURRENT_LOOP, ArmLoop, Gears, around, damping_at_one, joint_laws
from armgpi.tuning.two_mass import law as law_at

#: Largest sensitivity peak where the stiffness is told, and what is tried where none is as low. Where the
#: stiffness is believed, or none of these can be had: which share of the fastest stable bandwidth is taken,
#: and of that of joints that are faster than the weakest: at 0.85 late loops lose so101 (fit).
SENSITIVITIES, STABLE_SHARE, RAISED_SHARE = (2.5, 4.0, 6.3), 0.85, 0.7
#: Largest sensitivity peak at which gears are as good as rigid ones, or over that of rigid ones.
RIGID_SENSITIVITY, AS_RIGID = 3.0, 1.1
#: How far a specified stiffness may be off either way. Damping ratios of which nothing is known, 1 to 5 %
#: being usual: loops are judged at the first, and stable at the second.
STIFFNESS_OFF, DAMPINGS = 0.3, (0.03, 0.01)
#: Where that leaves a loop less than this [rad/s], it has to be stable at the damping at which it is judged:
#: slower ones lose more arms to gravity and friction than light damping does (tools/reality.py, fit arms).
LATE = 5.0
#: And no loop with believed gears and encoders at motors is slower [rad/s]: at 2 to 3 the arm falls under a
#: load (tools/reality.py, fit arms), while gears as stiff as may be behind rotors as light are rare. Nor does
#: the noise of coarse encoders make a joint slower.
SLOWEST = 4.5
#: Lowest resonance of believed gears behind encoders at the link, whose loops soft gears lose [Hz].
SOFTEST = 5.0
#: Bandwidths that are tried end here [rad/s]; one is below the one before by a factor, and the last interval
#: is halved so many times.
_SLOWEST, _STEP, _HALVINGS = 2.0, 1.25, 3
#: Then joints are raised one by one, by each of these factors that all loops tolerate: some 3 times lessen an
#: error by 11, and more only makes wrists noisier.
_RAISES = (2.0, 2.0**0.5, 2.0**0.25)
#: Stiffness over rotor inertia of a joint without a rotor, which has no gear [1/s^2]: 500 Hz.
_RIGID = (1000.0 * math.pi) ** 2
#: Configurations, the middle the first, and a rotor at least, as a share of the joint's own link inertia.
CONFIGURATIONS, _LEAST_ROTOR = 4, 0.01

_Found = TypeVar("_Found", float, Array)


class Case(NamedTuple):
    """An arm at a configuration, with its gears as they may be.

    Attributes:
        q: configuration [rad or m], (n,).
        arm: the plant, sampled and late.
        judged: whether its sensitivity counts; else it has to be stable.
        damping: ratio of the gears [-]; NaN where theirs is known, or they are rigid.
    """

    q: Array
    arm: ArmLoop
    judged: bool
    damping: float = math.nan


def is_known(robot: Robot) -> bool:
    """Tell whether something is known of the stiffness of an arm's joints, or assumed."""
    return bool(robot.drives.data.get("stiffness"))


def is_assumed(robot: Robot) -> bool:
    """Tell whether the stiffness of some joint is assumed."""
    return "assumed" in robot.drives.sources("stiffness")


def at_link(robot: Robot) -> bool:
    """Tell whether all encoders are specified to be at the link; at the motor is usual."""
    return bool((robot.drives.value("encoder_side") == "link").all())


@lru_cache(maxsize=16)
def cases(robot: Robot, dt: float, late: int, damping: float = DAMPINGS[1]) -> tuple[Case, ...]:
    """Return an arm at some configurations with its gears at the ends of what is known of them.

    Args:
        robot: with some stiffness in its drives; that of the other joints is assumed.
        dt: sample time [s].
        late: samples by which measurements are late.
        damping: ratio at which loops have to be stable where nothing is known of it.
    """
    robot = assume_gears(robot)
    drives = robot.drives
    current = float(np.min(drives.value("current_bandwidth", CURRENT_LOOP)))
    known_damping = drives.value("damping")
    is_damping_unknown = bool(np.isnan(known_damping).any())
    # Loops are judged at the first damping ratio, and have to be stable at the second.
    ratios = (DAMPINGS[0], damping) if is_damping_unknown else DAMPINGS[:1]
    rotors = _rotor_ends(robot)
    stiffness_ends = _stiffness_ends(robot)
    sides = _sides(robot)
    listed = []
    for q in _configurations(robot):
        link = robot.mass_matrix(q) - np.diag(robot.armature)
        for weight, rotor in enumerate(rotors):
            for stiffness in stiffness_ends:
                gears = Gears(rotor, _fill_unknown(stiffness, rotor), current=current)
                known_ratio = known_damping / damping_at_one(link, gears)
                for side, (place, ratio) in itertools.product(sides, enumerate(ratios)):
                    damped = np.where(np.isnan(known_damping), ratio, known_ratio)
                    loop = ArmLoop(robot, q, gears._replace(damping=damped, side=side), dt, late)
                    is_judged = weight == place == 0
                    listed.append(Case(q, loop, is_judged, ratio if is_damping_unknown else math.nan))
    return tuple(listed)


def _stiffness_ends(robot: Robot) -> list[Array]:
    """Return the joint stiffness at the ends of what is known of it [N m/rad or N/m], (n,) each.

    Of an arm whose stiffness is assumed the assumed one is between them, and the lower end of one with
    encoders at the links is as soft as its lowest resonance allows.
    """
    value = robot.drives.value("stiffness")
    low, high = robot.drives.interval("stiffness")
    is_exact = low == high
    lower = np.where(is_exact, (1.0 - STIFFNESS_OFF) * value, low)
    upper = np.where(is_exact, (1.0 + STIFFNESS_OFF) * value, high)
    if not is_assumed(robot):
        return [lower, upper]
    softer = 1.0
    if at_link(robot):
        softer = min(1.0, (SOFTEST / resonance(robot)) ** 2)
    return [np.minimum(lower, softer * value), value, upper]


def _sides(robot: Robot) -> list[Array]:
    """Return where the encoders may sit, (n,) each: both sides where one is not known."""
    side = robot.drives.value("encoder_side")
    is_unknown = side == ""
    if not is_unknown.any():
        return [side]
    return [np.where(is_unknown, other, side) for other in ("motor", "link")]


def _rotor_ends(robot: Robot) -> list[Array]:
    """Return the expected rotor inertias [kg m^2 or kg], (n,), and lighter ones where they may be lighter."""
    rotor = _rotor(robot)
    least, _ = robot.drives.interval("rotor_inertia")
    # An interval down to zero tells no lightest rotor: then that of an assumed one.
    least = np.where(least > 0.0, least, (1.0 / SCATTER) * rotor)
    is_lighter = least < rotor
    if not is_lighter.any():
        return [rotor]
    return [rotor, np.where(is_lighter, np.sqrt(least * rotor), rotor)]


def resonance(robot: Robot) -> float:
    """Return the lowest resonance of an arm with free motors in the middle [Hz]; stiffness may be assumed."""
    soft = assume_gears(robot)
    rotor = _rotor(soft)
    stiffness = _fill_unknown(soft.drives.value("stiffness"), rotor)
    links = soft.mass_matrix(soft.middle()) - np.diag(soft.armature)
    return lowest_mode(links, rotor, stiffness)


def _configurations(robot: Robot) -> Array:
    """Return the configurations that are looked at, (CONFIGURATIONS, n)."""
    return middle_and_random(robot, CONFIGURATIONS, seed=1)


def _rotor(robot: Robot) -> Array:
    """Return the rotors of an arm, none so light that nothing twists [kg m^2 or kg], (n,)."""
    inertia = np.diag(robot.mass_matrix(robot.middle()))
    links = inertia - robot.armature
    return np.maximum(robot.armature, _LEAST_ROTOR * links)


def _fill_unknown(stiffness: Array, rotor: Array) -> Array:
    """Return stiffness, that of a gear that hardly twists where none is known [N m/rad or N/m], (n,)."""
    return np.where(np.isnan(stiffness), _RIGID * rotor, stiffness)


def rigid_cases(robot: Robot, dt: float, late: int) -> tuple[Case, ...]:
    """Return an arm at the same configurations with rigid gears; arguments as :func:`cases`."""
    gears = Gears(robot.armature, current=CURRENT_LOOP)
    listed = []
    for q in _configurations(robot):
        loop = ArmLoop(robot, q, gears, dt, late)
        listed.append(Case(q, loop, judged=True))
    return tuple(listed)


def borne(law: Any, robot: Robot, late: int) -> tuple[float, float]:
    """Return the lowest resonance that a law tolerates with Ms of at most 3, and that of assumed joints [Hz].

    Encoders are at the motors, all gears of the believed stiffness times one factor, at the damping at which
    loops are judged; resonances are those in the middle.

    Args:
        law: a GPI with fixed gains.
        robot: the arm, without a word of its gears.
        late: samples by which measurements are late.
    """
    soft = assume_gears(robot)
    rotor = _rotor(soft)
    stiffness = _fill_unknown(soft.drives.value("stiffness"), rotor)
    laws = [(q, law_at(law, q)) for q in _configurations(robot)]

    def is_tolerated(factor: float) -> bool:
        gears = Gears(rotor, factor * stiffness, DAMPINGS[0], CURRENT_LOOP)
        for q, at_place in laws:
            arm = ArmLoop(robot, q, gears, law.dt, late)
            if not arm.sensitivity(at_place) <= RIGID_SENSITIVITY:
                return False
        return True

    exponents = np.linspace(-1.0, 4.0, 21)
    lowest = bisect.bisect_left(exponents.tolist(), True, key=lambda power: is_tolerated(10.0**power))
    usual = resonance(robot)
    if lowest == len(exponents):
        return math.inf, usual
    # A resonance grows with the root of the stiffness.
    return usual * 10.0 ** (0.5 * exponents[lowest]), usual


class _Closed(NamedTuple):
    """A loop: a case, and inertia and dG/dq of the law that closes it there."""

    case: Case
    inertia: Array
    steep: Array | None

    def under(self, own: Law) -> Law:
        """Return the law of torques there, of one of accelerations."""
        return around(own, self.inertia, self.steep)

    def holds(self, own: Law, most: float) -> bool:
        """Tell whether it is stable, and where it is judged no more sensitive than `most`."""
        law = self.under(own)
        if self.case.judged and most < math.inf:
            return self.case.arm.sensitivity(law) <= most
        return self.case.arm.growth(law) < 1.0

    def sensitivity(self, own: Law) -> float:
        """Return its sensitivity peak [-]."""
        return self.case.arm.sensitivity(self.under(own))


class Loops:
    """The loops of an arm's cases under the laws of one nominal model, as fast as one wants.

    Attributes:
        joints: how many there are.
    """

    def __init__(
        self,
        cases: Sequence[Case],
        nominal: Robot,
        bias: Robot | None,
        member: Member,
        dt: float,
        zeta: float | Array = 1.0,
    ) -> None:
        """Work out what the laws have in common.

        Args:
            cases: of the arm.
            nominal: model of the feedback.
            bias: model of a feedforward that is taken at the measured position; None for another one.
            member: of the family.
            dt: sample time [s].
            zeta: damping ratio of the first pair of poles [-], a number or (n,).
        """
        self.joints = nominal.n
        self._realisation = Bumpless(member)
        self._dt = dt
        self._zeta = zeta * np.ones(nominal.n)
        # Those that refused some bandwidth so far, which most likely refuse the next one as well; the others.
        self._critical: list[_Closed] = []
        self._others: list[_Closed] = []
        places: dict[int, tuple[Array, Array | None]] = {}  # worked out once for all cases at the same place
        for case in cases:
            place = id(case.q)
            if place not in places:
                steep = None if bias is None else gravity_stiffness(bias, case.q)
                places[place] = nominal.mass_matrix(case.q), steep
            self._others.append(_Closed(case, *places[place]))

    def holds(self, omega: float | Array, most: float = math.inf) -> bool:
        """Tell whether all loops are stable, with a sensitivity peak of at most `most`.

        The first loop that refuses is from now on among those that :meth:`may_hold` asks.
        """
        if not self.may_hold(omega, most):
            return False
        law = self._law(omega)
        for i, loop in enumerate(self._others):
            if not loop.holds(law, most):
                self._critical.append(self._others.pop(i))
                return False
        return True

    def may_hold(self, omega: float | Array, most: float = math.inf) -> bool:
        """Tell whether the loops hold that refused something so far: a few of all."""
        law = self._law(omega)
        return all(loop.holds(law, most) for loop in self._critical)

    def settle(self, find: Callable[[], _Found], most: float = math.inf) -> _Found:
        """Return what a search by :meth:`may_hold` finds once all loops hold there.

        Where another one does not it refuses from now on, and the search begins anew. What is zero or refused
        already was found for want of something better.
        """
        while True:
            bandwidths = find()
            refused = len(self._critical)
            if not np.all(bandwidths) or self.holds(bandwidths, most):
                return bandwidths
            if len(self._critical) == refused:  # refused by a loop that had refused before
                return bandwidths

    def swinging(self, omega: float | Array) -> Array:
        """Return which joints swing in some unstable loop, (n,) of bool; none where all are stable."""
        law = self._law(omega)
        swings = np.zeros(self.joints, dtype=bool)
        for loop in (*self._critical, *self._others):
            swings |= loop.case.arm.swinging(loop.under(law))
        return swings

    def sensitivity(self, omega: float | Array) -> float:
        """Return the largest sensitivity peak of all loops."""
        law = self._law(omega)
        return max(loop.sensitivity(law) for loop in (*self._critical, *self._others))

    def _law(self, omega: float | Array) -> Law:
        """Return the law of accelerations at a bandwidth [rad/s], a number or (n,)."""
        bandwidths = omega * np.ones(self.joints)
        tuning = Tuning(bandwidths, self._zeta, bandwidths)
        coefficients = self._realisation.coefficients(tuning, self._dt)
        return joint_laws(self._realisation, coefficients, self.joints)

    def fastest(self, highest: float, most: float = math.inf) -> float:
        """Return the largest bandwidth up to `highest` that all loops tolerate [rad/s]; zero for none."""

        def find() -> float:
            return _largest(lambda omega: self.may_hold(omega, most), highest)

        return self.settle(find, most)


def _largest(holds: Callable[[float], bool], highest: float) -> float:
    """Return about the largest number for which something holds, from above; zero for none."""
    omega = highest
    if holds(omega):
        return omega
    while omega > _SLOWEST:
        above, omega = omega, omega / _STEP
        if holds(omega):
            return halved(omega, above, holds, _HALVINGS)
    return 0.0


class Alike(NamedTuple):
    """How fast the joints of a law may be when all are as fast as each other.

    Attributes:
        fastest: bandwidth that all loops just tolerate [rad/s].
        most: largest sensitivity peak with it [-]; infinite where the loops are no more than stable.
    """

    fastest: float
    most: float

    @property
    def shares(self) -> tuple[float, float]:
        """What is taken of the fastest bandwidth, and of those of joints that are raised above it [-]."""
        return (1.0, 1.0) if self.most < math.inf else (STABLE_SHARE, RAISED_SHARE)

    @property
    def omega(self) -> float:
        """The bandwidth that is taken [rad/s]."""
        return self.shares[0] * self.fastest


def bandwidth(loops: Loops, highest: float, believed: bool) -> Alike:
    """Return how fast the joints of a law may be, all alike.

    Args:
        loops: of the arm under the law.
        highest: what else allows [rad/s].
        believed: whether the stiffness is: then a share of the fastest stable bandwidth is taken.
    """
    for most in () if believed else SENSITIVITIES:
        if omega := loops.fastest(highest, most):
            return Alike(omega, most)
    return Alike(loops.fastest(highest / STABLE_SHARE) or _SLOWEST / STABLE_SHARE, math.inf)


def raise_joints(alike: Alike, loops: Loops, highest: float) -> Array:
    """Return bandwidths raised joint by joint from the tip, as far as all loops tolerate it [rad/s], (n,).

    The weakest joint limits what all bear alike; wrists bear several times that.
    """
    share, of_raised = alike.shares

    def raise_all() -> Array:
        raised = alike.fastest * np.ones(loops.joints)
        from_tip = reversed(range(loops.joints))
        for joint, factor in itertools.product(from_tip, _RAISES):
            faster = raised.copy()
            faster[joint] = min(factor * raised[joint], highest / share)
            if faster[joint] > raised[joint] and loops.may_hold(faster, alike.most):
                raised = faster
        return raised

    raised = loops.settle(raise_all, alike.most)
    return np.maximum(alike.omega, of_raised * raised)
