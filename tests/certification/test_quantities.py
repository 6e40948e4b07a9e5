"""The numbers of an arm against its own equations: nothing that is drawn may exceed them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from strategies import robots

import armgpi
from armgpi.arrays import Array
from armgpi.certification import quantities
from armgpi.certification.quantities import (
    Points,
    Setting,
    functions,
    largest,
    motion,
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
