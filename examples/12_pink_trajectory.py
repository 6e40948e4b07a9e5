# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi[robots]", "pin-pink", "proxsuite"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""A trajectory that Pink's inverse kinematics plans, as a reference: the tool goes around a circle.

It is checked against the arm's limits before it runs, and an unknown load of 1 kg rides along.
"""

import numpy as np
import pink
import pinocchio as pin
from pink.tasks import FrameTask, PostureTask

import armgpi

STEP, DURATION, RADIUS = 0.01, 4.0, 0.1

robot = armgpi.Robot.load("ur5")
start = np.array([0.0, -1.2, 1.5, -0.3, 0.8, 0.0])


def planned() -> tuple[np.ndarray, np.ndarray]:
    """Return times and joint positions at which the tool is on the circle, as Pink solves for them."""
    model = robot.pinocchio_model()
    configuration = pink.Configuration(model, model.createData(), start)
    tool, posture = FrameTask(robot.tip, position_cost=1.0, orientation_cost=0.2), PostureTask(cost=1e-3)
    tool.set_target_from_configuration(configuration)
    posture.set_target(start)
    home = tool.transform_target_to_world.copy()
    times, path = np.arange(0.0, DURATION + STEP / 2.0, STEP), [start]
    for t in times[1:]:
        angle = np.pi * (1.0 - np.cos(np.pi * t / DURATION))  # gently off, and gently there
        aside = RADIUS * np.array([0.0, np.sin(angle), 1.0 - np.cos(angle)])
        tool.set_target(pin.SE3(home.rotation, home.translation + aside))
        velocity = pink.solve_ik(configuration, [tool, posture], STEP, solver="proxqp")
        configuration.integrate_inplace(velocity, STEP)
        path.append(configuration.q.copy())
    return times, np.array(path)


reference = armgpi.Recorded(*planned(), source="Pink")
reference.check(robot)  # positions and velocities against the URDF's limits
print(f"{reference!r}: within the limits of {robot.name}")

plant = armgpi.RigidBodyPlant(robot.with_payload(robot.tip, mass=1.0))
rollout = armgpi.simulate(plant, armgpi.GPI(robot, dt=1e-3), reference, t_final=4.5, progress=False)
print("peak error of each joint [rad]:", armgpi.metrics.peak_error(rollout).values.round(4))
paths = [robot.frame_pose(robot.tip, rollout[name].values).translation for name in ("q", "q_ref")]
print(f"the tool is within {1e3 * np.linalg.norm(paths[0] - paths[1], axis=1).max():.2f} mm of Pink's path")
print(f"it went around a circle of {2e3 * RADIUS:.0f} mm in {DURATION:g} s")
