"""Publication-grade Matplotlib figures of rollouts.

Two layers. The lower one draws one thing of one joint into axes that you made:

============================  ======================================================================
:func:`plot_positions`        reference and position
:func:`plot_error`            tracking error q - q*
:func:`plot_torque`           torque applied, its limits, where it was saturated
:func:`plot_torque_rate`      change of the torque from sample to sample
:func:`plot_velocity`         reference's velocity and that of the joint
:func:`plot_disturbance`      torque of the loads
:func:`plot_tool_error`       distance of the tool from its reference; `plot_tool_angle`, `plot_force`
:func:`plot_signal`           what a controller recorded (gains, weights: ``simulate(..., signals=True)``)
:func:`plot_path_plane`       the tool's path beside the desired one, viewed along an axis
:func:`plot_path_space`       the same in space (axes with ``projection="3d"``)
:func:`plot_pareto`           two costs against each other and their Pareto front
============================  ======================================================================

The upper one (:func:`overview`, :func:`positions`, :func:`velocities`, :func:`errors`, :func:`torques`,
:func:`torque_rates`, :func:`disturbances`, :func:`tool`, :func:`signals`, :func:`tool_path`, :func:`pareto`)
makes whole figures of them: a panel per joint and one legend. To compose a figure of your own::

    from armgpi.viewing import plots

    with plots.styled():
        figure, axes = plots.panels(rows=3, columns=2)
        for row, joint in enumerate(rollout["joint"].values):
            plots.plot_positions(axes[row, 0], rollout, joint)
            plots.plot_torque(axes[row, 1], rollout, joint)
        plots.legend(figure)
    plots.save(figure, "figure4.pdf")

Every function takes a dataset with or without the dimension ``rollout``; rollouts are drawn in the colours of
:mod:`armgpi.viewing.style`, named by the coordinate ``label`` where there is one. More rollouts than
``MOST_LINES`` are drawn as their median and the range between the 5th and 95th percentile.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.base.hints import PLOTS, missing
from armgpi.errors import MissingPackage, NameNotFound, ParameterError, RolloutError
from armgpi.loop.rollout import Status
from armgpi.loop.units import POSITION, TORQUE, TORQUE_RATE, VELOCITY, Unit, prismatic
from armgpi.robot.robot import Robot
from armgpi.viewing import style
from armgpi.viewing.tracks import (
    ToolPath,
    Trace,
    disturbance_onset,
    pareto_front,
    signal_names,
    tool_paths,
    torque_rate,
    traces,
)

try:
    import matplotlib as mpl
    import matplotlib.style
    from matplotlib import figure as matplotlib_figure
    from matplotlib import ticker as ticker
    from matplotlib.axes import Axes as Axes
except ImportError:
    raise MissingPackage("matplotlib") from None

__all__ = [
    "FORMATS",
    "Figure",
    "check_path",
    "disturbances",
    "errors",
    "legend",
    "overview",
    "panels",
    "pareto",
    "plot_disturbance",
    "plot_error",
    "plot_force",
    "plot_pareto",
    "plot_path_plane",
    "plot_path_space",
    "plot_positions",
    "plot_signal",
    "plot_tool_angle",
    "plot_tool_error",
    "plot_torque",
    "plot_torque_rate",
    "plot_velocity",
    "positions",
    "save",
    "signals",
    "styled",
    "tool",
    "tool_path",
    "torque_rates",
    "torques",
    "velocities",
]

#: What :func:`save` writes, by the file's ending.
FORMATS = ("png", "svg", "pdf")
#: Width of a figure over both columns of a page [in], and height of a panel.
_WIDTH, _HEIGHT = 7.2, 1.25
#: A torque limit is drawn as a line when the torque comes this near to it; else it is named above.
_NEAR = 0.4
#: Everything that makes a figure look like one of ours, and its file the same each time.
_FONT = "DejaVu Sans"
_STYLE: dict[Any, Any] = {
    "font.family": _FONT,  # comes with Matplotlib: the same text on every machine
    "font.size": 7.0,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7.0,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.0,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "figure.dpi": 100.0,
    "savefig.dpi": 200.0,
    "svg.hashsalt": "armgpi",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
    "text.usetex": False,
    "path.simplify": True,
}


def __getattr__(name: str) -> object:
    """Name what to use in place of what does not exist."""
    raise AttributeError(missing(f"module {__name__!r}", name, PLOTS, __all__))


def __dir__() -> list[str]:
    """Return the public names, without what is imported here."""
    return __all__


class Figure(matplotlib_figure.Figure):
    """A figure that a notebook shows by itself."""

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        with styled():
            self.savefig(content, format="png", dpi=130)
        return content.getvalue()


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the house style while in the context; Matplotlib's own settings come back after it."""
    with mpl.style.context(["default", _STYLE]):
        yield


