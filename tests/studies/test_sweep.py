"""Sweeps: intervals that hold, chunks that are the same whoever runs them, and worst rollouts that run."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import socket
from contextlib import suppress
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.stats import binom, loguniform, norm, uniform

from armgpi.base import files
from armgpi.base.intervals import clopper_pearson, quantile, wilson
from armgpi.base.parameter import Parameter, parameters
from armgpi.cli import main
from armgpi.cli.sweep import _part, _percent
from armgpi.codegen import build
from armgpi.config import build as build_experiment
from armgpi.config import experiment as experiments
from armgpi.config import parse, read
from armgpi.errors import ArmgpiError, ConfigError, ParameterError, RolloutError
from armgpi.health import reality as health
from armgpi.loop import metrics
from armgpi.loop.rollout import Status
from armgpi.plants.reality import Reality
from armgpi.studies import distributions, page, rare, results, sample, workers
from armgpi.studies.distributions import Distribution, distribution, shares
from armgpi.studies.objective import Expression
from armgpi.studies.sample import Sweep
from armgpi.studies.study import IDENTITY
from armgpi.supervisor import Reason

TEXT = """
robot: {name: anthropomorphic3}
plant:
  payload: {mass: 0.1, com: [0.0, 0.0, 0.02]}
  encoder_bits: 14
  delay: 1
  drop_out: 0.05
  loads: [{type: step, amplitude: 0.5, onset: 0.1}]
controllers: [{type: gpi, omega: 20}]
reference: {points: [[0, 0.3, 0], [0.1, 0.4, -0.1]], durations: 0.15, holds: [0.02, 0.1]}
t_final: 0.25
vary:
  plant.payload.mass: {uniform: [0.0, 0.3]}
  plant.delay: {choices: [0, 1, 2]}
  controller.inertia_scale: {log_uniform: [0.8, 1.3]}
  plant.loads.0.amplitude: {normal: [0.0, 0.5], each: joint}
  plant.coulomb: {uniform: [0, 0.1], each: joint}
  reference.durations.0: {uniform: [0.1, 0.2]}
failure: {peak_error: 0.01}
"""


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample, "_MOST", 16)


def made(text: str = TEXT, sampling: str = "random") -> Sweep:
    return Sweep.of(*parse(text, "study.yaml"), sampling)


def run(folder: Path, count: int = 40, text: str = TEXT, **options: Any) -> xr.Dataset:
    found = made(text)
    found.enter(folder)
    chunks = [(i, found.rows(i, count)) for i in range(-(-count // found.size))]
    assert workers.run(folder, chunks, lambda rows: None, **options) == {}
    whole = results.collect(found, found.enter(folder), count)
    results.write(found, whole, results.summary(found, whole), folder)
    return whole


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files but for what a killed process had not written whole, which nobody reads."""
    found = [x for x in folder.rglob("*") if x.is_file() and not x.name.startswith(".")]
    return {str(x.relative_to(folder)): x.read_bytes() for x in found}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sample, "_MOST", 16)
        folder = tmp_path_factory.mktemp("sweep")
        run(folder)
    return folder


def test_a_sweep_that_was_stopped_goes_on_to_the_same_bytes(done: Path, tmp_path: Path) -> None:
    # As if it had been killed in its second chunk, of which a part was written.
    first = made()
    first.enter(tmp_path)
    sample.run_chunk(tmp_path, 2, 8)
    (tmp_path / sample.CHUNKS / ".000001-16.chunk.abc").write_bytes(b"half")
    run(tmp_path)
    (tmp_path / sample.CHUNKS / ".000001-16.chunk.abc").unlink()
    assert contents(tmp_path) == contents(done)


def test_the_worst_rollouts_run_as_they_did(done: Path) -> None:
    found = xr.open_dataset(done / "results.nc")
    for place, i in list(enumerate(results.worst(found), start=1))[:3]:
        experiment = build_experiment(*read(done / "worst" / f"{place:02d}.yaml"))
        again = experiments.run(experiment, "gpi", progress=False, backend="compiled")
        for name in ("peak_error", "itae", "total_variation"):
            values = getattr(metrics, name)(again).values
            np.testing.assert_allclose(values, found[name].values[i], rtol=1e-9, err_msg=name)


SUPERVISED = """
robot: {name: anthropomorphic3}
plant: {encoder_bits: 14, delay: 1, loads: [{type: step, amplitude: 0.1, onset: 0.1, end: 0.3}]}
controllers: [{type: gpi, omega: 20}]
reference: {points: [[0, 0.3, 0], [0.1, 0.4, -0.1]], durations: 0.15, holds: [0.02, 0.1]}
supervisor: {torque_rate: 2000}
t_final: 0.5
vary:
  plant.loads.0.amplitude: {uniform: [0.0, 0.5]}
  supervisor.following: {log_uniform: [0.02, 0.4]}
"""


def test_a_sweep_runs_under_the_supervisor_of_its_file(tmp_path: Path) -> None:
    under = made(SUPERVISED)
    under.enter(tmp_path)
    sample.run_chunk(tmp_path, 0, 16)
    found = results.collect(under, under.enter(tmp_path), 16)
    results.write(under, found, results.summary(under, found), tmp_path)
    faults = found["fault"].values
    assert 0 < (faults > 0).sum() < 16
    for place, i in list(enumerate(results.worst(found), start=1)):
        again = experiments.run(build_experiment(*read(tmp_path / "worst" / f"{place:02d}.yaml")), "gpi")
        for name in ("fault", "fault_joint", "status"):
            assert int(again[name]) == int(found[name].values[i]), (place, name)
        if again["status"] != Status.DIVERGED:
            np.testing.assert_equal(float(again["t_fault"]), found["t_fault"].values[i])
    # Who was stopped has failed, also where no metric says so.
    assert (found["failed"].values >= (faults > 0)).all()
    said = results.summary(under, found)
    assert (
        sum(said["stops by reason"].values())
        == (faults > 0).sum()
        == said["probability of a stop"]["value"] * 16
    )
    assert any(line.startswith("stopped by the supervisor: ") for line in results.sentences(said))
    assert under.identity.digest != made(SUPERVISED.replace("2000", "1000")).identity.digest


