"""Whatever takes the samples of a loop, and in whatever pieces, the samples are the same."""

from __future__ import annotations

import math
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgpi import (
    GPI,
    Bezier,
    Delayed,
    Encoder,
    Hold,
    PIDInversion,
    RigidBodyPlant,
    Robot,
    Step,
    Supervised,
    Supervisor,
    simulate,
)
from armgpi.base.arrays import Array
from armgpi.codegen import build
from armgpi.errors import BackendError, RolloutError
from armgpi.hardware.export import recording
from armgpi.hardware.export.files import record
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.log import ArmLog, replay
from armgpi.loop.rollout import Recording, Status
from armgpi.loop.runner import DIVERGENCE, NumPyRun, drive, in_control
from armgpi.plants.plant import Plant

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
MOVE = Bezier([0.0, 0.1, 0.0], [0.2, 0.3, 0.1], 0.05)
PLANT = Delayed(Encoder(RigidBodyPlant(ARM), 16), 1)
STEPS = 60


def begun(steps: int = STEPS) -> NumPyRun:
    """Return a run in which nothing was taken yet."""
    loop = ClosedLoop(PLANT, GPI(ARM, DT), MOVE)
    return NumPyRun(loop, loop.init(), Recording.new((3,), steps, DT, 1))


def recorded(run: NumPyRun) -> dict[str, Array]:
    """Return what was recorded."""
    return run.recording.variables


WHOLE = begun()
drive(WHOLE, STEPS)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, 20), min_size=1, max_size=6))
def test_samples_do_not_depend_on_the_pieces_that_they_are_taken_in(pieces: list[int]) -> None:
    run = begun()
    counted: list[int] = []
    for piece in pieces:
        run.take(min(piece, STEPS - run.done)) if run.done < STEPS else None
    run.chunk = pieces[-1]
    taken = run.done
    drive(run, STEPS, counted.append)
    assert taken + sum(counted) == STEPS
    for name, values in recorded(WHOLE).items():
        np.testing.assert_array_equal(recorded(run)[name], values, err_msg=name)


@pytest.mark.parametrize("controller", [GPI(ARM, DT), PIDInversion(ARM, DT)], ids=["gpi", "pid"])
def test_a_log_has_the_numbers_of_the_rollout(controller: GPI | PIDInversion) -> None:
    rollout = simulate(PLANT, controller, MOVE, STEPS * DT)
    log = record(PLANT, controller, MOVE, STEPS * DT)
    assert "diverged" not in log.header
    for name, values in (("q_measured", log.inputs["q_measured"]), ("tau_command", log.tau)):
        np.testing.assert_array_equal(values, rollout[name][:STEPS])
    target = MOVE.at(np.arange(STEPS) * np.float64(DT))
    for name, wanted in target._asdict().items():
        np.testing.assert_array_equal(log.inputs[f"{name}_ref"], wanted)
    # What it was given makes the torque that it answered, velocities included.
    state = ClosedLoop(PLANT, controller, MOVE).init().plant
    np.testing.assert_array_equal(log.inputs["v_measured"][0], PLANT.measure(state).v)


def _has_compiler() -> bool:
    try:
        build.compiler()
    except BackendError:
        return False
    return find_spec("casadi") is not None


compiled = pytest.mark.skipif(not _has_compiler(), reason="there is no C compiler, or no CasADi")


def _logged(controller: Supervised, seconds: float, backend: str, plant: Plant = PLANT) -> ArmLog:
    """Return a log by a backend; generated code is there in time, however long that takes."""
    move = Bezier([0.0, 0.1, 0.0], [0.2, 0.3, 0.1], 0.8 * seconds)
    return record(plant, controller, move, seconds, backend)


@compiled
@pytest.mark.parametrize("seconds", [0.032, 0.2, 0.2005])
def test_a_log_by_generated_code_has_the_torques_of_python(
    seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "_SAMPLE", math.inf)
    controller = Supervised(GPI(ARM, DT))
    slow, fast = (_logged(controller, seconds, backend) for backend in ("numpy", "auto"))
    assert fast.header["inputs"] == ["q_measured", "q_ref", "v_ref", "a_ref"]  # it was generated code
    for name in ("q_ref", "v_ref", "a_ref"):
        np.testing.assert_array_equal(fast.inputs[name], slow.inputs[name])
    np.testing.assert_allclose(fast.inputs["q_measured"], slow.inputs["q_measured"], rtol=0.0, atol=1e-12)
    for name in ("number", "event", "status", "reason", "joint", "elapsed"):
        np.testing.assert_array_equal(fast.rows[name], slow.rows[name])
    again = replay(fast, controller)  # sample after sample, as it is in the loop
    assert again.samples == len(slow.tau) == round(seconds / DT)
    assert (again.difference <= 1e-12 * np.abs(fast.tau).max(axis=0)).all()
    assert again.status is None


