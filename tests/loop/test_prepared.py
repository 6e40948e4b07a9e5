"""A loop that is prepared once runs with new numbers as one that is made of them, and compiles nothing."""

from __future__ import annotations

import pickle
from collections import OrderedDict
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from machines import swing

import armgpi
from armgpi import (
    GPI,
    ArmgpiError,
    ArmgpiWarning,
    Bezier,
    BSplineNetwork,
    Delayed,
    Differentiated,
    DropOut,
    ElasticPlant,
    Encoder,
    FixedGains,
    Friction,
    GainSchedule,
    Hold,
    Noisy,
    PIDInversion,
    Plant,
    PreparedLoop,
    Pulse,
    Ramp,
    RateLimited,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Saturated,
    Sine,
    Status,
    Step,
    Supervisor,
    ToolForce,
    Wall,
    Waypoints,
    prepare,
    simulate,
)
from armgpi.base.parameter import with_parameters
from armgpi.codegen import build
from armgpi.errors import ArrayError, LimitError, NameNotFound, ParameterError
from armgpi.loop import prepared as preparing
from armgpi.plants.plant import Wrapper
from armgpi.robot.batch import VariedRobots, feedback_model

DT, SECONDS = 1e-3, 0.3
ARM = Robot.load("anthropomorphic3")
MOVE = Bezier([0.0, 0.1, 0.0], [0.4, 0.3, -0.2], duration=0.2, t_start=0.02)
ROWS = 3
EACH = np.random.default_rng(2).uniform(size=ROWS)
OWN = np.random.default_rng(3).uniform(size=(ROWS, 3))
LOADS = [Step(0.5, 0.05), Ramp(1.0, 0.05, 0.2), Sine(0.3, 20.0), Pulse(1.0, 0.05, 0.1)]


def gpi(gains: Any = None, **options: Any) -> GPI:
    return GPI(ARM, DT, FixedGains(20.0) if gains is None else gains, **options)


def column(values: Any) -> Any:
    return np.asarray(values, dtype=np.float64)[:, None]


