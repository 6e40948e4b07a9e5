"""Metrics of the tool against Pinocchio's kinematics and closed forms of springs and walls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr

import armgpi
from armgpi.loop import metrics
from armgpi.loop.tool import Tool, angle_of, most_apart
from armgpi.robot.kinematics import random_configurations

TOOL = ("tool_error", "tool_angle", "peak_force", "final_force")
Q0 = np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.3])


@pytest.fixture(scope="module")
def arm() -> armgpi.Robot:
    return armgpi.Robot.load("ur5").with_armature(0.5)


def run(arm: armgpi.Robot, environment: Any = (), t_final: float = 0.4, **how: Any) -> xr.Dataset:
    plant = armgpi.RigidBodyPlant(arm, environment=environment)
    move = armgpi.Bezier(Q0, Q0 + 0.15, 0.3)
    return armgpi.simulate(plant, armgpi.GPI(arm, dt=1e-3), move, t_final, **how)


def poses(arm: armgpi.Robot, q: np.ndarray) -> list[pin.SE3]:
    model = arm.pinocchio_model()
    data, frame = model.createData(), model.getFrameId(arm.tip)
    found = []
    for row in q:
        pin.framesForwardKinematics(model, data, row)
        found.append(data.oMf[frame].copy())
    return found


def test_the_error_is_that_of_pinocchios_poses(arm: armgpi.Robot) -> None:
    rollout = run(arm)
    pairs = list(zip(poses(arm, rollout["q"].values), poses(arm, rollout["q_ref"].values), strict=True))
    away = [1e3 * float(np.linalg.norm(a.translation - b.translation)) for a, b in pairs]
    turned = [math.degrees(np.linalg.norm(pin.log3(a.rotation.T @ b.rotation))) for a, b in pairs]
    np.testing.assert_allclose(metrics.tool_error(rollout), max(away), rtol=1e-9)
    np.testing.assert_allclose(metrics.tool_angle(rollout), max(turned), rtol=1e-7)
    np.testing.assert_allclose(rollout["tool"].values, [a.translation for a, _ in pairs], atol=1e-12)
    assert max(away) > 1e-3


@pytest.mark.parametrize("how", [{}, {"record": "metrics"}])
def test_metrics_are_of_the_frame_that_was_asked_for(arm: armgpi.Robot, how: dict[str, Any]) -> None:
    frame = "wrist_1_link"
    plant = armgpi.RigidBodyPlant(arm, metrics_frame=frame)
    move = armgpi.Bezier(Q0, Q0 + 0.15, 0.3)
    whole = armgpi.simulate(plant, armgpi.GPI(arm, dt=1e-3), move, 0.4)
    places = [arm.frame_pose(frame, whole[name].values).translation for name in ("q", "q_ref")]
    away = 1e3 * float(np.linalg.norm(places[0] - places[1], axis=-1).max())
    found = metrics.tool_error(whole)
    if how:
        loop = armgpi.prepare(plant, armgpi.GPI(arm, dt=1e-3), move, 0.4, **how)
        found = loop.run()["tool_error"]
    np.testing.assert_allclose(found, away, rtol=1e-9)
    assert frame in str(whole["tool"].attrs)


@pytest.mark.parametrize(("frame", "said"), [("nope", "no frame named"), ("base_link", "a joint moves")])
def test_a_frame_of_metrics_that_does_not_move_is_refused(arm: armgpi.Robot, frame: str, said: str) -> None:
    with pytest.raises(armgpi.ArmgpiError, match=said):
        armgpi.RigidBodyPlant(arm, metrics_frame=frame)


def test_angles_of_rotations_are_pinocchios() -> None:
    random = np.random.default_rng(0)
    for size in (1e-6, 0.1, 1.0, 3.1):
        axis = random.normal(size=3)
        turned = pin.exp3(size * axis / np.linalg.norm(axis))
        norm = np.sum((turned - np.eye(3)) ** 2)
        np.testing.assert_allclose(angle_of(norm), size, rtol=1e-6)


def test_the_force_is_that_of_the_spring_at_every_sample(arm: armgpi.Robot) -> None:
    home = arm.frame_pose(arm.tip, Q0).translation
    spring = armgpi.Spring(anchor=home, stiffness=300.0, damping=0.0)
    rollout = run(arm, [spring])
    lengths = np.array([np.linalg.norm(pose.translation - home) for pose in poses(arm, rollout["q"].values)])
    np.testing.assert_allclose(metrics.peak_force(rollout), 300.0 * lengths.max(), rtol=1e-9)
    np.testing.assert_allclose(metrics.final_force(rollout), 300.0 * lengths[-1], rtol=1e-9)
    force = np.linalg.norm(rollout["contact_force"].isel(contact=0).values, axis=-1)
    np.testing.assert_allclose(force, 300.0 * lengths, atol=1e-9)


def test_of_several_contacts_the_largest_counts(arm: armgpi.Robot) -> None:
    pushes = [
        armgpi.ToolForce(force=[0.0, 3.0, 4.0], onset=0.05, end=0.1),
        armgpi.ToolForce(force=[0.0, 0.0, -4.5], onset=0.05),
    ]
    rollout = run(arm, pushes, t_final=0.2)
    np.testing.assert_allclose(metrics.peak_force(rollout), 5.0)
    np.testing.assert_allclose(metrics.final_force(rollout), 4.5)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_a_loop_without_trajectories_has_the_same(arm: armgpi.Robot, backend: str) -> None:
    home = arm.frame_pose(arm.tip, Q0).translation
    wall = armgpi.Wall(normal=[0.0, 0.0, 1.0], distance=float(home[2]) - 0.01, stiffness=5e3, damping=50.0)
    whole = metrics.summary(run(arm, [wall]))
    plant = armgpi.RigidBodyPlant(arm, environment=[wall])
    move = armgpi.Bezier(Q0, Q0 + 0.15, 0.3)
    loop = armgpi.prepare(plant, armgpi.GPI(arm, dt=1e-3), move, 0.4, record="metrics", backend=backend)
    found = loop.run()
    for name in TOOL:
        np.testing.assert_allclose(found[name], whole[name], rtol=1e-7, err_msg=name)
    assert float(found["peak_force"].max()) > 1.0


def test_a_batch_has_those_of_its_rollouts(arm: armgpi.Robot) -> None:
    move = armgpi.Bezier(np.stack([Q0, Q0 + 0.1]), np.stack([Q0 + 0.15, Q0 + 0.05]), 0.3)
    push = armgpi.ToolForce(force=[10.0, 0.0, 0.0], onset=0.1)
    plant = armgpi.RigidBodyPlant(arm, environment=[push])
    both = armgpi.simulate(plant, armgpi.GPI(arm, dt=1e-3), move, 0.3)
    assert both["tool"].dims == ("rollout", "time", "axis")
    table = metrics.summary(both)
    for i in range(2):
        one = metrics.summary(both.isel(rollout=i))
        for name in TOOL:
            np.testing.assert_allclose(table[name][i], one[name], rtol=1e-12)
    assert float(table["tool_error"][0, 0]) != float(table["tool_error"][1, 0])


def test_behind_encoders_at_the_motor_the_error_is_of_the_link() -> None:
    # Gravity twists the gears: the motors hold the target, and the tool hangs below it.
    arm = armgpi.assume_drives(armgpi.Robot.load("ur5"))
    plant = armgpi.ElasticPlant(arm)
    at_rest = armgpi.Hold(Q0)
    rollout = armgpi.simulate(plant, armgpi.GPI.auto(arm, dt=1e-3), at_rest, 0.3)
    link = poses(arm, rollout["q"].values)[0].translation
    wished = arm.frame_pose(arm.tip, Q0).translation
    sunk = 1e3 * float(np.linalg.norm(link - wished))
    assert sunk > 0.05
    assert float(metrics.tool_error(rollout).max()) >= sunk * (1.0 - 1e-9)


def test_a_rollout_of_which_no_tool_is_known_has_no_number(arm: armgpi.Robot) -> None:
    rollout = run(arm).drop_vars(["tool", "tool_ref", "tool_turn"])
    for name in TOOL:
        assert np.isnan(getattr(metrics, name)(rollout)).all()


def test_what_nothing_touches_has_no_force(arm: armgpi.Robot) -> None:
    rollout = run(arm)
    assert "contact_force" not in rollout
    assert (metrics.peak_force(rollout) == 0.0).all()
    assert (metrics.final_force(rollout) == 0.0).all()


def test_the_static_deflection_is_how_far_links_hang_below_their_motors() -> None:
    arm = armgpi.assume_drives(armgpi.Robot.load("ur5"))
    plant = armgpi.ElasticPlant(arm, encoder_side="motor")
    # In the balance K (theta - q) = G(q) of the links q below encoders at Q0.
    link = Q0.copy()
    for _ in range(50):
        link = Q0 - arm.gravity(link) / plant.gear_stiffness
    wished, there = poses(arm, np.stack([Q0, link]))
    sunk = 1e3 * float(np.linalg.norm(wished.translation - there.translation))
    assert plant.static_deflection(Q0) == pytest.approx(sunk, rel=1e-6)
    assert armgpi.ElasticPlant(arm, encoder_side="link").static_deflection(Q0) == 0.0


@pytest.mark.parametrize("name", ["ur5", "panda", "xarm7"])
@pytest.mark.parametrize("size", [1e-6, 1e-3, 0.3])
def test_no_tool_is_farther_off_than_the_errors_of_its_joints_allow(name: str, size: float) -> None:
    robot = armgpi.Robot.load(name, lock=["panda_finger_joint1"] if name == "panda" else ())
    tool = Tool(armgpi.RigidBodyPlant(robot))
    assert tool.motion is not None
    wished = random_configurations(robot, 500, seed=3)
    q = wished + np.random.default_rng(4).normal(0.0, size, wished.shape)
    sample = tool.at(q, 0.0 * q, wished, 0.0)
    most = most_apart(tool.motion, q, wished)
    assert most is not None
    assert np.all(sample.offset <= most[0])
    assert np.all(sample.turn <= most[1])
    # One joint alone turns the tool by its own error.
    alone = wished.copy()
    alone[:, 0] += 0.5 * size
    one = most_apart(tool.motion, alone, wished)
    assert one is not None
    turned = tool.at(alone, 0.0 * q, wished, 0.0).turn
    np.testing.assert_allclose(angle_of(turned), np.sqrt(one[1] / 2.0), rtol=0.01 + 1e-8 / size)


def test_what_cannot_be_the_largest_is_left_out_and_changes_no_metric(arm: armgpi.Robot) -> None:
    starts = Q0 + np.random.default_rng(5).normal(0.0, 0.01, (11, 6))
    plant = armgpi.RigidBodyPlant(arm)
    move = armgpi.Bezier(Q0, Q0 + 0.15, 0.3)
    how: dict[str, Any] = {"q0": starts, "backend": "compiled"}
    whole = armgpi.simulate(plant, armgpi.GPI(arm, dt=1e-3), move, 1.0, **how)
    prepared = armgpi.prepare(
        plant, armgpi.GPI(arm, dt=1e-3), move, 1.0, record="metrics", backend="compiled"
    )
    found = prepared.run(q0=starts)
    for name in ("tool_error", "tool_angle"):
        wanted = getattr(metrics, name)(whole)
        np.testing.assert_allclose(found[name].values, wanted.values, rtol=1e-9)
