"""A plant, a controller and a reference together: what one sample of them is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, ArrayLike, as_joint_array, new
from armgpi.control.controller import Controller, FullState, Measurement
from armgpi.control.sizes import common_batch
from armgpi.errors import ArrayError, ParameterError
from armgpi.plants.plant import Plant, PlantState
from armgpi.references.batch import ReferenceBatch
from armgpi.references.reference import Reference, Target
from armgpi.supervisor import Supervised


class LoopState(NamedTuple):
    """State of a closed loop.

    Attributes:
        k: number of samples taken.
        plant: state of the plant.
        controller: state of the controller.
    """

    k: int
    plant: Any
    controller: Any


class LoopStep(NamedTuple):
    """Result of one sample of a closed loop.

    Attributes:
        state: the next state.
        measured: what the sensors said at the sample.
        tau: torque that the controller asked for [N m or N], shape (n,) or (batch, n).
    """

    state: LoopState
    measured: FullState
    tau: Array


class ClosedLoop:
    """A plant under a controller that follows a reference, one sample at a time.

    Of states x of the plant and z of the controller, at the times t = k dt::

        y = measure(x)    tau, z' = control(y, reference(t), z)    x' = plant(tau, x, dt)

    :func:`simulate` is a loop over :meth:`step`; use this class for a loop of your own.

    Attributes:
        plant: what moves.
        controller: what moves it.
        reference: where to; of a :class:`ReferenceBatch` the one with arrays that is the same, if any.
        dt: sample time [s], the controller's.
        batch: number of rollouts, None for a single one.
    """

    def __init__(self, plant: Plant, controller: Controller, reference: Reference) -> None:
        """Check that the three match.

        Raises:
            ParameterError: when an argument is of another kind, or joints or batches differ.
            ArrayError: when the reference has another number of joints.
        """
        for name, value, kind in (
            ("plant", plant, Plant),
            ("controller", controller, Controller),
            ("reference", reference, Reference),
        ):
            if not isinstance(value, kind):
                raise ParameterError(name, value, f"a {kind.__name__}")
        if plant.robot.joint_names != controller.robot.joint_names:
            raise ParameterError(
                "controller",
                ", ".join(controller.robot.joint_names),
                f"for the plant's joints {', '.join(plant.robot.joint_names)}",
            )
        self.plant = plant
        self.controller = controller
        self.reference = reference.as_arrays() if isinstance(reference, ReferenceBatch) else reference
        self.dt = controller.dt
        first = _arrays(reference.at(0.0))
        if first.q.ndim not in (1, 2) or first.q.shape[-1] != plant.robot.n:
            raise ArrayError(
                "reference",
                f"expected targets of shape (n,) or (batch, n) with n = {plant.robot.n}, got {first.q.shape}",
            )
        self._target_shape = first.q.shape
        self.batch = common_batch(plant.batch, controller.batch, first.q)
        if self.batch == 0:
            raise ArrayError("reference", "expected at least one rollout, got an empty batch")
        self._measures_velocity = controller.measurement_type is FullState

    def init(self, q0: ArrayLike | None = None, v0: ArrayLike | None = None) -> LoopState:
        """Return the state at time 0.

        Args:
            q0: starting positions [rad or m], (n,) or (batch, n); the reference's when not given.
            v0: starting velocities [rad/s or m/s], (n,) or (batch, n); zero when not given, also where the
                reference moves. They are not compared with the velocity limits.

        Raises:
            ArrayError: when an array is not as it should be.
            LimitError: when the start is outside the joint limits.
            ParameterError: when the tool is outside the workspace of a supervisor there.
        """
        robot = self.plant.robot
        target = self.reference.at(0.0)
        q = robot.check_position(target.q if q0 is None else q0, "the start q0")
        v = np.zeros_like(q) if v0 is None else as_joint_array(v0, "v0", robot.joint_names)
        batch = common_batch(self.batch, q, v)
        if batch == 0:
            raise ArrayError("q0", "expected at least one rollout, got an empty batch")
        shape = (robot.n,) if batch is None else (batch, robot.n)
        q, v = (np.ascontiguousarray(np.broadcast_to(x, shape)) for x in (q, v))
        if isinstance(self.controller, Supervised):
            self.controller.check_start(q)
        plant = self.plant.init(q, v)
        measured = self.plant.measure(plant)
        seen = measured if self._measures_velocity else Measurement(measured.q)
        return LoopState(0, plant, self.controller.init(seen, target))

    def targets(self, times: Array) -> Target:
        """Return the targets at some times [s], shape (k,): arrays (k, n) or (k, batch, n).

        Args:
            times: of the samples [s], shape (k,).

        Raises:
            ArrayError: when the reference, which may be a user's, gives something else.
        """
        target = _arrays(self.reference.at(times.copy()))
        expected = (len(times), *self._target_shape)
        if target.q.shape != expected:
            raise ArrayError(
                "reference",
                f"expected targets of shape {expected} at {len(times)} times, got {target.q.shape}",
            )
        return target

    def step(self, state: LoopState, target: Target | None = None) -> LoopStep:
        """Take one sample: measure, control, and hold the torque until the next.

        Args:
            state: from :meth:`init` or the step before.
            target: the reference at this time, if you have it; evaluated when not given.
        """
        if target is None:
            target = self.reference.at(state.k * self.dt)
        plant, controller, measured, tau = self._sample(state.plant, state.controller, target)
        return LoopStep(LoopState(state.k + 1, plant, controller), measured, tau)

    def _sample(self, plant: Any, controller: Any, target: Target) -> tuple[Any, Any, FullState, Array]:
        """Return the next states of plant and controller, what was measured and the torque asked for."""
        measured, tau, controller = self.asked(plant, controller, target)
        return self.plant.step(tau, plant, self.dt), controller, measured, tau

    def asked(self, plant: Any, controller: Any, target: Target) -> tuple[FullState, Array, Any]:
        """Return what is measured, the requested torque, and the controller's next state.

        Args:
            plant: state of the plant.
            controller: state of the controller.
            target: where to, at this sample.

        Returns:
            The measurement, the torque before its limits [N m or N], shape (n,) or (batch, n), and the
            state of the controller at the next sample.
        """
        measured = self.plant.measure(plant)
        seen = measured if self._measures_velocity else new(Measurement, (measured.q,))
        return measured, *self.controller.step(seen, target, controller)

    def true_state(self, state: LoopState) -> PlantState:
        """Return the true state of the plant.

        Args:
            state: of the loop.

        Returns:
            Sample number, positions [rad or m], velocities [rad/s or m/s] and applied torque [N m or N],
            each of shape (n,) or (batch, n).
        """
        return self.plant.true_state(state.plant)

    def describe(self) -> dict[str, Any]:
        """Return the parts, and what the controller measures and uses, for a rollout's provenance."""
        return {
            "plant": self.plant.describe(),
            "controller": self.controller.describe(),
            "reference": self.reference.describe(),
            "measurement": self.controller.measurement_type.__name__,
            "knows": self.controller.knows,
        }


def _arrays(target: Any) -> Target:
    """Return a target whose three parts are arrays of floats and of one shape, or refuse it."""
    if not isinstance(target, Target):
        raise ArrayError("reference", f"expected a Target(q, v, a), got a {type(target).__name__}")
    for name, part in zip(Target._fields, target, strict=True):
        kind = part.dtype.str if isinstance(part, np.ndarray) else type(part).__name__
        if kind != np.dtype(np.float64).str:
            raise ArrayError("reference", f"expected targets of native float64, got {name} of {kind!r}")
        if part.shape != target[0].shape:
            shapes = f"{target[0].shape} and {part.shape}"
            raise ArrayError("reference", f"expected q, v and a of one shape, got {shapes}")
    return Target(*map(np.asarray, target))