def panels(
    rows: int, columns: int = 1, *, width: float = _WIDTH, height: float = _HEIGHT
) -> tuple[Figure, Any]:
    """Return a figure of rows x columns panels over one time axis, and its axes (rows, columns).

    Args:
        rows: number of rows.
        columns: number of columns.
        width: of the figure [in].
        height: of a row [in].
    """
    figure = Figure(figsize=(width, rows * height + 0.75), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex="all")
    for below in axes[-1]:
        below.set_xlabel("time [s]")
    return figure, axes


def legend(figure: Figure) -> None:
    """Give a figure one legend, above its panels, of everything that its axes name.

    Args:
        figure: of Matplotlib, whose axes have named lines.
    """
    entries: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if not entries:
        return
    # As many a row as fit: a letter is about 0.06 in wide.
    longest = max(map(len, entries))
    columns = max(1, min(len(entries), int(figure.get_figwidth() / (0.06 * longest + 0.5))))
    figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=columns)


def save(figure: Figure, path: str | PathLike[str]) -> Path:
    """Write a figure as PNG, SVG or PDF, by the file's ending; the same figure makes the same bytes.

    Args:
        figure: of Matplotlib.
        path: file to write, which ends in .png, .svg or .pdf.

    Returns:
        The path of the file.

    Raises:
        ParameterError: when the ending is none of these, or it is no figure.
        RolloutError: when the file cannot be written.
    """
    target = check_path(path)
    if not hasattr(figure, "savefig"):
        raise ParameterError("figure", figure, "one of Matplotlib, such as armgpi.plots.overview(rollout)")
    kind = target.suffix[1:].lower()
    undated = {"pdf": "CreationDate", "svg": "Date", "png": "Software"}[kind]
    with styled():
        if figure.get_layout_engine() is not None:
            # Laid out once: a second pass would move things by a hair.
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        content = io.BytesIO()
        figure.savefig(content, format=kind, metadata={undated: None})
    return files.write(target, content.getvalue())


def check_path(path: str | PathLike[str]) -> Path:
    """Return the path of a figure, refusing an ending that :func:`save` does not know.

    Args:
        path: file of a figure.

    Raises:
        ParameterError: when the ending is none of :data:`FORMATS`.
    """
    target = Path(path)
    if target.suffix[1:].lower() not in FORMATS:
        raise ParameterError("the figure's file", str(path), f"one that ends in .{', .'.join(FORMATS)}")
    return target


# One thing of one joint ----------------------------------------------------------------------------------


def plot_positions(axes: Axes, rollout: xr.Dataset, joint: str, *, limits: bool = True) -> None:
    """Draw the reference and the position of a joint over time.

    Args:
        axes: where.
        rollout: the rollout(s).
        joint: name of the joint.
        limits: whether to draw position limits that the joint comes near to.
    """
    drawn = _traces(rollout, joint)
    _draw(axes, drawn, lambda data: data["q"])
    # One reference when it is the same for all, as in a comparison.
    references = _distinct([trace.data["q_ref"] for trace in drawn])
    for index, values in enumerate(references):
        axes.plot(
            values["time"],
            values,
            color=style.REFERENCE,
            linestyle=(0, (4, 2)),
            linewidth=0.8,
            label="reference" if index == 0 else None,
        )
    if limits:
        for name in ("lower", "upper"):
            value = _number(rollout, name, joint)
            low, high = axes.get_ylim()
            slack = 0.25 * (high - low)
            if low - slack <= value <= high + slack:  # within or near what the axes show
                _limit_line(axes, value)
    _label(axes, f"position [{_unit(rollout, joint)}]", joint)


def plot_error(axes: Axes, rollout: xr.Dataset, joint: str, *, onset: bool = True) -> None:
    """Draw the tracking error q - q* of a joint over time; `onset` marks when its disturbance sets in.

    Args:
        axes: axes of Matplotlib to draw into.
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joint: name of the joint.
        onset: whether to mark when the disturbance of the joint begins.
    """
    axes.axhline(0.0, color=style.QUIET, linewidth=0.6)
    _draw(axes, _traces(rollout, joint), lambda data: data["q"] - data["q_ref"])
    if onset:
        _mark_onset(axes, rollout, joint)
    _label(axes, f"error [{_unit(rollout, joint)}]", joint)


