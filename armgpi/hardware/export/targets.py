"""What is beside the exported C: a CMake package, C++, Python, tests of faults, and glue for interfaces."""

from __future__ import annotations

import math
from string import Template
from typing import Any

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.version import VERSION
from armgpi.codegen.following import follow_code
from armgpi.control.controller import FullState
from armgpi.errors import ParameterError, Remedy
from armgpi.hardware.export.code import ABI, Code, template
from armgpi.hardware.export.fault_tests import kept_tests
from armgpi.hardware.export.interfaces import COMPENSATING, TARGETS, Interface
from armgpi.hardware.export.names import plain
from armgpi.references.following import FollowLimits, SetpointInverse
from armgpi.robot import grippers
from armgpi.supervisor import FARTHEST, Reason, State, Supervised, least_acceleration
from armgpi.supervisor.bounds import COUNTS

#: Files of every export.
_PACKAGE = (
    *("CMakeLists.txt", "armgpi_controller.hpp", "armgpi_controller.py"),
    *("armgpi_move.h", "armgpi_move.c"),
)
#: What C++ and Python of a target give to the arguments of a step.
_WIRED = {"q_measured": "q", "q_ref": "to.q", "v_ref": "to.v", "a_ref": "to.a"}
#: Moves take at most these shares: of the velocity limits, of what the motors can, of the deceleration of a
#: stop, and of the torque's rate; so that the law has the rest for what the model does not know.
_MOVE_VELOCITY, _MOVE_EFFORT, _MOVE_STOP, _MOVE_RATE = 0.8, 0.25, 0.5, 0.25
#: Where no limit says how fast: rad/s or m/s; and the time in which an acceleration builds up at least [s].
_MOVE_UNLIMITED, _MOVE_ONSET = 1.0, 0.05
#: What a target with a geared robot is for, and three ways out.
GEARED = (
    "one for a model with rotor inertia, as its robot is geared and the loop would be unstable: leave out "
    "--rotor-inertia 0, --drives none and --direct-drive, and it is assumed; specify it "
    "(--drives FILE); or identify them (armgpi identify)"
)
_POSITIONS = ("q_measured", "q_ref")
_VELOCITY = """\
        v_measured[fault->joint] = (armgpi_real_t)((fault->dq + 3.0 * (k2 * fault->dddq)) / ARMGPI_DT);
"""
#: An arm rests that stays within 1 mrad (or mm) for 0.1 s: 0.01 rad/s, some encoder noise included.
_REST_MOTION, _REST_TIME = 1e-3, 0.1
#: Samples for which a packet without a counter may come once more: a bus cycle or two of 2 to 4 ms.
_REPEATS = 8
#: Counts in a sample by which a joint moves that cannot stand still in the next one.
_MOVING = 4.0
#: What C++ and Python keep of a motion for its log [s].
_LOG_TIME = 60.0


def check_target(target: str, controller: Supervised) -> None:
    """Refuse what would hurt on an interface: gravity twice, another arm, a law without positions alone.

    Raises:
        ParameterError: naming what does not fit.
    """
    robot: Any = controller.robot
    if target not in COMPENSATING and target != "ros2_control":
        return
    if controller.measurement_type is FullState:
        raise ParameterError("target", target, "bare for a controller that needs measured velocities")
    if target in COMPENSATING:
        _check_arm(target, controller)
    else:
        for name in robot.joint_names:
            if plain(name) != name:
                expected = (
                    f"bare for names that C does not have as they are: ROS would not find joint {name!r}"
                )
                raise ParameterError("target", target, expected)


