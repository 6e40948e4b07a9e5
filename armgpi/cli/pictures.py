"""Pictures of what was run, for the commands that simulate and for those that look."""

from __future__ import annotations

import getpass
import os
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armgpi.cli.parsing import refusal, refusal_of
from armgpi.cli.terminal import progress, say
from armgpi.errors import ParameterError

if TYPE_CHECKING:
    import xarray as xr

    from armgpi.cli.options import Run
    from armgpi.config import Experiment
    from armgpi.robot.robot import Robot

#: Picture -> packages that it needs.
_NEEDS = {
    "plot": ("matplotlib",),
    "view": ("trimesh",),
    "html": ("trimesh",),
    "report": ("trimesh",),
}


def check(
    *,
    plot: Path | None = None,
    view: bool = False,
    html: Path | None = None,
    report: Path | None = None,
    interactive: bool = False,
) -> None:
    """Refuse pictures that cannot be made: better before a long run than after it."""
    for picture, wanted in {"plot": plot, "view": view, "html": html, "report": report}.items():
        if wanted:
            check_packages(picture, f"--{picture}")
    if plot is not None:
        from armgpi.viewing import plots

        try:
            plots.check_path(plot)
        except ParameterError as error:
            raise refusal_of("--plot", error) from None
    if interactive:
        if report is None:
            raise refusal("--interactive", "requires --report FILE")
        from armgpi.viewing.play import compiler

        compiler()
    for picture, file in {"plot": plot, "html": html, "report": report}.items():
        if file is not None:
            check_file(file, f"--{picture}")


def check_packages(picture: str, option: str) -> None:
    """Refuse a picture whose packages are not installed."""
    for package in _NEEDS[picture]:
        if find_spec(package) is None:
            raise refusal(option, f"needs the package {package!r}: pip install {package}")


def check_file(path: Path, option: str) -> None:
    """Refuse a file that cannot be written."""
    folder = path.parent
    if path.is_dir():
        raise refusal(option, f"{path} is a folder; name a file")
    if not folder.is_dir():
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise refusal(option, f"{folder}: cannot be made: {error.strerror or error}") from None
    if path.exists() and not path.is_file():  # a pipe or a device
        return
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise refusal(option, f"{folder}: cannot be written to: {error.strerror or error}") from None


def make(options: Run, result: xr.Dataset, experiment: Experiment) -> list[Path]:
    """Write the pictures asked for and return their files."""
    written: list[Path] = []
    if not (options.plot or options.html or options.report):
        return written
    from armgpi.config import dump, world

    if result.sizes["time"] < 1:
        say("note: no pictures, as the run was stopped before its first sample", err=True)
        return written
    robot = one(experiment.plant.robot)
    if options.plot is not None:
        from armgpi.viewing import plots  # not for reports, which draw without Matplotlib

        written.append(plots.save(plots.overview(result), options.plot))
    if options.html is not None:
        from armgpi.viewing import meshcat

        written.append(meshcat.write(meshcat.rollout_page(result, robot), options.html))
    if options.report is not None:
        from armgpi.viewing import report

        text = dump(experiment.config)
        result = _with_estimated_wrench(result, experiment)
        if options.interactive:
            page = page_to_play_with(experiment, more=report.sections(result, robot, text))
        else:
            simulated = world.describe(experiment.config, experiment.robot, every=True)
            page = report.build(result, robot, configuration=text, world=simulated)
        written.append(report.write(page, options.report))
    return written


def _with_estimated_wrench(result: xr.Dataset, experiment: Experiment) -> xr.Dataset:
    """Return a result with the wrench that torques and positions tell, where something touches the tool.

    The model is the experiment's arm, without what its controller does not know. What recorded few samples,
    or diverged, has no estimate.
    """
    if "contact_force" not in result or experiment.config.record_every != 1 or result.sizes["time"] < 2:
        return result
    import numpy as np

    from armgpi.loop.wrench import tool_wrench

    if not bool(np.isfinite(result["q_measured"]).all() & np.isfinite(result["tau"]).all()):
        return result
    return tool_wrench(result, experiment.robot)


def check_playable(experiment: Experiment, frame: str | None = None) -> None:
    """Refuse an experiment or a frame that no page can have, before anything is said of it."""
    from armgpi.viewing.play.page import check_experiment

    check_experiment(experiment, frame)


def page_to_play_with(experiment: Experiment, **options: Any) -> str:
    """Return the page of an experiment; the user sees how far it is. See `armgpi.viewing.play.build`."""
    from armgpi.viewing.play import build

    if not sys.stderr.isatty():
        say("making the page: some 12 s the first time, 3 for the next one of the same arm", err=True)
    with progress() as told:
        return build(
            experiment, progress=lambda what, share: told(f"{what} the loop: {share:4.0%}"), **options
        )


def serve_rollout(result: xr.Dataset, robot: Any) -> None:
    """Show rollouts until Ctrl-C."""
    from armgpi.viewing import meshcat

    serve(meshcat.rollout_page(result, one(robot)))


def one(robot: Any) -> Robot:
    """Return the robot, the first of a batch."""
    first: Robot = robot.first if hasattr(robot, "first") else robot
    return first


def serve(page: str, port: int | None = None, browser: bool = False) -> None:
    """Serve a page to this machine until Ctrl-C, saying where it is."""
    from armgpi.viewing.meshcat import Server

    has_display = sys.platform in ("darwin", "win32") or any(
        map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))
    )
    if browser and not has_display:
        raise refusal(
            "--open", "there is no display here; leave it out and open the printed address elsewhere"
        )
    try:
        with Server(page, port) as server:
            say(f"{server.url}  (Ctrl-C ends it)")
            if remote := _ssh(server.port):
                say(f"from your own machine: {remote}")
            sys.stdout.flush()
            if browser and not server.open():
                raise refusal("--open", f"no browser could be started; open {server.url} yourself")
            server.wait()
    except KeyboardInterrupt:
        say("stopped", err=True)


def _ssh(port: int) -> str:
    """Return the command that makes the port reachable from where the user sits, if that is elsewhere."""
    parts = os.environ.get("SSH_CONNECTION", "").split()
    if len(parts) != 4:
        return ""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a user without a name
        return f"ssh -L {port}:127.0.0.1:{port} {parts[2]}"
    return f"ssh -L {port}:127.0.0.1:{port} {user}@{parts[2]}"
