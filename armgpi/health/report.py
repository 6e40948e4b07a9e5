"""The health report of a robot: what its model is, what will bite, and what a controller will do with it.

Whatever makes a model unusable is refused when it is loaded (``urdf.py``, ``urdf_model.py``). Here is what
loads and still goes wrong later: limits in degrees, a gripper that moves, gravity beyond a motor, an inertia
that no body has.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from os import PathLike
from typing import Any, Literal, NamedTuple

import numpy as np

from armgpi.arrays import Array, check_number, check_whole
from armgpi.control.gains import Tuning, betas, default_omega
from armgpi.control.payload import largest_payload
from armgpi.errors import ArmgpiWarning
from armgpi.robot import grippers, robots, urdf, urdf_model
from armgpi.robot.equations import PerJoint
from armgpi.robot.meshes import MeshFinder
from armgpi.robot.robot import Robot

Level = Literal["stop", "warn", "note"]
LEVELS: tuple[Level, ...] = ("stop", "warn", "note")

#: Configurations at which gravity and inertia are looked at, besides the middle of the ranges.
_SAMPLES = 500
#: Turns beyond two to either side are hardly meant in radians [rad], nor such speeds [rad/s].
_MOST_TURN, _MOST_SPIN = 4.0 * math.pi, 60.0
#: Speed limits below this are none [rad/s or m/s].
_LEAST_SPEED = 1e-6
#: What is practically without limit [rad].
_ENDLESS = 1000.0
#: Lengths that are hardly meant in metres [m].
_MOST_LENGTH = 20.0
_LEAST_MASS, _MOST_MASS = 1e-4, 1e4
_MOST_EFFORT = 1e5
#: Radii of gyration that no part of a robot has [m].
_LEAST_GYRATION, _MOST_GYRATION = 1e-4, 5.0
#: An inertia's largest moment may be so much larger than the sum of the others by rounding.
_TRIANGLE_ROUNDING = 0.01
_CONDITION, _LEAST_EIGENVALUE = 1e6, 1e-6
#: GPI with zeta_c = 1 is unstable where friction moves a joint's pole beyond this times omega_c (Theory).
_FRICTION_RATE = 6.67
#: It is unstable, too, where gravity tips the arm over faster than the root of this times omega_c (Theory).
_TIPPING = 16.0 / 15.0
#: Configurations at which that is looked at, step of the differences [rad or m], most of the delay margin
#: (0.356) that a higher bandwidth may be proposed to use.
_TIPPED, _STEP, _MOST_PHASE = 50, 1e-4, 0.2
#: One count of an encoder may cost this share of the torque.
_COUNT_SHARE = 0.05
_KNOWN = {
    "robot": {"link", "joint", "material", "gazebo", "transmission", "sensor", "ros2_control"},
    "link": {"inertial", "visual", "collision", "contact", "sensor", "gazebo", "self_collision_checking"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration"}
    | {"safety_controller", "gazebo", "hardwareInterface", "actuator", "property"},
}
#: Elements of which a link or joint has one.
_SINGLE = {
    "link": ("inertial",),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
}
#: Elements of shapes, their attributes and how many numbers are in each.
_SHAPES = (
    *(("origin", "xyz", 3), ("origin", "rpy", 3), ("box", "size", 3), ("sphere", "radius", 1)),
    *(("cylinder", "radius", 1), ("cylinder", "length", 1), ("capsule", "radius", 1), ("mesh", "scale", 3)),
)
#: Findings of one kind that are listed one by one.
_LISTED = 5


class Finding(NamedTuple):
    """One thing about a model that its user should know.

    Attributes:
        level: "stop" when it stops a run, "warn" when it is probably wrong, "note" when it is good to know.
        kind: a short name of the kind of finding ("degrees", "effort", ...).
        where: the link, joint or file concerned, as in "joint 'j1'".
        value: what was found, None where a single value does not say it.
        bound: what it was compared with, None likewise.
        message: what is the matter, in a sentence.
        repair: what to do about it; empty when nothing has to be done.
        option: the option of the command line that does it; empty when none does.
    """

    level: Level
    kind: str
    where: str
    value: float | str | None
    bound: float | str | None
    message: str
    repair: str = ""
    option: str = ""

    def __str__(self) -> str:
        """Return the finding in a line."""
        remedy = "; ".join(part for part in (self.repair, self.option) if part)
        return f"{self.where}: {self.message}" + (f" -> {remedy}" if remedy else "")


@dataclass(frozen=True)
class HealthReport:
    """What a robot is, and what was found.

    Attributes:
        robot: the robot that was looked at.
        facts: what the model is and what a controller will do with it, as plain data (JSON).
        findings: what was found, the worst first.
    """

    robot: Robot
    facts: Mapping[str, Any]
    findings: tuple[Finding, ...] = field(default=())

    @property
    def stops(self) -> bool:
        """Whether something was found that stops a run."""
        return any(finding.level == "stop" for finding in self.findings)

    def with_findings(self, more: Iterable[Finding], **facts: Any) -> HealthReport:
        """Return the report with more findings and facts."""
        findings = sorted((*self.findings, *more), key=lambda finding: LEVELS.index(finding.level))
        return HealthReport(self.robot, {**self.facts, **facts}, tuple(findings))

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data, None in place of infinity."""
        data: dict[str, Any] = _plain({**self.facts, "findings": [f._asdict() for f in self.findings]})
        return data


