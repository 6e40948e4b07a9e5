# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""The loop opened up: one sample at a time, in a loop of your own.

Use it to stop on a condition, to change the target while the arm moves, to talk to hardware, or to put a
learning algorithm around the loop. `simulate` is a loop over the same `step`.
"""

import numpy as np

from armgpi import GPI, ClosedLoop, FixedGains, Hold, RigidBodyPlant, Robot, Target

robot = Robot.load("anthropomorphic3")
loop = ClosedLoop(
    plant=RigidBodyPlant(robot),
    controller=GPI(robot, dt=1e-3, gains=FixedGains(20.0)),
    reference=Hold(np.zeros(3)),  # where it begins; below, the targets come from the loop
)

# An operator's stick: the target turns at a speed until the tool is high enough, and then stops.
SPEED = np.array([0.3, 0.5, 0.2])  # [rad/s]
HIGH = 0.4  # [m]

state = loop.init()
goal = np.zeros(3)
stopped_at = None
while state.k * loop.dt < 5.0:
    t = state.k * loop.dt
    height = robot.frame_pose("tool", loop.true_state(state).q).translation[2]
    if stopped_at is None and height > HIGH:
        stopped_at = t
        print(f"t = {t:.3f} s: the tool is {height:.3f} m high, stop")
    speed = SPEED if stopped_at is None else np.zeros(3)
    goal = goal + speed * loop.dt
    state, measured, tau = loop.step(state, Target(goal, speed, np.zeros(3)))
    if (state.k - 1) % 500 == 0:
        print(
            f"t = {t:.1f} s: height {height:.3f} m, q = {measured.q.round(3)} rad, tau = {tau.round(2)} N m"
        )
    if stopped_at is not None and t > stopped_at + 0.1 and np.abs(loop.true_state(state).v).max() < 1e-3:
        off = np.abs(goal - measured.q).max()
        print(f"t = {t:.3f} s: at rest, {off:.1e} rad from where it was told to stop")
        break

# The state is data: this one goes on from here, as often as you like, with the same result.
again = [loop.step(state, Target(goal, np.zeros(3), np.zeros(3))).tau for _ in range(2)]
assert (again[0] == again[1]).all()