@pytest.mark.parametrize(
    ("name", "values"), [("tool_speed", [0.05, 0.15, 40.0]), ("tool_force", [0.5, 5.0, 500.0])]
)
def test_a_limit_of_the_tool_may_vary(name: str, values: list[float], tmp_path: Path) -> None:
    """Each limit decides the form of the code, so its rollouts are stopped as those of a run with it."""
    text = SUPERVISED.replace("{torque_rate: 2000}", f"{{{name}: 30, following: 50, response: 0}}")
    text = text.split("vary:")[0]
    if name == "tool_force":  # a hand that friction, which the model has none of, cannot explain
        text = text.replace("amplitude: 0.1", "amplitude: 5.0")
    under = made(text + f"vary:\n  supervisor.{name}: {{choices: {values}}}\n")
    under.enter(tmp_path)
    sample.run_chunk(tmp_path, 0, 8)
    found = results.collect(under, under.enter(tmp_path), 8)
    results.write(under, found, results.summary(under, found), tmp_path)
    stopped = set()
    for place, i in list(enumerate(results.worst(found), start=1)):
        built = build_experiment(*read(tmp_path / "worst" / f"{place:02d}.yaml"))
        again = experiments.run(built, "gpi")
        assert built.supervisor is not None
        assert getattr(built.supervisor, name) in values
        assert int(again["fault"]) == int(found["fault"].values[i])
        np.testing.assert_equal(float(again["t_fault"]), found["t_fault"].values[i])
        stopped.add(int(again["fault"]))
    assert int(Reason[name.upper()]) in stopped
    assert len(set(found["fault"].values.tolist())) > 1


def test_what_a_sweep_says_is_in_its_files(done: Path) -> None:
    found, said = xr.open_dataset(done / "results.nc"), json.loads((done / "summary.json").read_text())
    assert said["rollouts"] == found.sizes["rollout"] == 40
    assert said["probability of failure"]["value"] == float(found["failed"].mean())
    peak = found["peak_error"].values.max(axis=1)
    np.testing.assert_array_equal(found["failed"].values, peak > 0.01)
    middle = said["quantiles"]["peak_error"]["0.5"]
    assert middle["lower"] <= np.median(peak) <= middle["upper"]
    parts = said["failure by quantity"]["plant.delay"]
    assert [part["from"] for part in parts] == [0.0, 1.0, 2.0]
    assert sum(part["rollouts"] for part in parts) == 40
    assert found["rollout"].values.tolist() == [*range(40)]
    assert all((done / name).read_text().endswith("}\n") for name in ("summary.json", IDENTITY))


#: Of a cluster of Dask that is not the only one on its machine.
ALONE: Any = {"dashboard_address": None, "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"}}


@pytest.mark.slow
def test_workers_of_dask_write_the_same_bytes(
    done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # as the workers do
    made().enter(tmp_path)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, protocol="tcp", **ALONE
    ) as local:
        chunks = [(0, 16), (1, 16), (2, 8)]
        broken = workers.run(tmp_path, chunks, lambda rows: None, cluster=local.scheduler_address)
    assert broken == {}
    for place in (done / sample.CHUNKS).iterdir():
        assert (tmp_path / sample.CHUNKS / place.name).read_bytes() == place.read_bytes()


