"""Rivals of the contest on elastic arms that are no part of the package.

They are controllers of experiment files as all others: this module has to be imported before
``armgpi.config``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.bandwidth import ErrorSchedule, error_scales
from armgpi.control.controller import ControlStep, Measurement
from armgpi.control.observer import (
    Estimate,
    ObserverState,
    SmoothedController,
    correct_estimate,
    expected_next,
)
from armgpi.control.pid import PIDInversion
from armgpi.control.pid_positions import PIDPositions
from armgpi.references.reference import Target
from armgpi.registry import Context

#: Share of a body that counts as none [-].
_NOTHING = 1e-9
#: Acceleration that a column of the regressor counts in [rad/s^2].
_ACCELERATION = 10.0
#: Rate at which what Slotine-Li learned decays [1/s].
_LEAK = 1.0


class CascadeState(NamedTuple):
    """State of a cascade.

    Attributes:
        q: positions at the last sample [rad or m].
        v: filtered velocities [rad/s or m/s].
        integral: of the velocity's error, times its gain [rad/s^2].
        raised: by what share the gains are above their lower ends [-].
    """

    q: Array
    v: Array
    integral: Array
    raised: Array


@with_parameters
class Cascade(ErrorSchedule, PIDPositions):
    """A proportional position loop around a proportional-integral velocity loop, as drives have it.

    u = kv (v_f - v*) + kv kx (q - q*) + ki int(v_f - v* + kx (q - q*)) with v_f the filtered derivative of
    the measured position, and tau = J (a* - u) + C(q, v*) v* + G(q). J is constant: what each motor moves in
    the middle of the ranges. kx, kv and ki rise together with the error, as the gains of
    :class:`armgpi.GainSchedule`. Its `kp` is kx [1/s], `kd` kv [1/s], `ki` of the velocity's error [1/s^2].
    """

    config_name: ClassVar[str | None] = "cascade"

    rise: PerJoint = parameter(
        "how many times as fast it is where the error is large",
        default=1.5,
        least=1.0,
        per_joint=True,
        search=(1.0, 5.0),
        kw_only=True,
    )

    derived: ClassVar[Mapping[str, str]] = {
        **PIDInversion.derived,
        "_moved": "inertia that each motor moves [kg m^2 or kg]",
        "_decay": "of the velocity's filter over a sample [-]",
        "_drive": "from a step of the position into the filtered velocity [1/s]",
    }

    def __post_init__(self) -> None:
        """Check the parameters and work out the inertia; see :class:`PIDPositions`."""
        super().__post_init__()
        self.check_leak(self.dt)
        robot: Any = self.robot
        middle = robot.middle()
        middle = middle if self.batch is None else np.tile(middle, (self.batch, 1))
        self._moved = np.diagonal(robot.mass_matrix(middle), axis1=-2, axis2=-1).copy()

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> Cascade:
        """Return the controller, with errors in counts."""
        own = {**error_scales(context), **given}
        return cls(context.nominal, context.dt, **own, bias_robot=context.robot)

    def init(self, measurement: Any, target: Target) -> Any:
        """Return the state before the first sample, at rest."""
        q = measurement.q
        zero = np.zeros_like(q - target.q)
        return CascadeState(q + zero, zero, zero, zero)

    def step(self, measurement: Any, target: Target, state: Any) -> ControlStep:
        """Return torque and next state."""
        q = measurement.q
        v: Array = self._decay * state.v + self._drive * (q - state.q)
        e = q - target.q
        faster = 1.0 + state.raised
        beside = v - target.v + (self.kp * faster) * e
        u = (self.kd * faster) * beside + state.integral
        asked = self.torque(q, target, u)
        tau = self.limited(asked)
        uncut = np.where(tau == asked, 1.0, 0.0)
        integral = state.integral + uncut * (self.dt * self.ki) * faster * faster * beside
        raised = self.raised(state.raised, e, self.rise - 1.0, uncut, self.dt)
        return ControlStep(tau, CascadeState(q, v, integral, raised))

    def torque(self, q: Array, target: Target, u: Array) -> Array:
        """Return the torque of an acceleration beside the reference's."""
        _, rate, acceleration = (part + np.zeros_like(q) for part in target)
        known: Array = self.bias_robot.dynamics.inverse(q, rate, 0.0 * acceleration)
        return known + self._moved * (acceleration - u)

    def signals(self, state: Any) -> Mapping[str, Array]:
        """Return the states under their names."""
        return dict(state._asdict())


@with_parameters
class ModelCascade(Cascade):
    """The same with D(q) in place of the constant inertia: a PID with inversion, and a schedule."""

    config_name: ClassVar[str | None] = "cascade_model"

    def torque(self, q: Array, target: Target, u: Array) -> Array:
        """Return the torque of an acceleration beside the reference's."""
        _, rate, acceleration = (part + np.zeros_like(q) for part in target)
        known: Array = self.bias_robot.dynamics.inverse(q, rate, 0.0 * acceleration)
        return known + self.robot.dynamics.inertia_times(q, acceleration - u)


