"""The checks of every sample, a class for each reason.

`fails` tells which joints fail. `nominal` yields conditions, per joint, under which the check can neither
fail nor begin to count: they are false of NaN, and little work, as most samples take no more. A check that
counts keeps a state in :class:`Watch`.
"""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from armgpi.base.arrays import LARGEST, Array
from armgpi.control.controller import Controller, FullState, Measurement
from armgpi.control.force_limit import FREE_FALL, ForceLimit
from armgpi.control.wrench import BANDWIDTH, OutsideTorque, WrenchState, downwards
from armgpi.errors import ArmgpiWarning
from armgpi.references.reference import Target
from armgpi.robot.batch import one_of
from armgpi.robot.frame_motion import Chain, FrameMotion, inner
from armgpi.robot.kinematics import random_configurations
from armgpi.supervisor.bounds import (
    COUNTS,
    FARTHEST,
    SMOOTHING,
    Bounds,
    Supervisor,
    frozen_samples,
    largest_gravity,
    own_inverse_inertia,
    proportional_gain,
    smoothing,
    turning,
)
from armgpi.supervisor.joints import (
    Mask,
    all_joints,
    any_joint,
    beyond,
    choose,
    largest,
    sum_joints,
    tightest,
)
from armgpi.supervisor.state import COUNTED, FrozenState, ResponseState, Sample, State, Watch

#: Velocities and accelerations beyond this are none [rad/s, rad/s^2 or m]. Set by hand.
_FASTEST = 1e6
#: Share of the reference's velocity above which a joint was in motion, and cannot stand still at once. Set by
#: hand, like the 0.1 beside it; tools/alarms.py counts what they stop.
_IN_MOTION = 0.5
#: Share of the last change that the smoothed velocity has where a joint goes on: more than one that swings
#: within five samples leaves at 1 and 2 ms. Set by hand.
_STEADY = 0.75
#: Errors below this, or :data:`COUNTS` counts, say nothing of how a joint answers its torque [rad or m]. Set
#: by hand: a fiftieth of what FOLLOWING allows.
ALERT = 0.01
#: Where less than that asks a stiff law for so much of the joint's torque limit, that is enough: such a law
#: drives an arm whose motor turns the other way away the faster (tools/faults.py --side motor).
_ALERT_SHARE = 0.05
#: What a sample counts in which the rate of torque limits it: a push takes a stiff law there as well.
_SLOW_SHARE = 0.5
#: Samples in which a joint has to answer, beside `response`. Set by hand: links on gears swing the wrong way
#: for 20 ms after a push, of 2 ms and three late; at 4 ms arms run away in ten (docs/supervisor.md).
_ANSWERS = 8
#: Time in which torques and what answers them are forgotten [s]: what changes faster is looked at. Set by
#: hand, as long as a push of half the motor's torque looks like a wrong sign (docs/supervisor.md).
_FORGOTTEN = 0.01
#: Changes of a torque that have to be answered, as a share of its limit. Set by hand: above what a count of a
#: 16-bit encoder moves under GPI.auto, 1 %.
_ASKED = 0.02
#: Share of its reference's velocity below which a joint stands [-]: a blocked one only twists its gear.
_STANDING = 0.5
#: How much faster than when it was found a joint that answers the wrong way may be, and still get a torque.
#: Set by hand: a motor that was wrongly accused stays below 2.5 times (tests/supervisor/test_supervisor.py).
_FASTER = 1.5

#: Configurations at which the rank of a Jacobian is looked at.
_RANK_CONFIGURATIONS = 8
#: Share of the largest singular value up to which one counts as zero.
_UNFELT = 1e-6


class NotFinite:
    """NOT_FINITE: a measurement is not finite, or farther or faster than any arm."""

    def __init__(self, law: Controller) -> None:
        self._velocities = law.measurement_type is FullState

    def nominal(self, measurement: Any) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        if self._velocities:  # positions are within their limits
            yield np.abs(measurement.v) <= _FASTEST

    def fails(self, measurement: Any) -> Mask:
        """Tell which joints fail."""
        wrong = beyond(measurement.q, FARTHEST)
        if self._velocities:
            wrong = wrong | beyond(measurement.v, _FASTEST)
        return wrong


