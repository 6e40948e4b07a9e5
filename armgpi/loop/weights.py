"""Weights of networks as files: what one run or search found, another begins with."""

from __future__ import annotations

from os import PathLike

import numpy as np
import xarray as xr

from armgpi.base import files
from armgpi.base.arrays import check_path, check_type
from armgpi.base.parameter import parameters
from armgpi.base.version import other_format
from armgpi.errors import ArrayError, RolloutError
from armgpi.gpi.gains import Tuning
from armgpi.gpi.weights import Weights
from armgpi.loop.rollout import netcdf, read_netcdf
from armgpi.robot.batch import AnyRobot, check_robot

_FORMAT = "armgpi_weights"


def save_weights(weights: Weights, path: str | PathLike[str], robot: AnyRobot) -> None:
    """Write weights as NetCDF, dimensions (joint, basis); the file appears whole or not at all.

    Args:
        weights: for a single rollout.
        path: of the file.
        robot: the arm whose joints they are for.

    Raises:
        RolloutError: when the file cannot be written.
        ArrayError: when the weights do not fit the joints, or are for a batch.
        ParameterError: when an argument is not as it should be.
    """
    check_type(weights, "weights", Weights, "Weights")
    check_robot(robot)
    checked = Weights(**{name: getattr(weights, name) for name in parameters(Weights)})
    checked.check_parameters(robot.joint_names)
    variables = {}
    for name in parameters(Weights):
        values = getattr(checked, name)
        if values is None:
            continue
        if values.ndim != 2:
            raise ArrayError("weights", "expected those of a single rollout, got a batch")
        variables[name] = (("joint", f"basis_of_{name}"), values)
    dataset = xr.Dataset(variables, coords={"joint": list(robot.joint_names)}, attrs={_FORMAT: 1})
    files.write(check_path(path, "path"), netcdf(dataset))


def load_weights(path: str | PathLike[str], robot: AnyRobot) -> Weights:
    """Read weights that :func:`save_weights` wrote.

    Args:
        path: of the file.
        robot: the arm whose joints they are for.

    Raises:
        RolloutError: when the file is missing, broken, or holds something else.
        ArrayError: when they are for other joints, or not finite.
        ParameterError: when `path` is no path.
    """
    source = check_path(path, "path")
    check_robot(robot)
    dataset = read_netcdf(source)
    version = dataset.attrs.get(_FORMAT, 1)
    if version != 1:
        raise RolloutError(f"{source}: {other_format(version, 1)}")
    if _FORMAT not in dataset.attrs or not set(dataset.data_vars) <= set(Tuning._fields):
        raise RolloutError(f"{source}: holds no weights of networks")
    joints = [str(name) for name in dataset["joint"].values] if "joint" in dataset else []
    if joints != list(robot.joint_names):
        expected = ", ".join(robot.joint_names)
        raise ArrayError(str(source), f"has weights for {', '.join(joints)}, not for {expected}")
    weights = Weights(**{str(name): variable.values for name, variable in dataset.data_vars.items()})
    weights.check_parameters(robot.joint_names)
    return weights


def learned_weights(rollout: xr.Dataset) -> Weights:
    """Return the weights of networks at the end of a rollout, to begin another one with.

    Args:
        rollout: recorded with ``signals=True``, dimensions ([rollout], time, joint).

    Raises:
        RolloutError: when it has no weights.
    """
    check_type(rollout, "rollout", xr.Dataset, "a rollout, as simulate returns it")
    weights = {}
    for name in Tuning._fields:
        signals = [key for key in map(str, rollout.data_vars) if key.startswith(f"{name}_weight_")]
        if signals:
            signals.sort(key=lambda key: int(key.rpartition("_")[2]))
            columns = [rollout[key].isel(time=-1).values for key in signals]
            weights[name] = np.stack(columns, axis=-1)
    if not weights:
        raise RolloutError("the rollout has no weights: simulate networks with signals=True")
    return Weights(**weights)
