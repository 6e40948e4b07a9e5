"""The supervisor around a controller: it checks every sample, stops the arm under control, and holds it.

States: INIT (the torque ramps to the law's first one), RUN, STOPPING (the law follows a reference that
decelerates), HOLD (it has stopped, and is held by the law), FAULT (open loop: nothing is measured that can
be trusted, or the law does not get the arm to follow). Only a reset leads back.

It is elementwise, like a law: what NumPy runs here is what exported C does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.arrays import LARGEST, SMALLEST, Array, check_type, check_whole, new, per_joint, quantity
from armgpi.control.controller import Controller, ControlStep, FullState, Measurement
from armgpi.errors import ParameterError
from armgpi.parameter import Parametrised, PerJoint, parameter, parameters, with_parameters
from armgpi.references.reference import Target

#: What a rollout records of the supervisor: status, reason and joint of a fault, samples since then.
SIGNALS = ("supervisor", "supervisor_reason", "supervisor_joint", "supervisor_since")
#: Which joints, or rollouts (..., 1).
Mask = npt.NDArray[np.bool_]


class State(IntEnum):
    """What a supervised controller is in."""

    INIT = 0
    RUN = 1
    STOPPING = 2
    HOLD = 3
    FAULT = 4


class Reason(IntEnum):
    """Why it stops; of several in one sample the one with the highest number."""

    NONE = 0
    BEFORE_INIT = 1
    LATE = 2
    SATURATED = 3
    FOLLOWING = 4
    REFERENCE = 5
    POSITION = 6
    FROZEN = 7
    JUMP = 8
    NOT_FINITE = 9
    RESPONSE = 10


#: Positions beyond this are no measurements: sine and cosine would lose digits and time [rad or m].
FARTHEST = 1e4
#: Velocities and accelerations beyond this are none [rad/s, rad/s^2 or m].
_FASTEST = 1e6
#: A measurement that does not change for so long [s], while it should, is frozen.
_FROZEN_TIME = 0.05
#: Counts by which a reference has to move before a measurement has to.
_FROZEN_COUNTS = 16.0
#: Share of the reference's velocity above which a joint was in motion, and cannot stand still at once.
_IN_MOTION = 0.5
#: Time constant of the velocities from which a stop begins [s].
_SMOOTHING = 5e-3
#: A stop begins at the reference where the joint is as near to it as this [rad or m], else at the joint.
_NEAR = 0.05
#: Errors below this say nothing of how a joint answers its torque [rad or m].
_ALERT = 0.01
#: Samples in which a joint has to answer, at least: where there are few, laws are slow.
_ANSWERS = 8
#: Time in which torques and what answers them are forgotten: looked at is what changes faster [s].
_FORGOTTEN = 0.01
#: Changes of a torque that have to be answered, as a share of its limit.
_ASKED = 0.02
#: How much faster than when it was found a joint that answers the wrong way may be, and still get a torque.
_FASTER = 1.5
#: Resolution of positions where none is given: a turn, or the travel of a prismatic joint, in 2^16 counts.
_BITS = 16
#: Rate at which FAULT damps a joint that still measures well, alone [1/s]; and its largest product with dt.
_DAMPING, _DAMPED_AT_ONCE = 60.0, 0.3
#: Configurations in which inertias are looked at.
_POSES = 16
#: Standard deviations of noise that count as resolution.
_SIGMAS = 6.0
#: Samples since a fault are counted up to here, which single precision can.
COUNTED = 1e7


@with_parameters
class Supervisor(Parametrised):
    """What a supervisor takes for a fault, and how it stops the arm.

    A frozen sensor and an arm at rest both repeat one number. They differ in what was asked of the arm since
    the number last changed: the reference has moved on by 16 counts, or the torque is at its limit.
    """

    on_fault: str = parameter(
        "torque in FAULT: brake follows the decelerating reference by the nominal model and damps the joints "
        "that still measure well, hold carries the arm's weight at the last good position, zero",
        kind="choice",
        default="brake",
        choices=("brake", "hold", "zero"),
        structural=True,
    )
    deceleration: PerJoint = parameter(
        "deceleration of a stop",
        unit="rad/s^2 or m/s^2",
        default=10.0,
        least=0.0,
        above=True,
        per_joint=True,
    )
    stop_velocity: PerJoint = parameter(
        "velocity at which a stop begins, at most",
        unit="rad/s or m/s",
        default=None,
        none="the velocity limits",
        least=0.0,
        above=True,
        per_joint=True,
    )
    torque_rate: PerJoint = parameter(
        "highest rate of change of torque, in every state; the anti-windup knows of it",
        unit="N m/s or N/s",
        default=None,
        none="no limit",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
    )
    jump: float = parameter(
        "JUMP: samples of travel at the velocity limit by which a measurement may miss where its last "
        "change leads; one more than may get lost in a row; 0 for no check",
        default=2.0,
        least=0.0,
    )
    reference_jump: float = parameter(
        "REFERENCE: samples of travel at the velocity limit by which the reference may miss where its "
        "velocity leads; 0 for no check, nor of reference_step",
        default=2.0,
        least=0.0,
    )
    reference_step: float = parameter(
        "REFERENCE: for how long a step of the reference's velocity may take all the torque of a joint's "
        "motor; 0 for no bound",
        unit="s",
        default=0.01,
        least=0.0,
    )
    frozen_samples: int | None = parameter(
        "FROZEN: samples for which a measurement repeats itself that should change; 0 for no check",
        kind="integer",
        default=None,
        none="those of 0.05 s, and of the delay",
        least=0,
        most=2**20,
        key="frozen",
    )
    sticking: float = parameter(
        "FROZEN: share of its limit by which a joint's torque may change while friction holds it: twice the "
        "friction of its gear; 0 for a joint without any",
        default=0.1,
        least=0.0,
        most=1.0,
    )
    resolution: PerJoint = parameter(
        "a count: what positions may differ by without a motion",
        unit="rad or m",
        default=None,
        none="the encoder's, or a turn / 2^16",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
    )
    position_margin: PerJoint = parameter(
        "POSITION: how far beyond its limits a joint may be",
        unit="rad or m",
        default=0.1,
        least=0.0,
        per_joint=True,
    )
    following: PerJoint = parameter(
        "FOLLOWING: largest distance from the reference",
        unit="rad or m",
        default=0.5,
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
    )
    saturated: float = parameter(
        "SATURATED: how long a torque may be at its limit; shorter times add up, times below it count back; "
        "0 for no check",
        unit="s",
        default=0.5,
        least=0.0,
    )
    response: float = parameter(
        "RESPONSE: how long a joint may answer its torque the wrong way, running away from its reference; "
        "it brakes by its torque turned round then; 0 for no check",
        unit="s",
        default=0.012,
        least=0.0,
    )
    missed: int = parameter(
        "LATE: samples that may be missed in a row; after as many without a good measurement it is FAULT",
        kind="integer",
        default=20,
        least=0,
        most=1000,
    )


class Bounds(NamedTuple):
    """The numbers that a supervised controller compares with, each of shape (n,) or (batch, n).

    Attributes:
        jump: by how much a position may miss where its last change leads [rad or m].
        turn: a change in a sample of which a joint may turn round at once [rad or m].
        step: likewise the reference [rad or m].
        lower: lowest position [rad or m].
        upper: highest position [rad or m].
        following: largest distance from the reference [rad or m].
        travel: of the reference, which asks a position to change [rad or m].
        slowing: change of velocity in a sample of a stop [rad or m per sample].
        stop_velocity: at which a stop begins, at most [rad or m per sample].
        rate: change of torque in a sample, at most [N m or N].
    """

    jump: Array
    turn: Array
    step: Array
    lower: Array
    upper: Array
    following: Array
    travel: Array
    slowing: Array
    stop_velocity: Array
    rate: Array


class Watch(NamedTuple):
    """What the supervisor keeps.

    From `status` to `ready` they are of shape (1,) or (batch, 1), the others of (n,) or (batch, n).

    Attributes:
        status: number of its state.
        reason: number of the reason of a fault, 0 for none.
        joint: index of the joint that it concerns.
        since: samples since the fault.
        late: 1 when the measurement that comes is too late.
        ready: 1 when there was a good measurement.
        bad: samples in a row without a good measurement of the joint.
        q: last good measurement [rad or m].
        change: of it, in its sample, the last that was not zero and over no gap [rad or m].
        v: its velocity, smoothed [rad or m per sample].
        r: reference that is followed [rad or m].
        rv: its way in the last sample [rad or m].
        tau: last torque [N m or N].
        still: samples for which the measurement should have changed; :data:`COUNTED` of a joint that FAULT
            does not trust.
        mark: reference when the measurement last changed [rad or m].
        pull: torque when it was first asked to change, the last one where it is not [N m or N].
        cut: samples for which the torque was at its limit, before the last one.
        against: 1, and the samples for which the joint has answered its torque the wrong way, from where an
            error was worth a look; 0 elsewhere.
        asked: torque, smoothed like the velocity; this and the next two where `against` is not 0 [N m or N].
            In FAULT, of a joint that answers the wrong way, the velocity at which it gets none.
        asked_before: the same, smoothed again.
        answer_before: torque that the nominal model needs for the motion, likewise.
        calm: 1 when it is RUN and nothing is counted: the next sample may be a usual one, (1,) or (batch, 1).
    """

    status: Array
    reason: Array
    joint: Array
    since: Array
    late: Array
    ready: Array
    bad: Array
    q: Array
    change: Array
    v: Array
    r: Array
    rv: Array
    tau: Array
    still: Array
    mark: Array
    pull: Array
    cut: Array
    against: Array
    asked: Array
    asked_before: Array
    answer_before: Array
    calm: Array


class SupervisedState(NamedTuple):
    """State of a supervised controller.

    Attributes:
        supervisor: what the supervisor keeps.
        law: state of the controller in it.
    """

    supervisor: Watch
    law: Any


class FaultReport(NamedTuple):
    """What a supervised controller of one rollout says of itself.

    Attributes:
        status: "init", "run", "stopping", "hold" or "fault".
        reason: name of a :class:`Reason` in lower case; "none" without a fault.
        joint: name of the joint concerned, None without a fault.
    """

    status: str
    reason: str
    joint: str | None


class _Seen(NamedTuple):
    """What a sample looks like.

    Attributes:
        q: measured positions where they are good, the last good ones elsewhere.
        bad: see :class:`Watch`.
        lost: whether a measurement is not good, (1,).
        dead: whether one is frozen, or has not been good for too long, (1,).
        failing: whether a joint does not follow, or was at its torque limit for too long, (1,).
        worst: reason with the highest number, 0 for none, (1,).
        joint: first joint that it concerns, (1,).
        still: see :class:`Watch`.
        e: distance from the reference [rad or m].
        distrusted: which joints do not measure well.
    """

    q: Array
    bad: Array
    lost: Mask
    dead: Mask
    failing: Mask
    worst: Array
    joint: Array
    still: Array
    e: Array
    distrusted: Mask


class _Answer(NamedTuple):
    """How joints answer their torques: fields of :class:`Watch`."""

    against: Array
    asked: Array
    asked_before: Array
    answer_before: Array


class Supervised(Controller):
    """A controller under a supervisor: its torque is finite and within limits and rate, whatever comes.

    Attributes:
        law: the controller.
        supervisor: the bounds, as they were given.
        bounds: the same as numbers for this arm and sample time.
        frozen_samples: samples that make a measurement frozen, 0 for no check.
    """

    derived: ClassVar[Mapping[str, str]] = {
        **Controller.derived,
        "_damping": "torque per velocity by which FAULT damps a joint alone [N m s]",
        "_braked": "change in a sample of which friction may stop a joint at once [rad or m]",
        "_sticking": "change of torque that friction may hold a joint against [N m or N]",
        "_driven": "half of what all torques at their limits change of a motion in a sample [rad or m]",
        "_overpowered": "what half of its motor's torque changes of a joint's motion in a sample [rad or m]",
        "_pushed": "half of what a push by half its motor's torque does [rad or m]",
        "_share": "one over the torque limits [1/(N m) or 1/N]",
        "_sound": "torque below which none is cut [N m or N]",
    }

    def __init__(self, law: Controller, supervisor: Supervisor | None = None) -> None:
        """Put a controller under a supervisor.

        Args:
            law: the controller.
            supervisor: what it takes for a fault; as :class:`Supervisor` has it when not given.

        Raises:
            ParameterError: when the controller is none, or is supervised already.
            ArrayError: when a bound does not fit the joints.
        """
        check_type(law, "law", Controller, "a Controller")
        if isinstance(law, Supervised):
            raise ParameterError("law", law, "a controller that is not supervised yet")
        supervisor = Supervisor() if supervisor is None else supervisor
        check_type(supervisor, "supervisor", Supervisor, "a Supervisor")
        # Checked by the law; its arrays, as one array is one table in exported C.
        for name in ("robot", "dt", "effort"):
            self.keep(name, getattr(law, name))
        self._floor = law._floor
        self.law, self.supervisor = law, supervisor
        self.measurement_type = law.measurement_type  # type: ignore[misc]  # of this one, not of the class
        self.knows = law.knows  # type: ignore[misc]
        self.bounds = _bounds(law, supervisor)
        self.batch = next((len(x) for x in self.bounds if x.ndim == 2), law.batch)
        self._smoothing = self.dt / (self.dt + _SMOOTHING)
        self.frozen_samples = supervisor.frozen_samples
        if self.frozen_samples is None:
            self.frozen_samples = frozen_samples(self.dt)
        self._lost = max(supervisor.jump - 1.0, 0.0)
        self._cut_samples = supervisor.saturated / self.dt
        self._forgotten = self.dt / (self.dt + _FORGOTTEN)
        self._answered = 0
        if supervisor.response:
            self._answered = max(_ANSWERS, math.ceil(supervisor.response / self.dt - 1e-9))
        # Bounds of the tightest joint, which take less to load than each its own.
        self._tightest = new(Bounds, [np.min(x, axis=-1, keepdims=True) for x in self.bounds])
        self._alert = np.minimum(self._tightest.following, _ALERT if self._answered else LARGEST)
        self._apart = np.minimum(self._tightest.jump, self._tightest.turn)
        # A torque below this is within its limit, and so is the sum of all.
        self._sound = np.minimum(self.effort, LARGEST / self.robot.n)
        # PID with a nominal model of its own for gravity brakes by that one.
        self._brakes = getattr(law, "bias_robot", law.robot).dynamics
        self._uses = _uses(law)
        self._damping, self._overpowered = _alone(law)
        # Where there is no torque limit, friction is no share of it.
        self._sticking = np.where(self.effort < LARGEST, supervisor.sticking * self.effort, 0.0)
        self._pushed, self._driven = _turning(law)
        self._braked = 2.0 * (self.bounds.travel / _FROZEN_COUNTS) + 4.0 * supervisor.sticking * self._pushed
        self._share = 1.0 / self.effort

    def init(self, measurement: Any, target: Target) -> SupervisedState:
        """Return the state before the first sample; FAULT, with torque zero, when it is implausible."""
        given, asked = measurement.q, target.q
        bounds = self.bounds
        code = np.where(_beyond(given - asked, bounds.following), float(Reason.FOLLOWING), 0.0)
        code = np.where(_beyond(asked, FARTHEST), float(Reason.REFERENCE), code)
        outside = (given < bounds.lower) | (given > bounds.upper)
        code = np.where(outside, float(Reason.POSITION), code)
        code = np.where(self._not_finite(measurement), float(Reason.NOT_FINITE), code)
        worst, joint = _worst(code)
        good = worst == 0.0
        zero = np.zeros_like(code)
        none = zero[..., :1]
        q, r = np.where(good, given, 0.0), np.where(good, asked, 0.0)
        v = np.where(good, measurement.v, 0.0) if self.measurement_type is FullState else zero
        rest = Target(r, zero, zero)
        law = self.law.init(self._shown(q, v), self._given(rest, target, worst != 0.0))
        watch = Watch(
            status=np.where(good, float(State.INIT), float(State.FAULT)),
            reason=worst,
            joint=joint,
            since=none,
            late=none,
            ready=np.where(good, 1.0, 0.0),
            bad=zero,
            q=q,
            change=zero,
            v=zero,
            r=r,
            rv=zero,
            tau=zero,
            still=zero,
            mark=r,
            pull=zero,
            cut=zero,
            against=zero,
            asked=zero,
            asked_before=zero,
            answer_before=zero,
            calm=none,
        )
        return SupervisedState(watch, law)

    def reset(self, measurement: Any, target: Target, state: SupervisedState) -> SupervisedState:
        """Return the state of a start from where the arm is now, by a decision of the caller.

        Args:
            measurement: as for :meth:`init`.
            target: likewise.
            state: the one to leave; the torque goes on from its last one, within the rate.
        """
        made = self.init(measurement, target)
        return made._replace(supervisor=made.supervisor._replace(tau=state.supervisor.tau))

    def advance(
        self, measurement: Any, target: Target, state: SupervisedState, elapsed: int = 1
    ) -> ControlStep:
        """Return torque and next state for a sample that comes several sample times after the last one.

        The samples between are filled by interpolation. More of them than `missed` are the fault LATE.

        Args:
            measurement: as for :meth:`step`.
            target: likewise.
            state: likewise.
            elapsed: sample times since the last sample; 1 when none was missed.

        Raises:
            ParameterError: when `elapsed` is no whole number from 1 on.
        """
        elapsed = check_whole(elapsed, "elapsed", 1)
        watch = state.supervisor
        if elapsed - 1 > self.supervisor.missed:
            one = np.ones_like(watch.late)
            bad = np.full_like(watch.bad, min(elapsed - 1.0, COUNTED))
            late = watch._replace(late=one, bad=bad, calm=np.zeros_like(one))
            return self.step(measurement, target, state._replace(supervisor=late))
        sent = watch.tau
        for i in range(1, elapsed):
            part = i / elapsed
            q = watch.q + part * (measurement.q - watch.q)
            q_ref = watch.r + part * (target.q - watch.r)
            filled = self.step(measurement._replace(q=q), target._replace(q=q_ref), state)
            state = filled.state
        if elapsed > 1:  # what was filled was sent to no robot
            state = state._replace(supervisor=state.supervisor._replace(tau=sent))
        return self.step(measurement, target, state)

    def within_rate(self, applied: Array, taken: ControlStep) -> ControlStep:
        """Return a step whose torque is within its rate of what the robot says it applies.

        A robot that did not get the last torque would see the change of two.

        Args:
            applied: torque that the robot has [N m or N], (n,) or (batch, n).
            taken: what a step returned.
        """
        rate, tau = self.bounds.rate, taken.tau
        within = np.minimum(np.maximum(tau, applied - rate), applied + rate)
        tau = np.where(np.abs(within) <= self.effort, within, tau)
        watch = taken.state.supervisor._replace(tau=tau)
        return ControlStep(tau, taken.state._replace(supervisor=watch))

    def step(self, measurement: Any, target: Target, state: SupervisedState) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`. Neither is ever NaN."""
        if isinstance(measurement.q, np.ndarray):
            with np.errstate(invalid="ignore"):  # infinity less infinity
                calm = self._calm(measurement, target, state.supervisor).all()
            if calm:
                sound, made = self._run(measurement, target, state)
                if sound.all():
                    return made
        return self._any_step(measurement, target, state)

    def usual(
        self, measurement: Any, target: Target, state: SupervisedState
    ) -> tuple[Mask, Mask, ControlStep]:
        """Return a step that takes a fraction of the work, and what has to hold for it to be that of `step`.

        Returns:
            What has to hold before it is taken, after it, both (1,) or (batch, 1); and torque and next state.
        """
        return self._calm(measurement, target, state.supervisor), *self._run(measurement, target, state)

    def _calm(self, measurement: Any, target: Target, watch: Watch) -> Mask:
        """Tell whether it is RUN, nothing is counted, and no check of this sample can find anything."""
        bounds, given = self._tightest, measurement.q
        change = given - watch.q
        # Each is false of NaN.
        good = np.abs(change - watch.change) <= self._apart
        good = good & (given >= self.bounds.lower) & (given <= self.bounds.upper)
        good = good & (np.abs((target.q - watch.r) - watch.rv) <= bounds.step)
        good = good & (np.abs(given - target.q) <= self._alert)
        mark = np.where(change != 0.0, target.q, watch.mark)
        good = good & (np.abs(target.q - mark) <= bounds.travel)
        if self.measurement_type is FullState:
            good = good & (np.abs(measurement.v) <= _FASTEST)
        for used, rate in zip(self._uses, target[1:], strict=True):
            if used:
                good = good & (np.abs(rate) <= _FASTEST)
        return (watch.calm > 0.0) & _all(good)

    def _run(self, measurement: Any, target: Target, state: SupervisedState) -> tuple[Mask, ControlStep]:
        """Return whether the torque is within its limits, and the step in RUN where nothing is wrong."""
        watch, before = state
        q, r = measurement.q, target.q
        change, law = q - watch.q, self.law.unlimited()
        lower, upper = self._limits(watch)
        if self.supervisor.torque_rate is not None:
            law = self.law.within(lower, upper)
        asked, after = law.step(measurement, target, before)
        sound = np.abs(asked) < self._sound
        if self.supervisor.torque_rate is not None:
            sound = sound & (asked >= lower) & (asked <= upper)
        zero = np.zeros_like(q)
        none = zero[..., :1]
        made = Watch(
            status=none + float(State.RUN),
            reason=none,
            joint=none,
            since=none,
            late=none,
            ready=none + 1.0,
            bad=zero,
            q=q,
            change=np.where(change != 0.0, change, watch.change),
            v=_gone(watch.v + self._smoothing * (change - watch.v)),
            r=r + zero,
            rv=r - watch.r,
            tau=asked,
            still=zero,
            mark=np.where(change != 0.0, r, watch.mark),
            pull=asked,
            cut=zero,
            against=zero,
            asked=zero,
            asked_before=zero,
            answer_before=zero,
            calm=none + 1.0,
        )
        return _all(sound), ControlStep(asked, SupervisedState(made, after))

    def _limits(self, watch: Watch) -> tuple[Array, Array]:
        """Return the lowest and the highest torque of a sample."""
        lower, upper = self._floor, self.effort
        if self.supervisor.torque_rate is not None:
            lower = np.maximum(lower, watch.tau - self.bounds.rate)
            upper = np.minimum(upper, watch.tau + self.bounds.rate)
        return lower, upper

    def _any_step(self, measurement: Any, target: Target, state: SupervisedState) -> ControlStep:
        """Return torque and next state, whatever comes."""
        watch, before = state
        watch = watch._replace(cut=np.maximum(watch.cut + self._at_limit(watch.tau, -1.0), 0.0))
        active = watch.status <= float(State.RUN)
        seen = self._checked(measurement, target, watch, active)
        entering = active & (seen.worst > 0.0)
        stopping = ~active | entering
        dead = (watch.status == float(State.FAULT)) | seen.dead | (~active & seen.failing)
        aim, pace = self._aim(target, watch, seen, entering, stopping)
        # Not over a gap: a quotient there would not have the same bits in C.
        gap = seen.bad + watch.bad > 0.0
        change = seen.q - watch.q
        v = _gone(watch.v + self._smoothing * np.where(gap, 0.0, change - watch.v))
        change = np.where(gap | (change == 0.0), watch.change, change)
        lower, upper = self._limits(watch)
        # A torque that is not used needs no limits, and so no anti-windup: a step stays short.
        unused = dead | seen.lost
        law = self.law.within(np.where(unused, -LARGEST, lower), np.where(unused, LARGEST, upper))
        shown = watch.v * (1.0 / self.dt)
        if self.measurement_type is FullState:
            shown = np.where(seen.lost, shown, measurement.v)
        asked, after = law.step(self._shown(seen.q, shown), self._given(aim, target, stopping), before)
        # A law whose torque is no number has a state that is none: it cannot go on.
        unsound = _beyond(_sum(asked), LARGEST)
        dead = dead | unsound
        opened = dead | seen.lost
        tau, answer = self._torque(asked, (lower, upper), opened, dead, watch, aim, seen, v)
        tau = np.minimum(np.maximum(tau, lower), upper)
        going: Array | float = float(State.RUN)
        waits = opened
        if self.supervisor.torque_rate is not None:
            ramping = (watch.status == float(State.INIT)) & self._held_back(asked, lower, upper)
            going, waits = np.where(ramping, float(State.INIT), going), opened | ramping
        stopped = np.where(_any(aim.v != 0.0) | seen.lost, float(State.STOPPING), float(State.HOLD))
        broken = unsound & (watch.reason == 0.0)
        reason = np.where(entering, seen.worst, np.where(broken, float(Reason.NOT_FINITE), watch.reason))
        made = Watch(
            status=np.where(dead, float(State.FAULT), np.where(stopping, stopped, going)),
            reason=reason,
            joint=np.where(entering, seen.joint, watch.joint),
            since=np.minimum(watch.since + np.where(watch.reason > 0.0, 1.0, 0.0), COUNTED),
            late=np.zeros_like(watch.late),
            ready=watch.ready,
            bad=seen.bad,
            q=seen.q,
            change=change,
            v=v,
            r=aim.q,
            rv=pace,
            tau=tau,
            still=np.where(dead & seen.distrusted, COUNTED, seen.still),
            mark=np.where(seen.q == watch.q, watch.mark, aim.q),
            pull=np.where(seen.still > 0.0, watch.pull, tau),
            cut=np.where(entering, 0.0, watch.cut),
            **answer._asdict(),
            calm=watch.calm,
        )
        counted = made.bad + made.still + made.cut + made.against + self._at_limit(tau, 0.0)
        calm = np.where((made.status == float(State.RUN)) & _all(counted == 0.0), 1.0, 0.0)
        return ControlStep(tau, SupervisedState(made._replace(calm=calm), _chosen(waits, before, after)))

    def _at_limit(self, tau: Array, otherwise: float) -> Array:
        """Return 1 where a torque is at its limit."""
        return np.where(np.abs(tau) >= self.effort, 1.0, otherwise)

    def report(self, state: SupervisedState) -> FaultReport:
        """Return what a state of one rollout says of itself."""
        status, reason, joint = (int(x[0]) for x in state.supervisor[:3])
        name = self.robot.joint_names[joint] if reason else None
        return FaultReport(State(status).name.lower(), Reason(reason).name.lower(), name)

    def signals(self, state: SupervisedState) -> dict[str, Array]:
        """Return its own signals and those of the law."""
        return {**self.reported(state), **self.law.signals(state.law)}

    def reported(self, state: SupervisedState) -> dict[str, Array]:
        """Return what :data:`SIGNALS` names, the same for all joints."""
        watch = state.supervisor
        own = (watch.status, watch.reason, watch.joint, watch.since)
        return {name: value + np.zeros_like(watch.q) for name, value in zip(SIGNALS, own, strict=True)}

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {**self.law.describe(), "supervisor": self.supervisor.values()}

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"Supervised({self.law!r})"

    def _checked(self, measurement: Any, target: Target, watch: Watch, active: Mask) -> _Seen:
        """Return what a sample looks like."""
        bounds, given = self.bounds, measurement.q
        finite = ~self._not_finite(measurement)
        # From where it was, or where its last change leads, as what moves fast goes on doing so.
        change = given - watch.q
        samples = 1.0 + watch.bad
        # It went on for a while, and all at once goes back as fast: its encoder counts backwards.
        turn = np.maximum(
            bounds.turn, self._pushed + self._driven * _largest(self._share * np.abs(watch.tau))
        )
        last = np.abs(watch.change)
        turned = (last > turn) & (watch.v * watch.change > turn * last) & (watch.late == 0.0)
        # One that decelerates to turn round is slower by then than it was, and has every right to.
        turned = turned & (last > 0.5 * np.abs(watch.v))
        turned = turned & (np.abs(change + samples * watch.change) <= 0.25 * samples * last)
        good = finite & ~turned & (np.abs(change - watch.change) <= bounds.jump * samples)
        strayed = self._strayed(target, watch)
        r = np.where(active & ~strayed, target.q, watch.r)
        q = np.where(good, given, watch.q)
        # Since the number last changed, the reference has moved on, or the torque has reached its limit. A
        # joint that is ahead of its reference waits for it.
        moved = np.maximum(np.minimum(r - watch.mark, r - q), np.minimum(watch.mark - r, q - r))
        unmoved = good & (change == 0.0)
        asked = unmoved & ((moved > bounds.travel) | (watch.cut > 0.0))
        still = np.where(asked, watch.still + 1.0, 0.0)
        frozen = good & self._frozen(still, moved, unmoved, watch)
        e = q - r
        away = np.abs(e) > bounds.following
        cut = watch.cut > self._cut_samples if self._cut_samples else away & ~away
        failing = away | cut
        turned = self._turned(watch.against)
        distrusted = ~good | frozen | (watch.still >= COUNTED)
        if not self._answered:  # its motor may turn the other way
            distrusted = distrusted | (~active & failing)
        code = np.where(cut, float(Reason.SATURATED), np.where(watch.late > 0.0, float(Reason.LATE), 0.0))
        for wrong, reason in (
            (away, Reason.FOLLOWING),
            (strayed, Reason.REFERENCE),
            ((given < bounds.lower) | (given > bounds.upper), Reason.POSITION),
            (frozen, Reason.FROZEN),
            (~good, Reason.JUMP),
            (~finite, Reason.NOT_FINITE),
            (turned, Reason.RESPONSE),
        ):
            code = np.where(wrong, float(reason), code)
        bad = np.where(good, 0.0, watch.bad + 1.0)
        dead = _any(frozen | turned | (bad > float(self.supervisor.missed)))
        return _Seen(q, bad, _any(~good), dead, _any(failing), *_worst(code), still, e, distrusted)

    def _not_finite(self, measurement: Any) -> Mask:
        """Tell which joints have a measurement that is no number, or farther than any arm."""
        wrong = _beyond(measurement.q, FARTHEST)
        if self.measurement_type is FullState:
            wrong = wrong | _beyond(measurement.v, _FASTEST)
        return wrong

    def _strayed(self, target: Target, watch: Watch) -> Mask:
        """Tell which joints have a reference that is no number, or that jumps."""
        # From one sample to the next: what is smoothed lags, and takes an acceleration for a step.
        samples = 1.0 + watch.bad
        wrong = _beyond((target.q - watch.r) - samples * watch.rv, self.bounds.step * samples)
        for used, rate in zip(self._uses, target[1:], strict=True):
            if used:  # what the law does not use need not be there
                wrong = wrong | _beyond(rate, _FASTEST)
        return wrong

    def _frozen(self, still: Array, moved: Array, unmoved: Mask, watch: Watch) -> Mask:
        """Tell which joints have a measurement that is frozen."""
        if not self.frozen_samples:
            return unmoved & ~unmoved
        # A joint that moved with its reference cannot stand still at once: there is no need to wait. One that
        # starts, or turns round, has slow changes first, and may stick.
        far = moved > self.bounds.travel + self._lost * np.abs(watch.rv)
        went = watch.change * watch.rv > _IN_MOTION * (watch.rv * watch.rv)
        moving = went & (watch.v * watch.change > 0.1 * (watch.change * watch.change))
        moving = moving & (np.abs(watch.change) > self._braked)
        # Friction holds a joint at rest until its torque has changed by more.
        pulled = (np.abs(watch.tau - watch.pull) > self._sticking) | (watch.cut > 0.0)
        return ((still >= float(self.frozen_samples)) & pulled) | (unmoved & far & moving)

    def _aim(
        self, target: Target, watch: Watch, seen: _Seen, entering: Mask, stopping: Mask
    ) -> tuple[Target, Array]:
        """Return the reference to follow, the one given or that of a stop, and its way in a sample."""
        # Where the joint did not follow, or nobody looked, the stop begins where it is, and as fast as it is.
        late = (watch.late > 0.0) & ~seen.lost
        apart = entering & ((np.abs(seen.e) > _NEAR) | late)
        # After a gap as fast as if it had changed its velocity evenly there.
        gap = 2.0 / (1.0 + np.maximum(watch.bad[..., :1], 0.0))
        own = np.where(late, (seen.q - watch.q) * gap - watch.v, watch.v)
        r, v = np.where(apart, seen.q, watch.r), np.where(apart, own, watch.rv)
        v = np.minimum(np.maximum(v, -self.bounds.stop_velocity), self.bounds.stop_velocity)
        less = np.minimum(np.maximum(v, -self.bounds.slowing), self.bounds.slowing)
        after = v - less
        pace = np.where(stopping, after, target.q - watch.r)
        aim = Target(
            np.where(stopping, r + 0.5 * (v + after), target.q),
            pace * (1.0 / self.dt),
            np.where(stopping, less * (-1.0 / self.dt**2), 0.0),
        )
        return aim, pace

    def _given(self, aim: Target, target: Target, stopping: Mask) -> Target:
        """Return the target for the law: its rates are those given, while there is no stop."""
        return Target(aim.q, np.where(stopping, aim.v, target.v), np.where(stopping, aim.a, target.a))

    def _shown(self, q: Array, v: Array) -> Measurement | FullState:
        """Return what the law measures."""
        return FullState(q, v) if self.measurement_type is FullState else Measurement(q)

    def _torque(
        self,
        asked: Array,
        limits: tuple[Array, Array],
        opened: Mask,
        dead: Mask,
        watch: Watch,
        aim: Target,
        seen: _Seen,
        v: Array,
    ) -> tuple[Array, _Answer]:
        """Return the torque before its limits, and how the joints answer theirs.

        The nominal model is asked once in a sample: for a torque in open loop, for that of the motion
        measured, or by the law for what a torque cut leaves. So no step takes much longer than others.
        """
        alert = _any(~opened & (np.abs(seen.e) > _ALERT)) if self._answered else opened & ~opened
        torque, motion = self._open_loop(opened, dead, watch, aim, seen, v)
        looks = alert & ~_any((asked <= limits[0]) | (asked >= limits[1]))
        model = self._brakes.inverse_where(*_chosen(looks, self._motion(watch, seen, v), motion))
        answer = self._answer(alert, looks, dead, model, watch, seen, v)
        tau = np.where(opened, model + torque, asked)
        # Turned round once more a motor brakes. If it was no motor that turns the other way, its joint is
        # faster soon, and gets no torque any more.
        turned, speed = dead & self._turned(answer.against), np.abs(v)
        most = np.where(watch.status < float(State.FAULT), _FASTER * speed, watch.asked)
        most = np.where(speed > most, 0.0, most)
        answer = answer._replace(asked=np.where(turned, most, answer.asked))
        return np.where(turned, np.where(most > 0.0, -tau, 0.0), tau), answer

    def _turned(self, against: Array) -> Mask:
        """Tell which joints have answered their torque the wrong way for too long."""
        return against > float(self._answered) if self._answered else against < 0.0

    def _answer(
        self, alert: Mask, looks: Mask, dead: Mask, model: Array, watch: Watch, seen: _Seen, v: Array
    ) -> _Answer:
        """Return how the joints answer their torques, from the torque of the nominal model for their motion.

        Torques and what answers them are compared by what is new in them: neither loads nor friction that
        stay are, and a push only while it begins. A motor that turns the other way is at every change. While
        a torque is cut the model is not asked. A joint whose torque is at its limit answers the wrong way
        then when it accelerates as by a push of half that torque.
        """
        if not self._answered:
            return _Answer(*(np.zeros_like(v),) * 4)
        known = watch.answer_before != 0.0
        asked = np.where(known, watch.asked + self._smoothing * (watch.tau - watch.asked), watch.tau)
        change = np.where(known, asked - watch.asked_before, 0.0)
        asked_before = asked - change + self._forgotten * change
        answer = np.where(known, model - watch.answer_before, 0.0)
        answer_before = np.where(looks, model - answer + self._forgotten * answer, watch.answer_before)
        # The torque pushes back, and what it does is to push on.
        wrong = (np.abs(change) > _ASKED * self.effort) & (change * seen.e < 0.0) & (answer * seen.e > 0.0)
        limited = np.abs(watch.tau) >= self.effort
        pushed = limited & (watch.tau * seen.e < 0.0)
        pushed = pushed & ((v - watch.v) * seen.e > self._overpowered * np.abs(seen.e))
        wrong = np.where(looks, wrong, pushed) & (np.abs(seen.e) > _ALERT) & ((v - watch.rv) * seen.e > 0.0)
        against = np.where(looks | limited, 1.0, watch.against)
        against = np.where(wrong, np.maximum(watch.against, 1.0) + 1.0, against)
        found = against, asked, asked_before, answer_before
        before = watch.against, watch.asked, watch.asked_before, watch.answer_before
        # Without the loop nothing new is found, and nothing forgotten.
        kept = [np.where(dead, old, 0.0) for old in before]
        return _Answer(*(np.where(alert, new, old) for new, old in zip(found, kept, strict=True)))

    def _motion(self, watch: Watch, seen: _Seen, v: Array) -> tuple[Array, ...]:
        """Return that a torque is asked for, and for which motion: the one measured."""
        rate = 1.0 / self.dt
        return np.ones_like(watch.ready), seen.q, v * rate, (v - watch.v) * (rate * rate)

    def _open_loop(
        self, opened: Mask, dead: Mask, watch: Watch, aim: Target, seen: _Seen, v: Array
    ) -> tuple[Array, tuple[Array, ...]]:
        """Return torque without a measurement that the law could use, and a motion that takes more.

        The motion is given as whether a torque is asked for, position, velocity and acceleration.
        """
        on, kind = np.where(opened, watch.ready, 0.0), self.supervisor.on_fault
        torque = np.zeros_like(v)
        if kind == "zero":
            on = np.where(dead, 0.0, on)
        elif kind == "hold":
            aim = Target(np.where(dead, watch.q, aim.q), *(np.where(dead, 0.0, rate) for rate in aim[1:]))
        else:
            damped = dead & ~seen.distrusted
            # A motor that turns the other way makes other joints fast, too: a stop from there would be long.
            rests = damped & _any(self._turned(watch.against))
            q, *rates = aim
            aim = Target(np.where(damped, seen.q, q), *(np.where(rests, 0.0, rate) for rate in rates))
            torque = np.where(damped, self._damping * (aim.v - v * (1.0 / self.dt)), 0.0)
        return torque, (on, *aim)

    def _held_back(self, asked: Array, lower: Array, upper: Array) -> Mask:
        """Tell whether the rate keeps a torque from what the law asks for."""
        above = (asked >= upper) & (upper < self.effort)
        return _any(above | ((asked <= lower) & (lower > self._floor)))


