"""Whatever a closed loop can be made of: the generated code runs it as NumPy does, quantity by quantity."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from loops import agreement, assert_close, compiled
from machines import sled, swing
from sampling import for_search
from strategies import robots

from armgpi import (
    GPI,
    Bezier,
    BSplineNetwork,
    CartesianReference,
    Controller,
    ControlStep,
    Delayed,
    Differentiated,
    DropOut,
    Encoder,
    FixedGains,
    Friction,
    Hold,
    Measurement,
    Noisy,
    PIDInversion,
    Pulse,
    Ramp,
    RateLimited,
    Reference,
    ReferenceBatch,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Saturated,
    Sine,
    SingleTurn,
    Step,
    Target,
    TrackingInverse,
    Unwrapped,
    Waypoints,
    simulate,
)
from armgpi.references.paths import Circle

# What its text does; what an optimiser makes of it stands in test_rollouts_apart and test_zoo_compiled.
pytestmark = pytest.mark.usefixtures("compile_quickly")

DT = 1e-3
ARM = Robot.load("anthropomorphic3")
HEAVY = ARM.with_payload(ARM.tip, 0.4)
ROWS = 5
MOVE = Bezier([0.0, 0.1, 0.0], [0.4, 0.3, -0.2], duration=0.2, t_start=0.02)
#: Numbers between 0 and 1: one for each joint, and one for each joint of each rollout.
EACH = np.random.default_rng(0).uniform(size=3)
OWN = np.random.default_rng(1).uniform(size=(ROWS, 3))


class Loop(NamedTuple):
    """What `simulate` is given."""

    plant: Any = RigidBodyPlant(ARM)
    controller: Any = GPI(ARM, DT)
    reference: Any = MOVE
    options: Any = MappingProxyType({})
    seconds: float = 0.3


def gpi(robot: Any = ARM, gains: Any = None, **options: Any) -> GPI:
    return GPI(robot, DT, FixedGains(20.0) if gains is None else gains, **options)


def network(**options: Any) -> GPI:
    return gpi(gains=BSplineNetwork(**options))


def check(loop: Loop, tolerance: float = 1e-10) -> None:
    """Run a loop both ways, its inner signals recorded, and compare everything.

    Differences stay near rounding, 1e-16 to 1e-12 of a quantity: every sample closes the loop.
    """
    arguments = (loop.plant, loop.controller, loop.reference, loop.seconds)
    options = {"signals": True, **loop.options}
    expected = simulate(*arguments, progress=False, **options)
    assert_close(expected, compiled(*arguments, **options), tolerance)


class Tilted(Waypoints):
    """A reference of a user that NumPy works out."""

    symbolic = False


LOADS = {
    "step": Step(EACH, onset=0.1, end=0.2),
    "step without end": Step(0.5, onset=0.05),
    "ramp": Ramp(EACH, onset=0.1),
    "ramp that ends": Ramp(EACH, onset=-0.1, end=0.15),
    "sine": Sine(EACH, 10.0 * EACH, EACH, onset=0.1),
    "sine with all its own": Sine(OWN, 10.0 * OWN, OWN),
    "pulse": Pulse(EACH, 0.05, 0.1),
    "own pulse": Pulse(OWN, 0.05, 0.1),
    "own step": Step(OWN, onset=0.1),
    "own ramp": Ramp(OWN),
    "all": [Step(EACH, 0.1), Ramp(0.3), Sine(OWN, 30.0), Pulse(2.0, 0.0, 0.5)],
}
WIRES: dict[str, Callable[[Any], Any]] = {
    "saturated": lambda p: Saturated(p, 3.0),
    "own effort": lambda p: Saturated(p, 2.0 + OWN),
    "rate": lambda p: RateLimited(p, 100.0),
    "own rate": lambda p: RateLimited(p, 50.0 + 100.0 * OWN),
    "noise": lambda p: Noisy(p, 1e-4, 1e-3, seed=7),
    "own noise": lambda p: Noisy(p, 1e-4 * OWN, 1e-3 * EACH, seed=2**62),
    "late": lambda p: Delayed(p, 3),
    "not late": lambda p: Delayed(p, 0),
    "lost": lambda p: DropOut(p, 0.3, seed=5),
    "differences": lambda p: Differentiated(p, 150.0),
    "own differences": lambda p: Differentiated(p, 100.0 + 50.0 * OWN),
    "lost, late, noisy": lambda p: DropOut(Delayed(Noisy(Saturated(p, 5.0), 1e-4, seed=1), 2), 0.1),
    "two noises": lambda p: Noisy(Noisy(p, 1e-4, seed=1), EACH * 1e-4, seed=2),
    "lost twice": lambda p: DropOut(DropOut(p, 0.2, seed=1), 0.2, seed=1),
}
CONTROLLERS: dict[str, Callable[[], Any]] = {
    "paper": lambda: gpi(realisation="paper"),
    "from zero": lambda: gpi(start="zero"),
    "cut": lambda: gpi(effort=[3.0, 2.0, 1.0]),
    "cut, paper": lambda: gpi(effort=2.0, realisation="paper"),
    "own gains": lambda: gpi(gains=FixedGains(15.0 + 10.0 * OWN, 0.7 + 0.1 * EACH)),
    "own effort": lambda: gpi(effort=1.0 + 3.0 * OWN),
    "told a payload": lambda: gpi(HEAVY),
    "own robot": lambda: gpi(RobotBatch([ARM, HEAVY, ARM.scaled_inertia(0.8), ARM, HEAVY])),
    "scaled": lambda: gpi(ARM.scaled_inertia(1.2)),
    "own scales": lambda: gpi(RobotBatch([ARM.scaled_inertia(s) for s in (0.8, 0.9, 1.0, 1.1, 1.2)])),
    "roll-off, own poles": lambda: gpi(rolloff=1, rolloff_ratio=3.0 + OWN),
    "gravity ahead, cut": lambda: gpi(feedforward="gravity", effort=[3.0, 2.0, 1.0]),
    "model ahead, own robot": lambda: gpi(
        RobotBatch([ARM, HEAVY, ARM.scaled_inertia(0.8), ARM, HEAVY]), feedforward="model"
    ),
    "model ahead, network, roll-off": lambda: gpi(gains=BSplineNetwork(), rolloff=1, feedforward="model"),
    "computed torque": lambda: gpi(rolloff=1, feedforward="computed"),
    "friction ahead": lambda: gpi(ARM.with_friction(0.1, EACH), friction_feedforward=True),
    "quiet at rest, network": lambda: gpi(
        gains=BSplineNetwork(), rolloff=1, rest_dead_zone=1e-4 * OWN, rest_leak=50.0 * EACH
    ),
    "one integrator, second quadratic": lambda: gpi(
        integrators=1, second_ratio=2.0, second_zeta=0.8 + 0.1 * EACH
    ),
    "three integrators, roll-off 2, network": lambda: gpi(
        gains=BSplineNetwork(), integrators=3, rolloff=2, rolloff_ratio=8.0 + OWN
    ),
    "network": lambda: network(),
    # The printed law under gains that change much does not settle.
    "network, paper": lambda: gpi(gains=BSplineNetwork((22.0, 24.0)), realisation="paper"),
    "network, cut": lambda: gpi(gains=BSplineNetwork(), effort=[3.0, 2.0, 1.0]),
    "network, rate": lambda: network(rate=0.5),
    "network, own rate": lambda: network(rate=0.2 + OWN),
    "network, signed": lambda: network(learning="signed", learning_rate=5.0),
    "network, three boxes": lambda: network(zeta_c=(0.7, 1.0), p_c=(20.0, 40.0)),
    "network, own boxes": lambda: network(omega_c=(20.0 + OWN, 50.0 + OWN), learning_rate=0.1 + 0.1 * OWN),
    "network, knots": lambda: network(knots=[-1, -1, -1, -0.5, 0, 0.5, 1, 1, 1]),
    "network, order 2": lambda: network(knots=[-1, -1, -0.3, 0.3, 1, 1], order=2),
    "network, order 4": lambda: network(knots=[-1, -1, -1, -1, 0, 1, 1, 1, 1], order=4),
    "PID": lambda: PIDInversion(ARM, DT),
    "PID, cut": lambda: PIDInversion(ARM, DT, effort=2.0),
    "PID, own gains": lambda: PIDInversion(ARM, DT, kp=300.0 + 100.0 * OWN, ki=500.0 * EACH, kd=40.0),
    "PID, no integral": lambda: PIDInversion(ARM, DT, ki=0.0, kp=0.0),
    "PID, other bias": lambda: PIDInversion(ARM.scaled_inertia(0.8), DT, bias_robot=ARM),
    "PID, heavy bias": lambda: PIDInversion(ARM, DT, bias_robot=HEAVY),
}
PLANTS: dict[str, Callable[[], Any]] = {
    "substeps": lambda: RigidBodyPlant(ARM, [Sine(EACH, 20.0), Step(1.0, 0.1)], substeps=3),
    "viscous": lambda: RigidBodyPlant(ARM, friction=Friction(0.3, 0.0)),
    "friction": lambda: RigidBodyPlant(ARM, friction=Friction(0.1, EACH)),
    "own friction": lambda: RigidBodyPlant(ARM, friction=Friction(0.1 * OWN, OWN), substeps=2),
    "stiff friction": lambda: RigidBodyPlant(ARM, friction=Friction(1e3, 10.0), stick_velocity=1e-4),
    "friction of the URDF": lambda: RigidBodyPlant(sled(damping=3.0, friction=1.0), friction="urdf"),
    "payload": lambda: RigidBodyPlant(HEAVY),
    "own payloads": lambda: RigidBodyPlant(
        RobotBatch([ARM.with_payload(ARM.tip, m, [0.0, 0.01, 0.0]) for m in (0.0, 0.1, 0.2, 0.3, 0.4)])
    ),
    "own payloads, some scaled": lambda: RigidBodyPlant(
        RobotBatch([ARM, HEAVY.scaled_inertia(0.9), HEAVY, ARM.scaled_inertia(1.1), ARM]),
        friction=Friction(0.1, 0.2),
    ),
    "scaled": lambda: RigidBodyPlant(ARM.scaled_inertia(0.9)),
    "rotors": lambda: RigidBodyPlant(ARM.with_armature(EACH)),
    "tilted": lambda: RigidBodyPlant(ARM.with_gravity([3.0, 0.0, -9.0])),
}
REFERENCES: dict[str, Callable[[], Any]] = {
    "hold": lambda: Hold([0.1, 0.2, 0.3]),
    "own holds": lambda: Hold(0.2 * OWN),
    "own moves": lambda: Bezier(0.1 * OWN, 0.3 * EACH, duration=0.25),
    "waypoints": lambda: Waypoints([[0.0, 0.0, 0.0], [0.2, 0.1, 0.3], [0.0, 0.1, 0.2]], 0.1, 0.03),
    "own waypoints": lambda: Waypoints([0.1 * OWN, 0.3 * OWN, np.zeros(3)], 0.1),
    "many waypoints": lambda: Waypoints(np.random.default_rng(3).uniform(-0.2, 0.2, (60, 3)), 0.05, 0.01),
    "a batch": lambda: ReferenceBatch([Hold(row) for row in 0.2 * OWN[:-1]] + [MOVE]),
    "of a user": lambda: Tilted([0.1 * OWN, 0.3 * OWN], 0.1),
    "shared, of a user": lambda: Tilted([[0.0, 0.0, 0.0], [0.2, 0.1, 0.3]], 0.1),
}

#: What a case beside them has in it as well: `make search` runs these by themselves.
PARTS = {
    *("step", "ramp", "sine", "sine with all its own", "pulse", "own step", "own ramp"),  # all
    *("saturated", "rate", "noise", "late", "lost", "differences"),  # lost, late, noisy
    *("cut", "told a payload", "own scales", "network", "network, rate", "network, cut", "PID"),
    "model ahead, network, roll-off",
    *("viscous", "friction", "payload", "scaled", "hold", "own holds", "waypoints", "own moves"),
}


def sampled(table: Mapping[str, Any]) -> list[Any]:
    """Return the names of a table, those that others have in them for `make search` alone."""
    return [for_search(name) if name in PARTS else name for name in table]


def fitting(plant: Any) -> tuple[Any, Any]:
    """Return a controller and a move for a plant's robot."""
    robot = plant.robot.robots[0] if isinstance(plant.robot, RobotBatch) else plant.robot
    if robot.n == 3:
        return gpi(), MOVE
    return GPI(robot, DT, FixedGains(20.0)), Bezier(robot.middle(), robot.middle() + 0.1, 0.2)


