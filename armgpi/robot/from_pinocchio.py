"""From a `pin.Model` that somebody else has built to a URDF, which is then read and checked as any other.

So nothing else has to know of such robots. Joints may be revolute, continuous or prismatic, and floating or
planar ones that are locked.
"""

from __future__ import annotations

import math
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import pinocchio as pin

from armgpi.arrays import Array
from armgpi.errors import ParameterError, UrdfError
from armgpi.robot import urdf_model

#: What a joint of several coordinates is in a URDF, where it has to be locked.
_WIDE = {"JointModelFreeFlyer": "floating", "JointModelPlanar": "planar"}
#: Pinocchio's limits beyond this mean none.
_NONE = 1e15
#: By how much the D(q) of the two models may differ by rounding, of its largest element.
_SAME = 1e-9


def model_of(given: Any) -> Any:
    """Return the `pin.Model` of a model or of a RobotWrapper, a model of the caller's own.

    Raises:
        ParameterError: when it is neither.
    """
    model = getattr(given, "model", given)
    if not isinstance(model, pin.Model):
        raise ParameterError("model", given, "a pin.Model or a pin.RobotWrapper")
    return model


def source(model: Any) -> str:
    """Return what messages and provenance call it."""
    return f"Pinocchio model {model.name!r}"


def urdf_text(model: Any) -> str:
    """Return the URDF of a model.

    Raises:
        UrdfError: for a joint that a URDF cannot have.
    """
    root = Element("robot", name=str(model.name) or "unnamed")
    # The name of the link that every joint carries: that of its first body in its own place.
    bodies = ["base", *(f"{name} (body)" for name in list(model.names)[1:])]
    for frame in reversed(list(model.frames)):
        at_joint = frame.placement.isIdentity(0.0)
        if frame.type == pin.FrameType.BODY and at_joint and frame.name != "universe":
            bodies[int(frame.parentJoint)] = frame.name
    _link(root, bodies[0], model.inertias[0])
    for index in range(1, model.njoints):
        _link(root, bodies[index], model.inertias[index])
        _joint(root, model, index, bodies)
    _frames(root, model, bodies)
    return tostring(root, encoding="unicode")


def check_same(model: Any, robot: Any, tangent: Array) -> None:
    """Refuse a robot whose D(q) is not that of the model that it was made from.

    Args:
        model: the model.
        robot: the robot.
        tangent: the model's coordinates as steps from neutral at `robot.middle()`, shape (nv,).

    Raises:
        UrdfError: when they differ by more than rounding.
    """
    own = model.copy()
    q = pin.integrate(own, pin.neutral(own), tangent)
    whole = pin.crba(own, own.createData(), q)
    whole = np.triu(whole) + np.triu(whole, 1).T
    rows = [int(own.joints[own.getJointId(name)].idx_v) for name in robot.joint_names]
    expected, found = whole[np.ix_(rows, rows)], robot.mass_matrix(robot.middle())
    if not np.abs(found - expected).max() <= _SAME * np.abs(expected).max():
        raise UrdfError(
            source(model), "its inertia matrix differs after the conversion: load the URDF that it came from"
        )


def tangent_of(model: Any, values: dict[str, float]) -> Array:
    """Return joint positions as steps from the neutral configuration, shape (nv,)."""
    steps = np.zeros(model.nv)
    for index in range(1, model.njoints):
        joint = model.joints[index]
        if joint.nv == 1:
            steps[joint.idx_v] = values.get(str(model.names[index]), 0.0)
    return steps


