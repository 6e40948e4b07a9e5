"""One HTML file with everything about some rollouts: what was run, tables, plots, the animation and the data.

It opens from a disk without a network. The plots are Plotly's, the scene is :mod:`armgpi.viz.scene`'s, and
one time moves both.
"""

from __future__ import annotations

import base64
import json
import tempfile
from collections.abc import Mapping, Sequence
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from armgpi.arrays import Array
from armgpi.config import experiment
from armgpi.errors import ArmgpiError, RolloutError
from armgpi.health import report as health
from armgpi.loop import rollout as rollouts
from armgpi.robot.robot import Robot
from armgpi.viz import meshcat, page, scene, tracks

#: Most points of a line in the plots, and most rollouts that are plotted.
POINTS, MOST_RUNS = 2400, 6
#: Most rows of the tables.
_MOST_ROWS = 400
#: Largest file of data that is put into the report [B]; beyond it the data are thinned.
DATA_BYTES = 8_000_000
#: Columns of the table: figure of merit, heading, unit for revolute joints.
_COLUMNS = (
    ("itae", "ITAE", "rad s²"),
    ("rms", "RMS error", "rad"),
    ("peak_error", "peak error", "rad"),
    ("final_error", "final error", "rad"),
    ("isci", "ISCI", "(N m)² s"),
    ("total_variation", "variation", "N m"),
    ("peak_torque", "peak", "N m"),
    ("saturated_time", "saturated", "s"),
)
_SEES = {"Measurement": "positions only", "FullState": "positions and velocities"}


