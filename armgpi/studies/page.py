"""One page of a sweep: what it says, distributions of metrics, failure maps, and the worst rollout."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import starmap
from typing import Any

import numpy as np
import xarray as xr

from armgpi.base.arrays import Array
from armgpi.base.escape import counted
from armgpi.config import build, dump, world
from armgpi.config import experiment as experiments
from armgpi.loop import metrics
from armgpi.studies.results import (
    QUANTILES,
    drawn_heading,
    failure_words,
    heading,
    of_arm,
    quantile_words,
    sentences,
    worst,
)
from armgpi.studies.sample import Sweep
from armgpi.viewing import page, report
from armgpi.viewing.drawing import LINE, Drawing, figure

#: Bars of a histogram.
_BARS = 40
#: Width of a picture [px].
_WIDTH = 300
#: Height of a picture [px].
_HEIGHT = 92
#: Room for words below it [px].
_BELOW = 18
#: Colour of a bar.
_BAR = "#4878a8"
#: Colour of a bar of what has failed.
_BAD = "#c44e52"
#: A histogram has a logarithmic scale where the largest value is more than so many times the smallest.
_LOGARITHMIC_FROM = 100.0


def html(sweep: Sweep, found: xr.Dataset, said: Mapping[str, Any], unseen: str = "") -> str:
    """Return the page.

    Args:
        sweep: what was run.
        found: its rollouts, from :func:`armgpi.studies.results.collect`.
        said: from :func:`armgpi.studies.results.summary`.
        unseen: the line of a verdict for part; empty where every rollout was run.

    Raises:
        MissingPackage: when trimesh is not installed.
    """
    worst_row = int(worst(found, 1)[0])
    worst_index = int(found["rollout"].values[worst_row])
    drawn = {}
    for name in sweep.drawn_names:
        drawn[name] = float(found[f"drawn.{name}"].values[worst_row])
    config = sweep.config_of(drawn, worst_index)
    experiment = build(config)
    run = experiments.run(experiment, sweep.label, progress=False)
    rollout = experiments.join({sweep.label: run})
    parts = []
    if unseen:
        parts.append(f"<p class=fair>{page.text(unseen)}</p>")
    parts += [
        page.bullets([*sentences(said), f"failed means: {failure_words(sweep)}"]),
        _quantiles(sweep, said),
        "<h3>Distribution of every metric that differs between rollouts</h3>",
        *_distributions(sweep, found),
    ]
    if found["failed"].values.any():
        parts += _failures(sweep, said)
    else:
        parts.append("<p>No rollout failed, so there is no chart of failures.</p>")
    parts.append(f"<p>Rollout {worst_index}, the worst, is the one that is played and below.</p>")
    return report.build(
        rollout,
        experiment.robot,
        title=f"Sweep of {sweep.robot.name}: {counted(found.sizes['rollout'], 'rollout')}",
        configuration=dump(config),
        before="".join(parts),
        world=world.describe(sweep.experiment.config, sweep.experiment.robot),
    )


def _quantiles(sweep: Sweep, said: Mapping[str, Any]) -> str:
    """Return the table of quantiles of the metrics."""
    head = ["metric of the arm", *(f"{100 * share:g} %" for share in QUANTILES)]
    rows = []
    for name in sweep.metrics:
        estimates = said["quantiles"][name]
        words = [quantile_words(estimates[str(share)]) for share in QUANTILES]
        rows.append([heading(sweep, name), *words])
    return page.table(head, rows, label="Quantiles of the metrics with 95 % intervals")


def _distributions(sweep: Sweep, found: xr.Dataset) -> list[str]:
    """Return a histogram of each metric that differs between rollouts, and a line of those that do not."""
    pictures = []
    alike = []
    for name in sweep.metrics:
        values = of_arm(found, name)
        if (values == values[0]).all():
            alike.append(f"{heading(sweep, name)}: {metrics.short(float(values[0]), 3)}")
        else:
            pictures.append((_histogram(values), heading(sweep, name)))
    parts = [_figures(pictures)]
    if alike:
        parts.append(f"<p>The same in all rollouts: {page.text('; '.join(alike))}.</p>")
    return parts


def _failures(sweep: Sweep, said: Mapping[str, Any]) -> list[str]:
    """Return the charts of failures by what was drawn, and by two of them."""
    by_one = []
    for name, rows in said["failure by quantity"].items():
        by_one.append((_map(rows), drawn_heading(sweep, name)))
    by_two = []
    for pair in said["failure by two of them"]:
        title = " × ".join(drawn_heading(sweep, name) for name in pair["of"])
        by_two.append((_square(pair["parts"]), title))
    return ["<h3>Share of failures by what was varied</h3>", _figures(by_one), _figures(by_two)]


def _figures(pictures: Iterable[tuple[str, str]]) -> str:
    """Return pictures with their titles, side by side."""
    return f"<div class=figures>{''.join(starmap(figure, pictures))}</div>"


def _histogram(values: Array) -> str:
    """Return a histogram of finite values; a logarithmic one where they span more than a hundredfold."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return "<p>None is finite.</p>"
    lowest, highest = float(finite.min()), float(finite.max())
    is_logarithmic = lowest > 0.0 and highest > _LOGARITHMIC_FROM * lowest
    scaled = np.log10(finite) if is_logarithmic else finite
    start, width = scaled.min(), np.ptp(scaled)
    # As shares of their range: between values that differ by rounding alone there is no room for bins.
    shares = (scaled - start) / width if width else np.full(len(scaled), 0.5)
    counts, _ = np.histogram(shares, bins=_BARS, range=(0.0, 1.0))
    low, high = metrics.short(lowest, 3), metrics.short(highest, 3)
    caption = f"bars up to {counts.max()} of {len(values)}"
    if is_logarithmic:
        caption = f"log scale, {caption}"
    others = len(values) - len(finite)
    if others:
        caption += f"; {others} not finite"
    return _bars(counts / counts.max(), (low, caption, high), _BAR)


