"""Metrics of a rollout: pure functions, one number per joint (and rollout).

Each is declared once, by :func:`metric` on its function. From that it is in :data:`ALL`, and so in the table
on the terminal, the HTML report, ``metrics.json``, :func:`summary` with its attributes, the tables of the
reproduction and of the zoo, and the documentation.

Integrals run over the recorded samples: errors by the trapezoidal rule, torques as the steps they are.
Of a rollout that was thinned (``record_every`` above 1) they are those of the samples kept; total variation
and saturated time then miss what lay between. A rollout that diverged has infinite cost; of one that was
interrupted the metrics are those until then.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import numpy.typing as npt

from armgpi import registry
from armgpi.arrays import Array
from armgpi.errors import RolloutError
from armgpi.loop.rollout import Recorded, Status
from armgpi.loop.running import LAST, LIMIT_SHARE, ROUNDING, SHARE, Running, Totals
from armgpi.loop.units import POSITION, TORQUE, Unit, prismatic

if TYPE_CHECKING:
    import xarray as xr

#: A function of a rollout, dimensions ([rollout], time, joint), to numbers ([rollout], joint).
Function = Callable[["xr.Dataset"], "xr.DataArray"]
#: What a metric is about; a table that is too wide is split by it.
Group = Literal["errors", "torques"]
GROUPS: tuple[Group, ...] = get_args(Group)
#: The tables that show metrics; the files have them all.
Table = Literal["terminal", "report", "reproduction", "zoo"]
_PAPER: tuple[Table, ...] = ("terminal", "report", "reproduction")
_RUNS: tuple[Table, ...] = ("terminal", "report", "zoo")
#: The values of a metric from what a run without trajectories adds up, (..., n).
OnLine = Callable[[Totals], Array]


@dataclass(frozen=True)
class Metric:
    """A metric as it was declared; called with a rollout it returns its values.

    Attributes:
        name: in files.
        heading: in tables, short.
        long_name: what it is, in words.
        unit: of its values.
        group: what it is about.
        tables: where it is shown.
        total: whether the value of an arm is the sum of those of its joints; else it is the largest.
        digits: significant digits that are shown.
        function: what computes it.
        on_line: what computes it of a run that keeps no trajectories; None for one that needs them.
    """

    name: str
    heading: str
    long_name: str
    unit: Unit
    group: Group
    tables: tuple[Table, ...]
    total: bool
    digits: int
    function: Function
    on_line: OnLine | None = None

    def __call__(self, rollout: xr.Dataset) -> xr.DataArray:
        """Return the metric of a rollout, dimensions ([rollout], joint); infinite where it diverged.

        Its attribute ``units`` is that of prismatic joints where all are.

        Raises:
            RolloutError: when the rollout lacks a variable or has fewer than two samples.
        """
        import xarray as xr

        if not isinstance(rollout, xr.Dataset):
            raise RolloutError(f"{self.long_name} needs a rollout, got a {type(rollout).__name__}")
        try:
            if (count := rollout.sizes["time"]) < 2:
                raise RolloutError(f"{self.long_name} needs at least two samples, the rollout has {count}")
            values = self.function(rollout).where(rollout["status"] != Status.DIVERGED, np.inf)
        except KeyError as error:
            raise RolloutError(
                f"{self.long_name}: the rollout lacks a variable that it needs: {error}"
            ) from None
        units = self.unit.symbol(bool(prismatic(rollout).all()), ascii=True)
        return values.rename(self.name).assign_attrs(long_name=self.long_name, units=units)

    def of_arm(self, values: Array) -> Array:
        """Return one value for the arm: the sum over its joints, or the largest, as the metric is declared.

        Args:
            values: of the joints, shape (..., n).

        Returns:
            Values of the arm, shape (...).
        """
        return np.asarray(values.sum(axis=-1) if self.total else values.max(axis=-1))

    def text(self, value: float | None, most: int = 16) -> str:
        """Return a value as text, with at most so many significant digits."""
        return short(value, min(self.digits, most))


#: Those that are declared so far; :func:`declared` loads plugins first.
ALL: dict[str, Metric] = {}


def metric(
    heading: str,
    unit: Unit,
    group: Group,
    *,
    long_name: str = "",
    tables: tuple[Table, ...] = get_args(Table),
    total: bool = False,
    digits: int = 4,
    on_line: OnLine | None = None,
) -> Callable[[Function], Function]:
    """Declare a metric: its name is that of the function, the rest is what :class:`Metric` says.

    Args:
        heading: in tables, short.
        unit: of its values.
        group: what it is about.
        long_name: what it is, in words; the heading where that says it.
        tables: where it is shown; everywhere when not given.
        total: whether the value of an arm is the sum of those of its joints.
        digits: significant digits that are shown.
        on_line: what computes it of a run that keeps no trajectories; such a run leaves it out without.
    """

    def declare(function: Function) -> Function:
        name = function.__name__
        words = (name, heading, long_name or heading)
        made = Metric(*words, unit, group, tables, total, digits, function, on_line)
        ALL[name] = made

        @wraps(function)
        def checked(rollout: xr.Dataset) -> xr.DataArray:
            return made(rollout)

        checked.__doc__ = f"{function.__doc__}\n\nUnit: {str(unit) or 'none'}."
        return checked

    return declare


def declared() -> Mapping[str, Metric]:
    """Return every metric by the name that it has in files, those of plugins too."""
    registry.load_plugins()
    return ALL


def shown_in(table: Table) -> list[Metric]:
    """Return the metrics that a table shows: those of errors first, as they were declared."""
    shown = [metric for metric in declared().values() if table in metric.tables]
    return sorted(shown, key=lambda metric: GROUPS.index(metric.group))


def short(value: float | None, digits: int = 4) -> str:
    """Return a number with some significant digits, rounding errors as 0; a dash when there is none."""
    if value is None or not np.isfinite(value):
        return "-"
    return f"{value:.{digits}g}" if abs(value) > ROUNDING else "0"


def error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the tracking error q - q* [rad or m], dimensions (..., time, joint)."""
    return rollout["q"] - rollout["q_ref"]


