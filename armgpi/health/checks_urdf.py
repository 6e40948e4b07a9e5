"""Checks of a URDF as written: what loads and is hardly meant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from difflib import get_close_matches

import numpy as np

from armgpi.errors import Remedy
from armgpi.health.findings import Finding, Level, Subject, check
from armgpi.robot import chains, from_mujoco, grippers, markup, tree, urdf
from armgpi.robot.batch import enough_effort

#: Turns beyond two to either side are hardly meant in radians [rad], nor such speeds [rad/s].
_MOST_TURN, _MOST_SPIN = 4.0 * math.pi, 60.0
#: Speed limits below this are taken as no limit [rad/s or m/s].
_LEAST_SPEED = 1e-6
#: Position limits beyond this are practically no limits [rad].
_ENDLESS = 1000.0
#: Soft limits are narrower than limits when by more than this [rad or m].
_SOFT_ROUNDING = 1e-3
#: Lengths that are hardly meant in metres [m].
_MOST_LENGTH = 20.0
_MOST_MASS, _MOST_EFFORT = 1e4, 1e5
#: Radii of gyration that no part of a robot has [m].
_LEAST_GYRATION, _MOST_GYRATION = 1e-4, 5.0
#: An inertia's largest moment may be so much larger than the sum of the others by rounding.
_TRIANGLE_ROUNDING = 0.01
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


@check("repair", "what was repaired on request when the file was loaded", "info")
def repairs(subject: Subject) -> Iterator[Finding]:
    """Find what is otherwise than the file says."""
    for made in subject.robot.provenance.get("repairs", ()):
        element = made["name"].partition(":")[2]
        where = f"{'link' if element in subject.document.links else 'joint'} {element!r}"
        message = (
            f"was repaired ({made['name']}): the file contains {made['before']}; {made['after']} is used"
        )
        yield Finding("info", where, message, made["name"])


@check("twice", "an element that may be there once; the first one is read", "warning")
def twice(subject: Subject) -> Iterator[Finding]:
    """Find duplicate elements."""
    for tag, singles in _SINGLE.items():
        for element in subject.document.root.findall(tag):
            children = [child.tag for child in element]
            for single in singles:
                if children.count(single) > 1:
                    message = f"has {children.count(single)} <{single}>, of which the first is read"
                    where = f"{tag} {element.get('name')!r}"
                    yield Finding("warning", where, message, repair="remove the others")


@check("unknown", "an element that is not part of URDF; a warning where it looks misspelt", "warning", "info")
def unknown(subject: Subject) -> Iterator[Finding]:
    """Find elements that URDF does not know: misspelt, they are not read."""
    root = subject.document.root
    for tag, known in _KNOWN.items():
        for element in [root] if tag == "robot" else root.findall(tag):
            for child in dict.fromkeys(child.tag for child in element):
                if child in known or ":" in child:
                    continue
                near = get_close_matches(child, known, n=1, cutoff=0.7)
                message = f"has a <{child[:80]}>, which is no element of URDF and is ignored"
                repair = f"did you mean <{near[0]}>?" if near else ""
                level: Level = "warning" if near else "info"
                yield Finding(level, f"{tag} {element.get('name')!r}", message, child, None, repair)


@check("xacro", "a definition of xacro that is used nowhere, and is not read", "warning")
def xacro(subject: Subject) -> Iterator[Finding]:
    """Find what an expansion by xacro, or by hand, left behind."""
    for element in subject.document.root.iter():
        if element.tag in markup.XACRO_DEFINITIONS:
            name = element.get("name", "")
            message = f"line {element.get('line')}: <{element.tag} name={name[:80]!r}> is used nowhere"
            yield Finding("warning", "robot", message, name, None, "remove it")


@check("frames", "links without mass", "info")
def frames(subject: Subject) -> Iterator[Finding]:
    """Count links without mass."""
    links = subject.document.links.values()
    count = sum(not link.inertial or link.mass == 0.0 for link in links)
    if count:
        message = f"{count} of {len(links)} links have no mass: frames of tools and sensors"
        yield Finding("info", "links", message, count)


@check(
    "inertia",
    "mass without inertia, or the inertia of something many metres wide; an incomplete or impossible "
    "inertia of a link that does not move",
    "warning",
    "info",
)
def inertia(subject: Subject) -> Iterator[Finding]:
    """Find inertias that the mass of their link does not explain."""
    carried = {joint.child for joint in subject.free}
    for link in subject.document.links.values():
        where = f"link {link.name!r}"
        if link.missing:
            message = f"has an <inertial> without <{link.missing}>; it does not move, so dynamics need none"
            yield Finding("warning", where, message, repair="add it for other tools")
        if not link.inertial or link.mass == 0.0 or link.missing:
            continue
        least, _, most = (float(moment) for moment in link.moments())
        if link.name not in subject.moved:
            if least < 0.0:
                message = "has an inertia that is not positive; it does not move, so dynamics need none"
                yield Finding("info", where, message, least, 0.0)
            continue
        if most < _LEAST_GYRATION**2 * link.mass:
            message = "has mass and hardly any inertia, as a point has"
            level: Level = "warning" if link.name in carried else "info"
            yield Finding(level, where, message, most, None, "specify the inertia of its body")
        gyration = math.sqrt(max(most, 0.0) / link.mass)
        if gyration > _MOST_GYRATION:
            message = (
                f"has the inertia of a body {2.0 * gyration:.3g} m wide at its mass of {link.mass:.4g} kg"
            )
            yield Finding("warning", where, message, gyration, _MOST_GYRATION, "check the units: kg m^2, kg")


@check("inertia", "an inertia that is written in full and is not symmetric", "info")
def asymmetric(subject: Subject) -> Iterator[Finding]:
    """Find products of inertia that are written twice, and are not the same.

    No warning: what is used is what URDF has, and may well be right.
    """
    for element in subject.document.root.findall("link"):
        written = element.find("inertial/inertia")
        if written is None:
            continue
        for key, other in urdf.MIRRORED.items():
            with suppress(ValueError):  # where one of them is not there, or no number
                one, two = float(written.get(key, "")), float(written.get(other, ""))
                if one != two:
                    message = f"has {key} {one:g} and {other} {two:g}, which are one number; {key} is used"
                    repair = f"correct the file, whose {other} URDF does not have"
                    yield Finding("info", f"link {element.get('name')!r}", message, two, one, repair)


@check(
    "triangle",
    "the largest principal moment is more than the sum of the others: no rigid body has it. Up to 1 %, or "
    "where nothing moves, it is an info",
    "warning",
    "info",
)
def triangle(subject: Subject) -> Iterator[Finding]:
    """Find inertias against the triangle inequality."""
    for link in subject.document.links.values():
        moments = link.moments()
        most, others = float(moments[2]), float(moments[0] + moments[1])
        moving = link.name in subject.moved
        if link.mass == 0.0 or most - others <= 1e-9 * most or (moments[0] < 0.0 and not moving):
            continue
        tells = most - others > _TRIANGLE_ROUNDING * most
        others = 0.0 if abs(others) <= 1e-9 * most else others  # what eigenvalues are rounded to
        message = (
            f"no rigid body has its inertia: the largest principal moment {most:.4g} is more than "
            f"the sum of the others, {others:.4g} kg m^2 (triangle inequality)"
        )
        repair = "take the inertia from CAD again; simulators such as MuJoCo refuse it" if tells else ""
        level: Level = "warning" if tells and moving else "info"
        yield Finding(level, f"link {link.name!r}", message, most, others, repair)


@check("mass", "a link of more than 10 t", "warning")
def heavy(subject: Subject) -> Iterator[Finding]:
    """Find masses in grams."""
    for link in subject.document.links.values():
        if link.name in subject.moved and link.mass > _MOST_MASS:
            message, repair = f"weighs {link.mass:.4g} kg", "check the unit: kg"
            yield Finding("warning", f"link {link.name!r}", message, link.mass, _MOST_MASS, repair)


def _places(subject: Subject) -> Iterator[tuple[str, str, tree.Joint | tree.Link]]:
    """Give what has an origin: every joint, and the centre of mass of every link that moves."""
    for joint in subject.document.joints.values():
        yield f"joint {joint.name!r}", "it", joint
    for link in subject.document.links.values():
        if link.name in subject.moved and link.mass > 0.0:
            yield f"link {link.name!r}", "the centre of mass", link


@check("length", "more than 20 m: millimetres, perhaps", "warning")
def length(subject: Subject) -> Iterator[Finding]:
    """Find origins and travels in millimetres."""
    repair = "check the unit: m, not mm"
    for where, what, place in _places(subject):
        far = max(place.xyz, key=abs)
        if abs(far) > _MOST_LENGTH:
            yield Finding("warning", where, f"{what} is {far:g} m away", far, _MOST_LENGTH, repair)
    for joint in subject.free:
        widest = max(abs(joint.lower), abs(joint.upper))
        if joint.type == "prismatic" and widest > _MOST_LENGTH:
            message = f"has the limits {joint.lower:g}..{joint.upper:g} m"
            yield Finding("warning", f"joint {joint.name!r}", message, widest, _MOST_LENGTH, repair)


@check(
    "degrees",
    "a limit beyond two turns, or an origin turned by more than one: degrees, perhaps",
    "warning",
)
def degrees(subject: Subject) -> Iterator[Finding]:
    """Find origins and position limits in degrees."""
    for where, what, place in _places(subject):
        turned = max(place.rpy, key=abs)
        if abs(turned) > 2.0 * math.pi + 0.01:
            message, repair = f"{what} is turned by {turned:g} rad", "check the unit: radians, not degrees"
            yield Finding("warning", where, message, turned, 2.0 * math.pi, repair)
    for joint in subject.free:
        widest = max(abs(joint.lower), abs(joint.upper))
        if joint.type == "revolute" and _MOST_TURN < widest <= _ENDLESS:
            message = f"has the limits {joint.lower:g}..{joint.upper:g} rad, which look like degrees"
            yield Finding("warning", f"joint {joint.name!r}", message, widest, _MOST_TURN, "write radians")


@check("axis", "an axis that is not a unit vector; it is taken as a direction", "warning")
def axis_length(subject: Subject) -> Iterator[Finding]:
    """Find axes that are no unit vectors."""
    for joint in subject.document.joints.values():
        tame = max(map(abs, joint.axis)) < 1e100
        length = math.sqrt(sum(x * x for x in joint.axis)) if tame else math.inf
        if joint.moves and abs(length - 1.0) > 1e-3:
            axis = " ".join(f"{x:g}" for x in joint.axis)
            message = f"its axis {axis} has length {length:.4g}; it is taken as a direction"
            yield Finding("warning", f"joint {joint.name!r}", message, length, 1.0, "write a unit vector")


@check("axis", "no axis, which means 1 0 0", "info")
def no_axis(subject: Subject) -> Iterator[Finding]:
    """Find joints whose axis is the default one."""
    for joint in subject.document.joints.values():
        if joint.moves and subject.elements[joint.name].find("axis") is None:
            yield Finding("info", f"joint {joint.name!r}", "has no <axis>, which means 1 0 0")


@check("limits", "no range (0 to 0, or equal limits), or more than 1,000 rad", "warning")
def position_range(subject: Subject) -> Iterator[Finding]:
    """Find position limits that leave no range, or that do not limit."""
    for joint in subject.free:
        where, span = f"joint {joint.name!r}", f"{joint.lower:g}..{joint.upper:g}"
        widest = max(abs(joint.lower), abs(joint.upper))
        if joint.type == "revolute" and widest > _ENDLESS:
            message = f"has the limits {span} rad, which are practically none"
            repair = "make it continuous, or specify its real limits"
            yield Finding("warning", where, message, widest, _ENDLESS, repair)
        if joint.lower == joint.upper:
            message = f"cannot move: lower and upper limit are {joint.lower:g} (0 where the file has none)"
            remedies = (Remedy("lock", (joint.name,)),)
            repair = "specify its range, or lock it"
            yield Finding("warning", where, message, joint.lower, joint.upper, repair, remedies)


@check("soft", "soft limits of a <safety_controller> that are narrower; they are not limits here", "warning")
def soft_limits(subject: Subject) -> Iterator[Finding]:
    """Find soft limits that the robot's own controller holds, and that nothing here reads."""
    for joint in subject.free:
        element = subject.elements[joint.name].find("safety_controller")
        if element is None or joint.type == "continuous":
            continue
        try:
            # By ROS, 0 where they are missing; both 0 then mean that there are none.
            lower, upper = (float(element.get(f"soft_{end}_limit", "0")) for end in ("lower", "upper"))
        except ValueError:
            continue
        narrower = lower > joint.lower + _SOFT_ROUNDING or upper < joint.upper - _SOFT_ROUNDING
        if lower < upper and narrower:
            message = (
                f"has soft limits {lower:g}..{upper:g} inside its limits {joint.lower:g}..{joint.upper:g}"
            )
            repair = "its own controller stops it there: write them into lower and upper of <limit>"
            yield Finding("warning", f"joint {joint.name!r}", message, lower, joint.lower, repair)


