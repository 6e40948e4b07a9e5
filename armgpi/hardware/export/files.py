"""The folder of an exported controller: its C, a log to replay, a Makefile and what to know."""

from __future__ import annotations

import json
import math
import re
import subprocess
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np

from armgpi.base import files
from armgpi.base.arrays import Array, check_choice, check_path, check_type
from armgpi.base.hints import with_keyword_hints
from armgpi.base.version import VERSION
from armgpi.codegen import build
from armgpi.control.controller import Controller, FullState, Measurement
from armgpi.errors import BackendError, RolloutError
from armgpi.hardware.export.code import MEANING, Code, Counts, generate, supervise, template
from armgpi.hardware.export.interfaces import TARGETS
from armgpi.hardware.export.names import check_name, plain, rename, source_of
from armgpi.hardware.export.recording import record as record
from armgpi.hardware.export.targets import (
    check_target,
    compensates_gravity,
    move_limits,
    package,
    position_of,
)
from armgpi.loop.log import INPUTS, ArmLog, of_samples, pack, preamble, row_type
from armgpi.references.reference import Target
from armgpi.robot import grippers
from armgpi.robot.batch import one_of
from armgpi.supervisor import FARTHEST, Reason, Supervised, Supervisor, reasons

#: What a package says of a controller whose first torque is the weight.
_HOLDS = "The first torque of the controller holds the arm: release the brakes under it."
#: What positions of the motors are, of which libfranka's documents and its issue 114 say no more.
_THETA = (
    "the motors' positions. Whether their zero and their scale are those of `q` is not documented:\n"
    "print both at rest before the first run. If they differ, do not run this program"
)
#: Largest difference from Python, as a share of the torque scale.
_TOLERANCE = 1e-12
#: The same where roundings add up: the states of the printed law grow without bound and cancel (docs,
#: theory); where torque is saturated, D(q)^-1, which the two work out in different ways, is integrated.
_LOOSE = 1e-9
#: How far the replay moves the reference to time a step whose torque is at its limits, as a share of the
#: distance that is a fault.
_FAR = 0.8
#: How long the replay times steps [s]: some 80,000 of them. Four times as long gave the same within 1 %.
_TIMING = 0.05
#: Time between the rows of motion.csv [s].
_ROWS = 0.01
#: How long it may take in all [s].
_PATIENCE = 120.0
#: As the Makefile has them.
_STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-Wdouble-promotion")
_BUILD = (*_STRICT, "-ffp-contract=off", "-fno-builtin-memset", "-fno-builtin-memcpy", "-O2")


class Measured(NamedTuple):
    """What the replay said.

    Attributes:
        compiler: which compiler.
        difference: largest difference from Python, as a share of the torque scale.
        agrees: whether it is as small as it should be, without a fault.
        state_bytes: size of the state.
        step: mean time of a step [ns]; None where it could not be timed.
        saturated: the same where torque is saturated.
        stack: bytes of stack of all functions together, None when the compiler does not say.
        said: all that it printed.
    """

    compiler: str
    difference: float
    agrees: bool
    state_bytes: int
    step: float | None
    saturated: float | None
    stack: int | None
    said: str


class Export(NamedTuple):
    """What was written.

    Attributes:
        folder: where.
        files: what.
        code: the C and its counts.
        measured: what the replay said; None where it was not asked for, or there is no compiler, or no
            program can be run.
        state_bytes: size of the state.
    """

    folder: Path
    files: list[Path]
    code: Code
    measured: Measured | None
    state_bytes: int


