"""The numbers of an arm against its own equations: nothing that is drawn may exceed them."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import sqrtm
from scipy.optimize import minimize
from strategies import robots

import armgpi
from armgpi.base.arrays import Array
from armgpi.certification import quantities, request
from armgpi.certification.box import box_of
from armgpi.certification.quantities import (
    Points,
    Setting,
    functions,
    largest,
    motion,
    points,
    search_numbers,
    slopes,
)
from armgpi.certification.request import ask
from armgpi.gpi.family import Member
from armgpi.gpi.payload import certified_sector, largest_payload, payload_range


def setting(speed: float = 0.5) -> Setting:
    arm = armgpi.Robot.load("anthropomorphic3")
    nominal = arm.with_payload(arm.tip, 0.25)
    return Setting(
        (arm, nominal), nominal, nominal, -np.ones(3), np.ones(3), np.full(3, 0.02), np.full(3, speed), "none"
    )


def test_no_motion_exceeds_the_numbers() -> None:
    given = setting()
    numbers = search_numbers(given)
    rng = np.random.default_rng(3)
    arm, nominal = given.arms
    for _ in range(200):
        q, v = rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.5, 0.5, 3)
        D = arm.mass_matrix(q)
        root = np.linalg.inv(np.linalg.cholesky(D))
        # The rate of the metric along the motion, by differences.
        rate = (arm.mass_matrix(q + 1e-6 * v) - arm.mass_matrix(q - 1e-6 * v)) / 2e-6
        assert np.abs(np.linalg.eigvalsh(root @ rate @ root.T)).max() <= numbers.sigma.value
        # Coriolis torques by inverse dynamics: at most kappa_v in the metric.
        coriolis = arm.nonlinear_effects(q, v) - arm.gravity(q)
        assert np.linalg.norm(root @ coriolis) <= numbers.kappa_v.value * np.sqrt(v @ D @ v) + 1e-12
        # The torque that is missing at q when the law holds the arm at q*: at most kappa_e times the error.
        star = q + rng.uniform(-0.02, 0.02, 3)
        missing = arm.gravity(q) - nominal.inertia_times(q, nominal.inertia_solve(star, arm.gravity(star)))
        e = q - star
        assert np.linalg.norm(root @ missing) <= numbers.kappa_e.value * np.sqrt(e @ D @ e)
        delta = np.linalg.eigvals(np.linalg.solve(D, nominal.mass_matrix(q))).real
        assert numbers.delta_low.value <= delta.min() + 1e-9
        assert delta.max() <= numbers.delta_high.value
        assert (np.diagonal(np.linalg.inv(D)) <= [each.value for each in numbers.inverse]).all()


@settings(max_examples=10)
@given(robots(min_joints=2, max_joints=5), st.integers(0, 2**32 - 1))
@example(armgpi.Robot.load("anthropomorphic3"), 5)  # a climb from every axis ends 13 % below
def test_no_speed_of_the_error_does_more_than_its_bound_and_some_comes_near(
    robot: armgpi.Robot, seed: int
) -> None:
    """At one configuration, against a climb over velocities from 6 starts."""
    rng, rest = np.random.default_rng(seed), np.zeros(robot.n)
    q = rng.uniform(-1.5, 1.5, robot.n)
    D = robot.mass_matrix(q)
    root = np.linalg.inv(np.linalg.cholesky(D))
    gradient = slopes(robot.mass_matrix, q[None])[0]

    def grows(v: Array) -> float:
        rate = np.tensordot(v, gradient, axes=1)
        return float(np.abs(np.linalg.eigvalsh(root @ rate @ root.T)).max() / np.sqrt(v @ D @ v))

    def turns(v: Array) -> float:
        return float(np.linalg.norm(root @ robot.nonlinear_effects(q, v) - root @ held) / (v @ D @ v))

    case = Setting((robot,), robot, robot, q, q, rest, rest + 1.0, "none")
    at, held = Points(q[None], q[None], q[None]), robot.gravity(q)
    for name, value in (("sigma_error", grows), ("kappa_error", turns)):
        (bound,) = functions(case)[name](case, robot, at)
        starts = root.T @ rng.standard_normal((robot.n, 6))
        found = max(-minimize(lambda v, f=value: -f(v), v, method="BFGS").fun for v in starts.T)
        rounding = 1e-9 * (1.0 + bound)
        assert found <= bound + rounding
        assert bound <= 1.25 * found + rounding


def test_speed_scales_what_depends_on_it() -> None:
    slow, fast = search_numbers(setting(0.2)), search_numbers(setting(0.4))
    assert fast.sigma.value == pytest.approx(2.0 * slow.sigma.value, rel=1e-9)
    assert fast.kappa_v.value == pytest.approx(2.0 * slow.kappa_v.value, rel=1e-9)
    assert fast.kappa_e == slow.kappa_e


def test_a_search_comes_to_each_end_of_its_box_and_no_further() -> None:
    # A box on neither side of zero: coordinates are largest and smallest at its ends, by hand.
    lower, upper, radius = np.array([-0.3, 0.2, -1.4]), np.array([1.1, 0.7, -0.5]), np.array([0.1, 0.02, 0.3])
    case = setting()._replace(lower=lower, upper=upper, radius=radius)
    for j, sign in itertools.product(range(3), (1.0, -1.0)):

        def along(_: Setting, arm: armgpi.Robot, at: Points, j: int = j, sign: float = sign) -> Array:
            return sign * at.star[:, j]

        def away(_: Setting, arm: armgpi.Robot, at: Points, j: int = j, sign: float = sign) -> Array:
            return sign * (at.q - at.star)[:, j]

        end = upper[j] if sign > 0.0 else -lower[j]
        assert largest(case, along) == pytest.approx(end, abs=1e-15)
        assert largest(case, away) == pytest.approx(radius[j], abs=1e-15)


def test_stiffness_and_jump_are_those_of_differences_at_a_configuration() -> None:
    case, q = setting(), np.array([0.3, -0.7, 0.5])
    light, heavy = case.arms
    at, nominal = Points(q[None], q[None], q[None]), case.nominal
    for arm in case.arms:
        D = arm.mass_matrix(q)
        root = np.linalg.inv(np.linalg.cholesky(D))
        v = np.linalg.solve(nominal.mass_matrix(q), arm.gravity(q))
        ends = [
            [arm.gravity(x) - nominal.mass_matrix(x) @ v for x in (q + h, q - h)] for h in 1e-5 * np.eye(3)
        ]
        gradient = np.column_stack([(after - before) / 2e-5 for after, before in ends])
        (found,) = functions(case)["kappa_e"](case, arm, at)
        assert found == pytest.approx(np.linalg.norm(root @ gradient @ root.T, 2), rel=1e-6)
        change = np.linalg.solve(nominal.mass_matrix(q), heavy.gravity(q) - light.gravity(q))
        (found,) = functions(case)["jump"](case, arm, at)
        assert found == pytest.approx(np.sqrt(change @ D @ change), rel=1e-9)


@pytest.mark.parametrize("feedforward", ["none", "gravity"])
@pytest.mark.parametrize("hull", [False, True])
def test_every_number_at_a_point_is_what_its_words_say_in_the_metric_of_the_arm(
    feedforward: str, hull: bool
) -> None:
    """By roots of matrices, differences and all corners; star, arm and gradient at three places."""
    arm = armgpi.Robot.load("anthropomorphic3").with_armature([0.02, 0.01, 0.03])
    heavy, known = arm.with_payload(arm.tip, 0.25, [0.1, 0.0, 0.05]), arm.with_payload(arm.tip, 0.1)
    arms = (arm, arm.with_payload(arm.tip, 0.4), heavy) if hull else (arm, heavy)
    rng, zero = np.random.default_rng(2), np.zeros(3)
    sizes = dict(zip(quantities.Setting._fields[8:], rng.uniform(0.1, 1.0, (7, 3)), strict=True))
    case = Setting(arms, heavy, known, zero, zero, zero, np.array([0.5, 0.2, 0.9]), feedforward, **sizes)
    star, q, between = rng.uniform(-1.2, 1.2, (3, 3))
    at, signs = Points(star[None], q[None], between[None]), [*itertools.product((1.0, -1.0), repeat=3)]
    every = functions(case)
    assert {*every} == {
        *("-delta_low", "delta_high", "sigma", "kappa_v", "kappa_e", "kappa_g", "sigma_error", "kappa_error"),
        *(f"{name}.{j}" for name in ("inverse", "hold", "reach") for j in range(3)),
        *("jump", "kappa_f", "torque", "friction", "velocity", "acceleration", "encoder", "zone", "shift"),
    }

    def slope(function: Any, x: Array) -> Array:  # derivatives along the last axis
        return np.stack([(function(x + h) - function(x - h)) / 2e-5 for h in 1e-5 * np.eye(3)], axis=-1)

    def acceleration_to_hold(each: armgpi.Robot, x: Array) -> Array:
        ahead = 0.0 if feedforward == "none" else known.gravity(x)
        return np.asarray(np.linalg.solve(heavy.mass_matrix(x), each.gravity(x) - ahead))

    for each in arms:
        D, H = each.mass_matrix(q), heavy.mass_matrix(q)
        root = np.linalg.inv(sqrtm(D))
        rate, v = slope(each.mass_matrix, q), acceleration_to_hold(each, star)
        gradient = slope(lambda x, each=each, v=v: each.gravity(x) - heavy.mass_matrix(x) @ v, between)
        speeds = case.speed * np.array(signs)
        turn = np.array(
            [
                [[rate[i, j, k] + rate[i, k, j] - rate[j, k, i] for k in range(3)] for j in range(3)]
                for i in range(3)
            ]
        )
        C = [0.5 * np.einsum("ijk,k->ij", turn, x) for x in speeds]
        held = H @ v + (0.0 if feedforward == "none" else known.gravity(star))
        deltas = np.sort(np.linalg.eigvals(np.linalg.solve(D, H)).real)
        first = arms[0] if each is heavy else each
        moved = acceleration_to_hold(heavy, star) - acceleration_to_hold(first, star)
        shift = slope(lambda x, each=each: acceleration_to_hold(each, x), star)

        def longest(bound: Array, metric: Array) -> float:
            return max(float(np.sqrt((bound * x) @ metric @ (bound * x))) for x in signs)

        wanted = {
            "-delta_low": -deltas[0],
            "delta_high": deltas[-1],
            "sigma": max(np.abs(np.linalg.eigvals(np.linalg.solve(D, rate @ x))).max() for x in speeds),
            "kappa_v": max(np.linalg.norm(root @ x @ root, 2) for x in C),
            "kappa_e": np.linalg.norm(root @ gradient @ root, 2),
            "kappa_g": np.linalg.norm(root @ slope(each.gravity, between) @ root, 2),
            "kappa_f": np.linalg.eigvals(np.linalg.solve(D, np.diag(case.viscous))).real.max(),
            "jump": np.sqrt(moved @ D @ moved),
            "shift": max(
                np.sqrt(x @ heavy.mass_matrix(q) @ x) for x in (case.velocity * np.array(signs)) @ shift.T
            ),
            **{name: longest(getattr(case, name), np.linalg.inv(D)) for name in ("torque", "friction")},
            **{
                name: longest(getattr(case, name), D)
                for name in ("velocity", "acceleration", "encoder", "zone")
            },
        }
        for j in range(3):
            wanted[f"inverse.{j}"], wanted[f"hold.{j}"] = np.linalg.inv(D)[j, j], abs(held[j])
            wanted[f"reach.{j}"] = np.sqrt(H[j] @ np.linalg.solve(D, H[j]))
        for name, value in wanted.items():
            np.testing.assert_allclose(
                every[name](case, each, at), [value], rtol=2e-6, atol=1e-9, err_msg=name
            )


def test_deltas_are_moved_away_from_one_and_motion_is_longer_between_the_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case = setting()
    for low, high, wanted in ((0.8, 2.0, (0.794, 2.03)), (1.2, 0.9, (1.0 + 0.2 / 1.03, 1.0 - 0.1 / 1.03))):
        values = ({"-delta_low": -low, "delta_high": high}.get(name, 0.5) for name in functions(case))
        monkeypatch.setattr(quantities, "largest", lambda *_, values=values: next(values))
        found = quantities.at_ends(case)
        assert (found.delta_low.value, found.delta_high.value) == pytest.approx(wanted)
        whole, least = quantities.between_ends(case, found), min(1.0, found.delta_low.value)
        factors = dict.fromkeys(("sigma_error", "kappa_error"), math.sqrt(found.delta_high.value / least))
        for name in found._fields:
            longer = {**factors, "shift": least**-0.5}.get(name, 1.0)
            pair = (getattr(x, name) for x in (found, whole))
            before, after = ((x,) if isinstance(x, quantities.Number) else x for x in pair)
            assert [x.value for x in after] == pytest.approx([longer * x.value for x in before]), name
        assert quantities.between_ends(case._replace(arms=case.arms[1:]), found) == found


def test_a_search_comes_near_what_is_largest_inside_and_holds_other_arms_against_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case, best = setting(), np.array([0.31, -0.17, 0.73])
    assert largest(case, lambda _, arm, at: -((at.star - best) ** 2).sum(axis=1)) > -2e-4  # drawn alone: 0.01
    monkeypatch.setattr(quantities, "MARGIN", 0.0)
    one = case._replace(arms=case.arms[1:])
    found = search_numbers(one)
    near, far = (case.nominal.with_payload(case.nominal.tip, x) for x in (0.0, 0.1))
    assert quantities.count_outside(one, found, []) == 0
    told: list[str] = []
    arms = [(near,), (far,), (near, far), (near,)]
    assert quantities.count_outside(one, found, arms, seed=0, progress=told.append) == 2
    assert told[2] == "searching possible arm 3 of 4"


def test_each_other_arm_is_searched_for_its_own_worst_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """A number that another arm exceeds only where the controller's own arm is at its least is found."""
    monkeypatch.setattr(quantities, "MARGIN", 0.0)
    one = setting()._replace(arms=setting().arms[1:])
    own, other = one.arms[0], one.arms[0].with_payload(one.nominal.tip, 0.1)
    where = np.array([0.31, -0.17, 0.73])

    def peak(_: object, arm: object, at: quantities.Points) -> Array:
        near = np.exp(-40.0 * ((at.star - where) ** 2).sum(axis=1))
        return 1.0 - 0.5 * near if arm is own else 0.5 + near

    found = search_numbers(one)._replace(sigma=quantities.Number(1.2))
    monkeypatch.setattr(quantities, "functions", lambda _: {"sigma": peak})
    assert quantities.count_outside(one, found, [(own,), (other,)]) == 1
    found = found._replace(sigma=quantities.Number(1.6))
    assert quantities.count_outside(one, found, [(own,), (other,)]) == 0


