"""What a model leaves of the torques of a log, joint by joint, as pictures."""

from __future__ import annotations

from armgpi.identification.arm import Validation
from armgpi.identification.text import followed
from armgpi.robot.robot import Robot
from armgpi.viewing import plots

#: Width of a figure, and height of a row [in].
_WIDTH, _HEIGHT = 13.0, 1.7
#: What is above the first row for the legend, below the last, and beside the columns [in].
_ABOVE, _BELOW, _LEFT, _RIGHT = 0.4, 0.45, 0.75, 0.12
#: Room between columns and rows, as a share of a panel. Set by hand, for labels of six digits.
_BETWEEN = {"wspace": 0.28, "hspace": 0.45}
#: Shares of the columns in the width, of which the second is left blank for labels; and those with panels.
_WIDTHS, _COLUMNS = (2.0, 0.05, 1.0, 1.0, 1.0, 1.0), (0, 2, 3, 4, 5)


def draw(robot: Robot, judged: Validation) -> bytes:
    """Return a PNG: of each joint its torque, and what is left over by time, position, speed and torque."""
    left = judged.torque - judged.predicted
    height = _HEIGHT * robot.n + _ABOVE + _BELOW
    with plots.styled():
        # Laid out by hand: that Matplotlib measures every label, and parses each number as mathematics, took
        # half of the time of the whole picture.
        figure = plots.Figure(figsize=(_WIDTH, height))
        margins = {
            "left": _LEFT / _WIDTH,
            "right": 1.0 - _RIGHT / _WIDTH,
            "bottom": _BELOW / height,
            "top": 1.0 - _ABOVE / height,
        }
        grid = figure.add_gridspec(robot.n, len(_WIDTHS), width_ratios=_WIDTHS, **margins, **_BETWEEN)
        for j, name in enumerate(robot.joint_names):
            length, torque = ("m", "N") if robot.prismatic[j] else ("rad", "N m")
            first, *others = axes = [figure.add_subplot(grid[j, column]) for column in _COLUMNS]
            first.plot(judged.times, judged.torque[:, j], label="measured")
            first.plot(judged.times, judged.predicted[:, j], label="identified", linestyle="--")
            first.set_ylabel(f"{plots.text(name)}\n[{torque}]")
            over = {"time": "s", "position": length, "speed": f"{length}/s", "torque": torque}
            first.set_xlabel("time [s]")
            for cell in axes:
                cell.ticklabel_format(useMathText=False)
            for cell, (key, values) in zip(others, followed(judged, j).items(), strict=True):
                cell.plot(values, left[:, j], ".", markersize=2.0)
                cell.axhline(0.0, linewidth=0.5, color="gray")
                cell.set_xlabel(f"{key} [{over[key]}]")
            others[0].set_ylabel(f"left over\n[{torque}]")
        plots.legend(figure)
        return figure._repr_png_()
