"""The paper's baseline: PID with dynamic inversion (computed torque), eqs. 32-33."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.controller import Controller, ControlStep, FullState
from armgpi.references.reference import Target
from armgpi.registry import Context
from armgpi.robot.batch import AnyRobot, check_robot, check_same_joints


class PIDState(NamedTuple):
    """State of the baseline.

    Attributes:
        integral: integral part of u up to the last sample, Ki int(e) [rad/s^2].
    """

    integral: Array


@with_parameters
class PIDInversion(Controller):
    """tau = D(q) (a* - u) + C(q, v) v + G(q), u = Kp e + Ki int(e) + Kd e' (eqs. 32-33).

    It needs measured velocities and the whole model; GPI needs neither.

    Attributes:
        kp: proportional gains [1/s^2], shape (n,) or (batch, n).
        ki: integral gains [1/s^3], likewise.
        kd: derivative gains [1/s], likewise.
        bias_robot: the robot whose C(q, v) v + G(q) is cancelled, `robot` when not given: the paper varies D
            alone, ``PIDInversion(robot.scaled_inertia(0.8), dt, bias_robot=robot)``.
    """

    measurement_type: ClassVar[type[FullState]] = FullState
    config_name: ClassVar[str | None] = "pid"
    knows: ClassVar[str] = "model"
    derived: ClassVar[Mapping[str, str]] = {
        "_kp_now": "gain of the error now: proportional, and half a sample of the integral [1/s^2]",
        "_ki_dt": "integral gain times the sample time [1/s^2]",
        "_back": "anti-windup [-]",
    }

    kp: PerJoint = parameter(
        "proportional gain",
        unit="1/s^2",
        default=400.0,
        least=0.0,
        per_joint=True,
        log=True,
        search=(1.0, 1e5),
        slider=(10.0, 1e4),
    )
    ki: PerJoint = parameter(
        "integral gain",
        unit="1/s^3",
        default=500.0,
        least=0.0,
        per_joint=True,
        log=True,
        search=(1.0, 1e6),
        slider=(10.0, 1e5),
    )
    kd: PerJoint = parameter(
        "derivative gain",
        unit="1/s",
        default=40.0,
        least=0.0,
        per_joint=True,
        log=True,
        search=(0.1, 1e3),
        slider=(1.0, 200.0),
    )
    bias_robot: AnyRobot = field(default=None, kw_only=True)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Check the parameters and work out what `step` needs of them.

        Raises:
            ParameterError: when dt is not positive.
            ArrayError: when a gain is negative or does not fit the joints.
            EffortError: when a joint has no torque.
        """
        check_robot(self.robot)
        self.fill("bias_robot", self.robot)
        check_same_joints(self.bias_robot, "bias_robot", self.robot)
        super().__post_init__()
        self._ki_dt = self.dt * self.ki
        self._kp_now = self.kp + 0.5 * self._ki_dt
        # Anti-windup by back-calculation with the tracking time Kp / Ki, but no less than a sample.
        with np.errstate(over="ignore"):
            self._back = np.minimum(self._ki_dt / np.maximum(self.kp, 1e-300), 1.0)

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> PIDInversion:
        """Return the controller; a scaled inertia varies D alone; see :meth:`Controller.configured`."""
        return cls(context.nominal, context.dt, **given, bias_robot=context.robot)

    def init(self, measurement: FullState, target: Target) -> PIDState:
        """Return the state before the first sample; see :meth:`Controller.init`."""
        return PIDState(integral=np.zeros_like(measurement.q - target.q))

    def step(self, measurement: FullState, target: Target, state: PIDState) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`."""
        q, v = measurement
        e = q - target.q
        # The trapezoidal rule: past samples count whole, the one now by half.
        u = self._kp_now * e + state.integral + self.kd * (v - target.v)  # eq. 33
        if self.bias_robot is self.robot:
            asked = self.robot.dynamics.inverse(q, v, target.a - u)  # eq. 32
        else:
            asked = self.robot.dynamics.inertia_times(
                q, target.a - u
            ) + self.bias_robot.dynamics.nonlinear_effects(q, v)
        tau = self.limited(asked)
        missing = self.robot.dynamics.inertia_solve(q, tau - asked)
        return ControlStep(tau, PIDState(state.integral + self._ki_dt * e - self._back * missing))
