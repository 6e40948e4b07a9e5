"""The command that holds laws against each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from armgpi.cli import options as opt
from armgpi.cli.parsing import refusal, split, stoppable
from armgpi.cli.terminal import say
from armgpi.cli.tune import show
from armgpi.escape import json_data


@stoppable
def contend(
    arms: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ROBOT]...",
            help="Which ones; ur5, panda, kinova and the paper's arm.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="Where the contest and its tables go.")
    ] = Path("contest"),
    laws: Annotated[
        list[str] | None,
        typer.Option(
            *("--controllers", "--law"), metavar="NAMES", help="Which ones; may be repeated. All by default."
        ),
    ] = None,
    evaluations: Annotated[int, typer.Option(help="Candidates for each law, arm and seed.")] = 481,
    seeds: Annotated[int, typer.Option(help="Searches of each law and arm.")] = 2,
    reality: Annotated[
        str, typer.Option(metavar="NAME", help="What the arms are: bare, geared or elastic.")
    ] = "bare",
    quick: Annotated[
        bool, typer.Option("--quick", metavar=opt.FLAG, help="A small contest, of minutes for one arm.")
    ] = False,
    accept_code: opt.AcceptCode = False,
    report: opt.Report = None,
    as_json: opt.Json = False,
) -> None:
    """Tune every law alike, for several budgets of torque variation, and judge them on what none has seen.

    A contest that was stopped goes on where it was.

    \b
    armgpi contend --out contest
    armgpi contend anthropomorphic3 --quick --out quick
    """  # noqa: D301 (\b keeps the lines apart)
    from armgpi import files
    from armgpi.robot import robots
    from armgpi.studies import contend as contests

    names = list(dict.fromkeys(split(arms or list(contests.ARMS))))
    for name in names:
        robots.locate(name)
    if not 2 <= evaluations <= 1_000_000:
        raise refusal("--evaluations", f"must be from 2 to 1000000, got {evaluations}")
    if not 1 <= seeds <= 1000:
        raise refusal("--seeds", f"must be from 1 to 1000, got {seeds}")
    if reality not in ("bare", "geared", "elastic"):
        raise refusal("--reality", f"must be bare, geared or elastic, got {reality!r}")
    setting = contests.QUICK if quick else contests.Setting(evaluations, seeds)
    setting = setting._replace(reality=reality)
    chosen = laws or list(contests.CONTENDERS)
    study = contests.enter(out, setting, accept_code)
    entries = contests.run(study, names, chosen, setting, lambda text: say(text, err=True))
    text = f"{contests.markdown(entries)}\n{contests.verdict(entries)}"
    paths = [files.write(out / "contest.md", text)]
    data = json_data([entry._asdict() for entry in entries]) if as_json else None
    picture = out / "contest.png", lambda pictures: pictures.contest_picture(entries)
    show("Contest of the laws", text, data, paths, report, *picture)
