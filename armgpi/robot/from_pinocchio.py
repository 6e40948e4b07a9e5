"""From a `pin.Model` that somebody else has built to a :class:`Urdf`, which is then built as any other.

So nothing else has to know of such robots. Joints may be revolute, continuous or prismatic, and floating or
planar ones that are locked.
"""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array
from armgpi.errors import ParameterError, UrdfError
from armgpi.robot import tensors, urdf
from armgpi.robot.tree import Joint, Link
from armgpi.robot.urdf import Urdf

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


def read(model: Any) -> Urdf:
    """Return the tree of a model, with limits, friction, rotor inertia and gravity.

    Args:
        model: the `pin.Model`.

    Raises:
        UrdfError: for a joint, an inertia or a limit that an arm cannot have; it names the joint.
    """
    return _Reader(model).document()


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


class _Reader:
    """Reads the tree of one model.

    Attributes:
        model: the `pin.Model`.
        source: what messages call it.
        bodies: name of the link that every joint carries: that of its first body in its own place.
    """

    def __init__(self, model: Any) -> None:
        """Name the bodies."""
        self.model, self.source = model, source(model)
        self.links: dict[str, Link] = {}
        self.joints: dict[str, Joint] = {}
        self.bodies = ["base", *(f"{name} (body)" for name in list(model.names)[1:])]
        for frame in reversed(list(model.frames)):
            at_joint = frame.placement.isIdentity(0.0)
            if frame.type == pin.FrameType.BODY and at_joint and frame.name != "universe":
                self.bodies[int(frame.parentJoint)] = frame.name

    def document(self) -> Urdf:
        """Return the whole tree."""
        model = self.model
        rotors: dict[str, float] = {}
        self._add_link(self.bodies[0], model.inertias[0])
        for index in range(1, model.njoints):
            self._add_link(self.bodies[index], model.inertias[index])
            joint = self._joint(index)
            self._add_joint(joint)
            if joint.moves:
                rotors[joint.name] = float(model.armature[int(model.joints[index].idx_v)])
        self._frames()
        name = str(model.name) or "unnamed"
        gravity = tuple(float(x) for x in model.gravity.linear)
        whole = repr((name, *self.links.values(), *self.joints.values(), rotors, gravity))
        return urdf.assemble(
            source=self.source,
            name=name,
            sha256=hashlib.sha256(whole.encode()).hexdigest(),
            root=urdf.elements(name, self.links, self.joints),
            links=self.links,
            joints=self.joints,
            armature=rotors,
            gravity=gravity,
        )

    def _add_link(self, name: str, inertia: Any = None) -> None:
        """Add a link, and refuse a second one of its name."""
        if name in self.links:
            raise UrdfError(self.source, f"two links are named {name!r}; rename one", name)
        mass = 0.0
        centre: tuple[float, ...] = (0.0,) * 3
        tensor: tuple[float, ...] = (0.0,) * 6
        if inertia is not None and inertia.mass != 0.0:
            mass = float(inertia.mass)
            centre = tuple(float(x) for x in inertia.lever)
            tensor = tensors.as_values(inertia.inertia)
        self.links[name] = Link(name, mass, centre, (0.0,) * 3, tensor, mass != 0.0, ())

    def _add_joint(self, joint: Joint) -> None:
        """Add a joint, and refuse a second one of its name."""
        if joint.name in self.joints:
            raise UrdfError(self.source, f"two joints are named {joint.name!r}; rename one", joint.name)
        self.joints[joint.name] = joint

    def _joint(self, index: int) -> Joint:
        """Return a joint of the model."""
        model, name = self.model, str(self.model.names[index])
        kind, axis = _kind(model, index)
        ends = self.bodies[int(model.parents[index])], self.bodies[index]
        pose = _xyz_rpy(model.jointPlacements[index])
        if axis is None:
            return Joint(name, kind, *ends, *pose)
        joint = model.joints[index]
        lower, upper = -math.inf, math.inf
        if kind != "continuous":
            limits = model.lowerPositionLimit, model.upperPositionLimit
            lower, upper = (_limit(float(limit[joint.idx_q])) for limit in limits)
        at = int(joint.idx_v)
        return Joint(
            name,
            kind,
            *ends,
            *pose,
            axis=tuple(float(x) for x in axis),
            lower=lower,
            upper=upper,
            velocity=_limit(float(model.velocityLimit[at])),
            effort=_limit(float(model.effortLimit[at])),
            damping=float(model.damping[at]),
            friction=float(model.upperDryFrictionLimit[at]),
        )

    def _frames(self) -> None:
        """Add the other frames as links on fixed joints: those of the URDF that it came from, if any."""
        model, bodies = self.model, self.bodies
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
            self._add_link(frame.name)
            self._add_joint(Joint(joint, "fixed", parent, frame.name, *_xyz_rpy(placement)))


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


def _xyz_rpy(placement: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a pose as a URDF has it."""
    angles = pin.rpy.matrixToRpy(placement.rotation)
    return tuple(float(x) for x in placement.translation), tuple(float(x) for x in angles)


def _limit(value: float) -> float:
    """Return a limit; infinite where there is none."""
    return math.copysign(math.inf, value) if abs(value) > _NONE else value
