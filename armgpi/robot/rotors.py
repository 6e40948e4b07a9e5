"""Rotors and gears that a file does not contain: what is assumed, by published drives (tools/rotors.py).

A motor that gives a torque T up to a speed v can turn its own rotor from rest to v in some time J v / T,
all as seen at the joint. Over five decades of J that time is nearly the same, as larger motors and higher
gear ratios raise T / v as they raise J: the gear ratio cancels. So a joint without a word of its rotor is
assumed to have J = SPIN_UP T / v.

A joint deflects by some angle under its largest torque, small ones as large ones: so a joint without
stiffness is assumed to have K = T / TWIST; that of a slide's belt, K = F / STRETCH.
"""

from __future__ import annotations

import math

import numpy as np

from armgpi.base import renamed
from armgpi.base.arrays import Array, check_choice, check_type
from armgpi.base.hints import with_keyword_hints
from armgpi.base.renamed import current_name
from armgpi.errors import ParameterError
from armgpi.robot.drives import Drives
from armgpi.robot.equations import ASSUMED_GEAR_RATIO
from armgpi.robot.kinematics import random_configurations
from armgpi.robot.known_arms import published_drives
from armgpi.robot.robot import Robot

#: Time in which a motor turns its own rotor to the velocity limit [s]: the geometric mean of those to fit,
#: each robot with the same weight (tools/rotors.py).
SPIN_UP = 0.0226
#: Factor either way of the assumed value within which 95 % of the held-out joints are (tools/rotors.py).
SCATTER = 2.5
#: Angle by which a gear twists under its torque limit [rad], and the factor either way within which it is
#: taken to be. Harmonic drives alone twist by some 5 mrad under their repeated peak torque (first stiffness
#: K1 of sizes 14 to 32, as cited from their catalogues, not looked up again; 31 kN m/rad at 100:1 in
#: CompliantJointToolbox, from a data sheet); links, bearings and torque sensors add to it.
TWIST, TWIST_SCATTER = 8e-3, 2.0
#: Length by which the belt of a slide stretches under its limit [m]: half a metre at the belt's allowable
#: load, which is 0.4 % of its specific spring rate (1100 N of 275 kN; Elatech ATL5, T5 and AT5 likewise).
STRETCH = 2e-3
#: Median ITAE of a law that assumes gears over that of one for stiff joints, on arms with stiff joints
#: (docs/drives_measured.md, `undriven`).
SOFT_COST = 9.4
#: An effort or velocity limit from here on, or of zero, is a word for none [N m or N, rad/s or m/s]; so is a
#: velocity below the last: a turn takes a week.
_NO_EFFORT, _NO_VELOCITY, _STILL = 1000.0, 100.0, 1e-5
#: Most that an arm's strongest joint may have over its largest gravity torque: limits above are no motors'.
_MOST_GRAVITY = 20.0
#: Where nothing tells the torque or speed of a motor: so many times the joint's largest gravity torque,
#: which is at least a share of the arm's; and that speed [rad/s or m/s].
_GRAVITIES, _LEAST_SHARE, _SPEED = 3.0, 0.1, 3.0
#: Configurations at which gravity torques are computed.
_GRAVITY_CONFIGURATIONS = 50
#: Gravity [m/s^2] of an arm mounted on a wall or a floor.
_GRAVITY_DIRECTIONS = ((9.81, 0.0, 0.0), (0.0, 9.81, 0.0), (0.0, 0.0, 9.81))
#: An arm moves in a horizontal plane where its gravity torque is below this share of what it is otherwise.
_HORIZONTAL = 0.05
#: What may be taken where nothing is known of drives; see :func:`assume_drives`.
ASSUMPTIONS = ("elastic", "stiff", "none")
#: Where encoders sit.
SIDES = ("motor", "link")


def silent(robot: Robot) -> tuple[str, ...]:
    """Return the joints of whose rotors nothing is known."""
    sources = robot.drives.sources("rotor_inertia")
    known = zip(robot.joint_names, sources, robot.armature, strict=True)
    return tuple(name for name, source, inertia in known if not source and not inertia)


def typical_inertia(robot: Robot) -> Array:
    """Return the rotor inertia that each joint of an arm is assumed to have [kg m^2 or kg], (n,)."""
    velocity = np.abs(robot.limits.velocity)
    speed = np.where((velocity > _STILL) & (velocity < _NO_VELOCITY), velocity, _SPEED)
    return np.asarray(SPIN_UP * motor_torque(robot) / speed)


def motor_torque(robot: Robot) -> Array:
    """Return the torque limit of each motor [N m or N], (n,), assumed where the limit is a word for none."""
    effort = np.abs(robot.limits.effort)
    gravity = _gravity_torque(robot)
    largest = float(gravity.max())
    told = (effort > 0.0) & (effort < _NO_EFFORT)
    strongest = float(effort[told].max(initial=0.0))
    if strongest > _MOST_GRAVITY * largest > 0.0:
        effort = effort * _MOST_GRAVITY * largest / strongest
    guessed = _GRAVITIES * np.maximum(gravity, _LEAST_SHARE * largest)
    return np.where(told, effort, guessed)


