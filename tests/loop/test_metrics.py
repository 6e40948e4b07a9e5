"""Metrics against closed forms, SciPy and their own laws, and declared once."""

from __future__ import annotations

import json
import runpy
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import quad, trapezoid

from armgpi import Status, config, metrics
from armgpi.base.arrays import Array
from armgpi.config.experiment import compare, save
from armgpi.errors import ArmgpiError, RolloutError
from armgpi.loop.running import TOTALS, Running, Totals, fold
from armgpi.loop.units import Unit

ROOT = Path(__file__).parents[2]
T, H = 4.0, 1e-3
TIME = np.arange(round(T / H) + 1) * H
#: Those of joints; tests/loop/test_tool.py has those of the tool.
OF_JOINTS = {name: metric for name, metric in metrics.ALL.items() if metric.group != "tool"}
#: How each metric grows when all errors and torques are multiplied by a factor.
POWER = {
    name: metric.unit.position + metric.unit.torque
    for name, metric in OF_JOINTS.items()
    if isinstance(metric.unit, Unit)
}


def rollout(
    e: np.ndarray,
    tau: np.ndarray | None = None,
    time: np.ndarray = TIME,
    status: object = 0,
    effort: float = 10.0,
) -> xr.Dataset:
    """A rollout with errors and torques of shape ([rollouts], time, joints), about a moving reference."""
    e = np.asarray(e, dtype=float)
    tau = np.zeros_like(e) if tau is None else np.asarray(tau, dtype=float)
    dims = ("rollout", "time", "joint")[3 - e.ndim :]
    q_ref = np.broadcast_to(np.sin(time)[:, None], e.shape)
    limit = np.full(e.shape[-1], 1.0)
    return xr.Dataset(
        {
            "q": (dims, q_ref + e),
            "q_ref": (dims, q_ref),
            "tau": (dims, tau),
            "status": (dims[:-2], np.asarray(status, dtype=np.int32)),
            "lower": ("joint", -5.0 * limit),
            "upper": ("joint", 5.0 * limit),
            "effort": ("joint", effort * limit),
        },
        coords={"time": time, "joint": [f"q{j}" for j in range(e.shape[-1])]},
    )


def column(values: np.ndarray) -> np.ndarray:
    return np.broadcast_to(values, TIME.shape)[:, None]


class Limits(NamedTuple):
    """Limits of joints."""

    lower: Array
    upper: Array
    effort: Array


# Rounding of 4,000 terms, each a multiple of q - q_ref that is rounded to 1e-16.
EXACT = {"rtol": 1e-11, "atol": 1e-14}


def test_a_constant_error_has_its_closed_forms() -> None:
    c = -0.25
    run = rollout(column(c))
    for metric, expected in (
        (metrics.itae, abs(c) * T**2 / 2),  # the trapezoidal rule is exact for t |c|
        (metrics.iae, abs(c) * T),
        (metrics.ise, c**2 * T),
        (metrics.rms, abs(c)),
        (metrics.peak_error, abs(c)),
        (metrics.final_error, abs(c)),
    ):
        np.testing.assert_allclose(metric(run), [expected], **EXACT)
    assert np.abs(run["q_ref"]).max() > 0.0
    np.testing.assert_allclose(metrics.error(run).values, c, **EXACT)


def test_a_ramp_of_error_has_its_closed_forms() -> None:
    r = 0.2
    run = rollout(column(r * TIME))
    # For squares of t, the trapezoidal rule is off by exactly h^2 / 12 times the difference of the slopes.
    surplus = H**2 / 12 * 2.0 * T
    np.testing.assert_allclose(metrics.itae(run), [r * (T**3 / 3 + surplus)], **EXACT)
    np.testing.assert_allclose(metrics.iae(run), [r * T**2 / 2], **EXACT)
    np.testing.assert_allclose(metrics.ise(run), [r**2 * (T**3 / 3 + surplus)], **EXACT)
    np.testing.assert_allclose(metrics.final_error(run), [r * T], **EXACT)


