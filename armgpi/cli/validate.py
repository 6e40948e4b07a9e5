"""The command that compares hand-derived dynamics with a robot's."""

from __future__ import annotations

import sys
from pathlib import Path

from armgpi.cli.derive import load, write
from armgpi.cli.parsing import FAILED, OK, per_joint, refusal, stoppable
from armgpi.cli.terminal import say

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "model <MODEL>": "Python file, module (with :Name when it has several models), SymPy file, or 'paper'.",
    "robot ROBOT": "What it is a model of: name or URDF; without, laws alone are checked.",
    "frame NAME": "Frame that its kinematics mean; the tip by default.",
    "rtol NUMBER": "Relative error up to which two values agree.",
    "joints NUMBER": "Number of joints, without a robot; found by trying.",
    "time_limit SECONDS": "How long one call of the model may take [s]; reading it, twelve times that.",
    "seed NUMBER": "Seed of the random states.",
    "absolute": "The model counts the angles of parallel joints from the base.",
    "from_vertical up|down": "Where the model counts its first level axis from.",
    "names --map NAME=FUNCTION": "What the model calls a function; M, D, C, G are known.",
    "markdown FILE": "Write the report as Markdown.",
    "latex FILE": "Write the report as LaTeX.",
    "suggest_urdf FILE": "Write a URDF whose parameters fit the model best.",
}


@stoppable
def validate(
    model: str,
    robot: str | None = None,
    lock: list[str] | None = None,
    keep: list[str] | None = None,
    package_dir: list[Path] | None = None,
    frame: str | None = None,
    rtol: float = 1e-9,
    joints: int | None = None,
    time_limit: float = 5.0,
    seed: int = 0,
    absolute: bool = False,
    from_vertical: str | None = None,
    rotor_inertia: list[str] | None = None,
    names: list[str] | None = None,
    report: Path | None = None,
    markdown: Path | None = None,
    latex: Path | None = None,
    suggest_urdf: Path | None = None,
    as_json: bool = False,
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
    arm = None if robot is None else load(robot, lock, keep)
    found = validated(
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
    say(found.to_json() if as_json else str(found), lines=True)
    for form, path in {"report": report, "markdown": markdown, "latex": latex}.items():
        if path is not None:
            write(path, found.html() if form == "report" else getattr(found, form)(), f"--{form}")
    if suggest_urdf is not None:
        from armgpi.validation.skeleton import suggest_urdf as suggested  # it imports SciPy, late

        suggestion = suggested(model, arm, joints=joints, time_limit=time_limit)
        write(suggest_urdf, suggestion.urdf, "--suggest-urdf")
        say(f"{suggest_urdf}: {suggestion.text}", err=True, lines=True)
    sys.exit(OK if found.agrees else FAILED)