@with_keyword_hints
def export_controller(
    controller: Controller,
    folder: str | Path,
    log: ArmLog | None = None,
    *,
    real: str = "double",
    supervisor: Supervisor | None = None,
    name: str | None = None,
    measure: bool = True,
    target: str = "bare",
    beside: Mapping[str, str | bytes] | None = None,
) -> Export:
    """Write a controller as freestanding C99 to a folder, with a README that explains how to wire it.

    Args:
        controller: for a single rollout.
        folder: made if needed; files of an earlier export in it are overwritten.
        log: what to replay (:func:`armgpi.hardware.export.files.record`); when not given, 0.1 s at rest in
            the middle of the joint ranges.
        real: number type in C, "double" or "float".
        supervisor: what is taken for a fault; :class:`armgpi.Supervisor` as it is when not given.
        name: what files, functions, types and macros begin with in place of `armgpi`, as in `left_arm_step`;
            with one each, several controllers go into one program.
        measure: whether to compile and run the replay, where there is a compiler.
        target: what is added: "bare" nothing, "fci" callbacks for libfranka and pylibfranka, "ur" a loop for
            UR's RTDE, "ros2_control" a plugin. The robots of the first two add gravity themselves.
        beside: further files of the folder, name -> content: `armgpi export` adds the experiment.

    Raises:
        ParameterError: when an argument is not as it should be, or a target would get gravity twice.
        BackendError: when the controller does what has no C.
        RolloutError: when the folder cannot be written to.
    """
    check_type(log, "log", ArmLog | None, "an ArmLog, as record returns it")
    check_type(measure, "measure", bool, "True or False")
    check_choice(target, "target", TARGETS)
    # Everything is generated, and refused if need be, before a file is written.
    code = generate(supervise(controller, supervisor), real)
    return write_code(code, folder, log, name=name, measure=measure, target=target, beside=beside)


def write_code(
    code: Code,
    folder: str | Path,
    log: ArmLog | None = None,
    *,
    name: str | None = None,
    measure: bool = True,
    target: str = "bare",
    beside: Mapping[str, str | bytes] | None = None,
) -> Export:
    """Write what was generated; arguments and errors as :func:`export_controller`."""
    from armgpi.config.experiment import prepare

    check_name(name)
    folder = check_path(folder, "folder")
    check_target(target, code.law.controller)
    log = _at_rest(code.law.controller) if log is None else log
    texts = _texts(code, log)
    check_name(name, f"{code.source} {texts['main.c']}")
    code = code._replace(header=rename(code.header, name), source=rename(code.source, name))
    texts = {rename(file, name): rename(text, name) for file, text in texts.items()}
    prepare(folder)
    # With the inputs of this controller alone, as its own C writes them.
    rows = np.zeros(len(log.rows), row_type(tuple(code.law.inputs), code.law.n))
    for each in rows.dtype.names or ():
        rows[each] = log.rows[each]
    own = ArmLog({**log.header, **_log_header(code), "made_by": log.header["made_by"]}, rows, log.source)
    measured, logged = None, {"log.armlog": pack(own), "motion.csv": _motion(log).encode()}
    if measure:
        with suppress(BackendError):  # there is no compiler, or no program can be run
            measured = _run_replay(texts | logged, build.compiler())
    state_bytes = code.state_bytes if measured is None else measured.state_bytes
    readme = _readme(code, len(log.samples), state_bytes, measured, target)
    texts["README.md"] = rename(readme, name)
    more = package(code, state_bytes, target)
    texts |= {rename(file, name): rename(text, name) for file, text in more.items()}
    return Export(
        folder, files.write_set(folder, texts | logged | dict(beside or {})), code, measured, state_bytes
    )


def _at_rest(controller: Supervised) -> ArmLog:
    """Return a short log of a controller whose arm does not move."""
    robot: Any = controller.robot
    middle, rest = np.ascontiguousarray(robot.middle()), np.zeros(robot.n)
    # No plant: a replay compares torques, and an arm at rest needs none to be at rest.
    seen: Any = FullState(middle, rest) if controller.measurement_type is FullState else Measurement(middle)
    target = Target(middle, rest, rest)
    state, taus = controller.init(seen, target), []
    for _ in range(max(1, round(0.1 / controller.dt))):
        tau, state = controller.step(seen, target, state)
        taus.append(np.broadcast_to(tau, rest.shape))
    values = dict(zip(INPUTS, (middle, rest, middle, rest, rest), strict=True))
    inputs = {name: np.tile(value, (len(taus), 1)) for name, value in values.items()}
    return of_samples(robot.joint_names, controller.dt, inputs, np.array(taus))


def _motion(log: ArmLog) -> str:
    """Return the motion of a log as CSV: a time, and the reference with its rates, in each row."""
    rates, joints = ("q_ref", "v_ref", "a_ref"), [plain(name) for name in log.header["joints"]]
    asked = np.concatenate([log.t[:, None], *(log.samples[name] for name in rates)], axis=1)
    step = max(1, min(round(_ROWS / float(log.header["dt"])), len(asked) - 1))
    rows = [",".join(["time", *joints, *(f"{name} {rate}" for rate in "va" for name in joints)])]
    rows += [",".join(f"{x:.12g}" for x in row) for row in asked[::step]]
    return "\n".join(rows) + "\n"


