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
        last = "-->" if text.startswith("<!--", begun) else ">"
        end = text.find(last, begun + 4 if last == "-->" else begun)
        begun = text.find("<", end + len(last)) if end >= 0 else -1
    return text.startswith("<mujoco", begun) if begun >= 0 else False


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
    return _Reader(_compiled(path), path).document(_hash(path, text, others))


def _hash(path: Path, text: str, others: Sequence[Path]) -> str:
    """Return the SHA-256 of a model: of its text, and of the files that its bodies depend on.

    That of a model in a single file is that file's. Of several it depends on what is in them alone, so that a
    copy of the folder is the same model.

    Raises:
        UrdfError: when one of them cannot be read any more.
    """
    digest = hashlib.sha256(text.encode())
    try:
        contents = {hashlib.sha256(files.read_bytes(other, mjcf_files.MOST)).digest() for other in others}
    except OSError as error:
        raise UrdfError(path, f"names a file that cannot be read: {files.reason(error)}") from None
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
        said = " ".join(str(error).split())
        if missing := _MISSING.search(said):
            way = "copy it to where <compiler> says (meshdir, texturedir, assetdir), or else beside the model"
            raise UrdfError(path, f"names the file {missing[1]!r}, which is not there: {way}") from None
        raise UrdfError(path, f"MuJoCo cannot read it: {said.removeprefix('Error: ')}") from None
    finally:
        mujoco.set_mju_user_warning(handler)


