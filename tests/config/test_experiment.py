"""Experiments run, compared, told as plain data and kept in a folder that makes them again."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from armgpi import Status, config, load, metrics
from armgpi.config import experiment
from armgpi.config import experiment as experiments
from armgpi.config.experiment import (
    compare,
    join,
    overall_status,
    prepare,
    record_all,
    records,
    records_of,
    run,
    save,
)
from armgpi.errors import RolloutError
from armgpi.loop.rollout import Recorded

ROOT = Path(__file__).parents[2]
TEXT = """
robot: {name: anthropomorphic3}
plant:
  loads: [{type: sine, amplitude: {q2: 0.3}, omega: 9}]
  payload: {mass: 0.05}
  encoder_bits: 16
  delay: 1
  drop_out: 0.05
  noise: {position: 1e-4, velocity: 1e-3}
  torque_rate: 200
controllers:
  - {type: gpi, omega: {q1: 18}, inertia_scale: 0.9}
  - {type: pid, label: "PID, exact"}
  - {type: gpi, realisation: paper, start: zero}
reference: {points: [{q1: 0.1}, {q2: 0.4}], durations: 0.2}
t_final: 0.3
seed: 7
"""
SAMPLED = ("q", "v", "q_ref", "q_measured", "tau_command", "tau")


def build(text: str = TEXT) -> config.Experiment:
    return config.build(*config.parse(text, "file.yaml"))


@pytest.fixture(scope="module")
def whole() -> config.Experiment:
    return build()


@pytest.fixture(scope="module")
def compared(whole: config.Experiment) -> xr.Dataset:
    return compare(whole)


@pytest.fixture
def stopping(whole: config.Experiment, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, int], None]:
    """Makes a controller be stopped by Ctrl-C at a sample."""

    def stop(label: str, at: int) -> None:
        controller = whole.controllers[label]
        step, calls = controller.step, iter(range(10**9))

        def interrupted(*arguments: Any) -> Any:
            if next(calls) == at:
                raise KeyboardInterrupt
            return step(*arguments)

        monkeypatch.setattr(controller, "step", interrupted)

    return stop


def test_controllers_without_labels_are_told_apart(whole: config.Experiment) -> None:
    assert list(whole.controllers) == ["gpi", "PID, exact", "gpi 3"]


def test_a_comparison_is_the_single_runs_side_by_side(whole: config.Experiment, compared: xr.Dataset) -> None:
    assert list(compared["label"].values) == list(whole.controllers)
    assert list(compared["measurement"].values) == ["Measurement", "FullState", "Measurement"]
    provenance = json.loads(compared.attrs["provenance"])
    for i, label in enumerate(whole.controllers):
        one = run(whole, label)
        for name in (*SAMPLED, "disturbance", "status", "t_end"):
            np.testing.assert_array_equal(compared[name].isel(rollout=i), one[name])
        assert provenance[label] == json.loads(one.attrs["provenance"])


def test_every_contender_meets_the_same_noise(compared: xr.Dataset) -> None:
    # The first sample of all of them: the same true configuration, the same noise.
    first = compared["q_measured"].isel(time=0).values
    np.testing.assert_array_equal(first, np.broadcast_to(first[0], first.shape))
    assert (first != compared["q"].isel(time=0).values).any()


def test_gains_that_adapt_are_kept_with_their_networks() -> None:
    controllers = "controllers: [{type: gpi}, {type: network}, {type: pid}]"
    both = compare(build(f"robot: {{name: anthropomorphic3}}\n{controllers}\nt_final: 0.05"))
    assert both["omega_c"].sel(rollout=both["label"] == "network").notnull().all()
    assert both["omega_c_weight_1"].sel(rollout=both["label"] != "network").isnull().all()


def test_a_comparison_survives_the_disk(
    compared: xr.Dataset, whole: config.Experiment, tmp_path: Path
) -> None:
    save(compared, whole, tmp_path)
    xr.testing.assert_identical(load(tmp_path / "rollout.nc"), compared)


def test_record_every_thins_an_experiment(whole: config.Experiment) -> None:
    thinned = run(build(TEXT + "record_every: 10"), "gpi")
    assert thinned.identical(run(whole, "gpi").isel(time=slice(None, None, 10)))


# Joining.


def test_joining_refuses_what_does_not_go_together(whole: config.Experiment) -> None:
    one = run(whole, "gpi")
    with pytest.raises(RolloutError, match="no rollouts"):
        join({})
    with pytest.raises(RolloutError, match="different joints"):
        join({"a": one, "b": one.assign_coords(joint=["a", "b", "c"])})
    with pytest.raises(RolloutError, match="different times"):
        join({"a": one, "b": one.assign_coords(time=2.0 * one["time"])})


def test_ctrl_c_ends_a_comparison_after_the_rollout_it_stopped(
    whole: config.Experiment, compared: xr.Dataset, stopping: Callable[[str, int], None]
) -> None:
    stopping("PID, exact", 100)
    with pytest.warns(UserWarning, match="interrupted at t = 0.1 s"):
        stopped = compare(whole)
    assert list(stopped["label"].values) == ["gpi", "PID, exact"]
    np.testing.assert_array_equal(stopped["status"], [Status.FINISHED, Status.INTERRUPTED])
    for name in SAMPLED:
        np.testing.assert_array_equal(stopped[name][0], compared[name][0])
        np.testing.assert_array_equal(stopped[name][1, :100], compared[name][1, :100])
        assert np.isnan(stopped[name][1, 100:]).all()
    found = records(stopped)
    assert [each["end"] for each in found] == ["finished", "interrupted at 0.1 s"]
    assert overall_status(found) is Status.INTERRUPTED
    # Figures of what is there: those of the whole run up to then.
    expected = metrics.iae(compared.isel(rollout=1, time=slice(0, 100)))
    np.testing.assert_allclose(found[1]["metrics"]["iae"], expected, rtol=1e-12)


# Plain data.


def test_records_are_json_with_the_metrics_of_every_joint(compared: xr.Dataset) -> None:
    found = json.loads(json.dumps(records(compared), allow_nan=False))
    table = metrics.summary(compared)
    for i, record in enumerate(found):
        assert set(record) == {"label", "measurement", "knows", "status", "end", "joints", "metrics"}
        assert record["joints"] == ["q1", "q2", "q3"]
        assert record["status"] == record["end"] == "finished"
        assert set(record["metrics"]) == set(metrics.ALL)
        for name, values in record["metrics"].items():
            np.testing.assert_array_equal(values, table[name][i])


def test_records_of_a_single_rollout_are_those_of_a_batch_of_one(whole: config.Experiment) -> None:
    one = run(whole, "gpi")
    (single,), (joined,) = records(one), records(join({"gpi": one}))
    assert single | {"label": "gpi"} == joined


def assert_same_records(runs: dict[str, Recorded]) -> None:
    """What is said of runs without a dataset is what is said of the dataset."""
    for ours, (label, each) in zip(records_of(runs), runs.items(), strict=True):
        (theirs,) = records(join({label: each.dataset()}))
        assert {**ours, "metrics": None} == {**theirs, "metrics": None}
        assert list(ours["metrics"]) == list(theirs["metrics"])
        for name, values in theirs["metrics"].items():
            if None in values:
                assert ours["metrics"][name] == values, name
            else:
                np.testing.assert_allclose(
                    ours["metrics"][name], values, rtol=1e-11, atol=1e-13, err_msg=name
                )


@pytest.mark.parametrize("every", [1, 7])
def test_runs_have_the_records_of_their_dataset(every: int, whole: config.Experiment) -> None:
    thinned = whole._replace(config=whole.config.replace(record_every=every))
    assert_same_records(record_all(thinned, progress=False))


@pytest.mark.parametrize("at", [0, 1, 2, 100])
def test_runs_that_were_stopped_have_the_records_of_their_dataset(
    at: int, whole: config.Experiment, stopping: Callable[[str, int], None]
) -> None:
    stopping("PID, exact", at)
    with pytest.warns(UserWarning, match="interrupted"):
        assert_same_records(record_all(whole, progress=False))


def test_runs_with_a_fault_or_a_metric_of_ones_own_have_the_records_of_their_dataset(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A metric that needs trajectories: no totals give it.
    median = lambda rollout: abs(metrics.error(rollout)).median("time")  # noqa: E731
    monkeypatch.setitem(metrics.ALL, "iae", replace(metrics.ALL["iae"], function=median, of_rollout=True))
    text = "robot: {name: anthropomorphic3}\nsupervisor: {following: 1e-4}\nt_final: 2"
    runs = record_all(build(text), progress=False)
    assert records_of(runs)[0]["end"].startswith("stopped at ")
    assert_same_records(runs)


def test_a_run_leaves_the_search_of_its_file_out() -> None:
    text = "robot: {name: anthropomorphic3}\n"
    assert config.parse(f"{text}tune: {{free: [omega]}}", "file.yaml").config == config.parse(text, "").config


def test_the_metrics_of_a_diverged_rollout_are_null() -> None:
    fast = "robot: {name: anthropomorphic3, effort: 1e9}\ncontrollers: [{type: gpi, omega: 3000}]\nt_final: 2"
    with pytest.warns(UserWarning, match="too fast"):
        unstable = build(fast)
    runs = record_all(unstable)
    assert_same_records(runs)
    (record,) = records_of(runs)
    assert record["status"] == "diverged"
    assert record["end"].startswith("diverged at ")
    assert all(value is None for values in record["metrics"].values() for value in values)
    assert overall_status([record]) is Status.DIVERGED


@pytest.mark.parametrize("at", [0, 1])
def test_a_run_that_was_stopped_at_once_has_no_metrics_but_a_record(
    at: int, whole: config.Experiment, stopping: Callable[[str, int], None], tmp_path: Path
) -> None:
    stopping("gpi", at)
    with pytest.warns(UserWarning, match="interrupted"):
        stopped = join({"gpi": experiments.record(whole, "gpi", partial=True).dataset()})
    (stored,) = records(stopped)
    assert stored["status"] == "interrupted"
    assert stored["metrics"]["itae"] == [None, None, None]
    save(stopped, whole, tmp_path)
    assert load(tmp_path / "rollout.nc").identical(stopped)


@pytest.mark.parametrize(
    ("statuses", "expected"),
    [
        ((), Status.FINISHED),
        (("finished", "finished"), Status.FINISHED),
        (("finished", "diverged"), Status.DIVERGED),
        (("diverged", "interrupted", "finished"), Status.INTERRUPTED),
    ],
)
def test_the_worst_end_is_that_of_the_whole(statuses: tuple[str, ...], expected: Status) -> None:
    assert overall_status({"status": status} for status in statuses) is expected


# The folder.


def test_a_folder_makes_its_rollouts_again_bit_by_bit(
    whole: config.Experiment, compared: xr.Dataset, tmp_path: Path
) -> None:
    folder = tmp_path / "made" / "if needed"
    paths = save(compared, whole, folder)
    assert sorted(paths) == sorted(folder.iterdir())
    assert {path.name for path in paths} == {"rollout.nc", "experiment.yaml", "metrics.json", "SHA256SUMS"}
    again = compare(config.build(*config.read(folder / "experiment.yaml")))
    assert again.identical(load(folder / "rollout.nc"))
    for name in SAMPLED:
        assert again[name].values.tobytes() == compared[name].values.tobytes()
    assert json.loads((folder / "metrics.json").read_text()) == records(compared)


def test_a_folder_with_a_robot_of_ones_own_can_be_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    urdf = (ROOT / "urdf" / "anthropomorphic3.urdf").read_text().replace("anthropomorphic3", "mine")
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    (here / "mine.urdf").write_text(urdf)
    monkeypatch.chdir(here)
    own = build(TEXT.replace("anthropomorphic3", "mine.urdf"))
    result = compare(own)
    save(result, own, Path("results"))
    shutil.move("results", there)
    shutil.rmtree(here)
    monkeypatch.chdir(tmp_path)
    copied = config.build(*config.read(there / "experiment.yaml"))
    assert copied.robot.name == "mine"
    again = compare(copied)
    for name in SAMPLED:
        assert again[name].values.tobytes() == result[name].values.tobytes()
    # From there to the next folder the copy keeps its name.
    save(again, copied, tmp_path / "third")
    assert {path.name for path in there.iterdir()} == {path.name for path in (tmp_path / "third").iterdir()}


def test_a_copied_robot_overwrites_no_other_one(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    urdf = (ROOT / "urdf" / "anthropomorphic3.urdf").read_text()
    (tmp_path / "robots" / "mine.urdf").write_text(urdf)
    other = tmp_path / "mine.urdf"
    other.write_text("another robot")
    own = build(TEXT.replace("anthropomorphic3", str(tmp_path / "robots" / "mine.urdf")))
    save(compare(own), own, tmp_path)
    assert other.read_text() == "another robot"


def test_saving_again_replaces_what_was_there(
    whole: config.Experiment, compared: xr.Dataset, tmp_path: Path
) -> None:
    first = {path: path.read_bytes() for path in save(compared, whole, tmp_path)}
    assert {path: path.read_bytes() for path in save(compared, whole, tmp_path)} == first


@pytest.mark.parametrize("where", ["file", "file/below"])
def test_a_folder_that_cannot_be_used_is_refused_before_the_run(where: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(RolloutError, match="cannot be written to") as refused:
        prepare(tmp_path / where)
    assert str(tmp_path / where) in str(refused.value)


def test_trying_a_folder_leaves_nothing_in_it(tmp_path: Path) -> None:
    prepare(tmp_path / "new")
    assert list((tmp_path / "new").iterdir()) == []


def test_the_module_offers_what_the_command_line_uses() -> None:
    assert {experiment.run, experiment.compare, experiment.save} == {run, compare, save}


def test_rollouts_of_a_batch_without_labels_are_told_apart(compared: xr.Dataset) -> None:
    own = json.loads(compared.attrs["provenance"])["gpi"]
    batch = compared.drop_vars("label").assign_attrs(provenance=json.dumps(own))
    names = [record["label"] for record in records(batch)]
    assert names == [f"rollout {i}" for i in range(compared.sizes["rollout"])]


def test_a_drawn_arm_moves_in_armgpis_own_simulator() -> None:
    text = "robot: {name: anthropomorphic3}\nreality: {name: geared}\ncontrollers: [{type: gpi, rolloff: 1}]"
    drawn = build(text)
    assert list(drawn.plants.items()) == [("armgpi", drawn.plant)]


def test_a_reference_of_the_file_runs_to_its_end_in_a_scenario() -> None:
    text = (
        "robot: {name: anthropomorphic3}\nreality: {name: geared}\ncontrollers: [{type: gpi, rolloff: 1}]\n"
    )
    alone = build(text).t_final
    for duration, t_final in ((0.5, alone), (20.0, 22.0)):
        moves = f"reference: {{points: [[0, 0, 0], [0.5, 0.5, 0.5]], durations: [{duration}]}}\n"
        assert build(text + moves).t_final == pytest.approx(t_final)


def test_a_joint_is_at_its_limit_for_more_than_a_share_of_the_time_not_for_just_that() -> None:
    record = {"joints": ["q1", "q2", "q3"], "metrics": {"saturated_time": [0.05, 0.06, None]}}
    assert experiments.describe_saturation(record, 1.0) == "at its torque limit: q2 for 6 % of the time"
