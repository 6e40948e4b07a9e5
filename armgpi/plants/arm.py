"""Plants of an arm, declared: which arm it is, its loads, its friction, and its parameters, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any, ClassVar, TypeVar

import numpy as np

from armgpi.base.arrays import Array, new, not_negative, per_joint
from armgpi.base.hints import PLANT
from armgpi.base.parameter import Parametrised, parameter, with_parameters
from armgpi.control.controller import FullState
from armgpi.control.sizes import batches, common_batch
from armgpi.errors import ArrayError, ParameterError
from armgpi.plants.environment import Contact, Environment
from armgpi.plants.friction import STICK_VELOCITY, ImplicitFriction
from armgpi.plants.loads import Load
from armgpi.plants.plant import Plant, PlantState
from armgpi.registry import Context
from armgpi.robot.batch import AnyRobot, check_robot
from armgpi.robot.equations import Friction
from armgpi.robot.frame_motion import FrameMotion
from armgpi.robot.robot import Robot

_Same = TypeVar("_Same", bound="Arm")


@with_parameters
class Arm(Parametrised, Plant):
    """An arm under torque, loads and friction, without sensors; a subclass integrates it.

    One with a ``config_name`` is an engine of experiment files, and its parameters are keys of ``plant:``.

    Attributes:
        robot: the arm that it really is; with a payload, say, that the controller does not know.
        loads: disturbance torques, each (n,) or (batch, n).
        environment: what its tool touches: forces, walls and springs (:mod:`armgpi.plants.environment`).
        metrics_frame: the frame that metrics of the tool are of; the tip when not given.
        friction: "urdf" for the coefficients in the robot's URDF (which Pinocchio's dynamics ignore),
            ``Friction(viscous, coulomb)`` for others, None for none.
        substeps: integration steps per sample.
        config_name: its `engine` in experiment files; None for one that has none there.
        feels: which of "loads", "friction" and "environment" its step has; others are refused.
        varies: whether one robot with other numbers in each rollout will do (:meth:`armgpi.Robot.varied`).
    """

    _hints: ClassVar[Mapping[str, str]] = PLANT
    config_name: ClassVar[str | None] = None
    feels: ClassVar[tuple[str, ...]] = ()
    varies: ClassVar[bool] = True

    robot: AnyRobot = field()
    loads: Any = field(default=())
    friction: Any = field(default=None)
    environment: Any = field(default=(), kw_only=True)
    metrics_frame: str | None = parameter(
        "frame that is the tool in metrics", kind="text", default=None, none="the tip", kw_only=True
    )
    substeps: int = parameter(
        "integration steps per sample", kind="integer", default=1, least=1, most=10_000, structural=True
    )

    def __post_init__(self) -> None:
        """Check what is given.

        Raises:
            ParameterError: for bad friction, or a parameter that is not as declared.
            ArrayError: when a load, coefficient or parameter does not fit the joints.
        """
        check_robot(self.robot)
        self.keep("loads", tuple(self.loads) if isinstance(self.loads, Sequence) else (self.loads,))
        self.check_parameters(self.robot.joint_names)
        self._check_metrics_frame()
        self.keep("friction", self._friction(self.friction))
        given = self.environment
        self.keep("environment", tuple(given) if isinstance(given, Sequence) else (given,))
        self._surroundings = Environment(self.robot, self.environment) if self.environment else None
        loads_now = [np.zeros(self._check_load(load)) for load in self.loads]
        numbers = [size for each in self.environment for size in batches(each)]
        columns = [size for size in numbers if isinstance(size, np.ndarray) and size.ndim == 2]
        self.batch = common_batch(*batches(self), *loads_now, *columns)
        self._table = LoadTable(self, self.substeps) if self.loads else None
        for name in ("loads", "friction", "environment"):
            if (given := getattr(self, name)) and name not in self.feels:
                raise ParameterError(name, given, f"none: {type(self).__name__} does not name it in `feels`")
        # What differs by rollout was declared to vary, whatever it is.
        coulomb = np.zeros(0) if self.friction is None else self.friction.coulomb
        self._brake = ImplicitFriction((coulomb.ndim == 2 or bool(coulomb.any()),))

    def _check_metrics_frame(self) -> None:
        """Refuse a frame for metrics that the arm has not, or that no joint moves."""
        if self.metrics_frame is not None:
            robot = self.robot
            FrameMotion(robot if isinstance(robot, Robot) else robot.first, self.metrics_frame)

    @classmethod
    def configured(
        cls: type[_Same],
        robot: AnyRobot,
        loads: Sequence[Load],
        friction: str | None,
        given: Mapping[str, Any],
        context: Context,
        environment: Sequence[Contact] = (),
    ) -> _Same:
        """Return the plant that an experiment file describes.

        Args:
            robot: the arm that it really is.
            loads: disturbance torques.
            friction: "urdf", or None for none.
            given: what the file says of the declared parameters, by their names.
            context: what else the experiment is.
            environment: what the tool touches.
        """
        return cls(robot, loads, friction, environment=environment, **given)

    def init(self, q: Array, v: Array) -> PlantState:
        """Return the state at time 0; see :meth:`Plant.init`."""
        self.check_start(q)
        return PlantState(0, q, v, np.zeros_like(q))

    def measure(self, state: PlantState) -> FullState:
        """Return the true positions and velocities."""
        return new(FullState, (state.q, state.v))

    def true_state(self, state: PlantState) -> PlantState:
        """Return the state itself."""
        return state

    def acting_torques(self, tau: Any, k: int, substep: int, dt: float) -> tuple[Array, Array, Array]:
        """Return what loads leave of `tau` at the beginning, middle and end of a substep of sample `k`."""
        if self._table is None:
            return tau, tau, tau
        begin, middle, end = self._table.at(k, substep, dt)
        return tau - begin, tau - middle, tau - end

    def check_start(self, q: Array) -> None:
        """Refuse positions at the start [rad or m], (n,) or (batch, n), that are inside of a wall.

        Raises:
            ParameterError: naming the wall, with how deep the point is.
            ArrayError: when numbers of the environment are for several rollouts, and positions for one.
        """
        if self._surroundings is None or not isinstance(q, np.ndarray):
            return
        if self.batch is not None and q.ndim < 2:
            raise ArrayError("q", f"expected shape ({self.batch}, {self.robot.n}), got {q.shape}")
        self._surroundings.check_start(q)

    def contact_torque(self, q: Array, v: Array, k: Any, substep: float, dt: float) -> Any:
        """Return the torque [N m or N] of what the tool touches; 0.0 where there is nothing.

        Args:
            q: positions [rad or m], (n,) or (batch, n).
            v: velocities [rad/s or m/s], likewise.
            k: number of the sample.
            substep: which substep of it, with a share of the next.
            dt: sample time [s].
        """
        if self._surroundings is None:
            return 0.0
        return self._surroundings.torque(q, v, (k + substep / self.substeps) * dt)

    def velocity_after_friction(
        self, q: Array, v: Array, h: float, stick: float = STICK_VELOCITY, before: Array | None = None
    ) -> Array:
        """Return what friction leaves of a velocity that a step gave without it.

        Args:
            q: positions at the beginning of the step [rad or m], (n,) or (batch, n).
            v: velocities after the step without friction [rad/s or m/s], likewise.
            h: length of the step [s].
            stick: speed below which Coulomb friction is smoothed [rad/s or m/s].
            before: velocities at the beginning of the step, from which less is to search; `v` when not given.
        """
        if self.friction is None:
            return v
        viscous, coulomb = self.friction
        begin = v if before is None else before
        return self._brake(v, begin, viscous, coulomb, h, stick, self.robot.dynamics.mass_matrix(q))

    def disturbance(self, t: Array) -> Array | None:
        """Return the sum of the loads; see :meth:`Plant.disturbance`."""
        if not self.loads:
            return None
        rank = max(1, max(len(load.shape) for load in self.loads))
        times = np.asarray(t, dtype=np.float64).reshape((-1,) + (1,) * rank)
        total = sum((load.torque(times) for load in self.loads), np.zeros((1,) * rank + (self.robot.n,)))
        return np.asarray(total)

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        friction = self.friction
        return {
            "plant": type(self).__name__,
            "robot": self.robot.provenance,
            "loads": [load.describe() for load in self.loads],
            "friction": friction and {name: value.tolist() for name, value in friction._asdict().items()},
            **({"environment": [each.describe() for each in self.environment]} if self.environment else {}),
            **self.values(),
        }

    def __repr__(self) -> str:
        """Return a one-line description."""
        loads = ", ".join(type(load).__name__ for load in self.loads) or "none"
        return f"{type(self).__name__}({self.robot.name!r}, n={self.robot.n}, loads: {loads})"

    def _friction(self, friction: str | Friction | None) -> Friction | None:
        """Return the friction coefficients, None when there is no friction."""
        if friction is None:
            return None
        if isinstance(friction, str) and friction == "urdf":
            return self.robot.friction
        if not isinstance(friction, tuple) or len(friction) != 2:
            raise ParameterError("friction", friction, '"urdf", Friction(viscous, coulomb) or None')
        names = self.robot.joint_names
        return Friction(
            *(
                per_joint(value, name, names, "zero or positive", not_negative)
                for value, name in zip(friction, Friction._fields, strict=True)
            )
        )

    def _check_load(self, load: Load) -> tuple[int, ...]:
        """Return the shape of a load, refusing one that does not fit the joints."""
        if not isinstance(load, Load):
            raise ParameterError("loads", load, "loads such as Step, Ramp, Sine or Pulse")
        shape = load.shape
        if len(shape) > 2 or (shape and shape[-1] not in (1, self.robot.n)):
            raise ArrayError("loads", f"{load}: expected one torque per joint ({self.robot.n}), got {shape}")
        return shape


class LoadTable:
    """Disturbance torques at the stage times, worked out for a stretch of samples at once.

    A load depends on time alone, so evaluating it at every Runge-Kutta stage would repeat itself.

    Attributes:
        plant: whose loads they are.
        substeps: Runge-Kutta steps per sample.
    """

    _SAMPLES = 256
    #: Shares of a substep. The end lies just before it, so that a load which sets in there is not felt yet.
    STAGES = np.array([0.0, 0.5, 1.0 - 1e-9])

    def __init__(self, plant: Plant, substeps: int) -> None:
        """Keep the loads of a plant."""
        self.plant = plant
        self.substeps = substeps
        self._first = -1
        self._dt = math.nan
        self._rows: Array = np.empty(0)

    def at(self, k: int, substep: int, dt: float) -> tuple[Array, Array, Array]:
        """Return the torque at the beginning, middle and end of a substep of sample `k`."""
        first = k - k % self._SAMPLES
        if first != self._first or dt != self._dt:
            substeps = np.arange(self.substeps * self._SAMPLES)[:, None]
            times = dt * (first + (substeps + self.STAGES) / self.substeps)
            rows = self.plant.disturbance(times.ravel())
            assert rows is not None
            self._first, self._dt, self._rows = first, dt, rows
        i = 3 * (self.substeps * (k - first) + substep)
        return self._rows[i], self._rows[i + 1], self._rows[i + 2]
