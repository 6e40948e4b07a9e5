# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""B-spline networks against fixed gains: tracking of a stiff controller, torque of a soft one.

The paper's arm for 40 s under the torques of eqs. 29-31, with 16-bit encoders and one sample of delay. With
ideal sensors a constant high gain tracks best; with encoders it turns every count into torque. The network
keeps omega_c low while the error is a few counts, and raises it while it is more. By default that is a gain
schedule, and the ten lines of GainSchedule do the same.
"""

import numpy as np

from armgpi import (
    GPI,
    BSplineNetwork,
    Delayed,
    Encoder,
    FixedGains,
    GainSchedule,
    RigidBodyPlant,
    Robot,
    Saturated,
    Waypoints,
    metrics,
    simulate,
)
from armgpi.plants.loads import paper_disturbances

robot = Robot.load("anthropomorphic3")
goal = np.array([0.8, 0.4, -0.4])
reference = Waypoints([np.zeros(3), goal, np.zeros(3)], durations=3.0, holds=[1.0, 8.0, 25.0])
plant = Delayed(Encoder(Saturated(RigidBodyPlant(robot, paper_disturbances())), bits=16), samples=1)
contenders = {
    "fixed, 25 rad/s": FixedGains(25.0),
    "fixed, 30 rad/s": FixedGains(30.0),
    "fixed, 30 rad/s, zeta 0.75": FixedGains(30.0, 0.75),
    "fixed, 40 rad/s": FixedGains(40.0),
    "network, 22..60 rad/s": BSplineNetwork(),
    "schedule, 22..60 rad/s": GainSchedule(),
    "network, rate 0.12": BSplineNetwork(rate=0.12),
}

print(f"{'gains':28} {'ITAE of q1, q2, q3 [rad s^2]':30} {'sum':>6} {'torque variation [N m]':>24}")
for name, gains in contenders.items():
    controller = GPI(robot, dt=1e-3, gains=gains, start="zero")
    rollout = simulate(plant, controller, reference, t_final=40.0, backend="auto")  # compiled where it can be
    itae = metrics.itae(rollout).values
    variation = float(metrics.total_variation(rollout).sum())
    each = "  ".join(f"{value:.3f}" for value in itae)
    print(f"{name:28} {each:30} {itae.sum():6.3f} {variation:24.0f}")
