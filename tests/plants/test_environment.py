"""What the tool touches: closed forms on a rail, Pinocchio's external forces, MuJoCo's own contact."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest
from machines import sled

import armgpi
from armgpi import ElasticPlant, Friction, Hold, RigidBodyPlant, Robot, Spring, ToolForce, Wall
from armgpi.control.pid_positions import PIDPositions
from armgpi.errors import ArmgpiError, NameNotFound, ParameterError
from armgpi.plants.environment import Contact, Wrench
from armgpi.plants.plant import PlantState
from armgpi.robot.frame_motion import FrameMotion, Motion

Array = npt.NDArray[np.float64]
DT = 1e-3


def run(
    plant: Any, samples: int, q: float = 0.0, v: float = 0.0, force: float = 0.0, dt: float = DT
) -> Array:
    """Return position and velocity of a single joint, (samples, 2)."""
    state = plant.init(np.array([q]), np.array([v]))
    rows = []
    for _ in range(samples):
        state = plant.step(np.array([force]), state, DT)
        rows.append([state.q[0], state.v[0]])
    return np.array(rows)


def test_a_mass_on_a_spring_swings_as_the_closed_form() -> None:
    mass, stiffness = 2.0, 800.0
    plant = RigidBodyPlant(sled(mass), environment=[Spring(anchor=[0.1, 0.0, 0.0], stiffness=stiffness)])
    omega = math.sqrt(stiffness / mass)
    times = DT * np.arange(1, 501)
    found = run(plant, 500)[:, 0]
    # Runge-Kutta of order 4: (omega dt)^5 / 120 a step.
    np.testing.assert_allclose(found, 0.1 * (1.0 - np.cos(omega * times)), atol=1e-7)


def test_a_damped_spring_swings_as_the_closed_form() -> None:
    mass, stiffness, damping = 1.0, 400.0, 8.0
    plant = RigidBodyPlant(
        sled(mass), environment=[Spring(anchor=[0.1, 0.0, 0.0], stiffness=stiffness, damping=damping)]
    )
    decay = damping / (2.0 * mass)
    omega = math.sqrt(stiffness / mass - decay**2)
    t = DT * np.arange(1, 501)
    expected = 0.1 * (1.0 - np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t)))
    np.testing.assert_allclose(run(plant, 500)[:, 0], expected, atol=1e-7)


class Shaking(Contact):
    """A force along x that swings [N] at some frequency [rad/s]."""

    force: ClassVar[float] = 3.0
    omega: ClassVar[float] = 40.0

    def wrench(self, motion: Motion, t: Array) -> Wrench:
        """Return the force at a time."""
        now = t + 0.0 * motion.position[..., 0:1]
        along = np.array([1.0, 0.0, 0.0])
        return Wrench(self.force * np.cos(self.omega * now) * along, 0.0 * now * along)


@pytest.mark.parametrize("substeps", [1, 3])
def test_a_force_that_changes_acts_at_the_time_of_every_stage(substeps: int) -> None:
    mass = 2.0
    plant = RigidBodyPlant(sled(mass), environment=[Shaking()], substeps=substeps)
    times = DT * np.arange(1, 301)
    expected = Shaking.force / mass / Shaking.omega**2 * (1.0 - np.cos(Shaking.omega * times))
    # Simpson's rule: (omega dt)^5 / 2880 a step; a stage at the time of another has omega dt / 2.
    np.testing.assert_allclose(run(plant, 300)[:, 0], expected, atol=1e-9)


def test_what_presses_on_a_wall_rests_where_force_and_stiffness_balance() -> None:
    wall = Wall(normal=[-2.0, 0.0, 0.0], distance=-0.05, stiffness=1e4, damping=200.0)
    plant = RigidBodyPlant(sled(1.0), environment=[wall])
    end = run(plant, 3000, force=30.0)[-1]
    assert end == pytest.approx([0.05 + 30.0 / 1e4, 0.0], abs=1e-9)


def test_a_wall_without_damping_gives_back_all_of_the_energy() -> None:
    plant = RigidBodyPlant(
        sled(1.0), environment=[Wall(normal=[-1.0, 0.0, 0.0], distance=-0.05, stiffness=1e4)]
    )
    away = run(plant, 1000, v=0.4)[-1, 1]
    # The force begins and ends between two steps: order 2 in there.
    assert away == pytest.approx(-0.4, rel=2e-3)


def test_a_wall_with_damping_never_pulls() -> None:
    wall = Wall(normal=[-1.0, 0.0, 0.0], distance=-0.05, stiffness=1e3, damping=1e3)
    motion = run(RigidBodyPlant(sled(1.0), environment=[wall]), 3000, v=0.4)
    slowed = np.diff(motion[:, 1])
    assert (slowed <= 1e-12).all()  # pushed away from the wall alone
    assert motion[-1, 1] < 0.0


@pytest.mark.parametrize("along", [[0.3, 0.0, 0.0], [0.0, 0.2, 0.0], [-0.1, 0.4, 0.0], [0.0, 0.5, -0.2]])
def test_the_friction_of_a_surface_is_a_share_of_its_force_against_any_way_it_is_slid(
    along: list[float],
) -> None:
    floor = Wall(normal=[0.0, 0.0, 1.0], distance=0.2, stiffness=50.0, friction=0.3)
    motion = Motion(np.eye(3), np.array([0.4, 0.1, 0.15]), np.array(along), np.zeros(3), ())
    force = floor.wrench(motion, np.zeros(())).force
    sliding = np.array([*along[:2], 0.0])
    np.testing.assert_allclose(
        force[:2], -0.3 * force[2] * (sliding / np.linalg.norm(sliding))[:2], rtol=2e-3
    )


def test_the_friction_of_a_surface_brakes_what_slides_on_it() -> None:
    # A sled along x that a floor of normal z carries: pressed by its depth, 0.2 m times 50 N/m.
    floor = Wall(normal=[0.0, 0.0, 1.0], distance=0.2, stiffness=50.0, friction=0.3)
    motion = run_inside(floor, v=1.0, samples=100)
    # mu N = 3 N on 1 kg; smoothed below 1 mm/s.
    assert motion[-1, 1] == pytest.approx(1.0 - 3.0 * 0.1, rel=1e-5)


def run_inside(wall: Wall, v: float, samples: int) -> Array:
    """Return the motion of a sled that starts inside of a wall, which a user's plant refuses."""
    plant = RigidBodyPlant(sled(1.0), environment=[wall])
    state = PlantState(0, np.zeros(1), np.array([v]), np.zeros(1))
    rows = []
    for _ in range(samples):
        state = plant.step(np.zeros(1), state, DT)
        rows.append([state.q[0], state.v[0]])
    return np.array(rows)


