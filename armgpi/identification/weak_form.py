"""The weak form of the equations of motion: linear in what is unknown, without accelerations.

The equations are multiplied by test functions phi of compact support and integrated by parts. With the
momentum p = D(q) v, linear in the unknowns, the rotor inertia J, and both frictions,

    int (-phi' p + phi (g - C^T v) + J phi'' q - f_v phi' q + f_c phi sign(v)) = int phi tau.

Velocity is needed inside D(q) v and C alone, where little depends on it.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

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


class Motion(NamedTuple):
    """A motion along a log, each (samples, n).

    Attributes:
        q: positions [rad or m].
        v: velocities [rad/s or m/s].
        a: accelerations [rad/s^2 or m/s^2].
    """

    q: Array
    v: Array
    a: Array


class WeakForm:
    """The moments of a log, as rows of a linear regression.

    Attributes:
        times: middle of each test function since the log began [s], shape (k,).
        starts: first sample of each test function, (k,).
    """

    def __init__(self, model: Any, grid: Grid) -> None:
        """Work out the moments of a log for a `pin.Model` with nq = nv.

        Where the log is shorter than a test function, there are none.
        """
        from scipy.interpolate import CubicSpline

        dt = grid.dt
        self._grid, self._model = grid, model
        self._step = max(1, round(_BODY_STEP / dt))
        coarse = self._step * dt
        self._count = max(DEGREE + 1, round(LENGTH / coarse)) * self._step  # samples of a test function
        self._hop = max(1, round(HOP / coarse)) * self._step
        self._first = -(-round((_TRIM + MOST_LAG) / dt) // self._step) * self._step
        cutoff = min(_CUTOFF, _CUTOFF_SHARE / dt)
        self._sections = low_pass(cutoff, 1.0 / dt)
        self._pad = min(len(grid.q) - 1, round(1.0 / dt))
        self._q = forth_and_back(self._sections, grid.q, self._pad)
        times = np.arange(len(self._q)) * dt
        self._v = CubicSpline(times, self._q).derivative()(times)
        # Of motors and links apart by the twist of gears: where the motors are, and how fast.
        self._motor_q, self._motor_v = grid.q, self._v
        last = len(grid.q) - self._first - self._count
        starts = np.arange(self._first, last, self._hop)
        gaps = np.append(0, np.cumsum(grid.bad))
        has_no_gap = gaps[starts + self._count] == gaps[starts]
        self.starts = starts[has_no_gap]
        self.times = (self.starts + 0.5 * self._count) * dt
        self._last_signs: tuple[Array, Array] | None = None  # width and moments
        self._last_moving: tuple[float, npt.NDArray[np.bool_]] | None = None  # speed and what is faster

    @cached_property
    def rows(self) -> Array:
        """Coefficients of the unknowns but for the sign of Coulomb friction, shape (k, n, n, 14)."""
        n = self._grid.q.shape[1]
        j = np.arange(n)
        by_value = self._weights(0)
        by_change = self._weights(1)
        by_second_change = self._weights(2)
        rows = np.zeros((len(self.starts), n, n, len(COLUMNS)))
        rows[..., : len(BODY)] = self._bodies
        rows[:, j, j, ROTOR] = self._moments(self._motor_q, by_second_change)
        rows[:, j, j, VISCOUS] = -self._moments(self._motor_q, by_change)
        rows[:, j, j, OFFSET] = by_value.sum()
        return rows

    def _weights(self, derivative: int) -> Array:
        """Return the samples of a test function, or of a derivative of it by time, times dt: (count + 1,)."""
        u = np.arange(self._count + 1) / self._count
        return bump(u, derivative) * self._grid.dt / self.length**derivative

    def in_order(self, order: Sequence[int], seconds: float) -> WeakForm:
        """Return the moments of a log's beginning with the positions of the joints in another order.

        Args:
            order: joint -> whose positions it gets.
            seconds: of the log.
        """
        count = round(seconds / self._grid.dt)
        q, tau, bad = self._grid.q[:count], self._grid.tau[:count], self._grid.bad[:count]
        grid = self._grid._replace(q=q[:, list(order)], tau=tau, bad=bad)
        return WeakForm(self._model, grid)

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

    @cached_property
    def links(self) -> Motion:
        """The motion of the links, filtered."""
        return Motion(self._q, self._v, self.derivative(self._v))

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
        first, second = spline(times, 1), spline(times, 2)
        return np.asarray(first), np.asarray(second)

    def torque_at_positions(self, lag: Array) -> Array:
        """Return the torques of the times of the positions, filtered like these [N m or N], (samples, n).

        Args:
            lag: time by which measured positions lag behind torques [s], shape (n,).
        """
        times = np.arange(len(self._q)) * self._grid.dt
        middle = times + 0.5 * self._grid.dt
        shifted = []
        for joint, late in enumerate(lag):
            shifted.append(np.interp(times - late, middle, self._grid.tau[:, joint]))
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
        other._last_signs = other._last_moving = None
        stale = ["rows"]  # of what was worked out before
        change = self.derivative(twist)
        if side == "motor":
            stale += ["links", "_bodies"]
            other._q, other._v = self._q - twist, self._v - change
        else:
            other._motor_q, other._motor_v = self._grid.q + twist, self._v + change
        for name in stale:
            other.__dict__.pop(name, None)
        return other

    def thin(self, values: Array) -> Array:
        """Return the samples (samples, ...) at which bodies are worked out."""
        return values[:: self._step]

    def moments(self, values: Array) -> Array:
        """Return the moments of torques at these, (thin samples, ...): [N m s or N s], (k, ...)."""
        count = self._count // self._step
        u = np.arange(count + 1) / count
        weights = bump(u) * self._grid.dt * self._step
        starts = self.starts // self._step
        windows = sliding_window_view(values, count + 1, axis=0)[starts]
        return np.asarray(windows @ weights, dtype=np.float64)

    def signs(self, width: Array, factor: Array | float = 1.0, velocity: Array | None = None) -> Array:
        """Return the moments of sign(v), smoothed over a width [rad/s or m/s] (n,); shape (k, n).

        Args:
            width: of the sign.
            factor: of each sample and joint, (samples, n).
            velocity: others than those of the joints, likewise.
        """
        if velocity is not None or not isinstance(factor, float):
            v = self._motor_v if velocity is None else velocity
            signs = factor * v / np.sqrt(v**2 + width**2)
            return self._moments(signs, self._weights(0))
        last = self._last_signs  # asked for again and again, as only the unknowns change
        if last is None or not np.array_equal(last[0], width):
            signs = self._motor_v / np.sqrt(self._motor_v**2 + width**2)
            last = (width.copy(), self._moments(signs, self._weights(0)))
            self._last_signs = last
        return factor * last[1]

    def moving(self, speed: float) -> npt.NDArray[np.bool_]:
        """Return which moments are of joints faster than a speed, (k, n): at rest friction has no sign."""
        if self._last_moving is None or self._last_moving[0] != speed:
            weights = bump(np.arange(self._count + 1) / self._count)
            is_fast = (np.abs(self._motor_v) > speed).astype(np.float64)
            fast_share = self._moments(is_fast, weights / weights.sum())
            self._last_moving = (speed, fast_share > _MOVING)
        return self._last_moving[1]

    def torque(self, lag: Array) -> tuple[Array, Array]:
        """Return the moments of the torque and their derivative by the lag, each (k, n).

        Args:
            lag: time by which measured positions lag behind torques [s], shape (n,), at most MOST_LAG.
        """
        dt = self._grid.dt
        pad = int(MOST_LAG / dt) + 1
        samples = np.arange(-pad, self._count + pad)[:, None]
        at: Any = (samples + 0.5) * dt + np.clip(lag, -MOST_LAG, MOST_LAG)
        windows: Any = sliding_window_view(self._grid.tau, len(at), axis=0)[self.starts - pad]
        moments = []
        for derivative in range(2):
            weights = bump(at / self.length, derivative) * dt / self.length**derivative
            moments.append(np.einsum("knm,mn->kn", windows, weights))
        value, slope = moments
        return value, slope

    def _moments(self, values: Array, weights: Array) -> Array:
        """Return the sums of values (samples, ...) under the test functions."""
        windows = sliding_window_view(values, len(weights), axis=0)[self.starts]
        return np.asarray(windows @ weights, dtype=np.float64)

    @cached_property
    def _bodies(self) -> Array:
        """Moments of the bodies' columns, shape (k, n, n, 10)."""
        used = slice(self._first, None, self._step)
        momentum, rest = _momentum_and_rest(self._model, self._q[used], self._v[used])
        count = self._count // self._step
        u = np.arange(count + 1) / count
        h = self._step * self._grid.dt
        by_value = bump(u) * h
        by_change = bump(u, 1) * h / self.length
        moments = []
        for first in (self.starts - self._first) // self._step:
            window = slice(first, first + count + 1)
            of_rest = np.tensordot(by_value, rest[window], 1)
            of_momentum = np.tensordot(by_change, momentum[window], 1)
            moments.append(of_rest - of_momentum)
        n = self._q.shape[1]
        return np.stack(moments).reshape(len(moments), n, n, len(BODY))


