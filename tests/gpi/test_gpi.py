"""The GPI controller: what it sees, what it asks for, how it starts, and what it refuses."""

from __future__ import annotations

import json
import math
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import sled, swing
from strategies import State, robots_and_states

from armgpi import (
    GPI,
    ArmgpiWarning,
    Bezier,
    Delayed,
    FixedGains,
    Friction,
    FullState,
    Hold,
    Measurement,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Target,
    config,
    default_omega,
    metrics,
    simulate,
)
from armgpi.errors import ArmgpiError, ArrayError, EffortError, ParameterError, PayloadError
from armgpi.loop.provenance import Provenance
from armgpi.plants.plant import Wrapper
from armgpi.registry import Context

Array = npt.NDArray[np.float64]

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
BRAKES = np.zeros(3)  # the paper's arm held level


def still(q: Array) -> Target:
    """Return the target of standing at q."""
    return Target(q, np.zeros_like(q), np.zeros_like(q))


def steps(controller: GPI, q: Array, target: Target) -> list[Array]:
    """Return the torques for positions of shape (samples, ..., n)."""
    state = controller.init(Measurement(q[0]), target)
    torques = []
    for row in q:
        tau, state = controller.step(Measurement(row), target, state)
        torques.append(tau)
    return torques


def test_the_torque_is_the_inertia_matrix_times_the_law_of_each_joint() -> None:
    tuning = {"omega_c": np.array([10.0, 20.0, 30.0]), "zeta_c": np.array([0.8, 1.0, 1.2])}
    way = BRAKES + 1e-3 * np.random.default_rng(0).normal(size=(50, 3))
    torques = steps(GPI(ARM, DT, FixedGains(**tuning), effort=1e9, start="zero"), way, still(BRAKES))
    rail = sled()  # where the force is v
    for joint in range(3):
        gains = FixedGains(*(value[joint] for value in tuning.values()))
        v = steps(GPI(rail, DT, gains, start="zero"), way[:, [joint]], still(np.zeros(1)))
        expected = [ARM.mass_matrix(q)[:, joint] * row for q, row in zip(way, v, strict=True)]
        torques = [tau - part for tau, part in zip(torques, expected, strict=True)]
    np.testing.assert_allclose(torques, 0.0, atol=1e-12)  # eq. 19; torques are below 1 N m


class Blind(Wrapper):
    """A plant whose velocity sensors are broken."""

    def measure(self, state: Any) -> FullState:
        q, v = self.plant.measure(state)
        return FullState(q, np.full_like(v, np.nan))


def test_it_is_given_positions_and_nothing_else() -> None:
    assert GPI.measurement_type is Measurement
    assert Measurement._fields == ("q",)
    plant, controller, reference = RigidBodyPlant(ARM), GPI(ARM, DT), Hold(BRAKES)
    seeing, blind = (simulate(p, controller, reference, 0.2) for p in (plant, Blind(plant)))
    np.testing.assert_array_equal(seeing["q"], blind["q"])
    assert np.isfinite(blind["q"]).all()


@settings(max_examples=50)
@given(robots_and_states(), st.floats(1.0, 100.0), st.integers(0, 1000))
def test_the_torque_never_exceeds_the_limits_on_any_robot(
    drawn: tuple[Robot, State], omega: float, seed: int
) -> None:
    robot, state = drawn
    way = state.q + np.random.default_rng(seed).normal(0.0, 0.3, (20, robot.n))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)  # fast loops are asked for here
        controller = GPI(robot, DT, FixedGains(omega))
    torques = np.array(steps(controller, way, still(state.q)))
    assert (np.abs(torques) <= robot.limits.effort).all()
    assert np.isfinite(torques).all()