class _Samples(NamedTuple):
    """What the model was seen to do: the first configuration is the middle of the ranges."""

    q: Array
    gravity: Array
    inertia: Array
    eigenvalues: Array


def inspect(
    path_or_name: str | PathLike[str],
    lock: Sequence[str] | Mapping[str, float] = (),
    keep: Sequence[str] | None = None,
    mimic: urdf_model.Mimic = "lock",
    effort: PerJoint | None = None,
    package_dirs: Iterable[str | PathLike[str]] = (),
    dt: float = 1e-3,
    delay: int = 0,
    encoder_bits: int = 16,
) -> HealthReport:
    """Load a robot and say what its model is, what will bite, and what a controller will do with it.

    Args:
        path_or_name: as :meth:`armgpi.Robot.load`, as are `lock`, `keep` and `mimic`.
        lock: joints to hold fixed.
        keep: joints to keep, all others are locked.
        mimic: whether joints that mimic another are locked or follow it.
        effort: effort limits that replace the URDF's [N m or N].
        package_dirs: folders in which meshes are looked for, besides the URDF's own.
        dt: sample time of the controller [s].
        delay: samples by which measurements are late.
        encoder_bits: resolution of the position sensors.

    Raises:
        ArmgpiError: as :meth:`armgpi.Robot.load`, for what is no usable URDF.
    """
    check_number(dt, "dt", "positive [s]", open_=True)
    check_whole(delay, "delay", 0)
    check_whole(encoder_bits, "encoder_bits", 1, 52)
    path, name = robots.locate(path_or_name)
    document = urdf.parse(urdf.read_file(path), str(path))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)  # what they say is found below
        robot = Robot.load(path if name is None else name, lock, keep, mimic)
    if effort is not None:
        robot = robot.with_limits(effort=effort)
    samples = _sampled(robot)
    finder = MeshFinder(path, package_dirs)
    timing = (dt, delay, encoder_bits)
    found = [
        *_of_elements(document),
        *_of_links(document, robot),
        *_of_joints(document, robot),
        *_of_mimics(document, robot),
        *_of_grippers(document, robot),
        *_of_shapes(document),
        *_of_meshes(document, finder),
        *_of_model(robot, samples),
        *_of_control(robot, samples, *timing),
    ]
    report = HealthReport(robot, _facts(document, robot, samples, *timing))
    return report.with_findings(_shortened(found))


