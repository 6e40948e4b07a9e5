"""One HTML file with everything about some rollouts: what was run, tables, plots, the animation and the data.

It opens from a disk without a network. The plots are canvases, the scene is that of
:mod:`armgpi.viewing.scene`, and one time moves both.
"""

from __future__ import annotations

import base64
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr

from armgpi.base.arrays import Array
from armgpi.config import experiment
from armgpi.errors import ArmgpiError, RolloutError
from armgpi.gpi.gains import Tuning
from armgpi.health import report as health
from armgpi.health.findings import fold
from armgpi.loop import metrics, units
from armgpi.loop import rollout as rollouts
from armgpi.loop.provenance import Provenance
from armgpi.loop.units import POSITION, TORQUE, TORQUE_RATE, VELOCITY, Unit
from armgpi.robot.repairs import made_in
from armgpi.robot.robot import Robot
from armgpi.viewing import meshcat, page, scene, tracks
from armgpi.viewing.style import REFERENCE, Look, canvas_dashes

#: Most points of a line in the plots.
POINTS = 2400
#: Most rollouts that are plotted.
MOST_RUNS = 6
#: Most rows of the tables.
_MOST_ROWS = 400
#: Most rollouts of which the verdict speaks.
_MOST_VERDICTS = 20
#: Largest file of data that is put into the report [B]; beyond it the data are thinned.
DATA_BYTES = 2_500_000
#: Back end -> what it is.
_BACKENDS = {"numpy": "NumPy and Pinocchio", "compiled": "generated C"}


def build(
    rollout: xr.Dataset,
    robot: Robot | None = None,
    *,
    title: str | None = None,
    configuration: str | None = None,
    findings: Sequence[str] = (),
    frame: str | None = None,
    folder: Path | None = None,
    before: str = "",
    world: str = "",
) -> str:
    """Return the report of a rollout, or of several in one dataset, as HTML.

    Args:
        rollout: the rollout(s).
        robot: the arm; the one that the rollout was made with when not given. Where that is not found any
            more, the report has no animation and says so.
        title: what the report is called; the robot's name when not given.
        configuration: text of the experiment file.
        findings: what else is to be said of the robot or the run.
        frame: the tool; the tip when not given.
        folder: where the rollout's file lies, to look for its robot there.
        before: HTML before the verdict and the tables.
        world: what was simulated and what of it was assumed, in a line.

    Raises:
        RolloutError: when the rollout has no samples, or `robot` is another one.
        MissingPackage: when trimesh is not installed.
    """
    tracks.traces(rollout)
    if "rollout" not in rollout.dims and "label" in rollout.coords:  # one of several
        rollout = rollout.expand_dims("rollout").assign_coords(
            label=("rollout", [str(rollout["label"].values)])
        )
    arrays = page.Arrays()
    data, troubles, notes = _arm(rollout, robot, frame, folder, arrays)
    records = _records(rollout)
    findings = [*findings, *troubles, *_found_in(rollout, records)]
    content, thinning = _netcdf(rollout)
    thinned = "" if thinning == 1 else f" One sample in {thinning}, so that this file stays small."
    values = {
        "title": page.text(title or str(rollout.attrs.get("robot", "rollout"))),
        "summary": _summary(rollout, world),
        "verdict": before + _verdict(rollout, records),
        "tables": _tables(rollout, records),
        "findings": _findings(findings, notes),
        "configuration": _configuration(rollout, configuration),
        "download": f"<p><button type=button id=download class=download>Download rollout.nc</button> "
        f"NetCDF, {len(content) / 1e6:.2g} MB; read it with <code>armgpi.load</code> or xarray.{thinned}</p>",
        "file": base64.b64encode(content).decode(),
    }
    data = {**data, "plots": _plots_data(rollout, arrays), "file": "rollout.nc"}
    scripts = [page.meshcat_script(), *map(page.asset, ("scene.js", "curves.js", "report.js"))]
    return page.fill("report.html", values, data, arrays, scripts)


def sections(rollout: xr.Dataset, robot: Robot, configuration: str) -> str:
    """Return metrics, findings and configuration of rollouts as HTML, for a page with a scene of its own.

    Args:
        rollout: the rollout(s).
        robot: the arm.
        configuration: text of the experiment file.
    """
    records = _records(rollout)
    troubles, notes = _health(robot)
    parts = {
        "Metrics": _verdict(rollout, records) + _tables(rollout, records),
        "Findings": _findings([*troubles, *_found_in(rollout, records)], notes),
        "How it was made": _configuration(rollout, configuration),
    }
    return "".join(f"<section><h2>{name}</h2>{content}</section>" for name, content in parts.items())


