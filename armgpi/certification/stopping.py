"""How far and how long a tool goes on when the supervisor stops the arm on its path; see docs/path.md."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armgpi.arrays import Array, check_number
from armgpi.certification.path import PathBound, Wish, bound_wish
from armgpi.errors import ParameterError
from armgpi.references.reference import Reference, Target
from armgpi.supervisor.bounds import Supervisor, bounds_of
from armgpi.supervisor.stop import NEAR

#: Moments of the path from which a stop is looked at, and of a stop; those whose errors are bounded.
_MOMENTS, _INSTANTS, _BOUNDED = 400, 60, 4
#: How long the law is watched after a stop [s].
_AFTER = 0.3
#: Widths of tubes that are tried for it.
_ROOM = (1.1, 1.7, 4.0)


class Retimed(Reference):
    """A path at another pace, after a rest."""

    def __init__(self, path: Reference, pace: float, rest: float) -> None:
        """Take the path, how many times as fast it is, and for how long it rests at first [s]."""
        self.path, self.pace, self.rest = path, pace, rest

    def at(self, t: float | Array) -> Target:
        """Return the target at time(s) `t` [s]; see :meth:`Reference.at`."""
        moving = np.asarray(t, float) > self.rest
        found = self.path.at(self.pace * np.maximum(np.asarray(t, float) - self.rest, 0.0))
        on = moving[..., None] * np.ones(found.q.shape[-1])
        return Target(found.q, self.pace * on * found.v, self.pace**2 * on * found.a)


class Stopped(Reference):
    """A path until a time, then each joint's stop, as :class:`armgpi.supervisor.stop.Stop` makes it."""

    def __init__(self, path: Reference, begin: float, slowing: Array, fastest: Array) -> None:
        """Take the path, when the stop begins [s], its decelerations, and the speeds that it begins at."""
        self.path, self.begin, self.slowing = path, begin, slowing
        self.q, v, _ = path.at(begin)
        self.v = np.clip(v, -fastest, fastest)
        self.lasts: Array = np.abs(self.v) / slowing

    def at(self, t: float | Array) -> Target:
        """Return the target at time(s) `t` [s]; see :meth:`Reference.at`."""
        t = np.asarray(t, float)
        before = self.path.at(np.minimum(t, self.begin))
        passed = np.minimum(np.maximum(t[..., None] - self.begin, 0.0), self.lasts)
        slower = np.sign(self.v) * self.slowing
        stopping, slowing = t[..., None] > self.begin, passed < self.lasts
        return Target(
            np.where(stopping, self.q + (self.v - 0.5 * slower * passed) * passed, before.q),
            np.where(stopping, (self.v - slower * passed) * slowing, before.v),
            np.where(stopping, -slower * slowing, before.a),
        )


class StopBound(NamedTuple):
    """How the supervisor stops a tool on its path.

    Attributes:
        tool_speed: of the tool at most, on the path at that pace [m/s].
        distance: way of the tool from where the stop begins, at most [m].
        time: until the last joint rests, at most [s].
        error: how far the tool is from there at most, while it stops and after it [m].
        reasons: why the error has no bound; empty where it has.
    """

    tool_speed: float
    distance: float
    time: float
    error: float
    reasons: tuple[str, ...]

    def __str__(self) -> str:
        """Return it in words."""
        said = (
            f"from {self.tool_speed:g} m/s the supervisor stops the tool within {1e3 * self.distance:.3g} mm "
            f"and {self.time:.2g} s of finding a fault"
        )
        if self.reasons:
            return f"{said}; the error beside it has no bound: {self.reasons[0]}"
        return f"{said}, and {1e3 * self.error:.3g} mm of error beside it"


def bound_stop(found: PathBound, tool_speed: float, supervisor: Supervisor | None = None) -> StopBound:
    """Return how far the tool goes on when the supervisor stops an arm whose joints still measure and drive.

    The path of a bound is driven at the pace at which the tool is as fast as stated. Ways and times are the
    longest of 400 moments; the errors, the largest of four of them. When the fault is found is not in it, nor
    FAULT, which is open loop.

    Args:
        found: a bound along the path; its disturbances act here as well.
        tool_speed: of the tool at most [m/s].
        supervisor: as :class:`armgpi.Supervisor` has it when not given.

    Raises:
        ParameterError: for a path on which the tool rests, or a speed that is none.
    """
    wish = found.wish
    law, h = wish.controller, wish.controller.dt
    check_number(tool_speed, "tool_speed", "a positive speed [m/s]", open_=True)
    q, v, _ = wish.reference.at(wish.samples)
    speed = np.linalg.norm(_tool_velocity(wish, q, v), axis=1)
    if not speed.max() > 0.0:
        raise ParameterError("reference", "a tool that rests", "a path on which the tool moves")
    pace = tool_speed / float(speed.max())
    path = Retimed(wish.reference, pace, (wish.delay + 2) * h)
    limits = bounds_of(law, supervisor or Supervisor())
    slowing, fastest = limits.slowing / h**2, limits.stop_velocity / h
    moving = wish.samples[speed > 0.01 * speed.max()] / pace + path.rest
    moments = h * np.rint(moving[np.linspace(0, len(moving) - 1, _MOMENTS).astype(int)] / h)
    stops = [Stopped(path, float(t), slowing, fastest) for t in moments]
    ways = np.array([_way(wish, stop) for stop in stops])
    chosen = {int(np.argmax(ways)), *np.linspace(0, len(stops) - 1, _BOUNDED + 1)[1:-1].astype(int).tolist()}
    made = []
    for stop in (stops[i] for i in sorted(chosen)):
        t_final = stop.begin + float(stop.lasts.max()) + _AFTER
        made.append(bound_wish(wish._replace(reference=stop, t_final=t_final), room=_ROOM))
    reasons = [reason for each in made for reason in each.reasons[:1]]
    if not reasons and max(each.error.max() for each in made) > NEAR:
        reasons = [f"a joint may be {NEAR:g} rad or m off, from where a stop begins at the joint"]
    longest = max(float(stop.lasts.max()) for stop in stops)
    error = float(np.max([each.tool for each in made]))
    return StopBound(tool_speed, float(ways.max()), longest, error, tuple(reasons))


def _tool_velocity(wish: Wish, q: Array, v: Array) -> Array:
    """Return the tool's velocity [m/s], (k, 3)."""
    robot = wish.arms[0]
    jacobian = robot.frame_jacobian(robot.tip, q)[:, :3]
    return np.asarray(np.einsum("kij,kj->ki", jacobian, v))


def _way(wish: Wish, stop: Stopped) -> float:
    """Return the length of the tool's way in a stop [m]."""
    longest = float(stop.lasts.max())
    at = stop.at(stop.begin + longest * (np.arange(_INSTANTS) + 0.5) / _INSTANTS)
    speed = np.linalg.norm(_tool_velocity(wish, at.q, at.v), axis=1)
    return float(speed.mean() * longest)