def _log_header(code: Code) -> dict[str, Any]:
    """Return the header of the logs that exported C writes."""
    robot: Any = code.law.controller.robot
    return {
        "joints": list(robot.joint_names),
        "dt": float(code.law.controller.dt),
        "inputs": list(code.law.inputs),
        "robot": robot.name,
        "real": code.real,
        "layout": f"{code.layout:08X}",
        "made_by": f"armgpi {VERSION}, C",
    }


def _log_writer(code: Code) -> dict[str, str]:
    """Return the C that writes logs."""
    inputs = code.law.inputs
    start = [f"0x{byte:02X}U" for byte in preamble(_log_header(code))]
    fill = {
        "version": VERSION,
        "inputs": str(len(inputs)),
        "parameters": ",\n".join(f"    const armgpi_real_t {name}[ARMGPI_N]" for name in inputs),
        "preamble": ",\n".join("    " + ", ".join(start[i : i + 16]) for i in range(0, len(start), 16)),
        "kept": "\n".join(
            f"            row->in[{i}U][i] = (double){name}[i];" for i, name in enumerate(inputs)
        ),
    }
    return {name: Template(template(name)).substitute(fill) for name in ("armgpi_log.h", "armgpi_log.c")}


def _texts(code: Code, log: ArmLog) -> dict[str, str]:
    """Return the files that are compiled and replayed."""
    names = list(code.law.inputs)
    effort = np.broadcast_to(code.law.controller.effort, (code.law.n,))
    # A joint without a limit is measured by its largest torque in the log.
    largest = np.maximum(np.abs(log.tau).max(axis=0), 1e-300)
    scale = np.where(np.isfinite(effort), effort, largest)
    printed = getattr(code.law.controller.law, "realisation", "") == "paper"
    adding = printed or (np.abs(log.tau) >= effort).any()
    double = "", _LOOSE if adding else _TOLERANCE
    suffix, tolerance = ("F", 0.0) if code.real == "float" else double
    q_ref = names.index("q_ref")
    fill = {
        "count": len(names),
        "tolerance": repr(tolerance),
        "seconds": repr(_TIMING),
        "scale": ",\n".join(f"    {x!r}" for x in scale.tolist()),
        "q_ref": f"{q_ref}U",
        "step_call": ", ".join("q_ref" if i == q_ref else f"in[{i}U]" for i in range(len(names))),
        "init_now": ", ".join("moved" if i == q_ref else f"timed[k][{i}U]" for i in range(len(names))),
        "init_in": ", ".join(f"in[{i}U]" for i in range(len(names))),
        "zero": f"0.0{suffix}",
        # Of a whole number C takes no suffix.
        "far": f"{float(f'{_FAR * float(np.min(code.law.controller.bounds.following)):.6g}')!r}{suffix}",
    }
    return {
        "armgpi_controller.h": code.header,
        "armgpi_controller.c": code.source,
        "main.c": Template(template("main.c")).substitute(fill),
        "Makefile": Template(template("Makefile")).substitute(),
        **_log_writer(code),
    }


def _run_replay(texts: dict[str, str | bytes], found: build.Compiler) -> Measured:
    """Compile the replay, where it was not before, and run it in a folder of its own.

    Raises:
        BackendError: when the compiler fails.
    """
    sources = {name: text for name, text in texts.items() if name.endswith((".c", ".h"))}
    flags = (*_BUILD, *found.flags)
    name = json.dumps([*flags, sources])
    kept = build.keep(name, found, lambda folder: _build_replay(folder, sources, found))
    said_of_stack, program = kept.split(b"\n", maxsplit=1)
    # Not in the user's folder, where a program would be left behind.
    with tempfile.TemporaryDirectory(prefix="armgpi-export-") as place:
        folder = Path(place)
        others = {name: text for name, text in texts.items() if name not in sources}
        files.write_temporary(folder, {**others, "replay": program})
        replay = folder / "replay"
        replay.chmod(0o700)
        done = _run([str(replay)], folder)
    compiler = found.version.splitlines()[0] if found.version else found.command[0]
    stack = json.loads(said_of_stack)
    said = done.stdout.decode(errors="replace")
    if re.search(r"state \d+", said) is None:
        end = f"it ended with {done.returncode} after printing {said[-200:].strip()!r}"
        raise BackendError(f"the replay of the exported controller did not report its state: {end}")
    return _read_replay(said, compiler, done.returncode == 0, stack)


