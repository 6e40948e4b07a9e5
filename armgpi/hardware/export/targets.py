"""What is beside the exported C: a CMake package, C++, Python, tests of faults, and glue for interfaces."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from string import Template
from typing import Any, NamedTuple

import numpy as np

from armgpi.base.arrays import Array
from armgpi.base.cache import keep_result, read_result
from armgpi.base.version import VERSION
from armgpi.codegen import build
from armgpi.codegen.following import follow_code
from armgpi.control.controller import FullState, Measurement
from armgpi.errors import ParameterError, Remedy
from armgpi.hardware.export.code import ABI, Code, template
from armgpi.hardware.export.interfaces import COMPENSATING, TARGETS, Interface
from armgpi.hardware.export.names import plain
from armgpi.references.following import FollowLimits, SetpointInverse
from armgpi.references.reference import Target
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
#: Under what the rows of the tests of faults are kept.
_FAULT_TESTS = "fault tests"
_POSITIONS = ("q_measured", "q_ref")
_VELOCITY = """\
        v_measured[fault->joint] = (armgpi_real_t)((fault->dq + 3.0 * (k2 * fault->dddq)) / ARMGPI_DT);
"""
#: Samples of a test of a fault at most, and motions of long tests.
_LONGEST, _TRIED = 4000, 2
#: Samples in which a joint runs away in a test, as far as FOLLOWING.
_RUNNING_AWAY = (100, 200, 400)
#: What keeps a measurement below 1 from repeating itself [rad or m]; single precision has it.
_DITHER = 2e-6
_OFF = "switched off at export"
#: An arm rests that stays within 1 mrad (or mm) for 0.1 s: 0.01 rad/s, some encoder noise included.
_REST_MOTION, _REST_TIME = 1e-3, 0.1
#: Samples for which a packet without a counter may come once more: a bus cycle or two of 2 to 4 ms.
_REPEATS = 8
#: Counts in a sample by which a joint moves that cannot stand still in the next one.
_MOVING = 4.0
#: What C++ and Python keep of a motion for its log [s].
_LOG_TIME = 60.0


class _Motion(NamedTuple):
    """A motion of one joint that has a fault, or why there is none; see test_faults.c."""

    joint: int = 0
    q: float = 0.0
    dq: float = 0.0
    dddq: float = 0.0
    r: float = 0.0
    dr: float = 0.0
    dither: float = 0.0
    samples: int = 100
    elapsed: int = 1
    nan_q: int = 0
    nan_r: int = 0
    why: str = ""


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
        "faults": ",\n".join(_kept_tests(code)),
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


def _kept_tests(code: Code) -> list[str]:
    """Return the rows of the tests of faults, found now or before for the same controller."""
    # Its C has all of its numbers in it.
    key = hashlib.sha256(f"{_FAULT_TESTS} {build.package()} {code.header} {code.source}".encode()).hexdigest()
    kept = read_result(key)
    if isinstance(kept, list) and all(isinstance(row, str) for row in kept):
        return kept
    rows = _tests(code.law.controller)
    keep_result(key, rows)
    return rows


def _tests(controller: Supervised) -> list[str]:
    """Return the rows of the tests of faults: a motion in which Python finds each, or why there is none."""
    rows = []
    for reason, motions in _motions(controller).items():
        found = (each for each in motions if each.why or _reason(controller, each) == reason)
        motion = next(found, _Motion(why="this controller does not get there in the motions tried"))
        numbers = ", ".join(repr(float(x)) for x in motion[1:7])
        counts = ", ".join(f"{x}U" for x in (motion.joint, motion.samples, motion.elapsed))
        why = f'"{motion.why}"' if motion.why else "NULL"
        name = reason.name.lower()
        rows.append(
            f'    {{"{name}", {numbers}, {counts}, {motion.nan_q}, {motion.nan_r}, {reason}U, {why}}}'
        )
    return rows


def _motions(controller: Supervised) -> dict[Reason, list[_Motion]]:
    """Return for each reason the motions to try, the likeliest first, or why there is none."""
    bounds, given, middle = controller.bounds, controller.supervisor, controller.robot.middle()
    each = (bounds.jump, bounds.step, bounds.following, bounds.travel, bounds.speed, bounds.upper)
    jump, step, following, travel, speed, upper, effort = (
        np.broadcast_to(x, middle.shape) for x in (*each, controller.effort)
    )
    # Changes in a sample that are neither JUMP nor REFERENCE. What repeats itself would be FROZEN.
    slip = np.minimum(0.4 * jump, 0.01)
    small = np.minimum(slip, 0.4 * step)
    dither = _DITHER * max(1.0, np.abs(middle).max())
    # Through all of what FOLLOWING allows; it shakes more, or it would be RESPONSE.
    shake, count = 0.25 * float(slip.min()), 1.2 * following / slip + 2.0
    away = [
        _Motion(k, dq=slip[k], dither=shake, samples=int(min(_LONGEST, count[k]))) for k in np.argsort(count)
    ]
    f, p = int(np.argmin(travel / small)), int(np.argmin(upper - middle))
    room = upper[p] - middle[p] - 1.5 * small[p]
    driven = [_Motion(k, r=0.9 * following[k], dither=dither, samples=_LONGEST) for k in range(len(middle))]
    driven = sorted(driven, key=lambda motion: -_share(controller, motion))[:_TRIED]
    runs = [
        _Motion(k, dddq=following[k] / samples**3, dither=dither, samples=samples)
        for samples in _RUNNING_AWAY
        for k in range(len(middle))
    ]
    no_torque, no_position = _unlimited(effort, "torque"), _unlimited(upper, "position")
    no_jump, no_speed = _unlimited(jump, "velocity"), _unlimited(speed, "velocity")
    found = {
        Reason.NOT_FINITE: [_Motion(nan_q=1)],
        Reason.REFERENCE: [_Motion(nan_r=1)],
        Reason.JUMP: [_Motion(int(np.argmin(jump)), dq=1.5 * jump.min(), why=no_jump)],
        Reason.FROZEN: [_Motion(f, dr=min(travel[f] / 8.0, small[f]), samples=_LONGEST)],
        Reason.POSITION: [_Motion(p, q=room, dq=small[p], r=room, dr=small[p])],
        Reason.FOLLOWING: away,
        Reason.SATURATED: driven,
        Reason.LATE: [_Motion(elapsed=given.missed + 2)],
        Reason.RESPONSE: runs,
        Reason.CAP: [*driven, *runs],
        # As fast as JUMP lets it begin, at most: it is found before it is too far from the reference.
        Reason.SPEED: [
            _Motion(k, dq=min(1.2 * speed[k], 0.9 * jump[k]), why=no_speed) for k in np.argsort(speed)
        ],
    }
    found |= _tool_motions(small, jump, driven)
    never = {Reason.POSITION: no_position, Reason.SATURATED: no_torque, Reason.RESPONSE: no_torque}
    found |= {reason: [_Motion(why=why)] for reason, why in never.items() if why}
    off = {
        Reason.JUMP: given.jump,
        Reason.FROZEN: controller.frozen_samples,
        Reason.SATURATED: given.saturated,
        Reason.RESPONSE: given.response,
        Reason.SPEED: given.speed is not None or given.speed_cap is not None,
        Reason.CAP: given.torque_cap is not None,
        Reason.WORKSPACE: given.workspace is not None,
        Reason.TOOL_SPEED: given.tool_speed is not None,
        Reason.TOOL_FORCE: given.tool_force is not None,
    }
    return found | {reason: [_Motion(why=_OFF)] for reason, value in off.items() if not value}


def _unlimited(limits: Array, kind: str) -> str:
    """Return that no joint has a limit; empty where one has."""
    return "" if (limits < FARTHEST).any() else f"no joint has a {kind} limit"


def _tool_motions(small: Any, jump: Any, driven: list[_Motion]) -> dict[Reason, list[_Motion]]:
    """Return the motions to try for the tool.

    Args:
        small: what a joint may move in a sample [rad or m].
        jump: what it may jump in one [rad or m].
        driven: motions in which a joint's torque is as large as it gets.
    """
    joints = range(len(small))
    return {
        # The reference moves along; slowly as well, or the tool is too fast before it is outside.
        Reason.WORKSPACE: [
            _Motion(k, dq=share * small[k], dr=share * small[k], samples=_LONGEST)
            for share in (1.0, -1.0, 0.1, -0.1)
            for k in joints
        ],
        Reason.TOOL_SPEED: [
            _Motion(k, dq=min(share * jump[k], 0.05), samples=_LONGEST)
            for share in (0.3, 0.9)
            for k in joints
        ],
        # A joint that does not move though the controller pulls at it is held by something.
        Reason.TOOL_FORCE: driven,
    }


def _share(controller: Supervised, motion: _Motion) -> float:
    """Return the torque that a law begins a motion with, as a share of its limit."""
    with np.errstate(all="ignore"):
        law = controller.law.unlimited()
        seen = _samples(controller, motion)(0)
        tau = law.step(*seen, law.init(*seen)).tau
    return float(np.abs(np.broadcast_to(tau, controller.robot.n) / controller.effort)[motion.joint])


def _samples(controller: Supervised, motion: _Motion) -> Callable[[int], tuple[Any, Target]]:
    """Return what gives measurement and target of each sample of a motion; as test_faults.c does."""
    robot: Any = controller.robot
    unit, zero, middle = np.eye(robot.n)[motion.joint], np.zeros(robot.n), robot.middle()
    bad_q, bad_r = (unit * bad > 0.0 for bad in (motion.nan_q, motion.nan_r))

    def sample(k: int) -> tuple[Any, Target]:
        q = motion.q + k * motion.dq + k**3 * motion.dddq
        v = (motion.dq + 3.0 * k**2 * motion.dddq) / controller.dt
        at = middle + q * unit + motion.dither * (k % 2)
        to = middle + (motion.r + k * motion.dr) * unit
        if k:
            at, to = np.where(bad_q, np.nan, at), np.where(bad_r, np.nan, to)
        seen = FullState(at, v * unit) if controller.measurement_type is FullState else Measurement(at)
        return seen, Target(to, zero, zero)

    return sample


def _reason(controller: Supervised, motion: _Motion) -> int:
    """Return the reason that the supervisor in Python gives for a motion."""
    sample = _samples(controller, motion)
    with np.errstate(all="ignore"):
        state = controller.init(*sample(0))
        for k in range(1, motion.samples + 1):
            if float(state.supervisor.status[0]) > State.RUN:
                break
            state = controller.advance(*sample(k), state, motion.elapsed).state
    return int(state.supervisor.reason[0])