def _check_arm(target: str, controller: Supervised) -> None:
    """Refuse an arm, a sample time or a rate that is not that of the target's robot."""
    robot: Any = controller.robot
    if not compensates_gravity(robot):
        expected = "one for a controller without gravity, as its robot adds it: robot.with_gravity((0, 0, 0))"
        raise ParameterError("target", target, expected)
    interface = COMPENSATING[target]
    dt, rate = interface.dt, interface.rate
    assert dt is not None
    if "friction" in interface.adds and getattr(controller.law, "friction_feedforward", False):
        expected = "one for a controller without the friction that its robot compensates"
        raise ParameterError("target", target, expected)
    _check_joints(target, robot)
    _check_side(interface, target, robot)
    if not math.isclose(controller.dt, dt):
        expected = f"for a sample time of {dt:g} s, its robot's; this controller's is {controller.dt:g} s"
        raise ParameterError("target", target, expected)
    given = controller.supervisor.torque_rate
    if rate is not None and (given is None or np.any(np.asarray(given) > rate)):
        raise ParameterError("target", target, f"a torque_rate of at most {rate:g} N m/s, as its robot's")


def _check_joints(target: str, robot: Any) -> None:
    """Refuse an arm without gears, with other joints than the target's robot, or with a gripper's as well."""
    rotors = zip(robot.drives.value("rotor_inertia"), robot.drives.sources("rotor_inertia"), strict=True)
    if any(value == 0.0 and source for value, source in rotors):
        raise ParameterError("target", target, GEARED)
    joints, fingers = COMPENSATING[target].joints, grippers.moving(robot)
    if robot.n != joints or fingers:
        which = f", with {', '.join(map(repr, fingers))} of its gripper" if fingers else ""
        refused = ParameterError("target", target, f"for {joints} joints; this arm has {robot.n}{which}")
        raise refused.suggesting(Remedy("lock", tuple(fingers))) if fingers else refused


def _check_side(interface: Interface, target: str, robot: Any) -> None:
    """Refuse an arm whose encoders are specified to sit where the target's positions are not measured."""
    if not interface.positions:
        return
    values = robot.drives.value("encoder_side").tolist()
    if len(interface.sides(values)) > 1:
        joints = {side: joint for joint, side in zip(robot.joint_names, values, strict=True)}
        said = ", ".join(f"{joint}: {side or 'not specified'}" for side, joint in joints.items())
        known = " or ".join(f"{name} ({side})" for side, name in interface.positions.items())
        wanted = (
            f"one for encoders at different sides ({said}); it reads {known} of all joints: specify one side"
        )
        raise ParameterError("target", target, wanted)


def position_of(target: str, robot: Any) -> str:
    """Return what a target's interface calls the positions that an arm's controller measures; or nothing.

    Args:
        target: what `--target` calls it.
        robot: the arm, with the side of its encoders where that was specified.
    """
    interface = COMPENSATING.get(target)
    if interface is None or not interface.positions:
        return ""
    side = interface.sides(robot.drives.value("encoder_side").tolist())[0]
    return interface.positions[side]


def compensates_gravity(robot: Any) -> bool:
    """Tell whether a nominal model has no gravity, as that of a robot which compensates it itself."""
    return not np.abs(robot.gravity(robot.middle() + 0.1 * np.arange(1, robot.n + 1))).max() > 0.0


