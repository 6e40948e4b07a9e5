"""A bound on the error along one trajectory, joint by joint, and in millimetres at the tool.

Along the arm's own motion each joint's error obeys ``e'' = g u + z``: what the law asks for, with a constant
gain, and a rest that is known by its size alone. What a joint's sampled loop makes of it is a sum
(:mod:`armgpi.certification.channels`). How large it is is a table of numbers of the arm along the path, and
of the errors (:func:`numbers_along`). The least solution of both is the tube. docs/path.md derives it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import (
    Array,
    check_choice,
    check_number,
    check_type,
    check_whole,
    not_negative,
    quantity,
)
from armgpi.base.hints import with_keyword_hints
from armgpi.base.renamed import warn_renamed
from armgpi.certification.channels import Channel, channel
from armgpi.certification.quantities import MARGIN, christoffel, slopes
from armgpi.certification.text import share_covered
from armgpi.control.controller import Measurement
from armgpi.errors import ParameterError
from armgpi.gpi.gains import FixedGains
from armgpi.gpi.law import GPI
from armgpi.loop.units import POSITION, TORQUE
from armgpi.references.reference import Reference, Target
from armgpi.robot.batch import RobotBatch
from armgpi.robot.robot import Robot

#: Times along the path at which the numbers are taken, each with another arm and configuration around it.
_TIMES = 400
#: Arms between the lightest and the heaviest load, both of them counted.
_LOADS = 3
#: By how much a bound is raised, far more than rounding does to it.
_RAISED = 1e-6
#: Steps to the least solution at most, and the change at which it is found.
_STEPS, _SETTLED = 20_000, 1e-10
#: Least width of a tube [rad or m], and the error beyond which none is looked for.
_THIN, _WIDEST = 1e-4, 1.0
#: Widths of the tubes that are tried, over the error that a thin one leads to.
_ROOM = (1.1, 1.3, 1.7, 2.5, 4.0, 8.0, 16.0, 40.0)
#: Positions that an encoder may show at first, beside the true one.
_HIDDEN = 16
#: Halvings in the search for what the arm tolerates.
_HALVINGS = 40
#: Motion below which a path is at rest [rad or m; rad/s or m/s].
_AT_REST = 1e-6
#: Share of an error below which its part is not told.
_TOLD = 0.05
#: What makes an error -> what makes it smaller.
_ADVICE = {
    "torques": "a faster controller, or smaller disturbance torque and friction",
    "force at the tool": "a faster controller, or a smaller force",
    "motion of the reference": "a slower path, or feedforward: model",
    "encoders and delay": "finer encoders, or less delay",
    "wrong inertia": "identify the arm, or state fewer loads",
    "gravity": "feedforward: model, or a faster controller",
    "Coriolis and viscous torques": "a slower path, or a faster controller",
}
_LESS = "Try smaller disturbances, a slower path, or feedforward."
#: Speed beyond that of the error from which a reference says which way friction points: ten times that at
#: which a plant smooths it, and that of the feedforward [rad/s or m/s].
_SMOOTH = 1e-2
#: How a run may start: see :data:`armgpi.certification.request.STARTS`.
STARTS = ("wrong-load", "held")


class Rest(NamedTuple):
    """What the rest is made of: as accelerations, or as torques of a law that makes up for it.

    Attributes:
        mismatch: of D^-1 D^ - g, element by element [-], (n, n).
        stiffness: of gravity beside what holds the arm at the reference [1/s^2], (n, n).
        turning: how D^ v* changes with the position [1/s^2], (n, n).
        rate: of Coriolis and viscous torques per speed of the error [1/s], (n, n).
        square: of Coriolis torques per product of two speeds of the error, (n, n, n).
        torque: of the stated torques and friction [rad/s^2 or m/s^2], (n,).
        spread: of 1 N m or N on all joints at once, (n,).
        force: of a force of 1 N at the tool, (n,).
        motion: what the reference's motion leaves beside the feedforward [rad/s^2 or m/s^2], (n,).
    """

    mismatch: Array
    stiffness: Array
    turning: Array
    rate: Array
    square: Array
    torque: Array
    spread: Array
    force: Array
    motion: Array


class Along(NamedTuple):
    """Numbers of an arm along a path, each the largest found and :data:`MARGIN` more; rows are joints.

    Attributes:
        gain: the loop's gain g that is taken for each joint [-], (n,).
        rest: as accelerations.
        answer: as torques, of the law's model a memory of the loop later at most.
        shift: by how much what holds the arm changes in a sample [rad/s^2 or m/s^2], (n,).
        start: by how much the first torque is wrong [rad/s^2 or m/s^2], (n,).
        speed: of the reference [rad/s or m/s], (n,).
        hold: torque that is asked for beside u [N m or N], (n,).
        reach: torque per unit of u, (n, n).
        jacobian: of the tool's position, (3, n).
        jerk: by how much its acceleration changes at each sample while torques are late, (samples, n).
        loop: what the joints' loops make of bounded inputs; None where one is unstable.
    """

    gain: Array
    rest: Rest
    answer: Rest
    shift: Array
    start: Array
    speed: Array
    hold: Array
    reach: Array
    jacobian: Array
    jerk: Array
    loop: Channel | None


class Solution(NamedTuple):
    """Bounds at all times; each of shape (n,).

    Attributes:
        error: of the joints [rad or m].
        speed: of the error [rad/s or m/s].
        asked: what the law asks for beside what holds the arm [rad/s^2 or m/s^2].
        rest: the acceleration that nobody knows but by its size.
        parts: where that comes from -> its part, (n,).
    """

    error: Array
    speed: Array
    asked: Array
    rest: Array
    parts: Mapping[str, Array]


class Wish(NamedTuple):
    """What a tube is asked for.

    Attributes:
        controller: a GPI with fixed gains.
        arms: what the true arm may be.
        reference: the trajectory.
        t_final: until when [s].
        torque: disturbance arbitrary in time on each joint [N m or N], (n,).
        force: at the tool, of any direction and course [N].
        friction: whether the arms have their friction.
        hidden: what an encoder hides at most [rad or m], (n,).
        delay: delay of the measurements, in samples.
        start: one of :data:`STARTS`.
        seed: of what is drawn.
    """

    controller: GPI
    arms: tuple[Robot, ...]
    reference: Reference
    t_final: float
    torque: Array
    force: float
    friction: bool
    hidden: Array
    delay: int
    start: str
    seed: int

    @property
    def samples(self) -> Array:
        """Times of the samples [s], (samples,)."""
        h = self.controller.dt
        return np.asarray(h * np.arange(round(self.t_final / h) + 1.0))

    @property
    def zone(self) -> Array:
        """Error that is not integrated [rad or m], (n,)."""
        return np.broadcast_to(self.controller.rest_dead_zone, (self.controller.robot.n,))


class PathBound(NamedTuple):
    """A tube around a trajectory, or why there is none.

    Attributes:
        wish: what was asked for.
        error: bound on each joint's error [rad or m], (n,); NaN where there is none.
        tool: bound on the tool's distance from where it should be [m].
        torque: bound on each joint's torque [N m or N], (n,).
        parts: what makes the error -> its share for each joint, (n,).
        tolerated_torque: torque on all joints at once that could act as well [N m or N].
        tolerated_force: force at the tool that could act instead [N].
        reasons: why there is no tube, a sentence each; empty where there is one.
        tried: other arms that are possible, all within it.
    """

    wish: Wish
    error: Array
    tool: float
    torque: Array
    parts: dict[str, Array]
    tolerated_torque: float
    tolerated_force: float
    reasons: tuple[str, ...] = ()
    tried: int = 0

    @property
    def holds(self) -> bool:
        """Whether there is a tube."""
        return not self.reasons

    @property
    def bears(self) -> float:
        """Return `tolerated_torque`; its old name."""
        warn_renamed("bears", "tolerated_torque")
        return self.tolerated_torque

    @property
    def bears_force(self) -> float:
        """Return `tolerated_force`; its old name."""
        warn_renamed("bears_force", "tolerated_force")
        return self.tolerated_force

    def weaker_than_friction(self) -> list[str]:
        """Return the joints whose Coulomb friction is not stated, and more than what it tolerates."""
        arms, names = self.wish.arms, self.wish.controller.robot.joint_names
        coulomb = np.max([np.broadcast_to(arm.friction.coulomb, (arm.n,)) for arm in arms], axis=0)
        over = (not self.wish.friction) & (coulomb > self.wish.torque + self.tolerated_torque)
        return [name for name, is_over in zip(names, over, strict=True) if is_over]

    def plain(self) -> dict[str, Any]:
        """Return it as plain data: SI units, joints by name; NaN where there is no bound."""
        names = self.wish.controller.robot.joint_names
        each = {"error": self.error, "torque": self.torque}
        return {
            "holds": self.holds,
            "numbers": "searched",
            "tool": self.tool,
            "tolerated_torque": self.tolerated_torque,
            "tolerated_force": self.tolerated_force,
            **{key: dict(zip(names, x.tolist(), strict=True)) for key, x in each.items()},
            "parts": {what: dict(zip(names, x.tolist(), strict=True)) for what, x in self.parts.items()},
            "reasons": list(self.reasons),
        }

    def __str__(self) -> str:
        """Return it in words, the verdict first."""
        return "\n".join(describe(self))


@with_keyword_hints
def bound_path(
    controller: GPI,
    reference: Reference,
    t_final: float,
    *,
    arms: Robot | Sequence[Robot] | None = None,
    others: Sequence[Robot] = (),
    torque: Any = 0.0,
    force: float = 0.0,
    friction: bool = False,
    bits: Any = None,
    delay: int | None = None,
    start: str = "wrong-load",
    seed: int = 0,
) -> PathBound:
    """Return a bound on the error of a rigid arm along one trajectory; see docs/path.md.

    The numbers of the arm that it depends on are estimated numerically: the largest of some hundred
    configurations around the path, and 3 % more. So it is no proof.

    Args:
        controller: a GPI with fixed gains, which may differ between the joints.
        reference: the trajectory, at rest at first and without jumps.
        t_final: until when [s].
        arms: what the true arm may be: one, or several of which each is possible, such as
            ``identified.sample(64).robots``; the controller's own, with all its loads, when not given.
        others: more arms that are possible; where one has a larger bound there is none. Of 59 drawn as the
            truth is, none with a larger one says with 95 % confidence that it holds for 95 % of such arms.
        torque: bound of disturbance torques that are arbitrary in time, all at once [N m or N].
        force: at the tool, of any direction and course [N].
        friction: whether the arms have their friction; what the controller feeds forward of it is taken off.
        bits: of the encoders, a number or one for each joint; None for exact positions.
        delay: delay of the measurements, in samples; those that the controller was made for when not given.
        start: "wrong-load", at rest with the torque of the controller's model, or "held" by the loop.
        seed: of the configurations.

    Raises:
        ParameterError: for a controller or a value that this does not cover.
        ArrayError: for what is not a number for each joint.
    """
    check_type(controller, "controller", GPI, "a GPI controller")
    check_type(reference, "reference", Reference, "a Reference")
    _check_law(controller)
    robot: Any = controller.bias_robot
    wish = Wish(
        controller,
        _arms(controller, arms),
        reference,
        check_number(t_final, "t_final", "a positive time [s]", open_=True),
        _sizes(torque, "torque", robot),
        check_number(force, "force", "zero or positive [N]"),
        friction,
        np.zeros(robot.n) if bits is None else 0.5 * robot.encoder_count(_bits(bits, robot)),
        check_whole(round(controller.delay / controller.dt) if delay is None else delay, "delay", 0, 20),
        start,
        check_whole(seed, "seed", 0),
    )
    check_choice(start, "start", STARTS)
    check_type(friction, "friction", bool, "True or False")
    return bound_wish(wish, _arms(controller, others) if others else ())


def bound_wish(wish: Wish, others: Sequence[Robot] = (), bears: bool = True) -> PathBound:
    """Return what :func:`bound_path` does, of a wish; what it tolerates is 0 where nobody asks."""
    _check_path(wish)
    thinnest = np.full(wish.controller.robot.n, _THIN)
    thin = _Tube(wish, thinnest, wish.controller.gains.nominal().omega_c * thinnest)
    first = thin.solve()
    if first is None:
        return _none(wish, [thin.cause()])
    tubes: list[_Tube] = []
    reasons: list[list[str]] = []
    for room in _ROOM:
        tube = _Tube(wish, np.maximum(room * first.error, _THIN), np.maximum(room * first.speed, _THIN))
        tubes.append(tube)
        reasons.append(tube.reasons())
        if not (bears or reasons[-1]):
            break
    if all(reasons):
        return _none(wish, min(reasons, key=len))
    best = tubes[reasons.index([])]
    made = best.path_bound(tubes if bears else ())
    own = made.error - wish.delay * wish.controller.dt * best.known.speed
    if outside := sum(not best.covers(arm, own, made.torque) for arm in others):
        said = f"{outside} of {len(others)} other possible arms have a larger bound. {_LESS}"
        return _none(wish, [said])
    return made._replace(tried=len(others))


def _none(wish: Wish, reasons: Sequence[str]) -> PathBound:
    """Return that there is no bound, and why."""
    nothing = np.full(wish.controller.robot.n, math.nan)
    return PathBound(wish, nothing, math.nan, nothing, {}, 0.0, 0.0, tuple(reasons))


class _Around(NamedTuple):
    """Configurations around the path, 400 of each.

    Attributes:
        target: what the law is given.
        late: the reference up to `d + 1` samples later.
        q: where the arm is, (400, n).
        y: what is measured of it.
        between: anywhere between the target and them.
        v: what the law asks for where it holds the arm at the target.
        coriolis: C(q, late.v), (400, n, n).
    """

    target: Target
    late: Target
    q: Array
    y: Array
    between: Array
    v: Array
    coriolis: Array


class _Sampled(NamedTuple):
    """An arm at configurations around the path; the first axis of each array is these.

    Attributes:
        true: inertia matrix D of the arm [kg m^2 or kg], (400, n, n).
        inverse: its inverse, likewise.
        model: inertia matrix D^ of the controller's model, likewise.
        torques: what makes the rest, as torques; see :func:`_torques`.
    """

    true: Array
    inverse: Array
    model: Array
    torques: dict[str, Array]


class _Largest:
    """The largest size of each of some numbers, element by element, over all configurations."""

    def __init__(self) -> None:
        """Begin without numbers."""
        self.sizes: dict[str, Array] = {}

    def add(self, values: Mapping[str, Array]) -> None:
        """Take in some more values, the first axis of each being configurations."""
        for name, value in values.items():
            self.sizes[name] = np.maximum(self.sizes.get(name, 0.0), np.abs(value).max(axis=0))

    def raised(self) -> dict[str, Array]:
        """Return them and :data:`MARGIN` more."""
        return {name: (1.0 + MARGIN) * size for name, size in self.sizes.items()}


def numbers_along(wish: Wish, radius: Array, fastest: Array) -> Along:
    """Return the numbers along the path.

    Args:
        wish: what a tube is asked for.
        radius: how far the arm is from the path at most [rad or m], (n,).
        fastest: how fast the error is at most [rad/s or m/s], (n,).
    """
    controller: Any = wish.controller
    rng = np.random.default_rng(wish.seed)
    every = wish.reference.at(wish.samples)
    speed = np.abs(every.v).max(axis=0)
    lateness = (wish.delay + 1) * controller.dt
    times, shares = _moments(wish, every, rng)
    target = wish.reference.at(times)
    late = wish.reference.at(times + lateness * shares)
    # How far a measurement may be from where the arm is when its torque acts.
    moved = lateness * (speed + fastest) + wish.hidden

    largest = _Largest()
    largest.sizes["start"] = np.zeros(len(radius))
    arms: list[_Sampled] = []
    for arm in wish.arms:
        q = late.q + _offsets(rng, radius)
        y = q + _offsets(rng, moved)
        between = target.q + _offsets(rng, radius + moved)
        slope = slopes(arm.mass_matrix, q)
        coriolis = christoffel(slope, late.v[:, None])[:, 0]
        at = _Around(target, late, q, y, between, _holds(wish, arm, target.q), coriolis)
        true = arm.mass_matrix(q)
        model = controller.robot.mass_matrix(y)
        inverse = np.asarray(np.linalg.inv(true), float)
        torques = _torques(wish, arm, at, slope, every, fastest)
        arms.append(_Sampled(true, inverse, model, torques))
        next_q = wish.reference.at(times + controller.dt).q
        holding = controller.robot.inertia_times(y, at.v) + controller.ahead(y, target)
        values = {
            "shift": _holds(wish, arm, next_q) - at.v,
            "hold": holding,
            "reach": model,
            "jacobian": arm.frame_jacobian(arm.tip, between)[:, :3],
        }
        if wish.start == "wrong-load":
            values["start"] = _start_error(wish, at, rng)
        largest.add(values)

    gain = _middle_gain(arms)
    loop = channel(controller, wish.delay, gain)
    rest = _Largest()
    answer = _Largest()
    for sampled in arms:
        torques = sampled.torques | {"mismatch": sampled.model - sampled.true * gain}
        later = times if loop is None else times + loop.memory * rng.random(_TIMES)
        reference = wish.reference.at(np.minimum(later, wish.t_final)).q
        measured = reference + _offsets(rng, radius + wish.hidden)
        model = controller.robot.mass_matrix(measured)
        rest.add(_through(sampled.inverse, torques))
        answer.add(_through(model @ sampled.inverse, torques))

    largest.sizes["jerk"] = _jerk(every.a, wish.delay + 1)
    others: Any = largest.raised()
    return Along(gain, Rest(**rest.raised()), Rest(**answer.raised()), speed=speed, loop=loop, **others)


def _offsets(rng: Any, size: Array) -> Array:
    """Return distances of at most a size, (400, n), half of them at their ends.

    The largest values mostly are at corners.
    """
    share = rng.uniform(-1.0, 1.0, (_TIMES, len(size)))
    at_end = rng.random((_TIMES, len(size))) < 0.5
    return np.asarray(np.where(at_end, np.sign(share), share) * size)


def _middle_gain(arms: Sequence[_Sampled]) -> Array:
    """Return the middle of what each joint's loop gain may be, the diagonal of D^-1 D^ [-], (n,)."""
    products = np.concatenate([each.inverse @ each.model for each in arms])
    diagonals = np.diagonal(products, axis1=1, axis2=2)
    return np.asarray(0.5 * (diagonals.min(axis=0) + diagonals.max(axis=0)))


