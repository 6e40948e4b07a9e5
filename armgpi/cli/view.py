"""The commands that show robots and rollouts: view and report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from armgpi.base.files import check_set, read_bytes
from armgpi.cli import options as opt
from armgpi.cli.arms import names_of_options
from armgpi.cli.parsing import is_experiment, refusal, stoppable
from armgpi.cli.terminal import progress, say
from armgpi.cli.written import import_xarray
from armgpi.errors import ArmgpiError

if TYPE_CHECKING:
    import xarray as xr

    from armgpi.robot.robot import Robot

#: Endings of logs, as :mod:`armgpi.loop.logs` writes them.
LOGS = (".mcap", ".rrd")
#: Endings of films, as :mod:`armgpi.viewing.film` writes them.
FILMS = (".gif", ".mp4")
File = Annotated[
    Path | None,
    opt.page(
        "Write one file and serve nothing: a page for any browser, or of a rollout a film (.gif, .mp4).",
        FILMS,
    ),
]
Report = Annotated[
    Path,
    opt.page("The file to write: .html; or a log: .mcap (Foxglove, PlotJuggler) or .rrd (Rerun).", LOGS),
]
#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "targets <ROBOT...|FILE>": "Names of robots or paths of URDF files, shown side by side; or a rollout "
    "(.nc, or its folder).",
    "robot ROBOT": "The arm of a rollout, where the one it was made with is gone.",
    "browser --open": "Open it in a browser.",
    "files <FILE...>": "Rollouts (.nc), folders of --out, or logs (.armlog), of one robot.",
    "title TEXT": "Title; the robot's name by default.",
}


@stoppable
@opt.add_options
def view(
    targets: list[str],
    out: File = None,
    robot: str | None = None,
    frame: str | None = None,
    port: int | None = None,
    browser: bool = False,
    *,
    how: opt.Loading,
) -> None:
    """Show robots, or play a rollout, in MeshCat: at an address of this machine alone, or as a page or film.

    \b
    armgpi view panda
    armgpi view ur5 panda kinova
    armgpi view results/rollout.nc -o arm.html
    armgpi view results -o arm.mp4
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.cli import pictures
    from armgpi.viewing import meshcat

    pictures.check_packages("html", "view")
    targets = [_rollout_of_folder(target) for target in targets]
    if out is not None:
        pictures.check_file(out, "--out")
        if out.suffix.lower() in FILMS:
            say(f"wrote {_film(targets, out, how, robot, frame)}", err=True)
            return
    page = _page(targets, how, robot, frame)
    if out is not None:
        say(f"wrote {meshcat.write(page, out)}", err=True)
    else:
        pictures.serve(page, port, browser)