def test_another_arm_has_the_room_of_loads_between_the_ends_too() -> None:
    """At the ends it may have no more than the numbers leave for loads in between."""
    case = setting()
    found = quantities.at_ends(case)
    raised = quantities.between_ends(case, found)
    longer = raised.sigma_error.value / found.sigma_error.value
    assert longer > 1.0 + quantities.MARGIN
    arms = [case.arms]
    assert quantities.count_outside(case, raised, arms) == 0
    between = raised._replace(sigma_error=quantities.Number(0.9 * raised.sigma_error.value))
    assert 0.9 * longer > 1.0  # it is above what the arm has at its ends, and below what it may have between
    assert quantities.count_outside(case, between, arms) == 1


def test_what_a_search_found_is_raised_by_its_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quantities, "largest", lambda *_: 0.8)
    found = quantities.at_ends(setting())
    assert found.sigma.value == pytest.approx(0.8 * (1.0 + quantities.MARGIN), rel=1e-12)
    assert {each.value for each in found.inverse} == {found.sigma.value}


def test_slopes_are_derivatives() -> None:
    q = np.array([[0.3, -0.7], [1.0, 2.0]])
    found = slopes(lambda x: np.sin(x) * x[:, ::-1], q)
    expected = np.empty((2, 2, 2))
    expected[:, 0, 0], expected[:, 0, 1] = np.cos(q[:, 0]) * q[:, 1], np.sin(q[:, 1])
    expected[:, 1, 1], expected[:, 1, 0] = np.cos(q[:, 1]) * q[:, 0], np.sin(q[:, 0])
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_the_numbers_of_motion_are_those_of_a_certificate_at_one_radian_per_second() -> None:
    arm = armgpi.Robot.load("anthropomorphic3")
    made = armgpi.certify(arm, speed=1.0, payload=None)
    for name, value in motion(arm).items():
        assert 0.4 * float(made.data["numbers"][name]) <= value <= float(made.data["numbers"][name]), name


