"""Rollouts as logs that other programs play: MCAP (Foxglove, PlotJuggler) and Rerun, by their libraries."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from armgpi.base import files
from armgpi.base.arrays import check_path, check_type
from armgpi.errors import ParameterError, import_extra

#: Topic or entity -> variables of a rollout: its position, velocity and effort, as a joint state has them.
_STATES = {
    "joint_states": ("q", "v", "tau"),
    "reference": ("q_ref", "v_ref", None),
    "measured": ("q_measured", None, "tau_command"),
    "disturbance": (None, None, "disturbance"),
}
_FIELDS = ("position", "velocity", "effort")
#: JSON Schema of a message; its fields are those of sensor_msgs/JointState.
_NUMBERS = {"type": "array", "items": {"type": "number"}}
_SCHEMA = {
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "name": {"type": "array", "items": {"type": "string"}},
        **dict.fromkeys(_FIELDS, _NUMBERS),
    },
}


def write(rollout: xr.Dataset, path: str | PathLike[str]) -> Path:
    """Write a rollout, or several in one dataset, as a log: MCAP or Rerun, by the file's ending.

    A topic (entity) for the joints' state, the reference, what was measured and the disturbance; below the
    name of the rollout where there are several. MCAP's messages are JSON with the fields of ROS's JointState.

    Args:
        rollout: the rollout(s).
        path: a file that ends in one of :data:`FORMATS`.

    Raises:
        ParameterError: when the ending is another one.
        MissingPackage: when the library is not installed.
        RolloutError: when the file cannot be written.
    """
    check_type(rollout, "rollout", xr.Dataset, "a rollout, as simulate returns it")
    target = check_path(path, "path")
    make = FORMATS.get(target.suffix.lower())
    if make is None:
        raise ParameterError("the log's file", str(target), f"one that ends in {' or '.join(FORMATS)}")
    return files.write(target, make(_series(rollout), [str(name) for name in rollout["joint"].values]))


#: Entity -> times and the values of the fields over time and joints.
_Series = dict[str, tuple[Any, dict[str, Any]]]


def _series(rollout: xr.Dataset) -> _Series:
    """Return what is logged, by the entity's name; each rollout until it ends."""
    if "rollout" not in rollout.dims:
        singles = {"": rollout}
    else:
        labels = rollout["label"].values if "label" in rollout.coords else range(rollout.sizes["rollout"])
        singles = {f"{label}/": rollout.isel(rollout=i) for i, label in enumerate(labels)}
    found: _Series = {}
    for prefix, run in singles.items():
        there = np.isfinite(run["q"].transpose("time", "joint").values).all(axis=1)
        for entity, names in _STATES.items():
            fields = {
                field: run[name].transpose("time", "joint").values[there]
                for field, name in zip(_FIELDS, names, strict=True)
                if name in run
            }
            if fields:
                found[prefix + entity] = (run["time"].values[there], fields)
    return found


def _mcap(series: _Series, joints: list[str]) -> bytes:
    """Return an MCAP file; its messages are JSON, in the order of their times."""
    content = io.BytesIO()
    writer = import_extra("mcap.writer", "mcap").Writer(content)
    writer.start(profile="", library="armgpi")
    schema = writer.register_schema("JointState", "jsonschema", json.dumps(_SCHEMA).encode())
    channels = {name: writer.register_channel(f"/{name}", "json", schema) for name in series}
    messages = (
        (round(float(t) * 1e9), name, {field: values[k].tolist() for field, values in fields.items()})
        for name, (times, fields) in series.items()
        for k, t in enumerate(times)
    )
    for stamp, name, fields in sorted(messages, key=lambda message: message[0]):
        seconds, nanoseconds = divmod(stamp, 1_000_000_000)
        message = {"timestamp": {"sec": seconds, "nsec": nanoseconds}, "name": joints, **fields}
        writer.add_message(channels[name], stamp, json.dumps(message).encode(), stamp)
    writer.finish()
    return content.getvalue()


def _rerun(series: _Series, joints: list[str]) -> bytes:
    """Return a Rerun recording: a scalar for every entity, field and joint."""
    rerun = import_extra("rerun", "rerun", "rerun-sdk")
    stream = rerun.RecordingStream("armgpi", recording_id="armgpi")
    memory = stream.memory_recording()
    for name, (times, fields) in series.items():
        clock = rerun.TimeColumn("time", duration=times)
        for field, values in fields.items():
            for joint, column in zip(joints, values.T, strict=True):
                scalars = rerun.Scalars.columns(scalars=column)
                stream.send_columns(f"{name}/{field}/{joint}", [clock], scalars)
    return bytes(memory.drain_as_bytes())


#: Ending -> what makes the file.
FORMATS: dict[str, Callable[[_Series, list[str]], bytes]] = {".mcap": _mcap, ".rrd": _rerun}
