"""The command that begins an experiment file for an arm."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import typer

from armgpi.base.escape import counted
from armgpi.cli import options as opt
from armgpi.cli.arms import load_arm
from armgpi.cli.parsing import INCOMPLETE, is_experiment, known_target, refusal
from armgpi.cli.terminal import say
from armgpi.cli.written import write
from armgpi.errors import ArmgpiError, ArmgpiWarning

if TYPE_CHECKING:
    from armgpi.robot.robot import Robot
    from armgpi.validation.template import Template

#: Command -> the module and the package that it needs beside armgpi's own.
_NEEDS = {
    "run": ("", ""),
    "compare": ("", ""),
    "inspect": ("", ""),
    "bound": ("", ""),
    "excite": ("", ""),
    "bringup": ("", ""),
    "sweep": ("casadi", "casadi"),
    "play": ("casadi", "casadi"),
    "export": ("casadi", "casadi"),
    "tune": ("cma", "cma"),
    "certify": ("clarabel", "clarabel"),
    "identify": ("clarabel", "clarabel"),
}
#: Kinds of findings that make what the file says of an arm doubtful: most are wrong units.
_DOUBTS = ("axis", "degrees", "inertia", "length", "limits", "mass", "velocity")

#: Configurations at which the torque that holds the arm is looked at.
_HOLDING = 500

_Value = TypeVar("_Value")
#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "robot <ROBOT>": "Path of a URDF file, or name of a robot (see `armgpi robots`).",
    "out --out -o FILE": "The experiment file; by default next to the URDF, with its name.",
    "payload KG": "Heaviest payload of the arm, which its controller does not know; none by default.",
    "target NAME": "Hardware that `armgpi export` writes for.",
    "force": "Replace the file.",
    "planar JOINTS": (
        "Begin with a planar arm in place of ROBOT: its URDF, and a model in Python to fill in for "
        "`armgpi validate`."
    ),
    "dh FILE": (
        "Begin with an arm from a table of Denavit-Hartenberg parameters (CSV) in place of ROBOT: its URDF, "
        "and a model in Python to fill in."
    ),
    "dh_convention standard|modified": "Convention of that table: standard by default, or modified (Craig).",
}


#: A controller of the file for `armgpi compare`.
_RIVAL = "  - type: pid_positions  # a rival that measures positions alone, for armgpi compare"


class _Answers:
    """What is known of the arm: typed as an option, asked where a person is there, or assumed.

    Attributes:
        asks: whether a person can be asked.
    """

    def __init__(self) -> None:
        self.asks = sys.stdin.isatty() and sys.stderr.isatty()

    def get(
        self, question: str, typed: _Value | None, assumed: _Value, kind: Callable[[str], Any]
    ) -> tuple[_Value, str]:
        """Return an answer, and the note that goes behind it in the file."""
        if typed is not None:
            return typed, ""
        if self.asks:
            return typer.prompt(question, default=assumed, type=kind, err=True), ""
        return assumed, "; assumed: change it where you know better"


@opt.add_options
def new(
    robot: str | None = None,
    out: Path | None = None,
    payload: float | None = None,
    encoder_bits: int | None = None,
    delay: int | None = None,
    dt: float | None = None,
    target: str | None = None,
    force: bool = False,
    planar: int | None = None,
    dh: Path | None = None,
    dh_convention: str | None = None,
    *,
    how: opt.Arm,
) -> None:
    """Begin an experiment file for an arm: what its URDF contains, what you specify, and what is assumed.

    Nothing else is added: without --payload there is none. For an arm whose joints have no effort limit, or
    whose links have no mass, the file has blanks to fill in, and the exit code is 3.

    \b
    armgpi new my_arm.urdf
    armgpi new humanoid.urdf --keep left_arm --payload 2 --target ros2_control
    armgpi new --planar 2
    armgpi new --dh my_arm.csv
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi import config
    from armgpi.health import findings, report

    typed = {"payload": payload, "encoder_bits": encoder_bits, "delay": delay, "dt": dt, "target": target}
    if _begins_template(robot, planar, dh, dh_convention, out, force, {**typed, **vars(how)}):
        return
    assert robot is not None
    if target is not None:
        known_target(target)
    if is_experiment(robot):
        raise refusal(
            "ROBOT",
            f"{robot} is an experiment file already: armgpi run {robot}; expected a URDF or "
            "the name of a robot",
        )
    path, name = _place(robot, out, force)
    answers = _Answers()
    arm, how, hands = _arm(robot, how, answers)
    section: dict[str, Any] = {"name": name, **opt.robot_given(how)}
    if set(section.get("lock", {}).values()) == {None}:
        section["lock"] = [*section["lock"]]
    massless = _assumed_bodies(arm, how)
    blanks = [name for name, effort in zip(arm.joint_names, arm.limits.effort, strict=True) if effort <= 0.0]
    lines = _file(arm, section, hands, answers, typed, path, blanks, massless)
    text = "\n".join(lines) + "\n"
    if not (blanks or massless):
        checked, _ = config.parse(text, str(path))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)  # the commands will give them
            config.build(checked.replace(robot=checked.robot.replace(name=robot)))
    write(path, text, "--out")
    if blanks or massless:
        _say_blanks(path, blanks, massless)
        sys.exit(INCOMPLETE)
    for each in findings.fold(report.inspect(robot, **opt.robot_given(how)).findings):
        if each.level == "warning" and each.kind in _DOUBTS:
            say(f"warning: {each}", err=True, fg="yellow")
    say(f"{arm.name}: {counted(arm.n, 'joint')}; next: armgpi run {path}")


