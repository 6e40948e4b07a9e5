"""Computed torque with a disturbance observer, on measured positions alone."""

from __future__ import annotations

from typing import ClassVar

from armgpi.base.parameter import with_parameters
from armgpi.control.observer import ScheduledController


@with_parameters
class ComputedTorqueDOB(ScheduledController):
    """tau = D(q) (a* + v) + C(q, v^) v^ + G(q), with v = -(omega_c^2 e + 2 zeta_c omega_c e' + zeta).

    It measures positions and uses the whole model. Velocity v^, error rate and what the model lacks (zeta)
    are estimates of a third-order observer. With an exact model zeta is zero.

    Source: inverse dynamics control, Siciliano et al., Robotics: Modelling, Planning and Control (2009),
    section 8.5.2; the observer is that of :class:`ADRC`.
    """

    config_name: ClassVar[str | None] = "ctdob"
    knows: ClassVar[str] = "model"
    cancels: ClassVar[bool] = True
