"""Robots that can be loaded by name: ours, arms of an installed example-robot-data, robot_descriptions.

example-robot-data 6 is data without a Python module, so its files are found by path. The names of
robot_descriptions (``ur5_description``) work where that package is installed; it fetches a robot at its
first use.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from importlib import import_module
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from armgpi.errors import NameNotFound, UrdfError
from armgpi.robot import identified

__all__ = [
    "EXAMPLE_ROBOT_DATA",
    "Example",
    "description_names",
    "example_folder",
    "find_identified",
    "is_textbook",
    "kept",
    "locate",
    "names",
]


class Example(NamedTuple):
    """Where an arm is in example-robot-data.

    Attributes:
        file: the URDF, below its `robots` folder (version 6).
        keep: patterns of the arm's joints in a larger robot, whose other joints are locked; None for all.
        remark: what to know of the data.
    """

    file: str
    keep: tuple[str, ...] | None = None
    remark: str = ""


def _sides(
    name: str, file: str, *keep: str, sides: tuple[str, str] = ("left", "right")
) -> dict[str, Example]:
    """Return a robot's left and right arm; `{}` in the patterns of joints is the side."""
    return {
        f"{name}_{side}_arm": Example(file, tuple(pattern.format(word) for pattern in keep))
        for side, word in zip(("left", "right"), sides, strict=True)
    }


_TALOS = "talos_data/robots/talos_full_v2.urdf"
_UR3 = "effort limits are ur10's"
_ARM_1_TO_7 = "arm_{}_[1-7]_joint"
#: Name -> arm of example-robot-data: those with a file of their own, then those of larger robots.
EXAMPLE_ROBOT_DATA: dict[str, Example] = {
    "double_pendulum": Example("double_pendulum_description/urdf/double_pendulum.urdf"),
    "finger_edu": Example("finger_edu_description/robots/finger_edu.urdf"),
    "kinova": Example("kinova_description/robots/kinova.urdf"),
    "panda": Example("panda_description/urdf/panda.urdf"),
    "so100": Example("so_arm_description/urdf/so100.urdf"),
    "so101": Example("so_arm_description/urdf/so101.urdf"),
    "talos_left_arm": Example("talos_data/robots/talos_left_arm.urdf", remark="without joint 1"),
    "twodof": Example("asr_twodof_description/urdf/TwoDofs.urdf"),
    # "ur3.urdf" in the data is an empty stub; this is the robot.
    "ur3": Example("ur_description/urdf/ur3_robot.urdf", remark=_UR3),
    "ur5": Example("ur_description/urdf/ur5_robot.urdf"),
    "ur10": Example("ur_description/urdf/ur10_robot.urdf"),
    "xarm7": Example("xarm_description/urdf/xarm7.urdf"),
    "z1": Example("z1_description/urdf/z1.urdf"),
    "borinot_arm": Example("borinot_description/urdf/borinot_flying_arm_2.urdf"),
    "double_pendulum_continuous": Example("double_pendulum_description/urdf/double_pendulum_continuous.urdf"),
    "double_pendulum_simple": Example("double_pendulum_description/urdf/double_pendulum_simple.urdf"),
    "hextilt_arm": Example("hextilt_description/urdf/hextilt_flying_arm_5.urdf"),
    "ur3_gripper": Example("ur_description/urdf/ur3_gripper.urdf", remark=_UR3),
    "ur3_limited": Example("ur_description/urdf/ur3_joint_limited_robot.urdf", remark=_UR3),
    "ur5_gripper": Example("ur_description/urdf/ur5_gripper.urdf"),
    "ur5_limited": Example("ur_description/urdf/ur5_joint_limited_robot.urdf"),
    "ur10_limited": Example("ur_description/urdf/ur10_joint_limited_robot.urdf"),
    **_sides(
        "alex",
        "alex_description/urdf/alex_nub_hands.urdf",
        *("{}Shoulder*", "{}Elbow*", "{}Wrist*", "{}Gripper*"),
        sides=("Left", "Right"),
    ),
    "anymal_kinova_arm": Example(
        "anymal_b_simple_description/robots/anymal-kinova.urdf", ("j2s6s200_joint_[1-6]",)
    ),
    "b1_z1_arm": Example("b1_description/urdf/b1-z1.urdf", ("joint[1-6]",)),
    **_sides("baxter", "baxter_description/urdf/baxter.urdf", "{}_[sew][0-2]"),
    **_sides("centauro", "centauro_description/urdf/centauro.urdf", "j_arm{}_[1-6]", sides=("1", "2")),
    **_sides("g1", "g1_description/urdf/g1_29dof_rev_1_0.urdf", "{}_shoulder_*", "{}_elbow_*", "{}_wrist_*"),
    **_sides(
        "icub",
        "icub_description/robots/icub.urdf",
        "{}_shoulder_*",
        "{}_elbow",
        "{}_wrist_*",
        sides=("l", "r"),
    ),
    **_sides(
        "pr2",
        "pr2_description/urdf/pr2.urdf",
        *("{}_shoulder_*", "{}_upper_arm_roll_joint", "{}_elbow_flex_joint", "{}_forearm_roll_joint"),
        "{}_wrist_*",
        sides=("l", "r"),
    ),
    **_sides(
        "romeo",
        "romeo_description/urdf/romeo_small.urdf",
        *("{}Shoulder*", "{}Elbow*", "{}Wrist*"),
        sides=("L", "R"),
    ),
    "talos_left_arm_7": Example(_TALOS, ("arm_left_[1-7]_joint",)),
    "talos_right_arm": Example(_TALOS, ("arm_right_[1-7]_joint",)),
    "tiago_arm": Example("tiago_description/robots/tiago.urdf", ("arm_[1-7]_joint",)),
    **_sides("tiago_dual", "tiago_description/robots/tiago_dual.urdf", _ARM_1_TO_7),
    **_sides("tiago_pro", "tiago_pro_description/robots/tiago_pro.urdf", _ARM_1_TO_7),
}


