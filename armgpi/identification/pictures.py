"""What a model leaves of the torques of a log, joint by joint, as pictures of a page."""

from __future__ import annotations

import numpy as np

from armgpi.base.arrays import Array
from armgpi.identification.arm import Validation
from armgpi.identification.text import followed
from armgpi.robot.robot import Robot
from armgpi.viewing.drawing import LINE, Drawing, figure
from armgpi.viewing.style import PALETTE, QUIET

#: Width of the panel of a torque over time, width of the others, and height of all [px].
_WIDE, _NARROW, _HEIGHT = 330, 170, 110
#: Room below a panel for the numbers and the name of its axis [px].
_BELOW = 30
#: Room that is left above and below what is drawn, as a share of it.
_ROOM = 0.06
#: Colours of the measured and of the predicted torque.
_MEASURED, _PREDICTED = PALETTE[0], PALETTE[1]


def draw(robot: Robot, judged: Validation) -> str:
    """Return HTML: of each joint its torque, and what is left over by time, position, speed and torque."""
    left = judged.torque - judged.predicted
    key = (
        f'<p><span style="color:{_MEASURED}">measured</span>, '
        f'<span style="color:{_PREDICTED}">identified (dashed)</span>; then what is left over.</p>'
    )
    rows = [key]
    for joint, name in enumerate(robot.joint_names):
        length, torque = ("m", "N") if robot.prismatic[joint] else ("rad", "N m")
        units = {"time": "s", "position": length, "speed": f"{length}/s", "torque": torque}
        panels = [_torques(judged, joint, torque)]
        for quantity, values in followed(judged, joint).items():
            panels.append(_left_over(values, left[:, joint], f"{quantity} [{units[quantity]}]"))
        rows.append(figure("".join(panels), name))
    return "".join(rows)


def _torques(judged: Validation, joint: int, unit: str) -> str:
    """Return the panel of the measured and the predicted torque of a joint over time."""
    measured, predicted = judged.torque[:, joint], judged.predicted[:, joint]
    panel = _panel(judged.times, np.concatenate([measured, predicted]), _WIDE)
    parts = [
        *_axes(panel, f"time [s], torque [{unit}]"),
        *(panel.line(piece, _MEASURED) for piece in _pieces(judged.times, measured)),
        *(panel.line(piece, _PREDICTED, dash="4 3") for piece in _pieces(judged.times, predicted)),
    ]
    return panel.svg(parts, f"measured and predicted torque [{unit}] over time")


def _left_over(over: Array, left: Array, label: str) -> str:
    """Return the panel of what is left over of a torque, over some quantity."""
    panel = _panel(over, left, _NARROW)
    zero = [(panel.x[0], 0.0), (panel.x[1], 0.0)]
    parts = [
        *_axes(panel, label),
        panel.line(zero, QUIET),
        panel.dots(np.column_stack([over, left]), _MEASURED),
    ]
    return panel.svg(parts, f"what is left over of the torque, over {label}")


def _panel(x: Array, y: Array, width: int) -> Drawing:
    """Return an empty panel for numbers, with some room around them."""
    return Drawing(_ends(x, 0.0), _ends(y, _ROOM), width, _HEIGHT, _BELOW)


def _ends(values: Array, room: float) -> tuple[float, float]:
    """Return the ends of an axis for values, of which some may be NaN."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    if not low < high:
        low, high = low - 1.0, high + 1.0
    return low - room * (high - low), high + room * (high - low)


def _axes(panel: Drawing, label: str) -> list[str]:
    """Return the frame of a panel, the numbers at its ends and the name of its axis."""
    (left, right), (low, high) = panel.x, panel.y
    line = (high - low) / panel.height  # what a pixel stands for
    frame = [(left, low), (right, low), (right, high), (left, high), (left, low)]
    return [
        panel.line(frame, LINE),
        panel.text(left, low - 12.0 * line, f"{left:.3g}", "start"),
        panel.text(right, low - 12.0 * line, f"{right:.3g}", "end"),
        panel.text(0.5 * (left + right), low - 25.0 * line, label),
        panel.text(left, high - 11.0 * line, f" {high:.3g}", "start"),
        panel.text(left, low + 3.0 * line, f" {low:.3g}", "start"),
    ]


def _pieces(x: Array, y: Array) -> list[Array]:
    """Return the lines of points (x, y) between those that are NaN, each (m, 2)."""
    points = np.column_stack([x, y])
    there = np.isfinite(y)
    cuts = np.flatnonzero(np.diff(there.astype(np.int8))) + 1
    pieces = np.split(points, cuts)
    return [piece for piece in pieces if len(piece) > 1 and np.isfinite(piece[0, 1])]
