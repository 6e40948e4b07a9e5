"""Faults of encoders and motors: what is measured and given, and what a supervisor says of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from armgpi import (
    GPI,
    Bezier,
    Encoder,
    MotorFault,
    RigidBodyPlant,
    Robot,
    Saturated,
    SensorFault,
    Supervisor,
    simulate,
)
from armgpi.config import build, parse
from armgpi.config import experiment as experiments
from armgpi.errors import ArrayError, ConfigError, ParameterError
from armgpi.plants import faults
from armgpi.plants.plant import PlantState

DT, ONSET = 1e-3, 0.05
ARM = Robot.load("anthropomorphic3")
SECOND = np.array([0.0, 1.0, 0.0])
MOVE = Bezier([0.0, 0.2, 0.0], [0.2, 0.4, -0.2], duration=0.2)


def run(plant: Any, seconds: float = 0.1, **options: Any) -> Any:
    return simulate(plant, GPI(ARM, DT), MOVE, seconds, progress=False, **options)


def sensor(**given: Any) -> SensorFault:
    return SensorFault(Saturated(RigidBodyPlant(ARM)), onset=ONSET, **given)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize(("gain", "offset"), [(0.0, 0.0), (-1.0, 0.0), (1.05, 0.0), (1.0, 0.5), (0.0, 0.5)])
def test_a_sensor_that_fails_measures_what_it_says(gain: float, offset: float, backend: str) -> None:
    found = run(sensor(end=0.08, gain=1.0 + (gain - 1.0) * SECOND, offset=offset * SECOND), backend=backend)
    q, seen, k = found["q"].values, found["q_measured"].values, np.arange(101)
    failing = (k >= 50) & (k < 80)
    last = q[49, 1]
    expected = q.copy()
    expected[failing, 1] = last + gain * (q[failing, 1] - last) + offset
    np.testing.assert_allclose(seen, expected, rtol=0.0, atol=1e-15)


def test_a_sensor_that_has_failed_measures_nan() -> None:
    found = run(sensor(end=0.051, lost=SECOND + 0.5 * (1.0 - SECOND)), supervisor=Supervisor())
    nan = np.isnan(found["q_measured"].values)
    assert nan[50, 1]
    assert nan.sum() == 1
    assert np.isfinite(found["tau"].values).all()


def test_a_fault_begins_with_the_sample_to_which_it_is_nearest() -> None:
    zero = np.zeros(3)
    for onset, first in ((0.0, 0), (0.3, 1), (0.375, 1), (0.376, 2), (1.0, 4)):
        begun = [faults._has_begun(PlantState(k, zero, zero, zero), onset, 0.25).tolist() for k in range(6)]
        assert begun == [[float(k >= first)] * 3 for k in range(6)]


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_a_motor_that_fails_gives_its_share(backend: str) -> None:
    found = run(
        MotorFault(RigidBodyPlant(ARM), onset=ONSET, end=0.08, gain=1.0 - 1.5 * SECOND), backend=backend
    )
    given, asked = found["tau"].values, found["tau_command"].values
    share = np.ones((101, 3))
    share[50:80, 1] = -0.5
    np.testing.assert_array_equal(given[:100], (share * asked)[:100])


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("sensor_fault: {onset: 0.3, gain: {q2: 0}}", "FROZEN (q2)"),
        ("sensor_fault: {onset: 0.3, gain: {q2: -1}}", "JUMP (q2)"),
        ("sensor_fault: {onset: 0.3, end: 0.301, offset: {q3: 1}}", "JUMP (q3)"),
        ("sensor_fault: {onset: 0.3, lost: {q1: 1}}", "NOT_FINITE (q1)"),
        ("motor_fault: {onset: 0.3, gain: {q2: -1}}", "RESPONSE (q2)"),
    ],
)
def test_a_fault_in_an_experiment_file_is_found_by_its_name(fault: str, reason: str) -> None:
    text = f"""
robot: {{name: anthropomorphic3}}
plant: {{encoder_bits: 16, {fault}}}
controllers: [{{type: gpi, omega: 20}}]
reference: {{points: [[0, 0.3, 0], [0.5, 0.6, -0.3]], durations: 0.6}}
supervisor: {{}}
t_final: 0.5
"""
    (record,) = experiments.record_all(build(*parse(text, "fault.yaml"))).values()
    (said,) = record.ends()
    assert reason in said


def test_faults_by_rollout_are_those_of_single_runs() -> None:
    onsets, gains = np.array([[0.02], [0.05]]), np.array([[1.0, -1.0, 1.0], [1.0, 0.5, 1.0]])
    both = run(MotorFault(RigidBodyPlant(ARM), onset=onsets, gain=gains))
    for i in range(2):
        alone = run(MotorFault(RigidBodyPlant(ARM), onset=float(onsets[i, 0]), gain=gains[i]))
        np.testing.assert_array_equal(both["q"].isel(rollout=i), alone["q"])


@pytest.mark.parametrize("kind", [SensorFault, MotorFault])
def test_bad_values_are_refused_by_name(kind: type) -> None:
    plant = Encoder(RigidBodyPlant(ARM), 16)
    for given, said in (
        ({"onset": 0.5, "end": 0.2}, "end must be a time after the onset"),
        ({"onset": -1.0}, "onset"),
        ({"onset": np.nan}, "onset"),
        ({"onset": 0.5, "gain": np.array([1.0, np.inf, 0.0])}, "gain"),
    ):
        with pytest.raises((ParameterError, ArrayError), match=said):
            kind(plant, **given)
    with pytest.raises(ConfigError, match="there is no joint named 'q9'"):
        build(*parse("robot: {name: anthropomorphic3}\nplant: {motor_fault: {onset: 1, gain: {q9: 0}}}", "f"))