class Jump:
    """JUMP: a measurement is not where its last change leads, or goes back all at once as fast as it came.

    Attributes:
        bounds: all bounds.
        pushed: half of what a push by half its motor's torque does [rad or m].
        driven: half of what all torques at their limits change of a motion in a sample [rad or m].
        share: one over the torque limits [1/(N m) or 1/N].
        apart: the smaller of both bounds, of the tightest joint [rad or m].
    """

    def __init__(self, law: Controller, bounds: Bounds) -> None:
        self.bounds = bounds
        self.pushed, self.driven = turning(law)
        self.share = 1.0 / law.effort
        self.apart = np.minimum(tightest(bounds.jump), tightest(bounds.turn))

    def nominal(self, change: Array, watch: Watch) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        yield np.abs(change - watch.change) <= self.apart

    def passes(self, change: Array, watch: Watch) -> Mask:
        """Tell which joints do not fail; one of NaN does."""
        # It went on for a while, and all at once goes back as fast: its encoder counts backwards.
        used_share = largest(self.share * np.abs(watch.tau))
        turn = np.maximum(self.bounds.turn, self.pushed + self.driven * used_share)
        last = np.abs(watch.change)
        samples = 1.0 + watch.bad
        steady = np.maximum(turn, _STEADY * last)
        was_fast: Mask = last > turn
        was_steady = watch.v * watch.change > steady * last
        back: Mask = was_fast & was_steady & (watch.late == 0.0)
        # One that turns round by itself, as on a gear that swings, was twice as fast a sample ago, or rested.
        back = back & (last > np.abs(watch.miss))
        not_reversed = np.abs(change + samples * watch.change)
        back = back & (not_reversed <= 0.25 * samples * last)
        # From where it was, or where its last change leads, as what moves fast goes on doing so.
        near: Mask = np.abs(change - watch.change) <= self.bounds.jump * samples
        return ~back & near


class Position:
    """POSITION: a joint is beyond its limits and the margin."""

    def __init__(self, bounds: Bounds) -> None:
        self._lower, self._upper = bounds.lower, bounds.upper

    def nominal(self, q: Array) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        yield q >= self._lower
        yield q <= self._upper

    def fails(self, q: Array) -> Mask:
        """Tell which joints fail."""
        return (q < self._lower) | (q > self._upper)


class ReferenceJump:
    """REFERENCE: the reference is not finite, or is not where its velocity leads."""

    def __init__(self, law: Controller, bounds: Bounds) -> None:
        self._step, self._tightest = bounds.step, tightest(bounds.step)
        self._used = _rates_used(law)  # what the law does not use need not be there

    def nominal(self, target: Target, watch: Watch) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        way = target.q - watch.r
        yield np.abs(way - watch.rv) <= self._tightest
        for rate in self._rates(target):
            yield np.abs(rate) <= _FASTEST

    def fails(self, target: Target, watch: Watch) -> Mask:
        """Tell which joints fail."""
        # By the way of the last sample: a smoothed speed lags, and makes an acceleration look like a step.
        samples = 1.0 + watch.bad
        way = target.q - watch.r
        wrong = beyond(way - samples * watch.rv, self._step * samples)
        for rate in self._rates(target):
            wrong = wrong | beyond(rate, _FASTEST)
        return wrong

    def _rates(self, target: Target) -> Iterator[Array]:
        """Yield velocity and acceleration of the reference, where the law uses them."""
        uses_velocity, uses_acceleration = self._used
        if uses_velocity:
            yield target.v
        if uses_acceleration:
            yield target.a


class Following:
    """FOLLOWING: a joint is too far from the reference."""

    def __init__(self, bounds: Bounds, response: Response) -> None:
        self._most = bounds.following
        # RESPONSE looks from its least error on: one comparison for both.
        looks = tightest(response.least) if response.samples else LARGEST
        self._nearest = np.minimum(tightest(bounds.following), looks)

    def nominal(self, e: Array) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        yield np.abs(e) <= self._nearest

    def fails(self, e: Array) -> Mask:
        """Tell which joints fail."""
        return np.abs(e) > self._most


