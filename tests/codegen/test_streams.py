"""Streams of poses as C: to 1e-9 those of Python, whatever arrives, in single runs and in batches."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import armgpi
from armgpi.references.following import SetpointInverse, Setpoints

pytest.importorskip("casadi", reason="casadi writes the C")
from armgpi.codegen import build, following
from armgpi.errors import BackendError

try:
    build.compiler()
except BackendError:
    pytest.skip("there is no C compiler", allow_module_level=True)

#: Arms with six and seven joints, and one whose first joint slides.
ARMS = {
    "ur5": np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.3]),
    "panda": np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]),
    "rail": np.array([0.1, 0.5, -0.8, 0.6]),
}
RAIL = """<robot name="rail"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
<link name="d"/>{joints}</robot>"""
INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def arm_of(name: str) -> armgpi.Robot:
    if name == "rail":
        kinds = ("prismatic", "revolute", "revolute", "revolute")
        axes = ("1 0 0", "0 0 1", "0 1 0", "0 1 0.2")
        joints = [
            f'<joint name="j{i}" type="{kind}"><parent link="{a}"/><child link="{b}"/><axis xyz="{axis}"/>'
            f'<origin xyz="0.1 0 0.3" rpy="0.2 0 0.1"/>'
            '<limit lower="-2" upper="2" velocity="2" effort="50"/></joint>'
            for i, (kind, axis, (a, b)) in enumerate(
                zip(kinds, axes, (("base", "a"), ("a", "b"), ("b", "c"), ("c", "d")), strict=True)
            )
        ]
        text = RAIL.format(joints="".join(joints))
        for link in "abcd":
            text = text.replace(f'<link name="{link}"/>', f'<link name="{link}">{INERTIAL}</link>')
        return armgpi.Robot.from_xml(text)
    if name not in armgpi.robots.names():
        pytest.skip("the robots extra is not installed")
    fingers = ["panda_finger_joint1", "panda_finger_joint2"] if name == "panda" else ()
    return armgpi.Robot.load(name, lock=fingers).with_armature(0.4)


def arriving(arm: armgpi.Robot, q: np.ndarray, seed: int, kind: str) -> tuple[np.ndarray, list[pin.SE3]]:
    """Poses with noise and jitter: smooth, with jumps and a gap, far out of reach, or through the base."""
    random = np.random.default_rng(seed)
    start = arm.frame_pose(arm.tip, q)
    times, poses = [], []
    for i in range(60):
        t = i / 30.0
        if kind == "gap and jump" and 0.8 <= t < 1.0:
            continue
        shift = 0.1 * np.sin(np.array([1.3, 1.9, 1.1]) * t) + 1e-3 * random.normal(size=3)
        turn = 0.3 * np.sin(np.array([1.1, 0.9, 1.3]) * t) + 3e-3 * random.normal(size=3)
        if kind == "gap and jump" and t >= 1.2:
            shift, turn = shift + np.array([0.0, 0.2, 0.0]), turn + np.array([0.0, 0.0, 3.0])
        position = start.translation + shift
        if kind == "out of reach" and 0.4 < t < 1.4:
            position = position + 3.0 * np.array([np.sin(3.0 * t), 1.0, 0.3])
        if kind == "singular":
            position = start.translation * (1.0 - 0.5 * t)
        times.append(t + random.uniform(0.0, 8e-3))
        poses.append(pin.SE3(pin.exp3(turn) @ start.rotation, position))
    return np.array(times), poses


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("kind", ["smooth", "gap and jump", "out of reach", "singular"])
@pytest.mark.parametrize("feedforward", [False, True])
def test_generated_streams_are_those_of_python(name: str, kind: str, feedforward: bool) -> None:
    arm = arm_of(name)
    times, poses = arriving(arm, ARMS[name], len(kind), kind)
    given: Any = {"start": ARMS[name], "feedforward": feedforward}
    python, generated = (Setpoints(arm, arm.tip, times, poses, **given) for _ in range(2))
    following.sample_streams(generated, 2.6)
    grid = np.arange(2600) * 1e-3
    scales: tuple[Any, ...] = (1.0, *(np.asarray(x) for x in python.follower.limits[:2]))
    for mine, theirs, scale in zip(python.at(grid), generated.at(grid), scales, strict=True):
        assert generated.sampled >= len(grid)
        np.testing.assert_allclose(mine / scale, theirs / scale, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_pose_and_jacobian_are_pinocchios(name: str) -> None:
    arm = arm_of(name)
    library = following._library(arm, SetpointInverse(arm, arm.tip))
    random = np.random.default_rng(0)
    for _ in range(20):
        q = np.ascontiguousarray(random.uniform(arm.limits.lower, arm.limits.upper))
        position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, arm.n))
        places = [ctypes.c_void_p(x.ctypes.data) for x in (q, position, rotation, jacobian)]
        library.armgpi_pose(*places[:3])
        library.armgpi_jacobian(places[0], places[3])
        pose = arm.frame_pose(arm.tip, q)
        np.testing.assert_allclose(position, pose.translation, atol=1e-14)
        np.testing.assert_allclose(rotation, pose.rotation, atol=1e-14)
        np.testing.assert_allclose(jacobian, arm.frame_jacobian(arm.tip, q), atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.3, 2.0, np.pi - 1e-3, np.pi - 1e-7])
def test_the_logarithm_undoes_scipys_exponential(angle: float) -> None:
    from scipy.spatial.transform import Rotation

    arm = arm_of("rail")
    library = following._library(arm, SetpointInverse(arm, arm.tip))
    for axis in (*np.eye(3), *-np.eye(3), np.array([0.6, -0.48, 0.64])):
        rotation = np.ascontiguousarray(Rotation.from_rotvec(angle * axis).as_matrix())
        vector = np.empty(3)
        library.armgpi_log3(ctypes.c_void_p(rotation.ctypes.data), ctypes.c_void_p(vector.ctypes.data))
        np.testing.assert_allclose(vector, angle * axis, atol=1e-14 * max(1.0, angle / 1e-2))


def test_a_compiled_batch_follows_a_stream_for_each_rollout(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = arm_of("rail")
    streams = []
    for seed in range(3):
        times, poses = arriving(arm, ARMS["rail"], seed, "smooth")
        streams.append(Setpoints(arm, arm.tip, times, poses, start=ARMS["rail"]))
    law = armgpi.GPI(arm, 1e-3, armgpi.FixedGains(15.0))
    plant = armgpi.RigidBodyPlant(arm)
    alone = [armgpi.simulate(plant, law, stream, 0.5, backend="numpy") for stream in streams]
    again = [Setpoints(arm, arm.tip, stream.times, stream.poses, start=stream.start) for stream in streams]
    grown = []
    monkeypatch.setattr(Setpoints, "_grow", lambda self, count: grown.append((self.sampled, count)))
    together = armgpi.simulate(plant, law, armgpi.ReferenceBatch(again), 0.5, backend="compiled")
    assert all(sampled >= count for sampled, count in grown), grown
    for i, each in enumerate(alone):
        np.testing.assert_allclose(together["q"].isel(rollout=i), each["q"], atol=1e-9)
        np.testing.assert_allclose(together["q_ref"].isel(rollout=i), each["q_ref"], atol=1e-9)
