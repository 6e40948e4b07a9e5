"""What is beside the exported C: a CMake package, C++, Python, tests of faults, and glue for interfaces."""

from __future__ import annotations

from string import Template
from typing import Any, NamedTuple

import numpy as np

from armgpi import __version__
from armgpi.control.controller import FullState, Measurement
from armgpi.control.supervisor import Reason, State, Supervised
from armgpi.errors import ParameterError, Remedy
from armgpi.export.code import ABI, Code, template
from armgpi.export.names import plain
from armgpi.references.reference import Target

#: Files of every export.
_PACKAGE = ("CMakeLists.txt", "armgpi_controller.hpp", "armgpi_controller.py")
#: Target -> its own files.
TARGETS: dict[str, tuple[str, ...]] = {
    "bare": (),
    "fci": ("fci.hpp", "fci.py"),
    "ur": ("ur.py",),
    "ros2_control": (
        *("ros2_control.hpp", "ros2_control.cpp", "ros2_stubs.hpp", "ros2_plugin.xml", "package.xml"),
    ),
}
#: Targets whose robot adds gravity itself, and the number of joints of their arms.
COMPENSATING = {"fci": 7, "ur": 6}
#: Rate of torque that libfranka allows [N m/s].
FCI_RATE = 1000.0
_POSITIONS = ("q_measured", "q_ref")
#: Samples of a test of a fault at most.
_LONGEST = 4000
#: Samples in which a joint runs away in a test, as far as FOLLOWING.
_RUNNING_AWAY = 100


class _Motion(NamedTuple):
    """A motion of one joint that has a fault; see test_faults.c."""

    name: str
    q: float = 0.0
    dq: float = 0.0
    ddq: float = 0.0
    r: float = 0.0
    dr: float = 0.0
    dither: float = 0.0
    samples: int = 100
    elapsed: int = 1
    nan_q: int = 0
    nan_r: int = 0


def check_target(target: str, controller: Supervised) -> None:
    """Refuse what would hurt on an interface: gravity twice, another arm, a law without positions alone.

    Raises:
        ParameterError: naming what does not fit.
    """
    robot: Any = controller.robot
    if target not in COMPENSATING and target != "ros2_control":
        return
    if controller.measurement_type is FullState or any(controller._uses):
        raise ParameterError(
            "target",
            target,
            "bare for a law that needs more than positions and their reference, as one with velocities or a "
            "feedforward (feedforward: none) does",
        )
    if target == "ros2_control":
        return
    if not compensated(robot):
        expected = "one for a controller without gravity, as its robot adds it: robot.with_gravity((0, 0, 0))"
        raise ParameterError("target", target, expected)
    if robot.n != COMPENSATING[target]:
        refused = ParameterError(
            "target", target, f"for {COMPENSATING[target]} joints; this arm has {robot.n}"
        )
        fingers = [x for x in robot.provenance.get("grippers", ()) if x in robot.joint_names]
        raise refused.suggesting(Remedy("lock", tuple(fingers))) if fingers else refused
    rate = controller.supervisor.torque_rate
    if target == "fci" and (rate is None or np.any(np.asarray(rate) > FCI_RATE)):
        raise ParameterError("target", target, f"a torque_rate of at most {FCI_RATE:g} N m/s, as libfranka's")


def compensated(robot: Any) -> bool:
    """Tell whether a nominal model has no gravity, as that of a robot which compensates it itself."""
    return not np.abs(robot.gravity(robot.middle() + 0.1 * np.arange(1, robot.n + 1))).max() > 0.0


