"""Robots by name: ours and the arms of example-robot-data, checked against their makers' dimensions."""

from __future__ import annotations

import sys
import warnings
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from armgpi import Robot, robots
from armgpi.errors import NameNotFound, UrdfError

LENGTH = 1e-5  # [m] the URDFs round lengths to that


class Arm(NamedTuple):
    """What an arm is without its gripper."""

    n: int
    lock: tuple[str, ...]
    first: str
    last: str


ARMS = {
    "anthropomorphic3": Arm(3, (), "q1", "q3"),
    "double_pendulum": Arm(2, (), "joint1", "joint2"),
    "finger_edu": Arm(3, (), "finger_base_to_upper_joint", "finger_middle_to_lower_joint"),
    "kinova": Arm(6, (), "j2s6s200_joint_1", "j2s6s200_joint_6"),
    "panda": Arm(7, ("panda_finger_joint1", "panda_finger_joint2"), "panda_joint1", "panda_joint7"),
    "so100": Arm(5, ("gripper",), "shoulder_pan", "wrist_roll"),
    "so101": Arm(5, ("gripper",), "shoulder_pan", "wrist_roll"),
    "talos_left_arm": Arm(6, ("gripper_left_joint",), "arm_left_2_joint", "arm_left_7_joint"),
    "twodof": Arm(2, (), "J1", "J2"),
    "ur3": Arm(6, (), "shoulder_pan_joint", "wrist_3_joint"),
    "ur5": Arm(6, (), "shoulder_pan_joint", "wrist_3_joint"),
    "ur10": Arm(6, (), "shoulder_pan_joint", "wrist_3_joint"),
    "xarm7": Arm(7, (), "joint1", "joint7"),
    "z1": Arm(6, ("jointGripper",), "joint1", "joint6"),
    "borinot_arm": Arm(2, (), "flying_arm_2__j_bl_link1", "flying_arm_2__j_link1_link2"),
    "double_pendulum_continuous": Arm(2, (), "joint1", "joint2"),
    "double_pendulum_simple": Arm(2, (), "joint1", "joint2"),
    "hextilt_arm": Arm(5, (), "flying_arm_5__j_base_link_link_1", "flying_arm_5__j_link_4_link_5"),
    "ur3_gripper": Arm(6, (), "shoulder_pan_joint", "wrist_3_joint"),
    "ur3_limited": Arm(6, (), "shoulder_pan_joint", "wrist_3_joint"),
    "ur5_gripper": Arm(6, (), "shoulder_pan_joint", "wrist_3_joint"),
    "ur5_limited": Arm(6, (), "shoulder_pan_joint", "wrist_3_joint"),
    "ur10_limited": Arm(6, (), "shoulder_pan_joint", "wrist_3_joint"),
}
#: Arms of larger robots, whose other joints are locked by the name alone.
PARTS = {
    "alex_left_arm": Arm(7, (), "LeftShoulderPitch", "LeftGripperYaw"),
    "alex_right_arm": Arm(7, (), "RightShoulderPitch", "RightGripperYaw"),
    "anymal_kinova_arm": Arm(6, (), "j2s6s200_joint_1", "j2s6s200_joint_6"),
    "b1_z1_arm": Arm(6, (), "joint1", "joint6"),
    "baxter_left_arm": Arm(7, (), "left_s0", "left_w2"),
    "baxter_right_arm": Arm(7, (), "right_s0", "right_w2"),
    "centauro_left_arm": Arm(6, (), "j_arm1_1", "j_arm1_6"),
    "centauro_right_arm": Arm(6, (), "j_arm2_1", "j_arm2_6"),
    "g1_left_arm": Arm(7, (), "left_shoulder_pitch_joint", "left_wrist_yaw_joint"),
    "g1_right_arm": Arm(7, (), "right_shoulder_pitch_joint", "right_wrist_yaw_joint"),
    "icub_left_arm": Arm(7, (), "l_shoulder_pitch", "l_wrist_yaw"),
    "icub_right_arm": Arm(7, (), "r_shoulder_pitch", "r_wrist_yaw"),
    "pr2_left_arm": Arm(7, (), "l_shoulder_pan_joint", "l_wrist_roll_joint"),
    "pr2_right_arm": Arm(7, (), "r_shoulder_pan_joint", "r_wrist_roll_joint"),
    "romeo_left_arm": Arm(7, (), "LShoulderPitch", "LWristPitch"),
    "romeo_right_arm": Arm(7, (), "RShoulderPitch", "RWristPitch"),
    "talos_left_arm_7": Arm(7, (), "arm_left_1_joint", "arm_left_7_joint"),
    "talos_right_arm": Arm(7, (), "arm_right_1_joint", "arm_right_7_joint"),
    "tiago_arm": Arm(7, (), "arm_1_joint", "arm_7_joint"),
    "tiago_dual_left_arm": Arm(7, (), "arm_left_1_joint", "arm_left_7_joint"),
    "tiago_dual_right_arm": Arm(7, (), "arm_right_1_joint", "arm_right_7_joint"),
    "tiago_pro_left_arm": Arm(7, (), "arm_left_1_joint", "arm_left_7_joint"),
    "tiago_pro_right_arm": Arm(7, (), "arm_right_1_joint", "arm_right_7_joint"),
}


