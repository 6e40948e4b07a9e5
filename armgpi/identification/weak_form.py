"""The weak form of the equations of motion: linear in what is unknown, without accelerations.

The equations are multiplied by test functions phi of compact support and integrated by parts. With the
momentum p = D(q) v, linear in the unknowns, the rotor inertia J, and both frictions,

    int (-phi' p + phi (g - C^T v) + J phi'' q - f_v phi' q + f_c phi sign(v)) = int phi tau.

Velocity is needed inside D(q) v and C alone, where little depends on it.
"""

from __future__ import annotations

import copy
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from numpy.lib.stride_tricks import sliding_window_view

from armgpi.base.arrays import Array
from armgpi.identification.filters import forth_and_back, low_pass
from armgpi.identification.logs import Grid

#: What is estimated of each joint: its body (mass, first moments, second moments about the joint's frame),
#: its rotor and its friction.
BODY = ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
COLUMNS = (*BODY, "rotor", "coulomb", "viscous", "offset")
ROTOR, COULOMB, VISCOUS, OFFSET = range(len(BODY), len(COLUMNS))
#: Test functions: B-splines of this degree and length [s], one begins every HOP [s]. They pass what is below
#: some 5 Hz, where excitation is and noise is not.
DEGREE, LENGTH, HOP = 5, 0.4, 0.1
#: Cut-off of the filter on positions [Hz], and the most that it may be of the sampling rate.
_CUTOFF, _CUTOFF_SHARE = 30.0, 0.2
#: What the filter's ends are dropped of a log [s].
_TRIM = 0.3
#: Bodies' columns are worked out this often [s]; nothing in them is faster than the filter.
_BODY_STEP = 0.004
#: Step of the difference that gives dY_p/dt [s].
_STEP = 1e-4
#: Largest lag that is looked for, either way [s].
MOST_LAG = 0.05
#: Share of a test function's weight in which a joint has to move for its friction to have a sign.
_MOVING = 0.5


