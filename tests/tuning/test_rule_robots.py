"""Robots nobody tuned for: default gains, coarse sensors, a wrong inertia matrix and an unknown load."""

from __future__ import annotations

import numpy as np
import pytest

from armgpi import GPI, Encoder, RigidBodyPlant, Robot, RobotBatch, Saturated, Waypoints, metrics, simulate

COUNT = 2.0 * np.pi / 2**16


@pytest.mark.parametrize(
    ("name", "lock"), [("panda", ["panda_finger_joint1", "panda_finger_joint2"]), ("ur5", [])]
)
def test_default_gains_track_with_a_wrong_inertia_and_an_unknown_quarter_of_a_kilogram(
    name: str, lock: list[str]
) -> None:
    robot = Robot.load(name, lock=lock)
    start = robot.middle()
    goal = start + 0.5 * (robot.limits.upper - start).clip(max=1.0)
    reference = Waypoints([start, goal, start], durations=2.0, holds=[1.0, 1.0, 2.0])
    nominal = RobotBatch([robot.scaled_inertia(scale) for scale in (0.8, 1.0, 1.2)])
    plant = Encoder(Saturated(RigidBodyPlant(robot.with_payload(robot.tip, mass=0.25))), bits=16)
    rollout = simulate(plant, GPI(nominal, dt=1e-3), reference, t_final=8.0)
    assert (rollout["status"] == 0).all()
    assert (metrics.limit_excess(rollout) == 0.0).all()
    assert (metrics.saturated_time(rollout) == 0.0).all()
    # The load and the wrong D are a disturbance of some 1 rad/s^2 against omega_c^2 = 900 / s^2.
    assert float(metrics.peak_error(rollout).max()) < 0.01
    # At rest the integrators leave what the encoder does not show: a count.
    assert float(metrics.final_error(rollout).max()) < COUNT
