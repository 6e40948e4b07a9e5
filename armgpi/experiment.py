"""Run the experiments that a configuration describes, and keep what came out in a folder."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from armgpi import metrics, rollout
from armgpi.config import Experiment, dump
from armgpi.errors import RolloutError
from armgpi.rollout import Status
from armgpi.simulation import simulate


def run(experiment: Experiment, label: str, progress: bool | None = None) -> xr.Dataset:
    """Run one of an experiment's controllers.

    Args:
        experiment: from :func:`armgpi.config.build`.
        label: which controller.
        progress: as for :func:`armgpi.simulate`.
    """
    return simulate(
        experiment.plant,
        experiment.controllers[label],
        experiment.reference,
        experiment.t_final,
        record_every=experiment.config.record_every,
        progress=progress,
    )


def compare(experiment: Experiment, progress: bool | None = None) -> xr.Dataset:
    """Run all controllers of an experiment on the same plant and reference.

    Returns:
        One dataset with a rollout per controller; coordinates ``label`` (its label) and ``sees`` (which
        measurement it was given). Ctrl-C ends it after the rollout it stopped.
    """
    runs: dict[str, xr.Dataset] = {}
    for label in experiment.controllers:
        runs[label] = run(experiment, label, progress)
        if (runs[label]["status"] == Status.INTERRUPTED).any():
            break
    return join(runs)


def join(runs: dict[str, xr.Dataset]) -> xr.Dataset:
    """Join single rollouts of one robot into one dataset, labelled along ``rollout``.

    Rollouts that were stopped early are NaN after their end.

    Raises:
        RolloutError: when there are none, or their joints or times differ.
    """
    if not runs:
        raise RolloutError("there are no rollouts to join")
    joints = {tuple(run["joint"].values) for run in runs.values()}
    if len(joints) > 1:
        raise RolloutError("rollouts of different joints cannot be joined")
    provenance = {label: json.loads(run.attrs["provenance"]) for label, run in runs.items()}
    joined = xr.concat(
        list(runs.values()), dim="rollout", data_vars="all", join="outer", combine_attrs="override"
    )
    labels = np.array(list(runs), dtype=object)
    sees = np.array([provenance[label]["measurement"] for label in runs], dtype=object)
    joined = joined.assign_coords(label=("rollout", labels), sees=("rollout", sees))
    joined.attrs["provenance"] = json.dumps(provenance, sort_keys=True)
    return joined


def records(result: xr.Dataset) -> list[dict[str, Any]]:
    """Return, for every rollout, its label, its end and its figures of merit as plain data."""
    single = "rollout" not in result.dims
    rows = result.expand_dims("rollout") if single else result
    table = metrics.summary(rows)
    ends = rollout.describe_end(rows)
    provenance = json.loads(result.attrs["provenance"])
    found = []
    for index in range(rows.sizes["rollout"]):
        label = str(rows["label"].values[index]) if "label" in rows.coords else "run"
        own = provenance.get(label, provenance)
        figures = {
            name: [_plain(x) for x in table[name].isel(rollout=index).values] for name in table.data_vars
        }
        found.append(
            {
                "label": label,
                "sees": own["measurement"],
                "status": Status(int(rows["status"].values[index])).name.lower(),
                "end": ends[index],
                "joints": [str(joint) for joint in rows["joint"].values],
                "metrics": figures,
            }
        )
    return found


def save(result: xr.Dataset, experiment: Experiment, folder: Path) -> list[Path]:
    """Write ``rollout.nc``, the exact ``experiment.yaml`` and ``metrics.json`` to a folder, made if needed.

    Raises:
        RolloutError: when the folder or a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        configuration = folder / "experiment.yaml"
        configuration.write_text(dump(experiment.config), encoding="utf-8")
        figures = folder / "metrics.json"
        figures.write_text(json.dumps(records(result), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise RolloutError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return [rollout.save(result, folder / "rollout.nc"), configuration, figures]


def worst(results: Iterable[dict[str, Any]]) -> Status:
    """Return the status that the whole outcome has: interrupted before diverged before finished."""
    statuses = {Status[record["status"].upper()] for record in results}
    for status in (Status.INTERRUPTED, Status.DIVERGED):
        if status in statuses:
            return status
    return Status.FINISHED


def _plain(value: float) -> float | None:
    """Return a number that JSON has: None for infinite (a diverged rollout)."""
    return float(value) if np.isfinite(value) else None