def fluid(model: Any) -> str:
    """Return what to say of the fluid around the arm of a `mujoco.MjModel`; empty where there is none."""
    option = model.opt
    if not (option.density > 0.0 or option.viscosity > 0.0) or not _is_passive(model):
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
    return not any(off & int(getattr(bits, f"mjDSBL_{part}", 0)) for part in parts)


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
        self.bodies = _names([model.body(b).name for b in range(model.nbody)], "body")
        self.joint_names = _names([model.joint(j).name for j in range(model.njnt)], "joint")
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
                rotors[name] = float(model.dof_armature[int(model.jnt_dofadr[joint])])
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
            gravity=tuple(float(x) for x in model.opt.gravity) if self._acts("GRAVITY") else _ZEROS,
            coupled=tuple(self._more_than_an_arm()),
            compiled=model,
        )

    def _acts(self, *parts: str) -> bool:
        """Tell whether parts of MuJoCo's equations act; see :func:`_acts`."""
        return _acts(self.model, *parts)

    def _targets(self) -> set[int]:
        """Return mocap bodies, which are targets to drag, with all below them; none with a joint below it."""
        model, skipped = self.model, set[int]()
        moving = {int(body) for body in model.jnt_bodyid}
        for body in range(1, model.nbody):
            below = [b for b in range(model.nbody) if body in self._above(b)]
            if model.body_mocapid[body] >= 0 and not moving.intersection(below):
                skipped.update(below)
        return skipped

    def _above(self, body: int) -> list[int]:
        """Return a body and those that carry it, without the world."""
        found = []
        while body:
            found.append(body)
            body = int(self.model.body_parentid[body])
        return found

    def _body(self, body: int) -> None:
        """Add the link of a body, and its joints."""
        model, name = self.model, self.bodies[body]
        mass = float(model.body_mass[body])
        inertia = tuple(float(x) for x in model.body_inertia[body])
        tensor = (inertia[0], 0.0, 0.0, inertia[1], 0.0, inertia[2])
        xyz, rpy = tuple(float(x) for x in model.body_ipos[body]), _rpy(_rotation(model.body_iquat[body]))
        self.links[name] = Link(name, mass, xyz, rpy, tensor, mass > 0.0, ())
        if body == 0:
            return
        parent = self.bodies[int(model.body_parentid[body])]
        place = pin.SE3(_rotation(model.body_quat[body]), np.array(model.body_pos[body]))
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            last = joint == first + int(model.body_jntnum[body]) - 1
            # An axis beside the origin of its body: the body is a fixed link behind it.
            anchor = np.array(model.jnt_pos[joint])
            ends_here = last and (
                not anchor.any() or self.kinds.get(int(model.jnt_type[joint])) == "floating"
            )
            link = name if ends_here else f"{name} ({self.joint_names[joint]})"
            place = self._joint(joint, parent, link, place)
            if not ends_here:
                self.links[link] = Link(link, 0.0, _ZEROS, _ZEROS, _NO_INERTIA, False, ())
            parent = link
            if ends_here:
                return
        fixed = f"{name} (fixed)"
        self.joints[fixed] = Joint(fixed, "fixed", parent, name, *_xyz_rpy(place))

    def _joint(self, joint: int, parent: str, child: str, place: Any) -> Any:
        """Add a joint on a body at `place` on its parent; return the place of the body on the child."""
        model, name = self.model, self.joint_names[joint]
        kind = self.kinds.get(int(model.jnt_type[joint]))
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
        anchor, axis = np.array(model.jnt_pos[joint]), np.array(model.jnt_axis[joint])
        # The pose that the file shows is that of qpos0.
        zero = float(model.qpos0[int(model.jnt_qposadr[joint])])
        shift = pin.SE3(np.eye(3), anchor)
        if kind == "prismatic":
            shift = shift * pin.SE3(np.eye(3), -zero * axis)
        else:
            shift = shift * pin.SE3(pin.exp3(-zero * axis), np.zeros(3))
        lower, upper = -math.inf, math.inf
        if model.jnt_limited[joint] and self._acts("LIMIT", "CONSTRAINT"):
            lower, upper = (float(x) for x in model.jnt_range[joint])
        elif kind == "revolute":
            kind = "continuous"
        leader, ratio, offset = self.mimics.get(name, (None, 1.0, 0.0))
        row = int(model.jnt_dofadr[joint])
        self.joints[name] = Joint(
            name,
            kind,
            parent,
            child,
            *_xyz_rpy(place * shift),
            axis=tuple(float(x) for x in axis),
            lower=lower,
            upper=upper,
            effort=float(self.efforts[joint]),
            damping=float(np.ravel(model.dof_damping[row])[0]) * self._acts("PASSIVE", "DAMPER"),
            friction=float(model.dof_frictionloss[row]) * self._acts("FRICTIONLOSS", "CONSTRAINT"),
            mimic=leader,
            mimic_multiplier=ratio,
            mimic_offset=offset,
        )
        return pin.SE3(np.eye(3), -anchor)

    def _sites(self, skipped: set[int]) -> None:
        """Add the sites that have a name, as frames."""
        model = self.model
        for site in range(model.nsite):
            name, body = model.site(site).name, int(model.site_bodyid[site])
            if not name or name in self.links or body in skipped or f"{name} (site)" in self.joints:
                continue
            self.links[name] = Link(name, 0.0, _ZEROS, _ZEROS, _NO_INERTIA, False, ())
            place = pin.SE3(_rotation(model.site_quat[site]), np.array(model.site_pos[site]))
            joint = f"{name} (site)"
            self.joints[joint] = Joint(joint, "fixed", self.bodies[body], name, *_xyz_rpy(place))

    def _efforts(self) -> Array:
        """Return the largest force of the actuators of each joint [N m or N]; infinite without any."""
        model = self.model
        mujoco = import_extra("mujoco", "mujoco")
        efforts = np.zeros(model.njnt)
        for a in range(model.nu):
            kind, place = int(model.actuator_trntype[a]), int(model.actuator_trnid[a, 0])
            if kind in (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)):
                joint, arm = place, 1.0
            elif kind == int(mujoco.mjtTrn.mjTRN_TENDON) and (led := self._led_by(place)) is not None:
                joint, arm = led
            else:
                continue
            limit = np.inf
            if model.actuator_forcelimited[a]:
                limit = np.abs(model.actuator_forcerange[a]).max()
            elif model.actuator_ctrllimited[a] and not np.any(model.actuator_biasprm[a]):
                limit = np.abs(model.actuator_ctrlrange[a]).max() * abs(model.actuator_gainprm[a, 0])
            efforts[joint] += abs(model.actuator_gear[a, 0] * arm) * limit if arm else 0.0
        for joint in range(model.njnt):
            if model.jnt_actfrclimited[joint]:
                most = np.abs(model.jnt_actfrcrange[joint]).max()
                efforts[joint] = min(efforts[joint] or np.inf, most)
        return np.where(efforts > 0.0, efforts, np.inf)

    def _led_by(self, tendon: int) -> tuple[int, float] | None:
        """Return the only joint that a tendon moves, with those that follow it, and its lever [m or 1].

        None for a tendon through sites, and for one that moves several joints.
        """
        mujoco, model = import_extra("mujoco", "mujoco"), self.model
        first = int(model.tendon_adr[tendon])
        levers: dict[str, float] = {}
        for wrap in range(first, first + int(model.tendon_num[tendon])):
            if int(model.wrap_type[wrap]) != int(mujoco.mjtWrap.mjWRAP_JOINT):
                return None
            name = self.joint_names[int(model.wrap_objid[wrap])]
            leader, ratio, _ = self.mimics.get(name, (name, 1.0, 0.0))
            levers[leader] = levers.get(leader, 0.0) + ratio * float(model.wrap_prm[wrap])
        if len(levers) != 1:
            return None
        ((name, lever),) = levers.items()
        return self.joint_names.index(name), lever

    def _mimics(self) -> dict[str, tuple[str, float, float]]:
        """Return the joints that follow another in proportion: name -> leader, ratio and offset."""
        model, found = self.model, dict[str, tuple[str, float, float]]()
        for equality in self._equalities("mjEQ_JOINT"):
            follower, leader = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
            factors = model.eq_data[equality]
            if leader >= 0 and not np.any(factors[2:5]):
                zeros = [float(model.qpos0[int(model.jnt_qposadr[j])]) for j in (follower, leader)]
                ratio = float(factors[1])
                offset = float(factors[0]) + zeros[0] - ratio * zeros[1]
                found[self.joint_names[follower]] = (self.joint_names[leader], ratio, offset)
        return found

    def _equalities(self, kind: str) -> list[int]:
        """Return the equality constraints of one kind that are active."""
        mujoco, model = import_extra("mujoco", "mujoco"), self.model
        if not self._acts("EQUALITY", "CONSTRAINT"):
            return []
        wanted = int(getattr(mujoco.mjtEq, kind))
        return [i for i in range(model.neq) if model.eq_active0[i] and int(model.eq_type[i]) == wanted]

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
        mujoco = import_extra("mujoco", "mujoco")
        actuators = _names([model.actuator(a).name for a in range(model.nu)], "actuator")
        tendons = _names([model.tendon(t).name for t in range(model.ntendon)], "tendon")
        for a in range(model.nu):
            tendon = int(model.actuator_trnid[a, 0])
            by_tendon = int(model.actuator_trntype[a]) == int(mujoco.mjtTrn.mjTRN_TENDON)
            if by_tendon and self._led_by(tendon) is None:
                what = f"actuator {actuators[a]!r} on tendon {tendons[tendon]!r}"
                yield Coupled(f"{what}, one force for several joints", self._joints_of_tendon(tendon))
        pulls = [model.tendon_stiffness] if self._acts("PASSIVE", "SPRING") else []
        pulls += [model.tendon_damping] if self._acts("PASSIVE", "DAMPER") else []
        pulls += [model.tendon_frictionloss] if self._acts("FRICTIONLOSS", "CONSTRAINT") else []
        pulls += [model.tendon_limited] if self._acts("LIMIT", "CONSTRAINT") else []
        for tendon in range(model.ntendon):
            if any(np.any(numbers[tendon]) for numbers in pulls):
                what = f"tendon {tendons[tendon]!r}, which pulls by itself"
                yield Coupled(what, self._joints_of_tendon(tendon))

    def _constraints(self) -> Iterator[Coupled]:
        """Give the equality constraints that are no mimic joints."""
        model = self.model
        for equality in self._equalities("mjEQ_JOINT"):
            follower, leader = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
            if self.joint_names[follower] not in self.mimics:
                names = tuple(self.joint_names[j] for j in (follower, leader) if j >= 0)
                yield Coupled("an equality constraint that is no ratio between two joints", names)
        for kind, what in (("mjEQ_CONNECT", "connect"), ("mjEQ_WELD", "weld")):
            for equality in self._equalities(kind):
                yield self._loop(equality, what)
        if self._equalities("mjEQ_TENDON"):
            yield Coupled("an equality constraint of tendons", tuple(self.joint_names))

    def _loop(self, equality: int, what: str) -> Coupled:
        """Return a constraint between two bodies, with the joints between them."""
        mujoco, model = import_extra("mujoco", "mujoco"), self.model
        ends = [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]
        if int(model.eq_objtype[equality]) == int(mujoco.mjtObj.mjOBJ_SITE):
            ends = [int(model.site_bodyid[site]) for site in ends]
        first, second = (set(self._above(body)) for body in ends)
        names = " and ".join(repr(self.bodies[body]) for body in ends)
        joints = self._joints_of(sorted(first ^ second))
        return Coupled(f"a loop: <{what}> of the bodies {names}", joints)

    def _joints_of(self, bodies: list[int]) -> tuple[str, ...]:
        """Return the names of the joints of some bodies."""
        owners = [int(body) for body in self.model.jnt_bodyid]
        return tuple(self.joint_names[j] for j, body in enumerate(owners) if body in bodies)

    def _joints_of_tendon(self, tendon: int) -> tuple[str, ...]:
        """Return the names of the joints that a tendon may pull at: of one through sites, all."""
        mujoco, model = import_extra("mujoco", "mujoco"), self.model
        first = int(model.tendon_adr[tendon])
        wraps = range(first, first + int(model.tendon_num[tendon]))
        if any(int(model.wrap_type[w]) != int(mujoco.mjtWrap.mjWRAP_JOINT) for w in wraps):
            return tuple(self.joint_names)
        return tuple(self.joint_names[int(model.wrap_objid[w])] for w in wraps)


