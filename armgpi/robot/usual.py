"""Where an arm moves if nothing specifies it: not through singular or upright configurations, nor itself."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.robot.clearance import Clearance, usual_floor
from armgpi.robot.collisions import shape_files
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: How far every joint moves [rad or m].
_MOVE = 0.5
#: Share of a joint's range beyond the start that the move may use [-].
_SHARE_OF_RANGE = 0.5
#: Parts of the move that are tried, in this order [-].
_SCALES = (1.0, -1.0, 0.5, -0.5, 0.25, -0.25, 0.125, -0.125)
#: Share of a joint's effort that holding the arm may take on the way [-].
_HOLDING_SHARE = 0.9
#: What counts as rounding, as a share [-].
_ROUNDING = 1e-9
#: Least conditioning on the way from the middle of the joint ranges [-]: smallest singular value of the
#: Jacobian over its median at random configurations.
_CONDITIONING = 0.25
#: The same of starts that replace the middle [-].
_WANTED_CONDITIONING = 0.5
#: Height of the centre of mass from which a configuration is upright, as a share of its range [-].
_UPRIGHT = 0.95
#: Number of configurations by which conditioning and height are scaled.
_SAMPLES = 256
#: Number of other starts that are tried.
_TRIED = 256
#: Number of configurations on a way for the first choice of starts.
_COARSE = 5
#: The same for the last check.
_FINE = 21
#: Farthest that a turning joint starts from the middle of its range [rad].
_FARTHEST = 0.5 * math.pi
#: The same as a share of the joint's range [-].
_RANGE = 0.4
#: The same of a slide without limits [m].
_SLIDE = 0.5
#: Starts are rounded to this [rad or m].
_GRID = 0.1
#: Most ways that are compared with the collision shapes.
_COMPARED = 100
#: Size of meshes up to which they are compared [B].
_MOST_BYTES = 10_000_000
#: Singular values below this share of the largest are 0 in every configuration: a direction without motion.
_SINGULAR = 1e-6
#: Joints from which a tool can have any orientation.
_POSE = 6


class Ends(NamedTuple):
    """Start and goal of a move [rad or m], shape (n,) each."""

    start: Array
    goal: Array


def usual_ends(robot: Robot) -> Ends:
    """Return start and goal of the move of an arm for which nothing specifies one.

    The move starts in the middle of the joint ranges, where the arm is well-conditioned there and on the way,
    not upright, held by its motors, and clear of itself and the floor. Else it starts at the nearest of some
    configurations for which all this holds, with as many joints in the middle as possible. Where none is
    found, clearance is given up first, then conditioning; at last it starts in the middle.

    Args:
        robot: the arm.
    """
    judge = _Judge(robot)
    middle = _from(robot, judge, robot.middle(), _CONDITIONING)
    clearance = _clearance(robot)
    if middle is not None and _is_clear(clearance, middle):
        return middle
    near = _other_starts(robot)
    for least in (_WANTED_CONDITIONING, _CONDITIONING):
        found = _search(robot, judge, near, least, clearance)
        if found is not None:
            return found
    if middle is not None:
        return middle
    if clearance is not None:
        for least in (_CONDITIONING, 0.0):
            found = _search(robot, judge, near, least, None)
            if found is not None:
                return found
    return Ends(robot.middle(), any_goal(robot, robot.middle()))


class _Judge:
    """Conditioning, height of the centre of mass, and holding torques of an arm."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        samples = random_configurations(robot, _SAMPLES, seed=0)
        J = robot.frame_jacobian(robot.tip, samples)
        turning = ~robot.prismatic
        # The longest lever makes lengths comparable with angles; of an arm that slides alone, one metre.
        self._length = float(np.linalg.norm(J[:, :3] * turning, axis=1).max()) or 1.0
        self._units = np.where(turning, 1.0, self._length)
        self._medians = [np.median(values, axis=0) for values in self._singular_values(samples)]
        self._model = robot.pinocchio_model()
        self._data = self._model.createData()
        energies = self._energies(samples)
        self._lowest, self._span = float(energies.min()), float(np.ptp(energies))

    def conditioning(self, q: Array) -> Array:
        """Return the smallest singular value over its median at random configurations, (k,).

        It is the smaller one of those of the tool's position, and from six joints on of its pose.
        """
        smallest = np.full(len(q), math.inf)
        for values, median in zip(self._singular_values(q), self._medians, strict=True):
            largest = max(float(median.max()), _SINGULAR)
            rank = int((median > _SINGULAR * largest).sum())
            if rank:
                last = rank - 1  # the smallest of a direction that moves; they come in falling order
                smallest = np.minimum(smallest, values[:, last] / median[last])
        return smallest

    def height(self, q: Array) -> Array:
        """Return the height of the centre of mass as a share of its range, (k,); 0 without gravity."""
        if self._span <= _ROUNDING:
            return np.zeros(len(q))
        return np.asarray((self._energies(q) - self._lowest) / self._span)

    def holds(self, ways: Array, least: float, most: float) -> npt.NDArray[np.bool_]:
        """Tell of ways (k, p, n) whether conditioning, height and holding torques are as wanted, (k,)."""
        count, points, n = ways.shape
        q = ways.reshape(-1, n)
        good = self.conditioning(q) >= least
        good &= self.height(q) <= _UPRIGHT
        good &= (self._robot.holding_share(q) <= most * (1.0 + _ROUNDING)).all(axis=-1)
        return np.asarray(good.reshape(count, points).all(axis=-1))

    def _singular_values(self, q: Array) -> list[Array]:
        """Return the singular values of the tool's position, and from six joints on of its pose."""
        J = self._robot.frame_jacobian(self._robot.tip, q) * self._units
        J[:, :3] /= self._length
        parts = [J[:, :3]] if self._robot.n < _POSE else [J[:, :3], J]
        return [np.asarray(np.linalg.svd(part, compute_uv=False)) for part in parts]

    def _energies(self, q: Array) -> Array:
        """Return potential energies [J], (k,)."""
        import pinocchio as pin  # here: it is slow to import

        coupling = self._robot.coupling
        rows = q if coupling is None else q @ coupling.ratio.T + coupling.offset
        return np.array([pin.computePotentialEnergy(self._model, self._data, row) for row in rows])


