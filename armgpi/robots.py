"""Robots that can be loaded by name: ours, and arms of an installed example-robot-data."""

from __future__ import annotations

import os
import sys
from os import PathLike
from pathlib import Path

from armgpi.errors import NameNotFound, UrdfError

#: Name -> file below example-robot-data's `robots` folder (version 6, data only).
EXAMPLE_ROBOT_DATA = {
    "double_pendulum": "double_pendulum_description/urdf/double_pendulum.urdf",
    "finger_edu": "finger_edu_description/robots/finger_edu.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "talos_left_arm": "talos_data/robots/talos_left_arm.urdf",
    "twodof": "asr_twodof_description/urdf/TwoDofs.urdf",
    # "ur3.urdf" in the data is an empty stub; this is the robot.
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
}


def names() -> tuple[str, ...]:
    """Return the names that :meth:`armgpi.Robot.load` finds on this machine."""
    ours = tuple(sorted(path.stem for path in _own_folder().glob("*.urdf")))
    folder = _example_folder()
    if folder is None:
        return ours
    return ours + tuple(name for name, file in EXAMPLE_ROBOT_DATA.items() if (folder / file).is_file())


def locate(path_or_name: str | PathLike[str]) -> tuple[Path, str | None]:
    """Return the URDF file that a path or a robot's name means, and the name if it was one.

    Raises:
        NameNotFound: when it is neither a known name nor an existing file.
        UrdfError: when it is a path that does not exist.
    """
    try:
        text = os.fsdecode(path_or_name)
    except TypeError:
        raise NameNotFound("robot", path_or_name, names()) from None
    path = Path(text)
    if path.suffix or len(path.parts) != 1 or path.is_absolute():
        if not os.path.exists(path):  # unlike Path.exists, False for a name too long for the system
            raise UrdfError(path, "there is no such file")
        return path, None
    own = _own_folder() / f"{text}.urdf"
    if os.path.isfile(own):
        return own, text
    folder = _example_folder()
    if folder is not None and text in EXAMPLE_ROBOT_DATA and (folder / EXAMPLE_ROBOT_DATA[text]).is_file():
        return folder / EXAMPLE_ROBOT_DATA[text], text
    if os.path.isfile(path):
        return path, None
    remedy = ""
    if text in EXAMPLE_ROBOT_DATA and folder is None:
        remedy = "it comes with the example-robot-data package: pip install 'armgpi[robots]'"
    raise NameNotFound("robot", text, names(), remedy or "or give the path of a URDF file")


def _own_folder() -> Path:
    """Return the folder of our own URDFs: inside an installed package, beside it in a checkout."""
    installed = Path(__file__).parent / "urdf"
    return installed if installed.is_dir() else Path(__file__).parents[1] / "urdf"


def _example_folder() -> Path | None:
    """Return example-robot-data's folder of robots, found on the import path; None when not installed."""
    for entry in sys.path:
        folder = Path(entry) / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
        if folder.is_dir():
            return folder
    return None