def test_friction_that_is_stated_is_that_of_the_fastest_reference_and_at_rest_what_sticks() -> None:
    arm = armgpi.Robot.load("anthropomorphic3").with_friction([0.3, 0.2, 0.1], [0.05, 0.04, 0.03])
    for more, viscous in (({}, 0.0), ({"acceleration": 1.0}, 0.4)):
        setting = ask(arm, 1e-3, speed=0.4, friction=True, **more).setting
        np.testing.assert_allclose(setting.friction, viscous * np.array([0.3, 0.2, 0.1]) + [0.05, 0.04, 0.03])
    assert not ask(arm, 1e-3, speed=0.4).setting.friction.any()


def test_a_range_of_loads_tells_when_delta_leaves_the_certified_sector() -> None:
    arm = armgpi.Robot.load("ur5")
    most = largest_payload(arm)
    assert certified_sector().upper == pytest.approx(4.27, abs=0.01)
    assert payload_range(arm, 0.0, 0.99 * most.certifiable).certifiable()
    beyond = payload_range(arm, 0.0, 1.01 * most.certifiable)
    assert not beyond.certifiable()
    assert not beyond.certifiable(Member(rolloff=1))
    assert "leaves the certified sector, 1 to 4.27" in str(beyond)
    assert "is within the certified sector" in str(payload_range(arm, 0.0, 0.99 * most.certifiable))
    near = payload_range(arm, 0.0, 0.8 * most.certifiable, member=Member(rolloff=1), slowest=1.0)
    assert "leaves the certified sector, 1 to 2" in str(near)
    made = armgpi.certify(arm, speed=1e-3, payload=(0.0, 1.05 * most.certifiable), box=0.5)
    assert not made.data["solutions"]