#: Name of a parameter, its values, and the loop that has them: plant, controller, reference.
ARMS = (RigidBodyPlant(ARM), gpi(), MOVE)
BY_ROLLOUT: dict[str, tuple[tuple[Any, Any, Any], dict[str, Any], Callable[[], tuple[Any, Any, Any]]]] = {
    "payload": (
        ARMS,
        {"plant.payload.mass": 0.3 * EACH, "plant.payload.com": 0.1 * OWN},
        lambda: (RigidBodyPlant(ARM.varied(payload=0.3 * EACH, com=0.1 * OWN)), gpi(), MOVE),
    ),
    "robot": (
        ARMS,
        {"plant.inertia_scale": 0.8 + EACH, "plant.rotor_inertia": 0.1 * OWN, "plant.viscous": OWN},
        lambda: (
            RigidBodyPlant(
                ARM.varied(inertia_scale=0.8 + EACH, rotor_inertia=0.1 * OWN),
                friction=Friction(OWN, np.zeros(3)),
            ),
            gpi(),
            MOVE,
        ),
    ),
    "nominal": (
        ARMS,
        {"controller.inertia_scale": 0.8 + 0.4 * EACH, "controller.omega": 15.0 + 10.0 * EACH},
        lambda: (
            RigidBodyPlant(ARM),
            GPI(ARM.varied(inertia_scale=0.8 + 0.4 * EACH), DT, FixedGains(15.0 + 10.0 * column(EACH))),
            MOVE,
        ),
    ),
    "loads": (
        (RigidBodyPlant(ARM, LOADS), gpi(), MOVE),
        {
            "plant.loads.0.onset": 0.1 * EACH,
            "plant.loads.1.end": 0.1 + 0.1 * EACH,
            "plant.loads.2.omega": 10.0 + OWN,
            "plant.loads.3.duration": 0.1 + EACH,
        },
        lambda: (
            RigidBodyPlant(
                ARM,
                [
                    Step(0.5, column(0.1 * EACH)),
                    Ramp(1.0, 0.05, column(0.1 + 0.1 * EACH)),
                    Sine(0.3, 10.0 + OWN),
                    Pulse(1.0, 0.05, column(0.1 + EACH)),
                ],
            ),
            gpi(),
            MOVE,
        ),
    ),
    "network": (
        (Encoder(RigidBodyPlant(ARM), 16), gpi(BSplineNetwork()), MOVE),
        {
            "controller.leak": 1.0 + EACH,
            "controller.bandwidth": 40.0 + EACH,
            "controller.omega": (15.0 + OWN, 40.0 + OWN),
            "plant.encoder_bits": np.array([14, 15, 16]),
        },
        lambda: (
            Encoder(RigidBodyPlant(ARM), column([14, 15, 16])),
            gpi(
                BSplineNetwork(
                    (15.0 + OWN, 40.0 + OWN),
                    leak=column(1.0 + EACH),
                    bandwidth=column(40.0 + EACH),
                )
            ),
            MOVE,
        ),
    ),
    "initial weights": (
        (RigidBodyPlant(ARM), gpi(BSplineNetwork()), MOVE),
        {"controller.weights.omega": 10.0 * EACH[:, None, None] * np.ones((3, 4))},
        lambda: (
            RigidBodyPlant(ARM),
            gpi(BSplineNetwork(weights={"omega_c": 10.0 * EACH[:, None, None] * np.ones((3, 4))})),
            MOVE,
        ),
    ),
    "sensors": (
        (
            Delayed(
                DropOut(
                    Noisy(Differentiated(RateLimited(Saturated(RigidBodyPlant(ARM), 9.0), 90.0)), 1e-5), 0.1
                ),
                2,
            ),
            PIDInversion(ARM, DT),
            MOVE,
        ),
        {
            "plant.drop_out": 0.3 * EACH,
            "plant.noise.position": 1e-4 * EACH,
            "plant.velocity_bandwidth": 100.0 + EACH,
            "plant.torque_rate": 50.0 + OWN,
            "plant.torque_limit": 8.0 + OWN,
            "controller.kp": 300.0 + 10.0 * OWN,
        },
        lambda: (
            Delayed(
                DropOut(
                    Noisy(
                        Differentiated(
                            RateLimited(Saturated(RigidBodyPlant(ARM), 8.0 + OWN), 50.0 + OWN),
                            100.0 + column(EACH),
                        ),
                        1e-4 * column(EACH),
                    ),
                    column(0.3 * EACH),
                ),
                2,
            ),
            PIDInversion(ARM, DT, kp=300.0 + 10.0 * OWN),
            MOVE,
        ),
    ),
    "move": (
        ARMS,
        {
            "reference.goal": 0.3 * OWN,
            "reference.duration": 0.1 + 0.1 * EACH,
            "reference.t_start": 0.05 * EACH,
        },
        lambda: (
            *ARMS[:2],
            Bezier(MOVE.start, 0.3 * OWN, column(0.1 + 0.1 * EACH), column(0.05 * EACH)),
        ),
    ),
    "moves": (
        (*ARMS[:2], Waypoints([np.zeros(3), 0.2 * np.ones(3), np.zeros(3)], 0.1, 0.02)),
        {
            "reference.points.1": 0.3 * OWN,
            "reference.durations.1": 0.05 + 0.1 * EACH,
            "reference.holds.0": 0.1 * EACH,
        },
        lambda: (
            *ARMS[:2],
            Waypoints(
                [np.zeros(3), 0.3 * OWN, np.zeros(3)],
                [0.1, column(0.05 + 0.1 * EACH)],
                [column(0.1 * EACH), 0.02, 0.02],
            ),
        ),
    ),
    "schedule at rest": (
        (*ARMS[:1], gpi(GainSchedule()), Hold([0.1, 0.2, 0.3])),
        {"controller.leak": 1.0 + EACH, "controller.rest_leak": 50.0 * EACH, "reference.q": 0.2 * OWN},
        lambda: (
            RigidBodyPlant(ARM),
            gpi(GainSchedule(leak=column(1.0 + EACH)), rest_leak=50.0 * column(EACH)),
            Hold(0.2 * OWN),
        ),
    ),
}


