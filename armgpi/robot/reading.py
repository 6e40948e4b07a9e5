"""From a file to the tree of a robot: a URDF, or a MuJoCo model."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from armgpi.robot import from_mujoco, urdf
from armgpi.robot.urdf import Urdf


def read(path: Path, repair: str | Iterable[str] = ()) -> Urdf:
    """Read and check the file of a robot.

    Args:
        path: of a URDF or an MJCF.
        repair: names of repairs that may be made in a URDF (:mod:`armgpi.robot.repairs`).

    Raises:
        UrdfError: when it is no usable robot; it names the link or joint.
        NameNotFound: for a repair that does not exist.
        MissingPackage: for an MJCF, when MuJoCo is not installed.
    """
    text = urdf.read_file(path)
    if from_mujoco.is_mjcf(text):
        return from_mujoco.read(path, text)
    return urdf.parse(text, str(path), repair)
