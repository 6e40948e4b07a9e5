"""How far and how long a tool goes on when the supervisor stops the arm on its path; see docs/path.md."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armgpi.base.arrays import Array, check_number
from armgpi.certification.path import PathBound, Wish, bound_wish
from armgpi.errors import ParameterError
from armgpi.references.reference import Reference, Target
from armgpi.supervisor.bounds import Supervisor, bounds_of
from armgpi.supervisor.stop import NEAR, Stop

#: Moments of the path from which a stop is looked at, and of a stop; those whose errors are bounded.
_MOMENTS, _INSTANTS, _BOUNDED = 200, 40, 4
#: Speed at which a joint rests [rad/s or m/s], and samples of a stop at most.
_STILL, _LONGEST = 1e-6, 100_000
#: How long the law is watched after a stop [s].
_AFTER = 0.3


class Retimed(Reference):
    """A path at another pace, after a rest."""

    def __init__(self, path: Reference, pace: float, rest: float) -> None:
        """Take the path, how many times as fast it is, and for how long it rests at first [s]."""
        self.path, self.pace, self.rest = path, pace, rest

    def at(self, t: float | Array) -> Target:
        """Return the target at time(s) `t` [s]; see :meth:`Reference.at`."""
        since = np.asarray(t, float) - self.rest
        moving = np.asarray(t, float) > self.rest
        q, v, a = self.path.at(self.pace * np.maximum(since, 0.0))
        on = moving[..., None] * np.ones(q.shape[-1])
        return Target(q, self.pace * on * v, self.pace**2 * on * a)


class Stopped(Reference):
    """A path until a time, then each joint's stop."""

    def __init__(self, path: Reference, begin: float, h: float, stop: Target) -> None:
        """Take the path, when the stop begins and the sample time [s], and the stop at samples (steps, n)."""
        self.path = path
        self.begin = begin
        self.h = h
        self.stop = stop

    def at(self, t: float | Array) -> Target:
        """Return the target at time(s) `t` [s]; see :meth:`Reference.at`."""
        time = np.asarray(t, float)
        before = self.path.at(np.minimum(time, self.begin))
        step = np.rint((time - self.begin) / self.h).astype(int)
        within = np.clip(step, 0, len(self.stop.q) - 1)
        stopping = (step > 0)[..., None]
        values = []
        for on_path, in_stop in zip(before, self.stop, strict=True):
            values.append(np.where(stopping, in_stop[within], on_path))
        return Target(*values)


def stops(stop: Stop, h: float, q: Array, v: Array) -> Target:
    """Return the references of a supervisor's stops from where they begin; times are the first axis.

    Args:
        stop: that of the supervisor.
        h: sample time [s].
        q: configurations at first [rad or m], (k, n).
        v: velocities at first [rad/s or m/s], (k, n).
    """
    v = np.clip(h * v, -stop.bounds.stop_velocity, stop.bounds.stop_velocity)
    rows = [(q, v, 0.0 * v)]
    while (np.abs(v) > _STILL * h).any() and len(rows) < _LONGEST:
        most = stop.deceleration(v, np.array(len(rows) - 1.0))
        less = np.clip(v, -most, most)
        q = q + v - 0.5 * less
        v = v - less
        rows.append((q, v, -less))
    rows.append((q, 0.0 * v, 0.0 * v))
    every_q, every_step, every_change = map(np.array, zip(*rows, strict=True))
    return Target(every_q, every_step / h, every_change / h**2)


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
            return f"{said}; the error that is added has no bound: {self.reasons[0]}"
        return f"{said}, and {1e3 * self.error:.3g} mm of error are added"


def bound_stop(found: PathBound, tool_speed: float, supervisor: Supervisor | None = None) -> StopBound:
    """Return how far the tool goes on when the supervisor stops an arm whose joints still measure and drive.

    The path of a bound is driven at the pace at which the tool is as fast as stated. Ways and times are the
    longest of 200 moments; the errors, the largest of four of them. When the fault is found is not in it, nor
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
    target = wish.reference.at(wish.samples)
    speed = np.linalg.norm(_tool_velocity(wish, target.q, target.v), axis=1)
    fastest = float(speed.max())
    if not fastest > 0.0:
        raise ParameterError("reference", "a tool at rest", "a path on which the tool moves")
    pace = tool_speed / fastest
    path = Retimed(wish.reference, pace, (wish.delay + 2) * h)
    supervisor = supervisor or Supervisor()
    stop = Stop(law, supervisor, bounds_of(law, supervisor))
    # Samples at which a stop may begin, evenly over where the tool moves.
    moving = wish.samples[speed > 0.01 * fastest] / pace + path.rest
    places = np.linspace(0, len(moving) - 1, _MOMENTS).astype(int)
    moments = h * np.rint(moving[places] / h)
    # All stops at once, arrays (samples, moments, n), and how far the tool goes in each.
    every = stops(stop, h, *path.at(moments)[:2])
    longest = h * (len(every.q) - 1)
    ways = _ways_of_tool(wish, every, h)
    evenly = np.linspace(0, _MOMENTS - 1, _BOUNDED + 1)[1:-1].astype(int)
    chosen = {int(np.argmax(ways)), *evenly.tolist()}
    bounds = []
    for i in sorted(chosen):
        course = Target(every.q[:, i], every.v[:, i], every.a[:, i])
        stopped = Stopped(path, float(moments[i]), h, course)
        t_final = stopped.begin + longest + _AFTER
        of_stop = wish._replace(reference=stopped, t_final=t_final)
        bounds.append(bound_wish(of_stop, bears=False))
    reasons: list[str] = []
    for bound in bounds:
        reasons.extend(bound.reasons[:1])
    largest = np.max([bound.error for bound in bounds])
    if not reasons and largest > NEAR:
        reasons = [f"The error of a joint can reach {NEAR:g} rad or m, where a stop begins at the joint."]
    error = float(np.max([bound.tool for bound in bounds]))
    return StopBound(tool_speed, float(ways.max()), longest, error, tuple(reasons))


def _ways_of_tool(wish: Wish, every: Target, h: float) -> Array:
    """Return how far the tool goes in each stop [m], (moments,), by the trapezoidal rule over some instants.

    Args:
        wish: of whose arm.
        every: the stops, (samples, moments, n).
        h: sample time [s].
    """
    instants = np.linspace(0, len(every.q) - 1, _INSTANTS).astype(int)
    n = wish.arms[0].n
    q = every.q[instants].reshape(-1, n)
    v = every.v[instants].reshape(-1, n)
    velocities = _tool_velocity(wish, q, v)
    speeds = np.linalg.norm(velocities, axis=1).reshape(_INSTANTS, -1)
    return np.asarray(np.trapezoid(speeds, h * instants, axis=0))


def _tool_velocity(wish: Wish, q: Array, v: Array) -> Array:
    """Return the tool's velocity [m/s], (k, 3)."""
    robot = wish.arms[0]
    jacobian = robot.frame_jacobian(robot.tip, q)[:, :3]
    return np.asarray(np.einsum("kij,kj->ki", jacobian, v))
