"""Tables of metrics on the terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from armgpi.cli.terminal import console as console_of
from armgpi.config import Experiment
from armgpi.escape import shown
from armgpi.loop import metrics, units
from armgpi.loop.rollout import describe_measurement

#: Length to which names of joints and controllers may be folded in tables.
_FOLDED = 10


def print_tables(experiment: Experiment, records: list[dict[str, Any]]) -> None:
    """Print a table of metrics per controller and joint, and a line on how each rollout ended."""
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120
    console = console_of(width)
    robot, chosen = experiment.robot, metrics.shown_in("terminal")
    slides = bool(robot.prismatic.all())
    title = f"{shown(robot.name)}, {experiment.t_final:.4g} s"
    if len(records) == 1:
        title = f"{shown(records[0]['label'])} on {title}"
    tables = [(title, chosen)]
    if _width(console, _table(title, records, chosen, slides)) > console.width:
        tables = [(f"{title}: {group}", [m for m in chosen if m.group == group]) for group in metrics.GROUPS]
    for heading, columns in tables:
        # Long names are folded; a terminal too narrow even so gets whole numbers all the same.
        folded = _table(heading, records, columns, slides, longest=_FOLDED)
        console.width = max(console.width, _width(console, folded))
        console.print(_table(heading, records, columns, slides))
    if note := units.note(robot.joint_names, robot.prismatic):
        console.print(shown(note))
    for record in records:
        excess = max((x or 0.0 for x in record["metrics"]["limit_excess"]), default=0.0)
        left = f"; left its joint limits by up to {excess:.3g}" if excess > metrics.ROUNDING else ""
        measured = describe_measurement(record["measurement"], record["knows"])
        console.print(f"{shown(record['label'])}: {record['end']}; measures {measured}{left}")


def _table(
    title: str,
    records: list[dict[str, Any]],
    columns: Sequence[metrics.Metric],
    slides: bool,
    longest: int | None = None,
) -> Table:
    """Return a table of some metrics, its names folded to a length."""
    table = Table(title=title, title_style="bold")
    labels = [shown(record["label"]) for record in records]
    joints = [shown(joint) for record in records for joint in record["joints"]]
    names_of = {"controller": labels, "joint": joints}
    if len(records) == 1:  # the title says which
        del names_of["controller"]
    for heading, names in names_of.items():
        least = min(_FOLDED, max(map(len, (heading, *names))))
        table.add_column(heading, overflow="fold", min_width=least, max_width=longest)
    for metric in columns:
        heading = f"{metric.heading}\n{metric.unit.symbol(slides)}"
        table.add_column(heading, justify="right", no_wrap=True)
    for record in records:
        for index, joint in enumerate(record["joints"]):
            names = [shown(record["label"]) if index == 0 else "", shown(joint)][-len(names_of) :]
            values = [metric.text(record["metrics"][metric.name][index]) for metric in columns]
            table.add_row(*names, *values, end_section=index == len(record["joints"]) - 1)
    return table


def _width(console: Console, table: Table) -> int:
    """Return how wide a table is where there is room enough."""
    return Measurement.get(console, console.options.update(max_width=10_000), table).maximum
