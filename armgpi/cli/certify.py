"""The command that certifies a controller on an arm."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armgpi.base import renamed
from armgpi.base.escape import json_data
from armgpi.base.renamed import current_name
from armgpi.base.verdict import Verdict, judge
from armgpi.cli import options as opt
from armgpi.cli.arms import (
    joint_numbers,
    load_arm,
    load_ends,
    note_assumed,
    note_gears,
    note_world,
    possible_arms,
    refuse_pushes,
    resolved,
    unjudged_drives,
)
from armgpi.cli.parsing import FAILED, OK, is_experiment, refusal, stoppable
from armgpi.cli.pictures import check_file
from armgpi.cli.terminal import progress, say
from armgpi.cli.written import write
from armgpi.errors import require_extra

if TYPE_CHECKING:
    from armgpi.certification.certificate import Certificate
    from armgpi.config import ExperimentConfig
    from armgpi.robot.robot import Robot

#: Controllers that no proof covers, and why; see docs/compliance.md.
_COMPLIANT = ("cartesian_impedance", "joint_impedance")
_NOT_PROVED = (
    "no proof covers a spring, whose damping from filtered positions ends at some frequency; "
    "`armgpi inspect` prints the largest stiffness"
)
#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "speed NUMBERS": "Largest speed of each joint of the reference [rad/s or m/s]; for a reference at "
    "rest, the speed of an error that changes D(q) as fast.",
    "payload KG:KG": "Lightest and heaviest payload at the tip [kg], such as '0:3'; none by default.",
    "box FILE": "YAML with the configurations of the reference: around and by, or lower and upper; the joint "
    "ranges by default.",
    "acceleration NUMBERS": "Acceleration of the reference [rad/s² or m/s²]; with it, tracking errors "
    "are bounded as well.",
    "torque NUMBERS": "Disturbance torque, arbitrary in time, bounded by this [N m or N].",
    "radius NUMBERS": "How far the arm may be from its reference [rad or m].",
    "omega NUMBER": (
        "Natural frequency omega_c [rad/s], by default that of armgpi run; '22:40' for "
        "one that adapts in this range."
    ),
    "rate NUMBER": (
        "Bound rho on its rate, abs(d omega/dt) <= rho omega^2, one for all joints; "
        "'auto' takes the largest that is found."
    ),
    "zeta NUMBER": "Damping ratio.",
    "pole --p NUMBER": "Real pole [rad/s]; omega.",
    "integrators NUMBER": "Number of integrators: 1 to 3.",
    "rolloff NUMBER": "Number of roll-off poles, which filter noise: 0 to 2.",
    "rolloff_ratio NUMBER": "Roll-off poles divided by omega.",
    "feedforward NAME": "Feedforward: none, gravity or model.",
    "delay SAMPLES": "Delay of the measurements [samples].",
    "friction": "Count the URDF's joint friction as a disturbance.",
    "jump": "The payload may be attached and removed while the arm moves.",
    "start NAME": "How a run starts: wrong-load, with the torque for another payload of the range, as "
    "GPI does; held, after the loop has held the arm; or exact, with the torque that holds "
    "its payload.",
    "controller --controller --controllers NAME": "gpi by default; or gpi_auto: automatic tuning with one "
    "omega for all joints.",
    "prove": (
        "Prove the numbers of the arm (branch and bound), as far as --budget suffices; "
        "otherwise they are estimated numerically."
    ),
    "budget SECONDS": "Processor time for the proof of each number of the arm [s].",
    "out --out -o FILE": "Write the certificate file (JSON).",
    "refute FILE": "Try to refute the numbers of this certificate by 20,000 configurations instead.",
}


@stoppable
@opt.add_options
def certify(
    robot: str,
    speed: str = "0.2",
    payload: str | None = None,
    box: Path | None = None,
    acceleration: str | None = None,
    torque: str | None = None,
    radius: str = "0.02",
    omega: str | None = None,
    rate: str | None = None,
    zeta: float = 1.0,
    pole: float | None = None,
    integrators: int = 2,
    rolloff: int = 0,
    rolloff_ratio: float = 4.0,
    feedforward: str = "none",
    dt: float | None = None,
    delay: int | None = None,
    encoder_bits: int | None = None,
    friction: bool = False,
    jump: bool = False,
    start: str = "wrong-load",
    controller: str | None = None,
    prove: bool = False,
    budget: float = 30.0,
    out: Path | None = None,
    report: Path | None = None,
    refute: Path | None = None,
    identified: Path | None = None,
    allow_part: bool = False,
    as_json: bool = False,
    *,
    how: opt.Arm,
) -> None:
    """Bound the whole arm's error under GPI, in a certificate that another program checks exactly.

    \b
    armgpi certify ur5 --payload 0:3 --start held --box task.yaml --out ur5.json
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.certification.box import read_box
    from armgpi.certification.certificate import certify as certified
    from armgpi.certification.text import verdict as verdict_of

    _check_means(refute, report)
    arm = load_arm(robot, how)
    _refute_file(refute, arm)
    known = resolved(robot, how, arm)
    dt, delay, controller = _loop_of(robot, known[0], dt, delay, controller)
    vectors = _vectors(arm, speed=speed, acceleration=acceleration, torque=torque, radius=radius)
    law: Any = {"integrators": integrators, "rolloff": rolloff, "rolloff_ratio": rolloff_ratio}
    law |= {"delay": delay, "feedforward": feedforward, "controller": controller}
    stated = {"bits": encoder_bits, "friction": friction, "jump": jump, "start": start}
    proof: Any = {"prove": prove, "budget": budget, "rate": "auto" if rate == "auto" else None}
    proof |= {"payload": load_ends(payload), "box": box and read_box(box), **possible_arms(identified, arm)}
    options = {**vectors, **_chosen_parts(law), **stated, **proof, "gains": _gains(omega, zeta, pole, rate)}
    left_out = _left_out(robot, payload=payload, omega=omega, encoder_bits=encoder_bits)
    left_out += unjudged_drives(known, friction)
    _note_judged(known, arm, (delay, encoder_bits, friction, controller), as_json)
    with progress() as told:
        found = certified(arm, dt, progress=told, **options)
    verdict = judge(found.certified, verdict_of(found), left_out, accepted=allow_part)
    _publish(found, arm, out, report, as_json, verdict)
    sys.exit(verdict.exit_code)


