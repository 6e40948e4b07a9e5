"""The commands that excite an arm and identify it."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from armgpi.base import files
from armgpi.cli import options as opt
from armgpi.cli.arms import load_arm, note_published, note_world, resolved
from armgpi.cli.parsing import is_experiment, per_joint, stoppable
from armgpi.cli.terminal import console, say, widen, working
from armgpi.cli.written import import_xarray
from armgpi.errors import ParameterError, require_extra

if TYPE_CHECKING:
    from armgpi.base.verdict import Verdict
    from armgpi.identification.arm import Identified, Load, Validation
    from armgpi.identification.excitation import Excitation
    from armgpi.robot.clearance import Clearance
    from armgpi.robot.robot import Robot

#: Duration of a motion by default [s].
_SECONDS = 20.0
#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "logs <LOG...>": "Logs of one arm: .armlog, CSV with time, q_JOINT and tau_JOINT, MCAP, or a rollout "
    "(NetCDF).",
    "identify.robot ROBOT": "The arm before it is identified: URDF or name.",
    "validate LOG": "Another log, on which the identified model is evaluated.",
    "no_gravity": "The logged torques do not contain gravity: the arm compensates it itself.",
    "current NUMBERS": "Torque constants at the joints [N m/A], for logs with currents as tau, such as "
    "'j1=10,j2=12'.",
    "torque KIND": "What the torques are: motor (current times a constant), joint (a sensor behind the gear) "
    "or commanded.",
    "columns NAMES": "What columns of CSV files are called: 'time=t,q=pos_JOINT,tau=i_NUMBER' (from 1).",
    "identify.resonance LOG": (
        "A log of excite --resonance, from which joint stiffness and the first mode are identified."
    ),
    "excite.resonance": (
        "Excite joint by joint with 2 to 60 Hz and a few degrees of motion, to identify joint stiffness."
    ),
    "identify.side LOG": (
        "A log of excite --side, from which the side of the encoders and the rotor inertia are identified; "
        "without other logs the folder has drives.yaml alone."
    ),
    "excite.side": (
        "Excite joint by joint with one second of 4 to 160 Hz, to identify the side of the encoders and the "
        "rotor inertia."
    ),
    "experiment FILE": (
        "The experiment of the first log; it is simulated with the identified arm and compared."
    ),
    "load LOG": "A log of the same arm with a payload at its tip, which is identified.",
    "load_mass KG": "The mass of the payload of --load, where it is known: gives the scale of --current.",
    "anyway": "Identify even if the check of the log fails.",
    "out --out -o FOLDER": "Folder for the files.",
    "seconds SECONDS": "Duration of the motion [s]; default 20. Those of --resonance and --side are fixed.",
    "share NUMBER": "Share of the limits of speed and torque; 0.7, 0.25 for --first, 0.4 for --resonance; "
    "0.15 for --side.",
    "first": (
        "For an arm of which only the URDF is known: a slower motion, planned with assumed rotor inertia."
    ),
    "floor METRES": "Height above which all links but the first stay [m]; default: an upright arm's.",
    "no_floor": "Assume no floor.",
    "box NUMBERS": "Two corners of a box that all links avoid: x,y,z,x,y,z [m].",
    "margin METRES": "Distance from itself, floor and box [m]; 0.02 of the arm's length by default.",
    "no_collisions": "Do not compare the arm's own links with each other.",
    "seed NUMBER": "Seed of the random motion.",
}


@stoppable
@opt.add_options
def identify(
    logs: list[Path] | None = None,
    *,
    robot: str,
    validate: Path | None = None,
    no_gravity: bool = False,
    current: str | None = None,
    torque: str | None = None,
    columns: str | None = None,
    resonance: Path | None = None,
    side: Path | None = None,
    experiment: Path | None = None,
    load: Path | None = None,
    load_mass: float | None = None,
    anyway: bool = False,
    out: Path = Path("identified"),
    allow_part: bool = False,
    report: Path | None = None,
    as_json: bool = False,
    how: opt.Loading,
) -> None:
    """Identify an arm from logs of measured positions and commanded torques.

    \b
    armgpi identify log.csv --robot my_arm.urdf --validate other.csv
    armgpi run identified/
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.identification.text import judge_arm
    from armgpi.identification.writing import write_identified

    if logs:
        require_extra("clarabel", "certify")
    else:
        of_logs = (resonance, validate, experiment, load, load_mass, report, no_gravity, anyway)
        _refuse_without_logs(side, of_logs)
    arm = load_arm(robot, how)
    constants = None if current is None else per_joint(current, "--current")
    options: dict[str, Any] = {"current": constants, "columns": _names(columns), "torque": torque}
    if side is not None and not logs:
        sys.exit(_identify_side(arm, robot, side, out, options, allow_part, as_json))
    options |= {"gravity": not no_gravity, "check_first": not anyway}
    if experiment is not None:  # it is simulated
        import_xarray()
    with working("fitting the model of the arm to the log"):
        found, carried = _with_load(logs or [], arm, load, load_mass, options)
        if side is not None:
            found = found.with_side(side)
        if resonance is not None:
            found = found.with_resonance(resonance)
        if experiment is not None:
            found = found.with_experiment(experiment)
        validation = None if validate is None else found.validate(validate)
    note_world(*resolved(robot, how, arm))
    note_published(arm)
    written = write_identified(found, out, validation, carried)
    if report is not None:
        files.write(report, (out / "report.html").read_text(encoding="utf-8"))
    verdict = judge_arm(found, validation, allow_part)
    _show(found, validation, carried, verdict, out if as_json else None)
    _say_written(written, out)
    sys.exit(verdict.exit_code)