@pytest.mark.slow
def test_workers_start_where_another_cluster_has_the_port_of_dask(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with socket.socket() as taken:
        with suppress(OSError):  # by another test, or a user
            taken.bind(("", 8787))
            taken.listen()
        assert workers.run(tmp_path, [], lambda rows: None, workers=2) == {}


@pytest.mark.slow
def test_a_worker_of_dask_that_is_killed_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr(sample, "_MOST", 4096)  # as in the worker, which is another process
    for name in ("here", "there", "broken"):
        made().enter(tmp_path / name)
    (tmp_path / "broken" / IDENTITY).unlink()
    options: Any = {"threads_per_worker": 1, "silence_logs": 50, **ALONE}
    with distributed.LocalCluster(n_workers=1, **options) as local:
        with distributed.Client(local) as client:
            (number,) = client.run(os.getpid).values()
        chunks = [(0, 16), (1, 16), (2, 8)]
        assert workers.run(tmp_path / "here", chunks, lambda rows: None) == {}
        counted: list[int] = []

        def killing(rows: int) -> None:
            counted.append(rows)
            if len(counted) == 1:
                os.kill(number, signal.SIGKILL)

        address = local.scheduler_address
        assert workers.run(tmp_path / "there", chunks, killing, cluster=address) == {}
        assert sorted(counted) == [8, 16, 16]
        broken = workers.run(tmp_path / "broken", [(0, 16)], lambda rows: None, cluster=address)
        assert "holds no study" in broken[0]
    assert contents(tmp_path / "here") == contents(tmp_path / "there")


# Rare failures.


def tail(beta: float) -> rare.Margin:
    """Return how near points come to a sum of standard normal numbers that is beta standard deviations."""
    return lambda points, seeds: points.sum(axis=1) / math.sqrt(points.shape[1]) / beta


def climbed(margin: rare.Margin, dimensions: int, count: int, seed: int) -> rare.Rare:
    random = np.random.default_rng(seed)
    return rare.estimate(rare.climb(margin, dimensions, count, lambda place, level: level(random)))


def test_where_margins_tie_a_level_begins_with_all_of_them_alike() -> None:
    # Whole steps: the tenth of a level that is nearest is not the tenth that argsort gives.
    true = 0.5 * math.erfc(3.5 / math.sqrt(2.0))
    found = [
        climbed(lambda points, seeds: np.floor(2.0 * points[:, 0]) / 6.9, 2, 500, seed) for seed in range(40)
    ]
    mean = np.mean([each.probability.value for each in found])
    assert abs(mean / true - 1.0) < 3.0 * np.mean([each.deviation for each in found]) / math.sqrt(40)
    held = sum(each.probability.lower <= true <= each.probability.upper for each in found)
    assert held >= 36  # 95 % of 40, less a standard deviation and a half


def test_a_level_that_cannot_rise_is_the_last() -> None:
    random = np.random.default_rng(0)
    levels = rare.climb(lambda x, seeds: 0.25 * np.sign(x[:, 0]), 1, 500, lambda place, level: level(random))
    assert len(levels) == 2
    assert rare.bounds_of(levels)[-1] == (0.25, 1.0)


@pytest.mark.parametrize(("beta", "dimensions"), [(3.0, 2), (4.7534243088, 10)])
def test_subset_simulation_finds_the_tail_of_a_gaussian(beta: float, dimensions: int) -> None:
    true, runs = 0.5 * math.erfc(beta / math.sqrt(2.0)), 40
    found = [climbed(tail(beta), dimensions, 500, seed) for seed in range(runs)]
    held = sum(each.probability.lower <= true <= each.probability.upper for each in found)
    assert held >= runs - 4  # 95 % of 40, less a standard deviation and a half
    # The mean of all is off by a sixth of one run's standard deviation.
    mean = np.mean([each.probability.value for each in found])
    assert abs(mean / true - 1.0) < 3.0 * np.mean([each.deviation for each in found]) / math.sqrt(runs)
    # A thousandth in 3 levels or 4, a millionth in 6 or 7.
    assert all(each.points == 500 * len(each.bounds) for each in found)
    assert {len(each.bounds) for each in found} <= ({3, 4} if beta == 3.0 else {6, 7})


RARE = TEXT.replace("peak_error: 0.01}", "peak_error: 0.4}")


def test_rare_failures_are_as_probable_as_random_rollouts_say(tmp_path: Path) -> None:
    found = made(RARE)
    found.enter(tmp_path)
    once, last, check = rare.simulate(found, found.enter(tmp_path), 300)
    drawn = np.vstack([found.numbers(i, 16) for i in range(128)])
    failed = found.fails(found.table(drawn, np.arange(len(drawn))))
    plain = clopper_pearson(int(failed.sum()), len(failed))
    assert max(plain.lower, once.probability.lower) < min(plain.upper, once.probability.upper)
    assert 1e-3 < plain.value < 0.1
    # Killed after a level, it ends with the same; the worst run as they did.
    for level in (tmp_path / "rare").iterdir():
        if level.name != "300-00.chunk":
            level.unlink()
    again, same, _ = rare.simulate(found, found.enter(tmp_path), 300)
    assert again == once
    np.testing.assert_array_equal(same, last)
    said = rare.summary(found, once, last, check)["plain check"]
    assert said["lower"] <= said["by the levels"] <= said["upper"]
    worst = rare.worst(found, last)[0]
    run = experiments.run(build_experiment(worst), "gpi", progress=False, backend="compiled")
    assert float(metrics.peak_error(run).max()) / 0.4 == pytest.approx(last[:, -1].max(), rel=1e-9)


@pytest.mark.parametrize(
    ("text", "count", "said"),
    [
        ("robot: {name: anthropomorphic3}\nreality: {name: geared}\n", 300, "have none between them"),
        (RARE.replace("0.4}", "0.0}"), 300, "above 0"),
        (RARE, 50, "at least 100"),
        (RARE.replace("peak_error: 0.4}", "saturated_time: 0.5}"), 100, "do not rise"),
    ],
)
def test_rare_failures_that_cannot_be_found_are_named(
    tmp_path: Path, text: str, count: int, said: str
) -> None:
    found = made(text)
    found.enter(tmp_path)
    with pytest.raises(ArmgpiError, match=said):
        rare.simulate(found, found.enter(tmp_path), count)


def test_the_command_of_rare_failures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = tmp_path / "study.yaml", tmp_path / "out"
    file.write_text(RARE)
    assert not called("sweep", str(file), "--rare", "--rollouts", "200", "--out", str(out))
    said = json.loads((out / "rare.json").read_text())
    assert f"{said['probability of failure']['value']:.3g}" in capsys.readouterr().out
    assert set(said["failures are at"]) == set(made(RARE).drawn_names)
    assert len(list((out / "rare" / "worst").iterdir())) == 10
    assert called("sweep", str(file), "--rare", "--workers", "2", "--out", str(out)) == 2
    assert "--workers" in capsys.readouterr().err


def test_the_coverage_that_is_told_is_the_least_that_was_measured() -> None:
    page = (Path(__file__).parents[2] / "docs" / "sweep.md").read_text()
    table = dict(re.findall(r"^\| ([^|]+) \|(?:[^|]+\|){2} ([\d.]+) % \| \d+ \|$", page, re.M))
    assert len(table) == 12
    assert float(table.pop("behind a flat margin")) == pytest.approx(100 * rare.HELD_UNSEEN)
    assert min(map(float, table.values())) == pytest.approx(100 * rare.HELD)


def test_maps_by_two_numbers_count_every_rollout_once() -> None:
    random = np.random.default_rng(0)
    a, b = random.uniform(size=(2, 4000))
    failed = (a > 0.5) & (b > 0.75)
    found = xr.Dataset({f"drawn.{k}": ("rollout", x) for k, x in (("a", a), ("b", b), ("c", np.round(b)))})
    found = found.assign(failed=("rollout", failed))
    parts = results.failure_map(found, ["a", "b"])
    assert sum(part["rollouts"] for part in parts) == 4000
    for part in parts:
        inside = [low >= bound for low, bound in zip(part["from"], (0.49, 0.74), strict=True)]
        assert all(inside) == (part["value"] > 0.9)
    assert [part["from"][1] for part in results.failure_map(found, ["a", "c"])[:2]] == [0.0, 1.0]


def test_the_parts_of_a_map_follow_one_another_from_the_least_to_the_largest() -> None:
    drawn, chosen = np.random.default_rng(0).uniform(size=800), np.arange(800) % 3.0
    found = xr.Dataset({"drawn.a": ("rollout", drawn), "drawn.b": ("rollout", chosen)})
    found = found.assign(failed=("rollout", drawn > 0.9))
    parts = results.failure_map(found, ["a"])
    assert [part["to"] for part in parts[:-1]] == [part["from"] for part in parts[1:]]
    assert (parts[0]["from"], parts[-1]["to"], len(parts)) == (drawn.min(), drawn.max(), 8)
    for few, named in ((80, ["a"]), (79, [])):  # a map by two numbers has 20 rollouts in each of four parts
        failed = np.arange(few) < 40
        assert (
            results._strongest({"a": results.failure_map(found.isel(rollout=slice(few)), ["a"])}, failed)
            == named
        )
    assert [part["to"] for part in results.failure_map(found, ["b"])] == [0.0, 1.0, 2.0]
    found["drawn.b"] = ("rollout", np.where(chosen > 0.0, np.arange(800) % 8.0, 0.0))  # most of them 0
    assert [part["to"] for part in results.failure_map(found, ["b"])] == [*np.arange(8.0)]


def test_the_plain_check_counts_the_points_at_the_bound_as_the_levels_do() -> None:
    levels = [np.column_stack([np.zeros((100, 2)), np.repeat([0.5, 0.25, 0.0], (5, 15, 80))])]
    levels += [np.column_stack([np.zeros((100, 2)), np.repeat([1.5, 0.5], (20, 80))])]
    found = rare.estimate(levels)
    assert (found.bounds, found.shares) == ([0.25, 1.0], [0.2, 0.2])
    own = SimpleNamespace(digest="")
    stub: Any = SimpleNamespace(
        identity=own, label="", failure={}, drawn_names=[], drawn_at=lambda u: u[:, :0]
    )
    check = np.column_stack([np.zeros((100, 2)), np.repeat([2.0, np.nextafter(1.0, 0.0), 0.0], (3, 7, 90))])
    whole = rare.summary(stub, found, levels[-1], check)
    assert whole["unseen is more probable than"] == 3.0 / 200.0  # one in so many is seen with 95 %
    said = whole["plain check"]
    assert (said["value"], said["by the levels"]) == (0.03, pytest.approx(0.04))
    one = rare.summary(stub, found._replace(bounds=[0.25], shares=[0.2]), levels[-1], levels[0])
    assert one["plain check"]["value"] == one["plain check"]["by the levels"] == 0.2


def test_a_chunk_is_a_function_of_study_and_number() -> None:
    found = made()
    np.testing.assert_array_equal(found.numbers(3, 16), found.numbers(3, 16))
    np.testing.assert_array_equal(found.numbers(3, 5), found.numbers(3, 16)[:5])
    assert not np.array_equal(found.numbers(3, 16), found.numbers(4, 16))
    own = found.identity.digest
    assert made(TEXT.replace("0.05", "0.06")).identity.digest != own == made().identity.digest


@pytest.mark.parametrize("sampling", ["random", "sobol"])
def test_points_fill_the_unit_cube(sampling: str) -> None:
    points = np.vstack([shares(sampling, 12345, 256 * i, 256, ("a", "b", "c")) for i in range(8)])
    assert ((points > 0.0) & (points < 1.0)).all()
    # The standard deviation of a mean of 2048 uniform numbers is 0.0064.
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.03)
    if sampling == "sobol":  # 2048 points, 2048 intervals, one in each
        for column in points.T:
            assert len(np.unique((column * 2048).astype(int))) == 2048


