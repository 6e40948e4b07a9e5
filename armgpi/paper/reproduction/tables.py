"""Tables of the reproduction, as Markdown, CSV and LaTeX."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
import xarray as xr

from armgpi.base.arrays import Array
from armgpi.base.escape import csv_table, latex_text, markdown_table
from armgpi.loop import metrics
from armgpi.loop.rollout import describe_end, describe_measurement
from armgpi.paper import published
from armgpi.paper.reproduction import runs

JOINTS = ("q1", "q2", "q3")
#: Metrics that the paper publishes, for every joint; the others are shown for the arm.
_PUBLISHED = published.Cells._fields
#: Significant digits of our numbers.
_DIGITS = 3


class Sheet(NamedTuple):
    """A table of text.

    Attributes:
        name: name of its files.
        title: what it shows.
        note: what to know when reading it.
        header: headings of the columns.
        rows: the cells.
    """

    name: str
    title: str
    note: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        """Return the table as Markdown."""
        return f"### {self.title}\n\n{self.note}\n\n{markdown_table(self.header, self.rows)}"

    def csv(self) -> str:
        """Return the table as CSV."""
        return csv_table(self.header, self.rows)

    def latex(self) -> str:
        """Return the table as LaTeX, without any package."""
        lines = [" & ".join(map(_latex, line)) + r" \\" for line in [self.header, *self.rows]]
        body = "\n".join([lines[0], r"\hline", *lines[1:]])
        columns = "l" * len(self.header)
        return (
            "\\begin{table}\n\\centering\\small\n"
            f"\\caption{{{_latex(self.title)}. {_latex(self.note)}}}\n"
            f"\\begin{{tabular}}{{{columns}}}\n{body}\n\\end{{tabular}}\n\\end{{table}}\n"
        )


class Contender(NamedTuple):
    """One rollout as a row of Tables 2 to 4.

    Attributes:
        name: who.
        sensors: "ideal" or "real".
        scale: factor on D(q).
        metrics: name -> value of each joint, shape (3,), for all that the tables show; infinite when it
            diverged.
        end: how it ended, in words.
        measures: what it was given, in words.
    """

    name: str
    sensors: str
    scale: float
    metrics: dict[str, Array]
    end: str
    measures: str


def contenders(results: Sequence[tuple[str, xr.Dataset]]) -> list[Contender]:
    """Return the rollouts that belong into Tables 2 to 4; each result comes with its sensors' name."""
    figure_only = (runs.SCENARIO_1, runs.SCENARIO_2, runs.UNDISTURBED)
    listed = []
    for sensors, result in results:
        tables = {metric.name: metric(result).values for metric in metrics.shown_in("reproduction")}
        ends = describe_end(result)
        stated = [key for key in ("measurement", "knows") if key in result]
        for row, name in enumerate(result["label"].values):
            if name in figure_only:
                continue
            measures = describe_measurement(*[str(result[key].values[row]) for key in stated])
            scale = float(result["scale"].values[row])
            values = {metric: table[row] for metric, table in tables.items()}
            listed.append(Contender(str(name), sensors, scale, values, ends[row], measures))
    return listed


def _heading(name: str, metric: metrics.Metric) -> str:
    """Return the heading of a column with its unit, where it has one."""
    unit = metric.unit.symbol()
    return f"{name} [{unit}]" if unit else name


def _per_joint(metric: metrics.Metric) -> list[str]:
    """Return the headings of a metric's columns, one for each joint."""
    return [_heading(f"{metric.heading} {joint}", metric) for joint in JOINTS]


def _texts(values: Iterable[float]) -> tuple[str, ...]:
    """Return numbers as text."""
    return tuple(metrics.short(float(value), _DIGITS) for value in values)


def comparison(table: published.Table, sensors: str, found: Sequence[Contender], holding: Array) -> Sheet:
    """Return Table 2, 3 or 4: published beside ours."""
    shown = [metrics.ALL[name] for name in _PUBLISHED]
    others = [metric for metric in metrics.shown_in("reproduction") if metric not in shown]
    rows: list[tuple[str, ...]] = []
    for name, cells in (("published PID-like", table.pid), ("published proposal", table.proposal)):
        printed = map(_paper_digits, chain(*cells))
        rows.append((name, "", *printed, *["not stated"] * len(others), ""))
    least: list[str] = []
    for name in _PUBLISHED:
        least += _texts(holding) if name == "isci" else [""] * len(JOINTS)
    rows.append(("holding against gravity and load alone", "", *least, *[""] * len(others), ""))
    for one in found:
        if (one.sensors, one.scale) == (sensors, table.inertia_scale):
            rows += _rows_of(one, table, shown, others)
    change = {1.0: "", 1.2: " plus 20 %", 0.8: " minus 20 %"}[table.inertia_scale]
    where = {
        "ideal": "ideal sensors",
        "real": f"{runs.BITS}-bit encoders at 1 kHz, one sample of delay, torque limits",
    }[sensors]
    header = (
        "controller",
        "measurement",
        *chain(*map(_per_joint, shown)),
        *(_heading(metric.long_name, metric) for metric in others),
        "end",
    )
    return Sheet(
        f"table-{table.number}-{sensors}",
        f"Table {table.number} (D(q){change}), {where}",
        "Smaller is better everywhere.",
        header,
        rows,
    )