def _findings(findings: Sequence[str], notes: Sequence[str]) -> str:
    """Return what was found, and mere notes, as HTML."""
    listed = page.bullets(findings, "findings") or "<p>None.</p>"
    if notes:
        listed += "<h3>Notes on the model</h3>" + page.bullets(notes)
    return listed


def _arm(
    rollout: xr.Dataset, robot: Robot | None, frame: str | None, folder: Path | None, arrays: page.Arrays
) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return what the page knows of the arm and its motion, what is wrong with the arm, and notes on it."""
    if robot is None:
        try:
            robot = scene.robot_of(rollout, folder)
        except RolloutError as error:
            return {"arm": None, "clip": None, "no_arm": f"No animation: {error}"}, [str(error)], []
    arm = scene.build(robot, frame)
    clip = scene.clip(rollout, robot)
    data = {"arm": page.arm_data(arm, arrays), "clip": page.clip_data(clip, arrays), "no_arm": ""}
    problems, notes = _health(robot)
    troubles = [*arm.findings, *problems]
    if clip.left_out:
        troubles.append(f"{clip.left_out} more rollouts are not in the animation and the plots")
    return data, troubles, notes


def write(html: str, path: str | PathLike[str]) -> Path:
    """Write a report to a file; it appears whole or not at all.

    Raises:
        RolloutError: when the file cannot be written.
    """
    return meshcat.write(html, path)


def merge_rollouts(files: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the rollouts of several files in one dataset.

    Args:
        files: name -> rollout(s); the name goes before labels that are in several files.

    Raises:
        RolloutError: when their joints or sample times differ.
    """
    if len(files) == 1:
        return next(iter(files.values()))
    runs: dict[str, xr.Dataset] = {}
    for name, dataset in files.items():
        for label, run in _singles(dataset).items():
            preferred = f"{name}: {label}" if label else name
            count = 2
            unique = preferred
            while unique in runs:
                unique = f"{preferred} ({count})"
                count += 1
            runs[unique] = run
    return experiment.join(runs)


def _singles(dataset: xr.Dataset) -> dict[str, xr.Dataset]:
    """Return the rollouts of a dataset one by one, each with its own provenance."""
    if "rollout" not in dataset.dims:
        return {"": dataset}
    provenance = Provenance.from_rollout(dataset)
    singles = {}
    for index in range(dataset.sizes["rollout"]):
        run = dataset.isel(rollout=index)
        label = str(run["label"].values) if "label" in run.coords else f"rollout {index}"
        run = run.drop_vars(["label", "measurement"], errors="ignore")
        run.attrs = {**dataset.attrs, "provenance": provenance.of(label).to_json()}
        singles[label] = run
    return singles


# Plots ---------------------------------------------------------------------------------------------------


class _Quantity(NamedTuple):
    """What the page plots over time, with one graph for each joint.

    Attributes:
        name: its heading.
        units: of each joint.
        traces: lines, each with the joint that it is of.
        levels: of each joint, where horizontal lines are drawn; None for none.
        onsets: of each joint, when its disturbance begins [s]; None for none.
    """

    name: str
    units: list[str]
    traces: list[dict[str, Any]]
    levels: Sequence[list[float] | None]
    onsets: Sequence[float | None]


def _plots_data(rollout: xr.Dataset, arrays: page.Arrays) -> dict[str, Any]:
    """Return what the page plots."""
    traces = tracks.traces(rollout, most=None)[:MOST_RUNS]
    time = np.asarray(rollout["time"].values, dtype=float)
    first, last = float(time[0]), float(time[-1])
    runs = []
    for trace in traces:
        look = trace.look
        runs.append({"label": trace.label or "actual", "color": look.color, "dash": canvas_dashes(look)})
    return {
        "joints": [str(name) for name in rollout["joint"].values],
        "runs": runs,
        "span": [first, last if last > first else first + 1.0],
        "quantities": [quantity._asdict() for quantity in _quantities(rollout, traces, arrays)],
        "tool": _tool_plots(time, traces, arrays),
    }


