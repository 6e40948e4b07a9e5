"""Each bound of a start and of a jump in docs/proof.md against the quantity that it bounds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import FOLLOWS, robots

from armgpi import Robot
from armgpi.base.arrays import Array
from armgpi.certification import check_certificate, quantities
from armgpi.certification.certificate import Certificate, certificate
from armgpi.certification.quantities import Points, Setting, resting, search_numbers
from armgpi.certification.request import ask
from armgpi.certification.solve import merge_facts

checker: Any = check_certificate
SEEDS = st.integers(0, 2**32 - 1)
SHARES = st.floats(0.0, 1.0)


def length(D: Array, x: Array) -> float:
    return float(np.sqrt(x @ D @ x))


def at_one_place(robot: Robot, load: float, shares: tuple[float, float], seed: int) -> None:
    """Compare, for any two loads of a range, what changes with the load with the numbers at that place."""
    rng, n = np.random.default_rng(seed), robot.n
    r, rest = rng.uniform(-1.0, 1.0, n), np.zeros(n)
    ends = robot.with_payload(robot.tip, 0.0), robot.with_payload(robot.tip, load)
    before, after = (robot.with_payload(robot.tip, share * load) for share in shares)
    setting = Setting(ends, ends[1], robot, r, r, rest, rest + 1.0, "none")._replace(
        velocity=rest, torque=rest, friction=rest, acceleration=rest, encoder=rest, viscous=rest, zone=rest
    )
    noise = 1e-3 * rng.uniform(-1.0, 1.0, n)
    between = r + np.linspace(0.0, 1.0, 5)[:, None] * noise
    at = Points(np.repeat(r[None], 5, 0), np.repeat(r[None], 5, 0), between)
    every = quantities.functions(setting)
    names = "-delta_low", "delta_high", "kappa_e", "jump"
    low, high, stiffness, jump = (max(float(every[x](setting, arm, at).max()) for arm in ends) for x in names)
    D, other = after.mass_matrix(r), before.mass_matrix(r)

    # V = x'(P x D)x grows by what D does.
    x, ratio = rng.standard_normal(n), high / -low
    assert length(D, x) ** 2 <= ratio * length(other, x) ** 2 * (1.0 + 1e-9)
    # The integrators are off by the change of v*, in the metric of the arm from then on.
    held = [resting(setting, arm, r[None])[0] for arm in (before, after)]
    assert length(D, held[1] - held[0]) <= jump * (1.0 + 1e-9) + 1e-9
    # And by what the encoders hide where it starts: in the metric of r, to which first order is compared.
    hidden = resting(setting, before, (r + noise)[None])[0] - held[0]
    # D at r + noise is D at r but for a part of the order of the noise.
    assert length(other, hidden) <= 1.05 * stiffness * length(other, noise) / -low + 1e-9 * length(
        other, held[0]
    )


@settings(max_examples=25)
@given(robots(max_joints=5), st.floats(0.01, 3.0), st.tuples(SHARES, SHARES), SEEDS)
def test_no_load_changes_more_than_its_bound(
    robot: Robot, load: float, shares: tuple[float, float], seed: int
) -> None:
    at_one_place(robot, load, shares, seed)


@pytest.mark.parametrize("seed", range(3))
def test_nor_of_an_arm_whose_joint_follows_another(seed: int) -> None:
    at_one_place(Robot.from_xml(FOLLOWS, mimic="follow"), 1.0, (0.3, 0.8), seed)


class Run(NamedTuple):
    """One held torque over a sample, first on one arm and then on another."""

    q: Array
    v: Array
    fastest: list[float]


def held(arms: tuple[Any, Any], q: Array, v: Array, tau: Array, times: tuple[float, float], D: Array) -> Run:
    """Integrate it by small Runge-Kutta steps; `fastest`: each arm's largest acceleration in the metric D."""
    fastest = []
    for arm, span in zip(arms, times, strict=True):
        h, most = span / 20, 0.0
        for _ in range(20):
            a = arm.dynamics.forward(q, v, tau)
            most = max(most, length(D, a))
            b = arm.dynamics.forward(q + h / 2 * v, v + h / 2 * a, tau)
            c = arm.dynamics.forward(q + h / 2 * v + h * h / 4 * a, v + h / 2 * b, tau)
            d = arm.dynamics.forward(q + h * v + h * h / 2 * b, v + h * c, tau)
            q = q + h * v + h * h / 6 * (a + b + c)
            v = v + h / 6 * (a + 2 * b + 2 * c + d)
        fastest.append(max(most, length(D, arm.dynamics.forward(q, v, tau))))
    return Run(q, v, fastest)


