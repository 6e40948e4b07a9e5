# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi[robots]"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""GPI against PID with dynamic inversion on a UR5, when the model is right and when it is not.

GPI measures positions and uses D(q). The PID measures velocities too and cancels Coriolis and gravity torques
with the whole model, so it is nearly perfect while the model is; what it does not know, its integral has
to find. Both read the same 16-bit encoders; the velocities are exact, which flatters the PID: GPI has to
make its own from encoder steps, and pays with chatter of the torque.
"""

from armgpi import GPI, Encoder, PIDInversion, RigidBodyPlant, Robot, Saturated, Waypoints, metrics, simulate
from armgpi.loop.rollout import describe_end

robot = Robot.load("ur5")
start = robot.middle()
reference = Waypoints([start, start + 0.5, start], durations=2.0, holds=[1.0, 1.0, 3.0])

controllers = {"GPI": GPI(robot, dt=1e-3), "PID": PIDInversion(robot, dt=1e-3)}
arms = {
    "as modelled": robot,
    "+ 0.5 kg at the flange": robot.with_payload(robot.tip, mass=0.5),
    "all 20 % heavier": robot.scaled_inertia(1.2),
}

HEAD = "{:24} {:10} {:14} {:10} {:>8} {:>9} {:>9} {:>8}"
print(HEAD.format("the arm is", "contender", "measurement", "end", "ITAE", "peak", "final", "chatter"))
for name, arm in arms.items():
    plant = Encoder(Saturated(RigidBodyPlant(arm)), bits=16)
    for label, controller in controllers.items():
        rollout = simulate(plant, controller, reference, t_final=9.0)
        measures = "positions" if controller.measurement_type.__name__ == "Measurement" else "and velocities"
        print(
            f"{name:24} {label:10} {measures:14} {describe_end(rollout)[0]:10} "
            f"{float(metrics.itae(rollout).sum()):8.4f} {float(metrics.peak_error(rollout).max()):9.5f} "
            f"{float(metrics.final_error(rollout).max()):9.6f} "
            f"{float(metrics.total_variation(rollout).sum()):8.0f}"
        )
print("\nITAE [rad s^2] and chatter (total variation of torque [N m]) summed over the joints; errors in rad")
