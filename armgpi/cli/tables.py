"""Tables of figures on the terminal."""

from __future__ import annotations

import os
import sys
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from armgpi.config import Experiment

#: Figures of a table: name in the records, heading.
_Columns = tuple[tuple[str, str], ...]
#: Length to which names of joints and controllers may be folded in tables.
_FOLDED = 10

#: Beyond a limit by less is no more than rounding [rad or m].
_ROUNDING = 1e-12


def print_tables(experiment: Experiment, records: list[dict[str, Any]]) -> None:
    """Print a table of figures per controller and joint, and a line on how each rollout ended."""
    errors: _Columns = (
        ("itae", "ITAE\nrad s²"),
        ("peak_error", "peak error\nrad"),
        ("final_error", "final error\nrad"),
    )
    torques: _Columns = (
        ("isci", "ISCI\n(N m)² s"),
        ("total_variation", "variation\nN m"),
        ("peak_torque", "peak\nN m"),
        ("saturated_time", "saturated\ns"),
    )
    seen = {"Measurement": "positions only", "FullState": "positions and velocities"}
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120
    console = Console(width=width, markup=False, emoji=False, highlight=False)
    slides = [kind == "prismatic" for kind in experiment.robot.joint_types]
    if all(slides):
        errors, torques = _sliding(errors), _sliding(torques)
    title = f"{experiment.robot.name}, {experiment.t_final:.4g} s"
    if len(records) == 1:
        title = f"{records[0]['label']} on {title}"
    tables = [(title, errors + torques)]
    if _width(console, _table(title, records, errors + torques)) > console.width:
        tables = [(f"{title}: errors", errors), (f"{title}: torques", torques)]
    for heading, columns in tables:
        # Long names are folded; a terminal too narrow even so gets whole numbers all the same.
        folded = _table(heading, records, columns, longest=_FOLDED)
        console.width = max(console.width, _width(console, folded))
        console.print(_table(heading, records, columns))
    if any(slides) and not all(slides):
        names = [n for n, slide in zip(experiment.robot.joint_names, slides, strict=True) if slide]
        console.print(f"prismatic: {', '.join(names)}: m for rad, N for N m")
    for record in records:
        excess = max((x or 0.0 for x in record["metrics"]["limit_excess"]), default=0.0)
        note = f"; left its joint limits by up to {excess:.3g}" if excess > _ROUNDING else ""
        console.print(f"{record['label']}: {record['end']}; measures {seen[record['measurement']]}{note}")


def _sliding(columns: _Columns) -> _Columns:
    """Return columns with the units of prismatic joints."""
    return tuple((name, text.replace("N m", "N").replace("rad", "m")) for name, text in columns)


def _table(
    title: str,
    records: list[dict[str, Any]],
    columns: _Columns,
    longest: int | None = None,
) -> Table:
    """Return a table of some figures, its names folded to a length."""
    table = Table(title=title, title_style="bold")
    labels = [record["label"] for record in records]
    joints = [joint for record in records for joint in record["joints"]]
    names_of = {"controller": labels, "joint": joints}
    if len(records) == 1:  # the title says which
        del names_of["controller"]
    for heading, names in names_of.items():
        least = min(_FOLDED, max(map(len, (heading, *names))))
        table.add_column(heading, overflow="fold", min_width=least, max_width=longest)
    for _, heading in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for record in records:
        for index, joint in enumerate(record["joints"]):
            names = [record["label"] if index == 0 else "", joint][-len(names_of) :]
            values = [_short(record["metrics"][name][index]) for name, _ in columns]
            table.add_row(*names, *values, end_section=index == len(record["joints"]) - 1)
    return table


def _width(console: Console, table: Table) -> int:
    """Return how wide a table is where there is room enough."""
    return Measurement.get(console, console.options.update(max_width=10_000), table).maximum


def _short(value: float | None) -> str:
    """Return a number with four significant digits, rounding errors as 0; a dash when there is none."""
    if value is None:
        return "-"
    return f"{value:.4g}" if abs(value) > 1e-12 else "0"
