"""Active disturbance rejection (J. Han 2009), linear, with bandwidth as its parameter (Z. Gao 2003)."""

from __future__ import annotations

from typing import ClassVar

from armgpi.base.parameter import parameter, with_parameters
from armgpi.control.observer import ScheduledController


@with_parameters
class ADRC(ScheduledController):
    """tau = D^(q) v, v = -(omega_c^2 e + 2 zeta_c omega_c e' + zeta), from an extended state observer.

    It measures positions and uses the inertia matrix, as GPI does. As dt goes to zero it is a member of the
    family (:mod:`armgpi.gpi.family`): with an observer of order 3 that of one integrator, of order 4
    that of two, and one roll-off pole in both. The poles are (s + omega_c)^2 (s + omega_o)^order.

    Source: J. Han, From PID to active disturbance rejection control, IEEE Transactions on Industrial
    Electronics 56 (2009), 900-906; bandwidths as parameters: Z. Gao, American Control Conference 2003.

    Attributes:
        order: of the observer.
    """

    config_name: ClassVar[str | None] = "adrc"
    knows: ClassVar[str] = "inertia"

    order: int = parameter(
        "order of the observer: 3 rejects constant disturbances, 4 ramps",
        kind="integer",
        default=3,
        least=3,
        most=4,
        structural=True,
        kw_only=True,
    )

    @property
    def observer_order(self) -> int:
        """Order of the observer."""
        return self.order