def _quantities(
    rollout: xr.Dataset, traces: Sequence[tracks.Trace], arrays: page.Arrays
) -> Iterator[_Quantity]:
    """Yield what is plotted of the joints, in the order of the page."""
    joints = [str(name) for name in rollout["joint"].values]
    prismatic = units.prismatic(rollout)
    time = np.asarray(rollout["time"].values, dtype=float)
    onsets = [tracks.disturbance_onset(rollout, joint) for joint in joints]
    none: list[None] = [None] * len(joints)
    longest = max((trace.data for trace in traces), key=_samples_of)
    dotted = Look(REFERENCE, (0, (1, 2)))
    forces = _symbols(TORQUE, prismatic)

    def of_runs(values: Callable[[xr.Dataset], xr.DataArray]) -> list[dict[str, Any]]:
        return _lines_of_runs(traces, values, arrays)

    def of_no_run(name: str, look: Look) -> list[dict[str, Any]]:
        return _lines(time, longest[name], arrays, -1, look)

    lengths = _symbols(POSITION, prismatic)
    positions = of_runs(lambda data: data["q"]) + of_no_run("q_ref", dotted)
    yield _Quantity("Position", lengths, positions, none, none)
    yield _Quantity("Error", lengths, of_runs(metrics.error), none, onsets)
    if "v" in rollout:
        velocities = of_runs(lambda data: data["v"])
        if "v_ref" in rollout:
            velocities += of_no_run("v_ref", dotted)
        yield _Quantity("Velocity", _symbols(VELOCITY, prismatic), velocities, none, none)
    torques = of_runs(lambda data: data["tau"])
    yield _Quantity("Torque", forces, torques, _levels(traces), onsets)
    torque_rates = of_runs(tracks.torque_rate)
    yield _Quantity("Torque rate", _symbols(TORQUE_RATE, prismatic), torque_rates, none, onsets)
    if any(onset is not None for onset in onsets):
        disturbance = of_no_run("disturbance", Look(REFERENCE, "-"))
        yield _Quantity("Disturbance", forces, disturbance, none, none)
    for name in _adapted_names(rollout, traces):
        unit = "" if name == "zeta_c" else "rad/s"
        gains = of_runs(operator.itemgetter(name))
        yield _Quantity(f"Gain {name}", [unit] * len(joints), gains, none, onsets)


def _samples_of(data: xr.Dataset) -> int:
    """Return how many numbers the reference of a rollout has, before the rollout ended."""
    return int(np.isfinite(data["q_ref"].values).sum())


def _symbols(unit: Unit, prismatic: Iterable[np.bool_]) -> list[str]:
    """Return the symbol of a unit for each joint."""
    return [unit.symbol(bool(slides)) for slides in prismatic]


def _lines_of_runs(
    traces: Sequence[tracks.Trace], values: Callable[[xr.Dataset], xr.DataArray], arrays: page.Arrays
) -> list[dict[str, Any]]:
    """Return the lines of a quantity of every rollout, over its own times."""
    lines = []
    for run, trace in enumerate(traces):
        drawn = values(trace.data)
        times = np.asarray(drawn["time"].values, dtype=float)
        lines += _lines(times, drawn, arrays, run, trace.look)
    return lines


def _tool_plots(time: Array, traces: Sequence[tracks.Trace], arrays: page.Arrays) -> list[dict[str, Any]]:
    """Return what the page plots of the tool: a quantity each, with a line for every rollout."""
    if not all("tool" in trace.data for trace in traces):
        return []

    def error(data: xr.Dataset) -> list[xr.DataArray]:
        return [1e3 * _length(data["tool"] - data["tool_ref"])]

    def angle(data: xr.Dataset) -> list[xr.DataArray]:
        return [data["tool_turn"] * (180.0 / math.pi)]

    def largest_force(data: xr.Dataset) -> list[xr.DataArray]:
        return [_length(data["contact_force"]).max("contact", skipna=False)]

    quantities: list[tuple[str, str, Callable[[xr.Dataset], Sequence[xr.DataArray]]]] = [
        ("Tool error", "mm", error),
        ("Tool angle", "deg", angle),
    ]
    if all("contact_force" in trace.data for trace in traces):
        quantities.append(("Force", "N", largest_force))
    if all("estimated_force" in trace.data and "rollout" not in trace.data.dims for trace in traces):
        quantities.append(("Estimated force, with its least and most", "N", _estimated_force))
    plots = []
    for name, unit, values in quantities:
        lines: list[dict[str, Any]] = []
        for run, trace in enumerate(traces):
            for drawn in values(trace.data):
                lines += _lines(time, drawn.expand_dims("joint"), arrays, run, trace.look)
        plots.append({"name": name, "unit": unit, "traces": lines})
    return plots


