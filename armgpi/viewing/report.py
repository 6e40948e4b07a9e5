"""One HTML file with everything about some rollouts: what was run, tables, plots, the animation and the data.

It opens from a disk without a network. The plots are canvases, the scene is that of
:mod:`armgpi.viewing.scene`, and one time moves both.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal

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
from armgpi.loop.units import POSITION, TORQUE, TORQUE_RATE, VELOCITY
from armgpi.robot.repairs import made_in
from armgpi.robot.robot import Robot
from armgpi.viewing import meshcat, page, scene, tracks
from armgpi.viewing.style import REFERENCE, Look, canvas_dashes

#: Most points of a line in the plots, and most rollouts that are plotted.
POINTS, MOST_RUNS = 2400, 6
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
    data, said, notes = _arm(rollout, robot, frame, folder, arrays)
    records = _records(rollout)
    findings = [*findings, *said, *_found_in(rollout, records)]
    content, every = _netcdf(rollout)
    thinned = "" if every == 1 else f" One sample in {every}, so that this file stays small."
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
    said = page.bullets(findings, "findings") or "<p>None.</p>"
    return said + ("<h3>Notes on the model</h3>" + page.bullets(notes) if notes else "")


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
    troubles, notes = _health(robot)
    said = [*arm.findings, *troubles]
    if clip.left_out:
        said.append(f"{clip.left_out} more rollouts are not in the animation and the plots")
    return data, said, notes


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
            wanted = f"{name}: {label}" if label else name
            count = 2
            unique = wanted
            while unique in runs:
                unique = f"{wanted} ({count})"
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


def _plots_data(rollout: xr.Dataset, arrays: page.Arrays) -> dict[str, Any]:
    """Return what the page plots."""
    traces = tracks.traces(rollout, most=None)[:MOST_RUNS]
    joints = [str(name) for name in rollout["joint"].values]
    time = np.asarray(rollout["time"].values, dtype=float)
    labels = [trace.label or "actual" for trace in traces]
    prismatic = units.prismatic(rollout)
    lengths, forces, rates = (
        [unit.symbol(slides) for slides in prismatic] for unit in (POSITION, TORQUE, TORQUE_RATE)
    )
    onsets = [tracks.disturbance_onset(rollout, joint) for joint in joints]
    nothing = [None] * len(joints)
    longest = max(traces, key=lambda trace: int(np.isfinite(trace.data["q_ref"].values).sum()))

    def each(values: Callable[[xr.Dataset], xr.DataArray]) -> list[dict[str, Any]]:
        """Return the lines of a quantity of every rollout."""
        return _lines_of_runs(traces, values, arrays)

    def common(name: str, dashes: Any) -> list[dict[str, Any]]:
        """Return the lines of a quantity that belongs to no rollout."""
        return _lines(time, longest.data[name], arrays, -1, Look(REFERENCE, dashes))

    def quantity(
        name: str,
        units: list[str],
        traces: list[dict[str, Any]],
        levels: Any = nothing,
        onsets: Any = nothing,
    ) -> dict[str, Any]:
        return {"name": name, "units": units, "traces": traces, "levels": levels, "onsets": onsets}

    position = each(lambda data: data["q"]) + common("q_ref", (0, (1, 2)))
    quantities = [
        quantity("Position", lengths, position),
        quantity("Error", lengths, each(metrics.error), onsets=onsets),
        quantity("Torque", forces, each(lambda data: data["tau"]), _levels(traces), onsets),
        quantity("Torque rate", rates, each(tracks.torque_rate), onsets=onsets),
    ]
    if "v" in rollout:
        speeds = [VELOCITY.symbol(slides) for slides in prismatic]
        lines = each(lambda data: data["v"]) + (common("v_ref", (0, (1, 2))) if "v_ref" in rollout else [])
        quantities.insert(2, quantity("Velocity", speeds, lines))
    if any(onset is not None for onset in onsets):
        quantities.append(quantity("Disturbance", forces, common("disturbance", "-")))
    for name in _adapted_names(rollout, traces):
        unit = "" if name == "zeta_c" else "rad/s"
        lines = each(lambda data, name=name: data[name])  # type: ignore[misc]
        quantities.append(quantity(f"Gain {name}", [unit] * len(joints), lines, onsets=onsets))
    first, last = float(time[0]), float(time[-1])
    return {
        "joints": joints,
        "runs": [
            {"label": labels[i], "color": trace.look.color, "dash": canvas_dashes(trace.look)}
            for i, trace in enumerate(traces)
        ],
        "span": [first, last if last > first else first + 1.0],
        "quantities": quantities,
        "tool": _tool_plots(time, traces, arrays),
    }


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
    quantities: list[tuple[str, str, Callable[[xr.Dataset], xr.DataArray]]] = [
        ("Tool error", "mm", lambda data: 1e3 * _length(data["tool"] - data["tool_ref"])),
        ("Tool angle", "deg", lambda data: data["tool_turn"] * (180.0 / math.pi)),
    ]
    if all("contact_force" in trace.data for trace in traces):
        quantities.append(
            ("Force", "N", lambda data: _length(data["contact_force"]).max("contact", skipna=False))
        )
    found = []
    for name, unit, values in quantities:
        lines = []
        for run, trace in enumerate(traces):
            lines += _lines(time, values(trace.data).expand_dims("joint"), arrays, run, trace.look)
        found.append({"name": name, "unit": unit, "traces": lines})
    if all("estimated_force" in trace.data and "rollout" not in trace.data.dims for trace in traces):
        lines = []
        for run, trace in enumerate(traces):
            for force in _estimated_force(trace.data):
                lines += _lines(time, force.expand_dims("joint"), arrays, run, trace.look)
        found.append({"name": "Estimated force, with its least and most", "unit": "N", "traces": lines})
    return found


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
    found = []
    for joint, column in enumerate(np.asarray(values.transpose("joint", "time").values, dtype=float)):
        x, y = (arrays.add(axis, "float32") for axis in _thin_line(time, column))
        how = {"color": look.color, "dash": canvas_dashes(look)}
        found.append({"joint": joint, "run": run, **how, "x": x, "y": y})
    return found


def _levels(traces: Sequence[tracks.Trace]) -> list[list[float]]:
    """Return, for every joint, the effort limits that its torque comes near to."""
    levels = []
    for j, effort in enumerate(traces[0].data["effort"].values.tolist()):
        torques = [trace.data["tau"].isel(joint=j).values for trace in traces]
        peak = max(np.max(np.abs(x), where=np.isfinite(x), initial=0.0) for x in torques)
        near = np.isfinite(effort) and effort < 1e300 and peak >= 0.4 * effort
        levels.append([-effort, effort] if near else [])
    return levels


def _adapted_names(rollout: xr.Dataset, traces: Sequence[tracks.Trace]) -> list[str]:
    """Return the recorded parameters of the tuning that change over time."""
    names = [name for name in tracks.signal_names(rollout) if name in Tuning._fields]
    return [
        name
        for name in names
        if any(
            np.nanmax(np.ptp(np.nan_to_num(trace.data[name].transpose("time", "joint").values), axis=0)) > 0.0
            for trace in traces
        )
    ]


def _thin_line(time: Array, values: Array) -> tuple[Array, Array]:
    """Return a line with fewer points that looks the same: of each stretch its lowest and its highest."""
    good = np.isfinite(values)
    time, values = time[good], values[good]
    stretches = POINTS // 2
    if len(time) <= POINTS:
        return time, values
    edges = np.linspace(0, len(time), stretches + 1).astype(np.int64)
    kept = [np.array([0, len(time) - 1])]
    for extreme in (np.minimum, np.maximum):
        reached = np.repeat(extreme.reduceat(values, edges[:-1]), np.diff(edges))
        places = np.flatnonzero(values == reached)
        # Of the places where a stretch has its extreme value, the first one.
        kept.append(places[np.searchsorted(places, edges[:-1])])
    index = np.unique(np.concatenate(kept))
    return time[index], values[index]


# Text ----------------------------------------------------------------------------------------------------


def _summary(rollout: xr.Dataset, world: str) -> str:
    """Return in a line what was run, and in another what was assumed."""
    time = rollout["time"].values
    step = float(time[1] - time[0]) if len(time) > 1 else 0.0
    robot, joints = str(rollout.attrs.get("robot", "unknown")), rollout.sizes["joint"]
    said = f"{robot}, {joints} joint{'s' * (joints > 1)}, {float(time[-1]):.6g} s in steps of {step:.6g} s"
    assumed = f"<p class=summary>{page.text(world)}</p>" if world else ""
    return f"<p class=summary>{page.text(said)}</p>{assumed}"


def _verdict(rollout: xr.Dataset, records: Sequence[Mapping[str, Any]]) -> str:
    """Return of every rollout how it ended, its worst joint, and what its controller measures and knows."""
    linear = np.broadcast_to(units.prismatic(rollout), rollout.sizes["joint"])
    lines = []
    for record, color in zip(records[:_MOST_VERDICTS], _colors(rollout), strict=False):
        peaks = [math.inf if x is None else x for x in record["metrics"]["peak_error"]]
        worst = int(np.argmax(peaks))
        said = [record["end"]]
        if math.isfinite(peaks[worst]):
            unit = POSITION.symbol(bool(linear[worst]))
            said.append(f"error at most {metrics.short(peaks[worst], 3)} {unit} ({record['joints'][worst]})")
        said.append(f"measures {rollouts.describe_measurement(record['measurement'], record['knows'])}")
        kind = "good" if record["status"] == "finished" else "bad"
        if kind == "good" and (held := experiment.describe_saturation(record, float(rollout["time"][-1]))):
            kind, said[0] = "fair", f"{said[0]}, {held}"
        lines.append(
            f"<li>{page.dot(color)} <b class=name>{page.text(record['label'])}</b> "
            f"<span class={kind}>{page.text(said[0])}</span>; {page.text('; '.join(said[1:]))}</li>"
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
    every = metrics.shown_in("report")
    shown = metrics.of_joints(every)
    headings = [f"{metric.heading}\n{metric.unit.symbol(bool(prismatic.all()))}" for metric in shown]
    rows, classes, marks = [], [], []
    for record, color in zip(records, _colors(rollout), strict=True):
        for j, joint in enumerate(record["joints"]):
            values = (metric.text(record["metrics"][metric.name][j]) for metric in shown)
            label, kind, mark = (record["label"], "first", color) if j == 0 else ("", "", "")
            rows.append((label, joint, *values))
            classes.append(kind)
            marks.append(mark)
    notes = [f"{len(rows) - _MOST_ROWS} more rows are left out."] if len(rows) > _MOST_ROWS else []
    notes += filter(None, [units.note([str(name) for name in rollout["joint"].values], prismatic)])
    table = page.table(
        ("controller", "joint", *headings),
        rows[:_MOST_ROWS],
        label="metrics",
        names=2,
        classes=classes[:_MOST_ROWS],
        marks=marks[:_MOST_ROWS],
    )
    return table + _tool_table(records, every) + "".join(f"<p>{page.text(note)}</p>" for note in notes)


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
        for joint, value in zip(record["joints"], record["metrics"]["limit_excess"], strict=True):
            if value is not None and value > 0.0:
                said.append(f"{record['label']}: joint {joint!r} left its position limits by {value:.3g}")
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