def suited(supervisor: Supervisor, plant: Any, controller: Controller) -> Supervisor:
    """Return settings in which what is not given suits an experiment's encoder, noise and delay.

    Args:
        supervisor: the settings.
        plant: the section of the experiment file.
        controller: for whose arm.
    """
    found: dict[str, Any] = {name: getattr(supervisor, name) for name in parameters(Supervisor)}
    if found["resolution"] is None:
        names = controller.robot.joint_names
        bits = _BITS if plant.encoder_bits is None else plant.encoder_bits
        count = controller.robot.encoder_count(quantity(bits, "encoder_bits", names, _BITS))
        noise = 0.0 if plant.noise is None else quantity(plant.noise.position, "position", names, 0.0)
        found["resolution"] = count + _SIGMAS * noise
    if found["frozen_samples"] is None:  # what comes late repeats itself for longer
        found["frozen_samples"] = frozen_samples(controller.dt) + plant.delay
    if found["response"]:  # and answers late
        found["response"] += controller.dt * plant.delay
    return Supervisor(**found)


def frozen_samples(dt: float) -> int:
    """Return how many samples of `dt` [s] make a measurement frozen."""
    return max(3, math.ceil(_FROZEN_TIME / dt - 1e-9))


def _bounds(law: Controller, given: Supervisor) -> Bounds:
    """Return the numbers for a controller's arm and sample time.

    Raises:
        ArrayError: when a bound does not fit the joints.
    """
    robot, dt = law.robot, law.dt
    declared = parameters(Supervisor)

    def joints(name: str, otherwise: Any = None) -> Array:
        value = getattr(given, name)
        value = otherwise if value is None else value
        one = declared[name]
        return per_joint(value, name, robot.joint_names, one.bounds, one.inside)

    count = joints("resolution", robot.encoder_count(_BITS))
    lower, upper, limit, _ = robot.limits
    # A joint whose URDF gives no velocity limit may move at any speed.
    speed = np.where(limit > 0.0, limit, math.inf)
    margin = joints("position_margin")
    jumps, steps = (
        share * dt * speed + 2.0 * count if share else math.inf
        for share in (given.jump, given.reference_jump)
    )
    if given.reference_jump and given.reference_step:
        steps = np.minimum(steps, given.reference_step * dt * least_acceleration(law) + 2.0 * count)
    known = np.minimum(speed, LARGEST)
    least, most = np.maximum(lower - margin, -FARTHEST), np.minimum(upper + margin, FARTHEST)
    shape = np.broadcast_shapes(count.shape, least.shape, np.shape(steps))
    return Bounds(
        jump=np.minimum(np.broadcast_to(jumps, shape), LARGEST),
        turn=4.0 * count if given.jump else np.full(shape, LARGEST),
        step=np.minimum(np.broadcast_to(steps, shape), FARTHEST),
        lower=least,
        upper=most,
        following=joints("following"),
        travel=_FROZEN_COUNTS * count,
        slowing=dt * (dt * joints("deceleration")),
        stop_velocity=dt * joints("stop_velocity", known),
        rate=dt * joints("torque_rate", LARGEST),
    )


