"""All chunks of a study as a dataset, what they say, and the worst rollouts as experiment files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import combinations, product
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
import xarray as xr
from xarray.backends import H5NetCDFStore

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.base.escape import counted, json_data
from armgpi.base.intervals import clopper_pearson, quantile, wilson
from armgpi.config import ExperimentConfig, keys
from armgpi.config import experiment as experiments
from armgpi.errors import RolloutError
from armgpi.loop import metrics
from armgpi.loop.rollout import FAULTS, Status
from armgpi.studies.sample import FAILURE_SHARES, Sweep, chunk_name
from armgpi.studies.study import Study
from armgpi.supervisor import Reason

#: The file of all rollouts.
RESULTS = "results.nc"
#: Quantiles that are told of every metric.
QUANTILES = (0.5, 0.9, 0.99)
#: How many of the worst rollouts are written.
WORST = 10
#: Parts into which the range of what varies is cut for the failure maps, at most.
_PARTS = 8
#: Least rollouts in each of them.
_LEAST = 20
#: Numbers of which there are maps by two: those that failures depend on most.
_PAIRED = 4


def collect(sweep: Sweep, study: Study, rollouts: int) -> xr.Dataset:
    """Write the rollouts whose chunks are there as ``results.nc``, in order, and return them.

    A chunk at a time is in memory. What is returned stays in the file, and is read each time that it is
    asked for.

    Returns:
        What was drawn, metrics, status and end; dimensions (rollout, joint).

    Raises:
        RolloutError: when there is no chunk, one is damaged, or the file cannot be written.
    """
    chunks = []
    for chunk in range(math.ceil(rollouts / sweep.size)):
        rows = sweep.rows(chunk, rollouts)
        if study.has(chunk_name(chunk, rows)):
            chunks.append((chunk, rows))
    if not chunks:
        raise RolloutError(f"{study.folder}: there is no rollout")
    target = study.folder / RESULTS
    total = sum(rows for _, rows in chunks)
    written = 0
    with files.replace_files([target], str(target)) as (partial,), h5netcdf.File(partial, "w") as file:
        for chunk, rows in chunks:
            name = chunk_name(chunk, rows)
            table = study.read(name, (rows, len(sweep.columns)))
            if not sweep.drew(table, chunk):
                raise RolloutError(f"{study.place(name)}: has other scenarios than this sweep; remove it")
            places = np.arange(rows) + chunk * sweep.size
            part = _dataset(sweep, table, places)
            if not written:
                _declare(file, part, total)
            for key, variable in part.variables.items():
                if "rollout" in variable.dims:
                    file[str(key)][written : written + rows] = variable.values
            written += rows
    # By a file that is open already: an interrupt inside xarray's own opening leaves its lock locked.
    opened = h5netcdf.File(target, "r", decode_vlen_strings=True)
    return xr.open_dataset(H5NetCDFStore(opened, lock=False), cache=False)


def _declare(file: Any, part: xr.Dataset, rollouts: int) -> None:
    """Declare in a file what a part of the rollouts has, for all of them, as xarray would write it."""
    file.attrs.update(part.attrs)
    file.dimensions = {**part.sizes, "rollout": rollouts}
    for name, variable in part.variables.items():
        dims = variable.dims
        if name == "joint":
            names = variable.values.astype(object)
            file.create_variable(name, dims, h5py.string_dtype(), data=names)
            continue
        options: dict[str, Any] = {}
        if variable.dtype.kind == "f":
            options = {"compression": "gzip", "compression_opts": 1, "fillvalue": np.nan}
        written = file.create_variable(name, dims, variable.dtype, chunks=variable.shape, **options)
        written.attrs.update(variable.attrs)


def _dataset(sweep: Sweep, table: Array, places: Any) -> xr.Dataset:
    """Return the numbers of rollouts as a dataset."""
    robot = sweep.robot
    variables: dict[str, Any] = {}
    # Columns of the table: what was drawn, then each metric of all joints, then how the rollout ended.
    for name, column in zip(sweep.drawn_names, table.T, strict=False):
        variables[f"drawn.{name}"] = ("rollout", column, {"long_name": f"{name}, as drawn"})
    begin = len(sweep.drawn_names)
    only_slides = bool(robot.prismatic.all())
    for name in sweep.metrics:
        declared = metrics.ALL[name]
        units = declared.unit.symbol(only_slides, ascii=True)
        attributes = {"long_name": declared.long_name, "units": units}
        variables[name] = (("rollout", "joint"), table[:, begin : begin + robot.n], attributes)
        begin += robot.n
    attributes_of_ends = {
        "status": {"long_name": "how the rollout ended"},
        "t_end": {"long_name": "end of the rollout", "units": "s"},
        **FAULTS,
    }
    for name, column in zip(sweep.ends, table.T[begin:], strict=True):
        is_time = name.startswith("t_")
        values = column if is_time else column.astype(np.int32)
        variables[name] = ("rollout", values, attributes_of_ends[name])
    joints = np.array(robot.joint_names)
    coordinates = {"rollout": ("rollout", places), "joint": ("joint", joints)}
    facts = {
        "title": f"armgpi sweep of {robot.name}",
        "study": sweep.identity.digest,
        "experiment": sweep.identity.text,
        "code": sweep.identity.code_digest,
        "sampling": sweep.sampling,
    }
    dataset = xr.Dataset(variables, coordinates, facts)
    failed = sweep.fails({name: dataset[name].values for name in (*sweep.metrics, "status")})
    attributes = {"long_name": failure_words(sweep)}
    return dataset.assign(failed=("rollout", failed.astype(np.int8), attributes))


def summary(sweep: Sweep, found: xr.Dataset) -> dict[str, Any]:
    """Return what the rollouts of a study say, as plain data: probabilities and quantiles with intervals."""
    n = found.sizes["rollout"]
    failed = found["failed"].values
    diverged = found["status"].values == Status.DIVERGED
    quantiles: dict[str, Any] = {}
    for name in sweep.metrics:
        values = of_arm(found, name)
        quantiles[name] = {}
        for share in QUANTILES:
            quantiles[name][str(share)] = quantile(values, share)._asdict()
    by_one = {name: failure_map(found, [name]) for name in sweep.drawn_names}
    pairs = combinations(_strongest(by_one, failed), 2)
    by_two = [{"of": pair, "parts": failure_map(found, pair)} for pair in map(list, pairs)]
    said: dict[str, Any] = {
        "study": sweep.identity.digest,
        "controller": sweep.label,
        "rollouts": n,
        "failure": {"diverged": None, **sweep.failure},
        "probability of failure": clopper_pearson(int(failed.sum()), n)._asdict(),
        "probability of divergence": clopper_pearson(int(diverged.sum()), n)._asdict(),
        **_stops(found),
        "quantiles": quantiles,
        "failure by quantity": by_one,
        "failure by two of them": by_two,
    }
    return dict(json_data(said))


def _stops(found: xr.Dataset) -> dict[str, Any]:
    """Return how often the supervisor stopped the arm, and why; nothing where there was none."""
    if "fault" not in found:
        return {}
    faults = found["fault"].values
    counts = {}
    for reason in Reason:
        count = int((faults == reason).sum())
        if reason and count:
            counts[reason.name] = count
    stopped = clopper_pearson(int((faults > 0).sum()), len(faults))
    return {"probability of a stop": stopped._asdict(), "stops by reason": counts}


def _strongest(maps: Mapping[str, list[dict[str, Any]]], failed: Any) -> list[str]:
    """Return the names that failures depend on most, in the order of `maps`; none where there are too few."""
    if not failed.any() or len(failed) < 4 * _LEAST:
        return []
    spans = {}
    for name, parts in maps.items():
        spans[name] = np.ptp([part["value"] for part in parts])
    by_span = sorted(maps, key=lambda name: spans[name], reverse=True)
    return [name for name in maps if name in by_span[:_PAIRED]]


def sentences(said: Mapping[str, Any]) -> list[str]:
    """Return what a sweep says of failures, in words."""
    lines = []
    words = {"failure": "failed", "divergence": "diverged", "a stop": "stopped by the supervisor"}
    for name, word in words.items():
        share = said.get(f"probability of {name}")
        if share is not None:
            lines.append(
                f"{word}: {100.0 * share['value']:.3g} % of {counted(said['rollouts'], 'rollout')} "
                f"({100.0 * share['lower']:.3g} to {100.0 * share['upper']:.3g} %, 95 % Clopper-Pearson)"
            )
    reasons = said.get("stops by reason")
    if reasons:
        lines.append(f"reasons: {', '.join(f'{name} {count}' for name, count in reasons.items())}")
    return lines


def quantile_words(estimate: Mapping[str, float | None]) -> str:
    """Return an estimate with its interval; an end that is open has no number."""
    value, low, high = (_number(estimate[key]) for key in ("value", "lower", "upper"))
    if estimate["lower"] is None and estimate["upper"] is None:
        return f"{value} (open)"
    if estimate["lower"] is None:
        return f"{value} (below {high})"
    if estimate["upper"] is None:
        return f"{value} (above {low})"
    return f"{value} ({low} to {high})"


def _number(value: float | None) -> str:
    """Return a number of a summary, where JSON has none for infinity."""
    return "inf" if value is None else f"{value:.3g}"


def of_arm(found: xr.Dataset, name: str) -> Array:
    """Return a metric of the arm for every rollout: the sum or the largest of its joints."""
    return metrics.ALL[name].of_arm(found[name].values)


def heading(sweep: Sweep, name: str) -> str:
    """Return what a metric of an arm is called, with its unit."""
    metric = metrics.ALL[name]
    return f"{metric.heading} [{metric.unit.symbol(bool(sweep.robot.prismatic.all())) or '-'}]"


def failure_map(found: xr.Dataset, names: Sequence[str]) -> list[dict[str, Any]]:
    """Return how often rollouts fail in each part of the ranges of one or two numbers that were drawn.

    The range of each is cut into parts that hold about as many rollouts; the intervals are Wilson's.

    Returns:
        For each part `from`, `to` (of two numbers: lists), `rollouts`, and the share of failures.
    """
    failed = found["failed"].values
    parts_with_enough = int((len(failed) / _LEAST) ** (1.0 / len(names)))
    count = max(1, min(_PARTS, parts_with_enough))
    cut = [_cut(found[f"drawn.{name}"].values, count) for name in names]
    maps = []
    for parts in product(*cut):
        low, high, rows = zip(*parts, strict=True)
        inside = np.logical_and.reduce(rows)
        ends: dict[str, Any] = {"from": list(low), "to": list(high)}
        if len(names) == 1:
            ends = {"from": low[0], "to": high[0]}
        n = int(inside.sum())
        share = wilson(int(failed[inside].sum()), n)
        maps.append({**ends, "rollouts": n, **share._asdict()})
    return maps


def _cut(values: Array, count: int) -> list[tuple[float, float, Any]]:
    """Return parts of the range of some values: lower and upper end, and which values are in it."""
    levels = np.unique(values)
    if len(levels) <= _PARTS:
        return [(float(x), float(x), values == x) for x in levels]
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)))
    last_part = len(edges) - 2
    part_of = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, last_part)
    ends = edges.tolist()
    return [(ends[i], ends[i + 1], part_of == i) for i in range(last_part + 1)]


def worst(found: xr.Dataset, count: int = WORST) -> Any:
    """Return the places of the worst rollouts, the worst first: who diverges first, then by peak error."""
    peak = found["peak_error"].values.max(axis=1)
    return np.lexsort((found["rollout"].values, found["t_end"].values, -peak))[:count]


def write(sweep: Sweep, found: xr.Dataset, said: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write ``summary.json`` and the worst rollouts as experiments that run (``worst/``).

    Returns:
        The files of the results, that of the rollouts first.

    Raises:
        RolloutError: when something cannot be written.
    """
    chosen = worst(found)
    places = found["rollout"].values[chosen].tolist()
    configs = []
    for i, place in zip(chosen, places, strict=True):
        row = {name: float(found[f"drawn.{name}"].values[i]) for name in sweep.drawn_names}
        configs.append(sweep.config_of(row, place))
    summary_file = files.write(folder / "summary.json", json.dumps(said, indent=2) + "\n")
    return [folder / RESULTS, summary_file, *write_worst(folder, configs)]


