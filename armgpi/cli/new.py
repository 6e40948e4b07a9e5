"""The command that begins an experiment file for an arm."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import typer

from armgpi.cli import options as opt
from armgpi.cli.certify import load_arm
from armgpi.cli.derive import write
from armgpi.cli.parsing import is_experiment, refusal
from armgpi.cli.terminal import say
from armgpi.errors import ArmgpiError, ArmgpiWarning

#: What is believed of an arm of which nobody says more: absolute encoders and a bus as geared arms have them.
_BITS, _DELAY = 16, 1
#: A load that an arm is for, as a share of its moving mass: makers' payloads of 3 and 5 kg are 0.18 of what
#: moves in Panda's URDF and 0.29 in UR5's; the share of what its motors hold everywhere that it may be; and
#: at least so much [kg].
_LOAD_SHARE, _HELD_SHARE, _LEAST_LOAD = 0.15, 0.5, 0.01
#: Kinds of findings that make what the file says of an arm doubtful: most are wrong units.
_DOUBTS = ("axis", "degrees", "inertia", "length", "limits", "mass", "velocity")

_Value = TypeVar("_Value")
#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "robot <ROBOT>": "Path of a URDF file, or name of a robot (see `armgpi robots`).",
    "out --out -o FILE": "The file; by default beside the URDF, with its name.",
    "payload KG": "Heaviest load that the arm will carry, unknown to it.",
    "target NAME": "Hardware that `armgpi export` writes for.",
    "force": "Replace the file.",
}


class _Answers:
    """What is known of the arm: typed as an option, asked where a person is there, or believed.

    Attributes:
        asks: whether a person can be asked.
    """

    def __init__(self) -> None:
        self.asks = sys.stdin.isatty() and sys.stderr.isatty()

    def get(
        self, question: str, typed: _Value | None, believed: _Value, kind: Callable[[str], Any]
    ) -> tuple[_Value, str]:
        """Return an answer, and the note that goes behind it in the file."""
        if typed is not None:
            return typed, ""
        if self.asks:
            return typer.prompt(question, default=believed, type=kind, err=True), ""
        return believed, "; believed: change it where you know better"


@opt.add_options(opt.loading, opt.arm)
def new(
    robot: str,
    out: Path | None = None,
    payload: float | None = None,
    encoder_bits: int | None = None,
    delay: int | None = None,
    dt: float | None = None,
    target: str | None = None,
    force: bool = False,
    **how: Any,
) -> None:
    """Begin an experiment file for an arm: what its URDF says, and what you say or armgpi believes.

    \b
    armgpi new my_arm.urdf
    armgpi new humanoid.urdf --keep left_arm --payload 2 --target ros2_control
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi import config
    from armgpi.hardware.export.targets import TARGETS
    from armgpi.health import findings, report

    if target not in (None, *TARGETS):
        raise refusal("--target", f"must be one of {', '.join(TARGETS)}, got {target!r}")
    if is_experiment(robot):
        raise refusal(
            "ROBOT", f"{robot} is an experiment file already: armgpi run {robot}; give a URDF or name"
        )
    path, name = _place(robot, out, force)
    answers = _Answers()
    arm, hands = _arm(robot, how, answers)
    typed = {"payload": payload, "encoder_bits": encoder_bits, "delay": delay, "dt": dt, "target": target}
    section: dict[str, Any] = {"name": name, **opt.robot_given(how)}
    if set(section.get("lock", {}).values()) == {None}:
        section["lock"] = [*section["lock"]]
    lines = _file(arm, section, hands, answers, typed, path)
    text = "\n".join(lines) + "\n"
    checked, _ = config.parse(text, str(path))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ArmgpiWarning)  # the commands will give them
        config.build(checked.replace(robot=checked.robot.replace(name=robot)))
    write(path, text, "--out")
    for each in findings.fold(report.inspect(robot, **opt.robot_given(how)).findings):
        if each.level == "warning" and each.kind in _DOUBTS:
            say(f"warning: {each}", err=True, fg="yellow")
    say(f"{arm.name}: {arm.n} joints; next: armgpi run {path}")


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
    arm: Any, section: dict[str, Any], hands: list[str], answers: _Answers, typed: dict[str, Any], path: Path
) -> list[str]:
    """Return the lines of the file, from the section of its robot and what was typed, asked or believed."""
    from armgpi.config.schema import FORMAT
    from armgpi.gpi.payload import largest_payload
    from armgpi.hardware.export.interfaces import COMPENSATING
    from armgpi.hardware.export.targets import TARGETS
    from armgpi.robot import rotors

    target, _ = answers.get(f"Target ({', '.join(TARGETS)})", typed["target"], "bare", str)
    interface = COMPENSATING.get(target)
    held = largest_payload(arm, dt=1e-3).effort
    likely = max(_LEAST_LOAD, float(f"{min(_LOAD_SHARE * arm.moving_mass, _HELD_SHARE * held):.2g}"))
    load, load_note = answers.get("Heaviest load at the tool [kg]", typed["payload"], likely, float)
    bits, bits_note = answers.get("Encoder resolution [bits per turn]", typed["encoder_bits"], _BITS, int)
    delay = max(_DELAY, interface.delays[0]) if interface else _DELAY
    late, late_note = answers.get("Delay of measurements [samples]", typed["delay"], delay, int)
    step, step_note = answers.get("Sample time [s]", typed["dt"], interface.dt if interface else 1e-3, float)
    if interface is not None:
        section["gravity"] = "robot"
    silent = rotors.silent(arm)
    notes = [
        f"  # The URDF says nothing of the rotors of {len(silent)} joints; the rule believes them.",
        "  # Where you know them, seen at the joint [kg m², kg]: rotor_inertia: {JOINT: NUMBER}",
    ]
    return [
        f"# {arm.name}: {arm.n} joints, tool {arm.tip!r}. One file for every command:",
        f"#   armgpi run {path}; compare, inspect, sweep, tune, play, certify, excite, export, bringup too,",
        f"#   armgpi identify log.armlog --robot {path}, armgpi export {path} --target {target}",
        f"format: {FORMAT}",
        "robot:",
        *(f"  {key}: {_text(value)}" for key, value in section.items()),
        *(f"  # {joint!r} looks like a gripper, and is locked" for joint in hands),
        *(notes if silent else []),
        "plant:  # what the controller does not know",
        f"  encoder_bits: {bits}  # per turn{bits_note}",
        f"  delay: {late}  # samples by which measurements are late{late_note}",
        f"  payload: {{mass: {load:.3g}, frame: {_text(arm.tip)}}}  # kg{load_note}",
        "controllers:",
        "  - type: gpi_auto  # the rule for arms that nobody tuned; the others: armgpi run --help",
        "  - type: pid  # armgpi compare puts it beside the first, which the other commands take",
        f"sample_time: {step:g}  # s{step_note}",
        "vary:  # what armgpi sweep draws",
        f"  plant.payload.mass: {{uniform: [0, {load:.3g}]}}",
    ]


