"""Robots made from robots: a payload, rotor inertia, friction, scaled inertia, gravity, limits."""

from __future__ import annotations

import copy
import math
import sys
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import SMALLEST, Array, ArrayLike, as_number, as_sized_array, frozen, quantity
from armgpi.base.hints import with_keyword_hints
from armgpi.errors import ArrayError, LimitError, ParameterError
from armgpi.robot.assembly import Assembly
from armgpi.robot.drives import Drives
from armgpi.robot.dynamics import (
    CoupledDynamics,
    Dynamics,
    PinocchioDynamics,
    ScaledDynamics,
    VariedDynamics,
    Workspace,
)
from armgpi.robot.equations import Limits, PerJoint
from armgpi.robot.frames import Frames
from armgpi.robot.urdf_model import Coupling

#: A tensor of inertia may have eigenvalues so far below zero by rounding [kg m^2].
_TENSOR_ROUNDING = 1e-12

_Same = TypeVar("_Same", bound="Edits")


class Edits(Frames):
    """What makes another robot of one; the robot itself does not change.

    Every edit is recorded in the provenance of the robot that it makes: `provenance["changes"]`, in order.
    """

    _provenance: Mapping[str, Any]
    _assembly: Assembly | None
    drives: Drives

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the model came from and what was done to it, as plain data, the caller's own."""
        return copy.deepcopy(dict(self._provenance))

    @property
    def armature(self) -> Array:
        """Rotor inertia reflected to every joint [kg m^2 or kg], shape (n,)."""
        return np.array(self._model.armature)[self._own]

    @property
    def tip(self) -> str:
        """Name of the link at the end, the one farthest from the last joint over fixed joints.

        A gripper is no part of the arm: of one whose joints move it is the link that carries them.
        """
        model = self._model
        fingers = self._provenance.get("grippers", ())
        arm = [j for j in range(1, model.njoints) if model.names[j] not in fingers]
        last = max(arm or range(1, model.njoints), key=lambda j: (len(model.supports[j]), j))
        locked = self._provenance["locked"]
        depth: dict[int, float] = {}  # frames on the last joint -> fixed joints up to it; parents come first
        tip, farthest = 0, -math.inf
        for index, frame in enumerate(model.frames):
            if int(frame.parentJoint) != last:
                continue
            count = 0.0 if frame.type == pin.FrameType.JOINT else depth.get(int(frame.parentFrame), 0.0)
            if frame.type == pin.FrameType.FIXED_JOINT:
                count += -math.inf if frame.name in locked else 1.0  # a locked joint ends the arm before it
            depth[index] = count
            if frame.type == pin.FrameType.BODY and count > farthest:
                tip, farthest = index, count
        return str(model.frames[tip].name)

    @with_keyword_hints
    def with_payload(
        self: _Same,
        frame: str,
        mass: float,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
    ) -> _Same:
        """Return the robot with a load fixed to a frame.

        Args:
            frame: the frame that carries it.
            mass: its mass [kg], not negative.
            com: its centre of mass in that frame [m], shape (3,).
            inertia: its inertia about that centre, in the frame's axes [kg m^2], shape (3, 3); a point
                mass when not given.

        Raises:
            NameNotFound: when there is no such frame.
            ParameterError: when the mass is negative or the frame does not move.
            ArrayError: when `com` or `inertia` is not as it should be.
        """
        mass = as_number(mass, "mass")
        if mass < 0.0:
            raise ParameterError("mass", mass, "zero or positive [kg]")
        centre = _as_shape(com, "com", (3,))
        tensor = np.zeros((3, 3)) if inertia is None else _as_shape(inertia, "inertia", (3, 3))
        if not np.allclose(tensor, tensor.T) or np.linalg.eigvalsh(tensor)[0] < -_TENSOR_ROUNDING:
            raise ArrayError("inertia", "expected a symmetric tensor without negative eigenvalues")
        element = self._model.frames[self._frame(frame)]
        joint = int(element.parentJoint)
        if joint == 0:
            raise ParameterError("frame", frame, "a frame that moves; this one is fixed to the base")
        model = self._model.copy()
        model.inertias[joint] += element.placement.act(pin.Inertia(mass, centre, tensor))
        change = {"payload": {"frame": frame, "mass": mass, "com": centre.tolist()}}
        if inertia is not None:
            change["payload"]["inertia"] = tensor.tolist()
        return self._change(change, **parts_of(model, self.coupling))

    def with_armature(self: _Same, armature: PerJoint) -> _Same:
        """Return the robot with rotor inertia (gear ratio squared times rotor) at its joints.

        Args:
            armature: [kg m^2 or kg], a number, shape (n,), or name -> value (the others keep theirs).

        Raises:
            ArrayError: for another shape, or a value that is not a number.
            NameNotFound: for a joint that does not exist.
            LimitError: for a negative value.
        """
        model = self._model.copy()
        values = self._within("armature", armature, self.armature, 0.0, sys.float_info.max)
        whole = np.array(model.armature)
        whole[self._own] = values
        model.armature = whole
        drives = self.drives.with_value("rotor_inertia", _given_part(armature, values))
        return self._change({"armature": values.tolist()}, drives=drives, **parts_of(model, self.coupling))

    def with_drives(self: _Same, drives: Drives | Mapping[str, Any]) -> _Same:
        """Return the robot with what is known of its drives: rotors, friction, gears, motors, encoders.

        Rotor inertia and friction are those of the equations of motion and of the plant; limits of the
        motors lower the URDF's. The rest is for whoever asks `robot.drives`.

        Args:
            drives: what is known, or joint -> quantity -> value as a file of drives has it.

        Raises:
            ConfigError: when a mapping is not as a file of drives has to be.
            NameNotFound: for a joint that does not exist.
        """
        if not isinstance(drives, Drives):
            drives = Drives.from_plain(drives, self.joint_names)
        known = self.drives.updated(drives)
        robot = self
        if drives.data.get("rotor_inertia"):
            robot = robot.with_armature(known.value("rotor_inertia", self.armature))
        if friction := {key for key in ("viscous", "coulomb") if drives.data.get(key)}:
            own = {key: known.value(key, getattr(self.friction, key)) for key in friction}
            robot = robot.with_friction(**own)
        limits = {"velocity": "velocity_limit", "effort": "torque_limit"}
        if given := {key: name for key, name in limits.items() if drives.data.get(name)}:
            lowest = {
                key: np.minimum(getattr(self.limits, key), known.value(name, math.inf))
                for key, name in given.items()
            }
            robot = robot.with_limits(**lowest)
        return robot._change({"drives": drives.plain()}, drives=known)

    def with_bodies(self: _Same, parameters: ArrayLike) -> _Same:
        """Return the robot with other bodies: what each joint moves, up to the next joint.

        Args:
            parameters: mass, first moments, and second moments about the joint's frame (xx, xy, yy, xz, yz,
                zz), as Pinocchio's dynamic parameters are ordered, shape (bodies, 10).

        Raises:
            ArrayError: for another shape, or a value that is not a number.
            ParameterError: for a mass that is not positive.
        """
        model = self._model.copy()
        table = _as_shape(parameters, "parameters", (model.njoints - 1, 10))
        for index, row in enumerate(table):
            if row[0] < SMALLEST:
                raise ParameterError(f"mass of {model.names[index + 1]}", row[0], "positive [kg]")
            model.inertias[index + 1] = pin.Inertia.FromDynamicParameters(row)
        return self._change({"bodies": table.tolist()}, **parts_of(model, self.coupling))

    def with_friction(self: _Same, viscous: PerJoint | None = None, coulomb: PerJoint | None = None) -> _Same:
        """Return the robot with other joint friction; each a number, shape (n,), or name -> value.

        Args:
            viscous: viscous coefficients [N m s/rad or N s/m].
            coulomb: Coulomb torques or forces [N m or N].
        """
        given = {"viscous": viscous, "coulomb": coulomb}
        arrays = {
            key: frozen(self._within(key, value, getattr(self.friction, key), 0.0, sys.float_info.max))
            for key, value in given.items()
            if value is not None
        }
        drives = self.drives
        for key, array in arrays.items():
            drives = drives.with_value(key, _given_part(given[key], array))
        change = {"friction": {key: array.tolist() for key, array in arrays.items()}}
        return self._change(change, friction=self.friction._replace(**arrays), drives=drives)

    def scaled_inertia(self: _Same, factor: float) -> _Same:
        """Return the robot with every mass and inertia multiplied by one factor.

        D, C and G all scale. For a controller that uses D alone (GPI) this is the paper's variation of
        D(q); see ``PIDInversion`` for a law that uses C and G as well.

        Args:
            factor: positive [-].

        Raises:
            ArrayError: when it is not a finite number.
            ParameterError: when it is not positive.
        """
        factor = as_number(factor, "factor")
        if factor < SMALLEST:
            raise ParameterError("factor", factor, "positive")
        model = self._model.copy()
        for index, inertia in enumerate(self._model.inertias):
            # Not a pin.Inertia product: mass and tensor scale, the centre of mass stays.
            model.inertias[index] = pin.Inertia(
                factor * inertia.mass, inertia.lever, factor * inertia.inertia
            )
        model.armature = factor * model.armature
        # Not the kernels of the scaled model: rollouts that differ by the factor alone share theirs.
        own = self.dynamics
        base, scale = (own.base, factor * own.scale) if isinstance(own, ScaledDynamics) else (own, factor)
        dynamics = ScaledDynamics(base, scale)
        drives = self.drives.scaled("rotor_inertia", factor)
        parts = {**parts_of(model, self.coupling), "dynamics": dynamics, "drives": drives}
        return self._change({"inertia_scale": factor}, **parts)

    def with_gravity(self: _Same, gravity: ArrayLike) -> _Same:
        """Return the robot under another gravity.

        Args:
            gravity: acceleration of free fall in the base frame [m/s^2], shape (3,).

        Raises:
            ArrayError: for another shape, or a value that is not finite.
        """
        model = self._model.copy()
        vector = _as_shape(gravity, "gravity", (3,))
        model.gravity = pin.Motion(vector, np.zeros(3))
        return self._change({"gravity": vector.tolist()}, **parts_of(model, self.coupling))

    def with_limits(
        self: _Same,
        lower: PerJoint | None = None,
        upper: PerJoint | None = None,
        velocity: PerJoint | None = None,
        effort: PerJoint | None = None,
    ) -> _Same:
        """Return the robot with other limits; each a number, shape (n,), or name -> value.

        Args:
            lower: lowest positions [rad or m].
            upper: highest positions [rad or m].
            velocity: highest speeds [rad/s or m/s].
            effort: highest torques or forces [N m or N].

        Raises:
            ArrayError: for another shape, or a value that is not a number.
            NameNotFound: for a joint that does not exist.
            LimitError: for a negative speed or torque, or a lower limit above the upper one.
        """
        given = {"lower": lower, "upper": upper, "velocity": velocity, "effort": effort}
        changed = {key: value for key, value in given.items() if value is not None}
        arrays = {}
        for key, value in changed.items():
            lowest = -math.inf if key in ("lower", "upper") else 0.0
            current = getattr(self.limits, key)
            arrays[key] = self._within(key, value, current, lowest, math.inf)
        limits = self.limits._replace(**arrays)
        for j, (low, high) in enumerate(zip(limits.lower, limits.upper, strict=True)):
            if low > high:
                raise LimitError("the lower limit", self.joint_names[j], low, -math.inf, high)
        change = {"limits": {key: array.tolist() for key, array in arrays.items()}}
        return self._change(change, limits=Limits(*map(frozen, limits)))

    def _varied_dynamics(self, batch: int, frame: str | None, arrays: Mapping[str, Array]) -> Dynamics:
        """Return the equations of motion of rollouts whose robots differ; see :meth:`armgpi.Robot.varied`.

        Args:
            batch: number of rollouts.
            frame: frame that carries the load; None for none.
            arrays: what varies, name -> (batch, ...); not checked.

        Raises:
            NameNotFound: when there is no such frame.
            ParameterError: when the frame does not move.
        """
        own: Any = self.dynamics
        scale = arrays.get("inertia_scale")
        factor: Any = 1.0 if scale is None else scale[:, None]
        if isinstance(own, ScaledDynamics):
            own, factor = own.base, own.scale * factor
        # All that hangs on the arm is over the factor first, as the factor is on the whole.
        varied: dict[str, Any] = {}
        if frame is not None:
            element = self._model.frames[self._frame(frame)]
            if not (joint := int(element.parentJoint)):
                raise ParameterError("frame", frame, "a frame that moves; this one is fixed to the base")
            rotation, position = np.array(element.placement.rotation), np.array(element.placement.translation)
            com = arrays.get("com", np.zeros((batch, 3))) @ rotation.T + position
            varied |= {"joint": joint, "load": np.hstack([arrays["payload"][:, None] / factor, com])}
        if "rotor_inertia" in arrays:
            whole = np.tile(np.array(self._model.armature), (batch, 1))
            whole[:, self._own] = arrays["rotor_inertia"]
            varied["armature"] = whole / factor
        if "gravity" in arrays:
            varied["gravity"] = arrays["gravity"]
        if varied:
            if isinstance(own, CoupledDynamics):
                arm: Any = own.whole
                own = CoupledDynamics(VariedDynamics(arm, batch, **varied), own.ratio, own.offset)
            else:
                own = VariedDynamics(own, batch, **varied)
        return own if isinstance(factor, float) and factor == 1.0 else ScaledDynamics(own, factor)

    def _within(self, name: str, value: PerJoint, current: Array, lowest: float, highest: float) -> Array:
        """Return a quantity of every joint, (n,); joints that a mapping leaves out keep the current one."""
        values = quantity(value, name, self.joint_names, current, infinite=True)
        for joint, number in zip(self.joint_names, values, strict=True):
            if not lowest <= number <= highest:
                raise LimitError(name, joint, number, lowest, highest)
            if lowest == 0.0 and 0.0 < number < SMALLEST:  # too few digits are left of it
                raise LimitError(name, joint, number, SMALLEST, highest)
        return values

    def _change(self: _Same, change: Mapping[str, Any], **attributes: Any) -> _Same:
        """Return a robot with other attributes that remembers the change."""
        changes = [*self._provenance["changes"], dict(change)]
        return self._with_attributes(_provenance={**self._provenance, "changes": changes}, **attributes)

    @property
    def _own(self) -> list[int]:
        """Places of the n joints among the model's coordinates."""
        return [int(self._model.joints[self._model.getJointId(name)].idx_v) for name in self.joint_names]


def parts_of(model: pin.Model, coupling: Coupling | None) -> dict[str, Any]:
    """Return the attributes of a robot that depend on its `pin.Model`, which nobody else may change."""
    whole = PinocchioDynamics(model)
    dynamics = whole if coupling is None else CoupledDynamics(whole, *coupling)
    return {"_model": model, "_workspace": Workspace(model), "dynamics": dynamics}


def _given_part(value: PerJoint | None, values: Array) -> Any:
    """Return checked values (n,), or those of the joints alone that a mapping names."""
    return value if isinstance(value, Mapping) else values


def _as_shape(value: ArrayLike, name: str, shape: tuple[int, ...]) -> Array:
    """Return `value` as an array of exactly `shape`."""
    array = as_sized_array(value, name)
    if array.shape != shape:
        raise ArrayError(name, f"expected shape {shape}, got {array.shape}")
    return array