def _show(
    found: Identified,
    validation: Validation | None,
    carried: Load | None,
    verdict: Verdict,
    folder: Path | None,
) -> None:
    """Print what was identified: the content of the folder as JSON, or sentences and the table."""
    from rich.table import Table

    from armgpi.identification.text import lines, say_load, tabulate

    if folder is not None:
        data = json.loads((folder / "identification.json").read_text(encoding="utf-8"))
        say(json.dumps({**data, "verdict": verdict.plain()}))
        return
    if verdict.outcome != "holds":
        say(verdict.line)
    say(lines(found, validation, [] if carried is None else [say_load(carried)]), lines=True)
    head, rows = tabulate(found, validation)
    table = Table(*head)
    for row in rows:
        table.add_row(*row)
    screen = console()
    widen(screen, table)
    screen.print(table)


#: Options of the identification from logs, which chirps alone do not use, as `identify` passes them.
_OF_LOGS = (
    "--resonance",
    "--validate",
    "--experiment",
    "--load",
    "--load-mass",
    "--report",
    "--no-gravity",
    "--anyway",
)


def _refuse_without_logs(side: Path | None, given: tuple[Any, ...]) -> None:
    """Refuse what cannot be done without the logs of an arm in motion.

    Raises:
        ParameterError: without a log of chirps as well, or for an option that nothing would use.
    """
    if side is None:
        raise ParameterError("LOG...", None, "at least one log, or --side LOG of armgpi excite --side")
    for option, value in zip(_OF_LOGS, given, strict=True):
        if value is not None and value is not False:
            wanted = "left out without LOG...: --side alone does not use it"
            raise ParameterError(option, "given" if value is True else str(value), wanted)


def _identify_side(
    arm: Robot,
    name: str,
    log: Path,
    out: Path,
    options: dict[str, Any],
    allow_part: bool,
    as_json: bool,
) -> int:
    """Identify the side of the encoders and the rotors from chirps alone, and return the exit code.

    Raises:
        ParameterError: for torques of sensors behind the gears, or a folder of an identified arm.
    """
    from armgpi.identification import chirp
    from armgpi.robot.identified import NAME

    if (out / NAME).exists():
        # Its drives.yaml has what other logs determined, and belongs to that record.
        wanted = "a folder without an identified arm: name another, or give its logs together with --side"
        raise ParameterError("--out", str(out), wanted)
    found = chirp.identify_side(arm, log, options["current"], options["columns"], options["torque"])
    drives = found.add_to(arm.drives)
    folder = files.make_folder(out)
    drives.write(folder / "drives.yaml")
    verdict = chirp.judge_side(found, arm.joint_names, allow_part)
    if as_json:
        say(json.dumps({**chirp.plain(found, arm.joint_names), "verdict": verdict.plain()}))
    else:
        say(verdict.line)
        say(chirp.describe(found, arm), lines=True)
        next_run = f"armgpi run {shlex.quote(name)} --drives {shlex.quote(str(folder / 'drives.yaml'))}"
        say(f"Next: {next_run}, or armgpi export with that option")
    _say_written([folder / "drives.yaml"], out)
    return verdict.exit_code