def package(code: Code, state_bytes: int, target: str) -> dict[str, str]:
    """Return the files of the package and of the target: name -> text."""
    law = code.law
    names, real = list(law.inputs), "float" if code.real == "float" else "double"
    fill = {
        "title": f"{type(law.controller.law).__name__} controller of {plain(law.controller.robot.name)}",
        "version": __version__,
        "abi": str(ABI),
        "state_bytes": str(state_bytes),
        "state_words": str(-(-state_bytes // 8)),
        "n": str(law.n),
        "dt_double": repr(float(law.controller.dt)),
        "vectors": ", ".join(f"const Vector& {name}" for name in names),
        "datas": ", ".join(f"{name}.data()" for name in names),
        "arguments": ", ".join(names),
        "declared": ", ".join(f"{name}[ARMGPI_N]" for name in names),
        "declared_zero": ", ".join(f"{name}[ARMGPI_N] = {{0}}" for name in names),
        "zeroed": "".join(
            f"        {name}[i] = (armgpi_real_t)0;\n"
            for name in names
            if name not in ("q_measured", "q_ref")
        ),
        "c_real": f"c_{real}",
        "joint_list": repr([plain(name) for name in law.controller.robot.joint_names]),
        "status_list": repr([state.name.lower() for state in State]),
        "reason_list": repr([reason.name.lower() for reason in Reason]),
        "middle": ",\n".join(f"    {x!r}" for x in law.controller.robot.middle().tolist()),
        "faults": ",\n".join(_tests(law.controller)),
    }
    texts = {name: Template(template(name)).substitute(fill) for name in (*_PACKAGE, "test_faults.c")}
    texts |= {name: Template(template(name)).safe_substitute(fill) for name in TARGETS[target]}
    if target == "ros2_control":
        texts["CMakeLists.txt"] += template("CMakeLists.ros2.txt")
    return texts


def _tests(controller: Supervised) -> list[str]:
    """Return the rows of the tests of faults, with what the supervisor in Python says."""
    bounds, given, robot = controller.bounds, controller.supervisor, controller.robot
    joint = int(np.argmin(bounds.following / np.maximum(bounds.jump, 1e-12)))
    jump, step, following, travel, upper = (
        float(np.broadcast_to(x, robot.n)[joint])
        for x in (bounds.jump, bounds.step, bounds.following, bounds.travel, bounds.upper)
    )
    middle = float(robot.middle()[joint])
    slip = min(0.4 * jump, 0.01)
    small = min(slip, 0.4 * step)
    # It shakes, or it would be RESPONSE; what repeats itself would be FROZEN.
    shake = 0.1 * float(np.min(bounds.jump))
    room = upper - middle
    motions = [
        _Motion("not_finite", nan_q=1),
        _Motion("reference", nan_r=1),
        _Motion("jump", q=0.0, dq=min(1.5 * jump, 5e3)),
        _Motion("frozen", dr=min(travel / 8.0, small), samples=_LONGEST),
        _Motion("position", q=room - 1.5 * small, dq=small, r=room - 1.5 * small, dr=small),
        _Motion("following", dq=slip, dither=shake, samples=min(_LONGEST, int(1.2 * following / slip) + 2)),
        _Motion("saturated", r=0.9 * following, dither=0.1 * min(shake, small), samples=_LONGEST),
        _Motion("late", elapsed=given.missed + 2),
        _Motion("response", ddq=min(following / _RUNNING_AWAY**2, small), samples=_RUNNING_AWAY),
    ]
    rows = []
    for motion in motions:
        reason = _reason(controller, motion, joint)
        numbers = ", ".join(repr(x) for x in motion[1:7])
        counts = f"{joint}U, {motion.samples}U, {motion.elapsed}U, {motion.nan_q}, {motion.nan_r}, {reason}U"
        rows.append(f'    {{"{motion.name}", {numbers}, {counts}}}')
    return rows


def _reason(controller: Supervised, motion: _Motion, joint: int) -> int:
    """Return the reason that the supervisor in Python gives for a motion."""
    robot: Any = controller.robot
    zero = np.zeros(robot.n)
    unit = np.eye(robot.n)[joint]
    middle = np.ascontiguousarray(robot.middle())

    def sample(q: float, r: float, dither: float = 0.0) -> tuple[Any, Target]:
        at = middle + q * unit + dither if np.isfinite(q) else np.where(unit > 0.0, np.nan, middle)
        to = middle + r * unit if np.isfinite(r) else np.where(unit > 0.0, np.nan, middle)
        seen = FullState(at, zero) if controller.measurement_type is FullState else Measurement(at)
        return seen, Target(to, zero, zero)

    with np.errstate(all="ignore"):
        state = controller.init(*sample(motion.q, motion.r))
        for k in range(1, motion.samples + 1):
            if float(state.supervisor.status[0]) > State.RUN:
                break
            q = np.nan if motion.nan_q else motion.q + k * motion.dq + k * k * motion.ddq
            r = np.nan if motion.nan_r else motion.r + k * motion.dr
            seen = sample(q, r, motion.dither * (k % 2))
            state = controller.advance(*seen, state, motion.elapsed).state
    return int(state.supervisor.reason[0])