@cache
def load(name: str) -> Robot:
    """Load an arm with its gripper locked, a warning being an error; once."""
    return Robot.load(name, lock=ARMS[name].lock)


# --- The arms ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_loads_by_name_with_its_joints_in_order_its_gripper_locked_and_an_inertia(name: str) -> None:
    robot, arm = load(name), ARMS[name]
    assert (robot.n, robot.joint_names[0], robot.joint_names[-1]) == (arm.n, arm.first, arm.last)
    assert robot.name == name
    assert len(robot.joint_types) == robot.n
    assert set(robot.provenance["locked"]) == set(arm.lock)
    model = robot.pinocchio_model()
    assert model.nq == model.nv == robot.n
    lower, upper = np.maximum(robot.limits.lower, -7.0), np.minimum(robot.limits.upper, 7.0)
    q = np.random.default_rng(7).uniform(lower, upper, (50, robot.n))
    assert np.linalg.eigvalsh(robot.mass_matrix(q)).min() > 0.0
    np.testing.assert_array_equal(robot.check_position(robot.middle(), "middle"), robot.middle())


@pytest.mark.parametrize("name", PARTS)
def test_the_name_of_an_arm_of_a_larger_robot_keeps_that_arm_alone(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what follows a locked joint is locked without a word
        robot = Robot.load(name)
    arm = PARTS[name]
    assert (robot.n, robot.joint_names[0], robot.joint_names[-1]) == (arm.n, arm.first, arm.last)
    # They stand one after the other: each moves all that come after it.
    model = robot.pinocchio_model()
    assert [int(model.parents[j]) for j in range(1, robot.n + 1)] == list(range(robot.n))
    assert np.linalg.eigvalsh(robot.mass_matrix(robot.random_positions(50))).min() > 0.0


def test_a_part_may_be_locked_further_and_kept_otherwise() -> None:
    assert Robot.load("baxter_left_arm", lock={"left_w2": 0.5}).joint_names[-1] == "left_w1"
    assert Robot.load("baxter_left_arm", lock="left_w2").n == 6
    assert Robot.load("baxter_left_arm", keep=["right_s0", "head_pan"]).joint_names == (
        "head_pan",
        "right_s0",
    )


def test_an_arm_in_a_larger_robot_is_the_arm_alone() -> None:
    # B1 carries a Z1, ANYmal a Kinova: the same arm, seen from its shoulder.
    for name, alone in (("b1_z1_arm", load("z1")), ("anymal_kinova_arm", load("kinova"))):
        carried = Robot.load(name)
        q = alone.random_positions(10)
        difference = carried.mass_matrix(q) - alone.mass_matrix(q)
        assert np.abs(difference).max() < 5e-3 * np.abs(alone.mass_matrix(q)).max()


@pytest.mark.parametrize(
    ("name", "d1", "a2", "a3", "d4", "d5", "d6"),
    [  # [m] Denavit-Hartenberg parameters published by Universal Robots
        ("ur3", 0.1519, 0.24365, 0.21325, 0.11235, 0.08535, 0.0819),
        ("ur5", 0.089159, 0.425, 0.39225, 0.10915, 0.09465, 0.0823),
        ("ur10", 0.1273, 0.612, 0.5723, 0.163941, 0.1157, 0.0922),
    ],
)
def test_a_ur_is_the_one_of_its_name(
    name: str, d1: float, a2: float, a3: float, d4: float, d5: float, d6: float
) -> None:
    # Stretched out level: example-robot-data's own loader returns a UR5 for "ur3".
    flange = load(name).frame_pose("tool0", np.zeros(6)).translation
    np.testing.assert_allclose(flange, [a2 + a3, d4 + d6, d1 - d5], rtol=0, atol=LENGTH)


def test_the_panda_with_locked_fingers_is_the_seven_joint_arm_of_its_data_sheet() -> None:
    panda = load("panda")
    assert panda.tip == "panda_hand_tcp"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one finger mimics the other
        assert Robot.load("panda").tip == "panda_hand_tcp"  # a finger that moves is no part of the arm
    # [m] Franka's Denavit-Hartenberg parameters: d1, d3, d5, flange; a7.
    flange = panda.frame_pose("panda_link8", np.zeros(7)).translation
    height = 0.333 + 0.316 + 0.384 - 0.107
    np.testing.assert_allclose(flange, [0.088, 0.0, height], rtol=0, atol=LENGTH)
    np.testing.assert_array_equal(panda.limits.effort, [87.0] * 4 + [12.0] * 3)


@pytest.mark.parametrize(
    ("name", "tip"),
    [("ur5", "ee_link"), ("xarm7", "link_eef"), ("so100", "gripper"), ("z1", "gripperStator")],
)
def test_the_tip_is_the_last_link_that_the_arm_carries_before_a_locked_gripper(name: str, tip: str) -> None:
    robot = load(name)
    assert robot.tip == tip
    assert robot.frame_jacobian(tip, robot.middle())[3:, -1].any()  # the last joint turns it


def test_a_locked_finger_still_weighs() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one finger mimics the other
        whole = Robot.load("panda")
    assert whole.n == 8
    assert load("panda").total_mass == pytest.approx(whole.total_mass, rel=1e-15)


def test_the_continuous_joints_of_the_kinova_are_unbounded_angles() -> None:
    kinova = load("kinova")
    continuous = np.array([kind == "continuous" for kind in kinova.joint_types])
    np.testing.assert_array_equal(continuous, [True, False, False, True, False, True])
    np.testing.assert_array_equal(np.isinf(kinova.limits.lower), continuous)
    np.testing.assert_array_equal(np.isinf(kinova.limits.upper), continuous)


def test_friction_is_what_the_file_states() -> None:
    np.testing.assert_array_equal(load("xarm7").friction.viscous, [10, 10, 5, 5, 5, 2, 2])
    np.testing.assert_array_equal(load("z1").friction.viscous, [1, 2, 1, 1, 1, 1])
    assert not load("ur5").friction.viscous.any()


@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_zero_is_no_posture_of_some_arms(name: str) -> None:
    robot = load(name)
    zero = np.zeros(robot.n)
    assert ((zero < robot.limits.lower) | (zero > robot.limits.upper)).any()


def test_no_arm_of_example_robot_data_states_a_rotor_inertia() -> None:
    assert not any(load(name).armature.any() for name in ARMS)


@pytest.mark.parametrize(
    ("file", "n"),
    [
        ("borinot_description/urdf/borinot_flying_arm_2.urdf", 2),
        ("hextilt_description/urdf/hextilt_flying_arm_5.urdf", 5),
    ],
)
def test_other_arms_of_example_robot_data_load_by_path(file: str, n: int) -> None:
    assert Robot.load(data_folder() / file).n == n


def test_the_empty_stub_that_is_named_like_a_ur3_is_refused() -> None:
    with pytest.raises(UrdfError, match="no <link>"):
        Robot.load(data_folder() / "ur_description" / "urdf" / "ur3.urdf")


def data_folder() -> Path:
    """Return the folder of example-robot-data's robots, found from one of them."""
    file = Path(robots.EXAMPLE_ROBOT_DATA["panda"].file)
    return robots.locate("panda")[0].parents[len(file.parts) - 1]


def test_names_of_robot_descriptions_work_where_it_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A stand-in with its layout; the real one fetches robots from the network.
    package = tmp_path / "robot_descriptions"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "_descriptions.py").write_text(
        "class D:\n    has_urdf = True\nclass M:\n    has_urdf = False\n"
        'DESCRIPTIONS = {"mine_description": D(), "broken_description": D(), "xacro_description": D(),'
        ' "mine_mj_description": M()}\n'
    )
    urdf = robots.locate("twodof")[0]
    (package / "mine_description.py").write_text(f"URDF_PATH = {str(urdf)!r}\n")
    (package / "broken_description.py").write_text("raise OSError('no network')\n")
    (package / "xacro_description.py").write_text("XACRO_PATH = 'x'\n")
    assert robots.description_names() == ()
    monkeypatch.syspath_prepend(str(tmp_path))
    assert robots.description_names() == ("mine_description", "broken_description", "xacro_description")
    robot = Robot.load("mine_description")
    assert (robot.n, robot.name) == (2, "mine_description")
    with pytest.raises(UrdfError, match="cannot bring it: no network"):
        Robot.load("broken_description")
    with pytest.raises(UrdfError, match="expand it first"):
        Robot.load("xacro_description")
    with pytest.raises(NameNotFound, match="did you mean 'mine_description'"):
        Robot.load("mine_descripton")
    for module in [name for name in sys.modules if name.partition(".")[0] == "robot_descriptions"]:
        del sys.modules[module]


