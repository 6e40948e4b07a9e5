"""Adaptive control after Slotine and Li (1987), with parameters of single joints, on positions alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.parameter import PerJoint, parameter, with_parameters
from armgpi.control.observer import Estimate, SmoothedController
from armgpi.references.reference import Target

#: Speed and acceleration that the regressor counts in [rad/s, rad/s^2].
_SPEED, _ACCELERATION = 1.0, 10.0


class Learned(NamedTuple):
    """What was learned of each joint, as accelerations [rad/s^2 or m/s^2].

    Attributes:
        constant: of constant torque.
        viscous: of viscous friction, at 1 rad/s.
        coulomb: of Coulomb friction.
        inertia: of inertia, at 10 rad/s^2.
    """

    constant: Array
    viscous: Array
    coulomb: Array
    inertia: Array


@with_parameters
class SlotineLi(SmoothedController):
    """tau = D(q) (a_r - k s + Y theta) + C(q, v^) v^ + G(q), with theta' = -gamma Y s.

    a_r = a* - omega_c e', s = e' + omega_c e, k = 2 omega_c, gamma = omega_c^2 adaptation; e, e' and v^ are
    estimates of a third-order observer. What is adapted are four parameters of each joint by itself: a
    constant torque, viscous and Coulomb friction, and inertia. The law of 1987 adapts the masses of all links
    by the regressor of the whole arm, which is not elementwise in the joints; so its proof of stability does
    not hold here.

    It measures positions and uses model feedforward (D, C, G).
    """

    config_name: ClassVar[str | None] = "slotineli"
    knows: ClassVar[str] = "model"
    cancels: ClassVar[bool] = True

    adaptation: PerJoint = parameter(
        "speed of adaptation over that of the feedback",
        default=0.25,
        least=0.0,
        per_joint=True,
        log=True,
        search=(0.01, 4.0),
        slider=(0.0, 2.0),
        kw_only=True,
    )
    leak: float = parameter(
        "rate at which the estimates of friction and inertia decay",
        unit="1/s",
        default=1.0,
        least=0.0,
        search=(0.01, 10.0),
        kw_only=True,
    )

    def __post_init__(self) -> None:
        """Check the parameters; see :class:`ObserverController`."""
        super().__post_init__()
        self._gamma_dt = self.adaptation * self.omega_c**2 * self.dt
        self._keep = max(1.0 - self.leak * self.dt, 0.0)

    def regressor(self, now: Estimate, target: Target) -> tuple[Array, ...]:
        """Return what the learned accelerations are multiplied by, without units.

        Args:
            now: estimates of velocity and disturbance.
            target: of this sample.

        Returns:
            Factors of the learned accelerations [1], each of shape (n,) or (batch, n).
        """
        rate = target.v + now.rate
        reference = target.a - self.omega_c * now.rate
        return (
            np.ones_like(rate),
            rate / _SPEED,
            rate / (np.abs(rate) + self.layer),
            reference / _ACCELERATION,
        )

    def law(self, now: Estimate, target: Target, own: Learned) -> Array:
        """Return v; see :meth:`ObserverController.law`."""
        s = now.rate + self.omega_c * now.e
        v: Array = -self.omega_c * (now.rate + 2.0 * s)
        for y, theta in zip(self.regressor(now, target), own, strict=True):
            v = v + y * theta
        return v

    def remembered(self, zero: Array) -> Learned:
        """Return that nothing is learned.

        Args:
            zero: zeros in the shape of a torque.
        """
        return Learned(zero, zero, zero, zero)

    def learned(self, now: Estimate, target: Target, missing: Array, own: Learned) -> Learned:
        """Return what is learned next; nothing winds up while the torque is cut.

        Args:
            now: estimates of velocity and disturbance.
            target: of this sample.
            missing: acceleration that the torque limits cut [rad/s² or m/s²], shape (n,) or (batch, n).
            own: what is learned so far.
        """
        s = now.rate + self.omega_c * now.e
        s = np.where(missing == 0.0, s, 0.0)
        constant, *others = (
            theta - self._gamma_dt * y * s for y, theta in zip(self.regressor(now, target), own, strict=True)
        )
        return Learned(constant, *(self._keep * theta for theta in others))

    def signals(self, state: Any) -> Mapping[str, Array]:
        """Return estimates and adapted parameters under their names; see :meth:`Controller.signals`."""
        return {**super().signals(state), **state.own._asdict()}
