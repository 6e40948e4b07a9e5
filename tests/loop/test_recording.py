"""What a run keeps, and where: chosen variables, narrow numbers, files, and memory that is used again."""

from __future__ import annotations

import os
import shutil
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from armgpi import GPI, Bezier, RigidBodyPlant, Robot, Step, Supervisor, load, metrics, prepare, simulate
from armgpi.errors import ArmgpiError, NameNotFound, ParameterError, RolloutError
from armgpi.gpi.gains import Tuning
from armgpi.gpi.weights import Weights
from armgpi.loop import rollout
from armgpi.loop.memory import Memory, NetCDF
from armgpi.loop.rollout import Recording, Status
from armgpi.loop.weights import load_weights, save_weights
from armgpi.supervisor import SIGNALS

ARM = Robot.load("anthropomorphic3")
MOVE = Bezier([0.0, 0.0, 0.0], [0.4, 0.3, -0.2], duration=0.3)
#: The third falls: its rollout ends early. Eleven fill no whole number of lanes.
EFFORT = np.where(np.arange(11)[:, None] == 2, 0.02, 20.0) * np.ones(3)
BACKENDS = ("numpy", "compiled")


def run(backend: str, batch: int | None = 11, **options: Any) -> xr.Dataset:
    plant = RigidBodyPlant(ARM, Step([0.1, 0.0, 0.2], onset=0.05))
    law = GPI(ARM, 1e-3) if batch is None else GPI(ARM, 1e-3, effort=EFFORT[:batch])
    return simulate(plant, law, MOVE, 0.2, divergence=0.1, backend=backend, **options)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("batch", [None, 8, 11])
def test_a_file_has_what_memory_has(backend: str, batch: int | None, tmp_path: Path) -> None:
    whole = run(backend, batch, signals=True)
    with run(backend, batch, signals=True, file=tmp_path / "run.nc") as lazy:
        assert list(lazy["q"].dims) == ["time", *(["rollout"] if batch else []), "joint"]
        again = lazy.load().transpose("rollout", "time", ..., missing_dims="ignore")
    xr.testing.assert_identical(again, whole)
    xr.testing.assert_identical(load(tmp_path / "run.nc"), whole)
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("every", [1, 3])
def test_chosen_and_narrow_variables_are_those_of_the_whole(backend: str, every: int, tmp_path: Path) -> None:
    names = ("q", "tau", "chi", "disturbance")
    whole = run(backend, signals=True)
    some = run(backend, record=names, dtype="float32", record_every=every, file=tmp_path / "run.nc")
    some = some.load().transpose("rollout", ...)
    trajectories = [str(name) for name, x in some.data_vars.items() if "time" in x.dims]
    assert sorted(trajectories) == sorted(names)
    for name in ("q", "tau", "chi"):
        expected = whole[name].isel(time=slice(None, None, every)).values.astype(np.float32)
        assert some[name].dtype == np.float32
        np.testing.assert_array_equal(some[name].values, expected)
    np.testing.assert_array_equal(some["status"], whole["status"])
    xr.testing.assert_identical(load(tmp_path / "run.nc").transpose("rollout", ...), some)
    with pytest.raises(RolloutError, match="q_ref"):
        metrics.peak_error(some)


def test_weights_of_all_three_tunings_are_read_as_they_were_written(tmp_path: Path) -> None:
    made = Weights(
        **{name: np.random.default_rng(k).normal(size=(3, 4)) for k, name in enumerate(Tuning._fields)}
    )
    save_weights(made, tmp_path / "w.nc", ARM)
    for name in Tuning._fields:
        np.testing.assert_array_equal(
            getattr(load_weights(tmp_path / "w.nc", ARM), name), getattr(made, name)
        )


@pytest.mark.parametrize("every", [1, 3, 4])
def test_what_is_stored_in_parts_is_the_whole_thinned(every: int) -> None:
    kept, whole = Recording.new((2, 3), 11, 0.1, every), np.random.default_rng(1).normal(size=(12, 2, 3))
    for begin, end in ((0, 4), (4, 5), (4, 5), (5, 10), (10, 12)):  # one of them twice
        kept.store(begin, {"q": whole[begin:end]})
        assert kept.stored == len(range(0, end, every))
    np.testing.assert_array_equal(kept.variables["q"], whole[::every])
    np.testing.assert_allclose(kept.times, 0.1 * np.arange(12)[::every])
    kept.interrupt(7)
    assert (kept.t_end.tolist(), kept.kept_samples) == ([0.7000000000000001] * 2, len(kept.times))


def test_a_recording_is_refused_from_the_first_byte_on_that_is_not_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # Five times, and numbers of four bytes: two variables of 2 rollouts and 3 joints.
    needed = 5 * (8 + 2 * 2 * 3 * 4)
    on_disk = SimpleNamespace(on_disk=True)
    for asked, bytes_ in (
        ({"names": frozenset("qv"), "dtype": "float32"}, needed),
        ({"memory": on_disk}, 40),
    ):
        for missing in (0, 1):
            monkeypatch.setattr(rollout, "machine_bytes", lambda there=bytes_ - missing: there)
            with pytest.raises(RolloutError, match="does not fit") if missing else nullcontext():
                Recording.new((2, 3), 13, 0.1, 3, **asked)


