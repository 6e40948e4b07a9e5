"""Tables of metrics on the terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from armgpi.base import files
from armgpi.base.arrays import quantity
from armgpi.base.escape import csv_table, latex_text, printable
from armgpi.base.parameter import parameters
from armgpi.cli.parsing import refusal
from armgpi.cli.pictures import check_file
from armgpi.cli.terminal import console as console_of
from armgpi.cli.terminal import natural_width, print_wrapped, widen
from armgpi.config import Experiment
from armgpi.config.building import verdicts
from armgpi.config.experiment import describe_saturation
from armgpi.gpi.advice import COUNT_SHARE
from armgpi.gpi.gains import FixedGains
from armgpi.gpi.law import GPI
from armgpi.loop import metrics, units
from armgpi.loop.rollout import describe_measurement
from armgpi.loop.running import ROUNDING
from armgpi.plants.elastic import ElasticPlant
from armgpi.plants.plant import inside
from armgpi.plants.sensors import Encoder
from armgpi.robot.robot import Robot
from armgpi.supervisor.reasons import remedy
from armgpi.tuning.geared import is_known
from armgpi.tuning.verdict import USUAL_SENSITIVITY, Verdict, verdict

#: Length to which names of joints and controllers may be folded in tables.
_FOLDED = 10


def print_tables(experiment: Experiment, records: list[dict[str, Any]]) -> None:
    """Print a table of metrics per controller and joint, and a line on how each rollout ended."""
    console = console_of()
    robot, shown = experiment.robot, metrics.shown_in("terminal")
    chosen = metrics.of_joints(shown)
    slides = bool(robot.prismatic.all())
    title = f"{printable(robot.name)}, {experiment.t_final:.4g} s"
    if len(records) == 1:
        title = f"{printable(records[0]['label'])} on {title}"
    tables = [(title, chosen)]
    if narrow := natural_width(console, _table(title, records, chosen, slides)) > console.width:
        tables = [
            (f"{title}: {group}", [m for m in chosen if m.group == group]) for group in metrics.GROUPS[:2]
        ]
    for heading, columns in tables:
        if narrow:
            # Long names are folded; a terminal too narrow even so gets whole numbers all the same.
            widen(console, _table(heading, records, columns, slides, longest=_FOLDED))
        console.print(_table(heading, records, columns, slides))
    for line in _tool_lines(experiment, records, metrics.of_tool(shown, records)):
        print_wrapped(console, line)
    if note := units.note(robot.joint_names, robot.prismatic):
        print_wrapped(console, printable(note))
    tuned = verdicts(experiment)
    for record in records:
        _print_end(console, experiment, record, tuned.get(record["label"]))


def _tool_lines(
    experiment: Experiment, records: list[dict[str, Any]], chosen: Sequence[metrics.Metric]
) -> list[str]:
    """Return a line per controller on what its tool did; of links, wherever the encoders sit."""
    lines = []
    for record in records if chosen else ():
        values = []
        for metric in chosen:
            number = metric.text(record["metrics"][metric.name][0], 3)
            values.append(f"{metric.heading} {number} {metric.unit.symbol()}")
        if record["label"] in experiment.runs:
            values[0] += _sunk(experiment, record["label"])
        lines.append(f"{printable(record['label'])}: {', '.join(values)}")
    return lines


def _sunk(experiment: Experiment, label: str) -> str:
    """Return the part of the tool's error at the end that is static deflection, unseen by motor encoders."""
    arm = inside(experiment.runs[label][0])
    end = experiment.reference.at(experiment.t_final).q
    if not isinstance(arm, ElasticPlant) or end.ndim != 1:
        return ""
    sunk = arm.static_deflection(end)
    return f" (static deflection at the end: {metrics.short(sunk, 3)} mm)" if sunk > 0.0 else ""


def _describe_excess(robot: Robot, excesses: Sequence[float | None]) -> str:
    """Return by how much a joint left its position limits, where one did; the worst one."""
    excess = [x or 0.0 for x in excesses]
    worst = max(range(len(excess)), key=excess.__getitem__)
    if excess[worst] <= ROUNDING:
        return ""
    unit = "m" if robot.prismatic[worst] else "rad"
    return f"; {printable(robot.joint_names[worst])} left its limits by up to {excess[worst]:.3g} {unit}"


def _print_end(
    console: Any, experiment: Experiment, record: dict[str, Any], tuned: Verdict | None = None
) -> None:
    """Print how a rollout ended, and what its loop tolerates; `tuned` limits an automatic controller."""
    left = _describe_excess(experiment.robot, record["metrics"]["limit_excess"])
    measured = describe_measurement(record["measurement"], record["knows"])
    held = describe_saturation(record, experiment.t_final) if record["status"] == "finished" else ""
    end = printable(f"{record['end']}, {held}" if held else record["end"])
    line = f"{printable(record['label'])}: {end}; measures {measured}{left}"
    print_wrapped(console, line, style="yellow" if held else "")
    if stopped := re.search(r"stopped at .*: ([A-Z_]+) \(", record["end"]):
        print_wrapped(console, printable(remedy(stopped[1])))
    controller = experiment.controllers.get(record["label"])
    if isinstance(controller, GPI):
        for line in _loop(controller, tuned, experiment):
            print_wrapped(console, f"  {line}")