def _build_replay(folder: Path, texts: Mapping[str, str | bytes], found: build.Compiler) -> bytes:
    """Compile the replay in a folder, and return the bytes of its stack as a line, and the program.

    Raises:
        BackendError: when the compiler cannot be run.
        RolloutError: when it fails.
    """
    files.write_temporary(folder, texts)
    sources = sorted((file for file in texts if file.endswith(".c")), key=lambda file: file != "main.c")
    stack, controller = None, folder / sources[1]
    # Not every compiler knows these options, so they do not belong to the build itself.
    more = (*found.flags, "-fstack-usage", "-c", controller.name)
    apart = _run([*found.command, *_BUILD, *more], folder)
    with suppress(OSError, ValueError):
        text = controller.with_suffix(".su").read_text(encoding="utf-8")
        stack = sum(int(line.split("\t")[1]) for line in text.splitlines())
    if not apart.returncode:
        sources[1] = controller.with_suffix(".o").name
    # As in the Makefile, so that what is refused here is refused there: warnings are errors.
    built = _run([*found.command, *_BUILD, "-o", "replay", *sources, "-lm"], folder)
    if built.returncode:
        lines = [x for x in built.stderr.decode(errors="replace").splitlines() if "error" in x]
        raise RolloutError(f"{' '.join(found.command)} failed: {(lines or ['it printed nothing'])[0]}")
    return json.dumps(stack).encode() + b"\n" + (folder / "replay").read_bytes()


def _read_replay(said: str, compiler: str, agrees: bool, stack: int | None) -> Measured:
    """Return what a replay printed."""

    def number(pattern: str) -> float:
        match = re.search(pattern, said)
        return float(match[1]) if match else math.nan

    # A step that faults too often is not timed: the replay says -1.
    def time(pattern: str) -> float | None:
        value = number(pattern)
        return value if value > 0.0 else None

    return Measured(
        compiler=compiler,
        difference=number(r"largest difference (\S+)"),
        agrees=agrees,
        state_bytes=int(number(r"state (\d+)")),
        step=time(r"(?m)^step (\S+) ns"),
        saturated=time(r"step with torque saturated (\S+) ns"),
        stack=stack,
        said=said,
    )


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[bytes]:
    """Run a program, or say why that was not possible."""
    try:
        return build.run_program(command, _PATIENCE, folder)
    except (OSError, subprocess.SubprocessError) as error:
        raise BackendError(f"{command[0]} cannot be run: {error}") from None


def _readme(code: Code, samples: int, state_bytes: int, measured: Measured | None, target: str) -> str:
    """Return the README."""
    law = code.law
    controller = law.controller
    robot: Any = controller.robot
    lower, upper, velocity, _ = robot.limits
    effort = np.broadcast_to(controller.effort, (law.n,))
    fastest = move_limits(controller)[0]
    units = [("m", "N") if slides else ("rad", "N m") for slides in robot.prismatic]
    rows = zip(robot.joint_names, robot.joint_types, units, strict=True)
    joints = [
        f"| {j} | `{plain(name)}` | {kind} | {lower[j]:.6g} to {upper[j]:.6g} {unit} "
        f"| {velocity[j]:.6g} {unit}/s | {effort[j]:.6g} {of_torque} | {fastest[j]:.3g} {unit}/s |"
        for j, (name, kind, (unit, of_torque)) in enumerate(rows)
    ]
    start = {
        "hold": _HOLDS,
        "rest": _HOLDS,
        "zero": "The torque begins at zero, but for a feedforward (for an arm that lies on something).",
    }.get("" if compensates_gravity(robot) else getattr(controller.law, "start", ""), "")
    return (
        Template(template("README.md"))
        .substitute(
            title=f"{type(controller.law).__name__} controller of {plain(robot.name)}",
            contains=_contains(robot) + (_STAGE if controller.supervisor.torque_cap is not None else ""),
            version=VERSION,
            target=_running(controller, target),
            source=source_of(robot),
            samples=samples,
            arrays=", ".join(f"{name}[ARMGPI_N]" for name in law.inputs),
            arguments=", ".join(law.inputs),
            dt=f"{controller.dt:g}",
            frame=plain(robot.tip),
            argument_notes="\n".join(f"- `{name}`: {MEANING[name]}." for name in law.inputs),
            joints="\n".join(joints),
            start=f"{start} " if start else "",
            **_faults(controller),
            real=code.real,
            state_bytes=state_bytes,
            layout=f"{code.layout:08X}",
            typical=_counts(code.typical),
            worst_case=_counts(code.worst_case),
            measured=_measured_rows(measured),
            float_note=_FLOAT if code.real == "float" else "",
        )
        .rstrip()
        + "\n"
    )