def with_payload(report: HealthReport, mass: float) -> HealthReport:
    """Return the report with what a load at the tip does to the loop, and the largest that it stands.

    Args:
        report: of a robot.
        mass: of the load [kg].

    Raises:
        ParameterError: when the mass is negative, or the tip does not move.
    """
    mass = check_number(mass, "payload", "zero or positive [kg]")
    control = report.facts["control"]
    most = largest_payload(report.robot, dt=control["dt"], delay=control["delay"] * control["dt"])
    spread = 1.0 + mass * most.mobility
    found = []
    if mass > most.effort:
        message = f"the motors do not hold {mass:g} kg at {report.robot.tip!r} at every configuration"
        found.append(_warn("payload", "robot", mass, most.effort, message, "a smaller load, or more effort"))
    facts = {
        "mass": mass,
        "frame": report.robot.tip,
        "delta_unknown": [1.0 / spread, 1.0],  # eigenvalues of D^-1 D-hat while nobody believes in it
        "delta_believed": [1.0, spread],  # and while it is believed in and comes and goes
        "largest_unknown": most.unknown,
        "largest_believed": most.nominal,
        "largest_held": most.effort,
    }
    return report.with_findings(found, payload=facts)


def _sampled(robot: Robot) -> _Samples:
    """Return gravity and inertia in the middle of the ranges and at random configurations."""
    q = np.vstack([robot.middle(), robot.random_positions(_SAMPLES, seed=1)])
    inertia = robot.dynamics.mass_matrix(q)
    eigenvalues = np.asarray(np.linalg.eigvalsh(inertia), dtype=np.float64)
    return _Samples(q, robot.dynamics.gravity(q), inertia, eigenvalues)


def _facts(
    document: urdf.Urdf, robot: Robot, samples: _Samples, dt: float, delay: int, encoder_bits: int
) -> dict[str, Any]:
    """Return what the model is and what a controller will do with it."""
    model = robot.pinocchio_model()
    holding = np.abs(samples.gravity).max(axis=0)
    diagonal = np.diagonal(samples.inertia, axis1=1, axis2=2)
    first = robot.frame_pose(robot.joint_names[0], samples.q[0]).translation
    distance = np.linalg.norm(robot.frame_pose(robot.tip, samples.q).translation - first, axis=-1)
    joints = []
    for j, name in enumerate(robot.joint_names):
        joint = document.joints[name]
        joints.append(
            {
                "name": name,
                "type": joint.type,
                "parent": joint.parent,
                "child": joint.child,
                **{key: float(limit[j]) for key, limit in robot.limits._asdict().items()},
                "damping": float(robot.friction.viscous[j]),
                "friction": float(robot.friction.coulomb[j]),
                "armature": float(robot.armature[j]),
                "holding": float(holding[j]),
                "inertia_least": float(diagonal[:, j].min()),
                "inertia_most": float(diagonal[:, j].max()),
                "omega_encoder": float(_omega_of_encoder(robot, samples, encoder_bits)[j]),
            }
        )
    return {
        "name": robot.name,
        "source": document.source,
        "sha256": document.sha256,
        "n": robot.n,
        "base": document.base,
        "tip": robot.tip,
        "links": len(document.links),
        "total_mass": robot.total_mass,
        "moving_mass": float(sum(inertia.mass for inertia in model.inertias[1:])),
        "reach": float(distance.max()),
        "locked": dict(robot.provenance["locked"]),
        "mimic": robot.provenance.get("mimic", "lock"),
        "joints": joints,
        "least_eigenvalue": float(samples.eigenvalues[:, 0].min()),
        "condition": float((samples.eigenvalues[:, -1] / samples.eigenvalues[:, 0]).max()),
        "configurations": len(samples.q),
        "control": {
            "dt": dt,
            "delay": delay,
            "encoder_bits": encoder_bits,
            "omega_c": default_omega(dt, delay * dt),
        },
    }


def _of_elements(document: urdf.Urdf) -> Iterator[Finding]:
    """Find elements that stand twice, or that URDF does not know: misspelt, they are not read."""
    for tag in ("robot", "link", "joint"):
        for element in [document.root] if tag == "robot" else document.root.findall(tag):
            where = f"{tag} {element.get('name')!r}"
            children = [child.tag for child in element]
            for single in _SINGLE.get(tag, ()):
                if children.count(single) > 1:
                    message = f"has {children.count(single)} <{single}>, of which the first is read"
                    yield _warn("twice", where, None, None, message, "remove the others")
            for child in dict.fromkeys(children):
                if child not in _KNOWN[tag] and ":" not in child:
                    near = get_close_matches(child, _KNOWN[tag], n=1, cutoff=0.7)
                    message = f"has a <{child[:80]}>, which URDF does not know and nothing reads"
                    repair = f"did you mean <{near[0]}>?" if near else ""
                    level: Level = "warn" if near else "note"
                    yield Finding(level, "unknown", where, child, None, message, repair)