def _check_means(refute: Path | None, report: Path | None) -> None:
    """Refuse what lacks a package, and a page that cannot be written, before the long work."""
    if refute is None:
        require_extra("clarabel", "certify")
    if report is not None:
        check_file(report, "--report")


def _note_judged(
    known: tuple[ExperimentConfig, Robot], arm: Robot, loop: tuple[int, int | None, bool, str], as_json: bool
) -> None:
    """Say which arm and controller a certificate is for, in the words of every command, and what is assumed.

    Args:
        known: what `armgpi run` resolves, as :func:`armgpi.cli.arms.resolved` returns it.
        arm: the arm.
        loop: samples of delay, bits of the encoders, whether friction disturbs, and type of the controller.
        as_json: whether the verdict is printed as JSON.
    """
    from armgpi import config
    from armgpi.config import world

    delay, bits, friction, controller = loop
    plant: dict[str, Any] = {"engine": "armgpi", "friction": "urdf" if friction else "none"}
    plant |= {"delay": delay} if delay else {}
    plant |= {"encoder_bits": bits} if bits is not None else {}
    data = {"robot": {"name": arm.name}, "plant": plant, "controllers": [{"type": controller}]}
    judged = world.describe_arm(config.check(data, config.Origin("certificate")), arm)
    note_world(*known, judged)
    note_assumed(arm, as_json, controller)


def _left_out(robot: str, **typed: Any) -> list[str]:
    """Return the keys of an experiment file that change its loop and that no certificate is made for.

    Args:
        robot: what stands in the place of a robot.
        typed: key -> what an option gives in place of the file's; None for what none gives.
    """
    if not is_experiment(robot):
        return []
    from armgpi import config

    data = config.read(Path(robot)).config.plain(given=True)
    # What options of this command have, what it takes from the file, and what no bound depends on.
    # Of friction, unjudged_drives says what is left out.
    known = {
        "type",
        "label",
        "delay",
        "friction",
        *(key for key, value in typed.items() if value is not None),
    }
    plant = data.get("plant") or {}
    if plant.get("engine") != "elastic":  # others simulate stiff joints, as a certificate takes them
        known.add("engine")
    found = []
    for name, section in (
        ("plant", plant),
        ("controllers.0", (data.get("controllers") or [{}])[0]),
    ):
        found += [f"{name}.{key} of {robot}" for key in section if key not in known]
    if data.get("supervisor") is not None:
        found.append(f"supervisor of {robot}")
    return found


def _publish(
    found: Certificate, arm: Robot, out: Path | None, report: Path | None, as_json: bool, verdict: Verdict
) -> None:
    """Write and print a certificate with its verdict."""
    from armgpi.certification.refute import again
    from armgpi.certification.report import html

    if out is not None:
        write(out, found.text, "--out")
    if report is not None:
        write(report, html(again(found, arm), found, verdict), "--report")
    said = str(found)
    if as_json:  # null for what is not certified
        data: dict[str, Any] = {
            "certified": found.certified,
            "verdict": verdict.plain(),
            "numbers_proved": found.numbers_proved,
            "joints": found.joint_names,
            "per_torque": found.per_torque.tolist(),
            "error": found.error.tolist(),
            "from_start": found.from_start.tolist(),
            "after_jump": found.after_jump.tolist(),
            "torque": found.torque.tolist(),
            "numbers": found.data["numbers"],
            "status": found.data["status"],
            "shares": found.data["shares"],
            "reasons": found.reasons,
        }
        said = json.dumps(json_data(data))
    elif found.certified:
        asked = again(found, arm)
        said = "\n".join(filter(None, [said, note_gears(asked.controller, asked.delay)]))
    if verdict.left_out and found.certified and not as_json:
        say(verdict.line)
    say(said, lines=True)