def test_a_sine_of_error_agrees_with_adaptive_quadrature() -> None:
    e = lambda t: 0.3 * np.sin(7.0 * t + 0.4)  # noqa: E731
    run = rollout(column(e(TIME)))
    # |f''| of all three integrands is below 0.3 * 7^2 * T + 2 * 0.3 * 7 = 63, but for the kinks of |e|, each
    # of which adds an error of at most its change of slope, 2 * 0.3 * 7 * T, times h^2 / 8.
    bound = H**2 / 12 * 63 * T + 10 * 2 * 0.3 * 7 * T * H**2 / 8
    zeros = (np.arange(1, 10) * np.pi - 0.4) / 7.0
    for metric, integrand in (
        (metrics.itae, lambda t: t * abs(e(t))),
        (metrics.iae, lambda t: abs(e(t))),
        (metrics.ise, lambda t: e(t) ** 2),
    ):
        expected, _ = quad(integrand, 0.0, T, points=zeros[zeros < T], epsabs=1e-12)
        np.testing.assert_allclose(metric(run), [expected], atol=bound)
    np.testing.assert_allclose(metrics.peak_error(run), [0.3], atol=0.3 * (7.0 * H) ** 2 / 8)


def test_a_sine_of_torque_has_its_closed_forms() -> None:
    a, periods = 3.0, 5
    tau = a * np.sin(2.0 * np.pi * periods / T * TIME)  # every peak falls on a sample
    run = rollout(column(0.0), column(tau))
    # Over whole periods the sum of squares of equally spaced samples is exactly half of them.
    np.testing.assert_allclose(metrics.isci(run), [a**2 * T / 2], **EXACT)
    np.testing.assert_allclose(metrics.total_variation(run), [4 * a * periods], **EXACT)
    np.testing.assert_allclose(metrics.peak_torque(run), [a], **EXACT)


#: Steps that are equal, from 0, from later and for long; others, of which the first is none.
GRIDS: dict[str, np.ndarray] = {
    "even": np.arange(56) * 0.02,  # whose last fifth begins at a sample but for rounding
    "later": 3.7 + np.arange(40) * 0.05,
    "long": np.arange(91) * 0.1,
    "uneven": 2.0 + np.cumsum([0.0, 0.0, 0.3, 0.01, 0.07, 0.2, 0.05, 0.02, 0.01, 0.03, 0.06, 0.02, 0.04]),
}


