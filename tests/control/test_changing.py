"""Stiffness, limit and target change while a spring runs: without a step of torque, in Python and in C."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi.control.controller import Measurement
from armgpi.errors import ArrayError, ParameterError
from armgpi.hardware.export.controller import ExportedController
from armgpi.references.reference import Target

DT = 1e-3
ARM = armgpi.Robot.load("ur5").with_armature(0.4)
HOME = np.array([0.0, -1.2, 1.6, -1.97, -1.5708, 0.0])
LAW = armgpi.CartesianImpedance(ARM, DT, force_limit=30.0)
CALM = Target(HOME, np.zeros(6), np.zeros(6))


def run(changes: dict[int, dict[str, Any]], samples: int, force: float = 10.0) -> tuple[Any, Any]:
    """Return torques and tool positions of a run under a hand's force, with changes at some samples."""
    plant = armgpi.RigidBodyPlant(ARM, environment=[armgpi.ToolForce([0.0, force, 0.0])])
    loop = armgpi.ClosedLoop(plant, LAW, armgpi.Hold(HOME))
    state, torques, places = loop.init(), [], []
    for k in range(samples):
        if k in changes:
            state = state._replace(controller=LAW.changed(state.controller, **changes[k]))
        state, measured, tau = loop.step(state)
        torques.append(tau)
        places.append(ARM.frame_pose(ARM.tip, measured.q).translation)
    return np.array(torques), np.array(places) - places[0]


def test_a_new_stiffness_gives_way_by_force_over_it_and_steps_no_torque() -> None:
    torques, places = run({1200: {"stiffness": [1000.0] * 3 + [60.0] * 3}}, 2600)
    assert places[1199, 1] == pytest.approx(0.02, rel=0.03)
    assert places[-1, 1] == pytest.approx(0.01, rel=0.03)
    change = np.abs(np.diff(torques, axis=0)).max(axis=1)
    # Changing 500 N/m at 20 mm by a hundredth of the way a sample: 0.1 N, on levers below a metre.
    assert change[1195:1400].max() < 0.15


def test_a_guided_arm_stays_where_it_was_left_and_returns_when_asked() -> None:
    changes: dict[int, dict[str, Any]] = {
        300: {"guided": True},
        600: {"guided": False},
        1500: {"moved": np.zeros(6)},
    }
    torques, places = run(changes, 2600)
    change = np.abs(np.diff(torques, axis=0)).max(axis=1)
    for k in changes:
        # The spring of 10 N goes by 4 % of it a sample (root and target), on levers below 0.7 m.
        assert change[k - 1] < 0.04 * 10.0 * 0.7 + 1.5 * change[k - 12 : k - 2].max()
    assert places[600, 1] > 0.05
    # It holds beside its target, and gives way to the hand by force over stiffness from there.
    assert places[1499, 1] > 0.05
    assert places[-1, 1] == pytest.approx(0.02, rel=0.1)


def test_a_target_that_jumps_moves_the_arm_without_a_step_of_torque() -> None:
    there = HOME + np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    state = LAW.init(Measurement(HOME), CALM)
    before = LAW.step(Measurement(HOME), CALM, state)
    jumped = Target(there, np.zeros(6), np.zeros(6))
    moved = LAW.changed(before.state, moved=HOME - there)
    after = LAW.step(Measurement(HOME), jumped, moved._replace(e=HOME - there))
    stepped = LAW.step(Measurement(HOME), jumped, before.state)
    assert np.abs(after.tau - before.tau).max() < 0.02 * np.abs(stepped.tau - before.tau).max()
    state = after.state
    for _ in range(2000):
        state = LAW.step(Measurement(there), jumped, state).state
    assert np.abs(state.offset).max() < 1e-6


def test_exported_c_changes_as_python_does() -> None:
    made = ExportedController.of(LAW)
    known, there = LAW.init(Measurement(HOME), CALM), made.init(Measurement(HOME), CALM)
    goal = np.array([800.0, 400.0, 500.0, 20.0, 30.0, 40.0])
    numbers = there.view(np.float64)
    # `goal[6]` of the struct: no other part has these six numbers in a row.
    (at,) = (i for i in range(len(numbers) - 5) if np.array_equal(numbers[i : i + 6], LAW.stiffness))
    numbers[at : at + 6] = goal
    known = LAW.changed(known, stiffness=goal)
    for k in range(200):
        q = HOME + 0.01 * (1.0 - np.cos(0.01 * k * np.arange(1, 7)))
        tau, known = LAW.step(Measurement(q), CALM, known)
        said, there = made.step(Measurement(q), CALM, there)
        assert made.report(there).reason == "none"
        np.testing.assert_allclose(said, tau, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        known.root[0], np.sqrt(500.0) + 0.86 * (np.sqrt(800.0) - np.sqrt(500.0)), rtol=0.05
    )


def test_to_a_supervisor_being_off_the_reference_is_no_fault_and_speed_is() -> None:
    plant = armgpi.RigidBodyPlant(ARM, environment=[armgpi.ToolForce([0.0, 0.0, -60.0], onset=0.1, end=1.2)])
    soft = armgpi.CartesianImpedance(ARM, DT, stiffness=[80.0] * 3 + [30.0] * 3)
    run = armgpi.simulate(plant, armgpi.Supervised(soft), armgpi.Hold(HOME), 1.5, backend="auto")
    off = np.abs(run["q"].values - HOME).max()
    assert off > 0.5
    assert run["status"] == armgpi.Status.FINISHED
    strict = armgpi.Supervised(soft, armgpi.Supervisor(following=0.3))
    stopped = armgpi.simulate(plant, strict, armgpi.Hold(HOME), 1.5, backend="auto")
    assert stopped["status"] == armgpi.Status.STOPPED
    thrown = armgpi.RigidBodyPlant(ARM, environment=[armgpi.ToolForce([0.0, 900.0, 0.0], onset=0.1, end=0.5)])
    caught = armgpi.simulate(thrown, armgpi.Supervised(soft), armgpi.Hold(HOME), 0.5, backend="auto")
    assert caught["status"] == armgpi.Status.STOPPED


def test_what_cannot_be_is_refused() -> None:
    state = LAW.init(Measurement(HOME), CALM)
    with pytest.raises(ParameterError, match="from 0 to the largest"):
        LAW.changed(state, stiffness=[1e9] * 6)
    with pytest.raises(ArrayError, match="shape"):
        LAW.changed(state, stiffness=[1.0, 2.0])
    with pytest.raises(ParameterError, match="positive"):
        LAW.changed(state, limit=0.0)
    with pytest.raises(ParameterError, match="guided"):
        LAW.changed(state, guided=1)
    free = armgpi.JointImpedance(ARM, DT)
    with pytest.raises(ParameterError, match="without a limit"):
        free.changed(free.init(Measurement(HOME), CALM), limit=3.0)
