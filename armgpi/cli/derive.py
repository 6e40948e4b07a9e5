"""The command that derives closed-form equations of motion."""

from __future__ import annotations

from pathlib import Path

from armgpi.cli.arms import load_robot
from armgpi.cli.terminal import say
from armgpi.cli.written import write

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "robot <ROBOT>": "Name of a robot (see `armgpi robots`) or path of a URDF file.",
    "latex": "Write LaTeX instead of a Python module.",
    "numbers": "Insert the values of masses and lengths instead of symbols.",
    "out --out -o FILE": "File to write; by default it is printed.",
}


def derive(
    robot: str,
    latex: bool = False,
    numbers: bool = False,
    lock: list[str] | None = None,
    keep: list[str] | None = None,
    package_dir: list[Path] | None = None,
    out: Path | None = None,
) -> None:
    """Derive D, C and G of an arm of up to four joints in closed form.

    \b
    armgpi derive anthropomorphic3 -o arm.py
    armgpi validate arm.py --robot anthropomorphic3
    armgpi derive double_pendulum --latex
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.validation.derivation import derive as derived

    arm = load_robot(robot, lock, keep)
    result = derived(arm, numbers=numbers)
    text = result.latex() if latex else result.python()
    if out is None:
        say(text, lines=True)
        return
    write(out, text, "--out")