def test_a_force_acts_as_pinocchios_external_force_from_its_onset_to_its_end() -> None:
    robot = Robot.load("ur5")
    random = np.random.default_rng(5)
    q, v, tau = random.normal(size=(3, robot.n))
    force, moment = random.normal(size=(2, 3)) * 20.0
    tool = ToolForce(force, moment, onset=0.2, end=0.3, frame="tool0")
    plant = RigidBodyPlant(robot, environment=[tool])
    model = robot.pinocchio_model()
    data = model.createData()
    frame = model.getFrameId("tool0")
    pin.framesForwardKinematics(model, data, q)
    # In the axes of the joint's body, as Pinocchio takes it.
    joint = model.frames[frame].parentJoint
    world = pin.Force(force, moment + np.cross(data.oMf[frame].translation, force))
    external = pin.StdVec_Force()
    for i in range(model.njoints):
        external.append(data.oMi[i].actInv(world) if i == joint else pin.Force.Zero())
    pushed = pin.aba(model, data, q, v, tau, external)
    for t, expected in ((0.1, robot.forward_dynamics(q, v, tau)), (0.25, pushed)):
        torque = plant.contact_torque(q, v, round(t / DT), 0.0, DT)
        np.testing.assert_allclose(robot.forward_dynamics(q, v, tau + torque), expected, rtol=1e-9, atol=1e-9)
    assert not plant.contact_torque(q, v, 300, 0.0, DT).any()


