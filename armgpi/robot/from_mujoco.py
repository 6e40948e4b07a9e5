"""From a MuJoCo model (MJCF) to a :class:`Urdf`, by the arrays of the model that MuJoCo compiles.

So includes, classes of defaults, frames and attachments are MuJoCo's business. What a tree of rigid bodies
does not have (springs, loops, tendons that pull) is refused, unless the joints that it acts on are locked.
"""

from __future__ import annotations

import hashlib
import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from armgpi.base import files
from armgpi.base.arrays import Array
from armgpi.errors import ArmgpiWarning, UrdfError, import_extra
from armgpi.robot import mjcf_files, urdf
from armgpi.robot.tree import Joint, Link
from armgpi.robot.urdf import Coupled, Urdf

#: By how much D(q) and C v + G may differ from MuJoCo's, of the largest number: rounding of rotations.
_SAME = 1e-10
#: Configurations at which they are compared.
_LOOKS = 5
#: What MuJoCo says of a mesh or texture that it does not find.
_MISSING = re.compile(r"Error opening file '([^']*)'")
_ZEROS = (0.0, 0.0, 0.0)
_NO_INERTIA = (0.0,) * 6


def is_mjcf(text: str) -> bool:
    """Tell whether the text of a file is that of a MuJoCo model: by its first element."""
    begun = text.find("<")
    while begun >= 0 and text.startswith(("<!", "<?"), begun):  # a comment, or a declaration
        is_comment = text.startswith("<!--", begun)
        last = "-->" if is_comment else ">"
        end = text.find(last, begun + 4 if is_comment else begun)
        if end < 0:
            return False
        begun = text.find("<", end + len(last))
    return begun >= 0 and text.startswith("<mujoco", begun)


def read(path: Path, text: str) -> Urdf:
    """Return the tree of an MJCF file, with rotor inertia, friction, limits and its actuators' efforts.

    Args:
        path: of the file; what it includes is found from there.
        text: what is in it, for the hash.

    Raises:
        MissingPackage: when MuJoCo is not installed.
        UrdfError: when MuJoCo refuses it, or a joint is none that an arm has; it names the joint.
    """
    import_extra("mujoco", "mujoco")
    others = mjcf_files.check(path)  # which refuses what is no regular file, where MuJoCo would wait
    reader = _Reader(_compiled(path), path)
    return reader.document(_hash(path, text, others))


def _hash(path: Path, text: str, others: Sequence[Path]) -> str:
    """Return the SHA-256 of a model: of its text, and of the files that its bodies depend on.

    That of a model in a single file is that file's. Of several it depends on what is in them alone, so that a
    copy of the folder is the same model.

    Raises:
        UrdfError: when one of them cannot be read any more.
    """
    digest = hashlib.sha256(text.encode())
    contents = set()
    for other in others:
        try:
            content = files.read_bytes(other, mjcf_files.MOST)
        except OSError as error:
            raise UrdfError(path, f"names a file that cannot be read: {files.reason(error)}") from None
        contents.add(hashlib.sha256(content).digest())
    for content in sorted(contents):
        digest.update(content)
    return digest.hexdigest()


def _compiled(path: Path) -> Any:
    """Return the `mujoco.MjModel` of a file whose names were checked; errors as for :func:`read`."""
    mujoco = import_extra("mujoco", "mujoco")
    # Or its warnings would be printed, and written into a file of the folder that one stands in.
    handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        return mujoco.MjModel.from_xml_path(str(path.absolute()))
    except (ValueError, TypeError) as error:  # TypeError for a name that is no text
        reason = " ".join(str(error).split())
        if missing := _MISSING.search(reason):
            way = "copy it to where <compiler> says (meshdir, texturedir, assetdir), or else beside the model"
            raise UrdfError(path, f"names the file {missing[1]!r}, which is not there: {way}") from None
        raise UrdfError(path, f"MuJoCo cannot read it: {reason.removeprefix('Error: ')}") from None
    finally:
        mujoco.set_mju_user_warning(handler)


