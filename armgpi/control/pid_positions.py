"""PID with dynamic inversion on measured positions alone: its velocities are filtered differences."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.bandwidth import FilteredDifference
from armgpi.control.controller import ControlStep, FullState, Measurement
from armgpi.control.pid import PIDInversion, PIDState
from armgpi.references.reference import Target


class PIDPositionsState(NamedTuple):
    """State of the controller.

    Attributes:
        pid: that of the baseline.
        seen: positions and velocities at the last sample.
    """

    pid: PIDState
    seen: FullState


@with_parameters
class PIDPositions(PIDInversion):
    """:class:`PIDInversion` whose velocities are bandwidth s / (s + bandwidth) of the measured positions.

    The same filter as that of :class:`armgpi.Differentiated`, but part of the controller: it is exported with
    it. It measures positions and uses model feedforward (D, C, G).
    """

    measurement_type: ClassVar[type[Any]] = Measurement
    config_name: ClassVar[str | None] = "pid_positions"

    velocity_bandwidth: PerJoint = parameter(
        "bandwidth of the velocities' filter",
        unit="rad/s",
        default=200.0,
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(10.0, 2000.0),
        slider=(10.0, 1000.0),
        key="filter",
        kw_only=True,
    )

    def __post_init__(self) -> None:
        """Check the parameters and work out the filter; see :class:`PIDInversion`."""
        super().__post_init__()
        self._decay, self._drive = FilteredDifference.of(self.velocity_bandwidth, self.dt)

    def init(self, measurement: Any, target: Target) -> Any:
        """Return the state before the first sample, at rest; see :meth:`Controller.init`."""
        q = measurement.q
        at_rest = FullState(q, np.zeros_like(q))
        return PIDPositionsState(PIDInversion.init(self, at_rest, target), at_rest)

    def step(self, measurement: Any, target: Target, state: Any) -> ControlStep:
        """Return torque and next state; see :meth:`Controller.step`."""
        q = measurement.q
        v: Array = self._decay * state.seen.v + self._drive * (q - state.seen.q)
        seen = FullState(q, v)
        tau, pid = PIDInversion.step(self, seen, target, state.pid)
        return ControlStep(tau, PIDPositionsState(pid, seen))
