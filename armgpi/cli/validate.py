"""The command that compares hand-derived dynamics with a robot's."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armgpi.cli import options as opt
from armgpi.cli.derive import load, write
from armgpi.cli.parsing import FAILED, INTERRUPTED, OK, per_joint, refusal
from armgpi.cli.terminal import say

if TYPE_CHECKING:
    from armgpi.validation.report import DynamicsReport

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
Suggest = Annotated[
    Path | None,
    typer.Option("--suggest-urdf", metavar="FILE", help="Write a URDF whose parameters fit the model best."),
]
Absolute = Annotated[
    bool, typer.Option("--absolute", help="The model counts the angles of parallel joints from the base.")
]
FromVertical = Annotated[
    str | None,
    typer.Option(
        "--from-vertical", metavar="up|down", help="Where the model counts its first level axis from."
    ),
]
Names = Annotated[
    list[str] | None,
    typer.Option(
        "--map", metavar="NAME=FUNCTION", help="What the model calls a function; M, D, C, G are known."
    ),
]
Markdown = Annotated[
    Path | None, typer.Option("--markdown", metavar="FILE", help="Write the report as Markdown.")
]
Latex = Annotated[Path | None, typer.Option("--latex", metavar="FILE", help="Write the report as LaTeX.")]
Seed = Annotated[int, typer.Option(metavar="NUMBER", help="Seed of the random states.")]


def validate(
    model: Model,
    robot: Reference = None,
    lock: opt.Lock = None,
    keep: opt.Keep = None,
    package_dir: opt.PackageDir = None,
    frame: FrameName = None,
    rtol: Tolerance = 1e-9,
    joints: Joints = None,
    time_limit: TimeLimit = 5.0,
    seed: Seed = 0,
    absolute: Absolute = False,
    from_vertical: FromVertical = None,
    rotor_inertia: opt.RotorInertia = None,
    names: Names = None,
    page: opt.Report = None,
    markdown: Markdown = None,
    latex: Latex = None,
    suggest_urdf: Suggest = None,
    as_json: opt.Json = False,
) -> None:
    """Compare hand-derived dynamics with Pinocchio's and say what is wrong with them.

    \b
    armgpi validate paper --robot anthropomorphic3
    armgpi validate my_arm.py --robot my_arm.urdf --report report.html
    armgpi validate my_arm.py --suggest-urdf my_arm.urdf
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.validation.check import validate as validated

    if robot is None and (lock or keep or frame or absolute or from_vertical or rotor_inertia):
        told = "--lock, --keep, --frame, --absolute, --from-vertical and --rotor-inertia are about it"
        raise refusal("--robot", f"is missing: {told}")
    if wrong := [item for item in names or () if item.count("=") != 1]:
        raise refusal("--map", f"expected NAME=FUNCTION, as in M=mass_matrix, got {wrong[0]!r}")
    mapped = [item.split("=")[0] for item in names or ()]
    if twice := next((name for name in mapped if mapped.count(name) > 1), None):
        raise refusal("--map", f"expected every name once, got {twice!r} twice")
    try:
        arm = None
        if robot is not None:
            arm = load(robot, lock, keep)
        report = validated(
            model,
            arm,
            frame=frame,
            rtol=rtol,
            joints=joints,
            time_limit=time_limit,
            seed=seed,
            absolute=absolute,
            from_vertical=from_vertical,
            rotor_inertia=per_joint(",".join(rotor_inertia), "--rotor-inertia") if rotor_inertia else None,
            names=dict(item.split("=") for item in names or ()),
        )
        say(report.to_json() if as_json else str(report), lines=True)
        _write(report, {"html": page, "markdown": markdown, "latex": latex})
        if suggest_urdf is not None:
            from armgpi.validation.skeleton import suggest_urdf as suggested  # it imports SciPy, late

            suggestion = suggested(model, arm, joints=joints, time_limit=time_limit)
            write(suggest_urdf, suggestion.urdf, "--suggest-urdf")
            say(f"{suggest_urdf}: {suggestion.text}", err=True, lines=True)
    except KeyboardInterrupt:
        say("interrupted", err=True, fg="yellow")
        sys.exit(INTERRUPTED)
    sys.exit(OK if report.agrees else FAILED)


def _write(report: DynamicsReport, files: Mapping[str, Path | None]) -> None:
    """Write a report in the forms that are asked for."""
    for form, path in files.items():
        if path is not None:
            write(path, getattr(report, form)(), f"--{'report' if form == 'html' else form}")