@pytest.mark.parametrize("realisation", ["bumpless", "paper"])
@pytest.mark.parametrize("start", ["hold", "zero"])
def test_a_batch_is_the_same_controllers_one_by_one(realisation: str, start: str) -> None:
    omega = np.array([[10.0, 20.0, 5.0], [30.0, 15.0, 20.0], [12.0, 40.0, 8.0]])
    effort = np.array([[1.0], [2.0], [30.0]])
    way = 0.1 * np.random.default_rng(3).normal(size=(60, 3, 3))
    options = {"realisation": realisation, "start": start}
    together = steps(GPI(ARM, DT, FixedGains(omega), effort=effort, **options), way, still(np.zeros((3, 3))))
    for row in range(3):
        alone = GPI(ARM, DT, FixedGains(omega[row]), effort=effort[row], **options)
        expected = steps(alone, way[:, row], still(BRAKES))
        np.testing.assert_array_equal(np.array(together)[:, row], expected)


def test_a_batch_of_closed_loops_is_the_same_runs_one_by_one() -> None:
    omega = np.array([[10.0, 20.0, 15.0], [30.0, 15.0, 20.0]])
    together = simulate(
        RigidBodyPlant(ARM), GPI(ARM, DT, FixedGains(omega)), Hold(BRAKES), 0.3, q0=BRAKES + 0.1
    )
    for row in range(2):
        alone = simulate(
            RigidBodyPlant(ARM), GPI(ARM, DT, FixedGains(omega[row])), Hold(BRAKES), 0.3, q0=BRAKES + 0.1
        )
        np.testing.assert_array_equal(together["q"][row], alone["q"])
        np.testing.assert_array_equal(together["tau"][row], alone["tau"])


def test_a_step_leaves_state_and_measurement_as_they_were() -> None:
    controller = GPI(ARM, DT, FixedGains(20.0), effort=0.5)  # saturated: anti-windup at work
    q = np.array([0.1, 0.2, 0.3])
    state = controller.init(Measurement(q), still(BRAKES))
    first = controller.step(Measurement(q), still(BRAKES), state)
    again = controller.step(Measurement(q), still(BRAKES), state)
    np.testing.assert_array_equal(first.tau, again.tau)
    np.testing.assert_array_equal(first.state.law, again.state.law)
    np.testing.assert_array_equal(q, [0.1, 0.2, 0.3])


def test_started_from_the_holding_torque_an_exact_model_does_not_drop() -> None:
    dropped = start_drop(ARM, "hold")
    assert dropped.max() < 1e-12  # [rad]


@pytest.mark.parametrize("scale", [0.8, 1.2])
def test_started_from_the_holding_torque_a_wrong_model_drops_a_fourth_of_that_from_zero(scale: float) -> None:
    model = ARM.scaled_inertia(scale)
    assert (4.0 * start_drop(model, "hold") < start_drop(model, "zero")).all()


def start_drop(model: Robot, start: str, **options: Any) -> Array:
    """Return how far shoulder and elbow move when the brakes of the level arm open [rad]."""
    controller = GPI(model, DT, FixedGains(20.0), start=start, **options)
    return np.abs(simulate(RigidBodyPlant(ARM), controller, Hold(BRAKES), 1.0)["q"].values).max(axis=0)[1:]


FEEDFORWARD = pytest.mark.parametrize("feedforward", ["none", "gravity", "model", "computed"])
WAY = Bezier([0.0, 0.1, 0.0], [0.8, 0.6, -0.5], duration=1.0, t_start=0.1)


@FEEDFORWARD
@pytest.mark.parametrize("start", [BRAKES, BRAKES + 0.2])
def test_every_feedforward_starts_with_the_torque_that_holds_the_arm(feedforward: str, start: Array) -> None:
    controller = GPI(ARM, DT, feedforward=feedforward)
    tau, _ = controller.step(
        Measurement(start), still(start), controller.init(Measurement(start), still(start))
    )
    np.testing.assert_allclose(tau, ARM.gravity(start), rtol=0, atol=1e-14)
    assert start_drop(ARM, "hold", feedforward=feedforward).max() < 1e-12  # [rad]


def test_a_moving_reference_starts_with_the_torque_that_follows_it() -> None:
    moving = Target(BRAKES, np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0]))
    controller = GPI(ARM, DT, feedforward="model")
    tau, _ = controller.step(Measurement(BRAKES), moving, controller.init(Measurement(BRAKES), moving))
    np.testing.assert_allclose(tau, ARM.inverse_dynamics(*moving), rtol=0, atol=1e-14)


