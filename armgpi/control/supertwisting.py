"""Super-twisting sliding mode (A. Levant 1993) with the model, on measured positions alone."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.observer import Estimate, SmoothedController
from armgpi.references.reference import Target


@with_parameters
class SuperTwisting(SmoothedController):
    """tau = D(q) (a* + v) + C(q, v^) v^ + G(q), with the super-twisting algorithm as v.

        v = -omega_c e' - k1 sqrt(abs(s)) sign(s) + w,    w' = -k2 sign(s)

    The sliding variable is s = e' + omega_c e, with e and e' from a third-order observer; k1 = 1.5 sqrt(L)
    and k2 = 1.1 L reject every disturbance whose slope stays below L. In place of the sign is
    s / (abs(s) + layer), which does not chatter inside of the layer.

    It measures positions and uses the whole model. Source: A. Levant, Sliding order and sliding accuracy in
    sliding mode control, International Journal of Control 58 (1993), 1247-1263.
    """

    config_name: ClassVar[str | None] = "supertwisting"
    knows: ClassVar[str] = "model"
    cancels: ClassVar[bool] = True

    slope: PerJoint = parameter(
        "largest slope of a disturbance that it rejects",
        unit="rad/s^3 or m/s^3",
        default=100.0,
        least=0.0,
        above=True,
        per_joint=True,
        log=True,
        search=(1.0, 1e4),
        kw_only=True,
    )

    def __post_init__(self) -> None:
        """Check the parameters and work out both gains; see :class:`ObserverController`."""
        super().__post_init__()
        self._k1, self._k2_dt = 1.5 * np.sqrt(self.slope), 1.1 * self.slope * self.dt
        # Anti-windup by back-calculation with the time constant of the sliding surface.
        self._back = np.minimum(self.omega_c * self.dt, 1.0)

    def law(self, now: Estimate, target: Target, own: Array) -> Array:
        """Return v; see :meth:`ObserverController.law`."""
        s = now.rate + self.omega_c * now.e
        v: Array = own - self.omega_c * now.rate - self._k1 * s / np.sqrt(np.abs(s) + self.layer)
        return v

    def remembered(self, zero: Array) -> Array:
        """Return w before the first sample.

        Args:
            zero: zeros in the shape of a torque.

        Returns:
            w [rad/s² or m/s²], in the same shape.
        """
        return zero

    def learned(self, now: Estimate, target: Target, missing: Array, own: Array) -> Array:
        """Return the next w.

        Args:
            now: estimates of velocity and disturbance.
            target: of this sample.
            missing: acceleration that the torque limits cut [rad/s² or m/s²], shape (n,) or (batch, n).
            own: w, the integral of the sign [rad/s² or m/s²], likewise.

        Returns:
            w at the next sample, likewise.
        """
        s = now.rate + self.omega_c * now.e
        w: Array = own - self._k2_dt * s / (np.abs(s) + self.layer) + self._back * missing
        return w
