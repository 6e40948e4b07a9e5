"""The command that runs every arm."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Annotated

import typer

from armgpi.cli import options as opt
from armgpi.cli.derive import write
from armgpi.cli.parsing import FAILED, stoppable
from armgpi.cli.terminal import say


@stoppable
def zoo(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ROBOT]...", help="Which ones; all by default.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write the table to a Markdown file.")
    ] = None,
    as_json: opt.Json = False,
) -> None:
    """Run every arm that can be loaded with default gains, empty and loaded, and print one table.

    \b
    armgpi zoo ur5 panda
    armgpi zoo --out zoo.md
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.health.zoo import markdown, run
    from armgpi.robot import robots

    known = robots.names()
    for name in names or ():
        robots.locate(name)
    rows = []
    for name in names or known:
        say(name, err=True)
        rows += run(name)
    table = markdown(rows)
    if out is not None:
        write(out, table, "--out")
    if as_json:
        say(json.dumps([_plain(row._asdict()) for row in rows]))
    else:
        say(table, lines=True)
    if any(row.end.startswith("diverged") for row in rows):
        sys.exit(FAILED)


def _plain(value: object) -> object:
    """Return a value that JSON has: None for a number that there is not."""
    if isinstance(value, dict):
        return {key: _plain(x) for key, x in value.items()}
    if isinstance(value, tuple):
        return [_plain(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
