"""The second simulator against the first: they share no code, so what they agree on is the arm."""

from __future__ import annotations

import pickle
import sys
import warnings
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from machines import sled, swing

from armgpi import (
    GPI,
    ArmgpiError,
    ArmgpiWarning,
    Bezier,
    Friction,
    Hold,
    MuJoCoPlant,
    RigidBodyPlant,
    Robot,
    RobotBatch,
    Sine,
    config,
    prepare,
    robots,
    simulate,
)
from armgpi.config import experiment as experiments
from armgpi.errors import MissingPackage, ParameterError, UrdfError
from armgpi.health import zoo
from armgpi.loop.provenance import Provenance
from armgpi.plants.mujoco import _round

ARM = Robot.load("anthropomorphic3")
#: Two integrators of order 4 with the same stages, with ideal sensors: only rounding is left [rad].
SAME = 1e-12


def closed_loop(plant: Any, robot: Robot, seconds: float = 0.5, **options: Any) -> Any:
    """Return a rollout of a move of 0.3 rad under default gains."""
    start = robot.middle()
    move = Bezier(start, start + 0.3, duration=0.4)
    return simulate(plant, GPI(robot, 1e-3), move, seconds, progress=False, **options)


def apart(robot: Robot, nominal: Robot | None = None) -> float:
    """Return by how much the positions of the two simulators differ [rad]."""
    nominal = nominal or robot
    first, second = (closed_loop(kind(robot), nominal) for kind in (RigidBodyPlant, MuJoCoPlant))
    return float(np.abs(first.q - second.q).max())


@pytest.mark.parametrize("name", ["anthropomorphic3", "finger_edu", "panda", "so101", "ur5", "xarm7"])
def test_closed_loops_go_the_same_way(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)
        robot = Robot.load(name, lock=zoo.fingers(name))
    assert apart(robot.with_limits(effort=np.maximum(robot.limits.effort, 500.0))) <= SAME


@pytest.mark.search
@pytest.mark.parametrize("name", robots.names())
def test_closed_loops_go_the_same_way_on_every_arm(name: str) -> None:
    test_closed_loops_go_the_same_way(name)


def test_what_no_rigid_body_has_is_told() -> None:
    # Link 2 of the paper's arm: A + B < C.
    (said,) = MuJoCoPlant(ARM).differences
    assert "q2" in said
    assert not MuJoCoPlant(Robot.load("ur5")).differences


@pytest.mark.parametrize(
    "changed",
    [
        ARM.with_payload("tool", 0.3),
        ARM.with_payload("tool", 0.3, (0.1, 0.0, 0.05), np.diag([1e-3, 2e-3, 1e-2])),  # A + B < C again
        ARM.with_payload("q3", 0.1),  # named by the joint that carries the link
        ARM.scaled_inertia(1.3).with_payload("tool", 0.2).scaled_inertia(0.9),
        ARM.with_armature([0.1, 0.2, 0.05]),
        ARM.with_drives({"q2": {"rotor_inertia": 0.2, "stiffness": 1e4}}),  # of which it takes the rotor
        ARM.with_gravity((1.0, 2.0, -5.0)),
    ],
)
def test_changes_of_the_robot_reach_it(changed: Robot) -> None:
    assert apart(changed, nominal=ARM) <= SAME


def test_locked_joints_are_fixed_where_they_are_locked() -> None:
    assert apart(Robot.load("anthropomorphic3", lock={"q2": 0.7})) <= SAME


def test_a_batch_is_the_same_arms_one_by_one() -> None:
    arms = RobotBatch([ARM, ARM.with_payload("tool", 0.3), ARM])
    loads = [Sine([0.1, 0.2, 0.1], 4.0)]
    q0 = ARM.middle() + np.array([0.0, 0.01, -0.02])[:, None]
    batch = closed_loop(MuJoCoPlant(arms, loads, substeps=2), ARM, 0.1, q0=q0)
    for row, arm in enumerate(arms.robots):
        alone = closed_loop(MuJoCoPlant(arm, loads, substeps=2), ARM, 0.1, q0=q0[row])
        np.testing.assert_array_equal(batch.q.isel(rollout=row), alone.q)


def test_a_load_is_felt_and_substeps_make_it_exact() -> None:
    load = [Sine([0.5, 0.5, 0.5], 30.0)]
    exact = closed_loop(RigidBodyPlant(ARM, load), ARM, 0.2).q
    errors = [
        float(np.abs(closed_loop(MuJoCoPlant(ARM, load, substeps=n), ARM, 0.2).q - exact).max())
        for n in (1, 2, 4)
    ]
    assert errors[0] < 1e-5
    # Its middle stands for the whole substep: order 2.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)


