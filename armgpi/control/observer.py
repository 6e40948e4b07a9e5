"""An extended state observer of the tracking error, and what the controllers that are built on it share.

Each joint's error is e'' = v + zeta, where v is the acceleration that the torque was made for and zeta what
disturbs it. The observer is exact for a held v and a zeta that is constant (order 3) or a ramp (order 4), and
all its poles are exp(-omega_o dt): Miklosovic, Radke, Gao, *Discrete Implementation and Generalization of the
Extended State Observer*, ACC 2006. It is given the v that was applied, so nothing winds up while the torque
is cut.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.bandwidth import ErrorSchedule, default_bandwidth, error_scales
from armgpi.control.controller import Controller, ControlStep, Measurement
from armgpi.references.reference import Target
from armgpi.registry import Context
from armgpi.robot.batch import AnyRobot, check_robot, check_same_joints

#: Default bandwidths: of the controller over that of GPI, of the observer over that of the controller. The
#: geometric mean of the five poles is then about the bandwidth of GPI, whose five are equal.
_SLOWER, _FASTER = 0.5, 4.0


class Estimate(NamedTuple):
    """What the observer knows.

    Attributes:
        e: tracking error [rad or m].
        rate: its derivative [rad/s or m/s].
        zeta: disturbance acceleration [rad/s^2 or m/s^2].
        slope: its derivative [rad/s^3 or m/s^3]; it stays zero in an observer of order 3.
    """

    e: Array
    rate: Array
    zeta: Array
    slope: Array


class ObserverGains(NamedTuple):
    """By what a difference between the measured and the expected error corrects the estimate.

    Attributes:
        e: of the error [-].
        rate: of its derivative [1/s].
        zeta: of the disturbance [1/s^2].
        slope: of its derivative [1/s^3].
    """

    e: Array
    rate: Array
    zeta: Array
    slope: Array


def observer_gains(omega_o: Array, dt: float, order: int = 3) -> ObserverGains:
    """Return the gains that place all poles of the observer at exp(-omega_o dt).

    Args:
        omega_o: bandwidth [rad/s], any shape.
        dt: sample time [s].
        order: 3 for a constant disturbance, 4 for a ramp.
    """
    b = np.exp(-omega_o * dt)
    c = 1.0 - b
    if order == 3:
        return ObserverGains(1.0 - b**3, 1.5 * c**2 * (1.0 + b) / dt, c**3 / dt**2, 0.0 * b)
    rate = c**2 * (11.0 + 14.0 * b + 11.0 * b**2) / (6.0 * dt)
    return ObserverGains(1.0 - b**4, rate, 2.0 * c**3 * (1.0 + b) / dt**2, c**4 / dt**3)


def correct_estimate(e: Array, expected: Estimate, gains: ObserverGains) -> Estimate:
    """Return the estimate after the error `e` was measured."""
    off = e - expected.e
    return Estimate(*(x + gain * off for x, gain in zip(expected, gains, strict=True)))


def expected_next(now: Estimate, v: Array, dt: float) -> Estimate:
    """Return what is expected of the next sample when `v` [rad/s^2] is applied until then."""
    pushed = now.zeta + v
    e = now.e + dt * (now.rate + dt * (0.5 * pushed + (dt / 6.0) * now.slope))
    rate = now.rate + dt * (pushed + (0.5 * dt) * now.slope)
    return Estimate(e, rate, now.zeta + dt * now.slope, now.slope)


class ObserverState(NamedTuple):
    """State of a controller with an observer.

    Attributes:
        expected: estimate for the next sample.
        own: what else the law remembers; None for nothing.
    """

    expected: Estimate
    own: Any


@with_parameters
class ObserverController(Controller):
    """A law on the estimates of an observer: tau = D^(q) v, or with the whole model cancelled.

    It measures positions alone.

    Attributes:
        omega_c: bandwidth of the controller [rad/s], shape (n,) or (batch, n).
        omega_o: bandwidth of the observer [rad/s], likewise.
        delay: transport delay in the loop [s]; only the default bandwidths depend on it.
        bias_robot: the robot whose C(q, v) v + G(q) is cancelled, if the law does so; `robot` when not given.
        cancels: whether it cancels them and adds the acceleration of the reference.
    """

    measurement_type: ClassVar[type[Measurement]] = Measurement
    cancels: ClassVar[bool] = False
    derived: ClassVar[Mapping[str, str]] = {"_gains": "gains of the observer"}

    omega_c: PerJoint = parameter(
        "bandwidth of the controller",
        unit="rad/s",
        default=None,
        none="half of what sample time and delay allow GPI",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(1.0, 200.0),
        slider=(1.0, 100.0),
    )
    omega_o: PerJoint = parameter(
        "bandwidth of the observer",
        unit="rad/s",
        default=None,
        none="four times omega_c",
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(4.0, 1000.0),
        slider=(4.0, 500.0),
    )
    delay: float = parameter("transport delay in the loop", unit="s", default=0.0, least=0.0, in_file=False)
    bias_robot: AnyRobot = field(default=None, kw_only=True)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Check the parameters and work out the gains of the observer.

        Raises:
            ParameterError: for a bad sample time or delay, or a `bias_robot` with other joints.
            ArrayError: for a bandwidth that is not positive or does not fit the joints.
            EffortError: when a joint has no torque.
        """
        check_robot(self.robot)
        self.check_parameters(self.robot.joint_names)
        self.fill("omega_c", _SLOWER * default_bandwidth(self.dt, self.delay) * np.ones(self.robot.n))
        self.fill("omega_o", _FASTER * self.omega_c)
        self.fill("bias_robot", self.robot)
        check_same_joints(self.bias_robot, "bias_robot", self.robot)
        super().__post_init__()
        self._gains = observer_gains(self.omega_o, self.dt, self.observer_order)

    @property
    def observer_order(self) -> int:
        """Order of the observer: 3 or 4."""
        return 3

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> ObserverController:
        """Return the controller; a scaled inertia varies D alone, as in the paper."""
        return cls(context.nominal, context.dt, **given, delay=context.delay, bias_robot=context.robot)

    def init(self, measurement: Measurement, target: Target) -> ObserverState:
        """Return the state before the first sample: the arm at rest, held; see :meth:`Controller.init`."""
        q = measurement.q
        e = q - target.q
        zero = np.zeros_like(e)
        zeta = zero
        if not self.cancels:  # then gravity is a disturbance
            zeta = zero - self.robot.dynamics.inertia_solve(q, self.limited(self.robot.dynamics.gravity(q)))
        return ObserverState(Estimate(e, zero, zeta, zero), self.remembered(zero))

    def step(self, measurement: Measurement, target: Target, state: ObserverState) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`."""
        q = measurement.q
        dynamics = self.robot.dynamics
        now = correct_estimate(q - target.q, state.expected, self.gains(state.own))
        v = self.law(now, target, state.own)
        if self.cancels:
            rate = target.v + now.rate
            asked = dynamics.inertia_times(q, target.a + v)
            asked = asked + self.bias_robot.dynamics.nonlinear_effects(q, rate)
        else:
            asked = dynamics.inertia_times(q, v)
        tau = self.limited(asked)
        missing = dynamics.inertia_solve(q, tau - asked)
        own = self.learned(now, target, missing, state.own)
        return ControlStep(tau, ObserverState(expected_next(now, v + missing, self.dt), own))

    @abstractmethod
    def law(self, now: Estimate, target: Target, own: Any) -> Array:
        """Return v [rad/s^2 or m/s^2]."""

    def gains(self, own: Any) -> ObserverGains:
        """Return the gains of the observer."""
        return self._gains

    def remembered(self, zero: Array) -> Any:
        """Return what the law remembers before the first sample; zero has the shape of the errors."""
        return None

    def learned(self, now: Estimate, target: Target, missing: Array, own: Any) -> Any:
        """Return what it remembers next, after v + `missing` was applied."""
        return None

    def signals(self, state: ObserverState) -> Mapping[str, Array]:
        """Return the estimates under their names."""
        return state.expected._asdict()


@with_parameters
class ScheduledController(ErrorSchedule, ObserverController):
    """v = -(omega^2 e + 2 zeta omega e' + zeta), and bandwidths that may rise with the error.

    They do as that of :class:`armgpi.GainSchedule`, with the same numbers, by the estimated error.
    """

    zeta_c: PerJoint = parameter(
        "damping ratio of the controller's poles",
        default=1.0,
        least=0.0,
        above=True,
        per_joint=True,
        key="zeta",
        search=(0.3, 2.0),
        kw_only=True,
    )
    rise: PerJoint = parameter(
        "how many times as fast controller and observer are where the error is large",
        default=None,
        none="as fast at any error",
        least=1.0,
        per_joint=True,
        search=(1.0, 5.0),
        kw_only=True,
    )

    def __post_init__(self) -> None:
        """Check the parameters; see :class:`ObserverController`."""
        super().__post_init__()
        self.check_leak(self.dt)

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> ObserverController:
        """Return the controller, with errors in counts; see :meth:`ObserverController.configured`."""
        return super().configured({**error_scales(context), **given}, context)

    def law(self, now: Estimate, target: Target, own: Any) -> Array:
        """Return v; `own` is by what share both bandwidths are above their lower ends."""
        omega = self.omega_c if own is None else self.omega_c * (1.0 + own)
        zeta = now.zeta + (0.5 * self.dt) * now.slope  # in the middle of the sample over which v is held
        v: Array = -(omega * (omega * now.e + 2.0 * self.zeta_c * now.rate) + zeta)
        return v

    def gains(self, own: Any) -> ObserverGains:
        """Return the gains of the observer, as fast as the controller is."""
        if own is None:
            return self._gains
        return observer_gains(self.omega_o * (1.0 + own), self.dt, self.observer_order)

    def remembered(self, zero: Array) -> Any:
        """Return that both bandwidths are at their lower ends; nothing without a schedule."""
        return None if self.rise is None else zero

    def learned(self, now: Estimate, target: Target, missing: Array, own: Any) -> Any:
        """Return by what share they are above them next; the same while the torque is cut."""
        if own is None:
            return None
        uncut = np.where(missing == 0.0, 1.0, 0.0)
        return self.raised(own, now.e, self.rise - 1.0, uncut, self.dt)


@with_parameters
class SmoothedController(ObserverController):
    """An observer's controller with a sign that is smoothed: x / (abs(x) + layer)."""

    layer: PerJoint = parameter(
        "width of the boundary layer in which the sign function is smoothed",
        unit="rad/s or m/s",
        default=0.05,
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(1e-3, 1.0),
        kw_only=True,
    )