def _of_links(document: urdf.Urdf, robot: Robot) -> Iterator[Finding]:
    """Find masses and inertias that no body, or no robot, has."""
    moved = document.moved_links(robot.provenance["locked"])
    carried = {document.joints[name].child for name in robot.joint_names}
    frames = 0
    for link in document.links.values():
        where, moving = f"link {link.name!r}", link.name in moved
        moments = link.moments()
        if not link.inertial or link.mass == 0.0:
            frames += 1
            continue
        lacking = float(moments[2] - moments[0] - moments[1])
        if moments[0] < 0.0 and not moving:
            message = "has an inertia that is not positive; it does not move, so nothing feels it"
            yield _note("inertia", where, float(moments[0]), 0.0, message)
            continue
        if lacking > 1e-9 * float(moments[2]):
            tells = lacking > _TRIANGLE_ROUNDING * float(moments[2])
            message = (
                f"no rigid body has its inertia: the largest principal moment {moments[2]:.4g} is more than "
                f"the sum of the others, {moments[0] + moments[1]:.4g} kg m^2 (triangle inequality)"
            )
            level: Level = "warn" if tells and moving else "note"
            repair = "take the inertia from CAD again; simulators such as MuJoCo refuse it" if tells else ""
            yield Finding(
                level,
                "triangle",
                where,
                float(moments[2]),
                float(moments[0] + moments[1]),
                message,
                repair,
            )
        if not moving:
            continue
        if link.mass > _MOST_MASS:
            message = f"weighs {link.mass:.4g} kg"
            yield _warn("mass", where, link.mass, _MOST_MASS, message, "check the unit: kg")
        if moments[2] < _LEAST_GYRATION**2 * link.mass:
            message = "has mass and hardly any inertia, as a point has"
            level = "warn" if link.name in carried else "note"
            repair = "give it the inertia of its body"
            yield Finding(level, "inertia", where, float(moments[2]), None, message, repair)
        gyration = math.sqrt(max(float(moments[2]), 0.0) / link.mass)
        if gyration > _MOST_GYRATION:
            message = (
                f"has the inertia of a body {2.0 * gyration:.3g} m wide at its mass of {link.mass:.4g} kg"
            )
            yield _warn("inertia", where, gyration, _MOST_GYRATION, message, "check the units: kg m^2, kg")
        yield from _of_place(where, "the centre of mass", link.xyz, link.rpy)
    if frames:
        message = f"{frames} of {len(document.links)} links have no mass: frames of tools and sensors"
        yield _note("frames", "links", frames, None, message)


def _of_place(where: str, what: str, xyz: Sequence[float], rpy: Sequence[float]) -> Iterator[Finding]:
    """Find origins in millimetres or degrees."""
    if max(map(abs, xyz)) > _MOST_LENGTH:
        far = max(xyz, key=abs)
        yield _warn(
            "length", where, far, _MOST_LENGTH, f"{what} is {far:g} m away", "check the unit: m, not mm"
        )
    if max(map(abs, rpy)) > 2.0 * math.pi + 0.01:
        turned = max(rpy, key=abs)
        message = f"{what} is turned by {turned:g} rad"
        yield _warn("degrees", where, turned, 2.0 * math.pi, message, "check the unit: radians, not degrees")