def _estimated_force(data: xr.Dataset) -> tuple[xr.DataArray, xr.DataArray, xr.DataArray]:
    """Return the length of an estimated force [N], and the least and the most that its interval allows."""
    low, high = data["estimated_force_low"], data["estimated_force_high"]
    nearest = low.clip(min=0.0) - high.clip(max=0.0)
    farthest = abs(low).where(abs(low) > abs(high), abs(high))
    return _length(data["estimated_force"]), _length(nearest), _length(farthest)


def _length(vectors: xr.DataArray) -> xr.DataArray:
    """Return the lengths of vectors over `axis`."""
    return (vectors**2).sum("axis", skipna=False) ** 0.5


def _lines(
    time: Array, values: xr.DataArray, arrays: page.Arrays, run: int, look: Look
) -> list[dict[str, Any]]:
    """Return a line for every joint of a quantity over time and joints; run -1 is no rollout."""
    columns = np.asarray(values.transpose("joint", "time").values, dtype=float)
    lines = []
    for joint, column in enumerate(columns):
        x, y = (arrays.add(axis, "float32") for axis in _thin_line(time, column))
        how = {"color": look.color, "dash": canvas_dashes(look)}
        lines.append({"joint": joint, "run": run, **how, "x": x, "y": y})
    return lines


def _levels(traces: Sequence[tracks.Trace]) -> list[list[float]]:
    """Return, for every joint, the effort limits that its torque comes near to."""
    levels = []
    for j, effort in enumerate(traces[0].data["effort"].values.tolist()):
        peak = 0.0
        for trace in traces:
            torque = trace.data["tau"].isel(joint=j).values
            peak = max(peak, np.max(np.abs(torque), where=np.isfinite(torque), initial=0.0))
        near = np.isfinite(effort) and effort < 1e300 and peak >= 0.4 * effort
        levels.append([-effort, effort] if near else [])
    return levels


def _adapted_names(rollout: xr.Dataset, traces: Sequence[tracks.Trace]) -> list[str]:
    """Return the recorded parameters of the tuning that change over time."""

    def changes(name: str) -> bool:
        for trace in traces:
            values = np.nan_to_num(trace.data[name].transpose("time", "joint").values)
            if np.nanmax(np.ptp(values, axis=0)) > 0.0:
                return True
        return False

    return [name for name in tracks.signal_names(rollout) if name in Tuning._fields and changes(name)]


def _thin_line(time: Array, values: Array) -> tuple[Array, Array]:
    """Return a line with fewer points that looks the same: of each stretch its lowest and its highest."""
    good = np.isfinite(values)
    time, values = time[good], values[good]
    stretches = POINTS // 2
    if len(time) <= POINTS:
        return time, values
    edges = np.linspace(0, len(time), stretches + 1).astype(np.int64)
    places_kept = [np.array([0, len(time) - 1])]
    for extreme in (np.minimum, np.maximum):
        reached = np.repeat(extreme.reduceat(values, edges[:-1]), np.diff(edges))
        places = np.flatnonzero(values == reached)
        # Of the places where a stretch has its extreme value, the first one.
        places_kept.append(places[np.searchsorted(places, edges[:-1])])
    index = np.unique(np.concatenate(places_kept))
    return time[index], values[index]


# Text ----------------------------------------------------------------------------------------------------


def _summary(rollout: xr.Dataset, world: str) -> str:
    """Return in a line what was run, and in another what was assumed."""
    time = rollout["time"].values
    step = float(time[1] - time[0]) if len(time) > 1 else 0.0
    robot, joints = str(rollout.attrs.get("robot", "unknown")), rollout.sizes["joint"]
    plural = "s" if joints > 1 else ""
    summary = f"{robot}, {joints} joint{plural}, {float(time[-1]):.6g} s in steps of {step:.6g} s"
    assumed = f"<p class=summary>{page.text(world)}</p>" if world else ""
    return f"<p class=summary>{page.text(summary)}</p>{assumed}"


