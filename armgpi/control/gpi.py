"""The output-feedback GPI controller (eqs. 12-25): torque from measured positions alone."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.arrays import Array, ArrayLike, PerJointInput, check_number, new
from armgpi.control.controller import Controller, ControlStep, Measurement, common_batch
from armgpi.control.gains import FixedGains, Gains, default_omega, delay_margin
from armgpi.control.payload import PayloadRange, payload_range
from armgpi.control.realisation import REALISATIONS
from armgpi.errors import ArmgpiWarning, ParameterError
from armgpi.references.reference import Target
from armgpi.robot.robot import AnyRobot, Robot


class GPIState(NamedTuple):
    """State of a GPI controller.

    Attributes:
        law: state of the realisation.
        gains: state of the gains.
        learn: 1 where the last torque was applied as asked, 0 where it was cut; shape as the errors.
    """

    law: Any
    gains: Any
    learn: Array


class GPI(Controller):
    """Generalised proportional-integral control, tau = D(q) v with v = -C(s) (q - q*).

    It needs positions, the inertia matrix D(q) and nothing else: gravity, Coriolis torque, friction and
    loads are the disturbance that its two integrators reject (constant and ramp without error).

    Attributes:
        gains: the tuning per joint.
        realisation: "bumpless" or "paper".
        start: "hold" or "zero".
        delay: transport delay that it was told of [s].
        payload: the range of loads that it was told of, None for none.
    """

    measurement_type: ClassVar[type[Measurement]] = Measurement

    def __init__(
        self,
        robot: AnyRobot,
        dt: float,
        gains: Gains | None = None,
        realisation: str = "bumpless",
        effort: PerJointInput | None = None,
        start: str = "hold",
        delay: float = 0.0,
        payload: tuple[float, float] | None = None,
        frame: str | None = None,
        com: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Define the controller.

        Args:
            robot: the robot that it believes in; only D(q) is used, and G(q) once to start.
            dt: sample time [s].
            gains: tuning per joint; ``FixedGains(default_omega(dt, delay))`` when not given.
            realisation: "bumpless" (three bounded states) or "paper" (as printed).
            effort: torque limits [N m or N], a number, (n,) or (batch, n); the robot's when not given.
            start: "hold" starts with the torque that holds the arm (brakes released under torque), "zero"
                with none.
            delay: transport delay in the loop [s], besides the sample and hold.
            payload: lightest and heaviest load [kg] that `robot` may carry: the controller then believes in
                the heaviest, and its default gains suit the lightest (:func:`armgpi.payload_range`).
            frame: frame that carries the load; the robot's tip when not given.
            com: centre of mass of the load in that frame [m], shape (3,).

        Raises:
            PayloadError: when no bandwidth serves the loads.
            ParameterError: for a bad sample time, realisation, start or delay.
            ArrayError: for gains that are not positive or do not fit the joints.
            EffortError: when a joint has no torque.
        """
        self.delay = check_number(delay, "delay", "zero or positive [s]")
        self.payload: PayloadRange | None = None
        if payload is not None:
            self.payload = _payload(robot, payload, frame, com, dt, self.delay, gains)
            robot = self.payload.nominal
        elif frame is not None:
            raise ParameterError("frame", frame, "left out where there is no payload")
        super().__init__(robot, dt, effort)
        if realisation not in REALISATIONS:
            raise ParameterError("realisation", realisation, f"one of {', '.join(REALISATIONS)}")
        if start not in ("hold", "zero"):
            raise ParameterError("start", start, "one of hold, zero")
        if gains is None:
            omega_c = default_omega(self.dt, self.delay) if self.payload is None else self.payload.omega_c
            gains = FixedGains(omega_c)
        if not isinstance(gains, Gains):
            raise ParameterError("gains", gains, "Gains, such as FixedGains(omega_c=20.0)")
        self.gains = gains.prepare(robot.joint_names, self.dt)
        self.realisation = realisation
        self.start = start
        self.batch = common_batch(self.batch, self.gains.batch)
        self._law = REALISATIONS[realisation]
        self._dynamics = robot.dynamics
        self._nominal = self._law.coefficients(self.gains.nominal(), self.dt)
        self._warn_of_delay()

    def init(self, measurement: Measurement, target: Target) -> GPIState:
        """Return the state before the first sample; see :meth:`Controller.init`."""
        q = measurement.q
        e = q - target.q
        hold = np.zeros_like(e)
        if self.start == "hold":
            hold = self._dynamics.inertia_solve(q, self.limited(self._dynamics.gravity(q)))
        learn = np.ones_like(e)
        return GPIState(self._law.init(hold, self._nominal), self.gains.init(e), learn)

    def step(self, measurement: Measurement, target: Target, state: GPIState) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`."""
        q = measurement.q
        e = q - target.q
        coefficients, learn, gains_state = self._nominal, state.learn, None
        if self.gains.adaptive:
            tuning, gains_state = self.gains.step(e, learn, state.gains)
            coefficients = self._law.coefficients(tuning, self.dt)
        v = self._law.output(e, state.law, coefficients)
        asked = self._dynamics.inertia_times(q, v)  # eq. 19
        tau = self.limited(asked)
        cut = tau - asked
        missing = self._dynamics.inertia_solve(q, cut)
        # The solver hands a zero torque back as it is: then nothing was cut.
        law = self._law.update(e, v, None if missing is cut else missing, state.law, coefficients)
        if self.gains.adaptive:
            learn = np.where(cut == 0.0, 1.0, 0.0)
        return new(ControlStep, (tau, new(GPIState, (law, gains_state, learn))))

    def signals(self, state: GPIState) -> Mapping[str, Array]:
        """Return the states of the law under their names."""
        return {**state.law._asdict(), **self.gains.signals(state.gains)}

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {
            **super().describe(),
            "gains": {"type": type(self.gains).__name__, **self.gains.describe()},
            "realisation": self.realisation,
            "start": self.start,
            "delay": self.delay,
            **({} if self.payload is None else {"payload": _plain(self.payload)}),
            "robot": self.robot.provenance,
        }

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"GPI({self.robot.name!r}, dt={self.dt:g}, realisation={self.realisation!r})"

    def _warn_of_delay(self) -> None:
        """Warn when hold and transport take more than the loop's delay margin."""
        nominal = self.gains.nominal()
        spent = 0.5 * self.dt + self.delay
        delta = 1.0 if self.payload is None else self.payload.delta[1]
        margin = float(np.min(delay_margin(nominal, delta)))
        if spent > margin:
            fastest = float(np.max(nominal.omega_c))
            enough = default_omega(self.dt, self.delay) if self.payload is None else self.payload.omega_c
            warnings.warn(
                f"omega_c = {fastest:g} rad/s is too fast for dt = {self.dt:g} s and a delay of "
                f"{self.delay:g} s: the loop stands a delay of {margin:.3g} s, hold and transport take "
                f"{spent:.3g} s, so it will be unstable; "
                f"{enough:.3g} rad/s would do",
                ArmgpiWarning,
                stacklevel=3,
            )


def _payload(
    robot: AnyRobot,
    payload: tuple[float, float],
    frame: str | None,
    com: ArrayLike,
    dt: float,
    delay: float,
    gains: Gains | None,
) -> PayloadRange:
    """Return the range of loads; who brings gains of their own chooses how slow they are."""
    if not isinstance(payload, tuple | list) or len(payload) != 2:
        raise ParameterError("payload", payload, "two masses [kg], the lightest and the heaviest")
    if not isinstance(robot, Robot):
        raise ParameterError("robot", robot, "a single Robot where there is a payload")
    slowest = {} if gains is None else {"slowest": 1e-9}
    return payload_range(robot, payload[0], payload[1], frame, com, dt=dt, delay=delay, **slowest)


def _plain(payload: PayloadRange) -> dict[str, Any]:
    """Return a range of loads as plain data, without the robot, which stands beside it."""
    return {key: value for key, value in payload._asdict().items() if key != "nominal"}
