"""The paper's baseline: PID with dynamic inversion (computed torque), eqs. 32-33."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.arrays import Array, PerJointInput, not_negative, per_joint
from armgpi.control.controller import Controller, ControlStep, FullState, common_batch
from armgpi.errors import ParameterError
from armgpi.references.reference import Target
from armgpi.robot.robot import AnyRobot


class PIDState(NamedTuple):
    """State of the baseline.

    Attributes:
        integral: integral part of u up to the last sample, Ki int(e) [rad/s^2].
    """

    integral: Array


class PIDInversion(Controller):
    """tau = D(q) (a* - u) + C(q, v) v + G(q), u = Kp e + Ki int(e) + Kd e' (eqs. 32-33).

    It needs measured velocities and the whole model; GPI needs neither.

    Attributes:
        kp: proportional gains [1/s^2], shape (n,) or (batch, n).
        ki: integral gains [1/s^3], likewise.
        kd: derivative gains [1/s], likewise.
        bias_robot: the robot whose C(q, v) v + G(q) is cancelled.
    """

    measurement_type: ClassVar[type[FullState]] = FullState

    def __init__(
        self,
        robot: AnyRobot,
        dt: float,
        kp: PerJointInput = 400.0,
        ki: PerJointInput = 500.0,
        kd: PerJointInput = 40.0,
        effort: PerJointInput | None = None,
        bias_robot: AnyRobot | None = None,
    ) -> None:
        """Define the controller.

        Args:
            robot: the robot that it believes in.
            dt: sample time [s].
            kp: proportional gains [1/s^2], a number, (n,) or (batch, n).
            ki: integral gains [1/s^3], likewise.
            kd: derivative gains [1/s], likewise.
            effort: torque limits [N m or N]; the robot's when not given.
            bias_robot: robot whose C and G are cancelled, `robot` when not given: the paper varies D alone,
                ``PIDInversion(robot.scaled_inertia(0.8), dt, bias_robot=robot)``.

        Raises:
            ParameterError: when dt is not positive.
            ArrayError: when a gain is negative or does not fit the joints.
            EffortError: when a joint has no torque.
        """
        super().__init__(robot, dt, effort)
        self.kp, self.ki, self.kd = (
            per_joint(gain, name, robot.joint_names, "zero or positive", not_negative)
            for name, gain in (("kp", kp), ("ki", ki), ("kd", kd))
        )
        self.bias_robot = robot if bias_robot is None else bias_robot
        if self.bias_robot.joint_names != robot.joint_names:
            joints = ", ".join(robot.joint_names)
            raise ParameterError("bias_robot", self.bias_robot, f"a robot with the joints {joints}")
        self.batch = common_batch(self.batch, self.bias_robot.batch, self.kp, self.ki, self.kd)
        self._ki_dt = self.dt * self.ki
        self._kp_now = self.kp + 0.5 * self._ki_dt
        # Anti-windup by back-calculation with the tracking time Kp / Ki, but no less than a sample.
        self._back = np.minimum(self._ki_dt / np.maximum(self.kp, 1e-300), 1.0)

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

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {
            **super().describe(),
            "kp": self.kp.tolist(),
            "ki": self.ki.tolist(),
            "kd": self.kd.tolist(),
            "robot": self.robot.provenance,
            "bias_robot": self.bias_robot.provenance,
        }

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"PIDInversion({self.robot.name!r}, dt={self.dt:g})"
