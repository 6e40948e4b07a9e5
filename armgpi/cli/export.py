"""The command that writes a controller as C."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from armgpi.base.escape import counted, json_data
from armgpi.cli import options as opt
from armgpi.cli.declared import options as declared_options
from armgpi.cli.declared import values_of
from armgpi.cli.parsing import FAILED, OK, known_target, refusal, refusal_of, stoppable
from armgpi.cli.terminal import hold, print_held, say, working
from armgpi.hardware.export.interfaces import COMPENSATING, choices

if TYPE_CHECKING:
    from armgpi.config import Experiment, Loaded
    from armgpi.hardware.export.files import Export
    from armgpi.loop.log import ArmLog
    from armgpi.supervisor import Supervised

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "out --out -o FOLDER": "Folder for the export.",
    "real TYPE": "Number type in C: double (default) or float.",
    "name NAME": "Prefix of files, functions, types and macros: 'left_arm' makes left_arm.h and "
    "left_arm_step; armgpi by default. With different prefixes, several controllers fit "
    "into one program.",
    "on_fault TORQUE": "Torque in FAULT, without a measurement: brake (default), hold or zero.",
    "frozen SAMPLES": "Samples without a change after which a measurement that should change is reported "
    "as FROZEN; 0 for no such check; by default those of 0.05 s plus the delay.",
    "jump SAMPLES": "Largest jump of a measurement, in samples of motion at the velocity limit: 2 by "
    "default, 0 for no such check (JUMP).",
    "torque_rate NUMBERS": "Highest rate of change of torque [N m/s or N/s], in every state: "
    "'j1=1000,j2=500', or one number for all; no limit by default.",
    "target NAME": f"What is added to the C: {choices()}. Robots of fci and ur compensate "
    "gravity and have their own sample time: --gravity is robot for them, and --dt is "
    "0.001 for fci, 0.002 for ur.",
    "direct_drive": "Direct-drive motors: no rotor inertia is assumed (--drives none); for bare and "
    "ros2_control.",
}
#: Configurations of a motion in which an arm's links may touch.
_LOOKED = 200
#: Of the catalogue, those that have no direct torque.
_CB3 = ("ur3", "ur5", "ur10")
#: What is printed of a replay -> its name in `Measured`.
_MEASURED = {
    "compiler": "compiler",
    "difference": "difference",
    "step_ns": "step",
    "saturated_step_ns": "saturated",
    "stack_bytes": "stack",
    "agrees": "agrees",
}
#: Of a robot's highest rate of torque, so that roundings do not pass it; libfranka's kLimitEps.
_JUST_BELOW = 1.0 - 1e-6


@stoppable
@opt.add_options
def export(
    context: typer.Context,
    robot: str | None = None,
    out: Path = Path("exported"),
    real: str = "double",
    name: str | None = None,
    on_fault: str | None = None,
    frozen: int | None = None,
    jump: float | None = None,
    torque_rate: str | None = None,
    target: str = "bare",
    direct_drive: bool = False,
    controller: str | None = None,
    explain: bool = False,
    as_json: bool = False,
    *,
    options: opt.Experiment,
) -> None:
    """Write a controller as freestanding C99 for hardware, with a log to replay.

    \b
    armgpi export ur5 -o controller
    armgpi export --config experiment.yaml --real float -o controller
    """  # noqa: D301 (\b keeps the lines apart)
    if direct_drive and options.drives is not None:
        raise refusal("--direct-drive", "is mutually exclusive with --drives")
    options = replace(options, supervised=True, drives=Path("none") if direct_drive else options.drives)
    supervisor = opt.SupervisorOptions(on_fault=on_fault, frozen=frozen, jump=jump, torque_rate=torque_rate)
    asked = opt.Asked(
        robot=robot,
        controllers=controller,
        declared=values_of(context),
        options=options,
        supervisor=supervisor,
    )
    sys.exit(_export(asked, _Written(out, real, name, target, explain, as_json)))


class _Written(NamedTuple):
    """What is written of a controller, and printed.

    Attributes:
        out: folder for the export.
        real: number type in C.
        prefix: of files, functions and types; None for the usual one.
        target: what is added to the C.
        explain: whether the assumed values of the drives are printed.
        as_json: whether what the code needs is printed as JSON.
    """

    out: Path
    real: str
    prefix: str | None
    target: str
    explain: bool
    as_json: bool


def _export(asked: opt.Asked, written: _Written) -> int:
    """Write what the options describe, print what it takes, and return the exit code."""
    import numpy as np

    from armgpi.cli.arms import note_drives
    from armgpi.config import experiment as experiments
    from armgpi.errors import ParameterError, require_extra

    require_extra("casadi", "compiled")
    if written.real not in ("double", "float"):
        raise refusal("--real", f"must be one of double, float, got {written.real!r}")
    from armgpi.hardware.export.code import generate, supervise
    from armgpi.hardware.export.files import record, write_code
    from armgpi.hardware.export.names import check_name
    from armgpi.hardware.export.targets import check_target

    target, out = written.target, written.out
    experiment = _experiment(_for_target(asked, target), target)
    _check_arm(experiment, target)
    experiment.robot.check_holding(experiment.reference.at(np.zeros(1)).q, "the start")
    label, controller = next(iter(experiment.controllers.items()))
    supervised = supervise(controller, experiment.supervisor)
    # What cannot be written is refused before the simulation.
    code = generate(supervised, written.real)
    option = "--target"
    try:
        check_target(target, supervised)
        option = "--name"
        check_name(written.prefix, code.source)
    except ParameterError as error:
        raise refusal_of(option, error) from error
    with experiments.prepared(out):
        note_drives(experiment, written.explain, asked.options)
        _note_contacts(experiment, asked.options.package_dir)
        print_held()
        with working("recording the motion, compiling the C code and replaying the motion with it"):
            log = record(experiment.plant, supervised, experiment.reference, experiment.t_final, "auto")
            config, copied = experiments.portable(experiment.config)
            beside: dict[str, str | bytes] = {"experiment.yaml": config, **copied}
            done = write_code(code, out, log, name=written.prefix, target=target, beside=beside)
    _print_needs(done, log, label, written.as_json)
    say(f"wrote {len(done.files)} files to {out}; {out / 'README.md'} explains them", err=True)
    return _exit_code(done, log, supervised)


def _exit_code(done: Export, log: ArmLog, supervised: Supervised) -> int:
    """Return the exit code of what was written, and say why it is no good where it is not."""
    if "diverged" in log.header:
        say(
            f"the simulated arm becomes unstable under this controller, at {log.header['diverged']:g} s",
            err=True,
        )
        return FAILED
    if log.fault is not None:
        if supervised.supervisor.torque_rate is not None:
            say(
                "note: the torque begins at zero and is limited in rate, and no brake holds this "
                "arm, so the simulated arm sank at the start",
                err=True,
            )
        return FAILED
    return OK if done.measured is None or done.measured.agrees else FAILED


def _check_arm(experiment: Experiment, target: str) -> None:
    """Refuse an arm that is specified to have no rotors where its robot is geared; warn of CB3."""
    from armgpi.hardware.export.targets import GEARED

    if target in COMPENSATING and experiment.config.robot.drives == "none":
        raise refusal("--target", f"{target} is {GEARED}")
    if target == "ur" and experiment.robot.name in _CB3:
        said = (
            "of the catalogue is a CB3 arm, which has no direct torque; docs/robots.md gets e-Series' URDFs"
        )
        hold(f"warning: {experiment.robot.name} {said}")


def _note_contacts(experiment: Experiment, package_dirs: list[Path] | None) -> None:
    """Warn of links that touch each other on the motion's way."""
    import numpy as np

    from armgpi.robot.collisions import self_collisions

    times = np.linspace(0.0, experiment.t_final, _LOOKED)
    touching = self_collisions(experiment.robot, experiment.reference.at(times).q, package_dirs or ())
    for first, second, index in touching or ():
        said = f"{first} and {second} touch {times[index]:.2g} s after the start of the motion"
        say(f"warning: {said}", err=True, fg="yellow")


