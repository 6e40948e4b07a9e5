"""The command line: parse, call one function, print a table, exit with a code.

Exit codes: 0 fine, 1 a rollout diverged, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

# What takes long to import is imported by the commands, so that --help answers at once.
if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from armgpi.config import Experiment, Loaded

app = typer.Typer(
    help="Torque control of any robot arm from its URDF and measured positions alone.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: it may speak of units in [brackets]
)

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

#: Figures of a table: name in the records, heading.
_Columns = tuple[tuple[str, str], ...]
#: Length to which names of joints and controllers may be folded in tables.
_FOLDED = 10
_FLAG = ""
RobotName = Annotated[
    str | None,
    typer.Argument(
        metavar="ROBOT",
        help="Name of a robot (see `armgpi robots`) or path of a URDF file.",
        show_default=False,
    ),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", "-c", metavar="FILE", help="Experiment file (YAML); options override it."),
]
Controller = Annotated[
    str | None, typer.Option(metavar="NAME", help="gpi (default) or pid; or a label of the experiment file.")
]
Controllers = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Which ones, 'gpi,pid' by default; or types and labels of the experiment file.",
    ),
]
To = Annotated[
    str | None,
    typer.Option(
        metavar="POSTURE",
        help="Goal [rad or m]: 'j1=0.8,j2=-0.4', the others stay; or all joints '0.8,-0.4'.",
    ),
]
Start = Annotated[
    str | None,
    typer.Option(
        "--from", metavar="POSTURE", help="Start, given as --to; the middle of the joint ranges by default."
    ),
]
Duration = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Time of each move [s]; gentle by default.")
]
Omega = Annotated[
    str | None,
    typer.Option(
        metavar="NUMBERS",
        help="Bandwidth omega_c [rad/s] of gpi: '20' or 'j1=20,...'; from the sample time by default.",
    ),
]
Lock = Annotated[
    list[str] | None,
    typer.Option(metavar="JOINT", help="Joint to hold fixed, 'name' or 'name=value'; may be repeated."),
]
Keep = Annotated[
    list[str] | None,
    typer.Option(metavar="JOINT", help="Joint to keep, all others are locked; may be repeated."),
]
Effort = Annotated[
    str | None,
    typer.Option(metavar="NUMBERS", help="Torque limits [N m or N]: 'j1=10,j2=5', or one number for all."),
]
InertiaScale = Annotated[
    float | None,
    typer.Option(
        metavar="FACTOR", help="The controllers believe in D(q) times this; the plant stays as it is."
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
        metavar=_FLAG,
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
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", metavar="FOLDER", help="Where to put rollout.nc, experiment.yaml and metrics.json."
    ),
]
Json = Annotated[bool, typer.Option("--json", metavar=_FLAG, help="Print JSON instead of tables.")]


def _show_version(wanted: bool) -> None:
    """Print the version and exit."""
    if wanted:
        from armgpi import __version__

        typer.echo(f"armgpi {__version__}")
        raise typer.Exit()


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            metavar=_FLAG,
            callback=_show_version,
            is_eager=True,
            help="Show the version and exit.",
        ),
    ] = False,
) -> None:
    """Take the options of armgpi itself."""


@app.command()
def run(
    robot: RobotName = None,
    controller: Controller = None,
    config: ConfigFile = None,
    to: To = None,
    start: Start = None,
    duration: Duration = None,
    omega: Omega = None,
    lock: Lock = None,
    keep: Keep = None,
    effort: Effort = None,
    inertia_scale: InertiaScale = None,
    payload: Payload = None,
    encoder_bits: Bits = None,
    delay: Delay = None,
    friction: Friction = None,
    dt: SampleTime = None,
    t_final: TFinal = None,
    seed: Seed = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Simulate one controller on a robot and print how well it tracked.

    \b
    armgpi run ur5 --payload 0.5 --encoder-bits 16
    armgpi run anthropomorphic3 --to q1=0.8,q2=0.4 --t-final 8 --out results
    """  # noqa: D301 (\b keeps the lines apart)
    options = dict(locals())
    options["controllers"] = options.pop("controller")
    _experiment(options, compare=False)


