"""One page of a sweep: what it says, distributions of metrics, failure maps, and the worst rollout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from armgpi.arrays import Array
from armgpi.config import build, dump
from armgpi.config import experiment as experiments
from armgpi.loop import metrics
from armgpi.studies.results import QUANTILES, of_arm, sentences, worst
from armgpi.studies.sample import Sweep
from armgpi.viz import page, report

#: Bars of a histogram, and size of a picture [px].
_BARS, _WIDTH, _HEIGHT, _HEIGHT_2 = 40, 300, 110, 218
#: Colours: a bar, one of what has failed, an interval, a line of text.
_BAR, _BAD, _LINE, _TEXT = "#4878a8", "#c44e52", "#1b2127", "#5a6570"


def html(sweep: Sweep, found: xr.Dataset, said: Mapping[str, Any]) -> str:
    """Return the page.

    Args:
        sweep: what was run.
        found: its rollouts, from :func:`armgpi.studies.results.collect`.
        said: from :func:`armgpi.studies.results.summary`.

    Raises:
        MissingPackage: when trimesh is not installed.
    """
    i = int(worst(found, 1)[0])
    row = {name: float(found[f"drawn.{name}"].values[i]) for name in sweep.drawn}
    config = sweep.config_of(row, int(found["rollout"].values[i]))
    experiment = build(config)
    rollout = experiments.join({sweep.label: experiments.run(experiment, sweep.label, progress=False)})
    parts = [
        page.bullets(sentences(said)),
        _table(sweep, said),
        "<h3>Distribution of every metric</h3>",
        _figures((_heading(name), _histogram(of_arm(found, name))) for name in sweep.metrics),
        "<h3>Share of failures by what was drawn</h3>",
        _figures((name, _map(rows)) for name, rows in said["failure by what was drawn"].items()),
        _figures((" × ".join(pair["of"]), _square(pair["parts"])) for pair in said["failure by two of them"]),
        f"<p>Rollout {int(found['rollout'].values[i])}, the worst, is the one that is played and below.</p>",
    ]
    return report.build(
        rollout,
        experiment.robot,
        title=f"Sweep of {sweep.robot.name}: {found.sizes['rollout']} rollouts",
        configuration=dump(config),
        before="".join(parts),
    )


def _table(sweep: Sweep, said: Mapping[str, Any]) -> str:
    """Return the quantiles of the metrics as a table."""
    rows, sliding = [], bool(sweep.robot.prismatic.all())
    for name in sweep.metrics:
        cells = [_cell(said["quantiles"][name][str(share)]) for share in QUANTILES]
        rows.append(
            [f"{metrics.ALL[name].heading} [{metrics.ALL[name].unit.symbol(sliding) or '-'}]", *cells]
        )
    head = ["metric of the arm", *(f"{100 * share:g} %" for share in QUANTILES)]
    return page.table(head, rows, label="Quantiles of the metrics with 95 % intervals")


def _cell(estimate: Mapping[str, float | None]) -> str:
    """Return an estimate with its interval as text."""
    value, low, high = (
        "inf" if x is None else metrics.short(x, 3)
        for x in (estimate[k] for k in ("value", "lower", "upper"))
    )
    return f"{value} ({low} to {high})"


def _figures(pictures: Any) -> str:
    """Return pictures with their titles, side by side."""
    shown = (f"<figure><figcaption>{page.text(title)}</figcaption>{svg}</figure>" for title, svg in pictures)
    return f"<div class=figures>{''.join(shown)}</div>"


def _heading(name: str) -> str:
    """Return what a metric is called, with its unit."""
    metric = metrics.ALL[name]
    return f"{metric.heading} [{metric.unit.symbol(False)}]"


def _histogram(values: Array) -> str:
    """Return a histogram of finite values; a logarithmic one where they span more than a hundredfold."""
    finite = values[np.isfinite(values)]
    lost = len(values) - len(finite)
    if not len(finite):
        return "<p>All infinite.</p>"
    positive = finite[finite > 0.0]
    log = len(positive) == len(finite) and positive.max() > 100.0 * positive.min()
    drawn = np.log10(finite) if log else finite
    counts, edges = np.histogram(drawn, bins=_BARS)
    ends = [10.0**x if log else x for x in (edges[0], edges[-1])]
    note = f"; {lost} infinite" if lost else ""
    bars = [(k / _BARS, 1.0 / _BARS, count / max(1, counts.max()), _BAR) for k, count in enumerate(counts)]
    scale = "log" if log else "linear"
    texts = [metrics.short(float(ends[0]), 3), f"{scale}{note}", metrics.short(float(ends[1]), 3)]
    return _svg(bars, texts, top=f"{counts.max()} of {len(values)} rollouts")


def _map(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the share of failures in each part of a range, with its interval."""
    rows = [row for row in rows if row["rollouts"]]
    most = max(max(row["upper"] for row in rows), 1e-6)
    bars = [(k / len(rows), 1.0 / len(rows), row["value"] / most, _BAD) for k, row in enumerate(rows)]
    lines = [((k + 0.5) / len(rows), row["lower"] / most, row["upper"] / most) for k, row in enumerate(rows)]
    texts = [
        metrics.short(rows[0]["from"], 3),
        f"up to {100.0 * most:.3g} %",
        metrics.short(rows[-1]["to"], 3),
    ]
    return _svg(bars, texts, lines)


