"""Elastic joints in the fit of slow motions: links and motors are apart by the twist of the gears.

Encoders measure one of both sides, and the other one follows from the torque of the gear, S:

    encoders at the motors: q = theta - c S,  S = tau - J theta'' - friction,
    encoders at the links: theta = q + c S,  S = M(q) q'' + C q' + G,

where c is the compliance, 1 / K. Neither divides by a stiffness or by a difference, so both hold through the
resonance. The weak form has bodies at q, rotors and friction at theta, and is linear in c around a value.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.identification.weak_form import COLUMNS, COULOMB, OFFSET, ROTOR, VISCOUS, WeakForm
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears, lowest_mode

#: First mode below which a log is fitted with elastic joints [Hz], where it is known; and where the log
#: itself says it, which is less certain than that joints are elastic at all.
SOFT, MOST_SOFT = 10.0, 15.0
#: Standard deviation of a compliance that is assumed, as a share of it.
_ASSUMED = 30.0
#: Least compliance [rad/(N m) or m/N] and rotor [kg m^2 or kg] of which a first mode is computed.
_LEAST = 1e-9
#: Half width of a 95 % interval in standard deviations.
_95 = 1.96


class Twisted(NamedTuple):
    """The moments of a log whose gears are twisted, linear around what the twist was computed from.

    Attributes:
        form: with links and motors where they are.
        slope: by the compliances, (k, n, n).
        rows: by rotors, friction and offsets, as far as the twist follows from them, (k, n, n, 14).
        late: by the lags, likewise, (k, n, n).
        known: what these make of the values that the twist was computed from, (k, n).
    """

    form: WeakForm
    slope: Array
    rows: Array
    late: Array
    known: Array


class Twist(NamedTuple):
    """What the twist of the gears of an arm is computed from.

    Attributes:
        side: where the encoders are: "motor" or "link".
        compliance: of the gears [rad/(N m) or m/N], (n,).
        unknowns: of the joints, as of :data:`COLUMNS`, (n, 14).
        arm: with these bodies; without rotors.
        width: speed over which friction changes its sign [rad/s or m/s], (n,).
        lag: time by which positions lag behind torques [s], (n,).
        hidden: joints whose torque is measured behind the gear, (n,).
    """

    side: str
    compliance: Array
    unknowns: Array
    arm: Any
    width: Array
    lag: Array
    hidden: Array

    def gear_torque(self, form: WeakForm) -> Array:
        """Return the torques of the gears in a log [N m or N], (samples, n)."""
        q, v, a = form.links
        if self.side == "link":
            data = self.arm.createData()
            return np.array([pin.rnea(self.arm, data, *each) for each in zip(q, v, a, strict=True)])
        rotor, coulomb, viscous, offset = (self.unknowns[:, k] for k in (ROTOR, COULOMB, VISCOUS, OFFSET))
        inside = rotor * a + viscous * v + coulomb * self._sign(form, v) + offset
        return form.torque_at_positions(self.lag) - np.where(self.hidden, 0.0, inside)

    def _sign(self, form: WeakForm, v: Array) -> Array:
        """Return the sign of velocities, filtered as the accelerations are that jump where it does."""
        return form.smooth(v / np.sqrt(v**2 + self.width**2))

    def apply(self, form: WeakForm) -> Twisted:
        """Return the moments of a log with its gears twisted, linear around this twist."""
        gear = self.gear_torque(form)
        twisted = form  # with all that was worked out of it
        if self.compliance.any():
            twisted = form.with_twist(self.compliance * gear, self.side)
        if self.side == "link":
            slope = form.moments(self._of_motors(twisted, gear))
            return Twisted(
                twisted,
                slope,
                np.zeros((*slope.shape, len(COLUMNS))),
                np.zeros_like(slope),
                slope @ self.compliance,
            )
        _, v, a = form.links
        change = _Change(self.arm, twisted)
        slope = -change.by(gear)
        # The gear's torque is less by these, so the links are ahead by the compliance times each.
        c = np.where(self.hidden, 0.0, self.compliance)
        rows = np.zeros((*slope.shape, len(COLUMNS)))
        columns = {ROTOR: a, VISCOUS: v, COULOMB: self._sign(form, v), OFFSET: np.ones_like(v)}
        for place, inside in columns.items():
            rows[..., place] = change.by(c * inside)
        late = change.by(self.compliance * form.derivative(form.torque_at_positions(self.lag)))
        known = slope @ self.compliance + late @ self.lag
        known += np.einsum("kijp,jp->ki", rows, self.unknowns)
        return Twisted(twisted, slope, rows, late, known)

    def _of_motors(self, twisted: WeakForm, gear: Array) -> Array:
        """Return how the torques of rotors and friction change as the motors go ahead, (samples, n, n)."""
        first, second = twisted.both_derivatives(gear)
        rotor, coulomb, viscous = (self.unknowns[:, k] for k in (ROTOR, COULOMB, VISCOUS))
        sharp = self.width**2 / (twisted.velocity**2 + self.width**2) ** 1.5
        each = rotor * second + (viscous + coulomb * sharp) * first
        each = twisted.thin(np.where(self.hidden, 0.0, each))
        slope: Array = each[:, :, None] * np.eye(len(rotor))
        return slope

    def mode(self, middle: Array) -> float:
        """Return the first mode at a configuration [Hz]."""
        data = self.arm.createData()
        links = pin.crba(self.arm, data, middle)
        links = np.triu(links) + np.triu(links, 1).T
        stiffness = 1.0 / np.maximum(self.compliance, _LEAST)
        return lowest_mode(links, np.maximum(self.unknowns[:, ROTOR], _LEAST), stiffness)


class _Change:
    """How the torques of the bodies change with the positions of the links."""

    def __init__(self, arm: Any, form: WeakForm) -> None:
        """Work out the derivatives of inverse dynamics along a log."""
        data, n = arm.createData(), arm.nv
        q, v, a = (form.thin(each) for each in form.links)
        self.form = form
        self.by_q, self.by_v, self.mass = np.empty((3, len(q), n, n))
        for k in range(len(q)):
            by_q, by_v, mass = pin.computeRNEADerivatives(arm, data, q[k], v[k], a[k])
            self.by_q[k], self.by_v[k], self.mass[k] = by_q, by_v, mass
        # Pinocchio gives the upper half.
        self.mass = np.triu(self.mass) + np.triu(self.mass, 1).swapaxes(-1, -2)

    def by(self, ahead: Array) -> Array:
        """Return the moments where the link of each joint is ahead by values (samples, n): (k, n, n)."""
        first, second = (self.form.thin(each) for each in self.form.both_derivatives(ahead))
        ahead = self.form.thin(ahead)
        change = self.by_q * ahead[:, None] + self.by_v * first[:, None] + self.mass * second[:, None]
        return self.form.moments(change)


def expected_compliance(robot: Robot) -> tuple[Array, Array]:
    """Return the compliance that is known or assumed of the gears of an arm and its deviation, each (n,)."""
    soft = assume_gears(robot)
    stiffness = soft.drives.value("stiffness")
    low, high = soft.drives.interval("stiffness")
    mean = np.where(np.isfinite(stiffness), 1.0 / stiffness, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        std = (1.0 / low - 1.0 / high) / (2.0 * _95)
    known = knows_stiffness(robot)
    return mean, np.where(known & np.isfinite(std) & (std > 0.0), std, np.where(known, 0.1, _ASSUMED) * mean)


def knows_stiffness(robot: Robot) -> Array:
    """Return of which joints somebody said or published the stiffness, (n,)."""
    return np.array([source not in ("", "assumed") for source in robot.drives.sources("stiffness")])