class Learned(NamedTuple):
    """What Slotine-Li learned, each joint's copy.

    Attributes:
        bodies: by what share each body is heavier than in the model [-], one (n,) for each.
        viscous: viscous friction, over the inertia [1/s].
        coulomb: Coulomb friction, over the inertia [rad/s^2].
    """

    bodies: tuple[Array, ...]
    viscous: Array
    coulomb: Array


@with_parameters
class SlotineLiRegressor(SmoothedController):
    """Slotine and Li (1987) with the arm's regressor: how heavy each body is, and friction of each joint.

    tau = Y(q, v, v_r, a_r) (1 + theta) - k D(q) s, theta' = -gamma Y^T s, with v_r = v* - omega_c e,
    s = v - v_r and v from an observer. A body's column of Y is the torque that it alone takes, masses and
    inertias in the proportions of the model: C(q, v) v_r is taken as C(q, u) u with u = (v + v_r) / 2, which
    is off by the square of s / 2. Each joint has a copy of theta, which keeps the proof of 1987.
    """

    config_name: ClassVar[str | None] = "slotineli_regressor"
    knows: ClassVar[str] = "model"
    cancels: ClassVar[bool] = True

    adaptation: PerJoint = parameter(
        "speed of adaptation over that of the feedback",
        default=0.25,
        least=0.0,
        per_joint=True,
        log=True,
        search=(0.001, 4.0),
        kw_only=True,
    )
    damping: PerJoint = parameter(
        "gain of s over omega_c",
        default=2.0,
        least=0.0,
        above=True,
        per_joint=True,
        search=(0.5, 4.0),
        kw_only=True,
    )

    def __post_init__(self) -> None:
        """Check the parameters and part the arm into its bodies."""
        super().__post_init__()
        arm: Any = self.bias_robot
        arm = getattr(arm, "base", arm)
        arm = arm.with_armature(np.zeros(arm.n))
        whole = np.array([body.toDynamicParameters() for body in arm._model.inertias[1:]])
        self._bodies = []
        for body in range(len(whole)):
            alone = _NOTHING * whole
            alone[body] = whole[body]
            self._bodies.append(arm.with_bodies(alone))
        robot: Any = self.robot
        middle = robot.middle()
        middle = middle if self.batch is None else np.tile(middle, (self.batch, 1))
        self._moved = np.diagonal(robot.mass_matrix(middle), axis1=-2, axis2=-1).copy()
        self._gamma_dt = self.adaptation * self.omega_c**2 * self.dt
        self._keep = max(1.0 - _LEAK * self.dt, 0.0)

    def remembered(self, zero: Array) -> Learned:
        """Return that nothing is learned."""
        return Learned(tuple(zero for _ in self._bodies), zero, zero)

    def law(self, now: Estimate, target: Target, own: Any) -> Array:
        """Return the acceleration of the feedback alone [rad/s^2]."""
        s = now.rate + self.omega_c * now.e
        v: Array = -self.omega_c * (now.rate + self.damping * s)
        return v

    def step(self, measurement: Measurement, target: Target, state: ObserverState) -> ControlStep:
        """Return torque and next state."""
        q, dynamics = measurement.q, self.robot.dynamics
        now = correct_estimate(q - target.q, state.expected, self._gains)
        rate = target.v + now.rate
        wanted_rate = target.v - self.omega_c * now.e
        wanted = target.a - self.omega_c * now.rate
        v = self.law(now, target, state.own)
        asked = dynamics.inertia_times(q, target.a + v)
        asked = asked + self.bias_robot.dynamics.nonlinear_effects(q, rate)
        middle = 0.5 * (rate + wanted_rate)
        columns = [body.dynamics.inverse(q, middle, wanted) for body in self._bodies]
        sign = rate / (np.abs(rate) + self.layer)
        learned: Learned = state.own
        for column, share in zip(columns, learned.bodies, strict=True):
            asked = asked + share * column
        asked = asked + self._moved * (learned.viscous * rate + learned.coulomb * sign)
        tau = self.limited(asked)
        missing = dynamics.inertia_solve(q, tau - asked)
        s = np.where(missing == 0.0, now.rate + self.omega_c * now.e, 0.0)
        step = self._gamma_dt * s
        # Columns are torques: over the inertia that a motor moves they adapt at the speed of the feedback.
        bodies = tuple(
            share - step * (column / (self._moved * _ACCELERATION**2))
            for share, column in zip(learned.bodies, columns, strict=True)
        )
        own = Learned(
            bodies,
            self._keep * learned.viscous - step * rate,
            self._keep * learned.coulomb - step * sign,
        )
        return ControlStep(tau, ObserverState(expected_next(now, v + missing, self.dt), own))

    def signals(self, state: Any) -> Mapping[str, Array]:
        """Return the estimates under their names."""
        return dict(state.expected._asdict())
