"""The command that writes a page to play with."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from armgpi.cli import options as opt
from armgpi.cli.declared import values_of
from armgpi.cli.parsing import refusal, stoppable
from armgpi.cli.terminal import say
from armgpi.errors import require_extra

File = Annotated[Path | None, opt.page("File of the page; ROBOT.html by default.")]
#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "open_ --open": "Open the page in a browser.",
}


@stoppable
@opt.add_options
def play(
    context: typer.Context,
    robot: str | None = None,
    controller: str | None = None,
    out: File = None,
    open_: bool = False,
    frame: str | None = None,
    *,
    options: opt.Experiment,
) -> None:
    """Write a page with sliders that simulates the loop again whenever one of them is moved.

    One file, no network: gains, networks, loads, friction, encoders, delays, goals and pushes, with the arm
    and its curves. What it shows can be copied as a command, YAML or Python, and has the same bits there.

    \b
    armgpi play panda --lock panda_finger_joint1 --lock panda_finger_joint2 -o panda.html
    armgpi play --config experiment.yaml --open
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi import config as configuration
    from armgpi.cli import pictures
    from armgpi.cli.settings import settings
    from armgpi.config.building import summary
    from armgpi.viewing import meshcat
    from armgpi.viewing.play import compiler

    pictures.check_packages("html", "--out")
    require_extra("casadi", "compiled")
    compiler()
    asked = opt.Asked(robot=robot, controllers=controller, declared=values_of(context), options=options)
    experiment = configuration.build(*settings(asked, compare=False))
    pictures.check_playable(experiment, frame)
    path = Path(f"{experiment.robot.name}.html") if out is None else out
    pictures.check_file(path, "--out")
    say(summary(experiment), err=True)
    written = meshcat.write(pictures.page_to_play_with(experiment, frame=frame), path)
    say(f"wrote {written}", err=True)
    if open_ and not webbrowser.open(written.resolve().as_uri()):
        raise refusal("--open", f"no browser could be started; open {written} yourself")