def _momentum_and_rest(model: Any, q: Array, v: Array) -> tuple[Array, Array]:
    """Return what bodies make of the momentum D(q) v, and of g - C^T v, at each sample.

    Args:
        model: a `pin.Model`.
        q: positions [rad or m], (samples, n).
        v: velocities [rad/s or m/s], (samples, n).

    Returns:
        Their regressors, each (samples, n, 10 n).
    """
    n = q.shape[1]
    still = np.zeros(n)
    free = model.copy()
    free.gravity = pin.Motion.Zero()
    free_data, data = free.createData(), model.createData()
    regressor = pin.computeJointTorqueRegressor
    momentum, rest = np.empty((2, len(q), n, 10 * n))
    for k, (position, velocity) in enumerate(zip(q, v, strict=True)):
        momentum[k] = regressor(free, free_data, position, still, velocity)
        change = regressor(free, free_data, position + _STEP * velocity, still, velocity).copy()
        change -= regressor(free, free_data, position - _STEP * velocity, still, velocity)
        rest[k] = regressor(model, data, position, velocity, still) - change / (2.0 * _STEP)
    return momentum, rest


def bump(u: Array, derivative: int = 0) -> Array:
    """Return the B-spline of DEGREE on [0, 1], or a derivative of it by u, at u; zero outside."""
    from scipy.interpolate import BSpline

    knots = np.linspace(0.0, 1.0, DEGREE + 2)
    spline = BSpline.basis_element(knots, extrapolate=False)
    values = spline.derivative(derivative)(u) if derivative else spline(u)
    return np.asarray(np.nan_to_num(values), dtype=np.float64)


def inverse_rows(model: Any, q: Array, v: Array, a: Array, width: Array) -> Array:
    """Return the rows of the equations themselves at (q, v, a), each (k, n); shape (k, n, n, 14)."""
    n = q.shape[1]
    data = model.createData()
    rows = np.zeros((len(q), n, n, len(COLUMNS)))
    bodies = rows[..., : len(BODY)]
    for k in range(len(q)):
        regressor = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])
        bodies[k] = regressor.reshape(n, n, len(BODY))
    j = np.arange(n)
    rows[:, j, j, ROTOR] = a
    rows[:, j, j, VISCOUS] = v
    rows[:, j, j, OFFSET] = 1.0
    rows[:, j, j, COULOMB] = v / np.sqrt(v**2 + width**2)
    return rows
