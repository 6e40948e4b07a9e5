"""Paths in space are the curves they are said to be, and the tool follows them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import robots_and_states

from armgpi import GPI, CartesianReference, FixedGains, RigidBodyPlant, Robot, simulate
from armgpi.errors import ArmgpiError, ArrayError, NameNotFound, ParameterError, ReachError
from armgpi.paper.arm import PaperArm
from armgpi.references.paths import Circle, Eased, LaserPath, Lissajous, Path, Polyline, line, rectangle

ARM = Robot.load("anthropomorphic3")
HAND = PaperArm()
PATHS: dict[str, Path] = {
    "laser": LaserPath(),
    "lissajous": Lissajous([0.2, 0.0, 0.3], [0.05, 0.1, 0.05], [1.0, 2.0, 3.0], [0.1, 0.2, 0.3]),
    "circle": Circle([0.25, 0.0, 0.3], 0.1, 4.0, normal=[1.0, 0.5, 2.0]),
    "around": Circle([0.0, 0.0, 0.3], 0.25, 3.0),
    "line": line([0.2, -0.2, 0.2], [0.2, 0.2, 0.4], 5.0),
    "rectangle": rectangle([0.2, -0.1, 0.3], [0.0, 0.2, 0.0], [0.0, 0.0, 0.1], 1.0),
}
each_path = pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
TIMES = np.linspace(0.05, 7.0, 141)


def reference(path: Path) -> CartesianReference:
    return CartesianReference(ARM, "tool", path, HAND.inverse_kinematics)


@each_path
def test_derivatives_of_a_path_are_those_of_its_position(path: Path) -> None:
    h = 1e-4
    before, now, after = (path.at(TIMES + dt) for dt in (-h, 0.0, h))
    # Central differences: h^2 of the third derivative (up to 200 m/s^3 in a Bezier corner), rounding / h^2.
    np.testing.assert_allclose((after.x - before.x) / (2 * h), now.v, atol=1e-6)
    np.testing.assert_allclose((after.v - before.v) / (2 * h), now.a, atol=1e-5)


def test_the_laser_path_is_eq_28_at_a_ninth_of_time() -> None:
    parameter = TIMES / 9.0
    expected = np.stack(
        [
            0.08 + 0.15 * (parameter / 4.0),
            -0.15 + 0.05 * np.cos(np.pi + parameter) * np.sin(np.pi + parameter),
            0.4 - 0.1 * np.cos(np.pi + parameter) * np.cos(np.pi + parameter),
        ],
        axis=-1,
    )
    np.testing.assert_allclose(LaserPath().at(TIMES).x, expected, atol=1e-15)


def test_the_printed_recursion_of_eq_28_settles_on_a_ninth_of_time() -> None:
    step, parameter, delta, seen = 1e-4, 0.0, 0.0, []
    for _ in range(20_000):
        parameter = (parameter + delta) / 10.0
        seen.append(parameter)
        delta += step
    time = step * np.arange(20_000)
    # After the first dozen steps it is (time - h / 9) / 9: a constant 1.1e-5 s behind.
    np.testing.assert_allclose(seen[20:], (time[20:] - step / 9.0) / 9.0, atol=1e-12)


def test_a_circle_has_its_radius_and_turns_about_its_normal() -> None:
    path = Circle([0.1, 0.2, 0.3], 0.07, 2.0, normal=[1.0, 2.0, -2.0])
    point = path.at(TIMES)
    arm = point.x - path.centre
    np.testing.assert_allclose(np.linalg.norm(arm, axis=-1), 0.07, rtol=1e-13)
    np.testing.assert_allclose(point.v, np.cross(np.pi * path.normal, arm), atol=1e-14)


def test_a_rectangle_stops_at_its_corners() -> None:
    path = rectangle([0.2, -0.1, 0.3], [0.0, 0.2, 0.0], [0.0, 0.0, 0.1], 1.5)
    corners = path.at(1.5 * np.arange(5))
    np.testing.assert_allclose(corners.x, path.corners, atol=1e-15)
    # Out along the first side, up the second, back and down.
    low, high = [0.2, -0.1, 0.3], [0.2, 0.1, 0.4]
    around = [low, [0.2, 0.1, 0.3], high, [0.2, -0.1, 0.4], low]
    np.testing.assert_allclose(corners.x, around, atol=1e-15)
    assert not np.abs(corners.v).max() > 1e-12
    assert path.t_end == 6.0


@each_path
def test_the_tool_is_on_the_path_and_moves_with_it(path: Path) -> None:
    target, point = reference(path).at(TIMES), path.at(TIMES)
    np.testing.assert_allclose(ARM.frame_pose("tool", target.q).translation, point.x, atol=1e-12)
    jacobian = ARM.frame_jacobian("tool", target.q)[:, :3]
    np.testing.assert_allclose(np.einsum("kij,kj->ki", jacobian, target.v), point.v, atol=1e-12)


@each_path
def test_joint_velocity_and_acceleration_are_derivatives_of_joint_position(path: Path) -> None:
    h, follow = 1e-4, reference(path)
    before, now, after = (follow.at(TIMES + dt) for dt in (-h, 0.0, h))
    scale = np.abs(now.a).max()
    np.testing.assert_allclose((after.q - before.q) / (2 * h), now.v, atol=1e-6 * (1.0 + scale))
    np.testing.assert_allclose((after.v - before.v) / (2 * h), now.a, atol=1e-4 * (1.0 + scale))


def test_angles_go_on_over_full_turns_in_any_order_of_times() -> None:
    follow = reference(PATHS["around"])
    late = follow.at(7.0)
    np.testing.assert_allclose(follow.at(TIMES).q[-1], late.q, atol=1e-12)
    # Two and a third turns about the base.
    assert late.q[0] == pytest.approx(2.0 * np.pi * 7.0 / 3.0, abs=1e-12)
    np.testing.assert_array_equal(reference(PATHS["around"]).at(7.0).q, late.q)


def test_one_time_gives_what_many_times_give() -> None:
    follow = reference(LaserPath())
    together = follow.at(TIMES[:5])
    for i, t in enumerate(TIMES[:5]):
        for part, alone in zip(together, follow.at(float(t)), strict=True):
            np.testing.assert_allclose(part[i], alone, rtol=1e-14, atol=1e-15)


@settings(max_examples=30)
@given(robots_and_states(max_joints=5))
def test_the_drift_of_a_frame_is_the_change_of_its_jacobian_times_velocity(drawn: Any) -> None:
    robot, (q, v, _) = drawn
    frame, h = robot.tip, 1e-6
    ahead, behind = (robot.frame_jacobian(frame, q + dt * v) @ v for dt in (h, -h))
    drift = robot.frame_drift(frame, q, v)
    scale = 1.0 + np.abs(drift).max() + np.abs(v).max() ** 3
    np.testing.assert_allclose((ahead - behind) / (2 * h), drift, atol=1e-7 * scale)
    np.testing.assert_array_equal(robot.frame_drift(frame, q[None], v[None])[0], drift)


@pytest.mark.parametrize(("payload", "most"), [(0.0, 1e-4), (0.25, 2e-4)])
def test_gpi_keeps_the_tool_on_the_laser_path(payload: float, most: float) -> None:
    plant = RigidBodyPlant(ARM.with_payload("tool", payload))
    path = LaserPath()
    rollout = simulate(plant, GPI(ARM, 1e-3, FixedGains(60.0)), reference(path), 8.0)
    tool = ARM.frame_pose("tool", rollout["q"].values).translation
    missed = np.linalg.norm(tool - path.at(rollout["time"].values).x, axis=-1)
    assert np.sqrt(np.mean(missed[1000:] ** 2)) < most


@pytest.mark.parametrize(
    ("make", "error", "named"),
    [
        (lambda: LaserPath(0.0), ParameterError, "rate"),
        (lambda: Circle([0, 0], 0.1, 1.0), ArrayError, "centre"),
        (lambda: Circle([0, 0, 0], -0.1, 1.0), ParameterError, "radius"),
        (lambda: Circle([0, 0, 0], 0.1, 1.0, [0, 0, 0]), ParameterError, "normal"),
        (lambda: rectangle([0, 0, 0], [1, 0, 0], [1, 1, 0], 1.0), ParameterError, "perpendicular"),
        (lambda: Polyline([[0, 0, 0], [1, 0]], 1.0), ArrayError, "corners"),
        (lambda: Lissajous([0, 0, 0], [1, 1, np.nan], [1, 1, 1]), ArrayError, "amplitude"),
        (lambda: CartesianReference(ARM, "tol", LaserPath(), HAND.inverse_kinematics), NameNotFound, "tool"),
        (lambda: CartesianReference(ARM, "tool", "line", HAND.inverse_kinematics), ParameterError, "path"),
        (
            lambda: CartesianReference(ARM, "tool", LaserPath(), lambda x: np.zeros_like(x)),
            ParameterError,
            "misses its beginning",
        ),
        (lambda: reference(line([0.2, 0, 0.2], [2.0, 0, 0.2], 1.0)).at(1.0), ReachError, "t = 1 s"),
        (lambda: reference(line([2.0, 0, 0.2], [0.2, 0, 0.2], 1.0)), ReachError, "t = 0 s"),
    ],
)
def test_what_cannot_be_followed_is_named(make: Any, error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        make()


@given(st.floats(0.0, 3.0))
def test_a_point_out_of_reach_comes_with_its_distance(t: float) -> None:
    path = line([0.2, 0.0, 0.14], [1.0, 0.0, 0.14], 1.0)
    beyond = float(path.at(t).x[0]) - 0.5
    if beyond <= 1e-9:
        reference(path).at(t)
    else:
        with pytest.raises(ReachError) as caught:
            reference(path).at(t)
        assert caught.value.distance == pytest.approx(beyond, abs=1e-9)


def test_an_eased_path_begins_at_rest_and_goes_on_as_the_path_does() -> None:
    circle = Circle([0.3, 0.0, 0.3], 0.1, 6.0)
    eased = Eased(circle, 2.0)
    begin = eased.at(0.0)
    np.testing.assert_array_equal(begin.x, circle.at(0.0).x)
    np.testing.assert_array_equal(begin.v, 0.0)
    np.testing.assert_array_equal(begin.a, 0.0)
    for before, after in zip(eased.at(2.0 - 1e-12), circle.at(1.0), strict=True):
        np.testing.assert_allclose(before, after, atol=1e-9)
    t = np.linspace(0.0, 4.0, 400)
    h = 1e-5
    ahead, now, behind = (eased.at(t + step) for step in (h, 0.0, -h))
    inside = np.abs(t - 2.0) > 2 * h
    np.testing.assert_allclose(((ahead.x - behind.x) / (2 * h))[inside][1:], now.v[inside][1:], atol=1e-9)
    np.testing.assert_allclose(((ahead.v - behind.v) / (2 * h))[inside][1:], now.a[inside][1:], atol=1e-8)
    assert eased.describe()["path"]["type"] == "Circle"