def test_viscous_friction_takes_a_mass_to_rest_as_it_should() -> None:
    plant = MuJoCoPlant(sled(mass=2.0, damping=3.0), friction="urdf")
    state = plant.init(np.zeros(1), np.ones(1))
    for _ in range(1000):
        state = plant.step(np.zeros(1), state, 1e-3)
    assert state.v[0] == pytest.approx(np.exp(-1.5), rel=1e-9)  # v = exp(-d / m t)


def test_coulomb_friction_holds_but_for_a_creep_which_is_told() -> None:
    plant = MuJoCoPlant(sled(mass=1.0, friction=2.0), friction="urdf")
    state = plant.init(np.zeros(1), np.zeros(1))
    for _ in range(1000):
        state = plant.step(np.array([1.0]), state, 1e-3)
    assert 0.0 < state.q[0] < 0.05  # 0.5 m without friction
    assert any("creeps" in each for each in plant.differences)


def test_strong_friction_wants_an_implicit_integrator() -> None:
    robot = sled(mass=1e-3, damping=10.0)  # explicit steps of 1 ms take no more than 2.8 N s/m
    ends = {}
    for integrator in ("rk4", "implicitfast"):
        plant = MuJoCoPlant(robot, friction="urdf", integrator=integrator)
        state = plant.init(np.zeros(1), np.ones(1))
        for _ in range(50):
            state = plant.step(np.zeros(1), state, 1e-3)
        ends[integrator] = abs(float(state.v[0]))
    assert ends["implicitfast"] < 1e-6
    assert not ends["rk4"] < 1e-6


def test_friction_may_differ_by_rollout() -> None:
    friction = Friction(np.array([[0.0], [1.0]]), np.zeros((2, 1)))
    plant = MuJoCoPlant(sled(), friction=friction)
    state = plant.init(np.zeros((2, 1)), np.ones((2, 1)))
    for _ in range(100):
        state = plant.step(np.zeros((2, 1)), state, 1e-3)
    np.testing.assert_allclose(state.v[:, 0], [1.0, np.exp(-0.1)], rtol=1e-9)


@pytest.mark.parametrize("stops", [False, True])
def test_stops_hold_a_joint_when_asked_for(stops: bool) -> None:
    robot = sled(bounds='lower="-0.1" upper="0.1"')
    plant = MuJoCoPlant(robot, stops=stops)
    state = plant.init(np.zeros(1), np.zeros(1))
    for _ in range(1000):
        state = plant.step(np.array([1.0]), state, 1e-3)
    assert (state.q[0] < 0.15) == stops


@pytest.mark.parametrize("contacts", [False, True])
def test_contacts_keep_a_falling_link_off_the_base_when_asked_for(contacts: bool, tmp_path: Path) -> None:
    box = '<collision><geometry><box size="{}"/></geometry></collision>'
    urdf = tmp_path / "hammer.urdf"
    urdf.write_text(
        f'<robot name="hammer"><link name="base">{box.format("2 2 0.1")}</link>'
        '<link name="arm"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<link name="head"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" '
        f'ixy="0" ixz="0" iyz="0"/></inertial>{box.format("0.1 0.1 0.1")}</link>'
        '<joint name="swing" type="continuous"><parent link="base"/><child link="arm"/>'
        '<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/><limit effort="9" velocity="9"/></joint>'
        '<joint name="twist" type="continuous"><parent link="arm"/><child link="head"/>'
        '<origin xyz="0.6 0 0"/><axis xyz="1 0 0"/><limit effort="9" velocity="9"/></joint></robot>'
    )
    plant = MuJoCoPlant(Robot.load(urdf), contacts=contacts)
    state = plant.init(np.zeros(2), np.zeros(2))
    lowest = 0.0
    for _ in range(1000):
        state = plant.step(np.zeros(2), state, 1e-3)
        lowest = max(lowest, float(state.q[0]))
    assert (lowest < 1.0) == contacts  # it touches at about asin(0.4 / 0.6) = 0.73 rad


