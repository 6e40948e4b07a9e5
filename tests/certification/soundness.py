"""Certificates against many rollouts of the whole arm: no error may exceed what is certified."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array, as_times
from armgpi.certification.adversary import Worst, worst
from armgpi.certification.quantities import resting
from armgpi.certification.request import Asked
from armgpi.certification.solve import checker, merge_facts
from armgpi.control.controller import Measurement
from armgpi.loop.prepared import prepare
from armgpi.loop.simulation import simulate
from armgpi.plants.loads import Load, Step
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.plants.sensors import Delayed, Encoder
from armgpi.references.reference import Reference, Target
from armgpi.references.waypoints import Hold

if TYPE_CHECKING:
    from armgpi.certification.certificate import Certificate

#: Samples of a rollout, rollouts at once, parts of a torque's course, and of the reference's.
_SAMPLES, _TOGETHER, _PARTS, _LEGS = 1000, 20_000, 8, 4
#: Share of what is certified that acts: the rest is for rounding.
_NEARLY = 0.99
#: How much wider than 0..1 genes are taken of configurations, loads, and torques and speeds: the ends are as
#: likely as what is beyond them.
_IN_BOX, _AT_ENDS, _AT_CORNERS = 1.2, 1.6, 2.0
#: Share of a generation that is kept, how many compete for a parent's place, and how far and how often a gene
#: changes.
_ELITE, _RIVALS, _CHANGE, _CHANGES = 0.02, 3, 0.1, 0.1


class Observed(NamedTuple):
    """The worst of many rollouts beside what is certified.

    Attributes:
        rollouts: how many there were.
        gain: largest error over that certified for the same torque with the reference at rest, (n,).
        stated: largest error over that certified for all that was stated, (n,); NaN where nothing was.
        start: the same from a start with the torque that holds another load, (n,); NaN likewise.
        jump: the same after a jump of the load, (n,); NaN likewise.
    """

    rollouts: int
    gain: Array
    stated: Array
    start: Array
    jump: Array


def observe(
    asked: Asked,
    made: Certificate,
    count: int,
    seed: int = 0,
    claims: Sequence[str] = Observed._fields[1:],
    generations: int = 1,
) -> Observed:
    """Return the worst of adversarial rollouts of the compiled loop.

    What a claim leaves open is a row of genes in 0..1 (:class:`Adversary`). The first generation is drawn: a
    quarter at the worst configurations of the frozen arm, half with a torque on one joint that switches when
    the worst one there does. Each later generation is bred from the one before it.

    Args:
        asked: what the certificate is for.
        made: the certificate.
        count: of rollouts, for each claim that was made.
        seed: of all that is drawn.
        claims: those that are tried, of those that were made.
        generations: how many; as many as fit into memory at least.
    """
    rng, cases = np.random.default_rng(seed), worst(asked, count=40, samples=_SAMPLES, seed=seed)
    ratios, rollouts = {name: np.full(asked.robot.n, np.nan) for name in Observed._fields[1:]}, 0
    size = -(-count // max(generations, -(-count // _TOGETHER)))
    for claim in claims:
        if claim not in made.data["solutions"]:
            continue
        adversary = Adversary(asked, made, claim)
        genes = adversary.first(size, cases, rng)
        for done in range(0, count, size):
            found = adversary.ratios(genes[: count - done])
            ratios[claim] = np.fmax(ratios[claim], found.max(axis=0))
            rollouts += len(found)
            genes = bred(genes[: len(found)], found.max(axis=1), size, rng)
    return Observed(rollouts, **ratios)


def bred(genes: Array, fitness: Array, count: int, rng: Any) -> Array:
    """Return the next generation (count, width): the best, and children of winners of small tournaments.

    Args:
        genes: of a generation, in 0..1, shape (k, width).
        fitness: how good each is, shape (k,).
        count: of the next.
        rng: of the draws.
    """
    best = np.argsort(-fitness)[: math.ceil(_ELITE * count)]
    rivals = rng.integers(len(genes), size=(2, count - len(best), _RIVALS))
    winners = np.take_along_axis(rivals, np.argmax(fitness[rivals], axis=2)[..., None], axis=2)[..., 0]
    mother, father = genes[winners]
    children = np.where(rng.random(mother.shape) < 0.5, mother, father)
    moved = rng.random(children.shape) < _CHANGES
    children = np.clip(children + moved * _CHANGE * rng.standard_normal(children.shape), 0.0, 1.0)
    return np.concatenate([genes[best], children])


class Swing(Reference):
    """A reference whose acceleration is constant but for a few times at which it changes.

    Attributes:
        start: configuration before it moves [rad or m], shape (batch, n).
        changes: of the acceleration [rad/s^2 or m/s^2], each of shape (batch, n).
        times: when they are [s].
    """

    symbolic = True

    def __init__(self, start: Array, changes: Sequence[Any], times: Any) -> None:
        """Take the start, the changes and their times."""
        self.start, self.changes, self.times = start, list(changes), times

    def variables(self) -> dict[str, Any]:
        """Return start and changes; see :meth:`Reference.variables`."""
        return {"start": self.start, **{f"change.{k}": x for k, x in enumerate(self.changes)}}

    def with_values(self, **changes: Any) -> Swing:
        """Return another motion; see :meth:`Reference.with_values`."""
        given = {**self.variables(), **changes}
        return Swing(given.pop("start"), list(given.values()), self.times)

    def at(self, t: Any) -> Target:
        """Return the target at `t` [s]; shapes as :meth:`Reference.at`."""
        t = np.multiply(1.0, as_times(t))  # an array, or symbols
        t = t.reshape(t.shape + (1,) * np.ndim(self.start))
        q, v, a = self.start + 0.0 * t, 0.0 * t, 0.0 * t
        for change, begin in zip(self.changes, self.times, strict=True):
            since = np.maximum(t - begin, 0.0)
            q, v = q + 0.5 * change * since * since, v + change * since
            a = a + change * np.where(t >= begin, 1.0, 0.0)
        return Target(q, v, a)


class Adversary:
    """What one claim leaves open, as genes in 0..1, and the rollouts that they lead to.

    Genes are of: configuration, torques and when they change, speeds of the reference, the load, the load of
    the start or of the time before a jump, and error and speed before a jump.
    """

    def __init__(self, asked: Asked, made: Certificate, claim: str) -> None:
        self.asked, self.made, self.claim = asked, made, claim
        n = asked.robot.n
        self.widths = [n, _PARTS * n, _PARTS, _LEGS * n, 1, 1, 2 * n]
        self.claimed = np.array(made.data["solutions"][claim]["claims"]["errors"], dtype=float)
        self.times = np.linspace(0.0, _SAMPLES * asked.controller.dt, _LEGS, endpoint=False)

    def first(self, count: int, cases: Sequence[Worst], rng: Any) -> Array:
        """Return genes of a first generation, (count, width)."""
        setting, n = self.asked.setting, self.asked.robot.n
        genes = rng.random((count, sum(self.widths)))
        q, torques, onsets = np.split(genes, np.cumsum(self.widths[:3]), axis=1)[:3]
        at = (np.array([case.q for case in cases]) - setting.lower) / (setting.upper - setting.lower + 1e-300)
        bad = rng.random(count) < 0.25
        q[bad] = (0.5 + (at - 0.5) / _IN_BOX)[rng.integers(n, size=bad.sum())]
        joint, single = rng.integers(n, size=count), rng.random(count) < 0.5
        turning = (-1.0) ** np.arange(_PARTS)
        for j, case in enumerate(cases):
            mine = single & (joint == j)
            signs = np.sign(case.response[_SAMPLES - 1 :: -1])
            turns = np.flatnonzero(signs[1:] != signs[:-1]) + 1  # the last ones are nearest to the peak
            turns = np.concatenate([[0], turns[1 - _PARTS :]])
            onsets[mine] = np.concatenate([turns / _SAMPLES, np.ones(_PARTS - len(turns))])
            torques[mine] = (0.5 + 0.5 * turning[:, None] * np.eye(n)[j]).ravel()
        return np.concatenate([q, torques, onsets, genes[:, sum(self.widths[:3]) :]], axis=1)

    def ratios(self, genes: Array) -> Array:
        """Return the largest error of each joint over the one that is claimed, (count, n)."""
        asked, claim = self.asked, self.claim
        setting, h, n = asked.setting, asked.controller.dt, asked.robot.n
        parts = np.split(genes, np.cumsum(self.widths)[:-1], axis=1)
        q = setting.lower + _spread(parts[0], _IN_BOX) * (setting.upper - setting.lower)
        arm, before, controller = self.loads(parts[4][:, 0], parts[5][:, 0])
        reference = self.reference(q, parts[3])
        start: dict[str, Any] = {}
        if claim == "jump":
            start = self.excited(reference, before, controller, 2.0 * parts[6].reshape(-1, 2, n) - 1.0)
        levels = 2.0 * _spread(parts[1].reshape(-1, _PARTS, n), _AT_CORNERS) - 1.0
        tau = self.torques(levels, reference.start, arm)
        onsets = _SAMPLES * h * np.sort(parts[2], axis=1)
        onsets[:, 0] = 0.0
        steps = np.diff(tau, axis=1, prepend=0.0)
        begins: Any = onsets[..., None]
        loads = [Step(steps[:, k], onset=begins[:, k]) for k in range(_PARTS)]
        plant: Any = RigidBodyPlant(arm, loads=loads, friction="urdf" if asked.friction else None)
        if asked.bits is not None and claim != "gain":
            plant = Encoder(plant, asked.bits)
        if asked.delay:
            plant = Delayed(plant, asked.delay)
        run = prepare(plant, controller, reference, h * _SAMPLES, record="metrics", backend="compiled")
        return np.asarray(run.run(**start)["peak_error"].values / self.claimed)

    def loads(self, true: Array, other: Array) -> tuple[Any, Any, Any]:
        """Return the arm, that of the start or before a jump, and the controller; genes of shape (count,)."""
        asked, claim = self.asked, self.claim
        controller, loads = asked.controller, asked.controller.payload
        if claim == "gain":
            controller = controller.with_values(rest_dead_zone=0.0)
        limits = asked.robot.limits  # an error may leave them
        robot = asked.robot.with_limits(lower=limits.lower - 1.0, upper=limits.upper + 1.0)
        if loads is None:
            return robot, robot, controller
        true, other = _spread(true, _AT_ENDS), _spread(other, _AT_ENDS)
        free = asked.setting.feedforward == "none"  # it starts with what holds the load that it is told
        if not free:
            other = np.full_like(other, float(asked.rule is None))
        if claim in ("gain", "stated"):
            true = other
        between = loads.heaviest - loads.lightest
        arm, before = (
            robot.varied(payload=loads.lightest + x * between, frame=loads.frame, com=loads.com)
            for x in (true, other)
        )
        return arm, before, controller.with_values(bias_robot=before) if free else controller

    def torques(self, levels: Array, q: Array, arm: Any) -> Array:
        """Return torques for levels in -1..1, both of shape (count, parts, n)."""
        setting, numbers = self.asked.setting, self.made.data["numbers"]
        if self.claim != "gain":
            return np.asarray(setting.torque * levels)
        # Its length in the metric changes as the arm moves.
        grown = math.exp(0.5 * float(numbers["sigma"]) * float(np.max(self.claimed / setting.speed)))
        size = _NEARLY * float(self.made.data["inputs"]["gain"]["torque"]) / grown
        length = np.sqrt(np.einsum("kpa,kab,kpb->kp", levels, np.linalg.inv(arm.mass_matrix(q)), levels))
        return np.asarray(levels * (size / np.maximum(length, 1e-9))[..., None])

    def reference(self, q: Array, genes: Array) -> Swing:
        """Return references in the box, as fast as was stated; at rest where nothing moves."""
        setting, n = self.asked.setting, self.asked.robot.n
        velocity = setting.velocity * float(self.claim != "gain")
        wanted = velocity * (2.0 * _spread(genes.reshape(-1, _LEGS, n), _AT_CORNERS) - 1.0)
        v, accelerations = np.zeros_like(q), []
        for k in range(_LEGS):
            most = setting.acceleration * (velocity > 0.0)
            accelerations.append(np.clip((wanted[:, k] - v) / self.times[1], -most, most))
            v = v + accelerations[-1] * self.times[1]
        changes: Any = np.diff(np.array(accelerations), axis=0, prepend=0.0)
        way = Swing(np.zeros_like(q), changes, self.times).at(np.linspace(0.0, self.times[1] * _LEGS, 60)).q
        lowest, highest = way.min(axis=0), way.max(axis=0)
        share = np.minimum(1.0, (setting.upper - setting.lower) / np.maximum(highest - lowest, 1e-9))
        start = np.clip(q, setting.lower - share * lowest, setting.upper - share * highest)
        return Swing(start, share * changes, self.times)

    def excited(self, reference: Swing, before: Any, controller: Any, x: Array) -> dict[str, Array]:
        """Return errors and speeds of a V that the stated inputs keep it at, in directions x (count, 2, n).

        The controller begins as at rest where the arm is. So its integrators differ from what holds the arm
        at the reference, and V is with that difference.
        """
        data, setting = self.made.data, self.asked.setting
        facts = merge_facts(data["limits"], data["law"], data["numbers"], data["inputs"]["jump"])
        solution, sizes = checker.exact(data["solutions"]["jump"]), checker.sample(facts)[4]
        level = float(sum(x * y * y for x, y in zip(solution["a"], sizes, strict=True)) / solution["alpha"])
        P, omega, late = np.array(solution["P"], dtype=float), float(min(facts["omega"])), self.asked.delay
        into = np.zeros((len(P), 3))  # of error, speed and integrators into the states
        into[:3] = np.eye(3)
        into[len(P) - late :, 0] = 1.0
        P = into.T @ P @ into
        r, x = reference.start, np.linalg.inv(np.linalg.cholesky(P[:2, :2])).T @ x
        D, held = before.mass_matrix(r), resting(setting, before, r)
        off = np.zeros_like(r)
        for _ in range(4):  # V is nearly quadratic in x
            whole = np.concatenate([x, off[:, None]], axis=1)
            V = np.einsum("kai,ab,kij,kbj->k", whole, P, D, whole)
            x = x * (_NEARLY * math.sqrt(level) / np.sqrt(V))[:, None, None]
            D = before.mass_matrix(r + x[:, 0])
            state = controller.init(Measurement(r + x[:, 0]), reference.at(0.0))
            off = (state.law[0] + held) / omega**2
        return {"q0": r + x[:, 0], "v0": omega * x[:, 1]}


def _spread(genes: Any, wide: float) -> Array:
    """Return genes as shares in 0..1, of which the ends are more likely the wider."""
    return np.asarray(np.clip(0.5 + wide * (genes - 0.5), 0.0, 1.0))


class Course(Load):
    """Torques that are given sample by sample, and zero afterwards."""

    def __init__(self, course: Array, dt: float) -> None:
        """Take the torques [N m or N], shape (samples, n), and the sample time [s]."""
        self.course, self.dt = np.concatenate([course, np.zeros((1, course.shape[1]))]), dt

    def torque(self, t: Any) -> Array:
        """Return the torque at times [s]; see :meth:`Load.torque`."""
        t = np.asarray(t)  # its last axis stands for the joints
        sample = np.floor((t[..., 0] if t.ndim else t) / self.dt + 1e-6).astype(int)
        return np.asarray(self.course[np.clip(sample, 0, len(self.course) - 1)])

    def describe(self) -> dict[str, Any]:
        """Return what it is as plain data."""
        return {"type": type(self).__name__}


def attack(asked: Asked, joint: int, case: Worst, size: float) -> float:
    """Return the error over the torque [rad/(N m)] that the worst torque leads to in the simulated arm.

    Args:
        asked: what the certificate is for.
        joint: on which the torque acts.
        case: from :func:`worst`.
        size: of the torque [N m or N].
    """
    h = asked.controller.dt
    rest = round(2.0 / h)
    course = np.zeros((rest + len(case.response), case.arm.n))
    course[rest:, joint] = -size * np.sign(case.response[::-1])
    plant: Any = RigidBodyPlant(case.arm, loads=[Course(course, h)])
    if asked.delay:
        plant = Delayed(plant, asked.delay)
    rollout = simulate(plant, asked.controller, Hold(case.q), h * (len(course) + 1), progress=False)
    e = np.abs(rollout["q"].values - rollout["q_ref"].values)[rest:, joint]
    return float(e.max()) / size
