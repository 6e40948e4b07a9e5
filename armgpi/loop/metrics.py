"""Metrics: pure functions of a run's totals, one number per joint (and rollout).

Each is declared once, by :func:`metric` on its function. From that it is in :data:`ALL`, and so in the HTML
report, ``metrics.json``, :func:`summary` with its attributes and the documentation, and in each table that it
names. Totals are folds over samples (:mod:`armgpi.loop.running`): those of a recorded rollout, and those that
a loop without trajectories adds up, by NumPy or in generated code. A metric that no total gives may take the
rollout.

Integrals run over the recorded samples: errors by the trapezoidal rule, torques as the steps they are.
Of a rollout that was thinned (``record_every`` above 1) they are those of the samples kept; total variation
and saturated time then miss what lay between. A rollout that diverged has infinite cost; of one that was
interrupted the metrics are those until then.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from armgpi import registry
from armgpi.base.arrays import Array
from armgpi.base.hints import METRICS, missing
from armgpi.errors import NameNotFound, RolloutError
from armgpi.loop.rollout import Recorded, Status
from armgpi.loop.running import ROUNDING, Totals, fold
from armgpi.loop.tool import ToolSample, angle_of
from armgpi.loop.units import NEWTON, POSITION, TORQUE, PlainUnit, Unit, prismatic

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "ALL",
    "Metric",
    "declared",
    "effort_used",
    "error",
    "final_error",
    "final_force",
    "hunting_amplitude",
    "hunting_frequency",
    "iae",
    "isci",
    "ise",
    "itae",
    "limit_excess",
    "metric",
    "peak_error",
    "peak_force",
    "peak_torque",
    "rms",
    "saturated_time",
    "summary",
    "tool_angle",
    "tool_error",
    "total_variation",
]

#: A function of totals to numbers (..., n); or of a rollout, dimensions ([rollout], time, joint), to numbers
#: ([rollout], joint).
Function = Callable[[Any], Any]
#: What a metric is about; a table that is too wide is split by it. Metrics of the tool are those of the arm:
#: every joint has the same number, and tables show it once.
Group = Literal["errors", "torques", "tool"]
GROUPS: tuple[Group, ...] = get_args(Group)
#: The tables that show metrics; the files have them all.
Table = Literal["terminal", "report", "reproduction", "zoo"]
_PAPER: tuple[Table, ...] = ("terminal", "report", "reproduction")
_RUNS: tuple[Table, ...] = ("terminal", "report", "zoo")
#: What of a rollout is folded.
_FOLDED = ("q", "q_ref", "tau")


class _Limits(NamedTuple):
    """Limits of rollouts, (rollouts, n)."""

    lower: Array
    upper: Array
    effort: Array


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
        of_rollout: whether that takes the rollout: a run without trajectories has no such metric.
    """

    name: str
    heading: str
    long_name: str
    unit: Unit | PlainUnit
    group: Group
    tables: tuple[Table, ...]
    total: bool
    digits: int
    function: Function
    of_rollout: bool = False

    def __call__(self, rollout: xr.Dataset) -> xr.DataArray:
        """Return the metric of a rollout, dimensions ([rollout], joint); infinite where it diverged.

        Its attribute ``units`` is that of prismatic joints where all are.

        Raises:
            RolloutError: when the rollout lacks a variable or has fewer than two samples.
        """
        return _values(rollout, [self])[self.name]

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
    unit: Unit | PlainUnit,
    group: Group,
    *,
    long_name: str = "",
    tables: tuple[Table, ...] = ("report",),
    total: bool = False,
    digits: int = 4,
    of_rollout: bool = False,
) -> Callable[[Function], Callable[[xr.Dataset], xr.DataArray]]:
    """Declare a metric: its name is that of the function, the rest is what :class:`Metric` says.

    Args:
        heading: in tables, short.
        unit: of its values.
        group: what it is about.
        long_name: what it is, in words; the heading where that says it.
        tables: where it is shown besides the files; in reports alone when not given.
        total: whether the value of an arm is the sum of those of its joints.
        digits: significant digits that are shown.
        of_rollout: whether the function takes a rollout in place of its totals; a run that keeps no
            trajectories leaves it out.
    """

    def declare(function: Function) -> Callable[[xr.Dataset], xr.DataArray]:
        name = function.__name__
        words = (name, heading, long_name or heading)
        declared = Metric(*words, unit, group, tables, total, digits, function, of_rollout)
        ALL[name] = declared

        # No functools.wraps: the signature is not the function's, which takes totals.
        def evaluate(rollout: xr.Dataset) -> xr.DataArray:
            return declared(rollout)

        evaluate.__name__ = evaluate.__qualname__ = name
        evaluate.__module__ = function.__module__
        evaluate.__doc__ = _documentation(function.__doc__ or "", str(unit) or "1")
        return evaluate

    return declare