def test_computed_torque_is_that_of_the_model_where_the_arm_is() -> None:
    moving = Target(BRAKES, np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0]))
    q = BRAKES + 1e-3
    law = GPI(ARM, DT, FixedGains(20.0), feedforward="computed", start="zero")
    tau, _ = law.step(Measurement(q), moving, law.init(Measurement(q), moving))
    bare = GPI(ARM, DT, FixedGains(20.0), start="zero")
    asked, _ = bare.step(Measurement(q), moving, bare.init(Measurement(q), moving))
    ahead = ARM.inverse_dynamics(q, moving.v, moving.a)
    np.testing.assert_allclose(tau, asked + ahead, rtol=0, atol=1e-13)


def test_with_the_exact_model_only_the_hold_of_the_torque_is_left_of_the_error() -> None:
    def peak(feedforward: str, dt: float) -> Array:
        controller = GPI(ARM, dt, FixedGains(20.0), feedforward=feedforward)
        return metrics.peak_error(simulate(RigidBodyPlant(ARM), controller, WAY, 1.5)).values

    none, gravity, coarse, fine = (
        peak(*case) for case in (("none", DT), ("gravity", DT), ("model", DT), ("model", 0.5 * DT))
    )
    assert (gravity < none).all()
    assert (coarse < 0.01 * none).all()
    # A torque that is held is half a sample late.
    np.testing.assert_allclose(coarse, 2.0 * fine, rtol=0.05)


def test_without_feedforward_the_bits_are_those_of_the_law_that_has_none() -> None:
    way = BRAKES + 1e-3 * np.random.default_rng(0).normal(size=(50, 3))
    moving = Target(BRAKES, np.full(3, 0.3), np.full(3, 2.0))
    np.testing.assert_array_equal(
        steps(GPI(ARM, DT, feedforward="none"), way, still(BRAKES)), steps(GPI(ARM, DT), way, moving)
    )