def _running(controller: Supervised, target: str) -> str:
    """Return how the package is run on the robot of its target, and before there is one."""
    if target == "bare":
        return ""
    robot: Any = controller.robot
    lower, upper, _, _ = robot.limits
    goal = ",".join(f"{x:.2f}" for x in robot.middle() + np.minimum(0.1, 0.25 * (upper - lower)))
    fill = {
        "frame": plain(robot.tip),
        "goal": goal,
        "rate": f"{1.0 / controller.dt:.0f}",
        "position": position_of(target, robot),
    }
    fill["side"] = _THETA if fill["position"] == "theta" else "the links' positions"
    return Template(template(f"README.{target}.md")).substitute(fill) + "\n"


def _contains(robot: Any) -> str:
    """Return what the torque contains, and whose joints it is for."""
    text = (
        "**The torque contains gravity**: the controller compensates it. On a robot that compensates "
        "gravity itself (Franka, UR) it would do so twice: export with `--gravity robot` for those."
    )
    if compensates_gravity(robot):
        text = (
            "**The torque is without gravity**: the robot compensates gravity itself, as the torque "
            "interfaces of libfranka and UR do. On a robot that does not, the arm falls. The weight of a "
            "load that the robot does not know is a disturbance."
        )
    if fingers := grippers.moving(robot):
        listed = ", ".join(f"`{plain(joint)}`" for joint in fingers)
        lock = " ".join(f"--lock {plain(joint)}" for joint in fingers)
        text += (
            f"\n\n**The gripper is controlled with the arm**: {listed} needs a position and a reference in "
            f"every sample, and gets a torque. `{lock}` at export leaves a gripper to its own controller."
        )
    return text


def _faults(controller: Supervised) -> dict[str, str]:
    """Return what the README says of faults: name -> text."""
    given, bounds, robot = controller.supervisor, controller.bounds, controller.robot
    action = {
        "brake": "the model's torque along the decelerating reference, then its gravity torque where it ends",
        "hold": "the gravity torque at the last good position",
        "zero": "zero torque",
    }[given.on_fault]
    rate = ""
    if given.torque_rate is not None:
        rate = f" It changes by at most {_few(bounds.rate)} N m or N from sample to sample, in every state."
    rise = np.max(bounds.slowing / bounds.jerk) * controller.dt
    built = f", which builds up and goes in {rise:.2g} s" if rise > controller.dt else ""
    tool = f"the tool, `{plain(given.tool_frame or one_of(robot).tip)}`," if given.checks_tool else ""
    when = {
        Reason.LATE: f"more than {given.missed} samples were missed in a row; as many without a good "
        "measurement end in FAULT",
        Reason.SATURATED: f"a torque was at its limit for {given.saturated:g} s" * bool(given.saturated),
        Reason.FOLLOWING: f"a position is farther than {_few(bounds.following)} rad or m from the reference",
        Reason.REFERENCE: "the reference is not finite"
        + _jump_text(bounds.step, robot, ", or") * bool(given.reference_jump),
        Reason.POSITION: "a position is beyond its limits by more than "
        f"{_few(np.broadcast_to(given.position_margin, (robot.n,)))} rad or m",
        Reason.FROZEN: f"a position did not change at all for {controller.frozen_samples} samples, though "
        "since it last changed its reference has moved by more than "
        f"{_few(bounds.travel)} rad or m, and its torque by more "
        f"than {_few(controller.frozen.sticking)} N m or N, or is at its limit; at once where the joint was "
        "moving with its reference (an arm at rest is no fault)" * bool(controller.frozen_samples),
        Reason.JUMP: _jump_text(bounds.jump, robot, "a position") * bool(given.jump),
        Reason.RESPONSE: f"a joint ran away from its reference for eight samples and {given.response:g} s "
        "while its torque pushed back; the state is FAULT, and that joint brakes with its torque reversed"
        * bool(given.response),
        Reason.SPEED: f"a joint was faster than {_few(bounds.speed / controller.dt)} rad/s or m/s"
        * (given.speed is not None or given.speed_cap is not None),
        Reason.CAP: f"the controller asked for a torque that differs by {_few(bounds.cap)} N m or N from "
        "the model's holding torque; the state is FAULT" * (given.torque_cap is not None),
        Reason.WORKSPACE: _box_text(given.workspace, tool) if given.workspace else "",
        Reason.TOOL_SPEED: f"{tool} was faster than {given.tool_speed:g} m/s" if given.tool_speed else "",
        Reason.TOOL_FORCE: _force_text(controller, tool) if given.tool_force else "",
    }
    return {
        "action": action,
        "rate": rate,
        "deceleration": f"{_few(bounds.slowing / controller.dt**2)} rad/s^2 or m/s^2{built}",
        "reasons": reasons.table(),
        "checks": reasons.checks(when),
    }


