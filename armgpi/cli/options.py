"""The options that several commands share."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import typer

if TYPE_CHECKING:
    from armgpi.cli.declared import Option


def robot_names(begun: str) -> list[str]:
    """Return the robots whose names begin so, for the completion of a shell."""
    from armgpi.robot.robots import names

    return [name for name in names() if name.startswith(begun)]


#: Options of several commands: parameter, its flags where they are others than its name, what --help shows
#: for its value (in <> of an argument) -> what --help says. A command's module has such rows of its own.
ROWS = {
    "rotor_inertia NUMBERS": "Reflected rotor inertia (armature): rotor inertia times the gear ratio "
    "squared [kg m² or kg]: 'j1=0.1,j2=0.05', or one number for all; may be "
    "repeated.",
    "drives FILE": "YAML or JSON file with rotor_inertia, viscous, coulomb, stiffness and others for "
    "each joint, where known. Or what is assumed for joints without data: 'elastic' "
    "(rotors and elastic joints, the default of type gpi_auto), 'stiff' (rotors and stiff "
    "joints) or 'none' (no rotors).",
    "identified FILE": "identification.json of armgpi identify: the arm is assumed to be between 12 random "
    "arms of it, each moved to 2.5 times its distance from the estimate.",
    "report FILE": "Write the results as one HTML file for any browser.",
    "allow_part": (
        "Accept an incomplete verdict, which holds for part of what was asked: exit code 0 instead of 3."
    ),
    "as_json --json": "Print JSON instead of tables.",
    "robot <ROBOT>": "Name of a robot (see `armgpi robots`), or path of a URDF or an experiment file (YAML).",
    "dt SECONDS": "Sample time [s]; 0.001 by default.",
    "encoder_bits BITS": "Encoder resolution; exact by default.",
    "lock JOINT": "Joint to hold fixed, 'name' or 'name=value'; may be repeated.",
    "keep JOINT": ("Joint to keep, or arm of a whole robot; all other joints are locked; may be repeated."),
    "mimic HOW": "Joints that mimic another: 'lock' (default), or 'follow' it exactly.",
    "repair NAME": (
        "Repair to make in the URDF, by the name in the error message, or 'all'; may be repeated."
    ),
    "package_dir FOLDER": "Folder of a package, or of packages, in which meshes are searched; may be "
    "repeated.",
    "effort NUMBERS": "Torque limits [N m or N]: 'j1=10,j2=5', or one number for all; may be repeated.",
    "accept_code": ("Continue a study that another version of the code has begun; the results are marked."),
    "controller --controller --controllers NAME": "{controllers}; or a label of the file. Default: "
    "gpi_auto, or gpi for an ideal arm (--ideal).",
    "controllers --controllers --controller NAMES": "Which ones of {controllers}; or labels of the "
    "experiment file. Default: 'gpi_auto,pid_positions,pid', or 'gpi,pid' for an ideal arm (--ideal).",
    "delay SAMPLES": "Delay of the measurements [samples].",
    "out --out -o FOLDER": "Folder for rollout.nc, experiment.yaml and metrics.json.",
    "force": "Write to --out even where it holds another experiment.",
    "config --config -c FILE": "Experiment file (YAML) or name of a scenario (see `armgpi scenarios`); "
    "options override it.",
    "to CONFIGURATION": "Goal [rad or m]: 'j1=0.8,j2=-0.4', the others stay; or all joints '0.8,-0.4'.",
    "start --from CONFIGURATION": ("Start position, written like --to; by default that of the default move."),
    "path NAME": "Instead of --to, a path of the tool in space: {paths}.",
    "trajectory FILE": "Instead of --to, a recorded trajectory: CSV (time and joints by name), NetCDF (a "
    "rollout) or MCAP (/joint_states).",
    "direction X,Y,Z": ("Direction of the tip's z axis along a path: '0,0,-1' is down; free by default."),
    "duration SECONDS": "Duration of each move [s]; by default chosen for a slow motion.",
    "inertia_scale FACTOR": (
        "Multiply D(q) of the controllers' nominal models by this factor; the plant is not changed."
    ),
    "plant NAME": "Simulator: {plants} (armgpi by default), or for compare both.",
    "payload KG": "Mass at the tip [kg] that the controllers' model does not contain.",
    "friction WORD": "'urdf': the URDF's joint friction acts, default of realistic arms; or 'none'.",
    "ideal": "Rigid joints, no rotors, no friction, exact positions, and the controller as printed.",
    "t_final SECONDS": "Simulated time [s]; by default the motion and 2 s more.",
    "seed NUMBER": "Seed of noise and drop-outs.",
    "supervised": "Run the controllers under a supervisor, which stops the arm when it detects a fault; "
    "with the bounds of the experiment file, or the default ones.",
    "gravity WHO": "What compensates gravity: the controller of the arm ('arm', the default), or the "
    "robot itself ('robot'), as with libfranka and UR; then plant and nominal models have "
    "no gravity.",
    "settings --set KEY=VALUE": "Any key of an experiment file, such as plant.delay=2 or "
    "controller.omega=25; may be repeated.",
    "backend NAME": ("What computes the run: 'numpy', 'compiled' (generated C), or 'auto', the faster one."),
    "table FILE": "Write the table of metrics: .csv, .md (Markdown) or .tex (LaTeX).",
    "plot FILE": "Plot position, error and torque of every joint: PNG, SVG or PDF.",
    "view": "Serve the animation on this machine until Ctrl-C.",
    "html FILE": "Write the animation as one file for any browser.",
    "explain": "Print the values that are assumed for the drives, and why.",
    "interactive": ("Write --report as an interactive page, as `armgpi play` does, of the first controller."),
    "frame FRAME": "Frame whose path is drawn; the tip by default.",
    "port PORT": "Port of 127.0.0.1; the first free one from 7070 by default.",
}


def _search_folders(folders: list[Path] | None) -> list[Path] | None:
    """Have meshes looked for in folders, as in those of ROS_PACKAGE_PATH but before them."""
    from armgpi.cli.parsing import refusal

    for folder in folders or ():
        if not os.path.isdir(folder):
            raise refusal("--package-dir", f"there is no folder {str(folder)!r}")
    known = os.environ.get("ROS_PACKAGE_PATH")
    if folders:
        os.environ["ROS_PACKAGE_PATH"] = os.pathsep.join(
            [*map(os.path.abspath, folders), *filter(None, [known])]
        )
    return folders


def robot_given(how: Loading) -> dict[str, Any]:
    """Return what options say of an arm, as keys of the section `robot`: how it is loaded, and its drives."""
    from armgpi.cli.parsing import locks, per_joint, split

    section: dict[str, Any] = {}
    if how.lock:
        section["lock"] = locks(how.lock)
    if how.keep:
        section["keep"] = split(how.keep)
    if how.mimic is not None:
        section["mimic"] = how.mimic
    if how.repair:
        section["repair"] = split(how.repair)
    if isinstance(how, Arm):
        if how.effort:
            section["effort"] = per_joint(",".join(how.effort), "--effort")
        section |= drives_given(how.rotor_inertia, how.drives)
    return section


def drives_given(rotor_inertia: list[str] | None, path: Path | None) -> dict[str, Any]:
    """Return what --drives and --rotor-inertia give, as keys of the section `robot`; the latter wins."""
    from armgpi.base import renamed
    from armgpi.cli.parsing import per_joint, refusal

    found: dict[str, Any] = {}
    word = None if path is None else renamed.current_name(str(path), renamed.DRIVES)
    if word in ("elastic", "stiff", "none"):
        found["drives"] = word
    elif path is not None and not path.exists():
        raise refusal("--drives", f"expected 'elastic', 'stiff', 'none' or a file, got {str(path)!r}")
    elif path is not None:
        from armgpi.robot.drives import Drives

        found["drives"] = Drives.read(path).plain()
    if rotor_inertia:
        found["rotor_inertia"] = per_joint(",".join(rotor_inertia), "--rotor-inertia")
    return found


#: Endings of a page; a name without one may be a device or a pipe.
_PAGES = ("", ".html", ".htm")


def page_file(parameter: typer.CallbackParam, path: Path | None) -> Path | None:
    """Return the file of a page, refusing the name of a picture or document."""
    return _check_ending(parameter, path, ())


def _check_ending(parameter: typer.CallbackParam, path: Path | None, others: Sequence[str]) -> Path | None:
    """Return the file that an option writes, refusing a name that promises something else than a page.

    Args:
        parameter: the option.
        path: its value.
        others: endings of what the option writes besides pages.
    """
    from armgpi.cli.parsing import refusal

    if path is not None and path.suffix.lower() not in (*_PAGES, *others):
        name = max(parameter.opts, key=len)
        instead = f", or a name that ends in {' or '.join(others)}" if others else ""
        page = path.with_suffix(".html")
        raise refusal(name, f"writes HTML, which browsers print as PDF: name it {page}{instead}")
    return path


def page(text: str, others: Sequence[str] = ()) -> Any:
    """Return the option --out of a command that writes a page.

    Args:
        text: its help.
        others: endings of what it writes besides pages.
    """

    def check(parameter: typer.CallbackParam, value: Path | None) -> Path | None:
        return _check_ending(parameter, value, others)

    return typer.Option("--out", "-o", metavar="FILE", callback=check, help=text)


#: Flag -> what checks its value.
_CALLBACKS: dict[str, Any] = {"--html": page_file, "--report": page_file, "--package-dir": _search_folders}

_Command = TypeVar("_Command", bound=Callable[..., None])


@dataclass(frozen=True, kw_only=True)
class Loading:
    """The options of how a robot is loaded; what each means is in :data:`ROWS`."""

    lock: list[str] | None = None
    keep: list[str] | None = None
    mimic: str | None = None
    repair: list[str] | None = None
    package_dir: list[Path] | None = None


@dataclass(frozen=True, kw_only=True)
class Arm(Loading):
    """The same, and the options of what the joints of an arm have."""

    effort: list[str] | None = None
    rotor_inertia: list[str] | None = None
    drives: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Experiment(Arm):
    """The options that describe an experiment."""

    config: Path | None = None
    to: str | None = None
    start: str | None = None
    path: str | None = None
    trajectory: Path | None = None
    direction: str | None = None
    duration: float | None = None
    inertia_scale: float | None = None
    plant: str | None = None
    payload: float | None = None
    friction: str | None = None
    ideal: bool = False
    dt: float | None = None
    t_final: float | None = None
    seed: int | None = None
    supervised: bool = False
    gravity: str | None = None
    settings: list[str] | None = None


@dataclass(frozen=True, kw_only=True)
class Run(Experiment):
    """The options of an experiment, and of what its results become."""

    backend: str = "auto"
    out: Path | None = None
    force: bool = False
    table: Path | None = None
    plot: Path | None = None
    view: bool = False
    html: Path | None = None
    report: Path | None = None
    interactive: bool = False
    explain: bool = False
    as_json: bool = False


@dataclass(frozen=True, kw_only=True)
class SupervisorOptions:
    """The options of `armgpi export` that are keys of the section `supervisor`."""

    on_fault: str | None = None
    frozen: int | None = None
    jump: float | None = None
    torque_rate: str | None = None


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What was typed of an experiment.

    Attributes:
        robot: name of a robot, path of a URDF or of an experiment file; None with --config.
        controllers: names, separated by commas; None for the standard ones.
        declared: options of declared parameters that were typed, with their values.
        options: the others.
        supervisor: those of the supervisor.
    """

    robot: str | None
    controllers: str | None
    declared: Sequence[tuple[Option, Any]]
    options: Experiment
    supervisor: SupervisorOptions = SupervisorOptions()


