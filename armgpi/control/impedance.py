"""Impedance control from positions alone: the tool, or the joints, as springs of the specified stiffness.

A controller with integrators presses until it is there. These have none: they are the members of the family
without integrators, a spring and a damper on a filtered difference of the positions. Gravity and the rest of
the nominal model are fed forward, so the model has to be good: a payload that it does not have, and friction,
deflect the springs.

The damping is Rayleigh's, (alpha D(q) + beta K) q', which needs no inertia at the tool: a mode of the
natural frequency omega has the ratio (alpha / omega + beta omega) / 2. It is the specified one at a low and
at a high natural frequency of the arm, less by up to a third between them, and more beyond.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, as_float_array, check_number, check_type, new
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.bandwidth import FilteredDifference
from armgpi.control.controller import Controller, ControlStep, Measurement
from armgpi.control.elastic_limits import ElasticLoop
from armgpi.control.force_limit import CHANGE, LEVER, ForceBound, ForceLimit, fitted, limit_after
from armgpi.control.impedance_limits import ImpedanceLimits, LimitSearch, Mode
from armgpi.errors import ArrayError, ParameterError
from armgpi.references.reference import Target
from armgpi.registry import Context
from armgpi.robot.batch import one_of
from armgpi.robot.equations import add_smooth_friction
from armgpi.robot.frame_motion import FrameMotion, Motion, Pose, cross, inner
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Natural frequency of the joint springs where no stiffness is given [rad/s].
_USUAL = 10.0
#: Configurations over which natural frequencies are taken.
_CONFIGURATIONS = 40
#: Shares of all modes between which they have no more than the damping ratio that was asked for.
_SPREAD = (0.15, 0.85)
#: Bandwidths that are tried where none is given [rad/s], in this order: lower ones for encoders at links; the
#: last two, which pass more of the encoder's counts on, for late loops on elastic joints.
_FILTERS = (250.0, 180.0, 120.0, 85.0, 60.0, 42.0, 30.0, 20.0, 500.0, 1000.0)
#: The largest stiffness that is enough, over the specified one.
_SPARE = 2.0
#: The largest stiffness is told with this share of it.
_ROUNDED = 0.95
#: Square of a natural frequency below which there is no spring: the tool cannot move that way
#: [1/s^2].
_STILL = 1e-6
#: Time constant of the target that follows a hand [s].
_GUIDE = 0.05
#: Least share of the damping that is left where the stiffness goes to zero.
_LEAST_DAMPING = 0.3
#: Most by which a stiffness may be raised while it runs, where no limit is nearer.
_RAISED = 1e3
#: The posture's spring is the cause of a refusal where without it so many times as much is allowed [-].
_CAUSE = 1.1
#: Least share of the posture's stiffness that is looked at where it is refused [-].
_LEAST_POSTURE = 1e-3
#: Sine below which the logarithm of a rotation is its sine.
_SMALL = 1e-6


class ImpedanceState(NamedTuple):
    """State of an impedance controller.

    Attributes:
        e: position error of the last sample [rad or m].
        rate: filtered difference of it [rad/s or m/s].
        root: root of the stiffness now, (6,) of a tool, (n,) of joints; damping goes with it.
        goal: stiffness that it changes to, likewise.
        limit: largest force [N] or torques of the springs now; None without a limit.
        limit_goal: limit that it changes to; None likewise.
        offset: what is added to the positions of the target [rad or m].
        guided: 1 while a hand guides the arm, (1,).
        kept: 1 where the offset stays, 0 where it goes back to zero, (1,).
    """

    e: Array
    rate: Array
    root: Array
    goal: Array
    limit: Any
    limit_goal: Any
    offset: Array
    guided: Array
    kept: Array


@with_parameters
class Impedance(Controller):
    """What impedance controllers share: the filtered rate, the feedforward and the damping.

    Attributes:
        damping_ratio: of the lowest and of the highest mode [-].
        friction_feedforward: whether the nominal model's joint friction at the reference velocity is added.
        friction_smoothing: speed below which its sign is smoothed [rad/s or m/s].
        velocity_filter: bandwidth of the filtered difference [rad/s].
        delay: transport delay in the loop [s], besides the sample and hold.
    """

    measurement_type: ClassVar[type[Measurement]] = Measurement
    knows: ClassVar[str] = "model"
    compliant: ClassVar[bool] = True
    derived: ClassVar[Mapping[str, str]] = {
        "_decay": "share of the rate that a sample leaves [-]",
        "_drive": "from a difference of positions into the rate [1/s]",
        "_alpha": "damping in proportion to the inertia [1/s]",
        "_beta": "damping in proportion to the stiffness [s]",
        "_viscous": "viscous friction of the nominal model [N m s/rad or N s/m]",
        "_coulomb": "Coulomb friction of the nominal model [N m or N]",
        "_share": "share of a change of stiffness that a sample makes [-]",
        "_follows": "share of the way to the hand that a sample makes [-]",
        "_most": "largest stiffness",
        "_springs": "stiffness that was specified",
        "_roots": "roots of it",
        "_weights": "share of each spring in the damping",
    }

    damping_ratio: float = parameter(
        "damping ratio of the slowest and of the fastest mode",
        default=0.8,
        search=(0.4, 1.5),
        least=0.0,
        most=5.0,
        above=True,
        structural=True,
        kw_only=True,
    )
    friction_feedforward: bool = parameter(
        "add the nominal model's joint friction at the reference velocity",
        kind="flag",
        default=False,
        structural=True,
        kw_only=True,
    )
    friction_smoothing: float = parameter(
        "speed below which the sign of the reference velocity is smoothed",
        unit="rad/s or m/s",
        default=0.05,
        least=0.0,
        above=True,
        log=True,
        kw_only=True,
    )
    velocity_filter: float = parameter(
        "bandwidth of the filtered difference of the positions",
        unit="rad/s",
        default=None,
        none="250, and less where elastic joints require it",
        least=0.0,
        above=True,
        log=True,
        structural=True,
        kw_only=True,
    )
    delay: float = parameter(
        "transport delay in the loop", unit="s", default=0.0, least=0.0, in_file=False, kw_only=True
    )

    def __post_init__(self) -> None:
        """Check the parameters, and refuse a stiffness that the loop is too slow for.

        Raises:
            ParameterError: when the stiffness is beyond the largest one; it has that one.
            ArrayError: for a stiffness that does not fit.
        """
        super().__post_init__()
        self._viscous, self._coulomb = self.robot.friction
        self._dynamics = self.robot.dynamics
        arm = one_of(self.robot)
        self._prepare(arm)
        modes = self._modes(arm, random_configurations(arm, _CONFIGURATIONS, seed=0))
        squares = np.concatenate([mode.square for mode in modes])
        moving = squares[squares > _STILL]
        if not len(moving):
            raise ParameterError(
                "stiffness",
                np.asarray(vars(self)["stiffness"]).tolist(),
                "positive in a direction in which the tool can move",
            )
        slowest, fastest = np.sqrt(np.quantile(moving, _SPREAD)).tolist()
        alpha = 2.0 * self.damping_ratio * slowest * fastest / (slowest + fastest)
        beta = 2.0 * self.damping_ratio / (slowest + fastest)
        # Arrays are numbers of generated code, so that a page can move them.
        self._alpha = np.array([alpha])
        self._beta = np.array([beta])
        limits = self._choose_filter(modes, arm)
        self._limits = limits
        self._springs = np.array(vars(self)["stiffness"], dtype=np.float64)
        # What was specified is no more than it may be, however near to the bound.
        raised = min(_ROUNDED * limits.factor, _RAISED)
        self._most = max(1.0, raised) * self._springs
        self._roots = np.sqrt(self._springs)
        count = (self._springs > 0.0).sum(axis=-1, keepdims=True)
        softness = 1.0 / np.maximum(self._roots, 1e-150)
        self._weights = np.where(self._roots > 0.0, softness, 0.0) / count
        self._share = -np.expm1(-self.dt / CHANGE)
        self._follows = -np.expm1(-self.dt / _GUIDE)
        self._decay, self._drive = FilteredDifference.of(self.velocity_filter, self.dt)
        if not limits.factor >= 1.0:
            raise self._refusal(limits, modes, arm)

    def _refusal(self, found: ImpedanceLimits, modes: list[Mode], arm: Robot) -> ParameterError:
        """Return the refusal of a stiffness that the loop is too slow for, with what is allowed."""
        largest = "less than a thousandth of"
        if found.factor > 0.0:
            largest = f"at most {_ROUNDED * found.factor:.2g} times"
        return ParameterError("stiffness", self._springs.tolist(), f"{largest} that: {found.reason}")

    def _choose_filter(self, modes: list[Mode], arm: Robot) -> ImpedanceLimits:
        """Choose the filter where none is given, and return what may be asked for with it."""
        search = self._search(modes, arm)
        given: Any = self.velocity_filter
        if given is not None:
            return search.at(given)
        for bandwidth in _FILTERS:
            if search.allows(bandwidth, _SPARE):  # this takes far less than how much it allows
                found = search.at(bandwidth)
                if min(found.factor, found.link_factor) >= _SPARE:
                    self.fill("velocity_filter", bandwidth)
                    return found
        # First that it may have what is asked for, then room for encoders at the links.
        best, found = search.best(_FILTERS)
        self.fill("velocity_filter", best)
        return found

    def _search(self, modes: list[Mode], arm: Robot) -> LimitSearch:
        """Return the search of what may be asked for."""
        return self._search_of(modes, self._elastic(modes, arm))

    def _elastic(self, modes: list[Mode], arm: Robot) -> ElasticLoop | None:
        """Return the loop with elastic joints; None where joints are stiff."""
        return ElasticLoop.of([mode.springs for mode in modes], arm.drives, self.dt, self.delay)

    def _search_of(self, modes: list[Mode], elastic: ElasticLoop | None) -> LimitSearch:
        """Return the search of what may be asked for with elastic joints as they are given."""
        return LimitSearch(modes, self._alpha.item(), self._beta.item(), self.dt, self.delay, elastic)

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> Controller:
        """Return the controller; see :meth:`Controller.configured`."""
        return cls(context.nominal, context.dt, delay=context.delay, **given)

    @property
    def limits(self) -> ImpedanceLimits:
        """What may be asked for: the largest stiffness, and the stiffest wall without damping."""
        return self._limits

    def largest_factor(self, at_link: bool = False) -> float:
        """Return the largest stiffness over the specified one with the filter that suits it best [-].

        Args:
            at_link: take encoders of which nothing tells the side to sit at the links.
        """
        return self.largest_factors()[int(at_link)]

    def largest_factors(self) -> tuple[float, float]:
        """Return :meth:`largest_factor` as it is enforced, and for encoders at the links [-]."""
        arm = one_of(self.robot)
        modes = self._modes(arm, random_configurations(arm, _CONFIGURATIONS, seed=0))
        return self._search(modes, arm).largest(_FILTERS)

    def init(self, measurement: Measurement, target: Target) -> ImpedanceState:
        """Return the state before the first sample, at rest; see :meth:`Controller.init`."""
        e = measurement.q - target.q
        zero = 0.0 * e[..., :1]
        stiffness, limit = zero + self._springs, self._first_limit(zero)
        still = np.zeros_like(e)
        return ImpedanceState(e, still, np.sqrt(stiffness), stiffness, limit, limit, still, zero, zero)

    def changed(
        self,
        state: ImpedanceState,
        stiffness: Any = None,
        limit: Any = None,
        guided: bool | None = None,
        moved: Any = None,
    ) -> ImpedanceState:
        """Return a state from which on it has another stiffness, limit or target, without a step of torque.

        Stiffness and limit go to their new values with a time constant of 0.1 s; a limit that is more than
        twice as large grows e times in 0.1 s. What is not given stays.

        Args:
            state: of the running controller.
            stiffness: as the constructor takes it, up to the largest one; 0 lets the arm go.
            limit: force limit [N] or torque limit; of a controller that has one.
            guided: True lets a hand guide the arm: the springs are gone, and the target follows the arm.
                False ends that: the arm stays where it was left.
            moved: old minus new positions of the target [rad or m], (n,): the target was set elsewhere at
                once. The wished position stays, and goes to the new one with the time constant. Zeros let
                an arm that was guided go back to its target.

        Raises:
            ParameterError: for a stiffness that is not from 0 to the largest, a limit that is not positive,
                or one of a controller without.
            ArrayError: when a shape does not fit.
        """
        new_parts: dict[str, Any] = {}
        if stiffness is not None:
            new_parts["goal"] = self._checked(stiffness, state.goal)
        if limit is not None:
            if state.limit is None:
                raise ParameterError("limit", limit, "left out of a controller without a limit")
            value = as_float_array(limit, "limit")
            if not (value > 0.0).all():
                raise ParameterError("limit", value.tolist(), "positive")
            new_parts["limit_goal"] = fitted(value, state.limit, "limit")
        if guided is not None:
            check_type(guided, "guided", bool, "True or False")
            now = np.full_like(state.guided, float(guided))
            new_parts |= {"guided": now, "kept": np.ones_like(now)}
        if moved is not None:
            by = fitted(as_float_array(moved, "moved"), state.offset, "moved")
            # The last error is one from the new target: what was set elsewhere is no motion to be damped.
            new_parts["e"] = state.e + by
            new_parts["offset"] = state.offset + by
            new_parts["kept"] = np.zeros_like(state.kept)
        return state._replace(**new_parts)

    def _checked(self, stiffness: Any, like: Array) -> Array:
        """Return a stiffness that the loop is fast enough for."""
        value = fitted(as_float_array(stiffness, "stiffness"), like, "stiffness")
        allowed = (value >= 0.0) & (value <= self._most)
        if not allowed.all():
            most = np.asarray(self._most).tolist()
            raise ParameterError("stiffness", value.tolist(), f"from 0 to the largest one, {most}")
        return value

    def signals(self, state: ImpedanceState) -> Mapping[str, Array]:
        """Return the filtered rate of the error."""
        return {"rate": state.rate}

    def _moved(self, q: Array, target: Target, state: ImpedanceState) -> ImpedanceState:
        """Return the state at a measured position."""
        e = q - target.q
        rate = self._decay * state.rate + self._drive * (e - state.e)
        free = 1.0 - state.guided
        wanted = np.minimum(np.maximum(state.goal, 0.0), self._most) * free
        root = state.root + self._share * (np.sqrt(wanted) - state.root)
        limit = state.limit
        if limit is not None:
            limit = limit_after(limit, state.limit_goal, self._share)
        back = self._share * free * (1.0 - state.kept)
        follows = self._follows * state.guided
        offset = state.offset + follows * (e - state.offset) - back * state.offset
        parts = (e, rate, root, state.goal, limit, state.limit_goal, offset, state.guided, state.kept)
        return new(ImpedanceState, parts)

    def _damping(self, root: Array) -> tuple[Array, Array]:
        """Return alpha [1/s], (..., 1), and beta K of the root of a stiffness: damping goes with it."""
        share: Any = 0.0
        for i in range(root.shape[-1]):
            share = share + self._weights[..., i : i + 1] * root[..., i : i + 1]
        alpha = self._alpha * np.maximum(share, _LEAST_DAMPING)
        damping = self._beta * root * self._roots
        return alpha, damping

    def _ahead(self, q: Array, target: Target, rate: Array, alpha: Array) -> Array:
        """Return the model's torque along the reference, less the damping in proportion to the inertia."""
        _, v, a = (part + np.zeros_like(q) for part in target)  # one reference may be for a whole batch
        tau = self._dynamics.inverse(q, v, a - alpha * rate)
        if self.friction_feedforward:
            tau = add_smooth_friction(tau, v, self._viscous, self._coulomb, self.friction_smoothing)
        return tau

    @abstractmethod
    def _first_limit(self, zero: Array) -> Any:
        """Return the limit of the springs before the first sample; None without one."""

    @abstractmethod
    def _prepare(self, arm: Robot) -> None:
        """Check the stiffness, and keep what the springs need."""

    @abstractmethod
    def _modes(self, arm: Robot, configurations: Array) -> list[Mode]:
        """Return the modes of the springs in some configurations."""