def _jerk(acceleration: Array, samples: int) -> Array:
    """Return by how much accelerations change within so many samples [rad/s^2 or m/s^2], likewise."""
    jerk = 0.0 * acceleration
    for away in range(1, samples + 1):
        change = np.abs(acceleration[away:] - acceleration[:-away])
        jerk[:-away] = np.maximum(jerk[:-away], change)
    return jerk


def _torques(
    wish: Wish, arm: Robot, at: _Around, slope: Array, every: Target, fastest: Array
) -> dict[str, Array]:
    """Return what makes the rest, as torques at configurations; the first axis is these."""
    controller: Any = wish.controller
    steps = 4 * arm.n  # of a slope
    v_of_steps = np.repeat(at.v, steps, axis=0)
    rest_of_steps = _at_rest(np.repeat(at.target.q, steps, axis=0))

    def torque(x: Array) -> Array:  # that holds the arm, measured at x
        of_v = controller.robot.inertia_times(x, v_of_steps)
        return np.asarray(of_v + controller.ahead(x, rest_of_steps))

    turning = slopes(torque, at.between).swapaxes(1, 2)
    gravity = slopes(arm.gravity, at.between).swapaxes(1, 2)
    viscous = wish.friction * np.broadcast_to(arm.friction.viscous, (arm.n,))
    friction_fed = 0.0
    if controller.friction_feedforward:
        friction_fed = controller.add_friction(0.0 * at.q, at.target.v)
    at_rest = controller.ahead(at.y, _at_rest(at.target.q))
    given = controller.ahead(at.y, at.target) - at_rest - friction_fed
    coriolis = np.einsum("kij,kj->ki", at.coriolis, at.late.v)
    needed = coriolis + arm.inertia_times(at.q, at.target.a)
    return {
        "stiffness": turning - gravity,
        "turning": turning,
        "rate": 2.0 * at.coriolis + np.diag(viscous),
        "square": christoffel(slope, np.eye(arm.n)),
        "torque": wish.torque + _rubbing(wish, arm, every, fastest),
        "force": arm.frame_jacobian(arm.tip, at.q)[:, :3].swapaxes(1, 2),
        "motion": given - needed,
    }