@pytest.mark.parametrize("grid", GRIDS)
def test_every_metric_is_what_its_words_say_joint_by_joint(grid: str) -> None:
    time, random = GRIDS[grid], np.random.default_rng(5)
    n, span = len(time), time[-1] - time[0]
    effort = np.array([[2.0, 1.0, np.inf], [3.0, 1.5, 4.0]])
    lower, upper = np.array([[-1.5, -1.0, -9.0]] * 2), np.array([[1.0, 9.0, 1.2]] * 2)
    e, q_ref, tau = random.normal(size=(3, n, 2, 3))
    e[-1, 1] *= 9.0
    q_ref[n // 3 :, :, :2] = 0.3
    q_ref[n // 3 :, 1, 0] = [0.0, *[1e-12] * (n - n // 3 - 1)]  # at rest, but for rounding
    q_ref[-1, 1, 1] += 1e-9  # which moves
    at = np.where(np.isinf(effort), 7.0, effort)
    tau[2:5], tau[-3], tau[-1] = at * (1.0 - 1e-9), -at * (1.0 - 5e-10), at  # at their limits
    tau[5:7] = at * (1.0 - 1e-8)
    q = q_ref + e
    found = metrics.of_totals(
        fold(time, q, q_ref, tau, Limits(lower, upper, effort)), np.array([False, False])
    )
    late = [k for k in range(n) if time[k] >= time[-1] - min(1.2, 0.2 * span) - 1e-9]
    for i, j in np.ndindex(2, 3):
        error, torque = np.abs(q - q_ref)[:, i, j], tau[:, i, j]
        steps, limit = np.diff(time), effort[i, j]
        squared = trapezoid(error**2, time)
        rests = np.ptp(q_ref[late, i, j]) <= 1e-12
        swing = np.ptp((q - q_ref)[late, i, j]) if rests else 0.0
        way = sum(abs((q - q_ref)[k, i, j] - (q - q_ref)[k - 1, i, j]) for k in late[1:])
        wanted: dict[str, Any] = {
            "itae": trapezoid(time * error, time),
            "iae": trapezoid(error, time),
            "ise": squared,
            "rms": np.sqrt(squared / span),
            "peak_error": max(error),
            "final_error": error[-1],
            "isci": sum(torque[:-1] ** 2 * steps),
            "total_variation": sum(abs(b - a) for a, b in pairwise(torque)),
            "peak_torque": max(abs(torque)),
            "effort_used": max(abs(torque)) / limit,
            "saturated_time": sum(steps[abs(torque[:-1]) >= limit * (1.0 - 1e-9)]),
            "limit_excess": max(0.0, lower[i, j] - min(q[:, i, j]), max(q[:, i, j]) - upper[i, j]),
            "hunting_amplitude": swing,
            "hunting_frequency": way / (2.0 * swing) / (time[-1] - time[late[0]]) if rests else 0.0,
        }
        assert wanted.keys() == found.keys() & OF_JOINTS.keys()
        for name, value in wanted.items():
            np.testing.assert_allclose(found[name][i, j], value, rtol=1e-9, atol=1e-14, err_msg=name)


def test_hunting_is_the_swing_at_rest_of_the_last_fifth_or_1_2_seconds() -> None:
    for horizon, window in ((4.0, 0.8), (12.0, 1.2)):
        time = np.arange(round(horizon / H) + 1) * H
        late = time >= horizon - window - 0.5 * H
        # Five periods in the window, between larger swings before it.
        e = np.where(late, 0.02 * np.sin(10.0 * np.pi * (time - horizon) / window), 0.5 * np.cos(9.0 * time))
        run = rollout(e[:, None], time=time)
        assert (
            metrics.hunting_amplitude(run).item() == metrics.hunting_frequency(run).item() == 0.0
        )  # it moves
        still = run.assign(q=run["q"] - run["q_ref"], q_ref=0.0 * run["q_ref"])
        np.testing.assert_allclose(metrics.hunting_amplitude(still), [0.04], rtol=1e-3)
        np.testing.assert_allclose(metrics.hunting_frequency(still), [5.0 / window], rtol=1e-2)
        for early in (0, 1):  # the window's first sample counts, the one before does not
            alone = (np.arange(len(time)) == late.argmax() - early)[:, None]
            spike = metrics.hunting_amplitude(still.assign(q=0.0 * still["q"] + alone))
            np.testing.assert_array_equal(spike, [1.0 - early])
        settles = still.assign(q=still["q"] * 0.0 + np.exp(-time)[:, None])
        np.testing.assert_allclose(metrics.hunting_frequency(settles), [0.5 / window], rtol=1e-2)


def test_a_rollout_ends_where_its_reference_does() -> None:
    run = rollout(np.random.default_rng(1).normal(size=(len(TIME), 2)))
    lost = run.assign(q_ref=run["q_ref"].where(run["time"] < TIME[-5], np.nan))
    for metric in (metrics.iae, metrics.peak_error):
        np.testing.assert_array_equal(metric(lost), metric(run.isel(time=slice(-5))))


# Laws.

SHAPE = st.tuples(st.integers(2, 20), st.integers(1, 4))
NUMBERS = st.floats(-2.0, 2.0, allow_subnormal=False)
ERRORS = SHAPE.flatmap(
    lambda shape: st.tuples(arrays(float, shape, elements=NUMBERS), arrays(float, shape, elements=NUMBERS))
)
FACTORS = st.floats(0.125, 2.0)


def test_metrics_do_not_depend_on_when_the_clock_starts() -> None:
    e, tau = np.random.default_rng(0).normal(size=(2, len(TIME), 2))
    run = rollout(0.1 * e, tau)
    run["q_ref"] = 0.0 * run["q_ref"]  # at rest, where hunting counts
    later = run.assign_coords(time=TIME + 100.0)
    for name in OF_JOINTS.keys() - {"itae"}:  # whose weight is the clock's time
        values = (getattr(metrics, name)(each) for each in (later, run))
        np.testing.assert_allclose(*values, rtol=1e-8, err_msg=name)


def with_signals(e: np.ndarray, tau: np.ndarray) -> xr.Dataset:
    # A grid that is not even, and a reference at rest: e is q itself, so that it scales exactly.
    time = np.cumsum(1.0 + 0.5 * np.sin(np.arange(len(e)))) * 1e-2
    return rollout(e, tau, time=time - time[0]).assign(
        q_ref=lambda run: 0.0 * run["q"], q=lambda run: run["q"] - run["q_ref"]
    )


@settings(max_examples=30)
@given(ERRORS)
def test_no_metric_is_negative(signals: tuple[np.ndarray, np.ndarray]) -> None:
    table = metrics.summary(with_signals(*signals))
    for name in OF_JOINTS:
        assert (table[name] >= 0.0).all()
        assert np.isfinite(table[name]).all()


@pytest.mark.slow
@settings(max_examples=12)
@given(ERRORS, FACTORS)
def test_metrics_scale_with_the_error_or_its_square(
    signals: tuple[np.ndarray, np.ndarray], factor: float
) -> None:
    run = with_signals(*signals)
    scaled = run.assign(
        {name: factor * run[name] for name in ("q", "q_ref", "tau", "lower", "upper", "effort")}
    )
    for name, metric in OF_JOINTS.items():
        np.testing.assert_allclose(metric(scaled), factor ** POWER[name] * metric(run), rtol=1e-9, atol=1e-14)


@settings(max_examples=12)
@given(ERRORS, FACTORS, FACTORS, FACTORS)
def test_a_metric_scales_as_its_unit_says(
    signals: tuple[np.ndarray, np.ndarray], position: float, torque: float, time: float
) -> None:
    run = with_signals(*signals)
    factors = dict.fromkeys(("q", "q_ref", "lower", "upper"), position) | {"tau": torque, "effort": torque}
    scaled = run.assign({name: factor * run[name] for name, factor in factors.items()})
    scaled = scaled.assign_coords(time=time * run["time"])
    for metric in OF_JOINTS.values():
        unit = metric.unit
        assert isinstance(unit, Unit)
        factor = position**unit.position * torque**unit.torque * time**unit.time
        np.testing.assert_allclose(metric(scaled), factor * metric(run), rtol=1e-9, atol=1e-14)


@settings(max_examples=30)
@given(ERRORS, st.randoms(use_true_random=False))
def test_metrics_do_not_depend_on_the_order_of_joints(
    signals: tuple[np.ndarray, np.ndarray], random: object
) -> None:
    run = with_signals(*signals)
    order = list(range(run.sizes["joint"]))
    random.shuffle(order)  # type: ignore[attr-defined]
    # But for the order in which NumPy sums.
    xr.testing.assert_allclose(
        metrics.summary(run.isel(joint=order)), metrics.summary(run).isel(joint=order), rtol=1e-12, atol=1e-15
    )


@settings(max_examples=30)
@given(ERRORS)
def test_a_thinned_rollout_has_the_metrics_of_the_samples_kept(
    signals: tuple[np.ndarray, np.ndarray],
) -> None:
    run = with_signals(*signals)
    kept = run.isel(time=slice(None, None, 3))
    if kept.sizes["time"] < 2:
        return
    e, t = np.abs((kept["q"] - kept["q_ref"]).values), kept["time"].values
    np.testing.assert_allclose(
        metrics.itae(kept), trapezoid(t[:, None] * e, t, axis=0), rtol=1e-12, atol=1e-15
    )
    # What lies between samples can only add to these.
    assert (metrics.total_variation(kept) <= metrics.total_variation(run) + 1e-12).all()
    assert (metrics.peak_error(kept) <= metrics.peak_error(run)).all()


@pytest.mark.parametrize("name", OF_JOINTS)
def test_a_metric_is_a_pure_function(name: str) -> None:
    run = rollout(column(0.1 * np.sin(TIME)), column(np.cos(TIME)))
    for variable in run.variables.values():
        if variable.dtype.kind == "f" and isinstance(variable._data, np.ndarray):
            variable.values.setflags(write=False)
    before = run.copy(deep=True)
    assert OF_JOINTS[name](run).identical(OF_JOINTS[name](run))
    assert run.identical(before)


@pytest.mark.parametrize("name", OF_JOINTS)
def test_a_metric_has_one_number_per_rollout_and_joint_with_units(name: str) -> None:
    single = OF_JOINTS[name](rollout(np.zeros((len(TIME), 2))))
    assert single.dims == ("joint",)
    assert {"units", "long_name"} <= set(single.attrs)
    batch = OF_JOINTS[name](rollout(np.zeros((3, len(TIME), 2)), status=[0, 0, 0]))
    assert batch.dims == ("rollout", "joint")
    assert batch.sizes == {"rollout": 3, "joint": 2}


def test_the_metrics_of_a_batch_are_those_of_its_rollouts() -> None:
    x = np.random.default_rng(0).normal(size=(2, 3, len(TIME), 2))
    batch = rollout(x[0], x[1], status=[0, 0, 0])
    table = metrics.summary(batch)
    for i in range(3):
        one = metrics.summary(batch.isel(rollout=i))
        for name in OF_JOINTS:
            np.testing.assert_allclose(table[name][i], one[name], rtol=1e-13)


# Rollouts that did not finish.


@pytest.mark.parametrize("name", OF_JOINTS)
def test_a_diverged_rollout_has_infinite_cost_and_the_others_their_own(name: str) -> None:
    e = np.full((2, len(TIME), 2), 0.1)
    e[1, 100:] = np.nan
    run = rollout(e, e, status=[Status.FINISHED, Status.DIVERGED])
    values = OF_JOINTS[name](run)
    np.testing.assert_array_equal(values[1], [np.inf, np.inf])
    np.testing.assert_array_equal(values[0], OF_JOINTS[name](run.isel(rollout=0)))
    assert np.isfinite(values[0]).all()


@pytest.mark.parametrize("name", OF_JOINTS)
def test_an_interrupted_rollout_among_longer_ones_has_the_metrics_until_then(name: str) -> None:
    x = np.random.default_rng(1).normal(size=(2, 2, len(TIME), 3))
    x[:, 1, 1000:] = np.nan
    joined = rollout(x[0], x[1], status=[Status.FINISHED, Status.INTERRUPTED])
    alone = joined.isel(rollout=1, time=slice(0, 1000))
    # The order of summation differs.
    np.testing.assert_allclose(OF_JOINTS[name](joined)[1], OF_JOINTS[name](alone), rtol=1e-12)


@pytest.mark.parametrize("name", OF_JOINTS)
@pytest.mark.parametrize("samples", [0, 1])
def test_too_few_samples_are_refused(name: str, samples: int) -> None:
    with pytest.raises(RolloutError, match=f"at least two samples, the rollout has {samples}"):
        OF_JOINTS[name](rollout(column(0.0)).isel(time=slice(0, samples)))


@pytest.mark.parametrize("name", OF_JOINTS)
def test_a_dataset_that_is_no_rollout_is_refused(name: str) -> None:
    with pytest.raises(ArmgpiError, match="lacks"):
        OF_JOINTS[name](xr.Dataset({"x": ("time", TIME)}))


# Declared once.


def test_a_metric_is_in_files_and_reports_by_default_and_in_no_other_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(metrics, "ALL", dict(metrics.ALL))

    @metrics.metric("mean", Unit(position=1), "errors")
    def mean_error(run: Totals) -> Array:
        """Return the mean of the absolute error."""
        return run.integral(run.absolute, abs(run.e)) / (run.dt * run.span)

    assert "mean_error" in metrics.summary(rollout(column(0.5)))
    declared = metrics.ALL["mean_error"]
    assert [each for each in get_args(metrics.Table) if declared in metrics.shown_in(each)] == ["report"]
    # By name it is what it was, of rollouts.
    np.testing.assert_allclose(mean_error(rollout(column(-0.5))), [0.5], **EXACT)
    with pytest.raises(AttributeError, match="'peek' is no total; there are timed, absolute"):
        _ = fold(TIME, TIME[:, None], TIME[:, None], TIME[:, None], Limits(*np.ones((3, 1)))).peek


def test_the_sample_time_is_the_first_step_or_all_of_what_begins_with_two_equal_times() -> None:
    effort = np.ones(3)
    assert Running(np.array([2.0, 2.25, 3.0]), effort).dt == 0.25
    assert Running(np.array([2.0, 2.0, 3.0]), effort).dt == 1.0


@pytest.mark.parametrize("first", [1, 2, 1999])
def test_totals_do_not_depend_on_how_samples_are_parted(first: int) -> None:
    q, q_ref, tau = np.random.default_rng(2).normal(size=(3, 2000, 2, 3))
    q_ref[1500:] = 0.0
    times, limits = np.arange(2000) * 1e-3, Limits(*np.ones((3, 3)))
    running = Running(times, limits.effort)
    sums = running.init((2, 3))
    for part in (slice(0, first), slice(first, 2000)):
        sums = running.add_all(part.start, q[part], q_ref[part], tau[part], sums)
    whole = fold(times, q, q_ref, tau, limits)
    one_by_one = running.init((2, 3))
    for k in range(2000):
        one_by_one = running.add(np.float64(k), q[k], q_ref[k], tau[k], one_by_one)
    for name, parted, each in zip(TOTALS, sums, one_by_one, strict=True):
        np.testing.assert_array_equal(getattr(whole, name), parted)
        np.testing.assert_array_equal(getattr(whole, name), each)


def test_a_grid_is_even_where_its_steps_are_equal_but_for_rounding() -> None:
    # Moved by far less than a step, times are still those of k dt. By more, they are a grid of their own.
    e = np.random.default_rng(3).normal(size=(len(TIME), 1))
    run = rollout(e)
    rounded = metrics.summary(run.assign_coords(time=TIME * (1.0 + 1e-15)))
    apart = metrics.summary(run.assign_coords(time=TIME + 1e-5 * H * np.sin(np.arange(len(TIME)))))
    for name, values in metrics.summary(run).items():
        np.testing.assert_allclose(rounded[name], values, rtol=1e-14, err_msg=str(name))
        np.testing.assert_allclose(apart[name], values, rtol=1e-4, err_msg=str(name))


def test_units_in_files_are_those_of_the_joints() -> None:
    run = rollout(np.zeros((len(TIME), 2)))
    kinds = {"rad s^2": ["revolute", "prismatic"], "m s^2": ["prismatic", "prismatic"]}
    for expected, types in kinds.items():
        assert metrics.itae(run.assign_coords(joint_type=("joint", types))).units == expected
    assert metrics.itae(run).units == "rad s^2"  # it does not say


def test_numbers_have_as_many_digits_as_there_are() -> None:
    short = metrics.short
    assert [short(x) for x in (None, np.inf, np.nan, 0.0, 1e-13, 0.123456, 12345.6)] == [
        *("-", "-", "-", "0", "0", "0.1235", "1.235e+04"),
    ]
    assert short(0.123456, 2) == "0.12"
    itae = metrics.ALL["itae"]
    assert (itae.text(0.123456), itae.text(0.123456, most=2)) == ("0.1235", "0.12")


@pytest.fixture
def scratch(monkeypatch: pytest.MonkeyPatch) -> metrics.Metric:
    """A metric of rollouts that is declared for all tables, and nothing else: the mean of t e^2."""
    monkeypatch.setattr(metrics, "ALL", dict(metrics.ALL))
    facts = {"long_name": "a scratch metric", "digits": 3, "tables": get_args(metrics.Table)}

    @metrics.metric("scratch", Unit(position=2, time=1), "errors", of_rollout=True, **facts)
    def scratch_metric(rollout: xr.Dataset) -> xr.DataArray:
        """Return a mean that nobody needs."""
        return (rollout["time"] * metrics.error(rollout) ** 2).mean("time")

    return metrics.ALL["scratch_metric"]


@pytest.fixture(scope="module")
def run_of_arm() -> tuple[config.Experiment, xr.Dataset]:
    text = """
    robot: {name: anthropomorphic3}
    plant: {loads: [{type: sine, amplitude: 0.3, omega: 9}]}
    t_final: 0.2
    """
    experiment = config.build(*config.parse(text, "x.yaml"))
    return experiment, compare(experiment, progress=False)


def test_a_metric_is_declared_once_and_is_everywhere(
    scratch: metrics.Metric,
    run_of_arm: tuple[config.Experiment, xr.Dataset],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from armgpi.cli.tables import print_tables
    from armgpi.viewing import report

    monkeypatch.setenv("COLUMNS", "300")
    experiment, run = run_of_arm
    values = scratch(run.isel(rollout=0)).values
    squares = (run["q"].values - run["q_ref"].values) ** 2 * run["time"].values[:, None]
    np.testing.assert_allclose(values, squares.reshape(-1, len(values)).mean(axis=0), rtol=1e-12)
    texts = [f"{value:.3g}" for value in values]
    assert min(values) > 1e-9
    # JSON.
    files = save(run, experiment, tmp_path)
    (record,) = json.loads(next(file for file in files if file.suffix == ".json").read_text())
    np.testing.assert_array_equal(record["metrics"]["scratch_metric"], values)
    # The terminal: among the errors, before the torques.
    print_tables(experiment, [record])
    out = capsys.readouterr().out
    header, units = out.splitlines()[2:4]
    assert header.index("final error") < header.index("scratch") < header.index("ISCI")
    assert units.count("rad² s ") == 1
    assert all(text in out for text in texts)
    # The report.
    html = report.build(run)
    assert "scratch<br>rad² s" in html
    assert all(f"<td>{text}</td>" in html for text in texts)
    # NetCDF.
    metrics.summary(run).drop_vars(["label", "measurement"]).to_netcdf(tmp_path / "metrics.nc")
    with xr.open_dataset(tmp_path / "metrics.nc") as table:
        assert table["scratch_metric"].attrs == {"long_name": "a scratch metric", "units": "rad^2 s"}
    # The documentation.
    table = runpy.run_path(str(ROOT / "docs" / "conf.py"))["metrics_table"]()
    assert "| scratch | `scratch_metric` | a mean that nobody needs | rad² s or m² s | " in table


def test_a_metric_is_in_the_tables_of_the_reproduction_and_of_the_zoo(
    scratch: metrics.Metric, run_of_arm: tuple[config.Experiment, xr.Dataset]
) -> None:
    from armgpi.health import zoo
    from armgpi.paper import published
    from armgpi.paper.reproduction import tables

    _, run = run_of_arm
    found = tables.contenders([("ideal", run.assign_coords(scale=("rollout", [1.0])))])
    sheet = tables.comparison(published.TABLES[0], "ideal", found, np.ones(3))
    place = sheet.header.index("a scratch metric [rad² s]")
    assert sheet.rows[-1][place] == f"{float(scratch(run).max()):.3g}"  # the worst joint
    row = zoo.Row("arm", 3, 0.5, False, 30.0, {m.name: (1.0, 2.0, 3.0) for m in metrics.shown_in("zoo")}, "")
    assert "| scratch [rad² s or m² s], D × 0.8 / 1 / 1.2 |" in zoo.markdown([row])
