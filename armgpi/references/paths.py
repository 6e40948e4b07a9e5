"""Paths in space: where the tool shall be, as a function of time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from armgpi.base.arrays import SMALLEST, Array, ArrayLike, as_sized_array, as_times, check_type, is_listing
from armgpi.base.parameter import Parametrised, Vector, parameter, plain, with_parameters
from armgpi.errors import ArrayError, ParameterError
from armgpi.references.waypoints import Waypoints

#: What an experiment takes for the place and size of a path that is not given.
_CHOSEN = "a place where the arm has room, a tenth of its distance from the base"


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


class Turning(NamedTuple):
    """How the orientation of a path moves, arrays for times of shape (...).

    Attributes:
        rotation: rotation matrix in the base frame, (..., 3, 3).
        omega: angular velocity in the base frame [rad/s], (..., 3).
        alpha: angular acceleration [rad/s^2], likewise.
    """

    rotation: Array
    omega: Array
    alpha: Array


class Path(Parametrised, ABC):
    """A curve x(t) in the base frame, with two derivatives.

    Attributes:
        t_end: when it is over [s]; infinite for a curve that goes on.
        config_name: its `type` in experiment files; None for one that has none there.
        starts_moving: whether an experiment eases its beginning (:class:`Eased`).
    """

    config_name: ClassVar[str | None] = None
    starts_moving: ClassVar[bool] = False

    t_end: float = math.inf

    @abstractmethod
    def at(self, t: float | Array) -> PathPoint:
        """Return the point at time(s) `t`.

        Args:
            t: a time [s], or times of shape (...).

        Returns:
            Arrays of shape (3,), or (..., 3) with times.
        """

    def turning(self, t: float | Array) -> Turning | None:
        """Return how the orientation moves at time(s) `t` [s]; None for a path of positions alone."""
        return None

    def describe_time(self, t: float) -> str:
        """Return where on the path a time [s] is, in words for messages."""
        return f"t = {t:.4g} s"

    @classmethod
    def fitted(cls, point: Array, size: float) -> dict[str, Any]:
        """Return what an experiment takes for `chosen` parameters.

        Args:
            point: around which the arm has room [m], shape (3,).
            size: of the path [m].
        """
        return {}

    def describe(self) -> dict[str, Any]:
        """Return the path as plain data: its public attributes."""
        values: dict[str, Any] = {"type": type(self).__name__}
        for name, value in vars(self).items():
            if not name.startswith("_"):
                values[name] = plain(value)
        return values


@with_parameters
class LaserPath(Path):
    """The laser path of the paper, eq. 28.

    Its parameter t_k follows t_k <- (t_k + Delta) / 10, Delta <- Delta + h at every step h = 1e-4 s. The
    recursion settles, a factor of ten closer every step, on t_k = (Delta - h / 9) / 9: the parameter runs
    at a ninth of real time, 1.1e-5 s late. Here it is t / 9 exactly, which does not depend on a step.

    Attributes:
        rate: path parameter per second; 1/9 in the paper.
    """

    config_name: ClassVar[str | None] = "laser"

    rate: float = parameter(
        "path parameter per second; 1/9 in the paper", unit="1/s", default=1.0 / 9.0, least=0.0, above=True
    )

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        s = as_times(t, infinite=False) * self.rate
        one = np.ones_like(s)
        # cos(pi + s) sin(pi + s) = sin(2 s) / 2 and cos(pi + s)^2 = (1 + cos(2 s)) / 2.
        sine = np.sin(2.0 * s)
        cosine = np.cos(2.0 * s)
        x = [0.08 + 0.15 * s / 4.0, -0.15 + 0.025 * sine, 0.35 - 0.05 * cosine]
        dx_ds = [0.0375 * one, 0.05 * cosine, 0.1 * sine]
        ddx_dss = [0.0 * one, -0.1 * sine, 0.2 * cosine]
        return PathPoint(
            x=np.stack(x, axis=-1),
            v=self.rate * np.stack(dx_ds, axis=-1),
            a=self.rate * self.rate * np.stack(ddx_dss, axis=-1),
        )


@with_parameters
class Lissajous(Path):
    """x_i(t) = centre_i + amplitude_i sin(omega_i t + phase_i) on each axis.

    Attributes:
        centre: [m], shape (3,).
        amplitude: [m], shape (3,).
        omega: angular frequencies [rad/s], shape (3,).
        phase: phases [rad], shape (3,).
    """

    config_name: ClassVar[str | None] = "lissajous"
    starts_moving: ClassVar[bool] = True

    centre: Vector = parameter("centre", unit="m", kind="vector", chosen=_CHOSEN)
    amplitude: Vector = parameter("amplitude on each axis", unit="m", kind="vector", chosen=_CHOSEN)
    omega: Vector = parameter(
        "angular frequency on each axis", unit="rad/s", kind="vector", default=(1.0, 1.0, 2.0)
    )
    phase: Vector = parameter("phase on each axis", unit="rad", kind="vector", default=(0.0, 0.0, 0.0))

    @classmethod
    def fitted(cls, point: Array, size: float) -> dict[str, Any]:
        """Return an eight; see :meth:`Path.fitted`."""
        return {"centre": point, "amplitude": np.array([0.0, size, 0.5 * size])}

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        angle = as_times(t, infinite=False)[..., None] * self.omega + self.phase
        return PathPoint(
            x=self.centre + self.amplitude * np.sin(angle),
            v=self.amplitude * self.omega * np.cos(angle),
            a=-self.amplitude * self.omega**2 * np.sin(angle),
        )


@with_parameters
class Circle(Path):
    """A circle at constant speed.

    Attributes:
        centre: [m], shape (3,).
        radius: [m].
        period: time of a turn [s].
        normal: axis that it turns about, right-handed, shape (3,), of length one.
    """

    config_name: ClassVar[str | None] = "circle"
    starts_moving: ClassVar[bool] = True

    centre: Vector = parameter("centre", unit="m", kind="vector", chosen=_CHOSEN)
    radius: float = parameter("radius", unit="m", least=0.0, above=True, chosen=_CHOSEN)
    period: float = parameter("time of a turn", unit="s", default=6.0, least=0.0, above=True)
    normal: Vector = parameter(
        "axis that it turns about, right-handed", kind="vector", default=(0.0, 0.0, 1.0)
    )

    def __post_init__(self) -> None:
        """Check the circle; it begins at the point nearest to the direction of +x (or +y)."""
        super().__post_init__()
        length = float(np.linalg.norm(self.normal))
        if length < SMALLEST:
            raise ParameterError("normal", self.normal, "a direction")
        self.keep("normal", self.normal / length)
        along = np.eye(3)[0 if abs(self.normal[0]) < 0.9 else 1]
        first = along - self.normal * (self.normal @ along)
        self._first = first / np.linalg.norm(first)
        self._second = np.cross(self.normal, self._first)

    @classmethod
    def fitted(cls, point: Array, size: float) -> dict[str, Any]:
        """Return centre and radius; see :meth:`Path.fitted`."""
        return {"centre": point, "radius": size}

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        omega = 2.0 * math.pi / self.period
        angle = omega * as_times(t, infinite=False)[..., None]
        cosine = np.cos(angle)
        sine = np.sin(angle)
        out = self.radius * (cosine * self._first + sine * self._second)
        ahead = self.radius * (cosine * self._second - sine * self._first)
        return PathPoint(self.centre + out, omega * ahead, -omega * omega * out)


@with_parameters
class Polyline(Path):
    """Straight lines from corner to corner, stopping smoothly at each (Bezier moves, eq. 26).

    Attributes:
        corners: the corners [m], shape (m, 3).
        durations: of the lines [s].
        holds: how long it stands at each corner [s].
    """

    config_name: ClassVar[str | None] = "polyline"

    corners: Any = parameter("corners", unit="m", kind="points", chosen=_CHOSEN)
    durations: float | Sequence[float] = parameter(
        "duration of the lines, or of each", unit="s", kind="times", default=2.0, least=0.0, above=True
    )
    holds: float = parameter("how long it rests at each corner", unit="s", default=0.0, least=0.0)

    def __post_init__(self) -> None:
        """Check the corners and make moves of them."""
        if not is_listing(self.corners) or len(self.corners) == 0:
            raise ParameterError("corners", self.corners, "at least one point [m]")
        corners = [_vector(corner, "corners") for corner in self.corners]
        self.keep("corners", np.stack(corners))
        self._moves = Waypoints(list(self.corners), self.durations, self.holds)
        self.t_end = float(self._moves.t_end)

    @classmethod
    def fitted(cls, point: Array, size: float) -> dict[str, Any]:
        """Return a square; see :meth:`Path.fitted`."""
        square = np.array(
            [
                [-0.5, -0.5, 0.0],
                [0.5, -0.5, 0.0],
                [0.5, 0.5, 0.0],
                [-0.5, 0.5, 0.0],
                [-0.5, -0.5, 0.0],
            ]
        )
        return {"corners": point + size * square}

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        return PathPoint(*self._moves.at(t))


@with_parameters
class Eased(Path):
    """A path that begins at rest and comes up to its own speed, along the same curve.

    For t < duration the path's time is duration (s^3 - s^4 / 2) with s = t / duration: speed and
    acceleration are zero at the start, and nothing jumps when its own speed is reached.

    Attributes:
        path: the path.
        duration: how long the start takes [s].
    """

    path: Path = field()
    duration: float = parameter("how long the start takes", unit="s", default=1.0, least=0.0, above=True)

    def __post_init__(self) -> None:
        """Check the duration."""
        super().__post_init__()
        check_type(self.path, "path", Path, "a Path")
        self.t_end = self.path.t_end + 0.5 * self.duration

    def at(self, t: float | Array) -> PathPoint:
        """Return the point; see :meth:`Path.at`."""
        t = as_times(t)
        s = np.clip(t / self.duration, 0.0, 1.0)
        easing_in = self.duration * (s**3 - 0.5 * s**4)
        time_of_path = np.where(t < self.duration, easing_in, t - 0.5 * self.duration)
        x, v, a = self.path.at(time_of_path)
        speed = (s * s * (3.0 - 2.0 * s))[..., None]
        gain = (6.0 * s * (1.0 - s) / self.duration)[..., None]
        return PathPoint(x, v * speed, a * speed**2 + v * gain)

    def describe(self) -> dict[str, Any]:
        """Return the path as plain data."""
        return {"type": "Eased", "path": self.path.describe(), "duration": self.duration}


def line(start: ArrayLike, end: ArrayLike, duration: float) -> Polyline:
    """Return a straight line that is travelled at a smooth speed, at rest at both ends.

    Args:
        start: where it begins in the base frame [m], shape (3,).
        end: where it ends [m], shape (3,).
        duration: how long it takes [s].
    """
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
    a = _vector(corner, "corner")
    b = _vector(side, "side")
    c = _vector(other, "other")
    area = float(np.linalg.norm(b) * np.linalg.norm(c))
    if abs(float(b @ c)) > 1e-9 * area:
        raise ParameterError("other", c.tolist(), f"perpendicular to the first side {b.tolist()}")
    return Polyline([a, a + b, a + b + c, a + c, a], duration)


def _vector(value: ArrayLike, name: str) -> Array:
    """Return three numbers as an array."""
    array = as_sized_array(value, name)
    if array.shape != (3,):
        raise ArrayError(name, f"expected three numbers, got shape {array.shape}")
    return array
