"""Whatever takes the samples of a loop, and in whatever pieces, the samples are the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgpi import GPI, Bezier, Delayed, Encoder, Hold, PIDInversion, RigidBodyPlant, Robot, simulate
from armgpi.base.arrays import Array
from armgpi.errors import RolloutError
from armgpi.hardware.export.files import record
from armgpi.loop.closed_loop import ClosedLoop
from armgpi.loop.rollout import Recording, Status
from armgpi.loop.runner import DIVERGENCE, NumPyRun, drive, in_control

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
