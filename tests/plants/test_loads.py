"""Disturbance torques: their values in time, and what they do to a plant."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machines import sled, swing
from scipy.integrate import solve_ivp

from armgpi import Load, Pulse, Ramp, RigidBodyPlant, Robot, Sine, Step
from armgpi.errors import ArmgpiError, ArrayError, ParameterError
from armgpi.plants.loads import multi_sine, paper_disturbances

Array = npt.NDArray[np.float64]

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
SLED = sled()

times = st.floats(0.0, 50.0)
torques = st.floats(-10.0, 10.0)


def at(load: Load, *t: float) -> list[float]:
    """Return a load's torque on one joint at some times."""
    return np.ravel(load.torque(np.array(t)[:, None])).tolist()


def printed(t: float) -> list[float]:
    """Return the disturbance torques of scenario 3 as eqs. 29-31 print them."""
    one = 0.7 * math.cos(0.1 * t) if t >= 10.0 else 0.0
    two = 0.3 * math.cos(0.1 * t) + 0.2 * math.sin(0.5 * t) if t >= 15.0 else 0.0
    three = 0.2 * math.sin(0.1 * t) + 0.1 * math.sin(0.5 * t) if t >= 20.0 else 0.0
    return [one, two, three]


@given(st.lists(times, min_size=1, max_size=10))
def test_the_disturbances_of_the_paper_are_equations_29_to_31(t: list[float]) -> None:
    t = [*t, 0.0, 10.0, 15.0, 20.0, *(np.nextafter(onset, 0.0) for onset in (10.0, 15.0, 20.0))]
    plant = RigidBodyPlant(ARM, paper_disturbances())
    # A cosine is a sine of pi / 2, which is rounded.
    np.testing.assert_allclose(plant.disturbance(np.array(t)), [printed(x) for x in t], atol=1e-15)


def test_a_step_lasts_from_its_onset_to_just_before_its_end() -> None:
    load = Step(2.0, onset=1.0, end=3.0)
    just_before = float(np.nextafter(1.0, 0.0)), float(np.nextafter(3.0, 0.0))
    assert at(load, 0.0, just_before[0], 1.0, just_before[1], 3.0, 9.0) == [0.0, 0.0, 2.0, 2.0, 0.0, 0.0]
    assert at(Step(2.0), 0.0, 1e9) == [2.0, 2.0]


def test_a_ramp_grows_from_its_onset_and_stays_after_its_end() -> None:
    assert at(Ramp(0.5, onset=1.0, end=3.0), 0.0, 1.0, 2.0, 3.0, 9.0) == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert at(Ramp(0.5), 0.0, 10.0) == [0.0, 5.0]


@given(torques, st.floats(0.0, 20.0), st.floats(-4.0, 4.0), times)
def test_a_sine_counts_its_phase_from_time_zero(
    amplitude: float, omega: float, phase: float, t: float
) -> None:
    load = Sine(amplitude, omega, phase, onset=5.0, end=30.0)
    expected = amplitude * math.sin(omega * t + phase) if 5.0 <= t < 30.0 else 0.0
    assert at(load, t) == pytest.approx([expected], abs=1e-12)


def test_a_pulse_is_smooth_and_gives_half_its_height_times_its_duration() -> None:
    load = Pulse(4.0, onset=1.0, duration=0.5)
    t = np.linspace(0.5, 2.0, 15_001)
    push = load.torque(t)
    assert push.max() == pytest.approx(4.0)
    assert at(load, 0.0, 1.0, 1.25, 9.0) == [0.0, 0.0, 4.0, pytest.approx(0.0, abs=1e-30)]
    assert np.trapezoid(push, t) == pytest.approx(0.5 * 4.0 * 0.5)
    assert np.abs(np.diff(push)).max() <= 4.0 * math.pi / 0.5 * 1e-4 * (1.0 + 1e-6)