def poses(document: Urdf, values: Mapping[str, float]) -> dict[str, Any]:
    """Return where MuJoCo has the bodies at values of all joints, as poses (4, 4) by the names of links.

    Relative to the base of the document, which is MuJoCo's world.
    """
    mujoco, model = import_extra("mujoco", "mujoco"), document.compiled
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    for joint, name in enumerate(_names([model.joint(j).name for j in range(model.njnt)], "joint")):
        if name in values:
            data.qpos[int(model.jnt_qposadr[joint])] = values[name]
    mujoco.mj_kinematics(model, data)
    found = {}
    for body, name in enumerate(_names([model.body(b).name for b in range(model.nbody)], "body")):
        if name in document.links:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = np.reshape(data.xmat[body], (3, 3)), data.xpos[body]
            found[name] = pose
    return found


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
    names = _names([theirs.joint(j).name for j in range(theirs.njnt)], "joint")
    at = {name: int(theirs.jnt_qposadr[j]) for j, name in enumerate(names)}
    rows = [int(theirs.jnt_dofadr[names.index(name)]) for name in robot.joint_names]
    data, full = mujoco.MjData(theirs), np.zeros((theirs.nv, theirs.nv))
    speeds = np.random.default_rng(0).uniform(-1.0, 1.0, (_LOOKS, robot.n))
    positions = robot.random_positions(_LOOKS)
    locked = {
        name: value for name, value in robot.provenance["locked"].items() if document.joints[name].moves
    }
    for q, v in zip(positions, speeds, strict=True):
        data.qpos[:], data.qvel[:] = theirs.qpos0, 0.0
        for name, value in (*locked.items(), *zip(robot.joint_names, q, strict=True)):
            data.qpos[at[name]] = value
        data.qvel[rows] = v
        mujoco.mj_forward(theirs, data)
        _full_inertia(mujoco, theirs, data, full)
        pairs = (
            (full[np.ix_(rows, rows)], robot.mass_matrix(q)),
            (np.array(data.qfrc_bias)[rows], robot.nonlinear_effects(q, v)),
        )
        for expected, found in pairs:
            apart = np.abs(found - expected)
            if not apart.max() <= _SAME * max(1.0, np.abs(expected).max()):
                worst = robot.joint_names[int(np.unravel_index(apart.argmax(), apart.shape)[0])]
                said = (
                    f"its equations differ from MuJoCo's at joint {worst!r} by {apart.max():.3g}: "
                    "give a URDF, and report this file"
                )
                raise UrdfError(path, said)


