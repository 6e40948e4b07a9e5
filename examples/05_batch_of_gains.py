# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""How fast should the controller be? Sixteen bandwidths at once, as one batch.

Behind 14-bit encoders, a faster controller tracks better but turns every encoder step into a jump of
torque; and one that is too fast for its sample time and the delay of its sensors is unstable: the last ones
shake between their torque limits.
"""

import warnings

import numpy as np

from armgpi import (
    GPI,
    ArmgpiWarning,
    Delayed,
    Encoder,
    FixedGains,
    RigidBodyPlant,
    Robot,
    Saturated,
    Waypoints,
    default_omega,
    metrics,
    simulate,
)
from armgpi.loop.rollout import describe_end

DT, LATE = 1e-3, 3  # sample time [s], and by how many samples measurements are late

robot = Robot.load("anthropomorphic3")
plant = Delayed(Encoder(Saturated(RigidBodyPlant(robot.with_payload("tool", mass=0.1))), bits=14), LATE)
reference = Waypoints([[0.0, 0.3, -0.3], [0.8, 0.6, -0.9], [0.0, 0.3, -0.3]], durations=1.5, holds=1.0)

omegas = np.geomspace(5.0, 160.0, 16)  # [rad/s]
with warnings.catch_warnings():
    warnings.simplefilter("ignore", ArmgpiWarning)  # it says which of them will be unstable
    # One row per rollout: gains of shape (16, 1) go with any number of joints.
    controller = GPI(robot, DT, FixedGains(omegas[:, None]), delay=LATE * DT)
rollout = simulate(plant, controller, reference, t_final=6.0)

error = metrics.itae(rollout).sum("joint")
chatter = metrics.total_variation(rollout).sum("joint")
print(f"{'omega_c':>8} {'ITAE':>9} {'torque variation':>17}  end")
for i, (omega, end) in enumerate(zip(omegas, describe_end(rollout), strict=True)):
    print(f"{omega:8.1f} {float(error[i]):9.4f} {float(chatter[i]):13.0f} N m  {end}")
print(f"\nleast ITAE at omega_c = {omegas[np.argmin(error.values)]:.1f} rad/s")
print(f"with no tuning at all, armgpi.GPI would take {default_omega(DT, LATE * DT):.1f} rad/s")