def _square(parts: Sequence[Mapping[str, Any]]) -> str:
    """Return the share of failures by two numbers, the first to the right, the second upwards."""
    columns = len({part["from"][0] for part in parts})
    rows = len(parts) // columns
    most = max(part["value"] or 0.0 for part in parts) or 1.0
    cells = []
    wide, high = _WIDTH / columns, (_HEIGHT_2 - 18) / rows
    for place, part in enumerate(parts):
        x, y = divmod(place, rows)
        value, ends = part["value"], zip(part["from"], part["to"], strict=True)
        if value is None:
            continue
        said = " × ".join(f"{metrics.short(a, 3)} to {metrics.short(b, 3)}" for a, b in ends)
        cells.append(
            f'<rect x="{wide * x:.1f}" y="{high * (rows - 1 - y):.1f}" width="{wide - 1:.1f}" '
            f'height="{high - 1:.1f}" fill="{_BAD}" fill-opacity="{0.04 + 0.96 * value / most:.2f}">'
            f"<title>{page.text(said)}: {100.0 * value:.3g} % of {part['rollouts']}</title></rect>"
        )
    (a, b), (c, d) = parts[0]["from"], parts[-1]["to"]
    text = f"{metrics.short(a, 3)} to {metrics.short(c, 3)} × {metrics.short(b, 3)} to {metrics.short(d, 3)}"
    label = (
        f'<text x="{_WIDTH / 2}" y="{_HEIGHT_2 - 4}" text-anchor="middle" font-size="11" fill="{_TEXT}">'
        f"{page.text(text)}, up to {100.0 * most:.3g} %</text>"
    )
    return page.drawing([*cells, label], _WIDTH, _HEIGHT_2)


def _svg(
    bars: Sequence[tuple[float, float, float, str]],
    texts: Sequence[str],
    lines: Sequence[tuple[float, float, float]] = (),
    top: str = "",
) -> str:
    """Return bars (left, width, height, colour) and vertical lines (at, from, to), in shares, with axes."""
    high = _HEIGHT - 18
    parts = [
        f'<path d="M0.5 0V{high}H{_WIDTH}" fill="none" stroke="{_LINE}"/>',
        f'<text x="4" y="10" font-size="11" fill="{_TEXT}">{page.text(top)}</text>',
    ]
    parts += [
        f'<rect x="{_WIDTH * x:.1f}" y="{high * (1 - h):.1f}" width="{max(0.5, _WIDTH * w - 1):.1f}" '
        f'height="{high * h:.1f}" fill="{colour}"/>'
        for x, w, h, colour in bars
    ]
    for x, a, b in lines:
        ends = (
            f'x1="{_WIDTH * x:.1f}" x2="{_WIDTH * x:.1f}" y1="{high * (1 - a):.1f}" y2="{high * (1 - b):.1f}"'
        )
        parts.append(f'<line {ends} stroke="{_LINE}" stroke-width="1.5"/>')
    places = ((0, "start"), (_WIDTH / 2, "middle"), (_WIDTH, "end"))
    for (x, anchor), text in zip(places, texts, strict=True):
        kind = f'text-anchor="{anchor}" font-size="11" fill="{_TEXT}"'
        parts.append(f'<text x="{x}" y="{_HEIGHT - 4}" {kind}>{page.text(text)}</text>')
    return page.drawing(parts, _WIDTH, _HEIGHT)
