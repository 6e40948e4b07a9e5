"""The command line: parse, call one function, print a table, exit with a code.

Exit codes: 0 fine, 1 a rollout diverged, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

# What takes long to import is imported by the commands, so that --help answers at once.
if TYPE_CHECKING:
    from armgpi.config import Experiment, ExperimentConfig

app = typer.Typer(
    help="Torque control of any robot arm from its URDF and measured positions alone.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

RobotName = Annotated[
    str | None, typer.Argument(help="Name of a robot (see `armgpi robots`) or path of a URDF file.")
]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", "-c", help="Experiment file (YAML); options override it.")
]
Lock = Annotated[
    list[str] | None, typer.Option(help="Joint to hold fixed, 'name' or 'name=value'; may be repeated.")
]
Keep = Annotated[list[str] | None, typer.Option(help="Joint to keep, all others are locked; repeatable.")]
Effort = Annotated[str | None, typer.Option(help="Torque limits [N m]: 'j1=10,j2=5' or one number.")]
To = Annotated[str | None, typer.Option(help="Goal [rad or m]: 'j1=0.8,j2=-0.4', or all joints '0.8,-0.4'.")]
Start = Annotated[
    str | None, typer.Option("--from", help="Start, as --to; the middle of the joint ranges by default.")
]
Duration = Annotated[float | None, typer.Option(help="Time of the move [s]; gentle by default.")]
Omega = Annotated[str | None, typer.Option(help="Bandwidth omega_c [rad/s] of GPI: '20' or 'j1=20,...'.")]
InertiaScale = Annotated[
    float | None, typer.Option(help="The controllers believe in D(q) times this; the plant is as it is.")
]
Payload = Annotated[
    float | None, typer.Option(help="Mass at the tip [kg] that the controllers do not know of.")
]
Bits = Annotated[int | None, typer.Option("--encoder-bits", help="Encoder resolution; exact by default.")]
Delay = Annotated[int | None, typer.Option(help="Samples by which measurements are late.")]
Friction = Annotated[bool, typer.Option("--friction", help="Add the URDF's joint friction to the plant.")]
SampleTime = Annotated[float | None, typer.Option("--dt", help="Sample time [s]; 0.001 by default.")]
TFinal = Annotated[float | None, typer.Option("--t-final", help="How long to run [s].")]
Seed = Annotated[int | None, typer.Option(help="Seed of noise and drop-outs.")]
Out = Annotated[Path | None, typer.Option("--out", "-o", help="Folder for rollout.nc and the configuration.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


@app.command()
def run(
    robot: RobotName = None,
    controller: Annotated[str | None, typer.Option(help="gpi or pid.")] = None,
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
    friction: Friction = False,
    dt: SampleTime = None,
    t_final: TFinal = None,
    seed: Seed = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Simulate one controller on a robot and print how well it tracked."""
    options = dict(locals())
    options["controllers"] = options.pop("controller")
    _experiment(options, compare=False)


