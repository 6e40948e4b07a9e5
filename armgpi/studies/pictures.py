"""Figures of searches: convergence, front and gains of a study; fronts of laws held against each other."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armgpi.studies.contend import Entry, classes, medians
from armgpi.studies.found import convergence, front
from armgpi.studies.objective import heading
from armgpi.studies.optimise import Row, Search, Validated
from armgpi.viewing import plots, style
from armgpi.viewing.plots import Axes, Figure


def study_picture(search: Search, found: Sequence[Validated], given: Row) -> bytes:
    """Return a figure of a study as PNG: how it converged, its front, and what became of the numbers."""
    with plots.styled():
        figure = Figure(figsize=(11.0, 3.6), layout="constrained")
        left, middle, right = figure.subplots(1, 3)
        _convergence(left, search)
        _front(middle, search, found, given)
        _gains(right, search, found)
    return png(figure)


def png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=150)
    return content.getvalue()


def _name(budget: float) -> str:
    return "best" if math.isinf(budget) else f"up to {budget:g}"


def _convergence(axes: Axes, search: Search) -> None:
    """Draw the best objective over the candidates."""
    problem = search.problem
    for index, best in enumerate(convergence(search)):
        candidates = np.arange(1, len(best) + 1)
        objective = np.where(np.isfinite(best), best, np.nan)
        label = _name(problem.budgets[index])
        axes.plot(candidates, objective, color=style.look(index).color, label=label)
    _log(axes.set_yscale, [row.objective for row in search.rows])
    name = plots.text(heading(problem.objective.expression.text, problem.slides))
    axes.set(xlabel="candidate", ylabel=name, title="convergence")
    if len(problem.budgets) > 1:
        axes.legend(fontsize="x-small")


def _front(axes: Axes, search: Search, found: Sequence[Validated], given: Row) -> None:
    """Draw what candidates cost, which no other beats, and what was found on held-out scenarios."""
    against = search.problem.against
    first_color, second_color, third_color, *_ = style.PALETTE
    candidates = search.rank()
    spent, objectives = _costs(candidates, against)
    axes.scatter(spent, objectives, s=6, color=style.QUIET, alpha=0.5, label="candidates", linewidths=0)
    spent, objectives = _costs(front(search), against)
    axes.plot(spent, objectives, color=first_color, linewidth=1.2, label="front", drawstyle="steps-post")
    held_out = [validated.held_out for validated in found]
    spent, objectives = _costs(held_out, against)
    axes.scatter(spent, objectives, marker="D", s=28, color=second_color, label="best, held out", zorder=3)
    if given.sound:
        spent, objectives = _costs([given], against)
        axes.scatter(spent, objectives, marker="s", s=28, color=third_color, label="default, held out")
    shown = [*candidates, *held_out]
    _log(axes.set_xscale, [row.means[against] for row in shown])
    _log(axes.set_yscale, [row.objective for row in shown])
    slides = search.problem.slides
    name = plots.text(heading(search.problem.objective.expression.text, slides))
    spent_name = plots.text(heading(against, slides))
    axes.set(xlabel=spent_name, ylabel=name, title="front")
    axes.legend(fontsize="x-small")


def _gains(axes: Axes, search: Search, found: Sequence[Validated]) -> None:
    """Draw where the numbers are in their ranges, before and after."""
    space = search.problem.space
    places = np.arange(len(space.names))
    axes.scatter(space.start, places, marker="s", s=28, color=style.PALETTE[2], label="default")
    for index, validated in enumerate(found):
        color = style.look(index).color
        label = _name(validated.budget)
        axes.scatter(validated.row.x, places, marker="D", s=24, color=color, label=label)
    labels = [plots.text(dimension.label(space.joints)) for dimension in space.dimensions]
    axes.set_yticks(places, labels)
    axes.set_xticks([0.0, 1.0], ["low", "high"])
    axes.invert_yaxis()
    axes.set(xlim=(-0.03, 1.03), title="numbers in their ranges")
    axes.legend(fontsize="x-small")


def _costs(rows: Sequence[Row], against: str) -> tuple[list[float], list[float]]:
    """Return what candidates spend, and their objectives."""
    spent = [row.means[against] for row in rows]
    return spent, [row.objective for row in rows]


def _log(scale: Any, values: Sequence[float]) -> None:
    """Take a logarithmic scale where all that is finite is positive."""
    finite = [value for value in values if math.isfinite(value)]
    if finite and min(finite) > 0.0:
        scale("log")


#: Markers of the curves of a panel, filled for GPI and open for others: they tell more curves than there
#: are colours apart, also in grey.
_MARKERS = "osD^v<>P*X"


def contest_picture(entries: Sequence[Entry]) -> bytes:
    """Return the fronts of a contest as PNG: a row for each arm, a column for each class of several laws."""
    arms = list(dict.fromkeys(entry.arm for entry in entries))
    all_groups = classes(entries)
    of_several = {name: laws for name, laws in all_groups.items() if len(laws) > 1}
    values = {arm: medians(entries, arm) for arm in arms}
    return draw_contest(values, of_several or all_groups)


def draw_contest(
    arms: Mapping[str, Mapping[str, Mapping[str, float]]], groups: Mapping[str, Sequence[str]]
) -> bytes:
    """Return the fronts of a contest as PNG.

    Args:
        arms: arm -> controller -> limit of torque variation -> error; a row of panels for each arm.
        groups: class -> its controllers; a column of panels for each class.
    """
    with plots.styled():
        size = (6.2 * len(groups), 2.8 * len(arms))
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(len(arms), len(groups), squeeze=False)
        for row, (arm, values) in enumerate(arms.items()):
            for axes, (group, laws) in zip(panels[row], groups.items(), strict=True):
                _draw_fronts(axes, laws, values)
                _, _, class_name = group.partition(", ")
                title = f"{plots.text(arm)}: {plots.text(class_name)}"
                axes.set_title(title, fontsize="small")
                if row == 0:
                    axes.legend(fontsize=6.5, loc="upper left", bbox_to_anchor=(1.01, 1.0))
            panels[row, 0].set_ylabel("ITAE on held-out scenarios [rad s²]")
    return png(figure)


def _draw_fronts(axes: Any, laws: Sequence[str], values: Mapping[str, Mapping[str, float]]) -> None:
    """Draw the errors of some controllers over their limits of torque variation.

    GPI has filled markers and solid lines, others have open markers and dashed lines. A controller has the
    colour of its place in `laws`, drawn or not, so that it keeps it in the panels of all arms.

    Args:
        axes: the panel.
        laws: names of the controllers of the panel; those without values are left out.
        values: controller -> limit of torque variation [N m], as text -> error [rad s^2].
    """
    ours = [law.startswith("GPI") for law in laws]
    for index, law in enumerate(laws):
        if law not in values:
            continue
        budgets = [float(budget) for budget in values[law]]
        errors = [error if math.isfinite(error) else math.nan for error in values[law].values()]
        color, _ = style.look(index)
        gpi = ours[index]
        place = ours[:index].count(gpi)
        look: dict[str, Any] = {
            "linestyle": "-" if gpi else (0, (4, 1.5)),
            "marker": _MARKERS[place % len(_MARKERS)],
            "markerfacecolor": color if gpi else "white",
        }
        axes.plot(budgets, errors, color=color, label=law, markersize=4.0, linewidth=1.0, **look)
    axes.set(xscale="log", yscale="log", xlabel="torque variation up to [N m]")
    ticks = [float(budget) for budget in next(iter(values.values()))]
    axes.set_xticks(ticks, [f"{tick:.6g}" for tick in ticks])
    axes.minorticks_off()
