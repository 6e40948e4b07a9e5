"""Figures of merit of a rollout: pure functions, one number per joint (and rollout).

Integrals run over the recorded samples: errors by the trapezoidal rule, torques as the steps they are.
Of a rollout that was thinned (``record_every`` above 1) they are those of the samples kept; total variation
and saturated time then miss what lay between. A rollout that diverged has infinite cost.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from armgpi.errors import RolloutError
from armgpi.rollout import Status


def error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the tracking error q - q* [rad or m], dimensions (..., time, joint)."""
    return rollout["q"] - rollout["q_ref"]


def itae(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of time times absolute error, int t |e| dt [rad s^2], eq. 34."""
    return _named(rollout, _integral(rollout["time"] * abs(error(rollout))), "ITAE", "rad s^2")


def iae(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of absolute error, int |e| dt [rad s]."""
    return _named(rollout, _integral(abs(error(rollout))), "IAE", "rad s")


def ise(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of squared error, int e^2 dt [rad^2 s]."""
    return _named(rollout, _integral(error(rollout) ** 2), "ISE", "rad^2 s")


def rms(rollout: xr.Dataset) -> xr.DataArray:
    """Return the root of the mean squared error [rad]."""
    return _named(rollout, (_integral(error(rollout) ** 2) / _duration(rollout)) ** 0.5, "RMS error", "rad")


def peak_error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the largest absolute error [rad]."""
    return _named(rollout, abs(error(rollout)).max("time"), "peak error", "rad")


def final_error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the absolute error of the last sample [rad]."""
    return _named(rollout, abs(error(rollout)).isel(time=-1), "final error", "rad")


def isci(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of squared control input, int tau^2 dt [(N m)^2 s], eq. 35."""
    return _named(rollout, _held_integral(rollout["tau"] ** 2), "ISCI", "(N m)^2 s")


def total_variation(rollout: xr.Dataset) -> xr.DataArray:
    """Return the total variation of torque, sum |tau_k+1 - tau_k| [N m]: how much it chatters."""
    return _named(rollout, abs(rollout["tau"].diff("time")).sum("time"), "total variation of torque", "N m")


def peak_torque(rollout: xr.Dataset) -> xr.DataArray:
    """Return the largest absolute torque [N m]."""
    return _named(rollout, abs(rollout["tau"]).max("time"), "peak torque", "N m")


def saturated_time(rollout: xr.Dataset) -> xr.DataArray:
    """Return how long the applied torque stood at its limit [s]."""
    at_limit = abs(rollout["tau"]) >= rollout["effort"] * (1.0 - 1e-9)
    return _named(rollout, _held_integral(at_limit.astype(float)), "saturated time", "s")


def limit_excess(rollout: xr.Dataset) -> xr.DataArray:
    """Return how far the joint went beyond its position limits [rad]; 0 when it stayed inside."""
    below = (rollout["lower"] - rollout["q"]).max("time")
    above = (rollout["q"] - rollout["upper"]).max("time")
    beyond = below.where(below > above, above).clip(min=0.0)
    return _named(rollout, beyond, "beyond position limits", "rad")


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
    """Integrate over time by the trapezoidal rule."""
    return values.integrate("time")


def _held_integral(values: xr.DataArray) -> xr.DataArray:
    """Integrate over time values that are held from each sample to the next."""
    steps = values["time"].diff("time", label="lower")
    return (values.isel(time=slice(None, -1)) * steps).sum("time")


def _duration(rollout: xr.Dataset) -> float:
    """Return the length of the rollout [s]."""
    return float(rollout["time"][-1] - rollout["time"][0])


def _named(rollout: xr.Dataset, values: xr.DataArray, name: str, units: str) -> xr.DataArray:
    """Label a figure of merit, infinite where the rollout diverged."""
    if rollout.sizes["time"] < 2:
        raise RolloutError(f"{name} needs at least two samples, the rollout has {rollout.sizes['time']}")
    values = values.where(rollout["status"] != Status.DIVERGED, np.inf)
    return values.rename(name.replace(" ", "_")).assign_attrs(long_name=name, units=units)