def fluid(model: Any) -> str:
    """Return what to say of the fluid around the arm of a `mujoco.MjModel`; empty where there is none."""
    option = model.opt
    is_there = option.density > 0.0 or option.viscosity > 0.0
    if not (is_there and _is_passive(model)):
        return ""
    numbers = f"density {option.density:g} kg/m^3, viscosity {option.viscosity:g} Pa s"
    return f"the forces of the fluid around the arm are left out ({numbers}), which MuJoCo adds"


def _acts(model: Any, *parts: str) -> bool:
    """Tell whether parts of MuJoCo's equations act: none of them is switched off by `<option><flag>`.

    Args:
        model: the `mujoco.MjModel`.
        parts: as in `mjtDisableBit`, without `mjDSBL_`; one that this version does not have acts.
    """
    bits = import_extra("mujoco", "mujoco").mjtDisableBit
    off = int(model.opt.disableflags)
    flags = [int(getattr(bits, f"mjDSBL_{part}", 0)) for part in parts]
    return not any(off & flag for flag in flags)


def _is_passive(model: Any) -> bool:
    """Tell whether forces act that are neither constraints nor actuators: some, if not springs."""
    return _acts(model, "PASSIVE") and (_acts(model, "SPRING") or _acts(model, "DAMPER"))


