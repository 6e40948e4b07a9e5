"""The command that compares hand-derived dynamics with a robot's."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armgpi.cli.arms import load_robot
from armgpi.cli.parsing import per_joint, refusal, stoppable
from armgpi.cli.terminal import say
from armgpi.cli.written import write

if TYPE_CHECKING:
    from armgpi.robot.robot import Robot

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "model <MODEL>": "Python file, module (with :Name when it has several models), SymPy file, or 'paper'.",
    "robot ROBOT": (
        "Robot that the model describes: name or URDF; without it, only structural properties are checked."
    ),
    "frame NAME": "Frame of its kinematics; the tip by default.",
    "rtol NUMBER": "Relative error up to which two values agree.",
    "joints NUMBER": "Number of joints, where no robot is given; by default found by trying.",
    "time_limit SECONDS": (
        "Longest time for one call of the model [s]; reading it may take twelve times as long."
    ),
    "seed NUMBER": "Seed of the random states.",
    "isolate": (
        "Run the model without network, other processes and files to write; needs user namespaces of Linux, "
        "or bubblewrap."
    ),
    "absolute": "The model measures the angles of parallel joints from the base (absolute angles).",
    "from_vertical up|down": "Direction from which the model measures its first horizontal axis.",
    "viscous_friction NUMBERS": (
        "Viscous friction that its dynamics contain [N m s/rad or N s/m]: 'j1=0.1,j2=0.05', or a number."
    ),
    "passive JOINT": (
        "Joint without a motor: its torque is zero, or no argument of forward_dynamics; may be repeated."
    ),
    "names --map NAME=FUNCTION": (
        "A function of the model and what it is, such as M_of_q=mass_matrix; functions named M, D, C and G "
        "are known."
    ),
    "allow_uncompared": "Accept functions of the model that were not compared: exit code 0 in place of 3.",
    "markdown FILE": "Write the report as Markdown.",
    "latex FILE": "Write the report as LaTeX.",
    "suggest_urdf FILE": "Write a URDF with the parameters that fit the model best.",
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
    viscous_friction: list[str] | None = None,
    passive: list[str] | None = None,
    names: list[str] | None = None,
    allow_uncompared: bool = False,
    isolate: bool = False,
    report: Path | None = None,
    markdown: Path | None = None,
    latex: Path | None = None,
    suggest_urdf: Path | None = None,
    as_json: bool = False,
) -> None:
    """Compare hand-derived dynamics with Pinocchio's, and name the mistakes in them.

    The model is code, which runs with your rights: read a stranger's before you run it, or --isolate it.

    \b
    armgpi validate paper --robot anthropomorphic3
    armgpi validate my_arm.py --robot my_arm.urdf --report report.html
    armgpi validate my_arm.py --suggest-urdf my_arm.urdf
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.validation.check import validate as validated

    about_robot = {"--lock": lock, "--keep": keep, "--frame": frame, "--absolute": absolute}
    about_robot |= {"--from-vertical": from_vertical, "--rotor-inertia": rotor_inertia, "--passive": passive}
    about_robot |= {"--viscous-friction": viscous_friction}
    if robot is None and any(about_robot.values()):
        *first, last = about_robot
        raise refusal("--robot", f"is missing: {', '.join(first)} and {last} are about it")
    arm = None if robot is None else load_robot(robot, lock, keep)
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
        rotor_inertia=_per_joint(rotor_inertia, "--rotor-inertia"),
        viscous_friction=_per_joint(viscous_friction, "--viscous-friction"),
        passive=passive or (),
        names=_read_map(names),
        isolate=isolate,
    )
    allow = allow_uncompared
    say(found.to_json(allow) if as_json else found.text(allow), lines=True)
    forms = ("--report", report, partial(found.html, allow)), ("--markdown", markdown, found.markdown)
    for option, path, form in (*forms, ("--latex", latex, found.latex)):
        if path is not None:
            write(path, form(), option)
    code = found.judge(allow).exit_code
    if suggest_urdf is not None and not _suggest(suggest_urdf, model, arm, joints, time_limit, isolate):
        code = code or 1
    sys.exit(code)


def _per_joint(items: list[str] | None, option: str) -> Any:
    """Return numbers per joint from JOINT=NUMBER; None where there are none."""
    return per_joint(",".join(items), option) if items else None


def _suggest(
    path: Path, model: str, arm: Robot | None, joints: int | None, time_limit: float, isolate: bool
) -> bool:
    """Write the URDF that fits a model best, and tell whether it is the model."""
    from armgpi.validation import skeleton  # it imports SciPy, late

    suggestion = skeleton.suggest_urdf(model, arm, joints=joints, time_limit=time_limit, isolate=isolate)
    write(path, suggestion.urdf, "--suggest-urdf")
    say(f"{path}: {suggestion.text}", err=True, lines=True)
    return suggestion.rest <= skeleton.EXACT


def _read_map(items: list[str] | None) -> dict[str, str]:
    """Return what the model calls each function, from NAME=FUNCTION."""
    functions: dict[str, str] = {}
    for item in items or ():
        if item.count("=") != 1:
            raise refusal("--map", f"expected NAME=FUNCTION, as in M=mass_matrix, got {item!r}")
        name, function = item.split("=")
        if name in functions:
            raise refusal("--map", f"expected every name once, got {name!r} twice")
        functions[name] = function
    return functions