def plot_velocity(axes: Axes, rollout: xr.Dataset, joint: str, *, limits: bool = True) -> None:
    """Draw the reference's velocity and that of a joint over time.

    Args:
        axes: where.
        rollout: the rollout(s).
        joint: name of the joint.
        limits: whether to draw a velocity limit that the joint comes near to.

    Raises:
        RolloutError: when velocities were not recorded.
    """
    if "v" not in rollout or "v_ref" not in rollout:
        raise RolloutError("the rollout has no velocities v and v_ref; record them")
    drawn = _traces(rollout, joint)
    _draw(axes, drawn, lambda data: data["v"])
    for index, values in enumerate(_distinct([trace.data["v_ref"] for trace in drawn])):
        label = "reference" if index == 0 else None
        axes.plot(
            values["time"], values, color=style.REFERENCE, linestyle=(0, (4, 2)), linewidth=0.8, label=label
        )
    limit = _number(rollout, "velocity", joint) if limits and "velocity" in rollout else math.nan
    low, high = axes.get_ylim()
    for value in (-limit, limit):
        if low <= value <= high or max(-low, high) > _NEAR * limit:
            _limit_line(axes, value)
    _label(axes, f"velocity [{_unit(rollout, joint, VELOCITY)}]", joint)


def plot_tool_error(axes: Axes, rollout: xr.Dataset) -> None:
    """Draw the distance of the tool from where the reference puts it over time [mm].

    Args:
        axes: axes of Matplotlib to draw into.
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.

    Raises:
        RolloutError: when the rollout has no tool.
    """
    _draw(axes, _tool_traces(rollout), lambda data: 1e3 * _length(data["tool"] - data["tool_ref"]))
    axes.set_ylabel("tool error [mm]")


def plot_tool_angle(axes: Axes, rollout: xr.Dataset) -> None:
    """Draw the angle between the tool's orientation and the wished one over time [deg].

    Args:
        axes: axes of Matplotlib to draw into.
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.

    Raises:
        RolloutError: when the rollout has no tool.
    """
    _draw(axes, _tool_traces(rollout), lambda data: data["tool_turn"] * (180.0 / math.pi))
    axes.set_ylabel("tool angle [deg]")


def plot_force(axes: Axes, rollout: xr.Dataset) -> None:
    """Draw the largest force of a contact over time [N]; zero where nothing touches.

    An estimate of :func:`armgpi.tool_wrench` is drawn beside it, with the band of its interval.

    Args:
        axes: axes of Matplotlib to draw into.
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.

    Raises:
        RolloutError: when the rollout has no tool.
    """

    def largest(data: xr.Dataset) -> xr.DataArray:
        if "contact_force" not in data:
            return 0.0 * data["tool_turn"]
        return _length(data["contact_force"]).max("contact", skipna=False)

    _draw(axes, _tool_traces(rollout), largest)
    if "estimated_force" in rollout:
        _draw_estimate(axes, rollout)
    axes.set_ylabel("force [N]")


def _draw_estimate(axes: Axes, rollout: xr.Dataset) -> None:
    """Draw the length of estimated forces, and from where to where they may be."""
    for trace in _tool_traces(rollout):
        if "rollout" in trace.data["estimated_force"].dims:
            continue
        low, high = trace.data["estimated_force_low"], trace.data["estimated_force_high"]
        # The box of the intervals: its nearest point to zero, and its farthest corner.
        nearest = low.clip(min=0.0) - high.clip(max=0.0)
        farthest = abs(low).where(abs(low) > abs(high), abs(high))
        time = trace.data["time"].values
        axes.fill_between(
            time,
            _length(nearest).values,
            _length(farthest).values,
            color=style.REFERENCE,
            alpha=0.25,
            linewidth=0,
        )
        estimate = _length(trace.data["estimated_force"])
        axes.plot(time, estimate, color=style.REFERENCE, linestyle="--", label=text("estimated"))


def plot_torque(
    axes: Axes, rollout: xr.Dataset, joint: str, *, limits: bool = True, onset: bool = True
) -> None:
    """Draw the torque applied at a joint over time.

    Args:
        axes: where.
        rollout: the rollout(s).
        joint: name of the joint.
        limits: whether to show the effort limit, and where the torque was at it.
        onset: whether to mark when the joint's disturbance sets in.
    """
    drawn = _traces(rollout, joint)
    _draw(axes, drawn, lambda data: data["tau"], steps=True)
    unit = _unit(rollout, joint, TORQUE)
    if limits:
        _show_effort(axes, drawn, _number(rollout, "effort", joint), unit)
    if onset:
        _mark_onset(axes, rollout, joint)
    _label(axes, f"torque [{unit}]" if unit == TORQUE.symbol() else f"force [{unit}]", joint)
    if axes.texts and len(joint) > 28:
        axes.set_title(text(joint), pad=11.0)  # clear of the note on the limit


def plot_torque_rate(axes: Axes, rollout: xr.Dataset, joint: str) -> None:
    """Draw how fast the torque of a joint changes from sample to sample, which shows noise and chatter.

    Args:
        axes: axes of Matplotlib to draw into.
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joint: name of the joint.
    """
    _draw(axes, _traces(rollout, joint), torque_rate)
    unit = _unit(rollout, joint, TORQUE_RATE)
    _label(axes, f"{'torque' if unit == TORQUE_RATE.symbol() else 'force'} rate [{unit}]", joint)


