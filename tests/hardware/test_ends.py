"""Two ends of a wire: what comes over it, what is missed, and what an arm does in silence.

Here the clock is simulated. So nothing depends on how busy the machine is.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armgpi
from armgpi import (
    GPI,
    Bezier,
    Encoder,
    FixedGains,
    PIDInversion,
    RigidBodyPlant,
    Robot,
    Saturated,
    Supervisor,
    simulate,
)
from armgpi.errors import ArmgpiError
from armgpi.hardware.realtime import Injected, Watchdog, run
from armgpi.hardware.realtime.datagram import END, SAMPLE, TORQUE, Datagram, unpack
from armgpi.hardware.realtime.ends import ArmEnd, ControllerEnd, supervise
from armgpi.loop.rollout import Status

DT = 1e-3
ARMS = {name: Robot.load(name) for name in ("anthropomorphic3", "ur5")}
ARM = ARMS["anthropomorphic3"]
#: What a fault of the wire may cost, as a factor on the error of the simulation.
FACTOR = 1.05
#: In the middle of the motion.
MOVING = 0.8


def parts(name: str = "anthropomorphic3") -> tuple[Any, Any, Any]:
    """Return plant, controller and reference: a move of 0.5 rad in 1.2 s, which ends at 1.4 s."""
    robot = ARMS[name]
    start = robot.middle()
    plant = Encoder(Saturated(RigidBodyPlant(robot)), 18)
    move = Bezier(start, start + 0.5, duration=1.2, t_start=0.2)
    return plant, GPI(robot, DT, FixedGains(20.0)), move


def looped(name: str = "anthropomorphic3", seconds: float = 1.6, **options: Any) -> Any:
    return run(*parts(name), seconds, clock="simulated", **options)


@cache
def without_faults(name: str) -> Any:
    return simulate(*parts(name), 1.6, progress=False)


# --- Datagrams -----------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(3,), (2, 3)])
def test_a_datagram_comes_back_as_it_was(shape: tuple[int, ...]) -> None:
    sent = Datagram(SAMPLE, 2**40, 1.5, np.arange(np.prod(shape), dtype=float).reshape(shape))
    got = unpack(sent.pack(), 3)
    assert got is not None
    assert got[:3] == sent[:3]
    np.testing.assert_array_equal(got.values, sent.values)
    assert got.applied is None
    echoed = unpack(sent._replace(applied=np.array([1.0, 2.0, 3.0])).pack(), 3)
    assert echoed is not None
    np.testing.assert_array_equal(echoed.applied, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(echoed.values, sent.values)


@pytest.mark.parametrize(
    ("bits", "exported"), [(14, False), (15, True), (16, False), (17, True), (18, False)]
)
def test_the_arm_sees_no_torque_change_faster_than_its_rate(bits: int, exported: bool) -> None:
    if exported:
        pytest.importorskip("casadi", reason="casadi writes the C")
    robot = ARM.with_gravity((0.0, 0.0, 0.0))
    start, rate = robot.middle(), 50.0
    plant = Encoder(Saturated(RigidBodyPlant(robot)), bits)
    move = Bezier(start, start + 0.5, duration=0.5, t_start=0.05)
    law, lossy = GPI(robot, DT, FixedGains(20.0)), Injected(loss=0.1)
    given = Supervisor(torque_rate=rate, missed=40)
    done = run(plant, law, move, 0.6, clock="simulated", injected=lossy, supervisor=given, exported=exported)
    applied = done.rollout["tau_command"].values
    assert done.filled > 10
    assert np.abs(np.diff(applied, axis=0)).max() <= rate * DT * (1.0 + 1e-9)
    assert np.abs(np.diff(applied, axis=0)).max() > 0.9 * rate * DT


@given(st.binary(max_size=120))
def test_anything_else_counts_as_not_received(data: bytes) -> None:
    assert unpack(data, 3) is None


@given(st.integers(0, 47), st.integers(0, 255))
def test_a_damaged_datagram_is_none_or_has_finite_numbers(place: int, byte: int) -> None:
    data = bytearray(Datagram(TORQUE, 7, 0.1, np.array([1.0, 2.0, 3.0])).pack())
    data[place] = byte
    got = unpack(bytes(data), 3)
    assert got is None or np.isfinite(got.values).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_and_other_arms_are_not_received(bad: float) -> None:
    assert unpack(Datagram(TORQUE, 7, 0.1, np.array([1.0, bad, 3.0])).pack(), 3) is None
    assert unpack(Datagram(END, 7, 0.1, np.zeros(4)).pack(), 3) is None


# --- The controller's end ------------------------------------------------------------------------


def test_without_faults_the_loop_is_the_simulation_bit_for_bit() -> None:
    expected = simulate(*parts(), 0.4, progress=False, supervisor=Supervisor(missed=50))
    outcome = looped(seconds=0.4)
    for name in ("q", "v", "q_measured", "tau_command", "tau", "q_ref"):
        np.testing.assert_array_equal(outcome.rollout[name], expected[name])
    assert outcome.missed == outcome.filled == 0
    assert outcome.fault == ("run", "none", None)


def test_velocities_go_over_the_wire_for_those_who_measure_them() -> None:
    plant, _, move = parts()
    pid = PIDInversion(ARM, DT)
    supervisor = Supervisor()
    expected = simulate(plant, pid, move, 0.3, progress=False, supervisor=supervisor)
    outcome = run(plant, pid, move, 0.3, clock="simulated", supervisor=supervisor)
    np.testing.assert_array_equal(outcome.rollout["q"], expected["q"])


def test_exported_c_is_a_controller_like_another() -> None:
    pytest.importorskip("casadi")
    first, second = (looped(seconds=0.3, exported=wanted).rollout["q"] for wanted in (False, True))
    np.testing.assert_allclose(first, second, rtol=0.0, atol=1e-12)


def test_what_was_missed_is_filled_along_a_straight_line() -> None:
    _, law, move = parts()
    q = ARM.middle() + np.linspace(0.0, 1e-4, 5)[:, None]
    whole, holes = (ControllerEnd(supervise(law, None, False), move) for _ in range(2))
    for k in range(5):
        every = whole.receive(Datagram(SAMPLE, k, k * DT, q[k]))
    for k in (0, 4):
        some = holes.receive(Datagram(SAMPLE, k, k * DT, q[k]))
    assert every is not None
    assert some is not None
    assert holes.filled == 3
    np.testing.assert_allclose(some.values, every.values, rtol=1e-9)


def test_a_sample_twice_has_one_answer_and_an_old_one_none() -> None:
    _, law, move = parts()
    end = ControllerEnd(supervise(law, None, False), move)
    samples = [Datagram(SAMPLE, k, k * DT, ARM.middle()) for k in range(3)]
    answers = [end.receive(sample) for sample in samples]
    assert end.receive(samples[2]) is answers[2]
    assert end.receive(samples[1]) is None


# --- Faults --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize(
    "injected",
    [Injected(loss=0.2), Injected(outage=(MOVING, 0.02)), Injected(stall=(MOVING, 0.02))],
    ids=["loss", "outage", "stall"],
)
def test_loss_and_short_silence_hardly_cost_anything(name: str, injected: Injected) -> None:
    simulated = without_faults(name)
    report = looped(name, injected=injected).report(simulated)
    assert report["missed"] >= 20
    assert all(ratio <= FACTOR for ratio in report["error_ratio"].values())
    assert not report["watchdog"]["latched"]


@pytest.mark.parametrize("name", ARMS)
def test_without_its_controller_the_arm_stops_by_itself(name: str) -> None:
    outcome = looped(name, injected=Injected(kill=MOVING))
    last = round(MOVING / DT) - 1
    assert outcome.fired[0] - last <= 12
    assert outcome.latched
    assert outcome.travel is not None
    assert outcome.travel <= 0.1
    # And it stands: what is left is how slowly it comes to rest.
    assert float(np.abs(outcome.rollout["v"][-1]).max()) < 1e-3


def test_what_else_it_could_do_lets_it_travel_farther() -> None:
    travels = {
        reaction: looped(injected=Injected(kill=MOVING), watchdog=Watchdog(12, reaction)).travel
        for reaction in ("damping", "gravity", "zero")
    }
    assert 2.0 * travels["damping"] < travels["gravity"] < travels["zero"]


def test_the_watchdog_brakes_all_joints_less_where_one_has_not_the_torque() -> None:
    robot = ARMS["ur5"]
    q, v = robot.middle(), np.full(robot.n, 2.0)
    arm = ArmEnd(Saturated(RigidBodyPlant(robot)), robot, DT, Watchdog(1, ramp=0.0), q, v, velocity=False)
    brake = arm.advance(None) - robot.gravity(q)
    asked = robot.mass_matrix(q) @ (-60.0 * v)
    assert (np.abs(asked) > robot.limits.effort).any()
    # The same way as asked for, as far as the first motor goes.
    share = brake @ asked / (asked @ asked)
    np.testing.assert_allclose(brake, share * asked, rtol=1e-9, atol=1e-9)
    assert 0.0 < share < 1.0
    np.testing.assert_allclose(np.max(np.abs(brake + robot.gravity(q)) / robot.limits.effort), 1.0, rtol=1e-9)


def test_an_arm_that_has_given_up_does_not_listen_any_more() -> None:
    outcome = looped(injected=Injected(stall=(MOVING, 0.3)))
    assert outcome.latched
    assert not outcome.answered[round(MOVING / DT) :].any()


def test_a_silence_that_is_too_long_is_a_fault_of_the_controller_too() -> None:
    # The arm bears more here than the supervisor allows.
    outcome = looped(
        injected=Injected(outage=(MOVING, 0.04)),
        watchdog=Watchdog(100, latch=1.0),
        supervisor=Supervisor(missed=20),
    )
    assert outcome.fault is not None
    assert outcome.fault.reason == "late"


def test_torques_are_taken_in_their_order() -> None:
    plant, _, _ = parts()
    arm = ArmEnd(plant, ARM, DT, Watchdog(), ARM.middle(), np.zeros(3), velocity=False)
    new, old = (Datagram(TORQUE, number, 0.0, np.full(3, float(number))) for number in (5, 3))
    np.testing.assert_array_equal(arm.advance(new), new.values)
    np.testing.assert_array_equal(arm.advance(old), new.values)
    assert arm.silent == 1


def test_the_same_seed_loses_the_same() -> None:
    first, second, other = (looped(seconds=0.2, injected=Injected(loss=0.1, seed=seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.answered, second.answered)
    assert not np.array_equal(first.answered, other.answered)


def test_a_report_is_plain_data_and_compares_as_long_as_it_ran() -> None:
    report = looped(seconds=0.2, injected=Injected(loss=0.1)).report(without_faults("anthropomorphic3"))
    assert report["error_ratio"]["rms"] == pytest.approx(1.0, abs=0.05)
    assert report["samples"] == 200
    assert report["lateness_us"] is None  # by a simulated clock nobody is late
    assert report["injected"]["loss"] == 0.1


def test_a_run_that_diverges_says_so() -> None:
    plant = Encoder(RigidBodyPlant(ARM, armgpi.Step(1e6)), 18)
    outcome = run(plant, *parts()[1:], 0.2, clock="simulated")
    assert int(outcome.rollout["status"]) == Status.DIVERGED


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: Injected(loss=1.0), "loss"),
        (lambda: Injected(outage=(1.0,)), "outage"),
        (lambda: Injected(stall=(-1.0, 0.1)), "stall"),
        (lambda: Injected(kill=np.nan), "kill"),
        (lambda: Injected(seed=-1), "seed"),
        (lambda: Watchdog(0), "samples"),
        (lambda: Watchdog(12, "brake"), "reaction"),
        (lambda: looped(injected=0.2), "injected"),
        (lambda: looped(watchdog=12), "watchdog"),
        (lambda: looped(model="ur5"), "model"),
        (lambda: looped(policy="rr"), "policy"),
        (lambda: looped(exported=1), "exported"),
        (lambda: looped(supervisor=20), "supervisor"),
        (lambda: looped(seconds=0.0), "t_final"),
        (lambda: run(*parts(), 1.0, clock="atomic"), "clock"),
        (lambda: looped(q0=np.zeros((2, 3))), "plant"),
    ],
)
def test_bad_arguments_are_named(call: Any, named: str) -> None:
    with pytest.raises(ArmgpiError, match=named):
        call()
