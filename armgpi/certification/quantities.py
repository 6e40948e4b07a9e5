"""The numbers of an arm that a certificate depends on, found by a search over configurations and loads.

In the metric of D(q) the matrix D^-1 D^ is self-adjoint, so one joint's loop with a gain delta in an interval
replaces all joints. What motion and gravity add to it are norms in the same metric. Each number belongs to
a box of configurations, to loads and to speeds (:class:`Setting`). Where the maximum over loads is at one
of the two ends, and what is done where it is not, is in docs/proof.md.

A search finds values that are too small at most, so :func:`search_numbers` adds a share to them. What
proves numbers takes a :class:`Setting` too, and returns :class:`Numbers` whose status is "proved".
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.robot import Robot

#: Configurations that are drawn at first; the best of them, neighbours of each, and how often.
_DRAWN, _BEST, _NEAR, _ROUNDS = 600, 8, 10, 6
#: Share that is added to what a search found.
MARGIN = 0.03
#: Numbers below this are as good as zero, which rounding makes larger.
TINY = 1e-9
#: Joints up to which all corners of a box of vectors are taken, and how many of more.
MOST_CORNERS, _CORNERS = 12, 64
#: Numbers that are looked at together: corners times matrices.
_TOGETHER = 4_000_000
#: Shares of the one order of indices in the other, of which the best bound is taken.
_CROSSED = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
#: Step of the derivatives [rad or m].
_STEP = 1e-2
_Function = Callable[["Setting", Robot, "Points"], Array]
#: Is told in words what is being done.
Progress = Callable[[str], None]
_NONE = np.zeros(0)


class Setting(NamedTuple):
    """What the numbers are taken over.

    Attributes:
        arms: the true arm with the lightest and with the heaviest load, one where they are the same; or arms
            in whose hull it is, the last of them the controller's.
        nominal: the controller's model.
        known: the model of its feedforward.
        lower: lower end of the reference's configurations [rad or m], shape (n,).
        upper: upper end [rad or m], shape (n,).
        radius: how far the arm is from its reference at most [rad or m], shape (n,).
        speed: largest speed of each joint of a reference that moves [rad/s or m/s], shape (n,).
        feedforward: "none", "gravity" or "model".
        torque: bound on the disturbance torque [N m or N], shape (n,).
        friction: bound on the torque of friction [N m or N], shape (n,).
        velocity: bound on the speed of a reference that moves [rad/s or m/s], shape (n,).
        acceleration: bound on its acceleration [rad/s^2 or m/s^2], shape (n,).
        encoder: half an encoder count [rad or m], shape (n,).
        viscous: viscous friction [N m s/rad or N s/m], shape (n,).
        zone: error that is not integrated [rad or m], shape (n,).
    """

    arms: tuple[Robot, ...]
    nominal: Robot
    known: Robot
    lower: Array
    upper: Array
    radius: Array
    speed: Array
    feedforward: str
    torque: Array = _NONE
    friction: Array = _NONE
    velocity: Array = _NONE
    acceleration: Array = _NONE
    encoder: Array = _NONE
    viscous: Array = _NONE
    zone: Array = _NONE


class Number(NamedTuple):
    """A bound on a number of the arm.

    Attributes:
        value: the bound.
        status: "proved" or "searched".
    """

    value: float
    status: str = "searched"


class Numbers(NamedTuple):
    """The numbers of an arm.

    Attributes:
        delta_low: at most the least eigenvalue of D^-1 D^ [-].
        delta_high: at least the largest one [-].
        sigma: largest ``|eigenvalue|`` of D^-1 dD/dt at the stated speed [1/s].
        kappa_v: largest norm of D^-1/2 C D^-1/2 at the stated speed [1/s].
        kappa_e: largest norm of D^-1/2 d(G - D^ v*)/dq D^-1/2, the stiffness of gravity [1/s^2].
        kappa_g: the same of dG/dq alone, for the time between two samples [1/s^2].
        kappa_f: largest eigenvalue of D^-1 F, with the coefficients F of viscous friction [1/s].
        inverse: largest diagonal elements of D^-1, one for each joint [1/(kg m^2) or 1/kg].
        sigma_error: what sigma grows by for a unit of the error's speed, a length in the metric of D [1/s].
        kappa_error: what kappa_v grows by for it [1/s].
        jump: largest change of v* between the two loads, in the metric of D.
        hold: largest torques that hold the joints at the reference [N m or N].
        reach: largest torques for a v of length 1 in the metric of D.
        torque: largest length of the disturbance torque in the metric of D^-1.
        friction: that of the torque of friction.
        velocity: largest length of the reference's velocity in the metric of D.
        acceleration: that of its acceleration.
        shift: largest length of dv*/dt along the reference.
        encoder: largest length of half an encoder count.
        zone: largest length of the error that is not integrated.
    """

    delta_low: Number
    delta_high: Number
    sigma: Number
    kappa_v: Number
    kappa_e: Number
    kappa_g: Number
    kappa_f: Number
    inverse: tuple[Number, ...]
    sigma_error: Number
    kappa_error: Number
    jump: Number
    hold: tuple[Number, ...]
    reach: tuple[Number, ...]
    torque: Number
    friction: Number
    velocity: Number
    acceleration: Number
    shift: Number
    encoder: Number
    zone: Number


class Points(NamedTuple):
    """Where a number is evaluated: three configurations near each other, each of shape (k, n).

    Attributes:
        star: the reference.
        q: the arm, which gives the metric.
        between: between the two, where a gradient is taken.
    """

    star: Array
    q: Array
    between: Array


def search_numbers(setting: Setting, seed: int = 0, progress: Progress = lambda _: None) -> Numbers:
    """Return the numbers of an arm, each searched over configurations and at both ends of the loads.

    Args:
        setting: what they are taken over.
        seed: of the configurations that are drawn.
        progress: called with what is being done.
    """
    return between_ends(setting, at_ends(setting, seed, progress))


def at_ends(setting: Setting, seed: int = 0, progress: Progress = lambda _: None) -> Numbers:
    """Return the numbers at both ends of the loads alone; see :func:`search_numbers`."""
    every = functions(setting)
    found = {}
    for place, (name, function) in enumerate(every.items(), start=1):
        progress(f"searching number {place} of {len(every)}")
        found[name] = largest(setting, function, seed)

    def number(name: str) -> Number:
        if name not in found:
            return Number(0.0, "proved")
        return Number((1.0 + MARGIN) * found[name])

    def delta(x: float, away: bool) -> Number:  # more is farther from 1, or nearer to it
        factor = 1.0 + MARGIN if away else 1.0 / (1.0 + MARGIN)
        return Number(1.0 + (x - 1.0) * factor)

    low = -found["-delta_low"]
    high = found["delta_high"]
    made: dict[str, Any] = {
        "delta_low": delta(low, low < 1.0),
        "delta_high": delta(high, high > 1.0),
    }
    for name in Numbers._fields[2:]:
        if name in PER_JOINT:
            made[name] = tuple(number(f"{name}.{j}") for j in range(setting.nominal.n))
        else:
            made[name] = number(name)
    return Numbers(**made)


def between_ends(setting: Setting, found: Numbers) -> Numbers:
    """Return numbers that hold for loads between the ends as well.

    Velocities of length 1 in the metric of an arm between are at most as long as the root of the ratio of
    the deltas in that of an end: what is linear in them is larger there at most by that. No metric is longer
    than the controller's by more than the root of 1 over the least delta.
    """
    proven = found.delta_low.status == found.delta_high.status == "proved"
    changed: dict[str, Any] = {}
    for name, longer in _factors_between_ends(setting, found).items():
        at_an_end = getattr(found, name)
        status = at_an_end.status if proven else "searched"
        changed[name] = Number(longer * at_an_end.value, status)
    return found._replace(**changed)


def _factors_between_ends(setting: Setting, found: Numbers) -> dict[str, float]:
    """Return by what factors some numbers can be larger between the ends of the loads than at them."""
    if setting.arms[0] is setting.arms[-1]:
        return {}
    low = min(1.0, found.delta_low.value)
    between = math.sqrt(found.delta_high.value / low)
    return {"sigma_error": between, "kappa_error": between, "shift": math.sqrt(1.0 / low)}


def count_outside(
    setting: Setting,
    found: Numbers,
    others: Sequence[tuple[Robot, ...]],
    friction: bool = False,
    seed: int = 1,
    progress: Progress = lambda _: None,
) -> int:
    """Return how many other arms exceed a number at the worst point that a search of each arm finds.

    Args:
        setting: what the numbers are taken over.
        found: the numbers, for all loads.
        others: of each arm, the arm with the lightest and with the heaviest load; or once.
        friction: whether their own friction acts.
        seed: of the configurations that are drawn.
        progress: called with what is being done.
    """
    outside = 0
    for place, loaded in enumerate(others, start=1):
        progress(f"searching possible arm {place} of {len(others)}")
        own = setting
        if friction:
            viscous, rubbing = friction_of(loaded[:1], friction, setting.velocity)
            own = setting._replace(viscous=viscous, friction=rubbing)
        outside += _exceeds(own, found, loaded, seed)
    return outside


def _exceeds(setting: Setting, found: Numbers, loaded: Sequence[Robot], seed: int) -> bool:
    """Tell whether an arm, at either end of its loads, has a larger number than those that were found."""
    factors = _factors_between_ends(setting, found)
    for name, function in functions(setting).items():
        group, _, joint = name.lstrip("-").partition(".")
        number = getattr(found, group)
        most = (number[int(joint)] if joint else number).value / factors.get(group, 1.0)
        if name.startswith("-"):
            most = -most
        if _search(setting, function, seed, loaded)[1].max() > most + TINY:
            return True
    return False


def functions(setting: Setting) -> dict[str, _Function]:
    """Return what each number is the largest value of; none for what is zero."""
    every: dict[str, _Function] = {
        "-delta_low": lambda *at: -_deltas(*at)[:, 0],
        "delta_high": lambda *at: _deltas(*at)[:, -1],
        "sigma": _sigma,
        "kappa_v": _coriolis,
        "kappa_e": _stiffness,
        "kappa_g": _gravity,
        "sigma_error": _sigma_error,
        "kappa_error": _kappa_error,
    }
    for name, per_joint in PER_JOINT.items():
        for j in range(setting.nominal.n):
            every[f"{name}.{j}"] = per_joint(j)
    if setting.arms[0] is not setting.arms[-1]:
        every["jump"] = _jump
    if setting.viscous.any():
        every["kappa_f"] = _rubbing
    sizes = {
        "torque": _force,
        "friction": _force,
        "velocity": _length,
        "acceleration": _length,
        "encoder": _length,
        "zone": _length,
    }
    for name, value in sizes.items():
        bound = getattr(setting, name)
        if bound.any():
            every[name] = _largest_of(bound, value)
    if setting.velocity.any():
        every["shift"] = _largest_of(setting.velocity, _shift)
    return every


def largest(setting: Setting, function: _Function, seed: int = 0) -> float:
    """Return the largest value of a function of a true arm and :class:`Points` that a search finds.

    Args:
        setting: the arms and where they are.
        function: (setting, arm, points) -> values (k,).
        seed: of the points that are drawn.
    """
    return float(_search(setting, function, seed)[1].max())


def _search(
    setting: Setting, function: _Function, seed: int, arms: Sequence[Robot] = ()
) -> tuple[Array, Array]:
    """Return coordinates of points and values there, the largest that are found among them.

    Args:
        setting: what the function is taken over.
        function: (setting, arm, points) -> values (k,).
        seed: of the points that are drawn.
        arms: that may be the true one; those of the setting when there are none.
    """
    rng = np.random.default_rng(seed)
    n = setting.nominal.n
    low, width = ranges(setting)

    def values(z: Array) -> Array:
        work = len(z) * n * n * 2 ** min(n, MOST_CORNERS)
        parts = np.array_split(z, -(-work // _TOGETHER))
        of_arms = []
        for arm in arms or setting.arms:
            of_parts = [function(setting, arm, points(setting, part)) for part in parts]
            of_arms.append(np.concatenate(of_parts))
        return np.asarray(np.max(of_arms, axis=0))

    share = rng.random((_DRAWN, 3 * n))
    # Extremes are often at the ends of the box and of the distance to the reference.
    likely = np.concatenate([np.full(n, 0.1), np.full(2 * n, 0.7)])
    at_end = rng.random(share.shape) < likely
    z = low + width * np.where(at_end, np.rint(share), share)
    found = values(z)
    for closer in range(_ROUNDS):
        best = np.argsort(-found)[:_BEST]
        z, found = z[best], found[best]
        near = np.repeat(z, _NEAR, axis=0)
        spread = 0.2 * 0.5**closer * width
        near = near + spread * rng.standard_normal(near.shape)
        near = np.clip(near, low, low + width)
        z = np.concatenate([z, near])
        found = np.concatenate([found, values(near)])
    return z, found


def motion(robot: Robot, count: int = 64) -> dict[str, float]:
    """Return what motion and gravity make of an arm without load, at joint speeds of 1 rad/s or m/s.

    Args:
        robot: the arm.
        count: of random configurations within its limits.

    Returns:
        `sigma`, `kappa_v` and `kappa_e` of :class:`Numbers`, the largest there.
    """
    q = random_configurations(robot, count, seed=0)
    none = np.zeros(robot.n)
    setting = Setting((robot,), robot, robot, none, none, none, none + 1.0, "none")
    at = Points(q, q, q)
    every = functions(setting)
    found = {}
    for name in ("sigma", "kappa_v", "kappa_e"):
        values = every[name](setting, robot, at)
        found[name] = float(values.max())
    return found


def ranges(setting: Setting) -> tuple[Array, Array]:
    """Return the lower ends and the widths of the coordinates of :func:`points`, (3 n,)."""
    offsets = np.ones(2 * setting.nominal.n)
    low = np.concatenate([setting.lower, -offsets])
    width = np.concatenate([setting.upper - setting.lower, 2.0 * offsets])
    return low, width


def friction_of(arms: Sequence[Robot], acts: bool, speed: Array) -> tuple[Array, Array]:
    """Return the largest viscous friction of some arms, and what all friction is at a speed at most, (n,).

    Args:
        arms: of which each is possible.
        acts: whether it acts; it is 0 otherwise.
        speed: of the joints [rad/s or m/s].
    """
    largest = np.max([arm.friction for arm in arms], axis=0)
    viscous, coulomb = float(acts) * largest
    return viscous, viscous * speed + coulomb


def points(setting: Setting, z: Array) -> Points:
    """Return the configurations that coordinates (k, 3 n) stand for: q*, and two offsets in -1..1."""
    star, first, second = np.split(z, 3, axis=1)
    return Points(star, star + setting.radius * first, star + setting.radius * second)


def slopes(function: Callable[[Array], Array], q: Array) -> Array:
    """Return the derivatives of a function of configurations, shape (k, n, ...); error 1e-8 of its size."""
    k, n = q.shape
    steps = _STEP * np.array([1.0, -1.0, 2.0, -2.0])
    moved = q[:, None, None] + steps[:, None] * np.eye(n)[:, None]
    values = function(moved.reshape(-1, n))
    values = values.reshape(k, n, 4, *values.shape[1:])
    near = values[:, :, 0] - values[:, :, 1]
    far = values[:, :, 2] - values[:, :, 3]
    return np.asarray((8.0 * near - far) / (12.0 * _STEP))


def roots(D: Array) -> Array:
    """Return L^-1 of D = L L^T, shape (k, n, n): L^-1 X L^-T has the norms of D^-1/2 X D^-1/2."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(D)))


