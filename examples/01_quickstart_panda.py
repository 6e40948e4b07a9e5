# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi[robots]"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""Panda with a load in its hand that the controller knows nothing of.

The controller gets the URDF, the measured positions and one number per joint, its bandwidth. Gravity,
Coriolis torques and the load are disturbances to it, which its integrators take up.
"""

import armgpi

robot = armgpi.Robot.load("panda", lock=["panda_finger_joint1", "panda_finger_joint2"])
q0 = robot.middle()  # the middle of the joint ranges; at q = 0, joint 4 is outside of its range

controller = armgpi.GPI(robot, dt=1e-3, gains=armgpi.FixedGains(omega_c=20.0))
plant = armgpi.RigidBodyPlant(robot.with_payload("panda_hand", mass=0.25))  # [kg]
reference = armgpi.Bezier(start=q0, goal=q0 + 0.5, duration=3.0)  # [rad], [s]

rollout = armgpi.simulate(plant, controller, reference, t_final=8.0)

# It is an xarray.Dataset: labelled arrays with units, how it ended and what it was made from. It is kept with
# armgpi.save(rollout, "panda.nc") and comes back, identical, from armgpi.load("panda.nc").
print(f"{rollout.attrs['title']}: {armgpi.Status(int(rollout['status'])).name.lower()}")
print(f"{rollout.sizes['time']} samples of {', '.join(rollout.data_vars)}\n")

peak = armgpi.metrics.peak_error(rollout)
final = armgpi.metrics.final_error(rollout)
torque = armgpi.metrics.peak_torque(rollout)
print(f"{'joint':14} {'peak error':>12} {'after 8 s':>12} {'peak torque':>12} {'limit':>7}")
for joint in robot.joint_names:
    print(
        f"{joint:14} {float(peak.sel(joint=joint)):8.5f} rad {float(final.sel(joint=joint)):8.1e} rad "
        f"{float(torque.sel(joint=joint)):8.2f} N m {float(rollout['effort'].sel(joint=joint)):7g}"
    )

# With start="hold" the motors begin with the torque that holds the nominal model.
# So all that it has to find at the start is the load, whose weight moves the joints a little:
drop = abs(rollout["q"] - rollout["q_ref"]).sel(time=slice(0.0, 0.2)).max()
print(f"\nwithin the first 0.2 s the load pulls a joint off by at most {float(drop):.5f} rad")