def _with_load(
    logs: list[Path], arm: Robot, load: Path | None, mass: float | None, options: dict[str, Any]
) -> tuple[Identified, Load | None]:
    """Return the identified arm and its load; torque constants are scaled by the mass where it is known.

    Raises:
        ParameterError: for a mass without a log of the load or without torque constants, or none.
    """
    from armgpi.base.arrays import check_number, quantity
    from armgpi.identification.arm import identify as identified

    if mass is not None:
        mass = check_number(mass, "--load-mass", "positive [kg]", 0.0, open_=True)
        if load is None or options["current"] is None:
            raise ParameterError("--load-mass", mass, "--load LOG of it, and --current, as well")
    found, first = identified(logs, arm, **options), options["check_first"]
    if mass is None or load is None:
        return found, None if load is None else found.load(load, check_first=first)
    factor = mass / found.load(load, check_first=first).mass
    values = factor * quantity(options["current"], "--current", arm.joint_names)
    options["current"] = dict(zip(arm.joint_names, values.tolist(), strict=True))
    said = ",".join(f"{name}={x:.4g}" for name, x in options["current"].items())
    say(f"torque constants by the known load, {factor:.3g} times those specified: --current {said}", err=True)
    found = identified(logs, arm, **options)
    return found, found.load(load, check_first=first, scale_known=True)


def _say_written(paths: list[Path], folder: Path) -> None:
    """Say what was written."""
    say(f"wrote {', '.join(path.name for path in paths)} to {folder}", err=True)


def _names(text: str | None) -> dict[str, str]:
    """Return what columns are called."""
    pairs = [each.partition("=") for each in (text or "").split(",") if each]
    wanted = ("time", "q", "tau")
    if any(key.strip() not in wanted or not name.strip() for key, _, name in pairs):
        raise ParameterError(
            "--columns", text, "time, q and tau with names, such as 'time=t,q=pos_JOINT,tau=i_NUMBER'"
        )
    return {key.strip(): name.strip() for key, _, name in pairs}


