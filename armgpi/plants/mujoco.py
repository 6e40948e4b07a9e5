"""An arm by MuJoCo, a second simulator: its own reader of URDFs, its own dynamics, its own integrators.

It shares no code with Pinocchio, so a closed loop that goes the same way in both is a fact about neither.
"""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from armgpi.base import files
from armgpi.base.arrays import Array, check_path, is_listing, new
from armgpi.base.parameter import parameter, with_parameters
from armgpi.errors import ParameterError, UrdfError, import_extra
from armgpi.plants.arm import Arm
from armgpi.plants.plant import PlantState
from armgpi.robot import repairs, urdf
from armgpi.robot.assembly import Assembly
from armgpi.robot.dynamics import thread_count
from armgpi.robot.meshes import MAX_MESH_BYTES, MeshFinder
from armgpi.robot.robot import Robot

#: Integrator -> order, by MuJoCo's names.
INTEGRATORS = {"rk4": 4, "euler": 1, "implicit": 1, "implicitfast": 1}
#: Changes of a robot that leave its masses alone; those of inertia are made in the URDF again.
_WITHOUT_MASS = {"armature", "drives", "friction", "gravity", "limits"}
#: Relative difference between MuJoCo's D(q) and Pinocchio's by rounding: 3e-13 was the worst of all arms.
_SAME_ARM = 1e-9
#: Share of the largest moment by which the other two may miss it before MuJoCo refuses a body.
_FLAT = 1e-9
#: Radius of gyration of a ball in the place of a link that has no inertia [m].
_LEAST_RADIUS = 1e-2
#: MuJoCo calls larger numbers unstable, and writes so to a file.
_HUGE = 1e9


