"""Friction: closed forms on one joint, passivity on any robot, and arms too stiff for explicit steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import sled, swing
from sampling import for_search
from strategies import State, robots_and_states

from armgpi import GPI, Friction, Hold, RigidBodyPlant, Robot, Status, simulate
from armgpi.errors import ArmgpiError, ArrayError, ParameterError
from armgpi.plants.friction import ImplicitFriction
from armgpi.plants.plant import PlantState

Array = npt.NDArray[np.float64]

DT = 1e-3
STICK = 1e-3  # [m/s] the speed below which Coulomb friction is smoothed, the plant's default


def run(plant: RigidBodyPlant, samples: int, dt: float, v: float = 0.0, force: float = 0.0) -> PlantState:
    """Return the state of a single joint after so many samples."""
    state = plant.init(np.zeros(1), np.array([v]))
    for _ in range(samples):
        state = plant.step(np.array([force]), state, dt)
    return state


def test_a_viscous_sled_slows_down_exponentially_to_order_one() -> None:
    mass, damping, t = 2.0, 3.0, 1.0
    decay = math.exp(-damping / mass * t)
    counts = np.array([20, 40, 80, 160, 320])
    ends = [run(RigidBodyPlant(sled(mass), friction=Friction(damping, 0.0)), n, t / n, v=1.0) for n in counts]
    speed = [abs(float(end.v[0]) - decay) for end in ends]
    way = [abs(float(end.q[0]) - mass / damping * (1.0 - decay)) for end in ends]
    for errors in (speed, way):
        assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("stiffness", [1e-2, 1.0, 1e3, 1e9])
def test_the_terminal_velocity_is_exact_however_stiff_the_friction(stiffness: float) -> None:
    # `stiffness` is the friction's rate times the step: an explicit step is unstable above 2.
    damping = stiffness / DT
    end = run(RigidBodyPlant(sled(), friction=Friction(damping, 0.0)), 4000, DT, force=3.0)
    assert float(end.v[0]) == pytest.approx(3.0 / damping, rel=1e-12)


def test_a_sled_with_coulomb_friction_stops_where_it_should_and_stays() -> None:
    mass, friction, v = 2.0, 4.0, 1.0
    plant = RigidBodyPlant(sled(mass), friction=Friction(0.0, friction))
    stopping = round(mass * v / friction / DT)
    moving, stopped = run(plant, stopping - 10, DT, v=v), run(plant, stopping + 10, DT, v=v)
    # Smoothed friction lacks f stick^2 / (2 v^2), in all stick^2 / (2 v) of speed.
    speed = v - friction / mass * (stopping - 10) * DT
    assert float(moving.v[0]) == pytest.approx(speed, abs=STICK**2 / speed)
    assert abs(float(stopped.v[0])) < STICK
    # To order one in the step, and the little way that smoothed friction lets it creep.
    assert float(stopped.q[0]) == pytest.approx(mass * v**2 / (2.0 * friction), abs=2.0 * DT * v)
    later = run(plant, stopping + 2000, DT, v=v)
    assert abs(float(later.q[0] - stopped.q[0])) < STICK * DT


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "share"), [(1.0, 0.5), (1e-2, 0.9), (1e-4, 0.99), (1e-4, 0.5)])
def test_a_force_below_breakaway_only_creeps_however_light_the_joint(mass: float, share: float) -> None:
    # Smoothed friction f v / sqrt(v^2 + stick^2) balances a share of f at this speed, whatever the mass.
    creep = STICK * share / math.sqrt(1.0 - share**2)
    plant = RigidBodyPlant(sled(mass), friction=Friction(0.0, 2.0))
    from_rest = run(plant, 1000, DT, force=2.0 * share)
    kept = run(plant, 1000, DT, v=creep, force=2.0 * share)
    assert 0.0 < float(from_rest.v[0]) <= creep * (1.0 + 1e-6)
    assert float(kept.v[0]) == pytest.approx(creep, rel=1e-6)


@pytest.mark.parametrize("mass", [1.0, 1e-4])
def test_a_force_beyond_breakaway_accelerates_with_what_is_left(mass: float) -> None:
    state = run(RigidBodyPlant(sled(mass), friction=Friction(0.0, 2.0)), 1000, DT, force=2.5)
    assert float(state.v[0]) == pytest.approx(0.5 / mass, rel=0.02)  # order one, and the start is smooth


def test_a_smaller_stick_velocity_creeps_less() -> None:
    plant = RigidBodyPlant(sled(), friction=Friction(0.0, 2.0), stick_velocity=1e-6)
    assert float(run(plant, 1000, DT, force=1.0).v[0]) == pytest.approx(
        1e-6 * 0.5 / math.sqrt(0.75), rel=1e-6
    )


coefficients = st.tuples(*[st.integers(-6, 6).map(lambda power: 10.0 ** (0.5 * power))] * 2)


@settings(max_examples=60)
@given(robots_and_states(max_joints=6), coefficients, st.booleans())
def test_friction_solves_its_own_equation_on_any_robot(
    drawn: tuple[Robot, State], pair: tuple[float, float], uneven: bool
) -> None:
    # What is left of D (v - v_free) + h (f_v v + f_c v / |v|), compared with the friction itself.
    robot, (q, v, _) = drawn
    scale = np.arange(1, robot.n + 1) if uneven else 1.0
    viscous, coulomb = (np.broadcast_to(x * scale, robot.n) for x in pair)
    free = RigidBodyPlant(robot)
    rough = RigidBodyPlant(robot, friction=Friction(viscous, coulomb))
    tau = robot.gravity(q)
    v_free, new = (plant.step(tau, plant.init(q, v), DT).v for plant in (free, rough))
    resistance = DT * (viscous * new + coulomb * new / np.sqrt(new**2 + STICK**2))
    left = robot.mass_matrix(q) @ (new - v_free) + resistance
    momentum = np.abs(robot.mass_matrix(q)) @ np.abs(v_free)
    assert np.abs(left).max() <= 1e-6 * (DT * coulomb.max() + momentum.max())


@settings(max_examples=60)
@given(robots_and_states(max_joints=6), coefficients)
def test_friction_never_adds_energy_on_any_robot(
    drawn: tuple[Robot, State], pair: tuple[float, float]
) -> None:
    robot, (q, v, _) = drawn
    robot = robot.with_gravity([0.0, 0.0, 0.0])
    model = robot.pinocchio_model()
    data = model.createData()
    plant, dt = RigidBodyPlant(robot, friction=Friction(*pair)), 1e-4
    state, before = plant.init(q, v), float(pin.computeKineticEnergy(model, data, q, v))
    first = before
    for _ in range(20):
        state = plant.step(np.zeros(robot.n), state, dt)
        after = float(pin.computeKineticEnergy(model, data, state.q, state.v))
        # Friction takes D from the beginning of a step: what that gets wrong is of second order in a
        # change that is of first, and was never seen.
        assert after <= before + 1e-12 * first
        before = after


@pytest.mark.parametrize("name", ["z1", for_search("xarm7")])
def test_stiff_friction_of_a_urdf_survives_a_second_without_torque_at_1_khz(name: str) -> None:
    robot = Robot.load(name)
    assert robot.friction.viscous.max() >= 2.0
    q = robot.middle()
    coarse, fine = (RigidBodyPlant(robot, friction="urdf", substeps=n) for n in (1, 10))
    state, exact = coarse.init(q, np.zeros(robot.n)), fine.init(q, np.zeros(robot.n))
    for k in range(1000):
        state = coarse.step(np.zeros(robot.n), state, DT)
        if k < 200:
            exact = fine.step(np.zeros(robot.n), exact, DT)
        if k == 199:
            # Order one: a tenth of the step leaves a tenth of the error. It sinks, slowly.
            moved = np.abs(exact.q - q).max()
            assert moved > 1e-3
            assert np.abs(state.q - exact.q).max() < 0.02 * moved
    assert np.isfinite(state.q).all()
    assert np.abs(state.v).max() < 10.0  # [rad/s]


@pytest.mark.parametrize("name", ["z1", for_search("xarm7")])
def test_stiff_friction_of_a_urdf_survives_a_second_of_feedback_at_1_khz(name: str) -> None:
    # With the light wrists of the URDF alone, friction is so much faster than the loop that the law is
    # unstable (as it is in continuous time), slowly: nothing blows up, and the integrator agrees with itself.
    robot = Robot.load(name)
    q = robot.middle()
    bare = simulate(RigidBodyPlant(robot, friction="urdf"), GPI(robot, DT), Hold(q), 1.0, q0=q + 0.02)
    assert int(bare["status"]) == Status.FINISHED
    # Rotor inertia, which such gearboxes have, makes a loop that works of it.
    geared = robot.with_armature(0.1)
    coarse, fine = (
        simulate(
            RigidBodyPlant(geared, friction="urdf", substeps=n), GPI(geared, DT), Hold(q), 1.0, q0=q + 0.02
        )
        for n in (1, 5)
    )
    assert np.abs(coarse["q"] - q).max() < 0.1
    assert np.abs(coarse["q"] - fine["q"]).max() < 1e-3


def test_an_explicit_step_of_that_friction_would_diverge() -> None:
    # Why it is implicit: the same coefficients as a torque that is held over the sample.
    robot = Robot.load("xarm7")
    plant = RigidBodyPlant(robot)
    state = plant.init(robot.middle(), np.full(robot.n, 1e-3))
    with np.errstate(all="ignore"):
        for _ in range(20):
            state = plant.step(-robot.friction.viscous * state.v, state, DT)
    assert not np.abs(state.v).max() < 1e3


def test_friction_comes_only_when_asked_for() -> None:
    robot = sled(damping=5.0, friction=1.0)
    np.testing.assert_array_equal(robot.friction, [[5.0], [1.0]])
    assert float(run(RigidBodyPlant(robot), 100, DT, v=1.0).v[0]) == 1.0
    rough = [RigidBodyPlant(robot, friction=f) for f in ("urdf", Friction(5.0, 1.0), (5.0, [1.0]))]
    speeds = {float(run(plant, 100, DT, v=1.0).v[0]) for plant in rough}
    assert len(speeds) == 1
    assert speeds.pop() < 0.7


def test_a_batch_is_the_same_arms_one_by_one() -> None:
    arm = swing(2)
    viscous, coulomb = np.array([[0.1, 0.2], [30.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 2.0]])
    plant = RigidBodyPlant(arm, friction=Friction(viscous, coulomb))
    assert plant.batch == 2
    q, v = np.array([[0.1, 0.2], [0.3, 0.4]]), np.ones((2, 2))
    together = plant.init(q, v)
    for _ in range(50):
        together = plant.step(np.zeros((2, 2)), together, DT)
    for row in range(2):
        one = RigidBodyPlant(arm, friction=Friction(viscous[row], coulomb[row]))
        alone = one.init(q[row], v[row])
        for _ in range(50):
            alone = one.step(np.zeros(2), alone, DT)
        np.testing.assert_allclose(
            [together.q[row], together.v[row]], [alone.q, alone.v], rtol=0.0, atol=1e-12
        )


def test_a_diverged_rollout_does_not_stop_the_others() -> None:
    arm = swing(2)
    plant = RigidBodyPlant(arm, friction=Friction(1.0, 0.5))
    q = np.array([[0.1, 0.2], [math.nan, 0.0], [0.3, 0.4]])
    state = plant.step(np.zeros((3, 2)), plant.init(q, np.ones((3, 2))), DT)
    assert np.isfinite(state.v[[0, 2]]).all()
    assert np.isnan(state.v[1]).any()


@pytest.mark.parametrize(
    ("friction", "error", "named"),
    [
        ("dry", ParameterError, "friction"),
        (5.0, ParameterError, "friction"),
        ((1.0,), ParameterError, "friction"),
        (Friction(-1.0, 0.0), ArrayError, "viscous"),
        (Friction(0.0, [1.0, -1.0]), ArrayError, "coulomb.*joint2"),
        (Friction(0.0, [1.0, 1.0, 1.0]), ArrayError, "coulomb"),
        (Friction(np.ones((2, 2)), np.ones((3, 2))), ArmgpiError, "batch"),
    ],
)
def test_bad_friction_is_named(friction: Any, error: type[ArmgpiError], named: str) -> None:
    with pytest.raises(error, match=named):
        RigidBodyPlant(swing(2), friction=friction)


def test_a_rollout_settles_by_itself_whatever_its_neighbours_need() -> None:
    # Newton's method ends for a rollout when its own numbers rest: three arms, from calm to sliding.
    brake = ImplicitFriction(sticks=(True,))
    random = np.random.default_rng(27)
    spread = random.normal(size=(3, 4, 4)) * np.array([0.1, 1.0, 10.0])[:, None, None]
    inertia = spread @ spread.swapaxes(-1, -2) + 1e-2 * np.eye(4)
    v_free = random.normal(size=(3, 4)) * np.array([1e-6, 1e-2, 10.0])[:, None]
    before = random.normal(size=(3, 4))
    coulomb = np.array([1e-2, 1.0, 300.0])[:, None] * np.ones(4)
    together = brake(v_free, before, 0.1 * coulomb, coulomb, DT, STICK, inertia)
    for row in range(3):
        alone = brake(v_free[row], before[row], 0.1 * coulomb[row], coulomb[row], DT, STICK, inertia[row])
        np.testing.assert_array_equal(together[row], alone)


@given(st.integers(0, 2**32 - 1))
def test_what_settled_is_the_balance_of_momentum_and_friction(seed: int) -> None:
    # D v = D v_free - h (f_v v + f_c v / sqrt(v^2 + stick^2)), the equation itself as the witness.
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 8))
    spread = random.normal(size=(n, n)) * 10.0 ** random.uniform(-2.0, 1.0)
    inertia = spread @ spread.T + np.diag(10.0 ** random.uniform(-3.0, 0.5, n))
    v_free = random.normal(size=n) * 10.0 ** random.uniform(-5.0, 1.0)
    before = random.normal(size=n) * 10.0 ** random.uniform(-8.0, 1.0)
    viscous = 10.0 ** random.uniform(-3.0, 2.0, n)
    coulomb = 10.0 ** random.uniform(-3.0, 3.0, n)
    v = ImplicitFriction(sticks=(True,))(v_free, before, viscous, coulomb, DT, STICK, inertia)
    impulse = DT * (viscous * v + coulomb * v / np.sqrt(v * v + STICK * STICK))
    scale = np.abs(inertia) @ np.abs(v_free) + DT * coulomb
    assert (np.abs(inertia @ (v - v_free) + impulse) <= 1e-8 * scale.max()).all()


@given(st.integers(0, 2**32 - 1))
def test_where_the_search_begins_decides_nothing(seed: int) -> None:
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 8))
    spread = random.normal(size=(n, n))
    inertia = spread @ spread.T + np.diag(10.0 ** random.uniform(-3.0, 0.5, n))
    v_free = random.normal(size=n) * 10.0 ** random.uniform(-5.0, 1.0)
    coulomb = 10.0 ** random.uniform(-3.0, 3.0, n)
    # At rest, without friction, the other way round, and far too fast.
    starts = (np.zeros(n), v_free, -v_free, 1e3 * random.normal(size=n))
    brake = ImplicitFriction(sticks=(True,))
    first, *others = (brake(v_free, start, 0.1 * coulomb, coulomb, DT, STICK, inertia) for start in starts)
    # What is left of the balance is 1e-10 of Coulomb friction, whatever the start.
    for other in others:
        assert (np.abs(inertia @ (other - first)) <= 1e-8 * DT * coulomb.max() * n).all()


def test_what_has_no_coulomb_friction_is_not_waited_for() -> None:
    # The first joint has none: its velocity is free, and the second one's is that of the arm with both.
    inertia = np.array([[1.0, 0.2], [0.2, 0.5]])
    v_free, coulomb = np.array([0.3, 2e-3]), np.array([0.0, 0.4])
    v = ImplicitFriction(sticks=(True,))(v_free, np.zeros(2), np.zeros(2), coulomb, DT, STICK, inertia)
    impulse = DT * coulomb * v / np.sqrt(v * v + STICK * STICK)
    np.testing.assert_allclose(inertia @ (v - v_free), -impulse, rtol=0.0, atol=1e-9 * DT)