@with_parameters
class JointImpedance(Impedance):
    """Every joint as a spring: tau = model(q, v*, a*) - K (q - q*) - damping.

    Attributes:
        stiffness: of the joints [N m/rad or N/m]; that of 10 rad/s with each joint's inertia when not given.
        torque_limit: of the springs [N m or N]; none when not given.
    """

    config_name: ClassVar[str | None] = "joint_impedance"

    stiffness: PerJoint = parameter(
        "stiffness of the joints",
        unit="N m/rad or N/m",
        default=None,
        none="that of 10 rad/s",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        key="joint_stiffness",
    )
    torque_limit: PerJoint = parameter(
        "largest torque of the springs",
        unit="N m or N",
        default=None,
        none="no limit",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        key="spring_torque",
    )

    def _prepare(self, arm: Robot) -> None:
        """Choose the stiffness where none is given."""
        given: Any = self.stiffness
        if given is None:
            inertias = arm.mass_matrix(random_configurations(arm, _CONFIGURATIONS, seed=0))
            own = np.median(np.diagonal(inertias, axis1=1, axis2=2), axis=0)
            self.keep("stiffness", _USUAL * _USUAL * own)

    def step(self, measurement: Measurement, target: Target, state: ImpedanceState) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`."""
        q = measurement.q
        state = self._moved(q, target, state)
        alpha, damping = self._damping(state.root)
        spring = -state.root * state.root * (state.e - state.offset)
        if state.limit is not None:
            spring = np.minimum(np.maximum(spring, -state.limit), state.limit)
        tau = self._ahead(q, target, state.rate, alpha) + spring - damping * state.rate
        return new(ControlStep, (self.limited(tau), state))

    def _first_limit(self, zero: Array) -> Any:
        """Return the largest torques of the springs; None without a limit."""
        limit: Any = self.torque_limit
        return None if limit is None else zero + limit

    def _modes(self, arm: Robot, configurations: Array) -> list[Mode]:
        """Return the modes of the joint springs."""
        stiffness = np.median(np.atleast_2d(self.stiffness), axis=0)
        return [Mode.of(arm.mass_matrix(q), np.diag(stiffness), arm.n) for q in configurations]


@with_parameters
class CartesianImpedance(Impedance):
    """The tool as a spring: tau = model(q, v*, a*) + J' F - damping + null space, F = -K (x - x*).

    The wished pose is that of the target's joints, and the rotation error is the logarithm of R R*'.
    Stiffness and forces are in the base frame. A posture spring in the null space of the tool, for arms with
    more than six joints, goes to the target's joints.

    Attributes:
        frame: the frame that is the tool; the robot's tip when not given.
        stiffness: of x, y, z [N/m] and of rotations about x, y, z [N m/rad].
        nullspace_stiffness: of the posture [N m/rad or N/m].
        force_limit: largest force of the spring [N], none when not given; its moment is limited to 0.2 m
            times it. Inertia, damping and friction come on top, and the impact at the speed of the approach:
            it is no safety function.
    """

    config_name: ClassVar[str | None] = "cartesian_impedance"

    frame: str | None = parameter(
        "frame that is the tool", kind="text", default=None, none="the tip", key="tool_frame"
    )
    stiffness: Array = parameter(
        "stiffness of x, y, z [N/m] and of rotations about x, y, z [N m/rad]",
        unit="N/m and N m/rad",
        kind="numbers",
        default=(500.0, 500.0, 500.0, 30.0, 30.0, 30.0),
    )
    nullspace_stiffness: float = parameter(
        "stiffness of the posture in the null space",
        unit="N m/rad or N/m",
        default=10.0,
        least=0.0,
        structural=True,
    )
    force_limit: float = parameter(
        "largest force of the spring, beyond damping and friction",
        unit="N",
        default=None,
        none="no limit",
        least=0.0,
        above=True,
        log=True,
    )

    def _prepare(self, arm: Robot) -> None:
        """Check the stiffness, and find the tool.

        Raises:
            NameNotFound: when there is no such frame.
        """
        stiffness = np.asarray(self.stiffness)
        if stiffness.shape != (6,):
            raise ArrayError("stiffness", f"expected six numbers, got shape {stiffness.shape}")
        if not (stiffness >= 0.0).all() or not stiffness.any():
            raise ParameterError("stiffness", stiffness.tolist(), "zero or positive, and not all zero")
        self._linear = stiffness[:3].copy()
        self._angular = stiffness[3:].copy()
        self._motion = FrameMotion(arm, self.frame or arm.tip)
        self._length = self._motion.reach(arm)
        self._redundant = arm.n > 6 and self.nullspace_stiffness > 0.0

    def force_bound(self, depth: float | None = None, **given: Any) -> ForceBound:
        """Return what the tool presses with at rest; see :meth:`armgpi.GPI.force_bound`.

        Without a force limit it presses with the stiffest spring times `depth`, and with friction and unknown
        weight. These may push aside a tool whose springs differ by direction, and count up to
        (k + 1) / (2 sqrt(k)) times then, with k the ratio of the stiffest to the softest one: on a surface
        with the normal n at rest, n' K^-1 (f n - r) is the depth, of the force f and what friction and weight
        are at the tool, r.

        Args:
            depth: how deep the target is behind a surface without friction, which is hit [m].
            **given: as with a force limit.

        Raises:
            ParameterError: when there is neither a force limit nor a depth, for a depth that is negative, or
                where the softest spring has no stiffness.
        """
        limit: Any = self.force_limit
        behind = 0.0 if depth is None else check_number(depth, "depth", "zero or positive [m]")
        aside = 1.0
        if limit is None and depth is None:
            raise ParameterError("force_limit", None, "given where the force is to be bounded, or a depth")
        if limit is None:
            softest, stiffest = float(self._linear.min()), float(self._linear.max())
            if softest == 0.0:
                raise ParameterError("stiffness", self._linear.tolist(), "positive along x, y and z")
            limit = stiffest * behind
            aside = 0.5 * (stiffest + softest) / math.sqrt(stiffest * softest)
        else:
            behind = 0.0
        arm = one_of(self.robot)
        bound = ForceLimit(arm, self._motion.frame, limit, None, self._coulomb).bound(arm, **given)
        friction, weight = aside * bound.friction, aside * bound.gravity
        total = bound.limit + friction + weight
        # A spring yields: nothing limits its speed.
        return bound._replace(friction=friction, gravity=weight, total=total, push=math.nan, depth=behind)

    def step(self, measurement: Measurement, target: Target, state: ImpedanceState) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`."""
        q = measurement.q
        state = self._moved(q, target, state)
        return new(ControlStep, (self._torque(q, target, state), state))

    def _torque(self, q: Array, target: Target, state: ImpedanceState) -> Array:
        """Return the torque within the effort limits [N m or N], for a state of this sample.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
            target: what is asked for, likewise.
            state: with the rate of the error in it, measured or filtered.
        """
        motion = self._motion.at(q, state.rate)
        alpha, damping = self._damping(state.root)
        wished = self._motion.pose(target.q + state.offset)
        spring = self._spring(motion, wished, state)
        force = spring[0] - damping[..., :3] * motion.velocity
        moment = spring[1] - damping[..., 3:] * motion.rate
        tau = self._ahead(q, target, state.rate, alpha) + motion.torque(q, force, moment)
        if self._redundant:
            posture = self._in_null_space(motion, state.e - state.offset)
            tau = tau - self.nullspace_stiffness * posture
        return self.limited(tau)

    def _first_limit(self, zero: Array) -> Any:
        """Return the largest force of the spring; None without a limit."""
        limit: Any = self.force_limit
        return None if limit is None else zero + limit

    def _spring(self, motion: Motion, wished: Pose, state: ImpedanceState) -> tuple[Array, Array]:
        """Return force [N] and moment [N m] of the spring."""
        stiffness = state.root * state.root
        linear, angular = stiffness[..., :3], stiffness[..., 3:]
        force = -linear * (motion.position - wished.position)
        moment = -angular * rotation_between(motion.rotation, wished.rotation)
        if state.limit is None:
            return force, moment
        return _shortened(force, state.limit), _shortened(moment, LEVER * state.limit)

    def _in_null_space(self, motion: Motion, e: Array) -> Array:
        """Return the part of a joint error that does not move the tool [rad or m]."""
        jacobian = motion.damped_jacobian(self._length)
        twist = np.matmul(jacobian.matrix, e[..., None])
        solved = np.linalg.solve(jacobian.square, twist)
        still: Array = e - np.matmul(jacobian.transposed, solved)[..., 0]
        return still

    def _refusal(self, found: ImpedanceLimits, modes: list[Mode], arm: Robot) -> ParameterError:
        """Return the refusal; it names the posture's stiffness where that is the cause."""
        elastic = self._elastic(modes, arm)
        if elastic is None or not self._redundant:
            return super()._refusal(found, modes, arm)
        # The filter is the one that was given, or suits the refused springs: without the posture, others may.
        filters = (self.velocity_filter, *_FILTERS)
        bandwidth, free = self._search_of(modes, elastic.with_posture(0.0)).best(filters)
        if free.factor <= _CAUSE * found.factor:
            return super()._refusal(found, modes, arm)
        if free.factor < 1.0:
            largest = f"at most {_ROUNDED * free.factor:.2g} times that with nullspace_stiffness=0"
            return ParameterError("stiffness", self._springs.tolist(), f"{largest}: {found.reason}")
        share = 1.0
        while share > _LEAST_POSTURE:
            share = share / 2.0
            if self._search_of(modes, elastic.with_posture(share)).allows_specified(bandwidth):
                break
        else:
            share = 0.0
        allowed = _ROUNDED * share * self.nullspace_stiffness
        expected = f"at most {allowed:.2g} for this stiffness: {found.reason}"
        return ParameterError("nullspace_stiffness", self.nullspace_stiffness, expected)

    def _modes(self, arm: Robot, configurations: Array) -> list[Mode]:
        """Return the modes of the tool's spring."""
        weights = np.concatenate([self._linear, self._angular])
        modes = []
        for q in configurations:
            jacobian = arm.frame_jacobian(self._motion.frame, q)
            stiffness = jacobian.T @ (weights[:, None] * jacobian)
            count = min(int((weights > 0.0).sum()), arm.n)
            inertia, posture = arm.mass_matrix(q), self._posture(q)
            modes.append(Mode.of(inertia, stiffness, count, jacobian[:3], posture))
        return modes

    def _posture(self, q: Array) -> Array | None:
        """Return the stiffness of the posture in the null space, (n, n); None without one."""
        if not self._redundant:
            return None
        jacobian = self._motion.at(q, 0.0 * q).damped_jacobian(self._length)
        moves_tool = jacobian.transposed @ np.linalg.solve(jacobian.square, jacobian.matrix)
        null_space = np.eye(len(q)) - moves_tool
        return np.asarray(self.nullspace_stiffness * null_space)