def prepared(parts: tuple[Any, Any, Any], backend: str, **options: Any) -> PreparedLoop:
    return prepare(*parts, SECONDS, backend=backend, **options)


def assert_same(one: xr.Dataset, other: xr.Dataset, tolerance: float = 0.0) -> None:
    for name in one.data_vars:
        np.testing.assert_allclose(one[name], other[name], rtol=0.0, atol=tolerance, err_msg=str(name))


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("name", BY_ROLLOUT)
def test_new_numbers_are_those_of_a_loop_made_of_them(name: str, backend: str) -> None:
    parts, values, made = BY_ROLLOUT[name]
    expected = simulate(*made(), SECONDS, backend=backend, progress=False)
    assert expected.sizes["rollout"] == ROWS
    # Generated code has numbers that are given anew as inputs, and others as literals.
    tolerance = 1e-12 if (name, backend) == ("initial weights", "compiled") else 0.0
    assert_same(prepared(parts, backend).run(values), expected, tolerance)


@pytest.mark.parametrize("name", ["payload", "sensors", "network"])
def test_other_numbers_trace_and_compile_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    parts, values, _ = BY_ROLLOUT[name]
    # What other tests have generated is not known here.
    monkeypatch.setattr("armgpi.codegen.run._generated", OrderedDict())
    loop = prepared(parts, "compiled")
    loop.run(values)

    def refused(*arguments: Any) -> Any:
        raise AssertionError("compiled anew")

    monkeypatch.setattr(build, "library", refused)
    monkeypatch.setattr(build, "find_library", refused)
    monkeypatch.setattr("armgpi.codegen.run.trace_used", refused)
    monkeypatch.setattr("armgpi.codegen.kernels.Arm._build_kernel", refused)
    # A scale of 1 and a payload of 0 in a whole batch are values like others.
    zero = {key: 0.0 * value for key, value in values.items() if key == "plant.payload.mass"}
    for seed in (1, 2):
        loop.run({**values, **zero}, seed=seed)
    with pytest.warns(ArmgpiWarning, match="compiled anew"):
        loop.run({})