@FEEDFORWARD
def test_cut_torque_winds_no_integrator_up(feedforward: str) -> None:
    # The reference asks for more torque than there is, then stands still.
    controller = GPI(ARM, DT, FixedGains(20.0), feedforward=feedforward, effort=[0.3, 3.4, 1.0])
    rollout = simulate(RigidBodyPlant(ARM), controller, Bezier(BRAKES, BRAKES + 0.5, 0.2), 4.0)
    assert (np.abs(rollout["tau"].values) == controller.effort).any()
    assert (metrics.final_error(rollout) < 1e-6).all()
    # While cut, the integrators follow what is applied less what the feedforward gives.
    q = BRAKES
    weak = GPI(ARM, DT, FixedGains(20.0), start="zero", feedforward=feedforward, effort=0.5)
    state = weak.init(Measurement(q), still(q))
    _, after = weak.step(Measurement(q), still(q), state)
    given = ARM.gravity(q) if feedforward != "none" else np.zeros(3)
    missing = np.linalg.solve(ARM.mass_matrix(q), np.clip(given, -0.5, 0.5) - given)
    np.testing.assert_allclose(after.law.lam, -3.0 * 20.0 * DT * missing, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("feedforward", ["none", "model"])
def test_friction_that_is_known_is_asked_for_ahead(feedforward: str) -> None:
    rough = ARM.with_friction(viscous=[0.1, 0.2, 0.3], coulomb=[0.2, 0.3, 0.1])

    def asked(on: bool, v: Array) -> Array:
        target = Target(BRAKES, v, np.zeros(3))
        law = GPI(rough, DT, feedforward=feedforward, friction_feedforward=on)
        return law.step(Measurement(BRAKES), target, law.init(Measurement(BRAKES), target)).tau

    fast = np.array([2.0, -3.0, 1.0])
    expected = rough.friction.viscous * fast + rough.friction.coulomb * np.sign(fast)
    np.testing.assert_allclose(asked(True, fast) - asked(False, fast), expected, rtol=1e-4)
    np.testing.assert_array_equal(asked(True, BRAKES), asked(False, BRAKES))
    peaks = []
    for on in (False, True):
        law = GPI(rough, DT, FixedGains(20.0), feedforward=feedforward, friction_feedforward=on)
        rollout = simulate(RigidBodyPlant(rough, friction="urdf"), law, WAY, 1.2)
        peaks.append(metrics.rms(rollout).values)
    assert (peaks[1] < peaks[0]).all()


def test_at_rest_small_errors_are_not_integrated_and_all_but_the_first_integrator_empty() -> None:
    rail, q = sled(), np.array([1e-3])
    zone, leak = 4e-4, 50.0
    resting = GPI(rail, DT, FixedGains(20.0), integrators=3, rest_dead_zone=zone, rest_leak=leak)
    plain = GPI(rail, DT, FixedGains(20.0), integrators=3)
    target = still(np.zeros(1))
    state = plain.init(Measurement(q), target)
    law = state.law._replace(lam=np.array([1.0]), chi=np.array([2.0]), psi=np.array([3.0]))
    state = state._replace(law=law)

    def after(controller: GPI, q: Array, target: Target = target) -> Any:
        return controller.step(Measurement(q), target, state).state.law

    kept = math.exp(-leak * DT)
    inside = after(resting, 0.3 * q)
    np.testing.assert_allclose(
        [inside.psi, inside.chi], [[3.0 * kept], [(2.0 + 3.0 * DT) * kept]], rtol=1e-14
    )
    np.testing.assert_allclose(inside.lam, 1.0 + 2.0 * kept * DT, rtol=1e-14)
    beyond, whole, none = after(resting, q), after(plain, q - zone), after(plain, 0.0 * q)
    np.testing.assert_allclose(beyond.psi - 3.0 * kept, whole.psi - none.psi, rtol=1e-9)
    np.testing.assert_array_equal(beyond.eta, after(plain, q).eta)  # the filter sees all of it
    for moving in (target._replace(v=np.array([1e-9])), target._replace(a=np.array([-1e-9]))):
        np.testing.assert_array_equal(after(resting, q, moving), after(plain, q, moving))


def test_a_leak_at_rest_ends_hunting_by_coulomb_friction() -> None:
    hold = np.array([0.0, 0.3, 0.3])
    weight = np.abs(ARM.gravity(hold)).max()
    plant = RigidBodyPlant(ARM.with_armature(0.05), friction=Friction(0.0, 0.1 * weight))
    move = Bezier(hold - 0.3, hold, 0.8, t_start=0.2)

    def run(leak: float) -> tuple[float, float]:
        controller = GPI(ARM.with_armature(0.04), DT, FixedGains(20.0), rolloff=1, rest_leak=leak)
        rollout = simulate(plant, controller, move, 5.0)
        return float(metrics.hunting_amplitude(rollout).max()), float(metrics.final_error(rollout).max())

    (hunts, far), (rests, near) = run(0.0), run(50.0)
    assert hunts > 1e-3  # [rad]
    assert rests < 0.1 * hunts
    assert near < 0.5 * far


def test_the_heaviest_load_is_what_the_feedforward_carries() -> None:
    controller = GPI(ARM, DT, payload=(0.0, 0.05), feedforward="gravity", start="zero")
    state = controller.init(Measurement(BRAKES), still(BRAKES))
    tau, _ = controller.step(Measurement(BRAKES), still(BRAKES), state)
    np.testing.assert_array_equal(tau, ARM.with_payload(ARM.tip, 0.05).gravity(BRAKES))


def test_holding_torque_beyond_the_limit_is_held_at_the_limit() -> None:
    controller = GPI(ARM, DT, effort=[1.0, 1.0, 1.0])  # 2.8 N m would hold the shoulder
    state = controller.init(Measurement(BRAKES), still(BRAKES))
    tau, _ = controller.step(Measurement(BRAKES), still(BRAKES), state)
    np.testing.assert_allclose(tau, np.minimum(ARM.gravity(BRAKES), 1.0), atol=1e-12)


@pytest.mark.parametrize(("dt", "delay"), [(1e-3, 0.0), (1e-3, 2e-3), (5e-3, 0.0), (2e-2, 4e-2)])
def test_without_gains_it_takes_the_default_bandwidth(dt: float, delay: float) -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        tuning = GPI(ARM, dt, delay=delay).gains.nominal()
    omega = default_omega(dt, delay)
    slow = [f"the default bandwidth is {omega:.3g} rad/s"] if omega < 15.0 else []
    assert [str(each.message).partition(" at ")[0] for each in told] == slow  # and of nothing else
    np.testing.assert_array_equal(tuning.omega_c, default_omega(dt, delay))


@pytest.mark.parametrize("samples", [0, 1, 5, 10])
def test_loops_beyond_their_delay_margin_are_unstable_and_warned_of(samples: int) -> None:
    delay = samples * DT
    limit = 0.356 / (0.5 * DT + delay)  # [rad/s]; a hold delays by half a sample
    rail = sled()
    plant = Delayed(RigidBodyPlant(rail), samples)

    def late_error(controller: GPI) -> float:
        rollout = simulate(plant, controller, Hold([0.0]), 300.0 / limit, q0=[1e-3], divergence=1e9)
        return float(np.abs(rollout["q"].values[-20:]).max())

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)  # with a sample for computation it would be too fast
        assert late_error(GPI(rail, DT, FixedGains(0.95 * limit), delay=delay)) < 1e-3
    with pytest.warns(ArmgpiWarning, match="too fast"):
        too_fast = GPI(rail, DT, FixedGains(1.05 * limit), delay=delay)
    assert late_error(too_fast) > 1e-2
    GPI(
        rail, DT, FixedGains(0.355 / (1.5 * DT + delay)), delay=delay
    )  # not warned of: tests fail on warnings