def _gravity_torque(robot: Robot) -> Array:
    """Return the largest gravity torque of each joint at random configurations [N m or N], (n,).

    Of an arm that moves in a horizontal plane, gravity tells nothing: it is taken as if it stood upright.
    """
    q = random_configurations(robot, _GRAVITY_CONFIGURATIONS, seed=0)
    mounted = np.abs(robot.gravity(q)).max(axis=0)
    turned = [np.abs(robot.with_gravity(g).gravity(q)).max(axis=0) for g in _GRAVITY_DIRECTIONS]
    upright = np.max(turned, axis=0)
    return np.asarray(upright if mounted.max() < _HORIZONTAL * upright.max() else mounted)


@with_keyword_hints
def assume_drives(robot: Robot, drives: str | None = None) -> Robot:
    """Return the arm with what is published or assumed of its drives where nothing is known of them.

    Args:
        robot: the arm.
        drives: "elastic" for rotors and elastic joints; "stiff" for rotors and stiff joints; "none" for no
            rotors. None is "elastic", and leaves an arm alone of whose rotors or stiffness something is
            assumed already. But for "none", what is published of a known arm
            (:mod:`armgpi.robot.known_arms`) comes first.

    Raises:
        ParameterError: for another word, or what is no robot.
    """
    check_type(robot, "robot", Robot, "a Robot")
    if drives is None:
        return robot if _is_assumed_already(robot) else assume_gears(robot)
    drives = current_name(drives, renamed.DRIVES)
    check_choice(drives, "drives", ASSUMPTIONS)
    return {"elastic": assume_gears, "stiff": assume_rotors, "none": without_rotors}[drives](robot)


def _is_assumed_already(robot: Robot) -> bool:
    """Tell whether rotors or joint elasticity of an arm were assumed before.

    Logs that do not determine a number leave it "assumed" as well: that says nothing of the elasticity. They
    have friction too, which nothing else assumes: of sensors behind the gears no rotor is "identified".
    """
    if "assumed" in robot.drives.sources("stiffness"):
        return True
    sources = robot.drives.sources("rotor_inertia")
    from_logs = "identified" in sources or "assumed" in robot.drives.sources("coulomb")
    return "assumed" in sources and not from_logs


def assume_rotors(robot: Robot) -> Robot:
    """Return the arm with published or assumed rotors where nothing is known of them."""
    robot = with_published(robot)
    rotors = _assumed_rotors(robot)
    return robot.with_drives(rotors) if rotors.data else robot


def with_published(robot: Robot) -> Robot:
    """Return an arm with what is published of its drives where nothing is known of them; else the same."""
    published = published_drives(robot)
    return robot.with_drives(published) if published.data else robot


def joints_without_side(robot: Robot) -> tuple[str, ...]:
    """Return the joints whose drives do not specify where the encoder sits."""
    sources = robot.drives.sources("encoder_side")
    return tuple(name for name, source in zip(robot.joint_names, sources, strict=True) if not source)


def with_encoder_side(robot: Robot, side: str) -> Robot:
    """Return an arm whose encoders sit at one side where its drives do not specify another.

    Args:
        robot: the arm.
        side: "motor" or "link".

    Raises:
        ParameterError: for another word, and where the drives of all joints specify a side, one of them
            another: then it would change nothing.
    """
    check_choice(side, "encoder_side", SIDES)
    unknown = joints_without_side(robot)
    if unknown:
        return robot.with_drives({joint: {"encoder_side": side} for joint in unknown})
    for joint, own in zip(robot.joint_names, robot.drives.value("encoder_side"), strict=True):
        if own != side:
            expected = f"{str(own)!r}, as the drives of joint {joint!r} specify: change these, or omit it"
            raise ParameterError("encoder_side", side, expected)
    return robot


def _assumed_rotors(robot: Robot) -> Drives:
    """Return rotors for the joints of whose rotors nothing is known."""
    names, every = silent(robot), zip(robot.joint_names, typical_inertia(robot).tolist(), strict=True)
    value = {name: inertia for name, inertia in every if name in names}
    low, high = ({name: factor * x for name, x in value.items()} for factor in (1.0 / SCATTER, SCATTER))
    own = Drives(robot.joint_names)
    return own.with_value("rotor_inertia", value, low, high, source="assumed") if value else own


def assume_gears(robot: Robot) -> Robot:
    """Return the arm with assumed stiffness of the gears where nothing is known of it.

    Rotors of which nothing is known are assumed as well: an elastic joint is between two masses.
    """
    robot = with_published(robot)
    rotors, known = _assumed_rotors(robot), robot.drives.data.get("stiffness", {})
    # One change of the arm, so that one read back from a file has the same history.
    armature = np.maximum(robot.armature, rotors.value("rotor_inertia", 0.0))
    twist = np.where(robot.prismatic, STRETCH, TWIST)
    every = zip(robot.joint_names, (motor_torque(robot) / twist).tolist(), armature, strict=True)
    value = {name: K for name, K, rotor in every if name not in known and rotor > 0.0}
    low, high = ({name: f * K for name, K in value.items()} for f in (1.0 / TWIST_SCATTER, TWIST_SCATTER))
    more = rotors.with_value("stiffness", value, low, high, source="assumed")
    return robot.with_drives(more) if more.data else robot