@check("limits", "a joint that is locked outside its limits", "warning")
def locked_outside(subject: Subject) -> Iterator[Finding]:
    """Find joints that are locked outside their limits."""
    for name, value in subject.locked.items():
        joint = subject.document.joints[name]
        if joint.mimic is None and not joint.lower <= value <= joint.upper:
            message = f"is locked at {value:g}, outside its limits {joint.lower:g}..{joint.upper:g}"
            bound = joint.upper if value > joint.upper else joint.lower
            remedies = (Remedy("lock", (name,), joint.nearest_to_zero()),)
            yield Finding(
                "warning", f"joint {name!r}", message, value, bound, "lock it inside them", remedies
            )


@check("limits", "a continuous joint with position limits, which are not read", "info")
def limits_of_continuous(subject: Subject) -> Iterator[Finding]:
    """Find position limits that are not read."""
    for joint in subject.document.joints.values():
        limit = subject.elements[joint.name].find("limit")
        if joint.type == "continuous" and limit is not None and {"lower", "upper"} & set(limit.attrib):
            message = "is continuous; the position limits that it has all the same are not read"
            repair = "make it revolute if it has them"
            yield Finding("info", f"joint {joint.name!r}", message, repair=repair)


@check("neutral", "0 is outside the position limits", "info")
def neutral(subject: Subject) -> Iterator[Finding]:
    """Find joints whose range does not contain 0."""
    for joint in subject.free:
        if joint.lower < joint.upper and not joint.lower <= 0.0 <= joint.upper:
            message = (
                f"0 is outside its limits {joint.lower:g}..{joint.upper:g}; runs start in the middle of them"
            )
            bound = joint.lower if joint.lower > 0.0 else joint.upper
            yield Finding("info", f"joint {joint.name!r}", message, 0.0, bound)