def _corners(text: str | None) -> list[list[float]] | None:
    """Return the corners of a box."""
    if text is None:
        return None
    try:
        numbers = [float(each) for each in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6:
        raise ParameterError("--box", text, "two corners in the base's frame [m]: x,y,z,x,y,z")
    return [numbers[:3], numbers[3:]]


@stoppable
@opt.add_options
def excite(
    robot: str,
    seconds: float | None = None,
    share: float | None = None,
    first: bool = False,
    resonance: bool = False,
    side: bool = False,
    floor: float | None = None,
    no_floor: bool = False,
    box: str | None = None,
    margin: float | None = None,
    no_collisions: bool = False,
    seed: int = 0,
    drives: Path | None = None,
    out: Path = Path("excite"),
    *,
    how: opt.Loading,
) -> None:
    """Write a motion from which an arm can be identified, and the experiment that runs it.

    \b
    armgpi excite my_arm.urdf --first
    armgpi run excite/experiment.yaml
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.identification.excitation import surroundings
    from armgpi.identification.writing import experiment_files
    from armgpi.robot.rotors import without_rotors

    arm = load_arm(robot, opt.Arm(**vars(how), drives=drives))
    given = {**_section(robot), **opt.drives_given(None, drives)}
    rotorless = given.get("drives") == "none"
    if rotorless:
        arm = without_rotors(arm)
    around = (_floor(floor, no_floor), _corners(box), margin, not no_collisions)
    clear = surroundings(arm, *around, how.package_dir or ())
    section = {**given, **opt.robot_given(how)}
    motion = _motion(arm, first, resonance, side, (seconds, share, seed), clear)
    folder = files.make_folder(out)
    source = robot
    if is_experiment(robot):
        source, section["lock"] = str(arm.provenance["source"]), arm.provenance["locked"]
    if not rotorless:
        note_published(arm)
    experiment = experiment_files(arm, source, motion, section, first=first or side)
    written = files.write_set(folder, experiment)
    rotors = "up to four times the assumed rotor inertia"
    if side or resonance:
        rotors = "the assumed rotor inertia"
    if rotorless:
        rotors = "no rotor inertia but what the file contains"
    _say_motion(arm, motion, rotors)
    if side:
        # The experiment has the arm with its locked joints and drives.
        arm_again = shlex.quote(str(out / "experiment.yaml"))
        say(f"Then: armgpi identify --side LOG --robot {arm_again}; the log has to have every sample")
    if first or resonance:
        say(
            "If the arm oscillates, its joints are less stiff than assumed: use --set "
            "controller.omega=5, then 3."
        )
    _say_written(written, out)


def _section(robot: str) -> dict[str, Any]:
    """Return what the section `robot` of an experiment file says of its arm; nothing of a robot's name."""
    if not is_experiment(robot):
        return {}
    from armgpi import config

    section: dict[str, Any] = config.read(Path(robot)).config.robot.plain(given=True)
    return {key: value for key, value in section.items() if key not in ("name", "lock", "keep", "posterior")}


def _say_motion(arm: Robot, motion: Excitation, rotors: str) -> None:
    """Say how much of the limits a motion takes, and what it was compared with.

    Args:
        arm: that moves.
        motion: of it.
        rotors: for which rotor inertia it was planned.
    """
    shares = {
        "largest speed in percent of its limit": motion.share,
        f"largest torque in percent of its limit, for {rotors}": motion.effort,
    }
    for what, of_joints in shares.items():
        said = (f"{name} {100 * x:.2g}" for name, x in zip(arm.joint_names, of_joints, strict=True))
        say(f"{what}: {', '.join(said)}")
    say(motion.clearance.describe(), lines=True)


def _motion(
    arm: Robot,
    first: bool,
    resonance: bool,
    side: bool,
    asked: tuple[float | None, float | None, int],
    clear: Clearance,
) -> Excitation:
    """Return the motion that was asked for: its duration, its share of the limits, its seed.

    Raises:
        ParameterError: when more than one kind was asked for, for a duration of a motion that has its own, or
            when no motion is free of collisions.
    """
    from armgpi.identification.chirp import SHARE, chirp
    from armgpi.identification.excitation import FIRST_SHARE
    from armgpi.identification.excitation import excite as excited
    from armgpi.identification.resonance import SHAKEN, shake

    if sum((first, resonance, side)) > 1:
        raise ParameterError("--first, --resonance, --side", "several", "one of them")
    seconds, share, seed = asked
    if seconds is not None and (resonance or side):
        option = "--side" if side else "--resonance"
        wanted = f"left out with {option}, whose motion takes a fixed time for each joint"
        raise ParameterError("--seconds", seconds, wanted)
    usual = SHAKEN if resonance else SHARE if side else FIRST_SHARE if first else 0.7
    given = usual if share is None else share
    if resonance:
        return shake(arm, given, seed, clear)
    if side:
        return chirp(arm, given, clear, seed)
    return excited(arm, _SECONDS if seconds is None else seconds, given, seed, clearance=clear)


def _floor(floor: float | None, no_floor: bool) -> float | Literal["usual"] | None:
    """Return the height of the floor, "usual" where nothing was specified, None for none.

    Raises:
        ParameterError: when both were specified.
    """
    if no_floor and floor is not None:
        raise ParameterError("--no-floor", f"with --floor {floor:g}", "one of the two")
    return None if no_floor else "usual" if floor is None else floor
