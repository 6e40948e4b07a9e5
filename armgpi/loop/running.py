"""Totals from which metrics follow: each is a fold over samples, declared once, in :data:`TOTALS`.

A loop that keeps no trajectories folds its samples as it goes, by NumPy or in generated code, and a recorded
rollout is folded by the same. The terms are elementwise NumPy; their number does not depend on the length of
the run.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from armgpi.base.arrays import Array
from armgpi.loop.tool import Tool, ToolSample

#: Hunting is looked for in the last seconds [s].
LAST = 1.2
#: But in no more than this share of the horizon [-].
SHARE = 0.2
#: Less than this is no more than rounding [rad, m, N m, N, s].
ROUNDING = 1e-12
#: A torque is at its limit from this share of it on.
LIMIT_SHARE = 1.0 - 1e-9
#: Times are those of equal steps where they differ from them by no more than this share of a step. Times of
#: files are k dt, rounded: 1e-10 of a step after 1e6 samples.
_EVEN = 1e-6


class Limits(Protocol):
    """Limits of an arm or of rollouts, each (n,) or (..., n)."""

    @property
    def lower(self) -> Array:
        """Lower position limits [rad or m]."""

    @property
    def upper(self) -> Array:
        """Upper position limits [rad or m]."""

    @property
    def effort(self) -> Array:
        """Torque limits [N m or N]."""


class Sample(NamedTuple):
    """A sample, or many along a first axis, as a total sees it: arrays (..., n). Times are in sample times.

    Attributes:
        moment: its time, times its weight.
        weight: its share of an integral by the trapezoidal rule, as if a sample like it came next.
        step: time since the sample before, for which that one's torque was held.
        later: whether it is not the first one.
        e: tracking error q - q* [rad or m].
        size: its absolute value [rad or m].
        e_before: that of the sample before [rad or m]; 0 in the first one.
        q: position [rad or m].
        q_ref: its target [rad or m].
        tau: torque from this sample on [N m or N].
        tau_before: that of the sample before [N m or N]; 0 in the first one.
        limit: from which on a torque is at its limit [N m or N].
        tool: what the tool does, arrays (..., 1): the same for all joints.
    """

    moment: Any
    weight: Any
    step: Any
    later: Any
    e: Array
    size: Array
    e_before: Array
    q: Array
    q_ref: Array
    tau: Array
    tau_before: Array
    limit: Array
    tool: ToolSample


class Fold(NamedTuple):
    """How samples change a total.

    Attributes:
        start: the total of no samples.
        one: total and sample -> the next total.
        all: total and samples along a first axis -> the total, with the same bits as one after the other.
    """

    start: float
    one: Callable[[Any, Any], Any]
    all: Callable[[Array, Array], Array]


def _add_all(total: Array, terms: Array) -> Array:
    """Return a sum with more terms, added one after the other: np.sum would add them in pairs."""
    total_first = np.concatenate([total[None], terms])
    last: Array = np.cumsum(total_first, axis=0)[-1]
    return last


def _least_of_all(total: Array, terms: Array) -> Array:
    """Return the least of a total and terms, of which there may be none."""
    least: Array = np.minimum(total, terms.min(axis=0, initial=np.inf))
    return least


def _most_of_all(total: Array, terms: Array) -> Array:
    """Return the largest of a total and terms, of which there may be none."""
    largest: Array = np.maximum(total, terms.max(axis=0, initial=-np.inf))
    return largest


_ADD = Fold(0.0, operator.add, _add_all)
_LEAST = Fold(np.inf, np.minimum, _least_of_all)
_MOST = Fold(-np.inf, np.maximum, _most_of_all)
#: Of magnitudes.
_PEAK = _MOST._replace(start=0.0)
_LAST = Fold(0.0, lambda total, term: term, lambda total, terms: terms[-1])


def _change_of_torque(x: Sample) -> Any:
    """Return by how much the torque changed [N m or N]; 0 in the first sample."""
    return np.where(x.later, np.abs(x.tau - x.tau_before), 0.0)


def _time_at_limit(x: Sample) -> Any:
    """Return for how long the torque before was at its limit, in sample times."""
    at_limit = x.later & (np.abs(x.tau_before) >= x.limit)
    return x.step * np.where(at_limit, 1.0, 0.0)


def _of_joints(value: Any, x: Sample) -> Any:
    """Return what is the same for all joints as an array over them."""
    return np.broadcast_to(value, x.e.shape)


class Total(NamedTuple):
    """A number of each joint that samples add up to.

    Attributes:
        fold: how.
        term: what a sample adds.
        since: of the last seconds alone: from which sample on, counted from their first one; None of all.
    """

    fold: Fold
    term: Callable[[Sample], Any]
    since: float | None = None


#: Name -> total. Samples before the last one count in what is held until the next.
TOTALS: dict[str, Total] = {
    "timed": Total(_ADD, lambda x: x.moment * x.size),  # time times absolute error
    "absolute": Total(_ADD, lambda x: x.weight * x.size),
    "squared": Total(_ADD, lambda x: x.weight * (x.e * x.e)),
    "peak": Total(_PEAK, lambda x: x.size),
    "e": Total(_LAST, lambda x: x.e),
    "squared_torque": Total(_ADD, lambda x: x.step * (x.tau_before * x.tau_before)),
    "variation": Total(_ADD, _change_of_torque),
    "peak_torque": Total(_PEAK, lambda x: np.abs(x.tau)),
    "saturated": Total(_ADD, _time_at_limit),
    "tau": Total(_LAST, lambda x: x.tau),
    "lowest": Total(_LEAST, lambda x: x.q),
    "highest": Total(_MOST, lambda x: x.q),
    # Of the error in the last seconds, how far it goes there, and its target.
    "low": Total(_LEAST, lambda x: x.e, -0.5),
    "high": Total(_MOST, lambda x: x.e, -0.5),
    "way": Total(_ADD, lambda x: np.abs(x.e - x.e_before), 0.5),
    "target_low": Total(_LEAST, lambda x: x.q_ref, -0.5),
    "target_high": Total(_MOST, lambda x: x.q_ref, -0.5),
    # Of the tool, squares.
    "tool_offset": Total(_PEAK, lambda x: _of_joints(x.tool.offset, x)),
    "tool_turn": Total(_PEAK, lambda x: _of_joints(x.tool.turn, x)),
    "force": Total(_PEAK, lambda x: _of_joints(x.tool.force, x)),
    "force_last": Total(_LAST, lambda x: _of_joints(x.tool.force, x)),
}
#: Of a run whose tool nobody looks at.
_NO_TOOL = ToolSample(0.0, 0.0, 0.0)
#: What is added up, in the order of :data:`TOTALS`.
Sums = tuple[Any, ...]


class Running:
    """Adds samples to totals.

    Attributes:
        dt: sample time [s]; of unequal steps the first one.
        late: number of the first sample of the last seconds.
        tool: what works out what the tool does; None where nobody asks.
    """

    def __init__(self, times: Array, effort: Array, tool: Tool | None = None) -> None:
        """Begin a run.

        Args:
            times: of the samples [s], two at least.
            effort: torque limits [N m or N], (n,) or (batch, n).
            tool: works out what the tool does, where that counts.
        """
        self.tool = tool
        # Two samples of a file may have one time.
        horizon = times[-1] - times[0]
        self.dt = float(times[1] - times[0]) or float(horizon)
        window = times[-1] - min(LAST, SHARE * horizon) - ROUNDING
        self.late = np.array(float(np.searchsorted(times, window)))
        self._limit = effort * LIMIT_SHARE

    def init(self, shape: tuple[int, ...]) -> Sums:
        """Return the totals of no samples, of this shape."""
        return tuple(np.full(shape, total.fold.start) for total in TOTALS.values())

    def add(
        self,
        k: Any,
        q: Array,
        q_ref: Array,
        tau: Array,
        sums: Sums,
        late: bool = True,
        *,
        v: Array | None = None,
    ) -> Sums:
        """Return the totals with one more sample; steps are equal.

        Args:
            k: number of the sample.
            q: positions [rad or m].
            q_ref: their targets [rad or m].
            tau: torques applied from this sample on [N m or N].
            sums: the totals before.
            late: False where the sample is known to be before the last seconds: their totals stay.
            v: velocities [rad/s or m/s], where the tool counts.
        """
        before = dict(zip(TOTALS, sums, strict=True))
        later = k > 0.0
        e = q - q_ref
        largest = (before["tool_offset"][..., 0:1], before["tool_turn"][..., 0:1])
        sample = Sample(
            moment=k,
            weight=np.where(later, 1.0, 0.5),
            step=1.0,
            later=later,
            e=e,
            size=np.abs(e),
            e_before=before["e"],
            q=q,
            q_ref=q_ref,
            tau=tau,
            tau_before=before["tau"],
            limit=self._limit,
            tool=self._at_tool(k * self.dt, q, v, q_ref, largest),
        )

        def next_value(total: Total, value: Any) -> Any:
            if total.since is not None and not late:
                return value
            after = total.fold.one(value, total.term(sample))
            if total.since is None:
                return after
            return np.where(k > self.late + total.since, after, value)

        return tuple(map(next_value, TOTALS.values(), sums))

    def _at_tool(
        self, t: Any, q: Array, v: Array | None, q_ref: Array, largest: tuple[Any, Any] | None = None
    ) -> ToolSample:
        """Return what the tool does at times [s], a number or (..., 1); see :meth:`Tool.at`."""
        if self.tool is None or v is None:
            return _NO_TOOL
        return self.tool.at(q, v, q_ref, t, largest)

    def add_all(
        self, first: int, q: Array, q_ref: Array, tau: Array, sums: Sums, *, v: Array | None = None
    ) -> Sums:
        """Return the totals with samples from number `first` on, the same as those of one after the other.

        Args:
            first: number of the first sample.
            q: positions [rad or m], shape (samples, ...).
            q_ref: their targets [rad or m], likewise.
            tau: torques applied from each sample on [N m or N], likewise.
            sums: the totals before, arrays (...).
            v: velocities [rad/s or m/s], likewise, where the tool counts.
        """
        numbers = np.arange(first, first + len(q), dtype=np.float64)
        numbers = numbers.reshape(-1, *[1] * (q.ndim - 1))
        tool = self._at_tool(numbers * self.dt, q, v, q_ref)
        total_of = self.totals(first, q, q_ref, tau, sums, tool=tool)
        return tuple(map(total_of, TOTALS))

    def totals(
        self,
        first: int,
        q: Array,
        q_ref: Array,
        tau: Array,
        sums: Sums,
        times: Array | None = None,
        tool: ToolSample = _NO_TOOL,
    ) -> Callable[[str], Array]:
        """Return what gives a total by its name, each worked out when it is asked for.

        Args:
            first: as for :meth:`add_all`.
            q: likewise.
            q_ref: likewise.
            tau: likewise.
            sums: likewise.
            times: of all samples, where steps are not equal [s].
            tool: what the tool does, arrays (samples, ..., 1).
        """
        k = np.arange(first, first + len(q), dtype=np.float64)
        e = q - q_ref
        # Of equal steps, in sample times.
        step = np.ones(len(q))
        weight = np.where(k > 0.0, 1.0, 0.5)
        moment = k
        if times is not None:
            step = np.diff(times, prepend=times[:1]) / self.dt
            # The last one counts as if its step were the next, too: Totals.integral takes half of it away.
            weight = 0.5 * (step + np.append(step[1:], step[-1]))
            moment = times / self.dt * weight
        before = dict(zip(TOTALS, sums, strict=True))

        def for_all(values: Any) -> Any:
            """Return what is the same for all joints and rollouts, a number for each sample."""
            return values.reshape(-1, *[1] * (e.ndim - 1))

        sample = Sample(
            moment=for_all(moment),
            weight=for_all(weight),
            step=for_all(step),
            later=for_all(k > 0.0),
            e=e,
            size=np.abs(e),
            e_before=np.concatenate([before["e"][None], e[:-1]]),
            q=q,
            q_ref=q_ref,
            tau=tau,
            tau_before=np.concatenate([before["tau"][None], tau[:-1]]),
            limit=self._limit,
            tool=tool,
        )

        def total(name: str) -> Array:
            fold, term, since = TOTALS[name]
            terms = term(sample)
            if since is not None:
                terms = terms[k > self.late + since]
            return fold.all(before[name], terms)

        return total


class Totals:
    """What metrics are worked out from: all of :data:`TOTALS` as attributes, arrays (..., n), and the run's.

    Attributes:
        dt: sample time [s].
        end: time of the last sample, in sample times.
        span: from the first sample to the last, likewise.
        late: the last seconds in which hunting is looked for, likewise.
        step: from the last but one sample to the last, likewise.
        lower: lower position limits [rad or m].
        upper: upper position limits [rad or m].
        effort: torque limits [N m or N].
        has_tool: whether the totals of the tool are of one.
    """

    def __init__(
        self,
        running: Running,
        total: Callable[[str], Array],
        times: Array,
        limits: Limits,
        even: bool = True,
        has_tool: bool = False,
    ) -> None:
        """Keep what was added up.

        Args:
            running: what added it up.
            total: gives a total by its name; asked once for each that is wanted.
            times: of the samples [s].
            limits: `lower`, `upper` [rad or m] and `effort` [N m or N], each (n,) or (..., n).
            even: whether all steps are equal.
            has_tool: whether the totals of the tool are of one.
        """
        self.has_tool = has_tool
        self.has_angles = False
        self._total = cache(total)
        self.dt = running.dt
        last = float(len(times) - 1)
        late = float(running.late)
        self.end = last
        self.span = last
        self.late = last - late
        self.step = 1.0
        if not even:
            before_the_end = times[-1] - np.array([0.0, times[0], times[int(late)], times[-2]])
            self.end, self.span, self.late, self.step = (before_the_end / self.dt).tolist()
        self.lower: Array = limits.lower
        self.upper: Array = limits.upper
        self.effort: Array = limits.effort

    def __getattr__(self, name: str) -> Array:
        """Return a total."""
        if name not in TOTALS:
            raise AttributeError(f"{name!r} is no total; there are {', '.join(TOTALS)}")
        return self._total(name)

    def integral(self, total: Array, last: Array) -> Array:
        """Return an integral by the trapezoidal rule, of a total and the last sample's value."""
        return self.dt * (total - 0.5 * self.step * last)

    @property
    def swing(self) -> Array:
        """Range of the error in the last seconds [rad or m]; 0 where the reference moves then."""
        with np.errstate(invalid="ignore"):
            rests = ~(self.target_high - self.target_low > ROUNDING)
            return np.where(rests, np.fmax(self.high - self.low, 0.0), 0.0)


def fold(
    times: Array, q: Array, q_ref: Array, tau: Array, limits: Limits, tool: ToolSample | None = None
) -> Totals:
    """Return the totals of recorded samples.

    Args:
        times: of the samples [s], shape (samples,), two at least.
        q: positions [rad or m], shape (samples, ..., n).
        q_ref: their targets [rad or m], likewise.
        tau: torques applied from each sample on [N m or N], likewise.
        limits: as for :class:`Totals`.
        tool: what the tool does, arrays (samples, ..., 1), where that is known.
    """
    running = Running(times, limits.effort)
    apart = np.abs(times - np.arange(len(times)) * running.dt)
    even = bool((apart <= _EVEN * running.dt).all())
    total = running.totals(
        0,
        q,
        q_ref,
        tau,
        sums=running.init(q.shape[1:]),
        times=None if even else times,
        tool=_NO_TOOL if tool is None else tool,
    )
    return Totals(running, total, times, limits, even, tool is not None)
