"""Run the experiments that a configuration describes, and keep what came out in a folder."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armgpi.base import files
from armgpi.base.escape import json_data
from armgpi.config import Experiment, ExperimentConfig, dump
from armgpi.config.arms import expand
from armgpi.config.reading import with_nominals
from armgpi.config.schema import REFERENCE_FILES
from armgpi.errors import RolloutError
from armgpi.gpi.law import GPI
from armgpi.loop import metrics, rollout
from armgpi.loop.prepared import prepare as prepare_loop
from armgpi.loop.provenance import Provenance
from armgpi.loop.rollout import Recorded, Status
from armgpi.robot import robots

if TYPE_CHECKING:
    import xarray as xr

#: Largest size of a file that is copied beside an experiment [bytes]: a trajectory's.
_MOST_BYTES = 256 * 1024 * 1024


def run(
    experiment: Experiment, label: str, progress: bool | None = None, backend: str = "auto"
) -> xr.Dataset:
    """Run one of an experiment's controllers; where its gains adapt they are recorded, with their networks.

    Args:
        experiment: from :func:`armgpi.config.build`.
        label: which one of ``experiment.runs``: a controller, or one of several plants with it.
        progress: as for :func:`armgpi.simulate`.
        backend: likewise; "auto" takes generated code where that is faster.
    """
    return record(experiment, label, progress, backend).dataset()


def record(
    experiment: Experiment,
    label: str,
    progress: bool | None = None,
    backend: str = "auto",
    partial: bool = False,
) -> Recorded:
    """Run one of an experiment's controllers as :func:`run` does, and make no dataset of it.

    On Ctrl-C what is there is returned where it is wanted (`partial`).
    """
    plant, controller = experiment.runs[label]
    loop = prepare_loop(
        plant,
        controller,
        experiment.reference,
        experiment.t_final,
        record_every=experiment.config.record_every,
        signals=isinstance(controller, GPI) and controller.gains.adaptive,
        backend=backend,
        supervisor=experiment.supervisor,
    )
    return loop.record(progress, partial)


def record_all(
    experiment: Experiment, progress: bool | None = None, backend: str = "auto"
) -> dict[str, Recorded]:
    """Run all controllers of an experiment as :func:`compare` does, and make no dataset of it."""
    found: dict[str, Recorded] = {}
    for label in experiment.runs:
        found[label] = record(experiment, label, progress, backend, partial=True)
        if (found[label].recording.status == Status.INTERRUPTED).any():
            break
    return found


def compare(experiment: Experiment, progress: bool | None = None, backend: str = "auto") -> xr.Dataset:
    """Run all controllers of an experiment on the same reference and plant, or in two simulators.

    Returns:
        One dataset with a rollout per controller; coordinates ``label`` and ``measurement`` (what it
        measured). Ctrl-C ends it after the rollout it stopped.
    """
    found = record_all(experiment, progress, backend)
    return join({label: each.dataset() for label, each in found.items()})


def join(runs: dict[str, xr.Dataset]) -> xr.Dataset:
    """Join single rollouts of one robot into one dataset, labelled along ``rollout``.

    Rollouts that were stopped early are NaN after their end, and in variables that only others have.

    Raises:
        RolloutError: when there are none, or their joints or sample times differ.
    """
    import xarray as xr

    if not runs:
        raise RolloutError("there are no rollouts to join")
    joints = {tuple(run["joint"].values) for run in runs.values()}
    if len(joints) > 1:
        raise RolloutError("rollouts of different joints cannot be joined")
    times = max((run["time"].values for run in runs.values()), key=len)
    if any(not np.array_equal(run["time"], times[: run.sizes["time"]]) for run in runs.values()):
        raise RolloutError("rollouts sampled at different times cannot be joined")
    provenance = {label: Provenance.from_rollout(run) for label, run in runs.items()}
    joined = xr.concat(
        list(runs.values()), dim="rollout", data_vars="all", join="outer", combine_attrs="override"
    )
    labels = np.array(list(runs))
    measured = np.array([provenance[label].measurement for label in runs])
    joined = joined.assign_coords(label=("rollout", labels), measurement=("rollout", measured))
    joined.attrs["provenance"] = Provenance.join(provenance).to_json()
    return joined


def records(result: xr.Dataset) -> list[dict[str, Any]]:
    """Return, for every rollout, its label, its end and its metrics as plain data."""
    single = "rollout" not in result.dims
    rows = result.expand_dims("rollout") if single else result
    # A run that was stopped at once has no metrics.
    table = metrics.summary(rows) if rows.sizes["time"] > 1 else None
    ends = rollout.describe_end(rows)
    provenance = Provenance.from_rollout(result)
    joints = [str(joint) for joint in rows["joint"].values]
    found = []
    for index, status in enumerate(rows["status"].values):
        if "label" in rows.coords:
            label = str(rows["label"].values[index])
        else:
            label = "run" if single else f"rollout {index}"
        values = None
        if table is not None:
            values = {name: table[name].isel(rollout=index).values for name in metrics.declared()}
        found.append(_record(label, provenance.of(label), status, ends[index], joints, values))
    return found


def records_of(runs: Mapping[str, Recorded]) -> list[dict[str, Any]]:
    """Return the same of single runs by their labels, of which no dataset was made."""
    found = []
    for label, each in runs.items():
        values = None
        if each.recording.kept_samples > 1:
            values = {name: x[0] for name, x in metrics.of_recorded(each).items()}
        provenance, joints = Provenance(each.made_from), list(each.robot.joint_names)
        found.append(_record(label, provenance, each.recording.status[0], each.ends()[0], joints, values))
    return found


def _record(
    label: str, made_from: Provenance, status: int, end: str, joints: list[str], values: Any
) -> dict[str, Any]:
    """Return what is said of a rollout; its metrics are None where a run was stopped at once."""
    return {
        "label": label,
        "measurement": made_from.measurement,
        "knows": made_from.knows,
        "status": Status(int(status)).name.lower(),
        "end": end,
        "joints": joints,
        "metrics": {
            name: [None] * len(joints) if values is None else json_data(values[name].tolist())
            for name in metrics.declared()
        },
    }


def describe_saturation(record: Mapping[str, Any], duration: float, least: float = 0.05) -> str:
    """Return which joints were at their torque limits for more than a share of the time; empty for none."""
    seconds = zip(record["joints"], record["metrics"]["saturated_time"], strict=True)
    shares = [(joint, (value or 0.0) / (duration or 1.0)) for joint, value in seconds]
    said = [f"{joint} for {100.0 * share:.2g} %" for joint, share in shares if share > least]
    return f"at its torque limit: {', '.join(said)} of the time" if said else ""


def prepare(folder: Path) -> None:
    """Make a folder for results and try to write there: better before a long run than after it.

    Raises:
        RolloutError: when the folder cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise RolloutError(
            f"{folder}: cannot be written to: {error.strerror or error}; choose another folder"
        ) from None