def test_a_multi_sine_is_the_sum_of_its_sines() -> None:
    loads = multi_sine([[1.0], [2.0], [3.0]], [1.0, 5.0, 9.0], [0.1, 0.2, 0.3], onset=1.0)
    t = np.array([0.0, 0.5, 1.0, 7.3])
    expected = [
        (x >= 1.0) * sum(a * math.sin(w * x + p) for a, w, p in ((1, 1, 0.1), (2, 5, 0.2), (3, 9, 0.3)))
        for x in t
    ]
    disturbance = RigidBodyPlant(SLED, loads).disturbance(t)
    assert disturbance is not None
    np.testing.assert_allclose(disturbance[:, 0], expected, atol=1e-14)
    with pytest.raises(ParameterError, match="omegas"):
        multi_sine([1.0, 2.0], [1.0])


def slide(plant: RigidBodyPlant, samples: int, dt: float = DT, force: float = 0.0) -> tuple[float, float]:
    """Return position and velocity of the sled after so many samples from rest."""
    state = plant.init(np.zeros(1), np.zeros(1))
    for _ in range(samples):
        state = plant.step(np.array([force]), state, dt)
    return float(state.q[0]), float(state.v[0])


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("onset", [0.0, 0.1, 0.3])
def test_a_load_opposes_the_motor_from_its_sample_on(onset: float, substeps: int) -> None:
    # On the sled everything is a polynomial that Runge-Kutta integrates exactly. A load that sets in at a
    # sample is told from one a sample later by the stages' times: to 1e-9 of a substep.
    loads = [Step(2.0, onset), Ramp(3.0, onset, end=0.4)]
    q, v = slide(RigidBodyPlant(SLED, loads, substeps=substeps), 400, force=5.0)
    t, s = 0.4, 0.4 - onset
    assert v == pytest.approx(5.0 * t - 2.0 * s - 3.0 * s**2 / 2.0, abs=1e-11)
    assert q == pytest.approx(5.0 * t**2 / 2.0 - 2.0 * s**2 / 2.0 - 3.0 * s**3 / 6.0, abs=1e-11)


def test_a_push_that_is_over_leaves_its_momentum() -> None:
    _, v = slide(RigidBodyPlant(SLED, Step(2.0, onset=0.1, end=0.25)), 400)
    assert v == pytest.approx(-2.0 * 0.15, abs=1e-11)


def test_an_onset_between_samples_is_felt_to_within_a_sample() -> None:
    _, v = slide(RigidBodyPlant(SLED, Step(2.0, onset=0.1004)), 400)
    assert v == pytest.approx(-2.0 * (0.4 - 0.1004), abs=2.0 * DT)


