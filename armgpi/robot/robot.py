"""Robot: an arm's equations of motion, D(q) a + C(q, v) v + G(q) = tau, from its URDF by Pinocchio."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from types import ModuleType
from typing import Any, NoReturn

import numpy as np
import pinocchio as pin

from armgpi.base.arrays import Array, ArrayLike, check_path, check_type, check_whole, frozen
from armgpi.base.escape import counted, html_table
from armgpi.base.hints import ROBOT, loaded_by_name, missing, with_keyword_hints
from armgpi.errors import UrdfError, import_extra
from armgpi.robot import (
    chains,
    from_mujoco,
    from_pinocchio,
    grippers,
    reading,
    robots,
    tree,
    urdf,
    urdf_model,
)
from armgpi.robot.assembly import Assembly
from armgpi.robot.checks import check_inertia
from armgpi.robot.drives import Drives
from armgpi.robot.edits import Edits, parts_of
from armgpi.robot.equations import Friction, Limits
from armgpi.robot.several import VariedRobots

#: Configurations at which D(q) is checked when a robot is loaded, besides the middle of the ranges.
_SAMPLES = 16
#: Width of the range from which positions are drawn where a revolute joint has none or a huge one [rad].
_WIDEST_TURN = 4.0 * math.pi
#: The same for a prismatic joint [m].
_WIDEST_SLIDE = 4.0
#: Most configurations that are drawn at once.
_MOST_POSITIONS = 10_000_000


class Robot(Edits):
    """A fixed-base arm of revolute, continuous and prismatic joints, one coordinate each.

    Frozen: no attribute can be assigned, and the ``with_...`` methods return another robot. Threads may use
    one robot at the same time, and it can be pickled. Load one with :meth:`load`.

    Attributes:
        name: name of the robot.
        joint_names: names of the n joints, in the order of every array.
        joint_types: "revolute", "continuous" or "prismatic", for every joint.
        limits: position, velocity and effort limits.
        friction: joint friction that the URDF states; the equations of motion here leave it out.
        drives: what is known of rotors, gears, motors and encoders (:class:`armgpi.robot.drives.Drives`).
        dynamics: the same equations without checks, for loops of one's own.
        coupling: how joints that follow others (``mimic="follow"``) depend on the n; None when none does.
        provenance: where the model came from and what was done to it, as plain data.
    """

    @loaded_by_name
    def __init__(
        self,
        model: pin.Model,
        name: str,
        joint_types: Sequence[str],
        limits: Limits,
        friction: Friction,
        provenance: Mapping[str, Any],
        coupling: urdf_model.Coupling | None = None,
        joint_names: Sequence[str] | None = None,
        assembly: Assembly | None = None,
        drives: Drives | None = None,
    ) -> None:
        """Take over a `pin.Model` with nq = nv; users call :meth:`load` or :meth:`from_xml`."""
        frames: dict[str, int] = {}
        for index, frame in enumerate(model.frames):
            # Where a link and a joint share a name, the link's frame is the one people mean.
            if index and (frame.name not in frames or frame.type == pin.FrameType.BODY):
                frames[frame.name] = index
        joint_names = tuple(list(model.names)[1:] if joint_names is None else joint_names)
        vars(self).update(
            name=name,
            joint_names=joint_names,
            joint_types=tuple(joint_types),
            limits=Limits(*map(frozen, limits)),
            friction=Friction(*map(frozen, friction)),
            coupling=coupling,
            drives=Drives(joint_names) if drives is None else drives,
            _provenance=copy.deepcopy(dict(provenance)),
            _assembly=assembly,
            _frames=frames,
            **parts_of(model, coupling),
        )

    @classmethod
    @with_keyword_hints
    def load(
        cls,
        path_or_name: str | PathLike[str] | ModuleType | pin.Model,
        lock: Sequence[str] | Mapping[str, float] = (),
        keep: Sequence[str] | None = None,
        mimic: urdf_model.Mimic = "lock",
        repair: str | Iterable[str] = (),
    ) -> Robot:
        """Load a robot from a URDF file, or by one of the names of `armgpi robots`.

        Args:
            path_or_name: path of a URDF, of an MJCF (:meth:`from_mjcf`), or of a folder that
                ``armgpi identify`` wrote; a name from :func:`armgpi.robot.robots.names`, or a module of
                robot_descriptions. A `pin.Model` or its wrapper is taken by :meth:`from_pinocchio`, and the
                text of a URDF by :meth:`from_xml`.
            lock: joints to hold fixed: names (held at zero, or at the limit nearest to it) or
                name -> value [rad or m].
            keep: when given, every joint that is not named here is locked; the name of a chain of a whole
                robot ("left_arm") means its joints (``armgpi/robot/chains.py``). A name that means an arm of
                a larger robot (``baxter_left_arm``) keeps that arm by itself.
            mimic: joints that mimic another are locked where its zero (or lock) puts them; with "follow"
                they move with it, and their inertia and weight are felt by it.
            repair: names of repairs that may be made in the file (:mod:`armgpi.robot.repairs`), or "all".
                A refusal names the one that helps; ``provenance["repairs"]`` says what was there before.

        Raises:
            NameNotFound: for a robot, joint or repair that does not exist.
            UrdfError: for a file that is no usable URDF.
        """
        if isinstance(getattr(path_or_name, "model", path_or_name), pin.Model):
            return cls.from_pinocchio(path_or_name, lock, keep)
        if isinstance(path_or_name, str) and path_or_name.lstrip("\ufeff \t\r\n").startswith("<"):
            return cls.from_xml(path_or_name, lock, keep, mimic, repair)
        return cls._from_file(path_or_name, lock, keep, mimic, repair)[0]

    @classmethod
    def _from_file(
        cls,
        path_or_name: str | PathLike[str] | ModuleType,
        lock: Sequence[str] | Mapping[str, float],
        keep: Sequence[str] | None,
        mimic: urdf_model.Mimic,
        repair: str | Iterable[str],
    ) -> tuple[Robot, urdf.Urdf]:
        """Return the robot of a file, and what the file contains; arguments and errors as :meth:`load`."""
        if (found := robots.find_identified(path_or_name)) is not None:
            given = found.section(lock, repair)
            robot, document = cls._from_file(given["name"], given["lock"], keep, mimic, given["repair"])
            return robot.with_drives(Drives.read(found.drives, robot.joint_names)), document
        path, name = robots.locate(path_or_name)
        document = reading.read(path, repair)
        if name is not None and keep is None:
            keep = robots.kept(name, (j.name for j in document.joints.values() if j.moves), lock)
        robot = cls._from_document(document, name or document.name, lock, keep, mimic)
        from_mujoco.check_same(robot, document)
        return robot, document

    @classmethod
    def from_xml(
        cls,
        text: str,
        lock: Sequence[str] | Mapping[str, float] = (),
        keep: Sequence[str] | None = None,
        mimic: urdf_model.Mimic = "lock",
        repair: str | Iterable[str] = (),
    ) -> Robot:
        """Load a robot from the text of a URDF; arguments and errors as :meth:`load`.

        Args:
            text: the URDF.
            lock: joints to hold fixed, as in :meth:`load`.
            keep: joints to keep; all others are locked.
            mimic: "lock" or "follow", as in :meth:`load`.
            repair: names of repairs that may be made, or "all".

        Raises:
            UrdfError: for what is no usable URDF.
            NameNotFound: for a joint that the arm does not have.
        """
        check_type(text, "text", str, "the text of a URDF")
        document = urdf.parse(text, "URDF text", repair)
        return cls._from_document(document, document.name, lock, keep, mimic)

    @classmethod
    def from_pinocchio(
        cls,
        model: pin.Model,
        lock: Sequence[str] | Mapping[str, float] = (),
        keep: Sequence[str] | None = None,
    ) -> Robot:
        """Take over a `pin.Model`, or that of a `pin.RobotWrapper`, with limits, rotor inertia and gravity.

        Frames keep their names. Its joints are revolute, continuous or prismatic, or are locked.

        Args:
            model: the model; it is not changed, and may be changed afterwards.
            lock: joints to hold fixed, as for :meth:`load`.
            keep: when given, every joint that is not named here is locked.

        Raises:
            ParameterError: when it is no model.
            UrdfError: for a joint, an inertia or a limit that armgpi cannot have; it names the joint.
        """
        own = from_pinocchio.model_of(model)
        document = from_pinocchio.read(own)
        robot = cls._from_document(document, document.name, lock, keep, "lock")
        values = {**robot.provenance["locked"], **dict(zip(robot.joint_names, robot.middle(), strict=True))}
        from_pinocchio.check_same(own, robot, from_pinocchio.tangent_of(own, values))
        return robot

    @classmethod
    def from_mjcf(
        cls,
        path: str | PathLike[str],
        lock: Sequence[str] | Mapping[str, float] = (),
        keep: Sequence[str] | None = None,
        mimic: urdf_model.Mimic = "lock",
    ) -> Robot:
        """Load a robot from a MuJoCo model, with rotor inertia, friction, limits, efforts of its actuators.

        MuJoCo compiles it, so it is needed; D(q) and C v + G are compared with MuJoCo's. Equality constraints
        in proportion are mimic joints. A joint without a name is called "joint" and its index.

        Args:
            path: of the file.
            lock: joints to hold fixed, as for :meth:`load`; free bases have to be.
            keep: when given, every joint that is not named here is locked.
            mimic: as for :meth:`load`.

        Raises:
            MissingPackage: when MuJoCo is not installed.
            UrdfError: for a file that cannot be read, or has what no rigid arm has; the message names it.
        """
        source = check_path(path, "path")
        import_extra("mujoco", "mujoco")  # said before anything about the file
        document = from_mujoco.read(source, urdf.read_file(source))
        robot = cls._from_document(document, document.name, lock, keep, mimic)
        from_mujoco.check_same(robot, document)
        return robot

    @classmethod
    def _from_document(
        cls,
        document: urdf.Urdf,
        name: str,
        lock: Sequence[str] | Mapping[str, float],
        keep: Sequence[str] | None,
        mimic: urdf_model.Mimic,
    ) -> Robot:
        """Return the robot of a file or model that was read, its joints locked."""
        built = urdf_model.build(document, lock, chains.expand(document, keep), mimic)
        source, joints = document.source, built.joints
        drives = Drives.from_urdf(document.root, source, [joint.name for joint in joints])
        _set_rotors(built, drives)
        limits, friction = _limits_and_friction(joints)
        if built.coupling is not None:
            limits, friction = _couple_limits(limits, friction, built.coupling, source, joints)
            joints = tuple(joint for joint in joints if joint.mimic is None)
        names = [joint.name for joint in joints]
        robot = cls(
            built.model,
            name,
            [joint.type for joint in joints],
            limits,
            friction,
            _provenance(document, built),
            built.coupling,
            names,
            built.assembly,
            _with_friction(drives.of(names), friction, source),
        )
        configurations = np.vstack([robot.middle(), robot.random_positions(_SAMPLES)])
        check_inertia(robot, configurations, source)
        return robot._with_rotors_of(document)

    def _with_rotors_of(self, document: urdf.Urdf) -> Robot:
        """Return the robot with the rotor inertia and gravity that a compiled model states."""
        robot = self
        rotors = {name: document.armature.get(name, 0.0) for name in robot.joint_names}
        if any(rotors.values()):
            robot = robot.with_armature(rotors)
        if document.gravity not in (None, tuple(robot._model.gravity.linear)):
            robot = robot.with_gravity(document.gravity)
        return robot

    @property
    def total_mass(self) -> float:
        """Mass of everything, the base included [kg]."""
        return float(sum(inertia.mass for inertia in self._model.inertias))

    @property
    def moving_mass(self) -> float:
        """Mass of the links that move [kg]."""
        return float(sum(inertia.mass for inertia in self._model.inertias[1:]))

    def varied(
        self,
        *,
        payload: ArrayLike | None = None,
        com: ArrayLike | None = None,
        frame: str | None = None,
        inertia_scale: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        viscous: ArrayLike | None = None,
        coulomb: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> VariedRobots:
        """Return this robot with other numbers in each rollout of a batch, all worked out at once.

        The first axis of every array is the rollouts. What is given varies, whatever its numbers are, so that
        generated code for it is made once.

        Args:
            payload: mass of a load that comes on top of what the robot has [kg], shape (batch,).
            com: its centre of mass in the frame [m], shape (batch, 3) or (3,); the origin when not given.
            frame: the its frame; the robot's tip when not given.
            inertia_scale: factor of the robot's own masses and inertias [-], shape (batch,); the load and
                rotor inertia given here are not scaled.
            rotor_inertia: at the joints, in place of the robot's [kg m^2 or kg], shape (batch,) or
                (batch, n).
            viscous: viscous friction [N m s/rad or N s/m], likewise.
            coulomb: Coulomb friction [N m or N], likewise.
            effort: effort limits [N m or N], likewise.
            gravity: acceleration of free fall in the base frame [m/s^2], shape (batch, 3) or (3,).

        Raises:
            ArrayError: for another shape, a value that is too small, or numbers of rollouts that differ.
            NameNotFound: when there is no such frame.
            ParameterError: when nothing varies, or a centre or frame is given without a load.
        """
        given = {"payload": payload, "com": com, "inertia_scale": inertia_scale, "gravity": gravity}
        given |= {"rotor_inertia": rotor_inertia, "viscous": viscous, "coulomb": coulomb, "effort": effort}
        return VariedRobots(self, frame, **given)

    def pinocchio_model(self) -> Any:
        """Return a copy of the `pin.Model`, with its limits, for what this class does not offer.

        With joints that follow others it has their coordinates too, ``coupling.ratio @ q + coupling.offset``,
        and no limits.
        """
        model = self._model.copy()
        if self.coupling is None:
            model.lowerPositionLimit, model.upperPositionLimit = self.limits.lower, self.limits.upper
            model.velocityLimit, model.effortLimit = self.limits.velocity, self.limits.effort
        return model

    def random_positions(self, count: int, seed: int = 0) -> Array:
        """Return configurations drawn evenly from the joint ranges [rad or m], shape (count, n).

        Where a range is infinite or huge they are from two turns, or 2 m, to either side of its middle.

        Args:
            count: how many.
            seed: the same seed gives the same configurations.

        Raises:
            ParameterError: when one is no whole number, or negative.
        """
        count = check_whole(count, "count", 0, _MOST_POSITIONS)
        seed = check_whole(seed, "seed", 0)
        lower, upper, middle = self.limits.lower, self.limits.upper, self.middle()
        half = 0.5 * np.where(self.prismatic, _WIDEST_SLIDE, _WIDEST_TURN)
        lower, upper = np.maximum(lower, middle - half), np.minimum(upper, middle + half)
        # Adding 0 makes -0 to 0: NumPy takes a range from 0 to -0 for a negative one.
        return np.random.default_rng(seed).uniform(lower, upper + 0.0, (count, self.n))

    def _repr_html_(self) -> str:
        """Return its joints as a table, for notebooks."""
        head = ("joint", "type", "lower", "upper", "velocity", "effort", "rotor inertia")
        values = np.stack([*self.limits, self.armature], axis=-1)
        rows = [
            (joint, kind, *(f"{value:.4g}" for value in row))
            for joint, kind, row in zip(self.joint_names, self.joint_types, values, strict=True)
        ]
        return html_table(f"{self.name}: {counted(self.n, 'joint')}, {self.total_mass:.4g} kg", head, rows)

    def __getattr__(self, name: str) -> NoReturn:
        """Name what to use in place of an attribute that does not exist."""
        if name.startswith("_"):  # Python itself asks for these
            raise AttributeError(f"'Robot' object has no attribute {name!r}")
        raise AttributeError(missing("'Robot' object", name, ROBOT, dir(type(self))))

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"Robot({self.name!r}, n={self.n}, joints={', '.join(self.joint_names)})"


def _provenance(document: urdf.Urdf, built: urdf_model.Built) -> dict[str, Any]:
    """Return where a robot comes from; with its grippers, and its chains where there are several."""
    found: dict[str, Any] = {
        "source": document.source,
        "sha256": document.sha256,
        "locked": dict(built.locked),
        "changes": [],
    }
    if built.coupling is not None:
        found["mimic"] = "follow"
    fingers = [joint for gripper in grippers.find(document, built.locked) for joint in gripper.joints]
    if fingers:
        found["grippers"] = fingers
    if len(several := chains.of_arms(document, built.locked, fingers)) > 1:
        found["chains"] = {chain.name: list(chain.joints) for chain in several}
    if built.repairs:
        found["repairs"] = [made._asdict() for made in built.repairs]
    return found


def _set_rotors(built: urdf_model.Built, drives: Drives) -> None:
    """Give a model the rotor inertia that its file states."""
    model = built.model
    for joint, inertia in zip(built.joints, drives.value("rotor_inertia", 0.0), strict=True):
        row = model.joints[model.getJointId(joint.name)].idx_v
        model.armature[row] = inertia


def _limits_and_friction(joints: Sequence[tree.Joint]) -> tuple[Limits, Friction]:
    """Return what the joints of a file state, in their order."""

    def each(name: str) -> Array:
        return np.array([getattr(joint, name) for joint in joints])

    limits = Limits(each("lower"), each("upper"), each("velocity"), each("effort"))
    return limits, Friction(each("damping"), each("friction"))


def _with_friction(drives: Drives, friction: Friction, source: str) -> Drives:
    """Return drives with the friction of the joints that have some, as stated by a file."""
    for key, values in friction._asdict().items():
        stated = {joint: value for joint, value in zip(drives.joint_names, values, strict=True) if value}
        drives = drives.with_value(key, stated, file=source)
    return drives


def _couple_limits(
    limits: Limits,
    friction: Friction,
    coupling: urdf_model.Coupling,
    source: str,
    joints: Sequence[tree.Joint],
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


def load_with_document(
    path_or_name: str | PathLike[str] | ModuleType,
    lock: Sequence[str] | Mapping[str, float] = (),
    keep: Sequence[str] | None = None,
    mimic: urdf_model.Mimic = "lock",
    repair: str | Iterable[str] = (),
) -> tuple[Robot, urdf.Urdf]:
    """Return the robot of a file, and what the file contains, which is read once.

    Arguments and errors are those of :meth:`Robot.load`.
    """
    return Robot._from_file(path_or_name, lock, keep, mimic, repair)
