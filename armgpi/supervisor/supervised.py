"""A controller under a supervisor."""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from armgpi.base.arrays import LARGEST, SMALLEST, Array, check_type, check_whole
from armgpi.base.escape import html_table
from armgpi.base.parameter import parameters
from armgpi.control.controller import Controller, ControlStep, FullState, Measurement
from armgpi.errors import ParameterError, show_value
from armgpi.references.reference import Target
from armgpi.robot.batch import one_of
from armgpi.robot.frame_motion import Chain, FrameMotion
from armgpi.supervisor import checks
from armgpi.supervisor.bounds import FARTHEST, SMOOTHING, Supervisor, bounds_of, smoothing, suited
from armgpi.supervisor.joints import (
    Mask,
    all_joints,
    any_joint,
    beyond,
    choose,
    sum_joints,
    worst_joint,
)
from armgpi.supervisor.state import (
    COUNTED,
    SIGNALS,
    FaultReport,
    FrozenState,
    Reason,
    ResponseState,
    Sample,
    State,
    SupervisedState,
    Watch,
)
from armgpi.supervisor.stop import Stop


class Supervised(Controller):
    """A controller under a supervisor: its torque is finite and within limits and rate, whatever comes.

    Attributes:
        law: the controller.
        supervisor: the bounds, as they were given.
        bounds: the same as numbers for this arm and sample time.
        frozen_samples: samples that make a measurement frozen, 0 for no check.
        finite: the check of that name, as are `jump`, `position`, `reference`, `following`, `speed`,
            `workspace`, `tool_speed`, `tool_force`, `frozen`, `saturated` and `response`.
        stop: how the arm is stopped.
        _sound: torque below which none is cut [N m or N].
    """

    def __init__(self, law: Controller, supervisor: Supervisor | None = None) -> None:
        """Put a controller under a supervisor.

        Args:
            law: the controller.
            supervisor: what it takes for a fault; as :class:`Supervisor` has it when not given.

        Raises:
            ParameterError: when the controller is none, or is supervised already, or no joint moves the tool.
            ArrayError: when a bound does not fit the joints.
            NameNotFound: when there is no frame of the tool's name.
        """
        check_type(law, "law", Controller, "a Controller")
        if isinstance(law, Supervised):
            raise ParameterError("law", law, "a controller that is not supervised yet")
        supervisor = Supervisor() if supervisor is None else supervisor
        check_type(supervisor, "supervisor", Supervisor, "a Supervisor")
        supervisor = suited(law, supervisor)
        # Checked by the law; its arrays, as one array is one table in exported C.
        for name in ("robot", "dt", "effort"):
            self.keep(name, getattr(law, name))
        self._floor = law._floor
        self.law, self.supervisor = law, supervisor
        self.measurement_type = law.measurement_type  # type: ignore[misc]  # of this one, not of the class
        self.knows = law.knows  # type: ignore[misc]
        self.bounds = bounds = bounds_of(law, supervisor)
        self.batch = next((len(x) for x in bounds if x.ndim == 2), law.batch)
        rated, self._capped, self._slow = (
            getattr(supervisor, x) is not None for x in ("torque_rate", "torque_cap", "speed_cap")
        )
        self._bounded = rated or self._capped
        self._smoothing = smoothing(self.dt, SMOOTHING)
        self.finite = checks.NotFinite(law)
        self.jump = checks.Jump(law, bounds)
        self.position = checks.Position(bounds)
        self.reference = checks.ReferenceJump(law, bounds)
        self.response = checks.Response(law, supervisor, bounds)
        self.following = checks.Following(bounds, self.response)
        self.speed = checks.Speed(bounds, supervisor)
        self.workspace = checks.Workspace(supervisor)
        self.tool_speed = checks.ToolSpeed(law, supervisor)
        self.tool_force = checks.ToolForce(law, supervisor)
        self._frame: FrameMotion | None = None
        if supervisor.checks_tool:
            arm = one_of(self.robot)
            try:
                self._frame = FrameMotion(arm, supervisor.tool_frame or arm.tip)
            except ParameterError:
                named = supervisor.tool_frame or arm.tip
                raise ParameterError("tool_frame", named, "a frame that a joint moves") from None
            self.tool_force.measure(self._frame, arm)
        self.frozen = checks.Frozen(law, supervisor, bounds, self.jump.pushed)
        self.saturated = checks.Saturated(law, supervisor)
        self.stop = Stop(law, supervisor, bounds)
        self.frozen_samples = self.frozen.samples
        # A torque below this is within its limit, and so is the sum of all.
        self._sound = np.minimum(self.effort, LARGEST / self.robot.n)
        # PID with a nominal model of its own for gravity brakes by that one.
        self._brakes = getattr(law, "bias_robot", law.robot).dynamics

    def init(self, measurement: Any, target: Target) -> SupervisedState:
        """Return the state before the first sample; see :meth:`Controller.init`.

        An implausible measurement or target gives FAULT with torque zero, not an error.
        """
        given, asked = measurement.q, target.q
        code = np.zeros_like(given - asked)
        for wrong, reason in (
            (beyond(given - asked, self.bounds.following), Reason.FOLLOWING),
            (beyond(asked, FARTHEST), Reason.REFERENCE),
            (self.position.fails(given), Reason.POSITION),
            (self.finite.fails(measurement), Reason.NOT_FINITE),
        ):
            code = np.where(wrong, float(reason), code)
        worst, joint = worst_joint(code)
        for outside in self.workspace.fails(self._chain(np.where(worst == 0.0, given, 0.0 * code))):
            worst = np.where((worst == 0.0) & outside, float(Reason.WORKSPACE), worst)
        good = worst == 0.0
        zero = np.zeros_like(code)
        none = zero[..., :1]
        q, r = np.where(good, given, 0.0), np.where(good, asked, 0.0)
        v = np.where(good, measurement.v, 0.0) if self.measurement_type is FullState else zero
        rest = Target(r, zero, zero)
        law = self.law.init(self._measurement(q, v), self._target(rest, target, worst != 0.0))
        watch = self._watch(zero, q=q, r=r, tau=zero)._replace(
            status=np.where(good, float(State.INIT), float(State.FAULT)),
            reason=worst,
            joint=joint,
            ready=np.where(good, 1.0, 0.0),
            nominal=none,
            wrench=self.tool_force.init(q),
        )
        return SupervisedState(watch, law)

    def check_start(self, q: Array) -> None:
        """Refuse a start outside the workspace; of a batch, one in which every start is.

        Args:
            q: positions [rad or m], (n,) or (batch, n).

        Raises:
            ParameterError: when the tool is outside there.
        """
        chain = self._chain(q)
        for outside in self.workspace.fails(chain):
            if outside.all() and chain is not None:
                where = ", ".join(f"{x:.4g}" for x in np.reshape(chain.position, (-1, 3))[0])
                expected = f"a box that contains the tool at the start, which is at ({where}) m"
                raise ParameterError("workspace", self.supervisor.values()["workspace"], expected)

    def _chain(self, q: Array) -> Chain | None:
        """Return where the tool is; None where nothing of it is checked."""
        return None if self._frame is None else self._frame.chain(q)

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
            late = watch._replace(late=one, bad=bad, nominal=np.zeros_like(one))
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
        """Return a step whose torque is within its rate of the torque that the robot reports.

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
                nominal = self._is_nominal(measurement, target, state.supervisor).all()
            if nominal:
                sound, taken = self._nominal_step(measurement, target, state)
                if sound.all():
                    return taken
        return self._any_step(measurement, target, state)

    def usual(
        self, measurement: Any, target: Target, state: SupervisedState
    ) -> tuple[Mask, Mask, ControlStep]:
        """Return a step that takes a fraction of the work, and what has to hold for it to be that of `step`.

        Args:
            measurement: as for :meth:`step`, as are `target` and `state`.
            target: likewise.
            state: likewise.

        Returns:
            What has to hold before it is taken, after it, both (1,) or (batch, 1); and torque and next state.
        """
        nominal = self._is_nominal(measurement, target, state.supervisor)
        return nominal, *self._nominal_step(measurement, target, state)

    def _is_nominal(self, measurement: Any, target: Target, watch: Watch) -> Mask:
        """Tell whether it is RUN, nothing is counted, and no check of this sample can find anything."""
        q = measurement.q
        change, chain = q - watch.q, self._chain(q)
        passed = (
            *self.jump.nominal(change, watch),
            *self.position.nominal(q),
            *self.following.nominal(q - target.q),
            *self.speed.nominal(watch),
            *self.frozen.nominal(change, target.q, watch),
            *self.finite.nominal(measurement),
            *self.reference.nominal(target, watch),
            *self.workspace.nominal(chain),
            *self.tool_speed.nominal(self._frame, chain, q, watch),
            *self.tool_force.nominal(self._frame, chain, q, watch),
        )
        return (watch.nominal > 0.0) & all_joints(reduce(operator.and_, passed))

    def _nominal_step(
        self, measurement: Any, target: Target, state: SupervisedState
    ) -> tuple[Mask, ControlStep]:
        """Return whether the torque is within its limits, and the step in RUN where nothing is wrong."""
        watch, before = state
        q, r = measurement.q, target.q
        change, law = q - watch.q, self.law.unlimited()
        lower, upper, capped = self._limits(watch, q)
        if self._bounded:
            law = self.law.within(lower, upper)
        asked, after = law.step(measurement, target, before)
        sound = np.abs(asked) < self._sound
        if capped is not None:
            sound = sound & ~capped(asked)
        if self.supervisor.torque_rate is not None:
            sound = sound & (asked >= lower) & (asked <= upper)
        zero, moved = np.zeros_like(q), change != 0.0
        kept = self._watch(zero, q=q, r=r + zero, tau=asked)._replace(
            change=np.where(moved, change, watch.change),
            miss=change - watch.change,
            v=_gone(watch.v + self._smoothing * (change - watch.v)),
            rv=r - watch.r,
            frozen=FrozenState(
                zero,
                np.where(moved, r, watch.frozen.reference_at_change),
                np.where(moved, asked, watch.frozen.torque_at_change),
                zero,
            ),
            wrench=self.tool_force.after(q, watch),
        )
        return all_joints(sound), ControlStep(asked, SupervisedState(kept, after))

    def _watch(self, zero: Array, q: Array, r: Array, tau: Array) -> Watch:
        """Return what is kept of a joint at rest in RUN, of which nothing is counted."""
        none = zero[..., :1]
        one = none + 1.0
        return Watch(
            status=none + float(State.RUN),
            reason=none,
            joint=none,
            since=none,
            late=none,
            ready=one,
            restless=none,
            travel=none,
            bad=zero,
            q=q,
            change=zero,
            miss=zero,
            v=zero,
            r=r,
            rv=zero,
            tau=tau,
            frozen=FrozenState(zero, r, tau, zero),
            saturated_samples=zero,
            response=ResponseState(zero, zero, zero, zero),
            nominal=one,
        )

    def _effort_and_rate(self, watch: Watch) -> tuple[Array, Array]:
        """Return the lowest and the highest torque, whatever the stage limits are."""
        lower, upper = self._floor, self.effort
        if self.supervisor.torque_rate is not None:
            lower = np.maximum(lower, watch.tau - self.bounds.rate)
            upper = np.minimum(upper, watch.tau + self.bounds.rate)
        return lower, upper

    def _limits(self, watch: Watch, q: Array) -> tuple[Array, Array, Callable[[Array], Mask] | None]:
        """Return the lowest and the highest torque where the joints are at q, and which ones reach a cap."""
        lower, upper = self._effort_and_rate(watch)
        if not self._capped:
            return lower, upper, None
        hold, cap = self._brakes.gravity(q), self.bounds.cap
        # The rate goes first, and leads to the cap.
        low, high = (np.minimum(np.maximum(x, lower), upper) for x in (hold - cap, hold + cap))
        reached = low == hold - cap, high == hold + cap
        return low, high, lambda tau: ((tau <= low) & reached[0]) | ((tau >= high) & reached[1])

    def _room_for_none(self, dead: Mask, lower: Array, upper: Array, watch: Watch) -> tuple[Array, Array]:
        """Return limits between which FAULT without torque has none: caps are about what holds the arm."""
        if not self._capped or self.supervisor.on_fault != "zero":
            return lower, upper
        least, most = self._effort_and_rate(watch)
        low, high = np.maximum(np.minimum(lower, 0.0), least), np.minimum(np.maximum(upper, 0.0), most)
        return np.where(dead, low, lower), np.where(dead, high, upper)

    def _any_step(self, measurement: Any, target: Target, state: SupervisedState) -> ControlStep:
        """Return torque and next state, whatever comes."""
        watch, before = state
        watch = watch._replace(saturated_samples=self.saturated.count(watch))
        active = watch.status <= float(State.RUN)
        seen = self._look(measurement, target, watch, active)
        entering = active & (seen.worst > 0.0)
        stopping = ~active | entering
        restless, travel, swings = self.stop.restless(watch)
        dead = (watch.status == float(State.FAULT)) | seen.dead | (~active & (seen.failing | swings))
        aim, way = self.stop.reference(seen, entering, stopping, target, watch)
        accused = self.response.accuses(watch)
        change, miss, v = self._motion(seen, accused, watch)
        lower, upper, caps = self._limits(watch, seen.q)
        # A torque that is not used needs no limits, and so no anti-windup: a step stays short.
        unused = dead | seen.lost
        law = self.law.within(np.where(unused, -LARGEST, lower), np.where(unused, LARGEST, upper))
        shown = watch.v * (1.0 / self.dt)
        if self.measurement_type is FullState:
            shown = np.where(seen.lost, shown, measurement.v)
        given, wanted = self._measurement(seen.q, shown), self._target(aim, target, stopping)
        asked, after = law.step(given, wanted, before)
        # A law whose torque is NaN may have NaN in its state: it cannot go on.
        unsound = beyond(sum_joints(asked), LARGEST)
        capped = None if caps is None else caps(asked) & ~unused
        dead = dead | (unsound if capped is None else unsound | any_joint(capped))
        opened = dead | seen.lost
        lower, upper = self._room_for_none(dead, lower, upper, watch)
        tau, response = self._torque(asked, (lower, upper), opened, dead, accused, watch, aim, seen, v)
        tau = np.minimum(np.maximum(tau, lower), upper)
        going: Array | float = float(State.RUN)
        if self.supervisor.torque_rate is not None:
            ramping = (watch.status == float(State.INIT)) & self._held_back(asked, lower, upper)
            going, opened = np.where(ramping, float(State.INIT), going), opened | ramping
            before = _chosen(ramping, self.law.waiting(given, wanted, before), before)
        moves = any_joint(aim.v != 0.0) | seen.lost | (restless > 0.0)
        stopped = np.where(moves, float(State.STOPPING), float(State.HOLD))
        reason, joint = self._reason(seen, entering, unsound, capped, watch)
        kept = watch._replace(
            status=np.where(dead, float(State.FAULT), np.where(stopping, stopped, going)),
            reason=reason,
            joint=joint,
            since=np.minimum(watch.since + np.where(watch.reason > 0.0, 1.0, 0.0), COUNTED),
            late=np.zeros_like(watch.late),
            restless=np.where(active & ~entering, 0.0, restless),
            travel=np.where(active, 0.0, travel),
            bad=seen.bad,
            q=seen.q,
            change=change,
            miss=miss,
            v=v,
            r=aim.q,
            rv=way,
            tau=tau,
            frozen=self.frozen.after(self._loses_trust(dead, seen, watch), seen, aim.q, tau, watch),
            saturated_samples=np.where(entering, 0.0, watch.saturated_samples),
            response=response,
            wrench=self._wrench(seen, watch),
        )
        kept = kept._replace(nominal=self._may_take_the_short_way(kept))
        return ControlStep(tau, SupervisedState(kept, choose(opened, before, after)))

    def _wrench(self, seen: Sample, watch: Watch) -> Any:
        """Return what the estimate of the tool's force keeps; None where it is not checked."""
        gap = any_joint(seen.bad + watch.bad > 0.0)
        return self.tool_force.after(seen.q, watch, gap | (watch.status == float(State.INIT)))

    def _loses_trust(self, dead: Mask, seen: Sample, watch: Watch) -> Mask:
        """Tell which joints FAULT does not trust any more."""
        # A gear that swings turns its joint round, a JUMP for a moment; RESPONSE sees other turns.
        passing = (seen.bad > 0.0) & (seen.bad <= float(self.supervisor.missed))
        return dead & seen.distrusted & (~passing | self.response.fails(watch.response))

    def _reason(
        self, seen: Sample, entering: Mask, unsound: Mask, capped: Mask | None, watch: Watch
    ) -> tuple[Array, Array]:
        """Return the reason of a fault and the joint that it concerns, each (1,) or (batch, 1)."""
        broken = unsound & (watch.reason == 0.0)
        reason = np.where(entering, seen.worst, np.where(broken, float(Reason.NOT_FINITE), watch.reason))
        joint = np.where(entering, seen.joint, watch.joint)
        if capped is None:
            return reason, joint
        hit = any_joint(capped) & (reason == 0.0)
        first = worst_joint(np.where(capped, 1.0, 0.0))[1]
        return np.where(hit, float(Reason.CAP), reason), np.where(hit, first, joint)

    def _may_take_the_short_way(self, kept: Watch) -> Array:
        """Return 1 where it is RUN and nothing is counted, (1,) or (batch, 1)."""
        counted = kept.bad + kept.frozen.unchanged_samples + kept.saturated_samples
        counted = counted + kept.response.adverse_samples + self.saturated.at_limit(kept.tau, 0.0)
        return np.where((kept.status == float(State.RUN)) & all_joints(counted == 0.0), 1.0, 0.0)

    def _look(self, measurement: Any, target: Target, watch: Watch, active: Mask) -> Sample:
        """Return what a sample looks like."""
        given = measurement.q
        finite = ~self.finite.fails(measurement)
        change = given - watch.q
        good = finite & self.jump.passes(change, watch)
        strayed = self.reference.fails(target, watch)
        r = np.where(active & ~strayed, target.q, watch.r)
        q = np.where(good, given, watch.q)
        unmoved = good & (change == 0.0)
        unchanged_samples, ahead = self.frozen.count(unmoved, q, r, watch)
        counted = np.where(any_joint(unchanged_samples > 0.0), 1.0, 0.0)
        gravity = self._brakes.inverse_where(counted, q, np.zeros_like(q), np.zeros_like(q))
        frozen = good & self.frozen.fails(unmoved, unchanged_samples, ahead, gravity, watch)
        e = q - r
        away, cut = self.following.fails(e), self.saturated.fails(watch.saturated_samples)
        failing, turned = away | cut, self.response.fails(watch.response)
        distrusted = ~good | frozen | (watch.frozen.unchanged_samples >= COUNTED)
        if not self.response.samples:  # its motor may turn the other way
            distrusted = distrusted | (~active & failing)
        chain = self._chain(q)
        code: Any = 0.0
        for wrong, reason in (
            (watch.late > 0.0, Reason.LATE),
            (cut, Reason.SATURATED),
            (away, Reason.FOLLOWING),
            (strayed, Reason.REFERENCE),
            (self.position.fails(given), Reason.POSITION),
            (frozen, Reason.FROZEN),
            (~good, Reason.JUMP),
            (~finite, Reason.NOT_FINITE),
            (turned, Reason.RESPONSE),
            *((fast, Reason.SPEED) for fast in self.speed.fails(watch)),
            *((outside, Reason.WORKSPACE) for outside in self.workspace.fails(chain)),
            *((fast, Reason.TOOL_SPEED) for fast in self.tool_speed.fails(self._frame, chain, q, watch)),
            *((much, Reason.TOOL_FORCE) for much in self.tool_force.fails(self._frame, chain, q, watch)),
        ):
            code = np.where(wrong, float(reason), code)
        bad = np.where(good, 0.0, watch.bad + 1.0)
        dead = frozen | turned | (bad > float(self.supervisor.missed))
        for fast in self.speed.fails(watch) if self._slow else ():
            dead = dead | fast
        dead = any_joint(dead)
        worst, joint = worst_joint(code)
        return Sample(
            q,
            bad,
            lost=any_joint(~good),
            dead=dead,
            failing=any_joint(failing),
            worst=worst,
            joint=joint,
            unchanged_samples=unchanged_samples,
            e=e,
            gravity=gravity,
            distrusted=distrusted,
        )

    def _torque(
        self,
        asked: Array,
        limits: tuple[Array, Array],
        opened: Mask,
        dead: Mask,
        accused: Mask,
        watch: Watch,
        aim: Target,
        seen: Sample,
        v: Array,
    ) -> tuple[Array, ResponseState]:
        """Return the torque before its limits, and how the joints answer theirs.

        The nominal model is asked once: for a torque in open loop, for that of the motion measured, or by the
        law for what a torque cut leaves. So no step takes much longer than others, though it was asked for
        gravity where FROZEN counts.
        """
        turned = self.response.fails(watch.response)
        torque, motion = self.stop.open_loop(opened, dead, turned, accused, seen, v, aim, watch)
        alert = self.response.alert(opened, seen.e)
        cut = any_joint((asked <= limits[0]) | (asked >= limits[1]))
        slow = self.response.looks_while_slow(cut, asked)
        looks = alert & (~cut | slow)
        rate = 1.0 / self.dt
        measured = np.ones_like(watch.ready), seen.q, v * rate, (v - watch.v) * (rate * rate)
        model = self._brakes.inverse_where(*choose(looks, measured, motion))
        response = self.response.after(alert, (looks, slow), dead, model, watch, seen.e, v)
        return self.response.turned_round(dead, np.where(opened, model + torque, asked), v, watch, response)

    def _motion(self, seen: Sample, accused: Mask, watch: Watch) -> tuple[Array, Array, Array]:
        """Return the last change, its miss, and the velocity, smoothed; all in rad or m per sample.

        It is smoothed for longer in FAULT, where joints may be elastic.
        """
        # Not over a gap: a quotient there would not have the same bits in C.
        gap, change = seen.bad + watch.bad > 0.0, seen.q - watch.q
        soft = (watch.status == float(State.FAULT)) & ~accused
        new = np.where(soft, self.stop.smoothing, self._smoothing) * np.where(gap, 0.0, change - watch.v)
        miss = np.where(gap, watch.miss, change - watch.change)
        return np.where(gap | (change == 0.0), watch.change, change), miss, _gone(watch.v + new)

    def _target(self, aim: Target, target: Target, stopping: Mask) -> Target:
        """Return the target for the law: its rates are those given, while there is no stop."""
        return Target(aim.q, np.where(stopping, aim.v, target.v), np.where(stopping, aim.a, target.a))

    def _measurement(self, q: Array, v: Array) -> Measurement | FullState:
        """Return what the law measures."""
        return FullState(q, v) if self.measurement_type is FullState else Measurement(q)

    def _held_back(self, asked: Array, lower: Array, upper: Array) -> Mask:
        """Tell whether the rate keeps a torque from what the law asks for."""
        above = (asked >= upper) & (upper < self.effort)
        return any_joint(above | ((asked <= lower) & (lower > self._floor)))

    def report(self, state: SupervisedState) -> FaultReport:
        """Return status, reason and joint of a state of one rollout.

        Args:
            state: of one rollout, as :meth:`step` returned it.

        Returns:
            Status, reason and joint.
        """
        status, reason, joint = (int(x[0]) for x in state.supervisor[:3])
        return FaultReport.of(status, reason, joint, self.robot.joint_names)

    def signals(self, state: SupervisedState) -> dict[str, Array]:
        """Return its own signals and those of the controller; see :meth:`Controller.signals`."""
        return {**self.reported(state), **self.law.signals(state.law)}

    def reported(self, state: SupervisedState) -> dict[str, Array]:
        """Return what :data:`SIGNALS` names, equal for all joints; see :meth:`Controller.reported`."""
        watch = state.supervisor
        own, zero = (watch.status, watch.reason, watch.joint, watch.since), np.zeros_like(watch.q)
        return {name: value + zero for name, value in zip(SIGNALS, own, strict=True)}

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {**self.law.describe(), "supervisor": self.supervisor.values()}

    def __repr__(self) -> str:
        """Return the controller and the bounds that differ from the default ones."""
        changed = "".join(f", {name}={show_value(value)}" for name, value in self._changed().items())
        return f"Supervised({self.law!r}{changed})"

    def _repr_html_(self) -> str:
        """Return the tables of the controller, and the bounds, for notebooks."""
        own = getattr(self.law, "_repr_html_", None)
        tables = html_table("Controller", ("controller",), [(repr(self.law),)]) if own is None else own()
        known, bounds = parameters(type(self.supervisor)), self.supervisor.values()
        rows = [
            (name, "automatic" if value is None else show_value(value), known[name].unit, known[name].text)
            for name, value in bounds.items()
        ]
        return tables + html_table("Supervisor", ("bound", "value", "unit", "meaning"), rows)

    def _changed(self) -> dict[str, Any]:
        """Return the bounds that differ from the default ones."""
        usual = type(self.supervisor)().values()
        return {name: value for name, value in self.supervisor.values().items() if value != usual[name]}


def _chosen(condition: Mask, yes: Any, no: Any) -> Any:
    """Return one of two states; most laws wait in the state that they have."""
    return no if yes is no else choose(condition, yes, no)


def _gone(v: Array) -> Array:
    """Return a smoothed velocity, zero where next to nothing is left of it.

    At rest it would halve for ever, and processors take long over the smallest numbers there are.
    """
    return np.where(np.abs(v) > SMALLEST, v, 0.0)