def _map(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the share of failures in each part of a range, with its interval."""
    rows = [row for row in rows if row["rollouts"]]
    largest = max(max(row["upper"] for row in rows), 1e-6)
    heights = np.array([row["value"] for row in rows]) / largest
    intervals = [(row["lower"] / largest, row["upper"] / largest) for row in rows]
    low = metrics.short(rows[0]["from"], 3)
    high = metrics.short(rows[-1]["to"], 3)
    return _bars(heights, (low, f"up to {100.0 * largest:.3g} %", high), _BAD, intervals)


def _bars(
    heights: Array,
    texts: Sequence[str],
    colour: str,
    intervals: Sequence[tuple[float, float]] = (),
) -> str:
    """Return bars side by side, 1 the highest, with intervals, an axis, and words below."""
    n = len(heights)
    drawing = Drawing((0.0, n), (0.0, 1.0), _WIDTH, _HEIGHT, _BELOW)
    shapes = [drawing.bar((k, k + 1), (0.0, height), colour) for k, height in enumerate(heights)]
    for k, (lower, upper) in enumerate(intervals):
        shapes.append(drawing.line([(k + 0.5, lower), (k + 0.5, upper)], LINE))
    shapes.append(drawing.line([(0.0, 1.0), (0.0, 0.0), (n, 0.0)], LINE))
    left, middle, right = texts
    shapes.append(drawing.text(0.0, -0.15, left, "start"))
    shapes.append(drawing.text(0.5 * n, -0.15, middle, "middle"))
    shapes.append(drawing.text(n, -0.15, right, "end"))
    return drawing.svg(shapes)


def _square(parts: Sequence[Mapping[str, Any]]) -> str:
    """Return the share of failures by two numbers, the first to the right, the second upwards."""
    columns = len({part["from"][0] for part in parts})
    rows = len(parts) // columns
    largest = max(part["value"] or 0.0 for part in parts) or 1.0
    drawing = Drawing((0.0, columns), (0.0, rows), _WIDTH, 2 * _HEIGHT, _BELOW)
    shapes = []
    for place, part in enumerate(parts):
        share = part["value"]
        if share is None:
            continue
        column, row = divmod(place, rows)
        ranges = _product(zip(part["from"], part["to"], strict=True))
        words = f"{ranges}: {100.0 * share:.3g} % of {part['rollouts']}"
        opacity = 0.04 + 0.96 * share / largest
        shapes.append(drawing.bar((column, column + 1), (row, row + 1), _BAD, opacity, words))
    whole = _product(zip(parts[0]["from"], parts[-1]["to"], strict=True))
    caption = f"{whole}, up to {100.0 * largest:.3g} %"
    return drawing.svg([*shapes, drawing.text(0.5 * columns, -0.075 * rows, caption)])


def _product(ends: Iterable[tuple[float, float]]) -> str:
    """Return ranges of two numbers in words."""
    return " × ".join(f"{metrics.short(low, 3)} to {metrics.short(high, 3)}" for low, high in ends)
