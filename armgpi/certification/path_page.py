"""The page of a bound along a path: the verdict, the joints, and a run inside of its tube."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armgpi.base.verdict import Verdict
from armgpi.certification.path import PathBound, describe
from armgpi.loop.units import POSITION, TORQUE
from armgpi.viewing import page, style
from armgpi.viewing.drawing import Drawing, figure

_BLUE, _QUIET, _RED = style.PALETTE[0], "#aeb8c2", style.ALARM
#: Points of a curve.
_POINTS = 300
#: Share of an error below which no column tells it.
_TOLD = 0.01
#: What every bound depends on.
ASSUMPTIONS = (
    "The arm is rigid, one of those given, and its joints follow the torque at once and exactly.",
    "Numbers of the arm are the largest of 400 configurations around the path, and 3 % more: no proof.",
    "Disturbances are arbitrary in time, within the stated bounds; the loop has held the arm before, or "
    "starts with the torque of its model where that is stated.",
)


def write_page(found: PathBound, run: Any, notes: Sequence[str] = (), judged: Verdict | None = None) -> str:
    """Return the page, without scripts and without anything from elsewhere.

    Args:
        found: the bound, or why there is none.
        run: a rollout along the path; None for none.
        notes: what is said beside the bound, as of a stop.
        judged: the verdict, where something that was supplied or asked for was left out.
    """
    verdict, *rest = describe(found)
    robot: Any = found.wish.controller.robot
    kind = "good" if found.holds and not found.weaker_than_friction() else "bad"
    if not found.holds:
        summary = f"<p class={kind}>{page.text(verdict)}</p>"
        sections = {"What limits the bound, and what to change": page.bullets(found.reasons)}
        return page.document(f"No bound along a path of {robot.name}", summary, sections)
    summary = ""
    if judged is not None and judged.outcome == "holds for part":
        kind = judged.page_class if kind == "good" else kind
        summary = f"<p class={kind}>{page.text(judged.line)}</p>"
    summary += f"<p class={kind}>{page.text(verdict)}</p>"
    summary += "".join(f"<p>{page.text(line.strip())}</p>" for line in [*rest[: -robot.n], *notes])
    rows = []
    told = [what for what, x in found.parts.items() if x.max() >= _TOLD]
    for j, name in enumerate(robot.joint_names):
        units = (POSITION.symbol(robot.prismatic[j]), TORQUE.symbol(robot.prismatic[j]))
        parts = (f"{100.0 * found.parts[what][j]:.0f} %" for what in told)
        rows.append((name, f"{found.error[j]:.3g} {units[0]}", f"{found.torque[j]:.3g} {units[1]}", *parts))
    head = ("joint", "error\nat most", "torque\nat most", *(what.replace(" ", "\n", 1) for what in told))
    sections = {"Joints, and what makes their errors": page.table(head, rows, label="bounds of the joints")}
    if run is not None:
        sections["A run without what is stated, inside of its tube"] = (
            f"<div class=figures>{''.join(_tubes(found, run))}</div>"
        )
    sections["What it assumes"] = page.bullets(ASSUMPTIONS)
    return page.document(f"Bound along a path of {robot.name}", summary, sections)


def _tubes(found: PathBound, run: Any) -> list[str]:
    """Return a picture for each joint: its error in a run between the ends of the tube."""
    every = max(1, len(run["time"]) // _POINTS)
    t = run["time"].values[::every]
    error = run["q"].values - run["q_ref"].values
    figures = []
    for j, name in enumerate(found.wish.controller.robot.joint_names):
        most = float(found.error[j])
        drawing = Drawing((float(t[0]), float(t[-1])), (-1.2 * most, 1.2 * most), height=150)
        ends = ((y, colour) for y, colour in ((most, _RED), (0.0, _QUIET), (-most, _RED)))
        parts = [drawing.line([(t[0], y), (t[-1], y)], colour) for y, colour in ends]
        parts.append(drawing.line(list(zip(t, error[::every, j], strict=True)), _BLUE))
        largest = float(np.abs(error[:, j]).max())
        unit = POSITION.symbol(found.wish.controller.robot.prismatic[j])
        said = f"{name}, {t[-1]:.3g} s: error within ±{most:.3g} {unit} (red); in this run {largest:.3g}"
        figures.append(figure(drawing.svg(parts, said), said))
    return figures
