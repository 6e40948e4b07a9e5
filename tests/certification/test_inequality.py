"""Each bound of docs/proof.md against the quantity that it bounds, where a claim allows the arm to be."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import FOLLOWS, robots

from armgpi import Robot, certify
from armgpi.arrays import Array
from armgpi.certification import quantities
from armgpi.certification.quantities import Points, Setting

SEEDS = st.integers(0, 2**32 - 1)


class Drawn(NamedTuple):
    """Numbers at one configuration, and an arm with a load between the ends that moves there."""

    numbers: dict[str, float]
    setting: Setting
    arm: Robot
    star: Array
    q: Array
    r: Array
    e: Array

    def length(self, x: Array) -> float:
        return float(np.sqrt(x @ self.arm.mass_matrix(self.q) @ x))

    def force(self, x: Array) -> float:
        return float(np.sqrt(x @ np.linalg.solve(self.arm.mass_matrix(self.q), x)))


def draw(
    robot: Robot,
    load: float,
    share: float,
    seed: int,
    feedforward: str = "gravity",
    box: Any = (-1.0, 1.0),
    uncertain: bool = False,
) -> Drawn:
    """Return what a claim allows: corners of the speeds are as likely as what is between."""
    rng, n = np.random.default_rng(seed), robot.n
    heavy, arm = (robot.with_payload(robot.tip, x) for x in (load, share * load))
    arms: tuple[Robot, ...] = (robot, heavy)
    if uncertain:  # of all bodies and rotors, the controller's in the middle
        scale, rotors = np.array([0.7, 1.4]), np.array([0.3, 0.05])

        def mixed(x: float) -> Robot:
            weights = np.array([1.0 - x, x])
            return robot.scaled_inertia(float(weights @ scale)).with_armature(float(weights @ rotors))

        heavy, arm = mixed(0.5), mixed(share)
        arms = (mixed(0.0), mixed(1.0), heavy)
    star = rng.uniform(*box, n)
    q = star + 0.02 * rng.uniform(-1.0, 1.0, n)
    speed, viscous = rng.uniform(0.1, 1.0, n), rng.uniform(0.0, 5.0, n)
    rest = np.zeros(n)
    setting = Setting(
        arms, heavy, robot, star, star, rest + 0.02, speed, feedforward, viscous=viscous
    )._replace(velocity=speed, torque=speed, friction=rest, acceleration=rest, encoder=rest, zone=rest)
    between = star + np.linspace(0.0, 1.0, 5)[:, None] * (q - star)
    at = Points(np.repeat(star[None], 5, 0), np.repeat(q[None], 5, 0), between)
    functions = quantities.functions(setting)
    numbers = {
        name: max(float(function(setting, each, at).max()) for each in setting.arms)
        for name, function in functions.items()
    }
    found = {name: quantities.Number(0.0) for name in quantities.Numbers._fields}
    found.update(
        {name.lstrip("-"): quantities.Number(abs(x)) for name, x in numbers.items() if "." not in name}
    )
    raised: Any = quantities.between_ends(setting, quantities.Numbers(**found))
    numbers.update({name: getattr(raised, name).value for name in ("sigma_error", "kappa_error", "shift")})
    r = speed * np.clip(rng.uniform(-2.0, 2.0, n), -1.0, 1.0)
    return Drawn(numbers, setting, arm, star, q, r, rng.standard_normal(n))


def check(case: Drawn) -> None:
    """Compare every term of the error's equation with its bound."""
    numbers, arm, q, r, e = case.numbers, case.arm, case.q, case.r, case.e
    D, speed = arm.mass_matrix(q), case.length(case.e)

    def torque(v: Array) -> Array:
        return arm.nonlinear_effects(q, v) - arm.gravity(q)

    # Twice along the reference, once for the error's own speed.
    extra = case.force(torque(r + e) - torque(r))
    tiny = 1e-9 * (1.0 + case.force(torque(r + e)))
    assert extra <= (2.0 * numbers["kappa_v"] + speed * numbers["kappa_error"]) * speed + tiny
    assert case.force(torque(r)) <= numbers["kappa_v"] * case.length(r) + tiny
    step = 1e-5
    rate = (arm.mass_matrix(q + step * (r + e)) - arm.mass_matrix(q - step * (r + e))) / (2.0 * step)
    root = np.linalg.inv(np.linalg.cholesky(D))
    grows = np.abs(np.linalg.eigvalsh(root @ rate @ root.T)).max()
    assert grows <= (numbers["sigma"] + speed * numbers["sigma_error"]) * (1.0 + 1e-6) + 1e-4
    z = -np.linalg.solve(D, case.setting.viscous * e)
    size = case.length(z) ** 2
    assert size + numbers["kappa_f"] * (z @ D @ e) <= 1e-9 * (size + 1.0)
    model, known = case.setting.nominal, case.setting.known
    delta = np.linalg.eigvalsh(root @ model.mass_matrix(q) @ root.T)
    assert -numbers["-delta_low"] <= delta.min() * (1.0 + 1e-9)
    assert delta.max() <= numbers["delta_high"] * (1.0 + 1e-9)

    def held(at: Array) -> Array:
        return model.inertia_solve(at, arm.gravity(at) - known.gravity(at))

    v = held(case.star)
    stiff = arm.gravity(q) - model.inertia_times(q, v)
    stiff = stiff - arm.gravity(case.star) + model.inertia_times(case.star, v)
    away = case.length(q - case.star)
    rounding = 1e-9 * (1.0 + case.force(arm.gravity(q)) + case.force(model.inertia_times(q, v)))
    assert case.force(stiff) <= 1.01 * numbers["kappa_e"] * away + rounding
    fall = case.force(arm.gravity(q) - arm.gravity(case.star))
    assert fall <= 1.01 * numbers["kappa_g"] * away + rounding
    change = (held(case.star + step * r) - held(case.star - step * r)) / (2.0 * step)
    assert case.length(change) <= numbers["shift"] * (1.0 + 1e-5) + 1e-4 * (1.0 + case.length(v))
    assert case.force(case.setting.torque) <= numbers["torque"] * (1.0 + 1e-9)
    inverse = np.diagonal(np.linalg.inv(D))
    for j in range(arm.n):
        assert inverse[j] <= numbers[f"inverse.{j}"] * (1.0 + 1e-9)