def _uses(law: Controller) -> tuple[bool, bool]:
    """Tell whether a law uses velocity and acceleration of its reference: NaN shows in its torque."""
    robot: Any = law.robot
    shape = (robot.n,) if law.batch is None else (law.batch, robot.n)
    q = np.ascontiguousarray(np.broadcast_to(robot.middle(), shape))
    zero = np.zeros(shape)
    seen: Any = FullState(q, zero) if law.measurement_type is FullState else Measurement(q)
    rates = ((zero * np.nan, zero), (zero, zero * np.nan))
    try:
        with np.errstate(all="ignore"):
            state = law.init(seen, Target(q, zero, zero))
            taus = [law.step(seen, Target(q, *rate), state).tau for rate in rates]
    except Exception:  # a user's law may raise anything: whoever steps it learns why
        return True, True
    return bool(np.isnan(taus[0]).any()), bool(np.isnan(taus[1]).any())


def _alone(law: Controller) -> tuple[Array, Array]:
    """Return what concerns each joint alone, as if no other one were.

    Returns:
        Torque per velocity by which it is damped [N m s]; and what half of its motor's torque changes of its
        motion in a sample [rad or m].
    """
    robot: Any = law.robot
    inverse = np.diagonal(np.linalg.inv(robot.mass_matrix(robot.middle())), axis1=-2, axis2=-1)
    rate = min(_DAMPING, _DAMPED_AT_ONCE / law.dt)
    return np.asarray(rate / inverse), 0.5 * law.dt**2 * np.minimum(law.effort, LARGEST) * inverse


