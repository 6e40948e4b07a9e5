"""Sensors: encoder counts, noise, delay and drop-outs, alone and on top of each other."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import sled, swing
from scipy.signal import cont2discrete, lfilter

from armgpi import (
    GPI,
    Delayed,
    Differentiated,
    DropOut,
    Encoder,
    FixedGains,
    FullState,
    Hold,
    Noisy,
    Plant,
    RateLimited,
    RigidBodyPlant,
    Robot,
    Saturated,
    simulate,
)
from armgpi.errors import ArmgpiError, ArrayError, ParameterError

Array = npt.NDArray[np.float64]

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
STILL = RigidBodyPlant(ARM)
ZERO = np.zeros(3)


def readings(plant: Plant, count: int, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return true positions, measured positions and measured velocities of an arm without torque."""
    state = plant.init(q, v)
    rows = []
    for _ in range(count):
        measured = plant.measure(state)
        rows.append((plant.true_state(state).q, measured.q, measured.v))
        state = plant.step(np.zeros_like(q), state, DT)
    true, seen_q, seen_v = map(np.array, zip(*rows, strict=True))
    return true, seen_q, seen_v


def drift(plant: Callable[[Plant], Plant], count: int, joints: int = 1) -> tuple[Array, Array, Array]:
    """Return the readings of a level arm turning at 1 rad/s: a new position at every sample."""
    robot = swing(joints, axis="0 0 1") if joints > 1 else sled()
    return readings(plant(RigidBodyPlant(robot)), count, np.zeros(joints), np.ones(joints))


@given(st.integers(1, 30), st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3))
def test_an_encoder_gives_the_nearest_count(bits: int, q: list[float]) -> None:
    encoder = Encoder(STILL, bits)
    true, v = np.array(q), np.array([1.0, -2.0, 3.0])
    measured = encoder.measure(encoder.init(true, v))
    step = 2.0 * math.pi / 2**bits
    counts = measured.q / step
    np.testing.assert_allclose(counts, np.rint(counts), rtol=1e-15)
    assert (np.abs(measured.q - true) <= 0.5 * step * (1.0 + 1e-9)).all()
    np.testing.assert_array_equal(measured.v, v)


def test_an_encoder_divides_a_turn_or_the_travel_of_a_slide() -> None:
    for robot, length in (
        (ARM, 2.0 * math.pi),
        (sled(bounds='lower="-0.25" upper="0.75"'), 1.0),
        (sled(bounds='lower="0" upper="3"'), 3.0),
    ):
        np.testing.assert_array_equal(Encoder(RigidBodyPlant(robot), 10).step_size, length / 1024)


def test_an_encoder_says_its_bits_once_where_all_joints_have_the_same() -> None:
    one, two = swing(1), swing(2)
    assert Encoder(RigidBodyPlant(one), 12).values() == {"bits": 12}
    assert Encoder(RigidBodyPlant(two), [12, 12]).values() == {"bits": 12}
    assert Encoder(RigidBodyPlant(two), [12, 14]).values() == {"bits": [12, 14]}


def test_an_encoder_reads_a_slide_without_travel() -> None:
    stuck = RigidBodyPlant(sled(bounds=""))  # a URDF limit without lower and upper means [0, 0]
    encoder = Encoder(stuck)
    assert np.isfinite(encoder.measure(encoder.init(np.zeros(1), np.zeros(1))).q).all()


def test_noise_has_the_stated_deviation_and_no_memory() -> None:
    std_q, std_v = np.array([1e-3, 2e-3]), np.array([1e-2, 0.0])
    count = 4000
    true, q, v = drift(lambda plant: Noisy(plant, std_q, std_v, seed=5), count, joints=2)
    noise_q, noise_v = (
        q - true,
        v - readings(RigidBodyPlant(swing(2, axis="0 0 1")), count, *np.array([[0, 0], [1, 1.0]]))[2],
    )
    # Four standard errors of mean, deviation and correlation.
    assert (np.abs(noise_q.mean(axis=0)) < 4.0 * std_q / math.sqrt(count)).all()
    np.testing.assert_allclose(noise_q.std(axis=0), std_q, rtol=4.0 / math.sqrt(2 * count))
    np.testing.assert_allclose(noise_v.std(axis=0), std_v, rtol=4.0 / math.sqrt(2 * count))
    unit = np.column_stack([noise_q / std_q, noise_v[:, 0] / std_v[0]])
    for lag in (1, 2):
        assert np.abs(unit[lag:].T @ unit[:-lag] / count).max() < 4.0 / math.sqrt(count)
    assert np.abs(unit.T @ unit / count - np.diag((unit**2).mean(axis=0))).max() < 4.0 / math.sqrt(count)


def test_a_measurement_looked_at_twice_is_the_same() -> None:
    plant = Noisy(DropOut(STILL, 0.5), 1e-3)
    state = plant.init(ZERO, ZERO)
    np.testing.assert_array_equal(plant.measure(state), plant.measure(state))