def check_table(path: Path | None) -> None:
    """Refuse a file for a table that cannot be written: better before a long run than after it."""
    if path is None:
        return
    if path.suffix not in _FORMATS:
        raise refusal("--table", f"{path}: expected a name that ends in {', '.join(_FORMATS)}")
    check_file(path, "--table")


def write_table(experiment: Experiment, records: list[dict[str, Any]], path: Path) -> Path:
    """Write all metrics of every controller and joint as a table in the format of a file's name."""
    slides = bool(experiment.robot.prismatic.all())
    chosen = tuple(metrics.declared().values())
    # Those of the tool stand in the row of every joint, as a table has one shape.
    heads = ["controller", "joint"]
    for metric in chosen:
        unit = metric.unit.symbol(slides)
        heads.append(f"{metric.heading} [{unit}]" if unit else metric.heading)
    # All digits for programs, four for readers.
    write = (lambda value: repr(float(value))) if path.suffix == ".csv" else metrics.short
    rows = []
    for record in records:
        for index, joint in enumerate(record["joints"]):
            values = [record["metrics"][metric.name][index] for metric in chosen]
            numbers = ("" if value is None else write(value) for value in values)
            rows.append([printable(record["label"]), printable(joint), *numbers])
    return files.write(path, _FORMATS[path.suffix](heads, rows))


def _markdown(heads: list[str], rows: list[list[str]]) -> str:
    """Return a table as Markdown."""
    rule = ["---"] * 2 + ["---:"] * (len(heads) - 2)
    lines = [[cell.replace("|", "\\|") for cell in row] for row in (heads, rule, *rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _latex(heads: list[str], rows: list[list[str]]) -> str:
    """Return a table as LaTeX."""
    first, *rest = (" & ".join(map(latex_text, row)) + r" \\" for row in (heads, *rows))
    columns = "ll" + "r" * (len(heads) - 2)
    rule = r"\hline"
    lines = (f"\\begin{{tabular}}{{{columns}}}", rule, first, rule, *rest, rule, r"\end{tabular}", "")
    return "\n".join(lines)


_FORMATS = {".csv": csv_table, ".md": _markdown, ".tex": _latex}


def _loop(controller: GPI, tuned: Verdict | None, experiment: Experiment) -> list[str]:
    """Return what the loop that is run tolerates, and what one count of the encoders does, a line each."""
    lines = [_margins(controller, tuned, experiment), _count(controller, experiment)]
    return [line for line in lines if line]


def _margins(controller: GPI, tuned: Verdict | None, experiment: Experiment) -> str:
    """Return the margins of the loop; those of an automatic controller are in its verdict."""
    if tuned is not None:
        return f"tuning {tuned.describe()}"
    if is_known(experiment.robot):
        if not isinstance(controller.gains, FixedGains):
            return ""
        judged = verdict(controller, experiment.robot)
        if not math.isfinite(judged.sensitivity):
            return "loop with elastic joints: not stable over the whole range of the joint stiffness"
        return (
            f"loop with elastic joints: Ms {judged.sensitivity:.2f} ({USUAL_SENSITIVITY}), "
            f"delay margin {1e3 * judged.spare:.3g} ms"
        )
    phase, delay, delta = controller.margins()
    spent = 0.5 * controller.dt + controller.delay
    return (
        f"loop: phase margin {math.degrees(phase):.3g} deg, stable for inertia ratios delta "
        f"{describe_ratios(delta.lower, delta.upper)}, delay margin {1e3 * delay:.3g} ms (of which sampling "
        f"and transport use {1e3 * spent:.3g})"
    )


def describe_ratios(low: float, high: float) -> str:
    """Return in words for which inertia ratios a loop is stable."""
    return f"from {low:.2g} to {high:.2g}" if math.isfinite(high) else f"above {low:.2g}"


def _count(controller: GPI, experiment: Experiment) -> str:
    """Return what one count of the encoders does to the torque; nothing where positions are exact."""
    bits = getattr(experiment.config.plant, "encoder_bits", None)
    if bits is None:
        return ""
    bits = quantity(bits, "encoder_bits", experiment.robot.joint_names, parameters(Encoder)["bits"].default)
    torque = controller.count_torque(bits)
    share = torque / controller.effort
    j = int(np.argmax(share))
    unit = "N" if experiment.robot.prismatic[j] else "N m"
    much = ": more than 1 %, which causes torque chatter" if share[j] > COUNT_SHARE else ""
    return (
        f"one encoder count changes the torque of {printable(experiment.robot.joint_names[j])} by "
        f"{torque[j]:.2g} {unit}, {100 * share[j]:.2g} % of its effort{much}"
    )


def _table(
    title: str,
    records: list[dict[str, Any]],
    columns: Sequence[metrics.Metric],
    slides: bool,
    longest: int | None = None,
) -> Table:
    """Return a table of some metrics, its names folded to a length."""
    table = Table(title=title, title_style="bold")
    labels = [printable(record["label"]) for record in records]
    joints = [*map(printable, chain(*(record["joints"] for record in records)))]
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
            names = [printable(record["label"]) if index == 0 else "", printable(joint)][-len(names_of) :]
            values = [metric.text(record["metrics"][metric.name][index]) for metric in columns]
            table.add_row(*names, *values, end_section=index == len(record["joints"]) - 1)
    return table
