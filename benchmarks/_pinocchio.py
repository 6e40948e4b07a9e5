"""A plain Python loop on Pinocchio doing the work of ``armgpi.simulate``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from _peer import Array, Law, Trajectory, refuse_cut

WORLD = pin.Convention.WORLD


def without_gravity(model: Any) -> Any:
    """Return a copy of a model that weighs nothing: its inverse dynamics at rest is D(q) a."""
    free = model.copy()
    free.gravity = pin.Motion.Zero()
    return free


def run_single(model: Any, law: Law, q0: Array, q_ref: Array, effort: Array, dt: float) -> Trajectory:
    """Run one closed loop: rnea without gravity for D(q) v, four aba and the sums of Runge-Kutta by NumPy."""
    data, free = model.createData(), without_gravity(model)
    free_data = free.createData()
    q, v, taus = (np.empty(q_ref.shape) for _ in range(3))
    at, speed, rest, floor = q0.copy(), np.zeros(len(q0)), np.zeros(len(q0)), -effort
    rnea, aba, half, sixth = pin.rnea, pin.aba, np.array(0.5 * dt), np.array(dt / 6.0)
    two, step = np.array(2.0), np.array(dt)
    for k in range(len(q_ref)):
        q[k] = at
        v[k] = speed
        asked = rnea(free, free_data, at, rest, law.step(at - q_ref[k]))
        tau = np.minimum(np.maximum(asked, floor), effort)
        refuse_cut(tau - asked)
        a1 = aba(model, data, at, speed, tau, WORLD).copy()
        v2 = speed + half * a1
        a2 = aba(model, data, at + half * speed, v2, tau, WORLD).copy()
        v3 = speed + half * a2
        a3 = aba(model, data, at + half * v2, v3, tau, WORLD).copy()
        v4 = speed + step * a3
        a4 = aba(model, data, at + step * v3, v4, tau, WORLD)
        at = at + sixth * (speed + two * (v2 + v3) + v4)
        speed = speed + sixth * (a1 + two * (a2 + a3) + a4)
        taus[k] = tau
    return Trajectory(q, v, taus, at)
