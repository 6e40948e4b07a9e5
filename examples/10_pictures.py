# /// script
# requires-python = ">=3.10"
# dependencies = ["armgpi[viz]"]
# [tool.uv.sources]
# armgpi = { path = ".." }  # this clone: armgpi is not on a package index
# ///
"""Pictures of a run: figures for a paper, the arm in MeshCat as one file, and a report of everything.

The paper's arm draws the paper's laser path (eq. 28) twice, with fixed gains and with a network, while its
joints are pushed from 20 s on. Name a folder to keep the files: python 10_pictures.py pictures
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from armgpi import (
    GPI,
    BSplineNetwork,
    CartesianReference,
    Encoder,
    FixedGains,
    RigidBodyPlant,
    Robot,
    Saturated,
    Step,
    simulate,
)
from armgpi.config import experiment
from armgpi.paper.arm import PaperArm
from armgpi.references.paths import LaserPath
from armgpi.viewing import meshcat, plots, report

robot = Robot.load("anthropomorphic3")
reference = CartesianReference(robot, robot.tip, LaserPath(), PaperArm().inverse_kinematics)
plant = Encoder(Saturated(RigidBodyPlant(robot, [Step([0.5, 1.0, 0.5], onset=20.0)])), bits=16)
gains = {"fixed gains": FixedGains(25.0), "network": BSplineNetwork()}
runs = {}
for label, own in gains.items():
    controller = GPI(robot, dt=1e-3, gains=own)
    runs[label] = simulate(plant, controller, reference, 40.0, signals=True, backend="auto")
both = experiment.join(runs)

scratch = tempfile.TemporaryDirectory()
folder = Path(sys.argv[1] if len(sys.argv) > 1 else scratch.name)
folder.mkdir(exist_ok=True)
written = [
    plots.save(plots.overview(both), folder / "overview.svg"),
    plots.save(plots.tool_path(both, robot), folder / "path.svg"),
    plots.save(plots.signals(runs["network"], ["omega_c"]), folder / "gains.svg"),
]

# A figure of one's own, composed of axes: where the push sets in, joint by joint.
with plots.styled():
    figure, axes = plots.panels(rows=robot.n, columns=2)
    onset = both.sel(time=slice(19.5, 22.0))
    for row, joint in enumerate(robot.joint_names):
        plots.plot_error(axes[row, 0], onset, joint)
        plots.plot_torque(axes[row, 1], onset, joint)
    plots.legend(figure)
written.append(plots.save(figure, folder / "onset.svg"))

written.append(meshcat.write(meshcat.rollout_page(both, robot), folder / "arm.html"))
written.append(report.write(report.build(both, robot, title="The laser path"), folder / "report.html"))
for path in written:
    print(f"{path.name:20} {path.stat().st_size / 1e6:6.2f} MB")
assert np.isfinite(both["q"]).all()
scratch.cleanup()