def _box_text(workspace: Any, tool: str) -> str:
    """Return when the tool is outside its box."""
    lower, upper = (", ".join(f"{x:g}" for x in corner) for corner in workspace)
    return f"{tool} left the box from ({lower}) to ({upper}) m in the base frame"


def _force_text(controller: Supervised, tool: str) -> str:
    """Return when the force on the tool is too large."""
    given, unsure = controller.supervisor, controller.tool_force.unsure_force
    mass = f" and {given.uncertain_mass:g} kg" if given.uncertain_mass else ""
    return (
        f"the force on {tool} as estimated from the torques was above {given.tool_force:g} N by more than "
        f"joint friction{mass} may be, which at rest is up to {unsure:.2g} N at usual configurations"
    )


_STAGE = """

**This is a stage of a bring-up**, with its limits compiled in: no torque is beyond CAP below, and a joint
beyond SPEED is a fault. Every stage is an export of its own. In the order of `stages.yaml`: let it follow
`motion.csv`, save the log as STAGE.armlog beside its file, and `armgpi bringup check` all logs so far: it
names what is wrong, what has not been tested yet, and which stage is next. The last one has no such
limits."""
_FLOAT = """\
In single precision the integrators round at 6e-8 of what they hold. In a replay, where no loop is closed
around them, that adds up with time, as the difference above shows. In a closed loop the feedback takes it
out.
"""


def _jump_text(jump: Array, robot: Any, what: str) -> str:
    """Return when something has jumped; "" for a robot without velocity limits."""
    checked = jump < FARTHEST
    if not checked.any():
        return ""
    listed = ", ".join(f"{x:.4g}" for x in jump[checked])
    names = [plain(name) for name, known in zip(robot.joint_names, checked, strict=True) if not known]
    rest = f"; not for {', '.join(names)}, without a velocity limit" if names else ""
    return f"{what} is more than {listed} rad or m from where its last change leads{rest}"


def _few(values: Array) -> str:
    """Return numbers per joint as text, one where all are alike."""
    texts = [f"{x:.4g}" for x in values]
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)


def _counts(counts: Counts) -> str:
    """Return counts as text."""
    return ", ".join(f"{x:,}" for x in counts)


def _measured_rows(measured: Measured | None) -> str:
    """Return the rows of the table that were measured."""
    if measured is None:
        why = "no C compiler, or no program could be run, where this was exported"
        return f"| time of a step | not measured: {why}; `make` measures it |"
    rows = [("largest difference from Python, as a share of the torque limits", f"{measured.difference:.2g}")]
    for what, value in (
        ("time of a step", measured.step),
        ("the same, torque saturated", measured.saturated),
    ):
        if value is not None:
            rows.append(
                (f"{what}, on the machine that exported ({plain(measured.compiler)})", f"{value:.0f} ns")
            )
    if measured.stack is not None:
        rows.append(("stack, all functions together (-O2)", f"{measured.stack} bytes"))
    return "\n".join(f"| {what} | {value} |" for what, value in rows)
