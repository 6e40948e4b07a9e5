"""derive: closed forms that are Pinocchio's, and a round trip through validate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from strategies import robots as random_robots

from armgpi import Derivation, Robot, derive, errors, robots, validate

KNOWN = ("anthropomorphic3", "double_pendulum", "finger_edu", "twodof")
SHORT = [name for name in robots.names() if name in KNOWN]
CHAINS = {
    "ur5": ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"],
    "panda": ["panda_joint1", "panda_joint2", "panda_joint3", "panda_joint4"],
    "kinova": ["j2s6s200_joint_1", "j2s6s200_joint_2"],
}


def check(robot: Robot, derivation: Derivation) -> None:
    space: dict[str, object] = {}
    exec(derivation.python(), space)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, v = rng.uniform(-1.5, 1.5, robot.n), rng.normal(size=robot.n)
        D = space["mass_matrix"](q)  # type: ignore[operator]
        h = space["coriolis_matrix"](q, v) @ v  # type: ignore[operator]
        G = space["gravity"](q)  # type: ignore[operator]
        right = robot.mass_matrix(q)
        np.testing.assert_allclose(D, right, rtol=0, atol=1e-10 * np.abs(right).max())
        bias = robot.nonlinear_effects(q, v)
        np.testing.assert_allclose(h + G, bias, rtol=0, atol=1e-10 * max(1e-3, np.abs(bias).max()))
        np.testing.assert_allclose(
            space["forward_kinematics"](q),  # type: ignore[operator]
            robot.frame_pose(robot.tip, q).translation,
            rtol=0,
            atol=1e-10,
        )


@pytest.mark.parametrize("numbers", [False, True], ids=["symbols", "numbers"])
@pytest.mark.parametrize("name", SHORT)
def test_every_short_robot_we_know_agrees_with_pinocchio(name: str, numbers: bool) -> None:
    robot = Robot.load(name)
    check(robot, derive(robot, numbers=numbers))


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CHAINS if name in robots.names()])
def test_the_first_joints_of_longer_ones_do_too(name: str) -> None:
    robot = Robot.load(name, keep=CHAINS[name])
    check(robot, derive(robot))


@given(random_robots(max_joints=2))
@settings(max_examples=10, deadline=None)
def test_any_short_arm_does(robot: Robot) -> None:
    check(robot, derive(robot))


def test_the_round_trip_through_validate(tmp_path: Path) -> None:
    robot = Robot.load("anthropomorphic3")
    path = tmp_path / "arm.py"
    path.write_text(derive(robot).python(), encoding="utf-8")
    report = validate(path, robot)
    assert report.agrees
    assert all(law.verdict == "holds" for law in report.laws)  # C is Christoffel's, unlike the paper's


def test_symbols_and_values_belong_together() -> None:
    d = derive("anthropomorphic3")
    assert d.D[1, 2] == d.D[2, 1]
    I3, m3, c3, l3, q3 = sympy.symbols("I3yy m3 c3x l3x q3")
    assert sympy.expand(d.D[1, 2] - (I3 + m3 * c3**2 + m3 * l3 * c3 * sympy.cos(q3))) == 0
    assert d.parameters["m3"] == 0.51


def test_latex_names_every_entry() -> None:
    text = derive("double_pendulum").latex()
    for entry in ("d_{11}", "d_{12}", "d_{22}", "c_{21}", "g_{2}", r"\dot q_{1}"):
        assert entry in text
    assert text.count(r"\begin{align*}") == text.count(r"\end{align*}") == 1


def test_a_long_arm_is_refused() -> None:
    if "ur5" not in robots.names():
        pytest.skip("needs example-robot-data")
    with pytest.raises(errors.ParameterError, match="at most 4") as caught:
        derive("ur5")
    assert caught.value.remedies == (errors.Remedy("lock"), errors.Remedy("keep"))