def _experiment(asked: opt.Asked, target: str) -> Experiment:
    """Return what the options describe, without a gripper where the interface has the arm alone."""
    from armgpi import config as configuration
    from armgpi.cli.settings import settings
    from armgpi.config import building
    from armgpi.robot import grippers

    given = settings(asked, compare=False)
    robot = building.robot(*given)
    fingers = grippers.moving(robot)
    if fingers and target in COMPENSATING:
        lock = [*(asked.options.lock or []), *fingers]
        asked = replace(asked, options=replace(asked.options, lock=lock))
        hold(f"note: {', '.join(fingers)} of the gripper locked: {target} has the arm's joints")
        given = settings(asked, compare=False)
    elif fingers:
        flags = " ".join(f"--lock {name}" for name in fingers)
        said = f"{', '.join(fingers)} of a gripper is controlled together with the arm; {flags} leaves it out"
        hold(f"warning: {said}")
    return configuration.build(*_with_side(given, target, asked))


def _with_side(given: Loaded, target: str, asked: opt.Asked) -> Loaded:
    """Return an experiment with the side that the target's positions are of, where none was specified."""
    from armgpi.cli.settings import settings
    from armgpi.config import arms

    interface = COMPENSATING.get(target)
    if interface is None or not interface.positions:
        return given
    resolved, robot = arms.resolve(*given)
    specified = robot.drives.value("encoder_side").tolist()
    sides = interface.sides(specified)
    if len(sides) > 1:  # the export refuses them, and names the joints
        return given
    side = sides[0]
    elastic = resolved.plant.engine == "elastic"
    if elastic and not all(specified):
        given = settings(_with_declared(asked, "--encoder-side", side), compare=False)
    if elastic or any(specified):
        other = next(each for each in interface.positions if each != side)
        name = interface.positions[side]
        said = f"note: the program reads {name}, the positions of the {side}s; --encoder-side {other} for"
        hold(f"{said} {interface.positions[other]}, those of the {other}s")
    return given