def _refute_file(file: Path | None, arm: Robot) -> None:
    """Say which numbers of a certificate drawn configurations exceed, and end; do nothing without one."""
    if file is None:
        return
    from armgpi.certification.certificate import Certificate
    from armgpi.certification.refute import refute
    from armgpi.certification.solve import checker

    certificate = Certificate.load(file)
    try:
        wrong = checker.verify(certificate.data)
    except checker.ERRORS as error:
        raise refusal("--refute", f"{file} is no certificate: {checker.text(str(error))}") from None
    said = [f"the certificate is not valid: {x}" for x in wrong]
    with progress() as told:
        exceeded = [] if wrong else refute(certificate, arm, progress=told)
    for name, claimed, found, q in exceeded:
        where = ", ".join(f"{x:.4g}" for x in q)
        said.append(f"refuted: {name} is {found:.6g}, not {claimed:.6g}, at q = ({where})")
    say(
        "\n".join(said)
        or (
            "the certificate passes the check, and no tried configuration exceeds its "
            "numbers; that is no proof"
        ),
        lines=True,
    )
    sys.exit(FAILED if said else OK)


def _loop_of(
    robot: str, config: ExperimentConfig, dt: float | None, delay: int | None, controller: str | None
) -> tuple[float, int, str]:
    """Return sample time, delay and law: as typed, as `armgpi run` has them of a file, or the usual ones."""
    usual: tuple[float, int, str] = (1e-3, 0, "gpi")
    if is_experiment(robot):
        from armgpi.config import read

        origin = read(Path(robot)).origin
        refuse_pushes(config, origin, "--torque")
        law = config.controllers[0].type
        if controller is None and law not in ("gpi", "gpi_auto"):
            expected = f"a certificate can be computed for gpi and gpi_auto, got {law!r}"
            if law in _COMPLIANT:
                expected += f"; {_NOT_PROVED}"
            raise origin.error(("controllers", 0, "type"), expected)
        usual = (config.sample_time, getattr(config.plant, "delay", None) or 0, law)
    return (
        usual[0] if dt is None else dt,
        usual[1] if delay is None else delay,
        usual[2] if controller is None else current_name(controller, renamed.CONTROLLERS),
    )


def _chosen_parts(law: dict[str, Any]) -> dict[str, Any]:
    """Return the parts of the law; of an automatically tuned one the rule chooses them."""
    usual = {"integrators": 2, "rolloff": 0, "rolloff_ratio": 4.0, "feedforward": "none"}
    if law["controller"] != "gpi_auto":
        return law
    for name, value in usual.items():
        if law[name] != value:
            raise refusal(
                f"--{name.replace('_', '-')}", "is chosen by --controller gpi_auto itself; leave it out"
            )
    return {name: value for name, value in law.items() if name not in usual}


def _gains(omega: str | None, zeta: float, pole: float | None, rate: str | None) -> Any:
    """Return the gains, None for the default ones."""
    from armgpi.gpi.gains import FixedGains
    from armgpi.gpi.network import BSplineNetwork

    ends = [] if omega is None else [_number(part, "--omega") for part in omega.split(":")]
    if len(ends) > 2:
        raise refusal("--omega", f"expected one number, or two such as '22:40', got {omega!r}")
    if (rate is not None) != (len(ends) == 2):
        raise refusal("--rate", "requires two ends of --omega such as '22:40', and they require it")
    match ends:
        case [low, high]:
            if pole is not None:
                raise refusal(
                    "--p", "cannot be set with an omega that adapts: it follows omega; leave it out"
                )
            # One that is looked for has to be something first.
            moves = 0.05 if rate == "auto" else _number(str(rate), "--rate")
            return BSplineNetwork(omega_c=(low, high), zeta_c=zeta, common=True, rate=moves)
        case [omega_c]:
            return FixedGains(omega_c, zeta, omega_c if pole is None else pole)
    for option, given in (("--p", pole is not None), ("--zeta", zeta != 1.0)):
        if given:
            raise refusal(option, "requires --omega")
    return None


def _vectors(arm: Robot, **texts: str | None) -> dict[str, Any]:
    """Return what options give for the joints, name -> numbers, of those that were typed."""
    return {key: joint_numbers(arm, text, f"--{key}") for key, text in texts.items() if text is not None}


def _number(text: str, option: str) -> float:
    """Return a number."""
    try:
        return float(text)
    except ValueError:
        raise refusal(option, f"expected a number, got {text!r}") from None