class Speed:
    """SPEED: a joint is faster than its limit allows, by its smoothed velocity up to the last sample."""

    def __init__(self, bounds: Bounds, given: Supervisor) -> None:
        self._most, self._tightest = bounds.speed, tightest(bounds.speed)
        self._checked = given.speed is not None or given.speed_cap is not None

    def nominal(self, watch: Watch) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        if self._checked:
            yield np.abs(watch.v) <= self._tightest

    def fails(self, watch: Watch) -> Iterator[Mask]:
        """Yield which joints fail, where it is checked."""
        if self._checked:
            yield np.abs(watch.v) > self._most


class Workspace:
    """WORKSPACE: the tool leaves its box.

    Attributes:
        checked: whether there is a box.
        lower: its lowest x, y, z in the base frame [m].
        upper: its highest ones [m].
    """

    def __init__(self, given: Supervisor) -> None:
        self.checked = given.workspace is not None
        everywhere = ((-LARGEST,) * 3, (LARGEST,) * 3)
        lower, upper = given.workspace or everywhere
        self.lower = np.array(lower)
        self.upper = np.array(upper)

    def nominal(self, chain: Chain | None) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        if self.checked and chain is not None:
            yield all_joints((chain.position >= self.lower) & (chain.position <= self.upper))

    def fails(self, chain: Chain | None) -> Iterator[Mask]:
        """Yield whether the tool fails, (1,) or (batch, 1), where it is checked."""
        if self.checked and chain is not None:
            yield any_joint((chain.position < self.lower) | (chain.position > self.upper))


class _ToolLimit(ABC):
    """A size of the tool that has a largest value.

    Attributes:
        most: the limit, in the unit of :meth:`_sizes`, (1,).
    """

    most: Array

    @abstractmethod
    def _sizes(
        self, frame: FrameMotion | None, chain: Chain | None, q: Array, watch: Watch
    ) -> Iterator[Array]:
        """Yield what is compared with the limit, (1,) or (batch, 1), where it is checked."""

    def nominal(
        self, frame: FrameMotion | None, chain: Chain | None, q: Array, watch: Watch
    ) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        for size in self._sizes(frame, chain, q, watch):
            yield size <= self.most

    def fails(self, frame: FrameMotion | None, chain: Chain | None, q: Array, watch: Watch) -> Iterator[Mask]:
        """Yield whether the tool fails, (1,) or (batch, 1), where it is checked."""
        for size in self._sizes(frame, chain, q, watch):
            yield size > self.most


class ToolSpeed(_ToolLimit):
    """TOOL_SPEED: the tool is too fast, by the joints' smoothed velocities up to the last sample.

    Attributes:
        checked: whether there is a limit.
        most: square of it [m^2 per sample^2], (1,).
    """

    def __init__(self, law: Controller, given: Supervisor) -> None:
        self.checked = given.tool_speed is not None
        square = LARGEST
        if given.tool_speed is not None:
            square = (law.dt * given.tool_speed) ** 2
        self.most = np.array([square])

    def _sizes(
        self, frame: FrameMotion | None, chain: Chain | None, q: Array, watch: Watch
    ) -> Iterator[Array]:
        """Yield the square of its speed [m^2 per sample^2], (1,) or (batch, 1), where it is checked."""
        if self.checked and frame is not None and chain is not None:
            velocity = frame.moving(chain, q, watch.v).velocity
            yield inner(velocity, velocity)


def _warn_of_unfelt_directions(arm: Any, frame: str) -> None:
    """Warn where the joints' torques tell nothing of a force on a frame along some direction."""
    configurations = random_configurations(arm, _RANK_CONFIGURATIONS, seed=0)
    jacobians = arm.frame_jacobian(frame, configurations)[:, :3]
    singular_values = np.linalg.svd(jacobians, compute_uv=False)
    felt = singular_values > _UNFELT * singular_values.max()
    directions = int(felt.sum(axis=1).max())
    if directions < 3:
        text = (
            f"tool_force: the torques of the joints show a force on {frame!r} along {directions} of 3 "
            "directions at most; one along the others does not stop the arm"
        )
        warnings.warn(ArmgpiWarning(text), stacklevel=5)