def test_what_is_asked_for_is_put_together_joint_by_joint() -> None:
    arm = armgpi.Robot.load("anthropomorphic3").with_friction([0.3, 0.2, 0.1], [0.05, 0.04, 0.03])
    two = arm.with_friction([0.1, 0.4, 0.1], [0.06, 0.01, 0.02])
    speed, radius = np.array([0.1, 0.2, 0.3]), np.array([0.03, 0.01, 0.02])
    stated: dict[str, Any] = {
        "acceleration": [1.0, 2.0, 3.0],
        "torque": [0.1, 0.2, 0.3],
        "rest_dead_zone": [0.1, 0.0, 0.2],
    }
    asked = ask(
        arm, 2e-3, speed=speed, radius=radius, delay=3, bits=12, friction=True, payload=(0.1, 0.3), **stated
    )
    found, count = asked.setting, 0.5 * arm.encoder_count(12)
    np.testing.assert_allclose(found.radius, radius + 4 * 2e-3 * speed + count)
    np.testing.assert_allclose(found.friction, np.array([0.3, 0.2, 0.1]) * speed + [0.05, 0.04, 0.03])
    wanted = {
        "speed": speed,
        "velocity": speed,
        "encoder": count,
        "viscous": [0.3, 0.2, 0.1],
        "zone": [0.1, 0.0, 0.2],
    }
    for name, value in {**wanted, **{x: stated[x] for x in ("acceleration", "torque")}}.items():
        np.testing.assert_allclose(getattr(found, name), value, err_msg=name)
    assert asked.loads == (0.1, 0.3)
    q = np.array([0.1, 0.4, -0.3])

    def weights(*arms: armgpi.Robot) -> list[list[float]]:
        return [each.gravity(q).tolist() for each in arms]

    light, heavy = (arm.with_payload(arm.tip, x) for x in (0.1, 0.3))
    assert weights(*found.arms, found.nominal) == weights(light, heavy, heavy)
    hull = ask(arm, 2e-3, speed=speed, payload=(0.1, 0.3), arms=(two, arm), others=(two,), friction=True)
    ends = [each.with_payload(arm.tip, x) for x in (0.1, 0.3) for each in (two, arm)]
    assert weights(*hull.setting.arms) == weights(*ends, light, heavy)
    (loaded,) = hull.others
    assert weights(*loaded) == weights(ends[0], ends[2])
    np.testing.assert_allclose(hull.setting.friction, [0.06, 0.04, 0.03])  # at rest: what sticks
    np.testing.assert_allclose(hull.setting.radius, 0.02 + 2e-3 * speed)
    none = ask(arm, 2e-3, speed=speed, arms=(two,)).setting
    assert weights(*none.arms) == weights(two, arm)
    assert not any(x.any() for x in (none.velocity, none.acceleration, none.encoder))


