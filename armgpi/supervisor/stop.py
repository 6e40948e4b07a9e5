"""How a supervised arm is stopped: along a reference that decelerates, or by a torque in open loop."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armgpi.base.arrays import Array
from armgpi.control.controller import Controller
from armgpi.references.reference import Target
from armgpi.supervisor.bounds import (
    COUNTS,
    SMOOTHING,
    Bounds,
    Supervisor,
    model_of,
    own_inverse_inertia,
    smoothing,
)
from armgpi.supervisor.joints import Mask, any_joint, largest
from armgpi.supervisor.state import Reason, Sample, State, Watch

#: A stop begins at the reference where the joint is as near to it as this [rad or m], else at the joint.
#: Set by hand: a tenth of what FOLLOWING allows.
NEAR = 0.05
#: Rate at which FAULT damps a joint that still measures well, alone [1/s]. Set by hand.
_DAMPING = 60.0
#: Largest product of that rate with the sample time [-]: damping of one joint by its last velocity is stable
#: up to 2.
_DAMPED_AT_ONCE = 0.3
#: The rate of a joint with a rotor, which may be elastic [1/s]: slow for resonances from 10 Hz on, whichever
#: side the encoder is at (tools/gears.py --stops measures what rests).
_SOFT_DAMPING = 8.0
#: Time constant of the velocity of such a joint [s].
_SOFT_SMOOTHING = 0.02
#: Velocity below which a joint rests [rad/s or m/s]. Set by hand.
_REST = 0.1
#: An arm that moves is not HOLD for so long at least [s]. Set by hand.
_RESTED = 0.01
#: A sample at rest takes away so many samples of motion [-]. Set by hand.
_AT_REST = 4.0
#: An arm whose reference rests, and that moves for so long, swings [s]; so does one that goes past its
#: reference, to and fro, as far as FOLLOWING allows. Set by hand.
_SWINGING = 2.0


class Stop:
    """The reference of a stop, and what FAULT does in place of the law.

    Attributes:
        bounds: all bounds.
        damping: torque per velocity by which FAULT damps a joint alone [N m s].
        soft: the same where a joint may be elastic [N m s].
        smoothing: of velocities then.
        rest: velocity below which a joint rests [rad or m per sample]: two counts more, as they are smoothed.
        rested: samples for which an arm that moves is not HOLD, at least.
    """

    def __init__(self, law: Controller, given: Supervisor, bounds: Bounds) -> None:
        """Work out what a stop needs in every sample.

        Args:
            law: the controller that is supervised.
            given: what the supervisor was asked for.
            bounds: its bounds, as the checks have them.
        """
        self.bounds, self._dt, self._on_fault = bounds, law.dt, given.on_fault
        self._touches = given.tool_force is not None
        # Whether a deceleration has to build up, as torques have a rate or joints may be elastic.
        self._rated = bool((bounds.jerk < bounds.slowing).any())
        inertia = 1.0 / own_inverse_inertia(law)  # that a joint has for a torque of its own
        may_be_elastic = model_of(law).armature > 0.0
        rate = min(_DAMPING, _DAMPED_AT_ONCE / law.dt)
        soft_rate = np.where(may_be_elastic, min(rate, _SOFT_DAMPING), rate)
        self.damping = np.asarray(rate * inertia)
        self.soft = np.asarray(soft_rate * inertia)
        slow, fast = smoothing(law.dt, _SOFT_SMOOTHING), smoothing(law.dt, SMOOTHING)
        self.smoothing = np.where(may_be_elastic, slow, fast)
        self._lag = np.where(may_be_elastic, _SOFT_SMOOTHING, 0.0)
        count = bounds.travel / COUNTS  # of the encoder [rad or m]
        # Two counts in a sample are noise of an arm at rest; the smoothed velocity has a part of them.
        self.rest = law.dt * _REST + 2.0 * fast * count
        self.rested = float(math.ceil(_RESTED / law.dt))  # samples
        self._longest = float(math.ceil(_SWINGING / law.dt))  # samples
        self._share = 1.0 / bounds.following

    def restless(self, watch: Watch) -> tuple[Array, Array, Mask]:
        """Return `restless` and `travel` of :class:`Watch` now, and whether the arm swings, each (1,)."""
        speed = np.abs(watch.v)
        counted = np.where(any_joint(watch.rv != 0.0), 0.0, 1.0)  # none counts before the reference rests
        holds = watch.status == float(State.HOLD)
        hysteresis = 1.0 + np.where(holds, 1.0, 0.0)  # HOLD does not flicker
        moves = any_joint(speed > hysteresis * self.rest)
        more_restless = np.maximum(watch.restless + counted, self.rested)
        less_restless = np.maximum(watch.restless - _AT_REST * counted, 0.0)
        after = np.where(moves, more_restless, less_restless)
        # The law may be what swings: how a joint goes past the reference tells before that rests.
        past = np.abs(watch.v - watch.rv)
        past = np.where(past > self.rest, past * self._share, 0.0)
        gone = watch.travel + largest(past)
        travel = np.where(after > 0.0, gone, 0.0)
        swings = (after > self._longest) | (travel > 1.0)
        return after, travel, swings

    def reference(
        self, seen: Sample, entering: Mask, stopping: Mask, target: Target, watch: Watch
    ) -> tuple[Target, Array]:
        """Return the reference to follow, the one given or that of a stop, and its way in a sample.

        Args:
            seen: the sample.
            entering: whether a stop begins, (1,) or (batch, 1).
            stopping: whether one begins or goes on, likewise.
            target: the reference given.
            watch: what is kept.
        """
        # Where the joint did not follow, or nobody looked, the stop begins where it is, and as fast as it is.
        late = (watch.late > 0.0) & ~seen.lost
        apart = entering & ((np.abs(seen.e) > NEAR) | late)
        if self._touches:  # what is behind a wall is no place to stop at
            pressed = seen.worst == float(Reason.TOOL_FORCE)
            apart = apart | (entering & pressed)
        begin = np.where(apart, seen.q, watch.r)
        v = np.where(apart, self._own_velocity(late, seen, watch), watch.rv)
        v = np.minimum(np.maximum(v, -self.bounds.stop_velocity), self.bounds.stop_velocity)
        most = self.deceleration(v, watch.since)
        slowed = np.minimum(np.maximum(v, -most), most)
        # A joint that does not follow the stop tells nothing of where it goes: it comes to rest there.
        unfinished = watch.status < float(State.FAULT)
        strays = stopping & ~entering & seen.failing & unfinished
        after = np.where(strays, 0.0, v - slowed)
        way = np.where(stopping, after, target.q - watch.r)
        q = np.where(stopping, begin + 0.5 * (v + after), target.q)
        acceleration = np.where(stopping, slowed * (-1.0 / self._dt**2), 0.0)
        return Target(q, way * (1.0 / self._dt), acceleration), way

    @staticmethod
    def _own_velocity(late: Mask, seen: Sample, watch: Watch) -> Array:
        """Return the velocity of a joint [rad or m per sample]; after a gap, if it changed evenly there.

        Args:
            late: whether a gap ends with this sample, (1,) or (batch, 1).
            seen: the sample.
            watch: what is kept.
        """
        missed = np.maximum(watch.bad[..., :1], 0.0)
        twice_share = 2.0 / (1.0 + missed)
        after_gap = (seen.q - watch.q) * twice_share - watch.v
        return np.where(late, after_gap, watch.v)

    def deceleration(self, v: Array, since: Array) -> Array:
        """Return by how much a stop slows down in a sample, at most [rad or m per sample].

        Where torques have a rate, or joints may be elastic, it builds up and goes no faster than they can.

        Args:
            v: velocities [rad or m per sample].
            since: samples since the stop began.
        """
        jerk = self.bounds.jerk
        if not self._rated:
            return self.bounds.slowing
        # Steps of `jerk` from here down to rest add up to v.
        ending = np.sqrt(0.25 * jerk * jerk + 2.0 * jerk * np.abs(v)) - 0.5 * jerk
        beginning = jerk * (1.0 + since)
        return np.minimum(np.minimum(self.bounds.slowing, ending), beginning)

    def open_loop(
        self,
        opened: Mask,
        dead: Mask,
        turned: Mask,
        accused: Mask,
        seen: Sample,
        v: Array,
        aim: Target,
        watch: Watch,
    ) -> tuple[Array, tuple[Any, ...]]:
        """Return torque without a measurement that the law could use, and a motion that takes more.

        The motion is given as whether a torque is asked for, position, velocity and acceleration.

        Args:
            opened: whether the loop is open, (1,) or (batch, 1).
            dead: whether for good, likewise.
            turned: which joints answer their torque the wrong way.
            accused: whether a motor is still taken to turn the other way, (1,) or (batch, 1).
            seen: the sample.
            v: velocities, smoothed [rad or m per sample].
            aim: the reference that decelerates.
            watch: what is kept.
        """
        on = np.where(opened, watch.ready, 0.0)
        torque = np.zeros_like(v)
        if self._on_fault == "zero":
            on = np.where(dead, 0.0, on)
        elif self._on_fault == "hold":
            aim = _held(dead, watch.q, dead, aim)
        else:
            damped = dead & ~seen.distrusted
            # A motor that turns the other way makes other joints fast, too: a stop from there would be long.
            rests = damped & any_joint(turned)
            aim = _held(damped, seen.q, rests, aim)
            damping = np.where(accused, self.damping, self.soft)
            late = aim.v - self._lag * aim.a  # as what is smoothed
            undone = self._undone(dead, seen, watch)
            too_slow = late - v * (1.0 / self._dt)
            torque = np.where(damped, damping * too_slow, undone)
        return torque, (on, *aim)

    def _undone(self, dead: Mask, seen: Sample, watch: Watch) -> Array:
        """Return the torque that takes back what the law asked of a joint whose encoder froze [N m or N].

        It took the joint for one that had stopped, and pushed it on for a sample, before that was found: the
        same torque the other way leaves the joint the velocity that it had. Once, as FAULT begins.
        """
        begins = watch.status < float(State.FAULT)
        measured = seen.bad == 0.0
        froze = dead & begins & seen.distrusted & measured
        return np.where(froze, watch.frozen.torque_at_change - watch.tau, 0.0)


def _held(placed: Mask, place: Array, resting: Mask, aim: Target) -> Target:
    """Return a reference that is at a place for some joints, and at rest for some."""
    q = np.where(placed, place, aim.q)
    v = np.where(resting, 0.0, aim.v)
    a = np.where(resting, 0.0, aim.a)
    return Target(q, v, a)