def _of_joints(document: urdf.Urdf, robot: Robot) -> Iterator[Finding]:
    """Find axes, limits and origins that are hardly meant."""
    free = set(robot.joint_names)
    elements = {element.get("name", ""): element for element in document.root.findall("joint")}
    for joint in document.joints.values():
        where = f"joint {joint.name!r}"
        if joint.moves and elements[joint.name].find("axis") is None:
            yield _note("axis", where, None, None, "has no <axis>, which means 1 0 0")
        limit = elements[joint.name].find("limit")
        if joint.type == "continuous" and limit is not None and {"lower", "upper"} & set(limit.attrib):
            message = "is continuous; the position limits that it has all the same are not read"
            yield _note("limits", where, None, None, message, "make it revolute if it has them")
        if joint.name in document.links:
            message = "shares its name with a link; frame_pose and the like take the link's frame"
            yield _note("names", where, joint.name, None, message)
        yield from _of_place(where, "it", joint.xyz, joint.rpy)
        if joint.type in urdf.WIDE_TYPES:
            message = f"is {joint.type}; it is locked where it stands"
            yield _note("type", where, joint.type, None, message)
        length = math.sqrt(sum(x * x for x in joint.axis)) if max(map(abs, joint.axis)) < 1e100 else math.inf
        if joint.moves and abs(length - 1.0) > 1e-3:
            message = f"its axis {_words(joint.axis)} has length {length:.4g}; it is taken as a direction"
            yield _warn("axis", where, length, 1.0, message, "write a unit vector")
        stands = robot.provenance["locked"].get(joint.name)
        if stands is not None and joint.mimic is None and not joint.lower <= stands <= joint.upper:
            message = f"is locked at {stands:g}, outside its limits {joint.lower:g}..{joint.upper:g}"
            bound = joint.upper if stands > joint.upper else joint.lower
            option = f"--lock {joint.name}={joint.nearest_to_zero():g}"
            yield _warn("limits", where, stands, bound, message, "lock it inside them", option)
        if joint.name in free:
            yield from _of_range(where, joint)
            yield from _of_motor(where, joint, robot)


def _of_range(where: str, joint: urdf.Joint) -> Iterator[Finding]:
    """Find position and velocity limits that are hardly meant."""
    lock = f"--lock {joint.name}"
    turns = joint.type == "revolute"
    widest = max(abs(joint.lower), abs(joint.upper)) if joint.type != "continuous" else 0.0
    if turns and widest > _ENDLESS:
        message = f"has the limits {joint.lower:g}..{joint.upper:g} rad, which are none"
        yield _warn("limits", where, widest, _ENDLESS, message, "make it continuous, or give its real limits")
    elif turns and widest > _MOST_TURN:
        message = f"has the limits {joint.lower:g}..{joint.upper:g} rad, which look like degrees"
        yield _warn("degrees", where, widest, _MOST_TURN, message, "write radians")
    elif joint.type == "prismatic" and widest > _MOST_LENGTH:
        message = f"has the limits {joint.lower:g}..{joint.upper:g} m"
        yield _warn("length", where, widest, _MOST_LENGTH, message, "check the unit: m, not mm")
    if joint.lower == joint.upper:
        message = f"cannot move: lower and upper limit are {joint.lower:g} (0 where the file has none)"
        yield _warn("limits", where, joint.lower, joint.upper, message, "give its range, or lock it", lock)
    elif not joint.lower <= 0.0 <= joint.upper:
        message = (
            f"0 is outside its limits {joint.lower:g}..{joint.upper:g}; runs start in the middle of them"
        )
        yield _note("neutral", where, 0.0, joint.lower if joint.lower > 0.0 else joint.upper, message)
    if joint.velocity < _LEAST_SPEED:
        message = f"has velocity limit {joint.velocity:g}; moves are planned as if it had none"
        yield _warn("velocity", where, joint.velocity, None, message, "give its speed")
    elif joint.type != "prismatic" and _MOST_SPIN < joint.velocity < math.inf:
        message = f"has velocity limit {joint.velocity:g} rad/s, which looks like degrees, or like none"
        yield _warn("velocity", where, joint.velocity, _MOST_SPIN, message, "write rad/s")


def _of_motor(where: str, joint: urdf.Joint, robot: Robot) -> Iterator[Finding]:
    """Find effort limits that are none."""
    effort = float(robot.limits.effort[robot.joint_names.index(joint.name)])
    unit, option = ("N" if joint.type == "prismatic" else "N m"), f"--effort {joint.name}=10"
    if effort == 0.0:
        message = "has effort limit 0, so no controller can move it"
        yield Finding("stop", "effort", where, 0.0, None, message, "give its torque, or lock it", option)
    elif effort > _MOST_EFFORT:
        message = f"has effort limit {effort:g} {unit}: torque is never cut"
        level: Level = "note" if math.isinf(effort) else "warn"
        yield Finding(
            level, "effort", where, effort, _MOST_EFFORT, message, "give what its motor can", option
        )