def _rows_of(
    one: Contender, table: published.Table, shown: Sequence[metrics.Metric], others: Sequence[metrics.Metric]
) -> Iterator[tuple[str, ...]]:
    """Yield the row of a contender, and beside what it stands in the paper."""
    ours = chain.from_iterable(one.metrics[metric.name] for metric in shown)
    of_arm = [float(metric.of_arm(one.metrics[metric.name])) for metric in others]
    yield one.name, one.measures, *_texts([*ours, *of_arm]), one.end
    if one.name in (runs.NETWORK, runs.NEAR_PID):
        whom = "PID-like" if _published_column(table, one.name) is table.pid else "proposal"
        words = (cell.status for cell in _cells(table, one))
        yield f"... against the published {whom}", "", *words, *[""] * len(others), ""


class _Cell(NamedTuple):
    joint: str
    metric: str
    ours: float
    published: float
    status: str


def _cells(table: published.Table, one: Contender) -> Iterator[_Cell]:
    """Return the published cells that a contender is held against, with its own values."""
    theirs = _published_column(table, one.name)
    for name, cells in theirs._asdict().items():
        values = one.metrics[name].tolist()
        for joint, ours, cell in zip(JOINTS, values, cells, strict=True):
            status = published.status(ours if np.isfinite(ours) else None, cell)
            yield _Cell(joint, metrics.ALL[name].heading, ours, cell, status)


def _published_column(table: published.Table, name: str) -> published.Cells:
    """Return the published column that a contender is held against."""
    return table.pid if name in (runs.NEAR_PID, runs.TUNED_PID) else table.proposal


def statuses(found: Sequence[Contender]) -> Sheet:
    """Return every contender against every published cell."""
    rows: list[tuple[str, ...]] = []
    for table in published.TABLES:
        for one in found:
            if one.scale != table.inertia_scale:
                continue
            for cell in _cells(table, one):
                place = (str(table.number), one.sensors, one.name, cell.metric, cell.joint)
                values = (*_texts([cell.ours]), _paper_digits(cell.published))
                rows.append((*place, *values, cell.status))
    return Sheet(
        "statuses",
        "Every cell of Tables 2 to 4",
        "GPI is held against the published proposal, PID + inversion against the published PID-like "
        "controller: better (or equal), same order (less than ten times it), worse, diverged.",
        ("table", "sensors", "controller", "metric", "joint", "ours", "published", "status"),
        rows,
    )


def sensitivity(result: xr.Dataset, horizon: float) -> Sheet:
    """Return what ITAE and ISCI do when a value that the paper does not give is halved or doubled."""

    def until(end: float) -> xr.Dataset:
        return result.sel(time=slice(None, end + 1e-9))

    rollouts = until(horizon)
    cases = [(str(label), rollouts.isel(rollout=i)) for i, label in enumerate(result["label"].values)]
    half, double = until(0.5 * horizon), until(2.0 * horizon)
    cases.insert(1, ("horizon x 0.5", half.isel(rollout=0)))
    cases.insert(2, ("horizon x 2", double.isel(rollout=0)))
    base = metrics.itae(rollouts.isel(rollout=0)).values
    rows = []
    for label, rollout in cases:
        itae = metrics.itae(rollout).values
        isci = metrics.isci(rollout).values
        ratios = [f"{ratio:.2f}" for ratio in itae / base]
        rows.append((label, *_texts(itae), *ratios, *_texts(isci)))
    return Sheet(
        "sensitivity",
        "Sensitivity to what the paper does not give",
        "GPI with networks, ideal sensors, 1 kHz, 33.3..100 rad/s. The configuration at rest is zero, which "
        "has no half and no double: it is raised and lowered instead.",
        (
            "value",
            *_per_joint(metrics.ALL["itae"]),
            *(f"ITAE {joint}, ratio" for joint in JOINTS),
            *_per_joint(metrics.ALL["isci"]),
        ),
        rows,
    )


def ablation(result: xr.Dataset) -> Sheet:
    """Return networks against fixed gains over encoder resolutions, with who wins in words."""
    itae, variation = metrics.ALL["itae"], metrics.ALL["total_variation"]
    rows = []
    for bits in runs.ABLATION_BITS:
        costs = ablation_costs(result, bits)
        network = costs[runs.NETWORK]
        for label, cost in costs.items():
            values = itae(_at(result, label, bits)).values
            rows.append((str(bits), label, *_texts([*values, *cost]), _verdict(network, cost)))
    return Sheet(
        "ablation",
        "Networks against fixed gains",
        "One sample of delay at 1 kHz. The last column compares the networks with the row.",
        (
            "encoder bits",
            "gains",
            *_per_joint(itae),
            _heading(f"{itae.heading}, sum", itae),
            _heading(variation.long_name, variation),
            "networks against it",
        ),
        rows,
    )


