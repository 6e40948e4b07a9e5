"""What came out of a loop between two processes: a rollout like any other, and how the two kept up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from armgpi.base.arrays import Array
from armgpi.base.escape import html_table
from armgpi.hardware.realtime.datagram import Datagram
from armgpi.hardware.realtime.ends import ArmEnd
from armgpi.loop.log import ArmLog
from armgpi.loop.rollout import Recorded, Recording
from armgpi.loop.runner import DIVERGENCE, in_control
from armgpi.plants.plant import Plant
from armgpi.references.reference import Reference
from armgpi.supervisor import FaultReport

#: Edges of the histogram of lateness [us]; what is later than the last is counted, too.
EDGES = (0, 10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000, 100_000)


class Samples:
    """What the arm's end keeps of every sample.

    Attributes:
        rows: name -> array (steps + 1, n).
        answered: shape (steps,): whether the torque of a sample came in time.
        lateness: shape (steps,): by how much the arm woke too late [s]; NaN by a simulated clock.
        count: samples taken.
    """

    def __init__(self, steps: int, n: int) -> None:
        """Allocate arrays for so many samples of n joints."""
        names = ("q", "v", "q_measured", "tau_command", "tau")
        self.rows: dict[str, Array] = {name: np.zeros((steps + 1, n)) for name in names}
        self.answered = np.zeros(steps, dtype=bool)
        self.lateness = np.full(steps, np.nan)
        self.count = 0

    def take(self, arm: ArmEnd, sample: Datagram, answer: Datagram | None) -> None:
        """Take a sample: move the arm on, and keep what it did."""
        k, rows = arm.k, self.rows
        truth = arm.plant.true_state(arm.state)
        rows["q"][k] = truth.q
        rows["v"][k] = truth.v
        rows["q_measured"][k] = sample.values if sample.values.ndim == 1 else sample.values[0]
        rows["tau_command"][k] = arm.advance(answer)
        rows["tau"][k] = arm.plant.true_state(arm.state).tau
        self.answered[k] = arm.answered == k
        self.count = arm.k

    def finish(self, arm: ArmEnd) -> None:
        """Keep the state after the last sample, its torque still held."""
        k, rows = arm.k, self.rows
        truth = arm.plant.true_state(arm.state)
        rows["q"][k] = truth.q
        rows["v"][k] = truth.v
        rows["tau"][k] = truth.tau
        rows["q_measured"][k] = arm.plant.measure(arm.state).q
        rows["tau_command"][k] = rows["tau_command"][max(0, k - 1)]


class Outcome(NamedTuple):
    """What came out.

    Attributes:
        rollout: what happened, as from :func:`armgpi.simulate`.
        answered: shape (samples,): whether the torque of a sample came in time.
        lateness: shape (samples,): by how much the arm's end woke too late [s]; NaN by a simulated clock.
        filled: samples that the controller has missed and filled.
        fired: samples at which the arm's watchdog began to act.
        latched: whether it gave the controller up.
        granted: "arm", "controller" -> what the system granted: policy, locked memory.
        steps: how long the controller took for its samples [s].
        fault: what the controller's supervisor said at the end; None when it was killed.
        log: what the controller was given and what it answered; None when it was killed.
        made_from: clock and faults, as plain data.
    """

    rollout: xr.Dataset
    answered: npt.NDArray[np.bool_]
    lateness: Array
    filled: int
    fired: list[int]
    latched: bool
    granted: dict[str, Any]
    steps: Array
    fault: FaultReport | None
    log: ArmLog | None
    made_from: dict[str, Any]

    @property
    def missed(self) -> int:
        """Samples whose torque did not come in time."""
        return int((~self.answered).sum())

    @property
    def travel(self) -> float | None:
        """How far a joint went after the last torque of a controller that was given up [rad or m]."""
        if not self.latched or not self.answered.any():
            return None
        last = int(np.flatnonzero(self.answered)[-1])
        q = self.rollout["q"].values[last:]
        return float(np.abs(q - q[0]).max())

    def _repr_html_(self) -> str:
        """Return how the two kept up as a table, for notebooks."""
        lateness = _quantiles(self.lateness) or {}
        rows = [
            ("samples", len(self.answered)),
            ("without a torque in time", self.missed),
            ("filled by the controller", self.filled),
            ("watchdog acted", f"{len(self.fired)} times"),
            *((f"woke late by, {name} [us]", value) for name, value in lateness.items()),
        ]
        return html_table("loop between two processes", ("", ""), rows)

    def report(self, simulated: xr.Dataset | None = None) -> dict[str, Any]:
        """Return everything but the rollout as plain data.

        Args:
            simulated: the same loop by :func:`armgpi.simulate`, to compare errors with, as long as this one.
        """
        error = _errors(self.rollout)
        report: dict[str, Any] = {
            **self.made_from,
            "granted": self.granted,
            "samples": len(self.answered),
            "missed": self.missed,
            "filled": self.filled,
            "supervisor": None if self.fault is None else self.fault._asdict(),
            "watchdog": {"fired": self.fired, "latched": self.latched, "travel": self.travel},
            "lateness_us": _quantiles(self.lateness),
            "controller_us": _quantiles(self.steps),
            "histogram": {"edges_us": list(EDGES), "counts": histogram(self.lateness)},
            "error": error,
        }
        if simulated is not None:
            as_long = slice(self.rollout.sizes["time"])
            error_simulated = _errors(simulated.isel(time=as_long))
            report["error_simulated"] = error_simulated
            report["error_ratio"] = {
                name: error[name] / expected if expected else None
                for name, expected in error_simulated.items()
            }
        return report


def histogram(lateness: Array) -> list[int]:
    """Return how many are between the edges, and later than the last one."""
    late = lateness[np.isfinite(lateness)] * 1e6
    counts, _ = np.histogram(late, bins=[*EDGES, np.inf])
    return [int(count) for count in counts]


def collect(
    samples: Samples, plant: Plant, reference: Reference, dt: float, made_from: Mapping[str, Any]
) -> xr.Dataset:
    """Return the rollout of what was kept."""
    steps, count = len(samples.answered), samples.count
    n = plant.robot.n
    recording = Recording.new((n,), steps, dt, 1)
    target = reference.at(np.arange(count + 1) * np.float64(dt))
    rows = {name: values[: count + 1] for name, values in samples.rows.items()}
    rows |= {"q_ref": target.q, "v_ref": target.v}
    error = rows["q"] - rows["q_ref"]
    good = in_control(error, rows["v"], rows["tau_command"], DIVERGENCE)
    recording.store(0, {name: values[:, None] for name, values in rows.items()})
    if not good.all():
        recording.diverge(0, int(np.argmin(good)))
    if count < steps:
        recording.interrupt(count)
    disturbance = plant.disturbance(recording.times)
    return Recorded(recording, plant.robot, disturbance, made_from).dataset()


def _errors(rollout: xr.Dataset) -> dict[str, float]:
    """Return the largest and the mean square error of the worst joint [rad or m]."""
    error = np.abs(rollout["q"].values - rollout["q_ref"].values)
    rms = np.sqrt((error**2).mean(axis=0))
    return {"peak": float(error.max()), "rms": float(rms.max())}


def _quantiles(times: Array) -> dict[str, float] | None:
    """Return quantiles [us]; None where nothing was measured."""
    times = times[np.isfinite(times)] * 1e6
    if not times.size:
        return None
    shares = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}
    quantiles = np.percentile(times, [*shares.values()])
    return {name: round(float(quantile), 1) for name, quantile in zip(shares, quantiles, strict=True)}