@app.command()
def compare(
    robot: RobotName = None,
    controllers: Annotated[str | None, typer.Option(help="Which ones: 'gpi,pid'.")] = None,
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
    friction: Friction = False,
    dt: SampleTime = None,
    t_final: TFinal = None,
    seed: Seed = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Simulate several controllers on the same robot, loads and sensors, and print one table."""
    _experiment(dict(locals()), compare=True)


@app.command()
def robots() -> None:
    """List the robots that can be loaded by name."""
    from armgpi.robots import names

    for name in names():
        typer.echo(name)


def main() -> None:
    """Run the command line; every error of ours becomes one line and an exit code."""
    from armgpi.errors import ArmgpiError, ArmgpiWarning

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        text = f"warning: {message}" if issubclass(category, ArmgpiWarning) else str(message)
        typer.secho(text, err=True, fg="yellow")

    with warnings.catch_warnings():
        warnings.showwarning = show
        warnings.simplefilter("default", ArmgpiWarning)
        try:
            app()
        except ArmgpiError as error:
            typer.secho(f"error: {error}", err=True, fg="red")
            sys.exit(BAD_INPUT)
        except KeyboardInterrupt:
            typer.secho("interrupted", err=True, fg="yellow")
            sys.exit(INTERRUPTED)


def _experiment(options: dict[str, Any], compare: bool) -> None:
    """Run what the options describe, print it, save it, and exit."""
    from armgpi import config as configuration
    from armgpi import experiment as experiments
    from armgpi.rollout import Status

    settings = _settings(options)
    source = str(options["config"] or "command line")
    experiment = configuration.build(settings, source)
    if compare:
        result = experiments.compare(experiment)
    else:
        label = next(iter(experiment.controllers))
        result = experiments.join({label: experiments.run(experiment, label)})
    records = experiments.records(result)
    if options["as_json"]:
        typer.echo(json.dumps(records))
    else:
        _print_tables(experiment, records)
    if options["out"] is not None:
        for path in experiments.save(result, experiment, options["out"]):
            typer.echo(f"wrote {path}", err=True)
    code = {Status.FINISHED: OK, Status.DIVERGED: FAILED, Status.INTERRUPTED: INTERRUPTED}
    sys.exit(code[experiments.worst(records)])


def _settings(options: dict[str, Any]) -> ExperimentConfig:
    """Return the configuration of a file and the options that override it."""
    from armgpi import config as configuration
    from armgpi.errors import ConfigError

    source = "command line"
    data: dict[str, Any] = {}
    if options["config"] is not None:
        data = configuration.read(options["config"]).model_dump(exclude_unset=True)
    if options["robot"] is not None:
        data["robot"] = {"name": options["robot"]}
    if "robot" not in data:
        raise ConfigError(source, "", "name a robot, or give an experiment file with --config")
    robot = data["robot"]
    if options["lock"]:
        robot["lock"] = _locks(options["lock"])
    for name in ("keep", "effort"):
        if options[name]:
            robot[name] = _per_joint(options[name], name) if name == "effort" else options[name]
    plant = data.setdefault("plant", {})
    if options["payload"] is not None:
        plant["payload"] = {"mass": options["payload"]}
    if options["friction"]:
        plant["friction"] = "urdf"
    for name in ("encoder_bits", "delay"):
        if options[name] is not None:
            plant[name] = options[name]
    for name, key in (("dt", "sample_time"), ("t_final", "t_final"), ("seed", "seed")):
        if options[name] is not None:
            data[key] = options[name]
    if options["controllers"] is not None:
        data["controllers"] = [{"type": name.strip()} for name in options["controllers"].split(",")]
    for section in data.setdefault("controllers", [{"type": "gpi"}]):
        if options["omega"] is not None and section["type"] == "gpi":
            section["omega"] = _per_joint(options["omega"], "omega")
        if options["inertia_scale"] is not None:
            section["inertia_scale"] = options["inertia_scale"]
    if options["to"] is not None:
        begin = _per_joint(options["start"], "from") if options["start"] is not None else {}
        data["reference"] = {"points": [begin, _per_joint(options["to"], "to")], "holds": [1.0, 0.0]}
        if options["duration"] is not None:
            data["reference"]["durations"] = options["duration"]
    elif options["start"] is not None or options["duration"] is not None:
        raise ConfigError(source, "", "--from and --duration go with --to")
    return configuration.check(data, source)


def _per_joint(text: str, option: str) -> Any:
    """Read 'j1=1,j2=2', '1,2,3' or '1'."""
    from armgpi.errors import ConfigError

    parts = [part.strip() for part in text.split(",") if part.strip()]
    try:
        if parts and all("=" in part for part in parts):
            pairs = [part.split("=", 1) for part in parts]
            return {name.strip(): float(value) for name, value in pairs}
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not numbers:
        expected = "numbers such as 'j1=0.8,j2=-0.4' or '0.8,-0.4'"
        raise ConfigError("command line", f"--{option}", f"expected {expected}, got {text!r}")
    return numbers[0] if len(numbers) == 1 else numbers


def _locks(items: list[str]) -> Any:
    """Read joint names, some with a value to lock at."""
    if not any("=" in item for item in items):
        return items
    locks: dict[str, float] = {}
    for item in items:
        locks.update(_per_joint(item if "=" in item else f"{item}=0", "lock"))
    return locks


def _print_tables(experiment: Experiment, records: list[dict[str, Any]]) -> None:
    """Print one table per controller, or one line where it failed."""
    from rich.console import Console
    from rich.table import Table

    columns = (
        ("itae", "ITAE\nrad s²"),
        ("peak_error", "peak error\nrad"),
        ("final_error", "final error\nrad"),
        ("isci", "ISCI\n(N m)² s"),
        ("total_variation", "variation\nN m"),
        ("peak_torque", "peak\nN m"),
        ("saturated_time", "saturated\ns"),
    )
    seen = {"Measurement": "positions only", "FullState": "positions and velocities"}
    console = Console(width=None if sys.stdout.isatty() else 120)
    table = Table(title=f"{experiment.robot.name}, {experiment.t_final:g} s", title_style="bold")
    table.add_column("controller", overflow="fold")
    table.add_column("joint", overflow="fold")
    for _, heading in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for record in records:
        for index, joint in enumerate(record["joints"]):
            label = record["label"] if index == 0 else ""
            values = [_short(record["metrics"][name][index]) for name, _ in columns]
            table.add_row(label, joint, *values, end_section=index == len(record["joints"]) - 1)
    console.print(table)
    for record in records:
        excess = max((x or 0.0 for x in record["metrics"]["limit_excess"]), default=0.0)
        note = f"; left its joint limits by up to {excess:.3g}" if excess > 0.0 else ""
        console.print(
            f"{record['label']}: {record['end']}; sees {seen[record['sees']]}{note}", highlight=False
        )


def _short(value: float | None) -> str:
    """Return a number with four significant digits; a dash when there is none."""
    return "-" if value is None else f"{value:.4g}"


if __name__ == "__main__":
    main()
