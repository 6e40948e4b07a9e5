"""A gain schedule on the size of the error: attack and leak, no basis functions, no weights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.control.controller import batches, common_batch
from armgpi.errors import ParameterError
from armgpi.gpi.gains import GainStep, Tuning
from armgpi.gpi.network import Boxes, BSplineNetwork
from armgpi.parameter import PerJoint, parameter, with_parameters
from armgpi.registry import Context


class ScheduleState(NamedTuple):
    """State of the schedule.

    Attributes:
        raised: by how much omega_c is above its lower end [rad/s].
    """

    raised: Array


@with_parameters
class GainSchedule(Boxes):
    """omega_c rises to the upper end of its box as the size of the error passes a dead zone, and leaks back.

    With w what it is above the lower end, and w* = (upper - lower) min(max(abs(e) - dead_zone, 0) /
    error_range, 1):

        w += attack max(w* - w, 0) - leak dt w

    This is what :class:`BSplineNetwork` comes to by default. While the torque is cut, or a measurement is no
    number, it stays as it is.
    """

    config_name: ClassVar[str | None] = "schedule"
    derived: ClassVar[Mapping[str, str]] = {
        "_low": "lower end of omega [rad/s]",
        "_span": "upper end of omega above it [rad/s]",
        "_per_error": "one over the error at which omega's aim is its upper end [1/rad or 1/m]",
        "_leak": "share that leaks in a sample [-]",
    }

    attack: PerJoint = parameter(
        "share of the way to its aim that omega goes in a sample",
        default=0.2,
        least=0.0,
        most=1.0,
        per_joint=True,
        search=(0.01, 1.0),
        slider=(0.0, 1.0),
    )
    leak: float = parameter("how fast it falls back", unit="1/s", default=5.0, least=0.0, search=(0.1, 50.0))
    error_range: PerJoint = parameter(
        "error beyond the dead zone at which its aim is its upper end",
        unit="rad or m",
        default=1e-4,
        least=0.0,
        above=True,
        per_joint=True,
        chosen="an encoder count; one of 22 bits without encoder",
        log=True,
        search=(1e-6, 1e-2),
    )
    dead_zone: PerJoint = parameter(
        "error that raises no gain, such as two encoder counts",
        unit="rad or m",
        default=2e-4,
        least=0.0,
        per_joint=True,
        chosen="two encoder counts; 0 without encoder",
        log=True,
        search=(1e-6, 1e-2),
    )

    def prepare(self, joint_names: Sequence[str], dt: float) -> GainSchedule:
        """Return the schedule as arrays over the joints.

        Raises:
            ArrayError: when a value is not as declared, a box is upside down or a shape does not fit.
            ParameterError: when the leak is too fast for the sample time.
        """
        if (leak := float(np.max(self.leak))) * dt >= 1.0:
            raise ParameterError("leak", leak, f"below 1 / dt = {1.0 / dt:g} 1/s")
        ready = object.__new__(GainSchedule)
        ready.__dict__.update(self.__dict__)
        ready.check_parameters(joint_names)
        ready._derive(dt)
        return ready

    def _derive(self, dt: float) -> None:
        """Work out what `step` needs."""
        ends: Any = self.omega_c
        low, high = ends
        self._low, self._span = low, high - low
        self._per_error, self._leak = 1.0 / self.error_range, self.leak * dt
        self.batch = common_batch(*batches(self))

    @classmethod
    def chosen(cls, context: Context) -> dict[str, Any]:
        """Return the box and scales of :meth:`BSplineNetwork.chosen`."""
        return BSplineNetwork.chosen(context)

    def nominal(self) -> Tuning:
        """Return the tuning where the error is small: the lower end."""
        return Tuning(self._low, self.zeta_c, self._low)

    def init(self, e: Array) -> ScheduleState:
        """Return the state before the first sample: omega at its lower end."""
        return ScheduleState(np.zeros_like(e))

    def step(self, e: Array, learn: Array, state: ScheduleState) -> GainStep:
        """Return the tuning for the tracking error `e`; see :meth:`Gains.step`."""
        sound = np.abs(e) < math.inf
        size = np.where(sound, np.abs(e), 0.0) - self.dead_zone
        aim = self._span * np.minimum(np.maximum(size, 0.0) * self._per_error, 1.0)
        w = state.raised
        change = self.attack * np.maximum(aim - w, 0.0) - self._leak * w
        w = w + np.where(sound, learn, 0.0) * change
        omega = self._low + w
        return GainStep(Tuning(omega, self.zeta_c, omega), ScheduleState(w))

    def signals(self, state: ScheduleState) -> Mapping[str, Array]:
        """Return omega_c."""
        return {"omega_c": self._low + state.raised}

    def describe(self) -> Mapping[str, Any]:
        """Return the parameters as plain data."""
        return self.values()