def build(
    rollout: xr.Dataset,
    robot: Robot | None = None,
    *,
    title: str | None = None,
    configuration: str | None = None,
    findings: Sequence[str] = (),
    frame: str | None = None,
    folder: Path | None = None,
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

    Raises:
        RolloutError: when the rollout has no samples, or `robot` is another one.
        MissingPackage: when Plotly or MeshCat is not installed.
    """
    tracks.traces(rollout)
    if "rollout" not in rollout.dims and "label" in rollout.coords:  # one of several
        rollout = rollout.expand_dims("rollout").assign_coords(
            label=("rollout", [str(rollout["label"].values)])
        )
    arrays = page.Arrays()
    said = list(findings)
    notes: list[str] = []
    data: dict[str, Any] = {"arm": None, "clip": None, "no_arm": "", "file": "rollout.nc"}
    if robot is None:
        try:
            robot = scene.robot_of(rollout, folder)
        except RolloutError as error:
            data["no_arm"] = f"No animation: {error}"
            said.append(str(error))
    if robot is not None:
        arm = scene.build(robot, frame)
        clip = scene.clip(rollout, robot)
        data["arm"], data["clip"] = page.arm_data(arm, arrays), page.clip_data(clip, arrays)
        said += arm.findings
        troubles, notes = _health(robot)
        said += troubles
        if clip.left_out:
            said.append(f"{clip.left_out} more rollouts are not in the animation and the plots")
    data["plots"] = _plots_data(rollout, arrays)
    records = _records(rollout)
    said += _found_in(rollout, records)
    content, every = _netcdf(rollout)
    name = str(rollout.attrs.get("robot", "rollout"))
    values = {
        "title": page.text(title or name),
        "summary": _summary(rollout, records),
        "tables": _tables(rollout, records),
        "findings": (page.findings_list(said) or "<p>None.</p>") + _notes(notes),
        "configuration": _configuration(rollout, configuration),
        "download": _download(content, every),
        "footer": "Made by armgpi "
        + page.text(rollouts.versions()["armgpi"])
        + ". This file needs no network.",
        "file": base64.b64encode(content).decode(),
    }
    scripts = [page.plotly_script(), page.meshcat_script(), page.asset("scene.js"), page.asset("report.js")]
    return page.fill("report.html", values, data, arrays, scripts)


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
    provenance = json.loads(dataset.attrs["provenance"])
    singles = {}
    for index in range(dataset.sizes["rollout"]):
        run = dataset.isel(rollout=index)
        label = str(run["label"].values) if "label" in run.coords else f"rollout {index}"
        run = run.drop_vars(["label", "measurement"], errors="ignore")
        run.attrs = {
            **dataset.attrs,
            "provenance": json.dumps(provenance.get(label, provenance), sort_keys=True),
        }
        singles[label] = run
    return singles


# Plots ---------------------------------------------------------------------------------------------------


def _plots_data(rollout: xr.Dataset, arrays: page.Arrays) -> dict[str, Any]:
    """Return what the page plots."""
    traces = tracks.traces(rollout, most=None)[:MOST_RUNS]
    joints = [str(name) for name in rollout["joint"].values]
    kinds = [str(kind) for kind in rollout["joint_type"].values] if "joint_type" in rollout.coords else []
    linear = [kind == "prismatic" for kind in kinds] or [False] * len(joints)
    length = ["m" if is_linear else "rad" for is_linear in linear]
    force = ["N" if is_linear else "N m" for is_linear in linear]
    time = np.asarray(rollout["time"].values, dtype=float)
    efforts = traces[0].data["effort"].values
    levels = []
    for j in range(len(joints)):
        peak = max(_peak(trace.data["tau"].isel(joint=j).values) for trace in traces)
        effort = float(efforts[j])
        near = np.isfinite(effort) and effort < 1e300 and peak >= 0.4 * effort
        levels.append([-effort, effort] if near else [])
    onsets = [tracks.disturbance_onset(rollout, joint) for joint in joints]
    nothing: list[Any] = [None] * len(joints)

    def lines(
        values: Mapping[int, Array], names: Mapping[int, str], dash: str = "solid"
    ) -> list[dict[str, Any]]:
        """Return the lines of a quantity: run -> (time, joint); run -1 belongs to no rollout."""
        found = []
        for run, table in values.items():
            color = "#000000" if run < 0 else traces[run].look.color
            for j in range(len(joints)):
                x, y = _thinned(time, table[:, j])
                found.append(
                    {
                        "joint": j,
                        "run": run,
                        "name": names[run],
                        "color": color,
                        "dash": dash,
                        "x": arrays.add(x, "float32"),
                        "y": arrays.add(y, "float32"),
                    }
                )
        return found

    def table(trace: tracks.Trace, name: str) -> Array:
        return np.asarray(trace.data[name].transpose("time", "joint").values, dtype=float)

    labels = {i: trace.label or "actual" for i, trace in enumerate(traces)}
    quantities = [
        {
            "name": "Position",
            "units": length,
            "traces": lines({i: table(t, "q") for i, t in enumerate(traces)}, labels)
            + lines({-1: table(_longest(traces), "q_ref")}, {-1: "reference"}, "dash"),
            "levels": nothing,
            "onsets": nothing,
        },
        {
            "name": "Error",
            "units": length,
            "traces": lines({i: table(t, "q") - table(t, "q_ref") for i, t in enumerate(traces)}, labels),
            "levels": nothing,
            "onsets": onsets,
        },
        {
            "name": "Torque",
            "units": force,
            "traces": lines({i: table(t, "tau") for i, t in enumerate(traces)}, labels),
            "levels": levels,
            "onsets": onsets,
        },
    ]
    if any(onset is not None for onset in onsets):
        pushed = lines({-1: table(_longest(traces), "disturbance")}, {-1: "disturbance"})
        quantities.append(
            {"name": "Disturbance", "units": force, "traces": pushed, "levels": nothing, "onsets": nothing}
        )
    for name in [n for n in tracks.signal_names(rollout) if n in ("omega_c", "zeta_c", "p_c")]:
        values = {i: table(t, name) for i, t in enumerate(traces)}
        if any(np.nanmax(np.ptp(np.nan_to_num(v), axis=0)) > 0.0 for v in values.values()):
            units = [""] * len(joints) if name == "zeta_c" else ["rad/s"] * len(joints)
            quantities.append(
                {
                    "name": f"Gain {name}",
                    "units": units,
                    "traces": lines(values, labels),
                    "levels": nothing,
                    "onsets": onsets,
                }
            )
    return {
        "joints": joints,
        "runs": [{"label": labels[i], "color": trace.look.color} for i, trace in enumerate(traces)],
        "span": [float(time[0]), float(time[-1])]
        if time[-1] > time[0]
        else [float(time[0]), float(time[0]) + 1.0],
        "quantities": quantities,
    }


def _thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """Return a line with fewer points that looks the same: of each stretch its lowest and its highest."""
    good = np.isfinite(values)
    time, values = time[good], values[good]
    stretches = POINTS // 2
    if len(time) <= POINTS:
        return time, values
    edges = np.linspace(0, len(time), stretches + 1).astype(np.int64)
    kept = {0, len(time) - 1}
    for begin, end in pairwise(edges):
        kept.add(int(begin + np.argmin(values[begin:end])))
        kept.add(int(begin + np.argmax(values[begin:end])))
    index = np.array(sorted(kept))
    return time[index], values[index]


def _longest(traces: Sequence[tracks.Trace]) -> tracks.Trace:
    """Return the rollout with most samples of the reference."""
    return max(traces, key=lambda trace: int(np.isfinite(trace.data["q_ref"].values).sum()))


def _peak(values: Array) -> float:
    """Return the largest absolute value, 0 when there is none."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))


# Text ----------------------------------------------------------------------------------------------------


def _summary(rollout: xr.Dataset, records: Sequence[Mapping[str, Any]]) -> str:
    """Return what was run, in short."""
    provenance = _provenance(rollout)
    time = rollout["time"].values
    step = float(time[1] - time[0]) if len(time) > 1 else 0.0
    made_from = _at(provenance, "plant", "robot", default={})
    made_from = _at(made_from, "robots", 0, default=made_from)
    rows = [
        ("robot", str(rollout.attrs.get("robot", "unknown"))),
        ("joints", ", ".join(str(joint) for joint in rollout["joint"].values)),
        ("time", f"{float(time[-1]):.6g} s in {len(time)} samples of {step:.6g} s"),
    ]
    for record in records[:20]:
        sees = _SEES.get(record["measurement"], record["measurement"])
        rows.append((f"{record['label']}", f"{record['end']}; measures {sees}"))
    if len(records) > 20:
        rows.append(("...", f"{len(records) - 20} more rollouts"))
    # Its name alone: a report is passed on, and need not say whose folders it was made in.
    rows.append(("URDF", Path(str(_at(made_from, "source", default="unknown"))).name))
    rows.append(("its SHA-256", f"{_at(made_from, 'sha256', default='unknown')}"))
    if locked := _at(made_from, "locked", default={}):
        rows.append(("locked joints", ", ".join(f"{name} = {value}" for name, value in locked.items())))
    if changes := _at(made_from, "changes", default=[]):
        rows.append(("changes of the plant", json.dumps(changes)))
    versions = _at(provenance, "versions", default={})
    rows.append(("versions", ", ".join(f"{name} {value}" for name, value in versions.items())))
    return "<dl>" + "".join(f"<dt>{page.text(k)}</dt><dd>{page.text(v)}</dd>" for k, v in rows) + "</dl>"


def _tables(rollout: xr.Dataset, records: Sequence[Mapping[str, Any]]) -> str:
    """Return the figures of merit as an HTML table."""
    slides = (
        rollout["joint_type"].values == "prismatic" if "joint_type" in rollout.coords else np.zeros(1, bool)
    )
    units = [unit for *_, unit in _COLUMNS]
    if slides.all():
        units = [unit.replace("N m", "N").replace("rad", "m") for unit in units]
    head = "".join(
        f"<th scope=col>{page.text(title)}<br>{page.text(unit)}</th>"
        for (_, title, _), unit in zip(_COLUMNS, units, strict=True)
    )
    rows = []
    for record in records:
        for j, joint in enumerate(record["joints"]):
            label = page.text(record["label"]) if j == 0 else ""
            cells = "".join(f"<td>{_short(record['metrics'][name][j])}</td>" for name, *_ in _COLUMNS)
            first = " class=first" if j == 0 else ""
            name = (
                f"<th class=name>{label}</th><th scope=row title='{page.text(joint)}'>{page.text(joint)}</th>"
            )
            rows.append(f"<tr{first}>{name}{cells}</tr>")
    note = ""
    if len(rows) > _MOST_ROWS:
        note = f"<p>{len(rows) - _MOST_ROWS} more rows are left out.</p>"
    if slides.any() and not slides.all():
        note += "<p>Prismatic joints: m for rad, N for N m.</p>"
    return (
        "<div class=scroll tabindex=0 role=region aria-label='figures of merit'>"
        "<table class=figures><thead><tr>"
        f"<th class=name>controller</th><th class=name>joint</th>{head}</tr></thead>"
        f"<tbody>{''.join(rows[:_MOST_ROWS])}</tbody></table></div>{note}"
    )


def _health(robot: Robot) -> tuple[list[str], list[str]]:
    """Return what :func:`armgpi.health.inspect` finds in the robot's URDF: what is wrong, and mere notes."""
    made_from = robot.provenance
    source = Path(str(made_from["source"]))
    if not source.is_file():
        return [], []
    mimic: Literal["lock", "follow"] = "follow" if made_from.get("mimic") == "follow" else "lock"
    try:
        found = health.inspect(source, lock=made_from["locked"], mimic=mimic).findings
    except ArmgpiError as error:  # it has changed since
        return [str(error)], []
    # Meshes that are missing the scene has named already.
    wrong = [str(finding) for finding in found if finding.level != "note" and finding.kind != "mesh"]
    return wrong, [str(finding) for finding in found if finding.level == "note"]


def _notes(notes: Sequence[str]) -> str:
    """Return what is good to know as an HTML list; nothing when there is none."""
    items = "".join(f"<li>{page.text(note)}</li>" for note in notes)
    return f"<h3>Notes on the model</h3><ul>{items}</ul>" if notes else ""


def _records(rollout: xr.Dataset) -> list[dict[str, Any]]:
    """Return the figures of every rollout."""
    try:
        return experiment.records(rollout)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise RolloutError("the rollout does not say how it was made (its provenance is damaged)") from None


def _found_in(rollout: xr.Dataset, records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the rollouts themselves give reason to say."""
    said = []
    for record in records[:20]:
        if record["status"] != "finished":
            said.append(f"{record['label']}: {record['end']}")
        for what, text in (("saturated_time", "stood at its torque limit for {:.3g} s"),
                           ("limit_excess", "left its position limits by {:.3g}")):  # fmt: skip
            for joint, value in zip(record["joints"], record["metrics"][what], strict=True):
                if value is not None and value > 0.0:
                    said.append(f"{record['label']}: joint {joint!r} {text.format(value)}")
    unlimited = tracks.traces(rollout, most=None)[0].data["effort"].values
    for joint, effort in zip(rollout["joint"].values, unlimited, strict=True):
        if not np.isfinite(effort) or effort >= 1e300:
            said.append(f"joint {str(joint)!r} has no torque limit")
    return said


def _configuration(rollout: xr.Dataset, configuration: str | None) -> str:
    """Return the experiment file, and everything that the rollout knows of how it was made."""
    parts = []
    if configuration is not None:
        parts.append(f"<h3>Experiment file</h3><pre tabindex=0>{page.text(configuration)}</pre>")
    provenance = json.dumps(json.loads(rollout.attrs.get("provenance", "{}")), indent=1, ensure_ascii=False)
    parts.append(
        f"<details><summary>Everything the rollout was made from</summary><pre tabindex=0>"
        f"{page.text(provenance[:400_000])}</pre></details>"
    )
    return "".join(parts)


def _download(content: bytes, every: int) -> str:
    """Return the part with the data."""
    thinned = "" if every == 1 else f" Every {every}th sample, so that this file stays small."
    return (
        f"<p><button type=button id=download class=download>Download rollout.nc</button> "
        f"NetCDF, {len(content) / 1e6:.2g} MB; read it with <code>armgpi.load</code> or xarray.{thinned}</p>"
    )


def _netcdf(rollout: xr.Dataset) -> tuple[bytes, int]:
    """Return the rollouts as a NetCDF file, every so many samples only where all are too many."""
    every = 1
    raw = sum(v.nbytes for v in rollout.data_vars.values())
    if raw > 12 * DATA_BYTES:  # not worth trying
        every = int(np.ceil(raw / (4 * DATA_BYTES)))
    with tempfile.TemporaryDirectory() as folder:
        while True:
            file = rollouts.save(rollout.isel(time=slice(None, None, every)), Path(folder) / "rollout.nc")
            size = file.stat().st_size
            if size <= DATA_BYTES or rollout.sizes["time"] <= 2 * every:
                return file.read_bytes(), every
            every *= max(2, int(np.ceil(size / DATA_BYTES)))


def _provenance(rollout: xr.Dataset) -> dict[str, Any]:
    """Return how the (first) rollout was made."""
    try:
        provenance = json.loads(rollout.attrs["provenance"])
        if "plant" not in provenance:
            provenance = next(iter(provenance.values()))
    except (KeyError, ValueError, StopIteration, AttributeError):
        return {}
    return provenance if isinstance(provenance, dict) else {}


def _at(data: Any, *path: str | int, default: Any) -> Any:
    """Return what stands at a path of keys in plain data."""
    for key in path:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return default
    return data


def _short(value: float | None) -> str:
    """Return a number with four significant digits, rounding errors as 0; a dash when there is none."""
    if value is None:
        return "–"
    return f"{value:.4g}" if abs(value) > 1e-12 else "0"