@stoppable
def report(
    files: list[Path],
    output: Report = Path("report.html"),
    title: str | None = None,
    robot: str | None = None,
    package_dir: list[Path] | None = None,
    frame: str | None = None,
) -> None:
    """Write tables, plots, animation and data of rollouts as one HTML file, or as a log for other programs.

    \b
    armgpi report results/rollout.nc
    armgpi report elastic/rollout.nc stiff/rollout.nc -o both.html
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.cli import pictures
    from armgpi.loop import rollout as rollouts

    is_log = output.suffix.lower() in LOGS
    if not is_log:
        pictures.check_packages("report", "--out")
    pictures.check_file(output, "--out")
    import_xarray()
    from armgpi.viewing import report as reports

    loaded = {}
    files = [path / "rollout.nc" if path.is_dir() else path for path in files]
    for path in files:
        name = path.parent.name if path.stem == "rollout" and path.parent.name else path.stem
        while name in loaded:
            name += "'"
        loaded[name] = _log(path, robot) if path.suffix == ".armlog" else rollouts.load(path)
    result = reports.merge_rollouts(loaded)
    if is_log:
        from armgpi.loop import logs

        say(f"wrote {logs.write(result, output)}", err=True)
        return
    page = reports.build(
        result,
        None if robot is None else _arm(robot, result),
        title=title,
        configuration=_configuration(files),
        frame=frame,
        folder=files[0].parent,
        world=_world(files),
    )
    say(f"wrote {reports.write(page, output)}", err=True)


def _rollout_of_folder(target: str) -> str:
    """Return the rollout in a folder that `--out` of a run wrote; any other target as it is."""
    inside = Path(target) / "rollout.nc"
    return str(inside) if inside.is_file() else target


def _film(targets: list[str], out: Path, how: opt.Loading, robot: str | None, frame: str | None) -> Path:
    """Write the film of a rollout and return its path."""
    from armgpi.cli import pictures
    from armgpi.viewing import film

    pictures.check_packages("plot", "--out")
    film.check_path(out)
    result, arm = _rollout(targets, how, robot)
    with progress(f"drawing {out.name}") as show:
        return film.write(result, out, arm, frame=frame, progress=show)


def _rollout(targets: list[str], how: opt.Loading, robot: str | None) -> tuple[xr.Dataset, Robot]:
    """Return the rollout that shall be shown, and its arm."""
    from armgpi.loop import rollout as rollouts
    from armgpi.viewing import scene

    if Path(targets[0]).suffix.lower() != ".nc":
        raise refusal("FILE", f"a film is of a rollout (.nc) or its folder, and {targets[0]} is neither")
    given = {"--lock": how.lock, "--keep": how.keep, "--mimic": how.mimic, "--repair": how.repair}
    for option, value in given.items():
        if value:
            raise refusal(option, "is for robots; a rollout has its joints locked already")
    if len(targets) > 1:
        raise refusal("FILE", f"one rollout at a time, or `armgpi report {' '.join(targets)}`")
    import_xarray()
    result = rollouts.load(targets[0])
    arm = scene.robot_of(result, Path(targets[0]).parent) if robot is None else _arm(robot, result)
    return result, arm


def _page(targets: list[str], how: opt.Loading, robot: str | None, frame: str | None) -> str:
    """Return the page of what shall be shown."""
    from armgpi.robot.robot import Robot
    from armgpi.viewing import meshcat

    if Path(targets[0]).suffix.lower() == ".nc":
        result, arm = _rollout(targets, how, robot)
        return meshcat.rollout_page(result, arm, frame=frame)
    given = {"--lock": how.lock, "--keep": how.keep, "--frame": frame}
    for option in (option for option, value in given.items() if value and len(targets) > 1):
        raise refusal(option, "is for one robot at a time")
    if robot is not None:
        raise refusal("--robot", "requires a rollout")
    # Joints that mimic another follow it, if nothing else is said; one that is locked without a value is
    # locked where it is nearest to zero.
    loading: dict[str, Any] = {"mimic": "follow", **opt.robot_given(how)}
    for name in filter(is_experiment, targets):
        expected = f"name its robot, or the rollout that `armgpi run {name}` writes"
        raise refusal("FILE", f"{name} is an experiment file; {expected}")
    with names_of_options(**{key: loading.get(key) for key in ("lock", "keep", "repair")}):
        robots = [Robot.load(name, **loading) for name in targets]
    return meshcat.robot_page(*robots, frame=frame)


def _log(path: Path, robot: str | None) -> xr.Dataset:
    """Return a log of an arm as a rollout of a robot."""
    from armgpi.loop.log import read, to_rollout
    from armgpi.robot.robot import Robot

    if robot is None:
        raise refusal("--robot", f"{path} is a log, which does not have its arm: name it")
    there = read(path)
    return to_rollout(there, Robot.load(robot, keep=there.header["joints"]))


def _arm(name: str, result: xr.Dataset) -> Robot:
    """Load a robot with the joints of a rollout, all others locked."""
    from armgpi.robot.robot import Robot

    return Robot.load(name, keep=[str(joint) for joint in result["joint"].values])


def _world(files: list[Path]) -> str:
    """Return what was simulated of a single rollout; empty where its experiment is not beside it."""
    from armgpi import config
    from armgpi.config import arms, world

    beside = files[0].parent / "experiment.yaml"
    if len(files) > 1 or not beside.is_file():
        return ""
    try:
        return world.describe(*arms.resolve(*config.read(beside)), every=True)
    except ArmgpiError:  # its arm, say, is not there any more; the page says so itself
        return ""


def _configuration(files: list[Path]) -> str | None:
    """Return the experiment file beside a single rollout, as `armgpi run --out` writes it."""
    beside = files[0].parent / "experiment.yaml"
    if len(files) > 1 or not beside.is_file():
        return None
    check_set(beside.parent, [beside.name])
    try:
        return read_bytes(beside, 1_000_000).decode(errors="replace")
    except OSError:  # too large for one that armgpi wrote
        return None