def _arm(robot: str, how: dict[str, Any], answers: _Answers) -> tuple[Any, list[str]]:
    """Return one arm of a robot, and the joints of its gripper, locked: `how` says so afterwards."""
    from armgpi.robot import chains, reading, robots

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ArmgpiWarning)  # of what is mended here
            # Numbers that are listed are of the arm's joints alone.
            arm = load_arm(robot, {**how, "effort": None, "rotor_inertia": None, "drives": None})
        several = chains.of(arm.provenance)
    except ArmgpiError:  # which may be of a part that is not kept
        source, _ = robots.locate(robot)
        several = chains.find(reading.read(source))
        if how["keep"] or len(several) < 2:
            raise
    if not how["keep"] and several:
        believed = chains.first_arm(several).name
        said = chains.describe(several)
        chosen, _ = answers.get(f"{said}. Keep", None, believed, str)
        say(f"note: {said}; the file keeps {chosen}", err=True)
        how["keep"] = [chosen]
    hands = [] if how["keep"] else [j for j in arm.provenance.get("grippers", ()) if j in arm.joint_names]
    how["lock"] = [*(how["lock"] or []), *hands]
    return load_arm(robot, how), hands


def _text(value: Any) -> str:
    """Return a value as YAML on one line."""
    import yaml

    return (
        yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=1e9)
        .removesuffix("...\n")
        .strip()
    )
