# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi[robots]"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""A recorded teleoperation, followed: poses at 30 Hz with tremor, late packets and a gap of 0.2 s.

The recording is a CSV of poses. Each pose gets a configuration once, by damped steps with a posture and
joint limits, or by Pink's tasks where Pink is installed; the follower goes there within the arm's limits of
speed, acceleration and jerk, and the controller follows with the tool.
"""

import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin

import armgpi

try:
    import pink
    from pink.tasks import FrameTask, PostureTask
except ImportError:
    pink = None

robot = armgpi.Robot.load("ur5").with_armature(0.5)
start = np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.3])


def record(path: Path) -> None:
    """Write what a hand did: an eight of 0.2 m in 3 s, seen through a network."""
    random = np.random.default_rng(0)
    home = robot.frame_pose(robot.tip, start)
    lines = ["time,x,y,z,qx,qy,qz,qw"]
    for t in np.arange(0.0, 3.0, 1.0 / 30.0):
        if 1.5 <= t < 1.7:
            continue  # the network was away
        ease = min(t, 1.0) ** 2
        aside = ease * np.array([0.0, 0.1 * np.sin(2.0 * t), 0.05 * np.sin(4.0 * t)])
        tremor = 1e-3 * random.normal(size=3)
        turned = pin.exp3(ease * np.array([0.0, 0.0, 0.3 * np.sin(2.0 * t)])) @ home.rotation
        pose = pin.SE3ToXYZQUAT(pin.SE3(turned, home.translation + aside + tremor))
        arrived = t + random.uniform(0.0, 8e-3)
        lines.append(",".join(repr(float(x)) for x in (arrived, *pose)))
    path.write_text("\n".join(lines), encoding="utf-8")


def by_pink(q: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return the configuration of a set-point, as a few steps of Pink's tasks find it."""
    model = robot.pinocchio_model()
    configuration = pink.Configuration(model, model.createData(), q)
    tool, posture = FrameTask(robot.tip, position_cost=1.0, orientation_cost=0.5), PostureTask(cost=1e-3)
    tool.set_target(pin.SE3(rotation, position))
    posture.set_target(start)
    for _ in range(5):
        velocity = pink.solve_ik(configuration, [tool, posture], 0.01, solver="proxqp", safety_break=False)
        configuration.integrate_inplace(velocity, 0.01)
    return configuration.q.copy()


def follow(path: Path, name: str, **given: object) -> None:
    """Simulate the arm along the recording, and say how well its tool followed."""
    stream = armgpi.Setpoints.load(path, robot, robot.tip, start=start, **given)
    plant = armgpi.RigidBodyPlant(robot)
    rollout = armgpi.simulate(plant, armgpi.GPI(robot, dt=1e-3), stream, t_final=3.2, progress=False)
    error = float(armgpi.metrics.tool_error(rollout)[0])
    speed = float(np.abs(rollout["v_ref"] / stream.follower.limits.velocity).max())
    print(
        f"{name}: tool within {error:.1f} mm of what the follower asked, at {speed:.0%} of its speed limits"
    )


with tempfile.TemporaryDirectory() as folder:
    recording = Path(folder) / "teleoperation.csv"
    record(recording)
    limits = armgpi.FollowLimits.of(robot, torque_rate=robot.limits.effort / 0.1)
    print(f"jerk limits [rad/s^3]: {np.round(limits.jerk)}")
    follow(recording, "damped steps", limits=limits)
    follow(recording, "with the poses' own speed", limits=limits, feedforward=True)
    if pink is not None:
        follow(recording, "Pink's tasks", limits=limits, inverse=by_pink)
    else:
        print("Pink's tasks: left out, as Pink is not installed (pip install pin-pink proxsuite)")
print("a gap of 0.2 s and 1 mm of tremor moved the arm within its limits")