@pytest.mark.parametrize("name", sampled(LOADS))
def test_loads(name: str) -> None:
    check(Loop(plant=RigidBodyPlant(ARM, LOADS[name])))


@pytest.mark.parametrize("name", sampled(WIRES))
def test_wires(name: str) -> None:
    # The baseline looks at velocities as well.
    check(Loop(plant=WIRES[name](RigidBodyPlant(ARM)), controller=PIDInversion(ARM, DT)))


@pytest.mark.parametrize("name", sampled(CONTROLLERS))
def test_controllers(name: str) -> None:
    # Networks make of an error of 1e-4 rad all of their range: rounding is a million times larger there.
    check(Loop(controller=CONTROLLERS[name]()), 1e-9 if "network" in name else 1e-10)


@pytest.mark.parametrize("name", sampled(PLANTS))
def test_plants(name: str) -> None:
    plant = PLANTS[name]()
    controller, move = fitting(plant)
    check(Loop(plant, controller, move))


@pytest.mark.parametrize("name", sampled(REFERENCES))
def test_references(name: str) -> None:
    check(Loop(reference=REFERENCES[name]()))


def test_a_path_in_space() -> None:
    inverse = TrackingInverse(ARM, ARM.tip, near=[0.1, 0.4, 0.8])
    at = ARM.frame_pose(ARM.tip, np.array([0.1, 0.4, 0.8])).translation
    path = Circle(at + np.array([0.0, 0.0, 0.02]), 0.02, 0.5)
    check(Loop(reference=CartesianReference(ARM, ARM.tip, path, inverse)))