def _rubbing(wish: Wish, arm: Robot, every: Target, fastest: Array) -> Array:
    """Return how large friction is at most beside what is fed forward of it [N m or N], (n,)."""
    controller: Any = wish.controller
    viscous = wish.friction * np.broadcast_to(arm.friction.viscous, (arm.n,))
    coulomb = wish.friction * np.broadcast_to(arm.friction.coulomb, (arm.n,))
    fed = 0.0 * every.v
    if controller.friction_feedforward:
        fed = controller.add_friction(fed, every.v)
    largest = 0.0 * coulomb
    for late in range(wish.delay + 2):  # samples since what is fed forward was asked for
        v = every.v[late:]
        off = fed[: len(v)] - viscous * v
        # Which way Coulomb friction points is known where the reference is clearly faster than the error.
        is_known = np.abs(v) > fastest + _SMOOTH
        either_way = np.maximum(np.abs(off - coulomb), np.abs(off + coulomb))
        this_way = np.abs(off - coulomb * np.sign(v))
        sizes = np.where(is_known, this_way, either_way)
        largest = np.maximum(largest, sizes.max(axis=0))
    return np.asarray(largest)


def _through(left: Array, torques: Mapping[str, Array]) -> dict[str, Array]:
    """Return what matrices (400, n, n) make of torques: of each the number of :class:`Rest`."""
    sizes = np.abs(left)
    return {
        "mismatch": left @ torques["mismatch"],
        "stiffness": left @ torques["stiffness"],
        "turning": left @ torques["turning"],
        "rate": left @ torques["rate"],
        "square": np.einsum("kij,kcja->kica", left, torques["square"]),
        "torque": sizes @ torques["torque"],
        "spread": sizes.sum(axis=2),
        "force": np.linalg.norm(left @ torques["force"], axis=2),
        "motion": np.einsum("kij,kj->ki", left, torques["motion"]),
    }