@with_parameters
class MuJoCoPlant(Arm):
    """An arm by MuJoCo, from the same URDF and under the same changes as the robot that it is given.

    MuJoCo compiles the URDF itself, with locked joints fixed; joints are matched by their names. Payloads,
    scaled inertia, rotor inertia, gravity and friction are the robot's. The torque is held over the sample.

    Attributes:
        integrator: "rk4", or "euler", "implicit", "implicitfast", which take strong viscous friction.
        stops: whether joints stop at their position limits, softly, as MuJoCo has it.
        contacts: whether links that are not neighbours touch, by the URDF's ``<collision>`` shapes.
        package_dirs: where the meshes of these are looked for.
        differences: what it does otherwise than :class:`armgpi.RigidBodyPlant`, one sentence each.
        models: its `mujoco.MjModel`, one for each robot; not to be changed.
    """

    config_name: ClassVar[str | None] = "mujoco"
    feels: ClassVar[tuple[str, ...]] = ("loads", "friction", "environment")
    varies: ClassVar[bool] = False

    integrator: str = parameter(
        "integrator of MuJoCo",
        kind="choice",
        default="rk4",
        chosen="rk4",
        choices=("rk4", "euler", "implicit", "implicitfast"),
    )
    stops: bool = parameter(
        "whether joints have stops at their limits, in MuJoCo", kind="flag", default=False, kw_only=True
    )
    contacts: bool = parameter(
        "whether links touch each other, in MuJoCo", kind="flag", default=False, kw_only=True
    )
    package_dirs: Sequence[str | PathLike[str]] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        """Compile the robot.

        Raises:
            MissingPackage: when MuJoCo is not installed.
            UrdfError: when MuJoCo refuses the robot, or finds another arm in it; the message says why.
            ParameterError: for a bad argument.
        """
        super().__post_init__()
        robot, package_dirs = self.robot, self.package_dirs
        if not is_listing(package_dirs):
            raise ParameterError("package_dirs", package_dirs, "a list of folders")
        folders = [check_path(folder, "package_dirs") for folder in package_dirs]
        rows = 1
        for coefficients in self.friction or ():
            if coefficients.ndim == 2:
                rows = max(rows, len(coefficients))
        robots = [robot] * rows if isinstance(robot, Robot) else robot.robots
        compiled_robots = {id(arm): _Compiled(arm, self, folders) for arm in robots}  # each of them once
        self.models = []
        for row, arm in enumerate(robots):
            self.models.append(self._set_friction(compiled_robots[id(arm)], row))
        differences = [*compiled_robots[id(robots[0])].differences, *self._differences()]
        self.differences = tuple(dict.fromkeys(differences))
        self._memory = _Memory(self.models, self.robot.joint_names, self.integrator)

    def step(self, tau: Array, state: PlantState, dt: float) -> PlantState:
        """Return the state after `tau` was held for `dt`; see :meth:`Plant.step`."""
        k, q, v, _ = state
        h = dt / self.substeps
        torques = []  # in the middle of each substep
        for i in range(self.substeps):
            _, middle, _ = self.acting_torques(tau, k, i, dt)
            torques.append(middle)
        is_single = q.ndim == 1 and self.robot.batch is None
        advance = self._memory.one if is_single else self._memory.many
        if not self.environment:
            q, v = advance(q, v, torques, h)
        else:
            for i, torque in enumerate(torques):
                touched = self.contact_torque(q, v, k, i, dt)
                q, v = advance(q, v, [torque + touched], h)
        return new(PlantState, (k + 1, q, v, tau))

    def describe(self) -> dict[str, Any]:
        """Return the parameters as plain data."""
        return {
            **super().describe(),
            "engine": f"MuJoCo {_mujoco().mj_versionString()}",
            "differences": list(self.differences),
        }

    def _set_friction(self, compiled: _Compiled, row: int) -> Any:
        """Return a compiled model with the friction of its row."""
        if self.friction is None:
            return compiled.model
        model = copy.copy(compiled.model)  # robots that are the same may have other friction
        viscous, coulomb = (
            coefficients if coefficients.ndim == 1 else coefficients[row] for coefficients in self.friction
        )
        model.dof_damping[compiled.order] = viscous
        model.dof_frictionloss[compiled.order] = coulomb
        return model

    def _differences(self) -> Iterator[str]:
        """Yield what differs because of what was asked for."""
        if INTEGRATORS[self.integrator] < 4:
            yield f"the integrator {self.integrator} is of order 1"
        if self.loads:
            yield "a load acts over a substep as it is in its middle"
        if self.environment:
            yield "what the tool touches acts over a substep as it is at its beginning"
        if self.friction is not None and self.friction.viscous.any() and self.integrator == "rk4":
            yield "viscous friction is explicit: where it is strong, take the integrator implicitfast"
        if self.friction is not None and self.friction.coulomb.any():
            yield "Coulomb friction is a soft constraint, under which a joint at rest creeps"
        if self.stops:
            yield "joints stop at their position limits, softly"
        if self.contacts:
            yield "links touch each other, by their convex hulls"