def test_starts() -> None:
    check(Loop(options={"q0": [0.05, 0.1, 0.0], "v0": [0.5, -0.3, 0.2]}))
    check(Loop(options={"q0": 0.1 * OWN, "v0": OWN, "record_every": 7}))


@pytest.mark.parametrize("every", [1, 2, 3, 300, 301, 1000])
def test_thinning(every: int) -> None:
    check(Loop(options={"record_every": every}, seconds=0.301))


@pytest.mark.parametrize("seconds", [DT, 2 * DT, 0.0162])
def test_few_samples(seconds: float) -> None:
    check(Loop(seconds=seconds))


def test_turns_are_counted() -> None:
    wheel = swing(2)
    plant = Unwrapped(SingleTurn(RigidBodyPlant(wheel)))
    reference = Bezier([3.0, -3.0], [9.0, -8.0], duration=0.5)
    controller = GPI(wheel, DT, FixedGains(20.0))
    check(Loop(plant, controller, reference, {"q0": [3.01, -3.1], "v0": [2.0, 0.0]}, 0.6), 1e-9)


def test_slides_and_a_single_joint() -> None:
    rail = sled(mass=2.0, damping=3.0, friction=1.0)
    plant = Delayed(Noisy(RigidBodyPlant(rail, Sine(2.0, 5.0), "urdf"), 1e-5), 1)
    check(Loop(plant, GPI(rail, DT, BSplineNetwork()), Bezier([0.0], [0.4], 0.2)))


