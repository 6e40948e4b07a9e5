# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""A controller of your own: PD with gravity compensation, and what GPI does that it cannot.

A controller is three things: parameters that do not change, `init`, which makes a state, and `step`, which
takes the state and returns the next one. What it measures is part of its type: `measurement_type =
FullState` asks for velocities; the default, `Measurement`, has positions only.
"""

from typing import ClassVar

import numpy as np

from armgpi import (
    GPI,
    Controller,
    ControlStep,
    FixedGains,
    FullState,
    RigidBodyPlant,
    Robot,
    Waypoints,
    metrics,
    simulate,
)


class PDGravity(Controller):
    """tau = G(q) - Kp e - Kd e': no integrator, so no state."""

    measurement_type: ClassVar = FullState

    def __init__(self, robot: Robot, dt: float, kp: float, kd: float) -> None:
        super().__init__(robot, dt)
        self.kp = kp  # [N m/rad]
        self.kd = kd  # [N m s/rad]

    def init(self, measurement, target):
        """Return no state."""

    def step(self, measurement, target, state):
        """Return the torque, and the state as it was."""
        e, de = measurement.q - target.q, measurement.v - target.v
        tau = self.robot.dynamics.gravity(measurement.q) - self.kp * e - self.kd * de
        return ControlStep(self.limited(tau), state)

    def describe(self):
        """Return the parameters, which a rollout keeps."""
        return {**super().describe(), "kp": self.kp, "kd": self.kd}


robot = Robot.load("anthropomorphic3")
loaded = robot.with_payload("tool", mass=0.3)  # [kg], unknown to both
reference = Waypoints([[0.0, 0.2, -0.4], [0.8, 0.6, -0.9]], durations=1.5, holds=[1.0, 2.5])

contenders = {
    "PD + gravity": PDGravity(robot, dt=1e-3, kp=20.0, kd=1.5),
    "GPI": GPI(robot, dt=1e-3, gains=FixedGains(20.0)),
}
print(f"{'':14} {'peak error [rad]':>24} {'final error [rad]':>26}")
for name, controller in contenders.items():
    rollout = simulate(RigidBodyPlant(loaded), controller, reference, t_final=5.0)
    peak, final = metrics.peak_error(rollout).values, metrics.final_error(rollout).values
    print(f"{name:14} {np.array2string(peak, precision=4):>24} {np.array2string(final, precision=2):>26}")

# At rest the PD law holds the load by its error alone: Kp e = the torque of the load. GPI's integrators do.
q = reference.moves[-1].goal
weight = loaded.gravity(q) - robot.gravity(q)
print(f"the load's torque there over Kp: {(weight / contenders['PD + gravity'].kp).round(3)} rad")