@settings(max_examples=25)
@given(robots(max_joints=5), st.floats(0.0, 3.0), st.floats(0.0, 1.0), SEEDS)
def test_no_term_of_any_arm_exceeds_its_bound(robot: Robot, load: float, share: float, seed: int) -> None:
    check(draw(robot, load, share, seed))


@settings(max_examples=15)
@given(robots(max_joints=4), st.floats(0.0, 1.0), SEEDS)
def test_nor_of_one_between_others(robot: Robot, share: float, seed: int) -> None:
    check(draw(robot, 0.0, share, seed, uncertain=True))


@settings(max_examples=2)
@given(robots(min_joints=9, max_joints=10), st.floats(0.0, 3.0), st.floats(0.0, 1.0), SEEDS)
def test_nor_of_one_with_many_joints(robot: Robot, load: float, share: float, seed: int) -> None:
    """All 2^(n - 1) corners of the speeds are taken, not some."""
    check(draw(robot, load, share, seed))


@pytest.mark.parametrize("seed", range(5))
def test_nor_of_one_whose_joint_follows_another(seed: int) -> None:
    check(draw(Robot.from_xml(FOLLOWS, mimic="follow"), 1.0, 0.4, seed))


LONG = """<robot name='long'><link name='base'/>
<link name='table'><inertial><mass value='1'/>
<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>
<link name='slide'><inertial><mass value='2'/>
<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>
<joint name='turns' type='revolute'><parent link='base'/><child link='table'/><axis xyz='0 0 1'/>
<limit lower='-1' upper='1' effort='1000' velocity='1'/></joint>
<joint name='slides' type='prismatic'><parent link='table'/><child link='slide'/><axis xyz='1 0 0'/>
<limit lower='1' upper='11' effort='1000' velocity='1'/></joint></robot>"""


@pytest.mark.parametrize("seed", range(5))
def test_nor_of_one_that_slides_by_ten_meters(seed: int) -> None:
    check(draw(Robot.from_xml(LONG), 1.0, 0.4, seed, box=([-1.0, 1.0], [1.0, 11.0])))


def test_all_of_a_long_slide_is_kept_and_printed() -> None:
    made = certify(Robot.from_xml(LONG), payload=(0.0, 0.1), speed=0.01, start="held")
    assert made.data["limits"]["lower"] == ["-1.0", "1.0"]
    assert made.data["limits"]["upper"] == ["1.0", "11.0"]
    (said,) = (line for line in str(made).splitlines() if "box" in line)
    assert "1 to 11" in said, said
    assert made.certified, made.reasons
    assert made.check() == []


def test_corners_are_all_up_to_twelve_joints() -> None:
    assert len(np.unique(quantities.corners(np.ones(9)), axis=0)) == 2**8
    assert len(np.unique(quantities.corners(np.ones(12)), axis=0)) == 2**11