def _begins_template(
    robot: str | None,
    planar: int | None,
    table: Path | None,
    convention: str | None,
    out: Path | None,
    force: bool,
    others: dict[str, Any],
) -> bool:
    """Write an arm to begin with where one is asked for in place of a robot, and tell whether it was."""
    if convention is not None and table is None:
        raise refusal("--dh-convention", "is about a table: give it with --dh FILE")
    if table is not None:
        _begin_table(robot, table, convention or "standard", out, force, {**others, "planar": planar})
    elif robot is None or planar is not None:
        _begin_planar(robot, planar, out, force, others)
    else:
        return False
    return True


def _begin_planar(
    robot: str | None, joints: int | None, out: Path | None, force: bool, others: dict[str, Any]
) -> None:
    """Write the URDF of a planar arm, and beside it a model to fill in; other options are not for it."""
    from armgpi.validation import template

    if joints is None:
        raise refusal("ROBOT", "is missing: give a URDF or the name of a robot, --planar JOINTS or --dh FILE")
    _refuse_others("--planar", robot, others)
    made = template.planar(joints)
    _write_template(made, out or Path(f"planar{joints}.urdf"), "--planar", force)


def _begin_table(
    robot: str | None, table: Path, convention: str, out: Path | None, force: bool, others: dict[str, Any]
) -> None:
    """Write the URDF of an arm from a table, and beside it a model to fill in."""
    from armgpi.validation import denavit

    _refuse_others("--dh", robot, others)
    made = denavit.from_table(denavit.read_table(table), convention)
    _write_template(made, out or Path(f"{table.stem}.urdf"), "--dh", force, f"{convention} convention; ")


def _refuse_others(option: str, robot: str | None, others: dict[str, Any]) -> None:
    """Refuse a robot, and options of an experiment file, beside an option that writes none."""
    if robot is not None:
        raise refusal(option, f"takes the place of ROBOT; leave {robot} out")
    if given := [f"--{name.replace('_', '-')}" for name, value in others.items() if value not in (None, [])]:
        raise refusal(option, f"writes no experiment file, which {', '.join(given)} would be for")


def _write_template(made: Template, urdf: Path, option: str, force: bool, note: str = "") -> None:
    """Write a URDF and beside it the model to fill in, and say what is next."""
    if urdf.suffix != ".urdf":
        raise refusal("--out", f"expected a file that ends in .urdf with {option}, got {urdf}")
    model = urdf.with_suffix(".py")
    for path in (urdf, model):
        if path.exists() and not force:
            raise refusal("--out", f"{path} exists; choose another file, or add --force")
    write(urdf, made.urdf, "--out")
    write(model, made.model_for(urdf.stem), "--out")
    say(f"{urdf}, {model}: {note}fill in D, C v and G; next: armgpi validate {model} --robot {urdf}")


def _assumed_bodies(arm: Robot, how: opt.Arm) -> dict[str, str]:
    """Return the links whose bodies are assumed -> what is assumed; none where that was asked for."""
    from armgpi.robot.repairs import SUPPOSE

    if any(SUPPOSE in text for text in how.repair or ()):
        return {}
    made = [each for each in arm.provenance.get("repairs", ()) if each["name"].startswith(SUPPOSE)]
    return {each["name"].partition(":")[2]: each["after"] for each in made}