@check("velocity", "a speed limit of 0, or one beyond 60 rad/s", "warning")
def velocity(subject: Subject) -> Iterator[Finding]:
    """Find velocity limits that are hardly meant."""
    for joint in subject.free:
        where = f"joint {joint.name!r}"
        if joint.velocity < _LEAST_SPEED:
            message = f"has velocity limit {joint.velocity:g}; moves are planned as if it had none"
            yield Finding("warning", where, message, joint.velocity, None, "specify its velocity limit")
        elif joint.type != "prismatic" and _MOST_SPIN < joint.velocity < math.inf:
            message = f"has velocity limit {joint.velocity:g} rad/s, which looks like degrees, or like none"
            yield Finding("warning", where, message, joint.velocity, _MOST_SPIN, "write rad/s")


@check("effort", "an effort limit of 0: no controller can move the joint", "error")
def no_effort(subject: Subject) -> Iterator[Finding]:
    """Find joints without torque."""
    holding = np.abs(subject.gravity).max(axis=0)
    rows = zip(subject.robot.joint_names, subject.robot.limits.effort, holding, strict=True)
    for name, effort, held in rows:
        if effort == 0.0:
            message = "has effort limit 0, so no controller can move it"
            proposed = enough_effort(float(held))
            repair, remedies = "specify its effort limit, or lock it", (Remedy("effort", (name,), proposed),)
            yield Finding("error", f"joint {name!r}", message, 0.0, None, repair, remedies)