def _start_error(wish: Wish, at: _Around, rng: Any) -> Array:
    """Return by how much the first torque is wrong at most, as an acceleration [rad/s^2 or m/s^2], (1, n).

    The controller begins with the v* of its own model, at the position that the encoders show. So it is off
    by the difference of the two v* at the true position, and by what v* changes up to the position shown:
    its largest slope among some of these, times how far off they may be.

    Args:
        wish: whose controller it is, and what its encoders hide.
        at: the arm around the path; `v` is the true v*, of which the first is that at the start.
        rng: for positions that encoders may show.
    """
    controller = wish.controller
    first = at.target.q[:1]
    shares = rng.uniform(-1.0, 1.0, (_HIDDEN, len(wish.hidden)))
    shown = first + wish.hidden * np.vstack([0.0 * first, shares])  # the true position before others

    def v_of_model(q: Array) -> Array:
        """Return the v* with which the controller begins at positions that are measured."""
        return np.asarray(-controller.init(Measurement(q), _at_rest(first)).law.lam)

    slope = slopes(v_of_model, shown).swapaxes(1, 2)
    by_encoders = (np.abs(slope) @ wish.hidden).max(axis=0)
    return np.asarray(np.abs(at.v[:1] - v_of_model(first)) + by_encoders)


def _moments(wish: Wish, every: Target, rng: Any) -> tuple[Array, Array]:
    """Return times along the path (400,), and how much of the lateness has passed at each, 0 to 1.

    They are spread evenly over the motion, and are where a joint is the fastest, accelerates most, and where
    its acceleration changes most while measurement and torque are late.
    """
    speeds = np.abs(every.v)
    accelerations = np.abs(every.a)
    samples = len(speeds)
    apart = min(wish.delay + 1, samples - 1)
    jumps = np.abs(every.a[apart:] - every.a[:-apart])
    peaks = np.concatenate([sizes.argmax(axis=0) for sizes in (speeds, accelerations, jumps)])
    motion = np.zeros(samples)
    for sizes in (speeds, accelerations):
        largest = np.maximum(sizes.max(axis=0), 1e-12)
        motion = motion + (sizes / largest).sum(axis=1)
    weights = motion + 0.1 * np.mean(motion) + 1e-12  # a tenth of them where it rests
    passed = np.cumsum(weights)
    evenly = np.linspace(0.0, passed[-1], _TIMES - len(peaks))
    even = np.searchsorted(passed, evenly)
    shares = rng.random(_TIMES)
    shares[len(even) :] = np.repeat([0.0, 0.0, 1.0], every.v.shape[1])
    chosen = np.concatenate([np.minimum(even, samples - 1), peaks])
    chosen[0] = 0
    shares[0] = 0.0
    return wish.samples[chosen], shares


