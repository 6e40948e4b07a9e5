"""The command that compares hand-derived dynamics with a robot's."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from armgpi.cli import options as opt
from armgpi.cli.derive import load, write
from armgpi.cli.parsing import FAILED, INTERRUPTED, OK, refusal
from armgpi.cli.terminal import say

Model = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="Python file, module (with :Name when it has several models), SymPy file, or 'paper'.",
        show_default=False,
    ),
]
Reference = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="ROBOT",
        help="What it is a model of: name or URDF; without, laws alone are checked.",
    ),
]
FrameName = Annotated[
    str | None,
    typer.Option("--frame", metavar="NAME", help="Frame that its kinematics mean; the tip by default."),
]
Tolerance = Annotated[
    float, typer.Option("--rtol", metavar="NUMBER", help="Relative error up to which two values agree.")
]
Joints = Annotated[
    int | None, typer.Option(metavar="NUMBER", help="Number of joints, without a robot; found by trying.")
]
TimeLimit = Annotated[
    float,
    typer.Option(
        "--time-limit",
        metavar="SECONDS",
        help="How long one call of the model may take [s]; reading it, twelve times that.",
    ),
]
Html = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write the report as a page.")]
Suggest = Annotated[
    Path | None,
    typer.Option("--suggest-urdf", metavar="FILE", help="Write a URDF whose parameters fit the model best."),
]
Seed = Annotated[int, typer.Option(metavar="NUMBER", help="Seed of the random states.")]


def validate(
    model: Model,
    robot: Reference = None,
    lock: opt.Lock = None,
    keep: opt.Keep = None,
    frame: FrameName = None,
    rtol: Tolerance = 1e-9,
    joints: Joints = None,
    time_limit: TimeLimit = 5.0,
    seed: Seed = 0,
    html: Html = None,
    suggest_urdf: Suggest = None,
    as_json: opt.Json = False,
) -> None:
    """Compare hand-derived dynamics with Pinocchio's and say what is wrong with them.

    \b
    armgpi validate paper --robot anthropomorphic3
    armgpi validate my_arm.py --robot my_arm.urdf --html report.html
    armgpi validate my_arm.py --suggest-urdf my_arm.urdf
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.validation.check import validate as validated
    from armgpi.validation.skeleton import suggest_urdf as suggested

    if robot is None and (lock or keep or frame):
        raise refusal("--robot", "is missing: --lock, --keep and --frame are about it")
    try:
        arm = None
        if robot is not None:
            arm = load(robot, lock, keep)
        report = validated(
            model, arm, frame=frame, rtol=rtol, joints=joints, time_limit=time_limit, seed=seed
        )
        say(report.to_json() if as_json else str(report), lines=True)
        if html is not None:
            write(html, report.html(), "--html")
        if suggest_urdf is not None:
            suggestion = suggested(model, arm, joints=joints, time_limit=time_limit)
            write(suggest_urdf, suggestion.urdf, "--suggest-urdf")
            say(f"{suggest_urdf}: {suggestion.text}", err=True, lines=True)
    except KeyboardInterrupt:
        say("interrupted", err=True, fg="yellow")
        sys.exit(INTERRUPTED)
    sys.exit(OK if report.agrees else FAILED)