def _verdict(rollout: xr.Dataset, records: Sequence[Mapping[str, Any]]) -> str:
    """Return of every rollout how it ended, its worst joint, and what its controller measures and knows."""
    linear = np.broadcast_to(units.prismatic(rollout), rollout.sizes["joint"])
    lines = []
    for record, color in zip(records[:_MOST_VERDICTS], _colors(rollout), strict=False):
        peaks = [math.inf if x is None else x for x in record["metrics"]["peak_error"]]
        worst = int(np.argmax(peaks))
        end = record["end"]
        kind = "good" if record["status"] == "finished" else "bad"
        if kind == "good":
            held = experiment.describe_saturation(record, float(rollout["time"][-1]))
            if held:
                kind, end = "fair", f"{end}, {held}"
        details = []
        if math.isfinite(peaks[worst]):
            unit = POSITION.symbol(bool(linear[worst]))
            joint = record["joints"][worst]
            details.append(f"error at most {metrics.short(peaks[worst], 3)} {unit} ({joint})")
        details.append(f"measures {rollouts.describe_measurement(record['measurement'], record['knows'])}")
        lines.append(
            f"<li>{page.dot(color)} <b class=name>{page.text(record['label'])}</b> "
            f"<span class={kind}>{page.text(end)}</span>; {page.text('; '.join(details))}</li>"
        )
    if len(records) > _MOST_VERDICTS:
        lines.append(f"<li>{len(records) - _MOST_VERDICTS} more rollouts</li>")
    return f"<ul class=verdicts>{''.join(lines)}</ul>"


def _colors(rollout: xr.Dataset) -> list[str]:
    """Return the colours of the rollouts."""
    return [trace.look.color for trace in tracks.traces(rollout, most=None)]


def _tables(rollout: xr.Dataset, records: Sequence[Mapping[str, Any]]) -> str:
    """Return the metrics as an HTML table."""
    prismatic = units.prismatic(rollout)
    shown = metrics.shown_in("report")
    of_joints = metrics.of_joints(shown)
    all_slide = bool(prismatic.all())
    headings = [f"{metric.heading}\n{metric.unit.symbol(all_slide)}" for metric in of_joints]
    rows, classes, marks = [], [], []
    for record, color in zip(records, _colors(rollout), strict=True):
        for j, joint in enumerate(record["joints"]):
            values = (metric.text(record["metrics"][metric.name][j]) for metric in of_joints)
            is_first = j == 0
            rows.append((record["label"] if is_first else "", joint, *values))
            classes.append("first" if is_first else "")
            marks.append(color if is_first else "")
    notes = []
    if len(rows) > _MOST_ROWS:
        notes.append(f"{len(rows) - _MOST_ROWS} more rows are left out.")
    unit_note = units.note([str(name) for name in rollout["joint"].values], prismatic)
    if unit_note:
        notes.append(unit_note)
    table = page.table(
        ("controller", "joint", *headings),
        rows[:_MOST_ROWS],
        label="metrics",
        names=2,
        classes=classes[:_MOST_ROWS],
        marks=marks[:_MOST_ROWS],
    )
    paragraphs = "".join(f"<p>{page.text(note)}</p>" for note in notes)
    return table + _tool_table(records, shown) + paragraphs


def _tool_table(records: Sequence[Mapping[str, Any]], shown: Sequence[metrics.Metric]) -> str:
    """Return the metrics of the tool, a row per rollout; nothing where no tool is known."""
    chosen = metrics.of_tool(shown, records)
    if not chosen:
        return ""
    headings = [f"{metric.heading}\n{metric.unit.symbol()}" for metric in chosen]
    rows = []
    for record in records[:_MOST_ROWS]:
        values = (metric.text(record["metrics"][metric.name][0]) for metric in chosen)
        rows.append((record["label"], *values))
    return page.table(("controller", *headings), rows, label="metrics of the tool", names=1)


def _health(robot: Robot) -> tuple[list[str], list[str]]:
    """Return what :func:`armgpi.health.inspect` finds of the robot and its URDF: what is wrong, and notes."""
    made_from = robot.provenance
    source = Path(str(made_from["source"]))
    if not source.is_file():
        return [], []
    mimic: Literal["lock", "follow"] = "follow" if made_from.get("mimic") == "follow" else "lock"
    try:
        found = health.find_problems(
            source,
            lock=made_from["locked"],
            mimic=mimic,
            repair=made_in(made_from),
            effort=robot.limits.effort,
            drives=robot.drives,
        )
    except ArmgpiError as error:  # it has changed since
        return [str(error)], []
    folded = fold(found)
    # Meshes that are missing the scene has named already.
    wrong = [str(finding) for finding in folded if finding.level != "info" and finding.kind != "mesh"]
    return wrong, [str(finding) for finding in folded if finding.level == "info"]