def _at_rest(q: Array) -> Target:
    """Return a target that rests."""
    return Target(q, np.zeros_like(q), np.zeros_like(q))


def _holds(wish: Wish, arm: Any, q: Array) -> Array:
    """Return v*, which the law asks for where it holds an arm at q [rad/s^2 or m/s^2], (k, n)."""
    controller: Any = wish.controller
    missing = arm.gravity(q) - controller.ahead(q, _at_rest(q))
    return np.asarray(controller.robot.inertia_solve(q, missing))


class _Tube:
    """The least solution of what the loops make of the rest, and the rest of what they do.

    Attributes:
        wish: what is asked for.
        radius: how far the arm is from the path at most where the numbers were taken [rad or m], (n,).
        fastest: how fast the error is at most there [rad/s or m/s], (n,).
        known: the numbers.
        loop: what the joints' loops make of bounded inputs.
        fixed: what they make of those that do not grow with the error, (3, n).
    """

    def __init__(self, wish: Wish, radius: Array, fastest: Array, known: Along | None = None) -> None:
        self.wish = wish
        self.radius = radius
        self.fastest = fastest
        self.known = known = numbers_along(wish, radius, fastest) if known is None else known
        self.loop = loop = known.loop
        if loop is not None:
            self.fixed = loop.measured * wish.hidden
            self.fixed = self.fixed + loop.shift * known.shift
            self.fixed = self.fixed + loop.zone * wish.zone
            self.fixed = self.fixed + loop.start * known.start
            self.fixed = self.fixed + _convolve(loop, known.jerk)

    def parts(self, rest: Rest, old: Solution, torque: float, force: float) -> dict[str, Array]:
        """Return what the rest is made of, by what it comes from, for errors within bounds."""
        known = self.known
        wish = self.wish
        late = (wish.delay + 1) * wish.controller.dt
        hidden = late * (known.speed + old.speed) + wish.hidden
        squares = np.einsum("ica,c,a->i", rest.square, old.speed, old.speed)
        return {
            "torques": rest.torque + torque * rest.spread,
            "force at the tool": force * rest.force,
            "motion of the reference": rest.motion + rest.stiffness @ (late * known.speed),
            "encoders and delay": rest.turning @ hidden,
            "wrong inertia": rest.mismatch @ old.asked,
            "gravity": rest.stiffness @ old.error,
            "Coriolis and viscous torques": rest.rate @ old.speed + squares,
        }

    def step(self, old: Solution, torque: float, force: float) -> Solution:
        """Return the bounds that follow from bounds."""
        loop = self.loop
        h = self.wish.controller.dt
        assert loop is not None
        parts = self.parts(self.known.rest, old, torque, force)
        rest = sum(parts.values(), np.zeros_like(old.rest))
        error, speed, asked = loop.rest * rest + self.fixed
        acceleration = self.known.gain * asked + rest + self.known.jerk.max(axis=0)
        # Between samples as well.
        error_between = error + h * speed + 0.5 * h * h * acceleration
        speed_between = speed + h * acceleration
        return Solution(error_between, speed_between, asked, rest, parts)

    def solve(self, torque: float = 0.0, force: float | None = None) -> Solution | None:
        """Return the least solution, a little raised, wherever it leads; None where there is none.

        Args:
            torque: on all joints at once, beside what is stated [N m or N].
            force: at the tool [N]; what is stated when not given.
        """
        if self.loop is None:
            return None
        force = self.wish.force if force is None else force
        zero = np.zeros_like(self.radius)
        found = Solution(zero, zero, zero, zero, {})
        for _ in range(_STEPS):
            old, found = found, self.step(found, torque, force)
            if not (found.error <= _WIDEST).all():
                return None
            moved = np.abs(np.subtract(found[:4], old[:4]))
            if (moved <= _SETTLED * np.abs(old[:4])).all():
                break
        else:
            return None
        error, speed, asked, rest = ((1.0 + _RAISED) * x for x in found[:4])
        raised = Solution(error, speed, asked, rest, found.parts)
        after = self.step(raised, torque, force)
        within = all((x <= y).all() for x, y in zip(after[:3], raised[:3], strict=True))
        return raised if within else None

    def holds(self, found: Solution) -> bool:
        """Tell whether bounds are within what the numbers were taken over."""
        return bool((found.error <= self.radius).all() and (found.speed <= self.fastest).all())

    def torques(self, found: Solution, torque: float, force: float) -> Array:
        """Return the torques that are asked for at most [N m or N], (n,); see :meth:`solve`."""
        known, loop = self.known, self.loop
        assert loop is not None
        answer = loop.shared * sum(self.parts(known.answer, found, torque, force).values())
        answer = answer + known.reach @ (loop.own * found.rest + self.fixed[2])
        return np.asarray(known.hold + np.minimum(answer, known.reach @ found.asked))

    def reasons(self, torque: float = 0.0, force: float | None = None) -> list[str]:
        """Return why there is no bound in this tube; none where there is one. See :meth:`solve`."""
        force = self.wish.force if force is None else force
        found = self.solve(torque, force)
        if found is None or not self.holds(found):
            return [f"The error can exceed {float(self.radius.max()):.3g} rad or m. {_LESS}"]
        names, torques = self.wish.controller.robot.joint_names, self.torques(found, torque, force)
        effort = np.broadcast_to(self.wish.controller.effort, torques.shape)
        return [
            f"Joint {name!r} can need a torque of {most:.3g}; its effort is {limit:.3g}. {_LESS}"
            for name, most, limit in zip(names, torques, effort, strict=True)
            if most > limit
        ]

    def cause(self) -> str:
        """Return what grows with the error faster than the loops reject it."""
        if self.loop is None:
            return "with the inertia of these arms a joint's own loop is unstable: the model is too far off"
        if self._without().solve(0.0, 0.0) is not None:
            return f"The error can exceed {_WIDEST:g} rad or m. {_LESS}"
        grown = {
            "mismatch": "wrong inertia",
            "stiffness": "gravity",
            "rate": "Coriolis and viscous torques",
        }
        causes = [what for name, what in grown.items() if self._without(name).solve(0.0, 0.0) is not None]
        said = " or ".join(causes) or "several terms together"
        return f"the joints disturb each other more than their loops reject; limiting quantity: {said}"

    def _without(self, *names: str) -> _Tube:
        """Return the tube without what disturbs from the start, nor some of what grows with the error."""
        known, nothing = self.known, 0.0 * self.radius
        rest = {name: 0.0 * getattr(known.rest, name) for name in ("torque", "motion", *names)}
        still: Any = dict.fromkeys(("shift", "start", "speed"), nothing)
        quiet = known._replace(rest=known.rest._replace(**rest), jerk=0.0 * known.jerk, **still)
        return _Tube(self.wish, self.radius, self.fastest, quiet)

    def covers(self, arm: Robot, within: Array, torques: Array) -> bool:
        """Tell whether another arm has errors and torques within some sizes."""
        own = _Tube(self.wish._replace(arms=(arm,)), self.radius, self.fastest)
        found = own.solve()
        if found is None or not own.holds(found) or (found.error > within).any():
            return False
        return bool((own.torques(found, 0.0, self.wish.force) <= torques).all())

    def path_bound(self, tubes: Sequence[_Tube]) -> PathBound:
        """Return the bound, and what is tolerated in any of several tubes."""
        wish, known, loop = self.wish, self.known, self.loop
        found = self.solve()
        assert found is not None
        assert loop is not None
        size = np.maximum(found.error, 1e-300)
        parts = {name: loop.rest[0] * x / size for name, x in found.parts.items()}
        fixed = loop.measured[0] * wish.hidden + loop.shift[0] * known.shift
        parts["encoders and delay"] = parts["encoders and delay"] + fixed / size
        jerks = _convolve(loop, known.jerk)[0]
        parts["motion of the reference"] = parts["motion of the reference"] + jerks / size
        own = found.error + wish.delay * wish.controller.dt * known.speed
        return PathBound(
            wish=wish,
            error=own,
            tool=float(np.linalg.norm(known.jacobian @ own)),
            torque=self.torques(found, 0.0, wish.force),
            parts=parts,
            tolerated_torque=max((_most(lambda x, at=at: not at.reasons(x)) for at in tubes), default=0.0),
            tolerated_force=max(
                (_most(lambda x, at=at: not at.reasons(0.0, wish.force + x)) for at in tubes), default=0.0
            ),
        )