@pytest.mark.parametrize("samples", [0, 1, 2, 7])
def test_a_delay_is_exactly_so_many_samples(samples: int) -> None:
    true, q, v = drift(lambda plant: Delayed(plant, samples), 30)
    np.testing.assert_array_equal(q[samples:], true[: 30 - samples])
    np.testing.assert_array_equal(q[:samples], np.zeros((samples, 1)))  # where it stood before
    np.testing.assert_array_equal(v, np.ones((30, 1)))


def test_delays_add_up() -> None:
    _, chained, _ = drift(lambda plant: Delayed(Delayed(plant, 2), 3), 30)
    _, once, _ = drift(lambda plant: Delayed(plant, 5), 30)
    np.testing.assert_array_equal(chained, once)


def test_a_delay_of_noise_is_noise_that_is_late() -> None:
    _, noisy, _ = drift(lambda plant: Noisy(plant, 1e-3, seed=3), 20)
    _, late, _ = drift(lambda plant: Delayed(Noisy(plant, 1e-3, seed=3), 4), 20)
    np.testing.assert_array_equal(late[4:], noisy[:16])


@pytest.mark.parametrize("probability", [0.0, 0.1, 0.9])
def test_a_lost_sample_is_replaced_by_the_last_that_arrived_joint_by_joint(probability: float) -> None:
    count, joints = 4000, 2
    true, q, _ = drift(lambda plant: DropOut(plant, probability, seed=2), count, joints)
    arrived = q == true
    np.testing.assert_array_equal(q[0], true[0])
    kept = np.vstack([q[:1], q[:-1]])
    np.testing.assert_array_equal(q, np.where(arrived, true, kept))
    lost = ~arrived[1:]
    error = 4.0 * math.sqrt(probability * (1.0 - probability) / lost.shape[0])
    assert (np.abs(lost.mean(axis=0) - probability) <= error).all()
    # Joints are lost apart, and one loss says nothing of the next.
    for one, other in ((lost[:, 0], lost[:, 1]), (lost[1:, 0], lost[:-1, 0])):
        assert abs(np.mean(one & other) - probability**2) <= error


def test_velocities_are_lost_and_late_together_with_positions() -> None:
    pendulum = RigidBodyPlant(swing())  # falls, so that its velocity changes as well
    q, v = np.zeros(1), np.zeros(1)
    true, _, true_v = readings(pendulum, 50, q, v)
    for wrapped in (DropOut(pendulum, 0.5, seed=1), Delayed(pendulum, 3)):
        _, seen_q, seen_v = readings(wrapped, 50, q, v)
        of_q, of_v = (np.searchsorted(-a[:, 0], -b[:, 0]) for a, b in ((true, seen_q), (true_v, seen_v)))
        np.testing.assert_array_equal(of_q, of_v)


WRAPPERS: dict[str, Callable[[Plant, int], Plant]] = {
    "encoder": lambda plant, seed: Encoder(plant, 14),
    "noisy": lambda plant, seed: Noisy(plant, 1e-4, 1e-3, seed=seed),
    "delayed": lambda plant, seed: Delayed(plant, 2),
    "dropout": lambda plant, seed: DropOut(plant, 0.2, seed=seed),
    "saturated": lambda plant, seed: Saturated(plant, 4.0),
    "slow": lambda plant, seed: RateLimited(plant, 200.0),
}


def stacked(order: tuple[str, ...], seed: int = 0) -> Plant:
    """Return the arm behind these wrappers, the first one innermost."""
    plant: Plant = RigidBodyPlant(ARM)
    for name in order:
        plant = WRAPPERS[name](plant, seed)
    return plant


@settings(max_examples=40)
@given(st.permutations(sorted(WRAPPERS)), st.integers(1, 6))
def test_wrappers_go_on_top_of_each_other_in_any_order(order: list[str], count: int) -> None:
    # A batch behind them is its rollouts one by one, rollout i with seed + i.
    names = tuple(order[:count])
    controller = GPI(ARM, DT, FixedGains(15.0))
    starts = np.array([[0.1, 0.0, 0.0], [0.0, 0.3, -0.2]])
    together = simulate(stacked(names), controller, Hold(ZERO), 0.03, q0=starts)
    for row in range(2):
        alone = simulate(stacked(names, seed=row), controller, Hold(ZERO), 0.03, q0=starts[row])
        for what in ("q", "q_measured", "tau"):
            np.testing.assert_array_equal(together[what][row], alone[what])
    if "saturated" in names:
        assert np.abs(together["tau"]).max() <= 4.0
    if "slow" in names:
        assert np.abs(np.diff(together["tau"], axis=1)).max() <= 200.0 * DT * (1.0 + 1e-12)
    json.dumps(stacked(names).describe())


def test_two_wrappers_of_a_kind_are_both_described() -> None:
    both = Encoder(Encoder(STILL, 16), 12).describe()
    assert "16" in json.dumps(both)
    assert "12" in json.dumps(both)


