"""The networks learn by eq. 23, inside their bounds, and pay off where they are said to."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from armgpi import (
    GPI,
    BSplineNetwork,
    Delayed,
    Encoder,
    FixedGains,
    Hold,
    RigidBodyPlant,
    Robot,
    Saturated,
    Waypoints,
    Weights,
    config,
    learned_weights,
    load_weights,
    metrics,
    save_weights,
    simulate,
)
from armgpi.errors import ArmgpiError, ArrayError, ParameterError, RolloutError
from armgpi.plants.loads import paper_disturbances

ARM = Robot.load("anthropomorphic3")
DT = 1e-3
NAMES = ("q1",)
errors = st.lists(st.floats(-0.1, 0.1), min_size=2, max_size=60)


def run(network: BSplineNetwork, e: Any, learn: float = 1.0) -> list[Any]:
    """Return the tunings of a one-joint network over a sequence of errors."""
    ready = network.prepare(NAMES, DT)
    state = ready.init(np.array([e[0]]))
    tunings = []
    for value in e:
        tuning, state = ready.step(np.array([value]), np.array([learn]), state)
        tunings.append(tuning)
    return tunings


def omegas(network: BSplineNetwork, e: Any, learn: float = 1.0) -> np.ndarray:
    return np.array([tuning.omega_c[0] for tuning in run(network, e, learn)])


def test_a_network_that_does_not_learn_is_fixed_gains_bit_by_bit() -> None:
    reference = Waypoints([np.zeros(3), np.array([0.4, 0.3, -0.2])], durations=0.5)
    plant = RigidBodyPlant(ARM)
    adaptive = GPI(ARM, DT, BSplineNetwork((20.0, 60.0), learning_rate=0.0))
    fixed = GPI(ARM, DT, FixedGains(20.0, 0.75))
    one, other = (simulate(plant, c, reference, 0.8) for c in (adaptive, fixed))
    for name in ("q", "v", "tau"):
        np.testing.assert_array_equal(one[name], other[name])


@given(errors)
def test_the_signed_rule_is_eq_23_to_the_letter(e: list[float]) -> None:
    rate = 30.0
    network = BSplineNetwork(learning="signed", learning_rate=rate, error_range=0.05, derivative_range=5.0)
    # The slow obvious twin: two functions of third order per input, weights from zero, w += l e a / (a a).
    weights, filtered, expected = np.zeros(4), e[0], []
    ready = network.prepare(NAMES, DT)
    for value in e:
        slope = 60.0 * (value - filtered)
        filtered += DT * slope
        a = np.array([x[0] for x in ready.activations(np.array([value]), np.array([slope]))])
        weights = weights + rate * value * a / (a @ a)
        expected.append(22.0 + a @ weights)
    np.testing.assert_allclose(omegas(network, e), expected, rtol=1e-12)


@given(errors)
def test_gains_stay_in_their_box_and_within_their_rate(e: list[float]) -> None:
    omega = np.concatenate([[20.0], omegas(BSplineNetwork((20.0, 60.0), rate=0.5), e)])
    assert omega.min() >= 20.0
    assert omega.max() <= 60.0
    # |d omega / dt| <= rate omega^2, to rounding.
    assert (np.abs(np.diff(omega)) <= DT * 0.5 * omega[:-1] ** 2 * (1.0 + 1e-12)).all()


@given(errors)
def test_the_magnitude_rule_does_not_know_the_sign_of_the_error(e: list[float]) -> None:
    network = BSplineNetwork(zeta_c=(0.7, 1.0), p_c=(10.0, 50.0))
    there, back = run(network, e), run(network, [-x for x in e])
    np.testing.assert_allclose(np.array(there), np.array(back), rtol=1e-12)


def test_a_gain_rises_while_the_error_is_large_and_is_forgotten_when_it_is_not() -> None:
    network = BSplineNetwork((20.0, 60.0), leak=5.0)
    omega = omegas(network, [0.0] * 10 + [0.01] * 100 + [0.0] * 2000)
    assert omega[9] == 20.0
    assert omega[109] > 58.0  # leak 5 1/s against learning 0.2 per sample: 40 / (1 + 0.025) above 20
    # Once the derivative's filter (60 rad/s) is quiet, the leak of 5 1/s is all there is.
    falling = omega[410:] - 20.0
    decay = np.exp(-5.0 * DT * np.arange(len(falling)))
    np.testing.assert_allclose(falling, falling[0] * decay, rtol=0.03)


def test_errors_inside_the_dead_zone_teach_nothing() -> None:
    assert (omegas(BSplineNetwork((20.0, 60.0), dead_zone=1e-3), [1e-3, -1e-3] * 50) == 20.0).all()


def test_nothing_is_learned_while_the_torque_is_cut() -> None:
    assert (omegas(BSplineNetwork((20.0, 60.0)), [0.05] * 50, learn=0.0) == 20.0).all()
    weak = GPI(ARM, DT, BSplineNetwork((20.0, 60.0)), effort=1e-3, start="zero")
    rollout = simulate(RigidBodyPlant(ARM), weak, Hold(np.zeros(3)), 0.05, signals=True)
    # Joints 2 and 3 fall with their motors at the limit: from the second sample on nothing is learned.
    assert (np.abs(rollout["q"][-1, 1:]) > 1e-3).all()
    assert (rollout["omega_c"][:, 1:] == 20.0).all()


@pytest.mark.parametrize("learning", ["magnitude", "signed"])
@pytest.mark.parametrize("fault", [math.nan, math.inf, -math.inf])
def test_nothing_is_learned_from_a_measurement_that_is_no_number(learning: str, fault: float) -> None:
    network = BSplineNetwork((20.0, 60.0), learning=learning, leak=0.0).prepare(NAMES, DT)
    state = network.step(np.full(3, 1e-3), np.ones(3), network.init(np.zeros(3))).state
    faulty = network.step(np.array([1e-3, fault, 1e-3]), np.ones(3), state)
    for before, after in zip(state.weights[0], faulty.state.weights[0], strict=True):
        assert after[1] == before[1]
        assert np.isfinite(after).all()
    assert np.isfinite(faulty.tuning.omega_c).all()


def test_tuning_and_weights_are_recorded_when_asked_for() -> None:
    controller = GPI(ARM, DT, BSplineNetwork(zeta_c=(0.7, 1.0)))
    rollout = simulate(RigidBodyPlant(ARM), controller, Hold(np.zeros(3)), 0.02, signals=True)
    weights = {f"{name}_weight_{i}" for name in ("omega_c", "zeta_c") for i in range(1, 5)}
    assert {"omega_c", "zeta_c", "p_c"} | weights <= set(rollout.data_vars)
    for first, second in ((1, 2), (3, 4)):  # of the error, and of its derivative: they add up to one
        together = rollout[f"activation_{first}"] + rollout[f"activation_{second}"]
        np.testing.assert_allclose(together, 1.0, atol=1e-14)
    told = json.loads(rollout.attrs["provenance"])["controller"]["gains"]
    assert told["type"] == "BSplineNetwork"
    assert told["zeta_c"] == [[0.7] * 3, [1.0] * 3]


def test_a_batch_of_networks_is_the_same_networks_one_by_one() -> None:
    lower = np.array([[20.0], [25.0]])
    reference = Waypoints([np.zeros(3), np.array([0.4, 0.3, -0.2])], durations=0.4)
    plant = Encoder(RigidBodyPlant(ARM), 16)
    together = simulate(plant, GPI(ARM, DT, BSplineNetwork((lower, 60.0)), start="zero"), reference, 0.5)
    for row in range(2):
        alone = GPI(ARM, DT, BSplineNetwork((lower[row], 60.0)), start="zero")
        one = simulate(plant, alone, reference, 0.5)
        np.testing.assert_array_equal(together["q"][row], one["q"])


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "fixed"), [(np.inf, 30.0), (0.12, 25.0)])
def test_the_network_beats_a_fixed_gain_in_error_and_in_torque_variation_on_every_joint(
    rate: float, fixed: float
) -> None:
    # 40 s under eqs. 29-31, 16-bit encoders, one sample of delay; fixed gains with their default zeta = 1.
    goal = np.array([0.8, 0.4, -0.4])
    reference = Waypoints([np.zeros(3), goal, np.zeros(3)], durations=3.0, holds=[1.0, 8.0, 25.0])
    plant = Delayed(Encoder(Saturated(RigidBodyPlant(ARM, paper_disturbances())), 16), 1)
    network, constant = (
        simulate(plant, GPI(ARM, DT, gains, start="zero"), reference, 40.0, backend="auto")
        for gains in (BSplineNetwork(rate=rate), FixedGains(fixed))
    )
    assert (metrics.itae(network) < metrics.itae(constant)).all()
    assert (metrics.total_variation(network) < metrics.total_variation(constant)).all()


def test_a_box_may_have_ends_that_are_equal_in_some_joints() -> None:
    low, high = np.array([20.0, 30.0, 25.0]), np.array([20.0, 60.0, 25.0])
    joints = ("q1", "q2", "q3")
    given = BSplineNetwork((low, high)).prepare(joints, DT)
    np.testing.assert_array_equal(given.omega_c, (low, high))
    with pytest.raises(ArrayError, match="expected lower <= upper"):
        BSplineNetwork((low, np.nextafter(high, 0.0))).prepare(joints, DT)


@settings(max_examples=20)
@given(st.floats(0.0, 5.0))
@example(2.0 - 5.1 * DT)  # with the leak of 5 1/s, just below what is stable and just above
@example(2.0 - 4.9 * DT)
def test_learning_rates_are_stable_or_refused(rate: float) -> None:
    if rate < 2.0 - 5.0 * DT:
        omega = omegas(BSplineNetwork((20.0, 60.0), learning_rate=rate), [0.02] * 300)
        assert 20.0 <= omega[-1] <= 60.0
    else:
        with pytest.raises(ParameterError, match=r"learning_rate|leak"):
            BSplineNetwork((20.0, 60.0), learning_rate=rate).prepare(NAMES, DT)


@pytest.mark.parametrize(
    ("arguments", "error", "named"),
    [
        ({"omega_c": (60.0, 20.0)}, ArrayError, "omega_c"),
        ({"omega_c": -1.0}, ArrayError, "omega_c"),
        ({"zeta_c": (0.7, 0.8, 0.9)}, ParameterError, "zeta_c"),
        ({"learning": "hebbian"}, ParameterError, "learning"),
        ({"learning_rate": -0.1}, ParameterError, "learning_rate"),
        ({"learning_rate": 2.0}, ParameterError, "learning_rate"),
        ({"leak": -1.0}, ParameterError, "leak"),
        ({"rate": 0.0}, ParameterError, "rate"),
        ({"bandwidth": 2000.0}, ParameterError, "bandwidth"),
        ({"error_range": 0.0}, ArrayError, "error_range"),
        ({"dead_zone": -1e-4}, ArrayError, "dead_zone"),
        ({"knots": [0, 0, 0, 1, 0.5, 1]}, ArrayError, "knots"),
        ({"order": 4}, ParameterError, "order"),
    ],
)
def test_a_bad_argument_is_named(arguments: Any, error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        GPI(ARM, DT, BSplineNetwork(**arguments))


@pytest.mark.parametrize("count", [8, 11, 12, 13])
def test_knots_of_linspace_are_symmetric_but_for_rounding(count: int) -> None:
    knots = BSplineNetwork(knots=np.linspace(-2.0, 2.0, count), order=4).basis.knots
    np.testing.assert_array_equal(knots, -knots[::-1])
    np.testing.assert_allclose(knots, np.linspace(-2.0, 2.0, count), rtol=0.0, atol=1e-15)


# Initial weights: what a search found off line (section 4 of the paper).

WEIGHTS = np.array([[3.0, 9.0, 1.0, 20.0], [0.0, 15.0, 2.0, 8.0], [5.0, 5.0, 30.0, 4.0]])


@pytest.mark.parametrize("learning", ["magnitude", "signed"])
def test_weights_of_zero_are_none_bit_by_bit(learning: str) -> None:
    e = np.sin(np.arange(80.0)) * np.linspace(0.0, 1e-3, 80)
    plain = run(BSplineNetwork(learning=learning, zeta_c=(0.6, 1.0)), e)
    zeros = run(BSplineNetwork(learning=learning, zeta_c=(0.6, 1.0), weights={"omega_c": np.zeros(4)}), e)
    np.testing.assert_array_equal(plain, zeros)


def test_weights_that_do_not_learn_are_a_map_of_error_and_derivative() -> None:
    network = BSplineNetwork((20.0, 60.0), learning_rate=0.0, weights={"omega_c": WEIGHTS[0]})
    e = np.sin(np.arange(60.0)) * 3e-4
    ready = network.prepare(NAMES, DT)
    filtered, expected = e[0], []
    for value in e:
        slope = 60.0 * (value - filtered)
        filtered += DT * slope
        a = [x[0] for x in ready.activations(np.array([value]), np.array([slope]))]
        expected.append(np.clip(20.0 + np.dot(a, WEIGHTS[0]), 20.0, 60.0))
    np.testing.assert_allclose(omegas(network, e), expected, rtol=1e-13)
    a = [x[0] for x in ready.activations(np.zeros(1), np.zeros(1))]
    assert ready.nominal().omega_c == pytest.approx(20.0 + np.dot(a, WEIGHTS[0]))


def test_the_leak_returns_to_the_initial_weights() -> None:
    network = BSplineNetwork((20.0, 60.0), leak=50.0, weights={"omega_c": WEIGHTS[1]})
    late = omegas(network, np.concatenate([np.full(50, 1e-2), np.zeros(2000)]))
    rest = network.prepare(NAMES, DT).nominal().omega_c[0]
    assert late[49] > rest + 8.0
    assert late[-1] == pytest.approx(rest, abs=1e-6)


def test_weights_at_rest_change_no_torque() -> None:
    """Bumpless: whatever gains the weights give, an arm that is held stays where it is."""
    q = np.array([0.2, 0.4, -0.3])
    plain, given = (
        simulate(RigidBodyPlant(ARM), GPI(ARM, DT, BSplineNetwork(weights=weights)), Hold(q), 0.3)
        for weights in (None, {"omega_c": WEIGHTS})
    )
    np.testing.assert_allclose(given["tau"], plain["tau"], atol=1e-9)
    np.testing.assert_allclose(given["q"], np.tile(q, (len(given["time"]), 1)), atol=1e-9)


def test_weights_of_a_batch_are_those_of_its_rollouts_by_generated_code_too() -> None:
    random = np.random.default_rng(1)
    weights = random.uniform(-5.0, 20.0, (4, 3, 4))
    reference = Waypoints([np.zeros(3), np.array([0.4, 0.3, -0.2])], durations=0.3)
    plant = Encoder(RigidBodyPlant(ARM), 24)

    def made(given: np.ndarray, backend: str = "numpy") -> Any:
        gpi = GPI(ARM, DT, BSplineNetwork((20.0, 60.0), error_range=1e-3, weights={"omega_c": given}))
        return simulate(plant, gpi, reference, 0.4, signals=True, backend=backend)

    batch, compiled = made(weights), made(weights, "compiled")
    np.testing.assert_allclose(compiled["omega_c"], batch["omega_c"], rtol=1e-6)
    for row in range(4):
        np.testing.assert_array_equal(made(weights[row])["omega_c"], batch["omega_c"][row])
    learned = learned_weights(batch)
    assert learned.omega_c.shape == weights.shape
    assert not np.array_equal(learned.omega_c, weights)


def test_weights_are_kept_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "weights.nc"
    save_weights(Weights(omega_c=WEIGHTS, zeta_c=[0.1, 0.0, 0.2, 0.3]), path, ARM)
    found = load_weights(path, ARM)
    np.testing.assert_array_equal(found.omega_c, WEIGHTS)
    assert found.zeta_c.shape == (3, 4)
    assert found.p_c is None
    with pytest.raises(ArrayError, match="q1, q2, q3"):
        load_weights(path, Robot.load("double_pendulum"))
    (tmp_path / "no.nc").write_bytes(b"no")
    for bad in ("no.nc", "missing.nc"):
        with pytest.raises(RolloutError, match=bad):
            load_weights(tmp_path / bad, ARM)
    with pytest.raises(RolloutError, match="signals=True"):
        learned_weights(simulate(RigidBodyPlant(ARM), GPI(ARM, DT), Hold(np.zeros(3)), 0.01))


def test_weights_are_a_section_of_an_experiment_file() -> None:
    by_joint = {name: row.tolist() for name, row in zip(ARM.joint_names, WEIGHTS, strict=True)}
    for values in (by_joint, WEIGHTS.tolist(), WEIGHTS[0].tolist()):
        section = {"type": "network", "weights": {"omega": values}}
        wanted = {"robot": {"name": "anthropomorphic3"}, "controllers": [section]}
        built = config.build(config.check(wanted, config.Origin("here")))
        (made,) = built.controllers.values()
        assert isinstance(made, GPI)
        assert isinstance(made.gains, BSplineNetwork)
        expected = np.tile(WEIGHTS[0], (3, 1)) if values == WEIGHTS[0].tolist() else WEIGHTS
        np.testing.assert_array_equal(made.gains.weights.omega_c, expected)
        assert yaml.safe_load(config.dump(built.config))["controllers"][0]["weights"]["omega"] == values


@pytest.mark.parametrize(
    ("weights", "named"),
    [
        ({"omega_c": [1.0, 2.0]}, "4 numbers"),
        ({"omega_c": np.zeros((2, 4))}, "3 lists"),
        ({"zeta_c": np.zeros(4)}, "does not adapt"),
        ({"omega": np.zeros(4)}, "omega_c"),
        ({"omega_c": [1.0, math.nan, 0.0, 0.0]}, "NaN|finite|nan"),
        ({"omega_c": {"q1": [0.0] * 4}}, "q2, q3"),
        ({"omega_c": {"q9": [0.0] * 4}}, "q9"),
        (3.0, "Weights"),
    ],
)
def test_bad_weights_are_named(weights: Any, named: str) -> None:
    with pytest.raises(ArmgpiError, match=named):
        GPI(ARM, DT, BSplineNetwork(weights=weights))
