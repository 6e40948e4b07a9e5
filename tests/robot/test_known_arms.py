"""Known arms: recognised by what no frames alter, and never by less; published drives before assumed ones."""

from __future__ import annotations

import copy
import math

import numpy as np
import pinocchio as pin
import pytest

import armgpi
from armgpi import config
from armgpi.config import building
from armgpi.config import experiment as experiments
from armgpi.robot import known_arms
from armgpi.robot.drives import QUANTITIES
from armgpi.robot.known_arms import KNOWN_ARMS, geometry_of, published_drives, recognise
from armgpi.robot.rotors import assume_drives, with_published

_HALF_PI = 0.5 * math.pi


def _urdf(name: str, rows: list[tuple[float, float, float]], first: str = "joint1", mass: float = 1.0) -> str:
    """Return a URDF of a chain by modified Denavit-Hartenberg rows (a, alpha, d)."""
    body = (
        f'<inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    parts = [f'<robot name="{name}">', '<link name="base"/>']
    parent = "base"
    for i, (a, alpha, d) in enumerate(rows):
        turn = pin.SE3(pin.rpy.rpyToMatrix(alpha, 0.0, 0.0), np.zeros(3))
        place = pin.SE3(np.eye(3), np.array([a, 0.0, 0.0])) * turn
        place = place * pin.SE3(np.eye(3), np.array([0.0, 0.0, d]))
        xyz = " ".join(f"{x:.17g}" for x in place.translation)
        rpy = " ".join(f"{x:.17g}" for x in pin.rpy.matrixToRpy(place.rotation))
        joint = first if i == 0 else f"joint{i + 1}"
        parts.append(
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="link{i + 1}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
            '<limit lower="-2" upper="2" velocity="2" effort="50"/></joint>'
        )
        parent = f"link{i + 1}"
        parts.append(f'<link name="{parent}">{body}</link>')
    return "".join([*parts, "</robot>"])


#: Denavit-Hartenberg rows of Panda and FR3, as Franka's FCI documentation has them (modified convention).
_FRANKA = [
    (0.0, 0.0, 0.333),
    (0.0, -_HALF_PI, 0.0),
    (0.0, _HALF_PI, 0.316),
    (0.0825, _HALF_PI, 0.0),
    (-0.0825, -_HALF_PI, 0.384),
    (0.0, _HALF_PI, 0.0),
    (0.088, _HALF_PI, 0.0),
]


def test_geometry_is_that_of_denavit_and_hartenberg() -> None:
    own = geometry_of(armgpi.Robot.from_xml(_urdf("some", _FRANKA)))
    assert own.distances == pytest.approx([abs(a) for a, _, _ in _FRANKA[1:]], abs=1e-12)
    assert own.angles == pytest.approx([90.0] * 6, abs=1e-9)
    offsets = [0.0 if x is None else x for x in own.offsets]
    assert offsets == pytest.approx([d for _, _, d in _FRANKA[1:-1]], abs=1e-12)


@pytest.mark.parametrize(
    ("name", "product"),
    [
        ("ur3", "UR3"),
        ("ur5", "UR5"),
        ("ur10", "UR10"),
        ("panda", "Franka Panda (FER)"),
        ("so100", "SO-100 follower"),
        ("so101", "SO-101 follower"),
        ("g1_left_arm", "Unitree G1, an arm"),
        ("g1_right_arm", "Unitree G1, an arm"),
        ("xarm7", None),
        ("z1", "Unitree Z1"),
        ("kinova", None),
        ("anthropomorphic3", None),
        ("twodof", None),
    ],
)
def test_arms_of_the_catalogue(name: str, product: str | None) -> None:
    robot = armgpi.Robot.load(name, lock=[] if name != "panda" else ["panda_finger_joint1"])
    known = recognise(robot)
    assert (known and known.name) == product


def test_a_geometry_that_two_products_share_needs_a_name() -> None:
    assert recognise(armgpi.Robot.from_xml(_urdf("my_arm", _FRANKA))) is None
    named = recognise(armgpi.Robot.from_xml(_urdf("my_arm", _FRANKA, first="left_fr3_joint1")))
    assert named is not None
    assert named.name == "Franka Research 3"
    assert recognise(armgpi.Robot.from_xml(_urdf("panda", _FRANKA))) == KNOWN_ARMS[1]


def _universal(name: str, lengths: tuple[float, ...]) -> armgpi.Robot:
    """Return an arm of Universal Robots by d1, a2, a3, d4, d5, d6 of its published table."""
    d1, a2, a3, d4, d5, d6 = lengths
    rows = [
        (0.0, 0.0, d1),
        (0.0, _HALF_PI, 0.0),
        (a2, 0.0, 0.0),
        (a3, 0.0, d4),
        (0.0, _HALF_PI, d5),
        (0.0, -_HALF_PI, d6),
    ]
    return armgpi.Robot.from_xml(_urdf(name, rows, first="shoulder_pan_joint"))


#: Universal Robots' published Denavit-Hartenberg parameters [m].
_UR3 = (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819)
_UR3E = (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921)
_UR5E = (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996)
_UR10E = (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655)


@pytest.mark.parametrize(
    ("name", "lengths", "product"),
    [
        ("ur3", _UR3, "UR3"),
        ("ur3e", _UR3E, "UR3e"),
        ("ur3e_robot", _UR3E, "UR3e"),
        ("ur", _UR3E, None),
        ("my_arm", _UR3, None),
        ("ur5e", _UR5E, "UR5e"),
        ("ur7e", _UR5E, "UR7e"),
        ("ur", _UR5E, None),
        ("UR10e", _UR10E, "UR10e"),
        ("ur12e", _UR10E, "UR12e"),
    ],
)
def test_arms_of_universal_robots_that_share_lengths_need_a_name(
    name: str, lengths: tuple[float, ...], product: str | None
) -> None:
    known = recognise(_universal(name, lengths))
    assert (known and known.name) == product


@pytest.mark.parametrize(
    ("name", "first", "product"),
    [
        ("arm", "fr3_joint1", "Franka Research 3"),
        ("fr3v2", "fr3v2_joint1", None),
        ("fr3v2_1", "fr3_joint1", None),
        ("fr3-v2", "joint1", None),
        ("fr3_duo", "left_fr3_joint1", None),
        ("transfer_arm", "joint1", None),
        ("my_offer", "joint1", None),
        ("fer", "fer_joint1", "Franka Panda (FER)"),
    ],
)
def test_words_of_a_name_are_compared_whole(name: str, first: str, product: str | None) -> None:
    known = recognise(armgpi.Robot.from_xml(_urdf(name, _FRANKA, first=first)))
    assert (known and known.name) == product


@pytest.mark.parametrize("name", ["so100", "so101"])
def test_a_leader_arm_is_no_follower(name: str) -> None:
    follower = armgpi.Robot.load(name)
    assert recognise(follower) is not None
    leader = copy.copy(follower)
    object.__setattr__(leader, "name", f"{name}_leader")
    assert recognise(leader) is None


def test_a_name_alone_is_not_enough() -> None:
    longer = [(a, alpha, d + (0.003 if d == 0.316 else 0.0)) for a, alpha, d in _FRANKA]
    assert recognise(armgpi.Robot.from_xml(_urdf("fr3", longer))) is None
    assert recognise(armgpi.Robot.from_xml(_urdf("fr3", _FRANKA[:6]))) is None


def test_published_rotors_come_before_assumed_ones_and_after_specified_ones() -> None:
    robot = armgpi.Robot.from_xml(_urdf("fr3", _FRANKA))
    given = robot.with_drives({"joint2": {"rotor_inertia": 0.5}})
    drives = assume_drives(given).drives
    # Franka's numbers, of the README of Drake's franka_description.
    franka = [0.605721456, 0.605721456, 0.462474144, 0.462474144, 0.205544064, 0.205544064, 0.205544064]
    expected = [franka[0], 0.5, *franka[2:]]
    assert drives.value("rotor_inertia") == pytest.approx(expected, rel=1e-3)
    assert drives.sources("rotor_inertia") == ("published", "specified", *["published"] * 5)
    assert set(drives.sources("stiffness")) == {"assumed"}
    low, high = drives.interval("rotor_inertia")
    assert low[0] < franka[0] < high[0]
    assert low[1] == high[1] == 0.5
    assert not published_drives(assume_drives(robot)).data  # nothing is left to say
    assert assume_drives(robot, "none").armature.tolist() == [0.0] * 7


def test_numbers_at_the_joint_follow_from_those_of_the_motors() -> None:
    # Damped by gears: inertia and viscous friction by the ratio squared, Coulomb friction by the ratio.
    puma = next(each for each in KNOWN_ARMS if each.name == "Puma 560")
    table = {each.quantity: each.values for each in puma.published}
    assert table["rotor_inertia"][1] == pytest.approx(200e-6 * 107.815**2)
    assert table["viscous"][1] == pytest.approx(0.817e-3 * 107.815**2)
    assert table["coulomb"][1] == pytest.approx(0.0985 * 107.815)
    g1 = next(each for each in KNOWN_ARMS if each.name.startswith("Unitree G1"))
    rotors, gears = (0.139e-4, 0.017e-4, 0.169e-4), (1.0 + 46.0 / 18.0, 1.0 + 56.0 / 16.0)
    reflected = rotors[0] * (gears[0] * gears[1]) ** 2 + rotors[1] * gears[1] ** 2 + rotors[2]
    assert g1.published[0].values[0] == pytest.approx(reflected, rel=1e-3)
    assert g1.published[1].values[0] == pytest.approx(gears[0] * gears[1])


def test_bits_of_known_encoders_are_those_of_the_simulation() -> None:
    said, origin = config.parse("format: 1\nrobot: {name: so101, lock: [gripper]}\nideal: false\n", "x.yaml")
    experiment = config.build(said, origin)
    assert experiment.config.plant.encoder_bits == 12
    assert set(experiment.robot.drives.value("encoder_side")) == {"link"}
    assert "12-bit encoders (published)" in building.summary(experiment)
    again = config.build(*config.parse(experiments.portable(experiment.config)[0], "y.yaml"))
    assert again.robot.drives == experiment.robot.drives


@pytest.mark.parametrize("known", KNOWN_ARMS, ids=lambda known: known.name)
def test_entries_are_whole(known: known_arms.KnownArm) -> None:
    n = len(known.geometry.distances) + 1
    assert len(known.geometry.angles) == n - 1
    assert len(known.geometry.offsets) == n - 2
    for each in known.published:
        assert len(each.values) in (1, n)
        assert each.quantity in QUANTITIES
        assert each.factors[0] <= 1.0 <= each.factors[1]
        assert each.source.page.startswith("https://")
        assert each.source.licence
    if known.loop is not None:
        assert 0.0 < known.loop.rate[0] <= known.loop.rate[1]
        assert known.loop.source.page.startswith("https://")
        assert known.loop.source.licence


def test_rates_of_interfaces_are_those_of_the_controllers() -> None:
    """CB3 controllers have 125 Hz, those of the e-Series 500, as Universal Robots' ROS driver sets them."""
    rates = {known.name: known.loop.rate for known in KNOWN_ARMS if known.loop is not None}
    assert len(rates) >= 5
    assert {rates[name] for name in ("UR3", "UR5", "UR10")} == {(125.0, 125.0)}
    assert {rates[name] for name in ("UR3e", "UR5e", "UR10e")} == {(500.0, 500.0)}
    said = known_arms.describe_arm(with_published(armgpi.Robot.load("panda", lock=["panda_finger_joint1"])))
    assert "control rate 1000 Hz; 20 late packets in a row stop the robot" in said
    assert "control rate" in known_arms.table()
    assert "500 Hz; numbers that are sent come back after 2 or 3 samples" in known_arms.table()


def test_a_tx40_has_the_rotors_and_friction_that_were_identified() -> None:
    rows = [(0.0, 0.0, 0.32), (0.0, -_HALF_PI, 0.0), (0.225, 0.0, 0.035)]
    rows += [(0.0, _HALF_PI, 0.225), (0.0, -_HALF_PI, 0.0), (0.0, _HALF_PI, 0.0)]
    robot = armgpi.Robot.from_xml(_urdf("staubli_tx40", rows))
    known = recognise(robot)
    assert known is not None
    assert known.name == "Staubli TX40"
    drives = published_drives(robot)
    np.testing.assert_allclose(drives.value("viscous"), [8.05, 5.53, 1.97, 1.11, 1.86, 0.65])
    assert set(drives.sources("rotor_inertia")) == {"published"}
    assert recognise(armgpi.Robot.from_xml(_urdf("arm", rows))) is None


def test_the_description_says_what_was_not_found() -> None:
    robot = with_published(armgpi.Robot.load("ur5"))
    said = known_arms.describe_arm(robot)
    assert said.startswith("recognised by its geometry as UR5; not found published: rotor inertia")
    assert "armgpi excite --side" in said
    assert not known_arms.describe_published(robot.drives)
