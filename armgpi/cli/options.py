"""The options that several commands share."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

#: Flags take no value: nothing is shown for one.
FLAG = ""


def robot_names(begun: str) -> list[str]:
    """Return the robots whose names begin so, for the completion of a shell."""
    from armgpi.robot.robots import names

    return [name for name in names() if name.startswith(begun)]


_ROBOT = typer.Argument(
    metavar="ROBOT",
    help="Name of a robot (see `armgpi robots`), or path of a URDF or an experiment file (YAML).",
    show_default=False,
    autocompletion=robot_names,
)
RobotName = Annotated[str | None, _ROBOT]
Arm = Annotated[str, _ROBOT]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config",
        "-c",
        metavar="FILE",
        help="Experiment file (YAML) or name of a scenario (see `armgpi scenarios`); options override it.",
    ),
]
Controller = Annotated[
    str | None,
    typer.Option(
        *("--controller", "--controllers"),
        metavar="NAME",
        help="{controllers}; or a label of the file. Default: gpi, or untuned with an encoder or delay.",
    ),
]
Controllers = Annotated[
    str | None,
    typer.Option(
        *("--controllers", "--controller"),
        metavar="NAMES",
        help="Which ones of {controllers}: 'gpi,pid' by default, 'untuned,pid' with an encoder or delay; or "
        "labels of the experiment file.",
    ),
]
To = Annotated[
    str | None,
    typer.Option(
        metavar="CONFIGURATION",
        help="Goal [rad or m]: 'j1=0.8,j2=-0.4', the others stay; or all joints '0.8,-0.4'.",
    ),
]
Start = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="CONFIGURATION",
        help="Start, given as --to; the middle of the joint ranges by default.",
    ),
]
PathName = Annotated[
    str | None,
    typer.Option(
        "--path",
        metavar="NAME",
        help="Instead of --to, a path of the tool in space: {paths}.",
    ),
]
Trajectory = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Instead of --to, a recorded trajectory: CSV (time and joints by name), NetCDF (a rollout) or "
        "MCAP (/joint_states).",
    ),
]
Direction = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z",
        help="Where the tip's z axis points to along a path: '0,0,-1' is down; free by default.",
    ),
]
Duration = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Time of each move [s]; gentle by default.")
]
Lock = Annotated[
    list[str] | None,
    typer.Option(metavar="JOINT", help="Joint to hold fixed, 'name' or 'name=value'; may be repeated."),
]
Keep = Annotated[
    list[str] | None,
    typer.Option(
        metavar="JOINT",
        help="Joint to keep, or chain of a whole robot; all others are locked; may be repeated.",
    ),
]
Mimic = Annotated[
    str | None,
    typer.Option(metavar="HOW", help="Joints that mimic another: 'lock' (default), or 'follow' it exactly."),
]
Repair = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Repair to make in the URDF, as its refusal names it, or 'all'; may be repeated.",
    ),
]


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


PackageDir = Annotated[
    list[Path] | None,
    typer.Option(
        "--package-dir",
        callback=_search_folders,
        metavar="FOLDER",
        help="Folder of a package, or of packages, in which meshes are looked for; may be repeated.",
    ),
]
Effort = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NUMBERS",
        help="Torque limits [N m or N]: 'j1=10,j2=5', or one number for all; may be repeated.",
    ),
]


def robot_given(how: dict[str, Any], rotor_inertia: list[str] | None, drives: Path | None) -> dict[str, Any]:
    """Return what options say of an arm, as keys of the section `robot`: how it is loaded, and its drives."""
    from armgpi.cli.parsing import locks, per_joint, split

    readers: dict[str, Any] = {"lock": locks, "keep": split, "repair": split}
    readers["effort"] = lambda texts: per_joint(",".join(texts), "--effort")
    given = {key: readers.get(key, str)(value) for key, value in how.items() if value}
    return given | drives_given(rotor_inertia, drives)


def drives_given(rotor_inertia: list[str] | None, path: Path | None) -> dict[str, Any]:
    """Return what --drives and --rotor-inertia give, as keys of the section `robot`; the latter wins."""
    from armgpi.cli.parsing import per_joint

    found: dict[str, Any] = {}
    if str(path) in ("believed", "soft", "rigid"):
        found["drives"] = str(path)
    elif path is not None:
        from armgpi.robot.drives import Drives

        found["drives"] = Drives.read(path).plain()
    if rotor_inertia:
        found["rotor_inertia"] = per_joint(",".join(rotor_inertia), "--rotor-inertia")
    return found


RotorInertia = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NUMBERS",
        help="Rotor inertia seen at the joints, gear ratio squared times rotor [kg m² or kg]: "
        "'j1=0.1,j2=0.05', or one number for all; may be repeated.",
    ),
]
Drives = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="YAML or JSON: joint -> rotor_inertia, viscous, coulomb, stiffness and others, where known. Or "
        "what is believed where nothing tells: 'soft', rotors and gears that twist, the default of type "
        "untuned; 'believed', rotors of stiff gears; 'rigid', no rotors.",
    ),
]
PlantEngine = Annotated[
    str | None,
    typer.Option(
        "--plant",
        metavar="NAME",
        help="Simulator: {plants} (armgpi by default; mujoco is a second one), or for compare both.",
    ),
]
InertiaScale = Annotated[
    float | None,
    typer.Option(
        metavar="FACTOR",
        help="The controllers' nominal models have D(q) times this; the plant stays as it is.",
    ),
]
Payload = Annotated[
    float | None, typer.Option(metavar="KG", help="Mass at the tip [kg] that the controllers do not know of.")
]
Bits = Annotated[
    int | None, typer.Option("--encoder-bits", metavar="BITS", help="Encoder resolution; exact by default.")
]
Delay = Annotated[int | None, typer.Option(metavar="SAMPLES", help="Samples by which measurements are late.")]
Friction = Annotated[
    bool | None,
    typer.Option(
        "--friction/--no-friction",
        metavar=FLAG,
        help="Whether the plant has the URDF's joint friction; not by default.",
        show_default=False,
    ),
]
SampleTime = Annotated[
    float | None, typer.Option("--dt", metavar="SECONDS", help="Sample time [s]; 0.001 by default.")
]
TFinal = Annotated[
    float | None,
    typer.Option(
        "--t-final", metavar="SECONDS", help="How long to run [s]; by default 2 s beyond the last hold."
    ),
]
Seed = Annotated[int | None, typer.Option(metavar="NUMBER", help="Seed of noise and drop-outs.")]
Gravity = Annotated[
    str | None,
    typer.Option(
        metavar="WHO",
        help="Who carries the arm's weight: 'arm' (default), the controller does, or 'robot', as libfranka "
        "and UR do: then plant and nominal models have no gravity.",
        show_default=False,
    ),
]
SupervisedFlag = Annotated[
    bool,
    typer.Option(
        "--supervised",
        metavar=FLAG,
        help="Put the controllers under a supervisor, which stops the arm when something is wrong; with the "
        "bounds of the experiment file, or the default ones.",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", metavar="FOLDER", help="Where to put rollout.nc, experiment.yaml and metrics.json."
    ),
]
Force = Annotated[
    bool,
    typer.Option("--force", metavar=FLAG, help="Write to --out even where it holds another experiment."),
]
Backend = Annotated[
    str,
    typer.Option(
        metavar="NAME", help="What computes: 'numpy', 'compiled' (generated C), or 'auto': the faster one."
    ),
]
AcceptCode = Annotated[
    bool,
    typer.Option("--accept-code", metavar=FLAG, help="Go on with what other code has begun; it is marked."),
]
Json = Annotated[bool, typer.Option("--json", metavar=FLAG, help="Print JSON instead of tables.")]

Table = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write the table of metrics: .csv, .md (Markdown) or .tex (LaTeX)."),
]

# Pictures of what was run.
Plot = Annotated[
    Path | None,
    typer.Option(
        "--plot", metavar="FILE", help="Draw position, error and torque of every joint: PNG, SVG, PDF."
    ),
]
View = Annotated[
    bool, typer.Option("--view", metavar=FLAG, help="Serve the animation to this machine until Ctrl-C.")
]


def page_file(parameter: typer.CallbackParam, path: Path | None) -> Path | None:
    """Return the file of a page, refusing the name of a picture or document."""
    from armgpi.cli.parsing import refusal

    if path is not None and path.suffix.lower() in (".pdf", ".png", ".svg", ".jpg"):
        name = max(parameter.opts, key=len)
        raise refusal(name, f"writes HTML, which browsers print as PDF: name it {path.with_suffix('.html')}")
    return path


Html = Annotated[
    Path | None,
    typer.Option(
        "--html", metavar="FILE", callback=page_file, help="Write the animation as one file for any browser."
    ),
]
Report = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="FILE",
        callback=page_file,
        help="Write what is found as one HTML file for any browser.",
    ),
]
Interactive = Annotated[
    bool,
    typer.Option(
        "--interactive",
        metavar=FLAG,
        help="Make --report a page to play with, as `armgpi play` does; of the first controller.",
    ),
]
Frame = Annotated[
    str | None, typer.Option(metavar="FRAME", help="The tool whose path is drawn; the tip by default.")
]
RobotOf = Annotated[
    str | None,
    typer.Option(
        "--robot", metavar="ROBOT", help="The arm of a rollout, where the one it was made with is gone."
    ),
]
Port = Annotated[
    int | None,
    typer.Option(metavar="PORT", help="Port of 127.0.0.1; the first free one from 7070 by default."),
]

_Command = TypeVar("_Command", bound=Callable[..., None])


Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Any key of an experiment file, such as plant.delay=2 or controller.omega=25; may be repeated.",
    ),
]


def experiment(
    config: ConfigFile = None,
    to: To = None,
    start: Start = None,
    path: PathName = None,
    trajectory: Trajectory = None,
    direction: Direction = None,
    duration: Duration = None,
    lock: Lock = None,
    keep: Keep = None,
    mimic: Mimic = None,
    repair: Repair = None,
    package_dir: PackageDir = None,
    effort: Effort = None,
    rotor_inertia: RotorInertia = None,
    drives: Drives = None,
    inertia_scale: InertiaScale = None,
    plant: PlantEngine = None,
    payload: Payload = None,
    friction: Friction = None,
    dt: SampleTime = None,
    t_final: TFinal = None,
    seed: Seed = None,
    supervised: SupervisedFlag = False,
    gravity: Gravity = None,
    settings: Settings = None,
) -> None:
    """List the options that describe an experiment, for :func:`add_options`."""


def results(
    backend: Backend = "auto",
    out: Out = None,
    force: Force = False,
    table: Table = None,
    plot: Plot = None,
    view: View = False,
    html: Html = None,
    report: Report = None,
    interactive: Interactive = False,
    as_json: Json = False,
) -> None:
    """List the options of what a run becomes, for :func:`add_options`."""


def printing(as_json: Json = False) -> None:
    """List the options of what is printed, for :func:`add_options`."""


def add_options(*lists: Callable[..., None]) -> Callable[[_Command], _Command]:
    """Put lists of options in the place of a command's ``**options``."""

    def decorate(command: _Command) -> _Command:
        own = list(inspect.signature(command, eval_str=True).parameters.values())[:-1]
        for function in lists:
            own += inspect.signature(function, eval_str=True).parameters.values()
        # What Typer reads.
        vars(command)["__signature__"] = inspect.Signature(
            [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own]
        )
        command.__annotations__ = {each.name: each.annotation for each in own}
        return command

    return decorate
