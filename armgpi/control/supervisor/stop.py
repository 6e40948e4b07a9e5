"""How a supervised arm is stopped: along a reference that decelerates, or by a torque in open loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from armgpi.arrays import Array
from armgpi.control.controller import Controller
from armgpi.control.supervisor.bounds import Bounds, own_inverse_inertia
from armgpi.control.supervisor.joints import Mask, any_joint
from armgpi.control.supervisor.state import Sample, Watch
from armgpi.references.reference import Target

#: A stop begins at the reference where the joint is as near to it as this [rad or m], else at the joint.
#: Set by hand: a tenth of what FOLLOWING allows.
_NEAR = 0.05
#: Rate at which FAULT damps a joint that still measures well, alone [1/s]; and its largest product with dt.
#: Set by hand: damping of one joint by its last velocity is stable up to 2.
_DAMPING, _DAMPED_AT_ONCE = 60.0, 0.3


class Stop:
    """The reference of a stop, and what FAULT does in place of the law.

    Attributes:
        bounds: all bounds.
        damping: torque per velocity by which FAULT damps a joint alone [N m s].
    """

    def __init__(self, law: Controller, on_fault: str, bounds: Bounds) -> None:
        self.bounds, self._dt, self._on_fault = bounds, law.dt, on_fault
        rate = min(_DAMPING, _DAMPED_AT_ONCE / law.dt)
        self.damping = np.asarray(rate / own_inverse_inertia(law))

    def reference(
        self, seen: Sample, entering: Mask, stopping: Mask, target: Target, watch: Watch
    ) -> tuple[Target, Array]:
        """Return the reference to follow, the one given or that of a stop, and its way in a sample.

        Args:
            seen: the sample.
            entering: whether a stop begins, (1,) or (batch, 1).
            stopping: whether one begins or goes on, likewise.
            target: the reference given.
            watch: what is kept.
        """
        # Where the joint did not follow, or nobody looked, the stop begins where it is, and as fast as it is.
        late = (watch.late > 0.0) & ~seen.lost
        apart = entering & ((np.abs(seen.e) > _NEAR) | late)
        # After a gap as fast as if it had changed its velocity evenly there.
        gap = 2.0 / (1.0 + np.maximum(watch.bad[..., :1], 0.0))
        own = np.where(late, (seen.q - watch.q) * gap - watch.v, watch.v)
        r, v = np.where(apart, seen.q, watch.r), np.where(apart, own, watch.rv)
        v = np.minimum(np.maximum(v, -self.bounds.stop_velocity), self.bounds.stop_velocity)
        less = np.minimum(np.maximum(v, -self.bounds.slowing), self.bounds.slowing)
        after = v - less
        way = np.where(stopping, after, target.q - watch.r)
        q = np.where(stopping, r + 0.5 * (v + after), target.q)
        return Target(q, way * (1.0 / self._dt), np.where(stopping, less * (-1.0 / self._dt**2), 0.0)), way

    def open_loop(
        self, opened: Mask, dead: Mask, turned: Mask, seen: Sample, v: Array, aim: Target, watch: Watch
    ) -> tuple[Array, tuple[Any, ...]]:
        """Return torque without a measurement that the law could use, and a motion that takes more.

        The motion is given as whether a torque is asked for, position, velocity and acceleration.

        Args:
            opened: whether the loop is open, (1,) or (batch, 1).
            dead: whether for good, likewise.
            turned: which joints answer their torque the wrong way.
            seen: the sample.
            v: velocities, smoothed [rad or m per sample].
            aim: the reference that decelerates.
            watch: what is kept.
        """
        on, torque = np.where(opened, watch.ready, 0.0), np.zeros_like(v)
        if self._on_fault == "zero":
            on = np.where(dead, 0.0, on)
        elif self._on_fault == "hold":
            aim = Target(np.where(dead, watch.q, aim.q), *(np.where(dead, 0.0, rate) for rate in aim[1:]))
        else:
            damped = dead & ~seen.distrusted
            # A motor that turns the other way makes other joints fast, too: a stop from there would be long.
            rests = damped & any_joint(turned)
            aim = Target(np.where(damped, seen.q, aim.q), *(np.where(rests, 0.0, x) for x in aim[1:]))
            torque = np.where(damped, self.damping * (aim.v - v * (1.0 / self._dt)), 0.0)
        return torque, (on, *aim)