def package(code: Code, state_bytes: int, target: str) -> dict[str, str]:
    """Return the files of the package and of the target: name -> text."""
    law = code.law
    names, real = list(law.inputs), "float" if code.real == "float" else "double"
    statuses, reasons = ([each.name.lower() for each in kind] for kind in (State, Reason))
    fill = {
        "title": f"{type(law.controller.law).__name__} controller of {plain(law.controller.robot.name)}",
        "version": VERSION,
        "abi": str(ABI),
        "state_bytes": str(state_bytes),
        "state_words": str(-(-state_bytes // 8)),
        "n": str(law.n),
        "wired": ", ".join(_WIRED.get(name, name) for name in names),
        "missed": str(law.controller.supervisor.missed),
        "position": position_of(target, law.controller.robot),
        **_move(law.controller, "F" if real == "float" else ""),
        "log_seconds": repr(_LOG_TIME),
        "install": template(f"CMakeLists.{target}.txt"),
        "moving": ", ".join(map(repr, (_MOVING / COUNTS * law.controller.bounds.travel).tolist())),
        "repeats": f"{min(_REPEATS, law.controller.supervisor.missed)}U",
        "row_words": str(4 + (len(names) + 2) * law.n),
        "rest_motion": repr(_REST_MOTION),
        "rest_samples": str(max(1, round(_REST_TIME / law.controller.dt))),
        "dt_double": repr(float(law.controller.dt)),
        "vectors": ", ".join(map("const Vector& {}".format, names)),
        "datas": ", ".join(map("{}.data()".format, names)),
        "arguments": ", ".join(names),
        "declared": ", ".join(map("{}[ARMGPI_N]".format, names)),
        "declared_zero": ", ".join(map("{}[ARMGPI_N] = {{0}}".format, names)),
        "zeroed": "".join(
            f"        {name}[i] = (armgpi_real_t)0;\n" for name in names if name not in _POSITIONS
        ),
        "velocity": _VELOCITY if "v_measured" in names else "",
        "c_real": f"c_{real}",
        "compliance": code.compliance,
        "joint_list": repr([*map(plain, law.controller.robot.joint_names)]),
        "status_list": repr(statuses),
        "reason_list": repr(reasons),
        "status_words": ", ".join(map('"{}"'.format, statuses)),
        "reason_words": ", ".join(map('"{}"'.format, reasons)),
        "middle": ",\n".join(map("    {!r}".format, law.controller.robot.middle().tolist())),
        "faults": ",\n".join(kept_tests(code)),
    }
    texts = {name: Template(template(name)).substitute(fill) for name in (*_PACKAGE, "test_faults.c")}
    texts |= _follow(law.controller)
    own = TARGETS[target].files.items()
    return texts | {place: Template(template(name)).safe_substitute(fill) for name, place in own}


def move_limits(controller: Supervised) -> Array:
    """Return the limits of moves: velocity, acceleration and jerk of each joint."""
    bounds, dt, robot = controller.bounds, controller.dt, controller.robot
    velocity = robot.limits.velocity
    most = np.where(velocity > 0.0, velocity, _MOVE_UNLIMITED)
    speed = _MOVE_VELOCITY * np.where(np.isfinite(most), most, _MOVE_UNLIMITED)
    speed = np.minimum(speed, _MOVE_VELOCITY * bounds.speed / dt)
    # What all the torque of a joint, and what its rate, gives at least.
    able = least_acceleration(controller.law)
    effort = np.minimum(controller.effort, FARTHEST)
    acceleration = np.minimum(_MOVE_EFFORT * able, _MOVE_STOP * bounds.slowing / dt**2)
    jerk = np.minimum(acceleration / _MOVE_ONSET, _MOVE_RATE * able * bounds.rate / dt / effort)
    return np.stack([np.broadcast_to(row, robot.n) for row in (speed, acceleration, jerk)])


def follow_limits(controller: Supervised) -> FollowLimits:
    """Return the limits of streams of poses: as :meth:`FollowLimits.of`, and as fast as moves at most."""
    robot: Any = controller.robot
    limits = FollowLimits.of(robot, controller.supervisor.torque_rate)
    return limits._replace(velocity=np.minimum(limits.velocity, move_limits(controller)[0]))


def _follow(controller: Supervised) -> dict[str, str]:
    """Return the C that follows poses of the arm's tip: name -> text."""
    robot: Any = controller.robot
    inverse = SetpointInverse(robot, robot.tip)
    code = follow_code(robot, follow_limits(controller), inverse, controller.dt)
    return {"armgpi_follow.h": code.header, "armgpi_follow.c": code.source}


def _move(controller: Supervised, suffix: str) -> dict[str, str]:
    """Return the limits of moves, and the range of goals, as C."""
    lower, upper, _, _ = controller.robot.limits
    rows = [
        "    {" + ", ".join(f"{x!r}{suffix}" for x in row) + "}" for row in move_limits(controller).tolist()
    ]
    ends = (np.maximum(lower, -FARTHEST), np.minimum(upper, FARTHEST))
    ranges = ["    {" + ", ".join(map(repr, row.tolist())) + "}" for row in ends]
    return {"move_limits": ",\n".join(rows), "move_range": ",\n".join(ranges)}