@pytest.mark.parametrize("wrap", [Noisy, RateLimited, Saturated])
def test_parameters_per_rollout_make_a_batch(wrap: Any) -> None:
    values = np.array([[1e-3], [2e-3], [50.0]])
    plant = wrap(STILL, values)
    assert plant.batch == 3
    together = simulate(plant, GPI(ARM, DT), Hold(ZERO), 0.01, divergence=1e9)
    assert together.sizes["rollout"] == 3
    # Row by row, seeds apart: the noise of row i is that of seed + i.
    for row in range(3):
        options = {"seed": row} if wrap is Noisy else {}
        one = wrap(STILL, float(values[row, 0]), **options)
        alone = simulate(one, GPI(ARM, DT), Hold(ZERO), 0.01, divergence=1e9)
        np.testing.assert_array_equal(together["q"][row], alone["q"])


def test_what_is_behind_the_sensors_stays_true() -> None:
    plant = stacked(("noisy", "delayed", "dropout", "encoder"))
    state = plant.init(ZERO + 0.1, ZERO)
    truth = plant.true_state(state)
    np.testing.assert_array_equal(truth.q, ZERO + 0.1)
    assert isinstance(plant.measure(state), FullState)
    assert plant.robot is ARM
    assert plant.disturbance(np.zeros(2)) is None


BAD = [
    (Encoder, {"bits": 0}, ParameterError, "bits"),
    (Encoder, {"bits": 53}, ParameterError, "bits"),
    (Encoder, {"bits": 12.0}, ParameterError, "bits"),
    (Noisy, {"std_q": -1.0}, ArrayError, "std_q"),
    (Noisy, {"std_q": 1.0, "std_v": [1.0, 2.0]}, ArrayError, "std_v"),
    (Noisy, {"std_q": 1.0, "seed": -1}, ParameterError, "seed"),
    (Noisy, {"std_q": 1.0, "seed": 1.5}, ParameterError, "seed"),
    (Delayed, {"samples": -1}, ParameterError, "samples"),
    (Delayed, {"samples": 1.0}, ParameterError, "samples"),
    (DropOut, {"probability": 1.0}, ParameterError, "probability"),
    (DropOut, {"probability": -0.1}, ParameterError, "probability"),
    (DropOut, {"probability": math.nan}, ParameterError, "probability"),
    (DropOut, {"probability": "often"}, ParameterError, "probability"),
    (DropOut, {"probability": 0.1, "seed": None}, ParameterError, "seed"),
]


@pytest.mark.parametrize(("wrap", "options", "error", "named"), BAD)
def test_a_bad_parameter_is_named(
    wrap: Any, options: dict[str, Any], error: type[ArmgpiError], named: str
) -> None:
    with pytest.raises(error, match=named):
        wrap(STILL, **options)


# Velocities from differences.


def test_differences_are_the_filter_that_scipy_discretises() -> None:
    bandwidth, count = 80.0, 60
    _, seen_q, seen_v = readings(
        Differentiated(Encoder(STILL, 12), bandwidth), count, ZERO, np.array([0.5, -0.3, 0.2])
    )
    numerator, denominator, _ = cont2discrete(([bandwidth, 0.0], [1.0, bandwidth]), DT, method="bilinear")
    expected = lfilter(np.ravel(numerator), denominator, seen_q - seen_q[0], axis=0)
    np.testing.assert_allclose(seen_v, expected, rtol=1e-9, atol=1e-12)


def test_differences_of_a_steady_turn_settle_on_its_speed() -> None:
    _, _, seen = drift(lambda plant: Differentiated(plant, 200.0), 200)
    np.testing.assert_allclose(seen[-1], 1.0, rtol=1e-9)


def test_encoders_and_filters_may_differ_from_rollout_to_rollout() -> None:
    bits, bandwidth = np.array([[12.0], [16.0]]), np.array([[50.0], [200.0]])
    both = Differentiated(Encoder(STILL, bits), bandwidth)
    assert both.batch == 2
    v = np.array([0.5, -0.3, 0.2])
    together = readings(both, 20, np.zeros((2, 3)), np.tile(v, (2, 1)))
    for row in range(2):
        alone = Differentiated(Encoder(STILL, int(bits[row, 0])), float(bandwidth[row, 0]))
        for mine, theirs in zip(readings(alone, 20, ZERO, v), together, strict=True):
            np.testing.assert_array_equal(mine, theirs[:, row])


@pytest.mark.parametrize("bits", [0, 53, 16.5, [16, 16], math.nan])
def test_bits_that_no_encoder_has_are_refused(bits: Any) -> None:
    with pytest.raises(ArmgpiError, match="bits"):
        Encoder(STILL, bits)


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, math.nan])
def test_a_filter_needs_a_bandwidth(bandwidth: float) -> None:
    with pytest.raises(ArrayError, match="bandwidth"):
        Differentiated(STILL, bandwidth)