def _convolve(loop: Channel, course: Array) -> Array:
    """Return what loops make of accelerations whose sizes are known at each sample, at most; (3, n)."""
    later = loop.rest - loop.course.sum(axis=0)  # beyond the samples that were looked at
    beyond = later * course.max(axis=0)
    length = len(loop.course) + len(course)
    of_loop = np.fft.rfft(loop.course, length, axis=0)
    of_course = np.fft.rfft(course, length, axis=0)
    sums = np.fft.irfft(of_loop * of_course[:, None], length, axis=0)
    return np.asarray(beyond + np.maximum(sums.max(axis=0), 0.0))


def _most(fits: Any) -> float:
    """Return about the largest size that fits, rounded down."""
    low, high = 0.0, 1e-3
    while fits(high) and high < 1e9:
        low, high = high, 2.0 * high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
        if high - low < 1e-3 * high:
            break
    return low


def describe(found: PathBound) -> list[str]:
    """Return a tube in words, the verdict first."""
    robot, slides = found.wish.controller.robot, found.wish.controller.robot.prismatic
    if not found.holds:
        return ["No bound along this path:", *(f"  {reason}" for reason in found.reasons)]
    lines = [
        f"The tool stays within {1e3 * found.tool:.3g} mm of its path.",
        "  This is not proved: joints are assumed stiff, and the numbers of the arm are the largest that "
        "were found, and 3 % more.",
        f"  Tolerated in addition, arbitrary in time: {found.tolerated_torque:.2g} N m or N on all joints at "
        f"once, or {found.tolerated_force:.2g} N at the tool.",
    ]
    if found.tried:
        lines.append(
            f"  With 95 % confidence it holds for {100.0 * share_covered(found.tried):.0f} % of the possible "
            f"arms: {found.tried} more are within it."
        )
    if names := found.weaker_than_friction():
        lines.append(
            f"  That is less than the Coulomb friction of {', '.join(names)}, which the bound does not "
            "include: add --friction, or feed it forward."
        )
    most = max(found.parts, key=lambda what: float(found.parts[what] @ found.error))
    lines.append(f"  The largest part is {most}. Try first: {_ADVICE[most]}.")
    width = max(len(name) for name in robot.joint_names)
    for j, name in enumerate(robot.joint_names):
        shares = sorted(((x[j], what) for what, x in found.parts.items()), reverse=True)
        parts = ", ".join(f"{what} {100.0 * x:.0f} %" for x, what in shares if x >= _TOLD)
        lines.append(
            f"  {name:<{width}}  {found.error[j]:.3g} {POSITION.symbol(slides[j])}, torque up to "
            f"{found.torque[j]:.3g} {TORQUE.symbol(slides[j])}{'; ' if parts else ''}{parts}"
        )
    return lines