def _full_inertia(mujoco: Any, model: Any, data: Any, full: Array) -> None:
    """Write MuJoCo's D(q), whose function has had two signatures."""
    try:
        mujoco.mj_fullM(model, data, full)
    except TypeError:
        mujoco.mj_fullM(model, full, data.qM)


def _model_name(model: Any) -> str:
    """Return the name that a compiled model has."""
    return bytes(model.names).split(b"\0", 1)[0].decode("utf-8", "replace").strip()


def _names(given: list[str], kind: str) -> list[str]:
    """Return names, and for what has none its kind and index, as MuJoCo's viewer shows it."""
    used, names = set(given), []
    for index, name in enumerate(given):
        unnamed = f"{kind}{index}"
        while unnamed in used:
            unnamed += "_"
        names.append(name or unnamed)
    return names


def _rotation(quaternion: Any) -> Array:
    """Return the matrix of a quaternion w, x, y, z."""
    w, x, y, z = (float(number) for number in quaternion)
    matrix: Array = pin.Quaternion(w, x, y, z).normalized().matrix()
    return matrix


def _rpy(rotation: Array) -> tuple[float, ...]:
    """Return the angles of a rotation as a URDF has them."""
    return tuple(float(angle) for angle in pin.rpy.matrixToRpy(rotation))


def _xyz_rpy(place: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a pose as a URDF has it."""
    return tuple(float(x) for x in place.translation), _rpy(np.array(place.rotation))