def names() -> tuple[str, ...]:
    """Return the names that :meth:`armgpi.Robot.load` finds on this machine without fetching anything."""
    ours = _own_names()
    folder = example_folder()
    if folder is None:
        return ours
    return ours + tuple(name for name, arm in EXAMPLE_ROBOT_DATA.items() if (folder / arm.file).is_file())


def _own_names() -> tuple[str, ...]:
    """Return the names of our own arms."""
    return tuple(sorted(path.stem for path in _own_folder().glob("*.urdf")))


def description_names() -> tuple[str, ...]:
    """Return the names of an installed robot_descriptions that have a URDF; none when it is not installed."""
    if find_spec("robot_descriptions") is None:
        return ()
    with contextlib.suppress(Exception):  # a package of others, whose inside may change
        found = import_module("robot_descriptions._descriptions").DESCRIPTIONS
        return tuple(name for name, description in found.items() if description.has_urdf)
    return ()


def find_identified(name: object) -> identified.Identification | None:
    """Return what the folder of an identified arm says; None for what is none, and for a known robot's name.

    Args:
        name: path of a folder that `armgpi identify` wrote.

    Raises:
        UrdfError: when a file in it is damaged, or was changed.
    """
    if not isinstance(name, str | PathLike):
        return None
    path = os.path.join(os.fsdecode(name), identified.NAME)
    try:
        folder = os.path.isfile(path) and name not in names()
    except ValueError:  # a name that no file can have
        return None
    return identified.read(Path(path)) if folder else None


def locate(path_or_name: str | PathLike[str] | ModuleType) -> tuple[Path, str | None]:
    """Return the URDF file that a path, a robot's name or a module means, and the name if it was one.

    A folder of an identified arm counts as a name.

    Args:
        path_or_name: path of a URDF, name of a known robot, or a module of robot_descriptions.

    Raises:
        NameNotFound: when it is neither a known name nor an existing file.
        UrdfError: when it is a path that does not exist, or a folder.
    """
    if isinstance(path_or_name, ModuleType):  # of robot_descriptions
        described = getattr(path_or_name, "URDF_PATH", None)
        if described is None:
            raise UrdfError(path_or_name.__name__, "is a module without a URDF (URDF_PATH)")
        return _existing(Path(described), str(described)), None
    try:
        text = os.fsdecode(path_or_name)
    except TypeError:
        raise NameNotFound("robot", path_or_name, names()) from None
    if (arm := find_identified(text)) is not None:
        return arm.urdf, text
    path = Path(text)
    if path.suffix or len(path.parts) != 1 or path.is_absolute():
        return _existing(path, text), None
    file = _find_installed(text)
    if file is not None:
        return file, text
    if os.path.isfile(path):
        return path, None
    described = description_names()
    if text in described:
        return _find_described(text), text
    raise _unknown(text, described)


