"""A recorded trajectory as a reference: smooth, at its samples, inside the limits, from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import armgpi
from armgpi import Bezier, Recorded, Robot, config, simulate
from armgpi.config import experiment as experiments
from armgpi.errors import ArmgpiError, ArrayError, LimitError, NameNotFound, UnreadableTrajectory

ARM = Robot.load("anthropomorphic3")
START = ARM.middle()
MOVE = Bezier(START, START + np.array([0.3, 0.2, -0.4]), duration=1.0)
TIMES = np.linspace(0.0, 1.0, 41)


def written(path: Path, names: str = "q1,q2,q3", q: Any = None, times: Any = TIMES) -> Path:
    """Write a CSV file."""
    rows = np.column_stack([times, MOVE.at(TIMES).q if q is None else q])
    path.write_text(f"time,{names}\n" + "\n".join(",".join(map(repr, row.tolist())) for row in rows) + "\n")
    return path


def test_it_goes_through_its_samples_and_follows_what_was_recorded() -> None:
    recorded = Recorded(TIMES, MOVE.at(TIMES).q)
    np.testing.assert_allclose(recorded.at(TIMES).q, MOVE.at(TIMES).q, rtol=0.0, atol=1e-12)
    t = np.linspace(0.0, 1.0, 1001)
    found, expected = recorded.at(t), MOVE.at(t)
    # Of degree 5 through a polynomial of degree 9, 25 ms apart.
    for mine, theirs, tolerance in zip(found, expected, (1e-7, 1e-5, 1e-3), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=tolerance)


def test_position_velocity_and_acceleration_are_continuous_also_at_the_ends() -> None:
    rng = np.random.default_rng(0)
    recorded = Recorded([0.0, 0.1, 0.25, 0.5], rng.normal(size=(4, 2)), t_start=0.3)
    for knot in recorded.times:
        before, after = recorded.at(knot - 1e-9), recorded.at(knot + 1e-9)
        for left, right in zip(before, after, strict=True):
            np.testing.assert_allclose(left, right, rtol=0.0, atol=1e-4)
    t = np.linspace(0.0, 1.0, 200001)
    target = recorded.at(t)
    np.testing.assert_allclose(np.gradient(target.q, t, axis=0), target.v, rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(np.gradient(target.v, t, axis=0), target.a, rtol=0.0, atol=2e-1)
    assert not recorded.at(0.1).v.any()
    np.testing.assert_array_equal(recorded.at(2.0).q, recorded.at(recorded.t_end).q)


def test_shapes_are_those_of_every_reference() -> None:
    recorded = Recorded(TIMES, MOVE.at(TIMES).q)
    assert recorded.at(0.2).q.shape == (3,)
    assert recorded.at(np.zeros(5)).a.shape == (5, 3)


def test_a_csv_file_is_read_by_the_names_of_joints(tmp_path: Path) -> None:
    q = MOVE.at(TIMES).q
    path = written(tmp_path / "move.csv", "q3, extra ,q1,q2", np.column_stack([q[:, 2], q[:, 0], q[:, :2]]))
    np.testing.assert_array_equal(Recorded.load(path, ARM).q, q)


@pytest.mark.parametrize("batch", [None, 2])
def test_a_rollout_is_a_trajectory(tmp_path: Path, batch: int | None) -> None:
    q0 = None if batch is None else np.tile(START, (batch, 1))
    plant = armgpi.RigidBodyPlant(ARM)
    rollout = simulate(plant, armgpi.GPI(ARM, 1e-3), MOVE, 0.2, q0=q0, progress=False)
    armgpi.save(rollout, tmp_path / "rollout.nc")
    recorded = Recorded.load(tmp_path / "rollout.nc", ARM, variable="q_ref")
    np.testing.assert_array_equal(recorded.q, MOVE.at(rollout["time"].values).q)


def test_a_rollout_that_a_file_does_not_have_is_said_to_be_none(tmp_path: Path) -> None:
    plant, q0 = armgpi.RigidBodyPlant(ARM), np.tile(START, (3, 1))
    armgpi.save(
        simulate(plant, armgpi.GPI(ARM, 1e-3), MOVE, 0.05, q0=q0, progress=False),
        tmp_path / "rollouts.nc",
    )
    with pytest.raises(UnreadableTrajectory, match=r"has 3 rollouts.*got rollout 3$"):
        Recorded.load(tmp_path / "rollouts.nc", ARM, rollout=3)


def test_limits_are_checked_between_samples_too() -> None:
    robot = ARM.with_limits(velocity=0.5)
    with pytest.raises(LimitError, match=r"velocity at t = .*joint 'q3'"):
        Recorded(TIMES, MOVE.at(TIMES).q, source="here").check(robot)
    with pytest.raises(LimitError, match="position at t = "):
        Recorded(TIMES, MOVE.at(TIMES).q).check(ARM.with_limits(upper={"q1": START[0] + 0.1}))


def test_an_experiment_follows_a_file_and_keeps_it(tmp_path: Path) -> None:
    written(tmp_path / "move.csv")
    file = tmp_path / "experiment.yaml"
    file.write_text("robot: {name: anthropomorphic3}\nreference: {file: move.csv}\nt_final: 0.1\n")
    experiment = config.build(*config.read(file))
    result = experiments.compare(experiment, progress=False)
    assert isinstance(experiment.reference, Recorded)
    experiments.save(result, experiment, tmp_path / "out")
    (tmp_path / "move.csv").unlink()
    again = experiments.compare(
        config.build(*config.read(tmp_path / "out" / "experiment.yaml")), progress=False
    )
    np.testing.assert_array_equal(result["q"], again["q"])


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ({"file": "no such.csv"}, r"reference\.file: .*No such file"),
        ({"file": "x.csv", "holds": 1.0}, r"reference\.holds: file and this key"),
        ({"file": "x.csv", "path": {"type": "circle"}}, r"reference\.path: file and this key"),
    ],
)
def test_a_wrong_experiment_names_its_key(reference: dict[str, Any], message: str) -> None:
    wanted = {"robot": {"name": "anthropomorphic3"}, "reference": reference}
    with pytest.raises(ArmgpiError, match=message):
        config.build(config.check(wanted, config.Origin("x")), config.Origin("x"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no CSV file"),
        ("time,q1,q2,q3\n0,1,2\n", "is no CSV|has the columns"),
        ("time,q1,q2,q3\n0,1,2,x\n", "is no CSV file"),
        ("q1,q2,q3\n0,1,2\n", "expected time"),
        ("time,q1,q1,q2,q3\n0,1,2,3,4\n", "has the columns"),
        ("time,q1,q2,q3\n0,0,0,0\n", "at least two times"),
        ("time,q1,q2,q3\n0,0,0,0\n0,0,0,0\n", "each later than the one before"),
        ("time,q1,q2,q3\n0,0,0,0\n1,nan,0,0\n", "finite"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(UnreadableTrajectory, match=message):
        Recorded.load(path, ARM)


def test_a_missing_joint_and_a_broken_netcdf_are_named(tmp_path: Path) -> None:
    with pytest.raises(NameNotFound, match="q3"):
        Recorded.load(written(tmp_path / "two.csv", "q1,q2,q4"), ARM)
    (tmp_path / "broken.nc").write_bytes(b"nothing")
    with pytest.raises(UnreadableTrajectory, match="broken"):
        Recorded.load(tmp_path / "broken.nc", ARM)
    xr.Dataset({"p": ("time", [0.0, 1.0])}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(UnreadableTrajectory, match="no variable 'q'"):
        Recorded.load(tmp_path / "other.nc", ARM)


def test_arrays_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ArrayError, match="times"):
        Recorded([0.0, 0.0], np.zeros((2, 3)))
    with pytest.raises(ArrayError, match="q"):
        Recorded([0.0, 1.0], np.zeros((3, 3)))
