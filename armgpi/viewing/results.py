"""Python's `armgpi compare`, `armgpi report` and `armgpi view`: rollouts compared, as a page, and seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armgpi.base.escape import html_table
from armgpi.base.hints import with_keyword_hints
from armgpi.control.controller import Controller
from armgpi.errors import ParameterError
from armgpi.loop import metrics
from armgpi.loop.simulation import simulate
from armgpi.plants.plant import Plant
from armgpi.references.reference import Reference
from armgpi.robot.robot import Robot

if TYPE_CHECKING:
    import xarray as xr

    from armgpi.viewing.page import Page

#: Metrics of a comparison: name -> heading with unit.
_SHOWN: Mapping[str, str] = {
    "itae": "ITAE [rad s², m s²]",
    "peak_error": "largest error [rad, m]",
    "total_variation": "torque variation [N m, N]",
}


class Comparison(NamedTuple):
    """Rollouts of several controllers on the same plant and reference.

    Attributes:
        rollouts: label of the controller -> its rollout.
    """

    rollouts: Mapping[str, xr.Dataset]

    def __repr__(self) -> str:
        """Return the table as text."""
        lines = self._lines()
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        padded = ("  ".join(map(str.ljust, line, widths)) for line in lines)
        return "\n".join(line.rstrip() for line in padded)

    def _repr_html_(self) -> str:
        """Return the table for notebooks."""
        head, *rows = self._lines()
        return html_table("Comparison; smaller is better", head, rows)

    def _lines(self) -> list[list[str]]:
        """Return heading and rows: sums over the joints, of errors the largest."""
        from armgpi.loop.rollout import describe_end

        lines = [["controller", *_SHOWN.values(), "end"]]
        for label, rollout in self.rollouts.items():
            table = metrics.summary(rollout)
            cells = []
            for name in _SHOWN:
                values = np.asarray(table[name])
                cells.append(f"{values.sum() if metrics.declared()[name].total else values.max():.4g}")
            ends = describe_end(rollout if "rollout" in rollout.dims else rollout.expand_dims("rollout"))
            lines.append([label, *cells, ", ".join(dict.fromkeys(ends))])
        return lines


@with_keyword_hints
def compare(
    plant: Plant,
    controllers: Mapping[str, Controller] | Sequence[Controller],
    reference: Reference,
    t_final: float | None = None,
    *,
    backend: str = "numpy",
) -> Comparison:
    """Run several controllers on the same plant and reference, as `armgpi compare` does.

    Args:
        plant: the simulated arm.
        controllers: label -> controller; of a sequence the labels are the names of the classes.
        reference: the motion.
        t_final: simulated time [s], as of :func:`armgpi.simulate`.
        backend: "numpy", "compiled" or "auto", as of :func:`armgpi.simulate`.

    Returns:
        The rollouts, which print as a table. `armgpi.report(comparison, "x.html")` writes a page.

    Raises:
        ParameterError: without a controller, or when an argument is not as it should be.
    """
    if isinstance(controllers, Mapping):
        named = dict(controllers)
    elif isinstance(controllers, list | tuple):
        named = {}
        for controller in controllers:
            label = type(controller).__name__
            while label in named:
                label += "'"
            named[label] = controller
    else:
        raise ParameterError("controllers", controllers, "controllers by their labels, or a sequence of them")
    if not named or not all(isinstance(label, str) for label in named):
        raise ParameterError("controllers", controllers, "at least one controller, and texts as labels")
    return Comparison(
        {
            label: simulate(plant, controller, reference, t_final, backend=backend)
            for label, controller in named.items()
        }
    )


@with_keyword_hints
def report(
    rollouts: xr.Dataset | Mapping[str, xr.Dataset] | Comparison,
    path: str | PathLike[str],
    *,
    title: str | None = None,
    robot: Robot | None = None,
) -> Path:
    """Write tables, plots, animation and data of rollouts as one HTML file, as `armgpi report` does.

    Args:
        rollouts: one dataset, several by their labels, or what :func:`armgpi.compare` returns.
        path: the file, which ends in .html.
        title: of the page; the robot's name by default.
        robot: the arm; by default that with which the rollouts were made.

    Raises:
        ParameterError: when `rollouts` is none of these, or the file does not end in .html.
        RolloutError: when the rollouts differ in joints or sample time, or the file cannot be written.
        MissingPackage: when trimesh is not installed.
    """
    import xarray as xr

    from armgpi.base.arrays import check_path
    from armgpi.viewing import report as reports

    file = Path(check_path(path, "path"))
    if file.suffix.lower() != ".html":
        raise ParameterError("path", str(path), "a file that ends in .html")
    runs: object = rollouts.rollouts if isinstance(rollouts, Comparison) else rollouts
    if isinstance(runs, xr.Dataset):
        merged = runs
    elif isinstance(runs, Mapping) and runs and all(isinstance(run, xr.Dataset) for run in runs.values()):
        merged = reports.merge_rollouts({str(label): run for label, run in runs.items()})
    else:
        expected = "rollouts: a Dataset (armgpi.load(...)), or Datasets by their labels"
        raise ParameterError("rollouts", rollouts, expected)
    return reports.write(reports.build(merged, robot, title=title), file)


@with_keyword_hints
def view(
    shown: Robot | xr.Dataset | Comparison | Sequence[Robot],
    path: str | PathLike[str] | None = None,
    *,
    frame: str | None = None,
) -> Page:
    """Return a page with a robot, several side by side, or the animation of a rollout; a notebook shows it.

    Args:
        shown: a robot, a sequence of robots, or rollouts.
        path: file that is written as well: the page (.html), or of rollouts a film (.gif, or .mp4 by ffmpeg).
        frame: the tool; the tip by default.

    Raises:
        ParameterError: when `shown` is none of these, the file has another ending, or a film is of robots.
        RolloutError: when the robot of a rollout is not found, or the file cannot be written.
        MissingPackage: when trimesh is not installed; or ffmpeg, of an MP4.
    """
    import xarray as xr

    from armgpi.base.arrays import check_path
    from armgpi.viewing import film, meshcat, page
    from armgpi.viewing import report as reports

    if isinstance(shown, Comparison):
        shown = reports.merge_rollouts(shown.rollouts)
    if isinstance(shown, xr.Dataset):
        html = meshcat.rollout_page(shown, frame=frame)
    elif isinstance(shown, Robot):
        html = meshcat.robot_page(shown, frame=frame)
    elif isinstance(shown, Sequence) and shown and all(isinstance(each, Robot) for each in shown):
        html = meshcat.robot_page(*shown, frame=frame)
    else:
        expected = "a Robot (armgpi.Robot.load(...)), a sequence of them, or a rollout (armgpi.load(...))"
        raise ParameterError("shown", shown, expected)
    file = None if path is None else Path(check_path(path, "path"))
    endings = (".html", *film.FORMATS)
    if file is not None and file.suffix.lower() not in endings:
        raise ParameterError("path", str(path), f"a file that ends in {', '.join(endings)}")
    if file is not None and file.suffix.lower() in film.FORMATS:
        if not isinstance(shown, xr.Dataset):
            raise ParameterError("path", str(path), "a page (.html): a film is of a rollout")
        film.write(shown, file, frame=frame)
    elif file is not None:
        meshcat.write(html, file)
    return page.Page(html)
