"""What an arm may have otherwise than its file says, once for plants, nominal models and rollouts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from armgpi.base.parameter import Parameter
from armgpi.robot.edits import Edits

_Same = TypeVar("_Same", bound=Edits)

_DECLARED = (
    ("payload", Parameter("mass of a load on top of what the robot has", "kg", default=0.0, least=0.0)),
    ("com", Parameter("centre of mass of that load in its frame", "m", "vector", default=(0.0, 0.0, 0.0))),
    ("frame", Parameter("frame of the load", kind="text", default=None, none="the tip")),
    (
        "inertia_scale",
        Parameter("factor of the robot's masses and inertias", default=1.0, least=0.0, above=True),
    ),
    ("rotor_inertia", Parameter("rotor inertia at the joints", "kg m^2 or kg", default=None, least=0.0)),
    ("viscous", Parameter("viscous friction", "N m s/rad or N s/m", least=0.0)),
    ("coulomb", Parameter("Coulomb friction", "N m or N", least=0.0)),
    ("effort", Parameter("effort limits", "N m or N", least=0.0)),
    ("gravity", Parameter("acceleration of free fall", "m/s^2", "vector", default=None)),
)
_PER_JOINT = ("rotor_inertia", "viscous", "coulomb", "effort")
#: What may be changed, by the names that `Robot.varied` has.
CHANGES: Mapping[str, Parameter] = {
    name: replace(each, name=name, per_joint=name in _PER_JOINT) for name, each in _DECLARED
}


def change(robot: _Same, given: Mapping[str, Any]) -> _Same:
    """Return a robot with some quantities changed, always in the same order.

    Args:
        robot: the robot.
        given: name in :data:`CHANGES` -> value; a load is at the origin of the tip if nothing else is said.

    Raises:
        ArmgpiError: when a value is not as the robot's own methods expect it.
    """
    if "inertia_scale" in given:
        robot = robot.scaled_inertia(float(given["inertia_scale"]))
    if "payload" in given:
        frame = given.get("frame") or robot.tip
        robot = robot.with_payload(frame, float(given["payload"]), given.get("com", np.zeros(3)))
    if "rotor_inertia" in given:
        robot = robot.with_armature(given["rotor_inertia"])
    if friction := {key: given[key] for key in ("viscous", "coulomb") if key in given}:
        robot = robot.with_friction(**friction)
    if "gravity" in given:
        robot = robot.with_gravity(given["gravity"])
    return robot.with_limits(effort=given["effort"]) if "effort" in given else robot
