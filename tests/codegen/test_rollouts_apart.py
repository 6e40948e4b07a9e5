"""A rollout's numbers are its own: in any lane, batch and thread, whatever its neighbours do."""

from __future__ import annotations

import os
import shutil
import signal
import threading
import tracemalloc
import warnings
from typing import Any

import numpy as np
import pytest
import xarray as xr
from loops import SAMPLED, assert_close, compiled, machine
from machines import sled

from armgpi import (
    GPI,
    ArmgpiWarning,
    Bezier,
    BSplineNetwork,
    Delayed,
    DropOut,
    Encoder,
    FixedGains,
    Friction,
    Hold,
    Noisy,
    PIDInversion,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Saturated,
    Sine,
    Status,
    Waypoints,
    simulate,
)
from armgpi.codegen.run import CompiledRun

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
MOST = 33
OWN = np.random.default_rng(0).uniform(size=(MOST, 3))
SEED = 11


def batch(rows: slice) -> tuple[Any, ...]:
    """Return some rollouts of one batch, with everything that can differ between them."""
    own, first = OWN[rows], range(MOST)[rows][0]
    arms = RobotBatch([ARM.scaled_inertia(1.0 + 0.1 * x) for x in own[:, 0]])
    plant: Any = RigidBodyPlant(arms, Sine(own, 10.0 * own), Friction(0.1 * own, 0.2))
    plant = Noisy(Saturated(plant, 5.0 + own), 1e-4 * own, seed=SEED + first)
    plant = DropOut(Delayed(Encoder(plant, 14.0 + np.rint(4.0 * own)), 1), 0.1, seed=SEED + first)
    network = BSplineNetwork((20.0 + own, 40.0 + own), rate=0.5)
    reference = Bezier(0.1 * own, 0.3 * own, duration=0.03)
    return plant, GPI(ARM, DT, network, delay=DT), reference, 0.05


def run(rows: slice, lanes: int, threads: int = 1) -> xr.Dataset:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="omega_c", category=ArmgpiWarning)
        return compiled(*batch(rows), signals=True, lanes=lanes, threads=threads)


@pytest.fixture(scope="module")
def whole() -> xr.Dataset:
    return run(slice(0, MOST), 8)


def assert_rows(got: xr.Dataset, whole: xr.Dataset, rows: slice) -> None:
    for name in got.data_vars:
        part = whole[name].isel(rollout=rows) if "rollout" in whole[name].dims else whole[name]
        np.testing.assert_array_equal(got[name].values, part.values, err_msg=str(name))


@pytest.mark.parametrize("lanes", [1, 4, 8])
@pytest.mark.parametrize("size", [1, 2, 7, 8, 9, 16, 33])
def test_any_batch_any_lane_the_same_bits(whole: xr.Dataset, size: int, lanes: int) -> None:
    # Another place in the batch is another lane.
    for first in {0, min(3, MOST - size)}:
        rows = slice(first, first + size)
        assert_rows(run(rows, lanes), whole, rows)


@pytest.mark.parametrize("threads", [2, 3, 16])
def test_threads_change_nothing(whole: xr.Dataset, threads: int) -> None:
    assert_rows(run(slice(0, MOST), 4, threads), whole, slice(0, MOST))


def test_a_single_run_is_the_first_row_of_a_batch() -> None:
    plant = Noisy(Encoder(RigidBodyPlant(ARM, Sine(1.0, 5.0)), 16), 1e-5, seed=3)
    arguments = (plant, GPI(ARM, DT), Bezier([0.0, 0.1, 0.0], [0.2, 0.2, 0.1], 0.05), 0.05)
    one = compiled(*arguments)
    many = compiled(*arguments, q0=np.tile([0.0, 0.1, 0.0], (9, 1)))
    for name in SAMPLED:
        np.testing.assert_array_equal(one[name], many[name][0])


def test_it_is_what_numpy_does(whole: xr.Dataset) -> None:
    rows = slice(0, 9)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="omega_c", category=ArmgpiWarning)
        expected = simulate(*batch(rows), signals=True)
    # The counts of 14 to 18 bits are the same at every sample of so short a run.
    np.testing.assert_array_equal(expected["q_measured"], whole["q_measured"][rows])
    np.testing.assert_allclose(whole["q"][rows], expected["q"], rtol=0, atol=1e-12)


# --- Divergence --------------------------------------------------------------------------------------


