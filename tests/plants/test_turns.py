"""Continuous joints: turns are never lost, and wrapping is a choice."""

from __future__ import annotations

import numpy as np
import pytest
from machines import swing

from armgpi import GPI, Bezier, Encoder, RigidBodyPlant, Robot, Status, Waypoints, metrics, simulate
from armgpi.plants.turns import SingleTurn, Unwrapped

TURN = 2.0 * np.pi
COUNT = TURN / 2**16
KINOVA = Robot.load("kinova")
CONTINUOUS = np.array([kind == "continuous" for kind in KINOVA.joint_types])
#: Three turns of every continuous joint, and back.
START = KINOVA.middle()
FAR = START + 3.0 * TURN * CONTINUOUS
THERE_AND_BACK = Waypoints([START, FAR, START], durations=4.0, holds=[0.1, 0.2, 0.5])


def test_three_turns_forward_and_back_are_followed_without_a_jump() -> None:
    plant = RigidBodyPlant(KINOVA)
    rollout = simulate(plant, GPI(KINOVA, dt=1e-3), THERE_AND_BACK, t_final=8.8)
    assert (rollout["status"] == Status.FINISHED).all()
    q = rollout["q"].values
    assert np.abs(q[..., CONTINUOUS]).max() == pytest.approx(3.0 * TURN, abs=0.05)
    # No sample to sample difference beyond the reference's own speed.
    fastest = np.abs(np.diff(THERE_AND_BACK.at(rollout["time"].values).q, axis=0)).max()
    assert np.abs(np.diff(q, axis=rollout["q"].dims.index("time"))).max() < 1.1 * fastest
    assert float(metrics.final_error(rollout).max()) < 1e-4


def test_a_wrapped_encoder_is_unwrapped_to_the_count() -> None:
    arm = swing(1, axis="0 0 1")  # level: it turns by what it is given
    exact = Encoder(RigidBodyPlant(arm), bits=12)
    counted, dt = Unwrapped(SingleTurn(exact)), 1e-2
    state = counted.init(np.array([1.0]), np.array([0.0]))
    most = 0.0
    for k in range(1000):  # three turns one way, then five the other
        torque = np.array([np.cos(2.0 * np.pi * k / 500.0) * (1.0 if k < 500 else -1.6) * 10.0])
        state = counted.step(torque, state, dt)
        truth = counted.true_state(state)
        expected = exact.measure(truth).q
        np.testing.assert_allclose(counted.measure(state).q, expected, rtol=0, atol=1e-12)
        most = max(most, abs(float(truth.q[0]) - 1.0))
    assert most > 3.0 * TURN


def test_a_controller_behind_the_count_notices_nothing() -> None:
    exact, gpi = Encoder(RigidBodyPlant(KINOVA), bits=16), GPI(KINOVA, dt=1e-3)
    one, two = (simulate(p, gpi, THERE_AND_BACK, t_final=8.8) for p in (exact, Unwrapped(SingleTurn(exact))))
    assert (two["status"] == Status.FINISHED).all()
    # Rounding falls to another count now and then, no more.
    difference = metrics.peak_error(two) - metrics.peak_error(one)
    assert float(np.abs(difference).max()) < 2.0 * COUNT
    assert float(metrics.final_error(two).max()) < 2.0 * COUNT


def test_without_the_count_the_arm_is_seen_to_jump_by_a_turn() -> None:
    wrapped = SingleTurn(RigidBodyPlant(KINOVA))
    q = FAR + 0.25
    seen = wrapped.measure(wrapped.init(q, np.zeros_like(q))).q
    np.testing.assert_allclose(seen[CONTINUOUS], 0.25, atol=1e-12)
    np.testing.assert_array_equal(seen[~CONTINUOUS], q[~CONTINUOUS])
    # The edge belongs to one side: [-pi, pi).
    edge = np.where(CONTINUOUS, np.pi, START)
    assert (wrapped.measure(wrapped.init(edge, 0.0 * q)).q[CONTINUOUS] == -np.pi).all()


def test_a_start_some_turns_away_is_where_it_was_said_to_be() -> None:
    counted = Unwrapped(SingleTurn(RigidBodyPlant(KINOVA)))
    np.testing.assert_allclose(counted.measure(counted.init(FAR, 0.0 * FAR)).q, FAR, atol=1e-12)
    batch = np.stack([FAR, START, -FAR * CONTINUOUS + START])
    np.testing.assert_allclose(counted.measure(counted.init(batch, 0.0 * batch)).q, batch, atol=1e-12)


def test_the_short_way_is_a_choice() -> None:
    goal = START + (3.0 * TURN + 0.5) * CONTINUOUS
    short = KINOVA.wrap(goal, near=START)
    np.testing.assert_allclose(short, START + 0.5 * CONTINUOUS, atol=1e-12)
    np.testing.assert_allclose(KINOVA.wrap(goal)[CONTINUOUS], 0.5, atol=1e-12)
    np.testing.assert_array_equal(KINOVA.wrap(goal, near=goal), goal)
    rows = KINOVA.wrap(np.stack([goal, goal]), near=START)
    np.testing.assert_allclose(rows, [short, short], atol=1e-12)
    # A revolute joint with limits beyond a turn is no continuous one: it stays.
    ur5 = Robot.load("ur5")
    q = np.full(6, 6.0)
    np.testing.assert_array_equal(ur5.wrap(q), q)
    # And by itself nothing wraps: the goal is three turns away.
    assert Bezier(START, goal, duration=1.0).at(np.array([1.0])).q[0, 0] == pytest.approx(goal[0])
