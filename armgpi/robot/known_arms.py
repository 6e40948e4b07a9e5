"""Arms that are known by their geometry, and what is published of their drives, each number with its source.

An arm is recognised by what no change of frames alters: the distance and the angle between each joint axis
and the next one, and the offset along an axis between its two neighbours. Where two products share that, the
name of the robot or of its joints has to say which one it is; an arm that is only alike is not taken for a
known one. Words are compared as whole ones, which letters and digits make: "fr3" is a word of
``left_fr3_joint1`` and none of ``fr3v2``.

Nothing here is guessed: what no public source states is left out, and assumed by the rule of
:mod:`armgpi.robot.rotors`. Licences are those of the sources; numbers alone were taken over.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.base.escape import markdown_table
from armgpi.robot.drives import Drives

#: Lengths [m] and angles [degrees] of an arm may differ by so much from those of a product: URDFs are
#: rounded, and some hold the calibration of one robot.
_LENGTH, _ANGLE = 1.5e-3, 1.0
#: Sine of the angle between two axes below which they are parallel: the offset along them is not defined.
_PARALLEL = 1e-3


class Source(NamedTuple):
    """Where a number was published.

    Attributes:
        text: what it is called in output.
        page: its address.
        licence: of the page.
    """

    text: str
    page: str
    licence: str


class Published(NamedTuple):
    """One quantity of the drives of an arm.

    Attributes:
        quantity: a key of :data:`armgpi.robot.drives.QUANTITIES`.
        values: of each joint; a single one is that of all.
        factors: the lowest and the highest value over the published one.
        source: where it was published.
    """

    quantity: str
    values: tuple[Any, ...]
    factors: tuple[float, float]
    source: Source


class Geometry(NamedTuple):
    """The geometry of a chain of n joints, which no choice of frames alters.

    Attributes:
        distances: between each axis and the next one [m], n - 1 of them.
        angles: between them [degrees], 0 to 90, n - 1 of them.
        offsets: along each axis but the first and last one, between the common normals with its neighbours
            [m], n - 2 of them; None where an axis is parallel to a neighbour.
    """

    distances: tuple[float, ...]
    angles: tuple[float, ...]
    offsets: tuple[float | None, ...]


class Loop(NamedTuple):
    """How often an arm's interface exchanges positions and commands, and how late it lets them be.

    Attributes:
        rate: samples a second [Hz]: lowest and highest that is published.
        late: what is published of late samples, in words; empty where nothing was found.
        source: where that was published.
    """

    rate: tuple[float, float]
    late: str
    source: Source

    def describe(self) -> str:
        """Return the control rate of the interface in words, and what it requires of timing."""
        low, high = self.rate
        rate = f"{low:g} Hz" if low == high else f"{low:g} to {high:g} Hz"
        return f"{rate}; {self.late}" if self.late else rate


class KnownArm(NamedTuple):
    """A product, and what is published of its drives.

    Attributes:
        name: of the product.
        geometry: of its joints.
        words: of which one has to be in the name of the robot or of its first joint, as whole words, "so_100"
            as two in a row; none where the geometry is that of this product alone.
        published: of its drives.
        interface: what its interface says of positions; empty where nothing was found.
        loop: rate of its interface; None where nothing was found.
        arm_joints: how many joints are the arm's, where the geometry has those of a gripper, too.
        others: beginnings of words by which other products of this geometry are called; none of them may be
            in these names.
    """

    name: str
    geometry: Geometry
    words: tuple[str, ...] = ()
    published: tuple[Published, ...] = ()
    interface: str = ""
    loop: Loop | None = None
    arm_joints: int | None = None
    others: tuple[str, ...] = ()


_DRAKE_FR3 = Source(
    "Franka's reflected inertias of the FR3, README of Drake's franka_description",
    "https://github.com/RobotLocomotion/drake/blob/master/manipulation/models/franka_description/README.md",
    "BSD-3-Clause",
)
_BAM = Source(
    "STS3215 (7.4 V), identified on a pendulum by Rhoban/bam, models M1 to M6",
    "https://github.com/Rhoban/bam/tree/main/bam/params/feetech_sts3215_7_4V",
    "Apache-2.0",
)
_SO_BOM = Source(
    "parts of the follower arm, README of SO-ARM100",
    "https://github.com/TheRobotStudio/SO-ARM100",
    "Apache-2.0",
)
_STS3215 = Source(
    "STS3215: magnetic encoder of 12 bits, absolute in a turn of the output",
    "https://github.com/matthieuvigne/STS_servos",
    "not stated",
)
_XM540 = Source("ROBOTIS e-Manual", "https://emanual.robotis.com/docs/en/dxl/x/xm540-w270", "not stated")
_XM430 = Source(
    "ROBOTIS e-Manual",
    "https://emanual.robotis.com/docs/en/platform/turtlebot3/appendix_dynamixel",
    "not stated",
)
_IIWA = Source(
    "Chawda and Niemeyer: motor positions are measured, link positions are not",
    "https://fdocuments.net/document/toward-controlling-a-kuka-lbr-iiwa-for-interactive-tracking-toward-controlling.html",
    "all rights reserved",
)
_PUMA = Source(
    "Corke and Armstrong-Helouvry 1994, as in Robotics Toolbox for Python",
    "https://github.com/petercorke/robotics-toolbox-python/blob/master/roboticstoolbox/models/DH/Puma560.py",
    "MIT",
)
_LWA4P = Source(
    "identified by Giusti, OTFCtrlModRob",
    "https://github.com/AndreaGiusti/OTFCtrlModRob/blob/master/Dissertation/modulesDB/init_SchunkModDB.m",
    "not stated",
)
_G1 = Source(
    "Unitree's motors 5020 and 4010, as in mjlab",
    "https://github.com/mujocolab/mjlab/blob/main/src/mjlab/asset_zoo/robots/unitree_g1/g1_constants.py",
    "Apache-2.0",
)

_TX40 = Source(
    "identified by the makers of FIGAROH, configuration of its example staubli_TX40",
    "https://github.com/thanhndv212/figaroh-examples/blob/main/examples/staubli_TX40/config/TX40_config.yaml",
    "Apache-2.0",
)
_FCI_LOOP = Loop(
    (1000.0, 1000.0),
    "20 late packets in a row stop the robot",
    Source(
        "libfranka; of late packets Polymetis",
        "https://facebookresearch.github.io/fairo/polymetis/troubleshooting.html",
        "libfranka Apache-2.0, Polymetis MIT",
    ),
)
_FRI_LOOP = Loop(
    (200.0, 1000.0),
    "torques at least every 5 ms",
    Source(
        "FRI application of iiwa_ros, after KUKA's example",
        "https://github.com/epfl-lasa/iiwa_ros/blob/master/iiwa_driver/java/FRIOverlay.java",
        "not stated",
    ),
)
_UR_RATES = "https://github.com/UniversalRobots/Universal_Robots_ROS2_Driver/tree/main/ur_robot_driver/config"
_UR_ISSUES = "https://github.com/UniversalRobots/Universal_Robots_Client_Library/issues/86"
_UR_CB3 = Loop(
    (125.0, 125.0),
    "",
    Source("rates of Universal Robots' ROS 2 driver", _UR_RATES, "BSD-3-Clause"),
)
_UR_E = Loop(
    (500.0, 500.0),
    "numbers that are sent come back after 2 or 3 samples",
    Source(
        "samples: a user of a UR10e, without motion; rate: Universal Robots' ROS 2 driver (BSD-3-Clause)",
        _UR_ISSUES,
        "not stated",
    ),
)
_SO_LOOP = Loop(
    (100.0, 100.0),
    "",
    Source(
        "NVIDIA's example so101_sinus_motion reads joints at that rate",
        "https://docs.nvidia.com/isaac-os/reference/applications/so101-sinus-motion",
        "all rights reserved",
    ),
)
_Z1_LOOP = Loop(
    (500.0, 500.0),
    "",
    Source(
        "z1_sdk: default dt of ctrlComponents.h",
        "https://github.com/unitreerobotics/z1_sdk/blob/master/include/unitree_arm_sdk/control/ctrlComponents.h",
        "not stated",
    ),
)

#: What was looked for of every arm.
_LOOKED_FOR = (
    "rotor_inertia",
    "gear_ratio",
    "viscous",
    "coulomb",
    "stiffness",
    "encoder_side",
    "encoder_count",
)
#: The gears of a Puma 560, by which its motors' friction is seen at the joint.
_PUMA_RATIO = (62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686)
#: Its motors' inertia [kg m^2], viscous friction [N m s/rad] and Coulomb friction [N m], of both directions.
_PUMA_MOTOR = (200e-6, 200e-6, 200e-6, 33e-6, 33e-6, 33e-6)
_PUMA_VISCOUS = (1.48e-3, 0.817e-3, 1.38e-3, 71.2e-6, 82.6e-6, 36.7e-6)
_PUMA_COULOMB = (0.415, 0.0985, 0.1185, 14.05e-3, 11.88e-3, 7.23e-3)
_PUMA_ANGLES = (90.0, 0.0, 90.0, 90.0, 90.0)
_PUMA_DRIVES = (
    Published(
        "rotor_inertia",
        tuple(J * N**2 for J, N in zip(_PUMA_MOTOR, _PUMA_RATIO, strict=True)),
        (0.9, 2.1),  # Armstrong, Khatib and Burdick 1986 have 0.95 to 2.05 of it
        _PUMA,
    ),
    Published("gear_ratio", _PUMA_RATIO, (1.0, 1.0), _PUMA),
    Published(
        "viscous",
        tuple(B * N**2 for B, N in zip(_PUMA_VISCOUS, _PUMA_RATIO, strict=True)),
        (0.5, 2.0),
        _PUMA,
    ),
    Published(
        "coulomb",
        tuple(T * N for T, N in zip(_PUMA_COULOMB, _PUMA_RATIO, strict=True)),
        (0.5, 2.0),
        _PUMA,
    ),
)
#: Right angles between the axes of seven joints.
_RIGHT_7 = (90.0,) * 6
#: A UR arm: axes 2, 3 and 4 are parallel.
_UR_ANGLES = (90.0, 0.0, 0.0, 90.0, 90.0)
_UR_WORDS = (
    "each joint has an encoder at the motor and one at the link (Madsen et al. 2020, "
    "doi.org/10.1155/2020/8709870); which of them RTDE's actual_q is, was not found published"
)
_FCI = "libfranka gives q, the joint position, and theta, the motor position (robot_state.h)"


def _ur(name: str, upper_arm: float, forearm: float, wrist: float, words: tuple[str, ...] = ()) -> KnownArm:
    """Return an arm of Universal Robots, of lengths [m], called by a word where others share these.

    Names of e-Series arms end in "e".
    """
    loop = _UR_E if name.endswith("e") else _UR_CB3
    geometry = Geometry((0.0, upper_arm, forearm, 0.0, 0.0), _UR_ANGLES, (None, None, None, wrist))
    return KnownArm(name, geometry, words, interface=_UR_WORDS, loop=loop)


def _servos(ratios: tuple[float, ...], ratio_source: Source, encoder: Source) -> tuple[Published, ...]:
    """Return what is known of servos with a 12-bit encoder at the output."""
    return (
        Published("gear_ratio", ratios, (1.0, 1.0), ratio_source),
        Published("encoder_side", ("link",), (1.0, 1.0), encoder),
        Published("encoder_count", (4096.0,), (1.0, 1.0), encoder),
    )


_FRANKA = Geometry((0.0, 0.0, 0.0825, 0.0825, 0.0, 0.088), _RIGHT_7, (0.0, 0.316, 0.0, 0.384, 0.0))
_SO_ARM = (90.0, 0.0, 0.0, 90.0, 90.0)
#: Published values of a servo's five or six models span so much around the first one.
_SERVO_SPREAD = (0.8, 1.1)
_SO_SERVOS = (
    Published("rotor_inertia", (0.0261,), _SERVO_SPREAD, _BAM),
    Published("viscous", (0.0599,), (0.4, 1.3), _BAM),
    Published("coulomb", (0.0515,), (0.5, 2.0), _BAM),
    *_servos((345.0,), _SO_BOM, _STS3215),
)

#: The arms that are known.
KNOWN_ARMS: tuple[KnownArm, ...] = (
    KnownArm(
        "Franka Research 3",
        _FRANKA,
        ("fr3",),
        (
            Published(
                "rotor_inertia",
                (0.6057, 0.6057, 0.4625, 0.4625, 0.2055, 0.2055, 0.2055),
                (0.9, 1.1),
                _DRAKE_FR3,
            ),
        ),
        _FCI,
        _FCI_LOOP,
        others=("fr3v", "v2", "duo"),
    ),
    KnownArm("Franka Panda (FER)", _FRANKA, ("panda", "fer"), (), _FCI, _FCI_LOOP),
    KnownArm(
        "SO-100 follower",
        Geometry((0.0306, 0.116, 0.135, 0.0, 0.0202), _SO_ARM, (None, None, None, 0.0845)),
        ("so100", "so_100", "so-100", "so_arm100"),
        _SO_SERVOS,
        loop=_SO_LOOP,
        arm_joints=5,
        others=("leader",),  # of other gears
    ),
    KnownArm(
        "SO-101 follower",
        Geometry((0.0304, 0.116, 0.135, 0.0, 0.0202), _SO_ARM, (None, None, None, 0.0845)),
        ("so101", "so_101", "so-101"),
        _SO_SERVOS,
        loop=_SO_LOOP,
        arm_joints=5,
        others=("leader",),  # of other gears
    ),
    KnownArm(
        "KUKA LBR iiwa 7",
        Geometry((0.0,) * 6, _RIGHT_7, (0.0, 0.4, 0.0, 0.4, 0.0)),
        ("iiwa", "iiwa7"),
        (Published("encoder_side", ("motor",), (1.0, 1.0), _IIWA),),
        "the Fast Robot Interface gives the measured positions of the motors",
        _FRI_LOOP,
    ),
    KnownArm(
        "KUKA LBR iiwa 14",
        Geometry((0.0,) * 6, _RIGHT_7, (0.0, 0.42, 0.0, 0.4, 0.0)),
        ("iiwa", "iiwa14"),
        (Published("encoder_side", ("motor",), (1.0, 1.0), _IIWA),),
        "the Fast Robot Interface gives the measured positions of the motors",
        _FRI_LOOP,
    ),
    KnownArm(
        "Puma 560",
        Geometry((0.0, 0.4318, 0.0203, 0.0, 0.0), _PUMA_ANGLES, (None, None, 0.4318, 0.0)),
        (),
        _PUMA_DRIVES,
    ),
    KnownArm(  # as Robotics Toolbox's URDF has it, whose elbow has no offset
        "Puma 560",
        Geometry((0.0, 0.4323, 0.0, 0.0, 0.0), _PUMA_ANGLES, (None, None, 0.4331, 0.0)),
        ("puma", "puma560"),
        _PUMA_DRIVES,
    ),
    KnownArm(
        "Staubli TX40",
        Geometry((0.0, 0.225, 0.0, 0.0, 0.0), _PUMA_ANGLES, (None, None, 0.225, 0.0)),
        ("tx40", "tx_40"),
        (
            Published("rotor_inertia", (0.362, 0.362, 0.0988, 0.0313, 0.0468, 0.0105), (0.7, 1.4), _TX40),
            Published("gear_ratio", (32.0, 32.0, 45.0, 48.0, 45.0, 32.0), (1.0, 1.0), _TX40),
            Published("viscous", (8.05, 5.53, 1.97, 1.11, 1.86, 0.65), (0.7, 1.4), _TX40),
            Published("coulomb", (7.14, 8.26, 6.34, 2.48, 3.03, 0.282), (0.7, 1.4), _TX40),
        ),
        "motor 6 turns with joint 5 as well",
    ),
    KnownArm(
        "Unitree Z1",
        Geometry((0.0, 0.35, 0.2253, 0.07, 0.0), _UR_ANGLES, (None, None, None, 0.0)),
        ("z1",),
        loop=_Z1_LOOP,
    ),
    KnownArm(
        "Schunk LWA 4P",
        Geometry((0.0, 0.35, 0.0, 0.0, 0.0), (90.0, 0.0, 90.0, 90.0, 90.0), (0.0, 0.0, 0.305, 0.0053)),
        (),
        (
            Published("rotor_inertia", (1.339, 1.339, 1.339, 1.339, 0.17, 0.17), (0.7, 1.4), _LWA4P),
            Published("gear_ratio", (160.0, 160.0, 160.0, 160.0, 100.0, 100.0), (1.0, 1.0), _LWA4P),
            Published("viscous", (15.68, 13.91, 17.89, 13.63, 4.45, 4.67), (0.7, 1.4), _LWA4P),
            Published("coulomb", (7.14, 5.1, 6.84, 6.91, 2.12, 2.33), (0.7, 1.4), _LWA4P),
        ),
    ),
    KnownArm(
        "Unitree G1, an arm",
        Geometry((0.0138, 0.0062, 0.0158, 0.01, 0.0, 0.046), _RIGHT_7, (0.0, 0.1837, 0.0019, 0.138, 0.0)),
        (),
        (
            Published("rotor_inertia", (0.00361,) * 5 + (0.00425,) * 2, (0.7, 1.4), _G1),
            Published("gear_ratio", (16.0,) * 5 + (25.0,) * 2, (1.0, 1.0), _G1),
        ),
        "its motors have two encoders each; which of them is reported was not found published",
    ),
    KnownArm(
        "ViperX-300 6DOF",
        Geometry((0.0, 0.3059, 0.0, 0.0, 0.0), (90.0, 0.0, 90.0, 90.0, 90.0), (None, None, 0.3, 0.0)),
        (),
        (
            Published("encoder_side", ("link",), (1.0, 1.0), _XM540),
            Published("encoder_count", (4096.0,), (1.0, 1.0), _XM540),
        ),
    ),
    KnownArm(
        "OpenMANIPULATOR-X",
        Geometry((0.0, 0.1302, 0.124), (90.0, 0.0, 0.0), (None, None)),
        (),
        (
            Published("encoder_side", ("link",), (1.0, 1.0), _XM430),
            Published("encoder_count", (4096.0,), (1.0, 1.0), _XM430),
        ),
    ),
    # UR3 and UR3e differ along the first and last axes alone, which this geometry has not; UR7e and
    # UR12e have the lengths of UR5e and UR10e.
    _ur("UR3", 0.24365, 0.21325, 0.08535, ("ur3",)),
    _ur("UR3e", 0.24355, 0.2132, 0.08535, ("ur3e",)),
    _ur("UR5", 0.425, 0.39225, 0.09465),
    _ur("UR10", 0.612, 0.5723, 0.1157),
    _ur("UR5e", 0.425, 0.3922, 0.0997, ("ur5e",)),
    _ur("UR7e", 0.425, 0.3922, 0.0997, ("ur7e",)),
    _ur("UR10e", 0.6127, 0.57155, 0.11985, ("ur10e",)),
    _ur("UR12e", 0.6127, 0.57155, 0.11985, ("ur12e",)),
)


def geometry_of(robot: Any) -> Geometry:
    """Return the geometry of an arm: how each joint's axis lies to the next one, with the joints at zero.

    Args:
        robot: one arm without joints that follow others. Only what lies between revolute joints is of use: a
            prismatic joint counts as one without an axis.
    """
    model = robot.pinocchio_model()
    data = model.createData()
    q = np.zeros(model.nq)
    jacobians = np.reshape(pin.computeJointJacobians(model, data, q), (6, -1))  # of one joint it is flat
    columns = [model.joints[i].idx_v for i in range(1, model.njoints)]
    axes = [np.asarray(jacobians[3:, column]) for column in columns]
    points = [np.asarray(data.oMi[i].translation) for i in range(1, model.njoints)]
    distances, angles, normals = [], [], []
    for i in range(len(axes) - 1):
        distance, angle, feet = _between(points[i], axes[i], points[i + 1], axes[i + 1])
        distances.append(distance)
        angles.append(angle)
        normals.append(feet)
    offsets: list[float | None] = []
    for i in range(1, len(axes) - 1):
        before, after = normals[i - 1], normals[i]
        known = before is not None and after is not None
        offsets.append(abs(float((after[0] - before[1]) @ axes[i])) if known else None)
    return Geometry(tuple(distances), tuple(angles), tuple(offsets))


def _between(point: Array, axis: Array, other_point: Array, other_axis: Array) -> tuple[float, float, Any]:
    """Return distance [m] and angle [degrees] of two lines, and the feet of their common normal; or None."""
    between = other_point - point
    normal = np.cross(axis, other_axis)
    sine, cosine = float(np.linalg.norm(normal)), float(axis @ other_axis)
    angle = math.degrees(math.atan2(sine, abs(cosine)))
    if sine < _PARALLEL:
        return float(np.linalg.norm(between - (between @ axis) * axis)), angle, None
    along = np.linalg.solve(
        np.array([[1.0, -cosine], [cosine, -1.0]]), np.array([between @ axis, between @ other_axis])
    )
    feet = (point + along[0] * axis, other_point + along[1] * other_axis)
    return abs(float(between @ normal)) / sine, angle, feet


def recognise(robot: Any) -> KnownArm | None:
    """Return the product that an arm is; None where it is none that is known.

    Its first joints have to have the product's geometry; joints after them may be those of a gripper.

    Args:
        robot: one arm.
    """
    if getattr(robot, "coupling", None) is not None or not all(
        kind in ("revolute", "continuous") for kind in robot.joint_types[:3]
    ):
        return None
    own = geometry_of(robot)
    names = robot.name, robot.joint_names[0]
    for known in KNOWN_ARMS:
        if (
            _is_named(names, known)
            and robot.n >= (known.arm_joints or _joints(known))
            and _matches(own, known.geometry)
        ):
            return known
    return None


def _is_named(names: Sequence[str], known: KnownArm) -> bool:
    """Tell whether names may be those of a product: with one of its words, and none of another product."""
    words = [f" {' '.join(_words(name))} " for name in names]
    for other in known.others:
        if any(f" {other}" in own for own in words):
            return False
    wanted = [f" {' '.join(_words(word))} " for word in known.words]
    return not wanted or any(word in own for word in wanted for own in words)


def _words(name: str) -> list[str]:
    """Return the words of a name, of letters and digits alone, in small letters."""
    return re.findall("[a-z0-9]+", name.lower())


def _joints(known: KnownArm) -> int:
    """Return the number of joints of a product."""
    return len(known.geometry.distances) + 1


def _matches(own: Geometry, known: Geometry) -> bool:
    """Tell whether the first joints of an arm have a known geometry."""
    for distance, length in zip(own.distances, known.distances, strict=False):
        if abs(distance - length) > _LENGTH:
            return False
    for offset, along in zip(own.offsets, known.offsets, strict=False):
        if offset is not None and along is not None and abs(offset - along) > _LENGTH:
            return False
    return all(abs(x - y) < _ANGLE for x, y in zip(own.angles, known.angles, strict=False))


def published_drives(robot: Any, quantities: Sequence[str] = ()) -> Drives:
    """Return what is published of the drives of an arm, where nothing is known of them yet.

    Args:
        robot: one arm.
        quantities: those that are wanted; all when not given.
    """
    found = Drives(robot.joint_names)
    known = recognise(robot)
    if known is None:
        return found
    joints = robot.joint_names[: _joints(known)]
    for each in known.published:
        if quantities and each.quantity not in quantities:
            continue
        values = each.values * len(joints) if len(each.values) == 1 else each.values[: len(joints)]
        left = {
            joint: value
            for joint, value in zip(joints, values, strict=True)
            if joint in _unknown(robot, each.quantity)
        }
        if not left:
            continue
        ends: dict[str, Any] = {}
        if not isinstance(each.values[0], str):
            low, high = each.factors
            ends["low"] = {joint: low * value for joint, value in left.items()}
            ends["high"] = {joint: high * value for joint, value in left.items()}
        found = found.with_value(each.quantity, left, source="published", file=each.source.text, **ends)
    return found


def _unknown(robot: Any, quantity: str) -> set[str]:
    """Return the joints of which nothing is known of a quantity, neither by drives nor by the URDF."""
    contained: Mapping[str, Array] = {
        "rotor_inertia": robot.armature,
        "viscous": robot.friction.viscous,
        "coulomb": robot.friction.coulomb,
    }
    sources = robot.drives.sources(quantity)
    numbers = contained.get(quantity, np.zeros(robot.n))
    return {
        joint
        for joint, source, number in zip(robot.joint_names, sources, numbers, strict=True)
        if not source and not number
    }


def describe_published(drives: Drives, values: bool = False) -> str:
    """Return in a line which quantities of an arm's drives are published, with their sources; or nothing.

    Args:
        drives: of one arm.
        values: whether their values are said, joint by joint; else where they are shown.
    """
    sources: dict[str, dict[str, list[str]]] = {}
    for quantity, data in drives.data.items():
        for joint, datum in data.items():
            if datum.source == "published":
                shown = f"{datum.value:.4g}" if isinstance(datum.value, float) else str(datum.value)
                sources.setdefault(datum.file, {}).setdefault(quantity, []).append(f"{joint} {shown}")
    said = []
    for source, quantities in sources.items():
        names = [
            f"{_in_words(name)} {_together(rows)}" if values else _in_words(name)
            for name, rows in quantities.items()
        ]
        said.append(f"{', '.join(names)} ({source})")
    end = "" if values else ". Values: --explain"
    return f"Published for this arm: {'; '.join(said)}{end}" if said else ""


def _together(rows: Sequence[str]) -> str:
    """Return values of joints in words: once where all are the same."""
    values = {row.rpartition(" ")[2] for row in rows}
    return values.pop() if len(values) == 1 else ", ".join(rows)


def describe_arm(robot: Any) -> str:
    """Return in a line which product an arm is, and what was not found published of it; or nothing."""
    known = recognise(robot)
    if known is None:
        return ""
    quantities = {each.quantity for each in known.published}
    missing = [_in_words(name) for name in _LOOKED_FOR if name not in quantities]
    said = [f"recognised by its geometry as {known.name}"]
    if missing:
        said.append(f"not found published: {', '.join(missing)}")
    if known.interface:
        said.append(known.interface)
    if known.loop is not None:
        said.append(f"control rate {known.loop.describe()} ({known.loop.source.text})")
    joints = robot.joint_names[: _joints(known)]
    sides = dict(zip(robot.joint_names, robot.drives.sources("encoder_side"), strict=True))
    open_ = [joint for joint in joints if not sides[joint]]
    if "encoder_side" not in quantities and open_:
        of = "" if len(open_) == len(joints) else f" of {', '.join(open_)}"
        said.append(f"armgpi excite --side finds the side of the encoders{of}")
    return "; ".join(said)


def known_bits(drives: Drives, default: int) -> Any:
    """Return the resolution of an arm's encoders [bits]: a number, or joint -> number where they differ.

    Args:
        drives: of one arm.
        default: of joints of which no count is known.
    """
    counts = drives.value("encoder_count")
    bits = [default if math.isnan(count) else round(math.log2(count)) for count in counts.tolist()]
    return bits[0] if len(set(bits)) == 1 else dict(zip(drives.joint_names, bits, strict=True))


def _in_words(quantity: str) -> str:
    return quantity.replace("_", " ")


def table() -> str:
    """Return the table of known arms as Markdown."""
    head = ("arm", "recognised by", "published", "values at the joints", "interval", "source, licence")
    rows: list[tuple[str, ...]] = []
    for known in KNOWN_ARMS:
        words = " or ".join(f"`{word}`" for word in known.words)
        how = f"geometry, and {words} in a name" if words else "geometry"
        if known.others:
            how += f", and none of {', '.join(f'`{word}`' for word in known.others)}"
        if not known.published:
            rows.append((known.name, how, "of its drives nothing found", "", "", known.interface))
        for each in known.published:
            shown = [f"{x:.3g}" if isinstance(x, float) else str(x) for x in each.values]
            exact = each.factors == (1.0, 1.0)
            interval = "" if exact else f"{each.factors[0]:g} to {each.factors[1]:g} times"
            source = f"[{each.source.text}]({each.source.page}), {each.source.licence}"
            rows.append((known.name, how, _in_words(each.quantity), ", ".join(shown), interval, source))
        if known.loop is not None:
            source = f"[{known.loop.source.text}]({known.loop.source.page}), {known.loop.source.licence}"
            rows.append((known.name, how, "control rate", known.loop.describe(), "", source))
    return markdown_table(head, rows)