def _of_mimics(document: urdf.Urdf, robot: Robot) -> Iterator[Finding]:
    """Find joints that mimic another."""
    locked = robot.provenance["locked"]
    for joint in document.joints.values():
        if joint.mimic is None:
            continue
        where = f"joint {joint.name!r}"
        ratio = f"{joint.mimic_multiplier:g} x {joint.mimic!r} + {joint.mimic_offset:g}"
        if joint.name not in locked:
            yield _note("mimic", where, joint.mimic, None, f"follows {ratio}")
            continue
        value = locked[joint.name]
        if joint.mimic in robot.joint_names:
            message = f"mimics {ratio}; it is locked at {value:g} while that moves"
            repair = f"lock {joint.mimic!r} as well, or let it follow"
            yield _warn(
                "mimic", where, value, None, message, repair, f"--lock {joint.mimic} or --mimic follow"
            )
        if not joint.lower - 1e-9 <= value <= joint.upper + 1e-9 and joint.lower != joint.upper:
            message = f"is locked at {value:g}, outside its limits {joint.lower:g}..{joint.upper:g}"
            yield _note("mimic", where, value, joint.upper if value > joint.upper else joint.lower, message)


def _of_grippers(document: urdf.Urdf, robot: Robot) -> Iterator[Finding]:
    """Find grippers that move."""
    # Followers that were locked for following a joint that moves belong to what moves.
    locked = {
        name for name in robot.provenance["locked"] if document.joints[name].mimic not in robot.joint_names
    }
    for gripper in grippers.find(document, locked):
        option = f"--lock {','.join(gripper.joints)}"
        listed = ", ".join(map(repr, gripper.joints))
        several = len(gripper.joints) > 1
        message = (
            f"{listed} {'look' if several else 'looks'} like a gripper behind {gripper.after!r} "
            f"({gripper.reason}), and {'they move' if several else 'it moves'} with the arm"
        )
        where = f"joint {gripper.joints[0]!r}"
        yield _warn("gripper", where, listed, None, message, "lock it for the control of the arm", option)


def _of_shapes(document: urdf.Urdf) -> Iterator[Finding]:
    """Find shapes whose numbers cannot be read. Dynamics need none."""
    for element in document.root.findall("link"):
        where = f"link {element.get('name')!r}"
        for drawn in (*element.findall("visual"), *element.findall("collision")):
            for tag, key, count in _SHAPES:
                for shape in drawn.iter(tag):
                    problem = urdf.bad_numbers(shape, key, count, positive=key != "xyz" and key != "rpy")
                    if problem:
                        message = f"<{drawn.tag}>, <{tag}>: {problem} (dynamics need none)"
                        yield _warn("shape", where, shape.get(key), None, message, "correct or remove it")


def _of_meshes(document: urdf.Urdf, finder: MeshFinder) -> Iterator[Finding]:
    """Find meshes that are missing or may not be read. Dynamics need none."""
    for link in document.links.values():
        for name in link.meshes:
            found = finder.find(name)
            if found.path is not None:
                continue
            tried = f"; tried {', '.join(map(str, found.tried))}" if found.tried else ""
            shown = name if len(name) <= 200 else name[:197] + "..."
            message = f"mesh {shown!r} is not there: {found.reason}{tried} (dynamics need none)"
            repair = "say where the robot's package is, or ignore it"
            yield _warn("mesh", f"link {link.name!r}", shown, None, message, repair, "--package-dir FOLDER")


