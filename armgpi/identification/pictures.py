"""What a model leaves of the torques of a log, joint by joint, as pictures."""

from __future__ import annotations

from armgpi.identification.arm import Validation
from armgpi.identification.text import followed
from armgpi.robot.robot import Robot
from armgpi.viewing import plots

#: Width of a figure, and height of a row [in].
_WIDTH, _HEIGHT = 13.0, 1.7


def draw(robot: Robot, judged: Validation) -> bytes:
    """Return a PNG: of each joint its torque, and what is left over by time, position, speed and torque."""
    left = judged.torque - judged.predicted
    with plots.styled():
        figure = plots.Figure(figsize=(_WIDTH, _HEIGHT * robot.n + 0.75), layout="constrained")
        axes = figure.subplots(robot.n, 5, squeeze=False, width_ratios=[2.0, 1.0, 1.0, 1.0, 1.0])
        for j, name in enumerate(robot.joint_names):
            length, torque = ("m", "N") if robot.prismatic[j] else ("rad", "N m")
            first = axes[j, 0]
            first.plot(judged.times, judged.torque[:, j], label="measured")
            first.plot(judged.times, judged.predicted[:, j], label="identified", linestyle="--")
            first.set_ylabel(f"{plots.text(name)}\n[{torque}]")
            over = {"time": "s", "position": length, "speed": f"{length}/s", "torque": torque}
            first.set_xlabel("time [s]")
            for cell, (key, values) in zip(axes[j, 1:], followed(judged, j).items(), strict=True):
                cell.plot(values, left[:, j], ".", markersize=2.0)
                cell.axhline(0.0, linewidth=0.5, color="gray")
                cell.set_xlabel(f"{key} [{over[key]}]")
            axes[j, 1].set_ylabel(f"left over\n[{torque}]")
        plots.legend(figure)
        return figure._repr_png_()