def _documentation(text: str, unit: str) -> str:
    """Return the docstring of a metric: what it is, its argument, and unit and shape of its values."""
    return (
        f"{inspect.cleandoc(text)}\n\n"
        "Args:\n    rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.\n\n"
        f"Returns:\n    Values [{unit}], dimensions ([rollout], joint); infinite where one diverged.\n\n"
        "Raises:\n    RolloutError: when the rollout lacks a variable or has fewer than two samples."
    )


def declared() -> Mapping[str, Metric]:
    """Return every metric by the name that it has in files, those of plugins too."""
    registry.load_plugins()
    return ALL


def without_rollouts() -> dict[str, Metric]:
    """Return the metrics that a run without trajectories has, as in sweeps and searches, by their names."""
    return {name: each for name, each in declared().items() if not each.of_rollout}


def not_found(name: str, known: Iterable[str]) -> NameNotFound:
    """Return the error for a name that is not one of the metrics of such a run.

    Args:
        name: that was asked for.
        known: names of the metrics that such a run has.
    """
    remedy = "it needs whole rollouts, which sweeps and searches do not store" if name in declared() else ""
    return NameNotFound("metric", name, sorted(known), remedy)


def shown_in(table: Table) -> list[Metric]:
    """Return the metrics that a table shows: those of errors first, as they were declared.

    Args:
        table: "terminal", "report", "reproduction" or "zoo".
    """
    shown = [metric for metric in declared().values() if table in metric.tables]
    return sorted(shown, key=lambda metric: GROUPS.index(metric.group))


def of_joints(shown: Iterable[Metric]) -> list[Metric]:
    """Return the metrics that differ by joint: tables have a row for each of these."""
    return [metric for metric in shown if metric.group != "tool"]


def of_tool(shown: Iterable[Metric], records: Iterable[Mapping[str, Any]]) -> list[Metric]:
    """Return the metrics of the tool that say something of rollouts: forces only where something touched.

    Args:
        shown: the metrics to choose from.
        records: of the rollouts, as :func:`armgpi.config.experiment.records` has them.
    """
    chosen = []
    for metric in shown:
        values = [record["metrics"][metric.name][0] for record in records]
        known = [value for value in values if value is not None]
        touched = any(value != 0.0 for value in known) or metric.unit != NEWTON
        if metric.group == "tool" and known and touched:
            chosen.append(metric)
    return chosen


def short(value: float | None, digits: int = 4) -> str:
    """Return a number with some significant digits, rounding errors as 0; a dash when there is none.

    Args:
        value: the number; None for none.
        digits: significant digits.
    """
    if value is None or not np.isfinite(value):
        return "-"
    return f"{value:.{digits}g}" if abs(value) > ROUNDING else "0"


def error(rollout: xr.Dataset) -> xr.DataArray:
    """Return the tracking error q - q* [rad or m], dimensions (..., time, joint).

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.
    """
    return rollout["q"] - rollout["q_ref"]


