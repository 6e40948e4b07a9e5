"""A controller under a force limit: a wrapper for every controller; see :mod:`armgpi.control.force_limit`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, check_number, check_type, new
from armgpi.base.parameter import Parametrised, PerJoint, parameter, with_parameters
from armgpi.control.controller import Controller, ControlStep
from armgpi.control.force_limit import FREE_FALL, SPEED, ForceBound, ForceLimit, check_weight, warn
from armgpi.errors import ParameterError
from armgpi.references.reference import Target
from armgpi.robot.batch import AnyRobot, one_of


@with_parameters
class ForceSettings(Parametrised):
    """What a force limit is, as parameters: of the wrapper around a controller, and of GPI."""

    force_limit: float = parameter(
        "largest force at the tool beyond the model's torque and Coulomb friction, at rest",
        unit="N",
        default=None,
        none="no limit",
        least=0.0,
        above=True,
        log=True,
        structural=True,
    )
    moment_limit: float = parameter(
        "largest moment at the tool, with a force limit",
        unit="N m",
        default=None,
        none="0.2 m times the force limit",
        least=0.0,
        above=True,
        log=True,
        structural=True,
    )
    force_frame: str | None = parameter(
        "frame at which the force limit holds", kind="text", default=None, none="the tip"
    )
    speed_limit: float = parameter(
        "largest speed of the tool relative to its reference, with a force limit",
        unit="m/s",
        default=None,
        none="0.25",
        least=0.0,
        above=True,
        log=True,
    )
    limit_friction: PerJoint = parameter(
        "Coulomb friction that is added to the force limit",
        unit="N m or N",
        default=None,
        none="the model's",
        least=0.0,
        per_joint=True,
    )


class LimitedState(NamedTuple):
    """State of a controller under a force limit.

    Attributes:
        limit: state of the force limit.
        law: state of the controller in it.
    """

    limit: Any
    law: Any


class ForceLimited(Controller):
    """A controller whose torque beyond the model's presses with a force at most, without a force sensor.

    The controller itself takes the shortened torque for its own saturation, so that its integrators do not
    wind up. A limit that does not act changes no bit. It bounds the force at rest: the impact at the speed of
    the approach comes on top (:meth:`force_bound`), and it is no safety function.

    Attributes:
        law: the controller.
        settings: the limit, as it was given.
        force: what shortens the torque.
        delay: transport delay in the loop that it was made for [s], besides the sample and hold.
    """

    derived: ClassVar[Mapping[str, str]] = {**Controller.derived, **ForceLimit.derived}

    def __init__(
        self,
        law: Controller,
        force_limit: float,
        moment_limit: float | None = None,
        force_frame: str | None = None,
        speed_limit: float | None = None,
        limit_friction: Any = None,
        uncertain_mass: float = 0.0,
        delay: float | None = None,
    ) -> None:
        """Put a controller under a force limit.

        Args:
            law: the controller.
            force_limit: largest force [N] at the tool at rest, beyond model torque and Coulomb friction.
            moment_limit: likewise its moment [N m]; 0.2 m times the force limit when not given.
            force_frame: the frame that they are of; the tip when not given.
            speed_limit: of the tool beside its reference [m/s], also below the limit; 0.25 when not given.
            limit_friction: Coulomb friction that comes on top [N m or N], a number or (n,); the nominal
                model's when not given.
            uncertain_mass: mass that the nominal model is uncertain by [kg], at the tool.
            delay: transport delay in the loop [s], besides the sample and hold, which the speed limit has to
                know; that of the controller when not given, and 0 where it has none.

        Raises:
            ParameterError: when the controller is none, has a force limit of its own, or the limit is below
                the weight that the model is uncertain by.
            NameNotFound: when there is no such frame.
            ArrayError: when the friction does not fit the joints.
        """
        check_type(law, "law", Controller, "a Controller")
        given: Any = (force_limit, moment_limit, force_frame, speed_limit, limit_friction)
        settings = ForceSettings(*given)
        if settings.force_limit is None:
            raise ParameterError("force_limit", None, "positive [N]")
        if getattr(law, "force_limit", None) is not None or isinstance(law, ForceLimited):
            raise ParameterError("law", law, "a controller without a force limit of its own")
        if hasattr(law, "supervisor"):
            raise ParameterError("law", law, "a controller that is not supervised: supervise the limited one")
        for name in ("robot", "dt", "effort"):
            self.keep(name, getattr(law, name))
        self._floor = law._floor
        self.law, self.settings = law, settings
        self.measurement_type = law.measurement_type  # type: ignore[misc]  # of this one, not of the class
        self.knows = "model"  # type: ignore[misc]
        self.compliant = law.compliant  # type: ignore[misc]
        self.batch = law.batch
        self.bias_robot: AnyRobot = getattr(law, "bias_robot", law.robot)
        self._known = self.bias_robot.dynamics
        late = getattr(law, "delay", 0.0) if delay is None else delay
        self.delay = check_number(late, "delay", "zero or positive [s]")
        self._weight = FREE_FALL * check_number(uncertain_mass, "uncertain_mass", "zero or positive [kg]")
        arm = one_of(self.bias_robot)
        settings.check_parameters(arm.joint_names)
        friction: Any = settings.limit_friction
        if friction is None:
            friction = self.bias_robot.friction.coulomb
        check_weight(force_limit, self._weight)
        self.force = ForceLimit(
            arm,
            settings.force_frame,
            settings.force_limit,
            settings.moment_limit,
            friction,
            SPEED if settings.speed_limit is None else settings.speed_limit,
            (law.dt, self.delay),
        )
        if not getattr(law, "remade", False):
            warn(self.force.doubts(arm), 2)

    @property
    def least_limit(self) -> float:
        """The weight that the nominal model is uncertain by [N]: no force limit may be below it."""
        return self._weight

    @property
    def force_limit(self) -> float:
        """The force limit [N]."""
        return self.settings.force_limit

    def force_bound(self, **given: Any) -> ForceBound:
        """Return what the tool presses with, and the impact beside it; see :meth:`armgpi.GPI.force_bound`."""
        return self.force.bound(one_of(self.bias_robot), weight=self._weight, **given)

    def changed(self, state: LimitedState, limit: float) -> LimitedState:
        """Return a state from which on it has another force limit; see :meth:`armgpi.GPI.changed`."""
        return state._replace(limit=self.force.changed(state.limit, limit, self._weight))

    def init(self, measurement: Any, target: Target) -> LimitedState:
        """Return the state before the first sample; see :meth:`Controller.init`."""
        return LimitedState(self.force.init(measurement.q - target.q), self.law.init(measurement, target))

    def waiting(self, measurement: Any, target: Target, state: LimitedState) -> LimitedState:
        """Return the state at the start; see :meth:`Controller.waiting`."""
        return state._replace(law=self.law.waiting(measurement, target, state.law))

    def step(self, measurement: Any, target: Target, state: LimitedState) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`."""
        q = measurement.q
        _, v, a = (part + np.zeros_like(q) for part in target)
        known = self._known.inverse(q, v, a)
        asked = self.law.within(self._floor, self.effort).step(measurement, target, state.law).tau
        gentle = self.force.gentle(q, target, (asked, known), state.limit, self.robot.dynamics)
        # Once more, so that the controller knows what is applied.
        law = self.law.within(gentle.told, gentle.told).step(measurement, target, state.law).state
        return new(ControlStep, (self.limited(gentle.tau), new(LimitedState, (gentle.state, law))))

    def signals(self, state: LimitedState) -> Mapping[str, Array]:
        """Return the signals of the controller in it; see :meth:`Controller.signals`."""
        return self.law.signals(state.law)

    def reported(self, state: LimitedState) -> Mapping[str, Array]:
        """Return the recorded signals of the controller in it; see :meth:`Controller.reported`."""
        return self.law.reported(state.law)

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {**self.law.describe(), "force": self.settings.values()}

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"ForceLimited({self.law!r}, force_limit={self.settings.force_limit:g})"