def _say_blanks(path: Path, blanks: list[str], massless: dict[str, str]) -> None:
    """Say what has to be filled in before the file can be run."""
    wanted = [f"the mass of {', '.join(massless)}, or use its line `repair`"] if massless else []
    wanted += [f"robot.effort of {', '.join(blanks)}"] if blanks else []
    say(f"INCOMPLETE: fill in {'; and '.join(wanted)} in {path}; then: armgpi run {path}")


def _place(robot: str, out: Path | None, force: bool) -> tuple[Path, str]:
    """Return where the file goes, and what it calls its robot.

    Raises:
        ConfigError: when it would overwrite the robot, or another file that may not be replaced.
    """
    from armgpi.robot import robots

    source, name = robots.locate(robot)
    other = source.with_suffix(".yaml")
    path = out or (Path(f"{name}.yaml") if name else other)
    if path.exists() and path.samefile(source):
        raise refusal("--out", f"{path} is the robot itself; choose another file, such as {other}")
    if path.exists() and not force:
        raise refusal("--out", f"{path} exists; choose another file, or add --force")
    beside = path.parent.resolve() == source.parent.resolve()
    return path, name or (source.name if beside else str(source.resolve()))


def _file(
    arm: Robot,
    section: dict[str, Any],
    hands: list[str],
    answers: _Answers,
    typed: dict[str, Any],
    path: Path,
    blanks: list[str],
    massless: dict[str, str],
) -> list[str]:
    """Return the lines of the file.

    Args:
        arm: the arm.
        section: of its robot.
        hands: joints of its gripper, which are locked.
        answers: what gives the rest.
        typed: what options gave, None for what they did not.
        path: of the file.
        blanks: joints whose effort limit has to be filled in.
        massless: links whose mass has to be -> the body that is assumed.
    """
    from armgpi.config.schema import FORMAT
    from armgpi.config.world import DELAY
    from armgpi.hardware.export.interfaces import COMPENSATING, TARGETS
    from armgpi.robot import robots, rotors

    target, _ = answers.get(f"Target ({', '.join(TARGETS)})", typed["target"], "bare", str)
    interface = COMPENSATING.get(target)
    load, _ = answers.get("Heaviest load at the tool [kg]", typed["payload"], 0.0, float)
    bits, bits_note = _resolution(arm, typed["encoder_bits"], answers)
    delay = max(DELAY, interface.delays[0]) if interface else DELAY
    late, late_note = answers.get("Delay of measurements [samples]", typed["delay"], delay, int)
    step, step_note = answers.get("Sample time [s]", typed["dt"], interface.dt if interface else 1e-3, float)
    if interface is not None:
        section["gravity"] = "robot"
    payload = f"  payload: {{mass: {load:.3g}, frame: {_text(arm.tip)}}}  # kg"
    none = f"  # payload: {{mass: 0.5, frame: {_text(arm.tip)}}}  # kg; none unless this line is in use"
    assumed = _assumed_drives(arm, section, blanks or [*massless])
    ideal = robots.is_textbook(section["name"]) and typed["encoder_bits"] is None and typed["delay"] is None
    sensors = [
        f"  encoder_bits: {_text(bits)}  # per turn{bits_note}",
        f"  delay: {late}  # samples; delay of the measurements{late_note}",
        _friction_line(rotors.with_published(arm), interface is not None),
    ]
    realistic = "ideal: false  # a realistic arm: what no line states is assumed (armgpi run prints it)"
    textbook = "ideal: true  # a textbook's arm: rigid, no rotors, no friction, exact positions"
    automatic = "  - type: gpi_auto  # tuned automatically for this arm; other types: armgpi run --help"
    printed = "  - type: gpi  # as printed in the paper; the others: armgpi run --help"
    return [
        f"# {arm.name}: {counted(arm.n, 'joint')}, tool {arm.tip!r}. One file for every command:",
        *_command_lines(path, target),
        f"format: {FORMAT}",
        "robot:",
        *(f"  {key}: {_text(value)}" for key, value in section.items()),
        *(f"  # {joint!r} looks like a gripper, and is locked" for joint in hands),
        *_mass_lines(massless),
        *_effort_lines(arm, blanks, massless),
        *([] if blanks or massless or "drives" in section else _drive_lines(arm, assumed)),
        textbook if ideal else realistic,
        "plant:  # the simulated arm; the controller does not know the payload",
        *(["  engine: armgpi"] if ideal else sensors),
        payload if load else none,
        "controllers:",
        *([printed] if ideal else [automatic, _RIVAL]),
        "  - type: pid  # for armgpi compare; the other commands take the first controller",
        f"sample_time: {step:g}  # s{step_note}",
        *_vary_lines(arm, assumed, load),
    ]