class ToolForce(_ToolLimit):
    """TOOL_FORCE: what acts on the tool is more than its limit, whatever friction and the payload are.

    The force is estimated from torques and positions up to the last sample. Along its own direction friction,
    within its interval, and an unknown mass explain a part of it; what is left is compared.

    Attributes:
        most: the limit [N], (1,).
        outside: what estimates the torque from outside; None without a limit.
        weight: that the model may lack or have too much, in the base frame [N], (3,).
        unsure_force: what friction and that weight may be at the tool at rest [N], median over configurations
            away from singular ones, the worst direction of each; 0 without a limit.
    """

    def __init__(self, law: Controller, given: Supervisor) -> None:
        """Prepare the check; :meth:`measure` takes what depends on the tool.

        Args:
            law: the controller. The force is estimated with the model of its feedforward, `bias_robot`, if it
                has one of its own.
            given: the bounds.
        """
        self.unsure_force = 0.0
        limit = given.tool_force
        self.most = np.array([LARGEST if limit is None else limit])
        self.outside: OutsideTorque | None = None
        self.weight, self._length = np.zeros(3), 1.0
        if limit is not None:
            robot = getattr(law, "bias_robot", law.robot)
            self.outside = OutsideTorque(robot, law.dt, BANDWIDTH, given.friction_within)
            self.weight = given.uncertain_mass * FREE_FALL * downwards(one_of(robot))

    def measure(self, frame: FrameMotion, arm: Any) -> None:
        """Take the length of an arm, which makes forces and moments comparable, and what is unsure at rest.

        Warns where the joints feel no force along some direction, in any configuration.

        Args:
            frame: the tool.
            arm: the robot.
        """
        if self.outside is not None:
            self._length = frame.reach(arm)
            level = np.max(np.atleast_2d(self.outside.most_friction), axis=0)
            force = ForceLimit(arm, frame.frame, 1.0, None, level).force_of(arm, level)
            self.unsure_force = force + float(np.linalg.norm(self.weight))
            _warn_of_unfelt_directions(arm, frame.frame)

    def init(self, q: Array) -> WrenchState | None:
        """Return what is kept of an arm at rest; None without a limit."""
        return None if self.outside is None else self.outside.init(q)

    def after(self, q: Array, watch: Watch, waits: Mask | None = None) -> WrenchState | None:
        """Return what is kept after a sample; None without a limit.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
            watch: what was kept so far: its torque was applied since the last sample.
            waits: where nothing is learnt: brakes may hold the arm, or there is a gap, (1,) or (batch, 1).
        """
        if self.outside is None:
            return None
        after = self.outside.after(q, watch.tau, watch.wrench)
        if waits is None:
            return after
        waiting: WrenchState = choose(waits, watch.wrench._replace(q=q), after)
        return waiting

    def _sizes(
        self, frame: FrameMotion | None, chain: Chain | None, q: Array, watch: Watch
    ) -> Iterator[Array]:
        """Yield the least that the force may be [N], (1,) or (batch, 1), where it is checked."""
        if self.outside is None or frame is None or chain is None:
            return
        jacobian = frame.moving(chain, q, 0.0 * q).damped_jacobian(self._length)
        at_tool = np.matmul(jacobian.matrix, watch.wrench.residual[..., None])
        wrench: Any = np.linalg.solve(jacobian.square, at_tool)[..., 0]
        force = wrench[..., 0:3] * (1.0 / self._length)
        size = np.sqrt(np.maximum(inner(force, force), 1e-12))
        along = force / size
        # How each joint's torque counts along the force: what it does not know of them is a part of it.
        whole = np.concatenate([along, 0.0 * along], axis=-1) * (1.0 / self._length)
        counted: Any = np.linalg.solve(jacobian.square, whole[..., None])
        share = np.abs(np.matmul(jacobian.transposed, counted)[..., 0])
        unsure_friction = sum_joints(share * self.outside.unsure(watch.wrench))
        unsure_weight = np.abs(inner(along, self.weight + 0.0 * along))
        yield size - unsure_friction - unsure_weight