def corners(bound: Array) -> Array:
    """Return the corners of a box of vectors, one of each pair of opposites; some of very many."""
    n = len(bound)
    if n <= MOST_CORNERS:
        others = itertools.product((1.0, -1.0), repeat=n - 1)
        signs = np.array([(1.0, *signs) for signs in others])
    else:
        drawn = np.random.default_rng(0).standard_normal((2 * _CORNERS, n))
        signs = np.sign(drawn)
    return signs * bound


def resting(setting: Setting, arm: Robot, star: Array) -> Array:
    """Return v* [rad/s^2], which the controller asks for where the arm rests at q*; shape (k, n)."""
    held = arm.gravity(star)
    if setting.feedforward != "none":
        held = held - setting.known.gravity(star)
    return np.asarray(setting.nominal.inertia_solve(star, held))


def norms(X: Array) -> Array:
    """Return the largest singular values of matrices (..., n, n)."""
    squares = np.linalg.eigvalsh(X.swapaxes(-1, -2) @ X)[..., -1]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _in_metric(arm: Robot, q: Array, X: Array) -> Array:
    """Return D^-1/2 X D^-1/2 but for a rotation; X of shape (k, n, n) or (k, m, n, n)."""
    inverse = roots(arm.mass_matrix(q))
    inverse = inverse[:, None] if X.ndim == 4 else inverse
    return np.asarray(inverse @ X @ inverse.swapaxes(-1, -2))