def test_a_rollout_can_tell_what_controlled_it() -> None:
    told = json.loads(json.dumps(GPI(ARM, DT, FixedGains([10.0, 20.0, 30.0]), delay=1e-3).describe()))
    assert told["controller"] == "GPI"
    assert told["gains"]["omega_c"] == [10.0, 20.0, 30.0]
    assert (told["dt"], told["delay"], told["realisation"], told["start"]) == (DT, 1e-3, "bumpless", "hold")


@pytest.mark.parametrize("realisation", ["bumpless", "paper"])
def test_the_states_of_the_law_can_be_recorded(realisation: str) -> None:
    controller = GPI(ARM, DT, realisation=realisation)
    state = controller.init(Measurement(BRAKES), still(BRAKES))
    assert controller.signals(state)
    assert all(signal.shape == (3,) for signal in controller.signals(state).values())


def test_the_bumpless_lambda_settles_on_the_disturbance_acceleration() -> None:
    pendulum = swing()
    controller = GPI(pendulum, DT, FixedGains(20.0), start="zero")
    rollout = simulate(RigidBodyPlant(pendulum), controller, Hold([0.3]), 3.0, signals=True)
    weight = -pendulum.gravity([0.3]) / pendulum.mass_matrix([0.3])[0]
    np.testing.assert_allclose(rollout["lam"][-1], weight, rtol=1e-9)  # e^(-20 * 3) has died out


