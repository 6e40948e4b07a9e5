"""Any arm follows a path: exactly, smoothly, inside its limits, or says where it cannot."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from armgpi import GPI, CartesianReference, RigidBodyPlant, Robot, TrackingInverse, simulate
from armgpi.errors import ArmgpiError, ArrayError, LimitError, ParameterError, ReachError
from armgpi.paper.arm import PaperArm
from armgpi.references.paths import Circle, Lissajous, Path, line

ARM = Robot.load("anthropomorphic3")
UR5 = Robot.load("ur5")
PANDA = Robot.load("panda", lock=["panda_finger_joint1", "panda_finger_joint2"])
CURVE = Lissajous([0.45, 0.1, 0.4], [0.08, 0.15, 0.1], [1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
CURVE_OF_THREE = Circle([0.25, 0.0, 0.3], 0.1, 4.0)
TIMES = np.linspace(0.0, 4.0, 150)

#: Robot, frame, what else is held, by how many equations.
FOLLOWERS: dict[str, tuple[Robot, str, dict[str, Any]]] = {
    "ur5": (UR5, "ee_link", {}),
    "ur5 tool down": (UR5, "ee_link", {"direction": [0.0, 0.0, -1.0], "tool_axis": [1.0, 0.0, 0.0]}),
    "ur5 rotation": (UR5, "tool0", {"rotation": np.diag([1.0, -1.0, -1.0])}),
    "panda": (PANDA, "panda_hand_tcp", {}),
    "panda tool down": (PANDA, "panda_hand_tcp", {"direction": [0.0, 0.0, -1.0]}),
    "panda rotation": (PANDA, "panda_hand_tcp", {"rotation": np.diag([1.0, -1.0, -1.0])}),
}
each_follower = pytest.mark.parametrize("name", FOLLOWERS)


def follow(robot: Robot, frame: str, path: Path, **held: Any) -> CartesianReference:
    return CartesianReference(robot, frame, path, TrackingInverse(robot, frame, **held))


@cache
def follower(name: str) -> CartesianReference:
    """One of those arms on the curve; integrated once."""
    robot, frame, held = FOLLOWERS[name]
    return follow(robot, frame, CURVE, **held)


@each_follower
def test_the_frame_is_on_the_path_inside_the_limits(name: str) -> None:
    robot, frame, held = FOLLOWERS[name]
    target, point = follower(name).at(TIMES), CURVE.at(TIMES)
    pose = robot.frame_pose(frame, target.q)
    np.testing.assert_allclose(pose.translation, point.x, atol=1e-9)
    robot.check_position(target.q, "path")
    jacobian = robot.frame_jacobian(frame, target.q)
    moved = np.einsum("kij,kj->ki", jacobian, target.v)
    np.testing.assert_allclose(moved[:, :3], point.v, atol=1e-11)
    sped = np.einsum("kij,kj->ki", jacobian, target.a) + robot.frame_drift(frame, target.q, target.v)
    np.testing.assert_allclose(sped[:, :3], point.a, atol=1e-10)
    if "rotation" in held:
        np.testing.assert_allclose(pose.rotation, np.tile(held["rotation"], (150, 1, 1)), atol=1e-9)
        np.testing.assert_allclose(moved[:, 3:], 0.0, atol=1e-11)
    if "direction" in held:
        axis = np.array(held.get("tool_axis", [0.0, 0.0, 1.0]))
        np.testing.assert_allclose(pose.rotation @ axis, np.tile(held["direction"], (150, 1)), atol=1e-9)


@pytest.mark.slow
@each_follower
def test_velocity_and_acceleration_are_derivatives_of_position(name: str) -> None:
    h, reference = 1e-4, follower(name)
    # Also across the nodes of the integration, which are 0.01 s apart.
    times = np.sort(np.concatenate([TIMES + 0.0123, np.arange(0.01, 1.0, 0.01)]))
    before, now, after = (reference.at(times + dt) for dt in (-h, 0.0, h))
    # Central differences: h^2 of the third derivative, some 30 rad/s^3, and rounding over h.
    np.testing.assert_allclose((after.q - before.q) / (2 * h), now.v, atol=1e-6)
    np.testing.assert_allclose((after.v - before.v) / (2 * h), now.a, atol=1e-5)


def test_without_joints_to_spare_it_is_the_closed_form() -> None:
    path = Circle([0.25, 0.0, 0.3], 0.1, 4.0, normal=[1.0, 0.5, 2.0])
    closed = CartesianReference(ARM, "tool", path, PaperArm().inverse_kinematics).at(TIMES)
    ours = follow(ARM, "tool", path, near=closed.q[0]).at(TIMES)
    np.testing.assert_allclose(ours.q, closed.q, atol=1e-12)
    np.testing.assert_allclose(ours.v, closed.v, atol=1e-11)
    np.testing.assert_allclose(ours.a, closed.a, atol=1e-10)


def test_the_answer_depends_on_no_question_before() -> None:
    late = follow(PANDA, "panda_hand_tcp", CURVE).at(3.0)
    many = follow(PANDA, "panda_hand_tcp", CURVE)
    early = many.at(0.5)
    assert early.q.shape == (7,)
    backwards = many.at(TIMES[::-1])
    np.testing.assert_array_equal(many.at(3.0).q, late.q)
    np.testing.assert_array_equal(many.at(0.5).q, early.q)
    np.testing.assert_allclose(backwards.q[::-1], many.at(TIMES).q, atol=1e-12)


@pytest.mark.slow
def test_joints_to_spare_come_back_to_where_the_path_began() -> None:
    path = Circle([0.45, 0.0, 0.4], 0.1, 5.0)
    reference = follow(PANDA, "panda_hand_tcp", path, rate=5.0)
    turns = reference.at(5.0 * np.arange(5))
    # The flow without the pull drifts from turn to turn; with it every turn is the same.
    assert np.abs(np.diff(turns.q[2:], axis=0)).max() < 1e-4


def test_a_path_begins_in_the_posture_nearest_to_the_one_asked_for() -> None:
    left = np.array([0.3, -1.0, 1.2, -1.5, -1.5, 0.0])
    path = line(UR5.frame_pose("ee_link", left).translation, [0.5, 0.3, 0.5], 2.0)
    near = follow(UR5, "ee_link", path, near=left + 0.01).at(0.0).q
    np.testing.assert_allclose(near, left, atol=0.03)


def test_sliding_joints_follow_too() -> None:
    gantry = Robot.from_xml(_gantry())
    path = Lissajous([0.1, 0.2, 0.3], [0.3, 0.4, 0.1], [1.0, 2.0, 1.5])
    target = follow(gantry, "z_body", path).at(TIMES)
    point = path.at(TIMES)
    for ours, theirs in zip(target, point, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_gpi_carries_a_ur5_along_the_curve() -> None:
    reference = follow(UR5, "ee_link", CURVE, **FOLLOWERS["ur5 tool down"][2])
    rollout = simulate(RigidBodyPlant(UR5), GPI(UR5, 1e-3), reference, 3.0)
    tool = UR5.frame_pose("ee_link", rollout["q"].values).translation
    missed = np.linalg.norm(tool - CURVE.at(rollout["time"].values).x, axis=-1)
    # It starts at rest on a moving target, at 0.5 m/s; then only the ramp-like change of its pull is left.
    assert missed[1000:].max() < 1e-3
    assert "TrackingInverse" in rollout.attrs["provenance"]


@pytest.mark.parametrize(
    ("make", "error", "named"),
    [
        (lambda: follow(UR5, "ee_link", line([2.0, 0, 0.2], [0.5, 0, 0.2], 1.0)), ReachError, "misses it by"),
        (
            lambda: follow(UR5, "ee_link", line([0.5, 0.1, 0.2], [2.0, 0.1, 0.2], 1.0)).at(1.0),
            ReachError,
            "the path at t = 0.",
        ),
        (
            lambda: follow(
                ARM.with_limits(upper={"q1": 0.5}), "tool", Circle([0, 0, 0.3], 0.25, 3.0), near=np.zeros(3)
            ).at(TIMES),
            LimitError,
            "on the path at t = 0.* of joint 'q1'",
        ),
        (
            lambda: follow(ARM, "tool", line([0.2, 1e-4, 0.3], [-0.2, 1e-4, 0.3], 1.0)).at(1.0),
            ReachError,
            "t = 0.45.* s: .* can be reached, but not from where the path begins",
        ),
        (lambda: follow(ARM, "tool", CURVE_OF_THREE).at(np.nan), ArrayError, "finite"),
        (lambda: follow(UR5, "ee_link", CURVE).at(-0.5), ParameterError, "zero or later"),
        (
            lambda: CartesianReference(UR5, "tool0", CURVE, TrackingInverse(UR5, "ee_link")),
            ParameterError,
            "one for 'tool0' of 'ur5'",
        ),
    ],
)
def test_what_cannot_be_followed_is_named(make: Any, error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        make()


def _gantry() -> str:
    """Three sliding joints along x, y and z."""
    parts = ['<robot name="gantry"><link name="base"/>']
    for parent, name, axis in (
        ("base", "x", "1 0 0"),
        ("x_body", "y", "0 1 0"),
        ("y_body", "z", "0 0 1"),
    ):
        parts.append(
            f'<link name="{name}_body"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
            f'ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="prismatic"><parent link="{parent}"/>'
            f'<child link="{name}_body"/><axis xyz="{axis}"/>'
            '<limit lower="-1" upper="1" effort="100" velocity="10"/></joint>'
        )
    return "".join(parts) + "</robot>"
