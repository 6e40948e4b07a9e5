"""Figures of merit of a rollout: pure functions, one number per joint (and rollout).

Integrals run over the recorded samples: errors by the trapezoidal rule, torques as the steps they are.
Of a rollout that was thinned (``record_every`` above 1) they are those of the samples kept; total variation
and saturated time then miss what lay between. A rollout that diverged has infinite cost; of one that was
interrupted the figures are those until then.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps

import numpy as np
import xarray as xr

from armgpi.errors import RolloutError
from armgpi.loop.rollout import Status

Metric = Callable[[xr.Dataset], xr.DataArray]


def _figure(name: str, units: str, *needs: str) -> Callable[[Metric], Metric]:
    """Make a figure of merit: check the rollout, label the result, and make it infinite for a diverged one.

    Args:
        name: what it is called.
        units: its units, of a revolute joint.
        needs: the variables that it is made from.
    """

    def decorate(metric: Metric) -> Metric:
        @wraps(metric)
        def figure(rollout: xr.Dataset) -> xr.DataArray:
            for variable in (*needs, "time", "status"):
                if variable not in rollout:
                    raise RolloutError(f"{name} needs the variable {variable!r}, which the rollout lacks")
            if rollout.sizes["time"] < 2:
                raise RolloutError(
                    f"{name} needs at least two samples, the rollout has {rollout.sizes['time']}"
                )
            values = metric(rollout).where(rollout["status"] != Status.DIVERGED, np.inf)
            return values.rename(name.replace(" ", "_")).assign_attrs(long_name=name, units=units)

        return figure

    return decorate


def error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the tracking error q - q* [rad or m], dimensions (..., time, joint)."""
    return rollout["q"] - rollout["q_ref"]


@_figure("ITAE", "rad s^2", "q", "q_ref")
def itae(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of time times absolute error, ``int t |e| dt`` [rad s^2], eq. 34."""
    return _integral(rollout["time"] * abs(error(rollout)))


@_figure("IAE", "rad s", "q", "q_ref")
def iae(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of absolute error, ``int |e| dt`` [rad s]."""
    return _integral(abs(error(rollout)))


@_figure("ISE", "rad^2 s", "q", "q_ref")
def ise(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of squared error, int e^2 dt [rad^2 s]."""
    return _integral(error(rollout) ** 2)


@_figure("RMS error", "rad", "q", "q_ref")
def rms(rollout: xr.Dataset) -> xr.DataArray:
    """Return the root of the mean squared error [rad]."""
    e = error(rollout)
    time = e["time"].where(e.notnull())
    return (_integral(e**2) / (time.max("time") - time.min("time"))) ** 0.5


@_figure("peak error", "rad", "q", "q_ref")
def peak_error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the largest absolute error [rad]."""
    return abs(error(rollout)).max("time")


@_figure("final error", "rad", "q", "q_ref")
def final_error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the absolute error of the last sample [rad]."""
    e = abs(error(rollout))
    return e.isel(time=e.notnull().sum("time") - 1).drop_vars("time")


@_figure("ISCI", "(N m)^2 s", "tau")
def isci(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of squared control input, int tau^2 dt [(N m)^2 s], eq. 35."""
    return _held_integral(rollout["tau"] ** 2)


@_figure("total variation of torque", "N m", "tau")
def total_variation(rollout: xr.Dataset) -> xr.DataArray:
    """Return the total variation of torque, ``sum |tau_k+1 - tau_k|`` [N m]: how much it chatters."""
    return abs(rollout["tau"].diff("time")).sum("time")


@_figure("peak torque", "N m", "tau")
def peak_torque(rollout: xr.Dataset) -> xr.DataArray:
    """Return the largest absolute torque [N m]."""
    return abs(rollout["tau"]).max("time")


@_figure("saturated time", "s", "tau", "effort")
def saturated_time(rollout: xr.Dataset) -> xr.DataArray:
    """Return how long the applied torque stood at its limit [s]."""
    tau = rollout["tau"]
    at_limit = abs(tau) >= rollout["effort"] * (1.0 - 1e-9)
    return _held_integral(at_limit.astype(float).where(tau.notnull()))


@_figure("beyond position limits", "rad", "q", "lower", "upper")
def limit_excess(rollout: xr.Dataset) -> xr.DataArray:
    """Return how far the joint went beyond its position limits [rad]; 0 when it stayed inside."""
    lowest, highest = rollout["q"].min("time"), rollout["q"].max("time")
    below, above = -(lowest - rollout["lower"]), highest - rollout["upper"]
    return below.where(below > above, above).clip(min=0.0)


#: Every figure of merit, by the name it has in tables and files.
ALL = {
    "itae": itae,
    "iae": iae,
    "ise": ise,
    "rms": rms,
    "peak_error": peak_error,
    "final_error": final_error,
    "isci": isci,
    "total_variation": total_variation,
    "peak_torque": peak_torque,
    "saturated_time": saturated_time,
    "limit_excess": limit_excess,
}


def summary(rollout: xr.Dataset) -> xr.Dataset:
    """Return every figure of merit in one dataset, dimensions ([rollout], joint)."""
    return xr.Dataset({name: metric(rollout) for name, metric in ALL.items()})


def _integral(values: xr.DataArray) -> xr.DataArray:
    """Integrate over time by the trapezoidal rule, up to where the values end."""
    steps = values["time"].diff("time", label="lower")
    means = (0.5 * (values + values.shift(time=-1))).isel(time=slice(None, -1))
    return (means * steps).sum("time")


def _held_integral(values: xr.DataArray) -> xr.DataArray:
    """Integrate over time values that are held from each sample to the next, up to where they end."""
    steps = values["time"].diff("time", label="lower")
    whole = values.where(values.shift(time=-1).notnull()).isel(time=slice(None, -1))
    return (whole * steps).sum("time")