class Frozen:
    """FROZEN: a measurement repeats itself that should change.

    Attributes:
        samples: for which it may; 0 for no check.
        travel: of the reference, which asks a position to change [rad or m].
        sticking: change of torque that friction may hold a joint against [N m or N].
        braked: change in a sample of which friction may stop a joint at once [rad or m].
    """

    def __init__(self, law: Controller, given: Supervisor, bounds: Bounds, pushed: Array) -> None:
        self.samples = frozen_samples(law.dt) if given.frozen_samples is None else given.frozen_samples
        self.travel, self._tightest = bounds.travel, tightest(bounds.travel)
        self._lost = max(given.jump - 1.0, 0.0)
        # Where there is no torque limit, friction is no share of it; a limit that was lowered lessens none.
        motor = np.maximum(law.effort, 2.0 * largest_gravity(law))
        self.sticking = np.where(law.effort < LARGEST, given.sticking * motor, 0.0)
        self._effort = law.effort
        self.braked = 2.0 * (bounds.travel / COUNTS) + 4.0 * given.sticking * pushed

    def nominal(self, change: Array, r: Array, watch: Watch) -> Iterator[Mask]:
        """Yield what holds where nothing is wrong; see above."""
        reference_at_change = np.where(change != 0.0, r, watch.frozen.reference_at_change)
        yield np.abs(r - reference_at_change) <= self._tightest

    def count(self, unmoved: Mask, q: Array, r: Array, watch: Watch) -> tuple[Array, Array]:
        """Return the samples for which a measurement should have changed, and how far the reference is ahead.

        It should where, since it last did, the reference has moved on, or the torque has gone to its limit. A
        joint that is ahead of its reference waits for it.
        """
        mark = watch.frozen.reference_at_change
        above = np.minimum(r - mark, r - q)
        below = np.minimum(mark - r, q - r)
        ahead = np.maximum(above, below)
        should_move = unmoved & ((ahead > self.travel) | self._gone_to_limit(watch))
        return np.where(should_move, watch.frozen.unchanged_samples + 1.0, 0.0), ahead

    def _gone_to_limit(self, watch: Watch) -> Mask:
        """Tell which torques are at their limit, and were not near it when the measurement last changed."""
        gone = np.abs(watch.tau - watch.frozen.torque_at_change) > self.sticking
        return gone & (np.abs(watch.tau) >= self._effort)

    def fails(
        self, unmoved: Mask, unchanged_samples: Array, ahead: Array, gravity: Array, watch: Watch
    ) -> Mask:
        """Tell which joints fail, by the torque of gravity where they are."""
        if not self.samples:
            return unmoved & ~unmoved
        # A joint that moved with its reference cannot stand still at once: there is no need to wait. One that
        # starts, or turns round, has slow changes first, and may stick.
        far = ahead > self.travel + self._lost * np.abs(watch.rv)
        went = watch.change * watch.rv > _IN_MOTION * (watch.rv * watch.rv)
        is_steady = watch.v * watch.change > 0.1 * (watch.change * watch.change)
        moving = went & is_steady
        moving = moving & (np.abs(watch.change) > self.braked)
        # Friction holds a joint at rest until its torque has changed by more, towards the reference, beside
        # what gravity has: other joints change that.
        pull = watch.tau - gravity - watch.frozen.pull_when_asked
        towards_reference = pull * (watch.r - watch.q) > 0.0
        pulled = (np.abs(pull) > self.sticking) & towards_reference
        pulled = pulled | self._gone_to_limit(watch)
        # From the second sample on: in the first there is nothing to compare the pull with.
        too_long = unchanged_samples >= float(max(self.samples, 2))
        return (too_long & pulled) | (unmoved & far & moving)

    def after(self, untrusted: Mask, seen: Sample, r: Array, tau: Array, watch: Watch) -> FrozenState:
        """Return what is kept, by the reference that is followed and the torque that is sent."""
        before = watch.frozen
        samples = seen.unchanged_samples
        same = seen.q == watch.q
        pull = np.where(samples > 0.0, watch.tau - seen.gravity, 0.0)
        return FrozenState(
            np.where(untrusted, COUNTED, samples),
            np.where(same, before.reference_at_change, r),
            np.where(same, before.torque_at_change, tau),
            np.where(samples > 1.0, before.pull_when_asked, pull),
        )


