"""Damping of a tool that moves too fast beside its reference: what holds an arm beyond a force limit.

Up to a share of the speed limit it does nothing, so a motion as it was meant keeps its bits. From there on
the joints are damped in proportion to how much faster the tool is, whatever the controller asks for: a slow
controller that is pushed never comes to its force limit, and its arm would be as fast.

A damping late by T is stable up to a gain of pi / (2 T), of the motor alone beyond the resonance of an
elastic joint. It damps that resonance where the motor is measured, and drives it where the link is: there a
gain is left of what the joint damps by itself, which bounds no speed. Where nothing tells the side both have
to hold.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.control.bandwidth import FilteredDifference
from armgpi.control.impedance_limits import largest_damping, motor_share
from armgpi.robot.dynamics import Dynamics
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Bandwidths of the filtered difference of positions that are tried [rad/s].
_FILTERS = (500.0, 250.0, 120.0, 60.0, 30.0)
#: Gain times the time that filter, delay and hold take [-]: a phase margin of 64 degrees.
_GAIN = 0.45
#: Share of the speed limit from which on it brakes.
FREE = 0.4
#: Likewise beyond the resonance of an elastic joint, where its motor moves alone: 44 degrees.
_MOTOR_GAIN = 0.8
#: Share of the gain at which a resonance of elastic joints is no longer damped.
_SPARE = 0.5
#: Configurations in which resonances are taken.
_CONFIGURATIONS = 20


class _Brake(NamedTuple):
    """A brake that is possible: bandwidth of its filter [rad/s], damping over inertia [1/s], (n,)."""

    bandwidth: float
    gain: Array


class SpeedBrake:
    """Damps the joints of a tool that is faster than a share of its speed limit.

    Attributes:
        gain: damping over inertia of each joint [1/s], (n,).
        full: what it would be without elastic joints [1/s].
    """

    derived: ClassVar[Mapping[str, str]] = {
        "_decay": "share of the rate that a sample leaves [-]",
        "_drive": "from a difference of positions into the rate [1/s]",
        "_root": "root of the damping over inertia [1/s], where the tool is too fast",
    }

    def __init__(self, robot: Robot, dt: float, delay: float) -> None:
        """Choose filter and gain.

        Args:
            robot: the arm, with what is known of its drives.
            dt: sample time [s].
            delay: transport delay in the loop [s], besides the sample and hold.
        """
        matrices = robot.mass_matrix(random_configurations(robot, _CONFIGURATIONS, seed=0))
        inertias = np.diagonal(matrices, axis1=1, axis2=2)
        late = delay + 0.5 * dt
        share = motor_share(inertias, robot.drives)

        def brake_of(bandwidth: float) -> _Brake:
            resonant = _SPARE * largest_damping(inertias, bandwidth, late, robot.drives)
            alone = np.minimum(_GAIN, _MOTOR_GAIN * share)
            return _Brake(bandwidth, np.minimum(alone / (1.0 / bandwidth + late), resonant))

        best = max(map(brake_of, _FILTERS), key=lambda brake: float(brake.gain.min()))
        self.gain = best.gain
        self.full = _GAIN / (1.0 / _FILTERS[0] + late)
        self._root = np.sqrt(self.gain)
        self._decay, self._drive = FilteredDifference.of(best.bandwidth, dt)

    def rate(self, e: Array, last: Array, rate: Array) -> Array:
        """Return the filtered rate of the position error after a sample [rad/s or m/s].

        Args:
            e: position error [rad or m], (n,) or (batch, n).
            last: that of the last sample, likewise.
            rate: the filtered rate of the last sample, likewise.
        """
        filtered: Array = self._decay * rate + self._drive * (e - last)
        return filtered

    def torque(self, q: Array, rate: Array, fast: Array, dynamics: Dynamics) -> Array:
        """Return the torque that brakes [N m or N], exactly 0 where the tool is slow.

        Args:
            q: measured positions [rad or m], (n,) or (batch, n).
            rate: of the error [rad/s or m/s], likewise.
            fast: speed of the tool over its limit, (..., 1).
            dynamics: of the arm: its inertia scales the damping.
        """
        share = np.maximum(1.0 - FREE / np.maximum(fast, FREE), 0.0)
        brake: Array = self._root * dynamics.inertia_times(q, share * self._root * rate)
        return brake