def _of_model(robot: Robot, samples: _Samples) -> Iterator[Finding]:
    """Find what the dynamics as a whole show."""
    model = robot.pinocchio_model()
    for index in range(1, model.njoints):
        mass, name = float(model.inertias[index].mass), model.names[index]
        if mass < _LEAST_MASS:
            links = ", ".join(map(repr, robot.links_moved_by(name)))
            what = "nothing of its own" if mass == 0.0 else f"only {mass:.3g} kg"
            message = f"carries {what} (links {links}), besides what hangs on the joints after it"
            repair = "give these links their mass and inertia, if they are more than frames"
            yield _warn("mass", f"joint {name!r}", mass, _LEAST_MASS, message, repair)
    least = float(samples.eigenvalues[:, 0].min())
    condition = float((samples.eigenvalues[:, -1] / samples.eigenvalues[:, 0]).max())
    row = int(np.argmin(samples.eigenvalues[:, 0]))
    vector = np.linalg.eigh(samples.inertia[row])[1][:, 0]
    weak = f"joint {robot.joint_names[int(np.argmax(np.abs(vector)))]!r}"
    repair = "give it the inertia of its rotor times the gear ratio squared: with_armature, or `armature`"
    if condition > _CONDITION:
        message = f"D(q) has condition {condition:.3g}, as this joint moves very little inertia"
        yield _warn("condition", weak, condition, _CONDITION, message, repair)
    elif least < _LEAST_EIGENVALUE:
        message = f"moves an inertia of only {least:.3g} at some configuration"
        yield _warn("condition", weak, least, _LEAST_EIGENVALUE, message, repair)
    effort, holding, shares = robot.limits.effort, np.abs(samples.gravity), robot.holding_share(samples.q)
    for j, name in enumerate(robot.joint_names):
        most, start = float(holding[:, j].max()), float(holding[0, j])
        if effort[j] == 0.0 or shares[:, j].max() <= 1.0:
            continue
        share = float((shares[:, j] > 1.0).mean())
        where, option = f"joint {name!r}", f"--effort {name}={1.5 * most:.3g}"
        if shares[0, j] > 1.0:
            message = (
                f"needs {start:.4g} to hold the arm where runs start, and has effort limit {effort[j]:g}"
            )
            repair = "start elsewhere (--from), or give what its motor can"
            yield Finding("stop", "gravity", where, start, float(effort[j]), message, repair, option)
        else:
            message = (
                f"needs up to {most:.4g} to hold the arm, and has effort limit {effort[j]:g}: too little at "
                f"{100.0 * share:.2g} % of {len(holding)} configurations"
            )
            repair = "keep the arm from there, or give what its motor can"
            yield _warn("gravity", where, most, float(effort[j]), message, repair, option)


def _of_control(
    robot: Robot, samples: _Samples, dt: float, delay: int, encoder_bits: int
) -> Iterator[Finding]:
    """Find what a controller with default gains will suffer from."""
    omega = default_omega(dt, delay * dt)
    viscous = robot.friction.viscous
    if viscous.any() or robot.friction.coulomb.any():
        rates = np.linalg.eigvals(np.linalg.solve(samples.inertia[0], np.diag(viscous)))
        fastest = float(rates.real.max())
        damped = f"joint {robot.joint_names[int(np.argmax(viscous))]!r}"
        message = "the URDF states joint friction; the plant has it only when asked for"
        yield _note("friction", "joints", float(viscous.max()), None, message, "", "--friction")
        if fastest > _FRICTION_RATE * omega:
            message = (
                f"the URDF's damping acts at up to {fastest:.3g} 1/s; with it in the plant (--friction) GPI "
                f"is unstable beyond {_FRICTION_RATE} omega_c = {_FRICTION_RATE * omega:.3g} 1/s"
            )
            repair = "let the controller believe in some rotor inertia (with_armature)"
            yield _warn("friction", damped, fastest, _FRICTION_RATE * omega, message, repair)
    if not robot.armature.any():
        message = "no rotor inertia: URDFs have none, and real gears make light wrists heavier"
        repair = "with_armature, or `armature` in the experiment file"
        yield _note("armature", "joints", 0.0, None, message, repair)
    yield from _of_tipping(robot, samples, omega, _MOST_PHASE / ((1.5 + delay) * dt))
    allowed = _omega_of_encoder(robot, samples, encoder_bits)
    for j, name in enumerate(robot.joint_names):
        if allowed[j] < omega:
            message = (
                f"one count of a {encoder_bits}-bit encoder costs more than {100 * _COUNT_SHARE:g} % of its "
                f"torque above omega_c = {allowed[j]:.3g} rad/s, and the default is {omega:.3g}"
            )
            level: Level = "warn" if allowed[j] < 0.5 * omega else "note"
            option = f"--omega {allowed[j]:.2g}"
            yield Finding(level, "encoder", f"joint {name!r}", float(allowed[j]), omega, message, "", option)