def test_a_fault_is_told_at_the_sample_that_it_was_in() -> None:
    """Of three rollouts: 4 samples ago, none, and diverged after it, with nothing stored since."""
    kept = Recording.new((3, 2), 10, 1e-3, 1)
    rows = np.full((4, 11, 3, 2), np.nan)
    for k in range(11):
        rows[:, k, 0], rows[:, k, 1] = np.array([[[3], [5 * (k > 5)], [1], [k - 6]], [[0], [0], [0], [0]]])
    rows[:, :8, 2] = np.array([3.0, 8.0, 0.0, 2.0])[:, None, None]
    for name, values in zip(SIGNALS, rows, strict=True):
        kept.store(0, {name: values})
    kept.diverge(np.array([2]), np.array([8]))
    kept.note_faults()
    np.testing.assert_array_equal(kept.faults["fault"], [5, 0, 8])
    np.testing.assert_array_equal(kept.faults["fault_joint"], [1, -1, 0])
    np.testing.assert_allclose(kept.faults["t_fault"], [5e-3, np.nan, 5e-3], atol=1e-12)
    assert kept.status.tolist() == [Status.STOPPED, Status.FINISHED, Status.DIVERGED]
    np.testing.assert_allclose(kept.t_end, [5e-3, 10e-3, 8e-3], atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_faults_are_told_of_chosen_variables(backend: str) -> None:
    plant = RigidBodyPlant(ARM, Step([0.0, 0.0, 400.0], onset=0.05))
    parts = plant, GPI(ARM, 1e-3), MOVE, 0.3
    one, other = (
        simulate(*parts, supervisor=Supervisor(), backend=backend, record=record) for record in ("all", ["q"])
    )
    assert one["fault"] > 0
    for name in ("fault", "fault_joint", "t_fault", "status"):
        assert one[name].equals(other[name]), name


@pytest.mark.parametrize("backend", BACKENDS)
def test_memory_in_use_is_not_written_again(backend: str) -> None:
    loop = prepare(RigidBodyPlant(ARM), GPI(ARM, 1e-3), MOVE, 0.2, backend=backend)
    kept = loop.run(q0=np.zeros((8, 3)))
    view = kept["q"].values[3]
    before = view.copy()
    del kept  # the view is still there
    for i in range(3):
        loop.run(q0=np.full((8, 3), 0.01 * i))
    loop.run(q0=np.zeros((3, 3)))  # another batch
    np.testing.assert_array_equal(view, before)


def test_memory_that_nobody_has_is_used_again() -> None:
    memory = Memory()
    for size in (1, 7, 1000, 1_000_003):
        first = memory.array("q", (size, 2), "float64")
        place, view = first.ctypes.data, first[:1]
        assert place % 64 == 0
        del first
        assert memory.array("v", (size, 2), "float64").ctypes.data != place
        del view
        assert place in {memory.array("v", (2, size), "float64").ctypes.data for _ in range(2)}


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"record": ("q", "tua")}, NameNotFound, "tau"),
        ({"record": ()}, ParameterError, "record"),
        ({"record": "some"}, ParameterError, "record"),
        ({"record": ("q", 1)}, ParameterError, "record"),
        ({"dtype": "float16"}, ParameterError, "dtype"),
        ({"file": "no/such/folder/run.nc"}, RolloutError, "cannot be written"),
        ({"file": "run.nc", "partial": True}, ParameterError, "partial"),
        ({"file": 3}, ParameterError, "file"),
    ],
)
def test_what_cannot_be_recorded_is_refused(
    options: dict[str, Any],
    error: type[ArmgpiError],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=words):
        run("numpy", **options)
    assert not list(tmp_path.iterdir())


def test_a_disk_without_room_is_told_before_the_run(tmp_path: Path) -> None:
    plant, law = RigidBodyPlant(ARM), GPI(ARM, 1e-3)
    start = np.zeros((100_000, 3))
    with pytest.raises(RolloutError, match="cannot be written"):
        simulate(plant, law, MOVE, 1e4, q0=start, file=tmp_path / "run.nc", backend="compiled")  # 168 TB
    assert not list(tmp_path.iterdir())
    with pytest.raises(RolloutError, match="file="):
        simulate(plant, law, MOVE, 1e8, backend="compiled")


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="this system does not list open files")
def test_a_rollout_in_a_file_closes_it(tmp_path: Path) -> None:
    """As a dataset of another class it forgot how."""
    path = tmp_path / "run.nc"

    def is_open() -> bool:
        return any(str(path) == os.path.realpath(each) for each in Path("/proc/self/fd").iterdir())

    lazy = run("numpy", file=path)
    assert is_open()
    assert lazy.encoding["source"] == str(path)
    lazy.close()
    assert not is_open()


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="this system promises no room on a disk")
def test_a_file_has_its_room_before_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[tuple[int, int]] = []
    real = os.posix_fallocate

    def take(descriptor: int, begin: int, size: int) -> None:
        taken.append((begin, begin + size))
        real(descriptor, begin, size)

    monkeypatch.setattr(os, "posix_fallocate", take)
    run("compiled", file=tmp_path / "run.nc", record=("q", "tau")).close()
    assert [end - begin for begin, end in taken] == [8 * 201 * 11 * 3] * 2
    assert max(begin for begin, _ in taken) >= min(end for _, end in taken)  # beside each other


def test_a_variable_takes_all_that_is_free_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, size = NetCDF(tmp_path / "a.nc"), 5 * 3 * 8
    for free, fits in ((size, True), (size - 1, False)):
        monkeypatch.setattr(shutil, "disk_usage", lambda folder, free=free: SimpleNamespace(free=free))
        with nullcontext() if fits else pytest.raises(OSError, match="No space"):
            assert file.array(f"q{fits}", (5, 3), "float64").shape == (5, 3)