@pytest.mark.parametrize("feedforward", ["none", "gravity", "model"])
def test_numbers_and_inputs_of_a_certificate_are_those_that_were_found_and_no_smaller(
    feedforward: str,
) -> None:
    arm, rng = armgpi.Robot.load("anthropomorphic3"), np.random.default_rng(4)
    asked = ask(arm, 1e-3, speed=[0.1, 0.2, 0.3], acceleration=1.0, bits=9, feedforward=feedforward)
    drawn = {name: rng.uniform(0.1, 1.0, 3) for name in quantities.Numbers._fields}
    each = {
        name: tuple(map(quantities.Number, x)) if name in quantities.PER_JOINT else quantities.Number(x[0])
        for name, x in drawn.items()
    }
    found, one = quantities.Numbers(**each), {name: x[0] for name, x in drawn.items()}
    model = feedforward == "model"
    turned = one["sigma"] * max(asked.setting.radius / asked.setting.speed)
    more = 1.0 + math.sqrt(one["delta_high"] * math.exp(turned)) if model else 1.0
    shares = {
        "disturbance": one["torque"],
        "friction": one["friction"],
        "velocity of the reference": more * one["kappa_v"] * one["velocity"],
        "acceleration of the reference": more * one["acceleration"],
    }
    assert request.shares_of(asked, found) == pytest.approx(shares)
    inputs = {"torque": sum(shares.values()), "shift": one["shift"], "reference": one["velocity"]}
    inputs |= {"count": one["encoder"], "zone": one["zone"]}
    assert request.inputs_of(asked, found).keys() == inputs.keys()
    told = {**request.numbers_of(asked, found), **request.inputs_of(asked, found)}
    push = one["kappa_v"] * one["velocity"] + one["acceleration"] if model else 0.0
    wanted = {**one, **inputs, "count_time": max(asked.setting.encoder / asked.setting.speed)}
    wanted |= {name: drawn[name] for name in quantities.PER_JOINT}
    wanted["hold"] = drawn["hold"] + push * drawn["reach"]
    for name, text in told.items():
        ratio = np.array([float(x) for x in ([text] if isinstance(text, str) else text)]) / wanted[name]
        assert (abs(ratio - 1.0) < 1.1e-9).all(), name
        assert (ratio < 1.0 if name == "delta_low" else ratio > 1.0).all(), name