@metric(
    "ITAE",
    Unit(position=1, time=2),
    "errors",
    long_name="integral of time times absolute error",
    tables=_PAPER,
    total=True,
)
def itae(run: Totals) -> Array:
    """Return the integral of time times absolute error, ``∫ t |e| dt`` (eq. 34)."""
    return run.dt * run.integral(run.timed, run.end * abs(run.e))


@metric(
    "IAE", Unit(position=1, time=1), "errors", long_name="integral of absolute error", tables=(), total=True
)
def iae(run: Totals) -> Array:
    """Return the integral of absolute error, ``∫ |e| dt``."""
    return run.integral(run.absolute, abs(run.e))


@metric(
    "ISE", Unit(position=2, time=1), "errors", long_name="integral of squared error", tables=(), total=True
)
def ise(run: Totals) -> Array:
    """Return the integral of squared error, ``∫ e² dt``."""
    return run.integral(run.squared, run.e**2)


@metric("RMS error", POSITION, "errors")
def rms(run: Totals) -> Array:
    """Return the root of the mean squared error."""
    return np.sqrt(run.integral(run.squared, run.e**2) / (run.dt * run.span))


@metric("peak error", POSITION, "errors", tables=_RUNS)
def peak_error(run: Totals) -> Array:
    """Return the largest absolute error."""
    return run.peak


@metric("final error", POSITION, "errors", tables=_RUNS)
def final_error(run: Totals) -> Array:
    """Return the absolute error of the last sample."""
    return abs(run.e)


@metric(
    "ISCI",
    Unit(torque=2, time=1),
    "torques",
    long_name="integral of squared control input",
    tables=_PAPER,
    total=True,
)
def isci(run: Totals) -> Array:
    """Return the integral of squared control input, ``∫ τ² dt`` (eq. 35)."""
    return run.dt * run.squared_torque


@metric("variation", TORQUE, "torques", long_name="total variation of torque", tables=_PAPER, total=True)
def total_variation(run: Totals) -> Array:
    """Return the total variation of torque, ``Σ |τₖ₊₁ - τₖ|``: how much it chatters."""
    return run.variation


@metric("peak", TORQUE, "torques", long_name="peak torque", tables=("terminal", "report"))
def peak_torque(run: Totals) -> Array:
    """Return the largest absolute torque."""
    return run.peak_torque


@metric("effort used", Unit(), "torques", tables=("zoo",))
def effort_used(run: Totals) -> Array:
    """Return the largest share of the effort limit that was used; 0 where there is no limit."""
    return np.where(run.peak_torque > 0.0, run.peak_torque / run.effort, 0.0)


@metric("saturated", Unit(time=1), "torques", long_name="saturated time", tables=_RUNS)
def saturated_time(run: Totals) -> Array:
    """Return how long the applied torque was at its limit."""
    return run.dt * run.saturated


@metric("beyond position limits", POSITION, "errors", tables=())
def limit_excess(run: Totals) -> Array:
    """Return how far the joint went beyond its position limits; 0 when it stayed inside."""
    return np.maximum(np.maximum(run.lower - run.lowest, run.highest - run.upper), 0.0)


@metric("hunting", POSITION, "errors", long_name="range of the joint at rest")
def hunting_amplitude(run: Totals) -> Array:
    """Return how far the joint swings, peak to peak, in the last 1.2 s, a fifth of the horizon at most.

    It is 0 where the reference moves in that time. A joint that still settles has a range as well, but swings
    half a time or less.
    """
    return run.swing


@metric("hunting frequency", Unit(time=-1), "errors", long_name="frequency of the joint at rest", tables=())
def hunting_frequency(run: Totals) -> Array:
    """Return how many times a second the joint swings up and down its range at rest; 0 if it stands still."""
    # One swing up and down is twice the range.
    swings = run.way / (2.0 * run.swing) / (run.dt * run.late)
    return np.where(run.swing > ROUNDING, swings, 0.0)