def ablation_costs(result: xr.Dataset, bits: int) -> dict[str, tuple[float, float]]:
    """Return, at a resolution, each contender's sum of ITAE [rad s^2] and torque variation [N m]."""
    labels = dict.fromkeys(str(label) for label in result["label"].values)
    rollouts = {label: _at(result, label, bits) for label in labels}
    return {
        label: (float(metrics.itae(rollout).sum()), float(runs.variation(rollout)))
        for label, rollout in rollouts.items()
    }


def ablation_in_words(result: xr.Dataset) -> list[str]:
    """Return, for each resolution, a sentence on where the networks win and where they do not."""
    sentences = []
    for bits in runs.ABLATION_BITS:
        costs = ablation_costs(result, bits)
        network = costs.pop(runs.NETWORK)
        parts = []
        for verdict, text in (
            ("better in both", "beat {} in both"),
            ("tracks better, chatters more", "track better than {} at more chatter"),
            ("tracks worse, chatters less", "track worse than {} at less chatter"),
            ("worse in both", "lose against {} in both"),
        ):
            who = [
                name.removeprefix("GPI, ")
                for name, cost in costs.items()
                if _verdict(network, cost) == verdict
            ]
            if who:
                parts.append(text.format(", ".join(name.removeprefix("GPI, ") for name in who)))
        sentences.append(f"{bits} bits: the networks {'; they '.join(parts)}.")
    return sentences


def sweep(results: dict[str, xr.Dataset]) -> Sheet:
    """Return where eq. 23 to the letter diverges, over the learning rate, D(q) and the realisation."""
    rows = []
    for realisation, result in results.items():
        itae, ends = metrics.itae(result).sum("joint").values, describe_end(result)
        for rate in runs.SWEEP_RATES:
            cells = []
            for scale in runs.SCALES:
                here = (result["learning_rate"].values == rate) & (result["scale"].values == scale)
                row = int(np.flatnonzero(here)[0])
                cells.append(
                    f"ITAE {metrics.short(itae[row], _DIGITS)}" if ends[row] == "finished" else ends[row]
                )
            rows.append((realisation, *_texts([rate]), *cells))
    return Sheet(
        "literal-law",
        "The adaptive law to the letter (eq. 23 with e_n = e)",
        "All three parameters adapt from omega_c = p_c = 30 rad/s, zeta_c = 1; ideal sensors, 1 kHz, 40 s. "
        "Where it does not diverge: the sum of the joints' ITAE [rad s²].",
        ("realisation", "learning rate", *(f"D(q) x {scale:g}" for scale in runs.SCALES)),
        rows,
    )


def _verdict(network: tuple[float, float], other: tuple[float, float]) -> str:
    """Return in words how the networks compare with another contender."""
    if network == other:
        return ""
    tracks, chatters = network[0] < other[0], network[1] > other[1]
    if tracks:
        return "tracks better, chatters more" if chatters else "better in both"
    return "worse in both" if chatters else "tracks worse, chatters less"


def _at(result: xr.Dataset, label: str, bits: int) -> xr.Dataset:
    """Return the rollout of a contender at a resolution."""
    here = (result["label"].values == label) & (result["bits"].values == bits)
    return result.isel(rollout=int(np.flatnonzero(here)[0]))


def _paper_digits(value: float) -> str:
    """Return a published number with all the digits that the paper prints."""
    return f"{value:.7g}"


def _latex(text: str) -> str:
    """Return text with what LaTeX takes for commands written out."""
    return latex_text(text).replace("...", r"\ldots{}")


def count_statuses(sheet: Sheet, name: str, sensors: str) -> dict[str, int]:
    """Return how often a contender has each status in the sheet of :func:`statuses`."""
    counts: dict[str, int] = {}
    for row in sheet.rows:
        if row[1:3] == (sensors, name):
            counts[row[-1]] = counts.get(row[-1], 0) + 1
    return counts


def not_better(sheet: Sheet, name: str, sensors: str, holding: Array) -> list[str]:
    """Return in words every published cell that a contender does not reach."""
    words = []
    for table, where, who, metric, joint, ours, theirs, status in sheet.rows:
        if (where, who) != (sensors, name) or status == "better":
            continue
        text = f"Table {table}, {metric} of {joint}: {ours}, published {theirs} ({status})."
        if metric == metrics.ALL["isci"].heading:
            least = metrics.short(float(holding[JOINTS.index(joint)]), _DIGITS)
            text += f" Holding against gravity and load alone costs {least} on our references."
        words.append(text)
    return words
