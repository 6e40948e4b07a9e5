"""The kernels against MuJoCo, which shares no code with Pinocchio, and against slow obvious twins.

MuJoCo gets the same URDF text without geometry, with the joints fixed that are locked here. It keeps
inertias as principal moments and a quaternion, so its D agrees to a few more eps than ours does with
itself: the worst seen over 1,500 random robots was 7e-15 of the largest element.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from strategies import Array, State, states, urdf_texts

from armgpi import Robot, robots
from armgpi.robot.dynamics import PinocchioDynamics, stack_dynamics

SAME = 1e-13
#: Arm -> joints to lock. Not finger_edu: it has an infinitely thin rod, which MuJoCo refuses.
ARMS: dict[str, Sequence[str]] = {
    "double_pendulum": (),
    "kinova": (),
    "panda": ("panda_finger_joint1", "panda_finger_joint2"),
    "so100": ("gripper",),
    "so101": ("gripper",),
    "twodof": (),
    "ur3": (),
    "ur5": (),
    "ur10": (),
    "xarm7": (),
    "z1": ("jointGripper",),
}


class MuJoCo:
    """MuJoCo's equations of motion of a URDF, its joints in the order of a robot's."""

    def __init__(self, text: str, robot: Robot, fixed: Sequence[str] = ()) -> None:
        root = ElementTree.fromstring(text)
        for joint in root.findall("joint"):
            if joint.get("name") in fixed:
                joint.set("type", "fixed")
            elif joint.get("type") == "revolute":
                joint.set("type", "continuous")  # ours has no stops in its equations of motion
        for link in root.findall("link"):
            for child in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(child)
        self.model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
        # Nor stops of prismatic joints, nor friction.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.model.dof_damping[:] = 0.0
        self.data = mujoco.MjData(self.model)
        self.order = [self.model.joint(name).dofadr[0] for name in robot.joint_names]
        assert self.model.nv == robot.n

    def at(self, q: Array, v: Array, tau: Array) -> None:
        data = self.data
        for array, values in ((data.qpos, q), (data.qvel, v), (data.qfrc_applied, tau)):
            array[self.order] = values
        mujoco.mj_forward(self.model, data)

    @property
    def acceleration(self) -> Array:
        return self.data.qacc[self.order].copy()

    @property
    def nonlinear_effects(self) -> Array:
        return self.data.qfrc_bias[self.order].copy()

    @property
    def inertia(self) -> Array:
        rows = []
        for direction in np.eye(self.model.nv):
            row = np.zeros(self.model.nv)
            mujoco.mj_mulM(self.model, self.data, row, direction)
            rows.append(row[self.order])
        return np.array(rows)[self.order]


def check_against(oracle: MuJoCo, robot: Robot, state: State) -> None:
    q, v, a = state
    tau = robot.inverse_dynamics(q, v, a)
    oracle.at(q, v, tau)
    D, bias = robot.mass_matrix(q), robot.nonlinear_effects(q, v)
    size = np.abs(D).sum() * np.abs(a).max() + np.abs(bias).max() + 9.81 * robot.total_mass
    np.testing.assert_allclose(oracle.inertia, D, rtol=0, atol=SAME * np.abs(D).max())
    np.testing.assert_allclose(oracle.nonlinear_effects, bias, rtol=0, atol=SAME * size)
    # Accelerations differ by what the smallest eigenvalue of D makes of that.
    smallest = np.linalg.eigvalsh(D)[0]
    mine = robot.forward_dynamics(q, v, tau)
    np.testing.assert_allclose(oracle.acceleration, mine, rtol=0, atol=SAME * size / smallest)


@settings(max_examples=50)
@given(urdf_texts().flatmap(lambda text: states(Robot.from_xml(text)).map(lambda s: (text, s))))
def test_every_robot_moves_as_in_mujoco(case: tuple[str, State]) -> None:
    text, state = case
    robot = Robot.from_xml(text)
    check_against(MuJoCo(text, robot), robot, state)


@pytest.mark.parametrize("name", ARMS)
def test_arms_of_example_robot_data_move_as_in_mujoco(name: str) -> None:
    text = robots.locate(name)[0].read_text(encoding="utf-8")
    robot = Robot.load(name, lock=dict.fromkeys(ARMS[name], 0.0))
    oracle = MuJoCo(text, robot, fixed=ARMS[name])
    rng = np.random.default_rng(1)
    for _ in range(20):
        q, v, a = rng.uniform(-1.0, 1.0, (3, robot.n)) * [[3.0], [2.0], [10.0]]
        check_against(oracle, robot, State(q, v, a))


# --- One robot per row ---------------------------------------------------------------------------


def three_robots() -> list[Robot]:
    robot = Robot.load("anthropomorphic3")
    return [robot, robot.scaled_inertia(0.8), robot, robot.with_payload("tool", 0.5), robot]


def test_every_row_of_a_stack_is_the_answer_of_its_own_robot() -> None:
    parts = [robot.dynamics for robot in three_robots()]
    together = stack_dynamics(parts)
    q, v, x = np.random.default_rng(2).uniform(-2.0, 2.0, (3, len(parts), 3))
    x[1] = 0.0
    for name, arguments in {
        "forward": (q, v, x),
        "inverse": (q, v, x),
        "inertia_times": (q, x),
        "inertia_solve": (q, x),
        "nonlinear_effects": (q, v),
        "gravity": (q,),
        "mass_matrix": (q,),
    }.items():
        expected = [getattr(part, name)(*rows) for part, *rows in zip(parts, *arguments, strict=True)]
        np.testing.assert_array_equal(
            getattr(together, name)(*arguments), expected, err_msg=name, strict=True
        )


def test_no_torque_solves_to_no_acceleration_exactly() -> None:
    dynamics = Robot.load("anthropomorphic3").dynamics
    rng = np.random.default_rng(3)
    q, tau = rng.uniform(-1.0, 1.0, (2, 20, 3))
    tau[::2] = 0.0
    solved = dynamics.inertia_solve(q, tau)
    assert not solved[::2].any()
    assert solved[1::2].all()
    assert not dynamics.inertia_solve(q[0], np.zeros(3)).any()


# --- The edges of the kernels --------------------------------------------------------------------


def test_what_a_kernel_returned_does_not_change_when_it_is_called_again() -> None:
    dynamics = Robot.load("anthropomorphic3").dynamics
    q, v, x = np.random.default_rng(4).uniform(-1.0, 1.0, (3, 3))
    calls = {
        "forward": (q, v, x),
        "inverse": (q, v, x),
        "inertia_times": (q, x),
        "inertia_solve": (q, x),
        "nonlinear_effects": (q, v),
        "gravity": (q,),
        "mass_matrix": (q,),
    }
    kept = {name: getattr(dynamics, name)(*arguments) for name, arguments in calls.items()}
    before = {name: result.copy() for name, result in kept.items()}
    for name, arguments in calls.items():
        getattr(dynamics, name)(*(x + 1.0 for x in arguments))
    for name, result in kept.items():
        np.testing.assert_array_equal(result, before[name], err_msg=name)


def test_kernels_take_read_only_arrays_and_leave_them_as_they_were() -> None:
    dynamics = Robot.load("anthropomorphic3").dynamics
    for shape in ((3,), (20, 3)):
        q, v, x = arrays = np.random.default_rng(5).uniform(-1.0, 1.0, (3, *shape))
        before = arrays.copy()
        arrays.setflags(write=False)
        dynamics.forward(q, v, x)
        dynamics.inverse(q, v, x)
        dynamics.inertia_solve(q, x)
        np.testing.assert_array_equal(arrays, before)


def test_a_robot_keeps_its_own_copy_of_the_masses() -> None:
    robot = Robot.load("anthropomorphic3")
    q = np.array([0.1, 0.2, 0.3])
    before = robot.mass_matrix(q)
    model = robot.pinocchio_model()
    model.inertias[3].mass = 100.0
    model.armature = np.ones(3)
    robot.with_armature(1.0), robot.with_payload("tool", 3.0), robot.scaled_inertia(2.0)
    np.testing.assert_array_equal(robot.mass_matrix(q), before)
    assert PinocchioDynamics(model).mass_matrix(q)[0, 0] > before[0, 0] + 1.0


def test_results_do_not_depend_on_the_number_of_threads() -> None:
    # In processes of their own: OpenMP reads the number once.
    code = (
        "import numpy as np, hashlib, armgpi;"
        "r = armgpi.Robot.load('anthropomorphic3');"
        "q, v, tau = np.random.default_rng(6).uniform(-1, 1, (3, 100, 3));"
        "print(hashlib.sha256(r.forward_dynamics(q, v, tau).tobytes()).hexdigest())"
    )
    digests = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "OMP_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "2", "nonsense")
    }
    assert len(digests) == 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_computes_batches_as_its_parent_does() -> None:
    """OpenMP's threads are not there after a fork: a batch in the child must not wait for them."""
    script = (
        "import os, warnings\n"
        "warnings.simplefilter('ignore')\n"
        "import numpy as np\n"
        "from armgpi import Robot\n"
        "arm = Robot.load('anthropomorphic3')\n"
        "q = np.linspace(0.0, 1.0, 600).reshape(200, 3)\n"
        "before = arm.gravity(q)\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    os._exit(0 if np.array_equal(Robot.load('anthropomorphic3').gravity(q), before) else 3)\n"
        "raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
    )
    env = {**os.environ, "OMP_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", script], env=env, timeout=200, check=False)
    assert done.returncode == 0