def rotation_between(actual: Array, wished: Array) -> Array:
    """Return the rotation vector [rad] of R R*', elementwise.

    Args:
        actual: R, rotation matrices (..., 3, 3).
        wished: R*, likewise.

    Returns:
        The logarithm in the base frame, (..., 3): 0 at exactly half a turn, where it has no direction.
    """
    sine: Any = 0.0
    trace: Any = 0.0
    for column in range(3):
        wished_axis, actual_axis = wished[..., :, column], actual[..., :, column]
        sine = sine + 0.5 * cross(wished_axis, actual_axis)
        trace = trace + inner(wished_axis, actual_axis)
    length = _length_of(sine)
    # 1 + cos(angle), and tan(angle / 2) = sin / (1 + cos).
    one_and_cosine = np.maximum(0.5 * (trace + 1.0), 1e-12)
    angle = 2.0 * np.arctan(length / one_and_cosine)
    angle_over_sine = angle / np.maximum(length, _SMALL)
    rotation: Array = sine * np.where(length > _SMALL, angle_over_sine, 1.0)
    return rotation


def _shortened(vector: Array, most: Any) -> Array:
    """Return vectors (..., 3) of at most a length."""
    length = np.maximum(_length_of(vector), 1e-9)
    shorter: Array = vector * np.minimum(1.0, most / length)
    return shorter


def _length_of(vector: Array) -> Array:
    """Return the lengths of vectors (..., 3), (..., 1)."""
    length: Array = np.sqrt(inner(vector, vector))
    return length