@pytest.mark.parametrize("bits", [10, 16, np.array([12.0, 16.0, 20.0]), np.rint(10.0 + 10.0 * OWN)])
def test_encoders(bits: Any) -> None:
    plant = Encoder(RigidBodyPlant(ARM, Sine(OWN, 5.0)), bits)
    arguments = (plant, gpi(), MOVE, 0.5)
    apart = agreement(simulate(*arguments), compiled(*arguments), plant.step_size)
    assert apart.before < 1e-9
    assert apart.counts <= 1.0
    assert apart.after < 10.0 * np.max(plant.step_size)


@pytest.mark.parametrize("times", [0.1, 0.15, 0.05 + 0.0005, 0.1 - 1e-13])
def test_loads_set_in_at_the_same_stage(times: float) -> None:
    # An onset on a sample, between two, or beside one: the comparison with the time decides.
    loads = [Step(1.0, onset=times), Pulse(1.0, times, 0.01), Ramp(5.0, onset=times)]
    for substeps in (1, 3):
        check(Loop(plant=RigidBodyPlant(ARM, loads, substeps=substeps), seconds=0.16))


# --- What users write themselves -------------------------------------------------------------------


class Memory(NamedTuple):
    """State of a user's controller."""

    integral: Any
    last: Any
    pair: Any


