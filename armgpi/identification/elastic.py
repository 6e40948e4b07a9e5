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
from armgpi.identification.estimate import HALF_95
from armgpi.identification.weak_form import COLUMNS, COULOMB, OFFSET, ROTOR, VISCOUS, WeakForm
from armgpi.robot.robot import Robot
from armgpi.robot.rotors import assume_gears, lowest_mode

#: First mode below which a log is fitted with elastic joints [Hz], where it is known; and where the log
#: itself says it, which is less certain than that joints are elastic at all.
SOFT, MOST_SOFT = 10.0, 15.0
#: Standard deviation of a compliance that is assumed, as a share of it.
_ASSUMED = 30.0
#: Standard deviation of a compliance that is specified without an interval, as a share of it.
_EXACT = 0.1
#: Least compliance [rad/(N m) or m/N] and rotor [kg m^2 or kg] of which a first mode is computed.
_LEAST = 1e-9


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
        if self.side == "link":
            data = self.arm.createData()
            torques = []
            for q, v, a in zip(*form.links, strict=True):
                torques.append(pin.rnea(self.arm, data, q, v, a))
            return np.array(torques)
        torque, signs = form.torque_at_positions(self.lag), self._signs(form)
        return self._gear_of_motors(form, torque, signs)

    def _gear_of_motors(self, form: WeakForm, torque: Array, signs: Array) -> Array:
        """Return what rotors and friction leave of the torques of the motors, each (samples, n)."""
        rotor, coulomb, viscous, offset = self._of_motors
        inside = rotor * form.links.a + viscous * form.links.v + coulomb * signs + offset
        return torque - np.where(self.hidden, 0.0, inside)

    @property
    def _of_motors(self) -> tuple[Array, Array, Array, Array]:
        """Rotors, Coulomb friction, viscous friction and offsets, each (n,)."""
        rotor, coulomb, viscous, offset = self.unknowns[:, [ROTOR, COULOMB, VISCOUS, OFFSET]].T
        return rotor, coulomb, viscous, offset

    def _signs(self, form: WeakForm) -> Array:
        """Return the sign of velocities, filtered as the accelerations are that jump where it does."""
        v = form.links.v
        return form.smooth(v / np.sqrt(v**2 + self.width**2))

    def apply(self, form: WeakForm) -> Twisted:
        """Return the moments of a log with its gears twisted, linear around this twist."""
        return self._apply_to_links(form) if self.side == "link" else self._apply_to_motors(form)

    def _twisted(self, form: WeakForm, gear: Array) -> WeakForm:
        """Return the moments with motors and links apart by what torques of the gears, (samples, n), make."""
        if not self.compliance.any():
            return form  # with all that was worked out of it
        return form.with_twist(self.compliance * gear, self.side)

    def _apply_to_links(self, form: WeakForm) -> Twisted:
        """Return the moments where encoders are at the links: the motors go ahead of what was measured."""
        gear = self.gear_torque(form)
        twisted = self._twisted(form, gear)
        slope = form.moments(self._change_of_motors(twisted, gear))
        none = np.zeros((*slope.shape, len(COLUMNS)))
        return Twisted(twisted, slope, none, np.zeros_like(slope), slope @ self.compliance)

    def _apply_to_motors(self, form: WeakForm) -> Twisted:
        """Return the moments where encoders are at the motors: the links stay behind what was measured."""
        torque, signs = form.torque_at_positions(self.lag), self._signs(form)
        gear = self._gear_of_motors(form, torque, signs)
        twisted = self._twisted(form, gear)
        change = _Change(self.arm, twisted)
        slope = -change.by(gear)
        # The gear's torque is less by these, so the links are ahead by the compliance times each.
        compliance = np.where(self.hidden, 0.0, self.compliance)
        _, v, a = form.links
        rows = np.zeros((*slope.shape, len(COLUMNS)))
        rows[..., ROTOR] = change.by(compliance * a)
        rows[..., VISCOUS] = change.by(compliance * v)
        rows[..., COULOMB] = change.by(compliance * signs)
        rows[..., OFFSET] = change.by(compliance * np.ones_like(v))
        late = change.by(self.compliance * form.derivative(torque))
        known = slope @ self.compliance + late @ self.lag
        known += np.einsum("kijp,jp->ki", rows, self.unknowns)
        return Twisted(twisted, slope, rows, late, known)

    def _change_of_motors(self, twisted: WeakForm, gear: Array) -> Array:
        """Return how the torques of rotors and friction change as the motors go ahead, (samples, n, n)."""
        first, second = twisted.both_derivatives(gear)
        rotor, coulomb, viscous, _ = self._of_motors
        sharp = self.width**2 / (twisted.velocity**2 + self.width**2) ** 1.5
        change = rotor * second + (viscous + coulomb * sharp) * first
        change = twisted.thin(np.where(self.hidden, 0.0, change))
        slope: Array = change[:, :, None] * np.eye(len(rotor))
        return slope

    def mode(self, middle: Array) -> float:
        """Return the first mode at a configuration [Hz]."""
        data = self.arm.createData()
        upper = np.triu(pin.crba(self.arm, data, middle))
        links = upper + np.triu(upper, 1).T
        stiffness = 1.0 / np.maximum(self.compliance, _LEAST)
        rotors = np.maximum(self.unknowns[:, ROTOR], _LEAST)
        return lowest_mode(links, rotors, stiffness)


class _Change:
    """How the torques of the bodies change with the positions of the links."""

    def __init__(self, arm: Any, form: WeakForm) -> None:
        """Work out the derivatives of inverse dynamics along a log."""
        self.form = form
        data, n = arm.createData(), arm.nv
        q, v, a = (form.thin(values) for values in form.links)
        self.by_q, self.by_v, self.mass = np.empty((3, len(q), n, n))
        for k in range(len(q)):
            by_q, by_v, mass = pin.computeRNEADerivatives(arm, data, q[k], v[k], a[k])
            self.by_q[k], self.by_v[k], self.mass[k] = by_q, by_v, mass
        # Pinocchio gives the upper half.
        above_diagonal = np.triu(self.mass, 1)
        self.mass = np.triu(self.mass) + above_diagonal.swapaxes(-1, -2)

    def by(self, ahead: Array) -> Array:
        """Return the moments where the link of each joint is ahead by values (samples, n): (k, n, n)."""
        first, second = self.form.both_derivatives(ahead)
        by_position = self.by_q * self.form.thin(ahead)[:, None]
        by_velocity = self.by_v * self.form.thin(first)[:, None]
        by_acceleration = self.mass * self.form.thin(second)[:, None]
        return self.form.moments(by_position + by_velocity + by_acceleration)


def expected_compliance(robot: Robot) -> tuple[Array, Array]:
    """Return the compliance that is known or assumed of the gears of an arm and its deviation, each (n,)."""
    soft = assume_gears(robot)
    stiffness = soft.drives.value("stiffness")
    low, high = soft.drives.interval("stiffness")
    mean = np.where(np.isfinite(stiffness), 1.0 / stiffness, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        std = (1.0 / low - 1.0 / high) / (2.0 * HALF_95)
    known = knows_stiffness(robot)
    has_interval = known & np.isfinite(std) & (std > 0.0)
    without_interval = np.where(known, _EXACT, _ASSUMED) * mean
    return mean, np.where(has_interval, std, without_interval)


def knows_stiffness(robot: Robot) -> Array:
    """Return of which joints somebody said or published the stiffness, (n,)."""
    sources = robot.drives.sources("stiffness")
    return np.array([source not in ("", "assumed") for source in sources])