def test_a_law_that_python_does_not_repeat_is_logged_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "_SAMPLE", math.inf)
    controller = Supervised(GPI(ARM, DT))
    tried: list[float] = []

    def other(*given: Any) -> Any:
        tau, reports, ends = kept(*given)
        tried.append(tau[70, 1])
        tau[70, 1] += 1e-3
        return tau, reports, ends

    kept = recording._repeat
    monkeypatch.setattr(recording, "_repeat", other)
    log, true = _logged(controller, 0.2, "auto"), _logged(controller, 0.2, "numpy")
    assert len(tried) == 1
    assert "v_measured" in log.inputs
    np.testing.assert_array_equal(log.tau, true.tau)


def test_a_law_for_one_row_alone_is_logged_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    class Single(GPI):
        def step(self, measurement, target, state):  # type: ignore[no-untyped-def]
            if measurement.q.ndim > 1:
                raise TypeError("one row")
            return super().step(measurement, target, state)

    monkeypatch.setattr(recording, "_SAMPLE", math.inf)
    assert "v_measured" in _logged(Supervised(Single(ARM, DT)), 0.1, "auto").inputs


@compiled
def test_a_fault_is_in_the_log_by_generated_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "_SAMPLE", math.inf)
    plant = Delayed(Encoder(RigidBodyPlant(ARM, [Step([0.0, 10.0, 0.0], 0.05)]), 16), 1)
    controller = Supervised(GPI(ARM, DT), Supervisor(following=0.05))
    slow, fast = (_logged(controller, 0.3, backend, plant) for backend in ("numpy", "auto"))
    assert fast.fault == slow.fault
    assert "FOLLOWING" in str(fast.fault)
    assert "v_measured" not in fast.inputs
    assert (replay(fast, controller).difference <= 1e-12 * np.abs(fast.tau).max()).all()


def test_a_log_ends_where_the_rollout_does() -> None:
    class Turning(GPI):
        def step(self, measurement, target, state):  # type: ignore[no-untyped-def]
            return super().step(measurement, target, state)._replace(tau=np.array([5.0, 0.0, 0.0]))

    parts = RigidBodyPlant(ARM), Turning(ARM, DT), Hold(np.zeros(3)), 10.0
    rollout, log = simulate(*parts), record(*parts)
    assert int(rollout["status"]) == Status.DIVERGED
    assert log.header["diverged"] == float(rollout["t_end"]) == pytest.approx(len(log.tau) * DT)
    assert np.isfinite(log.tau).all()


def test_nothing_to_log_is_said() -> None:
    class Lost(GPI):
        def step(self, measurement, target, state):  # type: ignore[no-untyped-def]
            return super().step(measurement, target, state)._replace(tau=np.full(3, np.nan))

    with pytest.raises(RolloutError, match="the first sample is out of control"):
        record(RigidBodyPlant(ARM), Lost(ARM, DT), MOVE, 0.1)


@given(st.integers(0, 2), st.sampled_from([np.nan, np.inf, -np.inf]), st.sampled_from(["error", "v", "tau"]))
def test_one_number_that_is_not_finite_is_a_divergence(joint: int, wrong: float, where: str) -> None:
    given_ = {name: np.zeros((4, 2, 3)) for name in ("error", "v", "tau")}
    given_[where][2, 1, joint] = wrong
    good = in_control(**given_, divergence=1.0)
    assert not good[2, 1]
    assert good.sum() == good.size - 1


def test_the_bound_itself_is_no_divergence() -> None:
    zero = np.zeros(3)
    assert in_control(np.full(3, -DIVERGENCE), zero, zero, DIVERGENCE)
    assert not in_control(np.array([0.0, 0.0, np.nextafter(DIVERGENCE, 11.0)]), zero, zero, DIVERGENCE)