def test_links_behind_elastic_joints_feel_it_and_motors_do_not() -> None:
    # At rest: K (theta - q) = -F of the spring, whatever the motor holds.
    robot = sled(1.0).with_armature(0.5)
    spring = Spring(anchor=[0.2, 0.0, 0.0], stiffness=500.0, damping=40.0)
    plant = ElasticPlant(robot, environment=[spring], gear_stiffness=2000.0, gear_damping=20.0)
    state = plant.init(np.zeros(1), np.zeros(1))
    for _ in range(20_000):
        # A stiff hold of the motor by a damped spring.
        state = plant.step(-3000.0 * state.theta - 60.0 * state.omega, state, DT)
    pull = 500.0 * (0.2 - state.q)
    assert 2000.0 * (state.q - state.theta) == pytest.approx(pull, rel=1e-6)
    assert 3000.0 * state.theta == pytest.approx(pull, rel=1e-6)


def pressed(plant: Any, robot: Robot, depth: float) -> float:
    """Return the height [m] of UR5's tool after pressing straight down onto a floor."""
    start = np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.0])
    tool = robot.frame_pose("tool0", start)
    below = armgpi.inverse_kinematics(
        robot, "tool0", tool.translation - [0.0, 0.0, depth], tool.rotation, near=start
    )
    assert below.reached
    law = PIDPositions(robot, DT)
    rollout = armgpi.simulate(plant, law, armgpi.Bezier(start, below.q, 1.0), 2.0, backend="auto")
    assert int(rollout["status"]) == armgpi.Status.FINISHED
    return float(robot.frame_pose("tool0", rollout["q"].values[-1]).translation[2])


def test_all_plants_press_alike() -> None:
    robot = Robot.load("ur5").with_armature(0.5)
    start = np.array([0.0, -1.2, 1.5, -1.87, -1.57, 0.0])
    height = float(robot.frame_pose("tool0", start).translation[2])
    floor = Wall(normal=[0.0, 0.0, 1.0], distance=height - 0.03, stiffness=5e3, damping=100.0, frame="tool0")
    depths = {}
    for kind, plant in {
        "rigid": RigidBodyPlant(robot, environment=[floor]),
        "elastic": ElasticPlant(robot, environment=[floor], gear_stiffness=1e6, encoder_side="link"),
        "mujoco": armgpi.MuJoCoPlant(robot, environment=[floor]),
    }.items():
        depths[kind] = floor.distance - pressed(plant, robot, 0.05)
    assert depths["rigid"] > 0.002
    # A load held over a substep in MuJoCo, and springs of 1e6 N m/rad between.
    assert depths["mujoco"] == pytest.approx(depths["rigid"], rel=0.01)
    assert depths["elastic"] == pytest.approx(depths["rigid"], rel=0.02)


def test_mujocos_own_contact_carries_the_same_force() -> None:
    """A ball on a slide pressed onto a plane: MuJoCo's contact as a spring and damper of the same numbers."""
    mujoco = pytest.importorskip("mujoco")
    stiffness, damping, weight = 5e3, 100.0, 40.0
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="1e-4" gravity="0 0 0"/><worldbody>
        <geom type="plane" size="1 1 1" solref="-{stiffness} -{damping}" solimp="1 1 .001 .5 2"/>
        <body pos="0 0 .02"><joint type="slide" axis="0 0 1"/>
        <geom type="sphere" size=".01" mass="1" solref="-{stiffness} -{damping}" solimp="1 1 .001 .5 2"/>
        </body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = -weight
    mujoco.mj_step(model, data, 30_000)
    force = np.zeros(6)
    mujoco.mj_contactForce(model, data, 0, force)
    floor = Wall(normal=[0.0, 0.0, 1.0], distance=-0.01, stiffness=stiffness, damping=damping)
    rail = sled(1.0, axis="0 0 1").with_gravity([0.0, 0.0, 0.0])
    end = run(RigidBodyPlant(rail, environment=[floor]), 3000, force=-weight)[-1]
    ours = stiffness * (floor.distance - end[0])
    assert ours == pytest.approx(weight, rel=1e-6)
    assert force[0] == pytest.approx(ours, rel=0.05)