class _Reader:
    """Reads the tree of one compiled model.

    Attributes:
        model: the `mujoco.MjModel`.
        source: its file, for messages.
        bodies: name of the link of every body; the world is "world".
        joint_names: name of every joint; one without a name is called by its index.
        parents: the body that carries each body.
        joint_bodies: the body that each joint moves.
        position_rows: where each joint's first coordinate stands in qpos.
        velocity_rows: where its first velocity stands in qvel.
    """

    def __init__(self, model: Any, source: Path) -> None:
        """Name bodies and joints."""
        mujoco = import_extra("mujoco", "mujoco")
        self.model, self.source = model, source
        self.kinds = {
            int(mujoco.mjtJoint.mjJNT_HINGE): "revolute",
            int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic",
            int(mujoco.mjtJoint.mjJNT_FREE): "floating",
        }
        self.bodies = _body_names(model)
        self.joint_names = _joint_names(model)
        self.parents = _whole(model.body_parentid)
        self.joint_bodies = _whole(model.jnt_bodyid)
        self.position_rows = _whole(model.jnt_qposadr)
        self.velocity_rows = _whole(model.jnt_dofadr)
        self.links: dict[str, Link] = {}
        self.joints: dict[str, Joint] = {}

    def document(self, sha256: str) -> Urdf:
        """Return the whole tree of a model with a hash."""
        model = self.model
        self.mimics = self._mimics()
        self.efforts = self._efforts()
        skipped = self._targets()
        for body in range(model.nbody):
            if body not in skipped:
                self._body(body)
        self._sites(skipped)
        rotors = {}
        for joint, name in enumerate(self.joint_names):
            if self.joints[name].moves:
                rotors[name] = float(model.dof_armature[self.velocity_rows[joint]])
        gravity = _numbers(model.opt.gravity) if self._acts("GRAVITY") else _ZEROS
        name = _model_name(model) or "unnamed"
        if around := fluid(model):
            warnings.warn(f"{self.source}: {around}", ArmgpiWarning, stacklevel=2)
        return urdf.assemble(
            source=str(self.source),
            name=name,
            sha256=sha256,
            root=urdf.elements(name, self.links, self.joints),
            links=self.links,
            joints=self.joints,
            armature=rotors,
            gravity=gravity,
            coupled=tuple(self._more_than_an_arm()),
            compiled=model,
        )

    def _acts(self, *parts: str) -> bool:
        """Tell whether parts of MuJoCo's equations act; see :func:`_acts`."""
        return _acts(self.model, *parts)

    def _targets(self) -> set[int]:
        """Return mocap bodies, which are targets to drag, with all below them; none with a joint below it."""
        model = self.model
        skipped: set[int] = set()
        for body in range(1, model.nbody):
            if model.body_mocapid[body] < 0:
                continue
            below = [other for other in range(model.nbody) if body in self._above(other)]
            if not set(self.joint_bodies).intersection(below):
                skipped.update(below)
        return skipped

    def _above(self, body: int) -> list[int]:
        """Return a body and those that carry it, without the world."""
        above = []
        while body:
            above.append(body)
            body = self.parents[body]
        return above

    def _body(self, body: int) -> None:
        """Add the link of a body, and its joints."""
        model, name = self.model, self.bodies[body]
        mass = float(model.body_mass[body])
        xx, yy, zz = _numbers(model.body_inertia[body])
        xyz = _numbers(model.body_ipos[body])
        rpy = _rpy(_rotation(model.body_iquat[body]))
        inertia = (xx, 0.0, 0.0, yy, 0.0, zz)
        self.links[name] = Link(name, mass, xyz, rpy, inertia, mass > 0.0, ())
        if body == 0:
            return
        parent = self.bodies[self.parents[body]]
        place = _place(model.body_pos[body], model.body_quat[body])
        first = int(model.body_jntadr[body])
        end = first + int(model.body_jntnum[body])
        for joint in range(first, end):
            # An axis beside the origin of its body: the body is a fixed link behind it.
            is_at_origin = not np.any(model.jnt_pos[joint]) or self._kind(joint) == "floating"
            ends_here = joint == end - 1 and is_at_origin
            link = name if ends_here else f"{name} ({self.joint_names[joint]})"
            place = self._joint(joint, parent, link, place)
            if not ends_here:
                self._add_frame(link)
            parent = link
            if ends_here:
                return
        fixed = f"{name} (fixed)"
        self.joints[fixed] = Joint(fixed, "fixed", parent, name, *_xyz_rpy(place))

    def _kind(self, joint: int) -> str | None:
        """Return the type of a joint as a URDF has it; None for a ball joint."""
        return self.kinds.get(int(self.model.jnt_type[joint]))

    def _add_frame(self, name: str) -> None:
        """Add a link without mass."""
        self.links[name] = Link(name, 0.0, _ZEROS, _ZEROS, _NO_INERTIA, False, ())

    def _joint(self, joint: int, parent: str, child: str, place: Any) -> Any:
        """Add a joint on a body at `place` on its parent; return the place of the body on the child."""
        model, name = self.model, self.joint_names[joint]
        kind = self._kind(joint)
        if kind is None:
            raise UrdfError(
                self.source,
                f"joint {name!r} is a ball joint; armgpi needs hinges and slides: write three hinges in its "
                "place, or take it out",
                name,
            )
        if kind == "floating":
            self.joints[name] = Joint(name, kind, parent, child, *_xyz_rpy(place))
            return pin.SE3.Identity()
        anchor = np.array(model.jnt_pos[joint])
        axis = np.array(model.jnt_axis[joint])
        # The pose that the file shows is that of qpos0.
        back = -self._shown_position(joint) * axis
        turned_back, moved_back = np.eye(3), np.zeros(3)
        if kind == "prismatic":
            moved_back = back
        else:
            turned_back = pin.exp3(back)
        shift = pin.SE3(np.eye(3), anchor) * pin.SE3(turned_back, moved_back)
        lower, upper = -math.inf, math.inf
        if model.jnt_limited[joint] and self._acts("LIMIT", "CONSTRAINT"):
            lower, upper = _numbers(model.jnt_range[joint])
        elif kind == "revolute":
            kind = "continuous"
        leader, ratio, offset = self.mimics.get(name, (None, 1.0, 0.0))
        row = self.velocity_rows[joint]
        damping = float(np.ravel(model.dof_damping[row])[0])
        friction = float(model.dof_frictionloss[row])
        self.joints[name] = Joint(
            name,
            kind,
            parent,
            child,
            *_xyz_rpy(place * shift),
            axis=_numbers(axis),
            lower=lower,
            upper=upper,
            effort=float(self.efforts[joint]),
            damping=damping * self._acts("PASSIVE", "DAMPER"),
            friction=friction * self._acts("FRICTIONLOSS", "CONSTRAINT"),
            mimic=leader,
            mimic_multiplier=ratio,
            mimic_offset=offset,
        )
        return pin.SE3(np.eye(3), -anchor)

    def _shown_position(self, joint: int) -> float:
        """Return the first coordinate of a joint in the pose that the file shows [rad or m]."""
        return float(self.model.qpos0[self.position_rows[joint]])

    def _sites(self, skipped: set[int]) -> None:
        """Add the sites that have a name, as frames."""
        model = self.model
        for site in range(model.nsite):
            name = model.site(site).name
            body = int(model.site_bodyid[site])
            joint = f"{name} (site)"
            if not name or body in skipped or name in self.links or joint in self.joints:
                continue
            self._add_frame(name)
            xyz, rpy = _xyz_rpy(_place(model.site_pos[site], model.site_quat[site]))
            self.joints[joint] = Joint(joint, "fixed", self.bodies[body], name, xyz, rpy)

    def _efforts(self) -> Array:
        """Return the largest force of the actuators of each joint [N m or N]; infinite without any."""
        model = self.model
        efforts = np.zeros(model.njnt)
        for actuator in range(model.nu):
            driven = self._driven_by(actuator)
            if driven is None:
                continue
            joint, arm = driven
            lever = abs(model.actuator_gear[actuator, 0] * arm)
            if arm:
                efforts[joint] += lever * self._largest_force(actuator)
        for joint in range(model.njnt):
            if model.jnt_actfrclimited[joint]:
                most = np.abs(model.jnt_actfrcrange[joint]).max()
                efforts[joint] = min(efforts[joint] or np.inf, most)
        return np.where(efforts > 0.0, efforts, np.inf)

    def _driven_by(self, actuator: int) -> tuple[int, float] | None:
        """Return the only joint that an actuator drives, and its lever [m or 1]; None where there is none."""
        transmissions = import_extra("mujoco", "mujoco").mjtTrn
        kind = int(self.model.actuator_trntype[actuator])
        place = int(self.model.actuator_trnid[actuator, 0])
        if kind in (int(transmissions.mjTRN_JOINT), int(transmissions.mjTRN_JOINTINPARENT)):
            return place, 1.0
        if kind == int(transmissions.mjTRN_TENDON):
            return self._led_by(place)
        return None

    def _largest_force(self, actuator: int) -> float:
        """Return the largest force of an actuator without its gear; infinite where nothing limits it."""
        model = self.model
        if model.actuator_forcelimited[actuator]:
            return float(np.abs(model.actuator_forcerange[actuator]).max())
        is_motor = not np.any(model.actuator_biasprm[actuator])
        if not (model.actuator_ctrllimited[actuator] and is_motor):
            return math.inf
        largest_control = np.abs(model.actuator_ctrlrange[actuator]).max()
        return float(largest_control * abs(model.actuator_gainprm[actuator, 0]))

    def _led_by(self, tendon: int) -> tuple[int, float] | None:
        """Return the only joint that a tendon moves, with those that follow it, and its lever [m or 1].

        None for a tendon through sites, and for one that moves several joints.
        """
        wraps = self._wraps(tendon)
        if not self._wraps_joints(wraps):
            return None
        levers: dict[str, float] = {}
        for wrap in wraps:
            name = self._wrapped(wrap)
            leader, ratio, _ = self.mimics.get(name, (name, 1.0, 0.0))
            levers.setdefault(leader, 0.0)
            levers[leader] += ratio * float(self.model.wrap_prm[wrap])
        if len(levers) != 1:
            return None
        ((name, lever),) = levers.items()
        return self.joint_names.index(name), lever

    def _mimics(self) -> dict[str, tuple[str, float, float]]:
        """Return the joints that follow another in proportion: name -> leader, ratio and offset."""
        mimics: dict[str, tuple[str, float, float]] = {}
        for equality in self._equalities("mjEQ_JOINT"):
            follower, leader = self._ends(equality)
            constant, ratio, *powers = _numbers(self.model.eq_data[equality][:5])
            if leader < 0 or any(powers):
                continue
            offset = constant + self._shown_position(follower) - ratio * self._shown_position(leader)
            mimics[self.joint_names[follower]] = (self.joint_names[leader], ratio, offset)
        return mimics

    def _ends(self, equality: int) -> tuple[int, int]:
        """Return the two objects of an equality constraint; -1 for one that is not there."""
        return int(self.model.eq_obj1id[equality]), int(self.model.eq_obj2id[equality])

    def _equalities(self, kind: str) -> list[int]:
        """Return the equality constraints of one kind that are active."""
        mujoco, model = import_extra("mujoco", "mujoco"), self.model
        if not self._acts("EQUALITY", "CONSTRAINT"):
            return []
        is_of_kind = np.array(model.eq_type) == int(getattr(mujoco.mjtEq, kind))
        return _whole(np.flatnonzero(is_of_kind & np.array(model.eq_active0, dtype=bool)))

    def _more_than_an_arm(self) -> Iterator[Coupled]:
        """Give what equations of rigid bodies on a tree do not have, with the joints that it acts on."""
        model = self.model
        for joint in range(model.njnt):
            if np.any(model.jnt_stiffness[joint]) and self._acts("PASSIVE", "SPRING"):
                yield Coupled("a spring", (self.joint_names[joint],))
        for body in range(1, model.nbody):
            if model.body_gravcomp[body] and self._acts("GRAVITY") and _is_passive(model):
                joints = self._joints_of(self._above(body))
                yield Coupled(f"gravity compensated (gravcomp) at body {self.bodies[body]!r}", joints)
        yield from self._constraints()
        yield from self._tendons()

    def _tendons(self) -> Iterator[Coupled]:
        """Give the tendons that are no drive of one joint."""
        mujoco, model = import_extra("mujoco", "mujoco"), self.model
        actuators = _names([model.actuator(a).name for a in range(model.nu)], "actuator")
        tendons = _names([model.tendon(t).name for t in range(model.ntendon)], "tendon")
        for actuator, name in enumerate(actuators):
            tendon = int(model.actuator_trnid[actuator, 0])
            is_by_tendon = model.actuator_trntype[actuator] == int(mujoco.mjtTrn.mjTRN_TENDON)
            if is_by_tendon and self._led_by(tendon) is None:
                drive = f"actuator {name!r} on tendon {tendons[tendon]!r}, one force for several joints"
                yield Coupled(drive, self._joints_of_tendon(tendon))
        pulls = [model.tendon_stiffness] if self._acts("PASSIVE", "SPRING") else []
        pulls += [model.tendon_damping] if self._acts("PASSIVE", "DAMPER") else []
        pulls += [model.tendon_frictionloss] if self._acts("FRICTIONLOSS", "CONSTRAINT") else []
        pulls += [model.tendon_limited] if self._acts("LIMIT", "CONSTRAINT") else []
        for tendon, name in enumerate(tendons):
            if any(np.any(numbers[tendon]) for numbers in pulls):
                pulling = f"tendon {name!r}, which pulls by itself"
                yield Coupled(pulling, self._joints_of_tendon(tendon))

    def _constraints(self) -> Iterator[Coupled]:
        """Give the equality constraints that are no mimic joints."""
        for equality in self._equalities("mjEQ_JOINT"):
            ends = self._ends(equality)
            if self.joint_names[ends[0]] not in self.mimics:
                names = tuple(self.joint_names[joint] for joint in ends if joint >= 0)
                yield Coupled("an equality constraint that is no ratio between two joints", names)
        for kind, element in (("mjEQ_CONNECT", "connect"), ("mjEQ_WELD", "weld")):
            for equality in self._equalities(kind):
                yield self._loop(equality, element)
        if self._equalities("mjEQ_TENDON"):
            yield Coupled("an equality constraint of tendons", tuple(self.joint_names))

    def _loop(self, equality: int, element: str) -> Coupled:
        """Return a constraint between two bodies, with the joints between them."""
        mujoco, model = import_extra("mujoco", "mujoco"), self.model
        ends = list(self._ends(equality))
        if int(model.eq_objtype[equality]) == int(mujoco.mjtObj.mjOBJ_SITE):
            ends = [int(model.site_bodyid[site]) for site in ends]
        first, second = (set(self._above(body)) for body in ends)
        names = " and ".join(repr(self.bodies[body]) for body in ends)
        joints = self._joints_of(sorted(first ^ second))
        return Coupled(f"a loop: <{element}> of the bodies {names}", joints)

    def _joints_of(self, bodies: list[int]) -> tuple[str, ...]:
        """Return the names of the joints of some bodies."""
        owners = zip(self.joint_names, self.joint_bodies, strict=True)
        return tuple(name for name, body in owners if body in bodies)

    def _joints_of_tendon(self, tendon: int) -> tuple[str, ...]:
        """Return the names of the joints that a tendon may pull at: of one through sites, all."""
        wraps = self._wraps(tendon)
        if not self._wraps_joints(wraps):
            return tuple(self.joint_names)
        return tuple(self._wrapped(wrap) for wrap in wraps)

    def _wraps(self, tendon: int) -> range:
        """Return what a tendon runs along, as MuJoCo numbers it."""
        first = int(self.model.tendon_adr[tendon])
        return range(first, first + int(self.model.tendon_num[tendon]))

    def _wraps_joints(self, wraps: range) -> bool:
        """Tell whether a tendon runs along joints alone: none is through sites or around geometries."""
        of_joint = int(import_extra("mujoco", "mujoco").mjtWrap.mjWRAP_JOINT)
        return all(int(self.model.wrap_type[wrap]) == of_joint for wrap in wraps)

    def _wrapped(self, wrap: int) -> str:
        """Return the name of the joint that a tendon runs along."""
        return self.joint_names[int(self.model.wrap_objid[wrap])]


