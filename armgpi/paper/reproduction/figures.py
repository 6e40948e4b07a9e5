"""Figures 5 to 13 of the paper, drawn from our rollouts, and the Pareto plot of the ablation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from armgpi.base.arrays import Array
from armgpi.gpi.gains import Betas, Tuning, betas
from armgpi.paper.reproduction import runs, tables
from armgpi.robot.robot import Robot
from armgpi.viewing import plots, style
from armgpi.viewing.plots import Axes, Figure, ticker

#: Which panel is which, as the paper letters them.
_LETTERS = "abcdefghij"
#: About how many points a curve is drawn with: more than a page can show.
_POINTS = 4000
#: Until when scenario 5.1 has something to show, and scenario 5.2 goes once round its curve [s].
_END_1, _END_2 = 18.0, 9.0 * math.pi


def write(
    gpi: xr.Dataset, pid: xr.Dataset, ablation: xr.Dataset | None, folder: Path, endings: Sequence[str]
) -> list[Path]:
    """Draw the figures and write them in some formats.

    Args:
        gpi: the proposal with ideal sensors, from :mod:`armgpi.paper.reproduction.runs`.
        pid: PID + inversion, likewise.
        ablation: networks and fixed gains; None when they were not run.
        folder: where to.
        endings: of the files.
    """
    one = _thin(gpi, runs.SCENARIO_1).sel(time=slice(None, _END_1))
    two = _thin(gpi, runs.SCENARIO_2).sel(time=slice(None, _END_2))
    calm = _thin(pid, runs.UNDISTURBED), _thin(gpi, runs.UNDISTURBED)
    pushed = _thin(pid, runs.NEAR_PID), _thin(gpi, runs.NETWORK)
    draw: dict[str, Callable[[], Figure]] = {
        "figure-05": partial(_motion, one),
        "figure-06": partial(_tuning, one),
        "figure-07": partial(_gains, one),
        "figure-09": partial(_cartesian, two),
        "figure-10": partial(_motion, two),
        "figure-11": partial(_disturbances, pushed[1]),
        "figure-12": partial(_against, calm),
        "figure-13": partial(_against, pushed),
    }
    if ablation is not None:
        costs = {bits: tables.ablation_costs(ablation, bits) for bits in runs.ABLATION_BITS}
        draw["ablation"] = partial(_pareto, costs)
    files = []
    for name, figure in draw.items():
        with plots.styled():
            drawn = figure()
        files += [plots.save(drawn, folder / f"{name}.{ending}") for ending in endings]
    return files


def _motion(rollout: xr.Dataset) -> Figure:
    """Return Figures 5 and 10: position and torque of every joint."""
    figure, axes = plots.panels(3, 2)
    for row, joint in enumerate(tables.JOINTS):
        plots.plot_positions(axes[row, 0], rollout, joint, limits=False)
        plots.plot_torque(axes[row, 1], rollout, joint, limits=False, onset=False)
        number = row + 1
        _name(axes[row, 0], 2 * row, f"Controlled angular position $q_{number}$", f"$q_{number}$ [rad]")
        _name(axes[row, 1], 2 * row + 1, f"Computed torque $\\tau_{number}$", f"$\\tau_{number}$ [N m]")
    return _finish(figure, axes)


def _tuning(rollout: xr.Dataset) -> Figure:
    """Return Figure 6: the adapted parameters of joint 1."""
    figure, axes = plots.panels(3, 1)
    symbols = (
        ("omega_c", "\\omega_{n1}", "rad/s"),
        ("zeta_c", "\\zeta_{n1}", "-"),
        ("p_c", "P_{n1}", "rad/s"),
    )
    for row, (name, symbol, unit) in enumerate(symbols):
        values = rollout[name].sel(joint="q1")
        axes[row, 0].plot(values["time"], values, color=style.PALETTE[0])
        _name(axes[row, 0], row, f"Adaptive ${symbol}$ control parameter", f"${symbol}$ [{unit}]")
    return _finish(figure, axes)


def _gains(rollout: xr.Dataset) -> Figure:
    """Return Figure 7: the gains of joint 1 (eq. 25)."""
    figure, axes = plots.panels(5, 1)
    here = rollout.sel(joint="q1")
    values = betas(Tuning(*(here[name].values for name in Tuning._fields)))
    for row, (name, value) in enumerate(zip(Betas._fields, values, strict=True)):
        symbol, power = f"\\beta_{{{name[-1]}1}}", 5 - int(name[-1])
        axes[row, 0].plot(here["time"], value, color=style.PALETTE[0])
        unit = "1/s" if power == 1 else f"1/s$^{power}$"
        _name(axes[row, 0], row, f"${symbol}$", f"${symbol}$ [{unit}]")
    return _finish(figure, axes)


def _cartesian(rollout: xr.Dataset) -> Figure:
    """Return Figure 9: the tool on the axes over time, and in space."""
    robot = Robot.load("anthropomorphic3")
    is_at, should = (robot.frame_pose(robot.tip, rollout[name].values).translation for name in ("q", "q_ref"))
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    grid = figure.add_gridspec(3, 2)
    for axis, letter in enumerate("xyz"):
        axes = figure.add_subplot(grid[axis, 0])
        axes.plot(rollout["time"], should[:, axis], color=style.REFERENCE, dashes=(4, 2), label="desired")
        axes.plot(rollout["time"], is_at[:, axis], color=style.PALETTE[0], label="actual", zorder=1)
        axes.margins(x=0.0)
        _name(axes, axis, f"Tracking on the {letter} axis", f"${letter}$ [m]")
        if axis == 2:
            axes.set_xlabel("time [s]")
        else:
            axes.tick_params(labelbottom=False)
    space: Any = figure.add_subplot(grid[:, 1], projection="3d")
    plots.plot_path_space(space, rollout, robot)
    space.set_title("(d) Tracking in space", loc="left")
    _one_legend(figure)
    return figure


def _disturbances(rollout: xr.Dataset) -> Figure:
    """Return Figure 11: the vibrating torques of eqs. 29-31."""
    figure, axes = plots.panels(3, 1)
    for row, joint in enumerate(tables.JOINTS):
        plots.plot_disturbance(axes[row, 0], rollout, joint)
        number = row + 1
        _name(axes[row, 0], row, f"External torque $\\tau_{{d{number}}}$", f"$\\tau_{{d{number}}}$ [N m]")
    return _finish(figure, axes)


def _against(rollouts: Sequence[xr.Dataset]) -> Figure:
    """Return Figures 12 and 13: PID + inversion at the left, the proposal at the right."""
    figure, axes = plots.panels(3, 2)
    for column, (rollout, who) in enumerate(zip(rollouts, ("PID", "proposed"), strict=True)):
        for row, joint in enumerate(tables.JOINTS):
            plots.plot_positions(axes[row, column], rollout, joint, limits=False)
            number = row + 1
            title = f"$q_{number}$ with the {who} controller"
            _name(axes[row, column], 2 * row + column, title, f"$q_{number}$ [rad]")
    for row in axes:  # the same scale side by side
        ends = [end for one in row for end in one.get_ylim()]
        for one in row:
            one.set_ylim(min(ends), max(ends))
    return _finish(figure, axes)


def _pareto(every: dict[int, dict[str, tuple[float, float]]]) -> Figure:
    """Return tracking against chatter: networks and fixed gains, a panel per encoder resolution."""
    figure = Figure(figsize=(7.2, 5.0), layout="constrained")
    panels = np.ravel(figure.subplots(2, 2))
    color_of_fixed, color_of_networks, *_ = style.PALETTE
    for panel, (bits, costs) in enumerate(every.items()):
        axes = panels[panel]
        fixed = np.array([cost for name, cost in costs.items() if name != runs.NETWORK])
        axes.plot(*fixed.T, "o-", color=color_of_fixed, label="fixed $\\omega_c$ [rad/s]", markersize=3)
        networks = costs[runs.NETWORK]
        axes.plot(*networks, "*", color=color_of_networks, label="networks", markersize=8, zorder=3)
        for omega, place in zip(runs.FIXED, fixed, strict=True):
            axes.annotate(f"{omega:g}", tuple(place), xytext=(4, 3), textcoords="offset points", fontsize=6.5)
        axes.set_xscale("log")
        axes.set_yscale("log")
        errors, variations = np.transpose(list(costs.values()))
        _number_axis(axes.xaxis, errors)
        _number_axis(axes.yaxis, variations)
        axes.margins(0.15)
        _name(axes, panel, f"{bits}-bit encoders", "torque variation [N m]")
        axes.set_xlabel("ITAE, sum of the joints [rad s²]")
    _one_legend(figure)
    return figure


def _number_axis(axis: Any, values: Array) -> None:
    """Number a logarithmic axis: less than a decade needs more numbers for there to be three."""
    subs: tuple[float, ...] = (1.0, 2.0, 5.0)
    if values.max() < 5.0 * values.min():
        subs = (1.0, 1.2, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
    axis.set_major_locator(ticker.LogLocator(subs=subs))
    axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(ticker.NullFormatter())


def _name(axes: Axes, panel: int, title: str, ylabel: str) -> None:
    """Letter and title a panel as the paper does, and label its axis."""
    axes.set_title(f"({_LETTERS[panel]}) {title}", loc="left")
    axes.set_title("")
    axes.set_ylabel(ylabel)


def _finish(figure: Figure, axes: Any) -> Figure:
    """Label the time axis at the bottom, without empty ends, and give the figure its legend."""
    for bottom in axes[-1]:
        bottom.set_xlabel("time [s]")
    for one in axes.flat:
        one.margins(x=0.0)
    _one_legend(figure)
    return figure


def _one_legend(figure: Figure) -> None:
    """Give the figure one legend where there is more than one thing to distinguish."""
    labels: set[str] = set()
    for axes in figure.axes:
        _, labels_there = axes.get_legend_handles_labels()
        labels.update(labels_there)
    if len(labels) > 1:
        plots.legend(figure)


def _thin(result: xr.Dataset, label: str) -> xr.Dataset:
    """Return a rollout at D(q) x 1.0, thinned, and without its label: the panel's title says what it is."""
    rollout = runs.select(result, label, 1.0)
    every = max(1, rollout.sizes["time"] // _POINTS)
    return rollout.isel(time=slice(None, None, every)).drop_vars(["label", "scale", "measurement", "knows"])