class _Compiled:
    """MuJoCo's model of one robot.

    Attributes:
        model: the `mujoco.MjModel`.
        order: coordinate of every joint in it, shape (n,).
        differences: what had to be done otherwise.
    """

    def __init__(self, robot: Robot, plant: MuJoCoPlant, package_dirs: Iterable[Path]) -> None:
        """Compile a robot for a plant."""
        mujoco = _mujoco()
        self.robot = robot
        self.source = str(robot.provenance["source"])
        self.differences: list[str] = []
        assembly = self._known_assembly()
        root = assembly.element()
        rounded = {link.get("name", "") for link in root.iter("link") if _round(link)}
        for change in robot.provenance["changes"]:
            rounded |= _change(root, change)
        assets: dict[str, bytes] = {}
        if plant.contacts:
            assets = _add_shapes(root, robot, package_dirs)
        try:
            self.model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"), assets)
        except ValueError as error:
            reason = " ".join(str(error).removeprefix("Error: ").split())
            raise UrdfError(self.source, f"is refused by MuJoCo: {reason}") from None
        places = {self.model.joint(j).name: j for j in range(self.model.njnt)}
        if set(places) != set(robot.joint_names):
            names = ", ".join(sorted(places))
            raise UrdfError(self.source, f"MuJoCo finds the joints {names} in it; expected {robot!r}")
        joints = [places[name] for name in robot.joint_names]
        self.order = np.array([self.model.jnt_dofadr[joint] for joint in joints])
        self._set_options(plant, joints)
        self._restore_inertia(rounded)
        self._check()

    def _known_assembly(self) -> Assembly:
        """Return links and joints; refuse robots that MuJoCo cannot be given as they are."""
        assembly = self.robot._assembly
        if assembly is None:
            raise UrdfError(self.source, "did not come from a URDF, which MuJoCo is given: use Robot.load")
        if self.robot.coupling is not None:
            raise UrdfError(
                self.source,
                'has joints that follow others, which MuJoCo does softly: lock them (mimic="lock")',
            )
        return assembly

    def _set_options(self, plant: MuJoCoPlant, joints: list[int]) -> None:
        """Set what a URDF does not say."""
        mujoco, model, robot = _mujoco(), self.model, self.robot
        bits = mujoco.mjtDisableBit
        is_off = {
            bits.mjDSBL_WARMSTART: True,  # a step depends on the state alone
            bits.mjDSBL_AUTORESET: True,  # which would hide that a run has diverged
            bits.mjDSBL_CONTACT: not plant.contacts,
            bits.mjDSBL_LIMIT: not plant.stops,
            bits.mjDSBL_FRICTIONLOSS: plant.friction is None,
        }
        model.opt.disableflags = sum(int(bit) for bit, disabled in is_off.items() if disabled)
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{plant.integrator.upper()}")
        model.opt.gravity[:] = np.asarray(robot._model.gravity.linear)
        model.dof_armature[self.order] = robot.armature
        model.dof_damping[:] = 0.0
        model.dof_frictionloss[:] = 0.0
        lower, upper = robot.limits.lower, robot.limits.upper
        model.jnt_range[joints] = np.stack([lower, upper], axis=-1)
        model.jnt_limited[joints] = np.isfinite(lower) & np.isfinite(upper)

    def _restore_inertia(self, rounded: set[str]) -> None:
        """Give what carries links that were rounded the inertia that they have."""
        import pinocchio as pin

        mujoco, model, robot = _mujoco(), self.model, self.robot
        restored = []
        for joint in robot.joint_names:
            index = robot._model.getJointId(joint)
            frames = [frame for frame in robot._model.frames if frame.parentJoint == index]
            links = [frame.name for frame in frames if frame.type == pin.FrameType.BODY]
            if rounded.isdisjoint(links):
                continue
            body = int(model.joint(joint).bodyid[0])
            inertia = robot._model.inertias[index]
            moments, axes = np.linalg.eigh(inertia.inertia)
            axes[:, 0] *= np.linalg.det(axes)  # a rotation, no reflection
            model.body_inertia[body] = moments
            mujoco.mju_mat2Quat(model.body_iquat[body], np.ascontiguousarray(axes).ravel())
            model.body_ipos[body] = inertia.lever
            model.body_sameframe[body] = 0
            restored.append(joint)
        if restored:
            mujoco.mj_setConst(model, mujoco.MjData(model))
            self.differences.append(
                f"the bodies of {', '.join(restored)} have an inertia that MuJoCo refuses, as no rigid body "
                "has it; it compiled another one, which was replaced by this one"
            )

    def _check(self) -> None:
        """Refuse a model that is another arm than Pinocchio's: their D(q) differ in the middle."""
        mujoco, model = _mujoco(), self.model
        data = mujoco.MjData(model)
        q = self.robot.middle()
        data.qpos[self.order] = q
        mujoco.mj_forward(model, data)
        columns = np.eye(model.nv)
        inertia = np.empty((model.nv, model.nv))
        for row, column in zip(inertia, columns, strict=True):
            mujoco.mj_mulM(model, data, row, column)
        inertia = inertia[np.ix_(self.order, self.order)]
        expected = self.robot.mass_matrix(q)
        apart = float(np.abs(inertia - expected).max() / np.abs(expected).max())
        if not apart <= _SAME_ARM:
            raise UrdfError(self.source, f"is another arm to MuJoCo: D(q) differs by {apart:.2g} of its size")