def _with_declared(asked: opt.Asked, flag: str, value: Any) -> opt.Asked:
    """Return what was typed with a declared option before it, whose value holds where none was typed."""
    usual = [(option, value) for option in declared_options() if option.flag == flag]
    return replace(asked, declared=[*usual, *asked.declared])


def _for_target(asked: opt.Asked, target: str) -> opt.Asked:
    """Return the options with what the target's interface asks for put into them."""
    from armgpi.cli.settings import with_file

    asked = with_file(asked)
    if known_target(target) not in COMPENSATING:
        return asked
    interface, options = COMPENSATING[target], asked.options
    if options.gravity not in (None, "robot"):
        raise refusal("--gravity", f"must be robot for {target}: that robot compensates gravity itself")
    options = replace(options, gravity="robot")
    if options.config is None:
        options = replace(options, dt=interface.dt if options.dt is None else options.dt)
        asked = _with_declared(asked, "--delay", interface.delays[0])
        if asked.controllers is None:
            asked = replace(asked, controllers="gpi_auto")
            text = (
                f"the controller for {target} is chosen automatically, with gravity "
                "compensated by the robot: use --controller gpi_auto"
            )
            hold(f"note: {text}")
    supervisor = asked.supervisor
    if supervisor.torque_rate is None and interface.rate is not None:
        supervisor = replace(supervisor, torque_rate=f"{interface.rate * _JUST_BELOW:.10g}")
    return replace(asked, options=options, supervisor=supervisor)


def _print_needs(done: Export, log: ArmLog, label: str, as_json: bool) -> None:
    """Print what the exported code needs: state, operations, time of a step; and what its replay found."""
    from armgpi.hardware.export.targets import compensates_gravity

    measured, typical, worst_case = done.measured, done.code.typical, done.code.worst_case
    facts: dict[str, Any] = {
        "controller": label,
        "real": done.code.real,
        "gravity": "robot" if compensates_gravity(done.code.law.controller.robot) else "arm",
        "samples": len(log.samples),
        "state_bytes": done.state_bytes,
        "operations": sum(typical),
        "worst_operations": sum(worst_case),
        **{key: getattr(measured, name, None) for key, name in _MEASURED.items()},
        "stopped": log.fault,
    }
    if as_json:
        say(json.dumps(json_data(facts)))
        return
    say(
        f"{type(done.code.law.controller.law).__name__} of {done.code.law.controller.robot.name}, "
        f"{counted(done.code.law.n, 'joint')}, as C in {done.folder}"
    )
    carried = (
        "without gravity: the robot compensates it" if facts["gravity"] == "robot" else "contains gravity"
    )
    say(f"  torque                   {carried}")
    say(f"  state                    {done.state_bytes} bytes")
    say(f"  operations of a step     {sum(typical):,}, at worst {sum(worst_case):,}")
    if log.fault is not None:
        say(f"  the log has a fault      {log.fault}")
    if measured is None:
        say(
            "  not replayed here: there is no C compiler, or no program can be run; "
            "`make` in the folder replays the log"
        )
        return
    say(
        f"  replay of {counted(len(log.samples), 'sample')}   {measured.difference:.2g} of the torque limits "
        "from Python"
    )
    if not measured.agrees:
        say(f"  which is not as it should be:\n{measured.said}", lines=True)
    if measured.step is not None:
        saturated = "" if measured.saturated is None else f", saturated {measured.saturated:.0f} ns"
        say(f"  time of a step           {measured.step:.0f} ns{saturated}")
