"""The controller protocol: from a measurement and a target to a torque, with explicit state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, PerJointInput
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.shown import Shown
from armgpi.control.sizes import batches, common_batch
from armgpi.references.reference import Target
from armgpi.registry import Context
from armgpi.robot.batch import AnyRobot, RobotBatch, check_powered, check_robot
from armgpi.robot.robot import Robot


class Measurement(NamedTuple):
    """What an output-feedback controller measures: positions, and nothing else.

    Attributes:
        q: measured positions [rad or m], shape (n,) or (batch, n).
    """

    q: Array


class FullState(NamedTuple):
    """What a state-feedback controller measures: positions and velocities.

    Attributes:
        q: measured positions [rad or m], shape (n,) or (batch, n).
        v: measured velocities [rad/s or m/s], same shape.
    """

    q: Array
    v: Array


class ControlStep(NamedTuple):
    """Result of one control step.

    Attributes:
        tau: torque to apply until the next sample [N m or N], shape (n,) or (batch, n).
        state: the controller's next state.
    """

    tau: Array
    state: Any


@with_parameters
class Controller(Shown, ABC):
    """A sampled torque controller.

    From a measurement y, a target r and a state z, at every sample::

        tau, z' = step(y, r, z)    -effort <= tau <= effort    z = init(y, r) before the first

    Its parameters do not change; what changes is its state, which goes in and out of :meth:`step`. Steps
    are elementwise in the joints except for D(q) x and D(q)^-1 x of its nominal model.

    Attributes:
        robot: nominal model.
        dt: its sample time [s].
        effort: torque that it never exceeds [N m or N], shape (n,) or (batch, n).
        batch: number of rollouts that its parameters are for, None when they fit any.
        measurement_type: :class:`Measurement` or :class:`FullState`: what `step` is given.
        config_name: its `type` in experiment files and name on the command line; None for one that has none.
        knows: what it needs of the nominal model: "inertia" (D(q)), "gravity" (G(q) as well) or "model" (all
            of it); empty where it does not say.
        compliant: whether it gives way like a spring: to a supervisor an error is no fault then.
        derived: what is worked out from the parameters: name -> meaning, for comments in exported C.
    """

    measurement_type: ClassVar[type[Measurement] | type[FullState]] = Measurement
    config_name: ClassVar[str | None] = None
    knows: ClassVar[str] = ""
    compliant: ClassVar[bool] = False
    derived: ClassVar[Mapping[str, str]] = {
        "_floor": "lower torque limits [N m or N]",
        "inertia_scale": "factor of all masses and inertias [-]",
    }
    _unlimited: ClassVar[bool] = False

    robot: AnyRobot = field()
    dt: float = parameter("sample time", unit="s", least=1e-9, in_file=False, structural=True)
    effort: PerJoint = parameter(
        "torque limits",
        unit="N m or N",
        default=None,
        none="the robot's",
        least=0.0,
        above=True,
        per_joint=True,
        in_file=False,
        log=True,
        kw_only=True,
    )

    def __init__(self, robot: AnyRobot, dt: float, effort: PerJointInput | None = None) -> None:
        """Check and keep what all controllers share: for a controller with an ``__init__`` of its own.

        Args:
            robot: nominal model.
            dt: sample time [s].
            effort: torque limits [N m or N], a number, (n,) or (batch, n); the robot's when not given.

        Raises:
            ParameterError: when dt is not positive.
            EffortError: when a joint's limit leaves no torque.
        """
        self.keep("robot", robot)
        self.keep("dt", dt)
        self.keep("effort", effort)
        Controller.__post_init__(self)

    def __post_init__(self) -> None:
        """Check the parameters; the effort limits are the robot's when none are given."""
        check_robot(self.robot)
        self.check_parameters(self.robot.joint_names)
        self.fill("effort", self.robot.limits.effort)
        check_powered(self.robot, self.effort)
        self._floor = -self.effort
        self.batch = common_batch(*batches(self))

    @classmethod
    def context_for(cls, given: Mapping[str, Any], context: Context) -> Context:
        """Return the context for `chosen` defaults, after the parameters of the law that were given.

        Args:
            given: parameters of the controller in the file, by their names.
            context: what else the experiment is.
        """
        return context

    @classmethod
    def chosen(cls, context: Context) -> dict[str, Any]:
        """Return what an experiment takes for `chosen` parameters.

        Args:
            context: what else the experiment is: robot, sample time, delay.

        Returns:
            Values by the names of the parameters.
        """
        return {}

    @classmethod
    def configured(cls, given: Mapping[str, Any], context: Context) -> Controller:
        """Return the controller that an experiment describes.

        Args:
            given: its parameters by their names, but for those that are not in the file.
            context: what else the experiment is.
        """
        return cls(context.nominal, context.dt, **given)

    @abstractmethod
    def init(self, measurement: Any, target: Target) -> Any:
        """Return the state before the first sample.

        Args:
            measurement: the first measurement, of the type that :attr:`measurement_type` names.
            target: the first target.
        """

    @abstractmethod
    def step(self, measurement: Any, target: Target, state: Any) -> ControlStep:
        """Return the torque to hold until the next sample, and the next state.

        Args:
            measurement: of the type that :attr:`measurement_type` names; arrays (n,) or (batch, n).
            target: what is asked for now.
            state: from :meth:`init` or the step before.

        Returns:
            The torque, within +-`effort` [N m or N], of the shape of the positions, and the next state.
        """

    def waiting(self, measurement: Any, target: Target, state: Any) -> Any:
        """Return the state of a controller whose first torque is not reached yet, as its rate is limited.

        Args:
            measurement: of this sample.
            target: of this sample.
            state: of the controller.
        """
        return state

    def limited(self, tau: Array) -> Array:
        """Return a torque saturated at what the controller may ask for.

        Args:
            tau: torque [N m or N], shape (n,) or (batch, n).

        Returns:
            The torque within +-`effort` [N m or N], same shape.
        """
        if self._unlimited:
            return tau
        cut: Array = np.minimum(np.maximum(tau, self._floor), self.effort)
        return cut

    def within(self, lower: Array, upper: Array) -> Controller:
        """Return the same controller with other torque limits, which may change from sample to sample.

        Args:
            lower: lowest torque [N m or N], shape (n,) or (batch, n).
            upper: highest torque [N m or N], same shape.
        """
        made = object.__new__(type(self))
        vars(made).update(vars(self), _floor=lower, effort=upper)
        return made

    def unlimited(self) -> Controller:
        """Return the same controller without torque limits: whoever steps it looks at the torque."""
        made = object.__new__(type(self))
        vars(made).update(vars(self), _unlimited=True)
        return made

    def signals(self, state: Any) -> Mapping[str, Array]:
        """Return inner signals worth recording, name -> array (..., n); none by default.

        Args:
            state: of the controller, as :meth:`step` returned it.

        Returns:
            Name -> values, shape (..., n), in the units that :attr:`derived` or the attributes state.
        """
        return {}

    def reported(self, state: Any) -> Mapping[str, Array]:
        """Return those of its :meth:`signals` that every recording has; arguments and result are the same."""
        return {}

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data, for a rollout's provenance."""
        models = {
            key: value.provenance
            for key, value in vars(self).items()
            if isinstance(value, Robot | RobotBatch)
        }
        return {"controller": type(self).__name__, **self.values(), **models}