def test_a_batch_has_walls_of_its_own() -> None:
    robot = sled(1.0)
    stiffness = np.array([[1e3], [1e4], [1e5]])
    floor = Wall(normal=[-1.0, 0.0, 0.0], distance=-0.05, stiffness=stiffness, damping=100.0)
    plant = RigidBodyPlant(robot, environment=[floor])
    state = plant.init(np.zeros((3, 1)), np.zeros((3, 1)))
    for _ in range(4000):
        state = plant.step(np.full((3, 1), 20.0), state, DT)
    np.testing.assert_allclose(state.q - 0.05, 20.0 / stiffness, rtol=1e-6)


@pytest.mark.parametrize("kind", ["rigid", "rigid with friction", "elastic"])
def test_generated_code_touches_what_numpy_touches(kind: str) -> None:
    robot = Robot.load("anthropomorphic3").with_armature(0.1)
    q = np.array([0.3, 0.5, -0.7])
    tip = robot.frame_pose(robot.tip, q).translation
    contacts = [
        Wall(
            normal=[0.1, 0.2, 1.0],
            distance=float(tip @ [0.1, 0.2, 1.0]) / math.sqrt(1.05) - 0.01,
            friction=0.3,
        ),
        Spring(anchor=tip + 0.1, stiffness=200.0, damping=5.0),
        ToolForce([5.0, -3.0, 2.0], [0.1, 0.2, 0.3], onset=0.05, end=0.2),
    ]
    friction = Friction(0.1, 0.05) if kind != "rigid" else None
    plant: Any = RigidBodyPlant(robot, (), friction, environment=contacts)
    if kind == "elastic":
        plant = ElasticPlant(robot, (), friction, environment=contacts, gear_stiffness=5e3)
    law = armgpi.GPI(robot, DT, gains=armgpi.FixedGains(15.0, 1.0, 15.0))
    reference = armgpi.Bezier(q, q + np.array([0.2, -0.3, 0.1]), 0.2)
    loops = {
        backend: armgpi.simulate(plant, law, reference, 0.3, backend=backend)
        for backend in ("numpy", "compiled")
    }
    for name in ("q", "v", "tau"):
        ours, theirs = loops["compiled"][name].values, loops["numpy"][name].values
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max())


def test_numbers_of_contacts_vary_in_a_prepared_loop() -> None:
    robot = sled(1.0)
    floor = Wall(normal=[-1.0, 0.0, 0.0], distance=-0.05, stiffness=1e4, damping=300.0)
    plant = RigidBodyPlant(robot, environment=[floor])
    law = armgpi.GPI(robot, DT, gains=armgpi.FixedGains(10.0, 1.0, 10.0))
    loop = armgpi.prepare(plant, law, Hold([0.0]), 0.5, backend="numpy")
    name = "plant.environment.0.stiffness"
    found = loop.run({name: np.array([1e3, 1e4])})
    assert found.sizes["rollout"] == 2


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Wall(normal=[0.0, 0.0, 0.0], distance=0.1), "normal"),
        (lambda: Wall(normal=[0.0, 0.0, 1.0], distance=0.1, stiffness=0.0), "stiffness"),
        (lambda: ToolForce([1.0, 0.0, 0.0], onset=2.0, end=1.0), "end"),
        (lambda: RigidBodyPlant(sled(), environment=[1.0]), "environment"),
        (lambda: RigidBodyPlant(sled(), environment=[Spring(anchor=[0.0, 0.0, 0.0], frame="nose")]), "nose"),
    ],
)
def test_bad_input_is_named(make: Any, said: str) -> None:
    with pytest.raises(ArmgpiError, match=said):
        make()