def poses(document: Urdf, values: Mapping[str, float]) -> dict[str, Any]:
    """Return where MuJoCo has the bodies at values of all joints, as poses (4, 4) by the names of links.

    Relative to the base of the document, which is MuJoCo's world.
    """
    mujoco, model = import_extra("mujoco", "mujoco"), document.compiled
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    rows = _whole(model.jnt_qposadr)
    for name, row in zip(_joint_names(model), rows, strict=True):
        if name in values:
            data.qpos[row] = values[name]
    mujoco.mj_kinematics(model, data)
    pose_of_link = {}
    for body, name in enumerate(_body_names(model)):
        if name in document.links:
            pose = np.eye(4)
            pose[:3, :3] = np.reshape(data.xmat[body], (3, 3))
            pose[:3, 3] = data.xpos[body]
            pose_of_link[name] = pose
    return pose_of_link


def check_same(robot: Any, document: Urdf) -> None:
    """Refuse a robot whose D(q) or C v + G is not MuJoCo's, where it came from an MJCF.

    Args:
        robot: the robot; one with joints that follow others is not compared.
        document: what it was built from.

    Raises:
        UrdfError: when they differ by more than rounding.
    """
    theirs = document.compiled
    if theirs is None or robot.coupling is not None:
        return
    mujoco, path = import_extra("mujoco", "mujoco"), document.source
    names = _joint_names(theirs)
    position_rows = dict(zip(names, _whole(theirs.jnt_qposadr), strict=True))
    velocity_rows = dict(zip(names, _whole(theirs.jnt_dofadr), strict=True))
    rows = [velocity_rows[name] for name in robot.joint_names]
    data = mujoco.MjData(theirs)
    full = np.zeros((theirs.nv, theirs.nv))
    rng = np.random.default_rng(0)
    speeds = rng.uniform(-1.0, 1.0, (_LOOKS, robot.n))
    positions = robot.random_positions(_LOOKS)
    frozen = robot.provenance["locked"]
    locked = {name: frozen[name] for name in frozen if document.joints[name].moves}
    for q, v in zip(positions, speeds, strict=True):
        data.qpos[:] = theirs.qpos0
        data.qvel[:] = 0.0
        values = locked | dict(zip(robot.joint_names, q, strict=True))
        for name, value in values.items():
            data.qpos[position_rows[name]] = value
        data.qvel[rows] = v
        mujoco.mj_forward(theirs, data)
        _full_inertia(mujoco, theirs, data, full)
        inertia = full[np.ix_(rows, rows)]
        bias = np.array(data.qfrc_bias)[rows]
        for expected, computed in (
            (inertia, robot.mass_matrix(q)),
            (bias, robot.nonlinear_effects(q, v)),
        ):
            apart = np.abs(computed - expected)
            allowed = _SAME * max(1.0, np.abs(expected).max())
            if not apart.max() <= allowed:
                row = np.unravel_index(apart.argmax(), apart.shape)[0]
                raise UrdfError(
                    path,
                    f"its equations differ from MuJoCo's at joint {robot.joint_names[int(row)]!r} by "
                    f"{apart.max():.3g}: give a URDF, and report this file",
                )


