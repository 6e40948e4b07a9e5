"""The command that expands a xacro file to a URDF."""

from __future__ import annotations

from pathlib import Path

from armgpi.cli.parsing import refusal
from armgpi.cli.terminal import say_data
from armgpi.cli.written import write

#: Its options; see :func:`armgpi.cli.options.with_rows`.
ROWS = {
    "file <FILE>": "Path of a xacro file (robot.urdf.xacro).",
    "values <[NAME:=VALUE]...>": "Values of its arguments (<xacro:arg>).",
    "out --out -o FILE": "URDF to write; by default it is printed.",
}


def expand(
    file: Path,
    values: list[str] | None = None,
    package_dir: list[Path] | None = None,
    out: Path | None = None,
) -> None:
    """Expand a xacro file to a URDF.

    xacro evaluates expressions of the file and reads what it includes, with your rights.

    \b
    armgpi expand ur.urdf.xacro ur_type:=ur5e name:=ur5e -o ur5e.urdf
    armgpi inspect ur5e.urdf
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.robot import xacro

    arguments = {}
    for each in values or []:
        name, assigned, value = each.partition(":=")
        if not assigned or not name:
            raise refusal("NAME:=VALUE", f"{each!r}: expected the name of an argument, := and its value")
        arguments[name] = value
    text = xacro.expand(file, arguments, package_dir or [], Path.cwd() if out is None else out.parent)
    if out is None:
        say_data(text)
        return
    write(out, text, "--out")