def _from(robot: Robot, judge: _Judge, start: Array, least: float) -> Ends | None:
    """Return a move from a start on which all but clearance is as wanted; None where there is none."""
    most = max(_HOLDING_SHARE, float(robot.holding_share(start).max()))
    if most > 1.0:
        return None
    for scale in _SCALES:
        goal = _goal(robot, start, scale)
        if judge.holds(_way(start, goal, _FINE)[None], least, most)[0]:
            return Ends(start, goal)
    return None


def _search(
    robot: Robot, judge: _Judge, starts: Array, least: float, clearance: Clearance | None
) -> Ends | None:
    """Return a move from the first start that is as wanted; None where there is none."""
    tried = [(start, sign) for start in starts for sign in (1.0, -1.0)]
    ways = np.array([_way(start, _goal(robot, start, sign), _COARSE) for start, sign in tried])
    holds = judge.holds(ways, least, _HOLDING_SHARE)
    for index in np.flatnonzero(holds)[:_COMPARED]:
        start, sign = tried[index]
        for candidate in (_plainer(robot, judge, start, sign, least), start):
            ends = Ends(candidate, _goal(robot, candidate, sign))
            whole_way = _way(*ends, _FINE)
            if judge.holds(whole_way[None], least, _HOLDING_SHARE)[0] and _is_clear(clearance, ends):
                return ends
    return None


def _plainer(robot: Robot, judge: _Judge, start: Array, sign: float, least: float) -> Array:
    """Return a start with as many joints in the middle of their ranges as can be."""
    plain, middle = start.copy(), robot.middle()
    for joint in range(robot.n):
        tried = plain.copy()
        tried[joint] = middle[joint]
        way = _way(tried, _goal(robot, tried, sign), _COARSE)
        if judge.holds(way[None], least, _HOLDING_SHARE)[0]:
            plain = tried
    return plain


def _other_starts(robot: Robot) -> Array:
    """Return configurations around the middle of the joint ranges, the nearest first, shape (k, n)."""
    middle = robot.middle()
    lower, upper = robot.limits.lower, robot.limits.upper
    is_bounded = np.isfinite(upper - lower)
    width = np.where(is_bounded, upper - lower, 0.0)
    share = np.where(is_bounded, _RANGE * width, math.inf)
    # How far from the middle a joint may start.
    of_slides = np.where(is_bounded, share, _SLIDE)
    of_turns = np.minimum(share, _FARTHEST)
    farthest = np.where(robot.prismatic, of_slides, of_turns)
    parts = np.random.default_rng(0).uniform(-1.0, 1.0, (_TRIED, robot.n))
    rounded = np.round((middle + parts * farthest) / _GRID) * _GRID
    starts = np.clip(rounded, lower, upper)
    starts = np.where(farthest < _GRID, middle, starts)  # of a short range there is the middle alone
    nearest_first = np.argsort(np.linalg.norm(parts, axis=-1), kind="stable")
    return np.asarray(starts[nearest_first])


def _goal(robot: Robot, start: Array, scale: float) -> Array:
    """Return the goal of a part of the move from a start."""
    room = robot.limits.upper - start if scale > 0.0 else start - robot.limits.lower
    return np.asarray(start + scale * np.minimum(_MOVE, _SHARE_OF_RANGE * room))


def any_goal(robot: Robot, start: Array) -> Array:
    """Return the goal of the largest part of the move on which the motors hold the arm; of all, if none."""
    most = np.maximum(_HOLDING_SHARE, robot.holding_share(start)) * (1.0 + _ROUNDING)
    for scale in _SCALES:
        goal = _goal(robot, start, scale)
        if (robot.holding_share(_way(start, goal, _FINE)) <= most).all():
            return goal
    return _goal(robot, start, 1.0)


def _way(start: Array, goal: Array, points: int) -> Array:
    """Return configurations on the straight way, shape (points, n)."""
    return np.asarray(start + np.linspace(0.0, 1.0, points)[:, None] * (goal - start))


def _clearance(robot: Robot) -> Clearance | None:
    """Return what tells whether an arm is clear of itself and its floor; None where that takes long."""
    sizes = [size for _, size, _ in shape_files(robot).meshes]
    if any(size < 0 for size in sizes) or sum(sizes) > _MOST_BYTES:
        return None
    return Clearance(robot, floor=usual_floor(robot))


def _is_clear(clearance: Clearance | None, ends: Ends) -> bool:
    """Tell whether a move is clear, as far as that is known."""
    return clearance is None or clearance.first_hit(_way(*ends, _FINE)) is None
