# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi[robots]"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""Two robots nobody tuned for: default gains, 16-bit encoders, an unknown quarter of a kilogram.

Each robot goes from the middle of its joint ranges by up to 0.5 rad and back. The inertia of the
nominal model is 20 % too small, right, or 20 % too large, and it has no payload. The three run as one batch.
"""

from armgpi import (
    GPI,
    Encoder,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Saturated,
    Waypoints,
    metrics,
    simulate,
)
from armgpi.loop.rollout import describe_end

SCALES = (0.8, 1.0, 1.2)
ROBOTS = {
    "panda": ["panda_finger_joint1", "panda_finger_joint2"],
    "ur5": [],
    "anthropomorphic3": [],
}

print("| robot | D scaled by | end | peak error [rad] | final error [rad] | saturated [s] | beyond limits |")
print("|---|---|---|---|---|---|---|")
for name, lock in ROBOTS.items():
    robot = Robot.load(name, lock=lock)
    start = robot.middle()
    goal = start + 0.5 * (robot.limits.upper - start).clip(max=1.0)
    reference = Waypoints([start, goal, start], durations=2.0, holds=[1.0, 1.0, 2.0])
    nominal = RobotBatch([robot.scaled_inertia(scale) for scale in SCALES])
    controller = GPI(nominal, dt=1e-3)
    plant = Encoder(Saturated(RigidBodyPlant(robot.with_payload(robot.tip, mass=0.25))), bits=16)
    rollout = simulate(plant, controller, reference, t_final=8.0)
    table = metrics.summary(rollout).max("joint")
    for scale, end, row in zip(SCALES, describe_end(rollout), range(len(SCALES)), strict=True):
        worst = {key: float(value[row]) for key, value in table.items()}
        print(
            f"| {name} | {scale} | {end} | {worst['peak_error']:.4f} | {worst['final_error']:.5f} "
            f"| {worst['saturated_time']:.3f} | {worst['limit_excess']:.1g} |"
        )