#: Numbers of the law of which a batch has more than one for each joint.
_PER_JOINT = ("rest_dead_zone", "rolloff_ratio", "effort", "second_ratio", "second_zeta")


def _check_law(controller: GPI) -> None:
    """Refuse what is no linear law of the error with gains that stay, from the torque that holds the arm."""
    if not (isinstance(controller.robot, Robot) and isinstance(controller.bias_robot, Robot)):
        raise ParameterError("controller", "a batch of robots", "one robot")
    if not isinstance(controller.gains, FixedGains):
        raise ParameterError("gains", type(controller.gains).__name__, "FixedGains: gains that stay")
    for name, value in {"realisation": "bumpless", "start": "hold"}.items():
        if getattr(controller, name) != value:
            raise ParameterError(name, getattr(controller, name), f"{value} where there is to be a bound")
    limit: Any = controller.force_limit
    if limit is not None:
        raise ParameterError("force_limit", limit, "none where there is to be a bound")
    if np.any(controller.rest_leak):
        raise ParameterError("rest_leak", controller.rest_leak, "0 where there is to be a bound")
    values = {
        "gains": max(controller.gains.nominal(), key=np.ndim),
        **{name: getattr(controller, name) for name in _PER_JOINT},
    }
    for name, value in values.items():
        if np.ndim(value) > 1:
            raise ParameterError(name, f"shape {np.shape(value)}", "one number for each joint")


