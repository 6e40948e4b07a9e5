"""Paths in space: where the tool shall be, as a function of time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.arrays import Array, ArrayLike, as_float_array, check_number
from armgpi.errors import ArrayError, ParameterError
from armgpi.references.waypoints import Waypoints


class PathPoint(NamedTuple):
    """A point of a path with its derivatives, arrays of shape (..., 3) for times of shape (...).

    Attributes:
        x: position [m].
        v: velocity [m/s].
        a: acceleration [m/s^2].
    """

    x: Array
    v: Array
    a: Array


class Path(ABC):
    """A curve x(t) in the base frame, with two derivatives.

    Attributes:
        t_end: when it is over [s]; infinite for a curve that goes on.
    """

    t_end: float = math.inf

    @abstractmethod
    def at(self, t: float | Array) -> PathPoint:
        """Return the point at time(s) `t` [s]."""

    def describe(self) -> dict[str, Any]:
        """Return the path as plain data: its public attributes."""
        values = {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in vars(self).items()
            if not name.startswith("_")
        }
        return {"type": type(self).__name__, **values}


class LaserPath(Path):
    """The laser path of the paper, eq. 28.

    Its parameter t_k follows t_k <- (t_k + Delta) / 10, Delta <- Delta + h at every step h = 1e-4 s. The
    recursion settles, a factor of ten closer every step, on t_k = (Delta - h / 9) / 9: the parameter runs
    at a ninth of real time, 1.1e-5 s late. Here it is t / 9 exactly, which does not depend on a step.

    Attributes:
        rate: path parameter per second; 1/9 in the paper.
    """

    def __init__(self, rate: float = 1.0 / 9.0) -> None:
        """Set the speed along the path."""
        self.rate = check_number(rate, "rate", "positive [1/s]", open_=True)

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        s = np.asarray(t, dtype=np.float64) * self.rate
        one = np.ones_like(s)
        r, r2 = self.rate, self.rate * self.rate
        # cos(pi + s) sin(pi + s) = sin(2 s) / 2 and cos(pi + s)^2 = (1 + cos(2 s)) / 2.
        sine, cosine = np.sin(2.0 * s), np.cos(2.0 * s)
        return PathPoint(
            x=np.stack([0.08 + 0.15 * s / 4.0, -0.15 + 0.025 * sine, 0.35 - 0.05 * cosine], axis=-1),
            v=r * np.stack([0.0375 * one, 0.05 * cosine, 0.1 * sine], axis=-1),
            a=r2 * np.stack([0.0 * one, -0.1 * sine, 0.2 * cosine], axis=-1),
        )


class Lissajous(Path):
    """x_i(t) = centre_i + amplitude_i sin(omega_i t + phase_i) on each axis.

    Attributes:
        centre: [m], shape (3,).
        amplitude: [m], shape (3,).
        omega: angular frequencies [rad/s], shape (3,).
        phase: phases [rad], shape (3,).
    """

    def __init__(
        self, centre: ArrayLike, amplitude: ArrayLike, omega: ArrayLike, phase: ArrayLike = (0.0, 0.0, 0.0)
    ) -> None:
        """Define the curve; each argument has three numbers, one per axis."""
        self.centre, self.amplitude, self.omega, self.phase = (
            _vector(value, name)
            for value, name in (
                (centre, "centre"),
                (amplitude, "amplitude"),
                (omega, "omega"),
                (phase, "phase"),
            )
        )

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        angle = np.asarray(t, dtype=np.float64)[..., None] * self.omega + self.phase
        return PathPoint(
            x=self.centre + self.amplitude * np.sin(angle),
            v=self.amplitude * self.omega * np.cos(angle),
            a=-self.amplitude * self.omega**2 * np.sin(angle),
        )


class Circle(Path):
    """A circle at constant speed.

    Attributes:
        centre: [m], shape (3,).
        radius: [m].
        period: time of a turn [s].
        normal: axis that it turns about, right-handed, shape (3,), of length one.
    """

    def __init__(
        self, centre: ArrayLike, radius: float, period: float, normal: ArrayLike = (0.0, 0.0, 1.0)
    ) -> None:
        """Define the circle; it begins at the point nearest to the direction of +x (or +y)."""
        self.centre = _vector(centre, "centre")
        self.radius = check_number(radius, "radius", "positive [m]", open_=True)
        self.period = check_number(period, "period", "positive [s]", open_=True)
        axis = _vector(normal, "normal")
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            raise ParameterError("normal", normal, "a direction")
        self.normal = axis / length
        along = np.eye(3)[0 if abs(self.normal[0]) < 0.9 else 1]
        first = along - self.normal * (self.normal @ along)
        self._first = first / np.linalg.norm(first)
        self._second = np.cross(self.normal, self._first)

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        omega = 2.0 * math.pi / self.period
        angle = omega * np.asarray(t, dtype=np.float64)[..., None]
        out = self.radius * (np.cos(angle) * self._first + np.sin(angle) * self._second)
        ahead = self.radius * (np.cos(angle) * self._second - np.sin(angle) * self._first)
        return PathPoint(self.centre + out, omega * ahead, -omega * omega * out)


class Polyline(Path):
    """Straight lines from corner to corner, stopping smoothly at each (Bezier moves, eq. 26).

    Attributes:
        corners: the corners [m], shape (m, 3).
        durations: of the lines [s].
        holds: how long it stands at each corner [s].
    """

    def __init__(
        self, corners: Sequence[ArrayLike], durations: float | Sequence[float], holds: float = 0.0
    ) -> None:
        """Define the corners, the durations of the lines [s] and the time to stand at each corner [s]."""
        self.corners = np.stack([_vector(corner, "corners") for corner in corners])
        self.durations, self.holds = durations, holds
        self._moves = Waypoints(list(self.corners), durations, holds)
        self.t_end = float(self._moves.t_end)

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        return PathPoint(*self._moves.at(t))


class Eased(Path):
    """A path that begins at rest and comes up to its own speed, along the same curve.

    For t < duration the path's time is duration (s^3 - s^4 / 2) with s = t / duration: speed and
    acceleration are zero at the start, and nothing jumps when its own speed is reached.

    Attributes:
        path: the path.
        duration: how long the start takes [s].
    """

    def __init__(self, path: Path, duration: float = 1.0) -> None:
        """Ease the beginning of `path`."""
        self.path = path
        self.duration = check_number(duration, "duration", "positive [s]", open_=True)
        self.t_end = path.t_end + 0.5 * self.duration

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        t = np.asarray(t, dtype=np.float64)
        s = np.clip(t / self.duration, 0.0, 1.0)
        begun = self.duration * (s**3 - 0.5 * s**4)
        x, v, a = self.path.at(np.where(t < self.duration, begun, t - 0.5 * self.duration))
        speed = (s * s * (3.0 - 2.0 * s))[..., None]
        gain = (6.0 * s * (1.0 - s) / self.duration)[..., None]
        return PathPoint(x, v * speed, a * speed**2 + v * gain)

    def describe(self) -> dict[str, Any]:
        """Return the path as plain data."""
        return {"type": "Eased", "path": self.path.describe(), "duration": self.duration}


def line(start: ArrayLike, end: ArrayLike, duration: float) -> Polyline:
    """Return a straight line that takes `duration` [s]."""
    return Polyline([start, end], duration)


def rectangle(corner: ArrayLike, side: ArrayLike, other: ArrayLike, duration: float) -> Polyline:
    """Return a rectangle from a corner along two sides and back, each side taking `duration` [s].

    Args:
        corner: where it begins and ends [m], shape (3,).
        side: vector of the first side [m], shape (3,).
        other: vector of the second side [m], perpendicular to the first.
        duration: time for each side [s].

    Raises:
        ParameterError: when the sides are not perpendicular.
    """
    a, b, c = _vector(corner, "corner"), _vector(side, "side"), _vector(other, "other")
    if abs(float(b @ c)) > 1e-9 * float(np.linalg.norm(b) * np.linalg.norm(c)):
        raise ParameterError("other", c.tolist(), f"perpendicular to the first side {b.tolist()}")
    return Polyline([a, a + b, a + b + c, a + c, a], duration)


def _vector(value: ArrayLike, name: str) -> Array:
    """Return three numbers as an array."""
    array = as_float_array(value, name)
    if array.shape != (3,):
        raise ArrayError(name, f"expected three numbers, got shape {array.shape}")
    return array