def _turning(law: Controller) -> tuple[Array, Array]:
    """Return half of what a push, and all torques, change of a motion in a sample, at most [rad or m].

    A push is by half the torque of the joint's motor; torques are at their limits.
    """
    effort, half = np.minimum(law.effort, LARGEST), 0.5 * law.dt**2
    pushed, driven = [], []
    for inertia in _inertias(law):
        inverse = np.abs(np.linalg.inv(inertia))
        pushed.append(half * 0.5 * effort * np.diagonal(inverse, axis1=-2, axis2=-1))
        driven.append(half * (inverse @ effort[..., None])[..., 0])
    return np.max(pushed, axis=0), np.max(driven, axis=0)


def least_acceleration(law: Controller) -> Array:
    """Return each joint's least acceleration by all its torque, the others held [rad/s^2 or m/s^2]."""
    most = np.max([np.diagonal(inertia, axis1=-2, axis2=-1) for inertia in _inertias(law)], axis=0)
    return np.asarray(np.minimum(law.effort, LARGEST) / most)


def _inertias(law: Controller) -> Iterator[Array]:
    """Yield the nominal model's D(q) in some configurations, always the same."""
    robot: Any = law.robot
    lower, upper = (np.clip(x, -math.pi, math.pi) for x in robot.limits[:2])
    for share in np.random.default_rng(0).uniform(size=(_POSES, robot.n)):
        yield robot.mass_matrix(lower + share * (upper - lower))