class WeakForm:
    """The moments of a log, as rows of a linear regression.

    Attributes:
        times: middle of each test function since the log began [s], shape (k,).
    """

    def __init__(self, model: Any, grid: Grid) -> None:
        """Work out the moments of a log for a `pin.Model` with nq = nv.

        Where the log is shorter than a test function, there are none.
        """
        from scipy.interpolate import CubicSpline

        self._grid, self._model, dt = grid, model, grid.dt
        self._step = max(1, round(_BODY_STEP / dt))
        coarse = self._step * dt
        self._count = max(DEGREE + 1, round(LENGTH / coarse)) * self._step  # samples of a test function
        self._hop = max(1, round(HOP / coarse)) * self._step
        self._first = -(-round((_TRIM + MOST_LAG) / dt) // self._step) * self._step
        cutoff = min(_CUTOFF, _CUTOFF_SHARE / dt)
        self._sections = low_pass(cutoff, 1.0 / dt)
        self._pad = min(len(grid.q) - 1, round(1.0 / dt))
        self._q = forth_and_back(self._sections, grid.q, self._pad)
        self._v = CubicSpline(np.arange(len(self._q)) * dt, self._q).derivative()(
            np.arange(len(self._q)) * dt
        )
        # Of motors and links apart by the twist of gears: where the motors are, and how fast.
        self._motor_q, self._motor_v = grid.q, self._v
        last = len(grid.q) - self._first - self._count
        starts = np.arange(self._first, last, self._hop)
        gaps = np.append(0, np.cumsum(grid.bad))
        self.starts = starts[gaps[starts + self._count] == gaps[starts]]
        self.times = (self.starts + 0.5 * self._count) * dt

    @cached_property
    def rows(self) -> Array:
        """Coefficients of the unknowns but for the sign of Coulomb friction, shape (k, n, n, 14)."""
        n = self._grid.q.shape[1]
        u = np.arange(self._count + 1) / self._count
        weights = [bump(u, k) * self._grid.dt / self.length**k for k in range(3)]
        rows = np.zeros((len(self.starts), n, n, len(COLUMNS)))
        rows[..., : len(BODY)] = self._bodies()
        q, j = self._motor_q, np.arange(n)
        rows[:, j, j, ROTOR] = self._moments(q, weights[2])
        rows[:, j, j, VISCOUS] = -self._moments(q, weights[1])
        rows[:, j, j, OFFSET] = weights[0].sum()
        return rows

    @property
    def length(self) -> float:
        """Length of a test function [s]."""
        return self._count * self._grid.dt

    @property
    def hop(self) -> float:
        """Time from one test function to the next [s]."""
        return self._hop * self._grid.dt

    @property
    def speed(self) -> Array:
        """Largest speed of each joint [rad/s or m/s], shape (n,)."""
        return np.asarray(np.abs(self._v).max(axis=0))

    @property
    def velocity(self) -> Array:
        """Velocities of the motors, filtered [rad/s or m/s], shape (samples, n)."""
        return np.asarray(self._motor_v)

    @property
    def position(self) -> Array:
        """Positions of the links, filtered [rad or m], shape (samples, n)."""
        return np.asarray(self._q)

    @property
    def links(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations of the links, filtered, each (samples, n)."""
        return self._q, self._v, self.derivative(self._v)

    def derivative(self, values: Array) -> Array:
        """Return the derivative of values (samples, n) by time."""
        from scipy.interpolate import CubicSpline

        times = np.arange(len(values)) * self._grid.dt
        return np.asarray(CubicSpline(times, values)(times, 1))

    def both_derivatives(self, values: Array) -> tuple[Array, Array]:
        """Return the first and second derivative of values (samples, n) by time."""
        from scipy.interpolate import CubicSpline

        times = np.arange(len(values)) * self._grid.dt
        spline = CubicSpline(times, values)
        return np.asarray(spline(times, 1)), np.asarray(spline(times, 2))

    def torque_at_positions(self, lag: Array) -> Array:
        """Return the torques of the times of the positions, filtered like these [N m or N], (samples, n).

        Args:
            lag: time by which measured positions lag behind torques [s], shape (n,).
        """
        times = np.arange(len(self._q)) * self._grid.dt
        middle = times + 0.5 * self._grid.dt
        shifted = [
            np.interp(times - late, middle, column)
            for late, column in zip(lag, self._grid.tau.T, strict=True)
        ]
        return self.smooth(np.stack(shifted, axis=-1))

    def smooth(self, values: Array) -> Array:
        """Return values (samples, n) behind the filter of the positions."""
        return forth_and_back(self._sections, values, self._pad)

    def with_twist(self, twist: Array, side: str) -> WeakForm:
        """Return the moments of the same log where the motors are ahead of the links by a twist.

        Args:
            twist: of the gears, filtered [rad or m], (samples, n).
            side: where the log's positions were measured: "motor" or "link".
        """
        other = copy.copy(self)
        other.__dict__.pop("rows", None)
        change = self.derivative(twist)
        if side == "motor":
            other._q, other._v = self._q - twist, self._v - change
        else:
            other._motor_q, other._motor_v = self._grid.q + twist, self._v + change
        return other

    def thin(self, values: Array) -> Array:
        """Return the samples (samples, ...) at which bodies are worked out."""
        return values[:: self._step]

    def moments(self, values: Array) -> Array:
        """Return the moments of torques at these, (thin samples, ...): [N m s or N s], (k, ...)."""
        count = self._count // self._step
        weights = bump(np.arange(count + 1) / count) * self._grid.dt * self._step
        windows = sliding_window_view(values, count + 1, axis=0)[self.starts // self._step]
        return np.asarray(windows @ weights, dtype=np.float64)

    def signs(self, width: Array, factor: Array | float = 1.0, velocity: Array | None = None) -> Array:
        """Return the moments of sign(v), smoothed over a width [rad/s or m/s] (n,); shape (k, n).

        Args:
            width: of the sign.
            factor: of each sample and joint, (samples, n).
            velocity: others than those of the joints, likewise.
        """
        u, v = np.arange(self._count + 1) / self._count, self._motor_v if velocity is None else velocity
        return self._moments(factor * v / np.sqrt(v**2 + width**2), bump(u) * self._grid.dt)

    def moving(self, speed: float) -> npt.NDArray[np.bool_]:
        """Return which moments are of joints faster than a speed, (k, n): at rest friction has no sign."""
        u = np.arange(self._count + 1) / self._count
        weights = bump(u)
        fast = (np.abs(self._motor_v) > speed).astype(np.float64)
        moving: npt.NDArray[np.bool_] = self._moments(fast, weights / weights.sum()) > _MOVING
        return moving

    def torque(self, lag: Array) -> tuple[Array, Array]:
        """Return the moments of the torque and their derivative by the lag, each (k, n).

        Args:
            lag: time by which measured positions lag behind torques [s], shape (n,), at most MOST_LAG.
        """
        dt, pad = self._grid.dt, int(MOST_LAG / self._grid.dt) + 1
        at: Any = (np.arange(-pad, self._count + pad)[:, None] + 0.5) * dt + np.clip(lag, -MOST_LAG, MOST_LAG)
        windows: Any = sliding_window_view(self._grid.tau, len(at), axis=0)[self.starts - pad]
        value, slope = (
            np.einsum("knm,mn->kn", windows, bump(at / self.length, k) * dt / self.length**k)
            for k in range(2)
        )
        return value, slope

    def _moments(self, values: Array, weights: Array) -> Array:
        """Return the sums of values (samples, ...) under the test functions."""
        windows = sliding_window_view(values, len(weights), axis=0)[self.starts]
        return np.asarray(windows @ weights, dtype=np.float64)

    def _bodies(self) -> Array:
        """Return the moments of the bodies' columns, shape (k, n, n, 10)."""
        used = slice(self._first, None, self._step)
        q, v, n = self._q[used], self._v[used], self._q.shape[1]
        free, still = self._model.copy(), np.zeros(n)
        free.gravity = pin.Motion.Zero()
        data, own = free.createData(), self._model.createData()
        momentum, rest = np.empty((2, len(q), n, 10 * n))
        regressor = pin.computeJointTorqueRegressor
        for k, (p, w) in enumerate(zip(q, v, strict=True)):
            momentum[k] = regressor(free, data, p, still, w)
            change = regressor(free, data, p + _STEP * w, still, w).copy()
            change -= regressor(free, data, p - _STEP * w, still, w)
            rest[k] = regressor(self._model, own, p, w, still) - change / (2.0 * _STEP)
        count = self._count // self._step
        u = np.arange(count + 1) / count
        h = self._step * self._grid.dt
        weights = [bump(u, k) * h / self.length**k for k in range(2)]
        first = (self.starts - self._first) // self._step
        found: Array = np.stack(
            [
                np.tensordot(weights[0], rest[i : i + count + 1], 1)
                - np.tensordot(weights[1], momentum[i : i + count + 1], 1)
                for i in first
            ]
        )
        return found.reshape(len(first), n, n, len(BODY))


def bump(u: Array, derivative: int = 0) -> Array:
    """Return the B-spline of DEGREE on [0, 1], or a derivative of it by u, at u; zero outside."""
    from scipy.interpolate import BSpline

    spline = BSpline.basis_element(np.linspace(0.0, 1.0, DEGREE + 2), extrapolate=False)
    values = spline.derivative(derivative)(u) if derivative else spline(u)
    return np.asarray(np.nan_to_num(values), dtype=np.float64)


def inverse_rows(model: Any, q: Array, v: Array, a: Array, width: Array) -> Array:
    """Return the rows of the equations themselves at (q, v, a), each (k, n); shape (k, n, n, 14)."""
    n, data = q.shape[1], model.createData()
    rows = np.zeros((len(q), n, n, len(COLUMNS)))
    for k in range(len(q)):
        body = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])
        rows[k, ..., : len(BODY)] = body.reshape(n, n, len(BODY))
    j = np.arange(n)
    rows[:, j, j, ROTOR], rows[:, j, j, VISCOUS], rows[:, j, j, OFFSET] = a, v, 1.0
    rows[:, j, j, COULOMB] = v / np.sqrt(v**2 + width**2)
    return rows