def plot_disturbance(axes: Axes, rollout: xr.Dataset, joint: str) -> None:
    """Draw the disturbance torque of a joint over time: zero where there are no loads.

    Args:
        axes: axes of Matplotlib to draw into.
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joint: name of the joint.
    """
    if "disturbance" not in rollout:
        rollout = rollout.assign(disturbance=0.0 * rollout["tau"].fillna(0.0))
    references = _distinct([trace.data["disturbance"] for trace in _traces(rollout, joint)])
    for index, values in enumerate(references):
        axes.plot(
            values["time"], values, color=style.DISTURBANCE, label="disturbance" if index == 0 else None
        )
    axes.margins(x=0.0)
    _label(axes, f"disturbance [{_unit(rollout, joint, TORQUE)}]", joint)


def plot_signal(
    axes: Axes, rollout: xr.Dataset, joint: str, names: str | Sequence[str], *, unit: str = ""
) -> None:
    """Draw signals that the controller recorded, such as gains or network weights, over time.

    Args:
        axes: where.
        rollout: the rollout(s), of ``simulate(..., signals=True)``.
        joint: name of the joint.
        names: variables of the rollout: ``"omega_c"``, or several in one panel, as the weights
            ``["omega_c_weight_1", "omega_c_weight_2", ...]``.
        unit: shown on the axis.

    Raises:
        NameNotFound: when the rollout has no such signal.
    """
    wanted = [names] if isinstance(names, str) else list(names)
    for name in wanted:
        if name not in rollout or "joint" not in rollout[name].dims:
            raise NameNotFound("signal", name, signal_names(rollout), "record them with signals=True")
    drawn = _traces(rollout, joint)
    if len(wanted) == 1:
        _draw(axes, drawn, lambda data: data[wanted[0]], alone=wanted[0])
    else:
        for index, name in enumerate(wanted):
            color = style.look(index)
            for number, trace in enumerate(drawn):
                axes.plot(
                    trace.data["time"],
                    _middle(trace.data[name]),
                    color=color.color,
                    linestyle=style.look(number * len(style.PALETTE)).dashes,
                    label=text(name if len(drawn) == 1 else f"{name}, {trace.label}"),
                )
    axes.margins(x=0.0)
    what = wanted[0] if len(wanted) == 1 else _common_start(wanted)
    _label(axes, text(what) + (f" [{unit}]" if unit else ""), joint)


def plot_path_plane(
    axes: Axes, rollout: xr.Dataset, robot: Robot, *, frame: str | None = None, plane: str | None = None
) -> None:
    """Draw the path of the tool, and the desired one, viewed along an axis of the base frame.

    Args:
        axes: where.
        rollout: the rollout(s).
        robot: the arm.
        frame: which frame; the tip when not given.
        plane: "xy", "xz" or "yz"; the one in which the desired path is widest when not given.

    Raises:
        ParameterError: when there is no such plane.
    """
    paths = tool_paths(rollout, robot, frame)
    if plane is None:
        extent = np.ptp(np.concatenate([path.desired for path in paths]), axis=0)
        plane = "".join("xyz"[i] for i in sorted(np.argsort(extent, kind="stable")[1:]))
    if plane not in ("xy", "xz", "yz"):
        raise ParameterError("plane", plane, "'xy', 'xz' or 'yz'")
    pair = ["xyz".index(letter) for letter in plane]
    _draw_paths(axes, paths, pair)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{plane[0]} [m]")
    axes.set_ylabel(f"{plane[1]} [m]")


def plot_path_space(axes: Any, rollout: xr.Dataset, robot: Robot, *, frame: str | None = None) -> None:
    """Draw the path of the tool in space, and the desired one; `axes` have ``projection="3d"``.

    Args:
        axes: axes of Matplotlib to draw into.
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        robot: the arm.
        frame: name of the frame whose path is drawn; the tip when not given.

    Raises:
        NameNotFound: when the robot has no such frame.
    """
    paths = tool_paths(rollout, robot, frame)
    _draw_paths(axes, paths, [0, 1, 2])
    every = np.concatenate([path.desired for path in paths] + [path.drawn for path in paths])
    every = every[np.isfinite(every).all(axis=1)]
    centre = 0.5 * (every.min(axis=0) + every.max(axis=0))
    half = max(0.55 * float(np.ptp(every, axis=0).max()), 1e-6)
    for index, letter in enumerate("xyz"):
        getattr(axes, f"set_{letter}lim")(centre[index] - half, centre[index] + half)
        getattr(axes, f"set_{letter}label")(f"{letter} [m]")
        getattr(axes, f"{letter}axis").set_major_locator(ticker.MaxNLocator(4))
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=0.85)


