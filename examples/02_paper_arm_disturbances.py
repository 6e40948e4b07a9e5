# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""The paper's 3-DOF arm under its vibrating torques (eqs. 29-31): what each of them does to its joint.

The paper gives neither moves nor gains; they are ours. The torques set in at 10, 15 and 20 s. The law
takes up constant and ramp disturbances without any error, and of a slow sine next to nothing is left. What
a sudden torque does at its onset falls with the square of the bandwidth, so the same runs at twice as much.
"""

import numpy as np

from armgpi import GPI, FixedGains, RigidBodyPlant, Robot, Waypoints, metrics, simulate
from armgpi.plants.loads import paper_disturbances

robot = Robot.load("anthropomorphic3")
plant = RigidBodyPlant(robot, paper_disturbances())
reference = Waypoints(
    [[0.0, 0.0, 0.0], [0.8, 0.4, -0.4], [0.0, 0.0, 0.0]],  # [rad]
    durations=3.0,  # [s]
    holds=[1.0, 8.0, 25.0],
)
ONSETS = dict(zip(robot.joint_names, (10.0, 15.0, 20.0), strict=True))

for omega in (20.0, 40.0):
    controller = GPI(robot, dt=1e-3, gains=FixedGains(omega), start="zero")
    rollout = simulate(plant, controller, reference, t_final=40.0)
    error = abs(metrics.error(rollout))
    print(f"omega_c = {omega:g} rad/s")
    print(f"{'joint':>6} {'ITAE':>8} {'ISCI':>8} {'release':>9} {'onset':>9} {'late':>9}")
    for joint, onset in ONSETS.items():
        one = error.sel(joint=joint)
        release = float(one.sel(time=slice(0.0, 1.0)).max())  # the brakes open, no torque yet
        sets_in = float(one.sel(time=slice(onset, onset + 1.0)).max())
        late = float(one.sel(time=slice(30.0, 40.0)).max())
        itae, isci = (float(metric(rollout).sel(joint=joint)) for metric in (metrics.itae, metrics.isci))
        print(f"{joint:>6} {itae:8.4f} {isci:8.2f} {release:9.6f} {sets_in:9.6f} {late:9.6f}")
    assert np.isfinite(error).all()
print("release, onset, late: largest error [rad] in the first second, the second after the onset, 30 to 40 s")