def _frames(root: Element, model: Any, bodies: list[str]) -> None:
    """Write the other frames as links on fixed joints: those of the URDF that it came from, if any."""
    frames = list(model.frames)
    named = {*bodies, *list(model.names)}
    carriers = {int(frame.parentFrame) for frame in frames[1:] if frame.type == pin.FrameType.BODY}
    for index, frame in enumerate(frames[1:], start=1):
        fixed = frame.type == pin.FrameType.FIXED_JOINT
        if frame.name in named or frame.type == pin.FrameType.JOINT or (fixed and index in carriers):
            continue
        named.add(frame.name)
        above = frames[int(frame.parentFrame)]
        joint = above.name if above.type == pin.FrameType.FIXED_JOINT else f"{frame.name} (frame)"
        while above.type not in (pin.FrameType.BODY, pin.FrameType.JOINT) and above.name != "universe":
            above = frames[int(above.parentFrame)]
        placement, parent = frame.placement, bodies[int(frame.parentJoint)]
        if above.type == pin.FrameType.BODY and above.name in named:
            placement, parent = above.placement.inverse() * placement, above.name
        SubElement(root, "link", name=frame.name)
        element = SubElement(root, "joint", name=joint, type="fixed")
        _ends(element, parent, frame.name, placement)


def _link(root: Element, name: str, inertia: Any) -> None:
    """Write a link."""
    link = SubElement(root, "link", name=name)
    if inertia.mass != 0.0:
        inertial = SubElement(link, "inertial")
        SubElement(inertial, "origin", xyz=urdf_model.join(inertia.lever), rpy="0 0 0")
        SubElement(inertial, "mass", value=repr(float(inertia.mass)))
        matrix = inertia.inertia
        keys = {f"i{'xyz'[i]}{'xyz'[j]}": repr(float(matrix[i, j])) for i in range(3) for j in range(i, 3)}
        SubElement(inertial, "inertia", keys)


def _joint(root: Element, model: Any, index: int, bodies: list[str]) -> None:
    """Write a joint that moves."""
    joint, name = model.joints[index], str(model.names[index])
    kind, axis = _kind(model, index)
    element = SubElement(root, "joint", name=name, type=kind)
    _ends(element, bodies[int(model.parents[index])], bodies[index], model.jointPlacements[index])
    if axis is None:
        return
    at, bounds = int(joint.idx_v), {}
    if kind != "continuous":
        lower, upper = (
            float(limit[joint.idx_q]) for limit in (model.lowerPositionLimit, model.upperPositionLimit)
        )
        bounds = {"lower": _limit(lower), "upper": _limit(upper)}
    SubElement(element, "axis", xyz=urdf_model.join(axis))
    effort, velocity = _limit(float(model.effortLimit[at])), _limit(float(model.velocityLimit[at]))
    SubElement(element, "limit", {**bounds, "effort": effort, "velocity": velocity})
    friction = {
        "damping": repr(float(model.damping[at])),
        "friction": repr(float(model.upperDryFrictionLimit[at])),
    }
    SubElement(element, "dynamics", friction)


def _kind(model: Any, index: int) -> tuple[str, Array | None]:
    """Return the type of a joint in a URDF, and its axis; none for one that has to be locked."""
    joint = model.joints[index]
    short = joint.shortname()
    if short in _WIDE:
        return _WIDE[short], None
    if joint.nv == 1 and "Helical" not in short and "Mimic" not in short:
        data = joint.createData()
        joint.calc(data, pin.neutral(model))
        motion = np.asarray(data.S).ravel()
        linear, angular = motion[:3], motion[3:]
        if not linear.any():
            return ("continuous" if joint.nq == 2 else "revolute"), angular
        if not angular.any():
            return "prismatic", linear
    raise UrdfError(
        source(model),
        f"joint {str(model.names[index])!r} is a {short.removeprefix('JointModel')}; armgpi needs revolute, "
        "continuous or prismatic joints: build the model without it, or lock it by pin.buildReducedModel",
        str(model.names[index]),
    )


def _ends(element: Element, parent: str, child: str, placement: Any) -> None:
    """Write what a joint connects, and where it is."""
    SubElement(element, "parent", link=parent)
    SubElement(element, "child", link=child)
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    SubElement(element, "origin", xyz=urdf_model.join(placement.translation), rpy=urdf_model.join(rpy))


def _limit(value: float) -> str:
    """Return a limit; huge where there is none."""
    return repr(math.copysign(1e300, value)) if abs(value) > _NONE else repr(value)