def plot_pareto(
    axes: Axes,
    costs: npt.ArrayLike,
    *,
    names: tuple[str, str] = ("first cost", "second cost"),
    label: str = "",
    index: int = 0,
) -> None:
    """Draw two costs against each other, and the Pareto front: those that nothing beats in both.

    Args:
        axes: where.
        costs: the points, shape (k, 2); those that are not finite are left out.
        names: of the costs, with units.
        label: name in the legend, for several sets in one picture.
        index: which colour.

    Raises:
        ParameterError: when `costs` does not have shape (k, 2).
    """
    points = np.asarray(costs, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ParameterError("costs", points.shape, "an array of shape (k, 2)")
    points = points[np.isfinite(points).all(axis=1)]
    best = pareto_front(points)
    front = points[best][np.lexsort((-points[best][:, 1], points[best][:, 0]))]
    color = style.look(index).color
    axes.scatter(points[~best, 0], points[~best, 1], s=8, color=color, alpha=0.35, linewidths=0)
    name = f"{label}, Pareto front" if label else "Pareto front"
    axes.plot(*front.T, color=color, marker="o", markersize=3, drawstyle="steps-post", label=text(name))
    for index, letter in enumerate("xy"):
        if len(points) and points[:, index].min() > 0.0 and np.ptp(np.log10(points[:, index])) > 2.0:
            getattr(axes, f"set_{letter}scale")("log")
        getattr(axes, f"set_{letter}label")(text(names[index]))


# Whole figures -------------------------------------------------------------------------------------------


def overview(rollout: xr.Dataset, joints: Sequence[str] | None = None) -> Figure:
    """Return position, error and torque of every joint, or of `joints`, a row per joint.

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joints: names of the joints; all when not given.

    Raises:
        NameNotFound: when the robot has no such joint.
    """
    names = _joints(rollout, joints)
    with styled():
        figure, axes = panels(len(names), 3, width=_WIDTH + 1.0)
        for row, joint in enumerate(names):
            plot_positions(axes[row, 0], rollout, joint)
            plot_error(axes[row, 1], rollout, joint)
            plot_torque(axes[row, 2], rollout, joint)
            for others in axes[row, 1:]:
                others.set_title("")
        legend(figure)
    return figure


def positions(rollout: xr.Dataset, joints: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Return reference and position of every joint; drawn into `ax`, axes for each joint, where given.

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joints: names of the joints; all when not given.
        ax: axes of Matplotlib, one for each joint; a new figure when not given.

    Returns:
        The figure that was made, or of `ax` the axes.

    Raises:
        NameNotFound: when the robot has no such joint.
    """
    return _per_joint(rollout, joints, plot_positions, ax)


def errors(rollout: xr.Dataset, joints: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Return the tracking error of every joint; drawn into `ax`, axes for each joint, where given.

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joints: names of the joints; all when not given.
        ax: axes of Matplotlib, one for each joint; a new figure when not given.

    Returns:
        The figure that was made, or of `ax` the axes.

    Raises:
        NameNotFound: when the robot has no such joint.
    """
    return _per_joint(rollout, joints, plot_error, ax)


def torques(rollout: xr.Dataset, joints: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Return the torque of every joint with its limits; drawn into `ax`, axes for each joint, where given.

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joints: names of the joints; all when not given.
        ax: axes of Matplotlib, one for each joint; a new figure when not given.

    Returns:
        The figure that was made, or of `ax` the axes.

    Raises:
        NameNotFound: when the robot has no such joint.
    """
    return _per_joint(rollout, joints, plot_torque, ax)


def torque_rates(rollout: xr.Dataset, joints: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Return the rate of every joint's torque; drawn into `ax`, axes for each joint, where given.

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joints: names of the joints; all when not given.
        ax: axes of Matplotlib, one for each joint; a new figure when not given.

    Returns:
        The figure that was made, or of `ax` the axes.

    Raises:
        NameNotFound: when the robot has no such joint.
    """
    return _per_joint(rollout, joints, plot_torque_rate, ax)


def velocities(rollout: xr.Dataset, joints: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Return reference and velocity of every joint; drawn into `ax`, axes for each joint, where given.

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joints: names of the joints; all when not given.
        ax: axes of Matplotlib, one for each joint; a new figure when not given.

    Returns:
        The figure that was made, or of `ax` the axes.

    Raises:
        NameNotFound: when the robot has no such joint.
    """
    return _per_joint(rollout, joints, plot_velocity, ax)


def tool(rollout: xr.Dataset) -> Figure:
    """Return how far the tool was off its path and its orientation over time, and the force of contacts.

    The force is there where the plant's environment has contacts.

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.

    Raises:
        RolloutError: when the rollout has no tool.
    """
    rows = [
        plot_tool_error,
        plot_tool_angle,
        *([plot_force] if {"contact_force", "estimated_force"} & {*rollout} else []),
    ]
    with styled():
        figure, axes = panels(len(rows), 1)
        for place, draw in zip(axes[:, 0], rows, strict=True):
            draw(place, rollout)
        legend(figure)
    return figure


def wrench(rollout: xr.Dataset) -> Figure:
    """Return the estimated force on the tool over time, axis by axis, with the band of its interval.

    Args:
        rollout: one rollout, or a log as one, with the estimate of :func:`armgpi.tool_wrench`.

    Raises:
        RolloutError: when the rollout has no estimate, or there are several.
    """
    if "estimated_force" not in rollout:
        raise RolloutError("the rollout has no estimated force; armgpi.tool_wrench(rollout, robot) adds it")
    if "rollout" in rollout["estimated_force"].dims:
        raise RolloutError("there are several rollouts; choose one: rollout.isel(rollout=0)")
    time = rollout["time"].values
    with styled():
        figure, places = panels(3, 1)
        for axes, axis in zip(places[:, 0], "xyz", strict=True):
            force, low, high = (
                rollout[f"estimated_force{end}"].sel(axis=axis).values for end in ("", "_low", "_high")
            )
            axes.fill_between(time, low, high, color=style.REFERENCE, alpha=0.25, linewidth=0)
            axes.plot(time, force, color=style.REFERENCE, label="estimated")
            axes.axhline(0.0, color="0.6", linewidth=0.6)
            axes.set_ylabel(f"force along {axis} [N]")
        legend(figure)
    return figure


def disturbances(rollout: xr.Dataset, joints: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Return the disturbance torque of every joint; drawn into `ax`, axes for each joint, where given.

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
        joints: names of the joints; all when not given.
        ax: axes of Matplotlib, one for each joint; a new figure when not given.

    Returns:
        The figure that was made, or of `ax` the axes.

    Raises:
        NameNotFound: when the robot has no such joint.
    """
    return _per_joint(rollout, joints, plot_disturbance, ax)


def signals(
    rollout: xr.Dataset, names: Sequence[str] | None = None, joints: Sequence[str] | None = None
) -> Figure:
    """Return signals that the controllers recorded: a row per joint, a column per kind.

    Args:
        rollout: of ``simulate(..., signals=True)``.
        names: which; all by default. Numbered ones (``p_c_weight_1``, ``p_c_weight_2``) share a panel.
        joints: which; all by default.

    Raises:
        RolloutError: when the rollout has none.
    """
    wanted = signal_names(rollout) if names is None else tuple(names)
    if not wanted:
        raise RolloutError("the rollout has no signals of its controller; simulate with signals=True")
    kinds: dict[str, list[str]] = {}
    for name in wanted:
        kinds.setdefault(name.rstrip("0123456789").rstrip("_"), []).append(name)
    rows = _joints(rollout, joints)
    with styled():
        figure, axes = panels(len(rows), len(kinds), width=max(_WIDTH, 2.2 * len(kinds)))
        for row, joint in enumerate(rows):
            for column, group in enumerate(kinds.values()):
                plot_signal(axes[row, column], rollout, joint, group[0] if len(group) == 1 else group)
                if column:
                    axes[row, column].set_title("")
        legend(figure)
    return figure


def tool_path(rollout: xr.Dataset, robot: Robot, frame: str | None = None) -> Figure:
    """Return the path of a frame [m] beside the desired one, in its plane and in space.

    Args:
        rollout: the rollout(s).
        robot: the arm.
        frame: name of the frame; the tip when not given.

    Raises:
        RolloutError: when the rollout is one of another arm.
        NameNotFound: when the arm has no such frame.
    """
    with styled():
        figure = Figure(figsize=(_WIDTH, 3.6), layout="constrained")
        plot_path_plane(figure.add_subplot(1, 2, 1), rollout, robot, frame=frame)
        plot_path_space(figure.add_subplot(1, 2, 2, projection="3d"), rollout, robot, frame=frame)
        legend(figure)
    return figure


def pareto(
    costs: npt.ArrayLike | dict[str, npt.ArrayLike], names: tuple[str, str] = ("first cost", "second cost")
) -> Figure:
    """Return two costs against each other, with their Pareto fronts.

    Args:
        costs: k points, shape (k, 2); or several sets of them by the names of the legend.
        names: of the two costs with their units, for the axes.

    Raises:
        ParameterError: when a set has another shape.
    """
    sets = costs if isinstance(costs, dict) else {"": costs}
    with styled():
        figure = Figure(figsize=(0.5 * _WIDTH, 3.0), layout="constrained")
        axes = figure.subplots()
        for index, (label, points) in enumerate(sets.items()):
            plot_pareto(axes, points, names=names, label=label, index=index)
        legend(figure)
    return figure


def text(name: str) -> str:
    """Return a name as Matplotlib shows it to the letter: no mathematics, no glyph that the font lacks."""
    known = _glyphs()
    shown = "".join(c if ord(c) in known else "?" for c in style.shorten(name)).replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown  # Matplotlib hides labels that begin with it


@lru_cache(maxsize=1)
def _glyphs() -> frozenset[int]:
    """Return the characters that the figures' font has."""
    from matplotlib.font_manager import findfont, get_font

    return frozenset(get_font(findfont(_FONT)).get_charmap())


def _traces(rollout: xr.Dataset, joint: str) -> list[Trace]:
    """Return the rollouts, of one joint."""
    found = traces(rollout)
    if (names := [str(name) for name in rollout["joint"].values]).count(joint) != 1:
        raise NameNotFound("joint", joint, names)
    index = names.index(joint)
    return [trace._replace(data=trace.data.isel(joint=index)) for trace in found]


def _tool_traces(rollout: xr.Dataset) -> list[Trace]:
    """Return the rollouts, of which the tool is known."""
    if "tool" not in rollout:
        raise RolloutError("the rollout has no tool; simulate it with all trajectories recorded")
    return traces(rollout)


def _length(vectors: xr.DataArray) -> xr.DataArray:
    """Return the lengths of vectors over `axis`."""
    return (vectors**2).sum("axis", skipna=False) ** 0.5


def _draw(
    axes: Axes,
    drawn: Sequence[Trace],
    quantity: Callable[[xr.Dataset], xr.DataArray],
    steps: bool = False,
    alone: str = "actual",
) -> None:
    """Draw a quantity of every rollout over time; `alone` names a rollout that has no name."""
    for trace in drawn:
        values = quantity(trace.data)
        color, dashes = trace.look
        time = values["time"].values
        if "rollout" in values.dims:
            low, middle, high = _percentiles(values)
            axes.fill_between(time, low, high, color=color, alpha=0.25, linewidth=0)
            axes.plot(time, middle, color=color, label=text(trace.label))
            continue
        axes.plot(
            time,
            values,
            color=color,
            linestyle=dashes,
            drawstyle="steps-post" if steps and len(time) < 200 else "default",
            marker="." if len(time) == 1 else None,
            label=text(trace.label or alone),
        )
        there = np.flatnonzero(np.isfinite(values.values))
        if int(trace.data["status"]) == Status.DIVERGED and there.size:  # a cross where it did
            last = there[-1]
            axes.plot(
                time[last],
                values.values[last],
                marker="x",
                markersize=5,
                color=style.ALARM,
                linestyle="none",
                label="diverged",
            )
    axes.margins(x=0.0)


def _show_effort(axes: Axes, drawn: Sequence[Trace], effort: float, unit: str) -> None:
    """Show an effort limit: as lines where the torque comes near to it, else as a note in words."""
    if not effort < 1e300:  # NaN as well
        return
    torques = np.concatenate([trace.data["tau"].values.ravel() for trace in drawn])
    torques = torques[np.isfinite(torques)]
    lowest, peak = torques.min(initial=0.0), np.abs(torques).max(initial=0.0)
    if peak >= _NEAR * effort:
        for sign in (-1.0, 1.0):
            if sign * peak >= 0.0 or lowest <= -_NEAR * effort:
                _limit_line(axes, sign * effort)
    else:
        # Above the axes: inside it would cover some curve.
        axes.annotate(
            f"limit ±{effort:.6g} {unit}",
            xy=(1.0, 1.0),
            xycoords="axes fraction",
            xytext=(-1.0, 1.5),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=5.5,
            color=style.QUIET,
        )
    for trace, sign in product(drawn, (-1.0, 1.0)):
        tau = trace.data["tau"].values
        # Each side by itself: a torque that jumps from one limit to the other was at neither in between.
        at_limit = sign * tau >= effort * (1.0 - 1e-9)
        if at_limit.ndim == 1 and at_limit.any():
            axes.plot(
                trace.data["time"].values,
                np.where(at_limit, tau, np.nan),
                color=style.ALARM,
                linewidth=2.5,
                solid_capstyle="butt",
                alpha=0.6,
                label="at the limit",
            )


def _mark_onset(axes: Axes, rollout: xr.Dataset, joint: str) -> None:
    """Mark when the joint's disturbance sets in, unless it does so at the beginning."""
    time = disturbance_onset(rollout, joint)
    if time is not None and time > float(rollout["time"][0]):
        axes.axvline(
            time, color=style.DISTURBANCE, linewidth=0.8, linestyle=(0, (1, 1.5)), label="disturbance sets in"
        )


def _limit_line(axes: Axes, value: float) -> None:
    """Draw a limit."""
    axes.axhline(value, color=style.QUIET, linewidth=0.8, linestyle=(0, (6, 2, 1, 2)), label="limit")


def _draw_paths(axes: Any, paths: Sequence[ToolPath], pick: list[int]) -> None:
    """Draw paths by two or three of their coordinates."""
    desired = _distinct([path.desired for path in paths])
    for index, points in enumerate(desired):
        axes.plot(
            *points[:, pick].T,
            color=style.REFERENCE,
            linestyle=(0, (4, 2)),
            linewidth=0.8,
            label="desired" if index == 0 else None,
            zorder=3,
        )
    for path in paths:
        color, dashes = path.look
        name = text(path.label or "actual")
        axes.plot(*path.drawn[:, pick].T, color=color, linestyle=dashes, linewidth=1.4, label=name)


def _per_joint(
    rollout: xr.Dataset,
    joints: Sequence[str] | None,
    plot: Callable[[Axes, xr.Dataset, str], None],
    ax: Any = None,
) -> Any:
    """Return a figure with a panel per joint, in two columns where there are many; or that of own axes.

    Raises:
        ParameterError: when there are not as many axes as joints.
    """
    names = _joints(rollout, joints)
    if ax is not None:
        own = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
        if len(own) != len(names) or not all(isinstance(each, Axes) for each in own):
            expected = f"axes for each of {', '.join(names)}: plt.subplots({len(names)}), or name joints"
            raise ParameterError("ax", ax, expected)
        for place, joint in zip(own, names, strict=True):
            plot(place, rollout, joint)
        return own[0].figure
    columns = 1 if len(names) <= 4 else 2
    rows = -(-len(names) // columns)
    with styled():
        figure, axes = panels(rows, columns)
        for place, joint in zip(axes.T.flat, names, strict=False):
            plot(place, rollout, joint)
        for place in axes.T.flat[len(names) :]:
            place.set_visible(False)
            # The panel above is now the last of its column.
            axes[rows - 2, -1].tick_params(labelbottom=True)
            axes[rows - 2, -1].set_xlabel("time [s]")
        legend(figure)
    return figure


def _joints(rollout: xr.Dataset, joints: Sequence[str] | None) -> list[str]:
    """Return the joints asked for, all by default."""
    traces(rollout)
    known = [str(name) for name in rollout["joint"].values]
    if joints is None:
        return known
    for joint in joints:
        if joint not in known:
            raise NameNotFound("joint", joint, known)
    return list(joints)


def _label(axes: Axes, quantity: str, joint: str) -> None:
    """Name the quantity on the axis and the joint above it."""
    axes.set_ylabel(quantity)
    axes.set_title(text(joint))
    axes.yaxis.set_major_locator(ticker.MaxNLocator(4))


def _unit(rollout: xr.Dataset, joint: str, unit: Unit = POSITION) -> str:
    """Return a unit as it is of a joint."""
    names = [str(name) for name in rollout["joint"].values]
    return unit.symbol(bool(prismatic(rollout)[names.index(joint)]))


def _number(rollout: xr.Dataset, name: str, joint: str) -> float:
    """Return a limit of a joint; of rollouts that differ in it there is none."""
    names = [str(n) for n in rollout["joint"].values]
    values = np.unique(np.atleast_1d(rollout[name].isel(joint=names.index(joint)).values))
    return float(values[0]) if len(values) == 1 else math.nan


def _distinct(arrays: Sequence[Any]) -> list[Any]:
    """Return arrays without those that equal an earlier one where both have values."""
    found: list[Any] = []
    for array in arrays:
        if getattr(array, "ndim", 1) == 2 and hasattr(array, "dims"):
            array = _middle(array)
        ours = np.asarray(array)
        for index, other in enumerate(found):
            theirs = np.asarray(other)
            both = np.isfinite(ours) & np.isfinite(theirs)
            if np.array_equal(ours[both], theirs[both]):
                if np.isfinite(ours).sum() > np.isfinite(theirs).sum():
                    found[index] = array
                break
        else:
            found.append(array)
    return found


def _middle(values: xr.DataArray) -> xr.DataArray:
    """Return the median over rollouts where there are several."""
    if "rollout" not in values.dims:
        return values
    return values.isel(rollout=0, drop=True).copy(data=_percentiles(values)[1])


def _percentiles(values: xr.DataArray) -> tuple[Array, Array, Array]:
    """Return the 5th, 50th and 95th percentile over rollouts; those that ended are left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all have ended: NaN, which is not drawn
        low, middle, high = np.nanpercentile(values.transpose("rollout", "time").values, [5, 50, 95], axis=0)
    return low, middle, high


def _common_start(names: Sequence[str]) -> str:
    """Return what names have in common, as "p_c_weight" of "p_c_weight_1" and "p_c_weight_2"."""
    stem = names[0]
    for name in names[1:]:
        while not name.startswith(stem):
            stem = stem[:-1]
    return stem.rstrip("_0123456789") or "signal"
