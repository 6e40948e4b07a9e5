"""What pictures show of rollouts: each by itself with its name and colour, where its tool went, its pushes.

Plots, scenes and reports draw the same things; here is what they have in common, without any drawing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from armgpi.base.arrays import Array
from armgpi.errors import RolloutError
from armgpi.loop.rollout import Status
from armgpi.robot.robot import Robot
from armgpi.viewing import style

if TYPE_CHECKING:
    import xarray as xr

#: More rollouts than this are drawn as a band.
MOST_LINES = 14
#: What a rollout has -> its dimensions, besides that of several rollouts.
_DIMENSIONS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("q", "q_ref", "tau"), ("time", "joint")),
    **dict.fromkeys(("effort", "lower", "upper"), ("joint",)),
    **dict.fromkeys(("status", "t_end"), ()),
}


class Trace(NamedTuple):
    """One rollout to draw, or many as one.

    Attributes:
        label: its name in the legend; empty for a single rollout without one.
        look: its colour and dashes.
        data: its dataset, without the dimension ``rollout``; with it for a band of many.
    """

    label: str
    look: style.Look
    data: xr.Dataset


class ToolPath(NamedTuple):
    """The path of a frame in the base frame.

    Attributes:
        label: name of the rollout.
        look: its colour and dashes.
        drawn: where the frame was [m], shape (k, 3); NaN after the end.
        desired: where it should have been [m], shape (k, 3).
    """

    label: str
    look: style.Look
    drawn: Array
    desired: Array


def traces(rollout: xr.Dataset, most: int | None = MOST_LINES) -> list[Trace]:
    """Return the rollouts of a dataset one by one; as one, with their dimension, when more than `most`.

    Raises:
        RolloutError: when there is nothing to draw.
    """
    _check(rollout)
    rollout = _until_the_end(rollout)
    if "rollout" not in rollout.dims:
        label = str(rollout["label"].values) if "label" in rollout.coords else ""
        return [Trace(label, style.looks([label])[0], rollout)]
    count = rollout.sizes["rollout"]
    if most is not None and count > most:
        return [Trace(f"{count} rollouts: median, 5 to 95 %", style.look(0), rollout)]
    labels = rollout["label"].values if "label" in rollout.coords else [f"rollout {i}" for i in range(count)]
    names = [str(label) for label in labels]
    looks = style.looks(names)
    return [
        Trace(name, look, rollout.isel(rollout=i))
        for i, (name, look) in enumerate(zip(names, looks, strict=True))
    ]


def tool_paths(
    rollout: xr.Dataset, robot: Robot, frame: str | None = None, most: int = 2000
) -> list[ToolPath]:
    """Return where a frame went and where it should have gone, at most `most` points a rollout.

    Raises:
        RolloutError: when the robot's joints are not the rollout's.
        NameNotFound: when there is no such frame.
    """
    if robot.joint_names != tuple(str(name) for name in rollout["joint"].values):
        raise RolloutError(
            f"the robot's joints are {', '.join(robot.joint_names)}; the rollout has "
            f"{', '.join(map(str, rollout['joint'].values))}"
        )
    name = robot.tip if frame is None else frame
    paths = []
    for trace in traces(rollout, most=None):
        thinned = thin(trace.data, most)
        drawn, desired = np.full((2, thinned.sizes["time"], 3), np.nan)
        for points, q in ((drawn, thinned["q"].values), (desired, thinned["q_ref"].values)):
            there = np.isfinite(q).all(axis=-1)
            points[there] = robot.frame_pose(name, q[there]).translation.reshape(-1, 3)
        paths.append(ToolPath(trace.label, trace.look, drawn, desired))
    return paths


def thin(data: xr.Dataset, most: int) -> xr.Dataset:
    """Return a dataset with at most `most` times, evenly spread, the last one among them."""
    count = data.sizes["time"]
    if count <= most:
        return data
    return data.isel(time=np.unique(np.linspace(0, count - 1, most).round().astype(int)))


def signal_names(rollout: xr.Dataset) -> tuple[str, ...]:
    """Return the variables over time and joints that a controller recorded beside the usual ones."""
    usual = {"q", "v", "q_measured", "tau_command", "tau", "q_ref", "v_ref", "disturbance"}
    return tuple(
        str(name)
        for name, values in rollout.data_vars.items()
        if name not in usual and {"time", "joint"} <= set(values.dims)
    )


def torque_rate(data: xr.Dataset) -> xr.DataArray:
    """Return how fast the torque of every joint changes from sample to sample [N m/s or N/s].

    Its times are those of the later samples; of a single sample there is one rate, NaN.
    """
    if data.sizes["time"] < 2:
        return data["tau"] * np.nan
    return data["tau"].diff("time") / data["time"].diff("time")


def disturbance_onset(rollout: xr.Dataset, joint: str) -> float | None:
    """Return when a joint is first pushed by a load [s], None when it never is."""
    if "disturbance" not in rollout:
        return None
    names = [str(name) for name in rollout["joint"].values]
    torque = rollout["disturbance"].isel(joint=names.index(joint)).values
    pushed = np.atleast_2d(torque != 0.0).any(axis=0)
    return float(rollout["time"].values[np.argmax(pushed)]) if pushed.any() else None


def pareto_front(points: Array) -> npt.NDArray[np.bool_]:
    """Return which points (k, m) no other point beats: none is as good in all costs and better in one."""
    best = np.ones(len(points), dtype=bool)
    for index, point in enumerate(points):
        others = (points <= point).all(axis=1) & (points < point).any(axis=1)
        best[index] = not others.any()
    return best


def _check(rollout: xr.Dataset) -> None:
    """Refuse a dataset that is no rollout, or has nothing to draw: files can hold anything."""
    import xarray as xr

    if not isinstance(rollout, xr.Dataset):
        raise RolloutError(f"expected a rollout, as simulate returns it, got a {type(rollout).__name__}")
    if min(rollout.sizes.get("time", 0), rollout.sizes.get("rollout", 1)) < 1:
        raise RolloutError("the rollout has no samples, so there is nothing to draw")
    _check_variables(rollout)
    time = np.asarray(rollout["time"].values)
    if time.dtype.kind != "f" or not np.isfinite(time).all() or (np.diff(time) <= 0.0).any():
        raise RolloutError("the rollout's times are not finite numbers that increase")
    if unknown := set(np.unique(rollout["status"].values).tolist()) - set(map(int, Status)):
        raise RolloutError(f"the rollout has a status that there is not: {sorted(unknown)}")
    names = [str(name) for name in rollout["joint"].values]
    if not 0 < len(names) == len(set(names)):
        raise RolloutError("the rollout's joints have no names of their own")


def _check_variables(rollout: xr.Dataset) -> None:
    """Refuse a dataset whose variables are not numbers of a rollout's dimensions."""
    for name, dimensions in _DIMENSIONS.items():
        if name not in rollout or not {*dimensions} <= set(rollout[name].dims) <= {*dimensions, "rollout"}:
            raise RolloutError(f"the rollout has no {name!r} with the dimensions of one")
        if rollout[name].dtype.kind not in "fiu":
            raise RolloutError(f"the rollout's {name!r} is no numbers but {rollout[name].dtype}")


def _until_the_end(rollout: xr.Dataset) -> xr.Dataset:
    """Return rollouts without what came after they diverged."""
    diverged = rollout["status"] == Status.DIVERGED
    if not diverged.any():
        return rollout
    kept = ~diverged | (rollout["time"] < rollout["t_end"] - 1e-9)
    return rollout.assign(
        {name: v.where(kept) for name, v in rollout.data_vars.items() if {"time", "joint"} <= set(v.dims)}
    )
