"""How the joints of any arm go along a path: integrated from node to node, exactly on the path between."""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from armgpi.base.arrays import Array
from armgpi.errors import LimitError, ParameterError, ReachError
from armgpi.references.paths import Path
from armgpi.references.reference import Target
from armgpi.robot.kinematics import TrackingInverse

#: Time from node to node [s].
_STEP = 0.01
#: Step of the central difference that gives the nodes' accelerations [s].
_DIFFERENCE = 1e-4
#: What the frame may miss the path by [m, rad].
_MISS = 1e-10
#: Correction of a step or of the interpolation beyond which they are astray [rad or m].
_ASTRAY = 1e-3
#: Parts of a step that goes astray as a whole, next to a singular configuration.
_PARTS = 16
#: Longest step of a scout [rad or m].
_LONGEST = 0.5
#: How many configurations to begin in are tried, for how many steps of so long [s], to stay so near [m, rad].
_SCOUTS, _SCOUT_STEPS, _SCOUT_STEP, _SCOUT_MISS = 16, 200, 0.05, 1e-5


class Track:
    """Joint positions along a path, with two continuous derivatives, whatever was asked for before.

    Nodes on a fixed grid of times follow the flow v = J^+ x' + N rate (home - q) by Runge-Kutta steps, and
    each is put on the path. Between two nodes a polynomial of degree five joins their positions, velocities
    and accelerations. It is put on the path as well, which moves it by its interpolation error alone.
    """

    def __init__(self, inverse: TrackingInverse, path: Path) -> None:
        """Begin at time 0.

        Raises:
            ReachError: when the path begins out of reach.
        """
        self.inverse = inverse
        self._path = path
        self._home = self._scout(inverse.candidates(path.at(np.zeros(1)).x[0]))
        self._nodes = self._with_rates(0, self._home[None])

    def _scout(self, q: Array) -> Array:
        """Return the starting configuration, of several, that follows the path the longest.

        All of them go ahead together, with large steps. On ends where one leaves the limits or the path.
        """
        inverse = self.inverse
        home = q[:_SCOUTS]
        if len(home) == 1:
            return np.asarray(home[0])
        q = home
        clearance = inverse.clearance(home)
        rows = np.arange(len(home))  # those that still go, of all
        score = np.zeros(len(home))
        for step in range(1, _SCOUT_STEPS):
            t = np.full(len(rows), _SCOUT_STEP * step)
            velocity = self._path.at(t - _SCOUT_STEP).v
            turning = self._path.turning(t - _SCOUT_STEP)
            omega = None if turning is None else turning.omega
            ahead = q + _SCOUT_STEP * inverse.flow(q, velocity, home[rows], omega)
            point, rotation = self._path.at(t).x, self._rotation(t)
            ahead = inverse.correct(ahead, point, 2, rotation)
            clearance = np.minimum(clearance, inverse.clearance(ahead))
            going = np.abs(ahead - q).max(axis=-1) < _LONGEST
            going &= clearance > 0.0
            going &= inverse.missed(ahead, point, rotation) < _SCOUT_MISS
            rows = rows[going]
            q = ahead[going]
            clearance = clearance[going]
            if not len(rows):
                break
            score[rows] = step + clearance / (1.0 + clearance)
        return np.asarray(home[np.argmax(score)])

    def at(self, times: Array) -> Target:
        """Return the target at times (k,) [s], arrays of shape (k, n).

        Raises:
            ParameterError: for a time before 0.
            ReachError: with the time and the point where the path cannot be followed farther.
            LimitError: with the time and the joint that would leave its limits.
        """
        if (times < -_STEP).any():
            raise ParameterError("t", float(times.min()), "zero or later [s]: the path begins there")
        before = np.ceil(times / _STEP).astype(int) - 1
        before = np.maximum(before, 0)
        self._grow(int(before.max(initial=0)) + 2)
        wish = self._between(times / _STEP - before, before)
        point = self._path.at(times)
        turning = self._path.turning(times)
        rotation = omega = None
        alpha: Array | float = 0.0
        if turning is not None:
            rotation, omega, alpha = turning
        q = self.inverse.correct(wish.q, point.x, 2, rotation)
        correction = np.abs(q - wish.q).max(axis=-1, initial=0.0)
        astray = ~(correction < _ASTRAY)  # which a number that is none is as well
        if astray.any():
            row = int(np.argmax(astray))
            self._give_up(float(times[row]), point.x[row], None if rotation is None else rotation[row])
        self._check_limits(times, q)
        v = self.inverse.resolve(q, point.v, wish.v, omega)
        drift = self.inverse.robot.frame_drift(self.inverse.frame, q, v)
        a = self.inverse.resolve(q, point.a - drift[:, :3], wish.a, alpha - drift[:, 3:])
        return Target(q, v, a)

    def _grow(self, count: int) -> None:
        """Have at least so many nodes."""
        first = len(self._nodes.q)
        if count <= first:
            return
        q = [self._nodes.q[-1:]]
        for node in range(first, count):
            q.append(self._next(q[-1], _STEP * (node - 1)))
        new = self._with_rates(first, np.concatenate(q[1:]))
        both = zip(self._nodes, new, strict=True)
        self._nodes = Target(*(np.concatenate(old_and_new) for old_and_new in both))

    def _with_rates(self, first: int, q: Array) -> Target:
        """Return nodes, of which the first has this number, with velocities and accelerations."""
        t = np.arange(first, first + len(q), dtype=np.float64) * _STEP
        self._check_limits(t, q)
        v = self._flow(t, q)
        step = _DIFFERENCE * v
        after = self._flow(t + _DIFFERENCE, q + step)
        before = self._flow(t - _DIFFERENCE, q - step)
        a = (after - before) / (2.0 * _DIFFERENCE)
        return Target(q, v, a)

    def _flow(self, t: Array, q: Array) -> Array:
        """Return the velocities at times (k,) and configurations (k, n)."""
        turning = self._path.turning(t)
        omega = None if turning is None else turning.omega
        return self.inverse.flow(q, self._path.at(t).v, self._home, omega)

    def _rotation(self, t: Array) -> Array | None:
        """Return the rotations at times (k,), where they move."""
        turning = self._path.turning(t)
        return None if turning is None else turning.rotation

    def _next(self, q: Array, t: float) -> Array:
        """Return the node that follows the one at `t`, shape (1, n)."""
        for substeps in (1, _PARTS):
            node = q
            h = _STEP / substeps
            for substep in range(substeps):
                guess = self._runge_kutta_step(node, t + substep * h, h)
                end = t + (substep + 1) * h
                then = np.array([end])
                point = self._path.at(then).x
                rotation = self._rotation(then)
                node = self.inverse.correct(guess, point, 3, rotation)
                is_near = np.abs(node - guess).max() < _ASTRAY
                if not is_near or self.inverse.missed(node, point, rotation)[0] > _MISS:
                    break
            else:
                return node
        self._give_up(end, point[0], None if rotation is None else rotation[0])

    def _runge_kutta_step(self, q: Array, t: float, h: float) -> Array:
        """Return a Runge-Kutta step of the flow from `t` on, as long as `h`."""
        now = np.array([t])
        k1 = self._flow(now, q)
        k2 = self._flow(now + 0.5 * h, q + 0.5 * h * k1)
        k3 = self._flow(now + 0.5 * h, q + 0.5 * h * k2)
        k4 = self._flow(now + h, q + h * k3)
        return q + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def _between(self, share: Array, before: Array) -> Target:
        """Return the polynomials at shares (k,) of the way from nodes `before` (k,) to the next."""
        h, s = _STEP, share[:, None]
        q0, v0, a0 = (x[before] for x in self._nodes)
        q1, v1, a1 = (x[before + 1] for x in self._nodes)
        # q0 + h s (v0 + h s (a0 / 2 + s (c3 + s (c4 + s c5)))), with c from q1, v1 and a1.
        dq = (q1 - q0) / h**2 - v0 / h - 0.5 * a0
        dv = (v1 - v0) / h - a0
        da = a1 - a0
        c3 = 10.0 * dq - 4.0 * dv + 0.5 * da
        c4 = -15.0 * dq + 7.0 * dv - da
        c5 = 6.0 * dq - 3.0 * dv + 0.5 * da
        q = q0 + h * s * (v0 + h * s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
        v = v0 + h * s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))
        a = a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))
        return Target(q, v, a)

    def _check_limits(self, times: Array, q: Array) -> None:
        """Refuse configurations outside the joint limits, naming the first time."""
        outside = self.inverse.robot.outside(q)
        if outside is not None:
            time = self._path.describe_time(times[outside.place[0]])
            remedy = "begin in another configuration (near=...), or hold less of the tool"
            raise LimitError(f"on the path at {time} the position", *outside[1:], remedy)

    def _give_up(self, t: float, point: Array, rotation: Array | None) -> NoReturn:
        """Raise why the path cannot be followed to a point, or a pose.

        Args:
            t: when the path is there [s].
            point: position of the frame [m], (3,).
            rotation: of the frame, where it moves, (3, 3).

        Raises:
            ReachError: always; it tells a point, or of a path of poses a pose, out of reach from one that
                another branch may reach.
        """
        try:
            self.inverse.begin(point, rotation)
        except ReachError as error:
            text = f"the path at {self._path.describe_time(t)}: {error}"
            raise ReachError(error.point, error.distance, text) from None
        text = ", ".join(f"{x:.6g}" for x in point)
        raise ReachError(
            tuple(point),
            0.0,
            f"the path at {self._path.describe_time(t)}: ({text}) m can be reached, but not from where the "
            "path begins: a singular configuration is between; begin in another one (near=...), or hold less "
            "of the tool",
        )
