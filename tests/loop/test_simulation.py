"""The loop: batches, steps by hand, thinning, divergence, interruption, bad input."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from armgpi import (
    GPI,
    ArmgpiWarning,
    Bezier,
    ClosedLoop,
    Controller,
    ControlStep,
    Delayed,
    DropOut,
    Encoder,
    FixedGains,
    Friction,
    FullState,
    Hold,
    Measurement,
    Noisy,
    PIDInversion,
    Pulse,
    Ramp,
    RateLimited,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Saturated,
    Sine,
    Status,
    Step,
    Target,
    Waypoints,
    prepare,
    simulate,
)
from armgpi.errors import ArmgpiError, ArrayError, LimitError, ParameterError, RolloutError
from armgpi.loop import metrics
from armgpi.loop.rollout import Recording

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
PANDA = Robot.load("panda", lock=["panda_finger_joint1", "panda_finger_joint2"])
ROBOTS = {"arm": ARM, "panda": PANDA}
MOVE = Bezier([0.0, 0.0, 0.0], [0.4, 0.3, -0.2], duration=0.5)
#: What a sample leaves behind.
SAMPLED = ("q", "v", "q_ref", "v_ref", "q_measured", "tau_command", "tau")


def gpi(robot: Any = ARM, omega: Any = 20.0, **options: Any) -> GPI:
    return GPI(robot, DT, FixedGains(omega), **options)


def assert_same_bits(one: xr.Dataset, other: xr.Dataset, names: tuple[str, ...] = SAMPLED) -> None:
    for name in names:
        np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=name, strict=True)


# A batch is the same runs one by one. Every case takes a robot and random rows of numbers, and returns what
# simulates row i, or all rows at once for None.

Case = Callable[[Robot, np.ndarray], Callable[[int | None], tuple[Any, Any]]]


def pick(rows: np.ndarray, i: int | None) -> np.ndarray:
    return rows if i is None else rows[i]


CASES: dict[str, Case] = {
    "gains": lambda robot, x: lambda i: (RigidBodyPlant(robot), gpi(robot, pick(20 + 10 * x, i))),
    "gains of the printed law": lambda robot, x: (
        lambda i: (
            RigidBodyPlant(robot),
            gpi(robot, pick(20 + 10 * x, i), realisation="paper"),
        )
    ),
    "gains of the PID": lambda robot, x: (
        lambda i: (
            RigidBodyPlant(robot),
            PIDInversion(robot, DT, kp=pick(400 + 100 * x, i)),
        )
    ),
    "disturbances": lambda robot, x: (
        lambda i: (
            RigidBodyPlant(
                robot,
                [
                    Sine(pick(x, i), omega=30.0),
                    Step(pick(x, i), onset=0.02),
                    Ramp(pick(x, i), end=0.05),
                    Pulse(pick(x, i), onset=0.01, duration=0.05),
                ],
            ),
            gpi(robot),
        )
    ),
    "friction": lambda robot, x: (
        lambda i: (
            RigidBodyPlant(robot, friction=Friction(pick(1 + x, i), pick(0.1 + 0.1 * x**2, i))),
            gpi(robot),
        )
    ),
    "torque limits": lambda robot, x: (
        lambda i: (
            RateLimited(Saturated(RigidBodyPlant(robot), pick(robot.limits.effort * (0.1 + x**2), i)), 50.0),
            gpi(robot, effort=pick(robot.limits.effort * (0.1 + x**2), i)),
        )
    ),
    "plants": lambda robot, x: lambda i: (RigidBodyPlant(loaded(robot, x, i)), gpi(robot)),
    "beliefs": lambda robot, x: lambda i: (RigidBodyPlant(robot), gpi(loaded(robot, x, i))),
    "noise, encoder, drop-outs, delay": lambda robot, x: (
        lambda i: (
            Delayed(DropOut(Encoder(noisy(robot, x, i)), 0.1, seed=7 + (i or 0)), 2),
            gpi(robot, pick(20 + x, i)),
        )
    ),
}


def loaded(robot: Robot, x: np.ndarray, i: int | None) -> Robot | RobotBatch:
    robots = [robot.with_payload(robot.tip, mass) for mass in 0.3 * x[:, 0] ** 2]
    return RobotBatch(robots) if i is None else robots[i]


def noisy(robot: Robot, x: np.ndarray, i: int | None) -> Noisy:
    # Row i of a batch draws from seed + i.
    return Noisy(RigidBodyPlant(robot), pick(1e-4 * x**2, i), seed=5 + (i or 0))


# From 16 rows on, the batch kernels run in several threads.
@pytest.mark.parametrize("rows", [3, 17])
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("case", CASES)
def test_a_batch_equals_its_runs_one_by_one_bit_by_bit(case: str, robot: str, rows: int) -> None:
    arm = ROBOTS[robot]
    x = np.random.default_rng(1).uniform(-1.0, 1.0, (rows, arm.n))
    make = CASES[case](arm, x)
    start = arm.middle()
    move = Bezier(start, start + 0.1, duration=0.06)
    batch = simulate(*make(None), move, t_final=0.07)
    assert batch.sizes["rollout"] == rows
    for i in (0, 1, rows - 1):
        assert_same_bits(batch.isel(rollout=i), simulate(*make(i), move, t_final=0.07))


def test_a_batch_of_starts_and_goals_equals_its_runs_one_by_one_bit_by_bit() -> None:
    x = np.random.default_rng(2).uniform(-0.2, 0.2, (4, 3))
    plant, controller = RigidBodyPlant(ARM), gpi()
    batch = simulate(plant, controller, Bezier(x, -x, 0.1), 0.2, q0=1.1 * x, v0=x)
    for i in range(4):
        one = simulate(plant, controller, Bezier(x[i], -x[i], 0.1), 0.2, q0=1.1 * x[i], v0=x[i])
        assert_same_bits(batch.isel(rollout=i), one)


def test_what_is_the_same_for_all_rollouts_needs_no_batch_axis() -> None:
    plant = RigidBodyPlant(ARM, Step([0.1, 0.2, 0.3]))
    one = simulate(plant, gpi(), MOVE, 0.1)
    batch = simulate(plant, gpi(), MOVE, 0.1, q0=np.zeros((2, 3)))
    for i in range(2):
        assert_same_bits(batch.isel(rollout=i), one, (*SAMPLED, "disturbance"))


# Repetition.


def noisy_run(seed: int) -> xr.Dataset:
    plant = DropOut(Noisy(RigidBodyPlant(ARM), 1e-3, 1e-2, seed), 0.2, seed)
    return simulate(plant, gpi(), MOVE, 0.2)


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    first, again, other = noisy_run(3), noisy_run(3), noisy_run(4)
    assert first.identical(again)
    assert_same_bits(first, again)
    assert (first["q_measured"] != other["q_measured"]).any()


def test_a_run_leaves_nothing_behind_in_its_parts() -> None:
    def parts() -> tuple[Delayed, GPI, Bezier]:
        plant = RateLimited(Noisy(RigidBodyPlant(ARM, Sine([0.1, 0.1, 0.1], 9.0)), 1e-4, seed=1), 100.0)
        return Delayed(plant, 1), gpi(), MOVE

    used = parts()
    simulate(*used, t_final=0.3, q0=[0.1, 0.0, 0.0])
    assert simulate(*used, t_final=0.2).identical(simulate(*parts(), t_final=0.2))


def test_init_of_a_used_loop_equals_init_of_a_fresh_one() -> None:
    used, fresh = (ClosedLoop(Noisy(RigidBodyPlant(ARM), 1e-3), gpi(), MOVE) for _ in range(2))
    state = used.init()
    for _ in range(10):
        state = used.step(state).state
    one, other = used.step(used.init()), fresh.step(fresh.init())
    np.testing.assert_array_equal(one.tau, other.tau)
    np.testing.assert_array_equal(one.measured.q, other.measured.q)


def test_a_state_can_be_stepped_from_again_with_the_same_result() -> None:
    plant = Delayed(DropOut(Noisy(RateLimited(RigidBodyPlant(ARM), 100.0), 1e-3), 0.3), 2)
    loop = ClosedLoop(plant, gpi(realisation="paper"), MOVE)
    state = loop.init()
    for _ in range(20):
        state = loop.step(state).state
    first = [loop.step(state)]
    for _ in range(5):
        first.append(loop.step(first[-1].state))
    again = loop.step(state)
    for step in first:
        np.testing.assert_array_equal(step.tau, again.tau)
        np.testing.assert_array_equal(loop.true_state(step.state).q, loop.true_state(again.state).q)
        again = loop.step(again.state)


# The loop by hand.


# 600 samples are more than two of the stretches that `simulate` works in.
@pytest.mark.slow
@pytest.mark.parametrize("batch", [None, 2])
@pytest.mark.parametrize("controller_class", [GPI, PIDInversion])
def test_steps_by_hand_equal_simulate_bit_by_bit(
    controller_class: type[Controller], batch: int | None
) -> None:
    plant = Delayed(Noisy(Saturated(RigidBodyPlant(ARM, Sine([0.1, 0.2, 0.3], 7.0))), 1e-4, seed=2), 1)
    controller = controller_class(ARM, DT)
    q0 = np.zeros(3) if batch is None else np.zeros((batch, 3))
    rollout = simulate(plant, controller, MOVE, 0.6, q0=q0)
    loop = ClosedLoop(plant, controller, MOVE)
    state = loop.init(q0)
    for k in range(600):
        now = rollout.isel(time=k)
        truth = loop.true_state(state)
        np.testing.assert_array_equal(now["q"], truth.q)
        np.testing.assert_array_equal(now["v"], truth.v)
        state, measured, tau = loop.step(state)
        np.testing.assert_array_equal(now["q_measured"], measured.q)
        np.testing.assert_array_equal(now["tau_command"], tau)
        np.testing.assert_array_equal(now["tau"], loop.true_state(state).tau)
    np.testing.assert_array_equal(rollout["q"].isel(time=600), loop.true_state(state).q)


def test_a_target_given_to_step_stands_in_for_the_reference() -> None:
    loop = ClosedLoop(RigidBodyPlant(ARM), gpi(), Hold(np.zeros(3)))
    elsewhere = Target(np.full(3, 0.01), np.zeros(3), np.zeros(3))
    state = loop.init()
    assert (loop.step(state, elsewhere).tau != loop.step(state).tau).all()
    np.testing.assert_array_equal(loop.step(state, loop.reference.at(0.0)).tau, loop.step(state).tau)


class Watching(GPI):
    """A controller that keeps what it was shown."""

    def init(self, measurement: Any, target: Target) -> Any:
        self.shown = [measurement]
        return super().init(measurement, target)

    def step(self, measurement: Any, target: Target, state: Any) -> ControlStep:
        self.shown.append(measurement)
        return super().step(measurement, target, state)


def test_an_output_feedback_controller_is_shown_positions_alone_and_as_measured() -> None:
    controller = Watching(ARM, DT)
    rollout = simulate(Encoder(RigidBodyPlant(ARM), bits=10), controller, MOVE, 0.02)
    assert {type(seen) for seen in controller.shown} == {Measurement}
    counts = rollout["q_measured"].values / (2.0 * np.pi / 2**10)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    np.testing.assert_array_equal([seen.q for seen in controller.shown[1:]], rollout["q_measured"][:-1])
    assert (rollout["q"] != rollout["q_measured"]).any()


def test_a_controller_that_needs_velocities_is_shown_them() -> None:
    class WatchingAll(Watching):
        measurement_type = FullState  # type: ignore[assignment]

    controller = WatchingAll(ARM, DT)
    rollout = simulate(RigidBodyPlant(ARM), controller, MOVE, 0.02)
    assert {type(seen) for seen in controller.shown} == {FullState}
    np.testing.assert_array_equal([seen.v for seen in controller.shown[1:]], rollout["v"][:-1])


# The recording.


def test_a_rollout_begins_at_its_start_and_ends_at_t_final() -> None:
    rollout = simulate(RigidBodyPlant(ARM), gpi(), MOVE, 0.0104, q0=[0.1, 0.2, 0.3], v0=[1.0, 2.0, 3.0])
    np.testing.assert_array_equal(rollout["q"][0], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(rollout["v"][0], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(rollout["time"], DT * np.arange(11))  # whole samples: 0.0104 is 10 of them
    assert float(rollout["t_end"]) == pytest.approx(0.01)
    assert rollout["status"] == Status.FINISHED


def test_references_and_disturbances_are_recorded_as_they_are() -> None:
    load = Sine([0.1, 0.2, 0.3], omega=5.0, onset=0.05)
    rollout = simulate(RigidBodyPlant(ARM, load), gpi(), MOVE, 0.1)
    target = MOVE.at(rollout["time"].values)
    np.testing.assert_array_equal(rollout["q_ref"], target.q)
    np.testing.assert_array_equal(rollout["v_ref"], target.v)
    np.testing.assert_array_equal(rollout["disturbance"], load.torque(rollout["time"].values[:, None]))


def test_the_applied_torque_is_what_the_wires_let_through() -> None:
    plant = RateLimited(Saturated(RigidBodyPlant(ARM), effort=2.0), rate=100.0)
    rollout = simulate(plant, gpi(start="zero"), MOVE, 0.2)
    applied, asked = rollout["tau"].values[:-1], rollout["tau_command"].values[:-1]
    assert np.abs(applied).max() <= 2.0 < np.abs(asked).max()
    # At most 100 N m/s, for 1 ms; one rounding of values up to 2.
    assert np.abs(np.diff(applied, axis=0)).max() <= 0.1 + 1e-15


@settings(max_examples=30)
@given(every=st.integers(1, 700), steps=st.integers(1, 600), batch=st.sampled_from([None, 2]))
def test_record_every_thins_exactly(every: int, steps: int, batch: int | None) -> None:
    plant = RigidBodyPlant(SLED, Sine(1.0, 9.0))
    controller = GPI(SLED, DT)
    q0 = np.zeros(1) if batch is None else np.zeros((batch, 1))
    full = simulate(plant, controller, GLIDE, steps * DT, q0=q0, signals=True)
    thinned = simulate(plant, controller, GLIDE, steps * DT, q0=q0, signals=True, record_every=every)
    assert thinned.identical(full.isel(time=slice(None, None, every)))


SLED = Robot.from_xml(
    '<robot name="sled"><link name="base"/><link name="body"><inertial><mass value="2"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="x" type="prismatic"><parent link="base"/><child link="body"/><axis xyz="1 0 0"/>'
    '<limit lower="-1" upper="1" effort="50" velocity="5"/></joint></robot>'
)
GLIDE = Bezier([0.0], [0.5], duration=0.4)


def test_signals_are_the_states_of_the_law_after_each_sample() -> None:
    plant, controller = RigidBodyPlant(ARM), gpi()
    rollout = simulate(plant, controller, MOVE, 0.05, signals=True)
    loop = ClosedLoop(plant, controller, MOVE)
    state = loop.init()
    for k in range(50):
        state = loop.step(state).state
        for name, value in controller.signals(state.controller).items():
            np.testing.assert_array_equal(rollout[name].isel(time=k), value)
    assert {"lam", "chi", "eta"} <= set(rollout.data_vars)
    assert "lam" not in simulate(plant, controller, MOVE, 0.05)


def test_a_rollout_carries_what_it_was_made_from() -> None:
    plant = Encoder(RigidBodyPlant(ARM.with_payload("tool", 0.1), Step([0.0, 0.1, 0.0])), bits=14)
    rollout = simulate(plant, gpi(ARM.scaled_inertia(0.8), 25.0), MOVE, 0.01)

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    made = json.loads(rollout.attrs["provenance"], parse_constant=refuse)
    assert made["plant"]["robot"]["sha256"] == ARM.provenance["sha256"]
    assert made["plant"]["robot"]["changes"] == [
        {"payload": {"frame": "tool", "mass": 0.1, "com": [0.0, 0.0, 0.0]}}
    ]
    assert made["plant"]["loads"] == [
        {"type": "Step", "amplitude": [0.0, 0.1, 0.0], "onset": 0.0, "end": "inf"}
    ]
    (encoder,) = made["plant"]["io"]
    assert (encoder["type"], encoder["bits"]) == ("Encoder", 14)
    assert made["controller"]["robot"]["changes"] == [{"inertia_scale": 0.8}]
    assert made["controller"]["gains"]["omega_c"] == [25.0] * 3
    assert made["controller"]["dt"] == DT
    assert made["measurement"] == "Measurement"
    assert {"armgpi", "pin", "numpy"} <= set(made["versions"])


# Divergence.


class Breaking(GPI):
    """A controller that says something that is no number, from one sample on, in one rollout."""

    bad: float = np.nan
    at = 300
    row = 1

    def init(self, measurement: Any, target: Target) -> Any:
        return 0, super().init(measurement, target)

    def step(self, measurement: Any, target: Target, state: Any) -> ControlStep:
        k, inner = state
        tau, inner = super().step(measurement, target, inner)
        if k == self.at:
            tau = tau.copy()
            tau[self.row, 1] = self.bad
        return ControlStep(tau, (k + 1, inner))

    def signals(self, state: Any) -> Any:
        return super().signals(state[1])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_rollout_that_breaks_is_stopped_and_the_others_go_on_bit_by_bit(bad: float) -> None:
    controller = Breaking(ARM, DT)
    controller.bad = bad
    q0 = np.zeros((3, 3))
    rollout = simulate(RigidBodyPlant(ARM), controller, MOVE, 0.6, q0=q0)
    well = simulate(RigidBodyPlant(ARM), GPI(ARM, DT), MOVE, 0.6, q0=q0)
    np.testing.assert_array_equal(rollout["status"], [Status.FINISHED, Status.DIVERGED, Status.FINISHED])
    # The torque of sample 300 is bad, so sample 299 is the last one that is whole.
    np.testing.assert_allclose(rollout["t_end"], [0.6, 0.3, 0.6])
    assert_same_bits(rollout.isel(rollout=[0, 2]), well.isel(rollout=[0, 2]))
    assert_same_bits(rollout.isel(rollout=1, time=slice(0, 300)), well.isel(rollout=1, time=slice(0, 300)))
    for name in ("q", "v", "q_measured", "tau_command", "tau"):
        assert np.isnan(rollout[name].isel(rollout=1, time=slice(300, None))).all()
    assert np.isfinite(rollout["q_ref"]).all()


def test_a_controller_too_weak_to_hold_the_arm_lets_it_fall_and_says_when() -> None:
    # Rollout 1 may use a hundredth of the torque that gravity needs.
    effort = np.array([[30.0, 30.0, 15.0], [0.02, 0.02, 0.02]])
    controller = gpi(effort=effort)
    rollout = simulate(RigidBodyPlant(ARM), controller, Hold(np.zeros(3)), 1.0, divergence=0.5)
    np.testing.assert_array_equal(rollout["status"], [Status.FINISHED, Status.DIVERGED])
    end = float(rollout["t_end"][1])
    fallen = simulate(RigidBodyPlant(ARM), gpi(effort=0.02), Hold(np.zeros(3)), 1.0, divergence=100.0)
    beyond = (abs(fallen["q"]) > 0.5).any("joint")
    assert end == pytest.approx(float(fallen["time"][int(beyond.values.argmax())]))
    # Near q = 0 it falls like a rod, q2'' about -3/2 g / length: half a radian takes 0.1 to 0.2 s.
    assert 0.1 < end < 0.2
    assert np.isnan(rollout["q"].isel(rollout=1).sel(time=slice(end, None))).all()
    assert np.isfinite(rollout["q"].isel(rollout=1).sel(time=slice(None, end - 1.5 * DT))).all()


def test_gains_too_fast_for_the_sample_time_diverge_alone() -> None:
    with pytest.warns(ArmgpiWarning, match="too fast"):
        controller = gpi(SLED, np.array([[20.0], [3000.0], [20.0]]), effort=1e9)
    rollout = simulate(RigidBodyPlant(SLED), controller, GLIDE, 0.6)
    np.testing.assert_array_equal(rollout["status"], [Status.FINISHED, Status.DIVERGED, Status.FINISHED])
    well = simulate(RigidBodyPlant(SLED), gpi(SLED, effort=1e9), GLIDE, 0.6)
    for i in (0, 2):
        assert_same_bits(rollout.isel(rollout=i), well)


def test_what_has_diverged_stays_so_when_it_comes_back() -> None:
    robot = SLED
    pushed = RigidBodyPlant(robot, Pulse(np.array([[200.0], [1.0]]), onset=0.1, duration=0.3))
    rollout = simulate(pushed, GPI(robot, DT, FixedGains(5.0)), Hold([0.0]), 5.0, divergence=0.5)
    assert rollout["status"].values.tolist() == [Status.DIVERGED, Status.FINISHED]
    end = float(rollout["t_end"][0])
    assert 0.1 < end < 1.0
    after = rollout.isel(rollout=0).sel(time=slice(end + 0.5 * DT, None))
    assert after.sizes["time"] > 3000
    assert not np.isfinite(after["q"]).any()
    alone = simulate(pushed, GPI(robot, DT, FixedGains(5.0)), Hold([0.0]), 5.0)
    assert float(abs(alone["q"].isel(rollout=0, time=-1)).max()) < 0.5  # without the bound it came back


@pytest.mark.parametrize("batch", [None, 3])
def test_when_all_have_diverged_the_run_is_over(batch: int | None) -> None:
    class Counting(GPI):
        calls = 0

        def step(self, *arguments: Any) -> ControlStep:
            self.calls += 1
            return super().step(*arguments)

    controller = Counting(ARM, DT, effort=0.02)
    q0 = np.zeros(3) if batch is None else np.zeros((batch, 3))
    rollout = simulate(RigidBodyPlant(ARM), controller, Hold(np.zeros(3)), 30.0, q0=q0, divergence=0.5)
    assert (rollout["status"] == Status.DIVERGED).all()
    assert controller.calls < 1000 < 30_000 == rollout.sizes["time"] - 1
    over = rollout["time"] >= rollout["t_end"].max()
    for name in ("q", "q_ref"):
        np.testing.assert_array_equal(np.isnan(rollout[name]).all([*{*rollout[name].dims} - {"time"}]), over)


# Interruption.


class Interrupted(GPI):
    """A controller during whose step at sample `at` the user presses Ctrl-C."""

    at = 0

    def init(self, measurement: Any, target: Target) -> Any:
        self.k = 0
        return super().init(measurement, target)

    def step(self, *arguments: Any) -> ControlStep:
        if self.k == self.at:
            raise KeyboardInterrupt
        self.k += 1
        return super().step(*arguments)


# In the first stretch, in a later one, and right at its edge.
@pytest.mark.parametrize("at", [1, 100, 256, 300])
@pytest.mark.parametrize("batch", [None, 2])
@pytest.mark.parametrize("every", [1, 7])
def test_ctrl_c_keeps_what_is_there(at: int, batch: int | None, every: int) -> None:
    controller = Interrupted(ARM, DT)
    controller.at = at
    q0 = np.zeros(3) if batch is None else np.zeros((batch, 3))
    plant = RigidBodyPlant(ARM, Step([0.1, 0.1, 0.1]))
    with pytest.warns(ArmgpiWarning, match=f"interrupted at t = {at * DT:g} s of 0.6 s"):
        rollout = simulate(plant, controller, MOVE, 0.6, q0=q0, record_every=every, partial=True)
    with pytest.raises(KeyboardInterrupt):
        simulate(plant, controller, MOVE, 0.6, q0=q0, record_every=every)
    whole = simulate(plant, GPI(ARM, DT), MOVE, 0.6, q0=q0, record_every=every)
    assert (rollout["status"] == Status.INTERRUPTED).all()
    np.testing.assert_allclose(rollout["t_end"], at * DT)
    kept = len(range(0, at, every))
    assert rollout.sizes["time"] == kept
    assert_same_bits(rollout, whole.isel(time=slice(0, kept)), (*SAMPLED, "disturbance"))


def test_metrics_alone_of_what_was_interrupted_are_those_of_its_samples() -> None:
    found = {}
    for record in ("all", "metrics"):
        controller = Interrupted(ARM, DT)
        controller.at = 300
        loop = prepare(RigidBodyPlant(ARM), controller, MOVE, 0.6, record=record, backend="numpy")
        with pytest.warns(ArmgpiWarning, match="interrupted"):
            found[record] = loop.run(partial=True)
    whole = metrics.summary(found["all"])
    for name in ("itae", "rms", "isci", "hunting_amplitude"):
        np.testing.assert_allclose(found["metrics"][name], whole[name], rtol=1e-9, atol=1e-12)


def test_ctrl_c_at_once_leaves_an_empty_rollout() -> None:
    with pytest.warns(ArmgpiWarning, match="interrupted"):
        rollout = simulate(RigidBodyPlant(ARM), Interrupted(ARM, DT), MOVE, 0.6, partial=True)
    assert rollout.sizes["time"] == 0
    assert rollout["status"] == Status.INTERRUPTED
    assert set(SAMPLED) <= set(rollout.data_vars)


def test_ctrl_c_does_not_undo_what_had_diverged_before() -> None:
    class Both(Interrupted):
        at = 500

    effort = np.array([[30.0, 30.0, 15.0], [0.02, 0.02, 0.02]])
    controller = Both(ARM, DT, effort=effort)
    with pytest.warns(ArmgpiWarning, match="interrupted"):
        rollout = simulate(
            RigidBodyPlant(ARM), controller, Hold(np.zeros(3)), 1.0, divergence=0.5, partial=True
        )
    np.testing.assert_array_equal(rollout["status"], [Status.INTERRUPTED, Status.DIVERGED])
    assert float(rollout["t_end"][0]) == 0.5 > float(rollout["t_end"][1])


def test_ctrl_c_while_samples_are_stored_loses_and_doubles_none(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = simulate(RigidBodyPlant(ARM), gpi(), MOVE, 0.6)
    store = Recording.store
    calls = iter(range(10))

    def interrupted(self: Recording, *arguments: Any) -> None:
        store(self, *arguments)
        if next(calls) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(Recording, "store", interrupted)
    with pytest.warns(ArmgpiWarning, match="interrupted"):
        rollout = simulate(RigidBodyPlant(ARM), gpi(), MOVE, 0.6, partial=True)
    samples = rollout.sizes["time"]
    assert 0 < samples < 600
    assert float(rollout["t_end"]) == pytest.approx(samples * DT)
    assert_same_bits(rollout, whole.isel(time=slice(0, samples)))


# Bad input: our error, and what it names.

PLANT = RigidBodyPlant(ARM)
SWAPPED = np.dtype(float).newbyteorder()
NARROW = ARM.with_limits(lower=-0.1, upper=0.1)
OTHER_WAY_ROUND = Robot.from_xml(
    "<robot name='r'><link name='a'/>"
    + "".join(
        f"<link name='{link}'><inertial><mass value='1'/>"
        "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        f"<joint name='{joint}' type='revolute'><parent link='{parent}'/><child link='{link}'/>"
        "<limit lower='-3' upper='3' effort='9' velocity='9'/></joint>"
        for parent, joint, link in (("a", "q2", "b"), ("b", "q1", "c"), ("c", "q3", "d"))
    )
    + "</robot>"
)

BAD: dict[str, tuple[Callable[[], Any], type[ArmgpiError], str]] = {
    "a robot for a plant": (lambda: simulate(ARM, gpi(), MOVE, 1.0), ParameterError, "plant"),
    "a class for a controller": (lambda: simulate(PLANT, GPI, MOVE, 1.0), ParameterError, "controller"),
    "an array for a reference": (
        lambda: simulate(PLANT, gpi(), np.zeros(3), 1.0),
        ParameterError,
        "reference",
    ),
    "a controller for another robot": (
        lambda: simulate(PLANT, gpi(PANDA), MOVE, 1.0),
        ParameterError,
        "controller.*q1, q2, q3.*panda_joint1",
    ),
    "a controller for the joints in another order": (
        lambda: simulate(PLANT, gpi(OTHER_WAY_ROUND), MOVE, 1.0),
        ParameterError,
        "controller",
    ),
    "a reference for another robot": (
        lambda: simulate(PLANT, gpi(), Hold(np.zeros(2)), 1.0),
        ArrayError,
        "reference",
    ),
    "batches of different sizes": (
        lambda: simulate(PLANT, gpi(omega=np.full((2, 1), 20.0)), Hold(np.zeros((3, 3))), 1.0),
        ParameterError,
        r"batch.*\[2, 3\]",
    ),
    "a start of another size": (lambda: simulate(PLANT, gpi(), MOVE, 1.0, q0=[0.0, 0.0]), ArrayError, "q0"),
    "a start that is no number": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, q0=[0.0, np.nan, 0.0]),
        ArrayError,
        "q0.*'q2'",
    ),
    "a start in single precision": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, q0=np.zeros(3, np.float32)),
        ArrayError,
        "q0.*float64",
    ),
    "a start in the other byte order": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, q0=np.zeros(3).astype(SWAPPED)),
        ArrayError,
        "q0.*native",
    ),
    "a start velocity of another size": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, v0=[0.0] * 4),
        ArrayError,
        "v0",
    ),
    "a start outside the limits": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, q0=[0.0, 0.0, 4.0]),
        LimitError,
        r"start.*'q3' is 4, outside \[-2.7, 2.7\]",
    ),
    "a start outside the limits of one of several plants": (
        lambda: simulate(
            RigidBodyPlant(RobotBatch([ARM, NARROW])), gpi(), Hold(np.zeros(3)), 1.0, q0=[0.0, 0.5, 0.0]
        ),
        LimitError,
        r"start.*'q2' is 0.5, outside \[-0.1, 0.1\]",
    ),
    "a reference that leaves the limits": (
        lambda: simulate(PLANT, gpi(), Waypoints([[0.0, 0.0, 0.0], [3.5, 0.0, 0.0]], 1.0), 3.0),
        LimitError,
        "reference at t = 0.[5-9].*'q1'",
    ),
    "a reference outside the limits of one of several plants": (
        lambda: simulate(RigidBodyPlant(RobotBatch([ARM, NARROW])), gpi(), MOVE, 1.0),
        LimitError,
        r"reference at t = 0.[1-3].*'q1'.*outside \[-0.1, 0.1\]",
    ),
    "a batch of nobody": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, q0=np.zeros((0, 3))),
        ArrayError,
        "q0.*at least one",
    ),
    "no time": (lambda: simulate(PLANT, gpi(), MOVE, 0.0), ParameterError, "t_final"),
    "a time before now": (lambda: simulate(PLANT, gpi(), MOVE, -1.0), ParameterError, "t_final"),
    "a time without end": (lambda: simulate(PLANT, gpi(), MOVE, np.inf), ParameterError, "t_final"),
    "a time that is no number": (lambda: simulate(PLANT, gpi(), MOVE, np.nan), ParameterError, "t_final"),
    "a time as text": (lambda: simulate(PLANT, gpi(), MOVE, "8"), ParameterError, "t_final"),
    "a truth for a time": (lambda: simulate(PLANT, gpi(), MOVE, True), ParameterError, "t_final"),
    "less than half a sample": (lambda: simulate(PLANT, gpi(), MOVE, 0.4e-3), ParameterError, "sample time"),
    "more samples than there are numbers": (
        lambda: simulate(PLANT, gpi(), MOVE, 1e306),
        ParameterError,
        "t_final",
    ),
    "more than fits into memory": (
        lambda: simulate(PLANT, gpi(), MOVE, 1e12),
        RolloutError,
        "memory.*record_every",
    ),
    "recording every 0": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, record_every=0),
        ParameterError,
        "record_every",
    ),
    "recording every 1.5": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, record_every=1.5),
        ParameterError,
        "record_every",
    ),
    "recording every True": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, record_every=True),
        ParameterError,
        "record_every",
    ),
    "no room to diverge": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, divergence=0.0),
        ParameterError,
        "divergence",
    ),
    "a divergence as text": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, divergence="far"),
        ParameterError,
        "divergence",
    ),
    "a divergence that is no number": (
        lambda: simulate(PLANT, gpi(), MOVE, 1.0, divergence=np.nan),
        ParameterError,
        "divergence",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_by_name(case: str) -> None:
    call, kind, named = BAD[case]
    with pytest.raises(kind, match=named):
        call()


def test_a_run_whose_output_is_no_terminal_prints_nothing(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The clock leaps, so that every run is a long one.
    ticks = iter(range(0, 10**9, 100))
    monkeypatch.setattr("time.monotonic", lambda: float(next(ticks)))
    simulate(PLANT, gpi(), MOVE, 0.6)
    assert capfd.readouterr() == ("", "")


def test_an_arm_that_stands_far_from_zero_has_not_diverged() -> None:
    far = np.array([0.9, 0.8, -0.9])
    rollout = simulate(RigidBodyPlant(ARM), gpi(), Hold(far), 0.05, divergence=1.0, backend="numpy")
    assert rollout["status"] == Status.FINISHED