@settings(max_examples=15)
@given(robots(max_joints=4), st.floats(0.01, 1.0), st.tuples(SHARES, SHARES), SHARES, SEEDS)
def test_a_jump_inside_a_sample_moves_error_and_speed_by_no_more_than_both_accelerations(
    robot: Robot, load: float, shares: tuple[float, float], share: float, seed: int
) -> None:
    """Against the sample that the second arm would have had from its beginning."""
    rng, n, h = np.random.default_rng(seed), robot.n, 1e-3
    before, after = (robot.with_payload(robot.tip, x * load) for x in shares)
    q, v = rng.uniform(-1.0, 1.0, n), 0.3 * rng.standard_normal(n)
    D = after.mass_matrix(q)
    tau = before.gravity(q) + before.inertia_times(q, rng.standard_normal(n))
    jumped = held((before, after), q, v, tau, (share * h, (1.0 - share) * h), D)
    alone = held((after, after), q, v, tau, (share * h, (1.0 - share) * h), D)
    both = jumped.fastest[0] + max(jumped.fastest[1], *alone.fastest)
    tiny = 1e-9 * (1.0 + both) * h + 1e-12
    assert length(D, jumped.v - alone.v) <= h * both + tiny
    assert length(D, jumped.q - alone.q) <= 0.5 * h * h * both + tiny


@pytest.fixture(scope="module")
def jumping() -> tuple[Any, Certificate]:
    robot = Robot.load("anthropomorphic3").with_armature(0.02)
    given = {"payload": (0.0, 0.02), "speed": 0.2, "radius": 0.05, "torque": 0.001, "jump": True}
    asked = ask(robot, 1e-3, acceleration=0.2, **given)
    return asked, certificate(asked, search_numbers(asked.setting))


@pytest.mark.parametrize("claim", ["start", "jump"])
def test_no_state_that_v_allows_leaves_a_claim_in_the_sample_of_a_start_or_a_jump(
    jumping: tuple[Any, Certificate], claim: str
) -> None:
    """Integrators and filters may be anything, which no rollout from rest has; so may a jump's time."""
    asked, made = jumping
    setting, data, h = asked.setting, made.data, asked.controller.dt
    facts = merge_facts(data["limits"], data["law"], data["numbers"], data["inputs"][claim])
    solution, claims = checker.exact(data["solutions"][claim]), data["solutions"][claim]["claims"]
    level = float(
        sum(x * y * y for x, y in zip(solution["a"], checker.sample(facts)[4], strict=True))
        / solution["alpha"]
    )
    omega, P = float(facts["omega"][0]), np.array(solution["P"], dtype=float)
    A, K = (np.array(x, dtype=float) for x in checker.loop(facts, facts["omega"][0])[1:3])
    to_error = np.sqrt(np.linalg.inv(P)[0, 0] * np.array(data["numbers"]["inverse"], dtype=float))
    errors, speed = np.array(claims["errors"], dtype=float), float(claims["speed"][0])
    rng, worst = np.random.default_rng(0), 0.0
    for _ in range(300):
        r = rng.uniform(setting.lower, setting.upper)
        first, second = (asked.robot.with_payload(asked.robot.tip, x) for x in rng.permutation([0.0, 0.02]))
        x = np.linalg.inv(np.linalg.cholesky(P)).T @ rng.standard_normal((len(P), 3))
        change = (resting(setting, second, r[None]) - resting(setting, first, r[None]))[0]
        if claim == "start":  # it has stood with the other one's torque
            x, first = np.zeros_like(x), second
            x[2] = change / omega**2
        for _ in range(2):  # the metric is that of where the arm is
            D = first.mass_matrix(r + x[0])
            x *= np.sqrt(level / np.einsum("ai,ab,ij,bj->", x, P, D, x)) if claim == "jump" else 1.0
        q, v = r + x[0], omega * x[1]
        asks = resting(setting, first, r[None])[0] + omega**2 * (K @ x)
        tau = setting.nominal.inertia_times(q, asks) - setting.torque * rng.choice([-1.0, 1.0], 3)
        share = rng.random()
        run = held((first, second), q, v, tau, (share * h, (1.0 - share) * h), D)
        x = A @ x
        x[0], x[1] = run.q - r, run.v / omega
        x[2] += change / omega**2 if claim == "jump" else 0.0
        D = second.mass_matrix(run.q)
        assert (np.abs(x[0]) <= errors).all()
        assert length(D, run.v) <= speed
        # From here on V is at most what it is now, or what the inputs keep it at.
        bound = np.sqrt(np.einsum("ai,ab,ij,bj->", x, P, D, x)) * to_error / errors
        worst = max(worst, float(bound.max()))
    assert 0.5 < worst <= 1.0  # it is an attack
