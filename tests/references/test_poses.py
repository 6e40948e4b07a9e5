"""Paths of poses: through every pose, derivatives by differences, and joints that carry the frame there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import armgpi
from armgpi.errors import ArmgpiError, ArrayError, ParameterError, ReachError, UnreadableTrajectory
from armgpi.references.poses import NUMBERS, as_poses, exponential, jacobian_of_exp, load_poses

HOMES = {
    "ur5": np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.3]),
    "panda": np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]),
}
TIMES = np.array([0.0, 0.5, 1.1, 1.6])


def some_poses(start: pin.SE3, size: float = 0.4) -> list[pin.SE3]:
    random = np.random.default_rng(1)
    found = [start]
    for _ in range(3):
        turn, shift = size * random.normal(size=3), 0.05 * random.normal(size=3)
        found.append(pin.SE3(start.rotation @ pin.exp3(turn), start.translation + shift))
    return found


def start_of(name: str) -> tuple[armgpi.Robot, pin.SE3]:
    fingers = ["panda_finger_joint1", "panda_finger_joint2"] if name == "panda" else ()
    arm = armgpi.Robot.load(name, lock=fingers)
    pose = arm.frame_pose(arm.tip, HOMES[name])
    return arm, pin.SE3(pose.rotation, pose.translation)


def test_it_goes_through_every_pose_and_rests_at_both_ends() -> None:
    poses = some_poses(pin.SE3.Random())
    path = armgpi.PosePath(TIMES + 3.0, poses)
    for t, pose in zip(TIMES, poses, strict=True):
        np.testing.assert_allclose(path.at(t).x, pose.translation, atol=1e-12)
        np.testing.assert_allclose(path.turning(t).rotation, pose.rotation, atol=1e-10)
    for t in (0.0, TIMES[-1], 9.0):
        for part in (*path.at(t)[1:], *path.turning(t)[1:]):
            np.testing.assert_allclose(part, 0.0, atol=1e-8)


def test_velocities_and_accelerations_are_the_derivatives() -> None:
    path = armgpi.PosePath(TIMES, some_poses(pin.SE3.Random(), size=0.9))
    h = 1e-5
    for t in np.linspace(0.05, 1.55, 17):
        before, now, after = (path.turning(t + k * h) for k in (-1, 0, 1))
        omega = pin.log3(after.rotation @ before.rotation.T) / (2.0 * h)
        np.testing.assert_allclose(now.omega, omega, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(now.alpha, (after.omega - before.omega) / (2.0 * h), rtol=1e-4, atol=1e-4)
        points = [path.at(t + k * h) for k in (-1, 0, 1)]
        np.testing.assert_allclose(points[1].v, (points[2].x - points[0].x) / (2.0 * h), atol=1e-6)


def test_exponential_and_its_jacobian_are_pinocchios() -> None:
    random = np.random.default_rng(2)
    for size in (0.0, 1e-7, 1e-3, 0.9, 3.0, 5.0):
        r = random.normal(size=3)
        r = size * r / np.linalg.norm(r)
        np.testing.assert_allclose(exponential(r), pin.exp3(r), atol=1e-14)
        np.testing.assert_allclose(jacobian_of_exp(r), pin.Jexp3(-r), atol=1e-9)


def test_turns_of_more_than_half_a_turn_are_continued() -> None:
    angles = np.linspace(0.0, 1.5 * np.pi, 7)
    path = armgpi.PosePath(
        np.arange(7.0), [pin.SE3(pin.exp3(np.array([0.0, 0.0, a])), np.zeros(3)) for a in angles]
    )
    speeds = path.turning(np.linspace(0.1, 5.9, 50)).omega
    assert (speeds[:, 2] > 0.0).all()
    with pytest.raises(ParameterError, match="315 degrees"):
        armgpi.PosePath(
            np.arange(9.0),
            [pin.SE3(pin.exp3(np.array([0.0, 0.0, a])), np.zeros(3)) for a in np.linspace(0.0, 6.2, 9)],
        )


@pytest.mark.parametrize("left", [0.0, 1e-16, 1e-7])
def test_a_full_turn_that_ends_as_it_began_is_too_long_and_not_turned_back(left: float) -> None:
    """Quarter turns about z: the last is 90 degrees on; taken for none, it went back by 270."""
    half = np.deg2rad([0.0, 45.0, 90.0, 135.0, 0.0])
    poses = np.zeros((5, 7))
    poses[:, 5], poses[:, 6] = np.sin(half), np.cos(half)
    poses[-1, 3] = left
    with pytest.raises(ParameterError, match="315 degrees"):
        armgpi.PosePath(np.arange(5.0), poses)
    back = armgpi.PosePath(np.arange(3.0), poses[[0, 1, 4]])  # a quarter turn there, and back
    turns = np.linalg.norm(back._parts(np.linspace(0.0, 2.0, 50))[0][:, 3:], axis=-1)
    assert turns.max() < np.deg2rad(100.0)


@pytest.mark.parametrize("name", HOMES)
def test_joints_carry_the_frame_through_the_poses(name: str) -> None:
    arm, start = start_of(name)
    path = armgpi.PosePath(TIMES, some_poses(start))
    reference = armgpi.CartesianReference(arm, arm.tip, path)
    model = arm.pinocchio_model()
    data, frame = model.createData(), model.getFrameId(arm.tip)
    h = 1e-5
    for t in np.linspace(0.0, 1.6, 9):
        target = reference.at(t)
        pin.forwardKinematics(model, data, target.q, target.v, target.a)
        pin.updateFramePlacements(model, data)
        np.testing.assert_allclose(data.oMf[frame].translation, path.at(t).x, atol=1e-9)
        np.testing.assert_allclose(data.oMf[frame].rotation, path.turning(t).rotation, atol=1e-9)
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(twist.linear, path.at(t).v, atol=1e-8)
        np.testing.assert_allclose(twist.angular, path.turning(t).omega, atol=1e-8)
        motion = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(motion.linear, path.at(t).a, atol=1e-6)
        np.testing.assert_allclose(motion.angular, path.turning(t).alpha, atol=1e-4)
        if 0.0 < t < 1.6:
            before, after = reference.at(t - h), reference.at(t + h)
            np.testing.assert_allclose(target.v, (after.q - before.q) / (2.0 * h), atol=1e-5)


def test_the_arm_follows_a_path_of_poses_within_millimetres() -> None:
    arm, start = start_of("ur5")
    real = arm.with_armature(0.5)
    path = armgpi.PosePath(TIMES, some_poses(start))
    reference = armgpi.CartesianReference(arm, arm.tip, path)
    rollout = armgpi.simulate(armgpi.RigidBodyPlant(real), armgpi.GPI(real, dt=1e-3), reference, 1.8)
    assert float(armgpi.metrics.tool_error(rollout)[0]) < 5.0
    np.testing.assert_allclose(rollout["tool_ref"].values[-1], path.at(9.0).x, atol=1e-9)


def test_files_of_poses_are_read_alike(tmp_path: Path) -> None:
    import xarray as xr

    poses = some_poses(pin.SE3.Random())
    numbers = np.array([pin.SE3ToXYZQUAT(pose) for pose in poses])
    rows = [",".join(("time", *NUMBERS))]
    rows += [",".join(repr(float(x)) for x in (t, *row)) for t, row in zip(TIMES, numbers, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    xr.Dataset(
        {name: ("time", column) for name, column in zip(NUMBERS, numbers.T, strict=True)}, {"time": TIMES}
    ).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    for name in ("a.csv", "a.nc"):
        times, found = load_poses(tmp_path / name)
        np.testing.assert_array_equal(times, TIMES)
        for i, pose in enumerate(poses):
            np.testing.assert_allclose(found.positions[i], pose.translation, atol=1e-12)
            np.testing.assert_allclose(found.rotations[i], pose.rotation, atol=1e-12)


BAD = {
    "a quaternion of norm 0": (
        lambda: as_poses(np.array([[0, 0, 0, 0, 0, 0, 1.0], [1, 2, 3, 0, 0, 0, 0.0]])),
        r"pose 1: expected a quaternion qx, qy, qz, qw of norm 1; it has norm 0",
    ),
    "no rotation": (lambda: as_poses([np.diag([2.0, 1.0, 1.0, 1.0])]), "pose 0: expected a rotation matrix"),
    "a reflection": (lambda: as_poses([np.diag([1.0, 1.0, -1.0, 1.0])]), "pose 0: .*; it is a reflection"),
    "transposed": (
        lambda: as_poses([np.eye(4), pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.25])).homogeneous.T]),
        r"pose 1: .* last row 0, 0, 0, 1, not transposed; got 0.5, 0, 0.25, 1",
    ),
    "another shape": (lambda: as_poses(np.zeros((2, 6))), "expected pinocchio.SE3 poses"),
    "times that run back": (
        lambda: armgpi.PosePath([0.0, 1.0, 0.5], [pin.SE3.Identity()] * 3),
        r"pose 2 is at 0.5 s, after 1 s",
    ),
    "one pose": (lambda: armgpi.PosePath([0.0], [pin.SE3.Identity()]), "at least two poses"),
}


def test_poses_are_a_copy_of_what_the_caller_has() -> None:
    matrices = np.tile(np.eye(4), (2, 1, 1))
    found = as_poses(matrices)
    matrices[:, :3] = 7.0
    np.testing.assert_array_equal(found.positions, np.zeros((2, 3)))
    np.testing.assert_array_equal(found.rotations, np.tile(np.eye(3), (2, 1, 1)))


@pytest.mark.parametrize("case", BAD)
def test_bad_poses_are_refused_in_a_line(case: str) -> None:
    call, said = BAD[case]
    with pytest.raises(ArrayError, match=said):
        call()


def test_bad_files_of_poses_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,x,y\n0,1,2\n")
    with pytest.raises(UnreadableTrajectory, match="has no 'z'"):
        load_poses(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("time," + ",".join(NUMBERS) + "\n0,0,0,0,0,0,0,0\n")
    with pytest.raises(UnreadableTrajectory, match="pose 0: expected a quaternion"):
        load_poses(tmp_path / "b.csv")
    for name in ("none.csv", "none.nc", "none.mcap"):
        with pytest.raises(ArmgpiError):
            load_poses(tmp_path / name)


def test_a_path_of_poses_needs_an_inverse_that_holds_its_rotation() -> None:
    arm, start = start_of("ur5")
    path = armgpi.PosePath(TIMES, some_poses(start))
    with pytest.raises(ParameterError, match="or none for a path of poses"):
        armgpi.CartesianReference(arm, arm.tip, path, armgpi.TrackingInverse(arm, arm.tip))


def test_a_pose_out_of_reach_is_named_by_its_number() -> None:
    robot, start = start_of("ur5")
    poses = some_poses(start, size=0.1)
    poses[2] = pin.SE3(poses[2].rotation, start.translation + np.array([0.0, 0.0, 3.0]))
    path = armgpi.PosePath(TIMES, poses)
    reference = armgpi.CartesianReference(robot, robot.tip, path)
    with pytest.raises(ReachError, match=r"t = .* s \(between poses 1 and 2\)"):
        reference.at(np.linspace(0.0, path.t_end, 50))


def misses_of_ur5(pose: pin.SE3) -> float:
    """Return how far a pose of `tool0` is outside the reach of UR5's two long links [m], in closed form.

    Joints 2, 3 and 4 are parallel: joint 1 turns their normal until the wrist is beside it by d4, joint 5 is
    across that normal and the tool's axis, and joint 4 has to be within both links' lengths of the shoulder.
    Lengths are those that Universal Robots publishes.
    """
    height, upper, fore, d4, d5, d6 = 0.089159, 0.425, 0.39225, 0.10915, 0.09465, 0.0823
    tool_axis = pose.rotation[:, 2]
    wrist = pose.translation - d6 * tool_axis
    around = np.arctan2(wrist[1], wrist[0])
    opening = np.arccos(d4 / np.hypot(wrist[0], wrist[1]))
    misses = []
    for angle in (around + opening, around - opening):
        normal = np.array([np.cos(angle), np.sin(angle), 0.0])
        across = np.cross(normal, tool_axis)
        across *= d5 / np.linalg.norm(across)
        for sign in (1.0, -1.0):
            in_plane = wrist - d4 * normal - sign * across - np.array([0.0, 0.0, height])
            misses.append(float(np.linalg.norm(in_plane)) - upper - fore)
    return min(misses)


@pytest.mark.parametrize(("axis", "angle"), [(0, -2.0), (1, 2.0), (2, 2.0)])
def test_a_path_that_turns_out_of_reach_is_said_to_do_so(axis: int, angle: float) -> None:
    """Its point stays within reach in the rotation of the beginning: that of the pose counts."""
    robot = armgpi.Robot.load("ur5")
    start = robot.frame_pose("tool0", np.array([0.3, -0.25, 0.3, -0.4, 1.2, 0.0]))
    turns = [pin.exp3(np.eye(3)[axis] * part) for part in np.linspace(0.0, angle, 6)]
    poses = [pin.SE3(turn @ start.rotation, start.translation) for turn in turns]
    path = armgpi.PosePath(np.linspace(0.0, 4.0, 6), poses)
    with pytest.raises(ReachError, match=r"t = .* does not reach .* m: the nearest") as raised:
        armgpi.CartesianReference(robot, "tool0", path).at(np.linspace(0.0, 4.0, 9))
    found = re.search(r"t = ([0-9.]+) s", str(raised.value))
    assert found is not None
    t = float(found[1])
    before, after = (pin.SE3(path.turning(t + dt).rotation, path.at(t + dt).x) for dt in (-0.02, 0.02))
    assert misses_of_ur5(poses[0]) < misses_of_ur5(before) < 0.0 < misses_of_ur5(after)
    assert raised.value.distance > 0.0
    assert "near=" not in str(raised.value)