@check(
    "effort",
    "an effort limit above 1e5: torque is never saturated; without a `<limit>` it is an info",
    "warning",
    "info",
)
def endless_effort(subject: Subject) -> Iterator[Finding]:
    """Find effort limits that do not limit."""
    holding = np.abs(subject.gravity).max(axis=0)
    rows = zip(subject.free, subject.robot.limits.effort.tolist(), holding, strict=True)
    for joint, effort, held in rows:
        if effort > _MOST_EFFORT:
            unit = "N" if joint.type == "prismatic" else "N m"
            message = f"has effort limit {effort:g} {unit}: torque is never saturated"
            absent = math.isinf(effort) and subject.elements[joint.name].find("limit") is None
            level: Level = "info" if absent else "warning"
            proposed = enough_effort(float(held))
            repair, remedies = "specify the effort of its motor", (Remedy("effort", (joint.name,), proposed),)
            yield Finding(level, f"joint {joint.name!r}", message, effort, _MOST_EFFORT, repair, remedies)


@check("names", "a link and a joint of one name", "info")
def names(subject: Subject) -> Iterator[Finding]:
    """Find joints named like a link."""
    for name in subject.document.joints:
        if name in subject.document.links:
            message = "shares its name with a link; frame_pose and the like take the link's frame"
            yield Finding("info", f"joint {name!r}", message, name)