def test_smooth_loads_on_a_pendulum_are_integrated_at_order_four() -> None:
    pendulum, t_final = swing(), 1.0
    loads = [Sine(3.0, 7.0, 0.3), Pulse(5.0, onset=0.2, duration=0.6)]

    def motion(t: float, x: Array) -> list[float]:
        push = 3.0 * math.sin(7.0 * t + 0.3)
        push += 5.0 * math.sin(math.pi * (t - 0.2) / 0.6) ** 2 if 0.2 < t < 0.8 else 0.0
        # A rod of 1 kg and 1 m about its end: inertia 1/3 kg m^2.
        return [x[1], 3.0 * (1.5 - push - 9.81 * 0.5 * math.cos(x[0]))]

    exact = np.array([0.2, 0.0])
    for begin, end in ((0.0, 0.2), (0.2, 0.8), (0.8, 1.0)):  # a pulse has no third derivative at its ends
        exact = solve_ivp(motion, (begin, end), exact, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    counts = np.array([25, 50, 100, 200])
    errors = []
    for samples in counts:
        plant = RigidBodyPlant(pendulum, loads)
        state = plant.init(np.array([0.2]), np.zeros(1))
        for _ in range(samples):
            state = plant.step(np.array([1.5]), state, t_final / samples)
        errors.append(np.hypot(state.q[0] - exact[0], state.v[0] - exact[1]))
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize("substeps", [2, 5])
def test_substeps_are_shorter_samples_under_a_held_torque(substeps: int) -> None:
    loads = [Sine([0.5, 0.0, 0.2], 20.0), Step([0.0, 0.3, 0.0], onset=0.1)]
    q, v = np.array([[0.1, 0.4, -0.6], [0.5, 0.0, 1.0]])
    coarse, fine = RigidBodyPlant(ARM, loads, substeps=substeps), RigidBodyPlant(ARM, loads)
    state, expected = coarse.init(q, v), fine.init(q, v)
    for k in range(300):
        tau = np.sin([1.0 * k, 2.0 * k, 3.0 * k])
        state = coarse.step(tau, state, DT)
        for _ in range(substeps):
            expected = fine.step(tau, expected, DT / substeps)
    np.testing.assert_allclose(state.q, expected.q, atol=1e-11)
    np.testing.assert_allclose(state.v, expected.v, atol=1e-10)


def test_a_plant_remembers_nothing_of_the_times_it_was_at() -> None:
    # Loads are worked out ahead in stretches; jumping about in time, and to another dt, must not show.
    plant = RigidBodyPlant(SLED, Sine(1.0, 3.0))
    fresh = {
        (k, dt): RigidBodyPlant(SLED, Sine(1.0, 3.0)).step(np.zeros(1), start(k), dt)
        for k in (0, 255, 256, 257, 1000)
        for dt in (1e-3, 2e-3)
    }
    for (k, dt), expected in [*fresh.items(), *reversed(fresh.items())]:
        np.testing.assert_array_equal(plant.step(np.zeros(1), start(k), dt).v, expected.v)


def start(k: int) -> Any:
    """Return the sled at rest at sample k."""
    return RigidBodyPlant(SLED).init(np.zeros(1), np.zeros(1))._replace(k=k)


def test_rollouts_of_a_batch_may_have_loads_of_their_own() -> None:
    amplitudes = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, -1.0]])
    plant = RigidBodyPlant(ARM, [Step(amplitudes), Sine(0.1, 5.0)])
    assert plant.batch == 2
    assert np.shape(plant.disturbance(np.zeros(4))) == (4, 2, 3)
    state = plant.init(np.zeros((2, 3)), np.zeros((2, 3)))
    for _ in range(20):
        state = plant.step(np.zeros((2, 3)), state, DT)
    for row in range(2):
        one = RigidBodyPlant(ARM, [Step(amplitudes[row]), Sine(0.1, 5.0)])
        alone = one.init(np.zeros(3), np.zeros(3))
        for _ in range(20):
            alone = one.step(np.zeros(3), alone, DT)
        np.testing.assert_array_equal(state.q[row], alone.q)


def test_without_loads_there_is_no_disturbance() -> None:
    assert RigidBodyPlant(ARM).disturbance(np.zeros(3)) is None


def test_loads_describe_themselves_as_plain_data() -> None:
    told = json.loads(json.dumps(RigidBodyPlant(ARM, paper_disturbances()).describe()))
    first = {"type": "Sine", "amplitude": [0.7, 0.0, 0.0], "omega": 0.1, "phase": math.pi / 2, "onset": 10.0}
    assert told["loads"][0].items() >= first.items()


@pytest.mark.parametrize(
    ("make", "error", "named"),
    [
        (lambda: Step(math.nan), ArrayError, "amplitude"),
        (lambda: Step("much"), ArrayError, "amplitude"),
        (lambda: Step(1.0, onset=math.inf), ParameterError, "onset"),
        (lambda: Step(1.0, onset=math.nan), ParameterError, "onset"),
        (lambda: Step(1.0, onset="late"), ParameterError, "onset"),
        (lambda: Step(1.0, onset=2.0, end=1.0), ParameterError, "end"),
        (lambda: Ramp(np.ones(3, np.float32)), ArrayError, "slope"),
        (lambda: Sine(1.0, math.inf), ArrayError, "omega"),
        (lambda: Pulse(1.0, onset=0.0, duration=0.0), ParameterError, "duration"),
        (lambda: Pulse(1.0, onset=0.0, duration=math.nan), ParameterError, "duration"),
        (lambda: RigidBodyPlant(ARM, Step([1.0, 2.0])), ArrayError, "loads.*Step"),
        (lambda: RigidBodyPlant(ARM, [Step(np.ones((2, 3))), Step(np.ones((3, 3)))]), ArmgpiError, "batch"),
        (lambda: RigidBodyPlant(ARM, [1.0]), ParameterError, "loads"),
        (lambda: RigidBodyPlant(ARM, 1.0), ParameterError, "loads"),
    ],
)
def test_a_bad_load_is_named(make: Any, error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        make()