def _resolution(arm: Robot, typed: int | None, answers: _Answers) -> tuple[int | dict[str, int], str]:
    """Return the resolution of the encoders [bits], and the note that goes behind it in the file.

    Where the joints' differ it is joint -> bits: one number would take the place of what is known.
    """
    from armgpi.robot import rotors
    from armgpi.robot.known_arms import known_bits
    from armgpi.tuning.rule import BITS

    drives = rotors.with_published(arm).drives
    known = known_bits(drives, BITS)
    if typed is None and isinstance(known, dict):
        sources = dict.fromkeys(source or "assumed" for source in drives.sources("encoder_count"))
        return known, f"; {' or '.join(sources)}"
    usual = known if isinstance(known, int) else BITS
    bits, note = answers.get("Encoder resolution [bits per turn]", typed, usual, int)
    return bits, "; published for this arm" if note and usual != BITS else note


def _assumed_drives(arm: Robot, section: dict[str, Any], blanks: list[str]) -> Any:
    """Return the drives with what is assumed of them; None where that depends on efforts left blank."""
    from armgpi.robot import rotors

    if isinstance(section.get("drives"), str):  # a word, by which the arm was made already
        return arm.drives
    return None if blanks else rotors.assume_drives(arm, "elastic").drives


def _command_lines(path: Path, target: str) -> list[str]:
    """Return the commands that take the file, those of missing packages with the line that installs them."""
    from importlib.util import find_spec

    shown = {"identify": f"identify log.armlog --robot {path}", "export": f"export {path} --target {target}"}
    lines = []
    for command, (module, package) in _NEEDS.items():
        missing = module and find_spec(module) is None
        note = f"   (needs a package: pip install {package})" if missing else ""
        lines.append(f"#   armgpi {shown.get(command, f'{command} {path}')}{note}")
    return lines


def _mass_lines(massless: dict[str, str]) -> list[str]:
    """Return the blanks of masses, with what to do and what would be assumed."""
    from armgpi.robot.repairs import SUPPOSE

    if not massless:
        return []
    return [
        f"  # FILL IN: the URDF has no mass in {', '.join(massless)}, so this file cannot be run yet.",
        "  # Add an <inertial> with mass [kg] and inertia [kg m²] to each of these links in the URDF, or use",
        "  # the next line: bodies that are assumed, until `armgpi identify` finds the real ones from a log.",
        *(f"  #   {link}: {body}" for link, body in massless.items()),
        f"  # repair: [{SUPPOSE}]",
    ]


def _effort_lines(arm: Robot, blanks: list[str], massless: dict[str, str]) -> list[str]:
    """Return the blanks of effort limits, each with the torque that holds the arm if that is known."""
    import numpy as np

    if not blanks:
        return []
    q = np.vstack([arm.middle(), arm.random_positions(_HOLDING, seed=1)])
    holding = dict(zip(arm.joint_names, np.abs(arm.gravity(q)).max(axis=0), strict=True))
    return [
        "  effort:  # N m or N: FILL IN. The file has 0, with which no controller can move the arm",
        *(
            f"    {name}:  # FILL IN"
            + ("" if massless else f"; gravity alone takes up to {round(holding[name], 9):.3g}")
            for name in blanks
        ),
    ]


def _drive_lines(arm: Robot, assumed: Any) -> list[str]:
    """Return what is published or assumed of the drives as keys, with intervals; nothing if all is known."""
    from armgpi.robot import rotors
    from armgpi.robot.known_arms import describe_published

    known = arm.drives.plain()
    lines = []
    for joint, quantities in assumed.plain().items():
        own = {key: _rounded(value) for key, value in quantities.items() if key not in known.get(joint, {})}
        if own:
            lines.append(f"    {_text(joint)}: {_text(own)}")
    if not lines:
        return []
    published = describe_published(assumed, values=True)
    product = [f"  # {published}"] if published else []
    return [
        "  # The URDF contains no rotor inertia [kg m² or kg] or joint stiffness [N m/rad or N/m].",
        *product,
        "  # Assumed from effort and velocity limits (docs/drives.md), replace what you know:",
        f"  # rotors that spin up in {rotors.SPIN_UP:g} s, within a factor of {rotors.SCATTER:g},",
        f"  # and joints that deflect by {rotors.TWIST:g} rad at their effort limit, within a factor of "
        f"{rotors.TWIST_SCATTER:g}.",
        "  drives:",
        *lines,
    ]