def _of_tool(run: Totals, values: Array) -> Array:
    """Return a metric of the tool; NaN where no tool is known."""
    return values if run.has_tool else np.full(np.shape(values), np.nan)


@metric(
    "tool error",
    PlainUnit("mm"),
    "tool",
    long_name="largest distance of the tool from its path",
    tables=_RUNS[:2],
)
def tool_error(run: Totals) -> Array:
    """Return the largest distance of the arm's tip from where the reference puts it.

    It is that of the links: what elastic joints and encoders at the motors hide is in it.
    """
    return _of_tool(run, 1e3 * np.sqrt(run.tool_offset))


@metric(
    "tool angle",
    PlainUnit("deg"),
    "tool",
    long_name="largest angle of the tool off its path",
    tables=_RUNS[:2],
)
def tool_angle(run: Totals) -> Array:
    """Return the largest angle between the tip's orientation and the wished one."""
    return _of_tool(run, np.degrees(run.tool_turn if run.has_angles else angle_of(run.tool_turn)))


@metric("peak force", NEWTON, "tool", long_name="largest force of a contact", tables=_RUNS[:2])
def peak_force(run: Totals) -> Array:
    """Return the largest force that one contact of `plant.environment` had at a sample; 0 without any."""
    return _of_tool(run, np.sqrt(run.force))


@metric("final force", NEWTON, "tool", long_name="largest force of a contact at the end", tables=_RUNS[:2])
def final_force(run: Totals) -> Array:
    """Return the largest force of a contact in the last sample; 0 without any."""
    return _of_tool(run, np.sqrt(run.force_last))


def summary(rollout: xr.Dataset) -> xr.Dataset:
    """Return every metric in one dataset, dimensions ([rollout], joint).

    Args:
        rollout: one or several rollouts, as :func:`armgpi.simulate` returns them.

    Raises:
        RolloutError: when the rollout lacks a variable or has fewer than two samples.
    """
    import xarray as xr

    return xr.Dataset(_values(rollout, declared().values()))


def of_totals(totals: Totals, diverged: npt.NDArray[np.bool_]) -> dict[str, Array]:
    """Return the metrics of a run's totals, name -> (..., n); infinite where it diverged.

    Args:
        totals: what was added up.
        diverged: which rollouts did, shape (...).
    """
    with np.errstate(all="ignore"):
        return {
            name: np.where(diverged[..., None], np.inf, each.function(totals))
            for name, each in without_rollouts().items()
        }


def of_recorded(run: Recorded) -> dict[str, Array]:
    """Return every metric of what was recorded, name -> (rollouts, n); infinite where it diverged.

    They are those of its dataset, which is made for metrics of rollouts alone.
    """
    recording = run.recording
    rollouts = len(recording.status)
    joints = run.robot.n
    kept = recording.kept_samples
    q, q_ref, tau = (recording.variables[name][:kept].reshape(-1, rollouts, joints) for name in _FOLDED)
    track = run.track()
    tool = None
    if track is not None:
        tool = ToolSample(*(values[:kept].reshape(-1, rollouts, 1) for values in track.sample()))
    totals = fold(recording.times[:kept], q, q_ref, tau, run.robot.limits, tool)
    values_by_name = of_totals(totals, recording.status == Status.DIVERGED)
    missing = [each for name, each in declared().items() if name not in values_by_name]
    if missing:
        dataset = run.dataset()
        for each in missing:
            values_by_name[each.name] = each(dataset).values.reshape(rollouts, joints)
    return values_by_name