def test_more_numbers_than_sobol_has_dimensions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distributions, "_MOST_DIMENSIONS", 3)
    assert shares("sobol", 1, 0, 4, ("a", "b", "c")).shape == (4, 3)
    with pytest.raises(ParameterError, match="have 3 dimensions"):
        shares("sobol", 1, 0, 4, ("a", "b", "c", "d"))


def test_distributions_have_their_quantiles_up_to_their_ends() -> None:
    u = np.array([[2.0**-53, 0.2, 0.4], [0.7, 0.9, 1.0 - 2.0**-53]])
    twins = {
        ("uniform", (-1.0, 3.0)): (uniform(-1.0, 4.0).ppf(u), (-1.0, 3.0)),
        ("log_uniform", (0.2, 5.0)): (loguniform(0.2, 5.0).ppf(u), (0.2, 5.0)),
        ("normal", (5.0, 2.0)): (np.clip(norm(5.0, 2.0).ppf(u), -3.0, 13.0), (-3.0, 13.0)),
        ("choices", (2.0, 6.0, 1.0)): (np.array([[2.0, 2.0, 6.0], [1.0, 1.0, 1.0]]), (1.0, 6.0)),
        ("choices", (2.0,)): (np.full((2, 3), 2.0), (2.0, 2.0)),
    }
    for (kind, numbers), (values, ends) in twins.items():
        np.testing.assert_allclose(Distribution(kind, numbers).of(u), values, rtol=1e-12)
        assert Distribution(kind, numbers).ends == ends
    assert Distribution("choices", (2.0, 6.0, 1.0)).of(np.array([1.0])) == 1.0


def test_intervals_hold_at_both_ends() -> None:
    # With k = 0 the upper end solves (1 - p)^n = 0.025.
    assert clopper_pearson(0, 100) == pytest.approx((0.0, 0.0, 1.0 - 0.025**0.01))
    assert clopper_pearson(100, 100) == pytest.approx((1.0, 0.025**0.01, 1.0))
    assert wilson(0, 10).lower == 0.0
    # Agresti and Coull (1998): 95 % Wilson of 5 in 10 is 0.2366 to 0.7634.
    np.testing.assert_allclose(wilson(5, 10)[1:], (0.2366, 0.7634), atol=1e-4)
    random = np.random.default_rng(0)
    held = exact = 0
    for _ in range(400):
        estimate = quantile(random.normal(size=200), 0.9)
        held += estimate.lower <= 1.2815515655 <= estimate.upper
        found = clopper_pearson(int(random.binomial(50, 0.1)), 50)
        exact += found.lower <= 0.1 <= found.upper
    # 0.95 less three standard deviations of 400 trials.
    assert min(held, exact) >= 400 * 0.917


def test_quantiles_are_between_order_statistics_and_open_where_there_is_none() -> None:
    values = np.random.default_rng(1).permutation(np.arange(1.0, 101.0))
    # Of 100 values the 40th and the 61st hold the median with 95 % (Conover 1999, section 3.2).
    assert quantile(values, 0.5) == (50.0, 40.0, 61.0)
    # No value is above the 99 % quantile with a probability of 0.37.
    assert quantile(values, 0.99)[1:] == (97.0, math.inf)
    assert quantile(values, 0.01)[1:] == (-math.inf, 4.0)
    for n, share in product((1, 2, 5, 6, 20, 50, 200), (0.01, 0.5, 0.9)):
        middle, low, high = quantile(np.arange(1.0, n + 1.0), share)
        assert middle == min(k for k in range(1, n + 1) if k >= round(share * n, 9))
        # Whoever is below the quantile is binomial: no tail has more than 2.5 %, and a narrower one would.
        above = binom.cdf(np.arange(-1, n + 1), n, share)
        if math.isfinite(low):
            assert above[int(low)] <= 0.025
        assert above[max(0, int(max(low, 0.0))) + 1] > 0.025
        if math.isfinite(high):
            assert 1.0 - above[int(high)] <= 0.025
        assert 1.0 - above[int(min(high, n + 1.0)) - 1] > 0.025


@pytest.mark.parametrize(("k", "n", "level"), [(3, 17, 0.95), (1, 5, 0.8), (40, 41, 0.99)])
def test_an_interval_ends_where_a_tail_is_as_probable_as_its_level_leaves(
    k: int, n: int, level: float
) -> None:
    tail, (share, low, high) = 0.5 * (1.0 - level), clopper_pearson(k, n, level)
    np.testing.assert_allclose([binom.sf(k - 1, n, low), binom.cdf(k, n, high), share], [tail, tail, k / n])
    share, *ends = wilson(k, n, level)
    assert ends[0] < share < ends[1]
    np.testing.assert_allclose([norm.sf(abs(share - p) / math.sqrt(p * (1.0 - p) / n)) for p in ends], tail)
    assert all(wilson(m, m, level).upper == 1.0 for m in range(1, 40))