def _largest(x: Array) -> Array:
    """Return the largest over the joints, shape (1,) or (batch, 1)."""
    found = x[..., :1]
    for j in range(1, x.shape[-1]):
        found = np.maximum(found, x[..., j : j + 1])
    return found


def _gone(v: Array) -> Array:
    """Return a smoothed velocity, zero where next to nothing is left of it.

    At rest it would halve for ever, and processors take long over the smallest numbers there are.
    """
    return np.where(np.abs(v) > SMALLEST, v, 0.0)


def _beyond(x: Array, limit: Array | float) -> Mask:
    """Tell which numbers are not within plus and minus a limit; NaN is not."""
    return ~(np.abs(x) <= limit)


def _any(mask: Mask) -> Mask:
    """Tell whether any joint is, shape (1,) or (batch, 1)."""
    found = mask[..., :1]
    for j in range(1, mask.shape[-1]):
        found = found | mask[..., j : j + 1]
    return found


def _all(mask: Mask) -> Mask:
    """Tell whether all joints are, shape (1,) or (batch, 1)."""
    found = mask[..., :1]
    for j in range(1, mask.shape[-1]):
        found = found & mask[..., j : j + 1]
    return found


def _sum(x: Array) -> Array:
    """Return the sum over the joints, in their order, shape (1,) or (batch, 1)."""
    total = x[..., :1]
    for j in range(1, x.shape[-1]):
        total = total + x[..., j : j + 1]
    return total


def _worst(code: Array) -> tuple[Array, Array]:
    """Return the highest number, and the first joint that has it, each of shape (1,) or (batch, 1)."""
    joints = [code[..., j : j + 1] for j in range(code.shape[-1])]
    worst = _largest(code)
    first = np.zeros_like(worst)
    for j in reversed(range(len(joints))):
        first = np.where(joints[j] == worst, float(j), first)
    return worst, first


def _chosen(condition: Mask, yes: Any, no: Any) -> Any:
    """Return a state whose numbers are those of `yes` where the condition holds, else those of `no`.

    Counts are always those of `no`.
    """
    if isinstance(yes, tuple):
        return tuple.__new__(type(yes), [_chosen(condition, *pair) for pair in zip(yes, no, strict=True)])
    if yes is None or isinstance(no, int):
        return no
    return np.where(condition if np.ndim(yes) else condition[..., 0], yes, no)