def _values(rollout: xr.Dataset, declared: Iterable[Metric]) -> dict[str, xr.DataArray]:
    """Return metrics of a rollout, name -> ([rollout], joint), infinite where it diverged.

    Raises:
        RolloutError: when the rollout lacks a variable or has fewer than two samples.
    """
    import xarray as xr

    if not isinstance(rollout, xr.Dataset):
        raise RolloutError(f"a metric needs a rollout, got a {type(rollout).__name__}")
    found: dict[str, Any] = {}
    name = ""
    try:
        if (count := rollout.sizes["time"]) < 2:
            raise RolloutError(f"a metric needs at least two samples, the rollout has {count}")
        diverged, slides = rollout["status"] == Status.DIVERGED, bool(prismatic(rollout).all())
        of_totals = _of_totals(rollout)
        for each in declared:
            name = f"{each.long_name}: "
            values = each.function(rollout) if each.of_rollout else of_totals(each.function)
            facts = {"long_name": each.long_name, "units": each.unit.symbol(slides, ascii=True)}
            found[each.name] = values.where(~diverged, np.inf).rename(each.name).assign_attrs(facts)
    except KeyError as error:
        raise RolloutError(f"{name}the rollout lacks a variable that it needs: {error}") from None
    return found


def _of_totals(rollout: xr.Dataset) -> Callable[[Any], xr.DataArray]:
    """Return what works out a function of totals for a rollout, each until its end."""
    import xarray as xr

    template = rollout["q"].isel(time=0, drop=True).transpose(..., "joint")
    # All as arrays (samples, rollouts, joints), whatever dimensions the rollout has.
    dims = ("time", *template.dims)
    shape = (rollout.sizes["time"], -1, rollout.sizes["joint"])
    names = (*_FOLDED, "lower", "upper", "effort")
    arrays = xr.broadcast(*(rollout[name] for name in names))
    q, q_ref, tau, *limits = (array.transpose(*dims).values.reshape(shape) for array in arrays)
    times = rollout["time"].values
    tool = _recorded_tool(rollout, template.dims[:-1])
    # Rollouts that end at the same sample are folded together.
    is_recorded = ~np.isnan(q - q_ref).any(axis=-1)
    ends = np.maximum(is_recorded.sum(axis=0), 2)
    folds = []
    for end in np.unique(ends):
        rows = ends == end
        limits_of_rows = _Limits(*(limit[0, rows] for limit in limits))
        tool_of_rows = None
        if tool is not None:
            tool_of_rows = ToolSample(*(values[:end, rows] for values in tool))
        totals = fold(
            times[:end], q[:end, rows], q_ref[:end, rows], tau[:end, rows], limits_of_rows, tool_of_rows
        )
        totals.has_angles = True
        folds.append((rows, totals))

    def values(function: Callable[[Totals], Array]) -> xr.DataArray:
        by_rollout = np.empty(q.shape[1:])
        for rows, totals in folds:
            with np.errstate(all="ignore"):
                by_rollout[rows] = function(totals)
        return xr.DataArray(by_rollout.reshape(template.shape), template.coords, template.dims)

    return values


def _recorded_tool(rollout: xr.Dataset, rollouts: tuple[Any, ...]) -> ToolSample | None:
    """Return what the tool did in a rollout, arrays (samples, rollouts, 1); None where that is not recorded.

    In place of the square of its turn stands the angle itself.
    """
    if "tool" not in rollout:
        return None
    dims, count = ("time", *rollouts), rollout.sizes["time"]

    def squared(values: xr.DataArray) -> Array:
        squares = (values**2).sum("axis", skipna=False).transpose(*dims)
        return np.asarray(squares.values.reshape(count, -1, 1))

    turn = rollout["tool_turn"].transpose(*dims).values.reshape(count, -1, 1)
    force = np.zeros(turn.shape)
    if "contact_force" in rollout:
        for _, each in rollout["contact_force"].groupby("contact", squeeze=False):
            force = np.maximum(force, squared(each.isel(contact=0)))
    return ToolSample(squared(rollout["tool"] - rollout["tool_ref"]), turn, force)


def __getattr__(name: str) -> object:
    """Name what to use in place of what does not exist."""
    raise AttributeError(missing(f"module {__name__!r}", name, METRICS, __all__))


def __dir__() -> list[str]:
    """Return the public names, without what is imported here."""
    return __all__
