# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi[robots]"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""Wipe a table with a force that is chosen, without a force sensor: a tool that is soft along the normal.

The tool is a spring of 2,000 N/m along the table and of 200 N/m towards it. Its target lies 25 mm below the
table, so it presses with 5 N, wherever the table is a little higher or lower. The force is estimated from the
torques of the motors.
"""

import numpy as np

import armgpi

bare = armgpi.assume_drives(armgpi.Robot.load("ur5"), "stiff")
friction = armgpi.Friction(0.005 * bare.limits.effort, 0.005 * bare.limits.effort)
robot = bare.with_friction(*friction)
home = np.array([0.0, -1.2, 1.6, -1.97, -1.5708, 0.0])
pose = robot.frame_pose(robot.tip, home)


def reach(x, y, z, near):
    """Return the configuration in which the tool is so far from where it starts [m]."""
    place = pose.translation + np.array([x, y, z])
    return armgpi.inverse_kinematics(robot, robot.tip, place, pose.rotation, near=near).q


# 20 mm down to the table, 25 mm more below it, and three strokes of 160 mm.
above = home
down = reach(0.0, -0.08, -0.045, above)
strokes = [above, down]
for stroke in range(3):
    side = 0.08 if stroke % 2 == 0 else -0.08
    strokes.append(reach(0.0, side, -0.045, strokes[-1]))
move = armgpi.Waypoints(strokes, [1.5, 1.5, 1.5, 1.5], holds=[0.2, 0.5, 0.2, 0.2, 0.5])

table = armgpi.Wall(
    normal=[0.0, 0.0, 1.0], distance=float(pose.translation[2]) - 0.02, stiffness=2e4, damping=50.0
)
arm = armgpi.RigidBodyPlant(robot, friction="urdf", environment=[table])
plant = armgpi.Delayed(armgpi.Encoder(arm, bits=17), samples=1)
soft = armgpi.CartesianImpedance(
    robot,
    dt=1e-3,
    stiffness=[2000.0, 2000.0, 200.0, 100.0, 100.0, 100.0],
    delay=1e-3,
    force_limit=30.0,
    friction_feedforward=True,
)
stiff = armgpi.GPI.auto(robot, 1e-3, delay=1e-3, bits=17, drives="stiff")

print("target 25 mm below the table, 200 N/m towards it: 5 N are meant")
for name, controller in (("spring", soft), ("GPI with integrators", stiff)):
    rollout = armgpi.simulate(plant, controller, move, t_final=7.5, backend="auto")
    wiping = rollout.sel(time=slice(2.5, 7.0))
    force = np.linalg.norm(wiping["contact_force"].values[:, 0], axis=-1)
    print(f"{name}: presses with {force.min():.0f} to {force.max():.0f} N, {force.mean():.0f} N on average")
    if controller is soft:
        estimate = armgpi.tool_wrench(rollout, robot).sel(time=slice(2.5, 7.0))
        low, high = (estimate[f"estimated_force_{end}"].values[:, 2] for end in ("low", "high"))
        true = wiping["contact_force"].values[:, 0, 2]
        inside = ((low <= true) & (true <= high)).mean()
        print(f"the estimated force contains the true one in {100 * inside:.0f} % of the samples")
