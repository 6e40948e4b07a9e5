"""A gain schedule on the size of the error: attack and leak, no basis functions, no weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import with_parameters
from armgpi.control.bandwidth import ErrorSchedule
from armgpi.control.sizes import batches, common_batch
from armgpi.gpi.gains import GainStep, Tuning
from armgpi.gpi.network import Boxes, BSplineNetwork
from armgpi.registry import Context


class ScheduleState(NamedTuple):
    """State of the schedule.

    Attributes:
        raised: by how much omega_c is above its lower end [rad/s].
    """

    raised: Array


@with_parameters
class GainSchedule(ErrorSchedule, Boxes):
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
    }

    def prepare(self, joint_names: Sequence[str], dt: float) -> GainSchedule:
        """Return the schedule as arrays over the joints; see :meth:`Gains.prepare`.

        Raises:
            ArrayError: when a value is not as declared, a box is upside down or a shape does not fit.
            ParameterError: when the leak is too fast for the sample time.
        """
        self.check_leak(dt)
        ready = object.__new__(GainSchedule)
        ready.__dict__.update(self.__dict__)
        ready.check_parameters(joint_names)
        ready._derive(dt)
        return ready

    def _derive(self, dt: float) -> None:
        """Work out what `step` needs."""
        ends: Any = self.omega_c
        low, high = ends
        self._low, self._span, self._dt = low, high - low, dt
        self.batch = common_batch(*batches(self))

    @classmethod
    def chosen(cls, context: Context) -> dict[str, Any]:
        """Return the box and scales of :meth:`BSplineNetwork.chosen`; see :meth:`Gains.chosen`."""
        return BSplineNetwork.chosen(context)

    def nominal(self) -> Tuning:
        """Return the tuning where the error is small: the lower end."""
        return Tuning(self._low, self.zeta_c, self._low)

    def init(self, e: Array) -> ScheduleState:
        """Return the state before the first sample, omega at its lower end; see :meth:`Gains.init`."""
        return ScheduleState(np.zeros_like(e))

    def step(self, e: Array, learn: Array, state: ScheduleState) -> GainStep:
        """Return the tuning for the tracking error `e`; see :meth:`Gains.step`."""
        w = self.raised(state.raised, e, self._span, learn, self._dt)
        omega = self._low + w
        return GainStep(Tuning(omega, self.zeta_c, omega), ScheduleState(w))

    def signals(self, state: ScheduleState) -> Mapping[str, Array]:
        """Return omega_c [rad/s], (..., n); see :meth:`Gains.signals`."""
        return {"omega_c": self._low + state.raised}

    def describe(self) -> Mapping[str, Any]:
        """Return the parameters as plain data."""
        return self.values()
