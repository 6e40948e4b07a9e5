"""Robot: an arm's equations of motion, D(q) a + C(q, v) v + G(q) = tau, from its URDF by Pinocchio."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pinocchio as pin

from armgpi.arrays import Array, ArrayLike, as_float_array, as_joint_array, as_number, frozen
from armgpi.errors import ArrayError, LimitError, NameNotFound, ParameterError, Remedy, UrdfError
from armgpi.robot import robots, urdf, urdf_model
from armgpi.robot.dynamics import CoupledDynamics, Dynamics, PinocchioDynamics, ScaledDynamics, stacked

PerJoint = ArrayLike | Mapping[str, float]
#: Smallest eigenvalue of D(q), of the largest one and alone, below which a model is singular.
_SINGULAR, _WEIGHTLESS = 1e-14, 1e-15
#: How far D(q)^-1 D(q) may be from one.
_WRONG = 1e-3
#: Configurations at which D(q) is looked at when a robot is loaded.
_SAMPLES = 16
#: Width of the range from which configurations are drawn where a joint has none or a huge one [rad, m].
_WIDEST_TURN, _WIDEST_SLIDE = 4.0 * math.pi, 4.0


class Limits(NamedTuple):
    """Limits of every joint, arrays of shape (n,), read-only; infinite where the URDF has none.

    Attributes:
        lower: lowest position [rad or m].
        upper: highest position [rad or m].
        velocity: highest speed [rad/s or m/s].
        effort: highest torque or force [N m or N].
    """

    lower: Array
    upper: Array
    velocity: Array
    effort: Array


class Friction(NamedTuple):
    """Joint friction as the URDF's ``<dynamics>`` gives it, arrays of shape (n,), read-only.

    Attributes:
        viscous: viscous coefficient [N m s/rad or N s/m].
        coulomb: Coulomb torque or force [N m or N].
    """

    viscous: Array
    coulomb: Array


class Pose(NamedTuple):
    """Pose of a frame in the base frame.

    Attributes:
        rotation: rotation matrix, shape (..., 3, 3).
        translation: position [m], shape (..., 3).
    """

    rotation: Array
    translation: Array


class _Checked:
    """The equations of motion with their arguments checked; rows of a batch are states."""

    name: str
    joint_names: tuple[str, ...]
    joint_types: tuple[str, ...]
    limits: Limits
    friction: Friction
    dynamics: Dynamics
    batch: int | None = None

    @property
    def n(self) -> int:
        """Number of joints, coordinates and velocities."""
        return len(self.joint_names)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return the inertia matrix D(q), by CRBA.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            D, shape (n, n) or (batch, n, n), symmetric and positive definite.

        Raises:
            ArrayError: when `q` has another shape or dtype or is not finite.
        """
        (q_,) = self._states(q=q)
        return self.dynamics.mass_matrix(q_)

    def gravity(self, q: ArrayLike) -> Array:
        """Return the gravity torque G(q) [N m or N], shape as `q`: (n,) or (batch, n)."""
        (q_,) = self._states(q=q)
        return self.dynamics.gravity(q_)

    def nonlinear_effects(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return C(q, v) v + G(q) [N m or N], shape as `q`: (n,) or (batch, n)."""
        q_, v_ = self._states(q=q, v=v)
        return self.dynamics.nonlinear_effects(q_, v_)

    def forward_dynamics(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Array:
        """Return the acceleration D(q)^-1 (tau - C(q, v) v - G(q)), by ABA.

        Friction of the URDF is not part of it; a plant adds that (see ``armgpi.RigidBodyPlant``).

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.
            tau: torques [N m or N], same shape.

        Returns:
            Accelerations [rad/s^2 or m/s^2], same shape.

        Raises:
            ArrayError: when an argument has another shape or dtype or is not finite.
        """
        q_, v_, tau_ = self._states(q=q, v=v, tau=tau)
        return self.dynamics.forward(q_, v_, tau_)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return D(q) a + C(q, v) v + G(q) [N m or N], by RNEA; shapes as in `forward_dynamics`."""
        q_, v_, a_ = self._states(q=q, v=v, a=a)
        return self.dynamics.inverse(q_, v_, a_)

    def inertia_times(self, q: ArrayLike, a: ArrayLike) -> Array:
        """Return D(q) a [N m or N] without building D; shapes (n,) or (batch, n)."""
        q_, a_ = self._states(q=q, a=a)
        return self.dynamics.inertia_times(q_, a_)

    def inertia_solve(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Return D(q)^-1 tau [rad/s^2 or m/s^2] without building D; shapes (n,) or (batch, n)."""
        q_, tau_ = self._states(q=q, tau=tau)
        return self.dynamics.inertia_solve(q_, tau_).copy()

    def check_position(self, q: ArrayLike, what: str) -> Array:
        """Return positions as an array, refusing those outside the joint limits.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            what: what they are, for the message ("the start").

        Raises:
            ArrayError: when the shape or dtype is wrong or a value is not finite.
            LimitError: when a position is outside its joint's limits by more than rounding.
        """
        (positions,) = self._states(**{what: q})
        lower, upper = (np.broadcast_to(limit, positions.shape) for limit in self.limits[:2])
        slack = 1e-9 * np.maximum(1.0, np.abs(positions))
        outside = np.argwhere((positions < lower - slack) | (positions > upper + slack))
        if outside.size:
            index = tuple(int(i) for i in outside[0])
            joint = self.joint_names[index[-1]]
            raise LimitError(what, joint, positions[index], lower[index], upper[index])
        return positions

    def _states(self, **arguments: ArrayLike) -> tuple[Array, ...]:
        """Check state-like arguments and give them one shape; a single state goes with any batch."""
        arrays = [as_joint_array(value, name, self.joint_names) for name, value in arguments.items()]
        shapes = [array.shape for array in arrays]
        if self.batch is not None:
            shapes.append((self.batch, self.n))
        try:
            shape = np.broadcast_shapes(*shapes)
        except ValueError:
            names = ", ".join(arguments)
            raise ArrayError(names, f"shapes do not go together: {', '.join(map(str, shapes))}") from None
        if self.batch is not None and shape != (self.batch, self.n):
            raise ArrayError(", ".join(arguments), f"expected {self.batch} rows, got shape {shape}")
        return tuple(np.ascontiguousarray(np.broadcast_to(array, shape)) for array in arrays)


class Robot(_Checked):
    """A fixed-base arm of revolute, continuous and prismatic joints, one coordinate each.

    Immutable: the ``with_...`` methods return another robot. Load one with :meth:`load`.

    Attributes:
        name: name of the robot.
        joint_names: names of the n joints, in the order of every array.
        joint_types: "revolute", "continuous" or "prismatic", for every joint.
        limits: position, velocity and effort limits.
        friction: joint friction that the URDF states; the equations of motion here leave it out.
        dynamics: the same equations without checks, for loops of one's own.
        coupling: how joints that follow others (``mimic="follow"``) depend on the n; None when none does.
        provenance: where the model came from and what was done to it, as plain data.
    """

    def __init__(
        self,
        model: Any,
        name: str,
        joint_types: Sequence[str],
        limits: Limits,
        friction: Friction,
        provenance: Mapping[str, Any],
        coupling: urdf_model.Coupling | None = None,
        joint_names: Sequence[str] | None = None,
    ) -> None:
        """Take over a `pin.Model` with nq = nv; users call :meth:`load` or :meth:`from_xml`."""
        self._model = model
        self.name = name
        self.joint_names = tuple(list(model.names)[1:] if joint_names is None else joint_names)
        self.coupling = coupling
        self.joint_types = tuple(joint_types)
        self.limits = Limits(*map(frozen, limits))
        self.friction = Friction(*map(frozen, friction))
        self.provenance = dict(provenance)
        whole = PinocchioDynamics(model)
        self.dynamics: Dynamics = whole if coupling is None else CoupledDynamics(whole, *coupling)
        self._frames: dict[str, int] = {}
        for index, frame in enumerate(model.frames):
            # Where a link and a joint share a name, the link's frame is the one people mean.
            if index and (frame.name not in self._frames or frame.type == pin.FrameType.BODY):
                self._frames[frame.name] = index
        self._kinematics = model.createData()

    @classmethod
    def load(
        cls,
        path_or_name: str | PathLike[str],
        lock: Sequence[str] | Mapping[str, float] = (),
        keep: Sequence[str] | None = None,
        mimic: urdf_model.Mimic = "lock",
    ) -> Robot:
        """Load a robot from a URDF file, or by the name of one that armgpi knows.

        Args:
            path_or_name: path of a URDF, or a name from :func:`armgpi.robots.names`.
            lock: joints to hold fixed: names (held at zero, or at the limit nearest to it) or
                name -> value [rad or m].
            keep: when given, every joint that is not named here is locked. A name that means an arm of a
                larger robot (``baxter_left_arm``) keeps that arm by itself.
            mimic: joints that mimic another are locked where its zero (or lock) puts them; with "follow"
                they move with it, and their inertia and weight are felt by it.

        Raises:
            NameNotFound: for a robot or joint name that does not exist.
            UrdfError: for a file that is no usable URDF.
        """
        path, name = robots.locate(path_or_name)
        document = urdf.parse(urdf.read_file(path), str(path))
        if name is not None and keep is None:
            keep = robots.kept(name, (j.name for j in document.joints.values() if j.moves), lock)
        return cls._from_document(document, name or document.name, lock, keep, mimic)

    @classmethod
    def from_xml(
        cls,
        text: str,
        lock: Sequence[str] | Mapping[str, float] = (),
        keep: Sequence[str] | None = None,
        mimic: urdf_model.Mimic = "lock",
    ) -> Robot:
        """Load a robot from the text of a URDF; arguments and errors as :meth:`load`."""
        document = urdf.parse(text, "URDF text")
        return cls._from_document(document, document.name, lock, keep, mimic)

    @classmethod
    def _from_document(
        cls,
        document: urdf.Urdf,
        name: str,
        lock: Sequence[str] | Mapping[str, float],
        keep: Sequence[str] | None,
        mimic: urdf_model.Mimic,
    ) -> Robot:
        built = urdf_model.build(document, lock, keep, mimic)
        limits = Limits(
            *(
                np.array([getattr(j, k) for j in built.joints])
                for k in ("lower", "upper", "velocity", "effort")
            )
        )
        friction = Friction(
            np.array([j.damping for j in built.joints]), np.array([j.friction for j in built.joints])
        )
        joints = built.joints
        if built.coupling is not None:
            limits, friction = _coupled(limits, friction, built.coupling, document.source, joints)
            joints = tuple(j for j in joints if j.mimic is None)
        provenance = {
            "source": document.source,
            "sha256": document.sha256,
            "locked": dict(built.locked),
            "changes": [],
        }
        if built.coupling is not None:
            provenance["mimic"] = "follow"
        robot = cls(
            built.model,
            name,
            [j.type for j in joints],
            limits,
            friction,
            provenance,
            built.coupling,
            [j.name for j in joints],
        )
        robot._check_inertia(document.source)
        return robot

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all frames (links, joints and fixed joints)."""
        return tuple(self._frames)

    @property
    def armature(self) -> Array:
        """Rotor inertia seen at every joint [kg m^2 or kg], shape (n,)."""
        return np.array(self._model.armature)[self._own]

    @property
    def total_mass(self) -> float:
        """Mass of everything, the base included [kg]."""
        return float(sum(inertia.mass for inertia in self._model.inertias))

    @property
    def tip(self) -> str:
        """Name of the link at the end, the one farthest from the last joint over fixed joints."""
        model = self._model
        last = max(range(1, model.njoints), key=lambda j: (len(model.supports[j]), j))
        locked = self.provenance["locked"]
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

    def pinocchio_model(self) -> Any:
        """Return a copy of the `pin.Model`, for what this class does not offer.

        With joints that follow others it has their coordinates too: ``coupling.ratio @ q + coupling.offset``.
        """
        return self._model.copy()

    def frame_pose(self, name: str, q: ArrayLike) -> Pose:
        """Return the pose of a frame in the base frame.

        Args:
            name: a link, joint or fixed joint.
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            Rotation (..., 3, 3) and translation (..., 3) [m].

        Raises:
            NameNotFound: when there is no such frame.
            ArrayError: when `q` is not as it should be.
        """
        index = self._frame(name)
        (q_,) = self._states(q=q)

        def pose(row: Array) -> Array:
            pin.framesForwardKinematics(self._model, self._kinematics, self._whole(row))
            matrix: Array = self._kinematics.oMf[index].homogeneous.copy()
            return matrix

        homogeneous = _rowwise(pose, q_)
        return Pose(homogeneous[..., :3, :3], homogeneous[..., :3, 3])

    def frame_jacobian(self, name: str, q: ArrayLike) -> Array:
        """Return the Jacobian of a frame: J v is its linear, then angular velocity, along the base axes.

        Args:
            name: a link, joint or fixed joint.
            q: positions [rad or m], shape (n,) or (batch, n).

        Returns:
            J, shape (6, n) or (batch, 6, n).

        Raises:
            NameNotFound: when there is no such frame.
            ArrayError: when `q` is not as it should be.
        """
        index = self._frame(name)
        (q_,) = self._states(q=q)

        def jacobian(row: Array) -> Array:
            J = pin.computeFrameJacobian(
                self._model, self._kinematics, self._whole(row), index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )
            matrix: Array = np.array(J).reshape(6, -1)  # for a single joint Pinocchio drops an axis
            return matrix if self.coupling is None else matrix @ self.coupling.ratio

        return _rowwise(jacobian, q_)

    def frame_drift(self, name: str, q: ArrayLike, v: ArrayLike) -> Array:
        """Return J'(q, v) v, what a frame accelerates by when no joint does.

        Args:
            name: a link, joint or fixed joint.
            q: positions [rad or m], shape (n,) or (batch, n).
            v: velocities [rad/s or m/s], same shape.

        Returns:
            Linear [m/s^2], then angular acceleration [rad/s^2], along the base axes: (6,) or (batch, 6).

        Raises:
            NameNotFound: when there is no such frame.
            ArrayError: when an argument is not as it should be.
        """
        index = self._frame(name)
        q_, v_ = self._states(q=q, v=v)
        still = np.zeros(self._model.nv)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

        def drift(both: Array) -> Array:
            row, speed = np.split(both, 2)
            if self.coupling is not None:
                speed = self.coupling.ratio @ speed
            pin.forwardKinematics(self._model, self._kinematics, self._whole(row), speed, still)
            moved = pin.getFrameClassicalAcceleration(self._model, self._kinematics, index, axes)
            return np.array(moved.vector)

        return _rowwise(drift, np.concatenate([q_, v_], axis=-1))

    def with_payload(
        self, frame: str, mass: float, com: ArrayLike = (0.0, 0.0, 0.0), inertia: ArrayLike | None = None
    ) -> Robot:
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
        centre = _shaped(com, "com", (3,))
        tensor = np.zeros((3, 3)) if inertia is None else _shaped(inertia, "inertia", (3, 3))
        if not np.allclose(tensor, tensor.T) or np.linalg.eigvalsh(tensor)[0] < -1e-12:
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
        return self._changed(change, model=model)

    def with_armature(self, armature: PerJoint) -> Robot:
        """Return the robot with rotor inertia (gear ratio squared times rotor) at its joints.

        Args:
            armature: [kg m^2 or kg], a number, shape (n,), or name -> value (the others keep theirs).
        """
        model = self._model.copy()
        values = self._per_joint(armature, "armature", self.armature, 0.0, sys.float_info.max)
        whole = np.array(model.armature)
        whole[self._own] = values
        model.armature = whole
        return self._changed({"armature": values.tolist()}, model=model)

    def scaled_inertia(self, factor: float) -> Robot:
        """Return the robot with every mass and inertia multiplied by `factor`.

        D, C and G all scale. For a controller that uses D alone (GPI) this is the paper's variation of
        D(q); see ``PIDInversion`` for a law that uses C and G as well.
        """
        factor = as_number(factor, "factor")
        if factor <= 0.0:
            raise ParameterError("factor", factor, "positive")
        model = self._model.copy()
        for index, inertia in enumerate(self._model.inertias):
            # Not a pin.Inertia product: mass and tensor scale, the centre of mass stays.
            model.inertias[index] = pin.Inertia(
                factor * inertia.mass, inertia.lever, factor * inertia.inertia
            )
        model.armature = factor * model.armature
        robot = self._changed({"inertia_scale": factor}, model=model)
        # Not the kernels of the scaled model: rollouts that differ by the factor alone share theirs.
        own = self.dynamics
        base, scale = (own.base, factor * own.scale) if isinstance(own, ScaledDynamics) else (own, factor)
        robot.dynamics = ScaledDynamics(base, scale)
        return robot

    def with_gravity(self, gravity: ArrayLike) -> Robot:
        """Return the robot under another gravity [m/s^2], a vector of shape (3,) in the base frame."""
        model = self._model.copy()
        vector = _shaped(gravity, "gravity", (3,))
        model.gravity = pin.Motion(vector, np.zeros(3))
        return self._changed({"gravity": vector.tolist()}, model=model)

    def with_limits(
        self,
        lower: PerJoint | None = None,
        upper: PerJoint | None = None,
        velocity: PerJoint | None = None,
        effort: PerJoint | None = None,
    ) -> Robot:
        """Return the robot with other limits; each a number, shape (n,), or name -> value.

        Args:
            lower: lowest positions [rad or m].
            upper: highest positions [rad or m].
            velocity: highest speeds [rad/s or m/s].
            effort: highest torques or forces [N m or N].
        """
        given = {"lower": lower, "upper": upper, "velocity": velocity, "effort": effort}
        changed = {key: value for key, value in given.items() if value is not None}
        arrays = {
            key: self._per_joint(
                value,
                key,
                getattr(self.limits, key),
                -math.inf if key in ("lower", "upper") else 0.0,
                math.inf,
            )
            for key, value in changed.items()
        }
        limits = self.limits._replace(**arrays)
        for j, (low, high) in enumerate(zip(limits.lower, limits.upper, strict=True)):
            if low > high:
                raise LimitError("the lower limit", self.joint_names[j], low, -math.inf, high)
        change = {"limits": {key: array.tolist() for key, array in arrays.items()}}
        return self._changed(change, limits=limits)

    def middle(self) -> Array:
        """Return the middle of the joint ranges [rad or m], shape (n,); zero for unbounded joints."""
        lower, upper = self.limits.lower, self.limits.upper
        bounded = np.isfinite(lower) & np.isfinite(upper)
        nearest_zero = np.clip(0.0, lower, upper)
        centre = 0.5 * (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0))
        return np.where(bounded, np.clip(centre, lower, upper), nearest_zero)

    def check_holding(self, q: ArrayLike, what: str) -> None:
        """Refuse configurations at which gravity exceeds a joint's effort limit: nothing holds the arm there.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            what: what they are, for the message ("the start").

        Raises:
            ArrayError: when `q` is not as it should be.
            LimitError: when a joint cannot hold the arm.
        """
        holding = np.atleast_2d(self.gravity(q))
        beyond = np.argwhere(np.abs(holding) > self.limits.effort * (1.0 + 1e-9))
        if beyond.size:
            row, j = (int(i) for i in beyond[0])
            name, effort = self.joint_names[j], float(self.limits.effort[j])
            enough = float(f"{1.5 * abs(holding[row, j]):.3g}")
            raise LimitError(
                f"the torque that holds the arm at {what}",
                name,
                holding[row, j],
                -effort,
                effort,
                "begin elsewhere, or give the joint more with "
                f"robot.with_limits(effort={{{name!r}: {enough:g}}})",
            ).suggesting(Remedy("effort", (name,), enough))

    def random_positions(self, count: int, seed: int = 0) -> Array:
        """Return configurations drawn evenly from the joint ranges [rad or m], shape (count, n).

        Where a range is infinite or huge they are from two turns, or 2 m, to either side of its middle.

        Args:
            count: how many.
            seed: the same seed gives the same configurations.
        """
        lower, upper, middle = self.limits.lower, self.limits.upper, self.middle()
        turns = np.array([kind != "prismatic" for kind in self.joint_types])
        half = 0.5 * np.where(turns, _WIDEST_TURN, _WIDEST_SLIDE)
        lower, upper = np.maximum(lower, middle - half), np.minimum(upper, middle + half)
        # Adding 0 makes -0 to 0: NumPy takes a range from 0 to -0 for a negative one.
        return np.random.default_rng(seed).uniform(lower + 0.0, upper + 0.0, (count, self.n))

    def wrap(self, q: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Return positions with every continuous joint moved by whole turns to within half a turn of `near`.

        Nothing here wraps by itself: a continuous joint is an unbounded angle, and a goal of 6 pi is three
        turns away. This is the choice of the short way.

        Args:
            q: positions [rad or m], shape (n,) or (batch, n).
            near: positions, same shape; zero when not given.
        """
        arguments = {"q": q} if near is None else {"q": q, "near": near}
        q_, *given = self._states(**arguments)
        centre = given[0] if given else np.zeros_like(q_)
        continuous = np.array([kind == "continuous" for kind in self.joint_types])
        turns = np.round((q_ - centre) / (2.0 * math.pi))
        return np.where(continuous, q_ - 2.0 * math.pi * turns, q_)

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"Robot({self.name!r}, n={self.n}, joints={', '.join(self.joint_names)})"

    def _frame(self, name: str) -> int:
        """Return the index of a frame (Pinocchio itself returns a past-the-end index for a typo)."""
        try:
            return self._frames[name]
        except (KeyError, TypeError):
            raise NameNotFound("frame", name, self.frame_names) from None

    def _per_joint(self, value: PerJoint, name: str, current: Array, lowest: float, highest: float) -> Array:
        """Return a per-joint quantity given as a number, an array or name -> value."""
        result = np.array(current)
        if isinstance(value, Mapping):
            for joint, number in value.items():
                if joint not in self.joint_names:
                    raise NameNotFound("joint", joint, self.joint_names)
                index = self.joint_names.index(joint)
                result[index] = as_number(number, f"{name}[{joint!r}]", infinite=True)
        else:
            array = as_float_array(value, name, infinite=True)
            if array.shape not in ((), (1,), (self.n,)):
                raise ArrayError(name, f"expected a number or shape ({self.n},), got {array.shape}")
            result[:] = array
        for j, number in enumerate(result):
            if not lowest <= number <= highest:
                raise LimitError(name, self.joint_names[j], number, lowest, highest)
        return result

    def _changed(self, change: Mapping[str, Any], model: Any = None, limits: Limits | None = None) -> Robot:
        """Return a robot with another model or limits, remembering the change."""
        provenance = {**self.provenance, "changes": [*self.provenance["changes"], dict(change)]}
        robot = Robot(
            self._model.copy() if model is None else model,
            self.name,
            self.joint_types,
            self.limits if limits is None else limits,
            self.friction,
            provenance,
            self.coupling,
            self.joint_names,
        )
        if model is None:  # the same kernels, which a batch of both calls once
            robot.dynamics = self.dynamics
        return robot

    @property
    def _own(self) -> list[int]:
        """Where the n joints stand among the model's coordinates."""
        return [int(self._model.joints[self._model.getJointId(name)].idx_v) for name in self.joint_names]

    def _whole(self, q: Array) -> Array:
        """Return all coordinates of the model for one configuration (n,), following joints included."""
        return q if self.coupling is None else self.coupling.ratio @ q + self.coupling.offset

    def _check_inertia(self, source: str) -> None:
        """Refuse a model whose inertia matrix is not positive definite, naming a joint without inertia."""
        configurations = np.vstack([self.middle(), self.random_positions(_SAMPLES)])
        matrices = self.dynamics.mass_matrix(configurations)
        if not np.isfinite(matrices).all():
            raise UrdfError(source, "has masses and lengths so large that D(q) overflows; check their units")
        eigenvalues, vectors = np.linalg.eigh(matrices)
        bad = eigenvalues[:, 0] <= np.maximum(_SINGULAR * eigenvalues[:, -1], _WEIGHTLESS)
        if not bad.any():
            self._check_digits(configurations, source)
            return
        first = int(np.argmax(bad))
        weightless = eigenvalues[first] <= max(_SINGULAR * eigenvalues[first, -1], _WEIGHTLESS)
        rows = np.abs(vectors[first][:, weightless]).argmax(axis=0)
        joint, *others = dict.fromkeys(self.joint_names[int(row)] for row in rows)
        links = self._links_moved_by(joint)
        alike = f"; nor does {', '.join(map(repr, others[:5]))}" if others else ""
        where = (
            ""
            if first == 0
            else f" at q = {np.array2string(configurations[first], precision=3, max_line_width=10_000)}"
        )
        raise UrdfError(
            source,
            f"joint {joint!r} moves no inertia (links {', '.join(map(repr, links))}), so D(q) is "
            f"singular{where}{alike}; give them mass and inertia, lock the joint, or check its axis",
            joint,
        ).suggesting(Remedy("lock", (joint, *others[:5])))

    def _check_digits(self, configurations: Array, source: str) -> None:
        """Refuse a model whose accelerations lose their digits: lengths of 1e9 m beside others of 1 m."""
        unit = np.ones_like(configurations)
        back = self.dynamics.inertia_solve(configurations, self.dynamics.inertia_times(configurations, unit))
        wrong = np.abs(back - unit).max(axis=0)
        if not (wrong < _WRONG).all():
            joint = self.joint_names[int(np.argmax(np.where(np.isfinite(wrong), wrong, np.inf)))]
            raise UrdfError(
                source,
                "has lengths, masses or inertias so far apart that accelerations are wrong, that of joint "
                f"{joint!r} the most; check their units",
                joint,
            )

    def _links_moved_by(self, joint: str) -> list[str]:
        """Return the links that a joint carries directly."""
        index = self._model.getJointId(joint)
        return [f.name for f in self._model.frames if f.type == pin.FrameType.BODY and f.parentJoint == index]


class RobotBatch(_Checked):
    """One robot per rollout: the same joints, other masses, payloads or limits.

    Row i of every array argument belongs to ``robots[i]``. It goes where a :class:`Robot` goes in a plant
    or a controller.

    Attributes:
        robots: the robots.
        batch: their number.
        limits: arrays of shape (batch, n).
    """

    def __init__(self, robots: Sequence[Robot]) -> None:
        """Stack robots with equal joint names.

        Raises:
            ParameterError: when there are none or their joints differ.
        """
        if not isinstance(robots, Sequence) or not robots or not all(isinstance(r, Robot) for r in robots):
            raise ParameterError("robots", robots, "a sequence of at least one Robot")
        first = robots[0]
        for robot in robots:
            if robot.joint_names != first.joint_names:
                raise ParameterError(
                    "robots", robot, f"robots with the joints {', '.join(first.joint_names)}"
                )
        self.robots = tuple(robots)
        self.name = first.name
        self.joint_names = first.joint_names
        self.joint_types = first.joint_types
        self.batch = len(self.robots)
        self.limits = Limits(
            *(frozen(np.stack(rows)) for rows in zip(*(r.limits for r in robots), strict=True))
        )
        self.friction = Friction(
            *(frozen(np.stack(rows)) for rows in zip(*(r.friction for r in robots), strict=True))
        )
        self.dynamics = stacked([robot.dynamics for robot in self.robots])

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the models came from."""
        return {"robots": [robot.provenance for robot in self.robots]}

    def middle(self) -> Array:
        """Return the middle of the joint ranges [rad or m], shape (batch, n)."""
        return np.stack([robot.middle() for robot in self.robots])

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"RobotBatch({self.batch} x {self.name!r}, n={self.n})"


#: A single robot or one per rollout.
AnyRobot = Robot | RobotBatch

_T = TypeVar("_T")


def _rowwise(function: Callable[[Array], Array], q: Array) -> Array:
    """Apply a function of one configuration to (n,), or to every row of (batch, n)."""
    if q.ndim == 1:
        return function(q)
    if not len(q):
        return function(np.zeros(q.shape[-1]))[np.newaxis][:0]
    return np.stack([function(row) for row in q])


def _coupled(
    limits: Limits,
    friction: Friction,
    coupling: urdf_model.Coupling,
    source: str,
    joints: Sequence[urdf.Joint],
) -> tuple[Limits, Friction]:
    """Return limits and friction of the free joints, with those of the joints that follow them.

    A follower's range and speed bound its leader; its effort does not, as the leader's motor moves both.
    """
    ratio, offset = coupling
    own = [row for row, joint in enumerate(joints) if joint.mimic is None]
    lower, upper, velocity, effort = (limit[own] for limit in limits)
    for row, column in zip(*np.nonzero(ratio), strict=True):
        factor = ratio[row, column]
        ends = np.sort((np.array([limits.lower[row], limits.upper[row]]) - offset[row]) / factor)
        lower[column] = max(lower[column], ends[0])
        upper[column] = min(upper[column], ends[1])
        velocity[column] = min(velocity[column], limits.velocity[row] / abs(factor))
        if lower[column] > upper[column]:
            leader, follower = joints[own[column]].name, joints[row].name
            raise UrdfError(
                source,
                f"joint {follower!r} follows {leader!r}, and no position of that is inside both their "
                "limits; lock it or correct its limits",
                follower,
            )
    viscous, coulomb = ratio.T**2 @ friction.viscous, np.abs(ratio.T) @ friction.coulomb
    return Limits(lower, upper, velocity, effort), Friction(viscous, coulomb)


def _shaped(value: ArrayLike, name: str, shape: tuple[int, ...]) -> Array:
    """Return `value` as an array of exactly `shape`."""
    array = as_float_array(value, name)
    if array.shape != shape:
        raise ArrayError(name, f"expected shape {shape}, got {array.shape}")
    return array
