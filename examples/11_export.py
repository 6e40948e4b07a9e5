# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi[compiled]"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""The controller as C for hardware: exported, replayed, and run in the simulation with a sensor that dies.

What runs on the hardware is C that was written from the controller's own methods. The same C is a controller
here, so that its faults can be tried where nothing breaks.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from armgpi import (
    GPI,
    ClosedLoop,
    Encoder,
    ExportedController,
    Measurement,
    RigidBodyPlant,
    Robot,
    Saturated,
    Supervisor,
    Waypoints,
    export_controller,
)
from armgpi.hardware.export.files import record

robot = Robot.load("anthropomorphic3")
controller = GPI(robot, dt=1e-3)
plant = Encoder(Saturated(RigidBodyPlant(robot.with_payload("tool", 0.1))), bits=17)
reference = Waypoints([[0.0, 0.2, -0.4], [0.8, 0.6, -0.9]], durations=1.5, holds=[0.5, 0.5])

with tempfile.TemporaryDirectory() as folder:
    log = record(plant, controller, reference, t_final=2.5)
    done = export_controller(controller, folder, log, supervisor=Supervisor(resolution=2.0 * np.pi / 2**17))
    for path in done.files:
        print(f"{path.name:22} {path.stat().st_size:8,} bytes")
    print(f"state: {done.state_bytes} bytes; a step: {sum(done.code.typical)} operations")
    if done.measured is None:
        print("there is no C compiler here: `make` in the folder would replay the log")
        print("install GCC or Clang to see the rest of this example")
        sys.exit()
    print(f"replay: {done.measured.difference:.1e} of the torque limits from Python")
    exported = ExportedController(robot, Path(folder))

# On the way, the second joint's encoder stops counting.
loop = ClosedLoop(plant, exported, reference)
state = loop.init()
dead = None
for k in range(1200):
    target = reference.at(k * 1e-3)
    measured = plant.measure(state.plant)
    if k == 1000:
        dead = measured.q[1]
    if dead is not None:
        measured.q[1] = dead
    tau, after = exported.step(Measurement(measured.q), target, state.controller)
    state = state._replace(k=k + 1, plant=plant.step(tau, state.plant, 1e-3), controller=after)
    report = exported.report(after)
    if report.status == "fault":
        break
error = abs(loop.true_state(state).q[1] - target.q[1])
print(f"{1e-3 * k:.3f} s: {report.status}, {report.reason}, joint {report.joint}; it is {error:.3f} rad off")
print(f"torque from here on: {tau.round(3)} N m, by the model alone: engage the brakes")