def _of_tipping(robot: Robot, samples: _Samples, omega: float, highest: float) -> Iterator[Finding]:
    """Find configurations that gravity makes unstable faster than the default bandwidth catches."""
    q, steps = samples.q[: _TIPPED + 1], _STEP * np.eye(robot.n)
    stiffness = np.empty_like(samples.inertia[: len(q)])
    for j, step in enumerate(steps):
        ahead, behind = robot.dynamics.gravity(q + step), robot.dynamics.gravity(q - step)
        stiffness[:, :, j] = (ahead - behind) / (2.0 * _STEP)
    values, vectors = np.linalg.eig(np.linalg.solve(samples.inertia[: len(q)], stiffness))
    tipping, fastest = -values.real.min(axis=1), values.real.argmin(axis=1)
    bound = _TIPPING * omega**2
    if not (tipping > bound).any():
        return
    start = bool(tipping[0] > bound)
    row = 0 if start else int(tipping.argmax())
    joint = robot.joint_names[int(np.abs(vectors[row][:, fastest[row]]).argmax())]
    enough = 1.05 * math.sqrt(float(tipping[row]) / _TIPPING)
    where = "where runs start" if start else f"at one of {len(q)} configurations"
    message = (
        f"gravity tips the arm over at {math.sqrt(tipping[row]):.3g} 1/s {where}, as it does with what is "
        f"short, light and upright; at the default bandwidth GPI catches up to {math.sqrt(bound):.3g} 1/s"
    )
    if enough <= highest:
        repair, option = "a higher bandwidth", f"--omega {math.ceil(enough):d}"
    else:
        repair = "a shorter sample time, the inertia that its links really have, or lock it"
        option = f"--lock {joint}"
    level: Level = "warn" if start else "note"
    yield Finding(level, "tipping", f"joint {joint!r}", float(tipping[row]), bound, message, repair, option)


def _omega_of_encoder(robot: Robot, samples: _Samples, bits: int) -> Array:
    """Return the bandwidth at which a count of an encoder costs a set share of the torque, (n,) [rad/s].

    A step of the measured position by one count is a step of v by beta3 counts, at once.
    """
    one = np.ones(1)
    beta3 = float(betas(Tuning(one, one, one)).beta3[0])  # at omega_c = 1; it grows with omega_c^2
    count = robot.encoder_count(bits)
    most = np.diagonal(samples.inertia, axis1=1, axis2=2).max(axis=0)
    # Roots apart: a limit of 1e308 would overflow.
    result: Array = np.sqrt(_COUNT_SHARE * robot.limits.effort) / np.sqrt(beta3 * most * count)
    result[robot.limits.effort == 0.0] = math.inf  # said elsewhere
    return result


def _shortened(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings, those of one kind beyond the first few as their number alone."""
    kept: list[Finding] = []
    count: dict[tuple[Level, str], int] = {}
    last: dict[tuple[Level, str], Finding] = {}
    for finding in findings:
        key = (finding.level, finding.kind)
        count[key] = count.get(key, 0) + 1
        last[key] = finding
        if count[key] <= _LISTED:
            kept.append(finding)
    for end, finding in last.items():
        if count[end] > _LISTED:
            more = count[end] - _LISTED
            message = f"{more} more of this kind, the last of them at {finding.where}"
            kept.append(finding._replace(where="others", value=more, bound=None, message=message))
    return kept


def _level(level: Level) -> Callable[..., Finding]:
    """Return a constructor of findings of one level."""

    def finding(
        kind: str,
        where: str,
        value: float | str | None,
        bound: float | str | None,
        message: str,
        repair: str = "",
        option: str = "",
    ) -> Finding:
        return Finding(level, kind, where, value, bound, message, repair, option)

    return finding


_warn, _note = _level("warn"), _level("note")


def _words(numbers: Iterable[float]) -> str:
    """Join numbers for a message."""
    return " ".join(f"{x:g}" for x in numbers)


def _plain(value: Any) -> Any:
    """Return data for JSON: no infinity."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