class UsersController(Controller):
    """PID with a dead zone, written with whatever NumPy has for it, and signals of its own."""

    def __init__(self, robot: Any, dt: float, gain: Any = 400.0) -> None:
        super().__init__(robot, dt)
        self.gain = np.asarray(gain)
        self.options = {"damping": 40.0, "zone": np.array([1e-5, 0.0, 2e-5])}
        self.weights = [np.array(0.5), np.array([0.1, 0.2, 0.3])]

    def init(self, measurement: Measurement, target: Target) -> Memory:
        e = measurement.q - target.q
        return Memory(np.zeros_like(e), e, (np.ones_like(e), np.zeros_like(e)))

    def step(self, measurement: Measurement, target: Target, state: Memory) -> ControlStep:
        e = measurement.q - target.q
        zone = self.options["zone"]
        e = np.where(np.abs(e) > zone, e - np.sign(e) * zone, 0.0)
        integral = np.clip(state.integral + self.dt * e, -0.1, 0.1)
        slope = (e - state.last) / self.dt
        smooth = 0.9 * state.pair[1] + 0.1 * slope
        u = self.gain * e + 300.0 * integral + self.options["damping"] * smooth
        u += np.sqrt(np.square(e) + 1e-6) * self.weights[0] * np.sin(self.weights[1] + e) ** 3
        u = u * np.exp(-np.minimum(np.fabs(e), 1.0)) + np.floor(1e3 * e) * 1e-3
        u = u + 0.01 * np.dot(e, e) if e.ndim == 1 else u + 0.01 * np.sum(e * e, axis=-1, keepdims=True)
        a = np.logical_and(np.isfinite(e), ~(np.abs(slope) >= 1e9)) * (target.a - u)
        tau = self.robot.dynamics.inverse(measurement.q, smooth, a)
        return ControlStep(self.limited(tau), Memory(integral, e, (e.copy(), smooth)))

    def signals(self, state: Memory) -> dict[str, Any]:
        return {"integral": state.integral, "smooth": state.pair[1]}


def test_a_users_elementwise_controller() -> None:
    check(Loop(controller=UsersController(ARM, DT)))
    check(Loop(controller=UsersController(ARM, DT), options={"q0": MOVE.start + 0.01 * OWN}))
    check(Loop(controller=UsersController(ARM, DT, 400.0 + EACH)))