def test_an_arm_that_starts_inside_of_a_wall_is_refused_with_the_depth() -> None:
    wall = Wall(normal=[-1.0, 0.0, 0.0], distance=-0.05)
    plant = RigidBodyPlant(sled(), environment=[wall])
    with pytest.raises(ParameterError, match=r"environment.0.distance.*0\.25 m behind"):
        plant.init(np.array([0.3]), np.zeros(1))
    with pytest.raises(NameNotFound):
        RigidBodyPlant(sled(), environment=[Wall(normal=[1.0, 0.0, 0.0], distance=0.0, frame="x9")])


@pytest.mark.parametrize("name", ["anthropomorphic3", "ur5", "panda"])
def test_no_point_moves_farther_than_its_lever_bounds(name: str) -> None:
    """What generated code leaves out where a wall is far rests on this."""
    if name not in armgpi.robots.names():
        pytest.skip("the robots extra is not installed")
    fingers = ["panda_finger_joint1", "panda_finger_joint2"] if name == "panda" else ()
    arm = armgpi.Robot.load(name, lock=fingers)
    points = FrameMotion(arm, arm.tip, np.array([0.1, -0.2, 0.05]))
    bounds = points.lever_bounds()
    assert bounds is not None
    random = np.random.default_rng(0)
    q = random.uniform(-3.0, 3.0, (500, arm.n))
    way = random.normal(scale=0.5, size=(500, arm.n))
    moved = np.linalg.norm(points.pose(q + way).position - points.pose(q).position, axis=-1)
    assert (moved <= np.abs(way) @ bounds + 1e-12).all()


@pytest.mark.parametrize("substeps", [1, 3])
def test_a_compiled_batch_touches_as_numpy_does(substeps: int) -> None:
    """Some rollouts of a lane touch one wall or two, beside a spring and a push; others nothing."""
    pytest.importorskip("casadi", reason="casadi writes the C")
    arm = armgpi.Robot.load("anthropomorphic3")
    start = np.array([0.1, 0.4, -0.4])
    here = arm.frame_pose(arm.tip, start).translation
    environment = (
        armgpi.Wall([0, 0, 1], float(here[2]) - 0.03, 5e3, damping=50.0, friction=0.3),
        armgpi.Wall([0, -1, 0.2], float(np.array([0, -1, 0.2]) @ here / np.sqrt(1.04)) - 0.05, 2e4),
        armgpi.Spring(here + 0.1, 50.0, damping=2.0),
        armgpi.ToolForce([0.0, 5.0, 0.0], onset=0.1, end=0.2),
    )
    plant = armgpi.RigidBodyPlant(arm, substeps=substeps, environment=environment)
    ends = [start + shift for shift in np.linspace(-0.3, 0.3, 11)[:, None] * np.array([[1.0, 1.0, 0.5]])]
    moves = armgpi.ReferenceBatch([armgpi.Bezier(start, end, 0.3) for end in ends])
    law = armgpi.GPI(arm, 1e-3, armgpi.FixedGains(30.0))
    runs = [armgpi.simulate(plant, law, moves, 0.4, backend=backend) for backend in ("numpy", "compiled")]
    force = np.linalg.norm(runs[0]["contact_force"], axis=-1)
    assert 0 < (force[..., 0].max(axis=-1) > 1.0).sum() < 11
    for name in ("q", "v", "contact_force"):
        np.testing.assert_allclose(runs[1][name], runs[0][name], rtol=1e-7, atol=1e-8)