@pytest.mark.parametrize("scale", [1.0, 0.9])
@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_factors_of_the_feedbacks_inertia_by_rollout_are_those_of_single_runs(
    backend: str, scale: float
) -> None:
    """The nominal model of each rollout has its own links and rotors, also where it is scaled already."""
    arm = ARM.with_armature(0.04)
    plant = RigidBodyPlant(arm)

    def law(link_factor: float = 1.0, rotor_factor: float = 1.0) -> GPI:
        return GPI(
            arm.scaled_inertia(scale),
            DT,
            FixedGains(12.0),
            bias_robot=arm,
            feedforward="computed",
            integrators=1,
            link_factor=link_factor,
            rotor_factor=rotor_factor,
        )

    links, rotors = np.array([0.4, 0.7, 1.0]), np.array([1.5, 1.0, 2.0])
    loop = armgpi.prepare(plant, law(), MOVE, 0.05, backend=backend)
    found = loop.run({"controller.link_factor": links, "controller.rotor_factor": rotors}, progress=False)
    for row in range(3):
        single = law(float(links[row]), float(rotors[row]))
        one = armgpi.simulate(plant, single, MOVE, 0.05, backend="numpy", progress=False)
        np.testing.assert_allclose(found["tau"].values[row], one["tau"].values, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_delays_by_rollout_are_those_of_single_runs(backend: str) -> None:
    late = np.array([0, 3, 1])
    plant = Delayed(Encoder(RigidBodyPlant(ARM), 16), 1)
    both = prepared((plant, gpi(), MOVE), backend).run({"plant.delay": late})
    for i, samples in enumerate(late):
        alone = simulate(
            Delayed(Encoder(RigidBodyPlant(ARM), 16), int(samples)),
            gpi(),
            MOVE,
            SECONDS,
            backend=backend,
            progress=False,
        )
        assert_same(both.isel(rollout=i), alone, 0.0 if backend == "compiled" else 1e-12)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_any_seeds(backend: str) -> None:
    seeds = np.array([-5, 2**63 - 1, 7])
    plant = DropOut(Noisy(RigidBodyPlant(ARM), 1e-4), 0.2)
    loop = prepared((plant, gpi(), MOVE), backend)
    run = loop.run({"plant.noise.position": np.full(ROWS, 1e-4)}, seed=seeds)
    one = loop.run(seed=7)
    np.testing.assert_array_equal(run["q_measured"].isel(rollout=2), one["q_measured"])
    counted = loop.run({"plant.noise.position": np.full(ROWS, 1e-4)}, seed=5)
    named = loop.run({"plant.noise.position": np.full(ROWS, 1e-4)}, seed=np.arange(5, 8))
    assert_same(counted, named)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("case", ["rest", "moves", "cut", "diverges", "single"])
def test_metrics_without_trajectories_are_those_of_a_full_recording(case: str, backend: str) -> None:
    plant: Plant = Encoder(RigidBodyPlant(ARM, friction=Friction(0.0, 0.2)), 12)
    controller: Any = gpi(FixedGains(20.0 + OWN))
    reference, divergence, values = MOVE, 10.0, {"plant.payload.mass": EACH}
    if case == "moves":
        reference = Bezier(MOVE.start, MOVE.goal, 1.0)
    elif case == "cut":
        plant, controller = Saturated(plant, 2.5), gpi(effort=2.5)
    elif case == "diverges":
        divergence = 0.05
    elif case == "single":
        controller, values = gpi(), {}
    parts = (plant, controller, reference)
    options = {"divergence": divergence, "backend": backend}
    full = prepare(*parts, 0.5, **options).run(values)
    short = prepare(*parts, 0.5, record="metrics", **options).run(values, final=True)
    expected = armgpi.metrics.summary(full)
    assert set(expected.data_vars) <= set(short.data_vars)
    for name in expected.data_vars:
        # Kinematics are worked out here by generated code and there by NumPy, and round otherwise.
        rounding = 1e-11 if armgpi.metrics.ALL[str(name)].group == "tool" else 0.0
        np.testing.assert_allclose(short[name], expected[name], rtol=rounding, err_msg=str(name))
    for name in ("status", "t_end"):
        np.testing.assert_array_equal(short[name], full[name])
    running = full["status"] == armgpi.Status.FINISHED
    np.testing.assert_array_equal(short["q_end"], full["q"].isel(time=-1).where(running))
    assert (case == "diverges") == bool((full["status"] == armgpi.Status.DIVERGED).any())


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_faults_without_trajectories_are_those_of_a_full_recording(backend: str) -> None:
    plant = Saturated(RigidBodyPlant(ARM, loads=[Step(np.array([0.0, 1.0, 0.0]), 0.1)]))
    supervisor, options = Supervisor(following=0.1), {"backend": backend, "divergence": 3.0}
    values = {
        "plant.loads.0.amplitude": np.array([0.0, 0.3, 30.0]),
        "supervisor.following": np.array([0.4, 0.05, 0.3]),
    }
    loops = {
        record: prepare(plant, gpi(), MOVE, 0.5, supervisor=supervisor, record=record, **options)
        for record in ("all", "metrics")
    }
    full, short = (loop.run(values) for loop in loops.values())
    assert sorted(full["status"].values) == sorted([Status.FINISHED, Status.STOPPED, Status.DIVERGED])
    for name in ("status", "t_end", "fault", "fault_joint"):
        np.testing.assert_array_equal(short[name], full[name], err_msg=name)
    # Of one that diverged nobody counted on.
    expected = full["t_fault"].where(full["status"] != Status.DIVERGED)
    np.testing.assert_array_equal(short["t_fault"], expected)
    # Each as a loop with its own bound.
    for i, most in enumerate(values["supervisor.following"]):
        own = RigidBodyPlant(ARM, loads=[Step(values["plant.loads.0.amplitude"][i], 0.1)])
        alone = simulate(
            Saturated(own),
            gpi(),
            MOVE,
            0.5,
            supervisor=Supervisor(following=float(most)),
            progress=False,
            **options,
        )
        assert int(alone["fault"]) == int(full["fault"][i])
        np.testing.assert_equal(float(alone["t_fault"]), float(full["t_fault"][i]))


def test_metrics_keep_nothing_that_grows_with_time() -> None:
    run = prepare(*ARMS, 1000.0, record="metrics", backend="compiled").run()
    assert "time" not in run.dims
    assert run.nbytes < 3000


def test_a_prepared_loop_can_be_pickled() -> None:
    parts, values, _ = BY_ROLLOUT["payload"]
    loop = prepared(parts, "compiled", record="metrics")
    expected = loop.run(values)
    assert_same(pickle.loads(pickle.dumps(loop)).run(values), expected)
    plant = RigidBodyPlant(ARM.varied(payload=EACH))
    again = prepared((pickle.loads(pickle.dumps(plant)), gpi(), MOVE), "numpy").run()
    assert_same(prepared((plant, gpi(), MOVE), "numpy").run(), again)


@with_parameters
class Biased(Wrapper):
    """A sensor of a user with a constructor of its own."""

    def __init__(self, plant: Plant, bias: float) -> None:
        object.__setattr__(self, "plant", plant)
        Wrapper.__post_init__(self)
        object.__setattr__(self, "bias", bias)


REFUSALS: dict[str, tuple[dict[str, Any], type[ArmgpiError], str]] = {
    "a name that is not there": ({"plant.dely": 1}, NameNotFound, "dely"),
    "what decides the code": ({"controller.integrators": 1}, ParameterError, "form of the generated code"),
    "other numbers of rollouts": (
        {"plant.payload.mass": EACH, "controller.omega": 20.0 + OWN[:2]},
        ArrayError,
        "3 rollouts",
    ),
    "another shape": ({"plant.payload.mass": np.ones((2, 2))}, ArrayError, "plant.payload.mass"),
    "beyond a bound": ({"plant.payload.mass": -EACH}, ArrayError, "payload"),
    "a gain below its bound": ({"controller.omega": -EACH}, ArrayError, "omega_c"),
    "no number": ({"controller.omega": ["a"]}, ArrayError, "controller.omega"),
    "NaN": ({"plant.payload.mass": np.array([np.nan])}, ArrayError, "finite"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_values_are_refused_by_name(case: str) -> None:
    values, kind, said = REFUSALS[case]
    with pytest.raises(kind, match=said):
        prepared(ARMS, "numpy").run(values)


def test_a_robot_for_each_rollout_cannot_vary_as_well() -> None:
    plant = RigidBodyPlant(RobotBatch([ARM, ARM.scaled_inertia(1.1)]))
    with pytest.raises(ParameterError, match="another robot"):
        prepared((plant, gpi(), MOVE), "numpy").run({"plant.payload.mass": [0.1, 0.2]})


VARIATIONS: dict[str, dict[str, Any]] = {
    "payload": {"payload": EACH, "com": 0.1 * OWN},
    "scale": {"inertia_scale": 0.5 + EACH},
    "all": {
        "payload": EACH,
        "inertia_scale": 0.5 + EACH,
        "rotor_inertia": OWN,
        "gravity": OWN - [0.0, 0.0, 9.0],
    },
}


@pytest.mark.parametrize("name", VARIATIONS)
@pytest.mark.parametrize("robot", [ARM, ARM.scaled_inertia(0.8), swing()])
def test_varied_robots_are_those_built_one_by_one(robot: Robot, name: str) -> None:
    # Each of the robots is edited through Pinocchio's own sums of inertias.
    given = {
        key: value if np.ndim(value) == 1 or key in ("com", "gravity") else value[:, : robot.n]
        for key, value in VARIATIONS[name].items()
    }
    varied = robot.varied(**given)
    built = RobotBatch(varied.robots)
    q, v, x = np.random.default_rng(0).normal(size=(3, ROWS, robot.n))
    for method, arguments in (
        ("forward_dynamics", (q, v, x)),
        ("inverse_dynamics", (q, v, x)),
        ("inertia_times", (q, x)),
        ("inertia_solve", (q, x)),
        ("mass_matrix", (q,)),
        ("gravity", (q,)),
    ):
        expected = getattr(built, method)(*arguments)
        ours = getattr(varied, method)(*arguments)
        np.testing.assert_allclose(ours, expected, rtol=1e-11, atol=1e-12, err_msg=method)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("kind", ["rigid", "elastic"])
def test_a_batch_of_varied_robots_makes_no_robot_for_each_rollout(
    kind: str, backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A robot takes a quarter of a millisecond, a hundred times the start of a rollout.
    wall = Wall(normal=[0.0, 0.0, 1.0], distance=0.0, stiffness=100.0)
    rotors = np.full(3, 0.05)
    plant = {
        "rigid": lambda: RigidBodyPlant(ARM, environment=[wall]),
        "elastic": lambda: ElasticPlant(ARM.with_armature(rotors), gear_stiffness=500.0, environment=[wall]),
    }[kind]()
    loop = prepare(plant, gpi(), MOVE, 0.02, record="metrics", backend=backend)
    made: list[int] = []
    single = VariedRobots._robot

    def counted(robots: VariedRobots, i: int) -> Any:
        made.append(i)
        return single(robots, i)

    monkeypatch.setattr(VariedRobots, "_robot", counted)
    loop.run({"plant.payload.mass": np.linspace(0.1, 0.2, 50)})
    assert set(made) <= {0}


@pytest.mark.parametrize(
    ("given", "kind", "said"),
    [
        ({}, ParameterError, "at least one"),
        ({"com": OWN}, ParameterError, "payload"),
        ({"payload": EACH, "frame": "nowhere"}, NameNotFound, "nowhere"),
        ({"payload": EACH, "frame": "base_link"}, (ParameterError, NameNotFound), "base_link"),
        ({"payload": -EACH}, ArrayError, "zero or positive"),
        ({"payload": EACH, "inertia_scale": [1.0, 2.0]}, ArrayError, "inertia_scale"),
        ({"payload": OWN}, ArrayError, "payload"),
        ({"rotor_inertia": np.ones((3, 2))}, ArrayError, "rotor_inertia"),
    ],
)
def test_bad_variations_are_refused(given: dict[str, Any], kind: Any, said: str) -> None:
    with pytest.raises(kind, match=said):
        ARM.varied(**given)


def test_results_of_runs_are_apart() -> None:
    loop = prepare(*ARMS, 0.05, record="metrics", backend="numpy")
    first = loop.run({"controller.omega": [10.0, 20.0]}, final=True)
    kept = first.copy(deep=True)
    first["itae"].attrs["mine"] = first.attrs["mine"] = "x"
    second = loop.run({"controller.omega": [12.0, 22.0]}, final=True)
    third = loop.run({"controller.omega": [10.0, 20.0]}, final=True)
    xr.testing.assert_identical(third, kept)
    assert not np.array_equal(second["itae"], third["itae"])
    assert loop.run({"controller.omega": [10.0] * 3}).sizes["rollout"] == 3


FORCE = ToolForce([0.0, 0.0, -1.0])


def test_what_runs_have_taken_by_numpy_is_what_a_compiler_may_take() -> None:
    loop = prepare(RigidBodyPlant(ARM), gpi(), MOVE, 0.2, backend="auto")
    state, shape = loop.loop.init(), SimpleNamespace(shape=(4, 3))

    def leaves(part: Any) -> int:
        return sum(map(leaves, part)) if isinstance(part, tuple) else 1

    once = 200 * (5e-6 * (leaves(state) - 1) + 1.2e-6 * 12)
    for runs in (1, 2, 3):
        assert loop._patience(state, shape) == pytest.approx(runs * once)
    # Friction and gears are solved for in each sample (measured: 0.4 ms a rigid UR5's, 0.8 an elastic one's).
    rubbing, gears = Friction(1.0, 1.0), {"gear_stiffness": 1e4}
    for plant, more in (
        (RigidBodyPlant(ARM, friction=rubbing), 3.5e-4),
        (ElasticPlant(ARM.with_armature(0.1), friction=rubbing, **gears), 8e-4),
        # Contacts at four evaluations of each step (measured: 11 ms for UR5, two, eight steps), or at two.
        (RigidBodyPlant(ARM, environment=[FORCE, FORCE], substeps=8), 64 * 1.8e-4 + 7 * 1.4e-5),
        (ElasticPlant(ARM.with_armature(0.1), environment=[FORCE], **gears), 1e-4 + 2 * 1.8e-4),
    ):
        other = prepare(plant, gpi(), MOVE, 0.2, backend="auto")
        own = 5e-6 * (leaves(other.loop.init()) - 1) + 1.2e-6 * 12
        assert other._patience(other.loop.init(), shape) == pytest.approx(200 * (own + more))


def test_times_are_whole_numbers_of_samples_one_at_least() -> None:
    assert [preparing.whole_steps(t, 0.25) for t in (0.25, 0.2, 0.9, 2.5e14)] == [1, 1, 4, 10**15]
    for t_final, said in ((2.5e14 + 0.25, "at most"), (0.12, "at least one")):
        with pytest.raises(ParameterError, match=said):
            preparing.whole_steps(t_final, 0.25)


@pytest.mark.parametrize("batch", [None, 2])
@pytest.mark.parametrize("apart", [False, True])
def test_a_reference_is_refused_where_it_leaves_the_limits_at_any_of_its_times(
    batch: int | None, apart: bool
) -> None:
    arm = ARM if batch is None else RobotBatch([ARM, ARM])
    goal = np.array([0.0, 0.0, 2.71]) if not apart else np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 2.71]])
    move = Bezier(0.0 * goal, goal, 1.0)
    with pytest.raises(LimitError, match=r"the reference at t = 0.82 s of joint 'q3' is 2.70") as refused:
        prepare(RigidBodyPlant(arm), GPI(ARM, 1e-3), move, 1.0, backend="numpy").run()
    assert 2.7 < refused.value.value < 2.71


def test_a_bar_is_shown_of_what_takes_long_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Any] = []
    monkeypatch.setattr("rich.progress.Progress.start", lambda bar: shown.append(bar))
    clock = iter([100.0, 102.0, 102.1])
    monkeypatch.setattr(preparing, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    with preparing._progress_bar(10, True) as advance:
        advance(1)
        assert not shown
        advance(1)
    assert len(shown) == 1


def test_factors_by_rollout_scale_the_load_as_one_factor_does() -> None:
    arm = armgpi.Robot.load("ur5").with_armature(0.5)
    loaded = arm.varied(payload=np.array([1.0, 2.0]))
    links = np.array([[0.5], [1.5]])
    q, push = np.tile(arm.middle(), (2, 1)), np.ones((2, arm.n))
    many = feedback_model(loaded, links, 1.0).dynamics.inertia_times(q, push)
    for row, factor in enumerate(links[:, 0]):
        one = feedback_model(loaded.robots[row], float(factor), 1.0)
        np.testing.assert_allclose(many[row], one.dynamics.inertia_times(q[row], push[row]), rtol=1e-12)
    for factors in ((np.ones((3, 1)), 1.0), (links, np.ones((3, 1)))):
        with pytest.raises(ArrayError, match="a row for each of 3 rollouts"):
            feedback_model(loaded, *factors)