def add_options(command: Callable[..., None]) -> Callable[..., None]:
    """Put options in the place of a command's last parameter, whose annotation is a class that lists them.

    The command gets an object of that class, made of what was typed.
    """
    *own, last = inspect.signature(command, eval_str=True).parameters.values()
    kind = last.annotation
    types = get_type_hints(kind)
    listed = [
        inspect.Parameter(
            each.name, inspect.Parameter.KEYWORD_ONLY, default=each.default, annotation=types[each.name]
        )
        for each in fields(kind)
    ]
    names = [each.name for each in listed]
    alone = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in own]

    @wraps(command)
    def with_object(**typed: Any) -> None:
        options = {name: typed.pop(name) for name in names}
        command(**typed, **{last.name: kind(**options)})

    _take(with_object, [*alone, *listed])
    return with_object


def with_rows(command: _Command, rows: Mapping[str, str]) -> _Command:
    """Give a command's arguments and options what rows say of them: its module's, else :data:`ROWS`.

    A row of one command alone of a module begins with that: "excite.resonance".
    """
    known: dict[str, tuple[list[str], str]] = {}
    for key, text in {**ROWS, **rows}.items():
        name, *shown = key.split()
        known[name] = shown, text
    found = []
    for each in inspect.signature(command, eval_str=True).parameters.values():
        shown, text = known.get(f"{command.__name__}.{each.name}") or known.get(each.name) or ([], "")
        if text and not hasattr(each.annotation, "__metadata__"):
            each = each.replace(annotation=Annotated[each.annotation, _declare(each.name, shown, text)])
        found.append(each)
    _take(command, found)
    return command


def _declare(name: str, shown: list[str], text: str) -> Any:
    """Return an argument or option as Typer has it."""
    flags = [word for word in shown if word.startswith("-")] or [f"--{name.replace('_', '-')}"]
    value = " ".join(word for word in shown if not word.startswith("-"))
    if value.startswith("<"):
        complete = robot_names if name == "robot" else None
        return typer.Argument(metavar=value[1:-1], help=text, show_default=False, autocompletion=complete)
    told = "default" in text  # what it is by default
    return typer.Option(
        *flags, metavar=value or None, help=text, show_default=not told, callback=_CALLBACKS.get(flags[0])
    )


def _take(command: Callable[..., None], parameters: list[inspect.Parameter]) -> None:
    """Give a command the parameters that Typer reads."""
    vars(command)["__signature__"] = inspect.Signature(parameters)
    command.__annotations__ = {each.name: each.annotation for each in parameters}
