"""Certificates against many rollouts of the whole arm: no error may exceed what is certified."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from armgpi.arrays import Array
from armgpi.certification.adversary import Worst, worst
from armgpi.certification.asked import Asked
from armgpi.certification.solve import checker, merged
from armgpi.loop.prepared import prepare
from armgpi.plants.loads import Step
from armgpi.plants.rigid_body import RigidBodyPlant
from armgpi.plants.sensors import Delayed, Encoder
from armgpi.references.bezier import PEAK_ACCELERATION, PEAK_VELOCITY, Bezier
from armgpi.references.reference import Reference
from armgpi.references.waypoints import Hold
from armgpi.robot.robot import Robot

if TYPE_CHECKING:
    from armgpi.certification.certificate import Certificate

#: Samples of a rollout, rollouts at once, and switches of a torque.
_SAMPLES, _TOGETHER, _SWITCHES = 600, 20_000, 8
#: Share of the certified torque that acts: its length in the metric changes a little as the arm moves.
_NEARLY = 0.99


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
    asked: Asked, made: Certificate, count: int, seed: int = 0, claims: Sequence[str] = Observed._fields[1:]
) -> Observed:
    """Return the worst of random and adversarial rollouts of the compiled loop.

    Half of the torques act on one joint and switch when the worst one at some configuration does, the others
    act on all joints and switch at random. A quarter of the rollouts is at the worst configurations that were
    found, a third at corners of the box, the others anywhere in it. With a feedforward only the load that it
    knows is tried, the other one for a start with a wrong load, and without a feedforward both. A jump is
    from there to the other load, while error and speed are anything that what was stated may have led to.

    Args:
        asked: what the certificate is for.
        made: the certificate.
        count: of rollouts, for each claim that was made.
        seed: of all that is drawn.
        claims: those that are tried, of those that were made.
    """
    rng, cases = np.random.default_rng(seed), worst(asked, count=40, samples=_SAMPLES, seed=seed)
    every, knows = asked.setting.arms, -1 if asked.rule is None else 0
    ratios, rollouts = {name: np.full(asked.robot.n, np.nan) for name in Observed._fields[1:]}, 0
    for claim in claims:
        if claim in made.data["solutions"]:
            known = every[-1 - knows] if claim == "start" else every[knows]
            arms = every if asked.setting.feedforward == "none" else (known,)
            for arm in arms:
                for size in _portions(-(-count // len(arms))):
                    peaks = _Batch(asked, made, arm, cases, size, rng).peaks(claim)
                    claimed = made.data["solutions"][claim]["claims"]["errors"]
                    ratios[claim] = np.fmax(ratios[claim], peaks / np.array(claimed, dtype=float))
                    rollouts += size
    return Observed(rollouts, **ratios)


def _portions(count: int) -> list[int]:
    """Return portions of rollouts that fit into memory."""
    return [_TOGETHER] * (count // _TOGETHER) + [count % _TOGETHER] * bool(count % _TOGETHER)


class _Batch:
    """Rollouts that run together."""

    def __init__(
        self, asked: Asked, made: Certificate, arm: Robot, cases: list[Worst], count: int, rng: Any
    ) -> None:
        """Draw configurations, and which joint is pushed."""
        self.asked, self.made, self.arm = asked, made, arm
        self.cases, self.count, self.rng = cases, count, rng
        setting, n = asked.setting, arm.n
        share = rng.random((count, n))
        share = np.where(rng.random((count, 1)) < 1.0 / 3.0, np.rint(share), share)
        self.q = setting.lower + share * (setting.upper - setting.lower)
        bad = rng.random(count) < 0.25
        self.q[bad] = np.array([case.q for case in cases])[rng.integers(n, size=bad.sum())]
        self.joint = rng.integers(n, size=count)
        self.single = rng.random(count) < 0.5

    def peaks(self, claim: str) -> Array:
        """Return the largest error of each joint, (n,)."""
        asked, arm, h = self.asked, self.arm, self.asked.controller.dt
        light, heavy = asked.setting.arms[0], asked.setting.arms[-1]
        moved = {"jump": light if arm is heavy else heavy}.get(claim, arm)
        start: Any = self._excited() if claim == "jump" else {}
        tau, onsets = self._torques(claim), self._onsets()
        # After the first, each step turns the torque round.
        signs = [1.0, *(2.0 * (-1.0) ** k for k in range(1, _SWITCHES))]
        loads = [Step(sign * tau, onset=onset[:, None]) for sign, onset in zip(signs, onsets, strict=True)]
        plant: Any = RigidBodyPlant(moved, loads=loads)
        if asked.bits is not None and claim != "gain":
            plant = Encoder(plant, asked.bits)
        if asked.delay:
            plant = Delayed(plant, asked.delay)
        controller = asked.controller
        if asked.setting.feedforward == "none":  # it starts with what holds the true arm, or the other one
            other = light if arm is heavy else heavy
            controller = controller.with_values(bias_robot=other if claim == "start" else arm)
        if claim == "gain":
            controller = controller.with_values(rest_dead_zone=0.0)
        reference = Hold(self.q) if claim == "gain" else self._moving()
        run = prepare(plant, controller, reference, h * _SAMPLES, record="metrics", backend="compiled")
        return np.asarray(np.abs(run.run(**start)["peak_error"].values).reshape(-1, arm.n).max(axis=0))

    def _excited(self) -> dict[str, Array]:
        """Return errors and speeds of a V that the stated inputs keep it at; integrators as at rest."""
        data, n = self.made.data, self.arm.n
        facts = merged(data["limits"], data["law"], data["numbers"], data["inputs"]["jump"])
        solution, sizes = checker.exact(data["solutions"]["jump"]), checker.sample(facts)[4]
        level = sum(x * y * y for x, y in zip(solution["a"], sizes, strict=True)) / solution["alpha"]
        P = np.array([row[:2] for row in solution["P"][:2]], dtype=float)
        # Of length 1 in the metric of P and D, of either sign in each part.
        x = np.linalg.inv(np.linalg.cholesky(P)).T @ self.rng.standard_normal((self.count, 2, n))
        D = self.arm.mass_matrix(self.q)
        x *= _NEARLY * math.sqrt(level) / np.sqrt(np.einsum("kai,ab,kij,kbj->k", x, P, D, x))[:, None, None]
        limits, far = self.arm.limits, np.abs(x[:, 0])
        self.q = np.clip(self.q, limits.lower + far, limits.upper - far)
        return {"q0": self.q + x[:, 0], "v0": float(max(facts["omega"])) * x[:, 1]}

    def _torques(self, claim: str) -> Array:
        """Return the torques that switch, (count, n)."""
        n, setting = self.arm.n, self.asked.setting
        drawn = self.rng.standard_normal((self.count, n))
        if claim != "gain":
            return np.asarray(setting.torque * np.sign(drawn))
        tau = np.where(self.single[:, None], np.eye(n)[self.joint] * np.sign(drawn[:, :1]), drawn)
        inverse = np.linalg.inv(self.arm.mass_matrix(self.q))
        length = np.sqrt(np.einsum("ka,kab,kb->k", tau, inverse, tau))
        size = _NEARLY * float(self.made.data["inputs"]["gain"]["torque"])
        return np.asarray(size / length[:, None] * tau)

    def _onsets(self) -> Array:
        """Return when the torques switch, (switches, count)."""
        h = self.asked.controller.dt
        onsets = np.sort(self.rng.uniform(0.0, _SAMPLES * h, (_SWITCHES, self.count)), axis=0)
        onsets[0] = 0.0
        for j, case in enumerate(self.cases):
            signs = np.sign(case.response[_SAMPLES - 1 :: -1])
            turns = np.flatnonzero(signs[1:] != signs[:-1]) + 1  # the last ones are nearest to the peak
            times = np.concatenate([[0], turns[1 - _SWITCHES :]])
            padded = np.concatenate([times, np.full(_SWITCHES - len(times), 2 * _SAMPLES)])
            onsets[:, self.single & (self.joint == j)] = h * padded[:, None]
        return onsets

    def _moving(self) -> Reference:
        """Return references that move as fast as was stated, within the box; at rest where nothing moves."""
        setting, duration = self.asked.setting, 0.8 * _SAMPLES * self.asked.controller.dt
        far = np.minimum(
            setting.velocity * duration / PEAK_VELOCITY,
            setting.acceleration * duration**2 / PEAK_ACCELERATION,
        )
        if not far.any():
            return Hold(self.q)
        goal = self.q + far * self.rng.choice([-1.0, 1.0], self.q.shape)
        return Bezier(self.q, np.clip(goal, setting.lower, setting.upper), duration=duration)