@contextmanager
def prepared(folder: Path) -> Iterator[None]:
    """Make a folder for results, and take it away again where what follows fails and left it empty.

    Raises:
        RolloutError: when the folder cannot be made or written to.
    """
    is_new = not folder.exists()
    prepare(folder)
    try:
        yield
    except BaseException:  # an interruption too
        if is_new:
            with suppress(OSError):  # there is something in it
                folder.rmdir()
        raise


def save(
    result: xr.Dataset, experiment: Experiment, folder: Path, more: Mapping[str, str | bytes] | None = None
) -> list[Path]:
    """Write ``rollout.nc``, the exact ``experiment.yaml`` and ``metrics.json`` to a folder, made if needed.

    ``SHA256SUMS``, written last, has their hashes: files of two runs are not taken for those of one.

    The experiment file has every default written out, and a URDF that was given by its path is copied
    beside it: it makes the same rollout again, also on another machine.

    Args:
        result: the rollouts.
        experiment: what they came from.
        folder: where to.
        more: further files, name -> text.

    Raises:
        RolloutError: when the folder or a file cannot be written.
    """
    prepare(folder)
    config, copied = portable(experiment.config)
    contents: dict[str, str | bytes] = {
        "rollout.nc": rollout.netcdf(result),
        "experiment.yaml": config,
        "metrics.json": json.dumps(records(result), indent=2) + "\n",
    }
    return files.write_set(folder, contents | copied | dict(more or {}))


def is_another(experiment: Experiment, folder: Path) -> bool:
    """Tell whether a folder holds what came out of another experiment, or of one that is not known."""
    beside = folder / "experiment.yaml"
    try:
        if beside.is_file():
            return files.read_bytes(beside, _MOST_BYTES) != portable(experiment.config)[0].encode()
        return (folder / "rollout.nc").exists()
    except OSError:
        return True


def portable(config: ExperimentConfig, full: bool = True) -> tuple[str, dict[str, bytes]]:
    """Return the configuration as YAML, with robot and trajectory found beside it, and these files.

    Args:
        config: what an experiment is made from, or `Experiment.config`, where what was chosen is filled in.
        full: whether every default is written: not where a rule is still to choose.

    Raises:
        RolloutError: when one of them cannot be read any more.
    """
    copied: dict[str, bytes] = {}
    config = config.replace(robot=expand(config))
    if config.robot.posterior is not None:
        name, content = _file_copy(Path(config.robot.posterior))
        copied[name] = content
        config = config.replace(robot=config.robot.replace(posterior=name))
    if config.robot.name not in robots.names():
        name, content = _file_copy(robots.locate(config.robot.name)[0])
        copied[name] = content
        config = config.replace(robot=config.robot.replace(name=name))
    nominals = [each.nominal for each in config.controllers]
    if any(nominals):
        for index, given in enumerate(nominals):
            if given not in (None, *robots.names()):
                nominals[index], content = _file_copy(robots.locate(given)[0])
                copied[nominals[index]] = content
        config = with_nominals(config, nominals)
    for key in REFERENCE_FILES:
        if getattr(config.reference, key) is not None:
            name, content = _file_copy(Path(getattr(config.reference, key)))
            copied[name] = content
            config = config.replace(reference=config.reference.replace(**{key: name}))
    return dump(config, full), copied


def _file_copy(source: Path) -> tuple[str, bytes]:
    """Return the name of a copy of a file, and its content."""
    try:
        content = files.read_bytes(source, _MOST_BYTES)
    except OSError as error:
        raise RolloutError(f"{source}: cannot be read: {files.reason(error)}") from None
    # The hash in its name keeps the copy from overwriting another one.
    digest = hashlib.sha256(content).hexdigest()[:8]
    stem = "".join(c if c.isprintable() else "_" for c in source.stem.removesuffix(f"-{digest}"))
    return f"{stem}-{digest}{source.suffix or '.urdf'}", content


def overall_status(results: Iterable[dict[str, Any]]) -> Status:
    """Return the status that the whole outcome has: the first of interrupted, diverged, stopped, finished."""
    statuses = {Status[record["status"].upper()] for record in results}
    for status in (Status.INTERRUPTED, Status.DIVERGED, Status.STOPPED):
        if status in statuses:
            return status
    return Status.FINISHED