def _unknown(text: str, described: Sequence[str]) -> Exception:
    """Return the error for what is neither a file nor a name: of a folder that it is one."""
    if os.path.isdir(text):
        return UrdfError(text, "is a folder, and not one of armgpi identify: give the URDF in it")
    remedy = "or give the path of a URDF file"
    if text in EXAMPLE_ROBOT_DATA and example_folder() is None:
        remedy = "it comes with the example-robot-data package: pip install example-robot-data"
    return NameNotFound("robot", text, (*names(), *described), remedy)


def _existing(path: Path, text: str) -> Path:
    """Return the path of a URDF as given, refusing one that is not there."""
    if "://" in text:
        raise UrdfError(text, "is an address: download the file first, with the files that it names")
    if not os.path.exists(path):  # unlike Path.exists, False for a name too long for the system
        known = path.stem in names()
        near = ", ".join(sorted(each.name for each in path.parent.glob("*.urdf"))[:3])
        hint = f"; in that folder there is {near}" if near else "; give the path of a URDF"
        hint = f"; the name {path.stem!r} alone is a robot that armgpi knows" if known else hint
        raise UrdfError(path, f"there is no such file{hint}")
    return path


def is_textbook(name: object) -> bool:
    """Tell whether a name is that of one of our own arms, of textbooks: rigid, with exact positions.

    Args:
        name: of a robot.
    """
    return isinstance(name, str) and name in _own_names()


def _find_installed(name: str) -> Path | None:
    """Return the URDF of one of our arms or of example-robot-data; None where it is neither."""
    own, folder = _own_folder() / f"{name}.urdf", example_folder()
    if os.path.isfile(own):
        return own
    if folder is not None and name in EXAMPLE_ROBOT_DATA:
        file = folder / EXAMPLE_ROBOT_DATA[name].file
        return file if file.is_file() else None
    return None


def kept(
    name: str, joints: Iterable[str], lock: str | Iterable[str] | Mapping[str, float]
) -> list[str] | None:
    """Return the joints that a robot's name keeps, without those to `lock`; None when it keeps all.

    Args:
        name: of the robot.
        joints: names of its joints.
        lock: joints that are locked in addition.
    """
    patterns = EXAMPLE_ROBOT_DATA[name].keep if name in EXAMPLE_ROBOT_DATA else None
    if patterns is None:
        return None
    locked = {lock} if isinstance(lock, str) else set(lock)
    return [j for j in joints if j not in locked and any(fnmatchcase(j, p) for p in patterns)]


def _find_described(name: str) -> Path:
    """Return the URDF of a robot of robot_descriptions, which may fetch it first."""
    try:
        module = import_module(f"robot_descriptions.{name}")
        return Path(module.URDF_PATH)
    except AttributeError:
        raise UrdfError(name, "has no URDF in robot_descriptions but a xacro: expand it first") from None
    except Exception as error:  # git, the network, its folder: none of them ours
        raise UrdfError(name, f"robot_descriptions cannot bring it: {error}") from None


def _own_folder() -> Path:
    """Return the folder of our own URDFs: inside an installed package, beside it in a checkout."""
    installed = Path(__file__).parents[1] / "urdf"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "urdf"


def example_folder() -> Path | None:
    """Return example-robot-data's folder of robots, found on the import path; None when not installed."""
    for entry in sys.path:
        folder = Path(entry) / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
        if folder.is_dir():
            return folder
    return None


def __dir__() -> list[str]:
    """Return the public names, without what is imported here."""
    return __all__
