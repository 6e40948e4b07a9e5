"""Bounds along a path: against sums by hand, other simulations and the worst courses of torque."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lti
from soundness import Course

import armgpi
from armgpi import GPI, Bezier, Encoder, FixedGains, Measurement, Robot, bound_path
from armgpi.certification import stopping
from armgpi.certification.channels import Channel, channel, sampled_loops
from armgpi.certification.path import (
    Along,
    PathBound,
    Rest,
    Wish,
    _Around,
    _at_rest,
    _bits,
    _holds,
    _moments,
    _most,
    _start_error,
    _through,
    _torques,
    _Tube,
    numbers_along,
)
from armgpi.certification.path_page import write_page
from armgpi.certification.quantities import christoffel, slopes
from armgpi.certification.stopping import Retimed, bound_stop
from armgpi.errors import ParameterError
from armgpi.gpi.gains import Tuning, betas
from armgpi.loop.rollout import describe_end
from armgpi.plants.elastic import sag
from armgpi.supervisor.bounds import bounds_of
from armgpi.supervisor.stop import NEAR, Stop

ARM = Robot.load("anthropomorphic3").with_armature(0.1)
GOAL = np.array([0.4, 0.6, -0.1])
PATH = Bezier(GOAL - np.array([0.4, 0.2, -0.3]), GOAL, duration=2.0, t_start=0.2)


def first_norm(law: GPI) -> float:
    found = channel(law, 0, np.ones(3))
    assert found is not None
    return float(found.rest[0, 0])


def test_the_sum_tends_to_the_norm_of_the_continuous_loop() -> None:
    # From a disturbance to the error the continuous loop is s^2 (s + b4) / p(s); its L1 norm by SciPy.
    omega = 12.0
    b = betas(Tuning(np.array(omega), np.array(1.0), np.array(omega)))
    loop = lti([1.0, float(b.beta4), 0.0, 0.0], [1.0, *(float(x) for x in b[::-1])])
    t, response = loop.impulse(T=np.linspace(0.0, 3.0, 30_001))
    exact = float(np.trapezoid(np.abs(response), t))
    found = [first_norm(GPI(ARM, dt, FixedGains(omega))) for dt in (2e-3, 1e-3, 5e-4)]
    errors = np.abs(np.array(found) - exact)
    assert errors[-1] < 0.01 * exact
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 1.0, atol=0.15)  # a held torque is late


@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize(("integrators", "rolloff"), [(1, 1), (2, 0), (3, 2)])
def test_a_channel_is_the_law_on_a_double_integrator(delay: int, integrators: int, rolloff: int) -> None:
    law = GPI(ARM, 1e-3, FixedGains([9.0, 15.0, 20.0]), integrators=integrators, rolloff=rolloff)
    loops = sampled_loops(law, delay)
    rng = np.random.default_rng(0)
    x = np.zeros(loops.asks.shape)
    q, v, past, state = np.zeros(3), np.zeros(3), [np.zeros(3)] * delay, None
    c = law._nominal
    state = law._law.init(np.zeros(3), c)
    for _ in range(200):
        z = rng.standard_normal(3)
        seen = past[-1] if delay else q
        asked = law._law.output(seen, state, c)
        np.testing.assert_allclose(np.einsum("im,im->i", loops.asks, x), asked, rtol=1e-9, atol=1e-12)
        state = law._law.update(seen, asked, None, state, c)
        past = [q, *past][:delay]
        q, v = q + 1e-3 * v + 0.5e-6 * (asked + z), v + 1e-3 * (asked + z)
        x = np.einsum("imk,ik->im", loops.open, x) + (asked + z)[:, None] * loops.push
        np.testing.assert_allclose(x[:, 0], q, rtol=1e-9, atol=1e-15)


def test_a_channel_is_the_sum_of_what_each_sample_does_to_all_later_ones() -> None:
    h, gain = 4e-3, np.array([0.9, 1.0, 1.2])
    law = GPI(ARM, h, FixedGains([9.0, 15.0, 20.0]), integrators=2, rolloff=1)
    loops, found = sampled_loops(law, 2), channel(law, 2, gain)
    assert found is not None
    s, samples = np.linspace(0.0, h, 101), 2000
    apart = []
    for j in range(3):
        push = gain[j] * loops.push
        A = loops.open[j] + np.outer(push, loops.asks[j])
        e, v = np.eye(2, len(A))
        outputs = np.array([e, v, loops.asks[j]])
        inputs = np.array(
            [e, v, loops.measured[j] + push * loops.direct[j], loops.held[j], loops.integrated[j]]
        )
        y, x = np.empty((samples, 3, 5)), inputs.T
        for k in range(samples):
            y[k], x = outputs @ x, A @ x
        # An acceleration that acts s before the end of a sample has moved the error by s and its speed by 1.
        swept = np.trapezoid(np.abs(y[..., :1] * s + y[..., 1:2]), s, axis=-1)
        np.testing.assert_allclose(found.rest[:, j], swept.sum(axis=0), rtol=1e-4)
        np.testing.assert_allclose(found.course[:400, :, j], swept[:400], rtol=1e-2, atol=1e-3 * swept.max())
        sums = np.abs(y).sum(axis=0)
        at_once = [0.0, 0.0, abs(loops.direct[j])]
        for told, exact in (
            (found.measured, sums[:, 2] + at_once), (found.shift, sums[:, 3]), (found.zone, sums[:, 4])
        ):  # fmt: skip
            over = told[:, j] / exact - 1.0  # by what bounds the rest of the series
            assert (over > -1e-9).all()
            assert (over < 0.02).all()
        np.testing.assert_allclose(found.start[:, j], np.abs(y[..., 3]).max(axis=0), rtol=1e-9)
        apart.append((y[:, 2, :2], swept[:, 2]))
    asked, passed = np.array([x for x, _ in apart]), np.cumsum([x for _, x in apart], axis=1)
    last = max(int(np.argmax(x >= 0.99 * x[-1])) for x in passed)
    assert found.memory == pytest.approx(h * (last + 1))
    mean = asked.mean(axis=0)
    alike = np.trapezoid(np.abs(mean[:, :1] * s + mean[:, 1:]), s, axis=-1)
    assert found.shared == pytest.approx(alike[: last + 1].sum(), rel=1e-4)
    rest = np.trapezoid(np.abs((asked - mean)[..., :1] * s + (asked - mean)[..., 1:]), s, axis=-1)
    own = rest[:, : last + 1].sum(axis=1) + passed[:, -1] - passed[:, last]
    np.testing.assert_allclose(found.own, own, rtol=1e-3)


def test_a_tube_is_the_least_that_its_own_disturbances_do_not_leave() -> None:
    rng, n, h = np.random.default_rng(1), 2, 0.01

    def draw(*shape: int) -> Any:
        return 0.05 * rng.uniform(0.2, 1.0, shape)

    shapes = {"square": (n, n, n), **dict.fromkeys(("torque", "spread", "force", "motion"), (n,))}
    rest, answer = (Rest(**{x: draw(*shapes.get(x, (n, n))) for x in Rest._fields}) for _ in range(2))
    channel_of, along_of = (cast(Any, each) for each in (Channel, Along))
    loop = channel_of(*draw(5, 3, n), draw(6, 3, n) / 9.0, 0.7, draw(n), 0.3)
    known = along_of(*draw(1, n), rest, answer, *draw(4, n), draw(n, n), draw(3, n), draw(9, n), loop)
    wish: Any = SimpleNamespace(
        controller=SimpleNamespace(dt=h), delay=2, hidden=draw(n), zone=draw(n), force=3.0
    )
    tube = _Tube(wish, np.ones(n), np.ones(n), known)
    fixed = np.zeros((3, n))
    for i in range(3):
        for j in range(n):
            jerks = [
                sum(loop.course[a, i, j] * known.jerk[k - a, j] for a in range(6) if 0 <= k - a < 9)
                for k in range(15)
            ]
            later = (loop.rest[i, j] - loop.course[:, i, j].sum()) * known.jerk[:, j].max()
            fixed[i, j] = (
                later + max(jerks) + loop.measured[i, j] * wish.hidden[j] + loop.zone[i, j] * wish.zone[j]
            )
            fixed[i, j] += loop.shift[i, j] * known.shift[j] + loop.start[i, j] * known.start[j]
    np.testing.assert_allclose(tube.fixed, fixed, rtol=1e-12)

    def disturbs(x: Rest, old: Any, j: int) -> float:
        error, speed, asked = old[:3]
        seen = 3.0 * h * (known.speed + speed) + wish.hidden
        found = x.torque[j] + 0.5 * x.spread[j] + 4.0 * x.force[j] + x.motion[j]
        for k in range(n):
            found += x.stiffness[j, k] * (3.0 * h * known.speed[k] + error[k]) + x.turning[j, k] * seen[k]
            found += x.mismatch[j, k] * asked[k] + x.rate[j, k] * speed[k]
            found += sum(x.square[j, k, i] * speed[k] * speed[i] for i in range(n))
        return float(found)

    now = np.zeros((4, n))
    for _ in range(60):
        unknown = np.array([disturbs(rest, now, j) for j in range(n)])
        error, speed, asked = loop.rest * unknown + fixed
        most = known.gain * asked + unknown + known.jerk.max(axis=0)
        now = np.array([error + h * speed + 0.5 * h * h * most, speed + h * most, asked, unknown])
    found = tube.solve(0.5, 4.0)
    assert found is not None
    np.testing.assert_allclose(found[:4], now, rtol=1e-5)
    assert (np.array(found[:3]) > now[:3]).all()
    answers = loop.shared * np.array([disturbs(answer, found, j) for j in range(n)])
    answers = answers + known.reach @ (loop.own * found.rest + fixed[2])
    wanted = known.hold + np.minimum(answers, known.reach @ found.asked)
    np.testing.assert_allclose(tube.torques(found, 0.5, 4.0), wanted, rtol=1e-9)
    # Where the law asks for much, and inertia is right, what disturbs is less.
    light, much = answer._replace(mismatch=0.0 * answer.mismatch), found._replace(asked=1e6 * found.asked)
    answers = loop.shared * np.array([disturbs(light, much, j) for j in range(n)])
    answers = answers + known.reach @ (loop.own * found.rest + fixed[2])
    less = _Tube(wish, np.ones(n), np.ones(n), known._replace(answer=light)).torques(much, 0.5, 4.0)
    np.testing.assert_allclose(less, known.hold + answers, rtol=1e-9)
    made, alone = tube.path_bound([]), tube.solve(0.0, 3.0)
    assert alone is not None
    np.testing.assert_allclose(made.error, alone.error + 2.0 * h * known.speed, rtol=1e-9)
    assert made.tool == pytest.approx(np.linalg.norm(known.jacobian @ made.error))
    np.testing.assert_allclose(sum(made.parts.values()), 1.0, atol=0.4)
    assert _most(lambda x: x <= 0.37) == pytest.approx(0.37, rel=1.1e-3)
    assert _most(lambda x: x <= 0.37) <= 0.37
    bears: Any = SimpleNamespace(
        reasons=lambda torque, force=3.0: ["more"] * (torque > 0.2 or not 3.0 <= force <= 3.5)
    )
    made = tube.path_bound([bears])
    assert [made.tolerated_torque, made.tolerated_force] == pytest.approx([0.2, 0.5], rel=2e-3)


def test_what_matrices_make_of_torques_is_added_up_by_size() -> None:
    rng = np.random.default_rng(3)
    left = rng.normal(size=(4, 3, 3))
    torques = {
        name: rng.normal(size=(4, 3, 3)) for name in ("mismatch", "stiffness", "turning", "rate", "force")
    }
    torques |= {"square": rng.normal(size=(4, 3, 3, 3)), "torque": np.array([1.0, 2.0, 3.0])}
    found = _through(left, torques | {"motion": (motion := rng.normal(size=(4, 3)))})
    for k in range(4):
        for name in ("mismatch", "stiffness", "turning", "rate"):
            np.testing.assert_allclose(found[name][k], left[k] @ torques[name][k])
        for c, a in np.ndindex(3, 3):
            np.testing.assert_allclose(found["square"][k][:, c, a], left[k] @ torques["square"][k, c, :, a])
        np.testing.assert_allclose(found["torque"][k], np.abs(left[k]) @ torques["torque"])
        np.testing.assert_allclose(found["spread"][k], np.abs(left[k]) @ np.ones(3))
        forces = [np.linalg.norm(row) for row in left[k] @ torques["force"][k]]
        np.testing.assert_allclose(found["force"][k], forces)
        np.testing.assert_allclose(found["motion"][k], left[k] @ motion[k])


class Spied:
    """An object of which is known what it was asked."""

    def __init__(self, of: Any) -> None:
        self.of, self.asked = of, dict[str, list[Any]]()

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.of, name)

        def answer(*given: Any) -> Any:
            self.asked.setdefault(name, []).append(given)
            return found(*given)

        return answer if callable(found) else found


def slope_of(function: Any, q: Any, step: float = 1e-5) -> Any:
    """By differences: how what a function gives changes with each joint, which comes last."""
    return np.stack(
        [(function(q + x) - function(q - x)) / (2.0 * step) for x in step * np.eye(q.shape[-1])], axis=-1
    )


def times_each(M: Any, x: Any) -> Any:
    return np.einsum("kij,kj->ki", M, x)


def resting(q: Any) -> Any:
    return armgpi.Target(q, 0.0 * q, 0.0 * q)


def at_rest(law: GPI, arm: Robot, q: Any) -> Any:
    """What a law asks for where it holds an arm."""
    missing = arm.gravity(q) - law.ahead(q, resting(q))
    return np.linalg.solve(law.robot.mass_matrix(q), missing[..., None])[..., 0]


def rubs_by_hand(law: GPI, arm: Robot, v: Any, fastest: Any, latest: int) -> Any:
    """How far friction is off at most from what is fed forward up to so many samples before."""
    found, coulomb = np.zeros(3), np.broadcast_to(arm.friction.coulomb, 3)
    for k, back in np.ndindex(len(v), latest + 1):
        if back > k:
            continue
        off = law.add_friction(0.0 * v[k], v[k - back]) - arm.friction.viscous * v[k]
        for j in range(3):
            ways = [np.sign(v[k, j])] if abs(v[k, j]) > fastest[j] + 1e-2 else [-1.0, 1.0]
            found[j] = max(found[j], *(abs(off[j] - coulomb[j] * way) for way in ways))
    return found


def torques_by_hand(law: GPI, arm: Robot, at: Any, gain: Any) -> dict[str, Any]:
    """What disturbs at configurations, by differences: rows of a matrix are joints that it acts on."""
    target, late, q, y, between = at
    v, model = at_rest(law, arm, target.q), law.robot

    def holding(x: Any) -> Any:
        return times_each(model.mass_matrix(x), v) + law.ahead(x, resting(target.q))

    def coriolis(v: Any) -> Any:
        return arm.nonlinear_effects(q, np.broadcast_to(v, q.shape)) - arm.gravity(q)

    one, turning = np.eye(3), slope_of(holding, between)
    rate = [(coriolis(late.v + 1e-4 * u) - coriolis(late.v - 1e-4 * u)) / 2e-4 for u in one]
    pairs = [[0.5 * (coriolis(c + a) - coriolis(c) - coriolis(a)) for a in one] for c in one]
    given = law.ahead(y, target) - law.ahead(y, resting(target.q))
    return {
        "mismatch": model.mass_matrix(y) - arm.mass_matrix(q) * gain,
        "stiffness": turning - slope_of(arm.gravity, between),
        "turning": turning,
        "rate": np.stack(rate, axis=-1) + np.diag(np.broadcast_to(arm.friction.viscous, 3)),
        "square": np.moveaxis(np.array(pairs), (0, 1, 2, 3), (2, 3, 0, 1)),
        "force": slope_of(lambda x: arm.frame_pose(arm.tip, x).translation, q).swapaxes(1, 2),
        "motion": given - coriolis(late.v) - times_each(arm.mass_matrix(q), target.a),
    }


def largest_of(*every: dict[str, Any]) -> dict[str, Any]:
    """The largest sizes, and 3 % more."""
    return {name: 1.03 * np.max([np.abs(x[name]).max(axis=0) for x in every], axis=0) for name in every[0]}


def test_numbers_along_a_path_are_those_of_its_arms_at_configurations_around_it() -> None:
    model = ARM.with_payload(ARM.tip, 0.08, (0.03, -0.02, 0.04)).with_friction([0.2, 0.1, 0.3], 0.1)
    heavy = ARM.with_payload(ARM.tip, 0.15, (-0.04, 0.02, 0.01))
    arms = [
        Spied(ARM.with_friction([0.1, 0.3, 0.2], 0.08)),
        Spied(heavy.with_friction(0.15, [0.05, 0.1, 0.2])),
    ]
    law, plain = (
        GPI(model, 5e-3, FixedGains([12.0, 14.0, 13.0]), feedforward="model", friction_feedforward=rubs)
        for rubs in (True, False)
    )
    controller: Any
    controller, path = (
        Spied(law),
        Spied(Bezier(GOAL - np.array([0.4, -0.3, 0.4]), GOAL, duration=0.8, t_start=0.2)),
    )
    controller.robot, torque = Spied(model), np.array([0.1, 0.2, 0.3])
    hidden, radius, fastest = np.array([[0.02, 0.03, 0.01], [0.1, 0.2, 0.15], [0.3, 0.2, 0.1]])
    told: Any = (controller, tuple(arms), path, 1.2, torque, 2.0, True, hidden, 2, "wrong-load", 3)
    wish = Wish(*told)
    found = numbers_along(wish, radius, fastest)
    every = path.of.at(5e-3 * np.arange(241.0))
    _, (times,), (later,), _, _, *after = path.asked["at"]
    target, late = path.of.at(times), path.of.at(later)
    assert [(later - times).min(), (later - times).max()] == pytest.approx([0.0, 0.015])
    speed = np.abs(every.v).max(axis=0)
    moved = 0.015 * (speed + fastest) + hidden

    def reach(x: Any, size: Any) -> None:  # all around, the corners as well
        np.testing.assert_allclose([x.min(axis=0), x.max(axis=0)], [-size, size])

    around, *seen = [], *(x[0] for x in controller.robot.asked["mass_matrix"])
    for arm, y in zip(arms, seen[:2], strict=True):
        (_, q), (_, between) = arm.asked["frame_jacobian"]
        reach(q - late.q, radius)
        reach(y - q, moved)
        reach(between - target.q, radius + moved)
        around.append((arm.of, np.linalg.inv(arm.of.mass_matrix(q)), (target, late, q, y, between)))
    diagonals = [np.einsum("kij,kji->ki", x, model.mass_matrix(at[3])) for _, x, at in around]
    gain = 0.5 * (np.min(diagonals, axis=(0, 1)) + np.max(diagonals, axis=(0, 1)))
    np.testing.assert_allclose(found.gain, gain)
    rest, answer, rows = list[Any](), list[Any](), list[Any]()
    assert found.loop is not None
    for (arm, inverse, at), (at_last,), where in zip(around, after, seen[2:], strict=True):
        waited = (at_last - times)[at_last < 1.2]
        assert 0.0 <= waited.min() < 0.1 * found.loop.memory
        assert 0.9 * found.loop.memory < waited.max() <= found.loop.memory < 1.0
        assert at_last.max() == 1.2
        reach(where - path.of.at(at_last).q, radius + hidden)
        acts = torques_by_hand(plain, arm, at, gain)
        size = torque + rubs_by_hand(law, arm, every.v, fastest, 3)
        for kept, left in ((rest, inverse), (answer, model.mass_matrix(where) @ inverse)):
            made = {name: left @ acts[name] for name in ("mismatch", "stiffness", "turning", "rate")}
            made["square"] = np.einsum("kij,kjca->kica", left, acts["square"])
            made["force"] = np.linalg.norm(left @ acts["force"], axis=2)
            made |= {"motion": times_each(left, acts["motion"]), "spread": np.abs(left).sum(axis=2)}
            kept.append(made | {"torque": np.abs(left) @ size})
        _, _, _, y, between = at
        v = at_rest(plain, arm, target.q)
        rows.append(
            {
                "shift": at_rest(plain, arm, path.of.at(times + 5e-3).q) - v,
                "hold": times_each(model.mass_matrix(y), v) + law.ahead(y, target),
                "reach": model.mass_matrix(y),
                "jacobian": slope_of(lambda x, arm=arm: arm.frame_pose(arm.tip, x).translation, between),
            }
        )
    jerk = [
        np.max([np.abs(every.a[min(k + i, 240)] - every.a[k]) for i in (1, 2, 3)], axis=0) for k in range(241)
    ]
    wanted = largest_of(*rows) | {"jerk": 1.03 * np.array(jerk)}
    for of, by_hand in (
        (found, wanted),
        (found.rest, largest_of(*rest)),
        (found.answer, largest_of(*answer)),
    ):
        for name, x in by_hand.items():
            size = 1e-6 * np.abs(x).max()
            np.testing.assert_allclose(getattr(of, name), x, rtol=1e-5, atol=size, err_msg=name)
    np.testing.assert_allclose(found.speed, speed)
    begun = target.q[:1]
    off = np.max(
        [np.abs(at_rest(plain, arm.of, begun) - at_rest(plain, model, begun))[0] for arm in arms], axis=0
    )
    assert (found.start >= 1.03 * off).all()
    assert not numbers_along(wish._replace(start="held"), radius, fastest).start.any()


def errors(made: PathBound, course: Any, arm: Robot, bits: int | None = None) -> Any:
    """Return the errors of a run under torques, (samples, n), and the torques asked for."""
    wish = made.wish
    friction = "urdf" if wish.friction else None
    loads = [Course(course, wish.controller.dt)]
    plant: Any = armgpi.RigidBodyPlant(arm, loads=loads, friction=friction)
    plant = plant if bits is None else Encoder(plant, bits)
    plant = armgpi.Delayed(plant, wish.delay) if wish.delay else plant
    run = armgpi.simulate(plant, wish.controller, wish.reference, wish.t_final, progress=False)
    return run["q"].values - run["q_ref"].values, run["tau"].values


@settings(max_examples=2)
@given(
    st.integers(0, 10**6),
    st.sampled_from(["none", "gravity", "model", "computed"]),
    st.integers(0, 2),
    st.sampled_from([None, 14]),
)
def test_no_run_leaves_the_tube(seed: int, feedforward: str, delay: int, bits: int | None) -> None:
    rng = np.random.default_rng(seed)
    com = tuple(rng.normal(size=3) * 0.05)
    heavy = ARM.with_payload(ARM.tip, 0.05, com).with_friction(0.05, 0.03)
    law = GPI(ARM, 1e-3, FixedGains(rng.uniform(10.0, 22.0, 3)), feedforward=feedforward, delay=delay * 1e-3)
    torque = rng.uniform(0.0, 0.15, 3)
    made = bound_path(
        law, PATH, 2.6, arms=[ARM.with_friction(0.05, 0.03), heavy], torque=torque, friction=True, bits=bits
    )
    if not made.holds:
        return
    turns = rng.uniform(2.0, 40.0, 3) * np.arange(2600)[:, None] * 1e-3
    e, tau = errors(made, torque * np.sign(np.sin(turns)), heavy, bits)
    assert (np.abs(e) <= made.error).all()
    assert (np.abs(tau) <= made.torque).all()


def test_the_worst_course_comes_near_and_the_tool_stays_within() -> None:
    law = GPI(ARM, 1e-3, FixedGains(20.0), feedforward="model")
    made = bound_path(law, PATH, 2.6, torque=0.2)
    at, found = 1500, np.zeros(3)
    loops, inverse = sampled_loops(law, 0), np.linalg.inv(ARM.mass_matrix(PATH.at(1.5).q))
    x = loops.push[None, :, None] * inverse[:, None, :]
    seen = np.empty((at, 3, 3))
    for k in range(at):
        seen[k] = x[:, 0]
        asked = np.einsum("im,imj->ij", loops.asks, x)
        x = loops.open @ x + loops.push[None, :, None] * asked[:, None, :]
    for joint in range(3):
        course = 0.2 * np.sign(seen[::-1, joint])
        e, _ = errors(made, np.concatenate([course, np.zeros((1100, 3))]), ARM)
        found = np.maximum(found, np.abs(e).max(axis=0))
        tip = ARM.frame_pose(ARM.tip, PATH.at(1e-3 * np.arange(len(e))).q + e).translation
        meant = ARM.frame_pose(ARM.tip, PATH.at(1e-3 * np.arange(len(e))).q).translation
        assert np.linalg.norm(tip - meant, axis=1).max() <= made.tool
    assert (found <= made.error).all()
    assert (made.error <= 4.0 * found).all()


def test_what_it_bears_is_borne() -> None:
    law = GPI(ARM, 1e-3, FixedGains(20.0), feedforward="model")
    made = bound_path(law, PATH, 2.6, torque=0.1)
    assert bound_path(law, PATH, 2.6, torque=0.1 + 0.9 * made.tolerated_torque).holds
    assert bound_path(law, PATH, 2.6, torque=0.1, force=0.9 * made.tolerated_force).holds


def test_bounds_grow_with_what_is_stated() -> None:
    law = GPI(ARM, 1e-3, FixedGains(20.0))
    least = bound_path(law, PATH, 2.6)
    for more in ({"torque": 0.1}, {"force": 0.2}, {"bits": 14}, {"delay": 1}):
        assert (bound_path(law, PATH, 2.6, **more).error > least.error).all()
    loads = [ARM, ARM.with_payload(ARM.tip, 0.05)]
    assert (bound_path(law, PATH, 2.6, arms=loads).error > least.error).all()
    resting = GPI(ARM, 1e-3, FixedGains(20.0), rest_dead_zone=1e-4)
    assert (bound_path(resting, PATH, 2.6).error > least.error).all()


def test_an_arm_that_is_far_from_its_model_has_no_bound_and_the_reason_says_why() -> None:
    made = bound_path(GPI(ARM, 1e-3), PATH, 2.6, arms=ARM.scaled_inertia(8.0))
    assert not made.holds
    assert np.isnan(made.error).all()
    assert "No bound" in str(made)


class Given(armgpi.Reference):
    """A reference from functions of time."""

    def __init__(self, *parts: Any) -> None:
        self.parts = parts

    def at(self, t: Any) -> armgpi.Target:
        t = np.asarray(t, dtype=float)[..., None] + np.zeros(len(GOAL))
        return armgpi.Target(*(part(t) for part in self.parts))


def nothing(t: Any) -> Any:
    return 0.0 * t


JUMP = Given(lambda t: GOAL + 0.1 * (t > 0.5), nothing, nothing)
RAMP = Given(lambda t: GOAL + 0.1 * np.maximum(t - 0.5, 0.0), lambda t: 0.1 * (t > 0.5), nothing)
LAW = GPI(ARM, 1e-3, FixedGains(20.0))


@pytest.mark.parametrize(
    ("law", "path", "options", "says"),
    [
        (LAW, Bezier(GOAL - 0.3, GOAL, duration=1.0, t_start=-0.5), {}, "at rest"),
        (LAW, Bezier(GOAL - 0.3, GOAL, duration=0.01), {}, "at rest"),  # until the next sample
        (LAW, JUMP, {}, "jumps"),
        (LAW, RAMP, {}, "jump"),
        (LAW, Bezier(np.zeros(2), np.ones(2), duration=1.0), {}, "3 joints"),
        (LAW, PATH, {"t_final": 1e-3}, "t_final"),
        (LAW, PATH, {"bits": 12.5}, "bits"),
        (LAW, PATH, {"arms": 5}, "arms"),
        (LAW, PATH, {"arms": ()}, "arms"),
        (LAW, PATH, {"torque": -1.0}, "torque"),
        (LAW, PATH, {"friction": 0.2}, "friction"),
        (GPI(ARM, 1e-3, FixedGains(20.0), start="zero"), PATH, {}, "hold"),
        (GPI(ARM, 1e-3, FixedGains(20.0), rest_leak=50.0), PATH, {}, "rest_leak"),
        (GPI(ARM, 1e-3, armgpi.BSplineNetwork()), PATH, {}, "FixedGains"),
        (GPI(ARM, 1e-3, payload=(0.0, 0.02)), PATH, {}, "heaviest"),
        (GPI(ARM, 1e-3, payload=(0.0, 0.02), rotor_factor=1.1), PATH, {}, "heaviest"),
    ],
)
def test_what_it_does_not_cover_is_refused(law: GPI, path: Any, options: Any, says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        bound_path(law, path, **{"t_final": 2.0, **options})


def test_friction_that_is_fed_forward_to_an_arm_without_it_disturbs() -> None:
    rough = ARM.with_friction(0.1, 0.05)
    law = GPI(rough, 1e-3, FixedGains(20.0), feedforward="model", friction_feedforward=True)
    made = bound_path(law, PATH, 2.6, arms=ARM)
    e, tau = errors(made, np.zeros((2600, 3)), ARM)
    assert (np.abs(e) <= made.error).all()
    assert (np.abs(e).max(axis=0) > 0.05 * made.error).all()
    assert (np.abs(tau) <= made.torque).all()


def test_what_grows_with_the_speed_of_the_error_is_the_slope_of_the_arms_torque() -> None:
    rough = ARM.with_friction([0.3, 0.2, 0.1], 0.0)
    wish = bound_path(GPI(ARM, 1e-3, FixedGains(20.0)), PATH, 2.6, arms=rough, friction=True).wish
    at = wish.reference.at(np.array([0.8]))
    slope = slopes(rough.mass_matrix, at.q)
    around = _Around(at, at, at.q, at.q, at.q, at.v, christoffel(slope, at.v[:, None])[:, 0])
    found = _torques(wish, rough, around, slope, wish.reference.at(wish.samples), np.zeros(3))["rate"][0]

    def torque(v: Any) -> Any:
        return rough.nonlinear_effects(at.q[0], v) + rough.friction.viscous * v

    steps = 1e-4 * np.eye(3)
    columns = [(torque(at.v[0] + step) - torque(at.v[0] - step)) / 2e-4 for step in steps]
    np.testing.assert_allclose(found, np.transpose(columns), rtol=1e-6, atol=1e-9)


def test_what_holds_the_arm_is_asked_for_wherever_in_a_count_it_is_measured() -> None:
    law, nearly = GPI(ARM, 1e-3, FixedGains(20.0)), np.full(3, 1e-9)
    wish = bound_path(law, PATH, 2.6, bits=4).wish._replace(reference=armgpi.Hold(GOAL))
    known, v = numbers_along(wish, nearly, nearly), _holds(wish, ARM, GOAL[None])
    measured = GOAL + np.random.default_rng(0).uniform(-wish.hidden, wish.hidden, (200, 3))
    most = np.abs(ARM.inertia_times(measured, np.repeat(v, 200, axis=0))).max(axis=0)
    assert (most <= known.hold).all()
    assert (known.hold < 1.5 * most).all()


def test_an_acceleration_that_jumps_is_seen_though_it_lasts_a_moment() -> None:
    # Up and down within 20 ms of 20 s, fed forward a sample late.
    size, begin, half = 2.0, 10.0, 0.01

    def acceleration(t: Any) -> Any:
        return size * ((t >= begin) & (t < begin + half)) - size * (
            (t >= begin + half) & (t < begin + 2 * half)
        )

    def speed(t: Any) -> Any:
        return size * np.clip(half - np.abs(t - begin - half), 0.0, half)

    def way(t: Any) -> Any:
        up, down = np.clip(t - begin, 0.0, half), np.clip(t - begin - half, 0.0, half)
        return GOAL + size * (0.5 * up**2 + half * down - 0.5 * down**2)

    law = GPI(ARM, 1e-3, FixedGains(20.0), feedforward="model", delay=2e-3)
    made = bound_path(law, Given(way, speed, acceleration), 20.0)
    e, _ = errors(made, np.zeros((20_000, 3)), ARM)
    assert made.holds
    assert (np.abs(e) <= made.error).all()


def test_the_command_prints_it_and_writes_page_and_file(cli: Any, tmp_path: Path) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(
        "robot: {name: anthropomorphic3, rotor_inertia: 0.1}\n"
        "controllers: [{type: gpi, omega: 20, feedforward: model}]\n"
        "reference: {points: [[0, 0.4, -0.4], [0.4, 0.6, -0.1]], durations: 2}\n"
    )
    out, page = tmp_path / "bound.json", tmp_path / "bound.html"
    answer = cli("bound", file, "--torque", "0.1", "--tool-speed", "0.1", "--out", out, "--report", page)
    assert answer.code == 0, answer.err
    assert answer.out.startswith("The tool stays within")
    assert '"holds": true' in out.read_text()
    assert "class=good" in page.read_text()
    for line in answer.out.splitlines()[-3:]:  # the stop, the gears, and what they let the tool sink
        assert f"<p>{line.strip()}</p>" in page.read_text()
    assert "the supervisor stops the tool" in answer.out
    arm = armgpi.assume_drives(ARM, "elastic")
    assert f"{sag(arm)} (stiffness assumed)" in answer.out
    file.write_text(f"{file.read_text()}plant: {{gear_stiffness: 1e4, engine: elastic}}\n")
    refused = cli("bound", file)
    assert refused.code == 2
    assert "stiff joints with encoders" in refused.err


@pytest.mark.parametrize(
    ("key", "entry"),
    [
        ("loads", "{type: step, amplitude: 1.0}"),
        ("environment", "{type: force, force: [0, 20, 0]}"),
        ("environment", "{type: wall, normal: [0, 0, 1], distance: -2.0, stiffness: 1.0e4}"),
    ],
)
def test_what_pushes_the_plant_is_refused_as_no_bound_knows_it(
    cli: Any, tmp_path: Path, key: str, entry: str
) -> None:
    file = tmp_path / "pushed.yaml"
    file.write_text(
        "robot: {name: anthropomorphic3, rotor_inertia: 0.1}\n"
        f"plant: {{{key}: [{entry}]}}\n"
        "controllers: [{type: gpi, omega: 20, feedforward: model}]\n"
        "reference: {points: [[0, 0.4, -0.4], [0.4, 0.6, -0.1]], durations: 2}\n"
    )
    for command, options in (("bound", "--torque and --force"), ("certify", "--torque")):
        refused = cli(command, file)
        assert refused.code == 2
        (line,) = refused.err.splitlines()
        assert f"plant.{key}: disturbances of a bound are given by {options}; remove this key" in line


def test_a_page_shows_the_errors_of_its_run() -> None:
    made = bound_path(LAW, PATH, 2.6)
    run = armgpi.simulate(armgpi.RigidBodyPlant(ARM), LAW, PATH, 2.6, progress=False)
    told = re.findall(r"in this run ([\d.e-]+)</figcaption>", write_page(made, run))
    e, _ = errors(made, np.zeros((2600, 3)), ARM)
    assert told == [f"{x:.3g}" for x in np.abs(e).max(axis=0)]


def test_a_law_for_gears_that_twist_is_bounded_on_a_rigid_arm(cli: Any) -> None:
    words = ("anthropomorphic3", "--controller", "gpi_auto", "--rotor-inertia", "0.1", "--torque", "0.1")
    lowest = []
    for drives in ((), ("--drives", "stiff")):
        answer = cli("bound", *words, *drives)
        assert answer.code == 0, answer.err
        lowest.append(float(re.findall(r"below ([\d.]+) Hz", answer.out)[0]))
    assert lowest[0] < 0.5 * lowest[1]  # what the slow law is for


@pytest.mark.parametrize("payload", ["1", "2:1", "-1:1", "0:nan", "0:inf"])
def test_loads_that_are_no_range_are_refused(cli: Any, payload: str) -> None:
    answer = cli("bound", "anthropomorphic3", f"--payload={payload}")
    assert (answer.code, "the lighter first" in answer.err) == (2, True)


class Leaping(armgpi.Reference):
    """A reference that is sent far away at a time."""

    def __init__(self, path: Any, begin: float) -> None:
        self.path, self.begin = path, begin

    def at(self, t: Any) -> armgpi.Target:
        q, v, a = self.path.at(t)
        return armgpi.Target(q + 1.0 * (np.asarray(t)[..., None] > self.begin + 5e-4), v, a)


def test_a_stop_of_the_supervisor_ends_within_its_way_and_error() -> None:
    law = GPI(ARM, 1e-3, FixedGains(20.0), feedforward="model")
    made = bound_path(law, PATH, 2.6, torque=0.1)
    stop = bound_stop(made, 0.25)
    assert not stop.reasons
    q, v, _ = PATH.at(np.linspace(0.2, 2.2, 400))
    speeds = np.linalg.norm(np.einsum("kij,kj->ki", ARM.frame_jacobian(ARM.tip, q)[:, :3], v), axis=1)
    path = Retimed(PATH, 0.25 / speeds.max(), 2e-3)
    begin = round(2e-3 + 1.2 / path.pace, 3)
    course = 0.1 * np.sign(np.sin(30.0 * np.arange(3000) * 1e-3))[:, None] * np.ones(3)
    plant = armgpi.RigidBodyPlant(ARM, loads=[Course(course, 1e-3)])
    supervisor = armgpi.Supervisor()
    run = armgpi.simulate(
        plant, law, Leaping(path, begin), begin + 0.5, supervisor=supervisor, progress=False
    )
    assert "REFERENCE" in describe_end(run)[0]
    tip = ARM.frame_pose(ARM.tip, run["q"].values).translation
    meant = ARM.frame_pose(ARM.tip, path.at(begin).q).translation
    away = np.linalg.norm(tip - meant, axis=1)[round(begin / 1e-3) :]
    assert 0.3 * stop.distance < away.max() <= stop.distance + stop.error
    rest = run["q"].values[round((begin + stop.time) / 1e-3) + 2 :]
    assert (np.abs(rest - rest[-1]) <= 2.0 * made.error).all()


class Turning(armgpi.Reference):
    """Joints that turn from the first moment on."""

    def at(self, t: Any) -> armgpi.Target:
        t = np.asarray(t, float)[..., None] + np.array([0.3, 0.1, -0.2])
        return armgpi.Target(np.sin(t), np.cos(t), -np.sin(t))


def test_a_path_is_retimed_after_its_rest_and_stopped_after_its_moment() -> None:
    times, rng = np.array([0.0, 0.2, 0.4, 0.402, 1.9, 1.904, 1.906, 2.5]), np.random.default_rng(0)
    path = Retimed(Turning(), 0.5, 0.4)
    stop = armgpi.Target(*rng.normal(size=(3, 3, 3)))
    found, stopped = path.at(times), stopping.Stopped(path, 1.9, 2e-3, stop).at(times)
    for k, t in enumerate(times):
        q, v, a = Turning().at(0.5 * max(0.0, t - 0.4))
        wanted = armgpi.Target(q, 0.5 * v * (t > 0.4), 0.25 * a * (t > 0.4))
        after = round((t - 1.9) / 2e-3)
        for each, part, own, end in zip(found, wanted, stopped, stop, strict=True):
            np.testing.assert_allclose(each[k], part, atol=1e-15)
            np.testing.assert_allclose(own[k], end[min(after, 2)] if after > 0 else part, atol=1e-15)


def test_stops_are_those_of_each_joint_sample_by_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    h, most = 2e-3, np.array([1e-3, 2e-3, 4e-3])
    stop: Any = SimpleNamespace(bounds=SimpleNamespace(stop_velocity=most))
    stop.deceleration = lambda v, k: 1e-5 * (1.0 + k) * np.array([1.0, 2.0, 3.0]) + 0.0 * v
    q, v = np.random.default_rng(1).normal(size=(2, 4, 3))
    found = stopping.stops(stop, h, q, v)
    for i, j in np.ndindex(4, 3):
        way, speed = q[i, j], max(-most[j], min(most[j], h * v[i, j]))
        for k in range(len(found.q)):
            got = [x[k, i, j] for x in found[:2]]
            np.testing.assert_allclose(got, [way, speed / h], rtol=1e-12, atol=1e-15)
            slows = max(-1e-5 * (1.0 + k) * (j + 1.0), min(1e-5 * (1.0 + k) * (j + 1.0), speed))
            way, speed = way + speed - 0.5 * slows, speed - slows
            if k + 2 < len(found.q):
                np.testing.assert_allclose(found.a[k + 1, i, j], -slows / h**2, rtol=1e-9, atol=1e-12)
    moving = (found.v != 0.0).any(axis=(1, 2))
    assert moving[:-2].all()
    assert not moving[-2:].any()
    assert not found.a[[0, -1]].any()
    monkeypatch.setattr(stopping, "_LONGEST", 5)
    assert len(stopping.stops(stop, h, q, v).q) == 6


@pytest.mark.parametrize("error", [NEAR, NEAR + 1e-9])
def test_a_stop_is_bounded_from_its_longest_way_and_moments_between(
    error: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def bound(wish: Any, bears: bool) -> Any:
        asked.append(wish)
        return SimpleNamespace(error=np.full(3, error), tool=np.array([1e-3 * len(asked)]), reasons=())

    monkeypatch.setattr(stopping, "bound_wish", bound)
    law, samples = GPI(ARM, 1e-3, FixedGains(20.0)), 1e-3 * np.arange(2600.0)
    wish = cast(Any, SimpleNamespace(controller=law, arms=(ARM,), reference=PATH, delay=2, samples=samples))
    wish._replace = lambda **new: SimpleNamespace(**new)
    found = bound_stop(cast(Any, SimpleNamespace(wish=wish)), 0.25)

    def speed(q: Any, v: Any) -> Any:
        return np.linalg.norm((ARM.frame_jacobian(ARM.tip, q)[:, :3] @ v[..., None])[..., 0], axis=1)

    fast = speed(*PATH.at(samples)[:2])
    pace = 0.25 / fast.max()
    moving = samples[fast > 0.01 * fast.max()] / pace + 4e-3
    stop = Stop(law, armgpi.Supervisor(), bounds_of(law, armgpi.Supervisor()))
    begins = [each.reference.begin for each in asked]
    path, every = (
        asked[0].reference.path,
        stopping.stops(stop, 1e-3, *Retimed(PATH, pace, 4e-3).at(moving)[:2]),
    )
    assert (path.path, path.pace, path.rest) == (PATH, pytest.approx(pace), pytest.approx(4e-3))
    ways = sum(1e-3 * speed(q, v) for q, v in zip(every.q, every.v, strict=True))
    assert found.distance == pytest.approx(ways.max(), rel=0.02)
    assert found.time == pytest.approx(1e-3 * (len(every.q) - 1), abs=2e-3)
    assert len(begins) == 4
    np.testing.assert_allclose(np.quantile(begins, [0.0, 1.0]), np.quantile(moving, [0.25, 0.75]), atol=0.01)
    assert min(abs(np.array(begins) - moving[ways.argmax()])) < 0.05
    for each in asked:
        assert each.t_final == pytest.approx(each.reference.begin + found.time + 0.3)
        np.testing.assert_allclose(each.reference.stop.q[0], path.at(each.reference.begin).q, atol=1e-12)
    assert (found.error, bool(found.reasons)) == (4e-3, error > NEAR)
    wish.reference = armgpi.Hold(GOAL)
    with pytest.raises(ParameterError, match="a tool at rest"):
        bound_stop(cast(Any, SimpleNamespace(wish=wish)), 0.25)


@pytest.mark.parametrize("delay", [0, 3])
def test_a_path_that_is_stopped_rests_until_what_was_late_is_seen(
    delay: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Seen(Exception):
        """What a retimed path is made of."""

    def retimed(*parts: Any) -> None:
        raise Seen(*parts)

    monkeypatch.setattr(stopping, "Retimed", retimed)
    wish: Any = SimpleNamespace(controller=LAW, arms=(ARM,), reference=PATH, delay=delay)
    wish.samples = 1e-3 * np.arange(2600.0)
    with pytest.raises(Seen) as seen:
        bound_stop(cast(Any, SimpleNamespace(wish=wish)), 0.25)
    q, v, _ = PATH.at(wish.samples)
    speed = np.linalg.norm(np.einsum("kij,kj->ki", ARM.frame_jacobian(ARM.tip, q)[:, :3], v), axis=1).max()
    assert seen.value.args == (PATH, pytest.approx(0.25 / speed), pytest.approx((delay + 2) * 1e-3))


def test_the_first_torque_is_off_by_no_more_than_it_changes_anywhere_in_a_count() -> None:
    law, rng = GPI(ARM, 1e-3, FixedGains(12.0)), np.random.default_rng(0)
    wish: Any = SimpleNamespace(hidden=np.full(3, 0.4), controller=law)

    def first(q: Any) -> Any:
        return -law.init(Measurement(q), _at_rest(q[:1])).law.lam

    for start in rng.uniform(
        -1.5, 1.5, (30, 1, 3)
    ):  # at some of these gravity is the largest: its slope is 0
        at: Any = SimpleNamespace(target=SimpleNamespace(q=start), v=first(start))
        changed = np.abs(first(start + rng.uniform(-0.2, 0.2, (40, 3))) - first(start)).max(axis=0)
        assert (changed <= _start_error(wish, at, rng)[0] + 1e-9).all()
        wish.hidden, before = np.zeros(3), wish.hidden  # then it is off by what the load makes of it alone
        np.testing.assert_allclose(_start_error(wish, at, rng), np.zeros((1, 3)), atol=1e-12)
        at.v = at.v + np.array([[0.1, -0.2, 0.3]])
        np.testing.assert_allclose(_start_error(wish, at, rng), [[0.1, 0.2, 0.3]], atol=1e-12)
        wish.hidden = before


@pytest.mark.parametrize("delay", [0, 1, 9])
def test_moments_are_those_of_a_path_that_is_shorter_than_the_lateness_too(delay: int) -> None:
    rng = np.random.default_rng(delay)
    path, samples = rng.normal(size=(3, 4, 2)), np.arange(4.0)
    every: Any = SimpleNamespace(v=path[1], a=path[2])
    times, shares = _moments(SimpleNamespace(delay=delay, samples=samples), every, rng)
    assert times.shape == shares.shape == (400,)
    assert set(np.abs(path[1:]).argmax(axis=1).ravel()) <= set(times) <= set(samples)


def test_encoders_have_up_to_52_bits() -> None:
    for most in (1, 52):
        np.testing.assert_array_equal(_bits(most, ARM), [most] * 3)
    for wrong in (0, 53, 12.5):
        with pytest.raises(ParameterError, match="1 to 52"):
            _bits(wrong, ARM)
