"""The wrench at the tool, estimated from torques and positions: no force sensor, no velocity.

A filtered difference of the positions gives velocity and acceleration. The torque that they and gravity need,
less that of the motors, acts from outside. Motors, gravity and friction are one sum: at rest friction holds
back anything up to its level, so 5 N of a hand and 5 N of friction are the same number. That is what the
intervals are for: they contain every wrench that friction within its interval, and an unknown mass at the
tool, can explain. Errors of the other masses count in fast motions, and are not in them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import SMALLEST, Array, ArrayLike, as_joint_array, check_number, check_type
from armgpi.control.bandwidth import FilteredDifference
from armgpi.control.force_limit import FREE_FALL, KNOWN_WITHIN, USUAL_WITHIN, usual_friction
from armgpi.robot.batch import AnyRobot, one_of
from armgpi.robot.frame_motion import FrameMotion
from armgpi.robot.robot import Robot

#: Bandwidth of the filters where none is given [rad/s]: counts of encoders are differenced twice.
BANDWIDTH = 30.0
#: Speed below which the sign of a joint's friction is not known [rad/s or m/s].
_STILL = 0.02


class ToolWrench(NamedTuple):
    """A wrench on the tool, in the base frame, and what it may be; arrays (..., 3).

    Attributes:
        force: estimate [N].
        force_low: lower ends of its intervals [N].
        force_high: upper ends [N].
        moment: estimate [N m].
        moment_low: lower ends [N m].
        moment_high: upper ends [N m].
    """

    force: Array
    force_low: Array
    force_high: Array
    moment: Array
    moment_low: Array
    moment_high: Array


class WrenchState(NamedTuple):
    """What the estimate remembers, arrays (..., n).

    Attributes:
        q: positions of the last sample [rad or m].
        rate: their filtered difference [rad/s or m/s].
        torque: torque of the motors, filtered likewise [N m or N].
        residual: torque from outside [N m or N].
    """

    q: Array
    rate: Array
    torque: Array
    residual: Array


class WrenchStep(NamedTuple):
    """Result of a sample.

    Attributes:
        wrench: the estimate.
        state: the next state.
    """

    wrench: ToolWrench
    state: WrenchState


class OutsideTorque:
    """The torque of the joints from outside, sample by sample; elementwise, so that it becomes C as it is.

    Attributes:
        friction: the joints' Coulomb friction that it counts on [N m or N], (n,) or (batch, n).
        most_friction: the upper ends of its intervals, likewise.
    """

    derived: ClassVar[Mapping[str, str]] = {"_viscous": "viscous friction of the joints [N m s/rad or N s/m]"}

    def __init__(self, robot: AnyRobot, dt: float, bandwidth: float, friction_within: float) -> None:
        """Take the friction from the model.

        Args:
            robot: the model, or one for each rollout.
            dt: sample time [s].
            bandwidth: of the filters [rad/s].
            friction_within: factor within which Coulomb friction is known; of a model without any, 0 to 6 %
                of the effort are reckoned with.
        """
        self._dynamics, self._dt = robot.dynamics, dt
        self._decay, self._drive = FilteredDifference.of(bandwidth, dt)
        self._viscous, self.friction = robot.friction
        self.most_friction = friction_within * self.friction
        without = ~self.friction.any(axis=-1, keepdims=True)
        if without.any():  # of a batch each arm is judged as it is alone
            usual = USUAL_WITHIN * usual_friction(one_of(robot))
            self.most_friction = np.where(without, usual, self.most_friction)

    def init(self, q: Array) -> WrenchState:
        """Return the state of an arm at rest, held by its motors; arguments as of :meth:`after`."""
        zero = np.zeros_like(q)
        return WrenchState(q, zero, self._dynamics.gravity(q), zero)

    def after(self, q: Array, applied: Array, state: WrenchState) -> WrenchState:
        """Return the next state.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
            applied: torque of the motors since the last sample [N m or N], likewise.
            state: of the last sample.
        """
        rate = self._decay * state.rate + self._drive * (q - state.q)
        # At rest it would halve for ever, and processors take long over the smallest numbers there are.
        rate = np.where(np.abs(rate) > SMALLEST, rate, 0.0)
        torque = self._decay * state.torque + (1.0 - self._decay) * applied
        needed = self._dynamics.inverse(q, rate, (rate - state.rate) / self._dt)
        rubbing = self._viscous * rate + self.friction * np.tanh(rate / _STILL)
        outside = needed + rubbing - torque
        residual = self._decay * state.residual + (1.0 - self._decay) * outside
        return WrenchState(q, rate, torque, residual)

    def unsure(self, state: WrenchState) -> Array:
        """Return what friction leaves unknown of each joint's torque [N m or N].

        In motion friction is known within its interval, at rest it may be anything up to its level.
        """
        unsure: Array = self.most_friction - self.friction * np.abs(np.tanh(state.rate / _STILL))
        return unsure


class WrenchEstimator:
    """Estimates what acts on the tool, sample by sample, from positions and torques.

    Attributes:
        robot: the model.
        dt: sample time [s].
        frame: the frame that is the tool.
        friction: the joints' Coulomb friction that it counts on [N m or N], (n,).
        most_friction: the upper ends of its intervals, (n,).
    """

    def __init__(
        self,
        robot: Robot,
        dt: float,
        frame: str | None = None,
        bandwidth: float = BANDWIDTH,
        friction_within: float | None = None,
        uncertain_mass: float = 0.0,
    ) -> None:
        """Find the tool.

        Args:
            robot: the model: masses and friction, and the payload that the arm carries.
            dt: sample time [s].
            frame: the frame that is the tool; the tip when not given.
            bandwidth: of the filters [rad/s].
            friction_within: factor within which Coulomb friction is known; 1.2 when not given. Of a model
                without any, 0 to 6 % of the effort are reckoned with.
            uncertain_mass: mass at the tool that the model may lack, or have too much [kg].

        Raises:
            ParameterError: when a number is not as it should be.
            NameNotFound: when there is no such frame.
        """
        check_type(robot, "robot", Robot, "a single Robot")
        self.robot = robot
        self.dt = check_number(dt, "dt", "positive [s]", open_=True)
        bandwidth = check_number(bandwidth, "bandwidth", "positive [rad/s]", open_=True)
        within = KNOWN_WITHIN if friction_within is None else friction_within
        within = check_number(within, "friction_within", "1 or more", lowest=1.0)
        mass = check_number(uncertain_mass, "uncertain_mass", "zero or positive [kg]")
        if frame is not None:
            check_type(frame, "frame", str, "the name of a frame")
        self.frame = robot.tip if frame is None else frame
        self._motion = FrameMotion(robot, self.frame)
        self._length = self._motion.reach(robot)
        self._outside = OutsideTorque(robot, self.dt, bandwidth, within)
        self.friction, self.most_friction = self._outside.friction, self._outside.most_friction
        self._weight = mass * FREE_FALL * np.abs(downwards(robot))

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"WrenchEstimator({self.robot.name!r}, dt={self.dt:g}, frame={self.frame!r})"

    def init(self, q: ArrayLike) -> WrenchState:
        """Return the state before the first sample: the arm at rest, held by its motors.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
        """
        return self._outside.init(as_joint_array(q, "q", self.robot.joint_names))

    def step(self, q: ArrayLike, tau: ArrayLike, state: WrenchState) -> WrenchStep:
        """Return the estimate at a sample, and the next state.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
            tau: torque of the motors since the last sample [N m or N], likewise.
            state: of the last sample.
        """
        names = self.robot.joint_names
        at, applied = as_joint_array(q, "q", names), as_joint_array(tau, "tau", names)
        after = self._outside.after(at, applied, state)
        return WrenchStep(self.wrench(after), after)

    def wrench(self, state: WrenchState) -> ToolWrench:
        """Return the wrench that follows from a state, with its intervals."""
        q, residual = state.q, state.residual
        jacobian = self._motion.at(q, 0.0 * q).damped_jacobian(self._length)
        inverse = np.linalg.solve(jacobian.square, jacobian.matrix)
        inverse[..., :3, :] /= self._length
        wrench = np.matmul(inverse, residual[..., None])[..., 0]
        spread = np.matmul(np.abs(inverse), self._outside.unsure(state)[..., None])[..., 0]
        spread[..., :3] = spread[..., :3] + self._weight
        low, high = wrench - spread, wrench + spread
        parts = [(x[..., :3], x[..., 3:]) for x in (wrench, low, high)]
        return ToolWrench(*(part[0] for part in parts), *(part[1] for part in parts))


def downwards(robot: Robot) -> Array:
    """Return the direction in which things fall, in the base frame, (3,); zeros without gravity."""
    gravity = robot.pinocchio_model().gravity.linear
    return np.asarray(gravity / max(float(np.linalg.norm(gravity)), 1e-9))