class _Memory(threading.local):
    """MuJoCo's working memory; every thread has its own, made at its first use.

    A pickle or copy of it has the models alone.
    """

    def __init__(self, models: list[Any], joint_names: Sequence[str], integrator: str) -> None:
        """Make the memory for `models`; Python calls this again in every further thread."""
        mujoco = _mujoco()
        self._arguments = (models, joint_names, integrator)
        # The time step is a part of the model: every thread has models of its own.
        copies = {id(model): copy.copy(model) for model in models}
        self.models = [copies[id(model)] for model in models]
        self.data = mujoco.MjData(self.models[0])
        self.order = np.array([self.models[0].joint(name).dofadr[0] for name in joint_names])
        methods: dict[str, Callable[[Any, Any], None]] = {
            "euler": mujoco.mj_Euler,
            "rk4": lambda model, data: mujoco.mj_RungeKutta(model, data, 4),
        }
        self.advance = methods.get(integrator, mujoco.mj_implicit)
        self._h = 0.0
        self._pool: Any = None

    def one(self, q: Array, v: Array, push: list[Array], h: float) -> tuple[Array, Array]:
        """Return q and v after one step of `h` for each of the torques."""
        numbers = np.concatenate([q, v, *push])
        if not (np.abs(numbers) < _HUGE).all():  # nor where one is NaN
            return np.full_like(q, np.nan), np.full_like(v, np.nan)
        model, data, order = self.models[0], self.data, self.order
        self._set_step(h)
        data.qpos[order] = q
        data.qvel[order] = v
        forward = _mujoco().mj_forward
        for tau in push:
            data.qfrc_applied[order] = tau
            forward(model, data)
            self.advance(model, data)
        return data.qpos[order], data.qvel[order]

    def many(self, q: Array, v: Array, push: list[Array], h: float) -> tuple[Array, Array]:
        """Do the same for a batch, by mujoco.rollout and on its threads."""
        from mujoco import rollout

        mujoco = _mujoco()
        batch, n = q.shape
        if self._pool is None:
            threads = max(1, min(thread_count(), batch))
            self._pool = rollout.Rollout(nthread=threads)
            self._datas = [mujoco.MjData(self.models[0]) for _ in range(threads)]
        self._set_step(h)
        numbers = np.concatenate([q, v, *push], axis=-1)
        good = (np.abs(numbers) < _HUGE).all(axis=-1)[:, None]
        place = np.argsort(self.order)
        # MuJoCo's state: time, positions, velocities, in the order of its own coordinates.
        size = mujoco.mj_stateSize(self.models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        start = np.zeros((batch, size))
        start[:, 1 : 1 + n] = np.where(good, q, 0.0)[:, place]
        start[:, 1 + n :] = np.where(good, v, 0.0)[:, place]
        torques = np.stack(push, axis=1)
        control = np.where(good[:, None], torques, 0.0)[..., place]
        models = self.models * batch if len(self.models) == 1 else self.models
        with _without_log():
            state, _ = self._pool.rollout(
                models,
                self._datas,
                start,
                np.ascontiguousarray(control),
                control_spec=int(mujoco.mjtState.mjSTATE_QFRC_APPLIED),
                chunk_size=-(-batch // len(self._datas)),
            )
        end = np.where(good, state[:, -1], np.nan)
        return end[:, 1 + self.order], end[:, 1 + n + self.order]

    def _set_step(self, h: float) -> None:
        """Set the time step [s] where it is another one."""
        if h != self._h:
            for model in self.models:
                model.opt.timestep = h
            self._h = h

    def __reduce__(self) -> tuple[type[_Memory], tuple[Any, ...]]:
        """Return how to make it anew: `mujoco.MjData` belongs to one thread."""
        return _Memory, self._arguments


def _mujoco() -> Any:
    """Return the module, which takes a while to import.

    Raises:
        MissingPackage: when it is not installed.
    """
    return import_extra("mujoco", "mujoco")


@contextmanager
def _without_log() -> Iterator[None]:
    """Keep MuJoCo from writing a file MUJOCO_LOG.TXT when a rollout diverges, which a rollout says itself."""
    mujoco = _mujoco()
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _change(root: Element, change: Mapping[str, Any]) -> set[str]:
    """Make a change of a robot's inertia in its URDF, and return the links that were rounded by it.

    Raises:
        UrdfError: for a change that is not known here.
    """
    ((kind, value),) = change.items()
    if kind == "inertia_scale":
        for inertial in root.iter("inertial"):
            for element in (inertial.find("mass"), inertial.find("inertia")):
                assert element is not None
                for key, text in element.attrib.items():
                    element.set(key, repr(float(text) * value))
    elif kind == "payload":
        return _hang(root, **value)
    elif kind not in _WITHOUT_MASS:
        raise UrdfError(root.get("name"), f"was changed in a way that MuJoCo's model does not have: {kind}")
    return set()


def _hang(root: Element, frame: str, mass: float, com: Sequence[float], inertia: Any = None) -> set[str]:
    """Hang a payload on a link, or on the link that a joint carries; return that link if it was rounded."""
    links = {link.get("name") for link in root.iter("link")}
    if frame not in links:
        joint = next(joint for joint in root.iter("joint") if joint.get("name") == frame)
        frame = joint.find("child").get("link")  # type: ignore[union-attr, assignment]
    tensor = np.zeros((3, 3)) if inertia is None else np.array(inertia)
    name = f"payload {len(links)}"
    link = SubElement(root, "link", name=name)
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=" ".join(map(repr, com)), rpy="0 0 0")
    SubElement(inertial, "mass", value=repr(mass))
    entries = {}
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        key = f"i{'xyz'[i]}{'xyz'[j]}"
        entries[key] = repr(float(tensor[i, j]))
    SubElement(inertial, "inertia", entries)
    fixed = SubElement(root, "joint", name=name, type="fixed")
    SubElement(fixed, "parent", link=frame)
    SubElement(fixed, "child", link=name)
    SubElement(fixed, "origin", xyz="0 0 0", rpy="0 0 0")
    if inertia is None:  # a point, which MuJoCo takes
        return set()
    return {frame} if _round(link) else set()


def _round(link: Element) -> bool:
    """Make a ball of a link with an inertia that MuJoCo refuses, and tell whether it was such a link.

    That is one that no rigid body has (no triangle: A + B < C), or that of a rod or a point.
    """
    element = link.find("inertial/inertia")
    mass_element = link.find("inertial/mass")
    if element is None or mass_element is None:
        return False
    mass = float(mass_element.get("value", "0"))
    if mass == 0.0:
        return False
    xx, xy, xz, yy, yz, zz = (
        float(element.get(f"i{key}", "0")) for key in ("xx", "xy", "xz", "yy", "yz", "zz")
    )
    a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if a > _FLAT * c and a + b > c * (1.0 + _FLAT):
        return False
    mean_moment = float(a + b + c) / 3.0
    moment = repr(max(mean_moment, _LEAST_RADIUS**2 * mass))
    element.attrib.update(ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0")
    return True


def _add_shapes(root: Element, robot: Robot, package_dirs: Iterable[Path]) -> dict[str, bytes]:
    """Put the URDF's collision shapes to the links, and return the meshes that they name.

    Raises:
        UrdfError: when the robot has no file, or a mesh is not found or not read by MuJoCo.
    """
    source = str(robot.provenance["source"])
    document = urdf.parse(urdf.read_file(Path(source)), source, repairs.made_in(robot.provenance))
    finder = MeshFinder(source, package_dirs)
    assets: dict[str, bytes] = {}
    links = {link.get("name"): link for link in root.iter("link")}
    for link in document.root.iter("link"):
        for shape in link.findall("collision"):
            own = copy.deepcopy(shape)
            for mesh in own.iter("mesh"):
                found = finder.find(mesh.get("filename", ""))
                if found.path is None or found.path.suffix.lower() not in (".stl", ".obj"):
                    reason = found.reason or "MuJoCo reads STL and OBJ"
                    raise UrdfError(
                        source, f"contacts need the mesh {found.name!r}: {reason}", link.get("name")
                    )
                name = f"{len(assets)}{found.path.suffix.lower()}"
                assets[name] = files.read_bytes(found.path, MAX_MESH_BYTES)
                mesh.set("filename", name)
            links[link.get("name")].append(own)
    return assets