@pytest.mark.parametrize(
    ("options", "error", "named"),
    [
        ({"dt": 0.0}, ParameterError, "dt"),
        ({"dt": -1e-3}, ParameterError, "dt"),
        ({"dt": math.nan}, ParameterError, "dt"),
        ({"dt": "fast"}, ParameterError, "dt"),
        ({"gains": 20.0}, ParameterError, "gains"),
        ({"gains": FixedGains(0.0)}, ArrayError, "omega_c"),
        ({"gains": FixedGains([1.0, 2.0])}, ArrayError, "omega_c"),
        ({"gains": FixedGains(np.ones((2, 3))), "effort": np.ones((3, 3))}, ParameterError, "batch"),
        ({"realisation": "minimal"}, ParameterError, "realisation"),
        ({"realisation": "paper", "rolloff": 1}, ParameterError, "realisation"),
        ({"realisation": "paper", "second_ratio": 2.0}, ParameterError, "realisation"),
        ({"integrators": 4}, ParameterError, "integrators"),
        ({"rolloff": 3}, ParameterError, "rolloff"),
        ({"rolloff_ratio": [4.0, 0.0, 4.0]}, ArrayError, "rolloff_ratio.*q2"),
        ({"start": "cold"}, ParameterError, "start"),
        ({"rest_leak": [1.0, -1.0, 1.0]}, ArrayError, "rest_leak.*q2"),
        ({"rest_dead_zone": -1e-3}, ArrayError, "rest_dead_zone"),
        ({"realisation": "paper", "rest_leak": 50.0}, ParameterError, "realisation"),
        ({"feedforward": "friction"}, ParameterError, "feedforward"),
        ({"delay": -1.0}, ParameterError, "delay"),
        ({"delay": math.inf}, ParameterError, "delay"),
        ({"delay": None}, ParameterError, "delay"),
        ({"effort": [1.0, 0.0, 1.0]}, ArrayError, "effort.*q2"),
        ({"effort": np.ones(3, np.float32)}, ArrayError, "effort"),
        ({"robot": ARM.with_limits(effort={"q3": 0.0})}, EffortError, "q3"),
    ],
)
def test_a_bad_parameter_is_named(options: dict[str, Any], error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        GPI(**{"robot": ARM, "dt": DT, **options})


def test_a_range_of_loads_beyond_what_a_roll_off_tolerates_is_refused_or_warned_of() -> None:
    loads = (0.0, 3.0)  # without them the nominal inertia is more than four times the true one
    assert GPI(ARM, DT, payload=loads).payload.delta[1] > 4.0
    with pytest.raises(PayloadError, match="no bandwidth is stable"):
        GPI(ARM, DT, payload=loads, rolloff=1)
    with pytest.warns(ArmgpiWarning, match="loop is unstable"):
        GPI(ARM, DT, FixedGains(20.0), payload=loads, rolloff=1)


def test_a_batch_of_robots_has_a_range_of_loads_each() -> None:
    arms = [ARM, ARM.scaled_inertia(1.5)]
    both = GPI(RobotBatch(arms), DT, delay=DT, payload=(0.0, 0.3), rolloff=1)
    for row, arm in enumerate(arms):
        alone = GPI(arm, DT, delay=DT, payload=(0.0, 0.3), rolloff=1)
        np.testing.assert_array_equal(both.gains.nominal().omega_c[row], alone.gains.nominal().omega_c)
        q = np.array([0.3, -0.2, 0.4])
        np.testing.assert_allclose(
            both.robot.mass_matrix(np.stack([q, q]))[row], alone.robot.mass_matrix(q), rtol=1e-12
        )
    assert both.payload.delta[1] == pytest.approx(GPI(ARM, DT, payload=(0.0, 0.3)).payload.delta[1])


def test_a_scaled_inertia_leaves_the_feedforward_as_the_robot_is_known() -> None:
    q = np.array([0.3, -0.2, 0.4])
    context = Context(ARM, DT, nominal=ARM, bits=None)
    known = config.controller({"type": "gpi", "feedforward": "model", "inertia_scale": 0.8}, context)
    state = known.init(Measurement(q), still(q))
    assert not np.any(state.law.lam)  # nothing is left to hold: the feedforward is exact
    np.testing.assert_allclose(known.step(Measurement(q), still(q), state).tau, ARM.gravity(q), rtol=1e-12)


@pytest.mark.parametrize(
    ("feedforward", "knows"),
    [("none", "inertia"), ("gravity", "gravity"), ("model", "model"), ("computed", "model")],
)
def test_what_it_knows_follows_its_feedforward(feedforward: str, knows: str) -> None:
    rollout = simulate(RigidBodyPlant(ARM), GPI(ARM, DT, feedforward=feedforward), Hold(np.zeros(3)), 0.01)
    assert Provenance.from_rollout(rollout).knows == knows
    assert GPI.knows == "inertia"