def test_a_box_is_where_it_was_asked_for_or_a_turn_about_the_middle() -> None:
    arm = armgpi.Robot.load("anthropomorphic3")
    arm = arm.with_limits(lower=[-8.0, -1.0, 0.5], upper=[5.0, 2.0, 0.7])
    middle = np.array([-1.5, 0.5, 0.6])
    for wanted, lower, upper in (
        (None, [-1.5 - math.pi, -1.0, 0.5], [-1.5 + math.pi, 2.0, 0.7]),
        (0.3, middle - 0.3, middle + 0.3),
        ({"around": [1.0, 0.1, 0.2], "by": [0.1, 0.2, 0.3]}, [0.9, -0.1, -0.1], [1.1, 0.3, 0.5]),
        ({"around": 0.6}, [0.6 - math.pi, -0.9, 0.5], [0.6 + math.pi, 2.1, 0.7]),
        ({"lower": [0.1, 0.2, 0.6]}, [0.1, 0.2, 0.6], [-1.5 + math.pi, 2.0, 0.7]),
        ({"upper": {"q1": 0.0}}, [-1.5 - math.pi, -1.0, 0.5], [0.0, 2.0, 0.7]),
    ):
        found = box_of(arm, wanted)
        np.testing.assert_allclose(found, [lower, upper], err_msg=str(wanted))


def test_a_point_is_beside_its_reference_by_shares_of_the_radius() -> None:
    case = setting()
    z = np.random.default_rng(8).uniform(-1.0, 1.0, (5, 9))
    at = points(case, z)
    for row in range(5):
        for j in range(3):
            star = z[row, j]
            assert at.star[row, j] == star
            assert at.q[row, j] == star + case.radius[j] * z[row, 3 + j]
            assert at.between[row, j] == star + case.radius[j] * z[row, 6 + j]