def wild(rows: Any, seconds: float = 0.3) -> tuple[Any, ...]:
    """Return rollouts of which some have gains that no sampled loop stands."""
    gains = np.full((9, 3), 20.0)
    gains[[2, 5, 8]] = [[900.0], [1500.0], [2500.0]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        controller = GPI(ARM, DT, FixedGains(gains[rows]), effort=1e6)
    plant = RigidBodyPlant(ARM)
    return plant, controller, Bezier([0.0, 0.1, 0.0], [0.2, 0.3, 0.1], 0.1), seconds


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("lanes", [1, 4, 8])
def test_who_diverges_leaves_alone(lanes: int, every: int) -> None:
    loop = wild(slice(None))
    expected = simulate(*loop, signals=True, record_every=every)
    got = compiled(*loop, signals=True, lanes=lanes, record_every=every)
    np.testing.assert_array_equal(got["status"], [0, 0, 1, 0, 0, 1, 0, 0, 1])
    np.testing.assert_array_equal(got["status"], expected["status"])
    np.testing.assert_array_equal(got["t_end"], expected["t_end"])
    assert len(set(got["t_end"].values[[2, 5, 8]])) == 3
    for name in expected.data_vars:
        np.testing.assert_array_equal(np.isnan(got[name]), np.isnan(expected[name]), err_msg=str(name))
    calm = [0, 1, 3, 4, 6, 7]
    np.testing.assert_allclose(got["q_ref"], expected["q_ref"], rtol=0, atol=1e-13)
    for name in SAMPLED:
        np.testing.assert_allclose(got[name][calm], expected[name][calm], rtol=1e-9, atol=1e-10)
    alone = compiled(*wild(calm), signals=True, record_every=every)
    for name in SAMPLED:
        np.testing.assert_array_equal(alone[name], got[name][calm])


@pytest.mark.parametrize("threads", [1, 2])
def test_when_all_diverge_the_run_ends(threads: int) -> None:
    loop = wild([2, 5, 8] * 6, seconds=1e5)
    # NumPy's run of the same: it ends as well, all but at once.
    expected = simulate(*loop, record_every=10**6)
    got = compiled(*loop, record_every=10**6, lanes=4, threads=threads)
    assert (got["status"] == Status.DIVERGED).all()
    np.testing.assert_array_equal(got["t_end"], expected["t_end"])


def test_what_is_left_when_all_diverge_does_not_depend_on_how_many_samples_are_taken_at_once() -> None:
    loop = wild([2, 5, 8], seconds=2.0)
    runs = [simulate(*loop), compiled(*loop)]
    last = runs[0]["t_end"].values.max()
    for run in runs:
        for name in SAMPLED:
            assert np.isnan(run[name].sel(time=slice(last, None))).all(), name
        assert np.isfinite(run["q_ref"].sel(time=slice(0.0, last - 0.5 * DT))).all()


@pytest.mark.parametrize(
    "bad", [{"v0": [[0.0] * 3, [1e30] * 3]}, {"divergence": 1e-9}, {"v0": [[0.0] * 3, [1e9] * 3]}]
)
def test_divergence_at_once(bad: Any) -> None:
    loop = (RigidBodyPlant(ARM), GPI(ARM, DT), Bezier([0.0, 0.1, 0.0], [0.2, 0.3, 0.1], 0.1), 0.02)
    expected, got = simulate(*loop, **bad), compiled(*loop, **bad)
    np.testing.assert_array_equal(got["status"], expected["status"])
    np.testing.assert_array_equal(got["t_end"], expected["t_end"])
    np.testing.assert_array_equal(np.isnan(got["q"]), np.isnan(expected["q"]))
    assert (got["status"] == Status.DIVERGED).any()


# --- Ctrl-C, memory, time ----------------------------------------------------------------------------


class Clock(Waypoints):
    """A reference that NumPy works out, and that is interrupted on the way."""

    symbolic = False
    until = np.inf

    def at(self, t: Any) -> Any:
        if np.size(t) > 1 and np.min(t) >= self.until:
            raise KeyboardInterrupt
        return super().at(t)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupted_run_is_the_beginning_of_a_whole_one(threads: int) -> None:
    reference = Clock([0.1 * OWN, 0.2 * OWN], 0.2)
    loop = (RigidBodyPlant(ARM), GPI(ARM, DT), reference, 0.4)
    whole = compiled(*loop, record_every=3)
    with pytest.MonkeyPatch.context() as patch:
        times = reference.at

        def stops(t: Any) -> Any:
            # The check before the run looks at the whole of it, the run at stretches, as long as time allows.
            if np.ndim(t) == 1 and t[-1] >= 0.1 and len(t) < 400:
                raise KeyboardInterrupt
            return times(t)

        patch.setattr(reference, "at", stops)
        with pytest.warns(ArmgpiWarning, match="interrupted at t = "):
            part = compiled(*loop, record_every=3, lanes=4, threads=threads, partial=True)
    assert (part["status"] == Status.INTERRUPTED).all()
    (end,) = set(part["t_end"].values.tolist())
    assert 0.0 < end <= 0.1
    samples = -(-round(end / DT) // 3)
    assert part.sizes["time"] == samples
    for name in SAMPLED:
        np.testing.assert_array_equal(part[name], whole[name][:, :samples])


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.skipif(os.name != "posix", reason="sends itself a signal")
def test_ctrl_c(threads: int) -> None:
    arguments = (RigidBodyPlant(ARM), GPI(ARM, DT), Bezier([0.0, 0.1, 0.0], [0.2, 0.3, 0.1], 0.1))
    rows = {"q0": np.tile([0.0, 0.1, 0.0], (MOST, 1)), "record_every": 10**5}
    compiled(*arguments, 0.01, **rows, lanes=4)  # so that it runs when the signal comes
    timer = threading.Timer(0.4, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.warns(ArmgpiWarning, match="interrupted at t = "):
        part = compiled(*arguments, 1e6, **rows, lanes=4, threads=threads, partial=True)
    timer.join()
    assert (part["status"] == Status.INTERRUPTED).all()
    end = float(part["t_end"][0])
    assert 0.0 < end < 1e6
    assert part.sizes["time"] == -(-round(end / DT) // 10**5)
    assert np.isfinite(part["q"]).all()


def test_memory_is_what_is_recorded() -> None:
    rail = sled()
    loop = (RigidBodyPlant(rail), PIDInversion(rail, DT), Hold([0.5]))
    compiled(*loop, 0.1)
    tracemalloc.start()
    try:
        run = compiled(*loop, 500.0, record_every=1000, q0=np.linspace(0.0, 1.0, 8)[:, None])
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (run["status"] == Status.FINISHED).all()
    # 8 rollouts of 500,000 samples have 4e6 numbers for each variable; 4e3 of them are recorded.
    recorded = 8 * 7 * 501 * 8
    assert peak < 4 * recorded + 4e6


def test_runs_may_run_at_the_same_time() -> None:
    loop = batch(slice(0, 5))
    results: list[Any] = []
    with warnings.catch_warnings(), machine(8):
        warnings.simplefilter("ignore", ArmgpiWarning)
        expected = simulate(*loop, backend="compiled")
        workers = [
            threading.Thread(target=lambda: results.append(simulate(*loop, backend="compiled")))
            for _ in range(4)
        ]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
    assert len(results) == 4
    for result in results:
        np.testing.assert_array_equal(result["q"], expected["q"])


def test_a_loop_is_not_changed_by_being_traced() -> None:
    loop = batch(slice(0, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        before = simulate(*loop)
        compiled(*loop)
        assert_close(before, simulate(*loop), 0.0)


def test_a_run_taken_in_pieces_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = batch(slice(0, 9))
    whole = run(slice(0, 9), 8)
    take = CompiledRun.take

    def one(self: CompiledRun, count: int) -> int:
        taken = take(self, 1)
        self.chunk = 1
        return taken

    monkeypatch.setattr(CompiledRun, "take", one)
    assert loop
    np.testing.assert_array_equal(run(slice(0, 9), 8)["q"], whole["q"])


@pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("clang")), reason="needs GCC and Clang")
def test_compilers_agree_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = []
    for name in ("gcc", "clang"):
        monkeypatch.setenv("CC", name)
        runs += [compiled(*batch(slice(0, 9)), lanes=lanes, signals=True) for lanes in (1, 8)]
    for run in runs[1:]:
        for variable in run.data_vars:
            expected = runs[0][variable].values
            np.testing.assert_array_equal(run[variable].values, expected, err_msg=str(variable))


def test_lanes_can_be_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = []
    for lanes in ("1", "2", "4", "8"):
        monkeypatch.setenv("ARMGPI_LANES", lanes)
        runs.append(compiled(*batch(slice(0, 3))))
    for run in runs[1:]:
        np.testing.assert_array_equal(run["q"].values, runs[0]["q"].values)
    monkeypatch.setenv("ARMGPI_LANES", "3")
    with pytest.warns(ArmgpiWarning, match="running by NumPy: ARMGPI_LANES is '3', expected 1, 2, 4 or 8"):
        simulate(*batch(slice(0, 3)), backend="compiled")