def _deltas(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return the eigenvalues of D^-1 D^, shape (k, n)."""
    ratio = _in_metric(arm, at.q, setting.nominal.mass_matrix(at.q))
    return np.asarray(np.linalg.eigvalsh(ratio))


def christoffel(slope: Array, v: Array) -> Array:
    """Return C(q, v) [.., k, c, n, n] of derivatives (k, n, n, n) of D and velocities (k, c, n) or (c, n)."""
    v = np.broadcast_to(v, (len(slope), *v.shape[-2:]))
    along = np.einsum("kiab,kci->kcab", slope, v)
    across = np.einsum("kjia,kca->kcij", slope, v)  # dD_ia/dq_j v_a
    return np.asarray(0.5 * (along + across - across.swapaxes(-1, -2)))


def _over_velocities(S: Array) -> Array:
    """Return at least the largest length of (x S_c x)_c over vectors x of length 1, symmetric S (k, c, n, n).

    Its square is a form of fourth degree, sum G_ijlm x_i x_j x_l x_m with G = sum S_c S_c. Indices may change
    their places, so many matrices give it as a quadratic form of x x^T, and the largest eigenvalue of each of
    them on symmetric matrices is a bound.
    """
    a, b = np.triu_indices(S.shape[-1])
    i, j = a[:, None], b[:, None]
    G = np.einsum("kcij,kclm->kijlm", S, S, optimize=True)
    straight = G[:, i, j, a, b]
    crossed = 0.5 * (G[:, i, a, j, b] + G[:, i, b, j, a])
    size = np.where(a == b, 1.0, math.sqrt(2.0))  # of an element in the length of a symmetric matrix
    mixed = [(1.0 - share) * straight + share * crossed for share in _CROSSED]
    forms = size[:, None] * size * np.stack(mixed)
    squares = np.linalg.eigvalsh(forms)[..., -1].min(axis=0)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _sigma_error(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return at least the largest rate of the metric over velocities of length 1."""
    D_slopes = slopes(arm.mass_matrix, at.q)
    unit_velocities = roots(arm.mass_matrix(at.q))
    rates = np.einsum("kiab,kji->kjab", D_slopes, unit_velocities)
    return _over_velocities(_in_metric(arm, at.q, rates))


def _kappa_error(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return at least the largest norm of C over velocities of length 1.

    C(q, a) b = C(q, b) a, so each of its components is a symmetric form, and largest where a is b.
    """
    D_slopes = slopes(arm.mass_matrix, at.q)
    unit_velocities = roots(arm.mass_matrix(at.q))
    C = christoffel(D_slopes, unit_velocities)
    return _over_velocities(_in_metric(arm, at.q, C).swapaxes(1, 2))


def _sigma(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return the largest rate of the metric; convex in the speeds, so largest at a corner of them."""
    D_slopes = slopes(arm.mass_matrix, at.q)
    rates = np.einsum("kiab,ci->kcab", D_slopes, corners(setting.speed))
    eigenvalues = np.linalg.eigvalsh(_in_metric(arm, at.q, rates))
    return np.asarray(np.abs(eigenvalues).max(axis=(1, 2)))


def _coriolis(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return the norm of Christoffel's C(q, v), at a corner of the speeds."""
    D_slopes = slopes(arm.mass_matrix, at.q)
    C = christoffel(D_slopes, corners(setting.speed))
    sizes = norms(_in_metric(arm, at.q, C))
    return np.asarray(sizes.max(axis=1))


def _stiffness(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return the norm of d(G - D^ v*)/dq, the metric at q, the gradient in between, v* at q*."""
    v = resting(setting, arm, at.star)
    v_of_steps = np.repeat(v, 4 * arm.n, axis=0)

    def holding(q: Array) -> Array:
        return setting.nominal.inertia_times(q, v_of_steps)

    slope = slopes(arm.gravity, at.between) - slopes(holding, at.between)
    return norms(_in_metric(arm, at.q, slope.swapaxes(1, 2)))


def _gravity(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return the norm of dG/dq."""
    slope = slopes(arm.gravity, at.between)
    return norms(_in_metric(arm, at.q, slope.swapaxes(1, 2)))


def _rubbing(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return the largest eigenvalue of D^-1 F."""
    F = np.broadcast_to(np.diag(setting.viscous), (len(at.q), arm.n, arm.n))
    eigenvalues = np.linalg.eigvalsh(_in_metric(arm, at.q, F))
    return np.asarray(eigenvalues[:, -1])


def _inverse(joint: int) -> _Function:
    """Return the function that gives an element of the diagonal of D^-1."""

    def element(_: Setting, arm: Robot, at: Points) -> Array:
        inverse = np.linalg.inv(arm.mass_matrix(at.q))
        return np.asarray(inverse[:, joint, joint], float)

    return element


def _hold(joint: int) -> _Function:
    """Return the function that gives the torque with which a joint is held [N m or N]."""

    def torque(setting: Setting, arm: Robot, at: Points) -> Array:
        v = resting(setting, arm, at.star)
        torques = setting.nominal.inertia_times(at.q, v)
        if setting.feedforward != "none":
            torques = torques + setting.known.gravity(at.star)
        return np.abs(torques[:, joint])

    return torque


def _reach(joint: int) -> _Function:
    """Return the function that gives a joint's torque over the length of v in the metric of D."""

    def factor(setting: Setting, arm: Robot, at: Points) -> Array:
        row = setting.nominal.mass_matrix(at.q)[:, joint]
        squares = np.einsum("ki,ki->k", row, arm.inertia_solve(at.q, row))
        return np.asarray(np.sqrt(squares))

    return factor


def _jump(setting: Setting, arm: Robot, at: Points) -> Array:
    """Return how long the difference is of v* of an arm and v* of the controller's, (k,).

    For the controller's own arm it is the difference to the first one. The length is in the metric of the
    inertia of `arm`: in rad/s^2 or m/s^2, times the root of an inertia.
    """
    last = setting.arms[-1]  # the controller's
    other = setting.arms[0] if arm is last else arm
    change = resting(setting, last, at.star) - resting(setting, other, at.star)
    change = change[:, None]  # one vector for each configuration
    return _length(setting, arm, at, change)[:, 0]


def _largest_of(bound: Array, value: Callable[[Setting, Robot, Points, Array], Array]) -> _Function:
    """Return the largest value of a function that is convex in a vector within bounds: it is at a corner."""
    ends = corners(bound)

    def largest_at_corners(setting: Setting, arm: Robot, at: Points) -> Array:
        values = value(setting, arm, at, ends)
        return np.asarray(values.max(axis=1))

    return largest_at_corners


def _length(_: Setting, arm: Robot, at: Points, x: Array) -> Array:
    """Return the lengths (k, c) of velocities or accelerations (c, n) or (k, c, n) in the metric of D."""
    vectors = np.broadcast_to(x, (len(at.q), *x.shape[-2:]))
    squares = (vectors @ arm.mass_matrix(at.q) * x).sum(axis=-1)
    return np.asarray(np.sqrt(squares))


def _force(_: Setting, arm: Robot, at: Points, x: Array) -> Array:
    """Return the lengths (k, c) of torques in the metric of D^-1."""
    vectors = np.broadcast_to(x, (len(at.q), *x.shape[-2:]))
    inverse = np.linalg.inv(arm.mass_matrix(at.q))
    squares = (vectors @ inverse * x).sum(axis=-1)
    return np.asarray(np.sqrt(squares))


def _shift(setting: Setting, arm: Robot, at: Points, v: Array) -> Array:
    """Return how fast v* changes along the reference, in the metric of the heaviest load.

    With both linear in the load its length is of third degree, and not largest at an end.
    """
    changes = slopes(lambda q: resting(setting, arm, q), at.star)
    return _length(setting, setting.arms[-1], at, v @ changes)


#: Numbers that each joint has one of.
PER_JOINT: dict[str, Callable[[int], _Function]] = {"inverse": _inverse, "hold": _hold, "reach": _reach}