def test_a_diverged_run_is_nan_and_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes MUJOCO_LOG.TXT to where one is
    for shape in ((3,), (2, 3)):
        plant = MuJoCoPlant(ARM)
        state = plant.init(np.zeros(shape), np.full(shape, 1e7))
        for _ in range(20):
            state = plant.step(np.full(shape, 1e12), state, 1e-3)
        assert np.isnan(state.q).all()
    assert not list(tmp_path.iterdir())


def test_a_step_depends_on_the_state_alone() -> None:
    plant = MuJoCoPlant(ARM, friction=Friction(np.full(3, 0.1), np.full(3, 0.1)), stops=True)
    copied = pickle.loads(pickle.dumps(plant))
    state = plant.init(np.full(3, 0.1), np.ones(3))
    first = plant.step(np.ones(3), state, 1e-3)
    for _ in range(10):
        plant.step(np.full(3, 5.0), first, 1e-3)  # elsewhere in between
    again, other = (each.step(np.ones(3), state, 1e-3) for each in (plant, copied))
    np.testing.assert_array_equal(first.q, again.q)
    np.testing.assert_array_equal(first.v, other.v)


def test_generated_code_is_refused_and_numpy_runs_instead() -> None:
    with pytest.warns(ArmgpiWarning, match="running by NumPy"):
        rollout = closed_loop(MuJoCoPlant(ARM), ARM, 0.05, backend="compiled")
    assert '"backend": "numpy"' in rollout.attrs["provenance"]


def test_both_simulators_stand_in_one_comparison() -> None:
    wanted = {"robot": {"name": "anthropomorphic3"}, "plant": {"engine": "both"}, "t_final": 0.1}
    result = experiments.compare(config.build(config.check(wanted, config.Origin("x"))), progress=False)
    assert list(result.label.values) == ["gpi (armgpi)", "gpi (mujoco)"]
    assert float(np.abs(result.q[0] - result.q[1]).max()) <= SAME
    plants = Provenance.from_rollout(result)
    assert plants.of("gpi (mujoco)").at("plant", "plant") == "MuJoCoPlant"


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        ({"integrator": "euler"}, r"plant\.integrator: .*requires engine: mujoco"),
        ({"contacts": True}, r"plant\.contacts: .*requires engine: mujoco"),
        ({"engine": "gazebo"}, r"plant\.engine"),
        ({"engine": "mujoco", "integrator": "rk5"}, r"plant\.integrator"),
    ],
)
def test_a_wrong_experiment_names_its_key(plant: dict[str, Any], message: str) -> None:
    wanted = {"robot": {"name": "anthropomorphic3"}, "plant": plant}
    with pytest.raises(ArmgpiError, match=message):
        config.build(config.check(wanted, config.Origin("x")), config.Origin("x"))


def test_bad_input_is_refused() -> None:
    with pytest.raises(ParameterError, match="integrator"):
        MuJoCoPlant(ARM, integrator="rk5")
    with pytest.raises(ParameterError, match="stops"):
        MuJoCoPlant(ARM, stops=1)
    with pytest.raises(UrdfError, match=r"mimic=\"lock\""):
        MuJoCoPlant(Robot.load("panda", mimic="follow"))
    with pytest.raises(ArmgpiError, match="URDF text"):
        MuJoCoPlant(swing(), contacts=True)  # which has no file to read shapes from


def test_without_mujoco_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingPackage, match=r"pip install mujoco"):
        MuJoCoPlant(ARM)


def test_what_cannot_vary_by_rollout_says_why() -> None:
    loop = prepare(MuJoCoPlant(ARM), GPI(ARM, 1e-3), Hold(np.zeros(3)), 0.01, backend="numpy")
    with pytest.raises(ParameterError, match="MuJoCoPlant is made for the robot that it has"):
        loop.run({"plant.payload.mass": [0.0, 0.1]})
    assert loop.run({"controller.omega": [20.0, 25.0]}).sizes["rollout"] == 2


def test_an_inertia_is_made_that_of_a_ball_where_no_rigid_body_has_it_alone() -> None:
    text = (
        '<link name="a"><inertial><mass value="2"/>'
        '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    for moments, changed in (((1.0, 2.0, 2.5), False), ((1.0, 1.0, 2.5), True), ((0.0, 1.0, 1.0), True)):
        link = fromstring(text.format(*moments))
        assert _round(link) == changed
        found = link.find("inertial/inertia")
        assert found is not None
        wanted = [sum(moments) / 3.0] * 3 if changed else [*moments]
        assert [float(found.get(key, "")) for key in ("ixx", "iyy", "izz")] == pytest.approx(wanted)