class Saturated:
    """SATURATED: a torque is at its limit for too long."""

    def __init__(self, law: Controller, given: Supervisor) -> None:
        self._effort, self._most = law.effort, given.saturated / law.dt

    def at_limit(self, tau: Array, otherwise: float) -> Array:
        """Return 1 where a torque is at its limit."""
        return np.where(np.abs(tau) >= self._effort, 1.0, otherwise)

    def count(self, watch: Watch) -> Array:
        """Return the samples at the limit; those below it count back."""
        return np.maximum(watch.saturated_samples + self.at_limit(watch.tau, -1.0), 0.0)

    def fails(self, samples: Array) -> Mask:
        """Tell which joints fail."""
        return samples > (self._most or LARGEST)


class Response:
    """RESPONSE: a joint answers its torque the wrong way, and runs away from its reference.

    Torques and what answers them are compared by what is new in them: neither loads nor friction that stay
    are, and a push only while it begins. A motor that turns the other way is at every change.

    Attributes:
        samples: for which a joint may; 0 for no check.
        overpowered: what half of its motor's torque changes of a joint's motion in a sample [rad or m].
        least: errors that are worth a look [rad or m].
    """

    def __init__(self, law: Controller, given: Supervisor, bounds: Bounds) -> None:
        self.samples = 0
        if given.response:
            self.samples = _ANSWERS + math.ceil(given.response / law.dt - 1e-9)
        gain = proportional_gain(law)
        self._stiff, self._limited = gain is not None, given.torque_rate is not None
        enough = ALERT if gain is None else np.minimum(ALERT, _ALERT_SHARE * law.effort / gain)
        self.least = np.maximum(enough, bounds.travel)
        self._effort, inverse = law.effort, own_inverse_inertia(law)
        self._smoothing = smoothing(law.dt, SMOOTHING)
        self._forgotten = smoothing(law.dt, _FORGOTTEN)
        self.overpowered = 0.5 * law.dt**2 * np.minimum(law.effort, LARGEST) * inverse

    def fails(self, kept: ResponseState) -> Mask:
        """Tell which joints fail."""
        adverse = kept.adverse_samples
        return adverse > float(self.samples) if self.samples else adverse < 0.0

    def alert(self, opened: Mask, e: Array) -> Mask:
        """Tell whether any joint is far enough from its reference to say something, (1,) or (batch, 1)."""
        if not self.samples:
            return opened & ~opened
        far = np.abs(e) > self.least
        return any_joint(~opened & far)

    def looks_while_slow(self, cut: Mask, asked: Array) -> Mask:
        """Tell whether the model is asked though the rate cuts a torque, (1,) or (batch, 1).

        A stiff law asks for more than the rate as soon as a motor turns the other way.
        """
        if not self._stiff:
            return cut & ~cut
        return cut & ~any_joint(np.abs(asked) >= self._effort)

    def after(
        self,
        alert: Mask,
        looked: tuple[Mask, Mask],
        dead: Mask,
        model: Array,
        watch: Watch,
        e: Array,
        v: Array,
    ) -> ResponseState:
        """Return what is kept of how the joints answer their torques.

        While a torque is cut the model is not asked. A joint whose torque is at its limit answers the wrong
        way then when it accelerates as by a push of half that torque.

        Args:
            alert: see :meth:`alert`.
            looked: whether the model was asked as well, and whether that was while the rate of torque
                limited it, each (1,) or (batch, 1).
            dead: whether the loop is open for good, likewise.
            model: torque of the nominal model for the motion measured [N m or N].
            watch: what was kept so far.
            e: distance from the reference [rad or m].
            v: velocity, smoothed [rad or m per sample].
        """
        if not self.samples:
            return ResponseState(*(np.zeros_like(v),) * 4)
        before = watch.response
        looks, slow = looked
        started = before.model_torque_lowpass != 0.0
        smoothed = before.torque + self._smoothing * (watch.tau - before.torque)
        torque = np.where(started, smoothed, watch.tau)
        change = np.where(started, torque - before.torque_lowpass, 0.0)
        torque_lowpass = torque - change + self._forgotten * change
        answer = np.where(started, model - before.model_torque_lowpass, 0.0)
        model_torque = np.where(looks, model - answer + self._forgotten * answer, before.model_torque_lowpass)
        # The torque pushes back, and what it does is to push on.
        is_new = np.abs(change) > _ASKED * self._effort
        wrong = is_new & (change * e < 0.0) & (answer * e > 0.0)
        limited = np.abs(watch.tau) >= self._effort
        pushed = limited & (watch.tau * e < 0.0)
        pushed = pushed & ((v - watch.v) * e > self.overpowered * np.abs(e))
        # A joint that does not move while its reference does answers nothing: it is blocked.
        moves = np.abs(v) > _STANDING * np.abs(watch.rv)
        far = np.abs(e) > self.least
        leaves = (v - watch.rv) * e > 0.0
        wrong = np.where(looks, wrong, pushed) & far & leaves & moves
        counted = np.where(slow, _SLOW_SHARE, 1.0)
        once_more = np.maximum(before.adverse_samples, 1.0) + counted
        adverse = np.where(looks | limited, 1.0, before.adverse_samples)
        adverse = np.where(wrong, once_more, adverse)
        after = ResponseState(adverse, torque, torque_lowpass, model_torque)
        # Without the loop nothing new is learnt, and nothing forgotten.
        parts = []
        for learnt, old in zip(after, before, strict=True):
            unlearnt = np.where(dead, old, 0.0)
            parts.append(np.where(alert, learnt, unlearnt))
        return ResponseState(*parts)

    def accuses(self, watch: Watch) -> Mask:
        """Tell whether a motor is taken to turn the other way, and nothing speaks against it yet, (1,)."""
        going = (watch.status < float(State.FAULT)) | (watch.response.torque > 0.0)
        return any_joint(self.fails(watch.response) & going)

    def turned_round(
        self, dead: Mask, tau: Array, v: Array, watch: Watch, kept: ResponseState
    ) -> tuple[Array, ResponseState]:
        """Return the torque of joints that answer the wrong way turned round in FAULT, and what is kept.

        Turned round once more a motor brakes. If it was no motor that turns the other way, its joint is
        faster soon, and gets its torque as it is; where it gets faster still, none any more.
        """
        turned = dead & self.fails(kept)
        speed = np.abs(v)
        most = np.where(watch.status < float(State.FAULT), _FASTER * speed, watch.response.torque)
        if self._limited and self._stiff:
            # A torque that its rate keeps from turning round yet says nothing of how the joint answers it.
            waits = (most > 0.0) & (watch.tau * tau > 0.0)
            most = np.where(waits, np.maximum(most, _FASTER * speed), most)
        next_stage = np.where(most > 0.0, -_FASTER * speed, 0.0)
        most = np.where(speed > np.abs(most), next_stage, most)
        kept = kept._replace(torque=np.where(turned, most, kept.torque))
        as_it_is = np.where(most < 0.0, 1.0, 0.0)
        sign = np.where(most > 0.0, -1.0, as_it_is)
        return np.where(turned, sign * tau, tau), kept


def _rates_used(law: Controller) -> tuple[bool, bool]:
    """Tell whether a law uses velocity and acceleration of its reference: NaN shows in its torque."""
    robot: Any = law.robot
    shape = (robot.n,) if law.batch is None else (law.batch, robot.n)
    q = np.ascontiguousarray(np.broadcast_to(robot.middle(), shape))
    zero = np.zeros(shape)
    seen: Any = FullState(q, zero) if law.measurement_type is FullState else Measurement(q)
    nothing = np.full(shape, np.nan)
    try:
        with np.errstate(all="ignore"):
            state = law.init(seen, Target(q, zero, zero))
            without_velocity = law.step(seen, Target(q, nothing, zero), state).tau
            without_acceleration = law.step(seen, Target(q, zero, nothing), state).tau
    except Exception:  # a user's law may raise anything: whoever steps it learns why
        return True, True
    return bool(np.isnan(without_velocity).any()), bool(np.isnan(without_acceleration).any())