class UsersReference(Reference):
    """A wave that NumPy works out, told by a function."""

    def __init__(self, wave: Callable[[Any], Any]) -> None:
        self.wave = wave

    def at(self, t: Any) -> Target:
        w = np.asarray(self.wave(np.asarray(t, dtype=float)))[..., None] * np.ones(3)
        return Target(0.1 * w, 0.0 * w, 0.0 * w)


def test_a_users_reference() -> None:
    check(Loop(reference=UsersReference(lambda t: np.round(np.sin(5.0 * t), 3))))


# --- Everything together ---------------------------------------------------------------------------


@st.composite
def loops(draw: st.DrawFn) -> Loop:
    """Loops put together at random of what is above."""
    robot: Robot | RobotBatch = draw(st.sampled_from([ARM, HEAVY, ARM.scaled_inertia(0.9)]))
    own = draw(st.booleans())
    if own and draw(st.booleans()):
        robot = RobotBatch([ARM, HEAVY, ARM.scaled_inertia(1.1), HEAVY.scaled_inertia(0.9), ARM])
    loads = draw(
        st.lists(st.sampled_from([name for name in LOADS if name != "all"]), max_size=3, unique=True)
    )
    friction = draw(st.sampled_from([None, Friction(0.1, 0.0), Friction(0.1, 0.2 * EACH)]))
    mine = [LOADS[name] for name in loads if own or "own" not in name]
    plant: Any = RigidBodyPlant(robot, mine, friction, substeps=draw(st.integers(1, 2)))
    for name in draw(st.lists(st.sampled_from(sorted(WIRES)), max_size=3)):
        if own or "own" not in name:
            plant = WIRES[name](plant)
    name = draw(st.sampled_from([name for name in CONTROLLERS if own or "own" not in name]))
    reference = draw(st.sampled_from([name for name in REFERENCES if own or name in ("hold", "waypoints")]))
    options = {"record_every": draw(st.integers(1, 5))}
    return Loop(plant, CONTROLLERS[name](), REFERENCES[reference](), options, 0.1)


@settings(
    max_examples=6,
    phases=[Phase.explicit, Phase.reuse, Phase.generate],  # compiling takes a while: show what was found
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(loops())
def test_any_loop(loop: Loop) -> None:
    check(loop, 1e-8)


@pytest.mark.slow
@settings(max_examples=3, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(robots(max_joints=4))
def test_any_arm(robot: Robot) -> None:
    robot = robot.with_limits(effort=1e3)
    start = np.clip(robot.middle(), -1.0, 1.0)
    plant = RigidBodyPlant(robot, Sine(1.0, 4.0), Friction(0.2, 0.1))
    check(Loop(plant, GPI(robot, DT, BSplineNetwork()), Bezier(start, start, 0.1), seconds=0.1), 1e-8)
    assert math.isfinite(start.sum())


class Sliding(Controller):
    """A user's law with elementary functions: a smoothed sliding mode with a saturating integral."""

    def init(self, measurement: Any, target: Any) -> Any:
        return (np.zeros_like(measurement.q), measurement.q)

    def step(self, measurement: Any, target: Any, state: Any) -> ControlStep:
        integral, last = state
        e = measurement.q - target.q
        s = 200.0 * (measurement.q - last) + 10.0 * e + integral
        push = (
            np.tanh(s)
            + 0.1 * np.arctan(s)
            + 0.01 * np.tan(np.clip(s, -1.0, 1.0))
            + 0.01 * np.log(1.0 + s * s)
        )
        asked = self.robot.dynamics.inertia_times(measurement.q, -20.0 * push * np.exp(-np.square(e)))
        tau = self.limited(asked + self.robot.dynamics.gravity(measurement.q))
        return ControlStep(tau, (np.clip(integral + 1e-3 * e, -0.1, 0.1), measurement.q))


def test_a_users_law_of_elementary_functions() -> None:
    check(Loop(controller=Sliding(ARM, DT)))