@metric(
    "ITAE",
    Unit(position=1, time=2),
    "errors",
    long_name="integral of time times absolute error",
    tables=_PAPER,
    total=True,
    on_line=lambda x: x.dt * x.integral(x.sums.timed, x.last * abs(x.sums.e)),
)
def itae(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of time times absolute error, ``∫ t |e| dt`` (eq. 34)."""
    return _integral(rollout["time"] * abs(error(rollout)))


@metric(
    "IAE",
    Unit(position=1, time=1),
    "errors",
    long_name="integral of absolute error",
    tables=(),
    total=True,
    on_line=lambda x: x.integral(x.sums.absolute, abs(x.sums.e)),
)
def iae(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of absolute error, ``∫ |e| dt``."""
    return _integral(abs(error(rollout)))


@metric(
    "ISE",
    Unit(position=2, time=1),
    "errors",
    long_name="integral of squared error",
    tables=(),
    total=True,
    on_line=lambda x: x.integral(x.sums.squared, x.sums.e**2),
)
def ise(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of squared error, ``∫ e² dt``."""
    return _integral(error(rollout) ** 2)


@metric(
    "RMS error",
    POSITION,
    "errors",
    tables=("report",),
    on_line=lambda x: np.sqrt(x.integral(x.sums.squared, x.sums.e**2) / (x.dt * x.last)),
)
def rms(rollout: xr.Dataset) -> xr.DataArray:
    """Return the root of the mean squared error."""
    e = error(rollout)
    time = e["time"].where(e.notnull())
    return (_integral(e**2) / (time.max("time") - time.min("time"))) ** 0.5


@metric("peak error", POSITION, "errors", tables=_RUNS, on_line=lambda x: x.sums.peak)
def peak_error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the largest absolute error."""
    return abs(error(rollout)).max("time")


@metric("final error", POSITION, "errors", tables=_RUNS, on_line=lambda x: abs(x.sums.e))
def final_error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the absolute error of the last sample."""
    e = abs(error(rollout))
    return e.isel(time=e.notnull().sum("time") - 1).drop_vars("time")


@metric(
    "ISCI",
    Unit(torque=2, time=1),
    "torques",
    long_name="integral of squared control input",
    tables=_PAPER,
    total=True,
    on_line=lambda x: x.dt * x.sums.effort,
)
def isci(rollout: xr.Dataset) -> xr.DataArray:
    """Return the integral of squared control input, ``∫ τ² dt`` (eq. 35)."""
    return _held_integral(rollout["tau"] ** 2)


@metric(
    "variation",
    TORQUE,
    "torques",
    long_name="total variation of torque",
    tables=_PAPER,
    total=True,
    on_line=lambda x: x.sums.variation,
)
def total_variation(rollout: xr.Dataset) -> xr.DataArray:
    """Return the total variation of torque, ``Σ |τₖ₊₁ - τₖ|``: how much it chatters."""
    return abs(rollout["tau"].diff("time")).sum("time")


@metric(
    "peak",
    TORQUE,
    "torques",
    long_name="peak torque",
    tables=("terminal", "report"),
    on_line=lambda x: x.sums.peak_torque,
)
def peak_torque(rollout: xr.Dataset) -> xr.DataArray:
    """Return the largest absolute torque."""
    return abs(rollout["tau"]).max("time")


def _share_used(x: Totals) -> Array:
    peak = x.sums.peak_torque
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(peak > 0.0, peak / x.effort, 0.0)


@metric("effort used", Unit(), "torques", tables=("zoo",), on_line=_share_used)
def effort_used(rollout: xr.Dataset) -> xr.DataArray:
    """Return the largest share of the effort limit that was used; 0 where there is no limit."""
    peak = abs(rollout["tau"]).max("time")
    return (peak / rollout["effort"]).where(peak > 0.0, 0.0)


@metric(
    "saturated",
    Unit(time=1),
    "torques",
    long_name="saturated time",
    tables=_RUNS,
    on_line=lambda x: x.dt * x.sums.saturated,
)
def saturated_time(rollout: xr.Dataset) -> xr.DataArray:
    """Return how long the applied torque was at its limit."""
    tau = rollout["tau"]
    at_limit = abs(tau) >= rollout["effort"] * LIMIT_SHARE
    return _held_integral(at_limit.astype(float).where(tau.notnull()))


@metric(
    "beyond position limits",
    POSITION,
    "errors",
    tables=(),
    on_line=lambda x: np.maximum(np.maximum(x.lower - x.sums.lowest, x.sums.highest - x.upper), 0.0),
)
def limit_excess(rollout: xr.Dataset) -> xr.DataArray:
    """Return how far the joint went beyond its position limits; 0 when it stayed inside."""
    lowest, highest = rollout["q"].min("time"), rollout["q"].max("time")
    below, above = -(lowest - rollout["lower"]), highest - rollout["upper"]
    return below.where(below > above, above).clip(min=0.0)


@metric(
    "hunting",
    POSITION,
    "errors",
    long_name="range of the joint at rest",
    tables=("report",),
    on_line=lambda x: x.swing,
)
def hunting_amplitude(rollout: xr.Dataset) -> xr.DataArray:
    """Return how far the joint swings, peak to peak, in the last 1.2 s, a fifth of the horizon at most.

    It is 0 where the reference moves in that time. A joint that still settles has a range as well, but swings
    half a time or less.
    """
    swing = _at_rest(rollout)
    return (swing.max("time") - swing.min("time")).fillna(0.0)


def _swings(x: Totals) -> Array:
    seconds = x.dt * (x.last - x.late)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(x.swing > ROUNDING, x.sums.way / (2.0 * x.swing) / seconds, 0.0)


@metric(
    "hunting frequency",
    Unit(time=-1),
    "errors",
    long_name="frequency of the joint at rest",
    tables=(),
    on_line=_swings,
)
def hunting_frequency(rollout: xr.Dataset) -> xr.DataArray:
    """Return how many times a second the joint swings up and down its range at rest; 0 if it stands still."""
    swing = _at_rest(rollout)
    amplitude = swing.max("time") - swing.min("time")
    time = swing["time"].where(swing.notnull())
    # One swing up and down is twice the range.
    swings = abs(swing.diff("time")).sum("time") / (2.0 * amplitude)
    return (swings / (time.max("time") - time.min("time"))).where(amplitude > ROUNDING, 0.0)


def summary(rollout: xr.Dataset) -> xr.Dataset:
    """Return every metric in one dataset, dimensions ([rollout], joint).

    Raises:
        RolloutError: when the rollout lacks a variable or has fewer than two samples.
    """
    import xarray as xr

    return xr.Dataset({name: metric(rollout) for name, metric in declared().items()})


def on_line(totals: Totals, diverged: npt.NDArray[np.bool_]) -> dict[str, Array]:
    """Return the metrics of a run that kept no trajectories, name -> (..., n); infinite where it diverged.

    Args:
        totals: what was added up.
        diverged: which rollouts did, shape (...).
    """
    found = {}
    with np.errstate(all="ignore"):
        for name, each in declared().items():
            if each.on_line is not None:
                found[name] = np.where(diverged[..., None], np.inf, each.on_line(totals))
    return found


def of_recorded(run: Recorded) -> dict[str, Array]:
    """Return every metric of what was recorded, name -> (rollouts, n); infinite where it diverged.

    They are those of its dataset, which is made for metrics without an ``on_line`` alone.
    """
    recording, limits = run.recording, run.robot.limits
    last, dt = recording.kept - 1, recording.every * recording.dt
    rows = len(recording.status), run.robot.n
    kept = {name: values[: last + 1].reshape(-1, *rows) for name, values in recording.variables.items()}
    running = Running(last, dt, limits.effort)
    sums = running.add_all(0, kept["q"], kept["q_ref"], kept["tau"], running.init(rows))
    totals = Totals(sums, dt, last, float(running.late), limits.lower, limits.upper, limits.effort)
    found = on_line(totals, recording.status == Status.DIVERGED)
    missing = [each for name, each in declared().items() if name not in found]
    if missing:
        dataset = run.dataset()
        found |= {each.name: each(dataset).values.reshape(rows) for each in missing}
    return found


def _at_rest(rollout: xr.Dataset) -> xr.DataArray:
    """Return the error of the last seconds, NaN before that and where the reference moves then."""
    e, time = error(rollout), rollout["time"]
    end = time.where(e.notnull()).max("time")
    last = time >= end - np.minimum(LAST, SHARE * (end - time[0])) - ROUNDING
    reference = rollout["q_ref"].where(last)
    moves = reference.max("time") - reference.min("time") > ROUNDING
    return e.where(last & ~moves)


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
