"""Payload ranges: eigenvalues against SciPy, and arms that carry both ends of their range."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import sled
from strategies import decimals, robots

from armgpi import (
    GPI,
    Encoder,
    FixedGains,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Saturated,
    Waypoints,
    default_omega,
    largest_payload,
    metrics,
    payload_range,
    simulate,
)
from armgpi.errors import ArmgpiError, ArmgpiWarning, NameNotFound, ParameterError, PayloadError
from armgpi.gpi.family import Member
from armgpi.gpi.gains import Tuning
from armgpi.gpi.margins import delay_margins, gain_interval, open_loop
from armgpi.gpi.payload import LEAST_DELTA

LOCKED = {"z1": ["jointGripper"], "so101": ["gripper"]}
FURTHER = (0.0, 0.0, 0.1)  # [m]
ARM = Robot.load("anthropomorphic3")


def load(name: str) -> Robot:
    return Robot.load(name, lock=LOCKED.get(name, ()))


def anywhere(robot: Robot, count: int, seed: int) -> Any:
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    return np.random.default_rng(seed).uniform(lower, upper, (count, robot.n))


@pytest.mark.parametrize("name", ["ur5", "z1", "so101", "anthropomorphic3"])
@pytest.mark.parametrize("com", [(0.0, 0.0, 0.0), FURTHER])
def test_delta_bounds_the_eigenvalues_for_every_load_in_the_range(name: str, com: Any) -> None:
    robot = load(name)
    found = payload_range(robot, 0.1, 0.4, com=com, slowest=0.1)
    for mass in (0.1, 0.25, 0.4):
        true = robot.with_payload(robot.tip, mass, com)
        deltas = np.array(
            [
                scipy.linalg.eigvalsh(found.nominal.mass_matrix(q), true.mass_matrix(q))
                for q in anywhere(robot, 300, seed=7)
            ]
        )
        assert deltas.min() > found.delta[0] - 1e-9
        # Found by sampling, too: other configurations than these.
        assert deltas.max() < found.delta[1] * 1.01
    assert found.nominal.total_mass == pytest.approx(robot.total_mass + 0.4)


def test_a_mass_on_a_rail_has_the_delta_of_its_masses() -> None:
    found = payload_range(sled(mass=2.0), 1.0, 3.0, dt=1e-3)
    assert found.delta == pytest.approx((1.0, 5.0 / 3.0))
    assert found.omega_c == default_omega(1e-3)
    largest = largest_payload(sled(mass=2.0), dt=1e-3)
    assert largest.mobility == pytest.approx(0.5)
    assert largest.unknown == pytest.approx(2.0 * (1.0 / 0.36 - 1.0))
    assert largest.effort == np.inf


def test_the_largest_payload_is_the_edge_of_the_range_with_default_gains() -> None:
    robot = load("ur10")
    most = largest_payload(robot, com=FURTHER)
    assert payload_range(robot, 0.0, most.nominal, com=FURTHER).omega_c == pytest.approx(default_omega(1e-3))
    assert payload_range(robot, 0.0, 1.1 * most.nominal, com=FURTHER).omega_c < 0.95 * default_omega(1e-3)
    # A controller that believes in none has the least delta there.
    loaded = robot.with_payload(robot.tip, most.unknown, FURTHER)
    deltas = [
        scipy.linalg.eigvalsh(robot.mass_matrix(q), loaded.mass_matrix(q)).min()
        for q in anywhere(robot, 500, seed=3)
    ]
    assert LEAST_DELTA - 1e-9 < min(deltas) < LEAST_DELTA + 0.1


def test_the_heaviest_load_is_what_the_motors_hold() -> None:
    # The paper's arm, stretched: 0.5 m from the shoulder, whose motor also holds the links.
    weak = ARM.with_limits(effort={"q2": 4.0})
    stretched = np.array([0.0, 0.0, 0.0])
    exact = (4.0 - ARM.gravity(stretched)[1]) / (9.81 * 0.5)
    found = largest_payload(weak).effort
    assert exact <= found < 1.1 * exact  # the random configurations come near the worst one
    assert largest_payload(ARM.with_limits(effort={"q2": 1.0})).effort == 0.0


@settings(max_examples=20)
@given(robots(max_joints=4), decimals(0.0, 2.0), st.floats(1e-3, 5e-3))
def test_a_range_is_served_or_refused_with_ranges_that_are(robot: Robot, heaviest: float, dt: float) -> None:
    try:
        found = payload_range(robot, 0.0, heaviest, dt=dt)
    except PayloadError as error:
        refused = error
    else:
        assert found.delta[0] == 1.0 <= found.delta[1]
        assert 0.0 < found.omega_c <= default_omega(dt)
        # With a computation of a whole sample the loop is stable with no load on.
        tuning = Tuning(*map(np.array, (found.omega_c, 1.0, found.omega_c)))
        assert delay_margins(tuning, delta=found.delta[1]) > 1.5 * dt
        return
    assert 0.0 <= refused.heaviest < heaviest
    assert 0.0 < refused.lightest <= heaviest
    payload_range(robot, 0.0, refused.heaviest * (1.0 - 1e-9), dt=dt)
    # Another lightest load has its own worst configurations among those looked at: almost the same.
    payload_range(robot, heaviest - 0.98 * (heaviest - refused.lightest), heaviest, dt=dt)


@pytest.mark.parametrize("member", [Member(1, 0), Member(2, 1), Member(2, 1, 8.0)])
def test_a_range_knows_what_a_member_tolerates(member: Member) -> None:
    heaviest = largest_payload(ARM, delay=1e-3, member=member).nominal
    found = payload_range(ARM, 0.0, heaviest, delay=1e-3, member=member)
    assert found.omega_c == pytest.approx(default_omega(1e-3, 1e-3, member=member), rel=1e-4)
    tuning = Tuning(*map(np.array, (found.omega_c, 1.0, found.omega_c)))
    assert float(delay_margins(tuning, member, found.delta[1])) > 2.5e-3  # computation, hold and transport
    with pytest.raises(PayloadError) as refused:
        payload_range(ARM, 0.0, 20.0 * heaviest, delay=1e-3, member=member)
    assert payload_range(ARM, 0.0, refused.value.heaviest * (1.0 - 1e-4), delay=1e-3, member=member)
    unknown = largest_payload(ARM, member=member)
    least = gain_interval(open_loop(Tuning(*map(np.array, (1.0, 1.0, 1.0))), member)).lower
    assert 1.0 / (1.0 + unknown.unknown * unknown.mobility) == pytest.approx(least)


def test_a_larger_inertia_leaves_less_delay() -> None:
    tuning = Tuning(*map(np.array, (20.0, 1.0, 20.0)))
    margins = np.array([delay_margins(tuning, delta=delta) for delta in (1.0, 3.0, 10.0, 100.0)])
    assert margins[0] == delay_margins(tuning)
    # 0.356 / omega_c, and 0.4 / (delta omega_c) when the crossover is far above all zeros.
    np.testing.assert_allclose(margins[[0, 3]] * 20.0 * np.array([1.0, 100.0]), [0.356, 0.4], rtol=0.03)


#: Robot, where the load is, sample time [s], largest error without and with half a kilogram [rad].
CARRIERS = {
    "ur10": ("ur10", (0.0, 0.0, 0.0), 1e-3, 0.002, 0.002),
    "ur10 further out": ("ur10", FURTHER, 1e-3, 0.05, 0.015),
    "z1": ("z1", (0.0, 0.0, 0.0), 1e-3, 0.01, 0.002),
    "z1 further out": ("z1", FURTHER, 1e-3, 0.01, 0.002),
    "xarm7": ("xarm7", (0.0, 0.0, 0.0), 1e-3, 0.03, 0.003),
    "xarm7 further out": ("xarm7", FURTHER, 1e-3, 0.03, 0.003),
    # D^-1 D^ goes up to 20: at 1 kHz no bandwidth is high enough.
    "so101": ("so101", (0.0, 0.0, 0.0), 5e-4, 0.1, 0.015),
}


@pytest.mark.parametrize(
    ("name", "com", "dt", "empty", "loaded"),
    # Those further out are harder; at the flange so101 is the hardest.
    [
        pytest.param(*row, id=x, marks=pytest.mark.search if x in ("ur10", "xarm7", "z1") else ())
        for x, row in CARRIERS.items()
    ],
)
def test_half_a_kilogram_comes_and_goes(name: str, com: Any, dt: float, empty: float, loaded: float) -> None:
    robot = load(name)
    start = robot.middle()
    goal = start + 0.5 * (robot.limits.upper - start).clip(max=1.0)
    reference = Waypoints([start, goal, start], durations=2.0, holds=[1.0, 1.0, 2.0])
    controller = GPI(robot, dt, payload=(0.0, 0.5), com=com)
    for mass, most in ((0.0, empty), (0.5, loaded)):
        plant = Encoder(Saturated(RigidBodyPlant(robot.with_payload(robot.tip, mass, com))), bits=16)
        rollout = simulate(plant, controller, reference, t_final=8.0)
        assert int(rollout["status"]) == 0
        assert float(metrics.peak_error(rollout).max()) < most
        assert float(metrics.saturated_time(rollout).max()) == 0.0


def test_gpi_believes_in_the_heaviest_and_says_so() -> None:
    controller = GPI(ARM, 1e-3, payload=(0.1, 0.3), frame="tool", com=[0.0, 0.0, 0.02])
    expected = payload_range(ARM, 0.1, 0.3, "tool", [0.0, 0.0, 0.02])
    assert controller.payload is not None
    assert controller.payload[:4] == expected[:4]
    q = ARM.middle()
    np.testing.assert_array_equal(controller.robot.mass_matrix(q), expected.nominal.mass_matrix(q))
    np.testing.assert_array_equal(controller.gains.nominal().omega_c, expected.omega_c)
    described = controller.describe()
    assert described["payload"]["heaviest"] == 0.3
    assert described["robot"]["changes"][-1]["payload"]["mass"] == 0.3
    assert "payload" not in GPI(ARM, 1e-3).describe()


def test_gains_of_ones_own_are_taken_and_warned_of() -> None:
    robot = load("so101")
    controller = GPI(robot, 1e-3, FixedGains(8.0), payload=(0.0, 0.5))
    assert float(controller.gains.nominal().omega_c[0]) == 8.0
    with pytest.warns(ArmgpiWarning, match="too fast .* 9.8. rad/s"):
        GPI(robot, 1e-3, FixedGains(60.0), payload=(0.0, 0.5))


def test_no_bandwidth_for_a_range_is_said_with_what_would_do() -> None:
    robot = load("so101")
    with pytest.raises(PayloadError, match=r"0 to 0\.319 kg or 0\.0136 to 0\.5 kg") as caught:
        GPI(robot, 1e-3, payload=(0.0, 0.5))
    assert caught.value.asked == (0.0, 0.5)
    GPI(robot, 1e-3, payload=(0.0, 0.99 * caught.value.heaviest))


@pytest.mark.parametrize(
    ("call", "error", "named"),
    [
        (lambda: payload_range(ARM, -0.1, 0.5), ParameterError, "lightest must be zero or positive"),
        (lambda: payload_range(ARM, 0.5, 0.1), ParameterError, "heaviest must be at least the lightest"),
        (lambda: payload_range(ARM, 0.0, np.inf), ParameterError, "heaviest"),
        (lambda: payload_range(ARM, 0.0, 0.5, "tol"), NameNotFound, "did you mean 'tool'"),
        (lambda: payload_range(ARM, 0.0, 0.5, ARM.frame_names[0]), ParameterError, "a frame that moves"),
        (lambda: payload_range(ARM, 0.0, 0.5, dt=0.0), ParameterError, "dt"),
        (lambda: payload_range(ARM, 0.0, 0.5, slowest=0.0), ParameterError, "slowest"),
        (lambda: payload_range(ARM, 0.0, 0.5, com=[0.0, 0.0]), ArmgpiError, "com"),
        (lambda: payload_range(RobotBatch([ARM]), 0.0, 0.5), ParameterError, "a single Robot"),
        (lambda: largest_payload(RobotBatch([ARM])), ParameterError, "a single Robot"),
        (lambda: GPI(ARM, 1e-3, payload=0.5), ParameterError, "payload must be two masses"),
        (lambda: GPI(ARM, 1e-3, frame="tool"), ParameterError, "frame must be left out"),
        (lambda: GPI(ARM, -1.0, payload=(0.0, 0.5)), ParameterError, "dt"),
    ],
)
def test_what_is_wrong_is_named(call: Any, error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        call()