def _full_inertia(mujoco: Any, model: Any, data: Any, full: Array) -> None:
    """Write MuJoCo's D(q), whose function has had two signatures."""
    try:
        mujoco.mj_fullM(model, data, full)
    except TypeError:
        mujoco.mj_fullM(model, full, data.qM)


def _model_name(model: Any) -> str:
    """Return the name that a compiled model has."""
    name, *_ = bytes(model.names).split(b"\0", 1)
    return name.decode("utf-8", "replace").strip()


def _body_names(model: Any) -> list[str]:
    """Return the names of all bodies, the world first."""
    return _names([model.body(body).name for body in range(model.nbody)], "body")


def _joint_names(model: Any) -> list[str]:
    """Return the names of all joints."""
    return _names([model.joint(joint).name for joint in range(model.njnt)], "joint")


def _names(given: list[str], kind: str) -> list[str]:
    """Return names, and for what has none its kind and index, as MuJoCo's viewer shows it."""
    used, names = set(given), []
    for index, name in enumerate(given):
        unnamed = f"{kind}{index}"
        while unnamed in used:
            unnamed += "_"
        names.append(name or unnamed)
    return names


def _whole(numbers: Any) -> list[int]:
    """Return whole numbers of a compiled model as Python's."""
    return [int(number) for number in numbers]


def _numbers(values: Any) -> tuple[float, ...]:
    """Return numbers of a compiled model as Python's."""
    return tuple(float(value) for value in values)


def _place(position: Any, quaternion: Any) -> Any:
    """Return a pose of a position and a quaternion w, x, y, z."""
    return pin.SE3(_rotation(quaternion), np.array(position))


def _rotation(quaternion: Any) -> Array:
    """Return the matrix of a quaternion w, x, y, z."""
    turned = pin.Quaternion(*_numbers(quaternion)).normalized()
    matrix: Array = turned.matrix()
    return matrix


def _rpy(rotation: Array) -> tuple[float, ...]:
    """Return the angles of a rotation as a URDF has them."""
    return _numbers(pin.rpy.matrixToRpy(rotation))


def _xyz_rpy(place: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a pose as a URDF has it."""
    rotation = np.array(place.rotation)
    return _numbers(place.translation), _rpy(rotation)