BAD: dict[str, tuple[str, str]] = {
    "beyond a bound": ("plant.payload.mass: {uniform: [-0.1, 0.3]}", "vary.plant.payload.mass"),
    "tails beyond a bound": ("plant.payload.mass: {normal: [0.1, 0.1]}", "4 standard deviations"),
    "no parameter": ("plant.paylod: {uniform: [0, 0.3]}", "plant.payload.mass"),
    "fixed": ("plant.stick_velocity: {choices: [1, 2]}", "form of the generated code"),
    "three numbers": ("plant.gravity: {uniform: [0, 1]}", "vary one, as in plant.payload.com.0"),
    "two kinds": ("plant.payload.mass: {uniform: [0, 1], choices: [0, 1]}", "one of uniform"),
    "no kind": ("robot.effort: {each: joint}", "a distribution, such as"),
    "upside down": ("plant.payload.mass: {uniform: [1, 0]}", "lowest, highest"),
    "logarithm of zero": ("plant.payload.mass: {log_uniform: [0, 1]}", "positive"),
    "no deviation": ("plant.payload.mass: {normal: [0.1, 0]}", "the second positive"),
    "no whole numbers": ("plant.delay: {normal: [2, 0.1]}", "choices"),
    "halves": ("plant.delay: {choices: [0.5]}", "whole"),
    "one for each joint": ("plant.payload.mass: {uniform: [0, 1], each: joint}", "each rollout"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_distributions_are_refused_by_name(case: str) -> None:
    line, said = BAD[case]
    text = TEXT[: TEXT.index("vary:")] + f"vary:\n  {line}\n"
    with pytest.raises(ConfigError, match=said) as refused:
        made(text)
    assert refused.value.line == len(text.splitlines())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TEXT.replace("peak_error: 0.01", "peek_error: 0.01"), "peak_error"),
        (TEXT[: TEXT.index("vary:")], "vary"),
        (TEXT.replace("plant:", "plant:\n  engine: mujoco"), "plant.engine: a sweep runs generated code"),
        (
            SUPERVISED.replace("r.following:", "r.on_fault:"),
            "supervisor.on_fault: .* form of the generated code",
        ),
        (SUPERVISED.replace("[0.02, 0.4]", "[0, 0.4]"), "vary.supervisor.following"),
        ("robot: {name: anthropomorphic3}\nreality: {}\nsample_time: 0.004\n", "sample_time: left out"),
        ("robot: {name: anthropomorphic3}\nreality: {}\nt_final: 1.0\n", "t_final: left out"),
    ],
)
def test_bad_studies_are_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        made(text)


def test_a_metric_of_whole_rollouts_bounds_no_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(metrics.ALL, "peak_error", replace(metrics.ALL["peak_error"], of_rollout=True))
    for failing in (lambda: made(TEXT), lambda: Expression("peak_error")):
        with pytest.raises(ArmgpiError, match=r"'peak_error'.*it needs whole rollouts, which sweeps"):
            failing()


def test_a_folder_of_another_study_is_refused(done: Path) -> None:
    with pytest.raises(RolloutError, match="another study"):
        made(TEXT.replace("0.05", "0.07")).enter(done)
    for name in (sample.EXPERIMENT, "study.yaml"):  # of a run, of a search
        (done / "other").mkdir(exist_ok=True)
        (done / "other" / name).write_text("robot: {name: ur5}")
        with pytest.raises(RolloutError, match="something else"):
            made().enter(done / "other")
        (done / "other" / name).unlink()
    damaged = done / sample.CHUNKS / "000000-16.chunk"
    before = damaged.read_bytes()
    damaged.write_bytes(b"x")
    with pytest.raises(RolloutError, match=r"000000-16.chunk: is damaged"):
        results.collect(made(), made().enter(done), 40)
    damaged.write_bytes(before)


def test_a_broken_chunk_is_named_and_not_fatal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = made()
    found.enter(tmp_path)
    monkeypatch.setattr(build, "library", lambda *_: (_ for _ in ()).throw(ArmgpiError("no disk")))
    monkeypatch.setattr(build, "find_library", lambda *_: None)
    monkeypatch.setattr("armgpi.codegen.run._generated", {})
    counted: list[int] = []
    broken = workers.run(tmp_path, [(0, 16)], counted.append)
    assert list(broken) == [0]
    assert "no disk" in broken[0]
    assert counted == []


