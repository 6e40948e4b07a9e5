"""The supervisor: what it takes for a fault, how the arm stops, and that C does the same."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import machines
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armgpi
from armgpi import (
    GPI,
    Bezier,
    FullState,
    Measurement,
    PIDInversion,
    RigidBodyPlant,
    Robot,
    Saturated,
    Supervised,
    Supervisor,
    Target,
    simulate,
)
from armgpi.errors import ArmgpiError
from armgpi.supervisor import COUNTED, FaultReport, Reason, State, Watch

DT = 1e-3

ARM = Robot.load("anthropomorphic3")
Q = np.array([0.1, 0.4, -0.5])
REST = np.zeros(3)
#: What a fault does to a sample: k samples after it began, measured and reference positions -> the same.
Fault = Callable[[int, Any, Any], tuple[Any, Any]]


class Course(NamedTuple):
    """What an arm did from a fault on."""

    q: Any
    v: Any
    tau: Any
    reports: list[FaultReport]

    @property
    def travel(self) -> float:
        return float(np.abs(self.q - self.q[0]).max())

    @property
    def reasons(self) -> set[str]:
        return {report.reason for report in self.reports}


def moving(robot: Robot, speed: float) -> Bezier:
    """A move of every joint whose fastest moment, in its middle, has this speed."""
    middle = robot.middle()
    step = np.minimum(0.4, 0.4 * (robot.limits.upper - middle))
    duration = 1.0
    peak = np.abs(Bezier(middle, middle + step, duration).at(np.array([0.5])).v).max()
    return Bezier(middle, middle + step, duration * peak / speed) if speed else Bezier(middle, middle, 1.0)


@cache
def begun(robot: Robot, speed: float, supervised: Any) -> tuple[Any, int, Any]:
    """A loop, the sample in the middle of its move, and its state there: all faults begin from it."""
    reference = moving(robot, speed)
    supervised = Supervised(GPI(robot, DT)) if supervised is None else supervised
    loop: Any = armgpi.ClosedLoop(Saturated(RigidBodyPlant(robot)), supervised, reference)
    begin, state = round(0.5 * reference.duration / DT), loop.init()
    for _ in range(begin):
        state = loop.step(state).state
    return loop, begin, state


def course(
    robot: Robot, fault: Fault, speed: float = 0.75, seconds: float = 0.5, supervised: Any = None
) -> Course:
    """Let a fault happen in the middle of a move."""
    loop, begin, (_, arm, state) = begun(robot, speed, supervised)
    plant, supervised, reference = loop.plant, loop.controller, loop.reference
    rows: list[Any] = []
    for k in range(round(seconds / DT)):
        target, measured = reference.at((begin + k) * DT), plant.measure(arm)
        truth = plant.true_state(arm)
        q, q_ref = fault(k, measured.q.copy(), target.q.copy())
        tau, state = supervised.step(Measurement(q), target._replace(q=q_ref), state)
        arm = plant.step(tau, arm, DT)
        rows.append((truth.q, truth.v, tau, supervised.report(state)))
    qs, vs, taus, reports = zip(*rows, strict=True)
    return Course(np.array(qs), np.array(vs), np.array(taus), list(reports))


def at_joint(j: int, change: Callable[[float], float]) -> Callable[[Any], Any]:
    def changed(q: Any) -> Any:
        q[j] = change(q[j])
        return q

    return changed


def frozen() -> Fault:
    held: list[float] = []

    def fault(k: int, q: Any, q_ref: Any) -> tuple[Any, Any]:
        held.append(q[1])
        q[1] = held[0]
        return q, q_ref

    return fault


#: Single faults: name -> (makes one, reason).
FAULTS: dict[str, tuple[Callable[[], Fault], str]] = {
    "reference NaN": (lambda: lambda k, q, r: (q, r * np.nan), "reference"),
    "reference jumps": (lambda: lambda k, q, r: (q, r + 0.3), "reference"),
    "reference infinite once": (lambda: lambda k, q, r: (q, r + np.inf if k == 0 else r), "reference"),
    "one NaN": (lambda: lambda k, q, r: (q * np.nan if k == 0 else q, r), "not_finite"),
    "NaN of a joint": (lambda: lambda k, q, r: (at_joint(1, lambda _: np.nan)(q), r), "not_finite"),
    "NaN for good": (lambda: lambda k, q, r: (q * np.nan, r), "not_finite"),
    "1e6 rad once": (
        lambda: lambda k, q, r: (at_joint(1, lambda x: x + 1e6)(q) if k == 0 else q, r),
        "not_finite",
    ),
    "a spike of 1 rad": (
        lambda: lambda k, q, r: (at_joint(1, lambda x: x + 1.0)(q) if k == 0 else q, r),
        "jump",
    ),
    "an offset for good": (lambda: lambda k, q, r: (at_joint(1, lambda x: x + 0.5)(q), r), "jump"),
    "frozen": (frozen, "frozen"),
}
ARMS = ["anthropomorphic3", *(name for name in ("ur5", "panda") if name in armgpi.robots.names())]


@cache
def arm(name: str, gravity: str = "arm") -> Robot:
    lock = [joint for joint in ("panda_finger_joint1", "panda_finger_joint2") if name == "panda"]
    robot = Robot.load(name, lock=lock)
    return robot.with_gravity((0.0, 0.0, 0.0)) if gravity == "robot" else robot


@pytest.mark.parametrize("name", ARMS)
def test_a_reference_that_is_nan_ends_at_rest_within_half_a_second(name: str) -> None:
    found = course(arm(name), FAULTS["reference NaN"][0](), 0.75, 0.6)
    assert found.reports[-1].status == "hold"
    assert found.travel < 0.05
    assert np.abs(found.v[500:]).max() < 0.01
    assert {report.status for report in found.reports} == {"stopping", "hold"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "speed"),
    [
        pytest.param(name, speed, marks=() if bool(speed) == bool(i % 2) else pytest.mark.search)
        for i, name in enumerate(ARMS)
        for speed in (0.0, 0.75)
    ],
)
def test_after_any_single_fault_an_arm_without_gravity_hardly_moves(name: str, speed: float) -> None:
    most = 0.05 if speed else 0.01
    for label, (make, reason) in FAULTS.items():
        found = course(arm(name, "robot"), make(), speed)
        assert found.travel < most, label
        # At rest a frozen sensor says the truth.
        assert found.reasons <= {"none", reason}, label
        assert reason in found.reasons or (reason == "frozen" and not speed), label
        assert np.isfinite(found.tau).all(), label


def test_torque_keeps_its_rate_in_every_state() -> None:
    rate = 300.0
    for make, _ in FAULTS.values():
        for on_fault in ("brake", "hold", "zero"):
            supervised = Supervised(GPI(ARM, DT), Supervisor(torque_rate=rate, on_fault=on_fault, missed=3))
            found = course(ARM, make(), 0.75, 0.05, supervised)
            steps = np.abs(np.diff(found.tau, axis=0))
            assert steps.max() <= rate * DT * (1.0 + 1e-9)
    # From the start on, which ramps: the law waits until its torque is reached, and winds nothing up.
    supervised = Supervised(GPI(ARM, DT), Supervisor(torque_rate=rate))
    state = supervised.init(Measurement(Q), Target(Q, REST, REST))
    taus = [REST]
    while supervised.report(state).status == "init":
        tau, state = supervised.step(Measurement(Q), Target(Q, REST, REST), state)
        taus.append(tau)
    assert np.abs(np.diff(taus, axis=0)).max() <= rate * DT * (1.0 + 1e-9)
    assert len(taus) == 1 + np.ceil(np.abs(ARM.gravity(Q)).max() / (rate * DT))
    np.testing.assert_allclose(taus[-1], ARM.gravity(Q), atol=1e-9)
    # A reset goes on from the last torque, a new start does not.
    again = supervised.reset(Measurement(Q), Target(Q, REST, REST), state)
    np.testing.assert_array_equal(again.supervisor.tau, taus[-1])


@pytest.mark.parametrize("geared", [False, True])
def test_a_stop_builds_up_and_goes_as_the_rate_of_torque_and_gears_allow(geared: bool) -> None:
    rate, robot = 200.0, ARM.with_armature(0.01) if geared else ARM
    given = Supervisor() if geared else Supervisor(torque_rate=rate)
    supervised = Supervised(GPI(robot, DT), given)
    loop, begin, (_, arm, state) = begun(robot, 0.75, supervised)
    speeds, heaviest = [], np.zeros(3)
    for k in range(500):
        measured, target = loop.plant.measure(arm), loop.reference.at((begin + k) * DT)
        tau, state = supervised.step(measured, target._replace(q=target.q * np.nan), state)
        speeds.append(state.supervisor.rv / DT)
        arm = loop.plant.step(tau, arm, DT)
        heaviest = np.maximum(heaviest, np.diag(robot.mass_matrix(measured.q)))
    jerk = np.abs(np.diff(speeds, 2, axis=0)) / DT**2
    # Half of the rate decelerates a joint alone, or 10 rad/s^2 take 0.1 s; of the last two steps one is up to
    # 1.13 times as large.
    assert (jerk.max(axis=0) <= 1.13 * (10.0 / 0.1 if geared else 0.5 * rate / heaviest)).all()
    assert jerk.max() > 0.0
    assert np.abs(np.diff(speeds, axis=0)).max() <= 10.0 * DT * (1.0 + 1e-9)
    assert supervised.report(state).status == "hold"
    assert np.abs(speeds[-1]).max() == 0.0


def test_the_anti_windup_knows_of_the_rate() -> None:
    law, rate = GPI(ARM, DT), 100.0
    supervised = Supervised(law, Supervisor(torque_rate=rate))
    state = supervised.init(Measurement(Q), Target(Q, REST, REST))
    for _ in range(60):
        state = held(supervised, state).state
    assert supervised.report(state).status == "run"
    before = state.supervisor.tau
    tau, after = held(supervised, state, Q, Q + 0.003)
    assert np.abs(np.abs(tau - before) - rate * DT).min() < 1e-12
    limited = law.within(before - rate * DT, before + rate * DT)
    told = limited.step(Measurement(Q), Target(Q + 0.003, REST, REST), state.law)
    untold = law.step(Measurement(Q), Target(Q + 0.003, REST, REST), state.law)
    np.testing.assert_array_equal(told.tau, tau)
    np.testing.assert_array_equal(told.state.law.lam, after.law.law.lam)
    assert np.abs(untold.state.law.lam - after.law.law.lam).min() > 0.1


@pytest.mark.parametrize("dither", [0.0, 1e-4])
@pytest.mark.parametrize("speed", [0.05, 0.3, 0.75])
def test_a_blocked_joint_is_a_fault_within_a_second(speed: float, dither: float) -> None:
    supervised, reference = Supervised(GPI(ARM, DT)), moving(ARM, speed)
    begin = 0.5 * reference.duration  # at its fastest
    q, (q_ref, *_) = reference.at(begin).q, reference.at(begin)
    state = supervised.init(Measurement(q), Target(q_ref, REST, REST))
    taken = 0
    while supervised.report(state).status in ("init", "run"):
        measured = Measurement(q + dither * (taken % 2))
        state = supervised.step(measured, reference.at(begin + taken * DT), state).state
        taken += 1
    assert taken <= 1000
    assert supervised.report(state).reason in ("saturated", "following", "frozen")


def started(**bounds: Any) -> tuple[Supervised, Any]:
    supervised = Supervised(GPI(ARM, DT), Supervisor(**bounds))
    return supervised, supervised.init(Measurement(Q), Target(Q, REST, REST))


def held(supervised: Supervised, state: Any, q: Any = Q, q_ref: Any = Q) -> Any:
    return supervised.step(Measurement(np.asarray(q)), Target(np.asarray(q_ref), REST, REST), state)


def test_a_joint_beyond_its_limits_is_a_fault() -> None:
    supervised, state = started(jump=0.0, reference_jump=0.0, following=100.0)
    edge = np.array([0.0, 0.0, ARM.limits.upper[2] + 0.1])
    state = held(supervised, state, edge - 1e-6, edge).state
    assert supervised.report(state).status == "run"
    state = held(supervised, state, edge + 1e-6, edge).state
    assert supervised.report(state) == ("stopping", "position", "q3")


def test_a_joint_that_does_not_follow_is_a_fault_and_the_stop_begins_where_it_is() -> None:
    supervised, state = started(reference_jump=0.0, following=0.2)
    ahead = np.array([0.0, 1.0, 0.0])
    state = held(supervised, state, Q, Q + 0.19 * ahead).state
    assert supervised.report(state).status == "run"
    state = held(supervised, state, Q, Q + 0.21 * ahead).state
    assert supervised.report(state) == ("hold", "following", "q2")
    np.testing.assert_allclose(state.supervisor.r, Q, atol=1e-12)
    # The law does not get it there either: the loop is opened.
    for k in range(1, 60):
        state = held(supervised, state, Q - 0.004 * k * ahead).state
    assert supervised.report(state).status == "fault"


def test_torque_at_its_limit_for_too_long_is_a_fault() -> None:
    supervised, state = started(saturated=0.1, frozen_samples=0, following=2.0)
    far = Q + np.array([0.0, 0.0, 1.0])
    state = supervised.init(Measurement(Q), Target(far, REST, REST))
    taken = 0
    while supervised.report(state).status in ("init", "run"):
        tau, state = held(supervised, state, Q + 1e-5 * (taken % 2), far)  # one count of dither
        taken += 1
        assert taken < 500
        if taken == 50:
            assert abs(tau[2]) == ARM.limits.effort[2]
    assert supervised.report(state)[1:] == ("saturated", "q3")
    assert 102 <= taken < 400


def test_samples_that_were_missed_are_filled_up_to_a_bound() -> None:
    supervised, state = started(missed=20)
    reference = Bezier(Q, Q + 0.3, 1.0)
    for k in range(1, 400):
        state = held(supervised, state, reference.at(k * DT).q, reference.at(k * DT).q).state
    for elapsed, reason in ((21, "none"), (22, "late")):
        at = reference.at((399 + elapsed) * DT)
        tau, after = supervised.advance(Measurement(at.q), at, state, elapsed)
        assert supervised.report(after).reason == reason
        one_by_one = state
        for k in range(400, 400 + elapsed):
            tau_own, one_by_one = held(supervised, one_by_one, reference.at(k * DT).q, reference.at(k * DT).q)
        if reason == "none":
            # The way between is nearly straight.
            np.testing.assert_allclose(tau, tau_own, atol=0.05)
            np.testing.assert_allclose(after.law.law.lam, one_by_one.law.law.lam, rtol=1e-3, atol=0.1)
    # The reference goes on meanwhile: that is no step of its velocity.
    supervised, state = started(missed=20, resolution=1e-6, reference_step=1e-6)
    for k in range(1, 100):
        q = Q + 0.5 * (k * DT) ** 2
        state = held(supervised, state, q, q).state
    q = q + 50.0 * 99.0 * DT**2
    state = supervised.advance(Measurement(q), Target(q, REST, REST), state, 50).state
    assert supervised.report(state).reason == "late"
    with pytest.raises(ArmgpiError, match="elapsed must be a whole number"):
        supervised.advance(Measurement(Q), Target(Q, REST, REST), state, 0)


@pytest.mark.parametrize(
    ("q", "q_ref", "reason"),
    [
        (Q * np.nan, Q, "not_finite"),
        (Q * 1e300, Q, "not_finite"),
        (Q + 7.0, Q + 7.0, "position"),
        (Q, Q * np.nan, "reference"),
        (Q, Q + 0.6, "following"),
    ],
)
def test_an_implausible_start_is_refused_with_torque_zero(q: Any, q_ref: Any, reason: str) -> None:
    supervised, _ = started()
    with np.errstate(all="ignore"):
        state = supervised.init(Measurement(q), Target(q_ref, REST, REST))
        assert supervised.report(state)[:2] == ("fault", reason)
        for _ in range(3):
            tau, state = held(supervised, state)
            np.testing.assert_array_equal(tau, REST)
            assert supervised.report(state).status == "fault"
    state = supervised.reset(Measurement(Q), Target(Q, REST, REST), state)
    assert supervised.report(held(supervised, state).state).status == "run"


def test_a_law_whose_torque_is_no_number_opens_the_loop() -> None:
    class Breaks(GPI):
        def step(self, measurement: Any, target: Any, state: Any) -> Any:
            tau, after = super().step(measurement, target, state)
            return armgpi.ControlStep(np.where(measurement.q > 0.45, np.nan, tau), after)

    supervised = Supervised(Breaks(ARM, DT), Supervisor(jump=0.0))
    state = supervised.init(Measurement(Q), Target(Q, REST, REST))
    state = held(supervised, state).state
    tau, state = held(supervised, state, Q + 0.1)
    assert supervised.report(state)[:2] == ("fault", "not_finite")
    assert np.isfinite(tau).all()


def test_after_a_gap_the_stop_begins_where_the_arm_is_and_as_fast_as_it_must_be() -> None:
    speed = np.array([0.3, 0.2, -0.4])
    supervised, start = started(missed=20)
    for k in range(1, 60):
        q = Q + k * DT * speed
        start = held(supervised, start, q, q).state
    # In 50 samples it went on evenly, or was braked evenly to rest.
    for share, after in ((1.0, speed), (0.5, 0.0 * speed)):
        there = Target(q + 50 * DT * speed, REST, REST)
        state = supervised.advance(Measurement(q + share * 50 * DT * speed), there, start, 50).state
        assert supervised.report(state).reason == "late"
        slower = np.sign(after) * np.maximum(np.abs(after) - 10.0 * DT, 0.0)
        np.testing.assert_allclose(state.supervisor.rv / DT, slower, atol=0.02)
        np.testing.assert_allclose(state.supervisor.r, q + share * 50 * DT * speed, atol=1e-3)


def test_a_joint_that_is_pushed_faster_than_its_limit_is_no_jump_and_one_that_jumps_is() -> None:
    # Its positions are given, so no torque is answered.
    supervised, state = started(following=100.0, position_margin=100.0, response=0.0)
    dt_limit = DT * ARM.limits.velocity[2]
    q, change = Q.copy(), 0.0
    for _ in range(20):  # ten times its velocity limit, at an acceleration that is below the bound
        change = min(change + 1.5 * dt_limit, 10.0 * dt_limit)
        q = q + np.array([0.0, 0.0, change])
        state = held(supervised, state, q).state
    assert supervised.report(state).reason == "none"
    state = held(supervised, state, q + np.array([0.0, 0.0, 15.0 * dt_limit])).state
    assert supervised.report(state)[1:] == ("jump", "q3")


def test_fault_damps_the_joints_that_still_measure_well_and_no_other() -> None:
    supervised, state = started(missed=0)
    speed = np.array([0.3, 0.2, -0.4])
    for k in range(1, 60):
        q = Q + k * DT * speed
        state = held(supervised, state, q, q).state
    lost = q + DT * speed + np.array([0.0, np.nan, 0.0])
    with np.errstate(invalid="ignore"):
        tau, after = held(supervised, state, lost)
    assert supervised.report(after)[:2] == ("fault", "not_finite")
    # As long as both are where the decelerating reference is, the torque is the model's; then it brakes.
    model = ARM.inverse_dynamics(
        np.where(np.isnan(lost), after.supervisor.r, lost), after.supervisor.rv / DT, -10.0 * np.sign(speed)
    )
    np.testing.assert_allclose(tau, model, atol=0.05)
    faster = lost + DT * 2.0 * speed
    with np.errstate(invalid="ignore"):
        braked, later = held(supervised, after, faster)
    model = ARM.inverse_dynamics(
        np.where(np.isnan(faster), later.supervisor.r, faster),
        later.supervisor.rv / DT,
        -10.0 * np.sign(speed),
    )
    more = (braked - model) * np.sign(speed)
    assert (more[[0, 2]] < -0.001).all()
    assert abs(more[1]) < 1e-9


def test_a_joint_that_fault_does_not_trust_is_never_trusted_again() -> None:
    supervised, state = started(missed=0)
    with np.errstate(invalid="ignore"):
        state = held(supervised, state, Q * np.array([1.0, np.nan, 1.0])).state
    assert supervised.report(state).status == "fault"
    for _ in range(5):
        state = held(supervised, state).state
    np.testing.assert_array_equal(state.supervisor.frozen.unchanged_samples >= COUNTED, [False, True, False])
    assert supervised.report(state).status == "fault"


def test_a_joint_that_measures_badly_for_a_moment_in_fault_is_trusted_again() -> None:
    supervised, state = started(missed=3)
    broken, once = np.array([1.0, np.nan, 1.0]), np.array([np.nan, np.nan, 1.0])
    with np.errstate(invalid="ignore"):
        for q in [broken] * 5 + [once] * 3 + [broken]:
            state = held(supervised, state, Q * q).state
        distrusted = state.supervisor.frozen.unchanged_samples >= COUNTED
        np.testing.assert_array_equal(distrusted, [False, True, False])
        for _ in range(4):
            state = held(supervised, state, Q * once).state
    distrusted = state.supervisor.frozen.unchanged_samples >= COUNTED
    np.testing.assert_array_equal(distrusted, [True, True, False])


def test_an_encoder_that_counts_backwards_is_found_at_once() -> None:
    def mirrored() -> Fault:
        first: list[float] = []

        def fault(k: int, q: Any, q_ref: Any) -> tuple[Any, Any]:
            first.append(q[1])
            q[1] = 2.0 * first[0] - q[1]
            return q, q_ref

        return fault

    for name in ARMS:
        found = course(arm(name, "robot"), mirrored(), 0.75, 0.2)
        assert found.reports[1][:2] == ("stopping", "jump"), name
        assert found.travel < 0.05, name


def test_a_joint_that_turns_round_is_neither_frozen_nor_does_its_encoder_count_backwards() -> None:
    supervised, state = started(following=100.0, position_margin=100.0, saturated=0.0)
    # To and fro beside its reference, by whole counts, so that it stands still for samples at each turn.
    count, q_ref = ARM.encoder_count(16), Q.copy()
    for k in range(700):
        q = np.round((Q + 0.05 * np.sin(20.0 * k * DT)) / count) * count
        q_ref = q_ref + 0.3 * DT
        state = held(supervised, state, q, q_ref).state
    assert supervised.report(state).reason == "none"


@pytest.mark.parametrize("hertz", [12.0, 25.0, 36.0, 60.0, 120.0])
def test_a_link_that_swings_on_its_gear_is_no_encoder_that_counts_backwards(hertz: float) -> None:
    count, turn = ARM.encoder_count(16), 2.0 * np.pi * hertz * DT
    for fastest in (10.0, 20.0, 40.0):  # counts in a sample, pushed from rest and left to swing
        supervised, state = started(following=100.0, saturated=0.0, frozen_samples=0, response=0.0)
        for k in range(100):
            way = turn * k + np.array([0.0, 0.3, 0.6]) * turn
            q = Q + count * np.round(fastest / turn * (1.0 - np.cos(way)))
            state = held(supervised, state, q).state
            assert supervised.report(state).reason == "none", (fastest, k)


def test_nor_is_one_that_moves_all_at_once_and_goes_back() -> None:
    check = Supervised(GPI(ARM, DT), Supervisor()).jump
    check.bounds = check.bounds._replace(jump=1e9 * np.ones(3))
    change = 2.0 * (check.bounds.turn + check.pushed + check.driven) * np.ones(3)
    moved = started()[1].supervisor._replace(change=change, v=change, bad=np.zeros(3), late=np.zeros(1))
    # Of one that rested, the first change is also by how much that missed where the one before led.
    assert check.passes(-change, moved._replace(miss=change)).all()
    assert not check.passes(-change, moved._replace(miss=0.9 * change)).any()


def test_what_torques_can_turn_round_in_a_sample_is_no_jump() -> None:
    """Half of what a push and the torques used do: the more torque, the faster a joint may go back."""
    check = Supervised(GPI(ARM, DT), Supervisor()).jump
    check.bounds = check.bounds._replace(jump=1e9 * np.ones(3), turn=1e-15 * np.ones(3))
    change = check.pushed + 0.5 * check.driven
    moved = started()[1].supervisor._replace(change=change, v=change, bad=np.zeros(3), late=np.zeros(1))
    moved = moved._replace(miss=0.9 * change)
    full = ARM.limits.effort * np.array([0.0, 1.0, 0.0])
    assert not check.passes(-change, moved._replace(tau=0.4 * full)).any()
    assert check.passes(-change, moved._replace(tau=0.6 * full)).all()
    assert check.passes(-change, moved._replace(tau=-0.6 * full)).all()


def test_a_torque_is_smoothed_twice_for_how_a_joint_answers_it() -> None:
    check = Supervised(GPI(ARM, DT), Supervisor()).response
    watch = started()[1].supervisor
    yes, no = np.ones(1, dtype=bool), np.zeros(1, dtype=bool)
    rng = np.random.default_rng(3)
    once, twice, model, tau = rng.uniform(0.5, 1.0, (4, 3))
    kept = watch.response._replace(torque=once, torque_lowpass=twice, model_torque_lowpass=model)
    watch = watch._replace(response=kept, tau=tau)
    after = check.after(yes, (yes, no), no, 1.1 * model, watch, 0.0 * tau, 0.0 * tau)
    smoothed = once + check._smoothing * (tau - once)
    np.testing.assert_allclose(after.torque, smoothed)
    np.testing.assert_allclose(after.torque_lowpass, twice + check._forgotten * (smoothed - twice))
    np.testing.assert_allclose(after.model_torque_lowpass, model + check._forgotten * 0.1 * model)


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_the_model_is_not_asked_while_a_torque_is_at_either_limit(way: float) -> None:
    supervised, state = started(following=100.0, saturated=0.0, position_margin=100.0, frozen_samples=0)
    q_ref, asked = Q.copy(), []
    for k in range(1500):  # it swings a little, so that the model's torque differs from sample to sample
        q_ref = q_ref + way * np.array([0.0, 0.3, 0.0]) * DT
        tau, state = held(supervised, state, Q + 0.01 * np.sin(10.0 * k * DT), q_ref)
        if way * tau[1] >= ARM.limits.effort[1]:
            asked.append(state.supervisor.response.model_torque_lowpass.copy())
    assert len(asked) > 100
    np.testing.assert_array_equal(asked, asked[:1] * len(asked))


def test_nor_is_one_that_swings_within_five_samples() -> None:
    h, count = 2e-3, ARM.encoder_count(16)
    weak = ARM.with_gravity((0.0, 0.0, 0.0)).with_limits(effort=0.01 * ARM.limits.effort)
    for phase in np.linspace(0.0, 1.2, 9):
        still = {"following": 100.0, "saturated": 0.0, "frozen_samples": 0, "response": 0.0}
        supervised = Supervised(GPI(weak, h), Supervisor(**still))
        state = supervised.init(Measurement(Q), Target(Q, np.zeros(3), np.zeros(3)))
        for k in range(40):  # it builds up
            way = 0.4 * np.pi * k + phase + np.array([0.0, 2.0, 4.0])
            q = Q + count * np.round(40.0 * min(k / 20.0, 1.0) * np.cos(way))
            state = held(supervised, state, q).state
        assert supervised.report(state).reason == "none", phase


def test_a_reference_that_stops_dead_is_a_fault_where_it_is_asked_for() -> None:
    speed = np.array([0.0, 0.0, 0.5 * ARM.limits.velocity[2]])
    for bound, reason in ((2.0, "none"), (0.2, "reference")):
        supervised, state = started(reference_jump=bound)
        for k in range(1, 100):
            q = Q + 0.5 * DT * speed * (k * DT / 0.1) * k  # it accelerates from rest
            state = held(supervised, state, q, q).state
        assert supervised.report(state).reason == "none"
        state = held(supervised, state, q, q).state
        assert supervised.report(state).reason == reason


def test_a_step_of_the_reference_s_velocity_may_take_all_torque_for_a_time() -> None:
    # Of a mass on a rail that is force over mass, and nothing else is.
    rail = machines.sled(bounds='lower="-1" upper="1"').with_limits(velocity=100.0, effort=20.0)
    most = 0.01 * 20.0 / rail.mass_matrix(np.zeros(1))[0, 0]
    count = np.full(1, 1e-9)
    for speed, reason in ((0.99 * most, "none"), (1.01 * most, "reference")):
        supervised = Supervised(GPI(rail, DT), Supervisor(resolution=count, frozen_samples=0))
        state = supervised.init(Measurement(np.zeros(1)), Target(*np.zeros((3, 1))))
        state = supervised.step(Measurement(np.zeros(1)), Target(*np.zeros((3, 1))), state).state
        there = Target(np.full(1, speed * DT), np.zeros(1), np.zeros(1))
        state = supervised.step(Measurement(np.full(1, 1e-6)), there, state).state
        assert supervised.report(state).reason == reason


@pytest.mark.parametrize("dt", [1e-3, 4e-3])
def test_an_acceleration_of_the_reference_is_no_step_of_its_velocity(dt: float) -> None:
    # Twice what the motor can: 8 ms of its torque in a sample of 4 ms, and 10 may be.
    rail = machines.sled(bounds='lower="-1" upper="1"').with_limits(velocity=100.0, effort=20.0)
    most = 20.0 / rail.mass_matrix(np.zeros(1))[0, 0]
    supervised = Supervised(GPI(rail, dt), Supervisor(resolution=1e-9, frozen_samples=0, jump=0.0))
    state = supervised.init(Measurement(np.zeros(1)), Target(*np.zeros((3, 1))))
    for k in range(1, round(0.1 / dt)):
        q = np.full(1, 0.5 * 2.0 * most * (k * dt) ** 2)
        state = supervised.step(Measurement(q), Target(q, np.zeros(1), np.zeros(1)), state).state
    assert supervised.report(state).reason == "none"


@pytest.mark.parametrize("sticking", [0.0, 0.02, 0.1])
def test_a_joint_that_stands_still_is_frozen_once_its_torque_has_changed_by_more_than_friction(
    sticking: float,
) -> None:
    supervised, state = started(sticking=sticking, following=10.0)
    j, taus, asked = 2, [0.0], 0
    while supervised.report(state).reason == "none":
        at = Q + np.array([0.0, 0.0, 0.02 * DT * len(taus)])
        asked += abs(at[j] - Q[j]) > supervised.bounds.travel[j]
        tau, state = held(supervised, state, Q, at)
        taus.append(tau[j])
    assert supervised.report(state) == ("fault", "frozen", "q3")
    # What was known in its sample is the torque before.
    pulled = np.abs(np.array(taus) - taus[-1 - asked])
    most = sticking * ARM.limits.effort[j]
    assert asked >= 50
    assert pulled[-2] > most
    assert asked == 50 or pulled[-3] <= most


@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_a_joint_that_sticks_while_others_change_what_holds_it_is_not_frozen(towards: float) -> None:
    supervised = Supervised(PIDInversion(ARM, DT), Supervisor(resolution=1e-6, sticking=0.01))
    state = supervised.init(FullState(Q, REST), Target(Q, REST, REST))
    ahead, taus, held_by = 2.0 * supervised.bounds.travel[2], [], []
    for k in range(1000):
        q, v = Q + np.array([0.0, towards * k * DT, 0.0]), np.array([0.0, towards, 0.0])
        target = Target(q - np.array([0.0, 0.0, towards * k * DT * ahead]), v, REST)
        tau, state = supervised.step(FullState(q, v), target, state)
        taus.append(tau[2])
        held_by.append(ARM.gravity(q)[2])
    assert supervised.report(state).reason == "none"
    # They changed it by more than what friction may hold.
    assert np.ptp(held_by) > 1.5 * supervised.frozen.sticking[2]
    assert np.ptp(taus) > 1.5 * supervised.frozen.sticking[2]


def test_a_lowered_torque_limit_lessens_no_friction() -> None:
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in ARM.limits[:2])
    grid = np.random.default_rng(5).uniform(lower, upper, size=(2000, 3))
    most = np.abs(ARM.gravity(grid)).max(axis=0)

    def sticking(effort: Any) -> Any:
        return Supervised(GPI(ARM.with_limits(effort=effort), DT), Supervisor()).frozen.sticking

    plenty = 3.0 * most + 1.0
    np.testing.assert_array_equal(sticking(plenty), 0.1 * plenty)
    low = sticking(1.2 * most + 1e-3)
    np.testing.assert_array_equal(low, sticking(1.5 * most + 1e-3))
    assert (low <= 0.2 * most + 1e-3).all()  # which 16 configurations need not meet, by the half
    assert (low >= 0.1 * most).all()


def test_a_motor_at_its_limit_that_just_holds_its_joint_has_no_frozen_encoder() -> None:
    supervised, state = started(saturated=0.0, response=0.0)
    away, count = np.array([0.0, 0.0, -0.1]), ARM.encoder_count(16)
    k = 0
    while abs(state.supervisor.tau[2]) < ARM.limits.effort[2] or k % 2:  # pushed off, and creeping
        k += 1
        state = held(supervised, state, Q + away * min(k / 100, 1.0) + count * (k % 2)).state
    for _ in range(200):  # by less than a count
        state = held(supervised, state, Q + away).state
    assert supervised.report(state).reason == "none"


def test_a_joint_ahead_of_its_reference_may_wait_for_it_and_no_longer() -> None:
    supervised, state = started(sticking=0.0)
    ahead, at = Q + np.array([0.0, 0.0, 0.02]), Q
    state = held(supervised, state, Q + 0.5 * (ahead - Q), Q).state
    while supervised.report(state).reason == "none":
        at = at + np.array([0.0, 0.0, 0.2 * DT])
        state = held(supervised, state, ahead, at).state
    assert supervised.report(state).reason == "frozen"
    passed = at[2] - ahead[2]
    assert supervised.bounds.travel[2] < passed <= supervised.bounds.travel[2] + 51 * 0.2 * DT


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_whose_reference_stops_dead_decelerates(name: str) -> None:
    held: list[Any] = []

    def fault(k: int, q: Any, q_ref: Any) -> tuple[Any, Any]:
        held.append(q_ref)
        return q, held[0]

    assert course(arm(name, "robot"), fault, 0.75, 0.3).travel < 0.05


def driven(robot: Robot, torque: Callable[[int, Any], Any], seconds: float) -> Course:
    """What an arm does from the middle of a move on, when other torques act than those asked for."""
    loop, begin, (_, arm, state) = begun(robot, 0.75, None)
    rows: list[Any] = []
    for k in range(round(seconds / DT)):
        measured, truth = loop.plant.measure(arm), loop.plant.true_state(arm)
        tau, state = loop.controller.step(Measurement(measured.q), loop.reference.at((begin + k) * DT), state)
        rows.append((truth.q, truth.v, tau, loop.controller.report(state)))
        arm = loop.plant.step(torque(k, tau), arm, DT)
    qs, vs, taus, reports = zip(*rows, strict=True)
    return Course(np.array(qs), np.array(vs), np.array(taus), list(reports))


@pytest.mark.parametrize("j", [0, 1, 2])
@pytest.mark.parametrize("gravity", ["arm", "robot"])
def test_a_motor_that_turns_the_other_way_brakes_by_its_torque_turned_round(gravity: str, j: int) -> None:
    robot = arm("anthropomorphic3", gravity)
    turned = np.where(np.arange(3) == j, -1.0, 1.0)
    found = driven(robot, lambda k, tau: turned * tau, 0.3)
    when = next(k for k, report in enumerate(found.reports) if report.status == "fault")
    assert found.reports[when][1:] == ("response", robot.joint_names[j])
    assert np.abs(found.q[when] - found.q[0]).max() < 0.2  # FOLLOWING would wait for 0.5
    assert np.abs(found.v[-1]).max() < 0.1 * np.abs(found.v[when]).max()
    assert found.travel < 0.5


def test_a_motor_that_was_taken_for_one_that_turns_the_other_way_brakes_after_all() -> None:
    robot = arm("anthropomorphic3", "robot")

    def torque(k: int, tau: Any) -> Any:
        # It turns the right way from when it is found on, so that a torque turned round drives it.
        return tau * np.where((np.arange(3) == 1) & (k < found_at), -1.0, 1.0)

    found_at = 1000
    reports = driven(robot, torque, 0.2).reports
    found_at = next(k for k, report in enumerate(reports) if report.status == "fault")
    found = driven(robot, torque, 0.3)
    assert found.reports[found_at][1:] == ("response", robot.joint_names[1])
    against = found.tau[found_at + 30 :, 1] * found.v[found_at + 30 :, 1] <= 0.0
    assert against[:100].all()
    assert np.abs(found.v[found_at:, 1]).max() < 2.5 * np.abs(found.v[found_at, 1])
    assert (found.tau[found_at + 30 :] != 0.0).any()


def pushed(push: Any, k: int, tau: Any) -> Any:
    """Return what acts during a push of 50 ms."""
    return tau + push * (k < 50)


def test_at_rest_nothing_is_kept_that_processors_take_long_over() -> None:
    loop = armgpi.ClosedLoop(
        Saturated(RigidBodyPlant(ARM)), Supervised(GPI(ARM, DT)), Bezier(Q, Q + 0.1, 0.2)
    )
    state = loop.init()
    for _ in range(1200):
        state = loop.step(state).state
    watch = state.controller.supervisor
    assert not watch.rv.any()  # halved for a second, it would be 1e-80
    for part in flat(watch):
        assert not ((part != 0.0) & (np.abs(part) < np.finfo(np.float64).tiny)).any()


def test_a_push_and_a_load_are_not_taken_for_a_motor_that_turns_the_other_way() -> None:
    robot = arm("anthropomorphic3", "robot")
    for share in (-0.5, -0.2, 0.1, 0.5):
        push = share * robot.limits.effort
        found = driven(robot, partial(pushed, push), 0.12)
        assert found.reasons == {"none"}, share
    # A load that stays, of a fifth of each motor's torque.
    load = 0.2 * robot.limits.effort
    assert driven(robot, lambda k, tau: tau - load, 0.12).reasons == {"none"}


@pytest.mark.parametrize("counts", [8, 15, 17])
def test_fewer_than_16_counts_say_nothing_of_how_a_motor_turns(counts: int) -> None:
    supervised, state = started(resolution=ARM.encoder_count(12), jump=0.0)
    state = held(supervised, state, Q + counts * ARM.encoder_count(12)).state
    assert state.supervisor.response.adverse_samples.any() == (counts > 16)


@pytest.mark.parametrize("name", ARMS)
def test_a_push_of_one_joint_is_not_taken_for_a_motor_that_turns_the_other_way(name: str) -> None:
    # Others are at their limits then, and accelerate this one.
    robot = arm(name, "arm")
    for j, share in enumerate(np.resize([0.3, -0.3], robot.n)):
        push = np.where(np.arange(robot.n) == j, share * robot.limits.effort, 0.0)
        assert "response" not in driven(robot, partial(pushed, push), 0.07).reasons, robot.joint_names[j]


@pytest.mark.parametrize("share", [0.0, 0.5])
@pytest.mark.parametrize("bits", [10, 16])
def test_a_joint_is_too_fast_by_a_share_above_its_limit_however_coarse_its_encoder(
    share: float, bits: int
) -> None:
    rail = machines.sled(bounds='lower="-1" upper="1"').with_limits(velocity=0.2, effort=20.0)
    count = 2.0 / 2**bits
    most = Supervisor(speed=share, resolution=count, reference_jump=0.0, frozen_samples=0, response=0.0)
    ours = Supervised(GPI(rail, DT), most)
    theirs: Any = armgpi.ExportedController.of(ours)
    for factor in (0.999, 1.3 if bits == 16 else 3.0):
        speed = factor * (1.0 + share) * 0.2
        begin = Measurement(np.array([-0.8])), Target(np.array([-0.8]), np.zeros(1), np.zeros(1))
        mine, its = ours.init(*begin), theirs.init(*begin)
        for k in range(1, 1500):
            q = np.round((-0.8 + speed * k * DT) / count) * count
            sample = Measurement(np.array([q])), Target(np.array([q]), np.zeros(1), np.zeros(1))
            mine, its = ours.step(*sample, mine).state, theirs.step(*sample, its).state
            assert ours.report(mine) == theirs.report(its)
            if ours.report(mine).reason != "none":
                break
        assert ours.report(mine).reason == ("none" if factor < 1.0 else "speed")
        if bits == 16 and factor > 1.0:
            # What is smoothed gets there by a law of its own, and is looked at a sample later.
            share_there = (1.0 + share) * 0.2 / speed
            expected = np.log(1.0 - share_there) / np.log(1.0 - DT / (DT + 5e-3)) + 1.0
            assert k == pytest.approx(expected, abs=1.5)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_a_push_that_makes_a_joint_too_fast_stops_it_under_control(backend: str) -> None:
    if backend == "compiled":
        pytest.importorskip("casadi")
    push = armgpi.Pulse(0.5 * ARM.limits.effort, 0.1, 0.15)
    limit = np.full(3, 2.0)
    robot = ARM.with_limits(velocity=limit)
    rollouts = [
        simulate(
            Saturated(RigidBodyPlant(robot, loads=[push])),
            GPI(robot, DT),
            armgpi.Hold(Q),
            1.0,
            supervisor=Supervisor(speed=speed),
            backend=backend,
        )
        for speed in (None, 0.5)
    ]
    fast = np.abs(rollouts[0]["v"]).max()
    assert fast > 1.5 * 2.0
    assert [str(Reason(int(run["fault"])).name) for run in rollouts] == ["NONE", "SPEED"]
    assert float(rollouts[1]["supervisor"].isel(time=-1).max()) == State.HOLD
    assert np.abs(rollouts[1]["v"].isel(time=-1)).max() < 0.05


# A rollout under it.


class Breaking(armgpi.Reference):
    """A move that is interrupted: the reference jumps."""

    def __init__(self, robot: Robot, at: float) -> None:
        self.move, self.time = moving(robot, 0.75), at

    def at(self, t: Any) -> Target:
        q, v, a = self.move.at(t)
        return Target(q + 0.2 * (np.asarray(t) >= self.time)[..., None], v, a)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize(("batch", "every"), [(False, 1), (False, 7), (True, 7)])
def test_a_rollout_says_why_and_when_it_was_stopped(backend: str, batch: bool, every: int) -> None:
    if backend == "compiled":
        pytest.importorskip("casadi")
    reference: Any = Breaking(ARM, 0.3)
    robot: Any = ARM
    if batch:
        robot = armgpi.RobotBatch([ARM, ARM.with_payload("tool", 0.05)])
    controller, plant = GPI(ARM, DT), Saturated(RigidBodyPlant(robot))
    rollout = simulate(
        plant, controller, reference, 0.6, supervisor=Supervisor(), record_every=every, backend=backend
    )
    assert (rollout["status"] == armgpi.Status.STOPPED).all()
    assert (rollout["fault"] == Reason.REFERENCE).all()
    np.testing.assert_allclose(rollout["t_fault"], 0.3, atol=1e-12)
    assert float(rollout["supervisor"].isel(time=-1).max()) == State.HOLD
    assert armgpi.loop.rollout.describe_end(rollout) == ["stopped at 0.3 s: REFERENCE (q1)"] * (1 + batch)
    if batch and backend == "numpy":
        alone = simulate(
            Saturated(RigidBodyPlant(ARM)),
            controller,
            reference,
            0.6,
            supervisor=Supervisor(),
            record_every=7,
        )
        np.testing.assert_array_equal(rollout["q"][0], alone["q"])


def test_without_a_fault_nothing_changes() -> None:
    plant, reference = Saturated(RigidBodyPlant(ARM)), moving(ARM, 0.75)
    for controller in (GPI(ARM, DT), PIDInversion(ARM, DT), GPI(ARM, DT, rolloff=1, rest_leak=50.0)):
        plain = simulate(plant, controller, reference, 1.0)
        supervised = simulate(plant, controller, reference, 1.0, supervisor=Supervisor())
        for name in ("q", "tau"):
            np.testing.assert_array_equal(plain[name], supervised[name])
        assert int(supervised["status"]) == armgpi.Status.FINISHED
        assert np.isnan(supervised["t_fault"])


@pytest.mark.parametrize(
    ("law", "rate"),
    [
        (GPI(ARM, DT), 300.0),
        (GPI(ARM, DT, gains=armgpi.BSplineNetwork()), None),
        (PIDInversion(ARM, DT), None),
        (GPI(ARM, DT, feedforward="model"), 300.0),
    ],
    ids=["fixed", "network", "velocity", "feedforward"],
)
def test_the_usual_step_has_the_bits_of_any_step(law: Any, rate: float | None) -> None:
    supervised: Any = Supervised(law, Supervisor(torque_rate=rate, missed=4, saturated=0.05, following=0.2))
    random = np.random.default_rng(11)
    loop: Any = armgpi.ClosedLoop(
        armgpi.Encoder(Saturated(RigidBodyPlant(ARM)), 18), supervised, moving(ARM, 2.0)
    )
    _, arm, state = loop.init()
    taken, seen = [], set()
    for k in range(600):
        target, measured = loop.reference.at(k * DT), loop.plant.measure(arm)
        wrong = random.choice([np.nan, 1e3, 0.01]) if random.random() < 0.005 else 0.0
        far = random.choice([np.nan, 0.3, -0.1]) if random.random() < 0.005 else 0.0
        given = measured._replace(q=measured.q + wrong)
        given = given if supervised.measurement_type is FullState else Measurement(given.q)
        target = target._replace(q=target.q + far)
        with np.errstate(all="ignore"):
            usual = supervised._is_nominal(given, target, state.supervisor).all()
            step, other = (f(given, target, state) for f in (supervised.step, supervised._any_step))
        for a, b in zip(flat(step), flat(other), strict=True):
            np.testing.assert_array_equal(a, b)
        taken.append(usual)
        seen.add(supervised.report(step.state).status)
        tau, state = step
        arm = loop.plant.step(tau + 5.0 * (k % 200 == 199), arm, DT)
        if supervised.report(state).status in ("hold", "fault"):
            arm = loop.plant.init(target.q, target.v) if not np.isnan(target.q).any() else arm
            state = supervised.reset(
                loop.plant.measure(arm)
                if supervised.measurement_type is FullState
                else Measurement(loop.plant.measure(arm).q),
                target,
                state,
            )
    assert 0.3 < np.mean(taken) < 1.0
    assert "run" in seen
    assert len(seen) > 1


def flat(value: Any) -> list[Any]:
    if isinstance(value, tuple):
        return [leaf for item in value for leaf in flat(item)]
    return [] if value is None else [value]


def geared(robot: Robot, rotor: Any) -> Robot:
    return robot.with_armature(np.array(rotor))


def test_an_arm_that_its_gears_swing_is_stopped_and_comes_to_rest() -> None:
    # Encoders at the link, gears half as stiff as usual: the law for rigid gears is unstable at 14 Hz.
    robot = geared(Robot.load("ur5"), [1.2, 1.2, 0.8, 0.2, 0.2, 0.2])
    stiffness = 0.5 * np.array([20e3, 20e3, 15e3, 5e3, 5e3, 5e3])
    plant: Any = armgpi.ElasticPlant(robot, gear_stiffness=stiffness, encoder_side="link")
    plant = armgpi.Delayed(armgpi.Encoder(Saturated(plant), 16), 1)
    law, start = GPI.auto(robot, DT, delay=DT, bits=16, drives="stiff"), robot.middle()
    given = Supervisor(resolution=robot.encoder_count(16), response=0.005)
    move = Bezier(start, start + 0.5, 3.0)
    seen = simulate(plant, law, move, 2.5, progress=False, backend="compiled", supervisor=given)
    q, k = seen["q"].values, int(float(seen["t_fault"]) / DT)
    assert k < 1500
    assert np.abs(q[k:] - q[k]).max() < 1.0
    assert np.abs(q[-1] - q[-200]).max() < 0.02
    assert float(seen["supervisor"].isel(time=-1).max()) == State.FAULT


def swinging(samples: int, **bounds: Any) -> list[str]:
    """Return the states after a fault of an arm whose joints swing by 0.05 rad at 15 Hz."""
    supervised, state = started(**bounds)
    state = held(supervised, state, Q, Q * np.nan).state
    said = []
    for k in range(samples):
        swung = Q + 0.05 * np.sin(2.0 * np.pi * 15.0 * k * DT)
        state = held(supervised, state, swung, Q).state
        said.append(supervised.report(state).status)
    return said


def test_hold_is_not_said_of_an_arm_that_swings_and_after_two_seconds_it_is_a_fault() -> None:
    said = swinging(2300, following=100.0)
    assert set(said[20:1900]) == {"stopping"}
    assert said[-1] == "fault"


def test_an_arm_that_swings_as_far_as_following_allows_is_a_fault_sooner() -> None:
    said = swinging(250)
    assert set(said[20:160]) == {"stopping"}  # 4 * 0.05 rad * 15 Hz take 0.17 s for half a radian
    assert said[220] == "fault"


def test_what_is_a_fault_goes_by_the_arm_and_not_by_the_heavier_rotors_of_a_feedback() -> None:
    robot = geared(ARM, [0.1, 0.1, 0.1])
    laws = (GPI(robot, DT, rotor_factor=factor) for factor in (1.0, 3.0))
    one, other = map(Supervised, laws)
    np.testing.assert_array_equal(one.jump.pushed, other.jump.pushed)
    np.testing.assert_array_equal(one.frozen.braked, other.frozen.braked)
    np.testing.assert_array_equal(one.bounds.step, other.bounds.step)
    np.testing.assert_array_equal(one.response.overpowered, other.response.overpowered)
    np.testing.assert_array_equal(one.stop.damping, other.stop.damping)


# The same in C.


@pytest.mark.parametrize(("rate", "start"), [(None, "hold"), (50.0, "hold"), (50.0, "rest")])
def test_c_does_the_same_bit_by_bit(rate: float | None, start: str) -> None:
    pytest.importorskip("casadi")
    # D(q) of a mass on a rail is one product, so that not even the dynamics round in another way.
    rail = machines.sled(bounds='lower="-1" upper="1"').with_limits(velocity=2.0, effort=20.0)
    law = GPI(rail, DT, start=start)
    ours = Supervised(law, Supervisor(torque_rate=rate, missed=4, frozen_samples=20))
    theirs: Any = armgpi.ExportedController.of(ours)
    random = np.random.default_rng(7)
    q, seen, outage = np.zeros(1), set(), 0
    target = Target(q, np.zeros(1), np.zeros(1))
    mine: Any = ours.init(Measurement(q), target)
    its: Any = theirs.init(Measurement(q), target)
    with np.errstate(all="ignore"):
        for k in range(3000):
            q = q + random.normal(scale=2e-4, size=1) * (random.random() > 0.3)
            if random.random() < 0.01:
                outage = int(random.choice([1, 2, 8]))
            outage -= 1
            wrong = random.choice([np.nan, np.inf, 0.3, 1e5]) if outage >= 0 else 0.0
            far = random.choice([np.nan, 0.6, -0.1]) if random.random() < 0.004 else 0.0
            target = Target(q + 1e-3 * np.sin(0.01 * k) + far, np.zeros(1), np.zeros(1))
            elapsed = int(random.choice([1, 1, 1, 1, 3, 9])) if random.random() < 0.05 else 1
            measurement = Measurement(q + wrong)
            mine = ours.advance(measurement, target, mine, elapsed)
            its = theirs.advance(measurement, target, its, elapsed)
            np.testing.assert_array_equal(mine.tau, its.tau)
            mine, its = mine.state, its.state
            numbers = its.view(np.float64)[2:]
            # C takes no shorter way, and so does not keep whether it might: the last of what is kept.
            kept = np.concatenate([*flat(mine.supervisor)[:-1], *mine.law.law, mine.law.learn])
            np.testing.assert_array_equal(kept, numbers[: kept.size])
            assert ours.report(mine) == theirs.report(its)
            seen.add(ours.report(mine)[:2])
            if ours.report(mine).status in ("hold", "fault") and random.random() < 0.1:
                mine = ours.reset(Measurement(q), Target(q, target.v, target.a), mine)
                its = theirs.reset(Measurement(q), Target(q, target.v, target.a), its)
    assert {status for status, _ in seen} >= {"run", "stopping", "hold", "fault"}
    assert {reason for _, reason in seen} >= {"none", "late", "reference", "jump", "not_finite"}


def test_c_of_an_arm_does_the_same_to_rounding() -> None:
    pytest.importorskip("casadi")
    ours = Supervised(PIDInversion(ARM, DT), Supervisor(on_fault="hold", missed=2))
    theirs: Any = armgpi.ExportedController.of(ours)
    target = Target(Q, REST, REST)
    mine: Any
    its: Any
    mine, its = (c.init(FullState(Q, REST), target) for c in (ours, theirs))
    random = np.random.default_rng(3)
    for k in range(200):
        q = Q + 1e-4 * np.sin(0.05 * k + np.arange(3))
        q = q * np.nan if k in (50, 51, 120, 121, 122, 123) else q
        v = np.array([0.0, np.inf, 0.0]) if k == 80 else 0.01 * random.normal(size=3)
        mine, its = (c.step(FullState(q, v), target, s) for c, s in ((ours, mine), (theirs, its)))
        np.testing.assert_allclose(mine.tau, its.tau, atol=1e-12)
        mine, its = mine.state, its.state
        assert ours.report(mine) == theirs.report(its)
    assert ours.report(mine).status == "fault"


# Bad input.


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Supervised("gpi"), "law must be a Controller"),
        (lambda: Supervised(Supervised(GPI(ARM, DT))), "not supervised yet"),
        (lambda: Supervised(GPI(ARM, DT), "strict"), "supervisor must be a Supervisor"),
        (lambda: Supervised(GPI(ARM, DT), Supervisor(following=[1.0, 2.0])), "following"),
        (
            lambda: simulate(RigidBodyPlant(ARM), GPI(ARM, DT), armgpi.Hold(Q), 0.1, supervisor=True),
            "supervisor",
        ),
    ],
)
def test_bad_input_ends_in_one_of_our_errors(call: Any, said: str) -> None:
    with pytest.raises(ArmgpiError, match=said):
        call()


def test_what_is_kept_is_named_as_the_c_has_it() -> None:
    assert Watch._fields[0] == "status"  # the first the template reads
    assert {"reason", "joint", "bad", "late", "q", "r", "tau"} <= set(Watch._fields)


CAP, SPEED_CAP = np.array([2.0, 1.5, 0.5]), np.array([0.2, 0.1, 0.3])


@given(
    walk=st.lists(st.sampled_from([0.0, 1e-4, -1e-3, 5e-3, 0.5, np.nan]), min_size=5, max_size=40),
    pull=st.floats(-3.0, 3.0),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None)
def test_no_torque_is_farther_from_what_holds_the_model_than_its_cap(
    walk: list[float], pull: float, seed: int
) -> None:
    supervised = Supervised(GPI(ARM, DT), Supervisor(torque_cap=CAP, speed_cap=SPEED_CAP))
    rng = np.random.default_rng(seed)
    q, r = Q.copy(), Q.copy()
    state = supervised.init(Measurement(q), Target(q, REST, REST))
    for change in walk:
        q = q + change * rng.choice([-1.0, 0.0, 1.0], 3)
        r = r + 1e-4 * pull
        tau, state = supervised.step(Measurement(q), Target(r, REST, REST), state)
        away = np.abs(tau - ARM.gravity(state.supervisor.q))
        assert (away <= CAP * (1.0 + 1e-12)).all()
        if (away >= CAP).any():
            assert supervised.report(state).status in ("stopping", "fault")  # a stop, not a clip


def test_a_law_that_asks_for_a_cap_is_a_fault_and_exported_c_says_so_too() -> None:
    ours = Supervised(GPI(ARM, DT), Supervisor(torque_cap=CAP))
    theirs: Any = armgpi.ExportedController.of(ours)
    pushed = RigidBodyPlant(ARM, armgpi.Pulse(np.array([0.0, 0.0, 0.8]), onset=0.05, duration=1.0))
    rollout = simulate(pushed, ours, armgpi.Hold(Q), 0.6, progress=False)
    assert "CAP (q3)" in armgpi.loop.rollout.describe_end(rollout)[0]
    targets = Target(Q, REST, REST)
    state = theirs.init(Measurement(Q), targets)
    for q, tau in zip(rollout["q_measured"].values[:-1], rollout["tau_command"].values[:-1], strict=True):
        assert (np.abs(tau - ARM.gravity(q)) <= CAP * (1.0 + 1e-9)).all()
        found, state = theirs.step(Measurement(q), targets, state)
        np.testing.assert_allclose(found, tau, rtol=1e-9, atol=1e-9)
    assert theirs.report(state) == ("fault", "cap", "q3")


@pytest.mark.parametrize("rate", [None, 500.0])
def test_a_fault_without_torque_is_without_torque_under_a_cap_too(rate: float | None) -> None:
    bounds: Any = {"torque_cap": CAP, "on_fault": "zero", "torque_rate": rate}
    supervised = Supervised(GPI(ARM, DT), Supervisor(**bounds))
    target, tau = Target(Q, REST, REST), REST
    state = supervised.init(Measurement(Q), target)
    assert (np.abs(ARM.gravity(Q)) > CAP).any()  # or the cap would say nothing
    for k in range(80):
        before = tau
        tau, state = supervised.step(Measurement(Q if k < 40 else np.full(3, np.nan)), target, state)
        assert rate is None or (np.abs(tau - before) <= rate * DT * (1.0 + 1e-9)).all()
    assert supervised.report(state).status == "fault"
    np.testing.assert_array_equal(tau, 0.0)


def test_a_joint_faster_than_the_cap_of_its_stage_is_stopped() -> None:
    supervised = Supervised(GPI(ARM, DT), Supervisor(speed_cap=SPEED_CAP))
    for share, reason in ((0.95, "none"), (1.3, "speed")):  # a count of 16 bits is 0.16 of this cap
        q, state = Q, supervised.init(Measurement(Q), Target(Q, REST, REST))
        for k in range(100):
            q = q + np.array([0.0, min(1.0, k / 50) * share * SPEED_CAP[1] * DT, 0.0])
            _, state = supervised.step(Measurement(q), Target(q, REST, REST), state)
        assert supervised.report(state).reason == reason
