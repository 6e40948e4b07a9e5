"""Contenders of GPI: each law against its closed form, and all of them by NumPy and by generated code."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from machines import sled, swing

from armgpi import (
    GPI,
    Bezier,
    BSplineNetwork,
    Controller,
    Differentiated,
    Encoder,
    FixedGains,
    FullState,
    Hold,
    Measurement,
    PIDInversion,
    Ramp,
    RigidBodyPlant,
    Robot,
    Saturated,
    Step,
    Target,
    Tuning,
    config,
    metrics,
    simulate,
)
from armgpi.control.adrc import ADRC
from armgpi.control.ctdob import ComputedTorqueDOB
from armgpi.control.observer import Estimate, correct_estimate, expected_next, observer_gains
from armgpi.control.pid_positions import PIDPositions
from armgpi.control.slotineli import SlotineLi
from armgpi.control.supertwisting import SuperTwisting
from armgpi.errors import ArmgpiError, ArrayError, ParameterError
from armgpi.gpi.family import Member, transfer_function
from armgpi.gpi.realisation import Bumpless
from armgpi.gpi.schedule import GainSchedule
from armgpi.registry import Context

Array = npt.NDArray[np.float64]

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
START, GOAL = np.array([0.2, 0.3, -0.4]), np.array([0.9, 0.7, -0.8])
MOVE = Bezier(START, GOAL, duration=1.0)
MODELLED = (ComputedTorqueDOB, SuperTwisting, SlotineLi, PIDPositions)
ALL: tuple[type[Controller], ...] = (ADRC, *MODELLED)


def still(q: Array) -> Target:
    """Return the target of standing at q."""
    return Target(q, np.zeros_like(q), np.zeros_like(q))


# The observer


@pytest.mark.parametrize("order", [3, 4])
@pytest.mark.parametrize("omega_o", [5.0, 120.0, 800.0])
def test_all_poles_of_the_observer_are_where_they_are_asked_for(order: int, omega_o: float) -> None:
    gains = np.array(observer_gains(np.array(omega_o), DT, order))[:order]
    states = np.eye(order)
    phi = np.array(
        [
            expected_next(Estimate(*np.append(x, np.zeros(4 - order))), np.array(0.0), DT)[:order]
            for x in states
        ]
    ).T
    correct = np.eye(order) - np.outer(gains, states[0])
    # In units of a sample, so that the numbers are of one size. The polynomial: its root is a multiple one.
    scale = np.diag(DT ** np.arange(order))
    whole = scale @ phi @ correct @ np.linalg.inv(scale)
    expected = np.poly(np.full(order, np.exp(-omega_o * DT)))
    np.testing.assert_allclose(np.poly(whole), expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("order", [3, 4])
def test_the_observer_is_exact_where_its_model_is(order: int) -> None:
    # e'' = v + zeta with v held, and zeta constant or a ramp: polynomials in time, sample by sample.
    rng = np.random.default_rng(0)
    zeta, slope = 3.0, 2.0 if order == 4 else 0.0
    gains = observer_gains(np.array(50.0), 0.01, order)
    true = Estimate(*(np.array(x) for x in (0.1, -0.2, zeta, slope)))
    seen = Estimate(*(np.array(x) for x in (0.0, 0.0, 0.0, 0.0)))
    for _ in range(400):
        now = correct_estimate(true.e, seen, gains)
        v = np.array(rng.normal())
        seen = expected_next(now, v, 0.01)
        e = true.e + 0.01 * true.rate + 0.01**2 * (0.5 * (v + true.zeta) + 0.01 * true.slope / 6.0)
        rate = true.rate + 0.01 * (v + true.zeta) + 0.5 * 0.01**2 * true.slope
        true = Estimate(e, rate, true.zeta + 0.01 * true.slope, true.slope)
    np.testing.assert_allclose(seen, true, rtol=0.0, atol=1e-8)


# ADRC


def adrc_transfer_function(omega_c: float, omega_o: float, order: int) -> tuple[Array, Array]:
    """Return numerator and denominator of C(s), v = -C e, of continuous ADRC, from its matrices."""
    A, B = np.eye(order, k=1), np.eye(order)[:, 1:2]
    L = np.poly(np.full(order, -omega_o))[1:, None]  # the poles of a chain of integrators
    K = np.zeros((1, order))
    K[0, :3] = omega_c**2, 2.0 * omega_c, 1.0
    inner = A - B @ K - L @ np.eye(order)[:1]
    denominator: Array = np.asarray(np.poly(inner), dtype=np.float64)
    # C = K (s - inner)^-1 L by the matrix determinant lemma.
    numerator: Array = np.poly(inner - L @ K) - denominator
    return numerator, denominator


@pytest.mark.parametrize("order", [3, 4])
def test_adrc_is_a_member_of_the_family(order: int) -> None:
    omega_c, omega_o = 13.0, 47.0
    numerator, denominator = adrc_transfer_function(omega_c, omega_o, order)
    ratio = np.array(omega_o / omega_c)
    member = Member(order - 2, 1, ratio, ratio, 1.0)
    tuning = Tuning(*(np.array(x) for x in (omega_c, 1.0, omega_o)))
    n, d = transfer_function(tuning, member)
    m = order - 2
    expected = np.array([*n[::-1]]), np.array([1.0, *d[::-1], *np.zeros(m)])
    np.testing.assert_allclose(numerator[-len(n) :], expected[0], rtol=1e-10)
    scale = omega_o ** np.arange(order + 1)
    np.testing.assert_allclose(denominator / scale, expected[1] / scale, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("order", [3, 4])
def test_sampled_adrc_goes_to_that_member_at_first_order(order: int) -> None:
    rail = sled()
    omega_c, omega_o = 10.0, 40.0
    member = Member(order - 2, 1, 4.0, 4.0, 1.0)
    law = Bumpless(member)
    errors, steps = [], np.array([2e-3, 1e-3, 5e-4])
    for dt in steps:
        controller = ADRC(rail, dt, omega_c, omega_o, order=order, effort=1e9)
        c = law.coefficients(Tuning(*(np.array([x]) for x in (omega_c, 1.0, omega_o))), dt)
        zero = np.zeros(1)
        state, twin = controller.init(Measurement(zero), still(zero)), law.init(zero, c)
        worst = 0.0
        for k in range(round(1.0 / dt)):
            e = np.array([1e-2 * np.sin(7.0 * k * dt) ** 2])
            tau, state = controller.step(Measurement(e), still(zero), state)
            v = law.output(e, twin, c)
            twin = law.update(e, v, None, twin, c)
            worst = max(worst, abs(float(tau[0] / rail.mass_matrix(zero)[0, 0] - v[0])))
        errors.append(worst)
    order_found = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order_found == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(("order", "load"), [(3, Step(2.0)), (4, Ramp(1.0))])
def test_adrc_rejects_constants_and_with_one_order_more_ramps(order: int, load: Any) -> None:
    rail = sled()
    run = simulate(RigidBodyPlant(rail, load), ADRC(rail, DT, 10.0, 40.0, order=order), Hold([0.0]), 4.0)
    # What a ramp does within a sample, slope dt^2 / 6 of acceleration, is not seen.
    assert abs(float(run["q"][-1, 0])) < 1e-8 + (order == 4) * DT**2 / 5.0 / 10.0**2 * 10.0
    if order == 4:
        other = simulate(RigidBodyPlant(rail, load), ADRC(rail, DT, 10.0, 40.0), Hold([0.0]), 4.0)
        assert abs(float(other["q"][-1, 0])) > 1e-5


# Computed torque and those like it


@pytest.mark.parametrize("law", MODELLED[:-1])
def test_with_the_model_an_undisturbed_arm_hardly_leaves_its_reference(law: type[Controller]) -> None:
    # What is left is the half sample of the hold: it halves with the sample time.
    peaks = [
        float(metrics.peak_error(simulate(RigidBodyPlant(ARM), law(ARM, dt), MOVE, 1.5)).max())
        for dt in (2e-3, 1e-3, 5e-4)
    ]
    assert peaks[2] < peaks[1] < peaks[0]
    assert peaks[1] < 5e-3
    assert peaks[0] / peaks[2] == pytest.approx(4.0, rel=0.5)


@pytest.mark.parametrize("law", MODELLED)
def test_the_bias_robot_is_what_coriolis_and_gravity_come_from(law: type[Any]) -> None:
    q = np.array([0.1, 0.4, -0.7])
    controller = law(ARM.scaled_inertia(0.8), DT, bias_robot=ARM, effort=1e6)
    state = controller.init(Measurement(q), still(q))
    np.testing.assert_allclose(
        controller.step(Measurement(q), still(q), state).tau, ARM.gravity(q), atol=1e-12
    )
    with pytest.raises(ParameterError, match="bias_robot"):
        law(ARM, DT, bias_robot=swing(2))


def test_pid_on_positions_is_pid_behind_the_sensor_that_differentiates() -> None:
    plant = Encoder(RigidBodyPlant(ARM, Step(0.05, onset=0.5)), 14)
    own = simulate(plant, PIDPositions(ARM, DT, velocity_bandwidth=150.0), MOVE, 1.5)
    other = simulate(Differentiated(plant, 150.0), PIDInversion(ARM, DT), MOVE, 1.5)
    np.testing.assert_allclose(own["q"], other["q"], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(own["tau"], other["tau"], rtol=0.0, atol=1e-9)


def test_super_twisting_holds_against_a_ramp_below_its_slope() -> None:
    rail = sled()
    mass = float(rail.mass_matrix(np.zeros(1))[0, 0])
    law = SuperTwisting(rail, DT, 20.0, 200.0, slope=50.0, layer=0.01)
    run = simulate(RigidBodyPlant(rail, Ramp(20.0 * mass)), law, Hold([0.0]), 3.0)
    assert abs(float(run["q"][-1, 0])) < 2e-3
    assert float(abs(run["q"]).max()) < 0.02


def test_adaptation_rejects_a_constant_load_under_a_wrong_inertia() -> None:
    rail = sled()
    plant = RigidBodyPlant(rail.with_payload(rail.tip, 0.5), Step(1.0))
    final = [
        abs(float(simulate(plant, SlotineLi(rail, DT, adaptation=x), Hold([0.0]), 6.0)["q"][-1, 0]))
        for x in (0.0, 0.25)
    ]
    assert final[1] < 1e-6 < final[0]


# All of them


@pytest.mark.parametrize("law", ALL)
def test_it_starts_holding_the_arm(law: type[Controller]) -> None:
    run = simulate(RigidBodyPlant(ARM), law(ARM, DT), Hold(START), 0.3)
    np.testing.assert_allclose(run["tau"][0], ARM.gravity(START), rtol=1e-9, atol=1e-12)
    assert float(metrics.peak_error(run).max()) < 1e-3


@pytest.mark.parametrize("law", ALL)
def test_a_step_far_beyond_the_torque_limit_settles(law: type[Controller]) -> None:
    arm = swing(2, axis="0 0 1")
    effort = 0.03 * arm.mass_matrix(np.zeros(2)) @ np.full(2, 400.0)
    run = simulate(RigidBodyPlant(arm), law(arm, DT, effort=effort), Hold([1.0, 1.0]), 8.0, q0=[0.0, 0.0])
    late = run.isel(time=run["time"] > 7.0)
    assert float(abs(run["tau"]).max()) <= effort.max() * (1.0 + 1e-12)
    assert float(abs(late["q"] - 1.0).max()) < 0.01


@pytest.mark.parametrize("law", ALL)
def test_it_measures_positions_and_says_what_it_knows(law: type[Controller]) -> None:
    assert law.measurement_type is Measurement
    assert law.knows == ("inertia" if law is ADRC else "model")


@pytest.mark.parametrize("law", ALL)
def test_a_batch_is_its_rollouts(law: type[Any]) -> None:
    rows = np.array([START, GOAL, 0.5 * GOAL])
    target = Target(rows - 0.01, 0.1 * rows, 0.2 * rows)
    controller = law(ARM, DT)
    state = controller.init(Measurement(rows), target)
    alone = [controller.init(Measurement(q), Target(*(x[i] for x in target))) for i, q in enumerate(rows)]
    for _ in range(3):
        tau, state = controller.step(Measurement(rows), target, state)
        for i, q in enumerate(rows):
            one, alone[i] = controller.step(Measurement(q), Target(*(x[i] for x in target)), alone[i])
            np.testing.assert_allclose(tau[i], one, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("law", ALL)
def test_generated_code_does_what_numpy_does(law: type[Controller]) -> None:
    pytest.importorskip("casadi")
    plant = Saturated(RigidBodyPlant(ARM, Step(0.05, onset=0.1)))
    arguments = (plant, law(ARM, DT), MOVE, 0.4)
    by_numpy = simulate(*arguments)
    by_c = simulate(*arguments, backend="compiled")
    np.testing.assert_allclose(by_c["q"], by_numpy["q"], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(by_c["tau"], by_numpy["tau"], rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("name", ["adrc", "ctdob", "supertwisting", "slotineli", "pid_positions", "schedule"])
def test_an_experiment_file_names_it_and_scales_d_alone(name: str) -> None:
    made = config.controller({"type": name, "inertia_scale": 0.8}, Context(ARM, DT, nominal=ARM))
    np.testing.assert_allclose(made.robot.mass_matrix(START), 0.8 * ARM.mass_matrix(START))
    if name not in ("schedule", "adrc"):
        assert made.bias_robot is ARM  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("law", "arguments", "error"),
    [
        (ADRC, {"omega_c": 0.0}, ArrayError),
        (ADRC, {"omega_o": [1.0, 2.0]}, ArrayError),
        (ADRC, {"order": 5}, ParameterError),
        (ADRC, {"delay": -1.0}, ParameterError),
        (SuperTwisting, {"layer": 0.0}, ArrayError),
        (SlotineLi, {"adaptation": -1.0}, ArrayError),
        (PIDPositions, {"velocity_bandwidth": 0.0}, ArrayError),
    ],
)
def test_bad_parameters_are_refused(
    law: type[Any], arguments: dict[str, Any], error: type[Exception]
) -> None:
    with pytest.raises(error) as refused:
        law(ARM, DT, **arguments)
    assert isinstance(refused.value, ArmgpiError)
    assert next(iter(arguments)) in str(refused.value)


# The schedule


def schedule(**changes: Any) -> GainSchedule:
    """Return a schedule for the arm."""
    ready = GainSchedule(**changes).prepare(ARM.joint_names, DT)
    assert isinstance(ready, GainSchedule)
    return ready


def test_the_schedule_is_its_formula() -> None:
    gains = schedule(omega_c=(20.0, 50.0), attack=0.3, leak=4.0, error_range=1e-3, dead_zone=5e-4)
    rng = np.random.default_rng(1)
    state = gains.init(np.zeros(3))
    w = np.zeros(3)
    for _ in range(200):
        e, learn = 1e-3 * rng.normal(size=3), np.array([1.0, 1.0, 0.0])
        tuning, state = gains.step(e, learn, state)
        for j in range(3):
            aim = 30.0 * min(max(abs(e[j]) - 5e-4, 0.0) / 1e-3, 1.0)
            w[j] += learn[j] * (0.3 * max(aim - w[j], 0.0) - 4.0 * DT * w[j])
        np.testing.assert_allclose(tuning.omega_c, 20.0 + w, rtol=1e-13)
        np.testing.assert_array_equal(tuning.p_c, tuning.omega_c)
        np.testing.assert_array_equal(gains.signals(state)["omega_c"], tuning.omega_c)
    assert w[2] == 0.0
    assert w[0] > 1.0


def test_a_network_whose_activations_do_not_change_is_the_schedule() -> None:
    # One function of order 1 per input: the activations are constant, and cancel in the normalised rule.
    scales = {"omega_c": (22.0, 60.0), "leak": 5.0, "error_range": 1e-4, "dead_zone": 2e-4}
    network = BSplineNetwork(knots=[-1.0, 1.0], order=1, learning_rate=0.2, **scales)
    runs = [
        simulate(Encoder(RigidBodyPlant(ARM, Step(0.2, onset=0.5)), 16), GPI(ARM, DT, gains), MOVE, 1.2)
        for gains in (network, GainSchedule(attack=0.2, **scales))
    ]
    np.testing.assert_allclose(runs[0]["q"], runs[1]["q"], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(runs[0]["tau"], runs[1]["tau"], rtol=0.0, atol=1e-8)


def test_without_attack_it_is_fixed_gains() -> None:
    plant = RigidBodyPlant(ARM)
    runs = [
        simulate(plant, GPI(ARM, DT, gains), MOVE, 0.5)
        for gains in (GainSchedule(attack=0.0), FixedGains(22.0, 0.75))
    ]
    np.testing.assert_allclose(runs[0]["q"], runs[1]["q"], rtol=0.0, atol=1e-12)


def test_a_measurement_that_is_no_number_leaves_no_trace_in_it() -> None:
    gains = schedule()
    state = gains.step(np.full(3, 1e-3), np.ones(3), gains.init(np.zeros(3))).state
    after = gains.step(np.full(3, np.nan), np.ones(3), state)
    np.testing.assert_array_equal(after.state.raised, state.raised)
    assert np.isfinite(after.tuning.omega_c).all()


def test_bad_schedules_are_refused() -> None:
    for changes, named in (
        ({"omega_c": (60.0, 22.0)}, "omega_c"),
        ({"attack": 1.5}, "attack"),
        ({"leak": 2000.0}, "leak"),
        ({"error_range": 0.0}, "error_range"),
    ):
        with pytest.raises(ArmgpiError, match=named):
            schedule(**changes)


def test_the_schedule_by_generated_code() -> None:
    pytest.importorskip("casadi")
    arguments = (RigidBodyPlant(ARM, Step(0.2, onset=0.1)), GPI(ARM, DT, GainSchedule()), MOVE, 0.4)
    runs = [simulate(*arguments, signals=True, backend=name) for name in ("numpy", "compiled")]
    np.testing.assert_allclose(runs[0]["q"], runs[1]["q"], rtol=0.0, atol=1e-11)
    assert float(runs[0]["omega_c"].max()) > 25.0


def test_unused_velocities_are_not_asked_for() -> None:
    q = START
    for law in ALL:
        controller = law(ARM, DT)
        state = controller.init(Measurement(q), still(q))
        a = controller.step(Measurement(q), still(q), state).tau
        b = controller.step(FullState(q, 5.0 + q), still(q), state).tau
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("kind", [ADRC, ComputedTorqueDOB])
def test_an_observer_whose_error_is_large_is_the_faster_one_and_without_rise_the_same(kind: Any) -> None:
    slow = kind(ARM, DT, omega_c=10.0, omega_o=40.0, zeta_c=0.7)
    fast = kind(ARM, DT, omega_c=30.0, omega_o=120.0, zeta_c=0.7)
    large: dict[str, Any] = {"attack": 1.0, "leak": 0.0, "error_range": 1e-6, "dead_zone": 0.0}
    seen, target = Measurement(START + 0.01), still(START)
    for rise, twin in ((1.0, slow), (3.0, fast)):
        law = kind(ARM, DT, omega_c=10.0, omega_o=40.0, zeta_c=0.7, rise=rise, **large)
        state = law.step(seen, target, law.init(seen, target)).state  # after which it has risen
        tau = law.step(seen, target, state).tau
        same = twin.step(seen, target, state._replace(own=None)).tau
        np.testing.assert_allclose(tau, same, rtol=1e-12)


def test_the_damping_ratio_weighs_the_estimated_rate() -> None:
    now, zero = Estimate(*(x * np.ones(3) for x in (0.1, 0.2, 0.0, 0.0))), still(START)
    for zeta in (0.5, 1.0):
        law = ADRC(ARM, DT, omega_c=10.0, zeta_c=zeta)
        np.testing.assert_allclose(law.law(now, zero, None), -(100.0 * 0.1 + 2.0 * zeta * 10.0 * 0.2))


def test_a_leak_that_is_too_fast_for_the_sample_time_is_refused() -> None:
    with pytest.raises(ParameterError, match="leak"):
        ADRC(ARM, DT, rise=2.0, leak=1000.0)