def test_a_disk_that_fills_up_ends_the_sweep_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "study.yaml", tmp_path / "out"
    file.write_text(TEXT)
    write = files.write

    def full(path: Path, content: Any) -> Path:
        if path.name.startswith("000001"):
            raise RolloutError(f"{path}: cannot be written: No space left on device")
        return write(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(files, "write", full)
        assert called("sweep", str(file), "--rollouts", "40", "--out", str(out)) == 2
    said = capsys.readouterr().err
    (line,) = [line for line in said.splitlines() if not line.startswith("world:")]
    assert line.startswith("error: ")
    assert "000001-16.chunk: cannot be written: No space left" in said
    assert [path.name for path in (out / sample.CHUNKS).iterdir()] == ["000000-16.chunk"]
    assert not called("sweep", str(file), "--rollouts", "40", "--out", str(out))


def test_a_cluster_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "_PATIENCE", 0.5)
    with pytest.raises(ArmgpiError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:1"):
        workers.run(tmp_path, [(0, 16)], lambda rows: None, cluster="tcp://127.0.0.1:1")


def called(*arguments: str) -> Any:
    """Return the exit code of a command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["armgpi", *arguments])
        try:
            main()
        except SystemExit as end:
            return end.code
    return 0


def test_the_command(done: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "study.yaml"
    file.write_text(TEXT)
    page = tmp_path / "page.html"
    assert not called("sweep", str(file), "--rollouts", "40", "--out", str(done), "--report", str(page))
    said = capsys.readouterr().out
    assert "of 40 rollouts" in said
    assert "95 % Clopper-Pearson" in said
    text = page.read_text(encoding="utf-8")
    # Nothing touches the arm, and no rollout leaves its limits: these are in a line of their own.
    (alike,) = re.findall(r"The same in all rollouts: ([^<]*)\.</p>", text)
    assert "peak force [N]: 0; final force [N]: 0" in alike
    differ = len(made().metrics) - len(alike.split("; "))
    assert text.count("<figure>") == differ + len(made().drawn_names)
    for wrong in ("0", "many", "1.5"):
        assert called("sweep", str(file), "--rollouts", wrong, "--out", str(done)) == 2
        assert "--rollouts" in capsys.readouterr().err
    assert called("sweep", str(tmp_path / "none.yaml"), "--out", str(tmp_path / "x")) == 2


def test_a_sweep_of_a_reality_draws_by_index() -> None:
    text = "robot: {name: anthropomorphic3}\nreality: {name: geared, seed: 3}\n"
    found = made(text + "controllers: [{type: gpi, rolloff: 1}]\n")
    assert found.columns[:2] == ["sample_time", "delay"]
    config = found.config_of({}, 5)
    assert config.reality is not None
    assert config.reality.index == 5
    # A row of a chunk is the draw of its index, as it runs alone.
    object.__setattr__(found, "size", 4)
    table = dict(zip(found.columns, found.run(1, 3).T, strict=True))
    reality = Reality(**{name: getattr(config.reality, name) for name in parameters(Reality)})
    for row in range(3):
        draw = reality.draw(found.robot, 4 + row)
        told = (table["payload"][row], table["inertia_scale"][row])
        assert told == (draw.numbers.payload, draw.numbers.inertia_scale)
        (alone,) = health.outcomes([draw], "arm", {"type": "gpi", "rolloff": 1})
        peak = max(table[f"peak_error[{joint}]"][row] for joint in found.robot.joint_names)
        assert peak == pytest.approx(alone.peak, rel=1e-6)


def test_chains_that_never_move_count_as_one_point_each() -> None:
    random = np.random.default_rng(0)
    first = np.column_stack([random.standard_normal((100, 2)), np.linspace(0.0, 0.9, 100)])
    chains = np.column_stack([random.standard_normal((10, 2)), np.where(np.arange(10) < 4, 1.1, 0.95)])
    found = rare.estimate([first, np.tile(chains, (10, 1))])
    assert found.shares == [0.1, 0.4]
    assert found.accepted == [0.0]
    tied = rare.estimate([first, np.tile(np.where(chains == 1.1, 0.95, chains), (10, 1))])
    assert (tied.bounds[1], tied.shares[1]) == (0.95, 1.0)
    assert tied.deviation == pytest.approx(np.sqrt(0.9 / (0.1 * 100)))  # all reach the second bound
    assert found.deviation == pytest.approx(np.sqrt(0.9 / (0.1 * 100)) + np.sqrt(0.6 / (0.4 * 10)))


def test_levels_and_their_estimate_are_those_that_are_worked_out_point_by_point() -> None:
    def margin(points: Any, seeds: Any) -> Any:
        return (points[:, 0] + 0.3 * points[:, 1]) / 3.5 + 0.02 * (np.asarray(seeds) % 7)

    levels = rare.climb(margin, 2, 200, lambda place, level: level(np.random.default_rng(place + 5)))
    assert len(levels) > 2
    bounds, before = [], -math.inf
    for number, level in enumerate(levels):
        ordered = sorted(level[:, -1], reverse=True)
        bound = 1.0 if ordered[19] > 1.0 else 0.5 * (ordered[19] + ordered[20])
        assert bound > before  # of a margin without ties
        bounds.append((bound, sum(x > 1.0 if bound == 1.0 else x >= bound for x in ordered) / 200))
        before = bound
        if number + 1 == len(levels):
            break
        random, step = np.random.default_rng(number + 6), 0.6
        now = level[random.choice([i for i in range(200) if level[i, -1] >= bound], 20, replace=False)].copy()
        spread, rows = [max(1e-6, now[:, j].std()) for j in range(2)], [now.copy()]
        for move in range(1, 10):
            size = np.minimum(1.0, step * np.array(spread))
            moved = np.array(
                [
                    np.sqrt(1.0 - size**2) * x[:2] + size * y
                    for x, y in zip(now, random.standard_normal((20, 2)), strict=True)
                ]
            )
            seeds = random.integers(2**31, size=20)
            accepted = 0
            for i, near in enumerate(margin(moved, seeds)):
                if near >= bound:
                    now[i], accepted = [*moved[i], seeds[i], near], accepted + 1
            step *= math.exp((accepted / 20 - 0.44) / math.sqrt(move))
            rows.append(now.copy())
        np.testing.assert_allclose(levels[number + 1], np.vstack(rows), rtol=1e-12)
    deviation = 0.0
    for place, (level, (bound, share)) in enumerate(zip(levels, bounds, strict=True)):
        hits = (level[:, -1] > 1.0 if bound == 1.0 else level[:, -1] >= bound).reshape(10, 20)
        related = 0.0
        for lag in range(1, 10) if place else ():
            pairs = [hits[k, i] * hits[k + lag, i] for k in range(10 - lag) for i in range(20)]
            related += 2.0 * (1.0 - lag / 10.0) * (np.mean(pairs) - share**2) / (share * (1.0 - share))
        deviation += math.sqrt((1.0 - share) / (share * 200) * (1.0 + max(0.0, related)))
    found = rare.estimate(levels)
    p = math.prod(share for _, share in bounds)
    factor = math.exp(1.959963985 * math.sqrt(math.log(1.0 + deviation**2)))
    np.testing.assert_allclose([found.bounds, found.shares], np.transpose(bounds))
    np.testing.assert_allclose([found.deviation, *found.probability], [deviation, p, p / factor, p * factor])
    assert found.points == 200 * len(levels)
    changed = [np.diff(level[:, :2].reshape(10, 20, 2), axis=0).any(axis=-1).mean() for level in levels[1:]]
    assert found.accepted == pytest.approx(changed)
    assert rare._correlation(np.ones((10, 4)), 1.0) == 0.0  # of a level that all of which reach its bound


def test_chains_that_stay_count_as_one_point_each_and_those_that_leap_as_all() -> None:
    """The variance of a mean of L equal points is L times that of L independent ones, which adds L - 1."""
    staying = np.repeat([[1.0, 0.0, 0.0, 1.0]], 12, axis=0)
    assert rare._correlation(staying, 0.5) == pytest.approx(11.0)
    leaping = (np.random.default_rng(0).random((40, 5000)) < 0.3).astype(float)
    assert rare._correlation(leaping, 0.3) < 0.1
    # Any chains, lag by lag and point by point.
    chains = (np.random.default_rng(1).random((6, 7)) < 0.6).astype(float).cumsum(axis=0) % 2
    share, total = 0.4, 0.0
    for lag in range(1, 6):
        pairs = [chains[k, j] * chains[k + lag, j] for k in range(6 - lag) for j in range(7)]
        total += 2.0 * (1.0 - lag / 6) * (sum(pairs) / len(pairs) - share**2) / (share * (1.0 - share))
    assert rare._correlation(chains, share) == pytest.approx(max(0.0, total))


def test_whole_numbers_are_drawn_from_all_between_the_ends_alike() -> None:
    nothing = dict.fromkeys(("log_uniform", "normal", "choices", "factor", "each"))
    declared = Parameter("samples", kind="integer", least=0, most=2000)
    for low, high, whole in ((2.0, 5.0, (2, 3, 4, 5)), (2.2, 5.7, (3, 4, 5)), (4.0, 4.0, (4,))):
        found = distribution("plant.delay", SimpleNamespace(uniform=[low, high], **nothing), declared, 3)
        assert found[:3] == ("choices", whole, 1)
    with pytest.raises(ParameterError, match="a range of at most 1000"):
        distribution("plant.delay", SimpleNamespace(uniform=[0, 1001], **nothing), declared, 3)
    wide = distribution("plant.delay", SimpleNamespace(uniform=[0, 1000], **nothing), declared, 3)
    assert wide.numbers == tuple(range(1001))
    assert distribution(
        "plant.delay", SimpleNamespace(uniform=[1990, 1993], **nothing), declared, 3
    ).numbers == (1990, 1991, 1992, 1993)
    unsaid = SimpleNamespace(uniform=None, **nothing)
    factors = Parameter("stiffness", least=0.0, log=True, search=(2.0, 8.0))
    from_zero = Parameter("stiffness", least=0.0, log=True, search=(0.0, 8.0))
    assert distribution("plant.x", unsaid, from_zero, 3)[:3] == ("uniform", (0.0, 8.0), 1)
    for kind in ("uniform", "log_uniform"):  # a number that stays what it is
        one = SimpleNamespace(**{**nothing, "uniform": None, kind: [2.0, 2.0]})
        assert distribution("plant.x", one, factors, 3)[:3] == (kind, (2.0, 2.0), 1)
    assert distribution("plant.x", unsaid, factors, 3)[:3] == ("log_uniform", (2.0, 8.0), 1)
    plain = Parameter("x", search=(2.0, 8.0))
    assert distribution("plant.x", unsaid, plain, 3)[:3] == ("uniform", (2.0, 8.0), 1)


def test_a_level_rises_where_a_tenth_of_a_tenth_is_above_the_bound_before() -> None:
    margins = np.full(100, 0.5)
    margins[7] = 0.6
    level = np.column_stack([np.zeros((100, 2)), margins])
    assert rare._level_bound(level, 0.5) == (0.6, 0.01)
    for failed, before, wanted in ((10, -1.0, (1.0, 0.1)), (9, -1.0, (0.5, 1.0)), (9, 0.5, (1.0, 0.09))):
        few = np.column_stack([np.zeros((100, 2)), np.where(np.arange(100) < failed, 1.2, 0.5)])
        assert rare._level_bound(few, before) == wanted
    assert rare._level_bound(level, 0.6) == (0.6, 1.0)


def test_bars_of_a_picture_stand_on_one_line() -> None:
    svg = page._bars(np.array([0.25, 1.0]), ["a", "b", "c"], "red", [(0.1, 0.5), (0.8, 1.0)])
    bars = re.findall(r'rect x="([\d.]+)" y="([\d.]+)" width="([\d.]+)" height="([\d.]+)"', svg)
    assert [(float(x), float(y) + float(high)) for x, y, _, high in bars] == [(0.0, 92.0), (150.0, 92.0)]
    assert [(float(wide), float(high)) for *_, wide, high in bars] == [(149.0, 23.0), (149.0, 92.0)]
    # Intervals: in the middle of their bars, the lower end below the upper one.
    assert 'points="75.0,82.8 75.0,46.0"' in svg
    assert 'points="225.0,18.4 225.0,0.0"' in svg


def test_a_histogram_tells_how_many_it_leaves_out() -> None:
    svg = page._histogram(np.array([1.0, 1.0, 2.0, 1.0, np.inf]))
    assert "bars up to 3 of 5; 1 not finite" in svg
    assert [float(x) for x in re.findall(r">([\d.]+)</text>", svg)] == [1.0, 2.0]
    assert "not finite" not in page._histogram(np.array([1.0, 2.0]))
    for values, log in (([2.0, 200.0], False), ([2.0, 201.0], True), ([0.0, 9.0], False)):
        assert ("log scale" in page._histogram(np.array(values))) == log
        assert f">{values[0]:g}</text>" in page._histogram(np.array(values))


@pytest.mark.parametrize("values", [[1.0, np.nextafter(1.0, 2.0)], [0.001, 0.001, np.inf]])
def test_a_histogram_of_values_that_are_nearly_alike_ends_at_them(values: list[float]) -> None:
    assert page._histogram(np.array(values)).count(f">{values[0]:g}</text>") == 2


def test_a_map_of_one_number_goes_from_its_least_to_its_largest() -> None:
    rows = [
        {"from": 3.0 + k, "to": 4.0 + k, "value": 0.1 * k, "lower": 0.05 * k, "upper": 0.2 * k, "rollouts": k}
        for k in range(4)
    ]
    svg = page._map(rows)  # the first of which has no rollouts
    assert re.findall(r">([^<>]+)</text>", svg) == ["4", "up to 60 %", "7"]
    heights = re.findall(r'height="([\d.]+)" fill="#c', svg)
    np.testing.assert_allclose([float(x) for x in heights], 92.0 * np.array([1.0, 2.0, 3.0]) / 6.0, atol=0.06)


def test_a_map_has_as_many_columns_as_its_first_number_has_parts() -> None:
    ends = [(x, y) for x in (0.0, 1.0) for y in (5.0, 6.0, 7.0)]
    values = [0.1, 0.2, 0.4, 0.0, 0.3, None]
    parts = [
        {"from": [x, y], "to": [x + 1.0, y + 1.0], "value": value, "rollouts": 50}
        for (x, y), value in zip(ends, values, strict=True)
    ]
    names = ("rect x", "y", "width", "height", "fill-opacity")
    cell = "<" + ".*?".join(f'{name}="([\\d.]+)"' for name in names)
    svg, high = page._square(parts), 2 * page._HEIGHT / 3
    bars = [tuple(map(float, each)) for each in re.findall(cell, svg)]
    wanted = [  # the first number to the right, the second upwards; none where there was no rollout
        (150.0 * (x == 1.0), high * (7.0 - y), 149.0, high, 0.04 + 0.96 * value / 0.4)
        for (x, y), value in zip(ends, values, strict=True)
        if value is not None
    ]
    np.testing.assert_allclose(bars, wanted, atol=0.06)
    assert "0 to 1 × 6 to 7: 20 % of 50" in svg
    assert "0 to 2 × 5 to 8, up to 40 %" in svg


def test_a_chunk_has_the_power_of_two_that_its_steps_and_its_loops_allow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sample, "_MOST", 4096)
    head, own = TEXT[: TEXT.index("vary:")], "vary:\n  plant.substeps: {choices: %s}\n"
    for forms, size in ((4, 4096), (32, 4096), (33, 16)):  # of more loops than are kept each has few rollouts
        assert made(head + own % [*range(1, forms + 1)]).size == size
    for t_final, size in ((3.0, 2048), (100.0, 64), (500.0, 16), (2e4, 16)):  # 2^23 steps, 16 at least
        assert made(TEXT.replace("t_final: 0.25", f"t_final: {t_final}")).size == size


def test_seeds_are_counted_from_that_of_the_study(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(Sweep, "table", lambda _, drawn, seeds: seen.append((drawn, seeds)))
    monkeypatch.setattr(Sweep, "_flat", lambda self, table: np.zeros((5, 1)))
    found = made(TEXT.replace("t_final: 0.25", "t_final: 0.25\nseed: 7"))
    found.run(3, 5)
    np.testing.assert_array_equal(seen[0][0], found.numbers(3, 5))
    assert seen[0][1].tolist() == [7 + 48 + k for k in range(5)]
    row = dict(zip(found.drawn_names, seen[0][0][1].tolist(), strict=True))
    assert (found.config_of(row, 49).seed, found.config_of(row, 49, seed=3).seed) == (56, 3)


def test_a_rollout_has_failed_beyond_a_bound_or_where_it_has_no_number() -> None:
    table = {"peak_error": np.array([[0.0, 0.01], [0.01, 0.011], [0.0, np.nan], [0.0, 0.0], [0.0, 0.0]])}
    ends = np.array([*[Status.FINISHED] * 3, Status.STOPPED, Status.DIVERGED])
    assert made().fails({**table, "status": ends}).tolist() == [False, True, True, True, True]


def test_levels_that_random_rollouts_do_not_confirm_are_said_to_be_wrong() -> None:
    said = {"value": 0.02, "rollouts": 1000, "lower": 0.01, "upper": 0.04, "by the levels": 0.03}
    assert "WRONG" not in rare._describe_check(said)
    assert "WRONG" in rare._describe_check({**said, "by the levels": 0.05})
    assert "WRONG" in rare._describe_check({**said, "by the levels": 0.005})


def test_parameters_say_whether_they_vary() -> None:
    assert Parameter("x").varies
    assert not Parameter("x", structural=True).varies
    with pytest.raises(ParameterError):
        Sweep.of(*parse(TEXT, "study.yaml"), "halton")


def test_where_a_file_states_no_failure_it_is_a_share_of_the_move() -> None:
    """The largest move of the file is known in closed form from its points."""
    text = TEXT[: TEXT.index("failure:")]
    sweep = made(text)
    points = np.array(sweep.config.reference.points)
    move = float(np.ptp(points, axis=0).max())
    assert sweep.failure == {
        "peak_error": pytest.approx(0.1 * move, rel=1e-2),
        "final_error": pytest.approx(0.02 * move, rel=1e-2),
    }
    assert "10 % and 2 % of the largest move" in results.failure_words(sweep)
    assert "of the largest move" not in results.failure_words(made(TEXT))


def test_a_factor_multiplies_what_each_joint_has() -> None:
    """Logarithms are evenly drawn: the middle is the value, the ends are the factor either way."""
    nominal = np.array([0.1, 2.0, 30.0])
    drawn = Distribution("factor", (2.5,), 3, tuple(nominal))
    for share, factor in ((0.0, 1 / 2.5), (0.5, 1.0), (1.0, 2.5)):
        np.testing.assert_allclose(drawn.of(np.full((1, 3), share))[0], factor * nominal)
    assert drawn.ends == pytest.approx((0.04, 75.0))


@pytest.mark.parametrize(
    ("section", "name"), [("robot", "effort"), ("plant", "rotor_inertia"), ("plant", "torque_limit")]
)
def test_a_factor_multiplies_the_values_of_joints_named_in_any_order(section: str, name: str) -> None:
    robot = {"name": "anthropomorphic3"}
    data: dict[str, Any] = {"robot": robot, "plant": {}, "t_final": 0.1}
    data[section] |= {name: {"q3": 30.0, "q1": 50.0, "q2": 40.0}}
    data["vary"] = {f"{section}.{name}": {"factor": 1.5, "each": "joint"}}
    assert made(json.dumps(data)).varied[f"{section}.{name}"].nominal == (50.0, 40.0, 30.0)


def test_a_factor_needs_the_values_of_all_joints_that_it_multiplies() -> None:
    """The other joints have the effort of the URDF: they had that of the only one that is named."""
    robot = {"name": "anthropomorphic3", "effort": {"q3": 30.0}}
    for each in ("rollout", "joint"):
        data = {"robot": robot, "t_final": 0.1, "vary": {"robot.effort": {"factor": 1.5, "each": each}}}
        with pytest.raises(ConfigError, match="of all joints"):
            made(json.dumps(data))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("controller.omega: {factor: 0.5}", "a factor of at least 1"),
        ("plant.rotor_inertia: {factor: 2, each: joint}", "a positive value to multiply"),
    ],
)
def test_a_factor_that_cannot_be_is_refused(line: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        made(TEXT[: TEXT.index("vary:")] + f"vary:\n  {line}\n")


def test_a_part_of_a_range_is_said_by_both_its_ends() -> None:
    assert _percent({"value": 0.1, "lower": 0.05, "upper": 0.2}) == "10 % (5 to 20 %)"
    assert (_part(0.5, 1.25), _part(2.0, 2.0)) == ("0.5..1.25", "2")