def _check_path(wish: Wish) -> None:
    """Refuse a path that begins in motion, jumps, or whose speed does."""
    h, late = wish.controller.dt, wish.delay + 1
    if len(wish.samples) <= 2 * late:
        raise ParameterError("t_final", wish.t_final, f"more than {2 * late * h:g} s, {2 * late} samples")
    q, v, a = wish.reference.at(wish.samples)
    if q.shape != (len(wish.samples), wish.controller.robot.n):
        raise ParameterError("reference", f"shape {q.shape[1:]}", f"{wish.controller.robot.n} joints")
    moved = np.abs(q[: late + 1] - q[0]).max()
    if moved > _AT_REST or np.abs(v[0]).max() > _AT_REST:
        raise ParameterError("reference", "moves at once", "a path that is at rest at first")
    most_v = np.maximum(np.abs(v[1:]), np.abs(v[:-1]))
    most_a = np.maximum(np.abs(a[1:]), np.abs(a[:-1]))
    by_trapezoid = 0.5 * h * (v[1:] + v[:-1])
    jumps = np.abs(np.diff(q, axis=0) - by_trapezoid)
    if (jumps > h * h * most_a + _AT_REST * h).any():
        raise ParameterError("reference", "jumps", "a path whose velocities are its derivative")
    speed_jumps = np.abs(np.diff(v, axis=0))
    if (speed_jumps > 2.0 * h * most_a + _AT_REST * (1.0 + most_v)).any():
        raise ParameterError(
            "reference", "its speed jumps", "a path whose accelerations are the derivative of its velocities"
        )


def _bits(value: Any, robot: Robot) -> Array:
    """Return the resolution of the encoders, as :class:`armgpi.Encoder` takes it."""
    bits = quantity(value, "bits", robot.joint_names)
    if not ((bits >= 1.0) & (bits <= 52.0) & (bits == np.rint(bits))).all():
        raise ParameterError("bits", value, "whole numbers of bits, 1 to 52")
    return bits


def with_loads(
    robot: Robot, lightest: float, heaviest: float, frame: str, com: Any = (0.0, 0.0, 0.0)
) -> list[Robot]:
    """Return an arm with the lightest load of a range [kg], the heaviest, and one between."""
    masses = np.linspace(lightest, heaviest, _LOADS)
    return [robot.with_payload(frame, float(mass), com) for mass in masses]


def _arms(controller: GPI, given: Any) -> tuple[Robot, ...]:
    """Return what the true arm may be."""
    if given is None:
        known: Any = controller.bias_robot
        if (loads := controller.payload) is None:
            return (known,)
        if known is loads.nominal:
            raise ParameterError(
                "arms", None, "the arms with their payloads: the model has the heaviest alone"
            )
        return tuple(with_loads(known, loads.lightest, loads.heaviest, loads.frame, loads.com))
    given = given.robots if isinstance(given, RobotBatch) else given
    arms = tuple(given) if isinstance(given, Sequence) else (given,)
    for arm in arms:
        check_type(arm, "arms", Robot, "a Robot, or several")
        if arm.joint_names != controller.robot.joint_names:
            raise ParameterError(
                "arms", list(arm.joint_names), f"the joints {list(controller.robot.joint_names)}"
            )
    if not arms:
        raise ParameterError("arms", "none", "at least one Robot")
    return arms


def _sizes(value: Any, name: str, robot: Robot) -> Array:
    """Return one size for each joint."""
    array = quantity(value, name, robot.joint_names)
    if not not_negative(array).all():
        raise ParameterError(name, value, "zero or positive")
    return np.broadcast_to(array, (robot.n,)).astype(float)