@check("type", "a floating or planar joint that is locked", "info")
def multi_dof(subject: Subject) -> Iterator[Finding]:
    """Find multi-DoF joints."""
    for joint in subject.document.joints.values():
        if joint.type in tree.MULTI_DOF_TYPES:
            message = f"is {joint.type}; it is locked at its origin"
            yield Finding("info", f"joint {joint.name!r}", message, joint.type)


@check("mimic", "a mimic joint is locked while its leader moves", "warning")
def locked_mimic(subject: Subject) -> Iterator[Finding]:
    """Find joints that would move if their mimic were followed."""
    for joint in subject.document.joints.values():
        if joint.mimic in subject.robot.joint_names and joint.name in subject.locked:
            value = subject.locked[joint.name]
            message = f"mimics {_describe_mimic(joint)}; it is locked at {value:g} while that moves"
            repair = f"lock {joint.mimic!r} as well, or let it follow"
            remedies = (Remedy("lock", (str(joint.mimic),)), Remedy("mimic", (), "follow"))
            yield Finding("warning", f"joint {joint.name!r}", message, value, None, repair, remedies)


@check("mimic", "it follows its leader; or it is locked outside its limits", "info")
def following(subject: Subject) -> Iterator[Finding]:
    """Find joints that follow another, and where that leads."""
    for joint in subject.document.joints.values():
        if joint.mimic is None:
            continue
        where = f"joint {joint.name!r}"
        if joint.name not in subject.locked:
            yield Finding("info", where, f"follows {_describe_mimic(joint)}", joint.mimic)
            continue
        value = subject.locked[joint.name]
        if not joint.lower - 1e-9 <= value <= joint.upper + 1e-9 and joint.lower != joint.upper:
            message = f"is locked at {value:g}, outside its limits {joint.lower:g}..{joint.upper:g}"
            bound = joint.upper if value > joint.upper else joint.lower
            yield Finding("info", where, message, value, bound)


