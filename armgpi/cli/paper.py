"""The commands about the paper: reproduce and scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from armgpi.cli.options import FLAG, Backend, Report
from armgpi.cli.parsing import known_backend, stoppable
from armgpi.cli.terminal import say


@stoppable
def reproduce(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="Where to put tables and figures.")
    ] = Path("reproduction"),
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", metavar=FLAG, help="A step of 1e-3 s and no side studies: under half a minute."
        ),
    ] = False,
    backend: Backend = "auto",
    report: Report = None,
) -> None:
    """Run the paper again: Tables 2-4 and Figures 5-13, published beside ours, and what it leaves open.

    \b
    armgpi reproduce
    armgpi reproduce --quick --out quick
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.cli import pictures
    from armgpi.paper.reproduction import reproduce as run

    pictures.check(report=report)
    done = run(
        out,
        quick=quick,
        done=lambda name: say(f"done: {name}", err=True),
        backend=known_backend(backend),
    )
    say(done.summary, lines=True)
    say(f"wrote {len(done.files)} files to {out}, {out / 'reproduction.md'} first", err=True)
    if report is not None:
        from armgpi.view import report as reports

        page = reports.build(
            reports.merge_rollouts(done.contenders), title="The paper's scenario 5.3, reproduced"
        )
        say(f"wrote {reports.write(page, report)}", err=True)


def scenarios(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Which one to print.", show_default=False)
    ] = None,
) -> None:
    """List the paper's scenarios, or print one as an experiment file to edit.

    \b
    armgpi compare --config scenario-5.3
    armgpi scenarios scenario-5.3 > mine.yaml
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi.paper.scenarios import locate, names

    if name is not None:
        say(locate(name).read_text(encoding="utf-8"), lines=True)
        return
    for each in names():
        say(each)
