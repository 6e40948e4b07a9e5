"""How stiff springs may be on elastic joints: from the eigenvalues of the sampled loop.

Between motor and link a joint is a spring of its own, so the controller may drive a resonance that it does
not know. Which stiffness is too much follows from no single resonance: the inertia and the springs of the
tool couple those of the joints. So the whole loop is worked out, in some configurations: the arm with motors
and links, encoders on their side, filter, delay and hold. It is linear but for changes of configuration.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.control.bandwidth import FilteredDifference
from armgpi.control.linear_arm import Law, LinearArm, Sampled, closed, critical_damping, measured, sampled

#: Damping ratio of a gear whose damping is not known [-].
GEAR_DAMPING = 0.01
#: Least share of a joint's inertia that is its link's.
LEAST_LINK = 0.05
#: What is allowed is this part of the stiffness at which the loop is no longer stable [-]: of configurations
#: that were not looked at, some are worse.
_SHARE = 0.6
#: Eigenvalues up to here count as stable: that of a motion without a spring is 1, but for rounding.
_STABLE = 1.0 + 1e-6
#: Ratio of the factors that are tried one after another, from 1 on.
_STEP = 2.0
#: Halvings of such a step, to a part of 1.1e-2 of the factor.
_HALVINGS = 6
#: Smallest factor that is tried [-].
_SMALLEST = 1e-3
#: So many configurations, the worst ones, join those in which factors are tried first.
_WORST = 3
#: How often they may: then all configurations are tried at every factor.
_ROUNDS = 4
#: Natural frequency of a motor on its spring beyond which the joint is stiff [rad/s]: 16 kHz, which no drive
#: has; far beyond it rounding hides the motion of the arm.
_STIFF = 1e5
#: A delay of more samples than these is looked at as these of a longer sample, with the same delay in all:
#: the largest stiffness of UR5 and Panda at 5 to 15 ms differs by up to 3 %, and takes a tenth of the time.
_LATEST = 4
#: By how much rotors are lightened until links have an inertia, where the model has none of them [-].
_LIGHTER = 0.8

#: Configurations by their places.
Places = npt.NDArray[np.intp]


class Springs(NamedTuple):
    """A controller of springs in one configuration.

    Attributes:
        inertia: D with the rotors [kg m^2 or kg], (n, n).
        stiffness: of the springs at the joints, J' K J [N m/rad or N/m], (n, n).
        posture: stiffness beside it that does not change with it, likewise.
    """

    inertia: Array
    stiffness: Array
    posture: Array


class Damping(NamedTuple):
    """What damps the springs: alpha [1/s] times D, beta [s] times K, of a filtered difference [rad/s]."""

    alpha: float
    beta: float
    bandwidth: float


def elastic_joints(drives: Any) -> npt.NDArray[np.bool_]:
    """Tell which joints are elastic, (n,): a motor with an inertia moves its link through a spring.

    A joint is stiff where its stiffness or its rotor is not known, where the rotor has no inertia (the motor
    then has no motion of its own), and where the motor on the spring is faster than any drive.

    Args:
        drives: of the arm.
    """
    gear, rotor = drives.value("stiffness"), drives.value("rotor_inertia")
    known = np.isfinite(gear) & np.isfinite(rotor) & (rotor > 0.0)
    with np.errstate(over="ignore", invalid="ignore"):  # NaN compares as not known
        slow = gear < _STIFF**2 * rotor
    return np.asarray(known & slow)


class ElasticLoop:
    """The sampled loop of springs on elastic joints, in some configurations.

    Attributes:
        unsure: whether nothing tells on which side an encoder is, (n,).
        at_link: which encoders sit at links, (n,).
    """

    def __init__(self, springs: Sequence[Springs], drives: Any, dt: float, delay: float) -> None:
        """Work out what the arm does in a sample.

        Args:
            springs: in some configurations.
            drives: of the arm; the stiffness of one joint is known at least.
            dt: sample time [s].
            delay: transport delay besides the sample and hold [s].
        """
        late = max(0, math.ceil(delay / dt - 1e-9))
        self._late = min(late, _LATEST)
        self._dt = dt * (late + 0.5) / (self._late + 0.5)
        gear = drives.value("stiffness")
        rotor = drives.value("rotor_inertia")
        elastic = elastic_joints(drives)
        self._elastic = np.flatnonzero(elastic)
        side = np.asarray(drives.value("encoder_side"))
        self.at_link, self.unsure = elastic & (side == "link"), elastic & (side == "")
        self._inertia, self._stiffness, self._posture = (
            np.array(parts) for parts in zip(*springs, strict=True)
        )
        damping = drives.value("damping")[elastic]
        transitions, inputs = [], []
        for inertia in self._inertia:
            arm = self._linear(inertia, gear[elastic], rotor[elastic], damping)
            transition, entry, _ = sampled(arm, self._dt, ~self.at_link)
            transitions.append(transition)
            inputs.append(entry)
        self._transition, self._input = np.array(transitions), np.array(inputs)
        self._suspects: Places | None = None

    @classmethod
    def of(cls, springs: Sequence[Springs], drives: Any, dt: float, delay: float) -> ElasticLoop | None:
        """Return the loop; None where the stiffness of no joint is known. Arguments as of the constructor."""
        if drives is None or not elastic_joints(drives).any():
            return None
        return cls(springs, drives, dt, delay)

    def _linear(self, inertia: Array, gear: Array, rotor: Array, damping: Array) -> LinearArm:
        """Return the arm of links and motors in one configuration, without gravity and current loop.

        Args:
            inertia: D with the rotors [kg m^2 or kg], (n, n).
            gear: stiffness of the elastic joints [N m/rad or N/m], (m,).
            rotor: their inertia, (m,).
            damping: of the elastic joints [N m s/rad or N s/m], NaN where it is not known, (m,).
        """
        n = len(inertia)
        own = np.diag(inertia)[self._elastic]
        motors = np.minimum(rotor, (1.0 - LEAST_LINK) * own)
        chosen = np.eye(n)[:, self._elastic]
        links = inertia - chosen @ np.diag(motors) @ chosen.T
        while np.linalg.eigvalsh(links)[0] <= 0.0:
            motors = _LIGHTER * motors
            links = inertia - chosen @ np.diag(motors) @ chosen.T
        usual = GEAR_DAMPING * critical_damping(own - motors, motors, gear)
        damping = np.where(np.isfinite(damping), damping, usual)
        return LinearArm(links, np.zeros((n, n)), self._elastic, motors, gear, damping, None)

    def with_posture(self, share: float) -> ElasticLoop:
        """Return the same loop with a share of the stiffness beside that of the springs."""
        other = copy.copy(self)
        other._posture = share * self._posture
        other._suspects = None
        return other

    def _radius(self, factor: float, damping: Damping, at_link: Array, where: Places) -> Array:
        """Return the largest modulus of the eigenvalues of the sampled loop, (configurations,).

        The state: positions and velocities of links and motors, one filter a joint, torques on their way.

        Args:
            factor: on the stiffness.
            damping: of the loop at factor 1.
            at_link: which encoders sit at links, (n,).
            where: which configurations.
        """
        root = math.sqrt(factor)
        springs = factor * self._stiffness[where]
        damper = damping.alpha * root * self._inertia[where] + damping.beta / root * springs
        law = self._law(springs + self._posture[where], damper, damping.bandwidth)
        at_motor = ~np.asarray(at_link, dtype=np.bool_)
        seen = measured(self._elastic, at_motor, self._transition.shape[-1])
        arm = Sampled(self._transition[where], self._input[where], seen)
        loop = closed(arm, law, self._late)
        return np.asarray(np.abs(np.linalg.eigvals(loop)).max(axis=1))

    def _law(self, spring: Array, damper: Array, bandwidth: float) -> Law:
        """Return springs and dampers as a controller of errors e, with one state x a joint.

        The filtered difference, rate = decay (last rate) + drive (e - last e), is rate = x + drive e with
        x' = decay x + (decay - 1) drive e.

        Args:
            spring: stiffness [N m/rad or N/m], (configurations, n, n).
            damper: damping [N m s/rad or N s/m], likewise.
            bandwidth: of the filtered difference [rad/s].
        """
        one = np.eye(spring.shape[-1])
        decay, drive = FilteredDifference.of(bandwidth, self._dt)
        return Law(decay * one, (decay - 1.0) * drive * one, -damper, -spring - drive * damper)

    def stable(self, factor: float, damping: Damping, at_link: Array) -> bool:
        """Tell whether a stiffness is allowed: first where others were not, then in all configurations.

        Args:
            factor: of the stiffness [-].
            damping: that belongs to a factor of 1.
            at_link: which encoders sit at links, (n,).
        """
        if self._suspects is not None and not self._stable_at(factor, damping, at_link, self._suspects):
            return False
        places = np.arange(len(self._transition))
        radius = self._radius(factor / _SHARE, damping, at_link, places)
        missed = bool((radius >= _STABLE).any())
        if missed:
            self._suspect(radius)
        return not missed

    def _stable_at(self, factor: float, damping: Damping, at_link: Array, where: Places) -> bool:
        """Tell whether a stiffness is allowed in some configurations."""
        return bool((self._radius(factor / _SHARE, damping, at_link, where) < _STABLE).all())

    def _suspect(self, radius: Array) -> Places:
        """Return the configurations to try first, with the worst of all by their radius among them."""
        worst = np.argsort(-radius)[:_WORST]
        before = worst if self._suspects is None else self._suspects
        self._suspects = np.union1d(before, worst)
        return self._suspects

    def factor(self, most: float, damping: Damping, at_link: Array, beyond: float = 0.0) -> float:
        """Return the largest factor of the stiffness that is allowed; 0 where less than a thousandth is.

        Args:
            most: no larger one is looked at.
            damping: that belongs to a factor of 1.
            at_link: which encoders sit at links, (n,).
            beyond: 0 is returned as well where no larger one than this is allowed.
        """
        if not most > beyond:
            return 0.0
        places = np.arange(len(self._transition))
        suspects = self._suspects
        if suspects is None:
            suspects = self._suspect(self._radius(most / _SHARE, damping, at_link, places))
        start = beyond if beyond > 0.0 else min(1.0, most)
        if beyond > 0.0 and not self._stable_at(start, damping, at_link, suspects):
            return 0.0
        for _ in range(_ROUNDS):
            found = self._up_to(start, most, damping, at_link, suspects)
            radius = self._radius(max(found, _SMALLEST) / _SHARE, damping, at_link, places)
            if found == 0.0 or (radius < _STABLE).all():
                return found
            suspects = self._suspect(radius)
            if beyond > 0.0 and not self._stable_at(start, damping, at_link, suspects):
                return 0.0
        return self._up_to(start, most, damping, at_link, places)

    def _up_to(self, start: float, most: float, damping: Damping, at_link: Array, where: Places) -> float:
        """Return the largest factor up to which some configurations are stable, from `start` on.

        Below it the first that is stable, from there down to a thousandth; 0 without one.
        """

        def holds(factor: float) -> bool:
            return self._stable_at(factor, damping, at_link, where)

        low = start
        if not holds(start):
            while not holds(low := low / _STEP):
                if low < _SMALLEST * start:
                    return 0.0
            return halved(low, _STEP * low, holds, _HALVINGS)
        while low < most:
            high = min(_STEP * low, most)
            if not holds(high):
                return halved(low, high, holds, _HALVINGS)
            low = high
        return most


def halved(low: float, high: float, holds: Callable[[float], bool], halvings: int) -> float:
    """Return the largest number that is found to hold, between one that does and one that does not.

    Args:
        low: holds, positive.
        high: does not hold.
        holds: tells whether a number does.
        halvings: how often the ratio of the two is halved, as a power.
    """
    for _ in range(halvings):
        middle = math.sqrt(low * high)
        if holds(middle):
            low = middle
        else:
            high = middle
    return low
