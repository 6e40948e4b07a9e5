"""One page of a sweep: what it says, distributions of metrics, failure maps, and the worst rollout."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import starmap
from typing import Any

import numpy as np
import xarray as xr

from armgpi.arrays import Array
from armgpi.config import build, dump, keys
from armgpi.config import experiment as experiments
from armgpi.loop import metrics
from armgpi.studies.results import QUANTILES, failure_words, heading, of_arm, quantile_words, sentences, worst
from armgpi.studies.sample import Sweep
from armgpi.viewing import page, report
from armgpi.viewing.drawing import LINE, Drawing, figure

#: Bars of a histogram; size of a picture, and room for words below it [px].
_BARS, _WIDTH, _HEIGHT, _BELOW = 40, 300, 92, 18
#: Colours: a bar, one of what has failed.
_BAR, _BAD = "#4878a8", "#c44e52"


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
    i = int(worst(found, 1)[0])
    row = {name: float(found[f"drawn.{name}"].values[i]) for name in sweep.drawn_names}
    config = sweep.config_of(row, int(found["rollout"].values[i]))
    experiment = build(config)
    rollout = experiments.join({sweep.label: experiments.run(experiment, sweep.label, progress=False)})
    quantiles = [
        [heading(sweep, name), *(quantile_words(said["quantiles"][name][str(share)]) for share in QUANTILES)]
        for name in sweep.metrics
    ]
    head = ["metric of the arm", *(f"{100 * share:g} %" for share in QUANTILES)]
    failures = [
        "<h3>Share of failures by what was drawn</h3>",
        _figures(
            (_map(rows), _heading_of(sweep, name)) for name, rows in said["failure by what was drawn"].items()
        ),
        _figures(
            (_square(pair["parts"]), " × ".join(_heading_of(sweep, name) for name in pair["of"]))
            for pair in said["failure by two of them"]
        ),
    ]
    if not found["failed"].values.any():
        failures = ["<p>No rollout failed, so there is no chart of failures.</p>"]
    parts = [
        f"<p class=fair>{page.text(unseen)}</p>" if unseen else "",
        page.bullets([*sentences(said), f"A rollout has failed that {failure_words(sweep)}."]),
        page.table(head, quantiles, label="Quantiles of the metrics with 95 % intervals"),
        "<h3>Distribution of every metric</h3>",
        _figures((_histogram(of_arm(found, name)), heading(sweep, name)) for name in sweep.metrics),
        *failures,
        f"<p>Rollout {int(found['rollout'].values[i])}, the worst, is the one that is played and below.</p>",
    ]
    return report.build(
        rollout,
        experiment.robot,
        title=f"Sweep of {sweep.robot.name}: {found.sizes['rollout']} rollouts",
        configuration=dump(config),
        before="".join(parts),
    )


def _heading_of(sweep: Sweep, name: str) -> str:
    """Return the name of a number that was drawn, with its unit where the file has it."""
    with suppress(LookupError):
        if unit := keys.find(sweep.experiment.config, name)[0].unit:
            return f"{name} [{unit}]"
    return name


def _figures(pictures: Iterable[tuple[str, str]]) -> str:
    """Return pictures with their titles, side by side."""
    return f"<div class=figures>{''.join(starmap(figure, pictures))}</div>"


def _histogram(values: Array) -> str:
    """Return a histogram of finite values; a logarithmic one where they span more than a hundredfold."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return "<p>All infinite.</p>"
    log = finite.min() > 0.0 and finite.max() > 100.0 * finite.min()
    counts, edges = np.histogram(np.log10(finite) if log else finite, bins=_BARS)
    low, high = (metrics.short(float(10.0**x if log else x), 3) for x in (edges[0], edges[-1]))
    lost = f"; {len(values) - len(finite)} infinite" if len(finite) < len(values) else ""
    said = f"{'log scale, ' if log else ''}bars up to {counts.max()} of {len(values)}{lost}"
    return _bars(counts / counts.max(), (low, said, high), _BAR)


def _map(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the share of failures in each part of a range, with its interval."""
    rows = [row for row in rows if row["rollouts"]]
    most = max(max(row["upper"] for row in rows), 1e-6)
    value, lower, upper = (np.array([row[k] for row in rows]) / most for k in ("value", "lower", "upper"))
    low, high = (metrics.short(x, 3) for x in (rows[0]["from"], rows[-1]["to"]))
    return _bars(
        value, (low, f"up to {100.0 * most:.3g} %", high), _BAD, list(zip(lower, upper, strict=True))
    )


def _bars(
    heights: Array,
    texts: Sequence[str],
    colour: str,
    intervals: Sequence[tuple[float, float]] = (),
) -> str:
    """Return bars side by side, 1 the highest, with intervals, an axis, and words below."""
    n = len(heights)
    drawing = Drawing((0.0, n), (0.0, 1.0), _WIDTH, _HEIGHT, _BELOW)
    parts = [drawing.bar((k, k + 1), (0.0, height), colour) for k, height in enumerate(heights)]
    parts += [drawing.line([(k + 0.5, a), (k + 0.5, b)], LINE) for k, (a, b) in enumerate(intervals)]
    parts += [drawing.line([(0.0, 1.0), (0.0, 0.0), (n, 0.0)], LINE)]
    for x, anchor, text in zip((0.0, 0.5 * n, n), ("start", "middle", "end"), texts, strict=True):
        parts.append(drawing.text(x, -0.15, text, anchor))
    return drawing.svg(parts)


def _square(parts: Sequence[Mapping[str, Any]]) -> str:
    """Return the share of failures by two numbers, the first to the right, the second upwards."""
    columns = len({part["from"][0] for part in parts})
    rows = len(parts) // columns
    most = max(part["value"] or 0.0 for part in parts) or 1.0
    drawing = Drawing((0.0, columns), (0.0, rows), _WIDTH, 2 * _HEIGHT, _BELOW)
    cells = []
    for place, part in enumerate(parts):
        x, y = divmod(place, rows)
        value, ends = part["value"], zip(part["from"], part["to"], strict=True)
        if value is not None:
            said = f"{_product(ends)}: {100.0 * value:.3g} % of {part['rollouts']}"
            cells.append(drawing.bar((x, x + 1), (y, y + 1), _BAD, 0.04 + 0.96 * value / most, said))
    whole = _product(zip(parts[0]["from"], parts[-1]["to"], strict=True))
    text = f"{whole}, up to {100.0 * most:.3g} %"
    return drawing.svg([*cells, drawing.text(0.5 * columns, -0.075 * rows, text)])


def _product(ends: Iterable[tuple[float, float]]) -> str:
    """Return ranges of two numbers in words."""
    return " × ".join(f"{metrics.short(a, 3)} to {metrics.short(b, 3)}" for a, b in ends)