@app.command()
def compare(
    robot: RobotName = None,
    controllers: Controllers = None,
    config: ConfigFile = None,
    to: To = None,
    start: Start = None,
    duration: Duration = None,
    omega: Omega = None,
    lock: Lock = None,
    keep: Keep = None,
    effort: Effort = None,
    inertia_scale: InertiaScale = None,
    payload: Payload = None,
    encoder_bits: Bits = None,
    delay: Delay = None,
    friction: Friction = None,
    dt: SampleTime = None,
    t_final: TFinal = None,
    seed: Seed = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Simulate several controllers on the same robot and print one table.

    \b
    armgpi compare ur5 --controllers gpi,pid --inertia-scale 0.8
    armgpi compare --config experiment.yaml --out results
    """  # noqa: D301 (\b keeps the lines apart)
    _experiment(dict(locals()), compare=True)


@app.command()
def robots() -> None:
    """List the robots that can be loaded by name."""
    from armgpi.robots import EXAMPLE_ROBOT_DATA, names

    found = names()
    for name in found:
        typer.echo(name)
    if not set(EXAMPLE_ROBOT_DATA) & set(found):
        typer.echo("more come with: pip install 'armgpi[robots]'", err=True)


def main() -> None:
    """Run the command line; every error of ours becomes one line and an exit code."""
    from armgpi.errors import ArmgpiError, ArmgpiWarning

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        text = f"warning: {message}" if issubclass(category, ArmgpiWarning) else str(message)
        typer.secho(text, err=True, fg="yellow")

    if sys.stdout is None:  # closed by whoever called
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        # A terminal that has no "²" shows "?" instead.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    with warnings.catch_warnings():
        warnings.showwarning = show
        warnings.simplefilter("default", ArmgpiWarning)
        try:
            app()
        except ArmgpiError as error:
            typer.secho(f"error: {error}", err=True, fg="red")
            sys.exit(BAD_INPUT)
        except OSError as error:  # the output: files have errors of their own
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (so that nothing is flushed at the end)
            typer.secho(f"error: cannot write the output: {error.strerror or error}", err=True, fg="red")
            sys.exit(BAD_INPUT)
        except KeyboardInterrupt:
            typer.secho("interrupted", err=True, fg="yellow")
            sys.exit(INTERRUPTED)


def _experiment(options: dict[str, Any], compare: bool) -> None:
    """Run what the options describe, print it, save it, and exit."""
    try:
        sys.exit(_run(options, compare))
    except KeyboardInterrupt:  # before or after the simulation, which keeps what is there itself
        typer.secho("interrupted", err=True, fg="yellow")
        sys.exit(INTERRUPTED)


def _run(options: dict[str, Any], compare: bool) -> int:
    """Run what the options describe, print it, save it, and return the exit code."""
    from armgpi import config as configuration
    from armgpi import experiment as experiments
    from armgpi.rollout import Status

    experiment = configuration.build(*_settings(options, compare))
    _check_out(options)
    _note_early_end(experiment)
    if compare:
        result = experiments.compare(experiment)
    else:
        label = next(iter(experiment.controllers))
        result = experiments.join({label: experiments.run(experiment, label)})
    records = experiments.records(result)
    paths: list[Path] = []
    try:  # first the files, then the table: whoever reads it may go away, as in `armgpi run ... | head`
        if options["out"] is not None:
            paths = experiments.save(result, experiment, options["out"])
    finally:
        if options["as_json"]:
            typer.echo(json.dumps(records))
        else:
            _print_tables(experiment, records)
    for path in paths:
        typer.echo(f"wrote {path}", err=True)
    code = {Status.FINISHED: OK, Status.DIVERGED: FAILED, Status.INTERRUPTED: INTERRUPTED}
    return code[experiments.worst(records)]


def _settings(options: dict[str, Any], compare: bool) -> Loaded:
    """Return the configuration of a file and the options that override it."""
    from armgpi import config as configuration
    from armgpi.config import Loaded, Origin

    data: dict[str, Any] = {}
    origin = Origin("command line")
    if options["config"] is not None:
        config, origin = configuration.read(options["config"])
        data = config.model_dump(exclude_unset=True)
    sources: dict[str, str] = {}  # dotted key -> the option that set it

    def override(option: str, value: Any, *path: str | int) -> None:
        """Put an option's value into the data and remember whose it is."""
        section: Any = data
        for step in path[:-1]:
            section = section[step] if isinstance(step, int) else section.setdefault(step, {})
        section[path[-1]] = value
        sources[".".join(map(str, path))] = option

    def given(name: str) -> bool:
        return options[name] not in (None, [])

    if given("robot"):
        data["robot"] = {}
        override("ROBOT", options["robot"], "robot", "name")
    if "robot" not in data:
        raise _refusal("", "name a robot, or give an experiment file with --config")
    if given("lock"):
        override("--lock", _locks(options["lock"]), "robot", "lock")
    if given("keep"):
        override("--keep", _split(options["keep"]), "robot", "keep")
    if given("effort"):
        override("--effort", _per_joint(options["effort"], "--effort"), "robot", "effort")
    if given("payload"):
        override("--payload", options["payload"], "plant", "payload", "mass")
    if given("friction"):
        override("--friction", "urdf" if options["friction"] else "none", "plant", "friction")
    for name in ("encoder_bits", "delay"):
        if given(name):
            override(f"--{name.replace('_', '-')}", options[name], "plant", name)
    for name, key in (("dt", "sample_time"), ("t_final", "t_final"), ("seed", "seed")):
        if given(name):
            override(f"--{name.replace('_', '-')}", options[name], key)
    origin = _choose_controllers(options, compare, data, origin, sources)
    for index, section in enumerate(data["controllers"]):
        if given("omega") and section["type"] == "gpi":
            override("--omega", _per_joint(options["omega"], "--omega"), "controllers", index, "omega")
        if given("inertia_scale"):
            override("--inertia-scale", options["inertia_scale"], "controllers", index, "inertia_scale")
    if given("omega") and "--omega" not in sources.values():
        raise _refusal("--omega", "is for gpi, which is not among the controllers")
    if given("to"):
        begin = _per_joint(options["start"], "--from") if given("start") else {}
        data["reference"] = {"points": [begin, {}], "holds": [1.0, 0.0]}
        override("--from", begin, "reference", "points", 0)
        override("--to", _per_joint(options["to"], "--to"), "reference", "points", 1)
    elif given("start"):
        raise _refusal("--from", "goes with --to")
    if given("duration"):
        override("--duration", options["duration"], "reference", "durations")
    # The longest keys first: of "controllers.0.omega" and "controllers.0", the first says more.
    origin = origin._replace(options=dict(sorted(sources.items(), key=lambda item: -len(item[0]))))
    return Loaded(configuration.check(data, origin), origin)


def _choose_controllers(
    options: dict[str, Any],
    compare: bool,
    data: dict[str, Any],
    origin: Any,
    sources: dict[str, str],
) -> Any:
    """Leave in `data` the controllers asked for, and return an origin that still knows their lines."""
    listed = data.get("controllers", [])
    option = "--controllers" if compare else "--controller"
    wanted = options["controllers"]
    if wanted is None:
        standard = [{"type": "gpi"}, {"type": "pid"}]
        data["controllers"] = (listed or standard) if compare else (listed or standard)[:1]
        return origin
    names = [name.strip() for name in wanted.split(",")]
    if not compare and len(names) > 1:
        raise _refusal(option, f"armgpi run takes one; use armgpi compare for {wanted!r}")
    chosen: list[dict[str, Any]] = []
    lines = {path: line for path, line in origin.lines.items() if path[0] != "controllers"}
    for name in names:
        # By label, by type, and as a new one, in this order.
        numbers = [i for i, section in enumerate(listed) if section.get("label") == name]
        numbers = numbers or [i for i, section in enumerate(listed) if section["type"] == name]
        for number in numbers if compare else numbers[:1]:
            for path, line in origin.lines.items():
                if path[:2] == ("controllers", number):
                    lines[("controllers", len(chosen), *path[2:])] = line
            chosen.append(listed[number])
        if not numbers:
            sources[f"controllers.{len(chosen)}"] = option
            chosen.append({"type": name})
    data["controllers"] = chosen
    return origin._replace(lines=lines)


def _refusal(option: str, message: str) -> Exception:
    """Return the error for options that cannot be used."""
    from armgpi.errors import ConfigError

    return ConfigError("command line", option, message)


def _split(items: list[str]) -> list[str]:
    """Return the parts of texts with commas in them."""
    return [part.strip() for item in items for part in item.split(",") if part.strip()]


def _per_joint(text: str, option: str) -> Any:
    """Read 'j1=1,j2=2', '1,2,3' or '1'."""
    parts = _split([text])
    try:
        if parts and all("=" in part for part in parts):
            pairs = [part.split("=", 1) for part in parts]
            joints = [name.strip() for name, _ in pairs]
            for joint in joints:
                if joints.count(joint) > 1:
                    raise _refusal(option, f"joint {joint!r} stands twice")
            return {joint: float(value) for joint, (_, value) in zip(joints, pairs, strict=True)}
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not numbers:
        expected = "numbers such as 'j1=0.8,j2=-0.4' or '0.8,-0.4'"
        raise _refusal(option, f"expected {expected}, got {text!r}")
    return numbers[0] if len(numbers) == 1 else numbers


def _locks(items: list[str]) -> dict[str, float | None]:
    """Read joint names, some with a value to lock at."""
    locks: dict[str, float | None] = {}
    for part in _split(items):
        name, equals, value = (x.strip() for x in part.partition("="))
        try:
            locks[name] = float(value) if equals else None
        except ValueError:
            raise _refusal("--lock", f"expected 'name' or 'name=value', got {part!r}") from None
    return locks


def _check_out(options: dict[str, Any]) -> None:
    """Refuse a folder for results that cannot be used: better before a long run than after it."""
    from armgpi import experiment as experiments

    folder, config = options["out"], options["config"]
    if folder is None:
        return
    if config is not None and (folder / "experiment.yaml").resolve() == config.resolve():
        raise _refusal("--out", f"would overwrite {config}; choose another folder")
    experiments.prepare(folder)


def _note_early_end(experiment: Experiment) -> None:
    """Say when the run is over before the last move is."""
    moves = experiment.reference.moves
    end = moves[-1].t_start + moves[-1].duration if moves else 0.0
    if experiment.t_final < end - experiment.config.sample_time:
        typer.echo(f"note: the run ends at {experiment.t_final:g} s, the last move at {end:g} s", err=True)


def _print_tables(experiment: Experiment, records: list[dict[str, Any]]) -> None:
    """Print a table of figures per controller and joint, and a line on how each rollout ended."""
    from rich.console import Console

    errors: _Columns = (
        ("itae", "ITAE\nrad s²"),
        ("peak_error", "peak error\nrad"),
        ("final_error", "final error\nrad"),
    )
    torques: _Columns = (
        ("isci", "ISCI\n(N m)² s"),
        ("total_variation", "variation\nN m"),
        ("peak_torque", "peak\nN m"),
        ("saturated_time", "saturated\ns"),
    )
    seen = {"Measurement": "positions only", "FullState": "positions and velocities"}
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120
    console = Console(width=width, markup=False, emoji=False, highlight=False)
    title = f"{experiment.robot.name}, {experiment.t_final:.4g} s"
    if len(records) == 1:
        title = f"{records[0]['label']} on {title}"
    tables = [(title, errors + torques)]
    if _width(console, _table(title, records, errors + torques)) > console.width:
        tables = [(f"{title}: errors", errors), (f"{title}: torques", torques)]
    for heading, columns in tables:
        # Long names are folded; a terminal too narrow even so gets whole numbers all the same.
        folded = _table(heading, records, columns, longest=_FOLDED)
        console.width = max(console.width, _width(console, folded))
        console.print(_table(heading, records, columns))
    for record in records:
        excess = max((x or 0.0 for x in record["metrics"]["limit_excess"]), default=0.0)
        note = f"; left its joint limits by up to {excess:.3g}" if excess > 0.0 else ""
        console.print(f"{record['label']}: {record['end']}; sees {seen[record['sees']]}{note}")


def _table(
    title: str,
    records: list[dict[str, Any]],
    columns: _Columns,
    longest: int | None = None,
) -> Table:
    """Return a table of some figures, its names folded to a length."""
    from rich.table import Table

    table = Table(title=title, title_style="bold")
    labels = [record["label"] for record in records]
    joints = [joint for record in records for joint in record["joints"]]
    names_of = {"controller": labels, "joint": joints}
    if len(records) == 1:  # the title says which
        del names_of["controller"]
    for heading, names in names_of.items():
        least = min(_FOLDED, max(map(len, (heading, *names))))
        table.add_column(heading, overflow="fold", min_width=least, max_width=longest)
    for _, heading in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for record in records:
        for index, joint in enumerate(record["joints"]):
            names = [record["label"] if index == 0 else "", joint][-len(names_of) :]
            values = [_short(record["metrics"][name][index]) for name, _ in columns]
            table.add_row(*names, *values, end_section=index == len(record["joints"]) - 1)
    return table


def _width(console: Console, table: Table) -> int:
    """Return how wide a table is where there is room enough."""
    from rich.measure import Measurement

    return Measurement.get(console, console.options.update(max_width=10_000), table).maximum


def _short(value: float | None) -> str:
    """Return a number with four significant digits, rounding errors as 0; a dash when there is none."""
    if value is None:
        return "-"
    return f"{value:.4g}" if abs(value) > 1e-12 else "0"


if __name__ == "__main__":
    main()