# --- Finding them --------------------------------------------------------------------------------


def test_every_name_that_is_listed_is_found_and_tested_here() -> None:
    assert set(robots.names()) == set(ARMS) | set(PARTS)
    for name in robots.names():
        path, found = robots.locate(name)
        assert path.is_file()
        assert found == name


@pytest.mark.parametrize(("typo", "meant"), [("pandas", "panda"), ("ur 5", "ur5"), ("kinva", "kinova")])
def test_a_name_that_does_not_exist_is_refused_and_the_near_one_offered(typo: str, meant: str) -> None:
    with pytest.raises(NameNotFound, match=f"no robot named {typo!r}; did you mean .*{meant!r}") as caught:
        Robot.load(typo)
    assert caught.value.valid == robots.names()


def test_an_address_is_no_file() -> None:
    with pytest.raises(UrdfError, match="download the file first"):
        Robot.load("https://example.org/arm.urdf")


@pytest.mark.parametrize("name", [None, 3, ["panda"], "", "a\0b", "a" * 5000])
def test_what_is_no_name_at_all_is_refused_by_our_error(name: object) -> None:
    with pytest.raises((NameNotFound, UrdfError)):
        Robot.load(name)


def test_without_example_robot_data_its_arms_are_refused_with_the_way_to_get_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(robots, "example_folder", lambda: None)
    assert "anthropomorphic3" in robots.names()
    assert not set(robots.names()) & set(robots.EXAMPLE_ROBOT_DATA)
    with pytest.raises(NameNotFound, match=r"pip install example-robot-data"):
        Robot.load("panda")
    with pytest.raises(NameNotFound, match="give the path of a URDF file"):
        Robot.load("pandas")


def test_a_name_means_the_known_robot_and_a_path_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = robots.locate("twodof")[0].read_text(encoding="utf-8")
    for file in ("ur5", "mine", "ur5.urdf"):
        Path(file).write_text(text, encoding="utf-8")
    assert Robot.load("ur5").n == 6
    for path in ("./ur5.urdf", "ur5.urdf", "mine", str(tmp_path / "ur5"), Path("mine")):
        assert Robot.load(path).n == 2, path


def test_a_folder_is_no_unknown_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "results").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        UrdfError, match=r"^results: is a folder, and not one of armgpi identify: give the URDF"
    ):
        Robot.load("results")
