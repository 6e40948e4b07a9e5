"""Proved numbers of an arm: no configuration exceeds them, and they are near the largest that there is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import robots

from armgpi import Robot
from armgpi.certification import proofs, quantities
from armgpi.certification.quantities import Numbers, Setting
from armgpi.certification.trigonometric import Expandable, polynomials_of
from armgpi.errors import ParameterError

TOLERANCE = 0.1


@pytest.fixture
def arm() -> Robot:
    return Robot.load("anthropomorphic3")


def setting(
    robot: Robot, load: float, half: float, feedforward: str = "none", radius: float = 0.02
) -> Setting:
    middle = robot.middle()
    heavy = robot.with_payload(robot.tip, load)
    lower = np.maximum(robot.limits.lower, middle - half)
    upper = np.minimum(robot.limits.upper, middle + half)
    speed = np.linspace(0.2, 0.4, robot.n)
    return Setting((robot, heavy), heavy, lower, upper, np.full(robot.n, 0.02), speed, feedforward)


def everywhere(case: Setting, count: int, seed: int) -> dict[str, float]:
    """Return the largest values at random configurations; an end of the box is as likely as its inside."""
    rng = np.random.default_rng(seed)
    n = case.nominal.n
    z = np.clip(rng.uniform(-0.3, 1.3, (count, 3 * n)), 0.0, 1.0)
    low = np.concatenate([case.lower, np.full(2 * n, -1.0)])
    width = np.concatenate([case.upper - case.lower, np.full(2 * n, 2.0)])
    at = quantities.points(case, low + width * z)
    return {
        name: max(float(np.max(function(case, arm, at))) for arm in case.arms)
        for name, function in quantities.functions(case).items()
    }


def bounds(proven: Numbers) -> dict[str, quantities.Number]:
    found = {}
    for name, number in proven._asdict().items():
        if name in quantities.PER_JOINT:
            found.update({f"{name}.{j}": each for j, each in enumerate(number)})
        else:
            found[name] = number
    low = found.pop("delta_low")
    return found | {"-delta_low": low._replace(value=-low.value)}


#: What is put together of other bounds, and so farther above the largest value: by how much at most.
LOOSE = {"sigma_error": 1.8, "kappa_error": 1.8, "hold": 2.5, "reach": 2.5, "jump": 2.5, "shift": 20.0}


@pytest.mark.parametrize("feedforward", ["none", "gravity", "model"])
def test_no_configuration_exceeds_what_is_proved_and_some_come_near(arm: Robot, feedforward: str) -> None:
    case = setting(arm, 0.25, 0.4, feedforward)
    vectors = {"torque": 0.1, "friction": 0.2, "velocity": 0.3, "acceleration": 1.0, "encoder": 1e-4}
    case = case._replace(**{name: size * np.array([1.0, 0.5, 2.0]) for name, size in vectors.items()})
    proven, seen = bounds(proofs.proved(case, TOLERANCE)), everywhere(case, 4000, 1)
    for name, number in proven.items():
        assert number.status == "proved", name
        # Rounding of D^-1 D^, which is the identity where the nominal model is the arm.
        assert seen[name] <= number.value + 1e-12 * abs(number.value), name
        loose = LOOSE.get(name.split(".")[0], 1.0)
        if feedforward == "model" and name == "acceleration":
            loose = 5.0
        if name != "-delta_low" and seen[name] > 0.1 * max(seen[x] for x in proven if x[:4] == name[:4]):
            assert number.value <= loose * (1.0 + 2.0 * TOLERANCE) * max(seen[name], 1e-12), name


@settings(max_examples=8)
@given(robots(min_joints=2, max_joints=3), st.floats(0.0, 2.0), st.integers(0, 2**32 - 1))
def test_no_configuration_of_any_arm_exceeds_what_is_proved(robot: Robot, load: float, seed: int) -> None:
    case = setting(robot, load, 0.3)
    proven = bounds(proofs.proved(case, 0.2, budget=0.2))
    for name, seen in everywhere(case, 200, seed).items():
        if proven[name].status == "proved":
            assert seen <= proven[name].value + 1e-9 * abs(proven[name].value), name


@settings(max_examples=30)
@given(robots(max_joints=4), st.integers(0, 2**32 - 1))
def test_polynomials_and_their_derivatives_are_those_of_the_robot(robot: Robot, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-1.5, 1.5, (3, robot.n))
    ((D, G),) = polynomials_of([robot])
    scale = np.abs(robot.mass_matrix(q)).max()
    np.testing.assert_allclose(D.at(q), robot.mass_matrix(q), atol=1e-11 * scale)
    np.testing.assert_allclose(
        G.at(q), robot.gravity(q), atol=1e-11 * max(np.abs(robot.gravity(q)).max(), 1.0)
    )
    expandable = Expandable(D, np.full(robot.n, 1.5))
    expansion, step = expandable.at(q), 1e-5
    np.testing.assert_allclose(expansion.value, D.at(q), atol=1e-12 * scale)
    for j, unit in enumerate(np.eye(robot.n)):
        difference = expandable.at(q + step * unit).value - expandable.at(q - step * unit).value
        np.testing.assert_allclose(expansion.slopes[:, j], difference / (2 * step), atol=1e-8 * scale)
    for row, (i, j) in enumerate(expandable.pairs):
        unit = step * np.eye(robot.n)[j]
        difference = expandable.at(q + unit).slopes[:, i] - expandable.at(q - unit).slopes[:, i]
        np.testing.assert_allclose(expansion.seconds[:, row], difference / (2 * step), atol=1e-8 * scale)
        third = expandable.at(q).seconds[:, row]
        for k, other in enumerate(np.eye(robot.n)):
            moved = np.abs(expandable.at(q + 0.1 * other).seconds[:, row] - third)
            assert np.all(moved <= 0.1 * expandable.thirds[i, j, k] + 1e-12 * scale)


def test_rounding_is_far_less_than_what_bounds_are_raised_by(arm: Robot) -> None:
    ((D, _),) = polynomials_of([arm])
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (200, arm.n))
    phase = q.astype(np.longdouble) @ D.frequencies.T.astype(np.longdouble)
    exact = np.tensordot(np.cos(phase), D.coefficients.real.astype(np.longdouble), 1)
    exact -= np.tensordot(np.sin(phase), D.coefficients.imag.astype(np.longdouble), 1)
    error = np.abs(D.at(q) - exact).max() * np.linalg.norm(np.linalg.inv(D.at(q)), 2, axis=(1, 2)).max()
    assert error < 1e-3 * proofs.OUTWARD


FOLLOWS = """<robot name="geared">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="50" velocity="2"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="6"/>
<mimic joint="shoulder" multiplier="3"/></joint>
</robot>"""


def test_what_has_no_such_polynomials_is_refused() -> None:
    with pytest.raises(ParameterError, match="no joint follows another"):
        polynomials_of([Robot.from_xml(FOLLOWS, mimic="follow")])
    polynomials_of([Robot.from_xml(FOLLOWS, lock="elbow")])


@settings(max_examples=1)
@given(robots(min_joints=9, max_joints=9, types=["revolute"]))
def test_many_joints_are_refused(robot: Robot) -> None:
    with pytest.raises(ParameterError, match="at most 8 joints"):
        polynomials_of([robot])


def test_branch_and_bound_ends_with_a_bound_when_time_is_over(arm: Robot) -> None:
    case = setting(arm, 0.25, 1.0)
    proven = proofs.proved(case, 1e-9, budget=0.05)
    for number in (proven.sigma, proven.kappa_v, *proven.inverse):
        assert number.status in ("proved", "searched")