def _describe_mimic(joint: tree.Joint) -> str:
    """Return what a joint mimics, for a message."""
    return f"{joint.mimic_multiplier:g} x {joint.mimic!r} + {joint.mimic_offset:g}"


@check("gripper", "a gripper moves with the arm", "warning")
def gripper(subject: Subject) -> Iterator[Finding]:
    """Find grippers that move."""
    # Followers that were locked for following a joint that moves belong to what moves.
    joints, free = subject.document.joints, subject.robot.joint_names
    locked = {name for name in subject.locked if joints[name].mimic not in free}
    for each in grippers.find(subject.document, locked):
        listed = ", ".join(map(repr, each.joints))
        several = len(each.joints) > 1
        message = (
            f"{listed} {'look' if several else 'looks'} like a gripper behind {each.after!r} "
            f"({each.reason}), and {'they move' if several else 'it moves'} with the arm"
        )
        repair, remedies = "lock it for the control of the arm", (Remedy("lock", each.joints),)
        yield Finding("warning", f"joint {each.joints[0]!r}", message, listed, None, repair, remedies)


@check("chains", "legs, wheels and arms that run as one arm", "warning")
def whole(subject: Subject) -> Iterator[Finding]:
    """Find whole robots."""
    if several := chains.of(subject.robot.provenance):
        arm = chains.first_arm(several).name
        remedies = (Remedy("keep", (arm,)),)
        repair = "keep one of them by its name"
        yield Finding("warning", "robot", chains.describe(several), len(several), 1, repair, remedies)


@check("fluid", "a fluid around the arm of an MJCF, whose forces are left out", "warning")
def fluid(subject: Subject) -> Iterator[Finding]:
    """Find a fluid, such as water, whose forces MuJoCo adds and armgpi does not."""
    compiled = subject.document.compiled
    around = "" if compiled is None else from_mujoco.fluid(compiled)
    if around:
        repair = "take density and viscosity out of <option> if the arm moves in air"
        yield Finding("warning", "robot", around, float(compiled.opt.density), 0.0, repair)


@check("shape", "a shape without a solid, or a size or origin that is not a number", "warning")
def shape(subject: Subject) -> Iterator[Finding]:
    """Find shapes that cannot be read. Dynamics need none."""
    for element in subject.document.root.findall("link"):
        where = f"link {element.get('name')!r}"
        for drawn in (*element.findall("visual"), *element.findall("collision")):
            for problem, value in urdf.shape_problems(drawn):
                message = f"<{drawn.tag}>{problem} (dynamics need none)"
                yield Finding("warning", where, message, value, None, "correct or remove it")


@check("mesh", "it is missing or may not be read; every path tried is named", "warning")
def mesh(subject: Subject) -> Iterator[Finding]:
    """Find meshes that are missing or may not be read. Dynamics need none."""
    for link in subject.document.links.values():
        for name in link.meshes:
            found = subject.finder.find(name)
            if found.path is not None:
                continue
            tried = f"; tried {', '.join(map(str, found.tried))}" if found.tried else ""
            shown = name if len(name) <= 200 else name[:197] + "..."
            message = f"mesh {shown!r} is not there: {found.reason}{tried} (dynamics need none)"
            repair = "give the folder of the robot's package, or ignore it"
            remedies = (Remedy("package_dir"),)
            yield Finding("warning", f"link {link.name!r}", message, shown, None, repair, remedies)