def _rounded(datum: Any) -> Any:
    """Return a value of a drive with three digits, and its ends likewise."""
    if not isinstance(datum, dict):
        return datum
    ordered = {key: datum[key] for key in ("value", "low", "high", "source", "file") if key in datum}
    return {key: float(f"{x:.3g}") if isinstance(x, float) else x for key, x in ordered.items()}


def _friction_line(arm: Robot, robot_compensates: bool) -> str:
    """Return the key of friction, with what the URDF contains of it."""
    if robot_compensates:
        return "  friction: none  # the robot compensates gravity and friction by itself"
    viscous, coulomb = arm.friction
    if not (viscous.any() or coulomb.any()):
        return "  friction: urdf  # the URDF contains no friction; specify it by robot.friction"
    where = (
        "published for this arm" if "published" in arm.drives.sources("viscous") else "contained in the URDF"
    )
    return (
        f"  friction: urdf  # {where}: viscous up to {viscous.max():g} N m s/rad, Coulomb up "
        f"to {coulomb.max():g} N m; none drops it"
    )


def _vary_lines(arm: Robot, assumed: Any, load: float) -> list[str]:
    """Return what a sweep draws: what is assumed of the drives, within its intervals, and the load.

    Args:
        arm: the arm.
        assumed: the drives with what is assumed of them; None where they depend on what is left blank.
        load: heaviest load [kg]; 0 for none.
    """
    from armgpi.robot import rotors

    varied = []
    for quantity, key, factor in (
        ("rotor_inertia", "plant.rotor_inertia", rotors.SCATTER),
        ("stiffness", "plant.gear_stiffness", rotors.TWIST_SCATTER),
    ):
        # With blanks, all that is not known will be assumed as soon as they are filled in.
        sources = set(assumed.sources(quantity)) if assumed is not None else set(arm.drives.sources(quantity))
        if sources == ({"assumed"} if assumed is not None else {""}):
            varied.append(
                f"  {key}: {{factor: {factor:g}, each: joint}}  # from 1/{factor:g} to {factor:g} times"
            )
    if load:
        varied.append(f"  plant.payload.mass: {{uniform: [0, {load:.3g}]}}  # kg")
    if not varied:
        return [
            "# vary: {plant.delay: {choices: [0, 1, 2]}}  # what armgpi sweep varies; nothing here is assumed"
        ]
    return ["vary:  # what armgpi sweep varies at random", *varied]


def _arm(robot: str, how: opt.Arm, answers: _Answers) -> tuple[Robot, opt.Arm, list[str]]:
    """Return one arm of a robot, the options that load it, and the joints of its gripper, which they lock."""
    from armgpi.robot import chains, grippers, reading, robots

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)  # of what is mended here
            # Numbers that are listed are of the arm's joints alone.
            arm = _load(robot, replace(how, effort=None, rotor_inertia=None, drives=None))
        several = chains.of(arm.provenance)
    except ArmgpiError:  # which may be of a part that is not kept
        source, _ = robots.locate(robot)
        several = chains.find(reading.read(source))
        if how.keep or len(several) < 2:
            raise
    if not how.keep and several:
        first = chains.first_arm(several).name
        said = chains.describe(several)
        chosen, _ = answers.get(f"{said}. Keep", None, first, str)
        say(f"note: {said}; the file keeps {chosen}", err=True)
        how = replace(how, keep=[chosen])
    hands = [] if how.keep else grippers.moving(arm)
    how = replace(how, lock=[*(how.lock or []), *hands])
    return _load(robot, how), how, hands


def _load(robot: str, how: opt.Arm) -> Robot:
    """Return an arm; that of a file without masses has assumed bodies, of which `how` says nothing."""
    from armgpi.robot.repairs import SUPPOSE

    try:
        return load_arm(robot, how)
    except ArmgpiError as error:
        cause = error.__cause__ if isinstance(error.__cause__, ArmgpiError) else error
        if not any(remedy.value == SUPPOSE for remedy in cause.remedies):
            raise
        return load_arm(robot, replace(how, repair=[*(how.repair or []), SUPPOSE]))


def _text(value: Any) -> str:
    """Return a value as YAML on one line."""
    import yaml

    return (
        yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=1e9, sort_keys=False)
        .removesuffix("...\n")
        .strip()
    )
