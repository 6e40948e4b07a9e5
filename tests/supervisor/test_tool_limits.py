"""The tool leaves its box, is too fast, or is pushed: against Pinocchio, and in C."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armgpi
from armgpi import GPI, Measurement, RigidBodyPlant, Robot, Supervised, Supervisor, Target, config, simulate
from armgpi.config.experiment import run
from armgpi.errors import ArmgpiError
from armgpi.hardware.export.code import generate
from armgpi.hardware.export.fault_tests import fault_tests
from armgpi.supervisor import Reason, State

DT = 1e-3
#: Time constant of the supervisor's velocities [s], as docs/supervisor.md says.
SMOOTHING = 5e-3
ARM = Robot.load("anthropomorphic3")
Q = np.array([0.1, 0.4, -0.5])
REST = np.zeros(3)
#: A box and a speed that no arm leaves or reaches.
FAR: Any = {"workspace": ([-50.0] * 3, [50.0] * 3), "tool_speed": 500.0, "tool_force": 1e6}


@cache
def path(seed: int, speed: float) -> Any:
    """Positions of a smooth motion of all joints, from rest at Q on."""
    random = np.random.default_rng(seed)
    way = random.normal(size=3)
    t = DT * np.arange(1200)
    growing = 1.0 - np.exp(-((t / 0.3) ** 2))
    return Q + speed * way * (growing * t)[:, None]


def played(controller: Any, positions: Any, state: Any = None) -> tuple[int, Any]:
    """Let the arm follow exactly; return the first sample that is no RUN, and the state there."""
    targets_of = [Target(q, REST, REST) for q in positions]
    state = controller.init(Measurement(positions[0]), targets_of[0])
    for k, (q, target) in enumerate(zip(positions, targets_of, strict=True)):
        state = controller.step(Measurement(q), target, state).state
        if controller.report(state).status not in ("init", "run"):
            return k, state
    return len(positions), state


@pytest.mark.parametrize("frame", [None, "link2"])
@pytest.mark.parametrize("seed", range(6))
def test_it_stops_at_the_first_sample_outside_the_box(seed: int, frame: str | None) -> None:
    positions = path(seed, 0.3)
    frame = None if frame is None else ARM.frame_names[-3]
    name = ARM.tip if frame is None else frame
    places = np.array([ARM.frame_pose(name, q).translation for q in positions])
    # Walls on one side alone: 60 % of the way along one axis.
    axis = int(np.argmax(np.abs(places[-1] - places[0])))
    lower, upper = places[0] - 5.0, places[0] + 5.0
    wall = places[0, axis] + 0.6 * (places[-1, axis] - places[0, axis])
    (upper if places[-1, axis] > places[0, axis] else lower)[axis] = wall
    outside = ((places < lower) | (places > upper)).any(axis=1)
    controller = Supervised(GPI(ARM, DT), Supervisor(workspace=(lower, upper), tool_frame=frame))
    k, state = played(controller, positions)
    assert outside.any()
    assert k == int(np.argmax(outside))
    assert controller.report(state) == ("stopping", "workspace", None)


@pytest.mark.parametrize("seed", range(6))
def test_it_stops_at_the_first_sample_in_which_the_tool_is_too_fast(seed: int) -> None:
    positions = path(seed, 0.5)
    v, speeds = REST, []
    before = positions[0]
    for q in positions:
        # J(q) of the joints' smoothed velocities, which are those up to the last sample.
        speeds.append(np.linalg.norm(ARM.frame_jacobian(ARM.tip, q)[:3] @ v) / DT)
        v = v + DT / (DT + SMOOTHING) * (q - before - v)
        before = q
    limit = 0.6 * max(speeds)
    controller = Supervised(GPI(ARM, DT), Supervisor(tool_speed=limit))
    k, state = played(controller, positions)
    assert k == int(np.argmax(np.array(speeds) > limit))
    assert controller.report(state) == ("stopping", "tool_speed", None)
    # What was smoothed is the speed of the tool, late by no more than three time constants.
    places = np.array([ARM.frame_pose(ARM.tip, q).translation for q in positions])
    true = np.linalg.norm(np.diff(places, axis=0), axis=1) / DT
    assert true[: k - round(3 * SMOOTHING / DT)].max() < limit


def test_one_that_is_never_left_changes_no_bit() -> None:
    move = armgpi.Bezier(Q, Q + 0.3, 0.5)
    off, on = (
        simulate(RigidBodyPlant(ARM), GPI(ARM, DT), move, 0.6, supervisor=each)
        for each in (Supervisor(), Supervisor(**FAR))
    )
    for name in ("q", "tau", "supervisor"):
        np.testing.assert_array_equal(off[name], on[name])


def test_without_them_the_c_has_nothing_of_them() -> None:
    off = generate(GPI(ARM, DT)).law
    on = generate(GPI(ARM, DT), supervisor=Supervisor(**FAR)).law
    assert not [table.name for table in off.tables if "WORKSPACE" in table.name or "TOOL" in table.name]
    assert {"WORKSPACE_LOWER", "WORKSPACE_UPPER", "TOOL_SPEED_MOST", "TOOL_FORCE_MOST"} <= {
        table.name for table in on.tables
    }


@pytest.mark.parametrize(
    ("law", "given"),
    [
        (GPI, {"workspace": True}),
        (GPI, {"tool_speed": 0.2}),
        (armgpi.CartesianImpedance, {"workspace": True, "tool_speed": 0.2}),
        (GPI, {"tool_force": 0.2, "uncertain_mass": 0.01}),
    ],
)
def test_c_does_the_same(law: Any, given: Any) -> None:
    pytest.importorskip("casadi")
    positions = path(3, 0.5)
    start, end = (ARM.frame_pose(ARM.tip, q).translation for q in (positions[0], positions[-1]))
    more: Any = {} if law is GPI else {"stiffness": [200.0] * 3 + [0.0] * 3}
    if "workspace" in given:
        given = given | {"workspace": (start - 0.3 * np.abs(end - start), start + 0.3 * np.abs(end - start))}
    # Of a model with hardly any friction, which follows its path without the torque that this takes.
    arm = ARM.with_friction(np.zeros(3), 1e-3 * ARM.limits.effort) if "tool_force" in given else ARM
    mine = Supervised(law(arm, DT, **more), Supervisor(**given))
    theirs: Any = armgpi.ExportedController.of(mine)
    states: list[Any] = [
        each.init(Measurement(positions[0]), Target(positions[0], REST, REST)) for each in (mine, theirs)
    ]
    for q in positions:
        target = Target(q, REST, REST)
        steps: list[Any] = [
            each.step(Measurement(q), target, state)
            for each, state in zip((mine, theirs), states, strict=True)
        ]
        np.testing.assert_allclose(steps[0].tau, steps[1].tau, rtol=1e-9, atol=1e-9)
        states = [step.state for step in steps]
        assert mine.report(states[0]) == theirs.report(states[1])
    assert mine.report(states[0]).reason in ("workspace", *given)
    assert mine.report(states[0]).joint is None


def quasi_static(arm: Robot, q: Any, outside: Any, friction: Any, mass: float) -> Any:
    """The least that the force on six joints may be, slowly: by Pinocchio and an inverse."""
    inverse = np.linalg.inv(arm.frame_jacobian(arm.tip, q).T)[:3]
    force = inverse @ outside
    along = force / np.linalg.norm(force)
    return np.linalg.norm(force) - np.abs(along @ inverse) @ friction - mass * 9.81 * abs(along[2])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("level", [0.0, 0.02])
def test_at_rest_the_estimate_less_what_friction_may_be_is_compared(seed: int, level: float) -> None:
    # A hand that grows slowly on an arm that its motors hold exactly: the torque tells all of it.
    arm = Robot.load("ur5").with_armature(0.4)
    q = np.array([0.0, -1.2, 1.6, -1.97, -1.57, 0.0])
    along = np.random.default_rng(seed).normal(size=3)
    along = along / np.linalg.norm(along)
    coulomb, mass, limit = level * arm.limits.effort, 0.2, 15.0
    most = 1.3 * coulomb if level else 2.0 * 0.03 * arm.limits.effort
    if level:
        arm = arm.with_friction(np.zeros(6), coulomb)
    given = Supervisor(tool_force=limit, friction_within=1.3, uncertain_mass=mass)
    controller = Supervised(GPI(arm, DT), given)
    target = Target(q, np.zeros(6), np.zeros(6))
    state = controller.init(Measurement(q), target)
    held, pulled = arm.gravity(q), arm.frame_jacobian(arm.tip, q)[:3].T @ along
    first = last = 0
    for k in range(1, 20000):
        force = 0.02 * k
        # The torque that was applied is this one, whatever the controller asked for.
        watch = state.supervisor._replace(tau=held - force * pulled)
        state = controller.step(Measurement(q), target, state._replace(supervisor=watch)).state
        if not first and quasi_static(arm, q, force * pulled, most, mass) > limit:
            first = k
        if controller.report(state).status != "run":
            last = k
            break
    assert controller.report(state)[1:] == ("tool_force", None)
    # Two filters of 30 rad/s are late by a 15th of a second, in which a hand of 20 N/s hardly grows.
    assert first
    assert first + 40 < last < first + 90


def test_what_friction_explains_is_no_fault() -> None:
    friction = 0.05 * ARM.limits.effort
    arm = ARM.with_friction(np.zeros(3), friction)
    plant = RigidBodyPlant(ARM, friction=armgpi.Friction(np.zeros(3), 1.19 * friction))
    move = armgpi.Bezier(Q, Q + np.array([0.8, -0.6, 0.7]), 1.0)
    for tool_force, fault in ((1.0, Reason.NONE), (None, Reason.NONE)):
        watched = Supervisor(tool_force=tool_force)
        rollout = simulate(plant, GPI(arm, DT), move, 1.5, supervisor=watched)
        assert int(rollout["fault"]) == fault
    # The same arm without what is known of its friction.
    bold = Supervisor(tool_force=1.0, friction_within=1.0)
    weak = ARM.with_friction(np.zeros(3), 0.2 * friction)
    rollout = simulate(plant, GPI(weak, DT), move, 1.5, supervisor=bold)
    assert int(rollout["fault"]) == Reason.TOOL_FORCE


def test_of_a_batch_an_arm_without_friction_is_stopped_as_it_is_alone() -> None:
    """Beside an arm with friction, that of an arm without was taken to be known, and 0."""
    arms = [ARM, ARM.with_friction(np.zeros(3), 0.01 * ARM.limits.effort)]
    push = armgpi.ToolForce(force=[0.0, 90.0, 0.0], onset=0.05)
    given = Supervisor(tool_force=10.0)

    def stops(robot: Any) -> list[float]:
        plant = RigidBodyPlant(robot, environment=[push])
        rollout = simulate(plant, GPI(robot, DT), armgpi.Hold(Q), 0.4, supervisor=given)
        assert (rollout["fault"] == Reason.TOOL_FORCE).all()
        return np.ravel(rollout["t_fault"]).tolist()

    alone = [stops(arm)[0] for arm in arms]
    assert stops(armgpi.RobotBatch(arms)) == alone
    assert alone[0] > alone[1]  # of a model without friction more is reckoned with


def test_every_step_has_the_bits_of_any_step() -> None:
    supervised: Any = Supervised(GPI(ARM, DT), Supervisor(**(FAR | {"tool_speed": 0.4})))
    state = supervised.init(Measurement(Q), Target(Q, REST, REST))
    for q in path(3, 0.5):
        sample = Measurement(q), Target(q, REST, REST)
        step, other = (f(*sample, state) for f in (supervised.step, supervised._any_step))
        np.testing.assert_array_equal(step.tau, other.tau)
        for a, b in zip(step.state.supervisor[:17], other.state.supervisor[:17], strict=True):
            for x, y in zip(np.atleast_1d(a), np.atleast_1d(b), strict=True):
                np.testing.assert_array_equal(x, y)
        state = step.state
    assert supervised.report(state).reason == "tool_speed"


def pushed(backend: str, supervisor: Supervisor, stiffness: float = 300.0) -> Any:
    """Two springs of which a hand pushes the tool away, the second from further away."""
    push = armgpi.ToolForce(force=[0.0, 20.0, 0.0], onset=0.1)
    spring = armgpi.CartesianImpedance(ARM, DT, stiffness=[stiffness] * 3 + [0.0] * 3)
    starts = armgpi.ReferenceBatch([armgpi.Hold(Q), armgpi.Hold(Q + 0.05)])
    plant = RigidBodyPlant(ARM, environment=[push])
    return simulate(plant, spring, starts, 1.0, supervisor=supervisor, backend=backend)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_a_hand_that_pushes_a_spring_out_of_its_box_stops_it(backend: str) -> None:
    if backend == "compiled":
        pytest.importorskip("casadi")
    places = [ARM.frame_pose(ARM.tip, q).translation for q in (Q, Q + 0.05)]
    box = np.min(places, axis=0) - 0.02, np.max(places, axis=0) + 0.02
    free, stopped = (pushed(backend, Supervisor(workspace=given)) for given in (None, box))
    assert (free["status"] == armgpi.Status.FINISHED).all()
    assert (stopped["fault"] == Reason.WORKSPACE).all()
    assert (stopped["fault_joint"] == -1).all()
    tool = free["tool"].transpose("rollout", "time", ...).values
    outside = ((tool < box[0]) | (tool > box[1])).any(axis=-1)
    np.testing.assert_allclose(stopped["t_fault"], DT * np.argmax(outside, axis=1), atol=1e-12)
    assert float(stopped["supervisor"].isel(time=-1).max()) == State.HOLD
    said = armgpi.loop.rollout.describe_end(stopped)
    assert [each.partition(": ")[2] for each in said] == ["WORKSPACE"] * 2


def test_a_start_outside_is_refused_and_by_itself_a_fault_without_torque() -> None:
    place = ARM.frame_pose(ARM.tip, Q).translation
    outside = Supervisor(workspace=(place + 0.01, place + 1.0))
    with pytest.raises(ArmgpiError, match=r"workspace must be a box that contains the tool at the start"):
        simulate(RigidBodyPlant(ARM), GPI(ARM, DT), armgpi.Hold(Q), 0.1, supervisor=outside)
    mine = Supervised(GPI(ARM, DT), outside)
    for each in (mine, armgpi.ExportedController.of(mine)):
        controller: Any = each
        state = controller.init(Measurement(Q), Target(Q, REST, REST))
        assert controller.report(state) == ("fault", "workspace", None)
        tau, state = controller.step(Measurement(Q), Target(Q, REST, REST), state)
        np.testing.assert_array_equal(tau, 0.0)
    for bad in (np.nan, np.inf, 1e300):
        state = mine.init(Measurement(Q * [1.0, bad, 1.0]), Target(Q, REST, REST))
        assert mine.report(state).reason == "not_finite"


def test_of_a_batch_those_that_start_outside_are_stopped_at_once() -> None:
    places = [ARM.frame_pose(ARM.tip, q).translation for q in (Q, Q + 0.3)]
    starts = armgpi.ReferenceBatch([armgpi.Hold(Q), armgpi.Hold(Q + 0.3)])
    given = Supervisor(workspace=(places[0] - 0.05, places[0] + 0.05))
    assert (np.abs(places[1] - places[0]) > 0.05).any()
    rollout = simulate(RigidBodyPlant(ARM), GPI(ARM, DT), starts, 0.05, supervisor=given)
    assert armgpi.loop.rollout.describe_end(rollout) == ["finished", "stopped at 0 s: WORKSPACE"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"workspace": ([0.0, 0.0, 0.0], [1.0, 0.0, 1.0])}, "lowest y is below its highest"),
        ({"workspace": ([0.0, 0.0, 2.0], [1.0, 1.0, 1.0])}, "lowest z is below its highest"),
        ({"workspace": 3.0}, "two corners of three numbers"),
        ({"workspace": ([0.0, 0.0], [1.0, 1.0])}, "two corners of three numbers"),
        ({"workspace": ([0.0, 0.0, np.nan], [1.0, 1.0, 1.0])}, "finite"),
        ({"workspace": "here"}, "workspace"),
        ({"tool_speed": 0.0}, "tool_speed must be positive"),
        ({"tool_speed": -1.0}, "tool_speed must be positive"),
        ({"tool_speed": np.nan}, "tool_speed"),
        ({"tool_speed": np.ones((2, 1))}, "tool_speed"),
        ({"tool_force": 0.0}, "tool_force must be positive"),
        ({"tool_force": np.inf}, "tool_force"),
        ({"tool_force": 9.0, "friction_within": 0.9}, "friction_within must be"),
        ({"tool_force": 9.0, "uncertain_mass": -1.0}, "uncertain_mass must be"),
        ({"tool_frame": "tool"}, "none of workspace, tool_speed"),
        ({"tool_speed": 1.0, "tool_frame": "hand"}, "no frame named 'hand'"),
        ({"tool_speed": 1.0, "tool_frame": ARM.frame_names[0]}, "tool_frame must be a frame that a joint"),
    ],
)
def test_what_is_no_box_and_no_speed_is_refused(given: Any, said: str) -> None:
    with pytest.raises(ArmgpiError, match=said):
        Supervised(GPI(ARM, DT), Supervisor(**given))


FILE = """\
robot: {{name: anthropomorphic3}}
controllers: [{{type: gpi, omega: 20}}]
plant: {plant}
reference: {{points: [[0.1, 0.4, -0.5], [0.6, 0.4, -0.5]], durations: 0.5}}
supervisor: {{workspace: {box}, tool_speed: {speed}}}
t_final: 0.6
"""


def test_files_have_them(tmp_path: Path) -> None:
    place = ARM.frame_pose(ARM.tip, Q).translation

    def experiment(below: float, speed: Any, hand: float = 0.0) -> Any:
        box = [(place - below).tolist(), (place + 1.0).tolist()]
        plant = f"{{environment: [{{type: force, force: [0.0, 0.0, {hand}], onset: 0.1}}]}}"
        file = tmp_path / "box.yaml"
        file.write_text(FILE.format(box=box, speed=speed, plant=plant))
        return config.build(*config.read(file))

    for below, speed, hand, said in (
        (0.05, 50.0, 0.0, "WORKSPACE"),
        (2.0, 0.05, 0.0, "TOOL_SPEED"),
        (2.0, "50.0, tool_force: 5.0, uncertain_mass: 0.1, response: 0, following: 50", 60.0, "TOOL_FORCE"),
    ):
        built = experiment(below, speed, hand)
        rollout = run(built, next(iter(built.runs)))
        assert armgpi.loop.rollout.describe_end(rollout)[0].endswith(f": {said}")
    with pytest.raises(ArmgpiError, match=r"box\.yaml.*supervisor.*contains the tool at the start"):
        experiment(-0.01, 1.0)


def test_exports_say_and_test_them(tmp_path: Path) -> None:
    middle = ARM.frame_pose(ARM.tip, ARM.middle()).translation
    given = Supervisor(workspace=(middle - 0.1, middle + 0.1), tool_speed=0.2, tool_force=20.0)
    supervised = Supervised(GPI(ARM, DT), given)
    rows = [row.strip() for row in fault_tests(supervised)]
    for name in ("workspace", "tool_speed", "tool_force"):
        (row,) = (each for each in rows if each.startswith(f'{{"{name}"'))
        assert row.rstrip(",}").endswith("NULL"), row
    armgpi.export_controller(supervised, tmp_path, measure=False)
    text = (tmp_path / "README.md").read_text()
    assert "`WORKSPACE` is reported when the tool" in text
    assert "was faster than 0.2 m/s" in text
    assert "was above 20 N by more than joint friction may be, which at rest is up to 14 N" in text


def test_directions_along_which_the_joints_feel_no_force_are_warned_of() -> None:
    """The tool of one joint moves along one direction in each configuration."""
    arm = Robot.load("anthropomorphic3", lock=dict.fromkeys(ARM.joint_names[1:], 0.3))
    with pytest.warns(armgpi.errors.ArmgpiWarning, match="along 1 of 3 directions"):
        Supervised(GPI(arm, DT), Supervisor(tool_force=10.0, tool_frame=ARM.tip))