def _records(rollout: xr.Dataset) -> list[dict[str, Any]]:
    """Return the metrics of every rollout."""
    try:
        return experiment.records(rollout)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise RolloutError(
            "the rollout does not record how it was made (its provenance is damaged)"
        ) from None


def _found_in(rollout: xr.Dataset, records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the rollouts themselves report."""
    said = []
    for record in records[:20]:
        if record["status"] != "finished":
            said.append(f"{record['label']}: {record['end']}")
        if held := experiment.describe_saturation(record, float(rollout["time"][-1]), least=0.0):
            said.append(f"{record['label']}: {held}")
        symbols = _symbols(POSITION, units.prismatic(rollout))
        excesses = record["metrics"]["limit_excess"]
        for joint, value, unit in zip(record["joints"], excesses, symbols, strict=True):
            if value is not None and value > 0.0:
                said.append(
                    f"{record['label']}: joint {joint!r} left its position limits by {value:.3g} {unit}"
                )
    unlimited = tracks.traces(rollout, most=None)[0].data["effort"].values
    for joint, effort in zip(rollout["joint"].values, unlimited, strict=True):
        if not np.isfinite(effort) or effort >= 1e300:
            said.append(f"joint {str(joint)!r} has no torque limit")
    return said


def _configuration(rollout: xr.Dataset, configuration: str | None) -> str:
    """Return where everything came from, in words, and the experiment file; both folded."""
    provenance = Provenance.from_rollout(rollout)
    first = provenance.first
    made_from = first.robot
    # Its name alone: a report is passed on, and need not say whose folders it was made in.
    name = Path(str(made_from.get("source", "unknown"))).name
    said = [f"The robot is {name}, whose SHA-256 begins with {str(made_from.get('sha256', 'unknown'))[:16]}."]
    if locked := made_from.get("locked"):
        held = ", ".join(f"{joint} at {value:g}" for joint, value in locked.items())
        said.append(f"Joints held fixed: {held}.")
    said += [f"The plant's arm was changed: {_change(each)}." for each in made_from.get("changes") or ()]
    said.append(f"It was computed by {_BACKENDS.get(first.backend, first.backend)}.")
    said.append(f"Versions: {', '.join(f'{name} {value}' for name, value in first.versions.items())}.")
    parts = [page.fold("Where it came from", "".join(f"<p>{page.text(each)}</p>" for each in said))]
    if configuration is not None:
        parts.append(page.fold("Experiment file", f"<pre tabindex=0>{page.text(configuration)}</pre>"))
    everything = page.text(provenance.to_json(indent=1)[:400_000])
    parts.append(page.fold("Everything it was made from, as data", f"<pre tabindex=0>{everything}</pre>"))
    return "".join(parts)


def _change(change: Any) -> str:
    """Return a change of a robot in words: its name, and what it says of it."""
    if not isinstance(change, Mapping):
        return str(change)
    told = []
    for name, value in change.items():
        facts = value.items() if isinstance(value, Mapping) else [("", value)]
        told.append(f"{name} " + ", ".join(f"{key} {_plain(fact)}".strip() for key, fact in facts))
    return "; ".join(told).replace("_", " ")


def _plain(value: Any) -> str:
    """Return a value of the provenance as text."""
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_plain, value))})"
    if isinstance(value, Mapping) and "value" in value:  # what is known of a drive
        return f"{_plain(value['value'])} ({value.get('source', 'specified')})"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(each)}" for key, each in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def _netcdf(rollout: xr.Dataset) -> tuple[bytes, int]:
    """Return the rollouts as a NetCDF file, every so many samples only where all are too many."""
    every = 1
    raw = sum(v.nbytes for v in rollout.data_vars.values())
    if raw > 12 * DATA_BYTES:  # not worth trying
        every = int(np.ceil(raw / (4 * DATA_BYTES)))
    while True:
        content = rollouts.netcdf(rollout.isel(time=slice(None, None, every)))
        if len(content) <= DATA_BYTES or rollout.sizes["time"] <= 2 * every:
            return content, every
        every *= max(2, int(np.ceil(1.1 * len(content) / DATA_BYTES)))  # fewer samples compress a bit less