def write_worst(folder: Path, configs: Sequence[ExperimentConfig]) -> list[Path]:
    """Write experiments as ``worst/01.yaml`` and so on, and remove those of more rollouts before.

    Raises:
        RolloutError: when they cannot be written.
    """
    where = files.make_folder(folder / "worst")
    written = []
    for place, config in enumerate(configs, start=1):
        text, copied = experiments.portable(config)
        contents = {f"{place:02d}.yaml": text.encode(), **copied}
        written += [files.write(where / name, content) for name, content in contents.items()]
    for path in {*where.glob("[0-9][0-9].yaml")}.difference(written):
        path.unlink()
    return sorted(set(written))


def drawn_heading(sweep: Sweep, name: str) -> str:
    """Return the name of a number that was drawn, with its unit where the file has it."""
    with suppress(LookupError):
        declared, _ = keys.find(sweep.experiment.config, name.partition("[")[0])
        if declared.unit:
            return f"{name} [{declared.unit}]"
    return name


def failure_words(sweep: Sweep) -> str:
    """Return when a rollout of a study has failed, in words."""
    stopped = [] if sweep.experiment.supervisor is None else ["stopped"]
    slides = bool(sweep.robot.prismatic.all())
    beyond = []
    for name, most in sweep.failure.items():
        metric = metrics.ALL[name]
        beyond.append(f"{metric.heading} > {most:g} {metric.unit.symbol(slides)}".rstrip())
    words = " or ".join(["diverged", *stopped, *beyond])
    if sweep.config.failure:
        return words
    shares = " and ".join(f"{100 * share:.0f} %" for share in FAILURE_SHARES.values())
    return f"{words} ({shares} of the largest move of a joint; the key `failure` sets other bounds)"