def lowest_mode(links: Array, rotor: Array, stiffness: Array) -> float:
    """Return the lowest natural frequency of an arm with free motors [Hz].

    Args:
        links: inertia matrix without rotors [kg m^2], (n, n).
        rotor: inertia of the rotors [kg m^2 or kg], (n,).
        stiffness: of the gears [N m/rad or N/m], (n,).
    """
    # Of the twist alone, which accelerates by -(M^-1 + J^-1) K twist.
    both = np.linalg.inv(links) + np.diag(1.0 / rotor)
    return math.sqrt(max(np.linalg.eigvals(both * stiffness).real.min(), 0.0)) / (2.0 * math.pi)


def without_rotors(robot: Robot) -> Robot:
    """Return the arm specified to have no rotors where nothing is known of them."""
    return robot.with_armature(dict.fromkeys(silent(robot), 0.0)) if silent(robot) else robot


def assumed_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints whose rotors are assumed."""
    sources = robot.drives.sources("rotor_inertia")
    return tuple(name for name, source in zip(robot.joint_names, sources, strict=True) if source == "assumed")


def told_none(robot: Robot) -> tuple[str, ...]:
    """Return the joints that the user, not the file of the arm, specified to have no rotor."""
    own = robot.drives.data.get("rotor_inertia", {})
    return tuple(
        joint
        for joint, datum in own.items()
        if datum.source == "specified" and not (datum.value or datum.file)
    )


def unlike(nominal: Robot, arm: Robot) -> str:
    """Return in a line that a controller assumes rotors which a simulated arm lacks; or nothing."""
    both = set(assumed_joints(nominal)) & set(silent(arm))
    names = ", ".join(name for name in arm.joint_names if name in both)
    return names and (
        f"the controller assumes rotor inertia in {names}, and the simulated arm has none; the loop "
        "may be unstable: make both of armgpi.assume_drives(robot), or specify both by "
        "robot.with_armature(...)"
    )


def describe(robot: Robot) -> str:
    """Return in a line the rotor inertia that is assumed, or that it was specified as zero; or nothing."""
    if none := told_none(robot):
        return (
            f"rotor inertia was specified as zero: {', '.join(none)}; with geared motors the loop would be "
            "unstable"
        )
    rows = _assumed_rows(robot, "rotor_inertia")
    return rows and (
        f"the URDF contains no rotor inertia; assumed [kg m² or kg, within a factor of {SCATTER:g}]: {rows}; "
        "specify it by --rotor-inertia or --drives FILE, or none by --drives none"
    )


def describe_gears(robot: Robot) -> str:
    """Return in a line the joint stiffness that is assumed; or nothing."""
    rows = _assumed_rows(robot, "stiffness")
    return rows and (
        f"the URDF contains no joint stiffness; assumed [N m/rad or N/m, within a factor of "
        f"{TWIST_SCATTER:g}]: {rows}; if joints are stiff, --drives stiff has 1/{SOFT_COST:g} of the ITAE, "
        "but destabilises most arms with elastic joints; specify stiffness by --drives FILE"
    )


def describe_ratio(robot: Robot) -> str:
    """Return in a line the gear ratio that is assumed behind encoders at motors; or nothing."""
    joints = joints_with_assumed_ratio(robot)
    return joints and (
        f"the gear ratio of {joints} is not specified; {ASSUMED_GEAR_RATIO:g} is assumed, by which an "
        "encoder at the motor is finer than one at the link; specify gear_ratio by --drives FILE, 1 for a "
        "direct drive"
    )


def joints_with_assumed_ratio(robot: Robot) -> str:
    """Return the joints with an encoder at the motor whose gear ratio is assumed."""
    sides, ratios = robot.drives.value("encoder_side"), robot.drives.value("gear_ratio", math.nan)
    assumed = (sides == "motor") & np.isnan(ratios) & ~np.asarray(robot.prismatic)
    if assumed.all():
        return "all joints"
    return ", ".join(name for name, own in zip(robot.joint_names, assumed, strict=True) if own)


def assumed_something(robot: Robot) -> bool:
    """Tell whether any value of an arm's drives is assumed."""
    quantities = ("rotor_inertia", "stiffness")
    assumed = any("assumed" in robot.drives.sources(quantity) for quantity in quantities)
    return assumed or bool(joints_with_assumed_ratio(robot))


def _assumed_rows(robot: Robot, quantity: str) -> str:
    """Return what is assumed of a quantity, joint by joint."""
    data = robot.drives.data.get(quantity, {})
    rows = (
        f"{joint} {float(f'{data[joint].value:.2g}'):g}"
        for joint in robot.joint_names
        if joint in data and data[joint].source == "assumed"
    )
    return ", ".join(rows)


def __getattr__(name: str) -> object:
    """Return what an old name stands for, with a warning; it works until the next minor version."""
    if name == "believe":
        renamed.warn_renamed(name, "assume_rotors")
        return assume_rotors
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
